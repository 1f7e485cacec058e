"""Systems that others have published with numbers: their number as it is printed, its source, and the same number by nhbm.

A system is a function that returns the numbers of nhbm in the order of `printed`. Inputs are those of the repository or of the
folder inputs/; the others are built in the function.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import nhbm

ROOT = Path(__file__).resolve().parents[1]
ASTER = "https://github.com/ehmoussi/code_aster/blob/master/astest"
RPM = math.pi / 30


@dataclass(frozen=True)
class System:
    """A system, the numbers that were printed with their names, who printed them, and how nhbm finds them."""

    name: str
    source: str  # Markdown
    kind: str  # of their numbers
    input: str  # Markdown, a path in the repository or the name of the function
    printed: Sequence[tuple[str, str]]
    solve: Callable[[], Sequence[float]]
    note: str = ""
    peer: str = ""  # name of the peer of peers.py that is timed


SYSTEMS: list[System] = []


def system(name: str, source: str, kind: str, printed: Sequence[tuple[str, str]], input: str = "", note: str = "", peer: str = ""):
    """Adds a function to the list of systems."""

    def added(solve: Callable[[], Sequence[float]]) -> Callable[[], Sequence[float]]:
        SYSTEMS.append(System(name, source, kind, input or f"`{solve.__name__}`", printed, solve, note, peer))
        return solve

    return added


def own(name: str) -> nhbm.Model:
    return nhbm.Model.from_file(ROOT / "benchmarks" / "inputs" / f"{name}.nml")


def of_repository(name: str) -> nhbm.Model:
    return nhbm.Model.from_file(ROOT / "inputs" / f"{name}.nml")


# The method


@system("Beam with a cubic spring, two tones", "the paper of the method, table 2 ([theory](../docs/why/theory.md))",
        "direct expansion",
        [("cos of tone 1 [m]", "1.190871824484995e-3"), ("cos of tone 2 [m]", "1.191004700829494e-3"),
         ("sin of tone 1 [m]", "1.159230995878226e-6"), ("sin of tone 2 [m]", "1.340061751905898e-6")],
        "[paper/table2](../inputs/paper/table2.nml)",
        "the beam's data are not printed: those of the input reproduce these digits")  # fmt: skip
def beam_of_the_paper() -> list[float]:
    motion = of_repository("paper/table2").solve()
    first, second = (complex(motion.nhbm.harmonic("v3", j)) for j in ((1, 0), (0, 1)))
    return [first.real, second.real, -first.imag, -second.imag]


# Circuits

QUANTUM = 3.29105976e-16  # reduced flux quantum as there [Wb]
PUMP = 2 * math.pi * 4.75001  # [rad/ns]
SCALE = 1e-9  # of the equations: the junction's 1/(1 nH) becomes 1


def amplifier(tones: list[float]) -> nhbm.Model:
    """Node fluxes over the reduced flux quantum, time in ns: a port of 50 ohm, 100 fF to a junction of 1 nH with 1 pF."""
    coupling, own_capacity = 100e-15 * 1e18 * SCALE, 1000e-15 * 1e18 * SCALE
    model = nhbm.Model(
        nhbm.Matrices(mass=[[coupling, -coupling], [-coupling, coupling + own_capacity]], stiffness=np.zeros((2, 2)),
                      damping=[[1e9 / 50.0 * SCALE, 0.0], [0.0, 0.0]]),
        tones=tones)  # fmt: skip
    model.law(nhbm.law(lambda q: np.sin(q)), "x2")
    return model


def current(amperes: float) -> float:
    return amperes / QUANTUM * SCALE


JOSEPHSON = "[JosephsonCircuits.jl, test/hbsolve.jl](https://github.com/kpobrien/JosephsonCircuits.jl/blob/main/test/hbsolve.jl)"


@system("Josephson parametric amplifier: pump", JOSEPHSON, "16 harmonics",
        [("flux 1 at the port", f"{abs(-0.013189575486618105 - 0.00865077163136891j):.13g}"),
         ("flux 1 at the junction", f"{abs(0.12157593753208869 + 0.07973582696437984j):.13g}"),
         ("flux 3 at the junction", f"{abs(1.3736443951855489e-5 - 6.463164795537436e-5j):.13g}")],
        note="fluxes over the reduced flux quantum, |X| of X exp(i w t)")  # fmt: skip
def josephson_pump() -> list[float]:
    model = amplifier([PUMP])
    model.load("x1", 1, cos=current(2 * 0.00565e-6))
    motion = model.solve(order=15)
    return [float(motion.nhbm.amplitude(dof, k)) / 2 for dof, k in (("x1", 1), ("x2", 1), ("x2", 3))]


@system("Josephson parametric amplifier: gain", JOSEPHSON, "16 harmonics",
        [("gain at 4.70 GHz [dB]", "0.7108074673012084"), ("gain at 4.74 GHz [dB]", "8.16945893982768"),
         ("gain at 4.75 GHz [dB]", "13.302337843265873")])  # fmt: skip
def josephson_gain() -> list[float]:
    """Reflection of a small signal beside the pump: derivative of the motion by the signal's current."""
    found = []
    for gigahertz in (4.70, 4.74, 4.75):
        signal = 2 * math.pi * gigahertz
        model = amplifier([PUMP, signal])
        model.load("x1", (1, 0), cos=current(2 * 0.00565e-6))
        model.load("x1", (0, 1), cos=0.0)
        model.set("harmonics", order=[9, 1])
        model.set("gradient", by=["load(2)%cos"])
        motion = model.solve()
        tuples = motion["tuples" if "tuples" in motion else "tuple"].values
        at = int(np.flatnonzero((np.atleast_2d(tuples) == [0, 1]).all(axis=-1))[0])
        slope = motion["gradient"].isel(gradient_value=0, harmonic=at).sel(dof="x1").values
        voltage = 1j * signal * 1e9 * QUANTUM * (slope[0] - 1j * slope[1]) * SCALE / QUANTUM  # of one ampere
        found.append(20 * math.log10(abs(2 * voltage / 50.0 - 1)))
    return found


