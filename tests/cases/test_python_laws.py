"""Laws as functions in Python, compiled or not, with memory or without: the numbers of the laws of the catalogue."""

from __future__ import annotations

import ctypes
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
import warnings

import numpy as np
import pytest
from scipy import LowLevelCallable

from in_process import FRICTION, INCLUDES, ROOT, cubic, duffing

import nhbm
from nhbm import Model, ModelError


def test_laws_are_functions_of_python(tmp_path):
    """Complex steps, differences, given derivatives and a compiled law agree with the law of the catalogue."""

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
            "compiled": (nhbm.law(compiled, odd=True), {}), "scipy": (nhbm.law(LowLevelCallable(compiled), odd=True), {}),
            "address": (nhbm.law(with_address, odd=True), {})}  # fmt: skip
    for name, (law, keys) in laws.items():
        model = duffing(spring=law)
        model.law(law, "x1", **keys)
        found = model.solve(order=9)
        np.testing.assert_allclose(
            found["coefficients"].values, expected, atol=1e-9 if name != "differences" else 1e-7, err_msg=name
        )


@pytest.mark.parametrize("odd", [False, True])
def test_a_law_that_cannot_continue_ends_a_curve(tmp_path, odd):
    """The points before it are there, and its row names the law."""
    (tmp_path / "law.c").write_text(
        '#include "nhbm_user_law.h"\n'
        "int cubic(const nhbm_law_samples_t *s) { for (int i = 0; i < s->n_samples; ++i) { if (s->z[i]*s->z[i] > .36) return -7;\n"
        "s->f[i] = .5*s->z[i]*s->z[i]*s->z[i]; if (s->df_dz) s->df_dz[i] = 1.5*s->z[i]*s->z[i]; } return 0; }\n")  # fmt: skip
    subprocess.run([shutil.which("cc"), *INCLUDES, "-shared", "-fPIC", tmp_path / "law.c", "-o", tmp_path / "law.so"], check=True)
    compiled = ctypes.CDLL(str(tmp_path / "law.so")).cubic
    compiled.restype, compiled.argtypes = ctypes.c_int, [ctypes.c_void_p]
    law = nhbm.law(compiled, odd=odd)
    model = duffing(spring=law)
    model.law(law, "x1", label="fragile")
    with pytest.warns(nhbm.NotConverged, match="fragile.*-7"):
        curve = model.curve("tones[0]", 0.5, 1.5, order=5)
    assert curve.sizes["point"] > 5
    assert set(curve["status"].values[:-1]) == {"converged"}
    assert curve["status"].values[-1] == "failed"
    assert np.nanmax(curve.nhbm.amplitude("x1", 1).values[:-1]) < 0.61


def stop(q, p):
    return 0.5 * p[0] * (q - p[1] + abs(q - p[1]))


def curved(q):
    return 0.5 * q * abs(q)


def late(q):
    """Differentiable in complex numbers as long as displacements are small."""
    return 0.5 * q**3 if np.abs(q).max() < 0.1 else 0.5 * q * q * abs(q) * np.sign(q.real)


