"""Structures of files of other programs."""

from __future__ import annotations

import bz2
import gzip
import re
import zipfile
import zlib
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.io
import scipy.sparse as sp

from nhbm import bulk_data, matrix_files, substructures
from nhbm.errors import ModelError, among
from nhbm.mesh import DIRECTIONS
from nhbm.meshes import add_mesh, name_frames
from nhbm.structure import MATRICES, Structure, check_labels

if TYPE_CHECKING:
    from nhbm.model import Model

ANGLES = ("rx", "ry", "rz")
OPTIONS = ("calculix", "abaqus", "nastran", "ansys", "substructure", "op4", "matlab", "ross", "labels", "mesh", "in_order",
           "drop_empty", "speed", "frequency", "units")  # fmt: skip
_OPENERS: dict[str, Any] = {".gz": gzip.open, ".bz2": bz2.open}  # as mmread takes them
_CONSTRAINED = 1e30  # [N/m]: what Abaqus adds to the stiffness of constrained degrees of freedom, 1e36, and no structure has
_COORDINATES = {3: "it may be of FORMAT=COORDINATE, which has no nodes; write FORMAT=MATRIX INPUT, the default"}
_CYCLIC = ("; of a *CYCLIC SYMMETRY MODEL there are twice as many rows, real and imaginary parts of one nodal diameter: write "
           "the sector without it, and nhbm-model wheel has all diameters")  # fmt: skip
_SMALL, _MOST_COMPRESSED = 2**26, 50  # bytes, and bytes a compressed byte, of matrices; those of finite elements have up to 30


def import_structure(  # noqa: PLR0913
    calculix: Any = None, abaqus: bool = False, nastran: Any = None, ansys: Any = None, substructure: Any = None, op4: Any = None,
    matlab: Any = None, ross: Any = None, labels: Any = None, mesh: Any = None, in_order: bool = False, drop_empty: bool = False,
    sets: dict[str, list[int]] | None = None, speed: float | None = None, frequency: float | None = None, units: str = "m kg s",
    **matrices: Any,
) -> Structure:  # fmt: skip
    """A structure from files of another program, as `nhbm-model import` makes it.

    Parameters
    ----------
    **options
        Those of `nhbm-model import` by their names: ``ansys="file.full"``, ``mesh="file.cdb"``, ``ross=rotor`` (also an object),
        ``speed=700.0`` [rad/s], ``stiffness=...``, ``labels=...`` (also a list), ``sets={"tip": [12, 13]}``, ...

    Returns
    -------
    Structure
        With `notes` on what was left out. ModelError where something is missing.
    """
    unknown = next((name for name in matrices if name not in MATRICES), "")
    if unknown:
        raise ModelError(f"there is no option and no matrix '{unknown}'{among(unknown, [*MATRICES])}")
    given = {name: value for name, value in matrices.items() if value}
    programs = {"calculix": calculix, "nastran": nastran, "ansys": ansys, "substructure": substructure, "op4": op4,
                "matlab": matlab, "ross": ross}  # fmt: skip
    chosen = [name for name, value in programs.items() if value is not None] + ["abaqus"] * bool(abaqus)
    if len(chosen) > 1:
        raise ModelError(f"give one of --{' and --'.join(chosen)}")
    program = chosen[0] if chosen else ""
    needs_names = program in ("", "abaqus", "nastran", "op4", "matlab")
    if needs_names and not {"mass", "stiffness"} <= set(given):
        of_program = f"the names of matrices of {programs[program]}" if program in programs else ""
        raise ModelError(f"give --mass and --stiffness, {of_program or 'or a file of a program, such as --calculix or --ansys'}")
    if not needs_names and given:
        raise ModelError(f"--{next(iter(given))} does not belong to --{program}, which has its own matrices")
    if (speed is not None or frequency is not None) and program != "ross":
        raise ModelError("--speed and --frequency belong to --ross")
    names = labels if labels is None or isinstance(labels, list) else read_labels(labels)
    if names is not None and program not in ("", "op4", "matlab"):
        raise ModelError(f"--labels does not belong to --{program}, which names its degrees of freedom")
    more: dict[str, Any] = {"unit_system": units}
    if program == "calculix":
        model = from_calculix(calculix, source=f"CalculiX: {calculix}", **more)
    elif program == "nastran":
        model = from_nastran(nastran, given, source=f"Nastran: {nastran}", **more)
    elif program == "abaqus":
        model = from_abaqus(given, source="Abaqus: " + ", ".join(map(str, given.values())), **more)
    elif program == "ansys":
        model = _from_ansys(ansys, more)
    elif program == "substructure":
        found, pairs = substructures.read_substructure(substructure)
        rows = [f"n{node}.{DIRECTIONS[direction]}" for node, direction in pairs]
        model = Structure(**found, **nodes_of_labels(_checked(rows, substructure)), source=f"Abaqus: {substructure}", **more)
    elif program == "ross":
        model = _from_ross(ross, speed, frequency, more)
    else:
        reader = {"op4": matrix_files.read_output4, "matlab": matrix_files.read_matlab}.get(program)
        path = programs.get(program)
        read = {name: read_matrix(file) for name, file in given.items()} if reader is None else reader(path, given)
        for name in {"mass", "stiffness"} - set(read):
            raise ModelError(f"file '{path}': '{given[name]}' is a single zero")
        model = _with_labels(read, names, ", ".join(map(str, given.values())) if reader is None else f"{program}: {path}", more)
        if labels is not None and not isinstance(labels, list) and Path(labels).suffix.lower() in (".asm", ".pch", ".bdf"):
            model.notes += name_frames(model, bulk_data.frames_of(labels))
    _drop_empty(model, drop_empty)
    if mesh is not None:
        model.notes += [f"{mesh}: {note}" for note in add_mesh(model, mesh, in_order)]
    _add_sets(model, sets or {})
    model.validate()
    return model


