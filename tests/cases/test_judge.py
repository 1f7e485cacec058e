"""The marching of tests/judge begins where it is told to: otherwise what it calls an error is one of its own."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from judge_parts.scenes import Law, Scene  # noqa: E402
from judge_parts.truth import Motion, build, error_of  # noqa: E402


def test_an_exact_motion_has_no_error(tmp_path):
    """Two masses, hardly damped: what the march begins with is still there in the end. The stop is out of reach."""
    mass, stiffness = np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]])
    damping, force, w = 1e-4 * mass, np.array([0.0, 1.0]), 0.6
    scene = Scene("", mass, damping, stiffness, ["x1", "x2"], np.array([w]), 1)
    scene.laws = [Law(1, np.array([1.0, 0.0]), (10.0, 1e3, 0.0))]
    scene.loads = [((1,), force, np.zeros(2))]
    amplitudes = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, force)
    assert error_of(build(tmp_path), scene, Motion(np.array([w]), amplitudes[None, :])) < 1e-5
