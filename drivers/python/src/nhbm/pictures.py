"""Plots of datasets in a notebook; nhbm-post draws result files with many more choices."""

from __future__ import annotations

import re
import textwrap
from typing import Any

import numpy as np
import xarray as xr

from nhbm.dataset import check_motion, varies_of
from nhbm.errors import ModelError, imported
from nhbm.located import MARKERS, located_kinds

_VERDICTS = ("stable", "-", "stable"), ("unstable", "--", "unstable"), ("unknown", ":", "stability not known")
_MOST_LINES = 10  # of one picture with a legend; more have a scale of colours
_LEGEND_WIDTH, _HANDLE_WIDTH = 72, 7  # characters
_SAMPLES, _MOST_SAMPLES = 12, 200_000  # of the fastest harmonic in a period, of a picture over time


def plot(data: xr.Dataset, of: str | None = None, ax: Any = None) -> Any:
    """The motion of a degree of freedom over time, or a response over the points: "max x1" the largest |x1|, "x1" the root mean
    square, "x1 (1)" the amplitude of a harmonic. Without `of` the largest of that which moves most. Returns the axes."""
    plt = imported("matplotlib.pyplot", "plots are drawn with")
    if ax is None:
        _, ax = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    elif not hasattr(ax, "plot"):
        raise ModelError(f"ax needs the axes of matplotlib to plot into, not {ax!r}; a plot shows one response, further ones into "
                         "its axes: plot('max x2', ax=dataset.nhbm.plot('max x1'))")  # fmt: skip
    if "coefficients" not in data:
        _numbers(ax, data, of)
    elif "point" in data.dims:
        _over_points(ax, data, of or f"max {most_of(data)}")
    else:
        _over_time(ax, data, of or most_of(data))
    ax.grid(color="0.9")
    ax.set_axisbelow(True)
    return ax


def most_of(data: xr.Dataset) -> str:
    """The degree of freedom that moves most; rotations are not compared with displacements."""
    sizes = abs(data["coefficients"].fillna(0.0)).sum([axis for axis in data["coefficients"].dims if axis != "dof"]).values
    lengths = np.array([data.nhbm.unit_of(str(dof)) == "m" for dof in data["dof"].values])
    return str(data["dof"].values[int(np.where(lengths | ~lengths.any(), sizes, -1.0).argmax())])


def _labelled(name: str, values: xr.DataArray) -> str:
    """Name and unit of an axis."""
    unit = re.sub(r"(?<=[A-Za-z])(\d)", lambda digit: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(digit[1])], str(values.attrs.get("units", "1")))
    unit = "" if unit == "1" else unit
    words = str(values.attrs.get("long_name", values.attrs.get("parameter", name)))
    return words + (f" [{unit}]" if unit else "")


def _over_time(ax: Any, data: xr.Dataset, dof: str) -> None:
    ax.set(xlabel="Time $t$ [s]", ylabel=f"Displacement {dof} [{data.nhbm.unit_of(dof)}]")
    if "displacement" in data:  # a record of time integration
        ax.plot(data["time"], data["displacement"].sel(dof=dof), color="C0", lw=1.2)
        return
    frequency = data["frequency"].values
    length = 2 * np.pi / frequency.min() * (2 if len(frequency) == 1 else 8)
    fastest = float(abs((data.nhbm._tuples() * data["frequency"]).sum("tone")).max())
    times = np.linspace(0.0, length, int(np.clip(_SAMPLES * fastest * length / (2 * np.pi), 2000, _MOST_SAMPLES)))
    ax.plot(times, data.nhbm.time(dof, times), color="C0", lw=1.2)
    ax.set(xlim=(0.0, length))


def _over_points(ax: Any, data: xr.Dataset, of: str) -> None:
    """Lines over what varies last: one for each branch of a curve, or for each of the other values of a sweep."""
    *others, name = varies_of(data) or ["point"]
    y = data.nhbm.response(of)
    if "curve_branch" in data:
        others = ["curve_branch"]
    groups, heading = [("", np.arange(data.sizes["point"]))], ""
    if others:
        rows, group = np.unique(np.stack([data[other].values for other in others], axis=1), axis=0, return_inverse=True)
        names = [", ".join(f"{value:.4g}" if isinstance(value, float) else str(value) for value in row) for row in rows.tolist()]
        groups = [(names[k], np.flatnonzero(group.ravel() == k)) for k in range(len(rows))]
        heading = ", ".join(_labelled(other, data[other]) for other in others)
    is_curve = "curve_branch" in data
    n_before = len({line.get_color() for line in ax.get_lines() if line.get_linestyle() != "None"})  # other results on these axes
    color_of: Any = [f"C{n_before + k}" for k in range(len(groups))].__getitem__
    if len(groups) > _MOST_LINES and not is_curve:
        color_of = _scale_of_colors(ax, rows, heading)
    kinds = located_kinds(data["curve_kind"].attrs) if "curve_kind" in data else {}
    drawn = set()
    for k, (title, points) in enumerate(groups):
        if is_curve:
            points = points[np.argsort(data["curve_length"].values[points], kind="stable")]
        color = color_of(0 if is_curve else k)
        stable = data["stability"].values[points]
        if is_curve:  # at a bifurcation itself a multiplier is on the unit circle
            located = (stable == "unknown") & np.isin(data["curve_kind"].values[points], list(kinds))
            stable = np.where(located, np.roll(stable, 1), stable)
        for verdict, style, word in _VERDICTS:
            held = stable == verdict
            if not held.any():
                continue
            held[:-1] |= held[1:] & (stable[:-1] != "stable")  # from the point where it changes
            text = word if word not in drawn and (is_curve or len(groups) == 1) else None
            if title and not is_curve and len(groups) <= _MOST_LINES and title not in drawn:
                text = title
            drawn |= {word, title}
            ax.plot(data[name].values[points], np.where(held, y.values[points], np.nan), style, color=color, lw=1.4, label=text)
    for kind, look in kinds.items():
        here = np.flatnonzero(data["curve_kind"].values == kind)
        if len(here):
            mark = MARKERS.get(look.mark, "o")
            ax.plot(data[name].values[here], y.values[here], mark, color="C3", ms=6, mfc="none", label=look.label, ls="none")
    ax.set(xlabel=_labelled(name, data[name]), ylabel=_labelled(of, y))
    labels = ax.get_legend_handles_labels()[1]
    if labels:
        above = textwrap.fill(heading, _LEGEND_WIDTH) if len(groups) > 1 and not is_curve else None
        ax.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=_columns_for(labels), borderaxespad=0.3,
                  title=above, alignment="left")  # fmt: skip


