"""`nhbm verify` for motions with unknown frequencies: every limit cycle and torus of the inputs is integrated."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from program import checksum_of_row, read, run, solve

INPUTS = Path(__file__).resolve().parents[2] / "inputs"
# A dynamic stiffness has no equations in time; `test_dynamic_stiffness` integrates the delay by itself.
AUTONOMOUS = sorted({path.stem for path in (INPUTS / "autonomous").glob("*.nml")} - {"delayed_feedback"})
NOT_DONE, AGREES, UNSTABLE, DIFFERS = 0, 1, 2, 3
COLLAPSED, NO_MOTION, LOCKED = 10, 11, 14

VAN_DER_POL = (
    "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones unknown=.true. /\n"
    "&harmonics order=31, odd_only=.true. /\n&law type='van_der_pol', dof='x1', strength=1 /\n"
)


def solved_and_verified(source: Path, folder: Path, *options) -> tuple[Path, str]:
    """Result of an input including the verdicts, and the output of the verb."""
    result = folder / f"{source.stem}.h5"
    done = run("solve", source, "-o", result, "--quiet", cwd=folder)
    assert done.status in (0, 4), done.stderr
    done = run("verify", result, *options, cwd=folder)
    assert done.status in (0, 4), done.stderr
    return result, done.stdout


LONG = (
    "duffing_backbone", "duffing_energy", "one_sided_spring", "rotor_stator_friction", "two_masses_energy", "van_der_pol_tied",
)  # fmt: skip


def assert_motions_stay(name: str, folder: Path, *options) -> None:
    result, text = solved_and_verified(INPUTS / "autonomous" / f"{name}.nml", folder, *options)
    status, kinds = read(result, "status", "integration_verdict")
    if options:
        status, kinds = (column[[int(point) for point in options[1].split(",")]] for column in (status, kinds))
    empty = np.isin(status, (COLLAPSED, NO_MOTION, LOCKED))
    assert (kinds[empty] == NOT_DONE).all() and ("skipped" in text) == empty.any()
    expected = UNSTABLE if name == "dry_whip" else AGREES  # friction drives the whirl outwards, damping inwards
    assert (kinds[~empty] == expected).all(), text


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in AUTONOMOUS])
def test_motions_with_tones_of_their_own_stay(tmp_path, name):
    assert_motions_stay(name, tmp_path)


@pytest.mark.parametrize("name", ["duffing_energy", "van_der_pol_tied"])
def test_two_of_many_motions_stay(tmp_path, name):
    assert_motions_stay(name, tmp_path, "--points", "2,6")


@pytest.mark.long
def test_large_cycles_of_the_rotor_stay_and_small_ones_grow(tmp_path):
    result, text = solved_and_verified(INPUTS / "rotor_stator" / "rotating.nml", tmp_path)
    kinds = read(result, "integration_verdict")
    assert kinds[0] == NOT_DONE and (kinds[1:14] == AGREES).all() and (kinds[14:] == UNSTABLE).all(), text


@pytest.mark.long
def test_small_cycle_of_the_rotor_grows_by_its_multiplier(tmp_path):
    """By 1.954 in a period, from shooting (test_rotor_stator.py); 12 periods end before the difference is large."""
    result, text = solved_and_verified(INPUTS / "rotor_stator" / "rotating.nml", tmp_path, "--points", 20, "--periods", 12)
    kinds, growth, frequency = read(result, "integration_verdict", "integration_growth", "frequency")
    assert kinds[20] == UNSTABLE, text
    assert np.exp(growth[20] * 2 * np.pi / frequency[20, 0]) == pytest.approx(1.954, rel=0.05)


@pytest.mark.long  # seconds
def test_blades_that_run_along_the_casing_are_integrated(tmp_path):
    """The law rotates with the phase of a known tone, and another tone is unknown."""
    result, text = solved_and_verified(INPUTS / "rotor_stator" / "stationary.nml", tmp_path)
    kinds, largest = read(result, "integration_verdict", "integration_difference")
    assert (kinds == AGREES).all() and (largest < 1e-5).all(), text


def test_frequency_that_is_wrong_by_a_hundred_thousandth_is_seen(tmp_path):
    """The motion remains on the cycle: only its phase drifts."""
    result = solve(VAN_DER_POL, tmp_path)
    with h5py.File(result, "r+") as file:
        file["frequency"][0, 0] *= 1.00001
        file["checksum"][0] = checksum_of_row(file, 0)
    done = run("verify", result, cwd=tmp_path)
    kinds, drift, frequency = read(result, "integration_verdict", "integration_drift", "frequency")
    assert done.status == 4 and kinds == [DIFFERS], done.stdout
    assert drift[0, 0] == pytest.approx(-1e-5 * frequency[0, 0], rel=0.1)


def test_phase_of_a_cycle_is_free(tmp_path):
    """The same cycle from another starting point agrees as well."""
    result = solve(VAN_DER_POL, tmp_path)
    with h5py.File(result, "r+") as file:
        angle = 0.7 * file["tuple"][:, 0]
        c, s = file["coefficients"][0, 0].T
        file["coefficients"][0, 0] = np.stack([c * np.cos(angle) + s * np.sin(angle), s * np.cos(angle) - c * np.sin(angle)]).T
        file["checksum"][0] = checksum_of_row(file, 0)
    done = run("verify", result, cwd=tmp_path)
    assert done.status == 0 and read(result, "integration_verdict") == [AGREES], done.stdout


def test_amplitude_that_is_wrong_is_seen_though_the_cycle_attracts(tmp_path):
    result = solve(VAN_DER_POL, tmp_path)
    with h5py.File(result, "r+") as file:
        file["coefficients"][0, 0] *= 1.001
        file["checksum"][0] = checksum_of_row(file, 0)
    done = run("verify", result, cwd=tmp_path)
    first, last = read(result, "integration_first_difference", "integration_drift")
    assert done.status == 4 and read(result, "integration_verdict") == [DIFFERS], done.stdout
    assert 1e-4 < first[0] < 1e-2 and np.isfinite(last).all()
