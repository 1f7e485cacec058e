#!/usr/bin/env python3
"""Makes the gallery of the site: each input of inputs/gallery and inputs/models with its description and its picture.

usage: gallery.py FOLDER [NAME ...]      writes FOLDER/index.md, thumbnails in groups, and for each input (default: all) FOLDER/NAME.md and
                                         its picture, if that is older than the input

nhbm, nhbm-post and nhbm-model must be on the path. A picture that takes longer than five minutes is omitted with a note.
Exit status: 0 all pictures were made, 1 some were not.
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
PER_ROW = 3  # thumbnails
GROUPS = {  # an input is in the first one whose words it has
    "Finite element models": r"type\s*=\s*'model'",
    "Rotors and bearings": r"'(jeffcott|rotor_stator|annular_clearance|blade_contact|rolling_bearing|short_bearing)'",
    "Friction": r"'(jenkins|jenkins_2d|iwan|bouc_wen|coulomb_rigid|coulomb_tanh|stribeck)'",
    "Stops, walls and impacts": r"'(elastic_stop|rigid_wall|hertz|contact_table|piecewise_linear)'|backlash",
    "Self-excited and parametric": r"'(van_der_pol|parametric)'|unknown\s*=\s*\.true",
    "Smooth springs": "",
}


def words(source: Path) -> str:
    """The comment at the top of an input, without its expectations."""
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
    """Solves an input and plots it; returns the error message, if any."""
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
                return f"left out: {step[0]} takes longer than {LIMIT:.0f} s here"
            allowed = (0, 4) if step[:2] == ["nhbm", "solve"] else (0,)  # points without a motion are drawn as such
            if done.returncode not in allowed or (step is steps[-1] and not picture.exists()):
                return f"not drawn: {done.stderr.strip().splitlines()[-1]}"
    return ""


def group_of(source: Path) -> str:
    """The group of an input, by its structure and laws."""
    text = re.sub(r"!.*", "", source.read_text(encoding="utf-8"))
    return next(group for group, words_of_it in GROUPS.items() if re.search(words_of_it, text))


def page(source: Path, folder: Path) -> str:
    """The page of an input; makes a missing picture."""
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
    return f"# {source.stem}\n\n{words(source)}\n\n{shown}\n\n    nhbm solve {path}\n\n```fortran\n{code}\n```\n"


def thumbnails(sources: list[Path], folder: Path) -> str:
    """A table of pictures, or names where there is none, that lead to the pages of inputs."""
    cells = []
    for source in sources:
        name = source.stem
        picture = f'<img src="{name}.png" width="220" alt="{name}"><br>' if (folder / f"{name}.png").exists() else ""
        cells.append(f"[{picture}{name}]({name}.md)")
    cells += [""] * (-len(cells) % PER_ROW)
    rows = ["| " + " | ".join(cells[i : i + PER_ROW]) + " |" for i in range(0, len(cells), PER_ROW)]
    return "\n".join(["|" + " |" * PER_ROW, "|" + ":---:|" * PER_ROW, *rows])


def main(folder: Path, names: list[str]) -> bool:
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.md"):
        old.unlink()
    sources = sorted([*ROOT.glob("inputs/gallery/*.nml"), *ROOT.glob("inputs/models/*.nml")])
    sources = [source for source in sources if not names or source.stem in names]
    pages = {source: page(source, folder) for source in sources}
    for source, text in pages.items():
        (folder / f"{source.stem}.md").write_text(text, encoding="utf-8")
    parts = ["# Gallery\n\nAll example inputs; a picture leads to the description, the input and the figure.\n"]
    for group in GROUPS:
        members = [source for source in sources if group_of(source) == group]
        if members:
            parts.append(f"## {group}\n\n{thumbnails(members, folder)}\n")
    contents = "\n".join(source.stem for source in sources)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{contents}\n```\n")
    (folder / "index.md").write_text("\n".join(parts), encoding="utf-8")
    return not any("*not drawn" in text for text in pages.values())


if __name__ == "__main__":
    sys.exit(0 if main(Path(sys.argv[1]).resolve(), sys.argv[2:]) else 1)
