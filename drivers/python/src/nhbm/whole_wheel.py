"""The whole wheel from the model of one sector: matrices, loads and laws of every sector.

Sector 0 has the names of the one sector; those of sector s end in `_s`. A degree of freedom of `high` is that of `low` in the next
sector, and has no name of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError
from nhbm.groups import Group, Groups
from nhbm.keys import repeated_groups
from nhbm.structure import MATRICES, Structure

DOFS = "dof", "dofs", "force_dof", "force_dofs", "normal_dofs", "second_dofs", "sensors", "actuators"  # keys that name some
WAVES = "load", "start"  # which travel from sector to sector
PARTS = "law", "bearing", "feedback", "dynamic_stiffness"  # which every sector has


def whole_wheel(groups: Groups, structure: Structure) -> Groups:
    """The groups of the whole wheel from those of a sector with a structure."""
    sector = groups.first("sector")
    if sector is None:
        raise ModelError("the model is not one sector of a wheel: model.sector(...) makes it one")
    n, labels = int(sector.keys["n_sectors"]), structure.labels
    low, high = ([_index(labels, name) for name in _several(sector.keys[side])] for side in ("low", "high"))
    own = [dof for dof in range(len(labels)) if dof not in high]
    at = np.zeros((n, len(labels)), dtype=int)  # in the wheel
    at[:, own] = np.arange(n * len(own)).reshape(n, -1)
    at[:, high] = np.roll(at[:, low], -1, axis=0)
    names = [labels[dof] + f"_{s}" * (s > 0) for s in range(n) for dof in own]
    wheel = Structure(
        **{name: _assembled(matrix, at, len(names)) for name, matrix in structure.matrices().items()},
        labels=names, units=[structure.units[dof] for dof in own] * n, unit_system=structure.unit_system,
        source=f"{structure.source}; wheel of {n} sectors",
    )  # fmt: skip
    orders = np.atleast_1d(sector.keys["engine_orders"])

    def in_sector(group: Group, s: int) -> Group:
        keys = dict(group.keys)
        for key in DOFS:
            if key in keys:
                found = [names[at[s, _index(labels, name)]] for name in _several(keys[key])]
                keys[key] = tuple(found) if isinstance(keys[key], tuple) else found[0]
        if s > 0 and group.label:
            keys["label"] = f"{group.label}_{s}"
        if group.name in WAVES and "tuple" in keys:
            diameter = int(np.dot(np.atleast_1d(keys["tuple"]), orders))
            keys["phase"] = keys.get("phase", 0.0) - 2.0 * np.pi * (diameter * s % n) / n
        return Group(group.name, keys)

    whole = Groups()
    for group in groups:
        _check(group)
        if group.name == "structure":
            further = {key: value for key, value in group.keys.items() if key in ("speed", "structural_frequency")}
            whole.add(Group("structure", {**further, "type": "model", "file": wheel}))
        elif group.name != "sector":
            for s in range(n if group.name in (*WAVES, *PARTS) else 1):
                whole.add(in_sector(group, s))
    return whole


def structure_of_matrices(keys: dict[str, Any]) -> Structure:
    """The structure of a group `type = 'matrices'`."""
    size = int(keys["n_dofs"])
    given: dict[str, Any] = {name: np.reshape(keys[name], (size, size)) for name in MATRICES if name in keys}
    for name in ("labels", "units"):
        if name in keys:
            given[name] = list(_several(keys[name]))
    if len(given.get("units", [])) == 1:
        given["units"] *= size
    return Structure(**given)


def _assembled(matrix: Any, at: np.ndarray, size: int) -> Any:
    entries = sp.coo_matrix(matrix)
    values = np.tile(entries.data, len(at))
    return sp.csr_matrix((values, (at[:, entries.row].ravel(), at[:, entries.col].ravel())), shape=(size, size))


def _check(group: Group) -> None:
    """Raises where sector s has no group that follows from that of the sector."""
    why = ""
    if group.name in repeated_groups() and group.name not in ("sector", *WAVES, *PARTS):
        why = "belongs to one sector: add it to the wheel"
    elif "vector" in group.keys:
        why = "has a load vector: add it to the wheel by its degrees of freedom"
    elif group.name == "load" and group.keys.get("kind", "force") != "force":
        why = "is a motion of the base: add it to the wheel"
    elif group.name == "load" and "tuple" not in group.keys:
        why = "has no tuple, and hence no delay from sector to sector: add it to the wheel"
    elif group.name in PARTS and "tuple" in group.keys:
        why = f"of the type '{group.keys.get('type')}' has a phase of its own in each sector: add it to the wheel"
    if why:
        raise ModelError(f"whole_wheel: &{group.name} {why}")


def _several(value: Any) -> tuple[str, ...]:
    return tuple(value) if isinstance(value, (tuple, list)) else (value,)


def _index(labels: list[str], name: str) -> int:
    """Of a degree of freedom by its label or number."""
    if name in labels:
        return labels.index(name)
    if str(name).isdigit() and 0 < int(name) <= len(labels):
        return int(name) - 1
    raise ModelError(f"whole_wheel: '{name}' is not a degree of freedom of the sector: name them one by one, not by sets")
