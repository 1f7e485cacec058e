"""nhbm-bench: its numbers are positive and in order, its file is a result file, and the sequences of orders keep what they promise.

The inputs of inputs/order_sequence/ promise numbers in lines `! expect: [COLUMN=VALUE ...] COLUMN < NUMBER`, or `COLUMN = NUMBER to
TOLERANCE` (relative), about the points whose columns have these values. `error` is that of nhbm-post: against the table beside the
input, else against the point with the most harmonics. No time is assessed here.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray
from nhbm_post.bench import KERNELS, Bench, read_reference
from input_cases import input_case
from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, run, solve

INPUTS = Path(__file__).resolve().parents[2] / "inputs"
FOLDER = INPUTS / "bench"
ORDER_SEQUENCES = sorted((INPUTS / "order_sequence").glob("*.nml"))
PARTS = ("setup", "solver", "recovery", "error_estimate", "total", "cpu")
ROUNDING = 1e-12

# One mass on a cubic spring, two tones.
MODEL = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,
   ground_stiffness = 1.0, damping_mass = 0.2 /
&tones frequency = 0.6, 0.9707963267948966 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, 0, cos = 0.2 /
&load dof = 'x1', tuple = 0, 1, cos = 0.2 /
&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /
"""
ORDERS = "&sweep parameter = 'harmonics%order', values = {} /\n"

LINE = re.compile(
    r"! expect: (?P<where>(?:\w+=\S+ )*)(?P<column>\w+) (?:< (?P<bound>\S+)|= (?P<number>\S+) to (?P<tolerance>\S+))"
)


def bench(source: Path | str, folder: Path, *options, status=ALL_CONVERGED, name="times") -> Path:
    """Runs the verb on a file or a text; returns the path of the result."""
    if isinstance(source, str):
        text, source = source, folder / f"{name}.nml"
        source.write_text(text)
    result = folder / f"{name}.h5"
    done = run("bench", source, "-o", result, "--quiet", *options, cwd=folder)
    assert done.status == status, done.stderr
    assert done.stdout == ""
    return result


def load(path: Path) -> xarray.Dataset:
    with xarray.open_dataset(path) as data:
        return data.load()


@pytest.mark.parametrize("name", ["duffing", "jenkins"])
def test_times_are_positive_and_in_order(name, tmp_path):
    data = load(bench(FOLDER / f"{name}.nml", tmp_path, "--budget", "0.01", "--repeats", "2"))
    assert data.attrs["threads"]
    assert (data.bench_memory_bandwidth.values > 0.0).all()
    for kernel in KERNELS:
        columns = {
            end: data[f"kernel_{kernel}_{end}"].values
            for end in ("seconds", "seconds_first", "seconds_min", "seconds_max", "yardstick", "ratio", "ratio_low", "ratio_high")
        }
        for column in columns.values():
            assert (column > 0.0).all(), kernel
        assert (columns["seconds_min"] <= columns["seconds"]).all()
        assert (columns["seconds"] <= columns["seconds_max"]).all()
        assert (columns["ratio_low"] <= columns["ratio"]).all()
        assert (columns["ratio"] <= columns["ratio_high"]).all()
    # Each contains the previous one.
    for part, whole in (
        ("residual", "newton_step"),
        ("tangent", "newton_step"),
        ("newton_step", "solution"),
        ("solution", "point"),
    ):
        least, most = data[f"kernel_{part}_seconds_min"].values, data[f"kernel_{whole}_seconds_max"].values
        assert (least < most).all(), (part, whole)


def test_rows_say_what_was_timed(tmp_path):
    data = load(bench(FOLDER / "duffing.nml", tmp_path, "--budget", "0.01", "--repeats", "1"))
    np.testing.assert_array_equal(data.tones_frequency.values, [2.0, 0.9])
    assert data.n_unknowns.values.tolist() == [8, 8], "an odd motion: harmonics 1, 3, 5, 7"
    assert data.bench_n_samples.values.tolist() == [64, 64]
    assert data.bench_n_channels.values.tolist() == [1, 1]
    assert (data.residual.values < 1e-12).all() and (data.evaluations.values > data.iterations.values).all()


