"""`nhbm bench`: it runs on the inputs of inputs/bench, and its numbers are positive and in order. No time is judged here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray

from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, run

FOLDER = Path(__file__).resolve().parents[2] / "inputs" / "bench"
KERNELS = ("residual", "tangent", "newton_step", "solution", "point")


def bench(source: Path, folder: Path, *options, status=ALL_CONVERGED) -> xarray.Dataset:
    result = folder / "times.h5"
    done = run("bench", source, "-o", result, "--quiet", "--budget", "0.01", *options, cwd=folder)
    assert done.status == status, done.stderr
    assert done.stdout == ""
    with xarray.open_dataset(result) as data:
        return data.load()


@pytest.mark.parametrize("name", ["duffing", "jenkins"])
def test_times_are_positive_and_in_order(name, tmp_path):
    data = bench(FOLDER / f"{name}.nml", tmp_path)
    assert data.attrs["kind"] == "bench" and data.attrs["threads"]
    assert (data.memory_bandwidth.values > 0.0).all()
    for kernel in KERNELS:
        columns = {
            end: data[f"{kernel}_{end}"].values
            for end in ("seconds", "seconds_first", "seconds_min", "seconds_max", "yardstick", "ratio", "ratio_low", "ratio_high")
        }
        for column in columns.values():
            assert (column > 0.0).all(), kernel
        assert (columns["seconds_min"] <= columns["seconds"]).all()
        assert (columns["seconds"] <= columns["seconds_max"]).all()
        assert (columns["ratio_low"] <= columns["ratio"]).all()
        assert (columns["ratio"] <= columns["ratio_high"]).all()
    # Each contains the one before it.
    for part, whole in (
        ("residual", "newton_step"),
        ("tangent", "newton_step"),
        ("newton_step", "solution"),
        ("solution", "point"),
    ):
        assert (data[f"{part}_seconds_min"].values < data[f"{whole}_seconds_max"].values).all(), (part, whole)


def test_rows_say_what_was_timed(tmp_path):
    data = bench(FOLDER / "duffing.nml", tmp_path)
    np.testing.assert_array_equal(data.parameter_tones_frequency.values, [2.0, 0.9])
    assert data.parameter_tones_frequency.attrs["parameter"] == "tones%frequency"
    assert data.n_unknowns.values.tolist() == [8, 8], "an odd motion: harmonics 1, 3, 5, 7"
    assert data.n_samples.values.tolist() == [64, 64]
    assert data.n_harmonics.values.tolist() == [4, 4]
    assert data.n_tones.values.tolist() == [1, 1]
    assert (data.residual_norm.values < 1e-12).all() and (data.evaluations.values > data.iterations.values).all()
    assert str(data.input_text.values) == (FOLDER / "duffing.nml").read_text()


def test_unsolved_points_are_told_by_the_exit_status(tmp_path):
    options = ("--set", "solver%max_iterations=1", "--set", "solver%rescue=.false.")
    data = bench(FOLDER / "duffing.nml", tmp_path, *options, status=NOT_ALL_CONVERGED)
    assert (data.status.values == 3).all()


def test_refusals(tmp_path):
    autonomous = next(iter(sorted((FOLDER.parent / "autonomous").glob("van_der_pol*.nml"))))
    source = FOLDER / "duffing.nml"
    (tmp_path / "there.h5").write_text("precious")
    for words, message in (
        ((autonomous,), "given base frequencies"),
        ((source, "--budget", "soon"), "--budget needs seconds"),
        ((source, "--budget", "-1"), "--budget needs seconds"),
        ((source, "-o", "there.h5"), "--overwrite"),
    ):
        done = run("bench", *words, cwd=tmp_path)
        assert done.status == BAD_INPUT and message in done.stderr, done.stderr
    assert (tmp_path / "there.h5").read_text() == "precious"
    assert [file.name for file in tmp_path.iterdir()] == ["there.h5"]


def test_ranks_are_refused(tmp_path):
    done = run("bench", FOLDER / "duffing.nml", cwd=tmp_path, ranks=2)
    assert done.status == BAD_INPUT and "without mpirun" in done.stderr


def test_help_tells_the_two_verbs_apart(tmp_path):
    text = run("--help", cwd=tmp_path).stdout
    assert "nhbm bench INPUT" in text and "nhbm benchmark INPUT" in text
