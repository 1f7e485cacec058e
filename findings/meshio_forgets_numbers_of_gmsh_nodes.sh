#!/usr/bin/env bash
# Nodes of a Gmsh mesh keep their numbers (tags) where some nodes are missing, in formats 2.2 and 4.1; meshio 5.3.5
# reads such a file right, but its mesh has no numbers: who takes node k as the k-th point assigns matrices to wrong
# places. Seen: nodes 10, 30, 20 of a .msh, no 10, 20 or 30 anywhere in the mesh.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 meshio==5.3.5
env/bin/python - <<'END'
import meshio, numpy as np
head = "$MeshFormat\n{} 0 8\n$EndMeshFormat\n"
old = head.format(2.2) + "$Nodes\n3\n10 0 0 0\n30 1 0 0\n20 2 0 0\n$EndNodes\n$Elements\n2\n1 1 2 1 1 10 30\n2 1 2 1 1 30 20\n$EndElements\n"
new = head.format(4.1) + "$Entities\n0 1 0 0\n1 0 0 0 2 0 0 0 0\n$EndEntities\n$Nodes\n1 3 10 30\n1 1 0 3\n10\n30\n20\n0 0 0\n1 0 0\n2 0 0\n$EndNodes\n"
new += "$Elements\n1 2 1 2\n1 1 1 2\n1 10 30\n2 30 20\n$EndElements\n"
for version, text in (("2.2", old), ("4.1", new)):
    open("line.msh", "w").write(text)
    mesh = meshio.read("line.msh")
    stored = [*mesh.point_data.values(), *mesh.point_sets.values(), *mesh.field_data.values()]
    found = any(np.isin([10, 20, 30], np.asarray(values).ravel()).all() for values in stored)
    print("meshio", meshio.__version__, "format", version, mesh.points[:, 0].tolist(), "numbers kept:", found)
    assert mesh.points[:, 0].tolist() == [0.0, 1.0, 2.0] and not found, "this has changed"
END
