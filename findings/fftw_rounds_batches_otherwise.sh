#!/usr/bin/env bash
# FFTW (3.3.5 in pyFFTW 0.15.1) takes other code for several transforms in one plan than for one: of the same numbers,
# with the same flags, the last bits differ for some lengths, among them the usual powers of two. Who computes forces of
# contact in batches, or distributes them, does not get the same bits as one by one. Seen on a processor with AVX2: lengths
# 20, 32, 64, 128 of the even ones up to 512, by one unit of the last digit; which ones depends on the processor.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=${PYTHON:-python3}
"$python" -m venv env
env/bin/pip install --quiet numpy==2.4.6 pyFFTW==0.15.1
env/bin/python - <<'END'
import numpy as np
import pyfftw


def transform(rows):
    """Of each row along the last axis, by one plan."""
    source = pyfftw.empty_aligned(rows.shape, dtype="float64")
    target = pyfftw.empty_aligned((*rows.shape[:-1], rows.shape[-1] // 2 + 1), dtype="complex128")
    plan = pyfftw.FFTW(source, target, axes=(-1,), flags=("FFTW_ESTIMATE",))
    source[:] = rows
    plan()
    return target.copy()


differ, largest = [], 0.0
for n in range(8, 513, 2):
    rows = np.random.default_rng(n).standard_normal((15, n))
    together, alone = transform(rows), np.array([transform(row) for row in rows])
    if not np.array_equal(together, alone):
        differ.append(n)
        largest = max(largest, np.abs(together - alone).max() / np.abs(alone).max())
print(f"pyFFTW {pyfftw.__version__}: batches differ for the lengths {differ}, by up to {largest:.1e}")
assert differ and largest < 1e-14
END
