"""Response curves of a sweep: one measure of the motion over a swept parameter."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from ..errors import UsageError
from ..reader import CONVERGED, PENDING, QUANTITIES, Parameter, Results
from ..text import list_text, tuple_text
from . import style

MEASURES = ("peak", "rms", "harmonic")


def measure_values(results: Results, dof: str, quantity: str, measure: str, j=None) -> np.ndarray:
    """The measure at every point, NaN at those that have not converged or do not have the tuple `j`."""
    values = np.full(results.n_points, np.nan)
    for point, series in results.all_series(dof, quantity):
        if measure == "harmonic":
            try:
                values[point] = np.hypot(*series.harmonic(j))
            except KeyError:
                continue
        else:
            values[point] = series.rms if measure == "rms" else series.peak()
    return values


def draw_response(
    results: Results,
    dof: str | None = None,
    *,
    quantity: str = "motion",
    measure: str = "peak",
    j=None,
    over: str | None = None,
    at=None,
):
    """Curves of `measure` (`peak`, `rms`, or `harmonic` with its tuple `j`) over the parameter `over`.

    Further swept parameters make several curves; `at` keeps only points with given values. A curve is
    broken where a point has not converged; such points stand as hollow red marks on the axis.
    """
    dof = results.default_dof(quantity) if dof is None else dof
    points = np.array(results.select(at) if at else range(results.n_points), dtype=int)
    swept = _swept_parameter(results, over, points)
    others = [
        p
        for p in results.parameters.values()
        if p is not swept and len({str(v) for v in p.values[points]}) > 1 and not _goes_along(p, swept, points)
    ]
    values = measure_values(results, dof, quantity, measure, j)
    if not np.isfinite(values[points]).any():
        if measure == "harmonic" and (results.status[points] == CONVERGED).any():
            raise UsageError(f"{results.path}: tuple {tuple_text(j)} is in the set of no converged point")
        counts = list_text([f"{n} {name}" for name, n in results.status_counts().items()])
        raise UsageError(f"{results.path}: none of the chosen points has converged; in the file: {counts}")

    x_factor, x_units = 1.0, swept.units
    if swept.is_number:
        x_factor, x_units = style.unit_scale(np.nanmax(np.abs(swept.values[points])), swept.units)
    x = x_factor * _positions(swept)
    factor, units = style.unit_scale(np.nanmax(values[points]), results.units(quantity, dof))
    what, symbol = _words(measure, QUANTITIES[quantity].symbol.format(dof), j)
    groups = _groups(others, points)
    with style.look():
        fig = style.figure(7.0, 4.4)
        ax = fig.add_subplot()
        is_ramp = len(groups) > len(style.COLOURS) and len(others) == 1 and others[0].is_number
        ramp = Normalize(min(g[0][0] for g in groups), max(g[0][0] for g in groups)) if is_ramp else None
        for i, (key, members) in enumerate(groups):
            members = members[np.argsort(x[members], kind="stable")]
            look = _curve_look(i, ramp, key) | ({} if swept.is_number else {"linestyle": "none"})
            label = ", ".join(p.text(int(members[0])) for p in others) or "converged"
            ax.plot(
                x[members],
                factor * values[members],
                markersize=3.6,
                linewidth=1.2,
                label=None if is_ramp else label,
                **look,
            )
        ax.set_xlabel(style.with_unit(_axis_words(swept), x_units))
        ax.set_ylabel(style.with_unit(symbol, units))
        ax.set_ylim(0.0, 1.06 * factor * np.nanmax(values[points]) or 1.0)
        ax.margins(x=0.03)
        ax.grid(True)
        if not swept.is_number:
            ax.set_xticks(range(len(_categories(swept))), _categories(swept))
        elif _is_logarithmic(x[points]):
            ax.set_xscale("log")
        if is_ramp:
            fig.colorbar(
                ScalarMappable(ramp, style.COLOUR_MAP),
                ax=ax,
                label=style.with_unit(others[0].name, others[0].units),
            )
        _mark_unsolved(ax, results, points, x, values, measure)
        handles, _ = ax.get_legend_handles_labels()
        if len(handles) > 1 or (is_ramp and handles):
            ax.legend(
                loc="lower left",
                bbox_to_anchor=(0.0, 1.0),
                ncol=style.legend_columns([h.get_label() for h in handles], fig.get_figwidth()),
                borderaxespad=0.3,
                columnspacing=1.4,
            )
        chosen = ", ".join(f"{key} = {value}" for key, value in (at or {}).items())
        style.head(
            fig, f"{what} over {_axis_words(swept)}", ", ".join(t for t in (results.title, chosen) if t)
        )
    return fig


def _swept_parameter(results: Results, over: str | None, points: np.ndarray) -> Parameter:
    """The parameter of the x axis: as named, else the number (else the word) that takes most values."""
    if over is not None:
        return results.parameter(over)
    several = [p for p in results.parameters.values() if len({str(v) for v in p.values[points]}) > 1]
    if several:
        return max(several, key=lambda p: (p.is_number, len(set(p.values[points].tolist()))))
    raise UsageError(
        f"{results.path}: no parameter changes over the chosen {len(points)} point(s); "
        f"a response needs a sweep (swept: {list_text(list(results.parameters))})"
    )


def _goes_along(other: Parameter, swept: Parameter, points: np.ndarray) -> bool:
    """Whether each value of `swept` comes with one value of `other`: parameters zipped on one axis of a sweep."""
    pairs = {(str(swept.values[point]), str(other.values[point])) for point in points}
    return len(pairs) == len({value for value, _ in pairs})


def _groups(others: list[Parameter], points: np.ndarray) -> list[tuple[tuple, np.ndarray]]:
    """Points by the values of the other swept parameters, in ascending order of the values."""
    keys = [tuple(p.values[point] for p in others) for point in points]
    found = sorted(set(keys))
    return [
        (key, np.array([point for point, k in zip(points, keys) if k == key], dtype=int)) for key in found
    ]


def _curve_look(i: int, ramp, key) -> dict:
    if ramp is not None:
        colour = colormaps[style.COLOUR_MAP](0.95 * ramp(key[0]))
        return {"color": colour, "marker": "o", "linestyle": "-"}
    n, turn = len(style.COLOURS), i // len(style.COLOURS)
    return {
        "color": style.COLOURS[i % n],
        "marker": style.MARKERS[(i + turn) % n],
        "linestyle": style.DASHES[turn % len(style.DASHES)],
    }


def _mark_unsolved(ax, results: Results, points, x, values, measure) -> None:
    """Marks on the axis the points without a result and counts them in the legend, by status."""
    is_pending = results.status[points] == PENDING
    is_unsolved = (results.status[points] != CONVERGED) & ~is_pending
    without_tuple = int(((results.status[points] == CONVERGED) & np.isnan(values[points])).sum())
    on_axis = dict(
        linestyle="none",
        marker="o",
        clip_on=False,
        zorder=5,
        transform=ax.get_xaxis_transform(),
        fillstyle="none",
    )
    if is_unsolved.any():
        names = [results.status_name(p) for p in points[is_unsolved]]
        counts = ", ".join(f"{len(list(g))} {name}" for name, g in itertools.groupby(sorted(names)))
        ax.plot(
            x[points[is_unsolved]],
            np.zeros(is_unsolved.sum()),
            color=style.FAILURE,
            markersize=6.5,
            markeredgewidth=1.3,
            label=f"not converged: {is_unsolved.sum()} of {len(points)} ({counts})",
            **on_axis,
        )
    if is_pending.any():
        on_axis["marker"] = "s"
        ax.plot(
            x[points[is_pending]],
            np.zeros(is_pending.sum()),
            color=style.WALL,
            markersize=5.5,
            markeredgewidth=1.2,
            label=f"not solved yet: {is_pending.sum()} of {len(points)}",
            **on_axis,
        )
    if without_tuple:
        ax.plot([], [], linestyle="none", label=f"{without_tuple} converged without this harmonic")


def _words(measure: str, dof: str, j) -> tuple[str, str]:
    """(what is shown, axis label) of a measure."""
    if measure == "harmonic":
        return f"Amplitude of harmonic {tuple_text(j)} of {dof}", rf"$|c_{{{tuple_text(j)}}}|$ of {dof}"
    if measure == "rms":
        return f"Root mean square of {dof}", f"rms of {dof}"
    return f"Peak of {dof}", rf"$\max\,|\,${dof}$\,|$ over hypertime"


def _axis_words(parameter: Parameter) -> str:
    return parameter.path or parameter.name


def _categories(parameter: Parameter) -> list[str]:
    return list(dict.fromkeys(parameter.values))


def _positions(parameter: Parameter) -> np.ndarray:
    """Place of each point on the x axis: the value, or the number of the word in order of appearance."""
    if parameter.is_number:
        return parameter.values
    order = {word: i for i, word in enumerate(_categories(parameter))}
    return np.array([float(order[word]) for word in parameter.values])


def _is_logarithmic(x: np.ndarray) -> bool:
    """Whether a sweep runs over two decades or more in about equal ratios."""
    x = np.unique(x[np.isfinite(x)])
    if len(x) < 3 or x[0] <= 0.0 or x[-1] < 99.0 * x[0]:
        return False
    ratios = np.diff(np.log(x))
    return bool(ratios.max() < 3.0 * ratios.min())
