"""Curves by tolerance: sets, folds and bifurcations along them, and how they go on after interruptions."""

import functools
import re
import shutil

import h5py
import numpy as np
import pytest
from nhbm_post.reader import Results

from curve_models import FOLD, PENDING, SOLUTION, STOP, UNUSED, assert_same_bits
from program import ALL_CONVERGED, read, run, solve


@pytest.fixture(scope="module")
def by_tolerance(tmp_path_factory):
    return solve(STOP + "&sweep parameter = 'law%gap', values = 1.0, 1.2 /\n", tmp_path_factory.mktemp("by_tolerance"))


def test_sets_along_a_curve_follow_the_tolerance(by_tolerance):
    """Folds: the first by the same curve to 1e-6, the second, which is close to the loss of contact, also without a tolerance."""
    names = ("status", "curve_kind", "n_harmonics", "truncation_estimate", "aliasing_estimate", "tones_frequency")
    status, kind, n_harmonics, truncation, aliasing, frequency = (a[:300] for a in read(by_tolerance, *names))
    used = status != UNUSED
    assert (status[used] == 1).all()
    assert np.nanmax(np.hypot(truncation[used], aliasing[used])) <= 1e-3
    folds = frequency[kind == 3]
    assert np.allclose(folds, [0.763852, 0.673056730], rtol=1e-5), folds
    assert (n_harmonics[(kind > 0) & (frequency < 0.55)] == 8).all()
    assert n_harmonics.max() > 20 and n_harmonics[used][-1] == 8


ONE_STOP = """
&structure type = 'chain', n_masses = 1, mass = 1.0, coupling_stiffness = 1.0, ground_stiffness = 0.5, damping_mass = 0.02,
   ends = 'free' /
&tones frequency = 1.6 /
&load dof = 'x1', tuple = 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 27.2, gap = 0.633 /
&curve parameter = 'tones%frequency', from = 1.6, to = 0.3, points = 600, peak_of = 'x1' /
"""


@pytest.mark.long  # seconds
def test_folds_and_peaks_are_those_of_a_fine_tolerance(tmp_path):
    """The curve to 1e-2 is wavy: its discretisation has additional folds."""
    events = []
    for tolerance in ("1e-2", "1e-4"):
        (tmp_path / tolerance).mkdir()
        path = solve(ONE_STOP + f"&accuracy tolerance = {tolerance} /\n", tmp_path / tolerance)
        with Results(path) as results:
            events.append([results.curve.values[results.select({"curve_kind": kind})].tolist() for kind in ("fold", "peak")])
    assert [len(places) for places in events[1]] == [6, 3]
    for coarse, fine in zip(*events):
        assert coarse == pytest.approx(fine, rel=2e-3)


def test_errors_of_bifurcations_are_those_of_their_multipliers(tmp_path):
    """Small errors of the motion move a multiplier much: the doubling of the period is off by more than the motion."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, stiffness=-0.0395, damping_mass=0.18255 /
&tones frequency=1.0 /
&load dof='x1', tuple=1, cos=7.4518 /
&load dof='x1', tuple=0, cos=0.0934 /
&law type='cubic_spring', dof='x1', stiffness=1.0 /
&curve parameter='tones%frequency', from=0.6, to=0.7, start=0.6 /
"""
    found = []
    for tolerance in ("1e-5", "1e-2"):
        (tmp_path / tolerance).mkdir()
        path = solve(text + f"&accuracy tolerance = {tolerance} /\n", tmp_path / tolerance)
        names = ("tones_frequency", "truncation_estimate", "level_estimate", "stability_estimate")
        with Results(path) as results:
            (row,) = results.select({"curve_kind": "period_doubling"})
        found.append([column[row] for column in read(path, *names)])
    (truth, *_), (frequency, of_motion, estimate, of_multipliers) = found
    assert abs(frequency / truth - 1) > of_motion
    assert estimate == pytest.approx(abs(frequency / truth - 1), rel=0.5)
    assert of_multipliers > 0.03


