"""Floquet multipliers of many points and the unit circle."""

from __future__ import annotations

import numpy as np

from ..axis_words import axis_words, with_symbol
from ..errors import UsageError
from ..reader import Results
from . import style

_LARGEST = 3.0  # magnitude up to which multipliers are drawn at their values


def draw_multipliers(results: Results, *, where=None):
    """Multipliers of the chosen points, coloured along the swept parameter with most values; unstable ones are crosses.

    Multipliers larger than 3 in magnitude are drawn at 3, on their ray, and counted.
    """
    points = np.array(results.select(where) if where else range(results.n_points), dtype=int)
    values = results.multipliers()[points]
    known = np.isfinite(values.real).any(axis=1)
    if not known.any():
        raise UsageError(f"{results.path}: none of the chosen points has multipliers; "
                         "&stability method = 'integration' in the input computes them")
    points, values = points[known], values[known]
    swept = [p for p in results.parameters.values() if p.is_number and len(set(p.values[points].tolist())) > 1]
    along = results.shown(max(swept, key=lambda p: len(set(p.values[points].tolist())))) if swept else None
    colour = np.repeat((along.values[points] if along else np.zeros(points.size))[:, None], values.shape[1], axis=1)
    seen = np.isfinite(values.real)
    values, colour = values[seen], colour[seen]
    size = np.abs(values)
    is_far = size > _LARGEST
    values = np.where(is_far, values / np.maximum(size, _LARGEST) * _LARGEST, values)
    n_unstable = int((results.stability()[points] < 0).sum())
    with style.look():
        fig = style.figure(5.6 if along else 4.8, 5.0)
        ax = fig.add_subplot()
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        ax.plot(np.cos(angle), np.sin(angle), color=style.WALL, linewidth=1.0, gid="circle")
        drawn = None
        for is_outside, marker in ((False, "o"), (True, "X")):
            part = (size > 1.0) == is_outside
            if part.any():
                drawn = ax.scatter(
                    values[part].real, values[part].imag, c=colour[part], cmap=style.COLOUR_MAP, marker=marker,
                    s=22 if is_outside else 12, vmin=colour.min(), vmax=colour.max(),
                    edgecolors=style.INK if is_outside else "none", linewidths=0.4,
                    gid="outside" if is_outside else "inside",
                )  # fmt: skip
        if along:
            fig.colorbar(drawn, ax=ax, label=style.with_unit(with_symbol(*axis_words(results, along)), along.units), shrink=0.8)
        reach = 1.08 * max(1.0, float(np.abs(values).max()))
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
        ax.set(xlabel=r"Real part of $\mu$", ylabel=r"Imaginary part of $\mu$", aspect="equal")
        ax.grid(True)
        notes = f"{int(is_far.sum())} multipliers above {_LARGEST:g} are clipped to {_LARGEST:g}" if is_far.any() else ""
        counts = f"{points.size} point{'s' * (points.size > 1)}, {n_unstable} unstable"
        about = ", ".join(t for t in (results.title, results.where_text(where or {}), counts) if t)
        style.head(fig, "Floquet multipliers", about, notes)
    return fig
