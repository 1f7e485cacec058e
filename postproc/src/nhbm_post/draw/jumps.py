"""Jumps off the folds of a curve: where a sweep that comes to a fold goes on."""

from __future__ import annotations

import numpy as np

# What need not change the stability. A graze may: where it and a fold are one, what is known lies beyond both.
_PASSED = ("regular", "peak", "value", "start", "end", "minimum", "amplitude", "resonance", "graze")


def jumps_at_folds(x: np.ndarray, y: np.ndarray, kind: np.ndarray, stability: np.ndarray) -> list[tuple[float, float, float]]:
    """(x, y of the fold, y of the motion jumped to) of each fold at which what is stable ends.

    Points are in the order of the arc; next to a fold a multiplier is 1 but for rounding, and what is known a little farther
    along the curve tells. A jump leads to the stable motion of the curve at the same x that is nearest in y; there
    is none where stability is not known, and where the curve has no stable motion at this x.
    """
    jumps = []
    stable = stability > 0
    for fold in np.flatnonzero(kind == "fold"):
        if _known_beside(fold, -1, kind, stability) * _known_beside(fold, 1, kind, stability) >= 0:
            continue
        to = [
            y[i] + (x[fold] - x[i]) / (x[i + 1] - x[i]) * (y[i + 1] - y[i])
            for i in range(x.size - 1)
            if stable[i] and stable[i + 1] and (x[i] - x[fold]) * (x[i + 1] - x[fold]) <= 0.0 and x[i] != x[i + 1]
            if fold not in (i, i + 1)
        ]
        to = [height for height in to if np.isfinite(height)]
        if to:
            jumps.append((float(x[fold]), float(y[fold]), float(min(to, key=lambda height: abs(height - y[fold])))))
    return jumps


def _known_beside(fold: int, step: int, kind: np.ndarray, stability: np.ndarray) -> int:
    """What is known of the stability on one side of a fold, as far as nothing else happens there; 0 where nothing is."""
    i = fold + step
    while 0 <= i < kind.size and kind[i] in _PASSED:
        if stability[i] != 0:
            return int(stability[i])
        i += step
    return 0
