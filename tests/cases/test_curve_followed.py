"""Folds, bifurcations and normal modes followed over two values, and the motions that branch off."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from nhbm_post.reader import Results
from scipy.integrate import solve_ivp

import shooting
from curve_models import COLLAPSED, DUFFING, FOLD, GRAZE, INPUTS, PENDING, assert_same_bits
from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, read, run, solve

MODE = """
&structure type = 'chain', n_masses = 2, ends = 'fixed', mass = 1.0, coupling_stiffness = 1.0 /
&tones unknown = .true. /
&harmonics order = 21, odd_only = .true. /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&normal_mode mode = 1 /
"""


def test_followed_points_stay_within_their_range(tmp_path):
    """The load at which an amplitude is constant passes 0.3 N where w**2 is about 1.37."""
    held = "&curve parameter = 'tones%frequency', from = 1.1, to = 1.6, amplitude_of = 'x1 (1)', amplitudes = 1.5,"
    held += " follow = 'amplitude', over = 'load(1)%cos', over_from = 0.01, over_to = 0.3 /\n"
    model = DUFFING.replace("order = 5", "order = 1") + "&error_estimate is_on = .false. /\n"
    (tmp_path / "held.nml").write_text(model + held)
    done = run("solve", "held.nml", cwd=tmp_path)
    assert "leaves the range of 'over'" in done.stdout + done.stderr
    assert "no bifurcation was located" not in done.stdout
    with Results(tmp_path / "held.h5") as curve:
        load = curve.per_point("curve_over")[curve.used]
        assert 0.28 < np.nanmax(load) <= 0.3


def test_followed_points_are_verified_at_both_values(tmp_path):
    """The computed load is in the model that is integrated."""
    held = "&curve parameter = 'tones%frequency', from = 0.6, to = 0.7, amplitude_of = 'x1 (1)', amplitudes = 1.5,"
    held += " follow = 'amplitude', over = 'load(1)%cos', over_from = 0.01, over_to = 2.0 /\n"
    path = solve(DUFFING + held, tmp_path)
    done = run("verify", path.name, "--points", "0,2", cwd=tmp_path)
    assert done.status == ALL_CONVERGED and done.stdout.count("agrees with time integration") == 2, done.stdout


LAVAL = """
&structure type = 'jeffcott', mass = 1.0, stiffness = 1.0, damping = 0.13, rotating_damping = 0.4, speed = 0.5 /
&tones frequency = 1.5 /
&tie parameter = 'structure%speed', to = 'tones%frequency' /
&harmonics order = 5 /
&load dof = 'x', tuple = 1, cos = 0.25, frequency_power = 2 /
&load dof = 'y', tuple = 1, sin = 0.25, frequency_power = 2 /
&load dof = 'x', tuple = 0, cos = -0.4 /
&law type = 'cubic_damping', dofs = 'x', coefficient = 0.25 /
&law type = 'cubic_damping', dofs = 'y', coefficient = 0.25 /
"""
CHAIN = """
&structure type = 'chain', n_masses = 3, ends = 'free', mass = 1.0, coupling_stiffness = 0.5, ground_stiffness = 1.0,
   damping_mass = 9.0 /
