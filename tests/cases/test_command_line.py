"""The options of the command line, and the worked example of docs/user/input.md, which prints the output on the page."""

from __future__ import annotations

import math
import re
import shlex
import subprocess
from pathlib import Path

import nhbm.command
import nhbm_post.cli
import pytest
from program import ALL_CONVERGED, BAD_INPUT, command, environment, read, run

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "user" / "running.md"
INPUT_PAGE = PAGE.with_name("input.md")
STARTERS = ROOT / "drivers" / "starters"
VERBS = ("solve", "resume", "info", "check", "plan", "integrate", "verify")

OSCILLATOR = """&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&tones frequency = 1.5 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
"""
VAN_DER_POL = """&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.0, stiffness = 1.0 /
&tones unknown = .true. /
&harmonics order = 7 /
&law type = 'van_der_pol', dof = 'x1', strength = 0.5 /
"""


def test_version_is_an_option_too(tmp_path):
    assert run("--version", cwd=tmp_path) == run("version", cwd=tmp_path)
    told = run("version", cwd=tmp_path).stdout
    assert re.search(r"^built as \w+ by GNU Fortran \d+\.", told, re.M) and re.search(r"^with MPI \d.*, HDF5 \d+\.\d", told, re.M)
    assert run("solve", "--version", cwd=tmp_path).stdout.startswith("nhbm ")


def test_values_may_stand_behind_an_equals_sign(tmp_path):
    (tmp_path / "case.nml").write_text(OSCILLATOR)
    words = ("--set=tones%frequency=2.5", "--set", "law(1)%stiffness=0.2", "--output=other.h5", "--log-level=quiet")
    done = run("solve", "case.nml", *words, cwd=tmp_path)
    assert (done.status, done.stdout, done.stderr) == (ALL_CONVERGED, "", "")
    assert read(tmp_path / "other.h5", "frequency")[0, 0] == 2.5
    assert b"stiffness = 0.2" in bytes(read(tmp_path / "other.h5", "input_complete"))


def test_two_dashes_end_the_options(tmp_path):
    (tmp_path / "-case.nml").write_text(OSCILLATOR)
    assert run("check", "--quiet", "--", "-case.nml", cwd=tmp_path).status == ALL_CONVERGED
    assert run("--", "check", "-case.nml", cwd=tmp_path).status == ALL_CONVERGED
    done = run("check", "--", "-case.nml", "--quiet", cwd=tmp_path)
    assert done.status == BAD_INPUT and len(done.messages) == 1
    assert done.messages[0].strip() == "unexpected argument '--quiet'; the file is '-case.nml'"


@pytest.mark.parametrize(
    "words, says",
    [
        (("solve", "case.nml", "--overwrite=yes"), "--overwrite takes no value, there is 'yes'"),
        (("solve", "case.nml", "--output="), "--output needs a value"),
        (("solve", "case.nml", "--ouput=x.h5"), "unknown option '--ouput'; did you mean '--output'?"),
        (("solve", "case.nml", "--set", "law%gap="), "--set law%gap= has no value; --unset law%gap removes the key"),
        (("solve", "case.nml", "--unset", "law%gap=1"), "--unset takes a path without a value, not 'law%gap=1'"),
        (("solve", "case.nml", "-v"), "unknown option '-v'; known: --output, -o, --overwrite, --resume,"),
        (("keys", "law", "gap"), "unexpected argument 'gap'; several words need quotes: nhbm keys 'law gap'"),
        (("why", "case.h5", "--point", "1,2"), "--point needs a whole number, 0 or more, not '1,2'"),
        (("census", "case.nml", "--starts=2,3"), "--starts needs a whole number, 0 or more, not '2,3'"),
        (("verify", "case.h5", "--periods", "0"), "--periods needs a whole number, 2 or more, not '0'"),
        (("info", "case.h5", "--set", "a%b=1"), "info has no option --set; it has --check, --quiet"),
        (("verify", "case.h5", "--overwrite"), "verify has no option --overwrite; it has --time-limit, --workers"),
        (("verify", "case.h5", "--point", "0"), "verify has no option --point; did you mean --points? it has --time-limit"),
        (("integrate", "case.nml", "--points=1"), "integrate has no option --points; did you mean --point? it has --output"),
    ],
)
def test_what_an_option_is_not(tmp_path, words, says):
    done = run(*words, cwd=tmp_path)
    assert (done.status, done.stdout) == (BAD_INPUT, "")
    assert len(done.messages) == 1 and done.messages[0].startswith(says), done.stderr


