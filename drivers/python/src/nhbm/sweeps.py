"""Sweeps of a model over a grid of values, by workers, an executor or the ranks of a communicator."""

from __future__ import annotations

import contextlib
import copy
import itertools
import math
import os
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from nhbm import advice, dataset
from nhbm.docstrings import documented
from nhbm.errors import Implausible, Jump, ModelError, NotConverged
from nhbm.groups import Group, Settings, request
from nhbm.paths import identifier, path_of
from nhbm.responses import absence_of, is_pattern, matches, parts_of, reject_largest, response_of, words_of
from nhbm.rows import Rows
from nhbm.schema import SOLVED
from nhbm.values import as_input, plain

if TYPE_CHECKING:
    from typing_extensions import Self

    from nhbm.model import Model
    from nhbm.session import Session

_MOST_POINTS = 10_000_000  # whose values and results are lists in memory


@documented
def sweep(self: Model, values: Mapping[str, Any], *, paired: bool = False, of: str | Callable[[Model], object] | None = None,
          tolerance: float | None = None, order: int | None = None, warm: bool | None = None,
          workers: int = 1, executor: Any = None, comm: Any = None, progress: Any = False) -> xr.Dataset:  # fmt: skip
    """Solves the points of a grid of values, with the motions of `nhbm solve` for the same groups &sweep.

    Points that start from each other form a chain (docs/user/input.md); chains are distributed over `workers`, an `executor`, or
    the ranks of `comm`.

    Parameters
    ----------
    values : dict
        Values by path, ``{"wall.gap": [...], "tones[0]": [...]}``; the last one varies fastest.
    paired : bool
        The first values of all paths form a point, the second values the next, as for random samples.
    of : str or function, optional
        Stores numbers instead of motions: a response ("x1 (1)"; "x* (1)" is the largest of all that match), or a function of the
        model that returns a number or a mapping of numbers, such as ``functools.partial(nhbm.Model.peak, of="x1", ...)``. It gets
        a model without a last motion,
        so that the numbers of a point do not depend on other points; with ``warm=True`` that of the point before.
    {tolerance and order}
    warm : bool, optional
        Whether points start from the previous ones along the last path; by default as `&solver first_guess` says, which is 'auto':
        if that path has eight points or more that are monotonic, and there is a law.
    workers : int
        Processes.
    executor : object, optional
        An executor with `map`: concurrent.futures, mpi4py.futures, or a Dask client by its `get_executor()`.
    comm : mpi4py.MPI.Comm, optional
        Communicator; each rank gets the complete dataset.
    progress : bool or function
        True: a progress bar of tqdm; a function is called with the number of points done.

    Returns
    -------
    xarray.Dataset
        As for `solve`, with the dimension `point`; `status` and `message` report failed points. With `of`: `response`, or what
        the function returns, NaN where it failed, and `status` and `message` of the last solution of each point. An
        exception in the function is raised at the first point; later points then have the status `failed`.

    Warns
    -----
    Jump
        Neighbouring points belong to different branches, which `dataset.nhbm.details["branch"]` numbers.
    NotConverged, Implausible
        As for `solve`, once for all points.
    """
    reject_largest(of)
    if not isinstance(values, Mapping):
        raise ModelError(f"the values of a sweep are a dict of lists by path, {{'wall.gap': [1e-3, 2e-3]}}, not {values!r}")
    if isinstance(workers, bool) or not isinstance(workers, (int, np.integer)) or workers < 1:
        raise ModelError(f"workers must be a whole number, 1 or more, not {workers!r}")
    for name, given, method in (("executor", executor, "map"), ("comm", comm, "Get_size")):
        if given is not None and not hasattr(given, method):
            raise ModelError(f"{name} must have the method `{method}`, as those of {_MAKERS[name]}, not {given!r}")
    grid = {self._resolved(path): _line_of(path, line) for path, line in values.items()}
    empty = [path for path, line in values.items() if not _line_of(path, line)]
    if not grid or empty:
        raise ModelError(f"'{empty[0]}' has no values" if empty else "a sweep needs a path with values, {'wall.gap': [1e-3, 2e-3]}")
    if len(grid) < len(values):
        raise ModelError(f"two paths of a sweep name the same value: {', '.join(values)}")
    for path, line in grid.items():
        self._check_value(path, path_of(path), line)
        if not (paired or warm) and len(set(line)) < len(line):  # otherwise samples, or a way up and down
            twice = next(value for value in line if line.count(value) > 1)
            advice.warn(advice.on("value_given_again", path, str(twice), values=[line.count(twice)]).text, Implausible)
    if paired and len(set(map(len, grid.values()))) > 1:
        raise ModelError("paired values must be as many for each path: " + ", ".join(f"{p}: {len(v)}" for p, v in grid.items()))
    n_points = math.prod(len(line) for line in grid.values())
    if n_points > _MOST_POINTS and not paired:
        raise ModelError(f"{n_points:,} points: a sweep in memory has at most {_MOST_POINTS:,}; the command writes larger ones to "
                         "a file, by model.to_file(path), and add a group &sweep for each path")  # fmt: skip
    points = list(zip(*grid.values()) if paired else itertools.product(*grid.values()))
    model = copy.copy(self)  # keeps its values
    settings = request(tolerance, order)
    given = [path for path in grid for at in [path_of(path)] if at.group in settings and at.key in (settings[at.group] or [at.key])]
    if given:
        raise ModelError(f"'{given[0]}' is swept, and given as an argument: leave one of them out")
    model._ready(settings)
    for path, value in zip(grid, points[0]):
        model[path] = value  # what is wrong is raised here, not by a worker
    advice.warn_of_model(model._ready(settings), self._warned)
    names = [identifier(path) for path in grid]
    coordinates = {
        name: ([point[k] for point in points], model._described(path)) for k, (name, path) in enumerate(zip(names, grid))
    }
    length = len(points) if paired else len(list(grid.values())[-1])
    if callable(of):
        work: _Work = _Function(model, list(grid), of, settings, bool(warm), points)
        n, per_piece = len(points), length if warm else 1
    else:
        chains = _Chains(model, grid, paired, of, settings, warm)
        work, n, per_piece = chains, chains.begin(), 1
    if comm is None and not (callable(of) and warm):  # fewer, larger pieces of work
        per_piece = max(1, n // (8 * workers)) if workers > 1 or executor else n
    pieces = [range(k, min(k + per_piece, n)) for k in range(0, n, per_piece)]
    with Progress(progress, "sweep", len(points)) as bar:
        done = list(_spread(work, pieces, workers, executor, comm, bar))
    doubtful = [doubt for part in done for doubt in part.doubtful]
    inactive = set.intersection(*([part.inactive for part in done if part.inactive is not None] or [set()]))
    if any(status not in SOLVED for status, _ in doubtful):  # a motion that was not found may have been prevented by a law
        inactive = set()
    if of is None:
        rows = Rows.joined([part.rows for part in done])
        chains.session.number_branches(rows)
        source = model._source(chains.session, rows)
        found = dataset.result_of(dataset.columns_of(rows, True), source, coordinates, {"varies": names, **model._attributes()})
    else:
        found = dataset.table([row for part in done for row in part.rows], coordinates).assign_attrs(varies=names)
    if isinstance(of, str):
        found["response"].attrs.update(long_name=words_of(of), units=_unit_of(chains.session, of))
    for category, text in dict.fromkeys(one for part in done for one in part.warned):
        advice.warn(text, category)
    advice.warn_of_points(doubtful, len(points))
    advice.warn_of_inactive_laws(sorted(inactive))
    if of is None:
        advice.warn_of_jumps(rows.values["branch"].tolist(), length, lambda k: _place_of(grid, points[k]), rows.messages)
    return found


def _place_of(paths: Iterable[str], values: Iterable[Any]) -> str:
    """The values of a point, in words."""
    texts = [f"{value:.7g}" if isinstance(value, float) else str(value) for value in values]
    return ", ".join(f"{path} = {text}" for path, text in zip(paths, texts))


_MAKERS = {"executor": "concurrent.futures", "comm": "mpi4py.MPI"}


def _line_of(path: str, line: Any) -> list[Any]:
    """The values of one path; ModelError if they are no list."""
    if isinstance(line, (set, frozenset, dict)):
        raise ModelError(f"'{path}': the values of a sweep are a list of numbers, in their order, not a {type(line).__name__}")
    if np.ndim(line) > 1:
        raise ModelError(f"'{path}': the values of a sweep are a list of numbers, not an array of {np.ndim(line)} dimensions")
    return list(np.atleast_1d(list(np.atleast_1d(line))))


def _unit_of(session: Any, of: str) -> str:
    """Unit of a response."""
    column = session.column("coefficients")
    units = str(column.attributes().get("dof_units", "")).split() if column.values is not None else []
    labels = session.labels("dof")
    dof = session.dofs_of_sets.get(parts_of(of)[0], parts_of(of)[0])
    dof = matches(dof, labels)[0] if is_pattern(dof) else dof
    return units[labels.index(dof)] if dof in labels and len(units) == len(labels) else "m"


_Warned = dict[tuple[type[Warning], str], None]  # each once, in its order


class _Part(NamedTuple):
    """What comes of a line of points."""

    rows: Any  # Rows of motions, or a list of mappings of numbers
    doubtful: list[tuple[str, list[advice.Advice]]]  # status, and what is doubtful
    inactive: set[advice.Advice] | None  # laws without force on all motions
    warned: _Warned  # what a function has warned of


class _Work:
    """Solves some pieces of a sweep; a value that processes can be sent."""

    model: Model

    def __init__(self) -> None:
        self.thread = threading.get_ident()

    def __call__(self, piece: range, update: Callable[[], None] | None = None) -> _Part:
        """The results of a piece; `update` is called after each of its points."""
        is_mine = threading.get_ident() == self.thread
        work = self if is_mine else self._copied()  # a model belongs to one thread
        return work._solved(piece, update or (lambda: None))

    def _copied(self) -> Self:
        other = copy.copy(self)
        other.model, other.thread = copy.copy(self.model), threading.get_ident()
        return other

    def _solved(self, piece: range, update: Callable[[], None]) -> _Part:
        raise NotImplementedError


class _Chains(_Work):
    """The chains of a sweep that the library solves."""

    def __init__(self, model: Model, grid: Mapping[str, list[Any]], paired: bool, of: str | None, settings: Settings,
                 warm: bool | None) -> None:  # fmt: skip
        super().__init__()
        self.model, self.of, self.settings = model, of, settings
        self.groups = [Group("sweep", {"axis": 1 if paired else axis, "parameter": path, **_values_of(line)})
                       for axis, (path, line) in enumerate(grid.items(), start=1)]  # fmt: skip
        if warm is not None:
            self.settings = {**settings, "solver": {"first_guess": "neighbour" if warm else "linear"}}
        self._session: Session | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_session": None}

    @property
    def session(self) -> Session:
        """The session of this process, in which the sweep has begun."""
        if self._session is None:
            self.begin()
        assert self._session is not None
        return self._session

    def begin(self) -> int:
        """Begins the sweep; returns the number of chains."""
        self._session = self.model._ready(self.settings, *self.groups)
        return self._session.begin_sweep(self.of is None and self.model._sharing(1) > 0)

    def _copied(self) -> Self:
        other = super()._copied()
        other._session = None
        return other

    def _solved(self, piece: range, update: Callable[[], None]) -> _Part:
        session, part = self.session, _Part([], [], None, {})
        session.clear_rows()
        session.select_chains(piece.start, len(piece))
        is_found = False
        while session.next_of_sweep():
            found, status = advice.on_motion(session), session.status
            if self.of is None:
                session.add_row()
            else:
                response = response_of(session, self.of) if status in SOLVED else float("nan")
                if status in SOLVED and response != response:
                    found = [advice.Advice("", "", absence_of(session, self.of))]
                part.rows.append({"response": response, "status": status, "message": session.message})
            if found:
                part.doubtful.append((status, found))
            is_found = is_found or status in SOLVED
            update()
        rows = session.rows() if self.of is None else part.rows
        return part._replace(rows=rows, inactive=set(session.advice("laws")) if is_found else None)


def _values_of(line: list[Any]) -> dict[str, Any]:
    """Keys of &sweep for the values of a path."""
    values = plain(line)
    if any(isinstance(value, (bool, str)) or hasattr(value, "input_name") for value in values):
        return {"texts": [value if isinstance(value, str) else as_input(value) for value in values]}
    return {"values": values}


class _Function(_Work):
    """A function of the model at each point."""

    def __init__(self, model: Model, paths: list[str], of: Any, settings: Settings, warm: bool, points: list[Any]) -> None:
        super().__init__()
        self.model, self.paths, self.of, self.settings, self.warm, self.points = model, paths, of, settings, warm, points

    def _solved(self, piece: range, update: Callable[[], None]) -> _Part:
        part = _Part([], [], None, {})
        for row, doubt in self._evaluated(self.model, [self.points[k] for k in piece], part.warned):
            part.rows.append(row)
            if doubt is not None:
                part.doubtful.append(doubt)
            update()
        return part

    def _evaluated(self, model: Model, points: list[Any], warned: _Warned) -> Iterator[tuple[Any, Any]]:
        for k, point in enumerate(points):
            if not (self.warm and k > 0):  # it may start from the last motion, of whichever point
                model = copy.copy(self.model)
            for path, value in zip(self.paths, point):
                model[path] = value
            yield self._value(model, point, warned)

    def _value(self, model: Model, point: Any, warned: _Warned) -> tuple[dict[str, Any], Any]:
        """What the function returns, with the status of its last solution; 'failed' where it raises an exception."""
        try:
            with _heard(warned):
                row = dataset.row_of(self.of(model))
        except Exception as fault:
            if point == self.points[0]:
                raise
            text = f"{type(fault).__name__}: {fault}"
            return {"status": "failed", "message": text}, ("failed", [advice.Advice("", "", text)])
        wrong = [value for value in row.values() if isinstance(value, (str, bytes)) or np.ndim(value) > 0 or value is None]
        if wrong:
            raise ModelError(f"the function `of` of a sweep returns a number or a dict of numbers, not {wrong[0]!r}")
        status, message, found = model._ending()
        return {**row, "status": status, "message": message}, (status, found) if found else None


@contextlib.contextmanager
def _heard(warned: _Warned) -> Iterator[None]:
    """Collects what nhbm warns of, for one warning for all points and processes; other warnings are issued as they are."""
    heard: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("ignore", NotConverged)  # one warning for all points, by their status
            for category in (Implausible, Jump):
                warnings.simplefilter("always", category)
            yield
    finally:
        for one in heard:
            if issubclass(one.category, (Implausible, Jump)):
                warned[one.category, str(one.message)] = None
            else:
                warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)


