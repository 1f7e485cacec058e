"""Harmonic balance of a high order, for tests/campaigns/workflows: shares nothing with the program but the model.

Unknowns are the complex coefficients Z of the coordinates z of the laws, over a full box of tuples with both signs:
Z + G(w) F(z) - Z_linear = 0, G the flexibility of the structure between the coordinates. Forces F are sampled on a torus of many
points. Newton's method with the exact tangent: Toeplitz matrices of the Fourier coefficients of the slopes; for a Jenkins element
under one tone those of the share of the period in which it sticks, less what its coordinate was when it began to stick.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from point_parts.models import KINDS, Model

SOLVED = 1e-7  # residual relative to the motion
MAX_STEPS = 25
MAX_HALVINGS = 7
OUTER = 0.75  # entries of tuples beyond this share of the order are the tail


@dataclass
class Box:
    """Tuples of at most `orders`, both signs, and a grid of samples for each tone."""

    orders: tuple[int, ...]
    samples: tuple[int, ...]
    tuples: np.ndarray = field(init=False)  # (n, n_tones)
    place: tuple = field(init=False)  # of each tuple in a transform
    lags: np.ndarray = field(init=False)  # place of k - l in a transform, flat, (n, n)
    weights: np.ndarray = field(init=False)  # so that norms are those of cosines and sines

    def __post_init__(self):
        axes = [np.arange(-n, n + 1) for n in self.orders]
        self.tuples = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
        self.place = tuple(self.tuples[:, m] % n for m, n in enumerate(self.samples))
        difference = self.tuples[:, None, :] - self.tuples[None, :, :]
        self.lags = np.ravel_multi_index([difference[..., m] % n for m, n in enumerate(self.samples)], self.samples)
        self.weights = np.where(np.any(self.tuples != 0, axis=1), np.sqrt(2.0), 1.0)

    def sampled(self, values: np.ndarray) -> np.ndarray:
        """Real samples of complex coefficients (..., n)."""
        spread = np.zeros((*values.shape[:-1], *self.samples), dtype=complex)
        spread[(..., *self.place)] = values
        axes = tuple(range(-len(self.samples), 0))
        return np.fft.ifftn(spread, axes=axes, norm="forward").real

    def coefficients(self, samples: np.ndarray) -> np.ndarray:
        axes = tuple(range(-len(self.samples), 0))
        return np.fft.fftn(samples, axes=axes, norm="forward")[(..., *self.place)]

    def product_with(self, samples: np.ndarray) -> np.ndarray:
        """Matrix that multiplies a series by a function of the torus."""
        return np.fft.fftn(samples, norm="forward").ravel()[self.lags]

    def norm(self, values: np.ndarray) -> float:
        return float(np.linalg.norm(values * self.weights))

    def tail(self, values: np.ndarray) -> float:
        """Share of the motion in the outer tuples."""
        outer = np.any(np.abs(self.tuples) > OUTER * np.array(self.orders), axis=1)
        return self.norm(values * outer) / max(self.norm(values), 1e-300)

    def of(self, tuples: np.ndarray, cosines: np.ndarray, sines: np.ndarray) -> np.ndarray:
        """Complex coefficients (n_coordinates, n) of a real series: cosines, sines (n_coordinates, n_tuples)."""
        values = np.zeros((len(cosines), len(self.tuples)), dtype=complex)
        strides = [int(np.prod([2 * n + 1 for n in self.orders[m + 1 :]])) for m in range(len(self.orders))]
        for k, c, s in zip(tuples, cosines.T, sines.T):
            if np.any(np.abs(k) > self.orders):
                continue
            at, opposite = (int(sum((sign * k[m] + self.orders[m]) * strides[m] for m in range(len(k)))) for sign in (1, -1))
            if at == opposite:
                values[:, at] += c
            else:
                values[:, at] += (c - 1j * s) / 2
                values[:, opposite] += (c + 1j * s) / 2
        return values

    def enlarged(self, values: np.ndarray, other: Box) -> np.ndarray:
        """The same series in the box `other`, what does not fit left out."""
        result = np.zeros((len(values), len(other.tuples)), dtype=complex)
        strides = [int(np.prod([2 * n + 1 for n in other.orders[m + 1 :]])) for m in range(len(other.orders))]
        fits = np.all(np.abs(self.tuples) <= np.array(other.orders), axis=1)
        places = (self.tuples[fits] + np.array(other.orders)) @ np.array(strides)
        result[:, places] = values[:, fits]
        return result


@dataclass
class System:
    """A model on the coordinates of its laws, in a box."""

    model: Model
    box: Box

    def __post_init__(self):
        shapes = []
        self.law_at = []
        for law in self.model.laws:
            for place, shape in enumerate(shapes):
                if np.allclose(shape, law.shape):
                    break
            else:
                place = len(shapes)
                shapes.append(law.shape)
            self.law_at.append(place)
        self.shapes = np.array(shapes)  # (n_coordinates, n_dofs)

    def frequencies(self, omega: np.ndarray) -> np.ndarray:
        return self.box.tuples @ omega

    def flexibility(self, omega: np.ndarray, damping: np.ndarray) -> np.ndarray:
        """From forces on all degrees of freedom to these, (n, n_dofs, n_dofs)."""
        w = self.frequencies(omega)[:, None, None]
        return np.linalg.inv(self.model.stiffness - w**2 * self.model.mass + 1j * w * damping)

    def loads(self) -> np.ndarray:
        """(n, n_dofs)"""
        n = len(self.model.mass)
        total = np.zeros((n, len(self.box.tuples)), dtype=complex)
        for harmonic, cosine, sine in self.model.loads:
            total += self.box.of(np.array([harmonic]), np.array(cosine)[:, None], np.array(sine)[:, None])
        return total.T

    def forces(self, z: np.ndarray, w: np.ndarray, with_tangent: bool = True):
        """Coefficients of the force at each coordinate and the matrix of its change with those of the coordinate."""
        samples = self.box.sampled(z)
        rates = self.box.sampled(1j * w * z)
        n = len(self.box.tuples)
        force = np.zeros_like(z)
        tangent = np.zeros((len(z), n, n), dtype=complex) if with_tangent else None
        for c in range(len(z)):
            f = np.zeros_like(samples[c])
            by_z, by_rate = np.zeros_like(f), np.zeros_like(f)
            for law, place in zip(self.model.laws, self.law_at):
                if place != c:
                    continue
                if KINDS[law.kind] == "jenkins":
                    more, sticks, began = _jenkins(samples[c], *law.parameters[:2])
                    f += more
                    by_z += law.parameters[0] * sticks
                    if with_tangent:
                        tangent[c] -= law.parameters[0] * self._began(began)
                else:
                    more, by_place, by_speed = _force(law, samples[c], rates[c])
                    f += more
                    by_z += by_place
                    by_rate += by_speed
            force[c] = self.box.coefficients(f)
            if with_tangent:
                tangent[c] += self.box.product_with(by_z)
                if np.any(by_rate):
                    tangent[c] += self.box.product_with(by_rate) * (1j * w)[None, :]
        return force, tangent

    def _began(self, began: np.ndarray) -> np.ndarray:
        """Of each sample that sticks, the coordinate where it began to: as a matrix on coefficients."""
        k = self.box.tuples[:, 0]
        n = len(began)
        total = np.zeros((len(k), len(k)), dtype=complex)
        for j in np.unique(began[began >= 0]):
            at = np.flatnonzero(began == j)
            projected = np.exp(-2j * np.pi * np.outer(k, at) / n).sum(1) / n
            total += np.outer(projected, np.exp(2j * np.pi * k * j / n))
        return total

    def residual(self, z, omega, damping, with_tangent=True):
        """Of the balance at the coordinates [m], and its matrix (n_coordinates*n, n_coordinates*n)."""
        w = self.frequencies(omega)
        flexibility = self.flexibility(omega, damping)
        linear = np.einsum("ca,kab,kb->ck", self.shapes, flexibility, self.loads())
        at_laws = np.einsum("ca,kab,db->kcd", self.shapes, flexibility, self.shapes)
        force, tangent = self.forces(z, w, with_tangent)
        r = z - linear + np.einsum("kcd,dk->ck", at_laws, force)
        if not with_tangent:
            return r, None
        n_c, n = z.shape
        matrix = np.einsum("kcd,dkl->ckdl", at_laws, tangent).reshape(n_c * n, n_c * n)
        matrix[np.diag_indices(n_c * n)] += 1.0
        return r, matrix

    def all_dofs(self, z, omega, damping) -> np.ndarray:
        """Motion of all degrees of freedom, (n, n_dofs)."""
        w = self.frequencies(omega)
        force, _ = self.forces(z, w, False)
        return np.einsum("kab,kb->ka", self.flexibility(omega, damping), self.loads() - force.T @ self.shapes)


def _force(law, z, rate):
    """Force of a law without memory, and its slopes."""
    first, second, third = law.parameters
    zero = np.zeros_like(z)
    name = KINDS[law.kind]
    if name == "cubic_spring":
        return first * z**3, 3 * first * z**2, zero
    if name == "elastic_stop":
        f, slope = first * np.maximum(z - second, 0.0), first * (z > second)
        if third:
            f, slope = f + first * np.minimum(z + second, 0.0), slope + first * (z < -second)
        return f, slope, zero
    if name == "coulomb_tanh":
        t = np.tanh(rate / second)
        return first * t, zero, first / second * (1 - t**2)
    if name == "quadratic_damping":
        return first * np.abs(rate) * rate, zero, 2 * first * np.abs(rate)
    if name == "cubic_damping":
        return first * rate**3, zero, 3 * first * rate**2
    if name == "polynomial":
        return first * z**3 + second * z**2, 3 * first * z**2 + 2 * second * z, zero
    if name == "piecewise_linear":
        f = first * np.maximum(z - second, 0.0) + third * np.minimum(z + second, 0.0)
        return f, first * (z > second) + third * (z < -second), zero
    if name == "van_der_pol":
        s = (z / second) ** 2
        return -first * (1 - s) * rate, 2 * first * z / second**2 * rate, -first * (1 - s)
    raise ValueError(f"no force of {name}")


def potential(law, z):
    """Energy that a law without memory and losses has stored [J]."""
    first, second, third = law.parameters
    name = KINDS[law.kind]
    if name == "cubic_spring":
        return first * z**4 / 4
    if name == "polynomial":
        return first * z**4 / 4 + second * z**3 / 3
    above, below = np.maximum(z - second, 0.0) ** 2 / 2, np.minimum(z + second, 0.0) ** 2 / 2
    if name == "elastic_stop":
        return first * (above + (below if third else 0.0))
    if name == "piecewise_linear":
        return first * above + third * below
    raise ValueError(f"no potential of {name}")


def _jenkins(z, stiffness, limit):
    """Force of a slider that starts relaxed, where it sticks (0 or 1), and the sample from which on: -1 where it slips, or always
    sticks."""
    reach = limit / stiffness
    place, since = 0.0, -1
    n = len(z)
    values = z.tolist()
    for _ in range(2):
        places, began = [0.0] * n, [-1] * n
        for i, value in enumerate(values):
            if value - place > reach:
                place, since = value - reach, i
            elif place - value > reach:
                place, since = value + reach, i
            else:
                began[i] = since
            places[i] = place
    places, began = np.array(places), np.array(began)
    slips = np.abs(np.abs(z - places) - reach) <= 1e-13 * max(reach, np.abs(z).max())
    slips &= began < 0
    return stiffness * (z - places), (~slips).astype(float), began


@dataclass
class Answer:
    """A motion of the high order: coefficients at the coordinates of the laws, and what went with it."""

    z: np.ndarray
    omega: np.ndarray
    value: float = 0.0  # of the parameter of a curve
    damping: float = 0.0  # artificial
    is_solved: bool = False


def forced(system: System, z, omega) -> Answer:
    """The motion of given tones next to `z`."""
    damping = system.model.damping
    return _newton(system, z, lambda z, tangent: system.residual(z, omega, damping, tangent), omega)


def _newton(system: System, z, residual, omega) -> Answer:
    size = max(system.box.norm(z), 1e-300)
    r, matrix = residual(z, True)
    norm = np.linalg.norm(r)
    for _ in range(MAX_STEPS):
        if norm < SOLVED * size:
            return Answer(z, omega, is_solved=True)
        try:
            step = _solution(matrix, r)
        except np.linalg.LinAlgError:
            break
        share = 1.0
        for _ in range(MAX_HALVINGS):
            trial, _ = residual(z - share * step, False)
            if np.linalg.norm(trial) < (1 - 0.1 * share) * norm:
                break
            share /= 2
        z = _real(system.box, z - share * step)
        size = max(system.box.norm(z), 1e-300)
        r, matrix = residual(z, True)
        norm = np.linalg.norm(r)
        if not np.isfinite(norm):
            break
    return Answer(z, omega, is_solved=bool(norm < SOLVED * size))


def _solution(matrix, r):
    """Solution of a system (n_c*n, n_c*n) that keeps the symmetry of real series, in real numbers: a quarter of the work."""
    n_c, n = r.shape
    half = n // 2
    matrix = matrix.reshape(n_c, n, n_c, n)
    above, below = matrix[:, half:, :, half:], matrix[:, half:, :, half::-1]
    upper, lower = above + below, 1j * (above - below)
    upper[..., 0] /= 2
    real = np.concatenate([upper, lower[..., 1:]], axis=3)
    real = np.concatenate([real.real, real[:, 1:].imag], axis=1).reshape(n_c * n, n_c * n)
    right = np.concatenate([r[:, half:].real, r[:, half + 1 :].imag], axis=1)
    x = np.linalg.solve(real, right.ravel()).reshape(n_c, n)
    positive = x[:, : half + 1].astype(complex)
    positive[:, 1:] += 1j * x[:, half + 1 :]
    return np.concatenate([positive[:, :0:-1].conj(), positive], axis=1)


def _real(box: Box, z):
    """Without what rounding adds to the symmetry of a real series."""
    return (z + np.conj(z[:, ::-1])) / 2


def on_curve(system_at, z, value, scale) -> Answer:
    """The point of the curve of motions over a value that is nearest to `z`: `system_at(value)` gives system and tones."""
    system, omega = system_at(value)
    start, start_value = z, value
    size = max(system.box.norm(z), 1e-300)
    weights = np.tile(system.box.weights, (len(z), 1)).ravel()
    h = 1e-6 * scale
    for _ in range(MAX_STEPS):
        system, omega = system_at(value)
        r, matrix = system.residual(z, omega, system.model.damping)
        if np.linalg.norm(r) < SOLVED * size and _ > 0:
            return Answer(z, omega, value, is_solved=True)
        slope = 0.0
        for sign in (1, -1):
            other, tones = system_at(value + sign * h)
            slope = slope + sign * other.residual(z, tones, other.model.damping, False)[0]
        slope = slope / (2 * h)
        try:
            a, b = _solution(matrix, r).ravel(), _solution(matrix, slope).ravel()
        except np.linalg.LinAlgError:
            break
        off = (z - start).ravel() - a  # z - a - b*change is next
        bw, ow = b * weights / size, off * weights / size
        change = (np.vdot(bw, ow).real - (value - start_value) / scale**2) / (np.vdot(bw, bw).real + 1 / scale**2)
        limit = 0.02 * scale
        change = float(np.clip(change, -limit, limit))
        z = _real(system.box, z - (a + b * change).reshape(z.shape))
        value += change
        if not np.all(np.isfinite(z)):
            break
    return Answer(z, omega, value)


def autonomous(system: System, q, omega: float, mode: Mode | None = None, damping: float = 0.0) -> Answer:
    """A motion of its own next to `q` (n_dofs, n): a limit cycle, or with `mode` a normal mode, kept up by artificial damping.
    All degrees of freedom are unknowns, since the undamped structure alone may be singular."""
    n = q.size
    model, box = system.model, system.box
    k = box.tuples[:, 0]
    anchor = (1j * k * q * box.weights**2).ravel().conj()
    size, first = max(box.norm(q), 1e-300), q.ravel()
    scale = np.abs(model.stiffness).max()

    def all_of(q, w, xi, with_tangent=True):
        at = (w * k)[:, None, None]
        dynamic = (model.stiffness - at**2 * model.mass + 1j * at * (model.damping + xi * model.mass)) / scale
        force, tangent = system.forces(system.shapes @ q, w * k, with_tangent)
        r = np.einsum("kab,bk->ak", dynamic, q) + system.shapes.T @ force / scale
        shift = anchor @ (q.ravel() - first) / size
        conditions = mode.conditions(system, q, w, shift) if mode else [shift]
        r = np.concatenate([r.ravel(), conditions])
        if not with_tangent:
            return r
        matrix = np.einsum("ca,ckl,cb->akbl", system.shapes, tangent, system.shapes) / scale
        for a in range(len(q)):
            for b in range(len(q)):
                matrix[a, np.arange(len(k)), b, np.arange(len(k))] += dynamic[:, a, b]
        full = np.zeros((len(r), len(r)), dtype=complex)
        full[:n, :n] = matrix.reshape(n, n)
        full[n:, :n] = mode.rows(system, q, w, anchor / size) if mode else anchor / size
        h = 1e-6 * omega
        full[:, n] = (all_of(q, w + h, xi, False) - all_of(q, w - h, xi, False)) / (2 * h)
        if mode:
            full[:, n + 1] = (all_of(q, w, xi + h, False) - all_of(q, w, xi - h, False)) / (2 * h)
        return r, full

    for _ in range(MAX_STEPS):
        r, full = all_of(q, omega, damping)
        norm = np.linalg.norm(r)
        if norm < SOLVED * size or not np.isfinite(norm):
            break
        try:
            step = np.linalg.solve(full, r)
        except np.linalg.LinAlgError:
            break
        share = min(1.0, 0.1 * omega / max(abs(step[n].real), 1e-300))
        for _ in range(MAX_HALVINGS):
            xi = damping - share * step[n + 1].real if mode else 0.0
            there = q - share * step[:n].reshape(q.shape), omega - share * step[n].real, xi
            if np.linalg.norm(all_of(*there, False)) < (1 - 0.1 * share) * norm:
                break
            share /= 2
        q, omega, damping = _real(box, there[0]), *there[1:]
    return Answer(q, np.array([omega]), damping=damping, is_solved=bool(norm < SOLVED * size))


@dataclass
class Mode:
    """What a normal mode prescribes: the displacement of a degree of freedom at time 0, where its rate is zero, or the energy."""

    dof: int
    amplitude: float = 0.0
    energy: float = 0.0

    def conditions(self, system: System, q, omega, shift) -> list:
        """`shift` of the phase against where the motion began; the position of a peak follows from the record itself."""
        if not self.energy:
            return [(1j * system.box.tuples[:, 0] * q[self.dof]).sum(), q[self.dof].sum() - self.amplitude]
        return [shift, (self._energy(system, q, omega) / self.energy - 1) * max(system.box.norm(q), 1e-300)]

    def rows(self, system: System, q, omega, anchor) -> np.ndarray:
        k = system.box.tuples[:, 0]
        rows = np.zeros((2, *q.shape), dtype=complex)
        if not self.energy:
            rows[0, self.dof] = 1j * k
            rows[1, self.dof] = 1.0
        else:
            rows[0] = anchor.reshape(q.shape)
            force, _ = system.forces(system.shapes @ q, omega * k, False)
            stored = system.model.stiffness @ q + (omega * k) ** 2 * (system.model.mass @ q) + system.shapes.T @ force
            rows[1] = stored.conj() * max(system.box.norm(q), 1e-300) / self.energy
        return rows.reshape(2, -1)

    @staticmethod
    def _energy(system: System, q, omega) -> float:
        rates = omega * system.box.tuples[:, 0] * q
        moves = np.einsum("ak,ab,bk->", rates.conj(), system.model.mass, rates).real / 2
        strains = np.einsum("ak,ab,bk->", q.conj(), system.model.stiffness, q).real / 2
        samples = system.box.sampled(system.shapes @ q)
        return moves + strains + sum(potential(law, samples[c]).mean() for law, c in zip(system.model.laws, system.law_at))
