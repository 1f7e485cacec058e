"""Sweeps in Python over threads, processes and ranks, and the functions and responses that they compute."""

from __future__ import annotations

import functools
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from in_process import DUFFING, cubic, duffing, same
from program import _ENVIRONMENT

import nhbm
from nhbm import Model


@pytest.mark.parametrize("warm", [False, True])
def test_functions_of_a_sweep_give_the_same_numbers_in_any_process(warm):
    """A response starts from the last motion of its model, which depends on who has computed the points before."""

    def response(model):
        return model.response("x1 (1)", tolerance=1e-3)

    values = {"load[0].cos": [0.1, 0.2], "spring.stiffness": [0.1, 0.3, 1.0, 2.0]}
    alone = duffing().sweep(values, of=response, warm=warm)["response"].values
    with ThreadPoolExecutor(2) as executor:
        np.testing.assert_array_equal(duffing().sweep(values, of=response, warm=warm, executor=executor)["response"].values, alone)
    one = {path: line[1:2] for path, line in values.items()}
    assert warm or duffing().sweep(one, of=response)["response"].values == alone[5]


def test_warm_starts_stay_on_the_branch():
    """With decreasing frequency the response of a hardening spring remains small at .9 of the range, with increasing frequency it
    is large."""
    model, found = Model.from_namelist(DUFFING.replace("damping_mass = 0.1", "damping_mass = 0.05")), []
    for values in (np.linspace(0.6, 1.6, 41), np.linspace(2.4, 1.6, 41)):
        line = model.sweep({"tones[0]": values}, order=7, warm=True)
        found.append(float(line.nhbm.amplitude("x1")[-1]))
    assert found[0] > 2 * found[1]


def test_numbers_of_a_sweep_are_named():
    for of, words in (("x1 (1)", "Amplitude of x1, harmonic 1"), ("x1", "Root mean square of x1")):
        found = duffing().sweep({"tones[0]": [0.6, 0.7]}, of=of, order=3)
        assert found["response"].attrs["long_name"] == words


def test_failed_responses_of_a_sweep_are_reported():
    model = duffing()
    model.set("solver", max_iterations=1, fallback=False)
    with pytest.warns(nhbm.NotConverged, match="of 2 points 2 out_of_budget") as warned:
        found = model.sweep({"tones[0]": [0.9, 1.0]}, of="x1 (1)", order=3)
    assert len(warned) == 1 and np.isnan(found["response"]).all()
    assert found["status"].values.tolist() == 2 * ["out_of_budget"] and all(found["message"].values)


def test_failed_functions_of_a_sweep_are_reported():
    """A solution that does not converge, and an exception, have a status and a message beside what the function returns."""

    def of(model):
        if model["tones[0]"] == 0.8:
            raise ValueError("no root")
        return {"at": model["tones[0]"], "size": float(model.solve(order=3).nhbm.amplitude("x1"))}

    with pytest.warns(nhbm.NotConverged, match="of 3 points 1 failed. ValueError: no root"):
        found = duffing().sweep({"tones[0]": [0.7, 0.8, 0.9]}, of=of)
    assert found["status"].values.tolist() == ["converged", "failed", "converged"]
    assert found["message"].values.tolist() == ["", "ValueError: no root", ""]
    np.testing.assert_array_equal(found["at"], [0.7, np.nan, 0.9])
    assert np.isfinite(found["size"]).values.tolist() == [True, False, True]
    with pytest.raises(ValueError, match="no root"):  # what is wrong with every point is not reported after the last one
        duffing().sweep({"tones[0]": [0.8, 0.9]}, of=of)
    model = duffing()
    model.set("solver", max_iterations=1, fallback=False)
    peak = functools.partial(Model.peak, of="x1 (1)", path="tones[0]", start=0.5, stop=1.5, order=3)
    with pytest.warns(nhbm.NotConverged):
        found = model.sweep({"load[0].cos": [0.3, 0.4]}, of=peak)
    assert np.isnan(found["value"]).all() and "converged" not in found["status"].values and all(found["message"].values)
    assert duffing().sweep({"tones[0]": [0.7]}, of=lambda model: 1.0)["status"].values.tolist() == ["converged"]


