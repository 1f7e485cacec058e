"""Orbits, sections, surfaces, waterfalls, Campbell diagrams and animations against closed forms."""

import shutil

import numpy as np
import pytest
from conftest import single
from PIL import Image
from synthetic import box, write_results

from nhbm_post import Results, UsageError
from nhbm_post.cli import main
from nhbm_post.draw import draw_orbit, draw_spectrum, draw_surface, draw_waterfall, hypertime_in_motion
from nhbm_post.draw.motion import section
from nhbm_post.series import Series


def circle(n_tones=1, radius=2.0, small=0.5):
    """x = 2 cos(w1 t) (+ 0.5 cos(w2 t) (+ 0.5 cos(w3 t)))."""
    tuples = np.eye(n_tones, dtype=int)
    size = np.array([radius, small, small][:n_tones])
    omega = 3.0 * np.sqrt([1.0, 2.0, 3.0][:n_tones])
    return Series(tuples, omega, size, 0.0 * size, "x1", "m", "displacement")


def drawn(fig, gid):
    return next(line for ax in fig.axes for line in ax.lines if line.get_gid() == gid)


def test_velocity_is_the_derivative():
    series = circle(2)
    times = np.linspace(0.0, 5.0, 41)
    exact = -6.0 * np.sin(3.0 * times) - 1.5 * np.sqrt(2.0) * np.sin(3.0 * np.sqrt(2.0) * times)
    assert series.velocity().evaluate(times) == pytest.approx(exact)
    assert (series.velocity().units, series.velocity().axis_label) == ("m/s", "Velocity of x1")


def test_words_of_an_axis_begin_with_a_capital():
    zero = np.zeros(1)
    headings = (("x1", "", "x1"), ("x1", "displacement", "Displacement x1"), ("law force on x1", "", "Law force on x1"))
    for label, words, axis in headings:
        assert Series(np.ones((1, 1), int), zero, zero, zero, label, "m", words).axis_label == axis


def test_phase_plane_is_an_ellipse():
    fig = draw_orbit(circle(), circle().velocity())
    x, v = drawn(fig, "orbit").get_data()
    assert np.hypot(x / 2.0, v / 6.0) == pytest.approx(1.0, rel=1e-9)
    assert np.array(drawn(fig, "section").get_data()).ravel() == pytest.approx([2.0, 0.0], abs=1e-12)
    ax = next(ax for ax in fig.axes if ax.get_xlabel())
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Displacement x1 [m]", "Velocity of x1 [m/s]")


def test_orbit_of_two_displacements_has_one_unit_and_scale():
    large, small = circle(radius=2e-3), circle(radius=4.5e-4)
    ax = next(ax for ax in draw_orbit(large, small).axes if ax.get_xlabel())
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Displacement x1 [mm]", "Displacement x1 [mm]")
    assert ax.get_aspect() == 1.0
    tiny = next(ax for ax in draw_orbit(large, circle(radius=9e-9)).axes if ax.get_xlabel())
    assert tiny.get_ylabel() == "Displacement x1 [nm]"


def test_section_of_a_torus():
    """At tau_1 = 0: x = 2 + 0.5 cos, v = -1.5 sqrt(2) sin; at tau_2 = 0 the large circle."""
    x = circle(2)
    at, of = section((x, x.velocity()), 0)
    assert np.hypot((at - 2.0) / 0.5, of / (1.5 * np.sqrt(2.0))) == pytest.approx(1.0)
    at, of = section((x, x.velocity()), 1)
    assert np.hypot((at - 0.5) / 2.0, of / 6.0) == pytest.approx(1.0)
    assert np.ptp(drawn(draw_orbit(x, x.velocity(), tone=1), "section").get_xdata()) == pytest.approx(4.0)


@pytest.mark.parametrize("view", ["surface", "map"])
def test_surface_over_two_tones(view):
    fig = draw_surface(circle(2), view=view, n_samples=32)
    assert any("Displacement x1 over hypertime" in text.get_text() for text in fig.texts)
    if view == "map":
        assert fig.axes[0].collections[0].get_array().max() == pytest.approx(2.5)
    with pytest.raises(UsageError, match="one tone has a line"):
        draw_surface(circle(1), view=view)


