"""Pictures are written, hold something, and show the data."""

import numpy as np
import pytest
from conftest import single, walled
from matplotlib.image import imread
from synthetic import write_results

from nhbm_post import Results, UsageError
from nhbm_post.cli import main
from nhbm_post.draw import draw_correction, draw_rotor, draw_spectrum, draw_time, save
from nhbm_post.draw.rotor import CASING, DISK, RotorStator, mean_radius
from nhbm_post.draw.style import quantity_text, unit_scale
from nhbm_post.draw.time_history import Record, read_record
from nhbm_post.errors import ReaderError
from nhbm_post.series import Series


def assert_picture(fig, path):
    save(fig, path, dpi=50)
    pixels = imread(path)[..., :3]
    assert min(pixels.shape[:2]) > 100
    assert pixels.std() > 0.02, "an empty picture"


def texts_of(fig):
    return " ".join(
        [t.get_text() for t in fig.texts] + [t.get_text() for ax in fig.axes for t in _legend_texts(ax)]
    )


def _legend_texts(ax):
    return ax.get_legend().get_texts() if ax.get_legend() else []


@pytest.mark.parametrize(
    "n_tones, view, is_stored",  # each pair of choices once
    [
        (1, "surface", True),
        *(pytest.param(n, "surface", n == 3, marks=pytest.mark.long) for n in (2, 3)),
        (1, "map", False),
        (2, "map", True),
        (3, "map", False),
    ],
)
def test_correction(tmp_path, n_tones, view, is_stored):
    path = walled(tmp_path / "a.h5", n_tones, has_samples=is_stored)
    with Results(path) as results:
        fig = draw_correction(results, 0, view=view, n_samples=24)
    heading = next(text for text in fig.texts if text.get_text().startswith("(c)")).get_window_extent()
    assert not any(ax.get_legend() and ax.get_legend().get_window_extent().overlaps(heading) for ax in fig.axes)
    assert_picture(fig, tmp_path / "a.png")
    source = "as stored by the run" if is_stored else "summed from the stored coefficients"
    assert source in texts_of(fig)
    assert ("section tau_3 = 0" in texts_of(fig)) == (n_tones == 3)


@pytest.mark.parametrize(
    "groups, why, status",
    [
        ("", "no law of this model is a rigid contact", 1),
        ("&law\n   type = 'rigid_wall'\n/\n", "the rigid contact at it is not reached", 1),
        ("&law\n   type = 'blade_contact'\n   contact = 'rigid'\n/\n", "the rigid contact at it is not reached", 1),
        ("&law\n   type = 'rigid_wall'\n/\n", "it was found by time integration", 18),
    ],
)
def test_correction_reports_where_there_is_none(tmp_path, groups, why, status):
    """Instead of four panels of which two are equal to the other two."""
    with (
        Results(single(tmp_path / "a.h5", 2, input_groups=groups, status=[status])) as results,
        pytest.raises(UsageError, match=f"nothing is corrected in the motion of 'v3' at point 0, since {why}"),
    ):
        draw_correction(results, 0)


def test_map_hatches_the_redundant_half(tmp_path):
    with Results(single(tmp_path / "a.h5", 2)) as results:
        fig = draw_spectrum(results.series(0))
    ax = fig.axes[0]
    shown = ax.collections[0].get_array().reshape(7, 7)
    mask = np.ma.getmaskarray(shown)
    assert (~mask).sum() == 25 and mask[:, :3].all() and mask[:3, 3].all() and not mask[3:, 3].any()
    hatched = [patch for patch in ax.patches if patch.get_hatch()]
    assert len(hatched) == 1 and len(hatched[0].get_path().vertices) == 24 * 5
    assert ax.get_xlim() == (-1.5, 3.5)  # it took more room than the data


@pytest.mark.parametrize(
    "n_tones, over, is_normalised",  # each pair of choices once
    [
        pytest.param(n, over, is_normalised, marks=[] if is_normalised == ((over == "tuple") == (n != 2)) else [pytest.mark.long])
        for n in (1, 2, 3)
        for over in ("tuple", "frequency")
        for is_normalised in (True, False)
    ],
)
def test_spectrum(tmp_path, n_tones, over, is_normalised):
    with Results(single(tmp_path / "a.h5", n_tones)) as results:
        fig = draw_spectrum(results.series(0), title="a title", over=over, is_normalised=is_normalised)
    assert not any("|c_j|" in text.get_text() for text in fig.texts)
    assert_picture(fig, tmp_path / "a.png")


def test_spectrum_of_few_harmonics_far_out_is_no_map(tmp_path):
    cross = np.array([[j, 0] for j in range(20)] + [[0, j] for j in range(1, 20)])
    series = Series(cross, np.array([1.0, 1.3]), np.ones(39), np.zeros(39), "x1", "m", "displacement")
    assert "Frequency" in draw_spectrum(series).axes[0].get_xlabel()
    assert "Harmonic $j_1$" in draw_spectrum(series, form="map").axes[0].get_xlabel()


