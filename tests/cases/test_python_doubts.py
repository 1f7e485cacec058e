"""What Python says about a model or a motion that is doubtful: warnings, in the words of the command, and what is no warning."""

from __future__ import annotations

import re
import warnings

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from in_process import duffing, shaft, stopped

import nhbm
from nhbm import Implausible, Model, NotConverged


def test_bifurcating_motions_that_are_not_followed_are_named():
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.2, stiffness=1.0), tones=[1.0])
    model.load("x1", 1, cos=3.0)
    model.law("cubic_spring", "x1", stiffness=1.0)
    model.law("elastic_stop", "x1", stiffness=10.0, gap=0.5)
    with pytest.warns(nhbm.NotConverged, match=r"not the motions that bifurcate at the point \d+ \(period_doubling\)"):
        curve = model.curve("load[0].cos", 5.5, 6.5, switch=True, tolerance=1e-3)
    assert "switch = .true." in curve.nhbm.input


def test_operations_of_an_input_are_left_out_with_their_calls():
    text = duffing().to_namelist()
    path = "tones%frequency"
    for groups, call in (
        ("&sweep parameter = 'law(spring)%stiffness', values = 1, 2 /\n"
         "&sweep parameter = 'tones%frequency', from = 1, to = 2, n = 3 /\n",
         f"model.sweep({{'law(spring)%stiffness': [1.0, 2.0], '{path}': np.linspace(1.0, 2.0, 3)}})"),
        (f"&sweep parameter = '{path}', values = 1, 2, axis = 1 /\n&sweep parameter = 'load(1)%cos', values = 1, 2, axis = 1 /\n",
         f"model.sweep({{'{path}': [1.0, 2.0], 'load(1)%cos': [1.0, 2.0]}}, paired=True)"),
        ("&sweep parameter = 'load(1)%cos', values = 1, 2 /\n"
         f"&curve parameter = '{path}', from = 1, to = 2, start = 1.5, points = 30, peak_of = 'x1' /\n",
         f"model.curve('{path}', 1.0, 2.0, first=1.5, points=30, peak_of='x1')"),
    ):  # fmt: skip
        names = " and ".join(sorted(set(re.findall(r"&\w+", groups)), reverse=True))
        with pytest.warns(Implausible, match=re.escape(f"model: a model leaves out {names} of an input; call {call}")) as issued:
            model = Model.from_namelist(text + groups)
        assert len(issued) == 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotConverged)
            assert eval(call, {"model": model, "np": np}).sizes["point"] > 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Model.from_namelist(text)


def test_a_tolerance_beside_given_harmonics_is_named():
    model = duffing()
    model.set("harmonics", order=9)
    model.set("accuracy", tolerance=1e-3)
    with pytest.warns(Implausible, match="the harmonics are given, so that accuracy%tolerance chooses the samples alone"):
        model.solve()
    model.set("harmonics", order=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.solve()


@pytest.mark.parametrize("tones, hint", [
    ([10.0], r"is the tone of 10.0 rad/s given in Hz\? A natural frequency is 10.0 Hz"),
    ({"hertz": 62.8}, r"is the tone of 62.8 Hz given in rad/s\? A natural frequency is 62.8 rad/s"),
    ([70.0], "lengths and loads$"),
    ([1000.0], "lengths and loads$"),
])  # fmt: skip
def test_a_stop_that_is_not_reached_may_have_a_tone_in_the_other_unit(tones, hint):
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=30.0, stiffness=(20 * np.pi) ** 2), tones=tones)
    model.load("x1", 1, cos=1.0)
    model.law("elastic_stop", "x1", stiffness=1e4, gap=0.01, label="stop")
    with pytest.warns(Implausible, match=hint) as warned:
        model.solve(order=1)
    assert any("law 'stop' exerts no force" in str(one.message) for one in warned)


def test_tones_with_a_common_period_are_implausible():
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[1.0, 2.0])
    model.load("x1", (1, 0), cos=0.3)
    model.load("x1", (0, 1), cos=0.1)
    model.law("cubic_spring", "x1", stiffness=0.5)
    with pytest.warns(Implausible, match="use one tone of 1.0 rad/s instead of both") as warned:
        model.solve(order=3)
    assert not any(issubclass(one.category, NotConverged) for one in warned)


