"""The reader against files written by the schema, and its messages on anything else."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import GAPS, single, walled
from synthetic import STATUS_WORDS, box, write_results

from nhbm_post import ReaderError, Results
from nhbm_post.outcome import NAMES, SOLVED, TEXTS
from nhbm_post.text import number_text


def test_head_of_a_file(sweep):
    with Results(sweep) as results:
        assert results.title == "sweep of the gap"
        assert results.program_version == "0.1.0"
        assert results.git_commit == "unknown"
        assert results.created_utc == "2024-01-02T03:04:05Z"
        assert "sqrt(cos_h**2 + sin_h**2)" in results.amplitude_convention
        assert (results.n_points, results.n_tones, results.n_harmonics, results.n_ranks) == (6, 2, 25, 2)
        assert (results.dofs, results.law_dofs, results.default_dof()) == (["v1", "v3"], ["v3"], "v3")
        assert results.status_counts() == {"pending": 1, "converged": 3, "stalled": 1, "failed": 1}
        assert results.message(4) == "dgetrf: singular matrix"
        assert "&output" in results.input_text and "&output" in results.input_complete
        assert list(results.converged) == [0, 1, 2]


def test_parameters_carry_path_units_and_values(sweep):
    with Results(sweep) as results:
        gap, method = results.parameters["law_1_gap"], results.parameters["solver_method"]
        assert (gap.path, gap.units, gap.is_number) == ("law(1)%gap", "m", True)
        np.testing.assert_array_equal(gap.values, GAPS + GAPS)
        assert not method.is_number and list(method.values) == ["newton"] * 3 + ["broyden"] * 3
        assert results.parameter("law(1)%gap") is gap


@pytest.mark.parametrize("strings", ["variable", "fixed"])
@pytest.mark.parametrize("layout", ["fixed", "chars"])
def test_every_kind_of_string_reads_alike(tmp_path, strings, layout):
    path = single(
        tmp_path / "a.h5",
        1,
        strings=strings,
        message_layout=layout,
        messages=["a message"],
        title="a title",
        parameters={"solver_method": ("solver%method", "1", ["newton"])},
    )
    with Results(path) as results:
        assert results.dofs == ["v3"] and results.title == "a title" and results.message(0) == "a message"
        assert list(results.parameters["solver_method"].values) == ["newton"]
        assert results.units() == "m"


def test_degrees_of_freedom_have_their_own_units(tmp_path):
    tuples = box(1, 1)
    path = write_results(
        tmp_path / "a.h5",
        tuples,
        [[1.0]],
        np.ones((1, 2, 2, 2)),
        dofs=("v3", "r3"),
        law_dofs=("v3", "r3"),
        units="see dof_units",
        dof_units=("m", "rad"),
    )
    with Results(path) as results:
        assert [results.series(0, dof).units for dof in results.dofs] == ["m", "rad"]
        assert results.units() == "see dof_units"


def test_names_of_statuses_are_those_of_the_schema():
    n = len(STATUS_WORDS.split())
    assert list(NAMES)[:n] == list(range(n)) and " ".join(list(NAMES.values())[:n]) == STATUS_WORDS


def test_statuses_and_their_texts_are_those_of_the_program():
    source = Path(__file__).parents[2] / "src" / "solve" / "hb_outcome.f90"
    if not source.exists():
        pytest.skip("no sources of the program here")
    text = source.read_text()
    names, texts = (
        re.findall(r'"([^"]*)"', re.search(rf":: {array}\(.*?\[character\(\d+\) ::(.*?)\]", text, re.DOTALL).group(1))
        for array in ("outcome_names", "texts")
    )
    assert list(TEXTS.items()) == list(zip(names, texts))
    solved = re.search(r"is_solved = any\(status == \[(.*?)\]\)", text, re.DOTALL).group(1)
    assert sorted(SOLVED) == sorted(names.index(word) for word in re.findall(r"outcome%(\w+)", solved))


def test_motions_found_by_time_integration_are_counted_as_answers(tmp_path):
    with Results(single_tone_sweep(tmp_path / "a.h5", [18, 18, 1, 0])) as results:
        assert results.outcome_text([0, 1, 3]) == "2 of 3 points found by time integration, 1 pending"
        assert results.outcome_text() == "1 of 4 points converged, 2 found by time integration, 1 pending"


def test_points_are_counted_as_the_program_does(tmp_path):
    """Converged are those of status 1 alone: truncated, aliased and penetrating ones are solved and counted apart."""
    status = [1, 7, 7, 8, 9, 2, 99]
    path = single_tone_sweep(tmp_path / "a.h5", status)
    with Results(path) as results:
        outcome = "1 of 7 points converged, 1 stalled, 2 truncated, 1 aliased, 1 penetrating, 1 status 99"
        assert results.outcome_text() == outcome
        assert results.outcome_text([0, 1]) == "1 of 2 points converged, 1 truncated"
        assert results.warning(0) == "" and results.warning(1) == "truncated: solved, but the truncation error exceeds its limit"
        assert results.warning(5) == "no solution, stalled: no step reduces the residual"
        assert results.warning(6) == "no solution, status 99"


def single_tone_sweep(path, status):
    n = len(status)
    frequency = np.linspace(1.0, 2.0, n)
    coefficients = np.full((n, 1, 2, 2), 0.5)
    parameters = {"tones_frequency": ("tones%frequency", "rad/s", frequency)}
    return write_results(path, box(1, 1), frequency[:, None], coefficients, status=status, parameters=parameters)


def test_selection_by_lists_and_ranges(sweep):
    with Results(sweep) as results:
        assert results.select({"law(1)%gap": "1e-3,2e-3", "solver%method": "newton"}) == [0, 2]
        assert results.select({"law(1)%gap": "1.2e-3:2e-3"}) == [1, 2, 4, 5]
        assert results.select({"law_1_gap": ":1.5e-3"}) == [0, 1, 3, 4]
        assert results.where_text({"law_1_gap": "1.2e-3:2e-3", "solver_method": "newton"}) == (
            "gap of law 1 = 1.2e-3 to 2.0e-3 m, method of the solver = 'newton'"
        )
        with pytest.raises(ReaderError, match="no point with law\\(1\\)%gap = 9"):
            results.select({"law(1)%gap": "1e-3,9"})


def test_the_nearest_of_many_values_are_named(tmp_path):
    """A curve has hundreds of values that cannot be given exactly by hand, and rows without a point at its end."""
    path = single_tone_sweep(tmp_path / "curve.h5", [1] * 30)
    with h5py.File(path, "r+") as file:
        file["tones_frequency"][-1] = np.nan
    with Results(path) as results:
        with pytest.raises(ReaderError, match=r"= 1.5; nearest: 1.48276 \(point 14\), 1.51724 \(point 15\)$"):
            results.point(at={"tones%frequency": "1.5"})
        with pytest.raises(ReaderError, match=r"= five; values: 1, [^n]* 1.96552 \(29 in all\)$"):
            results.point(at={"tones%frequency": "five"})


@pytest.mark.parametrize(
    "value, text",
    [(1.5e-3, "1.5e-3"), (5e-4, "5.0e-4"), (50.0, "50"), (0.25, "0.25"), (0.0123, "0.0123"), (2.718281828, "2.71828"),
     (-1.25e7 - 0.5, "-1.25e7"), (1.0e10, "1.0e10"), (0.0, "0"), ("newton", "newton")],
)  # fmt: skip
def test_numbers_are_spelled_as_in_an_input(value, text):
    assert number_text(value) == text

def test_selection_of_points(sweep):
    with Results(sweep) as results:
        assert results.point() == 0
        assert results.point(2) == 2
        assert results.point(at={"law_1_gap": "1.5e-3", "solver_method": "newton"}) == 1
        assert results.select({"law(1)%gap": 0.0015}) == [1, 4]
        with pytest.raises(ReaderError, match=r"fits points 1, 4; give also solver%method"):
            results.point(at={"law_1_gap": 1.5e-3})
        with pytest.raises(
            ReaderError, match=r"sweep.h5: no point with law\(1\)%gap = 1.4e-3; values: 1.0e-3, 1.5e-3, 2.0e-3"
        ):
            results.point(at={"law_1_gap": "1.4e-3"})
        with pytest.raises(ReaderError, match=r"no swept parameter 'gap'; swept: law\(1\)%gap, solver%method"):
            results.point(at={"gap": 1.0})
        with pytest.raises(ReaderError, match=r"no point 6; points: 0-5"):
            results.point(6)


def test_coefficients_are_those_written(sweep):
    with h5py.File(sweep, "r") as file, Results(sweep) as results:
        h = int(np.flatnonzero((file["tuple"][()] == (1, -2)).all(axis=1))[0])
        cos, sin = file["coefficients"][1, 1, h]
        assert results.coefficients(1, "v3", (1, -2)) == (cos, sin)
        assert results.coefficients(1, "v3", (-1, 2)) == (cos, -sin)
        assert results.amplitude(1, "v3", (1, -2)) == np.hypot(cos, sin)
        series = results.series(1, "v3")
        np.testing.assert_array_equal(results.evaluate(1, "v3", [0.0, 2.0]), series.evaluate([0.0, 2.0]))
        np.testing.assert_array_equal(results.on_grid(1, "v3", (4, 6)), series.on_grid((4, 6)))


def test_all_series_are_the_converged_ones(sweep):
    with Results(sweep) as results:
        found = dict(results.all_series("v1"))
        assert list(found) == [0, 1, 2]
        np.testing.assert_array_equal(found[2].cos, results.series(2, "v1").cos)


def test_harmonics_outside_the_set_are_left_out(sweep):
    with Results(sweep) as results:
        assert results.series(0).n_harmonics == 13
        assert results.series(1).n_harmonics == 25
        with pytest.raises(
            ReaderError,
            match=r"tuple \(3,0\) is not in the set of point 0; it has 13 tuples with \|j1\| <= 2",
        ):
            results.coefficients(0, "v3", (3, 0))
        with pytest.raises(ReaderError, match=r"tuple \(1\) has 1 entry; the file has 2 tones"):
            results.coefficients(0, "v3", (1,))


def test_points_without_result_are_refused(sweep):
    with Results(sweep) as results:
        with pytest.raises(
            ReaderError, match=r"point 3 has no result \(status stalled\); solved points: 0-2"
        ):
            results.series(3)
        assert results.series(3, allow_unconverged=True).n_harmonics == 25
        for point, why in ((4, "failed: dgetrf: singular matrix"), (5, "pending")):
            for allow in (False, True):
                with pytest.raises(
                    ReaderError, match=rf"sweep.h5: point {point} has no result \(status {why}\)"
                ):
                    results.series(point, allow_unconverged=allow)


def test_unknown_dof_names_the_stored_ones(sweep):
    with Results(sweep) as results:
        with pytest.raises(
            ReaderError, match="sweep.h5: no displacement of degree of freedom 'v9'; stored: v1, v3"
        ):
            results.series(0, "v9")
        with pytest.raises(ReaderError, match="no force of the laws of degree of freedom 'v1'; stored: v3"):
            results.series(0, "v1", "force")


@pytest.mark.parametrize("n_tones", [1, 2, 3])
def test_samples_have_axes_in_the_order_of_tones(tmp_path, n_tones):
    with Results(walled(tmp_path / "a.h5", n_tones)) as results:
        axes, surface = results.samples(0, "v3")
        assert [len(axis) for axis in axes] == list(surface.shape)
        np.testing.assert_allclose(surface, results.on_grid(0, "v3", 16), atol=1e-17)


def test_file_without_samples(sweep):
    with Results(sweep) as results:
        assert results.samples(0, "v3") is None


def test_no_converged_point(tmp_path):
    tuples = box(1, 1)
    path = write_results(tmp_path / "a.h5", tuples, [[1.0]] * 2, np.full((2, 1, 2, 2), np.nan), status=[0, 6])
    with (
        Results(path) as results,
        pytest.raises(ReaderError, match="no point is solved: 0 of 2 points converged, 1 pending, 1 failed"),
    ):
        results.point()


def test_converged_point_without_numbers(tmp_path):
    path = write_results(tmp_path / "a.h5", box(1, 1), [[1.0]], np.full((1, 1, 2, 2), np.nan))
    with Results(path) as results, pytest.raises(ReaderError, match="holds no displacement of 'v3'"):
        results.series(0)


def test_other_files_are_refused(tmp_path):
    text, given, other, newer, torn = (tmp_path / name for name in ("a.txt", "a.nml", "other.h5", "newer.h5", "torn.h5"))
    text.write_text("no HDF5")
    given.write_text("&structure /")
    with h5py.File(other, "w") as file:
        file["x"] = 1.0
    single(newer, 1, schema_version=2)
    single(torn, 1)
    with h5py.File(torn, "a") as file:
        del file["status"]
    for path, message in (
        (tmp_path / "none.h5", "no such file"),
        (tmp_path, "is a folder"),
        (text, "cannot be read as HDF5"),
        (given, "is an input, not a result: nhbm solve .* makes one, a.h5"),
        (other, "no result file of nhbm: it has no attribute 'schema_version'"),
        (newer, "schema version 2; this nhbm-post reads version 1"),
        (torn, "result file without status"),
    ):
        with pytest.raises(ReaderError, match=message) as caught:
            Results(path)
        assert str(path) in str(caught.value)
