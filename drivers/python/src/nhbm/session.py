"""The shared library in process (nhbm.h, ctypes): a session reads an input, is given other values, and is solved again and
again."""

from __future__ import annotations

import ctypes
import ctypes.util
import math
import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nhbm import laws
from nhbm.errors import ModelError
from nhbm.groups import as_input
from nhbm.structure import Structure

try:  # the functions of `signal` look each handler up among its enumerations, which takes a third of a small solution
    from _signal import getsignal as _getsignal  # type: ignore[import-not-found, unused-ignore]
    from _signal import signal as _signal
except ImportError:
    from signal import getsignal as _getsignal
    from signal import signal as _signal

API = 2
_MAIN_THREAD, _SIGINT = threading.main_thread().ident, int(signal.SIGINT)
_KINDS: dict[int, Any] = {0: np.dtype(np.float64), 1: np.dtype(np.int32)}
_CANCEL = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)
_FILL = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)


class _Error(ctypes.Structure):
    _fields_ = [("code", ctypes.c_int), ("text", ctypes.c_char * 2048)]


class _Column(ctypes.Structure):
    _fields_ = [
        ("data", ctypes.c_void_p),
        ("kind", ctypes.c_int),
        ("n_axes", ctypes.c_int),
        ("shape", ctypes.c_int64 * 4),
        ("unit", ctypes.c_char_p),
        ("axes", ctypes.c_char_p),
    ]


def _library_paths() -> Iterator[str]:
    """Where the shared library may be: NHBM_LIBRARY, beside this package, in the build of this checkout, in the folder `lib` of
    this installation, of the system."""
    if "NHBM_LIBRARY" in os.environ:
        yield os.environ["NHBM_LIBRARY"]
        return
    here = Path(__file__).resolve()
    for path in (here.parent / "libnhbm.so", *(parent / "build/release/lib/libnhbm.so" for parent in here.parents)):
        if path.is_file():
            yield str(path)
    for pattern in ("libnhbm.so", "*/libnhbm.so"):
        yield from map(str, here.parents[3].glob(pattern))
    found = ctypes.util.find_library("nhbm")
    if found:
        yield found


def _load() -> ctypes.CDLL:
    paths = list(_library_paths())
    if not paths:
        raise ModelError("libnhbm.so was not found; NHBM_LIBRARY may hold its path")
    library = ctypes.CDLL(paths[0])
    if library.nhbm_api() != API:
        raise ModelError(f"{paths[0]} has version {library.nhbm_api()} of the interface, this package needs {API}")
    text, number, pointer = ctypes.c_char_p, ctypes.c_int, ctypes.c_void_p
    error, handle = ctypes.POINTER(_Error), ctypes.POINTER(ctypes.c_void_p)
    for name, arguments in {
        "read": (pointer, text, text, error),
        "set_text": (pointer, text, text, error),
        "parameter": (pointer, text, ctypes.POINTER(number), error),
        "set": (pointer, number, ctypes.c_double, error),
        "solve": (pointer, number, error),
        "begin_curve": (pointer, error),
        "next": (pointer, ctypes.POINTER(number), error),
        "column_of": (pointer, text, ctypes.POINTER(_Column), error),
        "time_column_of": (pointer, text, ctypes.POINTER(_Column), error),
        "integrate": (pointer, error),
        "verify": (pointer, number, error),
        "ask": (pointer, _CANCEL, pointer, error),
    }.items():
        getattr(library, f"nhbm_{name}").argtypes = arguments
    for name, arguments in {
        "input": (pointer,),
        "column_names": (pointer,),
        "time_column_names": (pointer,),
        "labels": (pointer, text),
        "message": (pointer,),
    }.items():
        getattr(library, f"nhbm_{name}").argtypes = arguments
        getattr(library, f"nhbm_{name}").restype = text
    library.nhbm_version.restype = text
    library.nhbm_give_law.argtypes = (text, ctypes.POINTER(laws.LawInfo), laws.EVALUATE)
    library.nhbm_forget_law.argtypes = (text,)
    library.nhbm_forget_law.restype = None
    library.nhbm_new.restype = pointer
    library.nhbm_structures.argtypes = (pointer, _FILL, pointer)
    library.nhbm_structures.restype = None
    integers, reals = np.ctypeslib.ndpointer(np.int32, flags="C"), np.ctypeslib.ndpointer(np.float64, flags="C")
    for name, arguments in {
        "dofs": (text, text, ctypes.c_double),
        "matrix": (text, integers, integers, reals),
        "vector": (text, number, integers, reals),
        "nodes": (number, integers, text),
        "set": (text, number, integers),
        "refuse": (text,),
    }.items():
        getattr(library, f"nhbm_structure_{name}").argtypes = (pointer, *arguments)
    library.nhbm_points.argtypes = (pointer, number)
    library.nhbm_points.restype = None
    library.nhbm_delete.argtypes = (handle,)
    library.nhbm_delete.restype = None
    return library


