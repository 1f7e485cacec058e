"""Decks of Abaqus and CalculiX, and bulk data of Nastran, by the rules of their own languages."""

import numpy as np
import pytest
import scipy.sparse as sp
from nhbm import ModelError, Structure, bulk_data, importing, meshes

NODES = "".join(f"{n}, {n}.0, 0.5, 0.0\n" for n in range(1, 10))
HEX = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


def read(folder, text, name="deck.inp", **others):
    for stem, content in others.items():
        (folder / f"{stem}.inp").write_text(content)
    (folder / name).write_text(text)
    return meshes.read_mesh(folder / name)


def with_mesh(folder, text, numbers, name="deck.inp"):
    """A structure with the nodes `numbers`, each free along z, with this mesh."""
    unit = sp.identity(len(numbers))
    model = Structure(mass=unit, stiffness=unit, **importing.nodes_of_labels([f"n{n}.z" for n in numbers]))
    (folder / name).write_text(text)
    return model, meshes.add_mesh(model, folder / name)


@pytest.mark.parametrize(
    "sets, members",
    [
        ("*NSET, NSET=tip\n3, 4\n5\n*NSET, NSET=TIP\n7, 6\n", [3, 4, 5, 7, 6]),
        ("*NSET, NSET=low\n3, 4\n*NSET, NSET=high\n8\n*NSET, NSET=tip\nlow, HIGH, 2\n", [3, 4, 8, 2]),
        ("*NSET, NSET=tip\n9, 3, 5, 3\n", [9, 3, 5]),
        ("*NSET, NSET=tip, GENERATE\n2, 5\n8, 9, 1\n", [2, 3, 4, 5, 8, 9]),
        ("*NSET, NSET=tip, GENERATE\n1, 99, 4\n", [1, 5, 9]),
        ("*nset, nset = tip , generate\n 1, 3 , 2 ,\n", [1, 3]),
        ("*NSET,\nNSET=tip\n** 7\n1,\n", [1]),
        ("*ELEMENT, TYPE=C3D4, ELSET=cell\n1, 4, 3, 2, 1\n*NSET, NSET=tip, ELSET=cell\n", [4, 3, 2, 1]),
        ("*ELEMENT, TYPE=T3D2, ELSET=tip\n1, 4, 3\n*ELSET, ELSET=more, GENERATE\n2, 3\n*ELSET, ELSET=tip\nmore\n"
         "*ELEMENT, TYPE=T3D2\n2, 8, 7\n3, 7, 6\n", [4, 3, 8, 7, 6]),
        ("*NSET, NSET=some\n3, 1\n*SURFACE, NAME=tip, TYPE=NODE\nsome, 1.0\n5,\n", [3, 1, 5]),
    ],
)  # fmt: skip
def test_sets_are_those_of_the_solver(tmp_path, sets, members):
    assert read(tmp_path, f"*NODE\n{NODES}{sets}").sets["TIP"] == members


def test_order_of_a_set_is_that_of_the_deck(tmp_path):
    model, _ = with_mesh(tmp_path, f"*NODE\n{NODES}*NSET, NSET=b\n7, 3, 5\n", range(1, 10))
    assert [model.labels[i] for i in model.dofs_of("b.z")] == ["n7.z", "n3.z", "n5.z"]


def test_blocks_and_included_files_are_as_one_file(tmp_path):
    lines = NODES.splitlines(keepends=True)
    flat = "*NODE\n" + "".join(lines[::-1]) + "*NSET, NSET=near\n4, 2\n*NSET, NSET=far\n8, 9\n"
    first, second = "*NODE\n" + "".join(lines[5:][::-1]), "*NODE\n" + "".join(lines[:5][::-1])
    parts = [
        f"{first}{second}*NSET, NSET=near\n4, 2\n*NSET, NSET=far\n8, 9\n",
        "*INCLUDE, INPUT=flat.inp\n*STEP\n*END STEP\n",
        "*Include, input='nodes.inp'\n*NSET, NSET=near\n4, 2\n*NSET, NSET=far\n*INCLUDE, INPUT=numbers.inp\n",
        "*NODE, INPUT=lines.inp\n*NSET, NSET=near\n4, 2\n*NSET, NSET=far\n8, 9\n",
    ]
    others = {"flat": flat, "nodes": first + second, "numbers": "8, 9\n", "lines": "".join(lines)}
    wanted, _ = with_mesh(tmp_path, flat, range(1, 10))
    for part in parts:
        for stem, content in others.items():
            (tmp_path / f"{stem}.inp").write_text(content)
        model, _ = with_mesh(tmp_path, part, range(1, 10))
        for name in ("near", "far"):
            assert [model.labels[i] for i in model.dofs_of(f"{name}.z")] == [wanted.labels[i] for i in wanted.dofs_of(f"{name}.z")]
        np.testing.assert_array_equal(model.coordinates[model.dof_node], wanted.coordinates[wanted.dof_node])


