"""A bolted joint of a whole finite element model with many contacts, against the same joint reduced to its contacts beforehand."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from nhbm.command import main as nhbm_model

from program import read, solve

BAR = "--length 0.12 --width 0.03 --height 0.01 --n-x 9 --n-y 4 --n-z 1 --overwrite".split()

REST = """
&structure type = 'model', file = '{file}', damping_stiffness = 4.0e-6 /
&tones frequency = 6000.0 /
&harmonics order = 5 /
&load vector = 'bolt', tuple = 0, cos = 1000.0 /
&load dof = 'upper_shaker.x', tuple = 1, cos = {load} /
"""

SLIDERS = """
&law type = 'jenkins', label = 'joint', {places} stiffness = 1.0e7, friction_coefficient = 0.3
   {normal} normal_stiffness = 1.0e7, preload = 0.0 /
"""

WHOLE = SLIDERS.format(
    places="dofs = 'joint_1.x', 'joint_2.x', weights = 1.0, -1.0,",
    normal="normal_dofs = 'joint_1.z', 'joint_2.z', normal_weights = 1.0, -1.0,",
)
REDUCED = SLIDERS.format(places="dof = 'joint.x',", normal="normal_dofs = 'joint.z',")


@pytest.fixture(scope="module")
def joint(tmp_path_factory) -> Path:
    """A folder with the whole model parts.h5, 2,916 degrees of freedom with 63 pairs of nodes, and small.h5."""
    folder = tmp_path_factory.mktemp("joint")
    path = lambda name: str(folder / name)  # noqa: E731
    words = ["solid", *BAR, "--clamped", "left", "--node-set", "bolt=0.1,0.015,0", "--output", path("lower.h5")]
    assert nhbm_model(words) == 0
    words = ["solid", *BAR, "--clamped", "right", "--node-set", "bolt=0.02,0.015,0.01", "--node-set", "shaker=0,0.015,0.01"]
    assert nhbm_model([*words, "--output", path("upper.h5")]) == 0
    words = ["assemble", "lower=" + path("lower.h5"), "upper=" + path("upper.h5"), "--at", "upper=0.08,0,0.01"]
    words += ["--pair", "joint=lower_top,upper_bottom", "--partial", "--load", "bolt=lower_bolt.z:1,upper_bolt.z:-1"]
    assert nhbm_model([*words, "--output", path("parts.h5")]) == 0
    words = ["reduce", path("parts.h5"), "--keep", "joint.x,joint.z,upper_shaker.x", "--modes", "40", "--up-to", "60000"]
    assert nhbm_model([*words, "--no-error", "--output", path("small.h5")]) == 0
    return folder


def shaken(result: Path, other: Path) -> np.ndarray:
    """Motion of the degree of freedom that both results have, the shaken one: (points, harmonics, 2)."""
    with h5py.File(result) as file, h5py.File(other) as reference:
        labels = file["dof"][()].tolist()
        (common,) = set(labels) & set(reference["dof"][()].tolist())
        return file["coefficients"][:, labels.index(common)]


def test_whole_model_moves_as_the_reduced_one(joint):
    whole = solve(REST.format(file="parts.h5", load=1400.0) + WHOLE, joint, name="whole", status=None)
    small = solve(REST.format(file="small.h5", load=1400.0) + REDUCED, joint, name="reduced", status=None)
    assert read(whole, "status").tolist() == read(small, "status").tolist()
    expected = shaken(small, whole)
    assert np.abs(shaken(whole, small) - expected).max() < 1e-5 * np.abs(expected).max()
    power = read(small, "power_laws")
    assert power.max() > 0.0                                           # some pairs slip
    np.testing.assert_allclose(read(whole, "power_laws"), power, atol=1e-3 * power.max())
    names = "truncation_estimate", "aliasing_estimate"
    np.testing.assert_allclose(read(whole, *names), read(small, *names), rtol=0.3)
    assert read(whole, "is_stable")[0] == read(small, "is_stable")[0]


def test_points_of_a_sweep_are_those_of_their_own(joint):
    swept = "\n&sweep parameter = 'load(2)%cos', values = 700.0, 1400.0 /\n&solver first_guess = 'linear' /\n"
    # the second point has the factor of the first one
    sweep = solve(REST.format(file="parts.h5", load=1.0) + WHOLE + swept, joint, name="sweep", status=None)
    alone = solve(REST.format(file="parts.h5", load=1400.0) + WHOLE, joint, name="alone", status=None)
    np.testing.assert_array_equal(read(sweep, "coefficients")[-1], read(alone, "coefficients")[0])
