"""The tables of input keys and laws (src/input_keys.txt, src/laws.txt) against the source and the page: each key that the
program reads has one row, each row is read, docs/user/input has the tables that follow from them, and nothing of a row
stands a second time in the source.
"""

from __future__ import annotations

import json
import re
import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from program import run

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src"
TABLES = runpy.run_path(str(ROOT / "tests" / "keys"))
ELEMENTS, LOADS = (
    re.findall(r"^([a-z]\w*) \|", (SRC / f"structure_{table}.txt").read_text(), re.MULTILINE) for table in ("elements", "loads")
)
WITH_AMPLITUDES = [load for load in LOADS if "harmonic_amplitude_t" in (SRC / "structure" / f"hb_{load}.f90").read_text()]
OF_SOME_LOADS = {"label", "dof", "vector", "dofs", "tuple"}  # are read where the load has a row for them
KEYS, LAWS = TABLES["keys"](), TABLES["laws"]()

# Where neither the file nor the procedure (read_<group>) tells whose keys are read.
SECTIONS_BY_FILE = {
    "hb_truncation_reader.f90": ["harmonics"],
    "hb_location_reader.f90": ["law"],
    "hb_coupled_terms_reader.f90": ["law polynomial_coupled"],
    "hb_proportional_damping.f90": ["structure"],
    "hb_sweep_plan.f90": ["sweep"],
    "hb_swept.f90": ["sweep"],
    "hb_curve_plan.f90": ["curve"],
    "hb_element_reader.f90": [*ELEMENTS, *LOADS],
    "hb_harmonic_amplitude.f90": ["start", *WITH_AMPLITUDES],
}
SECTIONS_BY_PROCEDURE = {
    "structure_element_get_dof_keys": ["bearing"],
    "any_beam_declare_numbers": ["structure beam", "structure modal_beam"],
    "fe_model_builder_declare_numbers": ["structure model"],
    "read_beam": ["structure beam"],
    "read_chain": ["structure chain"],
    "read_fe_model": ["structure model"],
    "read_matrices": ["structure matrices"],
    "read_modal_beam": ["structure modal_beam"],
    "read_rotor_stator": ["structure rotor_stator"],
    "read_load": LOADS,
    "read_position": ["initial", "start", *LOADS],
    "read_tuple": ["start", *LOADS],
    "read_ties": ["tie"],
    "read_user_law": ["law user"],
    "reject_other_libraries": ["law user"],
    "jenkins_declare_numbers": ["law jenkins", "law jenkins_2d"],
    "declare_contacts": ["law blade_contact", "law contact_table"],
    "frequency_part_declare_numbers": ["dynamic_stiffness"],  # and of its kinds, each in a case
    "read_frequency_part": ["dynamic_stiffness"],
    "read_names": ["dynamic_stiffness"],
    "read_frequencies": ["tones"],
    "read_unknown_tones": ["tones"],
}

CALL = re.compile(r"\bcall\s+(?:(?!file%)\w+%(?:get|choose)|numbers%add)\s*\(\s*([\"'])(\w+)\1", re.IGNORECASE)
CALL_BY_LIST = re.compile(r"\bcall\s+\w+%get\s*\(\s*trim\(\s*(\w+)\s*\(", re.IGNORECASE)
LIST = re.compile(r"parameter\s*::\s*(\w+)\(\d+\)\s*=\s*\[character\(\d+\)\s*::([^]]*)\]", re.IGNORECASE)
CASE = re.compile(r"^\s*(?:case\s*\(kind_of_part%(\w+)\)|end select)", re.IGNORECASE)
FURTHER = re.compile(r'"(\w+_)dofs"')  # a further coordinate of a law, which has weights too
ROWS_OF_KINDS = (SRC / "motion" / "events" / "hb_point_kinds.f90").read_text(encoding="utf-8")
KEYS_OF_RESPONSES = re.findall(r'"(\w+_of)"', ROWS_OF_KINDS)
KEYS_OF_TARGETS = re.findall(r'"\w+_of", (?:&\s*)?"(\w+)"', ROWS_OF_KINDS)
PROCEDURE = re.compile(r"^\s*(?:(?:pure|impure|elemental|recursive|module)\s+)*subroutine\s+(\w+)", re.IGNORECASE)


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


