"""Whether a motion stays, by the time integration of integration.c: nothing of the program but the coefficients of the motion."""

from __future__ import annotations

import ctypes
import itertools
from dataclasses import dataclass

import numpy as np

from point_parts.compiled import compiled
from point_parts.models import KINDS, RIGID, Law, Model

NEARNESS = 1e-3  # of the second start, relative to the motion
PERIODS_OF_SLIDERS = 20
MEMORY = 10  # times as many of Bouc-Wen elements, which forget slowly
FIRST_ORDER = (*RIGID, 10, 24)  # kinds: Moreau's rule, and sliders in a plane, which stay where they are for a step
RIGID_STEP = 0.015  # of these, in radians of the fastest motion
RIGID_STEP_OF_ERRORS = 0.003
LOOKS = 64  # in a period of the slowest tone, for each tone in it
NEXT, PARTED = 1e-8, 100.0  # distance of neighbours relative to the motion, and how many times that they are apart when they part
HIGHEST_OF_BEAT, MAX_BEATS = 20, 1000
MAX_PERIODS, REPEATED = 12, 2e-2  # until a motion repeats, and how well, relative to it
AT_REST = 1e-6  # motion of a coordinate relative to that of all degrees of freedom
N_PARAMETERS = 6  # of a law in integration.c
SMALLEST = 2e-2  # motion of a coordinate relative to the largest one: where it sticks it keeps what the second start adds


class _Problem(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("n", "n_laws", "n_loads")] + [
        (name, ctypes.c_void_p)
        for name in ("stiffness", "damping", "frequency", "cosine", "sine", "kind", "shape", "kick", "parameters")
    ]


@dataclass(frozen=True)
class Motion:
    """Coefficients of a solved point."""

    frequencies: np.ndarray
    amplitudes: np.ndarray  # cos - i sin, (n_harmonics, n_dofs)

    def at(self, t: np.ndarray) -> np.ndarray:
        return (np.exp(1j * np.outer(t, self.frequencies)) @ self.amplitudes).real

    def rate_at(self, t: np.ndarray) -> np.ndarray:
        return (np.exp(1j * np.outer(t, self.frequencies)) @ (1j * self.frequencies[:, None] * self.amplitudes)).real


def build() -> ctypes.CDLL:
    return compiled("integration", "assess_integration")


def farthest(library: ctypes.CDLL, model: Model, motion: Motion, seed: int) -> float:
    """Largest difference in the end, at the coordinates of the laws relative to their own motion and at all degrees of
    freedom relative to the largest one, of two time integrations: from the motion, and from close to it."""
    draw = np.random.default_rng([seed, 1])
    size = np.abs(motion.amplitudes).sum(0).max()
    speed = np.abs(motion.frequencies[:, None] * motion.amplitudes).sum(0).max()
    if size == 0.0:  # rest: loads too small for friction
        return 0.0
    worst = 0.0
    for nearness in (0.0, NEARNESS):
        n = len(model.mass)
        q = motion.at(np.zeros(1))[0] + nearness * size * draw.uniform(-1, 1, n)
        v = motion.rate_at(np.zeros(1))[0] + nearness * speed * draw.uniform(-1, 1, n)
        worst = max(worst, _difference(model, motion, *_integration(library, model, motion, q, v, 1e3 * size)))
    return worst


def error_of(library: ctypes.CDLL, model: Model, motion: Motion) -> float:
    """Root of the mean square, over the last periods of integration from the motion and over the coordinates of the laws, of what
    separates the two, relative to that of the motion: what a tolerance is about. Tones that are nearly commensurate lead through
    all of the motion in the period of their slowest beat only."""
    size = np.abs(motion.amplitudes).sum(0).max()
    if size == 0.0:
        return 0.0
    start = np.zeros(1)
    q, v = motion.at(start)[0], motion.rate_at(start)[0]
    times, integrated = _integration(library, model, motion, q, v, 1e3 * size, RIGID_STEP_OF_ERRORS, slowest_beat(model.omega))
    if times is None:
        return np.inf
    everything = np.eye(len(model.mass))
    shapes = np.vstack([everything if law.is_multiplied_out else law.shape for law in model.laws]).T
    there = motion.at(times)
    own, whole = np.linalg.norm(there @ shapes), np.linalg.norm(there)
    at_rest = own < AT_REST * whole  # a slider that never slips keeps its coordinate where it is
    return float(np.linalg.norm((integrated - there) @ shapes) / (whole if at_rest else own))


