"""Curves: the output and the file of a run with `&curve`, independent of the number of ranks and of interruptions."""

import re
import shutil

import h5py
import numpy as np
import pytest
from nhbm_post.reader import Results

from curve_models import BRANCH, DOUBLING, DUFFING, FOLD, PENDING, SOLUTION, STOP, TORUS, UNUSED, assert_same_bits
from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, read, run, solve

STEPS = "points = 300, max_step = 0.1"
CURVE = DUFFING + f"&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, start = 1.2, values = 1.0, {STEPS} /\n"
FAMILY = CURVE + "&sweep parameter = 'load(1)%cos', values = 0.05, 0.12, 0.18, 0.3 /\n"
KINK = """
&structure type = 'chain', n_masses = 2, mass = 2.565, 2.139, coupling_stiffness = 2.008, 0.3647, 1.786, damping_mass = 0.00687 /
&tones frequency = 0.45 /
&load dof = 'x1', tuple = 1, cos = 0.385 /
&law type = 'jenkins', dof = 'x2', stiffness = 10.0, limit = 0.0585 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 25.8, gap = 0.0103, two_sided = .true. /
&curve parameter = 'tones%frequency', from = 0.423, to = 1.0 /
"""
MANY_FOLDS = """
&structure type = 'chain', n_masses = 2, mass = 1.0, 0.05, coupling_stiffness = 1.0, 2.0, 0.0, damping_mass = 0.01 /
&tones frequency = 2.1 /
&harmonics order = 9 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 10.0, gap = 0.1 /
&curve parameter = 'tones%frequency', from = 2.1, to = 0.2, points = 250 /
"""
RIDGE = "parameter = 'load(1)%cos', from = 0.18, to = 0.1, follow = 'fold'"


# Between two points of a curve multipliers meet, leave the unit circle and return.
DOUBLINGS = """
&structure type = 'matrices', n_dofs = 1, mass = 1.249, damping = 0.0228, stiffness = 1.671 /
&load dof = 'x1', tuple = 1, cos = 0.2168 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 6.597, gap = 0.1107, two_sided = .false. /
"""
BRANCHES = """
&structure type = 'matrices', n_dofs = 1, mass = 1.163, damping = 0.021, stiffness = 2.15 /
&load dof = 'x1', tuple = 1, cos = 0.812 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 4.677 /
"""
TORI = """
&structure type = 'matrices', n_dofs = 2
   mass = 1.7, 0.0, 0.0, 0.529, damping = 0.0331, -0.003, -0.003, 0.0139, stiffness = 2.471, -0.789, -0.789, 1.72 /
&load dof = 'x1', tuple = 1, cos = 0.662 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 5.408, gap = 0.0763, two_sided = .false. /
&law type = 'polynomial', dof = 'x1', stiffness = 0.0, 0.426, 0.891 /
"""


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


def test_a_curve_from_its_lower_end_stays_in_its_range(tmp_path):
    """The range is given downwards and the first motion at its lower end: the curve goes up."""
    curve = DUFFING + "&curve parameter = 'tones%frequency', from = 2.5, to = 0.5, start = 0.5 /\n"
    value, kind, status = read(solve(curve, tmp_path), "tones_frequency", "curve_kind", "status")
    used = status != UNUSED
    assert (status[used] == 1).all() and value[used].min() >= 0.5 and value[used][-1] == 2.5
    assert (kind[used] == FOLD).sum() == 2


def jumping(one, other, **further):
    keys = "".join(f", {key} = {value}" for key, value in further.items())
    return DUFFING + f"&curve parameter = 'tones%frequency', from = {one}, to = {other}, jump = .true.{keys} /\n"