@cache
def keys_of_program() -> dict[str, dict[str, str]]:
    """Keys by section of the table, each with the place where it is read."""
    keys: dict[str, dict[str, str]] = {}
    for path in sorted(SRC.rglob("*.f90")):
        procedure, kind = "", None
        lists: dict[str, list[str]] = {"response_keys": KEYS_OF_RESPONSES, "target_keys": KEYS_OF_TARGETS}
        for number, line in enumerate(code_of(path), start=1):
            if match := PROCEDURE.match(line):
                procedure = match.group(1).lower()
            if match := CASE.match(line):
                kind = match.group(1)
            lists |= {name: re.findall(r'"(\w+)"', names) for name, names in LIST.findall(line)}
            listed = [key for name in CALL_BY_LIST.findall(line) for key in lists[name]]
            if "dof_key_length) ::" in line:
                listed += re.findall(r'"(\w+)"', line)
            if "placement%further" in line:
                listed += [first + key for first in FURTHER.findall(line) for key in ("dofs", "weights")]
            for key in [key for _, key in CALL.findall(line)] + listed:
                for section in sections_of(path, procedure):
                    if section in LOADS and key in OF_SOME_LOADS - keys_of_table()[section]:
                        continue
                    if procedure == "frequency_part_declare_numbers" and kind:
                        section = f"{section} {kind}"
                    keys.setdefault(section, {})[key.lower()] = f"{path.relative_to(ROOT)}:{number}"
    return keys


def sections_of(path: Path, procedure: str) -> list[str]:
    """Sections of the table to which the keys that a procedure reads belong."""
    if path.name in SECTIONS_BY_FILE:
        return SECTIONS_BY_FILE[path.name]
    if procedure in SECTIONS_BY_PROCEDURE:
        return SECTIONS_BY_PROCEDURE[procedure]
    group = procedure.removesuffix("_declare_numbers")
    if group != procedure and group in keys_of_table():
        return [group]
    module = path.stem.removeprefix("hb_")
    if path.parent.name == "laws":
        return [f"law {module.removeprefix('law_')}"]
    if path.parent.name == "structure" and module in ELEMENTS + LOADS:
        return [module]
    if path.parent.name == "structure":
        return [f"structure {module}"]
    return [procedure.removeprefix("read_")]


@cache
def keys_of_table() -> dict[str, set[str]]:
    table: dict[str, set[str]] = {}
    for key in KEYS:
        table.setdefault(key.section, set()).add(key.name)
    return table


def words(text: str) -> list[str]:
    """The words of a list of quoted ones; none where there is anything else."""
    return re.findall("'([^']*)'", text) if re.fullmatch("'[^']*'(, '[^']*')*", text) else []


