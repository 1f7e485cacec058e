"""Periods of free and self-excited vibrations by time integration, against closed forms."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
from runs import Model, nhbm

# Case, input, values set, first displacement [m], length [s], value by closed form, is it a period [s] or a frequency [rad/s]
CASES = [
    ("van der Pol, strength 1", "van_der_pol", ("law(1)%strength=1",), 2.0, 1000, 6.6632868593231361, "period [s]"),
    ("van der Pol, strength 5", "van_der_pol", ("law(1)%strength=5",), 2.0, 1000, 11.6122306677196, "period [s]"),
    ("Duffing, amplitude 1", "duffing_backbone", (), 1.0, 1000, 1.31777606496552663, "frequency [rad/s]"),
    ("stop of 10 times the stiffness, no gap", "elastic_stop", (), -1.0, 1000, 1.53667504192892, "frequency [rad/s]"),
    ("stop of 1e4 times the stiffness at gap 1, amplitude 2", "one_sided_spring", ("law(1)%stiffness=1e4",), -2.0, 1000,
     1.488875033963116, "frequency [rad/s]"),
]  # fmt: skip

_NORMAL_MODE = re.compile(r"^&normal_mode\b.*?^/\n", re.MULTILINE | re.DOTALL)
_GIVEN_TONE = ("tones%unknown=.false.", "tones%frequency=1", "harmonics%odd_only=.false.", "harmonics%order=1")


def table(folder: Path) -> str:
    text = "| motion | quantity | closed form | integrated | relative error | processor seconds |\n|---|---|---|---|---|---|\n"
    for title, name, sets, start, length, known, quantity in CASES:
        found, seconds = _integrated(name, sets, start, length, folder)
        value = 2.0 * np.pi / found if quantity.startswith("period") else found
        text += f"| {title} | {quantity} | {known:.13g} | {value:.13g} | {abs(value / known - 1):.0e} | {seconds:.2g} |\n"
    return text


def _integrated(name: str, sets, start: float, length: float, folder: Path) -> tuple[float, float]:
    """Frequency of the largest line, and processor time."""
    source, result = folder / "free.nml", folder / "free.h5"
    text = _NORMAL_MODE.sub("", Model(f"autonomous/{name}", (), ()).text())
    source.write_text(text + f"&start dof='x1', tuple=1, cos={start} /\n", encoding="utf-8")
    settings = ("method='cvode'", "start='given'", "step=0.02", "tolerance=1e-14", "n_peaks=1")
    settings += ("transient=100", f"duration={length}")
    nhbm("integrate", source, result, sets + _GIVEN_TONE + tuple(f"integration%{setting}" for setting in settings))
    with h5py.File(result) as file:
        return float(file["peak_frequency"][0, 0]), float(file["cpu_seconds"][()])
