"""What campaigns share: a Python that has their packages, the program, options, runs by processor time, cases that are done.

Imported before the packages: it goes on under build/venv where they are missing. NHBM names the program; without it
build/release/bin/nhbm is used."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.dont_write_bytecode = True
sys.path[:0] = [str(ROOT / folder) for folder in ("tests", "tests/cases", "postproc/src", "drivers/python/src")]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded
os.environ.setdefault("NHBM", str(ROOT / "build" / "release" / "bin" / "nhbm"))

import python_environment  # noqa: E402

python_environment.enter("h5py", "numpy", "scipy")

from program import command, environment  # noqa: E402

ENDED = (0, 4)  # exit statuses of a run to its end


class Run(NamedTuple):
    """Processor seconds, None without a result within the limit of these, and what was printed."""

    seconds: float | None
    output: str


def options_of(text: str | None, **numbers: int) -> argparse.ArgumentParser:
    """A parser with the usage of a script's docstring, whole numbers with their defaults, `--list`, `--keep` and `--state`."""
    parser = argparse.ArgumentParser(usage=str(text).split("\n\n")[1].removeprefix("usage: "))
    for name, default in numbers.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--state", type=Path)
    return parser


@contextlib.contextmanager
def folder_of(keep: Path | None) -> Iterator[Path]:
    """The folder of `--keep`, or one that is removed."""
    with tempfile.TemporaryDirectory(prefix="campaign-") as made:
        folder = keep or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        yield folder


def run(limit: float, *words: object) -> Run:
    """Runs the program with at most `limit` processor seconds; prints what it said where it failed."""
    limited = ["sh", "-c", f'ulimit -t {limit}; exec "$@"', "sh", *command(*words)]
    with tempfile.TemporaryDirectory(prefix="mpi-") as own, tempfile.TemporaryFile() as said:  # MPI clears its own under others
        process = subprocess.Popen(limited, env={**environment(), "TMPDIR": own}, stdout=said, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode(errors="replace")
    has_ended = process.returncode in ENDED
    if not has_ended:
        print(*words, text, file=sys.stderr)
    return Run(usage.ru_utime + usage.ru_stime if has_ended else None, text)


class State:
    """Cases that are done, by their key: those of a file of `--state` to which the same question was put; new ones are added."""

    def __init__(
        self, path: Path | None, question: list[Any], read: Callable[[dict[str, Any]], Any], key: Callable[[Any], Any]
    ) -> None:
        self._path, self._question, self._key = path, question, key
        lines = map(json.loads, path.read_text().splitlines()) if path and path.exists() else ()
        cases = [read(line["case"]) for line in lines if line["question"] == question]
        self.known = {key(case): case for case in cases}

    def add(self, case: Any, record: dict[str, Any]) -> None:
        self.known[self._key(case)] = case
        if self._path:
            with self._path.open("a") as file:
                file.write(json.dumps({"question": self._question, "case": record}) + "\n")
