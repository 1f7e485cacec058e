"""Response curves, backbones and maps: the picture shows the data of the file."""

import csv

import h5py
import numpy as np
import pytest
from conftest import single
from synthetic import STATUS_WORDS, box, write_results

from nhbm_post import Results, UsageError
from nhbm_post.cli import main
from nhbm_post.draw import draw_map, draw_response, save
from nhbm_post.draw.marks import mark
from nhbm_post.draw.style import unit_scale
from nhbm_post.measure import Measure
from nhbm_post.outcome import TEXTS
from nhbm_post.report import info

CONVERGED, STALLED, FAILED, TRUNCATED = 1, 2, 6, 7


def grid_file(path, n_gaps=3, n_speeds=5, status=None, branch=None, n_points=None, **more):
    """One tone; amplitude 1 + number of the gap, plus a tenth of the number of the speed, over gap (slow) and frequency (fast)."""
    gap, speed = (m.ravel() for m in np.meshgrid(np.arange(n_gaps), np.arange(n_speeds), indexing="ij"))
    gap, speed = gap[:n_points], speed[:n_points]
    coefficients = np.zeros((gap.size, 1, 2, 2))
    coefficients[:, 0, 1, 0] = 1.0 + gap + 0.1 * speed
    parameters = {
        "law_1_gap": ("law(1)%gap", "m", 1e-3 * (gap + 1.0)),
        "tones_frequency": ("tones%frequency", "rad/s", 1.0 + speed),
    }
    frequency = np.stack([1.0 + speed], axis=1)
    status = np.ones(gap.size, np.int32) if status is None else np.asarray(status)
    write_results(path, box(1, 1), frequency, coefficients, status=status, parameters=parameters, **more)
    if branch is not None:
        with h5py.File(path, "r+") as file:
            file["branch"] = np.asarray(branch, dtype=np.int32)
    return path


def curves_of(fig):
    return [line for ax in fig.axes for line in ax.lines if line.get_gid() == "curve"]


def marks_of(fig, name):
    """x of the marks of a status, of all axes, and the axes they stand in."""
    found = [(ax, line) for ax in fig.axes for line in ax.lines if line.get_gid() == name]
    return np.concatenate([line.get_xdata() for _, line in found] or [np.array([])]), [ax for ax, _ in found]


def legend_of(fig):
    legends = [c for ax in fig.axes for c in ax.get_children() if type(c).__name__ == "Legend"]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def head_of(fig):
    return " ".join(text.get_text() for text in fig.texts)


