"""Laws from shared libraries: the worked examples built as described in their sources, solved and checked by the program."""

import shutil
import subprocess
from pathlib import Path

import h5py
import nhbm
import pytest
from nhbm_post.reader import Results

from expectations import failures, read_expectations
from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, coefficients_by_tuple, run
from user_law import HEADER_FOLDER, build_as_the_source_says

ROOT = Path(__file__).resolve().parents[2]
INPUT = "cubic_spring.nml"

WRONG = """
#include "nhbm_user_law.h"
#include <stddef.h>

int wrong_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 1;
   return 0;
}

int wrong_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                   const double *parameters, double *f, double *df_dz, double *df_dv)
{
   for (int i = 0; i < n; i++) {
      f[i] = z[i];
      if (df_dz != NULL)
         df_dz[i] = -1.0;
   }
   return n_parameters == 1 && parameters[0] > 0.5 ? (int)-parameters[0] : 0;
}
"""

ONE_MASS = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'user', label = 'mine', library = 'wrong.so', name = 'wrong', dof = 'x1', parameters = 0.0 /
"""


@pytest.fixture
def folder(tmp_path):
    """The folder of the examples with both libraries."""
    copy = tmp_path / "user_law"
    shutil.copytree(ROOT / "inputs" / "user_law", copy)
    for source in ("cubic_spring.c", "cubic_spring.f90"):
        build_as_the_source_says(copy / source)
    return copy


@pytest.fixture
def wrong_law(tmp_path):
    """Folder with a law whose derivative has the wrong sign, and an input `one_mass.nml` that uses it."""
    (tmp_path / "wrong.c").write_text(WRONG)
    command = ["cc", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "wrong.so", "wrong.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    (tmp_path / "one_mass.nml").write_text(ONE_MASS)
    return tmp_path


@pytest.mark.parametrize("more", [pytest.param("", marks=pytest.mark.long),
                                  "&sweep parameter = 'tones%frequency', values = 2.0, 2.1 /\n",
                                  "&curve parameter = 'tones%frequency', from = 2.0, to = 2.1, points = 3 /\n"])  # fmt: skip
def test_a_wrong_derivative_is_said_by_every_run(wrong_law, more):
    """The motion is right, and converges; its stability and curves would not be."""
    (wrong_law / "one_mass.nml").write_text(ONE_MASS + more)
    done = run("solve", "one_mass.nml", cwd=wrong_law)
    assert "warning: law 'mine': df/dz is not the derivative of its force" in done.stdout, done
    assert done.status == NOT_ALL_CONVERGED
    for ranks in (None, 2) if "sweep" in more else (None,):
        again = run("resume", "one_mass.h5", cwd=wrong_law, ranks=ranks)  # nothing is left to do, and the results are as they were
        assert again.status == NOT_ALL_CONVERGED and "warning: law 'mine': df/dz is not" in again.stdout, again
    assert "warning    law 'mine': df/dz is not the derivative" in run("info", "one_mass.h5", cwd=wrong_law).stdout
    ranks = None if "curve" in more else 2  # one of them may have no point
    done = run("solve", "one_mass.nml", "--overwrite", "--quiet", cwd=wrong_law, ranks=ranks)
    assert done.status == NOT_ALL_CONVERGED and "law 'mine': df/dz is not the derivative" in done.stderr and not done.stdout
    right = WRONG.replace("df_dz[i] = -1.0", "df_dz[i] = 1.0")
    (wrong_law / "wrong.c").write_text(right)
    subprocess.run(["cc", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "wrong.so", "wrong.c"], cwd=wrong_law, check=True)
    done = run("solve", "one_mass.nml", "--overwrite", cwd=wrong_law)
    assert "derivative" not in done.stdout and done.status == ALL_CONVERGED


def test_a_law_wrongly_declared_odd_is_said(wrong_law):
    even = WRONG.replace("df_dz[i] = -1.0", "df_dz[i] = 2.0 * z[i]").replace("f[i] = z[i]", "f[i] = z[i] * z[i]")
    assert even.count("2.0 * z[i]") == 1 and even.count("z[i] * z[i]") == 1
    (wrong_law / "wrong.c").write_text(even)
    subprocess.run(["cc", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "wrong.so", "wrong.c"], cwd=wrong_law, check=True)
    for odd in (True, False):
        text = ONE_MASS.replace("label = 'mine'", f"label = 'mine', odd = .{odd}.")
        (wrong_law / "one_mass.nml").write_text(text)
        said = run("solve", "one_mass.nml", "--overwrite", cwd=wrong_law).stdout
        assert ("law 'mine': it is declared odd, but f(-z, -v) is not -f(z, v)" in said) == odd
        checked = run("check", "one_mass.nml", cwd=wrong_law)
        assert ("wrong: declared odd" in checked.stdout) == odd and (checked.status == ALL_CONVERGED) != odd


def test_examples_move_like_the_built_in_spring(folder, tmp_path):
    done = run("solve", folder / INPUT, cwd=tmp_path)
    result = tmp_path / "cubic_spring.h5"
    assert done.status == ALL_CONVERGED, done.stderr
    with Results(result) as results:
        assert not failures(read_expectations((folder / INPUT).read_text()), results)
    built_in = coefficients_by_tuple(result, dof=2)
    largest = max(abs(value) for pair in built_in.values() for value in pair)
    for dof in (0, 1):
        for j, pair in coefficients_by_tuple(result, dof=dof).items():
            assert pair == pytest.approx(built_in[j], rel=0.0, abs=1e-15 * largest), f"{j} of x{dof + 1}"


def test_examples_pass_the_check(folder, tmp_path):
    done = run("check", folder / INPUT, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("from ")]
    assert [row[1] for row in rows if row[-1] == "right"] == ["C", "Fortran"]


def test_library_is_named_when_it_is_missing(tmp_path):
    source = tmp_path / INPUT
    shutil.copy(ROOT / "inputs" / "user_law" / INPUT, source)
    done = run("check", source, cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "cannot load the library: cubic_c.so" in done.stderr
    assert "cannot load the library: cubic_f.so" in done.stderr


# Two distinguishable springs; the second one creates a file where it is loaded.
SPRING = {"force": "z[i]"}
OTHER_SPRING = {
    "force": "2 * z[i]",
    "constructor": '''#include <stdio.h>
__attribute__((constructor)) static void begin(void) { FILE *f = fopen("loaded", "w"); if (f) fclose(f); }''',
}


@pytest.mark.parametrize("name", ["sub/rogue.so", "./rogue.so", "rogue.so"])
def test_library_is_not_taken_from_the_current_folder(name, tmp_path):
    """Code that is in the current folder is not run when an input from elsewhere is solved."""
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "sub").mkdir(parents=True)
    there.mkdir()
    rogue(here, **OTHER_SPRING)
    shutil.copy(here / "rogue.so", here / "sub")
    (there / "mine.nml").write_text(ROGUE_MODEL.replace("rogue.so", name))
    done = run("check", there / "mine.nml", cwd=here)
    assert not (here / "loaded").exists()
    assert done.status == BAD_INPUT and "cannot load the library" in done.stderr, done.stderr


def test_verify_takes_the_library_of_the_run(tmp_path):
    folder, elsewhere = tmp_path / "input", tmp_path / "elsewhere"
    for place in (folder, elsewhere):
        place.mkdir()
    rogue(folder, **SPRING)
    rogue(elsewhere, **OTHER_SPRING)
    result = elsewhere / "rogue.h5"
    assert run("solve", "input/rogue.nml", "-o", result, "--set", "law(1)%odd=.true.", cwd=tmp_path).status == ALL_CONVERGED
    done = run("verify", result, cwd=elsewhere)
    assert done.status == ALL_CONVERGED and "agrees" in done.stdout, done.stdout + done.stderr
    assert not (elsewhere / "loaded").exists()
    shutil.copy(elsewhere / "rogue.so", folder)
    for words in (["verify", result], ["resume", result]):
        done = run(*words, cwd=elsewhere)
        assert done.status == BAD_INPUT and "another library of a law" in done.stderr, done.stdout + done.stderr
        assert not (elsewhere / "loaded").exists(), words            # nothing of it was run
    (folder / "rogue.so").unlink()
    done = run("verify", result, cwd=elsewhere)
    assert done.status == BAD_INPUT and "cannot load the library" in done.stderr, done.stdout + done.stderr


def test_python_saves_a_result_without_its_library(tmp_path, monkeypatch):
    """The input of a file is stored as it was, with the library that the run had."""
    rogue(tmp_path, **SPRING)
    text = (tmp_path / "rogue.nml").read_text()
    (tmp_path / "rogue.nml").write_text(text.replace("'rogue.so'", f"'{tmp_path}/rogue.so'"))
    assert run("solve", "rogue.nml", "--set", "law(1)%odd=.true.", cwd=tmp_path).status == ALL_CONVERGED
    (tmp_path / "rogue.so").unlink()
    rogue(tmp_path, **OTHER_SPRING)
    (tmp_path / "loaded").unlink(missing_ok=True)
    monkeypatch.chdir(tmp_path)
    nhbm.open_dataset("rogue.h5").nhbm.save("copy.h5")
    assert not (tmp_path / "loaded").exists()
    with h5py.File("rogue.h5") as before, h5py.File("copy.h5") as after:
        assert after["input_libraries"][()] == before["input_libraries"][()]


def test_resume_takes_the_library_of_the_run(tmp_path):
    """Not the one in the current folder."""
    folder, elsewhere = tmp_path / "input", tmp_path / "elsewhere"
    for place in (folder, elsewhere):
        place.mkdir()
    rogue(folder, **SPRING)
    rogue(elsewhere, **OTHER_SPRING)
    done = run("solve", "rogue.nml", cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    done = run("resume", folder / "rogue.h5", "--retry", cwd=elsewhere)
    assert done.status == ALL_CONVERGED and "another library" not in done.stdout, done.stdout + done.stderr
    assert not (elsewhere / "loaded").exists()


def test_check_finds_a_wrong_sign(wrong_law):
    done = run("check", "one_mass.nml", cwd=wrong_law)
    assert done.status == NOT_ALL_CONVERGED
    (row,) = [line for line in done.stdout.splitlines() if line.startswith("mine ")]
    assert row.endswith("wrong: df/dz")
    assert done.stdout.splitlines()[-1] == "the input can be solved, but its results may be wrong: correct the law"


def test_other_points_go_on_when_a_law_fails(wrong_law):
    source = wrong_law / "one_mass.nml"
    keys = "&solver method = 'broyden' /\n&error_estimate is_on = .false. /\n"  # the error estimate needs right derivatives
    source.write_text(ONE_MASS + keys + "&sweep parameter = 'law(1)%parameters', values = 0, 2, 0.1 /\n")
    done = run("solve", source, cwd=wrong_law)
    assert done.status == NOT_ALL_CONVERGED, done.stderr
    with Results(wrong_law / "one_mass.h5") as results:
        assert [results.status_name(i) for i in range(3)] == ["converged", "failed", "converged"]
        assert results.message(1) == "law 'mine': 'wrong_evaluate' returned -2"


# A spring that modifies its inputs; `{body}` precedes the forces.
ROGUE = """
#include "nhbm_user_law.h"
#include <math.h>
#include <signal.h>
#include <stddef.h>
#include <stdlib.h>

