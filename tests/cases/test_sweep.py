"""Sweeps: their points, the results of each, and independence of the number of ranks."""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from nhbm_post.reader import Results
from nhbm_post.report import info

from ended_runs import ranks_of
from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, command, environment, read, run, solve

CONVERGED, OUT_OF_BUDGET, NOT_FINITE, FAILED = 1, 3, 5, 6

# The paper's beam against a rigid wall, at a low order.
BEAM = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4,
   damping_diagonal = 1.0 /
&tones frequency = 2.718281828459045, 3.141592653589793 /
&harmonics order = {order} /
&sampling samples = {samples} /
&load dof = 'v3', tuple = 1, 0, cos = 100.0 /
&load dof = 'v3', tuple = 0, 1, cos = 100.0 /
&law type = 'rigid_wall', label = 'wall', dof = 'v3', gap = 1.5e-3, augmentation = 1.0e5 /
&error_estimate truncation = 10.0, aliasing = 10.0, penetration = 10.0 /
"""
WALL = BEAM.format(order=4, samples=20)
GAPS, LOADS = [0.5e-3, 1.0e-3, 2.0e-3], [60.0, 100.0, 140.0, 180.0]
GRID = WALL + (
    "&sweep parameter = 'law(wall)%gap', values = 0.5e-3, 1.0e-3, 2.0e-3 /\n"
    "&sweep parameter = 'load(2)%cos', values = 60.0, 100.0, 140.0, 180.0 /\n"
)
SOLUTION = ("coefficients", "force_coefficients", "corrected_coefficients", "penetration", "residual", "status", "iterations")


def swept(*groups):
    return WALL + "".join(f"&sweep {keys} /\n" for keys in groups)


def assert_same_bits(a, b, names=SOLUTION):
    for name, one, other in zip(names, read(a, *names), read(b, *names)):
        assert one.tobytes() == other.tobytes(), name


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    return solve(GRID, tmp_path_factory.mktemp("grid"))


# Which points


def test_last_axis_runs_fastest(grid):
    gap, load = read(grid, "law_wall_gap", "load_2_cos")
    assert gap.tolist() == np.repeat(GAPS, len(LOADS)).tolist()
    assert load.tolist() == LOADS * len(GAPS)


def test_point_of_a_grid_equals_the_point_alone(grid, tmp_path):
    alone = solve(WALL, tmp_path, "--set", "law(1)%gap=2.0e-3", "--set", "load(2)%cos=140")
    with Results(grid) as results:
        point = results.point(at={"law_wall_gap": 2.0e-3, "load_2_cos": 140.0})
    assert read(grid, "coefficients")[point].tobytes() == read(alone, "coefficients")[0].tobytes()


def test_contact_is_felt_somewhere_and_not_everywhere(grid):
    force = np.abs(read(grid, "force_coefficients")).sum(axis=(1, 2, 3))
    assert (force > 1.0).any() and (force == 0.0).any()


def test_zipped_parameters_go_side_by_side(tmp_path):
    text = swept(
        "parameter = 'harmonics%order', values = 2, 3, 4, axis = 7",
        "parameter = 'law(1)%augmentation', values = 1e4, 1e5, axis = 2",
        "parameter = 'sampling%samples', values = 12, 16, 20, axis = 7",
    )
    order, samples, augmentation, n_harmonics = read(
        solve(text, tmp_path), "harmonics_order", "sampling_samples", "law_1_augmentation", "n_harmonics"
    )
    assert order.tolist() == [2, 2, 3, 3, 4, 4]
    assert samples.tolist() == [12, 12, 16, 16, 20, 20]
    assert augmentation.tolist() == [1e4, 1e5] * 3
    assert n_harmonics.tolist() == [13, 13, 25, 25, 41, 41]


def test_harmonics_that_a_point_lacks_are_nan(tmp_path):
    result = solve(swept("parameter = 'harmonics%order', values = 4, 2"), tmp_path)
    tuples, coefficients = read(result, "tuple", "coefficients")
    is_high = np.abs(tuples).max(axis=1) > 2
    assert is_high.sum() == 41 - 13
    assert np.isnan(coefficients[1][:, is_high]).all()
    assert np.isfinite(coefficients[1][:, ~is_high]).all() and np.isfinite(coefficients[0]).all()


@pytest.mark.parametrize("path", ["HARMONICS%order", "  Harmonics%Order"])
def test_file_has_room_for_the_highest_order(path, tmp_path):
    """Group names may be in either case; the harmonics of the second point must be preserved."""
    result = solve(swept(f"parameter = '{path}', values = 2, 4"), tmp_path)
    assert len(read(result, "tuple")) == 41
    assert np.isfinite(read(result, "coefficients")[1]).all()


def test_ranges(tmp_path):
    text = swept(
        "parameter = 'law(1)%gap', from = 1e-4, to = 1e-2, n = 5, spacing = 'log'",
        "parameter = 'load(1)%cos', from = 10.0, to = 20.0, n = 3",
    )
    gap, load = read(solve(text, tmp_path), "law_1_gap", "load_1_cos")
    assert np.allclose(gap[::3], 1e-4 * 10.0 ** (0.5 * np.arange(5)), rtol=1e-14, atol=0.0)
    assert (gap[0], gap[-1]) == (1e-4, 1e-2), "the ends are met exactly"
    assert load[:3].tolist() == [10.0, 15.0, 20.0]


def test_text_parameter(tmp_path):
    result = solve(swept("parameter = 'solver%method', texts = 'newton', 'broyden'"), tmp_path)
    coefficients, iterations = read(result, "coefficients", "iterations")
    with Results(result) as results:
        assert results.parameter("solver%method").values.tolist() == ["newton", "broyden"]
        assert results.select({"solver_method": "broyden"}) == [1]
    assert iterations[0] < iterations[1]
    assert np.abs(coefficients[0] - coefficients[1]).max() <= 1e-9 * np.abs(coefficients).max()


def test_element_of_a_list(tmp_path):
    result = solve(swept("parameter = 'tones%frequency(2)', values = 3.0, 4.5"), tmp_path)
    assert read(result, "frequency").tolist() == [[2.718281828459045, 3.0], [2.718281828459045, 4.5]]
    assert read(result, "tones_frequency_2").tolist() == [3.0, 4.5]


def test_label_and_number_name_the_same_law(tmp_path):
    by_label = solve(swept("parameter = 'law(wall)%gap', values = 1e-3, 2e-3"), tmp_path, name="label")
    by_number = solve(swept("parameter = 'law(1)%gap', values = 1e-3, 2e-3"), tmp_path, name="number")
    assert_same_bits(by_label, by_number)
    with h5py.File(by_label, "r") as file:
        assert file["law_wall_gap"].attrs["parameter"] in ("law(wall)%gap", b"law(wall)%gap")


# Ranks


@pytest.mark.parametrize("ranks", [1, 2, 4])
def test_every_number_of_ranks_gives_the_same_bits(ranks, grid, tmp_path):
    shared = solve(GRID, tmp_path, ranks=ranks)
    assert_same_bits(grid, shared)
    with h5py.File(shared, "r") as file:
        assert file.attrs["n_ranks"] == ranks
        assert set(file["rank"][()]) <= set(range(ranks))


def test_more_ranks_than_points(tmp_path):
    one, four = solve(WALL, tmp_path, name="one"), solve(WALL, tmp_path, ranks=4, name="four")
    assert_same_bits(one, four)


# Points that fail


@pytest.mark.parametrize("law", ["cubic_spring', stiffness = 1.0", "elastic_stop', stiffness = 10.0, gap = 0.5"])
def test_load_out_of_range_is_not_finite(law, tmp_path):
    """Squares of such loads, and powers, overflow: the residual is undetermined."""
    text = DUFFING.split("&sweep")[0].replace("cubic_spring', dof = 'x1', stiffness = 1.0", f"{law}, dof = 'x1'")
    text += "&sweep parameter = 'load(1)%cos', values = 0.1, 1e155, 1e200, 1e300 /\n"
    result = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    status, residual, power = read(result, "status", "residual", "power_in")
    assert status.tolist() == [CONVERGED] + 3 * [NOT_FINITE]
    assert np.isfinite(power[0]) and not np.isfinite(residual[1:]).any()
    with Results(result) as results:
        assert "overflow" in results.message(2)


@pytest.mark.parametrize("ranks", [None, 2])
def test_wrong_value_is_a_status_and_the_others_go_on(tmp_path, ranks):
    """A two-sided wall cannot have a negative gap."""
    text = swept("parameter = 'law(wall)%gap', values = 1.5e-3, -1.0e-3, 1.0e-3").replace(
        "augmentation = 1.0e5", "augmentation = 1.0e5, two_sided = .true."
    )
    result = solve(text, tmp_path, status=NOT_ALL_CONVERGED, ranks=ranks)
    status, coefficients = read(result, "status", "coefficients")
    assert status.tolist() == [CONVERGED, FAILED, CONVERGED]
    assert np.isnan(coefficients[1]).all() and np.isfinite(coefficients[[0, 2]]).all()
    with Results(result) as results:
        assert "gap" in results.message(1) and "two-sided" in results.message(1)
        assert results.message(0) == results.message(2) == ""


def test_wrong_first_value_is_bad_input(tmp_path):
    """The first point is read before anything is created, so that an error is reported immediately."""
    source = tmp_path / "case.nml"
    source.write_text(swept("parameter = 'law(wall)%augmentation', values = -1.0, 1.0e5"))
    done = run("solve", source, cwd=tmp_path)
    assert done.status == 2 and "augmentation" in done.stderr
    assert list(tmp_path.iterdir()) == [source]


def test_point_out_of_budget_is_a_status(tmp_path):
    text = swept("parameter = 'solver%max_iterations', values = 100, 1, 50").replace(
        "gap = 1.5e-3, augmentation = 1.0e5", "gap = 0.2e-3, augmentation = 1.0e3"
    )
    text += "&solver fallback = .false. /\n"
    result = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    status, iterations, residual = read(result, "status", "iterations", "residual")
    assert status.tolist() == [CONVERGED, OUT_OF_BUDGET, CONVERGED]
    assert iterations[1] == 1 and residual[1] > 1e-12
    with Results(result) as results:
        assert results.status_name(1) == "out_of_budget"


def test_point_with_other_degrees_of_freedom_is_a_status(tmp_path):
    result = solve(swept("parameter = 'structure%n_elements', values = 4, 6"), tmp_path, status=NOT_ALL_CONVERGED)
    assert read(result, "status").tolist() == [CONVERGED, FAILED]


def test_points_with_common_degrees_of_freedom_share_a_file(tmp_path):
    text = swept("parameter = 'structure%n_elements', values = 4, 6") + "&output dofs = 'v3' /\n"
    coefficients = read(solve(text, tmp_path), "coefficients")
    assert coefficients.shape[:2] == (2, 1)
    assert np.isfinite(coefficients).all() and not np.array_equal(coefficients[0], coefficients[1])


# Branches, and points that start from their neighbours

DUFFING = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.02 /
&tones frequency = 0.5 /
&harmonics order = 7 /
&sampling samples = 64 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&sweep parameter = 'tones%frequency', from = 0.5, to = 2.5, n = 200 /
"""
FROM_NEIGHBOUR = "&solver first_guess = 'neighbour', chain_length = 16 /\n"


