#!/usr/bin/env python3
"""Makes the reference pages of the site from the help texts, docstrings and headers.

usage: reference.py FOLDER      writes FOLDER/command.md, python.md and a page for each class in FOLDER/python, c.md and fortran.md

nhbm, nhbm-post and nhbm-model must be on the path, the package nhbm in this Python.
"""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def printed(*words: str) -> str:
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.rstrip()


def block(text: str, language: str = "text") -> str:
    return f"```{language}\n{text.rstrip()}\n```\n"


def command() -> str:
    """Help of all verbs of the three commands."""
    parts = ["# Commands\n\nThe output of `--help` for each verb.\n"]
    verbs = re.findall(r"nhbm (\w+) (?:INPUT|RESULT) \[options\]", printed("nhbm", "help"))
    parts.append("## nhbm\n\n" + block(printed("nhbm", "help")))
    parts += [f"## nhbm {verb}\n\n" + block(printed("nhbm", "help", verb)) for verb in verbs]
    for tool in ("nhbm-post", "nhbm-model"):
        text = printed(tool, "--help")
        parts.append(f"## {tool}\n\n" + block(text))
        verbs = re.findall(r"^    ([a-z][\w-]*)(?:  |$)", text.partition("positional arguments:")[2], re.MULTILINE)
        parts += [f"### {tool} {verb}\n\n" + block(printed(tool, verb, "--help")) for verb in verbs]
    return "\n".join(parts)


FIRST = ["Model", "dataset.nhbm", "Rotor", "Structure", "fit"]  # of the pages of Python


def python() -> dict[str, str]:
    """Public names of the package with their signatures and docstrings: a page a class, one of functions."""
    import nhbm
    import nhbm.accessor

    found = {name: getattr(nhbm, name) for name in nhbm.__all__}
    pages = {name: described(name, what, "#") for name, what in found.items() if members_of(name, what)}
    pages["dataset.nhbm"] = "# dataset.nhbm\n\n" + block(inspect.getdoc(nhbm.accessor.Accessor) or "") + "\n".join(
        members("dataset.nhbm", nhbm.accessor.Accessor))  # fmt: skip
    others = sorted((name for name in found if name not in pages), key=str.lower)
    names = sorted(pages, key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name.lower()))
    index = ["# Python\n\nClasses of the package `nhbm`, a page each; introduction: [nhbm from Python](../docs/user/library.md).\n"]
    index.append("\n".join(f"- [{name}](python/{name}.md)" for name in names) + "\n\nFunctions, small classes and warnings:\n")
    index += [described(name, found[name], "##") for name in others]
    index.append("```{toctree}\n:hidden:\n\n" + "\n".join(f"python/{name}.md" for name in names) + "\n```\n")
    return {"python": "\n".join(part for part in index if part), **{f"python/{name}": pages[name] for name in names}}


def members_of(name: str, what) -> list[str]:
    return members(name, what) if inspect.isclass(what) and not issubclass(what, tuple) else []


def described(name: str, what, level: str) -> str:
    if not (inspect.isclass(what) or callable(what)):
        return ""
    text = inspect.getdoc(what) or ""
    return "\n".join([f"{level} {name}\n", block(f"{signature(name, what)}\n\n{text}", "text"), *members_of(name, what)])


def members(name: str, owner) -> list[str]:
    own = {key: value for base in reversed(owner.__mro__) if base.__module__.startswith("nhbm") for key, value in vars(base).items()}
    found = [(key, value) for key, value in own.items() if not key.startswith("_") or key == "__setitem__"]
    parts = []
    for key, value in found:
        target = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
        if inspect.isfunction(target) and inspect.getdoc(target):
            shown = f"{name}.{key}" if isinstance(value, property) else signature(f"{name}.{key}", target)
            parts.append(f"## {name}.{key}\n\n".replace("__", "\\_\\_") + block(f"{shown}\n\n{inspect.getdoc(target)}"))
    return parts


def signature(name: str, what) -> str:
    try:
        return f"{name}{inspect.signature(what)}"
    except (TypeError, ValueError):
        return name


def main(folder: Path) -> None:
    (folder / "python").mkdir(parents=True, exist_ok=True)
    ford = '<a href="../ford/module/nhbm.html">pages of FORD</a>'
    source = {"c": ("# C\n\nThe headers document the interface in the order of use.\n", ["src/api/nhbm.h", "src/laws/nhbm_user_law.h"], "c"),
              "fortran": (f"# Fortran\n\nThe module `nhbm`; its types with all components: {ford}.\n", ["src/api/nhbm.f90"], "fortran")}  # fmt: skip
    pages = {"command": command(), **python()}
    for name, (head, files, language) in source.items():
        pages[name] = "\n".join([head, *(f"## {Path(file).name}\n\n{block((ROOT / file).read_text(encoding='utf-8'), language)}" for file in files)])
    for name, text in pages.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
