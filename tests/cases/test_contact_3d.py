"""Contact in three dimensions (`jenkins_2d` with a varying normal load) against forces without samples and against pyHarm."""

from functools import partial

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq

from in_process import nhbm

STIFFNESS, FRICTION, NORMAL = 2.0, 0.4, 1.5


def contact(preload, samples, weight=1.0, loads=()):
    model = nhbm.Model(nhbm.Matrices(np.eye(3), np.diag([1.0, 1.3, 2.0]), 0.1 * np.eye(3), labels=["x", "y", "n"]), tones=[1.1])
    for dof, harmonic, c, s in loads:
        model.load(dof, harmonic, cos=c, sin=s)
    model.law("jenkins_2d", "x", second_dofs="y", stiffness=STIFFNESS, friction_coefficient=FRICTION, normal_dofs="n",
              normal_weights=weight, normal_stiffness=NORMAL, preload=preload)  # fmt: skip
    model.set("sampling", samples=samples)
    return model


class Path:
    """A series of one tone over its phase."""

    def __init__(self, coefficients):
        self.c = coefficients[:, 0] - 1j * coefficients[:, 1]
        self.k = 1j * np.arange(len(self.c))

    def __call__(self, t):
        return (np.exp(np.multiply.outer(t, self.k)) @ self.c).real

    def rate(self, t):
        return (np.exp(np.multiply.outer(t, self.k)) @ (self.k * self.c)).real


def pieces_of_contact(x, normal, n=4000):
    """Pieces (begin, end, force) of a period of a contact that opens, each between two events found to rounding: Petrov's solution
    (E. P. Petrov and D. J. Ewins, J. Turbomach. 125 (2003) 364-371) for one slider under a normal load that varies."""
    grid = np.linspace(0, 2 * np.pi, n + 1)
    closes = grid[:-1][(normal(grid[:-1]) <= 0) & (normal(grid[1:]) > 0)]
    t = brentq(normal, closes[0], closes[0] + grid[1])
    until = brentq(normal, *next((a, a + grid[1]) for a in t + grid[1:] if normal(a) > 0 >= normal(a + grid[1])))
    pieces = []

    def next_event(margins):
        """The first zero of the functions that are positive now, and its index."""
        ends = [until]
        for margin in margins:
            a = t + 1e-9
            while a < until and margin(a + grid[1]) > 0:
                a += grid[1]
            ends.append(brentq(margin, a, a + grid[1], xtol=1e-14) if a < until and margin(a) > 0 else max(a, t + 1e-9))
        return min(ends), int(np.argmin(ends))

    def stuck(place, s):
        return STIFFNESS * (x(s) - place)

    def slipping(side, s):
        return side * FRICTION * normal(s)

    place, side = float(x(t)), 0  # it closes with a relaxed spring
    if STIFFNESS * abs(x.rate(t)) > FRICTION * normal.rate(t):
        side = int(np.sign(x.rate(t)))
    while t < until:
        if side == 0:
            force = partial(stuck, place)
            end, which = next_event([lambda s, f=force, e=e: FRICTION * normal(s) - e * f(s) for e in (1, -1)])
            pieces.append((t, end, force))
            side = (0, 1, -1)[which]
        else:
            force = partial(slipping, side)
            end, _ = next_event([lambda s, e=side: e * x.rate(s) - FRICTION * normal.rate(s) / STIFFNESS])
            pieces.append((t, end, force))
            place, side = float(x(end) - force(end) / STIFFNESS), 0
        t = end
    return pieces


def test_forces_are_those_between_events():
    """A contact that sticks, slips and opens: harmonics of its force along the motion, integrated between its events."""
    loads = [("x", 1, 0.6, 0.0), ("n", 1, 0.0, 0.8)]
    motion = contact(0.3, 8192, loads=loads).solve(order=15)
    place, force = motion["coefficients"].values, motion["force_coefficients"].values
    x, n = Path(place[0]), Path(place[2])
    normal = Path(NORMAL * place[2] + 0.3 * (np.arange(16) == 0)[:, None] * [1, 0])
    assert n.c.size == 16 and normal(np.linspace(0, 6.28, 99)).min() < 0
    nodes, weights = leggauss(40)
    pieces = pieces_of_contact(x, normal)
    assert 3 <= len(pieces) <= 12
    exact = np.zeros(16, dtype=complex)
    for begin, end, acts in pieces:
        s = begin + (end - begin) * (nodes + 1) / 2
        values = (end - begin) / 2 * weights * acts(s)
        exact += np.exp(1j * np.outer(np.arange(16), s)) @ values / np.pi
    exact[0] /= 2
    found = force[0, :, 0] + 1j * force[0, :, 1]
    assert np.abs(found - exact).max() < 1e-6 * np.abs(exact).max()
    assert np.abs(force[1]).max() < 1e-15


