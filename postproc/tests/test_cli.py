"""The command line: what it prints, the files it names, and one line with status 2 for mistakes."""

import errno
import os
import shutil
import signal
import subprocess
import sys

import h5py
import numpy as np
import pytest
from conftest import single, walled

from nhbm_post import Results, verbs
from nhbm_post.cli import main
from nhbm_post.draw.time_history import read_record
from nhbm.child_process import run_in_child_process


def run(capsys, *words):
    """(status, stdout, stderr) of a call."""
    try:
        status = main([str(word) for word in words])
    except SystemExit as stop:
        status = stop.code
    out, err = capsys.readouterr()
    return status, out, err


def test_value_prints_all_digits(sweep, capsys):
    status, out, _ = run(
        capsys,
        "value",
        sweep,
        "--dof",
        "v3",
        "--tuple",
        "1,-2",
        "--at",
        "law_1_gap=1.5e-3",
        "--at",
        "solver_method=newton",
    )
    cos, sin, amplitude = (float(word) for word in out.split())
    with Results(sweep) as results:
        assert status == 0 and (cos, sin) == results.coefficients(1, "v3", (1, -2))
    assert amplitude == np.hypot(cos, sin)
    assert all(len(word.lstrip("-").split("e")[0]) == 18 for word in out.split())


def test_an_input_is_never_replaced(sweep, tmp_path, capsys):
    (tmp_path / "link.html").symlink_to(sweep)
    before = sweep.read_bytes()
    for output in (sweep, tmp_path / "link.html"):
        status, _, err = run(capsys, "report", sweep, "-o", output)
        assert status == 2 and f"'{output}' is an input of this command" in err
    assert sweep.read_bytes() == before


def test_value_accepts_mirrored_tuples(sweep, capsys):
    _, out, _ = run(capsys, "value", sweep, "--tuple", "1,0")
    _, mirrored, _ = run(capsys, "value", sweep, "--tuple", "-1,0")
    cos, sin, _ = (float(word) for word in out.split())
    assert [float(word) for word in mirrored.split()][:2] == [cos, -sin]


def test_info_reports_what_is_in_a_file(sweep, capsys):
    status, out, _ = run(capsys, "info", sweep)
    assert status == 0
    for part in (
        "sweep of the gap",
        "nhbm 0.1.0",
        "swept      law(1)%gap: 3 values, 1.0e-3 to 2.0e-3 m",
        "swept      solver%method: 2 values, 'newton' to 'broyden'",
        "law(1)%gap [m]",
        "v1, v3",
        "6: 1 pending, 3 converged, 1 stalled, 1 failed",
        "dgetrf: singular matrix",
        "1.00e-11",
    ):
        assert part in out
    _, short, _ = run(capsys, "info", sweep, "--points", 2)
    assert "... 4 more points" in short and len(short.splitlines()) == len(out.splitlines()) - 3


def test_info_reports_unknown_frequencies_with_their_digits(sweep, capsys):
    with h5py.File(sweep, "r+") as file:
        estimates = file.create_dataset("frequency_estimate", data=np.full((6, 2), np.nan))
        estimates[:2] = [0.0, 2.0e-7]
        file["frequency"][2, 1] = np.nan
        file["status"][2] = 10
        file["message"][2] = np.frombuffer(b"damped at all amplitudes".ljust(file["message"].shape[1], b"\0"), dtype="S1")
    _, out, _ = run(capsys, "info", sweep)
    assert "tone 2 [rad/s]" in out and "tone 1" not in out
    assert "3.1415927 " in out
    assert "collapsed" in out and "damped at all amplitudes" in out


@pytest.mark.parametrize(
    "words",
    [
        ["spectrum"],
        ["spectrum", "--form", "bars"],
        ["spectrum", "--over", "frequency"],
        pytest.param(["correction"], marks=pytest.mark.long),
        ["correction", "--view", "map"],
        ["time", "--level", "-1e-3"],
    ],
)
def test_picture_is_named_after_the_file(tmp_path, capsys, words):
    path = walled(tmp_path / "beam.h5", 2)
    status, out, err = run(capsys, words[0], path, *words[1:], "--dpi", 50)
    picture = tmp_path / f"beam_{words[0]}.png"
    assert (status, out, err) == (0, f"wrote {picture}\n", "")
    assert picture.stat().st_size > 5000


@pytest.mark.long
def test_response_writes_a_pdf(sweep, tmp_path, capsys):
    status, _, _ = run(capsys, "response", sweep, "--tuple", "1,0", "-o", tmp_path / "r.pdf")
    assert status == 0 and (tmp_path / "r.pdf").read_bytes().startswith(b"%PDF")