def test_a_law_that_pushes_away_from_rest_is_named():
    """Forces stand on the left-hand side: that of a spring is positive. Laws with a mean force, and of several kinds, are judged by
    their change."""
    wrong = [lambda q: -0.01 * q**3, lambda q, v, p: v - p[0] * q, lambda q, v: -0.05 * v, lambda q, v: 0.1 * q - 0.01 * np.tanh(v),
             lambda q: (-0.1 * np.sin(q), -0.1 * np.cos(q)),
             lambda q: 0.1 - 0.1 * q]  # fmt: skip
    right = [lambda q: 0.5 * q**3, lambda q, v, p: p[0] * np.sinh(q) + v, lambda q: np.maximum(q - 0.5, 0.0),
             lambda v, q: 0.1 * v, lambda q: 0.1 * q - 0.01 * q**3, lambda q, v: 0.01 * (q**2 - 1.0) * v,
             lambda q, v: 0.01 * (v**3 - v)]  # fmt: skip
    def solved_with(law):
        model = duffing()
        model.law(law, "x1", parameters=[0.1])
        model.response("x1", order=1)
        model.response("x1", order=1)

    for law in wrong:
        with pytest.warns(Implausible, match="drives 'x1' away from rest") as warned:
            solved_with(law)
        assert sum("away from rest" in str(one.message) for one in warned) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", Implausible)
        for law in right:
            solved_with(law)


def test_all_operations_say_what_is_doubtful_in_the_same_words():
    """With the estimates, their limits and what to do; once."""
    words = r"(?s)estimated error .* by truncation .limit 0.01.\n.* by aliasing .limit 0.01.\n.*With this order: "
    for operation in (
        lambda m: m.solve(order=3),
        lambda m: m.response("x1 (1)", order=3),
        lambda m: m.gradient("x1 (1)", ["law[0].gap"], order=3),
        lambda m: m.sweep({"tones[0]": [0.9, 0.95]}, order=3),
        lambda m: m.sweep({"tones[0]": [0.9, 0.95]}, of="x1 (1)", order=3),
        lambda m: m.curve("tones[0]", 0.9, 0.95, order=3),
    ):
        with pytest.warns(NotConverged, match=words) as warned:
            operation(stopped())
        assert len(warned) == 1 and warned[0].filename == __file__
    with pytest.warns(NotConverged, match=r"of 2 points 2 aliased. The first: aliased"):
        stopped().sweep({"tones[0]": [0.9, 0.9]}, warm=True, order=3)


def test_tones_with_a_common_period_are_named():
    """The command warned of them, Python advised a higher order."""
    model = Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.8, 0.8])
    model.load("x1", (1, 0), cos=0.1)
    model.law("cubic_spring", "x1", stiffness=0.5)
    words = r"tones 0.8 and 0.8 rad/s: their combination \(1,-1\) has the frequency 0; use one tone of 0.8 rad/s"
    for operation in (
        lambda: model.solve(order=3),
        lambda: model.response("x1 (1,0)", order=3),
        lambda: model.sweep({"load[0].cos": [0.1, 0.11]}, order=3),
    ):
        with pytest.warns(Implausible, match=words):
            operation()
    model["tones[1]"] = 0.1131370849898476
    with warnings.catch_warnings():
        warnings.simplefilter("error", NotConverged)
        model.solve(tolerance=1e-2)


def test_rigid_body_modes_of_a_reduction_are_not_doubted():
    """Their stiffness is zero but for rounding, which was called negative."""
    model = Model(nhbm.Matrices(mass=[[1.0, 0.0], [0.0, 1.0]], stiffness=[[-1e-4, 0.0], [0.0, 1e9]]), tones=[0.9])
    assert not any("negative" in text for text in model.check())
    model = Model(nhbm.Matrices(mass=[[1.0, 0.0], [0.0, 1.0]], stiffness=[[-1.0, 0.0], [0.0, 1e9]]), tones=[0.9])
    assert any("the stiffness of 'x1' is negative" in text for text in model.check())


def test_a_shaft_in_millimetres_is_doubted():
    with pytest.warns(Implausible, match="shaft 'shaft': diameter = 20 m; lengths are in metres"):
        nhbm.Rotor().shaft([0.0, 500.0], diameter=20.0)


