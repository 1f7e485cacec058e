"""The error estimate of a point against the true error: the distance to a solution of much higher order."""

import numpy as np
import pytest

from program import NOT_ALL_CONVERGED, read, run, solve

BEAM = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4,
   damping_diagonal = 1.0 /
&tones frequency = 2.718281828459045, 3.141592653589793 /
&load dof = 'v3', tuple = 1, 0, cos = 100.0 /
&load dof = 'v3', tuple = 0, 1, cos = 100.0 /
&output dofs = 'v3' /
"""
MASS = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = {damping}, stiffness = 1.0 /
&tones frequency = {tones} /
&load dof = 'x1', tuple = 1, 0, cos = {load} /
&load dof = 'x1', tuple = 0, 1, cos = {load} /
"""

# Model, law and solver, orders with the reference last.
CASES = {
    "elastic stop": (
        MASS.format(damping=0.2, tones="1.0, 1.618033988749895", load=0.4)
        + "&law type = 'elastic_stop', dof = 'x1', stiffness = 10.0, gap = 0.5 /\n&solver first_guess = 'zero' /\n",
        (3, 5, 7, 9, 12, 21),
    ),
    "rigid wall": (
        BEAM + "&law type = 'rigid_wall', dof = 'v3', gap = 1.5e-3, augmentation = 1e5 /\n",
        (2, 3, 5, 8, 12, 21),
    ),
    # steps in the larger set, in which it holds touching contacts, detect .02 to .2 of the error
    "stop ten thousand times as stiff as the beam": (
        BEAM + "&law type = 'elastic_stop', dof = 'v3', stiffness = 84e7, gap = 1.5e-3 /\n&sampling samples = 64 /\n",
        (3, 5, 7, 15),
    ),
    "cubic spring on the beam": (
        BEAM + "&law type = 'cubic_spring', dof = 'v3', stiffness = 1e10 /\n",
        (1, 2, 3, 5, 7, 9, 15),
    ),
    "two-tone Duffing": (
        MASS.format(damping=0.1, tones="2.0, 2.8284271247461903", load=0.25)
        + "&law type = 'cubic_spring', dof = 'x1', stiffness = 1.5 /\n",
        (1, 2, 3, 4, 5, 9),
    ),
    "Jenkins element": (
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.02, stiffness = 1.0 /\n&tones frequency = 1.2 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.3 /\n&sampling samples = 1024 /\n"
        "&law type = 'jenkins', dof = 'x1', stiffness = 1.0, limit = 0.5 /\n",
        (1, 3, 5, 7, 9, 31),
    ),
    "Jenkins element, two tones": (
        MASS.format(damping=0.05, tones="0.9, 1.4562305898749055", load=0.4)
        + "&sampling samples = 64 /\n&law type = 'jenkins', dof = 'x1', stiffness = 1.0, limit = 0.5 /\n",
        (3, 5, 7, 13),
    ),
}
FACTOR = 3.0

CONVERGED, TRUNCATED, ALIASED, PENETRATING, IMPACT = 1, 7, 8, 9, 16


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.long] * (n == "cubic spring on the beam")) for n in CASES])
def test_estimate_is_within_a_factor_of_three_of_the_true_error(name, tmp_path):
    model, orders = CASES[name]
    values = ", ".join(str(order) for order in orders)
    thresholds = "&error_estimate truncation = 10.0, penetration = 10.0 /\n"
    sweep = f"&harmonics order = 1 /\n&sweep parameter = 'harmonics%order', values = {values} /\n"
    result = solve(model + thresholds + sweep, tmp_path)
    motion, truncation, aliasing = read(result, "coefficients", "truncation_estimate", "aliasing_estimate")
    motion = np.nan_to_num(motion)  # tuples that a point lacks count as zero
    estimates = np.hypot(truncation, aliasing)
    reference = motion[-1]
    for order, found, estimate in list(zip(orders, motion, estimates))[:-1]:
        true_error = np.linalg.norm(found - reference) / np.linalg.norm(reference)
        assert true_error / FACTOR <= estimate <= FACTOR * true_error, (order, true_error, estimate)