@pytest.fixture(scope="module")
def chained(tmp_path_factory):
    return solve(DUFFING + FROM_NEIGHBOUR, tmp_path_factory.mktemp("chained"))


@pytest.mark.parametrize("ranks", [1, 2, 4])
def test_chains_give_the_same_bits_on_any_ranks(ranks, chained, tmp_path):
    assert_same_bits(chained, solve(DUFFING + FROM_NEIGHBOUR, tmp_path, ranks=ranks), (*SOLUTION, "evaluations", "fallback"))


def test_neighbours_save_iterations(chained, tmp_path):
    """Less than four tenths of the iterations; where the linear and the neighbour's guess lead to one branch, they lead to one
    motion."""
    alone = solve(DUFFING + "&solver first_guess = 'linear' /\n", tmp_path)
    a, b = read(alone, "coefficients"), read(chained, "coefficients")
    assert 5 * read(chained, "iterations").sum() < 2 * read(alone, "iterations").sum()
    is_same = np.abs(a - b).max(axis=(1, 2, 3)) < 1e-9
    assert is_same.sum() > 150 and is_same[::16].all(), "points that begin a chain start as ever"


def test_whole_line_as_a_chain_follows_the_upper_branch(tmp_path):
    """The largest amplitude near its peak: 0.1/(0.02 w) at w with w**2 = 1 + 0.75 a**2 (first harmonic)."""
    told = solve(DUFFING + "&solver first_guess = 'neighbour', chain_length = 200 /\n", tmp_path, name="told")
    result = solve(DUFFING, tmp_path)
    amplitude = np.hypot(*read(result, "coefficients")[:, 0, 1, :].T)
    assert amplitude.max() > 2.2
    assert_same_bits(told, result)