@pytest.mark.parametrize("start, end", [(0.5, 2.5), (2.5, 0.5)])
def test_a_curve_jumps_over_its_fold(tmp_path, start, end):
    """As a slow sweep it leaves its branch at the fold ahead, 1.2696 upwards and 1.1157 downwards; all motions are stable."""
    value, kind, part, status, stable = read(solve(jumping(start, end), tmp_path), "tones_frequency", "curve_kind", "curve_branch",
                                             "status", "is_stable")
    used = status != UNUSED
    value, kind, part = value[used], kind[used], part[used]
    fold = np.flatnonzero(kind == FOLD)
    assert (status[used] == 1).all() and len(fold) == 1 and not (stable[used] == -1).any()
    assert value[fold[0]] == pytest.approx(1.2696 if end > start else 1.1157, abs=1e-4)
    assert (part[: fold[0] + 1] == 0).all() and (part[fold[0] + 1 :] == 1).all()
    assert (np.diff(value) * (end - start) > 0).all() and value[0] == start and value[-1] == end


def test_a_curve_jumps_also_after_an_interruption(tmp_path):
    """Resumed before the fold, at the fold, behind it, and with more points, it has the same bits."""
    whole = solve(jumping(0.5, 2.5), tmp_path)
    fold = int(np.argmax(read(whole, "curve_kind") == FOLD))
    for left in (fold - 1, fold, fold + 1, fold + 2, fold + 9):
        copy = tmp_path / f"left_{left}.h5"
        shutil.copy(whole, copy)
        with h5py.File(copy, "r+") as file:
            file["status"][left + 1 :] = PENDING
        assert run("resume", copy.name, cwd=tmp_path).status == ALL_CONVERGED
        assert_same_bits(copy, whole)
    down = solve(jumping(0.5, 2.5, start=2.5), tmp_path, name="down")                 # from the other end
    behind = int(np.argmax(read(down, "curve_branch") == 1)) + 5
    copy = shutil.copy(down, tmp_path / "left.h5")
    with h5py.File(copy, "r+") as file:
        file["status"][behind:] = PENDING
    assert run("resume", "left.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(copy, down)
    short = solve(jumping(0.5, 2.5, points=fold + 3), tmp_path, name="short")
    run("resume", short.name, "--set", "curve%points=500", cwd=tmp_path)
    assert_same_bits(short, whole)


@pytest.mark.long
def test_a_curve_with_many_folds_is_advised_to_jump(tmp_path):
    """A light mass between a stop and a spring: superharmonic folds take the points of a curve, and the printed command covers the
    range; two folds alone need more points."""
    (tmp_path / "few.nml").write_text(DUFFING + "&curve parameter = 'tones%frequency', from = 0.5, to = 12.0, points = 130 /\n")
    (tmp_path / "many.nml").write_text(MANY_FOLDS)
    few, many = (run("solve", f"{name}.nml", cwd=tmp_path) for name in ("few", "many"))
    assert "curve%points=" in few.stdout and "curve%jump" not in few.stdout
    command = re.search(r"try: nhbm (solve many.nml --set curve%jump=.true. .*)", many.stdout)[1].split()
    run(*command, cwd=tmp_path)
    value, status = read(tmp_path / "many_jump.h5", "tones_frequency", "status")
    assert value[status != UNUSED].min() == 0.2


def test_a_curve_that_turns_at_a_kink_has_a_fold_there(tmp_path):
    """A slider begins to slip a second time in the half period: the curve folds at a corner, and the motions beyond it are unstable
    although the slip is shorter than the distance of the detection times for events. The fold is the corner, which the last point
    before it (0.5431146384) has not reached."""
    curve = solve(KINK, tmp_path)
    value, kind, stable = read(curve, "tones_frequency", "curve_kind", "is_stable")
    fold = int(np.argmax(kind == FOLD))
    used = read(curve, "status") == 1
    assert value[fold] == pytest.approx(0.5431146498, abs=1e-9) and value[fold] == pytest.approx(value[used].max(), abs=1e-9)
    assert (stable[used][:25] == 1).sum() == 24
    assert not (stable[used][fold:] == 1).any() and (stable[used][fold:] == -1).sum() > 30


SIX_MODES = """
&structure type='matrices', n_dofs=6, mass=1.0,1.0,1.0,1.0,1.0,1.0, stiffness=1.0,4.0,0.3025,1.3456,3.1329,5.6644,
   damping=0.02,0.04,0.02,0.02,0.02,0.02 /
&tones frequency=0.85 /
&harmonics order=9 /
&load dof='x1', tuple=1, cos=0.02 /
&law type='polynomial_coupled', dofs='x1','x2', coefficients=1.0,0.5, acts_on='x1','x2', displacement_exponents=1,1, 2,0 /
&curve parameter='tones%frequency', from=0.85, to=1.2, max_step=0.02, points=20000 /
"""


@pytest.mark.long
def test_rows_that_a_curve_may_use_leave_stability_as_it_is(tmp_path):
    """The time for stability is shared by the points that curves usually have, not by all that are permitted."""
    with h5py.File(solve(SIX_MODES, tmp_path)) as file:
        found = file["tones_frequency"][()][file["curve_kind"][()] == 9]  # torus
    assert sorted(found) == pytest.approx([0.992407925, 1.004583200], abs=1e-6)


def test_a_curve_reports_what_it_found(tmp_path):
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


@pytest.mark.parametrize(
    ("model", "kind", "order", "ends"),
    [
        pytest.param(DOUBLINGS, DOUBLING, 15, (0.52, 2.54), id="doublings", marks=pytest.mark.long),
        pytest.param(BRANCHES, BRANCH, 7, (0.61, 1.6), id="branches"),
        pytest.param(TORI, TORUS, 15, (0.47, 4.1), id="tori", marks=pytest.mark.long),
    ],
)
def test_events_depend_neither_on_steps_nor_direction(tmp_path, model, kind, order, ends):
    text = f"{model}&tones frequency = 1.0 /\n&harmonics order = {order} /\n"
    found = []
    for keys, begin, end in [(", max_step = 0.01", *ends), ("", *ends), ("", *ends[::-1]), (", max_step = 0.1", *ends)]:
        curve = f"&curve parameter = 'tones%frequency', from = {begin}, to = {end}, points = 2000{keys} /\n"
        value, kinds = read(solve(text + curve, tmp_path), "tones_frequency", "curve_kind")
        found.append(np.sort(value[kinds == kind]))
    assert len(found[0]) >= 2
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=1e-6)


