#!/usr/bin/env bash
# Makes the model of blades_casing.nml in the present folder: blades_casing.sh [FOLDER]
set -euo pipefail
cd "${1:-.}"
nhbm-model sector --n-sectors 22 --hub 0.2 --rim 0.21 --platform 0.215 --tip 0.28 --height 0.02 --clamped none \
   --output blade.h5 --overwrite
nhbm-model ring --n-sectors 22 --inner 0.2805 --outer 0.2925 --height 0.02 --output ring.h5 --overwrite
wave=(--sectors 22 --diameter 3 --modes 4 --up-to 3000 --overwrite)
nhbm-model wheel blade.h5 --keep tip.r --output disk.h5 "${wave[@]}"
nhbm-model wheel ring.h5 --keep inside.r --output casing.h5 "${wave[@]}"
nhbm-model assemble disk=disk.h5 casing=casing.h5 --output blades_casing.h5 --overwrite
