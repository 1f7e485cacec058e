#!/usr/bin/env python3
"""Makes the catalogue of laws of the site: sketches of their forces on the page of each law and as an index, with examples and source.

usage: laws.py SOURCE      SOURCE is the folder with the pages of the site as they stand in the repository

The sketch is the force of the program itself along a motion that the law does not change, with the numbers of its example in
src/laws.txt or those of SKETCHES. NHBM_LIBRARY names libnhbm.so.
"""

from __future__ import annotations

import re
import runpy
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import matplotlib
import numpy as np

import nhbm

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
PAGES = Path("docs/user/laws")
INDEX = Path("docs/user/input/law.md")
EXAMPLES = 6  # listed on a page
UNITS = {"displacement": "m", "velocity": "m/s"}


@dataclass(frozen=True)
class Sketch:
    """Numbers of a law instead of those of its example in src/laws.txt, and over what its first force is drawn: displacement or velocity of
    the first coordinate."""

    keys: dict = field(default_factory=dict)
    over: str = "displacement"
    method: str = "cvode"


LAWS = {law.name: law for law in runpy.run_path(str(ROOT / "tests" / "keys"))["laws"]()}
SKETCHES = {  # where the example does not show the law over the displacement
    "bouc_wen": Sketch(method="central_differences"),
    "contact_table": Sketch({"n_contacts": 2, "shapes": [1.0, 0.0, -1.0, 0.0], "gaps": [0.3, 0.5], "stiffness": 2.0}),
    "coulomb_rigid": Sketch(over="velocity"),
    "coulomb_tanh": Sketch(over="velocity"),
    "cubic_damping": Sketch({"coefficient": 1.0}, over="velocity"),
    "electrostatic": Sketch({"coefficient": 1.0, "gap": 2.0, "voltage": 1.0}),
    "jenkins_2d": Sketch(method="central_differences"),
    "quadratic_damping": Sketch(over="velocity"),
    "short_bearing": Sketch({"second_dofs": "x2", "viscosity": 5.0, "radius": 2.0, "length": 1.5, "clearance": 2.0, "rotor_speed": 0.5}),
    "stribeck": Sketch({"limit": 0.3, "static_limit": 0.5, "stribeck_velocity": 0.4, "velocity": 0.05}, over="velocity"),
    "van_der_pol": Sketch(over="velocity"),
}


def sketch_of(kind: str) -> Sketch:
    """The sketch of a law, with numbers."""
    sketch = SKETCHES.get(kind, Sketch())
    return sketch if sketch.keys else replace(sketch, keys={key: all_or_one(values) for key, values in LAWS[kind].keys.items()})


def all_or_one(values: list) -> object:
    return values if len(values) > 1 else values[0]


