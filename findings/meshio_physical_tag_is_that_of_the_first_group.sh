#!/usr/bin/env bash
# A surface of Gmsh may be in several physical groups. In format 4.1 meshio 5.3.5 gives each element one tag
# ('gmsh:physical'), that of the first group; who selects contact faces by tag, as most scripts do, loses this surface
# from all others, without a word. Only cell_sets has all groups. Tags alone do not name a group, either: volume 1 and
# surface 1 have the same. Seen for Gmsh 4.15.2: 8 faces by cell_sets, 4 by tag.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 meshio==5.3.5 gmsh==4.15.2
env/bin/python - <<'END'
import gmsh, meshio

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.model.occ.addBox(0, 0, 0, 2, 1, 1)
gmsh.model.occ.synchronize()
for dimension, members, tag, name in ((3, [1], 1, "bar"), (2, [2], 1, "tip"), (2, [2, 4], 2, "contact")):
    gmsh.model.addPhysicalGroup(dimension, members, tag, name)
for curve in gmsh.model.getEntities(1):
    gmsh.model.mesh.setTransfiniteCurve(curve[1], 2)
gmsh.model.mesh.generate(3)
gmsh.write("bar.msh")
faces = sum(len(gmsh.model.mesh.getElements(2, surface)[1][0]) for surface in (2, 4))
gmsh.finalize()
mesh = meshio.read("bar.msh")
tag, dimension = mesh.field_data["contact"]
of_tag = sum(int((tags == tag).sum()) for block, tags in zip(mesh.cells, mesh.cell_data["gmsh:physical"]) if block.dim == dimension)
of_sets = sum(len(members) for members in mesh.cell_sets["contact"] if members is not None)
print(f"meshio {meshio.__version__}: contact has {faces} faces, {of_sets} by cell_sets, {of_tag} by the tag of the elements")
assert of_sets == faces and 0 < of_tag < faces
assert mesh.field_data["bar"][0] == mesh.field_data["tip"][0]
END
