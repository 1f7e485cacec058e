"""Plots of datasets in a notebook; nhbm-post draws result files with many more choices."""

from __future__ import annotations

import numpy as np
import xarray as xr

_MARKS = {3: ("fold", "s"), 4: ("peak", "^"), 7: ("branch", "x"), 8: ("flip", "D"), 9: ("torus", "P"), 10: ("split", "v"), 11: ("graze", "|")}


def plot(data: xr.Dataset, dof: str | None = None, ax=None):
    """The motion of a degree of freedom (that which moves most) over time, or its largest value over the points; returns the axes."""
    import matplotlib.pyplot as plt

    size = np.abs(data["coefficients"]).sum(["harmonic", "component"])
    if "point" in data.dims:
        size = size.sum("point")
    dof = dof or str(data["dof"].values[int(size.argmax("dof"))])
    if ax is None:
        _, ax = plt.subplots(figsize=(7.0, 4.0), layout="constrained")
    if "point" in data.dims:
        _over_points(ax, data, dof)
    else:
        _over_time(ax, data, dof)
    ax.grid(color="0.9")
    return ax


def _unit(data) -> str:
    return data["coefficients"].attrs.get("units", "m")


def _over_time(ax, data, dof) -> None:
    frequency = data["frequency"].values
    length = 2 * np.pi / frequency.min() * (2 if len(frequency) == 1 else 8)
    times = np.linspace(0.0, length, 2000)
    ax.plot(times, data.nhbm.time(dof, times), color="C0", lw=1.2)
    ax.set(xlabel="Time t [s]", ylabel=f"Displacement {dof} [{_unit(data)}]", xlim=(0.0, length))


def _over_points(ax, data, dof) -> None:
    name = (data.attrs.get("varies") or ["point"])[-1]
    x, y, stable = data[name].values, data.nhbm.largest(dof).values, data["is_stable"].values
    order = np.argsort(data["curve_length"].values) if "curve_length" in data else np.arange(len(x))
    x, y, stable = x[order], y[order], stable[order]
    for verdict, style, label in ((1, "-", "stable"), (-1, "--", "unstable"), (0, ":", "stability not known")):
        held = stable == verdict
        held[:-1] |= held[1:] & (stable[:-1] != 1)  # up to the point where it changes
        if (stable == verdict).any():
            ax.plot(x, np.where(held, y, np.nan), style, color="C0", lw=1.4, label=label)
    if "curve_kind" in data:
        kinds = data["curve_kind"].values[order]
        for kind, (word, mark) in _MARKS.items():
            if (kinds == kind).any():
                ax.plot(x[kinds == kind], y[kinds == kind], mark, color="C3", ms=6, mfc="none", label=word, ls="none")
    unit = data[name].attrs.get("units", "")
    ax.set(xlabel=data[name].attrs.get("parameter", name) + (f" [{unit}]" if unit else ""), ylabel=f"Largest |{dof}| [{_unit(data)}]")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
