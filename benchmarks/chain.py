#!/usr/bin/env python3
"""A chain of masses with a stop each, by thirty lines of SciPy and by nhbm, in turns: benchmarks/chain.py [MASSES]

The lines of SciPy are what an engineer writes for this one problem: the exact sparse tangent in blocks of 15 unknowns for each mass,
Newton's method, SuperLU. They estimate no error. NHBM names the program; without it build/release/bin/nhbm is taken. Both times are
processor times, nhbm's of the whole process with the input read and the file written, that of SciPy without its imports.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

ROOT = Path(__file__).resolve().parents[1]
N_SAMPLES, ORDER, OMEGA, STIFFNESS, GAP = 32, 7, 0.9, 0.5, 0.8


def by_scipy(n: int) -> tuple[np.ndarray, int]:
    """Coefficients of the motion, (masses, 1 + 2 ORDER), mean value, cosines, sines, and the number of steps."""
    tau = 2.0 * np.pi * np.arange(N_SAMPLES) / N_SAMPLES
    k = np.arange(1, ORDER + 1)
    synthesis = np.hstack([np.ones((N_SAMPLES, 1)), np.cos(np.outer(tau, k)), np.sin(np.outer(tau, k))])
    analysis = synthesis.T * np.r_[1.0, np.full(2 * ORDER, 2.0)][:, None] / N_SAMPLES
    rate = np.zeros((1 + 2 * ORDER,) * 2)
    rate[k, k + ORDER], rate[k + ORDER, k] = OMEGA * k, -OMEGA * k
    springs = np.full(n, 3.0)
    springs[[0, -1]] = 2.0
    stiffness = sp.diags([-np.ones(n - 1), springs, -np.ones(n - 1)], [-1, 0, 1])
    linear = sp.kron(stiffness, np.eye(1 + 2 * ORDER)) + sp.kron(sp.eye(n), rate @ rate + 0.05 * rate)
    load = np.zeros((n, 1 + 2 * ORDER))
    load[:, 1] = np.round(0.3 + 0.2 * np.sin(0.37 * np.arange(1, n + 1)), 6)
    u = np.zeros_like(load)
    for step in range(30):
        q = u @ synthesis.T
        residual = (linear @ u.ravel()).reshape(u.shape) + STIFFNESS * np.maximum(q - GAP, 0.0) @ analysis.T - load
        if np.linalg.norm(residual) < 1e-9 * np.linalg.norm(load):
            return u, step
        blocks = (analysis * (STIFFNESS * (q > GAP))[:, None, :]) @ synthesis
        tangent = linear + sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)))
        u -= splu(tangent.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0).solve(residual.ravel()).reshape(u.shape)
    raise ArithmeticError("not converged")


def by_nhbm(folder: str, n: int, *options: str) -> np.ndarray:
    """Amplitudes a - i b of the motion, (masses, 1 + ORDER)."""
    source, result = f"{folder}/chain.nml", f"{folder}/chain.h5"
    if not os.path.exists(source):
        made = subprocess.run([ROOT / "inputs/models/chain_of_contacts.sh", str(n), "stop"], check=True, capture_output=True)
        Path(source).write_bytes(made.stdout)
    program = os.environ.get("NHBM", str(ROOT / "build/release/bin/nhbm"))
    command = [program, "solve", source, "--output", result, "--overwrite", "--quiet", *options]
    subprocess.run(command, check=True)
    with h5py.File(result) as file:
        pairs, order = file["coefficients"][0], np.argsort(file["tuple"][:, 0])
    return (pairs[..., 0] - 1j * pairs[..., 1])[:, order]


def timed(call, *arguments):
    began = sum(os.times()[:4])
    found = call(*arguments)
    return found, sum(os.times()[:4]) - began


def main() -> int:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 10000
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(2):
            (u, steps), scipy_time = timed(by_scipy, n)
            c, with_estimate = timed(by_nhbm, folder, n)
            _, without = timed(by_nhbm, folder, n, "--set", "error_estimate%is_on=.false.")
            theirs = np.hstack([u[:, :1], u[:, 1 : ORDER + 1] - 1j * u[:, ORDER + 1 :]])
            difference = np.linalg.norm(c - theirs) / np.linalg.norm(theirs)
            print(f"{n} masses: SciPy {scipy_time:.2f} s, {steps} steps; nhbm {without:.2f} s, with estimate {with_estimate:.2f} s; "
                  f"motions differ by {difference:.0e}")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
