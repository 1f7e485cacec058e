"""Parts put together in one model: their positions, and pairs of nodes or surfaces where they meet."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag
from scipy.spatial import cKDTree

from nhbm.errors import ModelError
from nhbm.structure import MATRICES, Contact, Recovery, Structure
from nhbm.surfaces import contact


def assemble(parts: dict[str, Structure], offsets: dict[str, tuple[float, ...]] | None = None) -> Structure:
    """One model of several parts, which nothing couples yet. Nodes of later parts are numbered on from those before; sets and loads
    bear the name of their part, `lower_top`, as modes of reduced parts do, `lower.q1`. `offsets`: shifts of the parts."""
    offsets = offsets or {}
    unknown = set(offsets) - set(parts)
    if unknown:
        raise ModelError(f"there is no part '{sorted(unknown)[0]}'; parts: {', '.join(parts)}")
    models = list(parts.values())
    joined = [name for name, model in parts.items() if model.contacts]
    if joined:
        raise ModelError(f"part '{joined[0]}' has contacts between surfaces: name these when all parts are put together")
    are_reduced = [model.recovery is not None for model in models]
    if any(are_reduced) and not all(are_reduced):
        one, other = (list(parts)[are_reduced.index(is_reduced)] for is_reduced in (True, False))
        raise ModelError(f"part '{one}' is a reduced model and '{other}' is none: put either kind together, not both")
    labels, numbers, coordinates, nodes, cell_nodes, cell_starts = [], [], [], [], [], [np.zeros(1, dtype=np.int64)]
    sets: dict[str, Any] = {}
    loads: dict[str, Any] = {}
    recovered, recovered_directions = [], []
    n_nodes = n_dofs = highest = n_cell_nodes = 0
    for name, model in parts.items():
        moved = model.node_numbers + highest
        for label, node, direction in zip(model.labels, model.dof_node, model.dof_direction):
            labels.append(f"n{moved[node]}.{direction}" if node >= 0 else f"{name}.{label}")
        numbers.append(moved)
        coordinates.append(model.coordinates + np.asarray(offsets.get(name, (0.0, 0.0, 0.0))))
        nodes.append(np.where(model.dof_node >= 0, model.dof_node + n_nodes, -1))
        cell_nodes.append(model.cell_nodes + n_nodes)
        cell_starts.append(model.cell_starts[1:] + n_cell_nodes)
        sets |= {f"{name}_{key}": members + n_nodes for key, members in model.sets.items()}
        loads |= {f"{name}_{key}": (dofs + n_dofs, values) for key, (dofs, values) in model.loads.items()}
        if model.recovery is not None:
            recovered.append(model.recovery.node + n_nodes)
            recovered_directions += list(model.recovery.direction)
        n_nodes += len(moved)
        n_dofs += model.n_dofs
        n_cell_nodes += len(model.cell_nodes)
        highest = int(max(moved, default=highest))
    matrices = {}
    for name in MATRICES:
        blocks = [getattr(model, name) for model in models]
        if any(block is not None for block in blocks):
            empty = [sp.csr_matrix((model.n_dofs,) * 2) for model in models]
            matrices[name] = sp.block_diag([e if b is None else b for b, e in zip(blocks, empty)], format="csr")
    return Structure(
        **matrices,
        labels=labels,
        units=[unit for model in models for unit in model.units],
        node_numbers=np.concatenate(numbers),
        coordinates=np.vstack(coordinates),
        dof_node=np.concatenate(nodes),
        dof_direction=[direction for model in models for direction in model.dof_direction],
        cell_types=np.concatenate([model.cell_types for model in models]),
        cell_starts=np.concatenate(cell_starts),
        cell_nodes=np.concatenate(cell_nodes),
        sets=sets,
        loads=loads,
        unit_system=models[0].unit_system,
        source=" + ".join(model.source for model in models),
        recovery=Recovery(block_diag(*(model.recovery.matrix for model in models)), np.concatenate(recovered), recovered_directions)
        if recovered
        else None,
    )


def meeting_nodes(model: Structure, first: str, second: str, within: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of two sets that stand at the same positions, or no farther apart than `within`, first with first."""
    for name in (first, second):
        if name not in model.sets:
            raise ModelError(f"there is no set '{name}'; sets: {', '.join(model.sets) or 'none'}")
    a, b = (np.asarray(model.sets[name]) for name in (first, second))
    tree = cKDTree(model.coordinates[b])
    size = np.ptp(model.coordinates[np.concatenate([a, b])], axis=0).max()
    rounding = 1.0e-12 * abs(model.coordinates).max()  # of positions, where sets of one node have no size
    distance, nearest = tree.query(model.coordinates[a])
    meets = distance <= max(within, 1.0e-6 * size, rounding)
    if not meets.any():
        raise ModelError(f"no node of '{first}' meets one of '{second}'; the closest are {distance.min():.3g} apart")
    if len(set(nearest[meets].tolist())) < meets.sum():
        raise ModelError(f"two nodes of '{first}' meet the same node of '{second}'")
    return a[meets], b[nearest[meets]]


def add_pair(model: Structure, name: str, first: str, second: str, within: float = 0.0, partial: bool = False) -> int:
    """Names the nodes where two sets meet, `<name>_1` of the first and `<name>_2` of the second; returns how many. Each node of the
    smaller set must meet one of the other, unless `partial`: nodes of meshes that do not match meet by chance."""
    a, b = meeting_nodes(model, first, second, within)
    n_first, n_second = len(model.sets[first]), len(model.sets[second])
    if len(a) < min(n_first, n_second) and not partial:
        raise ModelError(
            f"{len(a)} nodes of '{first}' ({n_first}) and '{second}' ({n_second}) meet; pairs need meshes that match where the "
            "sets meet; --within pairs nodes at a distance, --partial pairs the nodes that meet"
        )
    model.sets |= {f"{name}_1": a, f"{name}_2": b}
    model.validate()
    return len(a)


def add_surfaces(model: Structure, name: str, first: str, second: str, within: float = 0.0) -> Contact:
    """Names the contact between two sets of nodes whose faces meet, or are no farther apart than `within` [m], whatever their
    meshes; `reduce` keeps its directions `<name>.n`, `.s` and `.t`."""
    if name in model.contacts or name in model.sets:
        raise ModelError(f"there is a set or a contact '{name}' already")
    if model.recovery is not None:
        raise ModelError("the model is reduced: name the surfaces of the full one")
    model.contacts[name] = contact(model, first, second, within)
    model.validate()
    return model.contacts[name]
