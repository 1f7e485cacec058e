"""The tutorials as notebooks (docs/site/notebooks.py): all of their code, in cells that run from the first to the last."""

from __future__ import annotations

import json
import os
import re
import runpy
import subprocess
from pathlib import Path

import pytest
from page_runner import ROOT, blocks_of

from program import environment, program

WRITER = runpy.run_path(str(ROOT / "docs" / "site" / "notebooks.py"))
PAGES = [page for page in sorted((ROOT / "docs" / "start").glob("*.md")) if blocks_of(page)]


def cells_of(page):
    cells = WRITER["notebook_of"](page.read_text(encoding="utf-8"))["cells"]
    return [cell["source"] for cell in cells if cell["cell_type"] == "code"]


def test_all_code_is_in_cells(tmp_path):
    WRITER["main"](str(tmp_path))
    for page in PAGES:
        if not any(kind in ("python", "code-cell", "console") for kind, _ in blocks_of(page)):
            continue
        notebook = json.loads((tmp_path / f"{page.stem}.ipynb").read_text(encoding="utf-8"))
        assert notebook["nbformat"] == 4 and len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
        code = "\n".join(cell["source"] for cell in notebook["cells"] if cell["cell_type"] == "code")
        for kind, text in blocks_of(page):
            if kind in ("python", "code-cell"):
                assert all(line in code for line in text.splitlines() if not line.startswith(":tags:")), page.name
            elif kind == "console":
                assert all(re.sub(r"\s+# exit.*", "", line[2:]) in code for line in text.splitlines() if line.startswith("$ "))


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_cells_run(page, tmp_path, monkeypatch):
    """As Jupyter does, in a folder without the sources: Python in one interpreter, %%bash by a shell, %%writefile into a file."""
    pytest.importorskip("matplotlib").use("Agg")
    if any("nhbm-model plate" in cell for cell in cells_of(page)):
        pytest.importorskip("skfem")
    for name, module in (("nhbm-post", "nhbm_post"), ("nhbm-model", "nhbm.command")):
        script = tmp_path / "bin" / name
        script.parent.mkdir(exist_ok=True)
        script.write_text(f'#!/bin/sh\nexec "{os.sys.executable}" -m {module} "$@"\n')
        script.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    variables = {**environment(), "PATH": f"{tmp_path / 'bin'}:{Path(program()).parent}:{os.environ['PATH']}"}
    names = {"__name__": "__main__"}
    for cell in cells_of(page):
        if cell.startswith("%%bash"):
            done = subprocess.run(["bash", "-c", cell.partition("\n")[2]], env=variables, capture_output=True, text=True)
            assert done.returncode == 0, cell + done.stdout + done.stderr
        elif cell.startswith("%%writefile"):
            (tmp_path / cell.split()[1]).write_text(cell.partition("\n")[2])
        else:
            exec(compile("\n".join(line for line in cell.splitlines() if not line.startswith("%")), page.name, "exec"), names)
