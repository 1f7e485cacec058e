"""tests/campaigns/points and tests/campaigns/time_domain: their time integration begins at the right state, otherwise the
reported error is its own; wrong numbers in a file are reported; tables are made from the stored part of an interrupted campaign."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CAMPAIGNS = Path(__file__).resolve().parents[1] / "campaigns"
sys.path.insert(0, str(CAMPAIGNS))

import h5py  # noqa: E402
from point_parts import pieces  # noqa: E402
from point_parts.models import Law, Model  # noqa: E402
from point_parts.truth import Motion, build, error_of, neighbours_part  # noqa: E402
from program import run  # noqa: E402


def test_an_exact_motion_has_no_error():
    """Two masses, lightly damped: the initial perturbation of the time integration is still present at the end. The stop is out of
    reach."""
    mass, stiffness = np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]])
    damping, force, w = 1e-4 * mass, np.array([0.0, 1.0]), 0.6
    model = Model("", mass, damping, stiffness, ["x1", "x2"], np.array([w]), 1)
    model.laws = [Law(1, np.array([1.0, 0.0]), (10.0, 1e3, 0.0))]
    model.loads = [((1,), force, np.zeros(2))]
    amplitudes = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, force)
    assert error_of(build(), model, Motion(np.array([w]), amplitudes[None, :])) < 1e-5


@pytest.mark.parametrize(("growth", "parts"), [(5e-3, True), (-5e-3, False)])
def test_neighbours_of_an_unstable_motion_part(growth, parts):
    """A slow growth and a slow decay have the same error in the first periods."""
    mass, stiffness, w = np.eye(2), np.diag([1.0, 2.0]), 0.6
    model = Model("", mass, np.diag([-2 * growth, 0.01]), stiffness, ["x1", "x2"], np.array([w]), 1)
    model.laws = [Law(1, np.array([1.0, 0.0]), (10.0, 1e3, 0.0))]
    model.loads = [((1,), np.array([1.0, 0.0]), np.zeros(2))]
    exact = 1.0 / (1.0 - w**2 - 2j * w * growth)
    motion = Motion(np.array([w]), np.array([[exact + 1e-4, 0.0]]))
    assert neighbours_part(build(), model, motion) == parts


def test_a_coordinate_at_rest_is_measured_by_the_whole_motion():
    """A slider that holds its mass: only rounding errors move there, and they are not used as a measure."""
    mass, stiffness, w = np.eye(2), np.array([[2.0, 0.0], [0.0, 2.0]]), 0.6
    model = Model("", mass, 0.1 * mass, stiffness, ["x1", "x2"], np.array([w]), 1)
    model.laws = [Law(5, np.array([1.0, 0.0]), (10.0, 0.0, 0.0))]
    model.loads = [((1,), np.array([0.0, 1.0]), np.zeros(2))]
    amplitudes = np.array([[1e-15, 1.0 / (2.0 - w**2 + 0.1j * w)]])
    assert error_of(build(), model, Motion(np.array([w]), amplitudes)) < 1e-9


def test_a_mass_leaves_a_stop_when_it_should():
    """x'' + x + 10 max(x, 0) = 0 from x' = 1: halves of sines of two frequencies."""
    one, root = np.eye(1), np.sqrt(11.0)
    model = pieces.Stops(one, 0 * one, one, np.ones(1), [(0.5, np.zeros(1))], [(1.0, 10.0, 0.0)])
    integration = pieces.Integration(pieces.build(), model, 1e6)
    integration.x[1] = 1.0
    times, z = integration.record(0.01, 400)
    inside = times < np.pi / root
    assert np.abs(z - np.where(inside, np.sin(root * times) / root, -np.sin(times - np.pi / root))).max() < 1e-9


def test_integration_gets_past_a_corner_between_two_stops():
    """Both stops touch at the same position of the mass; a time integration continues, and ends at its limit of steps."""
    one = np.eye(1)
    model = pieces.Stops(one, 0.2 * one, one, np.ones(1), [(0.8, np.array([0.4]))], [(1.0, 294.0, -0.3), (-1.0, 6.0, 0.3)])
    integration = pieces.Integration(pieces.build(), model, 1e5)
    integration.x[:] = -0.3, -0.1
    assert integration.record(0.1, 1000) is not None
    assert integration.record(0.1, 100_000) is None


