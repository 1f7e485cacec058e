"""Displacement in time: points of a file and references (figures 4 and 7 of the paper)."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nhbm.child_process import atomic_write

from ..errors import ReaderError, UsageError
from ..series import Series
from . import style

# Default window, in periods of the slowest harmonic of significant amplitude, and its resolution.
_PERIODS = (2.0, 8.0)  # with one tone; with several, of the slowest
_SAMPLES_A_PERIOD = 24
_MIN_SAMPLES, _MAX_SAMPLES = 2000, 200_000


@dataclass(frozen=True)
class Record:
    """A time series (t [s], x) from elsewhere, for example of a time integration."""

    label: str
    t: np.ndarray
    x: np.ndarray


def read_record(path, dof: str = "") -> Record:
    """Reads a text table: time in the first column, and the column headed `dof`, otherwise the second one.

    Columns are separated by commas, semicolons or blanks; one heading line and comments after # are allowed.
    """
    path = Path(path)
    try:
        lines = [line.split("#")[0].strip() for line in path.read_text().splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise ReaderError(
            f"{path}: cannot be read as text ({getattr(error, 'strerror', None) or error})"
        ) from None
    rows = [_fields(line) for line in lines if line]
    column, names = 1, []
    if rows and not _is_number(rows[0][0]):
        names = [name.strip().strip('"') for name in rows.pop(0)]
        bare = [re.sub(r"\s*[\[(].*", "", name) for name in names]
        column = bare.index(dof) if dof in bare[1:] else 1
    wide = next((len(row) for row in rows if len(row) > max(2, len(names))), 0)
    if wide and (names or all(re.fullmatch(r"[-+]?\d+", field) for row in rows for field in row)):
        raise ReaderError(f"{path}: its rows have {wide} values, and the table {len(names) or 2} columns; write points in numbers")
    try:
        table = np.array([[float(row[0]), float(row[column])] for row in rows])
    except (ValueError, IndexError):
        bad = next(
            i for i, row in enumerate(rows) if len(row) <= column or not _is_number(row[0], row[column])
        )
        raise ReaderError(
            f"{path}: data row {bad + 1} is not a pair of numbers (t, x): {' '.join(rows[bad])}"
        ) from None
    if len(table) < 2:
        raise ReaderError(f"{path}: needs at least two rows of numbers (t, x), found {len(table)}")
    table = table[np.argsort(table[:, 0], kind="stable")]
    if not np.isfinite(table).all():
        raise ReaderError(f"{path}: holds values that are not finite")
    return Record(path.stem, table[:, 0], table[:, 1])


def write_time(
    columns: list[tuple[str, Series]], path: Path, t_from: float | None, t_to: float | None, n_samples: int | None
) -> Path:
    """Writes a text table with the times and the columns (name, series), with all digits, for `read_record`."""
    several = [series for _, series in columns]
    t_from, t_to = _window(several[0], (), t_from, t_to)
    t = np.linspace(t_from, t_to, n_samples or _n_samples(several, t_to - t_from))
    names = [("t", "s"), *((name, series.units) for name, series in columns)]
    return write_table(names, [t, *(s.evaluate(t) for s in several)], path)


def write_table(names: list[tuple[str, str]], columns: list[np.ndarray], path: Path) -> Path:
    """Writes columns, with their names and units, as text."""
    header = ",".join(f"{name} [{unit}]" for name, unit in names)
    try:
        with atomic_write(path) as name:
            np.savetxt(name, np.column_stack(columns), "%.17g", ",", header=header, comments="")
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None
    return path


def draw_time(
    curves: list[tuple[str, Series]],
    references: list[tuple[str, Series] | Record] = (),
    *,
    title: str = "",
    t_from: float | None = None,
    t_to: float | None = None,
    level: float | None = None,
    n_samples: int | None = None,
    has_difference: bool = False,
):
    """Curves (legend text, series) over time, on top of the references; a wall is drawn at `level`.

    With `has_difference` a second panel shows the difference of each curve from the first reference.
    """
    if not curves:
        raise UsageError("nothing to draw: no curve was chosen")
    if has_difference and not references:
        raise UsageError("--difference needs --overlay: a difference to what?")
    first = curves[0][1]
    t_from, t_to = _window(first, references, t_from, t_to)
    t = np.linspace(t_from, t_to, n_samples or _n_samples([s for _, s in curves], t_to - t_from))

    reference_data = []
    for reference in references:
        if isinstance(reference, Record):
            inside = (reference.t >= t_from) & (reference.t <= t_to)
            if inside.sum() < 2:
                raise UsageError(
                    f"'{reference.label}' covers {reference.t[0]:g} to {reference.t[-1]:g} s: "
                    f"nothing from {t_from:g} to {t_to:g} s"
                )
            reference_data.append((reference.label, reference.t[inside], reference.x[inside]))
        else:
            reference_data.append((reference[0], t, reference[1].evaluate(t)))
    curve_data = [(label, series.evaluate(t)) for label, series in curves]

    everything = np.concatenate([x for _, _, x in reference_data] + [x for _, x in curve_data])
    largest = max(np.abs(everything).max(), abs(level or 0.0))
    factor, units = style.unit_scale(largest, first.units)
    with style.look():
        fig = style.figure(7.4, 4.0 if not has_difference else 5.2)
        axes = fig.subplots(
            2 if has_difference else 1,
            1,
            sharex=True,
            squeeze=False,
            gridspec_kw={"height_ratios": (2.4, 1.0) if has_difference else (1.0,)},
        )[:, 0]
        ax = axes[0]
        for i, (label, t_reference, x) in enumerate(reference_data):
            ax.plot(
                t_reference,
                factor * x,
                color=("#b9bec7", "#8d939e", "#d8c9a8")[i % 3],
                linewidth=3.2,
                label=label,
                solid_capstyle="round",
            )
        for i, (label, x) in enumerate(curve_data):
            ax.plot(t, factor * x, color=style.COLOURS[i % len(style.COLOURS)], label=label)
        low, high = factor * everything.min(), factor * everything.max()
        if level is not None:
            low, high = _draw_wall(ax, factor * level, units, low, high)
        margin = 0.06 * (high - low or abs(high) or 1.0)
        ax.set(
            xlim=(t_from, t_to),
            ylim=(low - margin, high + margin),
            ylabel=style.with_unit(first.axis_label, units),
        )
        ax.grid(True)
        ax.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncol=style.legend_columns(ax.get_legend_handles_labels()[1], fig.get_figwidth()),
            borderaxespad=0.3,
            handlelength=2.6,
            columnspacing=1.4,
        )
        if has_difference:
            _draw_difference(axes[1], curves, reference_data[0], first)
        axes[-1].set_xlabel(r"Time $t$ [s]")
        ends = " to ".join(style.quantity_text(t, "s") for t in (t_from, t_to))
        style.head(fig, f"Time history of {first.label}, {ends}", title)
    return fig


def _draw_wall(ax, level: float, units: str, low: float, high: float) -> tuple[float, float]:
    """Wall line with hatching on the side away from the motion; returns limits that include it."""
    depth = 0.07 * max(high - low, 1e-300)
    is_above = level >= 0.5 * (low + high)
    edge = max(high, level + depth) if is_above else min(low, level - depth)
    ax.axhspan(
        min(level, edge + (depth if is_above else -depth)),
        max(level, edge + (depth if is_above else -depth)),
        facecolor="none",
        edgecolor=style.WALL,
        hatch="////",
        linewidth=0,
        zorder=0.5,
    )
    ax.axhline(level, color=style.INK, linewidth=0.9, label=f"wall at {level:.6g} {units}".rstrip())
    return min(low, edge), max(high, edge)


def _draw_difference(ax, curves, reference, first: Series) -> None:
    """Each curve minus the reference, at the times of the reference."""
    _, t, x = reference
    differences = [series.evaluate(t) - x for _, series in curves]
    largest = max(np.abs(d).max() for d in differences)
    factor, units = style.unit_scale(largest, first.units)
    for i, difference in enumerate(differences):
        ax.plot(
            t,
            factor * difference,
            color=style.COLOURS[i % len(style.COLOURS)],
            linewidth=1.0,
        )
    ax.set_ylabel(style.with_unit("Difference", units))
    ax.set_title(
        f"difference to {reference[0]}: largest {factor * largest:.3g} {units}".rstrip(),
        color=style.MUTED,
        size=8.5,
    )
    ax.grid(True)


def _window(series: Series, references, t_from, t_to) -> tuple[float, float]:
    """Start and end [s]: as given, otherwise some periods of the slowest tone, at the end of a record if there is one."""
    slowest = _slowest(series)
    length = _PERIODS[series.n_tones > 1] * 2.0 * np.pi / slowest if slowest > 0.0 else 1.0
    ends = [reference.t[-1] for reference in references if isinstance(reference, Record)]
    if t_from is None and t_to is None and ends:
        starts = [reference.t[0] for reference in references if isinstance(reference, Record)]
        t_to = min(ends)
        t_from = max(t_to - length, max(starts))
    if t_from is None:
        t_from = 0.0 if t_to is None or t_to > 0.0 else t_to - length
    if t_to is None:
        t_to = t_from + length
    if not t_to > t_from:
        raise UsageError(f"the time window is empty: from {t_from:g} s to {t_to:g} s")
    return float(t_from), float(t_to)


def _slowest(series: Series) -> float:
    omega = np.abs(series.omega[np.abs(series.tuples).any(axis=0)])
    return float(omega[omega > 0.0].min(initial=np.inf)) if (omega > 0.0).any() else 0.0


def _n_samples(all_series: list[Series], length: float) -> int:
    fastest = max(np.abs(s.frequencies).max(initial=0.0) for s in all_series)
    wanted = _SAMPLES_A_PERIOD * length * fastest / (2.0 * np.pi)
    return int(np.clip(wanted, _MIN_SAMPLES, _MAX_SAMPLES)) + 1


def _fields(line: str) -> list[str]:
    for mark in (",", ";"):
        if mark in line:
            return [field.strip() for field in next(csv.reader([line], delimiter=mark))]
    return line.split()


def _is_number(*fields: str) -> bool:
    try:
        return all(isinstance(float(field), float) for field in fields)
    except ValueError:
        return False
