"""Lost or damaged results, during the run or afterwards, are never taken for computed ones."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, checksum_of_row, command, environment, read, run
from user_law import HEADER_FOLDER

ROOT = Path(__file__).resolve().parents[2]
CONVERGED = 1
N_POINTS = 6

# A spring of stiffness 1 whose parameter selects what happens to the result file during the run.
LAW = """
#include "nhbm_user_law.h"
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

int thief_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 1;
   return 0;
}

static void steal(int how)
{
   struct stat file;
   if (stat("case.h5", &file) != 0) return;
   switch (how) {
   case 1: unlink("case.h5"); break;
   case 2: rename("case.h5", "elsewhere.h5"); break;
   case 3: close(open("other.h5", O_CREAT | O_WRONLY, 0666)); rename("other.h5", "case.h5"); break;
   case 4: truncate("case.h5", file.st_size / 2); break;
   case 5:
      close(open("waiting", O_CREAT | O_WRONLY, 0666));
      for (int i = 0; i < 6000 && stat("go", &file) != 0; i++) usleep(100000);
      break;
   default: break;
   }
}

int thief_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                   const double *parameters, double *f, double *df_dz, double *df_dv)
{
   static int is_done = 0;
   if (parameters[0] >= 1.0 && !is_done) {
      is_done = 1;
      steal((int)parameters[0]);
   }
   for (int i = 0; i < n; i++) {
      f[i] = z[i];
      if (df_dz != NULL) df_dz[i] = 1.0;
   }
   return 0;
}
"""

MODEL = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
"""
SPRING = "&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /\n"
THIEF = "&law type = 'user', label = 'thief', library = 'thief.so', name = 'thief', dof = 'x1', parameters = 0.0 /\n"


def compile_law(folder, text=LAW):
    (folder / "thief.c").write_text(text)
    words = ["cc", "-w", "-O0", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "thief.so", "thief.c"]
    subprocess.run(words, cwd=folder, check=True)


def thief(folder, values):
    compile_law(folder)
    sweep = f"&sweep parameter = 'law(1)%parameters', values = {', '.join(map(str, values))} /\n"
    (folder / "case.nml").write_text(MODEL + THIEF + sweep)


@pytest.mark.parametrize(
    ("how", "says", "ranks"),
    [
        pytest.param(1, "deleted", None, id="deleted"),
        pytest.param(2, "moved", None, id="moved"),
        pytest.param(2, "moved", 2, id="moved on two ranks"),
        pytest.param(3, "replaced", None, id="replaced"),
        pytest.param(4, "cut off", None, id="cut"),
    ],
)
def test_file_that_is_lost_under_the_run_is_reported(how, says, ranks, tmp_path):
    thief(tmp_path, [0.1, 0.2, how, 0.3])
    done = run("solve", "case.nml", "--quiet", cwd=tmp_path, ranks=ranks)
    assert done.status == BAD_INPUT, (done.status, done.stderr)
    assert says in done.stderr and "case.h5" in done.stderr, done.stderr


def test_two_runs_do_not_write_to_one_file(tmp_path):
    thief(tmp_path, [0.1, 5, 0.2])
    assert run("solve", "case.nml", "--time-limit", "0", cwd=tmp_path).status == INCOMPLETE
    first = subprocess.Popen(command("resume", "case.h5", "--quiet"), cwd=tmp_path, env=environment())
    try:
        while first.poll() is None and not (tmp_path / "waiting").exists():
            time.sleep(0.01)
        done = run("resume", "case.h5", "--quiet", cwd=tmp_path)
        assert done.status == BAD_INPUT and "another run" in done.stderr, (done.status, done.stderr)
        other = run("solve", "case.nml", "-o", "case.h5", "--overwrite", "--quiet", "--set", "sweep(1)%values=0.1", cwd=tmp_path)
        assert other.status == BAD_INPUT and "another run" in other.stderr, (other.status, other.stderr)
        (tmp_path / "go").touch()
        assert first.wait(600) == ALL_CONVERGED
    finally:
        first.kill()
        first.wait()


