"""tests/benchmarks, with programs that are slower or find something else on purpose."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import shutil
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path

import h5py
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tests" / "benchmarks"
STUB = """#!{python} -IS
import sys, time
words = sys.argv
is_start = "duffing" in words[2]
end = time.process_time() + (0.0 if is_start else {seconds})
while time.process_time() < end:
    pass
with open(r"{folder}/start.h5" if is_start else r"{folder}/others.h5", "rb") as made:
    content = made.read()
with open(words[words.index("-o") + 1], "wb") as file:
    file.write(content)
"""


def build(folder, seconds, status=1):
    (folder / "bin").mkdir(parents=True)
    program = folder / "bin" / "nhbm"
    program.write_text(STUB.format(python=sys.executable, seconds=seconds, folder=folder))
    program.chmod(0o755)
    for name, last in (("start", 1), ("others", status)):
        with h5py.File(folder / f"{name}.h5", "w") as file:
            file["status"] = np.array([1, 1, last], dtype=np.int32)
            file["status"].attrs.update(flag_values=np.array([1, 2], dtype=np.int32), flag_meanings="converged truncated")
    return folder


@pytest.fixture(scope="module")
def script():
    """The script as a module, which is what a process of its own spends its time on."""
    spec = importlib.util.spec_from_loader("benchmarks_script", SourceFileLoader("benchmarks_script", str(SCRIPT)))
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def benchmarks(script, monkeypatch):
    """Runs the script in this process; exit status and printed text."""

    def run(*words, new=None):
        monkeypatch.setenv("NHBM", os.environ["NHBM"] if new is None else str(new / "bin" / "nhbm"))
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                status = script.main([*map(str, words)])
            except SystemExit as end:
                status = end.code
        return subprocess.CompletedProcess(words, status, out.getvalue(), err.getvalue())

    return run


@pytest.mark.parametrize("before, seconds, limit, status, expected, text", [
    (0.1, 0.1, 10, 1, 0, "0 of 2 are slower by more than 10, 0 have another result"),
    pytest.param(0.02, 0.3, 2, 1, 1, "1 of 2 are slower by more than 2, 0 have another result", marks=pytest.mark.long),
    (0.1, 0.1, 10, 2, 1, "3 converged became 2 converged, 1 truncated"),
])  # fmt: skip
def test_what_is_slower_or_another_is_said(benchmarks, tmp_path, before, seconds, limit, status, expected, text):
    """With margins that a busy machine leaves."""
    old, new = build(tmp_path / "old", before), build(tmp_path / "new", seconds, status)
    done = benchmarks("--program", old, "--only", "figure 4", "--rounds", 1, "--limit", limit, new=new)
    assert done.returncode == expected, done
    assert text in done.stdout and done.stdout.count("| points of the paper's figure 4 |") == 1


@pytest.mark.parametrize("words, message", [
    ((), "name a commit by --against, or a build by --program"),
    (("--against", "main", "--program", "."), "name a commit by --against, or a build by --program"),
    (("--against", "no-such-commit", "--only", "figure 4"),
     "no commit 'no-such-commit'" if shutil.which("git") else "--against needs git"),
    (("--program", "/nowhere"), "no such program: /nowhere/bin/nhbm"),
    (("--program", "/nowhere", "--only", "no such row"), "no row has 'no such row' in its name"),
    (("--program", "/nowhere", "--rounds", "0"), "--rounds is at least 1"),
])  # fmt: skip
def test_wrong_arguments_are_named(benchmarks, words, message):
    done = benchmarks(*words)
    assert done.returncode == 2 and message in done.stderr, done


def test_rows_are_listed():
    done = subprocess.run([sys.executable, SCRIPT, "--list", "--only", "tolerance"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "tolerance 0.001, stop, damping 0.02" in done.stdout.splitlines() and "Bouc-Wen" not in done.stdout
