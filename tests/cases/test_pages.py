"""The pages of the documentation: valid links, an index of all pages, commands that work."""

from __future__ import annotations

import contextlib
import fnmatch
import io
import os
import re
import runpy
import shlex
from pathlib import Path

import h5py
import pytest
from program import ALL_CONVERGED, NOT_ALL_CONVERGED, run
from user_law import with_its_law

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted({*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("postproc/*.md")} - {*ROOT.glob("docs/site/*")})
STATUSES = re.findall(
    r'"(\w+)"',
    re.search(r"outcome_names\(0:\d+\) = \[(.*?)\]", (ROOT / "src/solve/hb_outcome.f90").read_text(encoding="utf-8"), re.DOTALL)[1],
)
CONVERGENCE = (ROOT / "docs" / "user" / "convergence.md").read_text(encoding="utf-8")
MESSAGES = (ROOT / "docs" / "user" / "messages.md").read_text(encoding="utf-8")

MODEL = """&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0
   damping_mass = 0.1 /
&tones frequency = 1.2 /
&harmonics order = 7 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&sweep parameter = 'solver%max_iterations', values = 50, 0 /
"""


def without_code(page: Path) -> str:
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """Anchors of the headings in Markdown."""
    headings = re.findall(r"^#+ (.*)$", without_code(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page)):
        if target.startswith(("http:", "https:")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.relative_to(ROOT)}: there is no {target}"
        if anchor and file.suffix == ".md":
            assert anchor in anchors(file), f"{page.relative_to(ROOT)}: {target}: no such heading"


def test_tests_that_pages_name_exist():
    files = [path for folder in ("tests", "postproc/tests", "drivers/python/tests") for path in (ROOT / folder).rglob("*test_*")]
    known = {path.stem for path in files}
    for path in files:
        if path.suffix in (".py", ".pf"):
            known |= set(re.findall(r"\btest_\w+", path.read_text(encoding="utf-8")))
    for page in [*PAGES, *ROOT.glob("docs/**/*.md")]:
        named = {name for name in re.findall(r"\btest_\w+", page.read_text(encoding="utf-8")) if not name.endswith("_")}
        assert named <= known, f"{page.relative_to(ROOT)}: there is no {', '.join(sorted(named - known))}"


def test_every_picture_is_shown():
    pages = "".join(page.read_text(encoding="utf-8") for page in [*PAGES, *ROOT.glob("docs/**/*.md")])
    unused = [picture.name for picture in ROOT.glob("docs/pictures/*.png") if picture.name not in pages]
    assert not unused, f"no page shows {', '.join(unused)}"


def test_every_picture_has_an_origin():
    """A page that draws it, commands in docs/site/pictures.py, or a script of measurements."""
    script = runpy.run_path(str(ROOT / "docs" / "site" / "pictures.py"))
    drawn = {name for names in script["DRAWN"] for name in names}
    for page in script["PAGES"]:
        code = re.sub(r"!\[.*|<img.*", "", page.read_text(encoding="utf-8"))
        drawn |= {name for name in script["shown_on"](page) if f"{name}." in code}
    unknown = [picture.stem for picture in ROOT.glob("docs/pictures/*.png") if picture.stem not in drawn]
    assert [name for name in unknown if not name.startswith(script["MEASURED"])] == []


def test_index_lists_every_page():
    index = ROOT / "docs" / "README.md"
    listed = {(index.parent / name).resolve() for name in re.findall(r"\]\(([^)#]+)\)", index.read_text(encoding="utf-8"))}
    missing = [page.name for page in PAGES if page.parent.name in ("user", "why", "develop") and page not in listed]
    assert not missing, f"docs/README.md does not list {', '.join(missing)}"


def test_site_has_every_page():
    """Names and patterns of docs/site/index.md; the index for readers of the files is left out, and groups and laws, which follow
    from their pages (test_site.py)."""
    named = re.findall(
        r"^((?:docs|postproc)/\S+|[A-Z_]+)$", (ROOT / "docs" / "site" / "index.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    pages = [str(page.relative_to(ROOT).with_suffix("")) for page in PAGES
             if page != ROOT / "docs" / "README.md" and page.parent.name not in ("input", "laws")]  # fmt: skip
    missing = [page for page in pages if not any(fnmatch.fnmatch(page, name) for name in named)]
    assert not missing, f"docs/site/index.md does not have {', '.join(missing)}"


def test_license_is_given_where_it_is_looked_for():
    assert "GNU GENERAL PUBLIC LICENSE\n                       Version 3" in (ROOT / "LICENSE").read_text(encoding="utf-8")
    for name in ("README.md", "CITATION.cff", "CONTRIBUTING.md", "pyproject.toml"):
        assert "GPL-3.0-or-later" in (ROOT / name).read_text(encoding="utf-8"), name
    version = re.search(r"project\(nhbm VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")).group(1)
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_every_status_has_its_advice():
    assert "stalled" in STATUSES
    missing = [name for name in STATUSES if f"`{name}`" not in CONVERGENCE + MESSAGES]
    assert not missing, f"docs/user/convergence.md says nothing of {', '.join(missing)}"


