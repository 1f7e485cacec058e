"""tests/judge: its marching begins where it is told to, otherwise what it calls an error is one of its own; its tables come from
what is kept of a campaign that was stopped."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS))

from judge_parts.scenes import Law, Scene  # noqa: E402
from judge_parts.truth import Motion, build, error_of, neighbours_part  # noqa: E402


def test_an_exact_motion_has_no_error(tmp_path):
    """Two masses, hardly damped: what the march begins with is still there in the end. The stop is out of reach."""
    mass, stiffness = np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]])
    damping, force, w = 1e-4 * mass, np.array([0.0, 1.0]), 0.6
    scene = Scene("", mass, damping, stiffness, ["x1", "x2"], np.array([w]), 1)
    scene.laws = [Law(1, np.array([1.0, 0.0]), (10.0, 1e3, 0.0))]
    scene.loads = [((1,), force, np.zeros(2))]
    amplitudes = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, force)
    assert error_of(build(tmp_path), scene, Motion(np.array([w]), amplitudes[None, :])) < 1e-5


@pytest.mark.parametrize(("growth", "parts"), [(5e-3, True), (-5e-3, False)])
def test_neighbours_of_an_unstable_motion_part(tmp_path, growth, parts):
    """What is slow to come and what is slow to go have the same error in the first periods."""
    mass, stiffness, w = np.eye(2), np.diag([1.0, 2.0]), 0.6
    scene = Scene("", mass, np.diag([-2 * growth, 0.01]), stiffness, ["x1", "x2"], np.array([w]), 1)
    scene.laws = [Law(1, np.array([1.0, 0.0]), (10.0, 1e3, 0.0))]
    scene.loads = [((1,), np.array([1.0, 0.0]), np.zeros(2))]
    exact = 1.0 / (1.0 - w**2 - 2j * w * growth)
    motion = Motion(np.array([w]), np.array([[exact + 1e-4, 0.0]]))
    assert neighbours_part(build(tmp_path), scene, motion) == parts


def test_a_coordinate_at_rest_is_measured_by_the_whole_motion(tmp_path):
    """A slider that holds its mass: rounding is all that moves there, and no measure of anything."""
    mass, stiffness, w = np.eye(2), np.array([[2.0, 0.0], [0.0, 2.0]]), 0.6
    scene = Scene("", mass, 0.1 * mass, stiffness, ["x1", "x2"], np.array([w]), 1)
    scene.laws = [Law(5, np.array([1.0, 0.0]), (10.0, 0.0, 0.0))]
    scene.loads = [((1,), np.array([0.0, 1.0]), np.zeros(2))]
    amplitudes = np.array([[1e-15, 1.0 / (2.0 - w**2 + 0.1j * w)]])
    assert error_of(build(tmp_path), scene, Motion(np.array([w]), amplitudes)) < 1e-9


def test_a_campaign_goes_on_from_what_it_kept(tmp_path):
    """Scenes that are kept are not solved again, there is no program for it; those asked of another tolerance do not count."""
    kept = [
        {"number": 0, "title": "", "status": "converged", "estimate": 4e-3, "verdict": "stable", "truth": 2e-3, "seconds": 1.0},
        {"number": 1, "title": "", "status": "marched", "estimate": 1e-2, "verdict": "not known", "truth": 4e-2, "seconds": 3.0},
        {"number": 2, "title": "", "status": "converged", "estimate": 1e-3, "verdict": "unstable", "truth": 0.5, "seconds": 2.0},
        {"number": 3, "title": "", "status": "no result in time", "seconds": 60.0},
    ]
    lines = [{"question": [7, False, 1e-2, False, False], "case": case} for case in kept]
    lines.append({"question": [7, False, 1e-3, False, False], "case": {**kept[0], "truth": 9e-2}})
    state = tmp_path / "kept.jsonl"
    state.write_text("".join(json.dumps(line) + "\n" for line in lines))
    words = [sys.executable, TESTS / "judge", "--seed", "7", "--count", "4", "--tolerance", "1e-2", "--state", state]
    done = subprocess.run(words, env={**os.environ, "NHBM": str(tmp_path / "none")}, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr  # one is beyond three tolerances
    for row in (
        "`converged` | 2",
        "`marched` | 1",
        "of the 3 of these that are an answer: told to be unstable, or one of many | 1",
        "that leave their motion when marched | 1: 1 unstable",
        "not told, and stay when marched | 2",
        "their true error over tolerance: median; 95 %; largest | 2.1; 3.8; 4",
        "above 1; above 3 | 1; 1",
        "processor seconds of the program: median; 95 %; largest | 2.5; 51; 60",
    ):
        assert f"| {row} |" in done.stdout, (row, done.stdout)