@pytest.mark.parametrize(
    "keys",
    [
        "parameter = 'tones%frequency', values = 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6",  # too few
        "parameter = 'tones%frequency', values = 1.0, 1.1, 1.2, 1.3, 1.25, 1.4, 1.5, 1.6",  # up and down
        "parameter = 'harmonics%order', from = 1, to = 8, n = 8",
        "parameter = 'structure%n_masses', from = 1, to = 8, n = 8",
        "parameter = 'solver%tolerance', from = 1e-12, to = 1e-8, n = 9, spacing = 'log'",
    ],
)
def test_points_without_a_way_start_alone(keys, tmp_path):
    text = DUFFING.split("&sweep")[0].replace("&sampling samples = 64 /\n", "")
    text += f"&output dofs = 'x1' /\n&sweep {keys} /\n"
    result = solve(text, tmp_path)
    assert_same_bits(result, solve(text + "&solver first_guess = 'linear' /\n", tmp_path, name="linear"))
    with h5py.File(result, "r") as file:
        assert "first_guess = 'auto'" in file["input_complete"][()].decode()


@pytest.mark.parametrize("ranks, is_reported", [(1, False), (2, True)])
def test_ranks_without_a_chain_are_reported(ranks, is_reported, tmp_path):
    (tmp_path / "case.nml").write_text(DUFFING)
    done = run("solve", "case.nml", cwd=tmp_path, ranks=ranks)
    assert ("note: 1 chain of points for 2 ranks" in done.stdout) == is_reported