@pytest.mark.parametrize("path, says", [("law", "is not a path to a key; "), ("laws%gap", "unknown group '&laws'; did you mean ")])
def test_what_cannot_be_removed_is_named(tmp_path, path, says):
    (tmp_path / "case.nml").write_text(OSCILLATOR)
    done = run("solve", "case.nml", "--unset", path, cwd=tmp_path)
    assert done.status == BAD_INPUT and done.messages[0].startswith(f"--unset: '{path}': {says}"), done.stderr


@pytest.mark.parametrize("verb", ["resume", "info", "why", "verify", "check", "plan", "integrate", "census"])
def test_a_file_of_the_other_kind_is_named(tmp_path, verb):
    """HDF5 and the reader of inputs said what they did not find in it."""
    is_reader = verb in ("resume", "info", "why", "verify")
    done = run(verb, "case.nml" if is_reader else "case.h5", cwd=tmp_path)
    says = "an input file, not 'case.h5'; nhbm info"
    if is_reader:
        says = "a result file, not the input 'case.nml': nhbm solve case.nml makes one, case.h5"
    assert done.status == BAD_INPUT and done.messages[0].startswith(f"{verb} needs {says}"), done.stderr


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_has_its_help(tmp_path, verb):
    done = run(verb, "--help", cwd=tmp_path)
    assert (done.status, done.stderr) == (ALL_CONVERGED, "")
    assert done == run("help", verb, cwd=tmp_path)
    assert done.stdout.startswith(f"usage: nhbm {verb} ")
    assert re.findall(r"nhbm (\w+) (?:INPUT|RESULT)", done.stdout.split("options:")[0]).count(verb) >= 1
    assert ("--cost-from" in done.stdout) == (verb == "plan")
    assert ("--set" in done.stdout) == (verb in ("solve", "resume", "check", "plan", "integrate"))
    assert max(map(len, done.stdout.splitlines())) <= 120


@pytest.mark.parametrize("verb", ["keys", "new", "completion", "version"])
def test_verbs_without_a_file_have_their_help_too(tmp_path, verb):
    """They printed the help of all verbs."""
    done = run(verb, "--help", cwd=tmp_path)
    assert (done.status, done.stderr) == (ALL_CONVERGED, "")
    assert done == run("help", verb, cwd=tmp_path)
    assert done.stdout.startswith(f"usage: nhbm {verb}") and done.stdout.count("nhbm ") < 6
    assert ("--json" in done.stdout) == (verb == "keys") and "exit status" not in done.stdout


def test_options_say_what_they_do_for_their_verb(tmp_path):
    """One text for several verbs told of 'resume' in the help of 'verify', and of 'verify' in none."""
    texts = {verb: run("help", verb, cwd=tmp_path).stdout for verb in (*VERBS, "census")}
    told = {verb: text.split("options:")[1].split("exit status")[0] for verb, text in texts.items()}
    assert "nhbm resume" in told["solve"] and not any("resume" in told[verb] for verb in ("check", "census", "verify"))
    assert "curve%points" in told["resume"] and "curve%points" not in told["solve"] + told["check"]


def test_there_is_no_help_for_a_verb_that_there_is_not(tmp_path):
    done = run("help", "resum", cwd=tmp_path)
    assert done.status == BAD_INPUT and "unknown verb 'resum'; did you mean 'resume'?" in done.stderr
    assert run("resum", "--help", cwd=tmp_path).stderr == done.stderr


@pytest.mark.parametrize("name, verb", [("case.nml", "solve"), ("case.h5", "info")])
def test_a_file_without_a_verb_is_said(tmp_path, name, verb):
    (tmp_path / name).touch()
    done = run(name, cwd=tmp_path)
    assert done.status == BAD_INPUT and f"missing verb before the file '{name}', for example nhbm {verb} {name}" in done.stderr


