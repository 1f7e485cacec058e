"""Small models of large ones that keep chosen degrees of freedom as they are, with their error against the full model.

Krylov: shapes K_s^-1 B, K_s^-1 M K_s^-1 B, ... of the shifted stiffness K_s = K + s^2 M for forces B at the retained degrees of
freedom and the loads, as many as the flexibility needs up to a frequency (Bai, Appl. Numer. Math. 43 (2002), sections 3 and 5).
Craig-Bampton: x = T [x_b; q], static shapes of the retained degrees of freedom and modes with these held (Craig and Bampton 1968).
Free interface with residual attachment: modes of the free structure, and what they leave of the static response to forces at the
retained degrees of freedom (Rubin 1975, MacNeal 1971); rewritten in the retained degrees of freedom and modes, as Craig-Bampton's.
Of a stiffness that is not symmetric (bearings of fluid, follower forces) the symmetric part gives modes and static shapes, with
those of forces where the rest of it acts; what it is in these is Galerkin's.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from nhbm.errors import ModelError
from nhbm.factors import Factors, dense_values, lowest_modes, symmetric_part
from nhbm.structure import CONTACT_DIRECTIONS, Recovery, Structure
from nhbm.surfaces import contact_of, relative_motion

MODAL = ("free-interface", "craig-bampton")  # with a number of modes
METHODS = ("krylov", *MODAL)
LARGEST_REDUCED = {"krylov": 2000, "free-interface": 5000, "craig-bampton": 5000}  # degrees of freedom, by method
BLOCK = 128  # columns, or a sixteenth of the rows, of a large array that are changed at a time: nothing has a second copy
BAND = np.array([0.1, 0.35, 0.7, 1.0])
ASYMMETRY = 1.0e-9  # of the largest entry, which is rounding
MAX_CIRCULATORY = 60  # degrees of freedom that get static shapes because the skew-symmetric part of the stiffness acts on them
MIN_LEFT = 1.0e-11  # by the modes, of the static flexibility at a combination of retained degrees of freedom
RIGID = 1.0e-3  # frequencies below this share of the band are those of rigid bodies
KRYLOV_TOLERANCE = 1.0e-10  # of the flexibility
GOLDEN = 0.381966  # offset of frequencies that a space was not tuned to
N_RESIDUALS, FIRST_CHANGE = 4, 1.0e-2  # frequencies of a block of residuals, and the change below which these begin
SHIFT = 0.1  # s of K + s^2 M beside the highest frequency
DEPENDENT = 1.0e-11  # what is left of a shape of unit energy beside those before, to leave it out
ROUNDING = 1.0e-12  # of coupling between shapes, beside their own entries
GIB = 2.0**30
_TOLERANCE = "rtol" if "rtol" in inspect.signature(spla.gmres).parameters else "tol"  # SciPy before 1.12


@dataclass
class Report:
    """Errors of a reduced model: relative differences of flexibility at the retained degrees of freedom, and of frequencies."""

    frequencies: np.ndarray  # [rad/s]
    errors: np.ndarray  # of H, largest entry of the difference over the largest entry
    resonances: int = 0  # up to the highest of the frequencies
    resonance_error: float = 0.0  # largest relative difference of one
    seconds: float = 0.0


def reduce(
    model: Structure,
    keep: list[str],
    n_modes: int = 20,
    method: str = MODAL[0],
    up_to: float | None = None,
    tolerance: float = KRYLOV_TOLERANCE,
) -> Structure:
    """Reduced model with the named degrees of freedom or sets, and the vectors of loads as further static shapes.

    By a number of modes, or with 'krylov' by as many shapes as the flexibility needs up to a frequency [rad/s]: to a tolerance,
    relative to its largest entry there. Degrees of freedom of dashpots and bearings are retained then, too.

    The name of a pair, `joint.z` of the sets `joint_1` and `joint_2`, keeps the motion of the first relative to the second, node by
    node, as that of nodes of its own, which form the set `joint`; likewise that of a contact between surfaces, `joint.n`.
    """
    if method not in METHODS:
        raise ModelError(f"method '{method}' is not known; known: {', '.join(METHODS)}")
    if method == "krylov" and up_to is None:
        raise ModelError("method 'krylov' needs the highest frequency that the model is for")
    if model.recovery is not None:
        raise ModelError("the model is reduced already; reduce the full one")
    if abs(model.mass - model.mass.T).max() > ASYMMETRY * abs(model.mass).max():
        raise ModelError("the mass is not symmetric (nhbm-model check reports where)")
    of_contacts = [name for name in keep if contact_of(model, name)]
    if of_contacts:
        others = [name for name in keep if name not in of_contacts]
        rows = {f"{name} {i}": row for name in of_contacts for i, row in enumerate(relative_motion(model, name))}
        loads = {name: (row.indices, row.data) for name, row in rows.items()}
        pushed = replace(model, loads=model.loads | loads, contacts={})
        return _with_contacts(model, of_contacts, reduce(pushed, others, n_modes, method, up_to, tolerance), len(loads))
    full = model
    model, turn = _relative(model, keep)
    retained = list(dict.fromkeys(dof for name in keep for dof in model.dofs_of(name)))
    if not retained and not model.loads:
        raise ModelError("no degrees of freedom are retained; name those of laws and loads")
    n_shapes = len(retained) + len(model.loads) + (n_modes if method in MODAL else 0)
    if n_shapes > LARGEST_REDUCED[method]:
        many = f"{len(retained)} retained degrees of freedom and {n_modes} modes"
        raise ModelError(f"{many} are more than a reduced model may have by the method '{method}', {LARGEST_REDUCED[method]}")
    _check_memory(model.n_dofs, min(n_shapes, model.n_dofs))
    n_modes = min(n_modes, model.n_dofs - len(retained))
    if method == "krylov":
        space = _KrylovSpace(model, retained, up_to)
        retained = space.retained
        basis = space.grown(tolerance)
    else:
        make = _craig_bampton if method == "craig-bampton" else _free_interface
        basis = make(_without_circulation(model), np.array(retained, dtype=int), n_modes)
    reduced = _project(model, np.array(retained, dtype=int), basis, method)
    for columns in _blocks(reduced.n_dofs):
        reduced.recovery.matrix[:, columns] = turn @ reduced.recovery.matrix[:, columns]
    reduced.recovery = Recovery(reduced.recovery.matrix, full.dof_node, full.dof_direction)
    reduced.up_to = up_to if method == "krylov" else None
    return reduced


def _check_memory(n_dofs: int, n_shapes: int) -> None:
    """Refuses what does not fit into memory, before the work begins."""
    needed = 8.0 * (n_dofs * (n_shapes + 5 * BLOCK) + 8 * n_shapes**2)
    there = _available_memory()
    if needed > there:
        raise ModelError(
            f"{n_shapes} shapes of {n_dofs} degrees of freedom need {needed / GIB:.1f} GiB of memory beside the factors of the "
            f"stiffness, {there / GIB:.1f} GiB are available: keep fewer degrees of freedom"
        )


def _available_memory() -> float:
    """Bytes that can be allocated; infinite where the operating system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return np.inf
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), np.inf)


