"""One sector with all harmonics against the whole wheel, and against closed forms of nodal diameters."""

import itertools

import numpy as np
import pytest

from in_process import nhbm

MASS, STIFFNESS, COUPLING, DAMPING, SHEAR = 1.0, 4.0, 1.5, 0.08, 0.03  # a blade, to its disk and to its neighbours
EXACT = 1e-8
ALIGNED = {"sampling": {"samples": 256}}  # samples of contact are the same in all sectors: 8 of them, 256 samples


def springs(n, pairs, stiffness):
    matrix = np.zeros((n, n))
    for i, k in pairs:
        matrix[np.ix_([i, k], [i, k])] += stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return matrix


def ring(n, tones, **options):
    """Disk masses d in a ring, a blade b on each."""
    d, b = np.arange(n), n + np.arange(n)
    around = list(zip(d, np.roll(d, -1), strict=True))
    k = springs(2 * n, around, COUPLING) + springs(2 * n, zip(d, b, strict=True), STIFFNESS) + np.diag([2.0] * n + [0.0] * n)
    c = springs(2 * n, around, SHEAR) + DAMPING * np.eye(2 * n)
    labels = [f"d{i}" for i in d] + [f"b{i}" for i in d]
    return nhbm.Model(nhbm.Matrices(mass=MASS * np.eye(2 * n), damping=c, stiffness=k, labels=labels), tones=tones, **options)


def sector(n, tones, orders, **options):
    """The same as one sector: the disk mass of the next one has neither mass nor support here."""
    k = springs(3, [(0, 2)], COUPLING) + springs(3, [(0, 1)], STIFFNESS) + np.diag([2.0, 0.0, 0.0])
    c = springs(3, [(0, 2)], SHEAR) + DAMPING * np.diag([1.0, 1.0, 0.0])
    model = nhbm.Model(nhbm.Matrices(mass=MASS * np.diag([1.0, 1.0, 0.0]), damping=c, stiffness=k, labels=["d", "b", "next"]),
                       tones=tones, **options)  # fmt: skip
    model.sector(n, orders, ["d"], ["next"])
    return model


def amplitude(motion, dof, tuple_):
    return complex(motion.nhbm.harmonic(dof, tuple_))


def tuples_of(motion):
    return [tuple(int(j) for j in np.atleast_1d(each)) for each in motion["tuple"].values]


def in_wheel(dof, s):
    """A name in `whole_wheel`."""
    return f"{dof}_{s}" if s else dof


