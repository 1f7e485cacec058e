"""What notebooks show and what leaves them: tables of models and results, the report within a page, pictures of a motion, tables a
row a point, CSV and files for MATLAB."""

from __future__ import annotations

import inspect
import re
import sys
import types

import numpy as np
import pandas
import pytest
import xarray as xr
from nhbm_post.page import page_data
from nhbm_post.reader import Results

from in_process import ROOT, duffing

import nhbm
from nhbm import ModelError

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")


@pytest.fixture(scope="module")
def curve():
    return duffing().curve("tones[0]", 0.5, 2.5, order=5, max_step=0.2, peak_of="x1 (1)")


def test_errors_by_refinement_are_shown(tmp_path):
    """Where the difference of two levels was the largest estimate, report and tables showed the smaller ones alone."""
    model = nhbm.Model(nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1000.0, damping_mass=1.0), tones={"hertz": [4.7, 8.1]})
    model.load("x1", (1, 0), cos=2.0)
    model.load("x2", (0, 1), cos=1.0)
    model.law("elastic_stop", "x2", stiffness=5e3, gap=2e-3)
    motion = model.solve(tolerance=1e-2)
    level = float(motion.nhbm.details["level_estimate"])
    assert level > float(motion["truncation_estimate"])
    assert f"{level:.1e} by refinement" in motion.nhbm._repr_html_()
    assert motion.nhbm.to_dataframe()["level_estimate"].item() == level
    motion.nhbm.report().save(tmp_path / "motion.html")
    shown = '"Estimated error by refinement",["' + f"{level:.2e}".replace("e-0", "e-")
    assert shown in (tmp_path / "motion.html").read_text(encoding="utf-8")
    exact = duffing().solve(tolerance=1e-2)
    assert "refinement" not in exact.nhbm._repr_html_() and "by refinement" not in str(exact.nhbm.report()._page)


def test_models_and_results_are_shown_as_tables(curve):
    model = duffing()
    shown = model._repr_html_()
    assert "structure chain" in shown and "law cubic_spring &#x27;spring&#x27;" in shown and "stiffness = 0.5" in shown
    text, page = repr(curve.nhbm), curve.nhbm._repr_html_()
    n = curve.sizes["point"]
    assert f"{n} converged" in text and "tones%frequency: 0.5 to 2.5 rad/s" in text and "1 peak" in text and "by truncation" in text
    assert "<table>" in page and f"{n} converged" in page
    assert "events: 2 folds, 1 peak" in text, text
    assert "events" not in repr(model.solve(order=5).nhbm) + repr(curve.isel(point=1).nhbm)
    assert "converged" in repr(model.solve(order=5).nhbm) and "response" in repr(model.sweep({"tones[0]": [0.5, 0.6]}, of="x1"))


def test_a_missing_verdict_on_stability_has_its_reason():
    """That of many degrees of freedom takes longer than a motion."""
    model = nhbm.Model(nhbm.Chain(n_masses=200, mass=1.0, coupling_stiffness=1.0, damping_mass=0.1), tones=[0.9])
    model.load("x1", 1, cos=0.1)
    model.law("cubic_spring", "x1", stiffness=0.1)
    motion = model.solve(order=3)
    assert str(motion["stability_reason"].values) == "too_costly"
    assert "stability: unknown; " in repr(motion.nhbm) and "'integration'" in repr(motion.nhbm)
    points = model.sweep({"tones[0]": [0.8, 0.9]}, order=3)
    assert "stability: 2 unknown; " in repr(points.nhbm) and "2 points" in repr(points.nhbm)
    assert points.nhbm.is_stable.values.tolist() == [None, None]
    assert "2 points" in points.nhbm.is_stable.attrs["comment"]
    model.set("stability", method="off")
    assert "stability: unknown\n" in repr(model.solve(order=3).nhbm)


def test_axes_have_powers_of_units():
    data = duffing().sweep({"spring.stiffness": [0.4, 0.5]}, order=3)
    data["law_spring_stiffness"].attrs["units"] = "N m2/V2"
    assert data.nhbm.plot("x1 (1)").get_xlabel().endswith("[N m²/V²]")


