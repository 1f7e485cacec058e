"""Where curves end, why, and that no step leads to another part of them."""

import re

import numpy as np
import pytest
from nhbm_post.reader import Results

from curve_models import DUFFING
from program import NOT_ALL_CONVERGED, coefficients_by_tuple, read, run, solve

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


def test_curves_of_folds_end_where_two_merge(tmp_path):
    """Below the load of the cusp the response has one value at every frequency."""
    text = (
        DUFFING + "&curve parameter='load(1)%cos', from=0.18, to=0.02, follow='fold', over='tones%frequency', over_from=0.5,\n"
        "   over_to=2.5 /\n"
    )
    path = solve(text, tmp_path)
    said = run("info", path.name, cwd=tmp_path).stdout
    assert "two folds merge" in said, said
    with Results(path) as results:
        last = results.used[-1]
        assert results.status_name(last) == "converged"
        assert any("two folds merge" in text for text in results.curve_ends())


@pytest.mark.parametrize(("over_to", "step"), [(1.2481, 0.0404), (1.4623, 0.0368), (1.3, 0.04)])
def test_followed_folds_end_where_they_leave_the_range(over_to, step, tmp_path):
    """However close to the end of the range the last of them is."""
    text = (
        DUFFING.replace("cos = 0.18", "cos = 0.1")
        + "&curve parameter='load(1)%cos', from=0.1, to=1.0, follow='fold', over='tones%frequency', over_from=0.7,\n"
        f"   over_to={over_to}, max_step={step}, points=200 /\n"
    )
    with Results(solve(text, tmp_path)) as results:
        last = results.used[-1]
        assert results.status_name(last) == "converged"
        assert "leaves the range of 'over'" in results.message(last)
        assert results.per_point("curve_over")[last] == pytest.approx(over_to, rel=1e-4)


def test_curves_of_bifurcations_end_at_resonances(tmp_path):
    """Neimark-Sacker points of a forced van der Pol oscillator end on a fold, where the multipliers meet at 1."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.0, stiffness=1.0 /
&tones frequency=1.0 /
&harmonics order=7 /
&law type='van_der_pol', dof='x1', strength=0.3 /
&load dof='x1', tuple=1, cos=0.4 /
&curve parameter='load(1)%cos', from=0.4, to=0.05, follow='neimark_sacker', over='tones%frequency', over_from=0.7, over_to=1.3 /
"""
    with Results(solve(text, tmp_path)) as results:
        assert "1:1 resonance" in results.message(results.used[-1])


def test_curves_of_unreliable_motions_end(tmp_path):
    """A stiff stop with one harmonic: the errors are as large as the motions, so the curve does not use up its rows."""
    text = """
&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1 /
&tones frequency=1.0 /
&harmonics order=1 /
&load dof='x1', tuple=1, cos=1.0 /
&law type='elastic_stop', dof='x1', stiffness=1e4, gap=0.01 /
&curve parameter='tones%frequency', from=1.0, to=2.0, points=1000, max_step=0.002, peak_of='x1' /
"""
    path = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    with Results(path) as results:
        last = results.used[-1]
        assert results.status_name(last) == "out_of_budget" and "too large to be meaningful" in results.message(last)
        assert len(results.used) < 100
    said = run("why", path.name, cwd=tmp_path).stdout
    assert "oversampling" not in said, said


def test_curves_far_above_their_tolerance_end(tmp_path):
    """Eight harmonics for a stop like a wall: no row is near the tolerance, and the budget of each would be spent in vain."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.05, stiffness=1.0 /
&tones frequency=3.0 /
&load dof='x1', tuple=1, cos=1.0 /
&law type='elastic_stop', dof='x1', stiffness=2000.0, gap=0.0 /
&accuracy tolerance=1e-3, max_harmonics=8 /
&curve parameter='tones%frequency', from=0.4, to=3.0, start=3.0 /
"""
    path = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    with Results(path) as results:
        last = results.used[-1]
        assert results.status_name(last) == "out_of_budget" and "more than ten times the tolerance" in results.message(last)
        assert len(results.used) < 200


