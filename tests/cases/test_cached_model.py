"""Points of a sweep read only the values that change between them: each must equal a separate point."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from program import BAD_INPUT, run

MODEL = """
&structure type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 0.7 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 0.5, frequency_power = 2 /
&load dof = 'x2', tuple = 1, sin = 0.2 /
&start dof = 'x1', tuple = 1, cos = 0.0 /
&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 1.0 /
&law type = 'elastic_stop', label = 'stop', dof = 'x2', stiffness = 2.0, gap = 0.1 /
&error_estimate truncation = 0.1 /   ! order 3 for the speed: only what is read is in question
"""
NUMBERS = ("status", "coefficients", "force_coefficients", "frequency", "iterations", "residual", "truncation_estimate")
# parameter and values; the last axis runs fastest
SWEEPS = {
    "loads that grow with the frequency": [("tones%frequency", [0.5, 0.9, 0.5])],
    "a law by its label": [("law(stop)%gap", [0.1, 0.3, 0.2]), ("law(1)%stiffness", [0.5, 2.0])],
    "loads and start": [("load(2)%sin", [0.1, 0.4]), ("start(1)%cos", [0.0, 0.01])],
    "structure outside, law inside": [("structure%mass", [1.0, 1.5]), ("law(2)%stiffness", [1.0, 3.0])],
    "law outside, order inside": [("law(2)%stiffness", [1.0, 3.0]), ("harmonics%order", [2, 3])],
    "a wrong value between": [("law(2)%stiffness", [1.0, -1.0, 2.0])],
    "tones outside, two laws side by side": [("tones%frequency", [0.6, 0.8]), ("law(1)%stiffness", [1.0, 2.0])],
}


@pytest.mark.parametrize("name", SWEEPS)
def test_points_are_what_they_are_by_themselves(name, tmp_path):
    axes = SWEEPS[name]
    groups = "".join(f"&sweep parameter = '{path}', values = {', '.join(map(str, v))} /\n" for path, v in axes)
    together = _solve(MODEL + groups, tmp_path)
    points = [[]]
    for path, values in axes:
        points = [[*before, (path, value)] for before in points for value in values]
    with h5py.File(together) as file:
        tuples = [tuple(j) for j in file["tuple"][()].tolist()]
        assert len(file["status"]) == len(points)
        for k, point in enumerate(points):
            options = [word for path, value in point for word in ("--set", f"{path}={value}")]
            alone = _solve(MODEL, tmp_path, *options)
            if alone is None:
                assert file["status"][k] == 6 and np.isnan(file["coefficients"][k]).all()
                continue
            with h5py.File(alone) as other:
                places = [tuples.index(tuple(j)) for j in other["tuple"][()].tolist()]
                for dataset in NUMBERS:
                    found, expected = file[dataset][k], other[dataset][0]
                    if "coefficients" in dataset:
                        found = found[:, places]
                    np.testing.assert_array_equal(found, expected, err_msg=f"{point}: {dataset}")


def test_a_group_that_the_input_does_not_have(tmp_path):
    """The first guess of a sweep, &start, depends on its values only; the last point has no guess of its own."""
    model = MODEL.replace("&start dof = 'x1', tuple = 1, cos = 0.0 /\n", "")
    sweep = "&sweep parameter = 'start%cos', values = 0.0, 0.01 /\n"
    options = ("--set", "start%dof='x1'", "--set", "start%tuple=1")
    with h5py.File(_solve(model + sweep, tmp_path, *options)) as file:
        assert (file["status"][()] == 1).all()


def test_a_sweep_by_overrides_alone(tmp_path):
    options = ("--set", "sweep%parameter='law(2)%gap'", "--set", "sweep%values=0.1, 0.2")
    with h5py.File(_solve(MODEL, tmp_path, *options)) as file:
        assert (file["status"][()] == 1).all()


def _solve(text, folder, *options):
    """The result file; None if the input is rejected."""
    source = folder / "case.nml"
    source.write_text(text)
    result = folder / ("alone.h5" if options else "together.h5")
    done = run("solve", source, "-o", result, "--overwrite", "--quiet", *options, cwd=folder)
    return None if done.status == BAD_INPUT else result
