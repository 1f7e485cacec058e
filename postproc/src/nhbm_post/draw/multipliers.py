"""Floquet multipliers of many points and the unit circle."""

from __future__ import annotations

import numpy as np

from ..axis_words import axis_words, with_symbol
from ..errors import UsageError
from ..reader import Results
from . import style

_LARGEST = 3.0  # magnitude up to which multipliers are drawn at their values
_SMALL = 0.15  # part of the frame that is drawn enlarged if it has all of them


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
        drawn = _draw(ax, values, colour, size > 1.0)
        if along:
            fig.colorbar(drawn, ax=ax, label=style.with_unit(with_symbol(*axis_words(results, along)), along.units), shrink=0.8)
        reach = 1.08 * max(1.0, float(np.abs(values).max()))
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
        ax.set(xlabel=r"Real part of $\mu$", ylabel=r"Imaginary part of $\mu$", aspect="equal")
        ax.grid(True)
        _enlarge(ax, values, colour, size > 1.0)
        notes = f"{int(is_far.sum())} multipliers above {_LARGEST:g} are clipped to {_LARGEST:g}" if is_far.any() else ""
        counts = f"{points.size} point{'s' * (points.size > 1)}, {n_unstable} unstable"
        about = ", ".join(t for t in (results.title, results.where_text(where or {}), counts) if t)
        style.head(fig, "Floquet multipliers", about, notes)
    return fig


def _draw(ax, values: np.ndarray, colour: np.ndarray, is_outside: np.ndarray):
    """The unit circle, and multipliers inside and outside it; returns the last marks."""
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(np.cos(angle), np.sin(angle), color=style.WALL, linewidth=1.0, gid="circle")
    drawn = None
    for outside, marker in ((False, "o"), (True, "X")):
        part = is_outside == outside
        if part.any():
            drawn = ax.scatter(
                values[part].real, values[part].imag, c=colour[part], cmap=style.COLOUR_MAP, marker=marker, s=22 if outside else 12,
                vmin=colour.min(), vmax=colour.max(), edgecolors=style.INK if outside else "none", linewidths=0.4,
                gid="outside" if outside else "inside",
            )  # fmt: skip
    return drawn


def _enlarge(ax, values: np.ndarray, colour: np.ndarray, is_outside: np.ndarray) -> None:
    """Multipliers that are all within a small part of the frame, near the circle, are drawn enlarged within it."""
    low, high = (complex(f(values.real), f(values.imag)) for f in (np.min, np.max))
    extent = max((high - low).real, (high - low).imag)
    middle = 0.5 * (low + high)
    if not 0.0 < extent < _SMALL * np.ptp(ax.get_xlim()) or abs(middle) < 0.75:
        return
    inset = ax.inset_axes((0.3, 0.3, 0.42, 0.42))
    _draw(inset, values, colour, is_outside)
    half = 0.62 * extent
    inset.set(xlim=(middle.real - half, middle.real + half), ylim=(middle.imag - half, middle.imag + half), aspect="equal")
    inset.tick_params(labelsize=6.5)
    inset.locator_params(nbins=4)
    inset.grid(True)
    ax.indicate_inset_zoom(inset, edgecolor=style.MUTED)