# One tone each: at the same frequency the motion is the same, however a run arrives there.
FRAMES = {
    "cubic spring": "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n",
    "elastic stop": "&law type = 'elastic_stop', dof = 'x1', stiffness = 10.0, gap = 0.5 /\n",
    "Jenkins element": "&law type = 'jenkins', dof = 'x1', stiffness = 0.5, limit = 0.1 /\n&sampling samples = 256 /\n",
}


@pytest.mark.parametrize("law", FRAMES)
def test_the_same_motion_has_the_same_estimate(law, tmp_path):
    """As a single point, in sweeps from both sides, as the last point, and in a continued sweep."""
    model = MASS.format(damping=0.2, tones="{tone}", load=0.4).replace("tuple = 1, 0", "tuple = 1")
    model = "".join(line for line in model.splitlines(True) if "0, 1" not in line).format(tone=0.7)
    model += FRAMES[law] + "&harmonics order = 7 /\n"
    frequency = "&sweep parameter = 'tones%frequency', from = {}, to = {}, n = 9 /\n"
    names = ("coefficients", "truncation_estimate", "aliasing_estimate", "status")
    found = {"point": [column[0] for column in read(solve(model, tmp_path, name="point", status=None), *names)]}
    for name, ends, at in (("up", (0.5, 0.9), 4), ("down", (0.9, 0.5), 4), ("to it", (0.4, 0.7), 8)):
        path = solve(model + frequency.format(*ends), tmp_path, name=name.replace(" ", "_"), status=None)
        found[name] = [column[at] for column in read(path, *names)]
    text = model + frequency.format(0.5, 0.9)
    (tmp_path / "again.nml").write_text(text)
    run("solve", "again.nml", "--time-limit", "0", cwd=tmp_path)
    run("resume", "again.h5", cwd=tmp_path)
    found["resumed"] = [column[4] for column in read(tmp_path / "again.h5", *names)]
    motion, truncation, aliasing, status = found.pop("point")
    assert status in (CONVERGED, TRUNCATED) and truncation > 1e-9
    for name, (other, *estimates, _) in found.items():
        np.testing.assert_allclose(other, motion, rtol=0, atol=1e-10 * np.abs(motion).max(), err_msg=name)
        np.testing.assert_allclose(estimates, [truncation, aliasing], rtol=1e-6, atol=1e-13, err_msg=name)


VALUE = 5  # kind of a row of a curve
ESTIMATES = ("coefficients", "truncation_estimate", "aliasing_estimate")


@pytest.mark.parametrize("law", FRAMES)
def test_the_same_motion_has_the_same_estimate_on_a_curve(law, tmp_path):
    """At a value that a curve passes from both sides."""
    model = MASS.format(damping=0.2, tones="0.6", load=0.4).replace("tuple = 1, 0", "tuple = 1")
    model = "".join(line for line in model.splitlines(True) if "0, 1" not in line) + FRAMES[law] + "&harmonics order = 7 /\n"
    found = []
    for name, ends in (("up", (0.5, 0.7)), ("down", (0.7, 0.5))):
        curve = "&curve parameter = 'tones%frequency', from = {}, to = {}, values = 0.6 /\n".format(*ends)
        path = solve(model + curve, tmp_path, name=name, status=None)
        kind, *columns = read(path, "curve_kind", *ESTIMATES)
        (at,) = np.flatnonzero(kind == VALUE)
        found.append([column[at] for column in columns])
    _assert_same(found, motion=1e-8, estimates=1e-6)


START, BRANCH = 2, 7


