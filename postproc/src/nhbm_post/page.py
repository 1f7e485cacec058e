"""One HTML page with the contents of a result file: curves, and for each point spectrum, motion, orbit, shape and error estimate.

The page needs no network and no other file: data as JSON, coefficients as 32-bit floats, drawn by the script in page.html.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import numpy as np

from nhbm.child_process import atomic_write

from .axis_words import axis_words, with_symbol
from .contact import Degrees, Motion, contacts, state_text, summary, work_of
from .errors import ReaderError, UsageError
from .measure import Measure
from .outcome import SOLVED, sentence
from .parameter import Parameter
from .reader import Results
from .structure import harmonic_sizes, has_model, motions, structure_of
from .text import number_text

LARGEST = 5_000_000  # [bytes] of a page
# At most, all halved until the page is small enough: pairs of coefficients, 3.2 MB; points; characters of an input.
_COEFFICIENTS, _POINTS, _TEXT = 300_000, 6_000, 200_000
_LEAST = 1e-6  # harmonics that are smaller everywhere, relative to the largest, are omitted
_N_DOFS = 60
_N_FORCES = 12
_CONTACT_WORK = 5e7  # terms of series, about a second
_N_CURVES = 14
_N_SHAPES, _N_SHAPE_HARMONICS, _SHAPE_NUMBERS = 12, 5, 120_000

# Row of the error estimate: dataset, words, unit.
_ERROR_ESTIMATE = (
    ("truncation_estimate", "Estimated error by truncation", ""),
    ("aliasing_estimate", "Estimated error by aliasing", ""),
    ("level_estimate", "Estimated error by refinement", ""),
    ("residual", "Residual", ""),
    ("penetration", "Penetration of a rigid wall", "m"),
    ("impact_estimate", "Energy of the strongest impact", ""),
    ("combination_frequency", "Smallest combination frequency", "rad/s"),
    ("n_harmonics", "Harmonics", ""),
    ("n_unknowns", "Unknowns", ""),
    ("iterations", "Iterations", ""),
    ("solve_seconds", "Time", "s"),
    ("power_in", "Mean power of the loads", "W"),
    ("power_damping", "Mean loss in the damping", "W"),
)

_GREEK = {"omega": "ω", "Omega": "Ω", "mu": "µ", "alpha": "α", "beta": "β"}
_ONLY_IF_ANY = ("level_estimate", "penetration", "impact_estimate", "power_damping")


def write_page(results: Results, path: Path, model: Path | None = None) -> list[str]:
    """Writes the page; returns a description of the omitted data."""
    template = files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    for halved in range(20):
        data, notes = page_data(results, model, 0.5**halved)
        text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")  # "<!--" would hide </script>
        parts = {"__TITLE__": _escaped(data["title"]), "__DATA__": text}
        page = re.sub("__TITLE__|__DATA__", lambda found, parts=parts: parts[found[0]], template)
        size = len(page.encode())
        if size <= LARGEST:
            break
    else:
        raise UsageError(f"{results.path}: the page would have {size / 1e6:.1f} MB, more than {LARGEST / 1e6:.0f}")
    try:
        with atomic_write(path) as name:
            Path(name).write_text(page, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None
    return notes


def page_data(results: Results, model: Path | None = None, share: float = 1.0) -> tuple[dict, list[str]]:
    """The data of the page, with a share of the largest numbers of points and coefficients, and a description of the omitted
    data."""
    kinds = results.curve_kind() if results.curve else np.full(results.n_points, "")
    found, axis, curve_notes = _curves(results)
    points, point_notes = _some_points(results, kinds, found, int(share * _POINTS))
    dofs, forces, tuples, rows, coefficients, notes = _coefficients(results, points, int(share * _COEFFICIENTS))
    factor, hertz = results.frequency_scale()
    sizes = {dof: Measure().values(results, dof, points) for dof in dofs}
    tones = {
        f"Frequency of tone {m + 1}": Measure("frequency", tone=int(m)).values(results, dofs[0], points)
        for m in results.unknown_tones()
        if axis is None or not axis.path.startswith("tones%")
    }
    shapes, shape_notes = _shapes(results, points, model)
    data = {
        "title": results.title or results.path.stem,
        "file": results.path.name,
        "provenance": _provenance(results),
        "input": _cut(results.input_text, int(share * _TEXT)),
        "complete": _cut(results.input_complete, int(share * _TEXT)),
        "outcome": results.outcome_text(),
        "notes": [*results.curve_ends(), *point_notes, *notes, *curve_notes, *shape_notes],
        "frequency": {"factor": factor, "units": hertz},
        "axis": None if axis is None else _axis(results, axis),
        "curves": _drawn(results, found, points),
        "dofs": [
            {
                "name": results.as_written(dof),
                "units": results.units("motion", dof),
                "what": results.series(_first(results), dof).words,
                "size": _numbers(sizes[dof][points]),
                "index": results.labels().index(dof),
            }
            for dof in dofs
        ],
        "forces": [{"name": f"Force of laws at {results.as_written(dof)}", "units": results.units("force", dof)} for dof in forces],
        "tones": [{"name": name, "values": _numbers(values[points])} for name, values in tones.items()],
        "measure": len(dofs) if tones and axis and axis.path.startswith("normal_mode%") else 0,
        "tuples": tuples.tolist(),
        "events": {name: [kind.mark, kind.label, kind.plural] for name, kind in results.located_kinds.items()},
        "points": _points(results, points, kinds, model),
        "rows": rows,
        "coefficients": base64.b64encode(coefficients.astype("<f4").tobytes()).decode(),
        "shapes": shapes,
    }
    return data, data["notes"]


def _axis(results: Results, axis: Parameter) -> dict:
    label = re.sub(r"[$\\{}]", "", with_symbol(*axis_words(results, axis)))
    for name, letter in _GREEK.items():
        label = label.replace(f" {name}", f" {letter}")
    return {"label": label, "units": axis.units, "words": [] if axis.is_number else list(dict.fromkeys(axis.values))}


def _first(results: Results) -> int:
    if results.solved.size == 0:
        raise ReaderError(f"{results.path}: no point is solved: {results.outcome_text()}")
    return int(results.solved[0])


def _some_points(results: Results, kinds: np.ndarray, curves: list, most: int) -> tuple[list[int], list[str]]:
    """All used points, or so many: located points of curves such as folds, all of the curves that are shown if they fit, and
    others evenly over the file."""
    used = results.used.astype(int)
    if len(used) <= most:
        return used.tolist(), []
    is_located = np.isin(kinds[used], list(results.located_kinds))
    located, others = used[is_located], used[~is_located]
    located = _evenly(located, 3 * most // 4)
    shown = {int(point) for curve in curves for point in curve.points}
    if len(located) + len(shown) < most:
        located, what = [*located, *shown], "those of the curves first"
    else:
        what = "located points first"
    chosen = sorted({_first(results), *located, *_evenly(others, max(2, most - len(located)))})
    return chosen, [f"{len(chosen)} of {len(used)} points are in this page, evenly over the file, {what}"]


def _evenly(values, most: int) -> list[int]:
    """So many of the values at most, evenly spread, with both ends."""
    if len(values) <= most:
        return [int(value) for value in values]
    return [int(values[k]) for k in np.unique(np.linspace(0, len(values) - 1, most).round().astype(int))]


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}\n... {len(text) - most} more characters, in the result file"


def _coefficients(results: Results, points: list[int], max_pairs: int):
    """Degrees of freedom, those with forces of laws, tuples, row of each point (-1: none) and coefficients (rows, dofs and then
    forces, tuples, 2), NaN for missing ones."""
    _first(results)
    labels = results.labels()
    first = [label for label in results.law_dofs if label in labels]
    dofs = [*first, *(label for label in labels if label not in first)]
    solved = [point for point in points if results.status[point] in SOLVED]
    by_tuple = {tuple(int(k) for k in j): i for i, j in enumerate(results.tuples)}
    largest = np.zeros(len(by_tuple))
    for dof in dofs[:3]:
        for _, series in results.all_series(dof, points=solved):
            at = [by_tuple[tuple(int(k) for k in j)] for j in series.tuples]
            whole = series.amplitudes.max(initial=0.0)
            if whole > results.noise(solved[0], units=series.units):
                largest[at] = np.maximum(largest[at], series.amplitudes / (whole or 1.0))
    shown = np.flatnonzero(largest > _LEAST)
    shown = shown if shown.size else np.arange(1)
    row_of = np.full(len(by_tuple), -1)
    row_of[shown] = np.arange(shown.size)
    notes = []
    n_dofs = int(np.clip(max_pairs // (len(solved) * shown.size), 1, min(_N_DOFS, len(dofs))))
    forces = first[: min(_N_FORCES, n_dofs)] if results.has("force_coefficients") else []
    if n_dofs < len(dofs):
        notes.append(f"{n_dofs} of {len(dofs)} degrees of freedom are in this page")
    most = max(1, max_pairs // ((n_dofs + len(forces)) * shown.size))
    if most < len(solved):
        notes.append(f"{most} of {len(solved)} solved points have their motion in this page")
        solved = _evenly(solved, most)
    row = {point: i for i, point in enumerate(solved)}
    values = np.full((len(solved), n_dofs + len(forces), shown.size, 2), np.nan, dtype=np.float32)
    for d, (quantity, dof) in enumerate([*(("motion", dof) for dof in dofs[:n_dofs]), *(("force", dof) for dof in forces)]):
        for point, series in results.all_series(dof, quantity, solved):
            series = series.without_noise(results.noise(point, quantity, series.units))
            at = row_of[[by_tuple[tuple(int(k) for k in j)] for j in series.tuples]]
            values[row[point], d, at[at >= 0], 0] = series.cos[at >= 0]
            values[row[point], d, at[at >= 0], 1] = series.sin[at >= 0]
    return dofs[:n_dofs], forces, results.tuples[shown], [row.get(point, -1) for point in points], values, notes


def _curves(results: Results) -> tuple[list, Parameter | None, list[str]]:
    """The curves of the file as in pictures; none without a swept parameter."""
    from .draw.response import curves_of

    try:
        return curves_of(results, "", results.default_dof(), Measure(), None, None, _N_CURVES)
    except UsageError:
        return [], None, []


def _drawn(results: Results, found: list, points: list[int]) -> list[dict]:
    """Points in the order of their curves with positions on the x axis, without jumps."""
    row = {point: i for i, point in enumerate(points)}
    curves = []
    for curve in found:
        at = [k for k, point in enumerate(curve.points) if int(point) in row]
        steps = list(zip(at, at[1:]))
        curves.append({
            "label": curve.label,
            "points": [row[int(curve.points[k])] for k in at],
            "x": _numbers(curve.x[at]),
            "between": [int(curve.stability_between[a:b].min()) for a, b in steps],
            "breaks": [k for k, (a, b) in enumerate(steps) if curve.is_jump[a:b].any()],
            "falls": [_numbers(np.array(jump)) for jump in curve.jumps] if results.curve else [],
        })  # fmt: skip
    return [curve for curve in curves if curve["points"]]


def _points(results: Results, points: list[int], kinds: np.ndarray, model: Path | None) -> dict:
    """The data of the points except their motions: a list for each value, a table of the rows; each word once."""
    is_solved = np.isin(results.status[points], SOLVED)
    names = [results.status_name(point) for point in points]
    frequencies = results.column("frequency")[points]
    return {
        "number": points,
        "status": _in_words(names),
        "solved": is_solved.tolist(),
        "message": _in_words([results.message(point) for point in points]),
        "kind": [str(kind) if kind in results.located_kinds else "" for kind in kinds[points]],
        "stable": [int(stable) for stable in results.stability()[points]],
        "omega": [_numbers(omega) for omega in frequencies],
        "means": {name: sentence(name) for name in dict.fromkeys(names)},
        "rows": [
            [label, texts]
            for label, texts in (*_rows(results, points, is_solved, frequencies), *_contact_rows(results, points, is_solved, model))
            if any(texts)
        ],
    }


def _in_words(texts: list[str]) -> dict:
    number = {text: k for k, text in enumerate(dict.fromkeys(texts))}
    return {"words": list(number), "at": [number[text] for text in texts]}


def _rows(results: Results, points: list[int], is_solved: np.ndarray, frequencies: np.ndarray) -> Iterator[tuple[str, list]]:
    """Label and texts of each value of the error estimate, None at points that lack it."""
    factor, hertz = results.frequency_scale()
    for parameter in results.parameters.values():
        yield parameter.label, [parameter.value_text(value) for value in parameter.values[points]]
    for m, omega in enumerate(factor * frequencies.T):
        yield f"Tone {m + 1}", [f"{w:.7g} {hertz}" if solved else None for w, solved in zip(omega, is_solved)]
    for column, label, unit in _ERROR_ESTIMATE:
        if not results.has(column) or (column == "combination_frequency" and results.n_tones == 1):
            continue
        values = (factor if unit == "rad/s" else 1.0) * results.per_point(column)[points]
        is_shown = is_solved & np.isfinite(values) & ((values != 0.0) | (column not in _ONLY_IF_ANY))
        yield label, _texts(values, is_shown, ".3g", hertz if unit == "rad/s" else unit)
    if results.has("multiplier_real"):
        largest = np.abs(results.multipliers()[points])
        is_known = is_solved & np.isfinite(largest).any(axis=1)
        yield "Largest Floquet multiplier", _texts(np.nanmax(largest, axis=1, initial=0.0), is_known, ".4g", "")


def _contact_rows(results: Results, points: list[int], is_solved: np.ndarray, model: Path | None) -> list[tuple[str, list]]:
    """The state of each contact: the shares of time that it is open, sticks and slips, at as many points as the work allows."""
    solved = [k for k, is_one in enumerate(is_solved) if is_one]
    if not solved or not results.law_dofs:
        return []
    rows: dict[str, list[str | None]] = {}
    try:
        structure = structure_of(results, points[solved[0]], model) if model or has_model(results) else Degrees(results)
        found = [one for one in contacts(results, structure, points[solved[0]]) if one.table is None]
        work = work_of(found, Motion(results, points[solved[0]], True), len(results.tuples))
        n = min(len(solved), int(_CONTACT_WORK / max(work, 1.0))) if found else 0
        for k in np.unique(np.linspace(0, len(solved) - 1, n).round().astype(int)).tolist():
            at, point = solved[k], points[solved[k]]
            motion, power = Motion(results, point, True), np.full(len(results.laws), np.nan)
            for contact in contacts(results, structure, point):
                if contact.table is None:
                    texts = rows.setdefault(f"Contact {contact.label}", [None] * len(points))
                    texts[at] = state_text(contact, summary(contact, motion, power))
    except (ReaderError, UsageError):  # without the model, or of degrees of freedom that are not stored
        return []
    return list(rows.items())


def _texts(values: np.ndarray, is_shown: np.ndarray, digits: str, unit: str) -> list[str | None]:
    return [f"{number_text(float(f'{v:{digits}}'))} {unit}".rstrip() if shown else None for v, shown in zip(values, is_shown)]


def _shapes(results: Results, points: list[int], model: Path | None) -> tuple[dict | None, list[str]]:
    """Edges of a finite element model, and harmonics of its nodes at some points; none without such a model."""
    if model is None and not has_model(results):
        return None, []
    from .draw.deflection import surface

    try:
        structure = structure_of(results, _first(results), model)
        faces = surface(structure.cells)
        edges = {tuple(sorted((face[k - 1], face[k]))) for face in faces for k in range(len(face)) if face[k - 1] != face[k]}
        nodes = sorted({node for edge in edges for node in edge})
        n = max(1, min(_N_SHAPES, _SHAPE_NUMBERS // (6 * _N_SHAPE_HARMONICS * max(1, len(nodes)))))
        solved = [point for point in points if results.status[point] in SOLVED]
        chosen = [solved[k] for k in np.unique(np.linspace(0, len(solved) - 1, min(n, len(solved))).round().astype(int))]
        shapes = {str(points.index(point)): _shape(results, structure, point, nodes) for point in chosen}
    except (ReaderError, UsageError) as error:
        return None, [f"without the finite element model: {error}"]
    if 6 * _N_SHAPE_HARMONICS * len(nodes) > _SHAPE_NUMBERS:
        return None, [f"without the finite element model: {len(nodes)} nodes are too many for this page"]
    index = {node: i for i, node in enumerate(nodes)}
    return {
        "nodes": _numbers(structure.points[nodes].ravel()),
        "edges": [index[node] for edge in sorted(edges) for node in edge],
        "at": shapes,
    }, [f"3-D shapes are included for {len(chosen)} of {len(solved)} points"] * (len(chosen) < len(solved))


def _shape(results: Results, structure, point: int, nodes: list[int]) -> dict:
    """The largest harmonics of a motion as displacements of nodes, cos and sin."""
    tuples, _, coefficients = motions(results, structure, point)
    size = harmonic_sizes(coefficients)
    shown = [int(h) for h in np.argsort(-size, kind="stable")[:_N_SHAPE_HARMONICS] if size[h] > 1e-3 * size.max()]
    fields = [structure.displacement(part)[nodes] for h in shown for part in (coefficients[:, h].real, -coefficients[:, h].imag)]
    return {"tuples": tuples[shown].tolist(), "fields": base64.b64encode(np.array(fields).astype("<f4").tobytes()).decode()}


def _provenance(results: Results) -> list[list[str]]:
    facts = [
        ["File", results.path.name],
        ["Written by", f"nhbm {results.program_version}, commit {results.git_commit}"],
        ["Created", results.created_utc],
        ["Ranks", str(results.n_ranks)],
        ["Changed by --set", results.overrides],
        ["Swept", "; ".join(parameter.range_text() for parameter in results.parameters.values())],
        ["Amplitudes", results.amplitude_convention],
    ]
    return [fact for fact in facts if fact[1]]


def _numbers(values: np.ndarray) -> list[float | None]:
    """Rounds to seven digits; values that are not finite become null."""
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
