"""A bolted joint of a whole finite element model with many contacts, against the same joint reduced to its contacts beforehand."""

from __future__ import annotations

from pathlib import Path

import h5py
import nhbm
import numpy as np
import pytest
from nhbm.command import main as nhbm_model

from program import read, run, seconds_of_children, solve

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
    assemble_joint(folder, BAR)
    words = ["reduce", str(folder / "parts.h5"), "--keep", "joint.x,joint.y,joint.z,upper_shaker.x", "--modes", "40"]
    assert nhbm_model([*words, "--up-to", "60000", "--no-error", "--output", str(folder / "small.h5")]) == 0
    return folder


def assemble_joint(folder: Path, bar: list[str]) -> None:
    """Makes parts.h5, two bars that overlap."""
    path = lambda name: str(folder / name)  # noqa: E731
    words = ["solid", *bar, "--clamped", "left", "--node-set", "bolt=0.1,0.015,0", "--output", path("lower.h5")]
    assert nhbm_model(words) == 0
    words = ["solid", *bar, "--clamped", "right", "--node-set", "bolt=0.02,0.015,0.01", "--node-set", "shaker=0,0.015,0.01"]
    assert nhbm_model([*words, "--output", path("upper.h5")]) == 0
    words = ["assemble", "lower=" + path("lower.h5"), "upper=" + path("upper.h5"), "--at", "upper=0.08,0,0.01"]
    words += ["--pair", "joint=lower_top,upper_bottom", "--partial", "--load", "bolt=lower_bolt.z:1,upper_bolt.z:-1"]
    assert nhbm_model([*words, "--output", path("parts.h5")]) == 0


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


TWO_TONES = """
&structure type = 'model', file = '{file}', damping_stiffness = 4.0e-6 /
&tones frequency = 6000.0, 8485.281374 /
&harmonics order = 1 /
&load vector = 'bolt', tuple = 0, 0, cos = 1000.0 /
&load dof = 'upper_shaker.x', tuple = 1, 0, cos = 700.0 /
&load dof = 'upper_shaker.x', tuple = 0, 1, cos = 700.0 /
"""

PLANE = """
&law type = 'jenkins_2d', label = 'joint', {places} stiffness = 1.0e7, friction_coefficient = 0.3
   {normal} normal_stiffness = 1.0e7, preload = 0.0 /
"""

# an elastic stop that opens, and friction under a constant normal load
STOPS = """
&law type = 'elastic_stop', label = 'stop', {normal} stiffness = 1.0e7, gap = 0.0 /
&law type = 'jenkins', label = 'joint', {places} stiffness = 1.0e7, limit = 3.0 /
"""

PLACES = "dofs = 'joint_1.{0}', 'joint_2.{0}', weights = 1.0, -1.0,"
WHOLE_PLACES = {
    "jenkins_2d": (
        PLACES.format("x") + " second_dofs = 'joint_1.y', 'joint_2.y', second_weights = 1.0, -1.0,",
        "normal_dofs = 'joint_1.z', 'joint_2.z', normal_weights = 1.0, -1.0,",
    ),
    "stops": (PLACES.format("x"), "dofs = 'joint_1.z', 'joint_2.z', weights = -1.0, 1.0,"),
}
REDUCED_PLACES = {
    "jenkins_2d": ("dof = 'joint.x', second_dofs = 'joint.y',", "normal_dofs = 'joint.z',"),
    "stops": ("dof = 'joint.x',", "dofs = 'joint.z', weights = -1.0,"),
}


@pytest.mark.parametrize("name", ["jenkins_2d", "stops"])
def test_other_laws_of_a_whole_model(joint, name):
    law = {"jenkins_2d": PLANE, "stops": STOPS}[name]
    start = REST.replace("order = 5", "order = 3")
    texts = []
    for file, places in (("parts.h5", WHOLE_PLACES), ("small.h5", REDUCED_PLACES)):
        tangential, normal = places[name]
        texts.append(start.format(file=file, load=1400.0) + law.format(places=tangential, normal=normal))
    off = "\n&stability method = 'off' /\n"
    whole = solve(texts[0], joint, name=f"whole_{name}", status=None)
    small = solve(texts[1] + off, joint, name=f"reduced_{name}", status=None)
    assert read(whole, "status").tolist() == read(small, "status").tolist()
    expected = shaken(small, whole)
    assert np.abs(shaken(whole, small) - expected).max() < 1e-5 * np.abs(expected).max()


