"""The command tests/measurements/accuracy: its references, and the places in its page for all that it writes."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "measurements" / "accuracy_parts"))

import against_time  # noqa: E402
import paper  # noqa: E402
from runs import Balance, Model, known_methods, integration, rms  # noqa: E402

MIDSPAN = {"dofs": ("v3",), "weights": (1.0,)}


def test_no_case_has_the_name_of_a_section():
    sections = re.findall(
        r"^    \"(\w+)\": _\w+,$", (ROOT / "tests" / "measurements" / "accuracy").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert "time" in sections and not set(sections) & {case.name for case in against_time.CASES}


def test_page_has_both_marks_of_each_text():
    page = (ROOT / "docs" / "why" / "accuracy.md").read_text(encoding="utf-8")
    names = re.findall(r"rewrite\(\"([a-z0-9 ]+)\"", (ROOT / "tests" / "measurements" / "accuracy").read_text(encoding="utf-8"))
    assert "time" in names and len(names) == len(set(names))
    for name in names:
        assert page.count(f"<!-- {name} -->\n") == 1 and page.count(f"<!-- end of {name} -->\n") == 1, name


def test_each_case_has_its_input_and_pictures_stand_beside_the_page():
    for case in against_time.CASES:
        assert "&sweep" not in case.model.text() and "&structure" in case.model.text(), case.name
    page = ROOT / "docs" / "why" / "accuracy.md"
    names = re.findall(r"\]\((\.\./pictures/\w+\.png)\)", page.read_text(encoding="utf-8"))
    assert names
    for name in names:
        assert (page.parent / name).exists(), name


@pytest.mark.long
def test_integration_from_the_state_of_a_balance_stays_on_its_motion(tmp_path):
    """Displacement and velocity of all degrees of freedom fit into one tuple of &start; a wrong one would show immediately."""
    model = Model("order_sequence/paper_cubic", **MIDSPAN, sets=("law(1)%stiffness=10",))
    balance = Balance(model, tmp_path, "harmonics%order=5")
    record = integration(model, tmp_path, "method='cvode'", "step=0.02", "duration=1", "tolerance=1e-13",
                         start=balance.start_groups())
    assert record.cpu > 0.0
    assert rms(record.x - balance.at(record.t)) < 1e-10 * rms(record.x)


def test_window_errors_are_root_mean_squares_from_each_sample_on():
    x = np.array([3.0, -4.0, 1e-9, 2e-9])
    np.testing.assert_allclose(against_time._window_errors(x, 2), [np.sqrt(12.5), np.sqrt(8.0), np.sqrt(2.5) * 1e-9], rtol=1e-12)


def test_mass_at_the_contact_halves_with_the_elements():
    """1/(M^-1)_cc of four consistent elements, and its value for a finer mesh."""
    masses = [paper.mass_at_contact(n) for n in (4, 8, 16)]
    assert masses[0] == pytest.approx(1.138, rel=1e-3)
    assert masses[1] / masses[2] == pytest.approx(2.0, rel=1e-2)


def test_solvers_are_those_that_the_program_knows(tmp_path):
    assert {"newton", "broyden"} <= set(known_methods(tmp_path))
