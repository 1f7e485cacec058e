#!/usr/bin/env bash
# Makes the model of lap_joint.nml in the present folder: lap_joint.sh [FOLDER]
set -euo pipefail
cd "${1:-.}"
bar=(--length 0.12 --width 0.03 --height 0.01 --n-x 6 --n-y 2 --n-z 1 --overwrite)
nhbm-model solid "${bar[@]}" --clamped left --node-set 'bolt=0.1,0.015,0' --output lower.h5
nhbm-model solid "${bar[@]}" --clamped right --node-set 'bolt=0.02,0.015,0.01' --node-set 'shaker=0,0.015,0.01' --output upper.h5
nhbm-model assemble lower=lower.h5 upper=upper.h5 --at upper=0.08,0,0.01 --pair joint=lower_top,upper_bottom --partial \
   --load bolt=lower_bolt.z:1,upper_bolt.z:-1 --output period.h5 --overwrite
nhbm-model reduce period.h5 --keep joint.x,joint.z,upper_shaker.x --modes 30 --up-to 40000 --output lap_joint.h5 --overwrite
