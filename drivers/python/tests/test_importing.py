"""The same chain from each format, and lines that are wrong."""

import re

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from nhbm import Model, ModelError, importing
from nhbm.command import main

DIGITS = "{:d} {:d} {:.17g}\n"


def lower(matrix):
    part = sp.tril(matrix).tocoo()
    return zip(part.row + 1, part.col + 1, part.data)


def assert_same(model, chain):
    assert model.labels == chain.labels
    assert abs(model.mass - chain.mass).max() == 0.0
    assert abs(model.stiffness - chain.stiffness).max() == 0.0


@pytest.mark.parametrize("end", [".mtx", ".npz"])
def test_matrix_market_and_npz(chain, tmp_path, end):
    for name in ("mass", "stiffness"):
        matrix = getattr(chain, name)
        if end == ".npz":
            sp.save_npz(tmp_path / name, matrix)
        else:
            scipy.io.mmwrite(tmp_path / name, matrix, precision=17)
    (tmp_path / "labels").write_text("\n".join(chain.labels))
    arguments = [f"--{name}={tmp_path / name}{end}" for name in ("mass", "stiffness")]
    out = tmp_path / "out.h5"
    more = [f"--labels={tmp_path / 'labels'}", "--set=contact=5,2", "--load=push=n1.z:1,n12.z:-0.5", "-o", str(out)]
    assert main(["import", *arguments, *more]) == 0
    model = Model.read(out)
    assert_same(model, chain)
    assert model.dofs_of("contact.z") == chain.dofs_of("contact.z")
    np.testing.assert_array_equal(model.loads["push"], chain.loads["push"])


def test_calculix(chain, tmp_path):
    for end, matrix in ((".sti", chain.stiffness), (".mas", chain.mass)):
        (tmp_path / f"job{end}").write_text("".join(DIGITS.format(*entry) for entry in lower(matrix)))
    (tmp_path / "job.dof").write_text("".join(f"{i}.3\n" for i in range(1, 13)))
    assert_same(importing.from_calculix(tmp_path / "job.inp"), chain)


def test_abaqus(chain, tmp_path):
    for name in ("mass", "stiffness"):
        lines = [f"{i:d},3, {j:d},3, {v:.17g}\n" for i, j, v in lower(getattr(chain, name))]
        (tmp_path / f"{name}.mtx").write_text("** matrix\n" + "".join(lines))
    paths = {name: tmp_path / f"{name}.mtx" for name in ("mass", "stiffness")}
    assert_same(importing.from_abaqus(paths), chain)


def test_nastran(chain, tmp_path):
    pytest.importorskip("pyNastran")
    lines = []
    for card, matrix in (("KAAX", chain.stiffness), ("MAAX", chain.mass)):
        lines.append(f"DMIG,{card},0,6,2,0\n")
        lines += [f"DMIG*   {card:<16}{j:>16d}{3:>16d}                *\n*       {i:>16d}{3:>16d}{v:>16.9E}\n"
                  for i, j, v in lower(matrix)]  # fmt: skip
    (tmp_path / "matrices.pch").write_text("".join(lines))
    model = importing.from_nastran(tmp_path / "matrices.pch", {"mass": "MAAX", "stiffness": "KAAX"})
    assert model.labels == chain.labels
    assert abs(model.mass - chain.mass).max() < 1e-9
    assert abs(model.stiffness - chain.stiffness).max() < 1e-9


K_AND_M = "DMIG,KAAX,0,6,2,0\nDMIG,KAAX,1,3,,1,3,2.\nDMIG,MAAX,0,6,2,0\nDMIG,MAAX,1,3,,1,3,4.\n"


def nastran(tmp_path, text, stiffness="KAAX"):
    (tmp_path / "bulk.bdf").write_text(text)
    return importing.from_nastran(tmp_path / "bulk.bdf", {"mass": "MAAX", "stiffness": stiffness})


def test_nastran_with_its_other_decks(tmp_path):
    pytest.importorskip("pyNastran")
    model = nastran(tmp_path, f"SOL 103\nCEND\nBEGIN BULK\nGRID,1,,0.,0.,0.\n{K_AND_M}ENDDATA\n")
    assert model.labels == ["n1.z"] and model.stiffness[0, 0] == 2.0 and model.mass[0, 0] == 4.0


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("0,6,2,0\nDMIG,KAAX,1,3,,1,3,2.", "0,6,4,0\nDMIG,KAAX,1,3,,1,3,2.,1.", "DMIG 'KAAX' is complex"),
        ("KAAX,0,6,2,0", "KAAX,0,9,2,0,,,1", "DMIG 'KAAX' has the form 9"),
        ("1,3,,1,3,2.", "1,3,,1,3,", "is no bulk data that pyNastran reads"),
        ("DMIG,KAAX,0,6,2,0\n", "hello world\n1 2 3\n", "is no bulk data that pyNastran reads"),
        ("KAAX", "KX", "has no DMIG 'KAAX'; it has KX, MAAX"),
    ],
)
def test_nastran_that_is_not_right_is_named(tmp_path, capsys, old, new, message):
    pytest.importorskip("pyNastran")
    with pytest.raises(ModelError, match=re.escape(message)) as raised:
        nastran(tmp_path, K_AND_M.replace(old, new))
    assert "\n" not in str(raised.value) and capsys.readouterr().out == ""


def test_mesh_gives_places_cells_and_sets(chain, tmp_path):
    nodes = "".join(f"{10 * i}, {i}.0, 0.5, 0.0\n" for i in range(1, 4))
    (tmp_path / "mesh.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=T3D2\n1, 10, 20\n2, 20, 30\n*NSET, NSET=TIP\n30\n")
    model = Model(mass=sp.identity(2), stiffness=sp.identity(2), **importing.places_of(["n30.z", "n20.z"]))
    importing.add_mesh(model, tmp_path / "mesh.inp")
    assert model.node_numbers.tolist() == [10, 20, 30]
    assert model.coordinates[model.dof_node].tolist() == [[3.0, 0.5, 0.0], [2.0, 0.5, 0.0]]
    assert model.dofs_of("tip.z") == [0]
    assert model.cell_types.tolist() == [3, 3] and model.cell_nodes.tolist() == [0, 1, 1, 2]


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("job.dof", "1.3\nx.3\n", "'x.3' is no node and direction"),
        ("job.sti", "1 1 2.0\n1 2\n", "line 2 has 2 numbers, expected 3"),
        ("job.sti", "1 1 2.0\n1 two 3\n", "line 2: '1 two 3' are no numbers"),
        ("job.sti", "9 1 2.0\n", "has an entry in row 9, column 1 of 2"),
        ("job.mas", None, "does not exist"),
    ],
)
def test_wrong_lines_are_named(tmp_path, name, text, message):
    files = {"job.dof": "1.3\n2.3\n", "job.sti": "1 1 2.0\n2 2 1.0\n", "job.mas": "1 1 1.0\n2 2 1.0\n", name: text}
    for file, content in files.items():
        if content is not None:
            (tmp_path / file).write_text(content)
    with pytest.raises(ModelError, match=message):
        importing.from_calculix(tmp_path / "job")
