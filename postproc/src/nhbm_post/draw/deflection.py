"""A quick view of a motion in space: the deflected surface of a finite element model, coloured by its amplitude."""

from __future__ import annotations

from collections import Counter

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.ticker import FixedLocator, MaxNLocator

from ..structure import Structure
from .style import COLOUR_MAP, INK, figure, head, look, unit_scale

# Corners of the faces of each kind of VTK cell; mid-side nodes of quadratic cells are omitted.
_TETRA = ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))
_HEXA = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_WEDGE = ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
_FACES = {3: ((0, 1),), 5: ((0, 1, 2),), 9: ((0, 1, 2, 3),), 10: _TETRA, 12: _HEXA, 13: _WEDGE,
          21: ((0, 1),), 22: ((0, 1, 2),), 23: ((0, 1, 2, 3),), 24: _TETRA, 25: _HEXA, 26: _WEDGE}  # fmt: skip
_LARGEST = 0.12  # largest deflection in the picture, relative to the largest extent
_THIN = 0.3  # smallest side of the box around a body in the picture, relative to the longest
_FLAT = 0.1  # limits of extent and deflection across a plane, relative to those along it, of bodies that are drawn from above


def draw_deflection(structure: Structure, displacement: np.ndarray, colours_by: tuple[str, np.ndarray], heading: str, about: str):
    """The structure deflected by `displacement` (n_nodes, 3), coloured by sizes (n_nodes) that have a name, in metres."""
    # Imported here, because pictures in a plane are also drawn by a newer matplotlib than the system's, without its mpl_toolkits.
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    name, amplitude = colours_by
    with look():
        fig = figure(5.6, 4.3, is_arranged=False)
        scale = scale_of(structure, displacement)
        points = structure.points + scale * displacement
        faces = surface(structure.cells)
        factor, units = unit_scale(float(amplitude.max()), "m")
        is_lines = all(len(face) == 2 for face in faces)
        style = {"cmap": COLOUR_MAP, "linewidths": 2.5 if is_lines else 0.3}
        style["norm"] = Normalize(0.0, factor * float(amplitude.max()) or 1.0)
        across = flat_across(structure.points, displacement)
        if across is None:
            axes = fig.add_axes((0.0, 0.09, 0.8, 0.77), projection="3d")
            drawn = (Line3DCollection if is_lines else Poly3DCollection)([points[list(face)] for face in faces], **style)
            axes.add_collection3d(drawn)
            _frame(axes, points)
        else:
            axes = fig.add_axes((0.13, 0.14, 0.66, 0.7), aspect="equal", adjustable="datalim")
            along = [k for k in range(3) if k != across]
            drawn = (LineCollection if is_lines else PolyCollection)([points[list(face)][:, along] for face in faces], **style)
            axes.add_collection(drawn)
            axes.autoscale_view()
            axes.set_xlabel(f"{'xyz'[along[0]]} [m]")
            axes.set_ylabel(f"{'xyz'[along[1]]} [m]")
        drawn.set_array(factor * np.array([amplitude[list(face)].mean() for face in faces]))
        if not is_lines:
            drawn.set_edgecolor(INK)
        fig.colorbar(drawn, cax=fig.add_axes((0.84, 0.2, 0.025, 0.5)), label=f"{name} [{units}]")
        head(fig, heading, about, f"displacements scaled by {float(f'{scale:.3g}'):g}" if scale else "")
    return fig


def _frame(axes, points: np.ndarray) -> None:
    """Limits, labels and proportions of axes in space: the same scale along each axis."""
    middle, half = (points.max(axis=0) + points.min(axis=0)) / 2, 0.5 * np.ptp(points, axis=0)
    half = np.maximum(half, _THIN * half.max())
    is_upright = half[2] == half.max()
    for k, label in enumerate("xyz"):
        is_long = half[k] > 0.5 * half.max()
        few = FixedLocator([0.0]) if is_upright else MaxNLocator(2)  # two short sides that meet have no room for more
        getattr(axes, f"set_{label}lim")(middle[k] - half[k], middle[k] + half[k])
        getattr(axes, f"set_{label}label")(f"{label} [m]", labelpad=(18.0 if is_upright else 10.0) if is_long else 4.0)
        getattr(axes, f"{label}axis").set_major_locator(MaxNLocator(4) if is_long else few)
    axes.set_box_aspect(half, zoom=0.85 if is_upright else 1.0)


def scale_of(structure: Structure, displacement: np.ndarray) -> float:
    """Magnification of a displacement in the picture."""
    largest = float(np.abs(displacement).max())
    return _LARGEST * float(np.ptp(structure.points, axis=0).max()) / largest if largest > 0 else 0.0


def flat_across(points: np.ndarray, displacement: np.ndarray) -> int | None:
    """The direction normal to a plane body that moves only in its plane; none for others."""
    extent, largest = np.ptp(points, axis=0), np.abs(displacement).max(axis=0)
    across = int(np.argmin(extent))
    along = [k for k in range(3) if k != across]
    is_flat = 0 < extent[across] < _FLAT * extent[along].min() and largest[across] < _FLAT * largest.max()
    return across if is_flat else None


def surface(cells) -> list[tuple[int, ...]]:
    """Faces that belong to only one cell, for solids; lines and shells unchanged."""
    faces = [
        tuple(int(nodes[k]) for k in corners) for kind, nodes in cells for corners in _FACES.get(int(kind), ())
    ]
    count = Counter(frozenset(face) for face in faces)
    return [face for face in faces if count[frozenset(face)] == 1]
