#!/usr/bin/env bash
# Makes the model of dual_rotor.nml in the present folder: dual_rotor.sh [FOLDER]; PYTHON names an interpreter that has nhbm.
set -euo pipefail
examples=$(cd "$(dirname "$0")/../../drivers/examples" && pwd)
cd "${1:-.}"
PYTHONPATH="$examples${PYTHONPATH:+:$PYTHONPATH}" "${PYTHON:-python3}" -c 'import dual_rotor; dual_rotor.rotor().structure().write("dual_rotor.h5")'
