"""Times of small solutions in process from Python.

usage: python tests/bench/in_process.py        prints a table; NHBM_LIBRARY names the library, else that of build/release is taken

The Duffing oscillator of order 7 from the motion before, its frequency moved by 1e-4 at each point: least and median time of the
processor of 5,000 points, error estimate included. Then the same at 4,096 samples with laws of the catalogue, NumPy and (if it is
there) Numba.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "drivers" / "python" / "src"), str(ROOT / "postproc" / "src")]
import nhbm  # noqa: E402


def oscillator(**groups: dict) -> nhbm.Model:
    chain = nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.05)
    model = nhbm.Model(chain, tones=[0.9], **groups)
    model.load("x1", 1, cos=0.18)
    return model


def times(model: nhbm.Model, n: int) -> np.ndarray:
    """Of n solutions [us], sorted; without the dataset."""
    session = nhbm.Session()
    model.set("harmonics", order=7)
    session.read(model.to_namelist())
    frequency = session.parameter("tones%frequency")
    session.solve()
    found = np.zeros(n)
    for k, value in enumerate(0.9 + 1e-4 * np.sin(0.1 * np.arange(n))):
        start = time.process_time_ns()
        session.set_parameter(frequency, value)
        session.solve(warm=True)
        found[k] = time.process_time_ns() - start
    return np.sort(found) / 1000


def main() -> None:
    print("| solution | least [us] | median [us] |\n|---|---|---|")
    off = {"method": "off"}
    for name, groups in {
        "with error estimate": {"stability": off},
        "with error estimate and stability": {},
        "alone": {"stability": off, "error_estimate": {"is_on": False}},
    }.items():
        model = oscillator(**groups)
        model.law("cubic_spring", "x1", stiffness=0.1)
        found = times(model, 5000)
        print(f"| {name} | {found[0]:.1f} | {np.median(found):.1f} |", flush=True)
    law = nhbm.law(lambda q, v, p: p[0] * q * q * q, velocity=False, odd=True)
    laws = {"the catalogue": ("cubic_spring", {"stiffness": 0.1}), "NumPy": (law, {"parameters": [0.1]})}
    try:
        from nhbm.numba_laws import compiled

        cubic = (lambda q, v, p: p[0] * q * q * q, lambda q, v, p: (3 * p[0] * q * q, 0.0))
        force = compiled(*cubic, velocity=False, odd=True, degree=3)
        laws["Numba"] = force, {"parameters": [0.1]}
    except ImportError:
        pass
    for name, (law, keys) in laws.items():
        model = oscillator(stability=off, sampling={"samples": 4096})
        model.law(law, "x1", **keys)
        found = times(model, 300)
        print(f"| 4,096 samples, law of {name} | {found[0]:.1f} | {np.median(found):.1f} |", flush=True)


if __name__ == "__main__":
    main()
