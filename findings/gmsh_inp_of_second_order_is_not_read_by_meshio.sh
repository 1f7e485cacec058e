#!/usr/bin/env bash
# Gmsh 4.15.2 writes the named surface of a second-order mesh into an Abaqus deck as elements of the type CPS6; meshio
# 5.3.5, the usual reader, refuses the file for it, although CalculiX takes the solids of the same file. Seen: it prints
# that and ends the process (SystemExit 1).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 meshio==5.3.5 gmsh==4.15.2
env/bin/python - <<'END'
import contextlib, io
import gmsh, meshio
gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
gmsh.model.occ.synchronize()
gmsh.model.addPhysicalGroup(3, [1], name="body")
gmsh.model.addPhysicalGroup(2, [1], name="face")
gmsh.option.setNumber("Mesh.MeshSizeMin", 0.7)
gmsh.model.mesh.generate(3)
gmsh.model.mesh.setOrder(2)
gmsh.write("box.inp")
gmsh.finalize()
kinds = [line.strip() for line in open("box.inp") if line.upper().startswith("*ELEMENT")]
try:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        meshio.read("box.inp")
    outcome = "read"
except (Exception, SystemExit) as error:
    outcome = f"{type(error).__name__}: {error}"
print(kinds, outcome)
assert any("CPS6" in kind for kind in kinds) and outcome != "read", "this has changed"
END
