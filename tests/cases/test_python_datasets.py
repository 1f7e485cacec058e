"""Datasets that are asked for what they do not have, and files that are no results, answer with a message."""

from __future__ import annotations

import pickle
import resource
import subprocess
import sys

import h5py
import numpy as np
import pytest
import xarray as xr

from in_process import duffing, stopped

import nhbm
from nhbm import Model, ModelError, NotConverged, laws


def test_files_that_are_no_results_are_named(tmp_path):
    nhbm.Structure(np.eye(2), np.eye(2)).write(tmp_path / "model.h5")
    with pytest.raises(ModelError, match="cannot be read: it is a model file, which nhbm.Model takes"):
        nhbm.open_dataset(tmp_path / "model.h5")
    (tmp_path / "empty.h5").touch()
    with pytest.raises(ModelError, match="cannot be read: it is empty"):
        nhbm.open_dataset(tmp_path / "empty.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(ModelError, match="other.h5' is not a result of nhbm"):
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


def test_absent_harmonics_are_not_zero():
    model = duffing()
    motion = model.solve(order=3)
    odd = duffing().solve(tolerance=1e-8)
    assert 0 not in odd["tuple"].values % 2 or odd.sizes["harmonic"] > 2
    assert all(float(odd.nhbm.amplitude("x1", k)) == 0.0 for k in (0, 2, 4, 20)) and odd.nhbm.details["is_odd"] == 1
    with pytest.raises(ModelError, match="does not have the tuple 21"):
        odd.nhbm.amplitude("x1", 21)
    with pytest.raises(ModelError, match="does not have the tuple 9"):
        motion.nhbm.amplitude("x1", 9)
    with pytest.raises(ModelError, match="tuple_ must be a whole number"):
        motion.nhbm.amplitude("x1", 3.7)
    with pytest.raises(ModelError, match="'x1 .9.': the set of harmonics does not have this tuple"):
        model.response("x1 (9)", order=3)
    stop = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.05, stiffness=1.0), tones=[0.9])
    stop.load("x1", 1, cos=0.18)
    stop.law("elastic_stop", "x1", stiffness=5.0, gap=0.3, two_sided=True)
    with pytest.raises(ModelError, match="zero, as even ones of odd motions are; give an order to have its value"):
        stop.response("x1 (2)", tolerance=1e-4)
    with pytest.warns(NotConverged, match="does not have this tuple"):
        assert np.isnan(model.sweep({"tones[0]": [0.8, 0.9]}, of="x1 (9)", order=3)["response"]).all()


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
    for values in (point.nhbm.amplitude("x1"), point.nhbm.largest("x1"), point.nhbm.time("x1", 0.0), point.nhbm.response("x1")):
        assert np.isnan(values)
    for draw in (point.nhbm.plot, point.nhbm.orbit, point.nhbm.spectrum, point.nhbm.animate, lambda: duffing().verify(point)):
        with pytest.raises(ModelError, match="no motion was found .status pending."):
            draw()


