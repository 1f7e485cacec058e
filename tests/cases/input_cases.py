"""Parameters of tests that run input files: those with a line `! label: long` take many seconds and stand among the long tests,
as do those that a test names."""

from __future__ import annotations

from pathlib import Path

import pytest

INPUTS = Path(__file__).resolve().parents[2] / "inputs"


def input_case(file: Path, long_ones: tuple[str, ...] = ()):
    marks = [pytest.mark.long] if "\n! label: long\n" in file.read_text() or file.stem in long_ones else []
    return pytest.param(file, id=str(file.relative_to(INPUTS)), marks=marks)
