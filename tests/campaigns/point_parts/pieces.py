"""Integration of structures with elastic stops at one coordinate, exact but for rounding (pieces.c), and what it finds from a point
of a result says of it."""

from __future__ import annotations

import ctypes
import re
from dataclasses import dataclass

import numpy as np

from point_parts.compiled import compiled

SHORTEST = 0.1  # step, in radians of the fastest mode


class _Pieces(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("n", "n_modes", "n_loads", "n_stops")] + [
        (name, ctypes.c_void_p)
        for name in ("frequency", "side", "gap", "rate", "shapes", "inverse", "at_rest", "seen", "seen_rest", "shortest", "along")
    ]  # fmt: skip


@dataclass(frozen=True)
class Stops:
    """M q'' + D q' + K q + forces of the stops = sum of F cos(w t), z = shape.q; a stop is (side, stiffness, gap)."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    shape: np.ndarray
    loads: list[tuple[float, np.ndarray]]  # frequency [rad/s], force [N]
    stops: list[tuple[float, float, float]]


def build() -> ctypes.CDLL:
    return compiled("pieces", "pieces_integration", "-fcx-limited-range")


class Integration:
    """A model, its state at the time `t`, and the steps that it may still take."""

    def __init__(self, library: ctypes.CDLL, model: Stops, most: float):
        self.library, self.model, self.left, self.t = library, model, most, 0.0
        n = len(model.mass)
        self.x = np.zeros(2 * n)
        inverse, zero = np.linalg.inv(model.mass), np.zeros((n, n))
        along = np.concatenate([model.shape, np.zeros(n)])
        blocks: dict[str, list] = {name: [] for name in ("rate", "shapes", "inverse", "at_rest", "seen", "seen_rest", "shortest")}
        turning = 1j * np.array([w for w, _ in model.loads])
        systems = []
        for closed in range(2 ** len(model.stops)):
            shut = [stop for k, stop in enumerate(model.stops) if closed >> k & 1]
            stiffness = model.stiffness + sum(k for _, k, _ in shut) * np.outer(model.shape, model.shape)
            held = sum(side * k * gap for side, k, gap in shut) * model.shape
            state_matrix = np.block([[zero, np.eye(n)], [-inverse @ stiffness, -inverse @ model.damping]])
            systems.append((stiffness, held, *np.linalg.eig(state_matrix)))
        self.decay = min(-rate.real.max() for _, _, rate, _ in systems)
        counted = [self._counted(rate, modes, model.shape) for _, _, rate, modes in systems]
        n_modes = max(np.sum(weights > 0) for weights in counted)
        for (stiffness, held, rate, modes), weights in zip(systems, counted):
            kept = np.argsort(weights == 0, kind="stable")[:n_modes]
            driven = np.zeros((2 * n, len(model.loads)), dtype=complex)
            for m, (w, force) in enumerate(model.loads):
                driven[:n, m] = np.linalg.solve(stiffness - w**2 * model.mass + 1j * w * model.damping, force)
                driven[n:, m] = 1j * w * driven[:n, m]
            shapes = np.hstack([(modes * weights)[:, kept], driven])
            at_rest = np.concatenate([np.linalg.solve(stiffness, held), np.zeros(n)])
            values = (np.concatenate([rate[kept], turning]), shapes, np.linalg.inv(modes)[kept], at_rest, along @ shapes,
                      [along @ at_rest], [SHORTEST / np.abs(rate).max()])  # fmt: skip
            for name, value in zip(blocks, values):
                blocks[name].append(value)
        real = {"frequency": [w for w, _ in model.loads], "side": [side for side, _, _ in model.stops],
                "gap": [gap for _, _, gap in model.stops], "along": along} | {
                    name: blocks.pop(name) for name in ("at_rest", "seen_rest", "shortest")}  # fmt: skip
        self.kept = {name: np.array(value, dtype=float) for name, value in real.items()}
        self.kept |= {name: np.array(value, dtype=complex) for name, value in blocks.items()}
        pointers = {name: value.ctypes.data for name, value in self.kept.items()}
        self.problem = _Pieces(n=2 * n, n_modes=n_modes, n_loads=len(model.loads), n_stops=len(model.stops), **pointers)

    @staticmethod
    def _counted(rate, modes, shape) -> np.ndarray:
        """How often a mode counts: once or, for its conjugate, twice; not at all where the coordinate has a node of it, which is
        a mode then whatever is closed."""
        is_seen = np.abs(shape @ modes[: len(shape)]) > 1e-9 * np.linalg.norm(modes[: len(shape)], axis=0)
        return np.where(is_seen & (rate.imag >= 0), np.where(rate.imag > 0, 2.0, 1.0), 0.0)

    def record(self, look: float, n_looks: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Times and places of the coordinate, n_looks of them; none where that takes too many steps."""
        out = np.zeros(n_looks)
        steps = ctypes.c_long(int(self.left))
        done = self.library.pieces_integration(
            ctypes.byref(self.problem), ctypes.c_void_p(self.x.ctypes.data), ctypes.c_double(self.t), ctypes.c_double(look),
            ctypes.c_long(n_looks), ctypes.byref(steps), ctypes.c_void_p(out.ctypes.data),
        )  # fmt: skip
        self.left = steps.value
        times = self.t + look * np.arange(n_looks)
        self.t += look * n_looks
        return (times, out) if done == n_looks else None


