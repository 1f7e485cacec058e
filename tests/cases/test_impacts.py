"""Masses that strike rigid walls with a given restitution, against orbits composed of free flights."""

import shlex
import time

import h5py
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from program import INCOMPLETE, NOT_ALL_CONVERGED, read, run
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

W, D, E = 2.6, 0.1, 0.8  # tone, damping, restitution of a unit mass on a unit spring under a unit load
MODEL = """&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0,
           damping_mass=0.1 /
&tones frequency={tone} /
&load dof='x1', tuple={tuple}, cos=1.0 /
&law type='rigid_wall', dof='x1', gap=0.0{law} /
"""
INTEGRATED, IMPACT = 18, 16
NEAR = 1e-3  # of the frequency: how near the curve comes to the graze, where its derivatives grow without bound


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
    assert (status, stable) == (INTEGRATED, 1)
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
    assert read(solve(tmp_path, "", sets, status=NOT_ALL_CONVERGED), "status")[0] == IMPACT


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
    more = "&harmonics order=12 /\n&integration steps_per_period=20000 /\n&solver max_fallback_work=40 /\n"
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


@pytest.mark.long
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
        expected = largest(w)
        result = solve(tmp_path, f", restitution={E}", "&harmonics order=48 /\n", tone=w)
        real, imaginary, stable = (a[0] for a in read(result, "multiplier_real", "multiplier_imag", "is_stable"))
        assert stable == 1
        # At 2.0 the two are nearly equal: their sum and product, not they themselves, have the digits of the map.
        np.testing.assert_allclose(np.poly((real + 1j * imaginary)[:2]).real, np.poly(expected).real, atol=1e-7)

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


GAP, FOLDING = 2.0, 0.7  # gap and restitution of a mass whose orbits with one impact per period fold


def orbits_to(gap, e, w):
    """Velocities before the one impact in each turn at a wall in a distance, the larger first, each with the matrix of the turn, as
    `closed_orbit`: the forced state at the impact is (gap, 0) and a multiple of that velocity; NaN beyond the fold."""
    flow = expm(np.array([[0.0, 1.0], [-1.0, -D]]) * 2 * np.pi / w)
    steady = 1 / (1 - w**2 + 1j * w * D)
    a, b = np.linalg.solve(np.eye(2) - flow, flow @ [0.0, e] + [0.0, 1.0])
    both, found = a**2 + (b / w) ** 2, []
    for side in (1, -1):
        v = (-gap * a + side * np.sqrt(gap**2 * a**2 - both * (gap**2 - abs(steady) ** 2))) / both
        t0 = (np.arctan2(-v * b / w, gap + v * a) - np.angle(steady)) / w
        before, after = np.cos(w * t0) - gap - D * v, np.cos(w * t0) - gap + D * e * v
        found.append((v, flow @ np.array([[-e, 0.0], [(after + e * before) / v, -e]])))
    return found


def fold_of(gap, e, low, high):
    """Where both orbits meet."""

    def distance(w):
        flow = expm(np.array([[0.0, 1.0], [-1.0, -D]]) * 2 * np.pi / w)
        a, b = np.linalg.solve(np.eye(2) - flow, flow @ [0.0, e] + [0.0, 1.0])
        return gap**2 * a**2 - (a**2 + (b / w) ** 2) * (gap**2 - abs(1 / (1 - w**2 + 1j * w * D)) ** 2)

    return brentq(distance, low, high, xtol=1e-14)


KINDS = ("none", "regular", "start", "fold", "peak", "value", "end", "branch", "period_doubling", "neimark_sacker",
         "symmetry_breaking", "grazing", "minimum")


def curve(directory, more, gap, e, options=()):
    path = directory / "curve.nml"
    path.write_text(MODEL.replace("gap=0.0", f"gap={gap}").format(tone=1.15, tuple=1, law=f", restitution={e}") + more)
    run("solve", path, "--overwrite", "--quiet", *options, cwd=directory)
    return path.with_suffix(".h5")


