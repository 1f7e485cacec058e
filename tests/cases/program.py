"""Runs the program under test and reads what it wrote. Environment: NHBM, the program; MPIEXEC, default mpirun."""

from __future__ import annotations

import functools
import os
import resource
import subprocess
import tempfile
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

ALL_CONVERGED, NOT_ALL_CONVERGED, BAD_INPUT, INCOMPLETE = 0, 4, 2, 3

# Nothing here takes this long, on slow machines that do other work neither; a run that hangs must end the test.
_TIME_LIMIT = 600.0

# The session folder of Open MPI 4 is one for all its runs of a user, and the last of them removes it while another starts.
_session_folder = tempfile.TemporaryDirectory(prefix="mpi")

# Open MPI under root, on few cores (version 4 and, by PRRTE, 5) and on this machine alone, where it then starts in a third of the
# time; one thread a rank, so that sums have one order.
_ENVIRONMENT = {
    "OMPI_MCA_orte_tmpdir_base": _session_folder.name,
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_MCA_pml": "ob1",
    "OMPI_MCA_btl": "self,vader",
    "OPENBLAS_NUM_THREADS": "1",
}


@dataclass(frozen=True)
class Run:
    """The outcome of a run of the program."""

    status: int
    stdout: str
    stderr: str

    @property
    def messages(self) -> list[str]:
        """Messages of the program on standard error; a message may have several lines."""
        return ("\n" + self.stderr).split("\nnhbm: ")[1:]


def program() -> str:
    """Path of the program under test."""
    path = os.environ.get("NHBM", "")
    if not path or not os.access(path, os.X_OK):
        raise RuntimeError(f"set NHBM to the path of the program; it is '{path}'")
    return str(Path(path).resolve())


def command(*arguments, ranks: int | None = None) -> list[str]:
    """Command line of the program, with `ranks` under mpirun or, if it was built without MPI, with as many workers; with the word
    `bench` that of nhbm-bench in the same folder."""
    words = [program(), *map(str, arguments)]
    beside = Path(words[0]).with_name("nhbm-bench")
    if words[1:2] == ["bench"] and beside.exists():  # programs before it have a verb
        words[:2] = [str(beside)]
    if ranks is None:
        return words
    if is_without_mpi(program()):
        return [*words[:2], *(["--workers", str(ranks)] if words[1] in ("solve", "resume", "verify") else []), *words[2:]]
    return [os.environ.get("MPIEXEC") or "mpirun", "-n", str(ranks), *words]


@functools.cache
def is_without_mpi(path: str) -> bool:
    """Whether this program was built without MPI."""
    return b"without MPI" in subprocess.run([path, "version"], env=environment(), capture_output=True, check=True).stdout


def environment() -> dict[str, str]:
    return {**os.environ, **_ENVIRONMENT}


def run(*arguments, cwd, ranks: int | None = None, limit: float = _TIME_LIMIT) -> Run:
    """Runs the program in the folder `cwd` and waits for its end."""
    done = subprocess.run(
        command(*arguments, ranks=ranks), cwd=cwd, env=environment(), capture_output=True, timeout=limit
    )
    return Run(done.returncode, done.stdout.decode(errors="replace"), _of_the_program(done.stderr.decode(errors="replace")))


def _of_the_program(text: str) -> str:
    """Standard error without the messages of MPI's library for processor topology on systems without /sys."""
    return "".join(line for line in text.splitlines(keepends=True) if not line.startswith("[hwloc/"))


def seconds_of_children() -> float:
    """Processor seconds of all processes that were started here and have ended: the same whatever else the machine does."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def seconds_of(process: subprocess.Popen) -> float:
    """Processor seconds of a process until now (Linux); 0 if it has ended."""
    try:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    except FileNotFoundError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_until_caught(process: subprocess.Popen, number: int) -> None:
    """Waits until the program has installed its handler, which precedes every long operation (Linux)."""
    for _ in range(100_000):
        status = Path(f"/proc/{process.pid}/status").read_text()
        if int(status.split("SigCgt:")[1].split()[0], 16) >> (number - 1) & 1:
            return
        time.sleep(0.005)
    raise AssertionError("no handler")


def wait_until_taken(process: subprocess.Popen, number: int) -> None:
    """Waits until a signal that was sent to a process is no longer pending there (Linux)."""
    while process.poll() is None:
        status = Path(f"/proc/{process.pid}/status").read_text()
        if not int(status.split("ShdPnd:")[1].split()[0], 16) >> (number - 1) & 1:
            return
        time.sleep(0.002)


def solve(
    text: str, folder: Path, *options, ranks: int | None = None, status: int | None = ALL_CONVERGED, name="case"
) -> Path:
    """Writes an input, solves it and returns the result file; fails if the exit status differs (None: any)."""
    source = folder / f"{name}.nml"
    source.write_text(text)
    result = folder / f"{name}.h5"
    done = run("solve", source, "-o", result, "--overwrite", "--quiet", *options, cwd=folder, ranks=ranks)
    assert status in (None, done.status), f"exit status {done.status} instead of {status}: {done.stderr}{messages_of(result)}"
    return result


def messages_of(result: Path) -> str:
    """Status and message of every point of a result file, for the text of a failed test."""
    if not result.exists():
        return ""
    with h5py.File(result, "r") as file:
        texts = [bytes(row).decode(errors="replace").strip("\0 ") for row in np.atleast_2d(file["message"][()])]
        return f"\nstatus {file['status'][()].tolist()}, residual {file['residual'][()].tolist()}, {texts}"


def read(result: Path, *names: str):
    """Datasets of a result file as arrays; a single array for one name."""
    with h5py.File(result, "r") as file:
        values = [file[name][()] for name in names]
    return values[0] if len(values) == 1 else values


def coefficients_by_tuple(result: Path, point: int = 0, dof: int = 0) -> dict[tuple[int, ...], tuple[float, float]]:
    """(cos, sin) of every harmonic in the set of a point."""
    tuples, values = read(result, "tuple", "coefficients")
    return {
        tuple(int(k) for k in j): (float(c), float(s))
        for j, (c, s) in zip(tuples, values[point, dof])
        if not (np.isnan(c) and np.isnan(s))
    }


def checksum_of_row(file: h5py.File, row: int) -> int:
    """The checksum of the values of a point, in the form of the file."""
    names = file["checksum"].attrs["of"]
    found = 0
    for name in (names if isinstance(names, str) else names.decode()).split():
        found = zlib.crc32(file[name][row].tobytes(), found)
    return int(np.uint32(found).astype(np.int32))
