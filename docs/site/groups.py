#!/usr/bin/env python3
"""Writes contents of the site that follow from its pages: the groups of the input, and recipes by their verbs.

usage: groups.py SOURCE      SOURCE is the folder with the pages of the site as they stand in the repository

Recipes have the names and headings of docs/howto/README.md instead of "How do I ...?".
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

RECIPES = "docs/howto/README\ndocs/howto/*\n```\n"  # of docs/site/index.md


def recipes(overview: str) -> str:
    """Contents of the recipes by their overview: a list below each of its headings."""
    parts = []
    for heading, names in re.findall(r"^\*\*(.*)\*\*\n\n((?:- .*\n)+)", overview, re.MULTILINE):
        entries = [f"{name[0].upper()}{name[1:]} <docs/howto/{page}>" for name, page in re.findall(r"\[(.*)\]\((\w+)\.md\)", names)]
        parts.append(f"```{{toctree}}\n:caption: {heading}\n:hidden:\n\n" + "\n".join(entries) + "\n```\n")
    return "\n".join(parts)


def main(source: Path) -> None:
    page = source / "docs/user/input.md"
    text = page.read_text(encoding="utf-8")
    contents = "\n".join(re.findall(r"^\| \[`&\w+`\]\((input/(?!law\.)\w+)\.md\)", text, re.MULTILINE))
    page.write_text(f"{text.rstrip()}\n\n```{{toctree}}\n:hidden:\n\n{contents}\n```\n", encoding="utf-8")
    index = source / "index.md"
    overview = (source / "docs/howto/README.md").read_text(encoding="utf-8")
    index.write_text(index.read_text(encoding="utf-8").replace(RECIPES, f"docs/howto/README\n```\n\n{recipes(overview)}"), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    main(Path(sys.argv[1]))
