"""The speeds at which a whirling rotor touches its seal, by any mesh of the shaft, against the closed form of the circular whirl.

Of one harmonic the rub is at rest in the whirl: first contact is where the radius of the rotor without seal is the clearance.
"""

import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

from in_process import nhbm

CLEARANCE, UNBALANCE = 60e-6, 4e-4  # m, kg m
# Numbers of nodes, of 4 degrees of freedom each, and orders: rounding errors grow with the fourth power of the number of elements.
SCENES = ((4, 1), *(pytest.param(*scene, marks=pytest.mark.long) for scene in ((13, 1), (16, 1), (19, 3), (22, 1), (28, 1))))


def rotor(n_nodes):
    made = nhbm.Rotor()
    made.shaft(np.linspace(0.0, 1.2, n_nodes), diameter=0.04)
    made.disk(0.4, mass=8.0, diametral=0.03, polar=0.06)
    made.disk(0.8, mass=10.0, diametral=0.05, polar=0.1)
    for z in (0.0, 1.2):
        made.bearing(z, stiffness=3.4e6, damping=700.0)
    return made.structure()


def radii(structure):
    """Radius of the whirl at the second disk without the seal, as a function of the speed."""
    dense = {name: np.asarray(m.todense() if hasattr(m, "todense") else m) for name, m in structure.matrices().items()}
    spin = structure.gyroscopic_by_speed
    gyroscopic = np.asarray(spin.todense() if hasattr(spin, "todense") else spin)
    labels = list(structure.labels)
    third = len([label for label in labels if label.endswith(".x")]) // 3  # elements to the first disk
    load = np.zeros(len(labels), complex)
    load[[labels.index(f"n{third + 1}.{axis}") for axis in "xy"]] = UNBALANCE * np.array([1.0, -1.0j])

    def radius(speed):
        stiffness = dense["stiffness"] - speed**2 * dense["mass"] + 1j * speed * (dense["damping"] + speed * gyroscopic)
        return abs(np.linalg.solve(stiffness, speed**2 * load)[labels.index(f"n{2 * third + 1}.x")])

    return radius


@pytest.mark.parametrize(("n_nodes", "order"), SCENES)
def test_first_contact_is_located_for_any_mesh(n_nodes, order):
    structure = rotor(n_nodes)
    radius = radii(structure)
    model = nhbm.Model(structure, tones=[200.0])
    model.set("structure", speed=[200.0])
    model.tie("structure.speed", "tones[0]")
    model.load("disk1.x", 1, cos=UNBALANCE, frequency_power=2)
    model.load("disk1.y", 1, sin=UNBALANCE, frequency_power=2)
    model.law("annular_clearance", ["disk2.x", "disk2.y"], stiffness=2e7, clearance=CLEARANCE, friction_coefficient=0.05)
    for start, stop, kinds in ((150.0, 200.0, ["grazing"]), (240.0, 150.0, ["fold", "grazing"])):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", nhbm.NotConverged)  # where the contact ends the second curve turns back
            curve = model.curve("tones[0]", start, stop, order=order)
        events = curve.nhbm.events("disk2.x (1)")
        assert sorted(events.kind) == sorted(["start", *kinds, "end"])
        exact = brentq(lambda speed: radius(speed) - CLEARANCE, *((150.0, 200.0) if start < stop else (200.0, 240.0)))
        found = events.tones_frequency[events.kind.isin(kinds)]
        np.testing.assert_allclose(found, exact, rtol=1e-7)
        free = curve.nhbm.amplitude("disk2.x", 1) < 0.94 * CLEARANCE  # the linear rotor, whose bearings damp it
        assert free.any() and (curve.stability[free] == "stable").all()


def test_the_onset_of_oil_whirl_is_located_before_the_seal_is_reached():
    """Where the largest growth rate of the linear rotor, with the bearings at each speed, changes its sign."""
    made = nhbm.Rotor()
    made.shaft(np.linspace(0.0, 0.9, 10), diameter=0.03)
    for z, mass in ((0.2, 4.0), (0.4, 6.0), (0.7, 3.0)):
        made.disk(z, mass=mass, diametral=0.0025 * mass, polar=0.005 * mass)
    stiffness = [[1.5e6, 2e5, -2e5, 1.4e6], [2e6, 1e5, -1e5, 1.8e6], [3e6, 1e4, -1e4, 2.8e6]]
    for z in (0.0, 0.9):
        made.bearing(z, stiffness=stiffness, damping=[800.0, 700.0, 500.0], speeds=[0.0, 300.0, 1200.0])
    made.unbalance(0.4, 2e-4)
    model = made.model(speed=100.0)
    model.law("annular_clearance", ["disk2.x", "disk2.y"], stiffness=5e6, clearance=80e-6, friction_coefficient=0.1)
    curve = model.curve("tones[0]", 80.0, 130.0, order=1)
    onset = brentq(lambda speed: made.campbell([speed])[1].max(), 80.0, 130.0)
    events = curve.nhbm.events("disk2.x (1)")
    np.testing.assert_allclose(events.tones_frequency[events.kind == "neimark_sacker"], onset, rtol=1e-6)
    unknown = curve.stability == "unknown"
    assert set(np.flatnonzero(unknown)) <= set(np.flatnonzero(curve.curve_kind == "neimark_sacker"))
    assert ((curve.stability == "stable") == (curve.tones_frequency > onset))[~unknown].all()
