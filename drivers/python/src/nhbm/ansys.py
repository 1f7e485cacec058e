"""Files of Ansys Mechanical APDL: assembled matrices (.full); nodes, elements and components of a database in text (.cdb)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError, check_file
from nhbm.mesh import DIRECTIONS, Mesh, one_per_name

Matrices = dict[str, sp.csr_matrix]


def read_full(path: Any) -> tuple[Matrices, list[tuple[int, str]], list[tuple[int, str]]]:
    """Stiffness, mass and, where there is one, damping of a .full file without the rows of constraints; node and direction of each
    row, in the order of Ansys; those of the rows that were left out. Symmetric matrices with a consistent mass.
    Source of the layout: Ansys Programmer's Reference, fdfull.inc; tried on a file of version 2012 with K and M."""
    path = Path(path)
    check_file(path)
    try:
        return _full(_Records(path))
    except (ValueError, IndexError, OverflowError, MemoryError) as error:
        raise ModelError(f"file '{path}' is no .full file of Ansys that can be read: {error}") from None


class _Records:
    """Records of a binary file of Ansys: length in words, kind, content, length once more."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        self.words = np.frombuffer(data, "<i4", len(data) // 4)

    def at(self, word: int, kind: str = "<i4") -> tuple[np.ndarray, int]:
        """The record that begins at a word, and where the next one begins."""
        if not 0 <= word < len(self.words) - 2:
            raise ValueError("it ends too soon")
        n, flags = int(self.words[word]), int(self.words[word + 1]) & 0xFFFFFFFF
        end = word + 2 + n
        if n < 0 or end >= len(self.words) or int(self.words[end]) != n:
            raise ValueError(f"there is no record at word {word}")
        if flags != (0x80000000 if kind == "<i4" else 0):
            raise ValueError(f"the record at word {word} is compressed or of another kind of numbers (/FCOMP,FULL,0 writes none)")
        return self.words[word + 2 : end].view(kind), end + 1


def _full(records: _Records) -> tuple[Matrices, list[tuple[int, str]], list[tuple[int, str]]]:
    standard, word = records.at(0)
    if len(standard) < 1 or standard[0] != 4:
        raise ValueError("its first record is not that of a .full file")
    header, word = records.at(word)
    header = np.concatenate([header, np.zeros(max(0, 80 - len(header)), dtype=np.int32)])

    def long_at(low: int, high: int) -> int:
        return (int(header[low]) & 0xFFFFFFFF) + (int(header[high]) << 32)

    n_rows = int(header[1])
    for what, k, remedy in (("a lumped mass", 10, "LUMPM,OFF"), ("unsymmetric matrices", 13, "HBMAT or *DMAT"),
                            ("constraint equations, which are not applied in its matrices", 20, "no CE, CP and RBE")):  # fmt: skip
        if header[k]:
            raise ValueError(f"it has {what}; use {remedy}")
    if header[0] >= 0:
        raise ValueError("it is of the frontal solver; solve by the sparse solver or block Lanczos")
    kinds, word = records.at(word)
    nodes, _ = records.at(word)
    counts, word = records.at(long_at(35, 36))
    constants, _ = records.at(word)
    directions = [DIRECTIONS.get(int(kind), "") for kind in kinds]
    if not all(directions):
        raise ValueError(f"it has the degree of freedom {kinds[directions.index('')]}, which is not a displacement or rotation")
    if len(counts) != len(nodes) or (counts != len(directions)).any():
        raise ValueError("its nodes differ in their degrees of freedom; write HBMAT with its mapping file")
    rows = [(int(node), direction) for node in nodes for direction in directions]
    if not len(rows) == len(constants) == n_rows:
        raise ValueError(f"it has {n_rows} rows and {len(rows)} degrees of freedom")
    free = np.flatnonzero(constants >= 0)
    matrices: Matrices = {}
    for name, (low, high) in (("stiffness", (18, 19)), ("mass", (26, 27)), ("damping", (28, 29))):
        if long_at(low, high) == 0:
            if name != "damping":
                raise ValueError(f"it has no {name}; write it in a modal analysis (ANTYPE,MODAL)")
            continue
        matrices[name] = _columns(records, long_at(low, high), n_rows)[free][:, free]
    return matrices, [rows[i] for i in free], [rows[i] for i in np.flatnonzero(constants < 0)]


def _columns(records: _Records, word: int, n_rows: int) -> sp.csr_matrix:
    """A symmetric matrix of which each column has the rows on one side of the diagonal and their values."""
    indices, values, starts = [], [], [0]
    for _ in range(n_rows):
        index, word = records.at(word)
        value, word = records.at(word, "<f8")
        if len(index) != len(value):
            raise ValueError(f"a column has {len(index)} rows and {len(value)} values")
        indices.append(index.astype(np.int64) - 1)
        values.append(value)
        starts.append(starts[-1] + len(index))
    one = sp.csc_matrix((np.concatenate(values), np.concatenate(indices), starts), shape=(n_rows, n_rows))
    one.check_format()
    if not np.isfinite(one.data).all():
        raise ValueError("an entry is not a finite number")
    return sp.csr_matrix(one + one.T - sp.diags(one.diagonal()))


_SOLIDS = (45, 46, 62, 64, 65, 69, 70, 87, 90, 92, 95, 96, 98, 122, 123, 185, 186, 187, 190, 226, 227, 285)
_PLANES = (28, 41, 42, 43, 63, 82, 93, 143, 150, 181, 182, 183, 281)
_LINES = (1, 3, 4, 8, 10, 11, 14, 16, 37, 39, 40, 180, 188, 189, 288, 289)
_POINTS = (21, 71, 166)


def read_cdb(path: Any) -> Mesh:
    """Mesh of NBLOCK, EBLOCK and CMBLOCK; components of nodes are its sets."""
    path = Path(path)
    lines = enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1)
    reading = _Archive(path)
    for number, text in lines:
        words = [word.strip() for word in text.split(",")]
        command = words[0].upper()
        try:
            if command == "ET" and len(words) > 2:
                match = re.search(r"(\d+)$", words[2])
                reading.types[int(words[1])] = int(match[1]) if match else 0
            elif command == "NBLOCK":
                reading.take_nodes(lines)
            elif command == "EBLOCK":
                reading.take_elements(lines, "SOLID" in text.upper())
            elif command == "CMBLOCK":
                reading.take_component(words, lines)
        except (ValueError, IndexError, StopIteration) as error:
            raise ModelError(f"file '{path}': the {command} of line {number} is damaged ({error or 'it does not end'})") from None
    return reading.mesh()


class _Archive:
    """What has been read so far."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.types: dict[int, int] = {}
        self.nodes: dict[int, list[float]] = {}
        self.elements: list[tuple[int, int, list[int]]] = []  # number, type, nodes
        self.sets: dict[str, list[int]] = {}
        self.frames: dict[int, str] = {}
        self.notes: dict[str, None] = {}

    def take_nodes(self, lines: Iterator[tuple[int, str]]) -> None:
        """Whole numbers, the node first, and up to six reals: position, angles of its own axes."""
        (n_whole, whole), (n_real, real) = _widths(next(lines)[1])
        for _, text in lines:
            if text.lstrip().upper().startswith("N,") or text.split(",")[0].strip() == "-1":
                return
            node = int(text[:whole])
            start = n_whole * whole
            values = [float(text[k : k + real] or 0.0) for k in range(start, len(text.rstrip()), real)][:n_real]
            if node in self.nodes or not np.isfinite(values).all():
                raise ValueError(f"node {node} is given twice or has no finite position")
            self.nodes[node] = [*values, 0.0, 0.0, 0.0][:3]
            if any(values[3:]):
                self.frames[node] = f"node {node} has rotated axes of its own"
        raise ValueError("it does not end")

    def take_elements(self, lines: Iterator[tuple[int, str]], is_solid: bool) -> None:
        """11 numbers, of which the second is the type, the ninth the count of nodes, the last the element; then its nodes."""
        if not is_solid:
            self.notes["an EBLOCK without SOLID is not read"] = None
            return
        ((_, width),) = _widths(next(lines)[1])
        for _, text in lines:
            numbers = _numbers(text, width)
            if numbers[:1] == [-1]:
                return
            n = numbers[8]
            while len(numbers) < 11 + n:
                numbers += _numbers(next(lines)[1], width)
            self.elements.append((numbers[10], numbers[1], numbers[11 : 11 + n]))
        raise ValueError("it does not end")

    def take_component(self, words: list[str], lines: Iterator[tuple[int, str]]) -> None:
        """Numbers; a negative one ends a range that begins with the one before."""
        name, kind, count = words[1], words[2].upper(), int(words[3].split("!")[0])
        ((_, width),) = _widths(next(lines)[1])
        numbers: list[int] = []
        while len(numbers) < count:
            numbers += _numbers(next(lines)[1], width)
        if len(numbers) != count:
            raise ValueError(f"it has {len(numbers)} numbers, not {count}")
        if kind != "NODE":
            return
        found: list[int] = []
        for number in numbers:
            if number == 0 or (number < 0 and not (found and -number > found[-1])):
                raise ValueError(f"{number} ends no range")
            found += [number] if number > 0 else range(found[-1] + 1, -number + 1)
        self.sets[name] = found

    def mesh(self) -> Mesh:
        if not self.nodes:
            raise ModelError(f"file '{self.path}' has no NBLOCK with nodes")
        cells: list[tuple[int, list[int]]] = []
        left: dict[int, int] = {}
        for number, kind, nodes in self.elements:
            type_number = self.types.get(kind, 0)
            cell = _cell(type_number, nodes)
            if cell is None:
                left[type_number] = left.get(type_number, 0) + 1
                continue
            missing = [node for node in cell[1] if node not in self.nodes]
            if missing:
                raise ModelError(f"file '{self.path}': element {number} has the node {missing[0]}, which no NBLOCK has")
            cells.append(cell)
        for kind, n in left.items():
            self.notes[f"{n} elements of the type {kind or 'that no ET names'} are not drawn"] = None
        for name, members in self.sets.items():
            absent = [node for node in members if node not in self.nodes]
            if absent:
                raise ModelError(f"file '{self.path}': the component {name} has the node {absent[0]}, which no NBLOCK has")
        numbers, points = np.array(list(self.nodes), dtype=np.int64), np.array(list(self.nodes.values()))
        sets, more = one_per_name(self.sets.items())
        return Mesh(numbers, points, cells, sets, self.frames, [*self.notes, *more])


