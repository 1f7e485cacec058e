#!/usr/bin/env bash
# Makes the model of rotor_rub.nml in the present folder: rotor_rub.sh [FOLDER]
set -euo pipefail
cd "${1:-.}"
nhbm-model rotor --length 0.6 --diameter 0.02 --n-elements 12 --disk 0.25,3,0.004,0.008 --disk 0.6,0.8,0.0006,0.0012 \
   --bearing 0,3e6,300 --bearing 0.5,3e6,300 --speed 250 --output rotor_rub.h5 --overwrite