def test_a_curve_from_its_other_end_stays_within_its_range(tmp_path):
    """No motion is found at 3.0, and 0.6 + 3.0 - 3.0 is not 0.6 in binary numbers: the curve was followed below 0.6, too."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, stiffness=-0.8460, damping_mass=0.02823 /
&tones frequency=1.0 /
&load dof='x1', tuple=1, cos=1.7124 /
&load dof='x1', tuple=0, cos=0.5923 /
&law type='cubic_spring', dof='x1', stiffness=1.0 /
&accuracy tolerance=3e-2 /
&curve parameter='tones%frequency', from=0.6, to=3.0, start=3.0 /
"""
    path = solve(text, tmp_path)
    with Results(path) as results:
        values = results.curve.values[results.used]
        assert "begins at the other end" in results.message(0)
    assert values[0] == values[-1] == 0.6 and values.min() == 0.6 and values.max() > 0.61


def test_motions_beside_a_fold_at_a_graze_are_unstable(tmp_path):
    """Before the fold a second contact is shorter than the errors of the motion. Its multipliers were at times those of the stable
    motion without it, behind the fold: `stable` amid unstable points."""
    text = """
&structure type='matrices', n_dofs=3, mass=0.9611,-0.00407,-0.0072,-0.00407,1.9368,0.0169,-0.0072,0.0169,1.6555,
   damping=0.01032,-0.00433,0.0,-0.00433,0.0171,-0.0054,0.0,-0.0054,0.02036,
   stiffness=1.3616,-0.8783,0.0,-0.8783,1.9919,-1.1137,0.0,-1.1137,2.8715 /
&tones frequency=1.1 /
&law type='elastic_stop', dofs='x1','x3', weights=1,-1, stiffness=30.0, gap=0.0454 /
&load dof='x2', tuple=1, cos=0.224 /
&load dof='x1', tuple=3, cos=0.0861 /
&accuracy tolerance=1e-3 /
&curve parameter='tones%frequency', from=0.7413, to=1.1, max_step=0.03 /
"""
    path = solve(text, tmp_path)
    with Results(path) as results:
        assert len(values_at(results, "fold")) >= 2
    assert "no bifurcation was located" not in run("info", path.name, cwd=tmp_path).stdout


@pytest.mark.parametrize("load, max_step, values", [
    pytest.param(0.0413, 0.04, [1.09296, 1.09366], marks=pytest.mark.long),  # within one step, with one sign of the determinant
    (0.2, 0.004, [1.6855495, 1.2598894]),  # the crossing branch is farther away than a thousandth of a short step
])  # fmt: skip
def test_branch_points_are_located(load, max_step, values, tmp_path):
    text = f"""
&structure type='matrices', n_dofs=2, mass=1.0,0.0,0.0,1.0, damping=0.05,0.0,0.0,0.05, stiffness=1.05,-0.05,-0.05,1.05 /
&tones frequency=0.6 /
&harmonics order=7 /
&load dof='x1', tuple=1, cos={load} /
&load dof='x2', tuple=1, cos={load} /
&law type='cubic_spring', dof='x1', stiffness=1.0 /
&law type='cubic_spring', dof='x2', stiffness=1.0 /
&curve parameter='tones%frequency', from=0.6, to=3.0, points=3000, max_step={max_step} /
"""
    path = solve(text, tmp_path)
    with Results(path) as results:
        assert values_at(results, "branch") == pytest.approx(values, rel=1e-5)
    assert "no bifurcation was located" not in run("info", path.name, cwd=tmp_path).stdout


