"""Threads with one model each: no shared static data, and no race that a detector finds."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from program import read, run

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)
ROOT = Path(__file__).resolve().parents[2]
SUPPORT = ROOT / "tests" / "support"


def test_no_lengths_of_texts_are_static():
    """gfortran keeps the length of a deferred-length function result in static memory, `slen` with a number."""
    symbols = subprocess.run(["nm", LIBRARY], capture_output=True, text=True, check=True).stdout
    assert "nhbm_solve" in symbols
    assert [line.split()[-1] for line in symbols.splitlines() if " slen." in line] == []


@pytest.fixture
def two_models(tmp_path):
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    program = tmp_path / "two_models"
    folders = [f"-I{ROOT / 'src' / folder}" for folder in ("api", "laws")]
    subprocess.run([compiler, "-g", "-pthread", *folders, SUPPORT / "two_models.c", LIBRARY,
                    f"-Wl,-rpath,{LIBRARY.parent}", "-o", program],
                   check=True)  # fmt: skip
    return program


def test_two_threads_find_what_one_finds(two_models):
    found = subprocess.run([two_models], capture_output=True, text=True, check=True).stdout
    assert "did you mean 'stiffness'" in found
    assert "did you mean 'cubic_spring'" in found


@pytest.mark.long
def test_a_race_detector_sees_nothing(two_models):
    valgrind = shutil.which("valgrind") or pytest.skip("valgrind is not installed")
    done = subprocess.run([valgrind, "--tool=helgrind", f"--suppressions={SUPPORT / 'helgrind.supp'}", "--error-exitcode=9",
                           two_models],
                          capture_output=True, text=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]


def test_threads_of_a_point_change_no_bit(tmp_path):
    """Four contacts on 72 x 72 samples, with error estimate and stability."""
    laws = "".join(f"&law type='elastic_stop', dof='x{i}', stiffness=2.0, gap=0.4 /\n" for i in range(1, 5))
    (tmp_path / "shared.nml").write_text(
        "&structure type='chain', n_masses=4, mass=1.0, coupling_stiffness=1.0, ground_stiffness=1.0, damping_mass=0.2 /\n"
        "&tones frequency=0.7, 1.13 /\n&harmonics order=5 /\n&sampling samples=72 /\n"
        "&load dof='x1', tuple=1,0, cos=1.0 /\n&load dof='x4', tuple=0,1, cos=1.0 /\n" + laws,
        encoding="utf-8",
    )
    found = {}
    for n in (1, 2):
        result = tmp_path / f"{n}.h5"
        done = run("solve", "shared.nml", "--set", f"solver%threads={n}", "-o", result, cwd=tmp_path)
        assert ("on 1 rank of 2 threads" in done.stdout) == (n == 2)
        found[n] = read(result, "coefficients", "truncation_estimate", "status", "n_unstable", "stability_estimate")
    for one, shared in zip(found[1], found[2], strict=True):
        assert np.array_equal(one, shared, equal_nan=True)
