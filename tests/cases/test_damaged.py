"""Damaged files: a message and exit status 2, never a signal. tests/fuzz tries thousands; these are cases that failed once."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from nhbm.command import main as nhbm_model
from nhbm_post import Results
from nhbm_post.errors import ReaderError

from program import BAD_INPUT, INCOMPLETE, command, environment, run
from user_law import HEADER_FOLDER

sys.path.append(str(Path(__file__).resolve().parents[1] / "fuzz"))
from fuzz_results import campaign  # noqa: E402

MODEL = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
"""
SPRING = "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n"
MINE = "&law type = 'user', library = 'mine.so', name = 'mine', dof = 'x1' /\n"
SWEEP = "&sweep parameter = 'load(1)%cos', values = 0.5, 1.0, 1.5 /\n"

LAW = """
#include "nhbm_user_law.h"
int mine_info(nhbm_law_info_t *info) { info->api_version = NHBM_USER_LAW_API; info->n_coordinates = 1; return 0; }
int mine_evaluate(int n, int m, int stride, const double *z, const double *v, int k, const double *p, double *f,
                  double *df_dz, double *df_dv) { return n < 0; }
"""


def replace(file, name, data):
    del file[name]
    file[name] = data


def set_numbers(file, name, value):
    file[name][...] = value


DAMAGES = {
    "a status that is none": lambda file: set_numbers(file, "status", 2**31 - 1),
    "no points": lambda file: replace(file, "status", np.zeros(0, "i4")),
    "fewer rows": lambda file: replace(file, "residual", np.zeros(1)),
    "other axes": lambda file: replace(file, "tuple", np.zeros(7, "i4")),
    "a scalar for a column": lambda file: replace(file, "fallback", 1),
    "numbers for text": lambda file: replace(file, "input_text", np.zeros((1, 3))),
    "numbers for labels": lambda file: replace(file, "dof", np.zeros((3, 100))),
    "longer letters": lambda file: replace(file, "law", np.full((1, 64), b"text", "S9")),
    "no text": lambda file: replace(file, "input_overrides", h5py.Empty("S1")),
    "texts for a text": lambda file: replace(file, "input_complete", ["a", "b"]),
    "an attribute of several numbers": lambda file: file.attrs.__setitem__("n_ranks", np.zeros(1000, "i4")),
    "an attribute of several texts": lambda file: file.attrs.__setitem__("title", ["text"] * 1000),
    "an empty attribute": lambda file: file.attrs.__setitem__("git_commit", h5py.Empty("S1")),
}


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A result file whose points are all pending."""
    folder = tmp_path_factory.mktemp("damaged")
    (folder / "case.nml").write_text(MODEL + SPRING + SWEEP)
    done = run("solve", "case.nml", "--time-limit", "0", cwd=folder)
    assert done.status == INCOMPLETE, done.stderr
    return (folder / "case.h5").read_bytes()


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("verb", ["info", "resume"])
def test_damaged_content_is_named(verb, damage, begun, tmp_path):
    path = tmp_path / "case.h5"
    path.write_bytes(begun)
    with h5py.File(path, "r+") as file:
        DAMAGES[damage](file)
    done = run(verb, path, cwd=tmp_path)
    assert done.status == BAD_INPUT and len(done.messages) == 1, done.stderr
    assert "case.h5" in done.stderr


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A result file whose points are all solved."""
    folder = tmp_path_factory.mktemp("solved")
    (folder / "case.nml").write_text(MODEL + SPRING + SWEEP)
    done = run("solve", "case.nml", cwd=folder)
    assert done.status == 0, done.stderr
    return (folder / "case.h5").read_bytes()


@pytest.mark.parametrize("entry", [-(2**31), 2**31 - 1, 10**8, 1, 7])
@pytest.mark.parametrize("verb", ["resume", "verify"])
def test_a_tuple_that_is_not_of_the_input_is_refused(verb, entry, solved, tmp_path):
    """The tuples have no checksum. A large one would take gigabytes, -2**31 has no absolute value, 1 is there twice."""
    path = tmp_path / "case.h5"
    path.write_bytes(solved)
    with h5py.File(path, "r+") as file:
        file["tuple"][-1] = entry
    done = run(verb, path, cwd=tmp_path)
    assert done.status == BAD_INPUT and "case.h5" in done.stderr and "harmonics" in done.stderr, done.stderr


