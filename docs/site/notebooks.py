"""Writes the tutorials as Jupyter notebooks: python docs/site/notebooks.py FOLDER [PAGE ...]

Python is a code cell, a block that the page tells to store as a file a cell `%%writefile`, commands of a shell a cell `%%bash`; what
they print is left to the notebook. All else is text."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_FENCE = re.compile(r"^```(\{code-cell\}|[\w-]*)[^\n]*\n(.*?)^```\n?", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"(?:!|#|//|/\*)\s*([\w-]+\.\w+)\s*(?:\*/)?$")
_HEADER = re.compile(r"\A---\n.*?^---\n", re.DOTALL | re.MULTILINE)


def notebook_of(page: str) -> dict[str, Any]:
    """A page in Markdown as a notebook."""
    cells: list[dict[str, Any]] = []

    def add(kind: str, text: str) -> None:
        if not text.strip():
            return
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{len(cells)}", "metadata": {}, "source": text.strip("\n")}
        cells.append(cell if kind == "markdown" else {**cell, "execution_count": None, "outputs": []})

    page, at = _HEADER.sub("", page), 0
    for block in _FENCE.finditer(page):
        add("markdown", page[at : block.start()])
        at = block.end()
        kind, text = block[1].strip("{}"), block[2]
        file = _FILE.match(text.partition("\n")[0])
        if file:
            add("code", f"%%writefile {file[1]}\n{text}")
        elif kind in ("python", "code-cell"):
            add("code", "\n".join(line for line in text.splitlines() if not line.startswith(":tags:")))
        elif kind == "console":
            add("code", "%%bash\n" + _commands(text))
        elif kind != "text":  # what was printed is printed again
            add("markdown", block[0])
    add("markdown", page[at:])
    about = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


def _commands(text: str) -> str:
    """The commands of a block behind `$`, without what they print; a failure that the page states does not end the cell."""
    lines, is_open = [], False
    for line in text.splitlines():
        if line.startswith("$ ") or is_open:
            command = re.sub(r"\s+# exit status \d+$", " || true", line.removeprefix("$ "))
            lines.append(command)
            is_open = command.endswith("\\")
    return "\n".join(lines)


def has_code(path: Path) -> bool:
    return any(cell["cell_type"] == "code" for cell in notebook_of(path.read_text(encoding="utf-8"))["cells"])


def tutorials() -> list[Path]:
    """The pages that are notebooks: those of docs/start with code."""
    return [path for path in sorted((ROOT / "docs" / "start").glob("*.md")) if has_code(path)]


def main(folder: str, *pages: str) -> None:
    """Writes a notebook for each page with code, by default for all tutorials."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for path in filter(has_code, map(Path, pages)) if pages else tutorials():
        text = json.dumps(notebook_of(path.read_text(encoding="utf-8")), indent=1, ensure_ascii=False) + "\n"
        (Path(folder) / f"{path.stem}.ipynb").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
