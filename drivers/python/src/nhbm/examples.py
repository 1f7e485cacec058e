"""Models of plates, beams and solid blocks made with scikit-fem: to try things out, and for tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError, imported
from nhbm.structure import Structure

VTK_LINE, VTK_QUAD, VTK_QUADRATIC_TETRA = 3, 9, 24

STEEL = {"young": 2.1e11, "poisson": 0.3, "density": 7850.0}


def _skfem() -> Any:
    return imported("skfem", "examples are created with", "scikit-fem")


def beam(
    length: float = 1.0,
    n_elements: int = 20,
    width: float = 0.03,
    height: float = 0.01,
    clamped: str = "left",
    young: float = 2.1e11,
    density: float = 7850.0,
) -> Structure:
    """Bernoulli beam along x that bends along z: `z` and the slope `zx` at each node."""
    fem = _skfem()
    _above_zero(length=length, n_elements=n_elements, width=width, height=height, young=young, density=density)
    mesh = fem.MeshLine(np.linspace(0.0, length, int(n_elements) + 1))
    basis = fem.Basis(mesh, fem.ElementLineHermite(), intorder=6)
    bending, area = young * width * height**3 / 12, width * height
    stiffness = fem.BilinearForm(lambda u, v, w: bending * u.hess[0, 0] * v.hess[0, 0]).assemble(basis)
    mass = fem.BilinearForm(lambda u, v, w: density * area * u * v).assemble(basis)
    points = np.vstack([mesh.p, np.zeros((2, mesh.p.shape[1]))]).T
    sets = {"left": np.flatnonzero(points[:, 0] == 0.0), "right": np.flatnonzero(np.isclose(points[:, 0], length))}
    fixed = _clamped(clamped)
    return _nodal(
        stiffness, mass, basis.nodal_dofs, ("z", "zx"), points, mesh.t, VTK_LINE, sets, fixed, f"beam, {n_elements} elements"
    )


def plate(
    length: float = 0.4,
    width: float = 0.3,
    thickness: float = 0.004,
    n_x: int = 10,
    n_y: int = 8,
    edges: str = "clamped",
    young: float = 2.1e11,
    poisson: float = 0.3,
    density: float = 7850.0,
) -> Structure:
    """Kirchhoff plate in the plane of x and y that bends along z, by the rectangle of Bogner, Fox and Schmit: `z`, its slopes `zx`
    and `zy` and its twist `zxy` at each node. Edges are `clamped`, `supported`, `cantilever` (clamped at x = 0) or `free`."""
    fem = _skfem()
    _above_zero(length=length, width=width, thickness=thickness, n_x=n_x, n_y=n_y, young=young, poisson=poisson, density=density)
    mesh = fem.MeshQuad.init_tensor(np.linspace(0, length, int(n_x) + 1), np.linspace(0, width, int(n_y) + 1))
    basis = fem.Basis(mesh, fem.ElementQuadBFS(), intorder=8)
    bending = young * thickness**3 / (12 * (1 - poisson**2))

    def energy(u: Any, v: Any, w: Any) -> Any:
        a, b = u.hess, v.hess
        trace_a, trace_b = a[0, 0] + a[1, 1], b[0, 0] + b[1, 1]
        product = a[0, 0] * b[0, 0] + a[1, 1] * b[1, 1] + 2 * a[0, 1] * b[0, 1]
        return bending * (poisson * trace_a * trace_b + (1 - poisson) * product)

    stiffness = fem.BilinearForm(energy).assemble(basis)
    mass = fem.BilinearForm(lambda u, v, w: density * thickness * u * v).assemble(basis)
    x, y = mesh.p
    sides = {"left": x == 0.0, "right": np.isclose(x, length), "front": y == 0.0, "back": np.isclose(y, width)}
    sets = {name: np.flatnonzero(where) for name, where in sides.items()}
    points = np.vstack([mesh.p, np.zeros((1, mesh.p.shape[1]))]).T
    # what a support holds at each side: the motion and its slope along the side, and the slope across it where it is clamped
    along = {"left": ("z", "zy"), "right": ("z", "zy"), "front": ("z", "zx"), "back": ("z", "zx")}
    held = {
        "clamped": dict.fromkeys(sides, ("z", "zx", "zy", "zxy")),
        "supported": along,
        "cantilever": {"left": ("z", "zx", "zy", "zxy")},
        "free": {},
    }
    if edges not in held:
        raise ModelError(f"edges are {', '.join(held)}, not '{edges}'")
    return _nodal(
        stiffness, mass, basis.nodal_dofs, ("z", "zx", "zy", "zxy"), points, mesh.t, VTK_QUAD, sets, held[edges],
        f"plate, {n_x} x {n_y} elements, {edges}",
    )  # fmt: skip


def solid(
    length: float = 0.2,
    width: float = 0.04,
    height: float = 0.02,
    n_x: int = 10,
    n_y: int = 2,
    n_z: int = 2,
    clamped: str = "left",
    young: float = 2.1e11,
    poisson: float = 0.3,
    density: float = 7850.0,
) -> Structure:
    """Block of quadratic tetrahedra with `x`, `y`, `z` at each node."""
    fem = _skfem()
    _above_zero(length=length, width=width, height=height, n_x=n_x, n_y=n_y, n_z=n_z, young=young, poisson=poisson, density=density)
    mesh = fem.MeshTet.init_tensor(*(np.linspace(0, side, int(n) + 1) for side, n in ((length, n_x), (width, n_y), (height, n_z))))
    stiffness, mass, dofs, points, cells = _elastic(mesh, young, poisson, density)
    sets = {
        "left": np.flatnonzero(np.isclose(points[:, 0], 0.0)),
        "right": np.flatnonzero(np.isclose(points[:, 0], length)),
        "top": np.flatnonzero(np.isclose(points[:, 2], height)),
        "bottom": np.flatnonzero(np.isclose(points[:, 2], 0.0)),
    }
    fixed = _clamped(clamped)
    return _nodal(
        stiffness, mass, dofs, ("x", "y", "z"), points, cells, VTK_QUADRATIC_TETRA, sets, fixed,
        f"solid, {n_x} x {n_y} x {n_z} x 6 tetrahedra",
    )  # fmt: skip


def sector(
    n_sectors: int = 12, hub: float = 0.08, rim: float = 0.14, platform: float = 0.16, tip: float = 0.26,
    height: float = 0.012, clamped: str = "hub", young: float = 2.1e11, poisson: float = 0.3,
    density: float = 7850.0,
) -> Structure:  # fmt: skip
    """Sector of a bladed disk about the axis z: disk, neck, platform and blade of quadratic tetrahedra, `clamped` at the hub or not
    at all (`none`)."""
    fem = _skfem()
    _above_zero(hub=hub, height=height, young=young, poisson=poisson, density=density)
    if n_sectors < 3:
        raise ModelError(f"a wheel has three sectors or more, not {n_sectors}")
    if not hub < rim < platform < tip:
        raise ModelError(f"hub, rim, platform and tip must rise: {hub}, {rim}, {platform}, {tip}")
    if clamped not in ("hub", "none"):
        raise ModelError(f"clamped is 'hub' or 'none', not '{clamped}'")
    edge = 0.1 * (tip - platform)
    radii = np.concatenate([np.linspace(hub, rim, 3), [platform], np.linspace(platform + edge, tip, 5)])
    angles = 2 * np.pi / n_sectors * np.array([-0.5, -0.42, -0.1, 0.1, 0.42, 0.5])
    mesh = fem.MeshTet.init_tensor(radii, angles, np.array([0.0, height]))
    r, phi, _ = mesh.p[:, mesh.t].mean(axis=1)
    share = np.abs(phi) * n_sectors / (2 * np.pi)
    mesh = mesh.restrict(np.flatnonzero((r < rim) | (share < 0.1) | ((r > platform) & (r < platform + edge) & (share < 0.42))))
    r, phi, (stiffness, mass, dofs, points, cells) = _around_z(mesh, young, poisson, density)
    side, middle = np.pi / n_sectors, np.isclose(points[:, 2], height / 2)
    facing = np.isclose(r, platform) & np.isclose(points[:, 2], 0.0)
    sets = {
        "hub": np.flatnonzero(np.isclose(r, hub)),
        "low": np.flatnonzero(np.isclose(phi, -side)),
        "high": np.flatnonzero(np.isclose(phi, side)),
        "under_low": np.flatnonzero(facing & np.isclose(phi, -0.84 * side)),
        "under_high": np.flatnonzero(facing & np.isclose(phi, 0.84 * side)),
        "tip": np.flatnonzero(np.isclose(r, tip) & np.isclose(phi, 0.0) & middle),
    }
    return _nodal(
        stiffness, mass, dofs, ("x", "y", "z"), points, cells, VTK_QUADRATIC_TETRA, sets, ["hub"] * (clamped == "hub"),
        f"bladed sector, 1 of {n_sectors}",
    )  # fmt: skip


def ring(
    n_sectors: int = 12,
    inner: float = 0.262,
    outer: float = 0.272,
    height: float = 0.012,
    young: float = 2.1e11,
    poisson: float = 0.3,
    density: float = 7850.0,
) -> Structure:
    """Sector of a casing, a ring about the axis z that nothing holds, of quadratic tetrahedra; the set `inside` is the node of its
    middle that the blade of a `sector` meets."""
    fem = _skfem()
    _above_zero(inner=inner, height=height, young=young, poisson=poisson, density=density)
    if n_sectors < 3:
        raise ModelError(f"a wheel has three sectors or more, not {n_sectors}")
    if not inner < outer:
        raise ModelError(f"inner and outer must rise: {inner}, {outer}")
    side = np.pi / n_sectors
    mesh = fem.MeshTet.init_tensor(np.array([inner, outer]), np.array([-side, 0.0, side]), np.array([0.0, height]))
    r, phi, (stiffness, mass, dofs, points, cells) = _around_z(mesh, young, poisson, density)
    sets = {
        "low": np.flatnonzero(np.isclose(phi, -side)),
        "high": np.flatnonzero(np.isclose(phi, side)),
        "inside": np.flatnonzero(np.isclose(r, inner) & np.isclose(phi, 0.0) & np.isclose(points[:, 2], height / 2)),
    }
    return _nodal(
        stiffness, mass, dofs, ("x", "y", "z"), points, cells, VTK_QUADRATIC_TETRA, sets, [], f"ring, 1 of {n_sectors} sectors"
    )


def _around_z(mesh: Any, young: Any, poisson: Any, density: Any) -> Any:
    """Radius and angle of the nodes of a body given in these and z, and what `_elastic` makes of it. Middles of edges have those of
    their ends, so that both sides of a sector have them at the same positions."""
    polar = mesh.p
    bent = _skfem().MeshTet(np.vstack([polar[0] * np.cos(polar[1]), polar[0] * np.sin(polar[1]), polar[2]]), mesh.t)
    r, phi = np.hstack([polar[:2], polar[:2][:, bent.edges].mean(axis=1)])
    return r, phi, _elastic(bent, young, poisson, density)


def _elastic(mesh: Any, young: Any, poisson: Any, density: Any) -> Any:
    """Stiffness and mass of an elastic body of quadratic tetrahedra; numbers of the degrees of freedom (3, n_nodes), positions of
    the nodes, cells in the order of VTK."""
    fem = _skfem()
    basis = fem.Basis(mesh, fem.ElementVector(fem.ElementTetP2()), intorder=4)
    lame = young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))

    def energy(u: Any, v: Any, w: Any) -> Any:
        a, b = u.grad, v.grad
        strain = (a + np.swapaxes(a, 0, 1)) / 2, (b + np.swapaxes(b, 0, 1)) / 2
        trace = [s[0, 0] + s[1, 1] + s[2, 2] for s in strain]
        return lame[0] * trace[0] * trace[1] + 2 * lame[1] * np.einsum("ij...,ij...", *strain)

    stiffness = fem.BilinearForm(energy).assemble(basis)
    mass = fem.BilinearForm(lambda u, v, w: density * np.einsum("i...,i...", u, v)).assemble(basis)
    ends = mesh.p[:, mesh.edges]
    points = np.hstack([mesh.p, ends.mean(axis=1)]).T
    dofs = np.hstack([basis.nodal_dofs, basis.edge_dofs])
    cells = np.vstack([mesh.t, mesh.t2e[[0, 1, 2, 3, 4, 5]] + mesh.p.shape[1]])
    return stiffness, mass, dofs, points, _vtk_order(mesh, cells)


def _vtk_order(mesh: Any, cells: Any) -> Any:
    """Middle nodes in VTK's order, edges (0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3), whatever theirs is; corners so that the
    volume is positive."""
    wanted = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    n = mesh.p.shape[1]
    edges = mesh.edges[:, cells[4:] - n]  # (2, 6, n_cells)
    order = []
    for a, b in wanted:
        ends = np.sort(cells[[a, b], 0])
        order.append(next(k for k in range(6) if (np.sort(edges[:, k, 0]) == ends).all()))
    cells = np.vstack([cells[:4], cells[4:][order]])
    corners = mesh.p[:, cells[:4]]  # (3, 4, n_cells)
    sides = corners[:, 1:] - corners[:, :1]
    inverted = np.linalg.det(np.moveaxis(sides, -1, 0)) < 0
    cells[:, inverted] = cells[[0, 2, 1, 3, 6, 5, 4, 7, 9, 8]][:, inverted]
    return cells


def _nodal(
    stiffness: Any, mass: Any, dofs: Any, directions: Any, points: Any, cells: Any, vtk_type: Any, sets: Any, held: Any, source: Any
) -> Structure:
    """Model of the degrees of freedom that are not held, node by node. `held`: names of sets, or directions by set."""
    n_nodes = len(points)
    is_free = np.ones((len(directions), n_nodes), dtype=bool)
    for name in held:
        which = held[name] if isinstance(held, dict) else directions
        for direction in which:
            is_free[directions.index(direction), sets[name]] = False
    node = np.repeat(np.arange(n_nodes), len(directions))
    direction = np.tile(np.arange(len(directions)), n_nodes)
    free = is_free[direction, node]
    node, direction = node[free], direction[free]
    order = dofs[direction, node]
    pick = {"stiffness": stiffness, "mass": mass}
    symmetric = {name: sp.csr_matrix((m + m.T) / 2)[order][:, order] for name, m in pick.items()}
    moving = np.zeros(n_nodes, dtype=bool)
    moving[node] = True
    return Structure(
        **symmetric,
        labels=[f"n{i + 1}.{directions[d]}" for i, d in zip(node, direction)],
        units=["m" if len(directions[d]) == 1 else "rad" if len(directions[d]) == 2 else "rad/m" for d in direction],
        node_numbers=np.arange(1, n_nodes + 1),
        coordinates=points,
        dof_node=node,
        dof_direction=[directions[d] for d in direction],
        cell_types=np.full(cells.shape[1], vtk_type),
        cell_starts=np.arange(cells.shape[1] + 1) * cells.shape[0],
        cell_nodes=cells.T.ravel(),
        sets={name: nodes[moving[nodes]] for name, nodes in sets.items() if moving[nodes].any()},
        source=f"scikit-fem: {source}",
    )


def _clamped(ends: str) -> list[str]:
    known = {"left": ["left"], "right": ["right"], "both": ["left", "right"], "none": []}
    if ends not in known:
        raise ModelError(f"clamped ends are {', '.join(known)}, not '{ends}'")
    return known[ends]


def nearest_node(model: Structure, position: Any) -> int:
    """Index of the node that moves and is closest to a position."""
    moving = np.unique(model.dof_node[model.dof_node >= 0])
    distance = np.linalg.norm(model.coordinates[moving] - np.asarray(position), axis=1)
    nearest, extent = int(np.argmin(distance)), float(np.ptp(model.coordinates, axis=0).max())
    if not distance[nearest] <= 0.5 * extent:
        at = ", ".join(f"{x:g}" for x in model.coordinates[moving[nearest]])
        raise ModelError(f"no node is near {', '.join(f'{x:g}' for x in position)}: the closest is at {at}")
    return int(moving[nearest])


def _above_zero(**values: Any) -> None:
    for name, value in values.items():
        if name == "poisson" and not -1 < value < 0.5:
            raise ModelError(f"poisson must be above -1 and below 0.5, not {value}")
        if name != "poisson" and not 0 < value < np.inf:
            raise ModelError(f"{name} must be above 0, not {value}")
