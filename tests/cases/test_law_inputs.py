"""Random inputs with each kind of law (tests/law_inputs.py), and the program that solves them under valgrind (tests/valgrind)."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
os.environ.setdefault("NHBM_LIBRARY", str(LIBRARY))
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)

import nhbm  # noqa: E402


def write_inputs(folder: Path, count: int, *options: str) -> set[str]:
    """Their kinds."""
    subprocess.run([sys.executable, ROOT / "tests" / "law_inputs.py", folder, str(count), *options], check=True)
    return {path.stem.rpartition("_")[0] for path in folder.glob("*.nml")}


def test_random_inputs_with_each_law_are_read(tmp_path):
    module = runpy.run_path(str(ROOT / "tests" / "law_inputs.py"))
    laws = {law.name for law in module["LAWS"]()}
    assert write_inputs(tmp_path, 2, "--samples", "lib.so") == laws | set(module["VARIANTS"])
    shutil.rmtree(tmp_path)
    assert write_inputs(tmp_path, 6) == (laws | set(module["VARIANTS"])) - {"user"}
    for path in tmp_path.glob("*.nml"):
        nhbm.Session().read(path.read_text())


def test_all_that_inputs_ask_for_is_looked_at(tmp_path):
    """A curve, a record, a derivative, time integration along a motion: each of the random inputs asks for one of them."""
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    program = tmp_path / "solve_inputs"
    folders = [f"-I{ROOT / 'src' / folder}" for folder in ("api", "laws")]
    subprocess.run([compiler, *folders, ROOT / "tests" / "support" / "solve_inputs.c", LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}",
                    "-o", program],
                   check=True)  # fmt: skip
    write_inputs(tmp_path, 20)
    inputs = sorted(tmp_path.glob("cubic_spring_[0-9]*.nml"))
    found = subprocess.run([program, *inputs], capture_output=True, text=True, check=True).stdout
    for what in ("motion", "next motion", "curve", "verification", "record"):
        assert f".nml: {what}" in found
    wrong = tmp_path / "wrong.nml"
    wrong.write_text("&tones frequencies = 1.0 /\n")
    assert subprocess.run([program, wrong], capture_output=True, check=False).returncode == 1