def closed_line(w, e, gap, k):
    """First harmonic, cos - i sin, of the orbit with one impact per period at any gap and stiffness, in closed form."""
    turn = 2 * np.pi / w
    matrix = np.array([[0.0, 1.0], [-k, -D]])
    flow, steady = expm(matrix * turn), 1 / (k - w**2 + 1j * w * D)
    inverse = np.linalg.inv(np.eye(2) - flow)
    rest, along = inverse @ (np.eye(2) - flow) @ [gap, 0.0], inverse @ ([0.0, 1.0] + flow @ [0.0, e])
    norm = np.diag([1.0, w**-2])
    v = np.roots([along @ norm @ along, 2 * along @ norm @ rest, rest @ norm @ rest - abs(steady) ** 2]).max()
    forced = rest + v * along
    t0 = (np.arctan2(-forced[1] / w, forced[0]) - np.angle(steady)) / w
    # of the free part after the impact, in closed form: the integral of exp(matrix t) exp(-i w t) over a period
    free = np.linalg.solve(matrix - 1j * w * np.eye(2), (flow - np.eye(2)) @ (np.array([gap, -e * v]) - forced))[0]
    return steady + 2 / turn * free * np.exp(-1j * w * t0)


NUMBERS = ("tones%frequency", "law(1)%restitution", "law(1)%gap", "structure%ground_stiffness")
AT = (W, E, 0.0, 1.0)
BY = "&harmonics order=12 /\n&gradient by=" + ", ".join(f"'{name}'" for name in NUMBERS) + " /\n"


def derivative(k, at=AT):
    """Of the first harmonic by one of the numbers, by fourth-order differences of the closed form."""
    way = 1e-3 * np.eye(4)[k]
    near = [closed_line(*(np.array(at) + step * way)) for step in (2, 1, -1, -2)]
    return (-near[0] + 8 * near[1] - 8 * near[2] + near[3]) / 12e-3


def test_derivatives_of_an_orbit_are_those_of_its_closed_form(tmp_path):
    """And those of two points nearby."""
    result = solve(tmp_path, f", restitution={E}", BY)
    found, of_frequency, estimate, defect = (
        a[0] for a in read(result, "gradient", "frequency_gradient", "gradient_estimate", "gradient_defect")
    )
    slopes = found[:, 0, 1, 0] - 1j * found[:, 0, 1, 1]
    for k in range(4):
        assert slopes[k] == pytest.approx(derivative(k), rel=1e-6), NUMBERS[k]
    np.testing.assert_allclose(of_frequency[:, 0], [1.0, 0.0, 0.0, 0.0])
    assert estimate.max() < 1e-5 and defect.max() < 1e-3
    sides = []
    for e in (E - 1e-4, E + 1e-4):
        (tmp_path / f"{e}").mkdir()
        sides.append(read(solve(tmp_path / f"{e}", f", restitution={e}", "&harmonics order=12 /\n"), "coefficients")[0])
    np.testing.assert_allclose(found[1], (sides[1] - sides[0]) / 2e-4, atol=1e-5)


def test_derivatives_along_a_curve_are_those_of_the_closed_form(tmp_path):
    """Of each point at its value."""
    curve = "&curve parameter='tones%frequency', from=2.6, to=2.62, points=4 /\n"
    w, status, slopes = read(solve(tmp_path, f", restitution={E}", BY + curve), "tones_frequency", "status", "gradient")
    points = np.flatnonzero(status == INTEGRATED)
    assert len(points) > 1
    for i, k in np.ndindex(len(points), 4):
        slope = slopes[points[i], k, 0, 1]
        assert slope[0] - 1j * slope[1] == pytest.approx(derivative(k, (w[points[i]], *AT[1:])), rel=1e-6), NUMBERS[k]


def points_of(result):
    names = ("curve_kind", "status", "frequency", "is_stable", "multiplier_real", "multiplier_imag", "coefficients")
    kind, status, w, *values = read(result, *names)
    return [(KINDS[kind[i]], w[i, 0], *(value[i] for value in values)) for i in np.flatnonzero(status == INTEGRATED)]


