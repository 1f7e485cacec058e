"""Runs a workflow and holds each point of its result against a motion of a high order and against integration in time."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import h5py
import numpy as np
from point_parts.models import KINDS
from point_parts.truth import Motion, error_of, neighbours_part
from program import command, environment

from workflow_parts.reference import Answer, Box, Mode, System, autonomous, forced, on_curve
from workflow_parts.models import Workflow

TOLERANCE = 1e-2  # the default of `&accuracy`
TIME_LIMIT = 12.0  # processor seconds of a run, where nothing else is asked for
ORDERS = {1: (45, 90, 180), 2: (9, 13, 18)}  # of the reference, one after the other until it has nothing to speak of beyond
REFINE = 1.2  # ratio of orders on the way to a reference that is not reached at once
SAMPLES = {1: 16, 2: 8}  # of the reference, times the order of each tone
MAX_TUPLES = 4000  # of a reference, whose matrices are dense
FINER = (1.3, 4)  # times these samples, where Newton's method goes round between contacts of samples
MIN_SAMPLES = {1: 600, 2: 72}
BEYOND = 0.1  # largest tail of a reference, relative to the tolerance
BEYOND_TWO = 0.5
SHARE_OF_CURVE = 30  # points of a curve that are looked at
ONE_OF_MANY = "one of many"
ANSWERS = ("converged", "integrated")
RESUMED_AFTER = (0.02, 0.4)  # seconds until a run is stopped
GIVEN_UP = "references given up"
PATIENCE = 20.0  # processor seconds of the references of a model, after which only the direct way to one is tried


@dataclass
class Point:
    """The stored result of a point, and the true one."""

    number: int
    status: str
    estimate: float = 0.0
    error: float = np.nan  # against the motion of a high order, relative; NaN where none was found
    time_error: float = np.nan  # against integration in time
    said: str = ""  # of stability
    leaves: bool = False  # integration in time leaves it since neighbours part
    value: float = np.nan  # of the fastest swept parameter
    is_passed_over: bool = False  # only time integration could show this: unstable, or not one of those that were drawn for it

    @property
    def off(self) -> float:
        """Error over tolerance: by the motion of high order, where there is none by integration in time."""
        error = self.error if np.isfinite(self.error) or self.leaves else self.time_error
        return error / TOLERANCE


@dataclass
class Case:
    """What came of a workflow."""

    number: int
    kind: str
    title: str
    points: list[Point]
    seconds: float = 0.0  # of processor, of the program
    note: str = ""
    later: str = ""  # the law of LATER in the model

    def as_json(self) -> dict:
        return asdict(self)

    @staticmethod
    def of_json(line: dict) -> Case:
        return Case(**{**line, "points": [Point(**point) for point in line["points"]]})


@dataclass(frozen=True)
class Limits:
    """Processor seconds of the run of a workflow, and of the references of its points."""

    run: float = TIME_LIMIT
    references: float = 120.0


def hold(
    library, folder: Path, seed: int, number: int, workflow: Workflow, n_integrations: int, limits: Limits = Limits()
) -> Case:
    """Runs workflow `number` in `folder` and looks at all its points; at none where that takes longer than `limits`."""
    source = folder / f"workflow_{seed}_{number}.nml"
    result = source.with_suffix(".h5")
    source.write_text(f"! tests/campaigns/workflows --seed {seed} --first {number} --count 1: {workflow.title}\n" + workflow.text())
    result.unlink(missing_ok=True)
    case = Case(number, workflow.kind, workflow.title, [], later=workflow.later)
    draw = np.random.default_rng([seed, number, 1])
    case.seconds, case.note = _run(workflow, source, result, draw, limits.run)
    if not result.exists():
        return case
    try:
        with h5py.File(result) as file, _processor_time(limits.references):
            look_at(library, workflow, file, case, draw, n_integrations)
    except (TimeoutError, MemoryError) as reason:
        case.points.clear()
        case.note = f"{GIVEN_UP}: {reason or f'more than {limits.references:g} s'}"
    return case


@contextlib.contextmanager
def _processor_time(limit: float):
    """Ends what is in it by a TimeoutError."""

    def end(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _run(workflow: Workflow, source: Path, result: Path, draw, limit: float) -> tuple[float, str]:
    """Processor seconds, and what went wrong."""
    if workflow.kind != "resumed":
        return _process(limit, "solve", source, "-o", result, "--quiet", ranks=workflow.n_ranks)
    if draw.random() < 0.5:  # ends by itself, as a user does who sets a limit
        seconds, note = _process(limit, "solve", source, "-o", result, "--quiet", "--time-limit", "0.05")
    else:
        after = float(np.exp(draw.uniform(*np.log(RESUMED_AFTER))))
        which = signal.SIGKILL if draw.random() < 0.5 else signal.SIGTERM
        seconds, note = _process(limit, "solve", source, "-o", result, "--quiet", stopped=(after, which))
    if not result.exists():  # stopped before there was anything
        more, note = _process(limit, "solve", source, "-o", result, "--quiet")
        return seconds + more, note
    more, note = _process(limit, "resume", result, "--quiet")
    return seconds + more, note


def _process(limit: float, *words, ranks: int | None = None, stopped: tuple[float, int] | None = None) -> tuple[float, str]:
    limited = ["sh", "-c", f'ulimit -t {limit:.0f}; exec "$@"', "sh", *command(*words, ranks=ranks)]
    with tempfile.TemporaryDirectory(prefix="mpi-") as own, tempfile.TemporaryFile() as said:  # MPI clears its own under others
        variables = {**environment(), "TMPDIR": own}
        process = subprocess.Popen(limited, env=variables, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True)
        if stopped:
            time.sleep(stopped[0])
            os.kill(process.pid, stopped[1])  # `send_signal` would reap it, and wait4 find nothing
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = usage.ru_utime + usage.ru_stime
        if process.returncode in (0, 4) or stopped or "--time-limit" in words and process.returncode == 3:
            return seconds, ""
        said.seek(0)
        text = said.read().decode(errors="replace").strip().splitlines()
        late = seconds > 0.95 * limit
        return seconds, "no result in time" if late else f"exit status {process.returncode}: {text[-1] if text else ''}"


def look_at(library, workflow: Workflow, file: h5py.File, case: Case, draw, n_integrations: int) -> None:
    """Fills in the points of a case from a result file."""
    names = file["status"].attrs["flag_meanings"].split()
    statuses = [names[k] for k in file["status"][()]]
    paths = {_text(data.attrs["parameter"]): data[()] for data in file.values() if "parameter" in data.attrs}
    chosen = [i for i, status in enumerate(statuses) if status != "unused"]
    if workflow.kind == "curve" and len(chosen) > SHARE_OF_CURVE:
        chosen = sorted(draw.choice(chosen, SHARE_OF_CURVE, replace=False).tolist())
    found, began = {}, time.process_time()
    for i in chosen:
        values = {path: float(column[i]) for path, column in paths.items()}
        point = Point(i, statuses[i], value=values.get(workflow.axes[-1].path, np.nan))
        case.points.append(point)
        if point.status not in ANSWERS[: 1 + (workflow.later == "restitution")]:
            continue
        point.estimate = float(np.hypot(file["truncation_estimate"][i], file["aliasing_estimate"][i]))
        stable = {1: "stable", 0: "not known", -1: "unstable"}[int(file["is_stable"][i])]
        point.said = ONE_OF_MANY if file["n_full_stick"][i] > 0 else stable
        if point.said == ONE_OF_MANY:
            continue
        found[i] = Stored(workflow, file, i, values)
        point.error = found[i].error(time.process_time() - began < PATIENCE)
    if workflow.is_autonomous:
        return
    stable = [point for point in case.points if point.said == "stable"]
    others = [point for point in stable if np.isfinite(point.error)]
    picked = draw.choice(len(others), min(n_integrations, len(others)), replace=False) if others else []
    is_rigid = any(KINDS[law.kind] == "rigid_wall" for law in workflow.model.laws)
    without = [point for point in case.points if point.number in found and not np.isfinite(point.error)]
    integrated = [p for p in without if p.said == "stable" or is_rigid] + [others[k] for k in picked]
    if workflow.later:
        may = [p for p in without if p.said != "unstable"]
        integrated = [may[k] for k in draw.choice(len(may), min(n_integrations, len(may)), replace=False)] if may else []
        for point in without:
            point.is_passed_over = all(point is not one for one in integrated)
    for point in integrated:
        point.time_error, point.leaves = found[point.number].error_in_time(library)
        if workflow.later and point.leaves and point.said == "not known":
            point.leaves, point.is_passed_over = False, True


def _text(value) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


class Stored:
    """A stored motion, and motions near to it that are more accurate."""

    def __init__(self, workflow: Workflow, file: h5py.File, i: int, values: dict[str, float]):
        self.workflow, self.values = workflow, values
        self.model = workflow.at(values)
        self.omega = file["frequency"][i]
        n = int(file["n_harmonics"][i])
        self.tuples = file["tuples"][i, :n] if "tuples" in file else file["tuple"][()]
        self.coefficients = np.nan_to_num(file["coefficients"][i][:, : len(self.tuples)])  # (n_dofs, n, 2)
        self.damping = float(np.nan_to_num(file["artificial_damping"][i, 0]))
        self.better: Motion | None = None  # of a high order, where one was found at the same values

    def error(self, is_patient: bool = True) -> float:
        """Relative to the motion at the coordinates of the laws, and of a frequency or a value that was found; NaN where no motion
        of a high order was found, `is_patient` after finer grids and lower orders were tried."""
        if not self.has_reference:
            return np.nan
        m = len(self.omega)
        for order in ORDERS[m]:
            orders = tuple(int(max(order, 1.5 * n)) if m == 1 else int(max(order, n + 2)) for n in self.reach)
            system, start = self._system(orders)
            answer, change = self._answer(system, start)
            for times in FINER if m == 1 and is_patient else ():
                if not answer.is_solved:
                    system, start = self._system(orders, times)
                    answer, change = self._answer(system, start)
            is_first = order == ORDERS[m][0] and not self.workflow.is_autonomous
            if not answer.is_solved and m == 1 and is_patient and is_first:
                answer, change = self._climbed(system)
            if not answer.is_solved:
                return np.nan
            stored = system.shapes @ start
            z = system.shapes @ answer.z if self.workflow.is_autonomous else answer.z
            if system.box.tail(z) < TOLERANCE * (BEYOND if m == 1 else BEYOND_TWO):
                if not self.workflow.is_autonomous and self.workflow.kind != "curve":
                    amplitudes = system.all_dofs(answer.z, answer.omega, self.model.damping)
                    self.better = Motion(system.box.tuples @ self.omega, amplitudes)
                return float(np.hypot(system.box.norm(z - stored) / max(system.box.norm(z), 1e-300), change))
        return np.nan

    @property
    def has_reference(self) -> bool:
        """Not of rigid walls, nor of Jenkins elements on a torus, nor of laws of LATER."""
        if self.workflow.later:
            return False
        names = [KINDS[law.kind] for law in self.model.laws]
        return "rigid_wall" not in names and not (len(self.omega) > 1 and "jenkins" in names)

    @property
    def reach(self) -> np.ndarray:
        """Largest entries of the tuples of each tone."""
        return np.abs(self.tuples).max(0) if len(self.tuples) else np.zeros(len(self.omega), int)

    def _system(self, orders: tuple[int, ...], times: float = 1) -> tuple[System, np.ndarray]:
        """The model in a box, and the stored motion there."""
        m = len(orders)
        if np.prod([2 * n + 1 for n in orders]) > MAX_TUPLES:
            raise MemoryError(f"a box of orders {', '.join(map(str, orders))}")
        box = Box(orders, tuple(_fast(int(times * max(SAMPLES[m] * n, MIN_SAMPLES[m]))) for n in orders))
        return System(self.model, box), box.of(self.tuples, self.coefficients[..., 0], self.coefficients[..., 1])

    def _climbed(self, system: System) -> tuple[Answer, float]:
        """The motion in the box of `system` by way of lower orders, from that of the stored motion on."""
        below, q = self._system((max(int(self.reach[0]), 1),))
        while True:
            answer, change = self._answer(below, q)
            order = min(int(REFINE * below.box.orders[0]) + 1, system.box.orders[0])
            if not answer.is_solved or order == below.box.orders[0]:
                return answer, change
            q = below.all_dofs(answer.z, answer.omega, below.model.damping).T
            above = self._system((order,))[0]
            q, below = below.box.enlarged(q, above.box), above

    def _answer(self, system: System, start) -> tuple[Answer, float]:
        workflow = self.workflow
        if workflow.is_autonomous:
            mode = None
            if workflow.mode_dof is not None:
                value = self.values[workflow.axes[0].path]
                mode = Mode(workflow.mode_dof, **{workflow.measure: value})
            answer = autonomous(system, start, float(self.omega[0]), mode, self.damping)
            return answer, abs(float(answer.omega[0] / self.omega[0]) - 1)
        z = system.shapes @ start
        if workflow.kind != "curve":
            return forced(system, z, self.omega), 0.0
        path = workflow.axes[0].path
        value = self.values[path]

        def system_at(there):
            model = workflow.at({path: there})
            return System(model, system.box), model.omega

        answer = on_curve(system_at, z, value, abs(value))
        return answer, abs(answer.value / value - 1)

    def error_in_time(self, library) -> tuple[float, bool]:
        """Of integration in time from the motion, and whether neighbours part from it; not where integration from the motion of a
        high order remains there, so that only what attracts it is narrower than the error of the stored one."""
        values = self.coefficients
        motion = Motion(self.tuples @ self.omega, (values[..., 0] - 1j * values[..., 1]).T.copy())
        error = error_of(library, self.model, motion)
        leaves = error > TOLERANCE and neighbours_part(library, self.model, motion)
        if leaves and self.better is not None:
            leaves = error_of(library, self.model, self.better) > TOLERANCE
        return error, leaves


def _fast(n: int) -> int:
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 1