# Contact and friction


@system("Block on a vibrating plane, Coulomb friction", f"[code_aster, SDND104]({ASTER}/sdnd104a.comm)", "quasi-analytic",
        [("wear power, 15 m/s2 [W]", "15.2671"), ("wear power, 1.5 m/s2 [W]", "0.409062"),
         ("wear power, 1.01 m/s2 [W]", "2.26164e-4")],
        "[sdnd104](inputs/sdnd104.nml)",
        "normal force times mean sliding speed from 4 to 12 s after a start at rest, by nhbm's time integration: at 15 m/s2 the "
        "motion is not steady by then; the balance gives 15.1147 W")  # fmt: skip
def coulomb_block() -> list[float]:
    model, found = own("sdnd104"), []
    for acceleration in (15.0, 1.5, 1.01):
        model["load[0].sin"] = acceleration
        x = model.integrate(8.0, transient=4.0, step=2e-4)["displacement"].values.ravel()
        found.append(10.0 * float(abs(np.diff(x)).sum()) / 8.0)
    return found


def aster_frequency(energy: float, k: float, stop: float, gap: float) -> float:
    """Closed form of SDND122 [Hz]."""
    size = energy / (k * gap**2)
    free = 2 * math.acos(-1 / math.sqrt(2 * size))
    return math.sqrt(k) / (free + 2 * math.sqrt(k / (k + stop)) * math.acos(math.sqrt(k / (2 * size * (k + stop)))))


@system("Normal mode of a mass with a stop", f"[code_aster, SDND122]({ASTER}/sdnd122a.comm)", "closed form; their balance",
        [("frequency, closed form [Hz]", f"{aster_frequency(0.00650108331626, 10.0, 50.0, 0.01):.10g}"),
         ("frequency, MODE_NON_LINE [Hz]", "0.64669392749957")],
        "[sdnd122](inputs/sdnd122.nml)",
        "their closed form has 2 e (k + K) where the motion behind the gap gives 2 e (k + K) - K; with this term it is "
        "0.6466310406 Hz; "
        "their balance rounds the stop off")  # fmt: skip
