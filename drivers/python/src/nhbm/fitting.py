"""Parameters of a model from measured responses over the frequency: nonlinear least squares on curves that are continued through
their folds, with exact derivatives.

A measured sweep jumps where its branch ends, and noise or a slightly different fold shifts the jump. So each point is compared with
a branch of the curve, not with what the model does at the same frequency: the stable branches are the parts of the curve between
its folds, the points of a sweep move along them in their order, and of all such assignments the one with the smallest misfit
counts. Where the branch of a point ends before its frequency, the point is compared with the fold, and the difference in frequency
counts, too. The misfit is thus continuous where a fold passes a measured point.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from nhbm import advice
from nhbm.errors import ModelError, imported, without_own_frames
from nhbm.groups import request
from nhbm.keys import limits_of
from nhbm.measured import MeasuredSet, is_same, measured_sets, n_measured
from nhbm.paths import identifier, path_of
from nhbm.responses import absence_of, parts_of
from nhbm.schema import SOLVED
from nhbm.sweeps import Progress

if TYPE_CHECKING:
    from nhbm.model import Model
    from nhbm.session import Session

Array = Any  # np.ndarray
_MARGIN = 0.02  # by which curves are longer than the measured range, relative to it
_POOR = 50.0  # cost for each measured number, ten standard deviations, beyond which other starts are tried
_FACTORS = 0.25, 0.5, 2.0, 4.0  # of one parameter, for them
_FAR = 1e3  # residual of a point where the model has no motion
_WEAK = 1e-6  # singular value, relative to the largest, of a combination of parameters that the data do not determine
_FIRST, _HELD_STEP = 0.05, 0.25  # first force of a curve on which an amplitude is sought, over the measured one; longest step
_MOST_SOLUTIONS, _HELD, _LEAST_SLOPE = 8, 1e-7, 0.02  # of the search for a force that holds an amplitude
_OTHER_UNIT = 30.0  # ratio of measured and fitted amplitudes that suggests millimetres for metres
_UNLIKELY, _SIGNIFICANT, _MANY = 1e-3, 3.3, 8  # chance of a warning about noise alone; the same in deviations; fewest pairs


@dataclass
class _Segment:
    """The curve between two folds: points in its order, complex amplitudes, their derivatives."""

    at: list[float] = field(default_factory=list)
    z: list[complex] = field(default_factory=list)
    dz: list[Array] = field(default_factory=list)
    dat: list[Array] = field(default_factory=list)  # derivatives of the position, of folds


@dataclass
class Fit:
    """Fitted parameters, their uncertainty and the misfit.

    `values`, `errors` (standard errors), `covariance` and `correlation` are in the order of `paths`; `model` has the fitted values.
    """

    paths: list[str]
    values: Array
    covariance: Array
    residuals: Array
    n_parameters: int
    is_scaled: bool
    model: Model
    of: str
    path: str
    order: Any
    tolerance: Any
    sets: list[MeasuredSet]
    message: str
    predictions: list[Array]
    force: str = ""

    @property
    def errors(self) -> Array:
        """Standard errors."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlation of the estimates; NaN for parameters that the data do not determine, whose standard error is infinite."""
        with np.errstate(invalid="ignore"):
            found: Array = self.covariance / np.outer(self.errors, self.errors)
        return found

    @property
    def degrees_of_freedom(self) -> int:
        """Number of measured numbers beyond the number of parameters."""
        return n_measured(self.sets) - len(self.paths)

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals over their standard deviations."""
        return float(self.residuals @ self.residuals)

    @property
    def bic(self) -> float:
        """Bayesian information criterion: of two models fitted to the same data the one with the smaller value is more likely, by
        the factor exp(difference/2)."""
        n = n_measured(self.sets)
        misfit = n * np.log(self.chi_square / n) if self.is_scaled else self.chi_square
        return float(misfit + len(self.paths) * np.log(n))

    def interval(self, level: float = 0.95) -> Array:
        """Confidence intervals.

        Parameters
        ----------
        level : float
            Probability that an interval contains the true value.

        Returns
        -------
        numpy.ndarray
            Lower and upper ends, (n_parameters, 2).
        """
        from scipy.stats import norm, t

        quantile = t.ppf(0.5 + level / 2, self.degrees_of_freedom) if self.is_scaled else norm.ppf(0.5 + level / 2)
        return self.values[:, None] + quantile * self.errors[:, None] * np.array([-1.0, 1.0])

    def to_dataframe(self) -> Any:
        """The parameters as a table: value, standard error, ends of the 95 % interval, unit.

        Returns
        -------
        pandas.DataFrame
        """
        import pandas

        ends = self.interval()
        columns = {"value": self.values, "error": self.errors, "lower": ends[:, 0], "upper": ends[:, 1],
                   "unit": [self.model._described(path)["units"] for path in self.paths]}  # fmt: skip
        return pandas.DataFrame(columns, index=pandas.Index(self.paths, name="parameter"))

    def __repr__(self) -> str:
        return "\n".join(f"{name}: {text}" for name, text in self._rows())

    def _repr_html_(self) -> str:
        from nhbm import notebook

        return notebook.table(self._rows(), "nhbm fit")

    def _rows(self) -> list[tuple[str, str]]:
        rows = []
        for path, value, error in zip(self.paths, self.values, self.errors):
            unit = self.model._described(path)["units"]
            rows.append((path, f"{value:.6g} +- {error:.2g} {'' if unit == '1' else unit}".rstrip()))
        pairs = [(abs(c), i, j) for i, line in enumerate(self.correlation) for j, c in enumerate(line) if i < j and np.isfinite(c)]
        if pairs:
            _, i, j = max(pairs)
            rows.append(("largest correlation", f"{self.correlation[i, j]:.2f}, of {self.paths[i]} and {self.paths[j]}"))
        n = self.degrees_of_freedom
        rows.append(("misfit", f"chi-square {self.chi_square:.4g} of {n} degrees of freedom"
                     + (", by which the standard errors are scaled" if self.is_scaled else "")))  # fmt: skip
        return [*rows, *([("message", self.message)] if self.message else [])]

    def plot(self, figure: Any = None) -> Any:
        """Draws data, fitted curves and residuals.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            An empty figure to draw into.

        Returns
        -------
        matplotlib.figure.Figure
        """
        plt = imported("matplotlib.pyplot", "plots are drawn with")
        figure = figure or plt.figure(figsize=(6.4, 5.6), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        from nhbm.pictures import _labelled

        deviation = np.sqrt(self.chi_square / self.degrees_of_freedom) if self.is_scaled else 1.0
        conditions = list(dict.fromkeys(one.conditions for one in self.sets))
        for k, which in enumerate(conditions):
            if not self.force:
                for segment in _curve(self.model, self, which, [])[0]:
                    top.plot(segment.at, np.abs(segment.z), color=f"C{k}", lw=1.2)
        for one, predicted in zip(self.sets, self.predictions):
            color, mark = f"C{conditions.index(one.conditions)}", {"up": "^", "down": "v"}.get(one.sweep, "o")
            style = {"marker": mark, "ls": "none", "color": color, "mfc": "none", "ms": 5}
            if self.force:
                top.plot(one.at, np.abs(predicted), "+", color=color, ms=9, label="fitted")
            top.plot(one.at, one.measured, label=one.name or "measured", **style)
            sigma = deviation * one.sigma * one.measured / one.amplitude
            bottom.plot(one.at, (np.abs(predicted) - one.measured) / sigma, **style)
        attributes = self.model._described(self.path)
        import xarray as xr

        unit = "" if not self._unit() else f" [{self._unit()}]"
        top.set(ylabel=_labelled(self.force, xr.DataArray(0.0, attrs=self.model._described(self.force))) if self.force
                else f"Amplitude of {self.of}{unit}")  # fmt: skip
        bottom.set(xlabel=_labelled(self.path, xr.DataArray(0.0, attrs=attributes)), ylabel="Residual / $\\sigma$")
        bottom.axhline(0.0, color="0.5", lw=0.8)
        bottom.margins(y=0.15)  # room for whole marks
        for ax in (top, bottom):
            ax.grid(color="0.9")
            ax.set_axisbelow(True)
        top.legend(frameon=False)
        return figure

    def _unit(self) -> str:
        from nhbm.sweeps import _unit_of

        session = self.model._ready(request(self.tolerance, self.order))
        return _unit_of(session, self.of) if session.has_motion else "m"


@without_own_frames
def fit(model: Model, data: Any, by: Iterable[str], of: str, *, path: str = "tones[0]", tolerance: float | None = None,
        order: int | None = None, noise: float | None = None, bounds: Mapping[str, Sequence[float]] | None = None,
        controlled: bool = False, progress: Any = False, **keys: Any) -> Fit:  # fmt: skip
    """Fits parameters of a model to measured amplitudes, and phases, over the frequency.

    Points are compared with the stable branches of the response curve, so that sweeps with jumps may be given as they are.

    Parameters
    ----------
    model : Model
        The model, whose present values are the first guess. It is not changed.
    data : str, Path, dict or pandas.DataFrame
        A CSV file, what `read_uff` returns, or columns by name: `frequency` [rad/s] or `hertz` [Hz], `amplitude` in the unit of
        the degree of freedom and, optionally, `phase` of the response [rad], negative where it lags behind a cosine; `sweep`,
        "up" or "down"; `sigma`, the standard deviation of an amplitude. Any other column is a value of the model by its path,
        "load[0].cos". Names may have the unit of the model, "amplitude [m]"; others are refused, not converted.
    by : iterable of str
        Paths of the parameters, "stop.gap".
    of : str
        The harmonic that was measured, "x1 (1)".
    path : str
        Path of the frequency.
    tolerance, order : float, int, optional
        As for `Model.solve`.
    noise : float, optional
        Standard deviation of the amplitudes, relative to each. Without `noise` and `sigma` it is estimated from the residuals.
    bounds : dict, optional
        Lower and upper ends by path; by default those of the table of keys, such as 0 for a stiffness, and 0 for elements on the
        diagonal of matrices.
    controlled : bool
        The response was controlled, or its phase, so that points may be on unstable branches. Where the data have one column with
        the amplitude of a load, that force is compared at the measured amplitude and frequency, and `noise` and `sigma` over
        `amplitude` are those of the force.
    progress : bool or function
        True: a bar of tqdm with the number of evaluations of the model and their misfit, the mean of the squared residuals over
        their variances, which tends to 1 with `noise`; a function is called with both.
    **keys
        Of the group &curve, such as ``max_step=0.02``.

    Returns
    -------
    Fit
        Values, standard errors, correlation, confidence intervals, residuals; `plot` draws data, fitted curve and residuals.

    Examples
    --------
    >>> import nhbm, numpy as np
    >>> model = nhbm.Model(nhbm.Matrices(1.0, 1.0, 0.1), tones=[1.0])
    >>> model.load("x1", 1, cos=0.1)
    >>> omega = np.linspace(0.8, 1.2, 9)
    >>> measured = 0.1 / abs(1.21 - omega**2 + 0.2j * omega)
    >>> found = nhbm.fit(model, {"frequency": omega, "amplitude": measured}, ["structure.stiffness[0]", "structure.damping[0]"],
    ...                  "x1 (1)", order=1)
    >>> [float(round(value, 6)) for value in found.values]
    [1.21, 0.2]
    """
    work = copy.copy(model)
    paths = [work._resolved(one) for one in ([by] if isinstance(by, str) else by)]
    if not paths or len(set(paths)) < len(paths):
        raise ModelError("`by` needs the paths of the parameters, each once")
    if parts_of(of)[1] is None:
        raise ModelError(f"'{of}' is not a harmonic; a fit needs one, such as '{of} (1)'")
    at = work._resolved(path)
    sets, is_scaled, force = measured_sets(data, work, of, at, noise, controlled)
    if n_measured(sets) <= len(paths):
        n, few = n_measured(sets), len(paths)
        raise ModelError(f"{n} measured number{'s' * (n != 1)} cannot determine {few} parameter{'s' * (few != 1)}: "
                         f"give at least {few + 1}")  # fmt: skip
    first = np.array([float(work[one]) for one in paths])
    scale = np.where(first != 0.0, np.abs(first), 1.0)
    lower, upper = _bounds(work, paths, bounds or {})
    bar = Progress(progress, "fit", unit="evaluation")
    problem = _Problem(work, paths, of, at, tolerance, order, sets, controlled, keys, force, bar)
    least_squares = imported("scipy.optimize", "fits are made with", "scipy").least_squares
    work._begin({})  # of the first guess and of what is fitted, not of trial values
    def search(start: Array) -> Any:
        inside = np.clip(start, lower + 1e-6 * scale, upper - 1e-6 * scale)
        return least_squares(lambda x: problem.residuals(x * scale), inside / scale,
                             jac=lambda x: problem.jacobian(x * scale) * scale, bounds=(lower / scale, upper / scale),
                             x_scale="jac", xtol=1e-8, ftol=1e-8, gtol=1e-10, max_nfev=100)  # fmt: skip

    work._is_trial = True
    with bar:
        found = search(first)
        if found.cost > _POOR * n_measured(sets):  # a minimum far from the data: another start may lead elsewhere
            found = min([found, *map(search, _other_starts(problem, first, lower, upper))], key=lambda one: one.cost)
    values = found.x * scale
    residuals, jacobian = problem.residuals(values), problem.jacobian(values)
    covariance, is_known = _covariance(jacobian)
    if is_scaled:
        covariance = covariance * (residuals @ residuals) / (n_measured(sets) - len(paths))
    at_end = (values <= lower + 1e-6 * scale) | (values >= upper - 1e-6 * scale)
    problem.set_values(values)
    work._is_trial = False
    work._begin({})
    fitted = Fit(paths, values, covariance, residuals, len(paths), is_scaled, work, of, at, order, tolerance, sets, "",
                 problem.predictions, force)  # fmt: skip
    doubtful = [] if found.success else [advice.on("fit_ended_early", found.message)]
    if at_end.any():
        doubtful.append(advice.on("fit_at_end", ", ".join(np.array(paths)[at_end])))
    if not is_known.all():
        doubtful.append(advice.on("fit_undetermined", ", ".join(np.array(paths)[~is_known])))
    fitted.message = "; ".join(one.text for one in [*doubtful, *_scale_of(fitted), *_systematic(fitted)])
    if fitted.message:
        advice.warn(fitted.message)
    return fitted


@without_own_frames
def compare_fits(fits: Mapping[str, Fit]) -> Any:
    """Compares models that were fitted to the same data, by the Bayesian information criterion.

    Parameters
    ----------
    fits : dict
        Fits by name, ``{"stop": fit, "cubic spring": other}``.

    Returns
    -------
    pandas.DataFrame
        For each the number of parameters, chi-square, `bic` and `probability`, that of the model if one of them is right and none
        was more likely beforehand: proportional to exp(-bic/2).
    """
    import pandas

    first = next(iter(fits.values()), None)
    if first is None or len(fits) < 2:
        raise ModelError("a comparison needs two fits or more, by name")
    for name, fit in fits.items():
        same = len(fit.sets) == len(first.sets) and all(is_same(one, other) for one, other in zip(fit.sets, first.sets))
        if not same or fit.is_scaled != first.is_scaled:
            raise ModelError(f"fit '{name}' has other data, or another noise, than '{next(iter(fits))}'")
    bic = np.array([fit.bic for fit in fits.values()])
    likely = np.exp(-(bic - bic.min()) / 2)
    columns = {"parameters": [len(fit.paths) for fit in fits.values()], "chi_square": [fit.chi_square for fit in fits.values()],
               "bic": bic, "probability": likely / likely.sum()}  # fmt: skip
    return pandas.DataFrame(columns, index=pandas.Index(list(fits), name="model"))


def _covariance(jacobian: Array) -> tuple[Array, Array]:
    """Covariance of the parameters, for residuals of variance 1, and which of them the data determine; those that a combination
    without influence contains have an infinite variance."""
    size = np.linalg.norm(jacobian, axis=0)
    scaled = np.where(size > 0, size, 1.0)
    _, strength, ways = np.linalg.svd(jacobian / scaled, full_matrices=False)
    is_weak = strength <= _WEAK * strength.max(initial=0.0)
    is_known = (size > 0) & ~(np.abs(ways[is_weak]) > _WEAK**0.5).any(axis=0)
    covariance = (ways[~is_weak].T / strength[~is_weak] ** 2) @ ways[~is_weak] / np.outer(scaled, scaled)
    covariance[~is_known] = covariance[:, ~is_known] = np.nan
    np.fill_diagonal(covariance, np.where(is_known, np.diag(covariance), np.inf))
    return covariance, is_known


def _scale_of(fit: Fit) -> list[advice.Advice]:
    """What the sizes of the data and of the fit tell about the units of the data."""
    measured = float(np.median(np.concatenate([one.measured for one in fit.sets])))
    predicted = float(np.median(np.abs(np.concatenate(fit.predictions))))
    if not (measured > 0.0 and predicted > 0.0 and np.isfinite(predicted)) or 1 / _OTHER_UNIT < measured / predicted < _OTHER_UNIT:
        return []
    words = ("forces", "") if fit.force else ("amplitudes", f" [{fit._unit()}]")
    return [advice.on("fit_in_other_unit", *words, values=[measured / predicted])]


def _systematic(fit: Fit) -> list[advice.Advice]:
    """What the residuals tell about the model: a misfit beyond the noise, and residuals that depend on those beside them."""
    from scipy.stats import chi2

    found, products = [], []
    if not fit.is_scaled and chi2.sf(fit.chi_square, fit.degrees_of_freedom) < _UNLIKELY:
        found.append(advice.on("fit_beyond_noise", f"{fit.chi_square:.4g}", values=[fit.degrees_of_freedom]))
    rows, end = fit.residuals.reshape(-1, 3), 0
    for one in fit.sets:
        here, end = rows[end : end + len(one.at)], end + len(one.at)
        products += [(here[1:, k] * here[:-1, k]).tolist() for k in range(2 if one.phase is not None else 1)]
    beside = np.concatenate([np.array(some) for some in products])
    length = np.linalg.norm(beside)
    if len(beside) >= _MANY and length > 0 and beside.sum() / length > _SIGNIFICANT:
        found.append(advice.on("fit_with_pattern"))
    return found


def _other_starts(problem: _Problem, first: Array, lower: Array, upper: Array) -> list[Array]:
    """The first guess with one parameter changed: the two with the smallest misfits."""
    starts = []
    for k, factor in itertools.product(range(len(first)), _FACTORS):
        start = first.copy()
        start[k] *= factor
        if first[k] and lower[k] < start[k] < upper[k]:
            residuals = problem.residuals(start)
            starts.append((float(residuals @ residuals), k, factor, start))
    return [start for *_, start in sorted(starts, key=lambda one: one[:3])[:2]]


def _is_on_diagonal(model: Model, path: str) -> bool:
    """Whether a path is an element on the diagonal of the mass, damping or stiffness of a structure of full matrices."""
    at = path_of(path)
    group = model._groups.find(at)
    if group is None or at.group != "structure" or at.key not in ("mass", "damping", "stiffness") or not at.indices:
        return False
    n = math.isqrt(np.size(group.keys.get(at.key, ())))
    return group.keys.get("type") == "matrices" and (at.indices[0] == at.indices[-1] if len(at.indices) > 1
                                                     else (at.indices[0] - 1) % (n + 1) == 0)  # fmt: skip


def _bounds(model: Model, paths: list[str], given: Mapping[str, Sequence[float]]) -> tuple[Array, Array]:
    """Lower and upper ends of the parameters."""
    own = {model._resolved(path): ends for path, ends in given.items()}
    unknown = [path for path in own if path not in paths]
    if unknown:
        raise ModelError(f"bounds of '{unknown[0]}', which is not a parameter of the fit: {', '.join(paths)}")
    lower, upper = [], []
    for path in paths:
        key = model._groups.key_at(path_of(path))
        limits = limits_of("" if key is None else key.range)
        least = max(limits.minimum, limits.above)
        default = least, limits.maximum
        if least == -np.inf and _is_on_diagonal(model, path) and float(model[path]) >= 0:  # an amplitude does not tell its sign
            default = 0.0, default[1]
        ends = own.get(path, default)
        if len(ends) != 2 or not ends[0] < ends[1]:
            raise ModelError(f"bounds of '{path}' are two numbers, the lower one first, not {ends!r}")
        lower.append(ends[0])
        upper.append(ends[1])
    return np.array(lower, float), np.array(upper, float)


def _curve(model: Model, how: Any, conditions: tuple[tuple[str, float], ...], paths: list[str],
           keys: Mapping[str, Any] | None = None) -> tuple[list[_Segment], bool]:  # fmt: skip
    """The response curve between its folds under the conditions, with derivatives by `paths`; whether it has reached its end."""
    for path, value in conditions:
        model[path] = value
    wanted = np.unique(np.concatenate([one.at for one in how.sets if one.conditions == conditions]))
    margin = _MARGIN * max(np.ptp(wanted), 1e-3 * abs(wanted[-1]))
    ends = {"from": max(float(wanted[0] - margin), 0.5 * float(wanted[0])), "to": float(wanted[-1] + margin)}
    curve = {"parameter": how.path, **ends, "values": wanted.tolist(), "points": 2000 + 10 * len(wanted), **(keys or {})}
    groups: dict[str, Any] = {"curve": curve, "stability": {"method": "off"}}
    if paths:
        groups["gradient"] = {"by": paths}
    if how.order is not None:
        groups["error_estimate"] = {"is_on": False}
    points, reached = [], True
    if not model._groups.named("law"):  # a linear model has no folds
        del groups["curve"]
        for value in wanted:
            model[how.path] = float(value)
            session = model._begin(request(how.tolerance, how.order, **groups))
            session.solve(points=0)
            if session.status in SOLVED:
                points.append((0.0, "none", float(value), *_amplitude(session, how.of, paths, False)))
    else:
        session, name = model._begin(request(how.tolerance, how.order, **groups)), identifier(how.path)
        session.begin_curve()
        while session.next():
            if session.status in SOLVED:
                kind = session.kind
                if paths and kind == "regular":  # fits compare located points alone
                    continue
                found = _amplitude(session, how.of, paths, kind == "fold")
                points.append((session.number("curve_length"), kind, session.number(name), *found))
                reached = kind == "end"
    segments = [_Segment()]
    for _, kind, position, z, dz, moves in points:
        segments[-1].at.append(position)
        segments[-1].z.append(z)
        segments[-1].dz.append(dz)
        segments[-1].dat.append(moves)
        if kind == "fold":
            segments.append(_Segment([position], [z], [dz], [moves]))
    return segments, reached


def _amplitude(session: Session, of: str, paths: list[str], is_fold: bool) -> tuple[complex, Array, Array]:
    """Complex amplitude of the motion found last, its derivatives, and those of the position of a fold."""
    dof, tuple_ = parts_of(of)
    labels = session.labels("dof")
    label = session.dofs_of_sets.get(dof, dof)
    if label not in labels:
        raise ModelError(f"'{of}': there is no degree of freedom '{dof}'; known: {', '.join(labels)}")
    i, tuples = labels.index(label), session.column("tuples").values
    if tuple_ is None or len(tuple_) != tuples.shape[1]:
        raise ModelError(f"'{of}' needs a tuple of {tuples.shape[1]} entries")
    sign = next((s for s in (1, -1) if np.equal(tuples, np.multiply(s, tuple_)).all(axis=1).any()), 0)
    if not sign:
        raise ModelError(absence_of(session, of))
    h = int(np.flatnonzero(np.equal(tuples, np.multiply(sign, tuple_)).all(axis=1))[0])
    cos, sin = session.column("coefficients").values[i, h]
    by = session.column("gradient").values if paths else None
    slopes = np.zeros(len(paths), complex) if by is None else by[:, i, h, 0] - sign * 1j * by[:, i, h, 1]
    moves = session.column("position_gradient").values if paths and is_fold else None
    return cos - sign * 1j * sin, np.nan_to_num(slopes), np.zeros(len(paths)) if moves is None else np.nan_to_num(moves)




class _Problem:
    """Residuals and their derivatives by the parameters."""

    def __init__(self, model: Model, paths: list[str], of: str, path: str, tolerance: Any, order: Any, sets: list[MeasuredSet],
                 controlled: bool, keys: Mapping[str, Any], force: str, bar: Progress) -> None:  # fmt: skip
        self.model, self.paths, self.of, self.path, self.tolerance, self.order = model, paths, of, path, tolerance, order
        self.sets, self.controlled, self.keys, self.force, self.bar = sets, controlled, keys, force, bar
        self.predictions: list[Array] = []
        self._at: Array | None = None
        self._found: tuple[Array, Array] = np.zeros(0), np.zeros((0, 0))

    def set_values(self, values: Array) -> None:
        """Sets the parameters in the model."""
        for path, value in zip(self.paths, values):
            self.model[path] = float(value)

    def residuals(self, values: Array) -> Array:
        """Of amplitudes, of phases, and of frequencies beyond the end of a branch, over their standard deviations."""
        return self._evaluate(values)[0]

    def jacobian(self, values: Array) -> Array:
        """Their derivatives by the parameters."""
        return self._evaluate(values)[1]

    def _evaluate(self, values: Array) -> tuple[Array, Array]:
        if self._at is None or not np.array_equal(self._at, values):
            try:
                parts = self._parts(values)
            except ModelError:  # a negative mass, for example
                if self._at is None:
                    raise
                n = 3 * sum(len(one.at) for one in self.sets)
                self._found = np.full(n, _FAR), np.zeros((n, len(self.paths)))
            else:
                self.predictions = [part[2] for part in parts]
                self._found = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
            self._at = np.array(values)
            self.bar.update(misfit=float((self._found[0] ** 2).sum() / n_measured(self.sets)))
        return self._found

    def _parts(self, values: Array) -> list[tuple[Array, Array, Array]]:
        """Residuals, derivatives and predictions of each set; ModelError where the model cannot have these values."""
        self.set_values(values)
        if self.force:
            return [_held(self, one) for one in self.sets]
        curves = {}
        for one in self.sets:
            if one.conditions not in curves:
                curves[one.conditions] = _curve(self.model, self, one.conditions, self.paths, self.keys)[0]
        return [_compared(one, curves[one.conditions], len(self.paths), self.controlled) for one in self.sets]


def _held(how: _Problem, one: MeasuredSet) -> tuple[Array, Array, Array]:
    """Residuals of the forces that hold the response at the measured amplitudes, and of the phases there; their derivatives; the
    forces of the model with these phases."""
    n = len(how.paths)
    residuals, slopes, predicted = np.zeros((len(one.at), 3)), np.zeros((len(one.at), 3, n)), np.zeros(len(one.at), complex)
    for path, value in one.conditions:
        how.model[path] = value
    assert one.force is not None
    present = float(how.model[how.force])
    for i, (at, amplitude, measured) in enumerate(zip(one.at, one.amplitude, one.force)):
        how.model[how.path] = float(at)
        found = _by_newton(how, float(amplitude), float(measured)) or _by_curve(how, float(amplitude), float(measured))
        force, by_force, phase, by_phase = found
        width = one.sigma[i] / amplitude
        residuals[i, 0], slopes[i, 0] = (force / measured - 1) / width, by_force / measured / width
        if one.phase is not None:
            residuals[i, 1], slopes[i, 1] = np.angle(np.exp(1j * (phase - one.phase[i]))) / width, by_phase / width
        predicted[i] = force * np.exp(1j * phase)
    how.model[how.force] = present
    return residuals.ravel(), slopes.reshape(-1, n), predicted


def _by_newton(how: _Problem, amplitude: float, force: float) -> tuple[float, Array, float, Array] | None:
    """The force that holds an amplitude, the phase of the response, and their derivatives by the parameters at that amplitude, by
    Newton's method over the logarithm of the force from the motion found last; None if it fails, as near a fold over the force."""
    groups: dict[str, Any] = {"stability": {"method": "off"}, "gradient": {"by": [*how.paths, how.force]}}
    if how.order is not None:
        groups["error_estimate"] = {"is_on": False}
    for _ in range(_MOST_SOLUTIONS):
        how.model[how.force] = force
        session = how.model._begin(request(how.tolerance, how.order, **groups))
        session.solve(True, points=0)
        if session.status not in SOLVED:
            return None
        z, dz, _ = _amplitude(session, how.of, [*how.paths, how.force], False)
        if not z:
            return None
        by, excess = dz / z, math.log(abs(z) / amplitude)
        slope = float(by[-1].real) * force  # of the logarithm of the amplitude over that of the force
        if not abs(slope) > _LEAST_SLOPE:
            return None
        if abs(excess) <= _HELD:
            by_force = -by[:-1].real / by[-1].real
            return force, by_force, float(np.angle(z)), by[:-1].imag + by[-1].imag * by_force
        force *= math.exp(min(1.0, max(-1.0, -excess / slope)))
    return None


