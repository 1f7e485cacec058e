"""How the solution of a point ended: numbers, names and words of the statuses, and which of them are a solution.

The program has them in src/solve/hb_outcome.f90; a file brings its own numbers and names (attributes of `status`).
"""

from __future__ import annotations

PENDING, CONVERGED, FAILED, CRASHED, UNUSED = 0, 1, 6, 12, 17
# No motion was reached that could be looked at.
EMPTY = (PENDING, FAILED, CRASHED, UNUSED)
# There is a motion: of the balance, where all but the first miss a threshold of the certificate and do not count as converged, or
# integrated.
SOLVED = (CONVERGED, 7, 8, 9, 16, 18, 21)

TEXTS = {
    "pending": "not solved yet",
    "converged": "converged",
    "stalled": "stalled: no step makes the residual smaller",
    "out_of_budget": "out of budget: the limit was reached before the tolerance",
    "singular": "singular: the linear system of a step has no unique solution",
    "not_finite": "not finite: the residual is NaN or infinite where evaluated",
    "failed": "failed: see the message of the point",
    "truncated": "truncated: solved, but the harmonics left out matter",
    "aliased": "aliased: solved, but the samples are too few",
    "penetrating": "penetrating: solved, but too far inside a rigid wall",
    "collapsed": "collapsed: an unknown tone died out, the motion has fewer tones",
    "no_motion": "no motion: no self-excited motion was found",
    "crashed": "crashed: the process ended while this point was solved",
    "diverged": "diverged: the steps exceed the size of the problem",
    "locked": "locked: the tones are multiples of one, the motion has one tone",
    "timed_out": "timed out: the point has used its limit of processor time",
    "impact": "impact: solved, but a wall is struck: a law of impact is missing",
    "unused": "unused: room for a point of a curve that has ended before",
    "time_domain": "time domain: from time integration, no balance gives it",
    "subharmonic": "subharmonic: the motion takes several periods, see the message",
    "broadband": "broadband: time integration finds no motion of these tones",
    "several": "several: time integration ends in different motions, see message",
}
NAMES = dict(enumerate(TEXTS))


def words(name: str) -> str:
    """Name of a status for people: `out of budget`."""
    return name.replace("_", " ")


def sentence(name: str) -> str:
    """What a status means, in the words of the program; the bare name where this module is older than the file."""
    return TEXTS.get(name, words(name))
