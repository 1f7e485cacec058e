"""Rotors against closed forms."""

import warnings

import nhbm
import numpy as np
import pytest

from nhbm import Implausible, ModelError, Rotor, rotors
from nhbm.rotors import at_speeds


def frequencies(model):
    return rotors.whirls(at_speeds(model, (0.0, 0.0)) if model.gyroscopic is None else model)[0]


def test_shaft_between_stiff_bearings():
    """Pinned beam: (k pi/L)**2 sqrt(EI/rho A), a little lower by its rotary inertia; each twice."""
    shaft = rotors.rotor(1.0, 0.02, 20, bearings=[(0.0, 1e13, 0.0), (1.0, 1e13, 0.0)])
    exact = np.pi**2 * np.sqrt(2.1e11 / 7850.0) * 0.02 / 4
    assert frequencies(shaft)[0] == pytest.approx(exact, rel=2e-4) and frequencies(shaft)[1] == pytest.approx(exact, rel=2e-4)
    assert frequencies(shaft)[2] == pytest.approx(4 * exact, rel=1e-3)


def test_disk_that_turns_splits_the_whirls():
    """A heavy disk in the middle tilts alone: I w**2 -+ Omega I_p w - k = 0 with the tilting stiffness 12 EI/L of both halves."""
    speed, diametral, polar = 200.0, 5.0, 9.0
    shaft = rotors.rotor(
        1.0, 0.02, 20, [(0.5, 500.0, diametral, polar)], [(0.0, 1e13, 0.0), (1.0, 1e13, 0.0)], speed, density=1e-3
    )
    k = 12 * 2.1e11 * np.pi * 0.02**4 / 64 / 1.0
    root = np.sqrt((speed * polar / 2) ** 2 + diametral * k)
    wanted = np.array([root - speed * polar / 2, root + speed * polar / 2]) / diametral
    found = frequencies(shaft)
    for w in wanted:
        assert np.abs(found / w - 1.0).min() < 1e-6


def test_what_is_no_rotor_is_refused():
    with pytest.raises(ModelError, match="at 2.0 is not on the shaft, 0.0 to 1.0"):
        rotors.rotor(1.0, 0.02, 4, bearings=[(2.0, 1e6, 0.0)])
    with pytest.raises(ModelError, match="diameter must be above 0, not 0.0"):
        rotors.rotor(1.0, 0.0, 4)
    made = pinned(1.0, 0.02, 4)
    for inertias, message in (((-1.0, 0.1, 0.1), "mass must be 0 or more"), ((1.0, -0.1, 0.1), "diametral must be 0 or more"),
                              ((1.0, 0.1, np.nan), "polar must be finite")):  # fmt: skip
        with pytest.raises(ModelError, match=f"disk at 0.5: {message}"):
            made.disk(0.5, *inertias)
    with pytest.raises(ModelError, match="polar moment of inertia, 0.4, is more than twice the diametral one, 0.04"):
        made.disk(0.5, 10.0, 0.04, 0.4)
    made.disk(0.5, 10.0, 0.0, 0.4)  # without the inertia against tilting
    for keys, name in (({"young": 0.0}, "young"), ({"density": -1.0}, "density"), ({"poisson": 0.7}, "poisson")):
        with pytest.raises(ModelError, match=name):
            Rotor(**keys)


@pytest.mark.parametrize("has_table", [False, True])
def test_critical_speeds_of_bearings_that_feed_whirls(has_table):
    """A heavy disk on a stiff, light shaft: with z = x + i y the stiffness k - i c and damping d, m s**2 + d s + k - i c = 0."""
    mass, k, cross, d = 20.0, 2e6, 4e5, 900.0
    made = Rotor(density=10.0)
    made.shaft(np.linspace(0.0, 0.2, 3), 0.2)
    made.disk(0.1, mass=mass, diametral=0.01, polar=0.02)
    coefficients = {"stiffness": [[k / 2, cross / 2], [-cross / 2, k / 2]], "damping": d / 2}
    if has_table:
        coefficients = {name: [values, values] for name, values in coefficients.items()} | {"speeds": [0.0, 1000.0]}
    for z in (0.0, 0.2):
        made.bearing(z, **coefficients)
    exact = np.sort(abs(np.roots([mass, d, k - 1j * cross]).imag))
    found = made.critical_speeds(500.0)
    assert len(found) == 2
    np.testing.assert_allclose(found, exact, rtol=2e-3)  # the shaft bends a little


def pinned(length, diameter, n, support=1e12, **keys):
    made = Rotor(**{name: keys.pop(name) for name in ("poisson",) if name in keys})
    made.shaft(np.linspace(0.0, length, n + 1), diameter, **keys)
    for z in (0.0, length):
        made.bearing(z, support)
    return made


