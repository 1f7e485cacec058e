"""Text tables of the contents of a file, and single numbers."""

from __future__ import annotations

import numpy as np

from .errors import ReaderError
from .outcome import CRASHED, EMPTY, PENDING, SOLVED
from .reader import Results
from .text import list_text, number_text, tuple_text

_N_AMPLITUDES = 3


def info(results: Results, dof: str | None = None, max_points: int = 20) -> str:
    """Table of a file: origin, size, outcome, and one row per point with its largest amplitudes of `dof`."""
    dof = results.default_dof() if dof is None else dof
    if dof not in results.dofs:
        raise ReaderError(f"{results.path}: no degree of freedom '{dof}'; stored: {list_text(results.dofs)}")
    sweeps = [p.range_text() for p in results.parameters.values()] or ["nothing"]
    counts = ", ".join(f"{n} {name}" for name, n in results.status_counts(results.used).items())
    facts = [
        ("file", str(results.path)),
        ("title", " ".join(results.title.split("\n")) or "-"),
        ("written by", f"nhbm {results.program_version}, commit {results.git_commit}, {results.created_utc}"),
        ("run on", f"{results.n_ranks} rank{'s' if results.n_ranks != 1 else ''}"),
        ("tones", str(results.n_tones)),
        ("harmonics", f"{results.n_harmonics} in the union of all points"),
        ("dofs", list_text(results.dofs)),
        ("with laws", list_text(results.law_dofs)),
        *(("swept", text) for text in sweeps),
        *(("output", text) for text in _outputs(results)),
        *(("energies", text) for text in _energies(results)),
        ("points", f"{results.used.size}: {counts}"),
        ("complete", _completeness(results)),
        *(("ended", text) for text in results.curve_ends()),
    ]
    lines = [f"{name:<11}{value}" for name, value in facts]
    n = results.used.size
    shown = min(max_points, n)
    if shown > 0:
        lines += ["", *_table(_point_rows(results, dof, results.used[:shown]))]
    if shown < n:
        lines.append(f"... {n - shown} more points; --points {n} shows all")
    return "\n".join(lines)


def _outputs(results: Results) -> list[str]:
    """Outputs to which a tolerance applies, with the largest estimated error of each."""
    estimates = [(name, found[np.isfinite(found)]) for name, found in results.output_estimates()]
    return [f"{name}: estimated error {number_text(found.max())} or less" for name, found in estimates if found.size > 0]


def _energies(results: Results) -> list[str]:
    """Mean energies and losses, over all points where they are known."""
    texts = []
    for name, unit in (("energy_kinetic", " J"), ("energy_strain", " J"), ("loss_factor", ""), ("equivalent_damping", " 1/s")):
        values = results.per_point(name) if results.has(name) else np.array([])
        values = values[np.isfinite(values)]
        if values.size > 0:
            ends = list(dict.fromkeys(number_text(value) for value in (values.min(), values.max())))
            texts.append(f"{name.removeprefix('energy_').replace('_', ' ')} {' to '.join(ends)}{unit}")
    return [", ".join(texts)] if texts else []


def _completeness(results: Results) -> str:
    """Whether points remain, and the command that solves them; in the words of `nhbm info`."""
    n_left = int((results.status == PENDING).sum())
    if n_left == 0:
        return "yes"
    left, them = ("1 point left", "it") if n_left == 1 else (f"{n_left} points left", "them")
    return f"no, {left}; nhbm resume {results.path} solves {them}"


def value(
    results: Results, point: int, dof: str, j, quantity: str = "motion", allow_unconverged: bool = False
) -> str:
    """`cos sin amplitude` of one harmonic with 17 digits, enough to reproduce the stored numbers."""
    cos, sin = results.coefficients(point, dof, j, quantity, allow_unconverged)
    return " ".join(f"{number:.16e}" for number in (cos, sin, np.hypot(cos, sin)))


