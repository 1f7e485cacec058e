"""Parameters from measured responses: closed forms, sweeps with jumps (integrated in time), confidence intervals, mistakes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from in_process import ROOT

import nhbm
from nhbm import Model, ModelError

FORCE = 0.1


def linear(stiffness=1.0, damping=0.1, **tones):
    model = Model(nhbm.Matrices(1.0, stiffness, damping), tones=tones or [1.0])
    model.load("x1", 1, cos=FORCE)
    return model


LINEAR = ["structure.stiffness[0]", "structure.damping[0]"]
OMEGA = np.linspace(0.7, 1.4, 15)
Z = FORCE / (1.21 - OMEGA**2 + 0.2j * OMEGA)  # cos - i sin, as of x = Re(Z exp(i omega t))


def test_a_closed_form_is_found_from_amplitudes_and_phases():
    for data in ({"frequency": OMEGA, "amplitude": abs(Z)}, {"frequency": OMEGA, "amplitude": abs(Z), "phase": np.angle(Z)},
                 {"hertz": OMEGA / (2 * np.pi), "amplitude": abs(Z), "phase": np.angle(Z)}):  # fmt: skip
        model = linear()
        found = nhbm.fit(model, data, LINEAR, "x1 (1)", order=1)
        np.testing.assert_allclose(found.values, [1.21, 0.2], rtol=1e-7)
        assert model["structure.stiffness[0]"] == 1.0 and found.model["structure.stiffness[0]"] == pytest.approx(1.21)
        assert found.degrees_of_freedom == len(OMEGA) * (1 + ("phase" in data)) - 2
    in_hertz = nhbm.fit(linear(hertz=0.16), {"hertz": OMEGA / (2 * np.pi), "amplitude": abs(Z)}, LINEAR, "x1 (1)", order=1)
    np.testing.assert_allclose(in_hertz.values, [1.21, 0.2], rtol=1e-7)


def test_standard_errors_are_those_of_linear_regression():
    """At small noise: the covariance of the closed form's derivatives."""
    noise = 1e-3
    amplitude = abs(Z) * (1 + noise * np.random.default_rng(2).standard_normal(len(OMEGA)))
    found = nhbm.fit(linear(), {"frequency": OMEGA, "amplitude": amplitude}, LINEAR, "x1 (1)", order=1, noise=noise)
    k, d = found.values

    def size(k, d):
        return FORCE / abs(k - OMEGA**2 + 1j * d * OMEGA)

    h = 1e-6
    slopes = np.stack([(size(k + h, d) - size(k - h, d)) / (2 * h), (size(k, d + h) - size(k, d - h)) / (2 * h)], axis=1)
    covariance = np.linalg.inv((slopes / (noise * amplitude[:, None])).T @ (slopes / (noise * amplitude[:, None])))
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-4)
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    ends = found.interval(0.9)
    np.testing.assert_allclose(ends.mean(axis=1), found.values)
    np.testing.assert_allclose((ends[:, 1] - ends[:, 0]) / 2, 1.6448536 * found.errors, rtol=1e-6)


D, K3 = 0.08, 2.0


def swept(omegas, periods=80, steps=60):
    """Amplitudes and phases of the first harmonic of x'' + D x' + x + K3 x**3 = FORCE cos(omega t) at each of the frequencies in
    turn: the classical Runge-Kutta method."""
    x, v, found = 0.0, 0.0, []

    def slope(x, v, phase):
        return v, FORCE * math.cos(phase) - D * v - x - K3 * x**3

    for omega in omegas:
        h = 2 * math.pi / omega / steps
        for k in range(periods * steps):
            if k == (periods - 1) * steps:
                c = s = 0.0
            phase = 2 * math.pi * k / steps
            if k >= (periods - 1) * steps:
                c, s = c + x * math.cos(phase), s + x * math.sin(phase)
            a, b = slope(x, v, phase)
            a2, b2 = slope(x + h / 2 * a, v + h / 2 * b, phase + math.pi / steps)
            a3, b3 = slope(x + h / 2 * a2, v + h / 2 * b2, phase + math.pi / steps)
            a4, b4 = slope(x + h * a3, v + h * b3, phase + 2 * math.pi / steps)
            x, v = x + h / 6 * (a + 2 * a2 + 2 * a3 + a4), v + h / 6 * (b + 2 * b2 + 2 * b3 + b4)
        found.append((math.hypot(c, s) * 2 / steps, math.atan2(-s, c)))
    return np.array(found)


@pytest.fixture(scope="module")
def sweeps():
    """An upward and a downward sweep; between their jumps they have different motions."""
    omega = np.linspace(0.8, 1.6, 25)
    up, down = swept(omega), swept(omega[::-1])[::-1]
    assert (up[:, 0] / down[:, 0] > 2).sum() >= 2
    both = np.concatenate([up, down])
    return {"frequency": np.tile(omega, 2), "amplitude": both[:, 0], "phase": both[:, 1], "sweep": ["up"] * 25 + ["down"] * 25}