@pytest.mark.long
def test_a_curve_passes_the_fold_of_orbits_with_an_impact(tmp_path):
    """Along stable and unstable orbits multipliers are those of the closed form, and so is the fold, where both kinds meet.
    At the graze the curve turns to the motion that does not reach the wall."""
    more = "&curve parameter='tones%frequency', from=1.15, to=1.7, values=1.18,1.45, points=70 /\n&harmonics order=12 /\n"
    found = points_of(curve(tmp_path, more, GAP, FOLDING))
    fold = fold_of(GAP, FOLDING, 1.5, 1.53)
    place = [kind for kind, *_ in found].index("fold")
    assert found[place][1] == pytest.approx(fold, abs=1e-8)
    graze = [kind for kind, *_ in found].index("grazing")
    assert all(stable == 1 for _, _, stable, *_ in found[graze:])
    for i, (kind, w, stable, real, imaginary, _) in enumerate(found[:graze]):
        if kind == "fold":
            continue
        expected = np.linalg.eigvals(orbits_to(GAP, FOLDING, w)[i > place][1])
        np.testing.assert_allclose(np.sort_complex((real + 1j * imaginary)[:2]), np.sort_complex(expected), rtol=1e-6, atol=1e-7)
        assert stable == (-1 if i > place else 1)
    values = [point for point in found if point[0] == "value"]
    assert [stable for _, _, stable, *_ in values] == [1, 1, -1]
    swept = curve(tmp_path, "&harmonics order=12 /\n&sweep parameter='tones%frequency', values=1.18 /\n", GAP, FOLDING)
    np.testing.assert_allclose(read(swept, "coefficients")[0], values[0][-1], atol=1e-8)


@pytest.mark.long
def test_a_curve_locates_the_flip_of_shaw_and_holmes(tmp_path):
    more = "&curve parameter='tones%frequency', from=2.5, to=2.8, points=30 /\n&harmonics order=12 /\n"
    found = points_of(curve(tmp_path, more, 0.0, E))
    flip = brentq(lambda w: np.linalg.eigvals(closed_orbit(w)[2]).real.min() + 1, 2.6, 2.7, xtol=1e-14)
    place = [kind for kind, *_ in found].index("period_doubling")
    assert found[place][1] == pytest.approx(flip, abs=1e-8)
    assert [stable for _, _, stable, *_ in found] == [1] * place + [0] + [-1] * (len(found) - place - 1)


def test_the_doubled_period_is_followed_from_its_flip(tmp_path, monkeypatch):
    """Orbits with two impacts in two periods, between which and the single one the flight map alternates."""
    text = MODEL.format(tone=2.6, tuple=1, law=f", restitution={E}") + "&harmonics order=12 /\n"
    (tmp_path / "one.nml").write_text(text + "&curve parameter='tones%frequency', from=2.6, to=2.7, points=20 /\n")
    run("solve", "one.nml", "--quiet", cwd=tmp_path)
    kinds = [kind for kind, *_ in points_of(tmp_path / "one.h5")]
    flip = kinds.index("period_doubling")
    w = brentq(lambda w: np.linalg.eigvals(closed_orbit(w)[2]).real.min() + 1, 2.6, 2.7, xtol=1e-14) + 2e-2
    text = text.replace("frequency=2.6", "frequency=2.6, subharmonic=2").replace("tuple=1", "tuple=2")
    text = text.replace("order=12", "order=24")
    (tmp_path / "two.nml").write_text(
        text + f"&curve parameter='tones%frequency', from=2.6, to={w!r}, points=30, origin='one.h5', origin_point={flip} /\n"
    )
    done = run("solve", "two.nml", cwd=tmp_path)
    assert done.status == 0, done.stdout + done.stderr
    last = points_of(tmp_path / "two.h5")[-1]
    assert last[:3] == ("end", pytest.approx(w / 2), 1)
    monkeypatch.setattr("test_impacts.W", w)
    t0, v, turn = closed_orbit(w)[0], closed_orbit(w)[1], 2 * np.pi / w
    impacts = [np.array([t0 + 0.02, v])]
    for _ in range(400):  # to the orbit that attracts
        impacts.append(next_impact(impacts[-1], impacts[-1][0] + turn))
    np.testing.assert_allclose(impacts[-1] - impacts[-3], [2 * turn, 0.0], atol=1e-10)
    lines = np.zeros(6, complex)
    for before, after in ((impacts[-3], impacts[-2]), (impacts[-2], impacts[-1])):
        nodes, weights = leggauss(200)
        length = after[0] - before[0]
        t = before[0] + length * (nodes + 1) / 2
        x = flight(before[0], 0.0, -E * before[1], t)[0]
        lines += length / 2 / (2 * turn) * np.array([(2 if k else 1) * (weights * x) @ np.exp(-0.5j * k * w * t) for k in range(6)])
    found = last[-1][0, :6, 0] - 1j * last[-1][0, :6, 1]
    odd = (-1.0) ** np.arange(6)  # a period later it is the same orbit
    assert min(abs(found - lines).max(), abs(found - odd * lines).max()) < 1e-8
    assert abs(found[1]) > 1e-3


