"""`nhbm integrate`: the record, and the agreement of time integration and balance in cases with known numbers."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from scipy.integrate import solve_ivp

from nhbm_post import integration as post_integration
from nhbm_post.errors import ReaderError
from program import BAD_INPUT, NOT_ALL_CONVERGED, checksum_of_row, read, run, solve

INPUTS = Path(__file__).resolve().parents[2] / "inputs"

MASS = "&structure type='matrices', n_dofs=1, mass=1, damping=0.1, stiffness=1 /\n&tones frequency=1.3 /\n&harmonics order=3 /\n"
FREE = "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones frequency=1 /\n&harmonics order=1 /\n"
VAN_DER_POL = (
    "&structure type='matrices', n_dofs=1, mass=1, stiffness=1 /\n&tones unknown=.true. /\n"
    "&harmonics order=9, odd_only=.true. /\n&law type='van_der_pol', dof='x1', strength=1 /\n"
)
FORCED = MASS + "&load dof='x1', tuple=1, cos=0.4 /\n&law type='cubic_spring', dof='x1', stiffness=0.5 /\n"


def integration(text: str | Path, folder: Path, *options, name="integration", status=0) -> Path:
    """Integrates an input, given as text or as a file, and returns the record."""
    source = text
    if isinstance(text, str):
        source = folder / f"{name}.nml"
        source.write_text(text)
    record = folder / f"{name}.h5"
    done = run("integrate", source, "-o", record, "--overwrite", "--quiet", *options, cwd=folder)
    assert done.status == status, done.stderr
    return record


def test_the_largest_lines_of_the_spectrum_are_printed(tmp_path):
    (tmp_path / "case.nml").write_text(FORCED + "&integration duration=200, n_peaks=1 /\n")
    said = run("integrate", "case.nml", cwd=tmp_path).stdout
    found = re.search(r"^largest lines of x1, frequency \[rad/s\] \(amplitude\): (\S+) \((\S+)\)$", said, re.MULTILINE)
    assert found, said
    frequency, amplitude = read(tmp_path / "case.h5", "peak_frequency", "peak_coefficients")
    assert float(found[1]) == pytest.approx(frequency[0, 0], rel=1e-6)
    assert float(found[2]) == pytest.approx(np.hypot(*amplitude[0, 0]), rel=0.1)


def coefficient(record: Path, *j: int, dof: int = 0) -> np.ndarray:
    """(cos, sin) of a tuple."""
    tuples, values = read(record, "tuple", "coefficients")
    return values[dof, tuples.tolist().index(list(j))]


def balance_at(result: Path, point: int, dof: str, t: np.ndarray) -> np.ndarray:
    """Motion of a result file at given times."""
    with h5py.File(result) as file:
        frequencies = file["tuple"][()] @ file["frequency"][point]
        pairs = file["coefficients"][point, file["dof"].asstr()[()].tolist().index(dof)]
    known = ~np.isnan(pairs[:, 0])
    phases = np.outer(t, frequencies[known])
    return np.cos(phases) @ pairs[known, 0] + np.sin(phases) @ pairs[known, 1]


def difference(record: Path, result: Path, point: int, dof: str) -> np.ndarray:
    with h5py.File(record) as file:
        t, labels, x = file["time"][()], file["dof"].asstr()[()].tolist(), file["displacement"][()]
    return x[labels.index(dof)] - balance_at(result, point, dof, t)


def largest_motion(record: Path) -> float:
    """Largest |x| of a record, between samples by the cubic through displacements and velocities."""
    t, x, v = read(record, "time", "displacement", "velocity")
    x, v, h = np.abs(x[0]), v[0] * np.sign(x[0]), t[1] - t[0]
    k = int(np.argmax(x[1:-1])) + 1
    s = np.linspace(0.0, 1.0, 20001)
    tops = []
    for i in (k - 1, k):
        cubic = (
            (1 + 2 * s) * (1 - s) ** 2 * x[i]
            + s * (1 - s) ** 2 * h * v[i]
            + s**2 * (3 - 2 * s) * x[i + 1]
            + s**2 * (s - 1) * h * v[i + 1]
        )
        tops.append(cubic.max())
    return max(tops)


# The record


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_record_opens_in_xarray_with_names_and_units(tmp_path, engine):
    record = integration(FORCED + "&integration duration=20, step=0.1, decimation=4, n_peaks=2 /", tmp_path)
    with xarray.open_dataset(record, engine=engine) as data:
        assert data.displacement.dims == ("dof", "time") and data.displacement.shape == (1, 51)
        assert data.coefficients.dims == ("dof", "harmonic", "component")
        assert data.force.dims == ("law_coordinate", "time")
        assert data.peak_frequency.dims == ("dof", "peak")
        assert data.attrs["kind"] == "integration" and data.attrs["method"] == "cvode"
        assert data.displacement.attrs["units"] == "m" and data.velocity.attrs["units"] == "m/s"
        for name, variable in data.variables.items():
            assert variable.attrs.get("long_name"), name
            assert "units" in variable.attrs or variable.dtype.kind in "mM", name
        assert 0.0 < data.cpu_seconds < 10.0
        np.testing.assert_allclose(data.time, 0.4 * np.arange(51), rtol=1e-13)
        np.testing.assert_allclose(data.force[0], 0.5 * data.displacement[0] ** 3, atol=1e-15)


@pytest.mark.parametrize("method", ["cvode", "runge_kutta_4", "central_differences", "generalized_alpha"])
def test_continued_record_is_the_whole_one(tmp_path, method):
    law = "&law type='jenkins', dof='x1', stiffness=1, limit=0.2 /\n"
    rest = f"&integration step=0.05, method='{method}', tolerance=1e-12, "
    whole = integration(FORCED + law + rest + "duration=40 /", tmp_path, name="whole")
    integration(FORCED + law + rest + "duration=17 /", tmp_path, name="first")
    second = integration(FORCED + law + rest + "duration=23, continue='first.h5' /", tmp_path, name="second")
    # cvode chooses its steps again, and generalized_alpha starts with accelerations of equilibrium
    tolerance = {"cvode": 1e-9, "generalized_alpha": 1e-4}.get(method, 1e-12)
    assert read(second, "time")[0] == pytest.approx(17.0, rel=1e-12)
    np.testing.assert_allclose(read(second, "displacement")[0], read(whole, "displacement")[0, 340:], atol=tolerance)
    np.testing.assert_allclose(read(second, "state_slider"), read(whole, "state_slider"), atol=tolerance)


def test_a_record_says_what_it_holds(tmp_path):
    duffing = MASS.replace("damping=0.1", "damping=0.05").replace("frequency=1.3", "frequency=1.5")
    duffing += "&load dof='x1', tuple=1, cos=0.3 /\n&law type='cubic_spring', dof='x1', stiffness=1 /\n"
    record = integration(duffing + "&integration duration=60, transient=400, starts=8 /", tmp_path)
    starts = read(record, "start_motion")
    lines = post_integration.info(record).splitlines()
    assert [line.split()[:5] for line in lines if line.startswith("motion")] == [
        ["motion", str(k), "from", str(np.sum(starts == k)), "of"] for k in (1, 2)
    ]
    largest = np.abs(read(record, "displacement")).max()
    assert f"largest    {largest:.4g} at x1" in lines
    told = run("info", record, cwd=tmp_path)
    assert told.status == BAD_INPUT
    assert "it is a record of integration" in told.stderr


@pytest.mark.long  # seconds
def test_several_motions_are_the_same_on_any_number_of_ranks(tmp_path):
    """Both motions of a hardening spring, by nhbm integrate and by points with time integration as primary method: the same
    bits."""
    model = MASS.replace("frequency=1.3", "frequency=1.5")
    model += "&load dof='x1', tuple=1, cos=0.4 /\n&law type='cubic_spring', dof='x1', stiffness=1 /\n"
    model += "&integration duration=60, transient=150, starts=6 /\n"
    points = model + "&solver primary_method='integration' /\n&sweep parameter='tones%frequency(1)', values=1.5, 1.55 /\n"
    (tmp_path / "integrate.nml").write_text(model)
    (tmp_path / "solve.nml").write_text(points)
    for verb in ("integrate", "solve"):
        for ranks in (None, 2):
            done = run(verb, f"{verb}.nml", "-o", f"{verb}_{ranks}.h5", cwd=tmp_path, ranks=ranks)
            assert done.status == 0, done.stderr
    names = ("start_motion", "motion_coefficients", "coefficients", "displacement", "spread")
    for one, two in zip(*(read(tmp_path / f"integrate_{ranks}.h5", *names) for ranks in (None, 2))):
        assert one.tobytes() == two.tobytes()
    assert set(read(tmp_path / "integrate_2.h5", "start_motion")) == {1, 2}
    names = ("status", "n_motions", "message_byte", "coefficients", "truncation_estimate", "n_unknowns")
    for one, two in zip(*(read(tmp_path / f"solve_{ranks}.h5", *names) for ranks in (None, 2))):
        assert one.tobytes() == two.tobytes()
    assert read(tmp_path / "solve_2.h5", "n_motions").tolist() == [2, 2]


def test_progress_of_a_short_integration_is_one_line(tmp_path):
    (tmp_path / "a.nml").write_text(FORCED + "&integration duration=100, step=0.01, method='runge_kutta_4' /")
    done = run("integrate", "a.nml", cwd=tmp_path)
    assert [line.split()[0] for line in done.stderr.splitlines() if "steps" in line] == ["10000/10000"]


def test_forced_mass_is_that_of_the_balance(tmp_path):
    record = integration(FORCED + "&integration duration=400, transient=600, step=0.02, tolerance=1e-14 /", tmp_path)
    result = solve(FORCED.replace("order=3", "order=15"), tmp_path)
    assert np.abs(difference(record, result, 0, "x1")).max() < 1e-11
    assert read(record, "spread").max() < 1e-9


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FORCED, ": &integration: missing key 'duration', which needs a real number [s]"),
        (FORCED + "&integration duration=1, method='runge_kutta4' /", "did you mean 'runge_kutta_4'"),
        (FORCED + "&integration duration=1, continue='none.h5' /", "none.h5"),
        (
            FORCED + "&integration duration=1, method='runge_kutta_4' /\n&law type='rigid_wall', dof='x1', gap=1 /",
            "does not support rigid walls",
        ),
        (
            FORCED + "&integration duration=1 /\n"
            "&law type='contact_table', contact='rigid', dofs='x1', n_contacts=1, shapes=-1, gaps=1 /",
            "no method of &integration supports rigid contacts",
        ),
        (FORCED + "&integration duration=1e12 /", "at most 2147483647 can be counted"),
        (FORCED + "&integration duration=2e7, transient=1e20 /", "at most 2147483647 can be counted"),
        (
            "&structure type='chain', n_masses=1000, mass=1, coupling_stiffness=1 /\n&tones frequency=1 /\n"
            "&harmonics order=1 /\n&integration duration=2e9, step=1 /",
            "more than available",
        ),
        (
            "&structure type='matrices', n_dofs=1, mass=1, stiffness=0 /\n&tones unknown=.true. /\n&harmonics order=1 /\n"
            "&law type='van_der_pol', dof='x1', strength=1 /\n&integration duration=10 /\n",
            "give first guesses of the frequencies in &tones",
        ),
        (
            FORCED + "&integration duration=10 /\n&sweep parameter='law(1)%stiffness', values=1,2 /",
            "points 0 to 1; integrate takes one",
        ),
    ],
)
def test_what_cannot_be_integrated_is_said(tmp_path, text, words):
    source = tmp_path / "bad.nml"
    source.write_text(text)
    done = run("integrate", source, cwd=tmp_path)
    assert done.status == BAD_INPUT and words in done.stderr, done.stderr
    assert not (tmp_path / "bad.h5").exists()


def test_record_of_another_model_is_refused(tmp_path):
    integration(FORCED + "&integration duration=10 /", tmp_path, name="first")
    two = "&structure type='chain', n_masses=2, mass=1, coupling_stiffness=1 /\n&tones frequency=1 /\n&harmonics order=1 /\n"
    source = tmp_path / "second.nml"
    source.write_text(two + "&integration duration=10, continue='first.h5' /")
    done = run("integrate", source, cwd=tmp_path)
    assert done.status == BAD_INPUT and "record of another model" in done.stderr


def test_point_of_a_sweep_is_followed(tmp_path):
    swept = FORCED + "&sweep parameter='law(1)%stiffness', values=0.5, 2 /\n&integration duration=10, step=0.1 /"
    second = integration(swept, tmp_path, "--point", "1", name="swept")
    stiffer = FORCED.replace("stiffness=0.5", "stiffness=2")
    alone = integration(stiffer + "&integration duration=10, step=0.1 /", tmp_path, name="alone")
    np.testing.assert_array_equal(read(second, "displacement"), read(alone, "displacement"))


# Free motions


DECAY = "&structure type='matrices', n_dofs=1, mass=1, damping=0.1, stiffness=4 /\n"
# Steps of 0.01 at 2 rad/s: phase errors of (h w)^4/120 and (h w)^2/24 a radian over the decay time, 40 rad; twice that of the last.
METHODS = [("cvode", 1e-9), ("runge_kutta_4", 6e-8), ("central_differences", 7e-4), ("generalized_alpha", 1.4e-3)]
PUSHED = DECAY + "&initial dof='x1', displacement=0.02, velocity=-0.1 /\n"


def decay(t, x0, v0):
    """Free motion of DECAY."""
    w = np.sqrt(4 - 0.05**2)
    return np.exp(-0.05 * t) * (x0 * np.cos(w * t) + (v0 + 0.05 * x0) / w * np.sin(w * t))


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
    assert "valid for nhbm integrate alone: missing group &tones" in done.stdout
    for verb in ("solve", "plan", "census"):
        done = run(verb, "free.nml", cwd=tmp_path)
        assert done.status == BAD_INPUT and "free.nml: missing group &tones" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PUSHED + "&integration duration=60 /", "&integration: missing key 'step'"),
        (PUSHED + "&integration duration=60, step=0.1, starts=2 /", "&integration starts: other starts"),
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


# Loads over time

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


# Unknown tones


def test_unknown_tone_without_a_guess_is_read_from_the_record(tmp_path):
    text = VAN_DER_POL + "&start dof='x1', tuple=1, cos=1 /\n"
    text += "&integration start='given', transient=100, duration=400, tolerance=1e-12 /"
    record = integration(text, tmp_path)
    assert 2 * np.pi / read(record, "frequency")[0] == pytest.approx(6.6632868593231361, rel=1e-9)
    assert read(record, "spread").max() < 1e-8


def test_record_without_a_tone_of_its_own_says_so(tmp_path):
    source = tmp_path / "rest.nml"
    source.write_text(VAN_DER_POL + "&integration duration=50 /")
    done = run("integrate", source, cwd=tmp_path)
    assert done.status == 0 and "no tone of its own" in done.stdout, done.stderr


# Known motions


@pytest.mark.parametrize(
    ("strength", "period"), [(1, 6.6632868593231361), pytest.param(5, 11.6122306677196, marks=pytest.mark.long)]
)
def test_van_der_pol_has_its_period(tmp_path, strength, period):
    text = f"&law type='van_der_pol', dof='x1', strength={strength} /\n&start dof='x1', tuple=1, cos=2 /\n"
    group = "&integration start='given', transient=100, duration=1000, step=0.02, tolerance=1e-13, n_peaks=1 /"
    record = integration(FREE + text + group, tmp_path)
    assert 2 * np.pi / read(record, "peak_frequency")[0, 0] == pytest.approx(period, rel=1e-10)


def test_elastic_stop_under_two_tones(tmp_path):
    record = integration(INPUTS / "gallery" / "elastic_stop_two_tones.nml", tmp_path, "--point", 0)
    spread = read(record, "spread").max()
    assert spread < 2e-9
    for j, cosine, sine in [
        ((0, 0), -0.20334727152247, 0.0),
        ((1, 0), 0.62198242428873, 0.23632950152279),
        ((0, 1), -0.34135917761406, 0.13342729526516),
        ((1, -1), 0.17872615537078, 0.12571711125539),
        ((1, 1), -0.04362872589981, 0.01274249426881),
        ((2, 0), 0.07982706095386, 0.05150941687052),
        ((2, -1), 0.00810698665249, 0.04650284834983),
        ((3, 0), 0.01029472996623, 0.01959629382110),
    ]:
        np.testing.assert_allclose(coefficient(record, *j), (cosine, sine), atol=spread)


@pytest.mark.long
def test_elastic_stop_under_two_tones_to_eleven_digits(tmp_path):
    source = INPUTS / "gallery" / "elastic_stop_two_tones.nml"
    settings = ("--set", "integration%duration=40000", "--set", "integration%decimation=2000")
    record = integration(source, tmp_path, "--point", 0, *settings)
    np.testing.assert_allclose(coefficient(record, 0, 0), (-0.20334727152247, 0.0), atol=1e-11)
    np.testing.assert_allclose(coefficient(record, 1, 0), (0.62198242428873, 0.23632950152279), atol=1e-11)
    np.testing.assert_allclose(coefficient(record, 2, -1), (0.00810698665249, 0.04650284834983), atol=1e-11)


def test_jenkins_under_one_tone(tmp_path):
    record = integration(INPUTS / "gallery" / "jenkins_one_tone.nml", tmp_path, "--point", 0)
    np.testing.assert_allclose(coefficient(record, 1), (0.54763692209715, 0.37563080515507), atol=2e-11)
    np.testing.assert_allclose(coefficient(record, 3), (-0.00129227974560, -0.00444845581864), atol=2e-11)


@pytest.mark.long
def test_jenkins_under_two_tones(tmp_path):
    record = integration(INPUTS / "gallery" / "jenkins_two_tones.nml", tmp_path, "--point", 0)
    np.testing.assert_allclose(coefficient(record, 1, 0), (0.480722, 0.319828), atol=1e-6)
    np.testing.assert_allclose(coefficient(record, 0, 1), (-0.537212, 0.351565), atol=1e-6)
    assert np.hypot(*coefficient(record, 2, -1)) == pytest.approx(0.1155478, abs=1e-7)
    assert np.hypot(*coefficient(record, 3, 0)) == pytest.approx(0.0045035, abs=1e-7)


@pytest.mark.parametrize(("point", "amplitude"), [(0, 2.62610487572), (1, 0.721110255093)])
def test_den_hartog_motion_without_stops(tmp_path, point, amplitude):
    """Rigid friction: the direction changes at an event, and without other damping the transient decays slowly."""
    record = integration(INPUTS / "gallery" / "den_hartog.nml", tmp_path, "--point", point)
    assert largest_motion(record) == pytest.approx(amplitude, rel=1e-9 if point else 1e-7)


@pytest.mark.long
def test_figure_4_difference_between_integration_and_balance(tmp_path):
    source = INPUTS / "paper" / "figure4.nml"
    result = tmp_path / "balance.h5"
    done = run("solve", source, "-o", result, "--quiet", cwd=tmp_path)
    assert done.status == 0, done.stderr
    record = integration(source, tmp_path, "--point", 0)
    assert np.abs(difference(record, result, 0, "v3")).max() < 1e-14  # the paper claims 1e-14 m of 2.4e-3 m
    record = integration(source, tmp_path, "--point", 2)
    largest = np.abs(difference(record, result, 2, "v3")).max()
    assert 1e-8 < largest < 3e-7  # what order 7 leaves out at 1e10 N/m3


@pytest.mark.long
def test_figure_7_difference_falls_with_the_order(tmp_path):
    source = INPUTS / "paper" / "wall.nml"
    result = tmp_path / "balance.h5"
    done = run("solve", source, "-o", result, "--quiet", cwd=tmp_path)
    assert done.status in (0, 4), done.stderr
    record = integration(source, tmp_path, "--point", 3)
    errors = [np.sqrt(np.mean(difference(record, result, point, "v3") ** 2)) for point in range(4)]
    np.testing.assert_allclose(errors, [2.093e-5, 1.098e-5, 6.481e-6, 4.636e-6], rtol=2e-3)
    assert np.abs(difference(record, result, 3, "v3")).max() == pytest.approx(4.159e-5, rel=2e-3)
    events = integration(source, tmp_path, "--point", 3, "--set", "integration%method='cvode'", "--set", "integration%step=1e-3",
                         "--set",
                   "integration%decimation=1", name="events")
    middle = 3  # v3 among the eight degrees of freedom
    apart = read(events, "displacement")[middle] - read(record, "displacement")[middle]
    assert np.abs(apart).max() < 1e-8


# From a point of a result


def verified(result: Path, *options, status=0) -> dict[str, np.ndarray]:
    done = run("verify", result, *options, cwd=result.parent)
    assert done.status == status, done.stderr + done.stdout
    names = ("integration_verdict", "integration_first_difference", "integration_difference", "integration_growth")
    return dict(zip(names, read(result, *names)))


AGREES, UNSTABLE, DIFFERS, UNDECIDED = 1, 2, 3, 4
CONVERGED_CUBIC = FORCED.replace("order=3", "order=15")


def test_verify_agrees_with_a_converged_motion(tmp_path):
    found = verified(solve(CONVERGED_CUBIC, tmp_path))
    assert found["integration_verdict"] == [AGREES]
    assert found["integration_difference"][0] < 1e-9


def test_verify_integrates_again_what_was_integrated_with_a_set_of_its_own(tmp_path):
    """Ueda's oscillator without a balance: the file has as many elements as its largest set, the first point uses six of ten."""
    text = "&structure type='matrices', n_dofs=1, mass=1, damping=0.1, stiffness=0 /\n&tones frequency=1 /\n&harmonics order=9 /\n"
    text += "&load dof='x1', tuple=1, cos=1 /\n&law type='cubic_spring', dof='x1', stiffness=1 /\n"
    text += "&solver max_iterations=0, homotopy_iterations=0 /\n&sweep parameter='harmonics%order', values=5, 9 /\n"
    result = solve(text, tmp_path, status=None)
    assert (read(result, "status")[0] == 18).all()  # integrated
    assert (verified(result)["integration_verdict"] == AGREES).all()