def _from_ansys(path: Any, more: dict[str, Any]) -> Structure:
    from nhbm import ansys

    found, rows, held = ansys.read_full(path)
    labels = [f"n{node}.{direction}" for node, direction in rows]
    model = Structure(**found, **nodes_of_labels(_checked(labels, path)), source=f"Ansys: {path}", **more)
    if held:
        shown = ", ".join(f"n{node}.{direction}" for node, direction in held[:3]) + ", ..." * (len(held) > 3)
        model.notes.append(f"{path}: {len(held)} constrained degrees of freedom are left out: {shown}")
    return model


def _from_ross(rotor: Any, speed: float | None, frequency: float | None, more: dict[str, Any]) -> Structure:
    from nhbm import ross_rotors

    return _shaft_of_ross(rotor, *ross_rotors.read_rotor(rotor, speed, frequency), more)


def _shaft_of_ross(
    rotor: Any, found: dict[str, Any], rows: list[tuple[int, str]], positions: Any, more: dict[str, Any]
) -> Structure:
    labels = [f"n{node}.{direction}" for node, direction in rows]
    source = f"ROSS: {rotor}" if isinstance(rotor, (str, Path)) else "ROSS"
    model = Structure(**found, **nodes_of_labels(labels), source=source, **more)
    model.coordinates = positions
    model.cell_types = np.full(len(positions) - 1, 3)
    model.cell_starts = 2 * np.arange(len(positions))
    order = np.argsort(positions[:, 2], kind="stable")
    model.cell_nodes = np.column_stack([order[:-1], order[1:]]).ravel()
    return model


def import_rotor(ross: Any, speed: float, **groups: Any) -> Model:
    """The model of a Rotor of ROSS, or of its file (.toml), at a speed [rad/s] that is its tone 1: bearings and seals keep their
    tables over speed and frequency of the whirl (`&bearing`), and these and gyroscopic terms follow the tone along curves.

    Between the rows of tables the monotone cubics of `&bearing` apply, not those of ROSS. groups: of `nhbm.Model`."""
    from nhbm import ross_rotors
    from nhbm.model import Model

    found, rows, positions, bearings = ross_rotors.read_tables(ross)
    structure = _shaft_of_ross(ross, found, rows, positions, {})
    structure.validate()
    made = Model(structure, tones=[speed], **groups)
    made.set("structure", speed=[speed])
    made.tie("structure.speed[0]", "tones[0]")
    for i, bearing in enumerate(bearings):
        follows = bearing["speeds"] is not None
        keys: dict[str, Any] = {"speed": speed} if follows else {}
        made.bearing(**bearing, **keys)
        if follows:
            made.tie(f"bearing({i + 1})%speed", "tones[0]")
    return made


