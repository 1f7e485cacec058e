"""Curves that were followed: drawn along their arc, with folds, peaks and stability, beside backbones; their table."""

import h5py
import numpy as np
import pytest
from synthetic import box, write_results

from nhbm_post import ReaderError, Results
from nhbm_post.cli import main
from nhbm_post.draw import draw_response
from nhbm_post.draw.jumps import jumps_at_folds
from nhbm_post.measure import Measure
from nhbm_post.page import page_data
from nhbm_post.report import info

KINDS = (
    "none regular start fold peak value end branch period_doubling neimark_sacker symmetry_breaking grazing minimum amplitude "
    "resonance"
)
DESCRIPTION = {
    "flag_meanings": KINDS,
    "flag_labels": "none, regular, start, fold, peak, value, end, branch point, period doubling, Neimark-Sacker point, "
    "change of stability, grazing point, minimum, given amplitude, phase resonance",
    "flag_plurals": "none, regular, start, folds, peaks, value, end, branch points, period doublings, Neimark-Sacker points, "
    "changes of stability, grazing points, minima, given amplitudes, phase resonances",
    "flag_marks": "none none none circle up none none diamond square hexagon pentagon down left right octagon",
    "bifurcations": "fold branch period_doubling neimark_sacker symmetry_breaking",
}
START, REGULAR, FOLD, PEAK, END = 2, 1, 3, 4, 6
CONVERGED, UNUSED = 1, 17
# An S: up to the fold at 3, back to that at 2, up again. Two rows are not used.
VALUE = [1.0, 2.0, 3.0, 2.5, 2.0, 3.0, 4.0, np.nan, np.nan]
HEIGHT = [1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0, 0.0]
KIND = [START, REGULAR, FOLD, PEAK, FOLD, REGULAR, END, 0, 0]
STABLE = [1, 1, 0, -1, 0, 1, 1, 0, 0]


def curve_file(path, n_curves=1, stability=STABLE, value=VALUE, length=None):
    """One tone; curves of one shape, the k-th k + 1 times as high, its load k + 1."""
    n = len(value)
    coefficients = np.zeros((n * n_curves, 1, 2, 2))
    coefficients[:, 0, 1, 0] = np.outer(1.0 + np.arange(n_curves), HEIGHT).ravel()
    frequency = np.tile(value, n_curves)
    status = np.tile(np.where(np.isnan(value), UNUSED, CONVERGED), n_curves)
    parameters = {"tones_frequency": ("tones%frequency", "rad/s", frequency)}
    if n_curves > 1:
        parameters["load_1_cos"] = ("load(1)%cos", "N", np.repeat(1.0 + np.arange(n_curves), n))
    write_results(path, box(1, 1), frequency[:, None], coefficients, status=status, parameters=parameters)
    with h5py.File(path, "r+") as file:
        file["tones_frequency"].attrs["moves_along"] = "curve"
        file["curve_kind"] = np.tile(np.asarray(KIND, np.int32), n_curves)
        file["curve_kind"].attrs.update(DESCRIPTION)
        file["curve_length"] = np.tile(np.arange(n) * 1.0 if length is None else length, n_curves)
        if stability is not None:
            file["is_stable"] = np.tile(np.asarray(stability, np.int32), n_curves)
    return path


def lines(fig, gid):
    return [line for ax in fig.axes for line in ax.lines if line.get_gid() == gid]


def legend_of(fig):
    legends = [c for ax in fig.axes for c in ax.get_children() if type(c).__name__ == "Legend"]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def test_a_curve_is_drawn_along_its_arc(tmp_path):
    with Results(curve_file(tmp_path / "c.h5", stability=None)) as results:
        assert results.outcome_text() == "7 of 7 points converged"
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
        with pytest.raises(ReaderError, match="no point 8; points: 0-6"):
            results.point(8)
    [line] = lines(fig, "curve")
    assert line.get_xdata().tolist() == VALUE[:7] and line.get_ydata().tolist() == HEIGHT[:7]
    assert [x for fold in lines(fig, "fold") for x in fold.get_xdata()] == [3.0, 2.0]
    assert [x for peak in lines(fig, "peak") for x in peak.get_xdata()] == [2.5]
    assert "2 folds" in legend_of(fig) and "1 peak" in legend_of(fig) and "unstable" not in legend_of(fig)


def test_pending_points_of_a_curve_make_no_empty_row(tmp_path):
    path = curve_file(tmp_path / "c.h5", stability=None)
    with h5py.File(path, "r+") as file:
        file["status"][7:] = 0
    with Results(path) as results:
        fig = draw_response(results)
    assert "2 pending" in legend_of(fig) and len([ax for ax in fig.axes if ax.axison]) == 1


def test_info_has_rows_of_points_not_of_room(tmp_path):
    with Results(curve_file(tmp_path / "c.h5", stability=None)) as results:
        assert results.n_points > 7
        assert "more points" not in info(results)
        assert info(results, max_points=5).endswith("... 2 more points; --points 7 shows all")


