"""The shared library from Python and from C: the numbers of the command, errors that help, nothing left behind."""

from __future__ import annotations

import ctypes
import doctest
import importlib
import os
import pickle
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy import LowLevelCallable

from program import _ENVIRONMENT, ALL_CONVERGED, run

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)
os.environ["NHBM_LIBRARY"] = str(LIBRARY)

import nhbm  # noqa: E402
from nhbm import Model, ModelError, Session  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
INCLUDES = [f"-I{ROOT / 'src' / folder}" for folder in ("api", "laws")]
DUFFING = """&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 0.9 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /
"""
STOP = DUFFING.replace("type = 'cubic_spring'", "type = 'elastic_stop', gap = 0.2").replace("= 0.5 /", "= 20.0 /")
CURVE = "&curve parameter = 'tones%frequency', from = 0.3, to = 3.0, peak_of = 'x1 (1)' /\n"
SECONDS = "setup_seconds", "iteration_seconds", "certificate_seconds", "solve_seconds"


def session_of(text):
    session = Session()
    session.read(text)
    return session


def same(ours, stored, name):
    """Whether a column has the bits of a row of a file, which is padded where points have sets of their own."""
    stored = stored[tuple(slice(n) for n in np.shape(ours))] if np.ndim(ours) else stored
    assert np.array_equal(ours, stored, equal_nan=True), name


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
                assert column.unit in (file[name].attrs["units"], "m", "N")
        for axis in ("dof", "law_dof", "law"):
            assert session.labels(axis) == list(file[axis].asstr()[()])
    motion = Model.from_namelist(text).solve()
    assert set(motion.data_vars) >= {name for name in compared if session.column(name).values is not None} - {"tuples"}
    assert {"coefficients", "truncation_estimate", "is_stable", "multiplier_real", "power_in"} <= set(compared)