def _with_labels(read: dict[str, Any], names: list[str] | None, source: str, more: dict[str, Any]) -> Structure:
    """Structure of matrices and names of their rows, which are made valid."""
    n = next(iter(read.values())).shape[0]
    given = names or [f"x{i + 1}" for i in range(n)]
    for name, matrix in read.items():
        if matrix.shape[0] != len(given):
            raise ModelError(f"{source}: matrix '{name}' has {matrix.shape[0]} rows, there are {len(given)} labels")
    labels = _checked(valid_labels(given), "labels") if names else given
    model = Structure(**read, **nodes_of_labels(labels), source=source, **more)
    if labels != given:
        model.original_labels = given
        one, made = next((a, b) for a, b in zip(given, labels) if a != b)
        model.notes.append(f"labels were made valid, such as {one}: {made}; the model file keeps the original ones")
    return model


def _drop_empty(model: Structure, is_wanted: bool) -> None:
    """Rows without mass and stiffness are named, or left out."""

    def rows_without(*matrices: Any) -> np.ndarray:
        return np.flatnonzero(np.asarray(sum(abs(one) + abs(one).T for one in matrices).sum(axis=1)).ravel() == 0)

    empty = rows_without(*model.matrices().values())
    loose = np.setdiff1d(rows_without(model.stiffness), empty)
    if len(loose):
        which = f"{len(loose)} of {model.n_dofs} degrees of freedom, the first of which is {model.labels[loose[0]]},"
        model.notes.append(f"{which} have no stiffness")
    if not len(empty):
        return
    first = model.labels[empty[0]]
    which = f"{len(empty)} of {model.n_dofs} degrees of freedom, the first of which is {first} (row {empty[0] + 1}),"
    why = "as constrained ones that a file keeps"
    if not is_wanted:
        model.notes.append(f"{which} have neither mass nor stiffness, {why}; --drop-empty leaves them out")
        return
    if len(empty) == model.n_dofs:
        raise ModelError("all rows of the matrices are empty")
    model.notes.append(f"{which} have neither mass nor stiffness, {why}, and are left out")
    kept = np.setdiff1d(np.arange(model.n_dofs), empty)
    for name, matrix in model.matrices().items():
        setattr(model, name, sp.csr_matrix(matrix[kept][:, kept]))
    for name in ("labels", "units", "dof_direction", "original_labels"):
        values = getattr(model, name)
        setattr(model, name, None if values is None else [values[i] for i in kept])
    model.dof_node = np.asarray(model.dof_node)[kept]


def _add_sets(model: Structure, sets: dict[str, list[int]]) -> None:
    index = {int(number): i for i, number in enumerate(model.node_numbers)}
    for name, numbers in sets.items():
        absent = next((number for number in numbers if number not in index), None)
        if absent is not None:
            raise ModelError(f"set {name}: there is no node {absent}")
        model.sets[name] = np.array([index[number] for number in numbers])


def read_matrix(path: Any) -> sp.csr_matrix:
    """One matrix, its format by the end of the file's name."""
    path = _existing(path)
    try:
        _check_size(path)
        if path.suffix == ".npy":
            raise ValueError("it is a dense array of NumPy; scipy.sparse.save_npz writes one that is read here, as .npz")
        if path.suffix.lower() in matrix_files.HARWELL_BOEING:
            matrix = matrix_files.read_harwell_boeing(path)
        elif path.suffix != ".npz" and not _has_sizes(path):
            raise ValueError("it ends before the line with the sizes")
        else:
            matrix = sp.load_npz(path) if path.suffix == ".npz" else matrix_files.read_by_scipy(scipy.io.mmread, path)
        if sp.issparse(matrix) and matrix.format in ("csr", "csc", "bsr"):
            matrix.check_format()  # indices, which SciPy does not look at when it loads them
        matrix = sp.csr_matrix(matrix)
    except (ValueError, TypeError, OSError, KeyError, IndexError, MemoryError, EOFError, NotImplementedError, zipfile.BadZipFile,
            zlib.error) as error:  # fmt: skip
        raise ModelError(f"file '{path}' holds no sparse matrix: {error}{_of_abaqus(path)}") from None
    return matrix_files.checked(matrix, path)


def _of_abaqus(path: Path) -> str:
    """A hint for a file that is not in the Matrix Market format but a table of Abaqus."""
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
    """Labels, a line each; of Ansys' mapping file row, node and direction a line, of Nastran's .asm and .pch the entry EXTRN."""
    path = Path(path)
    if path.suffix.lower() in (".asm", ".pch", ".bdf"):
        found = [f"n{point}.{DIRECTIONS.get(component, 's')}" for point, component in bulk_data.external_rows(path)]
        return _checked(found, path)
    text = _text(path)
    rows = [match.groups() for match in re.finditer(r"^\s*(\d+)\s+(\d+)\s+([A-Za-z]+)\s*$", text, re.MULTILINE)]
    if rows:
        if [int(row) for row, _, _ in rows] != list(range(1, len(rows) + 1)):
            raise ModelError(f"file '{path}': rows must count from 1 to {len(rows)}")
        return [f"{node}.{direction}" for _, node, direction in rows]
    return text.split()