def assert_same(wheel, one, n, orders, tolerance=EXACT, name="{}{}".format):
    """The sector's motion is that of each sector of the wheel, in all harmonics."""
    size = max(abs(amplitude(wheel, name("b", 0), j)) for j in tuples_of(wheel))
    for j, s, dof in itertools.product(tuples_of(wheel), (0, 1, n // 2), "db"):
        turn = np.exp(-2j * np.pi * np.dot(j, orders) * s / n)
        assert abs(amplitude(wheel, name(dof, s), j) - turn * amplitude(one, dof, j)) < tolerance * size, (j, s, dof)


@pytest.mark.parametrize(("n", "order"), [(4, 0), (4, 2), (6, 3), (5, 2), (7, -3), (5, 11)])
def test_a_linear_sector_has_the_dynamic_stiffness_of_its_diameter(n, order):
    w = 1.3
    model = sector(n, [w], order)
    model.load("b", 1, cos=0.3, sin=0.2)
    motion = model.solve(order=2)
    turn = np.exp(-2j * np.pi * order / n)
    z = (2 * COUPLING + 2j * w * SHEAR) * (1 - turn.real) + 2.0 + STIFFNESS - w**2 * MASS + 1j * w * DAMPING
    s = np.array([[z, -STIFFNESS], [-STIFFNESS, STIFFNESS - w**2 * MASS + 1j * w * DAMPING]])
    exact = np.linalg.solve(s, [0, 0.3 - 0.2j])
    np.testing.assert_allclose([amplitude(motion, dof, 1) for dof in ("d", "b")], exact, rtol=1e-10)
    np.testing.assert_allclose(amplitude(motion, "next", 1), turn * exact[0], rtol=1e-10)


def stops(n, frequency, load, **options):
    """A wheel and a sector with a stop at each blade."""
    wheel, one = ring(n, [frequency], **options), sector(n, [frequency], 3, **options)
    wheel.engine_order([f"b{s}" for s in range(n)], 3, load)
    one.load("b", 1, cos=load)
    for model, blades in ((wheel, [f"b{s}" for s in range(n)]), (one, ["b"])):
        for blade in blades:
            model.law("elastic_stop", blade, gap=0.2, stiffness=6.0, label=f"stop_{blade}")
    return wheel, one


def test_stops_on_each_blade_as_on_the_whole_wheel():
    wheel, one = stops(8, 1.25, 0.3, **ALIGNED)
    assert_same(wheel.solve(order=9), one.solve(order=9), 8, [3])


@pytest.mark.long
def test_twenty_four_sectors_of_order_fifteen():
    wheel, one = stops(24, 1.25, 0.3, sampling={"samples": 512})
    assert_same(wheel.solve(order=15), one.solve(order=15), 24, [3])


def test_a_sector_that_is_loaded_twice_is_refused():
    with pytest.raises(nhbm.ModelError, match="'b1' is given more than once"):
        ring(4, [1.0]).engine_order(["b0", "b1", "b1", "b3"], 1, 1.0)


def test_two_engine_orders_as_on_the_whole_wheel():
    n, tones, orders = 6, [1.05, 1.6180339], [2, -1]
    wheel, one = ring(n, tones), sector(n, tones, orders)
    for order, load, j in ((2, 0.3, [1, 0]), (-1, 0.2, [0, 1])):
        wheel.engine_order([f"b{s}" for s in range(n)], order, load, j)
        one.load("b", j, cos=load)
    for model, blades in ((wheel, [f"b{s}" for s in range(n)]), (one, ["b"])):
        for blade in blades:
            model.law("cubic_spring", blade, stiffness=3.0, label=f"spring_{blade}")
    assert_same(wheel.solve(order=3), one.solve(order=3), n, orders)


def shrouded(kind, n=8, order=3, frequency=1.05, load=0.3, **keys):
    """Blades that touch their neighbours: the blade of the next sector is a copy without mass and stiffness."""
    wheel = ring(n, [frequency], **ALIGNED)
    k = springs(4, [(0, 2)], COUPLING) + springs(4, [(0, 1)], STIFFNESS) + np.diag([2.0, 0.0, 0.0, 0.0])
    c = springs(4, [(0, 2)], SHEAR) + DAMPING * np.diag([1.0, 1.0, 0.0, 0.0])
    one = nhbm.Model(nhbm.Matrices(mass=MASS * np.diag([1.0, 1.0, 0.0, 0.0]), damping=c, stiffness=k,
                                   labels=["d", "b", "next", "bnext"]), tones=[frequency], **ALIGNED)  # fmt: skip
    one.sector(n, order, ["d", "b"], ["next", "bnext"])
    wheel.engine_order([f"b{s}" for s in range(n)], order, load)
    one.load("b", 1, cos=load)
    for s in range(n):
        wheel.law(kind, [f"b{s}", f"b{(s + 1) % n}"], weights=[1.0, -1.0], label=f"shroud{s}", **keys)
    one.law(kind, ["b", "bnext"], weights=[1.0, -1.0], label="shroud", **keys)
    return wheel, one


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("elastic_stop", {"gap": 0.1, "stiffness": 3.0}),
        ("jenkins", {"stiffness": 2.0, "limit": 0.1}),
        ("cubic_spring", {"stiffness": 4.0}),
    ],
)
def test_laws_between_neighbours_as_on_the_whole_wheel(kind, keys):
    wheel, one = shrouded(kind, **keys)
    assert_same(wheel.solve(order=7), one.solve(order=7), 8, [3])


@pytest.mark.parametrize("kind", ["elastic_stop", "jenkins"])
def test_the_wheel_made_of_a_sector_has_laws_between_neighbours(kind):
    keys = {"elastic_stop": {"gap": 0.1, "stiffness": 3.0}, "jenkins": {"stiffness": 2.0, "limit": 0.1}}[kind]
    wheel, one = shrouded(kind, **keys)
    found = [model.solve(order=5) for model in (wheel, one.whole_wheel())]
    assert_same(found[1], one.solve(order=5), 8, [3], name=in_wheel)
    assert found[0]["stability"] == found[1]["stability"] != "unknown"


@pytest.mark.parametrize("n", [6, 8])
def test_stops_under_two_tones_are_those_of_the_wheel_made(n):
    """Fresh numbers in each run: two engine orders, of any sign, with any phase, and a mean load."""
    random = np.random.default_rng()
    tones, orders = [1.05, 1.6180339], [int(order) for order in random.integers(-n, n, 2)]
    one = sector(n, tones, orders, sampling={"samples": [48, 48]})  # n divides them: all sectors have the same samples
    for j, size in ([1, 0], 0.3), ([0, 1], 0.2), ([0, 0], 0.1):
        cos, sin = size * random.uniform(-1.0, 1.0, 2)
        one.load("b", j, cos=cos, sin=sin)
    one.law("elastic_stop", "b", gap=0.1, stiffness=random.uniform(1.0, 3.0), label="stop")
    assert_same(one.whole_wheel().solve(order=3), one.solve(order=3), n, orders, name=in_wheel)


