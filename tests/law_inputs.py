#!/usr/bin/env python3
"""Writes small random inputs with each kind of law, for runs under valgrind (tests/valgrind --laws N).

usage: tests/law_inputs.py FOLDER N [--seed S] [--samples LIBRARY]      writes FOLDER/KIND_K.nml for K from 1 to N

The kinds are the types of src/laws.txt and what some of them are with other keys: rigid contacts, a normal load that varies,
restitution. The numbers of a law are those of its example, scaled; structure, loads, one or two tones, the solver and what is asked
for besides the motion (a curve, stability, a derivative, an accuracy, a record) are drawn. A point need not converge.
`user` needs the library of tests/laws/user_law_samples.c, and is left out without it.
"""

from __future__ import annotations

import argparse
import random
import runpy
import sys
from pathlib import Path

LAWS = runpy.run_path(str(Path(__file__).resolve().parent / "keys"))["laws"]
MATRICES = {"shapes", "friction_shapes"}
NORMAL_LOAD = {"limit": None, "friction_coefficient": [0.4], "normal_stiffness": [1.5], "preload": [0.5], "normal_dofs": ["{last}"]}
RIGID = {"contact": ["rigid"], "stiffness": None}
# Kinds beyond the examples: the type, and keys that are set or, by None, left out.
VARIANTS = {
    "blade_contact_rigid": ("blade_contact", {**RIGID, "shares": None, "gaps": [0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0.2]}),
    "contact_table_rigid": ("contact_table", {**RIGID, "gaps": [0.1, 0.2, 0.3], "friction_coefficient": [0.05]}),
    "jenkins_normal_load": ("jenkins", NORMAL_LOAD),
    "jenkins_2d_normal_load": ("jenkins_2d", NORMAL_LOAD),
    "rigid_wall_restitution": ("rigid_wall", {"two_sided": None, "restitution": [0.6]}),
}


def shown(value: object) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(shown, value))
    if isinstance(value, bool):
        return f".{str(value).lower()}."
    return f"'{value}'" if isinstance(value, str) else repr(value)


def scaled(keys: dict, draw: random.Random) -> dict:
    """Real numbers by a factor of each key; integers and words stay."""
    found = {}
    for key, values in keys.items():
        factor = draw.uniform(0.8, 1.2)
        is_real = any(isinstance(value, float) for value in values)
        found[key] = [factor * value for value in values] if is_real else values
    return found


def text_of(law, changes: dict, draw: random.Random) -> str:
    keys = {key: values for key, values in {**law.keys, **changes}.items() if values is not None}
    n = max(len(law.dofs), 2 if "second_dofs" in keys else 1) + ("normal_dofs" in keys) + draw.choice([0, 1])
    stiffness = [[2.0 * (i == k) - (abs(i - k) == 1) for k in range(n)] for i in range(n)]
    stiffness = [[draw.uniform(0.8, 1.2) * (i == k) + stiffness[i][k] for k in range(n)] for i in range(n)]
    n_tones = draw.choice([1, 1, 2])
    tones = [draw.uniform(0.5, 1.5), draw.uniform(1.6, 2.4)][:n_tones]
    first = ["1", "1, 0"][n_tones - 1]
    groups = [
        f"&structure type = 'matrices', n_dofs = {n}, mass = {shown([1.0] * n)}, damping = {shown([0.1] * n)},\n   stiffness = "
        + shown([number for row in stiffness for number in row]) + " /",
        f"&tones frequency = {shown(tones)} /",
        f"&harmonics order = {draw.choice([2, 3])} /",
        f"&load dof = 'x1', tuple = {first}, cos = {draw.uniform(0.2, 0.8)!r} /",
    ]  # fmt: skip
    if n_tones == 2:
        groups.append(f"&load dof = 'x1', tuple = 0, 1, sin = {draw.uniform(0.1, 0.4)!r} /")
    values = scaled(keys, draw)
    if "tuple" in values and n_tones == 2:
        values["tuple"] = [k for j in values["tuple"] for k in (j, 0)]  # each has one entry
    given = ", ".join(f"{key} = {shown(value)}" for key, value in values.items()).replace("{last}", f"x{n}")
    groups.append(f"&law type = '{law.name}', {law.place}, {given} /")
    groups.append(f"&solver method = '{draw.choice(['newton', 'krylov', 'broyden', 'auto'])}', max_fallback_work = 0.03 /")
    more = draw.choice(["", "curve", "stability", "samples", "gradient", "accuracy", "record"])
    if more == "curve" and n_tones == 1:
        groups.append(f"&curve parameter = 'tones%frequency', from = {tones[0]!r}, to = {1.1 * tones[0]!r}, points = 6 /")
    elif more == "stability":
        groups.append("&stability method = 'integration' /")
    elif more == "samples":
        groups.append("&output samples = 8 /")
    elif more == "gradient":
        number = next((key for key, value in values.items() if isinstance(value[0], float) and key not in MATRICES), None)
        place = f"law(1)%{number}" + ("(1)" if number and len(values[number]) > 1 else "")
        groups.append(f"&gradient by = {shown(([place] if number else []) + ['tones%frequency(1)', 'load(1)%cos'])} /")
    elif more == "accuracy":
        groups.append("&accuracy tolerance = 0.05, max_harmonics = 60, max_work = 0.02 /")
    elif more == "record":
        method = draw.choice(["cvode", "runge_kutta_4", "central_differences", "generalized_alpha"])
        groups.append(f"&integration method = '{method}', duration = 6, steps_per_period = 50 /")
    return f"! {law.name}, at random\n" + "\n".join(groups) + "\n"


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(usage=__doc__.split("\n\n")[1].removeprefix("usage: "))
    parser.add_argument("folder", type=Path)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--samples", type=Path)
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    laws = {law.name: law for law in LAWS()}
    kinds = {**{name: (name, {}) for name in laws}, **VARIANTS}
    if options.samples:
        kinds["user"] = ("user", {"library": [str(options.samples.resolve())]})
    else:
        del kinds["user"]
    for kind, (name, changes) in kinds.items():
        for k in range(1, options.count + 1):
            draw = random.Random(f"{options.seed} {kind} {k}")
            (options.folder / f"{kind}_{k}.nml").write_text(text_of(laws[name], changes, draw), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