def test_verify_sees_a_coefficient_that_is_wrong_by_a_thousandth(tmp_path):
    result = solve(CONVERGED_CUBIC, tmp_path)
    with h5py.File(result, "r+") as file:
        file["coefficients"][0, 0, file["tuple"][:, 0].tolist().index(1), 0] *= 1.001
        file["checksum"][0] = checksum_of_row(file, 0)  # as if it had been found in this way
    found = verified(result, status=NOT_ALL_CONVERGED)
    assert found["integration_verdict"] == [DIFFERS]
    assert 2e-4 < found["integration_first_difference"][0] < 5e-3


def test_verify_knows_an_unstable_motion_from_a_wrong_one(tmp_path):
    """A van der Pol oscillator under a small load: the small motion is a solution, with a growth rate near strength/2."""
    law = "&load dof='x1', tuple=1, cos=0.05 /\n&law type='van_der_pol', dof='x1', strength=0.3 /\n"
    text = FREE.replace("&tones frequency=1", "&tones frequency=2").replace("order=1", "order=9") + law
    found = verified(solve(text, tmp_path), "--periods", 50, status=NOT_ALL_CONVERGED)
    assert found["integration_verdict"] == [UNSTABLE]
    assert found["integration_first_difference"][0] < 1e-10
    assert found["integration_growth"][0] == pytest.approx(0.15, rel=0.1)


