# shellcheck shell=bash
# Set-up shared by drivers/quickstart and tests/run, which source this file: Debian packages, Python environment, build.

# What the build needs on Debian 12, and what tests, models and pictures need beside it; the only list of packages in the project.
hb_build_packages=(
   gcc gfortran cmake make python3
   libopenmpi-dev openmpi-bin libhdf5-openmpi-dev libfftw3-dev libopenblas-dev libsuitesparse-dev
   libsundials-dev
)
hb_packages=(
   "${hb_build_packages[@]}"
   python3-venv python3-setuptools python3-wheel
   python3-numpy python3-h5py python3-matplotlib python3-xarray python3-h5netcdf python3-netcdf4 python3-pytest
   python3-scipy python3-cvxopt python3-meshio calculix-ccx
)
# Beside these for long tests: a browser, for pages of results.
# shellcheck disable=SC2034 # used by tests/run
hb_long_packages=(chromium)

hb_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
hb_venv=$hb_root/build/venv
hb_status_packages=3 # exit status when packages are missing and may not be installed

# Names a stage, with the time since the start of the script.
hb_say() { printf '\n==> [%d:%02d min] %s\n' $((SECONDS / 60)) $((SECONDS % 60)) "$*"; }

hb_fail() {
   printf '%s: %s\n' "${0##*/}" "$*" >&2
   exit 1
}

# Leaves with status 2 unless the option is followed by a number of 1 or more: hb_check_jobs OPTION VALUE
hb_check_jobs() {
   [[ $2 =~ ^[1-9][0-9]*$ ]] && return
   printf '%s: %s needs a number of 1 or more, not "%s"\n' "${0##*/}" "$1" "$2" >&2
   exit 2
}

# Environment of every program that we start.
hb_environment() {
   export OPENBLAS_NUM_THREADS=1 MPLBACKEND=Agg
   if ((EUID == 0)); then
      export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
   fi
   if (($(nproc) < 2)); then
      export OMPI_MCA_rmaps_base_oversubscribe=1
   fi
}

# hb_missing_packages PACKAGE...
hb_missing_packages() {
   local package
   for package; do
      [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null) == installed ]] ||
         printf '%s\n' "$package"
   done
}

# Installs what is missing; with `no` as the first argument, or on another system than Debian, only says what is missing:
# hb_install_packages yes|no [PACKAGE]...   (default: all)
hb_install_packages() {
   local missing as_root=() wanted=("${@:2}")
   ((${#wanted[@]} > 0)) || wanted=("${hb_packages[@]}")
   if ! command -v dpkg-query >/dev/null; then
      hb_say "No dpkg here: going on with what is installed. On Debian the packages would be"
      printf '%s\n' "${wanted[*]}"
      return
   fi
   mapfile -t missing < <(hb_missing_packages "${wanted[@]}")
   ((${#missing[@]} == 0)) && return
   if [[ $1 == no ]]; then
      hb_say "Missing packages, going on without them (--no-install): ${missing[*]}"
      return
   fi
   if ((EUID != 0)); then
      # sudo may ask for a password only where somebody can answer
      if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; then
         as_root=(sudo)
      else
         printf '%s: these packages are missing, and only root can install them:\n\n' "${0##*/}" >&2
         printf '   apt-get update && apt-get install --no-install-recommends %s\n\n' "${missing[*]}" >&2
         printf 'Run that line as root, then this command again. --no-install goes on without them.\n' >&2
         exit "$hb_status_packages"
      fi
   fi
   hb_say "Installing ${#missing[@]} packages (a few minutes on a fresh machine): ${missing[*]}"
   "${as_root[@]}" apt-get update -qq || echo "apt-get update failed; trying with the package lists at hand" >&2
   "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
      apt-get install -qq -o Dpkg::Use-Pty=0 --yes --no-install-recommends "${missing[@]}" >/dev/null ||
      hb_fail "apt-get could not install the packages (see above)"
}

# The Python of the system, which knows its packages.
hb_python() {
   if [[ -x /usr/bin/python3 ]]; then echo /usr/bin/python3; else command -v python3; fi
}

# Python environment in build/venv with the packages of the system, and ours as they stand in the tree; downloads nothing but scikit-fem
# and AUTO, which Debian does not have, and goes on without them.
hb_make_venv() {
   hb_say "Python environment in build/venv"
   # a copied or moved tree leaves an environment that points elsewhere, and so does a changed Python
   if ! "$hb_venv/bin/python" -c 'import sys; sys.exit(sys.prefix != sys.argv[1])' "$hb_venv" 2>/dev/null; then
      "$(hb_python)" -m venv --clear --system-site-packages "$hb_venv" || hb_fail "cannot make build/venv"
   fi
   hb_place_packages || hb_fail "cannot place our packages into build/venv"
   "$hb_venv/bin/nhbm-post" --version
   "$hb_venv/bin/nhbm-model" --version
   "$hb_venv/bin/python" -c 'import skfem' 2>/dev/null ||
      "$hb_venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --retries 1 --timeout 20 'scikit-fem>=8' ||
      echo "no scikit-fem: 'nhbm-model' makes no examples, and tests with them are left out"
   "$hb_venv/bin/python" -c 'import xpplab' 2>/dev/null ||
      "$hb_venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --retries 1 --timeout 20 'xpplab>=0.1.2' ||
      echo "no xpplab: long tests beside AUTO are left out"
}

# Names the folders of our packages to the Python of build/venv, and makes the commands of pyproject.toml: pip would need a build backend
# that Debian does not have.
hb_place_packages() {
   local command modules=(nhbm-model=nhbm.command nhbm-post=nhbm_post.__main__) folder
   folder=$("$hb_venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))') || return
   printf '%s\n' "$hb_root/drivers/python/src" "$hb_root/postproc/src" >"$folder/nhbm.pth" || return
   for command in "${modules[@]}"; do
      printf '#!%s\nimport sys\n\nfrom %s import main_in_child_process\n\nsys.exit(main_in_child_process())\n' \
         "$hb_venv/bin/python" "${command#*=}" >"$hb_venv/bin/${command%%=*}" || return
      chmod +x "$hb_venv/bin/${command%%=*}" || return
   done
}

# Configures and builds a preset: hb_build PRESET JOBS [TARGET [option of cmake]...]
hb_build() {
   hb_say "Building the $1 preset in build/$1"
   (cd "$hb_root" && cmake --preset "$1" -DPython3_EXECUTABLE="$(hb_python)" -DHB_PYTHON="$hb_venv/bin/python" "${@:4}") ||
      hb_fail "cmake could not configure $1"
   (cd "$hb_root" && cmake --build --preset "$1" --parallel "$2" --target "${3:-all}") || hb_fail "the $1 build failed"
}
