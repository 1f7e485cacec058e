"""Misuse from Python ends with a message, never the process: one model in several threads, laws that call their model, wrong
arguments, datasets without a motion."""

from __future__ import annotations

import gc
import re
import threading
import warnings

import h5py
import numpy as np
import pytest
import xarray as xr

from in_process import cubic, duffing

import nhbm
from nhbm import Implausible, Model, ModelError, NotConverged, laws


def in_threads(work, n=4):
    """Runs a function in threads at once; returns what it returned or raised in each."""
    found = [None] * n
    start = threading.Barrier(n)

    def run(k):
        start.wait()
        try:
            found[k] = work()
        except Exception as error:
            found[k] = error

    threads = [threading.Thread(target=run, args=(k,)) for k in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def test_threads_with_one_model_wait_for_each_other():
    model, alone = duffing(), duffing().curve("tones[0]", 0.5, 1.5, order=5, max_step=0.2)
    for curve in in_threads(lambda: model.curve("tones[0]", 0.5, 1.5, order=5, max_step=0.2)):
        np.testing.assert_array_equal(curve["coefficients"], alone["coefficients"])
    expected = duffing().solve(order=5)["coefficients"]
    for motion in in_threads(lambda: [model.solve(order=5), model.response("x1", order=5), model.to_namelist()][0]):
        np.testing.assert_array_equal(motion["coefficients"], expected)


def test_threads_with_one_session_are_refused():
    begun, refused = threading.Event(), threading.Event()

    def waiting(q):
        begun.set()
        refused.wait(60)
        return cubic(q)

    model = duffing(spring=cubic)
    model.law(waiting, "x1")
    session = nhbm.Session()
    session.read(model.to_namelist())
    thread = threading.Thread(target=session.solve)
    thread.start()
    assert begun.wait(60)
    for call in (session.solve, session.columns, session.integrate, lambda: session.column("status"),
                 lambda: session.set("tones%frequency", 1.0), session.begin_curve, session.next, session.verify):  # fmt: skip
        with pytest.raises(RuntimeError, match="in use by another thread"):
            call()
    refused.set()
    thread.join()
    assert session.column("status").values == 1


def test_a_law_cannot_call_its_own_model():
    found = []

    def calling(q):
        try:
            session.solve()
        except RuntimeError as error:
            found.append(str(error))
        return cubic(q)

    model = duffing(spring=cubic)
    model.law(calling, "x1")
    session = nhbm.Session()
    session.read(model.to_namelist())
    session.solve()
    assert "callback" in found[0] and session.column("status").values == 1
    other, expected = (duffing().solve(order=order).nhbm.amplitude("x1") for order in (1, 5))

    def solving(q):  # another model may be solved
        assert float(duffing().solve(order=1).nhbm.amplitude("x1")) == float(other)
        return cubic(q)

    model = duffing(spring=cubic)
    model.law(solving, "x1")
    model.set("stability", method="off")
    np.testing.assert_allclose(model.solve(order=5).nhbm.amplitude("x1"), expected, rtol=1e-8)


def test_a_session_holds_its_laws():
    model = duffing(spring=cubic)
    model.law(lambda q: 0.5 * q**3, "x1")
    session = nhbm.Session()
    session.read(model.to_namelist())
    del model
    gc.collect()
    session.solve()
    assert session.column("status").values == 1


def test_wrong_numbers_of_periods_are_refused():
    model = duffing()
    model.solve(order=5)
    for periods in (-5, -(2**31), 2**32 + 5, 1.5, "3", None, True):
        with pytest.raises(ModelError, match="periods must be a whole number"):
            model.verify(periods=periods)
    assert model.verify(periods=np.int64(3))["integration_verdict"].item() in ("agrees", "undecided")
    model["tones[0]"] = 1.0
    with pytest.raises(ModelError, match="values have changed"):
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
    (lambda: duffing().load("x1", "one"), "tuple_ must be whole numbers, not 'one'"),
    (lambda: duffing().load("x1", 1.5), "tuple_ must be whole numbers"),
    (lambda: duffing().start("x1", None), "tuple_ must be whole numbers"),
    (lambda: duffing().law("cubic_spring", 5), "dof must be a label such as 'x1'"),
    (lambda: duffing().curve("tones[0]", "low", 2.0), "start must be numbers, not 'low'"),
    (lambda: duffing().peak("x1", "tones[0]", 0.5, None), "stop must be numbers, not None"),
    (lambda: duffing().curve(3, 0.5, 2.0), "a path is a text such as 'wall.gap'"),
    (lambda: duffing().integrate("long"), "duration must be numbers, not 'long'"),
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
    (lambda: duffing().gradient("x1 (1)", ["spring.stifness"]), "unknown key 'stifness'; did you mean 'stiffness'"),
    (lambda: Model("nothing.h5", tones=[1.0]), "model file 'nothing.h5' does not exist"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[[1.0, 2.0]]), r"tones are frequencies .*, not \[\[1.0, 2.0\]\]"),
    (lambda: Model("beam.nml", tones=[1.0]), r"'beam.nml' is an input, not a model file: nhbm.Model.from_file\('beam.nml'\)"),
    (lambda: nhbm.Matrices(mass=np.array([[np.eye(2)], [0]], dtype=object), stiffness=1.0), r"loadmat\(..., simplify_cells=True\)"),
    (lambda: nhbm.open_dataset(__file__), "cannot be read: it is no HDF5 file"),
    (lambda: xr.Dataset({"a": 1.0}).nhbm.amplitude("x1", 1), "this dataset is no result of nhbm: it has no 'coefficients'"),
    (lambda: duffing().verify(xr.Dataset()), "this dataset is no result of nhbm"),
    (lambda: Model.from_file("nothing.nml"), "file 'nothing.nml' does not exist"),
    (lambda: Model.from_file(nhbm.__file__.replace("__init__.py", "")), "cannot be read: Is a directory"),
    (lambda: duffing().solve(tolerance=10.0), "tolerance = 10.0 must be 1.0 or less"),
    (lambda: duffing().solve(order=3).nhbm.to_csv("/nothing/x.csv"), "file '/nothing/x.csv' cannot be written: No such file"),
    (lambda: duffing().solve(order=3).nhbm.to_mat("/nothing/x.mat"), "file '/nothing/x.mat' cannot be written: No such file"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones={"frequency": 1.0, "hertz": 2.0}), "give either 'frequency' .* or 'hertz'"),
    (lambda: duffing().set("tones", hertz=2.0), r"None removes one: model.set\('tones', frequency=None, hertz=50.0\)"),
    (lambda: duffing().sweep({"tones[0]": [0.8]}, of="x1", order=3).nhbm.details, "has numbers, not motions"),
    (lambda: duffing().__setitem__("load[1].cos", 1.0), r"there is no load.2.; the file has load.1.$"),
])  # fmt: skip
def test_wrong_arguments_are_named(made, message):
    with pytest.raises(ModelError, match=message):
        made()


