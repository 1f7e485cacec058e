"""Runs nhbm itself on what is damaged: inputs, laws in shared libraries, result files.

    python tests/fuzz/fuzz_process.py NHBM [--count N] [--first K] [--seed S] [--kinds input,law,result,content]

Each case is a process of its own. It has to end with an exit status that docs/user/running.md lists, with a message where that
is 2, within 10 s of processor time and 1 GiB of resident memory; never by a signal, never with a trace of the Fortran
runtime, HDF5 or MPI. `solve` and `resume` may have honest work for longer: after 3 s they get SIGTERM twice, which has to end them.
Files may grow to 100 MB. Case K of seed S is always the same. What failed is kept in the folder of --keep.
Exit status 0: every case ended as it should.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from fuzz_results import damaged

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("input", "law", "result", "content")
ALLOWED = {"check": {0, 2, 4}, "solve": {0, 2, 3, 4}, "resume": {0, 2, 3, 4}, "info": {0, 2, 3}, "verify": {0, 2, 4}}
READERS = (["info"], ["info", "--check"], ["resume"], ["verify", "--points", "1", "--periods", "2"])
HUGE = 300_000_000  # rows of a dataset that holds none of them
SECONDS, GIBIBYTES, PATIENCE, FILE_BYTES = 10.0, 1.0, 3.0, 100_000_000
WALL = 120.0  # seconds after which a process that waits for something is a finding, too
TRACES = ("Fortran runtime", "Backtrace for", "Error termination", "Program received", "MPI_ABORT", "HDF5-DIAG",
          "free():", "malloc():", "double free", "stack smashing", "AddressSanitizer", "runtime error:")  # fmt: skip
LIMITED = ("--set", "solver%memory_limit=0.25")

MODEL = """
&structure type = 'matrices', n_dofs = 2, mass = 2*1.0, damping = 2*0.1, stiffness = 2*1.0 /
&tones frequency = 0.9, 1.2727922061357855 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, 0, cos = 0.3 /
&load dof = 'x1', tuple = 0, 1, cos = 0.2 /
"""
SPRING = "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n"
SWEEP = "&sweep parameter = 'load(1)%cos', values = 0.1, 0.2, 0.3 /\n"
ONE_TONE = "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.05, stiffness = 1.0 /\n&tones frequency = 0.8 /\n"
ONE_TONE += "&load dof = 'x1', tuple = 1, cos = 0.2 /\n&law type = 'elastic_stop', dof = 'x1', stiffness = 5.0, gap = 0.4 /\n"
OTHER_RESULTS = {
    "curve": ONE_TONE + "&harmonics order = 7 /\n&curve parameter = 'tones%frequency', from = 0.8, to = 1.0, points = 40 /\n",
    "adaptive": MODEL.replace("&harmonics order = 3 /", "&accuracy tolerance = 1e-3 /") + SPRING + SWEEP,
    "integration": ONE_TONE.replace("damping = 0.05", "damping = 0.3")
    + "&harmonics order = 15 /\n&solver primary_method = 'integration' /\n",
}
TEXT_ACCIDENTS = ("number", "number", "number", "piece", "cut", "bits", "double", "tail", "long")
NUMBERS = ("0", "-1", "1", "7", "1000", "100000", "100000000", "2147483647", "2147483648", "1e308", "-1e309", "5e-324",
           "nan", "inf", "1000000*0", "3*", "1.5.2", "'x1'", ".true.")  # fmt: skip
PIECES = (b"/", b"&", b"&law", b"(", b"(999999999)", b",,", b"'", b'"', b"!", b"%", b"\xff", b"\0", b"\r\n",
          b"\xef\xbb\xbf", b"\xc3\xa9")  # fmt: skip

# A spring under many names: each goes wrong in its own way. VERSION is that of the interface.
LAWS = """
#include "nhbm_user_law.h"
#include <math.h>
#include <stddef.h>