@pytest.mark.parametrize("cross", [0.0, 1e5])
def test_damping_of_bearings_with_unequal_cross_stiffness_is_not_doubted(cross):
    """Their damping is positive definite, whatever their stiffness; a negative one is doubted."""
    stiffness, damping = [[3e6, cross], [-0.6 * cross, 2.2e6]], np.array([[2500.0, 100.0], [100.0, 1800.0]])
    for indefinite in (False, True):
        rotor = nhbm.Rotor()
        rotor.shaft(np.linspace(0.0, 0.9, 4), 0.035)
        rotor.disk(0.3, mass=12.0, diametral=0.05, polar=0.09)
        for z in (0.0, 0.9):
            table = [damping + indefinite * np.array([[0.0, 3000.0], [3000.0, 0.0]])] * 2
            rotor.bearing(z, [stiffness] * 2, table, speeds=[50.0, 500.0])
        rotor.unbalance(0.3, 1e-5)
        told = [text for text in rotor.model(speed=100.0).check() if "damping matrix" in text]
        assert len(told) == indefinite


def test_a_law_of_several_coordinates_may_act_on_one():
    """Its single degree of freedom was refused as `dof`."""
    model, same = duffing(spring=True), duffing(spring=True)
    model.law("cubic_damping", "x1", coefficient=0.3)
    same.law("cubic_damping", ["x1"], coefficient=0.3)
    assert model.response("x1 (1)", order=3) == same.response("x1 (1)", order=3)


def test_a_wrong_derivative_of_a_law_is_said():
    model = duffing(spring=True)
    model.law(lambda q: (0.5 * q**3, 0.5 * q**2), "x1", label="mine")
    with pytest.warns(NotConverged, match="law 'mine': df/dz is not the derivative of its force"):
        model.solve(order=5)
    right = duffing(spring=True)
    right.law(lambda q: (0.5 * q**3, 1.5 * q**2), "x1")
    with warnings.catch_warnings():
        warnings.simplefilter("error", NotConverged)
        right.solve(order=5)


def test_a_model_without_mass_is_solved_in_silence(capfd):
    """There is no matrix whose eigenvalues LAPACK could find."""
    model = Model(nhbm.Chain(n_masses=1, mass=0.0, coupling_stiffness=1.0), tones=[0.9])
    model.load("x1", 1, cos=0.1)
    model.law("elastic_stop", "x1", stiffness=1.0, gap=0.01)
    with pytest.warns(UserWarning, match="all masses and dampings of the structure are zero"):
        assert model.solve(order=9)["n_harmonics"] == 10
    assert capfd.readouterr() == ("", "")


@pytest.mark.long
def test_a_law_that_is_wrongly_declared_odd_is_named():
    """Its motion has no even harmonics, whatever the tolerance; also where its derivatives are right."""
    model = duffing(spring=True)
    model.law(nhbm.law(lambda q: 0.2 * q**2, odd=True), "x1", label="mine")
    words = r"law 'mine': it is declared odd, but f.-z, -v. is not -f.z, v."
    for operation in (lambda: model.solve(order=5), lambda: model.curve("tones[0]", 0.5, 0.51, order=5)):
        model.set("sampling", samples=64)  # a new session
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            operation()
        assert any(re.search(words, str(one.message)) for one in warned)
    right = duffing(spring=True)
    right.law(nhbm.law(lambda q, v: 0.2 * np.abs(q) * q + 0.1 * v, odd=True), "x1")
    with warnings.catch_warnings():
        warnings.simplefilter("error", NotConverged)
        right.solve(order=5)


def test_a_resonance_is_named_by_its_frequency():
    model = Model(nhbm.Matrices(mass=1.0, stiffness=9.0), tones=[1.0])
    model.load("x1", 1, cos=0.1)
    with pytest.warns(NotConverged, match="singular at the frequency 3.0 rad/s: an undamped resonance"):
        model.solve(order=3)


@pytest.mark.parametrize("n", [4, 400])
def test_rows_that_a_file_keeps_empty_are_named(n):
    """The rows of constrained nodes: the structure has supports, and no rigid body motion."""
    stiffness = sp.diags([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], [-1, 0, 1]).tolil()
    mass = sp.identity(n, format="lil")
    for matrix in (stiffness, mass):
        matrix[[1, 3], :] = 0.0
        matrix[:, [1, 3]] = 0.0
    model = Model(nhbm.Structure(mass, stiffness, damping=0.01 * stiffness), tones=[1.0])
    model.load("x1", 1, cos=1.0)
    with pytest.warns(NotConverged, match="'x2', the first of 2, has neither mass nor stiffness, .*--drop-empty"):
        model.solve(order=3)