@pytest.mark.parametrize("call, message", [
    (lambda model: model.tie("stop.gap", to="tones[0]", by=2.0), r"Model.tie\(\) .*'by'; its arguments: path, to, factor, offset"),
    (lambda model: model.solve(ordr=3), r"Model.solve\(\) .*'ordr'; its arguments: tolerance, order, warm"),
    (lambda model: model.curve("tones[0]", 1.0), r"Model.curve\(\) .*'stop'; its arguments: path, start, stop, "),
])  # fmt: skip
def test_wrong_names_of_arguments_are_answered_with_the_right_ones(call, message):
    with pytest.raises(TypeError, match=message):
        call(duffing())


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
    with pytest.warns(Implausible, match="the harmonics are given, so that &accuracy refines the samples alone"):
        model.solve()
    model.set("harmonics", order=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.solve()


def test_files_that_are_no_results_are_named(tmp_path):
    nhbm.Structure(np.eye(2), np.eye(2)).write(tmp_path / "model.h5")
    with pytest.raises(ModelError, match="cannot be read: it is a model file, which nhbm.Model takes"):
        nhbm.open_dataset(tmp_path / "model.h5")
    (tmp_path / "empty.h5").touch()
    with pytest.raises(ModelError, match="cannot be read: it is empty"):
        nhbm.open_dataset(tmp_path / "empty.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(ModelError, match="other.h5' is no result of nhbm"):
        nhbm.open_dataset(tmp_path / "other.h5")
    path = tmp_path / "motion.h5"
    duffing().solve(order=3).nhbm.save(path)
    with pytest.raises(ModelError, match="motion.h5' is a result, not a model file: nhbm.open_dataset"):
        Model(path, tones=[1.0])
    part = tmp_path / "part.h5"
    part.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(ModelError, match=f"cannot be read: it is truncated: 5000 of {path.stat().st_size} bytes"):
        nhbm.open_dataset(part)
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 99
    with pytest.raises(ModelError, match="has the schema version 99; this nhbm reads 1"):
        nhbm.open_dataset(path)


def test_a_law_that_gives_nan_is_named():
    model = duffing()
    model.law(lambda q: np.full_like(q, np.nan), "x1")
    with pytest.warns(NotConverged, match="'<lambda>' gave NaN or infinity"):
        assert "'<lambda>' gave NaN" in model.solve().nhbm.message


def beam(**keys):
    return nhbm.Beam(**{"length": 1.0, "bending_stiffness": 1e3, "mass_per_length": 7.8, "n_elements": 4, **keys})


def labelled(label):
    duffing().law("cubic_spring", "x1", stiffness=1.0, label=label)


def shaft(diameter):
    rotor = nhbm.Rotor()
    rotor.shaft(np.linspace(0.0, 1.0, 4), diameter)
    return rotor


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
    (lambda: nhbm.Rotor("steel"), "young must be numbers, not 'steel'"),
    (lambda: shaft(np.nan), "shaft 'shaft': diameter must be finite"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[-1.0]), r"&tones: frequency\(1\) = -1.0 must be 0.0 or greater"),
    (lambda: duffing().__setitem__("spring.stiffness", [0.1, 0.2]), "'spring.stiffness': stiffness has 2 values, needs one"),
    (lambda: duffing().tie("tones[0]", "tones[0]"), "&tie: 'tones.0.' cannot follow itself"),
    (lambda: duffing().tie("structure.sped", "tones[0]"), "'structure%sped': there is no such value; known keys: type"),
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
    (lambda: shaft(0.1).unbalance(0.5, "1e-5"), "unbalance at 0.5: amount must be numbers"),
])  # fmt: skip
def test_mistakes_are_refused_where_they_are_written(made, message):
    with pytest.raises(ModelError, match=message):
        made()


