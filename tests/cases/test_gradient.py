"""Derivatives of motions with respect to values of the input, from Python and in files."""

import time

import h5py
import numpy as np
import pytest

from in_process import ROOT
from program import messages_of, run, solve

import nhbm


def damper(limit=0.035):
    chain = nhbm.Chain(n_masses=2, ends="fixed-free", mass=[1.0, 0.1], coupling_stiffness=[1.0, 0.05], damping_mass=0.01)
    model = nhbm.Model(chain, tones=[0.95])
    model.load("x1", 1, cos=0.1)
    model.law("jenkins", label="damper", dofs=["x2", "x1"], weights=[1, -1], stiffness=0.1, limit=limit)
    return model


def test_derivatives_by_default_are_those_of_the_motion():
    """On the samples that the motion needs they would be -1.12 and -.15 here."""
    by = ["damper.limit", "damper.stiffness"]
    found = damper().gradient("x1 (1)", by)
    fine = damper()
    fine.set("sampling", samples=4096)
    exact = fine.gradient("x1 (1)", by, order=31)
    assert found.value == pytest.approx(exact.value, rel=1e-2)
    np.testing.assert_allclose(found.slopes, exact.slopes, atol=0.05)
    assert exact.slopes[0] == pytest.approx(-0.308, abs=2e-3)


def test_a_harmonic_that_is_not_in_the_set_has_no_derivative():
    with pytest.raises(nhbm.ModelError, match="x1 .40.': the set of harmonics does not have this tuple"):
        damper().gradient("x1 (40)", ["damper.limit"], order=5)


