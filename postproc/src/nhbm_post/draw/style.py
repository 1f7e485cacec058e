"""Common appearance of all pictures: colours for colour-blind readers, units, headings, saving."""

import io
import logging
import shutil
import tempfile
import textwrap
from contextlib import contextmanager
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.colorbar import make_axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Bbox

from nhbm.child_process import atomic_write

from ..appearance import chosen
from ..errors import UsageError
from ..text import number_text

# Okabe and Ito, "Color universal design" (2008), in an order that also differs in grey.
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"]
# One meaning for each colour, in all pictures.
STABLE, UNSTABLE, UNKNOWN, REFERENCE = "-", (0, (4, 2)), ":", "-."
MARKERS = ["o", "s", "^", "D", "v", "P", "X"]
COLOUR_MAP = "viridis"
INK = "#222222"
MUTED = "#5f6670"
WALL = "#8a8f98"
CORRECTED = "#D55E00"
FAILURE = "#C00000"

_LEAST_SCALE = 0.7  # of type
_LEGEND_ROW = 0.19  # [inch]
# Legend of a few entries outside the data, above the axes on the right.
ABOVE = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncol": 2, "borderaxespad": 0.2}

ENDINGS = (".png", ".pdf", ".svg", ".pgf")

_RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "mathtext.fontset": "dejavusans",
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": False,
    "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": True,
    "grid.color": "#d9dce1",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "hatch.linewidth": 0.5,
    "pdf.fonttype": 42,
    "pgf.texsystem": "pdflatex",
    "pgf.rcfonts": False,  # the fonts of the document
    "svg.fonttype": "none",
    "svg.hashsalt": "nhbm",  # names of parts; otherwise random, so that the same picture would differ between runs
}

_RC_PAPER = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "lines.linewidth": 1.0,
}

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_WITH_PREFIX = ("m", "N", "rad", "s", "Pa", "m/s", "N m", "N*m", "N/m", "rad/s", "Hz")


