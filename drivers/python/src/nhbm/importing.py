"""Matrices and meshes of other programs: Matrix Market, npz, CalculiX, Abaqus, Nastran; meshes by meshio."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp

from nhbm.errors import ModelError, imported
from nhbm.structure import Structure, check_labels

DIRECTIONS = {1: "x", 2: "y", 3: "z", 4: "rx", 5: "ry", 6: "rz"}
ANGLES = ("rx", "ry", "rz")
_OPENERS: dict[str, Any] = {".gz": gzip.open, ".bz2": bz2.open}  # as mmread takes them
_CONSTRAINED = 1e30  # [N/m]: what Abaqus adds to the stiffness of constrained degrees of freedom, 1e36, and no structure has
_COORDINATES = {3: "it may be of FORMAT=COORDINATE, which has no nodes; write FORMAT=MATRIX INPUT, the default"}
_SMALL, _MOST_COMPRESSED = 2**26, 50  # bytes, and bytes a compressed byte, of matrices; those of finite elements have up to 30


def from_matrices(paths: dict[str, Path], labels: list[str] | None = None, **more: Any) -> Structure:
    """Structure of matrices in Matrix Market (.mtx, .mm) or npz files, one a matrix."""
    matrices = {name: read_matrix(path) for name, path in paths.items()}
    if labels is None:
        labels = [f"x{i + 1}" for i in range(next(iter(matrices.values())).shape[0])]
    for name, matrix in matrices.items():
        if matrix.shape[0] != len(labels):
            raise ModelError(f"file '{paths[name]}': matrix '{name}' has {matrix.shape[0]} rows, there are {len(labels)} labels")
    return Structure(**matrices, **nodes_of_labels(labels), **more)


def read_matrix(path: Any) -> sp.csr_matrix:
    """One matrix, its format by the end of the file's name."""
    path = _existing(path)
    try:
        _check_size(path)
        if path.suffix == ".npy":
            raise ValueError("it is a dense array of NumPy; scipy.sparse.save_npz writes one that is read here, as .npz")
        if path.suffix != ".npz" and not _has_sizes(path):
            raise ValueError("it ends before the line with the sizes")
        matrix = sp.load_npz(path) if path.suffix == ".npz" else scipy.io.mmread(path)
        if sp.issparse(matrix) and matrix.format in ("csr", "csc", "bsr"):
            matrix.check_format()  # indices, which SciPy does not look at when it loads them
        matrix = sp.csr_matrix(matrix)
    except (ValueError, TypeError, OSError, KeyError, IndexError, MemoryError, EOFError, NotImplementedError, zipfile.BadZipFile,
            zlib.error) as error:  # fmt: skip
        raise ModelError(f"file '{path}' holds no sparse matrix: {error}{_of_abaqus(path)}") from None
    if matrix.dtype.kind not in "fiub":
        kind = "complex" if matrix.dtype.kind == "c" else f"of type {matrix.dtype}"
        raise ModelError(f"file '{path}': the matrix is {kind}, not real; give an imaginary part of K as --structural")
    if matrix.shape[0] != matrix.shape[1] or 0 in matrix.shape:
        raise ModelError(f"file '{path}': the matrix is {matrix.shape[0]} x {matrix.shape[1]}, not square")
    if not np.isfinite(matrix.data).all():
        at = matrix.tocoo()
        e = int(np.argmin(np.isfinite(at.data)))
        raise ModelError(f"file '{path}': the entry in row {at.row[e] + 1}, column {at.col[e] + 1} is not a finite number")
    return matrix


def _of_abaqus(path: Path) -> str:
    """A hint for a file that is no Matrix Market but a table of Abaqus."""
    try:
        with open(path, "rb") as file:
            lines = [line for line in file.read(2**12).decode().splitlines()[:-1] if line.strip() and not line.startswith("*")]
        is_table = len(lines) > 0 and all(len([float(word) for word in line.split(",")]) == 5 for line in lines)
    except (OSError, ValueError):
        return ""
    return "; if Abaqus wrote it, add --abaqus" if is_table else ""


def _check_size(path: Path) -> None:
    """ValueError for a compressed file whose contents are out of proportion: a few MB of it could fill the memory."""
    n, limit = 0, max(_SMALL, _MOST_COMPRESSED * path.stat().st_size)
    if path.suffix == ".npz":
        with zipfile.ZipFile(path) as members:
            n = sum(member.file_size for member in members.infolist())
    elif path.suffix in _OPENERS:
        with _OPENERS[path.suffix](path, "rb") as file:
            while n <= limit and (block := file.read(2**20)):
                n += len(block)
    if n > limit:
        raise ValueError(f"it holds more than {limit / 1e6:.0f} MB in {path.stat().st_size / 1e6:.1f} MB; decompress it first")