@pytest.mark.parametrize("wrong, message", [
    (lambda data: data.nhbm.amplitude("x1", of="power_in"), "'power_in' has no harmonics"),
    (lambda data: data.nhbm.amplitude("x1", of="power"), "there is no column 'power'"),
    (lambda data: data.nhbm.time("x1", 0.0, of="forces"), "there is no column 'forces'; those of motions: coefficients, force_c"),
    (lambda data: data.nhbm.spectrum(over="freqency"), "over must be 'tuple' or 'frequency'"),
    (lambda data: data.nhbm.animate(frames=0), "frames must be 1 or more"),
    (lambda data: data.nhbm.report().save("page.png"), "the name must end in .html"),
    (lambda data: xr.Dataset({"integration_verdict": "agrees"}).nhbm.plot(), "a verdict of .verify., without a motion"),
    (lambda data: xr.Dataset({"a": ("x", [1.0, 2.0])}).nhbm.plot(), "this dataset is not a result of nhbm"),
    (lambda data: xr.Dataset({"a": ("x", [1.0, 2.0])}).nhbm.to_dataframe(), "this dataset is not a result of nhbm"),
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


@pytest.mark.parametrize("write", ["nhbm.save('a.h5')", "nhbm.to_mat('a.mat')"])
def test_a_full_disk_is_an_error(tmp_path, write):
    """HDF5 crashed at the end of the process after a write of its own had failed."""
    script = f"""
import nhbm
model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
model.load("x1", 1, cos=0.1)
curve = model.curve("tones[0]", 0.5, 1.5, order=3)
try:
    curve.{write}
except nhbm.ModelError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-B", "-c", script],  # which writes no compiled files, that would be cut
        capture_output=True, text=True, cwd=tmp_path, timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)),
    )  # fmt: skip
    assert done.returncode == 0 and "cannot be written: File too large" in done.stdout, (done.returncode, done.stdout, done.stderr)
    assert not list(tmp_path.iterdir())


def test_responses_have_the_axes_of_the_points():
    sweep = duffing().sweep({"load[0].cos": [0.1, 0.2], "spring.stiffness": [0.4, 0.5, 0.6]}, order=3)
    table = sweep.set_index(point=["load_1_cos", "law_spring_stiffness"]).unstack("point")
    for of in ("x1", "x1 (1)", "max x1"):
        on_table = table.nhbm.response(of).transpose("load_1_cos", "law_spring_stiffness")
        np.testing.assert_allclose(np.ravel(on_table), sweep.nhbm.response(of), rtol=1e-14)


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
    for code, status in ((-1, "failed"), (1, "not_finite")):
        with pytest.warns(NotConverged, match=f"{status}: law .*returned {code}"):
            curve = refusing(code).curve("tones[0]", 0.9, 1.0, order=3)
        assert curve["status"].values.tolist() == [status]


def test_datasets_of_one_layout_are_those_that_are_made_alone():
    """Motions of a model share what takes long; values, attributes and details are those of each."""
    model = duffing()
    first = model.solve(order=5)
    kept = first.copy(deep=True)
    model["load[0].cos"] = 0.25
    model["tones[0]"] = 1.1
    second = model.solve(order=5)
    alone = nhbm.Model.from_namelist(second.nhbm.input).solve()
    seconds = [name for name in alone.nhbm.details if str(name).endswith("_seconds")]
    for made, one in ((second, alone), (second.nhbm.details, alone.nhbm.details)):
        attrs = {**made.attrs, "created_utc": one.attrs.get("created_utc")} if "created_utc" in made.attrs else made.attrs
        xr.testing.assert_identical(made.drop_vars(seconds, errors="ignore").assign_attrs(attrs),
                                    one.drop_vars(seconds, errors="ignore"))  # fmt: skip
    second["coefficients"].attrs["units"] = "mm"
    second["coefficients"].values[:] = 0.0
    second["dof"].attrs["long_name"] = "mine"
    xr.testing.assert_identical(first, kept)
    assert model.solve(order=5)["dof"].attrs == first["dof"].attrs
    assert first.nhbm.input != second.nhbm.input and "cos = 0.25" in second.nhbm.input


def test_details_outlive_the_model(tmp_path):
    """They are made later, from what the motion was found with: also in another process, whatever has changed since."""
    model = duffing()
    motion = model.solve(order=5)
    model["load[0].cos"] = 7.0
    model.law("cubic_spring", "x1", stiffness=3.0)
    again = pickle.loads(pickle.dumps(motion))
    del model
    assert "cos = 7" not in motion.nhbm.input and motion.nhbm.input == again.nhbm.input
    xr.testing.assert_identical(motion.nhbm.details, again.nhbm.details)
    motion.nhbm.save(tmp_path / "motion.h5")
    assert nhbm.open_dataset(tmp_path / "motion.h5").nhbm.input == motion.nhbm.input
