"""Laws that a motion does not reach have no influence on what is said about it."""

import pytest
from program import read, run, solve

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
