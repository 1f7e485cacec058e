"""Spectra of a quantity over its integer tuples (figure 8 of the paper) or over frequency."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from ..errors import UsageError
from ..series import Series
from ..text import tuple_text
from . import style

FORMS = ("map", "bars", "stem")
# Default number of decades below the largest amplitude; smaller amplitudes of a converged point are rounding errors.
DECADES = 8.0
_LEAST_SHARE = 0.3  # of the cells of a map with a harmonic


def draw_spectrum(
    series: Series,
    *,
    title: str = "",
    form: str | None = None,
    over: str = "tuple",
    decades: float = DECADES,
    is_normalised: bool = True,
    in_hertz: bool = False,
):
    """Amplitudes |c_j|, relative to the largest if `is_normalised`.

    form: `map` (default for 2 tones, unless most of the map would be empty), `bars` (3-D, 2 tones) or `stem` (default otherwise);
    over: `tuple`, or `frequency` for stems over |j . omega|, which `tuple` also means for 3 tones and more.
    """
    if form in ("map", "bars") and (series.n_tones != 2 or over == "frequency"):
        raise UsageError(
            f"form '{form}' needs 2 tones and tuples as axes; this file has {series.n_tones} tone(s)"
        )
    if form is None:
        form = "map" if series.n_tones == 2 and over == "tuple" and _share(series.tuples) >= _LEAST_SHARE else "stem"
    amplitudes = series.amplitudes
    largest = amplitudes.max(initial=0.0)
    if largest == 0.0:
        raise UsageError(f"all harmonics of {series.label} are zero: there is no spectrum to draw")
    if is_normalised:
        amplitudes, label = amplitudes / largest, rf"Amplitude $|c_j|\,/\,\max|c_j|$ of {series.label}"
    else:
        factor, units = style.unit_scale(largest, series.units, is_logarithmic=True)
        amplitudes, label = amplitudes * factor, style.with_unit(rf"Amplitude $|c_j|$ of {series.label}", units)
    norm = amplitude_norm(amplitudes, decades)
    what = "Normalised amplitudes" if is_normalised else "Amplitudes"
    with style.look():
        if form == "map":
            left, (n1, n2) = series.tuples[:, 0].min() - 1, np.maximum(np.abs(series.tuples).max(axis=0), 1)
            cell = min(4.4 / (n1 - left + 1), 4.4 / (2 * n2 + 1))  # [inch]
            fig = style.figure(max(5.2, cell * (n1 - left + 1) + 1.8), max(3.4, cell * (2 * n2 + 1) + 1.6))
            ax = fig.add_subplot()
            draw_map(ax, series.tuples, amplitudes, norm)
            ax.set_xlim(left - 0.5, n1 + 0.5)  # of the redundant half one column
            colour_bar(fig, norm, amplitudes, label, cax=style.bar_beside(ax))
        elif form == "bars":
            fig = style.figure(7.2, 5.6, is_arranged=False)
            _draw_bars(fig, series.tuples, amplitudes, norm, label)
        else:
            fig = style.figure(7.0, 4.0)
            draw_stem(fig.add_subplot(), series, amplitudes, norm, label, over, in_hertz)
        head = f"{what} of the {series.n_harmonics} harmonics of {series.label}"
        scale = "" if not is_normalised else f"largest amplitude {style.quantity_text(largest, series.units)}"
        style.head(fig, head, title, scale)
    return fig


def _share(tuples: np.ndarray) -> float:
    """Share of the cells of a map that have a harmonic."""
    return 2 * len(tuples) / float(np.prod(2 * np.abs(tuples).max(axis=0) + 1))


def amplitude_norm(amplitudes: np.ndarray, decades: float = DECADES) -> LogNorm:
    """Logarithmic scale downward from the largest amplitude: by `decades`, or to a power of ten below all amplitudes."""
    largest = float(np.max(amplitudes))
    smallest = float(amplitudes[amplitudes > 0.0].min())
    if smallest > largest * 10.0**-decades:
        return LogNorm(10.0 ** np.floor(np.log10(0.999 * smallest)), largest)
    return LogNorm(largest * 10.0**-decades, largest)


def draw_map(ax, tuples: np.ndarray, amplitudes: np.ndarray, norm: LogNorm, has_legend: bool = True) -> None:
    """Heat map over (j1, j2): stored tuples coloured, mirrored ones hatched, those outside the set grey."""
    n1, n2 = np.maximum(np.abs(tuples).max(axis=0), 1)
    values = np.ma.masked_all((2 * n2 + 1, 2 * n1 + 1))
    values[tuples[:, 1] + n2, tuples[:, 0] + n1] = np.maximum(amplitudes, 0.999 * norm.vmin)
    is_stored = ~np.ma.getmaskarray(values)
    is_mirror = is_stored[::-1, ::-1] & ~is_stored
    is_outside = ~is_stored & ~is_mirror

    edges = np.arange(-n1, n1 + 2) - 0.5, np.arange(-n2, n2 + 2) - 0.5
    ax.pcolormesh(
        *edges,
        values,
        norm=norm,
        cmap=colormaps[style.COLOUR_MAP],
        edgecolors="white",
        linewidth=0.4 if max(n1, n2) <= 20 else 0.0,
        rasterized=max(n1, n2) > 40,
    )
    ax.add_patch(
        PathPatch(
            cells_outline(is_mirror, *edges), facecolor="white", edgecolor="#b4b9c1", hatch="////", linewidth=0
        )
    )
    keys = [
        Patch(
            facecolor="white",
            edgecolor="#b4b9c1",
            hatch="////",
            linewidth=0.4,
            label=r"redundant: $c_{-j}=\bar c_j$",
        )
    ]
    if is_outside.any():
        ax.add_patch(
            PathPatch(cells_outline(is_outside, *edges), facecolor="#e4e6ea", edgecolor="none", linewidth=0)
        )
        keys.append(Patch(facecolor="#e4e6ea", label="not in the set"))
    ax.set(
        xlim=(-n1 - 0.5, n1 + 0.5),
        ylim=(-n2 - 0.5, n2 + 0.5),
        xlabel="Harmonic $j_1$ of tone 1",
        ylabel="Harmonic $j_2$ of tone 2",
        aspect="equal",
    )
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(9, integer=True))
    ax.spines[["top", "right"]].set_visible(True)
    if has_legend:
        ax.legend(
            handles=keys,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncol=2,
            borderaxespad=0.3,
            handlelength=1.6,
            borderpad=0.0,
        )


def colour_bar(fig, norm: LogNorm, amplitudes: np.ndarray, label: str, **axes):
    """Colour bar of amplitudes at `ax` or in `cax`; a tip represents values below the scale, if any."""
    tip = "min" if (amplitudes < norm.vmin).any() else "neither"
    bar = fig.colorbar(ScalarMappable(norm, colormaps[style.COLOUR_MAP]), extend=tip, label=label, **axes)
    bar.outline.set_linewidth(0.5)
    bar.ax.minorticks_off()
    return bar


def draw_stem(
    ax, series: Series, amplitudes: np.ndarray, norm: LogNorm, label: str, over: str = "tuple", in_hertz: bool = False
) -> None:
    """Stems over j (one tone) or over |j . omega|, logarithmic; the largest are labelled with their tuples."""
    is_over_tuple = over == "tuple" and series.n_tones == 1
    x = series.tuples[:, 0] if is_over_tuple else np.abs(series.frequencies) / (2.0 * np.pi if in_hertz else 1.0)
    is_shown = amplitudes >= norm.vmin
    bottom, top = norm.vmin / 1.6, norm.vmax * (2.0 if is_over_tuple else 6.0)
    is_dense = is_shown.sum() > 60
    stem_colour = "#9cc4de" if is_dense else style.COLOURS[0]
    ax.vlines(
        x[is_shown], bottom, amplitudes[is_shown], color=stem_colour, linewidth=0.7 if is_dense else 1.1
    )
    ax.plot(
        x[is_shown], amplitudes[is_shown], "o", color=style.COLOURS[0], markersize=2.2 if is_dense else 3.4
    )
    ax.set_yscale("log")
    ax.set_ylim(bottom, top)
    ax.yaxis.set_major_locator(LogLocator(10.0, numticks=14))
    ax.grid(axis="y")
    ax.set_ylabel(label)
    ax.set_xlabel("Harmonic $j$" if is_over_tuple else "Frequency $f$ [Hz]" if in_hertz else r"Frequency $|j\cdot\omega|$ [rad/s]")
    if is_over_tuple:
        ax.xaxis.set_major_locator(MaxNLocator(16, integer=True))
        ax.set_xlim(min(x.min(), 0) - 0.6, x.max() + 0.6)
    else:
        span = max(float(x[is_shown].max()), 1e-300)
        ax.set_xlim(-0.02 * span, 1.03 * span)
        _label_stems(ax, x, series.tuples, amplitudes, span)
    n_hidden = int((~is_shown).sum())
    if n_hidden:
        why = f"below {norm.vmin:.1e} and not shown" if amplitudes[~is_shown].any() else "zero"
        ax.set_title(
            f"{n_hidden} of {series.n_harmonics} harmonics {'is' if n_hidden == 1 else 'are'} {why}",
            color=style.MUTED,
            size=8.0,
            loc="right",
        )


def _label_stems(ax, x, tuples, amplitudes, span, limit=16) -> None:
    """Writes the tuples of the largest stems, each one whose text overlaps no other stem or text."""
    bottom = ax.get_ylim()[0]
    decades = np.log10(ax.get_ylim()[1] / bottom)
    inches = ax.get_position().width * ax.figure.get_size_inches()[0]
    placed: list[tuple[float, float, float]] = []
    for k in np.argsort(amplitudes)[::-1]:
        if amplitudes[k] < bottom or len(placed) == limit:
            break
        half_width = span * 0.027 * len(tuple_text(tuples[k])) / inches
        level = np.log10(amplitudes[k])
        sides = {"left": x[k] + half_width} if x[k] < half_width else {"center": x[k], "right": x[k] - half_width}
        text = half_width, level, 0.06 * decades
        free = [(side, centre) for side, centre in sides.items() if _is_free(centre, *text, x, amplitudes, placed)]
        if not free:
            continue
        ax.annotate(
            tuple_text(tuples[k]),
            (x[k], amplitudes[k]),
            xytext=(0, 4),
            textcoords="offset points",
            size=7.5,
            ha=free[0][0],
            va="bottom",
            color=style.INK,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )
        placed.append((free[0][1], half_width, level))


def _is_free(centre: float, half_width: float, level: float, height: float, x, amplitudes, placed) -> bool:
    """Whether a text crosses no taller stem and overlaps none of the placed texts."""
    is_crossed = level < np.log10(amplitudes[np.abs(x - centre) < 0.75 * half_width].max(initial=1e-300))
    return not is_crossed and not any(abs(centre - a) < half_width + b and abs(level - c) < height for a, b, c in placed)


def _draw_bars(fig, tuples: np.ndarray, amplitudes: np.ndarray, norm: LogNorm, label: str) -> None:
    """3-D bars over (j1, j2), heights in decades above a power of ten; the mirrored half is empty."""
    ax = style.axes_at(fig, 0.0, 0.05, 6.15, 5.15, projection="3d", computed_zorder=False)
    bottom = np.floor(np.log10(norm.vmin) + 1e-9)
    heights = np.log10(np.maximum(amplitudes, norm.vmin)) - bottom
    n1, n2 = np.maximum(np.abs(tuples).max(axis=0), 1)
    is_shown = (amplitudes >= norm.vmin) & (heights > 0.0)
    width = 0.78
    # Seen from the empty half, so that the largest bars are in front. One call per bar, the farthest first, because matplotlib
    # sorts faces, not bars, and would draw tall bars over short ones in front of them.
    azimuth = -130.0
    towards_viewer = tuples @ np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    for rank, k in enumerate(np.argsort(towards_viewer, kind="stable")):
        if is_shown[k]:
            ax.bar3d(
                tuples[k, 0] - width / 2,
                tuples[k, 1] - width / 2,
                0.0,
                width,
                width,
                heights[k],
                color=colormaps[style.COLOUR_MAP](norm(amplitudes[k])),
                edgecolor=(0, 0, 0, 0.35),
                linewidth=0.2,
                shade=True,
                zorder=10 + rank,
            )
    top = max(1.0, np.ceil(np.log10(norm.vmax) - bottom - 1e-9))
    ax.set(
        xlim=(-n1 - 0.5, n1 + 0.5),
        ylim=(-n2 - 0.5, n2 + 0.5),
        zlim=(0.0, top),
        xlabel="Harmonic $j_1$ of tone 1",
        ylabel="Harmonic $j_2$ of tone 2",
    )
    ax.xaxis.set_major_locator(MaxNLocator(7, integer=True))
    ax.yaxis.set_major_locator(MaxNLocator(7, integer=True))
    ax.zaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.zaxis.set_major_formatter(FuncFormatter(lambda z, _: rf"$10^{{{int(round(z + bottom))}}}$"))
    ax.view_init(elev=30.0, azim=azimuth)
    style_3d(ax)
    colour_bar(fig, norm, amplitudes, label, cax=style.axes_at(fig, 6.25, 1.1, 0.14, 3.1))


def style_3d(ax) -> None:
    """White panes and thin grid lines for 3-D axes."""
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 1.0))
        axis._axinfo["grid"].update(color="#d9dce1", linewidth=0.5)
        axis.line.set_linewidth(0.6)
    ax.tick_params(pad=0.5, labelsize=8.0)


def cells_outline(mask: np.ndarray, x: np.ndarray, y: np.ndarray) -> Outline:
    """One outline of all cells of a mask (y, x) between these edges, so that a hatch is continuous."""
    column, row = np.array([0, 1, 1, 0, 0]), np.array([0, 0, 1, 1, 0])
    corners = [np.column_stack([x[i1 + column], y[i2 + row]]) for i2, i1 in np.argwhere(mask)]
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY]
    if not corners:
        return Outline(np.empty((0, 2)))
    return Outline(np.concatenate(corners), codes * len(corners))
