"""Advice on models and motions as warnings: one way for solve, response, gradient, curve and sweep. Texts are those of the
library's table of advice."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Sequence

from nhbm.errors import Implausible, Jump, NotConverged
from nhbm.groups import Group
from nhbm.laws import Law, laws_of
from nhbm.schema import SOLVED
from nhbm.schema import Advice as Advice
from nhbm.session import Session

_OF_TONES = frozenset({"near_commensurate", "commensurate", "dependent_tone", "one_tone_of_two", "one_tone_of_many", "equal_tones",
                       "vanishing_combination"})  # fmt: skip
_OF_MODEL = _OF_TONES | {"full_stick"}
SEVERAL = 3  # folds that take the points of a curve


def on_motion(session: Session) -> list[Advice]:
    """What is doubtful about the motion found last, with numbers and what to do."""
    found = session.advice("motion")
    if all(one.name != "wrong_derivative" for one in found):
        return found
    own = [label for law, label in laws_of(session.input()) if law.has_own_slopes]  # nhbm has taken the derivative, not the user
    return [on("rough_derivative", one.subject) if one.name == "wrong_derivative" and one.subject in own else one
            for one in found]  # fmt: skip


def on(name: str, *words: str, values: Sequence[float] = ()) -> Advice:
    """The advice of a row of the table with these words and values."""
    return Advice(name, words[0] if words else "", Session().describe_advice(name, values, words))


def warn(text: str, category: type[Warning] = NotConverged) -> None:
    """Issues a warning at the caller of the package."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).partition(".")[0] == "nhbm":
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def warn_of(found: Iterable[Advice]) -> None:
    """Warns of what was found about a motion."""
    for category, text in _parted(found):
        warn(text, category)


def _parted(found: Iterable[Advice]) -> list[tuple[type[Warning], str]]:
    """The texts about a motion, and those about the model, its tones or joints, each with the category of its warning."""
    parts = ((category, "\n".join(one.text for one in found if (one.name in _OF_MODEL) is is_of_model))
             for category, is_of_model in ((NotConverged, False), (Implausible, True)))  # fmt: skip
    return [(category, part) for category, part in parts if part]


def warn_of_model(session: Session, known: set[str]) -> None:
    """Warns of values of a model that suggest a mistake, except those that are known from before, also with other numbers."""
    for one in session.advice("model"):
        if f"{one.name} {one.subject}" not in known and one.name not in _OF_TONES:  # estimated for each motion, where it matters
            known.add(f"{one.name} {one.subject}")
            warn(one.text, Implausible)


def warn_of_signs(laws: Iterable[Group], known: set[str]) -> None:
    """Warns of functions of Python that are laws of one degree of freedom and push it away from rest, once each."""
    for group in laws:
        law, parameters = group.keys.get("name"), group.keys.get("parameters")
        name = f"{getattr(law, 'input_name', '')} {parameters}"
        if not isinstance(law, Law) or "dof" not in group.keys or name in known:
            continue
        known.add(name)
        if law.pushes_away(parameters):
            warn(on("pushes_away", law.__name__, str(group.keys["dof"])).text, Implausible)


def warn_of_inactive_laws(inactive: Iterable[Advice]) -> None:
    """Warns of laws that exert no force on any motion of an operation."""
    for one in inactive:
        warn(one.text, Implausible)


def warn_of_points(doubts: Iterable[tuple[str, list[Advice]]], n_points: int) -> None:
    """One warning for many motions, from the status of each and what was found: their numbers, and the first of each kind."""
    kinds: dict[type[Warning], dict[str, list[str]]] = {}
    for status, found in doubts:
        for category, part in _parted(found):
            kinds.setdefault(category, {}).setdefault(status if category is NotConverged else "converged", []).append(part)
    words = {"converged": "with a doubt"}
    for category, texts_of in kinds.items():
        counts = ", ".join(f"{len(texts)} {words.get(status, status)}" for status, texts in texts_of.items())
        firsts = "\n".join(f"The first: {texts[0]}" if len(texts) > 1 else texts[0] for texts in texts_of.values())
        text = f"of {n_points} points {counts}. {firsts}"
        warn(text, category)


def warn_of_jumps(branch: Sequence[int], n_line: int, where: Callable[[int], str], messages: Sequence[str]) -> None:
    """Warns of neighbours on different branches, by the numbers of these along lines of `n_line` points; 0: no motion."""
    jumps = []
    for first in range(0, len(branch), n_line):
        found = [k for k in range(first, first + n_line) if branch[k]]
        jumps += [after for before, after in zip(found, found[1:]) if branch[before] != branch[after]]
    if jumps:
        reason = f": {messages[jumps[0]]}" if messages[jumps[0]] else ""
        warn(on("jumps", where(jumps[0]) + reason, values=[len(jumps)]).text, Jump)


def warn_of_return(ends: list[float], start: float, stop: float, first: float) -> None:
    """Warns of a curve that began at one end of the range, and has left it there: what is behind its fold is not known."""
    other = start if first == stop else stop
    if first in (start, stop) and ends and all(abs(end - first) <= 1e-9 * abs(stop - start) for end in ends):
        warn(on("returned_curve", values=[first, other]).text)


def warn_of_bifurcations(kinds: Iterable[str], origins: Collection[str], path: str) -> None:
    """Warns of motions that bifurcate from a curve, of which &curve switch = .true. has the command make files of their own."""
    points = [f"{number} ({kind})" for number, kind in enumerate(kinds) if kind in origins]
    if points:
        warn(on("bifurcations_not_followed", f"point{'s' * (len(points) > 1)} {', '.join(points)}", path).text)


def warn_of_end(session: Session, path: str, values: list[float], extent: float) -> bool:
    """Whether a curve has ended before its range of an extent does, with a warning if so; `values` at its points."""
    reason = session.reason
    if reason == "points":
        share = (max(values) - min(values)) / abs(extent)
        wanted = len(values) * min(10.0, max(2.0, 1.3 / max(share, 1e-9)))
        digit = 10 ** int(math.log10(wanted))
        steps = [b - a for a, b in zip(values, values[1:]) if b != a]
        has_folds = share < 0.5 and sum(a * b < 0.0 for a, b in zip(steps, steps[1:])) >= SEVERAL
        numbers = [len(values), float(f"{values[-1]:.7g}"), 100.0 * share, digit * math.ceil(wanted / digit)]
        warn(on("cut_curve_of_folds" if has_folds else "cut_curve", path, values=numbers).text)
    elif reason == "grazing":
        warn(on("curve_ended_at_graze").text)
    elif session.status not in (*SOLVED, "collapsed", "locked"):  # there the motion ends
        warn_of([on("curve_ended_early"), *on_motion(session)])
    else:
        return False
    return True
