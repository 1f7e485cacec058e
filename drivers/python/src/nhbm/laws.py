"""Laws of one's own: functions of Python for all samples at once, or compiled ones (Numba, ctypes, scipy.LowLevelCallable)."""

from __future__ import annotations

import ctypes
import inspect
import itertools
import re
import sys
import threading
import weakref
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nhbm._library import ADVANCE, EVALUATE, LAW_API, LawInfo, LawSamples, LawStep, library, raise_error
from nhbm.errors import ModelError

__all__ = ["ADVANCE", "EVALUATE", "Law", "LawInfo", "LawSamples", "LawStep", "Step", "law"]

Array = NDArray[Any]

_ANY_NUMBER = -1
_FATAL = -1
_STEP = 1e-30  # of the complex step
_DIFFERENCE = float(np.finfo(float).eps ** (1 / 3))  # of central differences, relative to the largest sample
_NAMED = "phases", "frequencies", "states"  # arguments that a function has by name
_ROLES = {  # names of arguments by what they are; the first argument may have any other name and is q
    **dict.fromkeys("q z x u y displacement displacements".split(), "q"),
    **dict.fromkeys("v dq dz dx qd xd q_dot qdot x_dot xdot rate rates velocity velocities".split(), "v"),
    **dict.fromkeys("p par params parameter parameters".split(), "p"),
}

_LAW_GROUP = re.compile(r"^&law$(.*?)^/$", re.MULTILINE | re.DOTALL)

_COMPILED: Any = ctypes.CFUNCTYPE(None).__mro__[1]  # the base of all functions of ctypes

_numbers = itertools.count(1)
_state = threading.local()  # of this thread: the fault of a callback, and whether a law runs
_registered: weakref.WeakValueDictionary[str, Law] = weakref.WeakValueDictionary()


class Step(NamedTuple):
    """What is known of the displacements along a step of time, each an array like the displacements of a law [m]."""

    q: Array
    """at the end"""
    q_before: Array
    """at the start"""
    rise: Array
    """velocity at the end times the duration of the step"""
    rise_before: Array
    """velocity at the start times the duration of the step"""


