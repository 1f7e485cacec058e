"""The largest response along a curve, its position, and the derivatives of both."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from nhbm import advice
from nhbm.description import Description, exclusive
from nhbm.docstrings import documented
from nhbm.errors import Implausible, ModelError
from nhbm.groups import curve_range, request
from nhbm.paths import identifier
from nhbm.responses import gradient_of, reject_largest, response_of
from nhbm.schema import SOLVED
from nhbm.session import Session
from nhbm.sweeps import Progress


class Peak(NamedTuple):
    """The largest response of a curve, and the value of the parameter there."""

    value: float
    at: float


class PeakGradient(NamedTuple):
    """The largest response of a curve, its position, and the derivatives of both with respect to the given values, in their
    order."""

    value: float
    at: float
    slopes: Any  # np.ndarray
    at_slopes: Any  # np.ndarray


class Peaks(Description):
    """A model with the peaks of its curves."""

    @exclusive
    @documented
    def peak(self, of: str, path: str, start: float, stop: float, *, tolerance: float | None = None, order: int | None = None,
             progress: Any = False, **keys: Any) -> Peak:  # fmt: skip
        """Traces a curve like `curve` and returns its largest response.

        Stability and, for a given order, error estimates are not computed. Folds are passed.

        Parameters
        ----------
        of : str
            A response, as for `response`.
        path : str
            Path of the continuation parameter.
        start, stop : float
            Its range, in its unit.
        {tolerance and order}
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the number of points of the curve.
        **keys
            Of the group &curve.

        Returns
        -------
        Peak
            The response and the value of the parameter there; NaN, with the warning NotConverged, if the curve stops
            before the end of its range. The warning Implausible is issued if it is at an end of the range.
        """
        keys = curve_range(start, stop, keys)
        return self._highest(of, path, keys, tolerance, order, {}, lambda _, value, at: Peak(value, at), progress) or Peak(
            np.nan, np.nan
        )

    @exclusive
    @documented
    def peak_gradient(self, of: str, by: Iterable[str], path: str, start: float, stop: float, *, tolerance: float | None = None,
                      order: int | None = None, progress: Any = False, **keys: Any) -> PeakGradient:  # fmt: skip
        """Computes the largest response of a curve like `peak`, with its derivatives: for gradient-based optimisation.

        Parameters
        ----------
        of : str
            A response, as for `response`.
        by : iterable of str
            Paths of the values, "wall.gap".
        path : str
            Path of the continuation parameter.
        start, stop : float
            Its range, in its unit.
        {tolerance and order}
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the number of points of the curve.
        **keys
            Of the group &curve.

        Returns
        -------
        PeakGradient
            The response, the value of the parameter there, and the derivatives of both; those of the value are zero if the
            maximum is at an end of the range. NaN, with the warning NotConverged, if the curve stops before the end of its range.
            `at_slopes` alone is NaN with several tones, and for friction with memory or rigid contact where the peak of a value
            3 % off is not found.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
        >>> model.load("x1", 1, cos=0.1)
        >>> model.law("cubic_spring", "x1", stiffness=0.5, label="spring")
        >>> found = model.peak_gradient("x1 (1)", ["spring.stiffness"], "tones[0]", 0.8, 1.6, order=7)
        >>> model["spring.stiffness"] = 0.5 + 1e-5
        >>> further = model.peak("x1 (1)", "tones[0]", 0.8, 1.6, order=7)
        >>> bool(abs((further.at - found.at) / 1e-5 - found.at_slopes[0]) < 1e-3 * found.at_slopes[0])
        True
        """
        paths = self._of_peaks(by, path)
        none = np.full(len(paths), np.nan)
        groups, keys = {"gradient": {"by": paths}}, curve_range(start, stop, keys)
        return self._highest(of, path, keys, tolerance, order, groups, _with_slopes(of, paths), progress) or PeakGradient(
            np.nan, np.nan, none, none
        )

    @exclusive
    @documented
    def peaks(self, of: str, path: str, start: float, stop: float, *, by: Iterable[str] = (), tolerance: float | None = None,
              order: int | None = None, progress: Any = False, **keys: Any) -> list[PeakGradient]:  # fmt: skip
        """Finds all peaks of a response along a curve, with their derivatives: for the minimisation of the largest of them.

        The largest peak alone (`peak`, `peak_gradient`) has a kink where two peaks are equally high, which is where the optimum of
        several parameters is: a gradient method stalls there. Each peak by itself is smooth (docs/howto/optimise_damper.md).

        Parameters
        ----------
        of : str
            A response, as for `response`.
        path : str
            Path of the continuation parameter.
        start, stop : float
            Its range, in its unit.
        by : iterable of str
            Paths of the values to differentiate by; none by default.
        {tolerance and order}
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the number of points of the curve.
        **keys
            Of the group &curve.

        Returns
        -------
        list of PeakGradient
            The peaks in their order along the curve, as `peak_gradient` returns one. With the warning NotConverged, those before
            the point where a curve stops.

        Examples
        --------
        >>> import nhbm, numpy as np
        >>> structure = nhbm.Matrices(mass=np.eye(2), stiffness=[[2.0, -1.0], [-1.0, 2.0]], damping=0.05 * np.eye(2))
        >>> model = nhbm.Model(structure, tones=[1.0])
        >>> model.load("x1", 1, cos=1.0)
        >>> [f"{peak.at:.2f} rad/s, {peak.value:.2f} m" for peak in model.peaks("x1 (1)", "tones[0]", 0.5, 2.5, order=1)]
        ['1.00 rad/s, 10.00 m', '1.73 rad/s, 5.79 m']
        """
        paths, found = self._of_peaks(by, path) if by else [], []
        evaluate = _with_slopes(of, paths)

        def visit(session: Session, value: float, at: float) -> None:
            if session.kind == "peak":
                found.append((evaluate(session, value, at), advice.on_motion(session)))

        groups = {"gradient": {"by": paths}} if paths else {}
        self._trace(of, path, curve_range(start, stop, keys), tolerance, order, groups, visit, progress)
        advice.warn_of(dict.fromkeys(one for _, on_peak in found for one in on_peak))
        return [peak for peak, _ in found]

    def _of_peaks(self, by: Iterable[str], path: str) -> list[str]:
        """The values by which peaks over a path are differentiated."""
        paths = self._paths(by)
        if self._resolved(path) in paths:
            raise ModelError(f"'{path}' varies along the curve, so that the peak does not depend on it: leave it out of by")
        return paths

    def _highest(self, of: str, path: str, keys: dict[str, Any], tolerance: float | None, order: int | None,
                 groups: dict[str, Any], evaluate: Callable[[Session, float, float], Any], progress: Any) -> Any:  # fmt: skip
        """The result of `evaluate` for the session, the response and the varied value where the response is largest; None, and a
        warning, if the curve stops before the end of its range."""
        best: dict[str, Any] = {"value": -1.0, "at": np.nan, "found": None, "advice": []}

        def visit(session: Session, value: float, at: float) -> None:
            if value > best["value"]:
                best.update(value=value, at=at, found=evaluate(session, value, at), advice=advice.on_motion(session))

        if not self._trace(of, path, keys, tolerance, order, groups, visit, progress):
            return None
        advice.warn_of(best["advice"])
        if any(abs(best["at"] - end) <= 1e-9 * abs(keys["to"] - keys["from"]) for end in (keys["from"], keys["to"])):
            advice.warn(advice.on("largest_at_end", of, self._resolved(path), f"{best['at']:g}").text, Implausible)
        return best["found"]

    def _trace(self, of: str, path: str, keys: dict[str, Any], tolerance: float | None, order: int | None, groups: dict[str, Any],
               visit: Callable[[Session, float, float], None], progress: Any) -> bool:  # fmt: skip
        """Calls `visit` with the session, the response and the varied value at each point of a curve; whether it reaches the end of
        its range, with a warning if not."""
        reject_largest(of)
        path = self._resolved(path)
        curve = {"points": 10000, "parameter": path, "peak_of": of, **keys}  # none of which are stored
        groups = {"curve": curve, "stability": {"method": "off"}, **groups}
        if order is not None:
            groups["error_estimate"] = {"is_on": False}  # what is not returned is not made
        session = self._begin(request(tolerance, order, **groups))
        ends, values = [], []
        session.begin_curve()
        with Progress(progress, "curve") as bar:
            while session.next():
                bar.update()
                if session.status not in SOLVED:
                    continue
                values.append(float(session.column(identifier(path)).values))
                if session.kind == "end":
                    ends.append(values[-1])
                visit(session, response_of(session, of), values[-1])
        if advice.warn_of_end(session, path, values, keys["to"] - keys["from"]):
            return False
        advice.warn_of_return(ends, keys["from"], keys["to"], keys.get("start", keys["from"]))
        return True


def _with_slopes(of: str, paths: list[str]) -> Callable[[Session, float, float], PeakGradient]:
    """A function of a session, a response and its position that adds their derivatives by the values at paths."""
    none = np.full(len(paths), np.nan)

    def here(session: Session, value: float, at: float) -> PeakGradient:
        moves = session.column("position_gradient").values if paths else None
        return PeakGradient(value, at, gradient_of(session, of) if paths else none, none if moves is None else moves.copy())

    return here