@pytest.mark.parametrize("law", ["cubic_spring", "elastic_stop"])
def test_branch_points_have_their_estimate(law, tmp_path):
    """Where a motion loses its symmetry, approached from both sides and on the curves that begin there: as at the neighbouring
    points."""
    stiffness, tone, ends, nonlinear = {
        "cubic_spring": (0.0, 1.0, (2.0, 2.6), "stiffness = 1.0"),
        "elastic_stop": (1.0, 0.8, (1.2, 1.5), "stiffness = 5.0, gap = 1.0, two_sided = .true."),
    }[law]
    model = f"&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = {stiffness} /\n"
    model += f"&tones frequency = {tone} /\n&load dof = 'x1', tuple = 1, cos = 1.0 /\n&harmonics order = 8 /\n"
    model += f"&law type = '{law}', dof = 'x1', {nonlinear} /\n"
    curve = "&curve parameter = 'load(1)%cos', from = {0}, to = {1}, switch = .true., points = 300 /\n"
    found = []
    for name, (start, end) in (("up", ends), ("down", ends[::-1])):
        path = solve(model + curve.format(start, end), tmp_path, name=name, status=None)
        kind, status, along, estimate = read(path, "curve_kind", "status", "curve_branch", "truncation_estimate")
        assert np.isfinite(estimate[status == CONVERGED]).all()
        at = np.flatnonzero(kind == BRANCH)[0]
        beside = estimate[[at - 1, at + 1]]
        assert 1e-9 < beside.min() / 1.1 < estimate[at] < 1.1 * beside.max()
        starts = estimate[(kind == START) & (along == 1)]
        assert len(starts) == 2
        np.testing.assert_allclose(starts, estimate[at], rtol=1e-6)
        found.append(estimate[at])
    assert found[0] == pytest.approx(found[1], rel=1e-6)


@pytest.mark.parametrize("law", ["cubic spring", "elastic stop"])
def test_the_same_normal_mode_has_the_same_estimate(law, tmp_path):
    model = "&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /\n&tones unknown = .true. /\n"
    model += FRAMES[law].replace("gap = 0.5", "gap = 0.3") + "&harmonics order = 7 /\n&normal_mode dof = 'x1', amplitude = 0.5 /\n"
    sweep = "&sweep parameter = 'normal_mode%amplitude', from = {}, to = {}, n = 5 /\n"
    found = [[column[0] for column in read(solve(model, tmp_path, name="point", status=None), *ESTIMATES)]]
    for name, ends in (("up", (0.4, 0.6)), ("down", (0.6, 0.4))):
        path = solve(model + sweep.format(*ends), tmp_path, name=name, status=None)
        found.append([column[2] for column in read(path, *ESTIMATES)])
    _assert_same(found, motion=1e-8, estimates=1e-6)


@pytest.mark.parametrize("law", FRAMES)
def test_estimates_by_tolerance_are_those_of_their_sets(law, tmp_path):
    """Points of a sweep with a tolerance from both sides, solved again in the sets and on the grids that were chosen."""
    model = MASS.format(damping=0.2, tones="{tone}", load=0.4).replace("tuple = 1, 0", "tuple = 1")
    model = "".join(line for line in model.splitlines(True) if "0, 1" not in line)
    model = model.format(tone=0.7) + FRAMES[law].partition("&sampling")[0] + "&solver tolerance = 1e-11 /\n"
    sweep = "&accuracy tolerance = 1e-3 /\n&sweep parameter = 'tones%frequency', from = {}, to = 0.7, n = 5 /\n"
    for name, start in (("up", 0.5), ("down", 0.9)):
        path = solve(model + sweep.format(start), tmp_path, name=name, status=None)
        n, tuples, grid, *columns = read(path, "n_harmonics", "tuples", "grid", *ESTIMATES)
        given = ", ".join(str(j) for j in tuples[-1][: n[-1]].ravel())
        given = f"&harmonics set = 'list', tuples = {given} /\n&sampling samples = {grid[-1][0]}, kinks = 'corrected' /\n"
        again = read(solve(model + given, tmp_path, name=name + "_given", status=None), *ESTIMATES)
        swept = [column[-1] for column in columns]
        swept[0] = swept[0][:, : n[-1]]
        _assert_same([swept, [column[0] for column in again]], motion=1e-8, estimates=1e-4)


def _assert_same(found, motion, estimates):
    first, *others = found
    assert first[1] > 1e-11
    for other in others:
        np.testing.assert_allclose(other[0], first[0], rtol=0, atol=motion * np.abs(first[0]).max())
        np.testing.assert_allclose(other[1:], first[1:], rtol=estimates, atol=1e-12)


