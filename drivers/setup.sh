# shellcheck shell=bash
# Set-up shared by drivers/quickstart and tests/run, which source this file: Debian packages, Python environment, build.

# The only list of Debian packages in the project. What the build needs, what pictures need beside it, what tests need beside these,
# and what some recipes and comparisons use: these are left out where a release does not have them.
# shellcheck disable=SC2034 # used by the scripts that source this file
hb_build_packages=(
   gcc gfortran cmake make python3
   libopenmpi-dev openmpi-bin libhdf5-openmpi-dev libfftw3-dev libopenblas-dev libsuitesparse-dev
   libsundials-dev
)
# shellcheck disable=SC2034
hb_picture_packages=(python3-numpy python3-h5py python3-matplotlib)
# shellcheck disable=SC2034
hb_test_packages=(python3-venv python3-scipy python3-xarray python3-h5netcdf python3-netcdf4 python3-pytest)
# shellcheck disable=SC2034
hb_optional_packages=(python3-cvxopt python3-meshio calculix-ccx)
# Beside these for long tests: a browser, for pages of results, and an HDF5 without MPI.
# shellcheck disable=SC2034
hb_long_packages=(chromium libhdf5-dev calculix-ccx-test)
# What a wheel is built from beside the packages of the build.
# shellcheck disable=SC2034
hb_wheel_packages=(libhdf5-dev python3-venv ca-certificates git g++ ninja-build pkg-config binutils)
# What one for 64-bit Arm is built from on another processor.
# shellcheck disable=SC2034
hb_cross_packages=(
   gcc-aarch64-linux-gnu g++-aarch64-linux-gnu gfortran-aarch64-linux-gnu cmake python3-venv ca-certificates git ninja-build
   pkg-config binutils libhdf5-dev:arm64 libfftw3-dev:arm64 libopenblas-dev:arm64 libsuitesparse-dev:arm64
)
# Optional modules from PyPI, with versions: finite element models for examples, and AUTO.
hb_optional_modules=(skfem=scikit-fem==12.0.2 xpplab=xpplab==0.1.2)

hb_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
hb_venv=$hb_root/build/venv
hb_left_out=$hb_root/build/left_out
hb_sundials=$hb_root/build/sundials # what quickstart unpacks instead of installing libsundials-dev
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
   if (($(nproc) < 2)); then # more ranks than processors, for Open MPI 4 and 5
      export OMPI_MCA_rmaps_base_oversubscribe=1 PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe
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

# Notes what goes on without something, for the end: hb_leave_out WHAT EFFECT
hb_leave_out() {
   mkdir -p "$hb_root/build"
   printf '   %s: %s\n' "$1" "$2" >>"$hb_left_out"
}

# Names once what was left out.
hb_say_left_out() {
   [[ -s $hb_left_out ]] || return 0
   hb_say "Left out"
   sort -u "$hb_left_out"
   rm -f "$hb_left_out"
}

# Runs apt-get: as root, or by sudo where it may ask for a password or needs none. Leaves with status 3 where neither is possible.
hb_apt_get() {
   local as_root=()
   if ((EUID != 0)); then
      if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; then
         as_root=(sudo)
      else
         return "$hb_status_packages"
      fi
   fi
   "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Dpkg::Use-Pty=0 "$@"
}

