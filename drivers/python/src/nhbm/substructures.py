"""Substructures of Abaqus, as *SUBSTRUCTURE MATRIX OUTPUT writes them (.mtx): *USER ELEMENT with *MATRIX, TYPE=STIFFNESS, MASS."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from nhbm.errors import ModelError, check_file

_KINDS = {"STIFFNESS": "stiffness", "MASS": "mass", "STRUCTURAL DAMPING": "structural", "VISCOUS DAMPING": "damping"}


def read_substructure(path: Any) -> tuple[dict[str, sp.csr_matrix], list[tuple[int, int]]]:
    """Matrices, and node and direction (1 to 6) of each row. Nodes are listed in the comments behind ** ELEMENT NODES, the lines of
    *USER ELEMENT count their positions in this list. Matrices are given by rows, one triangle up to the diagonal, but the
    stiffness of an unsymmetric element, which is given in full."""
    path = Path(path)
    check_file(path)
    nodes: list[int] = []
    layout: list[list[int]] = []
    texts: dict[str, list[float]] = {}
    n_nodes, is_unsymmetric, state = 0, False, ""
    for number, raw in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        line = raw.strip().upper()
        if not line:
            continue
        try:
            if line.startswith("**"):
                if "ELEMENT NODES" in line:
                    state = "nodes"
                elif state == "nodes":
                    nodes += _whole(line[2:])
            elif line.startswith("*"):
                words = [word.strip() for word in line[1:].split(",")]
                state = words[0]
                if state == "USER ELEMENT":
                    if n_nodes:
                        raise ValueError("there is more than one *USER ELEMENT")
                    n_nodes = int(next(word.split("=")[1] for word in words if word.startswith("NODES")))
                    is_unsymmetric = "UNSYM" in words
                elif state == "MATRIX":
                    kind = next(word.split("=")[1].strip() for word in words if word.startswith("TYPE"))
                    if kind not in _KINDS or _KINDS[kind] in texts:
                        raise ValueError(f"a matrix of the type {kind} {'twice' if kind in _KINDS else 'is not known'}")
                    state = _KINDS[kind]
                    texts[state] = []
            elif state in texts:
                texts[state] += [float(word.replace("D", "E")) for word in line.split(",") if word.strip()]
            elif state in ("nodes", "USER ELEMENT"):
                layout.append(_whole(line))
        except (ValueError, StopIteration) as error:
            raise ModelError(f"file '{path}', line {number}: '{raw.strip()}' is not understood ({error})") from None
    return _with_rows(path, nodes, layout, n_nodes, is_unsymmetric, texts)


def _whole(text: str) -> list[int]:
    return [int(word) for word in re.split(r"[,\s]+", text) if word]


def _with_rows(path: Path, nodes: list[int], layout: list[list[int]], n_nodes: int, is_unsymmetric: bool,
               texts: dict[str, list[float]]) -> tuple[dict[str, sp.csr_matrix], list[tuple[int, int]]]:  # fmt: skip
    """The matrices of the numbers, as many as the rows need."""
    if n_nodes == 0 or not layout:
        raise ModelError(f"file '{path}' has no *USER ELEMENT with its degrees of freedom: is it a substructure of Abaqus?")
    if len(nodes) != n_nodes:
        raise ModelError(f"file '{path}' names {len(nodes)} nodes in its comments behind '** ELEMENT NODES', its element has "
                         f"{n_nodes}: without them its rows belong to positions, not to nodes")  # fmt: skip
    of_position = {1: layout[0]} | {line[0]: line[1:] for line in layout[1:]}
    rows: list[tuple[int, int]] = []
    current: list[int] = []
    for position, node in enumerate(nodes, start=1):
        current = of_position.get(position, current)
        rows += [(node, direction) for direction in current]
    wrong = next((row for row in rows if not 1 <= row[1] <= 6), None)
    if wrong is not None:
        raise ModelError(f"file '{path}': direction {wrong[1]} of node {wrong[0]} is not between 1 and 6")
    n = len(rows)
    matrices = {}
    for name, values in texts.items():
        is_full = is_unsymmetric and name == "stiffness"
        expected = n * n if is_full else n * (n + 1) // 2
        if len(values) != expected or not np.isfinite(values).all():
            raise ModelError(f"file '{path}': the matrix '{name}' has {len(values)} numbers, {n} rows need {expected} finite ones")
        matrix = np.zeros((n, n))
        if is_full:
            matrix[:] = np.reshape(values, (n, n))
        else:
            matrix[np.tril_indices(n)] = values
            matrix += np.tril(matrix, -1).T
        matrices[name] = sp.csr_matrix(matrix)
    for name in ("stiffness", "mass"):
        if name not in matrices:
            raise ModelError(f"file '{path}' has no *MATRIX, TYPE={name.upper()}: ask for it by *SUBSTRUCTURE MATRIX OUTPUT, "
                             f"{name.upper()}=YES")  # fmt: skip
    return matrices, rows