def test_near_commensurate_tones_are_flagged(tmp_path):
    model = MASS.format(damping=0.2, tones="0.9, 1.4142135623730951", load=0.1) + "&harmonics order = 2 /\n"
    model += "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /\n"
    model += "&sweep parameter = 'tones%frequency(1)', values = 0.9, 1.0, axis = 1 /\n"
    model += "&sweep parameter = 'tones%frequency(2)', values = 1.4142135623730951, 1.618033988749895, axis = 1 /\n"
    flags, combinations, frequencies = read(
        solve(model, tmp_path), "is_near_commensurate", "combination", "combination_frequency"
    )
    assert flags.tolist() == [1, 0]
    assert combinations[0].tolist() == [11, -7]
    assert frequencies[0] == pytest.approx(abs(11 * 0.9 - 7 * 2**0.5), rel=1e-9)


def test_thresholds_give_the_status_and_keep_the_coefficients(tmp_path):
    model = BEAM + "&law type = 'rigid_wall', dof = 'v3', gap = 1.5e-3 /\n&harmonics order = 3 /\n"
    model += "&sweep parameter = 'error_estimate%truncation', values = 1e-3, 0.1, 0.1, 0.1, axis = 1 /\n"
    model += "&sweep parameter = 'error_estimate%aliasing', values = 0.1, 1e-6, 0.1, 0.1, axis = 1 /\n"
    model += "&sweep parameter = 'error_estimate%penetration', values = 0.1, 0.1, 1e-3, 0.1, axis = 1 /\n"
    status, coefficients = read(solve(model, tmp_path, status=NOT_ALL_CONVERGED), "status", "coefficients")
    assert status.tolist() == [TRUNCATED, ALIASED, PENETRATING, CONVERGED]
    assert (coefficients == coefficients[-1]).all()


def test_an_error_above_one_per_cent_is_reported_by_default(tmp_path):
    """The motion against the wall at order 3 has an error of 2 %; it is stored all the same."""
    model = BEAM + "&law type = 'rigid_wall', dof = 'v3', gap = 1.5e-3 /\n&harmonics order = 3 /\n"
    status, coefficients, estimate = read(
        solve(model, tmp_path, status=NOT_ALL_CONVERGED), "status", "coefficients", "truncation_estimate"
    )
    assert status.tolist() == [TRUNCATED]
    assert 0.01 < estimate[0] < 0.1
    assert np.isfinite(coefficients).all()


@pytest.mark.parametrize(
    ("tones", "order", "status"),
    [("1.0", 15, IMPACT), ("0.5", 15, IMPACT), ("0.05", 31, CONVERGED), ("1.0, 1.618033988749895", 9, IMPACT)],
)
def test_an_impact_that_restitution_decides_on_is_reported(tones, order, status, tmp_path):
    """One mass against a rigid wall, integrated with restitution 0 and 0.8: the estimate is approximately their difference."""
    two = "," in tones
    model = MASS.format(damping=0.2, tones=tones, load=0.4 if two else 0.6)
    if not two:
        model = model.replace("&load dof = 'x1', tuple = 0, 1, cos = 0.6 /\n", "").replace("tuple = 1, 0", "tuple = 1")
    model += f"&law type = 'rigid_wall', dof = 'x1', gap = 0.5 /\n&harmonics order = {order} /\n"
    model += f"&sampling samples = {64 if two else 1024} /\n&error_estimate truncation = 1.0, penetration = 1.0 /\n"
    model += "&integration transient = 150.0, duration = 300.0, step = 0.05 /\n"
    result = solve(model, tmp_path, status=None)
    found, estimate = (values[0] for values in read(result, "status", "impact_estimate"))
    assert found == status
    motions = []
    for restitution in (0.0, 0.8):
        record = tmp_path / f"integration_{restitution}.h5"
        options = ("--set", f"integration%restitution={restitution}", "--overwrite", "--quiet")
        assert run("integrate", result.with_suffix(".nml"), "-o", record, *options, cwd=tmp_path).status == 0
        motions.append(read(record, "coefficients"))
    difference = np.linalg.norm(motions[1] - motions[0]) / np.linalg.norm(motions[0])
    assert difference / 4 < estimate < 4 * difference, (difference, estimate)


