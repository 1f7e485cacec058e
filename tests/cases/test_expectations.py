"""Tests of the check itself: expectations.py accepts correct results, rejects wrong ones, and does not fail otherwise."""

from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest
from nhbm_post.reader import Results

from expectations import MalformedExpectation, expects_only_converged, failures, has_only_answers, read_expectations
from program import NOT_ALL_CONVERGED, solve

# x'' + x'/10 + (1 + k) x = cos(2t) + 3 with k = 0 and 7: closed forms below. The third point has a wrong value.
MODEL = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,
   ground_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 2.0 /
&harmonics order = 1 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&load dof = 'x1', tuple = 0, cos = 3.0 /
&law type = 'polynomial', dof = 'x1', stiffness = 0.0 /
&sweep parameter = 'law(1)%stiffness', values = 0.0, 7.0, axis = 1 /
&sweep parameter = 'solver%max_iterations', values = 100, 100, axis = 1 /
"""
FAILING = MODEL.replace("values = 0.0, 7.0", "values = 0.0, 7.0, 50.0").replace("100, 100", "100, 100, 0")
FAILING += "&solver fallback_by_integration = .false. /\n"


# Van der Pol's oscillator: frequency and amplitude by shooting.
CYCLE = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /
&tones unknown = .true. /
&harmonics order = 7 /
&law type = 'van_der_pol', dof = 'x1', strength = 1.0 /
"""

