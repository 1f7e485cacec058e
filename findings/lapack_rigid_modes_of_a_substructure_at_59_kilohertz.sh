#!/usr/bin/env bash
# A substructure of Abaqus (symmetric/outer.mtx of abaqus-mtx-parser 1.1.4) has rotations with next to no inertia: its
# mass is positive, with eigenvalues from about 1e-24 to 2e-8. scipy.linalg.eigh(K, M) of SciPy 1.17.1 (LAPACK dsygvd), the
# usual way to natural frequencies, gives no error, but negative squares of up to (59 kHz)^2 where the free part has zeros;
# K alone has no negative eigenvalue above rounding. eigh(M, K + s M) gives zeros. Seen: -59,022 Hz against .002 Hz.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 scipy==1.17.1 abaqus-mtx-parser==1.1.4
env/bin/python - <<'END'
import re
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import scipy
from scipy.linalg import eigh, eigvalsh

text = (Path(find_spec("abaqus_mtx_parser").submodule_search_locations[0]) / "mtx" / "symmetric" / "outer.mtx").read_text()


def matrix(kind):
    """The lower triangle, row by row, behind *MATRIX, TYPE=kind."""
    lines = re.search(rf"^\*MATRIX, *TYPE={kind}\s*\n([^*]*)", text, re.MULTILINE | re.IGNORECASE)[1]
    numbers = [float(word) for word in re.split(r"[,\s]+", lines) if word]
    n = int(np.sqrt(2 * len(numbers)))
    full = np.zeros((n, n))
    full[np.tril_indices(n)] = numbers
    return full + np.tril(full, -1).T


stiffness, mass = matrix("STIFFNESS"), matrix("MASS")
squares = eigh(stiffness, mass, eigvals_only=True)
shift = 1e-9 * np.trace(stiffness) / np.trace(mass)
shifted = 1 / eigh(mass, stiffness + shift * mass, eigvals_only=True)[::-1] - shift
hertz = np.sqrt(-squares[0]) / (2 * np.pi), np.sqrt(np.abs(shifted[:6]).max()) / (2 * np.pi)
k, m = eigvalsh(stiffness), eigvalsh(mass)
print(f"SciPy {scipy.__version__}: mass {m[0]:.1e} to {m[-1]:.1e}, stiffness from {k[0] / k[-1]:.0e} of the largest on")
print(f"lowest by eigh(K, M): -({hertz[0]:.0f} Hz)^2; of the first six by eigh(M, K + s M): below {hertz[1]:.4f} Hz")
assert squares[0] < 0 and hertz[0] > 1e3 and hertz[1] < 1 and m[0] > 0 and k[0] > -1e-12 * k[-1]
END
