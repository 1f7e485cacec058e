#!/usr/bin/env python3
"""Divides the page of the input on the site, a page a group instead of one of all groups, and names recipes by their verbs.

usage: groups.py SOURCE      SOURCE is the folder with the pages of the site as they stand in the repository

docs/user/input.md remains one file, in which tests/keys writes the tables of keys. Here its section of each group becomes
docs/user/input/GROUP.md, and links to the headings that move follow in all pages. Group &law is the catalogue of laws (laws.py).
In the contents of the site (index.md), recipes have the names and headings of docs/howto/README.md instead of "How do I ...?".
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

PAGE = Path("docs/user/input.md")
LAWS = Path("laws")
RECIPES = "docs/howto/README\ndocs/howto/*\n```\n"  # of docs/site/index.md
_GROUP = re.compile(r"^### `&(\w+)`\n", re.MULTILINE)
_LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(#[^)\s]*)?\)")
_CODE = re.compile(r"(^```.*?^```\n?)", re.DOTALL | re.MULTILINE)


def anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def divided(text: str) -> tuple[str, dict[str, str]]:
    """The page without its groups, and the text of each group below its heading."""
    found = list(_GROUP.finditer(text))
    end = text.index("\n## ", found[-1].end()) + 1
    ends = [match.start() for match in found[1:]] + [end]
    return text[: found[0].start()] + text[end:], {match[1]: text[match.end() : after] for match, after in zip(found, ends)}


def homes(groups: dict[str, str]) -> dict[str, tuple[Path, str]]:
    """Where each heading of a group stands on the site: page and anchor there, none for the heading of a page."""
    places: dict[str, tuple[Path, str]] = {}
    for group, text in groups.items():
        page = LAWS / "index.md" if group == "law" else PAGE.with_suffix("") / f"{group}.md"
        places[anchor(f"`&{group}`")] = (page, "")
        for heading in re.findall(r"^#### (.*)$", text, re.MULTILINE):
            kind = re.fullmatch(r"`type = '(\w+)'`", heading)
            of_law = group == "law" and kind
            places[anchor(heading)] = (LAWS / f"{kind[1]}.md", "") if of_law else (page, f"#{anchor(heading)}")
    return places


def moved(text: str, old: Path, new: Path, places: dict[str, tuple[Path, str]]) -> str:
    """A text of the page `old` for the page `new`: links as they are from there, those to headings that have moved to their place."""

    def link(match: re.Match[str]) -> str:
        name, at = match[1], match[2] or ""
        target = Path(os.path.normpath(old.parent / name)) if name else old
        if target == PAGE and at[1:] in places:
            target, at = places[at[1:]]
        if target == new and at:
            return f"]({at})"
        return f"]({os.path.relpath(target, new.parent)}{at})"

    return "".join(part if part.startswith("```") else _LINK.sub(link, part) for part in _CODE.split(text))


def recipes(overview: str) -> str:
    """Contents of the recipes by their overview: a list below each of its headings."""
    parts = []
    for heading, names in re.findall(r"^\*\*(.*)\*\*\n\n((?:- .*\n)+)", overview, re.MULTILINE):
        entries = [f"{name[0].upper()}{name[1:]} <docs/howto/{page}>" for name, page in re.findall(r"\[(.*)\]\((\w+)\.md\)", names)]
        parts.append(f"```{{toctree}}\n:caption: {heading}\n:hidden:\n\n" + "\n".join(entries) + "\n```\n")
    return "\n".join(parts)


def main(source: Path) -> None:
    text = (source / PAGE).read_text(encoding="utf-8")
    rest, groups = divided(text)
    places = homes(groups)
    folder = (source / PAGE).with_suffix("")
    folder.mkdir(exist_ok=True)
    names = [group for group in groups if group != "law"]
    for group in names:
        new = PAGE.with_suffix("") / f"{group}.md"
        body = re.sub(r"^####", "##", moved(groups[group], PAGE, new, places), flags=re.MULTILINE)
        (source / new).write_text(f"# `&{group}`\n{body}", encoding="utf-8")
    contents = "\n".join(f"input/{group}" for group in names)
    (source / PAGE).write_text(f"{rest.rstrip()}\n\n```{{toctree}}\n:hidden:\n\n{contents}\n```\n", encoding="utf-8")
    index = source / "index.md"
    overview = (source / "docs/howto/README.md").read_text(encoding="utf-8")
    index.write_text(index.read_text(encoding="utf-8").replace(RECIPES, f"docs/howto/README\n```\n\n{recipes(overview)}"), encoding="utf-8")
    for path in sorted(source.rglob("*.md")):
        page = path.relative_to(source)
        if page.parts[0] in ("docs", "postproc", "laws", "reference") or len(page.parts) == 1:
            old = path.read_text(encoding="utf-8")
            if PAGE.name in old or page == PAGE:
                path.write_text(moved(old, page, page, places), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    main(Path(sys.argv[1]))
