"""A mass attracted by a plate: static pull-in, multipliers, and the message of a point whose motion reaches the plate."""

import numpy as np
import pytest

from in_process import nhbm
from program import run

C, GAP, K = 0.5, 0.8, 1.3


def mass(**keys):
    model = nhbm.Model(nhbm.Matrices(mass=[[1.0]], damping=[[0.05]], stiffness=[[K]], labels=["x"]), tones=[0.9])
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


def test_a_body_that_is_pulled_in_is_no_solution(tmp_path):
    text = mass(voltage=0.9, tuple=[1], voltage_cos=0.1).to_namelist()
    (tmp_path / "pulled.nml").write_text(text)
    done = run("solve", "pulled.nml", cwd=tmp_path)
    assert "law 'plate': the gap is closed at" in done.stdout


def test_a_voltage_that_changes_needs_its_tuple():
    with pytest.raises(nhbm.ModelError, match="give the tuple with which 'voltage_cos'"):
        mass(voltage=0.1, voltage_cos=0.1).solve()
