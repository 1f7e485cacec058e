"""What a model is made of: its groups, which are added and changed by name, and the sessions that solve them."""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np

from nhbm import advice
from nhbm.builders import Builder
from nhbm.errors import Implausible, ModelError, among, check_file, foreign_frames
from nhbm.groups import OPERATIONS, Group, Groups, Settings, absolute_files, call_of, value_at
from nhbm.keys import check_keys, check_numbers, model_groups, repeated_groups, subject_of
from nhbm.laws import Law
from nhbm.paths import InputPath, check_label
from nhbm.responses import responses_in
from nhbm.rows import Rows
from nhbm.session import Session
from nhbm.signatures import Laws
from nhbm.structure import Structure
from nhbm.values import numbers_of, plain

if TYPE_CHECKING:
    from typing_extensions import Self

_Method = TypeVar("_Method", bound=Callable[..., Any])
CHECKED_DOFS = 100  # of the largest structure for it
_SIZES = "n_masses", "n_elements", "n_dofs", "n_modes"  # keys of structures


def answering(method: _Method) -> _Method:
    """A method that answers wrong arguments with those that there are."""
    return _public(method, contextlib.nullcontext)


def exclusive(method: _Method) -> _Method:
    """Such a method that one thread at a time executes; others wait."""
    return _public(method, lambda self: self._lock)


def _public(method: _Method, held: Callable[[Any], Any]) -> _Method:
    """A method that answers wrong arguments with those that there are, and whose errors end where it was called."""
    signature = inspect.signature(method)

    @functools.wraps(method)
    def call(self: Description, *arguments: Any, **options: Any) -> Any:
        __tracebackhide__ = True
        try:
            if not isinstance(options.get("warm", False), (bool, np.bool_)):
                raise ModelError("warm must be True or False, for a start from the motion that this model had last, not "
                                 f"{type(options['warm']).__name__}")  # fmt: skip
            with held(self):
                return method(self, *arguments, **options)
        except (ModelError, KeyError) as error:
            raise error.with_traceback(foreign_frames(error)) from error.__cause__
        except TypeError:
            try:
                signature.bind(self, *arguments, **options)
            except TypeError as error:
                names = ", ".join(list(signature.parameters)[1:]) or "none"
                what = str(error).replace("too many", "got too many")
                text = f"{type(self).__name__}.{method.__name__}() {what}; its arguments: {names}"
                if "dof" in signature.parameters and len(arguments) > 2 and isinstance(arguments[2], str):
                    text += f"; several degrees of freedom are a list, dofs={list(arguments[1:])}"
                if list(signature.parameters)[1:2] == ["values"] and len(arguments) > 1 and isinstance(arguments[0], str):
                    text += f"; values are a dict by path, {{{arguments[0]!r}: [...]}}"
                raise TypeError(text) from None
            raise

    return cast(_Method, call)


