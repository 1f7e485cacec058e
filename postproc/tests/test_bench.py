"""Files of nhbm-bench: the reader, errors against references, the rates, and the pictures."""

import h5py
import numpy as np
import pytest

from nhbm_post import ReaderError, UsageError, draw
from nhbm_post.bench import KERNELS, Bench, read_reference
from nhbm_post.cli import main
from nhbm_post.rates import convergence_rate, cost_exponent, falling_part
from nhbm_post.reader import SCHEMA_VERSION

ORDERS = np.array([3, 5, 7, 9])
N = (2 * ORDERS + 1) ** 2
# Errors of x = cos tau_1 + 0.5 cos tau_2 + ..., whose rms is that of the reference; the last point of each method is the reference.
TUPLES = np.array([[0, 0], [0, 1], [1, 0]])
TRUTH = np.array([[0.1, 0.0], [0.5, 0.0], [1.0, 0.0]])


def write_order_sequence(path, errors, status=None):
    """Two methods at the orders; what is off is the cosine of the first tone."""
    n = errors.size
    text = h5py.string_dtype()
    size = np.sqrt(TRUTH[0, 0] ** 2 + 0.5 * (TRUTH[1:, 0] ** 2).sum())
    with h5py.File(path, "w") as file:
        file.attrs.update(schema_version=SCHEMA_VERSION, title="order_sequence")
        file["point"] = np.arange(n, dtype=np.int32)
        file["tone"] = np.arange(1, 3, dtype=np.int32)
        file["dof"] = np.array(["x0", "x1"], dtype=text)
        file["law_dof"] = np.array(["x1"], dtype=text)
        file["tuple"] = TUPLES
        values = np.full((n, 2, 3, 2), 9.0)
        values[:, 1] = TRUTH
        values[:, 1, 2, 0] += np.sqrt(2.0) * size * errors
        file["coefficients"] = values
        file["harmonics_order"] = np.tile(ORDERS, 2).astype(float)
        file["harmonics_order"].attrs["parameter"] = "harmonics%order"
        file["solver_method"] = np.array(["newton"] * 4 + ["broyden"] * 4, dtype=text)
        file["solver_method"].attrs["parameter"] = "solver%method"
        file["n_unknowns"] = np.tile(N, 2).astype(np.int32)
        file["n_harmonics"] = np.tile(N // 2 + 1, 2).astype(np.int32)
        file["status"] = np.array([7, 1, 1, 1, 1, 1, 1, 3] if status is None else status, dtype=np.int32)
        for part in ("total", "cpu", "setup", "solver", "error_estimate"):
            seconds = np.concatenate([1e-6 * N**2.0, 1e-5 * N])
            for end, factor in (("", 1.0), ("_min", 0.9), ("_max", 1.2)):
                file[f"bench_{part}_seconds{end}"] = factor * seconds
        for kernel in KERNELS:
            seconds = 1e-9 * np.tile(N, 2).astype(float) ** (2 if kernel == "tangent" else 1)
            for end, factor in (("seconds", 1.0), ("seconds_min", 0.9), ("yardstick", 2.0)):
                file[f"kernel_{kernel}_{end}"] = factor * seconds
    return path


@pytest.fixture
def order_sequence(tmp_path):
    """Errors fall by e**-N and N**-3, times grow with the square and the first power; the last point is not solved."""
    return write_order_sequence(tmp_path / "order_sequence.h5", np.concatenate([np.exp(-ORDERS), ORDERS**-3.0]))


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "truth.csv"
    path.write_text("# known\ndof,tuple 1,tuple 2,cos,sin\nx1,0,0,0.1,0\nx1,0,-1,0.5,0\nx1,1,0,1.0,0\n")
    return path


def test_curves_are_the_methods(order_sequence):
    curves = Bench(order_sequence).curves("order")
    assert [curve.label for curve in curves] == ["newton", "broyden"]
    assert [curve.points.tolist() for curve in curves] == [[0, 1, 2, 3], [4, 5, 6, 7]]


def test_errors_against_a_table(order_sequence, table):
    errors = Bench(order_sequence).errors(read_reference(str(table)), only_known=True)
    np.testing.assert_allclose(errors[:7], np.concatenate([np.exp(-ORDERS), ORDERS**-3.0])[:7], rtol=1e-9)
    assert np.isnan(errors[7]), "not solved"


def test_errors_against_a_point_of_a_file(order_sequence):
    with h5py.File(order_sequence, "a") as file:
        file["coefficients"][3, 1] = TRUTH
    errors = Bench(order_sequence).errors(read_reference(f"{order_sequence}@3"))
    assert errors[3] == 0.0
    np.testing.assert_allclose(errors[:3], np.exp(-ORDERS[:3]), rtol=1e-9)
    sequence = str(order_sequence)
    for text, message in ((sequence, "choose one"), (f"{sequence}@9", "no point 9"), (f"{sequence}@7", "not solved")):
        with pytest.raises(UsageError, match=message):
            read_reference(text)


def test_points_by_tolerance_have_tuples_of_their_own(order_sequence, table):
    with h5py.File(order_sequence, "a") as file:
        values = file["coefficients"][()]
        del file["coefficients"], file["tuple"], file["n_harmonics"]
        room = np.full((8, 2, 2, 2), np.nan)
        file["coefficients"] = np.concatenate([values[:, :, ::-1], room], axis=2)
        file["tuples"] = np.tile(np.concatenate([TUPLES[::-1], np.zeros((2, 2), dtype=int)]), (8, 1, 1))
        file["n_harmonics"] = np.full(8, 3)
    errors = Bench(order_sequence).errors(read_reference(str(table)), only_known=True)
    np.testing.assert_allclose(errors[:4], np.exp(-ORDERS), rtol=1e-9)
    assert Bench(order_sequence).errors(read_reference(f"{order_sequence}@0"))[0] == 0.0


def test_points_of_the_finest_set_are_the_reference(tmp_path):
    errors = np.concatenate([np.exp(-ORDERS), ORDERS**-3.0]) * np.tile([1, 1, 1, 0], 2)
    path = write_order_sequence(tmp_path / "order_sequence.h5", errors, [1] * 8)
    errors = Bench(path).errors()
    assert np.isnan(errors[[3, 7]]).all()
    np.testing.assert_allclose(errors[:3], np.exp(-ORDERS[:3]), rtol=1e-9)


def test_what_one_set_lacks_counts_as_zero_in_the_union(order_sequence, table):
    table.write_text("dof,tuple 1,tuple 2,cos,sin\nx1,1,0,1.0,0\n")
    reference = read_reference(str(table))
    known, union = (Bench(order_sequence).errors(reference, only_known=which)[0] for which in (True, False))
    assert known < union and union == pytest.approx(np.sqrt(known**2 + (0.1**2 + 0.5 * 0.5**2) / 0.5))


def test_wrong_tables_are_reported(table):
    table.write_text("dof,cos\nx1,1\n")
    with pytest.raises(ReaderError, match="columns dof"):
        read_reference(str(table))
    with pytest.raises(ReaderError, match="No such file"):
        read_reference("nowhere.csv")


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
    assert not cost_exponent(ORDERS[:2], np.array([1.0, 2.0]))


def test_cost_looks_at_the_larger_half():
    n = np.array([10.0, 20.0, 40.0, 80.0, 160.0, 320.0])
    seconds = np.where(n < 50.0, 1.0, (n / 50.0) ** 3)
    assert cost_exponent(n, seconds).exponent == pytest.approx(3.0)


@pytest.mark.long
def test_commands_draw_and_print_rates(order_sequence, table, capsys):
    for command, *options in (("work-precision", "--reference", table), ("convergence", "--reference", table), ("cost",)):
        assert main([command, str(order_sequence), *map(str, options), "--dpi", "80"]) == 0
        assert order_sequence.with_name(f"order_sequence_{command}.png").stat().st_size > 10_000
    out = capsys.readouterr().out
    assert "newton: error ~ exp(-1 harmonics%order)" in out
    assert "broyden: error ~ harmonics%order^-3" in out
    assert "newton: time ~ unknowns^2" in out


def test_pictures_report_omitted_data(order_sequence, table):
    bench = Bench(order_sequence)
    fig = draw.draw_work_precision(bench, draw.Errors(bench.errors(read_reference(str(table)))))
    text = " ".join(t.get_text() for t in fig.texts)
    assert "1 of 8 points not solved" in text and "hollow" in text


def test_improved_curves_need_an_improvement(order_sequence):
    bench = Bench(order_sequence)
    errors, none = np.exp(-np.tile(ORDERS, 2)), np.full(8, np.nan)
    with pytest.raises(UsageError, match="improvement_steps"):
        draw.draw_work_precision(bench, draw.Errors(errors, none))
    improved = np.where(np.arange(8) < 4, 0.1 * errors, np.nan)
    fig, rates = draw.draw_convergence(bench, draw.Errors(errors, improved))
    assert [curve.label for curve, _ in rates] == ["newton", "newton, improved", "broyden"]


def test_exponents_are_those_of_the_kernels(order_sequence):
    exponents = dict(draw.draw_bench(Bench(order_sequence), "n_unknowns")[1])
    assert exponents["tangent"].exponent == pytest.approx(2.0, abs=1e-9)
    assert exponents["residual"].exponent == pytest.approx(1.0, abs=1e-9)
    assert 7 not in exponents["solution"].points


def change(path, **columns):
    with h5py.File(path, "r+") as file:
        for name, values in columns.items():
            file[name][...] = values


def test_logarithmic_axes_report_omitted_points(order_sequence, capsys):
    times = np.array([0.0, 1e-7, 4e-7, 16e-7] * 2)
    change(order_sequence, kernel_tangent_seconds=times, harmonics_order=[0.0, 2.0, 4.0, 8.0] * 2)
    assert main(["bench", str(order_sequence), "--over", "harmonics%order", "--dpi", "40"]) == 0
    printed = capsys.readouterr().out
    assert "2 points with harmonics%order = 0 or less not drawn: the axis is logarithmic" in printed
    fig, _, notes = draw.draw_bench(Bench(order_sequence), "n_unknowns")
    assert notes == ["2 points of tangent with a time of 0 not drawn"]
    assert any(notes[0] in text.get_text() for text in fig.texts)


def test_noise_makes_no_exponent(order_sequence, capsys):
    change(order_sequence, kernel_residual_seconds=[1e-6, 3e-6, 1e-6, 2.5e-6] * 2, n_harmonics=[100, 101, 102, 103] * 2)
    exponents = dict(draw.draw_bench(Bench(order_sequence), "n_unknowns")[1])
    assert not exponents["residual"] and "scatter too much" in exponents["residual"].reason
    assert exponents["tangent"].exponent == pytest.approx(2.0, abs=1e-9)
    exponents = dict(draw.draw_bench(Bench(order_sequence), "n_harmonics")[1])
    assert not any(exponents.values()) and "the sizes span a factor of 1.03 alone" in exponents["tangent"].reason
    assert main(["bench", str(order_sequence), "--over", "n_harmonics", "--dpi", "40"]) == 0
    assert "tangent: no exponent, the sizes span" in capsys.readouterr().out


def test_sizes_by_column_and_by_path(order_sequence):
    data = Bench(order_sequence)
    assert data.varying() == "harmonics%order"
    np.testing.assert_array_equal(data.column("harmonics%order"), data.column("order"))
    with pytest.raises(ReaderError, match="sizes of this file"):
        data.column("n_nothing")


def test_files_are_joined(order_sequence):
    assert Bench(order_sequence, order_sequence).n_points == 16


def test_command_draws_kernels(order_sequence, capsys):
    assert main(["bench", str(order_sequence), "--also", str(order_sequence), "--over", "harmonics%order", "--dpi", "40"]) == 0
    assert "tangent: time ~ n^" in capsys.readouterr().out
    assert order_sequence.with_name("order_sequence_bench.png").exists()


def test_other_files_are_refused(sweep):
    with pytest.raises(ReaderError, match="no file of 'nhbm-bench'"):
        Bench(sweep)
