"""Contacts: gaps, forces, stick and slip of patches whose motion is known, in numbers, on files and in pictures."""

import h5py
import numpy as np
import pytest
from synthetic import write_results
from test_cli import run

from nhbm_post import Results
from nhbm_post.complete_input import groups
from nhbm_post.contact import OPEN, SLIP, STICK, Contact, Motion, contacts, follow, history, summary
from nhbm_post.structure import Structure

COORDINATES = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
STOP = "&law\n   type = 'elastic_stop'\n   label = 'stop'\n   stiffness = 100.0\n   gap = 0.5\n   dof = 'patch.z'\n/\n"
STICKING = 1.0 / 3.0  # reach of sliders, relative to their amplitude


def write_model(path, directions="z"):
    """Four nodes, `patch` of the fourth, second and third."""
    text = h5py.string_dtype()
    labels = [f"n{n}.{d}" for n in range(1, 5) for d in directions]
    with h5py.File(path, "w") as file:
        file.create_dataset("labels", data=labels, dtype=text)
        file["nodes/number"] = np.arange(1, 5)
        file["nodes/coordinates"] = COORDINATES
        file["cells/type"], file["cells/indptr"], file["cells/nodes"] = [9], [0, 4], [0, 1, 2, 3]
        file["dofs/node"] = np.repeat(np.arange(4), len(directions))
        file.create_dataset("dofs/direction", data=list(directions) * 4, dtype=text)
        file.create_dataset("sets/names", data=["patch"], dtype=text)
        file["sets/indptr"], file["sets/nodes"] = [0, 3], [3, 1, 2]
    return path


def files(folder, law, amplitudes, direction="z", **more):
    """A run in which the degrees of freedom of `amplitudes` move as cosines, and its model."""
    names = list(amplitudes)
    c = np.zeros((1, len(names), 2, 2))
    c[0, :, 1, 0] = list(amplitudes.values())
    more = {"laws": [f"stop n{n}.{direction}" for n in (4, 2, 3)], "power": [3.0, 1.0, 2.0], **more}
    write_results(folder / "run.h5", [[0], [1]], [[2.0]], c, dofs=names, law_dofs=names, input_groups=law, **more)
    write_model(folder / "model.h5", "xz" if direction == "x" else "z")
    return Results(folder / "run.h5"), Structure(folder / "model.h5")


PATCH = {"n4.z": 1.0, "n2.z": 0.25, "n3.z": 2.0}


def closed_share(amplitude, gap=0.5):
    return np.arccos(gap / amplitude) / np.pi


def test_a_stop_is_closed_where_the_motion_is_beyond_its_gap(tmp_path):
    results, structure = files(tmp_path, STOP, PATCH)
    (contact,) = contacts(results, structure, 0)
    found = summary(contact, Motion(results, 0), results.power_laws(0))
    assert contact.nodes.tolist() == [3, 1, 2] and "loss" not in found
    np.testing.assert_allclose(found["open share"], [1 - closed_share(1.0), 1.0, 1 - closed_share(2.0)], atol=1 / 256)
    np.testing.assert_allclose(found["smallest gap"], [-0.5, 0.25, -1.5], rtol=1e-12)
    np.testing.assert_allclose(found["mean gap"], 0.5, rtol=1e-12)
    np.testing.assert_allclose(found["largest gap"], [1.5, 0.75, 2.5], rtol=1e-12)
    np.testing.assert_allclose(found["largest normal force"], [50.0, 0.0, 150.0], rtol=1e-12)


def test_a_swept_gap_is_that_of_its_point(tmp_path):
    results, structure = files(tmp_path, STOP, PATCH, parameters={"law_stop_gap": ("law(stop)%gap", "m", [0.75])})
    (contact,) = contacts(results, structure, 0)
    assert contact.keys["gap"] == 0.75


def test_both_sides_of_a_stop(tmp_path):
    law = STOP.replace("gap = 0.5", "gap = 0.5\n   two_sided = .true.")
    results, structure = files(tmp_path, law, PATCH)
    (contact,) = contacts(results, structure, 0)
    found = summary(contact, Motion(results, 0), results.power_laws(0))
    np.testing.assert_allclose(found["open share"], [1 - 2 * closed_share(1.0), 1.0, 1 - 2 * closed_share(2.0)], atol=1 / 128)


def jenkins(kind="jenkins", more=""):
    return f"&law\n   type = '{kind}'\n   label = 'stop'\n   stiffness = 6.0\n   limit = 2.0\n   dof = 'patch.z'\n{more}/\n"