# Installs what is missing and what this release has, without waiting for the disk after each file; a package that it does not have is left
# out, and so are all with `no` as the first argument or on a system other than Debian: hb_install_packages yes|no PACKAGE...
hb_install_packages() {
   local missing available=() package status=0
   if ! command -v dpkg-query >/dev/null; then
      hb_leave_out "packages" "this is no Debian, what is installed is used; on Debian they would be ${*:2}"
      return
   fi
   mapfile -t missing < <(hb_missing_packages "${@:2}")
   ((${#missing[@]} == 0)) && return
   if [[ $1 == no ]]; then
      for package in "${missing[@]}"; do hb_leave_out "$package" "not installed (--no-install)"; done
      return
   fi
   hb_say "Installing ${#missing[@]} packages: ${missing[*]}"
   hb_apt_get update || status=$?
   if ((status == hb_status_packages)); then
      printf '%s: these packages are missing, and only root can install them:\n\n' "${0##*/}" >&2
      printf '   apt-get update && apt-get install --no-install-recommends %s\n\n' "${missing[*]}" >&2
      printf 'Run that line as root, then this command again. --no-install goes on without them.\n' >&2
      exit "$hb_status_packages"
   fi
   ((status == 0)) || echo "apt-get update failed; trying with the package lists at hand" >&2
   for package in "${missing[@]}"; do
      if [[ $(apt-cache policy "$package" 2>/dev/null) =~ Candidate:\ [^\(] ]]; then
         available+=("$package")
      else
         hb_leave_out "$package" "this release of the system does not have it"
      fi
   done
   ((${#available[@]} == 0)) ||
      hb_apt_get install --yes --no-install-recommends -o Dpkg::Options::=--force-unsafe-io "${available[@]}" >/dev/null ||
      hb_fail "apt-get could not install the packages (see above)"
}

# Unpacks CVODE from Debian's packages into build/sundials: libsundials-dev depends on PETSc and hypre, 83 packages of Debian 12 that nhbm
# does not use. The packages of its libraries are then in hb_sundials_packages. Fails where they cannot be had.
hb_unpack_sundials() {
   local package
   hb_sundials_packages=()
   [[ -f $hb_sundials/usr/include/cvode/cvode.h ]] && return # of an earlier run
   mapfile -t hb_sundials_packages < <(apt-cache depends libsundials-dev |
      sed -n 's/^ *Depends: \(libsundials-\(core\|cvode\|nvecserial\)[0-9].*\)/\1/p')
   ((${#hb_sundials_packages[@]} > 0)) || return
   mkdir -p "$hb_sundials" &&
      (cd "$hb_sundials" && apt-get -qq download libsundials-dev "${hb_sundials_packages[@]}" 2>/dev/null) || return
   for package in "$hb_sundials"/*.deb; do dpkg-deb --extract "$package" "$hb_sundials" || return; done
   rm -f "$hb_sundials"/*.deb
}

# The Python of the system, which knows its packages.
hb_python() {
   if [[ -x /usr/bin/python3 ]]; then echo /usr/bin/python3; else command -v python3; fi
}

# Makes a Python environment in build/venv with the packages of the system, and ours as they stand in the tree; downloads nothing.
hb_make_venv() {
   hb_say "Python environment in build/venv"
   # a copied or moved tree leaves an environment that points elsewhere, and so does a changed Python
   if ! "$hb_venv/bin/python" -c 'import sys; sys.exit(sys.prefix != sys.argv[1])' "$hb_venv" 2>/dev/null; then
      "$(hb_python)" -m venv --clear --without-pip --system-site-packages "$hb_venv" || hb_fail "cannot make build/venv"
   fi
   hb_place_packages || hb_fail "cannot place our packages into build/venv"
   "$hb_venv/bin/nhbm-post" --version
   if "$hb_venv/bin/python" -c 'import scipy' 2>/dev/null; then "$hb_venv/bin/nhbm-model" --version; fi
}

# Adds to build/venv what tests and examples use beside Debian's packages, from PyPI; goes on without what cannot be had.
hb_add_optional_modules() {
   local module
   for module in "${hb_optional_modules[@]}"; do
      "$hb_venv/bin/python" -c "import ${module%%=*}" 2>/dev/null && continue
      "$hb_venv/bin/python" -m pip --version >/dev/null 2>&1 || "$hb_venv/bin/python" -m ensurepip >/dev/null 2>&1 || true
      "$hb_venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --retries 1 --timeout 20 "${module#*=}" ||
         hb_leave_out "${module#*=}" "PyPI could not be reached; tests and examples with it are skipped"
   done
}

# Names the folders of our packages to the Python of build/venv, and makes the commands of pyproject.toml: pip would need a build backend
# that Debian does not have.
hb_place_packages() {
   local command modules=(nhbm-model=model nhbm-post=post) folder
   folder=$("$hb_venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))') || return
   printf '%s\n' "$hb_root/drivers/python/src" "$hb_root/postproc/src" >"$folder/nhbm.pth" || return
   for command in "${modules[@]}"; do
      printf '#!%s\nimport sys\n\nfrom nhbm.program import %s\n\nsys.exit(%s())\n' \
         "$hb_venv/bin/python" "${command#*=}" "${command#*=}" >"$hb_venv/bin/${command%%=*}" || return
      chmod +x "$hb_venv/bin/${command%%=*}" || return
   done
}

# Process groups of what goes on in the background, which end with the script; a package manager that is stopped half-way would
# refuse whatever follows, and is waited for.
hb_started=()
hb_end_started() {
   local group
   for group in "${hb_started[@]}"; do
      if grep -qsE "^[0-9]+ \(apt-get\) . [0-9]+ $group " /proc/[0-9]*/stat; then
         hb_say "Waiting for the packages that are being installed"
         wait "$group" || true
      else
         kill -- "-$group" 2>/dev/null || true
      fi
   done
}
# Starts a command in the background, whose output goes to a file: hb_start LOG COMMAND...; its process is in hb_last.
hb_start() {
   if ((${#hb_started[@]} == 0)); then
      trap hb_end_started EXIT
      trap 'exit 130' INT TERM
   fi
   set -m # a process group of its own, which can be ended as a whole
   "${@:2}" >"$1" 2>&1 </dev/null &
   hb_last=$!
   set +m
   hb_started+=("$hb_last")
}

# Waits for one of them and prints its output; leaves where it failed: hb_await PROCESS LOG WORDS
hb_await() {
   local status=0
   wait "$1" || status=$?
   cat "$2"
   ((status == 0)) || hb_fail "$3 (above)"
}

# Configures and builds a preset: hb_build PRESET JOBS [TARGET [option of cmake]...]
hb_build() {
   local sundials=()
   hb_say "Building the $1 preset in build/$1"
   if [[ -d $hb_sundials && -n $(hb_missing_packages libsundials-dev) ]]; then sundials=(-DCMAKE_PREFIX_PATH="$hb_sundials/usr"); fi
   (cd "$hb_root" &&
      cmake --preset "$1" -DHB_PFUNIT=OFF -DPython3_EXECUTABLE="$(hb_python)" -DHB_PYTHON="$hb_venv/bin/python" "${sundials[@]}" "${@:4}") ||
      hb_fail "cmake could not configure $1"
   (cd "$hb_root" && cmake --build --preset "$1" --parallel "$2" --target "${3:-all}") || hb_fail "the $1 build failed"
}