def swept(path):
    """Ten frequencies; harmonic 1 of 1 m, harmonic 3 of 0.1 m, harmonic 2 below the scale."""
    tuples = box(1, 3)
    order = tuples[:, 0]
    coefficients = np.zeros((10, 1, len(tuples), 2))
    for k, size in ((1, 1.0), (2, 1e-9), (3, 0.1)):
        coefficients[:, 0, order == k, 0] = size
    frequency = np.linspace(1.0, 2.0, 10)
    parameters = {"tones_frequency": ("tones%frequency", "rad/s", frequency)}
    return write_results(path, tuples, frequency[:, None], coefficients, parameters=parameters)


def test_campbell_has_a_dot_a_harmonic(tmp_path):
    with Results(swept(tmp_path / "a.h5")) as results:
        fig = draw_waterfall(results, view="campbell")
    dots = next(c for ax in fig.axes for c in ax.collections if c.get_gid() == "harmonics")
    x, y = np.array(dots.get_offsets()).T
    assert x.size == 20 and sorted(set((y / x).round(9))) == [1.0, 3.0]
    assert sorted(set(np.array(dots.get_array()).round(9))) == [0.1, 1.0]
    orders = [line for line in fig.axes[0].lines if line.get_gid() == "order"]
    assert [float((line.get_ydata() / line.get_xdata())[0].round(9)) for line in orders] == [1.0, 2.0, 3.0, 4.0]
    assert {line.get_linestyle() for line in orders} == {"-."}


def test_labels_of_orders_do_not_overlap(tmp_path):
    tuples = box(1, 12)
    coefficients = np.zeros((30, 1, len(tuples), 2))
    coefficients[:, 0, tuples[:, 0] > 0, 0] = 1.0
    frequency = np.linspace(1.0, 20.0, 30)
    coefficients[np.ix_(frequency > 5.0, [0], tuples[:, 0] > 3)] = 0.0
    parameters = {"tones_frequency": ("tones%frequency", "rad/s", frequency)}
    with Results(write_results(tmp_path / "a.h5", tuples, frequency[:, None], coefficients, parameters=parameters)) as results:
        fig = draw_waterfall(results, view="campbell")
    fig.canvas.draw()
    boxes = [text.get_window_extent() for text in fig.axes[0].texts]
    assert len(boxes) > 5
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])


@pytest.mark.long
def test_waterfall_has_stems(tmp_path):
    path = swept(tmp_path / "a.h5")
    with Results(path) as results:
        fig = draw_waterfall(results)
        stems = next(c for ax in fig.axes for c in ax.collections if c.get_gid() == "stems").get_segments()
        with pytest.raises(UsageError, match="no number changes over the 1 solved point"):
            draw_waterfall(results, where={"tones%frequency": "1"})
    heights = np.array([stem[1][1] - stem[0][1] for stem in stems])
    assert len(stems) == 20 and sorted(set(heights.round(9))) == pytest.approx([0.15, 0.2])  # 3 and 4 of 4 decades of 1.8/9
    assert main(["waterfall", str(path), "--dpi", "40"]) == 0 and main(["campbell", str(path), "--dpi", "40"]) == 0


@pytest.mark.parametrize(("view", "axis"), [("waterfall", "y"), ("campbell", "x")])
def test_small_swept_values_have_a_prefix(tmp_path, view, axis):
    tuples = box(1, 1)
    coefficients = np.ones((3, 1, 2, 2))
    parameters = {"law_1_gap": ("law(1)%gap", "m", np.array([0.5e-3, 1e-3, 2e-3]))}
    path = write_results(tmp_path / "a.h5", tuples, np.ones((3, 1)), coefficients, parameters=parameters)
    with Results(path) as results:
        ax = draw_waterfall(results, view=view).axes[0]
    assert getattr(ax, f"get_{axis}label")().endswith("[mm]")
    assert getattr(ax, f"get_{axis}lim")()[1] == pytest.approx(2.1, abs=1.5)


