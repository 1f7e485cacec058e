"""Sweeps that survive: however a run ends, its file can be opened, and `resume` completes it to the result of an undisturbed
run."""

import contextlib
import os
import random
import resource
import shlex
import signal
import subprocess
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from faults import run_with_fault
from program import (
    ALL_CONVERGED, BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, command, environment, read, run, seconds_of, seconds_of_children,
    wait_until_taken,
)  # fmt: skip

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


# Resume


def test_resumed_run_equals_the_undisturbed_one(tmp_path):
    result = ended(tmp_path, QUICK + GAPS, "--set", "law(1)%augmentation=2.0e5", "--set", "output%title='it''s a title'")
    assert read(result, "status").tolist() == [PENDING] * 3
    source = write(tmp_path, QUICK + GAPS, "whole")
    options = ("--set", "law(1)%augmentation=2.0e5", "--set", "output%title='it''s a title'")
    assert run("solve", source, *options, cwd=tmp_path).status == ALL_CONVERGED
    done = run("resume", result, cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "3 of 3 points converged" in done.stdout, done.stderr
    assert_same(result, tmp_path / "whole.h5")


def test_solve_with_resume_makes_the_file_or_goes_on(tmp_path):
    source = write(tmp_path, QUICK + GAPS)
    for limit, status in (("0", INCOMPLETE), ("1000", ALL_CONVERGED), ("1000", ALL_CONVERGED)):
        assert run("solve", source, "--resume", "--time-limit", limit, cwd=tmp_path).status == status
    assert read(tmp_path / "case.h5", "status").tolist() == [CONVERGED] * 3


def test_complete_file_is_left_as_it_is(tmp_path):
    source = write(tmp_path, QUICK + GAPS)
    assert run("solve", source, cwd=tmp_path).status == ALL_CONVERGED
    before = (tmp_path / "case.h5").read_bytes()
    assert run("resume", "case.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert (tmp_path / "case.h5").read_bytes() == before


@pytest.mark.parametrize("ranks", [None, 2])
def test_changed_input_is_refused_by_name(ranks, tmp_path):
    result = ended(tmp_path, QUICK + GAPS)
    before = result.read_bytes()
    source = write(tmp_path, (QUICK + GAPS).replace("tuple = 0, 1, cos = 100.0", "tuple = 0, 1, cos = 90.0, sin = 3.0"))
    done = run("solve", source, "--resume", "--set", "sweep(1)%values=1.0e-3, 1.5e-3, 2.5e-3", cwd=tmp_path, ranks=ranks)
    assert done.status == BAD_INPUT and len(done.messages) == 1
    for words in ("case.h5", "&load(2): cos: 90.0 in the input, 100.0 in the file", "&load(2): sin: 3.0 in the input"):
        assert words in done.stderr
    assert "&sweep: values: " in done.stderr and "2.5e-3" in done.stderr
    assert result.read_bytes() == before


def test_comments_and_blanks_do_not_change_an_input(tmp_path):
    ended(tmp_path, QUICK + GAPS)
    source = write(tmp_path, "! the same\n" + (QUICK + GAPS).replace(" = ", "=").replace("1.5e-3", "0.0015"))
    done = run("solve", source, "--resume", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr


def test_retry_solves_again_what_did_not_converge(tmp_path):
    text = QUICK + (
        "&sweep parameter = 'law(1)%gap', values = 1.0, 0.2e-3, -1.0e-3, 1.0e-3 /\n"
        "&solver method = 'broyden', max_iterations = 1, fallback = .false. /\n"
    )
    text = text.replace("augmentation = 100000.0", "augmentation = 1.0e5, two_sided = .true.")
    source = write(tmp_path, text)
    assert run("solve", source, cwd=tmp_path).status == NOT_ALL_CONVERGED
    result = tmp_path / "case.h5"
    undisturbed = contents(result)
    status = read(result, "status")
    again = np.flatnonzero(status != CONVERGED)
    assert {OUT_OF_BUDGET, FAILED} <= set(status.tolist()) and again.size < 4

    with h5py.File(result, "r+") as file:  # marks that show which rows are written
        file["solve_seconds"][...] = -1.0
    assert run("resume", result, cwd=tmp_path).status == NOT_ALL_CONVERGED
    assert (read(result, "solve_seconds") == -1.0).all()
    with h5py.File(result, "r+") as file:
        file["coefficients"][int(again[-1])] = 7.0
    done = run("resume", result, "--retry", cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED
    assert np.flatnonzero(read(result, "solve_seconds") != -1.0).tolist() == again.tolist()
    assert contents(result) == undisturbed


def test_an_unfinished_chain_is_said_to_begin_again(tmp_path):
    """A limit shorter than a chain would never end the run; points on their own need no word."""
    write(tmp_path, SWEPT)
    for guess, is_said in (("neighbour", True), ("linear", False)):
        done = run("solve", "case.nml", "--overwrite", "--time-limit", "0", "--set", f"solver%first_guess='{guess}'", cwd=tmp_path)
        assert done.status == INCOMPLETE and "nhbm resume case.h5 solves" in done.stderr
        assert ("a chain of points that is not finished begins again (see &solver chain_length)" in done.stderr) == is_said


@pytest.mark.parametrize(
    "words, says",
    [
        (("resume", "none.h5"), "'none.h5' does not exist"),
        (("resume", "case.nml"), "is no result file"),
        (("resume",), "needs a result file"),
        (("resume", "case.h5", "--set", "law(1)%gap=1"), "no --set"),
        (("resume", "case.h5", "--overwrite"), "--overwrite"),
        (("solve", "case.nml", "--resume", "--overwrite"), "--overwrite"),
        (("solve", "case.nml", "--retry"), "--resume"),
        (("solve", "case.nml", "--time-limit", "1h"), "--time-limit needs seconds"),
        (("solve", "case.nml", "--time-limit", "-1"), "--time-limit needs seconds"),
        (("info", "case.nml"), "is no result file"),
    ],
)
def test_what_cannot_be_resumed(words, says, tmp_path):
    write(tmp_path, QUICK)
    done = run(*words, cwd=tmp_path)
    assert done.status == BAD_INPUT and len(done.messages) == 1 and says in done.stderr, done.stderr


# The file


def test_only_rows_of_points_change_after_the_file_is_made(tmp_path):
    """Metadata do not change: a run may be killed between any two writes."""
    result = ended(tmp_path, QUICK + GAPS)
    before = np.frombuffer(result.read_bytes(), np.uint8)
    assert run("resume", result, cwd=tmp_path).status == ALL_CONVERGED
    after = np.frombuffer(result.read_bytes(), np.uint8)
    assert before.size == after.size
    is_row = np.zeros(before.size, bool)
    with h5py.File(result, "r") as file:
        for data in file.values():
            if data.ndim > 0 and data.dims[0].keys()[:1] == ["point"] and "parameter" not in data.attrs:
                first = data.id.get_offset()
                is_row[first : first + data.id.get_storage_size()] = True
    assert is_row.any() and (before[~is_row] == after[~is_row]).all()
    assert (before[is_row] != after[is_row]).any()


def test_leftover_of_a_killed_creation_is_replaced(tmp_path):
    source = write(tmp_path, QUICK)
    part = tmp_path / "case.h5.part"
    part.write_bytes(b"x" * 1000)
    part.chmod(0o1600)  # by this a part of a run is known; another file of that name is left alone
    assert run("solve", source, cwd=tmp_path).status == ALL_CONVERGED
    assert sorted(p.name for p in tmp_path.iterdir()) == ["case.h5", "case.nml"]
    assert read(tmp_path / "case.h5", "status").tolist() == [CONVERGED]


def test_file_that_another_run_is_making_is_left_alone(tmp_path):
    fcntl = pytest.importorskip("fcntl")
    source, part = write(tmp_path, QUICK), tmp_path / "case.h5.part"
    with open(part, "wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        done = run("solve", source, cwd=tmp_path)
    assert done.status == BAD_INPUT and "another run is making it" in done.stderr
    assert part.exists() and not (tmp_path / "case.h5").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to mount a small disk")
def test_full_disk(tmp_path):
    """Nothing remains of a file that does not fit, and the file that it should replace is unchanged."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", disk], capture_output=True, check=False)
    if mounted.returncode != 0:
        pytest.skip("no tmpfs can be mounted here")
    try:
        small, large = write(tmp_path, QUICK, "small"), write(tmp_path, SWEPT, "large")
        assert run("solve", small, "-o", disk / "kept.h5", cwd=tmp_path).status == ALL_CONVERGED
        kept = (disk / "kept.h5").read_bytes()
        for ranks in (None, 2):
            done = run("solve", large, "-o", disk / "kept.h5", "--overwrite", cwd=tmp_path, ranks=ranks)
            assert done.status == BAD_INPUT and len(done.messages) == 1, done.stderr
            assert "kept.h5" in done.stderr and "space" in done.stderr
        assert [p.name for p in disk.iterdir()] == ["kept.h5"]
        assert (disk / "kept.h5").read_bytes() == kept
    finally:
        subprocess.run(["umount", disk], check=True)


def test_write_that_fails_ends_the_run_with_a_message(tmp_path):
    """A limit on the size of files represents a full disk: the file is complete, its rows cannot be written."""
    text = SWEPT.replace(f"n = {N_SWEPT}", "n = 12")
    source = write(tmp_path, text)
    assert run("solve", source, "--time-limit", "0", cwd=tmp_path).status == INCOMPLETE
    result = tmp_path / "case.h5"
    with h5py.File(result, "r") as file:
        first = file["coefficients"].id.get_offset()
        row = file["coefficients"].id.get_storage_size() // 12
    limit = first + 3 * row + row // 2
    done = subprocess.run(
        command("resume", result, "--quiet"),
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    message = done.stderr.decode()
    assert done.returncode == BAD_INPUT, message
    assert message.count("nhbm: ") == 1 and "point " in message and "cannot write" in message and "case.h5" in message
    status = read(result, "status")
    assert (status[4:] == PENDING).all()
    assert run("resume", result, cwd=tmp_path).status == ALL_CONVERGED
    whole = write(tmp_path, text, "whole")
    assert run("solve", whole, cwd=tmp_path).status == ALL_CONVERGED
    assert_same(result, tmp_path / "whole.h5")


# Signals, time limit, kills


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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGUSR1], ids=lambda n: n.name)
def test_signal_ends_a_run_within_the_point_in_flight(number, tmp_path):
    result = tmp_path / "case.h5"
    process = begin(tmp_path, "solve", write(tmp_path, SWEPT), "--quiet")
    wait_for(process, lambda: result.exists() and (read(result, "status") == CONVERGED).any())
    process.send_signal(number)
    status, text = finish(process)
    n_left = int((read(result, "status") == PENDING).sum())
    assert status == INCOMPLETE and 0 < n_left < N_SWEPT
    assert f"stopped by {number.name}: {n_left} points are left; nhbm resume case.h5" in text
    in_flight = np.isfinite(read(result, "coefficients")).any(axis=(1, 2, 3)) & (read(result, "status") == PENDING)
    assert not in_flight.any(), "the point in flight is left as if it had never been begun"


POINT_OF_SECONDS = BEAM.format(order=14, samples=60, augmentation=1.0e3)
DENSE = ("--set", "solver%method='newton'", "--set", "solver%fallback=.false.", "--set", "solver%tolerance=1e-30")
DENSE += ("--set", "solver%max_iterations=40", "--set", "solver%line_search=.false.")


@pytest.fixture(scope="module")
def undisturbed_point(tmp_path_factory):
    """A result file, and the processor seconds that its run took."""
    folder = tmp_path_factory.mktemp("point")
    before = seconds_of_children()
    run("solve", write(folder, POINT_OF_SECONDS), "--quiet", *DENSE, cwd=folder)
    return folder / "case.h5", seconds_of_children() - before


@on_linux
@pytest.mark.parametrize("ending", [signal.SIGTERM, None], ids=["SIGTERM", "time limit"])
def test_point_in_flight_is_left_between_iterations_and_solved_again(ending, undisturbed_point, tmp_path):
    """A point of some seconds: its run ends long before, and after resume the result is that of an undisturbed run."""
    whole, undisturbed = undisturbed_point
    result = ended(tmp_path, POINT_OF_SECONDS, *DENSE)  # a limit may pass before the file is there
    before = seconds_of_children()
    limit = () if ending else ("--time-limit", str(0.2 * undisturbed))
    process = begin(tmp_path, "resume", result, "--quiet", *limit)
    if ending:
        wait_for(process, lambda: seconds_of(process) > 0.2 * undisturbed)
        process.send_signal(ending)
    status, text = finish(process)
    assert status == INCOMPLETE and "1 point is left" in text
    assert seconds_of_children() - before < 0.7 * undisturbed
    assert read(result, "status").tolist() == [PENDING]
    run("resume", result, cwd=tmp_path)
    assert_same(result, whole)


@on_linux
def test_second_signal_drops_the_point_in_flight(tmp_path):
    """Without waiting for its iteration."""
    long_point = BEAM.format(order=30, samples=150, augmentation=1.0e3)
    result = tmp_path / "case.h5"
    dense = ("--set", "solver%method='newton'", "--set", "solver%fallback=.false.", "--set", "solver%tolerance=1e-30")
    before = seconds_of_children()
    process = begin(tmp_path, "solve", write(tmp_path, long_point), "--quiet", *dense)
    wait_for(process, result.exists)
    begun = seconds_of(process)
    wait_for(process, lambda: seconds_of(process) > begun + 0.3)
    process.send_signal(signal.SIGTERM)
    wait_until_taken(process, signal.SIGTERM)
    before += seconds_of(process)
    process.send_signal(signal.SIGTERM)
    status, text = finish(process)
    assert status == INCOMPLETE and "second signal" in text and "nhbm resume case.h5" in text
    assert seconds_of_children() - before < 2.0
    assert read(result, "status").tolist() == [PENDING]


@on_linux
def test_signal_that_mpirun_passes_on_ends_all_ranks(tmp_path):
    """mpirun hands SIGUSR1 to the ranks."""
    result = tmp_path / "case.h5"
    process = begin(tmp_path, "solve", write(tmp_path, SWEPT), "--quiet", ranks=3)
    wait_for(process, lambda: result.exists() and (read(result, "status") == CONVERGED).any())
    process.send_signal(signal.SIGUSR1)
    status, text = finish(process)
    assert status == INCOMPLETE and "stopped by SIGUSR1" in text and "resume case.h5" in text
    assert 0 < (read(result, "status") == PENDING).sum() < N_SWEPT


@on_linux
def test_signal_to_one_rank_ends_all_ranks(tmp_path):
    result = tmp_path / "case.h5"
    process = begin(tmp_path, "solve", write(tmp_path, SWEPT), "--quiet", ranks=3)
    wait_for(process, lambda: result.exists() and (read(result, "status") == CONVERGED).any())
    os.kill(ranks_of(process)[-1], signal.SIGTERM)
    status, text = finish(process)
    assert status == INCOMPLETE and "stopped by" in text
    assert 0 < (read(result, "status") == PENDING).sum() < N_SWEPT


@pytest.mark.parametrize("ranks", [None, 2])
def test_time_limit(ranks, tmp_path):
    result = ended(tmp_path, SWEPT.replace(f"n = {N_SWEPT}", "n = 2000"))
    for limit in (1, 10, 60):  # within the first a slow machine solves no point
        done = run("resume", result, "--time-limit", limit, cwd=tmp_path, ranks=ranks)
        assert done.status == INCOMPLETE and "stopped by the time limit" in done.stderr
        n_solved = int((read(result, "status") == CONVERGED).sum())
        if n_solved > 0:
            break
    assert 0 < n_solved < 2000


def ranks_of(process):
    """Processes of a run: the children of mpirun."""
    if process.poll() is not None:
        return []
    return [int(word) for word in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]


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


DISTURBANCES = {"kill -9 of one rank": kill_one, "kill -9 of all": kill_all, "SIGTERM": terminate}
SLOW_DISTURBANCES = {"SIGTERM to mpirun": terminate_mpirun}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The file of an undisturbed run."""
    folder = tmp_path_factory.mktemp("undisturbed")
    done = run("solve", write(folder, SWEPT), "--quiet", cwd=folder, ranks=3)
    assert done.status == ALL_CONVERGED, done.stderr
    return folder / "case.h5"


def n_done(result):
    """Points of a file that have a status; the run may be creating it."""
    try:
        return int((read(result, "status") != PENDING).sum())
    except OSError:
        return -1


def wait_for_moment(process, result, moments, already):
    """Waits for a random moment of a run: during its start, or while any point is solved."""
    target = moments.randrange(already - 6, max(already + 1, N_SWEPT - 15))  # some points are left to be hit
    if target <= already:
        time.sleep(moments.uniform(0.0, 0.3))
        return
    while process.poll() is None and n_done(result) < target:
        time.sleep(0.01)
    time.sleep(moments.uniform(0.0, 0.05))


def disturb(folder, whole, disturbance, seed):
    """Disturbs a run at a random moment, continues it, once more, and compares; counts the kinds of moments."""
    moments = random.Random(seed)
    source, result = write(folder, SWEPT), folder / "case.h5"
    hits = {"before the file was there": 0, "between points": 0, "after the last point": 0}
    for _ in range(2):
        process = begin(folder, "solve", source, "--resume", "--quiet", ranks=3)
        wait_for_moment(process, result, moments, n_done(result))
        disturbance(process)
        try:
            process.communicate(timeout=120.0)
        except subprocess.TimeoutExpired:  # mpirun may wait for ever for a rank that was killed while it started
            kill_all(process)
            finish(process)
        if not result.exists():
            hits["before the file was there"] += 1
            continue
        with h5py.File(result, "r+") as file:  # no mark of being open keeps a writer out
            assert set(file["status"][()]) <= {PENDING, CONVERGED}
        status, coefficients = read(result, "status", "coefficients")
        hits["between points" if (status == PENDING).any() else "after the last point"] += 1
        with h5py.File(whole, "r") as file:
            is_done = status == CONVERGED
            assert coefficients[is_done].tobytes() == file["coefficients"][()][is_done].tobytes(), f"seed {seed}"
    done = run("solve", source, "--resume", "--quiet", cwd=folder, ranks=2)
    assert done.status == ALL_CONVERGED, f"seed {seed}: {done.stderr}"
    assert_same(result, whole)
    assert sorted(p.name for p in folder.iterdir()) == ["case.h5", "case.nml"]
    for path in (source, result):
        path.unlink()
    return hits


@on_linux
@pytest.mark.parametrize(
    "name",
    [
        "SIGTERM",
        "kill -9 of all",
        pytest.param("kill -9 of one rank", marks=pytest.mark.long),
        pytest.param("SIGTERM to mpirun", marks=pytest.mark.long),
    ],
)
def test_disturbed_runs_are_completed(name, undisturbed, tmp_path):
    seed = random.randrange(10**9)
    hits = disturb(tmp_path, undisturbed, (DISTURBANCES | SLOW_DISTURBANCES)[name], seed)
    assert sum(hits.values()) == 2, f"seed {seed}"


@on_linux
@pytest.mark.long
@pytest.mark.parametrize("name", DISTURBANCES)
def test_disturbed_runs_are_completed_at_fifty_moments(name, undisturbed, tmp_path):
    totals = {}
    for seed in range(25):
        for what, n in disturb(tmp_path, undisturbed, DISTURBANCES[name], seed).items():
            totals[what] = totals.get(what, 0) + n
    print(f"{name}: {totals}")
    assert sum(totals.values()) == 50 and totals["between points"] >= 30


CHAIN = 16
CHAINED = LINE + f"&solver first_guess = 'neighbour', chain_length = {CHAIN} /\n"


def broken_chains(result):
    """Chains in which only some points are solved."""
    try:
        is_done = read(result, "status") != PENDING
    except OSError:
        return []
    return [first for first in range(0, N_SWEPT, CHAIN) if len(set(is_done[first : first + CHAIN].tolist())) == 2]


@pytest.fixture(scope="module")
def undisturbed_chains(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chains")
    done = run("solve", write(folder, CHAINED), "--quiet", cwd=folder, ranks=3)
    assert done.status == ALL_CONVERGED, done.stderr
    return folder / "case.h5"


@on_linux
@pytest.mark.parametrize(
    "disturbance",
    [kill_all, pytest.param(lambda process: process.send_signal(signal.SIGUSR1), marks=pytest.mark.long)],
    ids=["kill -9 of all", "SIGUSR1"],
)
def test_broken_chains_are_solved_again_from_their_beginning(disturbance, undisturbed_chains, tmp_path):
    """Each point of a chain starts from the previous solution, so the rest of a chain cannot be solved separately."""
    result = tmp_path / "case.h5"
    process = begin(tmp_path, "solve", write(tmp_path, CHAINED), "--quiet", ranks=3)
    wait_for(process, lambda: len(broken_chains(result)) >= 2)
    disturbance(process)
    finish(process)
    broken = broken_chains(result)
    assert broken
    is_kept = read(result, "status") == CONVERGED
    for first in broken:
        is_kept[first : first + CHAIN] = False
    with h5py.File(result, "r+") as file:  # a mark that shows which rows are written
        file["rank"][...] = 99
    done = run("resume", result, cwd=tmp_path, ranks=2)
    assert done.status == ALL_CONVERGED and f"{N_SWEPT} of {N_SWEPT} points converged" in done.stdout, done.stderr
    assert ((read(result, "rank") == 99) == is_kept).all()
    assert_same(result, undisturbed_chains)


# Curves

DUFFING = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.05 /
&tones frequency = 1.0 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, cos = 0.18 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
&curve parameter = 'tones%frequency', from = 1.0, to = 1.4, peak_of = 'x1 (1)', points = 200 /
"""


@on_linux
def test_curve_that_a_signal_ends_within_a_point_goes_on(tmp_path):
    """The signal arrives during a step, twice; tests/interrupted tries a thousand moments."""
    run("solve", write(tmp_path, DUFFING, "whole"), "--quiet", cwd=tmp_path)
    result = tmp_path / "case.h5"
    for at in (297, 608):
        done = run_with_fault(
            "solve", write(tmp_path, DUFFING), "--resume", "--quiet", cwd=tmp_path, call="clock", at=at, number=signal.SIGTERM
        )
        status = read(result, "status")
        assert done.status == INCOMPLETE and "stopped by SIGTERM" in done.stderr, (done.status, done.stderr)
        assert (status == CONVERGED).any() and (status[status != CONVERGED] == PENDING).all()
    assert run("resume", result, cwd=tmp_path).status == ALL_CONVERGED
    assert_same(result, tmp_path / "whole.h5")


# Any number of ranks


def thousand():
    """Contact points of which some have too few iterations, and some an invalid gap."""
    gaps = ", ".join(f"{gap!r}" for gap in [*np.linspace(2.0e-3, 0.9e-3, 39).tolist(), -1.0e-4])
    text = BEAM.format(order=4, samples=20, augmentation=1.0e3)
    text = text.replace(" /\n&error_estimate", ", two_sided = .true. /\n&error_estimate")
    return text + (
        "&solver first_guess = 'linear', max_iterations = 7, fallback = .false. /\n"
        "&sweep parameter = 'load(2)%cos', from = 60.0, to = 110.0, n = 25 /\n"
        f"&sweep parameter = 'law(1)%gap', values = {gaps} /\n"
    )


@pytest.mark.long
def test_thousand_contact_points_have_the_same_bits_on_any_number_of_ranks(tmp_path):
    serial = None
    for ranks in (1, 2, 3, 4, 8):
        folder = tmp_path / str(ranks)
        folder.mkdir()
        done = run("solve", write(folder, thousand()).name, "--quiet", cwd=folder, ranks=ranks)
        assert done.status == NOT_ALL_CONVERGED, done.stderr
        if serial is None:
            serial = folder / "case.h5"
            status = read(serial, "status")
            assert status.size == 1000 and {OUT_OF_BUDGET, FAILED} <= set(status.tolist())
            assert 0.03 < (status != CONVERGED).mean() < 0.08
            print(f"{int((status != CONVERGED).sum())} of 1000 points did not converge")
        assert_same(serial, folder / "case.h5")


# Info


def test_info_of_a_run_that_is_not_complete(tmp_path):
    text = QUICK + "&output title = 'a beam' /\n&sweep parameter = 'law(wall)%gap', values = 2.0e-3, 1.0e-3 /\n"
    result = ended(tmp_path, text)
    done = run("info", result, cwd=tmp_path)
    assert done.status == INCOMPLETE, done.stderr
    for words in (
        "title      a beam",
        "swept      law(wall)%gap: 2 values, 1.0e-3 to 2.0e-3 m",
        "2 not solved yet",
        f"complete   no, 2 points left; nhbm resume {result} solves them",
    ):
        assert words in done.stdout, done.stdout
    assert "worst" not in done.stdout and "times" not in done.stdout


def test_info_of_a_complete_run(tmp_path):
    text = QUICK.replace("augmentation = 100000.0", "augmentation = 1.0e5, two_sided = .true.")
    source = write(tmp_path, text + "&sweep parameter = 'law(1)%gap', values = 1.5e-3, -1.0e-3, 1.0e-3 /\n")
    assert run("solve", source, cwd=tmp_path).status == NOT_ALL_CONVERGED
    done = run("info", "case.h5", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    truncation = read(tmp_path / "case.h5", "truncation_estimate")
    worst = int(np.nanargmax(truncation))
    gap = {0: "1.5e-3", 2: "1.0e-3"}[worst]
    for words in (
        "2 converged",
        "1 failed: an error of this point, see its message (first: point 1)",
        f"truncation {truncation[worst]:.2E} at point {worst} (law(1)%gap = {gap} m)",
        "complete   yes",
        "nhbm resume case.h5 --retry also tries 1 again",
    ):
        assert words in done.stdout, done.stdout


def test_info_agrees_with_the_reader(tmp_path):
    """The lines of the same name in `nhbm info` and `nhbm-post info`."""
    from nhbm_post import report
    from nhbm_post.reader import Results

    result = ended(tmp_path, QUICK + GAPS)
    for names in (("written by", "run on", "tones", "harmonics", "dofs", "swept", "complete"), ("complete",)):
        ours = run("info", result, cwd=tmp_path).stdout.splitlines()
        with Results(result) as results:
            theirs = report.info(results).splitlines()
        for name in names:
            line = [text for text in ours if text.startswith(name + " ")]
            assert line and line[0].rstrip() in [text.rstrip() for text in theirs], name
        run("resume", result, cwd=tmp_path)


def test_a_resumed_run_reads_only_points_that_have_results(tmp_path):
    """Not the file, which is empty for the most part: 1.2 GB of reserved harmonics for 3,000 points."""
    if not os.path.exists("/proc/self/io"):
        pytest.skip("this system does not count what a process reads")
    (tmp_path / "case.nml").write_text(
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.1 /\n&tones frequency = 0.9 /\n"
        "&law type = 'elastic_stop', dof = 'x1', stiffness = 1.0, gap = 0.3 /\n"
        "&sweep parameter = 'tones%frequency', from = 0.8, to = 1.2, n = 3000 /\n"
    )
    run("solve", "case.nml", "--time-limit", "0.2", "--quiet", cwd=tmp_path)
    assert (tmp_path / "case.h5").stat().st_size > 5e8
    words = shlex.join(command("resume", "case.h5", "--time-limit", "0", "--quiet"))
    words = ["bash", "-c", f"{words}; cat /proc/$$/io"]
    done = subprocess.run(words, cwd=tmp_path, env=environment(), capture_output=True, text=True)
    counted = dict(line.split(": ") for line in done.stdout.splitlines() if ": " in line)
    assert int(counted["rchar"]) < 2e8, done.stdout + done.stderr
