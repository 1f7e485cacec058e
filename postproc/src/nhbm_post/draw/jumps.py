"""Jumps at the folds of a curve: the motions with which a sweep continues after a fold."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

COINCIDENT = 1e-9  # of the largest value of x


def jumps_at_folds(
    x: np.ndarray, y: np.ndarray, kind: np.ndarray, stability: np.ndarray, bifurcations: Collection[str]
) -> list[tuple[float, float, float]]:
    """(x, y of the fold, y of the motion after the jump) for each fold at which stable motions end.

    Points are in the order of the arc; next to a fold a multiplier is 1 up to rounding, and the stability slightly farther along
    the curve is used. A jump leads to the stable motion of the curve at the same x that is nearest in y; there is none if stability
    is unknown, or if the curve has no stable motion at this x. Stability may change at bifurcations. At a graze it may, too: if it
    coincides with a fold, the stability beyond both is used, and no jump leads to it.
    """
    jumps = []
    is_passed = ~np.isin(kind, ["none", *bifurcations])
    stable = stability > 0
    for fold in np.flatnonzero(kind == "fold"):
        first, last = _at_fold(x, fold)
        beyond = np.where((kind == "grazing") & (np.arange(x.size) >= first) & (np.arange(x.size) <= last), 0, stability)
        if _known_beside(fold, -1, is_passed, beyond) * _known_beside(fold, 1, is_passed, beyond) >= 0:
            continue
        to = [
            y[i] + (x[fold] - x[i]) / (x[i + 1] - x[i]) * (y[i + 1] - y[i])
            for i in range(x.size - 1)
            if stable[i] and stable[i + 1] and (x[i] - x[fold]) * (x[i + 1] - x[fold]) <= 0.0 and x[i] != x[i + 1]
            if not first <= i + 1 <= last + 1
        ]
        to = [height for height in to if np.isfinite(height)]
        if to:
            jumps.append((float(x[fold]), float(y[fold]), float(min(to, key=lambda height: abs(height - y[fold])))))
    return jumps


def _at_fold(x: np.ndarray, fold: int) -> tuple[int, int]:
    """The first and the last of the points in a row that coincide with a fold, such as a graze."""
    apart = np.flatnonzero(np.abs(x - x[fold]) > COINCIDENT * np.nanmax(np.abs(x)))
    before, after = apart[apart < fold], apart[apart > fold]
    return (int(before[-1]) + 1 if before.size else 0), (int(after[0]) - 1 if after.size else x.size - 1)


def _known_beside(fold: int, step: int, is_passed: np.ndarray, stability: np.ndarray) -> int:
    """The stability on one side of a fold, up to the next bifurcation; 0 if unknown."""
    i = fold + step
    while 0 <= i < is_passed.size and is_passed[i]:
        if stability[i] != 0:
            return int(stability[i])
        i += step
    return 0
