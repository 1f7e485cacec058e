"""Runs on several processes of a program without MPI (`nhbm solve --workers N`), and what a program with MPI says to them.

Environment: NHBM, the program; NHBM_WITH_MPI, one whose files must have the same bits. tests/configure/without_mpi.cmake builds a
program without MPI and runs this file and others with it."""

import os
import signal
import subprocess
import time
from pathlib import Path

import h5py
import pytest

from ended_runs import LINE, N_SWEPT, assert_same, n_done, ranks_of, write
from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, command, environment, is_without_mpi, program, run

without_mpi = pytest.mark.skipif(not is_without_mpi(program()), reason="the program was built with MPI")
with_mpi = pytest.mark.skipif(is_without_mpi(program()), reason="the program was built without MPI")


@with_mpi
@pytest.mark.parametrize("words", [["--workers", "2"], ["--workers=1"]], ids=" ".join)
def test_a_program_with_mpi_names_mpirun(tmp_path, words):
    done = run("solve", write(tmp_path, LINE), *words, cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "this nhbm was built with MPI: instead of --workers" in done.stderr and "mpirun -n" in done.stderr
    assert not (tmp_path / "case.h5").exists()


@pytest.mark.parametrize("value", ["0", "-1", "two", "2,3", ""])
def test_a_number_of_workers_is_one_or_more(tmp_path, value):
    done = run("solve", write(tmp_path, LINE), f"--workers={value}", cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "--workers needs" in done.stderr


@without_mpi
def test_a_program_without_mpi_refuses_mpirun(tmp_path):
    variables = {**environment(), "OMPI_COMM_WORLD_SIZE": "4"}  # as mpirun sets it
    done = subprocess.run(command("solve", write(tmp_path, LINE)), cwd=tmp_path, env=variables, capture_output=True, text=True)
    assert done.returncode == BAD_INPUT
    assert "give --workers 4 instead" in done.stderr


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The file of one process."""
    folder = tmp_path_factory.mktemp("undisturbed")
    done = run("solve", write(folder, LINE), "--quiet", cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    return folder / "case.h5"


@without_mpi
@pytest.mark.parametrize("n", [1, 2, 3])
def test_workers_give_the_bits_of_one_process(tmp_path, undisturbed, n):
    done = run("solve", write(tmp_path, LINE), "--quiet", "--workers", n, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    assert_same(tmp_path / "case.h5", undisturbed)
    assert run("info", "case.h5", "--check", cwd=tmp_path).status == ALL_CONVERGED


@without_mpi
def test_a_file_of_processes_names_no_mpi(undisturbed):
    with h5py.File(undisturbed) as file:
        texts = [f"{name}: {text}" for name, data in file.items() for text in data.attrs.values() if isinstance(text, (bytes, str))]
    assert any("worker" in text for text in texts)
    assert not [text for text in texts if "MPI" in text]


@without_mpi
@pytest.mark.skipif("NHBM_WITH_MPI" not in os.environ, reason="NHBM_WITH_MPI does not name a program")
def test_a_program_with_mpi_gives_the_same_bits(tmp_path, undisturbed):
    words = [os.environ["NHBM_WITH_MPI"], "solve", str(write(tmp_path, LINE)), "--quiet"]
    subprocess.run(words, cwd=tmp_path, env=environment(), check=True)
    assert_same(tmp_path / "case.h5", undisturbed)


def begun_run(folder):
    """A run on two workers, in a group of its own as a shell starts it, of which some points are done; ready to be disturbed."""
    write(folder, LINE)
    words = command("solve", "case.nml", "--quiet", ranks=2)
    process = subprocess.Popen(words, cwd=folder, env=environment(), stderr=subprocess.PIPE, text=True, start_new_session=True)
    while process.poll() is None and n_done(folder / "case.h5") < 3:
        time.sleep(0.005)
    return process


def assert_resumes(folder, undisturbed):
    done = run("resume", "case.h5", "--quiet", "--workers", 3, cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    assert_same(folder / "case.h5", undisturbed)


@without_mpi
@pytest.mark.parametrize("end", ["Ctrl-C", "SIGTERM to the command", "SIGUSR1 to the command and its workers"])
def test_a_signal_ends_a_run_that_goes_on_later(tmp_path, undisturbed, end):
    process = begun_run(tmp_path)
    if end == "Ctrl-C":
        os.killpg(process.pid, signal.SIGINT)
    elif end == "SIGTERM to the command":
        process.terminate()
    else:  # as a batch system does
        for pid in [process.pid, *ranks_of(process)]:
            os.kill(pid, signal.SIGUSR1)
    stderr = process.communicate(timeout=600)[1]
    n_left = N_SWEPT - n_done(tmp_path / "case.h5")
    assert (process.returncode, n_left > 0) in ((INCOMPLETE, True), (ALL_CONVERGED, False)), stderr
    assert "second signal" not in stderr
    assert stderr.count("stopped by") == (1 if n_left else 0), stderr
    assert_resumes(tmp_path, undisturbed)


@without_mpi
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc, where the workers are found")
@pytest.mark.parametrize("victim", ["a worker", "the command", "all"])
def test_a_killed_process_ends_a_run_that_goes_on_later(tmp_path, undisturbed, victim):
    process = begun_run(tmp_path)
    workers = ranks_of(process)
    assert len(workers) in (0, 2)
    for pid in {"a worker": workers[:1], "the command": [process.pid], "all": [process.pid, *workers]}[victim]:
        os.kill(pid, signal.SIGKILL)
    process.communicate(timeout=600)  # nobody has its standard error any more: all have ended
    if workers and victim == "a worker":
        assert process.returncode == 128 + signal.SIGKILL
    if n_done(tmp_path / "case.h5") < N_SWEPT:
        assert_resumes(tmp_path, undisturbed)