def mode_with_stop() -> list[float]:
    frequency = float(own("sdnd122").solve()["frequency"][0]) / (2 * math.pi)
    return [frequency, frequency]


@system("Jenkins element, 3:1 superharmonic resonance",
        "[tmdsimpy, tests/test_vprnm.py](https://github.com/tmd-lab/tmdsimpy/blob/main/tests/test_vprnm.py)",
        "their balance, residual below 6e-5 and 4e-4",
        [("x(1), 1 N [m]", f"{math.hypot(1.28497308, 0.2842021):.9g}"),
         ("x(3), 1 N [m]", f"{math.hypot(0.50030017, 0.22542694):.9g}"),
         ("x(1), 100 N [m]", f"{math.hypot(150.01064345, 1.0314443):.11g}"),
         ("x(3), 100 N [m]", f"{math.hypot(9.20507502, 2.65110885):.9g}")],
        "[jenkins_3to1](inputs/jenkins_3to1.nml)")  # fmt: skip
def jenkins_3to1() -> list[float]:
    model, found = own("jenkins_3to1"), []
    for force, frequency in ((1.0, 0.3115958), (100.0, 0.28892166)):
        model["load[0].cos"], model["tones[0]"] = force, frequency
        motion = model.solve()
        found += [float(motion.nhbm.amplitude("x1", k)) for k in (1, 3)]
    return found


@system("Oscillator with rigid Coulomb friction", "J. P. Den Hartog, Trans. ASME 53 (1931) APM-107", "closed form",
        [("largest motion, 0.8 rad/s [m]", "2.62610487572"), ("largest motion, 1.5 rad/s [m]", "0.721110255093")],
        "[gallery/den_hartog](../inputs/gallery/den_hartog.nml)",
        "81 harmonics; the force jumps, so that the error of the series decreases like 1/order")  # fmt: skip
def den_hartog() -> list[float]:
    model, found = of_repository("gallery/den_hartog"), []
    for frequency in (0.8, 1.5):
        model["tones[0]"] = frequency
        found.append(float(model.solve(order=81).nhbm.largest("x1")))
    return found


def flip_of_shaw_and_holmes(damping: float = 0.1, restitution: float = 0.8) -> float:
    """Frequency at which the period doubles: a multiplier of the closed map of the orbits with an impact in each turn is -1."""
    from scipy.linalg import expm
    from scipy.optimize import brentq

    def largest(w: float) -> float:
        flow = expm(np.array([[0.0, 1.0], [-1.0, -damping]]) * 2 * np.pi / w)
        steady = 1 / (1 - w**2 + 1j * w * damping)
        along = np.linalg.solve(np.eye(2) - flow, flow @ [0.0, restitution] + [0.0, 1.0])
        v = abs(steady) / np.hypot(along[0], along[1] / w)
        t0 = (np.arctan2(-along[1] / w, along[0]) - np.angle(steady)) / w % (2 * np.pi / w)
        before, after = np.cos(w * t0) - damping * v, np.cos(w * t0) + damping * restitution * v
        turn = flow @ np.array([[-restitution, 0.0], [(after + restitution * before) / v, -restitution]])
        return float(np.linalg.eigvals(turn).real.min()) + 1

    return float(brentq(largest, 2.6, 2.7, xtol=1e-14))


@system("Impact oscillator: period doubling", "S. W. Shaw, P. J. Holmes, J. Sound Vib. 90 (1983) 129", "closed form of their map",
        [("flip [rad/s]", f"{flip_of_shaw_and_holmes():.10f}")],
        "[gallery/bouncing_mass](../inputs/gallery/bouncing_mass.nml)")  # fmt: skip
def shaw_holmes() -> list[float]:
    model = of_repository("gallery/bouncing_mass")
    curve = model.curve("tones[0]", 2.5, 2.8, points=30, order=12)
    return [float(curve["tones_frequency"].values[curve["curve_kind"].values == "period_doubling"][0])]