@pytest.mark.long  # seconds
def test_verify_takes_friction_and_chosen_points_on_two_ranks(tmp_path):
    text = (INPUTS / "gallery" / "jenkins_two_tones.nml").read_text()
    result = solve(text, tmp_path)
    done = run("verify", result, "--points", "1,2", cwd=tmp_path, ranks=2)
    assert done.status == 0, done.stderr
    kinds, largest = read(result, "integration_verdict", "integration_difference")
    assert kinds.tolist() == [0, AGREES, AGREES]
    assert np.isnan(largest[0]) and largest[1] < 5e-2 and largest[2] < 1.5e-2  # of the motion of the law's coordinate


# Converged motions from which a time integration departs; time integration by another program (tests/points) ends at the given
# distance from them.
# as said.
DEPARTING = {
    "grows slowly": (
        UNSTABLE,
        """
&structure type='chain', n_masses=2, mass=0.4975, 2.638, coupling_stiffness=0.7854, 1.2364, 0.9657, damping_stiffness=0.012955 /
&tones frequency=1.6141943 /
&harmonics order=21 /
&law type='cubic_spring', dof='x1', stiffness=1.98058 /
&law type='coulomb_tanh', dof='x1', limit=0.136304, velocity=0.0595164 /
&load dof='x1', tuple=1, cos=0.965677, sin=0.18018 /
""",
    ),  # 110 % of the motion of x1
    "grows more slowly than the structure forgets": (
        UNSTABLE,
        """
&structure type='modal_beam', length=1.0, bending_stiffness=0.010265982254684338, mass_per_length=1.0, n_modes=2,
   damping_stiffness=0.0414588 /
&tones frequency=1.6847037733 /
&harmonics order=7 /
&law type='coulomb_rigid', dofs='q1','q2', weights=0.985860607,0.330396373, limit=0.0845810128 /
&law type='cubic_spring', dofs='q1','q2', weights=0.908617370,-0.758930999, stiffness=9.29254771 /
&load dof='q1', tuple=1, cos=-0.453907734, sin=-0.467877773 /
""",
    ),  # 25 % of the motion of the friction
    "two stops": (
        UNSTABLE,
        """
&structure type='matrices', n_dofs=1, mass=1.90222, stiffness=11.39946, damping_stiffness=0.005401 /
&tones frequency=1.36007445 /
&harmonics order=16 /
&law type='elastic_stop', dof='x1', stiffness=483.645, gap=0.070841 /
&law type='elastic_stop', dof='x1', stiffness=113.038, gap=0.073506 /
&load dof='x1', tuple=1, cos=-0.154108, sin=0.764477 /
""",
    ),  # 95 %; with order 120 it is accurate to 1e-4, and departs at the same rate
    "two tones": (
        DIFFERS,
        """
&structure type='matrices', n_dofs=1, mass=1.62884, stiffness=5.06897, damping_mass=0.309476 /
&tones frequency=3.80818, 8.54107 /
&harmonics order=5 /
&law type='cubic_spring', dof='x1', stiffness=3780.877 /
&load dof='x1', tuple=1,0, cos=0.773091, sin=0.513342 /
&load dof='x1', tuple=0,1, cos=-0.477488, sin=0.840491 /
""",
    ),  # 59 %
    "wall between two masses": (
        DIFFERS,
        """
&structure type='chain', n_masses=3, mass=1.110137, 1.115973, 1.58035671, coupling_stiffness=2.07388, 0.335519, 2.29986, 0.327054,
   damping_mass=0.00463875 /
&tones frequency=1.04542795 /
&harmonics order=19 /
&law type='rigid_wall', dofs='x1','x2', weights=1.0,-1.0, gap=0.291549 /
&load dof='x1', tuple=1, cos=-0.39093, sin=-0.348957 /
""",
    ),  # 66 %
}


