#!/usr/bin/env bash
# CalculiX 2.20 expands beams and shells to bricks. In the list of rows that *FREQUENCY, SOLVER=MATRIXSTORAGE writes
# (.dof) the rows of the nodes of the expansion have the names of the nodes of the deck, so that one name stands for
# several rows. Seen for 4 B31 elements: far fewer names than rows.
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

def ccx(name):
    with open(f"{name}.log", "w") as log:
        subprocess.run(["ccx", "-i", name], stdout=log, stderr=log)  # its exit status differs between versions

deck = "*NODE, NSET=all\n" + "".join(f"{n}, {0.1 * (n - 1)}, 0., 0.\n" for n in range(1, 6))
deck += "*ELEMENT, TYPE=B31, ELSET=bar\n" + "".join(f"{n}, {n}, {n + 1}\n" for n in range(1, 5))
deck += "*MATERIAL, NAME=steel\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7800.\n"
deck += "*BEAM SECTION, ELSET=bar, MATERIAL=steel, SECTION=RECT\n0.01, 0.02\n0., 1., 0.\n*BOUNDARY\n1, 1, 6\n"
open("beam.inp", "w").write(deck + "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n2\n*END STEP\n")
ccx("beam")
rows = open("beam.dof").read().split()
print(f"{len(rows)} rows, {len(set(rows))} names")
assert len(set(rows)) < len(rows), "this has changed"
END
