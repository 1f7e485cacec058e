"""The two commands of README.md, run like a new user: in a fresh clone, with nothing built."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SECTION = (ROOT / "README.md").read_text().split("## Two commands")[1].split("\n## ")[0]
COMMANDS = re.findall(r"^    (\S+)", SECTION, re.MULTILINE)


def test_there_are_two():
    assert COMMANDS == ["drivers/quickstart", "tests/run"]


@pytest.mark.long
@pytest.mark.skipif(not (ROOT / ".git").exists() or not shutil.which("git"), reason="not a repository")
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_run_in_a_fresh_clone(command, tmp_path):
    """Nothing is installed: the requirements of the tests are met."""
    subprocess.run(["git", "clone", "--quiet", ROOT, tmp_path / "clone"], check=True)
    foreign = ("NHBM", "PYTHONPATH", "MPIEXEC")
    environment = {name: value for name, value in os.environ.items() if name not in foreign}
    done = subprocess.run([tmp_path / "clone" / command, "--no-install"], cwd=tmp_path, env=environment, capture_output=True)
    assert done.returncode == 0, (done.stdout + done.stderr).decode(errors="replace")[-5000:]
    if command == "drivers/quickstart":
        pictures = list((tmp_path / "clone" / "results").glob("*.png"))
        assert len(pictures) == 4 and all(picture.read_bytes().startswith(b"\x89PNG") for picture in pictures)


@pytest.mark.parametrize(
    "depends, taken",
    [
        ("libsundials-cvode6 libsundials-cvodes6 libsundials-nvecserial6 libsundials-nvecparallel-petsc6 petsc-dev",
         "libsundials-cvode6 libsundials-nvecserial6"),
        ("libsundials-core7 libsundials-cvode7 libsundials-nvecserial7 libsundials-sunlinsol5 libhypre-dev",
         "libsundials-core7 libsundials-cvode7 libsundials-nvecserial7"),
    ],
    ids=["Debian 12", "Debian 13"],
)  # fmt: skip
@pytest.mark.parametrize("is_online", [True, False])
def test_cvode_is_unpacked_without_what_sundials_depends_on(depends, taken, is_online, tmp_path):
    lines = "\n".join(f"  Depends: {name}" for name in depends.split())
    stubs = {
        "apt-cache": f"echo 'libsundials-dev\n{lines}'",
        "apt-get": 'shift 2; for name; do touch "$name.deb"; done' if is_online else "exit 100",
        "dpkg-deb": 'mkdir -p "$3/usr/include/cvode"; touch "$3/usr/include/cvode/cvode.h" "$3/$(basename "$2").unpacked"',
    }
    (tmp_path / "bin").mkdir()
    for name, text in stubs.items():
        (tmp_path / "bin" / name).write_text(f"#!/bin/bash\n{text}\n")
        (tmp_path / "bin" / name).chmod(0o755)
    commands = 'source "$1"; hb_sundials=$2; hb_unpack_sundials || exit 7; echo "${hb_sundials_packages[@]}"'
    done = subprocess.run(
        ["bash", "-euc", commands, "-", ROOT / "drivers" / "setup.sh", tmp_path / "sundials"],
        env={"PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin"}, capture_output=True, text=True,
    )  # fmt: skip
    if not is_online:
        assert done.returncode == 7
        return
    assert (done.returncode, done.stdout.split()) == (0, taken.split())
    unpacked = sorted(path.name.removesuffix(".deb.unpacked") for path in (tmp_path / "sundials").glob("*.unpacked"))
    assert unpacked == sorted(["libsundials-dev", *taken.split()])
    (tmp_path / "bin" / "apt-get").write_text("#!/bin/sh\nexit 100\n")       # what is there is used again, without a network
    again = subprocess.run([*done.args], env={"PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin"}, capture_output=True, text=True)
    assert (again.returncode, again.stdout.split()) == (0, [])
