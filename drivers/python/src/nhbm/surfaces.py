"""Contact between two surfaces whose meshes need not match: points with an area, a frame, and their relative motion.

Each corner j of the first surface is a point. With the linear shape functions psi_j of the corners, integrated over the part of
both surfaces where they face each other, its relative motion is the mean of u_1 - u_2 weighted by psi_j, and its area the integral
of psi_j. Since the psi_j add up to one, a uniform pressure passes as such, whatever the meshes (patch test). Source: Puso, A 3D
mortar method for solid mechanics, Int. J. Numer. Meth. Engng 59 (2004), and for quadratic faces with linear multipliers Puso,
Laursen
and Solberg, Comput. Methods Appl. Mech. Engrg. 197 (2008). Faces are flat between their corners; nodes between corners stand
halfway.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from nhbm.decks import FACES_OF_CELLS
from nhbm.errors import ModelError
from nhbm.structure import CONTACT_DIRECTIONS, Contact

if TYPE_CHECKING:
    import scipy.sparse as sp

    from nhbm.structure import Structure

FACING = -0.5  # cosine of the angle between the outward normals of faces that face each other, at most
TOUCHING = 1.0e-3  # distance at which faces touch without --within, in diameters of a face
FRICTION = ("bouc_wen", "coulomb_rigid", "coulomb_tanh", "iwan", "jenkins", "jenkins_2d", "stribeck")
SLIVER = 1.0e-10  # share of a face that rounding leaves of an overlap
SAME_DIRECTION = 0.9  # cosine with the x axis of a normal whose first tangent is taken from the y axis

# Points and weights on the triangle, exact up to degree 6 (Dunavant, Int. J. Numer. Meth. Engng 21 (1985)): weight, two equal or
# three different area coordinates
_A = ((0.116786275726379, 0.249286745170910), (0.050844906370207, 0.063089014491502))
_B = (0.082851075618374, 0.310352451033785, 0.053145049844816)


def _rule() -> tuple[np.ndarray, np.ndarray]:
    points, weights = [], []
    for weight, a in _A:
        points += [(a, a, 1 - 2 * a), (a, 1 - 2 * a, a), (1 - 2 * a, a, a)]
        weights += 3 * [weight]
    weight, a, b = _B
    c = 1 - a - b
    points += [(a, b, c), (a, c, b), (b, a, c), (b, c, a), (c, a, b), (c, b, a)]
    weights += 6 * [weight]
    return np.array(points), np.array(weights)


_POINTS, _WEIGHTS = _rule()


class Face(NamedTuple):
    """A face of a cell on the surface of a body."""

    nodes: np.ndarray  # indices, its corners first
    corners: np.ndarray  # (3 or 4, 3), positions
    normal: np.ndarray  # outward
    diameter: float


def faces_of(model: Structure, name: str) -> list[Face]:
    """The faces on the surface of a model all of whose nodes belong to a set."""
    if name not in model.sets:
        raise ModelError(f"there is no set '{name}'; sets: {', '.join(model.sets) or 'none'}")
    if not len(model.cell_types):
        raise ModelError("the model has no cells, and so no faces: give its mesh (--mesh)")
    is_member = np.zeros(len(model.node_numbers), dtype=bool)
    is_member[model.sets[name]] = True
    found: dict[tuple[int, ...], Face | None] = {}
    for kind, start, end in zip(model.cell_types, model.cell_starts, model.cell_starts[1:]):
        nodes = model.cell_nodes[start:end]
        if np.count_nonzero(is_member[nodes]) < 3:
            continue
        for n_corners, places in FACES_OF_CELLS.get(int(kind), ()):
            members = nodes[list(places)]
            if not is_member[members].all():
                continue
            key = tuple(sorted(members.tolist()))
            if key in found:
                found[key] = None  # between two cells
                continue
            corners = model.coordinates[members[:n_corners]]
            middle = corners.mean(axis=0)
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            if n_corners == 4:
                normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
            if normal @ (model.coordinates[nodes].mean(axis=0) - middle) > 0.0:
                normal = -normal
            size = np.linalg.norm(normal)
            if not size > 0.0:
                raise ModelError(f"set '{name}': the face with node {model.node_numbers[members[0]]} has no area")
            found[key] = Face(members, corners, normal / size, 2 * float(np.linalg.norm(corners - middle, axis=1).max()))
    faces = [face for face in found.values() if face is not None]
    if not faces:
        raise ModelError(
            f"set '{name}' has no face of a solid cell: all nodes of a face must belong to it, also those between corners"
        )
    return faces


def contact(model: Structure, first: str, second: str, within: float = 0.0) -> Contact:
    """The contact between two surfaces, sets of nodes, where faces of the first face one of the second, no farther apart than
    `within` [m] (0: where they touch)."""
    from scipy.sparse import csr_matrix
    from scipy.spatial import cKDTree

    ours, theirs = faces_of(model, first), faces_of(model, second)
    if set(model.sets[first].tolist()) & set(model.sets[second].tolist()):
        raise ModelError(f"sets '{first}' and '{second}' have nodes in common: surfaces belong to two bodies")
    _check_directions(model, ours + theirs, first, second)
    tree = cKDTree([face.corners.mean(axis=0) for face in theirs])
    largest = max(face.diameter for face in theirs)
    rows, columns, values = [], [], []
    areas, gaps, normals, places = (np.zeros((len(model.node_numbers), n)) for n in (1, 1, 3, 3))
    closest = np.inf
    for face in ours:
        allowed = max(within, TOUCHING * face.diameter)
        for k in tree.query_ball_point(face.corners.mean(axis=0), (face.diameter + largest) / 2 + allowed):
            other = theirs[k]
            if face.normal @ other.normal > FACING:
                continue
            weights, inside, there, across = _overlap(face, other)
            if not len(weights):
                continue
            distance = abs(across).min()
            closest = min(closest, distance)
            if distance > allowed:
                continue
            n = len(face.corners)
            test = _shapes(n, n, inside).T * weights  # (corners, points)
            ours_here = test @ _shapes(n, len(face.nodes), inside)
            theirs_here = test @ _shapes(len(other.corners), len(other.nodes), there)
            for j, node in enumerate(face.nodes[:n]):
                rows += [node] * (len(face.nodes) + len(other.nodes))
                columns += [*face.nodes, *other.nodes]
                values += [*ours_here[j], *-theirs_here[j]]
            here = face.nodes[:n]
            areas[here, 0] += test.sum(axis=1)
            gaps[here, 0] += test @ across
            normals[here] += test.sum(axis=1)[:, None] * face.normal
            places[here] += test @ _shapes(n, n, inside) @ face.corners
    points = np.flatnonzero(areas[:, 0] > SLIVER * areas.max())
    if not len(points):
        apart = f"; the closest faces are {closest:.3g} apart: give --within" if np.isfinite(closest) else ""
        raise ModelError(f"no face of '{first}' faces one of '{second}'{apart}")
    n_nodes = len(model.node_numbers)
    weights = csr_matrix((values, (rows, columns)), (n_nodes, n_nodes))[points]
    of_points = areas[points, 0]
    weights = csr_matrix(weights.multiply(1.0 / of_points[:, None]))
    return Contact(weights, of_points, np.array([_frame(normal) for normal in normals[points]]), gaps[points, 0] / of_points,
                   places[points] / of_points[:, None])  # fmt: skip


def contact_of(model: Structure, name: str) -> tuple[str, str] | None:
    """The contact between surfaces and the direction that a name such as `joint.n` stands for; none for what is another name."""
    stem, _, direction = name.rpartition(".")
    found = model.contacts.get(stem)
    if found is None or found.weights is None:
        return None
    if direction not in CONTACT_DIRECTIONS:
        raise ModelError(f"contact '{stem}' has the directions {', '.join(CONTACT_DIRECTIONS)}, not '{direction}'")
    return stem, direction


def relative_motion(model: Structure, name: str) -> sp.csr_matrix:
    """The motion of the first surface relative to the second along a direction of a contact, `joint.n`: rows @ degrees of freedom,
    (points, degrees of freedom) [1]. The columns of a row and its values are `dofs` and `weights` of a law at this point."""
    import scipy.sparse as sp

    stem, direction = contact_of(model, name) or ("", "")
    contact = model.contacts[stem]
    rows = sp.csr_matrix((len(contact.areas), model.n_dofs))
    for along, axis in zip(contact.along(direction).T, "xyz"):
        dofs = [dof for dof, d in enumerate(model.dof_direction) if d == axis and model.dof_node[dof] >= 0]
        at_nodes = sp.csr_matrix((np.ones(len(dofs)), (model.dof_node[dofs], dofs)), (len(model.node_numbers), model.n_dofs))
        rows = rows + sp.diags(along) @ contact.weights @ at_nodes
    rows = sp.csr_matrix(rows)
    rows.eliminate_zeros()
    return rows


def laws(
    model: Structure, name: str, kind: str, per_area: Mapping[str, float], along: str = "", **keys: Any
) -> list[dict[str, Any]]:
    """Keys of one law for each point of a contact, as `Model.law` takes them.

    Parameters
    ----------
    model : Structure
        With the contact `name`, reduced to its directions or whole.
    kind : str
        Type of the law. With `friction_coefficient` it has the direction n as normal one; `jenkins_2d` slips along s and t.
    per_area : mapping
        Keys whose values are multiplied by the area of the point, such as ``stiffness`` [N/m3] and ``preload`` [N/m2].
    along : str
        Direction of a law of one coordinate: by default "s" for friction, else "n".
    **keys
        Keys with the same value at all points.
    """
    if name not in model.contacts:
        raise ModelError(f"there is no contact '{name}'; contacts: {', '.join(model.contacts) or 'none'}")
    both = sorted(set(per_area) & set(keys))
    if both:
        raise ModelError(f"'{both[0]}' is given for each area and for each point")
    roles = {"": along or ("s" if kind in FRICTION else "n")}
    if kind == "jenkins_2d":
        roles = {"": "s", "second_": "t"}
    if "friction_coefficient" in keys:
        roles["normal_"] = "n"
    at = {role: _coordinates(model, name, direction) for role, direction in roles.items()}
    found = []
    for k, area in enumerate(model.contacts[name].areas):
        law: dict[str, Any] = {"kind": kind, "label": f"{name} {k + 1}"}
        for role, coordinates in at.items():
            dofs, weights = coordinates[k]
            if weights is not None:
                law |= {f"{role}dofs": dofs, f"{role}weights": weights}
            else:
                law |= {f"{role}dofs": dofs} if role else {"dof": dofs[0]}
        found.append(law | {key: float(value) * float(area) for key, value in per_area.items()} | keys)
    return found


def _coordinates(model: Structure, name: str, direction: str) -> list[tuple[list[str], list[float] | None]]:
    """Degrees of freedom and weights of a direction at each point; a reduced model has it as a degree of freedom."""
    if model.contacts[name].weights is None:
        return [([model.labels[dof]], None) for dof in model.dofs_of(f"{name}.{direction}")]
    rows = relative_motion(model, f"{name}.{direction}")
    return [([model.labels[dof] for dof in row.indices], row.data.tolist()) for row in rows]


def _check_directions(model: Structure, faces: list[Face], first: str, second: str) -> None:
    """Refuses nodes that do not move along x, y and z."""
    moving: dict[int, set[str]] = {}
    for node, direction in zip(model.dof_node, model.dof_direction):
        moving.setdefault(int(node), set()).add(direction)
    for node in np.unique(np.concatenate([face.nodes for face in faces])):
        missing = sorted({"x", "y", "z"} - moving.get(int(node), set()))
        if missing:
            raise ModelError(f"surfaces '{first}' and '{second}': node {model.node_numbers[node]} has no degree of freedom "
                             f"'{missing[0]}'; leave nodes that are held out of the sets")  # fmt: skip


def _frame(normal: np.ndarray) -> np.ndarray:
    """Directions n, s, t as rows: s is the x axis (the y axis where that is nearly normal) in the plane, t = n x s."""
    n = normal / np.linalg.norm(normal)
    axis = np.array([0.0, 1.0, 0.0]) if abs(n[0]) > SAME_DIRECTION else np.array([1.0, 0.0, 0.0])
    s = axis - (axis @ n) * n
    s /= np.linalg.norm(s)
    return np.array([n, s, np.cross(n, s)])


def _overlap(face: Face, other: Face) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Integration points of the part of a face that faces another one, along the normal of the first: their weights [m2], local
    coordinates in both (points, 2), and the distance across, positive where the faces are apart [m]."""
    middle = face.corners.mean(axis=0)
    plane = _frame(face.normal)[1:]
    flat, far = ((corners - middle) @ plane.T for corners in (face.corners, other.corners))
    polygon = _clipped(_counterclockwise(far), _counterclockwise(flat))
    none = np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    if len(polygon) < 3:
        return none
    centre = polygon.mean(axis=0)
    places, weights = [], []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0)):
        area = 0.5 * float((a[0] - centre[0]) * (b[1] - centre[1]) - (a[1] - centre[1]) * (b[0] - centre[0]))
        places.append(_POINTS @ np.array([centre, a, b]))
        weights.append(area * _WEIGHTS)
    if sum(one.sum() for one in weights) < SLIVER * face.diameter**2:
        return none
    place = np.vstack(places)
    inside, there = _local(flat, place), _local(far, place)
    heights = [_shapes(len(c), len(c), local) @ ((c - middle) @ face.normal)
               for c, local in ((face.corners, inside), (other.corners, there))]  # fmt: skip
    return np.concatenate(weights), inside, there, heights[1] - heights[0]


