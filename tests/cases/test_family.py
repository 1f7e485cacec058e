"""A hundred curves: the same bits on two ranks as on one, and after they were killed and resumed."""

import signal
import subprocess
import time

import h5py
import pytest

from program import ALL_CONVERGED, command, environment, read, run, solve
from curve_models import DUFFING, SOLUTION

FAMILY = (
    DUFFING
    + "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, points = 250 /\n"
    + "&sweep parameter = 'load(1)%cos', from = 0.01, to = 0.4, n = 100 /\n"
)
PENDING = 0


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    return solve(FAMILY, tmp_path_factory.mktemp("family"))


def assert_same_bits(a, b):
    names = [*SOLUTION, "tones_frequency"]
    for name, one, other in zip(names, read(a, *names), read(b, *names)):
        assert one.tobytes() == other.tobytes(), name


@pytest.mark.long
def test_a_hundred_curves_have_the_same_bits_on_two_ranks(family, tmp_path):
    assert_same_bits(family, solve(FAMILY, tmp_path, ranks=2))


@pytest.mark.long
def test_a_hundred_curves_killed_are_resumed_to_the_same_bits(family, tmp_path):
    (tmp_path / "family.nml").write_text(FAMILY + "&output title = 'killed' /\n")
    path = tmp_path / "family.h5"
    running = subprocess.Popen([*command("solve"), "family.nml", "--quiet"], cwd=tmp_path, env=environment())
    for _ in range(2000):
        time.sleep(0.02)
        if path.exists() and path.stat().st_size > 1_000_000:
            break
    time.sleep(1.0)
    running.send_signal(signal.SIGKILL)
    assert running.wait() == -signal.SIGKILL, "it had ended before"
    with h5py.File(path) as file:
        assert (file["status"][...] == PENDING).any()
    done = run("resume", path.name, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    assert_same_bits(family, path)