# Rotors

ROSS = "https://github.com/petrobras/ross"


def two_disk_rotor(stiffness: object, damping: float = 0.0) -> nhbm.Rotor:
    """M. I. Friswell, J. E. T. Penny, S. D. Garvey, A. W. Lees, Dynamics of Rotating Machines, 2010, example 5.9.1."""
    density, young, shear = 7810.0, 211e9, 81.2e9
    rotor = nhbm.Rotor(young=young, density=density, poisson=young / (2 * shear) - 1)
    rotor.shaft(np.linspace(0.0, 1.5, 7), 0.05)
    for z, outer in ((0.5, 0.28), (1.0, 0.35)):
        inner, width = 0.05, 0.07
        mass = density * math.pi * width * (outer**2 - inner**2) / 4
        rotor.disk(z, mass, mass * (3 * (outer**2 + inner**2) / 4 + width**2) / 12, mass * (outer**2 + inner**2) / 8)
    for z in (0.0, 1.5):
        rotor.bearing(z, stiffness, damping)
    return rotor


def whirls(rotor: nhbm.Rotor, rpm: float) -> list[float]:
    frequencies, growths = rotor.campbell([rpm * RPM])
    return sorted(np.hypot(frequencies[0], growths[0]).tolist())[:6]


def named(words: str, values: str) -> list[tuple[str, str]]:
    return [(f"{words} {k + 1} [rad/s]", value) for k, value in enumerate(values.split())]


@system("Friswell's rotor 5.9.1, equal bearings", f"[ROSS]({ROSS}), example 3 of its manual", "finite elements",
        named("whirl at 4000 rpm,", "85.389467 87.7958637 251.78460413 294.71333087 600.17936195 827.07536193"),
        peer="ross")  # fmt: skip
def friswell_1() -> list[float]:
    return whirls(two_disk_rotor(1e6), 4000)


@system("Friswell's rotor 5.9.2, unequal bearings", f"[ROSS]({ROSS}), example 4 of its manual", "finite elements",
        named("at rest,", "82.65303734 86.65811435 254.52047828 274.31285391 679.48903239 716.78631221")
        + named("whirl at 4000 rpm,", "82.32547398 86.86369902 239.64228361 287.24958074 583.48782916 806.8872843"))  # fmt: skip
def friswell_2() -> list[float]:
    rotor = two_disk_rotor(np.diag([1e6, 0.8e6]))
    return whirls(rotor, 0.0) + whirls(rotor, 4000)


@system("Friswell's rotor 5.9.4, cross-coupled bearings", f"[ROSS]({ROSS}), example 5 of its manual", "finite elements",
        named("whirl at 4000 rpm,", "84.19790045 89.03269396 246.44121183 301.08623205 594.81950178 834.0420378"),
        note="coupled in one direction alone, as there")  # fmt: skip
def friswell_4() -> list[float]:
    return whirls(two_disk_rotor(np.array([[1e6, 0.5e6], [0.0, 1e6]])), 4000)


@system("Friswell's rotor 5.9.5, damped bearings", f"[ROSS]({ROSS}), example 6 of its manual", "finite elements",
        [(f"size of eigenvalue {k + 1}, 4000 rpm [Hz]", value) for k, value in enumerate(
            "13.69730748 14.09185971 43.60796387 52.17870498 122.36522778 149.80603898".split())])  # fmt: skip
def friswell_5() -> list[float]:
    return [value / (2 * math.pi) for value in whirls(two_disk_rotor(1e6, 3e3), 4000)]


