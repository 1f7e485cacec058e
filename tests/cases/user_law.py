"""Builds user laws with the command in the first lines of their sources."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

HEADER_FOLDER = Path(__file__).resolve().parents[2] / "src" / "laws"


def build_as_the_source_says(source: Path):
    """Runs the single command in the first lines of a source."""
    lines = [line.strip(" *!>") for line in source.read_text().splitlines()[:5]]
    (command,) = [line for line in lines if "-shared" in line]
    words = [str(HEADER_FOLDER) if word == "../../src/laws" else word for word in shlex.split(command)]
    subprocess.run(words, cwd=source.parent, check=True)


def with_its_law(source: Path, folder: Path) -> Path:
    """The input itself; if there is a C source of the same name, a copy in `folder` with the law built."""
    law = source.with_suffix(".c")
    if not law.exists():
        return source
    folder.mkdir(exist_ok=True)
    for file in (source, law):
        shutil.copy(file, folder)
    build_as_the_source_says(folder / law.name)
    return folder / source.name