def forces(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Displacement or velocity of the first coordinate and the force on it over a period. The coordinates are carried by dashpots so
    strong that the law does not change their motion: sines in quarters of a period."""
    sketch, dofs = sketch_of(kind), LAWS[kind].dofs
    n = max(len(dofs), 2 if "second_dofs" in sketch.keys else 1)
    heavy = 1e5 * np.eye(n)
    model = nhbm.Model(nhbm.Matrices(heavy, heavy, heavy), tones=[1.0])
    for k in range(n):
        turn = 0.5 * np.pi * k
        model.load(f"x{k + 1}", 1, cos=1e5 * np.cos(turn), sin=1e5 * np.sin(turn))
    model.law(kind, all_or_one(dofs), **sketch.keys)
    record = model.integrate(2 * np.pi, transient=12 * np.pi, method=sketch.method)
    return record[sketch.over].values[0], record["force"].values[0]


def draw(kind: str, path: Path) -> None:
    """The force over the displacement or velocity."""
    sketch = sketch_of(kind)
    if kind == "rigid_wall":  # no force along a motion that it stops
        gap = sketch.keys["gap"]
        x, f = np.array([-1.0, gap, gap]), np.array([0.0, 0.0, 1.0])
    else:
        x, f = forces(kind)
    with plt.rc_context({"font.size": 9, "svg.hashsalt": kind, "svg.fonttype": "none"}):
        figure, axes = plt.subplots(figsize=(3.4, 2.3), layout="constrained")
        axes.axhline(0.0, color="0.8", linewidth=0.8)
        axes.axvline(0.0, color="0.8", linewidth=0.8)
        axes.plot(x, f, color="#1f5fa8")
        axes.set_xlabel(f"{sketch.over} of the first coordinate [{UNITS[sketch.over]}]")
        axes.set_ylabel("force [N]")
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def examples(kind: str) -> list[Path]:
    """Inputs that have the law, short ones first."""
    found = [path for folder in ("gallery", "autonomous", "paper", "models", "accuracy", "hard") for path in (ROOT / "inputs" / folder).glob("*.nml")
             if re.search(rf"type\s*=\s*'{kind}'", path.read_text(encoding="utf-8"))]  # fmt: skip
    return sorted(found, key=lambda path: (path.parent.name not in ("gallery", "autonomous"), path.stat().st_size))[:EXAMPLES]


def title(path: Path) -> str:
    found = re.search(r"title\s*=\s*'([^']*)'", path.read_text(encoding="utf-8"))
    return found[1] if found else path.stem


def page(text: str, kind: str, has_sketch: bool) -> str:
    """The page of a law with its sketch below the title, examples and source at the end."""
    title_line, _, body = text.partition("\n")
    lines = [f"{title_line}\n"]
    if has_sketch:
        lines.append(f"![Force of {kind} over the {sketch_of(kind).over}]({kind}.svg)\n")
    lines.append(body.strip() + "\n")
    found = examples(kind)
    if found:
        lines.append("## Examples\n")
        lines += [f"- [{path.parent.name}/{path.name}](../../../inputs/{path.parent.name}/{path.name}): {title(path)}" for path in found]
        lines.append("")
    numbers = ", ".join(f"`{key} = {value}`" for key, value in sketch_of(kind).keys.items()) if has_sketch else ""
    lines.append("## Source\n")
    lines.append(f"[`src/laws/hb_law_{kind}.f90`](../../../src/laws/hb_law_{kind}.f90), with its derivatives."
                 + (f" The sketch has {numbers}." if numbers else ""))  # fmt: skip
    return "\n".join(lines) + "\n"


def index(text: str, kinds: list[str]) -> str:
    """The page of all laws with thumbnails that lead to them at its top, and contents."""
    cells = [f"[<img src=\"../laws/{kind}.svg\" width=\"150\" alt=\"Force of {kind}\"><br>{kind}](../laws/{kind}.md)" for kind in kinds]
    rows = [cells[i : i + 4] + [""] * (4 - len(cells[i : i + 4])) for i in range(0, len(cells), 4)]
    table = "\n".join(["| | | | |", "|:---:|:---:|:---:|:---:|", *("| " + " | ".join(row) + " |" for row in rows)])
    contents = "\n".join(f"../laws/{kind}" for kind in sorted(LAWS))
    first, rest = text.rstrip().split("\n\n| key |", 1)
    return f"{first}\n\n{table}\n\n| key |{rest}\n\n```{{toctree}}\n:hidden:\n\n{contents}\n```\n"


def main(source: Path) -> None:
    sketched = sorted(set(LAWS) - {"user"})
    for kind in LAWS:
        if kind in sketched:
            draw(kind, source / PAGES / f"{kind}.svg")
        path = source / PAGES / f"{kind}.md"
        path.write_text(page(path.read_text(encoding="utf-8"), kind, kind in sketched), encoding="utf-8")
    path = source / INDEX
    path.write_text(index(path.read_text(encoding="utf-8"), sketched), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    main(Path(sys.argv[1]))
