"""A multi-tone Fourier series: one degree of freedom of one solution, independent of files.

x(t) = sum_h [ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], tau_m = omega_m t. Only one of j and -j is stored. Amplitudes
are one-sided peaks, sqrt(cos_h**2 + sin_h**2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

# Numbers in memory while sines are summed, and points of the grid on which the peak is searched for.
_CHUNK = 2**22
_PEAK_GRID = 2**22


@dataclass(frozen=True)
class Series:
    """Harmonics of one quantity, with `tuples` (n_harmonics, n_tones) and `omega` (n_tones) [rad/s]."""

    tuples: np.ndarray
    omega: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    label: str = "x"
    units: str = ""
    words: str = ""

    @property
    def axis_label(self) -> str:
        """Description and name of the quantity: `Displacement v3`, `Law force on v3`."""
        text = f"{self.words} {self.label}" if self.words else self.label
        return text[:1].upper() + text[1:] if " " in text else text

    @property
    def n_tones(self) -> int:
        return self.tuples.shape[1]

    @property
    def n_harmonics(self) -> int:
        return self.tuples.shape[0]

    @property
    def frequencies(self) -> np.ndarray:
        """Frequency j . omega of each harmonic [rad/s]; may be negative."""
        return self.tuples @ self.omega

    @property
    def amplitudes(self) -> np.ndarray:
        """One-sided peak amplitude of each harmonic."""
        return np.hypot(self.cos, self.sin)

    def without_noise(self, noise: float) -> Series:
        """The same with zeros for coefficients at the rounding level; all of them are zero if none is larger."""
        is_noise = self.amplitudes <= noise
        return replace(self, cos=np.where(is_noise, 0.0, self.cos), sin=np.where(is_noise, 0.0, self.sin))

    def velocity(self) -> Series:
        """Its time derivative."""
        units = f"{self.units if self.units not in ('', '1') else '1'}/s"
        frequencies = self.frequencies
        return replace(self, cos=frequencies * self.sin, sin=-frequencies * self.cos, units=units, words="velocity of")

    @property
    def mean(self) -> float:
        """Mean value: the coefficient of j = 0, zero if that is not in the set."""
        return float(self.cos[~self.tuples.any(axis=1)].sum())

    @property
    def rms(self) -> float:
        """Root mean square over hypertime by Parseval; equals that over time for incommensurate tones."""
        is_mean = ~self.tuples.any(axis=1)
        power = np.where(is_mean, self.cos**2, 0.5 * (self.cos**2 + self.sin**2))
        return float(np.sqrt(power.sum()))

    def harmonic(self, j: Sequence[int]) -> tuple[float, float]:
        """(cos, sin) of tuple `j`, also if -j is the stored one; KeyError if neither is."""
        j = np.asarray(j, dtype=int)
        if j.shape == (self.n_tones,):
            for sign in (1, -1):
                found = np.flatnonzero((self.tuples == sign * j).all(axis=1))
                if found.size:
                    return float(self.cos[found[0]]), float(sign * self.sin[found[0]])
        raise KeyError(tuple(int(k) for k in j))

    def evaluate(self, t) -> np.ndarray:
        """Values at times `t` [s], of the shape of `t`."""
        t = np.asarray(t, dtype=float)
        return self._sum(t.reshape(-1, 1), self.frequencies[None, :]).reshape(t.shape)

    def at(self, tau) -> np.ndarray:
        """Values at points `tau` (..., n_tones) of hypertime [rad]."""
        tau = np.asarray(tau, dtype=float)
        return self._sum(tau.reshape(-1, self.n_tones), self.tuples.T).reshape(tau.shape[:-1])

    def on_grid(self, shape) -> np.ndarray:
        """Values on the grid tau_m = 2 pi k / shape[m], axes in the order tau_1, tau_2, ...

        `shape` is one number for all tones or one for each. Any size is permitted, even coarser than the harmonics, because at a
        grid point exp(i j tau_m) depends on j modulo shape[m] only.
        """
        shape = (int(shape),) * self.n_tones if np.ndim(shape) == 0 else tuple(int(n) for n in shape)
        if len(shape) != self.n_tones or min(shape) < 1:
            raise ValueError(
                f"a grid for {self.n_tones} tones needs {self.n_tones} sizes of 1 or more, got {shape}"
            )
        return _on_grid(self.tuples, shape, self.cos[None], self.sin[None])[0]

    def peak(self) -> float:
        """Largest |x| over hypertime."""
        return float(peaks(self.tuples, self.cos[None], self.sin[None])[0])

    def _sum(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Sum over harmonics at phases `left @ right` (n, n_harmonics), in pieces that fit the memory."""
        values = np.empty(left.shape[0])
        step = max(1, _CHUNK // max(1, self.n_harmonics))
        for start in range(0, left.shape[0], step):
            phase = left[start : start + step] @ right
            values[start : start + step] = np.cos(phase) @ self.cos + np.sin(phase) @ self.sin
        return values


def peaks(tuples: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    """Largest |x| over hypertime of each of n series with the same tuples, coefficients (n, n_harmonics): the highest maxima of
    a fine grid, refined by Newton steps."""
    n_tones = tuples.shape[1]
    order = np.abs(tuples).max(axis=0, initial=0)
    factor = 4.0 * min(1.0, (_PEAK_GRID / np.prod(4.0 * (2.0 * order + 1.0))) ** (1.0 / n_tones))
    shape = tuple(np.where(order > 0, np.maximum(np.ceil(factor * (2 * order + 1)), 4), 1).astype(int))
    step = max(1, _CHUNK // (8 * max(int(np.prod(shape)), tuples.shape[0])))
    pieces = [_peaks(tuples, shape, cos[k : k + step], sin[k : k + step]) for k in range(0, len(cos), step)]
    return np.concatenate([np.zeros(0), *pieces])


def _peaks(tuples: np.ndarray, shape: tuple[int, ...], cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    height = np.abs(_on_grid(tuples, shape, cos, sin))
    is_summit = np.ones(height.shape, dtype=bool)
    for axis in range(1, height.ndim):
        for shift in (1, -1):
            is_summit &= height >= np.roll(height, shift, axis)
    height = np.where(is_summit, height, 0.0).reshape(len(cos), -1)
    summits = np.argpartition(height, -min(4, height.shape[1]), axis=1)[:, -4:]
    tau = 2.0 * np.pi * np.stack(np.unravel_index(summits, shape), axis=-1) / shape
    best, cos, sin = height.max(axis=1), cos[:, None], sin[:, None]
    for _ in range(9):
        phase = tau @ tuples.T
        c, s = np.cos(phase), np.sin(phase)
        value = cos * c + sin * s
        best = np.maximum(best, np.abs(value.sum(axis=-1)).max(axis=1))
        hessian = np.linalg.pinv(-np.einsum("nsh,ha,hb->nsab", value, tuples, tuples, optimize=True), rcond=1e-12)
        tau = tau - np.einsum("nsab,nsb->nsa", hessian, (sin * c - cos * s) @ tuples)
    return best


def _on_grid(tuples: np.ndarray, shape: tuple[int, ...], cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    """Values of series (n, *shape); see Series.on_grid."""
    spectrum = np.zeros((len(cos), *shape), dtype=complex)
    half = 0.5 * (cos - 1j * sin)
    np.add.at(spectrum, (slice(None), *(tuples % shape).T), half)
    np.add.at(spectrum, (slice(None), *(-tuples % shape).T), half.conj())
    return np.fft.ifftn(spectrum, axes=range(1, spectrum.ndim)).real * np.prod(shape)