@pytest.mark.parametrize("name", DEPARTING)
def test_verify_sees_motions_from_which_integration_departs(tmp_path, name):
    expected, text = DEPARTING[name]
    result = solve(text, tmp_path, status=None)
    found = verified(result, status=NOT_ALL_CONVERGED)
    assert found["integration_verdict"] == [expected], found
    names = ("integration_growth", "integration_limit", "integration_duration", "frequency")
    growth, limit, duration, frequency = read(result, *names)
    assert limit <= 0.1 and duration >= 20 * 2 * np.pi / frequency.min() * (1 - 1e-12)
    if expected == DIFFERS:
        assert found["integration_difference"] > 0.3
    else:
        assert growth * duration > 3.0


def test_verify_is_as_long_as_the_slowest_decay_needs_by_default(tmp_path):
    """With 0.1 % of damping ten periods show nothing, and 700 are sufficient."""
    light = "&structure type='matrices', n_dofs=1, mass=1, damping=0.002, stiffness=1 /\n&tones frequency=1.2 /\n"
    text = light + "&harmonics order=7 /\n&load dof='x1', tuple=1, cos=0.1 /\n&law type='cubic_spring', dof='x1', stiffness=0.5 /\n"
    result = solve(text, tmp_path)
    assert verified(result, "--periods", 10, status=NOT_ALL_CONVERGED)["integration_verdict"] == [UNDECIDED]
    assert read(result, "integration_duration")[0] == pytest.approx(10 * 2 * np.pi / 1.2)
    assert verified(result)["integration_verdict"] == [AGREES]
    assert np.log(100) / 0.001 < read(result, "integration_duration")[0] < 1.3 * np.log(100) / 0.001


