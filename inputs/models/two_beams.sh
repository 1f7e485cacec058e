#!/usr/bin/env bash
# Makes the model of two_beams.nml in the present folder: two_beams.sh [FOLDER]
set -euo pipefail
cd "${1:-.}"
nhbm-model beam --length 0.5 --n-elements 20 --clamped left --node-set 'top=0.35,0,0;0.4,0,0;0.45,0,0;0.5,0,0' --node-set 'shaker=0.2,0,0' \
   --node-set 'end=0.5,0,0' --output long_beam.h5 --overwrite
nhbm-model beam --length 0.4 --n-elements 16 --clamped right --node-set 'under=0,0,0;0.05,0,0;0.1,0,0;0.15,0,0' --node-set 'shaker=0.25,0,0' \
   --output short_beam.h5 --overwrite
nhbm-model assemble lower=long_beam.h5 upper=short_beam.h5 --at upper=0.35,0,0.02 --pair contact=lower_top,upper_under --within 0.021 \
   --output beams.h5 --overwrite
nhbm-model reduce beams.h5 --keep contact.z,lower_shaker.z,upper_shaker.z --modes 12 --up-to 8000 --output two_beams.h5 --overwrite