@pytest.mark.parametrize(
    "parameter", ["load(1)%cos", *(pytest.param(f"law(1)%{key}", marks=pytest.mark.long) for key in ("gap", "restitution"))]
)
def test_a_curve_moves_what_is_no_frequency(parameter, tmp_path):
    """Its end is the motion that a point has there."""
    start, end = {"law(1)%gap": (2.0, 1.8), "law(1)%restitution": (0.7, 0.6), "load(1)%cos": (1.0, 1.1)}[parameter]
    more = "&harmonics order=12 /\n"
    found = points_of(
        curve(tmp_path, more + f"&curve parameter='{parameter}', from={start}, to={end}, points=40 /\n", GAP, FOLDING)
    )
    assert found[-1][0] == "end"
    alone = curve(tmp_path, more, GAP, FOLDING, ("--set", f"{parameter}={end}"))
    np.testing.assert_allclose(found[-1][-1], read(alone, "coefficients")[0], atol=1e-8)


@pytest.mark.long
def test_an_interrupted_curve_goes_on_where_it_was(tmp_path):
    more = "&curve parameter='tones%frequency', from=1.15, to=1.3, points=40 /\n&accuracy tolerance=1e-2 /\n"
    begun = time.monotonic()
    whole = points_of(curve(tmp_path, more, GAP, FOLDING))
    limit = (time.monotonic() - begun) / 4
    result = curve(tmp_path, more, GAP, FOLDING, ("--time-limit", str(limit)))
    assert len(points_of(result)) < len(whole)
    assert run("resume", result, "--quiet", cwd=tmp_path).status == 0
    for one, other in zip(points_of(result), whole, strict=True):
        assert one[0] == other[0]
        np.testing.assert_allclose(one[1], other[1], rtol=1e-7)


@pytest.mark.long
def test_a_curve_interrupted_at_a_graze_goes_on_to_the_same_bits(tmp_path):
    """At a load of 1.007 the motion without impacts reaches the wall, and the curve turns back to the unstable motion with one."""
    model = MODEL.replace("gap=0.0", f"gap={GAP}").replace("cos=1.0", "cos=0.95")
    model = model.format(tone=1.22, tuple=1, law=f", restitution={FOLDING}")
    (tmp_path / "turn.nml").write_text(
        model + "&harmonics order=3 /\n&curve parameter='load(1)%cos', from=0.95, to=1.05, points=8, max_step=0.5 /\n"
    )
    whole, part = tmp_path / "whole.h5", tmp_path / "part.h5"
    begun = time.monotonic()
    assert run("solve", "turn.nml", "-o", whole, "--quiet", cwd=tmp_path).status == 0
    limit = (time.monotonic() - begun) / 4
    assert "grazing" in [kind for kind, *_ in points_of(whole)]
    status = run("solve", "turn.nml", "-o", part, "--time-limit", str(limit), "--quiet", cwd=tmp_path).status
    assert status == INCOMPLETE
    assert run("resume", part, "--quiet", cwd=tmp_path).status == 0
    with h5py.File(whole) as one, h5py.File(part) as other:
        assert set(one) == set(other)
        for name in one:  # but for the times of both runs
            if isinstance(one[name], h5py.Dataset) and not (name.startswith("worker_") or name.endswith("_seconds")):
                np.testing.assert_array_equal(one[name][()], other[name][()], name)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("&tones frequency=1.3,2.1 /", "one by one: &sweep parameter = 'law(1)%gap', from = 0.0, to = 1.0, n = 20 /"),
        ("&tones frequency=1.3,2.1, unknown=.false.,.true. /", "needs a given tone; replace the wall by an elastic_stop"),
        ("others=0.5", "'others'"),
        ("follow='fold', over='load(1)%cos', over_from=1.0, over_to=2.0", "'follow'"),
    ],
)
def test_what_a_curve_with_impacts_cannot_do_is_refused(more, says, tmp_path):
    path = tmp_path / "refused.nml"
    of_curve = "" if more.startswith("&") else ", " + more
    text = MODEL.format(tone=1.3, tuple=1, law=", restitution=0.7") + "&harmonics order=5 /\n"
    if "tones" in more:
        text = text.replace("&tones frequency=1.3 /", more).replace("tuple=1", "tuple=1,0").replace("order=5", "order=5,5")
    path.write_text(text + f"&curve parameter='law(1)%gap', from=0.0, to=1.0, points=5{of_curve} /\n")
    ended = run("solve", path, "--overwrite", cwd=tmp_path)
    assert ended.status == 2
    assert says in ended.stderr


