"""Models in process: a structure with tones, loads and laws, its motions, curves and sweeps as xarray.Dataset."""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from nhbm import dataset
from nhbm.errors import ModelError
from nhbm.groups import Builder, group_text, identifier, path_of
from nhbm.laws import Law
from nhbm.session import Session
from nhbm.structure import Structure

GROUPS = (
    "structure", "tones", "phase", "harmonics", "sampling", "load", "law", "start", "normal_mode", "solver", "certificate", "stability",
    "output", "march", "accuracy", "curve",
)  # fmt: skip
_IN_MEMORY = "structure in memory"


class NotConverged(UserWarning):
    """A motion was not found, or misses what was asked for."""


class Model:
    """A structure with tones, loads and laws.

    structure: a Builder (nhbm.Beam, nhbm.Chain, ...), a Structure of sparse matrices, or the path of a model file.
    tones: base frequencies [rad/s], or a mapping of keys of the group &tones.
    groups: further groups of the input by name, each a mapping of its keys: harmonics={"order": 9}.

    Keys, units and defaults are those of the input (docs/user/input.md). Raises ModelError with group, key and the right value. A model
    belongs to one thread at a time; it can be pickled with its values, for processes that work on the same.
    """

    def __init__(self, structure: Builder | Structure | str | Path, tones: Iterable[float] | Mapping = (), **groups: Mapping):
        self._clear()
        if isinstance(structure, Builder):
            self._groups["structure"] = dict(structure.keys)
        elif isinstance(structure, Structure):
            self._structure = structure
            self._groups["structure"] = {"type": "model", "file": _IN_MEMORY}
        elif isinstance(structure, (str, Path)):
            self._groups["structure"] = {"type": "model", "file": str(structure)}
        else:
            raise ModelError(f"{structure!r} is no structure; nhbm.Beam(...), nhbm.Structure(...) or the path of a model file is one")
        if isinstance(tones, Mapping):
            self._groups["tones"] = dict(tones)
        elif len(list(np.atleast_1d(tones))) > 0:
            self._groups["tones"] = {"frequency": [float(omega) for omega in np.atleast_1d(tones)]}
        for name, keys in groups.items():
            self.set(name, **keys)

    def _clear(self) -> None:
        self._base, self._folder, self._name = "", Path(), "model"
        self._groups: dict[str, dict] = {}
        self._lists: list[tuple[str, dict]] = []
        self._laws: list[Law] = []
        self._structure: Structure | None = None
        self._values: dict[str, object] = {}
        self._handles: dict[str, int] = {}
        self._session: Session | None = None
        self._wanted: tuple[float | None, int | None] = (None, None)  # tolerance and order

    @classmethod
    def from_namelist(cls, text: str, folder: str | Path = ".") -> Model:
        """The model of the text of an input; files that it names are looked for in `folder`."""
        model = cls.__new__(cls)
        model._clear()
        model._base, model._folder = text if text.endswith("\n") else text + "\n", Path(folder)
        model._live()
        return model

    @classmethod
    def from_file(cls, path: str | Path) -> Model:
        """The model of an input file."""
        model = cls.from_namelist(Path(path).read_text(), Path(path).parent)
        model._name = str(path)
        return model

    def to_namelist(self) -> str:
        """The input with all keys that may be given and their values; laws of Python and structures in memory stand by name alone."""
        return self._live().input()

    # What it is made of

    def set(self, group: str, **keys) -> None:
        """Sets keys of a group, such as set("harmonics", order=9); None leaves a key to its default."""
        if group in ("load", "law", "start"):
            raise ModelError(f"there may be several groups &{group}; model.{group}(...) adds one")
        if group not in GROUPS:
            raise ModelError(f"unknown group '{group}'; known: {', '.join(GROUPS)}")
        self._groups.setdefault(group, {}).update(keys)
        self._session = None

    def load(self, dof: str | None = None, tuple_: int | Iterable[int] = 1, cos: float = 0.0, sin: float = 0.0, **keys) -> None:
        """Adds the force cos cos(j.omega t) + sin sin(j.omega t) [N] at a degree of freedom, or vector="name" of a structure; `tuple_` is j."""
        entries = [int(k) for k in np.atleast_1d(tuple_)]
        self._add("load", {"dof": dof, "tuple": entries, "cos": cos, "sin": sin, **keys})

    def law(self, kind: str | Law | Callable, dof: str | Iterable[str] | None = None, **keys) -> None:
        """Adds a law of the catalogue by its type, or one of Python (nhbm.law); `dof` is where it acts, several are `dofs`."""
        where = {} if dof is None else {"dof": dof} if isinstance(dof, str) else {"dofs": list(dof)}
        if isinstance(kind, str):
            self._add("law", {"type": kind, **where, **keys})
            return
        law = kind if isinstance(kind, Law) else Law(kind)
        self._laws.append(law)
        self._add("law", {"type": "user", "library": "", "name": law.name, "odd": law.odd, **where, **keys})

    def start(self, dof: str, tuple_: int | Iterable[int] = 1, cos: float = 0.0, sin: float = 0.0, **keys) -> None:
        """Adds an entry of the first guess, as `load`, in units of the motion."""
        self._add("start", {"dof": dof, "tuple": [int(k) for k in np.atleast_1d(tuple_)], "cos": cos, "sin": sin, **keys})

    def __setitem__(self, path: str, value) -> None:
        """Sets a value by its path: model["wall.gap"] = 1e-3, model["tones[0]"] = 2.0, or a path of the input, "law(wall)%gap"."""
        path, session = path_of(path, GROUPS), self._live()
        if isinstance(value, (float, np.floating)):
            if path not in self._handles:
                self._handles[path] = session.parameter(path)
            session.set_parameter(self._handles[path], float(value))
        else:
            session.set(path, value)
        self._values[path] = value

    # What it does

    def solve(self, *, tolerance: float | None = None, order: int | None = None, warm: bool = False) -> xr.Dataset:
        """Finds the motion: harmonics by tolerance (relative, 1e-2 if nothing is said) or of a given order.

        `warm` starts from the motion found last. The dataset has the names of the result file; its status is 1 where the motion has
        converged, else NotConverged is warned of with the reason.
        """
        session = self._asked(tolerance, order)
        session.solve(warm)
        motion = dataset.motion_of(session)
        if int(motion["status"]) != dataset.CONVERGED:
            warnings.warn(session.message or f"status {int(motion['status'])}", NotConverged, stacklevel=2)
        return motion

    def curve(self, path: str, start: float, stop: float, *, tolerance: float | None = None, order: int | None = None,
              on_point: Callable[[xr.Dataset], bool] | None = None, progress=False, **keys) -> xr.Dataset:  # fmt: skip
        """Follows motions while the value of a path moves from `start` to `stop`, round folds, with stability and bifurcations.

        keys: of the group &curve (docs/user/curves.md), such as peak_of="x1 (1)", points=200. `on_point` gets each point and may end the
        curve by returning True. The points are those of the dimension `point`; `curve_kind` tells folds, peaks and bifurcations.
        """
        path = path_of(path, GROUPS)
        self._groups["curve"] = {"parameter": path, "from": float(start), "to": float(stop), **keys}
        self._session = None
        try:
            session, points = self._asked(tolerance, order), []
            session.begin_curve()
            with _Progress(progress, "curve") as bar:
                while session.next():
                    points.append(dataset.motion_of(session))
                    bar.update()
                    if on_point is not None and on_point(points[-1]):
                        break
        finally:
            del self._groups["curve"]
            self._session = None
        if not points:
            raise ModelError(session.message or "the curve has no points")
        found = dataset.joined(points, {})
        found[identifier(path)].attrs["parameter"] = path
        return found.set_coords(identifier(path)).assign_attrs(varies=[identifier(path)])

    def sweep(self, values: Mapping[str, Iterable], *, tolerance: float | None = None, order: int | None = None, warm: bool = False,
              workers: int = 1, executor=None, comm=None, progress=False) -> xr.Dataset:  # fmt: skip
        """Solves the points of a grid of values by path, {"wall.gap": [...], "tones[0]": [...]}; the last one changes fastest.

        `warm` starts each point from its neighbour along the last path. The work is spread over lines of the grid (points, where nothing
        is warm): over `workers` processes, an executor with `map` (concurrent.futures, mpi4py.futures, Dask), or the ranks of an MPI
        communicator, each of which gets the whole dataset. Points that have no motion are told by `status` and `message`.
        """
        grid = {path: list(np.atleast_1d(list(line))) for path, line in values.items()}
        if not grid or not all(grid.values()):
            raise ModelError("a sweep needs at least one path, and values for each")
        points = list(itertools.product(*grid.values()))
        length = len(list(grid.values())[-1]) if warm else 1
        lines = [points[k : k + length] for k in range(0, len(points), length)]
        if length == 1 and comm is None:  # fewer, larger pieces of work
            n = max(1, len(points) // (8 * workers)) if workers > 1 or executor else 1
            lines = [points[k : k + n] for k in range(0, len(points), n)]
        work = _Line(self, list(grid), tolerance, order, warm)
        with _Progress(progress, "sweep", len(points)) as bar:
            motions = list(itertools.chain.from_iterable(_spread(work, lines, workers, executor, comm, bar)))
        names = [identifier(path_of(path, GROUPS)) for path in grid]
        found = dataset.joined(motions, {name: [point[k] for point in points] for k, name in enumerate(names)}).assign_attrs(varies=names)
        for name, path in zip(names, grid):
            found[name].attrs["parameter"] = path_of(path, GROUPS)
        bad = int((found["status"] != dataset.CONVERGED).sum())
        if bad:
            warnings.warn(f"{bad} of {len(points)} points have not converged: {found.nhbm.message}", NotConverged, stacklevel=2)
        return found

    # How it is kept

    def _add(self, name: str, keys: dict) -> None:
        self._lists.append((name, keys))
        self._session = None

    def _text(self) -> str:
        groups, (tolerance, order) = dict(self._groups), self._wanted
        if order is not None:
            groups.pop("accuracy", None)
        for name, key, value in (("accuracy", "tolerance", tolerance), ("harmonics", "order", order)):
            if value is not None and not self._is_in_base(name):
                groups[name] = {**groups.get(name, {}), key: value}
        groups = [group_text(name, keys) for name, keys in groups.items()]
        return self._base + "".join(groups + [group_text(name, keys) for name, keys in self._lists])

    def _is_in_base(self, group: str) -> bool:
        return re.search(rf"^\s*&{group}\b", self._base, re.IGNORECASE | re.MULTILINE) is not None

    def _live(self) -> Session:
        """The session, made anew where groups have changed."""
        if self._session is None:
            session = Session(self._find_structure)
            session.read(self._text(), self._name)
            for name, path, value in zip(("accuracy", "harmonics"), ("accuracy%tolerance", "harmonics%order"), self._wanted):
                if value is not None and self._is_in_base(name):
                    session.set(path, value)
            for path, value in self._values.items():
                session.set(path, value)
            self._session, self._handles = session, {}
        return self._session

    def _find_structure(self, name: str) -> Structure:
        if name == _IN_MEMORY and self._structure is not None:
            return self._structure
        path = self._folder / name
        return Structure.read(path if path.is_file() else name)

    def _asked(self, tolerance, order) -> Session:
        """The session with that tolerance or order. Which of both it is decides how an input is read, so it is read again where that changes."""
        if (tolerance, order) != self._wanted:
            self._wanted, self._session = (tolerance, order), None
        return self._live()

    def __getstate__(self):
        return {**self.__dict__, "_session": None, "_handles": {}, "_lists": [*self._lists], "_law_names": [law.name for law in self._laws]}

    def __setstate__(self, state):
        names = state.pop("_law_names")
        self.__dict__.update(state)
        new = {old: law.name for old, law in zip(names, self._laws)}  # laws have names of their own in each process
        self._lists = [(g, {**keys, "name": new.get(keys["name"], keys["name"])} if "name" in keys else keys) for g, keys in self._lists]


class _Line:
    """Solves a line of points; a value that processes can be sent."""

    def __init__(self, model, paths, tolerance, order, warm):
        self.model, self.paths, self.tolerance, self.order, self.warm = model, paths, tolerance, order, warm

    def __call__(self, points) -> list[xr.Dataset]:
        motions = []
        for k, point in enumerate(points):
            for path, value in zip(self.paths, point):
                self.model[path] = value
            session = self.model._asked(self.tolerance, self.order)
            session.solve(self.warm and k > 0)
            motions.append(dataset.motion_of(session))
        return motions


def _spread(work, lines, workers, executor, comm, bar) -> Iterable[list[xr.Dataset]]:
    """What comes of all lines, in their order."""
    if comm is not None:
        mine = [(k, work(line)) for k, line in enumerate(lines) if k % comm.Get_size() == comm.Get_rank()]
        done = dict(itertools.chain.from_iterable(comm.allgather(mine)))
        yield from (done[k] for k in range(len(lines)))
        return
    if executor is None and workers > 1:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as executor:
            yield from _spread(work, lines, 1, executor, None, bar)
        return
    for motions in map(work, lines) if executor is None else executor.map(work, lines):
        bar.update(len(motions))
        yield motions


class _Progress:
    """A bar of tqdm where one is asked for and tqdm is there, or a function that gets the number of points done."""

    def __init__(self, wanted, what: str, total: int | None = None):
        self._wanted, self._what, self._total, self._n, self._bar = wanted, what, total, 0, None

    def __enter__(self) -> _Progress:
        if self._wanted is True:
            try:
                from tqdm.auto import tqdm

                self._bar = tqdm(total=self._total, desc=self._what, unit="point")
            except ImportError:
                pass
        return self

    def update(self, n: int = 1) -> None:
        self._n += n
        if self._bar is not None:
            self._bar.update(n)
        elif callable(self._wanted):
            self._wanted(self._n)

    def __exit__(self, *fault) -> None:
        if self._bar is not None:
            self._bar.close()