def test_two_tones_on_a_whole_model(joint):
    whole = solve(TWO_TONES.format(file="parts.h5") + WHOLE, joint, name="whole_two", status=None)
    text = TWO_TONES.format(file="small.h5") + REDUCED + "\n&stability method = 'off' /\n"
    small = solve(text, joint, name="small_two", status=None)
    assert read(whole, "status").tolist() == read(small, "status").tolist()
    expected = shaken(small, whole)
    assert np.abs(shaken(whole, small) - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("method", ["auto", "integration"])
def test_missing_stability_of_a_whole_model_is_explained(joint, method):
    text = REST.format(file="parts.h5", load=700.0) + WHOLE + f"&stability method = '{method}' /\n"
    (joint / "verdict.nml").write_text(text)
    found = run("solve", "verdict.nml", "--overwrite", cwd=joint)
    assert "nhbm-model reduce" in found.stdout + found.stderr


def test_error_estimate_in_many_harmonics(joint):
    text = REST.replace("order = 5", "order = 15").format(file="parts.h5", load=1400.0) + WHOLE
    result = solve(text, joint, name="many_harmonics", status=None)
    assert np.isfinite(read(result, "truncation_estimate")).all()
    coarse = solve(REST.format(file="parts.h5", load=1400.0) + WHOLE, joint, name="few_harmonics", status=None)
    assert read(result, "truncation_estimate")[0] < 0.5 * read(coarse, "truncation_estimate")[0]


SMALL_BAR = "--length 0.12 --width 0.03 --height 0.01 --n-x 6 --n-y 2 --n-z 1 --overwrite".split()


def test_verification_of_a_whole_model(tmp_path):
    """A joint of 25 pairs, 1,080 degrees of freedom, in steps with its sparse matrices."""
    assemble_joint(tmp_path, SMALL_BAR)
    text = REST.replace("order = 5", "order = 3").format(file="parts.h5", load=1400.0) + WHOLE
    result = solve(text + "\n&stability method = 'off' /\n", tmp_path, name="verified", status=None)
    found = run("verify", result, "--periods", "2", cwd=tmp_path)
    assert read(result, "integration_verdict").tolist() == [1], found.stdout + found.stderr
    assert read(result, "integration_difference")[0] < 1e-3


def test_verification_that_would_not_end_is_rejected(joint):
    text = quick(700.0)
    result = solve(text, joint, name="not_verified", status=None)
    begun = seconds_of_children()
    found = run("verify", result, "--periods", "10000", cwd=joint)
    assert seconds_of_children() - begun < 5.0
    assert found.status != 0
    assert "nhbm-model reduce" in found.stderr
    (joint / "session.nml").write_text(text)
    model = nhbm.Model.from_file(joint / "session.nml")
    motion = model.solve()
    with pytest.raises(nhbm.ModelError, match="nhbm-model reduce"):
        model.verify(motion, periods=10000)


@pytest.mark.long
def test_frequencies_beyond_the_modes_are_condensed(joint):
    text = REST.replace("order = 5", "order = 3").replace("6000.0", "1.5e5").format(file="parts.h5", load=1400.0) + WHOLE
    result = solve(text, joint, name="high", status=None)
    assert np.isfinite(read(result, "truncation_estimate")).all()


def test_time_limit_of_a_whole_model(joint):
    text = REST.format(file="parts.h5", load=5600.0) + WHOLE + "\n&solver time_limit = 0.5 /\n"
    begun = seconds_of_children()
    result = solve(text, joint, name="limited", status=None)
    assert seconds_of_children() - begun < 5.0
    assert "time_limit" in run("why", result, cwd=joint).stdout


def test_ranks_have_the_points_of_one_process(joint):
    swept = "\n&sweep parameter = 'load(2)%cos', values = 700.0, 1000.0, 1400.0 /\n&error_estimate is_on = .false. /\n"
    swept += "&solver first_guess = 'linear' /\n"
    text = REST.replace("order = 5", "order = 3").format(file="parts.h5", load=1.0) + WHOLE + swept
    alone = solve(text, joint, name="one_rank", status=None)
    shared = solve(text, joint, name="two_ranks", status=None, ranks=2)
    np.testing.assert_array_equal(read(shared, "coefficients"), read(alone, "coefficients"))


QUICK = "\n&solver first_guess = 'linear' /\n&error_estimate is_on = .false. /\n&stability method = 'off' /\n"


def quick(load: float, frequency: float = 6000.0) -> str:
    """The whole joint at order 3, without what follows from a motion."""
    text = REST.replace("order = 5", "order = 3").replace("6000.0", str(frequency))
    return text.format(file="parts.h5", load=load) + WHOLE + QUICK


@pytest.mark.parametrize(
    "path, ends, values",
    [("tones(1)%frequency", (5900.0, 6100.0), (5950.0, 6080.0)), ("load(2)%cos", (1300.0, 1500.0), (1340.0, 1470.0))],
)
def test_curve_of_a_whole_model_has_the_motions_of_points(joint, path, ends, values):
    numbers = ", ".join(map(str, values))
    request = f"&curve parameter = '{path}', from = {ends[0]}, to = {ends[1]}, values = {numbers} /\n"
    curve = solve(quick(1400.0) + request, joint, name="curve_of_whole", status=None)
    swept = f"&sweep parameter = '{path}', values = {numbers} /\n"
    points = solve(quick(1400.0) + swept, joint, name="points_of_whole", status=None)
    with h5py.File(curve) as file:
        names = file["curve_kind"].attrs["flag_meanings"].split()
        kinds = [names[i] for i in file["curve_kind"][()]]
    located = [i for i, kind in enumerate(kinds) if kind == "value"]
    assert len(located) == len(values)
    expected = read(points, "coefficients")
    assert np.abs(read(curve, "coefficients")[located] - expected).max() < 1e-7 * np.abs(expected).max()
    assert "end" in kinds


def test_curve_of_a_whole_model_resumes_to_the_same_bits(joint):
    request = "&curve parameter = 'tones(1)%frequency', from = 5900.0, to = 6100.0, points = {} /\n"
    whole = solve(quick(1400.0) + request.format(30), joint, name="curve_at_once", status=None)
    solve(quick(1400.0) + request.format(3), joint, name="curve_in_parts", status=None)
    run("resume", "curve_in_parts.h5", "--set", "curve%points=30", cwd=joint)
    np.testing.assert_array_equal(read(joint / "curve_in_parts.h5", "coefficients"), read(whole, "coefficients"))


def test_points_at_other_frequencies_are_those_of_their_own(joint):
    swept = "&sweep parameter = 'tones(1)%frequency', values = 5000.0, 7600.0, 5100.0 /\n"
    sweep = solve(quick(1400.0) + swept, joint, name="frequencies", status=None)
    alone = solve(quick(1400.0, 5100.0), joint, name="one_frequency", status=None)
    np.testing.assert_array_equal(read(sweep, "coefficients")[-1], read(alone, "coefficients")[0])


def test_walls_of_a_whole_model_are_solved_with_advice(joint):
    wall = "&law type = 'rigid_wall', label = 'wall', dofs = 'joint_1.z', 'joint_2.z', weights = -1.0, 1.0, gap = 0.0 /\n"
    text = REST.format(file="parts.h5", load=1400.0) + WHOLE + wall       # so many coordinates would be factorised without the wall
    (joint / "wall.nml").write_text(text)
    found = run("check", "wall.nml", cwd=joint)
    assert "nhbm-model reduce" in found.stdout + found.stderr
