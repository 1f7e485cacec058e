"""The memory estimate: the output of `check` agrees with the memory of a run, and models that cannot fit are rejected."""

import re
import subprocess
import sys

import numpy as np
import pytest
from faults import count_calls, on_linux, run_with_fault
from program import BAD_INPUT, INCOMPLETE, command, environment, run

# Two tones, order 28, three degrees of freedom: the tangent needs almost all of the memory.
LARGE = """&structure
   type = 'chain', n_masses = 3, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 1.0, 1.4142 /
&harmonics order = 28, symmetry = 'none' /
&load dof = 'x1', tuple = 1, 0, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
&law type = 'cubic_spring', dof = 'x2', stiffness = 0.1 /
&solver method = 'newton', max_iterations = 1, fallback = .false. /
&error_estimate is_on = .false. /
"""
MIB = 2**20


@pytest.mark.long  # seconds
def test_estimate_is_what_a_run_takes(tmp_path):
    source = tmp_path / "large.nml"
    source.write_text(LARGE.replace("order = 28", "order = 24"))
    estimated, measured = estimate_and_measurement(source, tmp_path)
    assert estimated > 200 * MIB
    assert estimated / 2 < measured < 2 * estimated


def test_products_take_little(tmp_path):
    source = tmp_path / "products.nml"
    source.write_text(LARGE.replace("newton", "auto"))
    estimated, measured = estimate_and_measurement(source, tmp_path)
    assert estimated < 120 * MIB
    assert estimated / 2 < measured < 2 * estimated


LONG_CHAIN = """&structure type = 'chain', n_masses = 10000, ends = 'fixed', mass = 1.0, coupling_stiffness = 4.0,
   ground_stiffness = 1.0, damping_mass = 0.2 /
&tones frequency = 1.1 /
&harmonics order = 15 /
&load dof = 'x5000', tuple = 1, cos = 5.0 /
&law type = 'elastic_stop', dof = 'x5000', stiffness = 5.0, gap = 0.3 /
"""
TWO_TONES = {
    "frequency = 1.1": "frequency = 1.1, 1.618",
    "order = 15": "order = 5",
    "tuple = 1": "tuple = 1, 0",
    "&law": "&load dof = 'x5000', tuple = 0, 1, cos = 3.0 /\n&law",
}


@pytest.mark.long
@pytest.mark.parametrize("n_tones", [1, 2])
def test_memory_of_a_chain_grows_with_its_length(n_tones, tmp_path):
    """10,000 masses need less than 100 MB, including their error estimate, beside the program and its libraries; dense matrices
    would need 2.4 GB. Twice as many need less than twice as much."""
    text = LONG_CHAIN
    for old, new in TWO_TONES.items() if n_tones == 2 else ():
        text = text.replace(old, new)
    source = tmp_path / "chain.nml"
    source.write_text(text)
    estimated, measured = estimate_and_measurement(source, tmp_path)
    libraries = peak_of("version", cwd=tmp_path)
    assert measured - libraries < 100 * MIB
    assert estimated / 2 < measured < 2 * estimated
    source.write_text(text.replace("10000", "20000"))
    assert estimate_and_measurement(source, tmp_path)[1] - libraries < 2 * (measured - libraries)


GRID = """&structure type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 1.0, 1.4142 /
&harmonics order = 12 /
&load dof = 'x1', tuple = 1, 0, cos = 1.0 /
&load dof = 'x1', tuple = 0, 1, cos = 1.0 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 1.0, gap = 0.5 /
&sampling samples = 512, 512 /
"""


def test_error_estimate_of_two_tones_doubles_their_samples(tmp_path):
    """It does not take four times as many, as with one tone or rigid walls."""
    source = tmp_path / "grid.nml"
    source.write_text(GRID)
    estimated, measured = estimate_and_measurement(source, tmp_path)
    assert estimated / 2 < measured < 2 * estimated


def estimate_and_measurement(source, tmp_path):
    """The estimate of `check` for one point, and the largest resident memory of a run, in bytes."""
    estimate = re.search(r"^memory +(\d+) MiB", run("check", source, cwd=tmp_path).stdout, re.MULTILINE)
    assert estimate, "nhbm check says no memory"
    return int(estimate.group(1)) * MIB, peak_of("solve", source, "-o", tmp_path / "result.h5", "--quiet", cwd=tmp_path)


def peak_of(*arguments, cwd):
    """The largest resident memory of a run, in bytes."""
    # A process starts with the peak of its parent: a small process is put in between.
    code = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], stderr=subprocess.DEVNULL); "
    code += "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    between = [sys.executable, "-c", code, *command(*arguments)]
    done = subprocess.run(between, cwd=cwd, env=environment(), capture_output=True, text=True, check=True)
    return int(done.stdout.split()[-1]) * 1024


def test_limit_refuses_with_what_would_fit(tmp_path):
    source = tmp_path / "large.nml"
    source.write_text(LARGE)
    done = run("solve", source, "--set", "solver%memory_limit=0.1", cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert len(done.messages) == 1
    assert "102 MiB are available for each process" in done.stderr
    assert re.search(r"tangent \d+ MiB.*What would fit: order \d+ instead of 28", done.stderr)
    order = re.search(r"order (\d+) instead", done.stderr).group(1)
    assert run(
        "check", source, "--set", "solver%memory_limit=0.1", "--set", f"harmonics%order={order}", cwd=tmp_path
    ).status == 0


def test_more_than_the_computer_has_is_refused(tmp_path):
    source = tmp_path / "large.nml"
    source.write_text(LARGE.replace("order = 28", "order = 1000"))
    done = run("check", source, cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "of memory" in done.stderr and "What would fit" in done.stderr


DUFFING = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 2.0 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
"""


@on_linux
def test_a_small_allocation_that_fails_ends_with_a_message(tmp_path):
    """Wherever it is in the program: compiled Fortran does not test those of assignments, and crashed."""
    (tmp_path / "case.nml").write_text(DUFFING)
    words = ("solve", "case.nml", "--overwrite", "--quiet")
    n = count_calls(*words, cwd=tmp_path, call="memory")
    assert n > 100
    for at in np.unique(np.geomspace(1, n - 1, 40).astype(int)):
        done = run_with_fault(*words, cwd=tmp_path, call="memory", at=at)
        assert done.status in (0, BAD_INPUT, INCOMPLETE), (at, done.status, done.stderr)
        assert done.status == 0 or "memory" in done.stderr, (at, done.stderr)