def test_a_picture_over_time_has_the_fast_tone_too():
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.001, 0.9])
    model.load("x1", (1, 0), cos=0.1)
    model.load("x1", (0, 1), sin=0.3)
    motion = model.solve(order=1)
    (line,) = motion.nhbm.plot("x1").lines
    assert np.abs(line.get_ydata()).max() == pytest.approx(float(motion.nhbm.largest("x1")), rel=0.05)
    crossings = np.count_nonzero(np.diff(np.sign(line.get_ydata())))
    assert crossings == pytest.approx(2 * 8 * 900, rel=0.05)


def test_one_motion_has_one_value(curve):
    one = curve.isel(point=3).nhbm
    assert repr(one).splitlines()[:2] == ["motion: converged", f"tones%frequency: {float(curve['tones_frequency'][3]):.6g} rad/s"]
    assert repr(curve.isel(point=[3]).nhbm).startswith("points: 1 converged\n")


def test_a_report_is_shown_within_a_page(curve, tmp_path):
    report = curve.nhbm.report()
    assert report._repr_html_().startswith("<iframe srcdoc=")
    report.save(tmp_path / "curve.html")
    page = (tmp_path / "curve.html").read_text()
    assert "</html>" in page and "cubic_spring" in page and repr(report).startswith("<nhbm report")
    with pytest.raises(ModelError, match="save the whole result"):
        curve.isel(point=[1, 2]).nhbm.report()


def test_a_report_has_the_state_of_contacts(tmp_path):
    """The shares of time, of a stop those with which the motion is beyond its gap."""
    model = duffing()
    model.law("elastic_stop", "x1", stiffness=5.0, gap=0.2, label="stop")
    model.law("jenkins", "x1", stiffness=0.3, limit=0.05, label="pad")
    found = model.sweep({"tones[0]": [0.7, 0.9, 1.1]}, order=9)
    found.nhbm.save(tmp_path / "found.h5")
    with Results(tmp_path / "found.h5") as results:
        rows = dict(page_data(results)[0]["points"]["rows"])
    times = np.linspace(0.0, 2 * np.pi / 0.9, 20_000, endpoint=False)
    share = 100 * float((found.nhbm.time("x1", times).isel(point=1) > 0.2).mean())
    is_open, is_closed = map(float, re.fullmatch(r"open (\S+) %, closed (\S+) %", rows["Contact stop"][1]).groups())
    assert is_closed == pytest.approx(share, abs=0.5) and is_open + is_closed == pytest.approx(100.0, abs=0.2)
    sticks, slips = map(float, re.fullmatch(r"sticking (\S+) %, slipping (\S+) %", rows["Contact pad"][1]).groups())
    assert 0 < sticks < slips and sticks + slips == pytest.approx(100.0, abs=0.2)


def test_rotations_are_not_drawn_in_place_of_displacements():
    """The slope at the tip of a beam is 15 times its displacement."""
    beam = nhbm.Beam(length=0.1, bending_stiffness=1.0, mass_per_length=1.0, n_elements=1, left_support="clamped",
                     right_support="free")  # fmt: skip
    model = nhbm.Model(beam, tones=[10.0])
    model.load("v2", 1, cos=1.0)
    motion = model.solve(order=1)
    assert motion.nhbm.largest("theta2") > 10 * motion.nhbm.largest("v2")
    assert motion.nhbm.plot().get_ylabel() == "Displacement v2 [m]"


def test_pictures_of_a_motion(curve, tmp_path):
    motion = curve.isel(point=3)
    for figure in (motion.nhbm.orbit(), motion.nhbm.spectrum("x1"), motion.nhbm.spectrum(over="frequency")):
        assert figure.axes
    moving = motion.nhbm.animate(frames=2)
    moving.save(tmp_path / "motion.gif")
    assert (tmp_path / "motion.gif").read_bytes().startswith(b"GIF") and "<img" in moving._repr_html_()
    with pytest.raises(ModelError, match="give one motion"):
        curve.nhbm.orbit()
    model = nhbm.Model(nhbm.Matrices(np.eye(2), np.eye(2), 0.1 * np.eye(2)), tones=[0.9, 1.3])
    model.load("x1", (1, 0), cos=0.3)
    model.load("x2", (0, 1), cos=0.3)
    motion = model.solve(order=3)
    assert motion.nhbm.orbit("x1", "x2").axes[0].get_xlabel().startswith("Displacement x1")


