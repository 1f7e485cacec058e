"""Events that the stored points of a curve show, and what the result file reports of them. Reads the file alone.

Between neighbouring rows of a branch a sign change is an event: of the value along the curve (a turn), of a response that rises and
falls (an extreme), of the distance of a response to a requested amplitude, of the value to a requested one, of an extreme distance
to a kink of a law (a graze), of the number of growing disturbances (a bifurcation).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import h5py
import numpy as np

REGULAR, START, FOLD, PEAK, VALUE, END, BRANCH = 1, 2, 3, 4, 5, 6, 7
GRAZING, MINIMUM, AMPLITUDE = 11, 12, 13
BIFURCATIONS = (FOLD, BRANCH, 8, 9, 10, GRAZING)
REPORTS = ("located", "named", "small", "silent")
UNUSED, UNLOCATED = 17, 12  # status, reason
ROUNDING = 1e-9  # relative: smaller differences show nothing
AT_ZERO = 1e-6  # distance of a located graze from its kink, relative to the motion of the law
ERRORS = 3.0  # estimated errors of both ends: extremes that are lower may be left out
CLEAR = 0.02  # distance of all multipliers from the unit circle: nearer ones may be on either side
NEARBY = 5  # rows: a fold and the change of stability of its truncated motion
N_PHASES = {1: 2048, 2: 96, 3: 24}  # of each tone, on the first grid
N_TOPS = 6  # points of the grid from which an extreme is improved

Group = tuple[str, dict[str, list[float | str | bool]]]


@dataclass(frozen=True)
class Event:
    """An event that two rows show, and how the file reports it: "located", "named" as not located, "small" or "silent"."""

    kind: str
    row: int  # the first row behind it
    value: float  # of the curve there
    report: str


def groups_of(text: str) -> list[Group]:
    """Groups of a complete input, each with the values of its keys."""
    groups: list[Group] = []
    for name, body in re.findall(r"(?ms)^&(\w+)(.*?)^\s*/", text):
        keys = dict(re.findall(r"(?m)^\s+(\w+(?:\(\d+\))?) = (.*)$", body))
        groups.append((name, {key: [_value(word) for word in re.findall(r"'[^']*'|[^,\s]+", said)] for key, said in keys.items()}))
    return groups


def _value(word: str):
    if word.startswith("'"):
        return word.strip("'")
    if word.startswith("."):
        return word == ".true."
    return float(word)


class Curve:
    """The rows of one curve of a file."""

    def __init__(self, file: h5py.File, rows: np.ndarray):
        self.rows = rows
        self.groups = groups_of(file["input_complete"][()].decode())
        keys = dict(self.groups)["curve"]
        self.keys, self.path = keys, str(keys["parameter"][0])
        self.kind, self.branch, self.length = (file[f"curve_{name}"][...][rows] for name in ("kind", "branch", "length"))
        self.response, self.reason = file["curve_response"][...][rows], file["reason"][...][rows]
        unknowns, n = file["curve_unknowns"][...][rows], file["curve_n_unknowns"][...][rows]
        direction = file["curve_direction"][...][rows]
        self.rise = np.array([row[k - 1] if k > 0 else np.nan for row, k in zip(direction, n)])
        self.value = np.array([row[k - 1] if k > 0 else np.nan for row, k in zip(unknowns, n)])
        self.error = np.nanmax([np.hypot(file["truncation_estimate"][...], file["aliasing_estimate"][...])[rows],
                                file["level_estimate"][...][rows] if "level_estimate" in file else np.zeros(len(rows)),
                                np.zeros(len(rows))], axis=0)
        self.dofs = [label.decode() if isinstance(label, bytes) else label for label in file["dof"][...]]
        coefficients = np.nan_to_num(file["coefficients"][...][rows])
        self.c = coefficients[..., 0] - 1j * coefficients[..., 1]  # (row, dof, harmonic)
        self.tuples = (np.broadcast_to(file["tuple"][...], (len(rows), *file["tuple"].shape)) if "tuple" in file
                       else file["tuples"][...][rows])
        self.n_unstable, self.is_stable = file["n_unstable"][...][rows], file["is_stable"][...][rows]
        self.margin = np.zeros(len(rows))  # distance of the multipliers from the unit circle
        if "multiplier_real" in file:
            sizes = np.hypot(file["multiplier_real"][...][rows], file["multiplier_imag"][...][rows])
            self.margin = np.min(np.nan_to_num(np.abs(sizes - 1.0), nan=1.0), axis=1)
        self.message = [bytes(text).rstrip(b"\0 ").decode(errors="replace") for text in file["message"][...][rows]]

    def parts(self) -> Iterator[np.ndarray]:
        """Rows of each direction of each branch, in their order along the curve."""
        starts = [*np.flatnonzero(self.kind == START), len(self.kind)]
        for first, last in zip(starts[:-1], starts[1:]):
            here = np.arange(first, last)
            for is_backward in (False, True):
                some = here[(self.length[here] < 0.0) == is_backward]
                some = some[np.argsort(np.abs(self.length[some]), kind="stable")]
                yield np.concatenate([[first], some]) if is_backward else some

    def of(self, label: str) -> np.ndarray:
        """Complex amplitudes of a degree of freedom, (row, harmonic)."""
        return self.c[:, self.dofs.index(label)]

    def measure(self, name: str) -> np.ndarray:
        """A response of `peak_of` and the like at all rows."""
        label, _, tuple_ = name.partition("(")
        c = np.abs(self.of(label.strip())) ** 2
        if tuple_:
            wanted = [int(j) for j in tuple_.rstrip(")").split(",")]
            return np.sqrt(np.sum(c * np.all(self.tuples == wanted, axis=-1), axis=-1))
        return np.sqrt(0.5 * np.sum(c * np.any(self.tuples != 0, axis=-1), axis=-1))

    def responses(self) -> list[tuple[int, str, float]]:
        """Kind, name and target of the responses, in the order of their numbers."""
        listed = []
        for key, kind, targets in (("peak_of", PEAK, ""), ("minimum_of", MINIMUM, ""), ("amplitude_of", AMPLITUDE, "amplitudes")):
            for name in self.keys.get(key, []):
                listed += [(kind, str(name), float(target)) for target in (self.keys[targets] if targets else [0.0])]
        return listed

    def distances(self) -> Iterator[tuple[str, np.ndarray, float]]:
        """Smallest and largest distance to each kink of the laws at all rows, (row, 2), and the unit of their errors."""
        for number, keys in enumerate((keys for name, keys in self.groups if name == "law"), 1):
            labels = [str(label) for label in keys.get("dofs", keys.get("dof", []))]
            motions = [self.of(label) for label in labels]
            if keys["type"] == ["annular_clearance"]:
                for_all, kinks = motions, [("r", 1.0, self._number(keys, number, "clearance"))]
            else:
                weights = keys.get("weights", [1.0] * len(labels))
                for_all = [sum(w * c for w, c in zip(weights, motions))] if motions else []
                if keys["type"] == ["elastic_stop"]:
                    gap = self._number(keys, number, "gap")
                    kinks = [("+", 1.0, gap), *([("-", -1.0, gap)] if keys["two_sided"] == [True] else [])]
                elif keys["type"] == ["piecewise_linear"]:
                    kinks = [(str(b), 1.0, np.full(len(self.kind), b)) for b in keys["breakpoints"]]
                else:
                    continue
            for name, sense, kink in kinks:
                found = np.array([self._extremes(row, for_all, sense) for row in range(len(self.kind))])
                yield f"law {number} {name}", found[:, :2] - kink[:, None], found[:, 2]

    def _number(self, keys: dict, number: int, key: str) -> np.ndarray:
        """A number of a law at all rows: it may be that of the curve."""
        if re.fullmatch(rf"law(\({number}\))?%{key}", self.path):
            return self.value
        return np.full(len(self.kind), float(keys[key][0]))

    def _extremes(self, row: int, motions: list[np.ndarray], sense: float) -> tuple[float, float, float]:
        """Smallest and largest value of a coordinate, or of the radius of two, over the torus, and the size of the motion."""
        used = np.any([np.abs(c[row]) > 0 for c in motions], axis=0)
        tuples = self.tuples[row][used].astype(float)
        c = np.array([sense**(len(motions) == 1) * motion[row][used] for motion in motions])
        n_tones = tuples.shape[1]

        def at(phases):  # (point, tone)
            z = (np.exp(1j * phases @ tuples.T) @ c.T).real
            return np.hypot(*z.T) if len(motions) == 2 else z[:, 0]

        axis = np.linspace(0.0, 2 * np.pi, N_PHASES[n_tones], endpoint=False)
        grid = np.stack(np.meshgrid(*[axis] * n_tones, indexing="ij"), axis=-1).reshape(-1, n_tones)
        values = at(grid)
        ends = []
        for sign in (-1.0, 1.0):
            tops = grid[np.argsort(-sign * values)[:N_TOPS]]
            ends.append(sign * max(_top(lambda p, sign=sign: sign * at(p), top, axis[1]) for top in tops))
        return *ends, float(np.sum(np.abs(c)) + 1e-300)


def _top(of, phases: np.ndarray, width: float) -> float:
    """A local maximum near given phases, by a pattern search that shrinks."""
    n = len(phases)
    pattern = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * n, indexing="ij"), axis=-1).reshape(-1, n)
    best = of(phases[None])[0]
    while width > 1e-6:
        around = of(phases + width * pattern)
        k = int(np.argmax(around))
        if around[k] > best:
            phases, best = phases + width * pattern[k], around[k]
        else:
            width *= 0.4
    return best


def events_of(curve: Curve) -> list[Event]:
    """All events that the rows of a curve show."""
    found: list[Event] = []
    measures = [curve.measure(name) for _, name, _ in curve.responses()]
    distances = list(curve.distances())
    unit = np.sqrt(2.0) * np.max([curve.measure(label) for label in curve.dofs])  # of estimates
    for rows in curve.parts():
        if len(rows) < 2:
            continue
        found += _turns(curve, rows)
        if curve.kind[rows[-1]] == END and curve.value[rows[-1]] == curve.value[rows[0]] and not np.any(curve.kind[rows] == FOLD):
            found.append(Event("end at the start", int(rows[-1]), float(curve.value[rows[-1]]), "silent"))
        for number, ((kind, name, target), measure) in enumerate(zip(curve.responses(), measures), 1):
            is_this = (curve.kind == kind) & (curve.response == number)
            if kind == AMPLITUDE:
                found += _crossings(curve, rows, f"amplitude {name}", measure - target, is_this, ROUNDING * target)
            else:
                sense = 1.0 if kind == PEAK else -1.0
                rounding = ROUNDING * np.sqrt(np.sum(np.abs(curve.of(name.partition("(")[0].strip())) ** 2, axis=-1))
                found += _extremes(curve, rows, f"{'peak' if kind == PEAK else 'minimum'} {name}", sense * measure, is_this,
                                   curve.error * unit + rounding)
        span = np.ptp([curve.keys["from"][0], curve.keys["to"][0]])
        for wanted in curve.keys.get("values", []):
            found += _crossings(curve, rows, "value", curve.value - wanted, curve.kind == VALUE, ROUNDING * span)
        for name, extremes, size in distances:
            for side in range(2):
                found += _crossings(curve, rows, f"graze {name}", extremes[:, side], curve.kind == GRAZING, AT_ZERO * size)
        if curve.tuples.shape[-1] == 1:
            found += _changes_of_stability(curve, rows)
    return found


def _report(curve: Curve, rows: np.ndarray, i: int) -> str:
    """Whether the file names what it did not locate on the step that ends at or behind the i-th row."""
    for row in rows[i:]:
        if curve.reason[row] == UNLOCATED:
            return "named"
        if curve.kind[row] == REGULAR:
            break
    return "silent"


def _turns(curve: Curve, rows: np.ndarray) -> list[Event]:
    """Steps between whose ends the tangent changes its direction along the value, or the value moves against it."""
    found = []
    value, error = curve.value[rows], curve.error[rows] * np.abs(curve.value[rows])
    steps = [i for i, row in enumerate(rows) if curve.kind[row] in (START, REGULAR) and np.isfinite(curve.rise[row])]
    for i, k in zip(steps[:-1], steps[1:]):
        between = curve.kind[rows[i + 1 : k]]
        n_folds, has_branched = int((between == FOLD).sum()), bool(np.any(between == BRANCH))
        rise, fall = curve.rise[rows[i]], curve.rise[rows[k]]
        is_turn, is_against = rise * fall < 0.0, n_folds == 0 and rise * fall > 0.0 and (value[k] - value[i]) * rise < 0.0
        if not (is_turn or is_against or n_folds):
            continue
        if not is_against and (n_folds % 2 == is_turn or (is_turn and has_branched)):
            report = "located"
        else:
            of = value if rise > 0.0 else -value
            top = i + int(np.argmax(of[i : k + 1])) if is_turn else i
            ways = (-1, 1) if is_turn else (1,)
            near = [j for way in ways for j, is_level in _way(of, error, top, way) if is_level]
            is_clear = _is_clear(of, error, top, ways) and not np.any(curve.kind[rows[near]] == FOLD)
            report = _report(curve, rows, k) if is_clear else "small"
        kind = "fold" if is_turn else "step back" if is_against else "fold that is none"
        found.append(Event(kind, int(rows[k]), float(value[k]), report))
    return found


def _extremes(curve: Curve, rows: np.ndarray, kind: str, of: np.ndarray, is_located: np.ndarray, error) -> list[Event]:
    """Local maxima inside a part of the curve. Of several on one peak the first is reported."""
    of, error = of[rows], error[rows]
    least = ROUNDING * (np.ptp(of) + 1e-300)
    found = []
    for i in range(1, len(rows) - 1):
        if not (of[i] - of[i - 1] > least and of[i] - of[i + 1] > least):
            continue
        on_peak = [i, *(k for way in (-1, 1) for k, is_level in _way(of, error, i, way) if is_level)]
        if np.any(is_located[rows[on_peak]]):
            report = "located"
        else:
            report = _report(curve, rows, i) if _is_clear(of, error, i) else "small"
        found.append(Event(kind, int(rows[i]), float(curve.value[rows[i]]), report))
    return found


def _way(of: np.ndarray, error: np.ndarray, i: int, way: int) -> Iterator[tuple[int, bool]]:
    """The rows on one side of a maximum, and whether each is level with it within the errors up to there; the first that is not is
    the last."""
    limit = ERRORS * error[i]
    for k in range(i - 1, -1, -1) if way < 0 else range(i + 1, len(of)):
        limit = max(limit, ERRORS * error[k])
        is_level = bool(abs(of[i] - of[k]) <= limit)
        yield k, is_level
        if not is_level:
            return


def _is_clear(of: np.ndarray, error: np.ndarray, i: int, ways: tuple[int, ...] = (-1, 1)) -> bool:
    """Whether a maximum falls on its sides by more than the errors before it rises by as much."""
    for way in ways:
        last = list(_way(of, error, i, way))[-1:]
        if not last or last[0][1] or of[last[0][0]] > of[i]:
            return False
    return True


def _crossings(curve: Curve, rows: np.ndarray, kind: str, distance: np.ndarray, is_located: np.ndarray, zero) -> list[Event]:
    """Sign changes between rows that are not at zero themselves; those at zero are located, or show nothing."""
    found = []
    zero = np.broadcast_to(zero, distance.shape)
    before, was_located = None, False
    for i, row in enumerate(rows):
        if abs(distance[row]) <= zero[row]:
            was_located = was_located or bool(is_located[row])
            continue
        if before is not None and distance[row] * before < 0.0:
            report = "located" if was_located else _report(curve, rows, i)
            found.append(Event(kind, int(row), float(curve.value[row]), report))
        before, was_located = distance[row], False
    return found


def _changes_of_stability(curve: Curve, rows: np.ndarray) -> list[Event]:
    """Changes of the number of growing disturbances: each has an event on the way, or, as multipliers of a truncated motion pass 1
    beside its folds, one nearby that has no other change. The summary of the run counts the others."""
    bifurcations = [i for i, row in enumerate(rows) if curve.kind[row] in BIFURCATIONS]
    known = [i for i, row in enumerate(rows) if curve.is_stable[row] != 0 and curve.margin[row] >= CLEAR and i not in bifurcations]
    changes = [(i, k) for i, k in zip(known[:-1], known[1:]) if curve.n_unstable[rows[i]] != curve.n_unstable[rows[k]]]
    taken = {j for i, k in changes for j in bifurcations if i < j < k}
    found = []
    for i, k in changes:
        beside = [j for j in bifurcations if i - NEARBY <= j <= k + NEARBY and (i < j < k or j not in taken)]
        taken |= set(beside[:1])
        row = int(rows[k])
        found.append(Event("bifurcation", row, float(curve.value[row]), "located" if beside else "named"))
    return found


def curves_of(file: h5py.File) -> list[Curve]:
    """All curves of a file: one for each point of its sweep."""
    used = (file["status"][...] != UNUSED) & (file["curve_kind"][...] > 0)
    n = int(dict(groups_of(file["input_complete"][()].decode()))["curve"]["points"][0])
    rows = np.flatnonzero(used)
    return [Curve(file, rows[rows // n == k]) for k in np.unique(rows // n)]