def test_curves_of_a_family_are_those_of_single_runs(family, tmp_path):
    alone = solve(CURVE, tmp_path, "--set", "load(1)%cos=0.12")
    for name, one, other in zip(SOLUTION, read(family, *SOLUTION), read(alone, *SOLUTION)):
        assert one[300:600].tobytes() == other.tobytes(), name


def test_a_family_has_the_same_bits_on_two_ranks(family, tmp_path):
    assert_same_bits(family, solve(FAMILY, tmp_path, ranks=2))


@pytest.mark.parametrize("share", [pytest.param(0.05, marks=pytest.mark.long), 0.4, 0.9])
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
    again = run("resume", path, cwd=tmp_path).stdout.splitlines()
    assert done.stdout.splitlines()[1:] == [line for line in again[1:] if "nothing is left" not in line], "all points are counted"


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
    text = DUFFING.replace("order = 5", "order = 1") + "&error_estimate is_on = .false. /\n"
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


def test_a_curve_turns_the_phase_of_one_of_two_loads(tmp_path):
    """With the fundamental alone the motion is that under the one load |F1 exp(i p) + F2|; a sweep has the same motions."""
    text = DUFFING.replace("order = 5", "order = 1")
    text += "&load dof = 'x1', tuple = 1, sin = 0.1 /\n&error_estimate is_on = .false. /\n"
    path = solve(text + "&curve parameter = 'load(2)%phase', from = 0.0, to = 6.0, values = 2.0, 4.0 /\n", tmp_path, name="curve")
    points = solve(text + "&sweep parameter = 'load(2)%phase', values = 2.0, 4.0 /\n", tmp_path, name="points")
    with Results(path) as curve, Results(points) as known:
        phase = curve.per_point("load_2_phase")[curve.used]
        size = np.array([curve.amplitude(p, "x1", (1,)) for p in curve.used])
        load = abs(0.18 - 0.1j * np.exp(1j * phase))
        assert np.ptp(load) > 0.15
        assert size * abs(1 + 0.075 * size**2 - 0.25 + 0.025j) == pytest.approx(load, rel=1e-9)
        there = curve.select({"curve_kind": "value"})
        expected = [known.amplitude(k, "x1", (1,)) for k in (0, 1)]
        assert [curve.amplitude(p, "x1", (1,)) for p in there] == pytest.approx(expected, rel=1e-10)