def test_spectra_are_those_of_one_line_of_a_sweep(tmp_path):
    tuples, frequency = box(1, 1), np.tile([1.0, 2.0, 3.0], 2)
    coefficients = np.zeros((6, 1, 2, 2))
    coefficients[:, 0, 1, 0] = [1.0] * 3 + [5.0] * 3
    gap = np.repeat([1e-3, 2e-3], 3)
    parameters = {"law_1_gap": ("law(1)%gap", "m", gap), "tones_frequency": ("tones%frequency", "rad/s", frequency)}
    path = write_results(tmp_path / "a.h5", tuples, frequency[:, None], coefficients, parameters=parameters)
    with Results(path) as results:
        for where, size, head in (
            (None, 1.0, "gap of law 1 = 1.0e-3 m one of 2 lines"),
            ({"law(1)%gap": "2e-3"}, 5.0, "gap of law 1 = 2.0e-3 m"),
        ):
            fig = draw_waterfall(results, view="campbell", where=where)
            dots = next(c for ax in fig.axes for c in ax.collections if c.get_gid() == "harmonics")
            assert dots.get_array().tolist() == [size] * 3
            assert head in " ".join(text.get_text() for text in fig.texts).replace("dash-dotted: multiples of the first tone; ", "")


@pytest.mark.parametrize("n_tones", [1, 2])
def test_state_moves_along_the_motion(n_tones):
    series, times = circle(n_tones), np.linspace(0.0, 2.0, 21)
    fig, update = hypertime_in_motion(series, times, "")
    update(10)
    t, x = (float(values[0]) for values in drawn(fig, "now").get_data())
    assert (t, x) == (pytest.approx(1.0, abs=0.01), pytest.approx(series.evaluate(t)))
    state = np.ravel(drawn(fig, "state").get_data())
    phases = np.mod(series.omega * t, 2.0 * np.pi)
    assert state == pytest.approx([x, float(series.velocity().evaluate(t))] if n_tones == 1 else phases)
    whole = fig.axes[1].lines[0].get_xdata()
    assert whole[-1] == pytest.approx(times[-1] + times[1] - times[0])  # a period is drawn to where it closes
    bars = [ax for ax in fig.axes if ax.get_label() == "<colorbar>"]
    assert [bar.get_ylabel() for bar in bars] == ([] if n_tones == 1 else [f"{series.label} [m]"])


@pytest.mark.parametrize("n_tones", [2, 3])
def test_a_colour_bar_is_as_high_as_its_map(n_tones):
    fig = draw_surface(circle(n_tones), view="map")
    fig.draw_without_rendering()
    (drawn_map, bar) = fig.axes
    assert bar.get_position().height == pytest.approx(drawn_map.get_position().height)
    assert ("tau_3 = 0" in " ".join(text.get_text() for text in fig.texts)) == (n_tones == 3)


def test_the_bar_of_a_flat_spectrum_is_as_high_as_it():
    tuples = np.array([[k, 1] for k in range(9)])
    fig = draw_spectrum(Series(tuples, np.array([3.0, 4.1]), np.ones(9), np.ones(9), "x1", "m", "displacement"), form="map")
    fig.draw_without_rendering()
    (drawn_map, bar) = fig.axes
    assert bar.get_position().height == pytest.approx(drawn_map.get_position().height) and bar.get_position().height < 0.5


@pytest.mark.long
def test_animations_are_written(tmp_path, capsys):
    path = single(tmp_path / "a.h5", 2)
    assert main(["animate", str(path), "--frames", "2", "--dpi", "40"]) == 0
    with Image.open(tmp_path / "a_animate.gif") as image:
        assert image.n_frames == 2 and image.size == (352, 156)
    assert main(["animate", str(path), "--frames", "5", "-o", str(tmp_path / "a.png")]) == 2
    assert "must end in .gif, .mp4" in capsys.readouterr().err
    assert main(["surface", str(path), "--view", "map", "--dpi", "40"]) == 0
    assert main(["orbit", str(path), "--dpi", "40", "--section", "2"]) == 0
    assert main(["orbit", str(path), "--section", "3"]) == 2 and "no tone 3; tones: 1 to 2" in capsys.readouterr().err


def test_mp4(tmp_path):
    if not shutil.which("ffmpeg"):
        pytest.importorskip("imageio_ffmpeg")
    path = single(tmp_path / "a.h5", 1)
    assert main(["animate", str(path), "--frames", "2", "--dpi", "40", "-o", str(tmp_path / "a.mp4")]) == 0
    assert (tmp_path / "a.mp4").read_bytes()[4:8] == b"ftyp"