# Damage after the run


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Folder with the result of a complete run, and the names of all its datasets with rows that have a checksum."""
    folder = tmp_path_factory.mktemp("sound")
    sweep = f"&sweep parameter = 'load(1)%cos', from = 0.5, to = 1.5, n = {N_POINTS} /\n"
    (folder / "case.nml").write_text(MODEL + SPRING + "&output samples = 8 /\n" + sweep)
    done = run("solve", "case.nml", "--quiet", cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    return folder


def test_checksum_is_that_of_zlib(sound):
    with h5py.File(sound / "case.h5", "r") as file:
        for row, expected in enumerate(file["checksum"][()]):
            assert checksum_of_row(file, row) == expected
        names = file["checksum"].attrs["of"]
        names = (names if isinstance(names, str) else names.decode()).split()
        assert {"status", "coefficients", "residual", "message", "displacement_samples"} <= set(names)


def test_sound_file_passes(sound, tmp_path):
    done = run("info", sound / "case.h5", "--check", cwd=tmp_path)
    assert done.status == 0 and "all rows are as they were written" in done.stdout, (done.stdout, done.stderr)


def place_of(path, name, row):
    """Offset and length of a row in the file."""
    with h5py.File(path, "r") as file:
        data = file[name]
        n_bytes = data.dtype.itemsize * int(np.prod(data.shape[1:], dtype=int))
        return data.id.get_offset() + row * n_bytes, n_bytes


DAMAGES = {
    "a bit of a coefficient": ("coefficients", lambda data: bytes([data[0] ^ 1]) + data[1:]),
    "zeros": ("displacement_samples", lambda data: bytes(len(data))),
    "a status": ("status", lambda data: b"\2\0\0\0"),
    "the checksum itself": ("checksum", lambda data: bytes([data[0] ^ 128]) + data[1:]),
}


def damaged(sound, folder, damage, rows):
    """A copy of the result file with these rows damaged."""
    path = folder / "case.h5"
    shutil.copy(sound / "case.h5", path)
    name, change = DAMAGES[damage]
    with open(path, "r+b") as file:
        for row in rows:
            at, n_bytes = place_of(path, name, row)
            file.seek(at)
            data = file.read(n_bytes)
            file.seek(at)
            file.write(change(data))
    return path


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_rows_are_found_and_solved_again(damage, sound, tmp_path):
    path = damaged(sound, tmp_path, damage, (1, 4))
    done = run("info", path, "--check", cwd=tmp_path)
    assert done.status == BAD_INPUT and "2 points" in done.stderr and "(1, 4)" in done.stderr, (done.status, done.stderr)
    done = run("resume", path, cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "2 points were damaged" in done.stdout, (done.stdout, done.stderr)
    assert run("info", path, "--check", cwd=tmp_path).status == 0
    for name in ("status", "coefficients", "residual", "displacement_samples", "message"):
        assert read(path, name).tobytes() == read(sound / "case.h5", name).tobytes(), name


def test_verify_refuses_damaged_rows(sound, tmp_path):
    path = damaged(sound, tmp_path, "a bit of a coefficient", (1, 4))
    done = run("verify", path, "--periods", "2", cwd=tmp_path)
    assert done.status == BAD_INPUT and "(1, 4)" in done.stderr and "resume" in done.stderr, (done.status, done.stderr)
    done = run("verify", path, "--points", "2,4", "--periods", "2", cwd=tmp_path)
    assert done.status == BAD_INPUT and "1 point " in done.stderr and "(4)" in done.stderr, (done.status, done.stderr)
    assert run("verify", path, "--points", "0,2", "--periods", "2", cwd=tmp_path).status != BAD_INPUT


def test_verify_leaves_the_checksums_right(sound, tmp_path):
    path = tmp_path / "case.h5"
    shutil.copy(sound / "case.h5", path)
    run("verify", path, "--points", "1", "--periods", "2", cwd=tmp_path)
    assert run("info", path, "--check", cwd=tmp_path).status == 0


# Libraries


def test_another_library_is_not_gone_on_with_unasked(tmp_path):
    thief(tmp_path, [0.1, 0.2])
    assert run("solve", "case.nml", "--time-limit", "0", cwd=tmp_path).status == INCOMPLETE
    os.remove(tmp_path / "thief.so")
    compile_law(tmp_path, LAW.replace("f[i] = z[i]", "f[i] = 1.0 * z[i] + 0.0"))
    done = run("resume", "case.h5", cwd=tmp_path)
    assert done.status == BAD_INPUT and "other libraries" in done.stderr and "thief: thief, CRC-32" in done.stderr, done.stderr
    done = run("resume", "case.h5", "--retry", cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "another library" in done.stdout, (done.stdout, done.stderr)


def test_changed_input_of_a_resumed_file_is_reported(tmp_path):
    thief(tmp_path, [0.1, 0.2])
    assert run("solve", "case.nml", "--set", "solver%max_iterations=60", "--time-limit", "0", cwd=tmp_path).status == INCOMPLETE
    done = run("resume", "case.h5", "--time-limit", "0", cwd=tmp_path)
    assert done.status == INCOMPLETE and "has changed" not in done.stderr, done.stderr
    with open(tmp_path / "case.nml", "a") as file:
        file.write("! another text\n")
    done = run("resume", "case.h5", cwd=tmp_path)
    assert done.status == ALL_CONVERGED and "case.nml has changed; the run continues with the input that case.h5" in done.stderr


def test_the_same_library_is_gone_on_with(tmp_path):
    thief(tmp_path, [0.1, 0.2])
    assert run("solve", "case.nml", "--time-limit", "0", cwd=tmp_path).status == INCOMPLETE
    assert run("resume", "case.h5", cwd=tmp_path).status == ALL_CONVERGED
    assert read(tmp_path / "case.h5", "status").tolist() == [CONVERGED] * 2


def test_a_curve_does_not_begin_at_a_damaged_row(tmp_path):
    run("solve", ROOT / "inputs" / "gallery" / "ueda_curve.nml", "-o", "u.h5", "--quiet", cwd=tmp_path)
    (child,) = sorted(tmp_path.glob("u_2*.h5"))
    with h5py.File(child) as file:
        text = file["input_complete"][()]
    (tmp_path / "case.nml").write_bytes(text)
    assert run("solve", "case.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    at, _ = place_of(tmp_path / "u.h5", "curve_unknowns", int(child.stem[2:]))
    with open(tmp_path / "u.h5", "r+b") as file:
        file.seek(at)
        byte = file.read(1)
        file.seek(at)
        file.write(bytes([byte[0] ^ 1]))
    done = run("solve", "case.nml", "--quiet", "--overwrite", cwd=tmp_path)
    assert done.status == BAD_INPUT and "is damaged" in done.stderr, (done.status, done.stderr)
