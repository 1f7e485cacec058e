"""The shared library in process (nhbm.h, ctypes): a session reads an input, is given other values, and is solved again and
again."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import math
import signal
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from nhbm import laws
from nhbm._library import (
    INTERRUPT_CALLBACK,
    INVALID_ARGUMENT,
    MAX_AXES,
    PROGRESS_CALLBACK,
    STRUCTURE_CALLBACK,
    Census,
    CensusMotion,
    ColumnDescription,
    Motion,
    Sweep,
    Table,
    TableColumn,
    last_error,
    library,
    raise_error,
    real_numbers,
    whole_numbers,
)
from nhbm._library import Column as _Column
from nhbm.errors import ModelError
from nhbm.keys import repeated_groups
from nhbm.rows import ColumnInfo, Layout, Rows
from nhbm.schema import Advice
from nhbm.structure import Structure, dofs_of_sets
from nhbm.values import flat, plain

if TYPE_CHECKING:
    from nhbm.groups import Group

try:  # the functions of `signal` look each handler up among its enumerations, which takes a third of a small solution
    from _signal import getsignal as _getsignal  # type: ignore[import-not-found, unused-ignore]
    from _signal import signal as _signal
except ImportError:
    from signal import getsignal as _getsignal
    from signal import signal as _signal

_MAIN_THREAD, _SIGINT = threading.main_thread().ident, int(signal.SIGINT)
_WORDS: dict[str, list[str]] = {}  # names of the numbers in columns, of the library, from the first use on
_HUGE = 2**31 - 1
_KINDS: dict[int, Any] = {0: np.dtype(np.float64), 1: np.dtype(np.int32)}


_COLUMNS: dict[Any, ColumnInfo] = {}  # of all models, by what the library says about them
_LAYOUTS: dict[Any, Layout] = {}  # of the last models, likewise
_MOST_LAYOUTS = 50


def _shared_layout(columns: list[ColumnInfo], sizes: bytes, labels: dict[str, list[str]], dofs_of_sets: dict[str, str]) -> Layout:
    """The layout of these columns, which models with the same columns share, and with it the templates of their datasets."""
    words = tuple((axis, *names) for axis, names in labels.items())
    key = tuple(map(id, columns)), sizes, words, tuple(dofs_of_sets.items())
    found = _LAYOUTS.get(key)
    if found is None:
        if len(_LAYOUTS) >= _MOST_LAYOUTS:
            _LAYOUTS.clear()
        each = np.frombuffer(sizes, np.int32).reshape(len(columns), 1 + MAX_AXES).tolist()
        found = _LAYOUTS[key] = Layout(columns, each, labels, dofs_of_sets)
    return found


class _Interrupts:
    """Records Ctrl-C during a call of the library, which then returns soon, and calls the handler of Python after it."""

    def __init__(self) -> None:
        self.is_noted = False
        self._handlers: list[Any] = []  # before each call in progress; calls of the main thread alone have one

    def __enter__(self) -> None:
        if threading.get_ident() != _MAIN_THREAD:
            return
        handler, depth = _getsignal(_SIGINT), len(self._handlers)
        try:
            if depth == 0:
                self.is_noted = False
            self._handlers.append(handler)
            if callable(handler):
                _signal(_SIGINT, self._note)
        except BaseException:  # the interrupt came before it could be noted: without __exit__ this call would stay in progress
            del self._handlers[depth:]
            if callable(handler):
                _signal(_SIGINT, handler)
            raise

    def _note(self, number: int, frame: Any) -> None:
        self.is_noted = True
        if laws.is_running():  # one that never ends
            raise KeyboardInterrupt

    def __exit__(self, *error: Any) -> None:
        if threading.get_ident() != _MAIN_THREAD:
            return
        handler = self._handlers.pop()
        if not callable(handler):
            return
        _signal(_SIGINT, handler)
        if self.is_noted and not self._handlers:
            self.is_noted = False
            if error[0] is None:
                handler(_SIGINT, None)


@dataclass
class Column:
    """A column of the motion found last: its values, None where they are not known, with unit and names of its axes."""

    values: Any  # np.ndarray or None
    unit: str
    axes: tuple[str, ...]
    describe: Callable[[], dict[str, Any]] = dict

    def attributes(self) -> dict[str, Any]:
        """Attributes as in a file: units, long_name, the words of numbers."""
        return {"units": self.unit or "1", **self.describe()}


@dataclass
class _Held:
    """A group of the library: the group of Python that it is like, its handle, and the values that it has."""

    group: Group
    handle: int
    keys: dict[str, Any] = field(default_factory=dict)


def _identity(group: Group) -> Any:
    """What tells a group from others: its name if it occurs once."""
    return id(group) if group.name == "sweep" or group.name in repeated_groups() else group.name


class Session:
    """An input that is solved in this process. Raises ModelError with group, key and a suggestion for an invalid input.

    `structures(name)` returns the Structure for `&structure type = 'model', file = name`. A session can be used by one thread
    at a time: a call while another thread uses it, or from one of its laws, raises RuntimeError. The global interpreter lock is
    released during a solution."""

    def __init__(self, structures: Callable[[str], Structure] | None = None) -> None:
        self._library, self._handle = library(), ctypes.c_void_p()
        self._check(self._library.nhbm_create(ctypes.byref(self._handle)))
        self._interrupts = interrupts = _Interrupts()
        self._n_points = 1
        self.has_motion = False  # of the present input
        self.laws: list[laws.Law] = []  # that the library may call
        self.serial = 0  # counts changes of values, and computations
        self._held: dict[Any, _Held] = {}  # groups of the library
        self._folder, self._is_torn = "", False
        self.dofs_of_sets: dict[str, str] = {}  # "disk1.x" of a set of one node, and the label of its degree of freedom
        self._declaration: tuple[int, list[ColumnInfo], dict[str, list[str]]] = (-1, [], {})  # of the table of motions
        self._layouts: dict[bytes, Layout] = {}  # of this declaration
        self.places: dict[Any, Any] = {}  # of responses, for nhbm.responses
        self._numbers = ctypes.c_int(), ctypes.c_int()  # of the last outcome
        this: Any = weakref.ref(self)  # the library holds callbacks, which must not hold the session
        self._interrupt = INTERRUPT_CALLBACK(lambda context: int(interrupts.is_noted))
        self._call("set_interrupt_callback", self._interrupt, None)
        self._structures = structures or Structure.read
        self._fill = STRUCTURE_CALLBACK(lambda context, name, structure: this()._describe(name.decode(), structure))
        self._call("set_structure_callback", self._fill, None)

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._library.nhbm_destroy(ctypes.byref(self._handle))

    def read(self, text: str, name: str = "model") -> None:
        """Reads the text of an input, replacing the previous one; `name` is used in messages."""
        named = laws.laws_in(text)
        self.has_motion = False
        self.places.clear()
        self._is_torn = True  # `hold` replaces all of it
        self._call("read_input", text.encode(), name.encode())
        self.laws = named

    def hold(self, groups: Iterable[Group], folder: str = "") -> None:
        """Gives the library these groups: what differs from those that it has. The next computation reports invalid values.

        Files that groups name are relative to `folder`, which ends with a slash."""
        if folder != self._folder or self._is_torn:
            self._call("clear", folder.encode())
            self._held, self._folder = {}, folder
        self._is_torn = True  # by an error or an interrupt
        wanted = {_identity(group): group for group in groups}
        for key in [key for key in self._held if key not in wanted]:
            self._alter("remove_group", self._held.pop(key).handle)
        for key, group in wanted.items():
            held = self._held.get(key)
            if held is None:
                handle = ctypes.c_int()
                self._alter("add_group", group.name.encode(), ctypes.byref(handle))
                held = self._held[key] = _Held(group, handle.value)
            if held.keys != group.keys:
                self._update(held, group)
        self._is_torn = False

    def put(self, group: Group, key: str, value: Any) -> None:
        """Sets a value, "gap" or "frequency(2)", where it has already been set in the group."""
        held = self._held.get(_identity(group))
        if held is not None:
            self._set(held.handle, key, value)
            held.keys = dict(group.keys)

    def check(self, group: Group | None = None) -> None:
        """Raises what is wrong with the groups, or with one of them on the structure and the tones alone."""
        if group is None:
            self._call("check")
        else:
            self._call("check_group", self._held[_identity(group)].handle)

    def _update(self, held: _Held, group: Group) -> None:
        """Sets all keys of a group that differ."""
        gone = {key.partition("(")[0] for key in held.keys if key not in group.keys}
        for stem in gone:
            self._alter("set_reals", held.handle, stem.encode(), 0, real_numbers([]))
        for key in sorted(group.keys, key="type".__ne__):
            value = group.keys[key]
            if key not in held.keys or key.partition("(")[0] in gone or held.keys[key] != value:
                self._set(held.handle, key, value)
                if isinstance(value, laws.Law):
                    self.laws.append(value)
        held.group, held.keys = group, dict(group.keys)

    def _set(self, handle: int, key: str, value: Any) -> None:
        """Sets a key of a group to a number, text, truth or list of them."""
        if type(value) is float:
            self.serial += 1
            status = self._library.nhbm_set_real(self._handle, handle, key.encode(), value)
            if status:
                self._check(status)
            return
        values = flat(value)
        kinds = set(map(type, values))
        name, n = key.encode(), len(values)
        if kinds <= {bool}:
            self._alter("set_logicals", handle, name, n, whole_numbers(values))
        elif kinds <= {int} and all(-_HUGE <= one <= _HUGE for one in values):
            self._alter("set_integers", handle, name, n, whole_numbers(values))
        elif kinds <= {int, float}:
            self._alter("set_reals", handle, name, n, real_numbers(values))
        elif kinds.isdisjoint({bool, int, float}):
            words = [str(getattr(one, "input_name", one)).encode() for one in values]
            self._alter("set_texts", handle, name, n, (ctypes.c_char_p * n)(*words))
        else:
            for k, one in enumerate(values, start=1):
                self._set(handle, f"{key}({k})", one)

    def _alter(self, name: str, *arguments: Any) -> None:
        """Changes groups, or values that are not single numbers."""
        self.places.clear()
        self.serial += 1
        self._call(name, *arguments)

    def set(self, path: str, value: Any) -> None:
        """Sets the value at a path of the input, "law(stop)%gap": a number, text, truth or list of them."""
        self._set(*self.parameter(path), plain(value))

    def parameter(self, path: str) -> tuple[int, str]:
        """The group of a value, and its key; raises what is wrong with the path."""
        handle = ctypes.c_int()
        self._call("find_group", path.encode(), ctypes.byref(handle))
        return handle.value, path.rpartition("%")[2].strip()

    def set_parameter(self, parameter: tuple[int, str], value: float) -> None:
        """Sets such a value, in the unit of the input."""
        self._set(*parameter, float(value))

    def solve(self, warm: bool = False, points: int = 1) -> None:
        """Computes the motion with the current values, from the last one if `warm`.

        `points` share the time budget of a run for stability, half a second in all; 0: none beside their own share.
        """
        self._share(points)
        self.serial += 1
        with self._interrupts:
            self._check(self._library.nhbm_solve(self._handle, int(bool(warm))))
        self.has_motion = True

    def _share(self, points: int) -> None:
        """Sets how many points share the time for stability."""
        if points != self._n_points:
            self._call("set_point_count", points)
            self._n_points = points

    def begin_sweep(self, has_budget: bool = True) -> int:
        """Starts the sweep of the groups &sweep; returns the number of its chains. `has_budget`: its points have the time for
        stability that those of a run share."""
        self._share(int(has_budget))
        sweep = Sweep()
        self._alter("sweep_begin", ctypes.byref(sweep))
        return int(sweep.n_chains)

    def select_chains(self, first: int, n: int) -> None:
        """Chooses the chains whose points follow."""
        self._call("sweep_select", first, n)

    def next_of_sweep(self) -> bool:
        """Computes the next point of the sweep as the last motion; false after the last one."""
        has_point = ctypes.c_int()
        with self._interrupts:
            self._call("sweep_next", ctypes.byref(has_point))
        return bool(has_point.value)

    def number_branches(self, rows: Rows) -> None:
        """Numbers the branches of all points of the sweep, in their column `branch`."""
        values, n = rows.values, len(rows)
        motion = np.asarray(values.get("corrected_coefficients", np.zeros((n, 0))), float).reshape(n, -1)
        branch, n_tuples = np.array(values["branch"], np.int32), values["tuples"].shape[1]
        status, tuples = whole_numbers(values["status"]), whole_numbers(values["tuples"])
        self._call("sweep_number_branches", motion.shape[1], n_tuples, status, tuples, real_numbers(motion), whole_numbers(branch))
        values["branch"] = branch

    def begin_curve(self) -> None:
        """Starts the curve of the group &curve."""
        self._alter("curve_begin")

    def lengthen_curve(self, points: int) -> bool:
        """Gives a curve that has ended at its number of points more of them; false if the last one has not ended so."""
        try:
            self._call("curve_lengthen", points)
        except ModelError:
            return False
        if "curve" in self._held:
            self._held["curve"].keys["points"] = points
        return True

    def next(self) -> bool:
        """Computes the next point of the curve as the last motion; false after its end."""
        has_point = ctypes.c_int()
        with self._interrupts:
            self._call("curve_next", ctypes.byref(has_point))
        self.has_motion = self.has_motion or bool(has_point.value)
        return bool(has_point.value)

    def take_census(self, n_starts: int, seed: int, time_limit: float) -> Census:
        """Searches for all coexisting motions; `select` makes one of them the last motion."""
        census = Census()
        with self._interrupts:
            self._alter("take_census", n_starts, seed, time_limit, ctypes.byref(census))
        return census

    @contextlib.contextmanager
    def reporting(self, receive: Callable[[int, int], None]) -> Iterator[None]:
        """Calls `receive` with the steps done and planned, twenty times a second, during work within this context; what it raises
        is raised after that work."""
        faults: list[BaseException] = []

        def report(_: Any, progress: Any) -> None:
            try:
                if not faults and progress.contents.n_steps > 0:
                    receive(progress.contents.n_done, progress.contents.n_steps)
            except BaseException as fault:
                faults.append(fault)

        callback = PROGRESS_CALLBACK(report)
        self._call("set_progress_callback", callback, None)
        try:
            yield
        finally:
            self._call("set_progress_callback", PROGRESS_CALLBACK(0), None)
        if faults:
            raise faults[0]

    def select(self, index: int) -> CensusMotion:
        """Makes a motion of the census the last motion; returns how it was found."""
        found = CensusMotion()
        self._call("select_census_motion", index, ctypes.byref(found))
        self.has_motion = True
        return found

    def integrate(self) -> None:
        """Integrates the model in time with the settings of the group &integration; `time_column` returns the record."""
        with self._interrupts:
            self._alter("integrate")

    def limit_verification(self, seconds: float) -> None:
        """Processor time [s] after which a verification ends undecided; 0: no limit."""
        self._call("set_verification_time", seconds)

    def verify(self, n_periods: int = 0) -> None:
        """Verifies the last motion by time integration; `time_column` returns the verdict."""
        with self._interrupts:
            self._alter("verify", n_periods)

    def verify_motion(self, motion: Motion, n_periods: int = 0) -> None:
        """Verifies a motion of the model with its present values, which need not be the last one."""
        with self._interrupts:
            self._alter("verify_motion", ctypes.byref(motion), n_periods)

    def natural_frequencies(self) -> Any:
        """Natural frequencies of the structure [rad/s]; none for large or sparse ones."""
        n, address = ctypes.c_size_t(), ctypes.c_void_p()
        self._call("get_natural_frequencies", ctypes.byref(n), ctypes.byref(address))
        return np.frombuffer(ctypes.string_at(address, 8 * n.value)).copy() if n.value else np.zeros(0)

    def time_columns(self) -> list[str]:
        """Names of the results of the last `integrate` or `verify`."""
        return self._text("get_time_column_names").split()

    def time_column(self, name: str) -> Column:
        """A column of these results. Raises KeyError for an unknown name."""
        return self._column("get_time_column", name)

    def clear_rows(self) -> None:
        """Removes all motions from the table that `add_row` fills."""
        self._call("clear_table")

    def add_row(self) -> None:
        """Adds the last motion to the table of motions."""
        self._check(self._library.nhbm_add_row(self._handle))

    def rows(self) -> Rows:
        """The table of motions: a copy of all columns, one array each."""
        table = Table()
        self._call("get_table", ctypes.byref(table))
        if not table.n_rows:
            return Rows(Layout([], [], {}, {}), {}, [])
        layout, n = self._layout_of(table), table.n_rows
        if n == 1:  # all columns in one array
            whole = np.empty(layout.n_bytes // 8)
            self._call("copy_columns", 0, table.n_columns, whole.ctypes.data, layout.n_bytes)
            columns, offsets = layout.columns, layout.offsets
            values = {name: np.ndarray((1, *shape), columns[name].dtype, whole, offsets[name])
                      for name, shape in layout.shapes.items()}  # fmt: skip
        else:
            values = {}
            for k, column in enumerate(layout.columns.values()):
                if column.name in layout.shapes:
                    one = np.empty((n, *layout.shapes[column.name]), column.dtype)
                    self._call("copy_columns", k, 1, one.ctypes.data, -(-one.nbytes // 8) * 8)
                    values[column.name] = one
        messages = [self._row_message(k) for k in range(n)] if table.has_messages else [""] * n
        return Rows(layout, values, messages)

    def _row_message(self, row: int) -> str:
        return self._with_names(self._text("get_row_message", row))

    def _layout_of(self, table: Table) -> Layout:
        """The layout of the table of motions; what has not changed since the last one is not asked for again."""
        if table.declaration != self._declaration[0] or table.n_columns != len(self._declaration[1]):
            columns = [self._table_column(k) for k in range(table.n_columns)]
            axes = dict.fromkeys(axis for column in columns for axis in column.axes)
            labels = {axis: self._lines("get_table_labels", axis.encode()) for axis in axes if axis != "multiplier"}
            self._declaration, self._layouts = (table.declaration, columns, labels), {}
        sizes = ctypes.string_at(table.sizes, 4 * (1 + MAX_AXES) * table.n_columns)
        found = self._layouts.get(sizes)
        if found is None:
            _, columns, labels = self._declaration
            found = self._layouts[sizes] = _shared_layout(columns, sizes, labels, self.dofs_of_sets)
        return found

    def _table_column(self, number: int) -> ColumnInfo:
        found = TableColumn()
        self._call("describe_table_column", number, ctypes.byref(found))
        d = found.description
        key = (found.name, found.unit, found.axes, d.kind, d.long_name, d.dof_units, d.flag_meanings, d.lowest_flag, d.attributes)
        known = _COLUMNS.get(key)
        if known is None:
            attributes = {"units": found.unit.decode() or "1", **_attributes(d)}
            known = ColumnInfo(found.name.decode(), _KINDS[d.kind], tuple(found.axes.decode().split()), attributes)
            known = _COLUMNS.setdefault(key, known)
        return known

    @property
    def status(self) -> str:
        """Status of the last motion."""
        return self._outcome()[0]

    @property
    def reason(self) -> str:
        """What ended the search for it, where the next step depends on it."""
        return self._outcome()[1]

    @property
    def kind(self) -> str:
        """Kind of the last point of a curve."""
        return self._word("curve_kind", int(self.column("curve_kind").values))

    def _outcome(self) -> tuple[str, str]:
        status, reason = self._numbers
        self._call("get_outcome", status, reason)
        return self._word("status", status.value), self._word("reason", reason.value)

    def _word(self, column: str, number: int) -> str:
        """Name of a number in a column."""
        if column not in _WORDS:
            _WORDS[column] = self.words_of(column)
        return _WORDS[column][number]

    def columns(self) -> list[str]:
        """Names of all columns of its motions (docs/user/schema.md)."""
        return self._text("get_column_names").split()

    def labels(self, axis: str) -> list[str]:
        """Labels along the axes `dof`, `law_dof` and `law`."""
        return self._lines("get_labels", axis.encode())

    def _lines(self, function: str, *arguments: Any) -> list[str]:
        text = self._text(function, *arguments)
        return text.split("\n") if text else []

    def advice(self, about: str) -> list[Advice]:
        """What was found about the `model`, the last `motion` or the `laws` that exert no force on it, and what to do."""
        text = self._with_names(self._text("get_advice", ("model", "motion", "laws").index(about)))
        return [Advice(*line.split("\t")) for line in text.split("\n") if line]

    def describe_advice(self, name: str, values: Sequence[float] = (), words: Sequence[str] = ()) -> str:
        """The text of a row of the table of advice."""
        numbers = (ctypes.c_double * len(values))(*values)
        lines = "\n".join(word.replace("\n", " ") for word in words)
        return self._text("describe_advice", name.encode(), len(values), numbers, lines.encode())

    @property
    def message(self) -> str:
        """Reason for a failure of the last motion, or a note."""
        return self._with_names(self._text("get_message"))

    def _with_names(self, text: str) -> str:
        """A text with the names of laws in Python instead of those that the library calls."""
        for law in self.laws:
            text = text.replace(f"'{law.input_name}_evaluate'", f"'{law.__name__}'")
        return text

    def input(self, given: bool = False) -> str:
        """The complete input with all keys and their values, or the keys that are given alone."""
        return self._text("get_given_input" if given else "get_input")

    def libraries(self) -> str:
        """Files on which the model depends, with checksums, one per line."""
        return self._text("get_libraries")

    def column(self, name: str) -> Column:
        """A column of the last motion, by a name of the result file. Raises KeyError for an unknown name."""
        if name == "message":
            return Column(np.array(self.message), "1", (), lambda: {"long_name": "reason for a failure, and advice"})
        return self._column("get_column", name)

    def number(self, name: str) -> float:
        """A column of the last motion that is one number; NaN if it is not known."""
        values = self.column(name).values
        return float("nan") if values is None else float(values.item())

    def _text(self, function: str, *arguments: Any) -> str:
        text = ctypes.c_char_p()
        self._call(function, *arguments, ctypes.byref(text))
        return (text.value or b"").decode(errors="replace")

    def _column(self, function: str, name: str) -> Column:
        column = _Column()
        status = getattr(self._library, f"nhbm_{function}")(self._handle, name.encode(), ctypes.byref(column))
        if status == INVALID_ARGUMENT:
            raise KeyError(last_error())
        if status:
            raise_error(status)
        unit, axes = column.unit.decode(), tuple(column.axes.decode().split())
        described = functools.partial(self._describe_column, function.replace("get", "describe"), name)
        if column.kind not in _KINDS:
            return Column(None, unit, axes, described)
        kind, shape = _KINDS[column.kind], tuple(column.shape[: column.n_axes])
        size = math.prod(shape) * kind.itemsize
        values = np.frombuffer(ctypes.string_at(column.data, size), kind).reshape(shape) if size else np.zeros(shape, kind)
        return Column(values, unit, axes, described)

    def kind_of(self, name: str) -> Any:
        """The type of a column of motions, also if its values are not known."""
        found = ColumnDescription()
        self._call("describe_column", name.encode(), ctypes.byref(found))
        return _KINDS[found.kind]

    def words_of(self, name: str) -> list[str]:
        """Names of the numbers 0, 1, ... in a column of motions such as `status`, also if its values are not known."""
        return str(self._describe_column("describe_column", name).get("flag_meanings", "")).split()

    def _describe_column(self, function: str, name: str) -> dict[str, Any]:
        found = ColumnDescription()
        self._call(function, name.encode(), ctypes.byref(found))
        return _attributes(found)

    def _describe(self, name: str, builder: Any) -> int:
        """Hands a structure over to the library; what goes wrong in Python is raised again when the library has returned."""
        try:
            structure: Any = self._structures(name)
            names = ("set_dofs", "set_matrix", "add_load", "set_nodes", "set_coordinates", "add_node_set")
            functions = {name: getattr(self._library, f"nhbm_structure_{name}") for name in names}
            n = len(structure.labels)
            units = _words([unit or "1" for unit in structure.units])
            code = functions["set_dofs"](builder, _words(structure.labels), units, structure.up_to or 0.0)
            for kind, matrix in structure.matrices().items():
                matrix.sort_indices()
                parts = whole_numbers(matrix.indptr), whole_numbers(matrix.indices), real_numbers(matrix.data)
                code = code or functions["set_matrix"](builder, kind.encode(), n, len(parts[2]), *parts)
            for load, (dofs, values) in structure.loads.items():
                code = code or functions["add_load"](builder, load.encode(), len(dofs), whole_numbers(dofs), real_numbers(values))
            if structure.sets:
                nodes, n_nodes = whole_numbers(structure.dof_node), len(structure.node_numbers)
                directions = _words([word or "-" for word in structure.dof_direction])
                code = code or functions["set_nodes"](builder, n_nodes, n, nodes, directions)
                code = code or functions["set_coordinates"](builder, n_nodes, real_numbers(structure.coordinates))
            for set_name, members in structure.sets.items():
                code = code or functions["add_node_set"](builder, set_name.encode(), len(members), whole_numbers(members))
            self.dofs_of_sets.update(dofs_of_sets(structure))
            return int(code)
        except BaseException as fault:
            if isinstance(fault, ModelError):
                self._library.nhbm_structure_set_error(builder, str(fault).encode())
            else:
                laws.store_fault(fault)
            return 1

    def _call(self, name: str, *arguments: Any) -> None:
        self._check(getattr(self._library, f"nhbm_{name}")(self._handle, *arguments))

    def _check(self, status: int) -> None:
        """Raises what a law or a structure has raised while the library was at work, or the error that it describes."""
        fault = laws.pop_fault()
        if fault is not None:
            raise fault
        if status:
            raise_error(status)


def _attributes(found: ColumnDescription) -> dict[str, Any]:
    """Attributes of a column as in a file, besides its unit."""
    attributes: dict[str, Any] = {"long_name": found.long_name.decode()}
    if found.dof_units:
        attributes["dof_units"] = found.dof_units.decode()
    if found.flag_meanings:
        attributes["flag_meanings"] = found.flag_meanings.decode()
        n = len(attributes["flag_meanings"].split())
        attributes["flag_values"] = np.arange(found.lowest_flag, found.lowest_flag + n, dtype=np.int32)
    attributes.update(line.split(" = ", 1) for line in found.attributes.decode().splitlines())
    return attributes


def _words(words: list[str]) -> bytes:
    return " ".join(words).encode()