def test_curves_have_the_bits_of_the_command(tmp_path):
    (tmp_path / "curve.nml").write_text(DUFFING + CURVE)
    assert run("solve", "curve.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    curve = Model.from_namelist(DUFFING).curve("tones.frequency", 0.3, 3.0, peak_of="x1 (1)")
    with h5py.File(tmp_path / "curve.h5") as file:
        n = np.count_nonzero(file["curve_kind"][()])
        assert curve.sizes["point"] == n
        for name in ("coefficients", "tones_frequency", "curve_kind", "curve_unknowns", "curve_step", "is_stable", "status"):
            stored = file[name][:n]
            same(curve[name].values, stored[tuple(slice(k) for k in curve[name].shape)], name)
    kinds = curve["curve_kind"].values.tolist()
    assert kinds.count(3) == 2 and kinds.count(4) == 1
    some = Model.from_namelist(DUFFING).curve(
        "tones.frequency", 0.3, 3.0, on_point=lambda point: float(point["tones_frequency"]) > 0.5
    )
    assert float(some["tones_frequency"][:-1].max()) <= 0.5 < float(some["tones_frequency"][-1])


def test_stability_is_known_where_the_command_knows_it(tmp_path):
    """Of tori: a point, the points of a sweep, cold and warm, and of a curve."""
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
    assert model.solve()["is_stable"] == found["point"][0] == 1
    assert np.array_equal(model.sweep(values)["is_stable"], found["sweep"])
    assert np.array_equal(model.sweep(values, warm=True)["is_stable"], found["sweep"])
    followed = model.curve("tones[0]", 0.9, 0.92, points=9)["is_stable"]
    assert np.array_equal(followed, found["curve"][: followed.size])


def test_values_are_set_by_path_and_by_handle():
    other = Model.from_namelist(DUFFING.replace("stiffness = 0.5", "stiffness = 0.7").replace("= 0.9 /", "= 1.1 /"))
    for spring, tone in (
        ("spring.stiffness", "tones[0]"),
        ("law[0].stiffness", "tones.frequency"),
        ("law(1)%stiffness", "tones%frequency(1)"),
    ):
        model = Model.from_namelist(DUFFING)
        model[spring] = 0.7
        model[tone] = 1.1
        np.testing.assert_array_equal(model.solve()["coefficients"], other.solve()["coefficients"])
        assert "stiffness = 0.7" in " ".join(model.to_namelist().split())


def test_inputs_go_both_ways():
    """The complete input of a model gives the same model, with values set since and laws of Python; &sweep of a file is left out."""
    model = duffing(spring=cubic)
    model.law(cubic, "x1")
    model["tones[0]"] = 0.95
    text = model.to_namelist()
    again = Model.from_namelist(text)
    assert "frequency = 0.95" in text and again.to_namelist() == text
    same(again.solve(order=5)["coefficients"].values, model.solve(order=5)["coefficients"].values, "coefficients")
    for path in ("gallery/duffing_response.nml", "paper/wall.nml", "autonomous/van_der_pol.nml", "rotor_stator/rotating.nml"):
        text = Model.from_file(ROOT / "inputs" / path).to_namelist()
        again = Model.from_namelist(text, (ROOT / "inputs" / path).parent).to_namelist()
        assert sorted(again.splitlines()) == sorted(text.splitlines())


def test_warm_starts_stay_on_the_branch():
    """Downwards the response of a hardening spring stays small at .9 of the way up, upwards large."""
    model, found = Model.from_namelist(DUFFING.replace("damping_mass = 0.1", "damping_mass = 0.05")), []
    for values in (np.linspace(0.6, 1.6, 41), np.linspace(2.4, 1.6, 41)):
        line = model.sweep({"tones[0]": values}, order=7, warm=True)
        found.append(float(line.nhbm.amplitude("x1")[-1]))
    assert found[0] > 2 * found[1]


def test_what_is_wrong_is_said():
    with pytest.raises(ModelError, match="type = 'chian' is not known; did you mean 'chain'"):
        Model.from_namelist(DUFFING.replace("chain", "chian"))
    model = Model.from_namelist(DUFFING)
    with pytest.raises(ModelError, match="'law.stop.%gap'.*spring"):
        model["stop.gap"] = 0.1
    with pytest.raises(ModelError, match="unknown group 'harmonic'; known: structure, tones"):
        model.set("harmonic", order=3)
    with pytest.raises(ModelError, match="'wall gap!' is no path"):
        model["wall gap!"] = 1.0
    with pytest.raises(KeyError, match="no column 'amplitude'; known: status message"):
        session_of(DUFFING).column("amplitude")
    model["tones%frequency"] = -1.0
    with pytest.raises(ModelError, match="frequency"):
        model.solve()
    model["tones%frequency"] = 0.9
    motion = model.solve()
    assert motion.nhbm.is_converged and motion.nhbm.message == ""
    with pytest.raises(KeyError, match="no dof 'x2'; known: x1"):
        motion.nhbm.amplitude("x2")
    with pytest.raises(ModelError, match="curve"):
        session_of(DUFFING).begin_curve()
    with pytest.warns(nhbm.NotConverged, match="budget|iterations|residual"):
        Model.from_namelist(DUFFING + "&solver max_iterations = 1, fallback = .false. /\n").solve(order=7)


def long_solution(more=""):
    """A model that takes many seconds."""
    laws = "".join(f"&law type = 'jenkins', dof = 'x{i}', stiffness = 5.0, limit = 0.1 /\n" for i in range(1, 9))
    return Model.from_namelist(
        "&structure type = 'chain', n_masses = 8, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.01 /\n"
        "&tones frequency = 0.7, 1.13 /\n&harmonics order = 14 /\n"
        "&load dof = 'x1', tuple = 1, 0, cos = 1.0 /\n&load dof = 'x1', tuple = 0, 1, cos = 1.0 /\n" + laws + more
    )


def test_an_interrupt_ends_a_solution():
    """Ctrl-C ends a long solution within a second, and the model goes on."""
    model = long_solution()
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        model.solve()
    assert time.monotonic() - started < 3.0


def test_other_threads_go_on_during_a_solution():
    """The lock of the interpreter is released while the library is at work."""
    model, pauses = long_solution("&solver time_limit = 0.5 /\n"), 0
    thread = threading.Thread(target=model.solve)
    with pytest.warns(nhbm.NotConverged):
        thread.start()
        while thread.is_alive():
            time.sleep(0.005)
            pauses += 1
        thread.join()
    assert pauses > 20


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


def test_models_leave_nothing_behind():
    def make(n):
        for _ in range(n):
            session_of(DUFFING + "&harmonics order = 3 /\n").solve()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    make(50)
    before = make(50)
    assert make(500) - before < 4000  # KiB


@pytest.mark.long
def test_a_hundred_thousand_models_leave_nothing_behind():
    """Read and dropped, every tenth solved."""

    def make(n):
        for k in range(n):
            session = session_of(DUFFING + "&harmonics order = 3 /\n&stability method = 'off' /\n")
            if k % 10 == 0:
                session.solve()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    make(1000)
    before = make(1000)
    assert make(100000) - before < 4000  # KiB


def test_programs_of_an_earlier_header_run(tmp_path):
    """The headers in abi/ are those of the first program that was built with this version of the interface: it runs, and its law does."""
    headers = ROOT / "tests" / "cases" / "abi"
    version = [
        re.search(r"#define NHBM_API (\d+)", (folder / "nhbm.h").read_text())[1] for folder in (headers, ROOT / "src" / "api")
    ]
    assert version[0] == version[1], "programs must be compiled anew: copy nhbm.h and nhbm_user_law.h to tests/cases/abi"
    compiler = [shutil.which("cc"), f"-I{headers}"]
    example = ROOT / "drivers" / "examples" / "duffing.c"
    subprocess.run([*compiler, example, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}", "-o", "duffing"], cwd=tmp_path, check=True)
    done = subprocess.run(["./duffing"], cwd=tmp_path, capture_output=True, text=True, check=True)
    session = session_of(DUFFING)
    session.set("tones%frequency", 0.5)
    session.solve()
    assert float(done.stdout.split()[1]) == session.column("coefficients").values[0, 1, 0]
    law = ROOT / "inputs" / "user_law" / "friction.c"
    subprocess.run([*compiler, "-shared", "-fPIC", law, "-o", "friction.so", "-lm"], cwd=tmp_path, check=True)
    slider = "dof = 'x1', {} /\n"
    texts = [FRICTION + "&law " + slider.format(keys) for keys in ("type = 'jenkins', stiffness = 2.0, limit = 0.2",
             "type = 'user', library = 'friction.so', name = 'friction', parameters = 2.0, 0.2, odd = .true.")]  # fmt: skip
    found = [Model.from_namelist(text, tmp_path).solve()["coefficients"].values for text in texts]
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-10)


def test_programs_in_c_and_fortran_have_the_same_numbers(tmp_path):
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    source = ROOT / "drivers" / "examples" / "duffing.c"
    program = tmp_path / "duffing"
    command = [compiler, "-Wall", "-Werror", *INCLUDES, str(source), str(LIBRARY), "-o", str(program)]
    subprocess.run([*command, f"-Wl,-rpath,{LIBRARY.parent}"], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    session, expected = session_of(DUFFING), []
    frequency = session.parameter("tones%frequency")
    for k in range(5):
        session.set_parameter(frequency, 0.5 + 0.25 * k)
        session.solve(warm=k > 0)
        expected.append(session.column("coefficients").values[0, 1, 0])
    assert [float(line.split()[1]) for line in done.stdout.splitlines()] == expected
    in_fortran = subprocess.run([LIBRARY.parents[1] / "drivers" / "duffing_in_fortran"], capture_output=True, text=True, check=True)
    assert [float(line.split()[1]) for line in in_fortran.stdout.splitlines()] == expected
    by_phase = subprocess.run([LIBRARY.parents[1] / "drivers" / "force_by_phase"], capture_output=True, text=True, check=True)
    np.testing.assert_allclose(
        float(by_phase.stdout), duffing().solve()["coefficients"].values[0, 1, 0], rtol=1e-6
    )  # sets by tolerance


@pytest.mark.long
def test_valgrind_finds_nothing_in_the_example_of_c(tmp_path):
    valgrind = shutil.which("valgrind") or pytest.skip("no valgrind")
    source = ROOT / "drivers" / "examples" / "duffing.c"
    subprocess.run(
        [shutil.which("cc"), *INCLUDES, source, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}", "-o", "duffing"], cwd=tmp_path, check=True
    )
    options = ["--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite,indirect,possible"]
    done = subprocess.run(
        [valgrind, *options, "./duffing"], cwd=tmp_path, capture_output=True, text=True, env={**os.environ, **_ENVIRONMENT}
    )
    assert done.returncode == 0, done.stderr


def duffing(**spring):
    model = Model(
        nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1), tones=[0.9]
    )
    model.load("x1", 1, cos=0.3)
    if not spring:
        model.law("cubic_spring", "x1", label="spring", stiffness=0.5)
    return model


def test_models_are_made_of_values():
    same(duffing().solve()["coefficients"].values, Model.from_namelist(DUFFING).solve()["coefficients"].values, "coefficients")
    wall = Model(
        nhbm.Beam(length=1.0, bending_stiffness=1750.0, mass_per_length=7.8, n_elements=4, damping_diagonal=1.0),
        tones=[np.e, np.pi],
    )
    wall.load("v3", (1, 0), cos=100)
    wall.load("v3", (0, 1), cos=100)
    wall.law("rigid_wall", "v3", gap=1.5e-3, label="wall")
    wall.set("certificate", penetration=0.1)
    motion = wall.solve(order=8)
    assert motion.nhbm.is_converged and motion["coefficients"].dims == ("dof", "harmonic", "component")
    first = motion.nhbm.harmonic("v3", (1, 0))
    assert complex(motion.nhbm.harmonic("v3", (-1, 0))) == complex(first).conjugate()
    times = np.linspace(0.0, 40.0, 500)
    direct = sum(c * np.cos(j @ [np.e, np.pi] * times) + s * np.sin(j @ [np.e, np.pi] * times)
                 for j, (c, s) in zip(motion["tuple"].values, motion["coefficients"].sel(dof="v3").values))  # fmt: skip
    np.testing.assert_allclose(motion.nhbm.time("v3", times), direct, atol=1e-12)


def test_structures_come_from_memory_and_from_files(tmp_path):
    """Matrices of SciPy, a model file and a chain of the solver's own give the same motion; sets and load vectors go along."""
    n = 3
    k = np.diag([2.0, 2.0, 2.0]) - np.diag([1.0, 1.0], 1) - np.diag([1.0, 1.0], -1)
    structure = nhbm.Structure(
        mass=np.eye(n), stiffness=k, damping=0.1 * np.eye(n), labels=["x1", "x2", "x3"], node_numbers=np.arange(1, 4),
        coordinates=np.zeros((3, 3)), dof_node=np.arange(3), dof_direction=["x"] * 3, sets={"tip": np.array([2])},
        loads={"push": (np.array([0]), np.array([2.0]))},
    )  # fmt: skip
    structure.write(tmp_path / "chain.h5")
    found = []
    for source in (structure, tmp_path / "chain.h5", nhbm.Matrices(np.eye(n), k, 0.1 * np.eye(n))):
        is_builder = isinstance(source, nhbm.Matrices)
        model = Model(source, tones=[0.7])
        if is_builder:
            model.load("x1", 1, cos=0.6)
        else:
            model.load(vector="push", cos=0.3)
        model.law("cubic_spring", "x3" if is_builder else "tip.x", stiffness=0.5)
        found.append(model.solve(order=7)["coefficients"].values)
    same(found[0], found[1], "coefficients")
    np.testing.assert_allclose(found[0], found[2], rtol=1e-12)
    with pytest.raises(ModelError, match="nowhere.h5.*does not exist"):
        Model(tmp_path / "nowhere.h5", tones=[1.0]).solve()


def dual_rotor():
    """Two shafts with speeds of their own, a bearing with clearance between them and a casing that the first disk may rub."""
    rotor = nhbm.Rotor()
    rotor.shaft(np.linspace(0, 1.6, 11), 0.06, name="low")
    rotor.shaft(np.linspace(0.5, 1.2, 8), 0.12, 0.09, name="high", speed=2)
    rotor.disk(0.16, 8.0, 0.1, 0.2, shaft="low")
    rotor.disk(0.7, 7.0, 0.08, 0.15, shaft="high")
    rotor.bearing(0.0, 2e7, 800.0, shaft="low")
    rotor.bearing(1.6, 2e7, 800.0, shaft="low")
    rotor.bearing(0.5, 3e7, 800.0, shaft="high")
    rotor.between(1.2, "low", "high", 1e5, 200.0)
    rotor.unbalance(0.16, 1e-4, shaft="low")
    rotor.unbalance(0.7, 8e-5, shaft="high")
    model = Model(rotor.structure(), tones=[60.0, 71.5], harmonics={"order": 3})
    model.set("structure", speed=[60.0, 71.5], damping_stiffness=1e-5)
    for i, shaft in enumerate(("low", "high")):
        model.tie(f"structure%speed({i + 1})", f"tones%frequency({i + 1})")
        model.load(vector=f"unbalance_{shaft}_cos", tuple_=np.eye(2)[i], cos=1.0, frequency_power=2)
        model.load(vector=f"unbalance_{shaft}_sin", tuple_=np.eye(2)[i], sin=1.0, frequency_power=2)
    model.law("annular_clearance", ["inner1.x", "inner1.y", "outer1.x", "outer1.y"], label="bearing", stiffness=2e7, clearance=1e-5)
    return model


def test_rotors_turn_with_their_tones():
    """A curve over the speed of the first shaft, the second one in its ratio: its points are those of models at these speeds."""
    model = dual_rotor()
    curve = model.curve("tones%frequency(1)", 60.0, 60.2, tie="ratio")
    assert (curve["status"] == 1).all() and curve.sizes["point"] >= 3
    at = curve.isel(point=-1)
    speeds = at["frequency"].values
    assert speeds[1] / speeds[0] == pytest.approx(71.5 / 60.0, rel=1e-12)
    for i in range(2):
        model[f"tones%frequency({i + 1})"] = speeds[i]
    point = model.solve()
    assert np.allclose(point["coefficients"], at["coefficients"], rtol=1e-7, atol=1e-7 * float(abs(at["coefficients"]).max()))
    with pytest.raises(ModelError, match="follows 'tones%frequency'"):
        model.curve("structure%speed(1)", 60.0, 66.0)


def cubic(q):
    return 0.5 * q**3


def test_laws_are_functions_of_python(tmp_path):
    """Complex steps, differences, given derivatives and a compiled law find what the law of the catalogue does."""

    def with_derivatives(q, v, p):
        return p[0] * q**3, 3 * p[0] * q**2, np.zeros_like(v)

    def by_differences(q):
        return np.array([0.5 * x**3 for x in q.tolist()], dtype=float)

    (tmp_path / "law.c").write_text(
        '#include "nhbm_user_law.h"\n'
        "int cubic(const nhbm_law_samples_t *s) { for (int i = 0; i < s->n_samples; ++i) { s->f[i] = .5*s->z[i]*s->z[i]*s->z[i];\n"
        "if (s->df_dz) s->df_dz[i] = 1.5*s->z[i]*s->z[i]; } return 0; }\n")  # fmt: skip
    subprocess.run([shutil.which("cc"), *INCLUDES, "-shared", "-fPIC", tmp_path / "law.c", "-o", tmp_path / "law.so"], check=True)
    compiled = ctypes.CDLL(str(tmp_path / "law.so")).cubic
    compiled.restype, compiled.argtypes = ctypes.c_int, [ctypes.c_void_p]
    with_address = types.SimpleNamespace(address=ctypes.cast(compiled, ctypes.c_void_p).value)  # as Numba's cfunc has it
    expected = duffing().solve(order=9)["coefficients"].values
    laws = {"complex": (cubic, {}), "given": (with_derivatives, {"parameters": [0.5]}), "differences": (by_differences, {}),
            "compiled": (nhbm.Law(compiled, odd=True), {}), "scipy": (nhbm.Law(LowLevelCallable(compiled), odd=True), {}),
            "address": (nhbm.Law(with_address, odd=True), {})}  # fmt: skip
    for name, (law, keys) in laws.items():
        model = duffing(spring=law)
        model.law(law, "x1", **keys)
        found = model.solve(order=9)
        np.testing.assert_allclose(
            found["coefficients"].values, expected, atol=1e-9 if name != "differences" else 1e-7, err_msg=name
        )


def pushed(q, phases, frequencies):
    return -0.3 * np.cos(phases[:, 0]) - 0.1 * frequencies[0] ** 2 * np.sin(phases[:, 0]) + 0.0 * q


def test_laws_may_depend_on_phases_and_frequencies():
    """A force given by the phase is a load; its derivative by the frequency leads round folds as well; two tones."""
    forced = Model(
        nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1), tones=[0.9]
    )
    forced.law("cubic_spring", "x1", stiffness=0.5)
    forced.law(pushed, "x1")
    loaded = duffing()
    loaded.load("x1", 1, sin=0.1 * 0.9**2)
    a, b = loaded.solve(order=9), forced.solve(order=9)
    np.testing.assert_allclose(b["coefficients"].values, a["coefficients"].values, atol=1e-10)
    np.testing.assert_allclose(b["multiplier_real"].values, a["multiplier_real"].values, atol=1e-8)
    curve = forced.curve("tones[0]", 0.3, 3.0, order=9, peak_of="x1 (1)")
    kinds = curve["curve_kind"].values.tolist()
    assert kinds.count(3) == 2 and kinds.count(4) == 1 and bool((curve["status"] == 1).all())
    for k in (5, 15):  # before the fold a load of that frequency has no other motion
        loaded = duffing()
        loaded["tones[0]"] = omega = float(curve["tones_frequency_1"][k])
        loaded.load("x1", 1, sin=0.1 * omega**2)
        np.testing.assert_allclose(loaded.solve(order=9)["coefficients"], curve["coefficients"][k], atol=1e-8)

    def product(q, phases):
        return 0.2 * np.cos(phases[:, 0]) * np.cos(phases[:, 1]) * q - 0.1 * np.sin(phases[:, 1])

    two = Model(nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1),
                tones=[0.9, 0.9 * np.sqrt(3)])  # fmt: skip
    two.load("x1", (1, 0), cos=0.3)
    two.law(product, "x1")
    motion = two.solve(order=12)
    times = np.linspace(0.0, 30.0, 400)
    step = 1e-3
    x, x_up, x_down = (motion.nhbm.time("x1", times + shift).values for shift in (0.0, step, -step))
    tau = np.outer(times, [0.9, 0.9 * np.sqrt(3)])
    rest = (x_up - 2 * x + x_down) / step**2 + 0.1 * (x_up - x_down) / (2 * step) + x + product(x, tau) - 0.3 * np.cos(tau[:, 0])
    assert np.abs(rest).max() < 1e-5