def test_a_harmonic_lags_its_load_by_requested_angles(tmp_path):
    """With the fundamental alone a motion that lags by p has c w A = F sin(p) and A (1 + 3/4 k3 A**2 - w**2) = F cos(p)."""
    text = DUFFING.replace("order = 5", "order = 1") + "&error_estimate is_on = .false. /\n"
    located = (
        "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, phase_of = 'x1 (1)', phases = 0.7, 1.5707963267948966, 2.2,"
    )
    with Results(solve(text + located + " resonance_of = 'x1 (1)' /\n", tmp_path, name="curve")) as curve:
        points = curve.select({"curve_kind": "phase"})
        assert list(curve.per_point("curve_response")[points]) == [2, 3, 4]
        for point, lag in zip(points, (0.7, np.pi / 2, 2.2)):
            w, size = curve.frequency(point)[0], curve.amplitude(point, "x1", (1,))
            assert 0.05 * w * size == pytest.approx(0.18 * np.sin(lag), rel=1e-8)
            assert size * (1 + 0.075 * size**2 - w**2) == pytest.approx(0.18 * np.cos(lag), abs=1e-8)
        (point,) = curve.select({"curve_kind": "resonance"})
        assert curve.frequency(points[1])[0] == pytest.approx(curve.frequency(point)[0], rel=1e-9)


def test_motions_are_unstable_exactly_between_the_folds(tmp_path):
    with Results(solve(DUFFING + "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5 /\n", tmp_path)) as results:
        kinds, stable = results.curve_kind()[results.used], results.stability()[results.used]
    first, last = np.flatnonzero(kinds == "fold")
    assert (stable[:first] == 1).all() and (stable[first + 1 : last] == -1).all() and (stable[last + 1 :] == 1).all()


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
        assert "neimark_sacker" not in results.curve_kind() and "end" in results.curve_kind()


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


def test_budget_of_points_is_kept(tmp_path):
    (tmp_path / "short.nml").write_text(CURVE.replace("points = 300", "points = 7"))
    done = run("solve", "short.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED
    path = tmp_path / "short.h5"
    values = read(path, "tones_frequency").ravel()
    share = int(100 * np.ptp(values) / 2.0)
    line = f"1 curve reached the limit of 7 points at tones%frequency = {values[-1]:.12g}"[:-5]
    command = r"try: (nhbm resume short.h5 --set curve%points=\d+)"
    for text in (done.stdout, run("info", "short.h5", cwd=tmp_path).stdout):
        found = re.search(rf"{line}\d* rad/s, with {share} % of the range covered: increase 'points' of &curve\n *{command}", text)
        assert found, text
    assert found[1] in run("why", "short.h5", cwd=tmp_path).stdout
    assert (read(path, "status") == 1).all() and "end" not in Results(path).curve_kind()
    assert run(*found[1].split()[1:], cwd=tmp_path).status == ALL_CONVERGED
    assert read(path, "tones_frequency")[:7].ravel().tolist() == values.tolist()


LONGER = {
    "order": CURVE,
    "tolerance": STOP,
    "family": FAMILY,
    "ridge": DUFFING + f"&curve {RIDGE}, over = 'tones%frequency', over_from = 0.8, over_to = 1.6, points = 300 /\n",
    "separate": CURVE.replace("values = 1.0", "others = 1.0"),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] if name != "order" else []) for name in LONGER])
