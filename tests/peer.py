"""The three peer cases of tests/measurements/performance by pyHarm, run inside a virtual environment that has it.

usage: python peer.py duffing_upper|duffing_lower|jenkins|chain_100 REPEATS

Prints one JSON object: seconds to build and to solve of each repeat, seconds of the first run with its compilation, norm of the
residual, and the coefficients [cos 0, cos 1, sin 1, ...] at the degree of freedom of the law.
"""

from __future__ import annotations

import json
import logging
import sys
import time

import numpy as np

logging.disable(logging.CRITICAL)

from pyHarm.Maestro import Maestro  # noqa: E402

TOLERANCE = 1e-12  # of the residual, relative to the load


def on(dof: int, **keys) -> dict:
    return {"connect": {"s": [dof]}, "dirs": [0], **keys}


def oscillator(law: dict, n_harmonics: int, n_samples: int, omega: float) -> dict:
    one = np.eye(1)
    load = on(0, type="CosinusForcing", amp=0.1)
    return case(one, 0.02 * one, one, {"law": law, "load": load}, n_harmonics, n_samples, omega, 0.1)


def chain(n: int) -> dict:
    """Masses coupled to each other, to the ground and to fixed ends."""
    stiffness = 3.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    middle = (n - 1) // 2
    law = on(middle, type="PenaltyUnilateralGap", k=20.0, g=0.6)
    load = on(middle, type="CosinusForcing", amp=1.0)
    damping = 0.05 * np.eye(n) + 0.02 * stiffness
    return case(np.eye(n), damping, stiffness, {"law": law, "load": load}, 15, 256, 0.9, 1.0)


def case(mass, damping, stiffness, connectors, n_harmonics, n_samples, omega, load) -> dict:
    point = {
        "study": "frf",
        "solver": "NewtonRaphson",
        "solver_options": {"tol_residual": TOLERANCE * load, "tol_delta_x": 1e9, "max_iter": 100},
        "puls_inf": omega,
        "puls_sup": 2.0 * omega,
        "puls_start": omega,
        "verbose": False,
    }
    matrices = {"M": mass, "C": damping, "K": stiffness, "G": 0.0 * mass}
    return {
        "analysis": {"point": point},
        "system": {"type": "Base", "nh": n_harmonics, "nti": n_samples},
        "substructures": {"s": {"matrix": matrices, "ndofs": 1}},
        "connectors": connectors,
    }


def run(data: dict, start) -> tuple[float, float, object]:
    began = time.perf_counter()
    analysis = Maestro(data).nls["point"]
    built = time.perf_counter()
    analysis.initialise(start)
    return built - began, time.perf_counter() - built, analysis.SolList[0]


def main(name: str, repeats: int) -> None:
    start, dof, n_dofs, small = None, 0, 1, None
    if name.startswith("duffing"):
        omega = 2.0 if name == "duffing_upper" else 0.9
        data = oscillator(on(0, type="CubicSpring", k=1.0), 7, 64, omega)
        start = np.zeros(15) if omega == 2.0 else "null"
        if omega == 2.0:
            start[1:3] = 1.2, 1.6
    elif name == "jenkins":
        data = oscillator(on(0, type="Jenkins", k=0.5, mu=1.0, N0=0.1), 31, 1024, 1.1)
    else:
        data, small, dof, n_dofs = chain(100), chain(3), 49, 100
    build, solve, _ = run(small or data, start)  # compiles what the case needs
    first = build + solve
    found = [run(data, start) for _ in range(repeats)]
    solution = found[-1][2]
    print(
        json.dumps(
            {
                "first": first,
                "build": [one[0] for one in found],
                "solve": [one[1] for one in found],
                "residual": float(np.linalg.norm(solution.R)),
                "iterations": int(solution.iter_numb),
                "coefficients": solution.x[:-1][dof::n_dofs].tolist(),
            }
        )
    )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
