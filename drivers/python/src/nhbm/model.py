"""Models in process: a structure with tones, loads and laws, its motions, curves and sweeps as xarray.Dataset."""

from __future__ import annotations

import functools
import re
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import xarray as xr

from nhbm import dataset, sweeps
from nhbm.docstrings import documented
from nhbm.errors import ModelError, NotConverged
from nhbm.groups import GROUPS, Builder, described, group_text, identifier, numbers_of, path_of, value_of, without_group
from nhbm.laws import Law
from nhbm.session import Session, input_keys
from nhbm.structure import Structure
from nhbm.sweeps import Progress

_IN_MEMORY = "structure in memory"
_REPLACED = "curve", "gradient"  # groups that an operation gives complete
_Method = TypeVar("_Method", bound=Callable[..., Any])
_CHECKED, _CHECKED_DOFS = ("load", "start"), 300  # groups that are checked when they are added; largest structure for it


def _exclusive(method: _Method) -> _Method:
    """A method that one thread at a time executes; others wait."""

    @functools.wraps(method)
    def call(self: Model, *arguments: Any, **options: Any) -> Any:
        with self._lock:
            return method(self, *arguments, **options)

    return cast(_Method, call)


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


class Gradient(NamedTuple):
    """A response, and its derivatives with respect to the given values, in their order."""

    value: float
    slopes: Any  # np.ndarray