def peaks(files: list[tuple[str, Results]], measure, dof: str | None = None) -> str:
    """Table of the located points of curves: folds, peaks, ends, with the measure there."""
    rows = []
    for name, results in files:
        curve = results.curve
        if curve is None:
            raise ReaderError(f"{results.path}: no curve was followed (&curve); nhbm-post response shows sweeps")
        shown = results.default_dof(measure.quantity) if dof is None else dof
        others = [p for p in results.parameters.values() if p is not curve]
        units = measure.units(results, shown)
        heading = ["point", *(p.heading for p in others), "kind", curve.heading, "stable", "status"]
        heading = [*(["file"] if len(files) > 1 else []), *heading]
        if not rows or rows[0][:-1] != heading:
            rows.append([*heading, measure.words(results, shown)[0].lower() + (f" [{units}]" if units not in ("", "1") else "")])
        values, kinds, stability = measure.values(results, shown), results.curve_kind(), results.stability()
        for point in results.used:
            if kinds[point] == "regular":
                continue
            row = [str(point), *(number_text(p.values[point]) if p.is_number else p.values[point] for p in others)]
            row += [kinds[point], f"{curve.values[point]:.10g}", {1: "yes", -1: "no"}.get(int(stability[point]), "-")]
            row += [results.status_name(point), f"{values[point]:.10g}"]
            rows.append([*([name] if len(files) > 1 else []), *row])
    return "\n".join(_table(rows))


def _point_rows(results: Results, dof: str, points) -> list[list[str]]:
    parameters = list(results.parameters.values())
    units = results.units("motion", dof)
    unknown = results.unknown_tones()
    heading = ["point", *(p.heading for p in parameters), "status", "iterations", "residual", "seconds"]
    heading += [f"tone {m + 1} [rad/s]" for m in unknown]
    rows = [[*heading, f"largest amplitudes of {dof}" + (f" [{units}]" if units not in ("", "1") else "")]]
    columns = [results.per_point(name) for name in ("iterations", "residual", "solve_seconds")]
    for point in points:
        row = [str(point), *(number_text(p.values[point]) for p in parameters), results.status_name(point)]
        if results.status[point] in (PENDING, CRASHED):
            row += ["-", "-", "-", *("-" for _ in unknown)]
        else:
            iterations, residual, seconds = (column[point] for column in columns)
            row += [str(int(iterations)), f"{residual:.2e}", f"{seconds:.3g}"]
            row += [_frequency_text(results, point, m) for m in unknown]
        rows.append([*row, _last_column(results, point, dof)])
    return rows


def _frequency_text(results: Results, point: int, tone: int) -> str:
    """Frequency with the digits that its estimated error permits."""
    frequency, error = results.frequency(point)[tone], results.frequency_estimate(point)[tone]
    if not np.isfinite(frequency):
        return "-"
    if not np.isfinite(error):
        return f"{frequency:.6g}"
    error = max(error, np.spacing(frequency))
    return f"{frequency:.{min(15, max(0, int(np.ceil(-np.log10(error)))))}f}"


def _last_column(results: Results, point: int, dof: str) -> str:
    """Largest amplitudes of a solved point, the cause of a failure, or the different motions."""
    if results.status[point] in EMPTY or results.status_name(point) in ("collapsed", "no_motion", "locked", "multiple_attractors"):
        return results.message(point) or "-"
    try:
        series = results.series(point, dof, allow_unconverged=True)
    except ReaderError:
        return results.message(point) or "-"
    if not np.any(series.amplitudes):
        return "0"
    largest = np.argsort(series.amplitudes, kind="stable")[::-1][:_N_AMPLITUDES]
    texts = [f"{tuple_text(series.tuples[k])} {series.amplitudes[k]:.4e}" for k in largest]
    return "  ".join(texts) + ("" if results.status[point] in SOLVED else "  (not a solution)")


def _table(rows: list[list[str]]) -> list[str]:
    """Columns of equal width, numbers right-aligned; the last column is unchanged."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return [
        "  ".join([*(text.rjust(width) for text, width in zip(row, widths)), row[-1]]).rstrip()
        for row in rows
    ]
