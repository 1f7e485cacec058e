#!/usr/bin/env bash
# Makes the model of bladed_wheel.nml in the present folder: bladed_wheel.sh [FOLDER]
set -euo pipefail
cd "${1:-.}"
nhbm-model sector --n-sectors 8 --output sector.h5 --overwrite
nhbm-model wheel sector.h5 --sectors 8 --frequencies 3 --neighbours damper=under_high,under_low \
   --wave two=tip.z:2 --wave three=tip.z:3 --keep damper.z,tip.z --modes 8 --up-to 10000 --output bladed_wheel.h5 --overwrite
