"""Newton's method with products only finds the same motions as with the dense tangent, in every case of the paper and the
gallery."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from input_cases import INPUTS, input_case
from program import read, run

INTEGRATED = ("bouncing_curve",)  # a curve with impacts has no tangent
FILES = sorted(file for folder in ("paper", "gallery") for file in INPUTS.glob(f"{folder}/*.nml") if file.stem not in INTEGRATED)

# Of the largest coefficient of a point; both solvers stop at a residual of 1e-12.
SAME_POINT = 1e-10
# Located points of curves, such as peaks, are defined by a zero of a function of the motion; steps of a branch that begins at one
# are counted from there. Along the curve they may differ by more, but not across it.
SAME_EVENT = 1e-8
# Seconds each, like others of their kind: separate curves and curves after branch points, limit cycles that are driven or rub.
LONG_CURVES = tuple(file.stem for file in FILES if "\n&curve" in file.read_text())
LONG_CYCLES = ("forced_van_der_pol", "locked_van_der_pol", "one_sided_spring", "rotor_stator", "rotor_stator_friction")
NEIGHBOURS = 4  # of a point: the ways to them span the tangent to fourth order
START = 2
LOCATED = [3, 4, 7, 8, 9, 10, 11]  # fold, peak, branch, flip, torus, split, graze


def solved(source: Path, method: str, folder: Path) -> tuple[np.ndarray, ...]:
    """Coefficients, statuses, and the branch of each point that may be elsewhere on its curve; 0: none."""
    result = folder / f"{method}.h5"
    settings = (
        f"solver%method='{method}'",
        "solver%tolerance=1e-12",
        "error_estimate%is_on=.false.",  # neither asks the solver
        "stability%method='off'",
    )
    options = [word for setting in settings for word in ("--set", setting)]
    done = run("solve", source, "--output", result, *options, cwd=folder)
    assert "converged" in done.stdout, done.stderr
    coefficients, status = read(result, "coefficients", "status")
    with h5py.File(result, "r") as file:
        kinds = file["curve_kind"][()].ravel() if "curve_kind" in file else np.zeros(status.size, dtype=int)
    branch = np.cumsum(kinds == START)
    return coefficients, status, np.where(np.isin(kinds, LOCATED) | (branch > 1), branch, 0)  # the first start is that of the input


def across(difference: np.ndarray, points: np.ndarray, point: int) -> np.ndarray:
    """The part of a difference perpendicular to the curve."""
    neighbours = sorted(range(len(points)), key=lambda other: abs(other - point))[1 : NEIGHBOURS + 1]
    ways = (points[neighbours] - points[point]).T
    return difference - ways @ np.linalg.lstsq(ways, difference, rcond=1e-13)[0]


@pytest.mark.parametrize("source", [input_case(file, LONG_CURVES) for file in FILES])
def test_krylov_agrees_with_dense_newton(source, tmp_path):
    newton, newton_status, branch = solved(source, "newton", tmp_path)
    krylov, krylov_status, _ = solved(source, "krylov", tmp_path)
    assert krylov_status.ravel().tolist() == newton_status.ravel().tolist()
    assert (np.isnan(krylov) == np.isnan(newton)).all()  # harmonics that a point does not have, rows that a curve did not need
    points = newton.reshape(newton_status.size, -1)
    is_used = ~np.isnan(points).all(axis=1)
    assert is_used.any()
    differences = np.nan_to_num(krylov.reshape(points.shape) - points)[is_used]
    points, branch = np.nan_to_num(points[is_used]), branch[is_used]
    for i in np.flatnonzero(branch):
        assert np.abs(differences[i]).max() <= SAME_EVENT * np.abs(points[i]).max()
        own = np.flatnonzero(branch == branch[i]) if branch[i] > 1 else np.arange(len(points))
        differences[i] = across(differences[i], points[own], int(np.searchsorted(own, i)))
    assert (np.abs(differences).max(axis=1) <= SAME_POINT * np.abs(points).max(axis=1)).all()


def test_large_sets_are_solved_by_products(tmp_path):
    """Three tones of order 5 on a stop, 1331 unknowns: the default is not the dense tangent, and finds the same motion."""
    text = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.4, stiffness = 1.0 /
&tones frequency = 1.0, 1.618033988749895, 0.7320508075688772 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, 0, 0, cos = 0.4 /
&load dof = 'x1', tuple = 0, 1, 0, cos = 0.4 /
&load dof = 'x1', tuple = 0, 0, 1, cos = 0.3 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 2.0, gap = 0.5 /
"""
    source = tmp_path / "stop.nml"
    source.write_text(text)
    results = {}
    for method in ("auto", "krylov", "newton"):
        results[method], status, _ = solved(source, method, tmp_path)
        assert status.ravel().tolist() == [1]
    assert (results["auto"] == results["krylov"]).all()
    assert np.abs(results["auto"] - results["newton"]).max() <= SAME_POINT * np.abs(results["newton"]).max()


def test_chain_of_stops_is_solved_as_a_band(tmp_path):
    """A stop on each of 120 masses: nothing is condensed, all matrices of the structure remain narrow."""
    lines = [
        "&structure type = 'chain', n_masses = 120, ends = 'fixed', mass = 1.0, coupling_stiffness = 4.0,",
        "   ground_stiffness = 1.0, damping_mass = 0.2 /",
        "&tones frequency = 1.1 /\n&harmonics order = 5 /",
        "&load dof = 'x20', tuple = 1, cos = 1.0 /\n&load dof = 'x90', tuple = 1, sin = 1.0 /",
    ]
    lines += [f"&law type = 'elastic_stop', dof = 'x{i}', stiffness = 5.0, gap = {0.1 + 0.001 * i} /" for i in range(1, 121)]
    source = tmp_path / "chain.nml"
    source.write_text("\n".join(lines) + "\n")
    newton, status, _ = solved(source, "newton", tmp_path)
    assert status.ravel().tolist() == [1]
    krylov, status, _ = solved(source, "krylov", tmp_path)
    assert status.ravel().tolist() == [1]
    assert np.abs(krylov - newton).max() <= SAME_POINT * np.abs(newton).max()


AUTONOMOUS = sorted(INPUTS.glob("autonomous/*.nml"))


@pytest.mark.parametrize("source", [input_case(file, LONG_CYCLES) for file in AUTONOMOUS])
def test_unknown_tones_agree_with_dense_newton(source, tmp_path):
    """The search takes the same path, whether the bordered tangent is factorised or used in products."""
    found = {}
    for method in ("newton", "krylov"):
        result = tmp_path / f"{method}.h5"
        done = run("solve", source, "--output", result, "--set", f"solver%method='{method}'", cwd=tmp_path)
        assert "converged" in done.stdout, done.stderr
        found[method] = read(result, "status", "frequency", "truncation_estimate", "residual")
    status, frequencies, truncation, _ = found["newton"]
    residual = max(float(np.max(found[method][3][status == 1], initial=0.0)) for method in found)  # to which each was solved
    assert found["krylov"][0].ravel().tolist() == status.ravel().tolist()
    np.testing.assert_allclose(found["krylov"][1][status == 1], frequencies[status == 1], rtol=max(1e-9, residual))
    np.testing.assert_allclose(found["krylov"][2][status == 1], truncation[status == 1], rtol=1e-4, atol=1e-12)
