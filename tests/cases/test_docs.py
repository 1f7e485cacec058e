"""docs/user/input.md against the source: every group and key that the program reads is documented, and no other.

Headings of the page say where a key belongs: `### `&law`` for a group, `#### `type = 'rigid_wall'`` for one kind of it.
In the tables the first column names the key.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src"
PAGE = ROOT / "docs" / "user" / "input.md"

# Where neither the file nor the procedure (read_<group>) tells whose keys are read.
SECTIONS_BY_FILE = {
    "hb_truncation.f90": [("harmonics", "")],
    "hb_law.f90": [("law", "")],
    "hb_law_catalogue.f90": [("law", "")],
    "hb_proportional_damping.f90": [("structure", "")],
    "hb_structure_catalogue.f90": [("structure", "")],
    "hb_sweep_plan.f90": [("sweep", "")],
    "hb_curve_plan.f90": [("curve", "")],
    "hb_scene_reduction.f90": [],  # looks at keys that others read, as the next
    "hb_next_step.f90": [],
    "hb_switched_input.f90": [],
}
SECTIONS_BY_PROCEDURE = {
    "read_amplitude": [("load", ""), ("start", "")],
    "read_hardness": [("law", "blade_contact"), ("law", "contact_table")],
}

CALL = re.compile(r"\bcall\s+(?!file%)\w+%(?:get|require)\s*\(\s*([\"'])(\w+)\1", re.IGNORECASE)
PROCEDURE = re.compile(r"^\s*(?:(?:pure|impure|elemental|recursive|module)\s+)*subroutine\s+(\w+)", re.IGNORECASE)
GROUP_HEADING = re.compile(r"^### `&(\w+)`\s*$")
KIND_HEADING = re.compile(r"^#### `type = '(\w+)'`\s*$")


def without_comment(line: str) -> str:
    """Fortran line up to its comment; quotes may hold exclamation marks."""
    quote = ""
    for i, c in enumerate(line):
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c == "!":
            return line[:i]
    return line


def code_of(path: Path) -> list[str]:
    return [without_comment(line) for line in path.read_text(encoding="utf-8").splitlines()]


def names_in(path: Path, constant: str) -> list[str]:
    """Words of a character array parameter."""
    text = "\n".join(code_of(path))
    match = re.search(rf"::\s*{constant}\s*(?:\([^)]*\))?\s*=\s*&?\s*\[(.*?)\]", text, re.DOTALL)
    assert match, f"{path.name} has no list '{constant}'"
    return [word.strip() for word in re.findall(r"\"([^\"]*)\"", match.group(1))]


@cache
def groups_of_program() -> list[str]:
    return names_in(SRC / "motion" / "hb_scene_reader.f90", "group_names") + ["sweep", "curve"]


@cache
def kinds_of_program() -> set[tuple[str, str]]:
    laws = names_in(SRC / "laws" / "hb_law_catalogue.f90", "law_names")
    structures = names_in(SRC / "structure" / "hb_structure_catalogue.f90", "known_structures")
    return {("law", name) for name in laws} | {("structure", name) for name in structures}


def sections_of(path: Path, procedure: str) -> list[tuple[str, str]]:
    """Groups, and kinds of them, to which the keys that a procedure reads belong."""
    if path.name in SECTIONS_BY_FILE:
        return SECTIONS_BY_FILE[path.name]
    if procedure in SECTIONS_BY_PROCEDURE:
        return SECTIONS_BY_PROCEDURE[procedure]
    module = path.stem.removeprefix("hb_")
    if path.parent.name == "laws":
        return [("law", module.removeprefix("law_"))]
    if path.parent.name == "structure":
        return [("structure", module)]
    return [(procedure.removeprefix("read_"), "")]


@cache
def keys_of_program() -> dict[tuple[str, str], dict[str, str]]:
    """Keys by section, each with the place where it is read."""
    keys: dict[tuple[str, str], dict[str, str]] = {}
    for path in sorted(SRC.rglob("*.f90")):
        if path.parent.name == "base":
            continue
        procedure = ""
        for number, line in enumerate(code_of(path), start=1):
            if match := PROCEDURE.match(line):
                procedure = match.group(1).lower()
            for _, key in CALL.findall(line):
                for section in sections_of(path, procedure):
                    keys.setdefault(section, {})[key.lower()] = f"{path.relative_to(ROOT)}:{number}"
    return keys


@cache
def keys_of_page() -> dict[tuple[str, str], set[str]]:
    """Keys in the first column of the tables under each heading."""
    keys: dict[tuple[str, str], set[str]] = {}
    section = None
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if match := GROUP_HEADING.match(line):
            section = (match.group(1), "")
        elif match := KIND_HEADING.match(line):
            assert section, f"'{line}' stands under no group"
            section = (section[0], match.group(1))
        elif re.match(r"^#{1,3} ", line):
            section = None
        if section:
            row_keys = keys.setdefault(section, set())
            if match := re.match(r"^\| `(\w+)` \|", line):
                row_keys.add(match.group(1))
    return keys


def heading(section: tuple[str, str]) -> str:
    group, kind = section
    return f"&{group}" + (f" type = '{kind}'" if kind else "")


def test_keys_are_found_in_the_source():
    """The patterns above still fit the source."""
    keys = keys_of_program()
    assert "gap" in keys[("law", "rigid_wall")]
    assert "tolerance" in keys[("solver", "")]
    assert {"load", "start", "sweep"} <= {group for group, _ in keys}


def test_keys_belong_to_known_groups():
    known = {(group, "") for group in groups_of_program()} | kinds_of_program()
    for section, keys in keys_of_program().items():
        assert section in known, (
            f"{next(iter(keys.values()))} reads '{next(iter(keys))}' of {heading(section)}, which is no group or kind "
            f"of the program; name the procedure read_<group>, or add it to the tables in {Path(__file__).name}"
        )


@pytest.mark.parametrize("group", groups_of_program())
def test_group_is_documented(group):
    assert (group, "") in keys_of_page(), f"docs/user/input.md has no heading '### `&{group}`'"


@pytest.mark.parametrize("kind", sorted(kinds_of_program()))
def test_kind_is_documented(kind):
    group, name = kind
    assert kind in keys_of_page(), f"docs/user/input.md has no heading '#### `type = '{name}'`' under &{group}"


@pytest.mark.parametrize("section", sorted(keys_of_program()), ids=heading)
def test_keys_are_documented(section):
    documented = keys_of_page().get(section, set())
    missing = [f"{key} ({place})" for key, place in keys_of_program()[section].items() if key not in documented]
    assert not missing, f"docs/user/input.md lacks under {heading(section)}: {', '.join(missing)}"


@pytest.mark.parametrize("section", sorted(keys_of_page()), ids=heading)
def test_documented_keys_exist(section):
    invented = sorted(keys_of_page()[section] - set(keys_of_program().get(section, {})))
    assert not invented, f"docs/user/input.md has under {heading(section)} keys that nothing reads: {', '.join(invented)}"


def test_units_of_parameters_are_those_of_the_page():
    """What a reader declares for a key is what the page says of a key of that name; a number without a unit there is a 1."""
    page: dict[str, set[str]] = {}
    for key, unit in re.findall(r"^\| `(\w+)` \| (?:list of )?reals? \| ([^|]*)\|", PAGE.read_text(), re.MULTILINE):
        page.setdefault(key, set()).add(unit.strip().replace("²", "2").replace("³", "3") or "1")
    told: dict[str, set[str]] = {}
    for path in SRC.rglob("*.f90"):
        for key, unit in re.findall(r'%get\("(\w+)"[^\n]*?unit="([^"]+)"', "\n".join(code_of(path))):
            told.setdefault(key, set()).add(unit)
    wrong = {key: (told[key], page[key]) for key in told.keys() & page.keys() if not told[key] <= page[key]}
    assert told["gap"] == {"m"} and told["energy"] == {"J"} and not wrong, wrong
    silent = {key for key, units in page.items() if len(units) == 1 and not units & {"1"} and key not in told}
    of_parameters = {"values", "others", "from", "to", "start", "over_from", "over_to"}
    assert silent <= of_parameters | {"cos", "sin", "damping", "coefficients", "rescue_work"}, silent


def test_choices_are_documented():
    """Each word that a key accepts from a list of choices stands on the page in quotes."""
    page = PAGE.read_text(encoding="utf-8")
    for path in sorted(SRC.rglob("*.f90")):
        for constant in re.findall(r"choices=(\w+)", "\n".join(code_of(path))):
            for word in _choices(path, constant):
                assert f"`'{word}'`" in page, f"docs/user/input.md does not tell of '{word}', a choice in {path.name}"


def _choices(path: Path, constant: str) -> list[str]:
    """Words of a list of choices, from the file that uses it or the one that owns it."""
    for candidate in [path, *sorted(SRC.rglob("*.f90"))]:
        if re.search(rf"parameter\s*::\s*{constant}\s*\(", "\n".join(code_of(candidate))):
            return names_in(candidate, constant)
    return []  # an argument of the reader itself


def test_sections_of_theory_exist():
    """Sections and equations that comments cite stand in docs/user/theory.md."""
    theory = (ROOT / "docs" / "user" / "theory.md").read_text(encoding="utf-8")
    known = set(re.findall(r"^#{2,3} (\d(?:\.\d)?)\.? ", theory, re.MULTILINE))
    known |= {f"({number})" for number in re.findall(r"\\tag\{(\d+)\}", theory)}
    citation = re.compile(r"docs/user/theory\.md, (?:sections? ([\d., toand]+)|eq\. ([()\d, toand]+))")
    n_cited = 0
    for path in sorted(SRC.rglob("*.f90")):
        for sections, equations in citation.findall(path.read_text(encoding="utf-8")):
            cited = re.findall(r"\d(?:\.\d)?", sections) + re.findall(r"\(\d+\)", equations)
            n_cited += len(cited)
            missing = sorted(set(cited) - known)
            assert not missing, f"{path.relative_to(ROOT)} cites what docs/user/theory.md lacks: {', '.join(missing)}"
    assert n_cited > 10, "the pattern of citations no longer fits the source"
