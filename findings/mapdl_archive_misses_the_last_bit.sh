#!/usr/bin/env bash
# mapdl-archive 0.4.2 reads coordinates of an NBLOCK that are not the nearest floating-point numbers: 0.49999999999999
# becomes 0.49999999999999006. Coordinates of two readers of one file are then not equal, and coincident nodes are not
# found by equality. Seen on the TetBeam.cdb that the package brings: about 500 of 3123 coordinates differ from float()
# of the same text.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 mapdl-archive==0.4.2
env/bin/python - <<'END'
from pathlib import Path
import mapdl_archive, numpy as np
path = next(Path(mapdl_archive.__file__).parent.rglob("TetBeam.cdb"))
lines = path.read_text().splitlines()
start = next(k for k, line in enumerate(lines) if line.startswith("NBLOCK")) + 2
width = int(lines[start - 1].split("e")[1].split(".")[0])
digits = int(lines[start - 1].split("i")[1].split(",")[0]) * int(lines[start - 1].lstrip("(").split("i")[0])
theirs, text = np.asarray(mapdl_archive.Archive(str(path), parse_vtk=False).nodes)[:, :3], []
for line in lines[start : start + len(theirs)]:
    words = [line[k : k + width] for k in range(digits, len(line), width)][:3]
    text.append([float(word) for word in words] + [0.0] * (3 - len(words)))
wrong = theirs != np.array(text)
print(f"{wrong.sum()} of {wrong.size} differ, by up to {abs(theirs - np.array(text)).max():.1e}")
assert wrong.sum() > 100 and abs(theirs - np.array(text)).max() < 1e-14, "this has changed"
END