def _widths(form: str) -> list[tuple[int, int]]:
    """Counts and widths of a Fortran format such as (3i9,6e21.13e3)."""
    found = [(int(n or 1), int(width)) for n, width in re.findall(r"(\d*)[ieIE](\d+)", form.split("e3)")[0])]
    if not found:
        raise ValueError(f"'{form.strip()}' is not a format")
    return found


def _numbers(text: str, width: int) -> list[int]:
    text = text.rstrip()
    return [int(text[k : k + width]) for k in range(0, len(text), width)]


def _cell(kind: int, nodes: list[int]) -> tuple[int, list[int]] | None:
    """VTK type and nodes of an element; degenerate ones repeat a corner, as K = L of a triangle."""
    if kind in _POINTS:
        return 1, nodes[:1]
    if kind in _LINES:
        return (21, nodes[:3]) if kind in (189, 289) and len(nodes) >= 3 else (3, nodes[:2])
    if kind in _PLANES and len(nodes) >= 3:
        return _plane(nodes)
    return _solid(nodes) if kind in _SOLIDS else None


def _plane(nodes: list[int]) -> tuple[int, list[int]]:
    corners, middles = nodes[:4], nodes[4:8]
    if len(nodes) == 6:
        return 22, nodes
    has_middles = len(middles) == 4 and all(middles)
    if len(corners) == 3 or corners[2] == corners[3]:
        return (22, [*corners[:3], middles[0], middles[1], middles[3]]) if has_middles else (5, corners[:3])
    return (23, [*corners, *middles]) if has_middles else (9, corners)


