#!/usr/bin/env bash
# Bulk data of Nastran may repeat entries: '=,*1,,*1.,==' is the GRID before with number and x one higher, '=6' does that
# six times more. pyyeti 1.4.7 (bulk.rdgrids) reads over such lines, without a word: the mesh has too few points. A deck
# of its own tests has them (cant_beam.dat: 8,222 points, one by rdgrids). Seen: 2 of 9 points.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 scipy==1.17.1 pyyeti==1.4.7
printf '%s\n' 'GRID,1,,0.,0.,0.' '=,*1,,*1.,==' '=6' 'GRID,20,,5.,0.,0.' >beam.bdf
env/bin/python - <<'END'
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from pyyeti.nastran import bulk

found = bulk.rdgrids("beam.bdf")
deck = Path(find_spec("pyyeti").submodule_search_locations[0]) / "tests" / "nas2cam_extseout" / "cant_beam.dat"
of_deck = len(bulk.rdgrids(str(deck)))
points = found[:, 0].astype(int).tolist()
print(f"pyyeti {version('pyyeti')}: points {points} of 1 to 8 and 20; {of_deck} of the 8222 of {deck.name}")
assert found[:, 0].tolist() == [1.0, 20.0] and of_deck == 1
END
