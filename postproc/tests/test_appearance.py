"""What axes are called, units, line styles, and the options that all pictures share."""

import os
import shutil

import numpy as np
import pytest
from conftest import single
from synthetic import box, write_results

from nhbm_post import Results
from nhbm_post.appearance import appearance
from nhbm_post.axis_words import with_symbol, words_of
from nhbm_post.cli import main
from nhbm_post.draw import draw_correction, draw_response, relabel, save
from nhbm_post.draw import style as look
from nhbm_post.measure import Measure


def response(path, name="tones%frequency", unit="rad/s", groups="", amplitudes=(1.0, 2.0, 0.5), **more):
    n = len(amplitudes)
    coefficients = np.zeros((n, 2, 2, 2))
    coefficients[:, 0, 1, 0] = amplitudes
    coefficients[:, 1, 1, 0] = 1e-17
    parameters = {name.replace("%", "_"): (name, unit, 2.0 * np.pi * np.arange(1.0, n + 1.0))}
    frequency = 2.0 * np.pi * np.arange(1.0, n + 1.0)[:, None]
    return write_results(
        path, box(1, 1), frequency, coefficients, dofs=("v3", "v5"), parameters=parameters, input_groups=groups, **more
    )


@pytest.mark.parametrize(
    "path, label",
    [
        ("tones%hertz", "Excitation frequency $f$"),
        ("tones%frequency(2)", r"Excitation frequency 2 $\omega_{2}$"),
        ("law(stop)%gap", "Gap of stop $g$"),
        ("law(2)%stiffness", "Stiffness of law 2 $k$"),
        ("load(1)%cos", "Amplitude of load 1 $F$"),
        ("load%cos", "Amplitude of the load $F$"),
        ("solver%method", "Method of the solver"),
        ("law(pump)%stiffness_cos", "Stiffness amplitude of pump $k$"),
        ("structure%stiffness(3)", "Stiffness of the structure, entry 3 $k$"),
        ("amplitude", "Amplitude"),
    ],
)
def test_axes_are_in_words(path, label):
    assert with_symbol(*words_of(path)) == label


@pytest.mark.parametrize(
    "groups, label, last", [("", r"$\omega$ [rad/s]", 6 * np.pi), ("&tones\n   hertz = 1.0\n/\n", "$f$ [Hz]", 3.0)]
)
def test_frequencies_are_in_hertz_where_the_input_has_hertz(tmp_path, groups, label, last):
    with Results(response(tmp_path / "a.h5", groups=groups)) as results:
        over = draw_response(results)
        of = draw_response(results, measure=Measure("frequency"))
    ax = next(ax for ax in over.axes if ax.get_xlabel())
    assert ax.get_xlabel() == f"Excitation frequency {label}"
    assert max(line.get_xdata().max() for line in ax.lines if line.get_gid() == "curve") == pytest.approx(last)
    ax = next(ax for ax in of.axes if ax.get_xlabel())
    assert ax.get_ylabel() == f"Frequency of the tone {label}"
    assert max(line.get_ydata().max() for line in ax.lines if line.get_gid() == "curve") == pytest.approx(last)


def test_noise_is_zero(tmp_path):
    """Beside a motion of 1 m a coefficient of 1e-17 m is nothing."""
    path = response(tmp_path / "a.h5")
    with Results(path) as results:
        assert Measure().values(results, "v5").tolist() == [0.0, 0.0, 0.0]
        assert Measure().values(results, "v3") == pytest.approx([1.0, 2.0, 0.5])
        ax = next(ax for ax in draw_response(results, "v5").axes if ax.get_ylabel())
    assert "10^" not in ax.get_ylabel()
    assert main(["spectrum", str(path), "--dof", "v5", "--form", "stem"]) == 2


def test_jumps_of_a_sweep_are_marked(tmp_path):
    import h5py

    path = response(tmp_path / "a.h5", amplitudes=(1.0, 2.0, 0.5, 0.4))
    with h5py.File(path, "a") as file:
        file.create_dataset("branch", data=np.array([1, 1, 2, 2]))
    with Results(path) as results:
        ax = next(ax for ax in draw_response(results).axes if ax.get_xlabel())
    (arrow,) = (text for text in ax.texts if text.get_gid() == "jump")
    assert arrow.xyann == pytest.approx((4 * np.pi, 2.0)) and arrow.xy == pytest.approx((6 * np.pi, 0.5))


