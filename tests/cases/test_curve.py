"""Curves: the output and the file of a run with `&curve`, independent of the number of ranks and of interruptions."""

import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from nhbm_post.reader import Results
from scipy.integrate import solve_ivp

import shooting
from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, read, run, solve

DUFFING = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.05 /
&tones frequency = 0.5 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, cos = 0.18 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
"""
CURVE = DUFFING + "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, start = 1.2, values = 1.0, points = 300 /\n"
FAMILY = CURVE + "&sweep parameter = 'load(1)%cos', values = 0.05, 0.12, 0.18, 0.3 /\n"
SOLUTION = (
    "status", "coefficients", "force_coefficients", "residual", "iterations", "curve_kind", "curve_length",
    "curve_unknowns", "curve_direction", "curve_step", "curve_orientation", "curve_largest_motion", "checksum",
)  # fmt: skip
STOP = """
&structure type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, damping_stiffness = 0.03, ends = 'fixed-free' /
&tones frequency = 0.3 /
&load dof = 'x2', tuple = 1, cos = 0.1 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 100.0, gap = 1.0 /
&accuracy tolerance = 1e-3 /
&curve parameter = 'tones%frequency', from = 0.3, to = 1.2, points = 300 /
"""
KINK = """
&structure type = 'chain', n_masses = 2, mass = 2.565, 2.139, coupling_stiffness = 2.008, 0.3647, 1.786, damping_mass = 0.00687 /
&tones frequency = 0.45 /
&load dof = 'x1', tuple = 1, cos = 0.385 /
&law type = 'jenkins', dof = 'x2', stiffness = 10.0, limit = 0.0585 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 25.8, gap = 0.0103, two_sided = .true. /
&curve parameter = 'tones%frequency', from = 0.423, to = 1.0 /
"""
MODE = """
&structure type = 'chain', n_masses = 2, ends = 'fixed', mass = 1.0, coupling_stiffness = 1.0 /
&tones unknown = .true. /
&harmonics order = 21, odd_only = .true. /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&normal_mode mode = 1 /
"""
RIDGE = "parameter = 'load(1)%cos', from = 0.18, to = 0.1, follow = 'fold'"
UNUSED, PENDING, COLLAPSED = 17, 0, 10
FOLD, GRAZE = 3, 11
INPUTS = Path(__file__).resolve().parents[2] / "inputs"


def assert_same_bits(a, b, moving="tones_frequency"):
    names = [*SOLUTION, moving]
    for name, one, other in zip(names, read(a, *names), read(b, *names)):
        assert one.tobytes() == other.tobytes(), name


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    return solve(FAMILY, tmp_path_factory.mktemp("family"))


def test_a_curve_that_turns_back_is_reported(tmp_path):
    """From 1.2 down the lower motions meet a fold at 1.1157; the upper ones lead back to 1.2, and 0.5 is not reached."""
    curve = DUFFING + "&curve parameter = 'tones%frequency', from = 1.2, to = "
    line = "1 curve returned to 1.2 without reaching the other end of the range: try start = 0.5 in &curve"
    for end, is_reported in (("0.5 /", True), ("2.5 /", False)):
        (tmp_path / "case.nml").write_text(curve + end)
        done = run("solve", "case.nml", "--overwrite", cwd=tmp_path)
        assert done.status == ALL_CONVERGED
        assert (line in done.stdout.splitlines()) == is_reported, done.stdout


def test_a_curve_that_turns_at_a_kink_has_a_fold_there(tmp_path):
    """A slider begins to slip a second time in the half period: the curve folds at a corner, and the motions beyond it are unstable
    although the slip is shorter than the distance of the detection times for events."""
    curve = solve(KINK, tmp_path)
    value, kind, stable = read(curve, "tones_frequency", "curve_kind", "is_stable")
    fold = int(np.argmax(kind == FOLD))
    used = read(curve, "status") == 1
    assert value[fold] == pytest.approx(0.5431146384, abs=1e-9) and value[fold] == pytest.approx(value[used].max(), abs=1e-9)
    assert (stable[used][:25] == 1).sum() == 24
    assert not (stable[used][fold:] == 1).any() and (stable[used][fold:] == -1).sum() > 30


def test_a_curve_tells_what_it_found(tmp_path):
    (tmp_path / "curve.nml").write_text(CURVE)
    done = run("solve", "curve.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    kinds = [line[0] for line in lines if len(line) > 2 and line[1] == "at"]
    assert kinds == ["start", "end", "fold", "fold", "value", "end"]
    assert "fold    at tones%frequency = 1.1157" in done.stdout and "fold    at tones%frequency = 1.2696" in done.stdout
    told = run("info", "curve.h5", cwd=tmp_path)
    assert told.status == ALL_CONVERGED
    for line in done.stdout.splitlines():
        if " at tones%frequency" in line:
            assert line in told.stdout
    with Results(tmp_path / "curve.h5") as results:
        assert results.curve.path == "tones%frequency"
        assert results.used.size < 300 and (results.status[results.used] == 1).all()
        assert results.select({"curve_kind": "value"}) and results.select({"curve_kind": "fold", "tones%frequency": "1.2:1.3"})
        assert results.outcome_text() == f"{results.used.size} of {results.used.size} points converged"


def test_a_curve_says_that_it_begins_at_the_other_end(tmp_path):
    """There is no motion at the first end, where rest is unstable and the &start is not a motion."""
    (tmp_path / "pumped.nml").write_text(
        "&structure type = 'chain', n_masses = 1, ends = 'fixed-free', mass = 0.3, coupling_stiffness = 120.0,\n"
        "           damping_mass = 0.12 /\n"
        "&tones frequency = 20.0 /\n&law type = 'parametric', dof = 'x1', tuple = 2, stiffness_cos = 30.0 /\n"
        "&law type = 'cubic_spring', dof = 'x1', stiffness = 4.0e4 /\n&start dof = 'x1', tuple = 1, cos = 0.02 /\n"
        "&curve parameter = 'tones%frequency', from = 20.0, to = 26.0 /\n"
    )
    for verb in (("solve", "pumped.nml"), ("info", "pumped.h5")):
        told = run(*verb, cwd=tmp_path).stdout
        assert "point 0: no motion was found at 20.0; the curve begins at the other end of its range" in told


def test_curves_of_a_family_are_those_of_single_runs(family, tmp_path):
    alone = solve(CURVE, tmp_path, "--set", "load(1)%cos=0.12")
    for name, one, other in zip(SOLUTION, read(family, *SOLUTION), read(alone, *SOLUTION)):
        assert one[300:600].tobytes() == other.tobytes(), name


def test_a_family_has_the_same_bits_on_two_ranks(family, tmp_path):
    assert_same_bits(family, solve(FAMILY, tmp_path, ranks=2))


@pytest.mark.parametrize("share", [0.05, 0.4, 0.9])
def test_an_ended_curve_goes_on_bit_by_bit(family, tmp_path, share):
    """Rows after a point, which may contain anything, as after a killed run."""
    path = tmp_path / "family.h5"
    shutil.copy(family, path)
    with h5py.File(path, "r+") as file:
        for first in range(0, 1200, 300):
            n_used = int((file["status"][first : first + 300] != UNUSED).sum())
            file["status"][first + int(share * n_used) : first + 300] = PENDING
    assert run("info", path, cwd=tmp_path).status == INCOMPLETE
    done = run("resume", path, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    assert_same_bits(family, path)
    assert done.stdout.splitlines()[1:] == run("resume", path, cwd=tmp_path).stdout.splitlines()[1:], "all points are counted"


def test_points_of_a_curve_are_those_of_a_sweep(tmp_path):
    """At the values of a curve a sweep with first guesses from its neighbours finds the same motions, if there is only one."""
    curve = solve(CURVE.replace("values = 1.0", "values = 0.7, 0.9, 1.0, 2.0"), tmp_path, name="curve")
    points = solve(DUFFING + "&sweep parameter = 'tones%frequency', values = 0.7, 0.9, 1.0, 2.0 /\n", tmp_path, name="points")
    with Results(curve) as found, Results(points) as known:
        for point, value in enumerate((0.7, 0.9, 1.0, 2.0)):
            [there] = found.select({"curve_kind": "value", "tones%frequency": value})
            assert found.amplitude(there, "x1", (1,)) == pytest.approx(known.amplitude(point, "x1", (1,)), rel=1e-11)
            assert found.per_point("tones_frequency")[there] == value
            assert found.per_point("truncation_estimate")[there] < 1e-6


def test_controlled_experiments_are_those_of_one_harmonic(tmp_path):
    """With the fundamental alone: F = A |1 + 3/4 k3 A**2 - w**2 + i c w|, and w**2 = 1 + 3/4 k3 (F/(c w))**2 at the resonance."""
    text = DUFFING.replace("order = 5", "order = 1") + "&certificate is_on = .false. /\n"
    located = "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, amplitude_of = 'x1 (1)', amplitudes = 1.0, 1.5,"
    with Results(solve(text + located + " resonance_of = 'x1 (1)' /\n", tmp_path, name="curve")) as curve:
        (point,) = curve.select({"curve_kind": "resonance"})
        w = curve.frequency(point)[0]
        assert w**2 == pytest.approx(1 + 0.075 * (0.18 / (0.05 * w)) ** 2, rel=1e-10)
        points = curve.select({"curve_kind": "amplitude"})
        found = [curve.amplitude(p, "x1", (1,)) for p in points]
        assert found == pytest.approx([1.0, 1.5, 1.5, 1.0], rel=1e-9)
        assert list(curve.per_point("curve_response")[points]) == [1, 2, 2, 1]
    held = "&curve parameter = 'tones%frequency', from = 0.9, to = 1.3, amplitude_of = 'x1 (1)', amplitudes = 1.5,"
    held += " follow = 'amplitude', over = 'load(1)%cos', over_from = 0.01, over_to = 1.0 /\n"
    path = solve(text + held, tmp_path, name="held")
    with Results(path) as curve:
        w, load = (curve.per_point(name)[curve.used] for name in ("tones_frequency", "curve_over"))
        assert load == pytest.approx(1.5 * abs(1 + 0.075 * 1.5**2 - w**2 + 0.05j * w), rel=1e-9)
        assert set(curve.per_point("is_stable")[curve.used]) == {-1, 1}, "a controller holds what is unstable without it"


def test_followed_points_stay_within_their_range(tmp_path):
    """The load at which an amplitude is constant passes 0.3 N where w**2 is about 1.37."""
    held = "&curve parameter = 'tones%frequency', from = 1.1, to = 1.6, amplitude_of = 'x1 (1)', amplitudes = 1.5,"
    held += " follow = 'amplitude', over = 'load(1)%cos', over_from = 0.01, over_to = 0.3 /\n"
    model = DUFFING.replace("order = 5", "order = 1") + "&certificate is_on = .false. /\n"
    (tmp_path / "held.nml").write_text(model + held)
    done = run("solve", "held.nml", cwd=tmp_path)
    assert "leaves the range of 'over'" in done.stdout + done.stderr
    assert "no bifurcation was located" not in done.stdout
    with Results(tmp_path / "held.h5") as curve:
        load = curve.per_point("curve_over")[curve.used]
        assert 0.28 < np.nanmax(load) <= 0.3


def test_followed_points_are_verified_at_both_values(tmp_path):
    """The computed load is in the model that is integrated."""
    held = "&curve parameter = 'tones%frequency', from = 0.6, to = 0.7, amplitude_of = 'x1 (1)', amplitudes = 1.5,"
    held += " follow = 'amplitude', over = 'load(1)%cos', over_from = 0.01, over_to = 2.0 /\n"
    path = solve(DUFFING + held, tmp_path)
    done = run("verify", path.name, "--points", "0,2", cwd=tmp_path)
    assert done.status == ALL_CONVERGED and done.stdout.count("agrees with time integration") == 2, done.stdout


def test_doublings_are_followed_to_those_of_curves_there(tmp_path):
    """Ueda's oscillator with a mean load, over the load and along the damping."""
    model = (INPUTS / "gallery" / "ueda_curve.nml").read_text().partition("&curve")[0].replace("order = 21", "order = 9")
    model += "&load dof = 'x1', tuple = 0, cos = 0.2 /\n&certificate is_on = .false. /\n"
    curve = "&curve parameter = 'load(1)%cos', from = 0.01, to = 6.0"
    ridge = f"&curve parameter = 'structure%damping_mass', from = 0.1, to = 0.12, follow = 'flip', {curve[7:]} /\n"
    ridge = ridge.replace("parameter = 'load", "over = 'load").replace("from = 0.01, to = 6.0", "over_from = 0.01, over_to = 6.0")
    with Results(solve(model + ridge, tmp_path, name="ridge")) as followed:
        (last,) = followed.select({"curve_kind": "end"})
        there = solve(model.replace("damping_mass = 0.1", "damping_mass = 0.12") + curve + " /\n", tmp_path, name="there")
        with Results(there) as known:
            (flip,) = known.select({"curve_kind": "flip"})
            assert followed.per_point("curve_over")[last] == pytest.approx(known.curve.values[flip], rel=1e-8)


