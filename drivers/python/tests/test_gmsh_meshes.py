"""Meshes of Gmsh: nodes by their tags and physical groups, in both formats, text and binary, and damaged ones."""

import struct

import numpy as np
import pytest
import scipy.sparse as sp
from nhbm import ModelError, Structure, importing, meshes

POINTS = {40: (0.0, 0.0, 0.0), 10: (1.0, 0.0, 0.0), 30: (0.0, 1.0, 0.0), 20: (0.0, 0.0, 1.0)}
# dimension, entity, its groups, type of Gmsh, nodes of its elements
ENTITIES = [
    (0, 7, [5], 15, [[20]]),
    (2, 1, [1], 2, [[40, 30, 10]]),
    (2, 2, [2, 3], 2, [[40, 10, 20]]),
    (2, 4, [3], 2, [[10, 30, 20]]),
    (3, 1, [1], 4, [[40, 10, 30, 20]]),
]
NAMES = {(0, 5): "Corner", (2, 1): "root", (2, 2): "tip", (2, 3): "contact", (3, 1): "bar"}
SETS = {"Corner": [20], "root": [40, 10, 30], "tip": [40, 10, 20], "contact": [40, 10, 30, 20], "bar": [40, 10, 30, 20]}


def numbers(is_binary, *items):
    """Numbers of a section by their kinds: ("i", 1, 2), ("Q", 3), ("d", 0.5)."""
    if is_binary:
        return b"".join(struct.pack(f"<{len(values)}{kind}", *values) for kind, *values in items)
    return "".join(f"{value} " for _, *values in items for value in values).encode() + b"\n"


def section(name, body):
    return b"$%s\n%s\n$End%s\n" % (name, body.rstrip(b"\n") if body[-1:] == b"\n" else body, name)


def format_2(is_binary):
    nodes = b"".join(numbers(is_binary, ("i", tag), ("d", *at)) for tag, at in POINTS.items())
    lines, count = b"", 0
    for _, entity, groups, kind, elements in ENTITIES:
        for group in groups:
            for element in elements:
                count += 1
                head = ("i", kind, 1, 2, count) if is_binary else ("i", count, kind, 2)
                lines += numbers(is_binary, head, ("i", group, entity, *element))
    return section(b"Nodes", b"%d\n" % len(POINTS) + nodes) + section(b"Elements", b"%d\n" % count + lines)


def format_4(is_binary):
    entities = numbers(is_binary, ("Q", *(sum(dimension == d for dimension, *_ in ENTITIES) for d in range(4))))
    for dimension, entity, groups, _, _ in ENTITIES:
        box = ("d", *([0.0] * (3 if dimension == 0 else 6)))
        bounds = [("Q", 1), ("i", -7)] if dimension else []
        entities += numbers(is_binary, ("i", entity), box, ("Q", len(groups)), ("i", *groups), *bounds)
    nodes = numbers(is_binary, ("Q", 2, 4, 10, 40))
    for dimension, tags in ((0, [40]), (2, [10, 30, 20])):  # the second block has parameters of its surface
        nodes += numbers(is_binary, ("i", dimension, 1, int(dimension == 2)), ("Q", len(tags)))
        nodes += numbers(is_binary, ("Q", *tags))
        nodes += b"".join(numbers(is_binary, ("d", *POINTS[tag], *[0.25] * dimension)) for tag in tags)
    elements = numbers(is_binary, ("Q", len(ENTITIES), len(ENTITIES), 1, 9))
    for number, (dimension, entity, _, kind, rows) in enumerate(ENTITIES, start=1):
        elements += numbers(is_binary, ("i", dimension, entity, kind), ("Q", len(rows)))
        elements += b"".join(numbers(is_binary, ("Q", number, *row)) for row in rows)
    return section(b"Entities", entities) + section(b"Nodes", nodes) + section(b"Elements", elements)


def text_of(version, is_binary, names=NAMES):
    head = b"%s %d 8\n" % (version, is_binary) + is_binary * struct.pack("<i", 1)
    listed = "".join(f'{dimension} {tag} "{name}"\n' for (dimension, tag), name in names.items())
    body = format_2(is_binary) if version == b"2.2" else format_4(is_binary)
    return section(b"MeshFormat", head) + section(b"PhysicalNames", f"{len(names)}\n{listed}".encode()) + body


def read(folder, content):
    (folder / "part.msh").write_bytes(content)
    return meshes.read_mesh(folder / "part.msh")


@pytest.mark.parametrize("is_binary", [False, True], ids=["text", "binary"])
@pytest.mark.parametrize("version", [b"2.2", b"4.1"], ids=["2.2", "4.1"])
def test_groups_are_told_apart_by_dimension_and_entities_may_be_in_several(tmp_path, version, is_binary):
    mesh = read(tmp_path, text_of(version, is_binary))
    assert mesh.sets == SETS
    assert mesh.numbers.tolist() == [40, 10, 30, 20]
    assert mesh.points.tolist() == [list(POINTS[tag]) for tag in mesh.numbers.tolist()]
    assert (10, [40, 10, 30, 20]) in mesh.cells and len(mesh.cells) == len(ENTITIES)
    assert mesh.notes == []