def _has_sizes(path: Path) -> bool:
    """Whether there is a line behind the head and the comments of a Matrix Market file; SciPy looks for one for ever."""
    is_comment, begins = False, True
    with _OPENERS.get(path.suffix, open)(path, "rb") as file:
        while piece := file.readline(2**16):
            is_comment = piece.lstrip().startswith(b"%") if begins else is_comment
            if piece.strip() and not is_comment:
                return True
            begins = piece.endswith(b"\n")
    return False


def read_labels(path: Any) -> list[str]:
    """Labels, a line each."""
    return _checked(_text(path).split(), path)


def _checked(labels: list[str], path: Any) -> list[str]:
    try:
        check_labels(labels)
    except ModelError as error:
        raise ModelError(f"file '{path}': {error}") from None
    return labels


def nodes_of_labels(labels: list[str]) -> dict[Any, Any]:
    """Numbers of the nodes, and node and direction of each degree of freedom, from labels such as `n1204.z`."""
    numbers: dict[int, int] = {}
    node, direction, units = [], [], []
    for label in labels:
        stem, _, end = label.partition(".")
        names_node = stem[:1] == "n" and stem[1:].isdigit() and bool(end)
        node.append(numbers.setdefault(int(stem[1:]), len(numbers)) if names_node else -1)
        direction.append(end if names_node else "")
        units.append("rad" if end in ANGLES else "m")
    return {
        "labels": labels,
        "units": units,
        "node_numbers": np.array(list(numbers), dtype=np.int64),
        "coordinates": np.full((len(numbers), 3), np.nan),
        "dof_node": np.array(node),
        "dof_direction": direction,
    }


def calculix_files(stem: Any) -> dict[str, Path]:
    """The files that CalculiX stores for `*FREQUENCY, SOLVER=MATRIXSTORAGE`, by their contents."""
    stem = Path(stem)
    stem = stem.with_suffix("") if stem.suffix in (".sti", ".mas", ".dof", ".inp") else stem
    return {name: Path(f"{stem}{end}") for name, end in (("stiffness", ".sti"), ("mass", ".mas"), ("labels", ".dof"))}


def from_calculix(stem: Any, **more: Any) -> Structure:
    """Structure of what CalculiX stores for `*FREQUENCY, SOLVER=MATRIXSTORAGE`: <stem>.sti, .mas and .dof."""
    files = calculix_files(stem)
    labels = []
    for line in _text(files["labels"]).split():
        node, _, direction = line.partition(".")
        if not node.isdigit() or direction not in ("1", "2", "3", "4", "5", "6"):
            raise ModelError(f"file '{files['labels']}': '{line}' is no node and direction, such as 12.3")
        labels.append(f"n{node}.{DIRECTIONS[int(direction)]}")
    if not labels:
        raise ModelError(f"file '{files['labels']}' names no degree of freedom")
    n = len(_checked(labels, files["labels"]))
    matrices = {name: _triangle(files[name], n) for name in ("stiffness", "mass")}
    return Structure(**matrices, **nodes_of_labels(labels), **more)


def _triangle(path: Any, n: Any) -> sp.csr_matrix:
    """Symmetric matrix of which one triangle stands in a file as row, column, value."""
    table = _table(path, 3, 2)
    outside = ((table[:, :2] < 1) | (table[:, :2] > n)).any(axis=1)
    if outside.any():
        i, j = table[np.argmax(outside), :2]
        raise ModelError(f"file '{path}' has an entry in row {i:.0f}, column {j:.0f} of {n}; they count from 1")
    row, column = (table[:, :2].astype(np.int64) - 1).T
    return _symmetric(row, column, table[:, 2], n)


def _symmetric(row: Any, column: Any, value: Any, n: Any) -> sp.csr_matrix:
    """A symmetric matrix of one entry of each pair, in either triangle; with both entries of pairs it is taken as it is."""
    given = sp.coo_matrix((value, (row, column)), shape=(n, n)).tocsr()
    diagonal = sp.diags(given.diagonal())
    pattern = sp.csr_matrix(given - diagonal)
    pattern.eliminate_zeros()
    pattern.data[:] = 1.0
    if pattern.multiply(pattern.T).nnz > 0:
        return given
    return sp.csr_matrix(given + given.T - diagonal)


