"""Wrong arguments from Python are refused where they are written, by a message with what is right; the process does not end."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from in_process import cubic, duffing, shaft, stopped

import nhbm
from nhbm import Model, ModelError, NotConverged


def test_wrong_numbers_of_periods_are_refused():
    model = duffing()
    model.solve(order=5)
    for periods in (-5, -(2**31), 2**32 + 5, 1.5, "3", None, True):
        with pytest.raises(ModelError, match="periods must be a whole number"):
            model.verify(periods=periods)
    assert model.verify(periods=np.int64(3))["integration_verdict"].item() in ("agrees", "undecided")
    for seconds in (-1, float("nan"), "60"):
        with pytest.raises(ModelError, match="^time_limit must be"):
            model.verify(time_limit=seconds)


def with_values(motion, name, index, value):
    """A copy of a motion in which one number is another."""
    changed = motion.copy(deep=True)
    values = changed[name].values.copy()
    values[index] = value
    replaced = {name: (changed[name].dims, values)}
    return changed.assign_coords(replaced) if name in changed.coords else changed.assign(replaced)


def test_what_is_no_motion_has_no_verdict():
    """Arrays that are shorter than they say, and numbers that no motion has: a message, not a verdict from other memory."""
    model = duffing()
    for motion in (model.solve(order=3), model.solve(tolerance=1e-3)):
        assert model.verify(motion)["integration_verdict"].item() == "agrees"
        tuples = "tuples" if "tuples" in motion.coords else "tuple"
        wrong = [motion.isel(harmonic=slice(0, 2)), motion.isel(component=0), motion.isel(component=[0]), motion.isel(dof=[]),
                 motion.transpose("component", ...)]  # fmt: skip
        wrong += [with_values(motion, "frequency", 0, value) for value in (-1.0, 0.0, np.nan, np.inf)]
        wrong += [with_values(motion, "coefficients", (0, 1, 0), value) for value in (np.nan, -np.inf, 1e308)]
        last = (int(motion["n_harmonics"]) - 1, 0)
        wrong += [with_values(motion, tuples, last, value) for value in (-(2**31), 2**31 - 1, 10**8, 1)]
        for other in wrong:
            with pytest.raises(ModelError):
                model.verify(other, time_limit=10.0)


def test_a_verification_ends_at_its_time_limit():
    """From the last motion of `solve` and from a dataset; the limit does not remain for the next call."""
    model = nhbm.Model(nhbm.Chain(n_masses=20, mass=1.0, coupling_stiffness=1.0, damping_mass=1e-3), tones=[1.1])
    model.load("x1", 1, cos=0.1)
    model.law("cubic_spring", "x10", stiffness=0.1)
    motion = model.solve(order=1)
    for arguments in ((), (motion,)):
        ended = model.verify(*arguments, time_limit=1e-3)
        assert ended["integration_verdict"].item() == "undecided"
        assert ended["integration_duration"].item() == 0.0
    assert model.verify(periods=3)["integration_duration"].item() > 0.0
    model["tones[0]"] = 1.0
    with pytest.raises(ModelError, match="has changed .*: tones%frequency is 1.0, and was 1.1"):
        model.verify()


def beam(**keys):
    return nhbm.Beam(**{"length": 1.0, "bending_stiffness": 1e3, "mass_per_length": 7.8, "n_elements": 4, **keys})


def chain(**keys):
    return Model(nhbm.Chain(n_masses=1, ends="fixed", mass=1.0, coupling_stiffness=1.0), **keys)


def labelled(label):
    duffing().law("cubic_spring", "x1", stiffness=1.0, label=label)


def with_law(function, **keys):
    model = duffing()
    model.law(function, "x1", **keys)
    return model


# A kind of mistake with calls that make it, and what their messages name: the argument, its value, what is right.
MISTAKES = {
    "a type": [
        (lambda: nhbm.Matrices("heavy", np.eye(2)), "mass 'heavy'"),
        (lambda: nhbm.Matrices([[1, 2], [3]], np.eye(2)), "mass"),
        (lambda: Model(3.0), "nhbm.Beam 3.0"),
        (lambda: Model(np.eye(2), tones=[1.0]), "nhbm.Matrices(mass="),
        (lambda: duffing().load("x1", 1, cos=1 + 1j), "cos real"),
        (lambda: duffing().load("x1", 1.5), "tuple_ 1.5"),
        (lambda: duffing().load("x1", True, cos=1.0), "tuple_ True"),
        (lambda: duffing().start("x1", None), "tuple_"),
        (lambda: duffing().law("cubic_spring", 5), "dof 'x1'"),
        (lambda: duffing().law("cubic_spring", "x1", stiffness=1.0, label=5), "label 5"),
        (lambda: duffing().sweep("spring.stiffness"), "dict 'spring.stiffness'"),
        (lambda: duffing().sweep({"tones[0]": {0.8, 0.9}}), "set"),
        (lambda: duffing().curve("tones[0]", "low", 2.0), "start 'low'"),
        (lambda: duffing().curve(3, 0.5, 2.0), "path 'wall.gap'"),
        (lambda: duffing().integrate("long"), "duration 'long'"),
        (lambda: duffing().bearing(["x1", "x2"], ["slow"], [[1, 0, 0, 1]]), "speeds"),
        (lambda: duffing().response(1, order=3), "response 'x1'"),
        (lambda: duffing().set("accuracy", of=("x1", 1)), "of 1"),
        (lambda: duffing().solve(order=3).nhbm.plot(1), "response 1"),
        (lambda: duffing().sweep({"tones[0]": [0.8]}, comm=3), "comm Get_size 3"),
        (lambda: duffing().sweep({"tones[0]": [0.8]}, executor=3), "executor map"),
        (lambda: duffing().sweep({"tones[0]": [0.8]}, progress="bar"), "progress"),
        (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, of=lambda model: "a"), "number dict 'a'"),
        (lambda: duffing().solve(order=3, warm=chain(tones=[1.0])), "warm Model"),
        (lambda: duffing().verify(3), "model.solve int"),
        (lambda: nhbm.law(3), "function 3"),
        (lambda: nhbm.law(odd="yes")(cubic), "odd 'yes'"),
        (lambda: chain(tones="1.0"), "tones"),
        (lambda: nhbm.Rotor("steel"), "young 'steel'"),
        (lambda: beam(length="1"), "length '1'"),
        (lambda: beam(damping_diagonal=True), "damping_diagonal True"),
        (lambda: nhbm.Matrices(np.eye(2), 1j * np.eye(2)), "stiffness real"),
    ],
    "a value": [
        (lambda: duffing().sweep({"spring.stiffness": [0.1, 0.2]}, workers=0), "workers 0"),
        (lambda: duffing().natural_frequencies(9), "n 9"),
        (lambda: nhbm.Rotor().critical_speeds(0.0), "up_to"),
        (lambda: duffing().integrate(np.inf), "duration inf"),
        (lambda: duffing().solve(tolerance=10.0), "tolerance 10.0 1.0"),
        (lambda: beam(length=-1), "nhbm.Beam length -1"),
        (lambda: beam(n_elements=4.5), "n_elements 4.5"),
        (lambda: nhbm.Chain(n_masses=2, mass=[1.0, -1.0], coupling_stiffness=1.0), "mass(2) -1.0"),
        (lambda: Model(nhbm.Matrices([[1.0, 0.5], [0.0, 1.0]], np.eye(2))), "mass symmetric"),
        (lambda: duffing().__setitem__("spring.stiffness", np.nan), "'spring.stiffness' nan"),
        (lambda: duffing().__setitem__("spring.stiffness", np.ma.masked_equal([0.5], 0.5)[0]), "masked"),
        (lambda: stopped().__setitem__("law[0].stiffness", -1), "law[0].stiffness -1"),
        (lambda: duffing().sweep({"tones[0]": [0.8, np.inf]}), "frequency(2) inf"),
        (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[-1.0]), "frequency(1) -1.0"),
        (lambda: duffing().solve(order=3).nhbm.time("x1", [0.0, np.nan]), "times nan"),
        (lambda: shaft(np.nan), "'shaft' diameter"),
        (lambda: labelled("a.b"), "label 'a.b' path"),
        (lambda: duffing().set("output", title="two\nlines"), "line"),
    ],
    "a number of values": [
        (lambda: nhbm.Matrices(n_dofs=2, mass=np.eye(3), stiffness=np.eye(3)), "n_dofs 3"),
        (lambda: Model(nhbm.Chain(n_masses=2, mass=[1, 1, 1], coupling_stiffness=1)), "mass 3"),
        (lambda: duffing().__setitem__("spring.stiffness", [0.1, 0.2]), "'spring.stiffness' 2"),
        (lambda: shaft([0.1, 0.2]), "'shaft' diameter 2 3"),
        (lambda: duffing().sweep({"tones[0]": []}), "tones[0]"),
        (lambda: duffing().sweep({"tones[0]": range(1, 4001), "spring.stiffness": range(1, 4001)}), "16,000,000"),
        (lambda: nhbm.fit(duffing(), {"hertz": [1, 2], "amplitude": [1]}, ["load[0].cos"], "x1 (1)"), "hertz amplitude"),
        (lambda: duffing().gradient("x1", []), "by"),
        (lambda: with_law(lambda q: (q, q, q, q)).solve(order=3), "4"),
    ],
    "a name": [
        (lambda: nhbm.Chain(n_mass=2), "nhbm.Chain 'n_mass' 'n_masses'"),
        (lambda: nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0, ends="fix"), "'fix' 'fixed'"),
        (lambda: nhbm.Chain(n_masses=2, mass=1.0), "'coupling_stiffness'"),
        (lambda: duffing().law("cubic_sprng", "x1", stiffness=1.0), "'cubic_sprng' 'cubic_spring'"),
        (lambda: duffing().law("jenkins", "x1", stifness=1.0), "'stifness'"),
        (lambda: duffing().law("cubic_spring", "x7", stiffness=1.0), "'x7'"),
        (lambda: duffing().law("elastic_stop", "x1", stiffness=1.0, gap=0.1, label="spring"), "'spring'"),
        (lambda: duffing().set("harmonics", oder=3), "'oder' 'order'"),
        (lambda: duffing().curve("tones[0]", 0.5, 2.0, pints=3), "'pints' 'points'"),
        (lambda: duffing().gradient("x1 (1)", ["spring.stifness"]), "'stifness' 'stiffness'"),
        (lambda: duffing()["law(spring).stiffness"], "'spring.stiffness'"),
        (lambda: duffing()["spring"], "'spring' wall.gap"),
        (lambda: duffing().__setitem__("load[1].cos", 1.0), "load(2) load(1)"),
        (lambda: duffing().tie("spring.stiffness", "tones[3]"), "tones.frequency[3]"),
        (lambda: duffing().peak("max x1", "tones[0]", 0.5, 2.0), "'max x1' datasets"),
        (lambda: duffing().sweep({"tones[0]": [0.5]}, of="max x1"), "'max x1' datasets"),
    ],
    "two things at once, or none": [
        (lambda: duffing().solve(order=3, tolerance=1e-3), "tolerance order"),
        (lambda: Model(nhbm.Matrices(1.0, 1.0), tones={"frequency": 1.0, "hertz": 2.0}), "'frequency' 'hertz'"),
        (lambda: duffing().law("jenkins", "x1", stiffness=1.0, limit=0.1, friction_coefficient=0.3), "friction_coefficient"),
        (lambda: duffing().curve("tones[0]", 0.5, 2.0, **{"from": 0.1}), "'from' start"),
        (lambda: duffing().set("curve", points=5), "&curve"),
        (lambda: duffing().tie("tones[0]", "tones[0]"), "&tie itself"),
        (lambda: duffing().peak_gradient("x1 (1)", ["tones[0]"], "tones[0]", 0.8, 1.6), "'tones[0]'"),
        (lambda: duffing().load("x1", 1), "amplitude"),
        (lambda: with_law(lambda q, p: p[0] * q), "'<lambda>' parameters"),
    ],
    "a file": [
        (lambda: nhbm.open_dataset("/"), "'/' folder"),
        (lambda: duffing().solve(order=3).nhbm.save("/"), "'/' folder"),
        (lambda: Model("nothing.h5", tones=[1.0]), "'nothing.h5'"),
        (lambda: Model.from_file("nothing.nml"), "'nothing.nml'"),
        (lambda: Model("beam.nml", tones=[1.0]), "nhbm.Model.from_file('beam.nml')"),
        (lambda: Model.from_namelist("beam.nml"), "Model.from_file"),
        (lambda: nhbm.open_dataset(__file__), "HDF5"),
        (lambda: nhbm.open_dataset(f"{'a' * 300}.h5"), "long"),
        (lambda: duffing().solve(order=3).nhbm.to_csv("/nothing/x.csv"), "'/nothing/x.csv'"),
        (lambda: duffing().solve(order=3).nhbm.to_mat("x.csv"), "'x.csv' .mat"),
        (lambda: duffing().solve(order=3).nhbm.save("x.csv"), ".h5 to_dataframe"),
    ],
    "a dataset": [
        (lambda: xr.Dataset({"a": 1.0}).nhbm.amplitude("x1", 1), "'coefficients'"),
        (lambda: duffing().verify(xr.Dataset()), "dataset"),
        (lambda: duffing().sweep({"tones[0]": [0.8]}, of="x1", order=3).nhbm.details, "numbers"),
        (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, order=3).isel(point=[1, 0]).nhbm.save("x.h5"), "sorted"),
        (lambda: nhbm.fit(duffing(), {"hertz": [], "amplitude": []}, ["load[0].cos"], "x1 (1)"), "rows"),
    ],
}


@pytest.mark.parametrize(("made", "named"), [pytest.param(*case, id=f"{kind} {i}") for kind, cases in MISTAKES.items()
                                             for i, case in enumerate(cases)])  # fmt: skip
def test_mistakes_are_named_where_they_are_written(made, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError) as caught:
        made()
    said = str(caught.value)
    assert all(word in said for word in named.split()), said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("call, message", [
    (lambda model: model.tie("stop.gap", to="tones[0]", by=2.0), r"Model.tie\(\) .*'by'; its arguments: path, to, factor, offset"),
    (lambda model: model.law("elastic_stop", "x1", "x2"), r"a list, dofs=\['x1', 'x2'\]$"),
    (lambda model: model.solve(ordr=3), r"Model.solve\(\) .*'ordr'; its arguments: tolerance, order, warm"),
    (lambda model: model.sweep("stop.gap", [0.1, 0.2]), r"sweep\(\) got too many .*; values are a dict by path, {'stop.gap': "),
    (lambda model: model.sweep("tones[0]", 0.5, 1.5), r"Model.sweep\(\) .*; its arguments: values, paired, of, "),
    (lambda model: model.curve("tones[0]", 1.0), r"Model.curve\(\) .*'stop'; its arguments: path, start, stop, "),
])  # fmt: skip
def test_wrong_names_of_arguments_are_answered_with_the_right_ones(call, message):
    with pytest.raises(TypeError, match=message):
        call(duffing())


def test_a_response_of_points_is_not_one_of_a_motion():
    with pytest.raises(KeyError, match="'x1' is one, 'max x1' a response of curves and sweeps"):
        duffing().solve(order=3).nhbm.plot("max x1")


@pytest.mark.parametrize("law, message", [
    (lambda q, p: p[0] * q[0], "law '<lambda>' gives one force for [0-9]+ samples: it must give one for each"),
    (lambda q: max(q, 0.0), "law '<lambda>' takes its argument for one number, .* np.maximum"),
])  # fmt: skip
def test_a_law_for_one_number_is_named(law, message):
    model = duffing()
    model.law(law, "x1", parameters=[1.0])
    with pytest.raises(ModelError, match=message):
        model.solve()


def test_errors_end_at_the_call():
    """Frames of the package below its public functions help nobody; those of functions of the user do."""
    motion = duffing().solve(order=3)
    for wrong in (
        lambda: duffing().gradient("x1", ["speed"]),
        lambda: duffing().curve("tones[0]", 0.5, 2.0, pints=3),
        lambda: motion.nhbm.amplitude("x7", 1),
        lambda: nhbm.open_dataset("nothing.h5"),
        lambda: nhbm.fit(duffing(), "nothing.csv", ["spring.stiffness"], "x1 (1)"),
    ):
        with pytest.raises((ModelError, KeyError)) as caught:
            wrong()
        own = [frame for frame in caught.traceback if frame.path.parent.name == "nhbm"]
        assert len(own) == 1, [str(frame) for frame in own]

    def on_point(_):
        return {}["nothing"]

    with pytest.raises(KeyError, match="nothing") as caught:
        duffing().curve("tones[0]", 0.5, 2.0, order=3, on_point=on_point)
    assert caught.traceback[-1].name == "on_point"


def test_results_and_inputs_are_told_apart(tmp_path):
    result, source = str(tmp_path / "s.h5"), tmp_path / "s.nml"
    model = duffing()
    model.solve(order=3).nhbm.save(result)
    source.write_text(model.to_namelist())
    with pytest.raises(ModelError, match="s.h5' is a result, not an input: nhbm.open_dataset"):
        Model.from_file(result)
    with pytest.raises(ModelError, match="s.nml' is an input, not a result: nhbm.Model.from_file"):
        nhbm.open_dataset(source)


def test_a_law_that_gives_nan_is_named():
    model = duffing()
    model.law(lambda q: np.full_like(q, np.nan), "x1")
    with pytest.warns(NotConverged, match="'<lambda>' gave NaN or infinity"):
        assert "'<lambda>' gave NaN" in model.solve().nhbm.message


def test_a_law_cannot_change_the_motion():
    def doubling(q):
        q *= 2
        return q

    model = duffing()
    model.law(doubling, "x1")
    with pytest.raises(ValueError, match="read-only"):
        model.solve(order=3)


def test_structures_are_shown_in_one_line():
    structure = nhbm.Structure(np.eye(2), np.diag([1.0, 2.0]))
    assert repr(structure) == "<nhbm.Structure: 2 degrees of freedom; 2 entries of the stiffness>"


def test_arguments_of_a_law_are_what_their_names_say():
    expected = duffing().response("x1 (1)", order=5)
    for law in (lambda q, p: p[0] * q**3, lambda p, q: p[0] * q**3, lambda q, v, p: p[0] * q**3, lambda x, params: params[0] * x**3,
                nhbm.law(lambda a, b: b[0] * a**3, arguments="q p")):  # fmt: skip
        model = duffing(spring=True)
        model.law(law, "x1", parameters=[0.5])
        assert model.response("x1 (1)", order=5) == pytest.approx(expected, rel=1e-10)
    for law in (lambda q, c: c * q, lambda q, v, w: q, lambda q, x: q, lambda v: v):
        with pytest.raises(ModelError, match="argument '.*' is not known|takes no displacements"):
            duffing(spring=True).law(law, "x1")
    for arguments in ("q r", "p", "q q"):
        with pytest.raises(ModelError, match="arguments must be such as 'q p'"):
            nhbm.law(lambda a, b: a, arguments=arguments)


def test_settings_of_an_operation_stay_with_it():
    """Peaks leave stability out, an order fixes the harmonics, a curve moves a value: the model keeps its own."""
    model = duffing()
    before = model.to_namelist()
    model.peak("x1 (1)", "tones[0]", 0.5, 2.0, order=3)
    model.solve(order=3)
    model.solve(tolerance=1e-3)
    assert model["stability.method"] == "auto" and model["tones[0]"] == 0.9 and model.to_namelist() == before
    model.set("harmonics", order=3)
    assert int(model.solve(tolerance=1e-6)["n_harmonics"]) > 4 and int(model.solve()["n_harmonics"]) == 4
    model["harmonics.order"] = 5
    assert int(model.solve(order=7)["n_harmonics"]) == 8 and int(model.solve()["n_harmonics"]) == 6


def test_a_list_has_one_index():
    model = Model(nhbm.Matrices(mass=[[1.0, 0.0], [0.0, 2.0]], stiffness=np.eye(2)), tones=[0.9])
    with pytest.raises(ModelError, match=r"mass has 4 values, row by row: it has one index, mass\(4\)"):
        model["structure.mass[1, 1]"]


def test_a_number_of_degrees_of_freedom_that_agrees_is_accepted():
    assert nhbm.Matrices(n_dofs=2, mass=np.eye(2), stiffness=np.eye(2)).keys["n_dofs"] == 2


def test_a_misspelt_name_of_the_package_is_named():
    with pytest.raises(AttributeError, match="did you mean 'Model'"):
        nhbm.Modle  # noqa: B018
