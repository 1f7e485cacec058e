"""Wheels of equal sectors: the whole wheel from one sector, and its frequencies by nodal diameter.

The sector stands at the angle zero of the axis z and repeats every 2 pi/N. In the wheel nodes move along their own radius (`r`) and
across it (`t`) in place of x and y, so that matrices of all sectors are the same and nodes where sectors meet have one motion.
With y_i the degrees of freedom of sector i without those at its high side, x_i = A y_i + B y_(i+1); a wave of h nodal diameters has
y_(i+1) = exp(i h 2 pi/N) y_i, which leaves a Hermitian problem of one sector (Thomas, Int. J. Num. Meth. Eng. 14 (1979)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from nhbm.assembly import meeting_nodes
from nhbm.errors import ModelError
from nhbm.model import Model

POLAR = {"x": "r", "y": "t"}


@dataclass
class Sector:
    """A sector in polar directions, and what it shares with the next one."""

    model: Model
    n_sectors: int
    own: np.ndarray  # degrees of freedom that are not those of the high side
    inside: sp.csr_matrix  # A, (n_dofs, n_own)
    shared: sp.csr_matrix  # B
    twin: dict[int, int]  # nodes of the high side: that of the low side


def sector_of(model: Model, n_sectors: int, low: str, high: str) -> Sector:
    """Prepares a sector of which the set `low`, turned by 2 pi/n_sectors, meets the set `high`."""
    if n_sectors < 3:
        raise ModelError(f"a wheel has three sectors or more, not {n_sectors}")
    for name in (low, high):
        if name not in model.sets:
            raise ModelError(f"there is no set '{name}'; sets: {', '.join(model.sets) or 'none'}")
    polar = _polar(model)
    angle = 2 * np.pi / n_sectors
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = Model(**{**vars(model), "coordinates": model.coordinates.copy(), "recovery": None})
    turned.coordinates[model.sets[low]] = model.coordinates[model.sets[low]] @ turn.T
    a, b = meeting_nodes(turned, low, high)
    if len(a) != len(model.sets[low]) or len(a) != len(model.sets[high]):
        raise ModelError(f"'{low}' turned by 2 pi/{n_sectors} has {len(a)} nodes in common with '{high}', "
                         f"of {len(model.sets[low])} and {len(model.sets[high])}")  # fmt: skip
    twin = dict(zip(b.tolist(), a.tolist()))
    at = {(int(node), d): i for i, (node, d) in enumerate(zip(polar.dof_node, polar.dof_direction))}
    own = np.array([i for i, node in enumerate(polar.dof_node) if int(node) not in twin])
    place = {int(dof): k for k, dof in enumerate(own)}
    rows, columns = [], []
    for (node, direction), dof in at.items():
        if node in twin:
            if (twin[node], direction) not in at:
                raise ModelError(f"'{polar.labels[dof]}' of '{high}' moves and its partner in '{low}' does not")
            rows.append(dof)
            columns.append(place[at[twin[node], direction]])
    shape = (model.n_dofs, len(own))
    inside = sp.csr_matrix((np.ones(len(own)), (own, np.arange(len(own)))), shape=shape)
    shared = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=shape)
    return Sector(polar, n_sectors, own, inside, shared, twin)


def _polar(model: Model) -> Model:
    """The model with r and t in place of x and y at each node."""
    if set(model.dof_direction) & {"rx", "ry", ""}:
        raise ModelError("a sector moves along x, y and z; degrees of freedom that are rotations about x or y are not known here")
    phi = np.arctan2(model.coordinates[:, 1], model.coordinates[:, 0])
    at = {(int(node), d): i for i, (node, d) in enumerate(zip(model.dof_node, model.dof_direction))}
    turn = sp.lil_matrix(sp.identity(model.n_dofs))
    for (node, direction), i in at.items():
        if direction == "x":
            if (node, "y") not in at:
                raise ModelError(f"'{model.labels[i]}' moves along x and not along y")
            j, c, s = at[node, "y"], np.cos(phi[node]), np.sin(phi[node])
            turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c  # x = c r - s t, y = s r + c t
    turn = turn.tocsr()
    loads = {}
    for name, (dofs, values) in model.loads.items():
        full = np.zeros(model.n_dofs)
        np.add.at(full, dofs, values)
        full = turn.T @ full
        loads[name] = (np.flatnonzero(full), full[full != 0])
    directions = [POLAR.get(d, d) for d in model.dof_direction]
    changed = {name: sp.csr_matrix(turn.T @ m @ turn) for name, m in model.matrices().items()}
    labels = [f"n{model.node_numbers[node]}.{d}" for node, d in zip(model.dof_node, directions)]
    return Model(**{**vars(model), **changed, "labels": labels, "dof_direction": directions, "loads": loads, "recovery": None})


def frequencies(sector: Sector, diameter: int, n: int) -> np.ndarray:
    """The n lowest frequencies [rad/s] of waves of so many nodal diameters; those between 0 and N/2 belong to two waves each."""
    wave = sector.inside + np.exp(2j * np.pi * diameter / sector.n_sectors) * sector.shared
    stiffness, mass = ((wave.conj().T @ m @ wave).toarray() for m in (sector.model.stiffness, sector.model.mass))
    values = scipy.linalg.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, min(n, len(mass)) - 1])
    return np.sqrt(np.maximum(values, 0.0))


def wheel(sector: Sector) -> Model:
    """The whole wheel. Sets have their nodes sector by sector; nodes of sector i are numbered on from those of the one before."""
    model, n = sector.model, sector.n_sectors
    own_nodes = np.array([i for i in range(len(model.node_numbers)) if i not in sector.twin])
    place = {int(node): k for k, node in enumerate(own_nodes)}
    step = int(model.node_numbers.max())
    next_one = sp.csr_matrix(np.roll(np.eye(n), 1, axis=1))  # row i: one at sector i + 1

    def node_of(node: int, i: int) -> int:
        if node in place:
            return place[node] + i * len(own_nodes)
        return place[sector.twin[node]] + (i + 1) % n * len(own_nodes)

    def expand(matrix):
        a, b = sector.inside, sector.shared
        across = sp.kron(next_one, a.T @ matrix @ b)
        back = sp.kron(next_one.T, b.T @ matrix @ a)
        return sp.csr_matrix(sp.kron(sp.identity(n), a.T @ matrix @ a + b.T @ matrix @ b) + across + back)

    angles = 2 * np.pi * np.arange(n) / n
    numbers = np.concatenate([model.node_numbers[own_nodes] + i * step for i in range(n)])
    x, y, z = model.coordinates[own_nodes].T
    points = [np.column_stack([x * np.cos(t) - y * np.sin(t), x * np.sin(t) + y * np.cos(t), z]) for t in angles]
    dof_node = np.concatenate([[node_of(int(node), i) for node in model.dof_node[sector.own]] for i in range(n)])
    directions = [model.dof_direction[dof] for dof in sector.own] * n
    sizes = np.diff(model.cell_starts)
    return Model(
        **{name: expand(matrix) for name, matrix in model.matrices().items()},
        labels=[f"n{numbers[node]}.{d}" for node, d in zip(dof_node, directions)],
        units=[model.units[dof] for dof in sector.own] * n,
        node_numbers=numbers,
        coordinates=np.vstack(points),
        dof_node=dof_node,
        dof_direction=directions,
        cell_types=np.tile(model.cell_types, n),
        cell_starts=np.concatenate([[0], np.cumsum(np.tile(sizes, n))]),
        cell_nodes=np.array([node_of(int(node), i) for i in range(n) for node in model.cell_nodes], dtype=np.int64),
        sets={name: np.array([node_of(int(k), i) for i in range(n) for k in members if int(k) in place])
              for name, members in model.sets.items() if set(members.tolist()) - set(sector.twin)},
        unit_system=model.unit_system,
        source=f"{model.source}; wheel of {n} sectors",
    )  # fmt: skip


def add_neighbours(model: Model, name: str, high: str, low: str, n_sectors: int) -> None:
    """Names a set of each sector, and that of the next sector which it faces, `<name>_1` and `<name>_2`."""
    for one in (high, low):
        if one not in model.sets:
            raise ModelError(f"there is no set '{one}'; sets: {', '.join(model.sets) or 'none'}")
    a, b = (model.sets[one] for one in (high, low))
    if len(a) != len(b):
        raise ModelError(f"'{high}' has {len(a)} nodes and '{low}' {len(b)}; neighbours have as many")
    model.sets |= {f"{name}_1": a, f"{name}_2": np.roll(b, -len(b) // n_sectors)}
    model.validate()


def add_wave(model: Model, name: str, where: str, diameter: int, n_sectors: int) -> None:
    """Vectors of loads `<name>_cos` and `<name>_sin` of a wave that has so many nodal diameters: 1 N times the cosine and sine of
    its phase at each sector. Their cosine and sine in time make a wave that turns."""
    dofs = np.array(model.dofs_of(where))
    phase = 2 * np.pi * diameter * np.repeat(np.arange(n_sectors), len(dofs) // n_sectors) / n_sectors
    model.loads |= {f"{name}_cos": (dofs, np.cos(phase)), f"{name}_sin": (dofs, np.sin(phase))}
