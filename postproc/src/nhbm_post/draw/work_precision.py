"""Sequences of orders, samples or methods: error over time, error over order with its rate, cost over unknowns."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from ..bench import Bench, Curve
from ..errors import UsageError
from ..rates import Rate, convergence_rate, cost_exponent
from . import style

# Parts of the wall time that an axis can show.
PARTS = {
    "total": "Wall time without error estimate",
    "cpu": "Processor time without error estimate",
    "setup": "Wall time of the set-up",
    "solver": "Wall time of the iterations",
    "error_estimate": "Wall time of the error estimate",
}
# Axes with a symbol, by the end of their path.
_SYMBOLS = {"order": "N", "n_unknowns": "n"}
_AXES = {"order": "Order $N$ of the series", "samples": "Samples per tone", "n_unknowns": "Number of unknowns $n$"}


@dataclass(frozen=True)
class Errors:
    """Errors of all points of a file, NaN: none, and those of improved motions if requested."""

    plain: np.ndarray
    improved: np.ndarray | None = None


def draw_work_precision(bench: Bench, errors: Errors, *, part: str = "total"):
    """Error over wall time (median of the repetitions, bars from shortest to longest), one curve for each setting of all but one
    number."""
    over = bench.varying()
    middle, least, most = (bench.column(f"bench_{part}_seconds{end}") for end in ("", "_min", "_max"))
    curves, values = _drawable(bench, over, errors)
    with style.look():
        fig, ax = _picture(len(curves))
        for i, (curve, error) in enumerate(zip(curves, values)):
            points = curve.points[np.isfinite(error[curve.points])]
            look = _curve_look(i)
            ax.errorbar(
                middle[points],
                error[points],
                xerr=[middle[points] - least[points], most[points] - middle[points]],
                capsize=2.0,
                elinewidth=0.8,
                label=curve.label,
                **look,
            )
            _hollow(ax, bench, points, middle, error, look)
            _mark_ends(ax, over, bench, points, middle, error)
        ax.set(xscale="log", yscale="log")
        ax.set_xlabel(style.with_unit(PARTS[part], "s"))
        ax.set_ylabel("Relative rms error")
        _finish(fig, ax, bench, "Error over time", f"along each curve: {_axis(bench, over).replace('$', '')}")
    return fig


def draw_convergence(bench: Bench, errors: Errors, *, over: str = ""):
    """(figure, [(curve, rate or None)]): error over the order, or another varying number, with the observed rates."""
    over = over or bench.varying()
    x = bench.column(over).astype(float)
    curves, values = _drawable(bench, over, errors)
    if max(len(set(x[c.points].tolist())) for c in curves) < 2:
        raise UsageError(f"{bench.path}: all points have the same {over}; nothing can be drawn over it")
    rates = [convergence_rate(x[c.points], e[c.points]) for c, e in zip(curves, values)]
    algebraic = [rate.kind == "algebraic" for rate in rates if rate]
    with style.look():
        fig, ax = _picture(len(curves))
        for i, (curve, error, rate) in enumerate(zip(curves, values, rates)):
            points = curve.points[np.isfinite(error[curve.points])]
            look = _curve_look(i)
            label = f"{curve.label}: {rate.text(_symbol(over))}" if rate else curve.label
            ax.plot(x[points], error[points], label=label, **look)
            _hollow(ax, bench, points, x, error, look)
            if rate:
                _draw_rate(ax, x[curve.points][rate.points], rate, look["color"])
        ax.set_yscale("log")
        _number_axis(ax, x, is_logarithmic=bool(algebraic) and 2 * sum(algebraic) >= len(algebraic))
        ax.set_xlabel(_axis(bench, over))
        ax.set_ylabel("Relative rms error")
        _finish(fig, ax, bench, f"Error over {over.split('%')[-1]}", "thin lines: fitted rates, over the points that they span")
    return fig, list(zip(curves, rates))


def draw_cost(bench: Bench, *, part: str = "total", over: str = "n_unknowns"):
    """(figure, [(curve, exponent or None)]): wall time over the number of unknowns, with the observed exponents."""
    x = bench.column(over).astype(float)
    middle, least, most = (
        np.where(bench.is_solved, bench.column(f"bench_{part}_seconds{end}"), np.nan) for end in ("", "_min", "_max")
    )
    curves = [c for c in bench.curves(bench.varying()) if np.isfinite(middle[c.points]).any()]
    if not curves:
        raise UsageError(f"{bench.path}: no point is solved")
    exponents = [cost_exponent(x[c.points], middle[c.points]) for c in curves]
    with style.look():
        fig, ax = _picture(len(curves))
        for i, (curve, exponent) in enumerate(zip(curves, exponents)):
            points = curve.points[np.isfinite(middle[curve.points])]
            look = _curve_look(i)
            ax.errorbar(
                x[points],
                middle[points],
                yerr=[middle[points] - least[points], most[points] - middle[points]],
                capsize=2.0,
                elinewidth=0.8,
                label=f"{curve.label}: {exponent.text(_symbol(over))}" if exponent else curve.label,
                **look,
            )
            _hollow(ax, bench, points, x, middle, look)
            if exponent:
                _draw_rate(ax, x[curve.points][exponent.points], exponent, look["color"])
        ax.set(xscale="log", yscale="log")
        ax.set_xlabel(_axis(bench, over))
        ax.set_ylabel(style.with_unit(PARTS[part], "s"))
        _finish(fig, ax, bench, "Cost", "thin lines: powers fitted to the larger half, over the points that they span")
    return fig, list(zip(curves, exponents))


# Parts of the pictures


def _drawable(bench: Bench, over: str, errors: Errors) -> tuple[list[Curve], list[np.ndarray]]:
    """Curves with at least one error, each with the errors of all points; improved ones after the original ones."""
    if errors.improved is not None and not np.isfinite(errors.improved).any():
        raise UsageError(f"{bench.path}: no point has an improved motion; it needs &error_estimate improvement_steps")
    curves, values = [], []
    for curve in bench.curves(over):
        if np.isfinite(errors.plain[curve.points]).any():
            curves.append(curve)
            values.append(errors.plain)
        if errors.improved is not None and np.isfinite(errors.improved[curve.points]).any():
            curves.append(Curve(f"{curve.label}, improved", curve.points))
            values.append(errors.improved)
    if not curves:
        raise UsageError(f"{bench.path}: no point has an error; is only the reference solved?")
    return curves, values


def _symbol(over: str) -> str:
    return _SYMBOLS.get(over.split("%")[-1], "x")


def _axis(bench: Bench, over: str) -> str:
    return _AXES.get(over.split("%")[-1], bench.axis(over))


def _picture(n_curves: int):
    fig = style.figure(7.0, 4.3 + 0.17 * max(0, n_curves - 6))
    return fig, fig.add_subplot()


def _curve_look(i: int) -> dict:
    """Later curves have smaller marks and thinner lines, so that coinciding curves are all visible."""
    n = len(style.COLOURS)
    return {
        "color": style.COLOURS[i % n],
        "marker": style.MARKERS[i % n],
        "markersize": max(3.0, 6.4 - 1.1 * i),
        "linewidth": max(0.8, 2.6 - 0.5 * i),
    }


def _hollow(ax, bench: Bench, points, x, y, look) -> None:
    """White centre for solved points that exceed a threshold of the error estimate."""
    missed = points[~bench.is_converged[points]]
    ax.plot(
        x[missed], y[missed], linestyle="none", marker=look["marker"], markersize=look["markersize"], zorder=4,
        color=look["color"], markerfacecolor="white",
    )  # fmt: skip


def _mark_ends(ax, over: str, bench: Bench, points, x, y) -> None:
    """Order (or samples) at both ends of a curve."""
    numbers = bench.column(over)
    for point in {*points[:1].tolist(), *points[-1:].tolist()}:
        ax.annotate(
            f"{numbers[point]:.0f}", (x[point], y[point]), (4, 4), textcoords="offset points", size=7.0, color=style.MUTED
        )


def _draw_rate(ax, x, rate: Rate, colour) -> None:
    line = np.geomspace(x.min(), x.max(), 50)
    ax.plot(line, rate(line), color=colour, linewidth=0.7, alpha=0.8, zorder=1)


def _number_axis(ax, x, is_logarithmic: bool) -> None:
    """Ticks at the numbers themselves, as many as fit."""
    numbers = np.unique(x[np.isfinite(x)])
    if is_logarithmic:
        ax.set_xscale("log")
    low, high = numbers[0], numbers[-1]
    scale = np.log if is_logarithmic else np.asarray
    span = max(float(scale(high) - scale(low)), 1e-12)
    shown = []
    for number in numbers[::-1]:
        if not shown or float(scale(shown[-1]) - scale(number)) > 0.045 * span:
            shown.append(number)
    ax.xaxis.set_major_locator(FixedLocator(sorted(shown)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f}"))


def _bare(label: str) -> str:
    """A label without the commands of mathtext, approximately as long as in the picture."""
    return re.sub(r"\\\w+|[${}^,\\]", "", label)


def _finish(fig, ax, bench: Bench, title: str, *details: str) -> None:
    for axis in (ax.xaxis, ax.yaxis):
        if axis.get_scale() == "log" and not isinstance(axis.get_major_locator(), FixedLocator):
            style.decade_axis(axis, axis.get_view_interval())
    ax.grid(True)
    labels = [_bare(label) for label in ax.get_legend_handles_labels()[1]]
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=style.legend_columns(labels, fig.get_figwidth()),
        borderaxespad=0.3,
        columnspacing=1.4,
    )
    lost = bench.n_points - int(bench.is_solved.sum())
    notes = [*details]
    if (bench.is_solved & ~bench.is_converged).any():
        notes.append("hollow: solved, but missing a threshold of the error estimate")
    if lost:
        notes.append(f"{lost} of {bench.n_points} points not solved")
    head = f"{title}: {bench.title}" if bench.title else title
    style.head(fig, head, "; ".join(notes))