def _blocks(n: int, times: int = 1) -> Iterator[slice]:
    """The numbers 0 to n - 1 in blocks of so many times BLOCK."""
    size = times * BLOCK
    return (slice(i, min(i + size, n)) for i in range(0, n, size))


def _multiply_from_right(matrix: np.ndarray, factor: np.ndarray) -> None:
    """Replaces the first columns of a tall matrix by their product with a factor, in place."""
    for rows in _blocks(len(matrix), 16):
        matrix[rows, : factor.shape[1]] = matrix[rows, : len(factor)] @ factor


def _pair(model: Any, name: Any) -> tuple[str, str, str] | None:
    """Name of a pair and what its two sets are called with the direction; none for what is no pair."""
    stem, _, direction = name.rpartition(".")
    if not stem or name in model.labels or stem in model.sets or not {f"{stem}_1", f"{stem}_2"} <= set(model.sets):
        return None
    return stem, f"{stem}_1.{direction}", f"{stem}_2.{direction}"


def _relative(model: Any, keep: Any) -> tuple[Structure, sp.csr_matrix]:
    """The model in coordinates x = turn @ x' of which those of pairs are differences. These belong to new nodes, halfway."""
    numbers, coordinates, sets = model.node_numbers, model.coordinates, dict(model.sets)
    dof_node, dof_direction, labels = model.dof_node.copy(), list(model.dof_direction), list(model.labels)
    first: list[Any] = []
    second: list[Any] = []
    for pair in filter(None, (_pair(model, name) for name in keep)):
        name, one, other = pair
        a, b = model.dofs_of(one), model.dofs_of(other)
        if len(a) != len(b) or set(a) & set(first + second + b) or set(b) & set(first):
            raise ModelError(f"'{one}' and '{other}' are no pair: the sets must have equal sizes and be disjoint")
        if name not in sets:
            sets[name] = len(numbers) + np.arange(len(a))
            numbers = np.concatenate([numbers, max(numbers) + 1 + np.arange(len(a))])
            middle = (model.coordinates[model.dof_node[a]] + model.coordinates[model.dof_node[b]]) / 2
            coordinates = np.vstack([coordinates, middle])
        for node, dof in zip(sets[name], a):
            dof_node[dof] = node
            labels[dof] = f"n{numbers[node]}.{dof_direction[dof]}"
        first += a
        second += b
    shift = sp.csr_matrix((np.ones(len(first)), (first, second)), shape=(model.n_dofs,) * 2)
    turn = sp.csr_matrix(sp.identity(model.n_dofs) + shift)
    if not first:
        return model, turn
    turned = turn.T @ load_matrix(model)
    changed = replace(
        model,
        **{name: sp.csr_matrix(turn.T @ matrix @ turn) for name, matrix in model.matrices().items()},
        labels=labels,
        node_numbers=numbers,
        coordinates=coordinates,
        dof_node=dof_node,
        dof_direction=dof_direction,
        sets=sets,
        loads={name: (np.flatnonzero(column), column[column != 0]) for name, column in zip(model.loads, turned.T)},
    )
    return changed, turn