@pytest.mark.parametrize("frequency", [1.04, 1.25])
def test_the_wheel_made_of_a_sector_is_verified_by_time_integration(frequency):
    _, one = stops(6, frequency, 0.3)
    wheel = one.whole_wheel()
    verdict = {"stable": "agrees", "unstable": "unstable"}[wheel.solve(tolerance=1e-4)["stability"].item()]
    assert wheel.verify()["integration_verdict"] == verdict


def test_deviations_between_blades_of_the_wheel_made_are_those_of_full_matrices():
    """Mistuning without laws has a closed form: the dynamic stiffness of the wheel with the stiffness of each blade."""
    n, order, w, load = 12, 3, 1.05, 0.3
    one = sector(n, [w], order)
    one.load("b", 1, cos=load)
    wheel = one.whole_wheel()
    deviations = np.random.default_rng().normal(0.0, 0.05 * STIFFNESS, n)
    for s, k in enumerate(deviations):
        wheel.law("polynomial", ["b" + f"_{s}" * (s > 0), "d" + f"_{s}" * (s > 0)], weights=[1.0, -1.0], stiffness=[k])
    d, b = np.arange(n), n + np.arange(n)
    around = list(zip(d, np.roll(d, -1), strict=True))
    springs_of = springs(2 * n, around, COUPLING) + np.diag([2.0] * n + [0.0] * n)
    for s in range(n):
        springs_of += springs(2 * n, [(d[s], b[s])], STIFFNESS + deviations[s])
    dampers = springs(2 * n, around, SHEAR) + DAMPING * np.eye(2 * n)
    force = np.concatenate([np.zeros(n), load * np.exp(-2j * np.pi * order * np.arange(n) / n)])
    exact = np.linalg.solve(springs_of - w**2 * MASS * np.eye(2 * n) + 1j * w * dampers, force)
    motion = wheel.solve(order=1)
    np.testing.assert_allclose([amplitude(motion, in_wheel("b", s), 1) for s in range(n)], exact[n:], rtol=1e-8, atol=1e-10)


def test_what_a_wheel_cannot_repeat_is_refused_by_name():
    _, one = stops(5, 1.05, 0.3)
    one.law("parametric", "b", tuple=[2], stiffness_cos=0.1, label="swinging")
    with pytest.raises(nhbm.ModelError, match="phase of its own"):
        one.whole_wheel()
    with pytest.raises(nhbm.ModelError, match="not one sector"):
        ring(3, [1.0]).whole_wheel()


def test_a_curve_and_its_peak_are_those_of_the_whole_wheel():
    wheel, one = stops(8, 1.0, 0.3, **ALIGNED)
    peaks = []
    for model, blade in ((wheel, "b0"), (one, "b")):
        curve = model.curve("tones[0]", 1.0, 1.2, order=5, peak_of=f"{blade} (1)")
        events = curve.nhbm.events(f"{blade} (1)")
        peaks.append(events[events["kind"] == "peak"][["tones_frequency", f"{blade} (1)"]].to_numpy(float))
    assert len(peaks[0]) == 1
    np.testing.assert_allclose(peaks[1], peaks[0], rtol=1e-6)


def test_sweeps_are_those_of_the_whole_wheel():
    wheel, one = stops(8, 1.0, 0.3, **ALIGNED)
    frequencies = [0.9, 1.1, 1.3]
    found = one.sweep({"tones[0]": frequencies}, of="b (1)", order=5)["response"].values
    for w, response in zip(frequencies, found, strict=True):
        wheel["tones[0]"] = w
        assert response == pytest.approx(wheel.response("b0 (1)", order=5), rel=1e-8)


def test_derivatives_are_those_of_the_whole_wheel():
    wheel, one = stops(4, 1.05, 0.3)
    values, slopes = zip(*(model.gradient(f"{blade} (1)", ["tones[0]"], order=5) for model, blade in ((wheel, "b0"), (one, "b"))),
                         strict=True)  # fmt: skip
    np.testing.assert_allclose(values[1], values[0], rtol=1e-8)
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-6)


def test_derivatives_by_the_structure_are_those_of_differences():
    _, one = shrouded("cubic_spring", stiffness=4.0)
    path = "structure.stiffness[0]"
    _, slopes = one.gradient("b (1)", [path], order=5)
    middle, step, around = one[path], 1e-5, []
    for sign in (1, -1):
        one[path] = middle + sign * step
        around.append(one.response("b (1)", order=5))
    np.testing.assert_allclose(slopes[0], (around[0] - around[1]) / (2 * step), rtol=1e-5)