_library: ctypes.CDLL | None = None


def library() -> ctypes.CDLL:
    """The shared library, loaded at the first call."""
    global _library
    if _library is None:
        _library = _load()
    return _library


class Key(NamedTuple):
    """A key of the input as the table of the program has it (docs/user/input.md)."""

    section: str  # a group, or a group and its type: "law", "law jenkins"
    name: str
    type: str
    unit: str
    default: str
    range: str
    meaning: str


def input_keys() -> list[Key]:
    """The table of input keys, in the order of the documentation.

    Returns
    -------
    list of Key
        With section, name, type, unit, default, range and meaning, as texts.

    Examples
    --------
    >>> import nhbm
    >>> next(key.unit for key in nhbm.input_keys() if (key.section, key.name) == ("law rigid_wall", "gap"))
    'm'
    """
    keys: list[Key] = []
    row = ctypes.create_string_buffer(1200)
    while library().nhbm_key(len(keys), row, len(row)):
        keys.append(Key(*row.value.decode().split(" | ")))
    return keys


class _Interrupts:
    """Records Ctrl-C during a call of the library, which then returns soon, and calls the handler of Python after it."""

    def __init__(self) -> None:
        self.is_noted = False
        self._handler: Any = None

    def __enter__(self) -> None:
        if threading.get_ident() == _MAIN_THREAD and callable(_getsignal(_SIGINT)):
            self._handler = _signal(_SIGINT, self._note)

    def _note(self, number: int, frame: Any) -> None:
        self.is_noted = True
        if laws.is_running():  # one that never ends
            raise KeyboardInterrupt

    def __exit__(self, *error: Any) -> None:
        handler, self._handler = self._handler, None
        if handler is None:
            return
        _signal(_SIGINT, handler)
        if self.is_noted:
            self.is_noted = False
            if error[0] is None:
                handler(_SIGINT, None)


@dataclass
class Column:
    """A column of the motion found last: its values, None where they are not known, with unit and names of its axes."""

    values: Any  # np.ndarray or None
    unit: str
    axes: tuple[str, ...]