@pytest.mark.parametrize("force", [lambda q: q**3, lambda q: abs(q) ** 3 * np.sign(q)], ids=["complex", "differences"])
def test_a_flat_force_has_right_derivatives(force):
    """Both vanish at rest, where differences have nothing but their error, and are flat where the motion passes through zero."""
    model = Model(nhbm.Matrices(np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]]), 0.1 * np.eye(2)), tones=[1.0])
    model.load("x1", 1, cos=0.3)
    model.law("elastic_stop", "x1", stiffness=5.0, gap=0.1)
    model.law(force, "x1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.solve()


def test_derivatives_of_laws_that_complex_steps_do_not_follow():
    """`abs` accepts complex numbers and loses their derivative, whereas the same law without it keeps it."""
    pairs = {
        stop: lambda q, p: p[0] * np.maximum(q - p[1], 0.0),
        curved: lambda q: np.where(q.real > 0, 0.5, -0.5) * q * q,
        late: cubic,
    }
    for law, same_law in pairs.items():
        found, expected = [], []
        for function, numbers in ((law, found), (same_law, expected)):
            model = duffing(spring=law)
            model.law(nhbm.law(function, odd=law is not stop), "x1", **({"parameters": [0.5, 0.1]} if law is stop else {}))
            motion = model.solve(order=15)
            numbers += [motion.nhbm.amplitude("x1", 1).item(), *motion["multiplier_real"].values.ravel()]
            numbers += model.gradient("x1 (1)", ["tones[0]"], order=15).slopes.tolist()
        np.testing.assert_allclose(found, expected, rtol=1e-5, err_msg=law.__name__)


def test_one_sided_derivatives_at_a_kink_are_trusted():
    """All samples of the motion zero stand on the kink: that is not a reason to give complex steps up."""
    trust = nhbm.laws._Trust()
    kink, zero = lambda by: np.maximum(np.zeros(9) + by, 0.0), lambda: np.zeros(9)  # noqa: E731
    assert (trust.slopes(kink, zero, 1e-6) == 1.0).all() and trust.is_complex
    halved = lambda by: 1.0 + by + abs(np.ones(9) + by)  # noqa: E731
    np.testing.assert_allclose(trust.slopes(halved, lambda: np.full(9, 2.0), 1e-6), 2.0)
    assert not trust.is_complex


def pushed(q, phases, frequencies):
    return -0.3 * np.cos(phases[:, 0]) - 0.1 * frequencies[0] ** 2 * np.sin(phases[:, 0]) + 0.0 * q


def dry_friction(q, v, phases):
    return 0.95 * (1 + 0.2 * np.cos(phases[:, 0])) * np.sign(v) + 0.0 * q


def switched_load(q, phases):
    return 0.95 * np.sign(np.cos(phases[:, 0])) + 0.0 * q


def test_forces_that_jump_with_the_motion_end_at_once():
    """Also where they depend on phases; a force that jumps at given times alone has a motion, that of its Fourier series."""
    found = []
    for law in (dry_friction, switched_load):
        model = Model(
            nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1),
            tones=[0.7],
        )
        model.load("x1", 1, cos=1.0)
        model.law(law, "x1")
        found.append(model.solve(tolerance=1e-4))
    assert found[0]["status"] == "failed" and "its force jumps" in str(found[0]["message"].values)
    first = 1.0 - 0.95 * 4 / np.pi
    assert found[1]["status"] == "converged"
    assert abs(found[1].nhbm.amplitude("x1", 1) / abs(first / (1 - 0.49 + 0.07j)) - 1) < 1e-4


def test_laws_may_depend_on_phases_and_frequencies():
    """A force that depends on the phase is a load; its derivative with respect to the frequency also leads around folds; two
    tones."""
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
    curve = forced.curve("tones[0]", 0.6, 2.5, order=9, peak_of="x1 (1)", max_step=0.2)
    kinds = curve["curve_kind"].values.tolist()
    assert kinds.count("fold") == 2 and kinds.count("peak") == 1 and bool(curve.nhbm.is_converged.all())
    for k in (2, 4):  # before the fold a load of that frequency has no other motion
        loaded = duffing()
        loaded["tones[0]"] = omega = float(curve["tones_frequency"][k])
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


@pytest.mark.parametrize("tones", [pytest.param(1, marks=pytest.mark.long), 2])
def test_laws_with_memory_are_the_one_of_the_catalogue(tones, tmp_path):
    """A slider in Python, in C and of the catalogue: the same motion to 1e-10; multipliers, from time integration without the
    events of the catalogue's law, within their estimates."""
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
        assert motion.nhbm.details["iterations"] == expected.nhbm.details["iterations"]
    if tones == 1:
        compiled.set("stability", method="integration")
        motion = compiled.solve()
        assert motion["stability"] == expected["stability"] == "stable"
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


def test_no_parameters_are_an_empty_list():
    model = duffing(spring=True)
    model.law(lambda q: 0.1 * q, "x1", parameters=[], label="mine")
    other = duffing(spring=True)
    other.law(lambda q: 0.1 * q, "x1")
    np.testing.assert_array_equal(model.solve(order=3)["coefficients"], other.solve(order=3)["coefficients"])


