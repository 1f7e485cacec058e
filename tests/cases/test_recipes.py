"""The recipes (docs/howto) and tutorials (docs/start): their code runs as written and prints what the pages show."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
from pathlib import Path

import pytest
from page_runner import ROOT, blocks_of, compare, is_same, run_page

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
ALONE = [ROOT / "README.md", ROOT / "docs" / "user" / "cheat_sheet.md", ROOT / "docs" / "why" / "beside_pyharm.md"]
PAGES = [*ALONE, *sorted(page for page in ROOT.glob("docs/*/*.md") if page.parent.name in ("howto", "start") and blocks_of(page))]
LONG = {  # pages that take seconds
    "export", "limit_cycle", "resume", "verify",
    "bearing_tables",
    "bolted_joint", "calculix", "cheat_sheet", "dual_rotor", "exercises", "find_folds", "finite_element_bracket", "finite_elements",
    "fit_backbone", "fit_measurement", "friction_damper", "intermodulation", "isola", "law_in_python", "migrate", "mistuned_wheel",
    "normal_mode", "optimise_absorbers", "optimise_damper", "other_solution", "own_matrices", "parametric", "peak_over_gap",
    "one_sector", "period_doubling",
    "pictures", "rotor_rub", "rotor_seal", "small_signal", "surfaces", "sweep_two", "time_signal", "torus",
}  # fmt: skip
MAX_WORDS = {"howto": 450, "start": 1200, "README.md": 1000}


def words(page: Path) -> int:
    return len(page.read_text(encoding="utf-8").split())


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=pytest.mark.long if page.stem in LONG else ()) for page in PAGES], ids=lambda page: page.stem
)
def test_pages_run_as_written(page, tmp_path):
    text = page.read_text(encoding="utf-8")
    if not LIBRARY.is_file() and re.search("import .*nhbm|-lnhbm", text):
        pytest.skip("the shared library was not built")
    if "$ ccx " in text and not shutil.which("ccx"):
        pytest.skip("CalculiX is not here")
    if re.search("nhbm-model (?:plate|solid)|scikit-fem", text) and not importlib.util.find_spec("skfem"):
        pytest.skip("scikit-fem is not here")
    run_page(page, tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_are_short(page):
    assert words(page) <= MAX_WORDS.get(page.parent.name, MAX_WORDS["README.md"])


@pytest.mark.parametrize("folder", sorted({page.parent.name for page in PAGES} & {"howto", "start"}))
def test_index_lists_every_page(folder):
    index = (ROOT / "docs" / folder / "README.md").read_text(encoding="utf-8")
    missing = [page.name for page in PAGES if page.parent.name == folder and f"]({page.name})" not in index]
    assert not missing, f"docs/{folder}/README.md does not list {', '.join(missing)}"


def test_lines_are_compared():
    assert is_same("fold at 1.2696 rad/s, point 89", "fold    at 1.2700 rad/s, point 89")
    assert not is_same("fold at 1.2696 rad/s, point 89", "fold at 1.2696 rad/s, point 90")
    assert not is_same("fold at 1.2696 rad/s", "fold at 1.3 rad/s")
    assert is_same("error: ... by truncation", "error: 3.1E-04 by truncation")
    assert is_same("error: 3.1E-04", "error: 9.0E-05") and not is_same("error: 3.1E-04", "error: 9.0E-03")
    compare(["a", "...", "c"], "a\nb\nc\n", "page")
    with pytest.raises(AssertionError, match="the page has"):
        compare(["c", "a"], "a\nb\nc\n", "page")