def test_tied_tones_and_unbalance_move_along(tmp_path):
    text = (
        DUFFING.replace("frequency = 0.5", "frequency = 0.5, 0.8")
        .replace("order = 5", "order = 3")
        .replace("tuple = 1, cos = 0.18", "tuple = 1, 0, cos = 0.05, frequency_power = 2")
        + "&load dof = 'x1', tuple = 0, 1, cos = 0.05 /\n"
    )
    curve = "&curve parameter = 'tones%frequency(1)', from = 0.5, to = 0.7, values = 0.6, tie = 'ratio' /\n"
    followed = solve(text + curve, tmp_path, name="curve")
    alone = solve(text, tmp_path, "--set", "tones%frequency=0.6,0.96", name="alone")
    with Results(followed) as found, Results(alone) as known:
        [there] = found.select({"curve_kind": "value"})
        assert found.frequency(there) == pytest.approx([0.6, 0.96], rel=1e-15)
        for j in ((1, 0), (0, 1), (2, 1)):
            assert found.amplitude(there, "x1", j) == pytest.approx(known.amplitude(0, "x1", j), rel=1e-10)


def test_motions_are_unstable_exactly_between_the_folds(tmp_path):
    with Results(solve(DUFFING + "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5 /\n", tmp_path)) as results:
        kinds, stable = results.curve_kind()[results.used], results.stability()[results.used]
    first, last = np.flatnonzero(kinds == "fold")
    assert (stable[:first] == 1).all() and (stable[first + 1 : last] == -1).all() and (stable[last + 1 :] == 1).all()


