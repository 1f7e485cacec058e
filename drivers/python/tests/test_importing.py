"""The same chain from each format, and files that are wrong."""

import bz2
import gzip
import io
import re

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from nhbm import ModelError, Structure, importing, meshes
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
    model = Structure.read(out)
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


def test_abaqus_in_its_own_order(chain, tmp_path):
    """One entry of each pair, in the order of Abaqus' equations, which is not that of the nodes; constrained nodes have 1e36."""
    for name in ("mass", "stiffness"):
        matrix = getattr(chain, name)
        lines = [(i, j, v) if (i + j) % 3 else (j, i, v) for i, j, v in lower(matrix)]
        if name == "stiffness":
            lines += [(99, 99, 1e36), (99, lines[0][0], -5.0)]
        else:
            lines.append((99, 99, 1.0))
        (tmp_path / f"{name}.mtx").write_text("".join(f"{i:d},3, {j:d},3, {v:.17g}\n" for i, j, v in lines))
    assert_same(importing.from_abaqus({name: tmp_path / f"{name}.mtx" for name in ("mass", "stiffness")}), chain)


def test_nastran(chain, tmp_path):
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
    model = nastran(tmp_path, f"SOL 103\nCEND\nBEGIN BULK\nGRID,1,,0.,0.,0.\n{K_AND_M}ENDDATA\n")
    assert model.labels == ["n1.z"] and model.stiffness[0, 0] == 2.0 and model.mass[0, 0] == 4.0


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("0,6,2,0\nDMIG,KAAX,1,3,,1,3,2.", "0,6,4,0\nDMIG,KAAX,1,3,,1,3,2.,1.", "DMIG 'KAAX' is complex"),
        ("KAAX,0,6,2,0", "KAAX,0,9,2,0,,,1", "DMIG 'KAAX' has the form 9"),
        ("1,3,,1,3,2.", "1,3,,1,3,", "DMIG: field 8 is '', not a number"),
        ("1,3,,1,3,2.", "1,3,,1,9,2.", "DMIG: 1, 9 is not a point from 1 with a component from 0 to 6"),
        ("1,3,,1,3,2.", "1,3,,,3,2.", "a term has no grid point"),
        ("1,3,,1,3,2.", "1,3,,1,3,2.,\n,1,3,2.", "'KAAX' has the term of 1, 3 and 1, 3 twice"),
        ("1,3,,1,3,2.", "1,3,,1,3,2..", "DMIG: field 8 is '2..', not a number"),
        ("DMIG,KAAX,0,6,2,0\n", "", "DMIG: a column of 'KAAX', which has no line with its form before it"),
        ("DMIG,KAAX,0,6,2,0\n", "1 2 3\n", "line 1: '1 2 3' continues no entry"),
        ("KAAX", "KX", "has no DMIG 'KAAX'; it has KX, MAAX"),
    ],
)
def test_nastran_that_is_not_right_is_named(tmp_path, capsys, old, new, message):
    with pytest.raises(ModelError, match=re.escape(message)) as raised:
        nastran(tmp_path, K_AND_M.replace(old, new))
    assert "\n" not in str(raised.value) and capsys.readouterr().out == ""


GMSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
0 3 "Tip"
1 1 "wire"
$EndPhysicalNames
$Nodes
3
1 0 0 0
2 1 0 0
3 2 0 0
$EndNodes
$Elements
3
1 1 2 1 1 1 2
2 1 2 1 1 2 3
3 15 2 3 3 3
$EndElements
"""


def test_physical_groups_of_gmsh_are_sets(tmp_path):
    (tmp_path / "wire.msh").write_text(GMSH)
    unit = sp.identity(3)
    model = Structure(mass=unit, stiffness=unit, **importing.nodes_of_labels(["n1.z", "n2.z", "n3.z"]))
    meshes.add_mesh(model, tmp_path / "wire.msh")
    assert {name: nodes.tolist() for name, nodes in model.sets.items()} == {"tip": [2], "wire": [0, 1, 2]}
    assert model.dofs_of("tip.z") == [2]
    nameless = Structure(mass=unit, stiffness=unit, labels=["x1", "x2", "x3"])
    with pytest.raises(ModelError, match="no degree of freedom stands at a node of .*wire.msh': --labels gives"):
        meshes.add_mesh(nameless, tmp_path / "wire.msh")


def test_groups_of_med_are_sets(tmp_path):
    """Salome and code_aster give nodes and elements a family, and a family the names of its groups."""
    meshio = pytest.importorskip("meshio")
    points = np.array([[float(i), 0.0, 0.0] for i in range(4)])
    mesh = meshio.Mesh(points, [("line", [[0, 1], [1, 2], [2, 3]])])
    mesh.point_data["point_tags"] = np.array([0, 2, 2, 3])
    mesh.cell_data["cell_tags"] = [np.array([-6, -7, -7])]
    mesh.point_tags = {2: ["Middle"], 3: ["End", "Held"]}
    mesh.cell_tags = {-6: ["first"], -7: ["rest", "Held"]}
    mesh.write(tmp_path / "wire.med")
    model = Structure(mass=sp.identity(4), stiffness=sp.identity(4), **importing.nodes_of_labels([f"n{i}.z" for i in (1, 2, 3, 4)]))
    meshes.add_mesh(model, tmp_path / "wire.med", in_order=True)
    assert {name: nodes.tolist() for name, nodes in model.sets.items()} == {
        "middle": [1, 2], "end": [3], "held": [3], "first": [0, 1], "rest": [1, 2, 3]}  # fmt: skip


def test_mesh_gives_points_cells_and_sets(chain, tmp_path):
    nodes = "".join(f"{10 * i}, {i}.0, 0.5, 0.0\n" for i in range(1, 4))
    (tmp_path / "mesh.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=T3D2\n1, 10, 20\n2, 20, 30\n*NSET, NSET=TIP\n30\n")
    model = Structure(mass=sp.identity(2), stiffness=sp.identity(2), **importing.nodes_of_labels(["n30.z", "n20.z"]))
    meshes.add_mesh(model, tmp_path / "mesh.inp")
    assert model.node_numbers.tolist() == [10, 20, 30]
    assert model.coordinates[model.dof_node].tolist() == [[3.0, 0.5, 0.0], [2.0, 0.5, 0.0]]
    assert model.dofs_of("tip.z") == [0]
    assert model.cell_types.tolist() == [3, 3] and model.cell_nodes.tolist() == [0, 1, 1, 2]


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("job.dof", "1.3\nx.3\n", "'x.3' is not a node and direction"),
        ("job.sti", "1 1 2.0\n1 2\n", "line 2 has 2 numbers, expected 3"),
        ("job.sti", "1 1 2.0\n1 two 3\n", "line 2: '1 two 3' are no numbers"),
        ("job.sti", "9 1 2.0\n", "has an entry in row 9, column 1 of 2"),
        ("job.mas", None, "does not exist"),
        ("job.sti", "1 1 2.0\n", "job.sti' is not whole: row 2 of 2 is without its diagonal"),
        ("job.mas", "1 1 2.0\n2 2 1.", "job.mas' is not whole: its last line has no end"),
    ],
)
def test_wrong_lines_are_named(tmp_path, name, text, message):
    files = {"job.dof": "1.3\n2.3\n", "job.sti": "1 1 2.0\n2 2 1.0\n", "job.mas": "1 1 1.0\n2 2 1.0\n", name: text}
    for file, content in files.items():
        if content is not None:
            (tmp_path / file).write_text(content)
    with pytest.raises(ModelError, match=message):
        importing.from_calculix(tmp_path / "job")


HEAD = "%%MatrixMarket matrix coordinate real general\n"
SOUND = HEAD + "2 2 2\n1 1 1.0\n2 2 2.0\n"
CSR = {"format": b"csr", "shape": [2, 2], "data": [1.0, 2.0], "indices": [0, 1], "indptr": [0, 1, 2]}


def npz(**change):
    file = io.BytesIO()
    np.savez(file, **(CSR | change))
    return file.getvalue()


MATRIX_MARKET = ["--mass=sound.mtx", "--stiffness=bad.mtx"]
NPZ = ["--mass=sound.npz", "--stiffness=bad.npz"]
NPY = ["--mass=sound.npz", "--stiffness=bad.npy"]
CALCULIX = ["--calculix=job"]
ABAQUS = ["--abaqus", "--mass=abaqus.mtx", "--stiffness=bad.mtx"]
LABELS = ["--mass=sound.mtx", "--stiffness=sound.mtx", "--labels=labels"]
MESH = ["--mass=sound.mtx", "--stiffness=sound.mtx", "--labels=nodes"]
ALWAYS = {
    "sound.mtx": SOUND,
    "sound.npz": npz(),
    "abaqus.mtx": "1,3,1,3,1.0\n2,3,2,3,1.0\n",
    "job.dof": "1.3\n2.3\n",
    "job.sti": "1 1 2.0\n2 2 1.0\n",
    "job.mas": "1 1 1.0\n2 2 1.0\n",
    "nodes": "n1.z n2.z",
}


@pytest.mark.parametrize(
    "options, name, content, message",
    [
        (MATRIX_MARKET, "bad.mtx", "", "holds no sparse matrix"),
        (MATRIX_MARKET, "bad.mtx", "hello\n", "holds no sparse matrix"),
        (MATRIX_MARKET, "bad.mtx", SOUND[: SOUND.rindex("2 2")], "holds no sparse matrix"),
        (MATRIX_MARKET, "bad.mtx", SOUND.replace("2.0", "nan"), "the entry in row 2, column 2 is not a finite number"),
        (MATRIX_MARKET, "bad.mtx", SOUND.replace("2 2 2.0", "3 2 2.0"), "ow index"),
        (MATRIX_MARKET, "bad.mtx", HEAD + "2 3 1\n1 1 1.0\n", "the matrix is 2 x 3, not square"),
        (MATRIX_MARKET, "bad.mtx", HEAD + "3 3 1\n1 1 1.0\n", "matrix 'stiffness' has 3 rows, there are 2 labels"),
        (MATRIX_MARKET, "bad.mtx", HEAD + "0 0 0\n", "the matrix is 0 x 0, not square"),
        (MATRIX_MARKET, "bad.mtx", HEAD + "99999999999 99999999999 1\n1 1 1.0\n", "holds no sparse matrix"),
        (MATRIX_MARKET, "bad.mtx", HEAD.replace("real", "complex") + "2 2 1\n1 1 1.0 2.0\n", "the matrix is complex, not real"),
        (NPZ, "bad.npz", "", "holds no sparse matrix"),
        (NPZ, "bad.npz", "hello", "holds no sparse matrix"),
        (NPY, "bad.npy", npz(), "it is a dense array of NumPy; scipy.sparse.save_npz writes one that is read here"),
        (NPZ, "bad.npz", npz()[:-30], "File is not a zip file"),
        (NPZ, "bad.npz", npz(data=[1.0, np.inf]), "the entry in row 2, column 2 is not a finite number"),
        (NPZ, "bad.npz", npz(indices=[0, 7]), "must be < 2"),
        (NPZ, "bad.npz", npz(indices=[0, -1]), "must be >= 0"),
        (NPZ, "bad.npz", npz(indptr=[0, 2, 1]), "non-decreasing sequence"),
        (NPZ, "bad.npz", npz(data=["a", "b"]), "the matrix is of type <U1, not real"),
        (NPZ, "bad.npz", npz(data=[1.0, 2.0j]), "the matrix is complex, not real"),
        (CALCULIX, "job.dof", "", "names no degree of freedom"),
        (CALCULIX, "job.dof", "1.3\n1.3\n", "names n1.z twice: CalculiX expands beams, shells, plane elements"),
        (CALCULIX, "job.sti", "", "holds no entries"),
        (CALCULIX, "job.sti", b"\xff\xfe", "is not a text file"),
        (CALCULIX, "job.sti", "0 1 2.0\n", "has an entry in row 0, column 1 of 2; they count from 1"),
        (CALCULIX, "job.sti", "1.5 1 2.0\n", "line 1: 1.5 is not an integer"),
        (CALCULIX, "job.sti", "1 1 1.0\n1e30 1 2.0\n", "line 2: 1e30 is not an integer"),
        (CALCULIX, "job.sti", "1 1 nan\n", "line 1: nan is not a finite number"),
        (ABAQUS, "bad.mtx", "*HEADING\n", "holds no entries"),
        (ABAQUS, "bad.mtx", "1,3,1,3,1.0\n2,3,2", "line 2 has 3 numbers, expected 5"),
        (ABAQUS, "bad.mtx", "1,9,1,9,1.0\n", "node 1, direction 9: only nodes from 1 and directions 1 to 6 are known"),
        (ABAQUS, "bad.mtx", "1 1 1.0\n", "expected 5; it may be of FORMAT=COORDINATE, which has no nodes"),
        (ABAQUS, "bad.mtx", "-1,3,-1,3,1.0\n", "node -1, direction 3: nodes below 0 are internal to Abaqus"),
        (ABAQUS, "bad.mtx", "1,3,1,3,1e36\n2,3,2,3,1e36\n", "all degrees of freedom are constrained"),
        (MATRIX_MARKET, "bad.mtx", "1,3,1,3,1.0\n2,3,2,3,1.0\n", "if Abaqus wrote it, add --abaqus"),
        (ABAQUS, "bad.mtx", "inf,3,1,3,1.0\n", "line 1: inf is not an integer"),
        (ABAQUS, "bad.mtx", b"\xff\xfe", "is not a text file"),
        (LABELS, "labels", "a\na\n", "degrees of freedom 1 and 2 both have the label 'a'"),
        (LABELS, "labels", "1X+\n1:UX\n", "degrees of freedom 1 and 2 both have the label 'n1.x'"),
        (LABELS, "labels", b"\xff\xfe", "is not a text file"),
        ([*MESH, "--mesh=bad.inp"], "bad.inp", "*NODE\n7, 0.0, 0.0, 0.0\n", "node 1 of the matrices is not in the mesh"),
        ([*MESH, "--mesh=bad.inp"], "bad.inp", "*NODE\n1,0.,0.\n2,x", "line 3: '2,x' is not a node with its position"),
        ([*MESH, "--mesh=bad.msh"], "bad.msh", "hello", "is not a mesh of Gmsh: it has no section $MeshFormat"),
        ([*MESH, "--mesh=bad.vtk"], "bad.vtk", "hello", "is not a mesh that meshio reads: "),
    ],
)  # fmt: skip
def test_bad_files_get_one_message(tmp_path, monkeypatch, capsys, options, name, content, message):
    if name.startswith("bad.") and "--mesh" in options[-1]:
        pytest.importorskip("meshio")
    monkeypatch.chdir(tmp_path)
    for file, text in (ALWAYS | {name: content}).items():
        (tmp_path / file).write_bytes(text if isinstance(text, bytes) else text.encode())
    assert main(["import", *options, "-o", "out.h5"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1, printed
    assert name in printed.err and message in printed.err
    assert not (tmp_path / "out.h5").exists()


@pytest.mark.parametrize(
    "end", [pytest.param(".mtx.gz", marks=pytest.mark.long), pytest.param(".mtx.bz2", marks=pytest.mark.long), ".npz"]
)
def test_files_that_are_far_larger_than_their_bytes_are_refused(tmp_path, end):
    """100 MB of numbers in less than 1 MB; a matrix of a net of the same size on the disk is read."""
    path = tmp_path / f"large{end}"
    if end == ".npz":
        np.savez_compressed(path, format="csr", shape=(1, 1), data=np.zeros(12_000_000), indices=[0], indptr=[0, 1])
    else:
        compress = {".gz": gzip.compress, ".bz2": bz2.compress}[path.suffix]  # a file may have several parts
        lines = compress(b"1 1 1\n" * 10_000)
        path.write_bytes(compress(b"%%MatrixMarket matrix coordinate real general\n2 2 16000000\n") + 1600 * lines)
    assert path.stat().st_size < 1e6
    with pytest.raises(ModelError, match="holds more than 67 MB in 0.* MB; decompress it first"):
        importing.read_matrix(path)
    n = 40_000
    net = sp.diags([np.full(n, 2.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], [0, 1, -1])
    path = tmp_path / f"net{end}"
    if end == ".npz":
        sp.save_npz(path, net.tocsr())
    else:
        text = io.BytesIO()  # SciPy of Debian 13 seeks in what it writes, which a compressed file cannot
        scipy.io.mmwrite(text, net)
        path.write_bytes(compress(text.getvalue()))
    assert importing.read_matrix(path).nnz == net.nnz


def test_a_matrix_without_sizes_is_refused_whatever_its_lines(tmp_path):
    path = tmp_path / "long.mtx"
    path.write_bytes(b"%%MatrixMarket matrix coordinate real general\n%" + 100_000 * b"x" + b"\n")
    with pytest.raises(ModelError, match="ends before the line with the sizes"):
        importing.read_matrix(path)


def test_loads_and_paths_of_output_are_checked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sound.mtx").write_text(SOUND)
    command = ["import", "--mass=sound.mtx", "--stiffness=sound.mtx"]
    assert main([*command, "--load=push=x2:nan", "-o", "out.h5"]) == 2
    assert capsys.readouterr().err == "nhbm-model: load 'push': the value at x2 is not a finite number\n"
    assert main([*command, "-o", "nowhere/out.h5"]) == 2
    assert capsys.readouterr().err == "nhbm-model: file 'nowhere/out.h5': there is no folder 'nowhere'\n"


@pytest.mark.parametrize("kind", ["C3D8I", "C3D8"])
def test_nodes_that_calculix_adds_have_no_place(tmp_path, kind):
    """Those of C3D8I have numbers above all others; other nodes that are missing belong to another mesh."""
    nodes = "".join(f"{n}, {n}., {n % 3}., {n % 2}.\n" for n in range(1, 9))
    (tmp_path / "m.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE={kind}\n1, 1, 2, 3, 4, 5, 6, 7, 8\n")
    unit = sp.identity(2)
    model = Structure(mass=unit, stiffness=unit, **importing.nodes_of_labels(["n1.x", "n9.x"]))
    if kind == "C3D8":
        with pytest.raises(ModelError, match="node 9 of the matrices is not in the mesh .*1 are missing"):
            meshes.add_mesh(model, tmp_path / "m.inp")
        return
    assert meshes.add_mesh(model, tmp_path / "m.inp") == ["1 nodes, from 9 on, are of the solver's own, without a position"]
    assert model.coordinates[model.dof_node[0]].tolist() == [1.0, 1.0, 1.0] and np.isnan(model.coordinates[model.dof_node[1]]).all()
