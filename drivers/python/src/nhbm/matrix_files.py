"""Matrices by their names or in their own files: Harwell-Boeing, MATLAB (.mat up to 7.3), OUTPUT4 of Nastran (by pyyeti)."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp

from nhbm.errors import ModelError, check_file, imported

_ASYMMETRY = 1e-6  # relative, of a matrix that a file calls symmetric; rounding leaves 1e-15
HARWELL_BOEING = (".hb", ".rb", ".rsa", ".rua", ".matrix")  # ends of names


def read_by_scipy(reader: Any, path: Any, **options: Any) -> Any:
    """What a reader of SciPy gives, without its notice that sparse matrices become arrays: either is taken here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return reader(path, **options)


def read_harwell_boeing(path: Path) -> sp.csr_matrix:
    """A real assembled matrix, in text: of a symmetric one (RSA) the lower triangle is stored. ValueError where it is damaged.
    Source: Duff, Grimes, Lewis, Users' Guide for the Harwell-Boeing Sparse Matrix Collection (1992)."""
    with open(path, encoding="ascii") as file:
        file.readline()
        counts = [int(word) for word in file.readline().split()]
        words = file.readline().split()
        kind, (n_rows, n_columns, n_entries) = words[0].upper(), (int(word) for word in words[1:4])
        forms = re.findall(r"\(([^()]*)\)", file.readline())
        if kind not in ("RSA", "RUA") or len(forms) < 3:
            raise ValueError(f"it is of the type {kind}; RSA and RUA are read" if len(forms) >= 3 else "it has no formats")
        if len(counts) > 4 and counts[4] > 0:
            file.readline()
        starts = np.array(_column(file, forms[0], n_columns + 1, int)) - 1
        rows = np.array(_column(file, forms[1], n_entries, int)) - 1
        values = np.array(_column(file, forms[2], n_entries, float))
    matrix = sp.csc_matrix((values, rows, starts), shape=(n_rows, n_columns))
    matrix.check_format()
    if kind == "RSA":
        if matrix.nnz and sp.triu(matrix, 1).nnz and sp.tril(matrix, -1).nnz:
            raise ValueError("of the type RSA it has entries on both sides of the diagonal")
        matrix = matrix + matrix.T - sp.diags(matrix.diagonal())
    return sp.csr_matrix(matrix)


def _column(file: Any, form: str, n: int, kind: Any) -> list[Any]:
    """Numbers in fields of a Fortran format such as 4E20.12."""
    match = re.search(r"(\d*)\s*[IEDFGiedfg]\s*(\d+)", form)
    if match is None:
        raise ValueError(f"'{form}' is not a format of numbers")
    width = int(match[2])
    found: list[Any] = []
    while len(found) < n:
        line = file.readline()
        if not line.strip():
            raise ValueError("it ends too soon")
        text = line.rstrip("\n").replace("D", "E").replace("d", "e")
        found += [kind(text[k : k + width]) for k in range(0, len(text.rstrip()), width)]
    return found[:n]


def read_matlab(path: Any, names: dict[str, str]) -> dict[str, sp.csr_matrix]:
    """Variables of a .mat file: full or sparse, of any version."""
    path = Path(path)
    check_file(path)
    return {name: _real_square(value, f"file '{path}': '{names[name]}'") for name, value in _variables(path, names).items()}


def _variables(path: Path, names: dict[str, str]) -> dict[str, Any]:
    try:
        if h5py.is_hdf5(path):
            with h5py.File(path) as file:
                known = [name for name in file if not name.startswith("#")]
                _reject_unknown(path, names, known)
                return {name: _of_hdf5(file[variable]) for name, variable in names.items()}
        known = [name for name, _, _ in scipy.io.whosmat(path)]
        _reject_unknown(path, names, known)
        found = read_by_scipy(scipy.io.loadmat, path, variable_names=list(names.values()))
        return {name: found[variable] for name, variable in names.items()}
    except ModelError:
        raise
    except Exception as error:  # SciPy and h5py raise whatever they meet
        raise ModelError(f"file '{path}' is no .mat file that can be read: {' '.join(str(error).split())}") from None


def _reject_unknown(path: Path, names: dict[str, str], known: list[str]) -> None:
    for variable in names.values():
        if variable not in known:
            raise ModelError(f"file '{path}' has no variable '{variable}'; it has {', '.join(known) or 'none'}")