def _with_contacts(model: Structure, names: list[str], small: Structure, n_loads: int) -> Structure:
    """A reduced model, which answers forces at the points of contacts by its last `n_loads` loads, in coordinates of which these
    points have one each for every name; the retained degrees of freedom remain."""
    n, kept = small.n_dofs, [i for i, node in enumerate(small.dof_node) if node >= 0]
    others = np.setdiff1d(np.arange(n), kept)
    rows = sp.vstack([relative_motion(model, name) for name in names]) @ small.recovery.matrix
    turn, triangle = np.linalg.qr(rows[:, others].T, mode="complete")
    n_points = len(rows)
    sizes = np.abs(np.diag(triangle))
    if len(sizes) < n_points or sizes.min() <= DEPENDENT * sizes.max():
        raise ModelError(f"the points of {', '.join(names)} do not move independently: use a first surface with a coarser mesh")
    change = np.zeros((n, n))
    change[kept, np.arange(len(kept))] = 1.0
    points, rest = slice(len(kept), len(kept) + n_points), slice(len(kept) + n_points, n)
    change[others, points] = scipy.linalg.solve_triangular(triangle[:n_points], turn[:, :n_points].T).T
    change[others, : len(kept)] = -change[others, points] @ rows[:, kept]
    change[others, rest] = turn[:, n_points:]
    numbers, coordinates, sets, contacts = small.node_numbers, small.coordinates, dict(small.sets), {}
    nodes, directions, labels = list(small.dof_node[kept]), [small.dof_direction[i] for i in kept], [small.labels[i] for i in kept]
    for name in names:
        stem, direction = contact_of(model, name) or ("", "")
        contact = model.contacts[stem]
        if stem not in contacts:
            contacts[stem] = replace(contact, weights=None)
            sets[stem] = len(numbers) + np.arange(len(contact.areas))
            numbers = np.concatenate([numbers, max(numbers) + 1 + np.arange(len(contact.areas))])
            coordinates = np.vstack([coordinates, contact.points])
        nodes += list(sets[stem])
        directions += [direction] * len(contact.areas)
        labels += [f"n{numbers[node]}.{direction}" for node in sets[stem]]
    n_rest = n - len(labels)
    loads = change.T @ load_matrix(small)[:, : len(small.loads) - n_loads]
    turned = replace(
        small,
        **{name: sp.csr_matrix(change.T @ matrix @ change) for name, matrix in small.matrices().items()},
        labels=[*labels, *(f"q{i + 1}" for i in range(n_rest))],
        units=["m"] * n,
        node_numbers=numbers,
        coordinates=coordinates,
        dof_node=np.array([*nodes, *[-1] * n_rest]),
        dof_direction=[*directions, *[""] * n_rest],
        sets=sets,
        loads={name: (np.flatnonzero(column), column[column != 0]) for name, column in zip(small.loads, loads.T)},
        recovery=None,
    )
    found = _project(turned, np.arange(len(labels)), np.identity(n), MODAL[0])
    basis = small.recovery.matrix @ (change @ found.recovery.matrix)
    return replace(found, contacts=contacts, up_to=small.up_to, source=small.source, recovery=replace(small.recovery, matrix=basis))


def is_symmetric(model: Structure) -> bool:
    """Whether the stiffness is symmetric, up to rounding."""
    return abs(model.stiffness - model.stiffness.T).max() <= ASYMMETRY * abs(model.stiffness).max()


def _without_circulation(model: Structure) -> Structure:
    """The model with the symmetric part of its stiffness, and as loads unit forces where the rest acts, if these are few."""
    if is_symmetric(model):
        return model
    symmetric = symmetric_part(model.stiffness)
    rest = abs(model.stiffness - symmetric)
    rest.data[rest.data <= ASYMMETRY * abs(symmetric).max()] = 0.0
    where = np.flatnonzero(np.asarray(rest.sum(axis=1)).ravel())
    if len(where) > MAX_CIRCULATORY:
        where = where[:0]
    forces = {f"circulatory {dof}": (np.array([dof]), np.ones(1)) for dof in where}
    return replace(model, stiffness=symmetric, loads=model.loads | forces)


def load_matrix(model: Structure) -> np.ndarray:
    """The vectors of loads as columns (n_dofs, n_loads)."""
    loads = np.zeros((model.n_dofs, len(model.loads)))
    for i, (dofs, values) in enumerate(model.loads.values()):
        np.add.at(loads[:, i], dofs, values)
    return loads