def test_limit_cycles_are_followed_and_end_where_they_die(tmp_path):
    """A decreasing negative damping: the cycle of x'' - e (1 - x**2) x' + d x' + x = 0 has the amplitude 2 sqrt(1 - d/e) and
    vanishes at d = e."""
    text = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 1e-3 /
&tones unknown = .true. /
&harmonics order = 5 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.05 /
&curve parameter = 'structure%damping_mass', from = 1e-3, to = 0.1, values = 0.0375 /
"""
    path = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    with Results(path) as results:
        [there] = results.select({"curve_kind": "value"})
        assert results.amplitude(there, "x1", (1,)) == pytest.approx(1.0, abs=2e-4)
        assert results.frequency(there)[0] == pytest.approx(1.0, abs=1e-3)
        last = results.used[-1]
        assert results.status_name(last) == "collapsed"
        assert results.per_point("structure_damping_mass")[last] == pytest.approx(0.05, rel=0.01)


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


def test_motions_without_damping_make_no_torus(tmp_path):
    """At the start all multipliers are on the unit circle, and rounding determines on which side."""
    text = """
&structure type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, ground_stiffness = 1.0, damping_mass = 0.0 /
&tones frequency = 1.3 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&curve parameter = 'structure%damping_mass', from = 0.0, to = 0.5, points = 100 /
"""
    with Results(solve(text, tmp_path)) as results:
        assert "torus" not in results.curve_kind() and "end" in results.curve_kind()


@pytest.mark.parametrize(
    ("share", "responses"), [(0.33, "'x1', 'x1 (1)'"), pytest.param(0.72, "'x1'", marks=pytest.mark.long)]
)
def test_wavy_curves_go_on_bit_by_bit(tmp_path, share, responses):
    """The events reported on a wavy peak depend on those reported before."""
    path = solve(ONE_STOP.replace("peak_of = 'x1'", f"peak_of = {responses}"), tmp_path)
    broken = shutil.copy(path, tmp_path / "broken.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][int(share * (file["status"][...] != UNUSED).sum()) :] = PENDING
    assert run("resume", broken, cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(path, broken)


def test_a_curve_begins_at_the_end_where_its_motion_is_found(tmp_path):
    """Twenty masses, the last of which is preloaded by a stop: at 0.05 rad/s no motion is found in a minute."""
    text = """