def _spread(work: _Work, lines: list[range], workers: int, executor: Any, comm: Any, bar: Progress) -> Iterable[_Part]:
    """What comes of all lines, in their order."""
    if comm is not None:
        mine = [(k, work(line)) for k, line in enumerate(lines) if k % comm.Get_size() == comm.Get_rank()]
        done = dict(itertools.chain.from_iterable(comm.allgather(mine)))
        yield from (done[k] for k in range(len(lines)))
        return
    if executor is None and workers > 1:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor
        from concurrent.futures.process import BrokenProcessPool

        text, others = _pickled(work), set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent)
        try:
            with _script_left_out(text):
                found = executor.map(work, lines)  # all processes start here
            yield from _counted(found, bar)
        except BrokenProcessPool as error:
            raise ModelError(
                "a process of the sweep has ended. A script whose own laws or functions are sent to processes is run by each of "
                'them: put its work below  if __name__ == "__main__":'
            ) from error
        except BaseException:  # an interrupt: what they compute is not waited for
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise
        finally:
            executor.shutdown(cancel_futures=True)
        return
    if executor is None:
        for line in lines:
            yield work(line, bar.update)
    else:
        yield from _counted(executor.map(work, lines), bar)


def _end_with_parent() -> None:
    """Lets this process end when its parent process does, even by SIGKILL; otherwise it would solve its points to the last."""
    threading.Thread(target=_wait_for_parent, name="nhbm parent", daemon=True).start()