@system("Rotor on a squeeze film damper",
        "[HB-AD, example_rotor_SFD.py](https://github.com/shuizidesu/hb-ad) (Y. Chen et al., arXiv 2508.07309)",
        "circular whirl of their equations",
        [("radius at 100 rad/s [m]", "1.3030875858e-6"), ("radius at 300 rad/s [m]", "2.94172991e-5"),
         ("radius at 370 rad/s [m]", "3.03455111e-4"), ("radius at 380 rad/s [m]", "3.83861762e-4"),
         ("radius at 400 rad/s [m]", "1.52424080e-4"), ("radius at 600 rad/s [m]", "2.86499689e-5")],
        "[gallery/squeeze_film_damper](../inputs/gallery/squeeze_film_damper.nml)",
        "does not agree: their film force has an additional factor, the eccentricity ratio, and the opposite radial part; with it "
        "nhbm has their digits (tests/cases/test_squeeze_film.py)")  # fmt: skip
def squeeze_film() -> list[float]:
    model, found = of_repository("gallery/squeeze_film_damper"), []
    for speed in (100.0, 300.0, 370.0, 380.0, 400.0, 600.0):
        model["tones[0]"] = speed
        found.append(float(model.solve().nhbm.amplitude("x", 1)))
    return found


# Smooth systems


@system("Parametron", "HarmonicBalance.jl, test/parametron.jl (J. Kosata et al., SciPost Phys. Codebases 6 (2022))",
        "their equations of one harmonic, in closed form",
        [("amplitude [m]", f"{math.sqrt(4 / 3 * (1.05**2 - 1 + math.sqrt(0.2**2 - 0.105**2))):.12g}")],
        "[gallery/parametron](../inputs/gallery/parametron.nml)")  # fmt: skip
def parametron() -> list[float]:
    return [float(of_repository("gallery/parametron").solve(order=1).nhbm.amplitude("x1", 1))]


def by_auto(case: str) -> list[tuple[str, str]]:
    """Kinds and values of the located points of a case of docs/why/validation.md, as AUTO finds them."""
    rows, here, found = (ROOT / "docs" / "why" / "validation.md").read_text(encoding="utf-8").split("<!-- auto -->")[1], "", []
    for name, kind, value in re.findall(r"^\| ([^|]*)\| ([^|]+) \| ([\d.]+) \|", rows, re.MULTILINE):
        here = name.strip() or here
        if here == case:
            found.append((kind, value))
    return [(f"{kind} {k + 1}" if len(found) > 1 else kind, value) for k, (kind, value) in enumerate(found)]


def beside_auto(case: str) -> Callable[[], list[float]]:
    def solve() -> list[float]:
        import auto_reference

        return [value for _, value in auto_reference.by_nhbm(auto_reference.CASES[case])]

    return solve


PUBLIC = {
    "Duffing, NLvib 01": "[NLvib](https://github.com/maltekrack/NLvib), example 1 (Krack, Gross, Springer 2019)",
    "two masses, NLvib 02": "[NLvib](https://github.com/maltekrack/NLvib), example 2",
    "two springs, NLvib 06": "[NLvib](https://github.com/maltekrack/NLvib), example 6",
    "two Duffing, pyHarm": "[pyHarm](https://pypi.org/project/pyharm-os/), its example",
    "Duffing, CoSTAR": "[CoSTAR](https://github.com/Engineering-Dynamics-Group/CoSTAR), example",
    "forced van der Pol, CoSTAR, upwards": "[CoSTAR](https://github.com/Engineering-Dynamics-Group/CoSTAR), example",
    "forced van der Pol, CoSTAR, downwards": "[CoSTAR](https://github.com/Engineering-Dynamics-Group/CoSTAR), example",
    "Laval rotor, CoSTAR": "[CoSTAR](https://github.com/Engineering-Dynamics-Group/CoSTAR), example",
    "Ueda": "Y. Ueda, J. Stat. Phys. 20 (1979) 181",
}
for _case, _source in PUBLIC.items():
    SYSTEMS.append(System(_case[0].upper() + _case[1:], _source, "AUTO, collocation",
                          "[auto_reference.py](../tests/cases/auto_reference.py)",
                          by_auto(_case), beside_auto(_case), *(("nhbm: 41 harmonics, stability, bifurcations located", "pyharm")
                          if _case.endswith("pyHarm") else ())))  # fmt: skip
