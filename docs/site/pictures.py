#!/usr/bin/env python3
"""Draws the pictures of the pages again, each by the commands that its page shows.

usage: pictures.py [NAME ...]      writes docs/pictures/NAME.png; without NAME all, in about half an hour

A page with code is run as the tests run it. The commands of the others are in `DRAWN` below. Not here, as they measure or need
other programs: `MEASURED` (drawn by tests/measurements/accuracy, tests/measurements/performance, tests/benchmarks and tests/layers).
NHBM and NHBM_LIBRARY name the program and libnhbm.so. Look at each picture before you commit it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"
PAGES = [*ROOT.glob("docs/howto/*.md"), *ROOT.glob("docs/start/*.md"), ROOT / "README.md"]
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)]*/)?(\w+)\.(?:png|gif)\)|<img src=\"docs/pictures/(\w+)\.png\"")

sys.path[:0] = [str(ROOT / folder) for folder in ("tests/cases", "postproc/src", "drivers/python/src")]

from page_runner import run_page  # noqa: E402
from page_runner import _environment as environment_of_reader  # noqa: E402


def model(name: str, *drawings: str) -> list[str]:
    """Commands for a structure of inputs/models."""
    return [
        f"inputs/models/{name}.sh .",
        f"nhbm solve inputs/models/{name}.nml -o run.h5 --set \"structure%file='$PWD/{name}.h5'\"",
        *(f"nhbm-post {drawing}" for drawing in drawings),
    ]


def commands_on(page: str, word: str, output: str) -> list[str]:
    """The indented block of a page whose last line has `word`, which then writes `output`."""
    blocks = re.findall(r"(?:^    .*\n)+", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
    found = [block for block in blocks if block.strip().splitlines()[-1].strip().startswith(word) and "nhbm solve" in block]
    assert len(found) == 1, page
    return [f"nhbm() {{ command nhbm \"$@\" || [ $? = 4 ]; }}\n{textwrap.dedent(found[0]).rstrip()} -o {output}"]


#: First letters of the names of pictures that scripts of measurements draw.
MEASURED = ("accuracy_", "benchmark_convergence", "growth", "layers", "releases")

#: The names of pictures, and the commands that draw them in an empty folder with the links `inputs`, `drivers` and `docs`.
DRAWN = {
    ("rattling_plate",): model("rattling_plate", "deflection run.h5 --tuple 3,0 --dpi 100 -o rattling_plate.png"),
    ("two_beams",): model("two_beams", "deflection run.h5 --tuple 1,0 --dpi 100 -o two_beams.png"),
    ("rotor_rub",): model("rotor_rub", "deflection run.h5 --tuple 1,2 --dpi 100 -o rotor_rub.png"),
    ("lap_joint", "lap_joint_contact"): model(
        "lap_joint",
        "deflection run.h5 --tuple 1,0 --dpi 100 -o lap_joint.png",
        "contact run.h5 --dpi 60 -o lap_joint_contact.png",
    ),
    ("bladed_wheel", "bladed_wheel_contact"): model(
        "bladed_wheel",
        "deflection run.h5 --tuple 1,0 --dpi 100 -o bladed_wheel.png",
        "contact run.h5 --view time --dpi 80 -o bladed_wheel_contact.png",
    ),
    ("blades_casing", "blades_casing_contact"): model(
        "blades_casing",
        "deflection run.h5 --time 0 --dpi 100 -o blades_casing.png",
        "contact run.h5 --view time --dpi 80 -o blades_casing_contact.png",
    ),
    ("jeffcott_torus",): [
        # the torus at the second grazing, of points without an answer, takes longer than all before
        "nhbm solve inputs/gallery/jeffcott_torus.nml --set \"stability%method='integration'\" --time-limit 120 || [ $? = 3 ]",
        "nhbm-post response 'rub all round:jeffcott_torus.h5' torus:jeffcott_torus_56.h5 --dpi 100 -o jeffcott_torus.png",
    ],
    ("curve",): [
        *(f'nhbm solve inputs/gallery/duffing_curve.nml -o {a}.h5 --set "load(1)%cos={a}"' for a in ("0.06", "0.12", "0.18")),
        'nhbm solve inputs/autonomous/duffing_backbone.nml -o b.h5 --set "law(1)%stiffness=0.1" --set sweep%from=0.05'
        " --set sweep%to=3.2",
        'nhbm-post response "0.06 N:0.06.h5" "0.12 N:0.12.h5" "0.18 N:0.18.h5" backbone:b.h5 --tuple 1 --dpi 80 -o curve.png',
    ],
    ("response",): commands_on("postproc/README.md", "nhbm-post response", output="response.png"),
    ("bouncing_curve",): [
        "nhbm solve inputs/gallery/bouncing_curve.nml",
        "nhbm-post response bouncing_curve.h5 --tuple 1 --dpi 80 -o bouncing_curve.png",
    ],
    ("rotor_speeds",): [
        "nhbm solve inputs/rotor_stator/rotating.nml || [ $? = 4 ]",
        "nhbm-post rotor rotating.h5 --view speeds -o rotor_speeds.png",
    ],
    ("rotor_snapshots", "rotor_wave"): [
        "nhbm solve inputs/rotor_stator/stationary.nml",
        "nhbm-post rotor stationary.h5 --view snapshots -o rotor_snapshots.png",
        "nhbm-post rotor stationary.h5 --view wave -o rotor_wave.png",
    ],
    ("bolted_joint",): ["python drivers/examples/bolted_beam.py bolted_joint.png"],
    ("dual_rotor",): ["python drivers/examples/dual_rotor_film.py dual_rotor.gif dual_rotor.png"],
    ("concept_branches", "concept_error", "concept_hypertime", "concept_tuples"): ["python docs/site/concepts.py ."],
}


def shown_on(page: Path) -> set[str]:
    return {name or other for _, name, other in SHOWN.findall(page.read_text(encoding="utf-8"))}


def draw(names: tuple[str, ...], commands: list[str]) -> None:
    """Runs commands as a reader would, and copies the pictures that they make."""
    with tempfile.TemporaryDirectory() as where:
        folder = Path(where)
        for linked in ("inputs", "drivers", "docs"):
            (folder / linked).symlink_to(ROOT / linked)
        environment = environment_of_reader(folder)
        for command in commands:
            done = subprocess.run(["bash", "-ec", command], cwd=folder, env=environment, capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(f"{names[0]}: {command}\n{done.stdout}{done.stderr}")
        copy(folder, set(names))


def copy(folder: Path, names: set[str]) -> None:
    for picture in [*folder.glob("*.png"), *folder.glob("*.gif")]:
        if picture.stem in names and (PICTURES / picture.name).exists():
            shutil.copy(picture, PICTURES)
            print(picture.stem, flush=True)


def main(names: list[str]) -> None:
    of_pages = {page: shown_on(page) for page in PAGES}
    commanded = {name for group in DRAWN for name in group}
    known = commanded | set().union(*of_pages.values())
    if unknown := set(names) - known:
        raise SystemExit(f"no picture {', '.join(sorted(unknown))}; known: {', '.join(sorted(known))}")
    wanted = set(names or known)
    for group, commands in DRAWN.items():
        if wanted & set(group):
            draw(group, commands)
    for page, shown in of_pages.items():
        if wanted & shown - commanded:
            with tempfile.TemporaryDirectory() as folder:
                run_page(page, Path(folder))
                copy(Path(folder), wanted & shown - commanded)


if __name__ == "__main__":
    main(sys.argv[1:])