def test_closed_branches_are_traced_once(tmp_path):
    """Two equal oscillators: the motions in which they differ form one closed curve through both branch points."""
    text = """
&structure type='matrices', n_dofs=2, mass=1.0,1.0, damping=0.05,0.0,0.0,0.05, stiffness=1.05,-0.05,-0.05,1.05 /
&tones frequency=0.6 /
&harmonics order=11 /
&load dof='x1', tuple=1, cos=0.2 /
&load dof='x2', tuple=1, cos=0.2 /
&law type='cubic_spring', dof='x1', stiffness=1.0 /
&law type='cubic_spring', dof='x2', stiffness=1.0 /
&curve parameter='tones%frequency', from=0.6, to=3.0, points=3000, switch=.true. /
"""
    path = solve(text, tmp_path)
    assert "no bifurcation was located" not in run("info", path.name, cwd=tmp_path).stdout, "a branch starts at one"
    with Results(path) as results:
        branches = results.per_point("curve_branch")[results.used]
        assert values_at(results, "branch") == pytest.approx([1.685549526, 1.259889455], rel=1e-7)
        assert set(branches) == {0, 1}
        starts = results.select({"curve_kind": "start"})
        assert len(starts) == 2, "that of the curve and that of the branch"


def test_doubled_periods_end_where_they_halve(tmp_path):
    """Between two period doublings of the motion of one period: beyond the second the same motions would follow, a period later."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.1, stiffness=1.0 /
&tones frequency=3.6 /
&harmonics order=30 /
&load dof='x1', tuple=1, cos=1.0 /
&law type='elastic_stop', dof='x1', stiffness=12.0, gap=0.1 /
&curve parameter='tones%frequency', from=3.6, to=2.0, points=600, switch=.true. /
"""
    path = solve(text, tmp_path)
    [doubled] = [other for other in tmp_path.glob("*_*.h5") if other != path]
    with Results(doubled) as results:
        assert values_at(results, "end")[-1] == pytest.approx(2.248613591, abs=1e-5)
        assert values_at(results, "period_doubling") == pytest.approx([2.500778224, 2.397966151], rel=1e-5)


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


@pytest.fixture(scope="module")
def entrained(tmp_path_factory):
    """Motions of a van der Pol oscillator of three periods of the load, along the curve of their frequency."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, stiffness=1.0 /
&tones frequency=0.995 /
&harmonics order=15 /
&load dof='x1', tuple=3, cos=0.9 /
&law type='van_der_pol', dof='x1', strength=0.3 /
&start dof='x1', tuple=1, cos=2.0 /
&curve parameter='tones%frequency', start=0.995, from=0.97, to=1.02 /
"""
    return solve(text, tmp_path_factory.mktemp("entrained"))


def test_tori_end_where_their_tones_lock(entrained, tmp_path):
    """A forced van der Pol oscillator near three times its frequency: its torus ends at a fold of the entrained motion of three
    periods, which it approaches ever more slowly."""
    torus = solve(
        """
&structure type='matrices', n_dofs=1, mass=1.0, stiffness=1.0 /
&law type='van_der_pol', dof='x1', strength=0.3 /
&tones frequency=2.9, 0.993, unknown=.false., .true. /
&accuracy tolerance=1e-2 /
&load dof='x1', tuple=1,0, cos=0.9 /
&curve parameter='tones%frequency(1)', from=2.9, to=4.5 /
""",
        tmp_path,
        name="torus",
    )
    with Results(torus) as results, Results(entrained) as one_tone:
        last = results.used[-1]
        assert results.status_name(last) == "locked"
        message = results.message(last)
        assert "(1,-3)" in message, message
        [value] = re.findall(r"near the value ([\d.]+)", message)
        assert float(value) == pytest.approx(3.0 * values_at(one_tone, "fold").min(), rel=2e-5)
        assert len(results.used) < 100


def test_closed_curves_of_several_periods_are_traced_once(entrained):
    """Entrained motions of three periods of the load: after a third of the way round the same motions follow, a period later."""
    with Results(entrained) as results:
        assert values_at(results, "fold") == pytest.approx([1.002760326, 0.9858923797], rel=1e-7)
        assert values_at(results, "end") == pytest.approx([0.995])