def test_parts_add_up_and_lie_between_their_ends(tmp_path):
    path = bench(MODEL + ORDERS.format("3, 7"), tmp_path, "--budget", "0", "--repeats", "5")
    data = load(path)
    assert not any(name.startswith("kernel_") for name in data)
    for part in PARTS:
        least, middle, most = (data[f"bench_{part}_seconds{end}"].values for end in ("_min", "", "_max"))
        assert (least >= 0.0).all() and (least <= middle).all() and (middle <= most).all()
    assert (data.bench_solver_seconds.values > 0.0).all() and (data.bench_setup_seconds.values > 0.0).all()
    parts = sum(data[f"bench_{part}_seconds_min"] for part in ("setup", "solver", "recovery", "error_estimate"))
    assert (data.bench_error_estimate_seconds.values > 0.0).all()
    assert (parts.values <= data.bench_total_seconds_min.values * (1.0 + ROUNDING)).all()
    # One thread: the processor time does not exceed the wall time, except by one tick of its clock.
    assert (data.bench_cpu_seconds_min.values <= data.bench_total_seconds_max.values + 0.01).all()


def test_file_is_that_of_solve(tmp_path):
    """Each point is solved separately, without a first guess."""
    text = MODEL + ORDERS.format("3, 2")
    data = load(bench(text, tmp_path, "--budget", "0", "--repeats", "2"))
    solved = load(solve(text, tmp_path, name="solved"))
    for name in ("coefficients", "iterations", "evaluations", "residual", "truncation_estimate", "status", "n_unknowns"):
        np.testing.assert_array_equal(data[name].values, solved[name].values, err_msg=name)


@pytest.mark.long  # seconds
def test_memory_grows_with_the_tangent(tmp_path):
    """Newton's dense tangent of 61 MB at order 26 (2809 unknowns) must be visible; at order 3 it is negligible."""
    text = MODEL + "&solver method = 'newton' /\n&sampling samples = 54 /\n&error_estimate is_on = .false. /\n"
    options = ("--budget", "0", "--repeats", "1", "--set", "harmonics%symmetry='none'")
    data = load(bench(text + ORDERS.format("3, 26"), tmp_path, *options))
    if np.isnan(data.bench_memory_peak.values).any():
        pytest.skip("this system does not tell the peak of the memory")
    small, large = data.bench_memory_peak.values
    assert large >= 8 * 2809**2
    assert large <= 4 * 8 * 2809**2
    assert small < 0.2 * large


def test_improved_motion_is_nearer(tmp_path):
    text = MODEL + "&error_estimate improvement_steps = 12 /\n" + ORDERS.format("3, 11")
    data = Bench(bench(text, tmp_path, "--budget", "0", "--repeats", "1"))
    assert data.errors(is_improved=True)[0] < 0.01 * data.errors()[0]


def test_improved_motion_of_solve_is_on_the_wider_set(tmp_path):
    result = load(solve(MODEL + "&error_estimate improvement_steps = 12 /\n", tmp_path))
    tuples, plain, improved = (result[name].values for name in ("tuple", "coefficients", "improved_coefficients"))
    is_inside = np.abs(tuples).max(axis=1) <= 3
    assert np.abs(tuples).max() == 6
    assert np.isnan(plain[0, 0, ~is_inside]).all() and np.isfinite(plain[0, 0, is_inside]).all()
    assert np.isfinite(improved).all()
    wide = load(solve(MODEL.replace("order = 3", "order = 6"), tmp_path, name="wide"))
    known = dict(zip(map(tuple, wide["tuple"].values.tolist()), wide.coefficients.values[0, 0]))
    expected = np.array([known[tuple(j)] for j in tuples.tolist()])
    assert np.abs(improved[0, 0] - expected).max() < 0.01 * np.abs(plain[0, 0, is_inside] - expected[is_inside]).max()