def _craig_bampton(model: Any, retained: Any, n_modes: Any) -> np.ndarray:
    """Columns: retained degrees of freedom, modes with these held, static shapes of the loads."""
    inside = np.setdiff1d(np.arange(model.n_dofs), retained)
    k, m = model.stiffness, model.mass
    k_ii = sp.csr_matrix(k[inside][:, inside])
    what = "the stiffness with the retained degrees of freedom held (keep more, or leave --method craig-bampton out): it"
    factors: Any = Factors(k_ii, what) if len(inside) else None
    n, n_inside = len(retained), 0
    if len(inside):
        _, shapes = lowest_modes(k_ii, sp.csr_matrix(m[inside][:, inside]), n_modes, 0.0, factors)
        more = np.hstack([shapes, factors.solve(load_matrix(model)[inside])])
        n_inside = more.shape[1]
    basis = np.zeros((model.n_dofs, n + n_inside))
    basis[retained, np.arange(n)] = 1.0
    if len(inside):
        coupling = sp.csc_matrix(k[inside][:, retained])
        for columns in _blocks(n):
            basis[inside, columns] = -factors.solve(coupling[:, columns].toarray())
        basis[inside, n:] = more
    return basis


def _free_interface(model: Any, retained: Any, n_modes: Any) -> np.ndarray:
    """Modes of the free structure and the response to unit forces at the retained degrees of freedom, in a form that has these as
    coordinates. A small shift makes the stiffness of a structure that can move as a whole invertible; static answers are exact
    where there is none."""
    k, m = model.stiffness, model.mass
    shift = 1.0e-4 * float(np.median(k.diagonal() / np.where(m.diagonal() > 0, m.diagonal(), np.inf)))
    for _ in range(6):
        try:
            values, _ = lowest_modes(k, m, min(7, model.n_dofs - 2), shift)
        except ModelError:
            shift *= 10
            continue
        is_elastic = values > 1.0e-6 * max(values.max(), 0.0)
        if is_elastic.all():
            shift = 0.0
        elif is_elastic.any():
            shift = 0.1 * float(values[is_elastic].min())
        break
    factors = Factors(sp.csr_matrix(k + shift * m), "the stiffness with some of the mass (see nhbm-model check): it")
    values, modes = lowest_modes(k, m, n_modes, shift, factors)
    n, n_modes, n_loads = len(retained), modes.shape[1], len(model.loads)
    # modes, answers to unit forces, answers to loads; in the end what is returned
    shapes = np.empty((model.n_dofs, n_modes + n + n_loads))
    shapes[:, :n_modes] = modes
    attachment = shapes[:, n_modes:]
    whole = np.zeros(n + n_loads)
    for columns in _blocks(n + n_loads):
        answers = factors.solve(_forces(model, retained, columns))
        whole[columns] = np.abs(answers).max(axis=0)
        attachment[:, columns] = answers
    del answers, factors
    flexible = attachment[retained, :n]
    # what modes leave of the attachment, as shapes of unit energy like those of the modes; none where they leave nothing
    amplitudes = (m @ modes).T @ attachment
    for rows in _blocks(model.n_dofs, 16):
        attachment[rows] -= modes[rows] @ amplitudes
    scale = np.sqrt(np.diag(flexible))
    left, forces = np.zeros(0), np.zeros((0, 0))
    try:
        if n > 0:
            unit = np.outer(scale, scale)
            left, forces = scipy.linalg.eigh(*((a + a.T) / 2 / unit for a in (attachment[retained, :n], flexible)))
    except np.linalg.LinAlgError:
        raise ModelError("the retained degrees of freedom do not move independently: keep fewer") from None
    some = left > MIN_LEFT
    forces = forces[:, some] / scale[:, None] / np.sqrt(left[some])
    mix = scipy.linalg.block_diag(np.diag(1.0 / np.sqrt(values + shift)), forces)
    del forces, flexible
    boundary, inner = _boundary_and_inner(shapes[retained, : n_modes + n] @ mix)
    factor = mix @ np.hstack([boundary, inner])
    del mix, boundary
    _multiply_from_right(shapes, factor)
    n_shapes = factor.shape[1]
    more = shapes[:, n_modes + n :]
    more = more - shapes[:, :n] @ more[retained]
    known, _ = np.linalg.qr(shapes[:, n:n_shapes])
    more -= known @ (known.T @ more)  # nothing but rounding of loads on retained degrees of freedom
    more = more[:, np.abs(more).max(axis=0, initial=0.0) > 1.0e-9 * whole[n:]]
    shapes[:, n_shapes : n_shapes + more.shape[1]] = more
    return shapes[:, : n_shapes + more.shape[1]]


def _forces(model: Any, retained: Any, columns: slice) -> np.ndarray:
    """Some columns of unit forces at the retained degrees of freedom followed by the loads."""
    n = len(retained)
    forces = np.zeros((model.n_dofs, columns.stop - columns.start))
    here = np.arange(columns.start, min(columns.stop, n))
    forces[retained[here], here - columns.start] = 1.0
    if columns.stop > n:
        first = max(columns.start, n)
        forces[:, first - columns.start :] = load_matrix(model)[:, first - n : columns.stop - n]
    return forces