@pytest.mark.parametrize("ranks", [1, 3])
@pytest.mark.parametrize("length", [200, 70])
def test_jumps_are_reported_and_stored(length, ranks, tmp_path):
    """A line falls off the upper branch, in one chain after its peak, otherwise where the next chain begins below; the line of a
    small load has one branch. This does not depend on the ranks."""
    source = tmp_path / "case.nml"
    loads = "&sweep parameter = 'load(1)%cos', values = 0.1, 0.001, 0.1 /\n"
    text = DUFFING.replace("&sweep", loads + "&sweep") + f"&solver first_guess = 'neighbour', chain_length = {length} /\n"
    source.write_text(text)
    done = run("solve", source, cwd=tmp_path, ranks=ranks)
    assert done.status == ALL_CONVERGED, done.stderr
    branch, frequency, x = read(tmp_path / "case.h5", "branch", "tones_frequency", "coefficients")
    branch = branch.reshape(3, 200)
    assert branch[0].tolist() == branch[2].tolist() and (branch[1] == 1).all()
    steps = np.abs(np.diff(np.hypot(*x[:200, 0, 1].T)))
    assert np.flatnonzero(np.diff(branch[0])).tolist() == np.flatnonzero(steps > 0.1).tolist() == [{200: 170, 70: 69}[length]]
    first = np.flatnonzero(np.diff(branch[0]))[0] + 1
    begin = "2 jumps to another branch between neighbouring points (see 'branch'), the first at "
    place = re.search(re.escape(begin) + r"(load\(1\)%cos = 0.1 N, tones%frequency = (\S+) rad/s)", done.stdout)
    assert place and float(place[2]) == pytest.approx(frequency[first], abs=0.5 * abs(frequency[1] - frequency[0])), done.stdout
    told = run("info", tmp_path / "case.h5", cwd=tmp_path).stdout
    assert f"jumps      to another branch at point {first} ({place[1]})" in told
    assert ("which ends near" in told) == (length == 200), "known where a chain follows the branch alone"


def test_fall_behind_a_peak_between_coarse_points(tmp_path):
    """14 points, only one of which is near the peak: no slope is far above the others. The branch ends where finer points end,
    too."""
    result = solve(DUFFING.replace("n = 200", "n = 14"), tmp_path)
    branch, frequency = read(result, "branch", "tones_frequency")
    jump = int(np.flatnonzero(np.diff(branch))[0]) + 1
    assert branch.tolist() == [1] * jump + [2] * (14 - jump)
    told = run("info", result, cwd=tmp_path).stdout
    message = f"point {jump}: not on the branch of the previous point, which ends near tones%frequency = 2.211"
    assert message in told
    assert frequency[jump - 1] < 2.2115 < frequency[jump]
    with h5py.File(result, "r") as file:
        messages = file["message"][...].view("S400")[:, 0]
    assert [i for i, message in enumerate(messages) if message] == [jump]


