"""Meshes of Gmsh (.msh), formats 2.2 and 4.1, in text or binary: nodes by their tags, elements, physical groups as sets of nodes.

Groups are told apart by dimension and tag, and an entity may be in several. Source: Gmsh Reference Manual, "Gmsh mesh formats".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from nhbm.errors import ModelError
from nhbm.mesh import Mesh, one_per_name

_HEX20 = (*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15)
_WEDGE15 = (*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11)
_PYRAMID13 = (*range(5), 5, 8, 10, 6, 7, 9, 11, 12)
# by the type of Gmsh: number of nodes, VTK type, the node of the element at each place of the cell
_ELEMENTS: dict[int, tuple[int, int, tuple[int, ...]]] = {
    1: (2, 3, (0, 1)), 2: (3, 5, (0, 1, 2)), 3: (4, 9, (0, 1, 2, 3)), 4: (4, 10, (0, 1, 2, 3)), 5: (8, 12, (*range(8),)),
    6: (6, 13, (*range(6),)), 7: (5, 14, (*range(5),)), 8: (3, 21, (0, 1, 2)), 9: (6, 22, (*range(6),)),
    10: (9, 23, (*range(8),)), 11: (10, 24, (*range(8), 9, 8)), 12: (27, 25, _HEX20), 13: (18, 26, _WEDGE15),
    14: (14, 27, _PYRAMID13), 15: (1, 1, (0,)), 16: (8, 23, (*range(8),)), 17: (20, 25, _HEX20), 18: (15, 26, _WEDGE15),
    19: (13, 27, _PYRAMID13),
}  # fmt: skip
_DIMENSIONS = {15: 0, 1: 1, 8: 1, 2: 2, 3: 2, 9: 2, 10: 2, 16: 2}  # of elements; all others are solids
_NAMES = ("points", "curves", "surfaces", "volumes")

Group = tuple[int, int]  # dimension, tag


class _Numbers:
    """The numbers of a section, of which all must be taken."""

    def __init__(self, body: bytes, is_binary: bool) -> None:
        self.body, self.is_binary, self.at = body, is_binary, 0
        self.words = [] if is_binary else body.split()

    def take(self, kind: str, n: int) -> np.ndarray:
        """The next n numbers: i4, u8, f8."""
        if n < 0:
            raise ValueError(f"{n} is no count")
        size = int(kind[1]) if self.is_binary else 1
        if self.at + n * size > len(self.body if self.is_binary else self.words):
            raise ValueError("it ends too soon")
        start, self.at = self.at, self.at + n * size
        if self.is_binary:
            return np.frombuffer(self.body, f"<{kind}", n, start).astype(float if kind == "f8" else np.int64)
        return np.array([(float if kind == "f8" else int)(word) for word in self.words[start : self.at]])

    def one(self, kind: str) -> int:
        return int(self.take(kind, 1)[0])

    def close(self) -> None:
        if self.body[self.at :].strip() if self.is_binary else self.at < len(self.words):
            raise ValueError("it has more numbers than its counts say")


def read_mesh(path: Any) -> Mesh:
    """Mesh of a file."""
    path = Path(path)
    sections = _sections(path)
    version, is_binary, size = (*sections.get("MeshFormat", b"").split(), b"", b"", b"")[:3]
    if not version:
        raise ModelError(f"file '{path}' is not a mesh of Gmsh: it has no section $MeshFormat")
    if version not in (b"2.2", b"4.1") or size != b"8":
        raise ModelError(f"file '{path}' has the format {version.decode(errors='replace')}; let Gmsh write "
                         "2.2 or 4.1 (Mesh.MshFileVersion)")  # fmt: skip
    if "PartitionedEntities" in sections:
        raise ModelError(f"file '{path}' is partitioned; let Gmsh write it without $PartitionedEntities")
    reading = _Mesh(version == b"4.1")
    for name, take in (("PhysicalNames", reading.take_names), ("Entities", reading.take_entities), ("Nodes", reading.take_nodes),
                       ("Elements", reading.take_elements)):  # fmt: skip
        if name not in sections:
            if name in ("Nodes", "Elements"):
                raise ModelError(f"file '{path}' has no section ${name}: it is not whole")
            continue
        try:
            take(sections[name], is_binary == b"1")
        except (ValueError, IndexError, OverflowError, MemoryError) as error:
            raise ModelError(f"file '{path}': its section ${name} is damaged: {error}") from None
    return reading.mesh(path)


def _sections(path: Path) -> dict[str, bytes]:
    """The sections of a file by their names, without their ends."""
    data, at = path.read_bytes(), 0
    found: dict[str, bytes] = {}
    while (at := data.find(b"$", at)) >= 0:
        head, _, rest = data[at + 1 :].partition(b"\n")
        name = head.strip().decode("ascii", "replace")
        end = data.find(b"$End" + head.strip(), at)
        if end < 0:
            raise ModelError(f"file '{path}': its section ${name[:40]} does not end: it is not whole")
        if name in found and name in ("PhysicalNames", "Entities", "Nodes", "Elements"):
            raise ModelError(f"file '{path}' has two sections ${name}")
        found.setdefault(name, data[at + 2 + len(head) : end])
        at = end + 4 + len(head.strip())
    return found


class _Mesh:
    """What has been read so far."""

    def __init__(self, has_entities: bool) -> None:
        self.has_entities = has_entities  # format 4.1
        self.names: dict[Group, str] = {}
        self.groups_of: dict[Group, list[int]] = {}  # of an entity: tags of its groups
        self.tags: list[np.ndarray] = []
        self.points: list[np.ndarray] = []
        self.cells: dict[tuple[int, tuple[int, ...]], None] = {}
        self.members: dict[Group, dict[int, None]] = {}

    def take_names(self, body: bytes, _: bool) -> None:
        lines = [line for line in body.decode("utf-8", "replace").splitlines() if line.strip()]
        if len(lines) != int(lines[0]) + 1:
            raise ValueError(f"it has {len(lines) - 1} names, not {lines[0].strip()}")
        for line in lines[1:]:
            dimension, tag, name = line.split(None, 2)
            self.names[int(dimension), int(tag)] = name.strip().strip('"')

    def take_entities(self, body: bytes, is_binary: bool) -> None:
        numbers = _Numbers(body, is_binary)
        for dimension, n in enumerate(numbers.take("u8", 4)):
            for _ in range(int(n)):
                tag = numbers.one("i4")
                numbers.take("f8", 3 if dimension == 0 else 6)
                self.groups_of[dimension, tag] = [abs(int(group)) for group in numbers.take("i4", numbers.one("u8"))]
                if dimension > 0:
                    numbers.take("i4", numbers.one("u8"))
        numbers.close()

    def take_nodes(self, body: bytes, is_binary: bool) -> None:
        if self.has_entities:
            numbers = _Numbers(body, is_binary)
            n_blocks, expected, _, _ = numbers.take("u8", 4)
            for _ in range(int(n_blocks)):
                dimension, _, is_parametric = numbers.take("i4", 3)
                n = numbers.one("u8")
                self.tags.append(numbers.take("u8", n))
                columns = 3 + (int(dimension) if is_parametric else 0)
                self.points.append(numbers.take("f8", n * columns).reshape(n, columns)[:, :3])
            numbers.close()
        else:
            count, _, rest = body.partition(b"\n")
            expected = int(count)
            if is_binary:
                rows = np.frombuffer(rest, np.dtype([("tag", "<i4"), ("x", "<f8", 3)]), expected)
                self.tags, self.points = [rows["tag"].astype(np.int64)], [rows["x"]]
            else:
                table = np.array([[float(word) for word in line.split()] for line in rest.splitlines() if line.strip()])
                self.tags, self.points = [table[:, 0].astype(np.int64)], [table[:, 1:4]]
        tags = np.concatenate([np.zeros(0, dtype=np.int64), *self.tags])
        if len(tags) != expected or len(np.unique(tags)) != len(tags) or (tags < 1).any():
            raise ValueError(f"it has not {expected} nodes with tags from 1, each once")
        if len(tags) and not np.isfinite(np.concatenate(self.points)).all():
            raise ValueError("a node has no finite position")

    def take_elements(self, body: bytes, is_binary: bool) -> None:
        if self.has_entities:
            numbers = _Numbers(body, is_binary)
            n_blocks, expected, _, _ = numbers.take("u8", 4)
            n_elements = 0
            for _ in range(int(n_blocks)):
                dimension, entity, kind = (int(value) for value in numbers.take("i4", 3))
                n, n_nodes = numbers.one("u8"), _element(kind)[0]
                table = numbers.take("u8", n * (1 + n_nodes)).reshape(n, 1 + n_nodes)
                self.add(kind, table[:, 1:], self.groups_of.get((dimension, entity), []))
                n_elements += n
            numbers.close()
        else:
            count, _, rest = body.partition(b"\n")
            expected, n_elements = int(count), self.add_rows(rest, is_binary, int(count))
        if n_elements != expected:
            raise ValueError(f"it has {n_elements} elements, not {expected}")

    def add_rows(self, body: bytes, is_binary: bool, expected: int) -> int:
        """Elements of the format 2.2; in text one a line: number, type, number of tags, tags, first its group, nodes.
        In binary type, number of elements and number of tags stand before the rest of each. Returns their number."""
        blocks: dict[tuple[int, int], list[list[int]]] = {}
        if is_binary:
            numbers, n_read = _Numbers(body, True), 0
            while n_read < expected:
                kind, n, n_tags = (int(value) for value in numbers.take("i4", 3))
                width = 1 + n_tags + _element(kind)[0]
                blocks.setdefault((kind, n_tags), []).extend(numbers.take("i4", n * width).reshape(n, width).tolist())
                n_read += n
            numbers.close()
        else:
            for line in filter(bytes.strip, body.splitlines()):
                number, kind, n_tags, *rest = (int(word) for word in line.split())
                if len(rest) != n_tags + _element(kind)[0]:
                    raise ValueError(f"element {number} has {len(rest) - n_tags} nodes, not {_element(kind)[0]}")
                blocks.setdefault((kind, n_tags), []).append([number, *rest])
        for (kind, n_tags), rows in blocks.items():
            table = np.array(rows)
            groups = np.abs(table[:, 1]) if n_tags else np.zeros(len(table), dtype=int)
            for group in np.unique(groups):
                self.add(kind, table[groups == group][:, 1 + n_tags :], [int(group)] if group else [])
        return sum(map(len, blocks.values()))

    def add(self, kind: int, table: np.ndarray, groups: list[int]) -> None:
        """Elements of one type by their nodes; one of several groups may occur several times."""
        _, vtk, order = _element(kind)
        self.cells |= dict.fromkeys((vtk, tuple(row)) for row in table[:, list(order)].tolist())
        for group in groups:
            self.members.setdefault((_DIMENSIONS.get(kind, 3), group), {}).update(dict.fromkeys(table.ravel().tolist()))

    def mesh(self, path: Path) -> Mesh:
        numbers = np.concatenate([np.zeros(0, dtype=np.int64), *self.tags])
        place = {int(tag): i for i, tag in enumerate(numbers)}
        missing = next((node for _, nodes in self.cells for node in nodes if node not in place), None)
        if missing is not None:
            raise ModelError(f"file '{path}': an element has the node {missing}, which $Nodes does not have")
        notes = []
        for group in self.members.keys() ^ self.names.keys():
            kind = f"of {_NAMES[group[0]]}" if 0 <= group[0] <= 3 else f"of the dimension {group[0]}"
            notes.append(f"the physical group {group[1]} {kind} has no name" if group in self.members else
                         f"the physical group '{self.names[group]}' {kind} has no elements in the file")  # fmt: skip
        sets, more = one_per_name(
            (self.names[group], sorted(members, key=place.__getitem__))
            for group, members in self.members.items()
            if group in self.names
        )
        points = np.concatenate([np.zeros((0, 3)), *self.points])
        return Mesh(numbers, points, [(vtk, list(nodes)) for vtk, nodes in self.cells], sets, notes=[*sorted(notes), *more])


def _element(kind: int) -> tuple[int, int, tuple[int, ...]]:
    if kind not in _ELEMENTS:
        raise ValueError(f"elements of the type {kind} are not known; those up to the second order are (Mesh.ElementOrder)")
    return _ELEMENTS[kind]
