"""tests/campaigns/workflows: several of its models are correct; so are its references, and it detects a wrong motion."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CAMPAIGNS = Path(__file__).resolve().parents[1] / "campaigns"
sys.path.insert(0, str(CAMPAIGNS))

from point_parts.models import Law, Model  # noqa: E402
from point_parts.truth import Motion, build, error_of  # noqa: E402
from workflow_parts.held import GIVEN_UP, Limits, hold  # noqa: E402
from workflow_parts.reference import Box, System, autonomous, forced  # noqa: E402
from workflow_parts.models import Axis, Workflow, random_workflow  # noqa: E402


PATIENT = Limits(run=600.0, references=600.0)  # whatever the machine


@pytest.fixture(scope="module")
def library():
    return build()


def one_mass(law: Law, w: float = 0.7, load: float = 0.3, damping: float = 0.1) -> Model:
    words = (
        "&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, "
        f"damping_mass={damping!r}, damping_stiffness=0.0 /\n"
    )
    one = np.eye(1)
    model = Model(words, one, damping * one, one, ["x1"], np.array([w]), 0)
    model.laws = [law]
    model.loads = [((1,), np.array([load]), np.zeros(1))]
    return model


CUBIC = Law(0, np.ones(1), (0.5, 0.0, 0.0))
DAMPER = Law(7, np.ones(1), (1.0, 0.0, 0.0))
LAWS = [CUBIC, Law(1, np.ones(1), (5.0, 0.3, 1.0)), Law(2, np.ones(1), (1.0, 0.15, 0.0)), DAMPER]


@pytest.mark.parametrize("law", LAWS)
def test_a_reference_is_where_integration_in_time_stays(library, law):
    model = one_mass(law)
    box = Box((45,), (720,))
    system = System(model, box)
    answer = forced(system, np.zeros((1, len(box.tuples)), dtype=complex), model.omega)
    q = system.all_dofs(answer.z, model.omega, model.damping)
    amplitudes = np.concatenate([q[45:46], 2 * q[46:]])  # one-sided
    exact = Motion(np.arange(46) * model.omega[0], amplitudes)
    alone = Motion(exact.frequencies[:2], amplitudes[:2])
    assert answer.is_solved
    assert error_of(library, model, exact) < 2e-4  # fixed steps past the ends of a slip
    assert error_of(library, model, alone) > 3e-3  # without its third harmonic


def test_the_period_of_a_relaxation_oscillation():
    """van der Pol's equation of strength 2: 7.6299 is known."""
    model = one_mass(Law(14, np.ones(1), (2.0, 1.0, 0.0)), damping=0.0)
    box = Box((31,), (300,))
    z, omega = box.of(np.array([[1]]), np.array([[2.0]]), np.zeros((1, 1))), 0.99
    for strength in (0.3, 0.7, 1.2, 1.6, 2.0):
        model.laws = [Law(14, np.ones(1), (strength, 1.0, 0.0))]
        answer = autonomous(System(model, box), z, omega)
        z, omega = answer.z, float(answer.omega[0])
    assert answer.is_solved
    assert 2 * np.pi / omega == pytest.approx(7.6299, rel=1e-4)


def test_a_sweep_down_over_an_odd_law(library, tmp_path):
    """The set of a nearly linear point, one harmonic, is not the set of its neighbours."""
    sweep = Axis("tones%frequency", 3.0, 0.15, 40, False)
    case = hold(library, tmp_path, 0, 0, Workflow("frequency", one_mass(CUBIC), (sweep,)), 1, PATIENT)
    off = [point.off for point in case.points]
    assert len(off) == 40 and max(off) < 1


LONG_KINDS = ("load", 0), ("ranks", 2), ("mode_energy", 6), ("limit_cycle", 2)
LONG = [pytest.param(kind, number, marks=pytest.mark.long) for kind, number in LONG_KINDS]


@pytest.mark.parametrize(("kind", "number"), [("mode_amplitude", 3), ("limit_cycle", 3), *LONG])
def test_a_model_of_each_kind(library, tmp_path, kind, number):
    case = hold(library, tmp_path, 1, number, random_workflow(1, number, (kind,)), 0, PATIENT)
    off = [point.off for point in case.points if np.isfinite(point.off)]
    assert len(off) > 5 and max(off) < 1


@pytest.mark.parametrize(("law", "number"), [pytest.param("hertz", 0, marks=pytest.mark.long), ("base", 3)])
def test_a_model_with_a_law_that_came_later(library, tmp_path, law, number):
    case = hold(library, tmp_path, 1, number, random_workflow(1, number, ("frequency",), (law,)), 2, PATIENT)
    off = [point.off for point in case.points if np.isfinite(point.off)]
    assert len(off) == 2 and max(off) < 1


def test_references_that_take_too_long_are_given_up(library, tmp_path):
    sweep = Axis("tones%frequency", 3.0, 0.15, 40, False)
    case = hold(library, tmp_path, 0, 0, Workflow("frequency", one_mass(CUBIC), (sweep,)), 1, Limits(run=600.0, references=0.05))
    assert case.points == [] and case.note.startswith(GIVEN_UP)


def test_an_unknown_workflow_is_a_wrong_argument():
    assert subprocess.run([sys.executable, CAMPAIGNS / "workflows", "--kinds", "frequncy"], capture_output=True).returncode == 2
