"""Parts with frequency-dependent stiffness, against closed forms and against springs and dampers with their own coordinates."""

import numpy as np
import pytest
from scipy.optimize import brentq

from in_process import ROOT, nhbm
from program import run

TONES = [1.3, 1.83847763]
MASSES = np.eye(3)
SPRINGS = 2.0 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 2]])


def chain(tones=TONES):
    model = nhbm.Model(nhbm.Chain(n_masses=3, ends="fixed", mass=1.0, coupling_stiffness=2.0, damping_mass=0.2), tones=tones)
    model.load("x1", [1] + [0] * (len(tones) - 1), cos=1.0)
    return model


def coefficients(motion):
    """Amplitudes cos - i sin, (dof, harmonic)."""
    values = motion["coefficients"].values
    return values[..., 0] - 1j * values[..., 1]


def with_stop(model):
    model.load("x1", (0, 1), cos=0.6)
    model.law("elastic_stop", "x2", gap=0.2, stiffness=5.0, label="stop")
    model.set("sampling", samples=[32, 32])
    return model


def test_linear_motion_is_that_of_the_closed_form():
    """A sensor at x3 and an actuator at x1, with a delay of .9 s, and a fractional mount."""
    model = chain([1.3])
    model.dynamic_stiffness("delay", "x3", stiffness=0.7, damping=0.3, delay=0.9, force_dof="x1")
    model.dynamic_stiffness("fractional", "x2", coefficient=0.4, exponent=0.5)
    w = 1.3
    s = SPRINGS + (0.2j * w - w**2) * MASSES
    s[0, 2] += (0.7 + 0.3j * w) * np.exp(-0.9j * w)
    s[1, 1] += 0.4 * (1j * w) ** 0.5
    np.testing.assert_allclose(coefficients(model.solve(order=1))[:, 1], np.linalg.solve(s, [1, 0, 0]), rtol=1e-13)


def test_maxwell_elements_are_those_with_coordinates_of_their_own():
    """Two tones and a stop; each element is a spring in series with a damper, here a massless coordinate."""
    model = with_stop(chain())
    model.dynamic_stiffness("maxwell", ["x2", "x3"], weights=[1, -1], moduli=[0.7, 0.4], times=[0.5, 3.0])
    k = np.zeros((5, 5))
    k[:3, :3] = SPRINGS
    for n, modulus in ((3, 0.7), (4, 0.4)):
        shape = np.array([0, 1.0, -1, 0, 0]) - np.eye(5)[n]
        k += modulus * np.outer(shape, shape)
    reference = nhbm.Model(nhbm.Matrices(mass=np.diag([1.0, 1, 1, 0, 0]), damping=np.diag([0.2, 0.2, 0.2, 0.35, 1.2]), stiffness=k),
                           tones=TONES)  # fmt: skip
    reference.load("x1", (1, 0), cos=1.0)
    motions = [m.solve(order=5) for m in (model, with_stop(reference))]
    here, there = (coefficients(motion) for motion in motions)
    np.testing.assert_allclose(here, there[:3], atol=1e-12 * abs(there).max())
    for name in ("power_in", "power_damping", "truncation_estimate"):
        assert float(motions[0][name]) == pytest.approx(float(motions[1][name]), rel=1e-9)
    assert motions[0]["stability"] == "unknown"


def test_sweeps_and_derivatives_move_the_values_of_parts():
    model = with_stop(chain())
    model.dynamic_stiffness("maxwell", ["x2", "x3"], weights=[1, -1], moduli=[0.7, 0.4], times=[0.5, 3.0], label="mount")
    path = "dynamic_stiffness(mount)%moduli(2)"
    sides = model.sweep({path: [0.4 - 1e-4, 0.4, 0.4 + 1e-4]}, order=5)
    values = sides.nhbm.amplitude("x2", (1, 0)).values
    found = model.gradient("x2 (1,0)", [path], order=5)
    assert found.value == pytest.approx(values[1], rel=1e-12)
    assert found.slopes[0] == pytest.approx((values[2] - values[0]) / 2e-4, rel=1e-5)