def test_motions_that_are_steep_are_on_one_branch(tmp_path):
    """A linear peak, narrower than the distance of the points: examined and accepted."""
    text = DUFFING.replace("stiffness = 1.0 /", "stiffness = 1.0e-9 /").replace("n = 200", "n = 14")
    assert read(solve(text, tmp_path), "branch").tolist() == [1] * 14


def test_no_branches_without_an_order(tmp_path):
    result = solve(swept("parameter = 'law(wall)%gap', values = 1.0e-3, 3.0e-3, 2.0e-3"), tmp_path)
    assert read(result, "branch").tolist() == [0, 0, 0]


def test_chain_restarts_after_a_failed_point(tmp_path):
    text = DUFFING.split("&sweep")[0] + (
        "&sweep parameter = 'law(1)%stiffness', values = 0.1, 0.11, 0.12, 0.13, 0.14, axis = 1 /\n"
        "&sweep parameter = 'solver%max_iterations', values = 100, 100, 0, 100, 100, axis = 1 /\n"
        "&solver first_guess = 'neighbour', fallback = .false. /\n"
    )
    whole = solve(text, tmp_path, status=NOT_ALL_CONVERGED)
    last_two = text.replace("0.1, 0.11, 0.12, 0.13, 0.14", "0.13, 0.14").replace("100, 100, 0, 100, 100", "100, 100")
    rest = solve(last_two, tmp_path, name="rest")
    assert read(whole, "status").tolist() == [CONVERGED, CONVERGED, OUT_OF_BUDGET, CONVERGED, CONVERGED]
    assert read(whole, "coefficients")[3:].tobytes() == read(rest, "coefficients").tobytes()


def test_chains_run_along_the_last_axis_only(tmp_path):
    """Each line of a grid is a separate sweep; a chain over harmonics starts from the preceding point and finds the same motion."""
    line = "&sweep parameter = 'tones%frequency', from = 0.5, to = 0.7, n = 5 /\n"
    text = DUFFING.split("&sweep")[0] + FROM_NEIGHBOUR
    grid = solve(text + "&sweep parameter = 'harmonics%order', values = 3, 7 /\n" + line, tmp_path, name="grid")
    alone = solve(text + line, tmp_path, name="alone")
    assert read(grid, "coefficients")[5:].tobytes() == read(alone, "coefficients").tobytes()
    order_last = solve(text + "&sweep parameter = 'harmonics%order', values = 3, 7 /\n", tmp_path, name="order")
    single = solve(text, tmp_path, name="single")
    chained, anew = read(order_last, "coefficients")[1], read(single, "coefficients")[0]
    assert np.nanmax(np.abs(chained - anew)) <= 1e-13 * np.nanmax(np.abs(anew))


# Times of the ranks


def test_times_of_all_ranks_are_stored(tmp_path):
    result = solve(DUFFING + "&solver first_guess = 'linear' /\n", tmp_path, ranks=2)
    with h5py.File(result, "r") as file:
        times = {name.removeprefix("worker_"): file[name][()] for name in file if name.startswith("worker_")}
        assert file["worker"][()].tolist() == [0, 1]
        assert np.bincount(file["rank"][()], minlength=2).tolist() == times["points"].tolist()
        solved = [file["solve_seconds"][()][file["rank"][()] == rank].sum() for rank in (0, 1)]
        shares = [file[f"{part}_seconds"][()] for part in ("setup", "iteration", "error_estimate")]
        assert np.min(shares) > 0.0 and (sum(shares) < file["solve_seconds"][()]).all()
    assert times["points"].sum() == 200
    assert (times["draws"] > 0).all() and times["draws"].sum() < 150, "blocks, not single points"
    parts = sum(times[f"{part}_seconds"] for part in ("reading", "solving", "writing", "drawing", "idle"))
    assert (parts <= times["total_seconds"] + 1e-3).all()
    assert np.allclose(times["reading_seconds"] + times["solving_seconds"], solved, atol=1e-3)
    overhead = (times["total_seconds"] - times["solving_seconds"] - times["idle_seconds"]) / np.maximum(times["points"], 1)
    assert np.allclose(overhead, times["overhead_per_point"], atol=1e-9)


