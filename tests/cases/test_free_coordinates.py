"""Coordinates without static stiffness: their mean values are arbitrary, or they drift, which is reported."""

import h5py
import numpy as np
import pytest
from program import messages_of, read, run, solve

# A Duffing oscillator with a mass on a dashpot alone; each mass, its load and the law of the second are inserted.
DAMPER = """
&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.1, damping = 0.02, -0.02, -0.02, 0.02, stiffness = 1.0, 0.0, 0.0, 0.0 /
&tones frequency = 1.1 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&load dof = 'x1', tuple = 0, cos = {static} /
&law type = 'cubic_spring', dof = 'x1', stiffness = {stiffness!r} /
"""
FRICTION = "&law type = 'coulomb_tanh', dofs = 'x2', 'x1', weights = 1.0, -1.0, limit = 0.02, velocity = 0.01 /\n"
BEAM = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1.0, mass_per_length = 1.0, n_elements = 4,
   left_support = 'free', right_support = 'free', damping_mass = 0.3 /
&tones frequency = 3.0 /
&load dof = 'v5', tuple = 1, cos = 0.1 /
"""
FAILED, STABLE = 6, 1


def of(static=0.0, stiffness=1.0):
    return DAMPER.format(static=static, stiffness=stiffness)


@pytest.mark.parametrize("text", [of(), of(static=0.1), of() + FRICTION, of() + "&harmonics order = 5 /\n",
                                  pytest.param(BEAM + "&law type = 'cubic_spring', dof = 'v1', stiffness = 100.0 /\n",
                                               marks=pytest.mark.long)])  # fmt: skip
def test_a_motion_with_an_arbitrary_mean_value_is_found_and_stable(text, tmp_path):
    """Whether the set has a mean value or not, and on the finer grid of the error estimate."""
    path = solve(text, tmp_path)
    assert read(path, "is_stable")[0] == STABLE
    assert run("verify", path, cwd=tmp_path).status == 0
    assert "the mean value is set to zero at" in run("check", "case.nml", cwd=tmp_path).stdout


def test_derivatives_are_those_of_differences(tmp_path):
    by = "&gradient by = 'law(1)%stiffness' /\n&accuracy tolerance = 1e-9 /\n"
    found = solve(of(static=0.1) + by, tmp_path)
    with h5py.File(found) as file:
        gradient, n = file["gradient"][()].squeeze(), int(file["n_harmonics"][0])
        middle = file["coefficients"][0]
    around = []
    for stiffness in (0.999, 1.001):
        around.append(read(solve(of(static=0.1, stiffness=stiffness) + by, tmp_path), "coefficients")[0])
    difference = (around[1] - around[0]) / 0.002
    assert np.isfinite(middle[:, :n]).all()
    low = slice(0, 4)  # mean value and the lowest harmonics, the same in all sets
    assert gradient[:, low] == pytest.approx(difference[:, low], abs=1e-5 * abs(difference[:, low]).max())


@pytest.mark.parametrize(
    ("text", "dof"),
    [
        (of().replace("dof = 'x1', tuple = 0, cos = 0.0", "dof = 'x2', tuple = 0, cos = 0.1"), "x2"),
        (of(static=0.2) + FRICTION, "x2"),
        (BEAM + "&load dof = 'v2', tuple = 0, cos = 0.1 /\n", "v"),
        # a mass with friction alone is moved in one direction by two harmonics
        ("&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.02, stiffness = 0.0 /\n&tones hertz = 1.0 /\n"
         "&load dof = 'x1', tuple = 1, sin = 1.0 /\n&load dof = 'x1', tuple = 2, sin = 0.5 /\n"
         "&law type = 'coulomb_tanh', dof = 'x1', limit = 0.5, velocity = 0.05 /\n", "x1"),
    ],
)  # fmt: skip
def test_what_drifts_is_named(text, dof, tmp_path):
    path = solve(text, tmp_path, status=None)
    assert read(path, "status")[0] == FAILED
    assert f"'{dof}" in messages_of(path) and "drifts" in messages_of(path)
