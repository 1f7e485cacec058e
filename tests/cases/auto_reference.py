"""Folds, period doublings and Neimark-Sacker points of public cases by AUTO (PyPI: xpplab), beside those of curves of nhbm.

usage: python tests/cases/auto_reference.py [CASE...]        prints the table of docs/why/validation.md; NHBM names the program

AUTO's collocation gets a force cos(w t) from two further equations with a stable limit cycle, u = cos(w t), v = sin(w t). It starts
from time integration of a period, behind the transient. The models are those of the examples of NLvib, pyHarm and CoSTAR,
and Ueda's oscillator.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import h5py

from program import run

ROTATION = ("u' = u*(1-u^2-v^2) - w*v", "v' = v*(1-u^2-v^2) + w*u")
SETTINGS = {"ntst": 80, "ncol": 4, "dsmin": 1e-7, "epsl": 1e-10, "epsu": 1e-10, "epss": 1e-10, "npr": 100000, "normmax": 1e6}
KINDS = {"LP": 3, "PD": 8, "TR": 9}  # curve_kind
WORDS = {3: "fold", 8: "period doubling", 9: "Neimark-Sacker"}


@dataclass(frozen=True)
class Case:
    """A curve over w, or over the load B if there is one, from `start` to `stop`."""

    equations: tuple[str, ...]  # of XPPAUT, without those of the force
    model: str  # the input of nhbm, without &curve
    start: float
    stop: float
    longest_step: float = 0.05  # of AUTO, and of its points
    transient: int = 300  # periods
    load: bool = False  # the curve is over B at w = 1
    settings: dict[str, float] = field(default_factory=dict)


ONE = "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, "
_W1, _W2 = 1.13, 2.0
_S = (_W1**2 + _W2**2) / 2
CASES = {
    "Duffing, NLvib 01": Case(
        ("x' = p", "p' = -.05*p - x - .1*x^3 + .18*u"),
        ONE + "ground_stiffness = 1.0, damping_mass = 0.05 /\n&tones frequency = 0.5 /\n&harmonics order = 31 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.18 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /\n", 0.5, 2.0),
    "two masses, NLvib 02": Case(
        ("x' = p", "p' = -.002*p - .013*(p-q) - x - .0453*(x-y) - x^3 - .0042*(x-y)^3 + .11*u",
         "y' = q", "q' = (.013*(p-q) + .0453*(x-y) + .0042*(x-y)^3)/.05"),
        "&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.0, 0.0, 0.05, stiffness = 1.0453, -0.0453, -0.0453, 0.0453,\n"
        "   damping = 0.015, -0.013, -0.013, 0.013 /\n&tones frequency = 0.8 /\n&harmonics order = 31 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.11 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /\n"
        "&law type = 'cubic_spring', dofs = 'x1', 'x2', weights = 1.0, -1.0, stiffness = 0.0042 /\n", 0.8, 1.4),
    "two springs, NLvib 06": Case(
        ("x' = p", f"p' = -{2e-3 * _W1}*p - {_W1**2}*x - {_W1**2 / 2}*(3*x^2+y^2) - {_W2**2}*x*y - {_S}*x*(x^2+y^2) + .001*u",
         "y' = q", f"q' = -{10e-3 * _W2}*q - {_W2**2}*y - {_W2**2 / 2}*(3*y^2+x^2) - {_W1**2}*x*y - {_S}*y*(x^2+y^2) + .001*u"),
        f"&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.0, 0.0, 1.0, stiffness = {_W1**2!r}, 0.0, 0.0, {_W2**2!r},\n"
        f"   damping = {2e-3 * _W1!r}, 0.0, 0.0, {10e-3 * _W2!r} /\n&tones frequency = 1.1 /\n&harmonics order = 15 /\n"
        "&load dof = 'x1', tuple = 1, cos = 1e-3 /\n&load dof = 'x2', tuple = 1, cos = 1e-3 /\n"
        "&law type = 'polynomial_coupled', dofs = 'x1', 'x2',\n"
        f"   coefficients = {1.5 * _W1**2!r}, {_W1**2 / 2!r}, {_W2**2!r}, {_S!r}, {_S!r},\n"
        f"                  {1.5 * _W2**2!r}, {_W2**2 / 2!r}, {_W1**2!r}, {_S!r}, {_S!r},\n"
        "   acts_on = 5*'x1', 5*'x2', displacement_exponents = 2,0, 0,2, 1,1, 3,0, 1,2, 0,2, 2,0, 1,1, 0,3, 2,1 /\n", 1.1, 1.16,
        longest_step=0.002, transient=1500, settings={"ds": 0.0005, "nmax": 4000}),
    "two Duffing, pyHarm": Case(
        ("x' = p", "p' = -.1*p - x - x^3 - 5*(x-y) + 2*u", "y' = q", "q' = -.1*q - y - y^3 - 5*(y-x)"),
        "&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.0, 0.0, 1.0, stiffness = 6.0, -5.0, -5.0, 6.0,\n"
        "   damping = 0.1, 0.0, 0.0, 0.1 /\n&tones frequency = 0.5 /\n&harmonics order = 41 /\n"
        "&load dof = 'x1', tuple = 1, cos = 2.0 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /\n"
        "&law type = 'cubic_spring', dof = 'x2', stiffness = 1.0 /\n", 0.5, 5.0,
        longest_step=0.02, settings={"ntst": 120, "nmax": 3000}),
    "Duffing, CoSTAR": Case(
        ("x' = p", "p' = -.1*p - x - .3*x^3 + u"),
        ONE + "ground_stiffness = 1.0, damping_mass = 0.1 /\n&tones frequency = 0.6 /\n&harmonics order = 41 /\n"
        "&load dof = 'x1', tuple = 1, cos = 1.0 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 0.3 /\n", 0.6, 3.5,
        settings={"ntst": 120}),
    "forced van der Pol, CoSTAR, upwards": (upwards := Case(
        ("x' = p", "p' = .3*(1-x^2)*p - x + .4*u"),
        ONE + "ground_stiffness = 1.0, damping_mass = 0.0 /\n&tones frequency = 1.0 /\n&harmonics order = 31 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.4 /\n&law type = 'van_der_pol', dof = 'x1', strength = 0.3 /\n", 1.0, 1.2)),
    "forced van der Pol, CoSTAR, downwards": Case(upwards.equations, upwards.model, 1.0, 0.8),
    "Laval rotor, CoSTAR": Case(
        ("x' = p", f"p' = -x + .4*w*y - {8 / 15!r}*p - .25*p^3 + .25*w^2*v",
         "y' = q", f"q' = -y - .4*w*x - {8 / 15!r}*q - .25*q^3 + .25*w^2*u - .3924"),
        f"&structure type = 'jeffcott', mass = 1.0, stiffness = 1.0, damping = {2 / 15!r}, rotating_damping = 0.4, speed = 0.5 /\n"
        "&tones frequency = 0.5 /\n&tie parameter = 'structure%speed', to = 'tones%frequency' /\n&harmonics order = 15 /\n"
        "&load dof = 'x', tuple = 1, cos = 0.25, frequency_power = 2 /\n"
        "&load dof = 'y', tuple = 1, sin = 0.25, frequency_power = 2 /\n"
        "&load dof = 'x', tuple = 0, cos = -0.3924 /\n&law type = 'cubic_damping', dofs = 'x', coefficient = 0.25 /\n"
        "&law type = 'cubic_damping', dofs = 'y', coefficient = 0.25 /\n", 0.5, 2.0),
    "Ueda": Case(
        ("x' = p", "p' = -.1*p - x^3 + b*u"),
        ONE + "ground_stiffness = 0.0, damping_mass = 0.1 /\n&tones frequency = 1.0 /\n&harmonics order = 41, symmetry = 'none' /\n"
        "&load dof = 'x1', tuple = 1, cos = 4.5 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /\n"
        "&solver first_guess = 'integration' /\n", 4.5, 5.2, load=True),
}  # fmt: skip


def by_auto(case: Case) -> list[tuple[int, float]]:
    """Kinds and values along AUTO's curve, in its order."""
    import xpplab

    w, steps = 1.0 if case.load else case.start, 400
    period = 2 * math.pi / w
    at_rest = ", ".join(equation.split("'")[0] + "=0" for equation in case.equations)
    text = [*case.equations, *ROTATION, f"par w={w!r}, b={case.start!r}", f"init {at_rest}, u=1, v=0"]
    text += [f"@ total={case.transient * period!r}, trans={(case.transient - 1) * period!r}, dt={period / steps!r}"]
    text += ["@ meth=rk4, maxstor=1000000, bound=1e6", "done"]
    with xpplab.Model.from_text("\n".join(text) + "\n") as model:
        model.run()
        model.ic_last()
        model.set(total=period, trans=0)
        model.run()
        step = math.copysign(0.01, case.stop - case.start)
        low, high = sorted((case.start, case.stop))
        given = {**SETTINGS, "ds": step, "dsmax": case.longest_step, "nmax": 2000, **case.settings}
        diagram = model.auto.start("periodic", "b" if case.load else "w", parmin=low - 1e-3, parmax=high, **given)
        return [(KINDS[point.type], point.value) for point in diagram.labelled() if point.type in KINDS]


