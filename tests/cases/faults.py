"""Runs of the program in which a fault occurs at a chosen call, tests/fuzz/faults.c."""

from __future__ import annotations

import functools
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from program import Run, command, environment, is_without_mpi, program

SOURCE = Path(__file__).resolve().parents[1] / "fuzz" / "faults.c"
_FOLDER = tempfile.TemporaryDirectory(prefix="nhbm-faults-")

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="LD_PRELOAD and /proc are needed")


@functools.cache
def library() -> Path:
    path = Path(_FOLDER.name) / "faults.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", path, SOURCE, "-ldl"], check=True)
    return path


def faulty_command(*arguments, call, at=0, number=0, file=None, rank=None, ranks=None, count=None):
    """Command line and environment for a run in which the fault, signal or error `number`, occurs at the `at`-th `call` (0: at
    none)."""
    names = {"CALL": call, "AT": at, "NUMBER": int(number), "FILE": file, "RANK": rank, "COUNT": count}
    faults = {f"FAULT_{name}": str(value) for name, value in names.items() if value is not None}
    words, of_ranks = command(*arguments, ranks=ranks), {**faults, "LD_PRELOAD": str(library())}
    if ranks is None or is_without_mpi(program()):
        return words, of_ranks
    for name, value in of_ranks.items():  # the launcher itself stays as it is
        words[3:3] = ["-genv", name, value] if is_hydra(words[0]) else ["-x", f"{name}={value}"]
    return words, {}


@functools.cache
def is_hydra(launcher: str) -> bool:
    """Whether it is that of MPICH."""
    return "HYDRA" in subprocess.run([launcher, "--version"], capture_output=True, text=True).stdout


def run_with_fault(*arguments, cwd, **fault) -> Run:
    """Runs the program with such a fault, and waits for its end."""
    words, of_ranks = faulty_command(*arguments, **fault)
    done = subprocess.run(words, cwd=cwd, env={**environment(), **of_ranks}, capture_output=True, timeout=600.0)
    return Run(done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace"))


def count_calls(*arguments, cwd, **fault) -> int:
    """Number of such calls in a run."""
    count = Path(_FOLDER.name) / "count"
    count.unlink(missing_ok=True)
    run_with_fault(*arguments, cwd=cwd, count=count, **fault)
    return int(count.read_text())
