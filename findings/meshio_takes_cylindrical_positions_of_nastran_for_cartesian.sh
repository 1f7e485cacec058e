#!/usr/bin/env bash
# The third field of a GRID of Nastran names the coordinate system of its position. meshio 5.3.5 reads it over: radius,
# angle [degrees] and height of a cylindrical system become x, y, z, without a word. Wheels and shafts are usually
# written so. Seen: (2, 90 degrees, 0) becomes the point (2, 90, 0) instead of (0, 2, 0).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 meshio==5.3.5
cat >disc.bdf <<'END_OF_DECK'
CEND
BEGIN BULK
CORD2C,7,0,0.,0.,0.,0.,0.,1.
,1.,0.,0.
GRID,1,7,2.,90.,0.
GRID,2,7,2.,0.,0.
GRID,3,0,0.,0.,0.
CTRIA3,1,1,1,2,3
ENDDATA
END_OF_DECK
env/bin/python - <<'END'
import meshio

points = meshio.read("disc.bdf").points.tolist()
print(f"meshio {meshio.__version__}: point 1 at radius 2, 90 degrees is {points[0]}")
assert points[0] == [2.0, 90.0, 0.0]
END
