"""Representations of one motion: phase plane, orbit of two degrees of freedom, section of a torus, surface over hypertime."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D

from ..errors import UsageError
from ..series import Series
from . import style
from .correction import draw_level, draw_solid

_ORBIT_SAMPLES = 1200
_ORBIT_PERIODS = 40  # of the slowest of several tones
_SECTION_SAMPLES = 720
_STROBES = 2000  # of sections of three tones or more
_LEAST_SHARE = 1e-3  # of the larger displacement, for the other to have its unit
_TALLEST = 5.0  # largest ratio of the sides of a picture to scale


def orbit_times(series: Series) -> np.ndarray:
    """Times over one period, or over many of the slowest of several tones."""
    omega = np.abs(series.omega[series.omega != 0.0])
    if omega.size == 0:
        raise UsageError("a motion without a frequency has no orbit")
    is_large = series.amplitudes > 1e-3 * series.amplitudes.max(initial=0.0)
    fastest = max(float(np.abs(series.frequencies[is_large]).max(initial=0.0)), omega.max())
    periods = 1 if series.n_tones == 1 else _ORBIT_PERIODS
    duration = 2.0 * np.pi * periods / omega.min()
    n = int(np.clip(24 * duration * fastest / (2.0 * np.pi), _ORBIT_SAMPLES, 40_000))
    return np.linspace(0.0, duration, n + 1)


def section(series: tuple[Series, Series], tone: int) -> tuple[np.ndarray, np.ndarray]:
    """Both series where the phase of `tone` (from 0) is zero: a point for one tone, a closed curve for two, many points for
    more."""
    n_tones, omega = series[0].n_tones, series[0].omega
    if n_tones == 1:
        tau = np.zeros((1, 1))
    elif n_tones == 2:
        tau = np.zeros((_SECTION_SAMPLES + 1, 2))
        tau[:, 1 - tone] = np.linspace(0.0, 2.0 * np.pi, _SECTION_SAMPLES + 1)
    else:
        tau = 2.0 * np.pi * np.arange(_STROBES)[:, None] * (omega / omega[tone])
        tau[:, tone] = 0.0
    return series[0].at(tau), series[1].at(tau)


def draw_orbit(x: Series, y: Series, *, tone: int = 0, about: str = ""):
    """`y` over `x` in time; for several tones with the section where the phase of `tone` is zero."""
    times = orbit_times(x)
    along, across = x.evaluate(times), y.evaluate(times)
    factors, names = [], []
    sizes = [float(np.abs(values).max()) for values in (along, across)]
    if x.units == y.units and _LEAST_SHARE * max(sizes) <= min(sizes):
        sizes = 2 * [max(sizes)]  # one unit
    for series, size in zip((x, y), sizes):
        factor, units = style.unit_scale(size, series.units)
        factors.append(factor)
        names.append(style.with_unit(series.axis_label, units))
    is_torus = x.n_tones > 1
    with style.look():
        fig = style.figure(5.6, 5.0)
        meaning = "where the phase of the tone is zero" if not is_torus else rf"section $\tau_{tone + 1} = 0$"
        mark = {"marker": "o", "linestyle": "none", "color": style.COLOURS[1], "markersize": 2.5 if is_torus else 6.0}
        line = {"color": style.COLOURS[0], "linewidth": 0.4 if is_torus else 1.4, "alpha": 0.5 if is_torus else 1.0}
        handles = [Line2D([], [], **(line | {"linewidth": 1.4}), label="motion"), Line2D([], [], **mark, label=meaning)]
        (ax,) = style.below_legends(fig, [handles], 4.2)
        ax.plot(factors[0] * along, factors[1] * across, **line, gid="orbit", rasterized=times.size > 10_000)
        at = section((x, y), tone)
        ax.plot(factors[0] * at[0], factors[1] * at[1], **mark, gid="section", zorder=3)
        ax.set(xlabel=names[0], ylabel=names[1])
        ax.grid(True)
        sides = [max(float(np.ptp(values)), 1e-300) for values in (along, across)]
        if x.units == y.units and factors[0] == factors[1] and 1.0 / _TALLEST < sides[0] / sides[1] < _TALLEST:
            ax.set_aspect("equal", adjustable="datalim")
        what = "Phase plane" if y.units == f"{x.units}/s" else f"Orbit of {x.label} and {y.label}"
        style.head(fig, f"{what} of {x.label}" if what == "Phase plane" else what, about)
    return fig


def level_range(values: np.ndarray) -> Normalize:
    """The scale of a map; one of height 1 where all values are the same."""
    return Normalize(values.min(), values.max() if np.ptp(values) > 0.0 else values.min() + 1.0)


def other_phases(n_tones: int) -> str:
    """Of a map over the phases of two tones: those of the others."""
    return ", ".join(f"tau_{m} = 0" for m in range(3, n_tones + 1))


def draw_surface(series: Series, *, view: str = "surface", n_samples: int = 96, about: str = ""):
    """The motion over the phases of the first two tones, with zero phases of the others: a 3-D surface, or a map with contour
    lines."""
    if series.n_tones < 2:
        raise UsageError("one tone has a line over its phase, no surface: nhbm-post time draws it")
    values = series.on_grid((n_samples, n_samples) + (1,) * (series.n_tones - 2))
    values = np.pad(values.reshape(n_samples, n_samples), [(0, 1)] * 2, mode="wrap")
    factor, units = style.unit_scale(float(np.abs(values).max()), series.units)
    values = factor * values
    taus = [np.linspace(0.0, 2.0 * np.pi, n_samples + 1)] * 2
    levels = level_range(values)
    label = style.with_unit(series.axis_label, units)
    nowhere = np.zeros(values.shape, dtype=bool)
    with style.look():
        if view == "map":
            fig = style.figure(5.8, 5.0)
            ax = fig.add_subplot()
            draw_level(ax, taus, values, levels, label, nowhere)
            fig.colorbar(ax.collections[0], cax=style.bar_beside(ax), label=label).outline.set_linewidth(0.5)
        else:
            fig = style.figure(6.2, 5.2, is_arranged=False)
            ax = style.axes_at(fig, 0.0, 0.2, 5.8, 4.5, projection="3d")
            draw_solid(ax, taus, values, levels, label, nowhere)
            ax.zaxis.labelpad = 4
        style.head(fig, f"{series.axis_label} over hypertime", ", ".join(t for t in (about, other_phases(series.n_tones)) if t))
    return fig
