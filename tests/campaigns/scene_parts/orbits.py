"""One tone, and a coordinate without mass, or one that nothing holds: motions and multipliers by shooting over one period."""

from __future__ import annotations

import numpy as np

from scene_parts.systems import Law, Motion, System

SAMPLES = 256
CLOSE = 1e-3  # of the largest multiplier to 1
MORE = "&accuracy tolerance = 1e-3 /\n"


def _law(draw, weights, static: float) -> Law:
    kind = draw.choice(["cubic", "polynomial", "stop"])
    if kind == "stop":
        stiffness, gap = static * 10 ** draw.uniform(-0.5, 1.5), draw.uniform(0.05, 0.95)
        return Law(weights, "stop", stiffness=stiffness, gap=gap, is_two_sided=bool(draw.random() < 0.5))
    square = draw.uniform(-0.3, 0.3) * (kind == "polynomial")
    return Law(weights, "polynomial", square=square, cube=static * 10 ** draw.uniform(-1.0, 0.5))


def draw_massless(draw) -> System:
    """A chain of two or three coordinates to the ground, one of which has no mass but a dashpot."""
    n = int(draw.integers(2, 4))
    without = int(draw.integers(0, n))
    springs, dashpots = 10 ** draw.uniform(-0.3, 0.3, n + 1), 10 ** draw.uniform(-2.0, -1.0, n + 1)
    mass = np.diag(np.where(np.arange(n) == without, 0.0, 10 ** draw.uniform(-0.3, 0.3, n)))
    stiffness, damping = _chain(springs), _chain(dashpots)
    damping[without, without] += 10 ** draw.uniform(-1.0, 0.5)
    if draw.random() < 0.3:  # a circuit or a piezoelectric layer: not symmetric
        other = (without + 1) % n
        damping[without, other] += draw.uniform(-0.3, 0.3)
        stiffness[other, without] += draw.uniform(-0.2, 0.2)
    dof = int(draw.integers(0, n))
    law = _law(draw, np.eye(n)[dof], 1.0)
    if draw.random() < 0.3 and law.kind != "stop" and dof != without:  # two wells
        stiffness[dof, dof] -= 2.5
        law = Law(law.weights, "polynomial", cube=draw.uniform(0.5, 2.0))
    place = int(draw.choice(np.flatnonzero(np.diag(mass))))
    loads = [((1,), place, draw.uniform(0.1, 0.8), 0.0)]
    omega = np.array([draw.uniform(0.4, 2.2)])
    system = System(mass, damping, stiffness, omega, loads, [], f"{n} dofs, x{without + 1} without mass")
    system.add_law(law)
    return system


def draw_free(draw) -> tuple[System, np.ndarray]:
    """A mass on a dashpot alone, or a chain that nothing holds but a dashpot; and the displacement that no force knows."""
    n = int(draw.integers(2, 4))
    mass = np.diag(10 ** draw.uniform(-0.5, 0.5, n))
    springs = 10 ** draw.uniform(-0.3, 0.3, n + 1)
    dashpots = 10 ** draw.uniform(-2.0, -1.0, n + 1)
    springs[n] = 0.0
    if draw.random() < 0.5:  # the last mass hangs on a dashpot
        springs[n - 1] = dashpots[n] = 0.0
        gauge, held, kind = np.eye(n)[n - 1], n - 1, "the last on a dashpot"
        dashpots[n - 1] *= 3
    else:
        springs[0] = 0.0
        gauge, held, kind = np.ones(n), 0, "nothing holds the chain"
        dashpots[0] *= 3
    weights = np.eye(n)[0]
    if not held:
        weights = np.eye(n)[0] - np.eye(n)[1]
    law = _law(draw, weights, 1.0)
    loads = [((1,), 0, draw.uniform(0.1, 0.8), 0.0)]
    omega = np.array([draw.uniform(0.5, 2.2)])
    system = System(mass, _chain(dashpots), _chain(springs), omega, loads, [], f"{n} dofs, {kind}")
    system.add_law(law)
    return system, gauge


def _chain(springs: np.ndarray) -> np.ndarray:
    return np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)


def compare(system: System, motion: Motion, gauge: np.ndarray | None) -> tuple[float, str, str]:
    """Error of the motion (root mean square at the laws, relative), the verdict by multipliers, and the largest of them."""
    start = np.concatenate([motion.at(0.0), motion.rate_at(0.0)[system.massive]])
    found = system.orbit(start, gauge)
    if found is None:
        return float("nan"), "no orbit", ""
    y, multipliers = found
    times = np.arange(SAMPLES) * 2 * np.pi / system.omega[0] / SAMPLES
    there = motion.at(times) @ system.weights.T
    error = np.linalg.norm(system.samples(y, times) @ system.weights.T - there) / np.linalg.norm(there)
    largest = np.abs(multipliers).max()
    verdict = "close" if abs(largest - 1) < CLOSE else "stable" if largest < 1 else "unstable"
    return float(error), verdict, f"{largest:.5f}"
