"""The Python of the scripts beside this file: one that has the packages they need, wherever they were started.

    import python_environment
    python_environment.enter("h5py", "numpy")      # before the packages are imported
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / "build" / "venv"
SETUP = ROOT / "drivers" / "setup.sh"


def missing_of(packages: tuple[str, ...]) -> list[str]:
    """Packages that this Python does not have."""
    return [package for package in packages if importlib.util.find_spec(package) is None]


def enter(*packages: str) -> None:
    """Goes on under build/venv, which is made where there is none, unless this Python has the packages; else ends with 2."""
    if not missing_of(packages):
        return
    python = VENV / "bin" / "python"
    if Path(sys.prefix).resolve() != VENV.resolve():
        if not _is_ready(python, packages):
            _make()
        os.execv(python, [str(python), *sys.argv])
    print(
        f"{Path(sys.argv[0]).name}: build/venv has no {', '.join(missing_of(packages))}; tests/run installs what Debian has, "
        f"elsewhere: {python} -m pip install {' '.join(missing_of(packages))}",
        file=sys.stderr,
    )
    sys.exit(2)


def _is_ready(python: Path, packages: tuple[str, ...]) -> bool:
    """Whether build/venv has the packages, and those of this tree, not of one that it was copied from."""
    look = (
        "import sys; from importlib.util import find_spec; root, *names = sys.argv[1:];"
        "places = [find_spec(name) and find_spec(name).origin for name in ('nhbm_post', 'nhbm', *names)];"
        "sys.exit(not all(places) or not all(place.startswith(root) for place in places[:2]))"
    )
    try:
        return subprocess.run([python, "-c", look, f"{ROOT}/", *packages], stderr=subprocess.DEVNULL).returncode == 0
    except OSError:
        return False


def _make() -> None:
    """Makes build/venv as tests/run does, unless it is there."""
    made = subprocess.run(
        ["bash", "-c", f'set -euo pipefail; source "{SETUP}"; hb_make_venv'], stdout=subprocess.DEVNULL, text=True
    )
    if made.returncode != 0:
        sys.exit(2)