def test_curves_that_turn_back_end_at_their_first_fold(tmp_path):
    """Motions of two periods of the load: their branch passes a fold, meets the motions of one period, and would return along the
    same motions, a period later."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.1, stiffness=1.0 /
&tones frequency=1.05 /
&harmonics order=9 /
&load dof='x1', tuple=2, cos=1.0 /
&law type='polynomial', dof='x1', stiffness=0.0, 0.5, 1.0 /
&start dof='x1', tuple=1, cos=0.4, sin=0.4 /
&curve parameter='tones%frequency', start=1.05, from=1.05, to=2.0 /
"""
    with Results(solve(text, tmp_path)) as results:
        folds, last = results.select({"curve_kind": "fold"}), results.used[-1]
        first, middle, again = values_at(results, "fold")
        assert again == pytest.approx(first, rel=1e-8) and middle < first
        assert values_at(results, "end") == pytest.approx([first], rel=1e-8)
        assert "returns to this fold" in results.message(last)
        one, shifted = (coefficients_by_tuple(results.path, point) for point in (folds[0], folds[-1]))
        for tuple_, pair in one.items():
            assert shifted[tuple_] == pytest.approx([(-1) ** tuple_[0] * value for value in pair], abs=1e-6)


def test_curves_whose_steps_use_up_their_work_end(tmp_path):
    """Steps of a curve have the limit of work of a point; ten in a row that reach it above the tolerance end the curve."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.05, stiffness=1.0 /
&tones frequency=3.0 /
&load dof='x1', tuple=1, cos=1.0 /
&law type='elastic_stop', dof='x1', stiffness=50.0, gap=0.5 /
&accuracy tolerance=1e-6, max_work=1e-3 /
&solver max_fallback_work=1e-3 /
&curve parameter='tones%frequency', from=0.4, to=3.0, start=3.0 /
"""
    path = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    with Results(path) as results:
        last = results.used[-1]
        assert results.status_name(last) == "out_of_budget" and "max_work" in results.message(last)
        assert [results.status_name(point) for point in results.used[-11:-1]] == 10*["truncated"]


# `tests/campaigns/curves --seed 91101 --first 23`: an annular clearance and friction, whose kinks are closer than any step
CIRCLING = """
&structure type='matrices', n_dofs=3, mass=0.8212557504231407,0.07478061830259669,-0.007036507619602483,0.07478061830259669,
   1.92466513342953,-0.10730124117472342,-0.007036507619602483,-0.10730124117472342,0.923794064668919,
    stiffness=4.448880415308979,-1.3401841170851077,3.104209544641494,-1.3401841170851077,1.966998289225249,
   -1.5084283123034739,3.104209544641494,-1.5084283123034739,4.578847083225494, damping_mass=0.005767875145114082,
    damping_stiffness=0.0 /
&tones frequency=1.028661406366894 /
&harmonics order=25 /
&law type='annular_clearance', dofs='x1','x3', stiffness=14.816757002215315, clearance=0.7186320058080741 /
&law type='jenkins', dof='x3', stiffness=0.7809362257246167, limit=0.3330411986346336 /
&load dof='x1', tuple=1, cos=-0.38218455340794044, sin=0.8631107442933693 /
&curve parameter='tones%frequency', from=0.3406335278114423, to=1.9586427849157928, points=300, peak_of='x2 (1)',
    minimum_of='x1', amplitude_of='x1', amplitudes=0.6940939018531439 /
"""


def test_a_curve_that_circles_between_kinks_is_given_up_by_name(tmp_path):
    with Results(solve(CIRCLING, tmp_path, status=NOT_ALL_CONVERGED)) as results:
        last = results.used[-1]
        assert results.status_name(last) == "out_of_budget"
        assert "folds that it passed were not located" in results.message(last)


@pytest.mark.parametrize("n_points", [28, 36, 40])
def test_a_resumed_curve_has_the_folds_that_were_not_located(n_points, tmp_path):
    """The whole curve ends because of them, wherever it was interrupted."""
    whole = solve(CIRCLING, tmp_path, name="whole", status=NOT_ALL_CONVERGED)
    part = solve(CIRCLING.replace("points=300", f"points={n_points}"), tmp_path, status=None, name="part")
    assert run("resume", part.name, "--set", "curve%points=300", cwd=tmp_path).status == NOT_ALL_CONVERGED
    for name in ("status", "curve_kind", "curve_extreme", "curve_length", "frequency", "coefficients"):
        np.testing.assert_array_equal(read(part, name), read(whole, name))
