#!/usr/bin/env bash
# CalculiX 2.20 stores K and M by *FREQUENCY, SOLVER=MATRIXSTORAGE as text of 14 digits. Of a slender part this is not
# enough: the lowest frequency of K and M from .sti and .mas differs from that of its own modal step, which prints 7
# digits, in the fifth. Seen for a bar of 200 bricks, 4 m by 5 mm: relative difference above 1e-6 in the lowest
# frequency, below 1e-6 for a bar of 20 mm.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
command -v ccx >/dev/null || apt-get install --yes --quiet calculix-ccx=2.20-1 >/dev/null
[[ $(ccx -v || true) == *2.20* ]] || { echo "another version of CalculiX"; exit 1; }
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 scipy==1.18.1
env/bin/python - <<'END'
import re, subprocess
import numpy as np, scipy.sparse as sp
from scipy.sparse.linalg import eigsh
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

def difference(nx, length):
    for name, solver in (("modes", ""), ("stored", ", SOLVER=MATRIXSTORAGE")):
        open(f"{name}.inp", "w").write(bar(nx, length) + f"*STEP\n*FREQUENCY{solver}\n2\n*END STEP\n")
        ccx(name)
    printed = float(re.search(r"^ +1 +\S+ +(\S+)", open("modes.dat").read(), re.MULTILINE)[1])
    matrices = []
    for end in ("sti", "mas"):
        i, j, x = np.loadtxt(f"stored.{end}").T
        n = int(i.max())
        upper = sp.coo_matrix((x, (i.astype(int) - 1, j.astype(int) - 1)), (n, n)).tocsc()
        matrices.append(upper + upper.T - sp.diags(upper.diagonal()))
    w = np.sqrt(eigsh(matrices[0], 1, matrices[1], sigma=0.0)[0][0])
    word = open("stored.sti").readline().split()[2]
    return printed, w, abs(w / printed - 1), len(re.sub(r"[eE].*|[^0-9]", "", word))
for nx, length, is_short in ((4, 0.02, True), (200, 4.0, False)):
    printed, stored, relative, digits = difference(nx, length)
    print(f"{length} m: modal step {printed} rad/s, of K and M {stored:.9g}, relative difference {relative:.1e}; {digits} digits")
    assert digits == 14 and (relative < 1e-6) == is_short, "this has changed"
END