def test_a_curve_followed_both_ways_is_one_line(tmp_path):
    length = [0.0, 1.0, 2.0, 3.0, -1.0, -2.0, -3.0, np.nan, np.nan]
    with Results(curve_file(tmp_path / "c.h5", stability=None, length=length)) as results:
        [line] = lines(draw_response(results, measure=Measure("harmonic", (1,))), "curve")
    assert line.get_xdata().tolist() == [4.0, 3.0, 2.0, 1.0, 2.0, 3.0, 2.5]


def test_bifurcations_and_grazes_are_marked(tmp_path):
    path = curve_file(tmp_path / "c.h5")
    with h5py.File(path, "r+") as file:
        file["curve_kind"][1:6] = [7, 8, 9, 10, 11]
    with Results(path) as results:
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
    for kind, position in (
        ("branch", 2.0),
        ("period_doubling", 3.0),
        ("neimark_sacker", 2.5),
        ("symmetry_breaking", 2.0),
        ("grazing", 3.0),
    ):
        assert [x for mark in lines(fig, kind) for x in mark.get_xdata()] == [position], kind
    assert {"1 period doubling", "1 Neimark-Sacker point", "1 change of stability", "1 grazing point"} <= set(legend_of(fig))


def test_unstable_parts_are_dashed(tmp_path):
    with Results(curve_file(tmp_path / "c.h5")) as results:
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
    pieces = {line.get_linestyle(): line.get_xdata().tolist() for line in lines(fig, "curve")}
    assert pieces["--"] == [3.0, 2.5, 2.0], "to and from what is unstable"
    assert sorted(pieces) == ["-", "--"] and "stability not known" not in legend_of(fig)
    assert {"stable", "unstable"} <= set(legend_of(fig))


def test_a_curve_of_unknown_stability_is_not_drawn_as_stable(tmp_path):
    first, other = curve_file(tmp_path / "c.h5"), curve_file(tmp_path / "d.h5", stability=None)
    with Results(first) as results, Results(other) as unknown:
        fig = draw_response(results, measure=Measure("harmonic", (1,)), others=[("d", unknown)])
        alone = draw_response(unknown, measure=Measure("harmonic", (1,)))
    assert lines(fig, "curve")[-1].get_linestyle() == ":" and "stability not known" in legend_of(fig)
    assert lines(alone, "curve")[0].get_linestyle() == "-" and "stability not known" not in legend_of(alone)


def test_a_curve_is_dotted_where_stability_was_sought_in_vain(tmp_path):
    path = curve_file(tmp_path / "c.h5", stability=[0] * 9)
    with h5py.File(path, "r+") as file:
        file["exponent"] = np.full((9, 2), np.nan)
    with Results(path) as results:
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
    assert {line.get_linestyle() for line in lines(fig, "curve")} == {":"} and "stability not known" in legend_of(fig)


def arrows(fig):
    return [(a.xyann, a.xy) for ax in fig.axes for a in ax.texts if a.get_gid() == "jump"]


def test_arrows_lead_from_folds_to_where_a_sweep_jumps(tmp_path):
    with Results(curve_file(tmp_path / "c.h5")) as results:
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
        over = draw_response(results, measure=Measure("harmonic", (1,)), over="amplitude")
    assert arrows(fig) == [((3.0, 3.0), (3.0, 2.0)), ((2.0, 3.0), (2.0, 2.0))]
    assert arrows(over) == []
    with Results(curve_file(tmp_path / "unknown.h5", stability=None)) as results:
        assert arrows(draw_response(results, measure=Measure("harmonic", (1,)))) == []
    with Results(curve_file(tmp_path / "next.h5", stability=[1, 0, 0, -1, 0, 1, 1, 0, 0])) as results:
        assert arrows(draw_response(results, measure=Measure("harmonic", (1,))))[0] == ((3.0, 3.0), (3.0, 2.0))


def test_a_kind_that_only_the_file_describes_is_drawn(tmp_path):
    """A new event of the program needs no change of the pictures: names and marks are attributes of the column."""
    path = curve_file(tmp_path / "new.h5")
    with h5py.File(path, "r+") as file:
        column = file["curve_kind"]
        column[3] = 15
        more = {"flag_meanings": " cusp", "flag_labels": ", cusp", "flag_plurals": ", cusps", "flag_marks": " pentagon"}
        column.attrs.update({name: column.attrs[name] + text for name, text in more.items()})
    with Results(path) as results:
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
        data = page_data(results)[0]
    assert [line.get_marker() for line in lines(fig, "cusp")] == ["p"] and "1 cusp" in legend_of(fig)
    assert data["events"]["cusp"] == ["pentagon", "cusp", "cusps"] and "cusp" in data["points"]["kind"]


def test_a_fold_beside_a_graze_has_its_jump():
    """The response of a stop turns back where it first touches: fold, graze and what is known lie in a row."""
    x = np.array([1.0, 2.0, 3.0, 2.5, 2.0, 2.01, 2.5, 3.5])
    y = np.array([3.0, 4.0, 6.0, 4.0, 2.1, 2.0, 1.0, 0.5])
    kind = np.array(["start", "regular", "fold", "regular", "fold", "grazing", "regular", "end"])
    found = jumps_at_folds(x, y, kind, np.array([1, 1, 0, -1, 0, 0, 1, 1]), ["fold"])
    assert found == [(3.0, 6.0, 0.75), (2.0, 2.1, 4.0)]


