"""Fewer unknowns where laws feel fewer coordinates than they have degrees of freedom: the same motion.

Surfaces over hypertime need every degree of freedom of the laws by itself, so a scene that asks for them is solved without.
"""

import numpy as np
import pytest

from program import read, solve

SAME = 1e-11
NAMES = ("coefficients", "force_coefficients", "corrected_coefficients", "power_laws", "status")
MODES = """
&structure type = 'matrices', n_dofs = 3, mass = 1.0, 0.8, 1.2, stiffness = 2.0, 3.0, 5.0, damping_stiffness = 0.05 /
&tones frequency = 0.9, 1.4 /
&harmonics order = 4 /
&load dof = 'x1', tuple = 1, 0, cos = 1.0 /
&load dof = 'x3', tuple = 0, 1, cos = 0.7, sin = 0.3 /
&certificate truncation = 10.0, aliasing = 10.0, penetration = 10.0, impact = 10.0 /
&solver method = 'newton' /
&output dofs = 'x3', 'x1' /
"""  # steps from products end as soon as the tolerance is met, Newton's are exact by then
POINT = "dofs = 'x1', 'x2', 'x3', weights = 1.0, -0.5, 0.8"
OTHER_POINT = "dofs = 'x1', 'x3', weights = 0.3, 1.0"
LAWS = {
    "stop": f"&law type = 'elastic_stop', {POINT}, stiffness = 5.0, gap = 0.2 /",
    "wall": f"&law type = 'rigid_wall', {POINT}, gap = 0.3 /",
    "rigid friction": f"&law type = 'coulomb_rigid', {POINT}, limit = 0.2 /",
    "slider": f"&law type = 'jenkins', {POINT}, stiffness = 1.0, limit = 0.2 /",
    "two laws at one point": f"&law type = 'cubic_spring', {POINT}, stiffness = 1.0 /\n"
    f"&law type = 'van_der_pol', {POINT}, strength = -0.1 /",
    "two points": f"&law type = 'elastic_stop', {POINT}, stiffness = 5.0, gap = 0.2 /\n"
    f"&law type = 'quadratic_damping', {OTHER_POINT}, coefficient = 0.2 /",
}


@pytest.mark.parametrize("law", LAWS)
def test_the_motion_is_that_of_all_degrees_of_freedom(law, tmp_path):
    scene = MODES + LAWS[law]
    smaller = read(solve(scene, tmp_path, name="smaller"), *NAMES)
    whole = read(solve(scene, tmp_path, "--set", "output%samples=16", name="whole"), *NAMES)
    for name, own, other in zip(NAMES, smaller, whole):
        assert own.shape == other.shape
        assert np.max(np.abs(own - other)) <= SAME * np.max(np.abs(other)), name
