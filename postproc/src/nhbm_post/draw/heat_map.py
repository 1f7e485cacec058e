"""A measure of the motion over two swept parameters, as a map."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.patches import Patch, PathPatch

from ..axis_words import axis_words, with_symbol
from ..errors import UsageError
from ..measure import Measure
from ..outcome import NAMES, PENDING, SOLVED
from ..parameter import Parameter
from ..reader import Results
from ..text import list_text
from . import marks, style
from .response import is_logarithmic
from .spectrum import cells_outline

_UNSTABLE = "////"
_OUTSIDE = "#e4e6ea"
_UNSOLVED = "#ffffff"


def draw_map(
    results: Results,
    dof: str | None = None,
    *,
    measure: Measure | None = None,
    over: tuple[str, str] | None = None,
    where=None,
    logarithmic: str | None = None,
):
    """`measure` over two swept parameters `over` (x, y), one cell per point.

    Cells of points that have not converged carry the mark of their status: solved ones on their colour, others on white. Cells of
    pending points are blank, and those that are not in the sweep grey. Further swept parameters must be fixed by `where`.
    `logarithmic`: letters of `x`, `y`, `z` (the colours), or `none`; by default x and y are logarithmic if the sweep is.
    """
    measure = measure or Measure()
    dof = results.default_dof(measure.quantity) if dof is None else dof
    points = np.array(results.select(where) if where else range(results.n_points), dtype=int)
    axes = tuple(results.shown(axis) for axis in _axes(results, over, points))
    values = measure.values(results, dof)
    grids = [np.unique(axis.values[points]) if axis.is_number else np.array(_words(axis, points)) for axis in axes]
    indices = [_indices(axis, grid, points) for axis, grid in zip(axes, grids)]
    number = np.full((grids[1].size, grids[0].size), -1)
    number[indices[1], indices[0]] = points
    if (number >= 0).sum() < points.size:
        others = [p.label for p in results.parameters.values() if p.name not in {a.name for a in axes} and _varies(p, points)]
        raise UsageError(
            f"{results.path}: {points.size} points share {int((number >= 0).sum())} cells of {axes[0].label} and "
            f"{axes[1].label}; fix {list_text(others) if others else 'more'} by --where"
        )
    if min(number.shape) < 2 or (number >= 0).mean() < 0.5:
        raise UsageError(
            f"{results.path}: {axes[0].label} and {axes[1].label} make no grid, {points.size} points on {number.size} cells"
        )
    is_there = number >= 0
    status = np.where(is_there, results.status[number], -1)
    cells = np.where(is_there & np.isin(status, SOLVED), values[number], np.nan)
    if not np.isfinite(cells).any():
        raise UsageError(f"{results.path}: none of the chosen points is solved; in the file: {results.outcome_text()}")
    what, symbol = measure.words(results, dof)
    factor, units = style.unit_scale(np.nanmax(np.abs(cells)), measure.units(results, dof), "z" in (logarithmic or ""))
    scales = [
        "log" if axis.is_number and (is_logarithmic(grid) if logarithmic is None else letter in logarithmic) else "linear"
        for axis, grid, letter in zip(axes, grids, "xy")
    ]
    if logarithmic == "none":
        scales = ["linear", "linear"]
    notes = []
    cells = factor * cells
    is_flat = np.nanmin(cells) == np.nanmax(cells)
    norm = Normalize(np.nanmin(cells), np.nanmax(cells))
    if logarithmic and "z" in logarithmic:
        n_lost = int((cells <= 0.0).sum())
        cells = np.where(cells > 0.0, cells, np.nan)
        if not np.isfinite(cells).any():
            raise UsageError(f"{results.path}: all values are 0: there is no logarithmic scale for them")
        norm = LogNorm(np.nanmin(cells), np.nanmax(cells))
        if n_lost:
            notes.append(f"{n_lost} cells of value 0 have no colour on a logarithmic scale")
    with style.look():
        n_pending = int((results.status[points] == PENDING).sum())
        statuses = [one for one in marks.by_status(results, points) if one[0] != NAMES[PENDING]]
        counts = {(name, is_solved): group.size for name, is_solved, group in statuses}
        handles = marks.keys(counts, {})
        if n_pending:
            handles.append(Patch(facecolor=_UNSOLVED, edgecolor=style.WALL, label=f"{n_pending} pending"))
        if (~is_there).any():
            handles.append(Patch(facecolor=_OUTSIDE, label=f"{int((~is_there).sum())} not in the sweep"))
        is_unstable = is_there & (results.stability()[number] < 0)
        if is_unstable.any():
            label = f"{int(is_unstable.sum())} unstable"
            dark = colormaps[style.COLOUR_MAP](0.25)
            handles.append(Patch(facecolor=dark, edgecolor="white", linewidth=0.0, hatch=_UNSTABLE, label=label))
        fig = style.figure(6.6, 4.8)
        (ax,) = style.below_legends(fig, [handles], 4.0)
        labels, edges = [], []
        for axis, grid, scale in zip(axes, grids, scales):
            by, unit = style.unit_scale(np.abs(grid).max(), axis.units, scale == "log") if axis.is_number else (1.0, "")
            middles = by * grid.astype(float) if axis.is_number else np.arange(grid.size, dtype=float)
            if scale == "log" and middles[0] <= 0.0:
                raise UsageError(f"{results.path}: '{axis.label}' has values of 0 or less: no logarithmic axis")
            labels.append(style.with_unit(with_symbol(*axis_words(results, axis)), unit))
            edges.append(_edges(middles, scale))
        colours = colormaps[style.COLOUR_MAP].with_extremes(bad=_UNSOLVED)
        # Very thin edges in the colour of the cell: viewers of vector graphics otherwise show seams.
        seamless = {"edgecolors": "face", "linewidth": 0.6, "rasterized": cells.size > 4000}
        shown = ax.pcolormesh(*edges, np.ma.masked_invalid(cells), norm=norm, cmap=colours, **seamless)
        bar = fig.colorbar(shown, ax=ax, label=style.with_unit(symbol, units))
        bar.outline.set_linewidth(0.5)
        if is_flat:
            bar.set_ticks([np.nanmin(cells)])
            notes.append("all values are equal")
        elif isinstance(norm, LogNorm):
            style.decade_axis(bar.ax.yaxis, (norm.vmin, norm.vmax))
        centres = [_centres(edge, scale) for edge, scale in zip(edges, scales)]
        if is_unstable.any():
            outline = cells_outline(is_unstable, *edges)
            ax.add_patch(PathPatch(outline, facecolor="none", edgecolor="white", linewidth=0.0, hatch=_UNSTABLE))
        size = float(np.clip(0.55 * 72.0 * 4.0 / max(number.shape), 1.3, 6.0))
        for name, is_solved, group in statuses:
            rows, columns = np.nonzero(np.isin(number, group))
            look = marks.mark(name, is_solved).look(size)
            ax.plot(centres[0][columns], centres[1][rows], **look, gid=name, rasterized=group.size > 4000)
        if (~is_there).any():
            ax.pcolormesh(*edges, np.ma.masked_where(is_there, np.zeros(number.shape)), cmap=ListedColormap([_OUTSIDE]))
        ax.set_xscale(scales[0])
        ax.set_yscale(scales[1])
        for axis, grid, which in zip(axes, grids, (ax.xaxis, ax.yaxis)):
            if not axis.is_number:
                which.set_ticks(range(grid.size), list(grid))
        ax.set(xlabel=labels[0], ylabel=labels[1], xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
        ax.spines[["top", "right"]].set_visible(True)
        chosen = results.where_text(where or {})
        outcome = results.answers_text(points)
        style.head(
            fig,
            f"{what} over {' and '.join(axis_words(results, axis)[0] for axis in axes)}",
            ", ".join(t for t in (results.title, chosen) if t),
            "; ".join([outcome, *notes]),
        )
    return fig


def _axes(results: Results, over, points) -> tuple[Parameter, Parameter]:
    """The two parameters of the axes: the named ones, otherwise the two with most values that do not vary together."""
    if over is not None:
        return results.parameter(over[0]), results.parameter(over[1])
    several = [p for p in results.parameters.values() if _varies(p, points)]
    several.sort(key=lambda p: (not p.is_number, -len(set(p.values[points].tolist()))))
    for first in several[:1]:
        for second in several[1:]:
            pairs = {(str(first.values[point]), str(second.values[point])) for point in points}
            if len(pairs) > max(len({a for a, _ in pairs}), len({b for _, b in pairs})):
                return first, second
    raise UsageError(
        f"{results.path}: a map needs two parameters swept on different axes; "
        f"changing over the chosen points: {list_text([p.label for p in several])}"
    )


def _varies(parameter: Parameter, points) -> bool:
    return len({str(value) for value in parameter.values[points]}) > 1


def _words(parameter: Parameter, points) -> list[str]:
    return list(dict.fromkeys(parameter.values[points]))


def _indices(parameter: Parameter, grid: np.ndarray, points) -> np.ndarray:
    """Column or row of each point."""
    if parameter.is_number:
        return np.searchsorted(grid, parameter.values[points])
    return np.array([list(grid).index(word) for word in parameter.values[points]], dtype=int)


def _edges(centres: np.ndarray, scale: str) -> np.ndarray:
    """Borders of the cells, halfway between their centres on the scale of the axis."""
    middles = np.log(centres) if scale == "log" else centres
    inner = 0.5 * (middles[1:] + middles[:-1])
    edges = np.concatenate([[2.0 * middles[0] - inner[0]], inner, [2.0 * middles[-1] - inner[-1]]])
    return np.exp(edges) if scale == "log" else edges


def _centres(edges: np.ndarray, scale: str) -> np.ndarray:
    """Centres of cells on the scale of the axis, the positions of their marks."""
    return np.sqrt(edges[1:] * edges[:-1]) if scale == "log" else 0.5 * (edges[1:] + edges[:-1])