def _by_curve(how: _Problem, amplitude: float, measured: float) -> tuple[float, Array, float, Array]:
    """As `_by_newton`.

    The curve over the force is followed from a small one until it reaches the amplitude, round its folds. On its last step both
    follow from values and derivatives at its ends (Hermite), over the amplitude, which does not turn back.
    """
    curve = {"parameter": how.force, "from": _FIRST * measured, "to": measured / _FIRST, "max_step": _HELD_STEP, **how.keys}
    groups: dict[str, Any] = {"curve": curve, "stability": {"method": "off"}, "gradient": {"by": [*how.paths, how.force]}}
    if how.order is not None:
        groups["error_estimate"] = {"is_on": False}
    session, name = how.model._begin(request(how.tolerance, how.order, **groups)), identifier(how.force)
    ends: list[tuple[float, float, float, Array]] = []  # amplitude, force, phase, derivatives of log z by parameters and force
    session.begin_curve()
    while session.next():
        if session.status in SOLVED and session.kind != "fold":
            z, dz, _ = _amplitude(session, how.of, [*how.paths, how.force], False)
            ends = [*ends[-1:], (abs(z), session.number(name), float(np.angle(z)), dz / z)]
            if abs(z) >= amplitude:
                break
    if not ends:
        return _FAR * measured, np.zeros(len(how.paths)), 0.0, np.zeros(len(how.paths))
    forces, phases, by_forces, by_phases, slopes = [], [], [], [], []
    for size, force, phase, by in ends:
        turn = by[:-1] - by[-1] * by[:-1].real / by[-1].real  # at that amplitude
        forces.append(force)
        phases.append(phase)
        by_forces.append(-by[:-1].real / by[-1].real)
        by_phases.append(turn.imag)
        slopes.append((1 / (size * by[-1].real), by[-1].imag / (size * by[-1].real)))
    if len(ends) == 1 or ends[-1][0] < amplitude:  # beyond the curve: in proportion
        factor = amplitude / ends[-1][0]
        return factor * forces[-1], factor * by_forces[-1], phases[-1], by_phases[-1]
    width = ends[1][0] - ends[0][0]
    t = (amplitude - ends[0][0]) / width
    weights = (1 + 2 * t) * (1 - t) ** 2, t**2 * (3 - 2 * t), width * t * (1 - t) ** 2, width * t**2 * (t - 1)
    phases[1] = phases[0] + float(np.angle(np.exp(1j * (phases[1] - phases[0]))))
    force, phase = (weights[0] * values[0] + weights[1] * values[1] + weights[2] * slopes[0][k] + weights[3] * slopes[1][k]
                    for k, values in enumerate((forces, phases)))  # fmt: skip
    return force, (1 - t) * by_forces[0] + t * by_forces[1], phase, (1 - t) * by_phases[0] + t * by_phases[1]