def valid_labels(given: list[str]) -> list[str]:
    """Labels as the input needs them: node and direction, `11.1`, `12:UX`, `1X+`, become `n11.x`; others that do not begin by a
    letter get a d in front."""
    found = []
    for label in given:
        match = re.fullmatch(r"[nN]?(\d+)[.:_ ]?(?:(ROT|R|U|)([XYZ])\+?|(?<=[.:_ ])([1-6]))", label.upper())
        if match and match[4]:
            found.append(f"n{match[1]}.{DIRECTIONS[int(match[4])]}")
        elif match:
            found.append(f"n{match[1]}.{'r' if match[2] in ('R', 'ROT') else ''}{match[3].lower()}")
        else:
            found.append(label if label[:1].isalpha() else f"d{label}")
    return found


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
            raise ModelError(f"file '{files['labels']}': '{line}' is not a node and direction, such as 12.3")
        labels.append(f"n{node}.{DIRECTIONS[int(direction)]}")
    if not labels:
        raise ModelError(f"file '{files['labels']}' names no degree of freedom")
    repeated = next((label for label, n in Counter(labels).items() if n > 1), "")
    if repeated:
        raise ModelError(f"file '{files['labels']}' names {repeated} twice: CalculiX expands beams, shells, plane elements to "
                         "nodes of its own, which have the numbers of yours; model the part by solid elements")  # fmt: skip
    n = len(_checked(labels, files["labels"]))
    matrices = {name: _triangle(files[name], n, _CYCLIC) for name in ("stiffness", "mass")}
    return Structure(**matrices, **nodes_of_labels(labels), **more)


def _triangle(path: Any, n: Any, hint: str = "") -> sp.csr_matrix:
    """Symmetric matrix of which one triangle with its whole diagonal stands in a file, column by column, as row, column, value.
    `hint`: why it may have more than `n` rows."""
    table = _table(path, 3, 2)
    outside = ((table[:, :2] < 1) | (table[:, :2] > n)).any(axis=1)
    if outside.any():
        i, j = table[np.argmax(outside), :2]
        raise ModelError(f"file '{path}' has an entry in row {i:.0f}, column {j:.0f} of {n}; they count from 1"
                         + hint * bool(table[:, :2].max() == 2 * n))  # fmt: skip
    row, column = (table[:, :2].astype(np.int64) - 1).T
    absent = np.setdiff1d(np.arange(n), row[row == column])
    if len(absent) or not Path(path).read_bytes().endswith(b"\n"):
        where = f"row {absent[0] + 1} of {n} is without its diagonal" if len(absent) else "its last line has no end"
        raise ModelError(f"file '{path}' is not whole: {where}")
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
    model = Structure(**matrices, **nodes_of_labels(labels), **more)
    for name, path in paths.items():
        _check_diagonal(model, name, f"file '{path}'")
    return model


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
    for name, card in names.items():
        _check_diagonal(model, name, f"file '{path}': DMIG '{card}'")
    name_frames(model, bulk_data.frames_of(path))
    return model


def _check_diagonal(model: Structure, name: str, what: str) -> None:
    """A symmetric stiffness or mass has the diagonal of each row that has other terms, unless the row is of a multiplier of a
    constraint: one that is absent is a sign of columns that are missing, in formats without a count of terms."""
    matrix = model.matrices()[name]
    if name not in ("stiffness", "mass") or (matrix != matrix.T).nnz:
        return
    bare = np.flatnonzero((np.asarray(abs(matrix).sum(axis=1)).ravel() > 0) & (matrix.diagonal() == 0))
    if len(bare):
        raise ModelError(f"{what}: {model.labels[bare[0]]} has terms, but none on the diagonal: the file is not whole, or this is "
                         "the multiplier of a constraint; let the program that writes it eliminate constraints")  # fmt: skip


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
        raise ModelError(f"file '{path}' is not a text file") from None


def _existing(path: Any) -> Path:
    path = Path(path)
    if not path.is_file():
        raise ModelError(f"file '{path}' does not exist")
    return path
