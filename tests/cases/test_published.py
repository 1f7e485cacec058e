"""The systems of benchmarks/: their numbers by nhbm agree with the printed ones as well as the page says."""

from __future__ import annotations

import sys
import warnings

import pytest

from in_process import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))

from systems import SYSTEMS  # noqa: E402

LIMITS = {  # relative differences, of those that are not below 1e-7; the page says why
    "Block on a vibrating plane, Coulomb friction": 5e-5,
    "Jenkins element, 3:1 superharmonic resonance": 1e-3,
    "Normal mode of a mass with a stop": 1e-3,
    "Oscillator with rigid Coulomb friction": 1e-3,
    "Rotor on a squeeze film damper": 0.1,
}
LONG = "AUTO", "closed form of their map"  # curves


@pytest.mark.parametrize(
    "one",
    [pytest.param(one, marks=pytest.mark.long if one.kind.startswith(LONG) else ()) for one in SYSTEMS],
    ids=lambda one: one.name,
)
def test_numbers_are_those_that_were_printed(one):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = one.solve()
    assert len(found) == len(one.printed)
    for (quantity, theirs), ours in zip(one.printed, found):
        assert ours == pytest.approx(float(theirs), rel=LIMITS.get(one.name, 1e-7)), quantity
