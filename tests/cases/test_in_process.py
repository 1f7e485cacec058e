"""The shared library from Python: the bits of the command, threads and interrupts, no leaks."""

from __future__ import annotations

import ctypes
import inspect
import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time

import h5py
import numpy as np
import pytest

from in_process import DUFFING, ROOT, STOP, same, session_of
from program import ALL_CONVERGED, run

import nhbm
from nhbm import Model, ModelError

CURVE = "&curve parameter = 'tones%frequency', from = 0.6, to = 2.2, max_step = 0.2, peak_of = 'x1 (1)' /\n"
IMPACTS = """&structure type = 'matrices', n_dofs = 1, mass = 0.5, damping = 0.3, stiffness = 50 /
&tones frequency = 20.1 /
&load dof = 'x1', tuple = 1, cos = 6 /
&law type = 'rigid_wall', dof = 'x1', gap = 0.02, restitution = 0.5 /
"""
SECONDS = "setup_seconds", "iteration_seconds", "error_estimate_seconds", "solve_seconds"


@pytest.mark.parametrize("text", [DUFFING, STOP, STOP + "&harmonics order = 9 /\n"], ids=["tolerance", "stop", "order"])
def test_points_have_the_bits_of_the_command(text, tmp_path):
    (tmp_path / "point.nml").write_text(text)
    assert run("solve", "point.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    session = session_of(text)
    session.solve()
    with h5py.File(tmp_path / "point.h5") as file:
        compared = [name for name in session.columns() if name in file and name not in (*SECONDS, "message", "rank")]
        for name in compared:
            column = session.column(name)
            if column.values is not None:
                same(column.values, file[name][0], name)
                assert column.attributes()["units"] == file[name].attrs["units"]
                assert column.attributes()["long_name"] == file[name].attrs["long_name"] or name.startswith("combination")
        for axis in ("dof", "law_dof", "law"):
            assert session.labels(axis) == list(file[axis].asstr()[()])
    motion = Model.from_namelist(text).solve()
    known = {name for name in compared if session.column(name).values is not None} - {"tuples", "is_stable"}
    assert set(motion.variables) | set(motion.nhbm.details.variables) >= known | {"stability"}
    assert {"coefficients", "truncation_estimate", "is_stable", "multiplier_real", "power_in"} <= set(compared)


def test_curves_have_the_bits_of_the_command(tmp_path):
    (tmp_path / "curve.nml").write_text(DUFFING + CURVE)
    assert run("solve", "curve.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    curve = Model.from_namelist(DUFFING).curve("tones.frequency", 0.6, 2.2, max_step=0.2, peak_of="x1 (1)")
    with h5py.File(tmp_path / "curve.h5") as file:
        n = np.count_nonzero(file["curve_kind"][()])
        assert curve.sizes["point"] == n
        for name in ("coefficients", "tones_frequency", "multiplier_real", "curve_unknowns", "curve_step", "residual"):
            column = (curve if name in curve.variables else curve.nhbm.details)[name].values
            same(column, file[name][:n][tuple(slice(k) for k in column.shape)], name)
    opened = nhbm.open_dataset(tmp_path / "curve.h5")
    for name in ("status", "stability", "curve_kind"):
        assert opened[name].values.tolist() == curve[name].values.tolist()
    kinds = curve["curve_kind"].values.tolist()
    assert kinds.count("fold") == 2 and kinds.count("peak") == 1
    some = Model.from_namelist(DUFFING).curve(
        "tones.frequency", 0.6, 2.2, on_point=lambda point: float(point["tones_frequency"]) > 0.7
    )
    assert float(some["tones_frequency"][:-1].max()) <= 0.7 < float(some["tones_frequency"][-1])


def verdicts(data):
    """Stability as numbers, as in a file."""
    return np.vectorize({"stable": 1, "unstable": -1, "unknown": 0}.get)(data["stability"].values)


def test_a_curve_that_fails_is_that_of_the_command(tmp_path):
    """Its row has the reason: a point that cannot be computed is no error of the caller."""
    resonant = (
        "&structure type='matrices', n_dofs=2, mass=1, 1, stiffness=2, -1, -1, 1 /\n&tones frequency=1.0 /\n&harmonics order=3 /\n"
        "&load dof='x1', tuple=1, cos=1 /\n&law type='cubic_spring', dof='x1', stiffness=0.1 /\n"
    )
    (tmp_path / "curve.nml").write_text(resonant + CURVE.replace("0.6", "1.0"))
    assert run("solve", "curve.nml", "--quiet", cwd=tmp_path).status == 4
    with pytest.warns(nhbm.NotConverged, match="failed: dynamic stiffness"):
        curve = Model.from_namelist(resonant).curve("tones.frequency", 1.0, 2.2, max_step=0.2, peak_of="x1 (1)")
    opened = nhbm.open_dataset(tmp_path / "curve.h5")
    assert curve["status"].values.tolist() == opened["status"].values.tolist() == ["failed"]
    assert curve["message"].values.tolist() == opened["message"].values.tolist()
    assert curve["tones_frequency"].values.tolist() == opened["tones_frequency"].values.tolist() == [1.0]


def test_stability_is_known_where_the_command_knows_it(tmp_path):
    """For tori: a point, the points of a sweep, cold and warm, and those of a curve."""
    text = (DUFFING.replace("= 0.9 /", "= 0.9, 1.3 /").replace("tuple = 1, cos = 0.3", "tuple = 1, 0, cos = 0.1")
            + "&harmonics order = 3 /\n&load dof = 'x1', tuple = 0, 1, cos = 0.1 /\n")  # fmt: skip
    sweep = "&sweep parameter = 'tones%frequency(1)', from = 0.9, to = 1.0, n = 20 /\n"
    curve = "&curve parameter = 'tones%frequency(1)', from = 0.9, to = 0.92, points = 9 /\n"
    values, found = {"tones[0]": np.linspace(0.9, 1.0, 20)}, {}
    for name, more in (("point", ""), ("sweep", sweep), ("curve", curve)):
        (tmp_path / f"{name}.nml").write_text(text + more)
        run("solve", f"{name}.nml", "--quiet", cwd=tmp_path)
        with h5py.File(tmp_path / f"{name}.h5") as file:
            found[name] = file["is_stable"][()]
    model = Model.from_namelist(text)
    assert verdicts(model.solve()) == found["point"][0] == 1
    assert np.array_equal(verdicts(model.sweep(values)), found["sweep"])
    assert np.array_equal(verdicts(model.sweep(values, warm=True)), found["sweep"])
    followed = verdicts(model.curve("tones[0]", 0.9, 0.92, points=9))
    assert np.array_equal(followed, found["curve"][: followed.size])


def long_solution(more=""):
    """A model that takes many seconds."""
    laws = "".join(f"&law type = 'jenkins', dof = 'x{i}', stiffness = 5.0, limit = 0.1 /\n" for i in range(1, 9))
    return Model.from_namelist(
        "&structure type = 'chain', n_masses = 8, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.01 /\n"
        "&tones frequency = 0.7, 1.13 /\n&harmonics order = 14 /\n"
        "&load dof = 'x1', tuple = 1, 0, cos = 1.0 /\n&load dof = 'x1', tuple = 0, 1, cos = 1.0 /\n" + laws + more
    )


def test_an_interrupt_ends_a_solution():
    """Ctrl-C ends a long solution within a second, and the model remains usable."""
    model = long_solution()
    with pytest.raises(KeyboardInterrupt):
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        started = time.process_time()
        model.solve()
    assert time.process_time() - started < 3.0


def test_other_threads_go_on_during_a_solution(monkeypatch):
    """The lock of the interpreter is released while the library works, not only where it looks for interrupts."""
    solve, within, looks, pauses = nhbm.Session.solve, [], [], []

    class Counted(nhbm.session._Interrupts):
        @property
        def is_noted(self):
            looks.append(None)
            return False

        @is_noted.setter
        def is_noted(self, value):
            pass

    def timed(*arguments, **keys):
        within.append(time.monotonic())
        found = solve(*arguments, **keys)
        within.append(time.monotonic())
        return found

    monkeypatch.setattr(nhbm.session, "_Interrupts", Counted)
    monkeypatch.setattr(nhbm.Session, "solve", timed)
    thread = threading.Thread(target=long_solution("&solver time_limit = 0.5 /\n").solve)
    with pytest.warns(nhbm.NotConverged):
        thread.start()
        while thread.is_alive():
            time.sleep(0.001)
            pauses.append(time.monotonic())
        thread.join()
    assert sum(within[0] < moment < within[1] for moment in pauses) > 2 * len(looks)


def test_threads_with_a_model_each_do_not_meet():
    def sweep(text, found):
        session = session_of(text)
        frequency = session.parameter("tones%frequency")
        for value in np.linspace(0.5, 1.4, 30):
            session.set_parameter(frequency, value)
            session.solve(warm=True)
            found.append(session.column("coefficients").values.tobytes())

    texts = [text + "&harmonics order = 9 /\n" for text in (DUFFING, STOP)]
    alone, together = [[], []], [[], []]
    for text, found in zip(texts, alone):
        sweep(text, found)
    threads = [threading.Thread(target=sweep, args=pair) for pair in zip(texts, together)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone


def test_solved_models_leave_nothing_behind():
    def make(n):
        for _ in range(n):
            session_of(DUFFING + "&harmonics order = 3 /\n").solve()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    make(50)
    before = make(50)
    assert make(500) - before < 4000  # KiB


class _Heap(ctypes.Structure):
    """struct mallinfo2 of the GNU C library."""

    _fields_ = [(name, ctypes.c_size_t) for name in "a b c d e f g in_use h i".split()]


@pytest.mark.long
@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="the C library does not count what is in use")
def test_curves_leave_nothing_behind():
    """Each point left its unknowns, later each curve the loads of its set and grids of its products."""
    of_heap = ctypes.CDLL(None).mallinfo2
    of_heap.restype = _Heap
    session = session_of(DUFFING + CURVE)

    def curve():
        session.begin_curve()
        return sum(1 for _ in iter(session.next, False))

    def growth():
        before = of_heap().in_use
        for _ in range(10):
            curve()
        return (of_heap().in_use - before) / 10

    n_points = [curve() for _ in range(5)][-1]
    assert min(growth() for _ in range(6)) < 4 * n_points  # what is left adds to each; the interpreter's own comes and goes


def test_an_interrupt_as_a_call_begins_hides_no_later_one(monkeypatch):
    """It left a call in progress for ever: later interrupts ended curves without an exception."""
    interrupts = nhbm.session._Interrupts()

    def come(number, handler):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(nhbm.session, "_signal", come)
        with pytest.raises(KeyboardInterrupt):
            interrupts.__enter__()
    with pytest.raises(KeyboardInterrupt):
        with interrupts:
            signal.raise_signal(signal.SIGINT)
    assert not interrupts.is_noted


@pytest.mark.parametrize("seconds", [1.0, pytest.param(10.0, marks=pytest.mark.long)])
def test_an_interrupt_of_a_curve_is_never_another_error(seconds):
    """NumPy lost one that came while it converted a tuple."""
    model = Model.from_namelist(DUFFING)
    until = time.monotonic() + seconds
    before = signal.signal(signal.SIGALRM, lambda number, frame: signal.raise_signal(signal.SIGINT))
    wait = 2e-4
    while time.monotonic() < until:
        wait = 2e-4 + (1.37 * wait) % 0.02
        try:
            signal.setitimer(signal.ITIMER_REAL, wait)
            try:
                model.peak("x1 (1)", "tones[0]", 0.5, 2.0, order=5)
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
        except KeyboardInterrupt:
            pass
    signal.signal(signal.SIGALRM, before)


def test_no_argument_of_the_library_is_converted_by_python_code():
    """An interrupt in such a conversion arrives as an ArgumentError."""
    assert nhbm._library.library()
    for name in re.findall(r"\b(nhbm_\w+)\(", (ROOT / "src" / "api" / "nhbm.h").read_text()):
        for kind in getattr(nhbm._library.library(), name).argtypes or ():
            assert not inspect.ismethod(kind.from_param), name


@pytest.mark.parametrize("n", [pytest.param(n, marks=pytest.mark.long) for n in (3000, 100_000)])
def test_models_leave_nothing_behind(n):
    """Read and deleted, every tenth solved: less than 200 bytes each."""

    def make(n):
        for k in range(n):
            session = session_of(DUFFING + "&harmonics order = 3 /\n&stability method = 'off' /\n")
            if k % 10 == 0:
                session.solve()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    make(500)
    before = make(500)
    assert make(n) - before < max(n / 25, 600)  # KiB


@pytest.mark.parametrize("text", [DUFFING, STOP + "&harmonics order = 9 /\n"], ids=["tolerance", "order"])
def test_time_integration_has_the_bits_of_the_command(text, tmp_path):
    integration = "&integration duration = 20.0, transient = 5.0, n_peaks = 1 /\n"
    (tmp_path / "run.nml").write_text(text + integration)
    assert run("integrate", "run.nml", "-o", "record.h5", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    assert run("solve", "run.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    assert run("verify", "run.h5", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    record = Model.from_namelist(text).integrate(20.0, transient=5.0, n_peaks=1)
    with h5py.File(tmp_path / "record.h5") as file:
        for name in set(record.data_vars) - {"cpu_seconds"}:
            assert np.array_equal(record[name].values, file[name][()].reshape(record[name].shape)), name
        assert {"displacement", "velocity", "force", "coefficients", "peak_frequency", "state_velocity"} <= set(record.data_vars)
        assert record["law_coordinate"].values.tolist() == list(file["law_coordinate"].asstr()[()])
    model = Model.from_namelist(text)
    motion = model.solve()
    verdict = model.verify(motion)
    with h5py.File(tmp_path / "run.h5") as file:
        for name in set(verdict.data_vars) - {"integration_verdict"}:
            assert np.array_equal(verdict[name].values, file[name][0]), name
    assert verdict["integration_verdict"] == "agrees"
    assert model.verify(motion.assign(coefficients=2 * motion["coefficients"]))["integration_verdict"] == "differs"
    with pytest.raises(ModelError, match="duration"):
        model.integrate()
    assert model.verify()["integration_verdict"] == "agrees"  # of the motion still
    with pytest.raises(ModelError, match="no motion of `solve` that can be verified"):
        Model.from_namelist(text).verify()


@pytest.mark.filterwarnings("ignore::nhbm.NotConverged")  # found by time integration
def test_a_motion_with_impacts_is_verified_as_by_the_command(tmp_path):
    (tmp_path / "run.nml").write_text(IMPACTS)
    assert run("solve", "run.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    assert run("verify", "run.h5", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    model = Model.from_namelist(IMPACTS)
    model.solve()
    verdict = model.verify()
    with h5py.File(tmp_path / "run.h5") as file:
        for name in set(verdict.data_vars) - {"integration_verdict"}:
            assert np.array_equal(verdict[name].values, file[name][0]), name
    assert verdict["integration_verdict"] == "agrees"


def test_a_motion_with_impacts_has_derivatives():
    """Those of two motions beside it."""

    def gradient(gap):
        model = Model.from_namelist(IMPACTS)
        model["law[0].gap"] = gap
        with pytest.warns(nhbm.NotConverged, match="integrated") as said:
            found = model.gradient("x1 (1)", ["law[0].gap"])
        assert not any("no derivatives" in str(warning.message) for warning in said)
        return found

    sides = [gradient(0.02 + step).value for step in (-1e-5, 1e-5)]
    assert gradient(0.02).slopes[0] == pytest.approx((sides[1] - sides[0]) / 2e-5, rel=1e-5)


def test_a_motion_by_integration_alone_has_no_derivatives():
    text = STOP + "&solver primary_method = 'integration' /\n"
    with pytest.warns(nhbm.NotConverged, match="no derivatives of this motion: time integration over"):
        value, slopes = Model.from_namelist(text).gradient("x1 (1)", ["law[0].gap"])
    assert value > 0.02 and np.isnan(slopes).all()


SCRIPT = """
import numpy as np, nhbm
{law}
mass = nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1)
model = nhbm.Model(mass, tones=[2.0])
model.load("x1", 1, cos=0.1)
{use}
print("points", model.sweep({{"tones[0]": np.linspace(2.0, 3.0, 4)}}, workers=2).sizes["point"])
"""
OWN_LAW = "@nhbm.law\ndef force(q, v):\n    return q**3\n"


@pytest.mark.long
def test_a_script_needs_no_guard_for_its_processes(tmp_path):
    """Otherwise each process would run the script again, up to the sweep for which it is created."""
    path = tmp_path / "script.py"
    path.write_text(SCRIPT.format(law="", use="model.law('cubic_spring', 'x1', stiffness=1.0)"))
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=600)
    assert done.stdout == "points 4\n", done.stderr


@pytest.mark.long
def test_a_script_with_laws_of_its_own_is_warned_of_its_guard(tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT.format(law=OWN_LAW, use="model.law(force, 'x1')"))
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=600)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("nhbm.errors.ModelError: a process of the sweep has ended"), done.stderr
    assert '__name__ == "__main__":' in done.stderr
