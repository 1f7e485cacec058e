"""Contact between surfaces whose meshes differ: what passes from one to the other, in the whole model and in reduced ones."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.spatial.transform import Rotation

from nhbm import ModelError, Structure, assembly, cyclic, examples, reduction, surfaces
from nhbm.command import main
from nhbm.surfaces import relative_motion

YOUNG, POISSON = 2.1e11, 0.3
FORMS = {  # cell of one brick or wedge by its VTK type, with the shares of a uniform pressure that a face gives corners and middles
    12: ("hexahedron", 8, (1 / 4, 0.0)), 25: ("quadratic hexahedron", 20, (-1 / 12, 1 / 3)),
    13: ("wedge", 6, (1 / 3, 0.0)), 26: ("quadratic wedge", 15, (0.0, 1 / 3)),
}  # fmt: skip

EDGES = {  # between the corners of cells with middles, in the order of VTK
    20: [*((k, (k + 1) % 4) for k in range(4)), *((4 + k, 4 + (k + 1) % 4) for k in range(4)), *((k, 4 + k) for k in range(4))],
    15: [*((k, (k + 1) % 3) for k in range(3)), *((3 + k, 3 + (k + 1) % 3) for k in range(3)), *((k, 3 + k) for k in range(3))],
}


def blocks(first, second, shift=0.0, clamped=("none", "none")):
    """Two blocks of quadratic tetrahedra on each other, with so many elements along each side."""
    pytest.importorskip("skfem")
    size = {"length": 0.04, "width": 0.03, "height": 0.02, "young": YOUNG, "poisson": POISSON}
    parts = {}
    for name, n, ends in zip("ab", (first, second), clamped):
        parts[name] = examples.solid(**size, n_x=n[0], n_y=n[1], n_z=n[2], clamped=ends)
    return assembly.assemble(parts, {"b": (shift, 0.0, 0.02)})


def test_a_uniform_stress_passes_meshes_that_differ():
    """Patch test, with 3 elements below 4: uniform compression of both blocks is in equilibrium with springs between them."""
    model = blocks((3, 3, 2), (4, 4, 2))
    contact = assembly.add_surfaces(model, "joint", "a_top", "b_bottom")
    assert contact.areas.sum() == pytest.approx(0.04 * 0.03, rel=1e-12)
    pressure, spring = 1e6, 1e13
    stiffness = model.stiffness
    for direction in "nst":
        rows = relative_motion(model, f"joint.{direction}")
        stiffness = stiffness + spring * rows.T @ sp.diags(contact.areas) @ rows
    is_upper = np.isin(np.arange(len(model.node_numbers)), model.cell_nodes[model.cell_starts[3 * 3 * 2 * 6] :])
    strain = pressure / YOUNG
    fields = {"x": POISSON * strain * model.coordinates[:, 0], "y": POISSON * strain * model.coordinates[:, 1],
              "z": -strain * model.coordinates[:, 2] - np.where(is_upper, pressure / spring, 0.0)}  # fmt: skip
    motion = np.array([fields[d][node] for d, node in zip(model.dof_direction, model.dof_node)])
    force = np.zeros(model.n_dofs)
    along_z = {int(node): dof for dof, (node, d) in enumerate(zip(model.dof_node, model.dof_direction)) if d == "z"}
    for name, sign in (("b_top", -1.0), ("a_bottom", 1.0)):
        for face in surfaces.faces_of(model, name):
            area = np.linalg.norm(np.cross(face.corners[1] - face.corners[0], face.corners[2] - face.corners[0])) / 2
            for node in face.nodes[3:]:
                force[along_z[int(node)]] += sign * pressure * area / 3
    np.testing.assert_allclose(stiffness @ motion, force, atol=1e-10 * abs(force).max())


def bodies(kind, n_first, n_second, turn=None):
    """Two layers of bricks or wedges, the second on the first, whose meshes have so many parts along x and y; turned in space."""
    _, n_nodes, _ = FORMS[kind]
    corners, cells = [], []
    edges = EDGES.get(n_nodes, ())
    sets = {"low": set(), "high": set()}
    at = {}

    def node(point, body):
        key = (body, *np.round(point, 9))
        if key not in at:
            at[key] = len(corners)
            corners.append(point)
        return at[key]

    for body, (name, n, z) in enumerate((("low", n_first, (0.0, 1.0)), ("high", n_second, (1.0, 2.0)))):
        x = np.linspace(0.0, 3.0, n + 1)
        for i in range(n):
            for j in range(n):
                square = [(x[i], x[j]), (x[i + 1], x[j]), (x[i + 1], x[j + 1]), (x[i], x[j + 1])]
                for part in [square] if kind in (12, 25) else [square[:3], [square[0], *square[2:]]]:
                    points = [np.array([*p, level]) for level in z for p in part]
                    points += [(points[a] + points[b]) / 2 for a, b in edges]
                    members = [node(point, body) for point in points]
                    cells.append(members)
                    sets[name] |= {m for m, point in zip(members, points) if point[2] == 1.0}
    coordinates = np.array(corners) if turn is None else turn.apply(corners)
    n = len(corners)
    return Structure(
        mass=sp.identity(3 * n), stiffness=sp.identity(3 * n), labels=[f"n{i + 1}.{d}" for i in range(n) for d in "xyz"],
        node_numbers=np.arange(1, n + 1), coordinates=coordinates,
        dof_node=np.repeat(np.arange(n), 3), dof_direction=list("xyz" * n),
        cell_types=np.full(len(cells), kind), cell_starts=n_nodes * np.arange(len(cells) + 1), cell_nodes=np.ravel(cells),
        sets={name: np.array(sorted(members)) for name, members in sets.items()},
    )  # fmt: skip


@pytest.mark.parametrize("kind", FORMS)
def test_a_uniform_pressure_gives_the_forces_of_the_faces(kind):
    """On both surfaces, by the integrals of their own shape functions, in any position in space."""
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5])
    model = bodies(kind, 3, 4, turn)
    contact = assembly.add_surfaces(model, "joint", "low", "high")
    assert contact.areas.sum() == pytest.approx(9.0, rel=1e-12)
    np.testing.assert_allclose(contact.along("n"), np.tile(turn.apply([0.0, 0.0, 1.0]), (len(contact.areas), 1)), atol=1e-12)
    np.testing.assert_allclose(contact.frames @ contact.frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(contact.areas), 1, 1)),
                               atol=1e-12)  # fmt: skip
    found = contact.areas @ contact.weights
    expected = np.zeros(len(model.node_numbers))
    of_corner, of_middle = FORMS[kind][2]
    for name, sign in (("low", 1.0), ("high", -1.0)):
        for face in surfaces.faces_of(model, name):
            n = len(face.corners)
            area = np.linalg.norm(np.cross(face.corners[1] - face.corners[0], face.corners[-1] - face.corners[0])) / (
                2 if n == 3 else 1
            )
            expected[face.nodes[:n]] += sign * area * of_corner
            expected[face.nodes[n:]] += sign * area * of_middle
    np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize("kind", FORMS)
def test_only_relative_motions_are_seen(kind):
    """A motion of both bodies together, also a turn, is none; one of the first alone is what the frames make of it."""
    rng = np.random.default_rng(kind)
    model = bodies(kind, 2, 3, Rotation.from_rotvec(rng.normal(size=3)))
    contact = assembly.add_surfaces(model, "joint", "low", "high")
    rows = {direction: relative_motion(model, f"joint.{direction}") for direction in "nst"}
    together = (rng.normal(size=3) + np.cross(rng.normal(size=3), model.coordinates)).ravel()
    shift = rng.normal(size=3)
    first = set(model.sets["low"].tolist())
    alone = np.array([shift if node in first else np.zeros(3) for node in range(len(model.node_numbers))]).ravel()
    for direction, matrix in rows.items():
        np.testing.assert_allclose(matrix @ together, 0.0, atol=1e-11)
        np.testing.assert_allclose(matrix @ alone, contact.along(direction) @ shift, atol=1e-11)


def test_gaps_are_those_of_the_meshes():
    model = bodies(12, 3, 4)
    upper = np.unique(model.cell_nodes[8 * 9 :])
    model.coordinates[upper, 2] += 0.01 * (1.0 + model.coordinates[upper, 0])
    with pytest.raises(
        ModelError, match=r"no face of 'low' faces one of 'high'; the closest faces are 0\.01\d* apart: give --within"
    ):
        surfaces.contact(model, "low", "high")
    contact = surfaces.contact(model, "low", "high", within=0.05)
    assert contact.areas @ contact.gaps == pytest.approx(0.01 * (9.0 + 3.0 * 4.5), rel=1e-9)


def test_a_part_of_the_surface_may_face_the_other():
    model = blocks((3, 3, 2), (4, 4, 2), shift=0.025)
    contact = assembly.add_surfaces(model, "joint", "a_top", "b_bottom")
    assert contact.areas.sum() == pytest.approx(0.015 * 0.03, rel=1e-10)


@pytest.mark.parametrize("method", reduction.METHODS)
@pytest.mark.parametrize("more", [["n130.x"], []])
def test_reduced_models_keep_the_relative_motion(method, more):
    """Flexibility at rest against forces at the points of contact: that of the whole model."""
    model = blocks((2, 2, 1), (3, 3, 1), 0.02, ("left", "right"))
    contact = assembly.add_surfaces(model, "joint", "a_top", "b_bottom")
    model.loads["pull"] = (np.array([40, 50]), np.array([1.0, -2.0]))
    small = reduction.reduce(model, ["joint.n", "joint.s", *more], 10, method, 20000.0)
    rows = sp.vstack([relative_motion(model, f"joint.{d}") for d in "ns"]).toarray()
    rows = np.vstack([np.eye(model.n_dofs)[[model.labels.index(name) for name in more]], rows])
    n = len(rows)
    inverse = np.linalg.inv(small.stiffness.toarray())
    whole = rows @ spla.spsolve(model.stiffness.tocsc(), rows.T)
    np.testing.assert_allclose(inverse[:n, :n], whole, atol=1e-10 * abs(whole).max())
    np.testing.assert_allclose(rows @ small.recovery.matrix, np.eye(n, small.n_dofs), atol=1e-10)
    pull = np.zeros(model.n_dofs)
    pull[[40, 50]] = 1.0, -2.0
    reduced_pull = np.zeros(small.n_dofs)
    reduced_pull[small.loads["pull"][0]] = small.loads["pull"][1]
    answer = small.recovery.matrix @ inverse @ reduced_pull
    exact = spla.spsolve(model.stiffness.tocsc(), pull)
    np.testing.assert_allclose(answer, exact, atol=1e-9 * abs(exact).max())
    assert small.dofs_of("joint.s") == [len(more) + len(contact.areas) + k for k in range(len(contact.areas))]
    assert max(reduction.compare(model, small, [2000.0]).errors) < 1e-4


def test_files_hold_contacts(tmp_path):
    model = blocks((2, 2, 1), (3, 3, 1), 0.02, ("left", "right"))
    contact = assembly.add_surfaces(model, "joint", "a_top", "b_bottom")
    for one, has_weights in ((model, True), (reduction.reduce(model, ["joint.n"], 5), False)):
        one.write(tmp_path / "model.h5")
        read = Structure.read(tmp_path / "model.h5").contacts["joint"]
        for part in ("areas", "frames", "gaps", "points"):
            np.testing.assert_array_equal(getattr(read, part), getattr(contact, part))
        assert (read.weights is not None) == has_weights
        assert not has_weights or (read.weights != contact.weights).nnz == 0


def test_laws_have_their_share_of_the_area():
    model = blocks((2, 2, 1), (3, 3, 1), 0.02, ("left", "right"))
    areas = assembly.add_surfaces(model, "joint", "a_top", "b_bottom").areas
    small = reduction.reduce(model, ["joint.n", "joint.s", "joint.t"], 5)
    per_area = {"stiffness": 2e12, "normal_stiffness": 3e12, "preload": 1e6}
    for one, key in ((small, "dof"), (model, "dofs")):
        laws = surfaces.laws(one, "joint", "jenkins_2d", per_area, friction_coefficient=0.3)
        assert [law["stiffness"] for law in laws] == pytest.approx(2e12 * areas) and {key, "second_dofs", "normal_dofs"} <= set(
            laws[0]
        )
    assert surfaces.laws(small, "joint", "elastic_stop", {"stiffness": 1.0}, gap=0.1)[0]["dof"].endswith(".n")
    with pytest.raises(ModelError, match="'gap' is given for each area and for each point"):
        surfaces.laws(small, "joint", "elastic_stop", {"gap": 1.0}, gap=0.1)
    with pytest.raises(ModelError, match="there is no contact 'seam'; contacts: joint"):
        surfaces.laws(small, "seam", "elastic_stop", {})


def test_what_is_no_surface_is_refused():
    model = bodies(12, 2, 3)
    model.sets |= {"edge": model.sets["low"][:2], "both": np.union1d(model.sets["low"], model.sets["high"][:1])}
    for first, second, why in (
        ("low", "deep", "there is no set 'deep'; sets: low, high"),
        ("edge", "high", "set 'edge' has no face of a solid cell"),
        ("both", "high", "sets 'both' and 'high' have nodes in common"),
    ):
        with pytest.raises(ModelError, match=why):
            assembly.add_surfaces(model, "joint", first, second)
    with pytest.raises(ModelError, match="there is a set or a contact 'low' already"):
        assembly.add_surfaces(model, "low", "low", "high")
    held = replace(
        model, dof_direction=["rx" if i == 3 * int(model.sets["low"][0]) else d for i, d in enumerate(model.dof_direction)]
    )
    with pytest.raises(ModelError, match="has no degree of freedom 'x'"):
        surfaces.contact(held, "low", "high")
    bare = replace(model, cell_types=model.cell_types[:0], cell_starts=np.zeros(1, int), cell_nodes=np.zeros(0, int))
    with pytest.raises(ModelError, match="the model has no cells"):
        surfaces.contact(bare, "low", "high")
    assembly.add_surfaces(model, "joint", "low", "high")
    with pytest.raises(ModelError, match="part 'a' has contacts between surfaces"):
        assembly.assemble({"a": model})
    with pytest.raises(ModelError, match="a sector has no contacts between surfaces"):
        cyclic.sector_of(model, 8, "low", "high")
    with pytest.raises(ModelError, match="contact 'joint' has the directions n, s, t, not 'z'"):
        reduction.reduce(model, ["joint.z"], 5)


def test_the_command_makes_contacts_and_laws(tmp_path, capsys, monkeypatch):
    pytest.importorskip("skfem")
    monkeypatch.chdir(tmp_path)
    for name, n in (("a", 2), ("b", 3)):
        size = ["--length", "0.04", "--width", "0.03", "--height", "0.02", "--n-x", str(n), "--n-y", str(n)]
        assert main(["solid", *size, "--clamped", {"a": "left", "b": "right"}[name], "-o", f"{name}.h5"]) == 0
    assert (
        main(["assemble", "a=a.h5", "b=b.h5", "--at", "b=0.02,0,0.02", "--surfaces", "joint=a_top,b_bottom", "-o", "both.h5"]) == 0
    )
    assert "surfaces joint: 6 points, area 0.0006" in capsys.readouterr().out
    assert main(["reduce", "both.h5", "--keep", "joint.n,joint.s", "--modes", "5", "--no-error", "-o", "small.h5"]) == 0
    assert main(["info", "small.h5"]) == 0
    assert "surfaces joint: 6 points, area 0.0006" in capsys.readouterr().out
    asked = [
        "laws",
        "small.h5",
        "joint",
        "--type",
        "jenkins",
        "--per-area",
        "stiffness=1e12",
        "--per-area",
        "normal_stiffness=1e12",
    ]
    assert main([*asked, "--per-area", "preload=1e6", "--key", "friction_coefficient=0.3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6 and all(
        line.startswith("&law type = 'jenkins', label = 'joint ") and line.endswith("/") for line in lines
    )
    assert main([*asked, "--key", "friction_coefficient=high"]) != 0
    assert "'high' is no number" in capsys.readouterr().err
