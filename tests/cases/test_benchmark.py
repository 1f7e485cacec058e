"""`nhbm benchmark`: the measured error against numpy, the references that it takes, the table that it writes.

The inputs of inputs/benchmark/ promise numbers in lines `! expect: [COLUMN=VALUE ...] COLUMN < NUMBER`, or
`COLUMN = NUMBER to TOLERANCE` (relative), about the rungs whose columns have these values; the reference itself is left
out.
"""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray

from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, run, solve

INPUTS = sorted((Path(__file__).resolve().parents[2] / "inputs" / "benchmark").glob("*.nml"))

# One mass on a cubic spring, two tones.
SCENE = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,
   ground_stiffness = 1.0, damping_mass = 0.2 /
&tones frequency = 0.6, 0.9707963267948966 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, 0, cos = 0.2 /
&load dof = 'x1', tuple = 0, 1, cos = 0.2 /
&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /
"""
ROUNDING = 1e-12

LINE = re.compile(
    r"! expect: (?P<where>(?:\w+=\S+ )*)(?P<column>\w+) (?:< (?P<bound>\S+)|= (?P<number>\S+) to (?P<tolerance>\S+))"
)


def one_group_a_line(text: str) -> str:
    return text.replace(" / &", " /\n&").replace(" /&", " /\n&")


def benchmark(text: str, folder: Path, *options, status=ALL_CONVERGED, name="case") -> xarray.Dataset:
    source = folder / f"{name}.nml"
    source.write_text(one_group_a_line(text))
    result = folder / f"{name}.h5"
    done = run("benchmark", source, "-o", result, "--overwrite", "--quiet", *options, cwd=folder)
    assert done.status == status, done.stderr
    with xarray.open_dataset(result) as data:
        return data.load()


def refused(text: str, folder: Path, *options) -> str:
    source = folder / "bad.nml"
    source.write_text(one_group_a_line(text))
    done = run("benchmark", source, *options, cwd=folder)
    assert done.status == BAD_INPUT, done.stderr
    assert not list(folder.glob("bad.h5*"))
    return done.stderr


def weights(tuples) -> np.ndarray:
    """Mean squares of cosines over hypertime, with room for cosine and sine."""
    return np.where(np.any(tuples != 0, axis=1), 0.5, 1.0)[:, None]


def error_of(data: xarray.Dataset, rung: int) -> float:
    found = np.nan_to_num(data.coefficients.values[rung])
    reference = np.nan_to_num(data.reference_coefficients.values)
    w = weights(data.tuple.values)
    return float(np.sqrt((w * (found - reference) ** 2).sum() / (w * reference**2).sum()))


def test_error_is_the_relative_rms_over_hypertime(tmp_path):
    data = benchmark(SCENE + "&benchmark orders = 2, 3, 5, repeats = 1, reference_order = 9 /", tmp_path)
    assert data.order.values.tolist() == [2, 3, 5]
    for rung in range(3):
        assert data.error.values[rung] == pytest.approx(error_of(data, rung), rel=ROUNDING)
        difference = np.nan_to_num(data.coefficients.values[rung]) - np.nan_to_num(data.reference_coefficients.values)
        assert data.largest_error.values[rung] == pytest.approx(np.abs(difference).max(), rel=ROUNDING)
    assert (np.diff(data.error.values) < 0.0).all()
    assert not data.is_reference.values.any()


def test_motion_is_that_of_solve(tmp_path):
    data = benchmark(SCENE + "&benchmark orders = 3, repeats = 2 /", tmp_path)
    result = solve(SCENE, tmp_path, name="solved")
    with h5py.File(result) as file:
        by_tuple = dict(zip(map(tuple, file["tuple"][()].tolist()), file["coefficients"][0, 0].tolist()))
        for name in ("iterations", "evaluations", "residual", "n_harmonics", "truncation_estimate", "status"):
            assert data[name].values[0] == file[name][0], name
    for j, pair in zip(data.tuple.values.tolist(), data.coefficients.values[0, 0].tolist()):
        assert pair == by_tuple[tuple(j)]


def test_finest_rung_is_the_reference(tmp_path):
    data = benchmark(SCENE + "&benchmark orders = 5, 2, 3, repeats = 1 /", tmp_path)
    assert data.is_reference.values.tolist() == [1, 0, 0]
    assert data.error.values[0] == 0.0
    assert (data.error.values[1:] > 0.0).all()


def test_every_combination_is_a_rung(tmp_path):
    data = benchmark(
        SCENE
        + "&benchmark orders = 2, 3, methods = 'newton', 'broyden', samples = 16, 32, repeats = 1 /"
        + "&sweep parameter = 'solver%first_guess', texts = 'linear', 'zero' /",
        tmp_path,
    )
    assert data.sizes["rung"] == 16
    rows = set(zip(data.order.values, data.method.values, data.samples.values[:, 0], data.formulation.values))
    assert len(rows) == 16
    assert set(data.parameter_solver_first_guess.values) == {"linear", "zero"}
    assert data.parameter_solver_first_guess.attrs["parameter"] == "solver%first_guess"


def test_listed_reference_counts_its_tuples_alone(tmp_path):
    text = SCENE + "&reference dof = 'x1', tuple = -1, 0, cos = 0.5, sin = -0.1 /"
    text += "&reference dof = 'x1', tuple = 0, 1, cos = -0.3, sin = 0.2 / &benchmark repeats = 1 /"
    data = benchmark(text, tmp_path)
    found = dict(zip(map(tuple, data.tuple.values.tolist()), data.coefficients.values[0, 0]))
    difference = np.array([found[1, 0] - [0.5, 0.1], found[0, 1] - [-0.3, 0.2]])
    expected = np.sqrt((difference**2).sum() / (0.5**2 + 0.1**2 + 0.3**2 + 0.2**2))
    assert data.error.values[0] == pytest.approx(expected, rel=ROUNDING)
    everything = benchmark(text.replace("repeats", "compare = 'union', repeats"), tmp_path, name="union")
    assert everything.error.values[0] == pytest.approx(error_of(everything, 0), rel=ROUNDING)
    assert everything.error.values[0] > data.error.values[0]


def test_reference_from_a_result_file(tmp_path):
    solve(SCENE + "&sweep parameter = 'harmonics%order', values = 2, 9 /", tmp_path, name="fine")
    options = "reference_file = 'fine.h5', reference_point = 1 /"
    data = benchmark(SCENE + "&benchmark orders = 2, 3, repeats = 1, " + options, tmp_path)
    beside = benchmark(SCENE + "&benchmark orders = 2, 3, repeats = 1, reference_order = 9 /", tmp_path, name="beside")
    np.testing.assert_allclose(data.error.values, beside.error.values, rtol=1e-9)


def test_reference_without_points_or_frequencies(tmp_path):
    """A record of a march: coefficients (dof, harmonic, component), a list of tuples, nothing of a harmonic balance."""
    with h5py.File(tmp_path / "march.h5", "w") as file:
        file["tuple"] = np.array([[0, 1], [1, 0]], dtype=np.int32)
        file["dof"] = np.array(["other", "x1"], dtype=h5py.string_dtype())
        file["coefficients"] = np.array([[[9.0, 9.0], [9.0, 9.0]], [[-0.3, 0.2], [0.5, 0.1]]])
    data = benchmark(
        SCENE + "&benchmark repeats = 1, reference_file = 'march.h5', compare = 'reference' /", tmp_path
    )
    found = dict(zip(map(tuple, data.tuple.values.tolist()), data.coefficients.values[0, 0]))
    difference = np.array([found[1, 0] - [0.5, 0.1], found[0, 1] - [-0.3, 0.2]])
    assert data.largest_error.values[0] == pytest.approx(np.abs(difference).max(), rel=ROUNDING)


def test_times_add_up_and_lie_between_their_ends(tmp_path):
    data = benchmark(SCENE + "&benchmark orders = 3, 7, repeats = 5 /", tmp_path)
    for part in ("setup", "solver", "recovery", "certificate", "total", "cpu"):
        least, middle, most = (data[f"{part}_seconds{end}"].values for end in ("_min", "", "_max"))
        assert (least >= 0.0).all() and (least <= middle).all() and (middle <= most).all()
    assert (data.solver_seconds.values > 0.0).all() and (data.setup_seconds.values > 0.0).all()
    repeats = data.total_seconds_of_repeat.values
    assert repeats.shape == (2, 5)
    # One thread: no processor time without wall time, but for the tick of its clock.
    assert (data.cpu_seconds_min.values <= data.total_seconds_max.values + 0.01).all()
    np.testing.assert_array_equal(np.median(repeats, axis=1), data.total_seconds.values)
    parts = data.setup_seconds_min + data.solver_seconds_min + data.recovery_seconds_min
    assert (parts.values <= data.total_seconds_min.values * (1.0 + ROUNDING)).all()


def test_memory_grows_with_the_tangent(tmp_path):
    """Newton's dense tangent of 61 MB at order 26 (2809 unknowns) must show; at order 3 there is next to nothing."""
    data = benchmark(
        SCENE
        + "&solver method = 'newton' / &benchmark orders = 3, 26, samples = 54, repeats = 1 / &certificate is_on = .false. /",
        tmp_path,
        "--set",
        "harmonics%symmetry='none'",
    )
    if np.isnan(data.memory_peak.values).any():
        pytest.skip("this system does not tell the peak of the memory")
    small, large = data.memory_peak.values
    assert large >= 8 * 2809**2
    assert large <= 4 * 8 * 2809**2
    assert small < 0.2 * large


