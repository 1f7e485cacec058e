"""Models in process: motions, curves and sweeps of a description, as xarray.Dataset."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime, timezone
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import nhbm.accessor  # noqa: F401  (every dataset has the accessor `nhbm`)
from nhbm import advice, dataset, sweeps
from nhbm._library import Motion, library
from nhbm.description import CHECKED_DOFS, CutCurve, answering, exclusive, place_of, size_of
from nhbm.docstrings import documented
from nhbm.errors import ModelError
from nhbm.groups import FILE_KEYS, SETS, changed_values, curve_range, described, request
from nhbm.keys import check_keys, keys_of
from nhbm.laws import Law
from nhbm.paths import identifier, path_of
from nhbm.peaks import Peaks
from nhbm.responses import gradient_of, is_pattern, parts_of, reject_largest, required_response_of, responses_in
from nhbm.rows import Rows
from nhbm.schema import AMPLITUDES, CENSUS_STARTS, SOLVED
from nhbm.session import Session
from nhbm.structure import Structure
from nhbm.sweeps import Progress
from nhbm.values import numbers_of



class Gradient(NamedTuple):
    """A response, and its derivatives with respect to the given values, in their order."""

    value: float
    slopes: Any  # np.ndarray


_MOST_POINTS = 4000  # of a curve whose number of points is not given


def _points_of(session: Session, full: list[int], *, is_limited: bool) -> Iterator[int]:
    """Moves a session to each point of a curve; without a given number of points there is room for more until it ends."""
    number = 0
    while True:
        while session.next():
            number += 1
            yield number
        if is_limited or 2 * number > _MOST_POINTS or not session.lengthen_curve(2 * number):
            return
        full.append(number)


class Model(Peaks):
    """A structure with tones, loads and laws.

    Keys, units and defaults are those of the input (docs/user/input.md). A model executes one operation at a time: further
    threads wait. It can be pickled with its values, for use in other processes.

    Parameters
    ----------
    structure : Builder, Structure, str or Path
        `nhbm.Beam(...)`, `nhbm.Chain(...)` and so on, sparse matrices, or the path of a model file.
    tones : array_like or dict
        Base frequencies [rad/s], or keys of the group &tones: ``{"hertz": 50.0}``, ``{"unknown": True}``.
    **groups : dict
        Further groups of the input by name, each a mapping of its keys: ``harmonics={"order": 9}``.

    Raises
    ------
    ModelError
        Invalid model, with group, key and a suggestion: keys, words and, for structures that are not large, whole groups are
        checked when they are added, other values by the operation that first needs them.

    Examples
    --------
    >>> import nhbm
    >>> oscillator = nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0)
    >>> model = nhbm.Model(oscillator, tones=[0.9])
    >>> model.load("x1", 1, cos=0.3)
    >>> model.law("cubic_spring", "x1", stiffness=0.5, label="spring")
    >>> model
    <nhbm.Model: structure matrices; frequency [0.9]; 1 load; 1 law (cubic_spring)>
    >>> motion = model.solve(order=7)
    >>> print(f"{float(motion.nhbm.amplitude('x1', 1)):.6f} m, {motion['stability'].item()}")
    0.737765 m, stable
    """

    @exclusive
    @documented
    def solve(self, *, tolerance: float | None = None, order: int | None = None, warm: bool = False) -> xr.Dataset:
        """Computes the motion.

        Parameters
        ----------
        {tolerance and order}
        {warm}

        Returns
        -------
        xarray.Dataset
            Motion, errors, stability and status, with the names, axes and units of the result file (docs/user/schema.md);
            `dataset.nhbm` has amplitudes, values over time, plots, `details`, `save`.

        Warns
        -----
        NotConverged
            The motion was not found, or is less accurate than requested, with the estimates, their limits and what to do; or a
            derivative of a law is wrong.
        Implausible
            A law exerts no force, or values of the model suggest a mistake.
        """
        session = self._begin(request(tolerance, order))
        session.solve(warm, points=self._sharing(1))
        session.clear_rows()
        session.add_row()
        rows = session.rows()
        motion = dataset.motion_of(rows, self._source(session, rows, is_written_later=True), self._attributes())
        self._solved = motion
        advice.warn_of(advice.on_motion(session))
        advice.warn_of_inactive_laws(session.advice("laws"))
        return motion

    @exclusive
    @documented
    def response(self, of: str, *, tolerance: float | None = None, order: int | None = None, warm: bool = True) -> float:
        """Computes the motion and returns one response, without a dataset: for optimisation and other loops.

        Parameters
        ----------
        of : str
            A degree of freedom, "x1", for the root mean square of its oscillation, or a harmonic of it, "x1 (1)" or "v3
            (1,0)", for its amplitude.
        {tolerance and order}
        {warm}

        Returns
        -------
        float
            In the unit of the degree of freedom [m or rad]; NaN, with the warning NotConverged, if no motion was found.
        """
        reject_largest(of)
        session = self._begin(request(tolerance, order))
        session.solve(warm, points=0)
        advice.warn_of(advice.on_motion(session))
        self._warn_of_inactive_laws(session)
        return required_response_of(session, of) if session.status in SOLVED else float("nan")

    @exclusive
    @documented
    def gradient(self, of: str, by: Iterable[str], *, tolerance: float | None = None, order: int | None = None,
                 warm: bool = True) -> Gradient:  # fmt: skip
        """Computes the motion and returns a response with its derivatives: for gradient-based optimisation.

        One linear solution with the transposed tangent of the motion serves all values but frequencies. If contact or friction
        begins or ends at this motion, derivatives are one-sided: see `gradient_defect` of `solve` with the group &gradient.

        Parameters
        ----------
        of : str
            A response, as for `response`.
        by : iterable of str
            Paths of the values, "wall.gap".
        {tolerance and order}
        {warm}

        Returns
        -------
        Gradient
            The response, and its derivatives in its unit over those of the values. With the warning NotConverged, both are NaN
            if no motion was found, and derivatives alone if it was found by time integration.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
        >>> model.load("x1", 1, cos=0.1)
        >>> model.law("cubic_spring", "x1", stiffness=0.5, label="spring")
        >>> value, slopes = model.gradient("x1 (1)", ["spring.stiffness"], order=7)
        >>> model["spring.stiffness"] = 0.5 + 1e-6
        >>> further = model.response("x1 (1)", order=7)
        >>> bool(abs((further - value) / 1e-6 - slopes[0]) < 1e-4 * abs(slopes[0]))
        True
        """
        reject_largest(of)
        paths = self._paths(by)
        of_one = {} if is_pattern(parts_of(of)[0]) else {"of": of}  # the largest is known behind the solution
        session = self._begin(request(tolerance, order, gradient={"by": paths, **of_one}))
        session.solve(warm, points=0)
        advice.warn_of(advice.on_motion(session))
        self._warn_of_inactive_laws(session)
        if session.status not in SOLVED:
            return Gradient(float("nan"), np.full(len(paths), np.nan))
        value = required_response_of(session, of)
        if not value:
            raise ModelError(f"'{of}' is zero, where an amplitude has no derivative")
        slopes = gradient_of(session, of)
        if np.isnan(slopes).any():
            advice.warn(advice.on("no_derivatives_of_motion", session.message or "it is not differentiable").text)
        return Gradient(value, slopes)

    def _warn_of_inactive_laws(self, session: Session) -> None:
        """Warns of laws that exert no force on a motion, once each: a loop may pass through such motions."""
        inactive = [] if self._is_trial else [law for law in session.advice("laws") if law.text not in self._warned]
        self._warned.update(law.text for law in inactive)
        advice.warn_of_inactive_laws(inactive)

    @exclusive
    @documented
    def curve(self, path: str, start: float, stop: float, *, tolerance: float | None = None, order: int | None = None,
              on_point: Callable[[xr.Dataset], bool] | None = None, progress: Any = False, **keys: Any) -> xr.Dataset:  # fmt: skip
        """Traces a response curve through folds, with stability and bifurcations.

        Parameters
        ----------
        path : str
            Path of the value: "tones[0]", "wall.gap".
        start, stop : float
            Its range, in its unit.
        {tolerance and order}
        on_point : function, optional
            Called with the dataset of each point; return True to end the curve, which `nhbm resume` continues in a saved file.
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the number of points.
        **keys
            Keys of the group &curve (docs/user/curves.md), such as ``peak_of="x1 (1)", points=200``; its `start`, a value between
            the ends from which both directions are traced, is called `first` here. A curve that has reached its number of
            `points` is continued by the same call with more of them, if no value of the model has changed; without `points` it
            gets more until it ends, at most 4,000. `switch` follows branch
            points alone: motions that bifurcate with another period or tone are followed by the command, into files of their own.

        Returns
        -------
        xarray.Dataset
            As for `solve`, with the dimension `point`; `curve_kind` names folds, peaks and bifurcations, and
            `dataset.nhbm.events()` lists them. The warning
            NotConverged is issued if the curve stops before the end of its range, or turns back without reaching it.

        Examples
        --------
        >>> import nhbm
        >>> oscillator = nhbm.Matrices(mass=1.0, damping=0.05, stiffness=1.0)
        >>> model = nhbm.Model(oscillator, tones=[0.5])
        >>> model.load("x1", 1, cos=0.18)
        >>> model.law("cubic_spring", "x1", stiffness=0.1)
        >>> curve = model.curve("tones[0]", 0.5, 2.0, order=15)
        >>> print([f"{float(omega):.6f}" for omega in curve["tones_frequency"][curve["curve_kind"] == "fold"]])
        ['1.269602', '1.115700']
        """
        if on_point is not None and not callable(on_point):
            raise ModelError(f"on_point must be a function of the dataset of a point, not {on_point!r}")
        path = self._resolved(path)
        if "over" in keys:
            keys["over"] = self._resolved(keys["over"])
        for key in keys_of("curve").values():
            if key.type == "list of texts":  # responses, of all kinds of located points
                reject_largest(*responses_in(keys.get(key.name), key.name))
        settings = request(tolerance, order, curve={"parameter": path, **curve_range(start, stop, keys)})
        cut = self._continue_cut(settings) if on_point is None else None
        parts: list[Rows] = []  # points of an earlier call, and of each part of this one
        doubtful: list[tuple[str, list[advice.Advice]]] = []
        has_warned, is_stopped, inactive = False, False, None  # laws without force on all points
        full: list[int] = []  # numbers of points at which there was no room for more
        if cut is None:
            session = self._begin(settings)
            session.begin_curve()
        else:
            session, parts, doubtful, inactive = self._ready(settings), [cut.rows], cut.doubtful, cut.inactive
        session.clear_rows()
        with Progress(progress, "curve") as bar:
            for _ in range(sum(map(len, parts))):
                bar.update()
            for _ in _points_of(session, full, is_limited="points" in keys):
                session.add_row()
                status, found_here = session.status, advice.on_motion(session)
                doubtful += [(status, found_here)] if found_here else []
                if status in SOLVED and (inactive is None or inactive):
                    inactive = [law for law in session.advice("laws") if inactive is None or law in inactive]
                bar.update()
                if on_point is None:
                    continue
                parts.append(session.rows())
                session.clear_rows()
                if on_point(self._on_curve(parts[-1], path, self._source(session, parts[-1])).isel(point=0)):
                    is_stopped = True
                    break
        if on_point is None:
            parts.append(session.rows())
        if not any(map(len, parts)):
            raise ModelError(session.message or "the curve has no points")
        rows = Rows.joined(parts)
        if cut is not None and len(rows) > len(cut.rows):
            full.append(len(cut.rows))
        rows.values["reason"][[n - 1 for n in full]] = 0  # there was room for more
        if not is_stopped:
            values = rows.values.get(identifier(path), np.zeros(0))
            has_warned = advice.warn_of_end(session, path, values[np.isfinite(values)].tolist(), stop - start)
            if has_warned and session.reason == "points":
                self._cut = CutCurve(settings, session.serial, rows, [*doubtful], inactive)
        source = self._source(session, rows)
        source.is_complete = not is_stopped
        found = self._on_curve(rows, path, source)
        if doubtful and (doubtful[-1][0] in ("collapsed", "locked") or (has_warned and doubtful[-1][0] not in SOLVED)):
            doubtful.pop()  # the end of the curve, where the motion vanishes or that was reported
        advice.warn_of_points(doubtful, len(rows))
        advice.warn_of_inactive_laws(inactive or [])
        if not (is_stopped or has_warned or "over" in keys):
            ends = found[identifier(path)].values[found["curve_kind"].values == "end"].tolist()
            advice.warn_of_return(ends, start, stop, keys.get("first", start))
        if keys.get("switch"):
            kinds = found["curve_kind"]
            advice.warn_of_bifurcations(kinds.values.tolist(), kinds.attrs["origins"].split(), path)
        return found

    @exclusive
    @documented
    def census(self, *, starts: int = 200, seed: int = 1, time_limit: float = 0.0, tolerance: float | None = None,
               order: int | None = None, progress: Any = False) -> xr.Dataset:  # fmt: skip
        """Searches for all coexisting motions, and estimates how many were missed.

        Parameters
        ----------
        starts : int
            Number of random starts, after directed ones: static equilibria, and vibrations about them.
        seed : int
            Of the random starts.
        time_limit : float
            Of the starts and the descriptions of the motions [s]; 0: none.
        {tolerance and order}
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the numbers of starts done and planned.

        Returns
        -------
        xarray.Dataset
            The motions as for `solve`, with the dimension `point`, by size. `census_found` is the number of random starts that led
            to each of them, `census_start` the start that found it, `census_mirror_of` the motion whose mirror image it is, or -1.
            Attributes: `census_starts`, `census_lost`, starts that led to no motion, `census_unseen` and `census_unseen_bound`,
            the probability that a further random start finds an unknown motion and its bound with 95 %, `census_missed`, the
            estimated number of motions that were missed, at least, `census_least_share`: motions to which a smaller share of the
            converged random starts leads may be missed (95 %), and `census_is_reliable`, whether there were enough finds.

        Examples
        --------
        >>> import nhbm
        >>> oscillator = nhbm.Matrices(mass=1.0, damping=0.05, stiffness=1.0)
        >>> model = nhbm.Model(oscillator, tones=[1.2])
        >>> model.load("x1", 1, cos=0.18)
        >>> model.law("cubic_spring", "x1", stiffness=0.1)
        >>> found = model.census(order=7)
        >>> print([f"{float(size):.4f}" for size in found.nhbm.amplitude("x1")])
        ['0.4175', '2.2605', '2.5092']
        """
        for name, number in {"starts": starts, "seed": seed}.items():
            if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 0 <= number < 2**31:
                raise ModelError(f"{name} must be a whole number, 0 or more, not {number!r}")
        session = self._begin(request(tolerance, order))
        with Progress(progress, "census", unit="start") as bar, session.reporting(bar.reach):
            census = session.take_census(int(starts), int(seed), numbers_of("time_limit", time_limit)[0])
        if not census.n_motions:
            is_cut = census.n_left > 0
            raise ModelError("the time limit ended the census before a motion was found" if is_cut else "no start led to a motion")
        session.clear_rows()
        finds = []
        for index in range(census.n_motions):
            finds.append(session.select(index))
            session.add_row()
        rows = session.rows()
        columns = {
            "census_motion": np.arange(len(finds), dtype=np.int32),
            "census_found": np.array([find.n_random for find in finds], np.int32),
            "census_start": np.array([CENSUS_STARTS[find.start] for find in finds], dtype=object),
            "census_mirror_of": np.array([find.mirror_of for find in finds], np.int32),
        }
        values = {name: (column, dataset.described_find(name)) for name, column in columns.items()}
        estimates = {
            "varies": list(values),
            "census_starts": census.n_random,
            "census_lost": census.n_random_lost,
            "census_directed_starts": census.n_directed,
            "census_unseen": census.unseen,
            "census_unseen_bound": census.unseen_bound,
            "census_missed": census.missed,
            "census_least_share": census.least_share,
            "census_is_reliable": int(census.is_reliable),
        }
        source = self._source(session, rows)
        return dataset.result_of(dataset.columns_of(rows, True), source, values, {**estimates, **self._attributes()})

    def _on_curve(self, rows: Rows, path: str, source: dataset.Source) -> xr.Dataset:
        """Points of a curve as users get them."""
        name, columns = identifier(path), dataset.columns_of(rows, True)
        if name not in columns:
            text = next((str(text) for text in columns["message"].values if text), "")
            status = str(dataset.with_words(columns)["status"].values[0])
            raise ModelError(f"no motion was found (status {status}). {text}".rstrip())
        values = {name: (columns[name].values, {**columns[name].attrs, **self._described(path), "moves_along": "curve"})}
        return dataset.result_of(columns.drop_vars(name), source, values, {"varies": [name], **self._attributes()})

    @exclusive
    def integrate(self, duration: float | None = None, *, order: int | None = None, **keys: Any) -> xr.Dataset:
        """Integrates the model in time, by default from rest. A model without tones needs a `step`.

        Parameters
        ----------
        duration : float, optional
            Length of the record [s], after the `transient`; by default that of the group &integration.
        order : int, optional
            Highest order of the coefficients of the record.
        **keys
            Keys of the group &integration: `method`, `transient` [s], `step` [s], ...

        Returns
        -------
        xarray.Dataset
            The record, as written by `nhbm integrate`.
        """
        given = {"duration": None if duration is None else numbers_of("duration", duration)[0], **keys}
        if duration is not None and not given["duration"] > 0:
            raise ModelError(f"duration must be above 0, the length of the record [s], not {duration}")
        check_keys("integration", keys)
        given = {key: value for key, value in given.items() if value is not None}
        session = self._ready(request(None, order, integration=given))
        session.integrate()
        return dataset.record_of(session)

    @exclusive
    def verify(self, motion: xr.Dataset | None = None, *, periods: int = 0, time_limit: float = 0.0,
               progress: Any = False) -> xr.Dataset:  # fmt: skip
        """Integrates in time from a motion, and from a perturbed state, to verify the motion and its stability.

        Parameters
        ----------
        motion : xarray.Dataset, optional
            A motion of this model: of `solve`, or a point of a curve, sweep or file, ``curve.isel(point=3)``, at whose values it
            is verified. Default: the motion that `solve` has found last.
        periods : int
            Largest number of periods of the slowest tone; 0: from the decay rate.
        time_limit : float
            Processor time [s] after which the verdict is "undecided" and the duration 0; 0: no limit.
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the steps done and planned, which disturbances that decay slowly
            extend.

        Returns
        -------
        xarray.Dataset
            The results of `nhbm verify`: `integration_verdict` ("agrees", "unstable", "differs", "undecided"), the
            differences in the first and in the last periods, the limit of the latter from the estimated error, the growth
            rate of disturbances [1/s].
        """
        if isinstance(periods, bool) or not isinstance(periods, (int, np.integer)) or not 0 <= periods < 2**31:
            raise ModelError(f"periods must be a whole number, 0 for as many as the decay requires, not {periods!r}")
        limit = numbers_of("time_limit", time_limit)[0]
        if limit < 0.0:
            raise ModelError(f"time_limit must be a time [s], or 0 for no limit, not {time_limit!r}")
        if motion is None:
            motion = self._solved
        if motion is None:
            raise ModelError("there is no motion of `solve` that can be verified")
        return self._verify_motion(motion, int(periods), limit, progress)

    def _verify_motion(self, motion: xr.Dataset, periods: int, limit: float, progress: Any) -> xr.Dataset:
        """The verdict on a motion, at the values for which it was found."""
        if not isinstance(motion, xr.Dataset):
            raise ModelError(f"give a motion, as of model.solve() or curve.isel(point=3), not {type(motion).__name__}")
        dataset.check_found(motion, "coefficients")
        dataset.check_motion(motion)
        if "point" in motion.dims:
            raise ModelError("give one motion, such as curve.isel(point=3)")
        here = copy.copy(self)
        varied = []
        for value in motion.coords.values():
            if "parameter" in value.attrs:
                varied.append(str(value.attrs["parameter"]))
                here[varied[-1]] = value.item()
        record = dataset.record_beside(motion)
        changed = changed_values(record.source.text, here._input(), varied) if record is not None else ""
        if changed:
            raise ModelError(f"the model has changed since this motion was found: {changed}")
        n, tuples = self._checked_shapes(motion)
        parts = {
            "frequency": np.ascontiguousarray(motion["frequency"].values, float),
            "tuples": np.ascontiguousarray(tuples.values[:n], np.int32),
            "coefficients": np.ascontiguousarray(motion["coefficients"].values[:, :n], float),
            "frequency_estimate": np.ascontiguousarray(motion.get("frequency_estimate", np.nan * motion["frequency"]), float),
        }
        numbers = {name: float(motion.get(name, np.nan)) for name in ("truncation_estimate", "aliasing_estimate")}
        has_own_tuples = "tuples" in motion.coords or dataset.has_own_tuples(motion)
        order = None if has_own_tuples else abs(parts["tuples"]).max(axis=0).tolist()
        session = here._ready(request(None, order))
        session.check()
        sizes = {"n_tones": len(parts["frequency"]), "n_harmonics": n, "n_dofs": len(parts["coefficients"])}
        words = {"status": session.words_of("status").index(motion["status"].item()), "n_unstable": int(motion["n_unstable"])}
        addresses = {name: part.ctypes.data for name, part in parts.items()}
        session.limit_verification(limit)
        with Progress(progress, "verify", unit="step") as bar, session.reporting(bar.reach):
            session.verify_motion(Motion(**sizes, **addresses, **numbers, **words), periods)
        return dataset.record_of(session)

    @staticmethod
    def _checked_shapes(motion: xr.Dataset) -> tuple[int, xr.DataArray]:
        """Number of harmonics of a motion, and its tuples; ModelError if its arrays are not as long as they say."""
        tuples = motion["tuples" if "tuples" in motion.coords else "tuple"]
        n = int(motion["n_harmonics"])
        axes = {"coefficients": ("dof", "harmonic", "component"), "frequency": ("tone",), str(tuples.name): ("harmonic", "tone")}
        for name, wanted in axes.items():
            found = motion[name].dims
            if found != wanted:
                raise ModelError(f"'{name}' of a motion has the axes {', '.join(wanted)}, not {', '.join(map(str, found))}")
        lengths = dict(motion.sizes)
        if not 1 <= n <= lengths["harmonic"] or lengths["component"] != 2:
            raise ModelError(
                f"a motion of {n} harmonics has as many coefficients, cosine and sine of each; this dataset has "
                f"{lengths['harmonic']} harmonics and {lengths['component']} components: give the whole motion"
            )
        estimate = motion.get("frequency_estimate")
        if estimate is not None and estimate.dims != ("tone",):
            raise ModelError("'frequency_estimate' of a motion has the axis tone")
        return n, tuples

    @exclusive
    def check(self) -> list[str]:
        """Checks the model without solving it.

        Returns
        -------
        list of str
            Warnings: tones with a common period, no load, values that suggest a mistake. An invalid value raises ModelError.
            Derivatives of laws are compared with differences by the first solution.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Matrices(mass=1.0, stiffness=2.0), tones=[0.9])
        >>> model.check()
        ['no load acts and no tone is unknown: only laws can cause a motion']
        """
        return [one.text for one in self._ready({}).advice("model")]

    @exclusive
    def natural_frequencies(self, n: int | None = None) -> Any:
        """Natural frequencies of the structure, without damping and laws.

        Parameters
        ----------
        n : int, optional
            Number of the lowest ones; default: up to ten.

        Returns
        -------
        numpy.ndarray
            [rad/s], ascending; with gyroscopic terms for structures of up to 200 degrees of freedom.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Matrices(mass=1.0, stiffness=4.0), tones=[0.9])
        >>> model.natural_frequencies()
        array([2.])
        """
        if n is not None and (isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1):
            raise ModelError(f"n must be a whole number, 1 or more, not {n!r}")
        found = self._ready({}).natural_frequencies()
        group = self._groups.first("structure")
        structure = None if group is None else group.keys.get("file")
        if not len(found) and isinstance(structure, str):
            structure = self._find_structure(structure)
        if not len(found) and isinstance(structure, Structure):
            from nhbm.checks import lowest_frequencies

            found = lowest_frequencies(structure, n or 10)
        if n is not None and n > len(found):
            raise ModelError(f"n = {n}, but the structure has {len(found)} natural frequenc{'y' if len(found) == 1 else 'ies'}")
        return found[: n or 10]

    sweep = answering(sweeps.sweep)

    def _sharing(self, n: int) -> int:
        """Points that share the time for stability: none where its work, counted as that of compiled laws, would take minutes."""
        laws = [group.keys.get("name") for group in self._groups.named("law")]
        return 0 if any(isinstance(law, Law) and law.steps_slowly for law in laws) else n

    def _source(self, session: Session, rows: Rows, is_written_later: bool = False) -> dataset.Source:
        """What the motions of a session belong to."""
        sets = self._groups.with_settings(self._used).named("harmonics")
        has_own_tuples = not any(key in group.keys for group in sets for key in SETS)
        structure = self._groups.first("structure")
        file = None if structure is None else structure.keys.get("file")
        write = self._writer() if is_written_later else None
        text, libraries = ("", "") if write else (session.input(), session.libraries())
        in_memory = file if isinstance(file, Structure) else None
        source = dataset.Source(text, has_own_tuples, libraries, self._folder, in_memory, write)
        source.absent = dataset.absent_from(rows.layout)
        source.labels = {axis: session.labels(axis) for axis in ("law", "multiplier")}
        return source

    def _writer(self) -> Callable[[], tuple[str, str]] | None:
        """What returns the complete input and the files for the present values, by reading these again; None if that
        takes long or files may have changed by then."""
        groups, structure = self._groups.with_settings(self._used), self._groups.first("structure")
        is_small = structure is None or size_of(structure) <= CHECKED_DOFS
        if not is_small or any(key in group.keys for group in groups for key in FILE_KEYS):
            return None
        snapshot, place = groups.snapshot(), place_of(self._folder)

        def write() -> tuple[str, str]:
            again = Session()
            again.hold(snapshot, place)
            again.check()
            return again.input(), again.libraries()

        return write

    def _attributes(self) -> dict[str, Any]:
        """Attributes of a result, as in a file."""
        output = self._groups.first("output")
        return {
            "schema_version": np.int32(1),
            "program_version": library().nhbm_get_version().decode(),
            "git_commit": library().nhbm_get_commit().decode(),
            "created_utc": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "title": "" if output is None else str(output.keys.get("title", "")),
            "amplitude_convention": AMPLITUDES,
            "n_ranks": np.int32(1),
        }

    def _described(self, path: str) -> dict[str, str]:
        """Attributes of a value that varies: path, name and unit."""
        return {"parameter": path, **described(path_of(path), self._groups)}

    def _ending(self) -> tuple[str, str, list[advice.Advice]]:
        """Status and message of the last solution, and advice on it; converged if there was none."""
        session = self._session
        if session is None or not session.has_motion:
            return "converged", "", []
        return session.status, session.message, advice.on_motion(session)
