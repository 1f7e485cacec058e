#!/usr/bin/env bash
# SciPy 1.18.1 reads Harwell-Boeing files of unsymmetric matrices (RUA) alone: symmetric ones (RSA), which finite
# element programs write, are refused, although it is the same format. Seen: ValueError that names the type.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 scipy==1.18.1
env/bin/python - <<'END'
import scipy, scipy.io
def text(kind):
    numbers = f"{1:10d}{2:10d}{3:10d}\n{1:10d}{2:10d}\n{2.0:20.12E}{3.0:20.12E}\n"
    head = f"{'two masses':<72}{'key':<8}\n{3:14d}{1:14d}{1:14d}{1:14d}{0:14d}\n{kind:<14}{2:14d}{2:14d}{2:14d}{0:14d}\n"
    return head + f"{'(8I10)':<16}{'(8I10)':<16}{'(4E20.12)':<20}{'':20}\n" + numbers
outcomes = {}
for kind in ("RUA", "RSA"):
    open("m.hb", "w").write(text(kind))
    try:
        outcomes[kind] = scipy.io.hb_read("m.hb").diagonal().tolist()
    except ValueError as error:
        outcomes[kind] = f"ValueError: {error}"
print(scipy.__version__, outcomes)
assert outcomes["RUA"] == [2.0, 3.0] and str(outcomes["RSA"]).startswith("ValueError"), "this has changed"
END