@pytest.mark.long
def test_pictures_show_with_and_without_a_semicolon(curve, monkeypatch):
    """Backends of notebooks show the figures of pyplot at the end of a cell; the value of a cell was shown alone, so that
    `orbit();` showed nothing."""
    from matplotlib import pyplot

    display, images = types.ModuleType("IPython.display"), []
    display.Image, display.display = bytes, images.append
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    motion = curve.isel(point=3)
    for figure in (motion.nhbm.orbit(), motion.nhbm.spectrum("x1")):
        assert pyplot.fignum_exists(figure.number)
        figure._ipython_display_()
        assert not pyplot.fignum_exists(figure.number), "a value that was shown is not shown again"
        figure._ipython_display_()
    assert len(images) == 4 and all(image.startswith(b"\x89PNG") for image in images)


@pytest.mark.parametrize("values", [
    {"tones[0]": [0.8, 1.0, 1.2], "spring.stiffness": [0.1, 0.2]},
    {"tones[0]": [0.8, 1.0, 1.2], "spring.stiffness": [0.1, 0.2, 0.3], "load[0].cos": [0.1, 0.2]},
    {"tones[0]": np.linspace(0.8, 1.2, 13), "spring.stiffness": [0.1, 0.2]},
])  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_the_legend_of_a_sweep_leaves_room_for_its_lines(values):
    axes = duffing().sweep(values, order=3).nhbm.plot("max x1")
    axes.figure.canvas.draw()
    assert axes.get_position().width > 0.6 and axes.get_position().height > 0.5
    legend, bar = axes.get_legend(), axes.figure.axes[1:]
    heading = legend.get_title().get_text() if legend and not bar else bar[0].get_ylabel()
    assert "rad/s" in heading and len(axes.lines) == np.prod([len(v) for v in [*values.values()][:-1]])
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.close(axes.figure)


def test_a_table_has_a_row_a_point(curve):
    table = curve.nhbm.to_dataframe("x1 (1)", "max x1")
    assert len(table) == curve.sizes["point"] and list(table)[:3] == ["tones_frequency", "x1 (1)", "max x1"]
    np.testing.assert_array_equal(table["x1 (1)"], curve.nhbm.amplitude("x1"))
    np.testing.assert_array_equal(table["max x1"], curve.nhbm.largest("x1"))
    assert set(table["stability"]) <= {"stable", "unstable", "unknown"} and (table["curve_kind"] == "peak").sum() == 1
    np.testing.assert_array_equal(curve.nhbm.to_dataframe()["x1"], curve.nhbm.response("x1"))
    assert len(duffing().solve(order=5).nhbm.to_dataframe("x1 (1)")) == 1
    numbers = duffing().sweep({"tones[0]": [0.5, 0.6]}, of="x1 (1)", order=5)
    np.testing.assert_array_equal(numbers.nhbm.to_dataframe()["response"], numbers["response"])


def test_results_of_netcdf_and_empty_selections(curve, tmp_path):
    curve.to_netcdf(tmp_path / "curve.nc", engine="h5netcdf")
    read = xr.open_dataset(tmp_path / "curve.nc", engine="h5netcdf")
    assert read.nhbm.events("x1 (1)").equals(curve.nhbm.events("x1 (1)"))
    assert read.nhbm.to_dataframe("max x1").columns.tolist() == curve.nhbm.to_dataframe("max x1").columns.tolist()
    assert repr(read.nhbm) == repr(curve.nhbm)
    none = curve.isel(point=[])
    assert none.nhbm.largest("x1").shape == (0,) and none.nhbm.to_dataframe("max x1", "x1", "x1 (1)").empty
    assert repr(none.nhbm) and none.nhbm.events().empty


def test_records_of_time_integration_are_shown():
    model = duffing()
    record = model.integrate(400.0, transient=400.0)
    motion = model.solve(order=7)
    assert float(record.nhbm.amplitude("x1", 1)) == pytest.approx(float(motion.nhbm.amplitude("x1", 1)), rel=1e-3)
    assert "record: 399.995 to 799.989 s, " in repr(record.nhbm) and "record" in record.nhbm._repr_html_()
    (line,) = record.nhbm.plot().lines
    np.testing.assert_array_equal(line.get_ydata(), record["displacement"].sel(dof="x1"))
    for refused in (lambda: record.nhbm.save("x.h5"), record.nhbm.report):
        with pytest.raises(ModelError, match="a record of time integration"):
            refused()