def test_error_of_an_unknown_frequency_is_stored(tmp_path):
    """Free vibration on two springs, 11 : 1, with the frequency 2 w1 w2/(w1 + w2)."""
    model = "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones unknown=.true. /\n"
    model += "&harmonics order=8 /\n&sampling samples=2048 /\n&normal_mode dof='x1', amplitude=-2 /\n"
    model += "&law type='elastic_stop', dof='x1', stiffness=10, gap=0 /\n"
    frequency, estimate = (values[0, 0] for values in read(solve(model, tmp_path), "frequency", "frequency_estimate"))
    error = abs(frequency - 2 * 11**0.5 / (1 + 11**0.5))
    assert error / FACTOR <= estimate <= FACTOR * error


def test_powers_balance(tmp_path):
    model = CASES["rigid wall"][0] + "&harmonics order = 8 /\n"
    model += "&error_estimate penetration = 1.0 /\n"  # of a truncated motion, by 2 %
    names = ("power_in", "power_damping", "power_laws", "truncation_estimate")
    power_in, damping, laws, error = (float(np.sum(values[0])) for values in read(solve(model, tmp_path), *names))
    assert power_in > 0.0
    assert abs(power_in - damping - laws) <= error * power_in


def test_peak_forces_are_those_of_the_motion(tmp_path):
    """A slider that slips carries its limit; the peak of a cubic spring follows from the largest displacement."""
    model = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 0.8 /
&harmonics order = 15 /
&load dof = 'x1', tuple = 1, cos = 0.5 /
&law type = 'jenkins', dof = 'x1', stiffness = 2.0, limit = 0.2 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.7 /
"""
    motion, peak = read(solve(model, tmp_path), "coefficients", "peak_force")
    tau = np.linspace(0.0, 2 * np.pi, 5000)
    cos, sin = motion[0, 0].T
    x = sum(c * np.cos(k * tau) + s * np.sin(k * tau) for k, (c, s) in enumerate(zip(cos, sin)))
    assert peak[0, 0] == pytest.approx(0.2, rel=1e-9)
    assert peak[0, 1] == pytest.approx(0.7 * np.abs(x).max() ** 3, rel=5e-3)


RUBBED = """
&structure type = 'matrices', n_dofs = 2, mass = 1.72, 0, 0, 1.88, damping = 0.472, 0.014, 0.014, 0.516,
   stiffness = 1.242, 0.073, 0.073, 1.359 /
&tones frequency = 0.722 /
&load dof = 'x1', tuple = 1, cos = 0.518, sin = -0.185 /
&law type = 'coulomb_rigid', dof = 'x1', limit = 0.323 /
"""


def test_estimates_under_rigid_friction_see_the_whole_error(tmp_path):
    """The error falls with the first power of the order: it is twice the change from an order to twice the order."""
    orders = (7, 15, 31, 255)
    sweep = f"&harmonics order = 1 /\n&sweep parameter = 'harmonics%order', values = {', '.join(map(str, orders))} /\n"
    result = solve(RUBBED + "&error_estimate truncation = 10.0 /\n" + sweep, tmp_path)
    motion, truncation, aliasing = read(result, "coefficients", "truncation_estimate", "aliasing_estimate")
    motion = np.nan_to_num(motion)
    for order, found, estimate in list(zip(orders, motion, np.hypot(truncation, aliasing)))[:-1]:
        true_error = np.linalg.norm(found - motion[-1]) / np.linalg.norm(motion[-1])
        assert estimate / FACTOR < true_error < 1.7 * estimate, (order, true_error, estimate)


def test_estimates_along_curves_weigh_the_parameter(tmp_path):
    """One harmonic of a mass at a stiff stop: the estimate along a curve is that of the motion, whatever the unit of the value;
    with the value in its own unit beside displacements of a hundredth, it was 70 times the error."""
    text = """