DUFFING = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.05, stiffness = 1.0 /
&tones frequency = 1.2 /
&harmonics order = 5, symmetry = 'none' /
&load dof = 'x1', tuple = 1, cos = 0.18 /
&law type = 'cubic_spring', label = 'c', dof = 'x1', stiffness = 1.0 /
&gradient by = 'law(c)%stiffness', of = '{}' /
"""


def test_a_response_without_derivative_is_named(tmp_path):
    """A file lacked the derivative and said nothing, both for a harmonic that its set does not have and for one that is zero."""
    (tmp_path / "case.nml").write_text(DUFFING.format("x1 (9)"))
    refused = run("solve", "case.nml", cwd=tmp_path)
    assert refused.status == 2
    assert "case.nml:7: &gradient: of: 'x1 (9)': the set of harmonics does not have this tuple" in refused.stderr
    zero = solve(DUFFING.format("x1 (2)"), tmp_path)
    assert "no derivatives: 'x1 (2)' is zero, or not in the set of harmonics" in messages_of(zero)
    path = solve(DUFFING.format("x1 (3)"), tmp_path)
    assert "no derivatives" not in messages_of(path)
    with h5py.File(path) as file:
        assert abs(file["response_gradient"][0, 0]) > 0.0


@pytest.mark.long
def test_responses_have_the_derivatives_of_differences():
    model = nhbm.Model(nhbm.Chain(n_masses=2, ends="free", mass=1.0, coupling_stiffness=2.0, ground_stiffness=1.0,
                                  damping_mass=0.1),
                       tones=[1.3, 2.1])  # fmt: skip
    model.load("x1", (1, 0), cos=0.8)
    model.load("x2", (0, 1), cos=0.3)
    model.law("elastic_stop", "x2", gap=0.3, stiffness=3.0, label="stop")
    values = {"stop.gap": 0.3, "stop.stiffness": 3.0, "load(1)%cos": 0.8}
    model.set("stability", method="off")
    model.set("gradient", by=["law(stop)%gap", "law(stop)%stiffness", "load(1)%cos"])
    motion = model.solve(order=5)
    largest, of_dataset = motion.nhbm.gradient("max x2").values, motion.nhbm.gradient("x2").values
    for of in ("x2", "x2 (1,0)"):
        found = model.gradient(of, values, order=5)
        for k, (path, value) in enumerate(values.items()):
            sides = []
            for side in (1e-4, -1e-4):
                model[path] = value + side
                sides.append((model.response(of, order=5), float(model.solve(order=5).nhbm.largest("x2"))))
                model[path] = value
            by_response, by_largest = (np.array(sides[0]) - sides[1]) / 2e-4
            assert found.slopes[k] == pytest.approx(by_response, rel=1e-6)
            assert of != "x2" or of_dataset[k] == pytest.approx(by_response, rel=1e-6)
            assert largest[k] == pytest.approx(by_largest, rel=1e-3)


def test_files_have_derivatives(tmp_path):
    path = solve((ROOT / "inputs" / "gallery" / "damper_gradient.nml").read_text(), tmp_path)
    with h5py.File(path) as file:
        assert [name.decode() for name in file["gradient_value"][()]] == ["law(damper)%limit", "law(damper)%stiffness"]
        assert file["gradient"].shape[:3] == (9, 2, 2)
        limit, motion, slope = file["law_damper_limit"][()], file["coefficients"][:, 0, 1], file["gradient"][:, 0, 0, 1]
        assert (file["gradient_estimate"][()] < 1e-2).all()
        assert (file["gradient_defect"][()] < 1e-3).all()
    amplitude = np.linalg.norm(motion, axis=1)
    along = np.trapezoid if hasattr(np, "trapezoid") else np.trapz
    assert along((slope * motion).sum(axis=1) / amplitude, limit) == pytest.approx(amplitude[-1] - amplitude[0], rel=0.05)


def test_derivatives_by_many_values_are_those_by_each():
    """Under two tones, with memory: several values share the factors of the tangent, one is solved from products."""
    chain = nhbm.Chain(n_masses=3, mass=1.0, coupling_stiffness=1.0, damping_mass=0.1, ends="fixed")
    model = nhbm.Model(chain, tones=[0.7, 0.4321])
    model.load("x1", (1, 0), cos=0.5)
    model.load("x3", (0, 1), cos=0.4)
    for k in (1, 2, 3):
        model.law("jenkins", f"x{k}", label=f"joint{k}", stiffness=1.0, limit=0.1)
    names = ["law(joint1)%limit", "law(joint2)%limit", "law(joint3)%stiffness"]
    model.set("stability", method="off")

    def slopes(by):
        model.set("gradient", by=by)
        return model.solve(order=5).gradient.values

    together = slopes(names)
    for k, name in enumerate(names):
        (alone,) = slopes([name])
        assert together[k] == pytest.approx(alone, abs=1e-5 * np.abs(alone).max())


def test_values_without_derivatives_are_refused():
    for path, reason in (
        ("damper.gap", "unknown key 'gap'"),
        ("harmonics%order", "not a number of &structure"),
        ("load(1)%dof", "has no number"),
    ):
        with pytest.raises(nhbm.ModelError, match=reason):
            damper().gradient("x1 (1)", [path])


def on_a_bearing(middle=0.6):
    model = nhbm.Model(nhbm.Jeffcott(mass=1.0, stiffness=0.5, damping=0.1), tones=[0.8])
    table = [0.5, 0.0, 0.0, 0.5, middle, 0.1, -0.1, 0.6, 0.9, 0.0, 0.0, 0.9]
    model.bearing(["x", "y"], [0.1, 1.0, 3.0], table, speed=0.8, label="b")
    model.load("x", 1, cos=0.3)
    model.law("cubic_spring", "x", stiffness=0.5)
    return model


def test_elements_of_tables_have_derivatives():
    found = on_a_bearing().gradient("x (1)", ["bearing(b)%stiffness(2, 1)"], order=5)
    step = 1e-5
    sides = [on_a_bearing(0.6 + change).response("x (1)", order=5) for change in (step, -step)]
    assert found.slopes[0] == pytest.approx((sides[0] - sides[1]) / (2 * step), rel=1e-6)


@pytest.mark.parametrize(("path", "advice"), [("stiffness(5)", "is an element of a matrix; write stiffness.2, 1."),
                                              ("speeds", "is a list; its elements have one index, like speeds.2."),
                                              ("speeds(1, 2)", "is a list; its elements have one index")])  # fmt: skip
def test_an_element_needs_its_indices(path, advice):
    with pytest.raises(nhbm.ModelError, match=advice):
        on_a_bearing().gradient("x (1)", [f"bearing(b)%{path}"], order=5)


def test_a_value_that_cannot_change_by_itself_is_named():
    matrices = nhbm.Matrices(np.array([[1.0, 0.1], [0.1, 1.0]]), 2 * np.eye(2), 0.1 * np.eye(2))
    model = nhbm.Model(matrices, tones=[1.0])
    model.load("x1", 1, cos=0.5)
    model.law("cubic_spring", "x1", stiffness=1.0)
    with pytest.warns(nhbm.NotConverged, match="structure%mass.2. cannot change by itself: .*symmetric"):
        assert np.isnan(model.gradient("x1 (1)", ["structure%mass(2)"], order=5).slopes).all()


def test_motions_by_time_integration_have_none():
    model = damper()
    model.set("solver", primary_method="integration")
    motion = model.solve(order=9)
    assert motion["status"] == "integrated"
    model.set("gradient", by=["law(damper)%limit"])
    assert "gradient" not in model.solve(order=9)


def test_peaks_have_derivatives():
    """Of the largest response and its frequency: a damper, and an oscillator that strikes its stop."""
    cases = ((damper(), "damper.limit", 0.035, (0.8, 1.1)), (stopped(), "stop.gap", 0.3, (0.9, 1.5)))
    for model, value, at, ends in cases:
        found = model.peak_gradient("x1 (1)", [value], "tones[0]", *ends, order=7)
        by_value, by_place = slopes_of_a_peak(model, value, at, 1e-3, ends)
        assert found.slopes[0] == pytest.approx(by_value, rel=1e-3)
        if value == "stop.gap":
            assert found.at_slopes[0] == pytest.approx(by_place, rel=1e-3)


def slopes_of_a_peak(model, value, at, step, ends):
    """Differences of the largest response and of its frequency."""
    sides = []
    for side in (1 + step, 1 - step):
        model[value] = side * at
        sides.append(model.peak("x1 (1)", "tones[0]", *ends, order=7))
    model[value] = at
    return (np.array(sides[0]) - sides[1]) / (2 * step * at)


@pytest.mark.long
def test_the_position_of_a_peak_does_not_follow_single_samples():
    """Stick begins and ends at samples: differences over many of them, for the rest the coarser grid would be wrong by half."""
    model, ends = damper(), (0.8, 1.1)
    found = model.peak_gradient("x1 (1)", ["damper.limit"], "tones[0]", *ends, order=7)
    model.set("sampling", samples=3000)
    assert found.at_slopes[0] == pytest.approx(slopes_of_a_peak(model, "damper.limit", 0.035, 4e-2, ends)[1], rel=3e-2)


def stopped():
    chain = nhbm.Chain(n_masses=2, ends="fixed-free", mass=1.0, coupling_stiffness=1.0, damping_mass=0.05)
    model = nhbm.Model(chain, tones=[0.3])
    model.load("x1", 1, cos=0.4)
    model.law("elastic_stop", "x2", stiffness=3.0, gap=0.3, label="stop")
    return model


@pytest.mark.long  # seconds
def test_folds_and_bifurcations_move_with_a_value():
    """Flips, a fold and tori of two masses and a stop, against those of two other gaps."""

    def curve(gap, **groups):
        model = stopped()
        model["stop.gap"], model["tones[0]"] = gap, 0.45
        for name, keys in groups.items():
            model.set(name, **keys)
        found = model.curve("tones[0]", 0.45, 0.3, order=7)
        return found.isel(point=np.isin(found["curve_kind"], ("fold", "period_doubling", "neimark_sacker")))

    here, above, below = curve(0.3, gradient={"by": ["law(stop)%gap"]}), curve(0.3001), curve(0.2999)
    kinds = here["curve_kind"].values
    assert set(kinds) == {"fold", "period_doubling", "neimark_sacker"}
    assert (kinds == above["curve_kind"].values).all() and (kinds == below["curve_kind"].values).all()
    differences = (above["tones_frequency"].values - below["tones_frequency"].values) / 2e-4
    np.testing.assert_allclose(here["position_gradient"].values[:, 0], differences, rtol=2e-3)
    np.testing.assert_allclose(here["frequency_gradient"].values[:, 0, 0], here["position_gradient"].values[:, 0], rtol=1e-9)


@pytest.mark.long  # seconds
def test_a_hundred_derivatives_are_those_of_differences():
    """For a chain of 50 masses with a stop at each, with respect to the gaps and stiffnesses of all; prints their cost (pytest
    -s)."""
    model = nhbm.Model(
        nhbm.Chain(n_masses=50, ends="fixed-free", mass=1.0, coupling_stiffness=100.0, damping_mass=0.02), tones=[1.0]
    )
    model.load("x50", 1, cos=0.1)
    for k in range(1, 51):
        model.law("elastic_stop", f"x{k}", gap=0.01 + 0.001 * k, stiffness=5.0, label=f"stop{k}")
    by = [f"stop{k}.{key}" for k in range(1, 51) for key in ("gap", "stiffness")]
    began = time.process_time()
    model.response("x50 (1)", order=5)
    from_rest = time.process_time()
    model.gradient("x50 (1)", by, order=5)
    with_set_up = time.process_time()
    slopes = dict(zip(by, model.gradient("x50 (1)", by, order=5).slopes))
    print(f"motion {from_rest - began:.2f} s, again with 100 derivatives {time.process_time() - with_set_up:.2f} s")
    for path, value in (("stop50.gap", 0.06), ("stop41.stiffness", 5.0)):
        sides = []
        for step in (1e-5, -1e-5):
            model[path] = value * (1 + step)
            sides.append(model.response("x50 (1)", order=5))
        model[path] = value
        assert slopes[path] == pytest.approx((sides[0] - sides[1]) / (2e-5 * value), rel=1e-4, abs=1e-7), path


def forced(law, tones, **groups):
    chain = nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.05)
    model = nhbm.Model(chain, tones=tones, stability={"method": "off"}, **groups)
    model.load("x1", [1, 0][: len(tones)], cos=0.4)
    model.law(law["type"], "x1", **{key: value for key, value in law.items() if key != "type"})
    return model


def transfer(law, slope, signals):
    """Responses at the frequencies of small signals, by Hill's matrix of the equation linearised about a motion of order 60."""
    motion = forced(law, [0.9], sampling={"samples": 4096}).solve(order=60)
    j, n = np.arange(-40, 41), 8192
    tau = 2 * np.pi * np.arange(n) / n
    x = sum(c * np.cos(h * tau) + s * np.sin(h * tau) for h, (c, s) in enumerate(motion["coefficients"].values[0]))
    k = np.fft.fft(slope(x)) / n
    responses = []
    for signal in signals:
        w = 0.9 * j + signal
        hill = np.diag(1 - w**2 + 0.05j * w) + k[(j[:, None] - j[None, :]) % n]
        responses.append(np.linalg.solve(hill, j == 0)[40])
    return responses