class Description(Laws):
    """The groups of a model, in their order. One thread at a time uses it; others wait."""

    def __init__(self, structure: Builder | Structure | str | Path, tones: Any = (), **groups: Mapping[str, Any]) -> None:
        self._clear()
        if isinstance(structure, Builder):
            self._groups.add(Group("structure", structure.keys))
            self._check(self._groups.single("structure"))
        elif isinstance(structure, (str, Path)) and str(structure).lower().endswith(".nml"):
            raise ModelError(f"'{structure}' is an input, not a model file: nhbm.Model.from_file({str(structure)!r})")
        elif isinstance(structure, (Structure, str, Path)):
            from nhbm.files import is_result  # with h5py

            file = structure if isinstance(structure, Structure) else str(structure)
            if isinstance(file, str):
                check_file(file, "model file")
            if isinstance(file, str) and is_result(file):
                raise ModelError(f"'{file}' is a result, not a model file: nhbm.open_dataset({file!r}) reads it")
            self._groups.add(Group("structure", {"type": "model", "file": file}))
        else:
            is_array = isinstance(structure, np.ndarray)
            given = "an array; nhbm.Matrices(mass=..., stiffness=...) takes matrices" if is_array else repr(structure)
            raise ModelError(
                f"expected a structure such as nhbm.Beam(...), nhbm.Structure(...) or the path of a model file, not {given}"
            )
        if isinstance(tones, Mapping):
            self.set("tones", **tones)
        elif not (isinstance(tones, tuple) and len(tones) == 0):
            try:
                frequencies = numbers_of("tones", tones if np.ndim(tones) < 2 else ())
            except ModelError:
                raise ModelError(
                    "tones are frequencies [rad/s] or keys of &tones such as {'unknown': True} or {'hertz': 50.0}, "
                    f"not {tones!r}"
                ) from None
            self.set("tones", frequency=frequencies)
        for name, keys in groups.items():
            if name in ("frequency", "hertz", "unknown"):
                raise ModelError(f"'{name}' is a key of the tones: write tones={{'{name}': {keys!r}}}")
            if not isinstance(keys, Mapping):
                raise ModelError(f"{name} must be a dict of keys, such as harmonics={{'order': 5}}, not {keys!r}")
            self.set(name, **keys)

    def __repr__(self) -> str:
        structure = self._groups.first("structure")
        parts = [f"structure {structure.keys.get('type')}"] if structure else []
        tones = self._groups.first("tones")
        if tones:
            parts += [f"{key} {list(value) if isinstance(value, tuple) else value}" for key, value in tones.keys.items()]
        for name in repeated_groups():
            found = self._groups.named(name)
            types = [str(group.keys["type"]) for group in found if "type" in group.keys]
            if found:
                parts.append(f"{len(found)} {name}{'s' if len(found) > 1 else ''}" + (f" ({', '.join(types)})" if types else ""))
        return f"<nhbm.Model: {'; '.join(parts)}>"

    def _repr_html_(self) -> str:
        from nhbm import notebook

        return notebook.html_of_model(self._groups)

    def _clear(self) -> None:
        self._lock = threading.RLock()
        self._folder = Path()  # of files that the groups name
        self._groups = Groups()
        self._session: Session | None = None  # which has the groups, from the first use on
        self._used: Settings = {}  # of the last operation
        self._is_held = False  # the session has the present values, with these settings
        self._warned: set[str] = set()  # warnings about the model that were issued
        self._is_trial = False  # its values are those of a search, of which no warning is issued
        self._solved: Any = None  # the motion of the last `solve`
        self._cut: CutCurve | None = None

    @classmethod
    def from_namelist(cls, text: str, folder: str | Path = ".", name: str = "model") -> Self:
        """Creates a model from the text of an input, without its groups &sweep and &curve: a warning names the calls instead.

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
        model._folder = Path(folder)
        if "&" not in text:
            raise ModelError(f"expected the text of an input, not {text!r}; Model.from_file reads a file")
        session = Session(model._find_structure)
        session.read(text, str(model._folder / name))
        given = Groups.of_text(session.input(given=True))
        model._groups = Groups(group for group in given if group.name not in OPERATIONS)
        left_out = [group for group in given if group.name in OPERATIONS]
        if left_out:
            names = " and ".join(f"&{name}" for name in dict.fromkeys(group.name for group in left_out))
            advice.warn(advice.on("left_out_groups", name, names, call_of(left_out)).text, Implausible)
        for group in model._groups:
            if group.keys.get("type") == "user" and not group.keys.get("library"):
                group.put("name", next((law for law in session.laws if law.input_name == group.keys["name"]), group.keys["name"]))
        return model

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Creates a model from an input file, as `from_namelist` does from its text."""
        try:
            text = Path(path).read_text(encoding="utf-8")
        except FileNotFoundError:
            raise ModelError(f"file '{path}' does not exist") from None
        except (OSError, UnicodeDecodeError) as error:
            from nhbm.files import is_result  # with h5py

            if is_result(path):
                raise ModelError(f"'{path}' is a result, not an input: nhbm.open_dataset({str(path)!r}) reads it") from None
            why = getattr(error, "strerror", None) or "it is not a text"
            raise ModelError(f"file '{path}' cannot be read: {why}") from None
        return cls.from_namelist(text, Path(path).parent, Path(path).name)

    @exclusive
    def to_namelist(self) -> str:
        """The complete input with all keys and their values.

        Returns
        -------
        str
            An input for `from_namelist` and the command. Laws of Python appear by names that are valid in this process alone.

        Raises
        ------
        ModelError
            The structure is in memory, which no input can name: `to_file` writes it into a file.
        """
        if self._structure_in_memory() is not None:
            raise ModelError("the structure is in memory, which no text can name: model.to_file('model.nml') writes the input and, "
                             "beside it, the matrices as 'model.structure.h5'")  # fmt: skip
        return self._input()

    @exclusive
    def to_file(self, path: str | Path) -> None:
        """Writes the complete input for the command, and a structure in memory beside it, as NAME.structure.h5.

        Parameters
        ----------
        path : str or Path
            The file, such as "wall.nml"; an existing one is replaced.

        Raises
        ------
        ModelError
            The model has laws of Python, which the command cannot call.
        """
        from nhbm.child_process import atomic_write  # with h5py

        path = Path(path)
        own = [group.keys["name"] for group in self._groups.named("law") if isinstance(group.keys.get("name"), Law)]
        if own:
            raise ModelError(f"law '{own[0].__name__}' is a function of Python, which the command cannot call: write it in C "
                             "(docs/howto/law_in_c.md) and give its library, or solve the model here")  # fmt: skip
        text = absolute_files(self._input(), self._folder)
        structure = self._structure_in_memory()
        try:
            if structure is not None:
                beside = path.with_name(f"{path.stem}.structure.h5")
                structure.write(beside)
                text = text.replace(f"'{Structure.input_name}'", f"'{beside.name}'")
            with atomic_write(path) as name:
                Path(name).write_text(text, encoding="utf-8")
        except OSError as error:
            raise ModelError(f"file '{path}' cannot be written: {error.strerror or error}") from None

    def _input(self) -> str:
        """The complete input; laws of Python and a structure in memory appear by name only."""
        session = self._ready({})
        session.check()
        return session.input()

    def _structure_in_memory(self) -> Structure | None:
        group = self._groups.first("structure")
        file = None if group is None else group.keys.get("file")
        return file if isinstance(file, Structure) else None

    @exclusive
    def set(self, group: str, **keys: Any) -> None:
        """Sets keys of a group.

        Parameters
        ----------
        group : str
            A group that occurs once: "harmonics", "stability", "solver", ...
        **keys
            Its keys, such as ``set("harmonics", order=9)``; None restores the default.
        """
        if group in repeated_groups():
            call = f"{group}(...)" if hasattr(self, group) else f"add('{group}', ...)"
            raise ModelError(f"there may be several groups &{group}; model.{call} adds one")
        if group == "curve":
            raise ModelError("the keys of &curve are arguments of the operations: model.curve(path, start, stop, points=200)")
        if group not in model_groups():
            raise ModelError(f"unknown group '{group}'{among(group, list(model_groups()))}")
        own = self._groups.first(group)
        kind = own.keys["type"] if own is not None and "type" in own.keys and "type" not in keys else None
        check_keys(group, {**keys, "type": kind} if kind else keys)
        if group in ("accuracy", "gradient"):
            responses_in(keys.get("of"), "of")
        keys = {key: plain(value) for key, value in keys.items()}
        both = {**(own.keys if own is not None else {}), **keys}
        if group == "tones" and both.get("frequency") is not None and both.get("hertz") is not None:
            raise ModelError("&tones: give either 'frequency' [rad/s] or 'hertz', not both; None removes one: "
                             "model.set('tones', frequency=None, hertz=50.0)")  # fmt: skip
        if group == "gradient" and keys.get("by") is not None:
            keys["by"] = tuple(self._resolved(path) for path in np.atleast_1d(keys["by"]).tolist())
        for key, value in keys.items():
            self._groups.single(group).put(key, value)
        self._forget()

    @exclusive
    def add(self, group: str, **keys: Any) -> None:
        """Adds a group of which there may be several, by its keys; those with methods of their own are easier to add by these.

        Parameters
        ----------
        group : str
            "load", "law", "bearing", ...
        **keys
            Its keys, as in an input.
        """
        if group not in repeated_groups():
            raise ModelError(f"'{group}' is not a group of which there may be several{among(group, list(repeated_groups()))}")
        if group == "tie":
            check_keys(group, keys)
            for key in ("parameter", "to"):
                if keys.get(key) is None:
                    raise ModelError(f"&tie: missing key '{key}', which needs a path such as 'structure.speed'")
            self.tie(keys["parameter"], keys["to"], keys.get("factor", 1.0), keys.get("offset", 0.0))
            return
        self._add(group, keys)

    @exclusive
    def load(self, dof: str | None = None, tuple_: Any = None, cos: float | None = None, sin: float | None = None,
             **keys: Any) -> None:  # fmt: skip
        """Adds the force ``cos cos(j.omega t) + sin sin(j.omega t)``.

        Parameters
        ----------
        dof : str, optional
            Degree of freedom; alternatively ``vector="name"``, a load vector of the structure.
        tuple_ : int or sequence of int, optional
            j, one entry per tone; by default 1, or none for a load with a `frequency` of its own and for a model without tones.
        cos, sin : float
            Amplitudes [N] ([N m] for rotations), multiplied by those of the vector. One of them must be given; the other is
            zero by default.
        **keys
            Further keys of &load, such as ``frequency_power=2`` for an unbalance [kg m] or
            ``kind="base_acceleration"`` for a base motion [m/s2]; ``begin=0.0, end=0.1`` [s] and ``frequency=50.0`` [rad/s] for
            `integrate` alone.
        """
        if tuple_ is None and self._groups.first("tones") is not None and "frequency" not in keys:
            tuple_ = 1
        keys = {"dof": dof, "tuple": None if tuple_ is None else numbers_of("tuple_", tuple_, int), "cos": cos, "sin": sin, **keys}
        check_keys("load", keys)
        if cos is None and sin is None:
            raise ModelError("a load needs an amplitude: cos= or sin= [N]")
        self._add("load", keys)

    @exclusive
    def engine_order(self, dofs: Iterable[str], order: int, amplitude: float, tuple_: Any = 1) -> None:
        """Adds the load that a wheel of equal sectors meets as it turns past an uneven flow: the force on sector k of N,
        ``amplitude cos(j.omega t - 2 pi order k/N)``, which travels round the wheel.

        Parameters
        ----------
        dofs : iterable of str
            One degree of freedom of each sector, in the order of the sectors.
        order : int
            Engine order, the number of waves round the wheel; negative: it travels the other way.
        amplitude : float
            [N], or [N m] for rotations.
        tuple_ : int or sequence of int
            j; its frequency is that of the order, `order` times the speed of the wheel.
        """
        names = list(_dofs([dofs] if isinstance(dofs, str) else dofs)["dofs"])
        waves = numbers_of("order", order, int)[0]
        size = numbers_of("amplitude", amplitude)[0]
        if len(names) < 2:
            raise ModelError(f"an engine order needs a degree of freedom of each of several sectors, not {names}")
        again = [name for k, name in enumerate(names) if name in names[:k]]
        if again:
            raise ModelError(f"an engine order needs a degree of freedom of each sector, and '{again[0]}' is given more than once")
        for k, dof in enumerate(names):
            angle = 2.0 * np.pi * ((waves * k) % len(names)) / len(names)
            self.load(dof, tuple_, cos=float(size * np.cos(angle)), sin=float(size * np.sin(angle)))

    if not TYPE_CHECKING:  # its keys by law: nhbm.signatures

        @exclusive
        def law(self, kind: str | Law | Callable[..., Any], dof: str | Iterable[str] | None = None, **keys: Any) -> None:
            """Adds a nonlinear element.

            Parameters
            ----------
            kind : str or function
                A law: a type of the catalogue ("cubic_spring", "jenkins", ...), a function, or what `nhbm.law` makes of one.
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
            if law.takes_parameters and keys.get("parameters") is None:
                raise ModelError(f"law '{law.__name__}' takes parameters p: give them, parameters=[...]")
            self._add("law", {"type": "user", "library": "", "name": law, "odd": law.odd, **where, **keys})

    @exclusive
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

    @exclusive
    def initial(self, dof: str | None = None, displacement: float = 0.0, velocity: float = 0.0, **keys: Any) -> None:
        """Adds to the state from which `integrate` begins.

        Parameters
        ----------
        dof : str, optional
            Degree of freedom; alternatively ``vector="name"``, a load vector of the structure as a shape.
        displacement, velocity : float
            In the unit of the degree of freedom [m or rad] and per second.
        **keys
            Further keys of &initial.
        """
        keys = {"dof": dof, "displacement": displacement, "velocity": velocity, **keys}
        check_keys("initial", keys)
        self._add("initial", keys)

    @exclusive
    def bearing(self, dofs: Iterable[str], speeds: Any, stiffness: Any, damping: Any = None, mass: Any = None, *,
                frequencies: Any = None, **keys: Any) -> None:  # fmt: skip
        """Adds a bearing, a seal or a foundation with tabulated coefficients to the structure.

        Parameters
        ----------
        dofs : iterable of str
            Directions x and y.
        speeds : sequence of float or None
            Speeds of the rows of the tables [rad/s]; None for tables over the frequency alone.
        stiffness, damping : array_like
            k_xx, k_xy, k_yx, k_yy [N/m], likewise the damping [N s/m], (n_speeds, 4), (n_frequencies, 4), or both:
            (n_speeds, n_frequencies, 4).
        mass : array_like, optional
            m_xx, m_xy, m_yy [kg], likewise (..., 3).
        frequencies : sequence of float, optional
            Frequencies of the motion (of the whirl) for which the tables have rows [rad/s].
        **keys
            `speed` [rad/s], the current speed, for ``model.tie("bearing(1)%speed", "tones[0]")``, and `label`.
        """
        tables = {"speeds": speeds, "frequencies": frequencies, "stiffness": stiffness, "damping": damping, "mass": mass}
        values = {name: numbers_of(name, table) for name, table in tables.items() if table is not None}
        self._add("bearing", {"dofs": list(dofs), **values, **keys})

    @exclusive
    def feedback(self, sensors: Iterable[str], actuators: Iterable[str], a: Any = None, b: Any = None, c: Any = None, d: Any = None,
                 e: Any = None, delay: float | None = None, **keys: Any) -> None:  # fmt: skip
        """Adds a linear controller, as of a magnetic bearing: x' = A x + B z, f = C x + D z + E z' with the displacements z.

        The forces are on the left-hand side of the equations of motion, as that of a spring: a controller whose output acts on
        the structure has -C, -D and -E.

        Parameters
        ----------
        sensors, actuators : iterable of str
            Degrees of freedom that are measured, and those on which the forces act.
        a, b, c : array_like, optional
            A [1/s], (n_states, n_states); B (n_states, n_sensors); C (n_actuators, n_states). The states are `state1`, ...
        d, e : array_like, optional
            Stiffness D [N/m] and damping E [N s/m], (n_actuators, n_sensors).
        delay : float, optional
            Of the forces [s].
        **keys
            `label`.
        """
        matrices = {"a": a, "b": b, "c": c, "d": d, "e": e}
        values: dict[str, Any] = {name: numbers_of(name, matrix) for name, matrix in matrices.items() if matrix is not None}
        if delay is not None:
            values["delay"] = delay
        if a is not None:
            values["n_states"] = len(np.atleast_1d(np.asarray(a)))
        self._add("feedback", {"sensors": list(sensors), "actuators": list(actuators), **values, **keys})

    @exclusive
    def sector(self, n_sectors: int, engine_orders: Any, low: Iterable[str], high: Iterable[str], **keys: Any) -> None:
        """Makes the structure one sector of a wheel, in motions that travel from sector to sector.

        Harmonic j has d = sum of j times the engine orders as its nodal diameter: its amplitude in the next sector is
        exp(-2 pi i d/n_sectors) times that in this one, as ``engine_order`` loads the sectors of a whole wheel.

        Parameters
        ----------
        n_sectors : int
        engine_orders : int or sequence of int
            Engine order of each tone; negative: its wave travels the other way.
        low, high : iterable of str
            Degrees of freedom at the boundary with the previous sector, and those of this sector that are the same in the next
            one, in the same order.
        **keys
            `label`.
        """
        orders = numbers_of("engine_orders", engine_orders, int)
        self._add("sector", {"n_sectors": n_sectors, "engine_orders": orders, "low": list(low), "high": list(high), **keys})

    @exclusive
    def whole_wheel(self) -> Self:
        """The whole wheel of a model of one sector, for what needs all sectors: verification, deviations between blades.

        Returns
        -------
        Model
            Its sector 0 has the names of this model; those of sector s end in ``_s``, such as `blade_3` and the law `stop_3`.
        """
        from nhbm.whole_wheel import structure_of_matrices, whole_wheel  # with SciPy

        group = self._groups.single("structure")
        if group.keys.get("type") == "matrices":
            structure = structure_of_matrices(group.keys)
        elif "file" in group.keys:
            structure = self._find_structure(str(group.keys["file"]))
        else:
            raise ModelError("whole_wheel: the sector must be of matrices or a model file")
        groups = whole_wheel(self._groups, structure)
        model = type(self)(groups.single("structure").keys["file"])
        model._groups, model._folder = groups, self._folder
        return model

    @exclusive
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

    @exclusive
    def tie(self, path: str, to: str, factor: float = 1.0, offset: float = 0.0) -> None:
        """Makes a value follow another one, ``offset + factor * value``.

        Parameters
        ----------
        path, to : str
            The dependent value, and the value to follow: ``model.tie("structure.speed", "tones[0]")``.
        factor, offset : float
            In the units of both.
        """
        for one in (path, to):
            at = self._groups.resolved(one)
            group = self._groups.find(at)
            is_beyond = group is not None and at.key in group.keys and group.get(at.key, at.indices) is None
            if group is None or self._groups.key_at(at) is None or is_beyond:
                value_at(at, Groups.of_text(self._input()))  # raises what is wrong with the path
        if self._resolved(path) == self._resolved(to):
            raise ModelError(f"&tie: '{path}' cannot follow itself")
        paths = str(self._groups.located(path)), str(self._groups.located(to))
        self._add("tie", {"parameter": paths[0], "to": paths[1], "factor": factor, "offset": offset})

    @exclusive
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
        nhbm.errors.ModelError: 'law(stop)%gap': there is no group '&law'; the input has: structure, tones
        """
        at = self._groups.resolved(path)
        self._check_value(path, at, value)
        key = self._groups.key_at(at)
        if key is not None and np.size(value) > 1 and (at.indices or not key.type.startswith(("list", "matrix"))):
            raise ModelError(f"'{path}': {at.keyed} has {np.size(value)} values, needs one")
        if value is None:
            raise ModelError(f"'{path}' needs a value, not None; del model[...] removes a group")
        session, group = self._ready(self._used), self._groups.find(at)
        if group is None or key is None or (self._groups.first("tie") and at.group not in self._used):
            session.parameter(str(at))  # raises what is wrong with the path
        self._is_held, value = False, plain(value)
        keyed = (group or self._groups.single(at.group)).put(at.keyed, value)
        if group is not None and at.group not in self._used:
            session.put(group, keyed, value)
            self._is_held = True

    @exclusive
    def __getitem__(self, path: str) -> Any:
        """Returns a value by its path.

        Parameters
        ----------
        path : str
            As for setting it; without an index, lists are returned whole.

        Returns
        -------
        object
            Number, text, truth or list of them, in the unit of the input; defaults are included. A value that follows another
            by `tie` is returned as it follows, from the first guess of an unknown tone.

        Examples
        --------
        >>> import nhbm
        >>> model = nhbm.Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0), tones=[0.9])
        >>> model["tones[0]"], model["structure.n_masses"], model["stability.method"]
        (0.9, 2, 'auto')
        """
        at = self._groups.resolved(path)
        for tie in self._groups.named("tie"):
            if self._groups.resolved(str(tie.keys["parameter"])) == at:
                factor, offset = (float(tie.keys.get(*key)) for key in (("factor", 1.0), ("offset", 0.0)))
                return offset + factor * self[str(tie.keys["to"])]
        group = self._groups.find(at)
        value = None if group is None else group.get(at.key, at.indices)
        if isinstance(value, (bool, int, float, str)):
            return value
        return value_at(at, Groups.of_text(self._input()))

    @exclusive
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
        if match:
            found = self._groups.named(match[1])[int(match[2]) :][:1] if match[1] in repeated_groups() else []
        else:
            found = [group for group in self._groups if group.label == entry]
        if not found:
            hint = "use its label, or a number as in 'load[0]'"
            raise ModelError(f"'{entry}' names no load, law or other group in this model; {hint}")
        self._groups.remove(found[0])
        self._forget()

    # Sessions

    def _check_value(self, path: str, at: InputPath, values: Any) -> None:
        """Raises what is wrong with the value of a path: numbers that are not finite or outside the range of the key."""
        key = self._groups.key_at(at)
        if key is not None:
            check_numbers(f"'{path}'", at.keyed, key, values)

    def _add(self, name: str, keys: dict[str, Any]) -> None:
        check_keys(name, keys)
        group = Group(name, keys)
        if not isinstance(keys.get("label", ""), (str, type(None))):
            raise ModelError(f"&{name}: label must be a text, not {keys['label']!r}")
        if "label" in group.keys:
            check_label(name, group.label)
        if group.label and any(other.label == group.label for other in self._groups.named(name)):
            raise ModelError(f"&{name}: there is another group with the label '{group.label}'; labels name one each")
        self._groups.add(group)
        self._forget()
        try:
            self._check(group)
        except ModelError:
            self._groups.remove(group)
            self._forget()
            raise

    def _check(self, group: Group) -> None:
        """Raises what is wrong with a new group by itself, on the structure and the tones; not for large structures, which are
        read once."""
        structure = self._groups.first("structure")
        if group.name not in ({"structure", *repeated_groups()} - {"tie"}) or structure is None:
            return
        file = structure.keys.get("file")
        if file is not None and not (isinstance(file, Structure) and file.n_dofs <= CHECKED_DOFS):
            return
        if not isinstance(file, Structure) and size_of(structure) > CHECKED_DOFS:
            return
        try:
            self._ready(self._used).check(group)
        except ModelError as error:
            subject = subject_of(group.name, group.keys.get("type"))
            raise ModelError(re.sub(rf"^&{group.name}\b", subject, str(error), flags=re.MULTILINE)) from None

    def _begin(self, settings: Settings) -> Session:
        """The session of an operation, with a warning of values that suggest a mistake."""
        session = self._ready(settings)
        if not self._is_trial:
            advice.warn_of_model(session, self._warned)
            advice.warn_of_signs(self._groups.named("law"), self._warned)
        return session

    def _continue_cut(self, settings: Settings) -> CutCurve | None:
        """The last curve, with more points in its session, if it has ended at their number and no other setting differs."""
        cut, self._cut = self._cut, None
        points = (settings["curve"] or {}).get("points")
        if cut is None or not isinstance(points, int):
            return None
        if {**settings, "curve": {**(cut.settings["curve"] or {}), "points": points}} != settings:
            return None
        session = self._ready(cut.settings)
        if cut.serial != session.serial or not session.lengthen_curve(points):
            return None
        self._used = settings
        return cut

    def _resolved(self, path: Any) -> str:
        """The one spelling of a path."""
        return str(self._groups.resolved(path))

    def _paths(self, by: Iterable[str]) -> list[str]:
        """The spellings of paths, of which there is at least one."""
        paths = [self._resolved(path) for path in ([by] if isinstance(by, str) else by)]
        if not paths:
            raise ModelError("by must name at least one value, such as ['wall.gap']")
        return paths

    def _forget(self) -> None:
        """Forgets the motions that were found: this is another model now."""
        self._is_held = False
        if self._session is not None and self._session.has_motion:
            self._session = None

    def _ready(self, settings: Settings, *further: Group) -> Session:
        """The session, with the present values, the settings of an operation, and its further groups."""
        if self._session is None:
            self._session, self._is_held = Session(self._find_structure), False
        if not self._is_held or settings != self._used or further:
            self._is_held, self._used = False, settings
            self._session.hold([*self._groups.with_settings(settings), *further], place_of(self._folder))
            self._is_held = not further
        return self._session

    def _find_structure(self, name: str) -> Structure:
        held = self._structure_in_memory()
        if held is not None:
            return held
        path = self._folder / name
        return Structure.read(path if path.is_file() else name)

    @exclusive
    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in self.__dict__.items() if name != "_lock"}
        return {**state, "_groups": self._groups.snapshot(), "_session": None, "_solved": None, "_cut": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = threading.RLock()


def _dofs(dof: str | Iterable[str]) -> dict[str, Any]:
    """Keys of an input for one or several degrees of freedom."""
    if isinstance(dof, str):
        return {"dof": dof}
    if not isinstance(dof, Iterable):
        raise ModelError(f"dof must be a label such as 'x1', or a list of labels, not {dof!r}")
    return {"dofs": list(dof)}


def size_of(structure: Group) -> int:
    """A measure of the size of a structure that the solver builds."""
    return max([int(value) for key, value in structure.keys.items() if key in _SIZES and isinstance(value, int)], default=0)


@functools.lru_cache(maxsize=100)
def place_of(folder: Path) -> str:
    """A folder as the name of an input that is not a file."""
    return "" if folder == Path() else f"{folder}/"


class CutCurve(NamedTuple):
    """A curve that has ended at its number of points: its settings, what the session had done then, and what was found."""

    settings: Settings
    serial: int
    rows: Rows
    doubtful: list[tuple[str, list[advice.Advice]]]
    inactive: list[advice.Advice] | None
