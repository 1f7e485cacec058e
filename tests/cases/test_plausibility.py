"""The command says what is not plausible: stops that no motion reaches, gaps of a kilometre, tones far above or below all
natural frequencies, signs that feed energy."""

import numpy as np
import pytest
from program import ALL_CONVERGED, NOT_ALL_CONVERGED, run

MODEL = """&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&tones frequency = 0.9 /
&harmonics order = 9 /
&law type = 'elastic_stop', label = 'stop', dof = 'x1', stiffness = 1.0, gap = {gap} /
"""
SWEEP = "&sweep parameter = 'tones%frequency', values = 0.1, 0.9 /\n"
IDLE = "warning: law 'stop' exerts no force: no motion reaches it; check the units of lengths and loads"


WALL = MODEL.replace("'elastic_stop'", "'rigid_wall'").replace("stiffness = 1.0, gap", "gap")


def said(text, folder, verb="solve", ranks=None):
    (folder / "case.nml").write_text(text)
    done = run(verb, "case.nml", *(["--overwrite"] if verb == "solve" else []), cwd=folder, ranks=ranks)
    assert done.status == ALL_CONVERGED, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
def test_a_stop_that_no_motion_reaches(tmp_path):
    for more in ("", SWEEP, "&curve parameter = 'tones%frequency', from = 0.5, to = 0.9 /\n"):
        assert IDLE in said(MODEL.format(gap=50.0) + more, tmp_path)
        assert "exerts no force" not in said(MODEL.format(gap=0.3) + more, tmp_path)
    assert IDLE in said(WALL.format(gap=50.0), tmp_path)
    assert "exerts no force" not in said(WALL.format(gap=0.0) + "&error_estimate is_on = .false. /\n", tmp_path)
    assert "exerts no force" not in said(WALL.format(gap=-0.5), tmp_path)  # which a body never leaves
    assert IDLE in said(MODEL.format(gap=50.0) + SWEEP, tmp_path, ranks=2)
    assert "exerts no force" not in said(MODEL.format(gap=0.3) + SWEEP, tmp_path, ranks=2)


def test_a_stop_that_a_free_body_does_not_reach(tmp_path):
    """Nothing determines its mean position: neither lengths nor loads are wrong. A spring determines it, as do other laws."""
    free = MODEL.format(gap=50.0).replace("stiffness = 1.0 /\n&load", "stiffness = 0.0 /\n&load")
    free = free.replace("&harmonics order = 9 /\n", "")
    text = said(free, tmp_path)
    assert "law 'stop' exerts no force on this motion, and nothing else holds the body" in text and IDLE not in text
    held = free + "&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /\n"
    assert IDLE in said(held, tmp_path)


def test_a_stop_is_reached_where_a_curve_moves_it(tmp_path):
    """With the gap at the start no motion reaches it, with that at the end all do; likewise where peaks are followed."""
    away = "&curve parameter = 'law(1)%gap', from = 1.0, to = {} /\n"
    assert "exerts no force" not in said(MODEL.format(gap=1.0) + away.format(0.2), tmp_path)
    assert IDLE in said(MODEL.format(gap=1.0) + away.format(0.7), tmp_path)
    peaks = "&curve parameter = 'law(1)%gap', from = 1.5, to = 0.8, peak_of = 'x1', follow = 'peak', {} /\n"
    over = peaks.format("over = 'tones%frequency', over_from = 0.7, over_to = 1.1")
    assert "exerts no force" not in said(MODEL.format(gap=1.5) + over, tmp_path)


