"""Words of results (docs/user/schema.md): statuses, axes, what a census has. Below all other modules."""

from typing import NamedTuple

SOLVED = "converged truncated aliased penetrating impact integrated multiple_attractors".split()  # there is a motion
AMPLITUDES = (
    "x(t) = sum over harmonics h of [ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], j_h = tuple[h, :]"
)
TUPLE = {"long_name": "integer tuple j of each harmonic", "units": "1"}
CENSUS = {  # what varies over the motions of a census, and is a whole number or a text
    "census_motion": "number of the motion, by size",
    "census_found": "random starts that led to the motion",
    "census_start": "start that found the motion",
    "census_mirror_of": "motion whose mirror image this is; -1: none",
}
AXES = {
    "advice_item": "number of the advice, from 0",
    "advice_value": "number of the value, from 0",
    "attempt": "number of the attempt, from 0",
    "point": "number of the sweep point, from 0",
    "tone": "number of the tone, from 1",
    "harmonic": "number of the harmonic, from 0",
    "dof": "stored degree of freedom",
    "law": "law, by its label",
    "law_dof": "degree of freedom on which laws act",
    "component": "part of a coefficient",
    "multiplier": "number of the multiplier, from 0",
    "output": "output that the tolerance is for, as the input has it",
    "gradient_value": "value by which motions are differentiated, as the input has it",
    "curve_unknown": "number of the unknown of the curve, from 0",
}

# enum nhbm_census_start
CENSUS_STARTS = "", "first guess", "equilibrium", "mode", "random start", "mirror image", "deflation", "continuation"


class Advice(NamedTuple):
    """A row of the table of advice with its numbers: its name, the law or degree of freedom that it is about, its text."""

    name: str
    subject: str
    text: str
