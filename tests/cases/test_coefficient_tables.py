"""Coefficients of bearings over speed and frequency, against closed forms and the equations behind the tables."""

import warnings

import numpy as np
import pytest

from in_process import nhbm
from program import run

SPEEDS = np.array([0.5, 1.0, 2.0, 4.0])
MASS = np.diag([1.0, 1.3])


def of(frequency, speed):
    """Coefficients of the journal, k = k0 + a w^2 + b W in each direction: xx, xy, yx, yy, and likewise damping."""
    stiffness = np.array([5.0, 0.3, -0.4, 6.0]) + np.multiply.outer(frequency**2, [0.2, 0.05, -0.03, 0.1])
    damping = np.array([0.3, 0.02, 0.0, 0.4]) + np.multiply.outer(frequency, [0.02, 0.0, 0.01, 0.03])
    return stiffness + speed * np.array([0.5, 0.1, -0.2, 0.3]), damping + speed * np.array([0.04, 0, 0, 0.05])


def tables(frequencies):
    stiffness, damping = (np.array(rows) for rows in zip(*(of(frequencies, speed) for speed in SPEEDS)))
    return {"speeds": SPEEDS, "frequencies": frequencies, "stiffness": stiffness, "damping": damping}


def journal(speed, frequencies, law=True, **keys):
    model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=np.zeros((2, 2)), stiffness=np.zeros((2, 2)), labels=["x", "y"]),
                       tones=[speed], **keys)  # fmt: skip
    model.bearing(["x", "y"], speed=speed, **tables(frequencies))
    model.load("x", 1, cos=1.0)
    model.load("y", 1, sin=0.5)
    if law:
        model.law("cubic_spring", "x", stiffness=0.0)
    return model


def motion_of(w, speed, load):
    """Amplitudes a - i b by the closed form."""
    stiffness, damping = (values.reshape(2, 2) for values in of(np.float64(w), speed))
    return np.linalg.solve(stiffness + 1j * w * damping - w**2 * MASS, load)


def amplitudes(motion, tuple_):
    """Those of a solved motion."""
    at = (motion["tuple"].values == np.atleast_1d(tuple_)).all(axis=1)
    return (motion["coefficients"].values[:, at] @ [1, -1j])[:, 0]


@pytest.mark.parametrize("law", [True, False])
def test_motions_at_the_speed_and_half_of_it_are_those_of_the_closed_form(law):
    """Synchronous whirl at W, and whirl at W/2 that a second tone of half the speed excites."""
    speed = 1.5
    model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=np.zeros((2, 2)), stiffness=np.zeros((2, 2)), labels=["x", "y"]),
                       tones={"frequency": [speed], "subharmonic": 2})  # fmt: skip
    model.bearing(["x", "y"], speed=speed, **tables(np.array([0.0, 0.75, 1.5, 3.0])))
    model.load("x", 2, cos=1.0)
    model.load("y", 2, sin=0.5)
    model.load("x", 1, cos=0.3)
    if law:
        model.law("cubic_spring", "x", stiffness=0.0)
    motion = model.solve(order=3)
    np.testing.assert_allclose(amplitudes(motion, 2), motion_of(1.5, speed, [1, -0.5j]), rtol=1e-12)
    np.testing.assert_allclose(amplitudes(motion, 1), motion_of(0.75, speed, [0.3, 0]), rtol=1e-12)
    assert motion["stability"] == "stable" and motion.nhbm.details["is_beyond_tables"] == 0


def test_two_tones_have_their_own_coefficients():
    model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=np.zeros((2, 2)), stiffness=np.zeros((2, 2)), labels=["x", "y"]),
                       tones=[1.5, 1.1])  # fmt: skip
    model.bearing(["x", "y"], speed=1.5, **tables(np.array([0.0, 1.1, 1.5, 3.0])))
    model.load("x", (1, 0), cos=1.0)
    model.load("y", (0, 1), sin=0.5)
    model.law("cubic_spring", "x", stiffness=0.0)
    motion = model.solve(order=1)
    np.testing.assert_allclose(amplitudes(motion, (1, 0)), motion_of(1.5, 1.5, [1, 0]), rtol=1e-12)
    np.testing.assert_allclose(amplitudes(motion, (0, 1)), motion_of(1.1, 1.5, [0, -0.5j]), rtol=1e-12)


def test_sweeps_and_curves_follow_the_closed_form():
    """Fine tables: the error of cubics between the nodes."""
    model = journal(1.5, np.linspace(0.0, 4.0, 161))
    model.tie("bearing(1)%speed", "tones[0]")
    for found in (model.sweep({"tones[0]": [0.8, 1.7, 3.3]}, order=1), model.curve("tones[0]", 0.8, 3.0, order=1)):
        got = np.array([found.nhbm.amplitude(dof, 1).values for dof in "xy"])
        exact = np.transpose([motion_of(w, w, [1, -0.5j]) for w in found["frequency"].values.ravel()])
        np.testing.assert_allclose(got, abs(exact), rtol=2e-5)
        assert (found["stability"] == "stable").all()


