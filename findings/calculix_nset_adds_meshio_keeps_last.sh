#!/usr/bin/env bash
# CalculiX 2.20 adds the nodes of a second *NSET of the same name and keeps the order of a set; meshio 5.3.5 keeps the
# last part only, without a word. Who takes contact nodes from meshio loses the first part. Seen: CalculiX prints
# displacements of nodes 45, 44, 37, 38; meshio's set has two nodes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
command -v ccx >/dev/null || apt-get install --yes --quiet calculix-ccx=2.20-1 >/dev/null
[[ $(ccx -v || true) == *2.20* ]] || { echo "another version of CalculiX"; exit 1; }
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 meshio==5.3.5
env/bin/python - <<'END'
import re, subprocess
import meshio, numpy as np
def bar(nx, lx, sets="", kind="C3D8", step="2"):
    """A clamped bar of nx x 2 x 2 bricks as a deck of CalculiX."""
    number = np.arange(1, 9 * (nx + 1) + 1).reshape(nx + 1, 3, 3)
    at = np.indices(number.shape).reshape(3, -1).T * [lx / nx, 0.0025, 0.0025]
    cells = number[:-1, :-1, :-1].reshape(-1, 1) + [0, 9, 12, 3, 1, 10, 13, 4]
    deck = "*NODE, NSET=all\n" + "".join(f"{n}, {x:.12g}, {y:.12g}, {z:.12g}\n" for n, (x, y, z) in enumerate(at, 1))
    deck += f"*ELEMENT, TYPE={kind}, ELSET=bar\n" + "".join(f"{n}, {', '.join(map(str, c))}\n" for n, c in enumerate(cells, 1))
    deck += "*NSET, NSET=root\n" + "".join(f"{n},\n" for n in range(1, 10)) + sets
    deck += "*MATERIAL, NAME=steel\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7800.\n*SOLID SECTION, ELSET=bar, MATERIAL=steel\n*BOUNDARY\nroot, 1, 3\n"
    return deck

def ccx(name):
    with open(f"{name}.log", "w") as log:
        subprocess.run(["ccx", "-i", name], stdout=log, stderr=log)  # its exit status differs between versions

sets = "*NSET, NSET=tip\n45, 44\n*NSET, NSET=tip\n37, 38\n"
deck = bar(4, 0.02, sets) + "*STEP\n*STATIC\n*CLOAD\n45, 3, 1.0\n*NODE PRINT, NSET=tip\nU\n*END STEP\n"
open("bar.inp", "w").write(deck)
ccx("bar")
printed = [int(n) for n in re.findall(r"^ +(\d+) +\S+ +\S+ +\S+$", open("bar.dat").read(), re.MULTILINE)]
read = [int(n) + 1 for n in meshio.read("bar.inp").point_sets["tip"]]
print("CalculiX:", printed, "meshio", meshio.__version__, ":", read)
assert printed == [45, 44, 37, 38] and sorted(read) == [37, 38], "this has changed"
END
