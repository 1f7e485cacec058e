"""Motions in space: shapes and animations read back as VTK has them, of whole models and of reduced ones."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from synthetic import write_results
from test_cli import run

from nhbm_post import Results
from nhbm_post.draw import draw_deflection
from nhbm_post.errors import ReaderError
from nhbm_post.structure import Structure

meshio = pytest.importorskip("meshio")

TUPLES = [[0, 0], [1, 0], [0, 1], [1, 1]]
FREQUENCY = [[2.0, 3.0]]


def write_model(path, labels, node, direction, recovery=None):
    """A quadrilateral of nodes 1 to 4."""
    text = h5py.string_dtype()
    with h5py.File(path, "w") as file:
        file.create_dataset("labels", data=labels, dtype=text)
        file["nodes/number"] = np.arange(1, 5)
        file["nodes/coordinates"] = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        file["cells/type"] = [9]
        file["cells/indptr"] = [0, 4]
        file["cells/nodes"] = [0, 1, 2, 3]
        file["dofs/node"] = node
        file.create_dataset("dofs/direction", data=direction, dtype=text)
        if recovery is not None:
            file["recovery/matrix"] = recovery
            file["recovery/node"] = [1, 2, 2]
            file.create_dataset("recovery/direction", data=["z", "z", "rx"], dtype=text)


@pytest.fixture
def files(tmp_path):
    coefficients = np.random.default_rng(3).normal(size=(1, 2, 4, 2))
    coefficients[:, :, 0, 1] = 0.0
    law = {"law_dofs": ("n2.z",), "force": 10.0 * coefficients[:, 1:]}  # ten times the motion of q1
    write_results(tmp_path / "run.h5", TUPLES, FREQUENCY, coefficients, dofs=("n2.z", "q1"), **law)
    return tmp_path, coefficients[0]


def moved(coefficients, t):
    """(n2.z, q1) at a time, written out."""
    total = np.zeros(2)
    for h, j in enumerate(TUPLES):
        phase = np.dot(j, FREQUENCY[0]) * t
        total += coefficients[:, h, 0] * np.cos(phase) + coefficients[:, h, 1] * np.sin(phase)
    return total


def test_shapes_and_motion_of_a_reduced_model(files, capsys):
    folder, c = files
    recovery = np.array([[1.0, 0.0], [0.5, 2.0], [9.0, 9.0]])
    write_model(folder / "small.h5", ["n2.z", "q1"], [1, -1], ["z", ""], recovery)
    words = ("--tuple", "1,1", "--frames", "3", "--from", "0.25", "--to", "1.0")
    assert run(capsys, "vtk", folder / "run.h5", "--model", folder / "small.h5", *words)[0] == 0
    shapes = meshio.read(folder / "run_harmonics.vtu").point_data
    expected = recovery[:2] @ c[:, 3, :]
    for k, part in enumerate(("cos", "sin")):
        field = shapes[f"{part} 1,1"]
        np.testing.assert_allclose(field[[1, 2], 2], expected[:, k], rtol=1e-14)
        assert not field[[0, 3]].any() and not field[:, :2].any()
    np.testing.assert_allclose(shapes["amplitude 1,1"][[1, 2], 2], np.hypot(*expected.T), rtol=1e-14)
    for i, t in enumerate((0.25, 0.5, 0.75)):
        mesh = meshio.read(folder / "run_motion" / f"000{i}.vtu")
        assert mesh.cells[0].type == "quad"
        np.testing.assert_allclose(mesh.point_data["displacement"][[1, 2], 2], recovery[:2] @ moved(c, t), rtol=1e-12)
        force = mesh.point_data["law_force"]
        np.testing.assert_allclose(force[1, 2], 10.0 * moved(c, t)[1], rtol=1e-12)
        assert np.count_nonzero(force) == 1
    assert 'timestep="0.5" file="run_motion/0001.vtu"' in (folder / "run_motion.pvd").read_text()


def test_model_as_it_is(files, capsys):
    folder, c = files
    write_model(folder / "full.h5", ["n2.z", "q1", "n3.x"], [1, 0, 2], ["z", "y", "x"])
    status, out, _ = run(capsys, "vtk", folder / "run.h5", "--model", folder / "full.h5", "--frames", "0", "-o", folder / "a")
    assert status == 0 and "a_harmonics.vtu: 4 harmonics" in out
    field = meshio.read(folder / "a_harmonics.vtu").point_data["cos 1,0"]
    np.testing.assert_allclose([field[1, 2], field[0, 1], field[2, 0]], [*c[:, 1, 0], 0.0], rtol=1e-14)
    assert not (folder / "a_motion.pvd").exists()


def test_nodes_without_a_cell_are_points(tmp_path):
    write_model(tmp_path / "full.h5", ["n2.z"], [1], ["z"])
    with h5py.File(tmp_path / "full.h5", "r+") as file:
        file["cells/nodes"][...] = [0, 1, 1, 0]
    mesh = Structure(tmp_path / "full.h5").mesh()
    assert [block.type for block in mesh.cells] == ["quad", "vertex"] and mesh.cells[1].data.tolist() == [[2], [3]]


def test_nodes_without_a_place_are_left_out(tmp_path):
    """As those that a program adds inside its elements; of an element with such a node nothing is guessed."""
    write_model(tmp_path / "full.h5", ["n2.z", "n3.z"], [1, 2], ["z", "z"])
    with h5py.File(tmp_path / "full.h5", "r+") as file:
        file["nodes/coordinates"][2] = np.nan
        file["cells/nodes"][...] = [0, 1, 3, 3]
    structure = Structure(tmp_path / "full.h5")
    mesh = structure.mesh()
    assert np.isfinite(mesh.points).all() and [block.type for block in mesh.cells] == ["quad"]
    assert np.array_equal(structure.displacement(np.array([2.0, 5.0])), [[0, 0, 0], [0, 0, 2.0], [0, 0, 0], [0, 0, 0]])
    with h5py.File(tmp_path / "full.h5", "r+") as file:
        file["cells/nodes"][...] = [0, 1, 2, 3]
    with pytest.raises(ReaderError, match="node 3"):
        Structure(tmp_path / "full.h5").mesh()


def test_sets_need_no_positions(files, capsys):
    folder, c = files
    write_model(folder / "bare.h5", ["n2.z", "q1"], [1, 0], ["z", "y"])
    with h5py.File(folder / "bare.h5", "r+") as file:
        file["nodes/coordinates"][...] = np.nan
        file["sets/names"], file["sets/indptr"], file["sets/nodes"] = [b"tip"], [0, 1], [1]
    words = "&structure\n   type = 'model'\n   file = 'bare.h5'\n/\n"
    write_results(folder / "named.h5", TUPLES, FREQUENCY, c[None], input_groups=words, dofs=("n2.z", "q1"), law_dofs=("n2.z",))
    with Results(folder / "named.h5") as results:
        np.testing.assert_array_equal(results.series(0, "tip.z").cos, results.series(0, "n2.z").cos)
    status, _, err = run(capsys, "vtk", folder / "named.h5")
    assert status == 2 and "has no coordinates" in err


def test_forces_of_nodes_that_move_along_their_radius(tmp_path):
    write_model(tmp_path / "polar.h5", ["n3.r", "n3.t", "n4.t", "n2.x"], [2, 2, 3, 1], ["r", "t", "t", "x"])
    force = Structure(tmp_path / "polar.h5").force({"n3.r": 2.0, "n4.t": 3.0, "n2.x": 5.0, "q1": 7.0})
    expected = [[0, 0, 0], [5, 0, 0], [np.sqrt(2), np.sqrt(2), 0], [-3, 0, 0]]
    np.testing.assert_allclose(force, expected, atol=1e-15)


def test_model_that_the_input_names_is_used(files, tmp_path, capsys, monkeypatch):
    folder, c = files
    write_model(folder / "full.h5", ["n2.z", "q1"], [1, 0], ["z", "y"])
    run_of = {"dofs": ("n2.z", "q1"), "law_dofs": ("n2.z",)}
    for name in ("full.h5", "elsewhere/full.h5"):
        words = f"&structure\n   type = 'model'\n   file = '{name}'\n/\n"
        write_results(folder / "named.h5", TUPLES, FREQUENCY, c[None], input_groups=words, **run_of)
        status, out, err = run(capsys, "vtk", folder / "named.h5", "--frames", "0")
        assert status == 0 and "4 harmonics" in out, err
    (folder / "full.h5").unlink()
    status, _, err = run(capsys, "vtk", folder / "named.h5")
    words = "its model file 'elsewhere/full.h5' is neither in the folder of its input, nor here, nor beside it; --model gives"
    assert status == 2 and words in err
    status, _, err = run(capsys, "vtk", folder / "run.h5")
    assert status == 2 and "its input names no model file" in err


def test_sets_of_the_input_name_degrees_of_freedom(files, capsys):
    folder, c = files
    write_model(folder / "full.h5", ["n2.z", "q1"], [1, 0], ["z", "y"])
    with h5py.File(folder / "full.h5", "a") as file:
        file.create_dataset("sets/names", data=["tip", "both"], dtype=h5py.string_dtype())
        file["sets/indptr"], file["sets/nodes"] = [0, 1, 3], [1, 0, 1]
    words = "&structure\n   type = 'model'\n   file = 'full.h5'\n/\n"
    of_run = {"dofs": ("n2.z", "q1"), "law_dofs": ("n2.z",)}
    write_results(folder / "named.h5", TUPLES, FREQUENCY, c[None], input_groups=words, **of_run)
    with Results(folder / "named.h5") as results:
        assert results.default_dof() == "n2.z"
    words += "&law\n   dof = 'tip.z'\n/\n"
    write_results(folder / "named.h5", TUPLES, FREQUENCY, c[None], input_groups=words, **of_run)
    with Results(folder / "named.h5") as results:  # pictures have the name that the user has given
        assert results.default_dof() == "tip.z" and results.series(0, None).label == "tip.z"
    values = [run(capsys, "value", folder / "named.h5", "--dof", dof, "--tuple", "1,0")[1] for dof in ("n2.z", "tip.z")]
    assert values[0] and values[0] == values[1]
    for wrong, message in (("both", "'both' are 2 degrees of freedom; name one"), ("tip.x", "stored: tip.z, q1")):
        assert message in run(capsys, "value", folder / "named.h5", "--dof", wrong, "--tuple", "1,0")[2]


def test_what_does_not_fit_is_reported(files, capsys):
    folder, _ = files
    write_model(folder / "other.h5", ["n9.z"], [1], ["z"])
    status, _, err = run(capsys, "vtk", folder / "run.h5", "--model", folder / "other.h5")
    assert status == 2 and "holds no degree of freedom of" in err
    write_model(folder / "more.h5", ["n2.z", "q1", "q2"], [1, -1, -1], ["z", "", ""], np.zeros((3, 3)))
    status, _, err = run(capsys, "vtk", folder / "run.h5", "--model", folder / "more.h5")
    assert status == 2 and "does not hold q2" in err
    status, _, err = run(capsys, "vtk", folder / "run.h5", "--model", folder / "run.h5")
    assert status == 2 and "no model with nodes" in err
    write_model(folder / "full.h5", ["n2.z", "q1"], [1, 0], ["z", "y"])
    status, _, err = run(capsys, "vtk", folder / "run.h5", "--model", folder / "full.h5", "--tuple", "9,9")
    assert status == 2 and "tuple 9,9 is not in the set of harmonics" in err


def test_wrong_model_files_and_paths_are_named(files, capsys):
    folder, _ = files
    (folder / "text.h5").write_text("no HDF5")
    write_model(folder / "full.h5", ["n2.z", "q1"], [1, 0], ["z", "y"])
    for model, more, message in (
        ("none.h5", (), "none.h5: no such file"),
        (".", (), "is a folder"),
        ("text.h5", (), "text.h5: cannot be read as HDF5"),
        ("run.h5", (), "run.h5: no model with nodes: it has no 'labels'"),
        ("full.h5", ("--to", "nan"), "nan is not a finite number"),
        ("full.h5", ("-o", folder / "none" / "x"), "cannot write"),
        ("full.h5", ("-o", folder / "text.h5" / "x"), "cannot write"),
    ):
        status, out, err = run(capsys, "vtk", folder / "run.h5", "--model", folder / model, *more)
        assert (status, out, err.count("\n")) == (2, "", 1) and message in err and "damaged" not in err


@pytest.mark.parametrize("words", [(), ("--tuple", "0,1"), ("--time", "0.5")])
def test_quick_view(files, capsys, words):
    folder, _ = files
    write_model(folder / "full.h5", ["n2.z", "q1"], [1, 0], ["z", "y"])
    status, out, _ = run(capsys, "deflection", folder / "run.h5", "--model", folder / "full.h5", *words, "--dpi", "40")
    assert status == 0 and (folder / "run_deflection.png").stat().st_size > 2000


def test_plane_bodies_that_move_in_their_plane_are_seen_from_above():
    from nhbm_post.draw.deflection import flat_across

    plate = np.array([[0.0, 0, 0], [1, 0, 0.01], [0, 1, 0]])
    in_plane, across = np.array([[0.1, 0, 0.001]] * 3), np.array([[0.0, 0, 0.1]] * 3)
    assert flat_across(plate, in_plane) == 2 and flat_across(plate[:, [2, 0, 1]], in_plane[:, [2, 0, 1]]) == 0
    assert flat_across(plate, across) is None and flat_across(plate * [1, 1, 100], in_plane) is None
    assert flat_across(plate * [1, 0, 0], in_plane) is None  # a line
    for points, moved, axes_names in ((plate, in_plane, "xy"), (plate[:, [2, 0, 1]], in_plane[:, [2, 0, 1]], "yz")):
        body = SimpleNamespace(points=points, cells=[(5, [0, 1, 2])])
        ax = draw_deflection(body, moved, ("amplitude", np.linalg.norm(moved, axis=1)), "Motion", "").axes[0]
        assert [ax.get_xlabel(), ax.get_ylabel()] == [f"{name} [m]" for name in axes_names] and ax.get_aspect() == 1.0


def test_labels_of_upright_bodies_stay_in_the_picture():
    heights = np.linspace(0.0, 0.6, 5)
    shaft = SimpleNamespace(points=np.array([[0.0, 0.0, z] for z in heights]), cells=[(3, [k, k + 1]) for k in range(4)])
    moved = np.array([[x, 0.0, 0.0] for x in (0.0, 1e-4, 2e-4, 1e-4, 0.0)])
    fig = draw_deflection(shaft, moved, ("amplitude", moved[:, 0]), "Motion", "")
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    lowest = np.asarray(canvas.buffer_rgba())[-1]
    assert (lowest == lowest[0]).all(), "nothing is cut off"


def test_surface_is_what_one_cell_has_alone():
    from nhbm_post.draw.deflection import surface

    two = [(10, [0, 1, 2, 3]), (10, [1, 2, 3, 4])]
    faces = surface(two)
    assert len(faces) == 6 and {1, 2, 3} not in [set(face) for face in faces]
    assert surface([(9, [4, 5, 6, 7])]) == [(4, 5, 6, 7)]