def test_log_levels(tmp_path):
    source = tmp_path / "case.nml"
    source.write_text(WALL)

    def told(*options):
        done = run("solve", source, "--overwrite", *options, cwd=tmp_path)
        assert done.status == 0, done.stderr
        return done.stdout, done.stderr

    assert told("--quiet") == told("--log-level", "quiet") == ("", "")
    normal, progress = told()
    assert "1 of 1 points converged" in normal and "overhead" not in normal and "1/1 points" in progress
    for options in (["--verbose"], ["--log-level", "verbose"]):
        table, progress = told(*options)
        assert "idle share" in table and "overhead/point [s]" in table and "point 0" not in progress
    table, progress = told("--log-level", "debug")
    assert "idle share" in table and "point 0 on rank 0: converged, " in progress


def test_unknown_log_level(tmp_path):
    done = run("solve", "case.nml", "--log-level", "loud", cwd=tmp_path)
    assert done.status == 2 and "unknown log level 'loud'; known: quiet, normal, verbose, debug" in done.stderr


# Contents of the file


@pytest.mark.parametrize("text", [GRID, WALL], ids=["sweep", "single point"])
def test_input_complete_gives_the_same_bits(text, tmp_path):
    fixed = ["--set", "solver%tolerance=1e-11"] + (["--set", "law(wall)%gap=1.2e-3"] if text is WALL else [])
    first = solve(text, tmp_path, *fixed, name="first")
    with Results(first) as results:
        complete = results.input_complete
    for key in ("two_sided", "max_iterations", "primary_method", "left_support"):
        assert key in complete, "defaults stand in it"
    again = solve(complete, tmp_path, name="again")
    if text is WALL:
        assert_same_bits(first, again)
    else:
        assert_same_bits(again, first, ("coefficients",))


def test_input_text_is_the_file_as_given(grid):
    with Results(grid) as results:
        assert results.input_text.rstrip("\n") == GRID.rstrip("\n")


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_file_opens_in_xarray(engine, tmp_path):
    result = solve(GRID + "&output samples = 12 /\n", tmp_path)
    with xarray.open_dataset(result, engine=engine) as data:
        assert dict(data.sizes)["point"] == len(GAPS) * len(LOADS)
        assert data["coefficients"].dims == ("point", "dof", "harmonic", "component")
        assert data["displacement_samples"].dims == ("point", "law_dof", "tau_2", "tau_1")
        assert [str(label) for label in data["component"].values] == ["cos", "sin"]
        middle = data["coefficients"].sel(dof="v3", component="cos").isel(point=0)
        first = middle.values[(data["tuple"].values == [1, 0]).all(axis=1)]
        with Results(result) as results:
            assert first[0] == results.coefficients(0, "v3", (1, 0))[0]


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_xarray_selects_without_our_package(engine, grid):
    """By the values of swept parameters, by tone and by tuple."""
    with xarray.open_dataset(grid, engine=engine) as data:
        assert {"law_wall_gap", "load_2_cos", "tuple", "tuple_1", "tuple_2", "frequency"} <= set(data.coords)
        assert data["frequency"].sel(tone=2).values.tolist() == [3.141592653589793] * 12
        table = data.set_index(point=["law_wall_gap", "load_2_cos"], harmonic=["tuple_1", "tuple_2"])
        found = table["coefficients"].sel(dof="v3", component="cos").sel(point=(1.0e-3, 140.0)).sel(harmonic=(1, 0))
        line = data["coefficients"].sel(dof="v3", component="cos").where(data["law_wall_gap"] == 1.0e-3, drop=True)
        with Results(grid) as results:
            point = results.point(at={"law_wall_gap": 1.0e-3, "load_2_cos": 140.0})
            assert float(found) == results.coefficients(point, "v3", (1, 0))[0]
        assert line.sizes["point"] == len(LOADS)
        assert {"units", "long_name"} <= set(data["worker_solving_seconds"].attrs)


def test_every_dataset_reports_its_unit(tmp_path):
    """As shown by h5dump: a unit and a description for each dataset, and scales along each axis."""
    result = solve(GRID + "&output samples = 12 /\n&sweep parameter = 'solver%method', texts = 'newton' /\n", tmp_path)
    with h5py.File(result, "r") as file:
        assert len(file) > 50
        for name, dataset in file.items():
            if name == "message_byte":
                continue
            assert {"units", "long_name"} <= set(dataset.attrs), name
            unit, words = (np.bytes_(dataset.attrs[key]).decode() for key in ("units", "long_name"))
            assert words, name
            assert unit or "parameter" in dataset.attrs or dataset.dtype.kind in "OS", name
            if not h5py.h5ds.is_scale(dataset.id):
                assert all(len(axis) == 1 for axis in dataset.dims), name


