"""Motions as xarray.Dataset: the columns of the result file (docs/user/schema.md), outcomes as words. What users need is in the
dataset; what describes the search, `details`, is beside it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from nhbm.errors import ModelError
from nhbm.rows import Layout, Rows
from nhbm.schema import AMPLITUDES, AXES, CENSUS, SOLVED, TUPLE

if TYPE_CHECKING:
    from nhbm.session import Session

_MAIN = (
    "status message n_harmonics tuple tuples coefficients force_coefficients improved_coefficients truncation_estimate "
    "aliasing_estimate frequency_estimate output_estimate penetration stability stability_reason n_unstable exponent "
    "multiplier_real multiplier_imag noise_status noise_variance phase_diffusion power_in power_damping power_laws "
    "curve_kind curve_branch curve_length gradient frequency_gradient "
    "gradient_estimate gradient_defect position_gradient displacement_samples corrected_samples force_samples"
).split()
_COORDINATES = "frequency", "tuple", "tuples"
Absent = Any  # type, axes and attributes of a column
_DETAILS = "nhbm_details"  # in the encoding of a dataset, which selections keep
_NAMES = {"is_stable": "stability"}  # columns that have another name as words
_COLUMNS = {word: name for name, word in _NAMES.items()}


class Source:
    """What the motions of a dataset belong to: the input with all values, and what the library is.

    `text` and `libraries` may be written when they are asked for: by `write`, which returns both."""

    def __init__(self, text: str, has_own_tuples: bool, libraries: str = "", folder: Path = Path(), structure: Any = None,
                 write: Callable[[], tuple[str, str]] | None = None) -> None:  # fmt: skip
        self._texts, self._write = (text, libraries), write
        self.has_own_tuples, self.folder, self.structure = has_own_tuples, folder, structure
        self.absent: dict[str, Absent] = {}  # columns of files that are not known
        self.labels: dict[str, list[str]] = {}  # along axes of such columns
        self.n_points: int | None = None  # of a sweep or curve
        self.is_complete = True  # the curve was not stopped before its end
        self.is_of_file = False  # the text is the one that the program wrote

    @property
    def text(self) -> str:
        """The complete input."""
        return self._written()[0]

    @property
    def libraries(self) -> str:
        """Files on which the model depends, with checksums."""
        return self._written()[1]

    def _written(self) -> tuple[str, str]:
        if self._write is not None:
            self._texts, self._write = self._write(), None
        return self._texts

    def __copy__(self) -> Source:
        other = object.__new__(Source)
        other.__dict__.update(self.__dict__)  # not yet written, either
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_texts": self._written(), "_write": None}


class Record:
    """What is beside a dataset of motions: their source, and their details, which are made when they are asked for."""

    def __init__(self, source: Source, details: xr.Dataset | None = None, rows: Rows | None = None,
                 attributes: Mapping[str, Any] | None = None) -> None:  # fmt: skip
        self.source = source
        self._details, self._rows, self._attributes = details, rows, attributes or {}

    @property
    def details(self) -> xr.Dataset:
        """The columns that users do not need."""
        if self._details is None:
            assert self._rows is not None
            self._details = result_of(columns_of(self._rows, False), self.source, {}, self._attributes).encoding[_DETAILS]._details
            self._rows = None
        return self._details

    def find_odd(self) -> xr.DataArray | None:
        """Whether each motion has only odd tuples; None if that is not known."""
        if self._rows is not None and "is_odd" in self._rows.values:
            return xr.DataArray(self._rows.values["is_odd"][0, ...] == 1)
        return self.details["is_odd"] == 1 if "is_odd" in self.details else None

    def __getstate__(self) -> dict[str, Any]:
        return {"source": self.source, "_details": self.details, "_rows": None, "_attributes": {}}

    def __deepcopy__(self, memo: Any) -> Record:
        return self  # nothing changes it



def described_find(name: str) -> dict[str, str]:
    """Attributes of a column of `CENSUS`."""
    return {"parameter": name.replace("_", "%", 1), "long_name": CENSUS[name], "units": "1"}


def record_beside(motion: xr.Dataset) -> Record | None:
    """Details and source of a result, if it still has them."""
    found: Record | None = motion.encoding.get(_DETAILS)
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
    return found is None or bool(found.source.has_own_tuples)


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
        raise ModelError(f"this dataset is not a result of nhbm: it has no '{name}'")


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


_MOST_TEMPLATES = 20  # sets of harmonics of motions with the same columns
_MAX_TEMPLATE = 1 << 20  # bytes of a motion: making the dataset of a larger one takes no time beside its solution


def motion_of(rows: Rows, source: Source, attributes: Mapping[str, Any]) -> xr.Dataset:
    """The dataset of one motion. Motions with the same columns and harmonics share what takes most of the time."""
    values, layout = rows.values, rows.layout
    if layout.n_bytes > _MAX_TEMPLATE or not _FIXED <= set(values):
        return result_of(columns_of(rows, False), source, {}, attributes)
    unknown = tuple(name for name in _reals_of(layout) if not np.isfinite(values[name]).any())
    key = values["tuples"].tobytes(), unknown
    template = layout.templates.get(key)
    if template is None:
        if len(layout.templates) >= _MOST_TEMPLATES:
            layout.templates.clear()
        found = result_of(columns_of(rows, False), source, {}, attributes)
        layout.templates[key] = _Template(layout, found)
        return found
    filled: xr.Dataset = template.filled(rows, source, attributes)
    return filled


_FIXED = {"status", "tuples", "frequency", "coefficients"}  # columns of a motion with a template


def _reals_of(layout: Layout) -> list[str]:
    """Columns for users that are left out where they are not known."""
    return [name for name in _MAIN if name in layout.shapes and layout.columns[name].dtype.kind == "f"
            and name not in ("coefficients", "force_coefficients")]  # fmt: skip


class _Template:
    """The dataset of a motion, for others with the same columns and harmonics."""

    def __init__(self, layout: Layout, found: xr.Dataset) -> None:
        record, found.encoding = found.encoding, {}
        self._empty = found.copy(deep=True)
        found.encoding = record
        self._absent, self._labels = record[_DETAILS].source.absent, record[_DETAILS].source.labels
        self._names = [(str(name), _COLUMNS.get(str(name), str(name))) for name in found.data_vars if name != "message"]
        self._words: dict[str, dict[int, Any]] = {}
        for name, column in self._names:
            attributes = layout.columns[column].attributes
            if "flag_meanings" in attributes:
                numbers, words = np.atleast_1d(attributes["flag_values"]), attributes["flag_meanings"].split()
                kind = f"<U{max(len('unknown'), *map(len, words))}"
                self._words[name] = {int(k): np.array(word, kind) for k, word in zip(numbers, words)}

    def filled(self, rows: Rows, source: Source, attributes: Mapping[str, Any]) -> xr.Dataset:
        """The dataset of another motion."""
        data: dict[Any, Any] = {"message": np.array(rows.messages[0]), "frequency": rows.values["frequency"][0]}
        for name, column in self._names:
            value = rows.values[column][0, ...]
            words = self._words.get(name)
            data[name] = value if words is None else words[int(value)].copy()
        found = _with_data(self._empty, data)
        found.attrs = dict(attributes)
        source.absent, source.labels = dict(self._absent), {**self._labels, **source.labels}
        found.encoding = {_DETAILS: Record(source, rows=rows, attributes=dict(attributes))}
        return found


def _with_data(template: xr.Dataset, data: Mapping[Any, Any]) -> xr.Dataset:
    """A dataset with other values of some variables, as by `template.copy(data=...)`, which makes all indexes anew."""
    try:
        # `copy` of an index variable examines its labels again, which takes longer than all the rest
        variables = {name: type(variable)(variable.dims, data.get(name, variable._data), dict(variable.attrs), fastpath=True)
                     for name, variable in template.variables.items()}  # fmt: skip
        return xr.Dataset._construct_direct(variables, set(template.coords), dict(template.sizes), indexes=dict(template._indexes))
    except (AttributeError, TypeError):  # a version of xarray with another constructor
        found = template.copy(deep=False, data={name: data[name] for name in template.data_vars})
        found.variables["frequency"].data = data["frequency"]
        return found


def columns_of(rows: Rows, has_points: bool) -> xr.Dataset:
    """All columns of motions, with numbers for words, along the axis `point` or of the only one."""
    n, layout = len(rows), rows.layout
    along: tuple[str, ...] = ("point",) if has_points else ()
    variables: dict[str, Any] = {}
    for name, values in rows.values.items():
        column = layout.columns[name]
        variables[name] = (*along, *column.axes), values if has_points else values[0, ...], dict(column.attributes)
    texts = np.array(rows.messages, dtype=object) if has_points else np.array(rows.messages[0])
    variables["message"] = along, texts, {"units": "1", "long_name": "reason for a failure, and advice"}
    labels = _labels(layout.labels, layout.dofs_of_sets, layout.lengths)
    if has_points:
        labels["point"] = "point", np.arange(n, dtype=np.int32), {"long_name": AXES["point"], "units": "1"}
    return xr.Dataset(variables, labels)


def _labels(labels_of: Mapping[str, list[str]], dofs_of_sets: Mapping[str, str], lengths: Mapping[str, int]) -> dict[str, Any]:
    """Coordinates along the axes that there are."""
    labels: dict[str, Any] = {}
    for axis, n in lengths.items():
        words = labels_of.get(axis, [])
        what = {"long_name": AXES[axis], "units": "1"} if axis in AXES else {}
        if axis == "component":
            labels[axis] = axis, ["cos", "sin"], what
        elif len(words) == n > 0:
            labels[axis] = axis, words, what
        else:
            labels[axis] = axis, np.arange(1 if axis == "tone" else 0, n + (axis == "tone"), dtype=np.int32), what
    if dofs_of_sets and "dof" in labels:
        labels["dof_of_set"] = "dof", names_of_dofs(dofs_of_sets, labels["dof"][1])
    return labels


def names_of_dofs(dofs_of_sets: Mapping[str, str], labels: Iterable[str]) -> list[str]:
    """The names that sets of one node give to each degree of freedom, separated by blanks."""
    return [" ".join(name for name, dof in dofs_of_sets.items() if dof == label) for label in labels]


def absent_from(layout: Layout) -> dict[str, Absent]:
    """Columns of files whose values are not known for the motions of a session."""
    found = {name: (column.dtype, column.axes, dict(column.attributes)) for name, column in layout.absent.items()}
    for name, unit, meaning in _OF_STABILITY:
        if name not in layout.columns:
            found[name] = np.dtype(float), ("multiplier",), {"units": unit, "long_name": meaning}
    return found


_OF_STABILITY = (
    ("exponent", "1/s", "growth rates of disturbances, the largest first"),
    ("multiplier_real", "1", "Floquet multipliers, the largest first: real parts"),
    ("multiplier_imag", "1", "Floquet multipliers, the largest first: imaginary parts"),
)


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


def split(columns: xr.Dataset, source: Source) -> xr.Dataset:
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
    main.encoding[_DETAILS] = Record(source, details)
    return main


def _without_unknown(columns: xr.Dataset, source: Source) -> xr.Dataset:
    """Without the columns for users that are not known at any point, and their axes, which a file has: `source` notes them."""
    reals = {name: columns[name].values for name in _MAIN if name in columns.data_vars and columns[name].dtype.kind == "f"}
    unknown = [name for name, values in reals.items()
               if name not in ("coefficients", "force_coefficients") and values.size and not np.isfinite(values).any()]  # fmt: skip
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
    lengths.pop("time", None)
    labels = _labels({axis: session.labels(axis) for axis in lengths if axis != "multiplier"}, session.dofs_of_sets, lengths)
    found = xr.Dataset(variables, labels, {"amplitude_convention": AMPLITUDES} if "time" in variables else {})
    return with_words(found)


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
