"""Laws of one's own: functions of Python for all samples at once, or compiled ones (Numba, ctypes, scipy.LowLevelCallable)."""

from __future__ import annotations

import ctypes
import inspect
import itertools
import threading
import weakref
from collections.abc import Callable

import numpy as np

from nhbm.errors import ModelError

API = 2  # NHBM_USER_LAW_API_2
_ANY_NUMBER = -1
_FATAL = -1
_STEP = 1e-30  # of the complex step
_DIFFERENCE = np.finfo(float).eps ** (1 / 3)  # of central differences, relative to the largest sample

_numbers = itertools.count(1)
_state = threading.local()  # of this thread: the fault of a law that was called, and how many run


class LawInfo(ctypes.Structure):
    """nhbm_law_info_t"""

    _fields_ = [
        ("api_version", ctypes.c_int),
        ("n_coordinates", ctypes.c_int),
        ("n_parameters", ctypes.c_int),
        ("needs_velocity", ctypes.c_int),
        ("degree", ctypes.c_int),
        ("length_scale", ctypes.c_double),
        ("context", ctypes.c_void_p),
    ]


class LawSamples(ctypes.Structure):
    """nhbm_law_samples_t, what a compiled law gets a pointer to."""

    _fields_ = [
        ("n_samples", ctypes.c_int),
        ("n_coordinates", ctypes.c_int),
        ("stride", ctypes.c_int),
        ("n_parameters", ctypes.c_int),
        ("z", ctypes.c_void_p),
        ("v", ctypes.c_void_p),
        ("parameters", ctypes.c_void_p),
        ("f", ctypes.c_void_p),
        ("df_dz", ctypes.c_void_p),
        ("df_dv", ctypes.c_void_p),
        ("context", ctypes.c_void_p),
    ]


EVALUATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(LawSamples))


class Law:
    """A law that models of this process may use: model.law(law, "x1").

    `function` has the arguments q, v and p, or the first one or two of them: displacements [m], velocities [m/s] and the parameters of the
    input, each an array of all samples, (n_samples) with one coordinate, (n_samples, n_coordinates) with several. It returns the forces
    [N] of the same shape, positive where they pull back, or a tuple of them and their derivatives by q (and v), with a further axis for the
    coordinate differentiated by where there are several. Without derivatives these come from complex steps where the function takes
    complex samples, else from central differences.

    A compiled function instead takes a pointer to LawSamples (nhbm_user_law.h): a ctypes pointer, a Numba cfunc, a
    scipy.LowLevelCallable; `velocity` says then whether it needs velocities.
    """

    def __init__(self, function, *, velocity: bool | None = None, degree: int = 0, length_scale: float = 0.0, odd: bool = False):
        self.function, self.odd = function, odd
        self.__name__ = getattr(function, "__name__", type(function).__name__)
        self._options = {"velocity": velocity, "degree": degree, "length_scale": length_scale, "odd": odd}
        address = _address(function)
        if address is None:
            self._n_arguments = _n_arguments(function)
            needs_velocity = self._n_arguments > 1 if velocity is None else velocity
            self._pointer = EVALUATE(_caller(function, self._n_arguments, needs_velocity))
        else:
            needs_velocity = bool(velocity)
            self._pointer = EVALUATE(address)
        self.name = f"{self.__name__}_{next(_numbers)}".replace("<lambda>", "law")
        info = LawInfo(API, _ANY_NUMBER, _ANY_NUMBER, needs_velocity, degree, length_scale, None)
        _give(self.name, info, self._pointer)
        weakref.finalize(self, _forget, self.name)

    def __call__(self, *arguments):
        return self.function(*arguments)

    def __reduce__(self):
        return _again, (self.function, self._options)


def law(function=None, **options):
    """Decorator that makes a Law of a function: @nhbm.law, or @nhbm.law(odd=True); the options are those of Law."""
    return (lambda f: Law(f, **options)) if function is None else Law(function, **options)


def take_fault() -> BaseException | None:
    """What a law has raised since this was asked last, in this thread."""
    fault, _state.fault = getattr(_state, "fault", None), None
    return fault


def is_running() -> bool:
    """Whether a function of Python is being called by the library, in this thread."""
    return getattr(_state, "running", False)


def _again(function, options) -> Law:
    return Law(function, **options)


def _give(name, info, pointer) -> None:
    from nhbm.session import library

    if library().nhbm_give_law(name.encode(), ctypes.byref(info), pointer):
        raise ModelError(f"law '{name}' could not be given to the library")


def _forget(name) -> None:
    from nhbm.session import library

    library().nhbm_forget_law(name.encode())