@pytest.mark.parametrize("name", ["out.csv", "out.nml", "out.h5", "out", "csv", "h.nc"])
def test_results_have_no_names_of_other_formats(tmp_path, name):
    (tmp_path / "case.nml").write_text(OSCILLATOR)
    done = run("solve", "case.nml", "-o", name, cwd=tmp_path)
    if name in ("out.csv", "out.nml"):
        assert done.status == BAD_INPUT and "give an --output that ends in .h5" in done.stderr
    assert (tmp_path / name).exists() == (done.status == ALL_CONVERGED) == (name not in ("out.csv", "out.nml"))


def test_the_page_knows_all_options(tmp_path):
    """The table of docs/user/running.md and the help name the same options."""
    section = PAGE.read_text(encoding="utf-8").split("## Command line")[1].split("\n## ")[0]
    options = set(re.findall(r"`(--[a-z-]+)", section.split("| exit status |")[0]))
    assert options == set(re.findall(r"(--[a-z-]+)", run("help", cwd=tmp_path).stdout.split("options:")[1]))


def test_frequencies_that_were_unknown_are_reported(tmp_path):
    (tmp_path / "case.nml").write_text(VAN_DER_POL + "&sweep parameter = 'law(1)%strength', values = 0.5, 1.0 /\n")
    done = run("solve", "case.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    low, high = sorted(read(tmp_path / "case.h5", "frequency")[:, 0])
    found = re.search(r"^unknown tone 1 from (\S+) to (\S+) rad/s$", done.stdout, re.MULTILINE)
    assert found, done.stdout
    assert [float(word) for word in found.groups()] == pytest.approx([low, high], rel=1e-7)
    assert f"unknown    tone 1 from {found.group(1)} to {found.group(2)} rad/s\n" in run("info", "case.h5", cwd=tmp_path).stdout
    done = run("solve", "case.nml", "-o", "one.h5", "--set", "sweep(1)%values=0.5", cwd=tmp_path)
    assert re.search(r"^unknown tone 1 at \d\.\d+ rad/s$", done.stdout, re.MULTILINE), done.stdout
    (tmp_path / "hertz.nml").write_text(VAN_DER_POL.replace("&tones", "&tones hertz = 0.16,"))
    told = re.search(r"^unknown tone 1 at (\S+) Hz$", run("solve", "hertz.nml", cwd=tmp_path).stdout, re.MULTILINE)
    assert told and float(told[1]) == pytest.approx(read(tmp_path / "hertz.h5", "frequency")[0, 0] / (2.0 * math.pi), rel=1e-7)
    assert f"unknown    tone 1 at {told[1]} Hz\n" in run("info", "hertz.h5", cwd=tmp_path).stdout


def test_worked_example_prints_what_the_page_shows(tmp_path):
    """`...` on the page represents anything, such as the memory of the machine, or the rounding errors of a check."""
    section = INPUT_PAGE.read_text(encoding="utf-8").split("## A worked example")[1].split("\n## ")[0]
    text = re.search(r"```fortran\n(.*?)```", section, re.DOTALL).group(1)
    console = re.search(r"```console\n(.*?)```", section, re.DOTALL).group(1)
    (tmp_path / "wall.nml").write_text(text)
    for block in console.removeprefix("$ ").split("\n$ "):
        command, _, shown = block.partition("\n")
        words = shlex.split(command)
        ranks = int(words[words.index("-n") + 1]) if words[0] == "mpirun" else None
        done = run(*words[words.index("nhbm") + 1 :], cwd=tmp_path, ranks=ranks)
        assert done.status == ALL_CONVERGED, done.stderr
        pattern = ".*?".join(re.escape(part) for part in shown.strip("\n").split("..."))
        assert re.fullmatch(pattern, done.stdout.strip("\n")), f"{command}\nprints\n{done.stdout}\nthe page shows\n{shown}"


def test_a_process_without_a_home_runs(tmp_path):
    """As services and schedulers start it; Open MPI 5 alone would end it."""
    (tmp_path / "case.nml").write_text(run("new", "duffing", cwd=tmp_path).stdout)
    bare = {name: value for name, value in environment().items() if name != "HOME"}
    done = subprocess.run(command("solve", "case.nml", "--quiet"), cwd=tmp_path, env=bare, capture_output=True, text=True)
    assert done.returncode == ALL_CONVERGED, done.stderr


def test_one_process_starts_no_mpi(tmp_path):
    """Its start takes longer than many a run; what mpirun starts needs it."""
    launcher = subprocess.run(["mpirun", "--version"], capture_output=True, text=True).stdout
    if not re.search(r"Open MPI\) 4\.", launcher):
        pytest.skip(f"no Open MPI 4: {launcher.partition(chr(10))[0]}")
    own = {**environment(), "OMPI_MCA_mpi_show_mca_params": "enviro"}  # MPI_Init prints them
    alone, launched = (
        subprocess.run(command("keys", ranks=ranks), cwd=tmp_path, env=own, capture_output=True, text=True, check=True).stderr
        for ranks in (None, 1)
    )
    assert alone == "" and "show_mca_params" in launched


def test_inputs_to_begin_with(tmp_path):
    """All except that of a model file are valid; that one requires its file."""
    listed = run("new", cwd=tmp_path).stdout.splitlines()
    assert all(re.fullmatch(r"\w+ +[A-Z].{20,}\.", line) for line in listed)
    names = [line.split()[0] for line in listed]
    assert names == sorted(path.stem for path in STARTERS.glob("*.nml"))
    for name in names:
        text = run("new", name, cwd=tmp_path).stdout
        assert text == (STARTERS / f"{name}.nml").read_text(encoding="utf-8")
        (tmp_path / f"{name}.nml").write_text(text)
        done = run("check", f"{name}.nml", cwd=tmp_path)
        if name == "model":
            assert done.status == BAD_INPUT and "part.h5" in done.stderr
        else:
            assert done.status == ALL_CONVERGED, done.stderr
    assert "did you mean 'rotor'" in run("new", "roter", cwd=tmp_path).stderr


@pytest.mark.parametrize(
    "name",
    [
        name if name == "stop" else pytest.param(name, marks=pytest.mark.long)
        for name in sorted(path.stem for path in STARTERS.glob("*.nml"))
        if name != "model"
    ],
)
def test_inputs_to_begin_with_are_solved_unchanged(tmp_path, name):
    (tmp_path / f"{name}.nml").write_text((STARTERS / f"{name}.nml").read_text(encoding="utf-8"))
    done = run("solve", f"{name}.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr


def test_the_input_of_a_model_file_is_solved_with_its_example(tmp_path, monkeypatch):
    pytest.importorskip("skfem")
    text = (STARTERS / "model.nml").read_text(encoding="utf-8")
    (words,) = re.findall(r"nhbm-model (beam .*part\.h5)", text)
    monkeypatch.chdir(tmp_path)
    assert PYTHON_COMMANDS["nhbm-model"](words.split()) == 0
    (tmp_path / "model.nml").write_text(text)
    done = run("solve", "model.nml", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stdout + done.stderr


def test_manual_page_has_every_verb_and_option_of_the_help(tmp_path):
    manual = run("help", "man", cwd=tmp_path).stdout
    told = run("help", cwd=tmp_path).stdout
    assert manual.startswith('.TH NHBM 1 "" "nhbm ')
    items = re.findall(r"^\.B (.*)", manual, re.M)[1:]
    verbs = re.findall(r"^(?:usage:|      ) nhbm (\w+)", told, re.M)
    options = re.findall(r"^  (?:-\w,|   ) (--[\w-]+)", told, re.M)
    assert [item.split()[0] for item in items[: len(verbs)]] == verbs
    assert [re.search(r"--[\w-]+", item.replace("\\", ""))[0] for item in items[len(verbs) :]] == options


def test_shells_complete_verbs_and_options(tmp_path):
    script = run("completion", "bash", cwd=tmp_path).stdout
    ask = '\nCOMP_WORDS=(nhbm {}); COMP_CWORD={}; _nhbm; echo "${{COMPREPLY[@]}}"'
    script += ask.format("re", 1) + ask.format("solve --time", 2) + ask.format("solve inp", 2) + ask.format("new du", 2)
    found = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True).stdout
    assert found == "resume\n--time-limit\n\nduffing\n"
    assert run("completion", "zsh", cwd=tmp_path).stdout.startswith("#compdef nhbm\n")
    assert "bash or zsh" in run("completion", "fish", cwd=tmp_path).stderr


@pytest.mark.parametrize("verb", ["import", "check", "plate", "ring", "reduce"])
def test_verbs_of_models_say_what_they_do(capsys, verb):
    """Only the list of all verbs did, which cut those of examples within a sentence."""
    with pytest.raises(SystemExit):
        nhbm.command.main([verb, "--help"])
    told = capsys.readouterr().out.split("\n\n")[1]
    assert told[0].isupper() and told.rstrip().endswith((".", ")."))


PYTHON_COMMANDS = {"nhbm-post": nhbm_post.cli.main, "nhbm-model": nhbm.command.main}
PAGES = {
    "man/man1/{}.1": ("help", "man"),
    "bash-completion/completions/{}": ("completion", "bash"),
    "zsh/site-functions/_{}": ("completion", "zsh"),
}


@pytest.mark.parametrize("name", PYTHON_COMMANDS)
@pytest.mark.parametrize("page", PAGES)
def test_installed_pages_are_those_that_the_command_prints(name, page, capsys):
    assert PYTHON_COMMANDS[name](PAGES[page]) == 0
    stored = ROOT / "drivers" / "python" / "share" / page.format(name)
    words = " ".join((name, *PAGES[page]))
    assert stored.read_text(encoding="utf-8") == capsys.readouterr().out, f"{words} > {stored.relative_to(ROOT)}"


@pytest.mark.parametrize("name", PYTHON_COMMANDS)
def test_manual_pages_of_the_python_commands_have_what_their_help_has(name, capsys):
    """Each verb with all its options, and none besides."""

    def printed(*words):
        PYTHON_COMMANDS[name](words)
        return capsys.readouterr().out

    sections = re.split(r"^\.SS ", printed("help", "man"), flags=re.M)[1:]
    verbs = [section.split()[0] for section in sections]
    assert verbs == re.findall(r"^    ([a-z][\w-]*)(?:  |$)", printed("help").partition("positional arguments:")[2], re.M)
    for verb, section in zip(verbs, sections):
        told = re.sub(r"\\(.)", r"\1", "\n".join(re.findall(r"^\.B (.*)", section, re.M)))
        entries = re.findall(r"^  (-.*?)(?:  |$)", printed("help", verb), re.M)
        options = {option for entry in entries for option in re.findall(r"(?:^| )(--?[\w-]+)", entry)}
        assert set(re.findall(r"(?:^| )(--?[\w-]+)", told, re.M)) == options - {"-h", "--help"}, verb


def test_shells_complete_the_python_commands():
    folder = ROOT / "drivers" / "python" / "share" / "bash-completion" / "completions"
    ask = '\nCOMP_WORDS=({}); COMP_CWORD={}; {}; echo "${{COMPREPLY[@]}}"'
    script = "".join((folder / name).read_text(encoding="utf-8") for name in PYTHON_COMMANDS)
    for words, function in (
        ("nhbm-post resp", "_nhbm_post"),
        ("nhbm-post orbit --wi", "_nhbm_post"),
        ("nhbm-post orbit --style p", "_nhbm_post"),
        ("nhbm-post orbit fil", "_nhbm_post"),
        ("nhbm-post completion z", "_nhbm_post"),
        ("nhbm-model reduce --method k", "_nhbm_model"),
        ("nhbm-model check --", "_nhbm_model"),
    ):
        script += ask.format(words, len(words.split()) - 1, function)
    found = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True).stdout
    assert found == "response\n--with --width\npaper\n\nzsh\nkrylov\n--help\n"
