"""Result files (docs/user/schema.md): those of the command as datasets of users, and datasets written as such files."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from nhbm.child_process import atomic_write
from nhbm.dataset import Record, Source, described_find, names_of_dofs, split, with_words
from nhbm.errors import ModelError, check_file
from nhbm.groups import Groups, absolute_files, described
from nhbm.hdf5_file import image_of, open_hdf5
from nhbm.paths import path_of
from nhbm.schema import AXES, CENSUS, TUPLE
from nhbm.session import Session
from nhbm.structure import FORMAT, Structure, dofs_of_sets_in

_PENDING, _UNUSED = 0, 17  # statuses of rows of a curve that was stopped, and of spare ones
_MESSAGE_LENGTH = 400  # bytes
_OF_STABILITY = {"exponent", "multiplier_real", "multiplier_imag"}
_TEXTS = "input_text", "input_overrides", "input_complete", "input_libraries"
_STRUCTURE = Structure.input_name
_TUPLES = "integer tuple j of each harmonic of the point; only the first n_harmonics are in use"
# Columns that a file has and that motions in memory have not: type and axes besides the point, unit and meaning.
_LATER: dict[str, tuple[Any, tuple[str, ...], str, str]] = {
    "branch": (np.int32, (), "1", "segment of the response along the fastest swept parameter, from 1; 0: unknown"),
    "integration_verdict": (np.int32, (), "1", "verdict of nhbm verify"),
    "integration_first_difference": (float, (), "1", "largest difference from time integration in the first period of the slowest "
                                     "tone, relative to the motion of its coordinate"),
    "integration_difference": (float, (), "1", "difference from time integration in the last periods, for the coordinate with the "
                               "largest ratio to its limit, relative to its motion"),
    "integration_limit": (float, (), "1", "limit of that difference"),
    "integration_growth": (float, (), "1/s", "rate at which a nearby trajectory diverges from the motion"),
    "integration_duration": (float, (), "s", "integrated time"),
    "integration_drift": (float, ("tone",), "rad/s", "integrated frequency minus that of the motion, 0 for given tones"),
}  # fmt: skip
_WORKER = {  # of the run
    "worker_points": (np.int32, "1", "points that the rank solved"),
    "worker_draws": (np.int32, "1", "accesses of the rank to shared counters"),
    "worker_reading_seconds": (float, "s", "time for creating models from the input"),
    "worker_solving_seconds": (float, "s", "time for solving"),
    "worker_writing_seconds": (float, "s", "time for writing results"),
    "worker_drawing_seconds": (float, "s", "time for accessing shared counters"),
    "worker_idle_seconds": (float, "s", "time waiting for the other ranks at the end"),
    "worker_total_seconds": (float, "s", "time from the first access to the end of the slowest rank"),
    "worker_overhead_per_point": (float, "s", "time per point that was neither solving nor waiting"),
}
_SCHEMA = 1  # version of result files
_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable. {:9d}"
_SCALES = {**AXES, "message_byte": "byte of a message", "worker": "rank or process of the run, from 0"}
_COUNTS_OF_CENSUS = "census_starts", "census_lost", "census_directed_starts", "census_is_reliable"
_VERDICTS = "not_done agrees unstable differs undecided"


def is_result(path: str | Path) -> bool:
    """Whether a file is a result of nhbm."""
    try:
        with open_hdf5(path) as file:
            return "schema_version" in file.attrs and "status" in file
    except (OSError, ValueError):
        return False


def opened(path: str | Path) -> xr.Dataset:
    """A result file as the dataset that `Model` returns for the same motions."""
    check_file(path)
    if str(path).lower().endswith(".nml"):
        raise ModelError(f"'{path}' is an input, not a result: nhbm.Model.from_file({str(path)!r})")
    is_open = False
    try:
        with open_hdf5(path) as file:
            is_open = True
            is_model, version = file.attrs.get("format") == FORMAT, int(file.attrs.get("schema_version", _SCHEMA))
            is_foreign = not {"schema_version", "varies"} & set(file.attrs) and not {"status", "displacement"} & set(file)
        if is_model:  # which h5netcdf opens or not, by its version
            raise ModelError(f"file '{path}' cannot be read: it is a model file, which nhbm.Model takes")
        if is_foreign:
            raise ModelError(f"file '{path}' is not a result of nhbm: it has no attribute 'schema_version'")
        if version != _SCHEMA:
            raise ModelError(f"file '{path}' has the schema version {version}; this nhbm reads {_SCHEMA}")
        data = xr.open_dataset(path, engine="h5netcdf")
    except ModelError:
        raise
    except (ArithmeticError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, TypeError, ValueError) as error:
        if not is_open:
            raise ModelError(f"file '{path}' cannot be read: {error}") from None
        why = " ".join(f"{type(error).__name__}: {error}".split())  # h5py and h5netcdf raise any of these where a part is damaged
        raise ModelError(f"file '{path}' is damaged: {why}") from None
    if "status" not in data or "point" not in data.dims:
        return with_words(data)
    data = data.isel(point=np.flatnonzero(data["status"].values != _UNUSED))
    texts = {name: str(data[name].values) for name in _TEXTS if name in data}
    folders = [str(data["input_text"].attrs.get("folder", "")) if "input_text" in data else "", str(Path(path).parent)]
    data = data.drop_vars([name for name in data.data_vars if name in _TEXTS or "worker" in data[name].dims])
    source = Source(texts.get("input_complete", ""), "tuples" in data, texts.get("input_libraries", ""))
    source.is_of_file = True
    data = with_words(data.reset_coords([name for name in ("frequency", "tuple", "tuples") if name in data.coords]))
    with h5py.File(path) as file:
        order = str(file.attrs.get("coordinates", "")).split()
    varies = [str(name) for name in data.variables if data[name].dims == ("point",) and "parameter" in data[name].attrs]
    groups = Groups.of_text(source.text)
    for name in varies:
        if name in CENSUS:
            kind = np.int32 if data[name].dtype.kind in "iuf" else object  # texts: of a type that depends on versions
            data[name] = data[name].dims, data[name].values.astype(kind), described_find(name)
        else:
            data[name].attrs.update(described(path_of(str(data[name].attrs["parameter"])), groups))
    data.attrs.update({name: int(data.attrs[name]) for name in _COUNTS_OF_CENSUS if name in data.attrs})
    sets = _dofs_of_sets(groups, folders)
    if sets and "dof" in data.coords:
        data = data.assign_coords(dof_of_set=("dof", names_of_dofs(sets, data["dof"].values)))
    varies.sort(key=lambda name: order.index(name) if name in order else len(order))
    data = data.set_coords(varies).drop_vars([name for name in ("message_byte", "worker") if name in data.coords])
    data = data.drop_vars([name for name in data.coords if re.fullmatch(r"tuple_\d+", str(name))])
    if "curve_unknown" in data.dims:
        data = data.isel(curve_unknown=slice(int(data["curve_n_unknowns"].max())))
    if "tuples" in data:
        used = int(data["n_harmonics"].max()) if data.sizes["point"] else 0
        data = data.isel(harmonic=slice(max(used, 1)))
    if varies:
        data.attrs["varies"] = varies
    elif data.sizes["point"] == 1:
        data = data.isel(point=0, drop=True)
        data = data.rename(tuples="tuple") if "tuples" in data else data
        data["tuple"].attrs.update(TUPLE)
    source.n_points = data.sizes.get("point")
    return split(data, source)


def _dofs_of_sets(groups: Groups, folders: list[str]) -> dict[str, str]:
    """Names of degrees of freedom by sets of the model file that an input names, in the first folder that has it."""
    given = next((str(group.keys["file"]) for group in groups.named("structure") if "file" in group.keys), "")
    found = [Path(folder, given) for folder in folders if given and Path(folder, given).is_file()]
    return dofs_of_sets_in(found[0]) if found else {}


_NOT_HDF5 = (".csv", ".gif", ".html", ".json", ".mat", ".nml", ".pdf", ".png", ".svg", ".txt", ".xlsx")


def save(data: xr.Dataset, record: Record, path: Path) -> None:
    """Writes a dataset of motions as a result file."""
    details, source = record.details, record.source
    if path.suffix.lower() in _NOT_HDF5:
        hint = "; dataset.nhbm.to_dataframe() gives a table" if path.suffix.lower() in (".csv", ".txt") else ""
        raise ModelError(f"file '{path}': a result file is HDF5, give it the ending .h5{hint}")
    text, libraries = source.text, source.libraries
    if not text or data.sizes.get("point") != source.n_points:
        raise ModelError("a file has all points of its input: save the whole result, not a selection of it")
    if "point" in data.coords and (np.diff(data["point"].values) <= 0).any():
        raise ModelError("a file has the points in the order of their computation: save the result as it was returned, not sorted")
    columns = _with_absent(_numbers(_columns(data, details, source.has_own_tuples)), source)
    if "curve_kind" in columns:
        columns = _padded(_with_wide_state(columns, text), _rows_of_curve(text), _UNUSED if source.is_complete else _PENDING)
    text, libraries = _canonical(source, text, libraries)
    text = absolute_files(text, source.folder)
    try:
        if source.structure is not None:
            beside = path.with_name(f"{path.stem}.structure.h5")
            source.structure.write(beside)
            text, libraries = text.replace(f"'{_STRUCTURE}'", f"'{beside.name}'"), libraries.replace(_STRUCTURE, beside.name)
        image = image_of(lambda file: _write(file, columns, dict(data.attrs), text, libraries, path))
        with atomic_write(path) as name:
            Path(name).write_bytes(image)
    except OSError as error:
        raise ModelError(f"file '{path}' cannot be written: {error.strerror or error}") from None


def _columns(data: xr.Dataset, details: xr.Dataset, has_own_tuples: bool) -> xr.Dataset:
    """All columns of the points, with the axis `point`, as variables."""
    if "point" in data.dims:
        details = details.sel(point=data["point"].values)
        attrs = data["point"].attrs
        data = data.assign_coords(point=("point", np.arange(data.sizes["point"], dtype=np.int32), attrs))
        details = details.assign_coords(point=data["point"])
    names = ("frequency", "tuple", "tuples")
    data = data.reset_coords([name for name in names if name in data.coords])
    details = details.reset_coords([name for name in names if name in details.coords])
    known = [name for name in (*names, *data.variables) if name in details.variables and name not in details.dims]
    data = data.merge(details.drop_vars(known, errors="ignore"))
    if "point" not in data.dims:
        own = data["tuple"].variable
        data = data.drop_vars([name for name in data.coords if re.fullmatch(r"tuple_\d+", str(name))])
        data = data.drop_vars("tuple").expand_dims(point=1)
        data = data.assign_coords(point=("point", np.zeros(1, dtype=np.int32), {"long_name": AXES["point"], "units": "1"}))
        whole = ("point", *own.dims), own.values[np.newaxis], {**own.attrs, "long_name": _TUPLES}
        data = data.assign(tuples=whole) if has_own_tuples else data.assign(tuple=own)
    for name in [name for name in data.coords if "parameter" in data[name].attrs]:
        path = data[name].attrs["parameter"]
        is_curve = "moves_along" in data[name].attrs
        data[name].attrs["long_name"] = f"value of {path} along the curve" if is_curve else f"swept parameter {path}"
        if data[name].dtype.kind == "i":
            data[name] = data[name].dims, data[name].values.astype(float), data[name].attrs
    return data.rename({"stability": "is_stable"} if "stability" in data else {})


def _numbers(data: xr.Dataset) -> xr.Dataset:
    """Words as the numbers that a file has for them."""
    for name in [name for name in data.variables if "flag_meanings" in data[name].attrs]:
        column = data[name]
        numbers = dict(zip(str(column.attrs["flag_meanings"]).split(), np.atleast_1d(column.attrs["flag_values"]).tolist()))
        values = np.vectorize(lambda word, numbers=numbers: numbers.get(word, 0), otypes=[np.int32])(column.values)
        data = data.assign({name: (column.dims, values, column.attrs)})
    return data


def _with_absent(data: xr.Dataset, source: Source) -> xr.Dataset:
    """With the columns of a file whose values are not known; those of stability unless the input leaves it out."""
    stability = Groups.of_text(source.text).first("stability")
    left_out = {"tuples", *(_OF_STABILITY if stability is not None and stability.keys.get("method") == "off" else ())}
    for name, (kind, axes, attrs) in source.absent.items():
        if name in left_out or name in data.variables:
            continue
        if name in ("multiplier_real", "multiplier_imag") and data.sizes["tone"] > 1:
            continue
        for axis in set(axes) & set(source.labels) - set(data.coords):
            labels: Any = source.labels[axis] if axis == "law" else np.arange(len(source.labels[axis]), dtype=np.int32)
            data = data.assign_coords({axis: (axis, labels, {"long_name": AXES[axis], "units": "1"})})
        lengths = data.sizes
        if not set(axes) <= set(lengths):
            continue
        shape = (data.sizes["point"], *(lengths[axis] for axis in axes))
        values = np.full(shape, np.nan if kind.kind == "f" else 0, dtype=kind)
        data = data.assign({name: (("point", *axes), values, attrs)})
    return data


def _rows_of_curve(text: str) -> int:
    """Number of rows that a file has for a curve."""
    group = Groups.of_text(text).first("curve")
    return int(group.keys.get("points", 0)) if group is not None else 0


def _with_wide_state(data: xr.Dataset, text: str) -> xr.Dataset:
    """With the length that a file has for the state of a curve on a given set: the sine of the mean has a place, too."""
    if "tuple" not in data or "curve_unknowns" not in data:
        return data
    groups = Groups.of_text(text)
    tones = groups.first("tones")
    n_further = 1 + int(np.sum(tones.keys.get("unknown", False) if tones else 0)) + (groups.first("normal_mode") is not None)
    n_coordinates, rest = divmod(data.sizes["curve_unknown"] - n_further, 2 * data.sizes["harmonic"] - 1)
    if rest:  # motions with impacts
        return data
    longer = data.sizes["curve_unknown"] + n_coordinates
    whole = data.reindex(curve_unknown=np.arange(longer, dtype=np.int32))
    whole["curve_unknown"].attrs.update(data["curve_unknown"].attrs)
    return whole


def _padded(data: xr.Dataset, n_rows: int, status: int) -> xr.Dataset:
    """Points of a curve with the further rows that a file has for it, and the status of these."""
    n = data.sizes["point"]
    if n >= n_rows:
        return data
    whole = data.reindex(point=np.arange(n_rows, dtype=np.int32))
    whole["point"].attrs.update(data["point"].attrs)
    for name in data.data_vars:
        if data[name].dims[:1] == ("point",) and data[name].dtype.kind in "iOU":
            fill: Any = "" if data[name].dtype.kind in "OU" else status if name == "status" else 0
            values = np.full((n_rows, *data[name].shape[1:]), fill, dtype=object if fill == "" else data[name].dtype)
            values[:n] = data[name].values
            whole[name] = (data[name].dims, values, data[name].attrs)
    return whole


def _canonical(source: Source, text: str, libraries: str) -> tuple[str, str]:
    """The input as the program itself writes it, with groups &sweep; as it is if it cannot be read any more. That of a file is not
    read: it would load the libraries that it names."""
    if source.is_of_file:
        return text, libraries
    session = Session(lambda name: source.structure or Structure.read(source.folder / name))
    try:
        session.read(text, "" if source.folder == Path() else f"{source.folder}/")
    except ModelError:
        return text, libraries
    return session.input(), session.libraries()


def _write(file: h5py.File, data: xr.Dataset, attrs: dict[str, Any], text: str, libraries: str, path: Path) -> None:
    n = data.sizes["point"]
    varies = [str(name) for name in data.coords if data[name].dims == ("point",) and "parameter" in data[name].attrs]
    tuples = ["tuples"] if "tuples" in data else ["tuple", *(f"tuple_{m + 1}" for m in range(data.sizes["tone"]))]
    attrs.pop("varies", None)
    attrs["coordinates"] = " ".join(["frequency", *tuples, *varies])
    for name, value in attrs.items():
        if name.startswith("census_"):
            file.attrs[name] = float(value)
        else:
            file.attrs[name] = np.int32(value) if isinstance(value, (int, np.integer)) else str(value)
    axes = _Axes(file, data)
    for name, words in (("input_text", text), ("input_overrides", ""), ("input_complete", text), ("input_libraries", libraries)):
        entry = file.create_dataset(name, data=words, dtype=h5py.string_dtype())
        entry.attrs.update({"units": "1", "long_name": _MEANING[name]})
    file["input_text"].attrs.update({"file_name": f"{path.stem}.nml", "folder": f"{path.resolve().parent}/"})
    skipped = {"point", "tone", "harmonic", "component", "dof_of_set", "checksum", *_LATER, *data.dims}
    for name in [str(name) for name in data.variables if name not in skipped]:
        axes.put(name, data[name])
    for name, (kind, dims, unit, meaning) in _LATER.items():
        if name in data:
            axes.put(name, data[name])
            continue
        shape = (n, *(data.sizes[axis] for axis in dims))
        empty = np.full(shape, np.nan if kind is float else 0, dtype=kind)
        axes.put(name, xr.DataArray(empty, dims=("point", *dims), attrs={"units": unit, "long_name": meaning}))
    if "flag_values" not in file["integration_verdict"].attrs:
        file["integration_verdict"].attrs["flag_values"] = np.arange(5, dtype=np.int32)
        file["integration_verdict"].attrs["flag_meanings"] = _VERDICTS
    for name, (kind, unit, meaning) in _WORKER.items():
        axes.put(name, xr.DataArray(np.zeros(1, dtype=kind), dims="worker", attrs={"units": unit, "long_name": meaning}))
    _add_checksums(file, axes, n)


_MEANING = {
    "input_text": "the input as given",
    "input_overrides": "path=value of each --set, a line each",
    "input_complete": "the input after defaults",
    "input_libraries": "libraries of the laws, checksum and length, a line each",
}


_OF_LABELS = "law", "law_dof", "law_coordinate", "output", "gradient_value"  # axes that may have none: a model without laws


class _Axes:
    """Dimension scales of a file, and datasets along them."""

    def __init__(self, file: h5py.File, data: xr.Dataset) -> None:
        self._file = file
        lengths = {"point": data.sizes["point"], "worker": 1, "message_byte": _MESSAGE_LENGTH, "output": 0, "gradient_value": 0}
        lengths.update({str(axis): size for axis, size in data.sizes.items()})
        for axis, size in lengths.items():
            values = data[axis].values if axis in data.variables else np.arange(size, dtype=np.int32)
            is_text = values.dtype.kind in "OU" or (size == 0 and axis in _OF_LABELS)
            kind = h5py.string_dtype() if is_text else values.dtype
            scale = file.create_dataset(axis, data=values.astype(object) if is_text else values, dtype=kind)
            scale.make_scale(_NO_VARIABLE.format(size) if axis == "message_byte" else axis)
            attrs = dict(data[axis].attrs) if axis in data.variables else {}
            scale.attrs.update({"units": "1", "long_name": _SCALES.get(axis, axis.replace("_", " ")), **attrs})

    def put(self, name: str, values: xr.DataArray) -> None:
        """Writes a dataset with its attributes."""
        dims, array = [str(axis) for axis in values.dims], values.values
        if name == "message":
            dims, array = [*dims, "message_byte"], _bytes_of(array)
        kind = h5py.string_dtype() if array.dtype.kind in "OU" else array.dtype
        entry = self._file.create_dataset(name, data=array.astype(object) if array.dtype.kind in "OU" else array, dtype=kind)
        for k, axis in enumerate(dims):
            entry.dims[k].attach_scale(self._file[axis])
        entry.attrs.update({"units": "1", "long_name": name.replace("_", " "), **_plain(values.attrs)})
        if name == "message":
            entry.attrs["_Encoding"] = "utf-8"


def _plain(attrs: dict[Any, Any]) -> dict[str, Any]:
    return {str(name): value for name, value in attrs.items() if name != "_Encoding"}


def _bytes_of(texts: Any) -> Any:
    """Messages as bytes, padded with zeros."""
    rows = []
    for text in texts:
        row = str(text).encode()[:_MESSAGE_LENGTH].decode(errors="ignore").encode()
        rows.append(np.frombuffer(row.ljust(_MESSAGE_LENGTH, b"\0"), dtype="S1"))
    return np.array(rows, dtype="S1").reshape(len(rows), _MESSAGE_LENGTH)


def _add_checksums(file: h5py.File, axes: _Axes, n: int) -> None:
    """The column `checksum`: CRC-32 of each row, as `nhbm info --check` computes it."""
    names = [name for name, entry in file.items()
             if entry.ndim and entry.shape[0] == n and entry.dims[0] and entry.dims[0][0].name == "/point" and name != "point"
             and entry.dtype.kind != "O" and ("parameter" not in entry.attrs or "moves_along" in entry.attrs)
             and name not in ("branch", "rank") and not name.startswith("integration_")
             and not name.endswith("_seconds")]  # fmt: skip
    columns = [file[name][()] for name in names]
    sums = np.zeros(n, dtype=np.uint32)
    for k in range(n):
        value = 0
        for column in columns:
            value = zlib.crc32(column[k].tobytes(), value)
        sums[k] = value
    attrs = {"units": "1", "long_name": "CRC-32 over the values of the row, as they stand in the file", "of": " ".join(names)}
    axes.put("checksum", xr.DataArray(sums.view(np.int32), dims="point", attrs=attrs))