def test_line_styles_have_one_meaning(tmp_path):
    styles = [look.STABLE, look.UNSTABLE, look.UNKNOWN, look.REFERENCE]
    assert len(set(map(str, styles))) == 4
    files = [Results(response(tmp_path / f"{name}.h5")) for name in "abc"]
    fig = draw_response(files[0], label="a", others=[("b", files[1]), ("c", files[2])])
    curves = [line for ax in fig.axes for line in ax.lines if line.get_gid() == "curve"]
    assert {line.get_linestyle() for line in curves} == {"-"} and len({line.get_color() for line in curves}) == 3


def test_paper_has_its_width_and_no_heading(tmp_path):
    path = response(tmp_path / "a.h5")
    with Results(path) as results, appearance(is_paper=True):
        fig = draw_response(results)
        assert fig.get_figwidth() * 25.4 == pytest.approx(90.0)
        assert not fig.texts and fig.nhbm_caption.startswith("Largest |v3| over excitation frequency. synthetic")
    with Results(path) as results, appearance(title="Mine", width=120.0):
        fig = draw_response(results)
    assert fig.get_figwidth() * 25.4 == pytest.approx(120.0) and fig.texts[0].get_text() == "Mine"


def test_fixed_parts_shrink_as_a_whole(tmp_path):
    from conftest import walled

    with Results(walled(tmp_path / "a.h5", 2)) as results, appearance(width=120.0):
        fig = draw_correction(results, 0, view="map", n_samples=16)
        native, size = fig.get_figwidth(), fig.texts[0].get_fontsize()
        save(fig, tmp_path / "a.png", dpi=40)
    assert fig.get_figwidth() * 25.4 == pytest.approx(120.0)
    assert fig.texts[0].get_fontsize() == pytest.approx(size * 120.0 / 25.4 / native)


def test_options_of_all_pictures(tmp_path, capsys):
    path = response(tmp_path / "a.h5")
    assert main(["response", str(path), "--style", "paper", "--label", "x=Speed n [1/min]", "--label", "y=Motion [m]"]) == 0
    printed = capsys.readouterr().out
    assert "caption: Largest |v3|" in printed and (tmp_path / "a_response.pdf").read_bytes().startswith(b"%PDF")
    with Results(path) as results:
        fig = draw_response(results)
    relabel(fig, {"x": "Speed", "y": "Motion"})
    assert [(ax.get_xlabel(), ax.get_ylabel()) for ax in fig.axes if ax.get_xlabel()] == [("Speed", "Motion")]
    assert main(["response", str(path), "--label", "z=Colour"]) == 2
    assert "has no z axis" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["response", str(path), "--label", "Colour"])


@pytest.mark.parametrize("options", [["--width", "5"], ["--width", "0.1"], ["--title", 3000 * "x"]], ids=["5", "0.1", "title"])
def test_texts_that_do_not_fit_are_an_error_of_the_user(tmp_path, capsys, options):
    """Matplotlib's solver of layouts would end in a traceback."""
    path = response(tmp_path / "a.h5")
    assert main(["response", str(path), *options]) == 2
    assert capsys.readouterr().err.startswith("nhbm-post response: the texts do not fit into the picture")
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize("n_tones", [1, 2])
def test_motion_over_time_is_in_words(tmp_path, n_tones):
    path = single(tmp_path / "a.h5", n_tones)
    with Results(path) as results:
        assert results.series(0, "v3").axis_label == "Displacement v3"
        assert results.series(0, "v3", "force").axis_label == "Law force on v3"


def test_pictures_in_a_plane_need_no_mplot3d():
    """A newer matplotlib beside the system's finds the mpl_toolkits of that, which fail."""
    import subprocess
    import sys

    script = (
        "import sys\nsys.modules['mpl_toolkits'] = None\n"
        "try:\n    import matplotlib.projections\nexcept ImportError:\n    sys.exit()  # before 3.7 matplotlib itself needs it\n"
        "import nhbm_post.draw"
    )
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-W", "ignore", "-c", script], check=True, env=here)


