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