def kill(process, ranks):
    """Kills a run, or one rank of it: mpirun then ends the others."""
    victim = process.pid
    if ranks is not None:
        victim = ranks_of(process)[-1]
    os.kill(victim, signal.SIGKILL)


@pytest.mark.parametrize("ranks", [None, 3])
def test_killed_run_leaves_a_sound_file(ranks, tmp_path):
    """Points that have a status are complete and correct; the others are NaN and pending."""
    if ranks is not None and not Path("/proc/self/task").exists():
        pytest.skip("no /proc, where the ranks of mpirun are found")
    n = 1000
    text = BEAM.format(order=8, samples=40) + f"&sweep parameter = 'law(1)%gap', from = 0.5e-3, to = 2e-3, n = {n} /\n"
    text += "&solver first_guess = 'linear' /\n"
    source, result = tmp_path / "case.nml", tmp_path / "case.h5"
    source.write_text(text)
    process = subprocess.Popen(
        command("solve", source, "--quiet", ranks=ranks), cwd=tmp_path, env=environment(), stderr=subprocess.PIPE
    )
    try:
        deadline = time.monotonic() + 600.0
        while not result.exists():
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < deadline, "no result file appeared"
            time.sleep(0.01)
        while not read(result, "status").any():  # the file may be read while the run writes it
            assert time.monotonic() < deadline, "no point was written"
            time.sleep(0.1)
        assert process.poll() is None, "the run ended before it could be killed"
        kill(process, ranks)
        process.wait(timeout=600.0)
    finally:
        process.kill()
        process.wait()
        process.stderr.close()
    status, coefficients, gap = read(result, "status", "coefficients", "law_1_gap")
    done = np.flatnonzero(status)
    assert 0 < done.size < n
    assert (status[done] == CONVERGED).all()
    assert np.isfinite(coefficients[done]).all()
    # Each rank may have been writing the block of rows that it held; all others are unchanged.
    touched = np.flatnonzero((status == 0) & ~np.isnan(coefficients).all(axis=(1, 2, 3)))
    assert touched.size <= 32 * (ranks or 1), "a block holds 32 rows at most"
    assert np.count_nonzero(np.diff(touched) > 1) < (ranks or 1), "one block a rank"
    alone = solve(text.split("&sweep")[0], tmp_path, "--set", f"law(1)%gap={float(gap[done[-1]])!r}", name="alone")
    assert read(alone, "coefficients")[0].tobytes() == coefficients[done[-1]].tobytes()


# Command line


def test_result_is_named_after_the_input(tmp_path):
    folder = tmp_path / "inputs.d"
    folder.mkdir()
    (folder / "my.case.nml").write_text(WALL)
    done = run("solve", "inputs.d/my.case.nml", cwd=tmp_path)
    assert done.status == 0, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["inputs.d", "my.case.h5"]
    assert "my.case.h5" in done.stdout and "1 of 1 points converged" in done.stdout


def test_set_of_a_swept_key_is_refused(tmp_path):
    """No point would have the value; another path of the key is the same key, another element is not."""
    text = swept("parameter = 'law(1)%gap', values = 1.0e-3, 2.0e-3", "parameter = 'tones%frequency(1)', values = 2.7, 2.8")
    source = tmp_path / "case.nml"
    source.write_text(text)
    for path in ("law(1)%gap", "law(wall)%GAP", "tones%frequency(1)"):
        done = run("solve", source, "--set", f"{path}=9.0", cwd=tmp_path)
        assert done.status == BAD_INPUT and f"--set {path}" in done.stderr and "&sweep(" in done.stderr, done.stderr
        assert ("law(1)%gap" if "law" in path else "tones%frequency(1)") in done.stderr.split("sweeps")[1]
    solve(text, tmp_path, "--set", "tones%frequency(2)=3.2")


def test_set_changes_every_point_and_sweeps(tmp_path):
    text = swept("parameter = 'law(1)%gap', values = 1.0e-3, 2.0e-3")
    other_load = solve(text, tmp_path, "--set", "load(1)%cos=90.0", name="load")
    expected = solve(text.replace("tuple = 1, 0, cos = 100.0", "tuple = 1, 0, cos = 90.0"), tmp_path, name="edited")
    assert_same_bits(other_load, expected)
    longer = solve(text, tmp_path, "--set", "sweep(1)%values=1.0e-3, 1.5e-3, 2.0e-3", name="longer")
    assert read(longer, "law_1_gap").tolist() == [1.0e-3, 1.5e-3, 2.0e-3]


