"""`nhbm integrate` of motions without a period: free ones, and under loads that begin, end or change their frequency."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray
from scipy.integrate import solve_ivp

from integrations import DECAY, FORCED, INPUTS, MASS, METHODS, decay, integration
from nhbm_post import integration as post_integration
from nhbm_post.errors import ReaderError
from program import BAD_INPUT, read, run

PUSHED = DECAY + "&initial dof='x1', displacement=0.02, velocity=-0.1 /\n"


@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_free_decay_without_a_tone(tmp_path, method, tolerance):
    record = integration(PUSHED + f"&integration duration=60, step=0.01, method='{method}', tolerance=1e-13 /", tmp_path)
    t, x = read(record, "time", "displacement")
    np.testing.assert_allclose(x[0], decay(t, 0.02, -0.1), atol=0.054 * tolerance)
    assert "tones" not in post_integration.info(record)
    with pytest.raises(ReaderError, match="has no harmonics"):
        post_integration.read_series(record, "x1")


def test_a_velocity_is_that_of_an_impulse(tmp_path):
    """Momentum of the second of three free masses: the centre moves with a third of its velocity."""
    chain = "&structure type='chain', n_masses=3, mass=1, coupling_stiffness=5, ends='free' /\n&law type='cubic_spring', "
    chain += "dofs='x1', 'x2', weights=1, -1, stiffness=7 /\n&initial dof='x2', velocity=3 /\n"
    chain += "&integration duration=5, step=0.1, tolerance=1e-13 /"
    t, x = read(integration(chain, tmp_path), "time", "displacement")
    np.testing.assert_allclose(x.mean(axis=0), t, atol=1e-9)


def test_initial_states_are_added(tmp_path):
    """To a motion under a load and to the end of a record: the free motion is superposed."""
    forced = DECAY + "&tones frequency=1.3 /\n&harmonics order=1 /\n&load dof='x1', tuple=1, cos=0.4 /\n"
    rest = integration(forced + "&integration duration=30, step=0.1, tolerance=1e-13 /", tmp_path, name="rest")
    pushed = "&initial dof='x1', displacement=0.02 /\n&initial dof='x1', velocity=-0.1 /\n"
    first = integration(forced + pushed + "&integration duration=10, step=0.1, tolerance=1e-13 /", tmp_path, name="first")
    t, x = read(first, "time", "displacement")
    np.testing.assert_allclose(x[0] - read(rest, "displacement")[0, :101], decay(t, 0.02, -0.1), atol=1e-9)
    integration(forced + "&integration duration=10, step=0.1, tolerance=1e-13 /", tmp_path, name="calm")
    kicked = integration(forced + pushed + "&integration duration=20, step=0.1, continue='calm.h5' /", tmp_path, name="kicked")
    x = read(kicked, "displacement")[0] - read(rest, "displacement")[0, 100:]
    np.testing.assert_allclose(x, decay(0.1 * np.arange(201), 0.02, -0.1), atol=1e-9)


def test_check_says_that_a_model_without_tones_is_integrated(tmp_path):
    (tmp_path / "free.nml").write_text(PUSHED + "&integration duration=60, step=0.01 /")
    done = run("check", "free.nml", cwd=tmp_path)
    assert done.status == 0 and "tones       none" in done.stdout and "warning" not in done.stdout
    assert "valid for nhbm integrate alone: missing tones" in done.stdout
    for verb in ("solve", "plan", "census"):
        done = run(verb, "free.nml", cwd=tmp_path)
        assert done.status == BAD_INPUT and "free.nml: missing group &tones" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PUSHED + "&integration duration=60 /", "missing integration%step"),
        (PUSHED + "&integration duration=60, step=0.1, starts=2 /", "integration%starts must be 1: other starts"),
        (PUSHED + "&harmonics order=3 /\n&integration duration=60, step=0.1, tolerance=1e-13 /", "no harmonics without &tones"),
        (PUSHED + "&load dof='x1', tuple=1, cos=1 /\n&integration duration=6, step=0.1 /", "no &tones, to which a tuple refers"),
        (DECAY + "&initial dof='x1' /\n&integration duration=6, step=0.1 /", "bad.nml:2: &initial: displacement: give"),
        (DECAY + "&initial dof='x2', velocity=1 /\n&integration duration=6, step=0.1 /", "bad.nml:2: &initial: dof"),
    ],
)
def test_free_motions_that_are_incomplete(tmp_path, text, words):
    (tmp_path / "bad.nml").write_text(text)
    done = run("integrate", "bad.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and words in done.stderr, done.stderr


HALF = "begin=1.5, end=4"


def under(force, edges, t, rest=(0.0, 0.0)):
    """Motion of DECAY under a force, by SciPy between the times at which it jumps."""
    times, state, x = [0.0, *edges, t[-1]], rest, np.zeros(len(t))
    for start, stop in zip(times[:-1], times[1:]):
        inside = (t >= start) & (t <= stop)

        def rates(s, y, middle=(start + stop) / 2):
            return [y[1], force(s, middle) - 0.1 * y[1] - 4 * y[0]]

        found = solve_ivp(rates, (start, stop), state, "DOP853", rtol=1e-12, atol=1e-14, dense_output=True)
        x[inside], state = found.sol(t[inside])[0], found.y[:, -1]
    return x


@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_a_pulse_leaves_two_steps(tmp_path, method, tolerance):
    """Responses to a step at the begin, and to its negative at the end."""

    def step(t):
        w = np.sqrt(4 - 0.05**2)
        return np.where(t < 0, 0, 0.25 * (1 - np.exp(-0.05 * t) * (np.cos(w * t) + 0.05 / w * np.sin(w * t))))

    text = DECAY + f"&load dof='x1', cos=0.8, {HALF} /\n&integration duration=20, step=0.01, method='{method}', tolerance=1e-13 /"
    t, x = read(integration(text, tmp_path), "time", "displacement")
    np.testing.assert_allclose(x[0], 0.8 * (step(t - 1.5) - step(t - 4)), atol=0.4 * tolerance)


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [("cvode", 1e-9), ("runge_kutta_4", 5e-5), ("central_differences", 7e-4), ("generalized_alpha", 1.4e-3)],
)
def test_edges_of_a_pulse_within_a_step_count_with_their_share(tmp_path, method, tolerance):
    text = DECAY + "&load dof='x1', cos=0.8, begin=1.5037, end=3.9989 /\n"
    text += f"&integration duration=20, step=0.01, method='{method}', tolerance=1e-13 /"
    t, x = read(integration(text, tmp_path), "time", "displacement")
    expected = under(lambda s, middle: 0.8 * (1.5037 < middle < 3.9989), [1.5037, 3.9989], t)
    np.testing.assert_allclose(x[0], expected, atol=0.4 * tolerance)


@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_a_burst_of_a_tone_keeps_its_phase(tmp_path, method, tolerance):
    text = DECAY + f"&tones frequency=3 /\n&harmonics order=1 /\n&load dof='x1', tuple=1, cos=0.8, sin=-0.5, {HALF} /\n"
    text += f"&load dof='x1', tuple=1, cos=0.1 /\n&integration duration=20, step=0.01, method='{method}', tolerance=1e-13 /"
    t, x = read(integration(text, tmp_path), "time", "displacement")
    expected = under(
        lambda s, middle: (0.8 * np.cos(3 * s) - 0.5 * np.sin(3 * s)) * (1.5 < middle < 4) + 0.1 * np.cos(3 * s), [1.5, 4], t
    )
    np.testing.assert_allclose(x[0], expected, atol=0.4 * tolerance)


def phase_of(chirp, s):
    """Phase, frequency and its rate of a chirp from 0.5 to 5 rad/s in 30 s."""
    if chirp == "linear":
        return 0.5 * s + 0.075 * s**2, 0.5 + 0.15 * s, 0.15 + 0 * s
    rate = np.log(10.0) / 30
    return 0.5 / rate * np.expm1(rate * s), 0.5 * np.exp(rate * s), 0.5 * rate * np.exp(rate * s)


@pytest.mark.parametrize("chirp", ["linear", "exponential"])
@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_a_chirp_through_resonance(tmp_path, chirp, method, tolerance):
    text = DECAY + "&load dof='x1', cos=0.3, sin=0.2, begin=2, end=32, frequency=0.5, end_frequency=5, "
    text += f"chirp='{chirp}' /\n&integration duration=40, step=0.01, method='{method}', tolerance=1e-13 /"
    t, x = read(integration(text, tmp_path), "time", "displacement")

    def force(s, middle):
        phase = phase_of(chirp, s - 2)[0]
        return (0.3 * np.cos(phase) + 0.2 * np.sin(phase)) * (2 < middle < 32)

    np.testing.assert_allclose(x[0], under(force, [2, 32], t), atol=tolerance)


@pytest.mark.parametrize("chirp", ["linear", "exponential"])
def test_an_unbalance_that_runs_up_accelerates(tmp_path, chirp):
    """-d2/dt2 of m e cos(phi), the acceleration of the angle included."""
    text = DECAY + "&load dof='x1', cos=0.3, end=30, frequency=0.5, end_frequency=5, frequency_power=2, "
    text += f"chirp='{chirp}' /\n&integration duration=30, step=0.1, tolerance=1e-13 /"
    t, x = read(integration(text, tmp_path), "time", "displacement")

    def force(s, middle):
        phase, rate, acceleration = phase_of(chirp, s)
        return 0.3 * (rate**2 * np.cos(phase) + acceleration * np.sin(phase))

    np.testing.assert_allclose(x[0], under(force, [], t), atol=1e-8)


def test_a_base_that_is_pushed(tmp_path):
    text = DECAY.replace("mass=1", "mass=2").replace("damping=0.1", "damping=0.2").replace("stiffness=4", "stiffness=8")
    text += "&load dof='x1', sin=0.7, kind='base_acceleration', begin=1, end=2, frequency=3.141592653589793 /\n"
    t, x = read(integration(text + "&integration duration=10, step=0.1, tolerance=1e-13 /", tmp_path), "time", "displacement")
    expected = under(lambda s, middle: -0.7 * np.sin(np.pi * (s - 1)) * (1 < middle < 2), [1, 2], t)
    np.testing.assert_allclose(x[0], expected, atol=1e-9)


def test_a_load_that_ends_releases_a_mass_from_a_wall(tmp_path):
    """Pressed against a rigid wall without a motion, the mass swings back freely after the load has ended."""
    text = DECAY + "&law type='rigid_wall', dof='x1', gap=0.1 /\n&initial dof='x1', displacement=0.1 /\n"
    text += "&load dof='x1', cos=2, end=3.05 /\n&integration duration=4, step=0.1, tolerance=1e-13 /"
    t, x, f = read(integration(text, tmp_path), "time", "displacement", "force")
    np.testing.assert_allclose(f[0, t < 3.05], 1.6, rtol=1e-9)
    np.testing.assert_allclose(x[0, t < 3.05], 0.1, rtol=1e-12)
    after = t > 3.05
    np.testing.assert_allclose(x[0, after], decay(t[after] - 3.05, 0.1, 0.0), atol=1e-10)


BURST = "&load dof='x1', tuple=1, cos=1, end=3 /\n"


@pytest.mark.parametrize(
    ("verb", "more"),
    [
        ("solve", ""),
        ("solve", "&sweep parameter='law(1)%stiffness', values=1, 2 /\n"),
        ("solve", "&curve parameter='tones%frequency', from=1, to=2 /\n"),
        ("plan", ""),
        ("census", ""),
    ],
)
def test_a_balance_has_no_loads_over_time(tmp_path, verb, more):
    (tmp_path / "burst.nml").write_text(FORCED + BURST + more)
    done = run(verb, "burst.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and "burst.nml:6: &load(2): end: a load that begins, ends" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("begin=2, end=1", "end: must be later"),
        ("frequency=1, tuple=1", "frequency: give either 'tuple' or 'frequency'"),
        ("frequency=1, end_frequency=3", "end_frequency: needs"),
        ("tuple=1, end=3, end_frequency=3", "end_frequency: needs"),
        ("frequency=0, end=3, end_frequency=3, chirp='exponential'", "chirp: 'exponential' needs"),
        ("tuple=1, end=3, kind='base_displacement'", "kind: a base that jumps"),
    ],
)
def test_loads_over_time_that_contradict_themselves(tmp_path, keys, words):
    (tmp_path / "bad.nml").write_text(MASS + f"&load dof='x1', cos=1, {keys} /\n&integration duration=1 /")
    done = run("integrate", "bad.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and "bad.nml:4: &load: " + words in done.stderr, done.stderr


LARGEST = re.compile(r"^! expect: largest (\w+) = (\S+) to (\S+)$", re.MULTILINE)


@pytest.mark.parametrize("source", sorted((INPUTS / "time").glob("*.nml")), ids=lambda source: source.stem)
def test_inputs_of_time_give_what_they_promise(tmp_path, source):
    promises = LARGEST.findall(source.read_text())
    assert promises
    with xarray.open_dataset(integration(source, tmp_path)) as data:
        for dof, value, tolerance in promises:
            assert float(abs(data.displacement.sel(dof=dof)).max()) == pytest.approx(float(value), rel=float(tolerance)), dof