def test_a_slider_sticks_until_the_motion_has_come_back_by_twice_its_reach(tmp_path):
    """1 - cos of the angle at which it slips again is twice the reach over the amplitude."""
    results, structure = files(tmp_path, jenkins(), PATCH)
    (contact,) = contacts(results, structure, 0)
    found = summary(contact, Motion(results, 0), results.power_laws(0))
    stick = [np.arccos(1 - 2 * STICKING / amplitude) / np.pi for amplitude in (1.0, 2.0)]
    np.testing.assert_allclose(found["slip share"], [1 - stick[0], 0.0, 1 - stick[1]], atol=2 / 256)
    np.testing.assert_allclose(found["stick share"], [stick[0], 1.0, stick[1]], atol=2 / 256)
    np.testing.assert_allclose(found["largest friction"], [2.0, 1.5, 2.0], rtol=1e-3)
    assert found["loss"].tolist() == [3.0, 1.0, 2.0] and "open share" not in found


def test_a_slider_remembers_what_was_before_its_record(tmp_path):
    results, structure = files(tmp_path, jenkins(), PATCH)
    (contact,) = contacts(results, structure, 0)
    t = np.array([0.2, 0.25])  # just behind the turn at t = 0, where it stood a reach away from the amplitude
    expected = 6.0 * np.abs(np.cos(2 * t) - (1 - STICKING))
    np.testing.assert_allclose(history(contact, Motion(results, 0), t).friction[:, 0], expected, rtol=1e-3)


def test_a_slider_on_a_circle_is_pulled_along_all_the_time():
    """At the radius R and a leash of length r it moves round at the radius sqrt(R2 - r2)."""
    t = np.linspace(0.0, 40.0, 40001)
    z = np.array([np.cos(t), np.sin(t)])[:, :, None]
    positions, moved = follow(z, np.full((t.size, 1), 0.6), np.zeros((2, 1)))
    assert moved.all()
    assert np.hypot(*positions[:, -1, 0]) == pytest.approx(0.8, abs=1e-3)


def test_friction_opens_where_its_normal_load_is_gone(tmp_path):
    law = jenkins().replace("limit = 2.0", "friction_coefficient = 0.5\n   normal_stiffness = 10.0\n   preload = 5.0")
    law = law.replace("dof = 'patch.z'", "dof = 'patch.x'\n   normal_dofs = 'patch.z'")
    moving = {"n4.x": 1.0, "n2.x": 1.0, "n3.x": 0.1, **PATCH}
    results, structure = files(tmp_path, law, moving, "x")
    (contact,) = contacts(results, structure, 0)
    found = summary(contact, Motion(results, 0), results.power_laws(0))
    open_share = [np.arccos(0.5 / 1.0) / np.pi, 0.0, np.arccos(0.5 / 2.0) / np.pi]
    np.testing.assert_allclose(found["open share"], open_share, atol=2 / 256)
    np.testing.assert_allclose(found["largest normal force"], [15.0, 7.5, 25.0], rtol=1e-12)
    np.testing.assert_allclose(found["smallest gap"], [-1.5, -0.75, -2.5], rtol=1e-12)
    past = history(contact, Motion(results, 0), np.linspace(0.0, np.pi, 721))
    n = past.normal_force
    assert (past.friction <= 0.5 * n + 1e-12).all() and ((n == 0.0) == (past.status == OPEN)).all()
    slips = past.status == SLIP
    np.testing.assert_allclose(past.friction[slips], 0.5 * n[slips], rtol=1e-12, atol=1e-12)
    assert (past.friction[past.status == STICK] < 0.5 * n[past.status == STICK] + 1e-12).all()


def test_rigid_laws_are_closed_where_their_force_is(tmp_path):
    """z = min(cos, gap) and a reaction where it is cut, to the sixtieth harmonic; friction that holds for a third of the period."""
    orders = np.arange(61)
    t = 2 * np.pi * np.arange(4096) / 4096
    cut, push = np.minimum(np.cos(t), 0.5), np.maximum(np.cos(t) - 0.5, 0.0) * 7.0
    c = np.array([[np.fft.rfft(x)[:61] * (2 - (orders == 0)) / 4096] for x in (cut, push)])
    pairs = np.stack([c.real, -c.imag], axis=-1)
    wall = Contact("w", "rigid_wall", np.array([0]), np.array([0]), {"gap": 0.5}, [([["n1.z"]], [1.0])])
    write_results(tmp_path / "run.h5", orders[:, None], [[1.0]], pairs[:1], dofs=["n1.z"], law_dofs=["n1.z"], force=pairs[1:])
    found = summary(wall, Motion(Results(tmp_path / "run.h5"), 0), np.zeros(1))
    assert found["open share"][0] == pytest.approx(1 - 1 / 3, abs=0.01)
    assert found["largest normal force"][0] == pytest.approx(3.5, rel=0.01)


