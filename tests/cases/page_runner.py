"""Runs the code of a page of the documentation in a folder, as its reader would, and compares what is printed with the page.

    python tests/cases/page_runner.py PAGE ...      writes the pictures that pages make and show into docs/pictures

A block whose first line is a comment with the name of a file alone is written to that file. Other blocks run in their order:
`python` and `{code-cell}` in one interpreter for the page, `console` with bash, a command behind each `$`. What stands below a
command, and in a block `text` below Python, must be printed: line by line in this order, `...` for anything, numbers with a point
to 2e-3; estimates, which are those with an exponent and two digits at most, to a factor of ten; below 1e-6 all are the same.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PRECISION = 2e-3  # of printed numbers: the last digits belong to the machine
ROUGH, ROUNDING = 10.0, 1e-6  # factor between estimates; what is rounding
LIMIT = 300.0  # [s] of a command

_FENCE = re.compile(r"^```(\{code-cell\}|[\w-]*)[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"(?:!|#|//|/\*)\s*([\w-]+\.\w+)\s*(?:\*/)?$")
_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
_STATUS = re.compile(r"\s+# exit status (\d+)$")


class Block(NamedTuple):
    """A block of code of a page: its language and its text."""

    kind: str
    text: str


def blocks_of(page: Path) -> list[Block]:
    return [Block(kind.strip("{}"), text) for kind, text in _FENCE.findall(page.read_text(encoding="utf-8"))]


def run_page(page: Path, folder: Path) -> None:
    """Runs the blocks of a page in a folder; AssertionError where something fails or prints another thing."""
    from program import program

    blocks = blocks_of(page)
    assert blocks, f"{page.name} has no code"
    for name in ("inputs", "drivers", "src"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "build").mkdir()
    (folder / "build" / "release").symlink_to(Path(program()).parents[1])
    environment, names, printed = _environment(folder), {"__name__": "__main__"}, ""
    with _inside(folder, environment):
        for kind, text in blocks:
            first = text.partition("\n")[0]
            if match := _FILE.match(first):
                Path(match[1]).write_text(text, encoding="utf-8")
            elif kind in ("python", "code-cell"):
                printed = _run_python(text, names, page)
            elif kind == "console":
                for command, expected in _commands(text):
                    _run_shell(command, expected, environment, page)
            elif kind == "text":
                compare(text.splitlines(), printed, page.name)


def compare(expected: list[str], printed: str, where: str) -> None:
    """Each expected line occurs in what was printed, behind the one before."""
    lines, start = [line.strip() for line in printed.splitlines()], 0
    for wanted in filter(None, (line.strip() for line in expected)):
        if wanted == "...":
            continue
        found = next((k for k in range(start, len(lines)) if is_same(wanted, lines[k])), None)
        assert found is not None, f"{where}: the page has\n   {wanted}\nprinted was\n" + "\n".join(lines[start:])
        start = found + 1


def is_same(wanted: str, line: str) -> bool:
    """Whether a line is as the page has it, numbers with a point or an exponent to the precision."""
    pieces = re.split(rf"((?<![\w.]){_NUMBER}(?![\w.])|\.\.\.)", wanted)
    numbers = [piece for piece in pieces[1::2] if piece != "..."]
    pattern = "".join(
        re.sub(r"(\\ )+", r"\\s*", re.escape(piece)) if k % 2 == 0 else ".*?" if piece == "..." else rf"\s*({_NUMBER})"
        for k, piece in enumerate(pieces)
    )
    match = re.fullmatch(pattern, line)
    return match is not None and all(_are_close(a, b) for a, b in zip(numbers, match.groups()))


def _are_close(wanted: str, found: str) -> bool:
    if re.fullmatch(r"[-+]?\d+", wanted):
        return int(wanted) == float(found)
    one, other = float(wanted), float(found)
    if "e" in wanted.lower() and len(re.sub(r"[eE].*|[-+.]", "", wanted).lstrip("0")) <= 2:
        return max(abs(one), abs(other)) <= max(ROUGH * min(abs(one), abs(other)), ROUNDING)
    return abs(one - other) <= max(PRECISION * abs(one), ROUNDING)


def _run_python(text: str, names: dict, page: Path) -> str:
    code = "\n".join(line for line in text.splitlines() if not line.startswith((":tags:", "%")))
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, page.name, "exec"), names)  # noqa: S102
    return printed.getvalue()


def _run_shell(command: str, expected: list[str], environment: dict, page: Path) -> None:
    match = _STATUS.search(command)
    status = int(match[1]) if match else 0
    done = subprocess.run(
        ["bash", "-c", f"set -eo pipefail\n{_STATUS.sub('', command)}"], env=environment, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LIMIT, text=True, errors="replace",
    )  # fmt: skip
    assert done.returncode == status, f"{page.name}: $ {command}\nexit status {done.returncode}\n{done.stdout}"
    compare(expected, done.stdout, f"{page.name}: $ {command}")


def _commands(text: str) -> list[tuple[str, list[str]]]:
    """Commands of a block with the lines below each; a backslash at the end of a line goes on in the next one."""
    found: list[tuple[str, list[str]]] = []
    is_open = False
    for line in text.splitlines():
        if is_open:
            found[-1] = (f"{found[-1][0]}\n{line}", [])
        elif line.startswith("$ "):
            found.append((line[2:], []))
        elif found:
            found[-1][1].append(line)
        is_open = (is_open or line.startswith("$ ")) and line.endswith("\\")
    return found


def _environment(folder: Path) -> dict[str, str]:
    """The environment of a reader who has the program and the Python package on the path."""
    from program import environment, program

    executable = Path(program())
    bin_folder = folder / ".bin"
    bin_folder.mkdir()
    (bin_folder / "nhbm").symlink_to(executable)
    for name, code in (("nhbm-post", "-m nhbm_post"), ("nhbm-model", "-m nhbm.command"), ("python", ""), ("python3", "")):
        (bin_folder / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {code} "$@"\n')
        (bin_folder / name).chmod(0o755)
    library = executable.parents[1] / "lib"
    packages = os.pathsep.join([str(ROOT / "postproc" / "src"), str(ROOT / "drivers" / "python" / "src")])
    return {
        **environment(),
        "PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": packages,
        "NHBM_LIBRARY": str(library / "libnhbm.so"),
        "MPLBACKEND": "Agg",
    }


@contextlib.contextmanager
def _inside(folder: Path, environment: dict[str, str]):
    before, here = dict(os.environ), Path.cwd()
    os.environ.update(environment)
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(here)
        os.environ.clear()
        os.environ.update(before)


def main(names: list[str]) -> None:
    for page in map(Path, names):
        page = page.resolve()
        with tempfile.TemporaryDirectory() as folder:
            run_page(page, Path(folder))
            for shown in re.findall(r"!\[[^\]]*\]\(([^)]*)\)", page.read_text(encoding="utf-8")):
                made = Path(folder) / Path(shown).name
                if made.exists():
                    shutil.copy(made, page.parent / shown)
        print(page.name)


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT / "postproc" / "src"), str(ROOT / "drivers" / "python" / "src")]
    main(sys.argv[1:])