def test_a_graze_at_a_fold_has_the_stability_of_one_side():
    # a lower branch ends at a corner, where the unstable one with contact begins: the graze is still as unstable as that
    x = np.array([1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 2.0, 3.0, 5.0])
    y = np.array([1.0, 2.0, 3.0, 4.0, 1.5, 0.5, 0.5, 0.4, 0.3])
    kind = np.array("start regular regular fold regular fold grazing regular end".split())
    found = jumps_at_folds(x, y, kind, np.array([1, 1, 1, 0, -1, -1, -1, 1, 1]), ["fold"])
    assert (2.0, 0.5, 2.0) in found


def test_no_jump_leads_to_the_graze_at_its_fold():
    """Both at the same place up to rounding, and the stability of both known: the jump leads to the other branch."""
    x = np.array([1.0, 2.0, 3.0, 2.5, 2.0, 2.0 - 1e-13, 2.5, 3.5])
    y = np.array([3.0, 4.0, 6.0, 4.0, 2.1, 2.1, 1.0, 0.5])
    kind = np.array(["start", "regular", "fold", "regular", "fold", "grazing", "regular", "end"])
    found = jumps_at_folds(x, y, kind, np.array([1, 1, 0, -1, 1, 1, 1, 1]), ["fold"])
    assert found == [(3.0, 6.0, 0.75), (2.0, 2.1, 4.0)]


def test_families_and_backbones_share_a_picture(tmp_path):
    mode = tmp_path / "mode.h5"
    coefficients = np.zeros((3, 1, 2, 2))
    coefficients[:, 0, 1, 0] = [1.0, 2.0, 3.0]
    amplitude = {"normal_mode_amplitude": ("normal_mode%amplitude", "m", np.array([1.0, 2.0, 3.0]))}
    write_results(mode, box(1, 1), [[1.1], [1.2], [1.5]], coefficients, parameters=amplitude)
    with h5py.File(mode, "r+") as file:
        file["frequency_estimate"] = np.full((3, 1), 1e-9)
    with Results(curve_file(tmp_path / "c.h5", 2, stability=None)) as results, Results(mode) as modes:
        fig = draw_response(results, measure=Measure("harmonic", (1,)), others=[("mode", modes)], label="forced")
    drawn = lines(fig, "curve")
    assert [line.get_xdata().tolist() for line in drawn] == [VALUE[:7], VALUE[:7], [1.1, 1.2, 1.5]]
    assert drawn[1].get_ydata().tolist() == [2.0 * y for y in HEIGHT[:7]]
    assert any("amplitude of load 1 = 1 N" in text for text in legend_of(fig)), legend_of(fig)


def test_peaks_are_a_table(tmp_path, capsys):
    curve_file(tmp_path / "c.h5", 2)
    assert main(["peaks", str(tmp_path / "c.h5"), "--tuple", "1"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[2] for row in rows[1:]] == 2 * ["start", "fold", "peak", "fold", "end"]
    assert rows[3] == ["3", "1", "peak", "2.5", "no", "converged", "4"]
    assert rows[8] == ["12", "2", "peak", "2.5", "no", "converged", "8"]


def test_peaks_need_a_curve(sweep):
    from nhbm_post.report import peaks

    with Results(sweep) as results, pytest.raises(ReaderError, match="no curve was followed"):
        peaks([("", results)], Measure("rms"))


def test_parts_of_a_curve_that_jumps_are_one(tmp_path):
    """In one colour, with a gap and an arrow from the fold to the start of the next part; the arc of each part begins at zero."""
    path = tmp_path / "jump.h5"
    value = np.array([1.0, 2.0, 3.0, 3.1, 4.0, 5.0])
    coefficients = np.zeros((6, 1, 2, 2))
    coefficients[:, 0, 1, 0] = [1.0, 2.0, 3.0, 0.5, 0.4, 0.3]
    parameters = {"tones_frequency": ("tones%frequency", "rad/s", value)}
    words = "&curve\n   parameter = 'tones%frequency'\n   jump = .true.\n/\n"
    write_results(path, box(1, 1), value[:, None], coefficients, parameters=parameters, input_groups=words)
    with h5py.File(path, "r+") as file:
        file["tones_frequency"].attrs["moves_along"] = "curve"
        file["curve_kind"] = np.array([START, REGULAR, FOLD, START, REGULAR, END], np.int32)
        file["curve_kind"].attrs.update(DESCRIPTION)
        file["curve_length"] = [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]
        file["curve_branch"] = np.array([0, 0, 0, 1, 1, 1], np.int32)
    with Results(path) as results:
        fig = draw_response(results, measure=Measure("harmonic", (1,)))
    [line] = lines(fig, "curve")
    assert np.isnan(line.get_ydata()).sum() == 1 and np.allclose(line.get_ydata()[:3], [1.0, 2.0, 3.0])
    assert [text.xy for ax in fig.axes for text in ax.texts if text.get_gid() == "jump"] == [(3.1, 0.5)]
