"""The marks of points by their status in all pictures: a filled shape or strokes and a colour each, which also differ in grey.

Open shapes are events of curves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.lines import Line2D

from ..outcome import ANSWERS, CONVERGED, PENDING, SOLVED, INTEGRATED, words
from ..reader import Results
from . import style


@dataclass(frozen=True)
class Mark:
    """Shape and colour of a status."""

    shape: str
    colour: str

    def look(self, size: float) -> dict:
        """Arguments for a line of matplotlib; shapes that consist of strokes have no face to fill."""
        is_stroke = self.shape in _STROKES
        return {
            "linestyle": "none",
            "marker": self.shape,
            "markersize": size,
            "markerfacecolor": self.colour,
            "markeredgecolor": self.colour if is_stroke else style.INK,
            "markeredgewidth": 1.2 if is_stroke else 0.5,
        }


_STROKES = ("x", "+", "1", "2", "3", "4", "|", "_")
_MARKS = {
    "truncated": Mark("^", "#E69F00"),
    "aliased": Mark("s", "#56B4E9"),
    "penetrating": Mark("v", "#CC79A7"),
    "impact": Mark("<", "#F0E442"),
    "multiple_attractors": Mark("D", "#009E73"),
    "stalled": Mark("x", style.FAILURE),
    "out_of_budget": Mark("+", style.FAILURE),
    "singular": Mark("1", style.FAILURE),
    "not_finite": Mark("2", style.FAILURE),
    "diverged": Mark(">", style.FAILURE),
    "failed": Mark("X", style.FAILURE),
    "law_undefined": Mark("8", style.FAILURE),
    "timed_out": Mark("4", style.FAILURE),
    "crashed": Mark("*", style.FAILURE),
    "collapsed": Mark("3", style.INK),
    "no_motion": Mark("_", style.INK),
    "locked": Mark("P", style.INK),
    "subharmonic": Mark("h", style.INK),
    "broadband": Mark("p", style.INK),
    "pending": Mark("|", style.WALL),
}
DOTS = {CONVERGED: "o", INTEGRATED: "d"}  # shapes of answers, in the colour of their curve
# Statuses that are newer than this table.
_SOLVED_MARK = Mark("$n$", "#F0E442")
_UNSOLVED_MARK = Mark("H", style.FAILURE)


def mark(name: str, is_solved: bool) -> Mark:
    """Mark of a status by its name in the file."""
    return _MARKS.get(name, _SOLVED_MARK if is_solved else _UNSOLVED_MARK)


def by_status(results: Results, points: Iterable[int]) -> list[tuple[str, bool, np.ndarray]]:
    """(name, whether solved, points) for each status except those of answers that occurs, in the order of the status numbers."""
    points = np.asarray(list(points), dtype=int)
    codes = [code for code in np.unique(results.status[points]) if code not in (*ANSWERS, PENDING)]
    if (results.status[points] == PENDING).any():
        codes.append(PENDING)
    groups = [points[results.status[points] == code] for code in codes]
    return [(results.status_name(int(group[0])), code in SOLVED, group) for code, group in zip(codes, groups)]


def keys(counts: dict[tuple[str, bool], int], n_answers: dict[int, int], size: float = 5.5) -> list[Line2D]:
    """Entries of a legend, `50 truncated`, for all that occur: answers first."""
    entries = []
    for code, n in n_answers.items():
        look = {"color": style.MUTED, "linewidth": 1.4, "marker": DOTS[code], "markersize": 0.62 * size}
        entries += [Line2D([], [], **look, label=f"{n} {ANSWERS[code]}")] if n else []
    for (name, is_solved), n in counts.items():
        entries.append(Line2D([], [], **mark(name, is_solved).look(size), label=f"{n} {words(name)}"))
    return entries
