"""How the solution of a point ended: numbers, names and words of the statuses, and which of them are a solution.

The program has them in src/solve/hb_outcome.f90; a file brings its own numbers and names (attributes of `status`).
"""

from __future__ import annotations

TEXTS = {
    "pending": "not solved yet",
    "converged": "converged",
    "stalled": "stalled: no step reduces the residual",
    "out_of_budget": "out of budget: a work limit was reached before the tolerance",
    "singular": "singular: the linear system of a Newton step is singular",
    "not_finite": "not finite: the residual is NaN or infinite",
    "failed": "failed: an error of this point, see its message",
    "truncated": "truncated: solved, but the truncation error exceeds its limit",
    "aliased": "aliased: solved, but the aliasing error exceeds its limit",
    "penetrating": "penetrating: solved, but the penetration exceeds its limit",
    "collapsed": "collapsed: an unknown tone vanished, the motion has fewer tones",
    "no_motion": "no motion: no self-excited motion was found",
    "crashed": "crashed: the process crashed while solving this point",
    "diverged": "diverged: the iteration diverged",
    "locked": "locked: the tones are commensurate, the motion is periodic",
    "timed_out": "timed out: the processor time limit of the point was reached",
    "impact": "impact: solved, but it may depend on the restitution of a wall",
    "unused": "unused: spare row of a curve that ended earlier",
    "integrated": "integrated: found by time integration instead of the balance",
    "subharmonic": "subharmonic: the motion repeats after several periods only",
    "broadband": "broadband: time integration finds no motion with these tones",
    "multiple_attractors": "multiple attractors: time integration finds several motions",
    "law_undefined": "law undefined: a law has no force at motions that were tried",
}
NAMES = dict(enumerate(TEXTS))


def _numbers(*names: str) -> tuple[int, ...]:
    return tuple(list(TEXTS).index(name) for name in names)


PENDING, CONVERGED, FAILED, CRASHED, UNUSED, INTEGRATED = _numbers(
    "pending", "converged", "failed", "crashed", "unused", "integrated"
)
# There is no motion to evaluate.
EMPTY = (PENDING, FAILED, CRASHED, UNUSED)
# There is a motion: of the balance, where all but the first exceed a limit of the error estimate and do not count as
# converged, or integrated.
SOLVED = _numbers("converged", "truncated", "aliased", "penetrating", "impact", "integrated", "multiple_attractors")
# Statuses of motions without a fault.
ANSWERS = {CONVERGED: "converged", INTEGRATED: "found by time integration"}


def words(name: str) -> str:
    """Name of a status for people: `out of budget`."""
    return name.replace("_", " ")


def sentence(name: str) -> str:
    """What a status means, in the words of the program; the bare name where this module is older than the file."""
    return TEXTS.get(name, words(name))
