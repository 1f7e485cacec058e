"""Where curves end, why, and that no step leads to another part of them."""

import numpy as np
import pytest
from nhbm_post.reader import Results

from program import solve

def values_at(results: Results, kind: str) -> np.ndarray:
    """Values along the curve at its points of a kind."""
    return results.curve.values[results.select({"curve_kind": kind})]


def test_no_step_leads_to_the_part_of_opposite_phase(tmp_path):
    """With hardly any damping both parts beside the lower fold, and the axis beyond it, are closer than a step. The peak is that
    of the first part."""
    text = """
&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=4.507e-05 /
&tones frequency=0.5 /
&harmonics order=9 /
&load dof='x1', tuple=1, cos=0.0005737 /
&law type='cubic_spring', dof='x1', stiffness=0.266 /
&curve parameter='tones%frequency', from=0.5, to=6.0, peak_of='x1 (1)', points=2500, max_step=0.08 /
"""
    with Results(solve(text, tmp_path)) as results:
        assert len(values_at(results, "fold")) == 2
        assert values_at(results, "end")[-1] == 6.0
        assert values_at(results, "peak") == pytest.approx([2.495], rel=5e-3)
