"""With more harmonics the result of a contact case converges to the motion of time integration."""

import numpy as np
import pytest
from nhbm_post.reader import Results

from program import NOT_ALL_CONVERGED, solve

# One mass at an elastic stop under two tones, inputs/gallery/elastic_stop_two_tones.nml.
MODEL = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,
   ground_stiffness = 1.0, damping_mass = 0.2 /
&tones frequency = 1.0, 1.618033988749895 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, 0, cos = 0.4 /
&load dof = 'x1', tuple = 0, 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', gap = 0.5, stiffness = 10.0 /
&solver first_guess = 'zero' /
&sweep parameter = 'harmonics%order', values = 5, 9, 13, 17, 21, axis = 1 /
&sweep parameter = 'sampling%samples', values = 64, 128, 192, 256, 256, axis = 1 /
"""

# Time integration, contact found as an event, and Fourier coefficients over hypertime: (cos, sin).
INTEGRATED = {
    (0, 0): (-0.20334727152247, 0.0),
    (1, 0): (0.62198242428873, 0.23632950152279),
    (0, 1): (-0.34135917761406, 0.13342729526516),
    (1, -1): (0.17872615537078, 0.12571711125539),
    (1, 1): (-0.04362872589981, 0.01274249426881),
    (2, 0): (0.07982706095386, 0.05150941687052),
    (2, -1): (0.00810698665249, 0.04650284834983),
    (3, 0): (0.01029472996623, 0.01959629382110),
}
INTEGRATED_RMS = 0.60617905978886

# The force has kinks, so the error falls with about the third power of the order.
LARGEST_ERROR_AT_5 = 1.2e-2


@pytest.mark.long
def test_elastic_stop_tends_to_the_integrated_motion(tmp_path):
    with Results(solve(MODEL, tmp_path, status=NOT_ALL_CONVERGED)) as results:  # orders 5 and 9 are truncated
        orders = results.parameter("harmonics%order").values
        for point, order in enumerate(orders):
            found = np.array([results.coefficients(point, "x1", j) for j in INTEGRATED])
            error = np.abs(found - np.array(list(INTEGRATED.values()))).max()
            assert error <= LARGEST_ERROR_AT_5 * (5.0 / order) ** 3, order
        assert abs(results.series(len(orders) - 1, "x1").rms - INTEGRATED_RMS) <= 1e-4 * INTEGRATED_RMS