&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.002 /
&tones frequency=8.0 /
&harmonics order={order} /
&load dof='x1', tuple=1, cos=1.0 /
&law type='elastic_stop', dof='x1', stiffness=1e4, gap=0.01 /
&curve parameter='tones%frequency', from=7.7, to=8.0, start=8.0, max_step={step}, points=1000 /
"""
    curves = []
    for order, step in ((1, 0.05), (40, 0.2)):
        result = solve(text.format(order=order, step=step), tmp_path, name=f"order_{order}", status=None)
        kinds, w, c, estimate = read(result, "curve_kind", "frequency", "coefficients", "truncation_estimate")
        used = kinds > 0
        curves.append((w[used, 0], np.nan_to_num(c[used].reshape(used.sum(), -1)), estimate[used]))
    (w, c, estimate), (w_reference, c_reference, _) = curves
    ascending = np.argsort(w_reference)
    reference = np.array([np.interp(w, w_reference[ascending], column[ascending]) for column in c_reference.T]).T
    missing = reference.shape[1] - c.shape[1]
    error = np.linalg.norm(np.pad(c, ((0, 0), (0, missing))) - reference, axis=1) / np.linalg.norm(reference, axis=1)
    assert np.all(estimate > error / FACTOR) and np.all(estimate < FACTOR * error), (estimate / error)


def test_estimates_of_frequencies_do_not_cancel(tmp_path):
    """A normal mode between two stops: at order 7 on 48 samples the errors by the set and by the grid have opposite signs, and
    their sum was a tenth of the error."""
    text = """
&structure type='chain', n_masses=1, ends='fixed-free', mass=1.39728, coupling_stiffness=1.04190, damping_mass=0.0 /
&tones unknown=.true. /
&law type='elastic_stop', dof='x1', stiffness=4.20985, gap=0.44854, two_sided=.true. /
&normal_mode dof='x1', amplitude=0.7, mode=1 /
&harmonics order={order} /
&sampling samples={samples}, kinks='corrected' /
"""
    reference = read(solve(text.format(order=127, samples=2048), tmp_path, name="reference"), "frequency")[0, 0]
    for order in (5, 7, 9, 11, 13):
        result = solve(text.format(order=order, samples=48), tmp_path, name=f"order_{order}", status=None)
        frequency, estimate = read(result, "frequency", "frequency_estimate")
        assert abs(frequency[0, 0] - reference) <= FACTOR * estimate[0, 0], order


def frequencies_towards_tip(damping, cubic, load, phases):
    """Frequencies at which Duffing's oscillator of order 1 lags its load by 90 degrees less `phases`, in closed form."""
    frequencies = []
    for phase in phases:
        w = 1.0
        for _ in range(200):
            a = load * np.cos(phase) / (damping * w)
            w = np.sqrt(1.0 + 0.75 * cubic * a**2 - damping * w * np.tan(phase))
        frequencies.append(w)
    return frequencies


@pytest.mark.parametrize("damping", [4e-5, 1e-4, 1e-3])
def test_error_towards_the_tip_of_a_resonance_is_not_underestimated(damping, tmp_path):
    """A shift of the backbone moves a motion at the tip by its root, along a direction that linear steps do not show."""
    phases = np.concatenate([np.arccos(np.linspace(0.01, 0.9, 90)), np.geomspace(0.4, 0.01, 20)])
    values = ", ".join(map(repr, map(float, frequencies_towards_tip(damping, 0.1, damping, phases))))
    model = (
        f"&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = {damping}, stiffness = 1.0 /\n&tones frequency = 1.0 /\n"
        f"&load dof = 'x1', tuple = 1, cos = {damping} /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /\n"
        "&solver first_guess = 'neighbour' /\n&error_estimate truncation = 10.0 /\n"
        f"&sweep parameter = 'tones%frequency', values = {values} /\n"
    )
    motions, estimates = [], []
    for order in (2, 15):
        result = solve(model + f"&harmonics order = {order} /\n", tmp_path)
        motion, status, estimate = read(result, "coefficients", "status", "truncation_estimate")
        assert (status == CONVERGED).all()
        motions.append(motion)
        estimates.append(estimate)
    found, reference = motions
    missing = np.zeros_like(reference)
    missing[:, :, : found.shape[2]] = found
    errors = np.sqrt(((missing - reference) ** 2).sum(axis=(1, 2, 3)) / (reference**2).sum(axis=(1, 2, 3)))
    assert errors[-1] > 0.02  # the tip is reached
    assert (errors <= FACTOR * estimates[0]).all()
    assert (estimates[0] <= FACTOR * errors)[errors > 1e-6].all()
