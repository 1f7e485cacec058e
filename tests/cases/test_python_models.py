"""Models in Python: created from values, from text and from matrices, set by path, sent to other processes; helpful errors."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import types
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import xarray as xr

from in_process import DUFFING, ROOT, cubic, duffing, same, session_of

import nhbm
from nhbm import Model, ModelError


def test_a_value_that_follows_is_read_as_it_follows():
    rotor = nhbm.Jeffcott(mass=1.0, stiffness=100.0, damping=0.5, speed=5.0, rotating_damping=0.2)
    model = nhbm.Model(rotor, tones=[5.0])
    model.law("cubic_spring", "x", stiffness=1.0, label="spring")
    model.add("tie", parameter="structure.speed", to="tones[0]", factor=2.0, offset=1.0)
    model.tie("spring.stiffness", "structure.speed")
    model["tones[0]"] = 7.0
    read = nhbm.Model.from_namelist(model.to_namelist())
    assert [one[path] for one in (model, read) for path in ("structure.speed", "law(spring)%stiffness")] == [15.0] * 4
    with pytest.raises(nhbm.ModelError, match="&tie: missing key 'to', which needs a path"):
        model.add("tie", parameter="structure.speed")


def test_values_are_set_by_path_and_by_handle():
    other = Model.from_namelist(DUFFING.replace("stiffness = 0.5", "stiffness = 0.7").replace("= 0.9 /", "= 1.1 /"))
    for spring, tone in (
        ("spring.stiffness", "tones[0]"),
        ("law[0].stiffness", "tones.frequency"),
        ("law(1)%stiffness", "tones%frequency(1)"),
    ):
        model = Model.from_namelist(DUFFING)
        model[spring] = 0.7
        model[tone] = 1.1
        np.testing.assert_array_equal(model.solve()["coefficients"], other.solve()["coefficients"])
        assert "stiffness = 0.7" in " ".join(model.to_namelist().split())


_THREE_QUARTERS = [np.float64(0.75), np.array(0.75), xr.DataArray(0.75), np.longdouble(0.75), Fraction(3, 4), Decimal("0.75")]


@pytest.mark.parametrize("number", _THREE_QUARTERS)
def test_numbers_of_any_kind_are_values(number):
    model = duffing()
    model["spring.stiffness"] = number
    assert model["spring.stiffness"] == 0.75


def test_a_model_in_memory_becomes_files_of_the_command(tmp_path):
    """A structure in memory was named by words that no command could read."""
    shaft = nhbm.Rotor()
    shaft.shaft(np.linspace(0.0, 1.0, 4), 0.05)
    shaft.disk(1 / 3, 10.0, 0.1, 0.2)
    for z in (0.0, 1.0):
        shaft.bearing(z, 1e7, 1e3)
    shaft.unbalance(1 / 3, 1e-3)
    model = Model(shaft.structure(), tones=[50.0], harmonics={"order": 1})
    model.load(vector="unbalance_shaft_cos", cos=1.0, frequency_power=2)
    model.load(vector="unbalance_shaft_sin", sin=1.0, frequency_power=2)
    model.tie("structure.speed", "tones[0]")
    with pytest.raises(ModelError, match=r"the structure is in memory, .*: model.to_file\('model.nml'\) writes"):
        model.to_namelist()
    model["tones[0]"] = 60.0
    (tmp_path / "there").mkdir()
    model.to_file(tmp_path / "there" / "shaft.nml")
    subprocess.run([Path(os.environ["NHBM"]).resolve(), "solve", "there/shaft.nml", "--quiet"], cwd=tmp_path, check=True)
    found = nhbm.open_dataset(tmp_path / "shaft.h5")
    assert float(found.nhbm.amplitude("disk1.x")) == pytest.approx(model.response("disk1.x (1)"), rel=1e-9)
    again = Model.from_file(tmp_path / "there" / "shaft.nml")
    assert again.response("disk1.x (1)") == pytest.approx(model.response("disk1.x (1)"), rel=1e-9)
    own = duffing(spring=cubic)
    own.law(cubic, "x1")
    with pytest.raises(ModelError, match="law 'cubic' is a function of Python, which the command cannot call"):
        own.to_file(tmp_path / "own.nml")
    assert not (tmp_path / "own.nml").exists()
    with pytest.raises(ModelError, match="cannot be written: No such file"):
        duffing().to_file(tmp_path / "nothing" / "own.nml")


def test_inputs_go_both_ways():
    """The complete input of a model gives the same model, with values set since and laws in Python; &sweep is left out."""
    model = duffing(spring=cubic)
    model.law(cubic, "x1")
    model["tones[0]"] = 0.95
    text = model.to_namelist()
    again = Model.from_namelist(text)
    assert "frequency = 0.95" in text and again.to_namelist() == text
    same(again.solve(order=5)["coefficients"].values, model.solve(order=5)["coefficients"].values, "coefficients")
    for path in ("gallery/duffing_response.nml", "paper/wall.nml", "autonomous/van_der_pol.nml", "rotor_stator/rotating.nml"):
        text = Model.from_file(ROOT / "inputs" / path).to_namelist()
        again = Model.from_namelist(text, (ROOT / "inputs" / path).parent).to_namelist()
        assert sorted(again.splitlines()) == sorted(text.splitlines())


def test_what_is_wrong_is_said():
    with pytest.raises(ModelError, match="type = 'chian' is not known; did you mean 'chain'"):
        Model.from_namelist(DUFFING.replace("chain", "chian"))
    with pytest.raises(ModelError, match=r"mass has the shape \(1, 4\), not \(1, 1\): matrices must be square and equal in size"):
        nhbm.Matrices([1, 0, 0, 1], np.eye(2))
    with pytest.raises(ModelError, match=r"damping has the shape \(1, 1\), not \(2, 2\)"):
        nhbm.Matrices(np.eye(2), np.eye(2), 0.1)
    with pytest.raises(ModelError, match="keys of &tones such as {'unknown': True}"):
        Model(nhbm.Chain(n_masses=1, mass=1.0, coupling_stiffness=1.0), tones=[None])
    model = Model.from_namelist(DUFFING)
    with pytest.raises(ModelError, match="'law.stop.%gap'.*spring"):
        model["stop.gap"] = 0.1
    with pytest.raises(ModelError, match="unknown group 'harmonic'; did you mean 'harmonics'"):
        model.set("harmonic", order=3)
    with pytest.raises(ModelError, match="'wall gap!' has no key, as in wall.gap"):
        model["wall gap!"] = 1.0
    with pytest.raises(ModelError, match="'wall.gap.x' is not a path"):
        model["wall.gap.x"] = 1.0
    with pytest.raises(KeyError, match="no column 'amplitude'; known: status reason n_periods message"):
        session_of(DUFFING).column("amplitude")
    with pytest.raises(ModelError, match="'tones%frequency': frequency.1. = -1.0 must be 0.0 or greater"):
        model["tones%frequency"] = -1.0
    motion = model.solve()
    assert motion.nhbm.is_converged and motion.nhbm.message == ""
    with pytest.raises(KeyError, match="there is no degree of freedom 'x2'; known: x1"):
        motion.nhbm.amplitude("x2")
    with pytest.raises(ModelError, match="curve"):
        session_of(DUFFING).begin_curve()
    with pytest.warns(nhbm.NotConverged, match="budget|iterations|residual"):
        Model.from_namelist(DUFFING + "&solver max_iterations = 1, fallback = .false. /\n").solve(order=7)


def test_a_label_names_a_bearing_too():
    """A tie took every label for that of a law."""
    model = Model(nhbm.Matrices(mass=np.eye(2), damping=np.eye(2), stiffness=np.eye(2)), tones=[1.5])
    model.load("x1", 1, cos=0.1)
    table = {"speeds": [0.0, 2.0], "stiffness": [[1.0, 0.0, 0.0, 1.0], [3.0, 0.0, 0.0, 3.0]]}
    model.bearing(["x1", "x2"], **table, speed=0.5, label="seal")
    model.tie("seal.speed", "tones[0]")
    x = 0.1 / abs(1.0 + 2.5 - 1.5**2 + 1.5j)  # at its speed of 1.5 rad/s
    assert float(model.solve(order=1).nhbm.amplitude("x1")) == pytest.approx(x, rel=1e-9)


def test_groups_are_added_by_their_keys():
    """Of a group that has no method of its own, too."""
    table = {"speeds": [0.0, 2.0], "stiffness": [[1.0, 0.0, 0.0, 1.0], [3.0, 0.0, 0.0, 3.0]]}
    by_methods, by_keys = (
        Model(nhbm.Matrices(mass=np.eye(2), damping=np.eye(2), stiffness=np.eye(2)), tones=[1.5]) for _ in range(2)
    )
    by_methods.load("x1", 1, cos=0.1)
    by_methods.law("cubic_spring", "x2", stiffness=3.0)
    by_methods.bearing(["x1", "x2"], **table, speed=0.5, label="seal")
    by_keys.add("load", dof="x1", tuple=1, cos=0.1)
    by_keys.add("law", type="cubic_spring", dof="x2", stiffness=3.0)
    by_keys.add("bearing", dofs=["x1", "x2"], **table, speed=0.5, label="seal")
    assert by_keys.to_namelist() == by_methods.to_namelist()
    with pytest.raises(nhbm.ModelError, match="'harmonics' is not a group of which there may be several"):
        by_keys.add("harmonics", order=3)
    with pytest.raises(nhbm.ModelError, match="did you mean 'bearing'"):
        by_keys.add("baering", dofs=["x1", "x2"])
    with pytest.raises(nhbm.ModelError, match="load: unknown key 'cosine'"):
        by_keys.add("load", dof="x1", cosine=3.0)


def test_models_are_made_of_values():
    same(duffing().solve()["coefficients"].values, Model.from_namelist(DUFFING).solve()["coefficients"].values, "coefficients")
    wall = Model(
        nhbm.Beam(length=1.0, bending_stiffness=1750.0, mass_per_length=7.8, n_elements=4, damping_diagonal=1.0),
        tones=[np.e, np.pi],
    )
    wall.load("v3", (1, 0), cos=100)
    wall.load("v3", (0, 1), cos=100)
    wall.law("rigid_wall", "v3", gap=1.5e-3, label="wall")
    wall.set("error_estimate", penetration=0.1)
    motion = wall.solve(order=8)
    assert motion.nhbm.is_converged and motion["coefficients"].dims == ("dof", "harmonic", "component")
    first = motion.nhbm.harmonic("v3", (1, 0))
    assert complex(motion.nhbm.harmonic("v3", (-1, 0))) == complex(first).conjugate()
    times = np.linspace(0.0, 40.0, 500)
    direct = sum(c * np.cos(j @ [np.e, np.pi] * times) + s * np.sin(j @ [np.e, np.pi] * times)
                 for j, (c, s) in zip(motion["tuple"].values, motion["coefficients"].sel(dof="v3").values))  # fmt: skip
    np.testing.assert_allclose(motion.nhbm.time("v3", times), direct, atol=1e-12)
    np.testing.assert_allclose(motion.nhbm.time("v3", 0.0), direct[0], atol=1e-12)  # a single time


def test_structures_come_from_memory_and_from_files(tmp_path):
    """Matrices of SciPy, a model file and a chain of the solver give the same motion; sets and load vectors are included."""
    n = 3
    k = np.diag([2.0, 2.0, 2.0]) - np.diag([1.0, 1.0], 1) - np.diag([1.0, 1.0], -1)
    structure = nhbm.Structure(
        mass=np.eye(n), stiffness=k, damping=0.1 * np.eye(n), labels=["x1", "x2", "x3"], node_numbers=np.arange(1, 4),
        coordinates=np.zeros((3, 3)), dof_node=np.arange(3), dof_direction=["x"] * 3, sets={"tip": np.array([2])},
        loads={"push": (np.array([0]), np.array([2.0]))},
    )  # fmt: skip
    structure.write(tmp_path / "chain.h5")
    found = []
    for source in (structure, tmp_path / "chain.h5", nhbm.Matrices(np.eye(n), k, 0.1 * np.eye(n))):
        is_builder = isinstance(source, nhbm.Matrices)
        model = Model(source, tones=[0.7])
        if is_builder:
            model.load("x1", 1, cos=0.6)
        else:
            model.load(vector="push", cos=0.3)
            known = "known: x1, x2, x3; sets: tip; did you mean 'tip.x'"
            with pytest.raises(ModelError, match=f"unknown degree of freedom 'tp.x'; {known}"):
                model.load("tp.x", cos=0.3)
                model.solve(order=1)
            model = Model(source, tones=[0.7])
            model.load(vector="push", cos=0.3)
        model.law("cubic_spring", "x3" if is_builder else "tip.x", stiffness=0.5)
        motion = model.solve(order=7)
        found.append(motion["coefficients"].values)
        if not is_builder:  # a set of one node names its degrees of freedom in results, too
            assert complex(motion.nhbm.harmonic("tip.x")) == complex(motion.nhbm.harmonic("x3"))
            assert motion.nhbm.largest("tip.x") == motion.nhbm.largest("x3")
            assert model.response("tip.x (1)", order=7) == model.response("x3 (1)", order=7)
            curve = model.curve("tones[0]", 0.7, 0.71, order=5, peak_of="tip.x (1)")
            assert float(curve.nhbm.amplitude("tip.x")[0]) == float(curve.nhbm.amplitude("x3")[0]) > 0
            with pytest.raises(KeyError, match="there is no degree of freedom 'tip.z'; known: x1, x2, x3, tip.x"):
                motion.nhbm.harmonic("tip.z")
    same(found[0], found[1], "coefficients")
    np.testing.assert_allclose(found[0], found[2], rtol=1e-12)
    with pytest.raises(ModelError, match="nowhere.h5.*does not exist"):
        Model(tmp_path / "nowhere.h5", tones=[1.0]).solve()


def dual_rotor():
    """Two shafts with different speeds, a bearing with clearance between them and a casing that the first disk may touch."""
    rotor = nhbm.Rotor()
    rotor.shaft(np.linspace(0, 1.6, 11), 0.06, name="low")
    rotor.shaft(np.linspace(0.5, 1.2, 8), 0.12, 0.09, name="high", speed=2)
    rotor.disk(0.16, 8.0, 0.1, 0.2, shaft="low")
    rotor.disk(0.7, 7.0, 0.08, 0.15, shaft="high")
    rotor.bearing(0.0, 2e7, 800.0, shaft="low")
    rotor.bearing(1.6, 2e7, 800.0, shaft="low")
    rotor.bearing(0.5, 3e7, 800.0, shaft="high")
    rotor.between(1.2, "low", "high", 1e5, 200.0)
    rotor.unbalance(0.16, 1e-4, shaft="low")
    rotor.unbalance(0.7, 8e-5, shaft="high")
    model = Model(rotor.structure(), tones=[60.0, 71.5], harmonics={"order": 3})
    model.set("structure", speed=[60.0, 71.5], damping_stiffness=1e-5)
    for i, shaft in enumerate(("low", "high")):
        model.tie(f"structure%speed({i + 1})", f"tones%frequency({i + 1})")
        model.load(vector=f"unbalance_{shaft}_cos", tuple_=np.eye(2)[i], cos=1.0, frequency_power=2)
        model.load(vector=f"unbalance_{shaft}_sin", tuple_=np.eye(2)[i], sin=1.0, frequency_power=2)
    model.law("annular_clearance", ["inner1.x", "inner1.y", "outer1.x", "outer1.y"], label="bearing", stiffness=2e7, clearance=1e-5)
    return model


@pytest.mark.long  # seconds
def test_rotors_turn_with_their_tones():
    """A curve over the speed of the first shaft, with a constant ratio of the second one: its points equal those of models at these
    speeds."""
    model = dual_rotor()
    curve = model.curve("tones%frequency(1)", 60.0, 60.2, tie="ratio")
    assert bool(curve.nhbm.is_converged.all()) and curve.sizes["point"] >= 3
    at = curve.isel(point=-1)
    speeds = at["frequency"].values
    assert speeds[1] / speeds[0] == pytest.approx(71.5 / 60.0, rel=1e-12)
    for i in range(2):
        model[f"tones%frequency({i + 1})"] = speeds[i]
    point = model.solve()
    assert np.allclose(point["coefficients"], at["coefficients"], rtol=1e-7, atol=1e-7 * float(abs(at["coefficients"]).max()))
    with pytest.raises(ModelError, match="follows 'tones%frequency'"):
        model.curve("structure%speed(1)", 60.0, 66.0)


def test_models_are_sent_with_their_values():
    """Pickled, with laws in Python and changed values; executors with `map`, that of Dask if it is installed."""
    model = duffing(spring=True)
    model.law(nhbm.law(cubic, odd=True), "x1")
    model["tones[0]"] = 0.8
    again = pickle.loads(pickle.dumps(model))
    same(again.solve(order=5)["coefficients"].values, model.solve(order=5)["coefficients"].values, "coefficients")
    values = {"tones[0]": np.linspace(0.6, 0.9, 4)}
    alone = model.sweep(values, order=5)["coefficients"].values
    with ThreadPoolExecutor(2) as executor:
        same(model.sweep(values, order=5, executor=executor)["coefficients"].values, alone, "coefficients")
    distributed = pytest.importorskip("distributed")
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        found = again.sweep(values, order=5, executor=client.get_executor())
    same(found["coefficients"].values, alone, "coefficients")


def test_progress_is_reported(monkeypatch):
    """To a function, or by a progress bar of tqdm, which is optional."""
    counts, shown = [], []

    class Bar:
        def __init__(self, **keys):
            self.total = keys["total"]

        def update(self, n):
            shown.append(n)

        def close(self):
            shown.append(self.total)

    monkeypatch.setitem(sys.modules, "tqdm.auto", types.SimpleNamespace(tqdm=Bar))
    monkeypatch.setitem(sys.modules, "tqdm", types.SimpleNamespace(auto=sys.modules["tqdm.auto"]))
    for progress in (counts.append, True):
        duffing().sweep({"tones[0]": [0.6, 0.7, 0.8]}, order=3, progress=progress)
    assert counts == [1, 2, 3] and shown == [1, 1, 1, 3]
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.warns(UserWarning, match="draws a bar of tqdm, which is not installed"):
        assert duffing().curve("tones[0]", 0.6, 0.7, order=3, progress=True).sizes["point"] > 1


def test_wrong_loads_are_reported_when_they_are_added():
    model = Model(nhbm.Matrices(mass=1.0, damping=0.05, stiffness=1.0), tones=[0.5])
    for message, keys in (
        ("unknown degree of freedom 'x9'; known: x1", {"dof": "x9"}),
        ("tuple has 2 values, needs 1", {"dof": "x1", "tuple_": (1, 0)}),
        ("did you mean 'frequency_power'", {"dof": "x1", "frequncy_power": 2}),
    ):
        with pytest.raises(ModelError, match=f"^&load.*{message}"):
            model.load(cos=1.0, **keys)
    with pytest.raises(ModelError, match="&start: .*'x2'"):
        model.start("x2", cos=1.0)
    model.load("x1", cos=0.1)
    assert model.solve(order=1).nhbm.is_converged  # the wrong ones were not added
    free = Model(nhbm.Matrices(mass=1.0, stiffness=1.0), tones={"unknown": True})
    free.start("x1", cos=0.1)  # what &tones still lacks, a law, is no mistake of this group
    plate = nhbm.Structure(sp.identity(2), sp.identity(2), ["a", "b"])
    with pytest.raises(ModelError, match="&load: .*'c'"):
        Model(plate, tones=[0.5]).load("c", cos=1.0)


def test_wrong_keys_are_reported_when_they_are_set():
    model = duffing()
    for value in (1.0, [1.0]):  # by a handle, by a text
        with pytest.raises(ModelError, match="unknown key 'stifness'; did you mean 'stiffness'"):
            model["spring.stifness"] = value
    with pytest.raises(ModelError, match="unknown key 'tolerence'"):
        model["solver.tolerence"] = 1e-8
    assert model.solve(order=3).nhbm.is_converged


def test_what_is_refused_leaves_the_model_as_it_was():
    model = duffing()
    before = model.response("x1 (1)", order=3)
    for wrong in ({"order": 2.5}, {"tolerance": "a"}):
        with pytest.raises(ModelError, match="2.5|'a'"):
            model.solve(**wrong)
    model["spring.stiffness"] = 0.7
    assert "order" not in model.to_namelist()  # that of an operation is not the model's
    model["spring.stiffness"] = 0.5
    assert model.response("x1 (1)", order=3, warm=False) == before


CURVE = "&curve parameter = 'tones%frequency', from = 0.5, to = 0.6, peak_of = 'x1 (1)' ! a/b\n /\n"


def test_curve_of_an_input_is_replaced():
    found = [Model.from_namelist(text).curve("tones[0]", 0.8, 1.2, order=3) for text in (DUFFING, DUFFING + CURVE, CURVE + DUFFING)]
    for other in found[1:]:
        np.testing.assert_array_equal(found[0]["coefficients"], other["coefficients"])


def test_keys_are_set_in_groups_of_an_input():
    model = Model.from_namelist(DUFFING + "&solver max_iterations = 30, tolerance = 1e-11 /\n&integration duration = 20.0 /\n")
    model.set("solver", max_iterations=40)
    assert (model["solver.max_iterations"], model["solver.tolerance"]) == (40, 1e-11)
    assert float(model.integrate(transient=1.0)["time"][-1]) == pytest.approx(21.0, abs=0.1)


def test_values_are_read_by_path():
    model = duffing()
    model.law("elastic_stop", "x1", stiffness=20.0, gap=0.1 + 0.2, label="it's a stop")
    assert model["spring.stiffness"] == model["law[0].stiffness"] == model["law(spring)%stiffness"] == 0.5
    assert model["law[1].gap"] == 0.1 + 0.2 and model["law[1].label"] == "it's a stop"
    assert model["tones[0]"] == 0.9 and model["tones.unknown"] is False and model["load[0].tuple"] == 1
    model["spring.stiffness"] = 1.0 / 3.0
    assert model["spring.stiffness"] == 1.0 / 3.0
    matrices = nhbm.Model(nhbm.Matrices([[1.0, 0.0], [0.0, 1.0]], [[2.0, -1.0], [-1.0, 2.0]]), tones=[0.9])
    assert matrices["structure.stiffness"] == [2.0, -1.0, -1.0, 2.0] and matrices["structure%stiffness(2)"] == -1.0
    for path, message in {
        "spring.gap": "'spring.gap': there is no such value; known keys: type, label",
        "law[7].gap": r"'law\[7\].gap': there is no such &law; the model has law\[0\], law\[1\]$",
        "stop.gap": "'stop.gap': no group &law has the label 'stop'; labels: 'spring', .*; known groups: structure, tones",
        "law.stiffness": "there are several groups &law",
        "tones[3]": "frequency has 1 value$",
    }.items():
        with pytest.raises(ModelError, match=message):
            model[path]


def test_what_was_added_can_be_removed():
    model, before = duffing(), duffing().response("x1 (1)", order=3)
    model.load("x1", 1, cos=1.0)
    assert model.response("x1 (1)", order=3) != before
    del model["load[1]"]
    assert model.response("x1 (1)", order=3) == before
    model.law("elastic_stop", "x1", stiffness=20.0, gap=0.1, label="stop")
    model.law("cubic_spring", "x1", stiffness=1.0)
    model["stop.gap"] = 0.2
    model["law[2].stiffness"] = 0.0
    assert model.response("x1 (1)", order=3) != before
    del model["stop"]
    assert model.response("x1 (1)", order=3) == pytest.approx(before, rel=1e-12) and model["law[1].stiffness"] == 0.0
    for wrong in ("stop", "load[1]", "tones[0]"):
        with pytest.raises(ModelError, match="names no load, law or other group in this model"):
            del model[wrong]


def test_sparse_matrices_need_no_labels():
    mass, stiffness = sp.identity(2, format="csr"), sp.csr_matrix([[2.0, -1.0], [-1.0, 2.0]])
    found = []
    for structure in (nhbm.Matrices(mass, stiffness, 0.02 * stiffness), nhbm.Structure(mass, stiffness, damping=0.02 * stiffness)):
        model = nhbm.Model(structure, tones=[0.9])
        model.load("x1", 1, cos=0.1)
        model.law("cubic_spring", "x2", stiffness=0.5)
        found.append(model.response("x2 (1)", order=3))
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_the_table_of_keys():
    rows = [line for line in (ROOT / "src" / "input_keys.txt").read_text().splitlines() if line and not line.startswith("#")]
    assert [" | ".join(key) for key in nhbm.input_keys()] == rows
    gap = next(key for key in nhbm.input_keys() if (key.section, key.name) == ("law rigid_wall", "gap"))
    assert (gap.type, gap.unit, gap.default) == ("real", "m", "required")


def test_one_of_several_values_is_set_for_all_operations():
    """Also by sessions that begin later: another order, another tolerance."""
    chain = nhbm.Chain(n_masses=2, mass=[1.0, 2.0], coupling_stiffness=[1.0, 1.0, 1.0], damping_mass=0.1)
    model = Model(chain, tones=[0.9])
    model.load("x1", 1, cos=0.1)
    model.solve(order=1)
    model.solve(order=3)
    model["structure.mass[1]"] = 3.0
    expected = Model(nhbm.Chain(n_masses=2, mass=[1.0, 3.0], coupling_stiffness=[1.0, 1.0, 1.0], damping_mass=0.1), tones=[0.9])
    expected.load("x1", 1, cos=0.1)
    for order in (1, 3, 5):
        assert model.response("x1 (1)", order=order) == pytest.approx(expected.response("x1 (1)", order=order), rel=1e-12)
    matrices = Model(nhbm.Matrices(np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], 0.1 * np.eye(2)), tones=[0.9])
    matrices.load("x1", 1, cos=0.1)
    matrices.solve(order=1)
    matrices["structure%stiffness(2,2)"] = 3.0
    other = Model(nhbm.Matrices(np.eye(2), [[2.0, -1.0], [-1.0, 3.0]], 0.1 * np.eye(2)), tones=[0.9])
    other.load("x1", 1, cos=0.1)
    assert matrices.response("x1 (1)", order=3) == pytest.approx(other.response("x1 (1)", order=3), rel=1e-12)


def test_one_element_of_a_table_is_set_for_all_operations():
    """Of three rows of four numbers, it was another one for operations with other settings."""
    structure = nhbm.Matrices(mass=np.eye(2), damping=np.eye(2), stiffness=np.eye(2))
    table = np.array([[1.0, 0.0, 0.0, 1.0], [3.0, 0.0, 0.0, 3.0], [5.0, 0.0, 0.0, 5.0]])
    found = []
    for value in (3.0, 4.0):
        model = Model(structure, tones=[1.5])
        model.load("x1", 1, cos=0.1)
        model.bearing(["x1", "x2"], [0.0, 2.0, 4.0], table, speed=2.0, label="seal")
        model.solve(order=3)
        model["seal.stiffness[1, 0]"] = 4.0
        table[1, 0] = 4.0
        found.append([model.response("x1 (1)", order=order) for order in (1, 3)])
        assert model["seal.stiffness[1, 0]"] == 4.0
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_no_text_is_between_a_model_and_the_library(monkeypatch):
    """Groups, values and settings are handed over one by one; inputs are read where somebody gives one."""
    monkeypatch.setattr(nhbm.Session, "read", lambda *arguments: pytest.fail("an input was read"))
    model = duffing()
    model.law("elastic_stop", "x1", stiffness=2.0, gap=0.1, label="stop")
    model["stop.gap"] = 0.2
    model.set("stability", method="off")
    motion = model.solve(order=5)
    assert model.gradient("x1 (1)", ["stop.gap"], order=5).value == pytest.approx(float(motion.nhbm.amplitude("x1")), rel=1e-9)
    assert model.response("x1 (1)", tolerance=1e-3) > 0.0 and model["harmonics.symmetry"] == "auto"
    assert model.sweep({"tones[0]": [0.8, 0.9]}, order=3).sizes["point"] == 2
    assert model.curve("tones[0]", 0.8, 0.9, order=3).sizes["point"] > 3
    assert model.integrate(10.0, order=3)["displacement"].size > 0 and model.verify(motion)["integration_verdict"].size == 1
    del model["stop"]
    assert "elastic_stop" not in model.to_namelist() and model.census(starts=3, order=3).sizes["point"] >= 1


def test_a_call_that_is_interrupted_leaves_the_model_as_it_is(monkeypatch):
    model, expected = duffing(), duffing().response("x1 (1)", order=5)
    true = nhbm.Session._set

    def interrupted(*arguments):
        monkeypatch.setattr(nhbm.Session, "_set", true)
        raise KeyboardInterrupt

    for _ in range(3):
        monkeypatch.setattr(nhbm.Session, "_set", interrupted)
        model._session = None
        with pytest.raises(KeyboardInterrupt):
            model.response("x1 (1)", order=5)
        assert model.response("x1 (1)", order=5) == expected


def test_a_free_decay_has_no_tones():
    """A unit mass on a spring, from a displacement and a velocity."""
    model = nhbm.Model(nhbm.Matrices(mass=1.0, stiffness=4.0))
    model.initial("x1", displacement=0.3)
    model.initial("x1", velocity=-0.8)
    record = model.integrate(10.0, step=0.1, tolerance=1e-13)
    t = record["time"].values
    np.testing.assert_allclose(record["displacement"].values[0], 0.3 * np.cos(2 * t) - 0.4 * np.sin(2 * t), atol=1e-9)
    assert "frequency" not in record
    with pytest.raises(nhbm.ModelError, match="missing tones"):
        model.solve()


def test_a_pulse_is_a_load_of_time_alone():
    """A constant force for half a period leaves no motion after a whole one."""
    model = nhbm.Model(nhbm.Matrices(mass=1.0, stiffness=4.0))
    model.load("x1", cos=1.0, begin=0.5, end=0.5 + np.pi)
    record = model.integrate(10.0, step=0.1, tolerance=1e-13)
    t, x = record["time"].values, record["displacement"].values[0]
    expected = np.where((t > 0.5) & (t < 0.5 + np.pi), 0.25 * (1 - np.cos(2 * (t - 0.5))), 0.0)
    np.testing.assert_allclose(x, expected, atol=1e-9)
    model = nhbm.Model(nhbm.Matrices(mass=1.0, stiffness=4.0), tones=[1.0])
    model.load("x1", cos=1.0, frequency=3.0, end=2.0)
    with pytest.raises(nhbm.ModelError, match="a load that begins, ends"):
        model.solve()


def test_long_calls_report_their_progress():
    """Steps done and planned of `verify` and `census`, points of `peak`; what the function raises ends the call."""
    model = duffing()
    model["structure.damping_mass"] = 0.01
    motion = model.solve(order=5)
    for call in (lambda report: model.verify(motion, periods=400, progress=report),
                 lambda report: model.census(starts=4000, order=5, progress=report)):  # fmt: skip
        seen = []
        call(lambda *numbers, seen=seen: seen.append(numbers))
        assert seen and all(0 <= n <= total for n, total in seen) and [n for n, _ in seen] == sorted(n for n, _ in seen)
    counts = []
    model.peak("x1 (1)", "tones[0]", 0.5, 1.5, order=5, progress=counts.append)
    assert counts == list(range(1, len(counts) + 1)) and len(counts) > 5
    with pytest.raises(ZeroDivisionError):
        model.peak("x1 (1)", "tones[0]", 0.5, 1.5, order=5, progress=lambda n: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        model.verify(motion, periods=400, progress=lambda *_: 1 / 0)
    assert model.verify(motion, periods=40)["integration_verdict"].item() in ("agrees", "undecided")