def test_absent_harmonics_are_not_zero():
    model = duffing()
    motion = model.solve(order=3)
    with pytest.raises(ModelError, match="does not have the tuple 9"):
        motion.nhbm.amplitude("x1", 9)
    with pytest.raises(ModelError, match="tuple_ must be whole numbers"):
        motion.nhbm.amplitude("x1", 3.7)
    with pytest.raises(ModelError, match="'x1 .9.': the set of harmonics does not have this tuple"):
        model.response("x1 (9)", order=3)
    with pytest.warns(NotConverged, match="does not have this tuple"):
        assert np.isnan(model.sweep({"tones[0]": [0.8, 0.9]}, of="x1 (9)", order=3)["response"]).all()


def stopped():
    model = duffing(spring=True)
    model.law("elastic_stop", "x1", stiffness=20.0, gap=0.2)
    return model


def test_all_operations_say_what_is_doubtful_in_the_same_words():
    """With the estimates, their limits and what to do; once."""
    words = r"estimated error .* by truncation .limit 0.01., .* by aliasing .limit 0.01.. With a given order: "
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


def test_a_law_cannot_change_the_motion():
    def doubling(q):
        q *= 2
        return q

    model = duffing()
    model.law(doubling, "x1")
    with pytest.raises(ValueError, match="read-only"):
        model.solve(order=3)


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


@pytest.mark.parametrize("made, words", [
    (lambda: stop_at(1500.0), "gap = 1500.0 m; lengths are in metres"),
    (lambda: stop_at(-0.1), "gap = -0.1 m is negative: in contact and preloaded at rest"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones={"hertz": 50.0}), "more than 50 times the highest natural frequency, 0.1592 Hz"),
    (lambda: Model(nhbm.Matrices(1.0, 1.0), tones=[0.5]), "no load acts"),
    (lambda: driven(1.0, -0.1, 1.0), "damping of 'x1' is negative, -0.1 N s/m: energy is fed into vibrations; unless the"),
    (lambda: driven(1.0, 0.1, -1.0), "stiffness of 'x1' is negative, -1.0 N/m: the equilibrium is unstable"),
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


def loaded_twice():
    model = duffing()
    model.load("x1", -1, cos=0.1)
    return model.solve(order=3)


@pytest.mark.parametrize("operation, words", [
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9, 0.8]}, order=3), "'tones%frequency': 0.8 is given 2 times"),
    (lambda: duffing().peak("x1 (1)", "tones[0]", 0.5, 0.6, order=3), "is at an end of the range, tones%frequency = 0.6: no peak"),
    (lambda: nhbm.Rotor(5), "young = 5: no solid has it; it is in N/m2, for steel 2.1e11"),
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
    assert repr(shaft(0.1)) == "<nhbm.Rotor: shaft with 4 nodes>"