class Law:
    """What `nhbm.law` makes of a function: a law for models in this process, ``model.law(law, "x1")``.

    Parameters
    ----------
    function : function or pointer
        A function of the displacements q [m], and optionally of the velocities v [m/s] and the parameters p of the input,
        which are recognised by these names (`v`, `velocity`, ...; `p`, `parameters`, ...). Displacements and velocities are
        arrays of all samples, (n_samples) for one coordinate, (n_samples, n_coordinates) for several. It returns the forces
        [N] of the same shape, positive if restoring, or a tuple of the forces and their derivatives
        with respect to q (and v), for several coordinates with a further axis. Missing derivatives are computed by complex
        steps if the function accepts complex samples, else by central differences.

        Further arguments are recognised by name: `phases` of the tones, omega t [rad], (n_samples, n_tones), and
        `frequencies`, the base frequencies [rad/s], (n_tones).

        A compiled function instead takes a pointer to LawSamples (nhbm_user_law.h): a ctypes pointer, a Numba cfunc, a
        scipy.LowLevelCallable.
    arguments : str, optional
        What the arguments of the function are if their names do not say so: "q p", "q v p".
    velocity, phases, frequencies : bool
        Whether a compiled function uses these.
    degree : int
        Degree of a polynomial force; 0: not a polynomial.
    length_scale : float
        Displacement [m] over which the force changes; 0: unknown.
    odd : bool
        Whether f(-q, -v) = -f(q, v).
    states : int
        Number of states of a law with memory. The force is then a function of q, `states` and optionally p, with
        derivatives with respect to q and the states. Samples of one state have the shape (n_samples), of several
        (n_samples, states). At rest they are zero.
    advance : function or pointer
        ``advance(states, step)`` or ``advance(states, step, p)`` returns the states at the end of a Step from those at its
        start; a compiled function takes a pointer to LawStep.

    Examples
    --------
    >>> import nhbm
    >>> law = nhbm.law(lambda q: 0.5 * q**3, odd=True)
    >>> law(2.0)
    4.0
    """

    def __init__(
        self, function: Any, *, arguments: str | None = None, velocity: bool | None = None, degree: int = 0,
        length_scale: float = 0.0, odd: bool = False, phases: bool = False, frequencies: bool = False, states: int = 0,
        advance: Any = None,
    ) -> None:  # fmt: skip
        if not isinstance(odd, (bool, np.bool_)):
            raise ModelError(f"odd must be True or False, not {odd!r}")
        self.function, self.odd = function, bool(odd)
        self.__name__ = str(getattr(function, "__name__", type(function).__name__))
        self.__module__ = str(getattr(function, "__module__", __name__))
        self._options = {"arguments": arguments, "velocity": velocity, "degree": degree, "length_scale": length_scale, "odd": odd,
                         "phases": phases, "frequencies": frequencies, "states": states, "advance": advance}  # fmt: skip
        if (states > 0) != (advance is not None):
            raise ModelError(f"law '{self.__name__}': states, their number, and the function advance belong together")
        address = _address(function)
        self.takes_parameters, self._force = False, None
        self.steps_slowly = states > 0 and None in (address, _address(advance))  # in time: an evaluation takes 1 ms
        if address is None and not callable(function):
            raise ModelError(f"a law is a function of q, v and p, a pointer to one, or the name of a type, not {function!r}")
        if address is None:
            caller = _Force(function, self.__name__, arguments, velocity, states)
            self.takes_parameters, self._force = "p" in caller.roles, caller
            needs_velocity, phases, frequencies = caller.needs_velocity, "phases" in caller.named, "frequencies" in caller.named
            self._pointer = EVALUATE(caller)
        else:
            needs_velocity = bool(velocity)
            self._pointer = EVALUATE(address)
        self.input_name = f"{self.__name__}_{next(_numbers)}".replace("<lambda>", "law")  # in inputs
        info = LawInfo(LAW_API, _ANY_NUMBER, _ANY_NUMBER, needs_velocity, degree, length_scale, None, phases, frequencies, states)
        if advance is not None:
            self._advance = ADVANCE(_address(advance) or _Advance(advance, self.__name__))
            info.advance = ctypes.cast(self._advance, ctypes.c_void_p).value
        status = library().nhbm_register_law(self.input_name.encode(), ctypes.byref(info), self._pointer)
        if status:
            raise_error(status)
        _registered[self.input_name] = self
        weakref.finalize(self, _unregister, self.input_name)

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)

    @property
    def has_own_slopes(self) -> bool:
        """Whether its derivatives are taken from its forces, since the function has none."""
        return self._force is not None and bool(self._force.trust)

    def pushes_away(self, parameters: Any = None) -> bool:
        """Whether the force of a function of Python on one coordinate at rest opposes each displacement, as no spring does, or
        is opposed to each velocity at any displacement, as no damper is."""
        if self._force is None or self._force.named:
            return False
        roles, sizes = self._force.roles, 10.0 ** np.arange(-6.0, 1.0)
        steps = np.concatenate([[0.0], sizes, -sizes])

        def opposes(q: Any, v: Any, steps: Any) -> bool:
            """Whether the force changes against each step from the first sample, and against one at least."""
            given = {"q": q, "v": v, "p": np.ravel(() if parameters is None else parameters)}
            try:
                with np.errstate(all="ignore"):
                    force = self.function(*(given[role].copy() for role in roles))
                force = np.asarray(force[0] if isinstance(force, tuple) else force)
                if force.dtype.kind not in "fi" or force.shape != q.shape:
                    return False
                work = (force - force[0])[1:] * steps[1:]
            except Exception:  # what is wrong with the function is reported when it is used
                return False
            return bool(np.isfinite(work).all() and (work <= 0).all() and (work < 0).any())

        wide = np.concatenate([steps, 1e3 * steps])  # a self-excited law damps large motions
        feeds = "v" in roles and all(opposes(np.full_like(wide, q), wide, wide) for q in wide)
        return feeds or opposes(steps, 0.0 * steps, steps)

    def __reduce__(self) -> Any:
        if getattr(sys.modules.get(self.__module__), self.__name__, None) is self:  # of the decorator: known by its name
            return self.__name__
        return _again, (self.function, self._options)


def law(function: Any = None, **options: Any) -> Any:
    """Turns a function into a law for ``model.law``: as a decorator, ``@nhbm.law`` or ``@nhbm.law(odd=True)``, or as a call,
    ``nhbm.law(function, odd=True)``.

    Parameters
    ----------
    function : function or pointer
        A function of Python, or a compiled one: see `nhbm.laws.Law`.
    **options
        Those of `nhbm.laws.Law`: `odd`, `degree`, `length_scale`, `states` and `advance`, `arguments`, ...

    Returns
    -------
    Law
        The law, which can be called like the function.

    Examples
    --------
    >>> import nhbm, numpy as np
    >>> @nhbm.law(odd=True)
    ... def stiffening(q, v, p):
    ...     return p[0] * np.sinh(q / p[1])
    >>> stiffening.odd
    True
    """
    return (lambda f: Law(f, **options)) if function is None else Law(function, **options)


