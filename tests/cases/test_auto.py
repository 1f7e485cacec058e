"""Folds, period doublings and Neimark-Sacker points of public cases agree with the program AUTO to eight digits."""

import auto_reference
import pytest


@pytest.mark.long
@pytest.mark.parametrize("name", auto_reference.CASES)
def test_points_of_curves_are_those_of_auto(name):
    pytest.importorskip("xpplab")
    for _, expected, value in auto_reference.pairs(auto_reference.CASES[name]):
        assert value == pytest.approx(expected, rel=1e-8)