&structure type = 'chain', n_masses = 20, ends = 'fixed-free', mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.005,
   damping_stiffness = 0.002 /
&tones frequency = 0.05 /
&harmonics order = 15 /
&load dof = 'x10', tuple = 1, cos = 0.02 /
&law type = 'elastic_stop', dof = 'x20', gap = 0.1, stiffness = 50.0 /
&curve parameter = 'tones%frequency', from = 0.05, to = 2.2, points = 40 /
"""
    path = solve(text, tmp_path)
    broken = shutil.copy(path, tmp_path / "broken.h5")
    with h5py.File(broken, "r+") as file:
        frequency, kind = file["tones_frequency"][...].ravel(), file["curve_kind"][...]
        assert kind[0] == 2 and frequency[0] == 2.2 and (np.diff(frequency) < 0).all()
        assert b"begins at the other end" in bytes(file["message"][0])
        file["status"][20:] = PENDING
    assert run("resume", broken, cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(path, broken)


def test_curves_by_tolerance_have_the_same_bits_on_two_ranks_and_resumed(by_tolerance, tmp_path):
    text = STOP + "&sweep parameter = 'law%gap', values = 1.0, 1.2 /\n"
    names = (*SOLUTION, "tuples", "grid", "n_harmonics")
    whole = read(by_tolerance, *names)
    others = [solve(text, tmp_path, ranks=2)]
    for share in (0.4, 0.7):
        others.append(shutil.copy(by_tolerance, tmp_path / f"ended_{share}.h5"))
        with h5py.File(others[-1], "r+") as file:
            for first in (0, 300):
                n_used = int((file["status"][first : first + 300] != UNUSED).sum())
                file["status"][first + int(share * n_used) : first + 300] = PENDING
        done = run("resume", others[-1], cwd=tmp_path)
        assert done.status == ALL_CONVERGED, done.stderr
    for other in others:
        for name, one, two in zip(names, whole, read(other, *names)):
            assert one.tobytes() == two.tobytes(), (other, name)


def test_budget_of_points_is_kept(tmp_path):
    (tmp_path / "short.nml").write_text(CURVE.replace("points = 300", "points = 7"))
    done = run("solve", "short.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED
    assert "1 curve reached the limit of 7 points" in done.stdout
    assert "1 curve reached the limit of 7 points" in run("info", "short.h5", cwd=tmp_path).stdout
    path = tmp_path / "short.h5"
    assert (read(path, "status") == 1).all() and "end" not in Results(path).curve_kind()


def test_progress_counts_points_and_not_the_room_for_them(tmp_path):
    (tmp_path / "curve.nml").write_text(CURVE)
    done = run("solve", "curve.nml", cwd=tmp_path)
    n_points = re.search(r"(\d+) of \1 points converged", done.stdout)[1]
    assert done.stderr.splitlines()[-1].startswith(f"{n_points} points, ") and "used all" not in done.stdout


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ("from = 0.0, to = 5.0", "must be above 0"),
        ("from = 1.0, to = 0.0", "must not be 0 and must not change its sign"),
        ("from = 1.0, to = 5.0 /\n&tie parameter = 'law(1)%stiffness', to = 'normal_mode%energy'", "no &tie may follow"),
    ],
)
def test_what_is_wrong_with_a_curve_over_the_energy_is_said(tmp_path, keys, says):
    (tmp_path / "bad.nml").write_text(MODE + f"&curve parameter = 'normal_mode%energy', {keys} /\n")
    done = run("solve", "bad.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and says in done.stderr, done.stderr


def test_motions_on_a_tongue_repeat_in_time(tmp_path):
    """Motions along the whole tongue, integrated over one period from those of the balance."""
    path = solve((INPUTS / "gallery" / "two_masses_tongue.nml").read_text().replace("order = 31", "order = 51"), tmp_path)
    status, energies, omegas, coefficients = read(path, "status", "normal_mode_energy", "frequency", "coefficients")
    orders = read(path, "tuple")[:, 0]
    on_tongue = np.flatnonzero((status == 1) & (energies > 1000.0))
    assert on_tongue.size > 60

    def rate(t, y):
        return [*y[2:], -2.0 * y[0] + y[1] - 0.5 * y[0] ** 3, y[0] - 2.0 * y[1]]

    for point in on_tongue[::8]:
        omega, cosines, sines = omegas[point, 0], *np.moveaxis(coefficients[point], -1, 0)
        start = np.concatenate([cosines.sum(axis=1), omega * sines @ orders])
        period = solve_ivp(rate, (0.0, 2.0 * np.pi / omega), start, method="DOP853", rtol=1e-12, atol=1e-12)
        assert np.linalg.norm(period.y[:, -1] - start) < 1e-8 * np.linalg.norm(start), energies[point]


def test_curves_over_the_energy_go_on_bit_by_bit(tmp_path):
    text = MODE + "&curve parameter = 'normal_mode%energy', from = 3000.0, to = 5000.0, points = 100 /\n"
    path = solve(text, tmp_path)
    assert "fold" in Results(path).curve_kind()
    broken = shutil.copy(path, tmp_path / "broken.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][9:] = PENDING
    assert run("resume", broken, cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(path, broken, "normal_mode_energy")


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ("parameter = 'tones%frequency', from = 0.5", "'to'"),
        ("parameter = 'tones%frequency', from = 0.5, to = 0.5", "the range is empty"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, start = 2.0", "must lie between 'from' and 'to'"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, values = 1.0, 1.6", "1.6 does not"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, others = 1.0, 1.6", "1.6 does not"),
        ("parameter = 'tones%frequenzy', from = 0.5, to = 1.5", "frequenzy"),
        ("parameter = 'harmonics%order', from = 1, to = 5", "a curve follows a number of &structure"),
        ("parameter = 'structure%n_masses', from = 1, to = 5", "is not a real number"),
        ("parameter = 'tones%frequency(2)', from = 0.5, to = 1.5", "the highest number of a tone is 1"),
        ("parameter = 'load(1)%cos', from = 0.5, to = 1.5, tie = 'ratio'", "is for the frequency of a tone"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, peak_of = 'x2'", "unknown degree of freedom 'x2'"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, peak_of = 'x1 (1,0)'", "is not a response"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, peak_of = 'x1 (9)'", "does not have this tuple"),
        (f"{RIDGE}, over = 'tones%frequency', over_from = 0.5, over_to = 1.5, switch = .true.", "switch: is for the motion"),
        (f"{RIDGE}, over = 'load(1)%cos', over_from = 0.5, over_to = 1.5", "moves along 'parameter' already"),
        (f"{RIDGE}, over = 'tones%frequency', over_from = 0.5, over_to = 0.5", "over_to: is the same as 'over_from'"),
        (
            "parameter = 'tones%frequency', from = 0.5, to = 1.5 /\n&sweep parameter = 'tones%frequency', values = 1, 2",
            "moves along the curve",
        ),
        (
            "parameter = 'tones%frequency', from = 0.5, to = 1.5 /\n&sweep parameter = 'curve%to', values = 1, 2",
            "cannot vary a curve",
        ),
    ],
)
def test_what_is_wrong_with_a_curve_is_said(tmp_path, keys, says):
    (tmp_path / "bad.nml").write_text(DUFFING + f"&curve {keys} /\n")
    done = run("solve", "bad.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and says in done.stderr, done.stderr
    assert re.search(r"bad.nml:[89]: ", done.stderr), done.stderr
    assert not (tmp_path / "bad.h5").exists()


@pytest.mark.long
def test_torus_behind_a_graze_is_found_and_followed_both_ways(tmp_path):
    """A rotor that bounces in its ring; radii at 1.15 rad/s by time integration from rest, 0.1271 and 1.1203."""
    text = (Path(__file__).parents[2] / "inputs" / "gallery" / "jeffcott_torus.nml").read_text(encoding="utf-8")
    path = solve(text.replace("to = 2.5", "to = 1.2").replace("1.0, 1.15, 1.3", "1.15"), tmp_path, status=None)
    with Results(path) as results:
        (graze,) = results.select({"curve_kind": "graze"})
    torus = path.with_name(f"{path.stem}_{graze}.h5")
    with Results(torus) as results:
        (at_value,) = results.select({"curve_kind": "value"})
    status, speed, tuples, c = read(torus, "status", "tones_frequency_1", "tuple", "coefficients")
    assert speed[status == COLLAPSED] == pytest.approx(0.9251817195, rel=1e-4), "its tone dies out at the graze"
    phases = np.stack(np.meshgrid(*2 * [np.linspace(0, 2 * np.pi, 200)]))
    angles = np.tensordot(tuples, phases, 1)
    radius = np.hypot(*(np.tensordot(c[at_value, k, :, 0], np.cos(angles), 1)
                        + np.tensordot(c[at_value, k, :, 1], np.sin(angles), 1) for k in (0, 1)))  # fmt: skip
    np.testing.assert_allclose([radius.min(), radius.max()], [0.1271, 1.1203], rtol=0, atol=1e-3)


def test_doubled_motions_are_followed_in_a_file_of_their_own(tmp_path):
    """Ueda's oscillator at B = 5: amplitudes by shooting (DOP853 at 3e-14)."""
    text = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 0.0,
   damping_mass = 0.1 /