def _boundary_and_inner(at_retained: Any) -> tuple[np.ndarray, np.ndarray]:
    """Combinations of shapes, from their motion at the retained degrees of freedom (n_retained, n_shapes): those with one at each
    of these, and those that are zero there."""
    n = len(at_retained)
    if n == 0:
        return np.zeros((at_retained.shape[1], 0)), np.identity(at_retained.shape[1])
    turn, triangle = np.linalg.qr(at_retained.T, mode="complete")
    return scipy.linalg.solve_triangular(triangle[:n], turn[:, :n].T).T, turn[:, n:]


class _KrylovSpace:
    """Shapes of unit energy, V' K_s V = 1 with K_s = K + s^2 M, in which a structure answers forces at the retained degrees of
    freedom and its loads; `retained` has also those few where damping, gyroscopic and circulatory terms act that are no sum of mass
    and stiffness, so that these are exact."""

    def __init__(self, model: Any, retained: Any, up_to: Any) -> None:
        self.model, self.up_to, self.shift = model, up_to, SHIFT * up_to
        self.rests = _rests(model)
        touched = np.unique(np.concatenate([np.concatenate(rest.nonzero()) for rest in self.rests] + [np.zeros(0, int)]))
        self.is_general = len(touched) > MAX_CIRCULATORY
        self.retained = retained if self.is_general else list(dict.fromkeys([*retained, *touched.tolist()]))
        unit = np.zeros((model.n_dofs, len(self.retained)))
        unit[self.retained, np.arange(len(self.retained))] = 1.0
        self.forces = self.next = np.hstack([unit, load_matrix(model)])
        self.energy = sp.csr_matrix(symmetric_part(model.stiffness) + self.shift**2 * model.mass)
        self.factors = Factors(self.energy, "the stiffness with some of the mass (see nhbm-model check): it")
        self.basis = np.zeros((model.n_dofs, 0))

    def grown(self, tolerance: Any) -> np.ndarray:
        """Columns: retained degrees of freedom and shapes, of a space that grew until its last block changed the flexibility by
        less than the tolerance, also at frequencies that it was not tuned to."""
        n_cycles, change = 0, np.inf
        while True:
            before = self.basis.shape[1]
            self._extend()
            n = self.basis.shape[1]
            if n == before:
                break  # nothing new: the space is whole
            change = self._change(before, 0.0)
            if change <= tolerance and (n_cycles > 0 or not self.is_general):
                change = max(change, self._change(before, GOLDEN))
                if change <= tolerance:
                    break
            if n > LARGEST_REDUCED["krylov"]:
                raise ModelError(f"{n} shapes leave an error of {change:.1e} up to {self.up_to:g} rad/s: keep fewer degrees of "
                                 "freedom, raise --tolerance, lower --up-to or take modes (--modes)")  # fmt: skip
            if self.is_general and (n_cycles > 0 or change < FIRST_CHANGE):
                n_cycles += 1
                self._continue_with_residuals((GOLDEN * n_cycles) % 1.0)
        _multiply_from_right(self.basis, np.hstack(_boundary_and_inner(self.basis[self.retained])))
        return self.basis

    def _extend(self) -> None:
        """Adds what the structure answers to the next forces, orthonormal; shapes that are none by now are left out."""
        w = self.factors.solve(self.next)
        size = np.sqrt(np.einsum("ij,ij->j", w, self.energy @ w))
        w = self._without_basis(w[:, size > 0] / size[size > 0])
        shapes, forces = np.zeros_like(w), np.zeros_like(w)
        n = 0
        for column in w.T:
            for _ in range(2):
                column = column - shapes[:, :n] @ (forces[:, :n].T @ column)
            force = self.energy @ column
            norm = np.sqrt(max(column @ force, 0.0))
            if norm > DEPENDENT:
                shapes[:, n], forces[:, n] = column / norm, force / norm
                n += 1
        shapes = self._without_basis(shapes[:, :n])
        if n:
            triangle = np.linalg.cholesky(shapes.T @ (self.energy @ shapes))
            shapes = scipy.linalg.solve_triangular(triangle, shapes.T, lower=True).T
        self.basis = np.hstack([self.basis, shapes])
        self.next = self.model.mass @ shapes

    def _without_basis(self, w: Any) -> np.ndarray:
        for _ in range(2):
            w = w - self.basis @ (self.basis.T @ (self.energy @ w))
        return w

    def _change(self, before: int, offset: float) -> float:
        """Largest change of the flexibility by the last block, relative to its largest entry at each of some frequencies: evenly up
        to the highest and beside the resonances. Forces are scaled to unit energy, so that no unit matters."""
        if before == 0:
            return np.inf
        count = 12 if self.is_general else 48
        theta = np.linalg.eigvalsh(self._mass(self.basis))[::-1]
        poles = np.sqrt(np.maximum(1.0 / np.maximum(theta, np.finfo(float).tiny) - self.shift**2, 0.0))
        poles = poles[(poles > RIGID * self.up_to) & (poles < self.up_to)]
        poles = poles[np.unique(np.linspace(0, max(len(poles) - 1, 0), min(count, len(poles))).astype(int))]
        frequencies = np.concatenate([self.up_to * (np.arange(1, count + 1) - offset) / count, (1.001 + 0.1 * offset) * poles])
        scale = 1.0 / np.linalg.norm(self.basis.T @ self.forces, axis=0)
        old, new = (self._answers(v, frequencies) for v in (self.basis[:, :before], self.basis))
        old, new = (scale[:, None] * (self.forces.T @ v @ x) * scale for v, x in ((self.basis[:, :before], old), (self.basis, new)))
        return float((np.abs(new - old).max(axis=(1, 2)) / np.abs(new).max(axis=(1, 2))).max())

    def _mass(self, v: Any) -> np.ndarray:
        mass = v.T @ (self.model.mass @ v)
        return (mass + mass.T) / 2

    def _answers(self, v: Any, frequencies: Any) -> np.ndarray:
        """Coordinates (frequencies, shapes, forces) of the motion in some shapes."""
        theta, u = np.linalg.eigh(self._mass(v))
        b = u.T @ (v.T @ self.forces)
        if not self.is_general:
            return np.array([u @ (b / (1.0 - (self.shift**2 + w**2) * theta)[:, None]) for w in frequencies])
        x = v @ u
        rigidity, viscous, hysteretic = (x.T @ (matrix @ x) for matrix in _parts(self.model))
        return np.array(
            [u @ np.linalg.solve(rigidity - np.diag(w**2 * theta) + 1j * (w * viscous + hysteretic), b) for w in frequencies]
        )

    def _continue_with_residuals(self, offset: Any) -> None:
        """The next forces are what the shapes leave of the forces at some frequencies: damping or stiffness of another kind than
        that of the space acts all over the structure."""
        frequencies = self.up_to * (np.arange(1, N_RESIDUALS + 1) - offset) / N_RESIDUALS
        motions = self._answers(self.basis, frequencies)
        left = [self.forces - _dynamic(self.model, w, 0.0) @ (self.basis @ x) for w, x in zip(frequencies, motions)]
        self.next = np.hstack([part for r in left for part in (r.real, r.imag)])


