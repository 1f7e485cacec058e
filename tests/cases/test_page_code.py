"""Code in the pages for users: commands have the verbs and options of the programs, groups and paths the keys of the table, and
whole inputs pass the check. Recipes and tutorials also run as written (test_recipes), as does the page of the library."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import io
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import nhbm
import nhbm.command
import nhbm_post.cli
import pytest
from nhbm.accessor import Accessor
from program import ALL_CONVERGED, run

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("docs/user", "docs/user/input", "docs/user/laws", "docs/start", "docs/howto", "drivers/python", "postproc")
PAGES = [ROOT / "README.md", *(page for folder in FOLDERS for page in sorted((ROOT / folder).glob("*.md")))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
FENCE = re.compile(r"^( *)```(\{code-cell\}|[\w-]*)[^\n]*\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"(?<!`)(`+)(?!`)(.+?)(?<!`)\1(?!`)")
GROUP = re.compile(r"&([a-z_]+)\b(?!\))((?:[^/'\"!]|'[^']*'|\"[^\"]*\"|![^\n]*\n)*)")  # not an address of C, &wall)
KEY = re.compile(r"(?:^|[\s,])([a-z_]\w*)(?:\([\d, :]*\))?\s*=(?!=)")
COMMENT = re.compile(r"!(?=(?:[^'\n]*'[^'\n]*')*[^'\n]*$).*", re.MULTILINE)
PATH = re.compile(r"(?<![\w%./-])([a-z_]+)(?:\([^()%]*\))?%([a-z]\w*)")
FILES = ("h", "h5", "mat", "nml")
NO_COMMAND = (["after", "installation)"], ["model"])
ONCE = {"structure", "tones", "harmonics"}
MODEL = {
    "structure": "&structure type = 'chain', n_masses = 2, ends = 'fixed', mass = 1, coupling_stiffness = 1, damping_mass = 0.1 /",
    "tones": "&tones frequency = 0.8 /",
    "harmonics": "&harmonics order = 3 /",
    "load": "&load dof = 'x1', tuple = 1, cos = 0.1 /",
    "law": "&law type = 'elastic_stop', label = 'wall', dof = 'x2', stiffness = 1.0, gap = 0.1 /\n"
    "&law type = 'van_der_pol', dof = 'x1', strength = 0.1 /",
}
PYTHON = {"nhbm-post": nhbm_post.cli.main, "nhbm-model": nhbm.command.main}


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(name: str, *kinds: str) -> list[str]:
    return [text for _, kind, text in FENCE.findall(text_of(name)) if kind.strip("{}") in kinds]


def pieces(name: str, *kinds: str) -> Iterator[str]:
    """The code of a page: its blocks of some kinds, indented lines, and what stands in the text."""
    text = text_of(name)
    yield from blocks(name, *kinds)
    text = FENCE.sub("", text)
    yield from re.findall(r"(?:^ {4,}[^\s|*-].*\n)+", text, re.MULTILINE)
    yield from (code for _, code in INLINE.findall(text))


def without_quotes(text: str) -> str:
    return re.sub(r"'[^']*'|\"[^\"]*\"", "''", COMMENT.sub("", text))


@functools.cache
def keys() -> dict[str, set[str]]:
    """Keys by group, those of all its types together."""
    table: dict[str, set[str]] = {}
    for row in json.loads(run("keys", "--json", cwd=ROOT).stdout):
        table.setdefault(row["section"].split()[0], set()).add(row["key"])
    return table


@pytest.mark.parametrize("name", NAMES)
def test_groups_have_their_keys(name):
    for piece in pieces(name, "fortran"):
        for group, body in GROUP.findall(piece):
            if group in ("name", "end"):  # of the description of the syntax
                continue
            assert group in keys(), f"{name}: there is no group &{group}"
            for key in KEY.findall(without_quotes(body)):
                assert key in keys()[group], f"{name}: &{group} has no key '{key}'"


@pytest.mark.parametrize("name", NAMES)
def test_paths_lead_to_keys(name):
    for piece in pieces(name, "fortran", "console", "sh", "text"):
        for group, key in PATH.findall(piece):
            assert key in keys().get(group, ()) or key == "key", f"{name}: no key has the path {group}%{key}"


def printed(program: str, *words: str) -> str:
    """What a command of the Python package prints."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        assert PYTHON[program](words) == 0
    return told.getvalue()


@functools.cache
def verbs_of(program: str) -> set[str]:
    if program == "nhbm":
        return set(re.findall(r"^(?:usage:|      ) nhbm (\w+)", run("help", cwd=ROOT).stdout, re.MULTILINE))
    told = printed(program, "help").partition("positional arguments:")[2]
    return set(re.findall(r"^    ([a-z][\w-]*)(?:  |$)", told, re.MULTILINE))


@functools.cache
def options_of(program: str, verb: str) -> set[str]:
    if program == "nhbm" and verb != "fit":
        told = run("help", verb, cwd=ROOT).stdout.split("options:", 1)[1]
    else:
        told = printed("nhbm-model" if verb == "fit" else program, "help", verb)
    return set(re.findall(r"(?<![\w-])(--?[a-zA-Z][\w-]*)", told)) | {"--help"}