def test_derivatives_count_frequency_and_speed():
    model = journal(1.5, np.array([0.0, 0.7, 1.5, 3.0]))
    model.tie("bearing(1)%speed", "tones[0]")
    found = model.gradient("x (1)", ["tones[0]", "bearing(1)%stiffness(7,2)"], order=1)
    sides = {}
    for path, at, step in (("tones[0]", 1.5, 1e-5), ("bearing(1)%stiffness(7,2)", float(tables(np.array([0.0, 0.7, 1.5, 3.0]))
                            ["stiffness"].reshape(-1, 4)[6, 1]), 1e-4)):  # fmt: skip
        values = model.sweep({path: [at - step, at + step]}, order=1).nhbm.amplitude("x", 1).values
        sides[path] = (abs(values[1]) - abs(values[0])) / (2 * step)
    np.testing.assert_allclose(found.slopes, list(sides.values()), rtol=1e-6)


def test_tables_over_the_frequency_alone_and_constant_ones():
    """A foundation without a speed; a table whose rows are equal is springs and dampers."""
    stiffness, damping = of(np.array([0.5, 1.0, 2.0]), 0.0)
    for k, d, mass in ((stiffness, damping, None), (stiffness[[1, 1, 1]], damping[[1, 1, 1]], np.full((3, 3), [0.2, 0.05, 0.3]))):
        model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=np.zeros((2, 2)), stiffness=np.zeros((2, 2)), labels=["x", "y"]),
                           tones=[1.0])  # fmt: skip
        model.bearing(["x", "y"], None, k, d, mass, frequencies=[0.5, 1.0, 2.0])
        model.load("x", 1, cos=1.0)
        motion = model.solve(order=1)
        added = np.zeros((2, 2)) if mass is None else np.array([[0.2, 0.05], [0.05, 0.3]])
        s = stiffness[1].reshape(2, 2) + 1j * damping[1].reshape(2, 2) - MASS - added
        np.testing.assert_allclose(amplitudes(motion, 1), np.linalg.solve(s, [1, 0]), rtol=1e-12)
        assert motion["stability"] == "stable"


def test_between_the_rows_nothing_overshoots():
    """A step of the stiffness: motions at frequencies between are between those of both values."""
    k = np.array([1.0, 1.0, 9.0, 9.0])
    model = nhbm.Model(nhbm.Matrices(mass=0.0 * np.eye(2), damping=np.zeros((2, 2)), stiffness=np.zeros((2, 2)), labels=["x", "y"]),
                       tones=[1.0])  # fmt: skip
    model.bearing(["x", "y"], None, np.outer(k, [1, 0, 0, 1]), np.zeros((4, 4)), frequencies=[0.5, 1.0, 1.1, 2.0])
    model.load("x", 1, cos=1.0)
    motions = model.sweep({"tones[0]": np.linspace(0.6, 1.9, 27)}, order=1)
    found = 1.0 / abs(motions.nhbm.amplitude("x", 1).values)
    assert found.min() > 1 - 1e-12 and found.max() < 9 + 1e-12 and (np.diff(found) > -1e-12).all()


