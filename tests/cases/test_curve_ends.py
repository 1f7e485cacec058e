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


@pytest.mark.parametrize(("amplitude", "frequency"), [(1.7286, 0.58229918), (2.0, 0.59654305)])
def test_normal_modes_are_found_behind_a_turn_of_their_amplitude(amplitude, frequency, tmp_path):
    """By shooting along the same branch: the amplitude rises to 1.705, falls to 1.528, then rises through both."""
    text = f"""
&structure type = 'chain', n_masses = 3, ends = 'fixed-free', mass = 1, 1, 1, ground_stiffness = 0, 0, 0, damping_mass = 0.0,
   coupling_stiffness = 0.536793856317, 1.46173193966, 0.528043229856 /
&law type='polynomial', dof='x3', stiffness=0.0, 0.016353641627074592, 0.12566522937005142 /
&tones unknown=.true. /
&accuracy tolerance=0.001 /
&normal_mode dof='x3', amplitude={amplitude} /
"""
    with Results(solve(text, tmp_path)) as results:
        assert results.frequency(0)[0] == pytest.approx(frequency, rel=1e-4)


def test_normal_modes_begin_at_internal_resonances(tmp_path):
    """Two modes at 1:2 with quadratic coupling: at any amplitude both take part. Two motions by shooting."""
    text = """
&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,4.0 /
&tones unknown=.true. /
&harmonics order=9 /
&normal_mode amplitude=0.02, dof='x1', mode=1 /
&law type='polynomial_coupled', dofs='x1','x2', coefficients=0.188,-1.708,-0.854,0.049,0.098,0.433,
   acts_on='x1','x1','x2','x1','x2','x2', displacement_exponents=2,0, 1,1, 2,0, 0,2, 1,1, 0,2 /
"""
    with Results(solve(text, tmp_path)) as results:
        frequency = results.frequency(0)[0]
        assert min(abs(frequency - 0.9969549), abs(frequency - 1.0030018)) < 1e-6
