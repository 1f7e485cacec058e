"""Small models of large ones that keep chosen degrees of freedom as they are, with their error against the full model.

Craig-Bampton: x = T [x_b; q], static shapes of the kept degrees of freedom and modes with these held (Craig and Bampton 1968).
Free interface with residual attachment: modes of the free structure, and what they leave of the static response to forces at the
kept degrees of freedom (Rubin 1975, MacNeal 1971); rewritten in the kept degrees of freedom and modes, as Craig-Bampton's.
Of a stiffness that is not symmetric (bearings of fluid, follower forces) the symmetric part gives modes and static shapes, with
those of forces where the rest of it acts; what it is in these is Galerkin's.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from nhbm.errors import ModelError
from nhbm.factors import Factors, dense_modes, lowest_modes, symmetric_part
from nhbm.model import Model, Recovery

METHODS = ("free-interface", "craig-bampton")
LARGEST_REDUCED = 2000
BAND = np.array([0.1, 0.35, 0.7, 1.0])
ASYMMETRY = 1.0e-9  # of the largest entry, which is rounding
MOST_CIRCULATORY = 60  # degrees of freedom that get static shapes because the skew-symmetric part of the stiffness acts on them
LEAST_LEFT = 1.0e-11  # by the modes, of the static flexibility at a combination of kept degrees of freedom
RIGID = 1.0e-3  # frequencies below this share of the band are those of rigid bodies


@dataclass
class Report:
    """How far a reduced model is off: relative differences of flexibility at the kept degrees of freedom, and of frequencies."""

    frequencies: np.ndarray  # [rad/s]
    errors: np.ndarray  # of H, largest entry of the difference over the largest entry
    resonances: int = 0  # up to the highest of the frequencies
    resonance_error: float = 0.0  # largest relative difference of one
    seconds: float = 0.0


def reduce(model: Model, keep: list[str], n_modes: int = 20, method: str = METHODS[0]) -> Model:
    """Reduced model with the named degrees of freedom or sets, and the vectors of loads as further static shapes.

    The name of a pair, `joint.z` of the sets `joint_1` and `joint_2`, keeps the motion of the first relative to the second, node by
    node, as that of nodes of its own, which form the set `joint`.
    """
    if method not in METHODS:
        raise ModelError(f"method '{method}' is not known; known: {', '.join(METHODS)}")
    if model.recovery is not None:
        raise ModelError("the model is reduced already; reduce the full one")
    if abs(model.mass - model.mass.T).max() > ASYMMETRY * abs(model.mass).max():
        raise ModelError("the mass is not symmetric (nhbm-model check says where)")
    full = model
    model, turn = _relative(model, keep)
    kept = list(dict.fromkeys(dof for name in keep for dof in model.dofs_of(name)))
    if not kept:
        raise ModelError("no degrees of freedom are kept; name those of laws and loads")
    if len(kept) + len(model.loads) + n_modes > LARGEST_REDUCED:
        raise ModelError(f"{len(kept)} kept degrees of freedom and {n_modes} modes are no small model")
    n_modes = min(n_modes, model.n_dofs - len(kept))
    make = _craig_bampton if method == "craig-bampton" else _free_interface
    basis = make(_without_circulation(model), np.array(kept), n_modes)
    reduced = _project(model, np.array(kept), basis, method)
    reduced.recovery = Recovery(turn @ reduced.recovery.matrix, full.dof_node, full.dof_direction)
    return reduced


def _pair(model, name) -> tuple[str, str, str] | None:
    """Name of a pair and what its two sets are called with the direction; none for what is no pair."""
    stem, _, direction = name.rpartition(".")
    if not stem or name in model.labels or stem in model.sets or not {f"{stem}_1", f"{stem}_2"} <= set(model.sets):
        return None
    return stem, f"{stem}_1.{direction}", f"{stem}_2.{direction}"


def _relative(model, keep) -> tuple[Model, sp.csr_matrix]:
    """The model in coordinates x = turn @ x' of which those of pairs are differences. These belong to new nodes, halfway."""
    numbers, coordinates, sets = model.node_numbers, model.coordinates, dict(model.sets)
    dof_node, dof_direction, labels = model.dof_node.copy(), list(model.dof_direction), list(model.labels)
    first, second = [], []
    for pair in filter(None, (_pair(model, name) for name in keep)):
        name, one, other = pair
        a, b = model.dofs_of(one), model.dofs_of(other)
        if len(a) != len(b) or set(a) & set(first + second + b) or set(b) & set(first):
            raise ModelError(f"'{one}' and '{other}' are no pair: they differ in number, or share nodes with each other or another")
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


