"""Curves in Python: where they begin, the points and parts that they name, and the reasons why they end."""

from __future__ import annotations

import os
import subprocess
import warnings

import h5py
import numpy as np
import pytest

from in_process import DUFFING, duffing
from program import _ENVIRONMENT

import nhbm
from nhbm import Model


def test_curves_run_over_the_energy_of_a_mode():
    model = Model(nhbm.Chain(n_masses=2, ends="fixed", mass=1.0, coupling_stiffness=1.0), tones={"unknown": True},
                  normal_mode={"energy": 1.0})  # fmt: skip
    model.law("cubic_spring", "x1", stiffness=0.5)
    curve = model.curve("normal_mode%energy", 3000.0, 5000.0, tolerance=1e-6)
    assert curve["normal_mode_energy"].values[curve["curve_kind"] == "fold"] == pytest.approx([4680.546293], rel=1e-8)


def test_points_of_a_curve_are_named(tmp_path):
    curve = duffing().curve("tones[0]", 0.5, 2.5, order=3, max_step=0.2, peak_of="x1 (1)")
    assert curve["curve_kind"][0] == "start" and (curve["curve_kind"] == "peak").sum() == 1
    path = tmp_path / "curve.nml"
    path.write_text(
        DUFFING + "&harmonics order = 3 /\n"
        "&curve parameter = 'tones%frequency', from = 0.5, to = 2.5, max_step = 0.2, peak_of = 'x1 (1)' /\n"
    )
    subprocess.run([os.environ["NHBM"], "solve", path, "--quiet"], check=True, cwd=tmp_path, env=_ENVIRONMENT)
    with h5py.File(tmp_path / "curve.h5") as file:
        assert (file["status"][:] == file["status"].attrs["flag_meanings"].split().index("unused")).any()
    with nhbm.open_dataset(tmp_path / "curve.h5") as opened:
        assert opened["curve_kind"].values.tolist() == curve["curve_kind"].values.tolist()
        np.testing.assert_allclose(opened.nhbm.amplitude("x1"), curve.nhbm.amplitude("x1"), rtol=1e-12)


def reasons(curve):
    return curve.nhbm.details["reason"].values.tolist()


def test_curves_that_end_early_are_reported():
    model = duffing()
    with pytest.warns(nhbm.NotConverged, match="limit of 12 points"):
        curve = model.curve("tones[0]", 0.5, 2.5, order=3, points=12)
    assert curve.sizes["point"] == 12 and reasons(curve) == 11 * ["none"] + ["points"]
    with pytest.warns(nhbm.NotConverged, match="limit of 12 points"):
        assert np.isnan(model.peak("x1 (1)", "tones[0]", 0.5, 2.5, order=3, points=12)).all()
    with pytest.warns(nhbm.NotConverged, match="limit of 12 points"):
        found = model.peak_gradient("x1 (1)", ["spring.stiffness"], "tones[0]", 0.5, 2.5, order=3, points=12)
    assert np.isnan([found.value, found.at, *found.slopes, *found.at_slopes]).all()
    assert not np.isnan(model.peak("x1 (1)", "tones[0]", 0.5, 2.5, order=3, max_step=0.2)).any()
    assert not np.isnan(model.peak("x1 (1)", "tones[0]", 0.5, 2.5, order=1, max_step=0.005)).any(), "more points than a file has"
    whole = model.curve("tones[0]", 0.5, 2.5, order=3, max_step=0.2)
    assert set(reasons(whole)) == {"none"}


def test_a_curve_that_ends_where_the_motion_vanishes_is_complete():
    """A van der Pol oscillator, whose limit cycle vanishes where the damping equals the strength."""
    model = Model(nhbm.Chain(n_masses=1, mass=1.0, ends="fixed-free", coupling_stiffness=1.0, damping_mass=0.05),
                  tones={"unknown": [True]})  # fmt: skip
    model.law("van_der_pol", "x1", strength=0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("error", nhbm.NotConverged)
        curve = model.curve("structure%damping_mass", 0.05, 0.4, order=5)
    assert curve["status"][-1] == "collapsed"


GRAZE = 1.4106735979666  # where the motion without impacts reaches the wall, (1 - w**2)**2 + (0.1 w)**2 = 1


def grazing():
    model = Model(nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1),
                  tones=[1.411])  # fmt: skip
    model.load("x1", 1, cos=1.0)
    model.law("rigid_wall", "x1", gap=1.0, restitution=0.9)
    return model


def test_a_curve_that_turns_at_a_graze_is_reported():
    """Motions with a slow impact lead back from there."""
    with pytest.warns(nhbm.NotConverged, match="returned to 1.411 without reaching 1.408"):
        curve = grazing().curve("tones[0]", 1.411, 1.408, order=3, points=40)
    located = curve.isel(point=np.isin(curve["curve_kind"], ["grazing", "fold"]))
    assert located["curve_kind"].values.tolist() == ["grazing", "fold"]
    np.testing.assert_allclose(located["tones_frequency"], GRAZE, atol=1e-6)


def test_a_curve_that_ends_at_a_graze_is_reported():
    """The value lies between the graze and the motions with an impact."""
    with pytest.warns(nhbm.NotConverged, match="ended where a wall is grazed"):
        curve = grazing().curve("tones[0]", 1.4108, 1.408, order=3, points=40, values=[GRAZE + 1e-7])
    assert curve["curve_kind"][-1] == "grazing" and reasons(curve)[-1] == "grazing" and set(reasons(curve)[:-1]) == {"none"}
    assert float(curve["tones_frequency"][-1]) == pytest.approx(GRAZE, abs=1e-6)


def test_a_curve_begins_between_its_ends():
    """The key `start` of &curve, whose name the range has in Python."""
    keys = {"order": 5, "max_step": 0.2}
    whole = duffing().curve("tones[0]", 0.5, 2.5, **keys)
    curve = duffing().curve("tones[0]", 0.5, 2.5, **keys, first=0.7)
    begin = curve.isel(point=curve["curve_kind"].values == "start")
    assert begin["tones_frequency"].values.tolist() == [0.7]
    assert float(curve["curve_length"].min()) < 0 < float(curve["curve_length"].max())
    for data in (whole, curve):
        assert sorted(data["tones_frequency"].values[data["curve_kind"] == "end"].tolist())[-1] == 2.5
    np.testing.assert_allclose(curve["tones_frequency"].min(), 0.5)
    assert duffing().peak("x1", "tones[0]", 0.5, 2.5, **keys, first=0.7).at == pytest.approx(
        duffing().peak("x1", "tones[0]", 0.5, 2.5, **keys).at, rel=1e-8
    )


def test_curves_of_two_tones_name_the_birth_of_a_third_one():
    """Both exponents of a van der Pol oscillator are half the mean of its damping while they are those of a pair."""
    model = Model(nhbm.Matrices(mass=[[1.0]], damping=[[0.0]], stiffness=[[1.0]], labels=["x1"]), tones=[2.23, 3.87])
    model.load("x1", (1, 0), cos=8.0)
    model.load("x1", (0, 1), cos=9.0)
    model.law("van_der_pol", "x1", strength=0.1)
    curve = model.curve("load(1)%cos", 6.0, 3.0, order=5)
    (birth,) = np.flatnonzero(curve["curve_kind"] == "neimark_sacker")
    exponents = curve["exponent"].values[:, :2]
    assert exponents[birth] == pytest.approx([0.0, 0.0], abs=1e-8)
    assert np.all(exponents[:birth] < 0.0) and np.all(exponents[birth + 1 :] > 0.0)
    assert curve["n_unstable"].values[[birth - 1, birth + 1]].tolist() == [0, 2]
