"""The site: its table of contents, and the catalogue of laws with a page for each type and a sketch by the program."""

from __future__ import annotations

import fnmatch
import importlib.util
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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


@pytest.mark.long
def test_every_law_has_a_page_with_a_sketch(laws, tmp_path):
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    laws.main(tmp_path)
    names = set(laws.LAWS)
    pages = tmp_path / "docs" / "user" / "laws"
    assert {path.stem for path in pages.glob("*.md")} == names
    sketches = {path.stem: path.read_text() for path in pages.glob("*.svg")}
    assert set(sketches) == names - {"user"}
    assert all("force [N]" in text and "of the first coordinate [m" in text for text in sketches.values())
    index = (pages.parent / "input" / "law.md").read_text()
    for name in names:
        text = (pages / f"{name}.md").read_text()
        assert f"[{name}](../laws/{name}.md)" in index and "| key | type |" in text and f"hb_law_{name}.f90" in text
        assert name == "user" or f'src="../laws/{name}.svg"' in index
        for link in re.findall(r"\]\(([^)#:]+)[)#]", text):
            assert (pages / link).exists() or (ROOT / "docs/user/laws" / link).exists(), f"{name}: {link}"


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """The pages of the site as drivers/site puts them together, with their contents."""
    folder = tmp_path_factory.mktemp("source")
    others = [ROOT / folder / "README.md" for folder in ("benchmarks", "postproc")]
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *others]:
        copy = folder / page.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(page, copy)
    shutil.copy(ROOT / "docs" / "site" / "index.md", folder)
    subprocess.run([sys.executable, ROOT / "docs" / "site" / "groups.py", folder], check=True)
    return folder


def rows_of(text: str) -> list[str]:
    return re.findall(r"^\| (`\w+` \| [^|]*) \|", text, re.MULTILINE)


def test_every_group_of_the_input_has_a_page(source):
    """A page a group and a law, with the rows of its keys, in the contents; no page is long."""
    keys = runpy.run_path(str(ROOT / "tests" / "keys"))["keys"]()
    groups = {key.section.partition(" ")[0] for key in keys}
    pages = {path.stem: path.read_text() for path in (source / "docs" / "user" / "input").glob("*.md")}
    assert set(pages) == groups
    for group, text in pages.items():
        mine = [
            f"`{key.name}` | {key.type}"
            for key in keys
            if key.section == group or group != "law" and key.section.split()[0] == group
        ]
        assert sorted(set(mine) & set(rows_of(text))) == sorted(set(mine)), group
        assert text.startswith(f"# `&{group}`\n") and len(text.split()) < 2500, group
    rest = (source / "docs" / "user" / "input.md").read_text()
    assert len(rest.split()) < 3000 and all(f"\ninput/{group}\n" in rest for group in groups - {"law"})
    laws = {path.stem: path.read_text() for path in (source / "docs" / "user" / "laws").glob("*.md")}
    assert set(laws) == {key.section.split()[1] for key in keys if key.section.startswith("law ")}
    assert all(text.startswith(f"# {law}\n") and len(text.split()) < 1000 for law, text in laws.items())


def test_inputs_of_the_gallery_have_titles(laws):
    """Pages of laws and reports show them."""
    inputs = list((ROOT / "inputs" / "gallery").glob("*.nml"))
    assert not [path.name for path in inputs if laws.title(path) == path.stem]


def test_recipes_are_named_by_their_verbs(source):
    contents = (source / "index.md").read_text()
    recipes = {path.stem for path in (ROOT / "docs" / "howto").glob("*.md")} - {"README"}
    assert set(re.findall(r"^[A-Z][^<\n]* <docs/howto/(\w+)>$", contents, re.MULTILINE)) == recipes


def test_sketches_are_the_formulas(laws):
    z, f = laws.forces("cubic_spring")
    np.testing.assert_allclose(f, 1.5 * z**3, atol=1e-12)
    z, f = laws.forces("elastic_stop")
    np.testing.assert_allclose(f, 3 * (np.maximum(z - 0.2, 0) + np.minimum(z + 0.2, 0)), atol=1e-12)
    v, f = laws.forces("stribeck")
    np.testing.assert_allclose(f, (0.3 + 0.2 * np.exp(-((v / 0.4) ** 2))) * np.tanh(v / 0.05), atol=1e-12)
    assert 0.99 < v.max() < 1.01


@pytest.mark.long
def test_pictures_of_the_concepts_are_drawn(tmp_path):
    """Those in docs/pictures are of this script."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(str(ROOT / path) for path in ("postproc/src", "drivers/python/src"))}
    subprocess.run([sys.executable, ROOT / "docs" / "site" / "concepts.py", tmp_path], check=True, env=environment)
    drawn = {path.name for path in tmp_path.glob("*.png")}
    assert drawn == {path.name for path in (ROOT / "docs" / "pictures").glob("concept_*.png")} and len(drawn) == 4
