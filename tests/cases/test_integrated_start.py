"""`&solver first_guess = 'integration'`: motions to which no linear mode leads, found from the end of a time integration."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from program import BAD_INPUT, NOT_ALL_CONVERGED, coefficients_by_tuple, read, run, solve

INPUTS = Path(__file__).resolve().parents[2] / "inputs"
FREE = (
    "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones unknown=.true. /\n"
    "&harmonics order=31, odd_only=.true. /\n"
)
FROM_INTEGRATION = "&solver first_guess='integration' /\n"


def without_a_start(name: str) -> str:
    """An input of inputs/autonomous without a start and without first guesses of frequencies."""
    text = (INPUTS / "autonomous" / f"{name}.nml").read_text()
    text = re.sub(r"^&start .*$", "", text, flags=re.MULTILINE)
    return re.sub(r"^&tones\n.*?^/", "&tones unknown = .true. /", text, flags=re.MULTILINE | re.DOTALL) + FROM_INTEGRATION


@pytest.mark.parametrize(
    ("name", "frequency", "disk", "casing"),
    [
        ("rotor_stator", 1.156673609, 6.158738248, 4.854332428),
        ("rotor_stator_friction", 1.3285288, 22.0252877, 20.0171897),
    ],
)
@pytest.mark.long
def test_blades_on_a_casing_from_nothing(tmp_path, name, frequency, disk, casing):
    """Rest is stable, and the search from modes ends in another cycle; references: inputs/autonomous."""
    result = solve(without_a_start(name), tmp_path)
    assert read(result, "frequency")[0, 0] == pytest.approx(frequency, rel=3e-8)
    assert np.hypot(*coefficients_by_tuple(result)[(1,)]) == pytest.approx(disk, rel=3e-8)
    assert np.hypot(*coefficients_by_tuple(result, dof=2)[(1,)]) == pytest.approx(casing, rel=3e-8)


def test_torus_is_found_from_its_integration(tmp_path):
    text = (INPUTS / "autonomous" / "coupled_van_der_pol.nml").read_text()
    result = solve(text + FROM_INTEGRATION, tmp_path)
    np.testing.assert_allclose(read(result, "frequency")[0], (1.031537529104, 1.473632651048), rtol=1e-11)


def test_tone_of_its_own_beside_a_force(tmp_path):
    text = (INPUTS / "autonomous" / "forced_van_der_pol.nml").read_text()
    result = solve(text[: text.index("&sweep")] + FROM_INTEGRATION, tmp_path)
    assert read(result, "frequency")[0, 1] == pytest.approx(0.98613304907993, rel=1e-10)


def test_integration_goes_to_the_stable_one_of_three_motions(tmp_path):
    """A Duffing oscillator at 1.2 rad/s has three motions; from the linear one Newton's method also finds one of them."""
    text = (
        "&structure type='matrices', n_dofs=1, mass=1, damping=0.05, stiffness=1 /\n&tones frequency=1.2 /\n&harmonics order=9 /\n"
        "&load dof='x1', tuple=1, cos=0.18 /\n&law type='cubic_spring', dof='x1', stiffness=0.1 /\n"
    )
    amplitudes = {}
    for start in ("", "&start dof='x1', tuple=1, sin=2.5 /\n"):
        result = solve(text + FROM_INTEGRATION + start, tmp_path)
        assert read(result, "fallback") == [0] and read(result, "iterations")[0] <= 3
        amplitudes[start] = np.hypot(*coefficients_by_tuple(result)[(1,)])
        assert run("verify", result, "--periods", 40, cwd=tmp_path).status == 0
    low, high = amplitudes.values()
    assert low < 0.6 and high > 2.0


@pytest.mark.long  # seconds
def test_what_dies_out_is_no_guess(tmp_path):
    """Damped everywhere: time integration gives no start, and the search from the mode ends as without it."""
    law = "&law type='van_der_pol', dof='x1', strength=0.1 /\n"
    result = solve(FREE.replace("mass=1", "mass=1, damping=0.2") + law + FROM_INTEGRATION, tmp_path, status=NOT_ALL_CONVERGED)
    assert read(result, "status") == [11]


def test_normal_mode_is_not_integrated(tmp_path):
    source = tmp_path / "bad.nml"
    source.write_text(
        FREE + "&normal_mode dof='x1', amplitude=1 /\n&law type='cubic_spring', dof='x1', stiffness=1 /\n" + FROM_INTEGRATION
    )
    done = run("solve", source, cwd=tmp_path)
    assert done.status == BAD_INPUT and "is not an attractor" in done.stderr, done.stderr


def test_coordinates_without_mass_are_followed(tmp_path):
    text = (
        "&structure type='matrices', n_dofs=1, mass=0, damping=1, stiffness=1 /\n&tones frequency=1 /\n&harmonics order=3 /\n"
        "&load dof='x1', tuple=1, cos=1 /\n&law type='cubic_spring', dof='x1', stiffness=1 /\n"
    )
    expected = read(solve(text, tmp_path, name="balance"), "coefficients")
    for method in ("", "&integration method='generalized_alpha' /"):
        assert np.allclose(read(solve(text + FROM_INTEGRATION + method, tmp_path), "coefficients"), expected, atol=1e-9)


@pytest.mark.parametrize("amplitude", [0.5, 0.4])
def test_a_start_beside_stick_slip_is_not_left_for_a_small_cycle(tmp_path, amplitude):
    """Three motions: a stable rest, an unstable cycle of period 6.2842 that a few harmonics have, and stick-slip of period
    7.19884 by time integration, beside which the search starts."""
    text = "&structure type='matrices', n_dofs=1, mass=1, damping=.02, stiffness=1 /\n&tones frequency=.87, unknown=.true. /\n"
    text += "&law type='stribeck', dof='x1', limit=.5, static_limit=.8, stribeck_velocity=.1, velocity=.002, belt_velocity=.3 /\n"
    text += f"&start dof='x1', tuple=1, cos={amplitude} /\n&start dof='x1', tuple=0, cos=.5 /\n"
    frequency, stable = read(solve(text, tmp_path), "frequency", "is_stable")
    assert 2.0 * np.pi / frequency[0, 0] == pytest.approx(7.19884, rel=1e-2) and stable[0] != -1