def test_groups_without_a_name_or_with_one_that_differs_by_case_are_named(tmp_path):
    names = NAMES | {(2, 1): "CORNER", (1, 8): "wire"}
    del names[2, 2]
    mesh = read(tmp_path, text_of(b"4.1", False, names))
    assert set(mesh.sets) == {"contact", "bar"}
    assert mesh.notes == [
        "the physical group 'wire' of curves has no elements in the file",
        "the physical group 2 of surfaces has no name",
        "2 sets have the name 'corner' in lower case: none of them is taken",
    ]
    unit = sp.identity(1)
    model = Structure(mass=unit, stiffness=unit, **importing.nodes_of_labels(["n20.z"]))
    assert any("corner" in note for note in meshes.add_mesh(model, tmp_path / "part.msh"))
    assert "corner" not in model.sets and model.coordinates[model.dof_node].tolist() == [[0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    "old, new, message",
    [
        (b"$EndElements", b"", "its section .Elements does not end: it is not whole"),
        (b"$Elements", b"$Others", "its section .Others does not end"),
        (b"\n4\n40 ", b"\n5\n40 ", "has not 5 nodes"),
        (b"\n4\n40 ", b"\n3\n40 ", "has not 3 nodes"),
        (b"\n6\n1 15", b"\n5\n1 15", "it has 6 elements, not 5"),
        (b"10 1.0", b"10 nan", "a node has no finite position"),
        (b"10 1.0", b"40 1.0", "nodes with tags from 1, each once"),
        (b"10 1.0", b"10 one", "its section .Nodes is damaged"),
        (b"10 1.0", b"10", "its section .Nodes is damaged"),
        (b"2.2 0 8", b"4.0 0 8", "has the format 4.0; let Gmsh write 2.2 or 4.1"),
        (b"1 15 2 ", b"1 26 2 ", "elements of the type 26 are not known"),
        (b"1 15 2 5 7 20", b"1 15 2 5 7 20 30", "element 1 has 2 nodes, not 1"),
        (b"1 15 2 5 7 20", b"1 15 2 5 7 99", "an element has the node 99"),
        (b"5\n0 5", b"4\n0 5", "it has 5 names, not 4"),
    ],
)
def test_damaged_files_are_refused(tmp_path, old, new, message):
    content = text_of(b"2.2", False)
    assert content.count(old) == 1
    with pytest.raises(ModelError, match=message):
        read(tmp_path, content.replace(old, new))


@pytest.mark.parametrize("is_binary", [False, True], ids=["text", "binary"])
@pytest.mark.parametrize("version", [b"2.2", b"4.1"], ids=["2.2", "4.1"])
def test_no_part_of_a_file_is_taken_for_the_whole(tmp_path, version, is_binary):
    content = text_of(version, is_binary)
    for end in range(0, len(content) - 1, 7):
        with pytest.raises(ModelError, match="part.msh"):
            read(tmp_path, content[:end])


@pytest.mark.parametrize("kind, n", [(11, 10), (17, 20), (18, 15), (19, 13)])
def test_middle_nodes_stand_between_their_corners(tmp_path, kind, n):
    """Edges of the reference manual of Gmsh, in its order, become those of VTK."""
    edges = {
        11: [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)],
        17: [(0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)],
        18: [(0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)],
        19: [(0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)],
    }[kind]
    of_vtk = {
        24: [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)],
        25: [(0, 1), (1, 2), (2, 3), (0, 3), (4, 5), (5, 6), (6, 7), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7)],
        26: [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (0, 3), (1, 4), (2, 5)],
        27: [(0, 1), (1, 2), (2, 3), (0, 3), (0, 4), (1, 4), (2, 4), (3, 4)],
    }
    corners = np.random.default_rng(1).random((n - len(edges), 3))
    at = np.vstack([corners, [0.5 * (corners[a] + corners[b]) for a, b in edges]])
    nodes = "".join(f"{i + 1} {x} {y} {z}\n" for i, (x, y, z) in enumerate(at))
    element = f"1\n1 {kind} 0 {' '.join(str(i + 1) for i in range(n))}\n"
    content = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{n}\n{nodes}$EndNodes\n$Elements\n{element}$EndElements\n"
    mesh = read(tmp_path, content.encode())
    ((vtk, cell),) = mesh.cells
    found = mesh.points[np.array(cell) - 1]
    middles = [0.5 * (found[a] + found[b]) for a, b in of_vtk[vtk]]
    assert np.abs(found[len(corners) :] - middles).max() < 1e-12
