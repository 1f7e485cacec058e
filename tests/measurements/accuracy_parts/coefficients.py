"""Coefficients of C2a from time integrations of growing length, and from balances of growing order, against 14 digits."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from against_time import TRIES
from nhbm_post.bench import Bench, read_reference
from nhbm_post.rates import convergence_rate
from runs import INPUTS, Model, nhbm, rms

LENGTHS = (200, 600, 2000, 6000, 20000, 60000)  # [s]
TOLERANCES = (1e-2, 1e-3, 1e-4)
TRUTH = 1e-5
ORDERS = (3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25)
KNOWN = INPUTS / "order_sequence" / "stop_two_tones.csv"


def integrated(folder: Path) -> str:
    """Table: largest error of a coefficient over the length of the record."""
    model = Model("gallery/elastic_stop_two_tones", ("x1",), (1.0,))
    text = "| transient [s] | record [s] | largest error [m] | largest `spread` [m] | processor seconds |\n|---|---|---|---|---|\n"
    known = _known()
    source, result = folder / "coefficients.nml", folder / "coefficients.h5"
    source.write_text(model.text(), encoding="utf-8")
    for length in LENGTHS:
        transient = min(max(100, length // 4), 500)
        settings = ("method='cvode'", "step=0.02", "tolerance=1e-14", "decimation=100")
        settings += (f"transient={transient}", f"duration={length}")
        nhbm("integrate", source, result, ("harmonics%order=3", *(f"integration%{setting}" for setting in settings)))
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
    source, result = folder / "c2a.nml", folder / "c2a.h5"
    text = Model("order_sequence/stop_two_tones", (), ()).text()
    source.write_text(f"{text}&sweep parameter='harmonics%order', values={', '.join(map(str, ORDERS))} /\n", encoding="utf-8")
    settings = ("solver%method='broyden'", "error_estimate%is_on=.false.", "stability%method='off'")
    nhbm("bench", source, result, settings, "--budget", "0", "--repeats", str(TRIES))
    bench = Bench(result)
    order, error = bench.column("order").astype(float), bench.errors(read_reference(str(KNOWN)), only_known=True)
    rate = convergence_rate(order, error, "algebraic")
    text = "| order | error of the eight tuples | processor seconds |\n|---|---|---|\n"
    for n, e, s in zip(order, error, bench.column("bench_cpu_seconds")):
        text += f"| {n:.0f} | {e:.1e} | {s:.2g} |\n"
    if rate:
        text += f"\nObserved rate: {rate.plain('N')}.\n"
    return text, order, error


def by_tolerance(folder: Path) -> str:
    """Table: what a tolerance takes, and the errors that it leaves, of the whole motion and of the eight tuples."""
    source, result = folder / "tolerance.nml", folder / "tolerance.h5"
    source.write_text(Model("accuracy/elastic_stop", (), ()).text(), encoding="utf-8")
    truth, _ = _motion(source, result, TRUTH)
    known = _known()
    text = "| tolerance | tuples | levels | steps | estimate | error of the motion | error of the eight tuples |\n"
    text += "|---|---|---|---|---|---|---|\n"
    for tolerance in TOLERANCES:
        found, counts = _motion(source, result, tolerance)
        differences = [found.get(j, 0.0) - pair for j, pair in truth.items()]
        error = rms(np.array(differences)) / rms(np.array(list(truth.values())))
        of_eight = rms(np.array([found[j] - pair for j, pair in known.items()])) / rms(np.array(list(known.values())))
        text += f"| {tolerance:.0e} | {' | '.join(counts)} | {error:.1e} | {of_eight:.1e} |\n"
    return text


def _motion(source: Path, result: Path, tolerance: float) -> tuple[dict[tuple[int, ...], np.ndarray], list[str]]:
    """(cos, sin) by tuple; numbers of tuples, levels and steps, and the estimate."""
    nhbm("solve", source, result, (f"accuracy%tolerance={tolerance!r}", "stability%method='off'"))
    with h5py.File(result) as file:
        counts = [str(file[name][0]) for name in ("n_harmonics", "n_levels", "iterations")]
        estimate = float(np.hypot(file["truncation_estimate"][0], file["aliasing_estimate"][0]))
        n = int(file["n_harmonics"][0])
        tuples, pairs = file["tuples"][0, :n], file["coefficients"][0, 0, :n]
    return {tuple(j): pair for j, pair in zip(tuples.tolist(), pairs)}, [*counts, f"{estimate:.1e}"]


def _known() -> dict[tuple[int, int], np.ndarray]:
    reference = read_reference(str(KNOWN))
    return {tuple(j): pair for j, pair in zip(reference.tuples.tolist(), reference.values[0])}