&tones frequency = 0.8 /
&harmonics order = 5 /
&load dof = 'x3', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&tie parameter = 'structure%damping_mass', to = 'load(1)%cos', factor = 0.2 /
&tie parameter = 'law(1)%stiffness', to = 'structure%damping_mass', factor = 10.0 /
"""


@pytest.mark.parametrize(
    ("model", "kind", "moved", "span", "over"),
    [
        (LAVAL, "neimark_sacker", "law(1)%coefficient", (0.25, 0.3), (1.5, 2.0)),
        (CHAIN, "fold", "load(1)%cos", (0.3, 0.4), (0.8, 1.6)),
    ],
)
def test_followed_points_take_along_what_is_tied(model, kind, moved, span, over, tmp_path):
    """A speed to the frequency that is located; damping and stiffness, of a condensed structure, to the load."""
    model += "&error_estimate is_on = .false. /\n"
    along = f"&curve parameter = '{moved}', from = {span[0]}, to = {span[1]}, follow = '{kind}', over = 'tones%frequency',"
    along += f" over_from = {over[0]}, over_to = {over[1]} /\n"
    curve = f"&curve parameter = 'tones%frequency', from = {over[0]}, to = {over[1]}, points = 400 /\n"
    with Results(solve(model + along, tmp_path, name="ridge")) as followed:
        (last,) = followed.select({"curve_kind": "end"})
        with Results(solve(model + curve, tmp_path, "--set", f"{moved}={span[1]}", name="there")) as known:
            found = known.curve.values[known.select({"curve_kind": kind})]
        assert followed.per_point("curve_over")[last] == pytest.approx(found[0], rel=1e-8)


def test_doublings_are_followed_to_those_of_curves_there(tmp_path):
    """Ueda's oscillator with a mean load, over the load and along the damping."""
    model = (INPUTS / "gallery" / "ueda_curve.nml").read_text().partition("&curve")[0].replace("order = 21", "order = 9")
    model += "&load dof = 'x1', tuple = 0, cos = 0.2 /\n&error_estimate is_on = .false. /\n"
    curve = "&curve parameter = 'load(1)%cos', from = 0.01, to = 6.0"
    ridge = f"&curve parameter = 'structure%damping_mass', from = 0.1, to = 0.12, follow = 'period_doubling', {curve[7:]} /\n"
    ridge = ridge.replace("parameter = 'load", "over = 'load").replace("from = 0.01, to = 6.0", "over_from = 0.01, over_to = 6.0")
    with Results(solve(model + ridge, tmp_path, name="ridge")) as followed:
        (last,) = followed.select({"curve_kind": "end"})
        there = solve(model.replace("damping_mass = 0.1", "damping_mass = 0.12") + curve + " /\n", tmp_path, name="there")
        with Results(there) as known:
            (flip,) = known.select({"curve_kind": "period_doubling"})
            assert followed.per_point("curve_over")[last] == pytest.approx(known.curve.values[flip], rel=1e-8)


def test_tied_tones_and_unbalance_move_along(tmp_path):
    text = (
        DUFFING.replace("frequency = 0.5", "frequency = 0.5, 0.8")
        .replace("order = 5", "order = 3")
        .replace("tuple = 1, cos = 0.18", "tuple = 1, 0, cos = 0.05, frequency_power = 2")
        + "&load dof = 'x1', tuple = 0, 1, cos = 0.05 /\n"
    )
    curve = "&curve parameter = 'tones%frequency(1)', from = 0.5, to = 0.7, values = 0.6, tie = 'ratio' /\n"
    followed = solve(text + curve, tmp_path, name="curve")
    alone = solve(text, tmp_path, "--set", "tones%frequency=0.6,0.96", name="alone")
    with Results(followed) as found, Results(alone) as known:
        [there] = found.select({"curve_kind": "value"})
        assert found.frequency(there) == pytest.approx([0.6, 0.96], rel=1e-15)
        for j in ((1, 0), (0, 1), (2, 1)):
            assert found.amplitude(there, "x1", j) == pytest.approx(known.amplitude(0, "x1", j), rel=1e-10)


def test_limit_cycles_are_followed_and_end_where_they_die(tmp_path):
    """A decreasing negative damping: the cycle of x'' - e (1 - x**2) x' + d x' + x = 0 has the amplitude 2 sqrt(1 - d/e) and
    vanishes at d = e."""
    text = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 1e-3 /