@pytest.mark.long
def test_sweeps_are_spread_over_processes():
    model = duffing(spring=cubic)
    model.law(nhbm.law(cubic, odd=True), "x1", label="spring")
    values = {"load[0].cos": [0.1, 0.3], "tones[0]": np.linspace(0.6, 0.9, 4)}
    alone = model.sweep(values, order=5)
    assert alone.sizes["point"] == 8 and alone["load_1_cos"].values.tolist() == [0.1] * 4 + [0.3] * 4
    assert bool(alone.nhbm.is_converged.all())
    together = model.sweep(values, order=5, workers=2)
    same(together["coefficients"].values, alone["coefficients"].values, "coefficients")


def wait(model):
    time.sleep(60)
    return 1.0


def far_stop(model):
    """Warns of a stop that no motion reaches, and of something of its own."""
    warnings.warn("of the function", RuntimeWarning, stacklevel=1)
    return float(model.sweep({"tones[0]": [0.6, 0.7]}, of="x1 (1)", order=3)["response"].max())


@pytest.mark.parametrize("workers", [1, 2])
def test_functions_of_a_sweep_warn_once_for_all_points(workers):
    """Each worker warned at each point; warnings of others are left as they are."""
    model = duffing()
    model.law("elastic_stop", "x1", stiffness=0.5, gap=50.0, label="stop")
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        model.sweep({"load[0].cos": [0.1, 0.2, 0.3, 0.4]}, of=far_stop, workers=workers)
    assert sum(one.category is nhbm.Implausible and "no motion reaches" in str(one.message) for one in heard) == 1
    assert workers > 1 or sum(one.category is RuntimeWarning for one in heard) == 4  # of processes on their standard error


def test_an_interrupt_ends_the_processes_of_a_sweep():
    """They ended what they had begun, and what was left: minutes."""
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGINT)).start()
        duffing().sweep({"load[0].cos": [0.1, 0.2, 0.3, 0.4]}, order=3, of=wait, workers=2)
    assert time.monotonic() - started < 40 and not multiprocessing.active_children()


def test_what_cannot_be_sent_to_processes_is_named():
    def local(q):
        return q**3

    model = duffing(spring=cubic)
    model.law(nhbm.law(local, odd=True), "x1", label="spring")
    with pytest.raises(nhbm.ModelError, match=r"processes of `workers` cannot be sent.*local.*top level of a module"):
        model.sweep({"load[0].cos": [0.1, 0.3]}, order=5, workers=2)
    assert model.sweep({"load[0].cos": [0.1, 0.3]}, order=5).sizes["point"] == 2


def test_sweeps_are_spread_over_ranks(tmp_path):
    """Each rank has the whole dataset, with the same bits as one process."""
    pytest.importorskip("mpi4py")
    (tmp_path / "ranks.py").write_text(
        "import numpy as np\nfrom mpi4py import MPI\nfrom in_process import duffing\n"
        "found = duffing().sweep({'tones[0]': np.linspace(0.6, 0.9, 5)}, order=5, comm=MPI.COMM_WORLD)\n"
        "np.save(f'rank_{MPI.COMM_WORLD.Get_rank()}.npy', found['coefficients'].values)\n"
    )
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    command = [os.environ.get("MPIEXEC", "mpirun"), "-n", "2", sys.executable, "ranks.py"]
    subprocess.run(command, cwd=tmp_path, env={**os.environ, **_ENVIRONMENT, "PYTHONPATH": path}, check=True, timeout=600)
    alone = duffing().sweep({"tones[0]": np.linspace(0.6, 0.9, 5)}, order=5)["coefficients"].values
    for rank in range(2):
        assert np.array_equal(np.load(tmp_path / f"rank_{rank}.npy"), alone)
