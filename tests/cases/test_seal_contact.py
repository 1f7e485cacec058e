"""The speeds at which a whirling rotor touches its seal, by any mesh of the shaft and any step length, against closed forms.

The motion without contact is that of the linear rotor with its bearings at each speed: first contact is where the larger semi-axis
of its ellipse is the clearance. Of one harmonic the rub is at rest in a circular whirl, with the radius r of

    r |1 + h k (1 - c/r) (1 + i mu)| = |a|

where a is the radius without seal and h the compliance at the seal, both in the rotating frame.
"""

import warnings

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from in_process import nhbm

CLEARANCE, UNBALANCE = 60e-6, 4e-4  # m, kg m
STIFFNESS, FRICTION = 2e7, 0.05
MAX_NODES_OF_VERDICTS = 13  # of larger models the stability is not computed unless it is requested
SPEEDS = (0.0, 300.0, 1200.0)  # of the table, which is a straight line and so not a matter of interpolation
# Kinds of bearings, numbers of nodes of 4 degrees of freedom each, orders, longest steps: rounding errors grow with the fourth
# power of the number of elements.
SHORT = (("constant", 4, 1, None), ("table", 4, 1, 0.1), ("elliptic", 4, 3, None), ("elliptic table", 13, 3, 0.1))
LONG = (
    ("constant", 13, 1, None), ("constant", 16, 1, None), ("constant", 19, 3, None), ("constant", 22, 1, None),
    ("constant", 28, 1, None),
    ("table", 7, 1, 0.01), ("table", 10, 3, None), ("table", 13, 1, 0.1), ("table", 16, 1, 0.03),
    ("elliptic", 7, 3, 0.1), ("elliptic", 10, 5, 0.01), ("elliptic", 16, 3, None),
    ("elliptic table", 4, 3, 0.1), ("elliptic table", 7, 5, 0.01), ("elliptic table", 16, 3, None),
)  # fmt: skip
SCENES = (*SHORT, *(pytest.param(*scene, marks=pytest.mark.long) for scene in LONG))
WHOLE = (("constant", 4, None), *(pytest.param(*scene, marks=pytest.mark.long) for scene in (
    ("table", 4, 0.1), ("table", 7, None), ("table", 10, 0.01), ("table", 13, None), ("constant", 16, 0.1))))  # fmt: skip


def bearing_at(kind, speed):
    """Stiffness across and along, damping."""
    stiffness = 3.0e6 + 2.0e3 * speed if "table" in kind else 3.4e6
    damping = 900.0 - 0.5 * speed if "table" in kind else 700.0
    return stiffness, stiffness * (1.25 if "elliptic" in kind else 1.0), damping


def without_bearings(n_nodes):
    made = nhbm.Rotor()
    made.shaft(np.linspace(0.0, 1.2, n_nodes), diameter=0.04)
    made.disk(0.4, mass=8.0, diametral=0.03, polar=0.06)
    made.disk(0.8, mass=10.0, diametral=0.05, polar=0.1)
    return made


def rubbing(kind, n_nodes):
    """The model with its seal."""
    made = without_bearings(n_nodes)
    for z in (0.0, 1.2):
        if "table" in kind:
            values = [bearing_at(kind, speed) for speed in SPEEDS]
            stiffness = [[x, 0.0, 0.0, y] for x, y, _ in values]
            made.bearing(z, stiffness=stiffness, damping=[d for _, _, d in values], speeds=list(SPEEDS))
        else:
            x, y, damping = bearing_at(kind, 0.0)
            made.bearing(z, stiffness=np.diag([x, y]), damping=damping)
    made.unbalance(0.4, UNBALANCE)
    model = made.model(speed=200.0)
    model.law("annular_clearance", ["disk2.x", "disk2.y"], stiffness=STIFFNESS, clearance=CLEARANCE, friction_coefficient=FRICTION)
    return model