@contextmanager
def look():
    """Draws and saves with the common style and the chosen settings, not with those that the user has for other pictures."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)
        if chosen().is_paper:
            matplotlib.rcParams.update(_RC_PAPER)
        matplotlib.rcParams.update(chosen().settings)
        yield


def settings_of(path: Path) -> dict:
    """The settings in a style file of matplotlib (matplotlibrc, .mplstyle)."""
    notes = io.StringIO()
    handler = logging.StreamHandler(notes)  # matplotlib reports lines that it does not understand, and goes on
    logger = logging.getLogger("matplotlib")
    logger.addHandler(handler)
    try:
        settings = matplotlib.rc_params_from_file(path, use_default_template=False)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"style file '{path}' cannot be read: {getattr(error, 'strerror', None) or error}") from None
    finally:
        logger.removeHandler(handler)
    if notes.getvalue():
        raise UsageError(f"style file '{path}': {notes.getvalue().strip().splitlines()[0]}")
    return {key: value for key, value in settings.items() if not key.startswith(("backend", "interactive", "toolbar"))}


def figure(width: float, height: float, is_arranged: bool = True) -> Figure:
    """Empty figure of a size in inches, without display; by default its axes are arranged automatically.

    A chosen width scales it: the height less than the width, because type does not shrink, or, for parts with fixed positions, the
    whole figure including type when it is saved.
    """
    scale = chosen().scale(width, 1 if is_arranged else 2)
    if not is_arranged:
        fig = Figure(figsize=(width, height))
        fig.nhbm_scale, fig.nhbm_later = 1.0, scale
        return fig
    fig = Figure(figsize=(scale * width, _of_height(scale) * height), layout="constrained")
    fig.nhbm_scale, fig.nhbm_later = scale, 1.0
    return fig


def max_columns(margin: float, width: float) -> int:
    """Panels of a width in inches beside each other, three at most, that fit into the chosen width with readable type."""
    if not chosen().is_scaled:
        return 3
    room = chosen().scale(1.0, 2) / _LEAST_SCALE
    return int(np.clip((room - margin) // width, 1, 3))


def panels(width: float, height: float) -> Figure:
    """Empty figure of many panels, arranged automatically, which a chosen width scales including its type."""
    fig = Figure(figsize=(width, height), layout="compressed")
    fig.nhbm_scale, fig.nhbm_later = 1.0, chosen().scale(width, 2)
    return fig


def _of_height(scale: float) -> float:
    return scale**0.5 if scale < 1.0 else scale**0.3


def axes_at(fig: Figure, left: float, bottom: float, width: float, height: float, **kwargs):
    """Axes at a position in inches, for pictures whose parts must not move."""
    full_width, full_height = fig.get_size_inches()
    return fig.add_axes(
        (left / full_width, bottom / full_height, width / full_width, height / full_height), **kwargs
    )


def rows_of(line: str, width: int) -> list[str]:
    """A detail of a heading in rows of some characters at most, broken behind commas where that is possible."""
    rows = [""]
    for part in line.split(", "):
        if rows[-1] and len(rows[-1]) + len(part) + 2 > width:
            rows[-1] += ","
            rows.append("")
        rows[-1] += (", " if rows[-1] else "") + part
    return [piece for row in rows for piece in textwrap.wrap(row, width)]


def head(fig: Figure, title: str, *lines: str) -> None:
    """Writes a bold heading with details below it, and keeps the axes of an arranged figure below both; on paper both are in the
    caption, `caption` of the figure."""
    title = title if chosen().title is None else chosen().title
    fig.nhbm_caption = ". ".join(text for text in (title, *lines) if text)
    if chosen().is_paper:
        return
    width, height = fig.get_size_inches()
    titles = textwrap.wrap(title, int(width * 12.0))
    details = [piece for line in lines if line for piece in rows_of(line, int(width * 15.5))]
    top = 0.10
    for texts, size, weight, colour in ((titles, 10.5, "bold", INK), (details, 8.5, "normal", MUTED)):
        for text in texts:
            fig.text(
                0.10 / width,
                1.0 - top / height,
                text.replace("$", r"\$"),
                va="top",
                ha="left",
                size=size,
                weight=weight,
                color=colour,
            )
            top += size * 1.35 / 72.0
    if fig.get_layout_engine() is not None:
        fig.get_layout_engine().set(rect=(0.0, 0.0, 1.0, 1.0 - (top + 0.05) / height))


def legend_columns(labels: list[str], width: float) -> int:
    """Number of columns (at most 3) of these labels that fit above axes of a width in inches."""
    column = 0.75 + 0.072 * max((len(label) for label in labels), default=0)
    return int(min(3, max(1, (width - 0.8) // column)))


def _dense_columns(labels: list[str], width: float) -> int:
    """As many columns as fit into a width in inches, filled from top to bottom, each as wide as necessary."""
    for n in range(len(labels), 1, -1):
        parts = np.array_split([0.5 + 0.068 * len(label) for label in labels], n)
        if sum(part.max() for part in parts) <= width:
            return n
    return 1


def below_legends(fig: Figure, groups: list[list], *heights: float, **kwargs) -> list:
    """Axes below each other, of heights in inches, below legends that each begin a new line.

    The height of the legends is added to that of the figure, so that the axes keep their size.
    """
    width, height = fig.get_size_inches()
    height -= 0.45 if chosen().is_paper else 0.0
    groups = [handles for handles in groups if handles]
    columns = [_dense_columns([h.get_label() for h in handles], width - 0.8) for handles in groups]
    rows = [-(-len(handles) // n) for handles, n in zip(groups, columns)]
    legend_height = _LEGEND_ROW * sum(rows)
    heights = tuple(_of_height(fig.nhbm_scale) * one for one in heights)
    fig.set_size_inches(width, height + legend_height)
    ratios = ([legend_height] if groups else []) + list(heights)
    cells = fig.add_gridspec(len(ratios), 1, height_ratios=ratios, **kwargs)
    axes = []
    for cell in list(cells)[len(ratios) - len(heights) :]:
        axes.append(fig.add_subplot(cell, **({"sharex": axes[0]} if axes else {})))
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    if groups:
        top = fig.add_subplot(cells[0])
        top.set_axis_off()
        for i, (handles, n) in enumerate(zip(groups, columns)):
            legend = top.legend(
                handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0 - sum(rows[:i]) / sum(rows)), ncol=n, borderpad=0.0,
                borderaxespad=0.0, columnspacing=1.3, handletextpad=0.5, labelspacing=0.35,
            )
            legend.set_in_layout(False)
            if i < len(groups) - 1:
                top.add_artist(legend)
    return axes


def unit_scale(largest: float, units: str, is_logarithmic: bool = False) -> tuple[float, str]:
    """(factor, unit text) for convenient numbers of values up to `largest`: 1.5e-3 m gives (1e3, `mm`). Logarithmic axes, whose
    numbers have powers of ten, need none in the unit."""
    if not np.isfinite(largest) or largest <= 0.0:
        return 1.0, units
    power = int(3 * np.floor((np.log10(largest) + 0.31) / 3.0))
    if power == 0:
        return 1.0, units
    is_as_given = (units in ("s", "rad/s") and power > 0) or (units == "Hz" and largest < 1e4 and power > 0)
    if units in _WITH_PREFIX and power in _PREFIXES and not is_as_given:
        return 10.0**-power, _PREFIXES[power] + units
    if -3 < power < 6 or is_logarithmic:
        return 1.0, units
    shown = "" if units in ("", "1") else " " + units
    return 10.0**-power, rf"$10^{{{power}}}${shown}"


def quantity_text(value: float, units: str, digits: int = 4) -> str:
    """A value with its unit for headings and legends, in a few digits and with a convenient prefix: `1.094 mm`."""
    factor, scaled = unit_scale(abs(value), units)
    if "$" in scaled:  # a power of ten: part of the number in a text
        factor, scaled = 1.0, units
    return f"{number_text(float(f'{factor * value:.{digits}g}'))} {'' if scaled == '1' else scaled}".rstrip()


def with_unit(name: str, units: str) -> str:
    """Axis label `name [unit]`, without brackets for pure numbers."""
    return name if units in ("", "1") else f"{name} [{units}]"


def relabel(fig: Figure, texts: dict[str, str]) -> None:
    """Other labels of the axes: of x, of y (of the first axes that have one), and of z, or of the colours."""
    bars = [ax for ax in fig.axes if ax.get_label() == "<colorbar>"]
    others = [ax for ax in fig.axes if ax not in bars]
    named = {
        "x": [ax.xaxis for ax in others if ax.get_xlabel()],
        "y": [ax.yaxis for ax in others if ax.get_ylabel()][:1],
        "z": [ax.zaxis for ax in others if getattr(ax, "get_zlabel", str)()]
        + [axis for ax in bars for axis in (ax.xaxis, ax.yaxis) if axis.get_label_text()],
    }
    for letter, text in texts.items():
        if not named[letter]:
            raise UsageError(f"the picture has no {letter} axis with a name, so --label has nothing to rename")
        for axis in named[letter]:
            axis.set_label_text(text)


def bar_beside(ax):
    """Axes of a colour bar beside axes of a given aspect, exactly as high as these are drawn."""
    bar, _ = make_axes(ax, aspect=16)

    def place(*_):
        ax.apply_aspect()
        height, own = ax.get_position(), bar.get_position(original=True)
        return Bbox([[height.x1 + own.x0 - ax.get_position(original=True).x1, height.y0], [own.x1, height.y1]])

    bar.set_axes_locator(place)
    return bar


def phase(tone: int) -> str:
    """Label of a hypertime axis; tones are counted from 1."""
    return rf"Phase $\tau_{tone}$ [rad]"


def phase_ticks(axis) -> None:
    """Ticks of a hypertime axis of length 2 pi, in multiples of pi."""
    axis.set_ticks([0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi, 2.0 * np.pi])
    axis.set_ticklabels(["0", r"$\frac{\pi}{2}$", r"$\pi$", r"$\frac{3\pi}{2}$", r"$2\pi$"])


def decade_axis(axis, limits) -> None:
    """Labels at the decades, at 2 and 5 of each if there are few, and at round numbers within less than a decade."""
    decades = np.log10(limits[1] / limits[0])
    if decades > 2.5:
        axis.set_major_locator(LogLocator(base=10.0, numticks=12))
        axis.set_minor_formatter(NullFormatter())
        return
    axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)) if decades > 0.8 else MaxNLocator(6))
    axis.set_major_formatter(FuncFormatter(_short))
    axis.set_minor_formatter(NullFormatter())


def _short(value: float, _=None) -> str:
    power = int(np.floor(np.log10(value) + 1e-9))
    if -2 <= power <= 3:
        return f"{value:g}"
    digit = f"{value / 10.0**power:.3g}"
    return rf"$10^{{{power}}}$" if digit == "1" else rf"${digit}\cdot 10^{{{power}}}$"


def save(fig: Figure, path, dpi: int = 200, has_numbers: bool = False) -> Path:
    """Writes a figure; the ending of `path` chooses the format. `has_numbers`: the command writes them as CSV."""
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        numbers = ", or in .csv for the numbers" if has_numbers else ""
        raise UsageError(f"cannot draw to '{path}': the name must end in {', '.join(ENDINGS)}{numbers}")
    if fig.nhbm_later != 1.0:
        for text in fig.findobj(Text):
            text.set_fontsize(fig.nhbm_later * text.get_fontsize())
        fig.set_size_inches(fig.nhbm_later * fig.get_size_inches())
        fig.nhbm_later = 1.0
    if path.suffix.lower() == ".pgf":
        _save_pgf(fig, path, dpi)
        return path
    # No date inside: the same data give the same file.
    metadata = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(path.suffix.lower())
    try:
        with look(), atomic_write(path) as name:
            fig.savefig(name, dpi=dpi, metadata=metadata, facecolor="white")
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None
    return path


def _save_pgf(fig: Figure, path: Path, dpi: int) -> None:
    """Writes a figure for LaTeX, whose fonts it takes; parts that are images become files beside it, NAME-img0.png."""
    with look(), tempfile.TemporaryDirectory() as folder:
        system = matplotlib.rcParams["pgf.texsystem"]
        if shutil.which(system) is None:
            raise UsageError(f"'{path}' needs {system}, which measures the texts and is not on the path; "
                             "pgf.texsystem in a style file names another, such as lualatex")  # fmt: skip
        try:
            fig.savefig(Path(folder) / path.name, dpi=dpi, backend="pgf")
        except RuntimeError as error:
            raise UsageError(f"'{path}': {system} fails: {str(error).strip().splitlines()[0]}") from None
        try:
            for part in sorted(Path(folder).iterdir(), reverse=True):  # images before the figure that names them
                with atomic_write(path.with_name(part.name)) as name:
                    shutil.copyfile(part, name)
        except OSError as error:
            raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None
