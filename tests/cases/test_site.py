"""The site: its table of contents, and the catalogue of laws with a page for each type and a sketch by the program."""

from __future__ import annotations

import fnmatch
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import nhbm

ROOT = Path(__file__).resolve().parents[2]
os.environ.setdefault("NHBM_LIBRARY", str(Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"))
pytest.importorskip("matplotlib")
if not Path(os.environ["NHBM_LIBRARY"]).is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)


@pytest.fixture(scope="module")
def laws():
    spec = importlib.util.spec_from_file_location("law_pages", ROOT / "docs" / "site" / "laws.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["law_pages"] = module
    spec.loader.exec_module(module)
    return module


def test_pages_of_the_contents_are_those_of_the_site():
    index = (ROOT / "docs" / "site" / "index.md").read_text()
    patterns = re.search(r"^include_patterns = \[(.*)\]$", (ROOT / "docs" / "site" / "conf.py").read_text(), re.MULTILINE)[1]
    patterns = re.findall('"([^"]+)"', patterns)
    for block in re.findall(r"```\{toctree\}\n(.*?)```", index, re.DOTALL):
        for name in re.findall(r"^([\w/.-]+)$", block, re.MULTILINE):
            assert any(fnmatch.fnmatch(f"{name}.md", pattern) for pattern in patterns), name
            if name.split("/")[0] not in ("gallery", "laws", "reference"):  # which are made
                assert (ROOT / f"{name}.md").is_file(), name


def test_every_law_has_a_page_with_a_sketch(laws, tmp_path):
    laws.main(tmp_path)
    line = next(line for line in (ROOT / "src" / "input_keys.txt").read_text().splitlines() if line.startswith("law | type |"))
    names = set(re.findall(r"'(\w+)'", line))
    assert {path.stem for path in tmp_path.glob("*.md")} == names | {"index"}
    assert {path.stem for path in tmp_path.glob("*.svg")} == names - {"user"}
    index = (tmp_path / "index.md").read_text()
    for name in names:
        text = (tmp_path / f"{name}.md").read_text()
        assert f"[{name}]({name}.md)" in index and "| key | type |" in text and f"hb_law_{name}.f90" in text
        for link in re.findall(r"\]\((\.\./[^)#]+)", text):
            assert (tmp_path / link).exists() or (ROOT / link.removeprefix("../")).exists(), f"{name}: {link}"


def test_sketches_are_the_formulas(laws):
    z, f = laws.forces("cubic_spring", laws.SKETCHES["cubic_spring"])
    np.testing.assert_allclose(f, z**3, atol=1e-12)
    z, f = laws.forces("elastic_stop", laws.SKETCHES["elastic_stop"])
    np.testing.assert_allclose(f, 3 * np.maximum(z - 0.4, 0), atol=1e-12)
    v, f = laws.forces("stribeck", laws.SKETCHES["stribeck"])
    np.testing.assert_allclose(f, (0.3 + 0.2 * np.exp(-((v / 0.4) ** 2))) * np.tanh(v / 0.05), atol=1e-12)
    assert 0.99 < v.max() < 1.01


def test_random_inputs_with_each_law_are_read(laws, tmp_path):
    """tests/law_inputs.py, which has the numbers of the sketches, for tests/valgrind."""
    subprocess.run([sys.executable, ROOT / "tests" / "law_inputs.py", tmp_path, "2"], check=True)
    assert {path.stem.rpartition("_")[0] for path in tmp_path.glob("*.nml")} == set(laws.SKETCHES)
    for path in tmp_path.glob("*.nml"):
        nhbm.Session().read(path.read_text())
