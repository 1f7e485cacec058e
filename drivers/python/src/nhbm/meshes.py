"""Meshes of other programs by the format of their files, and what structures take of them."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nhbm import ansys, bulk_data, decks, gmsh_meshes
from nhbm.errors import ModelError, check_file, imported
from nhbm.mesh import DIRECTIONS, Mesh, one_per_name
from nhbm.structure import Structure


def read_mesh(path: Any) -> Mesh:
    """Mesh of a file, its format by the end of the name: decks of Abaqus and CalculiX (.inp), bulk data of Nastran (.bdf, .dat,
    .nas, .fem, .pch, .asm), Ansys (.cdb), Gmsh (.msh), all others by meshio."""
    path = Path(path)
    check_file(path)
    readers = {".inp": decks.read_deck, ".cdb": ansys.read_cdb, ".msh": gmsh_meshes.read_mesh}
    readers |= dict.fromkeys((".bdf", ".dat", ".nas", ".fem", ".pch", ".asm"), bulk_data.read_mesh)
    return readers.get(path.suffix.lower(), _by_meshio)(path)


def add_mesh(model: Structure, path: Any, in_order: bool = False) -> list[str]:
    """Adds coordinates, cells and sets of nodes of a mesh to a structure, nodes by their numbers; returns notes on what was left
    out. `in_order`: node k is the k-th of the file, where its format has no numbers."""
    if (model.dof_node < 0).all():
        raise ModelError(f"no degree of freedom stands at a node of '{path}': --labels gives names such as n12.z")
    mesh = read_mesh(path)
    if mesh.numbers is None:
        if not in_order:
            raise ModelError(f"file '{path}' has no numbers of nodes, but the matrices name node {model.node_numbers[0]}; if node "
                             "k is the k-th of the file, say so by --in-order")  # fmt: skip
        mesh.numbers = np.arange(1, len(mesh.points) + 1)
        mesh.cells = [(kind, [node + 1 for node in cell]) for kind, cell in mesh.cells]
        mesh.sets = {name: [node + 1 for node in members] for name, members in mesh.sets.items()}
    index = {int(number): i for i, number in enumerate(mesh.numbers)}
    missing = [int(number) for number in model.node_numbers if int(number) not in index]
    notes = [*mesh.notes, *name_frames(model, mesh.frames)]
    if missing:
        is_of_solver = mesh.adds_nodes and min(missing) > max(index)
        if not is_of_solver:
            raise ModelError(f"node {missing[0]} of the matrices is not in the mesh '{path}' ({len(missing)} are missing)")
        notes.append(f"{len(missing)} nodes, from {missing[0]} on, are of the solver's own, without a position")
        index |= {number: len(index) + i for i, number in enumerate(missing)}
        mesh.numbers = np.concatenate([mesh.numbers, missing])
        mesh.points = np.vstack([mesh.points, np.full((len(missing), 3), np.nan)])
    old = np.array([index[int(number)] for number in model.node_numbers], dtype=np.int64)
    model.dof_node = np.array([old[node] if node >= 0 else -1 for node in model.dof_node])
    model.node_numbers = np.asarray(mesh.numbers, dtype=np.int64)
    model.coordinates = mesh.points
    model.cell_types = np.array([kind for kind, _ in mesh.cells], dtype=np.int64)
    model.cell_starts = np.cumsum([0, *(len(cell) for _, cell in mesh.cells)]).astype(np.int64)
    model.cell_nodes = np.array([index[node] for _, cell in mesh.cells for node in cell], dtype=np.int64)
    moving = set(model.dof_node.tolist())
    held = []
    for name, members in mesh.sets.items():
        known = dict.fromkeys(index[node] for node in members if node in index)
        kept = [node for node in known if node in moving]
        if kept:
            model.sets[name.lower()] = np.array(kept)
        if len(kept) < len(known):
            held.append(f"{name.lower()} ({len(known) - len(kept)} of {len(known)})")
    if held:
        notes.append(f"nodes without a degree of freedom are left out of sets: {', '.join(held)}")
    model.validate()
    return notes


def name_frames(model: Structure, frames: dict[int, str]) -> list[str]:
    """Degrees of freedom along axes that are not the global ones are called d1 to d6 instead of x to rz; returns notes."""
    wanted = {direction: f"d{k}" for k, direction in DIRECTIONS.items()}
    notes: dict[str, None] = {}
    for i, node in enumerate(model.dof_node):
        number = int(model.node_numbers[node]) if node >= 0 else -1
        if number in frames and model.dof_direction[i] in wanted:
            model.dof_direction[i] = wanted[model.dof_direction[i]]
            model.labels[i] = f"n{number}.{model.dof_direction[i]}"
            notes[frames[number]] = None
    shown = list(notes)[:3] + [f"so do {len(notes) - 3} more"] * (len(notes) > 3)
    return [f"{note}: its directions are called d1 to d6" if note in notes else note for note in shown]


def _by_meshio(path: Path) -> Mesh:
    """Any other format of meshio, without numbers of nodes."""
    meshio = imported("meshio", "meshes are read with")
    to_vtk = imported("meshio._vtk_common", "meshes are read with").meshio_to_vtk_type
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever they meet, or print it and exit
        why = output.getvalue() if isinstance(error, SystemExit) else str(error)
        raise ModelError(
            f"file '{path}' is not a mesh that meshio reads: {' '.join(why.split()) or 'none of its readers takes it'}"
        ) from None
    cells = [(int(to_vtk[block.type]), cell.tolist()) for block in mesh.cells for cell in block.data]
    sets, notes = one_per_name((name, np.unique(np.asarray(at, dtype=np.int64)).tolist()) for name, at in _groups(mesh))
    points = np.hstack([mesh.points, np.zeros((len(mesh.points), 3 - mesh.points.shape[1]))])
    return Mesh(None, points, cells, sets, notes=notes)


def _groups(mesh: Any) -> Iterator[tuple[str, Any]]:
    """Sets of nodes, and the nodes of sets of elements whose names are not taken; groups of MED by their families."""
    points: dict[str, list[Any]] = {name: [at] for name, at in mesh.point_sets.items()}
    cells: dict[str, list[Any]] = {}
    for name, blocks in mesh.cell_sets.items():
        cells[name] = [block.data[at].ravel() for block, at in zip(mesh.cells, blocks) if at is not None]
    for family, names in getattr(mesh, "point_tags", {}).items():
        for name in names:
            points.setdefault(name, []).append(np.flatnonzero(mesh.point_data["point_tags"] == family))
    for family, names in getattr(mesh, "cell_tags", {}).items():
        for name in names:
            of_blocks = zip(mesh.cells, mesh.cell_data["cell_tags"])
            cells.setdefault(name, []).extend(block.data[np.asarray(tags) == family].ravel() for block, tags in of_blocks)
    for name, parts in (cells | points).items():
        yield name, np.concatenate([np.zeros(0, dtype=np.int64), *(np.asarray(part, dtype=np.int64) for part in parts)])