def test_curves_have_the_peak_of_the_closed_form():
    """The peak of a linear response with a table of stiffness; between its rows there is a cubic, beyond the last one a
    constant."""
    model = nhbm.Model(nhbm.Matrices(mass=[[1.0]], damping=[[0.0]], stiffness=[[1.0]]), tones=[0.8])
    model.load("x1", 1, cos=1.0)
    model.dynamic_stiffness("table", "x1", frequencies=[0.5, 1.0], storage=[0.5, 0.7], loss=[0.1, 0.2])
    model.law("cubic_spring", "x1", stiffness=0.0)
    model.set("harmonics", order=1)
    peak = model.peak("x1 (1)", "tones[0]", 0.8, 2.0)
    assert peak.at == pytest.approx(np.sqrt(1.7), rel=1e-6)  # where Re S = 0, and Im S = .2 all round
    assert peak.value == pytest.approx(5.0, rel=1e-6)


@pytest.mark.parametrize("keys, message", [
    ({"kind": "tabel", "dof": "x1"}, "did you mean 'table'"),
    ({"kind": "maxwell", "dof": "x1", "moduli": [1.0]}, "missing key 'times'"),
    (
        {"kind": "table", "dof": "x1", "frequencies": [2.0, 1.0], "storage": [1.0, 1.0], "loss": [0.0, 0.0]},
        "greater than the one before",
    ),
    ({"kind": "table", "dof": "x1", "frequencies": [0.0, 1.0], "storage": [1.0, 1.0], "loss": [0.1, 0.0]}, "must be 0 at"),
    ({"kind": "delay", "dof": "x9", "delay": 1.0}, "unknown degree of freedom 'x9'"),
    ({"kind": "delay", "dof": ["x1", "x1"], "weights": [1, 2], "delay": 1.0}, "named twice"),
    ({"kind": "delay", "dof": ["x1", "x2"], "delay": 1.0}, "weights"),
])  # fmt: skip
def test_mistakes_name_the_key(keys, message):
    model = chain([1.3])
    with pytest.raises(nhbm.ModelError, match=message):
        model.dynamic_stiffness(**keys)


def test_check_and_solve_say_what_they_leave_out(tmp_path):
    mount = str(ROOT / "inputs" / "gallery" / "viscoelastic_mount.nml")
    assert "7.07107 rad/s  (without &dynamic_stiffness)" in run("check", mount, cwd=tmp_path).stdout
    assert "stability is not known" in run("solve", mount, cwd=tmp_path).stdout


def test_what_needs_time_is_refused():
    model = chain([1.3])
    model.dynamic_stiffness("loss_factor", "x2", stiffness=1.0, loss_factor=0.1)
    motion = model.solve(order=1)
    with pytest.raises(nhbm.ModelError, match="equations in time"):
        model.verify(motion)
    with pytest.raises(nhbm.ModelError, match="equations in time"):
        model.integrate(duration=10.0)
    free = nhbm.Model(nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0), tones=[1.0])
    free.set("tones", unknown=True)
    free.law("van_der_pol", "x1", strength=1.0, threshold=1.0)
    free.dynamic_stiffness("loss_factor", "x1", stiffness=1.0, loss_factor=0.1)
    free.set("normal_mode", dof="x1", amplitude=1.0)
    with pytest.raises(nhbm.ModelError, match="a normal mode has no stiffness that depends on the frequency"):
        free.solve(order=3)


D, P, DELAY, CUBIC = 0.1, 0.5, 1.0, 0.2  # x'' + D x' + x + P x(t - DELAY) + CUBIC x'^3 = 0, with loads of the tests


def fed_back(tones=None):
    """A mass under a delayed feedback, which drives it."""
    oscillator = nhbm.Matrices(mass=1.0, damping=D, stiffness=1.0)
    model = nhbm.Model(oscillator, tones=tones or {"unknown": True})
    model.dynamic_stiffness("delay", "x1", stiffness=P, delay=DELAY, label="feedback")
    model.law("cubic_damping", ["x1"], coefficient=CUBIC)
    return model


def delayed(t_end, h=0.01, x=0.1):
    """Motion of the mass in time, by Runge-Kutta steps with cubics between the stored points of the past."""
    lag, steps = round(DELAY / h), round(t_end / h)
    q, v = np.full(steps + 1, x), np.zeros(steps + 1)

    def past(i):
        return (x, x, x) if i < 0 else (q[i], 0.5 * (q[i] + q[i + 1]) + h / 8 * (v[i] - v[i + 1]), q[i + 1])

    for i in range(steps):
        old = past(i - lag)

        def rate(q0, v0, late):
            return v0, -D * v0 - q0 - P * late - CUBIC * v0**3

        a1, b1 = rate(q[i], v[i], old[0])
        a2, b2 = rate(q[i] + h / 2 * a1, v[i] + h / 2 * b1, old[1])
        a3, b3 = rate(q[i] + h / 2 * a2, v[i] + h / 2 * b2, old[1])
        a4, b4 = rate(q[i] + h * a3, v[i] + h * b3, old[2])
        q[i + 1] = q[i] + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        v[i + 1] = v[i] + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return h * np.arange(steps + 1), q, v


