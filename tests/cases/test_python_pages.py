"""Examples in the docstrings of the Python package and in the pages about it run."""

from __future__ import annotations

import doctest
import importlib
import re

import pytest

from in_process import ROOT


@pytest.mark.parametrize("module", ["builders", "keys", "laws", "model"])
def test_examples_of_docstrings(module):
    found = doctest.testmod(importlib.import_module(f"nhbm.{module}"), optionflags=doctest.ELLIPSIS)
    assert found.attempted > 0 and found.failed == 0


@pytest.mark.long
def test_examples_of_the_library_run(tmp_path, monkeypatch):
    """The lines of the page in sequence, as a reader would type them."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/user/library.md").read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    for block in blocks:
        if "nhbm" in block and "open_dataset" not in block:
            exec(block, names)
    assert names["motion"].nhbm.is_converged.all()