def _address(function) -> int | None:
    """Address of a compiled function, None for one of Python."""
    if type(function).__module__.startswith("scipy") and hasattr(function, "function"):  # scipy.LowLevelCallable
        function = function.function
    if hasattr(function, "address") and isinstance(function.address, int):  # Numba
        return function.address
    if isinstance(function, ctypes._CFuncPtr):
        return ctypes.cast(function, ctypes.c_void_p).value
    return None


def _n_arguments(function) -> int:
    try:
        n = sum(p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
                for p in inspect.signature(function).parameters.values())  # fmt: skip
    except (TypeError, ValueError):
        n = 0
    if n not in (1, 2, 3):
        raise ModelError(f"law '{function!r}' must take 1 to 3 arguments: displacements, velocities, parameters")
    return n


def _array(address, n_columns, block) -> np.ndarray:
    """Columns of samples as they stand in memory, (n_samples, n_columns)."""
    place = (ctypes.c_double * (block.stride * n_columns)).from_address(address)
    return np.frombuffer(place).reshape(n_columns, block.stride)[:, : block.n_samples].T


def _caller(function: Callable, n_arguments: int, needs_velocity: bool) -> Callable:
    """What the library calls: arrays instead of addresses, and faults kept until it has returned."""

    def call(pointer) -> int:
        if getattr(_state, "fault", None) is not None:  # it has failed before, and nobody has been told yet
            return _FATAL
        _state.running = True
        try:
            block = pointer.contents
            n = block.n_coordinates
            z = _array(block.z, n, block)
            v = _array(block.v, n, block) if block.v else np.zeros_like(z)
            p = np.frombuffer((ctypes.c_double * block.n_parameters).from_address(block.parameters)) if block.n_parameters else np.zeros(0)
            f, df_dz, df_dv = _evaluate(function, n_arguments, needs_velocity, (z, v, p), bool(block.df_dz))
            _array(block.f, n, block)[:] = f
            for place, values in ((block.df_dz, df_dz), (block.df_dv, df_dv)):
                if place:
                    _array(place, n * n, block)[:] = values.transpose(0, 2, 1).reshape(-1, n * n)
            return 0
        except BaseException as fault:
            _state.fault = fault
            return _FATAL
        finally:
            _state.running = False

    return call


def _evaluate(function, n_arguments, needs_velocity, samples, with_derivatives):
    """Forces (n_samples, n) and derivatives (n_samples, n, n), which are None where nobody asks."""
    z, v, p = samples
    n = z.shape[1]

    def ask(z, v):
        arguments = (z[:, 0], v[:, 0], p) if n == 1 else (z, v, p)
        return function(*arguments[:n_arguments])

    answer = ask(z, v)
    given = answer if isinstance(answer, tuple) else (answer,)
    f = _shaped(function, "forces", given[0], z.shape, n)
    if not with_derivatives:
        return f, None, None
    if len(given) > 1:
        parts = [_shaped(function, "derivatives", part, (*z.shape, n), n) for part in given[1:3]]
        if needs_velocity and len(parts) == 1:
            raise ModelError(f"law '{function.__name__}' gives derivatives by displacements but not by velocities")
        return f, parts[0], parts[1] if len(parts) > 1 else None
    by_z = np.stack([_slope(lambda d, c=c: ask(_moved(z, c, d), v), z[:, c], z.shape) for c in range(n)], axis=2)
    by_v = None
    if needs_velocity:
        by_v = np.stack([_slope(lambda d, c=c: ask(z, _moved(v, c, d)), v[:, c], z.shape) for c in range(n)], axis=2)
    return f, by_z, by_v


def _shaped(function, what, values, shape, n) -> np.ndarray:
    """Values as an array of that shape; raises ModelError that names the law where they are not."""
    values = np.asarray(values, dtype=float)
    wanted = (shape[0],) if n == 1 else shape
    if values.shape != wanted and values.shape != ():
        raise ModelError(f"law '{function.__name__}' gives {what} of shape {values.shape}, expected {wanted}")
    return np.broadcast_to(values, wanted).reshape(shape)


def _moved(samples, c, by) -> np.ndarray:
    moved = samples.astype(np.result_type(samples, by))
    moved[:, c] += by
    return moved


def _slope(along, values, shape) -> np.ndarray:
    """Derivative of forces by one coordinate: a complex step where the function follows it, else central differences."""
    try:
        stepped = along(_STEP * 1j)
        if np.iscomplexobj(stepped):
            return (np.imag(stepped) / _STEP).reshape(shape)
    except TypeError:
        pass
    step = _DIFFERENCE * (np.abs(values).max() or 1.0)
    return ((np.asarray(along(step), dtype=float) - np.asarray(along(-step), dtype=float)) / (2 * step)).reshape(shape)