&tones frequency = 1.0 /
&harmonics order = 21 /
&load dof = 'x1', tuple = 1, cos = 0.01 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&curve parameter = 'load(1)%cos', from = 0.01, to = 5.2, values = 5.0, switch = .true., points = 500 /
"""
    path = solve(text, tmp_path)
    with Results(path) as results:
        (flip, other) = results.select({"curve_kind": "flip"})
        assert results.curve.values[flip] == pytest.approx(4.8760911500, rel=1e-8)
    doubled = path.with_name(f"{path.stem}_{flip}.h5")
    with Results(doubled) as results:
        (at_value,) = results.select({"curve_kind": "value"})
        found = [results.amplitude(at_value, "x1", (j,)) for j in (1, 2, 3, 4)]
        np.testing.assert_allclose(found, [0.02060777, 1.81210552, 0.06220297, 0.74272815], rtol=0, atol=2e-8)
        assert results.stability()[at_value] == 1
    before = read(doubled, "coefficients")
    assert run("resume", path.name, cwd=tmp_path).status == ALL_CONVERGED
    assert read(doubled, "coefficients")[0].tobytes() == before[0].tobytes()
    shutil.copy(doubled, tmp_path / "alone.h5")
    old = path.with_name(f"{path.stem}_3.h5")
    shutil.copy(doubled, old)
    with h5py.File(old, "r+") as file:
        file["input_text"].attrs["file_name"] = f"point 3 of {path}"
    done = run("solve", path.with_suffix(".nml").name, "--overwrite", cwd=tmp_path, ranks=2)
    assert done.status == ALL_CONVERGED, done.stderr
    assert not old.exists(), "what left the curve of before at a point where this one has none"
    assert_same_bits(tmp_path / "alone.h5", doubled, moving="load_1_cos")


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
    return {name: solve(text, tmp_path_factory.mktemp(name)) for name, text in BY_TOLERANCE.items()}


ENDED = [(name, share) for name in BY_TOLERANCE for share in (0.35, 0.8)]


@pytest.mark.long  # seconds: the curves apart are solved again
@pytest.mark.parametrize(("name", "share"), ENDED)
def test_curves_by_tolerance_go_on_bit_by_bit(followed, tmp_path, name, share):
    path = followed[name]
    broken = shutil.copy(path, tmp_path / f"{name}.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][int(share * (file["status"][...] != UNUSED).sum()) :] = PENDING
    done = run("resume", broken, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    for dataset, one, other in zip(SOLUTION, read(path, *SOLUTION), read(broken, *SOLUTION)):
        assert one.tobytes() == other.tobytes(), dataset


def test_symmetry_and_period_break_by_tolerance_where_shooting_has_it(tmp_path):
    """Ueda's oscillator: the tuples that are zero before the loss of symmetry are in the set at that point. To 1e-6 the flip has an
    error of 1.3e-8, to 1e-7 of less than 2e-9."""
    path = solve(UEDA.replace("1e-6", "1e-7"), tmp_path)
    with Results(path) as results:
        (branch,) = results.select({"curve_kind": "branch"})
        (flip, other) = results.select({"curve_kind": "flip"})
        assert results.curve.values[branch] == pytest.approx(2.2863817051, rel=2e-9)
        assert results.curve.values[flip] == pytest.approx(4.8760911500, rel=2e-9)
        assert results.curve.values[other] == pytest.approx(4.8760911500, rel=2e-9)
        assert "split" not in results.curve_kind(), "told twice"
    with Results(path.with_name(f"{path.stem}_{flip}.h5")) as results:
        (at_value,) = results.select({"curve_kind": "value"})
        found = [results.amplitude(at_value, "x1", (j,)) for j in (1, 2, 3, 4)]
        np.testing.assert_allclose(found, [0.02060777, 1.81210552, 0.06220297, 0.74272815], rtol=0, atol=2e-6)
        assert results.stability()[at_value] == 1


TWO_FLIPS = """
&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,100.0, damping=0.1,0.2, labels='x','y' /
&tones frequency=1.3 /
&harmonics order=7 /
&load dof='y', tuple=1, cos=100.0 /
&law type='polynomial_coupled', dofs='x','y', coefficients=0.5, acts_on='x', displacement_exponents=1,1 /
&law type='cubic_spring', dof='x', stiffness=0.5 /
&curve parameter='tones%frequency', from=1.3, to=2.9, switch=.true., points=60 /
"""
RESONANCE = """
&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,4.0, damping=0.02,0.04 /
&tones frequency=1.008 /
&harmonics order=5 /
&load dof='x1', tuple=1, cos=0.02 /
&law type='polynomial_coupled', dofs='x1','x2', coefficients=1.0,0.5, acts_on='x1','x2', displacement_exponents=1,1, 2,0 /
&curve parameter='tones%frequency', from=1.008, to=1.001, switch=.true., points=30, torus_order=4,2 /
"""


def test_other_motions_begin_where_their_point_is(tmp_path):
    """Not elsewhere, where the motion of the curve has no such point: frequencies along it differ from that at its start."""
    path = solve(TWO_FLIPS, tmp_path)
    with Results(path) as results:
        flips = results.select({"curve_kind": "flip"})
        values = results.curve.values[flips]
    assert len(flips) == 2
    for flip, value in zip(flips, values):
        with Results(path.with_name(f"{path.stem}_{flip}.h5")) as results:
            assert results.curve.values[0] == pytest.approx(value, abs=1e-3)


def test_tone_that_joins_is_next_to_the_main_one(tmp_path):
    """Its frequency is that of the angle of the multipliers, at the frequency of the point."""
    path = solve(RESONANCE, tmp_path, status=None)
    with Results(path) as results:
        torus = results.select({"curve_kind": "torus"})[0]
        value = results.curve.values[torus]
    real, imaginary = read(path, "multiplier_real", "multiplier_imag")
    angle = np.arctan2(imaginary[torus, 0], real[torus, 0])
    with Results(path.with_name(f"{path.stem}_{torus}.h5")) as results:
        first, second = results.frequency(0)
        assert first == pytest.approx(value, abs=1e-3)
        assert abs(second - first) == pytest.approx(abs(angle) / (2 * np.pi) * value, rel=1e-2)
        assert results.status[0] == 1


def test_damping_may_begin_at_zero(tmp_path):
    """The value below it, of the central difference, is rejected: van der Pol's motion vanishes where the damping is 1."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, stiffness=1.0 /