def _counterclockwise(polygon: np.ndarray) -> np.ndarray:
    x, y = polygon.T
    return polygon if x @ np.roll(y, -1) - y @ np.roll(x, -1) > 0.0 else polygon[::-1]


def _clipped(subject: np.ndarray, window: np.ndarray) -> np.ndarray:
    """The part of a convex polygon inside another one (Sutherland and Hodgman), both counterclockwise."""
    for start, end in zip(window, np.roll(window, -1, axis=0)):
        if len(subject) == 0:
            break
        edge = end - start
        side = edge[0] * (subject[:, 1] - start[1]) - edge[1] * (subject[:, 0] - start[0])
        kept = []
        for i in range(len(subject)):
            k = (i + 1) % len(subject)
            if side[i] >= 0.0:
                kept.append(subject[i])
            if (side[i] > 0.0 > side[k]) or (side[i] < 0.0 < side[k]):
                kept.append(subject[i] + side[i] / (side[i] - side[k]) * (subject[k] - subject[i]))
        subject = np.array(kept)
    return subject


def _local(corners: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Local coordinates of positions in a flat face: area coordinates of corners 2 and 3 of a triangle; -1 to 1 in a
    quadrilateral, by Newton's method."""
    if len(corners) == 3:
        return np.linalg.solve((corners[1:] - corners[0]).T, (place - corners[0]).T).T
    local = np.zeros((len(place), 2))
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for _ in range(20):
        error = place - _shapes(4, 4, local) @ corners
        if abs(error).max() <= 1.0e-14 * np.ptp(corners, axis=0).max():
            break
        along = [signs[:, i] * (1 + signs[:, 1 - i] * local[:, 1 - i, None]) / 4 @ corners for i in (0, 1)]
        local += np.linalg.solve(np.stack(along, axis=2), error[:, :, None])[:, :, 0]
    return local


def _shapes(n_corners: int, n_nodes: int, local: np.ndarray) -> np.ndarray:
    """Shape functions of a face with or without nodes between its corners (points, n_nodes)."""
    if n_corners == 3:
        r = np.column_stack([1 - local.sum(axis=1), local])
        if n_nodes == 3:
            return r
        following = np.roll(r, -1, axis=1)
        return np.hstack([r * (2 * r - 1), 4 * r * following])
    x, y = local.T
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = np.column_stack([(1 + a * x) * (1 + b * y) / 4 for a, b in signs])
    if n_nodes == 4:
        return corners
    of_x, of_y = (1 - x * x) / 2, (1 - y * y) / 2
    middles = np.column_stack([of_x * (1 - y), (1 + x) * of_y, of_x * (1 + y), (1 - x) * of_y])
    return np.hstack([corners - (middles + np.roll(middles, 1, axis=1)) / 2, middles])