def test_thick_shaft_has_the_frequency_of_timoshenko():
    """Pinned: with n = k pi/L, G k' and rho: (rho/(k'G)) rho I w**4 - (rho A + (rho I)(1 + E/(k'G)) n**2) w**2 + E I n**4 = 0."""
    length, diameter, young, density = 1.0, 0.2, 2.1e11, 7850.0
    second, area = np.pi * diameter**4 / 64, np.pi * diameter**2 / 4
    shear = young / 2.6 * 6 * 1.3 / (7 + 6 * 0.3)
    n = np.pi / length
    b = density * area + density * second * (1 + young / shear) * n**2
    exact = np.sqrt(np.roots([density**2 * second / shear, -b, young * second * n**4]).min())
    found = frequencies(pinned(length, diameter, 40, 1e14).structure())[0]
    assert found == pytest.approx(exact, rel=2e-4)
    assert frequencies(pinned(length, diameter, 40, 1e14, poisson=None).structure())[0] > 1.02 * exact


def test_hollow_shaft_has_the_frequency_of_timoshenko():
    """As above, with the shear coefficient of a tube (Cowper 1966), whose limit for a thin wall is 2 (1 + nu)/(4 + 3 nu)."""
    length, outer, inner, young, density, poisson = 0.5, 0.14, 0.11, 2.1e11, 7850.0, 0.3
    second, area = np.pi * (outer**4 - inner**4) / 64, np.pi * (outer**2 - inner**2) / 4
    square = (inner / outer) ** 2
    wall = (1 + square) ** 2
    shear = young / 2.6 * 6 * (1 + poisson) * wall / ((7 + 6 * poisson) * wall + (20 + 12 * poisson) * square)
    n = np.pi / length
    b = density * area + density * second * (1 + young / shear) * n**2
    exact = np.sqrt(np.roots([density**2 * second / shear, -b, young * second * n**4]).min())
    made = Rotor()
    made.shaft(np.linspace(0.0, length, 41), outer, inner)
    for z in (0.0, length):
        made.bearing(z, 1e14)
    assert frequencies(made.structure())[0] == pytest.approx(exact, rel=2e-4)
    assert rotors._shear_coefficient(0.3, 0.0) == pytest.approx(6 * 1.3 / 8.8, rel=1e-12)
    assert rotors._shear_coefficient(0.3, 1.0) == pytest.approx(2 * 1.3 / 4.9, rel=1e-12)


def test_critical_speeds_of_anisotropic_bearings_do_not_depend_on_their_axes():
    """Each is a speed at which a whirl frequency equals the speed."""
    found = []
    for stiffness in ([[2e6, 1e6], [1e6, 2e6]], [[3e6, 0.0], [0.0, 1e6]]):
        made = Rotor()
        made.shaft(np.linspace(0.0, 1.0, 11), 0.03)
        made.disk(0.3, 8.0, 0.04, 0.08)
        made.bearing(0.0, stiffness)
        made.bearing(1.0, stiffness)
        found.append(made.critical_speeds(1200.0))
        np.testing.assert_allclose(made.critical_speeds(1200.0, order=-1.0), found[-1], rtol=1e-9)
    np.testing.assert_allclose(*found, rtol=1e-8)
    np.testing.assert_allclose(found[0], [190.253, 208.329, 669.773, 905.273, 1179.762], rtol=1e-5)
    for speed in found[0]:
        assert abs(made.campbell([speed])[0] - speed).min() < 1e-6 * speed


def test_critical_speeds_lie_on_the_campbell_diagram():
    made = pinned(1.0, 0.03, 12)
    made.disk(0.25, 5.0, 0.05, 0.08)
    for order in (1.0, -1.0):
        speeds = made.critical_speeds(5000.0, order=order)
        assert len(speeds) >= 2
        for speed in speeds:
            found = made.campbell(speed)[0][0]
            assert abs(found / speed - 1.0).min() < 1e-6
    assert made.critical_speeds(5000.0)[0] > made.critical_speeds(5000.0, order=-1.0)[0]


@pytest.mark.parametrize("order", [1.0, -1.0])
@pytest.mark.parametrize("bearings", [[], [1e7], [[[1e7, 0.0], [0.0, 2e7]]]])
def test_a_rotor_that_its_bearings_do_not_hold_has_no_critical_speed_of_zero(bearings, order):
    """The others are those of a rotor with soft springs, and for a slender shaft the frequencies of the free beam."""
    found = []
    for soft in (None, 1.0):
        made = Rotor(poisson=None)
        made.shaft(np.linspace(0.0, 1.0, 13), 0.01)
        for stiffness in bearings:
            made.bearing(0.3, stiffness)
        for z in (0.0, 1.0) if soft else ():
            made.bearing(z, soft)
        found.append(made.critical_speeds(5000.0, order=order))
    above = found[1][found[1] > 5.0]
    np.testing.assert_allclose(found[0], above, rtol=1e-3)
    assert len(found[0]) >= 3 and found[0].min() > 5.0
    if not bearings:
        first = 4.730040745**2 * np.sqrt(2.1e11 / 7850) * 0.01 / 4
        assert found[0][0] == pytest.approx(first, rel=1e-3)


