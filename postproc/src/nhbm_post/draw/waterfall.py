"""Spectra of many points along a swept value: a waterfall, and a Campbell diagram."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm

from ..axis_words import axis_words, with_symbol
from ..errors import UsageError
from ..reader import Results
from ..series import Series
from . import style
from .response import groups_of, other_parameters

_N_SPECTRA = 24  # largest number of spectra in a waterfall, spread evenly
_HEIGHT = 1.8  # of the tallest stem, in distances between spectra
_N_ORDERS = 12
_LABEL = 0.045, 0.035  # width and height of the label of an order, in those of the axes


def draw_waterfall(
    results: Results, dof: str | None = None, *, view: str = "waterfall", quantity: str = "motion", over: str | None = None,
    where=None, decades: float = 4.0,
):  # fmt: skip
    """Amplitudes of all harmonics over frequency and a swept value.

    `waterfall`: stems on a line for each of at most 24 points, heights logarithmic. `campbell`: a dot for each harmonic at its
    frequency over the swept value, coloured by its amplitude, with the multiples of a given tone.
    """
    dof = results.default_dof(quantity) if dof is None else dof
    points = np.intersect1d(results.select(where) if where else results.used, results.solved)
    if not points.size:
        raise UsageError(f"{results.path}: none of the chosen points is solved; in the file: {results.outcome_text()}")
    axis = results.shown(results.parameter(over) if over else _varied(results, points))
    if not axis.is_number:
        raise UsageError(f"{results.path}: '{axis.label}' takes words, which are no axis for spectra")
    others = [p for p in other_parameters(results, axis, points) if p is not results.curve]
    points, *other_lines = groups_of(others, points)
    found = {point: series.without_noise(results.noise(point, quantity, series.units))
             for point, series in results.all_series(dof, quantity, points)}  # fmt: skip
    by, hertz = results.frequency_scale()
    largest = max(float(series.amplitudes.max(initial=0.0)) for series in found.values())
    if largest == 0.0:
        raise UsageError(f"all harmonics of {dof} are zero: there is no spectrum to draw")
    factor, units = style.unit_scale(largest, next(iter(found.values())).units, is_logarithmic=True)
    norm = LogNorm(factor * largest * 10.0**-decades, factor * largest)
    words, symbol = axis_words(results, axis)
    frequency = "Frequency $f$ [Hz]" if hertz == "Hz" else r"Frequency $|j\cdot\omega|$ [rad/s]"
    amplitude = style.with_unit(rf"Amplitude $|c_j|$ of {next(iter(found.values())).label}", units)
    with style.look():
        fig = style.figure(7.0, 5.0)
        ax = fig.add_subplot()
        values = {point: float(axis.values[point]) for point in found}
        scale, axis_units = style.unit_scale(max(map(abs, values.values())), axis.units)
        values = {point: scale * value for point, value in values.items()}
        name = style.with_unit(with_symbol(words, symbol), axis_units)
        note = ""
        if view == "campbell":
            drawn, note = _campbell(ax, found, values, by, factor, norm, results)
            ax.set(xlabel=name, ylabel=frequency, ylim=(0.0, None))
        else:
            drawn, note = _waterfall(ax, found, values, by, factor, norm)
            ax.set(xlabel=frequency, ylabel=name, xlim=(0.0, None))
        ax.grid(True)
        fig.colorbar(drawn, ax=ax, label=amplitude, extend="min").outline.set_linewidth(0.5)
        head = "Campbell diagram" if view == "campbell" else "Waterfall"
        named = [p.name for p in others]
        chosen = {key: value for key, value in (where or {}).items() if results.parameter(key).name not in named}
        at = [results.shown(p).text(int(points[0])) for p in others]
        about = ", ".join(t for t in (results.title, results.where_text(chosen), *at) if t)
        if other_lines:
            note = "; ".join([*[note] * bool(note), f"one of {1 + len(other_lines)} lines of the sweep: --where chooses"])
        style.head(fig, f"{head} of {dof} over {words}", about, note)
    return fig


def _varied(results: Results, points: np.ndarray):
    """The value along which a curve was followed, otherwise the number with most values."""
    if results.curve:
        return results.curve
    several = [p for p in results.parameters.values() if p.is_number and len(set(p.values[points].tolist())) > 1]
    if not several:
        raise UsageError(f"{results.path}: no number changes over the {len(points)} solved point(s): nhbm-post spectrum draws one")
    return max(several, key=lambda p: len(set(p.values[points].tolist())))


def _shown(series: Series, by: float, factor: float, norm: LogNorm) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and amplitudes above the lower end of the scale."""
    amplitudes = factor * series.amplitudes
    which = amplitudes >= norm.vmin
    return by * np.abs(series.frequencies[which]), amplitudes[which]