@pytest.mark.parametrize("load", [1.0, 0.0])
def test_a_curve_of_a_mass_at_rest_ends(load, tmp_path):
    """A static load does not reach the wall: there are no speeds by which states could be scaled."""
    path = tmp_path / "rest.nml"
    text = MODEL.format(tone=1.0, tuple=0, law=", restitution=0.7").replace("gap=0.0", "gap=2.0") + "&harmonics order=5 /\n"
    path.write_text(text + "&curve parameter='tones%frequency', from=1.0, to=1.7, points=12 /\n")
    ended = run("solve", path, "--set", f"load(1)%cos={load}", cwd=tmp_path)
    assert ended.status in (0, 4), ended.stderr
    with h5py.File(tmp_path / "rest.h5") as file:
        solved = file["status"][()] == 18
        assert solved[0]
        displacements = file["coefficients"][()][solved, 0]
        assert displacements[:, 0, 0] == pytest.approx(load, abs=1e-8) and abs(displacements[:, 1:]).max() < 1e-8


@pytest.mark.long
def test_a_curve_turns_where_the_wall_is_grazed(tmp_path):
    """The unstable orbits end where the forced motion without an impact just reaches the wall, abs(steady) = gap; from there the
    curve goes on along that motion."""
    more = "&curve parameter='tones%frequency', from=1.15, to=1.7, points=200 /\n&harmonics order=12 /\n"
    found = points_of(curve(tmp_path, more, GAP, FOLDING))
    kinds = [kind for kind, *_ in found]
    graze = brentq(lambda w: abs(1 / (1 - w**2 + 1j * w * D)) - GAP, 1.1, 1.4)
    place = kinds.index("grazing")
    assert kinds.count("grazing") == 1 and found[place][1] == pytest.approx(graze, abs=NEAR)
    assert kinds[-1] == "end" and all(stable == 1 for _, _, stable, *_ in found[place + 1 :])
    for _, w, *_, coefficients in found[place + 1 :]:
        cosine, sine = coefficients[0, 1]
        assert cosine - 1j * sine == pytest.approx(1 / (1 - w**2 + 1j * w * D), abs=1e-8)


def two_masses(c, w):
    """Multipliers of the orbit of two coupled masses, of which the loaded one strikes a wall without a gap once a period: damping
    and restitution are constant, so that the state before the impact is linear in that of the forced motion."""
    k, damping = np.array([[1.1, -0.1], [-0.1, 0.5]]), np.diag([0.2, c])
    flow = expm(np.block([[np.zeros((2, 2)), np.eye(2)], [-k, -damping]]) * 2 * np.pi / w)
    steady = np.linalg.solve(k + 1j * w * damping - w**2 * np.eye(2), [1.0, 0.0])
    jump = np.diag([1.0, 1.0, -E, 1.0])
    before = np.linalg.solve(np.eye(4) - flow @ jump, (np.eye(4) - flow) @ np.concatenate([steady, 1j * w * steady]))
    for side in (1, -1):
        phase = side * np.pi / 2 - np.angle(before[0])
        x = (before * np.exp(1j * phase)).real
        if x[2] > 0:
            break
    slopes = [np.concatenate([y[2:], [np.cos(phase), 0.0] - k @ y[:2] - damping @ y[2:]]) for y in (x, jump @ x)]
    saltation = jump + np.outer(slopes[1] - jump @ slopes[0], [1.0, 0.0, 0.0, 0.0]) / x[2]
    return np.linalg.eigvals(flow @ saltation)


