"""The solvers for the paper's beam against its wall: work, accuracy, and independence of units."""

import math

import numpy as np
import pytest

from program import read, solve

ORDERS = {3: 16, 5: 32, 8: 48, 12: 64}  # order: samples of each tone

MAX_NEWTON_ITERATIONS = 10
LARGEST_RESIDUAL = 1e-12
SAME_POINT = 1e-9  # two solvers, each at a residual of 1e-12
SAME_IN_OTHER_UNITS = 1e-12  # rounding of the scaled input alone

AUGMENTATIONS = (1e3, 1e4, 1e5, 1e6, 1e7)


def beam(order, samples, length=1.0, force=1.0, **law):
    """The model of inputs/paper/wall.nml, its lengths and forces multiplied by `length` and `force`; time stays.

    The damping matrix of the paper, 1 N s/m and 1 N m s/rad, is no multiple of one number in other units: it is given
    as a multiple of the mass here. The thresholds are wide: the solvers are in question, not the truncated series.
    """
    stiffness = force / length
    keys = {"gap": 1.5e-3 * length, "augmentation": 1e5 * stiffness, **law}
    texts = ", ".join(f"{key} = {value!r}" for key, value in keys.items())
    return f"""
&structure type = 'beam', n_elements = 4, length = {length!r}, bending_stiffness = {1750.0 * force * length**2!r},
   mass_per_length = {7.8 * force / length**2!r}, damping_mass = 0.5 /
&tones frequency = {math.e!r}, {math.pi!r} /
&harmonics order = {order} /
&sampling samples = {samples} /
&load dof = 'v3', tuple = 1, 0, cos = {100.0 * force!r} /
&load dof = 'v3', tuple = 0, 1, cos = {100.0 * force!r} /
&law type = 'rigid_wall', dof = 'v3', {texts} /
&error_estimate truncation = 1.0, penetration = 1.0 /
&output dofs = 'v3' /
"""


def paper(order, samples, augmentation):
    """The model of inputs/paper/wall.nml itself."""
    return beam(order, samples, augmentation=augmentation).replace("damping_mass = 0.5", "damping_diagonal = 1.0")


def largest_difference(a, b):
    return np.abs(a - b).max() / np.abs(b).max()


@pytest.mark.parametrize("augmentation", AUGMENTATIONS)
@pytest.mark.parametrize("order", ORDERS)
def test_newton_needs_few_iterations(order, augmentation, tmp_path):
    result = solve(paper(order, ORDERS[order], augmentation), tmp_path)
    iterations, residual = read(result, "iterations", "residual")
    assert 1 <= iterations[0] <= MAX_NEWTON_ITERATIONS
    assert residual[0] < LARGEST_RESIDUAL


@pytest.mark.parametrize("start", ["linear", "tangent"])
@pytest.mark.parametrize("augmentation", [0.0, 1e4])
@pytest.mark.parametrize("order", ORDERS)
def test_broyden_finds_the_same_point(order, augmentation, start, tmp_path):
    """With the augmentation that the program chooses (0), and with one an eighth of the stiffness of the beam."""
    text = paper(order, ORDERS[order], augmentation)
    newton = read(solve(text, tmp_path, name="newton"), "coefficients")
    options = ("--set", "solver%method='broyden'", "--set", f"solver%first_jacobian='{start}'")
    result = solve(text, tmp_path, *options, "--set", "solver%max_iterations=300", name="broyden")
    coefficients, residual = read(result, "coefficients", "residual")
    assert largest_difference(coefficients, newton) <= SAME_POINT
    assert residual[0] < LARGEST_RESIDUAL


@pytest.mark.parametrize("augmentation", [1e5, 1e7])
@pytest.mark.parametrize("order", ORDERS)
def test_broyden_from_the_tangent_bears_a_large_augmentation(order, augmentation, tmp_path):
    text = paper(order, ORDERS[order], augmentation)
    newton = read(solve(text, tmp_path, name="newton"), "coefficients")
    options = ("--set", "solver%method='broyden'", "--set", "solver%first_jacobian='tangent'")
    broyden = read(solve(text, tmp_path, *options, name="broyden"), "coefficients")
    assert largest_difference(broyden, newton) <= SAME_POINT


