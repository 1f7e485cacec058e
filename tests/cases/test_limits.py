"""Signals and limits end a run within a second at any time. Many more cases in `tests/campaigns/limits`, label long."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from limit_parts.models import MODELS, build_laws
from program import BAD_INPUT, INCOMPLETE, command, environment, is_without_mpi, messages_of, program, read, run, seconds_of, solve

ROOT = Path(__file__).resolve().parents[2]
NO_MOTION = 11  # docs/user/schema.md
REFERENCE = 0.05  # seconds of the loop below on the machine where a second is the limit


def in_time():
    """A second of the processor, so that other work of the machine does not count, and more where a loop of Python takes longer."""
    best = np.inf
    for _ in range(3):
        began = time.process_time()
        sum(k * k for k in range(500_000))
        best = min(best, time.process_time() - began)
    return max(1.0, best / REFERENCE)


@pytest.mark.parametrize("name", ["time integration, cvode", "exponents"])
def test_a_signal_ends_a_run_within_a_second(name, tmp_path):
    build_laws(tmp_path)
    (tmp_path / "case.nml").write_text(MODELS[name])
    process = subprocess.Popen(
        command("solve", "case.nml", "--quiet"), cwd=tmp_path, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    while not (tmp_path / "case.h5").exists():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.005)
    time.sleep(0.3)
    if process.poll() is not None:
        pytest.skip("done before a signal came")
    limit, before = in_time(), seconds_of(process)
    last = before
    process.send_signal(signal.SIGTERM)
    while process.poll() is None:
        assert last - before < limit
        time.sleep(0.005)
        last = max(last, seconds_of(process))
    assert process.returncode == INCOMPLETE


MANY_HARMONICS = """
&structure type = 'chain', n_masses = 2, mass = 1.0, damping_mass = 0.02, ends = 'fixed-free', coupling_stiffness = 1.0 /
&tones frequency = 0.8, 1.31 /
&harmonics order = 300 /
&load dof = 'x1', tuple = 1, 0, cos = 0.3 /
&load dof = 'x1', tuple = 0, 1, cos = 0.3 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 10.0, gap = 50.0 /
"""


@pytest.mark.long
@pytest.mark.parametrize("seconds", [3.0, 5.0, 7.0])
def test_a_signal_ends_the_estimate_of_180000_harmonics(seconds, tmp_path):
    """36 s of the processor in e76263d3: a loop over harmonics within another one. Single transforms take half a second."""
    (tmp_path / "case.nml").write_text(MANY_HARMONICS)
    factor = in_time()
    process = subprocess.Popen(command("solve", "case.nml", "--quiet"), cwd=tmp_path, env=environment(), stderr=subprocess.DEVNULL)
    while seconds_of(process) < seconds * factor:
        if process.poll() is not None:
            pytest.skip("done before a signal came")
        time.sleep(0.05)
    last = before = seconds_of(process)
    process.send_signal(signal.SIGTERM)
    while process.poll() is None and last - before < 15.0 * factor:
        time.sleep(0.05)
        last = max(last, seconds_of(process))
    process.kill()
    assert process.wait() == INCOMPLETE


DUFFING = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 1e-7, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&sweep parameter = 'load(1)%cos', values = 0.5, 1.0, 1.5 /
"""


FULL = 'mount -t tmpfs -o size=4k none /dev/shm && exec "$@"'


@pytest.mark.skipif(is_without_mpi(program()), reason="ranks without MPI share memory of their own")
def test_full_shared_memory_is_an_error_on_all_ranks(tmp_path):
    """The window of MPI would fail on one of them, and the others would wait for it."""
    if subprocess.run(["unshare", "-m", "bash", "-c", FULL, "-", "true"], capture_output=True).returncode:
        pytest.skip("needs the right to mount a file system")
    (tmp_path / "case.nml").write_text(DUFFING)
    words = ["unshare", "-m", "bash", "-c", FULL, "-", *command("solve", "case.nml", ranks=2)]
    variables = {**environment(), "OMPI_MCA_btl": "self,vader,tcp"}  # Open MPI goes on without shared memory of its own
    done = subprocess.run(words, cwd=tmp_path, env=variables, capture_output=True, text=True, timeout=100)
    assert done.returncode == BAD_INPUT and "/dev/shm has 4 kB left" in done.stderr