@pytest.mark.long  # half a minute
def test_a_curve_locates_the_torus_of_two_masses(tmp_path):
    """A pair of multipliers leaves the unit circle where the second mass is driven as much as the impacts damp it."""
    (tmp_path / "two.nml").write_text(
        "&structure type='matrices', n_dofs=2, mass=1,0,0,1, stiffness=1.1,-0.1,-0.1,0.5, damping=0.2,0,0,0.05 /\n"
        "&tones frequency=2.5 /\n&load dof='x1', tuple=1, cos=1.0 /\n"
        f"&law type='rigid_wall', dof='x1', gap=0.0, restitution={E} /\n&harmonics order=12 /\n"
        "&curve parameter='structure%damping(4)', from=0.05, to=-0.02, points=40 /\n"
    )
    run("solve", "two.nml", "--quiet", cwd=tmp_path)
    kind, value, real, imaginary = read(
        tmp_path / "two.h5", "curve_kind", "structure_damping_4", "multiplier_real", "multiplier_imag"
    )
    torus = brentq(lambda c: abs(two_masses(c, 2.5)).max() - 1, -0.02, 0.05, xtol=1e-13)
    (place,) = np.flatnonzero(kind == KINDS.index("neimark_sacker"))
    assert value[place] == pytest.approx(torus, abs=1e-8)
    np.testing.assert_allclose(
        np.sort_complex((real + 1j * imaginary)[place][:4]), np.sort_complex(two_masses(torus, 2.5)), atol=1e-6
    )


def largest_of_difference(coupling, w):
    """Largest multiplier of the difference of two equal coupled masses that strike a wall each at the same instants."""
    turn = 2 * np.pi / w
    flow = expm(np.array([[0.0, 1.0], [-1.0, -D]]) * turn)
    steady, jump = 1 / (1 - w**2 + 1j * w * D) * np.array([1.0, 1j * w]), np.diag([1.0, -E])
    before = np.linalg.solve(np.eye(2) - flow @ jump, (np.eye(2) - flow) @ steady)
    phase = np.pi / 2 - np.angle(before[0])
    if (before[1] * np.exp(1j * phase)).real < 0:
        phase += np.pi
    x = (before * np.exp(1j * phase)).real
    slopes = [np.array([y[1], np.cos(phase) - y[0] - D * y[1]]) for y in (x, jump @ x)]
    saltation = jump + np.outer(slopes[1] - jump @ slopes[0], [1.0, 0.0]) / x[1]
    return np.linalg.eigvals(expm(np.array([[0.0, 1.0], [-1.0 - 2 * coupling, -D]]) * turn) @ saltation).real.max()


def equal_masses(coupling, way):
    """Two masses with a wall each, and a curve over the spring between them."""
    both = "".join(
        f"&load dof='x{i}', tuple=1, cos=1.0 /\n&law type='rigid_wall', dof='x{i}', gap=0.0, restitution={E} /\n" for i in (1, 2)
    )
    return (
        f"&structure type='chain', n_masses=2, ends='free', mass=1.0, coupling_stiffness={coupling}, ground_stiffness=1.0,\n"
        f"           damping_mass=0.1 /\n&tones frequency=2.3 /\n{both}&harmonics order=12 /\n"
        f"&curve parameter='structure%coupling_stiffness', {way} /\n"
    )


@pytest.mark.long  # half a minute
def test_a_curve_locates_the_branch_point_of_equal_masses(tmp_path):
    """Their common motion loses its stability to motions in which they differ."""
    (tmp_path / "equal.nml").write_text(equal_masses(0.1, "from=0.18, to=0.33, points=12"))
    run("solve", "equal.nml", "--quiet", cwd=tmp_path)
    kind, value = read(tmp_path / "equal.h5", "curve_kind", "structure_coupling_stiffness")
    assert KINDS.index("grazing") not in kind, "both masses strike at the same instant, each once a period"
    (place,) = np.flatnonzero(kind == KINDS.index("branch"))
    branch = brentq(lambda coupling: largest_of_difference(coupling, 2.3) - 1, 0.15, 0.25, xtol=1e-13)
    assert value[place] == pytest.approx(branch, abs=1e-6)


