"""What a benchmark found: error over time, error over order with its rate, cost over unknowns with its exponent."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from ..benchmark import Benchmark, Curve, Rate, convergence_rate, cost_exponent
from ..errors import UsageError
from . import style

# Parts of the wall time that can stand on an axis.
PARTS = {
    "total": "wall time without certificate",
    "cpu": "processor time without certificate",
    "setup": "wall time of the set-up",
    "solver": "wall time of the iterations",
    "certificate": "wall time of the certificate",
}
_SYMBOLS = {"order": "N", "samples": "n"}
_AXES = {"order": "order $N$ of the series", "samples": "samples $n$ per tone"}


def draw_work_precision(benchmark: Benchmark, *, part: str = "total", has_improved: bool = False):
    """Error over wall time (median of the repeats, bars from least to most), one curve for each method and formulation."""
    over = benchmark.varying()
    middle, least, most = (benchmark.column(f"{part}_seconds{end}") for end in ("", "_min", "_max"))
    curves, errors = _drawable(benchmark, over, has_improved)
    with style.look():
        fig, ax = _picture(len(curves))
        for i, (curve, error) in enumerate(zip(curves, errors)):
            rungs = curve.rungs[np.isfinite(error[curve.rungs])]
            look = _curve_look(i)
            ax.errorbar(
                middle[rungs],
                error[rungs],
                xerr=[middle[rungs] - least[rungs], most[rungs] - middle[rungs]],
                capsize=2.0,
                elinewidth=0.8,
                label=curve.label,
                **look,
            )
            _hollow(ax, benchmark, rungs, middle, error, look)
            _mark_ends(ax, over, benchmark, rungs, middle, error)
        ax.set(xscale="log", yscale="log")
        ax.set_xlabel(style.with_unit(PARTS[part], "s"))
        ax.set_ylabel("relative rms error")
        _finish(fig, ax, benchmark, "Error over time", f"along each curve: {_AXES[over].replace('$', '')}")
    return fig


def draw_convergence(benchmark: Benchmark, *, over: str = "", has_improved: bool = False):
    """(figure, [(curve, rate or None)]): error over the order, or over the samples, with the observed rates."""
    over = over or benchmark.varying()
    x = benchmark.x_of(over)
    curves, errors = _drawable(benchmark, over, has_improved)
    if max(len(set(x[c.rungs].tolist())) for c in curves) < 2:
        raise UsageError(f"{benchmark.path}: all rungs have the same {over}; nothing can be drawn over it")
    rates = [convergence_rate(x[c.rungs], e[c.rungs]) for c, e in zip(curves, errors)]
    algebraic = [rate.kind == "algebraic" for rate in rates if rate]
    with style.look():
        fig, ax = _picture(len(curves))
        for i, (curve, error, rate) in enumerate(zip(curves, errors, rates)):
            rungs = curve.rungs[np.isfinite(error[curve.rungs])]
            look = _curve_look(i)
            label = f"{curve.label}: {rate.text(_SYMBOLS[over])}" if rate else curve.label
            ax.plot(x[rungs], error[rungs], label=label, **look)
            _hollow(ax, benchmark, rungs, x, error, look)
            if rate:
                _draw_rate(ax, x[curve.rungs][rate.points], rate, look["color"])
        ax.set_yscale("log")
        _number_axis(ax, x, is_logarithmic=bool(algebraic) and 2 * sum(algebraic) >= len(algebraic))
        ax.set_xlabel(_AXES[over])
        ax.set_ylabel("relative rms error")
        _finish(fig, ax, benchmark, f"Error over {over}", "thin lines: fitted rates, over the points that they span")
    return fig, list(zip(curves, rates))


def draw_cost(benchmark: Benchmark, *, part: str = "total"):
    """(figure, [(curve, exponent or None)]): wall time over the number of unknowns, with the observed exponents."""
    over = benchmark.varying()
    x = benchmark.x_of("unknowns") if over == "order" else benchmark.size_of_sampling().astype(float)
    symbol = "n" if over == "order" else "m"
    middle, least, most = (
        np.where(benchmark.is_solved, benchmark.column(f"{part}_seconds{end}"), np.nan) for end in ("", "_min", "_max")
    )
    curves = [c for c in benchmark.curves(over) if np.isfinite(middle[c.rungs]).any()]
    if not curves:
        raise UsageError(f"{benchmark.path}: no rung is solved")
    exponents = [cost_exponent(x[c.rungs], middle[c.rungs]) for c in curves]
    with style.look():
        fig, ax = _picture(len(curves))
        for i, (curve, exponent) in enumerate(zip(curves, exponents)):
            rungs = curve.rungs[np.isfinite(middle[curve.rungs])]
            look = _curve_look(i)
            ax.errorbar(
                x[rungs],
                middle[rungs],
                yerr=[middle[rungs] - least[rungs], most[rungs] - middle[rungs]],
                capsize=2.0,
                elinewidth=0.8,
                label=f"{curve.label}: {exponent.text(symbol)}" if exponent else curve.label,
                **look,
            )
            _hollow(ax, benchmark, rungs, x, middle, look)
            if exponent:
                _draw_rate(ax, x[curve.rungs][exponent.points], exponent, look["color"])
        ax.set(xscale="log", yscale="log")
        ax.set_xlabel("number of unknowns $n$" if over == "order" else "samples on the torus $m$")
        ax.set_ylabel(style.with_unit(PARTS[part], "s"))
        _finish(fig, ax, benchmark, "Cost", "thin lines: powers fitted to the larger half, over the points that they span")
    return fig, list(zip(curves, exponents))


# Parts of the pictures


def _drawable(benchmark: Benchmark, over: str, has_improved: bool) -> tuple[list[Curve], list[np.ndarray]]:
    """Curves that have an error somewhere, each with the errors of all rungs; improved ones after those that they belong to."""
    plain = benchmark.error()
    improved = benchmark.error("improved_error") if has_improved else None
    if has_improved and not np.isfinite(improved).any():
        raise UsageError(f"{benchmark.path}: no rung has an improved motion; it needs &certificate improvement_steps")
    curves, errors = [], []
    for curve in benchmark.curves(over):
        if np.isfinite(plain[curve.rungs]).any():
            curves.append(curve)
            errors.append(plain)
        if improved is not None and np.isfinite(improved[curve.rungs]).any():
            curves.append(Curve(f"{curve.label}, improved", curve.rungs))
            errors.append(improved)
    if not curves:
        raise UsageError(f"{benchmark.path}: no rung has an error; is only the reference solved?")
    return curves, errors


def _picture(n_curves: int):
    fig = style.figure(7.0, 4.3 + 0.17 * max(0, n_curves - 6))
    return fig, fig.add_subplot()


def _curve_look(i: int) -> dict:
    """Later curves have smaller marks and gaps in their lines, so that one shows through another that lies upon it."""
    n = len(style.COLOURS)
    return {
        "color": style.COLOURS[i % n],
        "marker": style.MARKERS[i % n],
        "linestyle": style.DASHES[i % n],
        "markersize": max(3.0, 6.4 - 1.1 * i),
        "linewidth": 1.3,
    }


def _hollow(ax, benchmark: Benchmark, rungs, x, y, look) -> None:
    """White inside for solved rungs that miss a threshold of the certificate."""
    missed = rungs[~benchmark.is_converged[rungs]]
    ax.plot(
        x[missed], y[missed], linestyle="none", marker=look["marker"], markersize=look["markersize"], zorder=4,
        color=look["color"], markerfacecolor="white",
    )  # fmt: skip


def _mark_ends(ax, over: str, benchmark: Benchmark, rungs, x, y) -> None:
    """Order (or samples) at both ends of a curve."""
    numbers = benchmark.x_of(over)
    for rung in {*rungs[:1].tolist(), *rungs[-1:].tolist()}:
        ax.annotate(
            f"{numbers[rung]:.0f}", (x[rung], y[rung]), (4, 4), textcoords="offset points", size=7.0, color=style.MUTED
        )


def _draw_rate(ax, x, rate: Rate, colour) -> None:
    line = np.geomspace(x.min(), x.max(), 50)
    ax.plot(line, rate(line), color=colour, linewidth=0.7, alpha=0.8, zorder=1)


def _number_axis(ax, x, is_logarithmic: bool) -> None:
    """Ticks at the numbers themselves, as many as there is room for."""
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


def _decade_axis(axis, limits) -> None:
    """Labels at the decades, and at 2 and 5 of each where there are few."""
    decades = np.log10(limits[1] / limits[0])
    if decades > 2.5:
        axis.set_major_locator(LogLocator(base=10.0, numticks=12))
        axis.set_minor_formatter(NullFormatter())
        return
    axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(_short))
    axis.set_minor_formatter(NullFormatter())


def _short(value: float, _=None) -> str:
    power = int(np.floor(np.log10(value) + 1e-9))
    if -2 <= power <= 3:
        return f"{value:g}"
    digit = f"{value / 10.0**power:.0f}"
    return rf"$10^{{{power}}}$" if digit == "1" else rf"${digit}\cdot 10^{{{power}}}$"


def _bare(label: str) -> str:
    """A label without the commands of mathtext, about as long as it is drawn."""
    return re.sub(r"\\\w+|[${}^,\\]", "", label)


def _finish(fig, ax, benchmark: Benchmark, title: str, *details: str) -> None:
    for axis in (ax.xaxis, ax.yaxis):
        if axis.get_scale() == "log" and not isinstance(axis.get_major_locator(), FixedLocator):
            _decade_axis(axis, axis.get_view_interval())
    ax.grid(True)
    labels = [_bare(label) for label in ax.get_legend_handles_labels()[1]]
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=style.legend_columns(labels, fig.get_figwidth()),
        borderaxespad=0.3,
        columnspacing=1.4,
    )
    lost = benchmark.n_rungs - int(benchmark.is_solved.sum())
    notes = [*details]
    if (benchmark.is_solved & ~benchmark.is_converged).any():
        notes.append("hollow: solved, but missing a threshold of the certificate")
    if lost:
        notes.append(f"{lost} of {benchmark.n_rungs} rungs not solved")
    head = f"{title}: {benchmark.title}" if benchmark.title else title
    style.head(fig, head, "; ".join(notes))
