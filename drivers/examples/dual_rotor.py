"""Run-up of a rotor of two shafts with an unbalance on each, a roller bearing with clearance between them, and a casing that the
first disk rubs: two tones whose ratio is not a simple one, 224 degrees of freedom, each speed with its estimated error.

The inner shaft turns with the first tone, the outer one 1.236 times as fast. Dimensions are those of a small engine; the rollers
have 2 micrometres of clearance, the casing is 12 micrometres away.
"""

from __future__ import annotations

import time

import numpy as np

import nhbm
import nhbm.assembly
import nhbm.reduction

RATIO = np.sqrt(5) - 1  # of the speeds: no common period, nor a long beat, over which stability would have to be integrated
SPEEDS = np.linspace(300.0, 440.0, 29)  # of the inner shaft [rad/s], over the first bending of the pair


def rotor() -> nhbm.Rotor:
    pair = nhbm.Rotor()
    pair.shaft(np.linspace(0.0, 1.8, 37), 0.06, name="low")
    pair.shaft(np.linspace(0.5, 1.4, 19), 0.14, 0.11, name="high", speed=2)
    for z, mass, diametral, polar in ((0.1, 9, 0.12, 0.22), (0.2, 8, 0.1, 0.19), (0.3, 7, 0.08, 0.16), (1.6, 7, 0.07, 0.13),
                                      (1.7, 7, 0.07, 0.13)):  # fmt: skip
        pair.disk(z, mass, diametral, polar, shaft="low")
    for z, mass, diametral, polar in ((0.6, 4, 0.04, 0.08), (0.7, 4, 0.04, 0.08), (0.8, 4, 0.04, 0.08), (0.9, 4, 0.04, 0.08),
                                      (1.1, 6, 0.06, 0.11), (1.2, 6, 0.06, 0.11)):  # fmt: skip
        pair.disk(z, mass, diametral, polar, shaft="high")
    for z, stiffness, shaft in ((0.0, 2e7, "low"), (0.4, 1.5e7, "low"), (1.8, 1e7, "low"), (0.5, 2e7, "high")):
        pair.bearing(z, stiffness, 2000.0, shaft=shaft)
    pair.between(1.4, "low", "high", 1e5, 200.0)
    pair.unbalance(0.1, 2e-3, shaft="low")
    pair.unbalance(1.7, 1e-3, angle=1.0, shaft="low")
    pair.unbalance(0.6, 1e-3, shaft="high")
    pair.unbalance(1.2, 1e-3, angle=0.5, shaft="high")
    return pair


def reduced() -> nhbm.Structure:
    """The rotor by what the laws see, 8 modes and the static shapes of the unbalances: 16 degrees of freedom instead of 224. Of the
    rollers these are the motions of the inner shaft relative to the outer one."""
    structure = rotor().structure()
    nhbm.assembly.add_pair(structure, "rollers", "inner1", "outer1")
    return nhbm.reduction.reduce(structure, ["rollers.x", "rollers.y", "disk1.x", "disk1.y"], n_modes=8)


def model(speed: float, structure: nhbm.Structure | None = None) -> nhbm.Model:
    structure = structure or rotor().structure()
    rollers = ["rollers.x", "rollers.y"] if "rollers" in structure.sets else ["inner1.x", "inner1.y", "outer1.x", "outer1.y"]
    made = nhbm.Model(structure, tones=[speed, RATIO * speed])
    made.set("structure", speed=[speed, RATIO * speed], damping_stiffness=1e-5)
    made.tie("tones%frequency(2)", "tones%frequency(1)", factor=RATIO)
    for i, shaft in enumerate(("low", "high")):
        made.tie(f"structure%speed({i + 1})", f"tones%frequency({i + 1})")
        for part in ("cos", "sin"):
            made.load(vector=f"unbalance_{shaft}_{part}", tuple_=np.eye(2)[i], **{part: 1.0}, frequency_power=2)
    made.law("annular_clearance", rollers, label="rollers", stiffness=5e7, clearance=2e-6)
    made.law("annular_clearance", ["disk1.x", "disk1.y"], label="casing", stiffness=2e6, clearance=1.2e-5,
             friction_coefficient=0.05)  # fmt: skip
    return made


def main(speeds=SPEEDS, tolerance: float = 1e-2):
    """Returns the motions at the speeds, an xarray dataset."""
    began = time.perf_counter()
    motions = model(speeds[0]).sweep({"tones%frequency(1)": speeds}, tolerance=tolerance)
    print(f"{len(speeds)} speeds in {time.perf_counter() - began:.1f} s; degrees of freedom: {motions.sizes['dof']}")
    print("speed [rad/s]  status     harmonics  estimate  first disk [um]: inner, outer shaft's tone")
    for k, speed in enumerate(speeds):
        at = motions.isel(point=k)
        error = np.hypot(float(at["truncation_estimate"]), float(at["aliasing_estimate"]))
        sizes = [1e6 * float(motions.nhbm.amplitude("n3.x", tuple_)[k]) for tuple_ in ((1, 0), (0, 1))]
        told = f"{motions['status'].values[k]:9}  {int(at['n_harmonics']):9d}  {error:8.1e}"
        print(f"{speed:13.1f}  {told}  {sizes[0]:.2f}, {sizes[1]:.2f}")
    return motions


if __name__ == "__main__":
    main()