def test_a_stop_that_prevents_a_point_is_not_called_idle(tmp_path):
    """Motions that were not found reach it, perhaps."""
    text = MODEL.format(gap=0.5).replace("stiffness = 1.0, gap", "stiffness = 100.0, gap").replace("cos = 0.1", "cos = 0.3")
    text += "&solver max_iterations = 2, fallback = .false. /\n" + SWEEP.replace("0.1, 0.9", "0.3, 0.84, 3.0")
    (tmp_path / "case.nml").write_text(text)
    done = run("solve", "case.nml", cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED and "2 of 3 points converged" in done.stdout
    assert "exerts no force" not in done.stdout


def test_a_set_that_takes_minutes(tmp_path):
    """An order of a million, perhaps for a number of points, is named before the point is solved."""
    for order, is_large in ((1000000, True), (300, False)):
        text = said(MODEL.format(gap=0.3).replace("order = 9", f"order = {order}"), tmp_path, "check")
        named = f"given are {order + 1} harmonics, with 6001128 samples: a point may take minutes"
        assert (f"warning: {named}" in text) == is_large, text


def test_values_that_suggest_a_mistake(tmp_path):
    for verb in ("solve", "check"):
        assert "warning: law 'stop': gap = 1500.0 m; lengths are in metres" in said(MODEL.format(gap=1500.0), tmp_path, verb)
        fast = MODEL.format(gap=0.3).replace("frequency = 0.9", "hertz = 50.0")
        assert "is more than 50 times the highest natural frequency, 0.1592 Hz" in said(fast, tmp_path, verb)
        slow = MODEL.format(gap=0.3).replace("mass = 1.0", "mass = 1e-6").replace("frequency = 0.9", "frequency = 1.0")
        assert "the motion is nearly static: the lowest natural frequency, 1000.0 rad/s" in said(slow, tmp_path, verb)
        negative = MODEL.format(gap=0.3).replace("damping = 0.1", "damping = -0.1")
        assert said(negative, tmp_path, verb).count("warning: the damping of 'x1' is negative, -0.1 N s/m: energy is fed") == 1
    massless = MODEL.format(gap=0.3).replace("mass = 1.0, damping = 0.1", "mass = 0.0")
    assert "warning: all masses and dampings of the structure are zero: it follows its loads" in said(massless, tmp_path)
    assert "warning: all masses of the structure are zero: springs" in said(
        MODEL.format(gap=0.3).replace("mass = 1.0", "mass = 0.0"), tmp_path
    )
    assert "see the warnings above" in said(MODEL.format(gap=1500.0), tmp_path, "check")
    checked = said(MODEL.format(gap=0.3), tmp_path, "check")
    assert "the input is valid" in checked and "0 MiB" not in checked


TWO = """&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.4, damping = {damping}, stiffness = {stiffness} /
&tones frequency = 1.4 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 0.01 /
"""


def test_modes_that_grow_and_modes_that_do_not_oscillate(tmp_path):
    """One wrong sign of a coupling; damping in another unit. The eigenvalues say whether the words are due."""
    for stiffness, damping, words in (
        ((3.0, -1.0, 1.0, 1.5), (0.05, 0.02), "a mode of "),
        ((3.0, -1.0, -1.0, 1.5), (50.0, 20.0), "no mode of the structure oscillates"),
        ((3.0, -0.1, 0.1, 1.5), (0.05, 0.02), ""),
        ((3.0, -1.0, -1.0, 1.5), (0.05, 0.02), ""),
    ):
        k, c, m = np.reshape(stiffness, (2, 2)), np.diag(damping), np.diag((1.0, 0.4))
        state = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]])
        roots = np.linalg.eigvals(state)
        assert (roots.real > 1e-9).any() == (words == "a mode of ")
        assert (abs(roots.imag) > 1e-9).any() != words.startswith("no mode")
        text = TWO.format(stiffness=", ".join(map(str, stiffness)), damping=", ".join(map(str, damping)))
        told = said(text, tmp_path, verb="check")
        assert [words for words in ("a mode of ", "no mode of the structure oscillates") if words in told] == [words] * bool(words)


@pytest.mark.parametrize(("stiffness", "damping"), [
    ((2.0, -1.0, -10.0, 2.0), 0.05), ((2.0, -10.0, -1.0, 2.0), 5.0), ((2.0, -1.0, -1.1, 2.0), 0.05), ((2.0, 3.0, -3.0, 2.0), 5.0)])
def test_an_unsymmetric_stiffness_from_which_a_motion_departs(stiffness, damping, tmp_path):
    """A digit too many; the roots say whether one without oscillation grows."""
    k, m = np.reshape(stiffness, (2, 2)), np.diag((1.0, 0.4))
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(m, k), -damping * np.linalg.inv(m)]])
    departs = any(root.real > 0.0 and root.imag == 0.0 for root in np.linalg.eigvals(state))
    told = said(TWO.format(stiffness=", ".join(map(str, stiffness)), damping=f"{damping}, {damping}"), tmp_path, verb="check")
    assert ("the stiffness matrix has a negative eigenvalue" in told) == departs