def laws_in(text: str) -> list[Law]:
    """Laws of Python that an input may name; who reads the input holds them as long as the library may call them."""
    return [law for name, law in list(_registered.items()) if name in text]


def laws_of(text: str) -> list[tuple[Law, str]]:
    """Laws of Python in a complete input, each with its label."""
    found = []
    for group in _LAW_GROUP.findall(text):
        keys = dict(re.findall(r"^ *(name|label) = '(.*)'$", group, re.MULTILINE))
        if keys.get("name") in _registered:
            found.append((_registered[keys["name"]], keys.get("label", "")))
    return found


def store_fault(fault: BaseException) -> None:
    """Stores an exception of a callback until the library has returned to this thread."""
    _state.fault = fault


def pop_fault() -> BaseException | None:
    """Exception that a callback has raised since the last call of this function, in this thread."""
    fault, _state.fault = getattr(_state, "fault", None), None
    return fault


def is_running() -> bool:
    """Whether a function of Python is being called by the library, in this thread."""
    return getattr(_state, "running", False)


def _again(function: Any, options: dict[str, Any]) -> Law:
    return Law(function, **options)


def _unregister(name: str) -> None:
    library().nhbm_unregister_law(name.encode())


def _address(function: Any) -> int | None:
    """Address of a compiled function, None for one of Python."""
    if type(function).__module__.startswith("scipy") and hasattr(function, "function"):  # scipy.LowLevelCallable
        function = function.function
    if hasattr(function, "address") and isinstance(function.address, int):  # Numba
        return function.address
    if isinstance(function, _COMPILED):
        return ctypes.cast(function, ctypes.c_void_p).value
    return None


