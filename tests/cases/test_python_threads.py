"""One model or session in several threads, and laws that call their own model: answered one after the other, or refused."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from in_process import cubic, duffing

import nhbm


def in_threads(work, n=4):
    """Runs a function in threads at once; returns what it returned or raised in each."""
    found = [None] * n
    start = threading.Barrier(n)

    def run(k):
        start.wait()
        try:
            found[k] = work()
        except Exception as error:
            found[k] = error

    threads = [threading.Thread(target=run, args=(k,)) for k in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def test_threads_with_one_model_wait_for_each_other():
    model, alone = duffing(), duffing().curve("tones[0]", 0.5, 1.5, order=5, max_step=0.2)
    for curve in in_threads(lambda: model.curve("tones[0]", 0.5, 1.5, order=5, max_step=0.2)):
        np.testing.assert_array_equal(curve["coefficients"], alone["coefficients"])
    expected = duffing().solve(order=5)["coefficients"]
    for motion in in_threads(lambda: [model.solve(order=5), model.response("x1", order=5), model.to_namelist()][0]):
        np.testing.assert_array_equal(motion["coefficients"], expected)


def test_the_threads_of_blas_remain_those_of_the_program():
    """nhbm computes with one, NumPy may use the same library."""
    duffing().solve(order=3)  # loads it
    blas = _blas_of_this_process() if os.path.exists("/proc/self/maps") else None
    if blas is None:
        pytest.skip("no OpenBLAS beside that of NumPy")
    before = blas.openblas_get_num_threads()
    try:
        for n in (1, 2):
            blas.openblas_set_num_threads(n)
            duffing().solve(order=5)
            assert blas.openblas_get_num_threads() == n
    finally:
        blas.openblas_set_num_threads(before)


def _blas_of_this_process():
    with open("/proc/self/maps", encoding="utf-8") as maps:
        files = {line.split()[-1] for line in maps if "blas" in line}
    for file in sorted(files):
        library = ctypes.CDLL(file)
        if hasattr(library, "openblas_get_num_threads"):
            return library
    return None


SWEEP = """
import numpy as np
import nhbm

if __name__ == "__main__":
    model = nhbm.Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0, damping_mass=0.05, ends="fixed"), tones=[0.9])
    model.load("x1", 1, cos=0.3)
    model.law("elastic_stop", "x2", stiffness=10.0, gap=0.5, label="s")
    model.sweep({"tones[0]": np.linspace(0.5, 2.0, 320)}, order=25, workers=2, progress=lambda n: print(n, flush=True))
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="a system without signals")
def test_workers_end_with_a_killed_process(tmp_path):
    (tmp_path / "sweep.py").write_text(SWEEP)
    process = subprocess.Popen([sys.executable, "sweep.py"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    process.stdout.readline()  # the workers solve
    process.kill()
    process.stdout.read()  # returns when none of them has it any more
    process.wait()
    assert process.returncode == -signal.SIGKILL


def test_threads_with_one_session_are_refused():
    begun, refused = threading.Event(), threading.Event()

    def waiting(q):
        begun.set()
        refused.wait(60)
        return cubic(q)

    model = duffing(spring=cubic)
    model.law(waiting, "x1")
    session = nhbm.Session()
    session.read(model.to_namelist())
    thread = threading.Thread(target=session.solve)
    thread.start()
    assert begun.wait(60)
    for call in (session.solve, session.columns, session.integrate, lambda: session.column("status"),
                 lambda: session.set("tones%frequency", 1.0), session.begin_curve, session.next, session.verify):  # fmt: skip
        with pytest.raises(RuntimeError, match="in use by another thread"):
            call()
    refused.set()
    thread.join()
    assert session.column("status").values == 1


@pytest.mark.long
def test_a_law_cannot_call_its_own_model():
    found = []

    def calling(q):
        try:
            session.solve()
        except RuntimeError as error:
            found.append(str(error))
        return cubic(q)

    model = duffing(spring=cubic)
    model.law(calling, "x1")
    session = nhbm.Session()
    session.read(model.to_namelist())
    session.solve()
    assert "callback" in found[0] and session.column("status").values == 1
    other, expected = (duffing().solve(order=order).nhbm.amplitude("x1") for order in (1, 5))

    def solving(q):  # another model may be solved
        assert float(duffing().solve(order=1).nhbm.amplitude("x1")) == float(other)
        return cubic(q)

    model = duffing(spring=cubic)
    model.law(solving, "x1")
    model.set("stability", method="off")
    np.testing.assert_allclose(model.solve(order=5).nhbm.amplitude("x1"), expected, rtol=1e-8)


def test_a_session_holds_its_laws():
    model = duffing(spring=cubic)
    model.law(lambda q: 0.5 * q**3, "x1")
    session = nhbm.Session()
    session.read(model.to_namelist())
    del model
    gc.collect()
    session.solve()
    assert session.column("status").values == 1