@pytest.mark.long
def test_the_branch_of_motions_that_differ_is_followed(tmp_path):
    """From the branch point of equal masses, to both sides: their images under exchange of the masses."""
    (tmp_path / "equal.nml").write_text(equal_masses(0.2, "from=0.2, to=0.206, max_step=0.3, points=18, switch=.true."))
    run("solve", "equal.nml", "--quiet", cwd=tmp_path)
    kind, value, branch, residual, stable, found = read(
        tmp_path / "equal.h5", "curve_kind", "structure_coupling_stiffness", "curve_branch", "residual", "is_stable", "coefficients"
    )
    assert np.count_nonzero(kind == KINDS.index("branch")) == 1
    others = np.flatnonzero((branch == 1) & (kind != KINDS.index("start")))
    assert len(others) > 4 and residual[others].max() < 1e-9
    apart = np.abs(found[:, 0] - found[:, 1]).max(axis=(1, 2))
    assert apart[others].max() > 1e-2 and apart[branch == 0].max() < 1e-6


@pytest.mark.long  # 10 s each
@pytest.mark.parametrize("order", ["&harmonics order=9 /\n", ""], ids=["order", "tolerance"])
def test_unstable_motions_are_left_not_wrong(tmp_path, order):
    """Behind a flip; of a given order the coefficients are compared, and there are no disturbances to speak of."""
    (tmp_path / "case.nml").write_text(
        "&structure type='matrices', n_dofs=1, mass=0.5, damping=0.3, stiffness=50.0 /\n&tones hertz=3.4 /\n"
        "&load dof='x1', tuple=1, cos=6.0 /\n&law type='rigid_wall', dof='x1', gap=0.02, restitution=0.5 /\n"
        f"{order}&curve parameter='tones%hertz', from=3.68, to=3.76 /\n"
    )
    run("solve", "case.nml", "--quiet", cwd=tmp_path)
    stable = read(tmp_path / "case.h5", "is_stable")
    points = [np.flatnonzero(stable == 1)[0], np.flatnonzero(stable == -1)[-1]]
    said = run("verify", "case.h5", "--points", ",".join(map(str, points)), cwd=tmp_path).stdout
    assert f"point {points[0]}: agrees" in said and f"point {points[1]}: unstable" in said
    assert ("whose coefficients differ by" in said) == bool(order) and "neither grow nor decay" not in said


def test_a_motion_of_four_periods_leads_to_a_command_that_finds_it(tmp_path):
    (tmp_path / "case.nml").write_text(
        "&structure type='matrices', n_dofs=1, mass=0.5, damping=0.3, stiffness=50.0 /\n&tones hertz=4.0 /\n"
        "&load dof='x1', tuple=1, cos=6.0 /\n&law type='rigid_wall', dof='x1', gap=0.02, restitution=0.5 /\n"
    )
    run("solve", "case.nml", "--quiet", cwd=tmp_path)
    assert read(tmp_path / "case.h5", "n_periods") == [4]
    (command,) = [line for line in run("why", "case.h5", cwd=tmp_path).stdout.splitlines() if line.strip().startswith("try:")]
    words = shlex.split(command)
    assert words[1:4] == ["nhbm", "solve", "case.nml"] and "tones%subharmonic=4" in words
    run(*words[2:], cwd=tmp_path)
    assert read(tmp_path / words[-1], "status") == [INTEGRATED]


