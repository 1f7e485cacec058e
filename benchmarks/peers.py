"""Times of other programs on systems of systems.py, by a Python that has them: python peers.py pyharm|ross

Prints one JSON object: seconds of processor time from the model in memory to the result, and what was computed. Compilation is
not counted: the second of two runs is reported.
"""

from __future__ import annotations

import json
import logging
import sys
import time
import warnings

import numpy as np

logging.disable(logging.CRITICAL)
warnings.simplefilter("ignore")


def pyharm() -> tuple[float, str]:
    """Response curve of pyHarm's two Duffing oscillators from 0.5 to 5 rad/s, 7 harmonics."""
    import pyHarm
    from pyHarm.Maestro import Maestro

    def on(dof: int, **keys: object) -> dict[str, object]:
        return {"connect": {"s": [0]}, "dirs": [dof], **keys}

    curve = {"study": "frf", "predictor": "tangent",
             "puls_inf": 0.5, "puls_sup": 5.0, "puls_start": 0.5, "ds0": 0.02, "ds_max": 0.05, "ds_min": 1e-8,
             "verbose": False}  # fmt: skip
    matrices = {"M": np.eye(2), "C": 0.1 * np.eye(2), "K": np.array([[6.0, -5.0], [-5.0, 6.0]]), "G": np.zeros((2, 2))}
    data = {"analysis": {"curve": curve}, "system": {"type": "Base", "nh": 7, "nti": 128},
            "substructures": {"s": {"matrix": matrices, "ndofs": 2}},
            "connectors": {"one": on(0, type="CubicSpring", k=1.0), "two": on(1, type="CubicSpring", k=1.0),
                           "load": on(0, type="CosinusForcing", amp=2.0)}}  # fmt: skip
    duration = 0.0
    for _ in range(2):
        began = time.process_time()
        maestro = Maestro(data)
        maestro.operate()
        duration = time.process_time() - began
    n_points = len(maestro.nls["curve"].SolList)
    return duration, f"pyHarm {getattr(pyHarm, '__version__', '1.2.2')}, {n_points} points of 7 harmonics"


def ross() -> tuple[float, str]:
    """Whirl frequencies of the rotor with two disks at 4000 rpm."""
    import ross as rs

    steel = rs.Material("Steel", rho=7810, E=211e9, G_s=81.2e9)
    shaft = [rs.ShaftElement(L=0.25, material=steel, n=i, idl=0, odl=0.05) for i in range(6)]
    disks = [rs.DiskElement.from_geometry(n=n, material=steel, width=0.07, i_d=0.05, o_d=d) for n, d in ((2, 0.28), (4, 0.35))]
    bearings = [rs.BearingElement(n=n, kxx=1e6, kyy=1e6, cxx=0, cyy=0) for n in (0, 6)]
    duration, found = 0.0, None
    for _ in range(2):
        began = time.process_time()
        found = rs.Rotor(shaft, disks, bearings).run_modal(4000 * np.pi / 30, num_modes=24)
        duration = time.process_time() - began
    return duration, f"ROSS {rs.__version__}, run_modal: {np.sort(found.wn)[0]:.6f} rad/s first"


if __name__ == "__main__":
    seconds, what = {"pyharm": pyharm, "ross": ross}[sys.argv[1]]()
    print(json.dumps({"seconds": seconds, "what": what}))