@pytest.mark.parametrize(
    "kind, n_nodes, corners, edges",
    [
        ("c3d20r", 20, HEX, [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]),
        ("C3D8", 8, HEX, []),
        ("C3D10", 10, [HEX[0], HEX[1], HEX[3], HEX[4]], [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]),
        ("C3D15", 15, [HEX[0], HEX[1], HEX[3], HEX[4], HEX[5], HEX[7]],
         [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]),
    ],
)  # fmt: skip
def test_faces_are_planes_that_close_the_element(tmp_path, kind, n_nodes, corners, edges):
    """Each face lies on one side of the element and the areas that it spans point outwards and add up to zero."""
    points = np.array(corners + [np.mean([corners[a], corners[b]], axis=0) for a, b in edges], dtype=float)
    nodes = "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(points, 1))
    numbers = list(map(str, range(1, n_nodes + 1)))
    element = ", ".join(["1", *numbers[:12]]) + (",\n" + ", ".join(numbers[12:]) if n_nodes > 12 else "")
    n_faces = {8: 6, 20: 6, 10: 4, 15: 5}[n_nodes]
    surfaces = "".join(f"*SURFACE, NAME=f{k}\nall, S{k}\n" for k in range(1, n_faces + 1))
    mesh = read(tmp_path, f"*NODE\n{nodes}*ELEMENT, TYPE={kind}, ELSET=all\n{element}\n{surfaces}")
    assert len(mesh.cells) == 1 and mesh.cells[0][1] == list(range(1, n_nodes + 1))
    centre, total, seen = points.mean(axis=0), np.zeros(3), set()
    for k in range(1, n_faces + 1):
        members = mesh.sets[f"F{k}"]
        face = points[[n - 1 for n in members]]
        is_corner = [n <= len(corners) for n in members]
        ring = face[is_corner]
        middle = ring.mean(axis=0)
        area = sum(np.cross(a - middle, b - middle) for a, b in zip(ring, np.roll(ring, -1, axis=0))) / 2
        area *= np.sign(area @ (middle - centre))
        assert np.abs((face - middle) @ area).max() < 1e-12
        assert len(members) == len(ring) + (len(ring) if edges else 0)
        total, seen = total + area, seen | {tuple(sorted(members))}
    assert np.abs(total).max() < 1e-12 and len(seen) == n_faces


def test_unknown_elements_are_skipped_with_a_note(tmp_path):
    elements = (
        "*ELEMENT, TYPE=QQ7, ELSET=odd\n1, 1, 2,\n3, 4\n2, 5, 6\n*ELEMENT, TYPE=SPRINGA\n3, 1, 2\n*ELEMENT, TYPE=MASS\n4, 1\n"
    )
    mesh = read(tmp_path, f"*NODE\n{NODES}{elements}*BEHAVIOUR\n1, 2\n")
    assert [kind for kind, _ in mesh.cells] == [3, 1]
    assert mesh.notes == ["2 elements of the type QQ7 are not drawn"]


def test_middle_node_of_a_line_comes_last_in_its_cell(tmp_path):
    assert read(tmp_path, f"*NODE\n{NODES}*ELEMENT, TYPE=B32\n1, 1, 2, 3\n").cells == [(21, [1, 3, 2])]


def test_cylindrical_positions(tmp_path):
    mesh = read(tmp_path, "*NODE, SYSTEM=C\n1, 2., 90., 3.\n")
    np.testing.assert_allclose(mesh.points, [[0.0, 2.0, 3.0]], atol=1e-15)