#define LAW(name, version, coordinates, degree_told, length, told, force, slope, answer)                                    \\
   int name##_info(nhbm_law_info_t *info)                                                                                  \\
   {                                                                                                                       \\
      info->api_version = version;                                                                                         \\
      info->n_coordinates = coordinates;                                                                                   \\
      info->n_parameters = NHBM_ANY_NUMBER;                                                                                \\
      info->degree = degree_told;                                                                                          \\
      info->length_scale = length;                                                                                         \\
      return told;                                                                                                         \\
   }                                                                                                                       \\
   int name##_evaluate(int n, int m, int stride, const double *z, const double *v, int k, const double *p, double *f,      \\
                       double *df_dz, double *df_dv)                                                                       \\
   {                                                                                                                       \\
      (void)m, (void)stride, (void)v, (void)k, (void)p, (void)df_dv;                                                       \\
      for (int i = 0; i < n; i++) {                                                                                        \\
         f[i] = force;                                                                                                     \\
         if (df_dz != NULL)                                                                                                \\
            df_dz[i] = slope;                                                                                              \\
      }                                                                                                                    \\
      return answer;                                                                                                       \\
   }

#define API NHBM_USER_LAW_API
LAW(good, API, 1, 1, 0.0, 0, z[i], 1.0, 0)
LAW(not_a_number, API, 1, 1, 0.0, 0, NAN, NAN, 0)
LAW(sometimes_nan, API, 1, 0, 0.0, 0, z[i] > 0.1 ? NAN : z[i], 1.0, 0)
LAW(infinite, API, 1, 0, 0.0, 0, INFINITY, z[i], 0)
LAW(huge_force, API, 1, 0, 0.0, 0, 1e308 * z[i], 1e308, 0)
LAW(gives_up, API, 1, 0, 0.0, 0, z[i], 1.0, -7)
LAW(out_of_range, API, 1, 0, 0.0, 0, z[i], 1.0, 7)
LAW(wrong_slope, API, 1, 0, 0.0, 0, z[i], -1e12, 0)
LAW(other_version, 77, 1, 0, 0.0, 0, z[i], 1.0, 0)
LAW(refuses, API, 1, 0, 0.0, 3, z[i], 1.0, 0)
LAW(many_coordinates, API, 2147483647, 0, 0.0, 0, z[i], 1.0, 0)
LAW(negative_coordinates, API, -5, 0, 0.0, 0, z[i], 1.0, 0)
LAW(no_coordinates, API, 0, 0, 0.0, 0, z[i], 1.0, 0)
LAW(high_degree, API, 1, 2147483647, 0.0, 0, z[i], 1.0, 0)
LAW(negative_degree, API, 1, -2147483647, 0.0, 0, z[i], 1.0, 0)
LAW(no_length, API, 1, 0, NAN, 0, z[i], 1.0, 0)
LAW(negative_length, API, 1, 0, -1e300, 0, z[i], 1.0, 0)
"""
LAW_ACCIDENTS = ("sound", "sound", "sound", "cut", "cut", "head", "text", "empty", "folder", "missing", "symbol", "name")
LAW_NAMES = [line[4 : line.index(",")] for line in LAWS.splitlines() if line.startswith("LAW(")]


@dataclass
class Case:
    """One run: what was done, and the words behind the name of the program."""

    what: str
    words: list[str]


class Campaign:
    """Sound files to damage, made once, and one folder in which all cases run."""

    def __init__(self, program: Path, folder: Path):
        self.program, self.folder = program, folder
        self.environment = {
            **os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OPENBLAS_NUM_THREADS": "1",
            "TMPDIR": str(folder / "tmp"),
            "LSAN_OPTIONS": "detect_leaks=0",
        }  # fmt: skip
        (folder / "tmp").mkdir()
        self.inputs = [path.read_bytes() for path in sorted((ROOT / "inputs").rglob("*.nml"))]
        (folder / "good.nml").write_text(MODEL + SPRING + SWEEP + "&output samples = 8, title = 'sound' /\n")
        self._make("solve", "good.nml", "--output", "whole.h5", "--overwrite", status=0)
        self._make("solve", "good.nml", "--output", "begun.h5", "--overwrite", "--time-limit", "0", status=3)
        for name, text in OTHER_RESULTS.items():
            (folder / f"{name}.nml").write_text(text)
            self._make("solve", f"{name}.nml", "--overwrite", status=0)
        self.results = [(folder / f"{name}.h5").read_bytes() for name in ("whole", "begun", *OTHER_RESULTS)]
        self.library = self._build_laws()

    def _make(self, *words: str, status: int) -> None:
        done = subprocess.run([self.program, *words], cwd=self.folder, env=self.environment, capture_output=True)
        if done.returncode != status:
            raise RuntimeError(f"{' '.join(words)}: status {done.returncode}: {done.stderr.decode()}")

    def _build_laws(self) -> bytes:
        """The library of all laws; nothing where there is no C compiler."""
        compiler = os.environ.get("CC") or shutil.which("cc")
        if not compiler:
            return b""
        (self.folder / "laws.c").write_text(LAWS)
        include = f"-I{ROOT / 'src' / 'laws'}"
        subprocess.run([compiler, "-shared", "-fPIC", include, "-o", "laws.so", "laws.c", "-lm"], cwd=self.folder, check=True)
        return (self.folder / "laws.so").read_bytes()

    def prepare(self, kind: str, generator: random.Random) -> Case:
        """Writes the files of a case."""
        self._clear()
        return getattr(self, f"_prepare_{kind}")(generator)

    def _clear(self) -> None:
        for name in ("case.nml", "case.h5", "case.h5.part", "case.so", "case.fftw", "damaged.h5"):
            path = self.folder / name
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)

    def keep(self, folder: Path) -> None:
        """Copies the files of the case that ran last."""
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("case.nml", "case.so", "case.fftw", "damaged.h5", "out", "err"):
            if (self.folder / name).is_file():
                shutil.copy(self.folder / name, folder)

    def _prepare_input(self, generator: random.Random) -> Case:
        text = generator.choice(self.inputs)
        for _ in range(generator.randint(1, 4)):
            text = mutated(text, self.inputs, generator)
        (self.folder / "case.nml").write_bytes(text[:400_000])
        if generator.random() < 0.5:
            return Case("input", ["check", "case.nml", *LIMITED])
        return Case("input", ["solve", "case.nml", *LIMITED])

    def _prepare_law(self, generator: random.Random) -> Case:
        path, name = self.folder / "case.so", generator.choice(LAW_NAMES)
        how = generator.choice(LAW_ACCIDENTS)
        library, good = "case.so", self.library
        if not good:
            how = generator.choice(("text", "empty", "folder", "missing"))
        if how == "cut":
            path.write_bytes(good[: generator.randrange(len(good))])
        elif how == "head":  # the header of the file, which the loader of the system reads first
            data = bytearray(good)
            data[generator.randrange(64)] = generator.randrange(256)
            path.write_bytes(bytes(data))
        elif how == "text":
            path.write_text("this is no library\n" * generator.randint(1, 1000))
        elif how == "empty":
            path.write_bytes(b"")
        elif how == "folder":
            path.mkdir()
        elif how != "missing":
            path.write_bytes(good)
        if how == "symbol":
            name = generator.choice(("none", "goo", "x" * 5000, "good_info", "", "a b", "g\xf6\xf6d"))
        elif how == "name":
            library = generator.choice(("", "/", ".", "case.so/", "x" * 5000, "../case.so", "/dev/null", "case.nml"))
        keys = generator.choice(("", ", parameters = 1.0", ", parameters = 1000*1.0"))
        law = f"&law type = 'user', library = '{library}', name = '{name}', dof = 'x1'{keys} /\n"
        (self.folder / "case.nml").write_text(MODEL + law)
        verb = generator.choice(("check", "solve"))
        return Case(f"law {how} {name[:30]}", [verb, "case.nml", *LIMITED])

    def _prepare_result(self, generator: random.Random) -> Case:
        (self.folder / "damaged.h5").write_bytes(damaged(generator.choice(self.results), generator))
        return Case("result", reading(generator))

    def _prepare_content(self, generator: random.Random) -> Case:
        path = self.folder / "damaged.h5"
        path.write_bytes(generator.choice(self.results))
        what = ", ".join(change_content(path, generator) for _ in range(generator.randint(1, 3)))
        return Case(f"content {what}", reading(generator))

    def run(self, case: Case) -> tuple[str, float, int]:
        """What is wrong with how the case ended (empty: nothing), processor time [s], resident memory [kiB]."""
        with open(self.folder / "out", "wb") as out, open(self.folder / "err", "wb") as err:
            process = subprocess.Popen(
                [self.program, *case.words],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                preexec_fn=_limit_files,
            )
            status, usage, was_asked = _wait(process.pid, case.words[0] in ("solve", "resume"))
        process.returncode = 0  # it has been waited for
        seconds = usage.ru_utime + usage.ru_stime
        said = (self.folder / "err").read_bytes().decode(errors="replace")
        code = os.waitstatus_to_exitcode(status)
        found = [trace for trace in TRACES if trace in said]
        problem = ""
        if code < 0:
            problem = f"ended by {signal.Signals(-code).name}" if code != -signal.SIGKILL else "did not end"
        elif code not in ALLOWED[case.words[0]] or (case.words[0] == "solve" and code == 3 and not was_asked):
            problem = f"exit status {code}"
        elif found:
            problem = f"said '{found[0]}'"
        elif code == 2 and "nhbm: " not in said:
            problem = "exit status 2 without a message"
        elif seconds > SECONDS:
            problem = f"took {seconds:.1f} s"
        elif usage.ru_maxrss > GIBIBYTES * 2**20:
            problem = f"took {usage.ru_maxrss // 1024} MiB"
        return problem, seconds, usage.ru_maxrss


def _limit_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES, FILE_BYTES))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # writing beyond is then an error like that of a full disk
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _wait(pid: int, may_be_asked: bool) -> tuple[int, resource.struct_rusage, bool]:
    """Status and use of a process; whether it had to be asked to end."""
    started, n_asked = time.monotonic(), 0
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            return status, usage, n_asked > 0
        passed = time.monotonic() - started
        if may_be_asked and n_asked < 2 and passed > PATIENCE + n_asked:
            os.kill(pid, signal.SIGTERM)
            n_asked += 1
        if passed > WALL or _processor_time(pid) > 2 * SECONDS:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.005)


def _processor_time(pid: int) -> float:
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except (OSError, IndexError):
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def reading(generator: random.Random) -> list[str]:
    """Words of a run that reads the damaged file."""
    verb, *options = generator.choice(READERS)
    return [verb, "damaged.h5", *options]


def mutated(text: bytes, others: list[bytes], generator: random.Random, numbers_only: bool = False) -> bytes:
    """A text after one accident."""
    kind = "number" if numbers_only else generator.choice(TEXT_ACCIDENTS)
    place = generator.randint(0, len(text))
    if kind == "number":
        digits = [i for i in range(len(text)) if text[i : i + 1].isdigit() and not text[i - 1 : i].isalnum()]
        if not digits:
            return text
        first = generator.choice(digits)
        last = first
        while last < len(text) and text[last : last + 1] in b"0123456789.+-eE":
            last += 1
        return text[:first] + generator.choice(NUMBERS).encode() + text[max(last, first + 1) :]
    if kind == "piece":
        return text[:place] + generator.choice(PIECES) + text[place:]
    if kind == "cut":
        return text[:place] + text[place + generator.randint(1, 200) :]
    if kind == "double":
        return text[:place] + text[max(0, place - generator.randint(1, 200)) :]
    if kind == "tail":
        other = generator.choice(others)
        return text[:place] + other[generator.randint(0, len(other)) :]
    if kind == "long":
        return text[:place] + generator.choice((b"x", b"7,", b"'x',", b"(")) * generator.randint(1, 20_000) + text[place:]
    data = bytearray(text)
    for _ in range(generator.randint(1, 8)):
        if data:
            data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
    return bytes(data)


def change_content(path: Path, generator: random.Random) -> str:
    """Changes one thing that HDF5 finds sound: numbers, shapes, kinds and names of datasets and attributes, and texts."""
    import h5py
    import numpy as np

    with h5py.File(path, "r+") as file:
        name = generator.choice(sorted(file))
        how = generator.choice(("numbers", "numbers", "text", "text", "delete", "shape", "kind", "group", "attribute", "attribute"))
        if how == "attribute":
            name = generator.choice(sorted(file.attrs) or ["none"])
            value = generator.choice((0, -1, 2**31 - 1, 1.5, "", "x" * 1000, "a\nb", b"\xff\xfe", np.zeros(3), np.nan))
            file.attrs.pop(name, None)
            if generator.random() < 0.8:
                file.attrs[name] = value
            return f"attribute {name}"
        if how == "text":
            names = [n for n in file if isinstance(file[n], h5py.Dataset) and h5py.check_string_dtype(file[n].dtype)]
            if not names:
                return "nothing"
            name = generator.choice(names)
            data = np.atleast_1d(file[name][()]).ravel()
            if not data.size:
                return "nothing"
            old = data[0] if isinstance(data[0], bytes) else str(data[0]).encode()
            new = mutated(old, [old], generator).replace(b"\0", b" ")
            try:
                file[name][...] = new
            except (TypeError, ValueError, UnicodeError):
                return "nothing"
            return f"text {name}"
        if not isinstance(file[name], h5py.Dataset):
            return "nothing"
        if how == "numbers" and file[name].dtype.kind in "iuf" and file[name].size:
            whole = file[name][()]
            values = np.atleast_1d(whole).ravel()
            nasty = (0, -1, 7, 100, 2**31 - 1, -(2**31))
            if file[name].dtype.kind == "f":
                nasty = (np.nan, np.inf, -1e308, 5e-324, 0.0)
            values[generator.randrange(values.size)] = generator.choice(nasty)
            file[name][...] = values.reshape(file[name].shape)
            return f"numbers {name}"
        data = file[name][()]
        shape, dtype = file[name].shape, file[name].dtype
        del file[name]
        if how == "shape":
            sizes = generator.choice(((), (0,), (1,), (2, 2), (1000,), tuple(reversed(shape)), shape + (2,), (3, 100_000)))
            if generator.random() < 0.2:
                file.create_dataset(name, (HUGE, *shape[1:]), "f8" if dtype.kind == "O" else dtype, chunks=(1000, *shape[1:]))
            else:
                file[name] = np.zeros(sizes)
        elif how == "kind":
            others = (np.asarray("text", dtype="S9"), "text", np.zeros(shape, "c16"), np.zeros(shape, "u1"), 7, 1.5)
            file[name] = generator.choice(others)
        elif how == "group":
            file.create_group(name)
        elif how != "delete":
            file[name] = data
            return "nothing"
        return f"{how} {name}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--list", action="store_true", help="say what each case is, run none")
    arguments = parser.parse_args()
    kinds = arguments.kinds.split(",")
    n_cases, n_failed, longest, largest = collections.Counter(), collections.Counter(), 0.0, 0
    with tempfile.TemporaryDirectory(prefix="nhbm-") as folder:
        campaign = Campaign(arguments.program.resolve(), Path(folder))
        with contextlib.suppress(KeyboardInterrupt):  # what was tried up to then is reported below
            for number in range(arguments.first, arguments.first + arguments.count):
                kind = kinds[number % len(kinds)]
                case = campaign.prepare(kind, random.Random(f"{arguments.seed} {number}"))
                if arguments.list:
                    print(number, case)
                    continue
                problem, seconds, memory = campaign.run(case)
                n_cases[f"{kind} {case.words[0]}"] += 1
                longest, largest = max(longest, seconds), max(largest, memory)
                if problem:
                    n_failed[f"{kind} {case.words[0]}"] += 1
                    print(f"case {number}, {case.what}: {' '.join(case.words[:2])}: {problem}", flush=True)
                    if arguments.keep:
                        campaign.keep(arguments.keep / str(number))
    for name in sorted(n_cases):
        print(f"{name:20} {n_cases[name]:6} cases, {n_failed[name]} not as they should be")
    print(f"longest {longest:.2f} s, largest {largest // 1024} MiB")
    return 1 if n_failed else 0


if __name__ == "__main__":
    sys.exit(main())
