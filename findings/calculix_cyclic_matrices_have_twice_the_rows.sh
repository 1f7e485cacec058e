#!/usr/bin/env bash
# CalculiX 2.20 stores for *FREQUENCY, SOLVER=MATRIXSTORAGE of a *CYCLIC SYMMETRY MODEL the real and imaginary part of
# one nodal diameter as one real matrix: .sti has twice as many rows as .dof has lines, and off-diagonal entries that
# are no stiffness of the sector. Seen for a ring sector of 90 degrees.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
command -v ccx >/dev/null || apt-get install --yes --quiet calculix-ccx=2.20-1 >/dev/null
[[ $(ccx -v || true) == *2.20* ]] || { echo "another version of CalculiX"; exit 1; }
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6
env/bin/python - <<'END'
import subprocess
import numpy as np

def ccx(name):
    with open(f"{name}.log", "w") as log:
        subprocess.run(["ccx", "-i", name], stdout=log, stderr=log)  # its exit status differs between versions

n_angle, sectors = 4, 4
nodes, number = {}, {}
for k, angle in enumerate(np.linspace(0, 2 * np.pi / sectors, n_angle + 1)):
    for r in (0, 1):
        for z in (0, 1):
            number[k, r, z] = len(nodes) + 1
            nodes[len(nodes) + 1] = ((0.1 + 0.02 * r) * np.cos(angle), (0.1 + 0.02 * r) * np.sin(angle), 0.02 * z)
deck = "*NODE, NSET=all\n" + "".join(f"{n}, {x:.12g}, {y:.12g}, {z:.12g}\n" for n, (x, y, z) in nodes.items())
deck += "*ELEMENT, TYPE=C3D8, ELSET=ring\n"
for k in range(n_angle):
    corners = [number[k + a, r, z] for z in (0, 1) for a, r in ((0, 0), (0, 1), (1, 1), (1, 0))]
    deck += f"{k + 1}, " + ", ".join(map(str, corners)) + "\n"
deck += "*SURFACE, NAME=low\n1, S3\n*SURFACE, NAME=high\n"
deck += f"{n_angle}, S5\n*TIE, CYCLIC SYMMETRY, NAME=tie\nhigh, low\n*CYCLIC SYMMETRY MODEL, N={sectors}, NGRAPH=1, TIE=tie, ELSET=ring\n"
deck += "0., 0., 0., 0., 0., 1.\n*MATERIAL, NAME=steel\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7800.\n"
deck += "*SOLID SECTION, ELSET=ring, MATERIAL=steel\n*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n2\n"
open("ring.inp", "w").write(deck + "*SELECT CYCLIC SYMMETRY MODES, NMIN=1, NMAX=1\n*END STEP\n")
ccx("ring")
rows = len(open("ring.dof").read().split())
highest = int(np.loadtxt("ring.sti")[:, :2].max())
print(f"{rows} lines in .dof, rows up to {highest} in .sti")
assert highest == 2 * rows > 0, "this has changed"
END
