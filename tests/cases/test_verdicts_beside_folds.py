"""Verdicts beside folds of lightly damped curves, where multipliers move like the square root of an error of the motion."""

import h5py
import numpy as np
from program import solve

# Three masses and a cubic spring, damping ratio 2.5e-5; the third harmonic of order 5 errs by 7e-4 of the motion.
CHAIN = """
&structure type = 'matrices', n_dofs = 3, mass = 0.64785, 0, 0, 0, 1.89606, 0, 0, 0, 1.1056
   damping = 1.9428e-05, 0, 0, 0, 5.686e-05, 0, 0, 0, 3.3155e-05
   stiffness = 2.4404, -1.7531, 0, -1.7531, 2.49482, -0.74171, 0, -0.74171, 1.76612 /
&tones frequency = 0.48445 /
&load dof = 'x1', tuple = 1, cos = 2.2681e-4 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.98866 /
&harmonics order = 5 /
&curve parameter = 'tones%frequency', from = 0.48445, to = 1.21114, peak_of = 'x1 (1)', points = 200, max_step = 0.0614 /
"""


def test_no_motion_between_two_folds_is_called_stable(tmp_path):
    """Behind a fold one multiplier is outside the unit circle, until the next one."""
    with h5py.File(solve(CHAIN, tmp_path, status=None)) as file:
        kinds, statuses = (
            np.array(file[name].attrs["flag_meanings"].split())[file[name][:]] for name in ("curve_kind", "status")
        )
        verdicts = file["is_stable"][:]
    first, second = np.flatnonzero(kinds == "fold")[:2]
    assert second - first > 10
    between = slice(first + 1, second)
    assert not np.any((verdicts[between] == 1) & (statuses[between] == "converged"))