FRICTION = (  # under a load that makes it slip and stick
    "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0, damping_mass = 0.05 /\n"
    "&tones frequency = 1.1 /\n&harmonics order = 15 /\n&load dof = 'x1', tuple = 1, cos = 0.5 /\n"
)


def turning_point(start, end, start_rate, end_rate):
    """Value of the cubic where it turns, as hb_slider has it."""
    a, b, c = 3 * (start_rate + end_rate - 2 * (end - start)), 2 * (3 * (end - start) - 2 * start_rate - end_rate), start_rate
    with np.errstate(all="ignore"):
        q = -0.5 * (b + np.where(b.real < 0, -1, 1) * np.sqrt(np.where((b * b - 4 * a * c).real > 0, b * b - 4 * a * c, 0)))
        x = np.where((abs(c) <= abs(q)) & ((c * q).real > 0), c / q, np.where((abs(q) <= abs(a)) & ((q * a).real > 0), q / a, 1))
    return (1 + 2 * x) * (1 - x) ** 2 * start + (3 - 2 * x) * x**2 * end + x * (1 - x) ** 2 * start_rate + (x - 1) * x**2 * end_rate


def slide(states, step, p):
    half, w = p[1] / p[0], states
    w = np.clip(w, step.q_before - half, step.q_before + half)
    if np.any((step.rise * step.rise_before).real < 0):
        turn = turning_point(step.q_before, step.q, step.rise_before, step.rise)
        w = np.where((step.rise_before.real > 0) & (step.rise.real < 0), np.maximum(w, turn - half), w)
        w = np.where((step.rise_before.real < 0) & (step.rise.real > 0), np.minimum(w, turn + half), w)
    return np.clip(w, step.q - half, step.q + half)


