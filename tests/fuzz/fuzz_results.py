"""Damages result files byte by byte and has nhbm-post read them: a picture of the file or one line that says what is wrong.

    python tests/fuzz/fuzz_results.py FILE.h5 [--count N] [--seed N] [--seconds S] [--gigabytes G]

Each damaged file is read by `nhbm-post info` and `value` in a process of their own for a batch of files, with a limit of
time and of memory. Where the HDF5 library itself dies or hangs is counted apart: nhbm_post.guard turns the first into a
line. Exit status 0: no traceback, and otherwise nothing beyond the limits.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import multiprocessing
import random
import resource
import signal
import sys
import tempfile
from pathlib import Path

BATCH = 50


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
        data[first : first + 8] = generator.choice((2**31, 2**32, 2**62, 2**64 - 1)).to_bytes(8, "little")
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


def read_one(path: Path, seconds: float) -> str:
    """Empty when nhbm-post read the file or said in a line why not; else what went wrong."""
    from nhbm_post.cli import main

    for words in (["info"], ["value", "--tuple", "1,0"]):
        out, err = io.StringIO(), io.StringIO()
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = main([words[0], str(path), *words[1:]])
        except TimeoutError:
            return f"{words[0]}: longer than {seconds} s"
        except BaseException as error:  # any escape is a finding
            return f"{words[0]}: {type(error).__name__}: {error}"
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        if "longer than" in err.getvalue():
            return f"{words[0]}: longer than {seconds} s"
        if status not in (0, 2) or (status == 2) != (len(err.getvalue().strip().splitlines()) == 1):
            return f"{words[0]}: status {status}, said {err.getvalue()!r}"
    return ""


def _too_long(*_):
    raise TimeoutError("longer than allowed")


def _batch(good: bytes, seed: int, numbers: range, limits: tuple[float, float], report) -> None:
    seconds, gigabytes = limits
    resource.setrlimit(resource.RLIMIT_AS, (int(gigabytes * 2**30),) * 2)
    signal.signal(signal.SIGALRM, _too_long)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.h5"
        for number in numbers:
            path.write_bytes(damaged(good, random.Random(f"{seed} {number}")))
            report.send((number, None))
            report.send((number, read_one(path, seconds)))


def campaign(
    good: bytes, seed: int, count: int, seconds: float = 5.0, gigabytes: float = 4.0
) -> tuple[dict[int, str], list[int], list[int]]:
    """What went wrong, by the number of the damaged file; files in which the HDF5 library died, and hung."""
    failures: dict[int, str] = {}
    crashes: list[int] = []
    hangs: list[int] = []
    context = multiprocessing.get_context("fork")
    next_number = 0
    while next_number < count:
        receiver, sender = context.Pipe(duplex=False)
        numbers = range(next_number, min(count, next_number + BATCH))
        process = context.Process(target=_batch, args=(good, seed, numbers, (seconds, gigabytes), sender))
        process.start()
        sender.close()
        current, is_open = next_number, True
        while is_open:
            if not receiver.poll(3 * seconds):  # inside the HDF5 library, where no signal reaches Python
                hangs.append(current)
                process.kill()
                break
            try:
                current, problem = receiver.recv()
                if problem:
                    failures[current] = problem
            except EOFError:
                is_open = False
        process.join()
        if process.exitcode < 0 and current not in hangs and current not in failures:
            crashes.append(current)  # inside the library; nhbm_post.guard makes a line of it
        elif process.exitcode > 0:
            failures[current] = f"the process ended with {process.exitcode}"
        next_number = numbers.stop if process.exitcode == 0 else current + 1
    return failures, crashes, hangs


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--gigabytes", type=float, default=4.0)
    arguments = parser.parse_args()
    failures, crashes, hangs = campaign(
        arguments.file.read_bytes(), arguments.seed, arguments.count, arguments.seconds, arguments.gigabytes
    )
    for number, problem in failures.items():
        print(f"file {number}: {problem[:300]}")
    print(f"{arguments.count} damaged files, {len(failures)} not as they should be; the HDF5 library died in {crashes}, "
          f"hung in {hangs}")  # fmt: skip
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
