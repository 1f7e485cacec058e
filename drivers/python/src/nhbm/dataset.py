"""Motions as xarray.Dataset, with the names, axes and units of the result file (docs/user/schema.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from nhbm.errors import ModelError, imported

if TYPE_CHECKING:
    from nhbm.session import Session

CONVERGED = 1
STATUSES = (
    "pending converged stalled out_of_budget singular not_finite failed truncated aliased penetrating collapsed no_motion crashed "
    "diverged locked timed_out impact unused time_domain subharmonic broadband several"
).split()
SOLVED = (1, 7, 8, 9, 16, 18)  # a motion of the tones is stored, if not always within the requested limits
CUT_SHORT, GRAZED = 8, 9  # as `reason`: a curve continues beyond its last point; it ends at a grazing impact
UNUSED, FAILED = STATUSES.index("unused"), STATUSES.index("failed")  # a row of a curve that was not needed
COLLAPSED = STATUSES.index("collapsed")  # at the end of a curve: the motion vanishes there
KINDS = (
    "none regular start fold peak value end branch flip torus split graze minimum amplitude resonance"
).split()  # of the points of a curve
VERDICTS = "not_done", "agrees", "unstable", "differs", "undecided"
_NAMES = {"tuples": "tuple"}
AMPLITUDES = "x(t) = sum over h of cos_h cos(j_h.omega t) + sin_h sin(j_h.omega t), j_h = tuple[h, :]"


def open_dataset(path: str | Path) -> xr.Dataset:
    """Opens a result file, as `xarray.open_dataset` does; `dataset.nhbm` has amplitudes, motions over time and plots.

    Parameters
    ----------
    path : str or Path
        A result file of `nhbm solve`. Needs h5netcdf, which is installed with the package.

    Returns
    -------
    xarray.Dataset
        All points of the run (docs/user/schema.md), read on demand, without the unused rows of curves.
    """
    imported("h5netcdf", "result files are opened with")
    data = xr.open_dataset(path, engine="h5netcdf")
    if "status" in data and "point" in data.dims:
        data = data.isel(point=np.flatnonzero(data["status"].values != UNUSED))
    return data


def check_found(data: xr.Dataset, name: str) -> None:
    """Raises ModelError, with the status and the reason, if a dataset lacks a column because no motion was found."""
    if name in data or "status" not in data:
        return
    statuses = np.unique(data["status"].values)
    if not set(statuses.tolist()) & set(SOLVED):
        words = ", ".join(STATUSES[status] for status in statuses)
        raise ModelError(f"no motion was found (status {words}), so there are no '{name}'. {data.nhbm.message}".rstrip())


def motion_of(session: Session) -> xr.Dataset:
    """The motion found last."""
    columns = {name: session.column(name) for name in session.columns()}
    columns = {name: column for name, column in columns.items() if column.values is not None}
    layout = (columns["tuples"].values.tobytes(), tuple((name, column.values.shape) for name, column in columns.items()))
    if session.empty is None or session.empty[0] != layout:  # what motions of one layout share takes most of the time
        session.empty = layout, _dataset_of(session, columns)
    empty: xr.Dataset = session.empty[1]
    return empty.copy(data={_NAMES.get(name, name): column.values for name, column in columns.items()})


def _dataset_of(session: Session, columns: dict[str, Any]) -> xr.Dataset:
    variables: dict[str, Any] = {}
    lengths: dict[str, int] = {}
    for name, column in columns.items():
        lengths.update(zip(column.axes, column.values.shape))
        units = {"units": column.unit} if column.unit else {}
        variables[_NAMES.get(name, name)] = (column.axes if column.values.ndim else (), column.values, units)
    tuples = {f"tuple_{m + 1}": ("harmonic", line) for m, line in enumerate(columns["tuples"].values.T)}
    return xr.Dataset(variables, {**_labels(session, lengths), **tuples}, {"amplitude_convention": AMPLITUDES})


def record_of(session: Session) -> xr.Dataset:
    """What time integration has found: a record, or the verdict on a motion."""
    columns = {name: session.time_column(name) for name in session.time_columns()}
    variables: dict[str, Any] = {}
    lengths: dict[str, int] = {}
    for name, column in columns.items():
        lengths.update(zip(column.axes, column.values.shape))
        variables[name] = (column.axes, column.values, {"units": column.unit})
    labels = _labels(session, {axis: n for axis, n in lengths.items() if axis != "time"})
    return xr.Dataset(variables, labels, {"amplitude_convention": AMPLITUDES} if "time" in variables else {})


def _labels(session: Session, lengths: dict[str, int]) -> dict[str, Any]:
    """Coordinates along the axes that there are."""
    labels: dict[str, Any] = {}
    for axis, n in lengths.items():
        words = session.labels(axis)
        if axis == "component":
            labels[axis] = ["cos", "sin"]
        elif len(words) == n > 0:
            labels[axis] = words
        else:
            labels[axis] = np.arange(1 if axis == "tone" else 0, n + (axis == "tone"))
    if session.dofs_of_sets and "dof" in labels:
        words = [" ".join(name for name, dof in session.dofs_of_sets.items() if dof == label) for label in labels["dof"]]
        labels["dof_of_set"] = "dof", words
    return labels


def number(session: Session, name: str) -> float:
    """A column that is one number."""
    values = session.column(name).values
    return float("nan") if values is None else values.item()


def response_of(session: Session, of: str) -> float:
    """A response of the motion found last: "x1", the root mean square of what oscillates, or "x1 (1)", the amplitude of a
    harmonic."""
    dof, wanted = parts_of(of)
    motion, tuples = session.column("coefficients").values[_index(session, of, dof)], session.column("tuples").values
    if wanted is None:
        return float(np.sqrt((motion[tuples.any(axis=1)] ** 2).sum() / 2))
    if len(wanted) != tuples.shape[1]:
        raise ModelError(f"'{of}' has a tuple of {len(wanted)} entries, there are {tuples.shape[1]} tones")
    # not ==, in which NumPy takes a KeyboardInterrupt during the conversion of `wanted` for a comparison that is false
    found = np.equal(tuples, wanted).all(axis=1) | np.equal(tuples, np.negative(wanted)).all(axis=1)
    return float(np.sqrt((motion[found] ** 2).sum()))


def _index(session: Session, of: str, dof: str) -> int:
    """Position of a degree of freedom, by its label or by its set."""
    labels = session.labels("dof")
    label = session.dofs_of_sets.get(dof, dof)
    if label not in labels:
        known = ", ".join([*labels, *session.dofs_of_sets])
        raise ModelError(f"'{of}' is no response: there is no degree of freedom '{dof}'; known: {known}")
    return labels.index(label)


def gradient_of(session: Session, of: str) -> np.ndarray[Any, Any]:
    """Derivatives of that response by the values of the group &gradient; NaN where they are not known."""
    dof, wanted = parts_of(of)
    i_dof, by = _index(session, of, dof), session.column("gradient").values
    if by is None:
        return np.full(len(session.labels("gradient_value")), np.nan)
    motion, tuples = session.column("coefficients").values[i_dof], session.column("tuples").values
    size = response_of(session, of)
    if wanted is None:
        counts, size = tuples.any(axis=1), 2 * size
    else:
        counts = (tuples == wanted).all(axis=1) | (tuples == -np.array(wanted)).all(axis=1)
    slopes: np.ndarray[Any, Any] = (by[:, i_dof] * motion)[:, counts].sum(axis=(1, 2)) / (size or np.nan)
    return slopes


def parts_of(of: str) -> tuple[str, tuple[int, ...] | None]:
    """Degree of freedom and tuple of a response: "x1", "x1 (1)", "v3 (1,0)"."""
    parts = re.fullmatch(r"\s*([^()]*[^()\s])\s*(?:\(\s*([-+]?\d+(?:\s*,\s*[-+]?\d+)*)\s*\))?\s*", of)
    if parts is None:
        raise ModelError(f"'{of}' is no response; 'x1', 'x1 (1)' and 'x1 (1,0)' are")
    return parts[1], tuple(map(int, parts[2].split(","))) if parts[2] else None


def words_of(of: str) -> str:
    """A response of a motion in words, as axes have it."""
    dof, tuple_ = parts_of(of)
    if tuple_ is None:
        return f"Root mean square of {dof}"
    return f"Amplitude of {dof}, " + (f"harmonic {tuple_[0]}" if len(tuple_) == 1 else f"tuple ({', '.join(map(str, tuple_))})")


def row_of(found: Any) -> dict[str, Any]:
    """A number, or a mapping or named tuple of numbers, by their names."""
    return dict(found._asdict() if hasattr(found, "_asdict") else found if isinstance(found, Mapping) else {"response": found})


def table(rows: list[dict[str, Any]], coordinates: dict[str, Any]) -> xr.Dataset:
    """Named numbers as the points of one dataset; NaN where a row lacks one."""
    variables = {name: ("point", np.array([row.get(name, np.nan) for row in rows])) for name in rows[0]}
    return xr.Dataset(variables, {name: ("point", np.asarray(values)) for name, values in coordinates.items()})


def joined(motions: list[xr.Dataset], coordinates: dict[str, Any]) -> xr.Dataset:
    """Motions as the points of one dataset, in their order; what a motion lacks is padded as in the result file."""
    if not motions:
        raise ValueError("there are no motions to join")
    longest: dict[Any, int] = {axis: max(m.sizes.get(axis, 0) for m in motions) for m in motions for axis in m.sizes}
    variables: dict[Any, Any] = {}
    for name in dict.fromkeys(name for m in motions for name in m.data_vars):
        first = next(m[name] for m in motions if name in m)
        rows = [_padded(m.get(name), first, longest) for m in motions]
        variables["tuples" if name == "tuple" else name] = (("point", *first.dims), np.stack(rows), first.attrs)
    labels: dict[Any, Any] = {axis: next(m[axis].values for m in motions if m.sizes.get(axis) == n) for axis, n in longest.items()}
    labels["point"] = np.arange(len(motions))
    if "dof_of_set" in motions[0].coords:
        labels["dof_of_set"] = "dof", motions[0].coords["dof_of_set"].values
    labels.update({name: ("point", np.asarray(values)) for name, values in coordinates.items()})
    return xr.Dataset(variables, labels, motions[0].attrs)


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


@xr.register_dataset_accessor("nhbm")  # type: ignore[no-untyped-call, unused-ignore]
class Accessor:
    """Evaluation of motions: ``dataset.nhbm.amplitude("x1", 1)``."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    @property
    def is_converged(self) -> xr.DataArray:
        """Whether each motion satisfies its tolerances."""
        return self._dataset["status"] == CONVERGED

    @property
    def status(self) -> xr.DataArray:
        """Status of each motion as a word: converged, truncated, ... (docs/user/schema.md)."""
        words: xr.DataArray = xr.apply_ufunc(np.array(STATUSES).__getitem__, self._dataset["status"])
        return words

    @property
    def kind(self) -> xr.DataArray:
        """Kind of each point of a curve as a word: regular, fold, peak, ... (docs/user/curves.md)."""
        words: xr.DataArray = xr.apply_ufunc(np.array(KINDS).__getitem__, self._dataset["curve_kind"])
        return words

    @property
    def message(self) -> str:
        """Reason for a failure, or a note; for several points the first message."""
        return next((str(text) for text in np.ravel(self._dataset["message"].values) if str(text)), "")

    def harmonic(self, dof: str, tuple_: Any = 1, of: str = "coefficients") -> xr.DataArray:
        """Complex amplitude cos - i sin of a harmonic at a degree of freedom.

        Parameters
        ----------
        dof : str
            Label of a degree of freedom, or set of one node ("disk1.x"), or law, depending on the column.
        tuple_ : int or sequence of int
            Its tuple; the result is zero if it is not in the set.
        of : str
            Column: "coefficients" [m], "force_coefficients" [N], "corrected_coefficients" [m].

        Returns
        -------
        xarray.DataArray
            In the unit of the column, one value per point.
        """
        data = self._dataset
        check_found(data, of)
        wanted = np.atleast_1d(tuple_)
        tuples = data["tuples"] if "tuples" in data else data["tuple"]
        if len(wanted) != data.sizes["tone"]:
            raise KeyError(f"tuple {tuple_} has {len(wanted)} entries, there are {data.sizes['tone']} tones")
        sign = -1 if next((k for k in wanted if k), 0) < 0 else 1
        held = self._row(of, dof).where((tuples == sign * wanted).all("tone") & self._in_use())
        found = held.sum("harmonic")
        return found.sel(component="cos", drop=True) - sign * 1j * found.sel(component="sin", drop=True)

    def amplitude(self, dof: str, tuple_: Any = 1, of: str = "coefficients") -> xr.DataArray:
        """Amplitude of that harmonic; parameters and unit are those of `harmonic`."""
        size: Any = np.abs(self.harmonic(dof, tuple_, of))
        return size  # type: ignore[no-any-return]

    def time(self, dof: str, times: Any, of: str = "coefficients") -> xr.DataArray:
        """Values over time.

        Parameters
        ----------
        dof : str
            Degree of freedom, or law, depending on the column.
        times : array_like
            [s].
        of : str
            Column: "coefficients" [m], "force_coefficients" [N].

        Returns
        -------
        xarray.DataArray
            In the unit of the column, (..., time); a single time adds no dimension.
        """
        data = self._dataset
        check_found(data, of)
        tuples = data["tuples"] if "tuples" in data else data["tuple"]
        times = xr.DataArray(np.asarray(times, dtype=float), dims="time" if np.ndim(times) else (), attrs={"units": "s"})
        phases = (tuples * data["frequency"]).sum("tone") * times
        column = self._row(of, dof).where(self._in_use(), 0.0)
        values = column.sel(component="cos", drop=True) * np.cos(phases) + column.sel(component="sin", drop=True) * np.sin(phases)
        found: xr.DataArray = values.sum("harmonic").where(np.isfinite(times)).assign_coords(time=times)
        return found

    def largest(self, dof: str, n: int = 4096) -> xr.DataArray:
        """Largest absolute displacement [m] over many samples of the motion in time.

        Parameters
        ----------
        dof : str
            Degree of freedom.
        n : int
            Samples per period; for several tones eight times as many over 64 periods of the slowest one.
        """
        check_found(self._dataset, "coefficients")
        times = self._times(n)
        if "point" not in self._dataset.dims:
            return abs(self.time(dof, times)).max("time")
        points = (self._dataset.isel(point=[k]).nhbm.time(dof, times) for k in range(self._dataset.sizes["point"]))
        found: xr.DataArray = xr.concat([abs(values).max("time") for values in points], "point")
        return found

    def _times(self, n: int = 4096) -> Any:
        """Samples of a period, or eight times as many over 64 periods of the slowest of several tones [s]."""
        slowest = float(np.nanmin(self._dataset["frequency"]))
        periods = 1 if self._dataset.sizes["tone"] == 1 else 64
        return np.linspace(0.0, periods * 2 * np.pi / slowest, n * (1 if periods == 1 else 8), endpoint=False)

    def response(self, of: str) -> tuple[xr.DataArray, str]:
        """A response of each point, and its name with unit.

        Parameters
        ----------
        of : str
            "x1", the largest |x1|, or "x1 (1)", the amplitude of a harmonic.
        """
        dof, tuple_ = parts_of(of)
        check_found(self._dataset, "coefficients")
        unit = self._dataset["coefficients"].attrs.get("units", "m")
        if tuple_ is None:
            return self.largest(dof), f"Largest displacement |{dof}| [{unit}]"
        return self.amplitude(dof, tuple_), f"{words_of(of)} [{unit}]"

    def gradient(self, of: str) -> xr.DataArray:
        """Derivatives of a response with respect to the values of the group &gradient, in their units.

        For the largest displacement they are taken at its instant, with fixed phases.

        Parameters
        ----------
        of : str
            As for `response`: "x1", the largest |x1|, or "x1 (1)", the amplitude of a harmonic.

        Returns
        -------
        xarray.DataArray
            (..., gradient_value); NaN if the motion was not found or is not differentiable.
        """
        dof, tuple_ = parts_of(of)
        check_found(self._dataset, "coefficients")
        if "gradient" not in self._dataset:
            raise KeyError("there is no column 'gradient'; the group &gradient requests it: model.set('gradient', by=[...])")
        if tuple_ is not None:
            weight = self.harmonic(dof, tuple_)
            slope: Any = (weight.conj() * self.harmonic(dof, tuple_, "gradient")).real / abs(weight)
            return slope  # type: ignore[no-any-return]
        if "point" in self._dataset.dims:
            points = range(self._dataset.sizes["point"])
            parts = [self._dataset.isel(point=[k]).squeeze("point").nhbm.gradient(of) for k in points]
            joined: xr.DataArray = xr.concat(parts, "point")
            return joined
        return self._slope_of_largest(dof)

    def _slope_of_largest(self, dof: str) -> xr.DataArray:
        data = self._dataset
        rates = ((data["tuples"] if "tuples" in data else data["tuple"]) * data["frequency"]).sum("tone")
        motion = self._row("coefficients", dof).where(self._in_use(), 0.0)
        cos, sin = (motion.sel(component=c, drop=True) for c in ("cos", "sin"))
        times = self._times()
        at = times[int(abs(self.time(dof, times)).argmax("time"))]
        for _ in range(4):  # Newton's method for the instant where the rate vanishes
            c, s = np.cos(rates * at), np.sin(rates * at)
            curvature = float((-(rates**2) * (cos * c + sin * s)).sum())
            if curvature:
                at -= float((rates * (sin * c - cos * s)).sum()) / curvature
        c, s = np.cos(rates * at), np.sin(rates * at)
        slopes = self._row("gradient", dof).where(self._in_use(), 0.0)
        waves = slopes.sel(component="cos", drop=True) * c + slopes.sel(component="sin", drop=True) * s
        found: xr.DataArray = waves.sum("harmonic") * float(np.sign(float((cos * c + sin * s).sum())))
        return found

    def plot(self, of: str | None = None, ax: Any = None) -> Any:
        """Plots the motion of a degree of freedom over time, or the response of a curve or sweep over its parameter.

        Parameters
        ----------
        of : str, optional
            "x1", the largest |x1| [m], or "x1 (1)", the amplitude of a harmonic; default: the first degree of freedom.
        ax : matplotlib.axes.Axes, optional
            Axes to plot into.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from nhbm.pictures import plot

        check_found(self._dataset, "coefficients")
        return plot(self._dataset, of, ax)

    def _row(self, of: str, name: str) -> xr.DataArray:
        """What a column has of a degree of freedom, by its label or by its set, or of a law."""
        check_found(self._dataset, of)
        column = self._dataset[of]
        axis = column.dims[-3]
        known = [str(label) for label in column[axis].values]
        if axis == "dof" and name not in known and "dof_of_set" in column.coords:
            words = [str(names).split() for names in column["dof_of_set"].values]
            name = next((label for label, names in zip(known, words) if name in names), name)
            known += sum(words, [])
        if name not in column[axis].values:
            raise KeyError(f"'{of}' has no {axis} '{name}'; known: {', '.join(known)}")
        row: xr.DataArray = column.sel({axis: name})
        return row

    def _in_use(self) -> xr.DataArray:
        return self._dataset["harmonic"] < self._dataset["n_harmonics"]