@nhbm.law(states=1, advance=slide, odd=True)
def friction(q, p, states):
    return p[0] * (q - states)


@pytest.mark.parametrize("tones", [1, 2])
def test_laws_with_memory_are_the_one_of_the_catalogue(tones, tmp_path):
    """A slider in Python, in C and of the catalogue: the same motion to 1e-10; multipliers, which come from time integration without the
    events of the catalogue's, within their estimates."""
    shutil.copy(ROOT / "inputs" / "user_law" / "friction.c", tmp_path)
    subprocess.run(
        [shutil.which("cc"), *INCLUDES, "-shared", "-fPIC", "friction.c", "-o", "friction.so", "-lm"], cwd=tmp_path, check=True
    )
    text = (
        FRICTION
        if tones == 1
        else FRICTION.replace("1.1 /", "1.1, 1.9 /").replace("= 15", "= 5").replace("tuple = 1", "tuple = 1, 0")
    )
    expected = Model.from_namelist(text + "&law type = 'jenkins', dof = 'x1', stiffness = 2.0, limit = 0.2 /\n").solve()
    assert expected.nhbm.is_converged
    compiled = Model.from_namelist(text + "&law type = 'user', library = 'friction.so', name = 'friction', dof = 'x1', "
                                   "parameters = 2.0, 0.2, odd = .true. /\n", tmp_path)  # fmt: skip
    ours = Model.from_namelist(text)
    ours.law(friction, "x1", parameters=[2.0, 0.2])
    for model in (compiled, ours):
        motion = model.solve()
        np.testing.assert_allclose(motion["coefficients"].values, expected["coefficients"].values, rtol=0, atol=1e-10)
        assert motion["iterations"] == expected["iterations"]
    if tones == 1:
        compiled.set("stability", method="integration")
        motion = compiled.solve()
        assert motion["is_stable"] == expected["is_stable"] == 1
        np.testing.assert_allclose(motion["multiplier_real"][:2], expected["multiplier_real"][:2], atol=1e-4)
        check_derivatives_of_states(tmp_path / "friction.so")
    assert pickle.loads(pickle.dumps(friction)) is friction


