"""Motions of a few masses between walls with a restitution, from event to event: free flights in closed form, by
the modes of the masses that touch no wall, and events by Brent's method. Nothing of this is of the program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

MAX_EVENTS = 20000
CRAWLING = 1e-6  # of the largest speed so far: slower impacts end in contact


@dataclass(frozen=True)
class Wall:
    """What a degree of freedom strikes: beyond the gap, on one side or on both."""

    dof: int
    gap: float
    restitution: float
    two_sided: bool = False


@dataclass(frozen=True)
class Scene:
    """Masses on linear springs and dampers under loads of one or two tones, with walls."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    omega: np.ndarray  # base frequencies
    loads: list[tuple[int, tuple[int, ...], complex]]  # degree of freedom, tuple, cos - i sin
    walls: list[Wall]

    def force(self, t: float) -> np.ndarray:
        f = np.zeros(len(self.mass))
        for dof, multiple, value in self.loads:
            f[dof] += (value * np.exp(1j * float(np.dot(multiple, self.omega)) * t)).real
        return f

    def linear(self) -> np.ndarray:
        """Largest displacement of each degree of freedom without walls, over all phases."""
        extent = np.zeros(len(self.mass))
        for dof, multiple, value in self.loads:
            w = float(np.dot(multiple, self.omega))
            unit = np.zeros(len(self.mass))
            unit[dof] = 1.0
            response = np.linalg.solve(self.stiffness + 1j * w * self.damping - w**2 * self.mass, unit)
            extent += np.abs(response * value)
        return extent


class _Piece:
    """Motion while the same walls are touched: the free masses are linear, in closed form."""

    def __init__(self, scene: Scene, held: dict[int, int]):
        self.scene, self.held, n = scene, held, len(scene.mass)
        self.free = [d for d in range(n) if d not in {scene.walls[i].dof for i in held}]
        inverse = np.linalg.inv(scene.mass[np.ix_(self.free, self.free)])
        k, d = scene.stiffness[np.ix_(self.free, self.free)], scene.damping[np.ix_(self.free, self.free)]
        zero = np.zeros_like(k)
        self.values, self.vectors = np.linalg.eig(np.block([[zero, np.eye(len(k))], [-inverse @ k, -inverse @ d]]))
        self.inverse = np.linalg.inv(self.vectors)
        rest = np.zeros(n)
        for i, side in held.items():
            rest[scene.walls[i].dof] = side * scene.walls[i].gap
        self.rest = rest
        pairs: dict[float, np.ndarray] = {0.0: -(scene.stiffness @ rest)[self.free].astype(complex)}
        for dof, multiple, value in scene.loads:
            w = float(np.dot(multiple, scene.omega))
            pairs.setdefault(w, np.zeros(len(self.free), complex))
            if dof in self.free:
                pairs[w][self.free.index(dof)] += value if w else value.real
        m = scene.mass[np.ix_(self.free, self.free)]
        self.forced = [(w, np.linalg.solve(k + 1j * w * d - w**2 * m, f)) for w, f in pairs.items()]

    def steady(self, t: np.ndarray) -> np.ndarray:
        """Displacements and velocities without a free part, (2 n_free, times)."""
        waves = [(1j * w, c[:, None] * np.exp(1j * w * t)) for w, c in self.forced]
        return np.concatenate([sum(one.real for _, one in waves), sum((rate * one).real for rate, one in waves)])

    def after(self, y: np.ndarray, start: float, t: np.ndarray) -> np.ndarray:
        """States at times, (2 n, times), from one at `start`."""
        n = len(self.rest)
        own = [*self.free, *(n + d for d in self.free)]
        t = np.atleast_1d(t)
        free = self.inverse @ (y[own] - self.steady(np.array([start]))[:, 0])
        states = np.concatenate([self.rest, np.zeros(n)])[:, None] * np.ones(len(t))
        states[own] = (self.vectors @ (free[:, None] * np.exp(np.outer(self.values, t - start)))).real + self.steady(t)
        return states

    def functions(self, states: np.ndarray, t: np.ndarray) -> tuple[list[tuple[int, int]], np.ndarray]:
        """Walls and sides, 0 of those that are touched, and their functions, positive until an event."""
        scene, n = self.scene, len(self.rest)
        names, values = [], []
        for i, wall in enumerate(scene.walls):
            if i in self.held:
                force = np.array([scene.force(time)[wall.dof] for time in t])
                force = force - scene.damping[wall.dof] @ states[n:] - scene.stiffness[wall.dof] @ states[:n]
                names.append((i, 0))
                values.append(self.held[i] * force)
                continue
            for side in (1, -1) if wall.two_sided else (1,):
                names.append((i, side))
                values.append(wall.gap - side * states[wall.dof])
        return names, np.array(values)


