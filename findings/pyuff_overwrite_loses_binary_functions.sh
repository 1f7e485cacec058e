#!/usr/bin/env bash
# pyuff 2.5.8 writes a binary function (58b) with write_sets(..., 'overwrite') as a file of 7 bytes, without an error;
# with 'add' to a file that is not there yet it is complete. Text functions are complete both ways. Who converts
# measurements by 'overwrite' loses them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 pyuff==2.5.8
env/bin/python - <<'END'
import os
import numpy as np, pyuff
def written(binary, mode):
    if os.path.exists("m.uff"):
        os.remove("m.uff")
    hertz = np.arange(1.0, 51.0)
    pyuff.UFF("m.uff").write_sets([{"type": 58, "binary": binary, "func_type": 4, "rsp_node": 1, "rsp_dir": 3, "ref_node": 1, "ref_dir": 3,
        "data": 1.0 / hertz + 0.5j, "x": hertz, "id1": "one", "rsp_ent_name": "NONE", "ref_ent_name": "NONE", "abscissa_spacing": 1,
        "abscissa_spec_data_type": 18, "ordinate_spec_data_type": 8, "orddenom_spec_data_type": 13, "ord_data_type": 6}], mode)
    return os.path.getsize("m.uff")
sizes = {(kind, mode): written(binary, mode) for kind, binary in (("text", 0), ("binary", 1)) for mode in ("add", "overwrite")}
print(sizes)
assert sizes["binary", "overwrite"] < 50 < sizes["binary", "add"] and min(sizes["text", "add"], sizes["text", "overwrite"]) > 1000, "this has changed"
END