def test_disturbances_of_a_motion_that_agrees_decay(tmp_path):
    """Its difference exceeds the limit in the transient: growth is that of all periods, by the multipliers -0.6/s."""
    text = "&structure type='chain', n_masses=2, mass=2.0, 0.7, ends='fixed-free', coupling_stiffness=5000.0, 1500.0,\n"
    text += "           damping_stiffness=4e-4, damping_mass=0.3 /\n&tones hertz=8.0 /\n&load dof='x1', tuple=1, cos=8.0 /\n"
    text += "&law type='elastic_stop', label='stop', dof='x2', stiffness=3.0e4, gap=3e-3 /\n"
    found = verified(solve(text, tmp_path))
    assert found["integration_verdict"] == [AGREES] and found["integration_growth"][0] == pytest.approx(-0.6, abs=0.2)


def test_verify_needs_all_degrees_of_freedom(tmp_path):
    two = "&structure type='chain', n_masses=2, mass=1, coupling_stiffness=1 /\n&tones frequency=3 /\n&harmonics order=1 /\n"
    result = solve(two + "&load dof='x1', tuple=1, cos=1 /\n&output dofs='x1' /\n", tmp_path)
    done = run("verify", result, cwd=tmp_path)
    assert done.status == BAD_INPUT and "1 of 2; solve again" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("method", ["cvode", "central_differences"])
