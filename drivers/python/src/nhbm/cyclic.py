"""Wheels of equal sectors: the whole wheel from one sector, and its frequencies by nodal diameter.

The sector stands at the angle zero of the axis z and repeats every 2 pi/N. In the wheel nodes move along their own radius (`r`) and
across it (`t`) instead of x and y, so that matrices of all sectors are the same and nodes where sectors meet have one motion.
With y_i the degrees of freedom of sector i without those at its high side, x_i = A y_i + B y_(i+1); a wave of h nodal diameters has
y_i = c cos(i h 2 pi/N) + s sin(i h 2 pi/N). Then c - i s belongs to a Hermitian problem of one sector (Thomas, Int. J. Num. Meth.
Eng. 14 (1979)), which is a real symmetric one in c and s. Models of all nodal diameters, each reduced by itself, make up a reduced
wheel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.assembly import meeting_nodes
from nhbm.errors import ModelError
from nhbm.factors import lowest_modes, symmetric_part
from nhbm.structure import Recovery, Structure
from nhbm.reduction import MODAL, load_matrix, reduce

POLAR = {"x": "r", "y": "t"}


@dataclass
class Sector:
    """A sector in polar directions, and what it shares with the next one."""

    model: Structure
    n_sectors: int
    own: np.ndarray  # degrees of freedom that are not those of the high side
    inside: sp.csr_matrix  # A, (n_dofs, n_own)
    shared: sp.csr_matrix  # B
    twin: dict[int, int]  # nodes of the high side: that of the low side

    def pairs(self) -> tuple[list[str], list[str]]:
        """Degrees of freedom of the low side and those of the high side, in the same order: what `Model.sector` joins."""
        high, column = self.shared.nonzero()
        return [self.model.labels[dof] for dof in self.own[column]], [self.model.labels[dof] for dof in high]


def sector_of(model: Structure, n_sectors: int, low: str, high: str) -> Sector:
    """Prepares a sector of which the set `low`, turned by 2 pi/n_sectors, meets the set `high`."""
    if n_sectors < 3:
        raise ModelError(f"a wheel has three sectors or more, not {n_sectors}")
    if model.contacts:
        raise ModelError("a sector has no contacts between surfaces: pair sets of neighbours (--neighbours)")
    for name in (low, high):
        if name not in model.sets:
            raise ModelError(f"there is no set '{name}'; sets: {', '.join(model.sets) or 'none'}")
    polar = _polar(model)
    angle = 2 * np.pi / n_sectors
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = Structure(**{**vars(model), "coordinates": model.coordinates.copy(), "recovery": None})
    turned.coordinates[model.sets[low]] = model.coordinates[model.sets[low]] @ turn.T
    a, b = meeting_nodes(turned, low, high)
    if len(a) != len(model.sets[low]) or len(a) != len(model.sets[high]):
        raise ModelError(f"'{low}' turned by 2 pi/{n_sectors} has {len(a)} nodes in common with '{high}', "
                         f"of {len(model.sets[low])} and {len(model.sets[high])}")  # fmt: skip
    twin = dict(zip(b.tolist(), a.tolist()))
    at = {(int(node), d): i for i, (node, d) in enumerate(zip(polar.dof_node, polar.dof_direction))}
    own = np.array([i for i, node in enumerate(polar.dof_node) if int(node) not in twin])
    column_of = {int(dof): k for k, dof in enumerate(own)}
    rows, columns = [], []
    for (node, direction), dof in at.items():
        if node in twin:
            if (twin[node], direction) not in at:
                raise ModelError(f"'{polar.labels[dof]}' of '{high}' moves and its partner in '{low}' does not")
            rows.append(dof)
            columns.append(column_of[at[twin[node], direction]])
    shape = (model.n_dofs, len(own))
    inside = sp.csr_matrix((np.ones(len(own)), (own, np.arange(len(own)))), shape=shape)
    shared = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=shape)
    return Sector(polar, n_sectors, own, inside, shared, twin)


def _polar(model: Structure) -> Structure:
    """The model with r and t instead of x and y at each node."""
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
    return Structure(**{**vars(model), **changed, "labels": labels, "dof_direction": directions, "loads": loads, "recovery": None})


def frequencies(sector: Sector, diameter: int, n: int) -> np.ndarray:
    """The n lowest frequencies [rad/s] of waves of so many nodal diameters; those between 0 and N/2 belong to two waves each."""
    wave = nodal_diameter(sector, diameter)
    n_parts = wave.n_dofs // len(sector.own)
    n = min(n, len(sector.own))
    mass = np.where(wave.mass.diagonal() > 0, wave.mass.diagonal(), np.inf)
    shift = 1.0e-6 * float(np.median(wave.stiffness.diagonal() / mass))
    values, _ = lowest_modes(symmetric_part(wave.stiffness), wave.mass, n_parts * n, shift)
    return np.sqrt(np.maximum(values[::n_parts], 0.0))


def nodal_diameter(sector: Sector, diameter: int, neighbours: dict[str, tuple[str, str]] | None = None) -> Structure:
    """The wave of so many nodal diameters as a model of the amplitudes c and s of one sector; of c alone for 0 and N/2.

    The nodes of s are copies with numbers of their own, sets of them are called `<set>_sin`. For each of `neighbours`, a set and
    that of the next sector which it faces, the pairs `<name>_1`, `<name>_2` and `<name>_sin_1`,
    `<name>_sin_2` hold the first and the second, in the phase of the next sector.
    """
    model, n_own = sector.model, len(sector.own)
    angle = 2 * np.pi * diameter / sector.n_sectors
    wave = sector.inside + np.exp(1j * angle) * sector.shared
    is_single = 2 * diameter % sector.n_sectors == 0
    turn, turned_nodes = _turn_to_next(sector, angle, neighbours or {})
    if is_single:
        turn = turn[:n_own, :n_own]

    def doubled(matrix: Any) -> Any:
        x = wave.conj().T @ matrix @ wave
        return turn.T @ (x.real if is_single else sp.bmat([[x.real, x.imag], [-x.imag, x.real]])) @ turn

    numbers, n_nodes = model.node_numbers, len(model.node_numbers)
    parts = [0] if is_single else [0, 1]
    coordinates = model.coordinates.copy()
    x, y, _ = coordinates[turned_nodes].T
    t = 2 * np.pi / sector.n_sectors
    coordinates[turned_nodes, :2] = np.column_stack([x * np.cos(t) - y * np.sin(t), x * np.sin(t) + y * np.cos(t)])
    dof_node = np.concatenate([model.dof_node[sector.own] + part * n_nodes for part in parts])
    all_numbers = np.concatenate([numbers + part * numbers.max() for part in parts])
    directions = [model.dof_direction[dof] for dof in sector.own] * len(parts)
    sets = {}
    own_nodes = set(model.dof_node[sector.own].tolist())
    for part in parts:
        ending = "_sin" * part
        for name, members in model.sets.items():
            own_members = np.array([node for node in members if int(node) in own_nodes], dtype=np.int64)
            if len(own_members) and not set(own_members.tolist()) & set(turned_nodes.tolist()):
                sets[name + ending] = own_members + part * n_nodes
        for name, (high, low) in (neighbours or {}).items():
            sets |= {f"{name}{ending}_{k}": model.sets[one] + part * n_nodes for k, one in ((1, high), (2, low))}
    return Structure(
        **{name: doubled(matrix) for name, matrix in model.matrices().items()},
        labels=[f"n{all_numbers[node]}.{d}" for node, d in zip(dof_node, directions)],
        units=[model.units[dof] for dof in sector.own] * len(parts),
        node_numbers=all_numbers,
        coordinates=np.vstack([coordinates] * len(parts)),
        dof_node=dof_node,
        dof_direction=directions,
        sets=sets,
        unit_system=model.unit_system,
        source=f"{model.source}; {diameter} nodal diameters of {sector.n_sectors} sectors",
    )


def _turn_to_next(sector: Sector, angle: float, neighbours: dict[str, tuple[str, str]]) -> tuple[sp.csr_matrix, np.ndarray]:
    """(c, s) = turn (c', s'), with c', s' of the next sector at the second sets of neighbours, and the nodes of these."""
    model = sector.model
    own_nodes = set(model.dof_node[sector.own].tolist())
    for name, (high, low) in neighbours.items():
        _same_number(model, high, low)
        for one in (high, low):
            missing = [int(node) for node in model.sets[one] if int(node) not in own_nodes]
            if missing:
                number = model.node_numbers[missing[0]]
                raise ModelError(f"pair '{name}': node {number} of '{one}' is held, or belongs to the next sector")
    turned = np.array(sorted({int(node) for _, low in neighbours.values() for node in model.sets[low]}), dtype=np.int64)
    if set(turned.tolist()) & {int(node) for high, _ in neighbours.values() for node in model.sets[high]}:
        raise ModelError("a node that faces the sector before faces the next one, too")
    is_turned = np.isin(model.dof_node[sector.own], turned)
    cosine = sp.diags(np.where(is_turned, np.cos(angle), 1.0))
    sine = sp.diags(np.where(is_turned, np.sin(angle), 0.0))
    return sp.csr_matrix(sp.bmat([[cosine, -sine], [sine, cosine]])), turned


@dataclass
class Wave:
    """A wave of loads, 1 N at each degree of freedom of a sector."""

    where: str
    diameter: int


@dataclass
class Reduction:
    """Retained degrees of freedom of a wheel, and the method of reduction."""

    keep: list[str]
    n_modes: int  # of each nodal diameter; of those with two waves pairs
    method: str = MODAL[0]
    neighbours: dict[str, tuple[str, str]] = field(default_factory=dict)
    waves: dict[str, Wave] = field(default_factory=dict)


LARGEST_RECOVERY = 2.0e8  # entries


@dataclass
class _Part:
    """A nodal diameter: its model, what is left of it, and what that is in the degrees of freedom of the reduced wheel."""

    full: Structure
    reduced: Structure
    waves: np.ndarray  # cosine and sine of its phase at each sector, (n_sectors, n_parts)
    weight: float  # of its energies in those of the wheel
    embedding: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # (reduced.n_dofs, n_dofs)

    @property
    def n_retained(self) -> int:
        """Of one sector."""
        return sum(label[0] != "q" for label in self.reduced.labels) // self.waves.shape[1]


def reduced_wheel(
    sector: Sector, wanted: Reduction, diameter: int | None = None
) -> tuple[Structure, list[tuple[Structure, Structure]]]:
    """A small model of a wheel that never was put together: retained degrees of freedom of all sectors, and modes of each nodal
    diameter. Beside it the model of each diameter and what it was reduced to, to compare.

    With a diameter that of its waves alone: what is retained are the amplitudes c and s, those of s behind those of c in each set.
    """
    n = sector.n_sectors
    chosen = list(range(n // 2 + 1)) if diameter is None else [min(diameter % n, -diameter % n)]
    parts = []
    for d in chosen:
        phase = 2 * np.pi * d / n * np.arange(n)
        waves = np.column_stack([np.cos(phase), np.sin(phase)][: 1 if 2 * d % n == 0 else 2])
        parts.append(_Part(*_reduced_wave(sector, wanted, d), waves, (waves[:, 0] ** 2).sum() if diameter is None else 1.0))
    n_retained = parts[0].n_retained * (n if diameter is None else parts[0].waves.shape[1])
    starts = n_retained + np.cumsum([0] + [part.reduced.n_dofs - part.n_retained * part.waves.shape[1] for part in parts])
    for part, start, end in zip(parts, starts[:-1], starts[1:]):
        amplitudes = part.waves.T / part.weight if diameter is None else np.eye(part.waves.shape[1])
        part.embedding = np.zeros((part.reduced.n_dofs, starts[-1]))
        part.embedding[: start - end or None, :n_retained] = np.kron(amplitudes, np.eye(part.n_retained))
        part.embedding[len(part.embedding) - (end - start) :, start:end] = np.eye(end - start) / np.sqrt(part.weight)
    matrices: dict[str, Any] = {}
    loads: dict[str, Any] = {}
    for part in parts:
        for name, matrix in part.reduced.matrices().items():
            matrices[name] = matrices.get(name, 0.0) + part.weight * (part.embedding.T @ (matrix @ part.embedding))
        for name, vector in zip(part.reduced.loads, load_matrix(part.reduced).T):
            loads[name] = (np.arange(starts[-1]), part.weight * (part.embedding.T @ vector))
    body = _body(sector)
    retained = _retained_nodes(sector, body, parts[0], range(n) if diameter is None else None)
    n_modes = int(starts[-1]) - n_retained
    model = Structure(
        **{name: sp.csr_matrix(matrix) for name, matrix in matrices.items()},
        labels=[f"n{retained['node_numbers'][node]}.{d}" for node, d in zip(retained["dof_node"], retained["dof_direction"])]
        + [f"q{i + 1}" for i in range(n_modes)],
        units=retained["units"] + ["m"] * n_modes,
        node_numbers=retained["node_numbers"],
        coordinates=retained["coordinates"],
        dof_node=np.array(retained["dof_node"] + [-1] * n_modes),
        dof_direction=retained["dof_direction"] + [""] * n_modes,
        **{name: body[name] for name in ("cell_types", "cell_starts", "cell_nodes")},
        sets=retained["sets"],
        loads=loads,
        unit_system=sector.model.unit_system,
        source=f"{sector.model.source}; wheel of {n} sectors, " + f"{chosen[0]} nodal diameters, " * (diameter is not None)
        + f"{wanted.method}, {n_modes} modes",
        recovery=_recovery(sector, wanted, parts, body),
    )  # fmt: skip
    return model, [(part.full, part.reduced) for part in parts]


def _recovery(sector: Sector, wanted: Reduction, parts: list[_Part], body: dict[str, Any]) -> Recovery | None:
    """All degrees of freedom of the wheel; none where that would be too many numbers."""
    n_rows, size = sector.n_sectors * len(sector.own), parts[0].embedding.shape[1]
    if n_rows * size > LARGEST_RECOVERY:
        return None
    matrix = np.zeros((n_rows, size))
    for part in parts:
        angle = np.arctan2(part.waves[1, 1], part.waves[1, 0]) if part.waves.shape[1] == 2 else np.arccos(part.waves[1, 0])
        turn, _ = _turn_to_next(sector, angle, wanted.neighbours)
        amplitudes = turn[: part.full.n_dofs, : part.full.n_dofs] @ part.reduced.recovery.matrix @ part.embedding
        whole = amplitudes.reshape(part.waves.shape[1], len(sector.own), size)
        matrix += np.tensordot(part.waves, whole, axes=1).reshape(n_rows, size)
    return Recovery(matrix, body["dof_node"], body["dof_direction"])


def _reduced_wave(sector: Sector, wanted: Reduction, diameter: int) -> tuple[Structure, Structure]:
    """The model of a nodal diameter with its loads, and what is left of it."""
    full = nodal_diameter(sector, diameter, wanted.neighbours)
    n = sector.n_sectors
    n_parts = full.n_dofs // len(sector.own)
    for name, wave in wanted.waves.items():
        h = wave.diameter % n
        if diameter not in (h, (n - h) % n):
            continue
        dofs = np.array(full.dofs_of(wave.where))
        full.loads[f"{name}_cos"] = (dofs, np.ones(len(dofs)))
        if n_parts == 2:
            full.loads[f"{name}_sin"] = (dofs + len(sector.own), np.full(len(dofs), 1.0 if h == diameter else -1.0))
    keep = wanted.keep if n_parts == 1 else [*wanted.keep, *(_of_sine(full, sector, name) for name in wanted.keep)]
    return full, reduce(full, keep, n_parts * wanted.n_modes, wanted.method)


def _of_sine(full: Structure, sector: Sector, name: str) -> str:
    """What a degree of freedom, set or pair of c is called for s."""
    if name in full.labels:
        return full.labels[full.labels.index(name) + len(sector.own)]
    stem, dot, direction = (name, "", "") if name in full.sets else name.rpartition(".")
    return f"{stem}_sin{dot}{direction}"


def _retained_nodes(sector: Sector, body: dict[str, Any], part: _Part, sectors: range | None) -> dict[Any, Any]:
    """Retained nodes, degrees of freedom and sets of all sectors or, without these, of both amplitudes of a wave. Pairs, and sines
    of other nodes, have nodes of their own behind those of the wheel."""
    reduced, n_retained = part.reduced, part.n_retained
    numbers, coordinates = list(body["node_numbers"]), list(body["coordinates"])
    found: dict[tuple[int, int], int] = {}

    def node_of(node: int, copy: int) -> int:
        is_pair = node >= len(part.full.node_numbers)
        if not is_pair and (sectors is not None or copy == 0):
            return body["node_of"](node, copy)
        if (node, copy) not in found:
            found[node, copy] = len(numbers)
            numbers.append(max(numbers[-1], int(body["node_numbers"].max())) + 1)
            t = 2 * np.pi * copy / sector.n_sectors if sectors is not None else 0.0
            x, y, z = reduced.coordinates[node]
            coordinates.append([x * np.cos(t) - y * np.sin(t), x * np.sin(t) + y * np.cos(t), z])
        return found[node, copy]

    copies = range(part.waves.shape[1]) if sectors is None else sectors
    moving = set(reduced.dof_node[:n_retained].tolist())
    dof_node = [node_of(int(node), copy) for copy in copies for node in reduced.dof_node[:n_retained]]
    sets = {
        name: np.array([node_of(int(node), copy) for copy in copies for node in members])
        for name, members in reduced.sets.items()
        if set(np.asarray(members).tolist()) <= moving
    }
    return {
        "node_numbers": np.array(numbers, dtype=np.int64),
        "coordinates": np.array(coordinates),
        "dof_node": dof_node,
        "dof_direction": reduced.dof_direction[:n_retained] * len(copies),
        "units": reduced.units[:n_retained] * len(copies),
        "sets": sets,
    }


def _body(sector: Sector) -> dict[str, Any]:
    """Nodes, degrees of freedom and cells of the whole wheel, and where a node of sector i is. Nodes of sector i are numbered on
    from those of the one before."""
    model, n = sector.model, sector.n_sectors
    own_nodes = np.array([i for i in range(len(model.node_numbers)) if i not in sector.twin])
    index = {int(node): k for k, node in enumerate(own_nodes)}
    step = int(model.node_numbers.max())

    def node_of(node: int, i: int) -> int:
        if node in index:
            return index[node] + i * len(own_nodes)
        return index[sector.twin[node]] + (i + 1) % n * len(own_nodes)

    angles = 2 * np.pi * np.arange(n) / n
    x, y, z = model.coordinates[own_nodes].T
    points = [np.column_stack([x * np.cos(t) - y * np.sin(t), x * np.sin(t) + y * np.cos(t), z]) for t in angles]
    return {
        "node_numbers": np.concatenate([model.node_numbers[own_nodes] + i * step for i in range(n)]),
        "coordinates": np.vstack(points),
        "dof_node": np.concatenate([[node_of(int(node), i) for node in model.dof_node[sector.own]] for i in range(n)]),
        "dof_direction": [model.dof_direction[dof] for dof in sector.own] * n,
        "cell_types": np.tile(model.cell_types, n),
        "cell_starts": np.concatenate([[0], np.cumsum(np.tile(np.diff(model.cell_starts), n))]),
        "cell_nodes": np.array([node_of(int(node), i) for i in range(n) for node in model.cell_nodes], dtype=np.int64),
        "node_of": node_of,
    }


def wheel(sector: Sector) -> Structure:
    """The whole wheel. Sets have their nodes sector by sector."""
    model, n, body = sector.model, sector.n_sectors, _body(sector)
    node_of = body.pop("node_of")
    next_one = sp.csr_matrix(np.roll(np.eye(n), 1, axis=1))  # row i: one at sector i + 1

    def expand(matrix: Any) -> Any:
        a, b = sector.inside, sector.shared
        across = sp.kron(next_one, a.T @ matrix @ b)
        back = sp.kron(next_one.T, b.T @ matrix @ a)
        return sp.csr_matrix(sp.kron(sp.identity(n), a.T @ matrix @ a + b.T @ matrix @ b) + across + back)

    sets = {name: [int(k) for k in members if int(k) not in sector.twin] for name, members in model.sets.items()}
    return Structure(
        **{name: expand(matrix) for name, matrix in model.matrices().items()},
        **body,
        labels=[f"n{body['node_numbers'][node]}.{d}" for node, d in zip(body["dof_node"], body["dof_direction"])],
        units=[model.units[dof] for dof in sector.own] * n,
        sets={name: np.array([node_of(k, i) for i in range(n) for k in own]) for name, own in sets.items() if own},
        unit_system=model.unit_system,
        source=f"{model.source}; wheel of {n} sectors",
    )


def add_neighbours(model: Structure, name: str, high: str, low: str, n_sectors: int) -> None:
    """Names a set of each sector, and that of the next sector which it faces, `<name>_1` and `<name>_2`."""
    a, b = _same_number(model, high, low)
    model.sets |= {f"{name}_1": a, f"{name}_2": np.roll(b, -len(b) // n_sectors)}
    model.validate()


def _same_number(model: Structure, high: str, low: str) -> tuple[np.ndarray, np.ndarray]:
    for one in (high, low):
        if one not in model.sets:
            raise ModelError(f"there is no set '{one}'; sets: {', '.join(model.sets) or 'none'}")
    a, b = (model.sets[one] for one in (high, low))
    if len(a) != len(b):
        raise ModelError(f"'{high}' has {len(a)} nodes and '{low}' {len(b)}; neighbours have as many")
    return a, b


def add_wave(model: Structure, name: str, where: str, diameter: int, n_sectors: int) -> None:
    """Vectors of loads `<name>_cos` and `<name>_sin` of a wave that has so many nodal diameters: 1 N times the cosine and sine of
    its phase at each sector. Their cosine and sine in time make a wave that turns."""
    dofs = np.array(model.dofs_of(where))
    phase = 2 * np.pi * diameter * np.repeat(np.arange(n_sectors), len(dofs) // n_sectors) / n_sectors
    model.loads |= {f"{name}_cos": (dofs, np.cos(phase)), f"{name}_sin": (dofs, np.sin(phase))}