def test_a_negative_bearing_is_named():
    made = Rotor()
    made.shaft([0.0, 1.0], 0.1)
    with pytest.warns(nhbm.Implausible, match="bearing at 1 m: stiffness -1000000.0 is negative"):
        made.bearing(1.0, -1e6)


def test_damping_of_the_shaft_feeds_the_whirl_beyond_its_critical_speed():
    made = pinned(1.0, 0.03, 8, damping=1e-5)
    first = made.critical_speeds(5000.0)[0]
    for speed, grows in ((0.95 * first, False), (1.05 * first, True)):
        assert (made.campbell(speed)[1].max() > 0) == grows


def test_two_shafts_have_speeds_of_their_own():
    made = Rotor()
    made.shaft(np.linspace(0.0, 1.0, 5), 0.03, name="low")
    made.shaft(np.linspace(0.25, 0.75, 3), 0.06, 0.05, name="high", speed=2)
    made.disk(0.5, 2.0, 0.02, 0.04, shaft="high")
    made.bearing(0.0, 1e7, shaft="low")
    made.bearing(1.0, [[1e7, 1e5], [-1e5, 2e7]], 10.0, shaft="low")
    made.between(0.75, "high", "low", 1e6, 5.0)
    made.unbalance(0.5, 1e-4, np.pi / 2, shaft="high")
    model = made.structure()
    g = model.gyroscopic_by_speed_2.toarray()
    assert abs(g[:20]).max() == 0 and abs(g + g.T).max() < 1e-14 * abs(g).max()
    tilt_x, tilt_y = model.labels.index("n7.xz"), model.labels.index("n7.yz")
    assert model.gyroscopic_by_speed_2[tilt_x, tilt_y] > 0.04
    k = model.stiffness.toarray()
    x, y = model.labels.index("n5.x"), model.labels.index("n5.y")
    assert k[x, y] == 1e5 and k[y, x] == -1e5 and k[model.labels.index("n8.x"), model.labels.index("n4.x")] == -1e6
    dofs, values = model.loads["unbalance_high_cos"]
    assert [model.labels[d] for d in dofs] == ["n7.x", "n7.y"] and values == pytest.approx([0.0, 1e-4], abs=1e-18)
    assert model.loads["unbalance_high_sin"][1] == pytest.approx([-1e-4, 0.0], abs=1e-18)
    with pytest.raises(ModelError, match="choose a shaft"):
        made.disk(0.5, 1.0, 0.1, 0.1)


