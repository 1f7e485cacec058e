"""One result everywhere: datasets of models, files of the command, and files that datasets are saved as."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import warnings

import h5py
import numpy as np
import pytest
import xarray as xr
from nhbm_post.measure import Measure
from nhbm_post.reader import Results
from nhbm_post.structure import structure_of

from in_process import DUFFING, STOP, duffing
from program import ALL_CONVERGED, INCOMPLETE, run

import nhbm
from nhbm import Model, ModelError, dataset

RANGE, COARSE = ("tones[0]", 0.5, 2.5), {"order": 5, "max_step": 0.2}  # of curves with few points
INTERNALS = {"curve_unknowns", "curve_direction", "curve_step", "iterations", "residual", "setup_seconds", "rank", "fallback"}


def stop(**groups):
    model = Model.from_namelist(STOP)
    for name, keys in groups.items():
        model.set(name, **keys)
    return model


def self_excited(**tones):
    model = Model(nhbm.Matrices(mass=1.0, stiffness=1.0), tones=tones)
    if len(tones["unknown"]) > 1:
        model.load("x1", (1, 0), cos=0.3)
    model.law("van_der_pol", "x1", strength=0.3, label="feed")
    return model


def normal_mode():
    model = Model(nhbm.Chain(n_masses=2, ends="fixed", mass=1.0, coupling_stiffness=1.0), tones={"unknown": [True]})
    model.law("cubic_spring", "x1", stiffness=0.5)
    model.set("normal_mode", amplitude=0.1, dof="x1", mode=1)
    return model


def duffing_with(**groups):
    model = duffing()
    for name, keys in groups.items():
        model.set(name, **keys)
    return model


def long_chain():
    """Its stability takes too long, and one coordinate is stored."""
    model = Model(nhbm.Chain(n_masses=400, ends="fixed", mass=1.0, coupling_stiffness=1e4, damping_mass=0.1), tones=[0.7])
    model.load("x1", 1, cos=0.3)
    model.law("jenkins", "x1", stiffness=0.5, limit=0.1)
    model.set("output", dofs=["x1"])
    return model


@functools.cache
def results():
    return {
        "motion": duffing().solve(order=5),
        "by tolerance": stop().solve(tolerance=1e-2),
        "curve": duffing().curve(*RANGE, **COARSE, peak_of="x1 (1)"),
        "curve by tolerance": duffing().curve("tones[0]", 0.8, 1.2, tolerance=1e-2),
        "sweep": duffing().sweep({"load[0].cos": [0.1, 0.2], "spring.stiffness": [0.4, 0.5, 0.6]}, order=5),
        "long sweep": duffing().sweep({"tones[0]": np.linspace(0.5, 0.7, 60)}, order=5),
        "shared sweep": duffing().sweep({"tones[0]": [0.8, 0.9, 1.0]}, order=5, workers=2),
        "samples": duffing().sweep({"load[0].cos": [0.1, 0.2], "tones[0]": [0.8, 0.9]}, order=5, paired=True),
        "limit cycle": self_excited(unknown=[True]).solve(order=7),
        "torus": self_excited(frequency=[1.8, 0.0], unknown=[False, True]).solve(order=5),
        "limit cycles": self_excited(unknown=[True]).sweep({"feed.strength": [0.5, 1.0]}, order=7),
        "backbone": normal_mode().curve("normal_mode%amplitude", 0.1, 1.0, **COARSE),
        "census": duffing().census(starts=5, order=7),
        "integrated": duffing_with(solver={"primary_method": "integration"}).solve(order=5),
        "without estimates": duffing_with(error_estimate={"is_on": False}).solve(order=5),
        "without stability": duffing_with(stability={"method": "off"}).solve(order=5),
        "stability unknown": long_chain().solve(order=5),
    }


def test_a_model_without_laws_is_saved_for_the_command(tmp_path):
    """Its axes of laws, without labels, were numbers, and no result file to the command."""
    model = Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
    model.load("x1", 1, cos=0.1)
    model.sweep({"tones[0]": [0.8, 0.9]}, order=3).nhbm.save(tmp_path / "linear.h5")
    for verb in (("info", "--check"), ("why",), ("verify",)):
        done = run(verb[0], "linear.h5", *verb[1:], cwd=tmp_path)
        assert done.status == ALL_CONVERGED, done.stderr


@pytest.mark.parametrize(("settings", "status"), [
    ({"error_estimate": {"is_on": False}}, "converged"),
    pytest.param({"solver": {"primary_method": "integration"}}, "integrated", marks=pytest.mark.long),
    ({"solver": {"max_iterations": 0, "homotopy_iterations": 0, "fallback_by_integration": False}}, "out_of_budget"),
])  # fmt: skip
def test_a_motion_without_error_estimate_is_a_result_like_others(settings, status, tmp_path):
    """Its frequency and its tuples were lost with the estimates of both, and it could not be saved."""
    model = duffing()
    for name, keys in settings.items():
        model.set(name, **keys)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", nhbm.NotConverged)
        found = model.solve(order=5)
    assert found.status == status
    assert found.frequency.dims == ("tone",)
    assert found.tuple.dims == ("harmonic", "tone")
    found.nhbm.save(tmp_path / "one.h5")
    again = nhbm.open_dataset(tmp_path / "one.h5")
    assert again.frequency.values.ravel() == found.frequency.values
    if status == "out_of_budget":
        with pytest.raises(ModelError, match="^no point is solved"):
            found.nhbm.report()
    else:
        assert found.nhbm.amplitude("x1", (1,)) > 0
        found.nhbm.report().save(tmp_path / "one.html")


@pytest.mark.long
def test_users_get_what_they_need_and_internals_stand_apart():
    for name, data in results().items():
        assert not INTERNALS & set(data.variables), name
        assert len(data.data_vars) <= 20, name
        details = data.nhbm.details
        assert {"iterations", "residual", "n_unknowns"} <= set(details.data_vars)
        assert not set(details.data_vars) & set(data.data_vars)
        assert all(data[column].attrs.get("units") and data[column].attrs.get("long_name") for column in data.data_vars), name
        assert set(np.unique(data["status"])) == {"integrated" if name == "integrated" else "converged"}
        assert set(np.unique(data["stability"])) <= {"stable", "unstable", "unknown"}, name
        assert data.attrs["program_version"] == nhbm.__version__ and data.attrs["git_commit"]
        assert data.nhbm.input.startswith("&structure")
    curve = results()["curve"]
    assert "curve_step" in curve.nhbm.details and curve.isel(point=[2, 5]).nhbm.details["curve_step"].sizes["point"] == 2


@pytest.mark.parametrize("name", [
    *("by tolerance", "curve by tolerance", "sweep", "samples", "limit cycle", "torus", "backbone", "census", "integrated"),
    *("without estimates", "without stability", "stability unknown"),
    *(pytest.param(name, marks=pytest.mark.long) for name in ("motion", "curve", "long sweep", "shared sweep", "limit cycles")),
])  # fmt: skip
def test_a_saved_result_is_read_back_unchanged(name, tmp_path):
    data = results()[name]
    data.nhbm.save(tmp_path / "saved.h5")
    again = nhbm.open_dataset(tmp_path / "saved.h5")
    xr.testing.assert_identical(again.load(), data)
    details = again.nhbm.details
    for column, values in data.nhbm.details.data_vars.items():
        np.testing.assert_array_equal(details[column].values, values.values, err_msg=f"{name}: {column}")
    again.close()


AS_COMMANDS = {
    "sweep": (
        DUFFING + "&harmonics order = 5 /\n&sweep parameter = 'law(spring)%stiffness', values = 0.4, 0.5 /\n",
        lambda m: m.sweep({"spring.stiffness": [0.4, 0.5]}, order=5),
    ),
    "curve": (
        DUFFING + "&harmonics order = 5 /\n&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, max_step = 0.2 /\n",
        lambda m: m.curve(*RANGE, **COARSE),
    ),
    "tolerance": (DUFFING, lambda m: m.solve()),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name in ("sweep", "curve"))) for name in AS_COMMANDS]
)
def test_a_saved_result_is_that_of_the_command(name, tmp_path):
    """The same datasets with the same attributes, and the same numbers."""
    text, solve = AS_COMMANDS[name]
    (tmp_path / "ours.nml").write_text(text)
    assert run("solve", "ours.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    solve(Model.from_namelist(DUFFING)).nhbm.save(tmp_path / "python.h5")
    flags = {"flag_meanings", "flag_labels", "flag_plurals", "flag_marks", "bifurcations", "response_keys", "origins"}
    with h5py.File(tmp_path / "ours.h5") as ours, h5py.File(tmp_path / "python.h5") as python:
        assert set(ours) == set(python)
        for column in ours:
            a, b = ours[column], python[column]
            assert a.dtype == b.dtype and a.ndim == b.ndim, column
            for attribute in ("units", "long_name", "dof_units", "parameter", *flags):
                assert a.attrs.get(attribute) == b.attrs.get(attribute), (column, attribute)
        assert set(ours.attrs) == set(python.attrs)
        n, k = python["coefficients"].shape[0], python["coefficients"].shape[2]
        np.testing.assert_array_equal(ours["coefficients"][:n, :, :k], python["coefficients"][()])
        assert set(ours["checksum"].attrs["of"].split()) == set(python["checksum"].attrs["of"].split())
        assert len(python["curve_unknown"]) == len(ours["curve_unknown"]) if name == "curve" else True
    opened, saved = nhbm.open_dataset(tmp_path / "ours.h5"), nhbm.open_dataset(tmp_path / "python.h5")
    assert set(opened.variables) == set(saved.variables) and opened.sizes == saved.sizes


@pytest.mark.parametrize("name", [
    *("curve", "torus", "without estimates"),
    *(pytest.param(name, marks=pytest.mark.long) for name in ("motion", "sweep", "long sweep", "shared sweep", "limit cycle")),
    *(pytest.param(name, marks=pytest.mark.long) for name in ("limit cycles", "integrated", "backbone")),
    *(pytest.param(name, marks=pytest.mark.long) for name in ("without stability", "stability unknown")),
])  # fmt: skip
def test_the_command_reads_what_was_saved(name, tmp_path):
    results()[name].nhbm.save(tmp_path / "saved.h5")
    assert run("info", "saved.h5", "--check", cwd=tmp_path).status == 0
    assert run("why", "saved.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert run("resume", "saved.h5", cwd=tmp_path).status == ALL_CONVERGED
    with Results(tmp_path / "saved.h5") as file:
        assert set(file.status) <= {1, 17, 18 if name == "integrated" else 1}
    subprocess.run([sys.executable, "-m", "nhbm_post", "report", "saved.h5", "-o", "saved.html"], cwd=tmp_path, check=True)
    assert (tmp_path / "saved.html").stat().st_size > 10_000


@pytest.mark.long
def test_a_stopped_curve_is_resumed_to_its_end(tmp_path):
    """Bit by bit as if it had not been stopped."""
    stopped = duffing().curve(*RANGE, **COARSE, on_point=lambda point: float(point["tones_frequency"]) > 1.0)
    stopped.nhbm.save(tmp_path / "curve.h5")
    assert run("info", "curve.h5", cwd=tmp_path).status == INCOMPLETE
    assert nhbm.open_dataset(tmp_path / "curve.h5")["status"].values.tolist().count("converged") == stopped.sizes["point"]
    assert run("resume", "curve.h5", cwd=tmp_path).status == ALL_CONVERGED
    whole, found = duffing().curve(*RANGE, **COARSE), nhbm.open_dataset(tmp_path / "curve.h5")
    for name in ("coefficients", "tones_frequency", "curve_kind"):
        assert np.array_equal(found[name].values, whole[name].values)
    assert run("info", "curve.h5", cwd=tmp_path).status == ALL_CONVERGED


def test_a_saved_curve_has_no_warning_of_its_own(tmp_path):
    """Its input is complete: a structure at rest has a speed there, which is zero."""
    model = Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
    model.load("x1", 1, cos=0.3)
    model.law("cubic_spring", "x1", stiffness=0.5)
    model.curve("tones[0]", 0.8, 0.9, order=3).nhbm.save(tmp_path / "curve.h5")
    done = run("resume", "curve.h5", cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "warning" not in done.stdout + done.stderr, done


def test_a_saved_motion_is_verified(tmp_path):
    results()["motion"].nhbm.save(tmp_path / "motion.h5")
    done = run("verify", "motion.h5", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done
    assert nhbm.open_dataset(tmp_path / "motion.h5").nhbm.details["integration_verdict"] == "agrees"


def test_a_structure_in_memory_is_saved_beside_the_result(tmp_path):
    model = Model(nhbm.Structure(np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]]), damping=0.1 * np.eye(2)), tones=[0.7])
    model.load("x1", 1, cos=0.1)
    model.law("cubic_spring", "x2", stiffness=0.5)
    model.solve(order=3).nhbm.save(tmp_path / "chain.h5")
    assert (tmp_path / "chain.structure.h5").is_file()
    assert run("resume", "chain.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert run("verify", "chain.h5", cwd=tmp_path).status == ALL_CONVERGED


def with_a_set():
    k = np.array([[2.0, -1.0], [-1.0, 2.0]])
    return nhbm.Structure(
        mass=np.eye(2), stiffness=k, damping=0.1 * np.eye(2), labels=["n1.x", "n2.x"], node_numbers=np.arange(1, 3),
        coordinates=np.zeros((2, 3)), dof_node=np.arange(2), dof_direction=["x", "x"],
        sets={"tip": np.array([1]), "all": np.arange(2)},
    )  # fmt: skip


@pytest.mark.long
def test_sets_name_degrees_of_freedom_of_files(tmp_path):
    """As in memory: of results that were saved, and of those of the command with the model file that they name, where it is."""
    structure = with_a_set()
    structure.write(tmp_path / "model.h5")
    for source in (structure, tmp_path / "model.h5"):
        model = Model(source, tones=[0.7])
        model.load("tip.x", 1, cos=0.1)
        motion = model.solve(order=3)
        motion.nhbm.save(tmp_path / "saved.h5")
        xr.testing.assert_identical(motion, nhbm.open_dataset(tmp_path / "saved.h5"))
    (tmp_path / "case.nml").write_text(
        "&structure type = 'model', file = 'model.h5' /\n&tones frequency = 0.7 /\n&harmonics order = 3 /\n"
        "&load dof = 'tip.x', tuple = 1, cos = 0.1 /\n"
    )
    assert run("solve", "case.nml", cwd=tmp_path).status == ALL_CONVERGED
    opened = nhbm.open_dataset(tmp_path / "case.h5")
    assert float(opened.nhbm.amplitude("tip.x", 1)) == float(opened.nhbm.amplitude("n2.x", 1)) > 0.0
    for damaged in (b"no HDF5", None):
        (tmp_path / "model.h5").write_bytes(damaged) if damaged else (tmp_path / "model.h5").unlink()
        with pytest.raises(KeyError, match="no degree of freedom 'tip.x'"):
            nhbm.open_dataset(tmp_path / "case.h5").nhbm.amplitude("tip.x", 1)


def test_results_in_another_folder_find_their_model(tmp_path):
    """A model that an input names is the same wherever the result is: saved from Python or written by the command."""
    (tmp_path / "made").mkdir()
    with_a_set().write(tmp_path / "made/model.h5")
    (tmp_path / "made/case.nml").write_text(
        "&structure type = 'model', file = 'model.h5' /\n&tones frequency = 0.7 /\n&harmonics order = 3 /\n"
        "&load dof = 'tip.x', tuple = 1, cos = 0.1 /\n&law type = 'cubic_spring', dof = 'tip.x', stiffness = 0.1 /\n"
    )
    Model.from_file(tmp_path / "made/case.nml").solve().nhbm.save(tmp_path / "saved.h5")
    assert run("solve", "made/case.nml", "-o", "solved.h5", cwd=tmp_path).status == ALL_CONVERGED
    for name in ("saved.h5", "solved.h5"):
        assert run("verify", name, cwd=tmp_path).status == ALL_CONVERGED
        assert run("resume", name, cwd=tmp_path).status == ALL_CONVERGED
        assert structure_of(Results(tmp_path / name), 0, None).points.shape == (2, 3)


def test_names_do_not_depend_on_spelling():
    model = duffing()
    for path in ("tones[0]", "tones", "tones.frequency", "tones%frequency", "tones%frequency(1)", "Tones%Frequency"):
        assert model.sweep({path: [0.8, 0.9]}, order=3).attrs["varies"] == ["tones_frequency"]
    for path in ("spring.stiffness", "law[0].stiffness", "law(spring)%stiffness", "law(1)%stiffness"):
        assert model.sweep({path: [0.4, 0.5]}, order=3).attrs["varies"] == ["law_spring_stiffness"]
    for path in ("load[0].cos", "load%cos", "load(1)%cos"):
        assert model.sweep({path: [0.1, 0.2]}, order=3).attrs["varies"] == ["load_1_cos"]
    with pytest.raises(ModelError, match="two paths of a sweep name the same value"):
        model.sweep({"tones[0]": [0.8], "tones": [0.9]}, order=3)


def test_events_of_a_curve_are_a_table():
    curve = duffing().curve(*RANGE, **COARSE, peak_of="x1 (1)")
    events = curve.nhbm.events("x1 (1)", "max x1")
    kinds = curve["curve_kind"].values
    assert events["kind"].tolist() == kinds[np.isin(kinds, ["start", "peak", "fold", "end"])].tolist()
    peak = events[events["kind"] == "peak"].iloc[0]
    assert peak["x1 (1)"] == pytest.approx(events["x1 (1)"].max()) and peak["stability"] == "stable"
    assert float(curve["tones_frequency"].sel(point=events.index[0])) == events["tones_frequency"].iloc[0] == 0.5
    with pytest.raises(ModelError, match="only curves have events"):
        duffing().solve(order=3).nhbm.events()
    several = duffing().curve(*RANGE, **COARSE, peak_of=["x1 (1)", "x1 (3)"], amplitude_of="x1", amplitudes=[0.5, 0.6])
    several = several.nhbm.events()
    assert "located" not in events and set(several["located"][several["kind"] == "amplitude"]) == {"x1"}
    assert sorted(several["located"][several["kind"] == "peak"]) == ["x1 (1)", "x1 (3)"] and several["located"].iloc[0] == ""


def test_a_response_is_the_same_everywhere():
    """'x1' is the root mean square for models, for datasets and for &curve; the largest displacement has a name of its own."""
    model = duffing()
    motion = model.solve(order=5)
    for of in ("x1", "x1 (1)", "x1 (3)"):
        assert float(motion.nhbm.response(of)) == pytest.approx(model.response(of, order=5), rel=1e-12)
    response = motion.nhbm.response("max x1")
    assert response.name == "max x1" and response.attrs == {"long_name": "Largest displacement |x1|", "units": "m"}
    assert float(motion.nhbm.response("max x1")) == float(motion.nhbm.largest("x1")) > 1.3 * float(motion.nhbm.response("x1"))
    found = model.sweep({"tones[0]": [0.8, 0.9]}, of="x1", order=5)
    points = model.sweep({"tones[0]": [0.8, 0.9]}, order=5)
    np.testing.assert_allclose(points.nhbm.response("x1"), found["response"], rtol=1e-12)
    assert found["response"].attrs["units"] == "m"
    curve = model.curve(*RANGE, **COARSE, peak_of="x1")
    of_curve = curve.nhbm.response("x1")
    assert float(of_curve.max()) == float(of_curve[curve["curve_kind"].values == "peak"][0])


def test_the_largest_displacement_is_over_all_phases(tmp_path):
    """Whatever other frequencies a sweep has and however far tones are apart: linear motions, whose amplitudes add up."""
    model = Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
    model.load("x1", 1, cos=0.3)
    points = model.sweep({"tones[0]": [0.001, 0.5, 1.024, 4.096]}, order=1)
    np.testing.assert_allclose(points.nhbm.largest("x1"), points.nhbm.amplitude("x1"), rtol=1e-12)
    model = Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.001, 0.9])
    model.load("x1", (1, 0), cos=0.1)
    model.load("x1", (0, 1), sin=0.3)
    model.set("gradient", by=["load[0].cos", "load[1].sin"])
    points = model.sweep({"tones[1]": [0.5 + 1e-9, 0.9]}, order=1)
    parts = [points.nhbm.amplitude("x1", j) for j in ((1, 0), (0, 1))]
    np.testing.assert_allclose(points.nhbm.largest("x1"), parts[0] + parts[1], rtol=1e-12)
    slopes = np.stack([parts[0] / 0.1, parts[1] / 0.3], axis=1)
    np.testing.assert_allclose(points.nhbm.gradient("max x1"), slopes, rtol=1e-9)
    points.nhbm.save(tmp_path / "points.h5")
    with Results(tmp_path / "points.h5") as results:
        np.testing.assert_allclose(points.nhbm.largest("x1"), Measure("peak").values(results, "x1"), rtol=1e-12)


def test_points_without_a_motion_have_no_response():
    """Their coefficients are those of the last iterate."""

    def brittle(q):
        return 0.1 * q**3 if np.abs(q).max() < 0.6 else np.full_like(q, np.nan)

    model = Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.5])
    model.load("x1", 1, cos=0.3)
    model.law(brittle, "x1")
    with pytest.warns(nhbm.NotConverged, match="gave NaN"):
        points = model.sweep({"tones[0]": [0.5, 1.0, 1.6]}, order=3)
    assert points["status"].values.tolist() == ["converged", "not_finite", "converged"]
    for values in (points.nhbm.amplitude("x1"), points.nhbm.harmonic("x1"), points.nhbm.largest("x1"), points.nhbm.time("x1", 0.0),
                   *(points.nhbm.response(of) for of in ("x1", "x1 (1)", "max x1"))):  # fmt: skip
        assert np.isfinite(values).values.tolist() == [True, False, True]


def test_values_have_names_and_units():
    motion = duffing().solve(order=5)
    found = {
        "x1 (1)": (motion.nhbm.amplitude("x1"), motion.nhbm.harmonic("x1", 1), motion.nhbm.response("x1 (1)")),
        "x1": (motion.nhbm.time("x1", [0.0]), motion.nhbm.response("x1")),
        "max x1": (motion.nhbm.largest("x1"), motion.nhbm.response("max x1")),
    }
    for name, arrays in found.items():
        for values in arrays:
            assert values.name == name and values.attrs["units"] == "m" and values.attrs["long_name"]
    force = motion.nhbm.time("x1", [0.0], of="force_coefficients")
    assert force.attrs == {"long_name": "force of x1", "units": "N"}


def test_a_selection_is_not_saved_as_the_whole(tmp_path):
    sweep = results()["sweep"]
    with pytest.raises(ModelError, match="all points of its input"):
        sweep.isel(point=[0, 1]).nhbm.save(tmp_path / "part.h5")
    with pytest.raises(ModelError, match="computed from a result"):
        sweep.where(sweep["truncation_estimate"] > 0).nhbm.details  # noqa: B018


def test_units_are_those_of_the_degrees_of_freedom(tmp_path):
    beam = nhbm.Beam(length=1.0, bending_stiffness=1750.0, mass_per_length=7.8, n_elements=2, damping_diagonal=1.0)
    model = Model(beam, tones=[3.0])
    model.load(nhbm.Model(beam, tones=[3.0]).solve(order=1)["dof"].values[1], 1, cos=1.0)
    motion = model.solve(order=1)
    assert motion["coefficients"].attrs["units"] == "see dof_units"
    assert set(motion["coefficients"].attrs["dof_units"].split()) == {"m", "rad"}
    assert motion.nhbm.unit_of(str(motion["dof"].values[0])) == "rad"
    motion.nhbm.save(tmp_path / "beam.h5")
    xr.testing.assert_identical(nhbm.open_dataset(tmp_path / "beam.h5").load(), motion)


@pytest.mark.parametrize(
    "points", [pytest.param("curve", marks=pytest.mark.long), pytest.param("sweep", marks=pytest.mark.long), "file"]
)
def test_any_motion_is_verified(points, tmp_path):
    """Not the last one alone: a point of a curve, a sweep or a file, with the numbers of the last motion of `solve`."""
    model = duffing()
    if points == "sweep":
        data = model.sweep({"tones[0]": [0.7, 0.8]}, order=5)
    else:
        data = model.curve("tones[0]", 0.7, 0.8, order=5)
    if points == "file":
        data.nhbm.save(tmp_path / "curve.h5")
        data = nhbm.open_dataset(tmp_path / "curve.h5")
    verdict = model.verify(data.isel(point=0))
    assert verdict["integration_verdict"] == "agrees"
    wrong = data.isel(point=0).copy()
    wrong["coefficients"] = 1.5 * wrong["coefficients"]
    assert model.verify(wrong)["integration_verdict"] == "differs"
    with pytest.raises(ModelError, match="give one motion, such as"):
        model.verify(data)
    assert model["tones[0]"] == 0.9  # its values are those before


def test_a_motion_of_other_values_is_not_verified(tmp_path):
    """Its verdict would be on another motion."""
    model = duffing()
    motion = model.solve(order=5)
    curve = model.curve("tones[0]", 0.7, 0.8, order=5)
    curve.nhbm.save(tmp_path / "curve.h5")
    model["spring.stiffness"] = 0.6
    for old in (motion, curve.isel(point=1), nhbm.open_dataset(tmp_path / "curve.h5").isel(point=1)):
        with pytest.raises(ModelError, match=r"has changed .*: law.spring.%stiffness is 0.6, and was 0.5"):
            model.verify(old)
    model["spring.stiffness"] = 0.5
    model["tones[0]"] = 1.1  # of the curve it varies
    assert model.verify(curve.isel(point=1))["integration_verdict"] == "agrees"
    with pytest.raises(ModelError, match="tones%frequency is 1.1, and was 0.9"):
        model.verify(motion)
    model["tones[0]"] = 0.9
    model.law("cubic_spring", "x1", stiffness=0.1)
    with pytest.raises(ModelError, match="it has 2 groups &law, and had 1"):
        model.verify(motion)


def test_statuses_have_the_words_of_the_program():
    """Those with a motion are evaluated."""
    motion = duffing().solve(order=5)
    assert set(dataset.SOLVED) <= set(motion["status"].attrs["flag_meanings"].split())
    for status in dataset.SOLVED:
        found = motion.assign(status=motion["status"].copy(data=np.array(status)))
        assert np.isfinite(found.nhbm.response("x1")), status


def test_stability_that_is_unknown_is_neither():
    """`if not is_stable` took a motion of unknown stability for an unstable one."""
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.0, stiffness=1.0), tones=[0.9])
    model.load("x1", 1, cos=0.3)
    unknown = model.solve(order=3).nhbm.is_stable
    assert unknown.item() is None
    curve = duffing().curve(*RANGE, **COARSE)
    words, verdicts = curve["stability"].values, curve.nhbm.is_stable.values
    assert set(words) >= {"stable", "unstable"}
    assert [{"stable": True, "unstable": False, "unknown": None}[word] for word in words] == verdicts.tolist()
    with pytest.raises(TypeError):
        ~unknown  # noqa: B018


@pytest.mark.parametrize("part", ["dof", "component", "point", "law_dof"])
def test_files_without_an_axis_are_damaged(part, tmp_path):
    """h5netcdf meets what it does not expect."""
    path = tmp_path / "a.h5"
    duffing().solve(order=3).nhbm.save(path)
    with h5py.File(path, "a") as file:
        del file[part]
    with pytest.raises(ModelError, match="a.h5' is damaged"):
        nhbm.open_dataset(path)


@pytest.mark.parametrize("read", [nhbm.open_dataset, nhbm.Structure.read, nhbm.Model], ids=["result", "structure", "model"])
def test_pipes_are_refused(read, tmp_path):
    """HDF5 would wait for a writer, for ever."""
    os.mkfifo(tmp_path / "pipe.h5")
    with pytest.raises(ModelError, match="it is a pipe or a device"):
        model = read(tmp_path / "pipe.h5")
        model.solve()  # a model reads its structure when it is needed
