"""A mass attracted by a plate: static pull-in, multipliers, several voltages, points whose motion reaches the plate."""

import h5py
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from in_process import nhbm
from program import run

C, GAP, K = 0.5, 0.8, 1.3


def mass(tones=(0.9,), **keys):
    model = nhbm.Model(nhbm.Matrices(mass=[[1.0]], damping=[[0.05]], stiffness=[[K]], labels=["x"]), tones=list(tones))
    model.law("electrostatic", "x", label="plate", coefficient=C, gap=GAP, **keys)
    return model


def test_pull_in_at_a_third_of_the_gap():
    model = mass(voltage=0.1)
    model.set("harmonics", order=1)
    curve = model.curve("law(plate)%voltage", 0.1, 0.8, max_step=0.2)
    (fold,) = np.flatnonzero(curve.curve_kind == "fold")
    assert curve.law_plate_voltage[fold].item() == pytest.approx(np.sqrt(4 * K * GAP**3 / (27 * C)), rel=1e-9)
    assert curve.coefficients[fold].values.ravel()[0] == pytest.approx(GAP / 3, rel=1e-6)
    assert (curve.stability[1:fold] == "stable").all() and (curve.stability[fold + 1 :] == "unstable").all()


def test_small_motions_have_the_frequency_of_the_softened_spring():
    model = mass(voltage=0.4)
    model.set("harmonics", order=1)
    motion = model.solve()
    x = motion.coefficients.values.ravel()[0]
    softened = K - 2 * C * 0.4**2 / (GAP - x) ** 3
    multiplier = (motion.multiplier_real + 1j * motion.multiplier_imag).values.ravel()[0]
    expected = np.exp((-0.025 + 1j * np.sqrt(softened - 0.025**2)) * 2 * np.pi / 0.9)
    assert multiplier.real == pytest.approx(expected.real, rel=1e-9)
    assert abs(multiplier.imag) == pytest.approx(abs(expected.imag), rel=1e-9)


def test_pull_in_is_named(tmp_path):
    """Above the static pull-in there is no motion at all."""
    text = mass(voltage=0.9, tuple=[1], voltage_cos=0.1).to_namelist()
    (tmp_path / "pulled.nml").write_text(text)
    done = run("solve", "pulled.nml", cwd=tmp_path)
    assert "law 'plate': pull-in" in done.stdout
    with h5py.File(tmp_path / "pulled.h5") as file:
        meanings = file["status"].attrs["flag_meanings"].split()
        assert [meanings[k] for k in file["status"][:]] == ["law_undefined"]
        assert b"".join(np.ravel(file["message"][0])).startswith(b"law 'plate': pull-in")


def test_a_motion_that_does_not_persist_is_pull_in():
    """Of two tones the balance has a motion beyond pull-in, with errors as large as itself; integrated, it reaches the plate."""
    voltages = 0.1875, 0.6
    static = np.sqrt(4 * K * GAP**3 / (27 * C))
    natural = np.sqrt(K)
    tones = 0.93 * natural, 0.985 * natural
    model = nhbm.Model(nhbm.Matrices(mass=[[1.0]], damping=[[natural / 80]], stiffness=[[K]], labels=["x"]), tones=list(tones))
    model.law("electrostatic", "x", label="plate", coefficient=C, gap=GAP, voltage=0.35 * static, tuple=[1, 0, 0, 1],
              voltage_cos=[v * static for v in voltages])  # fmt: skip
    with pytest.warns(nhbm.NotConverged):
        motion = model.solve(tolerance=1e-2)
    assert motion.status == "law_undefined"
    assert "coefficients" not in motion or motion.coefficients.isnull().all()

    def rates(t, y):
        volts = static * (0.35 + sum(v * np.cos(w * t) for v, w in zip(voltages, tones)))
        return [y[1], -natural / 80 * y[1] - K * y[0] + C * volts**2 / (GAP - y[0]) ** 2]

    def reaches_the_plate(t, y):
        return y[0] - 0.98 * GAP

    reaches_the_plate.terminal = True
    assert solve_ivp(rates, (0.0, 2000.0), [0.0, 0.0], rtol=1e-8, events=reaches_the_plate).status == 1


def test_two_voltages_against_shooting():
    """Tuples 1 and 2 of one tone: integrated over one period, the motion returns to its start."""
    cosines, sines = [0.08, -0.05], [0.02, 0.06]
    model = mass(voltage=0.3, tuple=[1, 2], voltage_cos=cosines, voltage_sin=sines)
    motion = model.solve(order=20)

    def rates(t, y):
        voltage = 0.3 + sum(c * np.cos(j * 0.9 * t) + s * np.sin(j * 0.9 * t) for j, c, s in zip((1, 2), cosines, sines))
        return [y[1], -0.05 * y[1] - K * y[0] + C * voltage**2 / (GAP - y[0]) ** 2]

    end = 2 * np.pi / 0.9
    x, v = (np.ravel(series)[:1] for series in start_of(motion))
    done = solve_ivp(rates, (0, end), [x[0], v[0]], method="DOP853", rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(done.y[:, -1], [x[0], v[0]], atol=1e-8)


def start_of(motion):
    """Displacement and velocity at t = 0."""
    cosine, sine = motion.coefficients.values[0].T
    j = np.ravel(motion["tuple"].values)
    return np.nansum(cosine), np.nansum(0.9 * j * sine)


def test_voltages_of_two_tones_add():
    """Voltages of the same tuple are their sum, in any order; a number of each can be swept."""
    one = mass(tones=[0.7, 0.9], voltage=0.2, tuple=[1, 0, 0, 1], voltage_cos=[0.05, 0.08], voltage_sin=[0.0, 0.01])
    parts = mass(
        tones=[0.7, 0.9], voltage=0.2, tuple=[0, 1, 1, 0, 0, 1], voltage_cos=[0.06, 0.05, 0.02], voltage_sin=[0.03, 0.0, -0.02]
    )
    motions = [model.solve(order=3).coefficients.values for model in (one, parts)]
    np.testing.assert_allclose(*motions, rtol=0, atol=1e-9)
    swept = one.sweep({"plate.voltage_cos[1]": [0.0, 0.08]}, order=3)
    np.testing.assert_allclose(swept.coefficients.values[1], motions[0], rtol=0, atol=1e-8)
    assert one["plate.voltage_cos[1]"] == 0.08


def test_a_voltage_that_changes_needs_its_tuple():
    with pytest.raises(nhbm.ModelError, match="give the tuple with which 'voltage_cos'"):
        mass(voltage=0.1, voltage_cos=0.1).solve()


def test_each_voltage_has_its_tuple():
    with pytest.raises(nhbm.ModelError, match="3 entries for 2 voltages"):
        mass(tuple=[1, 0, 0], voltage_cos=[0.1, 0.1]).solve()
    with pytest.raises(nhbm.ModelError, match="as many values"):
        mass(tuple=[1, 2], voltage_cos=[0.1, 0.1], voltage_sin=[0.1]).solve()
    with pytest.raises(nhbm.ModelError, match="a constant voltage"):
        mass(tuple=[1, 0], voltage_cos=[0.1, 0.1]).solve()
