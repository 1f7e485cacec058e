"""What jobs of trades need from one call: all peaks for an optimiser, the largest of many blades, engine orders, backbones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from in_process import duffing

import nhbm
from nhbm import ModelError


def with_absorbers(stiffness=(0.024, 0.031), damping=(0.004, 0.006)):
    main = nhbm.Matrices(mass=np.diag([1.0, 0.03, 0.03]), stiffness=np.diag([1.0, 0, 0]), damping=np.diag([0.01, 0, 0]))
    model = nhbm.Model(main, tones=[1.0])
    model.load("x1", 1, cos=0.01)
    for i, k, d in zip((2, 3), stiffness, damping):
        model.law("polynomial", [f"x{i}", "x1"], weights=[1.0, -1.0], stiffness=[k], damping=[d], label=f"a{i}")
    return model


PATHS = ["a2.stiffness[0]", "a2.damping[0]", "a3.stiffness[0]", "a3.damping[0]"]


def amplitude(values, w):
    """Of the main mass, in closed form."""
    z = 1 - w**2 + 0.01j * w
    for k, d in zip(values[::2], values[1::2]):
        joint = k + 1j * w * d
        z = z + joint - joint**2 / (joint - 0.03 * w**2)
    return 0.01 / abs(z)


def test_all_peaks_have_their_derivatives():
    """Against the maxima of the closed form, and differences of them."""

    def maxima(values):
        w = np.linspace(0.5, 1.6, 200_001)
        a = amplitude(values, w)
        tops = np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] > a[2:])) + 1
        x, y = w[tops[:, None] + [-1, 0, 1]], a[tops[:, None] + [-1, 0, 1]]
        curved = [np.polyfit(u - v, b, 2) for u, v, b in zip(x, w[tops], y)]
        return np.array([c[2] - c[1] ** 2 / (4 * c[0]) for c in curved]), w[tops] - [c[1] / (2 * c[0]) for c in curved]

    model = with_absorbers()
    found = model.peaks("x1 (1)", "tones[0]", 0.5, 1.6, by=PATHS, order=1)
    values = np.array([model[path] for path in PATHS])
    sizes, positions = maxima(values)
    assert len(found) == len(sizes) == 3
    np.testing.assert_allclose([peak.value for peak in found], sizes, rtol=1e-6)
    np.testing.assert_allclose([peak.at for peak in found], positions, rtol=1e-5)
    for i in range(len(PATHS)):
        step = 1e-4 * values[i] * np.eye(len(PATHS))[i]
        expected = [(b - a) / (2 * step[i]) for a, b in zip(maxima(values - step)[0], maxima(values + step)[0])]
        np.testing.assert_allclose([peak.slopes[i] for peak in found], expected, rtol=1e-3, atol=1e-4)
    alone = model.peaks("x1 (1)", "tones[0]", 0.5, 1.6, order=1)
    np.testing.assert_allclose([peak.value for peak in alone], sizes, rtol=1e-6)
    highest = model.peak("x1 (1)", "tones[0]", 0.5, 1.6, order=1)
    assert highest.value == max(peak.value for peak in alone) and all(len(peak.slopes) == 0 for peak in alone)
    with pytest.raises(ModelError, match="varies along the curve"):
        model.peaks("x1 (1)", "tones[0]", 0.5, 1.6, by="tones[0]", order=1)


def test_peaks_pass_folds():
    found = duffing().peaks("x1 (1)", "tones[0]", 0.5, 2.5, order=5)
    assert len(found) == 1 and found[0].value == duffing().peak("x1 (1)", "tones[0]", 0.5, 2.5, order=5).value


@pytest.mark.long
def test_a_bound_above_all_peaks_reaches_the_optimum():
    """That of the closed form by a method without derivatives."""
    model, start = with_absorbers(), np.array([0.024, 0.004, 0.031, 0.006])

    def peaks(x):
        for path, value in zip(PATHS, start * np.exp(x)):
            model[path] = value
        found = sorted(model.peaks("x1 (1)", "tones[0]", 0.5, 1.6, by=PATHS, order=1), key=lambda peak: -peak.value)
        found = (found + 3 * found[-1:])[:3]
        return 20 * np.array([p.value for p in found]), 20 * np.array([p.slopes * start * np.exp(x) for p in found])

    below = {"type": "ineq", "fun": lambda y: y[-1] - peaks(y[:-1])[0],
             "jac": lambda y: np.column_stack([-peaks(y[:-1])[1], np.ones(3)])}  # fmt: skip
    best = minimize(lambda y: y[-1], [*np.zeros(4), 1.1], jac=lambda y: np.eye(5)[-1], constraints=below, method="SLSQP")
    w = np.linspace(0.5, 1.6, 4001)

    def largest(x):
        return amplitude(start * np.exp(x), w).max()

    assert largest(best.x[:-1]) == pytest.approx(best.fun / 20, rel=1e-4) and largest(best.x[:-1]) < 0.91 * largest(np.zeros(4))
    np.testing.assert_allclose(peaks(best.x[:-1])[0], best.fun, rtol=1e-3)  # all of them equally high
    least = minimize(largest, best.x[:-1], method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-10, "maxfev": 2000})
    assert least.fun > (1 - 1e-4) * largest(best.x[:-1])


def wheel(n=6, order=2):
    names = [f"b{i + 1}" for i in range(n)]
    ring = 2 * np.eye(n) - np.roll(np.eye(n), 1, 0) - np.roll(np.eye(n), -1, 0)
    model = nhbm.Model(nhbm.Matrices(mass=np.eye(n), stiffness=np.eye(n) + 0.1 * ring, damping=0.05 * np.eye(n), labels=names),
                       tones=[0.9])  # fmt: skip
    model.engine_order(names, order, amplitude=0.5)
    return model, names


@pytest.mark.parametrize("order", [2, -1, 3, 7])
def test_an_engine_order_excites_its_nodal_diameter(order):
    """All blades of a tuned wheel move alike, with the stiffness of that wave and the phase of their sector."""
    model, names = wheel(order=order)
    motion = model.solve(order=1)
    stiffness = 1 + 0.1 * 4 * np.sin(np.pi * order / 6) ** 2
    expected = 0.5 / (stiffness - 0.81 + 0.05j * 0.9) * np.exp(-2j * np.pi * order * np.arange(6) / 6)
    np.testing.assert_allclose([complex(motion.nhbm.harmonic(name)) for name in names], expected, rtol=1e-9)


def test_an_engine_order_needs_sectors():
    with pytest.raises(ModelError, match="of each of several sectors"):
        wheel()[0].engine_order("b1", 1, 1.0)
    with pytest.raises(ModelError, match="order must be a whole number"):
        wheel()[0].engine_order(["b1", "b2"], 1.5, 1.0)


def test_the_largest_of_many_is_a_response():
    """In datasets and sweeps, of amplitudes, root mean squares and largest displacements; its gradient is that of the largest."""
    model, names = wheel()
    model.law("polynomial", "b4", stiffness=[-0.2], label="soft")
    points = model.sweep({"tones[0]": [0.8, 0.9, 1.1]}, order=1)
    for of, each in (("b* (1)", [points.nhbm.amplitude(name) for name in names]), ("b*", [points.nhbm.response(n) for n in names]),
                     ("max b*", [points.nhbm.largest(name) for name in names])):  # fmt: skip
        largest = points.nhbm.response(of)
        np.testing.assert_allclose(largest, np.max(each, axis=0), rtol=1e-12)
        assert largest.attrs == {"long_name": f"Largest of {of}", "units": "m"}
    numbers = model.sweep({"tones[0]": [0.8, 0.9, 1.1]}, of="b* (1)", order=1)
    np.testing.assert_allclose(numbers["response"], points.nhbm.response("b* (1)"), rtol=1e-9)
    assert "b* (1)" in points.nhbm.to_dataframe("b* (1)") and numbers["response"].attrs["units"] == "m"
    points.nhbm.plot("b* (1)")
    alone = max(names, key=lambda name: model.response(f"{name} (1)", order=1))
    one, other = (model.gradient(of, ["soft.stiffness[0]"], order=1) for of in ("b* (1)", f"{alone} (1)"))
    assert one.value == pytest.approx(other.value, rel=1e-9) and one.slopes[0] == pytest.approx(other.slopes[0], rel=1e-9)
    with pytest.raises(ModelError, match=r"no degree of freedom matches 'c\*'; known: b1, b2"):
        points.nhbm.response("c* (1)")
    beam = nhbm.Beam(length=1.0, bending_stiffness=1.0, mass_per_length=1.0, n_elements=2, left_support="clamped",
                     right_support="free", damping_mass=0.1)  # fmt: skip
    tip = nhbm.Model(beam, tones=[1.0])
    tip.load("v3", 1, cos=1.0)
    with pytest.raises(ModelError, match="compares displacements with rotations"):
        tip.solve(order=1).nhbm.response("* (1)")


def test_fits_show_how_far_they_are():
    """A function gets the number of evaluations and the misfit, which falls."""
    model = nhbm.Model(nhbm.Matrices(1.0, 1.0, 0.1), tones=[1.0])
    model.load("x1", 1, cos=0.1)
    omega = np.linspace(0.8, 1.2, 9)
    data = {"frequency": omega, "amplitude": 0.1 / abs(1.21 - omega**2 + 0.2j * omega)}
    seen = []
    nhbm.fit(model, data, ["structure.stiffness[0]", "structure.damping[0]"], "x1 (1)", order=1, noise=0.01,
             progress=lambda n, misfit: seen.append((n, misfit)))  # fmt: skip
    assert [n for n, _ in seen] == list(range(1, len(seen) + 1)) and seen[-1][1] < 1e-6 < seen[0][1]
    with pytest.raises(ModelError, match="progress must be True, False or a function"):
        nhbm.fit(model, data, ["structure.stiffness[0]"], "x1 (1)", order=1, progress="yes")


@pytest.mark.long
def test_a_point_of_a_backbone_costs_a_few_solutions(monkeypatch):
    """The force that holds a controlled amplitude is sought from the motion before, not along a curve for each point; the fit
    leaves the load as it was."""
    from nhbm.session import Session

    k3, damping = 0.5, 0.02
    amplitude = np.linspace(0.1, 0.8, 12)
    omega = np.sqrt(1.0 + 0.75 * k3 * amplitude**2)
    data = {"frequency": omega, "amplitude": amplitude, "load[0].cos": damping * omega * amplitude, "phase": 0 * omega - np.pi / 2}
    model = nhbm.Model(nhbm.Matrices(1.0, 0.98, 0.025), tones=[1.0])
    model.load("x1", 1, cos=0.01)
    model.law("cubic_spring", "x1", stiffness=0.4, label="spring")
    curves, begin = [], Session.begin_curve
    monkeypatch.setattr(Session, "begin_curve", lambda self: (curves.append(1), begin(self)))
    evaluations = []
    found = nhbm.fit(model, data, ["structure.stiffness[0]", "structure.damping[0]", "spring.stiffness"], "x1 (1)", order=1,
                     controlled=True, progress=lambda n, _: evaluations.append(n))  # fmt: skip
    np.testing.assert_allclose(found.values, [1.0, damping, k3], rtol=1e-4)
    assert len(curves) < 0.5 * len(evaluations) * len(omega) and found.model["load[0].cos"] == 0.01