def test_elements_side_by_side_slip_one_after_the_other(tmp_path):
    """As many laws of one element each: their forces add up, and one of them slips at least while it does."""
    one = STOP.replace("elastic_stop", "jenkins").replace("   gap = 0.5\n", "   limit = 20.0\n")
    iwan = one.replace("jenkins", "iwan").replace("100.0", "100.0, 30.0").replace("20.0", "20.0, 45.0")
    results, structure = files(tmp_path, iwan, PATCH)
    (contact,) = contacts(results, structure, 0)
    motion = Motion(results, 0)
    times = motion.period * np.linspace(0.0, 1.0, 257)
    found, z = history(contact, motion, times), motion.coordinate(contact, 0, times)
    sliders = []
    for k, limit in ((100.0, 20.0), (30.0, 45.0)):
        longer = motion.coordinate(contact, 0, np.concatenate([times[:-1] - motion.period, times]))
        positions, moved = follow(longer[None], np.full(longer.shape, limit / k), np.zeros((1, 3)))
        sliders.append((k * (z - positions[0, 256:]), moved[256:]))
    np.testing.assert_allclose(found.friction, np.abs(sliders[0][0] + sliders[1][0]), atol=1e-9)
    assert ((found.status == SLIP) == (sliders[0][1] | sliders[1][1])).all()
    assert 0.0 < (found.status[:, 0] == STICK).mean() < 1.0
    left = summary(contact, motion, np.array([3.0, 1.0, 2.0]))
    assert "open share" not in left and left["loss"].tolist() == [3.0, 1.0, 2.0]


BLADES = """&law
   type = 'blade_contact'
   label = 'blades'
   dofs = 'n1.z', 'n2.z', 'n3.z', 'n4.z'
   n_diameters = 3
   n_blades = 5
   gaps = 0.2, 0.3, 0.4, 0.5, 0.6
   contact = 'elastic'
   stiffness = 100.0
   friction_coefficient = 0.25
   shares = 1.0
   frame = 'FRAME'
   tone = 1
/
"""


@pytest.mark.parametrize("frame", ["rotating", "stationary", "own"])
def test_blades_pass_along_a_casing(tmp_path, frame):
    """Gaps from the angles at which blades and casing are; a table of the same numbers gives the same."""
    amplitudes = {"n1.z": 0.3, "n2.z": -0.5, "n3.z": 0.4, "n4.z": -0.2}
    results, structure = files(tmp_path, BLADES.replace("FRAME", frame), amplitudes, laws=["blades"], power=[1.0])
    (contact,) = contacts(results, structure, 0)
    motion = Motion(results, 0)
    times = np.linspace(0.0, motion.period, 41)
    found = history(contact, motion, times)
    phi, tau = 2 * np.pi * np.arange(1, 6) / 5, 2.0 * times[:, None]
    q = np.outer(np.cos(2.0 * times), list(amplitudes.values())).T[:, :, None]
    disk, casing = phi + tau * (frame == "stationary"), phi + tau * (frame != "rotating")
    gap = np.linspace(0.2, 0.6, 5) + q[2] * np.cos(3 * casing) + q[3] * np.sin(3 * casing)
    gap = gap - q[0] * np.cos(3 * disk) - q[1] * np.sin(3 * disk)
    np.testing.assert_allclose(found.gap, gap, atol=1e-12)
    np.testing.assert_allclose(found.friction, 25.0 * np.maximum(-gap, 0.0), atol=1e-10)
    assert ((found.status == SLIP) == (gap < 0)).all() and 0 < (gap < 0).sum() < gap.size
    results.close()
    cosine, sine = np.cos(3 * phi), np.sin(3 * phi)
    shapes = ", ".join(map(repr, np.column_stack([-cosine, -sine, cosine, sine]).ravel().tolist()))
    table = BLADES.replace("blade_contact", "contact_table").replace("n_blades", "n_contacts")
    table = table.replace("frame = 'FRAME'", f"shapes = {shapes}")
    if frame == "rotating":
        table = table.replace("tone = 1", "tone = 0")
    else:
        table = table.replace("tone = 1", f"tone = 1\n   turns = {3 * (frame == 'stationary')}, 3")
    results, structure = files(tmp_path, table, amplitudes, laws=["blades"], power=[1.0])
    (contact,) = contacts(results, structure, 0)
    np.testing.assert_allclose(history(contact, Motion(results, 0), times).gap, gap, atol=1e-12)