def is_symmetric(model: Model) -> bool:
    """Whether the stiffness is symmetric, up to rounding."""
    return abs(model.stiffness - model.stiffness.T).max() <= ASYMMETRY * abs(model.stiffness).max()


def _without_circulation(model: Model) -> Model:
    """The model with the symmetric part of its stiffness, and as loads unit forces where the rest acts, if these are few."""
    if is_symmetric(model):
        return model
    symmetric = symmetric_part(model.stiffness)
    rest = abs(model.stiffness - symmetric)
    rest.data[rest.data <= ASYMMETRY * abs(symmetric).max()] = 0.0
    where = np.flatnonzero(np.asarray(rest.sum(axis=1)).ravel())
    if len(where) > MOST_CIRCULATORY:
        where = []
    forces = {f"circulatory {dof}": (np.array([dof]), np.ones(1)) for dof in where}
    return replace(model, stiffness=symmetric, loads=model.loads | forces)


def load_matrix(model: Model) -> np.ndarray:
    """The vectors of loads as columns (n_dofs, n_loads)."""
    loads = np.zeros((model.n_dofs, len(model.loads)))
    for i, (dofs, values) in enumerate(model.loads.values()):
        np.add.at(loads[:, i], dofs, values)
    return loads


def _craig_bampton(model, kept, n_modes) -> np.ndarray:
    """Columns: kept degrees of freedom, modes with these held, static shapes of the loads."""
    inside = np.setdiff1d(np.arange(model.n_dofs), kept)
    k, m = model.stiffness, model.mass
    k_ii = sp.csr_matrix(k[inside][:, inside])
    what = "the stiffness with the kept degrees of freedom held (keep more, or leave --method craig-bampton out): it"
    factors = Factors(k_ii, what) if len(inside) else None
    n_more = len(model.loads)
    basis = np.zeros((model.n_dofs, len(kept)))
    basis[kept, np.arange(len(kept))] = 1.0
    if len(inside):
        basis[inside] = -factors.solve(k[inside][:, kept].toarray())
        _, shapes = lowest_modes(k_ii, sp.csr_matrix(m[inside][:, inside]), n_modes, 0.0, factors)
        more = np.zeros((model.n_dofs, shapes.shape[1] + n_more))
        more[inside] = np.hstack([shapes, factors.solve(load_matrix(model)[inside])])
        basis = np.hstack([basis, more])
    return basis


