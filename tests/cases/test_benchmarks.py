"""tests/benchmarks, with programs that are slower or find something else on purpose."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUB = """#!{python}
import sys, time
import h5py
import numpy as np
words = sys.argv
is_start = "duffing" in words[2]
end = time.process_time() + (0.0 if is_start else {seconds})
while time.process_time() < end:
    pass
with h5py.File(words[words.index("-o") + 1], "w") as file:
    file["status"] = np.array([1, 1, 1 if is_start else {status}], dtype=np.int32)
    file["status"].attrs.update(flag_values=np.array([1, 2], dtype=np.int32), flag_meanings="converged truncated")
"""


def build(folder, seconds, status=1):
    (folder / "bin").mkdir(parents=True)
    program = folder / "bin" / "nhbm"
    program.write_text(STUB.format(python=sys.executable, seconds=seconds, status=status))
    program.chmod(0o755)
    return folder


def benchmarks(*words, new=None):
    env = dict(os.environ) if new is None else dict(os.environ, NHBM=str(new / "bin" / "nhbm"))
    script = [sys.executable, str(ROOT / "tests" / "benchmarks"), *map(str, words)]
    return subprocess.run(script, env=env, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("before, seconds, limit, status, expected, text", [
    (0.1, 0.1, 10, 1, 0, "0 of 2 are slower by more than 10, 0 have another result"),
    (0.02, 0.6, 3, 1, 1, "1 of 2 are slower by more than 3, 0 have another result"),
    (0.1, 0.1, 10, 2, 1, "3 converged became 2 converged, 1 truncated"),
])  # fmt: skip
def test_what_is_slower_or_another_is_said(tmp_path, before, seconds, limit, status, expected, text):
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
def test_wrong_arguments_are_named(words, message):
    done = benchmarks(*words)
    assert done.returncode == 2 and message in done.stderr, done


def test_rows_are_listed():
    done = benchmarks("--list", "--only", "tolerance")
    assert done.returncode == 0
    assert "tolerance 0.001, stop, damping 0.02" in done.stdout.splitlines() and "Bouc-Wen" not in done.stdout
