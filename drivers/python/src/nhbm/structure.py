"""A structure as sparse matrices with labels, nodes, sets and loads, and its file (HDF5, docs/user/model.md)."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nhbm.errors import ModelError, check_file, meant

if TYPE_CHECKING:  # SciPy and h5py take long to import: models of builders need neither
    import h5py
    import scipy.sparse as sp

FORMAT = "nhbm model"
SCHEMA_VERSION = 1
BY_SPEED = (
    "gyroscopic_by_speed", "stiffness_by_speed", "stiffness_by_speed_squared",
    "gyroscopic_by_speed_2", "stiffness_by_speed_2", "stiffness_by_speed_squared_2",
)  # fmt: skip
MATRICES = ("mass", "stiffness", "damping", "gyroscopic", "structural", *BY_SPEED)
MATRIX_PARTS = ("data", "indices", "indptr")
CONTACT_PARTS = ("areas", "frames", "gaps", "points")
CONTACT_DIRECTIONS = ("n", "s", "t")
MAX_LABEL = 16
LARGEST_IMAGE = 2**28  # bytes of a matrix that a file is first made with in memory
ROWS = 4096  # written at a time, of a matrix that may not be contiguous
MAX_ENTRIES = int(np.iinfo(np.int32).max)  # of a matrix in the library

_NO_INTEGERS = np.zeros(0, dtype=np.int64)


@dataclass
class Recovery:
    """Degrees of freedom of the full model that a reduced one stands for: full = matrix @ reduced."""

    matrix: np.ndarray  # (n_full, n_dofs)
    node: np.ndarray  # (n_full), index into the nodes, -1 for none
    direction: list[str]  # (n_full)


@dataclass
class Contact:
    """Points where two surfaces face each other; their motion relative to each other has the directions n, positive in compression,
    s and t. In a reduced model they are the nodes of the set with the name of the contact."""

    weights: sp.csr_matrix | None  # (points, nodes) of the motion of the nodes, along each axis; None: in a reduced model
    areas: np.ndarray  # (points) [m2]
    frames: np.ndarray  # (points, 3, 3), unit vectors n, s, t in rows; n is the outward normal of the first surface
    gaps: np.ndarray  # (points), distance of the surfaces at rest, as the meshes have it [m]
    points: np.ndarray  # (points, 3), centroids of their areas

    def along(self, direction: str) -> np.ndarray:
        """Unit vectors of a direction n, s or t (points, 3)."""
        return self.frames[:, CONTACT_DIRECTIONS.index(direction)]


@dataclass
class Structure:
    """M x'' + (D + G + sum W_s G_s) x' + (K + i H + sum W_s K_s + W_s**2 L_s) x = forces, with up to two speeds W_s [rad/s]."""

    input_name = "structure in memory"  # as the file of an input

    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    labels: list[str] = None  # type: ignore[assignment]  # x1, x2, ...
    damping: sp.csr_matrix | None = None
    gyroscopic: sp.csr_matrix | None = None
    structural: sp.csr_matrix | None = None  # H
    gyroscopic_by_speed: sp.csr_matrix | None = None  # G_1 [N s2/m], skew-symmetric
    stiffness_by_speed: sp.csr_matrix | None = None  # K_1 [N s/m]
    stiffness_by_speed_squared: sp.csr_matrix | None = None  # L_1 [N s2/m]
    gyroscopic_by_speed_2: sp.csr_matrix | None = None
    stiffness_by_speed_2: sp.csr_matrix | None = None
    stiffness_by_speed_squared_2: sp.csr_matrix | None = None
    units: list[str] = None  # type: ignore[assignment]  # of the coordinates; m
    node_numbers: np.ndarray = field(default_factory=lambda: _NO_INTEGERS)
    coordinates: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    dof_node: np.ndarray = None  # type: ignore[assignment]  # index into the nodes, -1 for none
    dof_direction: list[str] = None  # type: ignore[assignment]
    cell_types: np.ndarray = field(default_factory=lambda: _NO_INTEGERS)  # of VTK
    cell_starts: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    cell_nodes: np.ndarray = field(default_factory=lambda: _NO_INTEGERS)
    sets: dict[str, np.ndarray] = field(default_factory=dict)  # indices of nodes
    loads: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)  # degrees of freedom, values
    contacts: dict[str, Contact] = field(default_factory=dict)  # between surfaces, by their names
    unit_system: str = "m kg s"
    source: str = ""
    recovery: Recovery | Any = None  # None: there is none
    up_to: float | None = None  # frequencies that a reduced model is for [rad/s]
    original_labels: list[str] | None = None  # as another program has them
    notes: list[str] = field(default_factory=list)  # what an import has left out or changed; not part of the file

    def __repr__(self) -> str:
        parts = [f"{self.n_dofs} degrees of freedom", f"{self.stiffness.nnz} entries of the stiffness"]
        parts += [f"{name} {', '.join(found)}" for name, found in (("sets", self.sets), ("loads", self.loads)) if found]
        return f"<nhbm.Structure: {'; '.join(parts)}>"

    def __post_init__(self) -> None:
        import scipy.sparse as sp

        for name in MATRICES:
            matrix = getattr(self, name)
            if matrix is None:
                continue
            if np.iscomplexobj(matrix.data if sp.issparse(matrix) else matrix):
                raise ModelError(f"matrix '{name}' is complex; the imaginary part of a stiffness is the matrix `structural`")
            matrix = sp.csr_matrix(matrix, dtype=float)
            matrix.sum_duplicates()
            if matrix.nnz > MAX_ENTRIES:
                raise ModelError(f"matrix '{name}' has {matrix.nnz} entries; at most {MAX_ENTRIES} are possible: reduce the model")
            setattr(self, name, matrix)
        if self.labels is None:
            self.labels = [f"x{i + 1}" for i in range(self.mass.shape[0])]
        if self.units is None:
            self.units = ["m"] * self.n_dofs
        if self.dof_node is None:
            self.dof_node = np.full(self.n_dofs, -1)
        if self.dof_direction is None:
            self.dof_direction = [""] * self.n_dofs
        self.validate()

    @property
    def n_dofs(self) -> int:
        return len(self.labels)

    def matrices(self) -> dict[str, sp.csr_matrix]:
        """The given matrices, by name."""
        return {name: getattr(self, name) for name in MATRICES if getattr(self, name) is not None}

    def validate(self) -> None:
        """Refuses inconsistent sizes, non-finite numbers, and labels that are invalid or not unique."""
        import scipy.sparse as sp

        n = self.n_dofs
        if n == 0:
            raise ModelError("the model has no degrees of freedom")
        for name, matrix in self.matrices().items():
            if matrix.shape != (n, n):
                raise ModelError(f"matrix '{name}' is {matrix.shape[0]} x {matrix.shape[1]}, there are {n} labels")
            if not np.isfinite(matrix.data).all():
                at = sp.coo_matrix(matrix)
                e = int(np.argmin(np.isfinite(at.data)))
                raise ModelError(
                    f"matrix '{name}': the entry between {self.labels[at.row[e]]} and {self.labels[at.col[e]]} is not a "
                    "finite number"
                )
        check_labels(self.labels)
        for what, values in (("units", self.units), ("nodes", self.dof_node), ("directions", self.dof_direction)):
            if len(values) != n:
                raise ModelError(f"there are {len(values)} {what} for {n} degrees of freedom")
        n_nodes = len(self.node_numbers)
        if np.shape(self.coordinates) != (n_nodes, 3):
            raise ModelError(f"coordinates are {np.shape(self.coordinates)}, expected ({n_nodes}, 3)")
        for name, nodes in self.sets.items():
            nodes = np.asarray(nodes)
            if nodes.size and (nodes.min() < 0 or nodes.max() >= n_nodes):
                raise ModelError(f"set '{name}' names a node that there is not; there are 0 to {n_nodes - 1}")
            if len(np.unique(nodes)) != len(nodes):
                raise ModelError(f"set '{name}' names a node twice")
        for name, contact in self.contacts.items():
            n_points = len(contact.areas)
            shapes = {"frames": (n_points, 3, 3), "gaps": (n_points,), "points": (n_points, 3)}
            for part, shape in shapes.items():
                if np.shape(getattr(contact, part)) != shape:
                    raise ModelError(f"contact '{name}': {part} are {np.shape(getattr(contact, part))}, expected {shape}")
            if contact.weights is not None and contact.weights.shape != (n_points, n_nodes):
                raise ModelError(f"contact '{name}': weights are {contact.weights.shape}, expected ({n_points}, {n_nodes})")
            if contact.weights is None and len(self.sets.get(name, ())) != n_points:
                raise ModelError(f"contact '{name}' has {n_points} points, its set {len(self.sets.get(name, ()))} nodes")
        for name, (dofs, values) in self.loads.items():
            if len(dofs) != len(values):
                raise ModelError(f"load '{name}' has {len(dofs)} degrees of freedom and {len(values)} values")
            if len(dofs) and (np.min(dofs) < 0 or np.max(dofs) >= n):
                raise ModelError(f"load '{name}' acts on a degree of freedom that there is not")
            if not np.isfinite(values).all():
                at = self.labels[int(dofs[np.argmin(np.isfinite(values))])]
                raise ModelError(f"load '{name}': the value at {at} is not a finite number")

    def dofs_of(self, name: str) -> list[int]:
        """Indices of a label, of a set with a direction (`contact.z`), or of all directions of a set (`contact`)."""
        if name in self.labels:
            return [self.labels.index(name)]
        stem, _, direction = name.rpartition(".")
        wanted = None
        if name in self.sets:
            stem = name
        elif stem in self.sets:
            wanted = direction
        else:
            known = ", ".join(self.sets) or "none"
            directed = [f"{name}.{d}" for name in self.sets for d in set(self.dof_direction)]
            hint = meant(name, [*self.sets, *directed, *self.labels])
            raise ModelError(f"there is no degree of freedom and no set '{name}'; sets: {known}{hint}")
        of_node: dict[int, list[int]] = {}
        for dof, node in enumerate(self.dof_node):
            if wanted is None or self.dof_direction[dof] == wanted:
                of_node.setdefault(int(node), []).append(dof)
        missing = [int(node) for node in self.sets[stem] if int(node) not in of_node]
        if missing:
            raise ModelError(f"node {self.node_numbers[missing[0]]} of set '{stem}' has no degree of freedom '{direction}'")
        return [dof for node in self.sets[stem] for dof in of_node[int(node)]]

    def write(self, path: Any) -> None:
        """Writes the model file, under a temporary name until it is complete and on disk."""
        from nhbm.child_process import atomic_write
        from nhbm.hdf5_file import image_of

        is_large = self.recovery is not None and self.recovery.matrix.nbytes > LARGEST_IMAGE
        image = b"" if is_large else image_of(self._fill)
        try:
            with atomic_write(path) as name:
                if is_large:
                    self._write_in_place(name)
                else:
                    Path(name).write_bytes(image)
        except OSError as error:
            raise ModelError(f"file '{path}' cannot be written: {error.strerror or error}") from None

    def _write_in_place(self, name: str) -> None:
        """Writes what would not fit into memory a second time, if the disk has room: HDF5 does not recover from a full one."""
        import h5py

        needed = self.recovery.matrix.nbytes + 12 * sum(matrix.nnz for matrix in self.matrices().values())
        if shutil.disk_usage(Path(name).parent).free < 1.1 * needed:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), name)
        with h5py.File(name, "w") as file:
            self._fill(file)

    def _fill(self, file: h5py.File) -> None:
        """Writes the structure into an open file."""
        import h5py

        texts = h5py.string_dtype()
        file.attrs["format"] = FORMAT
        file.attrs["schema_version"] = np.int32(SCHEMA_VERSION)
        file.attrs["unit_system"] = self.unit_system
        file.attrs["source"] = self.source
        file.create_dataset("labels", data=self.labels, dtype=texts)
        file.create_dataset("units", data=self.units, dtype=texts)
        for name, matrix in self.matrices().items():
            group = file.create_group(name)
            group["indptr"] = matrix.indptr
            group["indices"] = matrix.indices
            group["data"] = matrix.data
        file["nodes/number"] = np.asarray(self.node_numbers, dtype=np.int64)
        file["nodes/coordinates"] = np.asarray(self.coordinates, dtype=float)
        file["dofs/node"] = np.asarray(self.dof_node, dtype=np.int64)
        file.create_dataset("dofs/direction", data=self.dof_direction, dtype=texts)
        file["cells/type"] = np.asarray(self.cell_types, dtype=np.uint8)
        file["cells/indptr"] = np.asarray(self.cell_starts, dtype=np.int64)
        file["cells/nodes"] = np.asarray(self.cell_nodes, dtype=np.int64)
        _write_lists(file, "sets", {name: (nodes,) for name, nodes in self.sets.items()}, ("nodes",), texts)
        _write_lists(file, "loads", self.loads, ("dofs", "values"), texts)
        for name, contact in self.contacts.items():
            for part in CONTACT_PARTS:
                file[f"contacts/{name}/{part}"] = getattr(contact, part)
            if contact.weights is not None:
                for part in MATRIX_PARTS:
                    file[f"contacts/{name}/weights/{part}"] = getattr(contact.weights, part)
        if self.recovery is not None:
            matrix = self.recovery.matrix
            dataset = file.create_dataset("recovery/matrix", matrix.shape, float)
            for first in range(0, len(matrix), ROWS):
                dataset[first : first + ROWS] = matrix[first : first + ROWS]
            file["recovery/node"] = np.asarray(self.recovery.node, dtype=np.int64)
            file.create_dataset("recovery/direction", data=self.recovery.direction, dtype=texts)
        if self.up_to is not None:
            file["up_to"] = np.array([self.up_to])
        if self.original_labels is not None:
            file.create_dataset("original_labels", data=self.original_labels, dtype=texts)

    @classmethod
    def read(cls, path: Any) -> Structure:
        """Reads a model file."""
        from nhbm.hdf5_file import open_hdf5

        check_file(path)
        try:
            with open_hdf5(path) as file:
                return cls._from_file(file)
        except ModelError as error:
            raise ModelError(f"file '{path}': {error}") from None
        except OSError as error:
            raise ModelError(f"file '{path}' cannot be read as HDF5: {error}") from None
        except (KeyError, RuntimeError, ValueError, TypeError, IndexError, AttributeError, OverflowError, MemoryError) as error:
            why = " ".join(str(error).strip("'\"").split())  # h5py raises any of these where a part is damaged
            raise ModelError(f"file '{path}' is damaged: {why}") from None

    @classmethod
    def _from_file(cls, file: h5py.File) -> Structure:
        import scipy.sparse as sp

        if _text(file.attrs.get("format", "")) != FORMAT:
            raise ModelError(f"is not a model file: it has no attribute 'format' with the value '{FORMAT}'")
        if int(file.attrs.get("schema_version", 0)) != SCHEMA_VERSION:
            raise ModelError(f"has schema version {file.attrs.get('schema_version')}, this package reads {SCHEMA_VERSION}")
        labels = _texts(file, "labels")
        n = len(labels)
        matrices = {}
        for name in MATRICES:
            if name in file:
                parts = [_values(file, f"{name}/{part}") for part in ("data", "indices", "indptr")]
                if len(parts[2]) != n + 1:
                    raise ModelError(f"matrix '{name}' has {len(parts[2]) - 1} rows, there are {n} labels")
                try:
                    matrices[name] = sp.csr_matrix(tuple(parts), shape=(n, n))
                    matrices[name].check_format()
                except ValueError as error:
                    raise ModelError(f"matrix '{name}': {error}") from None
        for name in ("mass", "stiffness"):
            if name not in matrices:
                raise ModelError(f"has no matrix '{name}'")
        more: dict[str, Any] = {}
        if "dofs" in file:
            more = {"dof_node": _values(file, "dofs/node"), "dof_direction": _texts(file, "dofs/direction")}
        if "nodes" in file:
            more |= {"node_numbers": _values(file, "nodes/number"), "coordinates": _values(file, "nodes/coordinates")}
        if "cells" in file:
            more |= {
                "cell_types": _values(file, "cells/type"),
                "cell_starts": _values(file, "cells/indptr"),
                "cell_nodes": _values(file, "cells/nodes"),
            }
        n_nodes = len(more.get("node_numbers", ()))
        more["contacts"] = {name: _contact(file[f"contacts/{name}"], n_nodes) for name in file.get("contacts", ())}
        if "recovery" in file:
            matrix, node = _values(file, "recovery/matrix"), _values(file, "recovery/node")
            more["recovery"] = Recovery(matrix, node, _texts(file, "recovery/direction"))
        if "up_to" in file:
            more["up_to"] = float(_values(file, "up_to")[0])
        if "original_labels" in file:
            more["original_labels"] = _texts(file, "original_labels")
        return cls(
            labels=labels,
            units=_texts(file, "units"),
            sets={name: nodes for name, (nodes,) in _read_lists(file, "sets", ("nodes",)).items()},
            loads=_read_lists(file, "loads", ("dofs", "values")),
            unit_system=_text(file.attrs.get("unit_system", "")),
            source=_text(file.attrs.get("source", "")),
            **matrices,
            **more,
        )