def stops_of(results, point: int) -> tuple[Stops, np.ndarray, list[str]]:
    """The model of a point, its base frequencies and degrees of freedom: a beam on pinned ends, or matrices;
    loads are cosines."""
    keys_of = re.compile(r"^ +(\w+) = (.*(?:\n {6}.*)*)", re.MULTILINE)
    groups = [
        (name, {key: _value(text) for key, text in keys_of.findall(body)})
        for name, body in re.findall(r"^&(structure|tones|load|law)\n(.*?)^/", results.input_complete, re.MULTILINE | re.DOTALL)
    ]
    laws = [keys for name, keys in groups if name == "law"]
    omega = np.array(next(keys["frequency"] for name, keys in groups if name == "tones"))
    for parameter in results.parameters.values():
        tone = re.fullmatch(r"tones%frequency\((\d+)\)", parameter.path)
        if tone:
            omega[int(tone[1]) - 1] = parameter.values[point]
        place = re.fullmatch(r"law\((.*)\)%(\w+)", parameter.path)
        if place:
            number = next((i for i, law in enumerate(laws) if law["label"] == [place[1]]), None)
            laws[int(place[1]) - 1 if number is None else number][place[2]] = [float(parameter.values[point])]
    structure = next(keys for name, keys in groups if name == "structure")
    if structure["type"] == ["beam"]:
        mass, stiffness, dofs = _beam(structure)
        damping = np.zeros_like(mass)
    else:
        n = int(structure["n_dofs"][0])
        mass, damping, stiffness = (np.reshape(structure[name], (n, n)) for name in ("mass", "damping", "stiffness"))
        dofs = structure["labels"]
    damping = (damping + structure["damping_diagonal"][0] * np.eye(len(mass)) + structure["damping_mass"][0] * mass
               + structure["damping_stiffness"][0] * stiffness)  # fmt: skip
    of = {law.get("dof", law.get("dofs"))[0] for law in laws}
    assert len(of) == 1 and all(law["type"] == ["elastic_stop"] for law in laws), "other than elastic stops at one coordinate"
    loads = [
        (float(np.dot(keys["tuple"], omega)), keys["cos"][0] * np.array([dof == keys["dof"][0] for dof in dofs], dtype=float))
        for name, keys in groups if name == "load"
    ]  # fmt: skip
    stops = [(law.get("weights", [1.0])[0], law["stiffness"][0], law["gap"][0]) for law in laws if law["stiffness"][0] > 0.0]
    return Stops(mass, damping, stiffness, np.array([dof in of for dof in dofs], dtype=float), loads, stops), omega, dofs


def _value(text: str) -> list:
    found: list = []
    for times, word in re.findall(r"(?:(\d+)\*)?('[^']*'|[^\s,]+)", text):
        found += int(times or 1) * [word[1:-1] if word[0] == "'" else word if word[0] == "." else float(word)]
    return found


def _beam(keys: dict) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Mass and stiffness of Hermite elements (Przemieniecki) between pinned ends."""
    n = int(keys["n_elements"][0])
    h = keys["length"][0] / n
    scale = np.diag([1.0, h, 1.0, h])
    bending = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) * (keys["bending_stiffness"][0] / h**3)
    inertia = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    inertia = keys["mass_per_length"][0] * h / 420 * inertia
    mass, stiffness = np.zeros((2, 2 * n + 2, 2 * n + 2))
    for i in range(0, 2 * n, 2):
        here = np.ix_(range(i, i + 4), range(i, i + 4))
        stiffness[here] += scale @ bending @ scale
        mass[here] += scale @ inertia @ scale
    free = [i for i in range(2 * n + 2) if i not in (0, 2 * n)]
    return mass[np.ix_(free, free)], stiffness[np.ix_(free, free)], [("v", "theta")[i % 2] + str(i // 2 + 1) for i in free]
