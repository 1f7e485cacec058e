"""Rotors against closed forms."""

import numpy as np
import pytest
import scipy.linalg

from nhbm import ModelError, rotors


def whirls(model):
    n = model.n_dofs
    g = model.gyroscopic.toarray() if model.gyroscopic is not None else np.zeros((n, n))
    zero, one = np.zeros((n, n)), np.eye(n)
    a = np.block([[zero, one], [-model.stiffness.toarray(), -g]])
    b = np.block([[one, zero], [zero, model.mass.toarray()]])
    return np.sort(np.abs(scipy.linalg.eigvals(a, b).imag))[::2]


def test_shaft_between_stiff_bearings():
    """Pinned beam: (k pi/L)**2 sqrt(EI/rho A), a little lower by its rotary inertia; each twice."""
    shaft = rotors.rotor(1.0, 0.02, 20, bearings=[(0.0, 1e13, 0.0), (1.0, 1e13, 0.0)])
    exact = np.pi**2 * np.sqrt(2.1e11 / 7850.0) * 0.02 / 4
    assert whirls(shaft)[0] == pytest.approx(exact, rel=2e-4) and whirls(shaft)[1] == pytest.approx(exact, rel=2e-4)
    assert whirls(shaft)[2] == pytest.approx(4 * exact, rel=1e-3)


def test_disk_that_turns_splits_the_whirls():
    """A heavy disk in the middle tilts alone: I w**2 -+ Omega I_p w - k = 0 with the tilting stiffness 12 EI/L of both halves."""
    speed, diametral, polar = 200.0, 5.0, 9.0
    shaft = rotors.rotor(
        1.0, 0.02, 20, [(0.5, 500.0, diametral, polar)], [(0.0, 1e13, 0.0), (1.0, 1e13, 0.0)], speed, density=1e-6
    )
    k = 12 * 2.1e11 * np.pi * 0.02**4 / 64 / 1.0
    root = np.sqrt((speed * polar / 2) ** 2 + diametral * k)
    wanted = np.array([root - speed * polar / 2, root + speed * polar / 2]) / diametral
    found = whirls(shaft)
    for w in wanted:
        assert np.abs(found / w - 1.0).min() < 1e-6


def test_what_is_no_rotor_is_refused():
    with pytest.raises(ModelError, match="at 2.0 is not on the shaft, 0 to 1.0"):
        rotors.rotor(1.0, 0.02, 4, bearings=[(2.0, 1e6, 0.0)])
    with pytest.raises(ModelError, match="diameter must be above 0, not 0.0"):
        rotors.rotor(1.0, 0.0, 4)
