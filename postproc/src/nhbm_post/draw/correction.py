"""The correction of a motion to the wall, in four panels (figure 6 of the paper)."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.patches import FancyArrowPatch, Patch

from ..errors import ReaderError, UsageError
from ..outcome import INTEGRATED
from ..reader import Results
from . import style
from .spectrum import DECADES, amplitude_norm, colour_bar, draw_map, draw_stem, style_3d

# Relative difference of the surfaces above which a location counts as corrected.
_TOUCH = 1e-9
# Faces along each axis of a surface: fewer leave gaps, more take long without a visible difference.
_N_FACES = 120


def draw_correction(
    results: Results,
    point: int,
    dof: str | None = None,
    *,
    view: str = "surface",
    decades: float = DECADES,
    n_samples: int = 96,
    allow_unconverged: bool = False,
):
    """Four panels: (a) spectrum and (b) surface of the motion, (c) surface and (d) spectrum corrected.

    Uses the stored surfaces, otherwise sums the stored coefficients on `n_samples` points per tone, and notes which. view:
    `surface` (3-D) or `map`. More than two tones: the section of the surface at tau_3 = ... = 0.
    """
    dof = results.default_dof("corrected") if dof is None else dof
    before = results.series(point, dof, "motion", allow_unconverged)
    after = results.series(point, dof, "corrected", allow_unconverged)
    taus, motion, corrected, is_stored = _surfaces(
        results, point, dof, before, after, n_samples, allow_unconverged
    )

    n_tones = before.n_tones
    if np.abs(motion).max() == 0.0:
        raise ReaderError(f"{results.path}: the motion of '{dof}' at point {point} is zero: nothing to draw")
    if not np.abs(corrected - motion).max() > _TOUCH * np.ptp(motion):
        why = "the rigid contact at it is not reached" if results.has_rigid_law else "no law of this model is a rigid contact"
        if results.status[point] == INTEGRATED:
            why = "it was found by time integration, where impacts replace the correction"
        raise UsageError(
            f"{results.path}: nothing is corrected in the motion of '{dof}' at point {point}, since {why}; "
            f"'nhbm-post spectrum' and 'time' draw the motion"
        )
    factor, units = style.unit_scale(max(np.abs(motion).max(), np.abs(corrected).max()), before.units)
    motion, corrected = factor * motion, factor * corrected
    spectra = [factor * series.amplitudes for series in (before, after)]
    norm = amplitude_norm(np.concatenate(spectra), decades)
    amplitude_label = style.with_unit(rf"$|c_j|$ of {dof}", units)
    # A truncated series differs from the motion everywhere: only stored surfaces show where it was corrected.
    difference = np.abs(corrected - motion)
    touch = (difference > _TOUCH * np.ptp(motion)) & is_stored
    label = style.with_unit(dof, units)
    with style.look():
        fig, axes, bars = _panels(n_tones, view)
        for name, series, amplitudes in (("a", before, spectra[0]), ("d", after, spectra[1])):
            if n_tones == 2:
                draw_map(axes[name], series.tuples, amplitudes, norm, has_legend=name == "a")
            else:
                draw_stem(axes[name], series, amplitudes, norm, amplitude_label)
        if n_tones == 2:
            colour_bar(
                fig, norm, np.concatenate(spectra), amplitude_label, cax=bars[0], orientation="horizontal"
            )
        if n_tones == 1:
            _draw_curves((axes["b"], axes["c"]), taus[0], motion, corrected, touch, label)
        else:
            levels = Normalize(min(motion.min(), corrected.min()), max(motion.max(), corrected.max()))
            draw = draw_solid if view == "surface" else draw_level
            draw(axes["b"], taus, motion, levels, label, np.zeros_like(touch))
            draw(axes["c"], taus, corrected, levels, label, touch)
            bar = fig.colorbar(
                ScalarMappable(levels, "cividis"), cax=bars[1], orientation="horizontal", label=label
            )
            bar.outline.set_linewidth(0.5)
            if touch.any():
                whole = "hypertime" if n_tones == 2 else "the section"
                key = Patch(
                    facecolor=style.CORRECTED, label=f"corrected: {100.0 * touch.mean():.3g} % of {whole}"
                )
                anchor = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
                if view == "surface":
                    anchor = {"loc": "upper left", "bbox_to_anchor": (0.085, 1.0)}
                axes["c"].legend(handles=[key], borderaxespad=0.3, borderpad=0.0, **anchor)
        moved = f"largest correction {difference.max():.3g} {units}"
        source = "surfaces as stored by the run"
        if not is_stored:
            source = (
                "surfaces summed from the stored coefficients, so (c) is cut off at the same harmonics as (d)"
            )
        section = (
            ""
            if n_tones <= 2
            else "section " + " = ".join(f"tau_{m}" for m in range(3, n_tones + 1)) + " = 0"
        )
        outcome = results.warning(point)
        style.head(
            fig,
            f"Correction of {dof} to the wall, {before.n_harmonics} harmonics",
            ", ".join(part for part in (results.title, results.point_text(point), outcome) if part),
            "; ".join(part for part in (moved, section, source) if part),
        )
    return fig


def _panels(n_tones: int, view: str):
    """Figure with axes a and b above d and c, arrows from a to b to c to d, and axes for two colour bars."""
    is_solid = view == "surface" and n_tones > 1
    has_maps = n_tones == 2
    side, pitch, lift = 2.85, 3.9, 0.30
    below = 0.75
    if n_tones == 1:
        side, pitch, lift, below = 2.1, 3.18, 0.30, 0.0
    height = 0.85 + 2.0 * pitch + below
    left_width = side if has_maps else 3.55
    right = 0.75 + left_width + (1.15 if has_maps else 1.45)
    right_width = side if not is_solid and n_tones > 1 else 3.55
    fig = style.figure(right + right_width + (0.35 if not is_solid else 0.55), height, is_arranged=False)
    floors = [height - 0.85 - row * pitch - lift - 0.15 - side for row in (0, 1)]
    axes = {
        "a": style.axes_at(fig, 0.75, floors[0], left_width, side),
        "d": style.axes_at(fig, 0.75, floors[1], left_width, side),
    }
    for name, floor in zip("bc", floors):
        if is_solid:
            axes[name] = style.axes_at(
                fig, right - 0.35, floor - 0.32, right_width + 0.6, side + 0.55, projection="3d"
            )
        else:
            axes[name] = style.axes_at(fig, right, floor, right_width, side)
    for name, left, floor, heading in (
        ("a", 0.75, floors[0], "motion, multi-frequency domain"),
        ("b", right, floors[0], "motion, hypertime domain"),
        ("d", 0.75, floors[1], "corrected, multi-frequency domain"),
        ("c", right, floors[1], "corrected, hypertime domain"),
    ):
        _write(fig, left, floor + side + lift, f"({name}) {heading}", weight="bold", size=9.5, va="bottom")
    gutter = 0.75 + left_width + 0.1
    prefix = "" if n_tones == 1 else f"{n_tones}-"
    middles = [floor + 0.62 * side for floor in floors]
    _arrow(fig, (gutter, middles[0]), (gutter + 0.5, middles[0]), f"{prefix}iFFT", (0.25, 0.08), "center")
    _arrow(fig, (gutter + 0.5, middles[1]), (gutter, middles[1]), f"{prefix}FFT", (0.25, 0.08), "center")
    turn = right - 0.25
    _arrow(fig, (turn, floors[0] - 0.02), (turn, floors[1] + side + 0.32), "wall", (-0.09, -0.27), "right")
    if n_tones == 1:
        return fig, axes, []
    bars = [
        style.axes_at(fig, left, 0.52, width, 0.12)
        for left, width in ((0.75, left_width), (right, side if not is_solid else 3.55))
    ]
    if not has_maps:
        bars[0].remove()
    return fig, axes, bars


def _write(fig, x: float, y: float, text: str, **kwargs) -> None:
    """Text at a position in inches."""
    width, height = fig.get_size_inches()
    fig.text(x / width, y / height, text, color=style.INK, **kwargs)


def _arrow(fig, start, end, text, offset, align) -> None:
    """Arrow between positions in inches, with text beside its start or middle."""
    size = fig.get_size_inches()
    fig.add_artist(
        FancyArrowPatch(
            tuple(start / size),
            tuple(end / size),
            transform=fig.transFigure,
            arrowstyle="-|>",
            mutation_scale=10,
            linewidth=1.0,
            color=style.MUTED,
            shrinkA=0,
            shrinkB=0,
        )
    )
    x, y = min(start[0], end[0]) + offset[0], max(start[1], end[1]) + offset[1]
    _write(fig, x, y, text, size=8.0, ha=align, va="bottom")


def _surfaces(results, point, dof, before, after, n_samples, allow_unconverged):
    """(axes, motion, corrected, whether stored) on at most two hypertime axes closed at 2 pi."""
    stored = [
        results.samples(point, dof, quantity, allow_unconverged) for quantity in ("motion", "corrected")
    ]
    if None not in stored:
        taus = [np.append(tau, 2.0 * np.pi) for tau in stored[0][0][:2]]
        values = [surface for _, surface in stored]
        is_stored = True
    else:
        shape = (n_samples,) * min(2, before.n_tones) + (1,) * max(0, before.n_tones - 2)
        taus = [2.0 * np.pi * np.arange(n + 1) / n for n in shape[:2]]
        values = [series.on_grid(shape) for series in (before, after)]
        is_stored = False
    closed = []
    for surface in values:
        while surface.ndim > 2:
            surface = surface[..., 0]
        closed.append(np.pad(surface, [(0, 1)] * surface.ndim, mode="wrap"))
    return taus, *closed, is_stored


def draw_solid(ax, taus, values, levels, label, touch) -> None:
    """3-D surface over (tau_1, tau_2); corrected areas in the colour of the legend."""
    taus, values, touch = _resample(taus, values, touch)
    mean = 0.25 * (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:])
    colours = colormaps["cividis"](levels(mean))
    colours[touch[:-1, :-1] & touch[1:, :-1] & touch[:-1, 1:] & touch[1:, 1:]] = to_rgba(style.CORRECTED)
    tau_1, tau_2 = np.meshgrid(*taus, indexing="ij")
    ax.plot_surface(
        tau_1,
        tau_2,
        values,
        facecolors=colours,
        rcount=values.shape[0],
        ccount=values.shape[1],
        linewidth=0.0,
        antialiased=False,
        shade=False,
        rasterized=True,
    )
    ax.set(xlim=(0.0, 2.0 * np.pi), ylim=(0.0, 2.0 * np.pi), zlim=(levels.vmin, levels.vmax))
    ax.set_xlabel(style.phase(1), labelpad=-2)
    ax.set_ylabel(style.phase(2), labelpad=-2)
    ax.set_zlabel(label, labelpad=-2)
    style.phase_ticks(ax.xaxis)
    style.phase_ticks(ax.yaxis)
    ax.view_init(elev=34.0, azim=-52.0)
    style_3d(ax)


def _resample(taus, values, touch):
    """Resamples a surface to a suitable number of faces, linearly between its samples."""
    fine = np.linspace(0.0, 2.0 * np.pi, _N_FACES + 1)
    held = touch.astype(float)
    for axis, tau in enumerate(taus):
        values = np.apply_along_axis(partial(np.interp, fine, tau), axis, values)
        held = np.apply_along_axis(partial(np.interp, fine, tau), axis, held)
    return [fine, fine], values, held > 0.5


def draw_level(ax, taus, values, levels, label, touch) -> None:
    """Heat map over (tau_1, tau_2) with contour lines; the boundary of corrected areas is drawn."""
    ax.pcolormesh(*taus, values.T, norm=levels, cmap="cividis", shading="gouraud", rasterized=True)
    between = np.linspace(levels.vmin, levels.vmax, 9)[1:-1]
    ax.contour(*taus, values.T, levels=between, colors="white", linewidths=0.4, linestyles=style.STABLE)
    if touch.any():
        ax.contourf(*taus, touch.T, levels=[0.5, 1.5], colors=[style.CORRECTED])
    ax.set(xlabel=style.phase(1), ylabel=style.phase(2), aspect="equal")
    ax.spines[["top", "right"]].set_visible(True)
    style.phase_ticks(ax.xaxis)
    style.phase_ticks(ax.yaxis)


def _draw_curves(axes, tau, motion, corrected, touch, label) -> None:
    """One tone: the motion over tau_1, and the corrected one over the motion."""
    axes[0].plot(tau, motion, color=style.COLOURS[0])
    axes[1].plot(tau, motion, color=style.WALL, linestyle=style.REFERENCE, linewidth=1.0, label="before")
    axes[1].plot(tau, corrected, color=style.COLOURS[0], label="corrected")
    if touch.any():
        axes[1].plot(
            tau[touch], corrected[touch], ".", color=style.CORRECTED, markersize=4, label="at the wall"
        )
    axes[1].legend(**style.ABOVE | {"ncol": 3})
    for ax in axes:
        ax.set(xlabel=style.phase(1), ylabel=label, xlim=(0.0, 2.0 * np.pi))
        style.phase_ticks(ax.xaxis)
        ax.grid(True)
