"""Checks of a model before it is used: symmetry, definiteness, rigid body modes, plausible units."""

from __future__ import annotations

from dataclasses import dataclass

from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError
from nhbm.factors import Factors, lowest_modes, symmetric_part
from nhbm.structure import Structure

ASYMMETRY = 1.0e-10
DENSE = 400


@dataclass
class Finding:
    """One sentence; `is_bad` where the model is not what a structure must be."""

    text: str
    is_bad: bool = False


def check(model: Structure) -> list[Finding]:
    """All findings, the bad ones among them."""
    findings = [_symmetry(model, "mass", True), _symmetry(model, "stiffness", False)]
    if model.gyroscopic is not None:
        findings.append(_symmetry(model, "gyroscopic", True, sign=-1))
    findings += _unconnected(model)
    findings.append(_definiteness(model))
    if not any(f.is_bad for f in findings):
        findings += _rigid_body_modes(model)
    findings += _units(model)
    return findings


def _symmetry(model: Any, name: Any, is_needed: Any, sign: int = 1) -> Finding:
    """Symmetry up to rounding, relative to the diagonal where there is one, so that units do not matter."""
    matrix = getattr(model, name)
    scale = np.sqrt(np.abs(matrix.diagonal()))
    if not (scale > 0).all():
        scale = np.full(model.n_dofs, np.sqrt(abs(matrix).max() or 1.0))
    inverse = sp.diags(1.0 / scale)
    rest = sp.coo_matrix(inverse @ (matrix - sign * matrix.T) @ inverse)
    kind = "symmetric" if sign > 0 else "skew-symmetric"
    if rest.nnz == 0 or np.abs(rest.data).max() <= ASYMMETRY:
        return Finding(f"{name} is {kind}")
    e = int(np.argmax(np.abs(rest.data)))
    i, j = rest.row[e], rest.col[e]
    return Finding(
        f"{name} is not {kind}: between {model.labels[i]} and {model.labels[j]} it is {matrix[i, j]:.9g} one way and "
        f"{matrix[j, i]:.9g} the other",
        is_needed,
    )


def _unconnected(model: Any) -> list[Finding]:
    touched = np.zeros(model.n_dofs, dtype=bool)
    for matrix in (model.mass, model.stiffness):
        touched |= np.asarray(abs(matrix).sum(axis=1)).ravel() > 0
    empty = np.flatnonzero(~touched)
    if not len(empty):
        return []
    return [Finding(f"{model.labels[empty[0]]} has neither mass nor stiffness ({len(empty)} such in all): singular", True)]


def _shift(model: Any) -> float:
    """A small shift: far below the first frequencies, far above rounding."""
    k, m = model.stiffness.diagonal(), model.mass.diagonal()
    used = (m > 0) & (k > 0)
    return 1.0e-7 * float(np.median(k[used] / m[used])) if used.any() else 1.0


def _definiteness(model: Any) -> Finding:
    """Mass positive semi-definite, so that nothing moves with negative energy."""
    diagonal = model.mass.diagonal()
    if (diagonal < 0).any():
        i = int(np.argmin(diagonal))
        return Finding(f"the mass of {model.labels[i]} is negative: {diagonal[i]:.9g}", True)
    massless = int((diagonal == 0).sum())
    scale = sp.diags(1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)))
    scaled = scale @ model.mass @ scale + 1.0e-8 * sp.identity(model.n_dofs)
    try:
        Factors(symmetric_part(scaled), "mass")
    except ModelError:
        return Finding("mass is indefinite: some motion would have negative kinetic energy", True)
    if massless:
        return Finding(f"mass is positive semi-definite, {massless} degrees of freedom have none")
    return Finding("mass is positive definite")


def lowest_frequencies(model: Any, n: int) -> Any:
    """The lowest natural frequencies of a structure [rad/s], without damping; 0 for rigid body modes."""
    shift = _shift(model)
    stiffness = symmetric_part(model.stiffness)
    factors = None if model.n_dofs <= 60 else Factors(stiffness + shift * model.mass, "stiffness")
    values, _ = lowest_modes(stiffness, model.mass, min(n, model.n_dofs), shift, factors)
    return np.sqrt(np.maximum(values, 0.0))


def _rigid_body_modes(model: Any) -> list[Finding]:
    shift = _shift(model)
    stiffness = symmetric_part(model.stiffness)
    n = min(model.n_dofs, 12)
    try:
        factors = None if model.n_dofs <= 60 else Factors(stiffness + shift * model.mass, "stiffness")
        values, _ = lowest_modes(stiffness, model.mass, min(n, model.n_dofs - 1) or 1, shift, factors)
    except (ModelError, np.linalg.LinAlgError):
        return [Finding("stiffness is indefinite, or singular together with the mass", True)]
    largest = np.abs(values).max() or 1.0
    n_rigid = int((np.abs(values) < 1.0e-7 * largest).sum()) if len(values) > 1 else int(values[0] <= 0)
    frequencies = np.sqrt(np.maximum(values[n_rigid:], 0.0)) / (2 * np.pi)
    shown = ", ".join(f"{f:.6g}" for f in frequencies[:6])
    findings = [Finding(f"{n_rigid} rigid body modes" if n_rigid != 1 else "1 rigid body mode")]
    if values.min() < -1.0e-7 * largest:
        findings.append(Finding("stiffness is indefinite: a motion has negative strain energy", True))
    if n_rigid > 6:
        findings.append(Finding(f"more than six rigid body modes ({n_rigid}): parts are not connected, or a mechanism", True))
    if shown:
        findings.append(Finding(f"lowest frequencies [Hz, by the unit of time]: {shown}"))
    return findings


def _units(model: Any) -> list[Finding]:
    """Translational mass and size of the model, with a guess whether they are those of m, kg, s or mm, t, s."""
    findings: list[Finding] = []
    if model.recovery is not None:  # reduced: its coordinates are those of modes, and nodes that move alone
        return findings
    for direction in ("x", "y", "z"):
        ones = np.array([1.0 if d == direction else 0.0 for d in model.dof_direction])
        if ones.any():
            findings.append(Finding(f"mass that moves along {direction}: {ones @ (model.mass @ ones):.6g}"))
    if len(model.coordinates) and np.isfinite(model.coordinates).all():
        extent = np.ptp(model.coordinates, axis=0)
        size = float(extent.max())
        findings.append(Finding("extent: " + " x ".join(f"{e:.6g}" for e in extent)))
        volume = float(np.prod(extent[extent > 1e-9 * (size or 1.0)])) if size > 0 else 0.0
        total = float(np.median([f for f in [np.abs(model.mass.sum()) / 3] if f > 0] or [0.0]))
        if (extent > 1e-9 * (size or 1.0)).sum() == 3 and volume > 0 and total > 0:
            density = total / volume
            if 1e-11 < density < 1e-7:
                guess = "that of mm, t, s; loads are in N, but motions in mm"
            elif 1e-8 < density < 1e-4:
                guess = "that of mm, kg: with N it wants ms, not s"
            elif 1.0 < density < 3e4:
                guess = "that of m, kg, s"
            else:
                guess = "that of no usual system of units for a solid body"
            findings.append(Finding(f"mass over the volume of the extent: {density:.3g}, {guess}"))
    return findings