def test_improved_motion_is_nearer(tmp_path):
    data = benchmark(
        SCENE + "&certificate improvement_steps = 12 / &benchmark orders = 3, repeats = 1, reference_order = 11 /", tmp_path
    )
    assert data.improved_error.values[0] < 0.01 * data.error.values[0]
    plain = benchmark(SCENE + "&benchmark orders = 3, repeats = 1, reference_order = 11 /", tmp_path, name="plain")
    assert np.isnan(plain.improved_error.values[0])


def test_improved_motion_of_solve_is_on_the_wider_set(tmp_path):
    result = solve(SCENE + "&certificate improvement_steps = 12 /", tmp_path)
    with h5py.File(result) as file:
        tuples, plain, improved = (file[name][()] for name in ("tuple", "coefficients", "improved_coefficients"))
    is_inside = np.abs(tuples).max(axis=1) <= 3
    assert np.abs(tuples).max() == 6
    assert np.isnan(plain[0, 0, ~is_inside]).all() and np.isfinite(plain[0, 0, is_inside]).all()
    assert np.isfinite(improved).all()
    wide = solve(SCENE.replace("order = 3", "order = 6"), tmp_path, name="wide")
    with h5py.File(wide) as file:
        known = dict(zip(map(tuple, file["tuple"][()].tolist()), file["coefficients"][0, 0]))
    expected = np.array([known[tuple(j)] for j in tuples.tolist()])
    assert np.abs(improved[0, 0] - expected).max() < 0.01 * np.abs(plain[0, 0, is_inside] - expected[is_inside]).max()