def integrate(scene: Scene, q, v, start: float, times: np.ndarray) -> np.ndarray:
    """Displacements at ascending times, (times, degrees of freedom), from a state at `start`; masses are not coupled by inertia."""
    n = len(q)
    y = np.concatenate([q, v]).astype(float)
    for wall in scene.walls:
        y[wall.dof] = np.clip(y[wall.dof], -wall.gap if wall.two_sided else -np.inf, wall.gap)
    fastest = np.abs(y[n:]).max() + 1e-3 * scene.linear().max() * scene.omega.max()
    modes = np.sqrt(np.linalg.eigvals(np.linalg.solve(scene.mass, scene.stiffness)).real.max())
    step = 0.02 * 2 * np.pi / max(modes, scene.omega.max())
    found = np.full((len(times), n), np.nan)
    t, done, held = start, 0, {}
    pieces: dict[tuple, _Piece] = {}
    for _ in range(MAX_EVENTS):
        piece = pieces.setdefault(tuple(held.items()), _Piece(scene, dict(held)))
        at, event, last = t, None, np.empty((0, 1))
        while at < times[-1] and event is None:
            grid = at + step * np.concatenate([[1e-3, 1e-2, 0.1] if at == t else [], np.arange(1, 65)])
            states = piece.after(y, t, grid)
            names, values = piece.functions(states, grid)
            before = np.concatenate([np.full((len(names), 1), np.inf) if at == t else last, values[:, :-1]], axis=1)
            falls = (values <= 0) & (before > 0)
            if falls.any():
                k = int(np.flatnonzero(falls.any(axis=0))[0])
                for c in np.flatnonzero(falls[:, k]):
                    low = t if k == 0 and at == t else (grid[k - 1] if k else at)

                    def value(time, c=c, piece=piece, y=y, t=t):
                        one = np.array([time])
                        return piece.functions(piece.after(y, t, one), one)[1][c, 0]

                    zero = low if value(low) <= 0 else brentq(value, low, grid[k], xtol=1e-15, rtol=1e-14)
                    if event is None or zero < event[0]:
                        event = (zero, *names[c])
            last, at = values[:, -1:], grid[-1]
        until = event[0] if event else times[-1]
        while done < len(times) and times[done] <= until:
            stop = int(np.searchsorted(times, until, side="right"))
            found[done:stop] = piece.after(y, t, times[done:stop])[:n].T
            done = stop
        if event is None or done >= len(times):
            break
        y = piece.after(y, t, np.array([event[0]]))[:, 0]
        t, i, side = event
        wall = scene.walls[i]
        if side == 0:
            side = held.pop(i)
            y[wall.dof] = side * (wall.gap - 1e-13 * max(abs(wall.gap), 1e-3))
            continue
        fastest = max(fastest, np.abs(y[n:]).max())
        speed = side * y[n + wall.dof]
        y[wall.dof] = side * wall.gap
        if speed > CRAWLING * fastest:
            y[n + wall.dof] = -side * wall.restitution * speed
            y[wall.dof] = side * (wall.gap - 1e-15 * max(abs(wall.gap), 1e-3))
        else:
            y[n + wall.dof] = 0.0
            held[i] = side
    return found


def series(omega_of: np.ndarray, amplitudes: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Displacements (times, dofs) of amplitudes cos - i sin, (harmonics, dofs)."""
    return (np.exp(1j * np.outer(t, omega_of)) @ amplitudes).real
