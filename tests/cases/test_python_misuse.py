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


@pytest.mark.parametrize("made, message", [
    (lambda: nhbm.Matrices(n_dofs=2, mass=np.eye(3), stiffness=np.eye(3)), "n_dofs follows from the matrices; .* 3 x 3"),
    (lambda: nhbm.Matrices(n_dofs=2), "takes mass and stiffness"),
    (lambda: nhbm.Matrices(np.eye(2), np.eye(2), None, ["a", "b"]), "further keys by name"),
    (lambda: nhbm.Matrices("heavy", np.eye(2)), "mass must be a square matrix of numbers, not 'heavy'"),
    (lambda: nhbm.Matrices([[1, 2], [3]], np.eye(2)), "mass must be a square matrix"),
    (lambda: nhbm.Chain(2, 1.0), r"Chain takes its keys by name, Chain\(key=value"),
    (lambda: nhbm.Beam(type="chain"), "leave 'type' out"),
    (lambda: Model(3.0), "expected a structure such as nhbm.Beam.*, not 3.0"),
    (lambda: Model(np.eye(2), tones=[1.0]), r"^expected a structure .*, not an array; nhbm.Matrices\(mass="),
    (lambda: duffing().load("x1", 1, cos=1 + 1j), "expected a real number, string, bool or list of them"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[1 + 1j]), "tones are frequencies .*, not .*1j"),
    (lambda: duffing().sweep({"spring.stiffness": [0.1, 0.2]}, workers=0), "workers must be a whole number, 1 or more, not 0"),
    (lambda: duffing().sweep("spring.stiffness"), "a dict of lists by path, .*, not 'spring.stiffness'"),
    (lambda: duffing().natural_frequencies(2.5), "n must be a whole number, 1 or more, not 2.5"),
    (lambda: duffing().set("output", title="two\nlines"), "a text of an input has one line"),
    (lambda: Model.from_namelist("beam.nml"), "expected the text of an input, not 'beam.nml'; Model.from_file reads a file"),
    (lambda: nhbm.open_dataset("/"), "'/' is a folder"),
    (lambda: duffing().solve(order=3).nhbm.save("/"), "file '/' cannot be written: it is a folder"),
    (lambda: nhbm.fit(duffing(), {"frequency": [1, 2], "amplitude": [1]}, ["spring.stiffness"], "x1 (1)"),
     "columns of data differ in length: frequency: 2, amplitude: 1"),
    (lambda: nhbm.Rotor().critical_speeds(0.0), "up_to must be above 0"),
    (lambda: duffing().load("x1", "one"), "tuple_ must be a whole number, or a list of them, not 'one'"),
    (lambda: duffing().load("x1", 1.5), "tuple_ must be a whole number"),
    (lambda: duffing().load("x1", [[1]]), r"tuple_ must be a whole number, or a list of them, not \[\[1\]\]"),
    (lambda: duffing().start("x1", None), "tuple_ must be a whole number"),
    (lambda: duffing().law("cubic_spring", 5), "dof must be a label such as 'x1'"),
    (lambda: duffing().sweep({"tones[0]": {0.8, 0.9}}), "a list of numbers, in their order, not a set"),
    (lambda: nhbm.Matrices(mass=1.0, damping=0.1, stiffness="1e3"), "stiffness must be a square matrix of numbers, not '1e3'"),
    (lambda: duffing().tie("spring.stiffness", "tones[3]"), r"tones.frequency\[3\].*frequency has 1 value"),
    (lambda: duffing()["law(spring).stiffness"], r"is not a path; .*; did you mean 'spring.stiffness'\?"),
    (lambda: duffing().curve("tones[0]", "low", 2.0), "start must be a number, not 'low'"),
    (lambda: duffing().peak("x1", "tones[0]", 0.5, None), "stop must be a number, not None"),
    (lambda: duffing().curve(3, 0.5, 2.0), "a path is a text such as 'wall.gap'"),
    (lambda: duffing().integrate("long"), "duration must be a number, not 'long'"),
    (lambda: duffing().bearing(["x1", "x2"], ["slow"], [[1, 0, 0, 1]]), "speeds must be numbers"),
    (lambda: duffing().curve("tones[0]", 0.5, 2.0, **{"from": 0.1}), "'from' follows from the arguments path, start and stop"),
    (lambda: duffing().peak("x1", "tones[0]", 0.5, 2.0, to=3.0), "'to' follows from the arguments"),
    (lambda: duffing().set("curve", points=5), r"the keys of &curve are arguments of the operations"),
    (lambda: duffing().gradient("x1", ["tones[1]"]), "is not there: the key has 1 number"),
    (lambda: duffing().gradient("x1", []), "by must name at least one value"),
    (lambda: duffing().response("max x1"), "'max x1' is a response of datasets"),
    (lambda: duffing().gradient("max x1", ["spring.stiffness"]), "'max x1' is a response of datasets"),
    (lambda: duffing().peak("max x1", "tones[0]", 0.5, 2.0), "'max x1' is a response of datasets"),
    (lambda: duffing().curve("tones[0]", 0.5, 2.0, peak_of=["x1", "max x1"]), "'max x1' is a response of datasets"),
    (lambda: duffing().curve("tones[0]", 0.5, 2.0, resonance_of="max x1"), "'max x1' is a response of datasets"),
    (lambda: duffing().sweep({"tones[0]": [0.5]}, of="max x1"), "'max x1' is a response of datasets"),
    (lambda: duffing().gradient("x1 (1)", ["spring.stifness"]), "has an unknown key 'stifness'; did you mean 'stiffness'"),
    (lambda: Model("nothing.h5", tones=[1.0]), "model file 'nothing.h5' does not exist"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[[1.0, 2.0]]), r"tones are frequencies .*, not \[\[1.0, 2.0\]\]"),
    (lambda: Model("beam.nml", tones=[1.0]), r"'beam.nml' is an input, not a model file: nhbm.Model.from_file\('beam.nml'\)"),
    (lambda: nhbm.Matrices(mass=np.array([[np.eye(2)], [0]], dtype=object), stiffness=1.0), r"loadmat\(..., simplify_cells=True\)"),
    (lambda: nhbm.open_dataset(__file__), "cannot be read: it is not an HDF5 file"),
    (lambda: xr.Dataset({"a": 1.0}).nhbm.amplitude("x1", 1), "this dataset is not a result of nhbm: it has no 'coefficients'"),
    (lambda: duffing().verify(xr.Dataset()), "this dataset is not a result of nhbm"),
    (lambda: Model.from_file("nothing.nml"), "file 'nothing.nml' does not exist"),
    (lambda: Model.from_file(nhbm.__file__.replace("__init__.py", "")), "cannot be read: Is a directory"),
    (lambda: duffing().solve(tolerance=10.0), "tolerance = 10.0 must be 1.0 or less"),
    (lambda: duffing().solve(order=3).nhbm.to_csv("/nothing/x.csv"), "file '/nothing/x.csv' cannot be written: No such file"),
    (lambda: duffing().solve(order=3).nhbm.to_mat("/nothing/x.mat"), "file '/nothing/x.mat' cannot be written: No such file"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones={"frequency": 1.0, "hertz": 2.0}), "give either 'frequency' .* or 'hertz'"),
    (lambda: duffing().set("tones", hertz=2.0), r"None removes one: model.set\('tones', frequency=None, hertz=50.0\)"),
    (lambda: duffing().sweep({"tones[0]": [0.8]}, of="x1", order=3).nhbm.details, "has numbers, not motions"),
    (lambda: duffing()["spring.stiffness, stop.gap"], "is not a path; .* give each of several paths by itself"),
    (lambda: duffing().__setitem__("load[1].cos", 1.0), r"^'load.2.%cos': there is no load.2.; the input has load.1.$"),
    (lambda: duffing().__setitem__("spring.gap", 1.0), "^'law.spring.%gap': unknown key 'gap'"),
    (lambda: duffing().law("jenkins", "x1", stifness=1.0), "^&law type = 'jenkins': unknown key 'stifness'; did you mean"),
    (lambda: duffing().law("annular_clearance", "x1", stiffness=1.0, clearance=1.0), "^&law type = 'annular_clearance': dof: "),
    (lambda: duffing().integrate(0.0), "^duration must be above 0"),
    (lambda: nhbm.law(3), "^a law is a function of q, v and p, a pointer to one, or the name of a type, not 3$"),
    (lambda: duffing().law(None, "x1"), "^a law is a function of q, v and p"),
    (lambda: duffing().peak_gradient("x1 (1)", ["tones[0]"], "tones[0]", 0.8, 1.6), "'tones.0.' varies along the curve"),
    (lambda: nhbm.open_dataset(f"{'a' * 300}.h5"), "^file 'a*.h5' cannot be read: File name too long$"),
    (lambda: nhbm.Structure.read(f"{'a' * 300}.h5"), "^file 'a*.h5' cannot be read: File name too long$"),
    (lambda: Model(f"{'a' * 300}.h5", tones=[1.0]), "^model file 'a*.h5' cannot be read: File name too long$"),
    (lambda: duffing().solve(order=3).nhbm.time("x1", np.zeros((2, 2))), "^times are a number or a list of them"),
    (lambda: duffing().__setitem__("spring.stiffness", np.ma.masked_equal([0.5], 0.5)[0]), "^a masked value is none"),
    (lambda: duffing().sweep({"tones[0]": range(1, 4001), "spring.stiffness": range(1, 4001)}), "^16,000,000 points"),
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, order=3).sortby("point", ascending=False).nhbm.save("x.h5"), "not sorted$"),
])  # fmt: skip
def test_wrong_arguments_are_named(made, message):
    with pytest.raises(ModelError, match=message):
        made()


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


