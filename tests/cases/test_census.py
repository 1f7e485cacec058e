"""`nhbm census` and `Model.census`: coexisting motions, how often each was found, and what may be missing."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pytest
import xarray as xr

from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, run

import nhbm
from nhbm import Model, ModelError

OSCILLATOR = """&structure type = 'matrices', n_dofs = 1, mass = 1, damping = 0.05, stiffness = 1 /
&tones frequency = 1.2 /
&harmonics order = 7 /
&load dof = 'x1', tuple = 1, cos = 0.18 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "duffing.nml").write_text(OSCILLATOR)
    return tmp_path


def test_the_file_that_exists_is_named(folder):
    (folder / "duffing.h5").write_text("a result")
    done = run("census", "duffing.nml", "--starts", "5", cwd=folder)
    assert done.status == BAD_INPUT and "result file 'duffing.h5': it exists; give --overwrite" in done.stderr


def test_table_and_file_have_the_same_motions(folder):
    done = run("census", "duffing.nml", "--starts", "60", cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    rows = re.findall(r"^ +(\d+) +(\S+) +(\S+) +(yes|no) +converged +(\d+) +\w+", done.stdout, re.M)
    assert [row[3] for row in rows] == ["yes", "no", "yes"]
    with h5py.File(folder / "duffing.h5") as file:
        amplitudes = np.hypot(*file["coefficients"][:, 0, 1].T)
        found = file["census_found"][()]
        least_share = float(file.attrs["census_least_share"])
        assert file.attrs["census_missed"] == 0.0 and file.attrs["census_starts"] == 60
        assert list(file["census_start"].asstr()[()])[0]
    assert [float(row[2]) for row in rows] == pytest.approx(amplitudes, rel=0.05)
    assert [int(row[4]) for row in rows] == list(found)
    assert "at most" in done.stdout and "3 motions from" in done.stdout
    assert "missed motions: at least 0.0" in done.stdout
    assert least_share == pytest.approx(1 - 0.05 ** (1 / sum(found)))
    said = re.search(r"fewer than (\S+) % of the converged starts lead may be missed", done.stdout)
    assert float(said[1]) == pytest.approx(100 * least_share, abs=0.06)
    assert run("verify", "duffing.h5", cwd=folder).stdout.count("unstable") >= 1
    assert run("info", "duffing.h5", cwd=folder).status == ALL_CONVERGED


def test_python_finds_the_motions_of_the_command(folder):
    assert run("census", "duffing.nml", "--seed", "3", "--quiet", cwd=folder).status == ALL_CONVERGED
    found = Model.from_namelist(OSCILLATOR).census(seed=3)
    with h5py.File(folder / "duffing.h5") as file:
        assert np.allclose(found["coefficients"].values, file["coefficients"][()], rtol=0.0, atol=1e-10)
        assert list(found["census_found"].values) == list(file["census_found"][()])
    assert list(found["stability"].values) == ["stable", "unstable", "stable"]
    assert found.attrs["census_missed"] == 0.0 and 0.0 < found.attrs["census_unseen_bound"] < 0.05
    assert 0.05 == pytest.approx((1 - found.attrs["census_least_share"]) ** int(found["census_found"].sum()))


def test_a_census_of_a_swept_point_and_of_a_curve(folder):
    swept = OSCILLATOR + "&sweep parameter = 'tones%frequency', values = 0.5, 1.2 /\n"
    (folder / "swept.nml").write_text(swept)
    done = run("census", "swept.nml", cwd=folder)
    assert done.status == BAD_INPUT and "--point" in done.stderr
    assert "3 motions" in run("census", "swept.nml", "--point", "1", cwd=folder).stdout
    assert "1 motion from" in run("census", "swept.nml", "--point", "0", "--overwrite", cwd=folder).stdout
    curve = OSCILLATOR + "&curve parameter = 'tones%frequency', from = 1.2, to = 0.5 /\n"
    (folder / "curve.nml").write_text(curve)
    assert "3 motions" in run("census", "curve.nml", cwd=folder).stdout


def test_what_a_census_refuses(folder):
    free = OSCILLATOR.replace("frequency = 1.2", "unknown = .true.").replace("&load dof = 'x1', tuple = 1, cos = 0.18 /\n", "")
    (folder / "free.nml").write_text(free)
    done = run("census", "free.nml", cwd=folder)
    assert done.status == BAD_INPUT and "given tones" in done.stderr
    assert run("census", "duffing.nml", "--starts", "-1", cwd=folder).status == BAD_INPUT
    with pytest.raises(ModelError, match="starts must be"):
        Model.from_namelist(OSCILLATOR).census(starts=-1)


def test_time_ends_a_census(folder):
    done = run("census", "duffing.nml", "--time-limit", "0", cwd=folder)
    assert done.status == INCOMPLETE and "200 random starts not made, branches of 3 motions not followed" in done.stderr
    assert "from 1 directed start and 0 random starts" in done.stdout


@pytest.mark.long
def test_the_time_limit_holds_for_the_first_motion(tmp_path):
    """Its motion, tangents and estimates take several times as long as the limit."""
    text = (
        "&structure type='chain', n_masses=900, mass=1.0, coupling_stiffness=100.0, damping_stiffness=0.002 /\n"
        "&tones frequency=3.0, 4.1 /\n&accuracy tolerance=1e-4 /\n"
        "&load dof='x10', tuple=1, 0, cos=30.0 /\n&load dof='x250', tuple=0, 1, cos=30.0 /\n"
        "&law type='elastic_stop', dof='x20', stiffness=500.0, gap=0.01 /\n"
        "&law type='jenkins', dof='x220', stiffness=50.0, limit=1.0 /\n&law type='rigid_wall', dof='x100', gap=0.02 /\n"
    )
    (tmp_path / "chain.nml").write_text(text)
    done = run("census", "chain.nml", "--time-limit", "0.5", cwd=tmp_path)
    assert done.status == INCOMPLETE and "stopped by the time limit before a motion was found" in done.stderr, done.stderr
    with pytest.raises(ModelError, match="the time limit ended the census before a motion was found"):
        Model.from_namelist(text).census(time_limit=0.5)


def test_a_census_is_not_resumed(folder):
    """It is complete: its rows are not the points of its input."""
    assert run("census", "duffing.nml", "--starts", "5", cwd=folder).status == ALL_CONVERGED
    done = run("resume", "duffing.h5", cwd=folder)
    assert done.status == BAD_INPUT and "'duffing.h5' is the result of a census, which is complete" in done.stderr, done.stderr


def test_a_census_of_python_is_that_of_the_command(folder):
    """Names, types, units and descriptions of what varies and of the estimates, also after it was saved."""
    assert run("census", "duffing.nml", "--starts", "20", cwd=folder).status == ALL_CONVERGED
    found = Model.from_namelist(OSCILLATOR).census(starts=20)
    found.nhbm.save(folder / "python.h5")
    of_command, saved = (nhbm.open_dataset(folder / name) for name in ("duffing.h5", "python.h5"))
    for data in (saved, of_command):
        assert data.attrs["varies"] == found.attrs["varies"] and set(data.variables) == set(found.variables)
        for name in found.attrs["varies"]:
            xr.testing.assert_identical(data[name].variable, found[name].variable)
        for name in (name for name in found.attrs if name.startswith("census_")):
            assert data.attrs[name] == found.attrs[name] and isinstance(data.attrs[name], type(found.attrs[name])), name
    assert found["census_mirror_of"].values.tolist() == [-1, -1, -1]
    assert run("info", "python.h5", "--check", cwd=folder).status == ALL_CONVERGED


def impact_each_period(omega, damping, restitution):
    """Mean value of the motion that strikes a wall at x = 0 once a period, of a unit mass and spring under cos(omega t)."""
    decay, omega_d = damping / 2, np.sqrt(1 - damping**2 / 4)
    stiffness = 1 - omega**2 + 1j * damping * omega
    period = 2 * np.pi / omega
    times = np.linspace(0, period, 20001)
    free = np.exp((-decay + 1j * omega_d) * times)
    forced = np.exp(1j * omega * times)
    shapes = np.array([free.real, free.imag, forced.real, forced.imag])
    slopes = np.array([
        ((-decay + 1j * omega_d) * free).real,
        ((-decay + 1j * omega_d) * free).imag,
        (1j * omega * forced).real,
        (1j * omega * forced).imag,
    ])
    conditions = np.array([shapes[:, 0], shapes[:, -1], slopes[:, 0] + restitution * slopes[:, -1]])
    solution = np.linalg.svd(conditions)[2][-1]  # up to a factor, by the amplitude of the forced motion
    solution *= 1 / abs(stiffness) / np.hypot(solution[2], solution[3])
    (motion,) = [m for m in (solution @ shapes, -solution @ shapes) if m.max() < 1e-9]
    return np.mean(motion[1:])


def test_restitution_decides_on_the_motions(tmp_path):
    wall = """&structure type='matrices', n_dofs=1, mass=1.0, damping=0.1, stiffness=1.0 /
&tones frequency=2.6 /
&load dof='x1', tuple=1, cos=1.0 /
&law type='rigid_wall', dof='x1', gap=0.0, restitution=0.8 /
"""
    (tmp_path / "wall.nml").write_text(wall)
    done = run("census", "wall.nml", "--starts", "40", cwd=tmp_path)
    statuses = re.findall(r"^ +\d+ +\S+ +\S+ +\S+ +(\w+) +\d+ +\w+", done.stdout, re.M)
    with h5py.File(tmp_path / "wall.h5") as file:
        means, periods = file["coefficients"][:, 0, 0, 0], file["n_periods"][()]
    assert sorted(statuses) == ["integrated", "subharmonic"], done.stdout
    assert np.nanmin(abs(means - impact_each_period(2.6, 0.1, 0.8))) < 0.01
    assert 3 in periods
