"""Bifurcations on curves of motions with two tones: of uncoupled oscillators, known from the curve of one tone; of a forced van der
Pol oscillator by the mean of its damping, which is zero where the third tone is born; and by time integration on both sides."""

import numpy as np
import pytest
from nhbm_post.reader import Results

from program import coefficients_by_tuple, read, solve

UEDA = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 0.0, damping_mass = 0.1 /
&tones frequency = 1.0 /
&harmonics order = 13 /
&load dof = 'x1', tuple = 0, cos = 0.5 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&curve parameter = 'load(2)%cos', from = 1.0, to = 3.7, points = 200 /
"""
BESIDE_LINEAR = """
&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.0, 0.0, 1.0, stiffness = 0.0, 0.0, 0.0, 1.0, damping_mass = 0.1 /
&tones frequency = {tones} /
&harmonics order = {orders} /
&load dof = 'x1', tuple = 0, 0, cos = 0.5 /
&load dof = 'x1', tuple = {own}, cos = 1.0 /
&load dof = 'x2', tuple = {other}, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&curve parameter = 'load(2)%cos', from = 1.0, to = 3.7, points = 200 /
&stability method = 'integration' /
"""
FORCED_VAN_DER_POL = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0, damping = 0.0 /
&tones frequency = 2.2, 3.7 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, 0, cos = 8.0 /
&load dof = 'x1', tuple = 0, 1, cos = 9.0 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.1 /
&stability method = 'integration' /
"""
SWAPPED = """
&tones frequency = 3.7, 2.2 /
&harmonics order = 5, 6 /
&load dof = 'x1', tuple = 0, 1, cos = 8.0 /
&load dof = 'x1', tuple = 1, 0, cos = 9.0 /
"""
TORUS = 9


def forced_van_der_pol(swapped):
    """With its tones in this order or the other one."""
    if not swapped:
        return FORCED_VAN_DER_POL
    lines = FORCED_VAN_DER_POL.splitlines(keepends=True)
    return "".join([lines[1], SWAPPED, *lines[6:]])


def points_of(path, kind):
    with Results(path) as results:
        return results.curve.values[results.select({"curve_kind": kind})]


def mean_squares(path, points=None):
    """Of the motion without a mean value."""
    coefficients = read(path, "coefficients")
    squares = 0.5 * np.nansum(coefficients**2, axis=tuple(range(1, coefficients.ndim)))
    return squares if points is None else squares[points]


@pytest.mark.parametrize(
    "names",
    [
        {"tones": "1.0, 1.6180339887", "orders": "13, 1", "own": "1, 0", "other": "0, 1"},
        {"tones": "1.6180339887, 1.0", "orders": "1, 13", "own": "0, 1", "other": "1, 0"},
        {"tones": "1.0, 0.27182818", "orders": "13, 1", "own": "1, 0", "other": "0, 1"},
    ],
    ids=["first tone", "second tone", "beside a slow tone"],
)
def test_uncoupled_parts_bifurcate_as_each_alone(names, tmp_path):
    """The motion of the second oscillator changes nothing of the first one."""
    alone = solve(UEDA, tmp_path, name="alone")
    both = solve(BESIDE_LINEAR.format(**names), tmp_path, name="both")
    doublings = points_of(alone, "period_doubling")
    assert len(doublings) == 3
    assert points_of(both, "period_doubling") == pytest.approx(doublings, rel=1e-8)


def test_odd_motions_lose_their_symmetry_as_alone(tmp_path):
    """Of the symmetric oscillator, with odd harmonics only."""
    found = {}
    for name, text in {
        "alone": UEDA.replace("&load dof = 'x1', tuple = 0, cos = 0.5 /\n", ""),
        "both": BESIDE_LINEAR.replace("&load dof = 'x1', tuple = 0, 0, cos = 0.5 /\n", "").format(
            tones="1.0, 1.6180339887", orders="13, 1", own="1, 0", other="0, 1"
        ),
    }.items():
        text = text.replace("load(2)", "load(1)").replace("&harmonics", "&harmonics odd_only = .true., ")
        found[name] = points_of(solve(text, tmp_path, name=name), "symmetry_breaking")
    assert len(found["alone"]) >= 1
    assert found["both"] == pytest.approx(found["alone"], rel=1e-8)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_third_tone_is_born_where_the_mean_damping_vanishes(swapped, tmp_path):
    """The sum of both exponents of a disturbance is the mean of mu (1 - x**2) (Liouville): a pair of them passes the axis where
    the mean square of the motion is 1."""
    text = forced_van_der_pol(swapped) + "&curve parameter = 'load(1)%cos', from = 8.0, to = 2.0 /\n"
    path = solve(text, tmp_path)
    kinds, n_unstable = read(path, "curve_kind", "n_unstable")
    (point,) = np.flatnonzero(kinds == TORUS)
    assert mean_squares(path, point) == pytest.approx(1.0, abs=1e-7)
    assert (n_unstable[point - 1], n_unstable[point + 1]) == (0, 2)


def test_the_locus_of_births_is_followed(tmp_path):
    text = FORCED_VAN_DER_POL + (
        "&curve parameter = 'load(1)%cos', from = 4.6, to = 2.0, follow = 'neimark_sacker', over = 'load(2)%cos',\n"
        "   over_from = 24.0, over_to = 3.0, points = 30 /\n"
    )
    path = solve(text, tmp_path)
    squares = mean_squares(path, read(path, "curve_kind") > 0)
    assert len(squares) > 5
    assert squares == pytest.approx(np.ones_like(squares), abs=1e-7)