def test_tables_as_files(curve, tmp_path):
    curve.nhbm.to_csv(tmp_path / "curve.csv", "x1 (1)")
    table = pandas.read_csv(tmp_path / "curve.csv")
    assert list(table)[:3] == ["point", "tones_frequency [rad/s]", "x1 (1) [m]"]
    np.testing.assert_allclose(table["x1 (1) [m]"], curve.nhbm.amplitude("x1"), rtol=1e-14)
    from scipy.io import loadmat

    for data in (curve, duffing().solve(order=5)):
        data.nhbm.to_mat(tmp_path / "data.mat")
        found = loadmat(tmp_path / "data.mat", squeeze_me=True, struct_as_record=False)
        np.testing.assert_array_equal(found["coefficients"], np.squeeze(data["coefficients"]))
        assert found["units"].coefficients == "m" and found["axes"].coefficients.endswith("harmonic component")
        assert np.all(np.asarray(found["status"] == data["status"].values.astype(object)))


def test_signatures_show_the_keys():
    parameters = inspect.signature(nhbm.Chain).parameters
    assert parameters["n_masses"].default is inspect.Parameter.empty and parameters["ground_stiffness"].default is None
    assert parameters["ends"].annotation == 'Literal["fixed", "free", "fixed-free"]'
    from nhbm.signatures import STRUCTURES

    for name, keys in STRUCTURES.items():
        known = {key.name for key in nhbm.input_keys() if key.section in ("structure", f"structure {name}")} - {"type"}
        assert set(keys) == known


def test_static_checks_know_the_keys(tmp_path):
    pytest.importorskip("mypy")
    from mypy import api

    (tmp_path / "right.py").write_text(
        "import nhbm\nchain = nhbm.Chain(n_masses=1, mass=1.0, coupling_stiffness=[1.0, 2.0])\n"
        "model = nhbm.Model(chain, tones=[0.9])\n"
        "model.law('cubic_spring', 'x1', stiffness=1.0, label='a')\nmodel.law(lambda q: q, 'x1')\n"
    )
    (tmp_path / "wrong.py").write_text(
        "import nhbm\nchain = nhbm.Chain(n_mass=1, mass=1.0, coupling_stiffness=1.0)\nmodel = nhbm.Model(chain, tones=[0.9])\n"
        "model.law('cubic_sprng', 'x1', stiffness=1.0)\nmodel.law('cubic_spring', 'x1', stifness=1.0)\n"
    )
    options = ["--no-incremental", "--follow-imports=silent", "--ignore-missing-imports"]
    import os

    os.environ["MYPYPATH"] = str(ROOT / "drivers" / "python" / "src")
    assert api.run([*options, str(tmp_path / "right.py")])[2] == 0
    said = api.run([*options, str(tmp_path / "wrong.py")])[0]
    assert {line.split(":")[1] for line in said.splitlines() if "error" in line} >= {"2", "4", "5"}, said


def test_results_on_the_same_axes_have_their_own_colours():
    model = duffing()
    axes = model.curve("tones[0]", 0.7, 0.9, order=1).nhbm.plot("x1 (1)")
    model.curve("tones[0]", 0.7, 0.8, order=1).nhbm.plot("x1 (1)", ax=axes)
    model.sweep({"tones[0]": [0.7, 0.8]}, order=1).nhbm.plot("x1 (1)", ax=axes)
    colours = [line.get_color() for line in axes.lines if line.get_linestyle() != "None"]
    assert len(set(colours)) == 3


def test_entries_of_a_list_are_told_apart():
    model = duffing()
    model.law("polynomial", "x1", stiffness=[0.1, 0.2], label="soft")
    grid = model.sweep({"soft.stiffness[0]": [0.1, 0.2], "soft.stiffness[1]": [0.0, 0.1]}, order=1)
    axes = grid.nhbm.plot("x1 (1)")
    assert axes.get_xlabel().startswith("Stiffness of soft, entry 2") and "entry 1" in axes.get_legend().get_title().get_text()
