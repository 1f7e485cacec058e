#!/usr/bin/env bash
# Makes the model of rattling_plate.nml in the present folder: rattling_plate.sh [FOLDER]
set -euo pipefail
cd "${1:-.}"
nhbm-model plate --length 0.4 --width 0.3 --thickness 0.004 --n-x 10 --n-y 8 \
   --node-set 'stops=0.12,0.1,0;0.28,0.1,0;0.12,0.2,0;0.28,0.2,0' --node-set 'shaker=0.16,0.1125,0' \
   --output plate.h5 --overwrite
nhbm-model reduce plate.h5 --keep stops.z,shaker.z --modes 20 --up-to 10000 --output rattling_plate.h5 --overwrite