def _contact(group: h5py.Group, n_nodes: int) -> Contact:
    import scipy.sparse as sp

    values = {part: _values(group, part) for part in CONTACT_PARTS}
    weights = None
    if "weights" in group:
        weights = sp.csr_matrix(tuple(_values(group, f"weights/{part}") for part in MATRIX_PARTS), (len(values["areas"]), n_nodes))
        weights.check_format()
    return Contact(weights, **values)


def dofs_of_sets(structure: Structure) -> dict[str, str]:
    """The labels of degrees of freedom by the names that sets of one node give them, such as "disk1.x"."""
    return _single_nodes(structure.sets, structure.dof_node, structure.dof_direction, structure.labels)


def dofs_of_sets_in(path: str | Path) -> dict[str, str]:
    """Likewise of a model file, without its matrices; none if it cannot be read."""
    from nhbm.hdf5_file import open_hdf5

    try:
        with open_hdf5(path) as file:
            if _text(file.attrs.get("format", "")) != FORMAT or not {"sets", "dofs"} <= set(file):
                return {}
            sets = {name: nodes for name, (nodes,) in _read_lists(file, "sets", ("nodes",)).items()}
            return _single_nodes(sets, _values(file, "dofs/node"), _texts(file, "dofs/direction"), _texts(file, "labels"))
    except (ModelError, OSError, KeyError, RuntimeError, ValueError, TypeError, IndexError, AttributeError):  # of a damaged file
        return {}


