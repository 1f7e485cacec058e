"""Laws that a motion does not reach have no influence on what is said about it."""

import numpy as np
import pytest
from program import read, run, solve
from scipy.integrate import solve_ivp

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


DETENT = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 3e-4, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 25 /
&load dof = 'x1', tuple = 1, cos = 2.7 /
&law type = '{law}', dof = 'x1', {keys} /
"""
NODES, SLOPE = np.array([0.31, 0.315, 0.32]), 100.0
FORCES = SLOPE * np.array([0.0, NODES[1] - NODES[0], 0.0])


def multipliers_past_the_detent(slope_of):
    """Of the periodic motion by shooting; `slope_of` a displacement, the force is its integral."""
    period = np.pi

    def rate(t, s):
        force, slope = slope_of(s[0])
        return [s[1], 2.7 * np.cos(2.0 * t) - 3e-4 * s[1] - s[0] - force, s[4], s[5],
                -3e-4 * s[4] - (1.0 + slope) * s[2], -3e-4 * s[5] - (1.0 + slope) * s[3]]  # fmt: skip

    state = np.array([-0.9, 0.0])
    for _ in range(5):
        end = solve_ivp(rate, (0.0, period), [*state, 1, 0, 0, 1], max_step=period / 4000, rtol=1e-9, atol=1e-11).y[:, -1]
        matrix = end[2:].reshape(2, 2)
        state = state - np.linalg.solve(matrix - np.eye(2), end[:2] - state)
    return np.linalg.eigvals(matrix)


def test_a_narrow_band_of_force_is_not_out_of_reach(tmp_path):
    """A detent that the motion passes quickly, between the samples: half of its frequency is that of the structure, whose little
    damping does not hold the subharmonic that the detent excites."""
    largest = np.abs(multipliers_past_the_detent(
        lambda x: (np.interp(x, NODES, FORCES), SLOPE * (1 if NODES[0] < x < NODES[1] else -1 if NODES[1] <= x < NODES[2] else 0))
    )).max()  # fmt: skip
    assert largest > 1.001
    laws = {
        "piecewise_linear": f"breakpoints = {', '.join(map(str, NODES))}, slopes = 0, {SLOPE}, -{SLOPE}, 0",
        "tabulated": f"displacements = 0, {', '.join(map(str, NODES))}, 1, forces = 0, 0, {FORCES[1]}, 0, 0",
    }
    for law, keys in laws.items():
        folder = tmp_path / law
        folder.mkdir()
        status, verdict, multiplier = read(
            solve(DETENT.format(law=law, keys=keys), folder, status=None), "status", "is_stable", "multiplier_real"
        )
        assert verdict[0] != 1, law
        if law == "piecewise_linear":
            assert verdict[0] == -1 and multiplier[0][0] == pytest.approx(-largest, abs=1e-4)


@pytest.mark.parametrize("law", ["piecewise_linear", "tabulated"])
def test_a_dead_band_that_is_not_left_changes_no_verdict(law, tmp_path):
    """Forces that rise throughout are zero in one interval, as behind a gap."""
    keys = {
        "piecewise_linear": "breakpoints = -5, 5, slopes = 10, 0, 20",
        "tabulated": "displacements = -6, -5, 5, 6, forces = -3, 0, 0, 2",
    }
    text = STRUCTURE.format(
        damping=-0.05, tones="0.011, 0.8123", first="1, 0", second="&load dof = 'x1', tuple = 0, 1, cos = 0.2 /"
    )
    text += f"&law type = '{law}', dof = 'x1', {keys[law]} /"
    assert read(solve(text, tmp_path, status=None), "is_stable")[0] == [-1]
