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

from nhbm import dataset, doubts
from nhbm.docstrings import documented
from nhbm.errors import Implausible, ModelError, NotConverged
from nhbm.groups import Settings, request
from nhbm.paths import identifier, path_of
from nhbm.responses import absence_of, parts_of, refuse_largest, response_of, words_of
from nhbm.rows import Rows
from nhbm.schema import SOLVED
from nhbm.values import plain

if TYPE_CHECKING:
    from nhbm.model import Model

_MOST_POINTS = 10_000_000  # whose values and results are lists in memory


@documented
def sweep(self: Model, values: Mapping[str, Any], *, paired: bool = False, of: str | Callable[[Model], object] | None = None,
          tolerance: float | None = None, order: int | None = None, warm: bool = False,
          workers: int = 1, executor: Any = None, comm: Any = None, progress: Any = False) -> xr.Dataset:  # fmt: skip
    """Solves the points of a grid of values.

    Lines of the grid (points, if not `warm`) are distributed over `workers`, an `executor`, or the ranks of `comm`.

    Parameters
    ----------
    values : dict
        Values by path, ``{"wall.gap": [...], "tones[0]": [...]}``; the last one varies fastest.
    paired : bool
        The first values of all paths form a point, the second values the next, as for random samples.
    of : str or function, optional
        Stores numbers instead of motions: a response ("x1 (1)"), or a function of the model that returns a number or a
        mapping of numbers, such as ``functools.partial(nhbm.Model.peak, of="x1", ...)``. If not `warm`, it gets a model without
        a last motion, so that the numbers of a point do not depend on other points.
    {tolerance and order}
    warm : bool
        Start each point from the previous one along the last path.
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
    """
    refuse_largest(of)
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
            doubts.warn(f"'{path}': {twice} is given {line.count(twice)} times; the same points are solved again", Implausible)
    if paired and len(set(map(len, grid.values()))) > 1:
        raise ModelError("paired values must be as many for each path: " + ", ".join(f"{p}: {len(v)}" for p, v in grid.items()))
    n_points = math.prod(len(line) for line in grid.values())
    if n_points > _MOST_POINTS and not paired:
        raise ModelError(f"{n_points:,} points: a sweep in memory has at most {_MOST_POINTS:,}; the command writes larger ones to "
                         "a file, from model.to_namelist() and a group &sweep for each path")  # fmt: skip
    points = list(zip(*grid.values()) if paired else itertools.product(*grid.values()))
    model = copy.copy(self)  # keeps its values
    settings = request(tolerance, order)
    model._live(settings)
    for path, value in zip(grid, points[0]):
        model[path] = value  # what is wrong is raised here, not by a worker
    doubts.warn_of_model(model._live(settings).session, self._warned)
    length = len(points) if paired else len(list(grid.values())[-1])
    if not warm and comm is None:  # fewer, larger pieces of work
        length = max(1, len(points) // (8 * workers)) if workers > 1 or executor else len(points)
    elif not warm:
        length = 1
    lines = [points[k : k + length] for k in range(0, len(points), length)]
    work = _Line(model, list(grid), of, settings, warm, points)
    with Progress(progress, "sweep", len(points)) as bar:
        done = list(_spread(work, lines, workers, executor, comm, bar))
    doubtful = [doubt for part in done for doubt in part.doubtful]
    idle = set.intersection(*([part.idle for part in done if part.idle is not None] or [set()]))
    if any(status not in SOLVED for status, _ in doubtful):  # a motion that was not found may have been prevented by a law
        idle = set()
    names = [identifier(path) for path in grid]
    coordinates = {
        name: ([point[k] for point in points], model._described(path)) for k, (name, path) in enumerate(zip(names, grid))
    }
    if of is None:
        for path, value in zip(grid, points[0]):
            model[path] = value
        rows = Rows.joined([part.rows for part in done])
        source = model._source(model._live(settings).session, rows, grid, paired, warm)
        found = dataset.result_of(dataset.columns_of(rows, True), source, coordinates, {"varies": names, **model._attributes()})
    else:
        found = dataset.table([row for part in done for row in part.rows], coordinates).assign_attrs(varies=names)
    if isinstance(of, str):
        found["response"].attrs.update(long_name=words_of(of), units=_unit_of(model._live(settings).session, of))
    doubts.warn_of_points(doubtful, len(points))
    doubts.warn_of_idle_laws(sorted(idle))
    return found


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
    return units[labels.index(dof)] if dof in labels and len(units) == len(labels) else "m"


class _Part(NamedTuple):
    """What comes of a line of points."""

    rows: Any  # Rows of motions, or a list of mappings of numbers
    doubtful: list[tuple[str, str]]  # status, and what is doubtful
    idle: set[str] | None  # laws without force on all motions


class _Line:
    """Solves a line of points; a value that processes can be sent."""

    def __init__(self, model: Model, paths: list[str], of: Any, settings: Settings, warm: bool, points: list[Any]) -> None:
        self.model, self.paths, self.of, self.settings, self.warm = model, paths, of, settings, warm
        self.n, self.first = len(points), points[0]
        self.idle: set[str] | None = None  # laws without force on all motions so far; None: there is no motion yet
        self.thread = threading.get_ident()

    def __call__(self, points: list[Any], update: Callable[[], None] | None = None) -> _Part:
        """The results of the points; `update` is called after each of them."""
        model = self.model if threading.get_ident() == self.thread else copy.copy(self.model)  # a model belongs to one thread
        part = _Part([], [], None)
        each = self._evaluated(model, points) if callable(self.of) else self._solved(model, points, part)
        for row, doubt in each:
            if row is not None:
                part.rows.append(row)
            if doubt is not None:
                part.doubtful.append(doubt)
            if update is not None:
                update()
        rows = part.rows if self.of is not None else model._live(self.settings).session.rows()
        return part._replace(rows=rows, idle=None if callable(self.of) else self.idle)

    def _solved(self, model: Model, points: list[Any], part: _Part) -> Iterator[tuple[Any, Any]]:
        """Solves the points with one session, which collects their motions; yields responses, and doubts."""
        live = model._live(self.settings)
        session, n_sharing = live.session, model._sharing(self.n) if self.of is None else 0
        varied = [(k, path) for k, path in enumerate(self.paths) if not self.settings.has(path_of(path))]
        session.clear_rows()
        for number, point in enumerate(points):
            for k, path in varied:
                live.set(path, plain(point[k]))
            session.solve(self.warm and number > 0, points=n_sharing)
            text, status = doubts.doubt_of(session), session.status
            doubt = (status, text) if text else None
            if self.of is None:
                session.add_row()
                self._note_idle_laws(session, status)
                yield None, doubt
                continue
            response = response_of(session, self.of) if status in SOLVED else float("nan")
            if status in SOLVED and response != response:
                doubt = status, absence_of(session, self.of)
            self._note_idle_laws(session, status)
            yield {"response": response, "status": status, "message": session.message}, doubt

    def _note_idle_laws(self, session: Any, status: str) -> None:
        if status in SOLVED and (self.idle is None or self.idle):
            found = set(session.idle_laws())
            self.idle = found if self.idle is None else self.idle & found

    def _evaluated(self, model: Model, points: list[Any]) -> Iterator[tuple[Any, Any]]:
        for k, point in enumerate(points):
            if not (self.warm and k > 0):  # it may start from the last motion, of whichever point
                model = copy.copy(self.model)
            for path, value in zip(self.paths, point):
                model[path] = value
            yield self._value(model, point)

    def _value(self, model: Model, point: Any) -> tuple[dict[str, Any], Any]:
        """What the function returns, with the status of its last solution; 'failed' where it raises an exception."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NotConverged)  # one warning for all points
                row = dataset.row_of(self.of(model))
        except Exception as fault:
            if point == self.first:
                raise
            text = f"{type(fault).__name__}: {fault}"
            return {"status": "failed", "message": text}, ("failed", text)
        wrong = [value for value in row.values() if isinstance(value, (str, bytes)) or np.ndim(value) > 0 or value is None]
        if wrong:
            raise ModelError(f"the function `of` of a sweep returns a number or a dict of numbers, not {wrong[0]!r}")
        status, message, text = model._ending()
        return {**row, "status": status, "message": message}, (status, text) if text else None


def _spread(work: _Line, lines: list[Any], workers: int, executor: Any, comm: Any, bar: Progress) -> Iterable[_Part]:
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
            yield from _counted(found, lines, bar)
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
        yield from _counted(executor.map(work, lines), lines, bar)


def _end_with_parent() -> None:
    """Lets this process end when its parent process does, even by SIGKILL; otherwise it would solve its points to the last."""
    threading.Thread(target=_wait_for_parent, name="nhbm parent", daemon=True).start()


def _wait_for_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _pickled(work: _Line) -> bytes:
    """What is sent to a process."""
    try:
        return pickle.dumps(work)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ModelError(
            f"the processes of `workers` cannot be sent something of this model: {error}. Define laws, and the function `of`, at "
            "the top level of a module or script, or leave `workers` out"
        ) from error


def _counted(found: Iterable[_Part], lines: list[Any], bar: Progress) -> Iterator[_Part]:
    for part, line in zip(found, lines):
        bar.update(len(line))
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
    """A bar of tqdm, with a warning if it is not installed, or a function that gets the number of points done."""

    def __init__(self, wanted: Any, what: str, total: int | None = None) -> None:
        self._wanted, self._what, self._total, self._n = wanted, what, total, 0
        self._bar: Any = None
        if not (wanted is None or isinstance(wanted, bool) or callable(wanted)):
            raise ModelError(f"progress must be True, False or a function of the number of points, not {wanted!r}")

    def __enter__(self) -> Progress:
        if self._wanted is True:
            try:
                from tqdm.auto import tqdm

                self._bar = tqdm(total=self._total, desc=self._what, unit="point")
            except ImportError:
                warnings.warn("progress=True draws a bar of tqdm, which is not installed: pip install tqdm", stacklevel=5)
        return self

    def update(self, n: int = 1) -> None:
        self._n += n
        if self._bar is not None:
            self._bar.update(n)
        elif callable(self._wanted):
            self._wanted(self._n)

    def __exit__(self, *fault: Any) -> None:
        if self._bar is not None:
            self._bar.close()
