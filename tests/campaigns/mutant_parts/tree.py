"""The copy of the tree in which mutants are built."""

from __future__ import annotations

import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
SCRATCH = ROOT / "build" / "mutants"
SOURCE = SCRATCH / "source"
COPIED = ("CMakeLists.txt", "cmake", "drivers", "inputs", "src", "tests")  # what a build reads
LEFT_OUT = {".pytest_cache", "__pycache__"}


def copy_tree() -> None:
    """Brings the copy up to date. Files that are the same stay untouched, so that nothing is built for them."""
    wanted = {path.relative_to(ROOT) for name in COPIED for path in files_of(ROOT / name)}
    if SOURCE.is_dir():
        for path in files_of(SOURCE):
            if path.relative_to(SOURCE) not in wanted:
                path.unlink()
    for relative in wanted:
        target = SOURCE / relative
        content = (ROOT / relative).read_bytes()
        if target.is_file() and target.read_bytes() == content:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
        shutil.copymode(ROOT / relative, target)


def files_of(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    return [file for file in path.rglob("*") if file.is_file() and not LEFT_OUT & set(file.parts)]