@pytest.mark.parametrize("method", ["newton", "broyden"])
@pytest.mark.parametrize("augmentation", [None, 0.0], ids=["given augmentation", "chosen augmentation"])
@pytest.mark.parametrize("length, force", [(1e-9, 1e6), (1e3, 1e-3), (1e-9, 1e-9)])
def test_units_do_not_matter(length, force, augmentation, method, tmp_path):
    law = {} if augmentation is None else {"augmentation": augmentation}
    option = ("--set", f"solver%method='{method}'")
    if method == "broyden" and augmentation is None:
        option += ("--set", "solver%first_jacobian='tangent'")
    names = ("coefficients", "force_coefficients", "penetration", "iterations", "evaluations")
    plain = read(solve(beam(5, 32, **law), tmp_path, *option, name="plain"), *names)
    scaled = read(solve(beam(5, 32, length, force, **law), tmp_path, *option, name="scaled"), *names)
    assert scaled[3] == plain[3] and scaled[4] == plain[4]
    assert largest_difference(scaled[0] / length, plain[0]) <= SAME_IN_OTHER_UNITS
    assert largest_difference(scaled[1] / force, plain[1]) <= SAME_IN_OTHER_UNITS
    assert largest_difference(scaled[2] / length, plain[2]) <= SAME_IN_OTHER_UNITS


@pytest.mark.parametrize("method", ["newton", "broyden"])
def test_linear_motion_needs_no_iteration(method, tmp_path):
    """A wall that is not reached: the first guess is the solution."""
    result = solve(beam(3, 16, gap=1.0), tmp_path, "--set", f"solver%method='{method}'")
    iterations, force = read(result, "iterations", "force_coefficients")
    assert iterations[0] == 0
    assert not force.any()


@pytest.mark.long  # seconds
def test_diverged_motion_is_not_called_converged(tmp_path):
    """Without line search Broyden's method may diverge to 1e150 m; such a residual is not a solution at any scale."""
    text = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,
   ground_stiffness = 1.0, damping_mass = 0.2 /
&tones frequency = 1.0, 1.618033988749895 /
&harmonics order = 9 /
&sampling samples = 64 /
&load dof = 'x1', tuple = 1, 0, cos = 0.4 /
&load dof = 'x1', tuple = 0, 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', gap = 0.5, stiffness = 10.0 /
&solver method = 'broyden', max_iterations = 2000, line_search = .false. /
&sweep parameter = 'harmonics%order', values = 3, 5, 7, 9 /
"""
    converged = 1
    status, residual = read(solve(text, tmp_path, status=None), "status", "residual")
    assert (residual[status == converged] < LARGEST_RESIDUAL).all()


def test_homotopy_without_corrections_ends(tmp_path):
    """Steps without corrections count as well: this curve never ends."""
    text = """
&structure type = 'matrices', n_dofs = 2, mass = 1.0, 1.0, damping = 0.1, 4.82842712474619e-6,
   stiffness = 1.0, 5.82842712474619 /
&tones frequency = 1.0, 1.414213562373095 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, 0, cos = 0.3 /
&load dof = 'x1', tuple = 0, 1, cos = 0.3 /
&law type = 'polynomial_coupled', dofs = 'x1', 'x2', coefficients = 2147483648, acts_on = 'x2',
   displacement_exponents = 2, 0 /
&solver max_iterations = 2, homotopy_iterations = 2, fallback_by_integration = .false. /
&sweep parameter = 'tones%frequency(2)', values = 1.414213562373095, 1.4142159765872 /
"""
    out_of_budget, diverged = 3, 13
    assert np.isin(read(solve(text, tmp_path, status=None), "status"), (out_of_budget, diverged)).all()