def test_errors_of_folds_are_those_of_their_values(tmp_path):
    """Two stops at a superharmonic resonance: the fold moves along the frequency by 40 times the error of its motion."""
    text = """
&structure type='matrices', n_dofs=2, mass=1,1, stiffness=1.6409476,-0.64094764, -0.64094764,1.0221997,
   damping=0.065637906,-0.025637906, -0.025637906,0.040887989 /
&tones frequency=0.35 /
&load dof='x1', tuple=1, cos=0.7461 /
&law type='elastic_stop', dof='x2', gap=0.10381, stiffness=12.661 /
&law type='elastic_stop', dof='x2', gap=-0.42042, stiffness=8.194 /
&stability method='off' /
&curve parameter='tones%frequency', from=0.35, to=0.4, points=30, peak_of='x2' /
&accuracy tolerance=1e-2 /
"""
    names = ("tones_frequency", "truncation_estimate", "level_estimate")
    path = solve(text, tmp_path)
    with Results(path) as results:
        row = results.select({"curve_kind": "fold"})[0]
    frequency, of_motion, estimate = (column[row] for column in read(path, *names))
    error = abs(frequency / 0.3752391 - 1)  # the fold by a tolerance of 1e-5
    assert error > 10 * of_motion
    assert estimate == pytest.approx(error, rel=0.5)


MODE = """
&structure type='chain', n_masses=2, ends='fixed', mass=1.0, coupling_stiffness=1.0 /
&tones unknown=.true. /
&law type='cubic_spring', dof='x1', stiffness=0.5 /
&normal_mode energy=0.1, mode=1 /
&curve parameter='normal_mode%energy', from=0.1, to=1e4, points=800, max_step=0.02 /
"""


@pytest.mark.parametrize("tolerance", ["1e-3", pytest.param("1e-4", marks=pytest.mark.long)])
def test_branch_points_are_found_where_the_set_grows(tolerance, tmp_path):
    """By shooting: the multiplier of the half period passes -1. The set grows close to the second and third energy: these are
    behind on the large set and ahead on the small one."""
    with Results(solve(MODE + f"&accuracy tolerance={tolerance} /\n", tmp_path)) as results:
        energies = results.curve.values[results.select({"curve_kind": "branch"})]
    assert energies == pytest.approx([40.9748, 2730.785, 6684.03], rel=3e-4)


TWO_SIDED = """
&structure type='matrices', n_dofs=1, mass=0.42702484810638125, damping=0.039705637095564364, stiffness=1.4177400819188144 /
&tones frequency=1.8220980168741574 /
&law type='elastic_stop', dof='x1', stiffness=7.67785976176595, gap=0.7606551219119453, two_sided=.true. /
&law type='cubic_spring', dof='x1', stiffness=0.5303497073300805 /
&load dof='x1', tuple=1, cos=0.8597255690663158 /
&curve parameter='tones%frequency', from=0.5466294050622472, to=5.466294050622472, points=125 /
"""


@pytest.mark.parametrize("tolerance", ["1e-3", "8e-4"])
def test_folds_are_found_where_the_set_grows(tolerance, tmp_path):
    """By 1e-3 the set grows from 17 to 30 tuples where the fold is ahead on the small set and behind on the large one."""
    with Results(solve(TWO_SIDED + f"&accuracy tolerance={tolerance} /\n", tmp_path)) as results:
        folds = results.curve.values[results.select({"curve_kind": "fold"})]
    assert folds == pytest.approx([0.76457, 0.70872], rel=3e-5)


SMALL_FOLDS = """
&structure type='matrices', n_dofs=2, mass=1,0,0,1, damping=.068,-.034,-.034,.034, stiffness=2,-1,-1,1 /
&tones frequency=.3708 /
&load dof='x1', tuple=1, cos=.12418634 /
&law type='elastic_stop', dof='x2', stiffness=9.91195, gap=.217324, two_sided=.true. /
&curve parameter='tones%frequency', from=.3708, to=2.912 /
"""


@pytest.mark.parametrize("damping", [".068,-.034,-.034,.034", ".06804624,-.03402312,-.03402312,.03402312", ".07,-.035,-.035,.035"])
def test_folds_between_both_ends_of_a_range_come_in_pairs(tmp_path, damping):
    """Two near .552 rad/s differ by 3e-4, less than the errors of their motions; one of them alone would be a fold without
    return."""
    result = solve(SMALL_FOLDS.replace(".068,-.034,-.034,.034", damping), tmp_path)
    kind, value = read(result, "curve_kind", "tones_frequency")
    assert kind[kind > 0][-1] == 6 and value[kind > 0][-1] == 2.912
    folds = value[kind == 3]
    assert len(folds) % 2 == 0, folds
    assert np.all(np.diff(folds) * (-1.0) ** np.arange(len(folds) - 1) < 0), folds