def repeats_after(library: ctypes.CDLL, model: Model) -> int:
    """Periods of the only tone after which the motion repeats that a time integration from the linear one ends in; 0: not within
    MAX_PERIODS."""
    w = float(model.omega[0])
    static = sum((cosine for harmonic, cosine, _ in model.loads if not any(harmonic)), np.zeros(len(model.mass)))
    load = sum((cosine - 1j * sine for harmonic, cosine, sine in model.loads if any(harmonic)), np.zeros(len(model.mass)))
    linear = np.linalg.solve(model.stiffness - w**2 * model.mass + 1j * w * model.damping, load)
    motion = Motion(np.array([0.0, w]), np.array([np.linalg.solve(model.stiffness, static) + 0j, linear]))
    start, size = np.zeros(1), np.abs(motion.amplitudes).sum(0).max()
    _, q = _integration(library, model, motion, motion.at(start)[0], motion.rate_at(start)[0], 1e3 * size, RIGID_STEP_OF_ERRORS)
    if q is None:
        return 0
    moved = np.linalg.norm(q - q.mean(0))
    for n in range(1, MAX_PERIODS + 1):
        if np.linalg.norm(q[n * LOOKS :] - q[: -n * LOOKS]) < REPEATED * moved:
            return n
    return 0


def neighbours_part(library: ctypes.CDLL, model: Model, motion: Motion) -> bool:
    """Whether two time integrations, from the motion and from NEXT beside it, diverge while the first one leaves the motion: an
    unstable motion, whose error a time integration does not tell. Not known of laws whose rule is of first order."""
    if any(law.kind in FIRST_ORDER for law in model.laws):
        return False
    size = np.abs(motion.amplitudes).sum(0).max()
    q, v = motion.at(np.zeros(1))[0], motion.rate_at(np.zeros(1))[0]
    first, second = (_integration(library, model, motion, q + off, v, 1e3 * size, is_whole=True)[1] for off in (0.0, NEXT * size))
    return first is None or second is None or bool(np.abs(second - first).max() > PARTED * NEXT * size)


def slowest_beat(omega: np.ndarray) -> int:
    """Periods of the slowest tone in which harmonics of two tones, up to HIGHEST_OF_BEAT, pass through each other, at most
    MAX_BEATS."""
    slowest = np.inf
    for i, j in itertools.combinations(range(len(omega)), 2):
        orders = np.arange(1, HIGHEST_OF_BEAT + 1)
        slowest = min(slowest, np.abs(np.subtract.outer(orders * omega[i], orders * omega[j])).min())
    return int(min(MAX_BEATS, np.ceil(omega.min() / slowest))) if np.isfinite(slowest) else 1


