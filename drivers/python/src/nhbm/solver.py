"""nhbm in process: a model from an input, solved again and again with other values, by the shared library (nhbm.h, ctypes).

    model = Model.from_file("beam.nml")
    frequency = model.parameter("tones%frequency")
    for value in values:
        frequency.set(value)
        motion = model.solve(warm=True)
        print(motion.status, motion["coefficients"])

Numbers are those of the command to the last bit. A model belongs to one thread at a time; the interpreter's lock is released while it
is solved.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import signal
import threading
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nhbm.errors import ModelError

API = 1
_KINDS = {0: np.float64, 1: np.int32}
_ASK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


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


def _places() -> Iterator[str]:
    """Where the shared library may be: NHBM_LIBRARY, beside this package, in the build of this checkout, of the system."""
    if "NHBM_LIBRARY" in os.environ:
        yield os.environ["NHBM_LIBRARY"]
        return
    here = Path(__file__).resolve()
    for path in (here.parent / "libnhbm.so", *(parent / "build/release/lib/libnhbm.so" for parent in here.parents)):
        if path.is_file():
            yield str(path)
    found = ctypes.util.find_library("nhbm")
    if found:
        yield found


def _load() -> ctypes.CDLL:
    places = list(_places())
    if not places:
        raise ModelError("libnhbm.so was not found; NHBM_LIBRARY may hold its path")
    library = ctypes.CDLL(places[0])
    if library.nhbm_api() != API:
        raise ModelError(f"{places[0]} has version {library.nhbm_api()} of the interface, this package needs {API}")
    text, number, pointer = ctypes.c_char_p, ctypes.c_int, ctypes.c_void_p
    error, handle = ctypes.POINTER(_Error), ctypes.POINTER(ctypes.c_void_p)
    for name, arguments in {
        "read": (text, text, handle, error),
        "set_text": (pointer, text, text, error),
        "parameter": (pointer, text, ctypes.POINTER(number), error),
        "set": (pointer, number, ctypes.c_double, error),
        "solve": (pointer, number, error),
        "begin_curve": (pointer, error),
        "next": (pointer, ctypes.POINTER(number), error),
        "column_of": (pointer, text, ctypes.POINTER(_Column), error),
        "ask": (pointer, _ASK, pointer, error),
    }.items():
        getattr(library, f"nhbm_{name}").argtypes = arguments
    for name, arguments in {"input": (pointer,), "column_names": (pointer,), "labels": (pointer, text), "message": (pointer,)}.items():
        getattr(library, f"nhbm_{name}").argtypes = arguments
        getattr(library, f"nhbm_{name}").restype = text
    library.nhbm_version.restype = text
    library.nhbm_delete.argtypes = (handle,)
    library.nhbm_delete.restype = None
    return library


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
    """The table of input keys, in the order of the documentation."""
    row, keys = ctypes.create_string_buffer(1200), []
    while library().nhbm_key(len(keys), row, len(row)):
        keys.append(Key(*row.value.decode().split(" | ")))
    return keys


_library: ctypes.CDLL | None = None


def library() -> ctypes.CDLL:
    """The shared library, loaded at the first call."""
    global _library
    if _library is None:
        _library = _load()
    return _library


class _Interrupts:
    """Takes note of Ctrl-C while the library is at work, so that it ends soon, and has Python's handler do what it does then."""

    def __init__(self, model: Model):
        self._model = model

    def __enter__(self) -> None:
        self._handler = None
        if threading.current_thread() is threading.main_thread() and callable(signal.getsignal(signal.SIGINT)):
            self._handler = signal.signal(signal.SIGINT, self._note)

    def _note(self, number, frame) -> None:
        self._model._is_interrupted = True

    def __exit__(self, *error) -> None:
        if self._handler is None:
            return
        signal.signal(signal.SIGINT, self._handler)
        if self._model._is_interrupted:
            self._model._is_interrupted = False
            self._handler(signal.SIGINT, None)


class Motion:
    """What is known of a motion: columns by the names of the result file (docs/user/schema.md), as arrays of their own.

    Raises KeyError for a name that there is not; a column that is not known of this motion is None.
    """

    def __init__(self, model: Model):
        self._model, self._number = model, model._n_solved
        self._held: dict[str, np.ndarray | None] = {}

    def __getitem__(self, name: str) -> np.ndarray | None:
        if name not in self._held:
            if self._number != self._model._n_solved:
                raise ModelError(f"'{name}' was not asked for before the model was solved again; motion.keep() keeps all columns")
            self._held[name] = self._model._column(name)
        return self._held[name]

    def keep(self) -> Motion:
        """Reads all columns, so that the motion does not need the model any more."""
        for name in self._model.columns():
            self[name]
        return self

    @property
    def status(self) -> int:
        """1: converged; docs/user/schema.md names the others."""
        return int(self["status"])

    @property
    def is_converged(self) -> bool:
        return self.status == 1


