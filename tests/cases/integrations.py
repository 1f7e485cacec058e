"""Runs of `nhbm integrate`: models, records and their difference from balances, for the tests of integration and verification."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from program import read, run

INPUTS = Path(__file__).resolve().parents[2] / "inputs"

MASS = "&structure type='matrices', n_dofs=1, mass=1, damping=0.1, stiffness=1 /\n&tones frequency=1.3 /\n&harmonics order=3 /\n"
FREE = "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones frequency=1 /\n&harmonics order=1 /\n"
VAN_DER_POL = (
    "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones unknown=.true. /\n"
    "&harmonics order=9, odd_only=.true. /\n&law type='van_der_pol', dof='x1', strength=1 /\n"
)
FORCED = MASS + "&load dof='x1', tuple=1, cos=0.4 /\n&law type='cubic_spring', dof='x1', stiffness=0.5 /\n"
DECAY = "&structure type='matrices', n_dofs=1, mass=1, damping=0.1, stiffness=4 /\n"
# Steps of 0.01 at 2 rad/s: phase errors of (h w)^4/120 and (h w)^2/24 a radian over the decay time, 40 rad; twice that of the last.
METHODS = [("cvode", 1e-9), ("runge_kutta_4", 6e-8), ("central_differences", 7e-4), ("generalized_alpha", 1.4e-3)]


def integration(text: str | Path, folder: Path, *options, name="integration", status=0) -> Path:
    """Integrates an input, given as text or as a file, and returns the record."""
    source = text
    if isinstance(text, str):
        source = folder / f"{name}.nml"
        source.write_text(text)
    record = folder / f"{name}.h5"
    done = run("integrate", source, "-o", record, "--overwrite", "--quiet", *options, cwd=folder)
    assert done.status == status, done.stderr
    return record


def coefficient(record: Path, *j: int, dof: int = 0) -> np.ndarray:
    """(cos, sin) of a tuple."""
    tuples, values = read(record, "tuple", "coefficients")
    return values[dof, tuples.tolist().index(list(j))]


def balance_at(result: Path, point: int, dof: str, t: np.ndarray) -> np.ndarray:
    """Motion of a result file at given times."""
    with h5py.File(result) as file:
        frequencies = file["tuple"][()] @ file["frequency"][point]
        pairs = file["coefficients"][point, file["dof"].asstr()[()].tolist().index(dof)]
    known = ~np.isnan(pairs[:, 0])
    phases = np.outer(t, frequencies[known])
    return np.cos(phases) @ pairs[known, 0] + np.sin(phases) @ pairs[known, 1]


def difference(record: Path, result: Path, point: int, dof: str) -> np.ndarray:
    with h5py.File(record) as file:
        t, labels, x = file["time"][()], file["dof"].asstr()[()].tolist(), file["displacement"][()]
    return x[labels.index(dof)] - balance_at(result, point, dof, t)


def largest_motion(record: Path) -> float:
    """Largest |x| of a record, between samples by the cubic through displacements and velocities."""
    t, x, v = read(record, "time", "displacement", "velocity")
    x, v, h = np.abs(x[0]), v[0] * np.sign(x[0]), t[1] - t[0]
    k = int(np.argmax(x[1:-1])) + 1
    s = np.linspace(0.0, 1.0, 20001)
    tops = []
    for i in (k - 1, k):
        cubic = (
            (1 + 2 * s) * (1 - s) ** 2 * x[i]
            + s * (1 - s) ** 2 * h * v[i]
            + s**2 * (3 - 2 * s) * x[i + 1]
            + s**2 * (s - 1) * h * v[i + 1]
        )
        tops.append(cubic.max())
    return max(tops)


def decay(t, x0, v0):
    """Free motion of DECAY."""
    w = np.sqrt(4 - 0.05**2)
    return np.exp(-0.05 * t) * (x0 * np.cos(w * t) + (v0 + 0.05 * x0) / w * np.sin(w * t))


def forced_blades(frame: str, order: int) -> str:
    """A force on the disk causes rubbing; in its own or the stationary frame the blades move along the casing."""
    turning = "" if frame == "rotating" else f"frame='{frame}', tone=2, "
    disk = -0.5 if frame == "stationary" else 0.0
    casing = 0.5 if frame == "rotating" else 0.0
    at = "tuple=1,3" if frame == "stationary" else "tuple=1,0"
    tuples = [f"{k},{m}" for k in range(order + 1) for m in (0, 3, -3) if k > 0 or m >= 0]
    loads = [f"&load dof='q1', {at}, cos=0.1 /"]
    if frame == "stationary":  # a force that rotates with the disk: half of it in each direction
        loads = [
            f"&load dof='q1', tuple=1,{m}, cos=0.05 /\n&load dof='q2', tuple=1,{m}, sin={0.05 if m > 0 else -0.05} /"
            for m in (3, -3)
        ]
    return f"""
&structure type='rotor_stator', frame='{frame}', n_diameters=3, speed=0.5, disk_frequency=1, casing_frequency=1.7,
   disk_damping_ratio=0.02, casing_damping_ratio=0.02 /
&tones frequency=1.05, 0.5 /
&harmonics set='list', tuples={", ".join(tuples)} /
&law type='blade_contact', {turning}dofs='q1','q2','r1','r2', n_diameters=3, n_blades=22, gaps=1, stiffness=2,
   friction_coefficient=0.05, friction_arms=0.3,0.333 /
&law type='cubic_damping', dofs='q1','q2', coefficient=0.01, n_diameters=3, speed={disk} /
&law type='cubic_damping', dofs='r1','r2', coefficient=0.01, n_diameters=3, speed={casing} /
""" + "\n".join(loads)