&tones unknown = .true. /
&harmonics order = 5 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.05 /
&curve parameter = 'structure%damping_mass', from = 1e-3, to = 0.1, values = 0.0375 /
"""
    path = solve(text, tmp_path)
    assert "1 curve ended where the motion of an unknown tone vanishes" in run("info", path.name, cwd=tmp_path).stdout
    with Results(path) as results:
        [there] = results.select({"curve_kind": "value"})
        assert results.amplitude(there, "x1", (1,)) == pytest.approx(1.0, abs=2e-4)
        assert results.frequency(there)[0] == pytest.approx(1.0, abs=1e-3)
        last = results.used[-1]
        assert results.status_name(last) == "collapsed"
        assert results.per_point("structure_damping_mass")[last] == pytest.approx(0.05, rel=0.01)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ("from = 0.0, to = 5.0", "must be above 0"),
        ("from = 1.0, to = 0.0", "must not be 0 and must not change its sign"),
        ("from = 1.0, to = 5.0 /\n&tie parameter = 'law(1)%stiffness', to = 'normal_mode%energy'", "no &tie may follow"),
    ],
)
def test_what_is_wrong_with_a_curve_over_the_energy_is_said(tmp_path, keys, says):
    (tmp_path / "bad.nml").write_text(MODE + f"&curve parameter = 'normal_mode%energy', {keys} /\n")
    done = run("solve", "bad.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and says in done.stderr, done.stderr


def test_motions_on_a_tongue_repeat_in_time(tmp_path):
    """Motions along the whole tongue, integrated over one period from those of the balance."""
    path = solve((INPUTS / "gallery" / "two_masses_tongue.nml").read_text().replace("order = 31", "order = 51"), tmp_path)
    status, energies, omegas, coefficients = read(path, "status", "normal_mode_energy", "frequency", "coefficients")
    orders = read(path, "tuple")[:, 0]
    on_tongue = np.flatnonzero((status == 1) & (energies > 1000.0))
    assert on_tongue.size > 60

    def rate(t, y):
        return [*y[2:], -2.0 * y[0] + y[1] - 0.5 * y[0] ** 3, y[0] - 2.0 * y[1]]

    for point in on_tongue[::8]:
        omega, cosines, sines = omegas[point, 0], *np.moveaxis(coefficients[point], -1, 0)
        start = np.concatenate([cosines.sum(axis=1), omega * sines @ orders])
        period = solve_ivp(rate, (0.0, 2.0 * np.pi / omega), start, method="DOP853", rtol=1e-12, atol=1e-12)
        assert np.linalg.norm(period.y[:, -1] - start) < 1e-8 * np.linalg.norm(start), energies[point]


def test_curves_over_the_energy_go_on_bit_by_bit(tmp_path):
    text = MODE + "&curve parameter = 'normal_mode%energy', from = 3000.0, to = 5000.0, points = 100 /\n"
    path = solve(text, tmp_path)
    assert "fold" in Results(path).curve_kind()
    broken = shutil.copy(path, tmp_path / "broken.h5")
    with h5py.File(broken, "r+") as file:
        file["status"][9:] = PENDING
    assert run("resume", broken, cwd=tmp_path).status == ALL_CONVERGED
    assert_same_bits(path, broken, "normal_mode_energy")


@pytest.mark.long
def test_torus_behind_a_graze_is_found_and_followed_both_ways(tmp_path):
    """A rotor that bounces in its ring; radii at 1.15 rad/s by time integration from rest, 0.1271 and 1.1203."""
    text = (Path(__file__).parents[2] / "inputs" / "gallery" / "jeffcott_torus.nml").read_text(encoding="utf-8")
    path = solve(text.replace("to = 2.5", "to = 1.2").replace("1.0, 1.15, 1.3", "1.15"), tmp_path, status=None)
    with Results(path) as results:
        (graze,) = results.select({"curve_kind": "grazing"})
    torus = path.with_name(f"{path.stem}_{graze}.h5")
    with Results(torus) as results:
        (at_value,) = results.select({"curve_kind": "value"})
    status, speed, tuples, c = read(torus, "status", "tones_frequency_1", "tuple", "coefficients")
    assert speed[status == COLLAPSED] == pytest.approx(0.9251817195, rel=1e-4), "its tone dies out at the graze"
    has_motion = np.isin(status, (1, 7))  # converged, truncated
    of_all, of_other_tone = ((part[has_motion] ** 2).sum(axis=(1, 2, 3)) for part in (c, c[:, :, tuples[:, 1] != 0]))
    assert (of_other_tone > 1e-12 * of_all).all(), "and what follows is no torus"
    phases = np.stack(np.meshgrid(*2 * [np.linspace(0, 2 * np.pi, 200)]))
    angles = np.tensordot(tuples, phases, 1)
    radius = np.hypot(*(np.tensordot(c[at_value, k, :, 0], np.cos(angles), 1)
                        + np.tensordot(c[at_value, k, :, 1], np.sin(angles), 1) for k in (0, 1)))  # fmt: skip
    np.testing.assert_allclose([radius.min(), radius.max()], [0.1271, 1.1203], rtol=0, atol=1e-3)


@pytest.mark.long
def test_doubled_motions_are_followed_in_a_file_of_their_own(tmp_path):
    """Ueda's oscillator at B = 5: amplitudes by shooting (DOP853 at 3e-14)."""
    text = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 0.0,
   damping_mass = 0.1 /