{constructor}

int rogue_info(nhbm_law_info_t *info)
{{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   {info}
   return 0;
}}

int rogue_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                   const double *parameters, double *f, double *df_dz, double *df_dv)
{{
   {body}
   for (int i = 0; i < n; i++) {{
      f[i] = {force};
      if (df_dz != NULL)
         df_dz[i] = 1.0;
   }}
   return 0;
}}
"""
ROGUE_PARTS = {"constructor": "", "info": "", "body": "", "force": "z[i]"}
ROGUE_MODEL = ONE_MASS.replace("'wrong.so'", "'rogue.so'").replace("'wrong'", "'rogue'").replace(", parameters = 0.0", "")
ROGUE_MODEL += "&integration duration = 1.0 /\n"


def rogue(folder, **parts):
    """Folder with the library and the input `rogue.nml`."""
    (folder / "rogue.c").write_text(ROGUE.format(**{**ROGUE_PARTS, **parts}))
    command = ["cc", "-w", "-O0", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "rogue.so", "rogue.c"]
    subprocess.run(command, cwd=folder, check=True)
    (folder / "rogue.nml").write_text(ROGUE_MODEL)
    return folder


@pytest.mark.parametrize("verb", ["check", "solve", "integrate", "plan"])
@pytest.mark.parametrize("status", [0, 7])
def test_exit_at_loading_is_no_success(status, verb, tmp_path):
    folder = rogue(tmp_path, constructor=f"__attribute__((constructor)) static void begin(void) {{ exit({status}); }}")
    done = run(verb, "rogue.nml", cwd=folder)
    assert done.status == BAD_INPUT and "has called exit()" in done.stderr, (done.status, done.stderr)


@pytest.mark.parametrize("verb", ["check", "integrate"])
@pytest.mark.parametrize("ending", ["exit(0);", "exit(7);", "quick_exit(0);"])
def test_exit_of_a_law_is_no_success(ending, verb, tmp_path):
    done = run(verb, "rogue.nml", cwd=rogue(tmp_path, body=ending))
    assert done.status == BAD_INPUT and "has called exit()" in done.stderr, (done.status, done.stderr)


@pytest.mark.parametrize("ending", ["abort();", "raise(SIGSEGV);", "raise(SIGFPE);"])
@pytest.mark.parametrize("place", ["info", "body"])
def test_signals_during_check_are_reported(place, ending, tmp_path):
    done = run("check", "rogue.nml", cwd=rogue(tmp_path, **{place: ending}))
    if "AddressSanitizer" in done.stderr:
        pytest.skip("the address sanitizer has its own handlers")
    assert done.status == BAD_INPUT and "ended the process" in done.stderr, (done.status, done.stderr)


@pytest.mark.parametrize(
    "parts, says",
    [
        ({"force": "NAN"}, "not known: no sample could be compared"),
        ({"force": "z[i] + 1e-3 * rand() / RAND_MAX"}, "wrong: two evaluations of the same motion differ"),
        ({"body": "return 0;"}, "not known: no sample could be compared"),
        ({"body": "((double *)z)[0] = 1.0;"}, "wrong: it writes to its inputs"),
    ],
    ids=["NaN", "random", "no force", "writes inputs"],
)
def test_check_does_not_call_it_sound(parts, says, tmp_path):
    done = run("check", "rogue.nml", cwd=rogue(tmp_path, **parts))
    assert done.status == NOT_ALL_CONVERGED and says in done.stdout, (done.status, done.stdout)
    assert "the input is valid" not in done.stdout


@pytest.mark.parametrize("parts", [{"force": "NAN"}, {"body": "return 0;"}], ids=["NaN", "no force"])
def test_point_without_forces_does_not_converge(parts, tmp_path):
    done = run("solve", "rogue.nml", cwd=rogue(tmp_path, **parts))
    assert done.status == NOT_ALL_CONVERGED, done.stderr
    with Results(tmp_path / "rogue.h5") as results:
        assert results.status_name(0) == "not_finite"
