"""CalculiX itself: its eigenfrequencies and those of its matrices as we import them, to the digits that it prints."""

import gzip
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator, eigs, splu

from nhbm import ModelError, cyclic, importing, meshes
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
    meshes.add_mesh(model, tmp_path / "matrices.inp")
    assert len(model.dofs_of("tip.z")) == len(block.sets["right"])
    ours = np.sqrt(lowest_modes(model.stiffness, model.mass, 6)[0])
    np.testing.assert_allclose(ours, printed, rtol=1e-6)  # seven digits are printed

    # and the same block as scikit-fem makes it: the same elements, integrated with another number of points
    np.testing.assert_allclose(np.sqrt(lowest_modes(block.stiffness, block.mass, 6)[0]), printed, rtol=1e-3)

N = 24


def write_sector(path, step):
    """A sector of a ring of bricks, held inside; its sides for CalculiX are without the nodes that are held."""
    r, t, z = np.linspace(0.1, 0.2, 4), np.linspace(-np.pi / N, np.pi / N, 4), (0.0, 0.02)
    at = {(i, j, k): 1 + 7 * n for n, (i, j, k) in enumerate(np.ndindex(4, 4, 2))}
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, {r[i] * np.cos(t[j]):.12g}, {r[i] * np.sin(t[j]):.12g}, {z[k]}" for (i, j, k), n in at.items()]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=BODY")
    for e, (i, j) in enumerate(np.ndindex(3, 3), start=1):
        corners = [at[i + a, j + b, k] for k in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines.append(f"{e}, " + ", ".join(map(str, corners)))
    for name, chosen in (
        ("HUB", lambda i, j: i == 0),
        ("LEFT", lambda i, j: j == 0),
        ("RIGHT", lambda i, j: j == 3),
        ("LOWER", lambda i, j: j == 0 and i > 0),
        ("UPPER", lambda i, j: j == 3 and i > 0),
    ):
        lines += [f"*NSET, NSET={name}", *(f"{n}," for (i, j, _), n in at.items() if chosen(i, j))]
    lines.append("*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1E11, 0.3\n*DENSITY\n7850.0")
    lines.append("*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL")
    path.write_text("\n".join([*lines, step, ""]))


CYCLIC = f"""*SURFACE, NAME=S1, TYPE=NODE
LOWER
*SURFACE, NAME=S2, TYPE=NODE
UPPER
*TIE, CYCLIC SYMMETRY, NAME=T1, POSITION TOLERANCE=1e-4
S1, S2
*CYCLIC SYMMETRY MODEL, N={N}, NGRAPH=1, TIE=T1
0., 0., 0., 0., 0., 1.
*BOUNDARY
HUB, 1, 3
*STEP
*FREQUENCY
4
*SELECT CYCLIC SYMMETRY MODES, NMIN=0, NMAX=4
*END STEP"""


def test_nodal_diameters_agree_with_calculix(tmp_path):
    write_sector(tmp_path / "cyclic.inp", CYCLIC)
    output = run(tmp_path, "cyclic")
    row = r"^\s+(\d+)\s+\d+\s+\S+E\S+\s+(\S+E\S+)\s+\S+E\S+\s+\S+E\S+\s*$"
    rows = re.findall(row, (tmp_path / "cyclic.dat").read_text(), re.MULTILINE)
    assert len(rows) == 20, output
    write_sector(tmp_path / "matrices.inp", "*BOUNDARY\nHUB, 1, 3\n*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n6\n*END STEP")
    run(tmp_path, "matrices")
    model = importing.from_calculix(tmp_path / "matrices")
    meshes.add_mesh(model, tmp_path / "matrices.inp")
    sector = cyclic.sector_of(model, N, "left", "right")
    for diameter in range(5):
        printed = [float(frequency) for number, frequency in rows if int(number) == diameter]
        ours = cyclic.frequencies(sector, diameter, 2)
        np.testing.assert_allclose(np.repeat(ours, 2), printed, rtol=1e-6)  # seven digits are printed


EXAMPLES = Path("/usr/share/doc/calculix-ccx-test/examples/test")  # of the Debian package calculix-ccx-test
DIGITS = 1e-13  # of the numbers in .sti and .mas, relative


def text_of(path):
    opened = gzip.open if path.suffix == ".gz" else open
    with opened(path, "rt", errors="replace") as file:
        return file.read()


def modal_decks():
    """Examples with a modal step whose elements are solids, springs, dashpots and masses."""
    found = []
    for path in sorted([*EXAMPLES.glob("*.inp"), *EXAMPLES.glob("*.inp.gz")]):
        text = re.sub(r"^\*\*.*\n", "", text_of(path).upper(), flags=re.MULTILINE)
        kinds = set(re.findall(r"^\*ELEMENT.*?TYPE\s*=\s*(\w+)", text, re.MULTILINE))
        if re.search(r"^\*FREQUENCY", text, re.MULTILINE) and all(re.match("C3D|SPRING|DASHPOT|MASS", kind) for kind in kinds):
            found.append(path)
    return found


def frequencies_printed(path):
    """Of each modal step, those above zero [rad/s]."""
    parts = path.read_text().split("E I G E N V A L U E   O U T P U T")[1:]
    tables = [part.split("P A R T I C I P A T I O N")[0] for part in parts]
    row = r"^ +\d+((?: +-?\d\.\d+E[+-]\d+){3,4}) *$"
    found = [[float(line.split()[-3]) for line in re.findall(row, table, re.MULTILINE)] for table in tables]
    return [np.array([value for value in values if value > 0]) for values in found]


@pytest.mark.long
@pytest.mark.skipif(not EXAMPLES.is_dir(), reason="the examples of CalculiX (calculix-ccx-test) are not installed")
@pytest.mark.parametrize("path", modal_decks(), ids=lambda path: path.name.split(".")[0])
def test_examples_of_calculix(path, tmp_path):
    """The lowest frequency is that of CalculiX's modal step, to its seven digits and what the digits of .sti leave of it; a cyclic
    sector, whose matrices are those of one nodal diameter, is refused for that."""
    text = text_of(path)
    for name in re.findall(r"INPUT\s*=\s*([^\s,]+)", text, re.IGNORECASE):
        for other in EXAMPLES.glob(f"{name}*"):
            (tmp_path / name).write_text(text_of(other))
    (tmp_path / "modes.inp").write_text(text)
    stored = re.sub(r"(?mi)^\*FREQUENCY.*", "*FREQUENCY, SOLVER=MATRIXSTORAGE", text)
    (tmp_path / "matrices.inp").write_text(stored)
    run(tmp_path, "matrices")
    if re.search(r"(?mi)^\*CYCLIC SYMMETRY MODEL", text):
        with pytest.raises(ModelError, match=r"CYCLIC SYMMETRY MODEL there are twice as many rows"):
            importing.from_calculix(tmp_path / "matrices")
        return
    run(tmp_path, "modes")
    printed = frequencies_printed(tmp_path / "modes.dat")
    model = importing.from_calculix(tmp_path / "matrices")
    meshes.add_mesh(model, tmp_path / "matrices.inp")
    assert np.isfinite(model.coordinates[model.dof_node]).any() and len(model.cell_types) > 0
    stiffness, mass = model.stiffness.tocsc(), model.mass.tocsc()
    shift = 1e-10 * abs(stiffness.diagonal()).max() / abs(mass.diagonal()).max()
    factors = splu((stiffness + shift * mass).tocsc())
    values, vectors = eigs(LinearOperator(stiffness.shape, matvec=lambda x: factors.solve(mass @ x)), min(6, model.n_dofs - 2))
    squares = (1 / values - shift).real  # the mass of C3D20R is semi-definite
    lowest = min((k for k in range(len(squares)) if squares[k] > 0), key=lambda k: squares[k])
    shape = abs(vectors[:, lowest].real)
    spread = DIGITS * (shape @ abs(stiffness) @ shape) / abs(vectors[:, lowest].real @ mass @ vectors[:, lowest].real)
    ours = np.sqrt(squares[lowest])
    assert min(abs(ours - step[0]) for step in printed) < 1e-6 * ours + 0.5 * spread / ours