def test_verify_starts_from_a_motion_that_is_partly_behind_a_wall(tmp_path, method):
    """Both tones have their maximum at t = 0, where the series of order 5 is 3e-5 m beyond the wall."""
    text = (INPUTS / "paper" / "wall.nml").read_text()
    result = solve(
        text[: text.index("&sweep")], tmp_path, "--set", "harmonics%order=5", "--set", "sampling%samples=32", "--set",
        f"integration%method='{method}'", status=None,
    )  # fmt: skip
    found = verified(result, "--points", 0, "--periods", 3)
    assert 2e-2 < found["integration_first_difference"][0] < 6e-2  # of the motion of the wall's coordinate


# Laws that turn with the phase of a tone


def forced_blades(frame: str, order: int) -> str:
    """A force on the disk causes rubbing; in its own or the stationary frame the blades move along the casing."""
    turning = "" if frame == "rotating" else f"frame='{frame}', tone=2, "
    disk = -0.5 if frame == "stationary" else 0.0
    casing = 0.5 if frame == "rotating" else 0.0
    at = "tuple=1,3" if frame == "stationary" else "tuple=1,0"
    tuples = [f"{k},{m}" for k in range(order + 1) for m in (0, 3, -3) if k > 0 or m >= 0]
    loads = [f"&load dof='q1', {at}, cos=0.1 /"]
    if frame == "stationary":  # a force that rotates with the disk: half of it in each direction
        loads = [
            f"&load dof='q1', tuple=1,{m}, cos=0.05 /\n&load dof='q2', tuple=1,{m}, sin={0.05 if m > 0 else -0.05} /"
            for m in (3, -3)
        ]
    return f"""
&structure type='rotor_stator', frame='{frame}', n_diameters=3, speed=0.5, disk_frequency=1, casing_frequency=1.7,
   disk_damping_ratio=0.02, casing_damping_ratio=0.02 /
&tones frequency=1.05, 0.5 /
&harmonics set='list', tuples={", ".join(tuples)} /
&law type='blade_contact', {turning}dofs='q1','q2','r1','r2', n_diameters=3, n_blades=22, gaps=1, stiffness=2,
   friction_coefficient=0.05, friction_arms=0.3,0.333 /
&law type='cubic_damping', dofs='q1','q2', coefficient=0.01, n_diameters=3, speed={disk} /
&law type='cubic_damping', dofs='r1','r2', coefficient=0.01, n_diameters=3, speed={casing} /
""" + "\n".join(loads)


