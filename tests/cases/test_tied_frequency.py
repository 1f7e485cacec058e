"""Values that follow the frequency of an unknown tone by a `&tie`: the van der Pol oscillator, whose frequency scales with the
square root of its stiffness, x'' - mu (1 - x**2) x' + k x = 0: omega = sqrt(k) W(mu / sqrt(k))."""

from __future__ import annotations

import shutil

import h5py
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from program import ALL_CONVERGED, read, run

PENDING = 0

W = 0.94295584744161  # W(1), from the period 6.6632868593231361 in extended precision
K = 2.0
MU = float(np.sqrt(K))
RATE = (K - 1.0) / (np.sqrt(K) * W)  # so that k = 1 + RATE * omega is 2 where mu = sqrt(2)
TIE = f"&tie parameter='structure%stiffness', to='tones%frequency(1)', factor={float(RATE)!r}, offset=1 /\n"


def model(mu=MU, rest="", tie=TIE, stiffness=1.0, size="&harmonics order=61, odd_only=.true. /\n"):
    return (
        f"&structure type='matrices', n_dofs=1, mass=1, stiffness={float(stiffness)!r} /\n"
        f"&tones unknown=.true., frequency=1.0 /\n{size}{tie}"
        f"&law type='van_der_pol', dof='x1', strength={float(mu)!r} /\n{rest}"
    )


def solve(folder, text, name="in"):
    (folder / f"{name}.nml").write_text(text)
    done = run("solve", f"{name}.nml", "-o", f"{name}.h5", "--overwrite", "--quiet", cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    return folder / f"{name}.h5"


def period(mu, k):
    """Of the limit cycle, between two zeros of x with x' > 0, by integration."""

    def rising(_, y):
        return y[0]

    rising.direction = 1
    times = solve_ivp(
        lambda _, y: [y[1], mu * (1 - y[0] ** 2) * y[1] - k * y[0]],
        (0, 120),
        [2.0, 0.0],
        "DOP853",
        events=rising,
        rtol=1e-13,
        atol=1e-13,
    ).t_events[0]
    return times[-1] - times[-2]


def test_a_stiffness_follows_the_frequency_of_its_cycle(tmp_path):
    result = solve(tmp_path, model())
    assert read(result, "frequency")[0, 0] == pytest.approx(np.sqrt(K) * W, rel=1e-11)
    done = run("verify", result, cwd=tmp_path)
    assert "agree" in done.stdout, done.stdout
    with_tolerance = solve(tmp_path, model(size="&accuracy tolerance=1e-6 /\n"), "tolerance")
    assert read(with_tolerance, "frequency")[0, 0] == pytest.approx(np.sqrt(K) * W, rel=1e-6)


@pytest.mark.long  # half a minute
def test_a_sweep_and_a_curve_have_the_same_cycles(tmp_path):
    """At each value the frequency is a fixed point, here of own integrations in time."""
    swept = solve(tmp_path, model(rest="&sweep parameter='law(1)%strength', values=0.5, 1.0, 2.0 /\n"))
    frequency = read(swept, "frequency")[:, 0]
    expected = [brentq(lambda w, mu=mu: 2 * np.pi / period(mu, 1 + RATE * w) - w, 0.8, 2.0, xtol=1e-12) for mu in (0.5, 2.0)]
    np.testing.assert_allclose(frequency[[0, 2]], expected, rtol=1e-9)
    curve = solve(tmp_path, model(0.5, "&curve parameter='law(1)%strength', from=0.5, to=2.0, values=1.0, points=40 /\n"), "curve")
    kind, value, along = read(curve, "curve_kind", "law_1_strength", "frequency")
    on = np.isin(value, (0.5, 1.0, 2.0)) & (kind > 0)
    assert sorted(value[on]) == [0.5, 1.0, 2.0]
    np.testing.assert_allclose(along[on, 0][np.argsort(value[on])], frequency, rtol=1e-9)
    done = run("verify", curve, cwd=tmp_path)
    assert "disagree" not in done.stdout and done.status == 0, done.stdout


def test_a_curve_continues_from_its_file(tmp_path):
    curve = solve(tmp_path, model(0.5, "&curve parameter='law(1)%strength', from=0.5, to=2.0, points=40 /\n"))
    broken = shutil.copy(curve, tmp_path / "broken.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][4:] = PENDING
    assert run("resume", broken, cwd=tmp_path).status == ALL_CONVERGED
    frequency = read(curve, "frequency")
    np.testing.assert_array_equal(read(broken, "frequency"), frequency)


def test_derivatives_follow_the_chain(tmp_path):
    """omega = sqrt(k) W(mu / sqrt(k)), k = 1 + RATE omega, against differences of the fixed points of two solutions."""
    size = "&harmonics order=61, odd_only=.true. /\n"
    result = solve(tmp_path, model(rest="&gradient by='law(1)%strength' /\n", size=size))
    slope = read(result, "frequency_gradient")[0, 0, 0]
    mu, step = np.sqrt(K), 1e-4
    there = [read(solve(tmp_path, model(mu + d, size=size)), "frequency")[0, 0] for d in (-step, step)]
    assert slope == pytest.approx((there[1] - there[0]) / (2 * step), rel=1e-6)


def test_a_normal_mode_follows_too(tmp_path):
    """Without a law that acts at this amplitude, k = 1 + omega has the frequency (1 + sqrt(5))/2."""
    text = (
        "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n"
        "&tones unknown=.true., frequency=1.0 /\n&harmonics order=7 /\n"
        "&tie parameter='structure%stiffness', to='tones%frequency(1)', factor=1, offset=1 /\n"
        "&law type='cubic_spring', dof='x1', stiffness=1e-12 /\n&normal_mode amplitude=0.1, dof='x1' /\n"
    )
    assert read(solve(tmp_path, text), "frequency")[0, 0] == pytest.approx((1 + np.sqrt(5)) / 2, rel=1e-11)
    curve = solve(
        tmp_path,
        text.replace("1e-12", "1.0") + "&curve parameter='normal_mode%amplitude', from=0.1, to=1.0, points=40 /\n",
        "curve",
    )
    kind, value, frequency = read(curve, "curve_kind", "normal_mode_amplitude", "frequency")
    last = np.flatnonzero(kind > 0)[-1]
    point = solve(tmp_path, text.replace("1e-12", "1.0").replace("amplitude=0.1", f"amplitude={float(value[last])!r}"), "point")
    assert frequency[last, 0] == pytest.approx(read(point, "frequency")[0, 0], rel=1e-9)


@pytest.mark.parametrize(("offset", "says"), [(-0.26, "agrees with the values that are tied to it"), (-1.1, "was not found")])
def test_a_tie_that_no_motion_satisfies_is_reported(offset, says, tmp_path):
    """omega**2 = k = omega + offset has no root below -1/4; below -1 the stiffness of the first guess is negative."""
    text = (
        "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n"
        "&tones unknown=.true., frequency=1.0 /\n&harmonics order=5 /\n"
        f"&tie parameter='structure%stiffness', to='tones%frequency(1)', factor=1, offset={offset} /\n"
        "&law type='van_der_pol', dof='x1', strength=0.5 /\n"
    )
    (tmp_path / "in.nml").write_text(text)
    done = run("solve", "in.nml", "-o", "in.h5", cwd=tmp_path)
    assert "1 stalled" in done.stdout and says in done.stdout, done.stdout + done.stderr
    assert "*" not in run("why", "in.h5", cwd=tmp_path).stdout, "a number without its digits"
