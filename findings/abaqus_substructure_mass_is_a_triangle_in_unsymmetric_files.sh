#!/usr/bin/env bash
# In an unsymmetric substructure that Abaqus writes (*USER ELEMENT, UNSYM; files of abaqus-mtx-parser 1.1.4) the
# stiffness is given in full, but the mass of the same file as a triangle: who reads both alike gets a mass of the wrong
# size or shape. Seen: 36 x 36 numbers of the stiffness, 36 x 37 / 2 of the mass; node numbers stand in comments only,
# and a line such as '46, 1, 2, 3, 4, 5, 6' begins with a place in their list.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 abaqus-mtx-parser==1.1.4
env/bin/python - <<'END'
import re
from importlib.util import find_spec
from pathlib import Path
folder = Path(find_spec("abaqus_mtx_parser").submodule_search_locations[0]) / "mtx"
def counts(path):
    parts = re.split(r"\*MATRIX,TYPE=(\w+)", path.read_text())[1:]
    return {kind: len(re.findall(r"[-+.\d]+(?:E[-+]\d+)?", body.upper())) for kind, body in zip(parts[::2], parts[1::2])}
found = counts(folder / "unsymmetric" / "total.mtx"), counts(folder / "symmetric" / "total.mtx")
head = (folder / "recovery" / "interface-beam-sub.mtx").read_text().split("*MATRIX")[0]
listed = [int(n) for line in re.findall(r"^\*\* +(\d.*)$", head, re.MULTILINE) for n in re.findall(r"\d+", line)]
lines = [re.findall(r"\d+", line) for line in head.splitlines() if line and not line.startswith("*")]
print("unsymmetric:", found[0], "symmetric:", found[1], "lines of degrees of freedom:", lines, "nodes:", listed[44:])
n = 36
assert found[0] == {"STIFFNESS": n * n, "MASS": n * (n + 1) // 2} and set(found[1].values()) == {n * (n + 1) // 2}, "this has changed"
assert [line[0] for line in lines[1:]] == ["46", "48"] and len(listed) == 48, "this has changed"
END
