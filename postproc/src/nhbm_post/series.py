"""A multi-tone Fourier series: one degree of freedom of one solution, independent of files.

x(t) = sum_h [ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], tau_m = omega_m t. Only one of j and -j is stored. Amplitudes
are one-sided peaks, sqrt(cos_h**2 + sin_h**2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from nhbm.hypertime import CHUNK, on_grid, peaks


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
        return on_grid(self.tuples, shape, self.cos[None], self.sin[None])[0]

    def peak(self) -> float:
        """Largest |x| over hypertime."""
        return float(peaks(self.tuples, self.cos[None], self.sin[None])[0][0])

    def _sum(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Sum over harmonics at phases `left @ right` (n, n_harmonics), in pieces that fit the memory."""
        values = np.empty(left.shape[0])
        step = max(1, CHUNK // max(1, self.n_harmonics))
        for start in range(0, left.shape[0], step):
            phase = left[start : start + step] @ right
            values[start : start + step] = np.cos(phase) @ self.cos + np.sin(phase) @ self.sin
        return values
