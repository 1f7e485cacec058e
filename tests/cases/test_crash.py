"""Points that end the whole process: recorded in the file by a handler, skipped when the run is resumed."""

import signal
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
from nhbm_post.reader import Results

from program import INCOMPLETE, NOT_ALL_CONVERGED, program, read, run
from user_law import HEADER_FOLDER

PENDING, CONVERGED, CRASHED = 0, 1, 12

# A spring of stiffness 1 whose parameter selects how it ends the process, if it is at least 1.
LAW = """
#include "nhbm_user_law.h"
#include <stddef.h>
#include <stdlib.h>
#include <unistd.h>

int deadly_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 1;
   return 0;
}

static int deeper(volatile int *caller)
{
   volatile int here[1000] = {0};
   here[0] = *caller + 1;
   return deeper(here) + here[0];
}

static void die(int way)
{
   volatile int deep = 0;
   volatile int *nowhere = NULL;
   switch (way) {
   case 1: *nowhere = 1; break;
   case 2: abort();
   case 3: deep = deeper(&deep); break;
   case 4: exit(0);
   case 5: if (fork() == 0) abort(); break;
   default: break;
   }
}

int deadly_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                    const double *parameters, double *f, double *df_dz, double *df_dv)
{
   die((int)parameters[0]);
   for (int i = 0; i < n; i++) {
      f[i] = z[i];
      if (df_dz != NULL)
         df_dz[i] = 1.0;
   }
   return 0;
}
"""