def beam(**keys):
    return nhbm.Beam(**{"length": 1.0, "bending_stiffness": 1e3, "mass_per_length": 7.8, "n_elements": 4, **keys})


def labelled(label):
    duffing().law("cubic_spring", "x1", stiffness=1.0, label=label)


@pytest.mark.parametrize("made, message", [
    (lambda: nhbm.Chain(n_mass=2), "nhbm.Chain: unknown key 'n_mass'; did you mean 'n_masses'"),
    (lambda: nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0, ends="fix"), "ends = 'fix' .*; did you mean 'fixed'"),
    (lambda: nhbm.Chain(n_masses=2, mass=1.0), "nhbm.Chain: missing key 'coupling_stiffness'"),
    (lambda: duffing().law("cubic_sprng", "x1", stiffness=1.0), "type = 'cubic_sprng' is not known; did you mean 'cubic_spring'"),
    (lambda: duffing().law("cubic_spring", "x1", stifness=1.0), "unknown key 'stifness'; did you mean 'stiffness'"),
    (lambda: duffing().law("cubic_spring", "x7", stiffness=1.0), "unknown degree of freedom 'x7'"),
    (lambda: duffing().law("cubic_spring", "x1"), "missing key 'stiffness'"),
    (lambda: duffing().law("elastic_stop", "x1", stiffness=1.0, gap=0.1, label="spring"), "another group with the label 'spring'"),
    (lambda: duffing().load("x1", 1), "a load needs an amplitude"),
    (lambda: duffing().load("x1", 1, cos=1j), r"expected a real number, .* not 1j"),
    (lambda: duffing().set("harmonics", oder=3), "unknown key 'oder'; did you mean 'order'"),
    (lambda: duffing().curve("tones[0]", 0.5, 2.0, pints=3), "unknown key 'pints'; did you mean 'points'"),
    (lambda: duffing().solve(order=3, tolerance=1e-3), "give a tolerance, .* or an order, .*; not both"),
    (lambda: duffing().law("jenkins", "x1", stiffness=1.0, limit=0.1, friction_coefficient=0.3),
     r"^&law type = 'jenkins': limit: give either 'limit' or 'friction_coefficient', not both$"),
    (lambda: nhbm.Matrices(np.eye(2), 1j * np.eye(2)), "stiffness must be real"),
    (lambda: nhbm.Structure(np.eye(2), (1 + 0.1j) * np.eye(2)), "'stiffness' is complex; .* `structural`"),
    (lambda: duffing().sweep({"frequency": [1.0]}), "did you mean 'tones"),
    (lambda: beam(length=-1), "nhbm.Beam: length = -1 must be above 0.0"),
    (lambda: beam(length=np.nan), "nhbm.Beam: length = nan must be finite"),
    (lambda: beam(length="1"), "nhbm.Beam: length = '1' must be a real number, without quotes"),
    (lambda: beam(n_elements=4.5), "nhbm.Beam: n_elements = 4.5 must be an integer like 3"),
    (lambda: beam(damping_diagonal=True), "damping_diagonal = True must be a real number, not a bool"),
    (lambda: nhbm.Chain(n_masses=2, mass=[1.0, -1.0], coupling_stiffness=1.0), r"mass\(2\) = -1.0 must be 0.0 or greater"),
    (lambda: Model(nhbm.Chain(n_masses=2, mass=[1, 1, 1], coupling_stiffness=1)), "mass: needs 1 or 2 values, there are 3"),
    (lambda: Model(nhbm.Matrices([[1.0, 0.5], [0.0, 1.0]], np.eye(2))), "mass .*symmetric"),
    (lambda: duffing().__setitem__("spring.stiffness", np.nan), "'spring.stiffness': stiffness = nan must be finite"),
    (lambda: stopped().__setitem__("law[0].stiffness", -1), r"'law.0..stiffness': stiffness = -1 must be 0.0 or greater"),
    (lambda: duffing().set("accuracy", tolerance=-1), "&accuracy: tolerance = -1 must be 1e-14 or greater"),
    (lambda: duffing().sweep({"tones[0]": [0.8, np.inf]}), r"frequency\(2\) = inf must be finite"),
    (lambda: duffing().curve("tones[0]", np.nan, 2.0), "start must be finite, not nan"),
    (lambda: duffing().integrate(np.inf), "duration must be finite, not inf"),
    (lambda: labelled(""), "label '' cannot be part of a path"),
    (lambda: labelled("a.b"), "label 'a.b' cannot be part of a path"),
    (lambda: labelled("1"), "label '1' cannot be part of a path"),
    (lambda: duffing().natural_frequencies(9), "n = 9, but the structure has 1 natural frequency$"),
    (lambda: duffing().solve(order=3).nhbm.time("x1", [0.0, np.nan]), r"times must be finite, not \[0.0, nan\]"),
    (lambda: nhbm.Rotor("steel"), "young must be a number, not 'steel'"),
    (lambda: shaft(np.nan), "shaft 'shaft': diameter must be finite"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[-1.0]), r"&tones: frequency\(1\) = -1.0 must be 0.0 or greater"),
    (lambda: duffing().__setitem__("spring.stiffness", [0.1, 0.2]), "'spring.stiffness': stiffness has 2 values, needs one"),
    (lambda: duffing().tie("tones[0]", "tones[0]"), "&tie: 'tones.0.' cannot follow itself"),
    (lambda: duffing().tie("structure.sped", "tones[0]"), "'structure.sped': there is no such value; known keys: type"),
    (lambda: duffing().sweep({"tones[0]": [[0.8, 0.9]]}), "the values of a sweep are a list of numbers, not an array of 2"),
    (lambda: duffing().sweep({"tones[0]": [0.8]}, comm=3), "comm must have the method `Get_size`, as those of mpi4py.MPI, not 3"),
    (lambda: duffing().sweep({"tones[0]": [0.8]}, executor=3), "executor must have the method `map`"),
    (lambda: duffing().sweep({"tones[0]": [0.8]}, progress="bar"), "progress must be True, False or a function"),
    (lambda: duffing().curve("tones[0]", 0.5, 0.6, on_point=3), "on_point must be a function"),
    (lambda: duffing().response(1, order=3), "a response is a text such as 'x1'"),
    (lambda: duffing().law(lambda q, p: p[0] * q, "x1"), "law '<lambda>' takes parameters p: give them, parameters="),
    (lambda: duffing().solve(order=3).nhbm.to_csv("x.xlsx"), "'x.xlsx': a table is a text; give it the ending .csv"),
    (lambda: duffing().solve(order=3).nhbm.to_mat("x.csv"), "'x.csv': MATLAB .* give it the ending .mat"),
    (lambda: shaft([0.1, 0.2]), "shaft 'shaft': diameter has 2 values; it needs one, or one for each of 3 elements"),
    (lambda: shaft(0.1).unbalance(0.5, "1e-5"), "unbalance at 0.5: amount must be a number"),
])  # fmt: skip
def test_mistakes_are_refused_where_they_are_written(made, message):
    with pytest.raises(ModelError, match=message):
        made()


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