def _single_nodes(sets: dict[str, np.ndarray], node: np.ndarray, direction: list[str], labels: list[str]) -> dict[str, str]:
    return {
        f"{name}.{direction[dof]}": labels[dof]
        for name, members in sets.items() if len(members) == 1
        for dof in np.flatnonzero(np.asarray(node) == members[0])
    }  # fmt: skip


def check_labels(labels: list[str]) -> None:
    """Refuses labels that are no names or not unique."""
    seen: dict[str, int] = {}
    for i, label in enumerate(labels):
        if not label or not label[0].isascii() or not label[0].isalpha():
            raise ModelError(f"label {i + 1} is '{label}', it must begin with a letter")
        if len(label) > MAX_LABEL:
            raise ModelError(f"label '{label}' has more than {MAX_LABEL} characters")
        if label in seen:
            raise ModelError(f"degrees of freedom {seen[label] + 1} and {i + 1} both have the label '{label}'")
        seen[label] = i


def _write_lists(file: Any, group: Any, lists: Any, parts: Any, texts: Any) -> None:
    """Writes named lists one behind the other, with the index where each begins."""
    if not lists:
        return
    file.create_dataset(f"{group}/names", data=list(lists), dtype=texts)
    columns = list(zip(*lists.values()))
    file[f"{group}/indptr"] = np.concatenate([[0], np.cumsum([len(c) for c in columns[0]])]).astype(np.int64)
    for part, column in zip(parts, columns):
        values = np.concatenate([np.asarray(c) for c in column])
        file[f"{group}/{part}"] = values.astype(float if part == "values" else np.int64)


def _read_lists(file: Any, group: Any, parts: Any) -> dict[str, Any]:
    if group not in file:
        return {}
    starts = _values(file, f"{group}/indptr")
    columns = [_values(file, f"{group}/{part}") for part in parts]
    names = _texts(file, f"{group}/names")
    if len(starts) != len(names) + 1:
        raise ModelError(f"'{group}/indptr' has {len(starts)} entries, expected {len(names) + 1}")
    return {name: tuple(column[starts[i] : starts[i + 1]] for column in columns) for i, name in enumerate(names)}


def _values(file: Any, name: Any) -> np.ndarray:
    if name not in file:
        raise ModelError(f"has no '{name}'")
    return file[name][()]


def _texts(file: Any, name: Any) -> list[str]:
    return [_text(value) for value in _values(file, name)]


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
