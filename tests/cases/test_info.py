"""`nhbm info` of files that are complete, and of others."""

import numpy as np

from ended_runs import GAPS, QUICK, ended, write
from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, read, run


def test_info_of_a_run_that_is_not_complete(tmp_path):
    text = QUICK + "&output title = 'a beam' /\n&sweep parameter = 'law(wall)%gap', values = 2.0e-3, 1.0e-3 /\n"
    result = ended(tmp_path, text)
    done = run("info", result, cwd=tmp_path)
    assert done.status == INCOMPLETE, done.stderr
    for words in (
        "title      a beam",
        "swept      law(wall)%gap: 2 values, 1.0e-3 to 2.0e-3 m",
        "2 not solved yet",
        f"complete   no, 2 points left; nhbm resume {result} solves them",
    ):
        assert words in done.stdout, done.stdout
    assert "worst" not in done.stdout and "times" not in done.stdout


def test_info_of_a_complete_run(tmp_path):
    text = QUICK.replace("augmentation = 100000.0", "augmentation = 1.0e5, two_sided = .true.")
    source = write(tmp_path, text + "&sweep parameter = 'law(1)%gap', values = 1.5e-3, -1.0e-3, 1.0e-3 /\n")
    assert run("solve", source, cwd=tmp_path).status == NOT_ALL_CONVERGED
    done = run("info", "case.h5", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    truncation = read(tmp_path / "case.h5", "truncation_estimate")
    worst = int(np.nanargmax(truncation))
    gap = {0: "1.5e-3", 2: "1.0e-3"}[worst]
    for words in (
        "2 converged",
        "1 failed: an error of this point, see its message (first: point 1)",
        f"truncation {truncation[worst]:.2E} at point {worst} (law(1)%gap = {gap} m)",
        "complete   yes",
        "nhbm resume case.h5 --retry also tries 1 again",
    ):
        assert words in done.stdout, done.stdout


def test_info_agrees_with_the_reader(tmp_path):
    """The lines of the same name in `nhbm info` and `nhbm-post info`."""
    from nhbm_post import report
    from nhbm_post.reader import Results

    result = ended(tmp_path, QUICK + GAPS)
    for names in (("written by", "run on", "tones", "harmonics", "dofs", "swept", "complete"), ("complete",)):
        ours = run("info", result, cwd=tmp_path).stdout.splitlines()
        with Results(result) as results:
            theirs = report.info(results).splitlines()
        for name in names:
            line = [text for text in ours if text.startswith(name + " ")]
            assert line and line[0].rstrip() in [text.rstrip() for text in theirs], name
        run("resume", result, cwd=tmp_path)


def test_info_says_that_stability_is_not_known_and_no_times_of_none(tmp_path):
    """A file from memory had times of zero seconds, and a run without verdicts no line of them."""
    import nhbm

    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[0.9])
    model.load("x1", 1, cos=0.1)
    model.set("stability", method="off")
    curve = model.curve("tones[0]", 0.9, 1.0, order=3)
    curve.nhbm.save(tmp_path / "saved.h5")
    told = run("info", "saved.h5", cwd=tmp_path).stdout
    assert f"stability  0 stable, 0 unstable, {curve.sizes['point']} not known" in told and "times" not in told


def test_check_shows_no_rounding_as_damping(tmp_path):
    text = "&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.5, stiffness = 3.0, -2.0, -2.0, 2.0 /\n&tones frequency = 1 /\n"
    (tmp_path / "case.nml").write_text(text + "&load dof = 'x1', tuple = 1, cos = 1 /\n")
    assert "damping     0.00E+00, 0.00E+00 of critical" in run("check", "case.nml", cwd=tmp_path).stdout


def test_the_time_of_a_point_is_a_mean_over_solved_points(tmp_path):
    """It was divided by the rows that are reserved for a curve."""
    text = "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n&tones frequency = 0.5 /\n"
    text += "&load dof = 'x1', tuple = 1, cos = 0.1 /\n&curve parameter = 'tones%frequency', from = 0.5, to = 0.9 /\n"
    source = write(tmp_path, text)
    assert run("solve", source, cwd=tmp_path).status == ALL_CONVERGED
    (line,) = [line for line in run("info", "case.h5", cwd=tmp_path).stdout.splitlines() if line.startswith("times")]
    total, each = float(line.split()[1]), float(line.split(",")[1].split()[0])
    n_points = int(np.sum(np.isfinite(read(tmp_path / "case.h5", "truncation_estimate"))))
    assert abs(each * n_points - total) < 0.02 * total, line


def test_info_of_several_files_is_a_line_each_and_the_worst_status(tmp_path):
    """The parts of an array of jobs: complete, cut and missing ones in one call."""
    left = ended(tmp_path, QUICK + GAPS)
    source = write(tmp_path, QUICK)
    assert run("solve", source, "-o", "whole.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert run("info", "whole.h5", "whole.h5", cwd=tmp_path).status == ALL_CONVERGED
    done = run("info", "whole.h5", left, cwd=tmp_path)
    assert done.status == INCOMPLETE, done.stderr
    assert len(done.stdout.splitlines()) == 3, done.stdout
    assert f"nhbm resume {left}" in done.stdout
    (tmp_path / "no.h5").write_text("no result")
    done = run("info", "whole.h5", "no.h5", left, cwd=tmp_path)
    assert done.status == BAD_INPUT and "no.h5" in done.stdout, done.stdout