def _arguments(function: Any) -> list[str]:
    """Names of the arguments that a call must give."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    return [p.name for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL and p.kind is not p.VAR_KEYWORD]


def _columns(address: int, n_columns: int, block: Any) -> Array:
    """Columns of samples as they stand in memory, (n_samples, n_columns)."""
    samples = (ctypes.c_double * (block.stride * n_columns)).from_address(address)
    return np.frombuffer(samples).reshape(n_columns, block.stride)[:, : block.n_samples].T


def _list(address: int, n: int) -> Array:
    return np.ctypeslib.as_array((ctypes.c_double * n).from_address(address)) if n else np.zeros(0)


def _narrow(values: Array) -> Array:
    """Samples of one column as a list of numbers."""
    return values[:, 0] if values.shape[1] == 1 else values


def _write(address: int, values: Array, block: Any) -> None:
    """Derivatives (n_samples, n, m), the last axis is what is differentiated by."""
    n, m = values.shape[1:]
    _columns(address, n * m, block)[:] = values.transpose(0, 2, 1).reshape(-1, n * m)


class _Caller:
    """What the library calls: exceptions are stored until it has returned."""

    def __call__(self, pointer: Any) -> int:
        if getattr(_state, "fault", None) is not None:  # it has failed before, and this has not been reported yet
            return _FATAL
        _state.running = True
        try:
            self.work(pointer.contents)
            return 0
        except BaseException as fault:
            _state.fault = fault
            return _FATAL
        finally:
            _state.running = False

    def work(self, block: Any) -> None:
        raise NotImplementedError


def _roles_of(name: str, arguments: list[str], declared: str | None) -> list[str]:
    """What each positional argument of a law is: q, v or p, by its name or as declared."""
    if declared is not None:
        roles = declared.split()
        if "q" not in roles or not set(roles) <= {"q", "v", "p"} or len(set(roles)) < len(roles):
            raise ModelError(f"law '{name}': arguments must be such as 'q p' or 'q v p', not {declared!r}")
        if arguments and len(roles) != len(arguments):
            raise ModelError(f"law '{name}': arguments='{declared}' has {len(roles)}, the function takes {len(arguments)}")
        return roles
    roles = [_ROLES.get(one.lower(), "") for one in arguments]
    if roles and not roles[0]:
        roles[0] = "q"
    for k, (role, one) in enumerate(zip(roles, arguments)):
        if not role or role in roles[:k]:
            raise ModelError(
                f"law '{name}': argument '{one}' is not known, or like an earlier one; name the displacements q, velocities v and "
                "parameters p, or declare them: nhbm.law(f, arguments='q p')"
            )
    if "q" not in roles:
        raise ModelError(f"law '{name}' takes no displacements: the arguments are q, and optionally v and p")
    return roles


class _Force(_Caller):
    """Forces and their derivatives by a function of Python."""

    def __init__(self, function: Any, name: str, roles: str | None, velocity: bool | None, n_states: int) -> None:
        arguments = _arguments(function)
        self.function, self.n_states = function, n_states
        self.trust: dict[tuple[int, int], _Trust] = {}  # by argument and column
        self.named = [named for named in _NAMED if named in arguments]
        self.roles = _roles_of(name, [one for one in arguments if one not in self.named], roles)
        self.needs_velocity = ("v" in self.roles if velocity is None else velocity) and n_states == 0
        if ("states" in self.named) != (n_states > 0):
            raise ModelError(f"law '{name}' must take the argument 'states' if it has states, and only then")
        if n_states and "v" in self.roles:
            raise ModelError(f"law '{name}' has states and therefore no velocities; it may take q, p and states")

    def work(self, block: Any) -> None:
        n = block.n_coordinates
        z = _columns(block.z, n, block)
        v = _columns(block.v, n, block) if block.v else np.zeros_like(z)
        s = _columns(block.states, block.n_states, block) if self.n_states else z
        p = _list(block.parameters, block.n_parameters)
        for samples in (z, v, s):
            samples.flags.writeable = False  # a law that changes them would change the motion
        named = {}
        if "phases" in self.named:
            named["phases"] = _columns(block.phases, block.n_tones, block)
        if "frequencies" in self.named:
            named["frequencies"] = _list(block.frequencies, block.n_tones)

        def call(z: Array, v: Array, s: Array) -> Any:
            given = {"q": lambda: _narrow(z), "v": lambda: _narrow(v), "p": lambda: p}
            if self.n_states:
                named["states"] = _narrow(s)
            try:
                return self.function(*(given[role]() for role in self.roles), **named)
            except ValueError as fault:
                if "truth value of an array" not in str(fault):
                    raise
                raise ModelError(
                    f"law '{self.function.__name__}' takes its argument for one number, but it has all samples: "
                    "write np.maximum, np.minimum or np.where instead of max, min or if"
                ) from fault

        answer = call(z, v, s)
        given = answer if isinstance(answer, tuple) else (answer,)
        if len(given) > 3:
            raise ModelError(f"law '{self.function.__name__}' gives {len(given)} values, not (force, df_dq[, df_dv])")
        forces = _shaped(self.function, "forces", given[0], z.shape)
        if np.shape(given[0]) == () and len(z) > 1 and forces.any():
            raise ModelError(f"law '{self.function.__name__}' gives one force for {len(z)} samples: it must give one for each")
        _columns(block.f, n, block)[:] = forces
        wanted = [(block.df_dz, z, lambda x: call(x, v, s)), (block.df_dv, v, lambda x: call(z, x, s)),
                  (block.df_ds, s, lambda x: call(z, v, x))]  # fmt: skip
        wanted = [(address, x, along) for address, x, along in wanted if address]
        if 1 < len(given) <= len(wanted):
            by = "states" if self.n_states else "velocities"
            raise ModelError(f"law '{self.function.__name__}' gives derivatives by displacements but not by {by}")
        for k, (address, x, along) in enumerate(wanted):
            if len(given) > 1:
                _write(address, _shaped(self.function, "derivatives", given[k + 1], (*z.shape, x.shape[1])), block)
            else:
                trust = [self.trust.setdefault((k, c), _Trust()) for c in range(x.shape[1])]
                slopes = [_slope(self.function, along, x, c, z.shape, trust[c]) for c in range(x.shape[1])]
                _write(address, np.stack(slopes, axis=2), block)


class _Advance(_Caller):
    """States at the end of a step by a function of Python, and their derivatives: all moved samples in one call."""

    def __init__(self, function: Any, name: str) -> None:
        self.function, self.name, self.n_arguments = function, name, len(_arguments(function))
        self.trust = _Trust()
        if self.n_arguments not in (2, 3):
            raise ModelError(f"'advance' of law '{name}' must take 2 or 3 arguments: states, step, parameters")

    def work(self, block: Any) -> None:
        n, m, c = block.n_samples, block.n_states, block.n_coordinates
        inputs = block.z, block.z_before, block.rise, block.rise_before
        p = _list(block.parameters, block.n_parameters)
        columns = np.hstack([_columns(block.states_before, m, block), *(_columns(address, c, block) for address in inputs)])

        def call(columns: Array) -> Array:
            parts = [_narrow(part) for part in np.split(columns, [m, m + c, m + 2 * c, m + 3 * c], axis=1)]
            found = self.function(*(parts[0], Step(*parts[1:]), p)[: self.n_arguments])
            return _shaped(self.function, "states", found, (len(columns), m), dtype=None)

        if not block.ds_dbefore:
            _columns(block.states, m, block)[:] = call(columns)
            return
        k = columns.shape[1]
        moves = np.eye(k)[:, None, :]
        step = _DIFFERENCE * (np.abs(columns[:, m:]).max() or 1.0)

        def moved(by: complex) -> Array:
            return call((columns + by * moves).reshape(-1, k)).reshape(k, n, m)

        states = call(columns)
        slopes = self.trust.slopes(moved, lambda: states, step)
        _columns(block.states, m, block)[:] = states
        slopes, first = slopes.transpose(1, 2, 0), m
        _write(block.ds_dbefore, slopes[:, :, :m], block)
        for address in (block.ds_dz, block.ds_dz_before, block.ds_drise, block.ds_drise_before):
            _write(address, slopes[:, :, first : first + c], block)
            first += c


def _shaped(function: Any, what: str, values: Any, shape: tuple[int, ...], dtype: Any = float) -> Array:
    """Values as an array of that shape; raises ModelError that names the law where they are not."""
    subject = f"law '{getattr(function, '__name__', function)}' gives {what}"
    if dtype is float and np.iscomplexobj(values):
        raise ModelError(f"{subject} that are complex")
    if values is None:
        raise ModelError(f"{subject} that are None")
    try:
        values = np.asarray(values, dtype=dtype)
    except (TypeError, ValueError) as fault:
        raise ModelError(f"{subject} that are no numbers: {fault}") from None
    wanted = shape[:1] if max(shape[1:]) == 1 else shape
    if values.shape not in (wanted, shape, ()):
        raise ModelError(f"{subject} of shape {values.shape}, expected {wanted}")
    return np.broadcast_to(values, wanted).reshape(shape) if values.shape == () else values.reshape(shape)


def _slope(function: Any, along: Callable[[Array], Any], samples: Array, c: int, shape: tuple[int, ...], trust: _Trust) -> Array:
    """Derivative of forces by a column."""

    def moved(by: complex) -> Array:
        columns = samples.astype(np.result_type(samples, by))
        columns[:, c] += by
        return _shaped(function, "forces", along(columns), shape, dtype=None if isinstance(by, complex) else float)

    return trust.slopes(moved, lambda: moved(0.0), _DIFFERENCE * (np.abs(samples[:, c]).max() or 1.0))


class _Trust:
    """Chooses how a derivative is found: by complex steps where the function follows them, else by central differences.

    A function may accept complex numbers without being differentiable in them, as with `abs`. Complex steps are compared with
    differences in the first call, the second, the fourth, the eighth ..., and are given up where more than an eighth of the
    samples has neither the derivative nor, at a kink, one from either side.
    """

    def __init__(self) -> None:
        self.n_calls, self.is_complex = 0, True

    def slopes(self, moved: Callable[[complex], Array], here: Callable[[], Array], step: float) -> Array:
        """Derivative of `moved`, the values after a move, with differences of this step; `here` has the values without."""
        self.n_calls += 1
        stepped = None
        if self.is_complex:
            try:
                stepped = moved(_STEP * 1j)
            except TypeError:
                self.is_complex = False
            else:
                self.is_complex = np.iscomplexobj(stepped)
        if stepped is not None and self.is_complex:
            stepped = stepped.imag / _STEP
            if self.n_calls & (self.n_calls - 1):
                return stepped
        up, down = moved(step), moved(-step)
        slope = (up - down) / (2 * step)
        if self.is_complex and stepped is not None:
            sides = np.stack([slope, (up - here()) / step, (here() - down) / step])
            size = max(np.abs(slope).max(initial=0.0), np.abs(stepped).max(initial=0.0))
            differs = ~(np.abs(sides - stepped).min(axis=0) <= 1e-3 * size)
            if np.mean(differs) > 0.125:  # as of the cube of a motion at rest, whose differences are nothing but their error
                longer = (moved(2 * step) - moved(-2 * step)) / (4 * step)
                differs &= ~(np.abs(slope - stepped) <= np.abs(longer - slope))
            self.is_complex = bool(np.mean(differs) <= 0.125)
            if self.is_complex:
                return stepped
        return slope
