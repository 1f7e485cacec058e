"""Evaluation of a series against direct sums and against the laws of Fourier series."""

import numpy as np
import pytest
from conftest import random_coefficients
from synthetic import box

from nhbm_post import Series

OMEGA = np.sqrt([2.0, 3.0, 5.0])
# Sums of some hundred terms of order 1e-3 in double precision.
ROUND_OFF = 1e-16


def make(n_tones, order=3, seed=5):
    tuples = box(n_tones, order)
    cos, sin = random_coefficients(seed, 1, 1, tuples)[0, 0].T
    return Series(tuples, OMEGA[:n_tones], cos, sin)


def direct(series, tau):
    """Sum over harmonics, written out."""
    total = 0.0
    for j, cos, sin in zip(series.tuples, series.cos, series.sin):
        phase = sum(k * angle for k, angle in zip(j, tau))
        total += cos * np.cos(phase) + sin * np.sin(phase)
    return total


@pytest.mark.parametrize("n_tones", [1, 2, 3])
def test_evaluation_equals_direct_sum(n_tones):
    series = make(n_tones)
    t = np.array([[0.0, 0.3, 7.1], [-2.0, 11.0, 100.0]])
    expected = [[direct(series, series.omega * instant) for instant in row] for row in t]
    np.testing.assert_allclose(series.evaluate(t), expected, rtol=0, atol=1e3 * ROUND_OFF)
    assert series.evaluate(1.5).shape == ()


@pytest.mark.parametrize("n_tones", [1, 2, 3])
@pytest.mark.parametrize("size", [2, 5, 8, 13])
def test_grid_of_any_size_equals_direct_sum(n_tones, size):
    series = make(n_tones)
    shape = tuple(size + m for m in range(n_tones))
    grid = series.on_grid(shape)
    assert grid.shape == shape
    for index in np.random.default_rng(0).integers(0, size, (6, n_tones)):
        tau = 2.0 * np.pi * index / shape
        assert grid[tuple(index)] == pytest.approx(direct(series, tau), abs=10 * ROUND_OFF)


def test_long_evaluation_in_pieces(monkeypatch):
    series = make(2)
    t = np.linspace(0.0, 9.0, 57)
    whole = series.evaluate(t)
    monkeypatch.setattr("nhbm_post.series.CHUNK", 100)
    np.testing.assert_allclose(series.evaluate(t), whole, rtol=0, atol=ROUND_OFF)


def test_grid_shape_is_checked():
    with pytest.raises(ValueError, match="2 tones"):
        make(2).on_grid((4, 4, 4))


@pytest.mark.parametrize("n_tones", [1, 2, 3])
def test_rms_obeys_parseval(n_tones):
    series = make(n_tones)
    grid = series.on_grid(16)
    assert series.rms == pytest.approx(np.sqrt((grid**2).mean()), rel=1e-13)
    assert series.mean == pytest.approx(grid.mean(), rel=1e-11)


def test_peak_of_two_cosines_and_a_mean():
    series = Series(
        np.array([[0, 0], [1, 0], [0, 1]]), OMEGA[:2], np.array([-0.5, 3.0, 0.0]), np.array([0.0, 4.0, 2.0])
    )
    assert series.peak() == pytest.approx(7.5, rel=1e-14)


@pytest.mark.parametrize("n_tones", [1, 2, 3])
def test_peak_bounds_a_fine_grid_closely(n_tones):
    series = make(n_tones)
    fine = np.abs(series.on_grid({1: 4096, 2: 512, 3: 96}[n_tones])).max()
    assert fine <= series.peak() <= fine * 1.002


def test_mirrored_tuple_is_the_conjugate():
    series = make(2)
    cos, sin = series.harmonic((1, -2))
    assert series.harmonic((-1, 2)) == (cos, -sin)
    with pytest.raises(KeyError):
        series.harmonic((4, 0))
    with pytest.raises(KeyError):
        series.harmonic((1,))
