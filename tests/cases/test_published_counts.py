"""Counts in the published tables are those of the program: statuses, tuples and levels, as far as rounding leaves them."""

import re
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest

from program import read, run

ROOT = Path(__file__).resolve().parents[2]
PERFORMANCE = ROOT / "docs" / "develop" / "performance.md"
ACCURACY = ROOT / "docs" / "why" / "accuracy.md"
OF_ROUNDING = 0.05  # of the tuples; of the levels one


def _tolerances() -> dict:
    """Models of the tables by tolerance, as the script that writes them has them."""
    loader = SourceFileLoader("performance", str(ROOT / "tests" / "measurements" / "performance"))
    script = module_from_spec(spec_from_loader("performance", loader))
    loader.exec_module(script)
    return script.TOLERANCES


def _rows(page, mark: str) -> list[list[str]]:
    """Cells of a table between its marks, without its heading."""
    text = page.read_text(encoding="utf-8").split(f"<!-- {mark} -->")[1].split(f"<!-- end of {mark} -->")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    return [row for row in rows[1:] if not re.fullmatch("[-:]+", row[0])]


def _counts(source: str, settings, tolerance: str, folder) -> tuple[int, int, int]:
    """Status, tuples and levels of a point."""
    values = (*settings, f"accuracy%tolerance={tolerance}", "stability%method='off'")
    words = [word for value in values for word in ("--set", value)]
    result = folder / "point.h5"
    run("solve", ROOT / "inputs" / f"{source}.nml", "-o", result, "--overwrite", "--quiet", *words, cwd=folder)
    return tuple(int(value[0]) for value in read(result, "status", "n_harmonics", "n_levels"))


def _assert_near(published: tuple[int, int], found: tuple[int, int, int], what: str) -> None:
    status, tuples, levels = found
    assert status == 1, what
    assert abs(tuples - published[0]) <= OF_ROUNDING * published[0] and abs(levels - published[1]) <= 1, (what, published, found)


@pytest.mark.long
def test_counts_by_tolerance_are_those_of_the_program(tmp_path):
    tolerances = _tolerances()
    of_users = {}
    for name, tolerance, tuples, levels, *_ in _rows(PERFORMANCE, "tolerance"):
        source, settings, _ = tolerances[name]
        found = _counts(source, settings, tolerance, tmp_path)
        _assert_near((int(tuples), int(levels)), found, f"{name}, {tolerance}")
        of_users[name, tolerance] = found[1]
    for damping, _, *cells in _rows(ACCURACY, "tolerance"):
        for tolerance, cell in zip(("1e-02", "1e-03", "1e-04"), cells, strict=True):
            found = of_users[f"elastic stop, damping {damping}", tolerance]
            published = int(cell.removeprefix("not converged: ").split(",")[0])
            assert abs(found - published) <= OF_ROUNDING * published, (damping, tolerance)
    for tolerance, tuples, levels, *_ in _rows(ACCURACY, "refinement"):
        found = _counts("accuracy/elastic_stop", (), tolerance, tmp_path)
        _assert_near((int(tuples), int(levels)), found, f"elastic stop, {tolerance}")