def test_a_disk_beside_the_nodes_is_doubted():
    """It is taken at the nearest node, which may be far away."""
    rotor = Rotor()
    rotor.shaft([0.0, 0.5, 1.0], diameter=0.03)
    with pytest.warns(Implausible, match="0.3 m on the shaft is not at a node: the nearest one, at 0.5 m, is taken"):
        rotor.disk(0.3, mass=1.0, diametral=0.1, polar=0.2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rotor.bearing(1.0 - 1e-12, stiffness=1e6)


def with_tables(stiffness, damping=0.0, speeds=(0.0, 1000.0), n_elements=4):
    rotor = Rotor()
    rotor.shaft(np.linspace(0.0, 1.0, n_elements + 1), 0.03)
    rotor.disk(0.25, 8.0, 0.04, 0.08)
    for z in (0.0, 1.0):
        rotor.bearing(z, stiffness, damping, speeds=speeds)
    rotor.unbalance(0.25, 1e-4)
    return rotor


@pytest.mark.long
def test_constant_tables_are_constant_bearings():
    tables, constant = with_tables(2e6, 200.0), with_tables(2e6, 200.0, speeds=None)
    for one, other in zip(tables.campbell([0.0, 300.0, 2000.0]), constant.campbell([0.0, 300.0, 2000.0])):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(tables.critical_speeds(1200.0), constant.critical_speeds(1200.0), rtol=1e-8)
    with pytest.raises(ModelError, match=r"'bearing1' has coefficients over the speed, .* rotor.model\(speed=...\)"):
        tables.structure()


def test_critical_speeds_of_bearings_that_stiffen_with_the_speed():
    """There the whirl of the rotor without damping has the frequency of its unbalance."""
    rotor = with_tables([2e5, 5e5, 9e5, 2e6], speeds=[0.0, 150.0, 400.0, 1000.0])
    found = rotor.critical_speeds(1000.0)
    assert len(found) >= 1
    for speed in found:
        assert abs(rotor.campbell([speed])[0][0] - speed).min() < 1e-6 * speed
    soft = with_tables(2e5).critical_speeds(1000.0)[0]
    assert found[0] > 1.05 * soft


def test_models_of_rotors_have_their_speed_and_unbalance():
    """Circular whirl at a row of the tables, against the linear equations at that speed; the speed follows the tone along
    sweeps."""
    speeds = [0.0, 150.0, 400.0, 1000.0]
    stiffness = [[[k, 0.2 * k], [-0.2 * k, k]] for k in (2e5, 5e5, 9e5, 2e6)]
    rotor = with_tables(stiffness, [300.0, 250.0, 200.0, 100.0], speeds)
    model = rotor.model(speed=100.0, harmonics={"order": 1})
    found = model.sweep({"tones[0]": [150.0, 250.0, 400.0]})
    for at, amplitude in zip((150.0, 250.0, 400.0), found.nhbm.amplitude("disk1.x").values):
        s = rotor._at_speed(rotor._matrices(), at, 1.0)
        force = np.zeros(s.n_dofs, complex)
        for part, factor in (("cos", 1.0), ("sin", -1j)):
            dofs, values = s.loads[f"unbalance_shaft_{part}"]
            force[dofs] += factor * values * at**2
        rates = s.damping.toarray() + s.gyroscopic.toarray()
        whole = s.stiffness.toarray() - at**2 * s.mass.toarray() + 1j * at * rates
        dof = s.labels.index("n2.x")
        assert amplitude == pytest.approx(abs(np.linalg.solve(whole, force)[dof]), rel=1e-9)
    figure = found.nhbm.orbit("disk1.x", "disk1.y")
    assert len(figure.axes[0].lines) == 3
    for line, amplitude in zip(figure.axes[0].lines, found.nhbm.amplitude("disk1.x").values):
        np.testing.assert_allclose(np.hypot(*line.get_data()), amplitude, rtol=1e-9)  # circles


def test_tables_over_speed_and_frequency_whirl_at_their_frequency():
    """Critical speeds and unbalance of tables over both are those of the synchronous coefficients."""
    speeds, whirls = np.array([0.0, 150.0, 400.0, 1000.0]), np.array([0.0, 150.0, 400.0, 1000.0])
    k, d = 2e5 + 900.0 * speeds[:, None] + 400.0 * whirls, 300.0 - 0.1 * speeds[:, None] - 0.05 * whirls
    rotor = Rotor()
    rotor.shaft(np.linspace(0.0, 1.0, 5), 0.03)
    rotor.disk(0.25, 8.0, 0.04, 0.08)
    for z in (0.0, 1.0):
        rotor.bearing(z, k, d, speeds=speeds, frequencies=whirls)
    rotor.unbalance(0.25, 1e-4)
    synchronous = with_tables(k.diagonal(), d.diagonal(), speeds)
    np.testing.assert_allclose(rotor.critical_speeds(800.0), synchronous.critical_speeds(800.0), rtol=1e-8)
    at = {"tones[0]": [150.0, 250.0, 400.0]}
    ours, theirs = (one.model(speed=100.0, harmonics={"order": 1}).sweep(at) for one in (rotor, synchronous))
    np.testing.assert_allclose(ours.nhbm.amplitude("disk1.x").values, theirs.nhbm.amplitude("disk1.x").values, rtol=1e-9)
    with pytest.raises(ModelError, match="there is no Campbell"):
        rotor.campbell([100.0])


def test_two_shafts_turn_with_two_tones():
    rotor = Rotor()
    for name, speed in (("inner", 1), ("outer", 2)):
        rotor.shaft([0.0, 0.5, 1.0], 0.03, name=name, speed=speed)
        rotor.disk(0.5, 5.0, 0.02, 0.04, shaft=name)
        rotor.unbalance(0.5, 1e-4, shaft=name)
        for z in (0.0, 1.0):
            rotor.bearing(z, 1e6, 100.0, shaft=name, speeds=[0.0, 1000.0])
    model = rotor.model(speed=100.0, ratio=1.5, harmonics={"order": 1})
    assert [model[path] for path in ("tones[1]", "structure.speed[1]", "bearing(bearing3)%speed")] == [150.0] * 3
    motion = model.solve()
    assert motion.nhbm.amplitude("disk1.x", (1, 0)) > 0 and motion.nhbm.amplitude("disk2.x", (0, 1)) > 0


@pytest.mark.parametrize("arguments, message", [
    (([1e6, 2e6], 0.0, [0.0, 100.0, 200.0]), r"needs for each of 3 speeds a number, a matrix of 2 x 2 or four numbers, not \(2,\)"),
    ((1e6, 0.0, [100.0, 0.0]), "speeds must be two or more ascending numbers"),
    (("stiff", 0.0, [0.0, 100.0]), "stiffness must be"),
])  # fmt: skip
def test_tables_that_do_not_fit_are_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        with_tables(*arguments)