def test_checks_before_a_solution():
    model = Model(nhbm.Matrices(mass=[[2.0]], stiffness=[[8.0]]), tones=[0.9, 1.8])
    assert model.natural_frequencies() == pytest.approx([2.0])
    found = model.check()
    assert any("combination (2,-1)" in text for text in found) and any("no load acts" in text for text in found)
    structure = nhbm.Structure(np.eye(200), np.diag(np.arange(1.0, 201.0) ** 2))
    assert Model(structure, tones=[0.9]).natural_frequencies(3) == pytest.approx([1.0, 2.0, 3.0])


def stop_at(gap, **keys):
    model = duffing(spring=True)
    model.law("elastic_stop", "x1", stiffness=2.0, gap=gap, label="stop", **keys)
    return model


def test_a_stop_that_no_motion_reaches_is_named():
    words = "law 'stop' exerts no force: no motion reaches it"
    for operation in (
        lambda m: m.solve(order=9),
        lambda m: m.curve("tones[0]", 0.5, 0.9, order=9, max_step=0.2),
        lambda m: m.sweep({"tones[0]": [0.8, 0.9]}, order=9),
        lambda m: m.sweep({"tones[0]": [0.8, 0.9]}, of="x1 (1)", order=9),
        lambda m: [m.response("x1 (1)", order=9) for _ in range(2)],
        lambda m: m.gradient("x1 (1)", ["load[0].cos"], order=9),
    ):
        with pytest.warns(Implausible, match=words) as warned:
            operation(stop_at(50.0))
        assert len(warned) == 1 and warned[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", Implausible)
        stop_at(0.5).solve(order=9)
        stop_at(0.5).curve("tones[0]", 0.1, 0.9, order=9, max_step=0.2)  # it is reached at some points
        stop_at(0.5).sweep({"tones[0]": [0.1, 0.9]}, order=9)
        duffing(spring=True).solve(order=3)


def pair_with(coupling):
    model = Model(nhbm.Matrices(n_dofs=2, mass=np.eye(2), stiffness=[[2.0, coupling], [0.0, 1.0]]), tones=[0.9])
    model.load("x1", 1, cos=1.0)
    return model


@pytest.mark.parametrize("made, words", [
    (lambda: stop_at(1500.0), "gap = 1500.0 m; lengths are in metres"),
    (lambda: stop_at(-0.1), "gap = -0.1 m is negative: in contact and preloaded at rest"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones={"hertz": 50.0}), "more than 50 times the highest natural frequency, 0.1592 Hz"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[0.5]), "no load acts"),
    (lambda: driven(1.0, -0.1, 1.0), "damping of 'x1' is negative, -0.1 N s/m: energy is fed into vibrations; unless the"),
    (lambda: driven(1.0, 0.1, -1.0), "stiffness of 'x1' is negative, -1.0 N/m: the equilibrium is unstable"),
    (lambda: pair_with(0.3), "'x1' and column 'x2', 0.3, and none of row 'x2' and column 'x1': unless the coupling is to act in"),
    (lambda: driven(1e4, 0.1, 1.0), "more than 50 times the highest natural frequency, 0.01 rad/s"),
    (lambda: driven(1e-6, 0.1, 1.0), "lowest natural frequency, 1000.0 rad/s, is more than 50 times the tone of 0.9 rad/s"),
])  # fmt: skip
def test_implausible_values_are_named_once(made, words):
    model = made()
    assert sum(re.search(words, text) is not None for text in model.check()) == 1
    with pytest.warns(Implausible, match=words):
        model.response("x1", order=3)
    with warnings.catch_warnings():
        warnings.simplefilter("error", Implausible)
        model.response("x1", order=3)
        model.response("x1", order=5)


def unbalanced(amount):
    """A shaft of 9.8 kg."""
    rotor = nhbm.Rotor()
    rotor.shaft(np.linspace(0.0, 1.0, 5), 0.04)
    rotor.unbalance(0.5, amount)
    return rotor.model(speed=10.0)


def loaded_twice():
    model = duffing()
    model.load("x1", -1, cos=0.1)
    return model.solve(order=3)