def check_derivatives_of_states(compiled, n=300):
    """Random steps: the states of Python's function and of the C one, and all derivatives."""
    from nhbm import laws

    info = laws.LawInfo()
    ctypes.CDLL(str(compiled)).friction_info(ctypes.byref(info))
    names = "z", "z_before", "rise", "rise_before", "states_before"
    given = dict(zip(names, np.random.default_rng(1).normal(scale=0.1, size=(5, n)))) | {"parameters": np.array([2.0, 0.2])}
    found = []
    for address in (info.advance, ctypes.cast(friction._advance, ctypes.c_void_p).value):
        answer = {name: np.full(n, np.nan) for name in ("states", "ds_dbefore", *(f"ds_d{name}" for name in names[:4]))}
        arrays = {name: values.ctypes.data for name, values in {**given, **answer}.items()}
        step = laws.LawStep(n_samples=n, n_coordinates=1, n_states=1, stride=n, n_parameters=2, **arrays)
        assert laws.ADVANCE(address)(ctypes.byref(step)) == 0
        found.append(np.array(list(answer.values())))
    assert np.count_nonzero(found[0][1]) > n / 20 and np.count_nonzero(found[0][4]) > n / 20  # they stick, and turn within
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)


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
    with pytest.raises(ModelError, match="found last"):
        model.verify(motion.assign(coefficients=2 * motion["coefficients"]))
    with pytest.raises(ModelError, match="duration"):
        model.integrate()
    assert model.verify()["integration_verdict"] == "agrees"  # of the motion still
    with pytest.raises(ModelError, match="no motion that `solve` has found"):
        Model.from_namelist(text).verify()