def test_what_can_be_meant_otherwise(tmp_path):
    """Loads that repeat or have no effect, phases in degrees, values of a sweep given twice, curves without their peak."""
    text = MODEL.format(gap=0.05)
    twice = text + "&load dof = 'x1', tuple = -1, cos = 0.1, phase = 90.0 /\n&load dof = 'x1', tuple = 1, cos = 0.1 /\n"
    twice = said(twice, tmp_path)
    assert "warning: load 2: phase = 90.0 rad is more than a turn; 90 degrees are 1.5708 rad" in twice
    assert "warning: loads 1 and 3 act at the same place with the same tuple, (1): they are added" in twice
    assert "loads 1 and 2" not in twice and "loads 2 and 3" not in twice
    assert "they are added" not in said(text + "&load dof = 'x1', tuple = 1, sin = 0.1 /\n", tmp_path)
    unloaded = text.replace("cos = 0.1", "cos = 0.0")
    assert "warning: no load acts" in said(unloaded, tmp_path)
    assert "no load acts" not in said(unloaded + "&sweep parameter = 'load(1)%cos', values = 0.0, 0.1 /\n", tmp_path)
    repeated = SWEEP.replace("0.1, 0.9", "0.5, 0.9, 0.9, 0.5")
    assert "warning: &sweep(1): tones%frequency = 0.9 is given twice in succession" in said(text + repeated, tmp_path)
    assert "given twice" not in said(text + SWEEP.replace("0.1, 0.9", "0.5, 0.9, 0.5"), tmp_path)
    once = "&sweep parameter = 'load(1)%cos', from = 0.1, to = {}, n = 1 /\n"
    assert "&sweep(1): with n = 1 only from = 0.1 is solved, not to = 0.2; n counts" in said(text + once.format(0.2), tmp_path)
    assert "with n = 1" not in said(text + once.format(0.1), tmp_path)
    product = text.replace("0.9 /", "2*0.9 /").replace("tuple = 1", "tuple = 1, 0").replace("order = 9", "order = 1")
    assert "(1,-1) has the frequency 0; use one tone of 0.9 rad/s" in said(product, tmp_path, "check")
    assert "; 2*3.14 in an input is 3.14 twice" in said(product, tmp_path, "check")
    curve = "&curve parameter = 'tones%frequency', from = 0.8, to = {}, peak_of = 'x1 (1)' /\n"
    assert "no peak: the response of 'peak_of' is largest at an end of the curve" in said(text + curve.format(0.9), tmp_path)
    assert "no peak" not in said(text + curve.format(2.0), tmp_path)
    adaptive = text.replace("&harmonics order = 9 /", "") + curve.format(2.0).replace("(1)", "(60)")
    assert "no peak" in (answer := said(adaptive, tmp_path)) and "or not in its sets of harmonics" in answer


def test_a_stop_that_both_tones_reach_together(tmp_path):
    """Phases of several tones are examined independently of each other: opposite ones, at which the motions cancel, are not
    enough."""
    text = MODEL.format(gap=0.5).replace("tuple = 1, cos = 0.1", "tuple = 1, 0, cos = 0.05")
    text = text.replace("frequency = 0.9", "frequency = 1.0, 1.618033988749895")
    assert "exerts no force" not in said(text + "&load dof = 'x1', tuple = 0, 1, cos = 0.8 /\n", tmp_path)


@pytest.mark.parametrize(
    ("hertz", "common", "tuples"), [("1.0, 1.5, 3.0", "0.5 Hz", "2, 3 and 6"), ("4.0, 6.0, 10.0, 14.0", "2.0 Hz", "2, 3, 5 and 7")]
)
def test_commensurate_tones_are_named_at_once(hertz, common, tuples, tmp_path):
    n = len(hertz.split(","))
    (tmp_path / "case.nml").write_text(
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n"
        f"&tones hertz = {hertz} /\n&load dof = 'x1', tuple = {'1, ' + ', '.join((n - 1) * '0')}, cos = 0.3 /\n"
        f"&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /\n"
    )
    done = run("check", "case.nml", cwd=tmp_path)
    assert f"one tone of {common}" in done.stdout + done.stderr and tuples in done.stdout + done.stderr


def test_a_joint_that_sticks_throughout_is_named(tmp_path):
    text = (
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n&tones frequency = 0.7 /\n"
        "&load dof = 'x1', tuple = 1, cos = {load} /\n&law type = 'jenkins', dof = 'x1', stiffness = 1.0, limit = 1.0 /\n"
    )
    for load, sticks in ((0.1, True), (5.0, False)):
        (tmp_path / "case.nml").write_text(text.format(load=load))
        done = run("solve", "case.nml", "--overwrite", cwd=tmp_path)
        assert ("continuum" in done.stdout + done.stderr) == sticks
