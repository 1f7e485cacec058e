#!/usr/bin/env python3
"""Makes the gallery of the site: each input of inputs/gallery and inputs/models with what it says of itself and its picture.

usage: gallery.py FOLDER [NAME ...]      writes FOLDER/index.md and a picture for each input (default: all) that is older than it

nhbm, nhbm-post and nhbm-model are looked for on the path. A picture that takes longer than five minutes is left out, with a word.
Exit status: 0 all are drawn, 1 some are not.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 300.0  # [s] of one input
COPIED_LINES = 40  # of an input on the page


def words(source: Path) -> str:
    """What stands on top of an input, without its expectations."""
    lines = []
    for line in source.read_text(encoding="utf-8").splitlines():
        if not line.startswith("!"):
            break
        if re.match(r"! (expect|label|picture):", line):
            continue
        lines.append(line.lstrip("! "))
    return "\n".join(lines).strip().replace("$", "\\$").replace("*", "\\*").replace("_", "\\_")


def view(source: Path) -> list[str]:
    """Arguments of nhbm-post for an input: what its comment `! picture:` has, else what suits it."""
    chosen = re.search(r"^! picture: (.*)$", source.read_text(encoding="utf-8"), re.MULTILINE)
    if chosen:
        return chosen[1].split()
    text = re.sub(r"!.*", "", source.read_text(encoding="utf-8"))
    n_tones = len(re.findall(r"[\d.]+|\.true\.|\.false\.", (re.search(r"(?:frequency|hertz|unknown)\s*=\s*([^/\n]*?)(?:,\s*\w+\s*=|/|\n)", text) or [0, ""])[1]))
    if source.parent.name == "models":
        return ["deflection"]
    if "&curve" in text:
        return ["response"]
    sweeps = re.findall(r"&sweep\b([^/]*)/", text)
    axes = {(re.search(r"axis\s*=\s*(\d+)", sweep) or [0, str(k)])[1] for k, sweep in enumerate(sweeps, 1)}
    lengths = [int((re.search(r"\bn\s*=\s*(\d+)", sweep) or [0, sweep.count(",")])[1]) for sweep in sweeps]
    if len(axes) > 1 and min(lengths) > 3:
        return ["map"]
    if len(sweeps) == 1 and lengths[0] > 3:
        return ["response"]
    return ["spectrum", "--form", "stem"] if n_tones > 1 else ["time"]


def draw(source: Path, picture: Path) -> str:
    """Solves an input and draws it; says what went wrong, if anything did."""
    with tempfile.TemporaryDirectory() as folder:
        script = source.with_suffix(".sh")
        steps = [["bash", script, "."]] if script.exists() else []
        model = ["--set", f"structure%file='{folder}/{source.stem}.h5'"] if script.exists() else []
        verb = view(source)
        extra = ["--tuple", "1,0"] if verb == ["deflection"] else []
        steps += [
            ["nhbm", "solve", source, "-o", "run.h5", "--quiet", *model],
            ["nhbm-post", *verb, "run.h5", *extra, "--dpi", "80", "-o", picture],
        ]
        for step in steps:
            try:
                done = subprocess.run(list(map(str, step)), cwd=folder, capture_output=True, text=True, timeout=LIMIT)
            except subprocess.TimeoutExpired:
                return f"not drawn: {step[0]} takes longer than {LIMIT:.0f} s"
            few_fail = 1 if step[:2] == ["nhbm", "solve"] else 0  # points without a motion are drawn as such
            if done.returncode > few_fail or (step is steps[-1] and not picture.exists()):
                return f"not drawn: {done.stderr.strip().splitlines()[-1]}"
    return ""


def section(source: Path, folder: Path) -> str:
    """The part of the page for an input; draws what is missing."""
    picture = folder / f"{source.stem}.png"
    problem = ""
    if not picture.exists() or picture.stat().st_mtime < source.stat().st_mtime:
        problem = draw(source, picture)
        print(source.stem, problem or "drawn", flush=True)
    code = "\n".join(line for line in source.read_text(encoding="utf-8").splitlines() if not line.startswith("!"))
    shown = f"![{source.stem}]({picture.name})" if picture.exists() else f"*{problem}*"
    path = source.relative_to(ROOT)
    lines = code.splitlines()
    if len(lines) > COPIED_LINES:
        code = "\n".join([*lines[:COPIED_LINES], f"! ... {len(lines) - COPIED_LINES} more lines in {path}"])
    return (
        f"## {source.stem}\n\n{words(source)}\n\n{shown}\n\n:::{{dropdown}} `nhbm solve {path}`\n```fortran\n{code}\n```\n:::\n"
    )


def main(folder: Path, names: list[str]) -> bool:
    folder.mkdir(parents=True, exist_ok=True)
    sources = sorted([*ROOT.glob("inputs/gallery/*.nml"), *ROOT.glob("inputs/models/*.nml")])
    parts = [section(source, folder) for source in sources if not names or source.stem in names]
    head = "# Gallery\n\nEvery example input with what it says of itself and its picture; `docs/site/gallery.py` made this page.\n\n"
    (folder / "index.md").write_text(head + "\n".join(parts), encoding="utf-8")
    return not any("*not drawn" in part for part in parts)


if __name__ == "__main__":
    sys.exit(0 if main(Path(sys.argv[1]).resolve(), sys.argv[2:]) else 1)