def _waterfall(ax, found, values, by, factor, norm):
    points = sorted(found, key=values.__getitem__)
    note = ""
    if len(points) > _N_SPECTRA:
        of_points = np.array([values[point] for point in points])
        wanted = np.linspace(of_points[0], of_points[-1], _N_SPECTRA)
        points = [points[k] for k in np.unique(np.abs(of_points[:, None] - wanted).argmin(axis=0))]
        note = f"{len(points)} of {len(found)} points, about evenly spread"
    levels = [values[point] for point in points]
    step = (max(levels) - min(levels)) / max(1, len(points) - 1) or 1.0
    decades = np.log10(norm.vmax / norm.vmin)
    stems, sizes = [], []
    for point, level in zip(points, levels):
        frequency, amplitudes = _shown(found[point], by, factor, norm)
        tops = level + _HEIGHT * step * np.log10(amplitudes / norm.vmin) / decades
        stems += [[(f, level), (f, top)] for f, top in zip(frequency, tops)]
        sizes += amplitudes.tolist()
    fastest = max(stem[0][0] for stem in stems)
    ax.hlines(levels, 0.0, 1.03 * fastest, color="#d9dce1", linewidth=0.5, zorder=0)
    drawn = ax.add_collection(LineCollection(stems, cmap=style.COLOUR_MAP, norm=norm, linewidths=1.6, array=sizes, gid="stems"))
    ax.set(xlim=(0.0, 1.03 * fastest), ylim=(min(levels) - 0.5 * step, max(levels) + (_HEIGHT + 0.3) * step))
    return drawn, note


def _campbell(ax, found, values, by, factor, norm, results):
    x, y, size = [], [], []
    for point, series in found.items():
        frequency, amplitudes = _shown(series, by, factor, norm)
        x += [values[point]] * frequency.size
        y += frequency.tolist()
        size += amplitudes.tolist()
    order = np.argsort(size)
    x, y, size = (np.array(column)[order] for column in (x, y, size))
    tone = {point: by * float(abs(found[point].omega[0])) for point in found}
    points = sorted(found, key=values.__getitem__)
    is_given = 0 not in results.unknown_tones() and len(set(tone.values())) > 1
    if is_given:
        at = np.array([values[point] for point in points])
        base = np.array([tone[point] for point in points])
        highest = int(round(max(f / tone[point] for point in points for f in _shown(found[point], by, factor, norm)[0])))
        named = np.empty((0, 2))
        for k in range(1, min(_N_ORDERS, highest + 1) + 1):
            line = k * base
            if line.min() > 1.02 * y.max():
                break
            is_seen = line <= 1.02 * y.max()
            ax.plot(at[is_seen], line[is_seen], linestyle=style.REFERENCE, color=style.WALL, linewidth=0.6, gid="order")
            end = np.flatnonzero(is_seen)[-1]
            position = np.array([at[end] / (np.ptp(at) or 1.0), line[end] / y.max()])
            if (np.abs(position - named) > _LABEL).any(axis=1).all():
                ax.annotate(f"{k}x", (at[end], line[end]), (2, 0), textcoords="offset points", size=7.0, color=style.MUTED)
                named = np.append(named, [position], axis=0)
    area = 5.0 + 22.0 * np.log10(size / norm.vmin) / np.log10(norm.vmax / norm.vmin)
    drawn = ax.scatter(
        x, y, c=size, s=area, norm=norm, cmap=style.COLOUR_MAP, linewidths=0.0, gid="harmonics", rasterized=x.size > 4000
    )
    return drawn, "dash-dotted: multiples of the first tone" if is_given else ""