@pytest.mark.parametrize(
    "text, message",
    [
        ("*NODE\n1, 0., x\n", "line 2: '1, 0., x' is not a node with its position"),
        ("*NODE\n1, 0.\n*NSET, NSET=a\n2x\n", "line 4: '2x' is neither a number nor the name of a node set that stands before it"),
        ("*NODE\n1, 0.\n*NSET, NSET=a, GENERATE\n1, 2, 0\n", "line 4: '1, 2, 0' must be 'first, last, increment'"),
        ("*NODE\n1, 0.\n*NSET\n1\n", "line 3: \\*NSET has no NSET="),
        ("*INCLUDE, INPUT=none.inp\n", "line 1: the file .*none.inp' of INPUT= does not exist"),
        ("*INCLUDE, INPUT=deck.inp\n", "includes itself"),
        ("*NODE\n1, 0.\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3\n", "line 4: element 1 of the type C3D4 has 3 nodes, not 4"),
        ("*NODE\n1, 0.\n*ELEMENT, TYPE=T3D2\n1, 1, 2\n", "element 1 has the node 2, which no \\*NODE defines"),
        ("*NODE\n1, 0.\n*INSTANCE, NAME=A, PART=P\n*INSTANCE, NAME=B, PART=P\n", "several \\*INSTANCE"),
        ("*HEADING\nnothing\n", "has no \\*NODE with nodes"),
    ],
)
def test_decks_that_are_not_right_are_named(tmp_path, text, message):
    with pytest.raises(ModelError, match=message):
        read(tmp_path, text)


def test_a_step_without_an_end_is_told(tmp_path):
    """CalculiX takes it: seven of its own examples end so."""
    mesh = read(tmp_path, "*NODE\n1, 0.\n*STEP\n*FREQUENCY\n")
    assert mesh.numbers.tolist() == [1] and mesh.notes == ["the *STEP of line 3 has no *END STEP: it may not be whole"]


def test_a_last_line_without_an_end_is_told(tmp_path):
    assert not read(tmp_path, "*NODE\n1, 800.\n").notes
    assert read(tmp_path, "*NODE\n1, 8").notes == ["its last line has no end: it may not be whole"]


@pytest.mark.parametrize(
    "text, message",
    [
        ("BEGIN BULK\nGRID,1,,0.,0.,0.\n", "line 1: BEGIN BULK is without ENDDATA"),
        ("GRID,1,,0.,0.,0.\n?rubbish, 1.2.3\n", "line 2: '.rubbish, 1.2.3' continues no entry"),
        ("DMIG,K,0,6,2,0\nDMIG,K,1,1,,1,1,2.0", "is not whole: its last line has no end"),
    ],
)
def test_bulk_data_that_is_not_whole(tmp_path, text, message):
    (tmp_path / "m.bdf").write_text(text)
    with pytest.raises(ModelError, match=message):
        bulk_data.read_dmig(tmp_path / "m.bdf")


@pytest.mark.parametrize("program", ["nastran", "abaqus"])
def test_no_part_of_matrices_without_a_count_is_taken_for_the_whole(tmp_path, program):
    """A chain of masses whose file ends at any line: it is refused, or told that something has no stiffness."""
    n = 5
    stiffness, mass = ({(i, j): value for i in range(n) for j, value in ((i, diagonal), (i + 1, off)) if j < n}
                       for diagonal, off in ((2.0, -1.0), (4.0, 1.0)))  # fmt: skip
    if program == "nastran":
        lines = []
        for name, terms in (("M", mass), ("K", stiffness)):
            lines.append(f"DMIG,{name},0,6,2,0\n")
            for (i, j), value in terms.items():
                lines.append((f"DMIG,{name},{i + 1},3," if i == j else "") + f",{j + 1},3,{value}\n")
        first = lines.index("DMIG,K,0,6,2,0\n")
    else:
        (tmp_path / "m.mtx").write_text("".join(f"{i + 1},3,{j + 1},3,{value}\n" for (i, j), value in mass.items()))
        lines = [f"{i + 1},3,{j + 1},3,{value}\n" for (i, j), value in stiffness.items()]
        first = 0

    def take(end):
        (tmp_path / "k.pch").write_text("".join(lines[:end]))
        if program == "nastran":
            return importing.import_structure(nastran=tmp_path / "k.pch", mass="M", stiffness="K")
        return importing.import_structure(abaqus=True, mass=tmp_path / "m.mtx", stiffness=tmp_path / "k.pch")

    assert take(len(lines)).notes == []
    for end in range(first, len(lines)):
        try:
            notes = take(end).notes
        except ModelError:
            continue
        assert any("have no stiffness" in note or "has no stiffness" in note for note in notes), end