def test_time_overlays_points_files_and_records(sweep, tmp_path, capsys):
    other = single(tmp_path / "other.h5", 2)
    record = tmp_path / "integration.csv"
    t = np.linspace(0.0, 30.0, 400)
    record.write_text("t,v1,v3\n" + "\n".join(f"{a},0,{1e-3 * np.cos(a)}" for a in t))
    status, _, err = run(
        capsys,
        "time",
        sweep,
        "--point",
        "0,1,2",
        "--overlay",
        f"time integration:{record}",
        "--overlay",
        other,
        "--from",
        2,
        "--to",
        9,
        "--difference",
        "--dpi",
        50,
    )
    assert (status, err) == (0, "")
    assert (tmp_path / "sweep_time.png").stat().st_size > 5000


def test_time_writes_a_table_that_it_reads_again(sweep, tmp_path, capsys):
    table = tmp_path / "v3.csv"
    words = ("time", sweep, "--dof", "v3", "--from", 2, "--to", 9, "--samples", 50, "-o", table)
    assert run(capsys, *words, "--point", 1) == (0, f"wrote {table}\n", "")
    with Results(sweep) as results:
        expected = results.series(1, "v3").evaluate(np.linspace(2.0, 9.0, 50))
        units = results.series(1, "v3").units
    assert table.read_text().startswith(f"t [s],v3 [{units}]\n2,")
    record = read_record(table, "v3")
    assert (record.t[-1], record.x.size) == (9.0, 50)
    np.testing.assert_allclose(record.x, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert run(capsys, *words, "--point", "0,2")[0] == 0
    assert table.read_text().startswith(f"t [s],v3 at point 0 [{units}],v3 at point 2 [{units}]\n")
    status, _, err = run(capsys, *words, "--overlay", sweep)
    assert status == 2 and "leave --overlay" in err


def integration_record(path, t, x, dof="v3"):
    with h5py.File(path, "w") as file:
        file.attrs["kind"], file.attrs["method"] = "integration", "runge_kutta_4"
        file["time"], file["displacement"], file["dof"] = t, x[None, :], [dof]
    return path


def test_a_picture_over_time_shows_few_motions(capsys, sweep, tmp_path, monkeypatch):
    """Many had a legend taller than the picture."""
    monkeypatch.setattr(verbs, "_MOST_MOTIONS", 1)
    chosen = ("time", sweep, "--at", "law(1)%gap=1.5e-3")
    status, _, err = run(capsys, *chosen)
    assert status == 2 and "2 points are chosen, of which a picture shows 1 at most: choose fewer by --point" in err
    assert "a picture shows" not in run(capsys, *chosen, "-o", tmp_path / "table.csv")[2]


def test_time_lays_an_integration_below_with_the_difference(sweep, tmp_path, capsys, monkeypatch):
    t = np.linspace(5.0, 30.0, 4000)
    with Results(sweep) as results:
        series = results.series(1, "v3")
    record = integration_record(tmp_path / "integration.h5", t, series.evaluate(t) + 2e-9 * np.cos(t))
    drawn = []
    monkeypatch.setattr("nhbm_post.draw.save", lambda fig, *_, **__: drawn.append(fig) or tmp_path / "x.png")
    status, _, err = run(capsys, "time", sweep, "--point", 1, "--dof", "v3", "--integration", record)
    assert (status, err) == (0, "")
    motion, difference = drawn[0].axes
    assert "time integration, runge kutta 4" in [text.get_text() for text in motion.get_legend().get_texts()]
    assert difference.get_title("left") == "difference to time integration, runge kutta 4: largest 2 nm"
    assert motion.get_xlim()[1] == pytest.approx(30.0)


def test_a_record_is_described_and_drawn(tmp_path, capsys, monkeypatch):
    t = np.linspace(0.0, 30.0, 4000)
    record, drawn = integration_record(tmp_path / "integration.h5", t, 0.5 * np.cos(2.0 * t)), []
    with h5py.File(record, "r+") as file:
        file.attrs.update(program_version="1", git_commit="0", created_utc="now", title="", schema_version=1)
        file["frequency"], file["tuple"], file["input_text"] = [2.0], [[0], [1]], "&tones hertz = 1 /"
        file["coefficients"] = [[[0.0, 0.0], [0.5, 0.0]]]
        file["coefficients"].attrs["units"] = "m"
        file["peak_frequency"], file["peak_coefficients"] = [[2.0, 3.5]], [[[0.3, -0.4], [0.0, 0.125]]]
    assert "peaks      0.5 at 2, 0.125 at 3.5 rad/s of v3" in run(capsys, "info", record)[1].splitlines()
    monkeypatch.setattr("nhbm_post.draw.save", lambda fig, *_, **__: drawn.append(fig) or tmp_path / "x.png")
    assert run(capsys, "time", record)[0] == 0 and run(capsys, "spectrum", record, "--over", "frequency")[0] == 0
    record_line, harmonics = drawn[0].axes[0].lines
    np.testing.assert_allclose(np.interp(record_line.get_xdata(), *harmonics.get_data()), record_line.get_ydata(), atol=1e-3)
    assert drawn[1].axes[0].get_xlabel() == "Frequency $f$ [Hz]"
    table = tmp_path / "record.csv"
    assert run(capsys, "time", record, "--from", t[1], "-o", table)[0] == 0
    assert table.read_text().splitlines()[0] == "t [s],v3 [m]"
    np.testing.assert_array_equal(np.loadtxt(table, delimiter=",", skiprows=1), np.stack([t, 0.5 * np.cos(2.0 * t)], axis=1)[1:])
    assert "holds its own times" in run(capsys, "time", record, "--samples", 5, "-o", table)[2]
    status, _, err = run(capsys, "time", record, "--point", 0)
    assert status == 2 and "leave --point, --at and --of out" in err
    assert "info, time and spectrum read it" in run(capsys, "orbit", record)[2]


def test_unconverged_points_are_drawn_only_on_request(sweep, capsys):
    assert run(capsys, "spectrum", sweep, "--point", 3)[0] == 2
    assert run(capsys, "spectrum", sweep, "--point", 3, "--unconverged")[0] == 0
    assert run(capsys, "spectrum", sweep, "--point", 4, "--unconverged")[0] == 2


@pytest.mark.parametrize(
    "words, message",
    [
        (["info", "none.h5"], "none.h5: no such file"),
        (["spectrum", "FILE", "--dof", "v9"], "stored: v1, v3"),
        (["spectrum", "FILE", "--point", "9"], "no point 9; points: 0-5"),
        (["spectrum", "FILE", "--point", "4"], "status failed: dgetrf: singular matrix"),
        (["spectrum", "FILE", "--point", "5"], "status pending"),
        (["spectrum", "FILE", "--point", "-1"], "-1 is less than 0"),
        (["spectrum", "FILE", "--point", "x"], "invalid whole number value: 'x'"),
        (["spectrum", "FILE", "--form", "bars", "--over", "frequency"], "needs 2 tones and tuples as axes"),
        (["spectrum", "FILE", "--output", "a.gif"], "must end in .png"),
        (["time", "FILE", "--output", "a.xlsx"], "must end in .png, .pdf, .svg, .pgf, or in .csv for the numbers"),
        (["spectrum", "FILE", "--output", "none/a.png"], "cannot write 'none/a.png'"),
        (["spectrum", "FILE", "--decades", "-3"], "-3 is not between 0 and 1000"),
        (["value", "FILE"], "--tuple"),
        (["value", "FILE", "--tuple", "1,x"], "'1,x' is not a tuple of integers"),
        (["value", "FILE", "--tuple", "1,0,0"], "the file has 2 tones"),
        (["value", "FILE", "--tuple", "9,9"], "tuple (9,9) is not in the set of point 0"),
        (["value", "FILE", "--tuple", "1,0", "--at", "law_1_gap"], "'law_1_gap' is no PARAMETER=VALUE"),
        (["value", "FILE", "--tuple", "1,0", "--at", "law_1_gap=abc"], "no point with law(1)%gap = abc"),
        (
            ["value", "FILE", "--tuple", "1,0", "--at", "law_1_gap=1e-3"],
            "fits points 0, 3; give also solver%method",
        ),
        (["value", "FILE", "--tuple", "1,0", "--at", "law_1_gap=1e-3", "--point", "1"], "not allowed with"),
        (["correction", "FILE", "--dof", "v1"], "stored: v3"),
        (["time", "FILE", "--from", "3", "--to", "1"], "window is empty"),
        (["time", "FILE", "--point", "0,a"], "'0,a' is not a list of points"),
        (["time", "FILE", "--overlay", "none.csv"], "none.csv: cannot be read as text"),
        (["time", "FILE", "--overlay", "FILE", "--dof", "v9"], "stored: v1, v3"),
        (["time", "FILE", "--integration", "none.h5"], "cannot be read as a record"),
        (["time", "FILE", "--integration", "FILE"], "is not a record of nhbm integrate"),
        (["time", "FILE", "--integration", "FILE", "--of", "force"], "--integration compares motions"),
        (["response", "FILE", "--over", "x"], "no swept parameter 'x'"),
        (["response", "FILE", "--measure", "harmonic"], "belong together"),
        (["response", "FILE", "--tuple", "1"], "has 2 tones"),
        (["response", "FILE", "--tuple", "8,8"], "in the set of no converged point"),
        (["frobnicate"], "invalid choice: 'frobnicate'"),
        ([], "COMMAND"),
    ],
)
def test_mistakes_give_one_line_and_status_2(sweep, tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *(sweep if word == "FILE" else word for word in words))
    assert status == 2 and out == ""
    assert err.startswith("nhbm-post") and err.count("\n") == 1 and message in err


@pytest.mark.parametrize("text", ["", "t,x\n", "t,x\n0,1\n", "t,x\n0,1\n1,abc\n", "0\n1\n", "0,nan\n1,2\n"])
def test_bad_records_give_one_line(sweep, tmp_path, capsys, text):
    record = tmp_path / "r.csv"
    record.write_text(text)
    status, _, err = run(capsys, "time", sweep, "--overlay", record)
    assert status == 2 and err.count("\n") == 1 and "r.csv" in err


@pytest.mark.parametrize("command", ["info", "value", "correction", "time", "spectrum", "response"])
def test_help_prints_text(capsys, command):
    status, out, _ = run(capsys, command, "--help")
    assert status == 0 and len(out) > 500


def test_a_full_device_is_no_damaged_file(sweep):
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "nhbm_post", "info", str(sweep)]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2 and "standard output cannot be written" in done.stderr and "damaged" not in done.stderr


