"""Files of nhbm benchmark: the reader, the rates, and the pictures."""

import h5py
import numpy as np
import pytest

from nhbm_post import ReaderError, Results, UsageError, draw
from nhbm_post.benchmark import Benchmark, convergence_rate, cost_exponent, falling_part
from nhbm_post.cli import main

ORDERS = np.array([3, 5, 7, 9])


@pytest.fixture
def ladder(tmp_path):
    """Two methods at four orders: errors fall by e**-N and N**-3, times grow with the square and the first power."""
    path = tmp_path / "ladder.h5"
    n = (2 * ORDERS + 1) ** 2
    text = h5py.string_dtype()
    with h5py.File(path, "w") as file:
        file.attrs["schema_version"] = 1
        file.attrs["kind"] = "benchmark"
        file.attrs["title"] = "ladder"
        file["rung"] = np.arange(8, dtype=np.int32)
        file["dof"] = np.array(["x1"], dtype=text)
        file["tuple"] = np.array([[0, 0], [1, 0]], dtype=np.int32)
        file["coefficients"] = np.ones((8, 1, 2, 2))
        file["coefficients"].attrs["units"] = "m"
        file["order"] = np.tile(ORDERS, 2).astype(np.int32)
        file["n_unknowns"] = np.tile(n, 2).astype(np.int32)
        file["samples"] = np.repeat(np.tile(8 * ORDERS, 2)[:, None], 2, axis=1).astype(np.int32)
        file["method"] = np.array(["newton"] * 4 + ["broyden"] * 4, dtype=text)
        file["sampling"] = np.array([""] * 8, dtype=text)
        file["formulation"] = np.array([""] * 8, dtype=text)
        file["status"] = np.array([7, 1, 1, 1, 1, 1, 1, 3], dtype=np.int32)
        file["is_reference"] = np.zeros(8, dtype=np.int32)
        file["error"] = np.concatenate([np.exp(-ORDERS), ORDERS**-3.0])
        file["improved_error"] = np.full(8, np.nan)
        for part in ("total", "cpu", "setup", "solver", "certificate"):
            seconds = np.concatenate([1e-6 * n**2.0, 1e-5 * n])
            for end, factor in (("", 1.0), ("_min", 0.9), ("_max", 1.2)):
                file[f"{part}_seconds{end}"] = factor * seconds
    return path


def test_curves_are_the_methods(ladder):
    curves = Benchmark(ladder).curves("order")
    assert [curve.label for curve in curves] == ["newton", "broyden"]
    assert [curve.rungs.tolist() for curve in curves] == [[0, 1, 2, 3], [4, 5, 6, 7]]


def test_what_is_not_solved_has_no_error(ladder):
    benchmark = Benchmark(ladder)
    assert np.isnan(benchmark.error()[7]) and np.isfinite(benchmark.error()[:7]).all()


def test_the_better_rate_is_chosen():
    rate = convergence_rate(ORDERS, 5.0 * np.exp(-0.7 * ORDERS))
    assert rate.kind == "exponential" and rate.exponent == pytest.approx(-0.7) and rate.factor == pytest.approx(5.0)
    rate = convergence_rate(ORDERS, 2.0 * ORDERS**-2.5)
    assert rate.kind == "algebraic" and rate.exponent == pytest.approx(-2.5)
    assert rate(4.0) == pytest.approx(2.0 * 4.0**-2.5)


def test_a_plateau_is_left_out():
    error = np.array([1e-1, 1e-2, 1e-3, 0.99e-3, 1.01e-3])
    assert falling_part(error).tolist() == [0, 1, 2]
    assert falling_part(np.array([1e-3, np.nan, 1e-6, 1e-9, 1e-15])).tolist() == [0, 2, 3]


def test_few_points_give_no_rate():
    assert convergence_rate(ORDERS[:2], np.array([1e-1, 1e-2])) is None
    assert cost_exponent(ORDERS[:2], np.array([1.0, 2.0])) is None


def test_cost_looks_at_the_larger_half():
    n = np.array([10.0, 20.0, 40.0, 80.0, 160.0, 320.0])
    seconds = np.where(n < 50.0, 1.0, (n / 50.0) ** 3)
    assert cost_exponent(n, seconds).exponent == pytest.approx(3.0)


def test_commands_draw_and_print_rates(ladder, capsys):
    for command in ("work-precision", "convergence", "cost"):
        assert main([command, str(ladder)]) == 0
        assert ladder.with_name(f"ladder_{command}.png").stat().st_size > 10_000
    out = capsys.readouterr().out
    assert "newton: error ~ exp(-1 order)" in out
    assert "broyden: error ~ order^-3" in out
    assert "newton: time ~ unknowns^2" in out


def test_pictures_say_what_they_leave_out(ladder):
    fig = draw.draw_work_precision(Benchmark(ladder))
    text = " ".join(t.get_text() for t in fig.texts)
    assert "1 of 8 rungs not solved" in text and "hollow" in text


def test_improved_curves_need_an_improvement(ladder):
    with pytest.raises(UsageError, match="improvement_steps"):
        draw.draw_work_precision(Benchmark(ladder), has_improved=True)
    with h5py.File(ladder, "a") as file:
        file["improved_error"][:4] = 0.1 * np.exp(-ORDERS)
    fig, rates = draw.draw_convergence(Benchmark(ladder), has_improved=True)
    assert [curve.label for curve, _ in rates] == ["newton", "newton, improved", "broyden"]


def test_files_of_the_other_kind_are_told(ladder, sweep):
    with pytest.raises(ReaderError, match="nhbm benchmark"):
        Results(ladder)
    with pytest.raises(ReaderError, match="no file of 'nhbm benchmark'"):
        Benchmark(sweep)