def test_a_cut_curve_is_continued_with_more_points(name, tmp_path):
    """To the bits of a run that had them from the start; curves that have ended stay as they are."""
    (tmp_path / "case.nml").write_text(LONGER[name])
    run("solve", "case.nml", "-o", "whole.h5", cwd=tmp_path)
    n_used = np.count_nonzero(read(tmp_path / "whole.h5", "status").reshape(-1, 300) != UNUSED, axis=1)
    for n in sorted({2, n_used.min(), n_used.max() - 1}):
        run("solve", "case.nml", "-o", "cut.h5", "--overwrite", "--set", f"curve%points={n}", cwd=tmp_path)
        for longer in (n + 3, 300):
            done = run("resume", "cut.h5", "--set", f"curve%points={longer}", cwd=tmp_path)
            assert done.status in (ALL_CONVERGED, NOT_ALL_CONVERGED), done.stderr
        assert_same_bits(tmp_path / "whole.h5", tmp_path / "cut.h5", "tones_frequency" if name != "ridge" else "load_1_cos")
        assert "all rows are as they were written" in run("info", "cut.h5", "--check", cwd=tmp_path).stdout
        assert b"curve%points=300" in read(tmp_path / "cut.h5", "input_overrides")
        assert_same_bits(tmp_path / "whole.h5", tmp_path / "cut.h5", "reason")


def test_a_longer_curve_may_end_early_and_go_on(tmp_path):
    (tmp_path / "case.nml").write_text(CURVE)
    run("solve", "case.nml", cwd=tmp_path)
    run("solve", "case.nml", "-o", "cut.h5", "--set", "curve%points=7", cwd=tmp_path)
    done = run("resume", "cut.h5", "--set", "curve%points=300", "--time-limit", "0", cwd=tmp_path)
    assert done.status == INCOMPLETE and (read(tmp_path / "cut.h5", "status")[:6] == 1).all()
    assert run("resume", "cut.h5", cwd=tmp_path, ranks=2).status == ALL_CONVERGED
    assert_same_bits(tmp_path / "case.h5", tmp_path / "cut.h5")


def test_what_gives_a_curve_no_more_points_is_refused(tmp_path):
    (tmp_path / "case.nml").write_text(CURVE)
    run("solve", "case.nml", "--set", "curve%points=20", cwd=tmp_path)
    (tmp_path / "point.nml").write_text(DUFFING)
    run("solve", "point.nml", cwd=tmp_path)
    before = (tmp_path / "case.h5").read_bytes()
    for words, says in (
        (("case.h5", "--set", "curve%points=19"), "'case.h5' have room for 20 points; give more, not 19"),
        (("case.h5", "--set", "curve%points=1e3"), "points = 1e3 must be an integer"),
        (("case.h5", "--set", "curve%to=3"), "no --set but curve%points=N"),
        (("case.h5", "--unset", "curve%points"), "resume has no option --unset"),
        (("point.h5", "--set", "curve%points=30"), "'point.h5' has no curve"),
    ):
        done = run("resume", *words, cwd=tmp_path)
        assert done.status == BAD_INPUT and len(done.messages) == 1 and says in done.stderr, done.stderr
    assert (tmp_path / "case.h5").read_bytes() == before