def test_held_nodes_of_a_set_are_told(tmp_path):
    _, notes = with_mesh(tmp_path, f"*NODE\n{NODES}*NSET, NSET=tip\n1, 2, 3\n*NSET, NSET=root\n1\n", [2, 3])
    assert notes == ["nodes without a degree of freedom are left out of sets: tip (1 of 3), root (1 of 1)"]


def test_grid_points_have_their_own_numbers(tmp_path):
    """In fields of 8 and 16 columns, by commas; CHEXA has its upright edges before those above."""
    points = [*HEX, *(np.mean([HEX[a], HEX[b]], axis=0) for a, b in
              [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)])]  # fmt: skip
    forms = [
        "GRID,{},,{},{},{}\n",
        "GRID    {:<8}        {:<8}{:<8}{:<8}\n",
        "GRID*   {:<16}                {:<16}{:<16}\n*       {:<16}\n",
    ]
    numbers = [101 + 7 * (k * 11 % 20) for k in range(20)]
    grids = "".join(forms[k % 3].format(numbers[k], *map(float, p)) for k, p in enumerate(points))
    cell = (
        f"CHEXA,1,1,{','.join(map(str, numbers[:6]))}\n,{','.join(map(str, numbers[6:14]))}\n,{','.join(map(str, numbers[14:]))}\n"
    )
    model, notes = with_mesh(tmp_path, f"CEND\nBEGIN BULK\n{grids}{cell}ENDDATA\n", sorted(numbers), "m.bdf")
    np.testing.assert_array_equal(model.coordinates[model.dof_node], [points[numbers.index(n)] for n in sorted(numbers)])
    assert notes == [] and model.cell_types.tolist() == [25]
    at = model.coordinates[model.cell_nodes]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    np.testing.assert_allclose(at[8:], [(at[a] + at[b]) / 2 for a, b in edges])  # as VTK has them


def test_entries_that_repeat_others_are_those_of_nastran(tmp_path):
    """= keeps a field, == all that follow, *x adds x, =n does the line before n times more."""
    text = """BEGIN BULK
GRID,1,,0.,-5.,2.+1
=,*1,,*(2.5),==
=(2)
=,34,,=,7.,==
=,*1,,=,*-1.0,==
=1
CBAR,1,100,1,2,150.,150.,300.
=,*1,=,*1,*1,==
GRID    50              1.0     2.0     3.0
ENDDATA
"""
    mesh = read(tmp_path, text, "m.bdf")
    assert dict(zip(mesh.numbers.tolist(), mesh.points.tolist())) == {
        1: [0.0, -5.0, 20.0], 2: [2.5, -5.0, 20.0], 3: [5.0, -5.0, 20.0], 4: [7.5, -5.0, 20.0],
        34: [7.5, 7.0, 20.0], 35: [7.5, 6.0, 20.0], 36: [7.5, 5.0, 20.0], 50: [1.0, 2.0, 3.0]}  # fmt: skip
    assert mesh.cells == [(3, [1, 2]), (3, [2, 3])]
    for bad, why in (
        ("=,*1,==\n", "repeats no entry"),
        ("GRID,1,,0.,0.,0.\n=2\n", "repeats no entry"),
        ("GRID,1,,0.,0.,0.\n=,*x,==\n", "is 'x', not a number"),
        ("GRID,1,,0.,0.,0.\n=,*1,==\nGRID,9,,0.,0.,1.\n=2\n", "repeats no entry"),
        ("CHEXA,1,1,1,2,3,4,5,6\n,7,8\n=,*1,==\n", "line 4 repeats it, and it has continuations"),
    ):
        with pytest.raises(ModelError, match=why):
            read(tmp_path, f"BEGIN BULK\n{bad}ENDDATA\n", "bad.bdf")


