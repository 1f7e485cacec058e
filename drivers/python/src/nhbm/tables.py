"""Results as tables: a row a point as a pandas.DataFrame or CSV, everything as a file for MATLAB."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from nhbm.child_process import atomic_write
from nhbm.dataset import check_points, check_result, refinement_of, varies_of
from nhbm.errors import ModelError

_MOST_DOFS = 12  # of which a table has a column by default
_OUTCOMES = ("status", "stability", "n_unstable", "curve_kind", "curve_branch", "truncation_estimate", "aliasing_estimate",
             "n_harmonics", "message")  # fmt: skip


@contextmanager
def writing(path: Path) -> Iterator[str]:
    """`atomic_write` with a ModelError for what cannot be written."""
    try:
        with atomic_write(path) as name:
            yield name
    except OSError as error:
        raise ModelError(f"file '{path}' cannot be written: {error.strerror or error}") from None


def frame(data: xr.Dataset, of: tuple[str, ...], has_units: bool = False) -> Any:
    """A row a point: what varies, responses, outcome."""
    import pandas

    check_result(data)
    check_points(data)
    columns: dict[str, Any] = {}

    def add(name: str, values: Any, unit: str) -> None:
        columns[f"{name} [{unit}]" if has_units and unit not in ("", "1") else name] = np.atleast_1d(values)

    for name in varies_of(data):
        add(name, data[name].values, str(data[name].attrs.get("units", "")))
    if "coefficients" in data:
        for one in of or [str(dof) for dof in data["dof"].values[:_MOST_DOFS]]:
            values = data.nhbm.response(one)
            add(one, values.values, str(values.attrs["units"]))
    elif of:
        raise ModelError("this dataset has numbers, not motions; leave the responses out")
    else:
        for name in [str(name) for name in data.data_vars if name not in _OUTCOMES]:
            add(name, data[name].values, str(data[name].attrs.get("units", "")))
    for name in _OUTCOMES:
        if name in data and (name != "message" or any(np.ravel(data[name].values))):
            add(name, data[name].values, "")
        if name == "aliasing_estimate" and (by_levels := refinement_of(data)) is not None:
            add("level_estimate", by_levels, "")
    points = np.atleast_1d(data["point"].values) if "point" in data.coords else np.arange(data.sizes.get("point", 1))
    index = pandas.Index(points, name="point")
    return pandas.DataFrame(columns, index=index)


def write_csv(data: xr.Dataset, path: Path, of: tuple[str, ...]) -> None:
    """Writes that table with units in its heading."""
    if path.suffix.lower() not in ("", ".csv", ".txt", ".dat"):
        raise ModelError(f"'{path}': a table is a text; give it the ending .csv")
    with writing(path) as name:
        frame(data, of, has_units=True).to_csv(name)


def write_mat(data: xr.Dataset, path: Path) -> None:
    """Writes all variables, with structures of their units and axes."""
    from scipy.io import savemat

    if path.suffix.lower() != ".mat":
        raise ModelError(f"'{path}': MATLAB reads files by their ending; give it the ending .mat")
    variables: dict[str, Any] = {}
    for name, column in {**data.coords, **data.data_vars}.items():
        values = column.values
        variables[str(name)] = values.astype(object) if values.dtype.kind in "UO" else values
    variables["units"] = {str(name): str(data[name].attrs["units"]) for name in data.variables if "units" in data[name].attrs}
    variables["axes"] = {str(name): " ".join(map(str, data[name].dims)) for name in data.variables if data[name].dims}
    with writing(path) as name:
        savemat(str(name), variables, long_field_names=True, appendmat=False, oned_as="column")


def _load_at(data: xr.Dataset, tuple_: list[int]) -> float | None:
    """Amplitude [N] of the force that excites a tuple, if it is one and the same at all points."""
    from nhbm.groups import Groups

    loads = Groups.of_text(data.nhbm.input).named("load")
    there = [load.keys for load in loads if np.ravel(load.keys.get("tuple", ())).tolist() in (tuple_, [-j for j in tuple_])]
    is_varied = any(str(column.attrs.get("parameter", "")).startswith("load") for column in data.coords.values())
    if len(there) != 1 or is_varied or there[0].get("vector") or there[0].get("kind", "force") != "force":
        return None
    amplitude = float(np.hypot(there[0].get("cos", 0.0), there[0].get("sin", 0.0)))
    return amplitude if amplitude > 0 and not there[0].get("frequency_power") else None


def write_uff(data: xr.Dataset, path: Path, dof: str, tuple_: Any, force: float | None) -> None:
    """A harmonic of the displacement over its frequency as a function of a universal file; points without a motion are left out."""
    from nhbm import universal_files

    check_result(data)
    if force is not None and not 0 < force < np.inf:
        raise ModelError(f"the force is an amplitude [N] above 0, not {force}")
    harmonic = data.nhbm.harmonic(dof, tuple_)
    numbers = np.atleast_1d(tuple_)
    omega = np.abs((data["frequency"].values[..., : len(numbers)] * numbers).sum(axis=-1))
    load = _load_at(data, list(map(int, numbers)))
    if force is not None and load is not None and not abs(force - load) <= 1e-6 * load:
        raise ModelError(f"the load of these motions at this tuple has the amplitude {load:g} N, and force = {force:g} N")
    values, hertz = np.atleast_1d(harmonic.values), np.atleast_1d(omega) / (2 * np.pi)
    known = np.isfinite(values)
    if not known.any():
        raise ModelError(f"no point has a motion of {dof}")
    node, _, direction = dof.partition(".")
    number = int(node[1:]) if node[:1] == "n" and node[1:].isdigit() else 0
    place = number, f"+{direction.upper()}" if number else ""
    with writing(path) as name:
        universal_files.write_uff(name, hertz[known], values[known] / (force or 1.0), place, force is not None, f"nhbm: {dof}")
