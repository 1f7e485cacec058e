"""Decks of Abaqus and CalculiX (.inp), by their own rules: nodes, elements that can be drawn, sets, surfaces; the rest is skipped.

A second *NSET of the same name adds nodes, a set may name sets that were defined before it, GENERATE has an increment of 1 where
none is given, and the order of a set is that of the deck. Sources: CalculiX CrunchiX USER'S MANUAL 2.20, chapter 7; Abaqus Keywords
Reference Guide.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nhbm.errors import ModelError
from nhbm.mesh import Mesh


class Shape(NamedTuple):
    """An element: number of nodes, VTK type, the node of the element at each place of the cell, faces by their corners."""

    n_nodes: int
    vtk: int
    order: tuple[int, ...]
    faces: tuple[tuple[int, ...], ...]


_HEX = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
_TET = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
_WEDGE = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_QUAD = ((0, 1), (1, 2), (2, 3), (3, 0))
# of the edges between corners, in the order of their middle nodes
_HEX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
_TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
_WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))


def _with_middles(faces: Any, edges: Any, n_corners: int) -> tuple[tuple[int, ...], ...]:
    """Faces with the nodes in the middle of their edges: first the corners, then the middle behind each of them."""
    middle = {frozenset(edge): n_corners + k for k, edge in enumerate(edges)}
    return tuple((*face, *(middle[frozenset(edge)] for edge in zip(face, (*face[1:], face[0])))) for face in faces)


def _shape(n: int, vtk: int, faces: Any = (), order: Any = None) -> Shape:
    return Shape(n, vtk, tuple(order or range(n)), tuple(faces))


_SOLIDS = {
    4: _shape(4, 10, _TET), 6: _shape(6, 13, _WEDGE), 8: _shape(8, 12, _HEX),
    10: _shape(10, 24, _with_middles(_TET, _TET_EDGES, 4)),
    15: _shape(15, 26, _with_middles(_WEDGE, _WEDGE_EDGES, 6)), 20: _shape(20, 25, _with_middles(_HEX, _HEX_EDGES, 8)),
}  # fmt: skip
# by the VTK type of a solid cell: number of corners of each face, and its places in the cell
FACES_OF_CELLS = {
    shape.vtk: tuple((len(face) if n <= 8 else len(face) // 2, face) for face in shape.faces) for n, shape in _SOLIDS.items()
}
_PLANES = {3: _shape(3, 5, _TRIANGLE), 4: _shape(4, 9, _QUAD), 6: _shape(6, 22, _with_middles(_TRIANGLE, _TRIANGLE, 3)),
           8: _shape(8, 23, _with_middles(_QUAD, _QUAD, 4))}  # fmt: skip
_SHELLS = {n: _shape(n, shape.vtk) for n, shape in _PLANES.items()}
_LINES = {2: _shape(2, 3), 3: _shape(3, 21, order=(0, 2, 1))}  # the second of three nodes is in the middle
_BEAMS = {"1": _LINES[2], "2": _LINES[3], "3": _LINES[2]}
_FAMILIES = (
    (r"(?:C3D|DC3D|AC3D|F3D)(\d+).*", _SOLIDS),
    (r"(?:CPS|CPE|CPEG|CAX|DC2D|DCAX|AC2D|ACAX)(\d+).*", _PLANES),
    (r"(?:S|M3D|STRI|SC|R3D|SFM3D|DS)(\d+).*", _SHELLS),
    (r"(?:T2D|T3D)(\d+).*", _LINES),
)  # fmt: skip
_TWO = ("SPRINGA", "SPRING2", "DASHPOTA", "DASHPOT2", "D", "GAPUNI", "CONN3D2", "R2D2", "JOINTC", "ITSUNI")
_ONE = ("MASS", "ROTARYI", "SPRING1", "DASHPOT1", "DCOUP3D", "HEATCAP")
_OWN_NODES = re.compile(r"C3D8I", re.IGNORECASE)  # elements that CalculiX gives nodes of its own
_LONGEST = 10**7  # numbers of a range
_MAKES_NODES = ("NCOPY", "NFILL", "NGEN", "NMAP")
_CELL_FACES = re.compile(r"S(\d)", re.IGNORECASE)


def shape_of(kind: str) -> Shape | None:
    """The shape of a type of element, None if it is not known."""
    kind = kind.upper()
    for pattern, shapes in _FAMILIES:
        match = re.fullmatch(pattern, kind)
        if match:
            return shapes.get(int(match[1]))
    beam = re.fullmatch(r"(?:B|PIPE)[23](\d).*", kind)
    if beam:
        return _BEAMS.get(beam[1])
    if kind in _TWO:
        return _LINES[3] if kind == "D" else _LINES[2]
    return _shape(1, 1) if kind in _ONE else None


class Line(NamedTuple):
    """A line that has data, with its place."""

    text: str
    path: Path
    number: int

    def refuse(self, why: str) -> ModelError:
        return ModelError(f"file '{self.path}', line {self.number}: {why}")


class Block(NamedTuple):
    """A keyword with its parameters, in upper case, and its lines of data."""

    keyword: str
    options: dict[str, str]
    head: Line
    data: list[Line]

    def name(self, option: str) -> str:
        """The name of a set in upper case, as both programs compare it; refused where there is none."""
        found = self.options.get(option, "")
        if not found:
            raise self.head.refuse(f"*{self.keyword} has no {option}=")
        return found.strip("\"'").upper()


def read_deck(path: Any) -> Mesh:
    """Mesh of a deck."""
    deck, in_step = _Deck(), None
    for block in _blocks(Path(path)):
        deck.take(block)
        in_step = block.head if block.keyword == "STEP" else None if block.keyword == "END STEP" else in_step
    mesh = deck.mesh(Path(path))
    if in_step is not None:
        mesh.notes.append(f"the *STEP of line {in_step.number} has no *END STEP: it may not be whole")
    if not Path(path).read_bytes().endswith(b"\n"):
        mesh.notes.append("its last line has no end: it may not be whole")
    return mesh


def _lines(path: Path, above: tuple[Path, ...] = ()) -> Iterator[Line]:
    """The lines that are no comments, those of included files in their place."""
    if path.resolve() in above:
        raise ModelError(f"file '{path}' includes itself")
    for number, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        line = Line(text.strip(), path, number)
        if not line.text or line.text.startswith("**"):
            continue
        if re.match(r"\*\s*INCLUDE\b", line.text, re.IGNORECASE):
            yield from _lines(_target(_keyword(line, line.text), path), (*above, path.resolve()))
        else:
            yield line


def _keyword(line: Line, text: str) -> Block:
    """The block of a line with a keyword, without data."""
    words = [word.strip() for word in text[1:].split(",")]
    options = {key.strip().upper(): value.strip() for key, _, value in (word.partition("=") for word in words[1:] if word)}
    return Block(" ".join(words[0].upper().split()), options, line, [])


def _target(block: Block, path: Path) -> Path:
    """The file that INPUT= names, beside the deck."""
    target = path.parent / block.options.get("INPUT", "").strip("\"'")
    if not target.is_file():
        raise block.head.refuse(f"the file '{target}' of INPUT= does not exist")
    return target


def _blocks(path: Path) -> Iterator[Block]:
    """Keywords with their data."""
    block: Block | None = None
    lines = _lines(path)
    for line in lines:
        if not line.text.startswith("*"):
            if block is not None:
                block.data.append(line)
            continue
        if block is not None:
            yield block
        text = line.text
        while text.endswith(",") and (following := next(lines, None)) is not None:
            text += following.text
        block = _keyword(line, text)
        if "INPUT" in block.options and block.keyword in ("NODE", "ELEMENT", "NSET", "ELSET"):
            block.data.extend(_lines(_target(block, line.path)))
    if block is not None:
        yield block


def _words(line: Line) -> list[str]:
    words = [word.strip() for word in line.text.split(",")]
    while words and not words[-1]:
        words.pop()
    return words


def _whole(word: str, line: Line, what: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise line.refuse(f"'{word}' is no {what}") from None


class _Deck:
    """What has been read so far."""

    def __init__(self) -> None:
        self.nodes: dict[int, tuple[float, ...]] = {}
        self.elements: dict[int, tuple[str, list[int]]] = {}
        self.node_sets: dict[str, dict[int, None]] = {}  # in their order
        self.element_sets: dict[str, dict[int, None]] = {}
        self.surfaces: dict[str, dict[int, None]] = {}
        self.generated: set[int] = set()  # nodes of ranges, of which not all need exist
        self.notes: dict[str, None] = {}
        self.unknown: dict[str, int] = {}
        self.instances = 0
        self.in_system: Line | None = None
        self.adds_nodes = False

    def take(self, block: Block) -> None:
        """Takes a keyword; one that it does not know is skipped."""
        known = {"NODE": self.take_nodes, "ELEMENT": self.take_elements, "NSET": self.take_node_set, "ELSET": self.take_element_set,
                 "SURFACE": self.take_surface, "INSTANCE": self.take_instance, "SYSTEM": self.take_system}  # fmt: skip
        if block.keyword in known:
            known[block.keyword](block)
        elif block.keyword in _MAKES_NODES or block.keyword in ("ELGEN", "ELCOPY"):
            self.notes[f"*{block.keyword} is not read: what it generates is missing"] = None

    def take_system(self, block: Block) -> None:
        self.in_system = block.head if block.data else None

    def take_instance(self, block: Block) -> None:
        self.instances += 1
        if self.instances > 1 or block.data:
            what = "several *INSTANCE" if self.instances > 1 else "an *INSTANCE that is moved"
            raise block.head.refuse(
                f"{what}: its node numbers are not those of the matrices; write the deck without parts and assemblies"
            )

    def take_nodes(self, block: Block) -> None:
        system = block.options.get("SYSTEM", "R").upper()
        if self.in_system is not None:
            raise self.in_system.refuse("positions in a *SYSTEM of their own are not read")
        if system not in ("R", "C", "S"):
            raise block.head.refuse(f"SYSTEM={system} is not R, C or S")
        members = self.node_sets.setdefault(block.name("NSET"), {}) if "NSET" in block.options else {}
        for line in block.data:
            words = _words(line)
            number = _whole(words[0], line, "number of a node")
            try:
                values = [float(word.upper().replace("D", "E")) if word else 0.0 for word in words[1:4]]
            except ValueError:
                raise line.refuse(f"'{line.text}' is not a node with its position") from None
            if number < 1 or not np.isfinite(values).all():
                raise line.refuse(f"'{line.text}' is not a node from 1 with a finite position")
            self.nodes[number] = _cartesian(system, [*values, 0.0, 0.0, 0.0][:3])
            members[number] = None

    def take_elements(self, block: Block) -> None:
        kind = block.name("TYPE")
        shape = shape_of(kind)
        members = self.element_sets.setdefault(block.name("ELSET"), {}) if "ELSET" in block.options else {}
        self.adds_nodes = self.adds_nodes or _OWN_NODES.match(kind) is not None
        lines = iter(block.data)
        for line in lines:
            words = _words(line)
            ends_open = line.text.endswith(",")
            while ends_open or (shape is not None and len(words) <= shape.n_nodes):
                following = next(lines, None)
                if following is None:
                    break
                words += _words(following)
                ends_open = following.text.endswith(",")
            number = _whole(words[0], line, "number of an element")
            if shape is None:
                self.unknown[kind] = self.unknown.get(kind, 0) + 1
                self.elements[number] = (kind, [int(word) for word in words[1:] if word.isdigit()])
            else:
                if len(words) <= shape.n_nodes:
                    raise line.refuse(f"element {number} of the type {kind} has {len(words) - 1} nodes, not {shape.n_nodes}")
                nodes = [_whole(_local(word), line, "number of a node") for word in words[1 : 1 + shape.n_nodes]]
                self.elements[number] = (kind, nodes)
            members[number] = None

    def take_node_set(self, block: Block) -> None:
        members = self.node_sets.setdefault(block.name("NSET"), {})
        if "ELSET" in block.options:
            for element in self._elements_of(block.name("ELSET"), block.head):
                members |= dict.fromkeys(self.elements[element][1] if element in self.elements else ())
        self._add_members(block, members, self.node_sets, "node")

    def take_element_set(self, block: Block) -> None:
        self._add_members(block, self.element_sets.setdefault(block.name("ELSET"), {}), self.element_sets, "element")

    def _add_members(self, block: Block, members: dict[int, None], sets: dict[str, dict[int, None]], what: str) -> None:
        for line in block.data:
            words = _words(line)
            if "GENERATE" in block.options:
                numbers = [_whole(word, line, f"number of {'an' if what == 'element' else 'a'} {what}") for word in words]
                if len(numbers) not in (2, 3) or (len(numbers) == 3 and numbers[2] < 1):
                    raise line.refuse(f"'{line.text}' must be 'first, last, increment'")
                found = range(numbers[0], numbers[1] + 1, *numbers[2:])
                if len(found) > _LONGEST:
                    raise line.refuse(f"'{line.text}' are {len(found)} numbers, more than {_LONGEST}")
                members |= dict.fromkeys(found)
                self.generated.update(members) if what == "node" else None
                continue
            for word in filter(None, words):
                text = _local(word)
                if re.fullmatch(r"[+-]?\d+", text):
                    members[int(text)] = None
                    continue
                name = text.strip("\"'").upper()
                if name not in sets:
                    raise line.refuse(f"'{word}' is neither a number nor the name of {'an' if what == 'element' else 'a'} {what} "
                                      "set that stands before it")  # fmt: skip
                members |= dict(sets[name])

    def take_surface(self, block: Block) -> None:
        if "NAME" not in block.options:
            raise block.head.refuse("*SURFACE has no NAME=")
        members = self.surfaces.setdefault(block.name("NAME"), {})
        kind = block.options.get("TYPE", "ELEMENT").upper()
        if kind == "NODE":
            for line in block.data:
                word = _local(_words(line)[0])
                members |= dict.fromkeys([int(word)]) if word.isdigit() else self._nodes_of(word.upper(), line)
            return
        if kind != "ELEMENT":
            self.notes[f"the surface {block.name('NAME').lower()} of TYPE={kind} is not read"] = None
            return
        for line in block.data:
            words = _words(line)
            word = _local(words[0])
            elements = [int(word)] if word.isdigit() else self._elements_of(word.strip("\"'").upper(), line)
            face = words[1].upper() if len(words) > 1 else ""
            for element in elements:
                members |= dict.fromkeys(self._face(element, face, line, block.name("NAME").lower()))

    def _face(self, element: int, face: str, line: Line, surface: str) -> list[int]:
        """The nodes of a face of an element, or of an element that has none."""
        if element not in self.elements:
            self.notes[f"surface {surface}: there is no element {element}"] = None
            return []
        kind, nodes = self.elements[element]
        shape = shape_of(kind)
        if shape is None:
            self.notes[f"surface {surface}: faces of the type {kind} are not known"] = None
            return []
        match = _CELL_FACES.fullmatch(face)
        if not shape.faces:
            return nodes
        if match is None or not 1 <= int(match[1]) <= len(shape.faces):
            if not face:
                self.notes[f"surface {surface}: faces that the deck leaves open are not known"] = None
                return []
            raise line.refuse(f"'{face}' is not a face of an element of the type {kind}")
        return [nodes[k] for k in shape.faces[int(match[1]) - 1]]

    def _nodes_of(self, name: str, line: Line) -> dict[int, None]:
        if name not in self.node_sets:
            raise line.refuse(f"there is no node set '{name}' before it")
        return self.node_sets[name]

    def _elements_of(self, name: str, line: Line) -> dict[int, None]:
        if name not in self.element_sets:
            raise line.refuse(f"there is no element set '{name}' before it")
        return self.element_sets[name]

    def mesh(self, path: Path) -> Mesh:
        """What was read; node sets, then the nodes of surfaces and of element sets whose names are not taken."""
        if not self.nodes:
            raise ModelError(f"file '{path}' has no *NODE with nodes" + "".join(f"; {note}" for note in self.notes))
        cells = []
        for number, (kind, nodes) in self.elements.items():
            shape = shape_of(kind)
            if shape is None or (kind == "D" and 0 in nodes):  # 0: the surroundings of a network
                continue
            missing = [node for node in nodes if node not in self.nodes]
            if missing:
                raise ModelError(f"file '{path}': element {number} has the node {missing[0]}, which no *NODE defines"
                                 + "".join(f"; {note}" for note in self.notes))  # fmt: skip
            cells.append((shape.vtk, [nodes[k] for k in shape.order]))
        for kind, n in self.unknown.items():
            self.notes[f"{n} element{'s' * (n > 1)} of the type {kind} {'are' if n > 1 else 'is'} not drawn"] = None
        sets = {name: dict(members) for name, members in self.node_sets.items()}
        for name, members in self.surfaces.items():
            if name in sets:
                self.notes[f"the name {name.lower()} is that of a node set and of a surface: it is the node set"] = None
            sets.setdefault(name, members)
        for name, members in self.element_sets.items():
            sets.setdefault(name, dict.fromkeys(n for e in members if e in self.elements
                                          for n in self.elements[e][1] if n))  # fmt: skip
        for name, members in sets.items():
            absent = [node for node in members if node not in self.nodes]
            if self.generated.issuperset(absent):
                sets[name] = dict.fromkeys(node for node in members if node in self.nodes)
            elif absent:
                self.notes[f"set {name.lower()}: no *NODE defines {absent[0]}; {len(absent)} left out"] = None
                sets[name] = dict.fromkeys(node for node in members if node in self.nodes)
        numbers = np.array(list(self.nodes), dtype=np.int64)
        points = np.array(list(self.nodes.values()), dtype=float).reshape(-1, 3)
        return Mesh(numbers, points, cells, {name: list(members) for name, members in sets.items()},
                    notes=list(self.notes), adds_nodes=self.adds_nodes)  # fmt: skip


def _local(word: str) -> str:
    """A number without the name of the instance in front, `PART-1-1.12`."""
    match = re.fullmatch(r"[A-Za-z_\"][^.]*\.(\d+|[A-Za-z_\"].*)", word)
    return match[1] if match else word


def _cartesian(system: str, values: list[float]) -> tuple[float, ...]:
    """Position in x, y, z, of one with angles in degrees: radius, angle, z (C), or radius, longitude, latitude (S)."""
    if system == "R":
        return tuple(values)
    radius, angle, third = values[0], np.radians(values[1]), values[2]
    if system == "C":
        return radius * np.cos(angle), radius * np.sin(angle), third
    latitude = np.radians(third)
    return radius * np.cos(latitude) * np.cos(angle), radius * np.cos(latitude) * np.sin(angle), radius * np.sin(latitude)