def _rests(model: Any) -> list[sp.csr_matrix]:
    """What of damping, gyroscopic and circulatory terms is no sum of mass and stiffness with the factors of most rows."""
    symmetric = symmetric_part(model.stiffness)
    rests = [model.stiffness - symmetric]
    others = [matrix for name, matrix in model.matrices().items() if name not in ("mass", "stiffness")]
    for matrix in others:
        alpha, beta = _proportions(matrix, model.mass, symmetric)
        rests.append(matrix - alpha * model.mass - beta * symmetric)
    largest = [abs(matrix).max() for matrix in (model.stiffness, *others)]
    found = []
    for rest, most in zip(rests, largest):
        rest = sp.csr_matrix(rest)
        rest.data[abs(rest.data) <= ASYMMETRY * most] = 0.0
        rest.eliminate_zeros()
        found.append(rest)
    return found


def _proportions(matrix: Any, mass: Any, stiffness: Any) -> tuple[float, float]:
    """Medians over the rows of the factors in matrix = alpha mass + beta stiffness."""
    pairs = {
        "mm": (mass, mass),
        "mk": (mass, stiffness),
        "kk": (stiffness, stiffness),
        "dm": (matrix, mass),
        "dk": (matrix, stiffness),
    }
    p = {name: np.asarray(a.multiply(b).sum(axis=1)).ravel() for name, (a, b) in pairs.items()}
    determinant = p["mm"] * p["kk"] - p["mk"] ** 2
    sound = determinant > 1.0e-6 * p["mm"] * p["kk"]
    if not sound.any():
        return 0.0, 0.0
    alpha = (p["dm"] * p["kk"] - p["dk"] * p["mk"])[sound] / determinant[sound]
    beta = (p["dk"] * p["mm"] - p["dm"] * p["mk"])[sound] / determinant[sound]
    return float(np.median(alpha)), float(np.median(beta))