&tones frequency = 1.0 /
&harmonics order = 21 /
&load dof = 'x1', tuple = 1, cos = 0.01 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&curve parameter = 'load(1)%cos', from = 0.01, to = 5.2, values = 5.0, switch = .true., points = 500 /
"""
    path = solve(text, tmp_path)
    with Results(path) as results:
        (flip, other) = results.select({"curve_kind": "period_doubling"})
        assert results.curve.values[flip] == pytest.approx(4.8760911500, rel=1e-8)
    doubled = path.with_name(f"{path.stem}_{flip}.h5")
    with Results(doubled) as results:
        (at_value,) = results.select({"curve_kind": "value"})
        found = [results.amplitude(at_value, "x1", (j,)) for j in (1, 2, 3, 4)]
        np.testing.assert_allclose(found, [0.02060777, 1.81210552, 0.06220297, 0.74272815], rtol=0, atol=2e-8)
        assert results.stability()[at_value] == 1
    before = read(doubled, "coefficients")
    assert run("resume", path.name, cwd=tmp_path).status == ALL_CONVERGED
    assert read(doubled, "coefficients")[0].tobytes() == before[0].tobytes()
    shutil.copy(doubled, tmp_path / "alone.h5")
    old = path.with_name(f"{path.stem}_3.h5")
    shutil.copy(doubled, old)
    with h5py.File(old, "r+") as file:
        file["input_text"].attrs["file_name"] = f"point 3 of {path}"
    done = run("solve", path.with_suffix(".nml").name, "--overwrite", cwd=tmp_path, ranks=2)
    assert done.status == ALL_CONVERGED, done.stderr
    assert not old.exists(), "what left the curve of before at a point where this one has none"
    assert_same_bits(tmp_path / "alone.h5", doubled, moving="load_1_cos")


TWO_FLIPS = """
&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,100.0, damping=0.1,0.2, labels='x','y' /
&tones frequency=1.3 /
&harmonics order=7 /
&load dof='y', tuple=1, cos=100.0 /
&law type='polynomial_coupled', dofs='x','y', coefficients=0.5, acts_on='x', displacement_exponents=1,1 /
&law type='cubic_spring', dof='x', stiffness=0.5 /
&curve parameter='tones%frequency', from=1.3, to=2.9, switch=.true., points=60 /
"""
RESONANCE = """
&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,4.0, damping=0.02,0.04 /
&tones frequency=1.008 /
&harmonics order=5 /
&load dof='x1', tuple=1, cos=0.02 /
&law type='polynomial_coupled', dofs='x1','x2', coefficients=1.0,0.5, acts_on='x1','x2', displacement_exponents=1,1, 2,0 /
&curve parameter='tones%frequency', from=1.008, to=1.001, switch=.true., points=30, torus_order=4,2 /
"""


def test_other_motions_begin_where_their_point_is(tmp_path):
    """Not elsewhere, where the motion of the curve has no such point: frequencies along it differ from that at its start."""
    path = solve(TWO_FLIPS, tmp_path)
    with Results(path) as results:
        flips = results.select({"curve_kind": "period_doubling"})
        values = results.curve.values[flips]
    assert len(flips) == 2
    for flip, value in zip(flips, values):
        with Results(path.with_name(f"{path.stem}_{flip}.h5")) as results:
            assert results.curve.values[0] == pytest.approx(value, abs=1e-3)


def test_tone_that_joins_is_next_to_the_main_one(tmp_path):
    """Its frequency is that of the angle of the multipliers, at the frequency of the point."""
    path = solve(RESONANCE, tmp_path, status=None)
    with Results(path) as results:
        torus = results.select({"curve_kind": "neimark_sacker"})[0]
        value = results.curve.values[torus]
    real, imaginary = read(path, "multiplier_real", "multiplier_imag")
    angle = np.arctan2(imaginary[torus, 0], real[torus, 0])
    with Results(path.with_name(f"{path.stem}_{torus}.h5")) as results:
        first, second = results.frequency(0)
        assert first == pytest.approx(value, abs=1e-3)
        assert abs(second - first) == pytest.approx(abs(angle) / (2 * np.pi) * value, rel=1e-2)
        assert results.status[0] == 1


def test_damping_may_begin_at_zero(tmp_path):
    """The value below it, of the central difference, is rejected: van der Pol's motion vanishes where the damping is 1."""
    text = """
&structure type='matrices', n_dofs=1, mass=1.0, stiffness=1.0 /
&tones unknown=.true. /
&accuracy tolerance=1e-4 /
&law type='polynomial', dof='x1', damping=-1.0,0.0,0.333333333333333 /
&curve parameter='structure%damping_diagonal', from=0.0, to=1.5, points=100 /
"""
    with Results(solve(text, tmp_path)) as results:
        assert results.status_name(results.used[-1]) == "collapsed"
        assert results.curve.values[results.used[-1]] == pytest.approx(1.0, abs=1e-2)