def test_a_grid_that_changes_at_a_corner_does_not_turn_the_curve_back(tmp_path):
    """Where a stiff stop is first met the curve has a corner; tangents of two grids there may be across each other."""
    text = """
&structure type='matrices', n_dofs=1, mass=1, damping=.0894, stiffness=1 /
&tones frequency=1.607 /
&load dof='x1', tuple=1, cos=.104 /
&law type='elastic_stop', dof='x1', stiffness=199.24, gap=1, two_sided=.true. /
&curve parameter='law(1)%gap', from=3.0, to=0.05 /
"""
    kind, gap = read(solve(text, tmp_path), "curve_kind", "law_1_gap")
    assert kind[kind > 0][-1] == 6
    assert gap[kind > 0][-1] == 0.05


def test_a_grid_that_grows_at_the_start_does_not_end_the_curve_there(tmp_path):
    """On the larger grid the start is slightly outside the range, into which the curve leads."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.7646741493255726, stiffness=3.0803268405594526, damping_mass=0.0042143809041063456 /
&tones frequency=2.3051469022036835 /
&accuracy tolerance=0.001 /
&law type='iwan', dof='x1', stiffness=3.080034571475491,1.8480207428852944, limit=0.05457545495794027,0.09823581892429249 /
&load dof='x1', tuple=1, cos=-0.9802993417343541, sin=0.18535806044343597 /
&curve parameter='tones%frequency', from=0.5284770468503343, to=3.038743019389422, points=6, max_step=0.1, peak_of='x1 (1)' /
"""
    kind, value = read(solve(text, tmp_path), "curve_kind", "tones_frequency")
    assert kind.tolist() == [2, 1, 1, 1, 1, 1]
    assert (np.diff(value[1:]) > 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize(("share", "responses"), [(0.33, "'x1', 'x1 (1)'"), (0.72, "'x1'")])
def test_wavy_curves_go_on_bit_by_bit(tmp_path, share, responses):
    """The events reported on a wavy peak depend on those reported before."""
    path = solve(ONE_STOP.replace("peak_of = 'x1'", f"peak_of = {responses}"), tmp_path)
    broken = shutil.copy(path, tmp_path / "broken.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][int(share * (file["status"][...] != UNUSED).sum()) :] = PENDING
    assert run("resume", broken, cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(path, broken)


@pytest.mark.long
def test_curves_by_tolerance_have_the_same_bits_on_two_ranks_and_resumed(by_tolerance, tmp_path):
    text = STOP + "&sweep parameter = 'law%gap', values = 1.0, 1.2 /\n"
    names = (*SOLUTION, "tuples", "grid", "n_harmonics")
    whole = read(by_tolerance, *names)
    others = [solve(text, tmp_path, ranks=2)]
    others.append(shutil.copy(by_tolerance, tmp_path / "ended.h5"))
    with h5py.File(others[-1], "r+") as file:
        for first, share in ((0, 0.4), (300, 0.7)):
            n_used = int((file["status"][first : first + 300] != UNUSED).sum())
            file["status"][first + int(share * n_used) : first + 300] = PENDING
    done = run("resume", others[-1], cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    for other in others:
        for name, one, two in zip(names, whole, read(other, *names)):
            assert one.tobytes() == two.tobytes(), (other, name)


UEDA = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 0.0,
   damping_mass = 0.1 /
&tones frequency = 1.0 /
&accuracy tolerance = 1e-6 /
&load dof = 'x1', tuple = 1, cos = 0.01 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&curve parameter = 'load(1)%cos', from = 0.01, to = 5.2, values = 5.0, switch = .true., points = 500 /
"""
FORCED_VAN_DER_POL = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0 /
&tones frequency = 1.2 /
&accuracy tolerance = 1e-4 /
&load dof = 'x1', tuple = 1, sin = 3.0 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.5 /
&curve parameter = 'load(1)%sin', from = 0.9, to = 0.5, switch = .true. /
"""
AT_THE_STOP = STOP[: STOP.index("&curve")].replace("frequency = 0.3", "frequency = 0.69")
BY_TOLERANCE = {
    "others": AT_THE_STOP + "&curve parameter = 'tones%frequency', from = 0.69, to = 0.71, points = 120, others = 0.7 /\n",
    "fold": STOP[: STOP.index("&curve")] + "&curve parameter = 'law(1)%gap', from = 1.0, to = 0.6, values = 0.8, points = 60,\n"
    "   follow = 'fold', over = 'tones%frequency', over_from = 0.3, over_to = 1.2 /\n",
    "switch": UEDA.replace("to = 5.2, values = 5.0", "to = 3.2"),
}


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """The result of each of them, solved where the first test needs it."""
    return functools.cache(lambda name: solve(BY_TOLERANCE[name], tmp_path_factory.mktemp(name)))


ENDED = [(name, share) for name in BY_TOLERANCE for share in (0.35, 0.8)]


@pytest.mark.long  # seconds: the curves apart are solved again
@pytest.mark.parametrize(("name", "share"), ENDED)
def test_curves_by_tolerance_go_on_bit_by_bit(followed, tmp_path, name, share):
    path = followed(name)
    broken = shutil.copy(path, tmp_path / f"{name}.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][int(share * (file["status"][...] != UNUSED).sum()) :] = PENDING
    done = run("resume", broken, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    for dataset, one, other in zip(SOLUTION, read(path, *SOLUTION), read(broken, *SOLUTION)):
        assert one.tobytes() == other.tobytes(), dataset


@pytest.mark.long
def test_symmetry_and_period_break_by_tolerance_where_shooting_has_it(tmp_path):
    """Ueda's oscillator: the tuples that are zero before the loss of symmetry are in the set at that point. To 1e-6 the flip has an
    error of 1.3e-8, to 1e-7 of less than 2e-9."""
    path = solve(UEDA.replace("1e-6", "1e-7"), tmp_path)
    with Results(path) as results:
        (branch,) = results.select({"curve_kind": "branch"})
        (flip, other) = results.select({"curve_kind": "period_doubling"})
        assert results.curve.values[branch] == pytest.approx(2.2863817051, rel=2e-9)
        assert results.curve.values[flip] == pytest.approx(4.8760911500, rel=2e-9)
        assert results.curve.values[other] == pytest.approx(4.8760911500, rel=2e-9)
        assert "symmetry_breaking" not in results.curve_kind(), "told twice"
    with Results(path.with_name(f"{path.stem}_{flip}.h5")) as results:
        (at_value,) = results.select({"curve_kind": "value"})
        found = [results.amplitude(at_value, "x1", (j,)) for j in (1, 2, 3, 4)]
        np.testing.assert_allclose(found, [0.02060777, 1.81210552, 0.06220297, 0.74272815], rtol=0, atol=2e-6)
        assert results.stability()[at_value] == 1


@pytest.mark.long  # seconds
def test_torus_is_followed_by_tolerance(tmp_path):
    """Its bifurcation point by shooting, its frequency and amplitudes at the end from a time integration (test_curve_switching)."""
    path = solve(FORCED_VAN_DER_POL, tmp_path)
    with Results(path) as results:
        (torus,) = results.select({"curve_kind": "neimark_sacker"})
        assert results.curve.values[torus] == pytest.approx(0.76153714393, rel=1e-9)
    with Results(path.with_name(f"{path.stem}_{torus}.h5")) as results:
        (end,) = results.select({"curve_kind": "end"})
        assert results.frequency(end)[1] == pytest.approx(1.01110072813, rel=1e-6)
        assert results.amplitude(end, "x1", (0, 1)) == pytest.approx(1.76810181, rel=1e-4)
        assert results.amplitude(end, "x1", (1, 0)) == pytest.approx(0.63880032, rel=1e-4)


@pytest.mark.long
def test_other_motions_are_each_found_to_the_tolerance(followed, tmp_path):
    """Those of the whole curve, which passes the frequency three times."""
    whole = solve(STOP.replace("points", "values = 0.7, points"), tmp_path)
    amplitudes = []
    for file in (followed("others"), whole):
        with Results(file) as results:
            there = np.flatnonzero(results.curve.values == 0.7)
            there = [p for p in there if results.curve_kind()[p] in ("start", "value")]
            amplitudes.append(sorted({round(results.amplitude(p, "x2", (1,)), 9) for p in there}))
            assert max(results.per_point("truncation_estimate")[there]) <= 1e-3
    assert len(amplitudes[0]) == len(amplitudes[1]) == 3
    np.testing.assert_allclose(amplitudes[0], amplitudes[1], rtol=2e-3)


@pytest.mark.long
def test_fold_is_followed_by_tolerance_to_that_of_the_curve_there(followed, tmp_path):
    there = solve(STOP.replace("gap = 1.0", "gap = 0.8"), tmp_path)
    with Results(followed("fold")) as ridge, Results(there) as curve:
        (point,) = ridge.select({"curve_kind": "value"})
        fold = curve.select({"curve_kind": "fold"})[0]
        assert ridge.frequency(point)[0] == pytest.approx(curve.frequency(fold)[0], rel=1e-5)


@pytest.mark.long
def test_points_that_time_integration_leaves_are_truncated(tmp_path):
    """A slow tone carries the motion through stops: near a fold the series of the steady motion converges so slowly that error
    estimates do not see it. A point whose estimate is near the tolerance is compared with an integration that starts on it."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.01716220957317408, stiffness=1.0 /
&tones frequency=0.5, 0.034784103257984846 /
&accuracy tolerance=0.001 /
&load dof='x1', tuple=1, 0, cos=0.1509392142186491 /
&load dof='x1', tuple=0, 1, cos=0.10046414392749753 /
&law type='elastic_stop', dof='x1', stiffness=29.4182479488366, gap=0.5013266119218442, two_sided=.true. /
&curve parameter='tones%frequency(1)', from=0.5, to=1.8, points=58 /
"""
    path = solve(text, tmp_path, status=None)
    with Results(path) as results:
        left = [point for point in results.used if "leaves it by" in results.message(point)]
        assert left and all(results.status_name(point) == "truncated" for point in left)
        largest = max(float(re.search(r"leaves it by ([\d.E+-]+)", results.message(point))[1].rstrip(",.")) for point in left)
    assert largest > 2e-3
    said = run("verify", path.name, "--points", str(left[-1]), cwd=tmp_path).stdout
    assert "differs from time integration" in said or "disagree" in said, said


# `tests/campaigns/curves --seed 85301 --first 36`: a stop so stiff that the curve turns back at once behind first contact
SHARP_FOLD = """
&structure type='matrices', n_dofs=2, mass=1.8187039674721859, 0.14040093527729233, 0.14040093527729233, 1.3445448549749253,
    stiffness=1.8944901193884942, -0.10675780958157434, -0.10675780958157434, 2.1225406250117005, damping_mass=0.0,
    damping_stiffness=0.00644882495800511 /
&tones frequency=2.190986194721853 /
&accuracy tolerance=0.003 /
&law type='elastic_stop', dof='x1', stiffness=1376.4301816178597, gap=0.003225119166284258, two_sided=.true. /
&load dof='x2', tuple=1, cos=-0.9992397287189276, sin=-0.013529756297112833 /
&load dof='x1', tuple=0, cos=-0.4126962195960133 /
&curve parameter='tones%frequency', from=0.3997323855767849, to=2.298461217066513, points=30 /
"""

REGULAR_OR_START = (1, 2)


def test_a_fold_that_a_change_of_the_set_has_behind_it_is_reported(tmp_path):
    """Between rows of the curve whose tangents have different signs along the frequency is an odd number of folds."""
    path = solve(SHARP_FOLD, tmp_path, status=None)
    kind, direction, used = read(path, "curve_kind", "curve_direction", "curve_n_unknowns")
    n_turns, n_folds, before = 0, 0, 0.0
    for row in np.flatnonzero(kind > 0):
        if kind[row] == FOLD:
            n_folds += 1
        elif kind[row] in REGULAR_OR_START and np.isfinite(rise := direction[row, used[row] - 1]):
            if before * rise != 0.0:
                assert n_folds % 2 == (before * rise < 0.0)
                n_turns += n_folds % 2
            before, n_folds = rise, 0
    assert n_turns == 1