def test_spectrum_as_bars(tmp_path):
    with Results(single(tmp_path / "a.h5", 2)) as results:
        assert_picture(draw_spectrum(results.series(0), form="bars"), tmp_path / "a.png")
    with Results(single(tmp_path / "b.h5", 1)) as results, pytest.raises(UsageError, match="needs 2 tones"):
        draw_spectrum(results.series(0), form="bars")


def test_time_draws_the_motion(tmp_path):
    with Results(single(tmp_path / "a.h5", 2)) as results:
        series = results.series(0)
    fig = draw_time([("two tones", series)], t_from=1.0, t_to=3.0, level=1e-3)
    t, x = fig.axes[0].lines[0].get_data()
    assert (t[0], t[-1]) == (1.0, 3.0)
    assert fig.axes[0].get_ylabel() in ("Displacement v3 [mm]", "Displacement v3 [µm]")
    factor = 1e3 if "mm" in fig.axes[0].get_ylabel() else 1e6
    np.testing.assert_allclose(x, factor * series.evaluate(t), rtol=1e-12)
    assert_picture(fig, tmp_path / "a.png")


def test_time_difference_to_a_record_is_drawn(tmp_path):
    with Results(single(tmp_path / "a.h5", 2)) as results:
        series = results.series(0)
    t = np.linspace(0.0, 50.0, 3001)
    fig = draw_time(
        [("balance", series)], [Record("integrated", t, series.evaluate(t) - 2e-6)], has_difference=True
    )
    np.testing.assert_allclose(fig.axes[1].lines[0].get_ydata(), 2.0, rtol=1e-9)
    assert fig.axes[1].get_ylabel() == "Difference [µm]"
    assert fig.axes[0].get_xlim()[1] == 50.0
    assert_picture(fig, tmp_path / "a.png")


def test_time_refuses_empty_windows(tmp_path):
    with Results(single(tmp_path / "a.h5", 1)) as results:
        curve = [("x", results.series(0))]
    with pytest.raises(UsageError, match="window is empty"):
        draw_time(curve, t_from=2.0, t_to=1.0)
    with pytest.raises(UsageError, match="covers 0 to 1 s: nothing from 5 to 6 s"):
        draw_time(curve, [Record("r", np.array([0.0, 1.0]), np.zeros(2))], t_from=5.0, t_to=6.0)
    with pytest.raises(UsageError, match="--overlay"):
        draw_time(curve, has_difference=True)


@pytest.mark.parametrize(
    "text",
    ["0,1\n1,3\n", "# by a program\nt,x\n0,1\n1,3\n", "t;v1;v3 [m]\n0;9;1\n1;9;3\n", "1 3\n0 1 # first\n"],
)
def test_record_of_many_forms(tmp_path, text):
    path = tmp_path / "r.csv"
    path.write_text(text)
    record = read_record(path, "v3")
    np.testing.assert_array_equal(record.t, [0.0, 1.0])
    np.testing.assert_array_equal(record.x, [1.0, 3.0])


@pytest.mark.parametrize("text", ["0,0,0,1\n0,5,0,2\n1,0,0,3\n", "t,v3\n0,0,0,1\n0,5,0,2\n", "t;v3\n0,0;0,1\n0,5;0,2\n"])
def test_decimal_commas_of_a_record_are_refused(tmp_path, text):
    path = tmp_path / "r.csv"
    path.write_text(text)
    with pytest.raises(ReaderError):
        read_record(path, "v3")


def test_a_record_without_names_may_have_further_columns(tmp_path):
    path = tmp_path / "r.txt"
    path.write_text("0 1 0.5\n1 3 0.5\n")
    np.testing.assert_array_equal(read_record(path).x, [1.0, 3.0])


@pytest.mark.parametrize(
    "ending, start", [("png", b"\x89PNG"), pytest.param("pdf", b"%PDF", marks=pytest.mark.long), ("svg", b"<?xml")]
)
def test_ending_chooses_the_format(tmp_path, ending, start):
    """The same bytes each time."""
    with Results(single(tmp_path / "a.h5", 1)) as results:
        paths = [save(draw_spectrum(results.series(0)), tmp_path / f"{name}.{ending}", dpi=40) for name in ("a", "b")]
    assert paths[0].read_bytes().startswith(start)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_saving_refuses_bad_names(tmp_path):
    with Results(single(tmp_path / "a.h5", 1)) as results:
        fig = draw_spectrum(results.series(0))
    with pytest.raises(UsageError, match="must end in .png, .pdf, .svg"):
        save(fig, tmp_path / "a.gif")
    with pytest.raises(UsageError, match="cannot write"):
        save(fig, tmp_path / "none" / "a.png")


