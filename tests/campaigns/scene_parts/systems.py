"""Random systems of few degrees of freedom for tests/campaigns/scenes, their inputs, and what linear algebra and SciPy say of a
motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.integrate import solve_ivp

ACCURACY = 1e-9  # of an integration, relative and absolute (displacements are about 1)
SHOTS = 12  # Newton steps to a periodic motion
SHOT = 1e-7  # step at which it is found


@dataclass(frozen=True)
class Law:
    """Force of z = weights . x: polynomial(z) for coefficients of z**2 and z**3, or a stop on one side or both."""

    weights: np.ndarray
    kind: str
    square: float = 0.0
    cube: float = 0.0
    stiffness: float = 0.0
    gap: float = 0.0
    is_two_sided: bool = False

    def force(self, z):
        if self.kind == "stop":
            beyond = np.maximum(z - self.gap, 0.0) - (np.maximum(-z - self.gap, 0.0) if self.is_two_sided else 0.0)
            return self.stiffness * beyond
        return self.square * z**2 + self.cube * z**3

    def slope(self, z):
        if self.kind == "stop":
            touches = (np.abs(z) if self.is_two_sided else z) > self.gap
            return self.stiffness * touches
        return 2 * self.square * z + 3 * self.cube * z**2

    def text(self) -> str:
        places = [i for i, weight in enumerate(self.weights) if weight]
        where = f"dof='x{places[0] + 1}'"
        if len(places) > 1:
            names = ", ".join(f"'x{i + 1}'" for i in places)
            where = f"dofs={names}, weights={listed(self.weights[places])}"
        if self.kind == "stop":
            both = ", two_sided=.true." if self.is_two_sided else ""
            return f"&law type='elastic_stop', {where}, stiffness={float(self.stiffness)!r}, gap={float(self.gap)!r}{both} /\n"
        return f"&law type='polynomial', {where}, stiffness=0, {float(self.square)!r}, {float(self.cube)!r} /\n"


@dataclass
class System:
    """M x'' + D x' + K x + laws = loads(t). Coordinates without mass have damping of their own."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    omega: np.ndarray
    loads: list[tuple[tuple[int, ...], int, float, float]]  # tuple, coordinate, cosine, sine
    laws: list[Law] = field(default_factory=list)
    title: str = ""

    def __post_init__(self) -> None:
        self.massive = np.diag(self.mass) > 0
        self.n = len(self.mass)
        m, r = self.massive, ~self.massive
        self.inverse = np.linalg.inv(self.mass[np.ix_(m, m)])
        self.resistance = np.linalg.inv(self.damping[np.ix_(r, r)]) if r.any() else np.zeros((0, 0))
        self.weights = np.array([law.weights for law in self.laws]).reshape(-1, self.n)

    def text(self, more: str) -> str:
        words = ", ".join(f"{name} = {listed(getattr(self, name).ravel())}" for name in ("mass", "damping", "stiffness"))
        text = f"&structure type = 'matrices', n_dofs = {self.n}, {words} /\n&tones frequency = {listed(self.omega)} /\n"
        for harmonic, dof, cosine, sine in self.loads:
            text += f"&load dof='x{dof + 1}', tuple={listed(harmonic)}, cos={float(cosine)!r}, sin={float(sine)!r} /\n"
        return text + "".join(law.text() for law in self.laws) + more

    def linear_amplitude(self, weights: np.ndarray) -> float:
        """Of a coordinate without laws; of several tones the sum."""
        total = 0.0
        for harmonic, dof, cosine, sine in self.loads:
            w = float(np.dot(harmonic, self.omega))
            matrix = self.stiffness - w**2 * self.mass + 1j * w * self.damping
            total += abs(weights @ np.linalg.solve(matrix, np.eye(self.n)[dof] * (cosine - 1j * sine)))
        return total

    def add_law(self, law: Law) -> None:
        """A law whose gap, if it has one, is in units of the linear amplitude."""
        self.laws.append(replace(law, gap=law.gap * self.linear_amplitude(law.weights)))
        self.title += f", {law.kind}"
        self.__post_init__()

    def load(self, t: float) -> np.ndarray:
        total = np.zeros(self.n)
        for harmonic, dof, cosine, sine in self.loads:
            phase = float(np.dot(harmonic, self.omega)) * t
            total[dof] += cosine * np.cos(phase) + sine * np.sin(phase)
        return total

    def state_matrix(self, slopes: np.ndarray) -> np.ndarray:
        """d(x', v')/d(x, v) with laws of these slopes; v: velocities of coordinates with mass. Slopes (..., n_laws)."""
        stiffness = self.stiffness + np.einsum("...l,li,lj->...ij", slopes, self.weights, self.weights)
        return self._matrix(stiffness)

    def _matrix(self, stiffness: np.ndarray) -> np.ndarray:
        n, m, r = self.n, self.massive, ~self.massive
        n_v = int(m.sum())
        matrix = np.zeros((*stiffness.shape[:-2], n + n_v, n + n_v))
        matrix[..., np.flatnonzero(m), n + np.arange(n_v)] = 1.0
        moves = np.zeros((*stiffness.shape[:-2], int(r.sum()), n + n_v))  # velocities without mass
        moves[..., :n] = -self.resistance @ stiffness[..., r, :]
        moves[..., n:] = -self.resistance @ self.damping[np.ix_(r, m)]
        matrix[..., np.flatnonzero(r), :] = moves
        pushes = -self.damping[np.ix_(m, r)] @ moves
        pushes[..., :n] -= stiffness[..., m, :]
        pushes[..., n:] -= self.damping[np.ix_(m, m)]
        matrix[..., n:, :] = self.inverse @ pushes
        return matrix

    def rate(self, t: float, y: np.ndarray) -> np.ndarray:
        x = y[: self.n]
        z = self.weights @ x
        external = self.load(t) - self.weights.T @ np.array([law.force(one) for law, one in zip(self.laws, z)])
        rate = self._linear() @ y
        r, m = ~self.massive, self.massive
        moves = self.resistance @ external[r]
        rate[: self.n][r] += moves
        rate[self.n :] += self.inverse @ (external[m] - self.damping[np.ix_(m, r)] @ moves)
        return rate

    def _linear(self) -> np.ndarray:
        if not hasattr(self, "_kept"):
            self._kept = self._matrix(self.stiffness)
        return self._kept

    def period_map(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State after a period of the first tone, and its derivative."""
        size = len(y)

        def rate(t, whole):
            x, tangent = whole[:size], whole[size:].reshape(size, size)
            slopes = np.array([law.slope(z) for law, z in zip(self.laws, self.weights @ x[: self.n])])
            return np.concatenate([self.rate(t, x), (self.state_matrix(slopes) @ tangent).ravel()])

        period = 2 * np.pi / self.omega[0]
        start = np.concatenate([y, np.eye(size).ravel()])
        step = period / 200 if any(law.kind == "stop" for law in self.laws) else np.inf
        done = solve_ivp(rate, (0.0, period), start, method="DOP853", rtol=ACCURACY, atol=ACCURACY, max_step=step)
        return done.y[:size, -1], done.y[size:, -1].reshape(size, size)

    def orbit(self, y: np.ndarray, gauge: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray] | None:
        """The periodic motion near a state, and its multipliers but for that of a gauge (a displacement that changes nothing)."""
        still = np.zeros((0, len(y))) if gauge is None else np.concatenate([gauge, np.zeros(len(y) - self.n)])[None]
        for _ in range(SHOTS):
            end, tangent = self.period_map(y)
            equations = np.vstack([tangent - np.eye(len(y)), still])
            step = np.linalg.lstsq(equations, np.concatenate([y - end, np.zeros(len(still))]), rcond=None)[0]
            y = y + step
            if np.linalg.norm(step) < SHOT * max(np.linalg.norm(y), SHOT):
                multipliers = np.linalg.eigvals(self.period_map(y)[1])
                if gauge is not None:
                    multipliers = np.delete(multipliers, np.argmin(np.abs(multipliers - 1.0)))
                return y, multipliers
        return None

    def samples(self, y: np.ndarray, times: np.ndarray) -> np.ndarray:
        step = times[-1] / 200 if any(law.kind == "stop" for law in self.laws) else np.inf
        ends = (0.0, times[-1])
        done = solve_ivp(self.rate, ends, y, method="DOP853", t_eval=times, rtol=ACCURACY, atol=ACCURACY, max_step=step)
        return done.y[: self.n].T


@dataclass(frozen=True)
class Motion:
    """Coefficients of a solved point: x = real part of the sum of amplitude exp(i frequency t)."""

    frequencies: np.ndarray
    amplitudes: np.ndarray  # (n_harmonics, n_dofs)

    def at(self, t) -> np.ndarray:
        return (np.exp(1j * np.multiply.outer(t, self.frequencies)) @ self.amplitudes).real

    def rate_at(self, t) -> np.ndarray:
        return (np.exp(1j * np.multiply.outer(t, self.frequencies)) @ (1j * self.frequencies[:, None] * self.amplitudes)).real


def listed(values) -> str:
    return ", ".join(repr(v.item() if hasattr(v, "item") else v) for v in values)
