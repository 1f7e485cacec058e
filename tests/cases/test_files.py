"""Files, links, pipes and devices as file names, and output that is lost."""

import ctypes
import errno
import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from faults import count_calls, run_with_fault
from program import (
    ALL_CONVERGED, BAD_INPUT, INCOMPLETE, command, environment, run, seconds_of, seconds_of_children, wait_until_caught,
)  # fmt: skip

MODEL = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&integration duration = 1.0 /
"""
SWEEP = "&sweep parameter = 'load(1)%cos', values = 0.5, 1.0, 1.5 /\n"

on_linux = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "case.nml").write_text(MODEL + SWEEP)
    (tmp_path / "point.nml").write_text(MODEL)
    return tmp_path


def refused(done, *says):
    assert done.status == BAD_INPUT and len(done.messages) == 1, (done.status, done.stderr)
    for words in says:
        assert words in done.messages[0]


# What is never replaced


def test_pipe_is_never_replaced(folder):
    os.mkfifo(folder / "pipe")
    refused(run("solve", "case.nml", "-o", "pipe", "--overwrite", cwd=folder), "'pipe'", "never replaced")
    assert (folder / "pipe").is_fifo()


def test_device_is_never_replaced(folder):
    """Through a link, which is followed: the test needs no right to make a device."""
    (folder / "link").symlink_to("/dev/null")
    refused(run("solve", "case.nml", "-o", "link", "--overwrite", cwd=folder), "'/dev/null'", "never replaced")
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize("mask", [0o077, 0o002])
def test_files_have_the_mode_that_the_umask_leaves(mask, folder):
    """Also the record of a time integration, and only the requested file remains."""
    before = os.umask(mask)
    try:
        for verb, name in (("solve", "r.h5"), ("integrate", "m.h5")):
            assert run(verb, "point.nml", "-o", name, cwd=folder).status == ALL_CONVERGED
    finally:
        os.umask(before)
    made = {path.name: path.stat().st_mode & 0o777 for path in folder.iterdir() if path.suffix != ".nml"}
    assert made == dict.fromkeys(("r.h5", "m.h5"), 0o666 & ~mask)


@pytest.mark.parametrize("options", [[], ["--overwrite"]])
def test_links_are_followed(options, folder):
    for name in ("kept.h5", "none.h5"):
        (folder / f"to_{name}").symlink_to(name)
    (folder / "kept.h5").write_text("old")
    for name in ("kept.h5", "none.h5"):
        done = run("solve", "case.nml", "-o", f"to_{name}", *options, cwd=folder)
        assert (folder / f"to_{name}").is_symlink()
        if name == "kept.h5" and not options:
            refused(done, "'kept.h5'", "--overwrite")
        else:
            assert done.status == ALL_CONVERGED, done.stderr
            assert run("info", name, cwd=folder).status == 0


def test_links_that_go_round_are_refused(folder):
    (folder / "a").symlink_to("b")
    (folder / "b").symlink_to("a")
    refused(run("solve", "case.nml", "-o", "a", cwd=folder), "leads nowhere")


@pytest.mark.parametrize("verb", ["solve", "integrate"])
@pytest.mark.parametrize("name", ["point.nml", "./point.nml", "link", "hard"])
def test_input_is_never_replaced(verb, name, folder):
    (folder / "link").symlink_to("point.nml")
    os.link(folder / "point.nml", folder / "hard")
    refused(run(verb, "point.nml", "-o", name, "--overwrite", cwd=folder), "is the input file")
    assert (folder / "point.nml").read_text() == MODEL


# Names


def test_long_names(folder):
    assert run("solve", "case.nml", "-o", 240 * "n", "--quiet", cwd=folder).status == ALL_CONVERGED
    for n_bytes in (241, 250, 255, 300):
        refused(run("solve", "case.nml", "-o", n_bytes * "n", cwd=folder), "more than 240 bytes")


def test_trailing_blank_leaves_nothing(folder):
    before = sorted(folder.iterdir())
    refused(run("solve", "case.nml", "-o", "result.h5 ", cwd=folder), "ends with a blank")
    assert sorted(folder.iterdir()) == before


def test_stale_pipe_of_the_temporary_name(folder):
    os.mkfifo(folder / "case.h5.part")
    refused(run("solve", "case.nml", cwd=folder), "'case.h5.part'", "not a regular file")


def test_file_of_the_user_with_the_temporary_name_is_left_alone(folder):
    """The remains of a killed run under this name are replaced: test_signals.py kills runs while they create it."""
    (folder / "case.h5.part").write_text("mine")
    refused(run("solve", "case.nml", cwd=folder), "'case.h5.part'", "was not written by a run")
    assert (folder / "case.h5.part").read_text() == "mine"


# What is read


@pytest.mark.parametrize(
    "keys",
    [
        "&structure type = 'model', file = 'pipe' /",
        "&law type = 'user', library = 'pipe', name = 'mine', dof = 'x1' /",
    ],
    ids=["model", "library"],
)
def test_pipes_in_place_of_files_of_the_input(keys, folder):
    """Opening a pipe waits for its writer."""
    os.mkfifo(folder / "pipe")
    model = MODEL[MODEL.index("&tones") :] if "&structure" in keys else MODEL
    (folder / "piped.nml").write_text(model + keys)
    refused(run("solve", "piped.nml", "--quiet", cwd=folder), "pipe'", "is a pipe or a device")


@pytest.mark.parametrize("verb", ["solve", "check", "info", "resume"])
def test_sources_that_are_no_files(verb, folder):
    os.mkfifo(folder / "pipe")
    (folder / "empty").touch()
    (folder / "lost").symlink_to("nothing")
    for name, says in (("pipe", "is a pipe or a device"), ("empty", "is empty"), ("lost", "does not exist")):
        refused(run(verb, name, cwd=folder), f"'{name}'", says)


# Where messages go


def run_into(output, *arguments, cwd):
    return subprocess.run(
        command(*arguments), cwd=cwd, env=environment(), stdout=output, stderr=subprocess.PIPE, text=True, timeout=600
    )


@pytest.mark.parametrize("arguments", [("solve", "case.nml"), ("check", "case.nml"), ("version",), ("help",)])
def test_closed_pipe_ends_nothing(arguments, folder):
    """The reader of the output has closed it: the program continues, and its exit status is that of its work."""
    reader, writer = os.pipe()
    os.close(reader)
    done = run_into(writer, *arguments, cwd=folder)
    os.close(writer)
    assert done.returncode == ALL_CONVERGED, done.stderr
    if arguments[0] == "solve":
        assert run("info", "case.h5", cwd=folder).status == 0


@on_linux
@pytest.mark.parametrize("arguments", [("solve", "case.nml"), ("check", "case.nml"), ("version",), ("help",)])
def test_full_device_is_reported(arguments, folder):
    with open("/dev/full", "w") as full:
        done = run_into(full, *arguments, cwd=folder)
    assert done.returncode == BAD_INPUT and "standard output cannot be written" in done.stderr


# What others leave behind


@on_linux
@pytest.mark.parametrize("ranks", [None, 2])
def test_semaphore_left_over_by_mpi_hangs_nothing(ranks, folder):
    """Of Open MPI's shared file pointers, which are not used; its name is that of the result file."""
    name = f"left_{os.getpid()}.h5"
    semaphore = f"/OMPIO_{name}".encode()
    libc = ctypes.CDLL(None)
    libc.sem_open.restype = ctypes.c_void_p
    assert libc.sem_open(semaphore, os.O_CREAT, 0o644, 0)
    try:
        assert run("solve", "case.nml", "-o", name, "--quiet", cwd=folder, ranks=ranks).status == ALL_CONVERGED
    finally:
        libc.sem_unlink(semaphore)


