"""Case tests: the program as users run it, NHBM=/path/to/nhbm python3 -m pytest tests/cases; by default that of build/release."""

import os
import signal
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [
    str(ROOT / "postproc" / "src"),
    str(ROOT / "drivers" / "python" / "src"),
    str(ROOT / "tests"),
    str(ROOT / "tests" / "campaigns"),
]
os.environ.setdefault("NHBM", str(ROOT / "build" / "release" / "bin" / "nhbm"))


def pytest_configure(config):
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell ignores in what it starts in the background