def test_runs_as_a_module_without_display(sweep):
    call = [sys.executable, "-m", "nhbm_post", "info", str(sweep)]
    done = subprocess.run(
        call, capture_output=True, text=True, env={"PYTHONPATH": ":".join(sys.path)}, check=True
    )
    assert "sweep of the gap" in done.stdout


def test_a_child_process_opens_open_files_again(tmp_path):
    """The newest h5py does so for each dataset that is met in a loop."""
    with h5py.File(tmp_path / "some.h5", "w") as file:
        file["x"] = 1.0

    def again() -> int:
        with h5py.File(tmp_path / "some.h5", "r") as file:
            return 0 if h5py.File(file.id).filename == file.filename else 7

    assert run_in_child_process(again, "program") == 0


def test_child_process_errors_are_reported(capfd):
    assert run_in_child_process(lambda: 1 // 0, "program") == 1
    assert "ZeroDivisionError" in capfd.readouterr().err
    assert run_in_child_process(lambda: os.kill(os.getpid(), signal.SIGSEGV), "program") == 2
    assert capfd.readouterr().err.endswith("program: ended by SIGSEGV\n")


def test_a_picture_that_cannot_be_written_leaves_the_old_one(sweep, tmp_path, monkeypatch, capsys):
    path = tmp_path / "old.png"
    path.write_bytes(b"old")

    def fails(descriptor):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fails)
    assert main(["response", str(sweep), "-o", str(path)]) == 2
    assert "Input/output error" in capsys.readouterr().err
    assert path.read_bytes() == b"old" and sorted(os.listdir(tmp_path)) == ["old.png", "sweep.h5"]