def _compared(one: MeasuredSet, segments: list[_Segment], n: int, controlled: bool) -> tuple[Array, Array, Array]:
    """Residuals of a set and their derivatives on the branches with the smallest misfit; amplitudes of the model."""
    stable = [segment for k, segment in enumerate(segments) if (controlled or k % 2 == 0) and segment.at]
    if not stable:
        return np.full(3 * len(one.at), _FAR), np.zeros((3 * len(one.at), n)), np.full(len(one.at), np.nan)
    on_each = [_on_segment(one, segment, n) for segment in stable]
    costs = np.array([(r**2).sum(axis=1) for r, _, _ in on_each])  # (segments, points)
    chosen = _in_order(costs) if one.sweep else costs.argmin(axis=0)
    rows = range(len(one.at))
    residuals = np.array([on_each[chosen[i]][0][i] for i in rows])
    slopes = np.array([on_each[chosen[i]][1][i] for i in rows])
    return residuals.ravel(), slopes.reshape(-1, n), np.array([on_each[chosen[i]][2][i] for i in rows])


def _in_order(costs: Array) -> Array:
    """A branch for each point, by the sum of the costs: along a sweep, and along the curve, the number of the branch rises."""
    n_segments, n_points = costs.shape
    total, before = np.zeros_like(costs), np.zeros((n_segments, n_points), int)
    for i in range(n_points):
        least, at = np.inf, 0
        for s in range(n_segments):
            previous = total[s, i - 1] if i else 0.0
            if previous < least:
                least, at = previous, s
            total[s, i], before[s, i] = least + costs[s, i], at
    chosen = np.zeros(n_points, int)
    chosen[-1] = int(total[:, -1].argmin())
    for i in range(n_points - 1, 0, -1):
        chosen[i - 1] = before[chosen[i], i]
    return chosen