# Writes that fail


@on_linux
@pytest.mark.parametrize("error", [errno.EIO, errno.ENOSPC], ids=["EIO", "ENOSPC"])
def test_writes_that_fail_are_reported(error, folder):
    """While the file is created, and when the result of its point is written."""
    words = ("solve", "point.nml", "--overwrite", "--quiet")
    n_writes = count_calls(*words, cwd=folder, call="write", file="point.h5")
    for at in (2, n_writes // 2, n_writes - 5):
        fails(run_with_fault(*words, cwd=folder, call="write", file="point.h5", at=at, number=error))


@on_linux
def test_writes_of_one_rank_that_fail_end_both(folder):
    words = ("solve", "point.nml", "--quiet")
    fails(run_with_fault(*words, cwd=folder, call="write", file="point.h5", at=1, number=errno.EIO, rank=1, ranks=2))


def fails(done):
    assert done.status == BAD_INPUT and "nhbm: result file 'point.h5': " in done.stderr, (done.status, done.stderr)


# Memory, signals


def under_limit(megabytes, words, cwd):
    """Runs a command that may have so much address space, and ten seconds of the processor."""
    limit = megabytes * 1000**2
    code = (
        f"import os, resource, sys; resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit})); "
        "resource.setrlimit(resource.RLIMIT_CPU, (10, 10)); os.execv(sys.argv[1], sys.argv[1:])"
    )
    return subprocess.run(["python3", "-c", code, *words], cwd=cwd, env=environment(), capture_output=True, text=True)


@on_linux
@pytest.mark.parametrize(("megabytes", "threads"), [(200, 1), pytest.param(220, 2, marks=pytest.mark.long), (260, 2)])
def test_too_little_address_space_is_reported(megabytes, threads, folder):
    """OpenBLAS requests its memory repeatedly, without an end; so do its threads, for which it waits when the process ends."""
    with_threads = ["/usr/bin/env", f"OPENBLAS_NUM_THREADS={threads}", f"NHBM_BLAS_THREADS={threads}"]
    if under_limit(megabytes, command("version"), folder).returncode != 0:
        pytest.skip("this OpenBLAS requests its memory while it is loaded, before the program begins")
    done = under_limit(megabytes, [*with_threads, *command("solve", "case.nml")], folder)
    if "AddressSanitizer" in done.stderr:
        pytest.skip("the address sanitizer maps far more")
    assert done.returncode == BAD_INPUT and "a limit on memory" in done.stderr, (done.returncode, done.stderr)


def test_signal_before_the_first_point_ends_at_once(tmp_path):
    """Forty million points, whose file would take half a minute to create and 24 GB: nothing remains of it."""
    sweeps = "".join(
        f"&sweep parameter = '{path}', from = 0.5, to = 1.5, n = {n} /\n"
        for path, n in (("load(1)%cos", 10000), ("law(1)%stiffness", 4000))
    )
    (tmp_path / "case.nml").write_text(MODEL + sweeps)
    for number in (signal.SIGUSR1, signal.SIGTERM):
        process = subprocess.Popen(command("solve", "case.nml", "--quiet"), cwd=tmp_path, env=environment(), stderr=subprocess.PIPE)
        try:
            wait_until_caught(process, number)
            before = seconds_of_children() + seconds_of(process)
            process.send_signal(number)
            words = process.communicate(timeout=600)[1].decode()
            assert seconds_of_children() - before < 2.0
            assert process.returncode == INCOMPLETE and "ended by a signal before there was a result" in words, words
        finally:
            process.kill()
            process.wait()
        assert [path.name for path in tmp_path.iterdir()] == ["case.nml"]


def test_plan_of_many_points_takes_little_memory(tmp_path):
    sweeps = "".join(
        f"&sweep parameter = '{path}', from = 0.5, to = 1.5, n = 10000 /\n" for path in ("load(1)%cos", "law(1)%stiffness")
    )
    (tmp_path / "case.nml").write_text(MODEL + sweeps)
    words = "import os, resource, subprocess, sys; done = subprocess.run(sys.argv[1:]); "
    words += "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss); sys.exit(done.returncode)"
    done = subprocess.run(
        ["python3", "-c", words, *command("plan", "case.nml")], cwd=tmp_path, env=environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "100000000 points" in done.stdout and int(done.stdout.split()[-1]) < 200_000
    before = seconds_of_children()
    refused(run("solve", "case.nml", "--quiet", cwd=tmp_path), "100000000 points are more than one result file takes")
    assert seconds_of_children() - before < 5.0 and not (tmp_path / "case.h5").exists()


@pytest.mark.skipif(not shutil.which("h5repack"), reason="h5repack is not here")
def test_a_result_is_compressed_by_the_tool_of_hdf5(folder):
    """It fails at datasets of fixed extent 0, such as the gradients of a run without any."""
    assert run("solve", "case.nml", cwd=folder).status == ALL_CONVERGED
    done = subprocess.run(["h5repack", "-f", "GZIP=6", "case.h5", "small.h5"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert run("info", "small.h5", cwd=folder).status == ALL_CONVERGED
