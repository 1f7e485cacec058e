"""Files that other programs wrote, from packages that have them (tests/doors installs these): from the file to a motion with
contact, and each of them damaged."""

import importlib.util
import re
import shutil
import sys
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigs, splu

import nhbm
from nhbm import ModelError, Structure, import_structure, meshes
from nhbm.command import main


ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "why" / "programs.md"


def package(name):
    """The folder of an installed package, which is not imported; the test is skipped where there is none."""
    try:
        found = importlib.util.find_spec(name)
    except ModuleNotFoundError:
        found = None
    if found is None or not found.submodule_search_locations:
        pytest.skip(f"{name} is not installed (tests/doors)")
    return Path(found.submodule_search_locations[0])


def lowest(structure, n=6):
    stiffness, mass = (0.5 * (m + m.T).toarray() for m in (structure.stiffness, structure.mass))
    return np.sqrt(np.abs(scipy.linalg.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, n - 1])))


def struck(structure, where, omega, held=()):
    """A converged motion near a resonance with a stop at half of its linear amplitude at `where`, and that amplitude."""
    structure = holding(structure, held)
    receptance = np.abs(response(structure, where, omega))
    model = nhbm.Model(structure, tones=[omega])
    model.load(where, 1, cos=1.0)
    model.law("elastic_stop", where, stiffness=1.0 / receptance, gap=0.5 * receptance, label="stop")
    motion = model.solve(order=9)
    return motion, receptance


def response(structure, where, omega):
    """Receptance, with 2 % of the damping that is critical at this frequency."""
    i = structure.labels.index(where)
    if structure.damping is None:
        structure.damping = sp.csr_matrix(0.04 / omega * structure.stiffness)
    total = structure.stiffness - omega**2 * structure.mass + 1j * omega * structure.damping
    if structure.gyroscopic is not None:
        total = total + 1j * omega * structure.gyroscopic
    return scipy.linalg.solve(total.toarray(), np.eye(structure.n_dofs)[i])[i]


def holding(structure, nodes):
    """The structure with some nodes held."""
    if not len(nodes):
        return structure
    kept = [i for i, node in enumerate(structure.dof_node) if int(structure.node_numbers[node]) not in nodes]
    matrices = {name: matrix[kept][:, kept] for name, matrix in structure.matrices().items()}
    return Structure(**matrices, labels=[structure.labels[i] for i in kept])


def assert_struck(found, where):
    motion, receptance = found
    assert motion["status"].item() == "converged"
    amplitude = float(motion.nhbm.amplitude(where, 1))
    assert 0.3 * receptance < amplitude < 0.99 * receptance  # it moves, and is held back


