"""Positions of the degrees of freedom of a result in space: the model file of nhbm, and motions of its nodes as VTK files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nhbm.child_process import atomic_write

from .complete_input import groups
from .errors import ReaderError, UsageError
from .hdf5 import open_file
from .reader import Results
from .series import Series

_AXES = {"x": 0, "y": 1, "z": 2, "r": 0, "t": 1}  # r and t: along and perpendicular to the node's own radius from the axis z


class Structure:
    """Nodes and cells of a model file, and the displacements of nodes for its degrees of freedom."""

    def __init__(self, path):
        self.path = Path(path)
        with open_file(self.path) as file:
            try:
                self._read(file)
            except KeyError as error:
                missing = re.search(r"'([^']*)'", str(error.args[0]))
                raise ReaderError(f"{path}: no model with nodes: it has no '{missing.group(1) if missing else ''}'") from None

    def _read(self, file):
        self.labels = [label.decode() for label in file["labels"][()]]
        self._points, self._fault = file["nodes/coordinates"][()], ""  # without positions the sets still have their names
        lost = ~np.isfinite(self._points).all(axis=1)  # as internal ones of incompatible modes
        self._types, starts, nodes = (file[f"cells/{name}"][()] for name in ("type", "indptr", "nodes"))
        if lost.all():
            self._fault = "the model has no coordinates; nhbm-model import --mesh adds them"
        elif lost[nodes].any():
            self._fault = f"nodes of elements have no coordinates, as node {file['nodes/number'][nodes[lost[nodes]][0]]}"
        else:
            self._points[lost] = self._points[~lost][0]
        self._lost = np.flatnonzero(lost)
        self._cells = [nodes[starts[i] : starts[i + 1]] for i in range(len(self._types))]
        where = zip(self.labels, file["dofs/node"][()], file["dofs/direction"][()])
        self._component = {label: (int(node), _AXES[d.decode()]) for label, node, d in where if node >= 0 and d.decode() in _AXES}
        self._labels_at: dict[int, dict[str, str]] = {}  # node: direction: label
        for label, node, d in zip(self.labels, file["dofs/node"][()], file["dofs/direction"][()]):
            self._labels_at.setdefault(int(node), {})[d.decode()] = label
        self.sets = {}
        if "sets" in file:
            starts, members = file["sets/indptr"][()], file["sets/nodes"][()]
            self.sets = {name.decode(): members[starts[i] : starts[i + 1]] for i, name in enumerate(file["sets/names"][()])}
        self._polar_nodes = {int(node) for node, d in zip(file["dofs/node"][()], file["dofs/direction"][()]) if d in (b"r", b"t")}
        group = "recovery" if "recovery" in file else "dofs"
        node = file[f"{group}/node"][()]
        direction = [text.decode() for text in file[f"{group}/direction"][()]]
        rows = [i for i, (n, d) in enumerate(zip(node, direction)) if n >= 0 and not lost[n] and d in _AXES]
        self._where = node[rows], np.array([_AXES[direction[i]] for i in rows], dtype=int)
        self._polar = np.unique([node[i] for i in rows if direction[i] in "rt"]).astype(int)
        self._matrix = file["recovery/matrix"][rows] if group == "recovery" else None
        self._rows = np.array(rows, dtype=int)

    @property
    def points(self) -> np.ndarray:
        """Positions (n_nodes, 3), of a node without one that of another node."""
        if self._fault:
            raise ReaderError(f"{self.path}: {self._fault}")
        return self._points

    @property
    def has_axis(self) -> bool:
        """Whether nodes move along and perpendicular to their radius from the axis z, as in a wheel."""
        return self._polar.size > 0

    @property
    def cells(self):
        """Kind in the numbering of VTK, and nodes of each cell."""
        return list(zip(self._types, self._cells))

    def displacement(self, motion: np.ndarray) -> np.ndarray:
        """Displacements (n_nodes, 3) for a motion of all degrees of freedom of the model."""
        moved = self._matrix @ motion if self._matrix is not None else motion[self._rows]
        field = np.zeros((len(self.points), 3))
        field[self._where] = moved
        return self._turned(field, self._polar)

    def dofs_of(self, name: str) -> list[str]:
        """Labels for a name in the input: a degree of freedom, its number, or all of a set in order."""
        if name in self.labels:
            return [name]
        if name.isdigit() and 1 <= int(name) <= len(self.labels):
            return [self.labels[int(name) - 1]]
        stem, _, direction = (name, "", None) if name in self.sets else name.rpartition(".")
        at = [self._labels_at.get(int(node), {}) for node in self.sets.get(stem, ())]
        found = [label for labels in at for d, label in labels.items() if direction in (None, d)]
        if not found:
            raise ReaderError(f"{self.path}: no degree of freedom and no set '{name}'; is that the model of the run?")
        return found

    def node_of(self, label: str) -> int | None:
        """Index of the node of a degree of freedom, None for one without a node."""
        return self._component[label][0] if label in self._component else None

    def force(self, values: Mapping[str, float]) -> np.ndarray:
        """Forces (n_nodes, 3) at the nodes of the degrees of freedom in `values`; those of pairs act at the node between them."""
        field = np.zeros((len(self.points), 3))
        for label, value in values.items():
            if label in self._component:
                field[self._component[label]] = value
        return self._turned(field, np.array(sorted(self._polar_nodes), dtype=int))

    def _turned(self, field: np.ndarray, polar: np.ndarray) -> np.ndarray:
        """The field with x and y instead of r and t."""
        x, y = self.points[polar, :2].T
        c, s = np.array([x, y]) / np.hypot(x, y)
        r, t = field[polar, :2].T
        field[polar, :2] = np.column_stack([c * r - s * t, s * r + c * t])
        return field

    def field(self, nodes: np.ndarray, values: np.ndarray, elsewhere: float = np.nan) -> np.ndarray:
        """Values at some nodes as a field over all."""
        whole = np.full(len(self.points), elsewhere)
        whole[nodes] = values
        return whole

    def mesh(self, **fields):
        """A mesh of meshio with fields on its nodes."""
        try:
            import meshio
            from meshio._vtk_common import vtk_to_meshio_type
        except ImportError:
            raise UsageError("files of VTK are written by meshio, which is not installed: pip install meshio") from None
        blocks: dict[tuple[str, int], list] = {}
        for kind, cell in zip(self._types, self._cells):
            blocks.setdefault((vtk_to_meshio_type[int(kind)], len(cell)), []).append(cell)
        cells = [(kind, np.array(members)) for (kind, _), members in blocks.items()]
        alone = np.setdiff1d(np.arange(len(self.points)), np.concatenate([self._lost, *self._cells]))
        if alone.size:  # ParaView shows no points without a cell: those of pairs, halfway
            cells.append(("vertex", alone[:, None]))
        return meshio.Mesh(self.points, cells, point_data=fields)


def has_model(results: Results) -> bool:
    """Whether the structure of a run is a model in a file."""
    return any(group.get("type") == ["model"] for group in groups(results.input_complete, "structure"))


def structure_of(results: Results, point: int, model: Path | None) -> Structure:
    """The structure of a model file, or of the one that the input of a point names: in the folder of the input, in the present one,
    or in that of the result."""
    if model is not None:
        return Structure(model)
    named = [file for group in groups(results.input_complete, "structure") for file in group.get("file", [])]
    swept = [str(p.values[point]) for p in results.parameters.values() if p.path == "structure%file"]
    name = next(iter(swept + named), "")
    if not name:
        raise UsageError(f"{results.path}: its input names no model file; nodes and cells come with --model")
    for path in (results.input_folder / name, Path(name), results.path.parent / name, results.path.parent / Path(name).name):
        if path.is_file():
            return Structure(path)
    places = "neither in the folder of its input, nor here, nor beside it"
    raise UsageError(f"{results.path}: its model file '{name}' is {places}; --model gives its path")


def motions(results: Results, structure: Structure, point: int, allow_unconverged: bool = False):
    """Tuples, frequencies and the coefficients (n_dofs of the model, n_harmonics) cos - i sin of a point."""
    stored = results.labels()
    missing = [label for label in structure.labels if label not in stored]
    if missing and structure._matrix is not None:
        raise ReaderError(
            f"{results.path} does not hold {missing[0]} of {structure.path} ({len(missing)} are missing); "
            "store all degrees of freedom (leave &output dofs out)"
        )
    if len(missing) == len(structure.labels):
        raise ReaderError(f"{results.path} holds no degree of freedom of {structure.path}; is that the model of the run?")
    series = None
    rows = []
    for label in structure.labels:
        if label in missing:
            rows.append(None)
            continue
        series = results.series(point, label, allow_unconverged=allow_unconverged)
        rows.append(series.cos - 1j * series.sin)
    zero = np.zeros(series.n_harmonics, dtype=complex)
    return series.tuples, series.frequencies, np.array([zero if row is None else row for row in rows])


def harmonic_sizes(coefficients: np.ndarray) -> np.ndarray:
    """Largest amplitude of each harmonic."""
    return np.abs(coefficients).max(axis=0)


def harmonic_of(tuples, coefficients, j: Sequence[int] | None) -> int:
    """Number of the harmonic of a tuple or its negative; of the largest one if none is given."""
    if j is None:
        return int(np.argmax(harmonic_sizes(coefficients)))
    j = np.array(j)
    if j.shape == (tuples.shape[1],):
        found = np.flatnonzero((tuples == j).all(axis=1) | (tuples == -j).all(axis=1))
        if found.size:
            return int(found[0])
    raise UsageError(f"tuple {','.join(map(str, j))} is not in the set of harmonics")


def write_harmonics(
    structure: Structure, tuples, coefficients, path: Path, wanted: Sequence[tuple[int, ...]] | None, most: int,
    more: Mapping[str, np.ndarray],
):  # fmt: skip
    """Writes operating deflection shapes: for each harmonic the displacement with the cosine and with the sine, and their
    magnitude; the requested harmonics, or by default the largest; and further fields. Returns their tuples."""
    if wanted is None:
        size = harmonic_sizes(coefficients)
        chosen = [int(h) for h in np.argsort(-size, kind="stable")[:most] if size[h] > 0]
    else:
        chosen = [harmonic_of(tuples, coefficients, j) for j in wanted]
    fields = {}
    for h in chosen:
        name = ",".join(map(str, tuples[h]))
        cosine = structure.displacement(coefficients[:, h].real)
        sine = structure.displacement(-coefficients[:, h].imag)
        fields |= {f"cos {name}": cosine, f"sin {name}": sine, f"amplitude {name}": np.sqrt(cosine**2 + sine**2)}
    _write(structure.mesh(**fields, **more), path)
    return [tuple(int(k) for k in tuples[h]) for h in chosen]


def _write(mesh, path: Path) -> None:
    try:
        with atomic_write(path) as name:
            mesh.write(name)
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None


def write_motion(
    structure: Structure, frequencies, coefficients, path: Path, times: np.ndarray, forces: Mapping[str, Series],
    more: Sequence[Mapping[str, np.ndarray]],
) -> None:  # fmt: skip
    """Writes an animation for ParaView: a file .pvd, and one file .vtu for each time with the field `displacement` and, if there
    are laws, `law_force`, the force of the laws on the nodes in the result; and further fields."""
    folder = path.with_suffix("")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write '{folder}': {error.strerror}") from None
    rows = []
    for i, t in enumerate(times):
        motion = (coefficients * np.exp(1j * frequencies * t)).real.sum(axis=1)
        file = folder / f"{i:04d}.vtu"
        fields = {"displacement": structure.displacement(motion)}
        if forces:
            fields["law_force"] = structure.force({dof: float(series.evaluate(t)) for dof, series in forces.items()})
        _write(structure.mesh(**fields, **more[i]), file)
        rows.append(f'<DataSet timestep="{t:.12g}" file="{folder.name}/{file.name}"/>')
    body = "\n".join(rows)
    try:
        with atomic_write(path) as name:
            Path(name).write_text(f'<VTKFile type="Collection" version="0.1">\n<Collection>\n{body}\n</Collection>\n</VTKFile>\n')
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None
