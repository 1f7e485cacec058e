"""A quick view of a motion in space: the deflected surface of a finite element model, coloured by its amplitude."""

from __future__ import annotations

from collections import Counter

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from ..structure import Structure
from .style import COLOUR_MAP, INK, figure, head, look, unit_scale

# Corners of the faces of each kind of cell of VTK; middle nodes of quadratic cells are left out.
_TETRA = ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))
_HEXA = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_WEDGE = ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
_FACES = {3: ((0, 1),), 5: ((0, 1, 2),), 9: ((0, 1, 2, 3),), 10: _TETRA, 12: _HEXA, 13: _WEDGE,
          21: ((0, 1),), 22: ((0, 1, 2),), 23: ((0, 1, 2, 3),), 24: _TETRA, 25: _HEXA, 26: _WEDGE}  # fmt: skip
_LARGEST = 0.12  # deflection that is drawn, relative to the largest extent
_THIN = 0.3  # of the longest side of the box round a body, that the others have at least
_FLAT = 0.1  # extent and deflection across a plane, relative to those along it, of bodies that are seen from above
_ABOVE = {0: (0, 0), 1: (0, -90), 2: (90, -90)}  # elevation and azimuth of a view along x, y and z


def draw_deflection(structure: Structure, displacement: np.ndarray, colours_by: tuple[str, np.ndarray], heading: str, about: str):
    """The structure deflected by `displacement` (n_nodes, 3), coloured by sizes (n_nodes) that have a name, in metres."""
    # Here, because pictures in a plane are drawn where a newer matplotlib than the system's has not its own mpl_toolkits.
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    name, amplitude = colours_by
    with look():
        fig = figure(5.6, 4.3, is_arranged=False)
        axes = fig.add_axes((0.0, 0.09, 0.8, 0.77), projection="3d")
        scale = scale_of(structure, displacement)
        points = structure.points + scale * displacement
        faces = surface(structure.cells)
        factor, units = unit_scale(float(amplitude.max()), "m")
        colours = Normalize(0.0, factor * float(amplitude.max()) or 1.0)
        kind = Line3DCollection if all(len(face) == 2 for face in faces) else Poly3DCollection
        width = 0.3 if kind is Poly3DCollection else 2.5
        drawn = kind([points[list(face)] for face in faces], cmap=COLOUR_MAP, norm=colours, linewidths=width)
        drawn.set_array(factor * np.array([amplitude[list(face)].mean() for face in faces]))
        if kind is Poly3DCollection:
            drawn.set_edgecolor(INK)
        axes.add_collection3d(drawn)
        middle, half = (points.max(axis=0) + points.min(axis=0)) / 2, 0.5 * np.ptp(points, axis=0)
        half = np.maximum(half, _THIN * half.max())
        for k, (set_limits, label) in enumerate(((axes.set_xlim, "x"), (axes.set_ylim, "y"), (axes.set_zlim, "z"))):
            set_limits(middle[k] - half[k], middle[k] + half[k])
            getattr(axes, f"set_{label}label")(f"{label} [m]", labelpad=10.0 if half[k] == half.max() else 4.0)
            getattr(axes, f"{label}axis").set_major_locator(MaxNLocator(4 if half[k] > 0.5 * half.max() else 2))
        across = flat_across(structure.points, displacement)
        axes.set_box_aspect(half, zoom=1.0 if across is None else 1.4)
        if across is not None:
            axes.view_init(*_ABOVE[across])
            axes.set_proj_type("ortho")
            getattr(axes, f"set_{'xyz'[across]}label")("")
            getattr(axes, f"set_{'xyz'[across]}ticks")([])
        fig.colorbar(drawn, cax=fig.add_axes((0.84, 0.2, 0.025, 0.5)), label=f"{name} [{units}]")
        head(fig, heading, about, f"drawn {float(f'{scale:.3g}'):g} times as large" if scale else "")
    return fig


def scale_of(structure: Structure, displacement: np.ndarray) -> float:
    """How many times as large a displacement is drawn."""
    largest = float(np.abs(displacement).max())
    return _LARGEST * float(np.ptp(structure.points, axis=0).max()) / largest if largest > 0 else 0.0


def flat_across(points: np.ndarray, displacement: np.ndarray) -> int | None:
    """The direction across which a plane body moves in its plane alone; none of others."""
    extent, largest = np.ptp(points, axis=0), np.abs(displacement).max(axis=0)
    across = int(np.argmin(extent))
    along = [k for k in range(3) if k != across]
    is_flat = 0 < extent[across] < _FLAT * extent[along].min() and largest[across] < _FLAT * largest.max()
    return across if is_flat else None


def surface(cells) -> list[tuple[int, ...]]:
    """Faces that belong to one cell alone, of solids; lines and shells as they are."""
    faces = [
        tuple(int(nodes[k]) for k in corners) for kind, nodes in cells for corners in _FACES.get(int(kind), ())
    ]
    count = Counter(frozenset(face) for face in faces)
    return [face for face in faces if count[frozenset(face)] == 1]