@pytest.mark.long  # seconds
def test_folds_at_a_stop_are_those_of_shooting(tmp_path):
    """Two masses, one against a stop: five digits at order 21, with a truncation of 5e-6, and more at order 41."""
    lower, upper = shooting.folds()
    for order, samples, tolerance in ((21, 256, 1e-5), (41, 1024, 1e-6)):
        text = (INPUTS / "gallery" / "stop_curve.nml").read_text()
        text = text.replace("order = 21", f"order = {order}").replace("samples = 256", f"samples = {samples}")
        frequency, kind = read(solve(text, tmp_path), "tones_frequency", "curve_kind")
        assert frequency[kind == GRAZE][-1] == pytest.approx(shooting.graze(), rel=1e-9)
        assert frequency[kind == FOLD] == pytest.approx([upper, lower], rel=tolerance)
        assert frequency[kind == FOLD][1] == pytest.approx(lower, rel=1e-9)


@pytest.mark.long
def test_coexisting_motions_of_the_rotor_are_reported(tmp_path):
    """At 1.3 rad/s: two whirls in permanent contact with the ring, one without contact, two tori; integration ends in the latter
    whirl and in a torus."""
    text = (INPUTS / "gallery" / "jeffcott_torus.nml").read_text(encoding="utf-8")
    (tmp_path / "rotor.nml").write_text(text)
    done = run("solve", "rotor.nml", cwd=tmp_path)
    assert done.status in (ALL_CONVERGED, NOT_ALL_CONVERGED)
    (torus,) = tmp_path.glob("rotor_*.h5")  # beyond the fold tones 6e-4 rad/s apart, less than their error, are no torus
    assert "no torus was found beyond" in done.stdout
    assert "of the frequency of an unknown tone: " in done.stdout
    assert "of an unknown frequency (limit 0.01)" in " ".join(run("why", torus, cwd=tmp_path).stdout.split())
    with Results(tmp_path / "rotor.h5") as results:
        there = np.flatnonzero((results.curve.values == 1.3) & (results.curve_kind() == "value"))
        assert [int(stable) for stable in results.per_point("is_stable")[there]] == [-1, -1, 1]
        free = results.amplitude(there[-1], "x", (1,))
    with Results(torus) as results:
        there = np.flatnonzero((results.curve.values == 1.3) & (results.curve_kind() == "value"))
        assert len(there) == 2
        bouncing = results.amplitude(there[0], "x", (1, 0))
    lines = [line for line in text.splitlines() if not line.startswith(("&curve", "   torus_order"))]
    (tmp_path / "integration.nml").write_text("\n".join(lines).replace("frequency = 0.7", "frequency = 1.3") + "\n")
    starts = ("integration%starts=12", "integration%transient=600.0", "integration%duration=600.0")
    settings = [word for key in starts for word in ("--set", key)]
    done = run("integrate", "integration.nml", "-o", "integration.h5", *settings, cwd=tmp_path)
    assert "2 motions" in done.stdout, done.stdout + done.stderr
    integrated, spread = read(tmp_path / "integration.h5", "motion_coefficients", "motion_spread")
    amplitudes = np.hypot(*np.moveaxis(integrated[:, 0, 1], -1, 0))
    assert amplitudes == pytest.approx([free, bouncing], rel=1e-2)
    assert amplitudes[0] == pytest.approx(free, rel=1e-6) and amplitudes[0] == pytest.approx(0.48138576, rel=1e-6)


