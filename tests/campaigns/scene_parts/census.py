"""All motions of polynomial systems under one tone, of given harmonics: Newton's method from hundreds of random starts."""

from __future__ import annotations

import numpy as np

from scene_parts.systems import Law, System

ORDER, SAMPLES = 3, 32  # cubes of three harmonics are resolved
STARTS, STEPS = 500, 60
SMALL, APART = 1e-9, 1e-4  # of a residual, relative to the loads; between two motions, relative to the larger one
MORE = f"&harmonics order = {ORDER} /\n"


def draw_system(draw) -> System:
    n = int(draw.integers(1, 3))
    springs = 10 ** draw.uniform(-0.2, 0.2, n)
    stiffness = np.diag(springs) + (n > 1) * draw.uniform(0.05, 0.6) * (2 * np.eye(n) - np.ones((n, n)))
    damping = draw.uniform(0.01, 0.06) * np.eye(n)
    laws = []
    for i in range(n):
        square = draw.uniform(-0.3, 0.3) if draw.random() < 0.4 else 0.0
        laws.append(Law(np.eye(n)[i], "polynomial", square=square, cube=10 ** draw.uniform(-0.7, 0.3)))
    if draw.random() < 0.25:  # two wells
        stiffness[0, 0] = -draw.uniform(0.3, 1.0)
    loads = [((1,), 0, draw.uniform(0.05, 0.4), 0.0)]
    wells = ", two wells" * bool(stiffness[0, 0] < 0)
    return System(np.eye(n), damping, stiffness, np.array([draw.uniform(0.5, 2.5)]), loads, laws, f"{n} dofs{wells}")


class Balance:
    """Harmonic balance of a system, for many motions at once: unknowns (starts, n_dofs * (2 ORDER + 1)), 1, cos, sin, cos 2 ..."""

    def __init__(self, system: System) -> None:
        self.system, self.n = system, system.n
        self.size = 2 * ORDER + 1
        theta = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
        waves = [np.ones(SAMPLES)] + [wave(k * theta) for k in range(1, ORDER + 1) for wave in (np.cos, np.sin)]
        self.back = np.array(waves).T  # samples of coefficients
        self.forth = np.array([waves[0] / SAMPLES, *(2 * wave / SAMPLES for wave in waves[1:])])
        w = system.omega[0]
        once = np.zeros((self.size, self.size))
        for k in range(1, ORDER + 1):
            once[2 * k - 1, 2 * k], once[2 * k, 2 * k - 1] = k * w, -k * w  # d/dt of cos and sin parts
        one = np.eye(self.size)
        self.linear = np.kron(system.mass, once @ once) + np.kron(system.damping, once) + np.kron(system.stiffness, one)
        self.load = np.zeros((self.n, self.size))
        for (k,), dof, cosine, sine in system.loads:
            self.load[dof, 2 * k - 1] += cosine
            self.load[dof, 2 * k] += sine
        self.load = self.load.ravel()

    def residual(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their derivatives."""
        parts = u.reshape(-1, self.n, self.size)
        residual = u @ self.linear.T - self.load
        tangent = np.repeat(self.linear[None], len(u), 0)
        for law in self.system.laws:
            i = int(np.argmax(law.weights))
            z = parts[:, i] @ self.back.T
            at = slice(i * self.size, (i + 1) * self.size)
            residual[:, at] += law.force(z) @ self.forth.T
            tangent[:, at, at] += np.einsum("as,ns,sb->nab", self.forth, law.slope(z), self.back)
        return residual, tangent

    def solve(self, u: np.ndarray) -> np.ndarray:
        """What Newton's method finds from these starts."""
        for _ in range(STEPS):
            residual, tangent = self.residual(u)
            step = np.linalg.solve(tangent, residual[..., None])[..., 0]
            length = np.linalg.norm(step, axis=1) / (1 + np.linalg.norm(u, axis=1))
            u = u - step / np.maximum(1.0, 2 * length)[:, None]
        return u[self.is_solution(u)]

    def is_solution(self, u: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.linalg.norm(self.residual(u)[0], axis=1) < SMALL * np.linalg.norm(self.load)

    def distinct(self, u: np.ndarray) -> list[np.ndarray]:
        kept: list[np.ndarray] = []
        for one in u:
            if all(not self.is_same(one, other) for other in kept):
                kept.append(one)
        return kept

    @staticmethod
    def is_same(one: np.ndarray, other: np.ndarray) -> bool:
        return bool(np.linalg.norm(one - other) < APART * max(np.linalg.norm(one), np.linalg.norm(other)))


def reference(system: System, draw) -> tuple[Balance, list[np.ndarray]]:
    balance = Balance(system)
    starts = draw.normal(size=(STARTS, len(balance.load)))
    starts *= 10 ** draw.uniform(-1.0, 0.7, (STARTS, 1)) / np.linalg.norm(starts, axis=1, keepdims=True)
    return balance, balance.distinct(balance.solve(starts))
