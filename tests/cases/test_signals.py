"""Sweeps and curves that signals, limits and kills end at any moment, on any number of ranks, and `resume` completes."""

import os
import random
import re
import signal
import subprocess
import time
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from ended_runs import (
    BEAM,
    CONVERGED,
    DUFFING,
    FAILED,
    LINE,
    N_SWEPT,
    OUT_OF_BUDGET,
    PENDING,
    SWEPT,
    assert_same,
    begin,
    ended,
    finish,
    kill_all,
    kill_one,
    n_done,
    on_linux,
    ranks_of,
    terminate,
    terminate_mpirun,
    wait_for,
    write,
)
from faults import run_with_fault
from program import (
    ALL_CONVERGED, INCOMPLETE, NOT_ALL_CONVERGED, command, environment, is_without_mpi, program, read, run, seconds_of,
    seconds_of_children, wait_until_caught, wait_until_taken,
)  # fmt: skip


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


def test_logs_are_written_while_the_run_goes_on(tmp_path):
    """Lines of a file or a pipe stayed in the memory of the program until its end, or were lost with it."""
    words = command("solve", write(tmp_path, SWEPT), "--log-level", "debug")
    with open(tmp_path / "out", "w") as out, open(tmp_path / "err", "w") as err:
        process = subprocess.Popen(words, cwd=tmp_path, env=environment(), stdout=out, stderr=err)
    while process.poll() is None and "point 0 on rank 0: converged" not in (tmp_path / "err").read_text():
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert (read(tmp_path / "case.h5", "status") == PENDING).any(), "it had solved all points before its lines were there"
    assert (tmp_path / "out").read_text().startswith("nhbm solve ")


POINT_OF_SECONDS = BEAM.format(order=20, samples=84, augmentation=1.0e3)
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
@pytest.mark.parametrize("ending", [pytest.param(signal.SIGTERM, marks=pytest.mark.long), None], ids=["SIGTERM", "time limit"])
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


@on_linux
@pytest.mark.skipif(is_without_mpi(program()), reason="the program was built without MPI")
def test_no_point_is_blamed_for_the_end_of_mpirun(tmp_path):
    """A thread of MPI ends each rank by _exit() when mpirun is killed, within whatever point; resume solves it."""
    result = tmp_path / "case.h5"
    process = begin(tmp_path, "solve", write(tmp_path, SWEPT), "--quiet", ranks=2)
    wait_for(process, lambda: result.exists() and (read(result, "status") == CONVERGED).any())
    process.kill()
    finish(process)  # also waits for the ranks, which have its standard error
    status = read(result, "status")
    assert set(status.tolist()) <= {PENDING, CONVERGED} and (status == PENDING).any()


RINGING = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0, damping = 1e-5 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&sweep parameter = 'load(1)%cos', values = 0.5, 1.0, 1.5 /
"""


def is_at_work(process, ranks):
    """Whether all ranks have begun a long work: the start takes a tenth of a second."""
    pids = ranks_of(process) if ranks else [process.pid]
    return len(pids) == (ranks or 1) and all(seconds_of(SimpleNamespace(pid=pid)) > 1.0 for pid in pids)


@on_linux
@pytest.mark.parametrize("ranks", [pytest.param(None, marks=pytest.mark.long), 2])
def test_a_signal_keeps_the_verdicts_of_verify(ranks, tmp_path):
    """Disturbances hardly decay: the first point is verified over 30 periods, the others would take days."""
    source = write(tmp_path, RINGING)
    assert run("solve", source, cwd=tmp_path).status == ALL_CONVERGED
    assert run("verify", "case.h5", "--points", "0", "--periods", "30", cwd=tmp_path).status != INCOMPLETE
    before = read(tmp_path / "case.h5", "integration_verdict")
    process = begin(tmp_path, "verify", "case.h5", "--points", "1,2", "--periods", "100000000", ranks=ranks)
    wait_for(process, lambda: is_at_work(process, ranks))
    process.send_signal(signal.SIGUSR1)
    status, text = finish(process)
    assert status == INCOMPLETE, text
    assert "stopped by SIGUSR1: 2 points are left: nhbm verify case.h5 --points 1,2\n" in text
    assert before[0] != 0 and (read(tmp_path / "case.h5", "integration_verdict") == before).all()


@on_linux
def test_a_signal_ends_check_and_integrate_with_a_message(tmp_path):
    sweep = RINGING.replace("values = 0.5, 1.0, 1.5", "from = 0.5, to = 1.5, n = 1000000")
    process = begin(tmp_path, "check", write(tmp_path, sweep))
    wait_for(process, lambda: is_at_work(process, None))
    process.send_signal(signal.SIGTERM)
    status, text = finish(process)
    assert status == INCOMPLETE and re.search(r"stopped by SIGTERM after \d+ points of 1000000, which can be read\n", text), text
    endless = RINGING.split("&sweep")[0] + "&integration duration = 1e7, decimation = 1000000 /\n"
    process = begin(tmp_path, "integrate", write(tmp_path, endless))
    wait_until_caught(process, signal.SIGINT)
    process.send_signal(signal.SIGINT)
    status, text = finish(process)
    assert status == INCOMPLETE and "ended by a signal before there was a result" in text, text
    assert [path.name for path in tmp_path.iterdir()] == ["case.nml"]


def test_the_time_limit_ends_integrate_without_a_record(tmp_path):
    endless = RINGING.split("&sweep")[0] + "&integration duration = 1e7, decimation = 1000000 /\n"
    done = run("integrate", write(tmp_path, endless), "--time-limit", 0.2, cwd=tmp_path)
    assert done.status == INCOMPLETE and "stopped by the time limit" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["case.nml"]


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


DISTURBANCES = {"kill -9 of one rank": kill_one, "kill -9 of all": kill_all, "SIGTERM": terminate}
SLOW_DISTURBANCES = {"SIGTERM to mpirun": terminate_mpirun}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The file of an undisturbed run."""
    folder = tmp_path_factory.mktemp("undisturbed")
    done = run("solve", write(folder, SWEPT), "--quiet", cwd=folder, ranks=3)
    assert done.status == ALL_CONVERGED, done.stderr
    return folder / "case.h5"


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
    names = {p.name for p in folder.iterdir() if not re.fullmatch(r"case\.h5\.(meta)?data\.\d+", p.name)}  # of Open MPI 6
    assert names == {"case.h5", "case.nml"}
    for path in (source, result):
        path.unlink()
    return hits


@on_linux
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("SIGTERM", marks=pytest.mark.long),
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
    [kill_all, lambda process: process.send_signal(signal.SIGUSR1)],
    ids=["kill -9 of all", "SIGUSR1"],
)
@pytest.mark.long
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


@on_linux
def test_curve_that_a_signal_ends_within_a_point_goes_on(tmp_path):
    """The signal arrives during a step, twice; tests/campaigns/interrupted tries a thousand moments."""
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