class Model:
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
        Invalid model, with group, key and a suggestion; loads are checked when they are added, other values by the operation
        that first needs them.

    Examples
    --------
    >>> import nhbm
    >>> oscillator = nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1)
    >>> model = nhbm.Model(oscillator, tones=[0.9])
    >>> model.load("x1", 1, cos=0.3)
    >>> model.law("cubic_spring", "x1", stiffness=0.5, label="spring")
    >>> model
    <nhbm.Model: structure chain; frequency [0.9]; 1 load; 1 law (cubic_spring)>
    >>> motion = model.solve(order=7)
    >>> print(f"{float(motion.nhbm.amplitude('x1', 1)):.6f} m, stable: {int(motion['is_stable'])}")
    0.737765 m, stable: 1
    """

    def __init__(self, structure: Builder | Structure | str | Path, tones: Any = (), **groups: Mapping[str, Any]) -> None:
        self._clear()
        if isinstance(structure, Builder):
            self._groups["structure"] = dict(structure.keys)
        elif isinstance(structure, Structure):
            self._structure: Structure | None = structure
            self._groups["structure"] = {"type": "model", "file": _IN_MEMORY}
        elif isinstance(structure, (str, Path)):
            self._groups["structure"] = {"type": "model", "file": str(structure)}
        else:
            raise ModelError(
                f"{structure!r} is not a structure; use nhbm.Beam(...), nhbm.Structure(...) or the path of a model file"
            )
        if isinstance(tones, Mapping):
            self._groups["tones"] = dict(tones)
        elif len(list(np.atleast_1d(tones))) > 0:
            try:
                self._groups["tones"] = {"frequency": [float(omega) for omega in np.atleast_1d(tones)]}
            except (TypeError, ValueError):
                raise ModelError(
                    "tones are frequencies [rad/s] or keys of &tones such as {'unknown': True} or {'hertz': 50.0}, "
                    f"not {tones!r}"
                ) from None
        for name, keys in groups.items():
            self.set(name, **keys)

    def __repr__(self) -> str:
        kinds = {name: [keys for other, keys in self._lists if other == name] for name, _ in self._lists}
        parts = [f"structure {self._groups['structure']['type']}" if "structure" in self._groups else f"input {self._name}"]
        parts += [f"{key} {value}" for key, value in self._groups.get("tones", {}).items()]
        for name, entries in kinds.items():
            types = [str(keys["type"]) for keys in entries if "type" in keys]
            parts.append(f"{len(entries)} {name}{'s' if len(entries) > 1 else ''}" + (f" ({', '.join(types)})" if types else ""))
        return f"<nhbm.Model: {'; '.join(parts)}>"

    def _clear(self) -> None:
        self._lock = threading.RLock()
        self._base, self._folder, self._name = "", Path(), "model"
        self._groups: dict[str, dict[str, Any]] = {}
        self._lists: list[tuple[str, dict[str, Any]]] = []
        self._laws: list[Law] = []
        self._structure = None
        self._values: dict[str, tuple[int, object]] = {}  # by path, with the number of the assignment
        self._n_assignments = 0
        self._sessions: dict[Any, _Live] = {}  # by tolerance, order and keys of further groups
        self._used: Any = (None, None, repr(""))  # which of them was used last
        self._solved: Any = None  # which has the motion found last

    @classmethod
    def from_namelist(cls, text: str, folder: str | Path = ".", name: str = "model") -> Model:
        """Creates a model from the text of an input, without groups &sweep.

        Parameters
        ----------
        text : str
            The groups of the input.
        folder : str or Path
            Folder of the files that the input names.
        name : str
            Name for messages.
        """
        model = cls.__new__(cls)
        model._clear()
        model._base, model._folder = text if text.endswith("\n") else text + "\n", Path(folder)
        model._name = str(model._folder / name)
        model._live()
        return model

    @classmethod
    def from_file(cls, path: str | Path) -> Model:
        """Creates a model from an input file."""
        return cls.from_namelist(Path(path).read_text(), Path(path).parent, Path(path).name)

    @_exclusive
    def to_namelist(self) -> str:
        """The complete input with all keys and their values; Python laws and structures in memory appear by name only.

        Returns
        -------
        str
            An input for `from_namelist` and the command.
        """
        return self._live(*self._used[:2]).session.input()

    # What it is made of

    @_exclusive
    def set(self, group: str, **keys: Any) -> None:
        """Sets keys of a group.

        Parameters
        ----------
        group : str
            A group that occurs once: "harmonics", "stability", "solver", ...
        **keys
            Its keys, such as ``set("harmonics", order=9)``; None restores the default.
        """
        if group in ("load", "law", "start", "tie", "bearing", "dynamic_stiffness"):
            raise ModelError(f"there may be several groups &{group}; model.{group}(...) adds one")
        if group not in GROUPS:
            raise ModelError(f"unknown group '{group}'; known: {', '.join(GROUPS)}")
        self._groups.setdefault(group, {}).update(keys)
        self._sessions = {}

    @_exclusive
    def load(self, dof: str | None = None, tuple_: Any = 1, cos: float = 0.0, sin: float = 0.0, **keys: Any) -> None:
        """Adds the force ``cos cos(j.omega t) + sin sin(j.omega t)``.

        Parameters
        ----------
        dof : str, optional
            Degree of freedom; alternatively ``vector="name"``, a load vector of the structure.
        tuple_ : int or sequence of int
            j, one entry per tone.
        cos, sin : float
            Amplitudes [N] ([N m] for rotations), multiplied by those of the vector.
        **keys
            Further keys of &load, such as ``frequency_power=2`` for an unbalance [kg m] or
            ``kind="base_acceleration"`` for a base motion [m/s2].
        """
        self._add("load", {"dof": dof, "tuple": numbers_of("tuple_", tuple_, int), "cos": cos, "sin": sin, **keys})

    @_exclusive
    def law(self, kind: str | Law | Callable[..., Any], dof: str | Iterable[str] | None = None, **keys: Any) -> None:
        """Adds a nonlinear element.

        Parameters
        ----------
        kind : str, Law or function
            A built-in type ("cubic_spring", "jenkins", ...), a Python law, or a function, which is converted to one.
        dof : str or iterable of str, optional
            Where it acts; several degrees of freedom correspond to the key `dofs`.
        **keys
            Its keys, with the units of docs/user/input.md, such as ``gap=1e-3`` [m]; ``label="wall"`` names it in paths.
        """
        where = {} if dof is None else _dofs(dof)
        if isinstance(kind, str):
            self._add("law", {"type": kind, **where, **keys})
            return
        law = kind if isinstance(kind, Law) else Law(kind)
        self._laws.append(law)
        self._add("law", {"type": "user", "library": "", "name": law.name, "odd": law.odd, **where, **keys})

    @_exclusive
    def start(self, dof: str, tuple_: Any = 1, cos: float = 0.0, sin: float = 0.0, **keys: Any) -> None:
        """Adds a harmonic to the initial guess.

        Parameters
        ----------
        dof : str
            Degree of freedom.
        tuple_ : int or sequence of int
            Tuple of the harmonic.
        cos, sin : float
            Amplitudes, in the unit of the degree of freedom [m or rad].
        **keys
            Further keys of &start.
        """
        self._add("start", {"dof": dof, "tuple": numbers_of("tuple_", tuple_, int), "cos": cos, "sin": sin, **keys})

    @_exclusive
    def bearing(self, dofs: Iterable[str], speeds: Any, stiffness: Any, damping: Any = None, **keys: Any) -> None:
        """Adds a bearing with tabulated coefficients to the structure.

        Parameters
        ----------
        dofs : iterable of str
            Directions x and y.
        speeds : sequence of float
            Speeds of the rows of the tables [rad/s].
        stiffness, damping : array_like
            k_xx, k_xy, k_yx, k_yy [N/m], likewise the damping [N s/m], (n_speeds, 4).
        **keys
            `speed` [rad/s], the current speed, for ``model.tie("bearing(1)%speed", "tones[0]")``, and `label`.
        """
        tables = {"stiffness": stiffness} if damping is None else {"stiffness": stiffness, "damping": damping}
        values = {name: numbers_of(name, table) for name, table in {"speeds": speeds, **tables}.items()}
        self._add("bearing", {"dofs": list(dofs), **values, **keys})

    @_exclusive
    def dynamic_stiffness(self, kind: str, dof: str | Iterable[str], **keys: Any) -> None:
        """Adds a part of the structure with frequency-dependent stiffness, such as a viscoelastic mount.

        Parameters
        ----------
        kind : str
            "delay", "fractional", "loss_factor", "maxwell" or "table", see docs/user/input.md.
        dof : str or iterable of str
            Degree of freedom of its displacement and force; several need `weights`.
        **keys
            Its keys with their units, such as ``moduli=[2e5], times=[1e-3]`` [N/m], [s].
        """
        self._add("dynamic_stiffness", {"type": kind, **_dofs(dof), **keys})

    @_exclusive
    def tie(self, path: str, to: str, factor: float = 1.0, offset: float = 0.0) -> None:
        """Makes a value follow another one, ``offset + factor * value``.

        Parameters
        ----------
        path, to : str
            The dependent value, and the value to follow: ``model.tie("structure.speed", "tones[0]")``.
        factor, offset : float
            In the units of both.
        """
        paths = path_of(path), path_of(to)
        self._add("tie", {"parameter": paths[0], "to": paths[1], "factor": factor, "offset": offset})

    @_exclusive
    def __setitem__(self, path: str, value: Any) -> None:
        """Sets a value by its path.

        Parameters
        ----------
        path : str
            "wall.gap" (label and key), "tones[0]", or a path of the input, "law(wall)%gap".
        value : object
            In the unit of the input.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0), tones=[0.9])
        >>> model["tones[0]"] = 1.1
        >>> model["stop.gap"] = 1e-3
        Traceback (most recent call last):
            ...
        nhbm.errors.ModelError: 'law(stop)%gap' there is no group '&law'; the file has: structure, tones
        """
        path, live = path_of(path), self._live(*self._used[:2])
        live.set(path, value)
        self._n_assignments += 1
        self._values.pop(path, None)
        self._values[path] = (self._n_assignments, value)
        live.n_assignments = self._n_assignments

    @_exclusive
    def __getitem__(self, path: str) -> Any:
        """Returns a value by its path.

        Parameters
        ----------
        path : str
            As for assignments: "wall.gap", "tones[0]", "law(wall)%gap".

        Returns
        -------
        float, int, bool, str or list
            In the unit of the input.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0), tones=[0.9])
        >>> model["tones[0]"], model["structure.n_masses"], model["stability.method"]
        (0.9, 2, 'auto')
        """
        return value_of(path_of(path), self.to_namelist())

    @_exclusive
    def __delitem__(self, entry: str) -> None:
        """Removes a load, law or another group that was added to the model.

        Parameters
        ----------
        entry : str
            Its group and number, "load[0]", or its label, "wall".

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0), tones=[0.9])
        >>> model.load("x2", 1, cos=0.1)
        >>> del model["load[0]"]
        >>> model
        <nhbm.Model: structure chain; frequency [0.9]>
        """
        match = re.fullmatch(r"(\w+)\[(\d+)\]", entry)
        group, wanted = (match[1], int(match[2])) if match else ("", -1)
        if match:
            found = [k for k, (name, _) in enumerate(self._lists) if name == group][wanted : wanted + 1]
        else:
            found = [k for k, (_, keys) in enumerate(self._lists) if keys.get("label") == entry]
        if not found:
            hint = "use its label, or a number as in 'load[0]'"
            raise ModelError(f"'{entry}' names no load, law or other group in this model; {hint}")
        k, group = found[0], self._lists[found[0]][0]
        number = 1 + sum(name == group for name, _ in self._lists[:k])
        if self._is_in_base(group) and any(re.match(rf"{group}\(\d", path) for path in self._values):
            raise ModelError(f"a value of &{group} was set by its number, which would change; use labels")
        label = self._lists.pop(k)[1].get("label")
        values = {}
        for path, value in self._values.items():
            at = re.match(rf"{group}\(([^()]*)\)", path)
            if at and at[1] in (str(number), label):
                continue
            if at and at[1].isdigit() and int(at[1]) > number:
                path = f"{group}({int(at[1]) - 1}){path[at.end() :]}"
            values[path] = value
        self._values, self._sessions = values, {}

    # What it does

    @_exclusive
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
            The names, axes and units of the result file (docs/user/schema.md); `dataset.nhbm` has amplitudes, harmonics,
            values over time and plots.

        Warns
        -----
        NotConverged
            The motion was not found, or does not satisfy its tolerance; its `status` is not 1, and `dataset.nhbm.message`
            gives the reason.
        """
        session = self._live(tolerance, order).session
        self._solved = self._used
        session.solve(warm, points=self._sharing(1))
        motion = dataset.motion_of(session)
        if int(motion["status"]) != dataset.CONVERGED:
            warnings.warn(session.message or f"the motion is {motion.nhbm.status.item()}", NotConverged, stacklevel=3)
        return motion

    @_exclusive
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
        session = self._live(tolerance, order).session
        session.solve(warm, points=0)
        if dataset.number(session, "status") in dataset.SOLVED:
            return dataset.response_of(session, of)
        warnings.warn(session.message, NotConverged, stacklevel=3)
        return float("nan")

    @_exclusive
    @documented
    def gradient(self, of: str, by: Iterable[str], *, tolerance: float | None = None, order: int | None = None,
                 warm: bool = True) -> Gradient:  # fmt: skip
        """Computes the motion and returns a response with its derivatives: for gradient-based optimisation.

        Each derivative needs one linear solution with the tangent of the motion. If contact or friction begins or ends at
        this motion, derivatives are one-sided: see `gradient_defect` of `solve` with the group &gradient.

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
        >>> model = nhbm.Model(nhbm.Chain(n_masses=1, mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0,
        ...                               damping_mass=0.1, ends="free"), tones=[0.9])
        >>> model.load("x1", 1, cos=0.1)
        >>> model.law("cubic_spring", "x1", stiffness=0.5, label="spring")
        >>> value, slopes = model.gradient("x1 (1)", ["spring.stiffness"], order=7)
        >>> model["spring.stiffness"] = 0.5 + 1e-6
        >>> further = model.response("x1 (1)", order=7)
        >>> bool(abs((further - value) / 1e-6 - slopes[0]) < 1e-4 * abs(slopes[0]))
        True
        """
        paths = [path_of(path) for path in ([by] if isinstance(by, str) else by)]
        session = self._live(tolerance, order, {"gradient": {"by": paths}}).session
        session.solve(warm, points=0)
        if dataset.number(session, "status") in dataset.SOLVED:
            value = dataset.response_of(session, of)
            if not value:
                raise ModelError(f"'{of}' is zero, where an amplitude has no derivative; does the set of harmonics have it?")
            slopes = dataset.gradient_of(session, of)
            if np.isnan(slopes).any():
                reason = session.message or "it is not differentiable"
                warnings.warn(f"no derivatives of this motion: {reason}", NotConverged, stacklevel=3)
            return Gradient(value, slopes)
        warnings.warn(session.message, NotConverged, stacklevel=3)
        return Gradient(float("nan"), np.full(len(paths), np.nan))

    @_exclusive
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
            The response and the value of the parameter there; NaN, with the warning NotConverged, if the curve ends before
            its range does.
        """
        keys = {**_range(start, stop), **keys}
        return self._highest(of, path, keys, tolerance, order, {}, lambda _, value, at: Peak(value, at)) or Peak(np.nan, np.nan)

    @_exclusive
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
            maximum is at an end of the range. NaN, with the warning NotConverged, if the curve ends before its range does.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Chain(n_masses=1, mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0,
        ...                               damping_mass=0.1, ends="free"), tones=[0.9])
        >>> model.load("x1", 1, cos=0.1)
        >>> model.law("cubic_spring", "x1", stiffness=0.5, label="spring")
        >>> found = model.peak_gradient("x1 (1)", ["spring.stiffness"], "tones[0]", 0.8, 1.6, order=7)
        >>> model["spring.stiffness"] = 0.5 + 1e-5
        >>> further = model.peak("x1 (1)", "tones[0]", 0.8, 1.6, order=7)
        >>> bool(abs((further.at - found.at) / 1e-5 - found.at_slopes[0]) < 1e-3 * found.at_slopes[0])
        True
        """
        paths = [path_of(one) for one in ([by] if isinstance(by, str) else by)]
        none = np.full(len(paths), np.nan)

        def here(session: Session, value: float, at: float) -> PeakGradient:
            moves = session.column("position_gradient").values
            return PeakGradient(value, at, dataset.gradient_of(session, of), none if moves is None else moves.copy())

        groups, keys = {"gradient": {"by": paths}}, {**_range(start, stop), **keys}
        return self._highest(of, path, keys, tolerance, order, groups, here) or PeakGradient(np.nan, np.nan, none, none)

    def _highest(self, of: str, path: str, keys: dict[str, Any], tolerance: float | None, order: int | None,
                 groups: dict[str, Any], evaluate: Callable[[Session, float, float], Any]) -> Any:  # fmt: skip
        """The result of `evaluate` for the session, the response and the varied value where the response is largest; None, and a
        warning, if the curve ends before its range does."""
        path = path_of(path)
        groups = {"curve": {"parameter": path, "peak_of": of, **keys}, "stability": {"method": "off"}, **groups}
        if order is not None:
            groups["certificate"] = {"is_on": False}  # what is not returned is not made
        session = self._live(tolerance, order, groups).session
        best, found = -1.0, None
        session.begin_curve()
        while session.next():
            if dataset.number(session, "status") not in dataset.SOLVED:
                continue
            value = dataset.response_of(session, of)
            if value > best:
                best = value
                found = evaluate(session, value, float(session.column(identifier(path)).values))
        return None if _warns_of_end(session, 5) else found

    @_exclusive
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
            Called with the dataset of each point; return True to end the curve.
        progress : bool or function
            True: a progress bar of tqdm; a function is called with the number of points.
        **keys
            Keys of the group &curve (docs/user/curves.md), such as ``peak_of="x1 (1)", points=200``.

        Returns
        -------
        xarray.Dataset
            As for `solve`, with the dimension `point`; `dataset.nhbm.kind` names folds, peaks and bifurcations. The warning
            NotConverged is issued if it ends before its range does.

        Examples
        --------
        >>> import nhbm
        >>> oscillator = nhbm.Chain(n_masses=1, ends="fixed-free", mass=1.0, coupling_stiffness=1.0, damping_mass=0.05)
        >>> model = nhbm.Model(oscillator, tones=[0.5])
        >>> model.load("x1", 1, cos=0.18)
        >>> model.law("cubic_spring", "x1", stiffness=0.1)
        >>> curve = model.curve("tones[0]", 0.5, 2.0, order=15)
        >>> print([f"{float(omega):.6f}" for omega in curve["tones_frequency_1"][curve.nhbm.kind == "fold"]])
        ['1.269602', '1.115700']
        """
        path = path_of(path)
        if "over" in keys:
            keys["over"] = path_of(keys["over"])
        session = self._live(
            tolerance, order, {"curve": {"parameter": path, **_range(start, stop), **keys}}
        ).session
        points = []
        session.begin_curve()
        with Progress(progress, "curve") as bar:
            while session.next():
                points.append(dataset.motion_of(session))
                bar.update()
                if on_point is not None and on_point(points[-1]):
                    break
            else:
                _warns_of_end(session)
        if not points:
            raise ModelError(session.message or "the curve has no points")
        found = dataset.joined(points, {})
        if identifier(path) not in found:
            dataset.check_found(found, identifier(path))
            raise ModelError(found.nhbm.message or "the curve has no points")
        found[identifier(path)].attrs.update(self._described(path))
        return found.set_coords(identifier(path)).assign_attrs(varies=[identifier(path)])

    @_exclusive
    def integrate(self, duration: float | None = None, *, order: int | None = None, **keys: Any) -> xr.Dataset:
        """Integrates the model in time, by default from rest.

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
        given = {key: value for key, value in given.items() if value is not None}
        session = self._live(None, order, {"integration": given}).session
        session.integrate()
        return dataset.record_of(session)

    @_exclusive
    def verify(self, motion: xr.Dataset | None = None, *, periods: int = 0) -> xr.Dataset:
        """Integrates in time from the last motion, and from a perturbed state, to verify the motion and its stability.

        Parameters
        ----------
        motion : xarray.Dataset, optional
            The last motion; others are refused.
        periods : int
            Largest number of periods of the slowest tone; 0: from the decay rate.

        Returns
        -------
        xarray.Dataset
            The results of `nhbm verify`: `integration_verdict` ("agrees", "unstable", "differs", "undecided"), the
            differences in the first and in the last periods, the limit of the latter from the estimated error, the growth
            rate of disturbances [1/s].
        """
        if isinstance(periods, bool) or not isinstance(periods, (int, np.integer)) or not 0 <= periods < 2**31:
            raise ModelError(f"periods must be a whole number, 0 for as many as the decay requires, not {periods!r}")
        live = self._sessions.get(self._solved)
        if live is None:
            raise ModelError("there is no motion of `solve` that can be verified")
        session = live.session
        if motion is not None:
            dataset.check_found(motion, "coefficients")
        if motion is not None and not np.array_equal(motion["coefficients"].values, session.column("coefficients").values):
            raise ModelError("only the motion that this model has found last can be verified")
        session.verify(int(periods))
        found = dataset.record_of(session)
        return found.assign(integration_verdict=dataset.VERDICTS[int(found["integration_verdict"])])

    sweep = sweeps.sweep

    # Input text and sessions

    def _sharing(self, n: int) -> int:
        """Points that share the time for stability: none where its work, counted as that of compiled laws, would take minutes."""
        return 0 if any(law.steps_slowly for law in self._laws) else n

    def _ending(self) -> tuple[int, str]:
        """Status and message of the last solution; converged if there was none."""
        live = self._sessions.get(self._used)
        if live is None:
            return dataset.CONVERGED, ""
        return int(dataset.number(live.session, "status")) or dataset.CONVERGED, live.session.message

    def _add(self, name: str, keys: dict[str, Any]) -> None:
        if name in _CHECKED:
            self._check(name, keys)
        self._lists.append((name, keys))
        self._sessions = {}

    def _check(self, name: str, keys: dict[str, Any]) -> None:
        """Raises what is wrong with a new group by itself, on the structure and the tones; not for large structures, which are
        read once."""
        if "structure" not in self._groups or len(self._structure.labels if self._structure else ()) > _CHECKED_DOFS:
            return
        groups = [(group, self._groups.get(group, {})) for group in ("structure", "tones")]
        try:
            Session(self._find_structure).read("".join(group_text(*group) for group in [*groups, (name, keys)]), self._name)
        except ModelError as error:
            wrong = [line for line in str(error).splitlines() if f": &{name}: " in line]
            if wrong:
                raise ModelError("\n".join(wrong)) from None

    def _given(self, tolerance: float | None, order: int | None, more: Any) -> dict[str, dict[str, Any]]:
        """The groups that occur once, with what the operation adds."""
        groups = {**self._groups, **{name: {**self._groups.get(name, {}), **keys} for name, keys in (more or {}).items()}}
        if order is not None:
            groups.pop("accuracy", None)
        for name, key, value in (("accuracy", "tolerance", tolerance), ("harmonics", "order", order)):
            if value is not None:
                groups[name] = {**groups.get(name, {}), key: value}
        return groups

    def _text(self, groups: dict[str, dict[str, Any]]) -> str:
        """The input: &curve and &gradient replace those of a text that was read, keys of other groups are set in it."""
        base = self._base
        for name in set(groups) & set(_REPLACED):
            base = without_group(base, name)
        texts = [group_text(name, keys) for name, keys in groups.items() if name in _REPLACED or not self._is_in_base(name)]
        return base + "".join(texts + [group_text(name, keys) for name, keys in self._lists])

    def _described(self, path: str) -> dict[str, str]:
        return {"parameter": path, **described(path, self._live(*self._used[:2]).session.input(), input_keys())}

    def _is_in_base(self, group: str) -> bool:
        return re.search(rf"^\s*&{group}\b", self._base, re.IGNORECASE | re.MULTILINE) is not None

    def _live(self, tolerance: float | None = None, order: int | None = None,
              more: dict[str, dict[str, Any]] | None = None) -> _Live:  # fmt: skip
        """The session with that tolerance or order and keys of further groups, made once, with the present values."""
        used = tolerance, order, repr(more or "")
        if used not in self._sessions:
            session = Session(self._find_structure)
            groups = self._given(tolerance, order, more)
            session.read(self._text(groups), self._name)
            for name in groups:
                if name not in _REPLACED and self._is_in_base(name):
                    for key, value in groups[name].items():
                        session.set(f"{name}%{key}", value)
            if more is not None:  # one of them is cached
                self._sessions = {key: live for key, live in self._sessions.items() if key[2] == repr("")}
            self._sessions[used] = _Live(session)
        self._used, live = used, self._sessions[used]
        live.update(self._values)
        return live

    def _find_structure(self, name: str) -> Structure:
        if name == _IN_MEMORY and self._structure is not None:
            return self._structure
        path = self._folder / name
        return Structure.read(path if path.is_file() else name)

    @_exclusive
    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in self.__dict__.items() if name != "_lock"}
        return {
            **state,
            "_sessions": {},
            "_values": {**self._values},
            "_lists": [*self._lists],
            "_law_names": [law.name for law in self._laws],
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        names = state.pop("_law_names")
        self.__dict__.update(state)
        self._lock = threading.RLock()
        new = {old: law.name for old, law in zip(names, self._laws)}  # laws have names of their own in each process
        self._lists = [
            (g, {**keys, "name": new.get(keys["name"], keys["name"])} if "name" in keys else keys) for g, keys in self._lists
        ]


def _dofs(dof: str | Iterable[str]) -> dict[str, Any]:
    """Keys of an input for one or several degrees of freedom."""
    if isinstance(dof, str):
        return {"dof": dof}
    if not isinstance(dof, Iterable):
        raise ModelError(f"dof must be a label such as 'x1', or a list of labels, not {dof!r}")
    return {"dofs": list(dof)}


def _range(start: Any, stop: Any) -> dict[str, Any]:
    """Keys of &curve for the range of its parameter."""
    return {"from": numbers_of("start", start)[0], "to": numbers_of("stop", stop)[0]}


def _warns_of_end(session: Session, stacklevel: int = 4) -> bool:
    """Whether a curve has ended before its range does, with a warning if so."""
    reason = int(dataset.number(session, "reason"))
    if reason == dataset.CUT_SHORT:
        what = "the curve continues: it has reached the limit of its points, 'points' of &curve"
    elif reason == dataset.GRAZED:
        what = "the curve ended where a wall is grazed: no motion was found beyond"
    elif int(dataset.number(session, "status")) not in (*dataset.SOLVED, dataset.COLLAPSED):  # there the motion ends
        what = session.message
    else:
        return False
    warnings.warn(what, NotConverged, stacklevel=stacklevel)
    return True


class _Live:
    """A session with handles of numbers, and how many of the assignments to its model it has followed."""

    def __init__(self, session: Session) -> None:
        self.session, self.n_assignments = session, 0
        self._handles: dict[str, int] = {}

    def set(self, path: str, value: Any) -> None:
        if isinstance(value, (float, np.floating)):
            if path not in self._handles:
                self._handles[path] = self.session.parameter(path)
            self.session.set_parameter(self._handles[path], float(value))
        else:
            self.session.set(path, value)

    def update(self, values: Mapping[str, tuple[int, object]]) -> None:
        for path, (number, value) in values.items():
            if number > self.n_assignments:
                self.set(path, value)
        self.n_assignments = max([self.n_assignments, *(number for number, _ in values.values())])
