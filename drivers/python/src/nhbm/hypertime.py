"""Series of several tones on their torus: values on grids of the phases, largest values. The packages nhbm_post and nhbm share this
module."""

from __future__ import annotations

from typing import Any

import numpy as np

# Numbers in memory while sines are summed, and points of the grid on which the peak is searched for.
CHUNK = 2**22
_PEAK_GRID = 2**22


def peaks(tuples: Any, cos: Any, sin: Any) -> tuple[Any, Any]:
    """Largest |x| over hypertime of each of n series with the same tuples (n_harmonics, n_tones), coefficients (n, n_harmonics),
    and the phases (n, n_tones) where it is: the highest maxima of a fine grid, refined by Newton steps."""
    n_tones = tuples.shape[1]
    order = np.abs(tuples).max(axis=0, initial=0)
    factor = 4.0 * min(1.0, (_PEAK_GRID / np.prod(4.0 * (2.0 * order + 1.0))) ** (1.0 / n_tones))
    shape = tuple(np.where(order > 0, np.maximum(np.ceil(factor * (2 * order + 1)), 4), 1).astype(int).tolist())
    step = max(1, CHUNK // (8 * max(int(np.prod(shape)), tuples.shape[0])))
    pieces = [_peaks(tuples, shape, cos[k : k + step], sin[k : k + step]) for k in range(0, len(cos), step)]
    sizes, phases = [piece[0] for piece in pieces], [piece[1] for piece in pieces]
    return np.concatenate([np.zeros(0), *sizes]), np.concatenate([np.zeros((0, n_tones)), *phases])


def _peaks(tuples: Any, shape: tuple[int, ...], cos: Any, sin: Any) -> tuple[Any, Any]:
    height = np.abs(on_grid(tuples, shape, cos, sin))
    is_summit = np.ones(height.shape, dtype=bool)
    for axis in range(1, height.ndim):
        for shift in (1, -1):
            is_summit &= height >= np.roll(height, shift, axis)
    height = np.where(is_summit, height, 0.0).reshape(len(cos), -1)
    summits = np.argpartition(height, -min(4, height.shape[1]), axis=1)[:, -4:]
    tau = 2.0 * np.pi * np.stack(np.unravel_index(summits, shape), axis=-1) / np.array(shape)
    rows = np.arange(len(cos))
    highest = np.take_along_axis(height, summits, axis=1).argmax(axis=1)
    best, phases = height.max(axis=1), tau[rows, highest]
    cos, sin = cos[:, None], sin[:, None]
    for _ in range(9):
        phase = tau @ tuples.T
        c, s = np.cos(phase), np.sin(phase)
        value = cos * c + sin * s
        size = np.abs(value.sum(axis=-1))
        highest = size.argmax(axis=1)
        is_higher = size[rows, highest] > best
        best = np.where(is_higher, size[rows, highest], best)
        phases = np.where(is_higher[:, None], tau[rows, highest], phases)
        hessian = np.linalg.pinv(-np.einsum("nsh,ha,hb->nsab", value, tuples, tuples, optimize=True), rcond=1e-12)
        tau = tau - np.einsum("nsab,nsb->nsa", hessian, (sin * c - cos * s) @ tuples)
    return best, phases


def on_grid(tuples: Any, shape: tuple[int, ...], cos: Any, sin: Any) -> Any:
    """Values of n series (n, *shape) on the grid tau_m = 2 pi k / shape[m]."""
    spectrum = np.zeros((len(cos), *shape), dtype=complex)
    half = 0.5 * (cos - 1j * sin)
    np.add.at(spectrum, (slice(None), *(tuples % shape).T), half)
    np.add.at(spectrum, (slice(None), *(-tuples % shape).T), half.conj())
    return np.fft.ifftn(spectrum, axes=range(1, spectrum.ndim)).real * np.prod(shape)