INPUT = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'user', label = 'mine', library = 'deadly.so', name = 'deadly', dof = 'x1', parameters = 0.0 /
&sweep parameter = 'law(1)%parameters', values = {values} /
"""

ENDINGS = {
    "SIGSEGV": (1, signal.SIGSEGV),
    "abort": (2, signal.SIGABRT),
    "stack overflow": (3, signal.SIGSEGV),
}


@pytest.fixture
def own_handlers():
    """Skips builds with the address sanitizer, which has its own signal handlers."""
    if b"__asan_init" in Path(program()).read_bytes():
        pytest.skip("the address sanitizer has its own handlers")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the law; mpirun ends the other ranks at once instead of waiting for them twice."""
    monkeypatch.setenv("OMPI_MCA_odls_base_sigkill_timeout", "0")
    monkeypatch.setenv("PRTE_MCA_odls_base_sigkill_timeout", "0")
    (tmp_path / "deadly.c").write_text(LAW)
    command = ["cc", "-O0", "-w", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "deadly.so", "deadly.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    return tmp_path


def write(folder, values, more="", name="case"):
    source = folder / f"{name}.nml"
    source.write_text(INPUT.format(values=", ".join(map(str, values))) + more)
    return source


def complete(folder, ranks, *options):
    """Resumes a run until nothing remains; returns how often that was necessary."""
    for n in range(1, 10):
        done = run("resume", "case.h5", "--quiet", *options, cwd=folder, ranks=ranks)
        if done.status == NOT_ALL_CONVERGED and PENDING not in read(folder / "case.h5", "status"):
            return n
    raise AssertionError(done.stderr)


def assert_rows_equal(a, b, rows):
    """All data that do not depend on the run, or on the points in between, are the same in these points of two files."""
    with h5py.File(a, "r") as one, h5py.File(b, "r") as other:
        for name, data in one.items():
            if data.ndim > 0 and data.dims[0].keys()[:1] == ["point"] and not name.endswith(("rank", "_seconds", "branch")):
                if "parameter" not in data.attrs:
                    assert data[()][rows].tobytes() == other[name][()][rows].tobytes(), name


@pytest.mark.usefixtures("own_handlers")
@pytest.mark.parametrize(("ending", "ranks"), [*((ending, None) for ending in ENDINGS), ("SIGSEGV", 2)])
def test_point_that_crashes_is_noted_and_passed_by(ending, ranks, folder):
    way, number = ENDINGS[ending]
    values = [0.1, 0.3, 0.2, way, 0.4, 0.5, 0.6, 0.7]  # up and down: each starts alone
    done = run("solve", write(folder, values), "--quiet", cwd=folder, ranks=ranks)
    if ranks is None:
        assert done.status == -number, done.stderr
    assert done.status not in (0, NOT_ALL_CONVERGED, INCOMPLETE)
    assert f"nhbm: point 3 has ended the process by {number.name}" in done.stderr
    status = read(folder / "case.h5", "status")
    assert status[3] == CRASHED and set(np.delete(status, 3)) <= {PENDING, CONVERGED}

    assert complete(folder, ranks) == 1
    with Results(folder / "case.h5") as results:
        assert [results.status_name(i) for i in range(8)] == ["converged"] * 3 + ["crashed"] + ["converged"] * 4
        assert results.message(3).startswith(f"the process was ended by {number.name}")
        assert np.isnan(results.per_point("residual")[3])

    whole = write(folder, [0.1, 0.3, 0.2, 0.35, 0.4, 0.5, 0.6, 0.7], name="whole")
    assert run("solve", whole, "--quiet", cwd=folder, ranks=ranks).status == 0
    assert_rows_equal(folder / "case.h5", folder / "whole.h5", [0, 1, 2, 4, 5, 6, 7])


@pytest.mark.parametrize("ranks", [None, 2])
def test_point_that_calls_exit_is_noted(ranks, folder):
    done = run("solve", write(folder, [0.1, 4, 0.2]), "--quiet", cwd=folder, ranks=ranks)
    assert done.status == INCOMPLETE and "point 1 has ended the process by exit()" in done.stderr
    assert read(folder / "case.h5", "status")[1] == CRASHED
    complete(folder, ranks)
    assert read(folder / "case.h5", "status").tolist() == [CONVERGED, CRASHED, CONVERGED]


@pytest.mark.usefixtures("own_handlers")
def test_several_points_that_crash_are_noted_one_by_one(folder):
    run("solve", write(folder, [1, 0.1, 2, 3, 0.2]), "--quiet", cwd=folder)
    assert complete(folder, None) == 3
    assert read(folder / "case.h5", "status").tolist() == [CRASHED, CONVERGED, CRASHED, CRASHED, CONVERGED]


@pytest.mark.usefixtures("own_handlers")
def test_retry_tries_a_crashed_point_again(folder):
    run("solve", write(folder, [0.1, 1, 0.2]), "--quiet", cwd=folder)
    complete(folder, None)
    assert run("resume", "case.h5", "--retry", "--quiet", cwd=folder).status == -signal.SIGSEGV
    (folder / "deadly.c").write_text(LAW.replace("*nowhere = 1;", ""))
    command = ["cc", "-shared", "-w", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "deadly.so", "deadly.c"]
    subprocess.run(command, cwd=folder, check=True)
    assert run("resume", "case.h5", "--retry", "--quiet", cwd=folder).status == 0
    with Results(folder / "case.h5") as results:
        assert results.status.tolist() == [CONVERGED] * 3 and results.message(1) == ""


@pytest.mark.usefixtures("own_handlers")
def test_chain_goes_on_behind_a_crashed_point(folder):
    """A chain with remaining points is solved again from its beginning, except the point that ends the process."""
    chain = "&solver first_guess = 'neighbour', chain_length = 8 /\n"
    run("solve", write(folder, [0.1, 0.2, 0.3, 1, 0.4, 0.5], chain), "--quiet", cwd=folder)
    assert complete(folder, None) == 1
    assert read(folder / "case.h5", "status").tolist() == [CONVERGED] * 3 + [CRASHED] + [CONVERGED] * 2
    done = run("resume", "case.h5", cwd=folder)
    assert done.status == NOT_ALL_CONVERGED
    assert "5 of 6 points converged" in done.stdout and "1 crashed: " in done.stdout


@pytest.mark.usefixtures("own_handlers")
def test_info_counts_crashed_points(folder):
    run("solve", write(folder, [0.1, 1]), "--quiet", cwd=folder)
    complete(folder, None)
    done = run("info", "case.h5", cwd=folder)
    assert done.status == 0, done.stderr
    for words in ("1 converged", "1 crashed: ", "(first: point 1)", "complete   yes", "--retry also tries 1 again"):
        assert words in done.stdout, done.stdout


@pytest.mark.usefixtures("own_handlers")
def test_crash_of_a_child_process_is_not_that_of_a_point(folder):
    done = run("solve", write(folder, [0.1, 5]), "--quiet", cwd=folder)
    assert done.status == 0, done.stderr
    assert "has ended the process" not in done.stderr