def _wait_for_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _pickled(work: _Work) -> bytes:
    """What is sent to a process."""
    try:
        return pickle.dumps(work)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ModelError(
            f"the processes of `workers` cannot be sent something of this model: {error}. Define laws, and the function `of`, at "
            "the top level of a module or script, or leave `workers` out"
        ) from error


def _counted(found: Iterable[_Part], bar: Progress) -> Iterator[_Part]:
    for part in found:
        bar.update(len(part.rows))
        yield part


@contextlib.contextmanager
def _script_left_out(text: bytes) -> Iterator[None]:
    """Processes that start meanwhile do not run the script of the user anew, unless something of it is sent to them."""
    script = sys.modules["__main__"].__dict__
    if b"__main__" in text:
        yield
        return
    saved = {name: script.get(name) for name in ("__file__", "__spec__")}
    script.update(dict.fromkeys(saved))
    try:
        yield
    finally:
        script.update(saved)


class Progress:
    """A bar of tqdm, with a warning if it is not installed, or a function that gets the number of points done, and the misfit of a
    search that has one."""

    def __init__(self, wanted: Any, what: str, total: int | None = None, unit: str = "point") -> None:
        self._wanted, self._what, self._total, self._unit, self._n = wanted, what, total, unit, 0
        self._bar: Any = None
        if not (wanted is None or isinstance(wanted, bool) or callable(wanted)):
            raise ModelError(f"progress must be True, False or a function of the number of points, not {wanted!r}")

    def __enter__(self) -> Progress:
        if self._wanted is True:
            try:
                from tqdm.auto import tqdm

                self._bar = tqdm(total=self._total, desc=self._what, unit=self._unit)
            except ImportError:
                advice.warn(advice.on("no_progress_bar").text, UserWarning)
        return self

    def update(self, n: int = 1, misfit: float | None = None) -> None:
        self._n += n
        if self._bar is not None:
            self._bar.update(n)
            if misfit is not None:
                self._bar.set_postfix_str(f"misfit {misfit:.3g}")
        elif callable(self._wanted):
            self._wanted(self._n, *([] if misfit is None else [misfit]))

    def reach(self, n: int, total: int) -> None:
        """Of work whose length is known: a function gets both numbers."""
        if self._bar is not None:
            self._bar.total = total
            self._bar.update(n - self._bar.n)
        elif callable(self._wanted):
            self._wanted(n, total)

    def __exit__(self, *fault: Any) -> None:
        if self._bar is not None:
            self._bar.close()