def test_beyond_the_table_its_ends_apply_with_a_warning(tmp_path):
    model = journal(1.5, np.array([1.6, 2.0, 3.0]))
    with pytest.warns(match="frequencies beyond a table"):
        motion = model.solve(order=1)
    s = of(np.float64(1.6), 1.5)
    expected = np.linalg.solve(s[0].reshape(2, 2) + 1.5j * s[1].reshape(2, 2) - 1.5**2 * MASS, [1, -0.5j])
    np.testing.assert_allclose(amplitudes(motion, 1), expected, rtol=1e-12)
    model.to_file(tmp_path / "m.nml")
    result = run("solve", "m.nml", cwd=tmp_path)
    assert "warning: in 1 point the motion has frequencies beyond a table" in result.stdout + result.stderr
    inside = journal(2.0, np.array([1.6, 2.0, 3.0]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert inside.solve(order=1).nhbm.details["is_beyond_tables"] == 0


def maxwell(w, k=2.0, t=0.8):
    """A Maxwell element as stiffness and damping over the frequency."""
    z = k * 1j * w * t / (1 + 1j * w * t)
    return z.real, z.imag / w


@pytest.mark.parametrize("cross, verdict", [(0.15, "stable"), (2.5, "unstable")])
def test_stability_is_that_of_the_equations_behind_the_table(cross, verdict):
    """A Maxwell element in each direction, and a coupling of the stiffness that drives forward whirl: by a table, and as
    states, whose eigenvalues decide."""
    w = np.concatenate([[1e-3], np.linspace(0.02, 12.0, 300)])
    k, d = maxwell(w)
    stiffness = np.stack([3.0 + k, np.full_like(k, cross), np.full_like(k, -cross), 3.0 + k], axis=1)
    model = nhbm.Model(nhbm.Matrices(mass=np.eye(2), damping=0.05 * np.eye(2), stiffness=np.zeros((2, 2)), labels=["x", "y"]),
                       tones=[0.7])  # fmt: skip
    model.bearing(["x", "y"], None, stiffness, np.outer(d, [1, 0, 0, 1]), frequencies=w)
    model.load("x", 1, cos=0.1)
    model.law("cubic_spring", "x", stiffness=0.01)
    motion = model.solve(order=3)
    # q'' + .05 q' + 3 q + cross J q + 2 (q - s) = 0, .8 s' = (q - s)
    n = np.zeros((2, 2))
    across = cross * np.array([[0, 1], [-1, 0]])
    one = np.eye(2)
    a = np.block([[n, one, n], [-5 * one - across, -0.05 * one, 2 * one], [one / 0.8, n, -one / 0.8]])
    growing = int((np.linalg.eigvals(a).real > 0).sum())
    assert (growing > 0) == (verdict == "unstable")
    assert motion["stability"] == verdict
    assert verdict == "stable" or int(motion["n_unstable"]) == growing


def test_what_needs_time_is_refused_with_what_is_missing():
    model = journal(1.5, np.array([0.0, 0.7, 1.5, 3.0]))
    motion = model.solve(order=1)
    with pytest.raises(nhbm.ModelError, match="table over frequencies"):
        model.verify(motion)
    model.set("solver", primary_method="integration")
    with pytest.raises(nhbm.ModelError, match="frequencies of &bearing"):
        model.solve(order=1)


@pytest.mark.parametrize("keys, message", [
    ({"frequencies": [1.0, 0.5, 2.0]}, "each greater than the one before"),
    ({"frequencies": [1.0]}, "two or more"),
    ({"frequencies": [-1.0, 0.5, 2.0]}, "the first 0 or more"),
    ({"stiffness": np.ones((4, 4))}, "stiffness"),
    ({"speed": 7.0}, "7.0 rad/s lies outside of the table, 0.5 to 4.0"),
    ({"speeds": None, "frequencies": None}, "speeds"),
])  # fmt: skip
def test_mistakes_name_the_key(keys, message):
    model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=np.zeros((2, 2)), stiffness=np.eye(2), labels=["x", "y"]), tones=[1.0])
    model.load("x", 1, cos=1.0)
    with pytest.raises(nhbm.ModelError, match=message):
        model.bearing(**{"dofs": ["x", "y"], "speed": 1.0, **tables(np.array([0.5, 1.0, 2.0])), **keys})
        model.solve(order=1)


@pytest.mark.parametrize("seed", range(8))
def test_tables_of_random_controllers_are_those_with_states(seed):
    """Motion and verdict of a table of a random transfer matrix, beside the states that it was computed of."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(3, 3))
    a -= (np.linalg.eigvals(a).real.max() + 0.4) * np.eye(3)
    b, c, d = rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), 0.3 * rng.normal(size=(2, 2))
    w = np.concatenate([[0.0], np.geomspace(1e-2, 60.0, 800)])
    z = np.array([c @ np.linalg.solve(1j * x * np.eye(3) - a, b) + d for x in w]).reshape(-1, 4)
    damping = np.vstack([-(c @ np.linalg.solve(a @ a, b)).reshape(1, 4), z[1:].imag / w[1:, None]])
    motions = []
    for by_table in (True, False):
        model = nhbm.Model(nhbm.Matrices(mass=MASS, damping=0.4 * np.eye(2), stiffness=[[5.0, -1], [-1, 4.0]], labels=["x", "y"]),
                           tones=[1.1])  # fmt: skip
        if by_table:
            model.bearing(["x", "y"], None, z.real, damping, frequencies=w)
        else:
            model.feedback(["x", "y"], ["x", "y"], a, b, c, d)
        model.load("x", 1, cos=1.0)
        model.law("cubic_spring", "y", stiffness=0.3)
        motions.append(model.solve(order=7))
    here, there = (motion["coefficients"].sel(dof=["x", "y"]).values for motion in motions)
    np.testing.assert_allclose(here, there, atol=3e-4 * abs(there).max())
    assert motions[0]["stability"] == motions[1]["stability"] != "unknown"