@pytest.mark.parametrize(
    "largest, units, expected",
    [
        (1.5e-3, "m", "mm"),
        (2.0e-5, "m", "µm"),
        (0.6, "m", "m"),
        (1.2e4, "N", "kN"),
        (3.0, "rad", "rad"),
        (1e-3, "m or rad", r"$10^{-3}$ m or rad"),
        (1e-14, "m", r"$10^{-15}$ m"),
        (0.0, "m", "m"),
    ],
)
def test_units_get_prefixes(largest, units, expected):
    factor, text = unit_scale(largest, units)
    assert text == expected
    assert largest == 0.0 or 0.4 < largest * factor < 1000.0
    assert "10^" not in unit_scale(largest, units, is_logarithmic=True)[1]


ROTOR = """&structure
   type = 'rotor_stator'
   n_diameters = 3
   speed = 0.9
   frame = '{}'
   disk_frequency = 1.0
   casing_frequency = 1.7
/
&law
   type = 'blade_contact'
   n_blades = 22
   gaps = 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
      1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0
/
"""


def rotor_file(path, frame, tone=1.2, disk=2.0, casing=1.5):
    """Waves exp(-i tone t) of disk and casing in the rotating frame at two speeds, in one frame or in each its own."""
    tuples, tones = np.array([[1]]), [[tone], [tone]]
    waves = np.array([[[disk, 0.0]], [[0.0, -disk]], [[casing, 0.0]], [[0.0, -casing]]])
    if frame == "own":  # on the casing exp(i (3 Omega - tone) t)
        tuples, tones = np.array([[1, 0], [1, -3]]), [[tone, 0.9], [tone, 0.95]]
        waves = np.repeat(waves, 2, axis=1)
        waves[:2, 1] = waves[2:, 0] = 0.0
    return write_results(
        path,
        tuples,
        tones,
        [waves, waves],
        dofs=("q1", "q2", "r1", "r2"),
        law_dofs=("q1", "q2", "r1", "r2"),
        parameters={"structure_speed": ("structure%speed", "1", [0.9, 0.95])},
        input_groups=ROTOR.format(frame),
    )


@pytest.mark.parametrize("frame", ["rotating", "own"])
def test_rotor_waves_in_the_stationary_frame(tmp_path, frame):
    """The casing's crest moves by (3 Omega - tone)/3, whatever the frame of the coordinates."""
    with Results(rotor_file(tmp_path / "a.h5", frame)) as results:
        rotor = RotorStator(results, 1)
        assert rotor.critical_speed == pytest.approx(0.9) and rotor.speed == 0.95
        assert (rotor.n_blades, rotor.gap) == (22, pytest.approx((0.5 + 21.0) / 22))
        assert rotor.wave_speed() == pytest.approx((3 * 0.95 - 1.2) / 3, rel=1e-6)
        theta, t = np.linspace(0.0, 6.0, 7), 2.3
        expected = np.cos(3 * theta - (3 * 0.95 - 1.2) * t)
        assert rotor.displacement(DISK, theta, t) == pytest.approx(2.0 * expected)
        assert rotor.displacement(CASING, theta, t) == pytest.approx(1.5 * expected)
        assert mean_radius(results, 1, CASING) == pytest.approx(1.5)


@pytest.mark.long
def test_views_of_a_rotor_have_names_of_their_own(tmp_path, capsys):
    path = rotor_file(tmp_path / "a.h5", "rotating")
    for view in ("speeds", "snapshots", "wave"):
        assert main(["rotor", str(path), "--view", view, "--dpi", "30"]) == 0
        assert capsys.readouterr().out == f"wrote {tmp_path / f'a_rotor_{view}.png'}\n"
        assert (tmp_path / f"a_rotor_{view}.png").exists()


@pytest.mark.parametrize("view", ["speeds", pytest.param("snapshots", marks=pytest.mark.long), "wave"])
def test_rotor_pictures(tmp_path, view):
    with Results(rotor_file(tmp_path / "a.h5", "rotating")) as results:
        fig = draw_rotor(results, 0, view)
    assert_picture(fig, tmp_path / "a.png")


def test_rotor_needs_its_structure(tmp_path):
    with Results(single(tmp_path / "a.h5", 1)) as results, pytest.raises(UsageError, match="rotor_stator"):
        draw_rotor(results, 0)


@pytest.mark.parametrize("value, units, text", [
    (1.09407e-3, "m", "1.094 mm"), (12345.678, "N", "12.35 kN"), (0.0, "m", "0 m"), (1.09407e-3, "1", "1.094e-3"),
    (2.5e-5, "kg m", "2.5e-5 kg m"), (3.14159, "s", "3.142 s"),
])  # fmt: skip
def test_numbers_of_headings_are_short(value, units, text):
    assert quantity_text(value, units) == text