@pytest.mark.parametrize(
    ("law", "slope"),
    [
        ({"type": "cubic_spring", "stiffness": 0.1}, lambda x: 0.3 * x**2),
        ({"type": "elastic_stop", "stiffness": 5.0, "gap": 0.5}, lambda x: 5.0 * (x > 0.5)),
    ],
)
def test_response_to_a_small_signal_is_that_of_the_linearised_equation(law, slope):
    """The load of the signal is zero, and the motion has none of the tuples that it would excite: with its own set the error would
    be one half."""
    signals = [0.11, 0.53, 1.02, 1.97]
    model = forced(law, [0.9, signals[0]])
    model.load("x1", (0, 1), cos=0.0)
    model.set("gradient", by=["load(2)%cos"])
    found = model.sweep({"tones%frequency(2)": signals})
    for point, exact in enumerate(transfer(law, slope, signals)):
        motion = found.isel(point=point)
        place = [tuple(row) for row in motion["tuples"].values].index((0, 1))
        c, s = motion["gradient"].values[0, 0, place]
        assert abs(c - 1j * s - exact) < 1e-2 * abs(exact)
        assert motion["gradient_estimate"] < 1e-2


def test_a_limit_cycle_responds_to_a_small_signal():
    responses = {}
    for amplitude in (0.0, 1e-3, -1e-3):
        chain = nhbm.Chain(n_masses=1, ends="fixed-free", mass=1.0, coupling_stiffness=1.0, damping_mass=0.0)
        model = nhbm.Model(chain, tones=[1.0, 0.41], stability={"method": "off"})
        model.set("tones", unknown=[True, False])
        model.load("x1", (0, 1), cos=amplitude)
        model.law("van_der_pol", "x1", strength=0.5)
        model.set("gradient", by=["load(1)%cos"])
        motion = model.solve()
        place = [tuple(row) for row in motion["tuple"].values].index((0, 1))
        responses[amplitude] = motion["coefficients"].values[0, place], motion["gradient"].values[0, 0, place]
    np.testing.assert_allclose(responses[0.0][1], (responses[1e-3][0] - responses[-1e-3][0]) / 2e-3, atol=1e-3)