@pytest.mark.long
def test_contacts_without_nodes_have_pictures_and_no_fields(tmp_path, capsys):
    pytest.importorskip("meshio")
    amplitudes = {"n1.z": 0.3, "n2.z": -0.5, "n3.z": 0.4, "n4.z": -0.2}
    files(tmp_path, BLADES.replace("FRAME", "own"), amplitudes, laws=["blades"], power=[1.0])[0].close()
    words = (tmp_path / "run.h5", "--model", tmp_path / "model.h5")
    assert "blades, 5 contacts: open share" in run(capsys, "contact", *words, "--dpi", 40)[1]
    assert run(capsys, "contact", *words, "--dpi", 40, "--view", "time")[0] == 0
    status, out, _ = run(capsys, "vtk", *words, "--frames", 2)
    assert status == 0 and "'blades': the contacts of blade_contact stand at no node, and in no file" in out
    rigid = BLADES.replace("FRAME", "own").replace("elastic", "rigid")
    files(tmp_path, rigid, amplitudes, laws=["blades"], power=[1.0])[0].close()
    assert "blade_contact, contact_table that are not rigid" in run(capsys, "contact", *words)[2]


def test_files_and_pictures(tmp_path, capsys):
    meshio = pytest.importorskip("meshio")
    results, _ = files(tmp_path, STOP, PATCH)
    results.close()
    words = (tmp_path / "run.h5", "--model", tmp_path / "model.h5")
    for view in ("patch", "time"):
        status, out, _ = run(capsys, "contact", *words, "--view", view, "--dpi", 40)
        assert status == 0 and ("stop, 3 nodes: open share " in out) == (view == "patch")
        assert (tmp_path / f"run_contact_{view}.png").stat().st_size > 3000
    assert run(capsys, "vtk", *words, "--frames", 4)[0] == 0
    mesh = meshio.read(tmp_path / "run_harmonics.vtu")
    np.testing.assert_allclose(mesh.point_data["smallest gap stop"], [np.nan, 0.25, -1.5, -0.5], rtol=1e-12)
    frames = [meshio.read(tmp_path / "run_motion" / f"000{i}.vtu").point_data for i in range(4)]
    for frame, expected in zip(frames, ([-1, OPEN, STICK, STICK], [-1, 0, 0, 0], [-1, 0, 0, 0], [-1, 0, 0, 0])):
        assert frame["status stop"].tolist() == expected
    np.testing.assert_allclose(frames[0]["normal_force stop"], [np.nan, 0.0, 150.0, 50.0], rtol=1e-12)
    np.testing.assert_allclose(frames[2]["gap stop"], [np.nan, 0.75, 2.5, 1.5], rtol=1e-12)


def test_what_cannot_be_drawn_is_reported(tmp_path, capsys):
    results, _ = files(tmp_path, STOP, PATCH)
    results.close()
    words = ("contact", tmp_path / "run.h5", "--model", tmp_path / "model.h5")
    assert "no contact 'joint'; there are stop" in run(capsys, *words, "--law", "joint")[2]
    assert "the motion must end after it begins" in run(capsys, *words, "--view", "time", "--to", "-1")[2]
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        file["law"][...] = [b"a", b"b", b"c"]
    assert "law 'stop' of its input is not that of" in run(capsys, *words)[2]
    files(tmp_path, STOP.replace("elastic_stop", "cubic_spring"), PATCH)[0].close()
    assert "no law of the result is a contact that can be drawn" in run(capsys, *words)[2]
    files(tmp_path, STOP.replace("patch", "other"), PATCH)[0].close()
    assert "no degree of freedom and no set 'other.z'" in run(capsys, *words)[2]


def test_groups_of_the_complete_input():
    text = "&law\n   type = 'a'\n   gaps = 1.0, 3*2.0,\n      4.0\n   label = 'it''s, /'\n/\n"
    text += "&output\n   title = 'x'\n/\n&law\n   type = 'b'\n/\n"
    first, second = groups(text, "law")
    assert first == {"type": ["a"], "gaps": ["1.0", "2.0", "2.0", "2.0", "4.0"], "label": ["it's, /"]} and second == {"type": ["b"]}
