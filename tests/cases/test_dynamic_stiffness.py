"""Parts with frequency-dependent stiffness, against closed forms and against springs and dampers with their own coordinates."""

import numpy as np
import pytest

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
    with pytest.raises(nhbm.ModelError, match="unknown tones"):
        free.dynamic_stiffness("loss_factor", "x1", stiffness=1.0, loss_factor=0.1)


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
