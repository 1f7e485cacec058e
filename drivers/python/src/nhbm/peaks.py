"""The largest response along a curve, its position, and the derivatives of both."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from nhbm import doubts
from nhbm.description import Description, exclusive
from nhbm.docstrings import documented
from nhbm.errors import Implausible, ModelError
from nhbm.groups import curve_range, request
from nhbm.paths import identifier
from nhbm.responses import gradient_of, refuse_largest, response_of
from nhbm.schema import SOLVED
from nhbm.session import Session


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
             **keys: Any) -> Peak:  # fmt: skip
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
        **keys
            Of the group &curve.

        Returns
        -------
        Peak
            The response and the value of the parameter there; NaN, with the warning NotConverged, if the curve stops
            before the end of its range. The warning Implausible is issued if it is at an end of the range.
        """
        keys = curve_range(start, stop, keys)
        return self._highest(of, path, keys, tolerance, order, {}, lambda _, value, at: Peak(value, at)) or Peak(np.nan, np.nan)

    @exclusive
    @documented
    def peak_gradient(self, of: str, by: Iterable[str], path: str, start: float, stop: float, *, tolerance: float | None = None,
                      order: int | None = None, **keys: Any) -> PeakGradient:  # fmt: skip
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
        paths = self._paths(by)
        if self._resolved(path) in paths:
            raise ModelError(f"'{path}' varies along the curve, so that the peak does not depend on it: leave it out of by")
        none = np.full(len(paths), np.nan)

        def here(session: Session, value: float, at: float) -> PeakGradient:
            moves = session.column("position_gradient").values
            return PeakGradient(value, at, gradient_of(session, of), none if moves is None else moves.copy())

        groups, keys = {"gradient": {"by": paths}}, curve_range(start, stop, keys)
        return self._highest(of, path, keys, tolerance, order, groups, here) or PeakGradient(np.nan, np.nan, none, none)

    def _highest(self, of: str, path: str, keys: dict[str, Any], tolerance: float | None, order: int | None,
                 groups: dict[str, Any], evaluate: Callable[[Session, float, float], Any]) -> Any:  # fmt: skip
        """The result of `evaluate` for the session, the response and the varied value where the response is largest; None, and a
        warning, if the curve stops before the end of its range."""
        refuse_largest(of)
        path = self._resolved(path)
        curve = {"points": 10000, "parameter": path, "peak_of": of, **keys}  # none of which are stored
        groups = {"curve": curve, "stability": {"method": "off"}, **groups}
        if order is not None:
            groups["error_estimate"] = {"is_on": False}  # what is not returned is not made
        session = self._begin(request(tolerance, order, **groups))
        best, best_at, found, doubt, ends, values = -1.0, np.nan, None, "", [], []
        session.begin_curve()
        while session.next():
            if session.status not in SOLVED:
                continue
            value, at = response_of(session, of), float(session.column(identifier(path)).values)
            values.append(at)
            if session.kind == "end":
                ends.append(at)
            if value > best:
                best, best_at = value, at
                found = evaluate(session, value, at)
                doubt = doubts.doubt_of(session)
        if doubts.warn_of_end(session, path, values, keys["to"] - keys["from"]):
            return None
        if doubt:
            doubts.warn(doubt)
        doubts.warn_of_return(ends, keys["from"], keys["to"], keys.get("start", keys["from"]))
        if any(abs(best_at - end) <= 1e-9 * abs(keys["to"] - keys["from"]) for end in (keys["from"], keys["to"])):
            doubts.warn(f"the largest {of} is at an end of the range, {path} = {best_at:g}: no peak of the curve; widen the range",
                        Implausible)  # fmt: skip
        return found
