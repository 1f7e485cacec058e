"""Programs in C and Fortran that link the shared library, also with an earlier header, and under valgrind."""

from __future__ import annotations

import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from in_process import DUFFING, FRICTION, INCLUDES, LIBRARY, ROOT, duffing, session_of
from program import _ENVIRONMENT

from nhbm import Model


def test_programs_of_an_earlier_header_run(tmp_path):
    """The headers in abi/ are those of the first program built with this version of the interface: it runs, and so does its law."""
    headers = ROOT / "tests" / "cases" / "abi"
    texts = [(folder / "nhbm.h").read_text() for folder in (headers, ROOT / "src" / "api")]
    version = [re.search(r"#define NHBM_API_VERSION (\d+)", text)[1] for text in texts]
    assert version[0] == version[1], "programs must be compiled anew: copy nhbm.h and nhbm_user_law.h to tests/cases/abi"
    compiler = [shutil.which("cc"), f"-I{headers}"]
    example = ROOT / "drivers" / "examples" / "duffing.c"
    subprocess.run([*compiler, example, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}", "-o", "duffing"], cwd=tmp_path, check=True)
    done = subprocess.run(["./duffing"], cwd=tmp_path, capture_output=True, text=True, check=True)
    session = session_of(DUFFING)
    session.set("tones%frequency", 0.5)
    session.solve()
    assert float(done.stdout.split()[1]) == session.column("coefficients").values[0, 1, 0]
    law = ROOT / "inputs" / "user_law" / "friction.c"
    subprocess.run([*compiler, "-shared", "-fPIC", law, "-o", "friction.so", "-lm"], cwd=tmp_path, check=True)
    slider = "dof = 'x1', {} /\n"
    texts = [FRICTION + "&law " + slider.format(keys) for keys in ("type = 'jenkins', stiffness = 2.0, limit = 0.2",
             "type = 'user', library = 'friction.so', name = 'friction', parameters = 2.0, 0.2, odd = .true.")]  # fmt: skip
    found = [Model.from_namelist(text, tmp_path).solve()["coefficients"].values for text in texts]
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-10)


def test_the_wall_in_c_has_the_number_of_the_paper(tmp_path):
    """The same number as the program in Fortran, of which tests/configure/install.cmake asserts it."""
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    source = ROOT / "drivers" / "examples" / "wall" / "wall.c"
    command = [compiler, "-std=c11", "-Wall", "-Wextra", "-Werror", *INCLUDES, source, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}"]
    subprocess.run([*command, "-o", "wall"], cwd=tmp_path, check=True)
    done = subprocess.run(["./wall"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert float(done.stdout.split()[-2]) == pytest.approx(1.0939e-3, abs=1e-7)


def test_programs_in_c_and_fortran_have_the_same_numbers(tmp_path):
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    source = ROOT / "drivers" / "examples" / "duffing.c"
    program = tmp_path / "duffing"
    command = [compiler, "-Wall", "-Werror", *INCLUDES, str(source), str(LIBRARY), "-o", str(program)]
    subprocess.run([*command, f"-Wl,-rpath,{LIBRARY.parent}"], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    session, expected = session_of(DUFFING), []
    frequency = session.parameter("tones%frequency")
    for k in range(5):
        session.set_parameter(frequency, 0.5 + 0.25 * k)
        session.solve(warm=k > 0)
        expected.append(session.column("coefficients").values[0, 1, 0])
    assert [float(line.split()[1]) for line in done.stdout.splitlines()] == expected
    in_fortran = subprocess.run([LIBRARY.parents[1] / "drivers" / "duffing_in_fortran"], capture_output=True, text=True, check=True)
    assert [float(line.split()[1]) for line in in_fortran.stdout.splitlines()] == expected
    by_phase = subprocess.run([LIBRARY.parents[1] / "drivers" / "force_by_phase"], capture_output=True, text=True, check=True)
    np.testing.assert_allclose(
        float(by_phase.stdout), duffing().solve()["coefficients"].values[0, 1, 0], rtol=1e-6
    )  # sets by tolerance


def test_the_header_declares_what_the_library_exports():
    """And tests/api/misuse_*.c misuse each function, except those that have no wrong arguments and return no status."""
    header = (ROOT / "src" / "api" / "nhbm.h").read_text()
    declared = set(re.findall(r"^NHBM_EXPORT [^;(]*?(\w+)\(", header, re.MULTILINE))
    symbols = subprocess.run(["nm", "-D", "--defined-only", LIBRARY], capture_output=True, text=True, check=True).stdout
    assert declared == {line.split()[-1] for line in symbols.splitlines() if " T " in line}
    steps = "".join(path.read_text() for path in (ROOT / "tests" / "api").glob("misuse_*.c"))
    misused = set(re.findall(r"\b(nhbm_\w+)\(", steps))
    assert declared - misused == {"nhbm_get_api_version", "nhbm_get_commit", "nhbm_get_version", "nhbm_get_version_number"}


@pytest.mark.long
def test_memory_that_is_exhausted_is_reported(tmp_path):
    source = ROOT / "tests" / "support" / "no_memory.c"
    subprocess.run([shutil.which("cc"), *INCLUDES, source, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}", "-o", "no_memory"],
                   cwd=tmp_path, check=True)  # fmt: skip
    done = subprocess.run(["./no_memory"], cwd=tmp_path, capture_output=True, text=True, env={**os.environ, **_ENVIRONMENT})
    assert (done.returncode, done.stdout) == (0, "out of memory: nhbm_create: memory is insufficient\n"), done.stderr


@pytest.mark.long
def test_valgrind_finds_nothing_in_the_example_of_c(tmp_path):
    valgrind = shutil.which("valgrind") or pytest.skip("no valgrind")
    source = ROOT / "drivers" / "examples" / "duffing.c"
    subprocess.run(
        [shutil.which("cc"), *INCLUDES, source, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}", "-o", "duffing"], cwd=tmp_path, check=True
    )
    options = ["--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite,indirect,possible"]
    done = subprocess.run(
        [valgrind, *options, "./duffing"], cwd=tmp_path, capture_output=True, text=True, env={**os.environ, **_ENVIRONMENT}
    )
    assert done.returncode == 0, done.stderr