def test_faults_of_laws_are_raised():
    def raises(q):
        raise RuntimeError("out of range")

    def wrong_shape(q):
        return np.zeros(3)

    def never_ends(q):
        while True:
            time.sleep(0.01)

    for law, fault, text in ((raises, RuntimeError, "out of range"), (wrong_shape, ModelError, "'wrong_shape' gives forces of shape"),
                             (lambda q, v, p, x: q, ModelError, "1 to 3 arguments"),
                             (lambda q: None, ModelError, "'<lambda>' gives forces that are None"),
                             (lambda q: 1j * q, ModelError, "gives forces that are complex"),
                             (lambda q: "much", ModelError, "gives forces that are no numbers"),
                             (lambda q: sys.exit(3), SystemExit, "3")):  # fmt: skip
        model = duffing(spring=law)
        with pytest.raises(fault, match=text):
            model.law(law, "x1")
            model.solve(order=3)
    for law in (lambda q: np.zeros(q.shape, dtype=int), lambda q: 0, lambda q: [0.0] * len(q)):  # taken as they are
        model = duffing(spring=True)
        model.law(law, "x1")
        np.testing.assert_allclose(
            model.solve(order=3)["coefficients"], duffing(spring=True).solve(order=3)["coefficients"], atol=1e-12
        )
    model = duffing(spring=True)
    model.law(lambda q: np.full_like(q, np.nan), "x1")
    with pytest.warns(nhbm.NotConverged, match="NaN"):
        model.solve(order=3)
    model = duffing(spring=True)
    model.law(never_ends, "x1")
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        model.solve(order=3)
    assert duffing().solve(order=3).nhbm.is_converged