@pytest.mark.long
def test_titles_and_names_do_not_command_the_terminal(sweep, tmp_path):
    path = tmp_path / "a\x1b[2Jb.h5"
    shutil.copy(sweep, path)
    with h5py.File(path, "a") as file:
        file.attrs["title"] = "x\x1b]0;owned\x07\x9b31m\u202e\ny"
    for words in (["info", str(path)], ["info", str(path), "--dof", "\x1b[31m"], ["peaks", str(path)], ["\x1b[2J"],
                  ["info", os.fsdecode(b"no\x9b.h5")]):  # fmt: skip
        command = [sys.executable, "-m", "nhbm_post", *words]
        done = subprocess.run(command, capture_output=True, env={"PYTHONPATH": ":".join(sys.path)})
        printed = (done.stdout + done.stderr).decode()
        assert not [c for c in printed if c != "\n" and not c.isprintable()], (words, printed)
        assert "Traceback" not in printed, printed


def test_a_misspelt_command_is_recognised(capsys):
    with pytest.raises(SystemExit):
        main(["respons", "run.h5"])
    said = capsys.readouterr().err
    assert "'respons' is unknown; did you mean 'response'?" in said and len(said) < 120


def test_a_page_has_the_ending_of_a_page(sweep, tmp_path, capsys):
    status, _, err = run(capsys, "report", sweep, "-o", tmp_path / "page.png")
    assert status == 2 and "the name must end in .html" in err and not (tmp_path / "page.png").exists()


def test_numbers_and_nouns_agree(tmp_path, capsys):
    path = single(tmp_path / "a.h5", 1)
    assert main(["value", str(path), "--tuple", "1,0"]) == 2
    assert "has 2 entries; the file has 1 tone\n" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["time", str(path), "--dpi", "100000"])
    assert "100000 is more than 2400" in capsys.readouterr().err
