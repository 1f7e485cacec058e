"""Bulk data of Nastran (.bdf, .dat, .pch): matrices of DMIG, grid points and elements that can be drawn, in fields of 8 or 16
columns or separated by commas. Source: MSC Nastran Quick Reference Guide, "Bulk Data Entries"."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError, check_file
from nhbm.mesh import Mesh


class Card(NamedTuple):
    """An entry: its name and its fields, those of its continuations behind each other."""

    name: str
    fields: list[str]
    path: Path
    line: int

    def refuse(self, why: str) -> ModelError:
        return ModelError(f"file '{self.path}', line {self.line}: {self.name}: {why}")

    def field(self, k: int) -> str:
        """Field k + 1 behind the name; empty where there is none."""
        return self.fields[k] if k < len(self.fields) else ""

    def whole(self, k: int, default: int | None = None) -> int:
        text = self.field(k)
        if not text and default is not None:
            return default
        if not re.fullmatch(r"[+-]?\d+", text):
            raise self.refuse(f"field {k + 2} is '{text}', not an integer")
        return int(text)

    def real(self, k: int, default: float | None = None) -> float:
        text = self.field(k).upper().replace("D", "E")
        if not text and default is not None:
            return default
        try:
            value = float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"E\1", text) if "E" not in text else text)
        except ValueError:
            raise self.refuse(f"field {k + 2} is '{self.field(k)}', not a number") from None
        if not np.isfinite(value):
            raise self.refuse(f"field {k + 2} is '{self.field(k)}', not a finite number")
        return value


def read_cards(path: Any) -> Iterator[Card]:
    """The entries of a file, and of those that it includes; before BEGIN BULK, where that is, nothing is one."""
    path = Path(path)
    check_file(path)
    texts = path.read_text(encoding="utf-8", errors="replace").splitlines()
    ends = any(text.strip().upper().startswith("ENDDATA") for text in texts)
    begin = next((k + 1 for k, text in enumerate(texts) if re.match(r"\s*BEGIN\s+BULK", text, re.IGNORECASE)), 0)
    if begin and not ends:
        raise ModelError(f"file '{path}', line {begin}: BEGIN BULK is without ENDDATA: the file is not whole")
    card: Card | None = None
    pattern: list[str] = []  # of the last line that repeats an entry
    for number, text in enumerate(texts[begin:], start=begin + 1):
        text = text.split("$")[0].rstrip().expandtabs(8)
        if not text.strip():
            continue
        if text.strip().upper().startswith("ENDDATA"):
            break
        match = re.match(r"\s*INCLUDE\s+['\"]?([^'\"]+)", text, re.IGNORECASE)
        if match:
            target = path.parent / match[1].strip()
            if not target.is_file() or target.resolve() == path.resolve():
                raise ModelError(f"file '{path}', line {number}: the file '{target}' of INCLUDE does not exist")
            if card is not None:
                yield card
                card = None
            yield from read_cards(target)
            continue
        name, fields = _fields(text)
        if name.startswith("="):
            pattern = fields if name == "=" else pattern
            count = re.fullmatch(r"=(?:\(?(\d+)\)?)?", name)
            if card is None or count is None or not pattern:
                raise ModelError(f"file '{path}', line {number}: '{text.strip()}' repeats no entry")
            for _ in range(int(count[1] or 1)):
                yield card
                card = _repeated(card, pattern, number)
            continue
        pattern = []
        if not re.match(r"[A-Za-z]", name):
            if card is None or name[:1] not in ("", "+", "*"):
                raise ModelError(f"file '{path}', line {number}: '{text.strip()}' continues no entry")
            card.fields.extend(fields)
            continue
        if card is not None:
            yield card
        card = Card(name.rstrip("*").upper(), fields, path, number)
    if card is not None:
        yield card


def _repeated(card: Card, pattern: list[str], line: int) -> Card:
    """The entry again: = keeps a field, == all that follow, *x or *(x) adds x; others are new."""
    if len(card.fields) > len(pattern):
        raise card.refuse(f"line {line} repeats it, and it has continuations")
    rest = pattern.index("==") if "==" in pattern else len(pattern)
    fields = [*pattern[:rest], *["="] * (len(pattern) - rest)]
    for k, word in enumerate(fields):
        step = re.fullmatch(r"\*\(?([^()]+)\)?", word)
        if word == "=":
            fields[k] = card.field(k)
        elif step:
            by = Card(card.name, [*fields[:k], step[1]], card.path, line)
            is_whole = all(re.fullmatch(r"[+-]?\d+", text) for text in (card.field(k), step[1]))
            fields[k] = str(card.whole(k) + by.whole(k)) if is_whole else repr(card.real(k) + by.real(k))
    return Card(card.name, fields, card.path, line)


def _fields(text: str) -> tuple[str, list[str]]:
    """Name and fields of a line: as many as its form has, 8, or 4 of 16 columns."""
    if "," in text:
        words = [word.strip() for word in text.split(",")]
        width = 4 if words[0].endswith("*") or words[0].startswith("*") else 8
        words = [words[0], *(words[1:] + [""] * width)[:width]]
        return words[0], words[1:]
    name = text[:8].strip()
    if name.endswith("*") or name.startswith("*"):
        return name, [text[8 + 16 * k : 24 + 16 * k].strip() for k in range(4)]
    return name, [text[8 + 8 * k : 16 + 8 * k].strip() for k in range(8)]


class Dmig(NamedTuple):
    """A matrix with the point and component of each row."""

    form: int
    is_complex: bool
    entries: dict[tuple[tuple[int, int], tuple[int, int]], float]  # row, column

    def matrix(self, index: dict[tuple[int, int], int]) -> sp.csr_matrix:
        """With rows by `index`; of a symmetric one that has one entry of a pair the other one, too."""
        full = dict(self.entries)
        if self.form == 6:
            for (row, column), value in self.entries.items():
                full.setdefault((column, row), value)
        rows = [index[row] for row, _ in full]
        columns = [index[column] for _, column in full]
        return sp.csr_matrix((list(full.values()), (rows, columns)), shape=(len(index),) * 2)


def read_dmig(path: Any) -> dict[str, Dmig]:
    """The matrices of a file by their names."""
    found: dict[str, Dmig] = {}
    for card in read_cards(path):
        if card.name != "DMIG":
            continue
        name = card.field(0).upper()
        if card.field(1) == "0":
            if name in found:
                raise card.refuse(f"'{name}' begins twice")
            found[name] = Dmig(card.whole(2), card.whole(3) in (3, 4), {})
            continue
        if name not in found:
            raise card.refuse(f"a column of '{name}', which has no line with its form before it")
        column = card.whole(1), card.whole(2, 0)
        entries = found[name].entries
        for k in range(4, len(card.fields), 4):
            if not card.field(k):
                if any(card.field(k + i) for i in (1, 2, 3)):
                    raise card.refuse("a term has no grid point")
                continue
            row = card.whole(k), card.whole(k + 1, 0)
            for point, component in (row, column):
                if point < 1 or not 0 <= component <= 6:
                    raise card.refuse(f"{point}, {component} is not a point from 1 with a component from 0 to 6")
            if (row, column) in entries:
                raise card.refuse(f"'{name}' has the term of {row[0]}, {row[1]} and {column[0]}, {column[1]} twice")
            entries[row, column] = card.real(k + 2)
    last = Path(path).read_bytes().rpartition(b"\n")[2]
    if found and last.strip() and not last.strip().upper().startswith(b"ENDDATA"):
        raise ModelError(f"file '{path}' is not whole: its last line has no end")
    return found


# name: first field of the nodes, step between them, and by their number VTK type and the node at each place of the cell
_HEX20 = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)  # middle nodes: below, upright, above
_WEDGE15 = (*range(9), 12, 13, 14, 9, 10, 11)
_LINE, _TRIANGLE, _QUAD = {2: (3, None)}, {3: (5, None), 6: (22, None)}, {4: (9, None), 8: (23, None)}
_ELEMENTS: dict[str, tuple[int, int, int, dict[int, tuple[int, Any]]]] = {
    "CROD": (2, 1, 2, _LINE), "CTUBE": (2, 1, 2, _LINE), "CBAR": (2, 1, 2, _LINE), "CBEAM": (2, 1, 2, _LINE),
    "CBUSH": (2, 1, 2, _LINE), "CONROD": (1, 1, 2, _LINE), "CELAS1": (2, 2, 2, _LINE), "CELAS2": (2, 2, 2, _LINE),
    "CDAMP1": (2, 2, 2, _LINE), "CTRIA3": (2, 1, 3, _TRIANGLE), "CTRIA6": (2, 1, 6, _TRIANGLE), "CTRIAR": (2, 1, 3, _TRIANGLE),
    "CQUAD4": (2, 1, 4, _QUAD), "CQUAD8": (2, 1, 8, _QUAD), "CQUADR": (2, 1, 4, _QUAD), "CSHEAR": (2, 1, 4, _QUAD),
    "CTETRA": (2, 1, 10, {4: (10, None), 10: (24, None)}), "CPENTA": (2, 1, 15, {6: (13, None), 15: (26, _WEDGE15)}),
    "CHEXA": (2, 1, 20, {8: (12, None), 20: (25, _HEX20)}),
    **dict.fromkeys(("CPYRAM", "CPYRA"), (2, 1, 13, {5: (14, None), 13: (27, None)})),
}  # fmt: skip
_NOT_DRAWN = re.compile(r"C(?!ORD|ONM|MASS|VISC|END|SET|SUP)[A-Z]+\d*$")


def read_mesh(path: Any) -> Mesh:
    """Grid points in the basic system, elements and scalar points of bulk data."""
    cards = list(read_cards(path))
    frames = _frames(cards)
    systems = {card.whole(0): card for card in cards if re.fullmatch(r"CORD2[RCS]", card.name)}
    points: dict[int, np.ndarray] = {}
    cells: list[tuple[int, list[int]]] = []
    left: dict[str, int] = {}
    default = next((card for card in cards if card.name == "GRDSET"), None)
    for card in cards:
        if card.name == "GRID":
            number = card.whole(0)
            system = card.whole(1, 0 if default is None else default.whole(1, 0))
            at = _in_basic(system, np.array([card.real(k, 0.0) for k in (2, 3, 4)]), systems, card)
            if not np.array_equal(points.setdefault(number, at), at):
                raise card.refuse(f"point {number} is given twice, at two places")
        elif card.name == "SPOINT":
            for number in _scalar_points(card):
                points[number] = np.full(3, np.nan)
        elif card.name in _ELEMENTS:
            cell = _cell(card)
            if cell is not None:
                cells.append(cell)
        elif _NOT_DRAWN.fullmatch(card.name):
            left[card.name] = left.get(card.name, 0) + 1
    if not points:
        raise ModelError(f"file '{path}' has no GRID")
    for _, nodes in cells:
        missing = [node for node in nodes if node not in points]
        if missing:
            raise ModelError(f"file '{path}': an element has the point {missing[0]}, which no GRID defines")
    notes = [f"{n} element{'s' * (n > 1)} of the type {kind} {'are' if n > 1 else 'is'} not drawn" for kind, n in left.items()]
    return Mesh(np.array(list(points), dtype=np.int64), np.array(list(points.values())), cells, {}, frames, notes)


def frames_of(path: Any) -> dict[int, str]:
    """Points of a file whose degrees of freedom are not along the axes of the basic system, and why."""
    return _frames(list(read_cards(path)))


def _frames(cards: list[Card]) -> dict[int, str]:
    default = next((card.whole(5, 0) for card in cards if card.name == "GRDSET"), 0)
    along: dict[int, int] = {}
    for card in cards:
        if card.name == "GRID" and along.setdefault(card.whole(0), card.whole(5, default)) != card.whole(5, default):
            raise card.refuse(f"point {card.whole(0)} is given twice, with two coordinate systems")
    return {point: f"point {point} moves along the axes of the coordinate system {system}"
            for point, system in along.items() if system > 0}  # fmt: skip


def external_rows(path: Any) -> list[tuple[int, int]]:
    """Point and component (0: a scalar point, such as a mode) of each row of an external superelement, by its entry EXTRN."""
    found: list[tuple[int, int]] = []
    for card in read_cards(path):
        if card.name == "EXTRN":
            for k in range(0, len(card.fields), 2):
                if card.field(k):
                    components = card.field(k + 1) or "0"
                    found += [(card.whole(k), int(c)) for c in components if c.isdigit()]
    if not found:
        raise ModelError(f"file '{path}' has no EXTRN, which names the rows of an external superelement; that is in its .pch")
    return found


def _scalar_points(card: Card) -> list[int]:
    words = [word for word in card.fields if word]
    if len(words) == 3 and words[1].upper() == "THRU":
        return list(range(int(words[0]), int(words[2]) + 1))
    return [card.whole(k) for k in range(len(card.fields)) if card.field(k)]


def _cell(card: Card) -> tuple[int, list[int]] | None:
    """VTK type and nodes; of the corners alone where some middle points are left out; None of one that stands on the ground."""
    first, step, most, kinds = _ELEMENTS[card.name]
    nodes = [card.whole(first + step * k, 0) for k in range(most)]
    nodes = nodes[: max((k + 1 for k, node in enumerate(nodes) if node > 0), default=0)]
    fitting = [n for n in kinds if n <= len(nodes) and all(node > 0 for node in nodes[:n])]
    if not fitting:
        if min(kinds) == 2 and any(nodes):
            return None
        raise card.refuse(f"it has {len(nodes)} points, not {' or '.join(map(str, kinds))}")
    vtk, order = kinds[max(fitting)]
    nodes = nodes[: max(fitting)]
    return vtk, nodes if order is None else [nodes[k] for k in order]


def _in_basic(number: int, at: np.ndarray, systems: dict[int, Card], card: Card, depth: int = 0) -> np.ndarray:
    """A position of a coordinate system in the basic one."""
    if number == 0:
        return at
    if number not in systems or depth > 20:
        raise card.refuse(f"there is no CORD2R, CORD2C or CORD2S {number}" if depth <= 20 else f"system {number} rests on itself")
    system = systems[number]
    a, b, c = (
        _in_basic(system.whole(1, 0), np.array([system.real(2 + 3 * k + i, 0.0) for i in range(3)]), systems, system, depth + 1)
        for k in range(3)
    )
    if system.name != "CORD2R":
        angle = np.radians(at[1])
        if system.name == "CORD2C":
            at = np.array([at[0] * np.cos(angle), at[0] * np.sin(angle), at[2]])
        else:  # radius, angle from the z axis, angle about it
            about = np.radians(at[2])
            at = at[0] * np.array([np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about), np.cos(angle)])
    z = (b - a) / np.linalg.norm(b - a)
    x = (c - a) - z * (z @ (c - a))
    if not np.linalg.norm(x) > 0:
        raise system.refuse("its three points are on one line")
    x /= np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(z, x), z])
    return np.asarray(a + axes @ at)
