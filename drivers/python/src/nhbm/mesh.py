"""A mesh as a file of another program has it: nodes by their numbers, cells of VTK, sets of nodes in their order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

DIRECTIONS = {1: "x", 2: "y", 3: "z", 4: "rx", 5: "ry", 6: "rz"}


@dataclass
class Mesh:
    """Nodes, cells and sets as a file has them, by the numbers of the nodes."""

    numbers: np.ndarray | None  # of the nodes; None: the format has none
    points: np.ndarray  # (nodes, 3), nan where it is not known
    cells: list[tuple[int, list[int]]] = field(default_factory=list)  # VTK type, numbers of its nodes
    sets: dict[str, list[int]] = field(default_factory=dict)  # numbers of nodes, in the order of the file
    frames: dict[int, str] = field(default_factory=dict)  # nodes whose degrees of freedom are not along x, y, z: why
    notes: list[str] = field(default_factory=list)  # what the file has and this does not
    adds_nodes: bool = False  # whether its elements get nodes that the file does not list


def one_per_name(sets: Iterable[tuple[str, list[int]]]) -> tuple[dict[str, list[int]], list[str]]:
    """Sets by their names, which inputs compare in lower case; of several with one name none is taken, which the notes say."""
    found: dict[str, list[tuple[str, list[int]]]] = {}
    for name, members in sets:
        found.setdefault(name.lower(), []).append((name, members))
    notes = [f"{len(several)} sets have the name '{name}' in lower case: none of them is taken"
             for name, several in found.items() if len(several) > 1]  # fmt: skip
    return dict(several[0] for several in found.values() if len(several) == 1), notes
