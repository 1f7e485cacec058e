"""Response curves: one measure of the motion, or the frequency of a tone, over a swept parameter or along a followed curve."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

from nhbm.child_process import atomic_write
from nhbm.located import MARKERS

from ..axis_words import axis_words, with_symbol
from ..errors import UsageError
from ..measure import Measure
from ..outcome import ANSWERS, CONVERGED, PENDING, SOLVED, INTEGRATED
from ..parameter import Parameter
from ..reader import Results
from ..text import list_text, tuple_text
from . import marks, style
from .jumps import jumps_at_folds

# Default number of curves in one picture: the number of colours that can be distinguished.
N_CURVES = len(style.COLOURS)
# Points of a curve above which converged points are not marked individually.
_MANY_POINTS = 45
_TONES = ("tones%frequency", "tones%hertz")
_ROW = 0.17  # [inch] height of a row of points without a motion


@dataclass(frozen=True)
class Curve:
    """Points of one file that differ only in the parameter of the x axis, in its order; x and y in units of the file."""

    label: str
    results: Results
    points: np.ndarray
    x: np.ndarray
    y: np.ndarray
    branch: np.ndarray
    kind: np.ndarray = field(default_factory=lambda: np.array([], dtype=str))  # of the points of a curve that was followed
    is_backbone: bool = False

    @property
    def is_solved(self) -> np.ndarray:
        return np.isin(self.results.status[self.points], SOLVED)

    @property
    def is_converged(self) -> np.ndarray:
        return self.results.status[self.points] == CONVERGED

    @property
    def has_dots(self) -> bool:
        """Whether each answer is marked: in a sweep of few points, not along a curve that was followed."""
        return self.points.size <= _MANY_POINTS and self.results.curve is None

    def line(self, is_drawn) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """x, y, status and stability, with a gap at points without a value and where the motion jumps to another branch."""
        y = np.where(is_drawn(self.y), self.y, np.nan)
        jumps = np.flatnonzero(self.is_jump) + 1
        columns = (self.x, np.nan), (y, np.nan), (self.results.status[self.points], PENDING), (self.stability, 0)
        return tuple(np.insert(column, jumps, gap) for column, gap in columns)

    @property
    def is_jump(self) -> np.ndarray:
        """Whether the motion jumps to another branch, for each point and the next."""
        return (np.diff(self.branch) != 0) & (self.branch[1:] > 0) & (self.branch[:-1] > 0) | (self.branch[1:] < 0)

    @property
    def stability(self) -> np.ndarray:
        """Stability of each point: 1 stable, -1 unstable, 0 unknown."""
        return self.results.stability()[self.points]

    @property
    def stability_between(self) -> np.ndarray:
        """Stability between each point and the next. At a located point, such as a fold, a multiplier is 1 up to rounding: the
        stability of the other end is used."""
        first, second = self.stability[:-1], self.stability[1:]
        is_located = np.isin(self.kind, list(self.results.located_kinds))
        if self.kind.size:
            first, second = (
                np.where(is_located[:-1] & (first == 0), second, first),
                np.where(is_located[1:] & (second == 0), first, second),
            )
        return np.where((first < 0) | (second < 0), -1, np.minimum(first, second))

    @property
    def jumps(self) -> list[tuple[float, float, float, float]]:
        """(x, y, x and y of the motion after the jump): for a sweep between its branches, for a curve that was followed at its
        folds, over the value along the curve."""
        moving = self.results.curve
        if moving is None or (self.results.curve_jumps and self.is_over(moving)):
            before = np.flatnonzero(self.is_jump & np.isfinite(self.y[1:]) & np.isfinite(self.y[:-1]))
            forth = self.points[before] < self.points[before + 1]
            start, end = np.where(forth, before, before + 1), np.where(forth, before + 1, before)
            return list(zip(self.x[start], self.y[start], self.x[end], self.y[end]))
        if not self.is_over(moving):
            return []
        bifurcations = [name for name, kind in self.results.located_kinds.items() if kind.is_bifurcation]
        return [(x, y, x, end) for x, y, end in jumps_at_folds(self.x, self.y, self.kind, self.stability, bifurcations)]

    def is_over(self, moving: Parameter) -> bool:
        """Whether the x axis is that value, in any unit."""
        values = self.results.shown(moving).values[self.points]
        return bool(self.kind.size) and np.array_equal(self.x, values, equal_nan=True)

    def is_special(self, kind: str) -> np.ndarray:
        """Which points are folds, peaks, or another kind."""
        return self.kind == kind if self.kind.size else np.zeros(self.points.size, dtype=bool)


def write_response(
    files: list[tuple[str, Results]],
    dof: str | None,
    path: Path,
    *,
    measure: Measure,
    over: str | None = None,
    where=None,
    n_curves: int = N_CURVES,
) -> None:
    """Writes the curves of `draw_response` as a text table, a row a point in the order along each curve, with all digits."""
    rows, header, axis = [], [], None
    for name, file in files:
        wanted = max(1, n_curves // len(files))
        found, its_axis, _ = curves_of(file, name if len(files) > 1 else "", dof, measure, over, where, wanted, axis)
        axis = axis or its_axis
        of = file.default_dof(measure.quantity) if dof is None else dof
        quantity = re.sub(r"[$\\{}]", "", measure.words(file, of)[0])
        value = style.with_unit(quantity, measure.units(file, of))
        header = header or ["curve", "point", axis.heading, value, "status", "stability", "kind"]
        for curve in found:
            kinds = curve.kind if curve.kind.size else np.full(curve.points.size, "")
            for point, x, y, stability, kind in zip(curve.points, curve.x, curve.y, curve.stability, kinds):
                words = _STABILITY[int(stability)], str(kind)
                rows.append([curve.label, int(point), repr(float(x)) if axis.is_number else x, repr(float(y)),
                             file.status_name(int(point)), *words])  # fmt: skip
    try:
        with atomic_write(path) as name, open(name, "w", newline="", encoding="utf-8") as text:
            csv.writer(text).writerows([header, *rows])
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None


_STABILITY = {1: "stable", -1: "unstable", 0: "unknown"}


def draw_response(
    results: Results,
    dof: str | None = None,
    *,
    measure: Measure | None = None,
    over: str | None = None,
    where=None,
    logarithmic: str | None = None,
    n_curves: int = N_CURVES,
    label: str = "",
    others: list[tuple[str, Results]] = (),
):
    """Curves of `measure` over the parameter `over`, or over `amplitude`, the peak of `dof`.

    Further swept parameters make several curves, at most `n_curves`, spread evenly; `where` selects points with given values. A
    curve is interrupted where a point is not solved and where the motion jumps; solved points that have not converged are marked on
    the curve, others in a row below, one row per curve. `others`: (label, results) of further files. `logarithmic`: `x`, `y`, `xy`
    or `none`; by default x is logarithmic if the sweep is. Curves that were followed (`&curve`) are drawn in the order of their
    arc, with marks at located points, such as folds and peaks; if stability is known, unstable parts are dashed, and arrows lead
    from folds to the motions to which a sweep jumps. A file of normal modes among curves over a frequency is drawn over the
    frequency found, as their backbone curve.
    """
    measure = measure or Measure()
    files = [(label, results), *others]
    curves, notes, axis = [], [], None
    for name, file in files:
        wanted = max(1, n_curves // len(files))
        found, its_axis, note = curves_of(file, name if len(files) > 1 else "", dof, measure, over, where, wanted, axis)
        axis = axis or its_axis
        if _axis_key(its_axis) != _axis_key(axis):
            raise UsageError(f"{file.path}: over {its_axis.heading}, but {results.path} over {axis.heading}: give --over")
        curves += found
        notes += note
    dof = results.default_dof(measure.quantity) if dof is None else dof
    y = np.concatenate([curve.y for curve in curves])
    if not np.isfinite(y).any():
        _refuse(files, curves, measure)
    x = np.concatenate([curve.x for curve in curves])
    what, symbol = measure.words(results, dof)
    words, letter = axis_words(results, axis)
    scales = _scales(logarithmic, axis, x)
    x_factor, x_units = style.unit_scale(np.nanmax(np.abs(x)), axis.units, scales[0] == "log") if axis.is_number else (1.0, "")
    factor, units = style.unit_scale(np.nanmax(np.abs(y)), measure.units(results, dof), scales[1] == "log")
    for scale, numbers, name in zip(scales, (x, y), "xy"):
        n_lost = int((numbers[np.isfinite(numbers)] <= 0.0).sum()) if scale == "log" else 0
        if n_lost:
            notes.append(f"{n_lost} points with {name} = 0 or less cannot be drawn on a logarithmic axis")
    rows = [i for i, curve in enumerate(curves) if (~curve.is_solved & np.isfinite(curve.x)).any()]
    with style.look():
        heights = [3.2] + ([_ROW * len(rows)] if rows else [])
        fig = style.figure(7.0, 0.9 + sum(heights))
        keys = [_curve_keys(curves, axis.is_number), [*_special_keys(curves), *_status_keys(curves)]]
        ax, *strips = style.below_legends(fig, keys, *heights, hspace=0.0)
        ax.set_xscale(scales[0])
        ax.set_yscale(scales[1])
        for i, curve in enumerate(curves):
            by_stability = axis.is_number and (curve.stability.any() or any(curve is c for c in _of_unknown_stability(curves)))
            _draw_curve(ax, i, curve, x_factor, factor, scales, axis.is_number, by_stability)
        if strips:
            _draw_rows(strips[0], [(i, curves[i]) for i in rows], x_factor, len(curves) > 1)
        below = strips[0] if strips else ax
        below.set_xlabel(style.with_unit(with_symbol(words, letter), x_units))
        ax.set_ylabel(style.with_unit(symbol, units))
        if scales[1] == "linear" and measure.name != "frequency":
            ax.set_ylim(0.0, 1.06 * factor * np.nanmax(y) or 1.0)
        ax.margins(x=0.03)
        for which, scale in zip((ax.xaxis, ax.yaxis), scales):
            if scale == "log":
                style.decade_axis(which, which.get_view_interval())
        ax.grid(True)
        if not axis.is_number:
            values = list(dict.fromkeys(axis.values))
            below.set_xticks(range(len(values)), values)
        if not np.nanmax(np.abs(y)) > 0.0:
            notes.append("zero at all points: nothing moves; nhbm-post multipliers shows the stability of the equilibrium")
        without = sum(int((curve.is_solved & np.isnan(curve.y)).sum()) for curve in curves)
        if without:
            notes.append(f"{without} solved points lack this harmonic")
        chosen = results.where_text(where or {})
        title = results.title if len(files) == 1 else ""
        all_right = all(curve.is_converged.all() for curve in curves)
        outcome = f"all {sum(c.points.size for c in curves)} points converged" if all_right else ""
        style.head(
            fig,
            f"{what} over {words}",
            ", ".join(t for t in (title, chosen, outcome) if t),
            "; ".join(dict.fromkeys(notes)),
        )
    return fig


def curves_of(results, name, dof, measure, over, where, n_curves, axis=None) -> tuple[list[Curve], Parameter, list[str]]:
    """Curves of one file, the quantity on their x axis, and the omitted data."""
    dof = results.default_dof(measure.quantity) if dof is None else dof
    points = np.array(results.select(where) if where else results.used, dtype=int)
    points = points[np.isin(points, results.used)]
    over_tone = axis is not None and axis.path.startswith(_TONES)
    if over_tone and not any(path.startswith(_TONES) for path in results.swept):
        return _backbone(results, name, dof, measure, points, axis)
    names_of_curve = [results.curve.path, results.curve.name] if results.curve else []
    moving = results.curve if over in (None, "amplitude", *names_of_curve) else None
    along = swept = moving or _swept_parameter(results, None if over == "amplitude" else over, points)
    if over == "amplitude":
        peaks = Measure("peak").values(results, dof)
        along = Parameter("amplitude", f"largest displacement of {dof}", results.units("motion", dof), peaks)
    along = results.shown(along)
    x = _positions(along)
    values = measure.values(results, dof)
    others = other_parameters(results, swept, points)
    is_one = moving is not None and results.curve_jumps
    if moving and results.curve_branch().any() and not is_one:
        others.append(Parameter("curve_branch", "curve", "", results.curve_branch().astype(float)))
    groups = groups_of(others, points)
    notes = []
    for follower in list(others[1:]):
        if _varies_along(follower, others[0], points):
            others.remove(follower)
            notes.append(f"{follower.words} changes along with {others[0].words}")
    if len(groups) > n_curves:
        which = np.unique(np.linspace(0, len(groups) - 1, n_curves).round().astype(int))
        what = " and ".join(p.label for p in others)
        all_of_them = "" if moving else ", nhbm-post map draws all"
        notes.append(f"{len(which)} of {len(groups)} curves over {what}: --where chooses{all_of_them}")
        groups = [groups[k] for k in which]
    # Branches are numbered along the fastest parameter of a sweep: along another parameter they do not describe neighbours.
    is_fastest = swept.values[0] != swept.values[min(1, results.n_points - 1)]
    branch = results.branch() if is_fastest and not moving else np.zeros(results.n_points, dtype=int)
    if is_one:
        branch = results.curve_branch() + 1
    if not is_fastest and not moving and others and results.branch().any():
        fastest = next(p.words for p in others[::-1] if p.values[0] != p.values[1])
        notes.append(f"jumps are known along {fastest} alone, not along {swept.words}")
    order = _along_the_arc(results) if moving else _positions(swept)
    if is_one:
        order = np.arange(results.n_points)
    kind = results.curve_kind() if moving else np.full(results.n_points, "")
    curves = []
    for members in groups:
        members = members[np.argsort(order[members], kind="stable")]
        label = ", ".join([name] * bool(name) + [p.text(int(members[0])) for p in others])
        curves.append(Curve(label, results, members, x[members], values[members], branch[members], kind[members]))
    return curves, along, notes


def _along_the_arc(results: Results) -> np.ndarray:
    """Position of each point of a curve in its order: by the arc length; a point at which the curve was lost follows the last
    point."""
    length = results.per_point("curve_length").copy()
    for point in np.flatnonzero(np.isnan(length) & np.isin(np.arange(results.n_points), results.used)):
        length[point] = length[point - 1] if point else 0.0
    return length


def _backbone(results, name, dof, measure, points, axis) -> tuple[list[Curve], Parameter, list[str]]:
    """Motions with unknown frequency as a function of that frequency, in the order of the swept value."""
    tones = results.unknown_tones()
    if tones.size == 0:
        return [], Parameter("", "", "", np.full(results.n_points, np.nan)), []
    factor = 0.5 / np.pi if axis.units == "Hz" else 1.0
    x = np.array([factor * results.frequency(point)[tones[0]] for point in range(results.n_points)])
    swept = _swept_parameter(results, None, points)
    members = points[np.argsort(_positions(swept)[points], kind="stable")]
    y = measure.values(results, dof)[members]
    curve = Curve(name, results, members, x[members], y, results.branch()[members], is_backbone=True)
    return [curve], Parameter(axis.name, axis.path, axis.units, x), []


def _refuse(files, curves, measure) -> None:
    path = files[0][1].path
    if measure.name == "harmonic" and any(curve.is_solved.any() for curve in curves):
        raise UsageError(f"{path}: tuple {tuple_text(measure.j)} is in the set of no converged point")
    outcomes = "; ".join(results.outcome_text() for _, results in files)
    raise UsageError(f"{path}: none of the chosen points is solved; in the file: {outcomes}")


def _curve_look(i: int, is_joined: bool, curve: Curve) -> dict:
    """Colour and line of a curve; only dots over words, which have no order."""
    line = style.REFERENCE if curve.is_backbone else style.STABLE
    line = line if is_joined else "none"
    return {"color": style.COLOURS[i % len(style.COLOURS)], "linestyle": line, "linewidth": 1.4}


def _draw_curve(ax, i, curve: Curve, x_factor, factor, scales, is_joined, by_stability) -> None:
    """The line, its converged points (if there are few, or between gaps), and marks of the others."""
    look = _curve_look(i, is_joined, curve)
    is_drawn = np.isfinite if scales[1] == "linear" else lambda values: values > 0.0
    x, y, status, stability = curve.line(is_drawn)
    if by_stability:
        _draw_by_stability(ax, curve, is_drawn, x_factor, factor, look)
    else:
        ax.plot(x_factor * x, factor * y, **look, gid="curve")
    for kind, shape in _special(curve).items():
        at = curve.is_special(kind)
        ax.plot(x_factor * curve.x[at], factor * curve.y[at], **shape, color=look["color"], gid=kind, zorder=5)
    for at, start, to, end in curve.jumps:
        arrow = {"arrowstyle": "-|>", "mutation_scale": 9.0, "linewidth": 0.8, "shrinkA": 3.0, "shrinkB": 0.0}
        arrow["color"] = look["color"]
        ax.annotate("", (x_factor * to, factor * end), (x_factor * at, factor * start), arrowprops=arrow, gid="jump", zorder=6)
    known = np.isfinite(y) & np.isfinite(x)
    alone = known & ~np.append(known[1:], False) & ~np.insert(known[:-1], 0, False)
    dot = {"color": look["color"], "linestyle": "none", "markersize": 3.4 if is_joined else 5.0}
    for code, shape in marks.DOTS.items():
        is_marked = not is_joined or curve.has_dots or (code == INTEGRATED and curve.is_converged.any())
        for verdict, face in _dot_faces(look["color"], by_stability).items():
            at = (known if is_marked else alone) & (status == code) & ((stability == verdict) | (not by_stability))
            ax.plot(x_factor * x[at], factor * y[at], **dot, marker=shape, markerfacecolor=face, gid=ANSWERS[code])
    _mark(ax, curve, x_factor * curve.x, factor * curve.y, are_solved=True)


def _dot_faces(colour: str, by_stability: bool) -> dict:
    """Colour of the face of a dot by stability: open for an unstable motion, grey for an unknown one."""
    return {1: colour, 0: style.WALL, -1: "white"} if by_stability else {0: colour}


def _shape(marker: str, size: float) -> dict:
    return {"linestyle": "none", "marker": marker, "markersize": size, "markerfacecolor": "white", "markeredgewidth": 1.3}


# Sizes of marks that differ from the usual one.
_SIZES = {"circle": 5.5, "diamond": 5.5, "square": 5.5, "hexagon": 7.0, "pentagon": 6.5}


def _special(curve: Curve) -> dict[str, dict]:
    """The look of each kind of located point of a curve."""
    kinds = curve.results.located_kinds
    return {name: _shape(MARKERS.get(kind.mark, "o"), _SIZES.get(kind.mark, 6.0)) for name, kind in kinds.items()}


def _draw_by_stability(ax, curve: Curve, is_drawn, x_factor, factor, look) -> None:
    """The line, solid between stable points, dashed if one end is unstable, dotted if stability is unknown; interrupted at a
    jump."""
    i, no_line = 0, 2
    y = np.where(is_drawn(curve.y), factor * curve.y, np.nan)
    between = np.where(curve.is_jump, no_line, curve.stability_between)
    while i < between.size:  # sequences of one kind, each drawn as one line
        end = i
        while end < between.size and between[end] == between[i]:
            end += 1
        dashes = {1: style.STABLE, -1: style.UNSTABLE, 0: style.UNKNOWN, no_line: "none"}[int(between[i])]
        if dashes != "none":
            ax.plot(x_factor * curve.x[i : end + 1], y[i : end + 1], **(look | {"linestyle": dashes}), gid="curve")
        i = end


def _mark(ax, curve: Curve, x, y, are_solved: bool, **keywords) -> None:
    """Marks of the points that have not converged, either the solved ones or the others."""
    size = 5.5 if curve.points.size <= 2 * _MANY_POINTS else 4.0
    for name, is_solved, points in marks.by_status(curve.results, curve.points):
        if is_solved == are_solved:
            at = np.isin(curve.points, points)
            ax.plot(x[at], y[at], **marks.mark(name, is_solved).look(size), zorder=4, gid=name, **keywords)


def _draw_rows(strip, curves, x_factor, has_several) -> None:
    """Points that are not solved, one row for each curve that has some."""
    strip.set_ylim(len(curves) - 0.5, -0.5)
    for row, (i, curve) in enumerate(curves):
        colour = style.COLOURS[i % len(style.COLOURS)]
        strip.axhspan(row - 0.46, row + 0.46, color="#eef0f3", linewidth=0.0, zorder=0)
        if has_several:
            strip.plot(
                [-0.055, -0.012], [row, row], color=colour, linewidth=2.0, clip_on=False,
                transform=strip.get_yaxis_transform(),
            )
        _mark(strip, curve, x_factor * curve.x, np.full(curve.points.size, row), are_solved=False, clip_on=False)
    if not has_several:
        strip.set_yticks([0], ["not solved"], size=7.5, color=style.MUTED)
        strip.tick_params(axis="y", length=0.0)
    else:
        strip.set_yticks([])
    strip.grid(True, axis="x")
    strip.spines[["left", "top", "right"]].set_visible(False)


def _curve_keys(curves: list[Curve], is_joined: bool) -> list[Line2D]:
    """Legend of the curves, none for a single one; a common beginning, such as `Gap of stop =`, is written once."""
    if len(curves) < 2:
        return []
    first = curves[0].label.partition("= ")[0] + "= "
    is_common = curves[0].label.count("= ") == 1 and all(curve.label.startswith(first) for curve in curves)
    entries = [Line2D([], [], linestyle="none", label=first[:1].upper() + first[1:].strip())] if is_common else []
    for i, curve in enumerate(curves):
        label = curve.label.removeprefix(first) if is_common else curve.label
        dot = {} if is_joined else {"marker": "o"}
        entries.append(Line2D([], [], **_curve_look(i, is_joined, curve), **dot, label=label))
    return entries


def _of_unknown_stability(curves: list[Curve]) -> list[Curve]:
    """Curves whose stability was sought in vain, or is unknown beside curves of known stability."""
    is_known_of_others = any(curve.stability.any() for curve in curves)
    return [
        curve
        for curve in curves
        if not curve.stability.any() and (curve.results.has_stability or (is_known_of_others and (curve.kind != "").any()))
    ]


def _special_keys(curves: list[Curve]) -> list[Line2D]:
    """Legend of the located points and of dashes, if there are any."""
    entries = []
    for kind, shape in {kind: shape for curve in curves for kind, shape in _special(curve).items()}.items():
        n = sum(int(curve.is_special(kind).sum()) for curve in curves)
        if n:
            look = next(c.results.located_kinds[kind] for c in curves if kind in c.results.located_kinds)
            entries.append(Line2D([], [], **shape, color=style.INK, label=f"{n} {look.label if n == 1 else look.plural}"))
    n_jumps = sum(len(curve.jumps) for curve in curves)
    if n_jumps:
        words = "1 jump" if n_jumps == 1 else f"{n_jumps} jumps"
        entries.append(Line2D([], [], linestyle="none", marker=r"$\downarrow$", markersize=9, color=style.INK, label=words))
    stability = np.concatenate([curve.stability for curve in curves])
    dots = {"marker": "o", "markersize": 3.4} if any(curve.has_dots and curve.stability.any() for curve in curves) else {}
    faces = _dot_faces(style.INK, True)
    if _of_unknown_stability(curves) or any(c.stability.any() and (c.stability_between == 0).any() for c in curves):
        look = {"linestyle": style.UNKNOWN, "linewidth": 1.4, "markerfacecolor": faces[0]} | dots
        entries.append(Line2D([], [], color=style.INK, **look, label="stability not known"))
    for verdict, dashes, word in ((1, style.STABLE, "stable"), (-1, style.UNSTABLE, "unstable")):
        if (stability == verdict).any():
            look = {"linestyle": dashes, "linewidth": 1.4, "markerfacecolor": faces[verdict]} | dots
            entries.append(Line2D([], [], color=style.INK, **look, label=word))
    return entries


def _status_keys(curves: list[Curve]) -> list[Line2D]:
    """Legend of the statuses of the points in the picture; none if all have converged."""
    counts: dict[tuple[str, bool], int] = {}
    status = np.concatenate([curve.results.status[curve.points] for curve in curves])
    n_answers = {code: int((status == code).sum()) for code in ANSWERS}
    for curve in curves:
        for name, is_solved, group in marks.by_status(curve.results, curve.points):
            counts[name, is_solved] = counts.get((name, is_solved), 0) + group.size
    return marks.keys(counts, n_answers) if counts or n_answers[INTEGRATED] else []


def _axis_key(axis: Parameter) -> tuple:
    """The properties that files in one picture must share: parameter and unit, or the words along it; a single tone is the first
    one."""
    return axis.label.removesuffix("(1)"), axis.units, () if axis.is_number else tuple(dict.fromkeys(axis.values))


def _swept_parameter(results: Results, over: str | None, points: np.ndarray) -> Parameter:
    """The parameter of the x axis: the named one, otherwise the number (otherwise the word) with most values."""
    if over is not None:
        return results.parameter(over)
    several = [p for p in results.parameters.values() if len({str(v) for v in p.values[points]}) > 1]
    if several:
        return max(several, key=lambda p: (p.is_number, len(set(p.values[points].tolist()))))
    raise UsageError(
        f"{results.path}: no parameter changes over the chosen {len(points)} point(s); "
        f"a response needs a sweep (swept: {list_text(results.swept)})"
    )


def other_parameters(results: Results, swept: Parameter, points: np.ndarray) -> list[Parameter]:
    """Parameters that change between the lines over `swept`."""
    is_moving = results.curve is not None and swept.name == results.curve.name
    several = [p for p in results.parameters.values() if p.name != swept.name and len({str(v) for v in p.values[points]}) > 1]
    return [p for p in several if is_moving or not _varies_along(p, swept, points)]


def _varies_along(other: Parameter, swept: Parameter, points: np.ndarray) -> bool:
    """Whether each value of `swept` occurs with one value of `other`: parameters that vary together on one axis of a sweep."""
    pairs = {(str(swept.values[point]), str(other.values[point])) for point in points}
    return len(pairs) == len({value for value, _ in pairs})


def groups_of(others: list[Parameter], points: np.ndarray) -> list[np.ndarray]:
    """Points by the values of the other swept parameters, in ascending order of the values."""
    members: dict[tuple, list[int]] = {}
    for point in points:
        members.setdefault(tuple(p.values[point] for p in others), []).append(int(point))
    return [np.array(members[key], dtype=int) for key in sorted(members)]


def _positions(parameter: Parameter) -> np.ndarray:
    """Position of each point on the x axis: the value, or the number of the word in order of appearance."""
    if parameter.is_number:
        return parameter.values
    order = {word: i for i, word in enumerate(dict.fromkeys(parameter.values))}
    return np.array([float(order[word]) for word in parameter.values])


def _scales(logarithmic: str | None, axis: Parameter, x: np.ndarray) -> tuple[str, str]:
    """Scales of both axes, as requested or as in the sweep."""
    if logarithmic is None:
        return ("log" if axis.is_number and is_logarithmic(x) else "linear"), "linear"
    if "x" in logarithmic and not axis.is_number:
        raise UsageError(f"'{axis.label}' takes words, which have no logarithmic axis")
    return tuple("log" if letter in logarithmic and logarithmic != "none" else "linear" for letter in "xy")


def is_logarithmic(x: np.ndarray) -> bool:
    """Whether a sweep extends over two decades or more with approximately equal ratios."""
    x = np.unique(x[np.isfinite(x)])
    if len(x) < 3 or x[0] <= 0.0 or x[-1] < 99.0 * x[0]:
        return False
    ratios = np.diff(np.log(x))
    return bool(ratios.max() < 3.0 * ratios.min())