def _free_interface(model, kept, n_modes) -> np.ndarray:
    """Modes of the free structure and the response to unit forces at the kept degrees of freedom, in a form that has these as
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
    factors = Factors(sp.csr_matrix(k + shift * m), "the stiffness with some of the mass (nhbm-model check says more): it")
    values, modes = lowest_modes(k, m, n_modes, shift, factors)
    unit = np.zeros((model.n_dofs, len(kept)))
    unit[kept, np.arange(len(kept))] = 1.0
    attachment = factors.solve(np.hstack([unit, load_matrix(model)]))
    whole, flexible = np.abs(attachment).max(axis=0), attachment[kept, : len(kept)]
    # what modes leave of the attachment, as shapes of unit energy like those of the modes; none where they leave nothing
    attachment -= modes @ (modes.T @ (m @ attachment))
    static, loads = attachment[:, : len(kept)], attachment[:, len(kept) :]
    scale = np.sqrt(np.diag(flexible))
    try:
        left, forces = scipy.linalg.eigh(*((a + a.T) / 2 / np.outer(scale, scale) for a in (static[kept], flexible)))
    except np.linalg.LinAlgError:
        raise ModelError("the kept degrees of freedom do not move independently: keep fewer") from None
    some = left > LEAST_LEFT
    static = static @ (forces[:, some] / scale[:, None] / np.sqrt(left[some]))
    shapes = np.hstack([modes / np.sqrt(values + shift), static])
    # all of them, in static shapes with one at each kept degree of freedom and in what is zero at these
    turn, triangle = np.linalg.qr(shapes[kept].T, mode="complete")
    boundary = scipy.linalg.solve_triangular(triangle[: len(kept)], (shapes @ turn[:, : len(kept)]).T).T
    inner = shapes @ turn[:, len(kept) :]
    more = loads - boundary @ loads[kept]
    known, _ = np.linalg.qr(inner)
    more -= known @ (known.T @ more)  # nothing but rounding of loads on kept degrees of freedom
    more = more[:, np.abs(more).max(axis=0, initial=0.0) > 1.0e-9 * whole[len(kept) :]]
    return np.hstack([boundary, inner, more])


def _project(model, kept, basis, method) -> Model:
    """The model in the columns of a basis, of which the first are the kept degrees of freedom."""
    n_kept = len(kept)
    inner = basis[:, n_kept:]
    # modal coordinates of the rest: unit modal mass, ordered by frequency; what depends on the others is left out
    m_inner, k_inner = (inner.T @ (matrix @ inner) for matrix in (model.mass, symmetric_part(model.stiffness)))
    if inner.shape[1]:
        size = np.sqrt(np.abs(np.diag(m_inner)))
        size[size == 0] = 1.0
        weights, vectors = scipy.linalg.eigh(m_inner / np.outer(size, size))
        good = weights > 1.0e-11 * weights.max()
        rotate = (vectors[:, good] / np.sqrt(weights[good])) / size[:, None]
        _, turn = scipy.linalg.eigh(rotate.T @ k_inner @ rotate)
        inner = inner @ (rotate @ turn)
    basis = np.hstack([basis[:, :n_kept], inner])
    matrices = {name: basis.T @ (matrix @ basis) for name, matrix in model.matrices().items()}
    for name in matrices:
        sign = -1.0 if name == "gyroscopic" else 1.0
        if name in ("mass", "gyroscopic") or (name == "stiffness" and is_symmetric(model)):
            matrices[name] = (matrices[name] + sign * matrices[name].T) / 2
    n_inner = inner.shape[1]
    loads = {}
    for (name, _), column in zip(model.loads.items(), load_matrix(model).T):
        loads[name] = (np.arange(n_kept + n_inner), basis.T @ column)
    node = np.concatenate([model.dof_node[kept], np.full(n_inner, -1)]).astype(int)
    moving = set(node[node >= 0].tolist())
    sets = {name: np.array([n for n in nodes if int(n) in moving]) for name, nodes in model.sets.items()}
    return Model(
        **{name: sp.csr_matrix(matrix) for name, matrix in matrices.items()},
        labels=[model.labels[dof] for dof in kept] + [f"q{i + 1}" for i in range(n_inner)],
        units=[model.units[dof] for dof in kept] + ["m"] * n_inner,
        node_numbers=model.node_numbers,
        coordinates=model.coordinates,
        dof_node=node,
        dof_direction=[model.dof_direction[dof] for dof in kept] + [""] * n_inner,
        cell_types=model.cell_types,
        cell_starts=model.cell_starts,
        cell_nodes=model.cell_nodes,
        sets={name: nodes for name, nodes in sets.items() if len(nodes)},
        loads=loads,
        unit_system=model.unit_system,
        source=f"{model.source}; {method}, {n_kept} of {model.n_dofs} kept, {n_inner} modes",
        recovery=Recovery(basis, model.dof_node, model.dof_direction),
    )


def band(reduced: Model, up_to: float, most: int = 6) -> np.ndarray:
    """Frequencies up to one at which errors are told: four over the band, then resonances of the reduced model, where it is off
    most; some of them, with the lowest and the highest."""
    found = resonances(reduced, up_to)
    chosen = found[np.unique(np.linspace(0, len(found) - 1, most).astype(int))] if len(found) else found
    return np.concatenate([up_to * BAND, chosen])


def resonances(reduced: Model, up_to: float) -> np.ndarray:
    """Frequencies of a small model without those of rigid bodies [rad/s]; with gyroscopic and circulatory terms those of its
    whirls."""
    k, m = reduced.stiffness.toarray(), reduced.mass.toarray()
    if reduced.gyroscopic is None and is_symmetric(reduced):
        found = np.sqrt(np.maximum(dense_modes(reduced.stiffness, reduced.mass)[0], 0.0))
    else:
        none, one = np.zeros_like(k), np.eye(len(k))
        states = np.block([[none, one], [-k, none if reduced.gyroscopic is None else -reduced.gyroscopic.toarray()]])
        found = np.sort(scipy.linalg.eigvals(states, scipy.linalg.block_diag(one, m)).imag)
    return found[(found > RIGID * up_to) & (found <= up_to)]


def compare(model: Model, reduced: Model, frequencies, loss: float = 1.0e-3) -> Report:
    """Errors of the reduced model's flexibility at its kept degrees of freedom against the full one's, at some frequencies [rad/s].

    Both with the loss factor `loss` on top, so that a resonance is no singularity. The full model is solved from the reduced one's
    answer on by GMRES, with the factors of the stiffness, slightly shifted, as preconditioner: to 1e-10 of the right-hand side, or
    to what rounding leaves where the motion is large.
    """
    started = time.perf_counter()
    model, turn = _relative(model, [f"{name}.{d}" for name in reduced.sets for d in set(reduced.dof_direction) if d])
    place = {label: i for i, label in enumerate(model.labels)}
    kept = [i for i, label in enumerate(reduced.labels) if label in place]
    full = [place[reduced.labels[i]] for i in kept]
    frequencies = np.atleast_1d(np.asarray(frequencies, dtype=float))
    shift = 1.0e-9 * float(np.median(model.stiffness.diagonal()) / np.median(model.mass.diagonal()))
    symmetric = symmetric_part(model.stiffness)
    factors = Factors(sp.csr_matrix(symmetric + shift * model.mass), "the shifted stiffness")
    recovery = 2 * reduced.recovery.matrix - turn @ reduced.recovery.matrix  # the inverse of turn
    errors = []
    for w in frequencies:
        a, b = _dynamic(model, w, loss), _dynamic(reduced, w, loss).toarray()
        small = np.linalg.solve(b, np.eye(len(b))[:, kept])
        columns = range(len(kept)) if len(kept) <= 4 else np.unique(np.linspace(0, len(kept) - 1, 4).astype(int))
        exact = np.zeros((len(kept), len(columns)), dtype=complex)
        for i, c in enumerate(columns):
            unit = np.zeros(model.n_dofs, dtype=complex)
            unit[full[c]] = 1.0
            exact[:, i] = _solve(a, unit, recovery @ small[:, c], factors)[full]
        difference = np.abs(small[kept][:, list(columns)] - exact).max()
        errors.append(difference / np.abs(exact).max())
    ours = resonances(replace(reduced, gyroscopic=None, stiffness=symmetric_part(reduced.stiffness)), frequencies.max())
    n_rigid = 6
    values, _ = lowest_modes(symmetric, model.mass, min(len(ours) + n_rigid, model.n_dofs - 2), shift, factors)
    exact = np.sqrt(np.maximum(values, 0.0))
    exact = exact[exact > RIGID * frequencies.max()][: len(ours)]
    off = np.abs(ours[: len(exact)] / exact - 1).max(initial=0.0)
    return Report(frequencies, np.array(errors), len(ours), float(off), time.perf_counter() - started)


def _dynamic(model, w, loss):
    d = sum((matrix for matrix in (model.damping, model.gyroscopic) if matrix is not None), sp.csr_matrix(model.mass.shape))
    h = model.structural if model.structural is not None else sp.csr_matrix(model.mass.shape)
    return sp.csr_matrix(model.stiffness * (1 + 1j * loss) - w**2 * model.mass + 1j * w * d + 1j * h)


def _solve(a, b, guess, factors):
    """Solution of a x = b by GMRES from a guess."""

    def precondition(r):
        r = np.ravel(r)
        return factors.solve(np.column_stack([r.real, r.imag])) @ np.array([1.0, 1.0j])

    def rounding(x):
        return np.finfo(float).eps * np.linalg.norm(abs(a) @ np.abs(x))

    m = spla.LinearOperator(a.shape, matvec=precondition, dtype=complex)
    x, info = spla.gmres(a, b, x0=guess, M=m, tol=1.0e-10, atol=rounding(guess), restart=200, maxiter=5)
    if info != 0 and not np.linalg.norm(a @ x - b) <= max(1.0e-8 * np.linalg.norm(b), 10 * rounding(x)):
        raise ModelError("the full model could not be solved at a frequency: no error can be told there")
    return x