def test_oversampling_makes_the_grid(tmp_path):
    options = ("--budget", "0.001", "--repeats", "1", "--set", "sampling%oversampling=3.0")
    data = load(bench(MODEL, tmp_path, *options, name="three"))
    assert data.bench_n_samples.values.tolist() == [24 * 24], "3 (2 3 + 1) = 21 samples, rounded up"
    done = run("check", tmp_path / "three.nml", "--set", "sampling%oversampling=2", "--set", "sampling%samples=16", cwd=tmp_path)
    assert done.status == BAD_INPUT and "either 'samples' or 'oversampling'" in done.stderr


def test_unsolved_points_are_reported_by_the_exit_status(tmp_path):
    options = ("--budget", "0.01", "--repeats", "1", "--set", "solver%max_iterations=1", "--set", "solver%fallback=.false.")
    data = load(bench(FOLDER / "duffing.nml", tmp_path, *options, status=NOT_ALL_CONVERGED))
    assert (data.status.values == 3).all()


def test_unknown_tones_have_costs_but_no_kernels(tmp_path):
    data = load(bench(INPUTS / "autonomous" / "van_der_pol.nml", tmp_path, "--budget", "0.01", "--repeats", "1"))
    assert (data.bench_total_seconds.values > 0.0).all() and "kernel_point_seconds" not in data


def test_refusals(tmp_path):
    source = FOLDER / "duffing.nml"
    (tmp_path / "there.h5").write_text("precious")
    for words, message in (
        ((source, "-o", "new.h5", "--budget", "soon"), "'--budget'"),
        ((source, "-o", "new.h5", "--budget", "-1"), "'--budget'"),
        ((source, "-o", "new.h5", "--repeats", "0"), "'--repeats'"),
        ((source, "-o", "new.h5", "--retry"), "'--retry'"),
        ((source,), "-o FILE"),
        ((source, "-o", "there.h5"), "--overwrite"),
    ):
        done = run("bench", *words, cwd=tmp_path)
        assert done.status == BAD_INPUT and message in done.stderr, done.stderr
    assert (tmp_path / "there.h5").read_text() == "precious"
    assert [file.name for file in tmp_path.iterdir()] == ["there.h5"]


def test_ranks_are_refused(tmp_path):
    done = run("bench", FOLDER / "duffing.nml", "-o", "times.h5", cwd=tmp_path, ranks=2)
    assert done.status == BAD_INPUT and "without mpirun" in done.stderr


LONG_ORDER_SEQUENCES = ("light_damping", "paper_strong_cubic", "dynamic_cubic", "jenkins_two_tones")


@pytest.mark.parametrize("source", [input_case(file, LONG_ORDER_SEQUENCES) for file in ORDER_SEQUENCES])
def test_order_sequence_gives_what_it_promises(source, tmp_path):
    lines = [line for line in source.read_text().splitlines() if "! expect" in line]
    assert lines, f"{source} has no '! expect:' line"
    result = tmp_path / "result.h5"
    done = run("bench", source, "-o", result, "--quiet", "--budget", "0", "--repeats", "1", cwd=tmp_path)
    assert done.status in (ALL_CONVERGED, NOT_ALL_CONVERGED), done.stderr
    data = Bench(result)
    assert data.is_solved.all(), data.column("status")
    table = source.with_suffix(".csv")
    errors = data.errors(read_reference(str(table)), only_known=True) if table.exists() else data.errors()
    for line in lines:
        match = LINE.fullmatch(line)
        assert match, f"not a known form: {line}"
        values = errors if match["column"] == "error" else data.column(match["column"])
        chosen = np.isfinite(errors)
        for word in match["where"].split():
            name, value = word.split("=")
            column = data.column(name)
            chosen &= column == (value if column.dtype == object else float(value))
        values = values[chosen]
        assert values.size, f"no point fits: {line}"
        if match["bound"]:
            assert (values < float(match["bound"])).all(), f"{line}: {values}"
        else:
            np.testing.assert_allclose(values, float(match["number"]), rtol=float(match["tolerance"]), err_msg=line)