@pytest.mark.long
def test_an_impact_that_fades_is_no_peak(tmp_path):
    """Behind the flip the motion is unstable; steps fail near the graze, where the linear motion reaches the wall and falls on."""
    (tmp_path / "case.nml").write_text(
        "&structure type='matrices', n_dofs=1, mass=0.5, damping=0.3, stiffness=50.0 /\n&tones hertz=2.9 /\n"
        "&load dof='x1', tuple=1, cos=6.0 /\n&law type='rigid_wall', dof='x1', gap=0.02, restitution=0.5 /\n"
        "&curve parameter='tones%hertz', from=2.9, to=4.5, peak_of='x1 (1)' /\n"
    )
    run("solve", "case.nml", "--quiet", cwd=tmp_path)
    kinds, hertz = read(tmp_path / "case.h5", "curve_kind", "tones_hertz")
    located = [(KINDS[kind], value) for kind, value in zip(kinds, hertz) if KINDS[kind] not in ("none", "regular", "start")]
    assert [kind for kind, _ in located] == ["peak", "period_doubling", "grazing", "end"]
    w = 2 * np.pi * brentq(lambda f: abs(6 / (50 - 0.5 * (2 * np.pi * f) ** 2 + 0.6j * np.pi * f)) - 0.02, 3.5, 5.0)
    assert located[2][1] == pytest.approx(w / (2 * np.pi), rel=1e-6)


def two_tone_flights(w, loads, damping, gap, e, duration, step=0.02):
    """Displacements of a unit mass on a unit spring under two tones, in free flights between impacts on a wall."""
    flow = np.array([[0.0, 1.0], [-1.0, -damping]])
    values, vectors = np.linalg.eig(flow)
    inverse = np.linalg.inv(vectors)
    steady = [load / (1 - tone**2 + 1j * tone * damping) for tone, load in zip(w, loads)]

    def forced(t):
        return np.array([sum((c * (1j * tone) ** k * np.exp(1j * tone * t)).real for c, tone in zip(steady, w)) for k in (0, 1)])

    def after(y, t, s):
        """States at t + s of the free motion that is y at t, (2, s.size)."""
        return (vectors @ (np.exp(np.outer(values, s)) * (inverse @ y)[:, None])).real + forced(t + s)

    t, state, record, steps = 0.0, np.zeros(2), [], step * np.arange(1, 401)
    while t < duration:
        y = state - forced(t)
        found = after(y, t, steps)[0]
        struck = np.flatnonzero(found > gap)
        n = struck[0] if struck.size else found.size
        record.append(np.array([t + steps[:n], found[:n]]).T)
        if n < found.size:
            s = brentq(lambda s, y=y, t=t: after(y, t, np.array([s]))[0, 0] - gap, n * step, (n + 1) * step)
            state = np.array([gap - 1e-14, -e * after(y, t, np.array([s]))[1, 0]])
        else:
            s = steps[-1]
            state = after(y, t, steps[-1:])[:, 0]
        t += s
    return np.concatenate(record)


@pytest.mark.long
def test_impacts_under_two_tones_are_integrated(tmp_path):
    """Incommensurate tones, several impacts in a beat: within the default budget, with the mean and the root mean square of
    flights, and without the remark that no motion reaches the wall."""
    w, loads, damping, gap, e = (0.9425771711, 0.7747863902), (0.554592, 0.411587 - 0.203003j), 0.090558, 0.752505, 0.5321
    (tmp_path / "case.nml").write_text(f"""
&structure type='matrices', n_dofs=1, mass=1.0, damping={damping}, stiffness=1.0 /
&tones frequency={w[0]}, {w[1]} /
&load dof='x1', tuple=1,0, cos=0.554592 /
&load dof='x1', tuple=0,1, cos=0.411587, sin=0.203003 /
&law type='rigid_wall', dof='x1', gap={gap}, restitution={e} /
&gradient by='law(1)%gap' /
""")
    done = run("solve", "case.nml", cwd=tmp_path)
    assert done.status == 0, done.stdout
    assert "no motion reaches it" not in done.stdout
    assert "without derivatives" in done.stdout
    status, c, tuples = read(tmp_path / "case.h5", "status", "coefficients", "tuples")
    assert status[0] == INTEGRATED
    amplitudes = np.hypot(*np.nan_to_num(c[0].reshape(-1, 2)).T)
    constant = ~np.any(tuples.reshape(len(amplitudes), -1), axis=1)
    record = two_tone_flights(w, loads, damping, gap, e, 3000.0)
    x = record[record[:, 0] > 500.0, 1]
    assert np.nan_to_num(c[0].reshape(-1, 2))[constant, 0].sum() == pytest.approx(x.mean(), rel=1e-2)
    assert np.sqrt(np.sum(amplitudes[~constant] ** 2) / 2) == pytest.approx(x.std(), rel=1e-2)
