"""Motions as xarray.Dataset: the columns of the result file (docs/user/schema.md), outcomes as words. What users need is in the
dataset; what describes the search, `details`, is beside it."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from nhbm.errors import ModelError, imported

if TYPE_CHECKING:
    from nhbm.session import Session

SOLVED = "converged truncated aliased penetrating impact integrated multiple_attractors".split()  # there is a motion
END = 6  # as `curve_kind`
CUT_SHORT, GRAZED = 8, 9  # as `reason`: a curve continues beyond its last point; it ends at a grazing impact
AMPLITUDES = (
    "x(t) = sum over harmonics h of [ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], j_h = tuple[h, :]"
)
_MAIN = (
    "status message n_harmonics tuple tuples coefficients force_coefficients improved_coefficients truncation_estimate "
    "aliasing_estimate frequency_estimate output_estimate penetration stability n_unstable exponent multiplier_real "
    "multiplier_imag power_in power_damping power_laws curve_kind curve_branch curve_length gradient frequency_gradient "
    "gradient_estimate gradient_defect position_gradient displacement_samples corrected_samples force_samples"
).split()
_COORDINATES = "frequency", "tuple", "tuples"
TUPLE = {"long_name": "integer tuple j of each harmonic", "units": "1"}
CENSUS = {  # what varies over the motions of a census, and is a whole number or a text
    "census_motion": "number of the motion, by size",
    "census_found": "random starts that led to the motion",
    "census_start": "start that found the motion",
    "census_mirror_of": "motion whose mirror image this is; -1: none",
}
Absent = Any  # type, axes and attributes of a column
_DETAILS = "nhbm_details"  # in the encoding of a dataset, which selections keep
_NAMES = {"is_stable": "stability"}  # columns that have another name as words


class Source:
    """What the motions of a dataset belong to: the input with all values, and what the library is."""

    def __init__(self, text: str, has_own_tuples: bool, libraries: str = "", folder: Path = Path(), structure: Any = None) -> None:
        self.text, self.has_own_tuples, self.libraries = text, has_own_tuples, libraries
        self.folder, self.structure = folder, structure
        self.absent: dict[str, Absent] = {}  # columns of files that are not known
        self.labels: dict[str, list[str]] = {}  # along axes of such columns
        self.n_points: int | None = None  # of a sweep or curve
        self.is_complete = True  # the curve was not stopped before its end
        self.is_of_file = False  # the text is the one that the program wrote


def open_dataset(path: str | Path) -> xr.Dataset:
    """Opens a result file of `nhbm solve` or of `dataset.nhbm.save`.

    Parameters
    ----------
    path : str or Path
        The file. Needs h5netcdf, which is installed with the package.

    Returns
    -------
    xarray.Dataset
        As returned by `Model.solve`, `curve` and `sweep` (docs/user/schema.md), read on demand, without the unused rows of
        curves. A file of one motion has no dimension `point`.
    """
    from nhbm import files

    imported("h5netcdf", "result files are opened with")
    return files.opened(path)


def described_find(name: str) -> dict[str, str]:
    """Attributes of a column of `CENSUS`."""
    return {"parameter": name.replace("_", "%", 1), "long_name": CENSUS[name], "units": "1"}


def record_beside(motion: xr.Dataset) -> tuple[xr.Dataset, Source] | None:
    """Details and source of a result, if it still has them."""
    found: tuple[xr.Dataset, Source] | None = motion.encoding.get(_DETAILS)
    return found


def refinement_of(data: xr.Dataset) -> Any:
    """Estimated errors by refinement, zero for motions with larger other estimates; None if no motion has one."""
    if data.encoding.get(_DETAILS) is None:
        return None
    found = data.nhbm.details.get("level_estimate")
    return found.values if found is not None and (found.values > 0).any() else None


def has_own_tuples(motion: xr.Dataset) -> bool:
    """Whether the harmonics of a motion were chosen for its tolerance; assumed where its details were lost."""
    found = motion.encoding.get(_DETAILS)
    return found is None or bool(found[1].has_own_tuples)


def check_found(data: xr.Dataset, name: str) -> None:
    """Raises ModelError, with the status and the reason, if a dataset lacks a column, or the tuples of it, because no motion was
    found; or if it is a motion by itself, no point of others, whose coefficients are the last iterate."""
    check_result(data, name)
    has_points = "point" in data.variables
    if "status" not in data or (has_points and name in data.variables and {"tuple", "tuples"} & set(data.variables)):
        return
    check_motion(data, f", so there are no '{name}'")
    if "coefficients" not in data:
        raise ModelError(f"this dataset has numbers, not motions: {', '.join(map(str, data.data_vars))}")


def check_result(data: xr.Dataset, name: str = "coefficients") -> None:
    """Raises ModelError if a dataset has neither a column nor any other sign of a result."""
    if not {name, "coefficients", "status", "displacement", "integration_verdict"} & set(data.variables):
        raise ModelError(f"this dataset is no result of nhbm: it has no '{name}'")


def check_points(data: xr.Dataset) -> None:
    """Raises ModelError if the points of a result lie along other axes than `point`."""
    axes = [str(axis) for axis in data["status"].dims if axis != "point"] if "status" in data else []
    if not axes:
        return
    back = "swap_dims" if "point" in data.coords else "rename"
    back = f"dataset.{back}({axes[0]}='point')" if len(axes) == 1 else f"dataset.stack(point={axes})"
    raise ModelError(f"the points are along {' and '.join(map(repr, axes))}; here their axis must be 'point': {back}")


def check_motion(data: xr.Dataset, what: str = "") -> None:
    """Raises ModelError, with the status and the reason, if a dataset has no motion."""
    statuses = np.unique(data["status"].values).tolist() if "status" in data else SOLVED
    if not set(statuses) & set(SOLVED):
        raise ModelError(f"no motion was found (status {', '.join(statuses)}){what}. {data.nhbm.message}".rstrip())


# Motions of a session


def motion_of(session: Session) -> xr.Dataset:
    """The columns of the motion found last, with numbers for words: a row of `result_of`."""
    columns = {name: session.column(name) for name in session.columns()}
    columns = {name: column for name, column in columns.items() if column.values is not None}
    layout = (columns["tuples"].values.tobytes(), tuple((name, column.values.shape) for name, column in columns.items()))
    if session.empty is None or session.empty[0] != layout:  # what motions of one layout share takes most of the time
        session.empty = layout, _dataset_of(session, columns)
    empty: xr.Dataset = session.empty[1]
    return empty.copy(data={name: column.values for name, column in columns.items()})


def _dataset_of(session: Session, columns: Mapping[str, Any]) -> xr.Dataset:
    variables: dict[str, Any] = {}
    lengths: dict[str, int] = {}
    for name, column in columns.items():
        lengths.update(zip(column.axes, column.values.shape))
        variables[name] = (column.axes if column.values.ndim else (), column.values, column.attributes())
    return xr.Dataset(variables, _labels(session, lengths))


def _labels(session: Session, lengths: Mapping[str, int]) -> dict[str, Any]:
    """Coordinates along the axes that there are."""
    labels: dict[str, Any] = {}
    for axis, n in lengths.items():
        words = session.labels(axis) if axis != "multiplier" else []
        what = {"long_name": AXES[axis], "units": "1"} if axis in AXES else {}
        if axis == "component":
            labels[axis] = axis, ["cos", "sin"], what
        elif len(words) == n > 0:
            labels[axis] = axis, words, what
        else:
            labels[axis] = axis, np.arange(1 if axis == "tone" else 0, n + (axis == "tone"), dtype=np.int32), what
    if session.dofs_of_sets and "dof" in labels:
        labels["dof_of_set"] = "dof", names_of_dofs(session.dofs_of_sets, labels["dof"][1])
    return labels


def names_of_dofs(dofs_of_sets: Mapping[str, str], labels: Iterable[str]) -> list[str]:
    """The names that sets of one node give to each degree of freedom, separated by blanks."""
    return [" ".join(name for name, dof in dofs_of_sets.items() if dof == label) for label in labels]


AXES = {
    "attempt": "number of the attempt, from 0",
    "point": "number of the sweep point, from 0",
    "tone": "number of the tone, from 1",
    "harmonic": "number of the harmonic, from 0",
    "dof": "stored degree of freedom",
    "law": "law, by its label",
    "law_dof": "degree of freedom on which laws act",
    "component": "part of a coefficient",
    "multiplier": "number of the multiplier, from 0",
    "output": "output that the tolerance is for, as the input has it",
    "gradient_value": "value by which motions are differentiated, as the input has it",
    "curve_unknown": "number of the unknown of the curve, from 0",
}


def absent_from(session: Session) -> dict[str, Absent]:
    """Columns of files whose values are not known for the last motion of a session."""
    columns = {name: session.column(name) for name in session.columns()}
    absent = {name: column for name, column in columns.items() if column.values is None}
    found = {name: (session.kind_of(name), column.axes, column.attributes()) for name, column in absent.items()}
    for name, unit, meaning in _OF_STABILITY:
        if name not in columns:
            found[name] = np.dtype(float), ("multiplier",), {"units": unit, "long_name": meaning}
    return found


_OF_STABILITY = (
    ("exponent", "1/s", "growth rates of disturbances, the largest first"),
    ("multiplier_real", "1", "Floquet multipliers, the largest first: real parts"),
    ("multiplier_imag", "1", "Floquet multipliers, the largest first: imaginary parts"),
)


def joined(motions: list[xr.Dataset]) -> xr.Dataset:
    """Motions of sessions as the points of one dataset, in their order; what a motion lacks is padded as in the result file."""
    if not motions:
        raise ValueError("there are no motions to join")
    longest: dict[Any, int] = {axis: max(m.sizes.get(axis, 0) for m in motions) for m in motions for axis in m.sizes}
    variables: dict[Any, Any] = {}
    for name in dict.fromkeys(name for m in motions for name in m.data_vars):
        first = next(m[name] for m in motions if name in m)
        rows = [_padded(m.get(name), first, longest) for m in motions]
        variables[name] = (("point", *first.dims), np.stack(rows), first.attrs)
    labels: dict[Any, Any] = {axis: next(m[axis].variable for m in motions if m.sizes.get(axis) == n)
                              for axis, n in longest.items()}  # fmt: skip
    labels["point"] = "point", np.arange(len(motions), dtype=np.int32), {"long_name": AXES["point"], "units": "1"}
    if "dof_of_set" in motions[0].coords:
        labels["dof_of_set"] = "dof", motions[0].coords["dof_of_set"].values
    return xr.Dataset(variables, labels)


def _padded(values: Any, like: xr.DataArray, longest: dict[Any, int]) -> np.ndarray[Any, Any]:
    """Values, or what stands for none, in an array of the longest axes: 0 for whole numbers and beyond the harmonics in use, else
    NaN."""
    shape = tuple(longest[axis] for axis in like.dims)
    is_real = like.dtype.kind == "f"
    if like.dtype.kind in "US":
        return np.array("" if values is None else values.values, dtype=object)
    row = np.full(shape, 0 if not is_real or (values is not None and "harmonic" in like.dims) else np.nan, dtype=like.dtype)
    if values is not None:
        row[tuple(slice(n) for n in values.shape)] = values
    return row


def result_of(columns: xr.Dataset, source: Source, coordinates: Mapping[str, Any], attributes: Mapping[str, Any]) -> xr.Dataset:
    """What users get: words for numbers, coordinates, and the details beside.

    `coordinates` are the values that vary, by name, with their attributes: (values, attributes)."""
    columns = with_words(columns)
    if not source.has_own_tuples and "point" in columns.dims:
        columns["tuple"] = columns["tuples"].isel(point=0)
        columns = columns.drop_vars("tuples")
    elif "point" not in columns.dims:
        columns = columns.rename(tuples="tuple")
    if "tuple" in columns:
        columns["tuple"].attrs.update(TUPLE)
    if coordinates:
        axes = ("point",) if "point" in columns.dims else ()
        columns = columns.assign_coords({name: (axes, values, dict(attrs)) for name, (values, attrs) in coordinates.items()})
    source = copy.copy(source)
    source.n_points = columns.sizes.get("point")
    source.absent, source.labels = dict(source.absent), dict(source.labels)
    return split(columns.assign_attrs(attributes), source)


def with_words(columns: xr.Dataset) -> xr.Dataset:
    """Columns whose numbers have names (flag_meanings) as these names."""
    texts: dict[Any, Any] = {}
    for name, column in columns.variables.items():
        if "flag_meanings" not in column.attrs or name in columns.coords:
            continue
        words = np.array(str(column.attrs["flag_meanings"]).split())
        numbers = np.atleast_1d(column.attrs["flag_values"])
        text = np.full(column.shape, "unknown", dtype=f"<U{max(7, *map(len, words))}")
        for number, word in zip(numbers, words):
            text[column.values == number] = word
        texts[name] = column.dims, text, column.attrs
    return columns.assign(texts).rename({old: new for old, new in _NAMES.items() if old in columns})


def split(columns: xr.Dataset, source: Source | None = None) -> xr.Dataset:
    """A dataset of what users need, with the other columns and the input as its details."""
    columns = columns.set_coords([name for name in _COORDINATES if name in columns.data_vars])
    if "tuple" in columns.coords and columns["tuple"].dims == ("harmonic", "tone"):
        columns = columns.assign_coords({
            f"tuple_{m + 1}": ("harmonic", line, {"long_name": f"entry of the tuple for tone {m + 1}", "units": "1"})
            for m, line in enumerate(columns["tuple"].values.T)
        })  # fmt: skip
    columns = _without_unknown(columns, source)
    main = columns[[name for name in _MAIN if name in columns.data_vars]].assign_attrs(columns.attrs)
    details = columns.drop_vars([name for name in columns.data_vars if name in _MAIN])
    axes = {*main.dims, *(axis for name in _COORDINATES if name in columns.coords for axis in columns[name].dims)}
    others = {name: columns.coords[name] for name in columns.coords if name not in main.coords
              and set(columns[name].dims) <= axes}  # fmt: skip
    main = main.assign_coords(others) if others else main
    main.encoding[_DETAILS] = details, source
    return main


def _without_unknown(columns: xr.Dataset, source: Source | None) -> xr.Dataset:
    """Without the columns for users that are not known at any point, and their axes, which a file has: `source` notes them."""
    reals = {name: columns[name].values for name in _MAIN if name in columns.data_vars and columns[name].dtype.kind == "f"}
    unknown = [name for name, values in reals.items()
               if name not in ("coefficients", "force_coefficients") and values.size and not np.isfinite(values).any()]  # fmt: skip
    if source is not None:
        for name in unknown:
            axes = tuple(axis for axis in columns[name].dims if axis != "point")
            source.absent.setdefault(name, (columns[name].dtype, axes, dict(columns[name].attrs)))
        for axis in ("law", "multiplier"):
            if axis in columns.coords:
                source.labels.setdefault(axis, list(columns[axis].values))
    columns = columns.drop_vars(unknown)
    used = {axis for name in columns.data_vars for axis in columns[name].dims}
    return columns.drop_vars([axis for axis in ("law", "multiplier") if axis in columns.coords and axis not in used])


def record_of(session: Session) -> xr.Dataset:
    """What time integration has found: a record, or the verdict on a motion."""
    columns = {name: session.time_column(name) for name in session.time_columns()}
    variables: dict[str, Any] = {}
    lengths: dict[str, int] = {}
    for name, column in columns.items():
        lengths.update(zip(column.axes, column.values.shape))
        variables[name] = (column.axes, column.values, column.attributes())
    labels = _labels(session, {axis: n for axis, n in lengths.items() if axis != "time"})
    found = xr.Dataset(variables, labels, {"amplitude_convention": AMPLITUDES} if "time" in variables else {})
    return with_words(found)


def number(session: Session, name: str) -> float:
    """A column that is one number."""
    values = session.column(name).values
    return float("nan") if values is None else values.item()


def status_of(session: Session) -> str:
    """Status of the motion found last."""
    return session.words_of("status")[int(number(session, "status"))]


def varies_of(data: xr.Dataset) -> list[str]:
    """Names of the values that vary over the points; netCDF has a list of one name as a text."""
    return [str(name) for name in np.atleast_1d(data.attrs.get("varies", [])) if str(name) in data.variables]


def row_of(found: Any) -> dict[str, Any]:
    """A number, or a mapping or named tuple of numbers, by their names."""
    return dict(found._asdict() if hasattr(found, "_asdict") else found if isinstance(found, Mapping) else {"response": found})


def table(rows: list[dict[str, Any]], coordinates: Mapping[str, Any]) -> xr.Dataset:
    """Named numbers as the points of one dataset; NaN where a row lacks one."""
    variables = {name: ("point", np.array([row.get(name, np.nan) for row in rows])) for name in rows[0]}
    along = {name: ("point", np.asarray(values), dict(attrs)) for name, (values, attrs) in coordinates.items()}
    return xr.Dataset(variables, along)


import nhbm.accessor  # noqa: E402, F401  (every dataset has the accessor `nhbm`)
