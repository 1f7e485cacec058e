"""The bolted beam of drivers/examples: its frequency and damping over the amplitude against two other methods."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)
pytest.importorskip("skfem")
os.environ["NHBM_LIBRARY"] = str(LIBRARY)
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "drivers" / "examples"))

import bolted_beam  # noqa: E402
import bolted_beam_check  # noqa: E402


@pytest.fixture(scope="module")
def structure():
    return bolted_beam.beam()


@pytest.fixture(scope="module")
def joint(structure):
    return bolted_beam_check.Joint(structure)


def test_bolts_press_the_middle_of_the_lap(structure, joint):
    """The normal forces carry the bolts, and the ends of the lap are open."""
    normal = joint.forces(joint.rest, joint.sliders)[0][joint.n]
    assert normal.sum() == pytest.approx(3 * bolted_beam.TENSION, rel=1e-6)
    far = abs(bolted_beam.positions(structure)) > 0.9 * bolted_beam.LAP / 2
    assert far.any() and not normal[far].any() and (normal > 0).sum() > 50


def test_areas_are_those_of_the_lap(structure):
    assert bolted_beam.areas(structure).sum() == pytest.approx(bolted_beam.LAP * bolted_beam.SIDE)


@pytest.mark.long  # minutes
def test_backbone_is_that_of_other_methods(structure, joint):
    """Frequency and damping at phase resonance. Slow cycles have the inertia of one shape, free decay changes its amplitude by up
    to 4 % in a cycle."""
    found = bolted_beam.backbone(structure)
    assert found.nhbm.is_converged.all()
    amplitude, omega, ratio = (found[name].values for name in ("amplitude", "omega", "ratio"))
    assert (np.diff(amplitude) > 0).all()
    for size in (5e-5, 7e-5, 1e-4, 1.4e-4):
        for reached, other_omega, other_ratio in (joint.slow_cycles(size), joint.decay(size)):
            assert np.interp(reached, amplitude, omega) == pytest.approx(other_omega, rel=1.5e-3)
            assert np.interp(reached, amplitude, ratio) == pytest.approx(other_ratio, rel=0.06)
    assert omega[0] == pytest.approx(joint.omega, rel=1e-4)
    assert omega[-1] < 0.99 * omega[0] and ratio[-1] > 10 * ratio[0]