def test_verify_and_check_end_in_time_too(tmp_path):
    """A point in progress has no verdict, and those before keep theirs. Disturbances hardly decay."""
    (tmp_path / "case.nml").write_text(DUFFING)
    assert run("check", "case.nml", "--time-limit", "100", cwd=tmp_path).status == 0
    done = run("check", "case.nml", "--time-limit", "0", cwd=tmp_path)
    assert done.status == INCOMPLETE and "stopped by the time limit after 1 point of 3" in done.stderr
    assert run("solve", "case.nml", cwd=tmp_path).status == 0
    assert run("verify", "case.h5", "--points", "0", "--periods", "30", "--time-limit", "100", cwd=tmp_path).status != INCOMPLETE
    began = time.monotonic()
    done = run("verify", "case.h5", "--points", "1,2", "--periods", "100000000", "--time-limit", "0.3", cwd=tmp_path)
    assert time.monotonic() - began < 30.0
    assert done.status == INCOMPLETE and "stopped by the time limit: 2 points are left" in done.stderr
    assert "0 points verified" in done.stdout
    with h5py.File(tmp_path / "case.h5") as file:
        assert (file["integration_verdict"][()] != 0).tolist() == [True, False, False]


def test_a_law_that_gives_up_for_ever_ends_by_itself(tmp_path):
    """640 s in version 2825d10: time integration took ever smaller steps towards a point where the law has no force."""
    build_laws(tmp_path)
    began = time.monotonic()
    result = solve(MODELS["recoverable law"], tmp_path, status=None)
    assert time.monotonic() - began < 60.0
    assert "as small as rounding" in messages_of(result)
    assert read(result, "status").tolist() != [0]


@pytest.mark.long
def test_limits_hold_everywhere():
    done = subprocess.run(
        [sys.executable, ROOT / "tests/campaigns/limits", "--runs", "3"],
        env={**environment(), "NHBM": program()},
        capture_output=True,
    )
    assert done.returncode == 0, done.stdout.decode()


def test_what_lies_beyond_the_set_is_in_the_estimate(tmp_path):
    """Averages of an integrated motion are exact to 1e-10; the harmonics omitted at order 1 are a hundredth and more."""
    text = (
        "&structure type='matrices', n_dofs=1, mass=1.0, damping=0.2, stiffness=1.0 /\n"
        "&tones frequency=0.8 /\n&harmonics order=1 /\n"
        "&load dof='x1', tuple=1, cos=1.0 /\n&law type='elastic_stop', dof='x1', stiffness=10.0, gap=0.5 /\n"
        "&solver primary_method='integration' /\n"
    )
    low = solve(text, tmp_path, status=None, name="low")
    high = solve(text.replace("order=1", "order=25"), tmp_path, status=None, name="high")
    whole, part = read(high, "coefficients")[0, 0], read(low, "coefficients")[0, 0]
    left = np.linalg.norm(whole[2:]) / np.linalg.norm(whole[1:])
    assert left > 0.01
    np.testing.assert_allclose(read(low, "truncation_estimate")[0], left, rtol=0.02)
    assert read(low, "aliasing_estimate")[0] < 1e-3
    np.testing.assert_allclose(part, whole[:2], atol=1e-3)


@pytest.mark.parametrize(
    "structure, law",
    [
        ("n_dofs=1, mass=1.0, stiffness=1.0, damping=-0.1", "type='elastic_stop', dof='x1', stiffness=10.0, gap=0.5"),
        ("n_dofs=1, mass=1.0, stiffness=1.0, damping=-0.1", "type='cubic_spring', dof='x1', stiffness=0.1"),
    ],
)
def test_what_runs_away_is_not_called_damped(structure, law, tmp_path):
    """Alone, and with a given tone, so that it is not reported as a vanished tone."""
    alone = "&tones unknown=.true. /\n&harmonics order=7 /\n"
    beside = "&tones frequency=1.7, 1.0, unknown=.false., .true. /\n&harmonics order=3 /\n&load dof='x1', tuple=1, 0, cos=0.2 /\n"
    for tones in (alone, beside):
        result = solve(f"&structure type='matrices', {structure} /\n{tones}&law {law} /\n", tmp_path, status=None)
        message = bytes(read(result, "message")[0]).decode().strip("\0 ")
        assert "damped" not in message and "self-excited" in message and "without bound" in message, message
        assert read(result, "status")[0] == NO_MOTION