EXAMPLES = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| `nhbm (solve [^`]*)`[^|]*\|", MESSAGES, re.MULTILINE)


def test_every_status_has_its_example():
    named = {name for names, _ in EXAMPLES for name in re.findall(r"\w+", names)}
    assert named == set(STATUSES)


@pytest.mark.long
@pytest.mark.parametrize(("names", "command"), EXAMPLES, ids=[re.sub(r"\W+", "_", names).strip("_") for names, _ in EXAMPLES])
def test_examples_have_the_status(names, command, tmp_path):
    verb, source, *options = shlex.split(command)
    done = run(verb, with_its_law(ROOT / source, tmp_path / "law"), *options, "-o", "run.h5", cwd=tmp_path)
    with h5py.File(tmp_path / "run.h5") as file:
        found = {STATUSES[status] for status in file["status"][:]}
    assert set(re.findall(r"\w+", names)) <= found, done.stdout + done.stderr


def test_settings_of_the_advice_are_accepted(tmp_path):
    (tmp_path / "case.nml").write_text(MODEL)
    advice = CONVERGENCE
    settings = re.findall(r"--set (\"[^\"]+\"|[^\s`]+)", advice)
    groups = re.findall(r"^ {7}(&.*/)$", advice, re.MULTILINE)
    assert len(settings) >= 3 and len(groups) >= 2
    done = run("check", "case.nml", *(f"--set={text.strip(chr(34))}" for text in settings), cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    (tmp_path / "chain.nml").write_text(MODEL.split("&sweep")[0] + "\n".join(groups) + "\n")
    done = run("check", "chain.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr


def test_messages_are_read_as_the_page_says(tmp_path):
    (tmp_path / "sweep.nml").write_text(MODEL)
    done = run("solve", "sweep.nml", "--set", "solver%fallback=.false.", cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED, done.stderr
    code = re.search(r"```python\n(.*?)```", CONVERGENCE, re.DOTALL).group(1)
    before, printed = os.getcwd(), io.StringIO()
    os.chdir(tmp_path)
    try:
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "convergence.md", "exec"), {})
    finally:
        os.chdir(before)
    assert re.fullmatch(r"1 3 .*\n", printed.getvalue()), printed.getvalue()


def statements_of_messages() -> list[list[str]]:
    """The texts of each statement of the source that gives a point its message."""
    also = {"hb_chain_check": r"|text = [^!\n]*", "hb_motion_curve": r"|text = [^!\n]*",
            "hb_curve_end": r"|text = [^!\n]*|returns_to_fold = [^!\n]*"}
    rows = (ROOT / "src" / "advice.txt").read_text(encoding="utf-8")  # those on failed searches and on what ended the work
    found = [[text] for text in re.findall(r"^(?:1?\d|9\d\d) \| \w+ \| (.*?) \|", rows, re.MULTILINE)]
    for folder in ("balance", "motion", "study", "timedomain"):
        for path in sorted((ROOT / "src" / folder).rglob("*.f90")):
            source = re.sub(r"&\s*\n\s*", " ", path.read_text(encoding="utf-8"))
            target = r"(?<!error%)\bmessage = [^!\n]*" + also.get(path.stem, "")
            for statement in re.findall(target, source):
                texts = [text for text in re.findall(r'"([^"]*)"', statement) if re.search(r"\w \w|\w[:;] |^; \w", text)]
                found += [texts] if texts else []
    return found


def test_every_message_of_a_point_is_explained():
    """Each statement has a row of the page by a part of its text, and each part comes from a statement."""
    table = MESSAGES.split("\n## ")[0]
    parts = [part for row in re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE) for part in re.findall("`([^`]*)`", row)]
    statements = statements_of_messages()
    assert len(statements) > 40 and len(parts) > 40
    assert not [texts for texts in statements if not any(part in text for part in parts for text in texts)]
    assert not [part for part in parts if not any(part in text for texts in statements for text in texts)]
