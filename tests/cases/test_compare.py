"""What tests/compare calls a dependence on the kernel of BLAS, and what it records."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from program import program

ROOT = Path(__file__).resolve().parents[2]



def script(name: str):
    """A script of tests/ as a module."""
    loader = importlib.machinery.SourceFileLoader(name, str(ROOT / "tests" / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


compare = script("compare")


def point(kind="", value=1.0, status="converged", amplitude=1.0, is_stable=1, estimate=1e-3):
    motion = {(1,): np.array([[amplitude, 0.0]])}
    return {
        "status": status, "motion": motion, "estimate": estimate, "is_stable": is_stable,
        "branch": 0, "kind": kind, "parameter": value,
    }  # fmt: skip


def test_differences_within_the_estimate_do_not_count():
    assert compare.run_differences([point(amplitude=1.0)], [point(amplitude=1.0005)], False) == []
    assert "motions differ" in compare.run_differences([point(amplitude=1.0)], [point(amplitude=1.01)], False)[0]


def test_rounding_errors_around_zero_do_not_count():
    assert compare.run_differences([point(amplitude=1e-18)], [point(amplitude=-2e-18)], False) == []
    assert compare.run_differences([point(amplitude=0.0)], [point(amplitude=1e-9)], False) != []


def test_statuses_and_stability_count():
    assert compare.run_differences([point()], [point(status="truncated")], False) == ["point 1: status converged and truncated"]
    assert compare.run_differences([point()], [point(is_stable=-1)], False) == ["point 1: is_stable 1 and -1"]


def test_steps_of_curves_may_differ_and_located_points_may_not():
    old = [point("start"), point("regular", 1.1), point("fold", 1.2), point("end", 2.0)]
    more_steps = [point("start"), point("regular", 1.05), point("regular", 1.15), point("fold", 1.2), point("end", 2.0)]
    assert compare.run_differences(old, more_steps, False) == []
    without = [point("start"), point("regular", 1.1), point("end", 2.0)]
    assert "1 fold against nothing" in compare.run_differences(old, without, False)[0]
    moved = [point("start"), point("regular", 1.1), point("fold", 1.21), point("end", 2.0)]
    assert "at 1.2 and 1.21" in compare.run_differences(old, moved, False)[0]


@pytest.mark.long
def test_a_record_is_written_and_its_differences_are_printed(tmp_path):
    source = ROOT / "inputs" / "paper" / "table2.nml"
    record = tmp_path / "work.txt"
    command = [sys.executable, str(ROOT / "tests" / "compare"), "--record", str(record), program(), str(source)]
    first = subprocess.run(command, capture_output=True, text=True, env=os.environ)
    assert first.returncode == 0 and "not recorded ->" in first.stdout
    assert "inputs/paper/table2.nml: " in record.read_text() and " evaluations" in record.read_text()
    assert subprocess.run(command, capture_output=True, text=True).stdout == ""
    record.write_text(record.read_text().replace(" iterations", "0 iterations"))
    assert " iterations" in subprocess.run(command, capture_output=True, text=True).stdout


def test_the_limit_is_of_processor_time(tmp_path):
    def solve(name, text):
        path = tmp_path / name
        path.write_text(f"#!{sys.executable} -IS\nimport time\n{text}\nraise SystemExit('no input')\n")
        path.chmod(0o755)
        return compare.solve(str(path), ROOT / "inputs" / "paper" / "table2.nml", 1.0, compare.read_work)

    assert solve("waits", "time.sleep(1.5)") == "refused: no input"
    assert solve("works", "while time.process_time() < 30: pass") == "not within 1 s"


def test_kernels_that_the_processor_does_not_have_are_skipped(monkeypatch):
    assert compare.missing_instructions(["Prescott"]) == {}
    monkeypatch.setattr(Path, "read_text", lambda path: "flags\t\t: pni avx")
    assert compare.missing_instructions(["Sandybridge", "Haswell"]) == {"Haswell": {"avx2", "fma"}}


def test_an_unknown_kernel_is_refused():
    done = subprocess.run([sys.executable, str(ROOT / "tests" / "kernels"), "Pentium"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "unknown kernel Pentium; known: Prescott, " in done.stderr


def test_kernels_fail_where_a_test_fails():
    is_failure = script("kernels").is_failure
    assert is_failure("failed: test_hb_gmres") and is_failure("could not be built")
    assert not is_failure("100% tests passed, 0 tests failed out of 140")
    assert not is_failure("skipped: this processor has no avx512_bf16")