def test_a_warning_about_a_number_is_not_repeated_for_its_next_value():
    model = driven(1.0, -0.1, 1.0)
    with pytest.warns(Implausible) as warned:
        for damping in (-0.1, -0.11, -0.12):
            model["structure.damping[0]"] = damping
            model.response("x1", order=3)
    assert len(warned) == 1


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


def test_a_list_has_one_index():
    model = Model(nhbm.Matrices(mass=[[1.0, 0.0], [0.0, 2.0]], stiffness=np.eye(2)), tones=[0.9])
    with pytest.raises(ModelError, match=r"mass has 4 values, row by row: it has one index, mass\(4\)"):
        model["structure.mass[1, 1]"]


def driven(mass, damping, stiffness):
    model = Model(nhbm.Matrices(mass=mass, damping=damping, stiffness=stiffness), tones=[0.9])
    model.load("x1", 1, cos=0.1)
    return model


def test_a_number_of_degrees_of_freedom_that_agrees_is_accepted():
    assert nhbm.Matrices(n_dofs=2, mass=np.eye(2), stiffness=np.eye(2)).keys["n_dofs"] == 2


def refusing(code):
    """A model whose compiled law returns this code."""
    model = duffing(spring=True)
    model.law(nhbm.law(laws.EVALUATE(lambda samples: code)), "x1")
    return model


def test_a_last_iterate_is_no_motion():
    """A motion that was not found has coefficients, the last ones, but no harmonics that they belong to."""
    model = stopped()
    model.set("solver", max_iterations=1, fallback=False)
    with pytest.warns(NotConverged):
        motion = model.solve(order=5)
    assert motion["status"] == "out_of_budget" and "coefficients" in motion
    for evaluate in (lambda: motion.nhbm.amplitude("x1"), lambda: motion.nhbm.largest("x1"), lambda: motion.nhbm.time("x1", 0.0),
                     lambda: motion.nhbm.response("x1"), motion.nhbm.plot, motion.nhbm.orbit, motion.nhbm.spectrum,
                     motion.nhbm.to_dataframe, lambda: model.verify(motion)):  # fmt: skip
        with pytest.raises(ModelError, match=r"no motion was found .status out_of_budget."):
            evaluate()
    with pytest.warns(NotConverged):
        assert np.isnan(model.response("x1", order=5))


def test_a_point_without_a_motion_is_not_drawn():
    points = duffing().sweep({"tones[0]": [0.8, 0.9]}, order=3)
    points["status"][1] = "pending"
    points["n_harmonics"][1] = 0
    point = points.isel(point=1)
    for values in (point.nhbm.amplitude("x1"), point.nhbm.largest("x1"), point.nhbm.time("x1", 0.0), point.nhbm.response("x1")[0]):
        assert np.isnan(values)
    for draw in (point.nhbm.plot, point.nhbm.orbit, point.nhbm.spectrum, point.nhbm.animate, lambda: duffing().verify(point)):
        with pytest.raises(ModelError, match="no motion was found .status pending."):
            draw()


@pytest.mark.parametrize("wrong, message", [
    (lambda data: data.nhbm.amplitude("x1", of="power_in"), "'power_in' has no harmonics"),
    (lambda data: data.nhbm.amplitude("x1", of="power"), "there is no column 'power'"),
    (lambda data: data.nhbm.spectrum(over="freqency"), "over must be 'tuple' or 'frequency'"),
    (lambda data: data.nhbm.animate(frames=0), "frames must be 1 or more"),
    (lambda data: data.nhbm.report().save("page.png"), "the name must end in .html"),
    (lambda data: xr.Dataset({"integration_verdict": "agrees"}).nhbm.plot(), "a verdict of .verify., without a motion"),
    (lambda data: xr.Dataset({"a": ("x", [1.0, 2.0])}).nhbm.plot(), "this dataset is no result of nhbm"),
    (lambda data: xr.Dataset({"a": ("x", [1.0, 2.0])}).nhbm.to_dataframe(), "this dataset is no result of nhbm"),
    (lambda data: duffing().sweep({"tones[0]": [0.8]}, of="x1", order=3).nhbm.plot("x1 (1)"), "numbers, not motions: response"),
    (lambda data: duffing().sweep({"tones[0]": [0.8]}, of="x1", order=3).nhbm.amplitude("x1"), "numbers, not motions: response"),
    (lambda data: duffing().sweep({"tones[0]": [0.8]}, of="x1", order=3).nhbm.save("x.h5"), "to_csv, to_mat or to_netcdf write it"),
    (lambda data: data.nhbm.plot("x1", "max x1"), "ax needs the axes of matplotlib .*, not 'max x1'; a plot shows one response"),
])  # fmt: skip
def test_wrong_uses_of_a_dataset_are_named(wrong, message):
    with pytest.raises(ModelError, match=message):
        wrong(duffing().solve(order=3))