def test_models_are_sent_with_their_values():
    """Pickled, with laws of Python and values set since; executors with `map`, that of Dask where it is there."""
    model = duffing(spring=True)
    model.law(nhbm.Law(cubic, odd=True), "x1")
    model["tones[0]"] = 0.8
    again = pickle.loads(pickle.dumps(model))
    same(again.solve(order=5)["coefficients"].values, model.solve(order=5)["coefficients"].values, "coefficients")
    values = {"tones[0]": np.linspace(0.6, 0.9, 4)}
    alone = model.sweep(values, order=5)["coefficients"].values
    with ThreadPoolExecutor(2) as executor:
        same(model.sweep(values, order=5, executor=executor)["coefficients"].values, alone, "coefficients")
    distributed = pytest.importorskip("distributed")
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        found = again.sweep(values, order=5, executor=client.get_executor())
    same(found["coefficients"].values, alone, "coefficients")


def test_progress_is_reported(monkeypatch):
    """To a function, or by a bar of tqdm, which need not be there."""
    counts, shown = [], []

    class Bar:
        def __init__(self, **keys):
            self.total = keys["total"]

        def update(self, n):
            shown.append(n)

        def close(self):
            shown.append(self.total)

    monkeypatch.setitem(sys.modules, "tqdm.auto", types.SimpleNamespace(tqdm=Bar))
    monkeypatch.setitem(sys.modules, "tqdm", types.SimpleNamespace(auto=sys.modules["tqdm.auto"]))
    for progress in (counts.append, True):
        duffing().sweep({"tones[0]": [0.6, 0.7, 0.8]}, order=3, progress=progress)
    assert counts == [1, 2, 3] and shown == [1, 1, 1, 3]
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    assert duffing().curve("tones[0]", 0.6, 0.7, order=3, progress=True).sizes["point"] > 1


