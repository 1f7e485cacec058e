"""Masses that strike rigid walls with a given restitution, against orbits composed of free flights."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from program import read, run
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

W, D, E = 2.6, 0.1, 0.8  # tone, damping, restitution of a unit mass on a unit spring under a unit load
MODEL = """&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0,
           damping_mass=0.1 /
&tones frequency={tone} /
&load dof='x1', tuple={tuple}, cos=1.0 /
&law type='rigid_wall', dof='x1', gap=0.0{law} /
"""
TIME_DOMAIN, IMPACT = 18, 16


def flight(t0, x0, v0, t):
    """Displacement and velocity at t of the mass in free flight since t0."""
    z, steady = D / 2, 1 / (1 - W**2 + 1j * W * D)
    wd = np.sqrt(1 - z**2)

    def forced(s):
        return (steady * np.exp(1j * W * s)).real, (1j * W * steady * np.exp(1j * W * s)).real

    a = x0 - forced(t0)[0]
    b = (v0 - forced(t0)[1] + z * a) / wd
    c, s, decay = np.cos(wd * (t - t0)), np.sin(wd * (t - t0)), np.exp(-z * (t - t0))
    x, v = forced(t)
    return x + decay * (a * c + b * s), v + decay * (-z * (a * c + b * s) + wd * (b * c - a * s))


def orbit():
    """Time after and velocity before the single impact in each period."""
    turn = 2 * np.pi / W

    def misses(unknowns):
        x, v = flight(unknowns[0], 0.0, -E * unknowns[1], unknowns[0] + turn)
        return [x, v - unknowns[1]]

    for guess in np.linspace(0, turn, 12, endpoint=False):
        (t0, v), _, found, _ = fsolve(misses, [guess, 1.0], full_output=True, xtol=1e-14)
        if found == 1 and v > 0 and flight(t0, 0.0, -E * v, t0 + np.linspace(0, turn, 999))[0].max() < 1e-9:
            return t0, v, turn
    raise AssertionError("no orbit")


def solve(directory, law="", more="", tone=W, of=1, status=0):
    path = directory / "model.nml"
    path.write_text(MODEL.format(tone=tone, tuple=of, law=law) + more)
    assert run("solve", path, "--overwrite", "--quiet", cwd=directory).status == status
    return path.with_suffix(".h5")


@pytest.mark.parametrize(
    ("more", "within"), [("&harmonics order=12 /\n", 1e-4), ("&accuracy tolerance=1e-3 /\n", 1e-3), ("", 1e-2)]
)
def test_one_impact_a_turn(more, within, tmp_path):
    """The retained harmonics are those of the orbit; with one impact per period the multipliers have det = e^2 exp(-d T)."""
    t0, v, turn = orbit()
    nodes, weights = leggauss(400)
    t = t0 + turn * (nodes + 1) / 2
    x = flight(t0, 0.0, -E * v, t)[0]
    result = solve(tmp_path, f", restitution={E}", more)
    status, found, stable = (a[0] for a in read(result, "status", "coefficients", "is_stable"))
    assert (status, stable) == (TIME_DOMAIN, 1)
    orders = read(result, "tuples")[0] if "tolerance" in more or not more else read(result, "tuple")
    orders = np.unique(orders.clip(0))  # a point with a tolerance has unused elements
    found = found[:, : orders.size]
    lines = np.array([(2 if k else 1) * (weights * x) @ np.exp(1j * k * W * t) / 2 for k in orders])
    assert np.abs(found[0, :, 0] + 1j * found[0, :, 1] - lines).max() < within * np.abs(lines).max()
    real, imaginary = (a[0] for a in read(result, "multiplier_real", "multiplier_imag"))
    product = np.prod((real + 1j * imaginary)[:2])
    assert product == pytest.approx(E**2 * np.exp(-D * turn), rel=1e-6)


def test_restitution_of_integration_is_that_of_walls_without_one(tmp_path):
    sets = "&harmonics order=12 /\n"
    own = read(solve(tmp_path, f", restitution={E}", sets), "coefficients")
    common = read(solve(tmp_path, "", sets + f"&integration restitution={E} /\n"), "coefficients")
    both = read(solve(tmp_path, f", restitution={E}", sets + "&integration restitution=0.1 /\n"), "coefficients")
    assert np.array_equal(own, common)
    assert np.array_equal(own, both)
    assert read(solve(tmp_path, "", sets, status=1), "status")[0] == IMPACT


def closed_orbit(w):
    """Time after and velocity before the one impact in each turn, and the matrix of a turn from before an impact to before the
    next, in closed form: free flights from wall to wall, forced by the load, as of Shaw and Holmes."""
    flow = expm(np.array([[0.0, 1.0], [-1.0, -D]]) * 2 * np.pi / w)
    steady = 1 / (1 - w**2 + 1j * w * D)
    along = np.linalg.solve(np.eye(2) - flow, flow @ [0.0, E] + [0.0, 1.0])  # forced state at the impact over the velocity
    v = abs(steady) / np.hypot(along[0], along[1] / w)
    t0 = (np.arctan2(-along[1] / w, along[0]) - np.angle(steady)) / w % (2 * np.pi / w)
    before, after = np.cos(w * t0) - D * v, np.cos(w * t0) + D * E * v  # accelerations
    return t0, v, flow @ np.array([[-E, 0.0], [(after + E * before) / v, -E]])


@pytest.mark.parametrize("w", [pytest.param(2.0, marks=pytest.mark.long), 2.6])
def test_orbits_have_their_closed_form(w, tmp_path, monkeypatch):
    monkeypatch.setattr("test_impacts.W", w)
    t0, v, turn = closed_orbit(w)
    assert flight(t0, 0.0, -E * v, t0 + 2 * np.pi / w) == pytest.approx((0.0, v), abs=1e-12)
    nodes, weights = leggauss(400)
    t = t0 + (nodes + 1) * np.pi / w
    x = flight(t0, 0.0, -E * v, t)[0]
    more = "&harmonics order=12 /\n&integration steps_per_period=20000 /\n"
    found, real, imaginary = (
        a[0] for a in read(solve(tmp_path, f", restitution={E}", more, w), "coefficients", "multiplier_real", "multiplier_imag")
    )
    lines = np.array([(2 if k else 1) * (weights * x) @ np.exp(1j * k * w * t) / 2 for k in range(13)])
    assert np.abs(found[0, :, 0] + 1j * found[0, :, 1] - lines).max() < 1e-8 * np.abs(lines).max()
    np.testing.assert_allclose(np.sort_complex((real + 1j * imaginary)[:2]), np.sort_complex(np.linalg.eigvals(turn)), atol=1e-8)


def next_impact(impact, guess):
    """Time of the next impact and the velocity before it, near that time."""
    for _ in range(20):
        x, u = flight(impact[0], 0.0, -E * impact[1], guess)
        guess -= x / u
    return np.array([guess, flight(impact[0], 0.0, -E * impact[1], guess)[1]])


def multipliers(turn, impacts):
    """Of an orbit of free flights between impacts: products of the derivatives of the maps between them, by differences."""
    product, ways = np.eye(2), 1e-5 * np.eye(2)
    for impact, (until, _) in zip(impacts, [*impacts[1:], impacts[0] + np.array([turn, 0.0])]):
        sides = [(next_impact(impact + way, until), next_impact(impact - way, until)) for way in ways]
        product = np.column_stack([(above - below) / 2e-5 for above, below in sides]) @ product
    return np.linalg.eigvals(product)


def test_the_period_doubles_as_shaw_and_holmes_say(tmp_path, monkeypatch):
    """S. W. Shaw and P. J. Holmes, J. Sound Vib. 90 (1983) 129-155: orbits with one impact per period lose their stability at a
    flip, followed by those with two impacts in two periods; multipliers on both sides are those of the maps between impacts."""

    def largest(w):
        monkeypatch.setattr("test_impacts.W", w)
        t0, v, turn = orbit()
        return multipliers(turn, [np.array([t0, v])])

    flip = brentq(lambda w: largest(w).real.min() + 1, 2.6, 2.7, xtol=1e-10)
    assert np.linalg.eigvals(closed_orbit(flip)[2]).min() == pytest.approx(-1.0, abs=1e-8)
    for w in (2.0, flip - 1e-2):
        expected = np.sort_complex(largest(w))
        result = solve(tmp_path, f", restitution={E}", "&harmonics order=48 /\n", tone=w)
        real, imaginary, stable = (a[0] for a in read(result, "multiplier_real", "multiplier_imag", "is_stable"))
        assert stable == 1
        np.testing.assert_allclose(np.sort_complex((real + 1j * imaginary)[:2]), expected, atol=1e-7)

    w = flip + 2e-2
    monkeypatch.setattr("test_impacts.W", w)
    t0, v, turn = orbit()
    impacts = [np.array([t0 + 0.02, v])]
    for _ in range(400):  # to the orbit that attracts
        impacts.append(next_impact(impacts[-1], impacts[-1][0] + turn))
    assert abs(impacts[-1][0] - impacts[-2][0] - turn) > 1e-2  # it is not the one of an impact a turn
    np.testing.assert_allclose(impacts[-1] - impacts[-3], [2 * turn, 0.0], atol=1e-10)
    expected = multipliers(2 * turn, impacts[-2:])
    result = solve(tmp_path, f", restitution={E}", "&harmonics order=96 /\n", tone=f"{w!r}, subharmonic=2", of=2)
    real, imaginary, stable = (a[0] for a in read(result, "multiplier_real", "multiplier_imag", "is_stable"))
    assert stable == 1
    np.testing.assert_allclose(np.sort_complex((real + 1j * imaginary)[:2]), np.sort_complex(expected), atol=1e-6)