def test_resume_refuses_rows_without_axes(begun, tmp_path):
    path = tmp_path / "case.h5"
    path.write_bytes(begun)
    with h5py.File(path, "r+") as file:
        replace(file, "iterations", 7)
    done = run("resume", path, cwd=tmp_path)
    assert done.status == BAD_INPUT and "'iterations'" in done.stderr


def test_a_file_that_another_program_has_compressed_is_named(begun, tmp_path):
    """Its rows cannot be written one by one; the message has the command that undoes it."""
    path = tmp_path / "case.h5"
    path.write_bytes(begun)
    with h5py.File(path, "r+") as file:
        content, axes = file["residual"][...], [[scale.name for scale in axis.values()] for axis in file["residual"].dims]
        del file["residual"]
        file.create_dataset("residual", data=content, chunks=True, compression="gzip")
        for axis, names in zip(file["residual"].dims, axes):
            for name in names:
                axis.attach_scale(file[name])
    done = run("resume", path, cwd=tmp_path)
    assert done.status == BAD_INPUT and "'residual' is stored in chunks" in done.stderr, done.stderr
    assert "h5repack -l CONTI -f NONE" in done.stderr


@pytest.mark.parametrize("column", ["attempts", "reason", "status"])
def test_numbers_keep_their_meaning_on_resume(column, begun, tmp_path):
    """A file of a version that had other rows in its table of attempts, of reasons or of outcomes."""
    path = tmp_path / "case.h5"
    path.write_bytes(begun)
    with h5py.File(path, "r+") as file:
        words = file[column].attrs["flag_meanings"].split()
        file[column].attrs["flag_meanings"] = " ".join(words[:3] + words[4:])
    content = path.read_bytes()
    done = run("resume", path, cwd=tmp_path)
    assert done.status == BAD_INPUT and f"numbers of '{column}'" in done.stderr and ", commit " in done.stderr, done.stderr
    assert path.read_bytes() == content


def store_elsewhere(path, name, form):
    """Moves a dataset of a file into another file."""
    other = path.with_name("other")
    with h5py.File(path, "r+") as file:
        values = file[name][()]
        del file[name]
        if form == "external storage":
            values.tofile(other)
            file.create_dataset(name, values.shape, values.dtype, external=[(str(other), 0, h5py.h5f.UNLIMITED)])
            return
        with h5py.File(other, "w") as there:
            there["x"] = values
        if form == "external link":
            file[name] = h5py.ExternalLink(str(other), "x")
        elif form == "link to a link":
            file["link"], file[name] = h5py.ExternalLink(str(other), "x"), h5py.SoftLink("/link")
        else:
            layout = h5py.VirtualLayout(values.shape, values.dtype)
            layout[...] = h5py.VirtualSource(str(other), "x", values.shape)
            file.create_virtual_dataset(name, layout)


@pytest.mark.parametrize("form", ["external storage", "virtual dataset", "external link", "link to a link"])
def test_nothing_is_read_from_other_files_that_a_file_names(form, begun, tmp_path, capsys):
    path = tmp_path / "model.h5"
    assert nhbm_model(["beam", "-o", str(path)]) == 0
    store_elsewhere(path, "stiffness/data", form)
    structure = "&structure type = 'model', file = 'model.h5', damping_mass = 1.0 /\n"
    (tmp_path / "model.nml").write_text(structure + "".join(MODEL.splitlines(keepends=True)[2:]).replace("'x1'", "1"))
    (tmp_path / "case.h5").write_bytes(begun)
    store_elsewhere(tmp_path / "case.h5", "status", form)
    before = (tmp_path / "other").read_bytes()
    for verb, file in (("check", "model.nml"), ("info", "case.h5"), ("resume", "case.h5")):
        done = run(verb, file, cwd=tmp_path)
        assert done.status == BAD_INPUT and "is stored in another file" in done.stderr, (verb, done.stderr)
    capsys.readouterr()
    assert nhbm_model(["info", str(path)]) == 2
    assert "is stored in another file" in capsys.readouterr().err
    with pytest.raises(ReaderError, match="is stored in another file"):
        Results(tmp_path / "case.h5")
    assert (tmp_path / "other").read_bytes() == before


