"""Expected results that stand in an input file as comments, and their check against a result file.

    ! expect: [PARAMETER=VALUE ...] SUBJECT = NUMBER to TOLERANCE
    ! expect: [PARAMETER=VALUE ...] SUBJECT = NUMBER to N estimates
    ! expect: [PARAMETER=VALUE ...] SUBJECT < NUMBER
    ! expect: [PARAMETER=VALUE ...] status = NAME [or NAME ...]
    ! expect: [PARAMETER=VALUE ...] solved > NUMBER

SUBJECT is a coefficient, `DOF (j1,j2,...) cos|sin|amplitude`, the frequency of a tone, `tone M frequency`, or one of
penetration, residual, iterations, n_harmonics, truncation_estimate, aliasing_estimate.
TOLERANCE is relative; N estimates are N times the error that the file estimates of a frequency, or of a coefficient, relative
to it, by truncation and aliasing, and of a given frequency at which a point of a curve was located also by `level_estimate`; `<`
compares the magnitude. Parameters are named as in the result file (law_1_gap) and
select points, as does curve_kind (fold, peak, ...) where there are curves; without any, the line is about every point. It
must hold at each selected point, and there must be one. `solved` counts the points whose equations are solved, well enough
for the error estimate or not, and lets the others end as they do.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from nhbm_post.errors import ReaderError
from nhbm_post.outcome import NAMES
from nhbm_post.reader import Results

QUANTITIES = ("penetration", "residual", "iterations", "n_harmonics", "truncation_estimate", "aliasing_estimate")
COMPONENTS = ("cos", "sin", "amplitude")
STATUSES = tuple(name for name in NAMES.values() if name != "pending")
ANSWERED = ("converged", "integrated", "multiple_attractors")

_FORMS = (
    "[PARAMETER=VALUE ...] then DOF (j1,j2) cos|sin|amplitude or tone M frequency or "
    + "|".join(QUANTITIES)
    + ", then '= NUMBER to TOLERANCE', '= NUMBER to N estimates' or '< NUMBER'; or status = NAME [or NAME ...]; or solved > NUMBER"
)
_MARK = re.compile(r"!\s*expect", re.IGNORECASE)
_LINE = re.compile(r"\s*! expect: (.*\S)\s*")
_PARAMETER = re.compile(r"([A-Za-z]\w*)=(\S+)\s+")
_STATUS = re.compile(r"status = (\w+(?: or \w+)*)")
_SOLVED = re.compile(r"solved > (\d+)")
_COMPARISON = re.compile(r"(?P<subject>.+?) (?:= (?P<number>\S+) to (?P<tolerance>\S+)(?P<estimates> estimates)?|< (?P<bound>\S+))")
_FREQUENCY = re.compile(r"tone (\d+) frequency")
_COEFFICIENT = re.compile(r"(\S+) \(([^()]*)\) (\w+)")


class MalformedExpectation(ValueError):
    """A line that says `! expect` but not in one of the known forms."""


@dataclass(frozen=True)
class Expectation:
    """One line. `number` is what to find, or the bound where `tolerance` is None; that may be counted in estimates of the file."""

    text: str
    line: int
    parameters: dict[str, str] = field(default_factory=dict)
    status: str | None = None
    more_solved_than: int | None = None
    quantity: str | None = None
    tone: int | None = None
    dof: str | None = None
    j: tuple[int, ...] = ()
    component: str | None = None
    number: float = math.nan
    tolerance: float | None = None
    in_estimates: bool = False

    def points(self, results: Results) -> list[int]:
        """Points that the line is about; ReaderError where there are none. What a curve did not need is no point."""
        used = set(results.used.tolist())
        return [point for point in results.select(self.parameters) if point in used]

    def value(self, results: Results, point: int) -> float:
        """What the file holds in place of `number`."""
        if self.quantity:
            return float(results.per_point(self.quantity)[point])
        if self.tone:
            if self.tone > results.n_tones:
                raise ReaderError(f"there is no tone {self.tone}, the file has {results.n_tones}")
            return float(results.frequency(point)[self.tone - 1])
        if self.component == "amplitude":
            return results.amplitude(point, self.dof, self.j)
        cosine, sine = results.coefficients(point, self.dof, self.j)
        return float(cosine if self.component == "cos" else sine)

    def unit(self, results: Results, point: int) -> float:
        """Difference that a tolerance of 1 allows: as large as the number, or what the file estimates."""
        if not self.in_estimates:
            return abs(self.number)
        if self.tone and results.frequency_estimate(point)[self.tone - 1] > 0.0:
            return float(results.frequency_estimate(point)[self.tone - 1])
        estimates = (results.per_point(name)[point] for name in ("truncation_estimate", "aliasing_estimate"))
        of_motion = math.hypot(*estimates)
        return abs(self.number) * (max(of_motion, results.per_point("level_estimate")[point]) if self.tone else of_motion)

    def holds_for(self, value: float, unit: float) -> bool:
        """Whether a value is as expected; NaN never is."""
        if self.tolerance is None:
            return abs(value) < self.number
        return abs(value - self.number) <= self.tolerance * unit


def read_expectations(text: str) -> list[Expectation]:
    """All expectations of an input file; raises MalformedExpectation with the number of the line."""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if _MARK.search(line):
            found.append(_parse(line, number))
    return found


def failures(expectations: list[Expectation], results: Results) -> list[str]:
    """What does not hold, a sentence each. Points that no line gives a status must have converged."""
    problems = []
    expected_status = {point: "converged" for point in results.used.tolist()}
    for expectation in expectations:
        try:
            points = expectation.points(results)
        except ReaderError as error:
            problems.append(_sentence(expectation, str(error)))
            continue
        if expectation.more_solved_than is not None:
            n_solved = len(set(points).intersection(results.solved.tolist()))
            if n_solved <= expectation.more_solved_than:
                problems.append(_sentence(expectation, f"{n_solved} of {len(points)} are solved"))
            for point in points:
                expected_status.pop(point, None)
        elif expectation.status:
            expected_status.update((point, expectation.status) for point in points)
        else:
            problems += _wrong_values(expectation, results, points)
    for point, name in expected_status.items():
        if results.status_name(point) not in name.split(" or "):
            what = f"status is {results.status_name(point)}, not {name}"
            problems.append(f"{results.point_text(point)}: {what} {results.message(point)}".rstrip())
    return problems


def expects_only_converged(expectations: list[Expectation]) -> bool:
    """Whether no line tells of a point without an answer."""
    return all(e.status in (None, *ANSWERED) and e.more_solved_than is None for e in expectations)


def has_only_answers(results: Results) -> bool:
    """Whether each point that a curve needed is answered. Beyond its first point a curve may end where the amplitude of its unknown
    tone vanishes: the row is `collapsed` and no point of the curve."""
    kinds = results.curve_kind() if results.curve is not None else None

    def is_end(point: int) -> bool:
        return point > 0 and kinds is not None and results.status_name(point) == "collapsed" and kinds[point] == "none"

    return all(results.status_name(point) in ANSWERED or is_end(point) for point in results.used)


def _wrong_values(expectation: Expectation, results: Results, points: list[int]) -> list[str]:
    problems = []
    for point in points:
        try:
            value = expectation.value(results, point)
        except ReaderError as error:
            problems.append(_sentence(expectation, str(error)))
            continue
        if expectation.holds_for(value, expectation.unit(results, point)):
            continue
        found = f"found {value:.17g} at {results.point_text(point)}"
        if expectation.tolerance is not None and expectation.number:
            found += f", relative difference {abs(value / expectation.number - 1.0):.1e}"
        problems.append(_sentence(expectation, found))
    return problems


def _sentence(expectation: Expectation, what: str) -> str:
    return f"line {expectation.line}: '{expectation.text}': {what}"


def _parse(line: str, number: int) -> Expectation:
    match = _LINE.fullmatch(line)
    if not match:
        raise _malformed(number, line, "must be a comment of its own that begins with '! expect: '")
    text = rest = match[1]
    parameters: dict[str, str] = {}
    while parameter := _PARAMETER.match(rest):
        if parameter[1] in parameters:
            raise _malformed(number, line, f"names {parameter[1]} twice")
        parameters[parameter[1]] = parameter[2]
        rest = rest[parameter.end() :]
    common = {"text": text, "line": number, "parameters": parameters}

    if status := _STATUS.fullmatch(rest):
        for name in status[1].split(" or "):
            if name not in STATUSES:
                raise _malformed(number, line, f"unknown status '{name}'; known: {', '.join(STATUSES)}")
        return Expectation(status=status[1], **common)

    if solved := _SOLVED.fullmatch(rest):
        return Expectation(more_solved_than=int(solved[1]), **common)

    comparison = _COMPARISON.fullmatch(rest)
    if not comparison:
        raise _malformed(number, line, f"the form is {_FORMS}")
    if comparison["bound"]:
        common["number"] = _number(comparison["bound"], number, line)
        if not common["number"] > 0.0:
            raise _malformed(number, line, "a bound must be above 0, or nothing can hold")
    else:
        common["number"] = _number(comparison["number"], number, line)
        common["tolerance"] = _number(comparison["tolerance"], number, line)
        common["in_estimates"] = bool(comparison["estimates"])
        if not 0.0 <= common["tolerance"] < (10.0 if comparison["estimates"] else 1.0):
            raise _malformed(number, line, "the relative tolerance must be from 0 to below 1, or below 10 estimates")
        if common["number"] == 0.0 and common["tolerance"] > 0.0:
            raise _malformed(number, line, "no relative tolerance fits 0; use '< NUMBER'")

    subject = comparison["subject"]
    if subject in QUANTITIES and comparison["estimates"]:
        raise _malformed(number, line, f"{subject} has no estimate")
    if subject in QUANTITIES:
        return Expectation(quantity=subject, **common)
    frequency = _FREQUENCY.fullmatch(subject)
    if frequency and int(frequency[1]) > 0:
        return Expectation(tone=int(frequency[1]), **common)
    coefficient = _COEFFICIENT.fullmatch(subject)
    if not coefficient or coefficient[3] not in COMPONENTS:
        raise _malformed(number, line, f"'{subject}' is not a subject; the form is {_FORMS}")
    try:
        j = tuple(int(entry) for entry in coefficient[2].split(","))
    except ValueError:
        raise _malformed(number, line, f"({coefficient[2]}) is not a tuple of integers") from None
    return Expectation(dof=coefficient[1], j=j, component=coefficient[3], **common)


def _number(text: str, number: int, line: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _malformed(number, line, f"'{text}' is not a finite number")
    return value


def _malformed(number: int, line: str, what: str) -> MalformedExpectation:
    return MalformedExpectation(f"line {number}: '{line.strip()}': {what}")
