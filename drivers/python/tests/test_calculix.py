"""CalculiX itself: its eigenfrequencies and those of its matrices as we import them, to the digits that it prints."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from nhbm import importing
from nhbm.factors import lowest_modes

pytestmark = pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")


def write_input(path, model, solver):
    """The block clamped at x = 0 as an input of CalculiX; its nodes are those of the model."""
    with open(path, "w") as file:
        file.write("*NODE, NSET=ALL\n")
        for number, point in zip(model.node_numbers, model.coordinates):
            file.write(f"{number}, " + ", ".join(f"{x:.12g}" for x in point) + "\n")
        file.write("*ELEMENT, TYPE=C3D10, ELSET=BLOCK\n")
        for i, cell in enumerate(model.cell_nodes.reshape(-1, 10)):
            file.write(f"{i + 1}, " + ", ".join(str(model.node_numbers[node]) for node in cell) + "\n")
        held = model.node_numbers[np.isclose(model.coordinates[:, 0], 0.0)]
        file.write("*NSET, NSET=HELD\n" + ",\n".join(map(str, held)) + "\n")
        tip = model.node_numbers[model.sets["right"]]
        file.write("*NSET, NSET=TIP\n" + ",\n".join(map(str, tip)) + "\n")
        file.write("*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1E11, 0.3\n*DENSITY\n7850.0\n")
        file.write("*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n*BOUNDARY\nHELD, 1, 3\n")
        file.write(f"*STEP\n*FREQUENCY{solver}\n6\n*END STEP\n")


def run(folder, job):
    done = subprocess.run(["ccx", "-i", job], cwd=folder, capture_output=True, text=True, timeout=120)
    return done.stdout


def test_frequencies_agree_with_calculix(block, tmp_path):
    write_input(tmp_path / "modes.inp", block, "")
    output = run(tmp_path, "modes")
    rows = re.findall(r"^\s+\d+\s+(\S+)\s+(\S+)\s+(\S+)\s+\S+\s*$", (tmp_path / "modes.dat").read_text(), re.MULTILINE)
    printed = np.array([float(row[1]) for row in rows[:6]])
    assert len(printed) == 6, output

    write_input(tmp_path / "matrices.inp", block, ", SOLVER=MATRIXSTORAGE")
    run(tmp_path, "matrices")
    model = importing.from_calculix(tmp_path / "matrices")
    importing.add_mesh(model, tmp_path / "matrices.inp")
    assert len(model.dofs_of("tip.z")) == len(block.sets["right"])
    ours = np.sqrt(lowest_modes(model.stiffness, model.mass, 6)[0])
    np.testing.assert_allclose(ours, printed, rtol=1e-6)  # seven digits are printed

    # and the same block as scikit-fem makes it: the same elements, integrated with another number of points
    np.testing.assert_allclose(np.sqrt(lowest_modes(block.stiffness, block.mass, 6)[0]), printed, rtol=1e-3)