def commands(name: str) -> Iterator[list[str]]:
    """The words of each command of the programs in a page."""
    for piece in pieces(name, "console", "sh", ""):
        for line in re.sub(r" *\\\n\s*", " ", piece).splitlines():
            try:
                words = shlex.split(line.removeprefix("$ "), comments=True)
            except ValueError:  # an apostrophe in what a command prints
                continue
            starts = [k for k, word in enumerate(words) if word in ("nhbm", *PYTHON) and words[k - 1 : k] != ["--name"]]
            for start, end in zip(starts, [*starts[1:], len(words)]):
                mine = words[start:end]
                stop = [k for k, word in enumerate(mine) if re.match(r"[|;&>#)]|\d?>", word)]
                yield [word.rstrip(";") for word in mine[: min(stop, default=len(mine))]]


@pytest.mark.parametrize("name", NAMES)
def test_commands_have_their_verbs_and_options(name):
    for words in commands(name):
        program, *rest = words
        verb = rest[0].strip(",") if rest else "..."
        if verb.startswith(("-", "...")) or verb.isupper() or words[1:] in NO_COMMAND:
            continue
        assert verb in verbs_of(program), f"{name}: {' '.join(words)}: no such verb"
        for option in (word.partition("=")[0] for word in rest[1:] if re.match(r"--?[a-zA-Z]", word)):
            assert option in options_of(program, verb), f"{name}: {' '.join(words)}: no option {option}"


def inputs(name: str) -> Iterator[str]:
    """The blocks of input of a page, each completed to a model; groups that exclude each other make several."""
    for block in blocks(name, "fortran"):
        found = [(group, f"&{group}{body}/") for group, body in GROUP.findall(COMMENT.sub("", block)) if group != "name"]
        names = [group for group, _ in found]
        is_choice = any(names.count(group) > 1 for group in ONCE) or any("begin = " in text for _, text in found)
        for mine in [[one] for one in found] if is_choice else [found] * bool(found):
            rest = dict(MODEL) if "structure" not in names else {}
            if "unknown" in mine[0][1]:
                del rest["load"]
            elif "begin = " in mine[0][1] and "tuple" not in mine[0][1]:
                rest = {"structure": MODEL["structure"], "integration": "&integration duration = 60.0, step = 0.01 /"}
            rest = {group: text for group, text in rest.items() if group not in dict(mine)}
            yield "\n".join([*rest.values(), *(text for _, text in mine)])


INPUTS = [(name, k) for name in NAMES if name.startswith("docs/user/") for k, _ in enumerate(inputs(name))]


@pytest.mark.parametrize(("name", "k"), INPUTS)
def test_inputs_are_valid(name, k, tmp_path):
    text = list(inputs(name))[k]
    if "'small.h5'" in text or "'bolt'" in text:
        pytest.skip("of a model file that the page creates")
    (tmp_path / "case.nml").write_text(text + "\n")
    done = run("check", "case.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, text + done.stderr


SOLVED = sorted(
    (name, shlex.join(words[2:]))
    for name in NAMES
    for words in commands(name)
    if words[:2] in (["nhbm", "solve"], ["nhbm", "check"], ["nhbm", "integrate"])
    if re.match(r"inputs/[a-z_0-9]+/[a-z_0-9]+\.nml", "".join(words[2:3])) and "models/" not in words[2]
)


@pytest.mark.parametrize(("name", "words"), dict.fromkeys(SOLVED))
def test_commands_have_their_inputs(name, words):
    source, *rest = shlex.split(words)
    given = [word for k, word in enumerate(rest) if word.startswith("--set") or rest[k - 1 : k] == ["--set"]]
    done = run("plan", ROOT / source.rstrip(":"), *(word.replace("$load", "0.1") for word in given), cwd=ROOT)
    assert done.status == ALL_CONVERGED or "cannot load the library" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("program", "name"),
    [("nhbm", "docs/user/running.md"), ("nhbm-post", "postproc/README.md"), ("nhbm-model", "docs/user/model.md")],
)
def test_pages_name_all_verbs(program, name):
    named = set(re.findall(r"[a-z][\w-]+", "\n".join(line[:60] for piece in pieces(name, "") for line in piece.splitlines())))
    assert verbs_of(program) - {"man"} <= named


OWNERS = {"nhbm": nhbm, "model": nhbm.Model, "Model": nhbm.Model}
OWNERS |= {f"{name}.nhbm": Accessor for name in ("motion", "dataset", "grid")}


@pytest.mark.parametrize("name", NAMES)
def test_python_names_exist(name):
    code = "\n".join([*pieces(name, "python"), *blocks(name, "code-cell")])
    for owner, attribute in re.findall(rf"(?<![\w./-])({'|'.join(map(re.escape, OWNERS))})\.([a-z_]\w*)", code, re.IGNORECASE):
        if owner in OWNERS and attribute not in FILES:
            is_module = owner == "nhbm" and importlib.util.find_spec(f"nhbm.{attribute}")
            assert is_module or hasattr(OWNERS[owner], attribute), f"{name}: {owner} has no {attribute}"


def test_the_page_of_results_runs(tmp_path, monkeypatch):
    """The lines of docs/user/schema.md on a file as they name it."""
    text = blocks("docs/user/input.md", "fortran")[0]
    swept = "&sweep parameter = 'law(wall)%gap', values = 1e-3, 2e-3 /\n&sweep parameter = 'load(2)%cos', values = 120.0, 140.0 /\n"
    (tmp_path / "sweep.nml").write_text(text.split("&sweep")[0] + swept)
    done = run("solve", "sweep.nml", "--set", "harmonics%order=3", "--set", "solver%fallback=.false.", cwd=tmp_path)
    assert (tmp_path / "sweep.h5").exists(), done.stderr
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks("docs/user/schema.md", "python"):
        exec(block, names)
    assert names["c"].size == 1 and names["near"].sizes["point"] == 2 and names["second"].sizes["point"] == 4
