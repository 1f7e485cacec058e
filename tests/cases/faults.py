"""Runs of the program under which a fault happens at a chosen call, tests/fuzz/faults.c."""

from __future__ import annotations

import functools
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from program import Run, command, environment

SOURCE = Path(__file__).resolve().parents[1] / "fuzz" / "faults.c"
_FOLDER = tempfile.TemporaryDirectory(prefix="nhbm-faults-")

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="LD_PRELOAD and /proc are needed")


@functools.cache
def library() -> Path:
    path = Path(_FOLDER.name) / "faults.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", path, SOURCE, "-ldl"], check=True)
    return path


def run_with_fault(*arguments, cwd, call, at=0, number=0, file=None, rank=None, ranks=None, count=None) -> Run:
    """Runs the program; at its `at`-th `call` (0: at none) the fault happens: signal or error `number`."""
    names = {"CALL": call, "AT": at, "NUMBER": int(number), "FILE": file, "RANK": rank, "COUNT": count}
    faults = {f"FAULT_{name}": str(value) for name, value in names.items() if value is not None}
    words = command(*arguments, ranks=ranks)
    of_ranks = {**faults, "LD_PRELOAD": str(library())}
    if ranks is not None:  # mpirun itself stays as it is
        words[3:3] = [word for name, value in of_ranks.items() for word in ("-x", f"{name}={value}")]
        of_ranks = {}
    done = subprocess.run(words, cwd=cwd, env={**environment(), **of_ranks}, capture_output=True, timeout=120.0)
    return Run(done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace"))


def count_calls(*arguments, cwd, call, file=None) -> int:
    """How many such calls a run makes."""
    count = Path(_FOLDER.name) / "count"
    count.unlink(missing_ok=True)
    run_with_fault(*arguments, cwd=cwd, call=call, file=file, count=count)
    return int(count.read_text())