@pytest.mark.parametrize("use", [
    lambda data: data.nhbm.plot("max x1"), lambda data: data.nhbm.to_dataframe("max x1"), lambda data: data.nhbm.events("max x1"),
    lambda data: data.nhbm.report(), lambda data: data.nhbm.save("x.h5"),
])  # fmt: skip
def test_an_axis_of_points_with_another_name_is_named(use):
    curve = duffing().curve("tones[0]", 0.5, 1.5, order=3, max_step=0.3)
    with pytest.raises(ModelError, match=r"are along 'p'; .* must be 'point': dataset.swap_dims\(p='point'\)|rename\(p='point'\)"):
        use(curve.rename(point="p"))
    with pytest.raises(ModelError, match=r"dataset.swap_dims\(tones_frequency='point'\)"):
        use(curve.swap_dims(point="tones_frequency"))


def test_responses_have_the_axes_of_the_points():
    sweep = duffing().sweep({"load[0].cos": [0.1, 0.2], "spring.stiffness": [0.4, 0.5, 0.6]}, order=3)
    table = sweep.set_index(point=["load_1_cos", "law_spring_stiffness"]).unstack("point")
    for of in ("x1", "x1 (1)", "max x1"):
        on_table = table.nhbm.response(of)[0].transpose("load_1_cos", "law_spring_stiffness")
        np.testing.assert_allclose(np.ravel(on_table), sweep.nhbm.response(of)[0], rtol=1e-14)


def test_a_dataset_without_a_motion_says_why():
    model = refusing(-1)  # fatal
    with pytest.warns(NotConverged):
        motion = model.solve(order=3)
    with pytest.warns(NotConverged):
        points = model.sweep({"tones[0]": [0.9, 1.0]}, order=3)
    for evaluate in (lambda: motion.nhbm.amplitude("x1"), lambda: motion.nhbm.harmonic("x1", 3), lambda: motion.nhbm.largest("x1"),
                     lambda: motion.nhbm.time("x1", [0.0]), lambda: motion.nhbm.response("x1"), lambda: motion.nhbm.plot("x1"),
                     lambda: motion.nhbm.gradient("x1"), lambda: model.verify(motion), lambda: points.nhbm.amplitude("x1"),
                     ):  # fmt: skip
        with pytest.raises(ModelError, match=r"no motion was found .status failed., so there are no 'coefficients'.*returned -1"):
            evaluate()
    for code, status in ((-1, "returned -1"), (1, "no motion was found .status not_finite.*returned 1")):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotConverged)
            with pytest.raises(ModelError, match=status):
                refusing(code).curve("tones[0]", 0.9, 1.0, order=3)


def with_law(function, **keys):
    model = duffing()
    model.law(function, "x1", **keys)
    return model


def chain(**keys):
    return Model(nhbm.Chain(n_masses=1, ends="fixed", mass=1.0, coupling_stiffness=1.0), **keys)


@pytest.mark.parametrize("made, message", [
    (lambda: duffing().load("x1", "1", cos=1.0), "tuple_ must be whole numbers, not '1'"),
    (lambda: duffing().load("x1", True, cos=1.0), "tuple_ must be whole numbers, not True"),
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
    (lambda: duffing().load("x1", 1, cos=1j), "&load: cos: expected a real number"),
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, of=lambda model: "a"), "returns a number or a dict of numbers, not 'a'"),
    (lambda: duffing().sweep({"tones[0]": [0.8, 0.9]}, of=lambda model: [1.0, 2.0]), "returns a number or a dict"),
    (lambda: duffing().solve(order=3).nhbm.save("x.csv"), "give it the ending .h5; dataset.nhbm.to_dataframe"),
    (lambda: duffing()["spring"], "path 'spring' has no key, as in wall.gap"),
    (lambda: nhbm.fit(duffing(), {"hertz": [-0.1, 0.2], "amplitude": [0.1, 0.2]}, ["load[0].cos"], "x1 (1)"), "'hertz' must"),
    (lambda: nhbm.fit(duffing(), {"hertz": [], "amplitude": []}, ["load[0].cos"], "x1 (1)"), "data have no rows"),
])
def test_wrong_types_are_refused(made, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError, match=message):
        made()
    assert not list(tmp_path.iterdir())


def test_a_misspelt_name_of_the_package_is_named():
    with pytest.raises(AttributeError, match="did you mean 'Model'"):
        nhbm.Modle  # noqa: B018
