"""`nhbm integrate`: the record, and the agreement of time integration and balance in cases with known numbers."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest
import xarray

from integrations import (
    FORCED, FREE, INPUTS, MASS, VAN_DER_POL, coefficient, difference, forced_blades, integration, largest_motion,
)  # fmt: skip
from nhbm_post import integration as post_integration
from program import BAD_INPUT, read, run, solve


def test_the_largest_lines_of_the_spectrum_are_printed(tmp_path):
    (tmp_path / "case.nml").write_text(FORCED + "&integration duration=200, n_peaks=1 /\n")
    said = run("integrate", "case.nml", cwd=tmp_path).stdout
    found = re.search(r"^largest lines of x1, frequency \[rad/s\] \(amplitude\): (\S+) \((\S+)\)$", said, re.MULTILINE)
    assert found, said
    frequency, amplitude = read(tmp_path / "case.h5", "peak_frequency", "peak_coefficients")
    assert float(found[1]) == pytest.approx(frequency[0, 0], rel=1e-6)
    assert float(found[2]) == pytest.approx(np.hypot(*amplitude[0, 0]), rel=0.1)


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
        (FORCED, ": missing integration%duration: give a time [s]"),
        (FORCED + "&integration duration=1, method='runge_kutta4' /", "did you mean 'runge_kutta_4'"),
        (FORCED + "&integration duration=1, continue='none.h5' /", "none.h5"),
        (
            FORCED + "&integration duration=1, method='runge_kutta_4' /\n&law type='rigid_wall', dof='x1', gap=1 /",
            "does not support rigid walls",
        ),
        (
            FORCED + "&integration duration=1 /\n"
            "&law type='contact_table', contact='rigid', dofs='x1', n_contacts=1, shapes=-1, gaps=1 /",
            "no method of time integration supports rigid contacts",
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
            "give first guesses of the frequencies of the tones",
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


@pytest.mark.parametrize(
    ("strength", "period"), [(1, 6.6632868593231361), pytest.param(5, 11.6122306677196, marks=pytest.mark.long)]
)
def test_van_der_pol_has_its_period(tmp_path, strength, period):
    text = f"&law type='van_der_pol', dof='x1', strength={strength} /\n&start dof='x1', tuple=1, cos=2 /\n"
    group = "&integration start='given', transient=100, duration=1000, step=0.02, tolerance=1e-13, n_peaks=1 /"
    record = integration(FREE + text + group, tmp_path)
    assert 2 * np.pi / read(record, "peak_frequency")[0, 0] == pytest.approx(period, rel=1e-10)


@pytest.mark.long
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


@pytest.mark.parametrize(("point", "amplitude"), [pytest.param(0, 2.62610487572, marks=pytest.mark.long), (1, 0.721110255093)])
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
