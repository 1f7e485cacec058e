"""Runs that end before they are complete: their inputs, how they are begun and ended, and what their files must contain."""

import contextlib
import os
import random
import signal
import subprocess
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from program import INCOMPLETE, command, environment, read, run

PENDING, CONVERGED, OUT_OF_BUDGET, FAILED = 0, 1, 3, 6

BEAM = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4,
   damping_diagonal = 1.0 /
&tones frequency = 2.718281828459045, 3.141592653589793 /
&harmonics order = {order} /
&sampling samples = {samples} /
&load dof = 'v3', tuple = 1, 0, cos = 100.0 /
&load dof = 'v3', tuple = 0, 1, cos = 100.0 /
&law type = 'rigid_wall', label = 'wall', dof = 'v3', gap = 1.5e-3, augmentation = {augmentation} /
&error_estimate truncation = 10.0, aliasing = 10.0, penetration = 10.0 /
"""
QUICK = BEAM.format(order=4, samples=20, augmentation=1.0e5)
SLOW = BEAM.format(order=12, samples=60, augmentation=1.0e5)
N_SWEPT = 60
LINE = SLOW + f"&sweep parameter = 'law(1)%gap', from = 0.5e-3, to = 2e-3, n = {N_SWEPT} /\n"
SWEPT = LINE + "&solver first_guess = 'linear' /\n"
GAPS = "&sweep parameter = 'law(1)%gap', values = 1.0e-3, 1.5e-3, 2.0e-3 /\n"

DUFFING = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.05 /
&tones frequency = 1.0 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, cos = 0.18 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
&curve parameter = 'tones%frequency', from = 1.0, to = 1.4, peak_of = 'x1 (1)', points = 200 /
"""

# Data that depend on the rank and the time of the solution.
OF_THE_RUN = ("rank", "solve_seconds", "setup_seconds", "iteration_seconds", "error_estimate_seconds", "worker")

on_linux = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc, where the ranks of mpirun are found")


def contents(path):
    """Bytes of each dataset that must not depend on the run."""
    with h5py.File(path, "r") as file:
        return {name: _bytes(data) for name, data in file.items() if not name.startswith(OF_THE_RUN)}


def _bytes(data):
    values = data[()]
    return values.tobytes() if isinstance(values, np.ndarray) and values.dtype != object else repr(values)


def assert_same(a, b):
    one, other = contents(a), contents(b)
    assert one.keys() == other.keys()
    assert [name for name in one if one[name] != other[name]] == []


def write(folder, text, name="case"):
    source = folder / f"{name}.nml"
    source.write_text(text)
    return source


def ended(folder, text, *options, status=INCOMPLETE, name="case"):
    """A result file whose run has ended before its first point."""
    source = write(folder, text, name)
    done = run("solve", source, "--time-limit", "0", *options, cwd=folder)
    assert done.status == status, done.stderr
    return folder / f"{name}.h5"


def begin(folder, *words, ranks=None):
    return subprocess.Popen(
        command(*words, ranks=ranks),
        cwd=folder,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def holds(condition) -> bool:
    try:
        return bool(condition())
    except BlockingIOError:  # the program is just opening the file, or closing it
        return False


def wait_for(process, condition):
    deadline = time.monotonic() + 600.0
    while not holds(condition):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.005)


def finish(process):
    """Exit status and standard error."""
    text = process.communicate(timeout=600.0)[1].decode(errors="replace")
    return process.returncode, text


def ranks_of(process):
    """Processes of a run: the children of mpirun, whose threads start them in Open MPI 6."""
    if process.poll() is not None:
        return []
    return sorted(int(word) for file in Path(f"/proc/{process.pid}/task").glob("*/children") for word in file.read_text().split())


def kill_one(process):
    pids = ranks_of(process)
    _kill([random.choice(pids)] if pids else [process.pid])


def kill_all(process):
    _kill([process.pid, *ranks_of(process)])


def _kill(pids):
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):  # it may have ended by itself
            os.kill(pid, signal.SIGKILL)


def terminate(process):
    """SIGTERM to each rank, as sent by batch systems; mpirun itself would pass it on only after a second."""
    for pid in ranks_of(process) or [process.pid]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)


def terminate_mpirun(process):
    process.send_signal(signal.SIGTERM)


def n_done(result):
    """Points of a file that have a status; the run may be creating it."""
    try:
        return int((read(result, "status") != PENDING).sum())
    except OSError:
        return -1
