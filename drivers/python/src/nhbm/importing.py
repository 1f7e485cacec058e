"""Matrices of other programs: Matrix Market, npz, CalculiX, Abaqus, Nastran."""

from __future__ import annotations

import bz2
import gzip
import zipfile
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp

from nhbm import bulk_data
from nhbm.errors import ModelError
from nhbm.meshes import DIRECTIONS, name_frames
from nhbm.structure import Structure, check_labels

ANGLES = ("rx", "ry", "rz")
_OPENERS: dict[str, Any] = {".gz": gzip.open, ".bz2": bz2.open}  # as mmread takes them
_CONSTRAINED = 1e30  # [N/m]: what Abaqus adds to the stiffness of constrained degrees of freedom, 1e36, and no structure has
_COORDINATES = {3: "it may be of FORMAT=COORDINATE, which has no nodes; write FORMAT=MATRIX INPUT, the default"}
_CYCLIC = ("; of a *CYCLIC SYMMETRY MODEL there are twice as many rows, real and imaginary parts of one nodal diameter: write "
           "the sector without it, and nhbm-model wheel has all diameters")  # fmt: skip
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
    repeated = next((label for label, n in Counter(labels).items() if n > 1), "")
    if repeated:
        raise ModelError(f"file '{files['labels']}' names {repeated} more than once: CalculiX expands beams, shells, plane elements "
                         "to nodes of its own, which have the numbers of yours; model the part by solid elements")  # fmt: skip
    n = len(_checked(labels, files["labels"]))
    matrices = {name: _triangle(files[name], n, _CYCLIC) for name in ("stiffness", "mass")}
    return Structure(**matrices, **nodes_of_labels(labels), **more)


def _triangle(path: Any, n: Any, hint: str = "") -> sp.csr_matrix:
    """Symmetric matrix of which one triangle stands in a file as row, column, value. `hint`: why it may have more than `n` rows."""
    table = _table(path, 3, 2)
    outside = ((table[:, :2] < 1) | (table[:, :2] > n)).any(axis=1)
    if outside.any():
        i, j = table[np.argmax(outside), :2]
        raise ModelError(f"file '{path}' has an entry in row {i:.0f}, column {j:.0f} of {n}; they count from 1"
                         + hint * bool(table[:, :2].max() == 2 * n))  # fmt: skip
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
    """Structure of DMIG matrices in bulk data or a punch file."""
    found, entries = bulk_data.read_dmig(path), {}
    for name, card in names.items():
        if card.upper() not in found:
            raise ModelError(f"file '{path}' has no DMIG '{card}'; it has {', '.join(found) or 'none'}")
        dmig = entries[name] = found[card.upper()]
        if dmig.form not in (1, 6):
            raise ModelError(f"file '{path}': DMIG '{card}' has the form {dmig.form}, not 1 (square) or 6 (symmetric)")
        if dmig.is_complex:
            raise ModelError(f"file '{path}': DMIG '{card}' is complex; give its imaginary part as --structural")
        if not dmig.entries:
            raise ModelError(f"file '{path}': DMIG '{card}' has no terms")
    pairs = sorted({pair for dmig in entries.values() for both in dmig.entries for pair in both})
    index = {pair: i for i, pair in enumerate(pairs)}
    matrices = {name: dmig.matrix(index) for name, dmig in entries.items()}
    labels = [f"n{node}.{DIRECTIONS.get(direction, 's')}" for node, direction in index]
    model = Structure(**matrices, **nodes_of_labels(labels), **more)
    name_frames(model, bulk_data.frames_of(path))
    return model


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
