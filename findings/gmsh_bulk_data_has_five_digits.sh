#!/usr/bin/env bash
# Gmsh 4.15.2 writes bulk data of Nastran (.bdf) in fields of eight columns by default (Mesh.BdfFieldFormat) and cuts what
# does not fit: -0.312345 becomes -0.31234, and 0.0001234 has three digits. Gaps of micrometres are closed, and nodes of two
# parts coincide that did not, without a message; .inp and .msh of the same mesh have all digits. Seen: two boxes 4
# micrometres apart, at x = -0.31 m, touch in the .bdf.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 gmsh==4.15.2
env/bin/python - <<'END'
import gmsh

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gap, face = 4e-6, -0.312345
gmsh.model.occ.addBox(-0.6, 0, 0, face + 0.6, 0.1, 0.1)
gmsh.model.occ.addBox(face + gap, 0, 0, -face - gap, 0.1, 0.1)
gmsh.model.occ.synchronize()
gmsh.option.setNumber("Mesh.MeshSizeMax", 0.1)
gmsh.model.mesh.generate(3)
for name in ("parts.bdf", "parts.inp"):
    gmsh.write(name)
version = gmsh.option.getString("General.Version")
gmsh.finalize()


def gap_of(positions):
    """Between the planes on both sides of the middle."""
    near = sorted({x for x in positions if -0.313 < x < -0.312})
    return near[-1] - near[0]


def value(text):
    mantissa = text.replace(" ", "")
    sign = max(mantissa.rfind("+"), mantissa.rfind("-"))
    return float(mantissa if sign < 1 or mantissa[sign - 1] in "eE" else mantissa[:sign] + "e" + mantissa[sign:])


of_bdf = gap_of([value(line[24:32]) for line in open("parts.bdf") if line.startswith("GRID ")])
lines = open("parts.inp").read().split("*NODE\n")[1].split("*")[0].splitlines()
of_inp = gap_of([float(line.split(",")[1]) for line in lines if "," in line])
print(f"Gmsh {version}: gap {gap:g} m, {of_inp:.3g} m in the .inp, {of_bdf:.3g} m in the .bdf")
assert abs(of_inp - gap) < 1e-9 and of_bdf == 0.0
END
