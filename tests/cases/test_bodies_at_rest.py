"""Bodies that rest in contact do not move."""

import numpy as np
import pytest
from program import read, solve

CONVERGED, INTEGRATED = 1, 18

RESTING = """
&structure type = 'matrices', n_dofs = 1, mass = {mass}, stiffness = {stiffness}, damping = {damping} /
&tones frequency = {frequency} /
&load dof = 'x1', tuple = 1, cos = {amplitude} /
&load dof = 'x1', tuple = 0, cos = {force} /
&law type = 'rigid_wall', label = 'wall', dof = 'x1', gap = {gap}, restitution = {restitution} /
"""


@pytest.mark.parametrize(
    ("stiffness", "damping", "amplitude", "force", "gap"),
    [
        (1.0, 0.1, 0.5, 1.0, 0.0),  # pressed against a wall that is touched
        (1.0, 0.1, 0.3, 1.0, 0.4),  # pressed against one behind a gap
        (0.0, 0.0, 0.5, 1.0, 0.0),  # a free body on a support
    ],
)
@pytest.mark.parametrize("unit", [pytest.param(1.0, marks=pytest.mark.long), 1e-5])
def test_a_body_that_is_pressed_against_a_wall_rests_there(stiffness, damping, amplitude, force, gap, unit, tmp_path):
    text = RESTING.format(mass=1.0, stiffness=stiffness, damping=damping, frequency=1.0, amplitude=amplitude * unit,
                          force=force * unit, gap=gap * unit, restitution=0.5)
    path = solve(text, tmp_path, status=None)
    status, motion, tuples = read(path, "status", "coefficients", "tuples")
    assert status[0] in (CONVERGED, INTEGRATED), read(path, "message")
    assert tuples[0, 0] == 0 and motion[0, 0, 0, 0] == pytest.approx(gap * unit, abs=1e-6 * unit)
    assert np.nanmax(abs(motion[0, 0, 1:])) < 1e-6 * unit
