"""tests/campaigns/scenes: a few scenes of each kind, and what it says of wrong arguments."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def scenes(*words):
    script = [sys.executable, str(ROOT / "tests" / "campaigns" / "scenes"), *map(str, words)]
    return subprocess.run(script, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("kinds", [("detuned", "free"), pytest.param(("massless",), marks=pytest.mark.long)])
def test_nothing_is_wrong_in_a_few_scenes(kinds, tmp_path):
    done = scenes("--seed", 5, "--count", 1, "--jobs", 1, "--keep", tmp_path, "--kinds", ",".join((*kinds, "census")))
    assert done.returncode == 0, done.stdout + done.stderr
    for kind in kinds:
        assert re.search(rf"^\| {kind} \| 1 \| 1 \| 1, 1, 0, 0 \| 0 \|", done.stdout, re.M), done.stdout
    assert "| census | scenes |" in done.stdout and len(list(tmp_path.glob("*.nml"))) == len(kinds) + 1


def test_a_wrong_kind_is_named():
    done = scenes("--kinds", "loose")
    assert done.returncode == 2 and "unknown kind 'loose'; known: detuned, massless, free, census" in done.stderr