def _of_hdf5(item: Any) -> Any:
    """A variable of MATLAB 7.3: a dataset, which is transposed, or a group with columns by data, ir and jc."""
    if isinstance(item, h5py.Dataset):
        if item.dtype.kind == "V":
            raise ValueError(f"{item.name} is complex")
        if item.attrs.get("MATLAB_empty", 0) or item.attrs.get("MATLAB_class", b"") == b"char":
            raise ValueError(f"{item.name} is {'empty' if item.attrs.get('MATLAB_empty', 0) else 'text'}")
        return item[()].T
    if "MATLAB_sparse" not in item.attrs or "jc" not in item:
        raise ValueError(f"{item.name} is not a matrix")
    starts = item["jc"][()].astype(np.int64)
    rows = item["ir"][()].astype(np.int64) if "ir" in item else np.zeros(0, dtype=np.int64)
    values = item["data"][()] if "data" in item else np.zeros(0)
    if values.dtype.kind == "V":
        raise ValueError(f"{item.name} is complex")
    shape = int(item.attrs["MATLAB_sparse"]), len(starts) - 1
    matrix = sp.csc_matrix((values.astype(float), rows, starts), shape=shape)
    matrix.check_format()
    return matrix


def read_output4(path: Any, names: dict[str, str]) -> dict[str, sp.csr_matrix]:
    """Matrices of an OUTPUT4 file of Nastran; `kaa#2` is the second of those that are called kaa. Those of 1 x 1 zeros beside
    larger ones are absent ones: Nastran writes them for damping that the model has not."""
    path = Path(path)
    check_file(path)
    op4 = imported("pyyeti.nastran.op4", "OUTPUT4 is read with", "pyyeti")
    try:
        known, values, forms, _ = op4.load(str(path), into="list", sparse=None)
    except Exception as error:  # it raises whatever it meets
        raise ModelError(f"file '{path}' is no OUTPUT4 that pyyeti reads: {' '.join(str(error).split())}") from None
    by_name: dict[str, list[Any]] = {}
    symmetric = set()
    for name, value, form in zip(known, values, forms):
        by_name.setdefault(str(name).lower(), []).append(value)
        symmetric |= {id(value)} if form == 6 else set()
    found = {}
    for name, wanted in names.items():
        stem, _, which = wanted.lower().partition("#")
        given = by_name.get(stem, [])
        if not given:
            raise ModelError(f"file '{path}' has no matrix '{wanted}'; it has {', '.join(by_name) or 'none'}")
        if len(given) > 1 and not which:
            sizes = ", ".join(f"{wanted}#{k} of {value.shape[0]} rows" for k, value in enumerate(given, start=1))
            raise ModelError(f"file '{path}' has {len(given)} matrices '{wanted}': give {sizes}")
        if which and not (which.isdigit() and 1 <= int(which) <= len(given)):
            raise ModelError(f"file '{path}' has {len(given)} matrices '{stem}', no '{wanted}'")
        value = given[int(which or 1) - 1]
        matrix = found[name] = _real_square(value, f"file '{path}': '{wanted}'")
        if id(value) in symmetric and abs(matrix - matrix.T).max() > _ASYMMETRY * abs(matrix).max():
            raise ModelError(f"file '{path}': '{wanted}' is called symmetric (form 6) and is not: it is damaged")
    largest = max(matrix.shape[0] for matrix in found.values())
    return {name: matrix for name, matrix in found.items() if largest == 1 or matrix.shape[0] > 1 or matrix.nnz > 0}


def _real_square(value: Any, what: str) -> sp.csr_matrix:
    try:
        matrix = sp.csr_matrix(value)
    except (TypeError, ValueError):
        raise ModelError(f"{what} is not a matrix") from None
    matrix = checked(matrix, what)
    matrix.eliminate_zeros()
    return sp.csr_matrix(matrix.astype(float))


def checked(matrix: sp.csr_matrix, what: Any) -> sp.csr_matrix:
    """The matrix, if it is real, square and finite."""
    what = f"file '{what}': the matrix" if isinstance(what, Path) else what
    if matrix.dtype.kind not in "fiub":
        kind = "complex" if matrix.dtype.kind == "c" else f"of type {matrix.dtype}"
        raise ModelError(f"{what} is {kind}, not real; give an imaginary part of K as --structural")
    if matrix.shape[0] != matrix.shape[1] or 0 in matrix.shape:
        raise ModelError(f"{what} is {matrix.shape[0]} x {matrix.shape[1]}, not square")
    if not np.isfinite(matrix.data).all():
        at = matrix.tocoo()
        e = int(np.argmin(np.isfinite(at.data)))
        raise ModelError(f"{what}: the entry in row {at.row[e] + 1}, column {at.col[e] + 1} is not a finite number")
    return matrix