class Linear:
    """The rotor without its seal."""

    def __init__(self, kind, n_nodes):
        def dense(matrix):
            return np.asarray(matrix.todense() if hasattr(matrix, "todense") else matrix)

        structure = without_bearings(n_nodes).structure()
        self.kind, self.matrices = kind, {name: dense(matrix) for name, matrix in structure.matrices().items()}
        self.gyroscopic = dense(structure.gyroscopic_by_speed)
        labels = list(structure.labels)
        third = (n_nodes - 1) // 3  # elements to the first disk
        ends = (1, n_nodes), (third + 1,), (2 * third + 1,)
        self.ends, self.first, self.second = (
            [[labels.index(f"n{node}.{axis}") for axis in "xy"] for node in nodes] for nodes in ends
        )

    def motion(self, speed):
        """Complex amplitudes x and y of the second disk, and its compliance in a circular whirl."""
        z = self.matrices["stiffness"] - speed**2 * self.matrices["mass"] + 1j * speed**2 * self.gyroscopic
        *stiffness, damping = bearing_at(self.kind, speed)
        for end in self.ends:
            for i, k in zip(end, stiffness):
                z[i, i] += k + 1j * speed * damping
        loads = np.zeros((len(z), 2), complex)
        loads[self.first[0], 0] = UNBALANCE * speed**2 * np.array([1.0, -1.0j])
        loads[self.second[0], 1] = [1.0, -1.0j]
        found = np.linalg.solve(z, loads)[self.second[0]]
        return found[0, 0], found[1, 0], found[0, 1]

    def largest_radius(self, speed):
        x, y, _ = self.motion(speed)
        return 0.5 * (abs(x + 1j * y) + abs(x.conjugate() + 1j * y.conjugate()))

    def first_contact(self, low, high):
        return brentq(lambda speed: self.largest_radius(speed) - CLEARANCE, low, high)

    def rub(self, speed, radius):
        """Zero on the curve of circular whirls in contact."""
        a, _, h = self.motion(speed)
        return abs(radius * (1 + h * STIFFNESS * (1 - CLEARANCE / radius) * (1 + 1j * FRICTION))) / abs(a) - 1.0


def follow(model, *words, **keys):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", nhbm.NotConverged)  # where the contact ends the second curve turns back
        return model.curve("tones[0]", *words, **{key: value for key, value in keys.items() if value is not None})


@pytest.mark.parametrize(("kind", "n_nodes", "order", "max_step"), SCENES)
def test_first_contact_is_located_for_any_mesh(kind, n_nodes, order, max_step):
    linear, model = Linear(kind, n_nodes), rubbing(kind, n_nodes)
    for start, stop, kinds in ((150.0, 200.0, ["grazing"]), (240.0, 150.0, ["fold", "grazing"])):
        is_circular = "elliptic" not in kind
        curve = follow(model, start, stop, order=order, max_step=max_step, points=None if is_circular else 80)
        events = curve.nhbm.events("disk2.x (1)")
        exact = linear.first_contact(*((150.0, 200.0) if start < stop else (200.0, 240.0)))
        if is_circular:
            assert sorted(events.kind) == sorted(["start", *kinds, "end"])
            found = events.tones_frequency[events.kind.isin(kinds)]
        else:  # the rub that begins on a part of each turn has further events
            found = events.tones_frequency[events.kind == "grazing"].iloc[:1]
            assert len(found) == 1
        np.testing.assert_allclose(found, exact, rtol=1e-7)
        free = curve.nhbm.amplitude("disk2.x", 1) < 0.9 * CLEARANCE  # the linear rotor, whose bearings damp it
        assert free.any() and (curve.stability[free] != "unstable").all()
        if is_circular and n_nodes <= MAX_NODES_OF_VERDICTS:
            assert (curve.stability[free] == "stable").all()


@pytest.mark.parametrize(("kind", "n_nodes", "max_step"), WHOLE)
def test_all_events_of_a_rub_are_those_of_its_closed_form(kind, n_nodes, max_step):
    """Contact begins at a speed, is lost at a fold far beyond, turns again where it ends, and begins at a third speed."""
    linear = Linear(kind, n_nodes)
    curve = follow(rubbing(kind, n_nodes), 60.0, 700.0, order=1, max_step=max_step, peak_of="disk2.x (1)")
    events = curve.nhbm.events("disk2.x (1)")
    grazes = events.tones_frequency[events.kind == "grazing"].to_numpy()
    exact = [linear.first_contact(*ends) for ends in ((60.0, 180.0), (190.0, 300.0), (450.0, 700.0))]
    np.testing.assert_allclose(grazes, exact, rtol=1e-7)
    radius = curve.nhbm.amplitude("disk2.x", 1).to_numpy()
    step = 1e-5

    def slope(at, i):
        ends = [np.array(at) * (1.0 + sign * step * (np.arange(2) == i)) for sign in (-1.0, 1.0)]
        return (linear.rub(*ends[1]) - linear.rub(*ends[0])) / step

    for name, i, n in (("peak", 0, 1), ("fold", 1, 2)):  # no change of the residual with the speed, with the radius
        rows = np.flatnonzero(curve.curve_kind == name)
        assert len(rows) == n, name
        at = [float(curve.tones_frequency[rows[0]]), float(radius[rows[0]])]
        true = fsolve(lambda x, at=at, i=i: [linear.rub(*(x * at)), slope(x * at, i)], np.ones(2), xtol=1e-12)
        np.testing.assert_allclose(true, 1.0, atol=1e-6)
    np.testing.assert_allclose(curve.tones_frequency[rows[1]], exact[1], rtol=1e-7)


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
