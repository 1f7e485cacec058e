"""The accessor `nhbm` of datasets with motions: responses, tables, files and pictures of them."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from nhbm.dataset import Record, check_found, check_motion, check_points, check_result, record_beside, varies_of
from nhbm.errors import ModelError, meant, without_own_frames
from nhbm.responses import is_pattern, largest_of, matches, parts_of, words_of, words_of_tuple
from nhbm.schema import SOLVED
from nhbm.values import numbers_of


@xr.register_dataset_accessor("nhbm")  # type: ignore[no-untyped-call, unused-ignore]
class Accessor:
    """Evaluation of motions: ``dataset.nhbm.amplitude("x1", 1)``."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def __repr__(self) -> str:
        from nhbm import notebook

        return "\n".join(f"{name}: {text}" for name, text in notebook.summary_of(self._dataset))

    def _repr_html_(self) -> str:
        from nhbm import notebook

        return notebook.table(notebook.summary_of(self._dataset), str(self._dataset.attrs.get("title", "")) or "nhbm result")

    @property
    def is_converged(self) -> xr.DataArray:
        """Whether each motion satisfies its tolerances."""
        return self._dataset["status"] == "converged"

    @property
    def is_stable(self) -> xr.DataArray:
        """Whether each motion is stable: True or False, and None where that is unknown; the attribute `comment` says why, and
        `stability_reason` of the dataset of which motions."""
        words = self._dataset["stability"]
        if not bool((words == "unknown").any()):
            return words == "stable"
        verdicts: xr.DataArray = xr.zeros_like(words, dtype=object)
        verdicts.values[...] = np.vectorize({"stable": True, "unstable": False}.get, otypes=[object])(words.values)
        from nhbm import notebook

        why = notebook.why_unknown(self._dataset)
        return verdicts.assign_attrs(comment=why) if why else verdicts

    @property
    def message(self) -> str:
        """Reason for a failure, or a note; for several points the first message."""
        return next((str(text) for text in np.ravel(self._dataset["message"].values) if str(text)), "")

    @property
    def details(self) -> xr.Dataset:
        """The other columns of the result file: work of the solver, levels of a tolerance, energies, state of a curve."""
        data, details = self._dataset, self._record().details
        if "point" in details.dims and "point" in data.coords:
            return details.sel(point=data["point"].values)
        return details

    @property
    def input(self) -> str:
        """The complete input of these motions, with all keys and their values."""
        return self._record().source.text

    def _record(self) -> Record:
        found = record_beside(self._dataset)
        if found is None and "displacement" in self._dataset:
            raise ModelError("this is a record of time integration, not a result; `nhbm integrate` writes files of records")
        if found is None and "coefficients" not in self._dataset and "status" in self._dataset:
            raise ModelError("this dataset has numbers, not motions, without an input; to_csv, to_mat or to_netcdf write it")
        if found is None:
            raise ModelError("this dataset was computed from a result and has no details; use the result, or a selection of it")
        return found

    def save(self, path: str | Path) -> None:
        """Writes the result file that `nhbm-post`, `nhbm verify`, `nhbm why` and `nhbm.open_dataset` read.

        Parameters
        ----------
        path : str or Path
            The file; an existing one is replaced. A structure in memory is written beside it, as NAME.structure.h5.
        """
        from nhbm import files

        check_points(self._dataset)
        files.save(self._dataset, self._record(), Path(path))

    def report(self) -> Any:
        """The interactive page of `nhbm-post report`: a notebook shows it.

        Returns
        -------
        Report
            `save(path)` writes the page as one file of HTML.
        """
        from nhbm import notebook

        check_points(self._dataset)
        return notebook.report(self._dataset)

    def to_dataframe(self, *of: str) -> Any:
        """A table with a row a point.

        Parameters
        ----------
        *of : str
            Responses, a column each, as for `response`. Default: the root mean square at each of the first twelve degrees of
            freedom.

        Returns
        -------
        pandas.DataFrame
            What varies, responses, status, stability, estimated errors; the index is the point.
        """
        from nhbm import tables

        return tables.frame(self._dataset, of)

    def to_csv(self, path: str | Path, *of: str) -> None:
        """Writes that table as CSV, with units in its heading.

        Parameters
        ----------
        path : str or Path
            The file; an existing one is replaced.
        *of : str
            As for `to_dataframe`.
        """
        from nhbm import tables

        tables.write_csv(self._dataset, Path(path), of)

    def to_mat(self, path: str | Path) -> None:
        """Writes all variables for MATLAB and Octave, with the structures `units` and `axes`.

        Parameters
        ----------
        path : str or Path
            The file; an existing one is replaced.
        """
        from nhbm import tables

        tables.write_mat(self._dataset, Path(path))

    def to_uff(self, path: str | Path, dof: str, tuple_: Any = 1, force: float | None = None) -> None:
        """Writes a harmonic of the displacement over the frequency as a universal file (dataset 58), for test software.

        Parameters
        ----------
        path : str or Path
            The file; an existing one is replaced.
        dof : str
            Degree of freedom; node and direction of a name such as "n12.z" are those of the file.
        tuple_ : int or tuple
            Which harmonic.
        force : float, optional
            Amplitude of the load [N]: written is the receptance; default: the displacement [m], as a spectrum.
        """
        from nhbm import tables

        tables.write_uff(self._dataset, Path(path), dof, tuple_, force)

    def orbit(self, dof: str | None = None, other: str | None = None) -> Any:
        """Draws a motion in the phase plane, or over another degree of freedom; for several tones with its section. Of several
        points all motions, each over the other degree of freedom.

        Parameters
        ----------
        dof : str, optional
            Degree of freedom; default: the one that moves most.
        other : str, optional
            Degree of freedom of the other axis; default: the velocity.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from nhbm import notebook, pictures

        if "point" in self._dataset.dims and dof and other:
            check_found(self._dataset, "coefficients")
            return pictures.orbits(self._dataset, dof, other)
        return notebook.drawn("orbit", self._dataset, [self._moving(dof), *([other] if other else [])])

    def spectrum(self, dof: str | None = None, over: str = "tuple") -> Any:
        """Draws the amplitudes of all harmonics of a motion.

        Parameters
        ----------
        dof : str, optional
            Degree of freedom; default: the one that moves most.
        over : str
            Axis: "tuple" or "frequency".

        Returns
        -------
        matplotlib.figure.Figure
        """
        from nhbm import notebook

        if over not in ("tuple", "frequency"):
            raise ModelError(f"over must be 'tuple' or 'frequency', not {over!r}")
        return notebook.drawn("spectrum", self._dataset, [self._moving(dof)], over=over)

    def animate(self, dof: str | None = None, frames: int = 60, fps: int = 20) -> Any:
        """Draws a motion that moves: in the phase plane, or on the torus of two tones, beside the motion over time.

        Parameters
        ----------
        dof : str, optional
            Degree of freedom; default: the one that moves most.
        frames, fps : int
            Number of pictures, and pictures a second.

        Returns
        -------
        Animation
            A notebook plays it; `save(path)` writes a GIF or MP4.
        """
        from nhbm import notebook

        for name, number in {"frames": frames, "fps": fps}.items():
            if not number >= 1:
                raise ModelError(f"{name} must be 1 or more, not {number!r}")
        return notebook.animated(self._dataset, self._moving(dof), frames, fps)

    def _moving(self, dof: str | None) -> str:
        """The given degree of freedom, or the one that moves most."""
        from nhbm.pictures import most_of

        check_found(self._dataset, "coefficients")
        check_motion(self._dataset)
        return dof or most_of(self._dataset)

    def events(self, *of: str) -> Any:
        """The located points of a curve: folds, peaks, bifurcations, ends.

        Parameters
        ----------
        *of : str
            Responses, each of which adds a column: "max x1", "x1 (1)".

        Returns
        -------
        pandas.DataFrame
            Kind, value of the parameter, responses, status, stability and branch; the index is the point. `located` names the
            response of a peak, if `peak_of` or other keys name several.
        """
        data = self._dataset
        if "curve_kind" not in data:
            raise ModelError("only curves have events; this dataset is not the result of `curve`")
        check_points(data)
        found = data.isel(point=~np.isin(data["curve_kind"].values, ("none", "regular")))
        columns: dict[str, Any] = {"kind": found["curve_kind"].values}
        names = _located_responses(self.input, data["curve_kind"].attrs["response_keys"]) if record_beside(data) else []
        if len(set(names)) > 1:
            columns["located"] = [["", *names][int(k)] for k in found.nhbm.details["curve_response"].values]
        columns.update({name: found[name].values for name in varies_of(data)})
        columns.update({one: found.nhbm.response(one).values for one in of})
        others = ("status", "stability", "n_unstable", "curve_branch")
        columns.update({name: found[name].values for name in others if name in found})
        import pandas

        return pandas.DataFrame(columns, index=pandas.Index(found["point"].values, name="point"))

    def harmonic(self, dof: str, tuple_: Any = 1, of: str = "coefficients") -> xr.DataArray:
        """Complex amplitude cos - i sin of a harmonic at a degree of freedom.

        Parameters
        ----------
        dof : str
            Label of a degree of freedom, or set of one node ("disk1.x"), or law, depending on the column.
        tuple_ : int or sequence of int
            Its tuple, of whole numbers.
        of : str
            Column: "coefficients" [m], "force_coefficients" [N], "corrected_coefficients" [m].

        Returns
        -------
        xarray.DataArray
            In the unit of the column, one value per point; NaN for points without a motion and for those whose set does not
            have the tuple, which is an error if no point has it. Even tuples of odd motions are zero.
        """
        data = self._dataset
        check_found(data, of)
        wanted = np.array(numbers_of("tuple_", tuple_, int))
        tuples = self._tuples()
        if len(wanted) != data.sizes["tone"]:
            needed = data.sizes["tone"]
            raise ModelError(f"tuple {tuple_} has the length {len(wanted)}; it needs {needed}, a whole number for each tone")
        sign = -1 if next((k for k in wanted if k), 0) < 0 else 1
        has = (tuples == sign * wanted).all("tone") & self._in_use()
        is_zero = self._is_odd() & bool(wanted.sum() % 2 == 0) & ~has.any("harmonic")
        if bool(self._has_motion().any()) and not bool((has | is_zero).any()):
            raise ModelError(f"the set of harmonics does not have the tuple {tuple_}: its amplitude is not known; "
                             f"the highest is {int(abs(tuples).max())}")  # fmt: skip
        found = self._row(of, dof).where(has).sum("harmonic", min_count=1)
        found = found.where(~is_zero, 0.0).where(self._has_motion())
        name, words = f"{dof} ({', '.join(map(str, wanted))})", f"complex amplitude of {dof}, {words_of_tuple(wanted.tolist())}"
        found = found.sel(component="cos", drop=True) - sign * 1j * found.sel(component="sin", drop=True)
        return self._named(found, name, words, self._unit(of, dof))

    def amplitude(self, dof: str, tuple_: Any = 1, of: str = "coefficients") -> xr.DataArray:
        """Amplitude of that harmonic; parameters and unit are those of `harmonic`."""
        complex_one = self.harmonic(dof, tuple_, of)
        size: Any = np.abs(complex_one)
        words = str(complex_one.attrs["long_name"]).removeprefix("complex ")
        return self._named(size, str(complex_one.name), words, str(complex_one.attrs["units"]))

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
            In the unit of the column, (..., time); a single time adds no dimension. NaN for points without a motion.
        """
        data = self._dataset
        check_found(data, of)
        tuples = self._tuples()
        if np.ndim(times) > 1:
            raise ModelError(f"times are a number or a list of them, not an array of {np.ndim(times)} dimensions")
        numbers = np.reshape(numbers_of("times", times), np.shape(times))
        times = xr.DataArray(numbers, dims="time" if np.ndim(times) else (), attrs={"units": "s"})
        phases = (tuples * data["frequency"]).sum("tone") * times
        column = self._row(of, dof).where(self._in_use(), 0.0)
        values = column.sel(component="cos", drop=True) * np.cos(phases) + column.sel(component="sin", drop=True) * np.sin(phases)
        found = values.sum("harmonic").where(self._has_motion()).assign_coords(time=times)
        return self._named(found, dof, f"{of.replace('_coefficients', '').replace('coefficients', 'displacement')} of {dof}",
                           self._unit(of, dof))  # fmt: skip

    def largest(self, dof: str) -> xr.DataArray:
        """Largest absolute displacement [m] over all times, as drawn by `nhbm-post`.

        Parameters
        ----------
        dof : str
            Degree of freedom.

        Returns
        -------
        xarray.DataArray
            The largest value over all phases, which several tones without a common period approach; NaN for points without a
            motion.
        """
        return self._peak(dof)[0]

    def _peak(self, dof: str) -> tuple[xr.DataArray, xr.DataArray]:
        """The largest absolute displacement of each motion, and the phases where it is."""
        from nhbm.hypertime import peaks

        data = self._dataset
        check_found(data, "coefficients")
        row = self._row("coefficients", dof).where(self._in_use(), 0.0)
        axes = [axis for axis in row.dims if axis not in ("harmonic", "component")]
        shape = [data.sizes[axis] for axis in axes]
        row = row.transpose(*axes, "harmonic", "component")
        tuples = self._tuples().transpose(..., "harmonic", "tone")
        n_points, n_tones = int(np.prod(shape)), data.sizes["tone"]
        waves = row.values.reshape(n_points, data.sizes["harmonic"], 2)
        of_points = np.broadcast_to(tuples.values, (n_points, *tuples.shape[-2:])) if tuples.ndim == 2 else tuples.values
        has_motion = np.broadcast_to(self._has_motion(), shape).ravel() & np.isfinite(waves).all(axis=(1, 2))
        sizes, phases = np.full(n_points, np.nan), np.full((n_points, n_tones), np.nan)
        alike: dict[bytes, list[int]] = {}  # points with the same tuples
        for point in np.flatnonzero(has_motion).tolist():
            alike.setdefault(of_points[point].tobytes(), []).append(point)
        for points in alike.values():
            sizes[points], phases[points] = peaks(of_points[points[0]], waves[points, :, 0], waves[points, :, 1])
        like = self._has_motion() if axes else xr.DataArray(0.0)
        size = xr.DataArray(sizes.reshape(shape), dims=axes, coords=like.coords)
        at = xr.DataArray(phases.reshape(*shape, n_tones), dims=[*axes, "tone"])
        return self._named(size, f"max {dof}", words_of(f"max {dof}"), self.unit_of(dof)), at

    def response(self, of: str) -> xr.DataArray:
        """A response of each point.

        Parameters
        ----------
        of : str
            "x1", the root mean square of its oscillation, "x1 (1)", the amplitude of a harmonic, or "max x1", the largest |x1|;
            with an asterisk, "x* (1)", the largest of all degrees of freedom whose names match.

        Returns
        -------
        xarray.DataArray
            In the unit of the degree of freedom, with the attributes `long_name` and `units`; NaN for points without a motion.
        """
        check_found(self._dataset, "coefficients")
        name = largest_of(of)
        dof, tuple_ = (name, None) if name is not None else parts_of(of)
        if is_pattern(dof):
            labels = matches(dof, [str(label) for label in self._dataset["dof"].values])
            units = {self.unit_of(label) for label in labels}
            if len(units) > 1:
                raise ModelError(f"'{of}' compares displacements with rotations: {', '.join(labels)}")
            each = xr.concat([self.response(of.replace(dof, label, 1)) for label in labels], "of", combine_attrs="drop")
            return self._named(each.max("of"), of, words_of(of), units.pop())
        if name is not None:
            return self._named(self.largest(dof), of, words_of(of), self.unit_of(dof))
        if tuple_ is not None:
            return self._named(self.amplitude(dof, tuple_), of, words_of(of), self.unit_of(dof))
        oscillates = self._tuples().any("tone") & self._in_use()
        squares = (self._row("coefficients", dof).where(oscillates) ** 2).sum(["harmonic", "component"], min_count=1)
        size: Any = np.sqrt(squares / 2)
        size = size.fillna(0.0).where(self._has_motion())
        return self._named(size, of, words_of(of), self.unit_of(dof))

    def unit_of(self, dof: str) -> str:
        """Unit of the displacement of a degree of freedom."""
        return self._unit("coefficients", dof)

    def _unit(self, of: str, name: str) -> str:
        """Unit of what a column has of a degree of freedom or a law."""
        column = self._column(of)
        units = str(column.attrs.get("dof_units", "")).split()
        known = [str(label) for label in column[column.dims[-3]].values]
        label = self._label(name, known)
        return units[known.index(label)] if label in known and len(units) == len(known) else str(column.attrs.get("units", "m"))

    @staticmethod
    def _named(values: xr.DataArray, name: str, words: str, unit: str) -> xr.DataArray:
        """Values with name and unit, as plots and files have them."""
        values = values.rename(name)
        values.attrs = {"long_name": words, "units": unit}
        return values

    def _has_motion(self) -> xr.DataArray:
        """Whether each point has a motion; all of a dataset that does not say so."""
        data = self._dataset
        return data["status"].isin(SOLVED) if "status" in data else xr.DataArray(True)

    def _is_odd(self) -> xr.DataArray:
        """Whether each motion is known to repeat with the opposite sign after half a period: its even harmonics are zero."""
        known = record_beside(self._dataset)
        found = None if known is None else known.find_odd()
        if found is None or not set(found.dims) <= set(self._dataset.dims):
            return xr.DataArray(False)
        is_selected = "point" in found.dims and "point" in self._dataset.coords
        return found.sel(point=self._dataset["point"].values) if is_selected else found

    def gradient(self, of: str) -> xr.DataArray:
        """Derivatives of a response with respect to the values of the group &gradient, in their units.

        For the largest displacement they are taken at its instant, with fixed phases.

        Parameters
        ----------
        of : str
            As for `response`: "x1", "x1 (1)", "max x1".

        Returns
        -------
        xarray.DataArray
            (..., gradient_value); NaN if the motion was not found or is not differentiable.
        """
        check_found(self._dataset, "coefficients")
        if "gradient" not in self._dataset:
            raise ModelError("there is no column 'gradient'; the group &gradient requests it: model.set('gradient', by=[...])")
        name = largest_of(of)
        dof, tuple_ = (name, None) if name is not None else parts_of(of)
        if tuple_ is not None:
            weight = self.harmonic(dof, tuple_)
            slope: Any = (weight.conj() * self.harmonic(dof, tuple_, "gradient")).real / abs(weight)
            return slope  # type: ignore[no-any-return]
        if name is None:
            oscillates = self._tuples().any("tone") & self._in_use()
            products = self._row("coefficients", dof) * self._row("gradient", dof)
            return products.where(oscillates, 0.0).sum(["harmonic", "component"], skipna=False) / (2 * self.response(of))
        at = self._peak(dof)[1]
        phases = (self._tuples() * at).sum("tone")
        parts = {"motion": self._row("coefficients", dof), "slopes": self._row("gradient", dof)}
        waves = {}
        for part, values in parts.items():
            values = values.where(self._in_use(), 0.0)
            cos, sin = (values.sel(component=c, drop=True) for c in ("cos", "sin"))
            waves[part] = (cos * np.cos(phases) + sin * np.sin(phases)).sum("harmonic", skipna=False)
        slopes_of_largest: xr.DataArray = (waves["slopes"] * np.sign(waves["motion"])).where(self._has_motion())
        return slopes_of_largest

    def plot(self, of: str | None = None, ax: Any = None) -> Any:
        """Plots the motion of a degree of freedom over time, or the response of a curve or sweep over its parameter.

        Parameters
        ----------
        of : str, optional
            For a motion a degree of freedom; for points a response as in `response`: "x1", "x1 (1)", "max x1". Default: the
            largest displacement of what moves most.
        ax : matplotlib.axes.Axes, optional
            Axes to plot into.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from nhbm.pictures import plot

        check_result(self._dataset)
        check_points(self._dataset)
        if "integration_verdict" in self._dataset and "coefficients" not in self._dataset:
            raise ModelError("this dataset is a verdict of 'verify', without a motion: plot the motion that was verified")
        if {"coefficients", "n_harmonics"} & set(self._dataset.variables):  # motions, not numbers
            check_found(self._dataset, "coefficients")
            check_motion(self._dataset)
        return plot(self._dataset, of, ax)

    def _row(self, of: str, name: str) -> xr.DataArray:
        """What a column has of a degree of freedom, by its label or by its set, or of a law."""
        column = self._column(of)
        if column.dims[-2:] != ("harmonic", "component"):
            raise ModelError(f"'{of}' has no harmonics; 'coefficients' and 'force_coefficients' have")
        axis = column.dims[-3]
        known = [str(label) for label in column[axis].values]
        label = self._label(name, known) if axis == "dof" else name
        if label not in known:
            sets = sum((str(names).split() for names in column["dof_of_set"].values), []) if "dof_of_set" in column.coords else []
            what = "degree of freedom" if axis == "dof" else "degree of freedom with a law" if axis == "law_dof" else axis
            one = largest_of(name) or parts_of(name)[0]
            hint = f"; '{one}' is one, '{name}' a response of curves and sweeps" if one != name and one in known else ""
            raise KeyError(f"there is no {what} '{name}'{hint}; known: {', '.join(known + sets)}")
        row: xr.DataArray = column.sel({axis: label})
        return row

    def _column(self, name: str) -> xr.DataArray:
        """A column, of the dataset or its details, with its harmonics last."""
        check_found(self._dataset, name)
        if name not in self._dataset and name not in self.details:
            known = [*map(str, self._dataset.data_vars), *map(str, self.details)]
            columns = {**self._dataset.data_vars, **self.details.data_vars}
            of_motions = [str(one) for one, column in columns.items() if "component" in column.dims]
            raise ModelError(f"there is no column '{name}'{meant(name, known) or '; those of motions: ' + ', '.join(of_motions)}")
        column = self._dataset[name] if name in self._dataset else self.details[name]
        if not {"harmonic", "component"} <= set(column.dims):
            return column
        return column.transpose(..., *(axis for axis in ("dof", "law_dof", "harmonic", "component") if axis in column.dims))

    def _label(self, name: str, known: list[str]) -> str:
        """The label of a degree of freedom that its set names."""
        if name in known or "dof_of_set" not in self._dataset.coords:
            return name
        words = [str(names).split() for names in self._dataset["dof_of_set"].values]
        return next((label for label, names in zip(known, words) if name in names), name)

    def _tuples(self) -> xr.DataArray:
        return self._dataset["tuples" if "tuples" in self._dataset.coords else "tuple"]

    def _in_use(self) -> xr.DataArray:
        """Which harmonics a motion has; all of a record of time integration."""
        if "n_harmonics" not in self._dataset:
            return xr.ones_like(self._dataset["harmonic"], dtype=bool)
        return self._dataset["harmonic"] < self._dataset["n_harmonics"]


for _name, _method in list(vars(Accessor).items()):
    if inspect.isfunction(_method) and not _name.startswith("_"):
        setattr(Accessor, _name, without_own_frames(_method))


def _located_responses(text: str, keys: str) -> list[str]:
    """The responses that the group &curve of a complete input locates, in the order of their numbers.

    `keys` are those that name responses, in this order, each with a colon and the key of its values if it has any.
    """
    lines = [line.partition("=") for line in text.partition("&curve")[2].partition("\n/")[0].splitlines()]
    values = {key.strip(): value for key, _, value in lines}
    names: list[str] = []
    for key, _, targets in (words.partition(":") for words in keys.split()):
        for name in re.findall(r"'([^']*)'", values.get(key, "")):
            names += [name] * (1 + values.get(targets, "").count(","))
    return names
