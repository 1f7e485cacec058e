"""Folds of the two masses and the stop of inputs/gallery/stop_curve.nml by shooting, to compare with those of a balance.

usage: python tests/cases/shooting.py        prints speeds at which the motion grazes the stop and at which its curve folds

A piecewise linear motion is known exactly between its events: a steady part and exponentials of a matrix. Motions that touch the
stop once a period are found for a given time of contact, from their state at the touch, its phase and the frequency: after a
period the state is the same, and the mean velocity during contact is zero. Where the frequency is stationary over the time of
contact the curve folds. Derivatives by complex steps. The curve begins at the graze, known from the motion without contact.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

STIFFNESS = np.array([[1.0, -1.0], [-1.0, 2.0]])  # masses 1
DAMPING = 0.03 * STIFFNESS
LOAD = np.array([0.0, 0.1])  # times cos w t
GAP = 1.0
IN_CONTACT = STIFFNESS + np.diag([100.0, 0.0])
REST = {False: np.zeros(2), True: np.linalg.solve(IN_CONTACT, [100.0 * GAP, 0.0])}
TINY = 1e-30


def steady(stiffness: np.ndarray, w: complex) -> np.ndarray:
    """Rows a, b of the motion a cos w t + b sin w t."""
    diagonal, beside = stiffness - w**2 * np.eye(2), w * DAMPING
    return np.linalg.solve(np.block([[diagonal, beside], [-beside, diagonal]]), [*LOAD, 0.0, 0.0]).reshape(2, 2)


def steady_state(has_contact: bool, w: complex, t: complex) -> np.ndarray:
    a, b = steady(IN_CONTACT if has_contact else STIFFNESS, w)
    return np.concatenate([REST[has_contact] + a * np.cos(w * t) + b * np.sin(w * t), w * (b * np.cos(w * t) - a * np.sin(w * t))])


def flow(state: np.ndarray, t: complex, duration: complex, w: complex, has_contact: bool) -> np.ndarray:
    """The state (positions, velocities) at t."""
    stiffness = IN_CONTACT if has_contact else STIFFNESS
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -DAMPING]])
    return steady_state(has_contact, w, t + duration) + expm(matrix * duration) @ (state - steady_state(has_contact, w, t))


def residual(y: np.ndarray, contact: complex) -> np.ndarray:
    """Of y: velocity of the first mass at the touch, position and velocity of the second, time of the touch, frequency."""
    state, t, w = np.array([GAP + 0.0 * y[0], y[1], y[0], y[2]]), y[3], y[4]
    left = flow(state, t, contact, w, True)
    again = flow(left, t + contact, 2.0 * np.pi / w - contact, w, False)
    return np.array([*(again - state), (left[0] - GAP) / contact])


def derivatives(y: np.ndarray, contact: float) -> np.ndarray:
    """By y and by the time of contact, in columns."""
    z = np.array([*y, contact])
    moved = z + 1j * TINY * np.eye(z.size)
    return np.array([residual(row[:-1], row[-1]).imag / TINY for row in moved]).T


def motion(y: np.ndarray, contact: float) -> tuple[np.ndarray, float]:
    """The motion near y, and the slope of its frequency over the contact time."""
    for _ in range(30):
        step = np.linalg.solve(derivatives(y, contact)[:, :-1], residual(y, contact))
        y = y - step
        if np.abs(step).max() < 1e-10:
            slopes = derivatives(y, contact)
            return y, -np.linalg.solve(slopes[:, :-1], slopes[:, -1])[-1]
    raise ArithmeticError(f"no motion with contact for {contact} s")


def graze() -> float:
    """Frequency above the resonance at which the motion without contact just reaches the stop."""
    return brentq(lambda w: np.hypot(*steady(STIFFNESS, w)[:, 0]) - GAP, 0.62, 0.7, xtol=1e-15)


def folds() -> list[float]:
    """Frequencies of both folds, the lower one first, from the graze on."""
    w = graze()
    a, b = steady(STIFFNESS, w)
    touch = np.arctan2(b[0], a[0]) / w
    position, velocity = np.split(steady_state(False, w, touch), 2)
    y = np.array([velocity[0], position[1], velocity[1], touch, w])
    found, last, slope = [], 0.0, 0.0
    for contact in [*np.geomspace(1e-4, 0.05, 40), *np.arange(0.051, 0.3175, 0.001), 0.3176]:
        ahead, slope_ahead = motion(y, contact)
        if slope * slope_ahead < 0.0:
            place = brentq(lambda t, near: motion(near, t)[1], last, contact, args=(y,), xtol=1e-14)
            fold, _ = motion(y, place)
            assert largest_in_flight(fold, place) < GAP
            found.append(fold[4])
        last, y, slope = contact, ahead, slope_ahead
    return found


def largest_in_flight(y: np.ndarray, contact: float) -> float:
    """Largest position of the first mass between two contacts, except close to both."""
    w = y[4]
    left = flow(np.array([GAP, y[1], y[0], y[2]]), y[3], contact, w, True)
    free = 2.0 * np.pi / w - contact
    return max(flow(left, y[3] + contact, t, w, False)[0] for t in np.linspace(0.01, 0.99, 500) * free)


if __name__ == "__main__":
    print(f"graze {graze():.10f} rad/s")
    print("folds", ", ".join(f"{w:.10f}" for w in folds()), "rad/s")