def cycle_of(p=P, delay=DELAY):
    """Frequency and amplitude of the balance of the first harmonic: w^2 = 1 + p cos(w T), 3/4 c (w A)^2 w = p sin(w T) - d w."""
    w = brentq(lambda w: 1 + p * np.cos(w * delay) - w**2, 0.5, 1.3)
    return w, np.sqrt((p * np.sin(w * delay) - D * w) / (0.75 * CUBIC * w**3))


def test_a_delayed_feedback_has_its_limit_cycle():
    motion = fed_back().solve(order=1)
    w, amplitude = cycle_of()
    assert motion["status"] == "converged" or motion["status"] == "truncated"
    assert float(motion["frequency"][0]) == pytest.approx(w, rel=1e-9)
    assert abs(coefficients(motion)[0, 1]) == pytest.approx(amplitude, rel=1e-9)


def test_a_limit_cycle_with_delay_is_that_of_time():
    """The steady motion of the delay differential equation: its period, and its amplitude."""
    motion = fed_back().solve(order=15)
    assert motion["status"] == "converged"
    t, q, v = delayed(150.0)
    last = np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0) & (t[:-1] > 100))
    tops = t[last] + 0.01 * v[last] / (v[last] - v[last + 1])
    period = (tops[-1] - tops[0]) / (len(tops) - 1)
    assert float(motion["frequency"][0]) == pytest.approx(2 * np.pi / period, rel=1e-6)
    x = coefficients(motion)[0]
    tau = np.linspace(0, 2 * np.pi, 4001)
    top = np.max((x[:, None] * np.exp(1j * np.outer(motion["tuple"].values[:, 0], tau))).real.sum(axis=0))
    assert top == pytest.approx(q[t > 100].max(), rel=1e-5)


def test_a_limit_cycle_moves_with_the_delay():
    delays = [0.6, 1.0, 1.4, 1.8]
    motions = fed_back().sweep({"dynamic_stiffness(feedback)%delay": delays}, order=1)
    expected = [cycle_of(delay=delay) for delay in delays]
    np.testing.assert_allclose(motions["frequency"].values[:, 0], [w for w, _ in expected], rtol=1e-9)
    amplitudes = motions.nhbm.amplitude("x1", 1).values
    np.testing.assert_allclose(amplitudes, [a for _, a in expected], rtol=1e-9)


def test_a_delay_that_damps_leaves_the_mass_at_rest():
    model = fed_back()
    model["dynamic_stiffness(feedback)%stiffness"] = -P
    assert model.solve(order=3)["status"] in ("no_motion", "collapsed")


def test_a_limit_cycle_with_delay_beside_a_forced_tone():
    """A weak load at 2.15 times the frequency of the cycle changes it little; with its tone the motion is a torus."""
    model = fed_back(tones={"frequency": [2.37, 0.0], "unknown": [False, True]})
    model.load("x1", (1, 0), cos=0.01)
    motion = model.solve(order=5)
    assert motion["status"] == "converged"
    assert float(motion["frequency"][1]) == pytest.approx(float(fed_back().solve(order=9)["frequency"][0]), rel=1e-5)


@pytest.mark.parametrize(
    "key", ["solver%first_guess='integration'", "solver%primary_method='integration'", "stability%method='integration'"]
)
def test_keys_that_request_time_integration_are_refused(key, tmp_path):
    mount = str(ROOT / "inputs" / "gallery" / "viscoelastic_mount.nml")
    result = run("check", mount, "--set", key, cwd=tmp_path)
    name = key.split("=")[0].split("%")[1]
    assert result.status == 2 and f"{name}: 'integration' is not available with &dynamic_stiffness" in result.stderr


def test_a_curve_of_flips_is_refused(tmp_path):
    mount = (ROOT / "inputs" / "gallery" / "viscoelastic_mount.nml").read_text().split("&sweep")[0]
    curve = "&curve parameter='tones%frequency', from=4.0, to=20.0, follow='period_doubling', over='load(1)%cos'"
    (tmp_path / "flips.nml").write_text(mount + curve + ", over_from=1.5, over_to=3.0 /\n")
    result = run("solve", "flips.nml", cwd=tmp_path)
    assert result.status == 2 and "not known with a &dynamic_stiffness" in result.stderr