# A stop at the smallest of the largest displacements between two resonances.
GRAZES = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0, damping = 0.15 /
&tones frequency = 0.43 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 2.0 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 0.05, gap = 0.339582 /
&accuracy tolerance = 1e-5 /
&curve parameter = 'tones%frequency', from = 0.43, to = 0.48 /
"""


def closed_form(k):
    return 1.0 / (1.0 + k - 4.0 + 0.2j)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    with Results(solve(MODEL, tmp_path_factory.mktemp("points"))) as file:
        yield file


@pytest.fixture(scope="module")
def failing_results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("points")
    with Results(solve(FAILING, folder, status=NOT_ALL_CONVERGED)) as file:
        yield file


def problems(results, *lines):
    return failures(read_expectations("\n".join(f"! expect: {line}" for line in lines)), results)


def test_right_expectations_hold(results):
    soft, stiff = closed_form(0.0), closed_form(7.0)
    assert not problems(
        results,
        f"law_1_stiffness=0 x1 (1) cos = {soft.real!r} to 1e-12",
        f"law_1_stiffness=0 x1 (1) sin = {-soft.imag!r} to 1e-12",
        f"law_1_stiffness=7.0 x1 (1) amplitude = {abs(stiff)!r} to 1e-12",
        f"law_1_stiffness=7.0 solver_max_iterations=100 x1 (-1) sin = {stiff.imag!r} to 1e-12",
        "law_1_stiffness=0 x1 (0) cos = 3.0 to 1e-12",
        "x1 (0) sin < 1e-300",
        "n_harmonics = 2 to 0",
        "tone 1 frequency = 2.0 to 0",
        "residual < 1e-12",
        "iterations < 10",
        "status = converged",
    )


@pytest.mark.parametrize(
    "line, says",
    [
        ("law_1_stiffness=0 x1 (0) cos = 3.001 to 1e-4", "found 3"),
        ("law_1_stiffness=0 x1 (0) cos = -3.0 to 1e-4", "found 3"),
        ("x1 (0) cos = 3.0 to 1e-4", "stiffness of law 1 = 7"),
        ("law_1_stiffness=0 x1 (1) cos = 3.0 to 1e-4", "found -0.33"),
        ("law_1_stiffness=0 x1 (1) sin < 1e-3", "found 0.02"),
        ("n_harmonics = 3 to 0", "found 2"),
        ("law_1_stiffness=5 n_harmonics = 2 to 0", "no point with law(1)%stiffness = 5"),
        ("law_1_gap=5 n_harmonics = 2 to 0", "no swept parameter 'law_1_gap'"),
        ("tone 1 frequency = 2.1 to 1e-3", "found 2"),
        ("tone 2 frequency = 2.0 to 1e-3", "there is no tone 2"),
        ("x2 (1) cos < 1.0", "'x2'"),
        ("x1 (2) cos < 1.0", "tuple (2) is not in the set"),
        ("x1 (1,0) cos < 1.0", "2 entries"),
        ("status = stalled", "status is converged, not stalled"),
    ],
)
def test_wrong_expectation_fails(results, line, says):
    found = problems(results, line)
    assert found and any(says in problem for problem in found), found


def test_point_that_is_not_converged_fails_unless_said(failing_results):
    assert any("status is" in problem for problem in problems(failing_results, "n_harmonics < 10"))
    name = failing_results.status_name(2)
    assert name != "converged"
    line = f"solver_max_iterations=0 status = {name}"
    assert not problems(failing_results, line)
    assert not problems(failing_results, f"solver_max_iterations=0 status = converged or {name}")
    assert problems(failing_results, "solver_max_iterations=0 status = converged or singular")
    assert not expects_only_converged(read_expectations(f"! expect: {line}"))


def test_numbers_may_be_off_by_what_the_file_estimates(tmp_path):
    with Results(solve(CYCLE, tmp_path)) as results:
        right = ("tone 1 frequency = 0.94295584744161 to 3 estimates", "x1 (1) amplitude = 2.0149065 to 3 estimates")
        assert not problems(results, *right, "truncation_estimate < 1e-2")
        assert problems(results, "tone 1 frequency = 0.943 to 3 estimates")
        assert problems(results, "x1 (1) amplitude = 2.05 to 3 estimates")
        assert problems(results, "truncation_estimate < 1e-9")


def test_located_values_may_be_off_by_what_the_file_estimates(tmp_path):
    # An error of the motion moves these grazes far along the curve; values by a tolerance of 1e-9.
    with Results(solve(GRAZES, tmp_path)) as results:
        parts = ("0.452:0.4533", "0.4533:0.455")
        first, second = (f"curve_kind=grazing tones_frequency={part} tone 1 frequency = " for part in parts)
        assert not problems(results, first + "0.45251205 to 1 estimates", second + "0.45402485 to 1 estimates")
        assert problems(results, first + "0.45256 to 1 estimates")


def test_points_of_a_file_are_all_answered_or_not(results, failing_results):
    assert has_only_answers(results)
    assert not has_only_answers(failing_results)


def test_points_solved_are_counted(failing_results):
    assert not problems(failing_results, "solved > 1")
    assert problems(failing_results, "solved > 2")
    assert problems(failing_results, "solver_max_iterations=100 solved > 1")  # says nothing of the third point
    assert not expects_only_converged(read_expectations("! expect: solved > 1"))


def test_coefficient_of_a_point_that_is_not_converged_fails(failing_results):
    name = failing_results.status_name(2)
    lines = [f"solver_max_iterations=0 status = {name}", "solver_max_iterations=0 x1 (1) cos < 1e300"]
    assert problems(failing_results, *lines)


@pytest.mark.parametrize(
    "line",
    [
        "! expect:",
        "! expect v3 (1,0) cos = 1.0 to 1e-3",
        "! Expect: v3 (1,0) cos = 1.0 to 1e-3",
        "!expect: v3 (1,0) cos = 1.0 to 1e-3",
        "! expected: v3 (1,0) cos = 1.0 to 1e-3",
        "&tones frequency = 1.0 / ! expect: v3 (1,0) cos = 1.0 to 1e-3",
        "! expect: v3 (1,0) cos = 1.0",
        "! expect: v3 (1,0) cos 1.0 to 1e-3",
        "! expect: v3 (1,0) cos = 1.O to 1e-3",
        "! expect: v3 (1,0) cos = nan to 1e-3",
        "! expect: v3 (1,0) cos = 1.0 to 1e3",
        "! expect: v3 (1,0) cos = 1.0 to -1e-3",
        "! expect: v3 (1,0) cos = 1.0 to 30 estimates",
        "! expect: residual = 1.0 to 3 estimates",
        "! expect: v3 (1,0) cos = 1.0 to 1e-3 m",
        "! expect: v3 (1,0) cos = 0.0 to 1e-3",
        "! expect: v3 (1,0) cos > 1.0",
        "! expect: v3 (1,0) cos < 0.0",
        "! expect: v3 (1,0) cosine = 1.0 to 1e-3",
        "! expect: v3 (1,a) cos = 1.0 to 1e-3",
        "! expect: v3 () cos = 1.0 to 1e-3",
        "! expect: v3 cos = 1.0 to 1e-3",
        "! expect: (1,0) cos = 1.0 to 1e-3",
        "! expect: residuum < 1e-3",
        "! expect: residual < inf",
        "! expect: law_1_gap = 1e-3 residual < 1e-3",
        "! expect: law_1_gap=1 law_1_gap=2 residual < 1e-3",
        "! expect: solved > many",
        "! expect: solved = 2",
        "! expect: status = fine",
        "! expect: status = stalled or fine",
        "! expect: status = converged to 1e-3",
    ],
)
def test_malformed_line_is_refused(line):
    with pytest.raises(MalformedExpectation, match="^line 2: "):
        read_expectations("! a comment\n" + line)


def test_other_comments_are_no_expectations():
    assert read_expectations("! as one would expect: nothing\n&tones frequency = 1.0 / ! [rad/s]\n") == []


def test_inputs_of_the_validation_page_name_their_reference():
    """`tests/measurements/validation` leaves out an input whose comment names none, and with it the row of the page."""
    root = Path(__file__).resolve().parents[2]
    spec = spec_from_loader("validation", SourceFileLoader("validation", str(root / "tests" / "measurements" / "validation")))
    spec.loader.exec_module(validation := module_from_spec(spec))
    page = (root / "docs" / "why" / "validation.md").read_text(encoding="utf-8")
    table = page.split("<!-- inputs -->")[1].split("<!-- end of inputs -->")[0]
    cases = validation.cases_of(table.splitlines())
    assert len(cases) > 50
    assert [case for case in cases if not validation.origin((root / "inputs" / f"{case}.nml").read_text(encoding="utf-8"))] == []
