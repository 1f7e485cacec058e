"""Controllers with states and delays, against springs and dampers, the closed form, parts that exist and own integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from in_process import nhbm

MASS = np.diag([1.0, 1.5])
DAMPING = np.array([[0.3, -0.1], [-0.1, 0.2]])
STIFFNESS = np.array([[4.0, -1.5], [-1.5, 3.0]])


def plant(tones=(0.8,), damping=DAMPING, stiffness=STIFFNESS, cubic=0.3):
    model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=damping, stiffness=stiffness, labels=["x", "y"]), tones=list(tones))
    model.load("x", [1] + [0] * (len(tones) - 1), cos=1.0)
    if cubic is not None:
        model.law("cubic_spring", "x", stiffness=cubic)
    return model


def coefficients(motion, n=2):
    return (motion["coefficients"].values @ [1, -1j])[:n]


def controller(rng, n=3, sensors=2, actuators=2):
    """A stable one."""
    a = rng.normal(size=(n, n))
    a -= (np.linalg.eigvals(a).real.max() + 0.5) * np.eye(n)
    return a, rng.normal(size=(n, sensors)), 0.3 * rng.normal(size=(actuators, n)), 0.2 * rng.normal(size=(actuators, sensors))


@pytest.mark.parametrize("tones", [(0.8,), (0.8, 1.234)])
def test_without_states_it_is_a_spring_and_a_damper(tones):
    """PD control of x and y, of each by the other, too."""
    k, d = np.array([[0.9, 0.2], [-0.3, 0.7]]), np.array([[0.11, 0.02], [0.03, 0.09]])
    model, reference = plant(tones), plant(tones, DAMPING + d, STIFFNESS + k)
    model.feedback(["x", "y"], ["x", "y"], d=k, e=d)
    here, there = (one.solve(order=5) for one in (model, reference))
    np.testing.assert_allclose(coefficients(here), coefficients(there), atol=1e-12 * abs(coefficients(there)).max())
    assert here["stability"] == there["stability"] == "stable"
    if len(tones) == 1:
        assert model.verify(here)["integration_verdict"] == reference.verify(there)["integration_verdict"] == "agrees"


@pytest.mark.parametrize("delay", [0.0, 0.7])
def test_linear_motions_are_those_of_the_closed_form(delay):
    rng = np.random.default_rng(5)
    w = 1.1
    a, b, c, d = controller(rng)
    e = 0.1 * rng.normal(size=(2, 2))
    for law in (None, 0.0):
        model = plant([w], cubic=law)
        model.feedback(["y", "x"], ["x", "y"], a, b, c, d, e, delay=delay)
        s = STIFFNESS + 1j * w * DAMPING - w**2 * MASS
        z = (c @ np.linalg.solve(1j * w * np.eye(3) - a, b) + d + 1j * w * e) * np.exp(-1j * w * delay)
        s = s + z[:, ::-1]  # sensors y, x
        np.testing.assert_allclose(coefficients(model.solve(order=1))[:, 1], np.linalg.solve(s, [1, 0]), rtol=1e-11)


def test_a_delay_without_states_is_that_of_a_part():
    model, reference = plant(), plant()
    model.feedback(["x"], ["y"], d=0.4, e=0.1, delay=0.6)
    reference.dynamic_stiffness("delay", "x", force_dof="y", stiffness=0.4, damping=0.1, delay=0.6)
    here, there = (one.solve(order=7) for one in (model, reference))
    np.testing.assert_allclose(coefficients(here), coefficients(there), atol=1e-13)
    assert here["stability"] == there["stability"] != "unknown"


@pytest.mark.parametrize("seed", range(6))
def test_random_controllers_agree_with_own_integration(seed):
    rng = np.random.default_rng(seed)
    w = 0.7 + rng.random()
    a, b, c, d = controller(rng, n=int(rng.integers(1, 4)), sensors=1)
    model = plant([w])
    model.feedback(["y"], ["x", "y"], a, b, c, d)
    motion = model.solve(order=11)
    n = len(a)
    linear = np.zeros((4 + n, 4 + n))
    linear[:2, 2:4] = np.eye(2)
    linear[2:4, :2] = -STIFFNESS
    linear[2:4, 1] -= d[:, 0]
    linear[2:4, 2:4] = -DAMPING
    linear[2:4, 4:] = -c
    linear[2:4] = np.linalg.solve(MASS, linear[2:4].reshape(2, -1))
    linear[4:, 1] = b[:, 0]
    linear[4:, 4:] = a
    if motion["stability"] != "stable":
        assert (np.linalg.eigvals(linear).real > -0.05).any()
        return

    def rate(t, z):
        dz = linear @ z
        dz[2] += np.cos(w * t) - 0.3 * z[0] ** 3
        return dz

    periods = 60
    growth = -np.log(1e-9) / min(-np.linalg.eigvals(linear).real.max(), 1.0)
    periods = int(max(periods, np.ceil(growth * w / (2 * np.pi)))) if growth > 0 else periods
    t = 2 * np.pi / w * (periods + np.linspace(0, 1, 65)[:-1])
    found = solve_ivp(rate, (0, t[-1]), np.zeros(4 + n), t_eval=t, rtol=1e-9, atol=1e-11, method="DOP853").y[:2]
    x = coefficients(motion)
    ours = (x @ np.exp(1j * w * np.outer(motion["tuple"].values[:, 0], t))).real
    np.testing.assert_allclose(ours, found, atol=2e-6 * abs(found).max())
    assert model.verify(motion)["integration_verdict"] == "agrees"


def test_stability_is_that_of_the_linear_equations():
    """A small motion: multipliers by eigenvalues of the closed loop; a controller that destabilises."""
    rng = np.random.default_rng(2)
    a, b, c, d = controller(rng)
    verdicts = set()
    for gain in (0.2, 1.0, 4.0, -4.0):
        model = plant([0.9], cubic=1e-6)
        model.feedback(["x", "y"], ["x", "y"], a, b, gain * c, d)
        motion = model.solve(order=3)
        closed = np.block([[np.zeros((2, 2)), np.eye(2), np.zeros((2, 3))],
                           [-np.linalg.solve(MASS, np.hstack([STIFFNESS + d, DAMPING, gain * c]))],
                           [b, np.zeros((3, 2)), a]])  # fmt: skip
        growing = int((np.linalg.eigvals(closed).real > 0).sum())
        assert motion["stability"] == ("stable" if growing == 0 else "unstable")
        assert growing == 0 or int(motion["n_unstable"]) == growing
        verdicts.add(str(motion["stability"].values))
    assert verdicts == {"stable", "unstable"}


def test_an_integrator_removes_the_mean():
    """PID control: under a constant load the measured displacement has the mean 0."""
    model = plant([0.8], cubic=0.3)
    model.load("x", 0, cos=0.5)
    model.feedback(["x"], ["x"], a=[[0.0]], b=[[1.0]], c=[[0.3]], d=1.0, e=0.5)
    motion = model.solve(order=7)
    x = coefficients(motion, 3)
    assert motion["status"] == "converged" and abs(x[0, 0]) < 1e-12
    assert motion["stability"] == "stable"
    at_rest = np.linalg.solve(np.array([[0.0, -1.5, 0.3], [0.0, 3.0, 0.0], [1.0, 0, 0]]) + np.array(
        [[4.0, 0, 0], [-1.5, 0, 0], [0, 0, 0]]), [0.5, 0, 0])  # fmt: skip
    assert x[2, 0].real == pytest.approx(at_rest[2], rel=1e-6)


def test_a_levitated_mass_between_unstable_magnets():
    """A rigid mass on a negative stiffness, which PD control with a filtered rate holds; sweeps move gains and delay."""
    negative, tau = -2.0, 0.05
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.0, stiffness=negative), tones=[1.5])
    model.load("x1", 1, cos=0.2)
    model.law("cubic_spring", "x1", stiffness=-0.1)
    p, d = 6.0, 0.8  # p + d s/(1 + tau s)
    model.feedback(["x1"], ["x1"], a=[[-1 / tau]], b=[[1 / tau]], c=[[-d / tau]], d=p + d / tau, label="magnet")
    motion = model.solve(order=5)
    assert motion["stability"] == "stable"
    swept = model.sweep({"feedback(magnet)%delay": [0.0, 1e-3, 0.1, 0.5]}, order=5)
    w = 1.5
    for k, delay in enumerate((0.0, 1e-3, 0.1, 0.5)):
        z = (p + d * 1j * w / (1 + 1j * w * tau)) * np.exp(-1j * w * delay)
        linear = 0.2 / abs(negative - w**2 + z)
        assert swept.nhbm.amplitude("x1", 1).values[k] == pytest.approx(linear, rel=0.05)
    assert list(swept["stability"].values) == ["stable", "stable", "stable", "unstable"]


def test_what_needs_time_is_refused_with_a_delay_alone():
    model = plant()
    model.feedback(["x"], ["y"], a=[[-1.0]], b=[[1.0]], c=[[0.2]], delay=0.3)
    with pytest.raises(nhbm.ModelError, match="a delayed feedback has none"):
        model.verify(model.solve(order=3))


@pytest.mark.parametrize("keys, message", [
    ({"sensors": ["z"]}, "unknown degree of freedom 'z'"),
    ({"a": [[-1.0]]}, "b"),
    ({"a": [[-1.0, 0.0]], "b": [[1.0]], "c": [[1.0]]}, "a"),
    ({"a": [[-1.0]], "b": [[1.0, 2.0]], "c": [[1.0]]}, "b"),
    ({"c": [[1.0]]}, "there are no states"),
    ({}, "exerts no force"),
    ({"d": 1.0, "delay": -1.0}, "delay"),
])  # fmt: skip
def test_mistakes_name_the_key(keys, message):
    model = plant()
    with pytest.raises(nhbm.ModelError, match=message):
        model.feedback(**{"sensors": ["x"], "actuators": ["x"], **keys})
        model.solve(order=1)