def _integration(library, model: Model, motion: Motion, q, v, bound, rigid_step=RIGID_STEP, min_kept=1, is_whole=False):
    """Times and displacements of the last periods, `min_kept` or more, or, `is_whole`, of all."""
    inverse = np.linalg.inv(model.mass)
    frequencies, decay = model.modes()
    shape = np.array([law.shape for law in model.laws])
    kick = shape @ inverse
    stiffest = (frequencies**2).max()
    for law, w, k in zip(model.laws, shape, kick):
        if law.kind in (1, 2, 9, 10, 11, 12, 13):
            stiffest += law.parameters[0] * (w @ k)
        elif law.kind == 0:
            stiffest += 3 * law.parameters[0] * (w @ k) * (np.abs(motion.amplitudes @ w).sum()) ** 2
        elif law.kind == 8:
            reach = np.abs(motion.amplitudes @ w).sum()
            stiffest += (3 * law.parameters[0] * reach + 2 * abs(law.parameters[1])) * reach * (w @ k)
    is_rigid = any(law.kind in FIRST_ORDER for law in model.laws)
    fastest = max(np.sqrt(stiffest), model.omega.max())
    for law, w, k in zip(model.laws, shape, kick):
        if law.kind == 3:
            fastest = max(fastest, 0.2 * law.parameters[0] / law.parameters[1] * (w @ k))
        elif law.kind in (6, 7):
            speed = np.abs(motion.frequencies * (motion.amplitudes @ w)).sum()
            fastest = max(fastest, law.parameters[0] * (law.kind - 4) * speed ** (law.kind - 5) * (w @ k))
        elif law.kind > 14:
            added, rate = _steepest(law, np.abs(motion.amplitudes @ w).sum(), w @ k)
            fastest = max(np.sqrt(fastest**2 + added * (w @ k)), rate)
    period = 2 * np.pi / model.omega.min()
    looks = int(LOOKS * np.ceil(model.omega.max() / model.omega.min()))
    stride = int(np.ceil(fastest * period / looks / (rigid_step if is_rigid else 0.08)))
    step = period / (looks * stride)
    beat = np.abs(np.subtract.outer(model.omega, model.omega))
    beats = int(np.ceil(model.omega.min() / beat[beat > 0].min())) if len(model.omega) > 1 else 1
    kept = max(20, min(100, 2 * beats), min_kept)
    slowest = decay[decay > 0].min()
    periods = int(np.clip(12 / (slowest * period), 200, 2500)) + kept
    arrays = {
        "stiffness": inverse @ model.stiffness,
        "damping": inverse @ model.damping,
        "frequency": np.array([np.dot(j, model.omega) for j, _, _ in model.loads], dtype=float),
        "cosine": np.array([c @ inverse for _, c, _ in model.loads]),
        "sine": np.array([s @ inverse for _, _, s in model.loads]),
        "kind": np.array([law.kind for law in model.laws], dtype=np.int32),
        "shape": shape,
        "kick": kick,
        "parameters": np.array([(*law.parameters, *(0.0,) * (N_PARAMETERS - len(law.parameters))) for law in model.laws]),
    }
    arrays = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
    pointers = {name: values.ctypes.data for name, values in arrays.items()}
    problem = _Problem(n=len(q), n_laws=len(model.laws), n_loads=len(model.loads), **pointers)
    n_steps, first = periods * looks * stride, (0 if is_whole else periods - kept) * looks * stride
    out = np.zeros(((n_steps - first) // stride, len(q)))
    slider = _sliders(model, motion, shape, period, looks)
    q, v = np.array(q), np.array(v)  # a real part is a view with gaps
    done = library.assess_integration(
        ctypes.byref(problem), *(ctypes.c_void_p(a.ctypes.data) for a in (q, v, slider)), ctypes.c_double(step),
        ctypes.c_long(n_steps), ctypes.c_long(first), ctypes.c_long(stride), ctypes.c_double(bound),
        ctypes.c_void_p(out.ctypes.data),
    )  # fmt: skip
    if done < n_steps:
        return None, None
    return first * step + step * stride * np.arange(len(out)), out


def _steepest(law: Law, reach: float, kick: float) -> tuple[float, float]:
    """Largest stiffness of a law in a motion up to `reach`, and a rate [rad/s] that steps have to follow as well."""
    q = law.parameters
    name = KINDS[law.kind]
    if name == "hertz":
        deep = max(reach - q[2], 0.0)
        return q[0] * q[1] * deep ** (q[1] - 1), 0.2 * q[0] * deep ** q[1] * q[3] * kick
    if name == "electrostatic":
        return 2 * q[0] * (abs(q[2]) + np.hypot(q[3], q[4])) ** 2 / max(q[1] - reach, 0.1 * q[1]) ** 3, abs(q[5])
    if name == "maxwell":
        return q[0], 0.2 / q[1]
    if name == "parametric":
        return np.hypot(q[0], q[1]), max(abs(q[5]), 0.2 * np.hypot(q[2], q[3]) * kick)
    if name in ("film_x", "film_y"):
        share = min(reach / q[1], 0.9)
        return 0.0, 0.2 * np.pi * q[0] / q[1] ** 3 * (1 + 2 * share**2) / (1 - share**2) ** 2.5 * kick
    if name in ("balls_x", "balls_y"):
        return q[3] * q[0] * q[1] * max(reach - q[2], 0.0) ** (q[1] - 1), abs(q[4])
    return (q[2] if name == "contact_n" else q[0]), 0.0  # bouc_wen, contact_x and contact_y


def _sliders(model: Model, motion: Motion, shape, period, looks) -> np.ndarray:
    """Places of the sliders, and what else laws remember, at t = 0 on the motion."""
    places = np.zeros(len(model.laws))
    names = [KINDS[law.kind] for law in model.laws]
    for k, law in enumerate(model.laws):
        if names[k] == "maxwell":
            places[k] = (motion.amplitudes @ law.shape / (1 + 1j * motion.frequencies * law.parameters[1])).sum().real
    if not any(name in ("jenkins", "jenkins_2d", "bouc_wen", "contact_x") for name in names):
        return places
    times = np.arange(-PERIODS_OF_SLIDERS * 4 * looks, 1) * period / (4 * looks)
    paths = motion.at(times) @ shape.T
    for k, law in enumerate(model.laws):
        if names[k] == "bouc_wen":
            is_periodic = len(model.omega) == 1
            n = 4 * looks if is_periodic else MEMORY * len(times)
            path = motion.at(np.arange(-n, 1) * period / (4 * looks)) @ law.shape
            places[k] = _yielded(law.parameters, float(path[0]), np.diff(path).tolist(), 2000 if is_periodic else 1)
        if names[k] == "contact_x":
            stiffness, friction, normal, preload = law.parameters
            reaches = friction / stiffness * np.maximum(preload + normal * paths[:, k + 2], 0.0)
            for z, reach in zip(paths[:, k : k + 2], reaches):
                leash = z - places[k : k + 2]
                length = np.hypot(*leash)
                if length > reach:
                    places[k : k + 2] = z - leash * reach / length
        if law.kind not in (2, 10):
            continue
        reach = law.parameters[1] / law.parameters[0]
        pair = slice(k, k + (2 if law.kind == 10 else 1))
        for z in paths[:, pair]:
            leash = z - places[pair]
            length = np.hypot(*leash) if law.kind == 10 else abs(leash[0])
            if length > reach:
                places[pair] = z - leash * reach / length
    return places


def _yielded(parameters, place: float, steps: list[float], times: int) -> float:
    """What a Bouc-Wen element, first at `place` as a spring would be, remembers after it went its steps so often, or until it
    comes back to where it was."""
    _, _, yields, exponent, beta = parameters
    place = min(yields, max(-yields, place))

    def gained(at: float, step: float) -> float:
        share = min(1.0, (abs(at) / yields) ** exponent)
        return step * (1 - share * (1 - beta + (beta if at * step > 0 else -beta)))

    for _ in range(times):
        before = place
        for step in steps:
            place += gained(place + gained(place, step) / 2, step)
        if abs(place - before) < 1e-9 * yields:
            break
    return place


def _difference(model: Model, motion: Motion, times, integrated) -> float:
    if times is None:
        return np.inf
    rest = integrated - motion.at(times)
    largest = np.abs(motion.amplitudes).sum(0).max()
    worst = np.abs(rest).max() / largest
    moves = motion.frequencies != 0
    for law in model.laws:
        own = np.sqrt((np.abs(motion.amplitudes[moves] @ law.shape) ** 2).sum())
        own = max(own, SMALLEST * np.abs(law.shape).max() * largest)
        worst = max(worst, np.abs(rest @ law.shape).max() / own)
    return float(worst)
