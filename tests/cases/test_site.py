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
    laws.main(tmp_path)
    names = set(laws.LAWS)
    assert {path.stem for path in tmp_path.glob("*.md")} == names | {"index"}
    sketches = {path.stem: path.read_text() for path in tmp_path.glob("*.svg")}
    assert set(sketches) == names - {"user"}
    assert all("force [N]" in text and "of the first coordinate [m" in text for text in sketches.values())
    index = (tmp_path / "index.md").read_text()
    for name in names:
        text = (tmp_path / f"{name}.md").read_text()
        assert f"[{name}]({name}.md)" in index and "| key | type |" in text and f"hb_law_{name}.f90" in text
        for link in re.findall(r"\]\((\.\./(?!docs/user/input/)[^)#]+)", text):  # but those to pages that are made, tested below
            assert (tmp_path / link).exists() or (ROOT / link.removeprefix("../")).exists(), f"{name}: {link}"


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """The pages of the site as drivers/site puts them together, divided."""
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
    """A page a group, with the rows of its keys; laws are in the catalogue; nothing is lost, and no page is long."""
    keys = runpy.run_path(str(ROOT / "tests" / "keys"))["keys"]()
    groups = {key.section.partition(" ")[0] for key in keys} - {"law"}
    pages = {path.stem: path.read_text() for path in (source / "docs" / "user" / "input").glob("*.md")}
    assert set(pages) == groups
    for group, text in pages.items():
        mine = [f"`{key.name}` | {key.type}" for key in keys if key.section.partition(" ")[0] == group]
        assert sorted(set(mine) & set(rows_of(text))) == sorted(set(mine)), group
        assert text.startswith(f"# `&{group}`\n") and len(text.split()) < 2500, group
    rest = (source / "docs" / "user" / "input.md").read_text()
    assert len(rest.split()) < 3000 and all(f"\ninput/{group}\n" in rest for group in groups) and "### `&" not in rest


def test_inputs_of_the_gallery_have_titles(laws):
    """Pages of laws and reports show them."""
    inputs = list((ROOT / "inputs" / "gallery").glob("*.nml"))
    assert not [path.name for path in inputs if laws.title(path) == path.stem]


def test_links_follow_the_headings_that_move(source):
    """Of all pages; those to the catalogue of laws lead to one that is made later."""
    pages = {path.relative_to(source): path.read_text() for path in source.rglob("*.md")}
    assert not [name for name, text in pages.items() if re.search(r"\]\([^)]*input\.md#(law|curve|type--|chains-of)", text)]
    moved = [page for page in pages if page.parent.name == "input"]
    others = ("docs/user/input.md", "docs/user/curves.md", "docs/howto/sweep_one.md", "README.md")
    for page in [*moved, *map(Path, others)]:
        text = re.sub(r"^```.*?^```", "", pages[page], flags=re.DOTALL | re.MULTILINE)
        for name, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", text):
            target = (source / page.parent / name).resolve() if name else source / page
            if target.parent.name in ("laws", "pictures") or target.suffix != ".md":
                continue
            assert target.is_file(), f"{page}: {name}"
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            anchors = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
            assert not anchor or anchor in anchors, f"{page}: {name}#{anchor}"


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