def test_curves_are_written_as_a_table(tmp_path):
    path = grid_file(tmp_path / "grid.h5", status=[1] * 14 + [STALLED])
    assert main(["response", str(path), "--over", "tones%frequency", "-o", str(tmp_path / "grid.csv")]) == 0
    with open(tmp_path / "grid.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 15 and list(rows[0])[:3] == ["curve", "point", "tones%frequency [rad/s]"]
    assert [float(row["tones%frequency [rad/s]"]) for row in rows[:5]] == [1.0, 2.0, 3.0, 4.0, 5.0]
    values = np.array([float(row[list(row)[3]]) for row in rows])
    np.testing.assert_allclose(values[:14], [1.0 + gap + 0.1 * speed for gap in range(3) for speed in range(5)][:14])
    assert np.isnan(values[14]) and rows[14]["status"] == "stalled" and rows[0]["stability"] == "unknown"


def test_hertz_stay_as_the_input_has_them():
    assert unit_scale(600.0, "Hz") == (1.0, "Hz") and unit_scale(2e4, "Hz") == (1e-3, "kHz")
    assert unit_scale(600.0, "N") == (1e-3, "kN")


def test_curves_show_the_measure_and_break_at_points_without_motion(sweep, tmp_path):
    with Results(sweep) as results:
        fig = draw_response(results, "v3", measure=Measure("rms"), over="law_1_gap")
        expected = [results.series(point, "v3").rms for point in range(3)]
    factor, _ = unit_scale(max(expected), "m")
    broyden, newton = curves_of(fig)
    np.testing.assert_allclose(newton.get_ydata(), factor * np.array(expected))
    assert np.isnan(broyden.get_ydata()).all()
    assert [ax.get_xlabel() for ax in fig.axes if ax.get_xlabel()] == ["Gap of law 1 $g$ [mm]"]
    assert save(fig, tmp_path / "a.png", 50).stat().st_size > 5000


def test_every_status_has_its_mark_and_its_count(sweep):
    """A file of three converged, a stalled, a failed and a pending point: each count is that of the summary of a run."""
    with Results(sweep) as results:
        fig = draw_response(results, "v3", measure=Measure("rms"), over="law_1_gap")
    legend = legend_of(fig)
    for words in ("3 converged", "1 stalled", "1 failed", "1 pending"):
        assert legend.count(words) == 1
    np.testing.assert_allclose(marks_of(fig, "stalled")[0], [1.0])
    np.testing.assert_allclose(marks_of(fig, "failed")[0], [1.5])


def test_truncated_points_stand_on_their_curve_and_do_not_count_as_converged(tmp_path):
    status = [1, 7, 7, 1, 8]
    with Results(grid_file(tmp_path / "a.h5", n_gaps=1, status=status)) as results:
        fig = draw_response(results)
    assert {"2 converged", "2 truncated", "1 aliased"} <= set(legend_of(fig))
    x, axes = marks_of(fig, "truncated")
    np.testing.assert_array_equal(x, [2.0, 3.0])
    (line,) = curves_of(fig)
    assert axes == [line.axes] and np.isfinite(line.get_ydata()).all()
    drawn = next(line for line in axes[0].lines if line.get_gid() == "truncated")
    np.testing.assert_allclose(drawn.get_ydata(), [1.1, 1.2])


@pytest.mark.parametrize("status", [[18] * 5, [18, 1, 18, 1, 1], [18] * 50])
def test_motions_found_by_time_integration_are_answers(tmp_path, status):
    """They have no mark of a failure, and along a line of many points none at all."""
    path = grid_file(tmp_path / "a.h5", n_gaps=1, n_speeds=len(status), status=status)
    with Results(path) as results:
        fig = draw_response(results)
    n = status.count(18)
    assert {f"{n} found by time integration"} <= set(legend_of(fig)) and marks_of(fig, "integrated")[0].size == 0
    assert len(marks_of(fig, "found by time integration")[0]) == (n if n < 50 else 0)
    assert all(line.get_markersize() < 4.0 for line in fig.axes[0].lines if line.get_gid() == "found by time integration")


def test_dots_of_unstable_motions_are_open(tmp_path):
    """Also where an unstable motion stands between dashes on both sides, as an unstable neighbour of it does."""
    path = grid_file(tmp_path / "a.h5", n_gaps=1)
    with h5py.File(path, "r+") as file:
        file["is_stable"] = np.array([1, -1, -1, 1, 0], np.int32)
    with Results(path) as results:
        fig = draw_response(results)
    dots = {line.get_markerfacecolor(): line.get_xdata().tolist() for line in fig.axes[0].lines if line.get_gid() == "converged"}
    assert dots["white"] == [2.0, 3.0] and sorted(dots.values()) == [[1.0, 4.0], [2.0, 3.0], [5.0]]


def test_failures_stand_in_the_row_of_their_curve(tmp_path):
    status = np.ones(15, int)
    status[[2, 3]], status[11] = STALLED, FAILED
    with Results(grid_file(tmp_path / "a.h5", status=status)) as results:
        fig = draw_response(results)
    curves = curves_of(fig)
    (strip,) = (ax for ax in fig.axes if ax.get_xlabel())
    assert strip is not curves[0].axes
    rows = {line.get_gid(): line for line in strip.lines if line.get_gid()}
    samples = {line.get_ydata()[0]: line.get_color() for line in strip.lines if not line.get_gid()}
    assert samples == {0: curves[0].get_color(), 1: curves[2].get_color()}, "rows for the first and the last curve alone"
    np.testing.assert_array_equal(rows["stalled"].get_data(), ([3.0, 4.0], [0, 0]))
    np.testing.assert_array_equal(rows["failed"].get_data(), ([2.0], [1]))


def test_statuses_look_different_and_new_ones_have_a_look():
    names = [name for name in TEXTS if name not in ("converged", "unused")]
    looks = [mark(name, False).look(5.0) for name in names]
    assert len({look["marker"] for look in looks}) == len(names), "distinguished without colour"
    assert all(look["markerfacecolor"] != "white" for look in looks), "events of curves have open shapes"
    assert mark("struck_wall", True) != mark("struck_wall", False)


def test_a_status_of_a_newer_program_is_drawn_by_its_name(tmp_path):
    path = grid_file(tmp_path / "a.h5", n_gaps=1, status=[1, 1, len(STATUS_WORDS.split()), 1, 1])
    with h5py.File(path, "r+") as file:
        words = file["status"].attrs["flag_meanings"]
        words = (words.decode() if isinstance(words, bytes) else words) + " hit_too_hard"
        file["status"].attrs["flag_meanings"] = words
        file["status"].attrs["flag_values"] = np.arange(len(words.split()), dtype=np.int32)
    with Results(path) as results:
        fig = draw_response(results)
    assert "1 hit too hard" in legend_of(fig) and marks_of(fig, "hit_too_hard")[0].tolist() == [3.0]


def test_lines_are_broken_where_the_motion_jumps(tmp_path):
    path = grid_file(tmp_path / "a.h5", n_gaps=1, branch=[1, 1, 1, 2, 2])
    with Results(path) as results:
        (line,) = curves_of(draw_response(results))
    np.testing.assert_array_equal(line.get_xdata(), [1.0, 2.0, 3.0, np.nan, 4.0, 5.0])
    with Results(grid_file(tmp_path / "b.h5", n_gaps=1)) as results:
        (line,) = curves_of(draw_response(results))
    assert np.isfinite(line.get_xdata()).all(), "a file without this column is joined"
    branch = [1, 1, 2, 2, 2, 1, 1, 1, 2, 2, 1, 1, 1, 1, 0]
    with Results(grid_file(tmp_path / "c.h5", branch=branch)) as results:
        figures = [draw_response(results, over=over) for over in ("tones%frequency", "law(1)%gap")]
    along, across = map(curves_of, figures)
    note = "jumps are known along excitation frequency alone, not along gap of law 1"
    assert [note in head_of(figure) for figure in figures] == [False, True]
    assert [np.isnan(line.get_xdata()).sum() for line in along] == [1, 1, 0], "0 is not another branch, but none that is known"
    assert all(np.isfinite(line.get_xdata()).all() for line in across), "numbers along the fastest parameter alone"


def test_no_line_crosses_a_jump_where_stability_is_known(tmp_path):
    path = grid_file(tmp_path / "a.h5", n_gaps=2, branch=[1, 1, 1, 2, 2, 1, 1, 1, 1, 1])
    with h5py.File(path, "r+") as file:
        file["is_stable"] = np.ones(10, dtype=np.int32)
    with Results(path) as results:
        fig = draw_response(results, over="tones%frequency")
        across = draw_response(results, over="law(1)%gap", logarithmic="none")
    assert [line.get_xdata().tolist() for line in curves_of(fig)] == [[1.0, 2.0, 3.0], [4.0, 5.0], [1.0, 2.0, 3.0, 4.0, 5.0]]
    (legend,) = [c for ax in fig.axes for c in ax.get_children() if type(c).__name__ == "Legend"][:1]
    shown = {line.get_linestyle() for line in legend.get_lines()} - {"None"}
    assert shown == {"-"}, "the legend shows the lines as they are drawn"
    assert len(curves_of(across)) == 5


def test_a_hundred_curves_are_thinned(tmp_path):
    with Results(grid_file(tmp_path / "a.h5", n_gaps=100)) as results:
        fig = draw_response(results, over="tones%frequency")
        assert len(curves_of(fig)) == 7
        assert "7 of 100 curves over law(1)%gap: --where chooses" in head_of(fig)
        assert "0.1 m" in legend_of(fig) and "1.0e-3 m" in legend_of(fig), "both ends are among them"
        chosen = draw_response(results, over="tones%frequency", where={"law(1)%gap": "2e-3,7e-3"})
        assert len(curves_of(chosen)) == 2 and "gap of law 1 = 2.0e-3, 7.0e-3 m" in head_of(chosen)
        assert len(curves_of(draw_response(results, over="tones%frequency", n_curves=12))) == 12


def test_logarithmic_axes_report_omitted_points(tmp_path):
    path = grid_file(tmp_path / "a.h5", n_gaps=1)
    with h5py.File(path, "r+") as file:
        file["coefficients"][1] = 0.0
    with Results(path) as results:
        fig = draw_response(results, logarithmic="xy")
    (line,) = curves_of(fig)
    assert (line.axes.get_xscale(), line.axes.get_yscale()) == ("log", "log")
    assert "1 points with y = 0 or less cannot be drawn on a logarithmic axis" in head_of(fig)
    assert np.isnan(line.get_ydata()).tolist() == [False, True, False, False, False]


def test_several_files_stand_in_one_picture_with_their_labels(tmp_path, capsys):
    first, second = grid_file(tmp_path / "a.h5", 1), grid_file(tmp_path / "b.h5", 1, status=[1, 7, 1, 1, 1])
    with Results(first) as results, Results(second) as other:
        fig = draw_response(results, label="fine", others=[("coarse", other)])
    assert len(curves_of(fig)) == 2 and {"fine", "coarse", "9 converged", "1 truncated"} <= set(legend_of(fig))
    assert main(["response", f"fine:{first}", str(second), "--dpi", "30"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out == [
        f"{first}: 5 of 5 points converged",
        f"{second}: 4 of 5 points converged, 1 truncated",
        f"wrote {tmp_path / 'a_response.png'}",
    ]
    with h5py.File(second, "r+") as file:
        file["tones_frequency"].attrs["parameter"] = "tones%hertz"
    with Results(first) as results, Results(second) as other, pytest.raises(UsageError, match="give --over"):
        draw_response(results, others=[("", other)])


@pytest.mark.parametrize("words", [["--measure", "rms"], ["--tuple", "3,0"], ["--over", "solver_method"], ["--log", "y"]])
def test_response_measures(sweep, tmp_path, words):
    assert main(["response", str(sweep), "--dpi", "50", *words]) == 0
    assert (tmp_path / "sweep_response.png").stat().st_size > 5000


def test_points_without_the_harmonic_are_reported(sweep):
    with Results(sweep) as results:
        assert "1 solved points lack this harmonic" in head_of(draw_response(results, measure=Measure("harmonic", (3, 0))))


def test_response_needs_a_sweep(tmp_path, sweep):
    with Results(single(tmp_path / "a.h5", 1)) as results, pytest.raises(UsageError, match="a response needs a sweep"):
        draw_response(results)
    with Results(sweep) as results, pytest.raises(UsageError, match="none of the chosen points is solved"):
        draw_response(results, where={"solver_method": "broyden"})


def backbone_file(path):
    """Two modes of which the frequency grows with the energy."""
    energy = np.tile([0.01, 0.1, 1.0, 10.0], 2)
    mode = np.repeat([1.0, 2.0], 4)
    coefficients = np.zeros((8, 1, 2, 2))
    coefficients[:, 0, 1, 0] = np.sqrt(energy)
    parameters = {
        "normal_mode_energy": ("normal_mode%energy", "J", energy),
        "normal_mode_mode": ("normal_mode%mode", "", mode),
    }
    write_results(path, box(1, 1), (mode + 0.1 * energy)[:, None], coefficients, parameters=parameters)
    with h5py.File(path, "r+") as file:
        file["frequency_estimate"] = np.full((8, 1), 1e-9)
    return path


def test_backbone_draws_frequency_over_energy_with_units(tmp_path, monkeypatch):
    path, drawn = backbone_file(tmp_path / "a.h5"), []
    monkeypatch.setattr("nhbm_post.draw.save", lambda fig, *_, **__: drawn.append(fig) or tmp_path / "x.png")
    assert main(["backbone", str(path)]) == 0
    first, second = curves_of(drawn[0])
    np.testing.assert_allclose(first.get_ydata(), [1.001, 1.01, 1.1, 2.0])
    np.testing.assert_allclose(second.get_xdata(), [0.01, 0.1, 1.0, 10.0])
    ax = first.axes
    assert (ax.get_xscale(), ax.get_xlabel()) == ("log", "Energy of the normal mode $E$ [J]")
    assert ax.get_ylabel() == r"Frequency of the tone $\omega$ [rad/s]" and ax.get_ylim()[0] > 0.5
    assert main(["backbone", str(path), "--over", "amplitude"]) == 0
    np.testing.assert_allclose(curves_of(drawn[1])[0].get_xdata(), np.sqrt([0.01, 0.1, 1.0, 10.0]))
    assert curves_of(drawn[1])[0].axes.get_xlabel() == "Largest displacement of v3 [m]"


def test_backbone_needs_one(sweep, capsys):
    assert main(["backbone", str(sweep)]) == 2
    assert "neither normal_mode%amplitude nor normal_mode%energy is swept; give --over" in capsys.readouterr().err


def map_of(fig):
    """Values of the cells of the first mesh."""
    mesh = next(c for ax in fig.axes for c in ax.collections if type(c).__name__ == "QuadMesh")
    return mesh, np.ma.filled(mesh.get_array(), np.nan)


def test_map_holds_a_cell_a_point(tmp_path):
    status = np.ones(15, int)
    status[4], status[7] = TRUNCATED, STALLED
    with Results(grid_file(tmp_path / "a.h5", status=status)) as results:
        fig = draw_map(results)
    mesh, cells = map_of(fig)
    ax = mesh.axes
    expected = 1.0 + np.arange(3)[:, None] + 0.1 * np.arange(5)
    expected[1, 2] = np.nan
    np.testing.assert_allclose(cells.reshape(3, 5), expected)
    assert (ax.get_xlabel(), ax.get_ylabel()) == (r"Excitation frequency $\omega$ [rad/s]", "Gap of law 1 $g$ [mm]")
    np.testing.assert_allclose(ax.get_ylim(), [0.5, 3.5])
    np.testing.assert_allclose([line.get_data() for line in ax.lines if line.get_gid() == "truncated"], [[[5.0], [1.0]]])
    np.testing.assert_allclose([line.get_data() for line in ax.lines if line.get_gid() == "stalled"], [[[3.0], [2.0]]])
    assert {"1 truncated", "1 stalled"} <= set(legend_of(fig)) and "13 of 15 points converged" in head_of(fig)
    assert save(fig, tmp_path / "a.png", 50).stat().st_size > 5000


def test_logarithmic_colours_have_several_numbers(tmp_path):
    with Results(grid_file(tmp_path / "a.h5")) as results:
        fig = draw_map(results, logarithmic="z")
    save(fig, tmp_path / "a.png", 50)
    bar = next(ax for ax in fig.axes if ax.get_label() == "<colorbar>")
    low, high = bar.get_ylim()
    shown = [tick for tick in bar.yaxis.get_major_ticks() if low <= tick.get_loc() <= high and tick.label2.get_text()]
    assert len(shown) >= 3


def test_map_of_multipliers_shows_where_rest_is_unstable(tmp_path):
    path = grid_file(tmp_path / "a.h5")
    size = np.linspace(0.5, 1.5, 15)
    with h5py.File(path, "r+") as file:
        file["coefficients"][...] = 0.0
        file["multiplier_real"], file["multiplier_imag"] = np.stack([-size, 0.1 * size], axis=1), np.zeros((15, 2))
    with Results(path) as results:
        assert "all values are equal" in head_of(draw_map(results))
        fig = draw_map(results, measure=Measure("multiplier"))
    assert "Largest Floquet multiplier over" in head_of(fig)
    np.testing.assert_allclose(np.sort(map_of(fig)[1].ravel()), size)
    assert main(["map", str(path), "--measure", "multiplier", "--dpi", "40"]) == 0


def test_map_hatches_what_is_unstable(tmp_path):
    path = grid_file(tmp_path / "a.h5")
    with Results(path) as results:
        assert not any("unstable" in text for text in legend_of(draw_map(results)))
    with h5py.File(path, "r+") as file:
        file["is_stable"] = np.where(np.arange(15) % 5 > 2, -1, 1).astype(np.int32)
    with Results(path) as results:
        fig = draw_map(results)
    assert "6 unstable" in legend_of(fig)
    (hatched,) = [patch for ax in fig.axes for patch in ax.patches if patch.get_hatch()]
    np.testing.assert_allclose(hatched.get_path().get_extents().get_points(), [[3.5, 0.5], [5.5, 3.5]])  # whole cells


def test_map_shows_what_the_sweep_lacks(tmp_path):
    with Results(grid_file(tmp_path / "a.h5", n_points=13)) as results:
        fig = draw_map(results, over=("law(1)%gap", "tones%frequency"))
    assert "2 not in the sweep" in legend_of(fig)
    assert np.isnan(map_of(fig)[1]).sum() == 2


def test_an_equilibrium_is_named(tmp_path):
    with h5py.File(grid_file(tmp_path / "a.h5", n_gaps=1), "r+") as file:
        file["coefficients"][...] = 0.0
    with Results(tmp_path / "a.h5") as results:
        assert "zero at all points" in head_of(draw_response(results))
        assert info(results).splitlines()[-1].endswith("  0")


def test_map_leaves_pending_cells_blank(tmp_path):
    with Results(grid_file(tmp_path / "a.h5", status=[1] * 9 + [STALLED] + [0] * 5)) as results:
        fig = draw_map(results)
    assert "5 pending" in legend_of(fig) and "1 stalled" in legend_of(fig)
    assert [line.get_gid() for ax in fig.axes for line in ax.lines] == ["stalled"]


def test_map_needs_a_grid(sweep, tmp_path):
    with Results(grid_file(tmp_path / "a.h5", n_gaps=1)) as results, pytest.raises(UsageError, match="needs two parameters"):
        draw_map(results)
    path = grid_file(tmp_path / "b.h5")
    with h5py.File(path, "r+") as file:
        file["law_1_gap"][...] = 1e-3
        file["load"] = np.repeat(np.arange(3.0), 5)
        file["load"].attrs["parameter"] = "load(1)%cos"
    with Results(path) as results, pytest.raises(UsageError, match=r"share 5 cells .*; fix load\(1\)%cos by --where"):
        draw_map(results, over=("tones%frequency", "law(1)%gap"))


def test_map_by_command(tmp_path, capsys):
    path = grid_file(tmp_path / "a.h5")
    assert main(["map", str(path), "--over", "law(1)%gap,tones%frequency", "--log", "xyz", "--dpi", "40"]) == 0
    assert capsys.readouterr().out.splitlines() == ["15 of 15 points converged", f"wrote {tmp_path / 'a_map.png'}"]
    assert main(["map", str(path), "--over", "law(1)%gap,x"]) == 2


def test_time_reports_how_its_point_ended(tmp_path, monkeypatch):
    path, drawn = grid_file(tmp_path / "a.h5", n_gaps=1, status=[1, 7, 1, 1, 1]), []
    monkeypatch.setattr("nhbm_post.draw.save", lambda fig, *_, **__: drawn.append(fig) or tmp_path / "x.png")
    assert main(["time", str(path), "--point", "1"]) == 0
    assert "truncated: solved, but the truncation error exceeds its limit" in head_of(drawn[0])
    assert main(["time", str(path), "--point", "0,1"]) == 0
    legend = legend_of(drawn[1])
    of = "harmonic balance, excitation frequency = {}".format
    assert legend == [of("1 rad/s"), of("2 rad/s (truncated)")]
    assert main(["spectrum", str(path), "--point", "1"]) == 0
    assert "TRUNCATED" not in head_of(drawn[2]) and "truncated: solved" in head_of(drawn[2])
