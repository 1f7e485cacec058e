"""However a run ends, its file can be opened, and `resume` completes it to the result of an undisturbed run; full disks."""

import os
import resource
import shlex
import signal
import subprocess

import h5py
import numpy as np
import pytest

from ended_runs import (
    CONVERGED,
    FAILED,
    GAPS,
    N_SWEPT,
    OUT_OF_BUDGET,
    PENDING,
    QUICK,
    SWEPT,
    assert_same,
    contents,
    ended,
    n_done,
    write,
)
from faults import on_linux, run_with_fault
from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, command, environment, read, run


def test_resumed_run_equals_the_undisturbed_one(tmp_path):
    result = ended(tmp_path, QUICK + GAPS, "--set", "law(1)%augmentation=2.0e5", "--set", "output%title='it''s a title'")
    assert read(result, "status").tolist() == [PENDING] * 3
    source = write(tmp_path, QUICK + GAPS, "whole")
    options = ("--set", "law(1)%augmentation=2.0e5", "--set", "output%title='it''s a title'")
    assert run("solve", source, *options, cwd=tmp_path).status == ALL_CONVERGED
    done = run("resume", result, cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "3 of 3 points converged" in done.stdout, done.stderr
    assert_same(result, tmp_path / "whole.h5")


def test_solve_with_resume_makes_the_file_or_goes_on(tmp_path):
    source = write(tmp_path, QUICK + GAPS)
    for limit, status in (("0", INCOMPLETE), ("1000", ALL_CONVERGED), ("1000", ALL_CONVERGED)):
        assert run("solve", source, "--resume", "--time-limit", limit, cwd=tmp_path).status == status
    assert read(tmp_path / "case.h5", "status").tolist() == [CONVERGED] * 3


def test_complete_file_is_left_as_it_is(tmp_path):
    source = write(tmp_path, QUICK + GAPS)
    assert run("solve", source, cwd=tmp_path).status == ALL_CONVERGED
    before = (tmp_path / "case.h5").read_bytes()
    assert run("resume", "case.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert (tmp_path / "case.h5").read_bytes() == before


@pytest.mark.parametrize("ranks", [None, 2])
def test_changed_input_is_refused_by_name(ranks, tmp_path):
    result = ended(tmp_path, QUICK + GAPS)
    before = result.read_bytes()
    source = write(tmp_path, (QUICK + GAPS).replace("tuple = 0, 1, cos = 100.0", "tuple = 0, 1, cos = 90.0, sin = 3.0"))
    done = run("solve", source, "--resume", "--set", "sweep(1)%values=1.0e-3, 1.5e-3, 2.5e-3", cwd=tmp_path, ranks=ranks)
    assert done.status == BAD_INPUT and len(done.messages) == 1
    for words in ("case.h5", "&load(2): cos: 90.0 in the input, 100.0 in the file", "&load(2): sin: 3.0 in the input"):
        assert words in done.stderr
    assert "&sweep: values: " in done.stderr and "2.5e-3" in done.stderr
    assert result.read_bytes() == before


def test_comments_and_blanks_do_not_change_an_input(tmp_path):
    ended(tmp_path, QUICK + GAPS)
    source = write(tmp_path, "! the same\n" + (QUICK + GAPS).replace(" = ", "=").replace("1.5e-3", "0.0015"))
    done = run("solve", source, "--resume", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr


def test_retry_solves_again_what_did_not_converge(tmp_path):
    text = QUICK + (
        "&sweep parameter = 'law(1)%gap', values = 1.0, 0.2e-3, -1.0e-3, 1.0e-3 /\n"
        "&solver method = 'broyden', max_iterations = 1, fallback = .false. /\n"
    )
    text = text.replace("augmentation = 100000.0", "augmentation = 1.0e5, two_sided = .true.")
    source = write(tmp_path, text)
    assert run("solve", source, cwd=tmp_path).status == NOT_ALL_CONVERGED
    result = tmp_path / "case.h5"
    undisturbed = contents(result)
    status = read(result, "status")
    again = np.flatnonzero(status != CONVERGED)
    assert {OUT_OF_BUDGET, FAILED} <= set(status.tolist()) and again.size < 4

    with h5py.File(result, "r+") as file:  # marks that show which rows are written
        file["solve_seconds"][...] = -1.0
    assert run("resume", result, cwd=tmp_path).status == NOT_ALL_CONVERGED
    assert (read(result, "solve_seconds") == -1.0).all()
    with h5py.File(result, "r+") as file:
        file["coefficients"][int(again[-1])] = 7.0
    done = run("resume", result, "--retry", cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED
    assert np.flatnonzero(read(result, "solve_seconds") != -1.0).tolist() == again.tolist()
    assert contents(result) == undisturbed


def test_an_unfinished_chain_is_said_to_begin_again(tmp_path):
    """A limit shorter than a chain would never end the run; points on their own need no word."""
    write(tmp_path, SWEPT)
    for guess, is_said in (("neighbour", True), ("linear", False)):
        done = run("solve", "case.nml", "--overwrite", "--time-limit", "0", "--set", f"solver%first_guess='{guess}'", cwd=tmp_path)
        assert done.status == INCOMPLETE and "nhbm resume case.h5 solves" in done.stderr
        assert ("a chain of points that is not finished begins again (see &solver chain_length)" in done.stderr) == is_said


@pytest.mark.parametrize(
    "words, says",
    [
        (("resume", "none.h5"), "'none.h5' does not exist"),
        (("resume", "case.txt"), "is not a result file"),
        (("resume",), "needs a result file"),
        (("resume", "case.h5", "--set", "law(1)%gap=1"), "no --set"),
        (("resume", "case.h5", "--overwrite"), "--overwrite"),
        (("solve", "case.nml", "--resume", "--overwrite"), "--overwrite"),
        (("solve", "case.nml", "--retry"), "--resume"),
        (("solve", "case.nml", "--time-limit", "1h"), "--time-limit needs seconds"),
        (("solve", "case.nml", "--time-limit", "-1"), "--time-limit needs seconds"),
        (("info", "case.txt"), "is not a result file"),
    ],
)
def test_what_cannot_be_resumed(words, says, tmp_path):
    write(tmp_path, QUICK).with_suffix(".txt").write_text(QUICK)
    done = run(*words, cwd=tmp_path)
    assert done.status == BAD_INPUT and len(done.messages) == 1 and says in done.stderr, done.stderr


# The file


def test_only_rows_of_points_change_after_the_file_is_made(tmp_path):
    """Metadata do not change: a run may be killed between any two writes."""
    result = ended(tmp_path, QUICK + GAPS)
    before = np.frombuffer(result.read_bytes(), np.uint8)
    assert run("resume", result, cwd=tmp_path).status == ALL_CONVERGED
    after = np.frombuffer(result.read_bytes(), np.uint8)
    assert before.size == after.size
    is_row = np.zeros(before.size, bool)
    with h5py.File(result, "r") as file:
        for data in file.values():
            if data.ndim > 0 and data.dims[0].keys()[:1] == ["point"] and "parameter" not in data.attrs:
                first = data.id.get_offset()
                is_row[first : first + data.id.get_storage_size()] = True
    assert is_row.any() and (before[~is_row] == after[~is_row]).all()
    assert (before[is_row] != after[is_row]).any()


def test_leftover_of_a_killed_creation_is_replaced(tmp_path):
    source = write(tmp_path, QUICK)
    part = tmp_path / "case.h5.part"
    part.write_bytes(b"x" * 1000)
    part.chmod(0o1600)  # by this a part of a run is known; another file of that name is left alone
    assert run("solve", source, cwd=tmp_path).status == ALL_CONVERGED
    assert sorted(p.name for p in tmp_path.iterdir()) == ["case.h5", "case.nml"]
    assert read(tmp_path / "case.h5", "status").tolist() == [CONVERGED]


def test_file_that_another_run_is_making_is_left_alone(tmp_path):
    fcntl = pytest.importorskip("fcntl")
    source, part = write(tmp_path, QUICK), tmp_path / "case.h5.part"
    with open(part, "wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        done = run("solve", source, cwd=tmp_path)
    assert done.status == BAD_INPUT and "another run is making it" in done.stderr
    assert part.exists() and not (tmp_path / "case.h5").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to mount a small disk")
def test_full_disk(tmp_path):
    """Nothing remains of a file that does not fit, and the file that it should replace is unchanged."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", disk], capture_output=True, check=False)
    if mounted.returncode != 0:
        pytest.skip("no tmpfs can be mounted here")
    try:
        small, large = write(tmp_path, QUICK, "small"), write(tmp_path, SWEPT, "large")
        assert run("solve", small, "-o", disk / "kept.h5", cwd=tmp_path).status == ALL_CONVERGED
        kept = (disk / "kept.h5").read_bytes()
        for ranks in (None, 2):
            done = run("solve", large, "-o", disk / "kept.h5", "--overwrite", cwd=tmp_path, ranks=ranks)
            assert done.status == BAD_INPUT and len(done.messages) == 1, done.stderr
            assert "kept.h5" in done.stderr and "space" in done.stderr
        assert [p.name for p in disk.iterdir()] == ["kept.h5"]
        assert (disk / "kept.h5").read_bytes() == kept
    finally:
        subprocess.run(["umount", disk], check=True)


def test_write_that_fails_ends_the_run_with_a_message(tmp_path):
    """A limit on the size of files represents a full disk: the file is complete, its rows cannot be written."""
    text = SWEPT.replace(f"n = {N_SWEPT}", "n = 12")
    source = write(tmp_path, text)
    assert run("solve", source, "--time-limit", "0", cwd=tmp_path).status == INCOMPLETE
    result = tmp_path / "case.h5"
    with h5py.File(result, "r") as file:
        first = file["coefficients"].id.get_offset()
        row = file["coefficients"].id.get_storage_size() // 12
    limit = first + 3 * row + row // 2
    done = subprocess.run(
        command("resume", result, "--quiet"),
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    message = done.stderr.decode()
    assert done.returncode == BAD_INPUT, message
    assert message.count("nhbm: ") == 1 and "point " in message and "cannot write" in message and "case.h5" in message
    status = read(result, "status")
    assert (status[4:] == PENDING).all()
    assert run("resume", result, cwd=tmp_path).status == ALL_CONVERGED
    whole = write(tmp_path, text, "whole")
    assert run("solve", whole, cwd=tmp_path).status == ALL_CONVERGED
    assert_same(result, tmp_path / "whole.h5")


@on_linux
def test_a_resumed_run_reads_what_is_stored(tmp_path):
    """Neither points without results nor harmonics that the others do not use: the file has room for 400 kB a point."""
    if not os.path.exists("/proc/self/io"):
        pytest.skip("this system does not count what a process reads")
    (tmp_path / "case.nml").write_text(
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.1 /\n&tones frequency = 0.9 /\n"
        "&law type = 'elastic_stop', dof = 'x1', stiffness = 1.0, gap = 0.3 /\n"
        "&sweep parameter = 'tones%frequency', from = 0.8, to = 1.2, n = 3000 /\n"
    )
    run_with_fault("solve", "case.nml", "--quiet", cwd=tmp_path, call="clock", at=10000, number=signal.SIGTERM)
    points = n_done(tmp_path / "case.h5")
    assert 100 < points < 3000 and (tmp_path / "case.h5").stat().st_size > 5e8
    words = shlex.join(command("resume", "case.h5", "--time-limit", "0", "--quiet"))
    words = ["bash", "-c", f"{words}; cat /proc/$$/io"]
    done = subprocess.run(words, cwd=tmp_path, env=environment(), capture_output=True, text=True)
    counted = dict(line.split(": ") for line in done.stdout.splitlines() if ": " in line)
    assert int(counted["rchar"]) < 5e6 + 1e5 * points, done.stdout + done.stderr