@pytest.mark.parametrize(
    ("method", "step", "tolerance"),
    [
        ("cvode", 0.02, 1e-9),
        ("runge_kutta_4", 0.005, 1e-6),
        ("central_differences", 0.002, 5e-4),
        pytest.param("generalized_alpha", 0.002, 5e-4, marks=pytest.mark.long),
    ],
)
def test_blades_are_integrated_alike_in_all_frames(tmp_path, method, step, tolerance):
    group = f"\n&integration duration=60, step={step}, method='{method}', tolerance=1e-12, spectral_radius=1 /\n"
    motions = {}
    for frame in ("rotating", "own", "stationary"):
        record = integration(forced_blades(frame, 3) + group, tmp_path, name=frame)
        t, x = read(record, "time", "displacement")
        disk, casing = x[0] + 1j * x[1], x[2] + 1j * x[3]
        turned = np.exp(-1j * 3 * 0.5 * t)  # from the stationary frame back to that of the disk
        disk = disk * turned if frame == "stationary" else disk
        motions[frame] = np.array([disk, casing if frame == "rotating" else casing * turned])
    largest = np.abs(motions["rotating"]).max()
    assert np.abs(motions["rotating"][1]).max() > 0.1, "the blades must touch"
    np.testing.assert_allclose(motions["own"], motions["rotating"], atol=tolerance * largest)
    np.testing.assert_allclose(motions["stationary"], motions["rotating"], atol=tolerance * largest)