def late_amplitude(rate, state, frequencies):
    """Largest amplitude at these frequencies of the first coordinate after a long time (Runge-Kutta)."""
    step, first, n = 0.02, 50000, 75000
    y = np.array(state)
    positions = np.empty(n - first)
    for i in range(n):
        t = i * step
        k1 = rate(t, y)
        k2 = rate(t + step / 2, y + step / 2 * k1)
        k3 = rate(t + step / 2, y + step / 2 * k2)
        k4 = rate(t + step, y + step * k3)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if i >= first:
            positions[i - first] = y[0]
    times = step * np.arange(first + 1, n + 1)
    window = np.hanning(n - first)
    return max(2 * abs(np.sum(window * positions * np.exp(-1j * w * times)) / np.sum(window)) for w in frequencies)


def free_amplitude(load):
    """Of the van der Pol oscillator, beside its two given tones."""

    def rate(t, y):
        x, v = y
        return np.array([v, 0.1 * (1.0 - x**2) * v - x + load * np.cos(2.2 * t) + 9.0 * np.cos(3.7 * t)])

    return late_amplitude(rate, [2.0, 0.0], np.linspace(0.9, 1.1, 201))


def test_coupled_parts_double_by_half_of_a_tone(tmp_path):
    """Where the period of one tone doubles does not depend on the tone over whose periods disturbances are mapped. A time
    integration from beside the motion has lines at half of that tone where it is unstable, and returns to it where it is stable."""
    found = []
    for tones, own, other in (("1.0, 1.6180339887", "1, 0", "0, 1"), ("1.6180339887, 1.0", "0, 1", "1, 0")):
        text = BESIDE_LINEAR.format(tones=tones, orders="8, 8", own=own, other=other)
        text = text.replace("stiffness = 0.0, 0.0, 0.0, 1.0", "stiffness = 0.05, -0.05, -0.05, 1.0")
        path = solve(text.replace("from = 1.0, to = 3.7", "from = 1.05, to = 1.25, values = 1.1, 1.2"), tmp_path)
        found += [points_of(path, "period_doubling")]
    assert len(found[0]) == 1
    assert found[1] == pytest.approx(found[0], rel=1e-8)

    def half_tone(load):
        point = np.nanargmin(abs(read(path, "load_2_cos") - load))
        omega = np.array([1.6180339887, 1.0])
        state = np.zeros((2, 2))
        for dof in (0, 1):
            for j, (c, s) in coefficients_by_tuple(path, point, dof).items():
                state[:, dof] += [c, omega @ j * s]

        def rate(t, y):
            x, z, v, w = y
            force = 0.5 + load * np.cos(t) - 0.1 * v - 0.05 * (x - z) - x**3
            return np.array([v, w, force, np.cos(1.6180339887 * t) - 0.1 * w + 0.05 * x - z])

        return late_amplitude(rate, state.ravel() + [0.01, 0.0, 0.0, 0.0], [0.5])

    assert half_tone(1.1) > 0.05
    assert half_tone(1.2) < 1e-3


def test_shifts_of_an_unknown_tone_do_not_count(tmp_path):
    """The one other exponent of a torus of a van der Pol oscillator is the mean of its damping."""
    text = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /
&tones frequency = 1.8, 0.0, unknown = .false., .true. /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, 0, cos = 0.3 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.3 /
&curve parameter = 'load(1)%cos', from = 0.3, to = 0.35 /
&stability method = 'integration' /
"""
    path = solve(text, tmp_path)
    used = read(path, "curve_kind") > 0
    exponents = read(path, "exponent")[used]
    assert exponents[:, 0] == pytest.approx(0.3 * (1.0 - mean_squares(path, used)), rel=1e-5)
    assert np.all(np.isnan(exponents[:, 1:]))


@pytest.mark.parametrize("swapped", [False, True])
def test_switch_leads_to_the_born_tone(swapped, tmp_path):
    """Its amplitude at a load behind the birth is that of a time integration, which finds none before it."""
    text = forced_van_der_pol(swapped) + "&curve parameter = 'load(1)%cos', from = 5.2, to = 3.5, values = 4.0, switch = .true. /\n"
    path = solve(text, tmp_path)
    (birth,) = np.flatnonzero(read(path, "curve_kind") == TORUS)
    branch = path.with_name(f"{path.stem}_{birth}.h5")
    loads = read(branch, "load_1_cos")
    point = np.nanargmin(abs(loads - 4.0))
    assert loads[point] == pytest.approx(4.0, rel=1e-9)
    amplitude = np.hypot(*coefficients_by_tuple(branch, point)[0, 0, 1])
    assert free_amplitude(4.0) == pytest.approx(amplitude, rel=1e-3)
    assert free_amplitude(5.2) < 1e-3 * amplitude


def test_an_oscillator_with_its_own_tone_loses_area_as_its_damping_does(tmp_path):
    """One of both disturbances of a forced self-excited oscillator is the shift of its phase, so that the exponent of the other one
    is the mean of mu (1 - x**2) (Liouville): on all points of a curve, however slowly the series of disturbances fall."""
    path = solve(
        """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /
&tones frequency = 1.2, 1.01, unknown = .false., .true. /
&harmonics order = 9, 7 /
&load dof = 'x1', tuple = 1, 0, sin = 0.5 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.5 /
&curve parameter = 'load(1)%sin', start = 0.5, from = 0.7, to = 0.3 /
""",
        tmp_path,
    )
    kinds, exponents, stable = read(path, "curve_kind", "exponent", "is_stable")
    used = np.flatnonzero(np.isfinite(read(path, "coefficients")).all(axis=(1, 2, 3)) & (kinds >= 0))
    assert len(used) > 5
    assert exponents[used, 0] == pytest.approx(0.5 * (1.0 - mean_squares(path)[used]), abs=1e-6)
    assert (stable[used] == 1).all()