@pytest.mark.parametrize("compression", [None, "gzip"])
@pytest.mark.parametrize("name", ["status", "tuple", "input_text", "coefficients"])
def test_rows_that_are_not_there_take_no_memory(name, compression, begun, tmp_path):
    """300 million of them took 1.2 GB, texts 2.4 GB; `verify` ended with a backtrace of the run-time library."""
    path = tmp_path / "case.h5"
    for verb in ("info", "resume", "verify"):
        path.write_bytes(begun)
        with h5py.File(path, "r+") as file:
            shape, dtype = file[name].shape[1:], file[name].dtype
            del file[name]
            file.create_dataset(name, (300_000_000, *shape), dtype, chunks=(100_000, *shape), compression=compression)
        code = "import resource, subprocess, sys; print(subprocess.run(sys.argv[1:]).returncode); "
        code += "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
        words = [sys.executable, "-c", code, *command(verb, "case.h5")]
        done = subprocess.run(words, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=True)
        status, kilobytes = map(int, done.stdout.split()[-2:])
        assert kilobytes < 2e5 and "Backtrace" not in done.stderr
        assert (status == BAD_INPUT and f"'{name}' claims" in done.stderr) or (name, verb) == ("coefficients", "info"), done.stderr


@pytest.mark.parametrize("n_bytes", [10**5, 10**9, 2**40, 2**62])
def test_texts_beyond_the_file_are_named(n_bytes, begun, tmp_path):
    """HDF5 copies as many bytes as its heap specifies, and crashes."""
    data = bytearray(begun)
    at = data.find(b"GCOL")  # signature, version and size of 16 bytes; of each text index, count and size of 16 bytes
    while at >= 0:
        data[at + 24 : at + 32] = n_bytes.to_bytes(8, "little")
        at = data.find(b"GCOL", at + 1)
    path = tmp_path / "case.h5"
    path.write_bytes(data)
    for verb in ("info", "resume"):
        done = run(verb, path, cwd=tmp_path)
        if "AddressSanitizer" in done.stderr and "libhdf5" in done.stderr:
            pytest.skip("the sanitizer ends the process where the library errs, before it dies of a signal")
        assert done.status == BAD_INPUT and "case.h5" in done.stderr, (done.status, done.stderr)


@pytest.mark.parametrize("part", [0.0, 0.1, 0.3, 0.6])
def test_library_that_is_cut_off_is_named(part, tmp_path):
    (tmp_path / "mine.c").write_text(LAW)
    command = ["cc", "-shared", "-fPIC", f"-I{HEADER_FOLDER}", "-o", "mine.so", "mine.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = tmp_path / "mine.so"
    library.write_bytes(library.read_bytes()[: int(part * library.stat().st_size)])
    (tmp_path / "case.nml").write_text(MODEL + MINE)
    done = run("check", "case.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and "mine.so" in done.stderr, (done.status, done.stderr)


@pytest.mark.long
@pytest.mark.parametrize("make", ["result", "model"])
def test_python_tools_end_within_a_second(make, begun, tmp_path):
    """A result or one line, for 200 of the damaged files of tests/fuzz."""
    path = tmp_path / "case.h5"
    path.write_bytes(begun)
    if make == "model":
        assert nhbm_model(["beam", "-o", str(path), "--overwrite"]) == 0
    assert campaign(path, range(200), seed=5) == {}


@pytest.mark.long
def test_model_in_which_hdf5_finds_no_end_is_named_with_the_entry(tmp_path):
    path = tmp_path / "case.h5"
    assert nhbm_model(["beam", "-o", str(path)]) == 0
    data = bytearray(path.read_bytes())
    at = data.find(b"GCOL")
    data[at + 24 : at + 32] = (2**64 - 16).to_bytes(8, "little")
    path.write_bytes(data)
    command = [sys.executable, "-m", "nhbm.command", "info", path]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False, timeout=600)
    assert done.returncode == 2 and "case.h5', at 'format': HDF5 exceeded its time" in done.stderr