def test_the_page_has_the_tables():
    done = subprocess.run([sys.executable, ROOT / "tests" / "keys", "--check"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_page_lists_the_groups():
    """Each group of the table of keys is in the table of groups, which links to its page."""
    page = (ROOT / "docs" / "user" / "input.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| \[`&(\w+)`\]\(input/(\w+)\.md\) \|", page, re.MULTILINE)
    assert all(group == heading for group, heading in listed)
    missing = {key.section.partition(" ")[0] for key in KEYS} - {group for group, _ in listed}
    assert not missing, f"the table of groups of docs/user/input.md lacks {', '.join(sorted(missing))}"


def test_the_program_has_the_table(tmp_path):
    rows = [line for line in (SRC / "input_keys.txt").read_text().splitlines() if line and not line.startswith("#")]
    assert run("keys", cwd=tmp_path).stdout.splitlines() == rows
    assert run("keys", "Jenkins_2d |", cwd=tmp_path).stdout.splitlines() == [
        row for row in rows if row.startswith("law jenkins_2d |")
    ]


def test_the_table_is_there_for_programs(tmp_path):
    lines = (SRC / "input_keys.txt").read_text().splitlines()
    rows = [line.rstrip().split(" | ", 6) for line in lines if line and not line.startswith("#")]
    names = ("section", "key", "type", "unit", "default", "range", "meaning")
    assert json.loads(run("keys", "--json", cwd=tmp_path).stdout) == [dict(zip(names, row)) for row in rows]
    assert {row["section"] for row in json.loads(run("keys", "law hertz", "--json", cwd=tmp_path).stdout)} == {"law hertz"}
    assert run("keys", "no such word", "--json", cwd=tmp_path).stdout == ""
    assert "did you mean 'clearance'?" in run("keys", "clearence", cwd=tmp_path).stderr


def test_a_key_has_one_row():
    sections = [key.section for key in KEYS]
    assert len({(key.section, key.name) for key in KEYS}) == len(KEYS)
    assert len(keys_of_table()) == 1 + sum(one != other for one, other in zip(sections, sections[1:]))
    for key in KEYS:
        group, _, kind = key.section.partition(" ")
        assert not kind or (key.name not in keys_of_table()[group] and f"'{kind}'" in _row(group, "type").range), key


def _row(section: str, name: str):
    return next(key for key in KEYS if (key.section, key.name) == (section, name))


def test_rows_are_as_the_head_of_the_table_says():
    for key in KEYS:
        assert re.fullmatch(r"(list of )?(real|integer|logical|text)s?|matrix of reals|\d integers", key.type), key
        assert not key.unit or "real" in key.type, key
        assert key.default and key.meaning, key
        if words(key.range) and words(key.default):
            assert words(key.default)[0] in words(key.range), key
        if re.fullmatch(r"[-\d.e]+", key.default):
            for bound, least in (("> ", 1e-300), (">= ", 0.0)):
                if match := re.match(rf"{bound}([-\d.e]+)", key.range):
                    assert float(key.default) >= float(match[1]) + least, key


@pytest.mark.parametrize("section", sorted(keys_of_program()))
def test_keys_that_are_read_have_rows(section):
    missing = {key: place for key, place in keys_of_program()[section].items() if key not in keys_of_table().get(section, ())}
    assert not missing, f"src/input_keys.txt lacks of {section}: {missing}; of another group: say so in SECTIONS_BY_PROCEDURE"


@pytest.mark.parametrize("section", sorted(keys_of_table()))
def test_keys_that_have_rows_are_read(section):
    invented = sorted(keys_of_table()[section] - set(keys_of_program().get(section, {})))
    assert not invented, f"src/input_keys.txt has of {section} keys that nothing reads: {', '.join(invented)}"


def test_the_table_of_laws_is_in_order():
    names = [law.name for law in LAWS]
    assert names == sorted(set(names)) and len(names) > 20
    assert {f"hb_law_{name}.f90" for name in names} <= {path.name for path in (SRC / "laws").glob("*.f90")}
    for law in LAWS:
        assert law.dofs and set(law.keys) <= keys_of_table()[f"law {law.name}"], law


def test_marks_of_located_points_can_be_drawn():
    source = (SRC / "motion" / "events" / "hb_point_kinds.f90").read_text(encoding="utf-8")
    table = source.partition("parameter :: curve_kinds")[2].partition(")]")[0]
    marks = {words[3] for words in (re.findall(r'"([^"]*)"', row) for row in table.split("point_kind_t(")) if len(words) > 3}
    page = (ROOT / "postproc" / "src" / "nhbm_post" / "page.html").read_text(encoding="utf-8")
    in_page = set(re.findall(r'shape === "(\w+)"', page))
    in_page |= set(re.findall(r"(\w+): \d", re.search(r"const n = \{(.*?)\}", page)[1]))
    from nhbm.located import MARKERS

    assert len(marks) > 8
    assert marks <= in_page, "nhbm_post/page.html draws no other marks"
    assert marks <= set(MARKERS), "nhbm/located.py draws no other marks"


def test_kinds_of_points_are_on_the_page_of_curves():
    source = (SRC / "motion" / "events" / "hb_point_kinds.f90").read_text(encoding="utf-8")
    kinds = re.findall(r'point_kind_t\("(\w+)"', source)
    page = (ROOT / "docs" / "user" / "curves.md").read_text(encoding="utf-8")
    table = page.partition("| kind | meaning |\n")[2].partition("\n\n")[0]
    listed = [name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split(" | ")[0])]
    assert len(kinds) > 10 and kinds[0] == "none" and sorted(listed) == sorted(kinds[1:])


def test_nothing_is_described_twice():
    """Choices stand in no list of the source, units at no reader; limits and defaults, a reader has no argument for."""
    of_columns = {"stability_method_names"}  # what a column of results shows, in the same words
    choices = {frozenset(words(key.range)): key for key in KEYS if len(words(key.range)) > 1}
    for path in sorted(SRC.rglob("*.f90")):
        text = "\n".join(code_of(path))
        for name, listed in re.findall(r"parameter :: (\w+)\([^)]*\) = (?:&\s*)?\[character\(\d+\) ::([^\]]*)\]", text):
            twice = choices.get(frozenset(word.strip() for word in re.findall('"([^"]*)"', listed)))
            assert not twice or name in of_columns, f"{path.name}: {name} has the choices of {twice}"
        assert not re.search(r'%get\([^\n]*unit="', text), f"{path.name} gives a unit to a key"



def test_sections_of_theory_exist():
    """Sections and equations that comments cite stand in docs/why/theory.md."""
    theory = (ROOT / "docs" / "why" / "theory.md").read_text(encoding="utf-8")
    known = set(re.findall(r"^#{2,3} (\d(?:\.\d)?)\.? ", theory, re.MULTILINE))
    known |= {f"({number})" for number in re.findall(r"\\tag\{(\d+)\}", theory)}
    citation = re.compile(r"docs/why/theory\.md, (?:sections? ([\d., toand]+)|eq\. ([()\d, toand]+))")
    n_cited = 0
    for path in sorted(SRC.rglob("*.f90")):
        for sections, equations in citation.findall(path.read_text(encoding="utf-8")):
            cited = re.findall(r"\d(?:\.\d)?", sections) + re.findall(r"\(\d+\)", equations)
            n_cited += len(cited)
            missing = sorted(set(cited) - known)
            assert not missing, f"{path.relative_to(ROOT)} cites what docs/why/theory.md lacks: {', '.join(missing)}"
    assert n_cited > 10, "the pattern of citations no longer fits the source"


def test_packages_have_one_version_and_one_license():
    version = re.search(r"project\(nhbm VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]
    places = {
        "pyproject.toml": rf'^version = "{version}"',
        "CITATION.cff": rf"^version: {version}",
        "packages/conda/recipe.yaml": rf"^  version: \"{version}\"",
        "drivers/python/src/nhbm/__init__.py": rf'^__version__ = "{version}"',
    }
    for name, line in places.items():
        assert re.search(line, (ROOT / name).read_text(), re.M), name
    spack = "packages/spack/spack_repo/nhbm/packages/nhbm/package.py"
    for name in ("pyproject.toml", "CITATION.cff", "packages/conda/recipe.yaml", spack):
        assert "GPL-3.0-or-later" in (ROOT / name).read_text(), name


def test_attempts_of_the_solver_are_documented():
    """docs/user/convergence.md has the attempts of src/solve/hb_attempts.f90, in their order."""
    source = (SRC / "solve" / "hb_attempts.f90").read_text(encoding="utf-8")
    page = (ROOT / "docs" / "user" / "convergence.md").read_text(encoding="utf-8")
    page = page.split("### What is tried")[1].split("\nWhich of these")[0]
    attempts = re.findall(r'attempt_rule_t\(attempt_row%\w+, "(\w+)"', source)
    assert len(attempts) > 20 and re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == attempts