def _project(model: Any, retained: Any, basis: Any, method: Any) -> Structure:
    """The model in the columns of a basis, of which the first are the retained degrees of freedom."""
    n_retained = len(retained)
    inner = basis[:, n_retained:]  # replaced in place: a second copy of the basis may not fit into memory
    # modal coordinates of the rest: unit modal mass, ordered by frequency; what depends on the others is left out
    m_inner, k_inner = (inner.T @ (matrix @ inner) for matrix in (model.mass, symmetric_part(model.stiffness)))
    if inner.shape[1]:
        size = np.sqrt(np.abs(np.diag(m_inner)))
        size[size == 0] = 1.0
        weights, vectors = scipy.linalg.eigh(m_inner / np.outer(size, size))
        good = weights > 1.0e-11 * weights.max()
        rotate = (vectors[:, good] / np.sqrt(weights[good])) / size[:, None]
        _, turn = scipy.linalg.eigh(rotate.T @ k_inner @ rotate)
        _multiply_from_right(inner, rotate @ turn)
        basis = basis[:, : n_retained + len(turn)]
    matrices = {}
    for name, matrix in model.matrices().items():
        sign = 0.0
        if name == "mass" or name.startswith("gyroscopic") or (name == "stiffness" and is_symmetric(model)):
            sign = -1.0 if name.startswith("gyroscopic") else 1.0
        matrices[name] = sp.csr_matrix(_uncoupled(_projection(matrix, basis, sign), n_retained))
    n_inner, words = basis.shape[1] - n_retained, "shapes" if method == "krylov" else "modes"
    loads = {}
    for (name, _), column in zip(model.loads.items(), load_matrix(model).T):
        loads[name] = (np.arange(n_retained + n_inner), basis.T @ column)
    node = np.concatenate([model.dof_node[retained], np.full(n_inner, -1)]).astype(int)
    moving = set(node[node >= 0].tolist())
    sets = {name: np.array([n for n in nodes if int(n) in moving]) for name, nodes in model.sets.items()}
    return Structure(
        **matrices,
        labels=[model.labels[dof] for dof in retained] + [f"q{i + 1}" for i in range(n_inner)],
        units=[model.units[dof] for dof in retained] + ["m"] * n_inner,
        node_numbers=model.node_numbers,
        coordinates=model.coordinates,
        dof_node=node,
        dof_direction=[model.dof_direction[dof] for dof in retained] + [""] * n_inner,
        cell_types=model.cell_types,
        cell_starts=model.cell_starts,
        cell_nodes=model.cell_nodes,
        sets={name: nodes for name, nodes in sets.items() if len(nodes)},
        loads=loads,
        unit_system=model.unit_system,
        source=f"{model.source}; {method}, {n_retained} of {model.n_dofs} retained, {n_inner} {words}",
        recovery=Recovery(basis, model.dof_node, model.dof_direction),
    )


def _projection(matrix: Any, basis: Any, sign: float) -> np.ndarray:
    """basis' matrix basis, of a matrix that is symmetric (sign 1), skew-symmetric (-1) or neither (0)."""
    n = basis.shape[1]
    product = np.empty((n, n))
    for columns in _blocks(n):
        first = columns.start if sign else 0
        product[first:, columns] = basis[:, first:].T @ (matrix @ basis[:, columns])
        if not sign:
            continue
        diagonal = product[columns, columns]
        product[columns, columns] = (diagonal + sign * diagonal.T) / 2
        product[columns, columns.stop :] = sign * product[columns.stop :, columns].T
    return product


def _uncoupled(matrix: Any, n_retained: Any) -> np.ndarray:
    """The matrix without the coupling between shapes that is rounding beside their own entries."""
    size = np.sqrt(np.abs(np.diag(matrix)[n_retained:]))
    shapes = matrix[n_retained:, n_retained:]
    shapes[(np.abs(shapes) <= ROUNDING * np.outer(size, size)) & ~np.eye(len(shapes), dtype=bool)] = 0.0
    return matrix


def band(reduced: Structure, up_to: float, most: int = 6) -> np.ndarray:
    """Frequencies up to one at which errors are reported: four over the band, then resonances of the reduced model, where it is off
    most; some of them, with the lowest and the highest."""
    found = resonances(reduced, up_to)
    chosen = found[np.unique(np.linspace(0, len(found) - 1, most).astype(int))] if len(found) else found
    return np.concatenate([up_to * BAND, chosen])


def resonances(reduced: Structure, up_to: float) -> np.ndarray:
    """Frequencies of a small model without those of rigid bodies [rad/s]; with gyroscopic and circulatory terms those of its
    whirls."""
    if reduced.gyroscopic is None and is_symmetric(reduced):
        found = np.sqrt(np.maximum(dense_values(reduced.stiffness, reduced.mass), 0.0))
    else:
        k, m = reduced.stiffness.toarray(), reduced.mass.toarray()
        none, one = np.zeros_like(k), np.eye(len(k))
        states = np.block([[none, one], [-k, none if reduced.gyroscopic is None else -reduced.gyroscopic.toarray()]])
        found = np.sort(scipy.linalg.eigvals(states, scipy.linalg.block_diag(one, m)).imag)
    return found[(found > RIGID * up_to) & (found <= up_to)]


