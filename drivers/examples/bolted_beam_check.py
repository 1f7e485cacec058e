"""Frequency and damping of the beam of bolted_beam.py by two other methods, with laws and integration of their own: slow cycles
of a force with the shape of the mode (quasi-static modal analysis), and free decay.
"""

import numpy as np
import scipy.linalg

import bolted_beam

RIGID = 1e-3  # [1/s2], times the mass: holds the free beam at rest
N_RIGID = 3


class Joint:
    """The beam after its bolts were tightened, with springs and sliders at its pairs of nodes."""

    def __init__(self, structure) -> None:
        self.mass, self.stiffness = structure.mass.toarray(), structure.stiffness.toarray()
        self.t, self.n = (np.array(structure.dofs_of(f"joint.{direction}")) for direction in "xz")
        self.end = structure.dofs_of("upper_end.z")[0]
        self.k = bolted_beam.CONTACT * bolted_beam.areas(structure)
        self.gap = bolted_beam.CROWN * (2 * bolted_beam.positions(structure) / bolted_beam.LAP) ** 2
        self.bolts = np.zeros(len(self.mass))
        dofs, values = structure.loads["bolts"]
        self.bolts[dofs] = bolted_beam.TENSION * values
        start = np.zeros(len(self.mass))
        start[self.n] = self.gap + 1e-6
        self.rest, self.sliders = self.loaded(start, np.zeros(len(self.t)), self.bolts)
        tangent = self.stiffness + self.forces(self.rest, self.sliders)[1]
        squares, shapes = scipy.linalg.eigh((tangent + tangent.T) / 2, self.mass)
        self.omega, self.shape = np.sqrt(squares[N_RIGID]), shapes[:, N_RIGID] / shapes[self.end, N_RIGID]
        self.modal_mass = self.shape @ self.mass @ self.shape

    def forces(self, q, sliders):
        """Forces of the joint, their tangent, and where they move the sliders."""
        normal = self.k * np.maximum(0.0, q[self.n] - self.gap)
        stuck, limit = self.k * (q[self.t] - sliders), bolted_beam.FRICTION * normal
        friction, slips = np.clip(stuck, -limit, limit), abs(stuck) >= limit
        force, tangent = np.zeros(len(q)), np.zeros(self.mass.shape)
        force[self.t], force[self.n] = friction, normal
        tangent[self.t, self.t] = np.where(slips, 0.0, self.k)
        tangent[self.t, self.n] = np.where(slips & (normal > 0), np.sign(stuck) * bolted_beam.FRICTION * self.k, 0.0)
        tangent[self.n, self.n] = np.where(normal > 0, self.k, 0.0)
        return force, tangent, q[self.t] - friction / self.k

    def newton(self, q, sliders, residual):
        """`residual` gives that of everything but the joint, and its derivative."""
        for _ in range(50):
            force, tangent, _ = self.forces(q, sliders)
            left, slope = residual(q)
            step = np.linalg.solve(slope + tangent, -left - force)
            q = q + step
            if abs(step[self.t]).max() + abs(step[self.n]).max() < 1e-13:
                return q, self.forces(q, sliders)[2]
        raise AssertionError("Newton's method does not converge")

    def loaded(self, q, sliders, load):
        held = self.stiffness + RIGID * self.mass
        return self.newton(q, sliders, lambda x: (held @ x - load, held))

    def slow_cycles(self, amplitude, n=12):
        """Amplitude of the end [m], secant frequency [rad/s] and damping ratio, from the last of two and a quarter cycles of a
        force with the shape of the mode: its work is 2 pi ratio times the product of the largest force and displacement. The
        damping that is proportional to the mass is added."""
        largest = self.omega**2 * amplitude
        angles = np.linspace(0.0, 4.5 * np.pi, 9 * 2 * n + 1)
        q, sliders, moved = self.rest, self.sliders, []
        for angle in angles:
            q, sliders = self.loaded(q, sliders, self.bolts + largest * np.sin(angle) * (self.mass @ self.shape))
            moved.append(self.shape @ self.mass @ (q - self.rest) / self.modal_mass)
        moved, force = np.array(moved[-8 * n - 1 :]), largest * np.sin(angles[-8 * n - 1 :])
        reach = np.ptp(moved) / 2
        work = abs(np.sum((force[1:] + force[:-1]) / 2 * np.diff(moved)))
        omega = np.sqrt(np.ptp(force) / np.ptp(moved))
        return reach, omega, work / (np.pi * reach * np.ptp(force)) + bolted_beam.DAMPING / (2 * omega)

    def decay(self, amplitude, n_cycles=14, n_steps=200, n_left_out=3):
        """Amplitude of the end [m], frequency [rad/s] and damping ratio of the free decay of the mode, by the trapezoidal rule."""
        h, damping = 2 * np.pi / self.omega / n_steps, bolted_beam.DAMPING * self.mass
        slope = self.stiffness + 4 / h**2 * self.mass + 2 / h * damping
        q, v, sliders = self.rest, self.shape * amplitude * self.omega, self.sliders
        a, moved = np.linalg.solve(self.mass, -damping @ v), []
        for _ in range(n_cycles * n_steps):

            def residual(x, q=q, v=v, a=a):
                there = 2 / h * (x - q) - v
                return self.mass @ (2 / h * (there - v) - a) + damping @ there + self.stiffness @ x - self.bolts, slope

            x, sliders = self.newton(q + h * v, sliders, residual)
            q, v, a = x, 2 / h * (x - q) - v, 4 / h**2 * (x - q) - 4 / h * v - a
            moved.append(self.shape @ self.mass @ (q - self.rest) / self.modal_mass)
        moved, times = np.array(moved), h * np.arange(1, len(moved) + 1)
        rises = np.flatnonzero((moved[:-1] < 0) & (moved[1:] >= 0))
        passes = times[rises] - moved[rises] * h / (moved[rises + 1] - moved[rises])
        omega = 2 * np.pi / np.diff(passes)[n_left_out:].mean()
        sizes = [np.ptp(moved[a:b]) / 2 for a, b in zip(rises, rises[1:])][n_left_out:]
        return np.mean(sizes), omega, -np.polyfit(np.arange(len(sizes)), np.log(sizes), 1)[0] / (2 * np.pi)