def damaged_in_five_ways(path, folder):
    """Copies: empty, cut in half, without its first tenth, with rubbish in the middle, another kind of file."""
    data = path.read_bytes()
    n = len(data)
    middle = n // 2
    copies = [
        b"",
        data[: n // 3],
        data[n // 10 :],
        data[:middle] + b"\x00?rubbish, 1.2.3\n" * 40 + data[middle + 640 :],
        b"PK\x03\x04" + data[:99],
    ]
    for k, content in enumerate(copies):
        copy = folder / f"damaged{k}{path.suffix}"
        copy.write_bytes(content)
        yield copy


def assert_refused(import_it, path, folder, can_be_told=range(5)):
    """Each damaged copy is refused by its name, but for other numbers within a matrix, which nothing tells."""
    for k, copy in enumerate(damaged_in_five_ways(path, folder)):
        if k not in can_be_told:
            continue
        with pytest.raises(ModelError) as raised, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import_it(copy)
        assert copy.name in str(raised.value) and "\n" not in str(raised.value)


# Ansys


def test_full_file_of_ansys(tmp_path, capsys):
    """963 rows of 321 nodes, of which 63 are constrained; free frequencies 1283.20, 1283.20, 5781.97 Hz."""
    path = package("ansys.mapdl.reader") / "examples" / "file.full"
    assert main(["import", "--ansys", str(path), "--drop-empty", "-o", str(tmp_path / "beam.h5")]) == 0
    assert "63 constrained degrees of freedom are left out: n" in capsys.readouterr().out
    model = Structure.read(tmp_path / "beam.h5")
    assert (model.n_dofs, model.source) == (900, f"Ansys: {path}")
    np.testing.assert_allclose(lowest(model, 3) / (2 * np.pi), [1283.20, 1283.20, 5781.97], rtol=1e-5)
    in_python = import_structure(ansys=path)
    assert in_python.labels == model.labels and abs(in_python.mass - model.mass).max() == 0.0
    assert len(in_python.notes) == 1 and "63 constrained" in in_python.notes[0]
    from ansys.mapdl.reader.full import FullFile

    pairs, stiffness, _ = FullFile(str(path)).load_km(sort=False)
    names = [f"n{node}.{'xyz'[component]}" for node, component in pairs.tolist()]
    kept = [names.index(label) for label in model.labels]
    theirs = sp.csr_matrix(stiffness)[kept][:, kept]
    assert abs(sp.triu(theirs) - sp.triu(model.stiffness)).max() == 0.0
    where = next(label for label in model.labels if label.endswith(".x"))
    assert_struck(struck(model, where, 0.98 * lowest(model, 1)[0]), where)
    assert_refused(lambda copy: import_structure(ansys=copy), path, tmp_path)


@pytest.mark.parametrize("name", ["TetBeam", "HexBeam", "sector"])
def test_archive_of_ansys(name, tmp_path):
    folder = package("mapdl_archive") / "examples"
    path = next((p for p in [*folder.rglob(f"{name}.cdb")]), None) or package("ansys.mapdl.reader") / "examples" / f"{name}.cdb"
    from mapdl_archive import Archive

    mesh, other = meshes.read_mesh(path), Archive(path)
    np.testing.assert_array_equal(mesh.numbers, other.nnum)
    np.testing.assert_allclose(
        mesh.points, np.asarray(other.nodes)[:, :3], rtol=1e-15, atol=1e-15
    )  # it misses the last bit of some
    assert {key: list(value) for key, value in other.node_components.items()} == mesh.sets
    assert len(mesh.cells) == len(other.elem)
    grid = other.grid
    order = np.asarray(grid.cell_connectivity)
    theirs = [sorted(set(np.asarray(other.nnum)[order[a:b]].tolist())) for a, b in zip(grid.offset[:-1], grid.offset[1:])]
    ours = [sorted(nodes) for _, nodes in mesh.cells]
    assert all(set(a) <= set(b) for a, b in zip(ours, theirs))
    assert np.mean([len(a) == len(b) for a, b in zip(ours, theirs)]) == 1.0
    assert_refused(meshes.read_mesh, path, tmp_path)


def test_components_of_ansys_are_sets(tmp_path):
    element = "".join(f"{n:9d}" for n in (1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, *range(1, 9)))
    text = f"""/PREP7
ET,1,186
NBLOCK,6,SOLID,     9,     9
(3i9,6e21.13e3)
        1        0        0
        2        0        0 1.0000000000000E+000
        3        0        0 1.0000000000000E+000 1.0000000000000E+000
        4        0        0 0.0000000000000E+000 1.0000000000000E+000
        5        0        0 0.0000000000000E+000 0.0000000000000E+000 1.0000000000000E+000
        6        0        0 1.0000000000000E+000 0.0000000000000E+000 1.0000000000000E+000
        7        0        0 1.0000000000000E+000 1.0000000000000E+000 1.0000000000000E+000
        8        0        0 0.0000000000000E+000 1.0000000000000E+000 1.0000000000000E+000
        9        0        0 0.0000000000000E+000 1.0000000000000E+000 2.0000000000000E+000 9.0000000000000E+001
N,R5.3,LOC,       -1,
EBLOCK,19,SOLID,       1,       1
(19i9)
{element}
       -1
CMBLOCK,Tip     ,NODE,       3  ! users node component definition
(8i10)
         1         6        -9
"""
    (tmp_path / "m.cdb").write_text(text)
    mesh = meshes.read_mesh(tmp_path / "m.cdb")
    assert mesh.sets == {"Tip": [1, 6, 7, 8, 9]} and mesh.cells == [(12, [1, 2, 3, 4, 5, 6, 7, 8])]
    assert mesh.points[0].tolist() == [0.0, 0.0, 0.0] and mesh.points[6].tolist() == [1.0, 1.0, 1.0]
    assert list(mesh.frames) == [9]
    for old, new in (("         1         6        -9\n", ""), ("        8        0        1        1        2", "x"),
                     ("(3i9,6e21.13e3)", "()"),
                     ("ET,1,186", "ET,1,SOLID"), ("-9\n", "-12\n"), ("N,R5.3,LOC,       -1,\n", "")):  # fmt: skip
        (tmp_path / "m.cdb").write_text(text.replace(old, new, 1))
        if "ET" in old:
            assert "not drawn" in meshes.read_mesh(tmp_path / "m.cdb").notes[0]
        elif old in text:
            with pytest.raises(ModelError, match="m.cdb"):
                meshes.read_mesh(tmp_path / "m.cdb")


def harwell_boeing(matrix, kind, form="(4E20.12)", width=20):
    matrix = sp.csc_matrix(sp.tril(matrix) if kind == "RSA" else matrix)
    n, nnz = matrix.shape[0], matrix.nnz
    fields = [
        [f"{x + 1:10d}" for x in matrix.indptr],
        [f"{x + 1:10d}" for x in matrix.indices],
        [f"{x:{width}.12E}" for x in matrix.data],
    ]
    lines = ["".join(words[k : k + per]) for words, per in zip(fields, (8, 8, 4)) for k in range(0, len(words), per)]
    head = f"{'Ansys matrix':<72}{'K':<8}\n{len(lines):14d}{1:14d}{1:14d}{1:14d}{0:14d}\n{kind:<14}{n:14d}{n:14d}{nnz:14d}{0:14d}\n"
    return head + f"{'(8I10)':<16}{'(8I10)':<16}{form:<20}{'':20}\n" + "\n".join(lines) + "\n"


@pytest.mark.parametrize("kind", ["RSA", "RUA"])
def test_harwell_boeing_with_its_mapping(chain, tmp_path, kind):
    n = chain.n_dofs
    for name in ("mass", "stiffness"):
        (tmp_path / f"{name}.hb").write_text(harwell_boeing(getattr(chain, name), kind))
    (tmp_path / "job.mapping").write_text(
        "  Matrix Eqn    Node   DOF\n" + "".join(f"{i:10d}{i:10d}     UZ\n" for i in range(1, n + 1))
    )
    files = {name: tmp_path / f"{name}.hb" for name in ("mass", "stiffness")}
    model = import_structure(**files, labels=tmp_path / "job.mapping")
    assert model.labels == chain.labels and model.original_labels[0] == "1.UZ"
    np.testing.assert_allclose(model.stiffness.toarray(), chain.stiffness.toarray(), rtol=1e-12)
    text = (tmp_path / "mass.hb").read_text()
    lines = text.splitlines(keepends=True)
    for broken in ("", "".join(lines[:3]), text.replace(kind, "CSA"), "".join(lines[:-1]), text.replace("(8I10)", "(x)", 1),
                   text.replace("E+00", "E+9999", 1) if "E+00" in text else "x"):  # fmt: skip
        (tmp_path / "mass.hb").write_text(broken)
        with pytest.raises(ModelError, match="mass.hb"):
            import_structure(**files)


# Rows that a file keeps, labels of other programs


def test_empty_rows_are_named_or_left_out(chain, tmp_path, capsys):
    mass, stiffness = chain.mass.tolil(), chain.stiffness.tolil()
    for matrix in (mass, stiffness):
        matrix[3, :] = 0
        matrix[:, 3] = 0
    for name, matrix in (("mass", mass), ("stiffness", stiffness)):
        sp.save_npz(tmp_path / name, sp.csr_matrix(matrix))
    (tmp_path / "labels").write_text("\n".join(f"{i}.3" for i in range(1, chain.n_dofs + 1)))
    words = [
        "import",
        f"--mass={tmp_path / 'mass.npz'}",
        f"--stiffness={tmp_path / 'stiffness.npz'}",
        f"--labels={tmp_path / 'labels'}",
    ]
    assert main([*words, "-o", str(tmp_path / "all.h5")]) == 0
    told = capsys.readouterr().out
    assert "the first of which is n4.z (row 4), have neither mass nor stiffness" in told and "--drop-empty" in told
    assert main([*words, "--drop-empty", "-o", str(tmp_path / "free.h5")]) == 0
    model = Structure.read(tmp_path / "free.h5")
    assert "n4.z" not in model.labels and model.n_dofs == chain.n_dofs - 1
    assert model.original_labels == [f"{i}.3" for i in range(1, chain.n_dofs + 1) if i != 4]


def test_labels_of_other_programs():
    from nhbm.importing import valid_labels

    given = ["11.1", "1X+", "13.6", "7:UX", "7_ROTZ", "n5.z", "tip", "3rd", "1X-"]
    assert valid_labels(given) == ["n11.x", "n1.x", "n13.rz", "n7.x", "n7.rz", "n5.z", "tip", "d3rd", "d1X-"]


# Abaqus


@pytest.mark.parametrize("kind", ["symmetric", "unsymmetric"])
@pytest.mark.parametrize("name", ["total", "inner", "outer"])
def test_substructure_of_abaqus(kind, name, tmp_path):
    path = package("abaqus_mtx_parser") / "mtx" / kind / f"{name}.mtx"
    from abaqus_mtx_parser import parse_mtx

    model, theirs = import_structure(substructure=path), parse_mtx(path)
    for ours, other in ((model.stiffness, theirs.stiffness), (model.mass, theirs.mass)):
        np.testing.assert_array_equal(ours.toarray(), np.asarray(other))
        assert abs(ours - ours.T).max() <= 1e-9 * abs(ours).max()
    first = model.node_numbers[model.dof_node[0]]
    assert first == 8 if name == "total" else first == 2  # a node, not its position
    if name == "total":
        where, held = next(label for label in model.labels if label.startswith("n13.")), [8]
        rest = holding(model, held)
        assert_struck(struck(model, where, 0.98 * lowest(rest, 1)[0], held), where)
        assert_refused(lambda copy: import_structure(substructure=copy), path, tmp_path)


def test_substructure_with_different_nodes():
    path = package("abaqus_mtx_parser") / "mtx" / "recovery" / "interface-beam-sub.mtx"
    model = import_structure(substructure=path)
    counts = np.bincount(model.dof_node)
    assert model.n_dofs == 150 and sorted(set(counts)) == [3, 6] and (counts == 6).sum() == 2


# Nastran


def outboard():
    return package("pyyeti") / "tests" / "nas2cam_extseout"


def test_output4_of_a_superelement(tmp_path, capsys):
    """NX Nastran: 4 grid points and 22 modes; damping is 1 x 1 zero, which is none; grid point 11 has axes of its own."""
    folder = outboard()
    words = ["import", "--op4", str(folder / "outboard.op4"), "--mass=mxx", "--stiffness=kxx", "--damping=bxx",
             "--labels", str(folder / "outboard.pch")]  # fmt: skip
    names = matrices_of(folder / "outboard.op4")
    damping = next((name for name in names if name.startswith("b")), None)
    words = [word if not word.startswith("--damping") else f"--damping={damping}" for word in words]
    assert main([*words, "-o", str(tmp_path / "o.h5")]) == 0
    model = Structure.read(tmp_path / "o.h5")
    assert model.n_dofs == 46 and model.damping is None and "d1 to d6" in capsys.readouterr().out
    assert model.labels[:2] == ["n3.x", "n3.y"] and "n11.d1" in model.labels and "n1995001.s" in model.labels
    assert lowest(model, 6).max() < 1e-2  # rigid body motions
    held = [3]
    where = "n19.x"
    assert_struck(struck(model, where, 0.98 * lowest(holding(model, held), 1)[0], held), where)
    assert_refused(lambda copy: import_structure(op4=copy, mass="mxx", stiffness="kxx"), folder / "outboard.op4", tmp_path,
                   (0, 1, 2, 4))  # fmt: skip


def matrices_of(path):
    from pyyeti.nastran import op4

    return [name.lower() for name in op4.load(str(path), into="list")[0]]


def test_names_that_occur_several_times(tmp_path):
    path = outboard() / "nas2cam.op4"
    with pytest.raises(ModelError, match=r"has 3 matrices 'kaa': give kaa#1 of 46 rows, kaa#2 of 32 rows, kaa#3 of 54 rows"):
        import_structure(op4=path, mass="maa#2", stiffness="kaa")
    assert import_structure(op4=path, mass="maa#2", stiffness="kaa#2").n_dofs == 32
    with pytest.raises(ModelError, match="'outboard.asm' has no EXTRN|has no EXTRN"):
        import_structure(op4=path, mass="maa#1", stiffness="kaa#1", labels=outboard() / "outboard.asm")


def test_punched_dmig():
    path = package("pyyeti") / "tests" / "nastran_dmig_data" / "matrix_factory.pch"
    from nhbm.bulk_data import read_dmig

    from pyyeti.nastran import bulk

    ours, theirs = read_dmig(path), bulk.rddmig(str(path))
    assert set(ours) == {name.upper() for name in theirs} and len(ours) > 3
    for name, frame in theirs.items():
        dmig = ours[name.upper()]
        if dmig.form not in (1, 6) or dmig.is_complex:
            continue
        index = {pair: i for i, pair in enumerate(sorted({pair for both in dmig.entries for pair in both}))}
        matrix = dmig.matrix(index).toarray()
        values = frame.to_numpy()
        assert matrix.shape[0] <= max(values.shape)
        np.testing.assert_allclose(np.sort(np.abs(matrix[matrix != 0])), np.sort(np.abs(values[values != 0])), rtol=1e-12)


@pytest.mark.parametrize("folder, deck, results", [("nas2cam", "with_se.dat", "with_se_nas2cam"),
                                                   ("nas2cam_extseout", "assemble.dat", "nas2cam"),
                                                   ("cla_test_data", "residual.dat", "nas2cam")])  # fmt: skip
def test_grid_points_stand_where_nastran_has_them(folder, deck, results):
    """Decks with entries that repeat others, and assemblies of files that share points, beside the positions in OUTPUT2."""
    path = package("pyyeti") / "tests" / folder
    from pyyeti.nastran import op2

    mesh = meshes.read_mesh(path / deck)
    place = dict(zip(mesh.numbers.tolist(), mesh.points))
    rows = op2.rdnas2cam(str(path / results))["uset"][0]
    theirs = {int(point): row.to_numpy()[1:4].astype(float) for (point, dof), row in rows.iterrows() if dof == 1}
    assert len(theirs) > 3 and all(np.array_equal(place[point], at) for point, at in theirs.items())


# MATLAB


def matlab_73(path, mass, stiffness):
    """As MATLAB writes sparse matrices with -v7.3: groups with data, ir, jc; full ones transposed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        columns = sp.csc_matrix(stiffness)
        group = file.create_group("K")
        group.attrs["MATLAB_sparse"] = np.uint64(columns.shape[0])
        group.attrs["MATLAB_class"] = np.bytes_("double")
        group["data"], group["ir"], group["jc"] = columns.data, columns.indices.astype(np.uint64), columns.indptr.astype(np.uint64)
        file["M"] = mass.T
        file["M"].attrs["MATLAB_class"] = np.bytes_("double")
        empty = file.create_group("C")
        empty.attrs["MATLAB_sparse"] = np.uint64(columns.shape[0])
        empty["jc"] = np.zeros(columns.shape[0] + 1, dtype=np.uint64)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with open(path, "r+b") as file:
        file.write(head)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab(tmp_path, version):
    rng = np.random.default_rng(3)
    stiffness = sp.random(7, 7, 0.4, random_state=3) + 9 * sp.identity(7)  # not symmetric: rows and columns are told apart
    mass = np.diag(rng.uniform(1, 2, 7))
    mass[1, 2] = mass[2, 1] = 0.25
    path = tmp_path / "m.mat"
    if version == "5":
        import scipy.io

        scipy.io.savemat(path, {"K": sp.csc_matrix(stiffness), "M": mass, "C": sp.csc_matrix((7, 7))})
    else:
        matlab_73(path, mass, stiffness)
    model = import_structure(matlab=path, mass="M", stiffness="K", damping="C")
    np.testing.assert_array_equal(model.stiffness.toarray(), stiffness.toarray())
    np.testing.assert_array_equal(model.mass.toarray(), mass)
    assert model.damping.nnz == 0
    with pytest.raises(ModelError, match="has no variable 'k'; it has "):
        import_structure(matlab=path, mass="M", stiffness="k")
    data = path.read_bytes()
    for k, content in enumerate((b"", data[: len(data) // 3], b"hello" * 99, data[:600], data[600:])):
        (tmp_path / f"bad{k}.mat").write_bytes(content)
        with pytest.raises(ModelError, match=f"bad{k}.mat"):
            import_structure(matlab=tmp_path / f"bad{k}.mat", mass="M", stiffness="K")


def test_damaged_sparse_matrix_of_matlab(tmp_path):
    path = tmp_path / "m.mat"
    for name, values in (("ir", [0, 9]), ("jc", [0, 2, 1]), ("data", [1.0, np.nan]), ("jc", [0, 1])):
        matlab_73(path, np.eye(2), sp.identity(2))
        with h5py.File(path, "r+") as file:
            kind = file["K"][name].dtype
            del file["K"][name]
            file["K"][name] = np.array(values, dtype=kind)
        with pytest.raises(ModelError, match="m.mat"):
            import_structure(matlab=path, mass="M", stiffness="K")


@pytest.mark.parametrize("kind, value, message", [("text", [[98]], "/M is text"), ("empty", [0, 0], "/M is empty")])
def test_what_matlab_stores_beside_matrices(tmp_path, kind, value, message):
    """One character is a 1 x 1 dataset, and an empty matrix is stored as its two zero dimensions."""
    path = tmp_path / "m.mat"
    matlab_73(path, np.eye(1), sp.identity(1))
    with h5py.File(path, "r+") as file:
        del file["M"]
        file["M"] = np.array(value, dtype=np.uint16 if kind == "text" else np.uint64)
        file["M"].attrs["MATLAB_class"] = np.bytes_("char" if kind == "text" else "double")
        if kind == "empty":
            file["M"].attrs["MATLAB_empty"] = np.uint8(1)
    with pytest.raises(ModelError, match=message):
        import_structure(matlab=path, mass="M", stiffness="K")


# ROSS


def eigenvalue_near(quadratic, value):
    """Eigenvalue of (m s^2 + c s + k) x = 0, by inverse iteration from a value near it."""
    mass, damping, stiffness = quadratic
    left = right = np.random.default_rng(1).standard_normal(len(mass)) + 0j
    for _ in range(4):
        slope = 2 * value * mass + damping
        factors = scipy.linalg.lu_factor(value**2 * mass + value * damping + stiffness)
        right = scipy.linalg.lu_solve(factors, slope @ right)
        left = scipy.linalg.lu_solve(factors, slope.T @ left, trans=1)
        right, left = right / np.linalg.norm(right), left / np.linalg.norm(left)
        value -= left @ (value**2 * mass + value * damping + stiffness) @ right / (left @ slope @ right)
    return value


def test_rotor_of_ross(tmp_path):
    """Eigenvalues of the compressor at 700 rad/s, as those of ROSS to nine digits; a stop at a seal."""
    path = package("ross") / "data" / "compressor_example.toml"
    with pytest.raises(ModelError, match="depend on the speed: give the speed"):
        import_structure(ross=path)
    with pytest.raises(ModelError, match="is for a speed of .* not 3000: ROSS would extrapolate it"):
        import_structure(ross=path, speed=3000.0)
    model = import_structure(ross=path, speed=700.0)
    import ross

    rotor = ross.Rotor.load(str(path))
    assert model.n_dofs == len(rotor.nodes) * 6
    n = model.n_dofs
    quadratic = [matrix.toarray() for matrix in (model.mass, model.damping + model.gyroscopic, model.stiffness)]
    theirs = rotor.run_modal(700.0, num_modes=20, sparse=False).evalues  # those of its dense solver have eleven digits
    whirls = sorted((value for value in theirs if value.imag > 10.0), key=lambda value: value.imag)[:8]
    assert len(whirls) == 8
    for value in whirls:
        assert abs(eigenvalue_near(quadratic, value) - value) < 1e-9 * abs(value)
    from_object = import_structure(ross=rotor, speed=700.0)
    assert abs(from_object.stiffness - model.stiffness).max() == 0.0

    class Old:  # as in ROSS 2, with matrices of one argument
        number_dof, nodes, nodes_pos, bearing_elements = 6, rotor.nodes, rotor.nodes_pos, []
        M = K = C = G = lambda self, frequency=None, synchronous=False: np.eye(n)

    with pytest.raises(ModelError, match="ROSS 3.1 and later"):
        import_structure(ross=Old())
    # axial motion and torsion have no support in this model
    for end in ("z", "rz"):
        i = model.labels.index(f"n1.{end}")
        model.stiffness = sp.csr_matrix(model.stiffness + sp.csr_matrix(([1e6], ([i], [i])), shape=(n, n)))
    where = "n28.x"
    assert_struck(struck(model, where, 700.0), where)
    assert_refused(lambda copy: import_structure(ross=copy, speed=700.0), path, tmp_path)


def test_tables_of_ross_follow_the_speed():
    """Bearings with tables over speed and frequency: at their rows the unbalanced motion is that of ROSS's own matrices, which
    depend on both; between them monotone cubics differ little."""
    package("ross")
    import ross

    steel = ross.Material("steel", rho=7810, E=211e9, G_s=81.2e9)
    shaft = [ross.ShaftElement(L=0.25, idl=0.0, odl=0.05, material=steel) for _ in range(4)]
    disk = ross.DiskElement.from_geometry(2, steel, 0.07, 0.05, 0.28)
    at = np.array([100.0, 200.0, 300.0, 500.0])
    table = 1e6 * (1 + 0.5 * np.add.outer(at / 500, (at / 600) ** 2))
    damping = 1e3 * np.add.outer(1 + at / 1e3, np.exp(-at / 400))
    bearings = [
        ross.BearingElement(n, kxx=(1 + 0.1 * n) * table, kyy=0.8 * table, kxy=0.2 * table, kyx=-0.1 * table, cxx=damping,
                            cyy=1.2 * damping, speed=at, frequency=at) for n in (0, 4)
    ]  # fmt: skip
    rotor = ross.Rotor(shaft, [disk], bearings)
    model = nhbm.import_rotor(rotor, 200.0)
    model.load("n3.x", 1, cos=1.0)
    speeds = [*at, 137.0, 431.0]
    swept = model.sweep({"tones[0]": speeds}, order=1)
    where = import_structure(ross=rotor, speed=200.0).labels.index("n3.x")
    for k, speed in enumerate(speeds):
        mass, rates, stiffness = (matrix(frequency=speed, speed=speed) for matrix in (rotor.M, rotor.C, rotor.K))
        force = np.zeros(len(mass))
        force[where] = 1.0
        motion = np.linalg.lstsq(stiffness - speed**2 * mass + 1j * speed * (rates + speed * rotor.G()), force, rcond=None)[0]
        ours = float(swept.isel(point=k).nhbm.amplitude("n3.x", 1))
        assert ours == pytest.approx(abs(motion[where]), rel=1e-9 if speed in at else 1e-2)


# BARC


@pytest.mark.long
def test_barc_as_visualdynamics_makes_it():
    """Mass and stiffness are without the ties of its bolts; with them the elastic modes of the coarse plates are 196.29, 217.83 and
    277.96 Hz."""
    package("visualdynamics")
    from visualdynamics.demo import barc

    model = barc.build(0.25)
    mass, stiffness = model.sparse_matrices()
    ties = model.constraint_transform(sparse=True)
    structure = Structure(mass=ties.T @ mass @ ties, stiffness=ties.T @ stiffness @ ties)
    shift = 1e-6 * abs(stiffness.diagonal()).max() / abs(mass.diagonal()).max()
    factors = splu((structure.stiffness + shift * structure.mass).tocsc())
    n = structure.n_dofs
    operator = LinearOperator((n, n), matvec=lambda x: factors.solve(structure.mass @ x))
    found = np.sqrt(np.sort(np.abs(1 / eigs(operator, 9, return_eigenvectors=False).real - shift))) / (2 * np.pi)
    np.testing.assert_allclose(found[6:], [196.29, 217.83, 277.96], rtol=1e-4)


@pytest.mark.long
def test_bolts_of_the_barc_may_slip():
    """Where all nodes of its bolts stick, drivers/examples/barc.py has the modes of its rigid links; softer contacts lower each of
    them, and so does slip, which dissipates."""
    package("visualdynamics")
    example = ROOT / "drivers" / "examples" / "barc.py"
    found = importlib.util.spec_from_file_location("barc_example", example)
    barc = importlib.util.module_from_spec(found)
    found.loader.exec_module(barc)
    structure = barc.structure()
    stuck = [barc.frequencies(structure, contact) for contact in (1e12, 1e9, 2e7)]
    np.testing.assert_allclose(stuck[0][:3], [196.29, 217.83, 277.96], rtol=2e-4)
    assert np.all(np.diff(stuck, axis=0) < 0.0)
    barc.FORCES = [0.5, 8.0]
    slipping = barc.backbone(structure)
    assert np.all(np.diff(slipping["omega"]) <= 1e-6 * slipping["omega"].values[1:])
    assert slipping["ratio"][-1] > 1.1 * slipping["ratio"][0]


# What belongs to what


@pytest.mark.parametrize(
    "options, message",
    [
        ({}, "give --mass and --stiffness, or a file of a program"),
        ({"matlab": "a.mat"}, "give --mass and --stiffness, the names of matrices of a.mat"),
        ({"ansys": "a.full", "ross": "b.toml"}, "give one of --ansys and --ross"),
        ({"ansys": "a.full", "mass": "m.mtx"}, "--mass does not belong to --ansys"),
        ({"ansys": "a.full", "speed": 1.0}, "--speed and --frequency belong to --ross"),
        ({"ansys": "a.full", "labels": ["a"]}, "--labels does not belong to --ansys"),
        ({"ansys": "none.full"}, "none.full' does not exist"),
        ({"stifness": "k.mtx"}, "there is no option and no matrix 'stifness'; did you mean 'stiffness'?"),
    ],
)
def test_options_that_do_not_fit(options, message):
    with pytest.raises(ModelError) as raised:
        import_structure(**options)
    assert message in str(raised.value)


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("is_binary", [0, 1])
def test_physical_groups_as_gmsh_counts_them(tmp_path, version, is_binary):
    """One tag in two dimensions, and a surface of two groups; prisms and hexahedra of the second order."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        for recombined, x in ((False, 0.0), (True, 1.0)):
            face = gmsh.model.occ.addRectangle(x, 0, 0, 1, 1)
            gmsh.model.occ.extrude([(2, face)], 0, 0, 1, [2], recombine=True)
            gmsh.model.occ.synchronize()
            if recombined:
                gmsh.model.mesh.setRecombine(2, face)
        for dimension, members, tag, name in (
            (3, [1, 2], 1, "bar"),
            (2, [1], 1, "root"),
            (2, [2], 2, "tip"),
            (2, [2, 4], 3, "contact"),
        ):
            gmsh.model.addPhysicalGroup(dimension, members, tag, name)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", is_binary)
        gmsh.write(str(tmp_path / "bar.msh"))
        groups = {gmsh.model.getPhysicalName(*group): set(gmsh.model.mesh.getNodesForPhysicalGroup(*group)[0].tolist())
                  for group in gmsh.model.getPhysicalGroups()}  # fmt: skip
        tags, at, _ = gmsh.model.mesh.getNodes()
    finally:
        gmsh.finalize()
    mesh = meshes.read_mesh(tmp_path / "bar.msh")
    assert {name: set(members) for name, members in mesh.sets.items()} == groups
    where = dict(zip(tags.tolist(), at.reshape(-1, 3)))
    assert np.abs(mesh.points - [where[tag] for tag in mesh.numbers.tolist()]).max() < 1e-12
    assert {kind for kind, _ in mesh.cells} == {22, 23, 25, 26}


# The page

SECTIONS = re.split(r"^### ", (PAGE.read_text(encoding="utf-8")).split("## Recipes")[1], flags=re.MULTILINE)[1:]
RECIPES = [section for section in SECTIONS if "```python" in section]
NEEDS = {"Ansys": "ansys.mapdl.reader", "Abaqus": "abaqus_mtx_parser", "ROSS": "ross", "Gmsh and CalculiX": "gmsh",
         "Measurements": "pyuff"}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("recipe", RECIPES, ids=lambda text: text.split("\n")[0])
def test_recipe_of_the_page(recipe, tmp_path):
    name = recipe.split("\n")[0]
    if name in NEEDS and importlib.util.find_spec(NEEDS[name].split(".")[0]) is None:
        pytest.skip(f"{NEEDS[name]} is not installed (tests/doors)")
    for program, of in (("ccx", "CalculiX (calculix-ccx)"), ("freecadcmd", "FreeCAD (freecad-python3)")):
        if f'["{program}"' in recipe and not shutil.which(program):
            pytest.skip(f"{of} is not installed")
    sys.path.insert(0, str(PAGE.parents[2] / "tests" / "cases"))
    from page_runner import run_page

    (tmp_path / "page.md").write_text(recipe)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run_page(tmp_path / "page.md", tmp_path)