def test_a_rung_that_fails_is_told_and_the_others_go_on(tmp_path):
    data = benchmark(
        SCENE
        + "&solver rescue = .false. / &benchmark repeats = 2 /"
        + "&sweep parameter = 'solver%max_iterations', values = 1, 100 /",
        tmp_path,
        status=NOT_ALL_CONVERGED,
    )
    assert data.status.values.tolist() == [3, 1]
    assert data.is_reference.values.tolist() == [0, 1]
    assert data.status.attrs["flag_meanings"].split()[3] == "out_of_budget"


def test_bad_input_says_what_would_be_right(tmp_path):
    for text, words in (
        (SCENE, "missing group &benchmark"),
        (SCENE + "&benchmark order = 3 /", "did you mean 'orders'"),
        (SCENE + "&benchmark methods = 'newtn' /", "newton"),
        (SCENE + "&benchmark orders = 3, samples = 5 /", "needs at least 7"),
        (SCENE + "&benchmark samples = 16, oversampling = 2.0 /", "give either 'samples' or 'oversampling'"),
        (SCENE + "&benchmark dofs = 'x7' /", "x7"),
        (SCENE + "&benchmark reference_file = 'nowhere.h5' /", "no such file"),
        (SCENE + "&benchmark reference_samples = 5 /", "reference_order"),
        (SCENE + "&benchmark / &reference dof = 'x2', tuple = 1, 0, cos = 1.0 /", "observed: x1"),
        (
            SCENE
            + "&benchmark / &reference dof = 'x1', tuple = 1, 0, cos = 1.0 /"
            + "&reference dof = 'x1', tuple = -1, 0, cos = 1.0 /",
            "given twice",
        ),
        (SCENE + "&benchmark / &sweep parameter = 'law(springs)%stiffness', values = 1.0 /", "spring"),
    ):
        assert words in refused(text, tmp_path), text


