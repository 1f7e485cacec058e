"""Coefficients of C2a from marches of growing length, and from balances of growing order, against those with 14 digits."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
from against_time import TRIES
from nhbm_post.benchmark import Benchmark, convergence_rate
from runs import INPUTS, Scene, nhbm

LENGTHS = (200, 600, 2000, 6000, 20000, 60000)  # [s]
ORDERS = (3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25)
_GROUP = re.compile(r"^&reference dof = 'x1', tuple = (\S+), (\S+),\s+cos = (\S+?)(?:, sin = (\S+))? /", re.MULTILINE)


def marched(folder: Path) -> str:
    """Table: largest error of a coefficient over the length of the record."""
    scene = Scene("gallery/elastic_stop_two_tones", ("x1",), (1.0,))
    text = "| transient [s] | record [s] | largest error [m] | largest `spread` [m] | processor seconds |\n|---|---|---|---|---|\n"
    known = _known()
    source, result = folder / "coefficients.nml", folder / "coefficients.h5"
    source.write_text(scene.text(), encoding="utf-8")
    for length in LENGTHS:
        transient = min(max(100, length // 4), 500)
        settings = ("method='cvode'", "step=0.02", "tolerance=1e-14", "decimation=100")
        settings += (f"transient={transient}", f"duration={length}")
        nhbm("march", source, result, ("harmonics%order=3", *(f"march%{setting}" for setting in settings)))
        with h5py.File(result) as file:
            tuples = [tuple(j) for j in file["tuple"][()].tolist()]
            found = file["coefficients"][0]
            spread = file["spread"][0][[tuples.index(j) for j in known]].max()
            seconds = float(file["cpu_seconds"][()])
        error = max(np.abs(found[tuples.index(j)] - pair).max() for j, pair in known.items())
        text += f"| {transient} | {length} | {error:.0e} | {spread:.0e} | {seconds:.2g} |\n"
    return text


def balanced(folder: Path) -> tuple[str, np.ndarray, np.ndarray]:
    """Table: rms of the error of the eight known tuples over the order; and orders and errors for the picture."""
    source, result = INPUTS / "benchmark" / "stop_two_tones.nml", folder / "c2a.h5"
    orders = ",".join(map(str, ORDERS))
    sets = (f"benchmark%orders={orders}", "benchmark%methods='broyden'", f"benchmark%repeats={TRIES}")
    nhbm("benchmark", source, result, sets)
    benchmark = Benchmark(result)
    order, error = benchmark.column("order").astype(float), benchmark.error()
    rate = convergence_rate(order, error, "algebraic")
    text = "| order | error of the eight tuples | processor seconds |\n|---|---|---|\n"
    for n, e, s in zip(order, error, benchmark.column("cpu_seconds")):
        text += f"| {n:.0f} | {e:.1e} | {s:.2g} |\n"
    if rate:
        text += f"\nObserved rate: {rate.plain('N')}.\n"
    return text, order, error


def _known() -> dict[tuple[int, int], np.ndarray]:
    text = (INPUTS / "benchmark" / "stop_two_tones.nml").read_text(encoding="utf-8")
    return {(int(a), int(b)): np.array([float(c), float(s or 0.0)]) for a, b, c, s in _GROUP.findall(text)}
