"""Error over processor time of time integration and of the balance, case by case."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from nhbm_post.bench import Bench
from runs import Balance, Refused, Model, integration, nhbm, rms, series

# A time integration is as good as it gets where a longer transient brings its error down by less than this.
SETTLED = 1.3
TRIES = 3
INTEGRATED = 18  # status of a point
TOO_LONG = 100.0  # processor seconds of a motion by tolerance, after which no finer one is asked for
LONG_ENOUGH = 0.1  # processor seconds from which a time integration is timed once
WINDOW_PERIODS = 10.0  # of the slowest tone


@dataclass(frozen=True)
class Case:
    """One model and what is tried on it."""

    name: str
    title: str
    model: Model
    sample: float  # [s], distance of the samples that are compared
    longest: float  # [s], time after which the start is forgotten to the last digit
    integrations: dict[str, tuple[int, ...]]  # method: steps in one sample
    orders: tuple[int, ...]
    reference_order: int
    tolerances: tuple[float, ...] = ()  # of cvode
    has_cvode_reference: bool = True  # no: too many degrees of freedom
    is_smooth: bool = True  # the balance of the reference order is the reference; else cvode, started from it
    slow_methods: tuple[str, ...] = ()  # solvers that are left out from `slow_order` on
    slow_order: int = 0
    improved_method: str = "broyden"


@dataclass
class Point:
    """One time integration or one balance: what it costs and how far off it is."""

    label: str
    seconds: float
    error: float
    transient: float = 0.0
    is_integrated: bool = False  # found by time integration, from the balance that came closest


@dataclass
class Finding:
    """All curves of a case."""

    case: Case
    curves: dict[str, list[Point]] = field(default_factory=dict)
    agreement: float = float("nan")  # relative rms difference of both ways to the reference

    def cheapest(self, is_integration: bool, error: float) -> tuple[str, Point] | None:
        """Fastest of all time integrations, or of all balances, with at most this error."""
        found = [
            (point.seconds, name, point)
            for name, points in self.curves.items()
            for point in points
            if (name in INTEGRATIONS) == is_integration and point.error <= error
        ]
        return min(found, key=lambda item: item[0])[1:] if found else None

    def least(self, is_integration: bool) -> float:
        return min(p.error for name, points in self.curves.items() for p in points if (name in INTEGRATIONS) == is_integration)


INTEGRATIONS = {
    "runge_kutta_4": "Runge-Kutta 4",
    "central_differences": "central differences",
    "generalized_alpha": "generalized alpha",
    "cvode": "CVODE",
}
STOP = {"dofs": ("q1", "q3"), "weights": (1.0, -1.0)}
MIDSPAN = {"dofs": ("v3",), "weights": (1.0,)}
MASS = {"dofs": ("x1",), "weights": (1.0,)}
ASKED_OF_SMOOTH = (1e-2, 1e-3, 1e-4, 1e-6, 1e-9)
ASKED_OF_KINKS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
# C2a with less damping is unstable, so that no time integration stays beside it; with tones of 0.8 and 1.294 rad/s it is stable.
SLOWER_TONES = ("tones%frequency(1)=0.8", "tones%frequency(2)=1.2944271909999159")
PAPER_BEAM = {
    "runge_kutta_4": (500, 700, 1000),
    "central_differences": (700, 2000),
    "generalized_alpha": (1, 2, 5, 20, 80, 320),
}

CASES = [
    Case(
        name="cubic_10",
        title="paper's beam, 10 N/m³",
        model=Model("order_sequence/paper_cubic", **MIDSPAN, sets=("law(1)%stiffness=10",)),
        sample=0.1,
        longest=9.0,
        integrations=PAPER_BEAM,
        tolerances=(1e-4, 1e-7, 1e-10, 1e-12),
        orders=(1, 3, 5, 7),
        reference_order=9,
    ),
    Case(
        name="cubic_1e10",
        title="paper's beam, 1e10 N/m³",
        model=Model("order_sequence/paper_cubic", **MIDSPAN),
        sample=0.1,
        longest=9.0,
        integrations=PAPER_BEAM,
        tolerances=(1e-4, 1e-7, 1e-10, 1e-12),
        orders=(3, 5, 7, 9, 11, 13, 15, 17, 19, 21),
        reference_order=25,
    ),
    Case(
        name="modal_1e10",
        title="beam of three modes, 1e10 N/m³",
        model=Model("order_sequence/dynamic_cubic", **STOP),
        sample=0.1,
        longest=16.0,
        integrations={
            "runge_kutta_4": (50, 100, 200, 400),
            "central_differences": (80, 400, 2000),
            "generalized_alpha": (1, 2, 5, 20, 80),
        },
        tolerances=(1e-4, 1e-7, 1e-10, 1e-12),
        orders=(3, 5, 7, 9, 11, 13, 15, 17, 19, 21),
        reference_order=25,
    ),
    Case(
        name="light_damping",
        title="lightly damped beam, fast tones",
        model=Model("order_sequence/light_damping", **STOP),
        sample=0.02,
        longest=1200.0,
        integrations={"runge_kutta_4": (10, 20, 40, 80), "central_differences": (16, 64, 160)},
        orders=(3, 5, 7, 9, 11, 13, 15),
        reference_order=21,
    ),
    Case(
        name="long_beam",
        title="beam of 200 degrees of freedom",
        model=Model("order_sequence/long_beam", dofs=("v51",), weights=(1.0,)),
        sample=0.1,
        longest=15.0,
        has_cvode_reference=False,
        integrations={"generalized_alpha": (1, 2, 5, 20, 80, 320)},
        orders=(3, 5, 7, 9, 11, 13, 15, 17, 19, 21),
        reference_order=25,
    ),
    Case(
        name="wall",
        title="paper's beam at a rigid wall",
        model=Model("order_sequence/paper_wall", **MIDSPAN, sets=("law(1)%augmentation=1e5",)),
        sample=0.02,
        longest=9.0,
        integrations={"central_differences": (40, 80, 160, 320, 640, 1280)},
        tolerances=TOLERANCES,
        orders=(3, 5, 7, 9, 11, 13, 17, 21),
        reference_order=13,
        is_smooth=False,
        slow_methods=("newton",),
        slow_order=15,
        improved_method="newton",
    ),
    Case(
        name="stop_c2a",
        title="one mass, elastic stop (C2a)",
        model=Model("order_sequence/stop_two_tones", **MASS),
        sample=0.1,
        longest=480.0,
        integrations={"runge_kutta_4": (1, 2, 4, 8, 16, 32, 64), "central_differences": (1, 4, 16, 64)},
        tolerances=TOLERANCES,
        orders=(3, 5, 7, 9, 13, 17, 21, 25),
        reference_order=17,
        is_smooth=False,
        slow_methods=("newton",),
        slow_order=21,
    ),
    *(
        Case(
            name=name,
            title=f"one mass, elastic stop, {title}",
            model=Model("order_sequence/stop_two_tones", **MASS, sets=(*SLOWER_TONES, f"structure%damping_mass={damping}")),
            sample=0.1,
            longest=40.0 / damping,
            integrations={"runge_kutta_4": (1, 2, 4, 8, 16), "central_differences": (1, 4, 16)},
            tolerances=TOLERANCES[:4],
            orders=(3, 5, 7, 9, 13),
            reference_order=17,
            is_smooth=False,
        )
        for name, title, damping in (
            ("stop_damped", "decay 0.1 1/s", 0.2),
            ("stop_tenth", "decay 0.01 1/s", 0.02),
            ("stop_hundredth", "decay 0.001 1/s", 0.002),
        )
    ),
    Case(
        name="dynamic_stop",
        title="beam of three modes, stop of 1e6 N/m",
        model=Model("order_sequence/dynamic_stop", **STOP),
        sample=0.02,
        longest=16.0,
        integrations={"runge_kutta_4": (10, 20, 40, 80, 160, 320, 640), "central_differences": (16, 80, 400)},
        tolerances=TOLERANCES,
        orders=(3, 5, 7, 9, 13, 17),
        reference_order=9,
        is_smooth=False,
        slow_methods=("newton",),
        slow_order=15,
    ),
    Case(
        name="jenkins",
        title="one mass, elastic friction (Jenkins)",
        model=Model("order_sequence/jenkins_two_tones", **MASS),
        sample=0.1,
        longest=800.0,
        integrations={"runge_kutta_4": (1, 2, 4, 8, 16, 32, 64), "central_differences": (1, 4, 16, 64)},
        tolerances=TOLERANCES,
        orders=(3, 5, 7, 9, 11, 13),
        reference_order=9,
        is_smooth=False,
    ),
]


def measure(case: Case, methods: list[str], folder: Path) -> Finding:
    """All curves of a case."""
    finding = Finding(case)
    window, t, reference = _reference(case, folder, finding)
    size = rms(reference[t >= case.longest])
    for method, divisions in case.integrations.items():
        levels = [(f"step {case.sample / n:.2g} s", (f"step={case.sample / n!r}", f"decimation={n}")) for n in divisions]
        finding.curves[method] = _integrations(case, method, levels, folder, window, t, reference)
    if case.tolerances:
        levels = [(f"tolerance {x:.0e}", (f"step={case.sample!r}", f"tolerance={x!r}")) for x in case.tolerances]
        finding.curves["cvode"] = _integrations(case, "cvode", levels, folder, window, t, reference)
    late = t >= case.longest
    for method in methods:
        finding.curves[method] = _balances(case, method, folder, t[late], reference[late], size)
    finding.curves["tolerance"] = _by_tolerance(case, folder, t[late], reference[late], size)
    if not case.is_smooth:
        finding.curves["improved"] = _improved(case, folder, t[late], reference[late], size)
    return finding


def _reference(case: Case, folder: Path, finding: Finding):
    """Window [s], times from 0 to its end, and the motion that is taken as true at them."""
    balance = Balance(case.model, folder, f"harmonics%order={case.reference_order}", "error_estimate%is_on=.false.")
    window = WINDOW_PERIODS * 2.0 * np.pi / balance.omega.min()
    window = case.sample * np.ceil(window / case.sample)
    t = case.sample * np.arange(int(round((case.longest + window) / case.sample)) + 1)
    settings = ("method='cvode'", f"step={case.sample!r}", "tolerance=1e-13")
    if not case.has_cvode_reference:
        return window, t, balance.at(t)
    duration = window if case.is_smooth else t[-1]
    record = integration(case.model, folder, *settings, f"duration={duration!r}", start=balance.start_groups())
    if case.is_smooth:
        reference = balance.at(t)
        finding.agreement = rms(record.x - reference[: len(record.x)]) / rms(reference)
        return window, t, reference
    rest = integration(case.model, folder, *settings, f"duration={t[-1]!r}")
    apart = np.abs(rest.x - record.x) / rms(record.x)
    finding.agreement = rms(apart[t >= case.longest])
    return window, t, record.x


def _integrations(case: Case, method: str, levels, folder: Path, window: float, t, reference) -> list[Point]:
    """Integrates from rest, each with the shortest transient after which its error over the window is about what it stays at."""
    points = []
    size = rms(reference[t >= case.longest])
    for label, settings in levels:
        seconds: list[float] = []
        try:
            while len(seconds) < TRIES and (not seconds or seconds[0] < LONG_ENOUGH):
                record = integration(case.model, folder, f"method='{method}'", *settings, f"duration={t[-1]!r}")
                seconds.append(record.cpu)
        except Refused as refusal:
            if "not finite" not in str(refusal):
                raise
            continue  # the step is beyond the limit of stability
        errors = _window_errors(record.x - reference, int(round(window / case.sample))) / size
        first = int(np.argmax(errors <= SETTLED * errors[-1]))
        share = (t[first] + window) / t[-1]
        points.append(Point(label, float(np.median(seconds)) * share, float(errors[first]), float(t[first])))
    return points


def _window_errors(difference: np.ndarray, n: int) -> np.ndarray:
    """Root mean square over n samples from each sample on."""
    sums = np.concatenate([[0.0], np.cumsum(np.square(difference[::-1]))])  # backwards: late errors are the small ones
    return np.sqrt((sums[n:] - sums[:-n]) / n)[::-1]


def _orders(case: Case, method: str) -> list[int]:
    return [n for n in case.orders if method not in case.slow_methods or n < case.slow_order]


def _balances(case: Case, method: str, folder: Path, t, reference, size: float) -> list[Point]:
    bench, orders = _bench(case, method, folder)
    omega = _base_frequencies(folder)
    points = []
    for i in np.flatnonzero(bench.is_solved):
        motion, model = bench.motion(i), case.model
        pairs = sum(w * motion.values[motion.dofs.index(dof)] for dof, w in zip(model.dofs, model.weights))
        error = rms(series(t, motion.tuples @ omega, pairs) - reference) / size
        points.append(Point(f"order {orders[i]}", float(bench.column("bench_cpu_seconds")[i]), error))
    return points


def _bench(case: Case, method: str, folder: Path, *sets: str) -> tuple[Bench, list[int]]:
    """Costs of a model over its orders, without kernels; and these orders."""
    source, result = folder / "order_sequence.nml", folder / "order_sequence.h5"
    orders = _orders(case, method)
    group = f"&sweep parameter='harmonics%order', values={', '.join(map(str, orders))} /\n"
    source.write_text(case.model.text() + group, encoding="utf-8")
    if not any(one.startswith("error_estimate") for one in sets):
        sets += ("error_estimate%is_on=.false.",)
    sets = (*case.model.sets, *sets, f"solver%method='{method}'", "stability%method='off'")
    nhbm("bench", source, result, sets, "--budget", "0", "--repeats", str(TRIES))
    return Bench(result), orders


def _by_tolerance(case: Case, folder: Path, t, reference, size: float) -> list[Point]:
    """Motions by `&accuracy`, timed as time integration is: with all levels and their error estimates, without stability."""
    source, result = folder / "tolerance.nml", folder / "tolerance.h5"
    source.write_text(case.model.without("harmonics", "sampling").text(), encoding="utf-8")
    points = []
    for tolerance in ASKED_OF_SMOOTH if case.is_smooth else ASKED_OF_KINKS:
        sets = (*case.model.sets, f"accuracy%tolerance={tolerance!r}", "stability%method='off'")
        seconds: list[float] = []
        while len(seconds) < TRIES and (not seconds or seconds[0] < LONG_ENOUGH):
            nhbm("bench", source, result, sets, "--budget", "0", "--repeats", "1")
            bench = Bench(result)
            seconds.append(float(bench.column("bench_cpu_seconds")[0]))
        if bench.is_solved[0]:
            motion = bench.motion(0)
            pairs = sum(w * motion.values[motion.dofs.index(dof)] for dof, w in zip(case.model.dofs, case.model.weights))
            error = rms(series(t, motion.tuples @ _base_frequencies(folder), pairs) - reference) / size
            is_integrated = bool(bench.column("status")[0] == INTEGRATED)
            points.append(Point(f"tolerance {tolerance:.0e}", float(np.median(seconds)), error, is_integrated=is_integrated))
        if max(seconds) > TOO_LONG:
            break
    return points


def _base_frequencies(folder: Path) -> np.ndarray:
    """Base frequencies, from the balance of the reference."""
    with h5py.File(folder / "balance.h5") as file:
        return file["frequency"][0]


def _improved(case: Case, folder: Path, t, reference, size: float) -> list[Point]:
    """Motions that are improved by some steps towards twice their order; the time is that of both."""
    method = case.improved_method
    steps = "error_estimate%improvement_steps=8"
    bench, orders = _bench(case, method, folder, steps)
    points = []
    for i in np.flatnonzero(bench.is_solved):
        order = orders[i]
        balance = Balance(case.model, folder, f"harmonics%order={order}", steps, f"solver%method='{method}'", name="improved")
        error = rms(balance.at(t, is_improved=True) - reference) / size
        points.append(Point(f"order {order}", float(bench.column("bench_cpu_seconds")[i]), error))
    return points