class Parameter:
    """A number of a model, looked up once."""

    def __init__(self, model: Model, path: str):
        self._model, self.path, handle = model, path, ctypes.c_int()
        model._call("parameter", path.encode(), ctypes.byref(handle))
        self._handle = handle.value

    def set(self, value: float) -> None:
        """Sets the number, in the unit of the input."""
        self._model._call("set", self._handle, value)


class Model:
    """A model from the text of an input, solved in process.

    Raises ModelError with group, key and the right value where something is wrong.
    """

    def __init__(self, text: str, name: str = "model"):
        self._handle, self._error, self._n_solved = ctypes.c_void_p(), _Error(), 0
        self._is_interrupted = False
        if library().nhbm_read(text.encode(), name.encode(), ctypes.byref(self._handle), ctypes.byref(self._error)):
            raise ModelError(self._error.text.decode(errors="replace"))
        this = weakref.ref(self)  # the library holds the callback, which must not hold the model
        self._ask = _ASK(lambda context: int(this()._is_interrupted))
        self._call("ask", self._ask, None)

    @classmethod
    def from_file(cls, path: str | Path) -> Model:
        """The model of an input file."""
        return cls(Path(path).read_text(), str(path))

    def __del__(self):
        if getattr(self, "_handle", None):
            library().nhbm_delete(ctypes.byref(self._handle))

    def __setitem__(self, path: str, value) -> None:
        """Sets a key as the command's --set does: model["law(stop)%gap"] = 1e-3; texts and lists as well."""
        self._call("set_text", path.encode(), _as_input(value).encode())

    def parameter(self, path: str) -> Parameter:
        """A number that is to be set many times."""
        return Parameter(self, path)

    def solve(self, warm: bool = False) -> Motion:
        """The motion with the present values, from the last one where `warm`."""
        self._n_solved += 1
        with _Interrupts(self):
            self._call("solve", int(warm))
        return Motion(self)

    def curve(self) -> Iterator[Motion]:
        """The points of the curve of the group &curve, one by one."""
        self._call("begin_curve")
        is_point = ctypes.c_int(1)
        while True:
            self._n_solved += 1
            with _Interrupts(self):
                self._call("next", ctypes.byref(is_point))
            if not is_point.value:
                return
            yield Motion(self)

    def columns(self) -> list[str]:
        """Names of all columns of its motions."""
        return library().nhbm_column_names(self._handle).decode().split()

    def labels(self, axis: str) -> list[str]:
        """Labels along the axes `dof`, `law_dof` and `law`."""
        return library().nhbm_labels(self._handle, axis.encode()).decode().split()

    @property
    def message(self) -> str:
        """Why the motion found last was not found, or what to know of it."""
        return library().nhbm_message(self._handle).decode(errors="replace")

    def to_namelist(self) -> str:
        """The input with all keys that may be given and their values."""
        return library().nhbm_input(self._handle).decode()

    def _call(self, name: str, *arguments) -> None:
        if getattr(library(), f"nhbm_{name}")(self._handle, *arguments, ctypes.byref(self._error)):
            raise ModelError(self._error.text.decode(errors="replace"))

    def _column(self, name: str) -> np.ndarray | None:
        if name == "message":
            return np.array(self.message)
        column = _Column()
        if library().nhbm_column_of(self._handle, name.encode(), ctypes.byref(column), ctypes.byref(self._error)):
            raise KeyError(self._error.text.decode())
        if column.kind not in _KINDS:
            return None
        kind, shape = np.dtype(_KINDS[column.kind]), tuple(column.shape[: column.n_axes])
        size = int(np.prod(shape)) * kind.itemsize
        return np.frombuffer(ctypes.string_at(column.data, size), kind).reshape(shape) if size else np.zeros(shape, kind)


def _as_input(value) -> str:
    """A value, or a list of them, as an input has it."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(map(_as_input, value))
    if isinstance(value, (bool, np.bool_)):
        return ".true." if value else ".false."
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    return repr(int(value)) if isinstance(value, (int, np.integer)) else repr(float(value))
