"""Damages a result or model file byte by byte and has nhbm-post or nhbm-model read it: an answer, or one line on what is wrong.

    python tests/fuzz/fuzz_results.py FILE.h5 [--count N] [--seed N] [--seconds S] [--gigabytes G]

Each damaged file is read by `nhbm-post info` and `value`, or by `nhbm-model check`, in a process with a limit of processor time
and of memory. Exit status 0: no traceback, and nothing beyond the limits.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import random
import resource
import sys
import tempfile
import time
from pathlib import Path

LAST_WORDS = (
    "corrupted",
    "double free",
    "free()",
    "malloc()",
    "munmap_chunk()",
    "realloc()",
    "Fatal glibc error",
)  # of the C library


def damaged(good: bytes, generator: random.Random) -> bytes:
    """The bytes of a file after one accident: bits turned, a piece overwritten, cut off, doubled or swapped."""
    data = bytearray(good)
    kind = generator.choice(("bits", "bits", "head", "piece", "size", "cut", "double", "swap"))
    if kind == "bits":
        for _ in range(generator.randint(1, 30)):
            data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
    elif kind == "head":  # superblock and first headers, where the structure of the file is
        for _ in range(generator.randint(1, 4)):
            data[generator.randrange(min(4096, len(data)))] = generator.randrange(256)
    elif kind == "piece":
        first = generator.randrange(len(data))
        length = min(generator.randint(1, 64), len(data) - first)
        data[first : first + length] = bytes(generator.choice((0, 255)) for _ in range(length))
    elif kind == "size":
        first = generator.randrange(max(1, len(data) - 8))
        data[first : first + 8] = generator.choice((2**31, 2**32, 2**62, 2**64 - 16, 2**64 - 1)).to_bytes(8, "little")
    elif kind == "cut":
        del data[generator.randrange(len(data)) :]
    else:
        first, second = sorted(generator.randrange(len(data)) for _ in range(2))
        piece = data[first : min(second, first + 2000)]
        if kind == "double":
            data[second:second] = piece
        else:
            data[second : second + len(piece)] = piece
    return bytes(data)


def commands(path: Path) -> list:
    """What reads a file: the program, its words, and the statuses with which it may end without a line on standard error."""
    import h5py
    from nhbm import command
    from nhbm_post import cli

    with h5py.File(path, "r") as file:
        if file.attrs.get("format") == "nhbm model":
            return [("nhbm-model", command.main, ["check", str(path)], (0, 1))]
    return [("nhbm-post", cli.main, words, (0,)) for words in (["info", str(path)], ["value", str(path), "--tuple", "1,0"])]


def wrong(program, main, words, good, seconds: float = 1.0, gigabytes: float = 4.0) -> str:
    """Empty when the program read the file or said in a line why not, in time; else what went wrong."""
    from nhbm.child_process import run_in_child_process

    before = _processor_time()
    with tempfile.TemporaryFile() as err, tempfile.TemporaryFile() as out:
        child = os.fork()
        if child == 0:
            faulthandler.disable()  # of pytest
            resource.setrlimit(resource.RLIMIT_AS, (int(gigabytes * 2**30),) * 2)
            resource.setrlimit(resource.RLIMIT_CPU, (60, 60))  # in case the limits of the child process have no effect
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
            status = run_in_child_process(lambda: main(words), program)
            sys.stderr.flush()
            os._exit(status)
        _, ending = os.waitpid(child, 0)
        err.seek(0)
        said = err.read().decode(errors="replace")
    took = _processor_time() - before
    if took > seconds:
        return f"{words[0]}: {took:.1f} s; {said!r}"
    status = os.WEXITSTATUS(ending) if os.WIFEXITED(ending) else -os.WTERMSIG(ending)
    if status in good and not said:
        return ""
    reported = [line for line in said.splitlines() if not line.startswith(LAST_WORDS)]
    if status == 2 and len(reported) == 1 and reported[0].startswith(program):
        return ""
    return f"{words[0]}: status {status}, said {said!r}"


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def campaign(path: Path, numbers, seed: int = 1, seconds: float = 1.0, gigabytes: float = 4.0) -> dict[int, str]:
    """What went wrong, by the number of the damage; each is done to the file in its place."""
    good, failures = path.read_bytes(), {}
    calls = commands(path)
    for number in numbers:
        path.write_bytes(damaged(good, random.Random(f"{seed} {number}")))
        reported = [text for call in calls if (text := wrong(*call, seconds, gigabytes))]
        if reported:
            failures[number] = "; ".join(reported)
    path.write_bytes(good)
    return failures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--gigabytes", type=float, default=4.0)
    arguments = parser.parse_args()
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.h5"
        path.write_bytes(arguments.file.read_bytes())
        failures = campaign(path, range(arguments.count), arguments.seed, arguments.seconds, arguments.gigabytes)
    for number, problem in failures.items():
        print(f"file {number}: {problem[:300]}")
    print(f"{arguments.count} damaged files, {len(failures)} not as they should be; {time.perf_counter() - started:.0f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
