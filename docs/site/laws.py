#!/usr/bin/env python3
"""Makes the catalogue of laws of the site: a page a law with a sketch, its formula, its keys, examples and source.

usage: laws.py FOLDER      writes FOLDER/index.md, and FOLDER/LAW.md and FOLDER/LAW.svg for each type of &law

Formula and keys are the section of the law in docs/user/input.md; index.md has what stands there for all laws. The sketch is the force of the program itself along a motion that the
law does not change, with the numbers of SKETCHES: a new law needs an entry there. NHBM_LIBRARY names libnhbm.so.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np

import nhbm

sys.path.insert(0, str(Path(__file__).resolve().parent))
import groups  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
MANUAL = ROOT / "docs" / "user" / "input.md"
EXAMPLES = 6  # listed on a page


@dataclass(frozen=True)
class Sketch:
    """Numbers of a law, and over what its first force is drawn: displacement or velocity of the first coordinate."""

    keys: dict = field(default_factory=dict)
    over: str = "displacement"
    method: str = "cvode"
    dofs: tuple[str, ...] = ("x1",)
    load: float = 1.0  # amplitude of the motion


SKETCHES = {
    "annular_clearance": Sketch({"stiffness": 3.0, "clearance": 0.4, "friction_coefficient": 0.2}, dofs=("x1", "x2")),
    "blade_contact": Sketch({"n_diameters": 2, "n_blades": 8, "gaps": 0.3, "stiffness": 2.0}, dofs=("x1", "x2", "x3", "x4")),
    "bouc_wen": Sketch({"stiffness": 2.5, "post_yield_ratio": 0.1, "yield_displacement": 0.3}, method="central_differences"),
    "contact_table": Sketch({"n_contacts": 2, "shapes": [1.0, 0.0, -1.0, 0.0], "gaps": [0.3, 0.5], "stiffness": 2.0}, dofs=("x1", "x2")),
    "coulomb_rigid": Sketch({"limit": 0.4}, over="velocity"),
    "coulomb_tanh": Sketch({"limit": 0.4, "velocity": 0.1}, over="velocity"),
    "cubic_damping": Sketch({"coefficient": 1.0}, over="velocity", dofs=("x1", "x2")),
    "cubic_spring": Sketch({"stiffness": 1.0}),
    "elastic_stop": Sketch({"stiffness": 3.0, "gap": 0.4}),
    "electrostatic": Sketch({"coefficient": 1.0, "gap": 2.0, "voltage": 1.0}),
    "hertz": Sketch({"stiffness": 3.0, "gap": 0.2, "dissipation": 0.3}),
    "iwan": Sketch({"stiffness": [1.0, 2.0, 0.5], "limit": [0.1, 0.4, 0.3]}),
    "jenkins": Sketch({"stiffness": 2.0, "limit": 0.5}),
    "jenkins_2d": Sketch({"stiffness": 2.0, "limit": 0.5, "second_dofs": "x2"}, method="central_differences"),
    "parametric": Sketch({"tuple": 2, "stiffness_cos": 0.5}),
    "piecewise_linear": Sketch({"breakpoints": [-0.5, 0.2], "slopes": [2.0, 0.5, 1.5]}),
    "polynomial": Sketch({"stiffness": [0.3, -0.5, 0.7], "damping": [0.1]}),
    "polynomial_coupled": Sketch({"coefficients": [1.0], "acts_on": ["x1"], "displacement_exponents": [1, 2],
                                  "velocity_exponents": [0, 0]}, dofs=("x1", "x2")),
    "quadratic_damping": Sketch({"coefficient": 1.0}, over="velocity"),
    "rigid_wall": Sketch({"gap": 0.4}),
    "rolling_bearing": Sketch({"second_dofs": "x2", "tuple": 1, "n_balls": 7, "stiffness": 4.0, "exponent": 1.5, "clearance": -0.2}),
    "short_bearing": Sketch({"second_dofs": "x2", "viscosity": 5.0, "radius": 2.0, "length": 1.5, "clearance": 2.0, "rotor_speed": 0.5}),
    "stribeck": Sketch({"limit": 0.3, "static_limit": 0.5, "stribeck_velocity": 0.4, "velocity": 0.05}, over="velocity"),
    "tabulated": Sketch({"displacements": [-0.8, -0.3, 0.0, 0.3, 0.8], "forces": [-1.0, -0.2, 0.0, 0.1, 0.9]}),
    "van_der_pol": Sketch({"strength": 1.0, "threshold": 0.7}, over="velocity"),
}  # fmt: skip


def forces(kind: str, sketch: Sketch) -> tuple[np.ndarray, np.ndarray]:
    """Displacement or velocity of the first coordinate and the force on it over a period. The coordinates are carried by dashpots so
    strong that the law does not change their motion: sines in quarters of a period."""
    n = max(len(sketch.dofs), 2 if "second_dofs" in sketch.keys else 1)
    heavy = 1e5 * np.eye(n)
    model = nhbm.Model(nhbm.Matrices(heavy, heavy, heavy), tones=[1.0])
    for k in range(n):
        turn = 0.5 * np.pi * k
        model.load(f"x{k + 1}", 1, cos=1e5 * sketch.load * np.cos(turn), sin=1e5 * sketch.load * np.sin(turn))
    model.law(kind, sketch.dofs if len(sketch.dofs) > 1 else sketch.dofs[0], **sketch.keys)
    record = model.integrate(2 * np.pi, transient=12 * np.pi, method=sketch.method)
    return record[sketch.over].values[0], record["force"].values[0]


def draw(kind: str, path: Path) -> None:
    """The force over the displacement or velocity."""
    sketch = SKETCHES[kind]
    if kind == "rigid_wall":  # no force along a motion that it stops
        gap = sketch.keys["gap"]
        x, f = np.array([-1.0, gap, gap]), np.array([0.0, 0.0, 1.0])
    else:
        x, f = forces(kind, sketch)
    with plt.rc_context({"font.size": 9, "svg.hashsalt": kind, "svg.fonttype": "none"}):
        figure, axes = plt.subplots(figsize=(3.4, 2.3), layout="constrained")
        axes.axhline(0.0, color="0.8", linewidth=0.8)
        axes.axvline(0.0, color="0.8", linewidth=0.8)
        axes.plot(x, f, color="#1f5fa8")
        axes.set_xlabel(f"{sketch.over} of the first coordinate")
        axes.set_ylabel("force")
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def sections() -> tuple[str, dict[str, str]]:
    """Text of the manual below the heading of &law and of each type of it."""
    text = groups.divided(MANUAL.read_text(encoding="utf-8"))[1]["law"]
    head, *parts = re.split(r"^#### `type = '(\w+)'`\n", text, flags=re.MULTILINE)
    return head, dict(zip(parts[::2], parts[1::2]))


def from_here(text: str, name: str) -> str:
    """Links of docs/user/input.md as they are from a page of the catalogue."""
    places = groups.homes(groups.divided(MANUAL.read_text(encoding="utf-8"))[1])
    return groups.moved(text, groups.PAGE, groups.LAWS / f"{name}.md", places)


def examples(kind: str) -> list[Path]:
    """Inputs that have the law, short ones first."""
    found = [path for folder in ("gallery", "autonomous", "paper", "models", "accuracy", "hard") for path in (ROOT / "inputs" / folder).glob("*.nml")
             if re.search(rf"type\s*=\s*'{kind}'", path.read_text(encoding="utf-8"))]  # fmt: skip
    return sorted(found, key=lambda path: (path.parent.name not in ("gallery", "autonomous"), path.stat().st_size))[:EXAMPLES]


def title(path: Path) -> str:
    found = re.search(r"title\s*=\s*'([^']*)'", path.read_text(encoding="utf-8"))
    return found[1] if found else path.stem


def page(kind: str, text: str, has_sketch: bool) -> str:
    lines = [f"# {kind}\n"]
    if has_sketch:
        lines.append(f"![Force of {kind} over the {SKETCHES[kind].over}]({kind}.svg)\n")
    lines.append(from_here(text.strip(), kind) + "\n")
    found = examples(kind)
    if found:
        lines.append("## Examples\n")
        lines += [f"- [{path.parent.name}/{path.name}](../inputs/{path.parent.name}/{path.name}): {title(path)}" for path in found]
        lines.append("")
    numbers = ", ".join(f"`{key} = {value}`" for key, value in SKETCHES[kind].keys.items()) if has_sketch else ""
    lines.append("## Source\n")
    lines.append(f"[`src/laws/hb_law_{kind}.f90`](../src/laws/hb_law_{kind}.f90), with its derivatives."
                 + (f" The sketch has {numbers}." if numbers else ""))  # fmt: skip
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    head, texts = sections()
    for kind, text in texts.items():
        if kind in SKETCHES:
            draw(kind, folder / f"{kind}.svg")
        (folder / f"{kind}.md").write_text(page(kind, text, kind in SKETCHES), encoding="utf-8")
    head = re.sub(r"^\| (\w+) \|(?= (?:one|two|several|x and y)\b)", r"| [\1](\1.md) |", from_here(head.strip(), "index"), flags=re.MULTILINE)
    contents = "\n".join(sorted(texts))
    (folder / "index.md").write_text(
        f"# Laws: `&law`\n\n{head}\n\nEach page has a sketch of the force, its formula, its keys, examples and the source.\n\n"
        f"```{{toctree}}\n:hidden:\n\n{contents}\n```\n", encoding="utf-8")  # fmt: skip


if __name__ == "__main__":
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    main(Path(sys.argv[1]))
