"""Examples against closed forms."""

import numpy as np
import pytest
import scipy.linalg

from nhbm import ModelError, cyclic, examples
from nhbm.command import main

pytest.importorskip("skfem")


def lowest(model, n):
    return np.sqrt(scipy.linalg.eigh(model.stiffness.toarray(), model.mass.toarray(), eigvals_only=True)[:n])


def test_cantilever():
    found = lowest(examples.beam(length=2.0, n_elements=12, width=0.05, height=0.02), 3)
    wave = np.sqrt(2.1e11 * 0.05 * 0.02**3 / 12 / (7850.0 * 0.05 * 0.02))
    exact = wave * (np.array([1.8751040687, 4.6940911330, 7.8547574382]) / 2.0) ** 2
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    assert abs(found[0] / exact[0] - 1.0) < 1e-6


def test_supported_plate():
    a, b, h = 0.4, 0.3, 0.004
    found = lowest(examples.plate(a, b, h, 8, 6, edges="supported"), 4)
    wave = np.sqrt(2.1e11 * h**2 / (12 * (1 - 0.09) * 7850.0))
    exact = sorted(wave * np.pi**2 * ((m / a) ** 2 + (n / b) ** 2) for m in range(1, 5) for n in range(1, 5))[:4]
    np.testing.assert_allclose(found, exact, rtol=1e-3)


def test_block_stretches_and_weighs_what_it_should():
    block = examples.solid(0.3, 0.02, 0.02, 12, 1, 1)
    along = np.array([d == "x" for d in block.dof_direction], dtype=float)
    total = examples.solid(0.3, 0.02, 0.02, 12, 1, 1, clamped="none")
    ones = np.array([d == "x" for d in total.dof_direction], dtype=float)
    assert ones @ total.mass @ ones == pytest.approx(7850.0 * 0.3 * 0.02**2, rel=1e-12)
    values, shapes = scipy.linalg.eigh(block.stiffness.toarray(), block.mass.toarray())
    share = (along @ block.mass.toarray() @ shapes) ** 2
    rod = np.pi / 2 / 0.3 * np.sqrt(2.1e11 / 7850.0)
    assert np.sqrt(values[np.argmax(share)]) == pytest.approx(rod, rel=1e-2)


def test_middle_nodes_stand_in_the_order_of_vtk():
    block = examples.solid(n_x=2, n_y=1, n_z=1)
    for cell in block.cell_nodes.reshape(-1, 10)[:5]:
        points = block.coordinates[cell]
        for k, (a, b) in enumerate([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]):
            np.testing.assert_allclose(points[4 + k], (points[a] + points[b]) / 2)
        assert np.linalg.det(points[1:4] - points[0]) > 0


@pytest.mark.parametrize("diameter", [2, 3])
def test_a_thin_ring_bends_in_its_plane(diameter):
    """Waves of a free ring (Hoppe 1871), to the share of thickness and width that the closed form leaves out."""
    radius, thickness = 0.25, 0.004
    sector = examples.ring(36, radius - thickness / 2, radius + thickness / 2, 0.004)
    found = cyclic.frequencies(cyclic.sector_of(sector, 36, "low", "high"), diameter, 2)
    n = diameter
    wave = np.sqrt(2.1e11 * thickness**2 / 12 / (7850.0 * radius**4)) * n * (n**2 - 1) / np.sqrt(n**2 + 1)
    assert np.abs(found / wave - 1.0).min() < 5e-3
    assert len(sector.sets["inside"]) == 1 and sector.coordinates[sector.sets["inside"][0]] == pytest.approx([0.248, 0, 0.002])


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ModelError, match="height must be above 0"):
        examples.solid(height=-1.0)


WITHOUT_ELEMENTS = ["plate --n-x 0", "beam --n-elements 0", "solid --n-z -1", "sector --n-sectors 2", "ring --outer 0.1"]


@pytest.mark.parametrize("words", [*WITHOUT_ELEMENTS, "sector --clamped tip"])
def test_sizes_without_elements_are_refused(words, tmp_path, capsys):
    assert main([*words.split(), "-o", str(tmp_path / "x.h5")]) == 2
    assert capsys.readouterr().err.startswith("nhbm-model: ") and not (tmp_path / "x.h5").exists()


def test_a_file_that_stands_in_the_way_is_reported_before_the_work(tmp_path, capsys, monkeypatch):
    path = tmp_path / "x.h5"
    path.write_text("mine")
    monkeypatch.setattr("nhbm.command.run_example", lambda options: pytest.fail("work was done"))
    for where, message in ((path, "exists; --overwrite"), (tmp_path, "is a folder"), (tmp_path / "a" / "b", "there is no folder")):
        assert main(["beam", "-o", str(where)]) == 2 and message in capsys.readouterr().err
