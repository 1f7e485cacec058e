"""Degrees of freedom without mass: circuits, nodes between springs, equations of first order."""

import numpy as np
import pytest
from program import read, solve
from scipy.integrate import solve_ivp

# A mass in a double well with a piezoelectric circuit: x'' + d x' - x/2 + x**3/2 - chi v = f cos(w t),
# v' + lambda v + kappa x' = 0.
HARVESTER = """
&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.0, labels = 'x', 'v', units = 'm', 'V'
   damping = 0.02, 0.0, 0.5, 1.0, stiffness = -0.5, -0.05, 0.0, 0.05 /
&tones frequency = 0.8 /
&load dof = 'x', tuple = 1, cos = {load} /
&law type = 'cubic_spring', dof = 'x', stiffness = 0.5 /
&accuracy tolerance = 1e-6 /
"""
SPRINGS = """
&structure type = 'matrices', n_dofs = {n}, mass = {mass}, damping = {damping}, stiffness = {stiffness} /
&tones frequency = {tones} /
&load dof = 'x1', tuple = {tuple}, cos = 0.4 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&stability method = 'integration' /
&accuracy tolerance = 1e-6 /
"""


def multipliers_of(path):
    real, imaginary = (values[0] for values in read(path, "multiplier_real", "multiplier_imag"))
    return (real + 1j * imaginary)[np.isfinite(real)]


def series_of(path):
    """The displacement x as a function of the phase of the tone, from the coefficients."""
    (cos, sin), tuples = np.moveaxis(read(path, "coefficients")[0, 0], -1, 0), read(path, "tuples")[0, :, 0]
    kept = np.isfinite(cos) & (np.hypot(cos, sin) > 1e-12)
    return lambda phase: cos[kept] @ np.cos(tuples[kept] * phase) + sin[kept] @ np.sin(tuples[kept] * phase)


@pytest.mark.parametrize("load", [0.15, 0.02])
def test_multipliers_of_a_circuit_are_those_of_its_equations(load, tmp_path):
    path = solve(HARVESTER.format(load=load), tmp_path, status=None)
    x_at = series_of(path)

    def rates(t, y):
        x, u, v = y.reshape(3, 3)
        return np.concatenate([u, -0.02 * u + (0.5 - 1.5 * x_at(0.8 * t) ** 2) * x + 0.05 * v, -0.05 * v - 0.5 * u])

    ends = solve_ivp(rates, (0.0, 2 * np.pi / 0.8), np.eye(3).ravel(), rtol=1e-10, atol=1e-12, method="DOP853").y[:, -1]
    wanted = np.linalg.eigvals(ends.reshape(3, 3))
    found = multipliers_of(path)
    assert len(found) == 3
    for multiplier in wanted:
        assert abs(found - multiplier).min() < 1e-5
    assert read(path, "is_stable")[0] == (1 if abs(wanted).max() < 1 else -1)


@pytest.mark.parametrize(("tones", "of"), [("1.3", "1"), ("1.3, 1.7123", "1, 0")])
def test_a_node_between_springs_is_no_state(tones, of, tmp_path):
    """Springs of 3 and 6 in a row are one of 2."""
    one = SPRINGS.format(n=1, mass="1.0", damping="0.1", stiffness="2.0", tones=tones, tuple=of)
    two = SPRINGS.format(n=2, mass="1.0, 0.0", damping="0.1, 0.0", stiffness="3.0, -3.0, -3.0, 9.0", tones=tones, tuple=of)
    found = [solve(text, tmp_path, name=name) for name, text in (("one", one), ("two", two))]
    assert read(found[0], "is_stable")[0] == read(found[1], "is_stable")[0] == 1
    exponents = [read(path, "exponent")[0] for path in found]
    assert exponents[1][:2] == pytest.approx(exponents[0][:2], abs=1e-5)


# Limit cycles of x' = f(x): equations without any mass, and without a &start.
BRUSSELATOR = """
&structure type = 'matrices', n_dofs = 2, mass = 0.0, 0.0, damping = 1.0, 1.0, stiffness = {k}, 0.0, {minus_b}, 0.0 /
&tones unknown = .true. /
&load dof = 'x1', tuple = 0, cos = 1.0 /
&law type = 'polynomial_coupled', dofs = 'x1', 'x2', coefficients = -1.0, 1.0, acts_on = 'x1', 'x2',
   displacement_exponents = 2, 1, 2, 1 /
&accuracy tolerance = 1e-5 /
"""
FITZHUGH_NAGUMO = """
&structure type = 'matrices', n_dofs = 2, mass = 0.0, 0.0, damping = 1.0, 1.0, stiffness = -1.0, 1.0, -0.08, 0.064 /
&tones unknown = .true. /
&load dof = 'x1', tuple = 0, cos = 0.5 /
&load dof = 'x2', tuple = 0, cos = 0.056 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.3333333333333333 /
&accuracy tolerance = 1e-4 /
"""


# frequencies: fourth-order Runge-Kutta integration, periods 7.156919921 and 39.474414981
@pytest.mark.parametrize(("text", "frequency"), [(BRUSSELATOR.format(k=4.0, minus_b=-3.0), 0.8779175087),
                                                 (FITZHUGH_NAGUMO, 0.1591710811)])  # fmt: skip
def test_limit_cycles_of_first_order_start_at_the_modes_that_grow(text, frequency, tmp_path):
    path = solve(text, tmp_path, status=0)
    assert read(path, "frequency")[0, 0] == pytest.approx(frequency, rel=1e-4)


NEURON = """
&structure type = 'matrices', n_dofs = 2, mass = 4*0.0, damping = 1.0, 0.0, 0.0, 1.0, stiffness = -1.0, 1.0, -0.211, 0.12253 /
&tones unknown = .true. /
&load dof = 'x1', tuple = 0, cos = 0.9692 /
&load dof = 'x2', tuple = 0, cos = 0.155106 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.3333333333333333 /
"""
REACTION = BRUSSELATOR.format(k=3.4004, minus_b=-2.4004).replace("cos = 1.0", "cos = 0.6277").replace("1e-5", "1e-2")


# No mode oscillates, or the smallest set leads to another motion; periods by LSODA to 1e-11.
@pytest.mark.parametrize(("text", "period"), [(NEURON, 17.89389981), (REACTION, 12.81841056)], ids=("neuron", "reaction"))
def test_relaxation_oscillations_begin_with_an_integration(text, period, tmp_path):
    path = solve(text, tmp_path, status=0)
    assert 2 * np.pi / read(path, "frequency")[0, 0] == pytest.approx(period, rel=1e-2)


def test_a_stable_equilibrium_of_first_order_has_no_limit_cycle(tmp_path):
    path = solve(BRUSSELATOR.format(k=2.5, minus_b=-1.5), tmp_path, status=None)
    assert b"no mode grows" in read(path, "message")[0].tobytes()