@pytest.mark.parametrize(
    ("kinds", "count"),
    [
        ("hertz,base", 2),
        pytest.param("hertz,short_bearing,dynamic_stiffness,base", 8, marks=pytest.mark.long),
        pytest.param("all", 24, marks=pytest.mark.long),  # 20 s
    ],
)
def test_laws_that_are_named_are_held_against_integration(kinds, count):
    """All are solved within the tolerance, and no integration departs from one that is called stable."""
    words = ["--seed", "7", "--count", str(count), "--kinds", kinds, "--tolerance", "1e-2", "--title", " 1 tones, .*, (?!rigid)"]
    done = subprocess.run([sys.executable, CAMPAIGNS / "points", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "| above 1; above 3 | 0; 0 |" in done.stdout, done.stdout + done.stderr


MODEL = """&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 2,
   damping_diagonal = 9.0 /
&tones frequency = 25.0, 40.3 /
&accuracy tolerance = 1e-3 /
&load dof = 'v2', tuple = 1, 0, cos = 100.0 /
&load dof = 'v2', tuple = 0, 1, cos = 100.0 /
&law type = 'elastic_stop', label = 'stop', dof = 'v2', stiffness = 2e4, gap = 1e-3 /
&sweep parameter = 'law(stop)%gap', values = 1e-3, 2e-3 /
"""


@pytest.mark.long  # seconds
def test_what_a_file_says_wrongly_is_reported(tmp_path):
    """Points of a beam agree with exact time integration; one whose coefficients are changed by 2 % does not."""
    (tmp_path / "model.nml").write_text(MODEL)
    result = tmp_path / "model.h5"
    assert run("solve", "model.nml", "--quiet", cwd=tmp_path).status == 0
    words = [sys.executable, CAMPAIGNS / "time_domain", result, "--state", tmp_path / "rows.jsonl"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "| `converged` | 2 | motion | agrees |" in done.stdout, done.stdout + done.stderr
    with h5py.File(result, "r+") as file:
        file["coefficients"][1] *= 1.02
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0, "rows are kept"
    (tmp_path / "rows.jsonl").unlink()
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "| `converged` | 1 | lines | differs |" in done.stdout, done.stdout + done.stderr


def test_a_campaign_goes_on_from_what_it_kept(tmp_path):
    """Stored models are not solved again, and no program is given for it; those with another tolerance do not count."""
    kept = [
        {"number": 0, "title": "", "status": "converged", "estimate": 4e-3, "verdict": "stable", "truth": 2e-3, "seconds": 1.0},
        {"number": 1, "title": "", "status": "integrated", "estimate": 1e-2, "verdict": "not known", "truth": 4e-2, "seconds": 3},
        {"number": 2, "title": "", "status": "converged", "estimate": 1e-3, "verdict": "unstable", "truth": 0.5, "seconds": 2.0},
        {"number": 3, "title": "", "status": "no result in time", "seconds": 60.0},
    ]
    lines = [{"question": [7, False, 1e-2, False, False], "case": case} for case in kept]
    lines.append({"question": [7, False, 1e-3, False, False], "case": {**kept[0], "truth": 9e-2}})
    state = tmp_path / "kept.jsonl"
    state.write_text("".join(json.dumps(line) + "\n" for line in lines))
    words = [sys.executable, CAMPAIGNS / "points", "--seed", "7", "--count", "4", "--tolerance", "1e-2", "--state", state]
    done = subprocess.run(words, env={**os.environ, "NHBM": str(tmp_path / "none")}, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr  # one is beyond three tolerances
    for row in (
        "`converged` | 2",
        "`integrated` | 1",
        "answers among these, 3: reported unstable, or one of several motions | 1",
        "time integration diverges from the motion | 1: 1 unstable",
        "not reported so, and time integration remains on the motion | 2",
        "true error over tolerance of these: median; 95 %; largest | 2.1; 3.8; 4",
        "above 1; above 3 | 1; 1",
        "processor seconds of the program: median; 95 %; largest | 2.5; 51; 60",
    ):
        assert f"| {row} |" in done.stdout, (row, done.stdout)