def by_nhbm(case: Case) -> list[tuple[int, float]]:
    """The same of the curve of nhbm."""
    path, column = ("load(1)%cos", "load_1_cos") if case.load else ("tones%frequency", "tones_frequency")
    with tempfile.TemporaryDirectory() as folder:
        name = Path(folder, "curve.nml")
        span = f"from = {case.start!r}, to = {case.stop!r}"
        name.write_text(f"{case.model}&curve parameter = '{path}', {span}, points = 2000 /\n")
        done = run("solve", name, "--quiet", cwd=folder)
        if done.status not in (0, 4):
            raise RuntimeError(done.stderr)
        with h5py.File(name.with_suffix(".h5")) as file:
            points = zip(file["curve_kind"][()].tolist(), file[column][()].ravel().tolist())
            return [(kind, value) for kind, value in points if kind in WORDS]


def pairs(case: Case) -> list[tuple[int, float, float]]:
    """Kind of each point, its value by AUTO and by nhbm."""
    theirs, ours = by_auto(case), by_nhbm(case)
    if [kind for kind, _ in ours] != [kind for kind, _ in theirs]:
        raise ArithmeticError(f"AUTO: {theirs}, nhbm: {ours}")
    return [(kind, expected, value) for (kind, expected), (_, value) in zip(theirs, ours)]


def main(words: list[str]) -> None:
    print("| case | point | AUTO | nhbm | relative difference |\n|---|---|---|---|---|")
    for name, case in CASES.items():
        if words and not any(word in name for word in words):
            continue
        for kind, expected, value in pairs(case):
            print(f"| {name} | {WORDS[kind]} | {expected:.10f} | {value:.10f} | {abs(value / expected - 1):.0e} |", flush=True)
            name = ""


if __name__ == "__main__":
    main(sys.argv[1:])