def _columns_for(labels: list[str]) -> int:
    """The most columns of a legend that are not wider than its axes; it is filled column by column."""

    def width(n: int) -> int:
        n_rows = -(-len(labels) // n)
        return sum(_HANDLE_WIDTH + max(map(len, labels[k : k + n_rows])) for k in range(0, len(labels), n_rows))

    return next((n for n in range(min(5, len(labels)), 1, -1) if width(n) <= _LEGEND_WIDTH), 1)


def orbits(data: xr.Dataset, dof: str, other: str) -> Any:
    """The motions of several points, one degree of freedom over another; returns the figure."""
    if data.sizes["point"] > _MOST_LINES:
        raise ModelError(f"a picture has at most {_MOST_LINES} orbits, not {data.sizes['point']}: select some points")
    plt = imported("matplotlib.pyplot", "plots are drawn with")
    figure, ax = plt.subplots(figsize=(5.0, 4.4), layout="constrained")
    names = varies_of(data) or ["point"]
    for k in range(data.sizes["point"]):
        point = data.isel(point=k)
        check_motion(point)
        frequency = point["frequency"].values
        length = 2 * np.pi / frequency.min() * (1 if len(frequency) == 1 else 8)
        fastest = float(abs((point.nhbm._tuples() * point["frequency"]).sum("tone")).max())
        times = np.linspace(0.0, length, int(np.clip(4 * _SAMPLES * fastest * length / (2 * np.pi), 400, _MOST_SAMPLES)))
        label = ", ".join(f"{point[name].item():.6g}" for name in names)
        ax.plot(point.nhbm.time(dof, times), point.nhbm.time(other, times), color=f"C{k}", lw=1.2, label=label)
    unit, unit_of_other = (data.nhbm.unit_of(one) for one in (dof, other))
    ax.set(xlabel=f"Displacement {dof} [{unit}]", ylabel=f"Displacement {other} [{unit_of_other}]",
           aspect="equal" if unit == unit_of_other else "auto")  # fmt: skip
    ax.ticklabel_format(scilimits=(-3, 4))
    ax.locator_params(nbins=5)
    ax.grid(color="0.9")
    ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0), title=textwrap.fill(", ".join(
        _labelled(name, data[name]) for name in names), 20))  # fmt: skip
    return figure


def _scale_of_colors(ax: Any, rows: Any, label: str) -> Any:
    """The colour of each of many lines: by its value, with a scale beside the axes; by its number if several values vary."""
    matplotlib = imported("matplotlib", "plots are drawn with")
    is_number = rows.shape[1] == 1 and rows.dtype.kind in "fi"
    values = rows[:, 0] if is_number else np.arange(len(rows))
    scale = imported("matplotlib.cm", "plots are drawn with").ScalarMappable(
        matplotlib.colors.Normalize(values.min(), values.max()), "viridis"
    )
    ax.figure.colorbar(scale, ax=ax, label=label if is_number else f"Number of the line, by {label}")
    return lambda k: scale.to_rgba(values[k])


def _numbers(ax: Any, data: xr.Dataset, name: Any) -> None:
    """Numbers of a sweep, over its one value as a line; over several as the distribution."""
    name, varies = name or next(iter(data.data_vars)), varies_of(data)
    if name not in data.data_vars:
        raise ModelError(f"this dataset has numbers, not motions: {', '.join(map(str, data.data_vars))}")
    if len(varies) == 1:
        ax.plot(data[varies[0]], data[name], ".-", lw=1.2)
        ax.set(xlabel=_labelled(varies[0], data[varies[0]]), ylabel=_labelled(name, data[name]))
    else:
        ax.hist(data[name].values, bins="auto", color="C0", edgecolor="white")
        ax.set(xlabel=_labelled(name, data[name]), ylabel="Number of samples")
