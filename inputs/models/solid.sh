#!/usr/bin/env bash
# Makes solid.h5, a clamped block of quadratic tetrahedra with ten places for stops, and solid.nml, the block under two tones, in a
# folder: solid.sh N_X N_Y N_Z [FOLDER]
set -euo pipefail
n_x=$1 n_y=$2 n_z=$3
cd "${4:-.}"
stops='0.2,0,0;0.2,0.025,0;0.2,0.05,0;0.18,0,0.045;0.18,0.05,0.045;0.16,0,0;0.16,0.05,0;0.14,0,0.045;0.14,0.05,0.045;0.12,0.025,0'
nhbm-model solid --length 0.2 --width 0.05 --height 0.045 --n-x "$n_x" --n-y "$n_y" --n-z "$n_z" \
   --node-set "stops=$stops" --node-set 'shaker=0.2,0.025,0.0225' --output solid.h5 --overwrite
cat >solid.nml <<'END'
&structure type = 'model', file = 'solid.h5', damping_stiffness = 1e-7 /
&tones frequency = 4000.0, 6541.0 /
&harmonics order = 12 /
&load dof = 'shaker.z', tuple = 1, 0, cos = 2000.0 /
&load dof = 'shaker.z', tuple = 0, 1, cos = 2000.0 /
&law type = 'elastic_stop', label = 'stop', dof = 'stops.z', stiffness = 1e7, gap = 1e-5 /
&output dofs = 'stops.z', 'shaker.z' /
END
