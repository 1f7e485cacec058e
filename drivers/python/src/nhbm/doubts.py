"""Warnings about motions: one way for solve, response, gradient, curve and sweep, with the sentences of the library."""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from nhbm.errors import Implausible, Jump, NotConverged
from nhbm.groups import Group
from nhbm.laws import Law, laws_of
from nhbm.schema import SOLVED

if TYPE_CHECKING:
    from nhbm.session import Session


_NUMBER = re.compile(r"(?<![\w'])[-+]?\d[\d.]*(?:[eE][-+]?\d+)?")  # not of a name
_OF_A_MOTION = "their combination"  # tones with a common period: estimated for each motion, where it matters
_STICKING = "stick throughout"
_WRONG_SLOPE = "is not the derivative of its force"
SEVERAL = 3  # folds that take the points of a curve


def doubt_of(session: Session) -> str:
    """What is doubtful about the motion found last, with numbers and what to do; empty if nothing is."""
    text = session.doubt()
    if _WRONG_SLOPE not in text:
        return text
    labels = [label for law, label in laws_of(session.input()) if law.has_own_slopes]
    return "\n".join(_of_own_slopes(line, labels) if _WRONG_SLOPE in line else line for line in text.splitlines())


def _of_own_slopes(line: str, labels: Iterable[str]) -> str:
    """The line about a wrong derivative, unless it is none of the user: of a law among those labels nhbm has taken it."""
    for label in labels:
        if line.startswith(f"law '{label}': "):
            return (f"law '{label}': its derivative, which nhbm takes from its forces, depends on the step: they are steps or rounded "
                    "there, or change over less than a millionth of the motion; return the derivative with the force, or smooth "
                    "it: stability, curves and derivatives are inaccurate")  # fmt: skip
    return line


def warn(text: str, category: type[Warning] = NotConverged) -> None:
    """Issues a warning at the caller of the package."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).partition(".")[0] == "nhbm":
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def warn_of(session: Session) -> None:
    """Warns of what is doubtful about the motion found last."""
    for category, text in _parted(doubt_of(session)):
        warn(text, category)


def _parted(text: str) -> list[tuple[type[Warning], str]]:
    """The lines about a motion, and those about the model, its tones or joints, each with the category of its warning."""
    lines = text.splitlines()
    parts = ((category, "\n".join(line for line in lines if (_OF_A_MOTION in line or _STICKING in line) is is_of_model))
             for category, is_of_model in ((NotConverged, False), (Implausible, True)))  # fmt: skip
    return [(category, part) for category, part in parts if part]


def warn_of_model(session: Session, known: set[str]) -> None:
    """Warns of values of a model that suggest a mistake, except those that are known from before, also with other numbers."""
    for text in session.warnings():
        kind = _NUMBER.sub("#", text)
        if kind not in known and _OF_A_MOTION not in text:
            known.add(kind)
            warn(text, Implausible)


def warn_of_signs(laws: Iterable[Group], known: set[str]) -> None:
    """Warns of functions of Python that are laws of one degree of freedom and push it away from rest, once each."""
    for group in laws:
        law, parameters = group.keys.get("name"), group.keys.get("parameters")
        name = f"{getattr(law, 'input_name', '')} {parameters}"
        if not isinstance(law, Law) or "dof" not in group.keys or name in known:
            continue
        known.add(name)
        if law.pushes_away(parameters):
            warn(f"law '{law.__name__}' drives '{group.keys['dof']}' away from rest: a law returns the force on the left-hand side "
                 "of the equation of motion, which is positive for a positive displacement of a spring; unless it is to soften, "
                 "change its sign", Implausible)  # fmt: skip


def warn_of_idle_laws(idle: Iterable[str]) -> None:
    """Warns of laws that exert no force on any motion of an operation."""
    for text in idle:
        warn(text, Implausible)


def warn_of_points(doubts: Iterable[tuple[str, str]], n_points: int) -> None:
    """One warning for many motions, from status and doubt of each that has one: their numbers, and the first of each kind."""
    kinds: dict[type[Warning], dict[str, list[str]]] = {}
    for status, text in doubts:
        for category, part in _parted(text):
            kinds.setdefault(category, {}).setdefault(status if category is NotConverged else "converged", []).append(part)
    words = {"converged": "with a doubt"}
    for category, found in kinds.items():
        counts = ", ".join(f"{len(texts)} {words.get(status, status)}" for status, texts in found.items())
        firsts = "\n".join(f"The first: {texts[0]}" if len(texts) > 1 else texts[0] for texts in found.values())
        warn(f"of {n_points} points {counts}. {firsts}", category)


def warn_of_jumps(branch: Sequence[int], n_line: int, where: Callable[[int], str], messages: Sequence[str]) -> None:
    """Warns of neighbours on different branches, by the numbers of these along lines of `n_line` points; 0: no motion."""
    jumps = []
    for first in range(0, len(branch), n_line):
        found = [k for k in range(first, first + n_line) if branch[k]]
        jumps += [after for before, after in zip(found, found[1:]) if branch[before] != branch[after]]
    if not jumps:
        return
    reason = f": {messages[jumps[0]]}" if messages[jumps[0]] else ""
    warn(
        f"{len(jumps)} jump{'s' * (len(jumps) > 1)} to another branch between neighbouring points "
        f"(dataset.nhbm.details['branch']), the first at {where(jumps[0])}{reason}",
        Jump,
    )


def warn_of_return(ends: list[float], start: float, stop: float, first: float) -> None:
    """Warns of a curve that began at one end of the range, and has left it there: what is behind its fold is not known."""
    other = start if first == stop else stop
    if first in (start, stop) and ends and all(abs(end - first) <= 1e-9 * abs(stop - start) for end in ends):
        warn(f"the curve returned to {first:g} without reaching {other:g}: trace another one from there, with first={other:g}")


def warn_of_bifurcations(kinds: Iterable[str], path: str) -> None:
    """Warns of motions that bifurcate from a curve, of which &curve switch = .true. has the command make files of their own."""
    points = [f"{number} ({kind})" for number, kind in enumerate(kinds) if kind in ("period_doubling", "neimark_sacker")]
    if points:
        where = f"point{'s' * (len(points) > 1)} {', '.join(points)} over {path}"
        warn(
            f"switch=True follows branch points alone here, not the motions that bifurcate at the {where}: the command does; "
            "write the input curve.nhbm.input into a file and use nhbm solve"
        )


def warn_of_end(session: Session, path: str, values: list[float], extent: float) -> bool:
    """Whether a curve has ended before its range of an extent does, with a warning if so; `values` at its points."""
    reason = session.reason
    if reason == "points":
        share = (max(values) - min(values)) / abs(extent)
        wanted = len(values) * min(10.0, max(2.0, 1.3 / max(share, 1e-9)))
        digit = 10 ** int(math.log10(wanted))
        text = (
            f"the curve reached the limit of {len(values)} points at {path} = {values[-1]:.7g}, with {share:.0%} of the range "
            f"covered: call again with points={digit * math.ceil(wanted / digit)}, which continues it"
        )
        steps = [b - a for a, b in zip(values, values[1:]) if b != a]
        if share < 0.5 and sum(a * b < 0.0 for a, b in zip(steps, steps[1:])) >= SEVERAL:
            text += ", or with jump=True and more points, from its folds to motions beyond"
    elif reason == "grazing":
        text = "the curve ended where a wall is grazed: no motion was found beyond"
    elif session.status not in (*SOLVED, "collapsed", "locked"):  # there the motion ends
        text = f"the curve ended before the end of its range: {doubt_of(session)}"
    else:
        return False
    warn(text)
    return True