def _on_segment(one: MeasuredSet, segment: _Segment, n: int) -> tuple[Array, Array, Array]:
    """Residuals (n_points, 3) of amplitude, phase and frequency on a branch, their derivatives and the complex amplitudes."""
    residuals, slopes, predicted = np.zeros((len(one.at), 3)), np.zeros((len(one.at), 3, n)), np.zeros(len(one.at), complex)
    positions = np.array(segment.at)
    for i, at in enumerate(one.at):
        k = int(np.abs(positions - at).argmin())
        z, dz, sigma = segment.z[k], segment.dz[k], one.sigma[i]
        size = max(abs(z), 1e-300)
        residuals[i, 0] = (size - one.amplitude[i]) / sigma
        slopes[i, 0] = (np.conj(z) * dz).real / size / sigma
        if one.phase is not None:
            weight = one.amplitude[i] / sigma
            residuals[i, 1] = np.angle(z * np.exp(-1j * one.phase[i])) * weight
            slopes[i, 1] = (np.conj(z) * dz).imag / size**2 * weight
        if not positions.min() - 1e-9 * abs(at) <= at <= positions.max() + 1e-9 * abs(at):  # beyond the end of the branch
            width = at * sigma / one.amplitude[i]
            residuals[i, 2] = (positions[k] - at) / width
            slopes[i, 2] = segment.dat[k] / width
        predicted[i] = z
    return residuals, slopes, predicted