def test_a_sliding_contact_is_that_of_pyharm():
    """Penalty3D of pyHarm 1.2.2 with 15 harmonics, on 1024 and 4096 samples; its error is of first order in their distance, and is
    taken out by the two. (Its contacts that open have other forces: with a preload the normal force jumps there.)"""
    loads = [("x", 1, 0.7, 0.0), ("y", 1, 0.0, 0.5), ("n", 1, 0.8, 0.0), ("n", 0, -1.25, 0.0)]  # the last one is in its N0
    motion = contact(1.25, 4096, weight=-1.0, loads=loads).solve(order=15)
    coarse = np.array([[0.1025572282, -0.0082276745, 0.0], [-0.2846649695, -0.5184184795, 0.3485407481],
                       [1.3823301381, 0.4655043579, 0.0167421212], [-0.0266504944, -0.0049985845, 0.0],
                       [-0.0099217751, -0.0283848597, 0.0]])  # fmt: skip
    fine = np.array([[0.1025229463, -0.008211502, 0.0], [-0.2849715727, -0.5189417718, 0.3485406791],
                     [1.3805282158, 0.4634714036, 0.0167421837], [-0.026648913, -0.0050220812, 0.0],
                     [-0.009935271, -0.0284022144, 0.0]])  # fmt: skip
    expected = fine + (fine - coarse) / 3  # mean; cos 1, sin 1; cos 2, sin 2, of x, y and n
    found = motion["coefficients"].values
    found = np.array([found[:, 0, 0], *(found[:, k, part] for k in (1, 2) for part in (0, 1))])
    assert found == pytest.approx(expected, abs=3e-6)


def two_contacts():
    """Two bodies of three degrees of freedom, pressed together and onto the ground, under two tones."""
    model = nhbm.Model(nhbm.Matrices(np.diag([1.0, 1.0, 1.0, 1.2, 1.2, 1.2]), np.diag([2.4, 2.6, 4.1, 1.8, 2.9, 4.1]),
                                     np.diag([0.12, 0.13, 0.17, 0.12, 0.15, 0.18])), tones=[0.8, 0.8 * 2**0.5])  # fmt: skip
    for dof, at, c, s in [("x1", (1, 0), 0.6, 0.0), ("x2", (0, 1), 0.0, 0.6), ("x3", (1, 0), 0.5, 0.0), ("x6", (0, 1), 0.0, 0.6),
                          ("x3", (0, 0), 0.2, 0.0), ("x6", (0, 0), 0.3, 0.0)]:  # fmt: skip
        model.load(dof, at, cos=c, sin=s)
    model.law("jenkins_2d", ["x1", "x4"], weights=[1, -1], second_dofs=["x2", "x5"], second_weights=[1, -1],
              normal_dofs=["x3", "x6"], normal_weights=[1, -1], stiffness=5.0, friction_coefficient=0.35,
              normal_stiffness=8.0, preload=0.6)  # fmt: skip
    model.law("jenkins_2d", "x4", second_dofs="x5", normal_dofs="x6", stiffness=3.0, friction_coefficient=0.5, normal_stiffness=4.0,
              preload=0.8)  # fmt: skip
    return model


FINER = {  # amplitudes of tones by a box of order 7
    "x1": (0.3264599297, 0.0055072314), "x2": (0.0027314783, 0.4030813202), "x3": (0.0687862407, 0.0510521391),
    "x4": (0.0224461990, 0.0022247365), "x5": (0.0022061867, 0.0323107141), "x6": (0.0357085319, 0.0693938475),
}  # fmt: skip
TONES = ((1, 0), (0, 1))


def amplitudes(result):
    return {dof: [float(abs(result.nhbm.amplitude(dof, tone))) for tone in TONES] for dof in result["dof"].values}


@pytest.mark.long
def test_two_contacts_under_two_tones_by_default():
    """Its sliders are moved rarely, and forget slowly from round to round of the torus."""
    default = two_contacts().solve()
    assert default["status"] == "converged"
    for dof, found in amplitudes(default).items():
        for a, b in zip(found, FINER[dof]):
            assert abs(a - b) < 2e-2 * abs(b) + 1e-3


@pytest.mark.long  # seconds
def test_two_contacts_have_the_amplitudes_of_order_7():
    for dof, found in amplitudes(two_contacts().solve(order=7)).items():
        assert found == pytest.approx(FINER[dof], rel=1e-6)