class Session:
    """An input that is solved in this process. Raises ModelError with group, key and a suggestion for an invalid input.

    `structures(name)` returns the Structure for `&structure type = 'model', file = name`. A session may be used by one
    thread at a time; the global interpreter lock is released during a solution."""

    def __init__(self, structures: Callable[[str], Structure] | None = None) -> None:
        self._library, self._error = library(), _Error()
        self._handle, self._error_address = ctypes.c_void_p(self._library.nhbm_new()), ctypes.byref(self._error)
        self._interrupts = interrupts = _Interrupts()
        self._n_points = 1
        self._fault: BaseException | None = None
        self.dofs_of_sets: dict[str, str] = {}  # "disk1.x" of a set of one node, and the label of its degree of freedom
        self.empty: Any = None  # layout of a motion and a dataset without its values, for nhbm.dataset
        this: Any = weakref.ref(self)  # the library holds callbacks, which must not hold the session
        self._cancel = _CANCEL(lambda context: int(interrupts.is_noted))
        self._call("ask", self._cancel, None)
        self._structures = structures or Structure.read
        self._fill = _FILL(lambda context, name, structure: this()._describe(name.decode(), structure))
        library().nhbm_structures(self._handle, self._fill, None)

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            library().nhbm_delete(ctypes.byref(self._handle))

    def read(self, text: str, name: str = "model") -> None:
        """Reads the text of an input, replacing the previous one; `name` is used in messages."""
        self._call("read", text.encode(), name.encode())

    def set(self, path: str, value: Any) -> None:
        """Sets a key like --set of the command: numbers, texts, lists."""
        self._call("set_text", path.encode(), as_input(value).encode())

    def parameter(self, path: str) -> int:
        """Returns a handle for a number that is set repeatedly."""
        handle = ctypes.c_int()
        self._call("parameter", path.encode(), ctypes.byref(handle))
        return handle.value

    def set_parameter(self, handle: int, value: float) -> None:
        """Sets that number, in the unit of the input."""
        if self._library.nhbm_set(self._handle, handle, value, self._error_address):
            self._raise_errors(1)

    def solve(self, warm: bool = False, points: int = 1) -> None:
        """Computes the motion with the current values, from the last one if `warm`.

        `points` share the time budget of a run for stability, two seconds in all; 0: no stability.
        """
        if points != self._n_points:
            self._library.nhbm_points(self._handle, points)
            self._n_points = points
        with self._interrupts:
            code = self._library.nhbm_solve(self._handle, int(warm), self._error_address)
            self._raise_errors(code)

    def begin_curve(self) -> None:
        """Starts the curve of the group &curve."""
        self._call("begin_curve")

    def next(self) -> bool:
        """Computes the next point of the curve as the last motion; false after its end."""
        is_point = ctypes.c_int(1)
        with self._interrupts:
            self._call("next", ctypes.byref(is_point))
        return bool(is_point.value)

    def integrate(self) -> None:
        """Integrates the model in time with the settings of the group &integration; `time_column` returns the record."""
        with self._interrupts:
            self._call("integrate")

    def verify(self, n_periods: int = 0) -> None:
        """Verifies the last motion by time integration; `time_column` returns the verdict."""
        with self._interrupts:
            self._call("verify", n_periods)

    def time_columns(self) -> list[str]:
        """Names of the results of the last `integrate` or `verify`."""
        return _text(library().nhbm_time_column_names(self._handle)).split()

    def time_column(self, name: str) -> Column:
        """A column of these results. Raises KeyError for an unknown name."""
        return self._column(library().nhbm_time_column_of, name)

    def columns(self) -> list[str]:
        """Names of all columns of its motions (docs/user/schema.md)."""
        return _text(library().nhbm_column_names(self._handle)).split()

    def labels(self, axis: str) -> list[str]:
        """Labels along the axes `dof`, `law_dof` and `law`."""
        return _text(library().nhbm_labels(self._handle, axis.encode())).split()

    @property
    def message(self) -> str:
        """Reason for a failure of the last motion, or a note."""
        return _text(library().nhbm_message(self._handle))

    def input(self) -> str:
        """The complete input with all keys and their values."""
        return _text(library().nhbm_input(self._handle))

    def column(self, name: str) -> Column:
        """A column of the last motion, by a name of the result file. Raises KeyError for an unknown name."""
        if name == "message":
            return Column(np.array(self.message), "", ())
        return self._column(library().nhbm_column_of, name)

    def _column(self, column_of: Any, name: str) -> Column:
        column = _Column()
        if column_of(self._handle, name.encode(), ctypes.byref(column), ctypes.byref(self._error)):
            raise KeyError(self._error.text.decode())
        unit, axes = column.unit.decode(), tuple(column.axes.decode().split())
        if column.kind not in _KINDS:
            return Column(None, unit, axes)
        kind, shape = _KINDS[column.kind], tuple(column.shape[: column.n_axes])
        size = math.prod(shape) * kind.itemsize
        values = np.frombuffer(ctypes.string_at(column.data, size), kind).reshape(shape) if size else np.zeros(shape, kind)
        return Column(values, unit, axes)

    def _describe(self, name: str, builder: Any) -> int:
        """Hands a structure over to the library; what goes wrong in Python is raised again when the library has returned."""
        try:
            structure: Any = self._structures(name)
            give = {word: getattr(library(), f"nhbm_structure_{word}") for word in ("dofs", "matrix", "vector", "nodes", "set")}
            code = give["dofs"](builder, _words(structure.labels), _words(structure.units), structure.up_to or 0.0)
            for kind, matrix in structure.matrices().items():
                matrix.sort_indices()
                parts = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), np.ascontiguousarray(matrix.data, float)
                code = code or give["matrix"](builder, kind.encode(), *parts)
            for load, (dofs, values) in structure.loads.items():
                dofs, values = np.ascontiguousarray(dofs, np.int32), np.ascontiguousarray(values, float)
                code = code or give["vector"](builder, load.encode(), len(dofs), dofs, values)
            if structure.sets:
                nodes, n_nodes = np.ascontiguousarray(structure.dof_node, np.int32), len(structure.node_numbers)
                code = code or give["nodes"](builder, n_nodes, nodes, _words([word or "-" for word in structure.dof_direction]))
            for set_name, members in structure.sets.items():
                members = np.ascontiguousarray(members, np.int32)
                code = code or give["set"](builder, set_name.encode(), len(members), members)
                if len(members) == 1:
                    for dof in np.flatnonzero(structure.dof_node == members[0]):
                        self.dofs_of_sets[f"{set_name}.{structure.dof_direction[dof]}"] = structure.labels[dof]
            return int(code)
        except BaseException as fault:
            if isinstance(fault, ModelError):
                library().nhbm_structure_refuse(builder, str(fault).encode())
            else:
                self._fault = fault
            return 1

    def _call(self, name: str, *arguments: Any) -> None:
        self._raise_errors(getattr(self._library, f"nhbm_{name}")(self._handle, *arguments, self._error_address))

    def _raise_errors(self, code: int) -> None:
        """Raises what a law or a structure has raised while the library was at work, or the error that it describes."""
        fault, self._fault = self._fault or laws.pop_fault(), None
        if fault is not None:
            raise fault
        if code:
            raise ModelError(self._error.text.decode(errors="replace"))


def _text(words: bytes) -> str:
    return words.decode(errors="replace")


def _words(words: list[str]) -> bytes:
    return " ".join(words).encode()
