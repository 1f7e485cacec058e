"""Findings of against_time.py kept in a file, and the tables made of them."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
from against_time import CASES, INTEGRATIONS, Finding, Point, measure
from nhbm_post.rates import convergence_rate
from runs import ROOT, known_methods

KEPT = ROOT / "docs" / "pictures" / "accuracy.json"
ERRORS = (1e-2, 1e-3, 1e-4, 1e-6, 1e-9)


def update(chosen: list[str], folder: Path) -> list[Finding]:
    """Measures the chosen cases anew and gives all that are known, in the order of the cases."""
    methods = known_methods(folder) if chosen else []
    for case in CASES:
        if case.name in chosen:
            print(f"    {case.name}", file=sys.stderr, flush=True)
            finding = as_json(measure(case, methods, folder))
            kept = {**_kept(), case.name: finding}
            KEPT.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    kept = _kept()
    return [_from_json(case, kept[case.name]) for case in CASES if case.name in kept]


def _kept() -> dict:
    return json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}


def as_json(finding: Finding) -> dict:
    curves = {name: [dataclasses.asdict(point) for point in points] for name, points in finding.curves.items()}
    agreement = None if np.isnan(finding.agreement) else finding.agreement
    return {"agreement": agreement, "curves": curves}


def _from_json(case, data: dict) -> Finding:
    curves = {name: [Point(**point) for point in points] for name, points in data["curves"].items()}
    agreement = float("nan") if data["agreement"] is None else data["agreement"]
    return Finding(case, curves, agreement)


def table(findings: list[Finding]) -> str:
    """How many times faster the balance is, at each error that it or time integration reaches."""
    text = "| case | " + " | ".join(f"{error:.0e}" for error in ERRORS)
    text += " | least error of the balance | transient [s] | reference |\n"
    text += "|---|" + "---|" * (len(ERRORS) + 3) + "\n"
    for finding in findings:
        cells = [_ratio(finding, error) for error in ERRORS]
        reference = "-" if np.isnan(finding.agreement) else f"{finding.agreement:.0e}"
        integrated = [finding.cheapest(True, error) for error in ERRORS]
        transients = " / ".join(f"{found[1].transient:.3g}" if found else "-" for found in integrated)
        cells += [f"{finding.least(is_integration=False):.0e}", transients, reference]
        text += f"| {finding.case.title} | {' | '.join(cells)} |\n"
    return text


def _ratio(finding: Finding, error: float) -> str:
    integrated, balanced = (finding.cheapest(is_integration, error) for is_integration in (True, False))
    if balanced is None:
        return f"time integration alone, {_seconds(integrated[1].seconds)}" if integrated else "-"
    if integrated is None:
        return f"balance alone, {_seconds(balanced[1].seconds)}"
    ratio = integrated[1].seconds / balanced[1].seconds
    times = f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"
    strong = "**" if ratio >= 10 else ""
    way = ", integrated" if balanced[1].is_integrated else ""
    return f"{strong}{times}{strong} ({_seconds(integrated[1].seconds)} / {_seconds(balanced[1].seconds)}{way})"


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"


def rate_table(findings: list[Finding]) -> str:
    text = "| case | error at each order | observed rate |\n|---|---|---|\n"
    for finding in findings:
        name, points = best_balance(finding)
        orders = np.array([order_of(point) for point in points], dtype=float)
        errors = np.array([point.error for point in points])
        rate = convergence_rate(orders, errors)
        listed = ", ".join(f"{n:.0f}: {e:.1e}" for n, e in zip(orders, errors))
        text += f"| {finding.case.title} | {listed} | {rate.plain('N') if rate else '-'} |\n"
    return text


def best_balance(finding: Finding) -> tuple[str, list[Point]]:
    """The solver that went furthest."""
    others = (*INTEGRATIONS, "improved", "tolerance")
    curves = {name: points for name, points in finding.curves.items() if name not in others}
    name = max(curves, key=lambda name: (len(curves[name]), name == "broyden"))
    return name, curves[name]


def order_of(point: Point) -> int:
    return int(point.label.split()[1])