&tones unknown=.true. /
&accuracy tolerance=1e-4 /
&law type='polynomial', dof='x1', damping=-1.0,0.0,0.333333333333333 /
&curve parameter='structure%damping_diagonal', from=0.0, to=1.5, points=100 /
"""
    with Results(solve(text, tmp_path, status=NOT_ALL_CONVERGED)) as results:
        assert results.status_name(results.used[-1]) == "collapsed"
        assert results.curve.values[results.used[-1]] == pytest.approx(1.0, abs=1e-2)


@pytest.mark.long  # seconds
def test_torus_is_followed_by_tolerance(tmp_path):
    """Its bifurcation point by shooting, its frequency and amplitudes at the end from a time integration (test_curve_switching)."""
    path = solve(FORCED_VAN_DER_POL, tmp_path)
    with Results(path) as results:
        (torus,) = results.select({"curve_kind": "torus"})
        assert results.curve.values[torus] == pytest.approx(0.76153714393, rel=1e-9)
    with Results(path.with_name(f"{path.stem}_{torus}.h5")) as results:
        (end,) = results.select({"curve_kind": "end"})
        assert results.frequency(end)[1] == pytest.approx(1.01110072813, rel=1e-6)
        assert results.amplitude(end, "x1", (0, 1)) == pytest.approx(1.76810181, rel=1e-4)
        assert results.amplitude(end, "x1", (1, 0)) == pytest.approx(0.63880032, rel=1e-4)


def test_other_motions_are_each_found_to_the_tolerance(followed, tmp_path):
    """Those of the whole curve, which passes the frequency three times."""
    whole = solve(STOP.replace("points", "values = 0.7, points"), tmp_path)
    amplitudes = []
    for file in (followed["others"], whole):
        with Results(file) as results:
            there = np.flatnonzero(results.curve.values == 0.7)
            there = [p for p in there if results.curve_kind()[p] in ("start", "value")]
            amplitudes.append(sorted({round(results.amplitude(p, "x2", (1,)), 9) for p in there}))
            assert max(results.per_point("truncation_estimate")[there]) <= 1e-3
    assert len(amplitudes[0]) == len(amplitudes[1]) == 3
    np.testing.assert_allclose(amplitudes[0], amplitudes[1], rtol=2e-3)


def test_fold_is_followed_by_tolerance_to_that_of_the_curve_there(followed, tmp_path):
    there = solve(STOP.replace("gap = 1.0", "gap = 0.8"), tmp_path)
    with Results(followed["fold"]) as ridge, Results(there) as curve:
        (point,) = ridge.select({"curve_kind": "value"})
        fold = curve.select({"curve_kind": "fold"})[0]
        assert ridge.frequency(point)[0] == pytest.approx(curve.frequency(fold)[0], rel=1e-5)


@pytest.mark.long  # seconds
def test_folds_at_a_stop_are_those_of_shooting(tmp_path):
    """Two masses, one against a stop: five digits at order 21, with a truncation of 5e-6, and more at order 41."""
    lower, upper = shooting.folds()
    for order, samples, tolerance in ((21, 256, 1e-5), (41, 1024, 1e-6)):
        text = (INPUTS / "gallery" / "stop_curve.nml").read_text()
        text = text.replace("order = 21", f"order = {order}").replace("samples = 256", f"samples = {samples}")
        frequency, kind = read(solve(text, tmp_path), "tones_frequency", "curve_kind")
        assert frequency[kind == GRAZE][-1] == pytest.approx(shooting.graze(), rel=1e-9)
        assert frequency[kind == FOLD] == pytest.approx([upper, lower], rel=tolerance)
        assert frequency[kind == FOLD][1] == pytest.approx(lower, rel=1e-9)


@pytest.mark.long
def test_coexisting_motions_of_the_rotor_are_told(tmp_path):
    """At 1.3 rad/s: two whirls in permanent contact with the ring, one without contact, two tori; integration ends in the latter
    whirl and in a torus."""
    text = (INPUTS / "gallery" / "jeffcott_torus.nml").read_text(encoding="utf-8")
    (tmp_path / "rotor.nml").write_text(text)
    assert run("solve", "rotor.nml", cwd=tmp_path).status in (ALL_CONVERGED, NOT_ALL_CONVERGED)
    (torus,) = tmp_path.glob("rotor_*.h5")
    with Results(tmp_path / "rotor.h5") as results:
        there = np.flatnonzero((results.curve.values == 1.3) & (results.curve_kind() == "value"))
        assert [int(stable) for stable in results.per_point("is_stable")[there]] == [-1, -1, 1]
        free = results.amplitude(there[-1], "x", (1,))
    with Results(torus) as results:
        there = np.flatnonzero((results.curve.values == 1.3) & (results.curve_kind() == "value"))
        assert len(there) == 2
        bouncing = results.amplitude(there[0], "x", (1, 0))
    lines = [line for line in text.splitlines() if not line.startswith(("&curve", "   torus_order"))]
    (tmp_path / "integration.nml").write_text("\n".join(lines).replace("frequency = 0.7", "frequency = 1.3") + "\n")
    starts = ("integration%starts=12", "integration%transient=600.0", "integration%duration=600.0")
    settings = [word for key in starts for word in ("--set", key)]
    done = run("integrate", "integration.nml", "-o", "integration.h5", *settings, cwd=tmp_path)
    assert "2 motions" in done.stdout, done.stdout + done.stderr
    integrated, spread = read(tmp_path / "integration.h5", "motion_coefficients", "motion_spread")
    amplitudes = np.hypot(*np.moveaxis(integrated[:, 0, 1], -1, 0))
    assert amplitudes == pytest.approx([free, bouncing], rel=1e-2)
    assert amplitudes[0] == pytest.approx(free, rel=1e-6) and amplitudes[0] == pytest.approx(0.48138576, rel=1e-6)


def test_the_warning_of_tones_names_a_point_of_the_curve(tmp_path):
    model = """&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.2, stiffness = 1.0 /
