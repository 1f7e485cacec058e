"""Coefficients of bearings in tables over the speed, against closed forms."""

import numpy as np
import pytest

from in_process import nhbm

SPEEDS = np.array([1.0, 2.0, 4.0])
STIFFNESS = np.outer(SPEEDS, [1.0, 0.2, -0.3, 0.8]) + [4.0, 0.0, 0.0, 5.0]  # monotone cubics are exact for points on a line
DAMPING = np.outer(SPEEDS, [-0.05, 0.0, 0.0, -0.04]) + [0.6, 0.01, 0.0, 0.5]
MASS = np.outer(SPEEDS, [0.05, 0.01, 0.02]) + [0.1, 0.0, 0.2]
SHAFT = np.kron([[3.0, -3.0], [-3.0, 3.0]], np.eye(2))  # between a disk and the bearing


def rotor(speed, **keys):
    model = nhbm.Model(nhbm.Matrices(mass=np.diag([1.0, 1, 0.2, 0.2]), damping=np.zeros((4, 4)), stiffness=SHAFT,
                                     labels=["x", "y", "bx", "by"]), tones=[speed])  # fmt: skip
    model.load("x", 1, cos=0.1, frequency_power=2)
    model.load("y", 1, sin=0.1, frequency_power=2)
    model.bearing(["bx", "by"], SPEEDS, STIFFNESS, DAMPING, MASS, speed=speed, **keys)
    return model


def amplitudes(w):
    """Of the disk, a - i b: x leads y by a quarter of a turn."""
    s = (SHAFT - w**2 * np.diag([1.0, 1, 0.2, 0.2])).astype(complex)
    s[2:, 2:] -= w**2 * np.array([[0.1 + 0.05 * w, 0.01 * w], [0.01 * w, 0.2 + 0.02 * w]])
    at = np.array([4.0, 0, 0, 5]) + w * np.array([1, 0.2, -0.3, 0.8])
    s[2:, 2:] += at.reshape(2, 2) + 1j * w * (np.array([0.6, 0.01, 0, 0.5]) + w * np.array([-0.05, 0, 0, -0.04])).reshape(2, 2)
    return np.linalg.solve(s, 0.1 * w**2 * np.array([1, -1j, 0, 0]))[:2]


def test_points_sweeps_and_curves_are_those_of_the_closed_form():
    model = rotor(1.5)
    model.tie("bearing(1)%speed", "tones[0]")
    model.law("cubic_spring", "x", stiffness=0.0)
    motion = model.solve(order=1)
    assert motion["stability"] == "stable"
    for found in (model.sweep({"tones[0]": [1.2, 2.0, 3.3]}, order=1), model.curve("tones[0]", 1.2, 3.0, order=1)):
        got = [found.nhbm.amplitude(dof, 1).values for dof in "xy"]
        exact = np.transpose([amplitudes(w) for w in found["frequency"].values.ravel()])
        np.testing.assert_allclose(np.abs(got), np.abs(exact), rtol=1e-9)


def test_derivatives_count_the_table():
    model = rotor(1.5)
    model.tie("bearing(1)%speed", "tones[0]")
    model.law("cubic_spring", "x", stiffness=0.0)
    found = model.gradient("x (1)", ["tones[0]"], order=1)
    difference = (abs(amplitudes(1.5 + 1e-5)[0]) - abs(amplitudes(1.5 - 1e-5)[0])) / 2e-5
    assert found.slopes[0] == pytest.approx(difference, rel=1e-6)


@pytest.mark.parametrize("keys, message", [
    ({"dofs": ["bx", "bz"]}, "unknown degree of freedom 'bz'"),
    ({"dofs": ["bx", "bx"]}, "named twice"),
    ({"speeds": [2.0, 1.0, 4.0]}, "greater than the one before"),
    ({"stiffness": [1.0, 2.0]}, "stiffness"),
    ({"speed": 4.5}, "4.5 rad/s lies outside of the table, 1.0 to 4.0"),
])  # fmt: skip
def test_mistakes_name_the_key(keys, message):
    model = nhbm.Model(
        nhbm.Matrices(mass=np.eye(2), damping=np.zeros((2, 2)), stiffness=np.eye(2), labels=["bx", "by"]), tones=[1.0]
    )
    model.load("bx", 1, cos=1.0)
    with pytest.raises(nhbm.ModelError, match=message):
        model.bearing(**{"dofs": ["bx", "by"], "speeds": SPEEDS, "stiffness": STIFFNESS, "speed": 1.5, **keys})