@pytest.mark.parametrize("path, value", [("sampling%samples", "24"), ("solver%memory", "7"), ("output%samples", "9")])
def test_group_that_the_file_lacks_is_added(path, value, tmp_path):
    """By --set and by a sweep; the result is that of a file with the group."""
    text = WALL.replace("&sampling samples = 20 /\n", "")
    group, key = path.split("%")
    written = solve(text + f"&{group} {key} = {value} /\n", tmp_path, name="written")
    by_set = solve(text, tmp_path, "--set", f"{path}={value}", name="set")
    by_sweep = solve(text + f"&sweep parameter = '{path}', values = {value} /\n", tmp_path, name="sweep")
    assert_same_bits(written, by_set)
    assert_same_bits(written, by_sweep)


def test_set_adds_a_group_with_texts(tmp_path):
    result = solve(WALL, tmp_path, "--set", "solver%method='broyden'", "--set", "output%dofs='v3','theta1'")
    with Results(result) as results:
        assert results.dofs == ["v3", "theta1"]
        assert "method = 'broyden'" in results.input_complete


def test_last_set_of_a_key_counts(tmp_path):
    twice = solve(WALL, tmp_path, "--set", "law(1)%gap=9.0", "--set", "LAW(wall)%GAP=1.0e-3", name="twice")
    once = solve(WALL, tmp_path, "--set", "law(1)%gap=1.0e-3", name="once")
    assert_same_bits(twice, once)


def test_energies_of_a_linear_oscillator_are_shown(tmp_path):
    """Mean kinetic energy m w**2 a**2/4, strain energy k a**2/4, loss factor d w/k, equivalent damping d/(2 m)."""
    text = """&structure type = 'matrices', n_dofs = 1, mass = 2.0, damping = 0.3, stiffness = 5.0 /
&tones frequency = 1.2 /
&harmonics order = 1 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1e-12 /
"""
    (tmp_path / "linear.nml").write_text(text)
    assert run("solve", "linear.nml", "-o", "linear.h5", cwd=tmp_path).status == 0
    amplitude = 1 / abs(5.0 - 2.0 * 1.2**2 + 0.3j * 1.2)
    with Results(tmp_path / "linear.h5") as results:
        line = next(line for line in info(results).splitlines() if line.startswith("energies"))
    expected = (2.0 * 1.2**2 * amplitude**2 / 4, 5.0 * amplitude**2 / 4, 0.3 * 1.2 / 5.0, 0.3 / 4.0)
    shown = [float(word) for word in line.replace(",", "").split() if word[0].isdigit() and word != "1/s"]
    np.testing.assert_allclose(shown, expected, rtol=1e-5)


def solve_masses_under_two_tones(folder: Path, n_masses: int, n_points: int) -> str:
    """The output of `solve` for a chain with one cubic spring, whose balances need very little time."""
    source = folder / "chain.nml"
    source.write_text(
        f"&structure type = 'chain', n_masses = {n_masses}, ends = 'free', mass = 1.0, coupling_stiffness = 1.0,\n"
        "   ground_stiffness = 1.0, damping_mass = 0.1 /\n&tones frequency = 2.0, 2.8284 /\n&harmonics order = 3 /\n"
        "&load dof = 'x1', tuple = 1, 0, cos = 0.25 /\n&load dof = 'x1', tuple = 0, 1, cos = 0.25 /\n"
        "&law type = 'cubic_spring', dof = 'x1', stiffness = 1.5 /\n"
        f"&sweep parameter = 'load(1)%cos', from = 0.1, to = 0.5, n = {n_points} /\n"
    )
    return run("solve", source, "-o", folder / "chain.h5", cwd=folder).stdout


def test_stability_of_a_short_run_is_found_without_being_asked_for(tmp_path):
    assert "6 stable, 0 unstable (see 'is_stable')" in solve_masses_under_two_tones(tmp_path, 3, 6)


def test_points_without_a_verdict_are_counted(tmp_path):
    """25 periods of 40 masses, which take six seconds, exceed what a run spends by default."""
    printed = solve_masses_under_two_tones(tmp_path, 40, 2)
    assert "0 stable, 0 unstable, 2 not known" in printed
    assert "the stability of 2 points was not computed, because it is costly; &stability method = 'integration'" in printed
