"""Bodies that rest in contact do not move, and laws that a motion does not reach have no influence on what is said about it."""

import numpy as np
import pytest
from program import read, run, solve

CONVERGED, INTEGRATED = 1, 18

RESTING = """
&structure type = 'matrices', n_dofs = 1, mass = {mass}, stiffness = {stiffness}, damping = {damping} /
&tones frequency = {frequency} /
&load dof = 'x1', tuple = 1, cos = {amplitude} /
&load dof = 'x1', tuple = 0, cos = {force} /
&law type = 'rigid_wall', label = 'wall', dof = 'x1', gap = {gap}, restitution = {restitution} /
"""


@pytest.mark.parametrize(
    ("stiffness", "damping", "amplitude", "force", "gap"),
    [
        (1.0, 0.1, 0.5, 1.0, 0.0),  # pressed against a wall that is touched
        (1.0, 0.1, 0.3, 1.0, 0.4),  # pressed against one behind a gap
        (0.0, 0.0, 0.5, 1.0, 0.0),  # a free body on a support
    ],
)
@pytest.mark.parametrize("unit", [1.0, 1e-5])
def test_a_body_that_is_pressed_against_a_wall_rests_there(stiffness, damping, amplitude, force, gap, unit, tmp_path):
    text = RESTING.format(mass=1.0, stiffness=stiffness, damping=damping, frequency=1.0, amplitude=amplitude * unit,
                          force=force * unit, gap=gap * unit, restitution=0.5)
    path = solve(text, tmp_path, status=None)
    status, motion, tuples = read(path, "status", "coefficients", "tuples")
    assert status[0] in (CONVERGED, INTEGRATED), read(path, "message")
    assert tuples[0, 0] == 0 and motion[0, 0, 0, 0] == pytest.approx(gap * unit, abs=1e-6 * unit)
    assert np.nanmax(abs(motion[0, 0, 1:])) < 1e-6 * unit


STRUCTURE = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = {damping}, stiffness = 1.0 /
&tones frequency = {tones} /
&load dof = 'x1', tuple = {first}, cos = 0.3 /
{second}
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
"""
WALL = "&law type = 'rigid_wall', dof = 'x1', gap = 50.0, restitution = 0.5 /"


@pytest.mark.parametrize(
    ("tones", "first", "second"),
    [("0.8", "1", ""), ("0.011, 0.8123", "1, 0", "&load dof = 'x1', tuple = 0, 1, cos = 0.2 /")],
)
@pytest.mark.parametrize("damping", [0.05, -0.05])
def test_a_wall_out_of_reach_changes_no_verdict(tones, first, second, damping, tmp_path):
    text = STRUCTURE.format(damping=damping, tones=tones, first=first, second=second)
    names = ("status", "is_stable", "n_harmonics", "n_unstable", "fallback", "truncation_estimate")
    facts = []
    for wall in ("", WALL):
        folder = tmp_path / f"with_{len(wall)}"
        folder.mkdir()
        facts.append([values[0] for values in read(solve(text + wall, folder, status=None), *names)])
    assert facts[1] == pytest.approx(facts[0], rel=1e-3)
    assert facts[0][1] == (1 if damping > 0 else -1)


def test_a_stop_that_is_hit_exerts_a_force(tmp_path):
    """Of the motion that time integration has found the one harmonic of the set stays within the gap; the motion does not."""
    (tmp_path / "case.nml").write_text(
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n"
        "&tones frequency = 1.2 /\n&harmonics order = 1 /\n&load dof = 'x1', tuple = 1, cos = 0.3 /\n"
        "&law type = 'elastic_stop', label = 'stop', dof = 'x1', stiffness = 500.0, gap = 0.3 /\n"
    )
    done = run("solve", "case.nml", cwd=tmp_path)
    assert "exerts no force" not in done.stdout + done.stderr


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