def test_a_linear_model_has_a_curve(tmp_path):
    """Two masses without a law: the peaks of both modes, by few points; loaded where the first mode does not move."""
    text = "&structure type='matrices', n_dofs=3, mass=1,1,1, stiffness=1,2,4, damping=0.01,0.02,0.02 /\n&tones frequency=0.5 /\n"
    text += "&load dof='x1', tuple=1, cos=1 /\n&load dof='x2', tuple=1, cos=1 /\n"
    text += "&curve parameter='tones%frequency', from=0.5, to=2.5, peak_of='x1 (1)', 'x2 (1)' /\n"
    path = solve(text, tmp_path)
    found = re.findall(r"peak .*, of (x\d \(1\))$", run("info", path, cwd=tmp_path).stdout, re.MULTILINE)
    assert found == ["x1 (1)", "x2 (1)"], "the response of each peak, as there are several"
    value, kind, status, c = read(path, "tones_frequency", "curve_kind", "status", "coefficients")
    with Results(path) as results:
        kinds = np.array(results.curve_kind())
    peaks = value.ravel()[kinds == "peak"]
    assert peaks == pytest.approx([np.sqrt(k - 0.5 * d**2) for k, d in ((1.0, 0.01), (2.0, 0.02))], rel=1e-9)
    used = status != UNUSED
    assert (status[used] == 1).all() and used.sum() < 150 and kinds[used][-1] == "end"
    omega, amplitude = value.ravel()[used], np.hypot(*c[used, 0, 1].T)
    assert amplitude == pytest.approx(1.0 / np.abs(1.0 - omega**2 + 0.01j * omega), rel=1e-8)
    assert run("verify", path, "--points", "0", cwd=tmp_path).status == ALL_CONVERGED
    pending = shutil.copy(path, tmp_path / "pending.h5")
    with h5py.File(pending, "r+") as file:
        file["status"][used.sum() // 2 :] = PENDING
    assert run("resume", pending, cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(path, pending)


def test_a_complete_file_has_nothing_left_to_solve(tmp_path):
    (tmp_path / "curve.nml").write_text(CURVE)
    run("solve", "curve.nml", cwd=tmp_path)
    words = run("resume", "curve.h5", cwd=tmp_path).stdout
    assert "\nnothing is left to solve: curve.h5 was complete\n" in words
    with h5py.File(tmp_path / "curve.h5", "r+") as file:
        file["status"][-3:] = PENDING
    assert "nothing is left" not in run("resume", "curve.h5", cwd=tmp_path).stdout


def test_progress_counts_points_and_not_the_room_for_them(tmp_path):
    (tmp_path / "curve.nml").write_text(CURVE)
    done = run("solve", "curve.nml", cwd=tmp_path)
    n_points = re.search(r"(\d+) of \1 points converged", done.stdout)[1]
    assert done.stderr.splitlines()[-1].startswith(f"{n_points} points, ") and "used all" not in done.stdout


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ("parameter = 'tones%frequency', from = 0.5", "'to'"),
        ("parameter = 'tones%frequency', from = 0.5, to = 0.5", "the range is empty"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, start = 2.0", "must lie between 'from' and 'to'"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, start = 1.0, jump = .true.", "must be 'from' or 'to' with 'jump'"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, others = 1.0, jump = .true.", "'others' follows curves"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, switch = .true., jump = .true.", "give one of them"),
        (f"{RIDGE}, over = 'tones%frequency', over_from = 0.5, over_to = 2.5, jump = .true.", "jump: is for the motion itself"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, values = 1.0, 1.6", "1.6 does not"),
        ("parameter = 'tones%frequency', from = 0.5, to = 1.5, others = 1.0, 1.6", "1.6 does not"),
        ("parameter = 'tones%frequenzy', from = 0.5, to = 1.5", "frequenzy"),
        ("parameter = 'harmonics%order', from = 1, to = 5", "a curve follows a number of &structure"),
        ("parameter = 'structure%n_masses', from = 1, to = 5", "is not a real number"),
        ("parameter = 'tones%frequency(2)', from = 0.5, to = 1.5", "the highest number of a tone is 1"),
        ("parameter = 'tones%hertz', from = 0.5, to = 1.5", "&curve, a &sweep or --set names the one that is given"),
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
    assert "nearly vanishes (see 'combination'), first at point 0" in done.stdout, done.stdout + done.stderr
    assert "their combination (2,-1) " in done.stdout


def test_stability_that_was_not_looked_for_is_reported(tmp_path):
    model = """&structure type = 'beam', length = 0.8, n_elements = 60, bending_stiffness = 43.75, mass_per_length = 0.78
           left_support = 'clamped', right_support = 'free', damping_mass = 1.5 /
&tones frequency = 30.0 /
&harmonics order = 3 /
&load dof = 'v61', tuple = 1, cos = 0.05 /
&law type = 'elastic_stop', dof = 'v61', stiffness = 2e3, gap = 1e-4 /
&curve parameter = 'tones%frequency', from = 30.0, to = 31.0, max_step = 1.0 /
"""
    (tmp_path / "beam.nml").write_text(model)
    hint = "&stability method = 'integration' requests it"
    assert hint in run("solve", "beam.nml", cwd=tmp_path).stdout
    told = run("solve", "beam.nml", "--overwrite", "--set", "stability%method='integration'", cwd=tmp_path).stdout
    assert hint not in told and " stable" in told


@pytest.mark.parametrize("damping", [1.077e-5, 2e-5, 4e-5])
def test_all_motions_between_the_folds_of_a_light_resonance_are_saddles(tmp_path, damping):
    """Beside a fold the multipliers are 1 +- 6e-4 and move by the root of an error; a load in proportion keeps the folds."""
    text = "&structure type='chain', n_masses=1, ends='free', mass=1, coupling_stiffness=0, ground_stiffness=1,\n"
    text += f"damping_mass={damping} /\n&tones frequency=.5 /\n&harmonics order=9 /\n"
    text += f"&load dof='x1', tuple=1, cos={7.8533 * damping} /\n&law type='cubic_spring', dof='x1', stiffness=.517 /\n"
    text += "&curve parameter='tones%frequency', from=.5, to=6, points=2500, max_step=.04 /\n"
    kind, stable = read(solve(text, tmp_path), "curve_kind", "is_stable")
    first, second = np.flatnonzero(kind == 3)
    assert np.all(stable[first + 1 : second] == -1), stable[first - 2 : second + 2]
    assert np.all(stable[1 : first - 2] >= 0) and np.all(stable[second + 1 :][kind[second + 1 :] > 0] >= 0)


SHORT_STEPS = DUFFING + "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, max_step = 0.005 /\n"


def test_a_curve_without_a_number_of_points_reaches_its_end(tmp_path):
    """It needs more than the 500 rows that are reserved at first; its points are those of a curve with enough of them."""
    result = solve(SHORT_STEPS, tmp_path)
    status, value = read(result, "status", "tones_frequency")
    used = status != UNUSED
    assert used.sum() > 500 and value[used][-1] == 2.5
    wanted = read(solve(SHORT_STEPS, tmp_path, "--set", "curve%points=4000", name="given"), "curve_unknowns")
    assert np.array_equal(read(result, "curve_unknowns")[used], wanted[: used.sum()], equal_nan=True)


def test_a_given_number_of_points_is_kept(tmp_path):
    result = solve(SHORT_STEPS, tmp_path, "--set", "curve%points=40")
    assert len(read(result, "status")) == 40


def test_a_response_that_is_rounding_has_no_extremes(tmp_path):
    """Modes that nothing couples: a static load on the first, a harmonic one on the second, and a wall that is not reached."""
    path = solve("""
&structure type = 'modal_beam', length = 1.0, bending_stiffness = 0.01, mass_per_length = 1.0, n_modes = 2
   damping_stiffness = 0.004 /
&tones frequency = 1.0 /
&accuracy tolerance = 1e-2 /
&law type = 'rigid_wall', dofs = 'q1', 'q2', weights = 0.9935510611661341, 0.2253, gap = 0.012 /
&load dof = 'q2', tuple = 1, cos = -0.65, sin = 0.27 /
&load dof = 'q1', tuple = 0, cos = -0.295 /
&curve parameter = 'tones%frequency', from = 0.4, to = 2.3, max_step = 0.1, peak_of = 'q1 (1)', minimum_of = 'q1 (1)' /
""", tmp_path)
    with h5py.File(path) as file:
        assert set(file["curve_kind"][...][file["status"][...] != UNUSED]) == {1, 2, 6}  # regular, start, end