def test_faults_of_laws_are_raised():
    def raises(q):
        raise RuntimeError("out of range")

    def wrong_shape(q):
        return np.zeros(3)

    def never_ends(q):
        while True:
            time.sleep(0.01)

    for law, fault, text in ((raises, RuntimeError, "out of range"),
                             (wrong_shape, ModelError, "'wrong_shape' gives forces of shape"),
                             (lambda q, v, p, x: q, ModelError, "argument 'x' is not known"),
                             (lambda q: None, ModelError, "'<lambda>' gives forces that are None"),
                             (lambda q: 1j * q, ModelError, "gives forces that are complex"),
                             (lambda q: "much", ModelError, "gives forces that are no numbers"),
                             (lambda q: sys.exit(3), SystemExit, "3")):  # fmt: skip
        model = duffing(spring=law)
        with pytest.raises(fault, match=text):
            model.law(law, "x1")
            model.solve(order=3)
    for law in (lambda q: np.zeros(q.shape, dtype=int), lambda q: 0, lambda q: [0.0] * len(q)):  # accepted unchanged
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
    with pytest.raises(KeyboardInterrupt):
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        model.solve(order=3)
    assert duffing().solve(order=3).nhbm.is_converged


@pytest.mark.parametrize(
    ("force", "text"),
    [
        (lambda q, v: 0.3 * np.sign(v), "jumps .* coulomb_rigid"),  # dry friction
        (lambda q: q**3 + q[0], "depends on other samples"),
    ],
)
def test_forces_that_no_method_can_follow_are_named(force, text):
    """They took half a minute, and ended as `stalled`: check units and loads first."""
    model = Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0, damping_mass=0.05), tones=[0.9])
    model.load("x1", 1, cos=0.5)
    model.law(force, "x2")
    with pytest.warns(UserWarning, match=text):
        model.solve()


def relay(states, step):
    return np.where(step.q.real > 0.1, 1.0, np.where(step.q.real < -0.1, -1.0, states))


def mixed_state(states, step):
    return 0.5 * states + step.q - step.q.mean()


@pytest.mark.parametrize(
    ("advance", "text", "tones"),
    [(relay, "jumps", 1), (mixed_state, "depends on other samples", 1), (mixed_state, "depends on other samples", 2)],
)
def test_states_that_no_method_can_follow_are_named(advance, text, tones):
    @nhbm.law(states=1, advance=advance)
    def force(q, p, states):
        return 2.0 * (q - states)

    model = Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0, damping_mass=0.05), tones=[0.9, 1.557][:tones])
    model.load("x1", 1 if tones == 1 else (1, 0), cos=0.5)
    model.law(force, "x2", parameters=[1.0])
    with pytest.warns(UserWarning, match=text):
        model.solve(order=9 if tones == 1 else 3)


def test_laws_compiled_by_numba():
    """A law of a velocity, too; each equals the one of the catalogue."""
    pytest.importorskip("numba")
    from nhbm.numba_laws import compiled

    cubic_law = compiled(lambda q, v, p: p[0] * q * q * q, lambda q, v, p: (3 * p[0] * q * q, 0.0), velocity=False, odd=True)
    damping = compiled(lambda q, v, p: p[0] * v * v * v, lambda q, v, p: (0.0, 3 * p[0] * v * v), odd=True)
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


def test_derivatives_that_nhbm_takes_are_none_of_the_user():
    """A force in steps has no derivative that its differences agree with; only one that the function returns can be wrong."""

    def solve(function):
        model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
        model.load("x1", 1, cos=1.0)
        model.law(nhbm.law(function), "x1", label="mine")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            model.solve(order=9)
        return "\n".join(str(one.message) for one in caught)

    said = solve(lambda q: np.round(0.3 * np.real(q), 6))
    assert "law 'mine'" in said and "which nhbm takes from its forces" in said and "correct the law" not in said
    assert "law 'mine': df/dz is not the derivative of its force" in solve(lambda q: (0.1 * q**3, 0.1 * q**2))