@pytest.mark.parametrize("operation, words", [
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9, 0.8]}, order=3), "'tones%frequency': 0.8 is given 2 times"),
    (lambda: duffing().peak("x1 (1)", "tones[0]", 0.5, 0.6, order=3), "is at an end of the range, tones%frequency = 0.6: no peak"),
    (lambda: nhbm.Rotor(5), "young = 5: no shaft has it; it is in N/m2, for steel 2.1e11"),
    (lambda: nhbm.Rotor(2.1e5), "young = 210000.0: no shaft has it; it is in N/m2"),
    (lambda: nhbm.Rotor(density=7.85), "density = 7.85: no shaft has it; it is in kg/m3"),
    (lambda: nhbm.Rotor().shaft([0.0, 500.0, 1000.0], 0.04), "shaft 'shaft': length = 1000 m; lengths are in metres"),
    (lambda: shaft(0.04).unbalance(0.0, 1e-4, angle=90.0), "unbalance at 0 m: angle = 90.0 rad is more than a turn"),
    (lambda: unbalanced(5.0), "unbalance of 5 kg m of shaft 'shaft': eccentricity of the rotor = 0.51 m; lengths are in metres"),
    (loaded_twice, r"loads 1 and 2 act at the same place with the same tuple, .-1.: they are added"),
])  # fmt: skip
def test_what_can_be_meant_otherwise_is_said(operation, words):
    with pytest.warns(Implausible, match=words) as warned:
        operation()
    assert len(warned) == 1 and warned[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", Implausible)
        duffing().sweep({"tones[0]": [0.8, 0.9, 0.8]}, order=3, warm=True)  # up and down
        duffing().sweep({"tones[0]": [0.8, 0.8], "spring.stiffness": [0.1, 0.2]}, order=3, paired=True)
        nhbm.Rotor(7e10, density=2700.0)
        unbalanced(1e-3)
    assert repr(shaft(0.1)) == "<nhbm.Rotor: shaft with 4 nodes>"


def test_a_warning_about_a_number_is_not_repeated_for_its_next_value():
    model = driven(1.0, -0.1, 1.0)
    with pytest.warns(Implausible) as warned:
        for damping in (-0.1, -0.11, -0.12):
            model["structure.damping[0]"] = damping
            model.response("x1", order=3)
    assert len(warned) == 1


@pytest.mark.parametrize("operation", ["curve", "peak"])
def test_a_curve_that_is_cut_says_how_far_it_came(operation):
    """The number of points that the warning names is enough."""
    values = {"curve": ("tones[0]", 0.5, 1.5), "peak": ("x1 (1)", "tones[0]", 0.5, 1.5)}[operation]
    with pytest.warns(NotConverged, match=r"reached the limit of 12 points at tones%frequency = ") as warned:
        getattr(duffing(), operation)(*values, order=5, points=12)
    share, points = re.search(r", with (\d+)% of the range covered: call again with points=(\d+)", str(warned[0].message)).groups()
    assert 5 < int(share) < 60 and 24 <= int(points) <= 200
    with warnings.catch_warnings():
        warnings.simplefilter("error", NotConverged)
        getattr(duffing(), operation)(*values, order=5, points=int(points))


@pytest.mark.filterwarnings("ignore::nhbm.NotConverged")
def test_a_cut_curve_is_continued_by_the_same_call(monkeypatch, tmp_path):
    """With more points: to the bits of one that had them from the start. A value that has changed begins it anew."""
    whole = duffing().curve("tones[0]", 0.5, 1.5, order=5, points=200)
    model = duffing()
    begun = []
    begin_curve = nhbm.session.Session.begin_curve
    monkeypatch.setattr(nhbm.session.Session, "begin_curve", lambda session: (begun.append(session), begin_curve(session)))
    for points in (12, 12, 20, 200):
        curve = model.curve("tones[0]", 0.5, 1.5, order=5, points=points)
    assert len(begun) == 2, "the second call has as many points as the first"
    for name in set(whole.variables) - {name for name in whole.variables if str(name).endswith("_seconds")}:
        assert whole[name].equals(curve[name]), name
    curve.nhbm.save(tmp_path / "curve.h5")
    with h5py.File(tmp_path / "curve.h5") as file:
        assert b"points = 200" in file["input_complete"][()]
    model.curve("tones[0]", 0.5, 1.5, order=5, points=12)
    model["load[0].cos"] = 0.05
    other = model.curve("tones[0]", 0.5, 1.5, order=5, points=200)
    assert len(begun) == 4 and float(other.nhbm.amplitude("x1")[0]) < 0.6 * float(whole.nhbm.amplitude("x1")[0])


def test_each_advice_has_a_name_and_a_subject():
    """By which programs tell them apart, in the place of their texts."""
    model = stop_at(50.0)
    model["load[0].cos"] = 0.0
    session = model._ready({"harmonics": {"order": 1}})
    assert [(one.name, one.subject) for one in session.advice("model")] == [("no_load", "")]
    model["load[0].cos"] = 0.1
    session = model._ready({"harmonics": {"order": 1}})
    assert session.advice("model") == []
    session.solve(False)
    assert [(one.name, one.subject) for one in session.advice("laws")] == [("inactive_law", "stop")]
    assert session.describe_advice("returned_curve", [2.9, 3.5]).startswith("the curve returned to 2.9 without reaching 3.5")


def test_a_curve_with_many_folds_is_advised_to_jump():
    model = Model(nhbm.Chain(n_masses=2, mass=[1.0, 0.05], coupling_stiffness=[1.0, 2.0, 0.0], damping_mass=0.01), tones=[2.1])
    model.load("x1", 1, cos=0.3)
    model.law("elastic_stop", "x2", stiffness=10.0, gap=0.1)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        model.curve("tones[0]", 2.1, 0.2, order=9, points=250)
    assert any("or with jump=True and more points" in str(one.message) for one in told)


def test_a_curve_that_jumps_goes_on_with_more_points():
    """Cut before, at and behind a jump."""
    settings = {"order": 5, "jump": True}
    whole = duffing().curve("tones[0]", 0.5, 2.5, **settings)
    jump = int(np.argmax(whole["curve_branch"].values == 1))
    assert jump > 0
    for points in range(jump - 2, jump + 4):
        model = duffing()
        with pytest.warns(nhbm.NotConverged, match="call again"):
            model.curve("tones[0]", 0.5, 2.5, points=points, **settings)
        curve = model.curve("tones[0]", 0.5, 2.5, points=500, **settings)
        assert np.array_equal(curve["coefficients"], whole["coefficients"]), points


def test_a_linear_model_has_a_curve():
    model = duffing(spring=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        curve = model.curve("tones[0]", 0.5, 1.5, peak_of="x1 (1)")
        assert model.solve().sizes.get("law", 0) == 0  # nothing remains of it
    peak = curve.sel(point=curve["curve_kind"] == "peak")
    assert float(peak["tones_frequency"][0]) == pytest.approx(np.sqrt(1.0 - 0.5 * 0.1**2), rel=1e-9)


@pytest.mark.parametrize("operation", [
    lambda m, **keys: m.curve("tones[0]", 2.9, 3.5, order=3, **keys),
    lambda m, **keys: m.peak("x1 (1)", "tones[0]", 2.9, 3.5, order=3, **keys),
])  # fmt: skip
def test_a_curve_that_turns_back_is_said(operation):
    """A softening spring, whose force has a maximum: behind the fold no motion leads to the other end of the range."""
    model = driven(0.5, 0.02, 5.0)
    model["load[0].cos"] = 0.05
    model.law("cubic_spring", "x1", stiffness=-4.0)
    model.set("stability", method="off")
    with pytest.warns(NotConverged, match="returned to 2.9 without reaching 3.5: trace another one from there, with first=3.5"):
        operation(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error", NotConverged)
        operation(model, first=3.5)


def driven(mass, damping, stiffness):
    model = Model(nhbm.Matrices(mass=mass, damping=damping, stiffness=stiffness), tones=[0.9])
    model.load("x1", 1, cos=0.1)
    return model


def test_a_joint_that_sticks_throughout_is_named():
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.05, stiffness=1.0), tones=[1.0])
    model.load("x1", 1, cos=0.1)
    model.law("jenkins", "x1", stiffness=10.0, limit=5.0)
    with pytest.warns(Implausible, match="stick throughout"):
        motion = model.solve(order=5)
    assert motion.nhbm.is_converged
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.05, stiffness=1.0), tones=[1.0])
    model.load("x1", 1, cos=10.0)
    model.law("jenkins", "x1", stiffness=10.0, limit=0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.solve()


def test_a_curve_without_a_number_of_points_has_as_many_as_it_needs():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        curve = duffing().curve("tones[0]", 0.5, 2.5, max_step=0.005, order=5)
    assert curve.sizes["point"] > 500 and curve["tones_frequency"].values[-1] == 2.5
    assert not np.any(curve.nhbm.details["reason"] == "points")