def hardening(k=1.0, d=D, k3=K3):
    model = linear(k, d)
    model.law("cubic_spring", "x1", stiffness=k3, label="spring")
    return model


HARDENING = [*LINEAR, "spring.stiffness"]


@pytest.mark.long
def test_sweeps_with_jumps_are_fitted_from_afar(sweeps, tmp_path):
    """The folds of the first guess are elsewhere; amplitudes are those of time integration."""
    for data in (sweeps, {name: column for name, column in sweeps.items() if name != "phase"}):
        found = nhbm.fit(hardening(0.9, 0.11, 1.2), data, HARDENING, "x1 (1)", order=3)
        np.testing.assert_allclose(found.values, [1.0, D, K3], rtol=1e-2)
    assert abs(found.residuals).max() < 1.0  # of a per cent
    assert found.plot().axes[0].get_ylabel() == "Amplitude of x1 (1) [m]"
    assert "spring" in repr(found) and "+-" in found._repr_html_() and list(found.to_dataframe())[:2] == ["value", "error"]
    wrong = nhbm.fit(linear(0.9, 0.13), sweeps, LINEAR, "x1 (1)", order=1)
    assert wrong.bic > found.bic + 100


def covered(sweeps, n, first):
    """Share of 90 % intervals of each parameter that contain the true value; noise of 2 %."""
    inside = np.zeros((n, 3), bool)
    for k in range(n):
        noise = 0.02 * np.random.default_rng(first + k).standard_normal((2, len(sweeps["amplitude"])))
        noisy = {"amplitude": sweeps["amplitude"] * (1 + noise[0]), "phase": sweeps["phase"] + noise[1]}
        found = nhbm.fit(hardening(), {**sweeps, **noisy}, HARDENING, "x1 (1)", order=3)
        ends = found.interval(0.9)
        inside[k] = (ends[:, 0] < [1.0, D, K3]) & (ends[:, 1] > [1.0, D, K3])
    return inside.mean(axis=0)


def test_intervals_contain_the_true_values(sweeps):
    assert (covered(sweeps, 4, first=1000) > 0).all()


@pytest.mark.long
def test_nine_of_ten_intervals_contain_the_true_values(sweeps):
    shares = covered(sweeps, 100, first=0)
    assert (shares >= 0.85).all() and (shares <= 0.95).all(), shares


def test_several_forces_and_files(tmp_path):
    rows = [f"{force},{w:.17g},{force / FORCE * abs(z):.17g}" for force in (0.1, 0.3) for w, z in zip(OMEGA, Z)]
    (tmp_path / "data.csv").write_text("load[0].cos, frequency [rad/s], amplitude [m]\n" + "\n".join(rows))
    found = nhbm.fit(linear(), tmp_path / "data.csv", LINEAR, "x1 (1)", order=1)
    np.testing.assert_allclose(found.values, [1.21, 0.2], rtol=1e-7)
    assert len(found.sets) == 2


DATA = {"frequency": OMEGA, "amplitude": abs(Z)}


@pytest.mark.parametrize("made, message", [
    (lambda: nhbm.fit(linear(), {"frequency": OMEGA}, LINEAR, "x1 (1)"), "need the columns 'amplitude' and 'frequency'"),
    (lambda: nhbm.fit(linear(), DATA, LINEAR, "x1"), "'x1' is no harmonic; a fit needs one, such as 'x1 .1.'"),
    (lambda: nhbm.fit(linear(), DATA, ["structure.stifness[0]"], "x1 (1)"), "stifness"),
    (lambda: nhbm.fit(linear(), {**DATA, "sweep": "left"}, LINEAR, "x1 (1)"), "'up' and 'down', not 'left'"),
    (lambda: nhbm.fit(linear(), {"frequency": [1.0], "amplitude": [1.0]}, LINEAR, "x1 (1)"), "1 measured numbers do not determ"),
    (lambda: nhbm.fit(linear(), DATA, LINEAR, "x1 (1)", bounds={"spring.gap": (0, 1)}), "is no parameter of the fit"),
    (lambda: nhbm.fit(linear(), DATA, LINEAR, "x1 (1)", bounds={LINEAR[0]: (1, 0)}), "the lower one first"),
    (lambda: nhbm.fit(linear(), DATA, LINEAR, "x7 (1)", order=1), "no degree of freedom 'x7'"),
    (lambda: nhbm.fit(linear(), {**DATA, "amplitude": -abs(Z)}, LINEAR, "x1 (1)"), "must have finite positive numbers"),
    (lambda: nhbm.fit(linear(), "none.csv", LINEAR, "x1 (1)"), "'none.csv' cannot be read"),
])  # fmt: skip
def test_mistakes_are_named(made, message):
    with pytest.raises(ModelError, match=message):
        made()