@pytest.mark.parametrize("frame", ["own", "stationary"])
def test_verify_agrees_with_blades_that_run_along_the_casing(tmp_path, frame):
    result = solve(forced_blades(frame, 9), tmp_path)
    found = verified(result)
    assert found["integration_verdict"] == [AGREES] and found["integration_first_difference"][0] < 1e-3, found


def test_motions_of_several_periods_are_named(tmp_path):
    """Parametric resonance by a quadratic spring at half of a tone. The balance in both tones alone is not accurate enough, and
    time integration from it ends in the subharmonic motion: that is the status, not a truncated motion that needs more work."""
    (tmp_path / "case.nml").write_text("""
&structure type='matrices', n_dofs=1, mass=1.0, damping=0.1, stiffness=1.0 /
&tones frequency=2.0, 0.7290084 /
&accuracy tolerance=1e-8, max_harmonics=61 /
&load dof='x1', tuple=1,0, cos=1.0 /
&load dof='x1', tuple=0,1, cos=0.1 /
&law type='polynomial', dof='x1', stiffness=0.0, 0.5, 0.3 /
""")
    done = run("solve", "case.nml", cwd=tmp_path)
    assert "1 subharmonic" in done.stdout, done.stdout
    assert "max_work" not in done.stdout, done.stdout
    (command,) = [line for line in done.stdout.splitlines() if line.strip().startswith("try:")]
    words = shlex.split(command)
    assert "tones%subharmonic=2" in words
    run(*words[2:], "--set", "accuracy%tolerance=1e-2", "--set", "accuracy%max_harmonics=2000", cwd=tmp_path)
    c, tuples, status = read(tmp_path / words[-1], "coefficients", "tuples", "status")
    assert status == [18]  # integrated
    odd = np.any(tuples.reshape(c.size // 2, -1) % 2 == 1, axis=1)
    assert np.nanmax(np.hypot(*c.reshape(-1, 2).T)[odd]) > 0.1