@pytest.mark.parametrize("module", ["groups", "laws", "model", "session"])
def test_examples_of_docstrings(module):
    found = doctest.testmod(importlib.import_module(f"nhbm.{module}"), optionflags=doctest.ELLIPSIS)
    assert found.attempted > 0 and found.failed == 0


def test_sweeps_are_spread_over_processes():
    model = duffing(spring=cubic)
    model.law(nhbm.Law(cubic, odd=True), "x1", label="spring")
    values = {"load[0].cos": [0.1, 0.3], "tones[0]": np.linspace(0.6, 0.9, 4)}
    alone = model.sweep(values, order=5)
    assert alone.sizes["point"] == 8 and alone["load_1_cos"].values.tolist() == [0.1] * 4 + [0.3] * 4
    assert bool(alone.nhbm.is_converged.all())
    together = model.sweep(values, order=5, workers=2)
    same(together["coefficients"].values, alone["coefficients"].values, "coefficients")


def test_sweeps_are_spread_over_ranks(tmp_path):
    """Each rank has the whole dataset, with the bits of one process."""
    pytest.importorskip("mpi4py")
    (tmp_path / "ranks.py").write_text(
        "import numpy as np\nfrom mpi4py import MPI\nfrom test_in_process import duffing\n"
        "found = duffing().sweep({'tones[0]': np.linspace(0.6, 0.9, 5)}, order=5, comm=MPI.COMM_WORLD)\n"
        "np.save(f'rank_{MPI.COMM_WORLD.Get_rank()}.npy', found['coefficients'].values)\n"
    )
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    command = [os.environ.get("MPIEXEC", "mpirun"), "-n", "2", sys.executable, "ranks.py"]
    subprocess.run(command, cwd=tmp_path, env={**os.environ, **_ENVIRONMENT, "PYTHONPATH": path}, check=True, timeout=120)
    alone = duffing().sweep({"tones[0]": np.linspace(0.6, 0.9, 5)}, order=5)["coefficients"].values
    for rank in range(2):
        assert np.array_equal(np.load(tmp_path / f"rank_{rank}.npy"), alone)


def test_laws_compiled_by_numba():
    """A law of a velocity, too; each equals the one of the catalogue."""
    pytest.importorskip("numba")
    from nhbm.numba_laws import compiled

    cubic_law = compiled(lambda q, v, p: p[0] * q * q * q, lambda q, v, p: (3 * p[0] * q * q, 0.0), odd=True)
    damping = compiled(lambda q, v, p: p[0] * v * v * v, lambda q, v, p: (0.0, 3 * p[0] * v * v), velocity=True, odd=True)
    found = []
    for laws in (
        (("cubic_spring", {"stiffness": 0.5}), ("cubic_damping", {"coefficient": 0.2})),
        ((cubic_law, {"parameters": [0.5]}), (damping, {"parameters": [0.2]})),
    ):
        model = duffing(spring=True)
        for law, keys in laws:
            model.law(law, ["x1"] if law == "cubic_damping" or law is damping else "x1", **keys)
        found.append(model.solve(order=9)["coefficients"].values)
    np.testing.assert_allclose(found[1], found[0], atol=1e-10)


def test_the_table_of_keys():
    rows = [line for line in (ROOT / "src" / "input_keys.txt").read_text().splitlines() if line and not line.startswith("#")]
    assert [" | ".join(key) for key in nhbm.input_keys()] == rows
    gap = next(key for key in nhbm.input_keys() if (key.section, key.name) == ("law rigid_wall", "gap"))
    assert (gap.type, gap.unit, gap.default) == ("real", "m", "required")


@pytest.mark.parametrize("page", ["README.md", "docs/user/library.md"])
def test_examples_of_the_pages_run(page, tmp_path, monkeypatch):
    """The lines of a page one after the other, as a reader would type them."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    for block in blocks:
        if "nhbm" in block and "open_dataset" not in block:
            exec(block, names)
    assert names["motion" if page.endswith("library.md") else "curve"].nhbm.is_converged.all()