PULL_IN = """
&structure type='matrices', n_dofs=2, mass=1.335850528071076, 0.0, 0.0, 1.2423682030671896, damping=0.699025056748461,
   -0.13918290291846383, -0.13918290291846383, 0.7014882245671656, stiffness=2185.66564554204, -1021.5319858988503,
   -1021.5319858988503, 2409.8217478215856 /
&tones frequency=25.535768910465848 /
&law type='electrostatic', dof='x1', coefficient=1.0, gap=1.6095735273883292, voltage=4.173322132310994, tuple=1,
   voltage_cos=-0.4367629547375046 /
&load dof='x2', tuple=1, cos=213.04514463579238 /
&accuracy tolerance=1e-3 /
"""


@pytest.mark.long
def test_errors_of_a_huge_multiplier_are_no_bifurcations(tmp_path):
    """Next to pull-in the largest multiplier is 1e8, and errors of the matrix move others across the unit circle."""
    curve = "&curve parameter='tones%frequency', from=18.78855565779982, to=59.49709291636609, points=200 /\n"
    (tmp_path / "pull_in.nml").write_text(PULL_IN + curve)
    done = run("solve", "pull_in.nml", cwd=tmp_path)
    assert "fold    at tones%frequency = 25.2961" in done.stdout
    assert "no bifurcation was located" not in done.stdout
    real, n_unstable = read(tmp_path / "pull_in.h5", "multiplier_real", "n_unstable")
    assert np.all(n_unstable[real[:, 0] < -1e8] == 1)


@pytest.mark.long
def test_a_fold_is_followed_from_beside_huge_multipliers(tmp_path):
    """The search for bifurcations among such errors ended neither here nor within 30 s."""
    curve = "&curve parameter='load(1)%cos', from=213.04514463579238, to=300.0, follow='fold', over='tones%frequency',\n"
    curve += "over_from=18.78855565779982, over_to=59.49709291636609 /\n"
    (tmp_path / "fold.nml").write_text(PULL_IN + curve)
    done = run("solve", "fold.nml", "--time-limit", "25", cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "end     at load(1)%cos = 300.0 N" in done.stdout, done.stdout + done.stderr