&tones frequency = 1.3, 2.6005 /
&harmonics order = 2 /
&load dof = 'x1', tuple = 1, 0, cos = 0.1 /
&load dof = 'x1', tuple = 0, 1, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
&curve parameter = 'load(1)%cos', from = 0.1, to = 0.2 /
"""
    (tmp_path / "near.nml").write_text(model)
    done = run("solve", "near.nml", "-o", "near.h5", cwd=tmp_path)
    assert "nearly vanishes (see 'combination'); first in point 0: " in done.stdout, done.stdout + done.stderr


def test_stability_that_was_not_looked_for_is_told(tmp_path):
    model = """&structure type = 'beam', length = 0.8, n_elements = 20, bending_stiffness = 43.75, mass_per_length = 0.78
           left_support = 'clamped', right_support = 'free', damping_mass = 1.5 /
&tones frequency = 30.0 /
&harmonics order = 3 /
&load dof = 'v21', tuple = 1, cos = 0.05 /
&law type = 'elastic_stop', dof = 'v21', stiffness = 2e3, gap = 2e-3 /
&curve parameter = 'tones%frequency', from = 30.0, to = 31.0 /
"""
    (tmp_path / "beam.nml").write_text(model)
    hint = "&stability method = 'integration' requests it"
    assert hint in run("solve", "beam.nml", cwd=tmp_path).stdout
    told = run("solve", "beam.nml", "--overwrite", "--set", "stability%method='integration'", cwd=tmp_path).stdout
    assert hint not in told and " stable" in told
