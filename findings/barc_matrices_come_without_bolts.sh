#!/usr/bin/env bash
# visualdynamics 0.1.0a74 builds the BARC, a bolted benchmark structure; sparse_matrices() of its model returns mass and
# stiffness, in this order, without the rigid ties that are its bolts. Alone they have 24 zero frequencies and a first
# elastic one of about 87 Hz; with T of constraint_transform, T'KT and T'MT, 6 and 196.29 Hz. Needs Python 3.12 or
# later.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3.13}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 scipy==1.18.1 visualdynamics==0.1.0a74
env/bin/python - <<'END'
import numpy as np
from scipy.sparse.linalg import LinearOperator, eigs, splu
from visualdynamics.demo import barc
model = barc.build(0.25)
mass, stiffness = model.sparse_matrices()
ties = model.constraint_transform(sparse=True)
def frequencies(mass, stiffness, n):
    shift = 1e-6 * abs(stiffness.diagonal()).max() / abs(mass.diagonal()).max()
    factors = splu((stiffness + shift * mass).tocsc())
    operator = LinearOperator(mass.shape, matvec=lambda x: factors.solve(mass @ x))
    return np.sqrt(np.sort(abs(1 / eigs(operator, n, return_eigenvectors=False).real - shift))) / (2 * np.pi)
alone, tied = frequencies(mass, stiffness, 26), frequencies(ties.T @ mass @ ties, ties.T @ stiffness @ ties, 8)
print("without ties:", (alone < 5).sum(), "near zero, then", alone[alone >= 5][0].round(2), "Hz; with them:", (tied < 5).sum(), "and", tied[6].round(2))
assert (alone < 5).sum() == 24 and alone[alone >= 5][0] < 100 and abs(tied[6] - 196.29) < 0.01, "this has changed"
END