def compare(model: Structure, reduced: Structure, frequencies: Any, loss: float = 1.0e-3) -> Report:
    """Errors of the flexibility at the retained degrees of freedom against that of the full model, at some frequencies [rad/s].

    Both with the loss factor `loss` on top, so that a resonance is no singularity. The full model is solved from the reduced one's
    answer on by GMRES, with the factors of the stiffness, slightly shifted, as preconditioner: to 1e-10 of the right-hand side, or
    to what rounding leaves where the motion is large.
    """
    started = time.perf_counter()
    whole = model
    model, turn = _relative(model, [f"{name}.{d}" for name in reduced.sets for d in set(reduced.dof_direction) if d])
    index = {label: i for i, label in enumerate(model.labels)}
    retained = [i for i, label in enumerate(reduced.labels) if label in index]
    full = [index[reduced.labels[i]] for i in retained]
    seen = sp.identity(model.n_dofs, format="csr")[full]
    for name in reduced.contacts:
        for direction in CONTACT_DIRECTIONS:
            along = np.array(reduced.dof_direction) == direction
            at = np.flatnonzero(along & np.isin(reduced.dof_node, reduced.sets[name])).tolist()
            if at:
                retained += at
                seen = sp.vstack([seen, relative_motion(whole, f"{name}.{direction}") @ turn], format="csr")
    frequencies = np.atleast_1d(np.asarray(frequencies, dtype=float))
    shift = 1.0e-9 * float(np.median(model.stiffness.diagonal()) / np.median(model.mass.diagonal()))
    symmetric = symmetric_part(model.stiffness)
    factors = Factors(sp.csr_matrix(symmetric + shift * model.mass), "the shifted stiffness")
    columns = np.unique(np.linspace(0, len(retained) - 1, min(4, len(retained))).astype(int))
    errors = []
    for w in frequencies:
        a, b = _dynamic(model, w, loss), _dense_dynamic(reduced, w, loss)
        small = scipy.linalg.solve(b, np.eye(len(b))[:, [retained[c] for c in columns]], overwrite_a=True)
        del b
        exact = np.zeros((len(retained), len(columns)), dtype=complex)
        for i, c in enumerate(columns):
            unit = seen[c].toarray()[0].astype(complex)
            recovered = (reduced.recovery.matrix @ np.column_stack([small[:, i].real, small[:, i].imag])) @ [1.0, 1.0j]
            guess = 2 * recovered - turn @ recovered  # the inverse of turn
            exact[:, i] = seen @ _solve(a, unit, guess, factors)
        difference = np.abs(small[retained] - exact).max()
        errors.append(difference / np.abs(exact).max())
    ours = resonances(replace(reduced, gyroscopic=None, stiffness=symmetric_part(reduced.stiffness)), frequencies.max())
    n_rigid = 6
    values, _ = lowest_modes(symmetric, model.mass, min(len(ours) + n_rigid, model.n_dofs - 2), shift, factors)
    exact = np.sqrt(np.maximum(values, 0.0))
    exact = exact[exact > RIGID * frequencies.max()][: len(ours)]
    off = np.abs(ours[: len(exact)] / exact - 1).max(initial=0.0)
    return Report(frequencies, np.array(errors), len(ours), float(off), time.perf_counter() - started)


def _parts(model: Any) -> tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix]:
    """Stiffness, viscous damping with gyroscopic terms, and structural damping."""
    none = sp.csr_matrix(model.mass.shape)
    viscous = sum((matrix for matrix in (model.damping, model.gyroscopic) if matrix is not None), none)
    return model.stiffness, viscous, model.structural if model.structural is not None else none


def _dynamic(model: Any, w: Any, loss: Any) -> Any:
    stiffness, viscous, hysteretic = _parts(model)
    return sp.csr_matrix(stiffness * (1 + 1j * loss) - w**2 * model.mass + 1j * w * viscous + 1j * hysteretic)


def _dense_dynamic(model: Any, w: Any, loss: Any) -> np.ndarray:
    """The same of a small model, by columns, without copies of sparse matrices that are full."""
    stiffness, viscous, hysteretic = (matrix.toarray(order="F") for matrix in _parts(model))
    dynamic = np.empty(stiffness.shape, dtype=complex, order="F")
    dynamic.imag = loss * stiffness + w * viscous + hysteretic
    stiffness -= w**2 * model.mass.toarray(order="F")
    dynamic.real = stiffness
    return dynamic


def _solve(a: Any, b: Any, guess: Any, factors: Any) -> Any:
    """Solution of a x = b by GMRES from a guess."""

    def precondition(r: Any) -> Any:
        r = np.ravel(r)
        return factors.solve(np.column_stack([r.real, r.imag])) @ np.array([1.0, 1.0j])

    def rounding(x: Any) -> Any:
        return np.finfo(float).eps * np.linalg.norm(abs(a) @ np.abs(x))

    m = spla.LinearOperator(a.shape, matvec=precondition, dtype=complex)
    x, info = spla.gmres(a, b, x0=guess, M=m, atol=rounding(guess), restart=200, maxiter=5, **{_TOLERANCE: 1.0e-10})
    if info != 0 and not np.linalg.norm(a @ x - b) <= max(1.0e-8 * np.linalg.norm(b), 10 * rounding(x)):
        raise ModelError("the full model could not be solved at a frequency: no error can be reported there")
    return x