def with_law(function, **keys):
    model = duffing()
    model.law(function, "x1", **keys)
    return model


def chain(**keys):
    return Model(nhbm.Chain(n_masses=1, ends="fixed", mass=1.0, coupling_stiffness=1.0), **keys)


@pytest.mark.parametrize("made, message", [
    (lambda: duffing().load("x1", "1", cos=1.0), "tuple_ must be a whole number, or a list of them, not '1'"),
    (lambda: duffing().load("x1", True, cos=1.0), "tuple_ must be a whole number, or a list of them, not True"),
    (lambda: chain(tones="1.0"), "tones are frequencies"),
    (lambda: chain(tones=[]), r"\}, not \[\]"),
    (lambda: chain(hertz=[2.0]), "write tones=.'hertz': .2.0"),
    (lambda: chain(harmonics=5), "a dict of keys"),
    (lambda: duffing().law("cubic_spring", "x1", stiffness=1.0, label=5), "label must be a text, not 5"),
    (lambda: with_law(lambda q: (q, q, q, q)).solve(order=3), "gives 4 values, not "),
    (lambda: nhbm.law(odd="yes")(cubic), "odd must be True or False, not 'yes'"),
    (lambda: duffing().solve(order=3, warm=chain(tones=[1.0])), "warm must be True or False, .*, not Model"),
    (lambda: duffing().verify(3), "give a motion, as of model.solve.*, not int"),
    (lambda: duffing().__setitem__("load[0].cos", None), "'load.0..cos' needs a value, not None"),
    (lambda: duffing().curve("tones[0]", 0.5, 0.6, peak_of=("x1", 1)), "peak_of: a response is a text such as .*, not 1"),
    (lambda: duffing().set("accuracy", of=("x1", 1)), "of: a response is a text such as .*, not 1"),
    (lambda: duffing().set("gradient", by=["load[0].cos"], of=1), "of: a response is a text such as .*, not 1"),
    (lambda: duffing().solve(order=3).nhbm.to_dataframe(("x1", 1)), "a response is a text such as .*, not ..x1., 1."),
    (lambda: duffing().solve(order=3).nhbm.plot(1), "a response is a text such as .*, not 1"),
    (lambda: duffing().load("x1", 1, cos=1j), "&load: cos: expected a real number"),
    (lambda: duffing().sweep({"tones[0]": []}), "'tones.0.' has no values"),
    (lambda: duffing().sweep({}), "a sweep needs a path with values"),
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, of=lambda model: "a"), "returns a number or a dict of numbers, not 'a'"),
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, of=lambda model: [1.0, 2.0]), "returns a number or a dict"),
    (lambda: duffing().solve(order=3).nhbm.save("x.csv"), "give it the ending .h5; dataset.nhbm.to_dataframe"),
    (lambda: duffing()["spring"], "path 'spring' has no key, as in wall.gap"),
    (lambda: nhbm.fit(duffing(), {"hertz": [-0.1, 0.2], "amplitude": [0.1, 0.2]}, ["load[0].cos"], "x1 (1)"), "'hertz' must"),
    (lambda: nhbm.fit(duffing(), {"hertz": [], "amplitude": []}, ["load[0].cos"], "x1 (1)"), "data have no rows"),
])  # fmt: skip
def test_wrong_types_are_refused(made, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError, match=message):
        made()
    assert not list(tmp_path.iterdir())


def test_a_misspelt_name_of_the_package_is_named():
    with pytest.raises(AttributeError, match="did you mean 'Model'"):
        nhbm.Modle  # noqa: B018
