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
    n = int(rotor.number_dof)
    if n not in DIRECTIONS:
        raise ModelError(f"nodes of this rotor have {n} degrees of freedom; those of 4 and 6 are known")
    try:  # by name: the second argument of M was another one before ROSS 3.1
        mass, stiffness, damping = (matrix(frequency=whirl, speed=at) for matrix in (rotor.M, rotor.K, rotor.C))
    except TypeError:
        raise ModelError("rotors of ROSS 3.1 and later are read, whose matrices depend on speed and frequency") from None
    gyroscopic = sp.csr_matrix(rotor.G())
    matrices = {"mass": sp.csr_matrix(mass), "stiffness": sp.csr_matrix(stiffness), "damping": sp.csr_matrix(damping)}
    matrices["gyroscopic_by_speed" if speed is None else "gyroscopic"] = gyroscopic if speed is None else at * gyroscopic
    nodes = [int(node) for node in rotor.nodes]
    rows = [(node + 1, direction) for node in nodes for direction in DIRECTIONS[n]]
    n_rows = matrices["mass"].shape[0]
    if n_rows != len(rows):
        raise ModelError(
            f"this rotor has {n_rows} rows for {len(nodes)} nodes of {n}: supports with nodes of their own are not read"
        )
    positions = np.column_stack([np.zeros((len(nodes), 2)), np.asarray(rotor.nodes_pos, dtype=float)])
    return matrices, rows, positions


def _axes(rotor: Any) -> list[tuple[str, str, float, float]]:
    """Element, axis and range of each table."""
    found: dict[tuple[str, str, float, float], None] = {}
    for element in rotor.bearing_elements:
        for axis in ("speed", "frequency"):
            values = getattr(element, axis, None)
            if values is not None and np.size(values) > 1:
                found[str(element.tag), axis, float(np.min(values)), float(np.max(values))] = None
    return list(found)
