"""Shafts with disks in bearings: beam elements in two planes, for examples and first studies of rotors.

Bernoulli's beam with rotary inertia and gyroscopic terms of the shaft (Nelson and McVaugh, J. Eng. Ind. 98 (1976), without shear),
the shaft along z: each node moves along x and y and has the slopes dx/dz and dy/dz.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError
from nhbm.structure import Structure

VTK_LINE = 3
DIRECTIONS = ("x", "y", "xz", "yz")


def rotor(length, diameter, n_elements, disks=(), bearings=(), speed=0.0, young=2.1e11, density=7850.0) -> Structure:
    """Rotor of a round shaft [m]; sets `disk1`, `bearing1`, ...

    `disks`: position [m], mass [kg], diametral and polar moment of inertia [kg m2]; `bearings`: position, stiffness [N/m] and
    damping [N s/m], the same in all directions; `speed` [rad/s] from x towards y.
    """
    for name, value in (("length", length), ("diameter", diameter), ("n_elements", n_elements)):
        if not value > 0:
            raise ModelError(f"{name} must be above 0, not {value}")
    n_nodes, h = int(n_elements) + 1, length / int(n_elements)
    area, second = np.pi * diameter**2 / 4, np.pi * diameter**4 / 64
    bend = young * second / h**3 * _element(h, 12, 6, 4, -12, 6, 2)
    move = density * area * h / 420 * _element(h, 156, 22, 4, 54, -13, -3)
    tilt = density * second / (30 * h) * _element(h, 36, 3, 4, -36, 3, -1)
    k, m, polar, d = (np.zeros((2 * n_nodes, 2 * n_nodes)) for _ in range(4))  # of one plane: deflection and slope of each node
    for e in range(n_nodes - 1):
        at = np.ix_(range(2 * e, 2 * e + 4), range(2 * e, 2 * e + 4))
        k[at] += bend
        m[at] += move + tilt
        polar[at] += 2 * tilt
    z = h * np.arange(n_nodes)
    sets = {}
    for i, (position, mass, diametral, about) in enumerate(disks, start=1):
        node = _node(z, position, length)
        m[2 * node, 2 * node] += mass
        m[2 * node + 1, 2 * node + 1] += diametral
        polar[2 * node + 1, 2 * node + 1] += about
        sets[f"disk{i}"] = np.array([node])
    for i, (position, stiffness, damping) in enumerate(bearings, start=1):
        node = _node(z, position, length)
        k[2 * node, 2 * node] += stiffness
        d[2 * node, 2 * node] += damping
        sets[f"bearing{i}"] = np.array([node])
    order = np.array([plane * 2 * n_nodes + 2 * node + slope for node in range(n_nodes) for slope in (0, 1) for plane in (0, 1)])
    both = np.eye(2)
    across = np.array([[0.0, 1.0], [-1.0, 0.0]])
    spread = {"stiffness": np.kron(both, k), "mass": np.kron(both, m), "damping": np.kron(both, d),
              "gyroscopic": speed * np.kron(across, polar)}  # fmt: skip
    if not speed:
        del spread["gyroscopic"]
    return Structure(
        **{name: sp.csr_matrix(matrix[np.ix_(order, order)]) for name, matrix in spread.items()},
        labels=[f"n{node + 1}.{d}" for node in range(n_nodes) for d in DIRECTIONS],
        units=["m", "m", "rad", "rad"] * n_nodes,
        node_numbers=np.arange(1, n_nodes + 1),
        coordinates=np.column_stack([np.zeros((n_nodes, 2)), z]),
        dof_node=np.repeat(np.arange(n_nodes), 4),
        dof_direction=list(DIRECTIONS) * n_nodes,
        cell_types=np.full(n_nodes - 1, VTK_LINE),
        cell_starts=2 * np.arange(n_nodes),
        cell_nodes=np.column_stack([np.arange(n_nodes - 1), np.arange(1, n_nodes)]).ravel(),
        sets=sets,
        source=f"rotor, {n_nodes - 1} elements, {speed:g} rad/s",
    )


def _element(h, deflection, both, slope, far_deflection, far_both, far_slope) -> np.ndarray:
    """Matrix of a beam element between deflection and slope of both ends, from the numbers that make it up."""
    near = np.array([[deflection, both * h], [both * h, slope * h**2]])
    other = np.array([[deflection, -both * h], [-both * h, slope * h**2]])
    far = np.array([[far_deflection, far_both * h], [-far_both * h, far_slope * h**2]])
    return np.block([[near, far], [far.T, other]])


def _node(z, position, length) -> int:
    if not 0 <= position <= length:
        raise ModelError(f"a disk or bearing at {position} is not on the shaft, 0 to {length}")
    return int(np.argmin(np.abs(z - position)))