def test_estimated_errors_are_those_of_the_whole_wheel():
    wheel, one = stops(8, 1.25, 0.3, **ALIGNED)
    found = [model.solve(order=5) for model in (wheel, one)]
    assert found[0]["truncation_estimate"] > 1e-6
    for name in ("truncation_estimate", "aliasing_estimate"):
        assert float(found[1][name]) == pytest.approx(float(found[0][name]), rel=1e-6)
    assert 8 * float(found[1]["power_damping"]) == pytest.approx(float(found[0]["power_damping"]), rel=1e-8)


@pytest.mark.parametrize(
    ("kind", "n", "frequency", "load"),
    [("cubic_spring", 6, 1.2, 0.3), ("cubic_spring", 6, 1.4, 0.3), ("cubic_spring", 6, 1.5, 0.6),
     ("elastic_stop", 8, 1.25, 0.3), ("elastic_stop", 8, 1.05, 0.3), ("elastic_stop", 8, 1.04, 0.3)],
)  # fmt: skip
def test_stability_is_that_of_the_whole_wheel(kind, n, frequency, load):
    """Where the wave loses its stability, another wave grows: disturbances of its own nodal diameter alone would not show it."""
    wheel, one = ring(n, [frequency], **ALIGNED), sector(n, [frequency], 3, stability={"method": "integration"}, **ALIGNED)
    wheel.engine_order([f"b{s}" for s in range(n)], 3, load)
    one.load("b", 1, cos=load)
    keys = {"cubic_spring": {"stiffness": 3.0}, "elastic_stop": {"gap": 0.2, "stiffness": 6.0}}[kind]
    for model, blades in ((wheel, [f"b{s}" for s in range(n)]), (one, ["b"])):
        for blade in blades:
            model.law(kind, blade, label=f"law_{blade}", **keys)
    found = [model.solve(order=9) for model in (wheel, one)]
    assert found[0]["stability"] != "unknown"
    assert found[1]["stability"] == found[0]["stability"]
    assert found[1]["n_unstable"] == found[0]["n_unstable"]


def test_stability_of_friction_with_memory_and_of_two_tones_is_not_known():
    _, one = shrouded("jenkins", stiffness=2.0, limit=0.1)
    assert one.solve(order=5)["stability"] == "unknown"
    two = sector(6, [1.05, 1.6180339], [2, -1])
    two.load("b", [1, 0], cos=0.3)
    two.law("cubic_spring", "b", stiffness=3.0)
    assert two.solve(order=3)["stability"] == "unknown"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"engine_orders": [1, 2]}, "engine_orders"),
        ({"low": ["d", "b"]}, "high"),
        ({"low": ["nothing"]}, "nothing"),
        ({"n_sectors": 1}, "n_sectors"),
        ({"high": ["d0"]}, "is in 'low', too"),
    ],
)
def test_sectors_that_are_none_are_refused(change, words):
    model = ring(3, [1.0])
    keys = {"n_sectors": 5, "engine_orders": 2, "low": ["d0"], "high": ["d1"], **change}
    with pytest.raises(nhbm.ModelError, match=words):
        model.sector(**keys)
        model.solve(order=1)


def test_what_needs_the_whole_wheel_is_refused_by_name():
    _, one = stops(5, 1.05, 0.3)
    with pytest.raises(nhbm.ModelError, match="whole wheel"):
        one.integrate(10.0)
    _, one = shrouded("rigid_wall", gap=0.1)
    with pytest.raises(nhbm.ModelError, match="rigid law between"):
        one.solve(order=3)


def test_a_sector_of_finite_elements_is_joined_in_polar_directions():
    pytest.importorskip("skfem")
    from nhbm import cyclic, examples, reduction

    n, order = 6, 2
    made = cyclic.sector_of(examples.sector(n_sectors=n), n, "low", "high")
    low, high = made.pairs()
    w = 0.6 * cyclic.frequencies(made, order, 1)[0]
    model = nhbm.Model(reduction.reduce(made.model, [*low, *high, "tip.z"], 20, "craig-bampton"), tones=[w])
    model.sector(n, order, low, high)
    model.load("tip.z", 1, cos=1.0)
    tip = made.model.dofs_of("tip.z")[0]
    shape = (made.inside + np.exp(-2j * np.pi * order / n) * made.shared).toarray()
    stiffness, mass = made.model.stiffness.toarray(), made.model.mass.toarray()
    exact = shape @ np.linalg.solve(shape.conj().T @ (stiffness - w**2 * mass) @ shape, shape[tip].conj())
    assert amplitude(model.solve(order=1), "tip.z", 1) == pytest.approx(exact[tip], rel=1e-4)
