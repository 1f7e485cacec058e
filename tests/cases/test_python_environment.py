"""The scripts of tests/ with a Python that lacks the required packages: they restart with build/venv."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]


def without_packages(script: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Runs a script with a Python that has only its standard library."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run(
        [sys._base_executable, "-S", script, *arguments], env=environment, capture_output=True, text=True, timeout=600
    )


CAMPAIGNS = ("campaigns/curves", "campaigns/points", "campaigns/jumps", "campaigns/time_domain")
MEASUREMENTS = ("measurements/error_estimates", "measurements/hard", "measurements/large", "measurements/performance")
SCRIPTS = ("compare", *CAMPAIGNS, *MEASUREMENTS)


@pytest.mark.parametrize("name", ["measurements/accuracy", *(pytest.param(name, marks=pytest.mark.long) for name in SCRIPTS)])
def test_script_finds_an_environment(name):
    done = without_packages(TESTS / name, "--help")
    assert done.returncode == 0, done.stderr
    assert f"tests/{name}" in done.stdout


def test_environment_that_is_there_is_not_made_again(monkeypatch):
    monkeypatch.syspath_prepend(TESTS)
    environment = importlib.import_module("python_environment")
    made, entered = [], []
    monkeypatch.setattr(environment, "_make", lambda: made.append(True))
    monkeypatch.setattr(environment, "missing_of", lambda packages: list(packages))
    monkeypatch.setattr(os, "execv", lambda python, words: entered.append(python))
    monkeypatch.setattr(sys, "prefix", "/elsewhere")
    for packages, makes in ((("h5py",), 0), (("h5py", "no_such_package"), 1)):
        made.clear()
        with pytest.raises(SystemExit):  # where nothing takes the place of this process
            environment.enter(*packages)
        assert len(made) == makes
    assert entered == [environment.VENV / "bin" / "python"] * 2


def test_what_is_missing_there_too_is_named(tmp_path):
    script = tmp_path / "measure"
    script.write_text(
        f"import sys; sys.path.insert(0, {str(TESTS)!r})\n"
        "import python_environment\n"
        "python_environment.enter('h5py', 'no_such_package')\n"
    )
    done = without_packages(script)
    assert done.returncode == 2
    assert done.stderr.startswith("measure: build/venv has no no_such_package; ")
    assert "Traceback" not in done.stderr
