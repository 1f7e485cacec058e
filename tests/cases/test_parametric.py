"""Stiffness that depends on the phase of tones, against closed forms, Mathieu's tongues from scipy and integration in time."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from program import ALL_CONVERGED, read, run, solve
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_b

OSCILLATOR = "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = {}, stiffness = {!r} /\n"
PUMP = "&law type = 'parametric', label = 'pump', dof = 'x1', tuple = {}, stiffness_cos = {!r} /\n"


def multipliers(stiffness: float, q: float, tmp_path, damping: float = 0.0):
    """Of x'' + d x' + (a - 2 q cos 2t) x = 0 over 2 pi."""
    model = OSCILLATOR.format(damping, stiffness) + "&tones frequency = 1.0 /\n&harmonics order = 5 /\n" + PUMP.format(2, -2.0 * q)
    path = solve(model, tmp_path, name=f"{stiffness}", status=None)
    real, imaginary = read(path, "multiplier_real", "multiplier_imag")
    return real[0] + 1j * imaginary[0]


@pytest.mark.parametrize("pump, start", [(0.02, 0.1), (0.02, 1e-6), (0.02, 1e-9), (0.03, 1e-3), (0.06, 1e-6)])
def test_remainder_of_an_iteration_is_no_motion(pump, start, tmp_path):
    """Without loads zero is a motion. Below the threshold of .04 it is the only one, and stable; a start does not change it."""
    model = OSCILLATOR.format(0.02, 1.0) + "&tones frequency = 1.0 /\n" + PUMP.format(2, pump)
    model += "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n"
    path = solve(model + f"&start dof = 'x1', tuple = 1, cos = {start} /\n", tmp_path, status=ALL_CONVERGED)
    coefficients, stable = read(path, "coefficients", "is_stable")
    assert not coefficients.any() and stable[0] == (1 if pump < 0.04 else -1)


@pytest.mark.parametrize("q", [0.1, 1.0])
@pytest.mark.parametrize("r", [1, 2])
def test_tongues_of_mathieu(r, q, tmp_path):
    """On the edges of a tongue both multipliers are 1, a double root that rounding splits with a constant sum; between the edges
    one is larger."""
    below, above = sorted(float(edge(r, q)) for edge in (mathieu_a, mathieu_b))
    for edge in (below, above):
        assert multipliers(edge, q, tmp_path).sum() == pytest.approx(2.0, abs=1e-6)
    inside = np.abs(multipliers(0.5 * (below + above), q, tmp_path))
    assert inside.max() > 1.001 and inside.prod() == pytest.approx(1.0, abs=1e-7)
    np.testing.assert_allclose(np.abs(multipliers(above + 0.05, q, tmp_path)), 1.0, atol=1e-7)


def test_multipliers_are_those_of_integration_in_time(tmp_path):
    q, stiffness, damping = 0.3, 1.1, 0.05

    def rate(t, x):
        return [x[1], -damping * x[1] - (stiffness - 2.0 * q * np.cos(2.0 * t)) * x[0]]

    columns = [solve_ivp(rate, (0.0, 2.0 * np.pi), x, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1] for x in np.eye(2)]
    expected = np.linalg.eigvals(np.array(columns).T)
    np.testing.assert_allclose(np.sort(multipliers(stiffness, q, tmp_path, damping)), np.sort(expected), rtol=1e-8)


@pytest.mark.parametrize("tuple_, tones", [("2", "0.9"), ("9", "0.31"), ("1, 1", "0.9, 0.5671"), ("6, -5", "0.9, 0.5671")])
def test_by_default_the_motion_is_that_of_integration_in_time(tuple_, tones, tmp_path):
    """With a distant modulation the response to each tuple is distant from the others: the degrees of the laws do not lead
    there."""
    n = len(tones.split(","))
    model = OSCILLATOR.format(0.2, 1.3) + f"&tones frequency = {tones} /\n" + PUMP.format(tuple_, 0.3)
    model += f"&load dof = 'x1', tuple = {'1' if n == 1 else '1, 0'}, cos = 1.0 /\n"
    if n == 2:
        model += "&load dof = 'x1', tuple = 0, 1, cos = 0.5 /\n"
    model += "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.05 /\n&accuracy tolerance = 1e-4 /\n"
    path = solve(model, tmp_path, status=ALL_CONVERGED)
    done = run("verify", path, cwd=tmp_path)
    with h5py.File(path) as file:
        assert file["is_stable"][0] == 1 and file["truncation_estimate"][0] < 1e-4
    assert "1 agrees" in done.stdout, done.stdout


def test_tuples_need_their_tones(tmp_path):
    model = OSCILLATOR.format(0.1, 1.0) + "&tones frequency = 1.0 /\n" + PUMP.format("0, 1", 0.1)
    (tmp_path / "case.nml").write_text(model)
    done = run("check", "case.nml", cwd=tmp_path)
    assert done.status == 2 and "tuple: there is only 1 tone" in done.stderr