def test_reference_of_another_scene_is_refused(tmp_path):
    solve(SCENE.replace("0.6,", "0.7,"), tmp_path, name="other")
    assert "other base frequencies" in refused(SCENE + "&benchmark reference_file = 'other.h5' /", tmp_path)
    solve(SCENE + "&sweep parameter = 'harmonics%order', values = 2, 3 /", tmp_path, name="two")
    assert "has 2 points" in refused(SCENE + "&benchmark reference_file = 'two.h5' /", tmp_path)


def test_ranks_are_refused(tmp_path):
    (tmp_path / "case.nml").write_text(SCENE + "&benchmark /")
    done = run("benchmark", "case.nml", cwd=tmp_path, ranks=2)
    assert done.status == BAD_INPUT
    assert "without mpirun" in done.stderr


def test_existing_file_is_kept(tmp_path):
    (tmp_path / "case.nml").write_text(SCENE + "&benchmark /")
    (tmp_path / "case.h5").write_text("precious")
    done = run("benchmark", "case.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and "--overwrite" in done.stderr
    assert (tmp_path / "case.h5").read_text() == "precious"


def test_solve_points_to_the_other_verb(tmp_path):
    (tmp_path / "case.nml").write_text(SCENE + "&benchmark /")
    done = run("solve", "case.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and "nhbm benchmark" in done.stderr


def test_there_are_inputs():
    assert INPUTS


@pytest.mark.parametrize("source", INPUTS, ids=lambda file: file.stem)
def test_input_gives_what_it_promises(source, tmp_path):
    lines = [line for line in source.read_text().splitlines() if "! expect" in line]
    assert lines, f"{source} has no '! expect:' line"
    result = tmp_path / "result.h5"
    done = run("benchmark", source, "-o", result, "--quiet", "--set", "benchmark%repeats=1", cwd=tmp_path)
    assert done.status in (ALL_CONVERGED, NOT_ALL_CONVERGED), done.stderr
    with xarray.open_dataset(result) as data:
        assert np.isin(data.status.values, (1, 7, 8, 9)).all(), data.status.values
        for line in lines:
            match = LINE.fullmatch(line)
            assert match, f"not a known form: {line}"
            chosen = data.is_reference.values == 0
            for word in match["where"].split():
                name, value = word.split("=")
                chosen &= data[name].values.astype(str) == value
            values = data[match["column"]].values[chosen]
            assert values.size, f"no rung fits: {line}"
            if match["bound"]:
                assert (values < float(match["bound"])).all(), f"{line}: {values}"
            else:
                np.testing.assert_allclose(values, float(match["number"]), rtol=float(match["tolerance"]), err_msg=line)
