"""Rotors of ROSS (3.1): its matrices at a speed of the shaft and a frequency of the whirl."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError, check_file, imported

DIRECTIONS = {4: ("x", "y", "rx", "ry"), 6: ("x", "y", "z", "rx", "ry", "rz")}  # by the degrees of freedom of a node


def read_rotor(
    rotor: Any, speed: float | None, frequency: float | None
) -> tuple[dict[str, Any], list[tuple[int, str]], np.ndarray]:
    """Matrices of a Rotor, or of its file (.toml): M, K, C, and G times the speed, or G by the speed where that is not given;
    node and direction of each row; positions of the nodes, the shaft along z.

    `speed`, `frequency` [rad/s]: where tables of bearings and seals are taken; the frequency is the speed where it is not given.
    Refused outside of the tables, where ROSS extrapolates: damping may become negative there."""
    rotor = _opened(rotor)
    tables = _axes(rotor)
    if speed is None and tables:
        raise ModelError(f"the coefficients of '{tables[0][0]}' depend on the {tables[0][1]}: give the speed [rad/s] of the model")
    at = 0.0 if speed is None else float(speed)
    whirl = at if frequency is None else float(frequency)
    if not (np.isfinite([at, whirl]).all() and whirl >= 0):
        raise ModelError(f"speed and frequency are finite [rad/s], the latter 0 or more, not {speed} and {frequency}")
    for tag, axis, lowest, highest in tables:
        value = at if axis == "speed" else whirl
        if not lowest <= value <= highest:
            raise ModelError(f"the table of '{tag}' is for a {axis} of {lowest:g} to {highest:g} rad/s, not {value:g}: ROSS would "
                             "extrapolate it")  # fmt: skip
    matrices = _matrices_of(rotor, at, whirl)
    gyroscopic = sp.csr_matrix(rotor.G())
    matrices["gyroscopic_by_speed" if speed is None else "gyroscopic"] = gyroscopic if speed is None else at * gyroscopic
    return matrices, *_rows_of(rotor, matrices["mass"].shape[0])


def read_tables(rotor: Any) -> tuple[dict[str, Any], list[tuple[int, str]], np.ndarray, list[dict[str, Any]]]:
    """Matrices of a Rotor or its file without bearings and seals that have tables, nodes and directions of the rows, positions, and
    of each of these elements the arguments of `Model.bearing`."""
    rotor = _opened(rotor)
    matrices = _matrices_of(rotor, 0.0, 0.0)
    rows, positions = _rows_of(rotor, matrices["mass"].shape[0])
    bearings = []
    for element in rotor.bearing_elements:
        axes = {name: _table_axis(element, name) for name in ("speed", "frequency")}
        if all(axis is None for axis in axes.values()):
            continue
        grid = [np.zeros(1) if axis is None else axis for axis in axes.values()]
        tables = {}
        for name, matrix in (("stiffness", element.K), ("damping", element.C), ("mass", element.M)):
            table = np.array([[matrix(frequency=w, speed=speed) for w in grid[1]] for speed in grid[0]])
            if table.shape[-1] != 3:
                raise ModelError(f"'{element.tag}' connects two nodes, with tables: &bearing is between a node and the ground; "
                                 "import_structure(ross=..., speed=...) reads it at one speed")  # fmt: skip
            if table[..., 2, 2].any():
                raise ModelError(f"'{element.tag}' has a table of its axial {name}; &bearing has x and y alone")
            tables[name] = table[..., :2, :2].reshape(*table.shape[:2], 4)
        if not np.array_equal(tables["mass"][..., 1], tables["mass"][..., 2]):
            raise ModelError(f"'{element.tag}' has m_xy unlike m_yx; the mass of &bearing is symmetric")
        if tables["mass"].any():
            tables["mass"] = tables["mass"][..., [0, 1, 3]]
        else:
            del tables["mass"]
        dofs = list(element.dof_global_index.values())[:2]
        for name, matrix in (("stiffness", element.K), ("damping", element.C), ("mass", element.M)):
            values = np.asarray(matrix(frequency=0.0, speed=0.0), dtype=float)[:2, :2]
            at = np.repeat(dofs, 2), np.tile(dofs, 2)
            matrices[name] = matrices[name] - sp.csr_matrix((values.ravel(), at), matrices[name].shape)
        bearings.append({"dofs": [f"n{rows[i][0]}.{rows[i][1]}" for i in dofs], "speeds": axes["speed"],
                         "frequencies": axes["frequency"], **tables})  # fmt: skip
    matrices["gyroscopic_by_speed"] = sp.csr_matrix(rotor.G())
    return matrices, rows, positions, bearings


def _table_axis(element: Any, name: str) -> np.ndarray | None:
    values = getattr(element, name, None)
    return None if values is None or np.size(values) < 2 else np.asarray(values, dtype=float)


def _opened(rotor: Any) -> Any:
    """The rotor of a file, or a rotor that is one."""
    if isinstance(rotor, (str, Path)):
        check_file(rotor)
        ross = imported("ross", "rotors are read with", "ross-rotordynamics")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # on the version that has written the file
                rotor = ross.Rotor.load(str(rotor))
        except Exception as error:  # it raises whatever it meets
            raise ModelError(f"file '{rotor}' is not a rotor that ROSS reads: {type(error).__name__}: {error}") from None
    for name in ("M", "K", "C", "G", "number_dof", "nodes", "nodes_pos", "bearing_elements"):
        if not hasattr(rotor, name):
            raise ModelError(f"ross is a Rotor of ROSS or its file, not {type(rotor).__name__}: it has no '{name}'")
    return rotor


def _matrices_of(rotor: Any, at: float, whirl: float) -> dict[str, Any]:
    """M, K and C at a speed and a frequency."""
    try:  # by name: the second argument of M was another one before ROSS 3.1
        mass, stiffness, damping = (matrix(frequency=whirl, speed=at) for matrix in (rotor.M, rotor.K, rotor.C))
    except TypeError:
        raise ModelError("rotors of ROSS 3.1 and later are read, whose matrices depend on speed and frequency") from None
    return {"mass": sp.csr_matrix(mass), "stiffness": sp.csr_matrix(stiffness), "damping": sp.csr_matrix(damping)}


def _rows_of(rotor: Any, n_rows: int) -> tuple[list[tuple[int, str]], np.ndarray]:
    """Node and direction of each row, positions of the nodes."""
    n = int(rotor.number_dof)
    if n not in DIRECTIONS:
        raise ModelError(f"nodes of this rotor have {n} degrees of freedom; those of 4 and 6 are known")
    nodes = [int(node) for node in rotor.nodes]
    rows = [(node + 1, direction) for node in nodes for direction in DIRECTIONS[n]]
    if n_rows != len(rows):
        raise ModelError(
            f"this rotor has {n_rows} rows for {len(nodes)} nodes of {n}: supports with nodes of their own are not read"
        )
    return rows, np.column_stack([np.zeros((len(nodes), 2)), np.asarray(rotor.nodes_pos, dtype=float)])


def _axes(rotor: Any) -> list[tuple[str, str, float, float]]:
    """Element, axis and range of each table."""
    found: dict[tuple[str, str, float, float], None] = {}
    for element in rotor.bearing_elements:
        for axis in ("speed", "frequency"):
            values = getattr(element, axis, None)
            if values is not None and np.size(values) > 1:
                found[str(element.tag), axis, float(np.min(values)), float(np.max(values))] = None
    return list(found)