def test_slender_things_are_no_slivers():
    """A bar is drawn in a box of its own shape, but none thinner than 0.3 of its length; a narrow patch is not to scale."""
    from types import SimpleNamespace

    from nhbm_post.draw import draw_deflection, draw_patch

    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0.01, 0], [0, 0.01, 0]])
    bar = SimpleNamespace(points=points, cells=[(9, [0, 1, 2, 3])])
    moved = np.column_stack([np.zeros((4, 2)), [0.0, 0.1, 0.1, 0.0]])
    ax = draw_deflection(bar, moved, ("amplitude", moved[:, 2]), "Motion", "").axes[0]
    sides = np.array([np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())])
    assert sides.min() >= 0.29 * sides.max() and np.array(ax._box_aspect) / sides == pytest.approx(ax._box_aspect[0] / sides[0])
    patch = SimpleNamespace(label="joint", kind="jenkins", counted="4 nodes")
    for width, aspect in ((0.01, "auto"), (0.5, 1.0)):
        ax = draw_patch(patch, {"open share": np.ones(4)}, points * [1.0, 100.0 * width, 1.0], "").axes[0]
        assert ax.get_aspect() == aspect


def test_forces_that_are_zero_have_no_scale():
    """Nodes that are never loaded: the colour bar names zero alone, no numbers of both signs."""
    from types import SimpleNamespace

    from nhbm_post.draw import draw_patch

    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    patch = SimpleNamespace(label="stop", kind="elastic_stop", counted="4 nodes")
    bar = draw_patch(patch, {"largest normal force": np.zeros(4)}, points, "").axes[0].child_axes[0]
    assert bar.get_yticks().tolist() == [0.0]


def test_details_of_a_heading_break_at_commas():
    line = "Two-tone beam against a rigid wall, point 3, order of the harmonics = 12, samples per period = 64"
    assert look.rows_of(line, 96) == [line.rpartition(" samples")[0], "samples per period = 64"]
    assert look.rows_of(line, 100) == [line]
    assert look.rows_of("a " * 20, 20) == ["a a a a a a a a a a", "a a a a a a a a a a"]


def test_a_style_file_sets_fonts_and_sizes(tmp_path, capsys, monkeypatch):
    """Settings of matplotlib from a file, also on paper; those of the user for other pictures have no effect."""
    path = response(tmp_path / "a.h5")
    style = tmp_path / "journal.mplstyle"
    style.write_text("font.family: serif\nfont.serif: DejaVu Serif\nfont.size: 11\naxes.labelsize: 13\nsvg.fonttype: none\n")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "matplotlibrc").write_text("axes.labelsize: 30\n")
    sizes = {}
    for name, styles in {"plain": [], "own": ["--style", str(style)], "paper": ["--style", "paper", "--style", str(style)]}.items():
        assert main(["response", str(path), "-o", f"{name}.svg", *styles]) == 0
        text = (tmp_path / f"{name}.svg").read_text()
        sizes[name] = "13px" in text, "DejaVu Serif" in text, "30px" in text
    assert sizes == {"plain": (False, False, False), "own": (True, True, False), "paper": (True, True, False)}
    capsys.readouterr()
    style.write_text("font.size: 11\naxes.labelsiez: 13\n")
    assert main(["response", str(path), "-o", "a.svg", "--style", str(style)]) == 2
    assert "axes.labelsiez" in capsys.readouterr().err
    assert main(["response", str(path), "-o", "a.svg", "--style", "papre"]) == 2
    assert "neither screen, paper nor" in capsys.readouterr().err


def test_a_font_that_is_not_installed_is_reported_once(tmp_path, caplog):
    """Matplotlib reported it for each text."""
    path, style = response(tmp_path / "a.h5"), tmp_path / "journal.mplstyle"
    style.write_text("font.family: No Such Font\n")
    for _ in range(2):
        caplog.clear()
        assert main(["response", str(path), "-o", str(tmp_path / "a.png"), "--style", str(style)]) == 0
        texts = [record.getMessage() for record in caplog.records if "No Such Font" in record.getMessage()]
        assert texts and len(texts) == len(set(texts))


def test_pictures_for_latex(tmp_path, capsys):
    """With the texts as LaTeX sets them; where it is not installed that is said."""
    path = response(tmp_path / "a.h5")
    status = main(["response", str(path), "-o", str(tmp_path / "a.pgf")])
    if shutil.which("pdflatex") is None:
        assert status == 2 and "needs pdflatex" in capsys.readouterr().err and not (tmp_path / "a.pgf").exists()
        return
    assert status == 0
    text = (tmp_path / "a.pgf").read_text()
    assert r"\begin{pgfpicture}" in text and "Excitation frequency" in text