def test_a_grid_point_may_stand_in_two_files_of_an_assembly(tmp_path):
    one, other = "GRID,3,,1.,2.,3.\n", "GRID    3       0       1.0     2.0     3.0\n"
    assert read(tmp_path, one + other, "m.bdf").points.tolist() == [[1.0, 2.0, 3.0]]
    for wrong, why in (("GRID,3,,1.,2.,4.\n", "at two places"), ("GRID,3,,1.,2.,3.,7\n", "with two coordinate systems")):
        with pytest.raises(ModelError, match=f"point 3 is given twice, {why}"):
            read(tmp_path, one + wrong, "m.bdf")


def test_directions_of_another_frame_are_not_called_x(tmp_path):
    text = "CORD2R,10,,1.,0.,0.,1.,0.,1.\n,1.,1.,0.\nGRID,1,10,2.,0.,0.,10\nGRID,2,,0.,0.,0.\n"
    model, notes = with_mesh(tmp_path, text, [1, 2], "m.bdf")
    assert model.labels == ["n1.d3", "n2.z"] and model.dof_direction == ["d3", "z"]
    np.testing.assert_allclose(model.coordinates[model.dof_node], [[1.0, 2.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-15)
    assert "point 1 moves along the axes of the coordinate system 10" in notes[0]


FORMS = {
    "6 lower": (6, [(1, 1), (2, 1), (2, 2)]), "6 upper": (6, [(1, 1), (1, 2), (2, 2)]),
    "6 both": (6, [(1, 1), (2, 1), (1, 2), (2, 2)]),
    "1": (1, [(1, 1), (2, 1), (1, 2), (2, 2)]),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("width", ["commas", "8", "16"])
def test_dmig_in_each_form(tmp_path, form, width):
    """Columns with several terms on a line, exponents D and those without a letter."""
    number, pairs = FORMS[form]
    values = {(1, 1): ("2.5D+03", 2500.0), (2, 1): ("-1.25+2", -125.0), (1, 2): ("-1.25+2", -125.0), (2, 2): ("3.", 3.0)}
    text = f"DMIG,K,0,{number},2,0\n"
    for column in (1, 2):
        rows = [pair for pair in pairs if pair[1] == column]
        if not rows:
            continue
        terms = [[str(10 * i), "3", values[i, j][0], ""] for i, j in rows]
        if width == "commas":
            text += f"DMIG,K,{10 * column},3,,{','.join(terms[0])}\n" + "".join(f",{','.join(t)}\n" for t in terms[1:])
        elif width == "8":
            text += "DMIG    K       " + f"{10 * column:<8}{3:<8}{'':8}" + "".join(f"{w:<8}" for w in terms[0]) + "\n"
            text += "".join(" " * 8 + "".join(f"{w:<8}" for w in t) + "\n" for t in terms[1:])
        else:
            text += f"DMIG*   {'K':<16}{10 * column:<16}{3:<16}{'':16}*\n"
            text += "".join("*       " + "".join(f"{w:<16}" for w in t) + "\n" for t in terms)
    (tmp_path / "k.pch").write_text("$TITLE   = \n" + text)
    model = importing.from_nastran(tmp_path / "k.pch", {"mass": "K", "stiffness": "k"})
    assert model.labels == ["n10.z", "n20.z"]
    np.testing.assert_array_equal(model.stiffness.toarray(), [[2500.0, -125.0], [-125.0, 3.0]])


def test_a_multiplier_of_a_constraint_is_told_apart_from_a_cut_file(tmp_path):
    (tmp_path / "k.mtx").write_text("1,1,1,1,2.0\n2,1,1,1,-1.0\n")
    (tmp_path / "m.mtx").write_text("1,1,1,1,1.0\n2,1,2,1,1.0\n")
    with pytest.raises(ModelError, match="n2.*none on the diagonal: .* constraint"):
        importing.import_structure(abaqus=True, mass=tmp_path / "m.mtx", stiffness=tmp_path / "k.mtx")