def from_abaqus(paths: dict[str, Path], **more: Any) -> Structure:
    """Structure of Abaqus' `*MATRIX GENERATE` (MATRIX INPUT format): node, direction, node, direction, value a line.
    Constrained degrees of freedom, whose stiffness Abaqus writes as 1e36, are omitted."""
    tables = {name: _table(path, 5, 4, _COORDINATES) for name, path in paths.items()}
    pairs = np.unique(np.concatenate([t[:, pair] for t in tables.values() for pair in ([0, 1], [2, 3])]), axis=0)
    index = {(int(node), int(direction)): i for i, (node, direction) in enumerate(pairs)}
    for node, direction in index:
        if direction not in DIRECTIONS or node < 1:
            at = [t[:, pair] == (node, direction) for t in tables.values() for pair in ([0, 1], [2, 3])]
            path = list(paths.values())[next(i for i, found in enumerate(at) if found.all(axis=1).any()) // 2]
            why = "only nodes from 1 and directions 1 to 6 are known"
            if node < 0:
                why = "nodes below 0 are internal to Abaqus, of couplings, connectors or hybrid elements; avoid these"
            raise ModelError(f"file '{path}': node {node}, direction {direction}: {why}")
    matrices = {}
    for name, table in tables.items():
        row = np.array([index[int(a), int(b)] for a, b in table[:, :2]])
        column = np.array([index[int(a), int(b)] for a, b in table[:, 2:4]])
        matrices[name] = _symmetric(row, column, table[:, 4], len(index))
    is_free = np.ones(len(index), dtype=bool)
    if "stiffness" in matrices:
        is_free = matrices["stiffness"].diagonal() < _CONSTRAINED
    if not is_free.any():
        raise ModelError(f"file '{paths['stiffness']}': all degrees of freedom are constrained")
    free = np.flatnonzero(is_free)
    matrices = {name: matrix[free][:, free] for name, matrix in matrices.items()}
    labels = [f"n{node}.{DIRECTIONS[direction]}" for (node, direction), known in zip(index, is_free) if known]
    return Structure(**matrices, **nodes_of_labels(labels), **more)


def from_nastran(path: Any, names: dict[str, str], **more: Any) -> Structure:
    """Structure of DMIG matrices in a bulk data or punch file (needs pyNastran)."""
    read_bdf = imported("pyNastran.bdf.bdf", "DMIG is read with").read_bdf
    is_punch = "BEGIN BULK" not in _existing(path).read_text(errors="replace").upper()
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints unknown lines
            bulk = read_bdf(str(path), validate=False, punch=is_punch, xref=False, debug=None)
    except (Exception, SystemExit) as error:  # it raises whatever it meets
        why = " ".join(str(error).split()) or type(error).__name__
        raise ModelError(f"file '{path}' is no bulk data that pyNastran reads: {why}") from None
    entries, pairs = {}, set()
    for name, card in names.items():
        if card not in bulk.dmig:
            raise ModelError(f"file '{path}' has no DMIG '{card}'; it has {', '.join(bulk.dmig) or 'none'}")
        form = bulk.dmig[card].matrix_form
        if form not in (1, 6):
            raise ModelError(f"file '{path}': DMIG '{card}' has the form {form}, not 1 (square) or 6 (symmetric)")
        entry, rows, columns = bulk.dmig[card].get_matrix(is_sparse=True, apply_symmetry=True)
        matrix = sp.coo_matrix(entry)
        if np.iscomplexobj(matrix.data):
            raise ModelError(f"file '{path}': DMIG '{card}' is complex; give its imaginary part as --structural")
        entries[name] = (matrix, rows, columns)
        pairs |= {tuple(map(int, pair)) for pair in (*rows.values(), *columns.values())}
    index = {pair: i for i, pair in enumerate(sorted(pairs))}
    matrices = {}
    for name, (matrix, rows, columns) in entries.items():
        row = [index[tuple(map(int, rows[i]))] for i in matrix.row]
        column = [index[tuple(map(int, columns[i]))] for i in matrix.col]
        matrices[name] = sp.csr_matrix((matrix.data, (row, column)), shape=(len(index),) * 2)
    labels = [f"n{node}.{DIRECTIONS.get(direction, 's')}" for node, direction in index]
    return Structure(**matrices, **nodes_of_labels(labels), **more)


def add_mesh(model: Structure, path: Any) -> None:
    """Reads coordinates, cells and sets of nodes from a mesh (any format of meshio), nodes by their numbers."""
    if (model.dof_node < 0).all():
        raise ModelError(f"no degree of freedom stands at a node of '{path}': --labels gives names such as n12.z")
    meshio = imported("meshio", "meshes are read with")
    meshio_to_vtk_type = imported("meshio._vtk_common", "meshes are read with").meshio_to_vtk_type
    path = _existing(path)
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever they meet, or print it and exit
        why = output.getvalue() if isinstance(error, SystemExit) else str(error)
        raise ModelError(f"file '{path}' is no mesh that meshio reads: {' '.join(why.split())}") from None
    numbers = np.asarray(mesh.point_gids) if getattr(mesh, "point_gids", None) is not None else _abaqus_numbers(path)
    if numbers is None or len(numbers) != len(mesh.points):
        numbers = np.arange(1, len(mesh.points) + 1)
    index = {int(number): i for i, number in enumerate(numbers)}
    missing = [int(number) for number in model.node_numbers if int(number) not in index]
    if missing:
        hint = ""
        if len(missing) < len(model.node_numbers) and min(missing) > max(index):
            hint = "; CalculiX gives elements such as C3D8I, beams and shells nodes of its own, C3D8, C3D10 and C3D20 have none"
        raise ModelError(f"node {missing[0]} of the matrices is not in the mesh '{path}' ({len(missing)} are missing{hint})")
    old = np.array([index[int(number)] for number in model.node_numbers], dtype=np.int64)
    model.dof_node = np.array([old[node] if node >= 0 else -1 for node in model.dof_node])
    model.node_numbers = np.asarray(numbers, dtype=np.int64)
    model.coordinates = np.hstack([mesh.points, np.zeros((len(mesh.points), 3 - mesh.points.shape[1]))])
    types, starts, nodes = [], [0], []
    for block in mesh.cells:
        for cell in block.data:
            types.append(meshio_to_vtk_type[block.type])
            nodes.extend(cell)
            starts.append(len(nodes))
    model.cell_types, model.cell_starts, model.cell_nodes = (np.array(a, dtype=np.int64) for a in (types, starts, nodes))
    moving = set(model.dof_node.tolist())
    for name, members in (mesh.point_sets | _physical_groups(mesh)).items():
        moving_nodes = [int(node) for node in np.unique(members) if int(node) in moving]
        if moving_nodes:
            model.sets[name.lower()] = np.array(moving_nodes)
    model.validate()


def _physical_groups(mesh: Any) -> dict[str, np.ndarray]:
    """Nodes of the named physical groups of Gmsh."""
    tags = mesh.cell_data.get("gmsh:physical", [])
    found = {}
    for name, (tag, _) in mesh.field_data.items():
        members = [np.asarray(block.data)[np.asarray(tag_of) == tag].ravel() for block, tag_of in zip(mesh.cells, tags)]
        found[name] = np.unique(np.concatenate(members)) if members else np.zeros(0, dtype=int)
    return found


def _abaqus_numbers(path: Path) -> np.ndarray | None:
    """Numbers of the nodes of an input file of Abaqus or CalculiX, in the order of the file."""
    if path.suffix != ".inp":
        return None
    numbers, inside = [], False
    for line in path.read_text().splitlines():
        if line.startswith("**") or not line.strip():
            continue
        if line.startswith("*"):
            inside = line.upper().replace(" ", "").split(",")[0] == "*NODE"
        elif inside:
            numbers.append(int(line.split(",")[0]))
    return np.array(numbers)


def _table(path: Any, n_columns: Any, n_whole: Any, hints: dict[int, str] | None = None) -> np.ndarray:
    """Numbers of a text file, a row a line, the first of them whole; lines that begin with * or # are no data. `hints` explain
    other numbers of columns."""
    rows = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        if not line.strip() or line.lstrip()[0] in "*#%":
            continue
        words = line.replace(",", " ").replace("D", "E").replace("d", "e").split()
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            raise ModelError(f"file '{path}', line {number}: '{line.strip()}' are no numbers") from None
        if len(words) != n_columns:
            hint = (hints or {}).get(len(words), "")
            raise ModelError(f"file '{path}', line {number} has {len(words)} numbers, expected {n_columns}{hint and '; '}{hint}")
        for word, value in zip(words[:n_whole], rows[-1]):
            if not (value.is_integer() and abs(value) < 2**53):
                raise ModelError(f"file '{path}', line {number}: {word} is not an integer")
        for word, value in zip(words[n_whole:], rows[-1][n_whole:]):
            if not np.isfinite(value):
                raise ModelError(f"file '{path}', line {number}: {word} is not a finite number")
    if not rows:
        raise ModelError(f"file '{path}' holds no entries")
    return np.array(rows).reshape(-1, n_columns)


def _text(path: Any) -> str:
    try:
        return _existing(path).read_text()
    except UnicodeDecodeError:
        raise ModelError(f"file '{path}' is no text") from None


def _existing(path: Any) -> Path:
    path = Path(path)
    if not path.is_file():
        raise ModelError(f"file '{path}' does not exist")
    return path