def _solid(nodes: list[int]) -> tuple[int, list[int]] | None:
    if len(nodes) in (4, 10):
        return (24, nodes) if len(nodes) == 10 and all(nodes) else (10, nodes[:4])
    if len(nodes) < 8:
        return None
    i, j, k, k2, m, n, o, p = nodes[:8]
    q = nodes[8:20]  # in the middle: IJ JK KL LI, MN NO OP PM, IM JN KO LP
    has_middles = len(q) == 12
    if k == k2 and m == n == o == p:
        chosen = [q[0], q[1], q[3], q[8], q[9], q[10]] if has_middles else []
        return (24, [i, j, k, m, *chosen]) if has_middles and all(chosen) else (10, [i, j, k, m])
    if m == n == o == p:
        chosen = [*q[:4], *q[8:]] if has_middles else []
        return (27, [i, j, k, k2, m, *chosen]) if has_middles and all(chosen) else (14, [i, j, k, k2, m])
    if k == k2 and o == p:
        chosen = [q[0], q[1], q[3], q[4], q[5], q[7], q[8], q[9], q[10]] if has_middles else []
        return (26, [i, j, k, m, n, o, *chosen]) if has_middles and all(chosen) else (13, [i, j, k, m, n, o])
    return (25, nodes[:20]) if has_middles and all(q) else (12, nodes[:8])
