#!/usr/bin/env bash
# An OUTPUT4 file of Nastran may have one name several times, of different sizes: nas2cam.op4 of the tests of pyyeti
# 1.4.7 has KAA and MAA three times (46, 32 and 54 rows). A reader that makes a dictionary keeps the last, which belongs
# to another superelement; damping matrices that a model has not are there as 1 x 1 zeros (outboard.op4: BXX1, K4XX1).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 scipy==1.18.1 pyyeti==1.4.7
env/bin/python - <<'END'
from importlib.util import find_spec
from pathlib import Path
import pyyeti
from pyyeti.nastran import op4
folder = Path(find_spec("pyyeti").submodule_search_locations[0]) / "tests" / "nas2cam_extseout"
names, values, *_ = op4.load(str(folder / "nas2cam.op4"), into="list")
rows = [value.shape[0] for name, value in zip(names, values) if name == "kaa"]
kept = op4.load(str(folder / "nas2cam.op4"), into="dct")["kaa"][0].shape[0]
absent = {name: (value.shape, float(abs(value).max())) for name, value in zip(*op4.load(str(folder / "outboard.op4"), into="list")[:2])
          if name in ("bxx1", "k4xx1")}
print(pyyeti.__version__, "kaa of", rows, "rows; a dictionary has", kept, ";", absent)
assert rows == [46, 32, 54] and kept == 54 and set(absent.values()) == {((1, 1), 0.0)}, "this has changed"
END
