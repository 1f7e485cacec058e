"""An error in an input is reported once, with a helpful message, with exit status 2 and without changing a result."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

import pytest

from program import ALL_CONVERGED, BAD_INPUT, run, solve

GOOD = """&structure
   type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 1.0, 1.4 /
&harmonics order = 2 /
&load dof = 'x1', tuple = 1, 0, cos = 0.1 /
&load dof = 'x2', tuple = 0, 1, cos = 0.1 /
&law type = 'elastic_stop', label = 'stop', dof = 'x2', gap = 0.5, stiffness = 1.0 /
"""
LAST_LINE = GOOD.count("\n")
TRACES = ("Backtrace", "Traceback", "Fortran runtime error", "SIGSEGV", "At line", "MPI_ABORT", "HDF5-DIAG", "Error stop")


@dataclass(frozen=True)
class Bad:
    """An invalid input or command line, and the required contents of its message."""

    name: str
    says: tuple[str, ...]
    text: str | bytes = GOOD
    options: tuple[str, ...] = ()
    n_lines: int = 1

    def write(self, folder):
        path = folder / "bad.nml"
        path.write_bytes(self.text if isinstance(self.text, bytes) else self.text.encode())
        return path


def changed(old, new):
    assert old in GOOD, old
    return GOOD.replace(old, new, 1)


def line(number):
    return f"bad.nml:{number}: "


def wall(label):
    return f"&law type = 'rigid_wall', label = '{label}', dof = 'x1', gap = 0.5 /\n"


def sweep(keys):
    return GOOD + f"&sweep {keys} /\n"


AFTER = LAST_LINE + 1  # line of the appended text

CASES = [
    # groups and keys
    Bad("label twice", (line(AFTER + 1), "&law(", "'one' is the label of &law(", "labels name one each"),
        GOOD + 2 * "&law type = 'cubic_spring', label = 'one', dof = 'x1', stiffness = 1.0 /\n"),
    Bad("label empty", (line(7), "&law", "label: is empty", "law(name)%gap"), changed("'stop'", "''")),
    Bad("label that is a number", (line(7), "&law", "'1' is a number", "a name has a letter"), changed("'stop'", "'1'")),
    Bad("label of no path", (line(7), "&law", "'a(1)'", "leave out '(', ')' and '%'"), changed("'stop'", "'a(1)'")),
    Bad("prose between groups", (line(AFTER), "'The' outside of a group", "comment with '!'"), GOOD + "The solver follows.\n"),
    Bad("group without its mark", (line(AFTER), "'solver' outside of a group", "with '&'"), GOOD + "solver time_limit = 1 /\n"),
    Bad("tolerance in percent", (line(AFTER), "tolerance = 10", "must be 1.0 or less"), GOOD + "&accuracy tolerance = 10 /\n"),
    Bad("unknown group", (line(AFTER), "'&solvr'", "did you mean '&solver'?"), GOOD + "&solvr /\n", n_lines=2),
    Bad("missing group", ("bad.nml: ", "missing group &tones"), changed("&tones frequency = 1.0, 1.4 /\n", "")),
    Bad("group twice", (line(AFTER), "&tones"), GOOD + "&tones frequency = 1.0, 1.4 /\n"),
    Bad("group without end", (line(LAST_LINE), "&law", "never ends", "'/'"), GOOD.rstrip()[:-1]),
    Bad(
        "unknown key",
        (line(7), "&law", "unknown key 'two_side'", "did you mean 'two_sided'?"),
        changed("gap = 0.5", "gap = 0.5, two_side = .true."),
    ),
    Bad("misspelt key", (line(7), "missing key 'gap'", "did you mean 'gap'?"), changed("gap =", "gapp ="), n_lines=2),
    Bad("key twice", (line(7), "&law", "'gap'", "again"), changed("gap = 0.5", "gap = 0.5, gap = 0.6")),
    Bad("missing key", (line(7), "&law", "missing key 'gap'", "real number"), changed("gap = 0.5, ", "")),
    Bad("missing value", (line(7), "&law", "'gap'", "empty value"), changed("gap = 0.5,", "gap = ,")),
    # values
    Bad("text for number", (line(7), "&law", "gap = 'wide'", "real number"), changed("gap = 0.5", "gap = 'wide'")),
    Bad("real for integer", (line(4), "&harmonics", "order(1) = 2.5", "integer"), changed("= 2 /", "= 2.5 /")),
    Bad("no quotes", (line(7), "&law", "dof = x2", "quotes: 'x2'"), changed("dof = 'x2', gap", "dof = x2, gap")),
    Bad("number for logical", (line(7), "two_sided = 1"), changed("gap = 0.5", "gap = 0.5, two_sided = 1")),
    Bad("negative mass", (line(2), "&structure", "mass(1) = -1.0", "0.0 or greater"), changed("= 1.0, coup", "= -1.0, coup")),
    Bad("gap NaN", (line(7), "&law", "gap = NaN", "finite"), changed("gap = 0.5", "gap = NaN")),
    Bad("gap infinite", (line(7), "&law", "gap = -Inf", "finite"), changed("gap = 0.5", "gap = -Inf")),
    Bad("gap too large for a number", (line(7), "&law", "gap = 1e999"), changed("gap = 0.5", "gap = 1e999")),
    Bad("frequency NaN", (line(3), "&tones", "frequency(1) = NaN", "finite"), changed("1.0, 1.4", "NaN, 1.4")),
    Bad("frequency infinite", (line(3), "&tones", "frequency(2) = inf", "finite"), changed("1.0, 1.4", "1.0, inf")),
    Bad("frequency zero", (line(3), "&tones", "frequency(1) = 0.0", "above 0.0"), changed("1.0, 1.4", "0.0, 1.4")),
    Bad(
        "both frequency and hertz",
        (line(3), "&tones", "either 'frequency' [rad/s] or 'hertz'"),
        changed("1.0, 1.4", "1.0, 1.4, hertz = 1.0, 1.4"),
    ),
    # references between groups
    Bad("unknown structure", (line(2), "'chan'", "did you mean 'chain'?", "modal_beam"), changed("'chain'", "'chan'")),
    Bad("unknown law", (line(7), "'elastic_stp'", "did you mean 'elastic_stop'?", "rigid_wall"), changed("_stop'", "_stp'")),
    Bad("dof of law unknown", (line(7), "&law", "'x3'", "known: x1, x2"), changed("dof = 'x2', gap", "dof = 'x3', gap")),
    Bad("dof of load unknown", (line(5), "&load(1)", "'y1'", "known: x1, x2"), changed("dof = 'x1'", "dof = 'y1'")),
    Bad("tuple not in the set", (line(5), "&load(1)", "(3,0)", "order"), changed("tuple = 1, 0", "tuple = 3, 0")),
    Bad("tuple of another size", (line(5), "&load(1)", "tuple has 1 value, needs 2: there are 2 tones"),
        changed("tuple = 1, 0", "tuple = 1")),
    Bad("number with its unit", (line(7), "gap has 2 values, needs one; numbers have no unit: leave out 'mm'"),
        changed("gap = 0.5", "gap = 0.5 mm")),
    Bad("typographic quotes", (line(7), "type = ‘elastic_stop’ needs quotes: 'elastic_stop'"),
        changed("'elastic_stop'", "‘elastic_stop’")),
    Bad("override by the label of a law", ("a law is named by its label in brackets: law(stop)%gap",),
        options=("--set", "stop%gap=1.0")),
    Bad("weights missing", (line(7), "&law: dofs: needs 'weights', one for each", "'dof'"),
        changed("dof = 'x2', gap", "dofs = 'x1', 'x2', gap")),
    Bad(
        "too few weights",
        (line(7), "&law", "weights has 1 value, needs 2"),
        changed("dof = 'x2', gap", "dofs = 'x1', 'x2', weights = 1.0, gap"),
    ),
    Bad(
        "two rigid walls on one dof",
        (line(AFTER + 1), "'one'", "'two'", "both rigid", "two-sided"),
        GOOD + wall("one") + wall("two"),
    ),
    Bad(
        "rigid walls that share one dof",
        ("'one'", "'rel'", "both rigid"),
        GOOD + wall("one") + wall("rel").replace("dof = 'x1'", "dofs = 'x2', 'x1', weights = 1.0, -1.0"),
    ),
    # sizes
    Bad("too few samples", (line(AFTER), "&sampling", "4 samples", "at least 5"), GOOD + "&sampling samples = 4 /\n"),
    Bad("too many samples", (line(AFTER), "&sampling", "more than"), GOOD + "&sampling samples = 1000000 /\n"),
    Bad("order far too large", (line(4), "&harmonics", "lower the order"), changed("= 2 /", "= 1000000000 /")),
    Bad("order beyond integers", (line(4), "&harmonics", "order(1) = 3000000000"), changed("= 2 /", "= 3000000000 /")),
    # sweeps
    Bad("sweep of an unknown key", ("&law", "'gab'", "did you mean 'gap'?"), sweep("parameter = 'law(1)%gab', values = 1.0")),
    Bad(
        "sweep of an unknown group",
        (line(AFTER), "&sweep", "'&lw'", "did you mean '&law'?"),
        sweep("parameter = 'lw(1)%gap', values = 1.0"),
    ),
    Bad(
        "sweep of one value by two names",
        (line(AFTER + 1), "&sweep", "is swept twice, also as 'law(1)%gap'", line(AFTER)),
        sweep("parameter = 'law(1)%gap', values = 0.1") + "&sweep parameter = 'law(stop)%gap', values = 0.2 /\n",
    ),
    Bad(
        "sweep of a law that is not there",
        (line(AFTER), "&sweep", "no law(2)"),
        sweep("parameter = 'law(2)%gap', values = 1.0"),
    ),
    Bad(
        "sweep of an unknown label",
        (line(AFTER), "&sweep", "'stp'", "did you mean 'stop'?"),
        sweep("parameter = 'law(stp)%gap', values = 1.0"),
    ),
    Bad("sweep of a sweep", (line(AFTER), "&sweep"), sweep("parameter = 'sweep(1)%values', values = 1.0")),
    Bad("sweep of numbers over words", (line(AFTER), "&structure: type = 1", "takes a text", "'texts'"),
        sweep("parameter = 'structure%type', values = 1.0, 2.0")),
    Bad("sweep without values", (line(AFTER), "'values'", "'from'"), sweep("parameter = 'law(1)%gap'")),
    Bad(
        "sweep with values and a range",
        (line(AFTER), "'values'", "'from'"),
        sweep("parameter = 'law(1)%gap', values = 1.0, from = 1.0, to = 2.0, n = 2"),
    ),
    Bad(
        "logarithmic range through zero",
        (line(AFTER), "spacing", "same sign"),
        sweep("parameter = 'law(1)%gap', from = -1.0, to = 1.0, n = 3, spacing = 'log'"),
    ),
    Bad(
        "zipped values of unequal number",
        (line(AFTER + 1), "&sweep(2)", "axis", "1 here, 2 before"),
        sweep("parameter = 'law(1)%gap', values = 1.0, 2.0, axis = 1")
        + "&sweep parameter = 'law(1)%stiffness', values = 1.0, axis = 1 /\n",
    ),
    Bad(
        "order too large at a later point",
        ("point 2", "&harmonics", "lower the order"),
        sweep("parameter = 'harmonics%order', values = 2, 100000000"),
    ),
    Bad(
        "more points than numbers",
        ("more than 2000000000 points",),
        sweep("parameter = 'law(1)%gap', from = 0.1, to = 1.0, n = 100000")
        + "&sweep parameter = 'law(1)%stiffness', from = 0.1, to = 1.0, n = 100000 /\n",
    ),
    # files that are no input
    Bad("NUL byte", (line(AFTER), "NUL"), GOOD + "\0\n"),
    Bad("empty file", ("'bad.nml' is empty",), ""),
    Bad("blank file", ("bad.nml: ", "missing group &structure"), "\n"),
    Bad("binary file", ("bad.nml:",), bytes((7 * i * i + 3 * i + 89) % 256 for i in range(4000))),
    Bad("words", ("bad.nml:",), "this is no namelist\n"),
    # options
    Bad("unknown option", ("'--overwite'", "did you mean '--overwrite'?"), options=("--overwite",)),
    Bad("option without value", ("--set needs a value",), options=("--set",)),
    Bad("output without name", ("--output needs a value",), options=("--output", "")),
    Bad("set without value", ("path=value", "'law(1)%gap'"), options=("--set", "law(1)%gap")),
    Bad("set of no path", ("--set", "'gap = 1'", "law(2)%gap"), options=("--set", "gap=1")),
    Bad("set of an unknown key", ("&law", "'gab'", "did you mean 'gap'?"), options=("--set", "law(1)%gab=1")),
    Bad("set of an unknown group", ("--set", "'&lw'", "did you mean '&law'?"), options=("--set", "lw%gap=1")),
    Bad("set of a wrong value", ("&law", "gap = wide", "real number"), options=("--set", "law(1)%gap=wide")),
    Bad("set of a value and more", ("--set", "one key"), options=("--set", "law(1)%gap=1.0, stiffness=2.0")),
    Bad("set of a label that is not there", ("'stp'", "did you mean 'stop'?"), options=("--set", "law(stp)%gap=1.0")),
    Bad("two inputs", ("unexpected argument 'more.nml'",), options=("more.nml",)),
]


def only_message(done):
    """The message of a run that must have rejected its input."""
    assert done.status == BAD_INPUT, f"exit status {done.status}, {done.stderr}"
    assert len(done.messages) == 1, done.stderr
    for trace in TRACES:
        assert trace not in done.stderr
    message = done.messages[0].split("\n-----")[0].rstrip("\n")  # mpirun appends its own message
    assert message
    return message


def check(done, says, n_lines=1):
    message = only_message(done)
    for words in says:
        assert words in message
    assert message.count("\n") == n_lines - 1, f"more lines than problems: {message}"


@pytest.mark.parametrize("bad", CASES, ids=lambda bad: bad.name)
def test_bad_input_is_refused(bad, tmp_path):
    source = bad.write(tmp_path)
    old_result = tmp_path / "bad.h5"
    old_result.write_bytes(b"precious")
    done = run("solve", source.name, "--overwrite", *bad.options, cwd=tmp_path)
    check(done, bad.says, bad.n_lines)
    assert done.stderr.startswith("nhbm: ")
    assert done.stdout == ""
    assert old_result.read_bytes() == b"precious"
    assert sorted(tmp_path.iterdir()) == sorted([source, old_result]), "a refused input leaves no file"


@pytest.mark.parametrize(
    "bad",
    [bad for bad in CASES if bad.name in ("misspelt key", "unknown option")],
    ids=lambda bad: bad.name,
)
def test_ranks_speak_with_one_voice(bad, tmp_path):
    source = bad.write(tmp_path)
    check(run("solve", source.name, *bad.options, cwd=tmp_path, ranks=2), bad.says, bad.n_lines)
    assert sorted(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize("verb", ["solve", "check"])
def test_check_refuses_what_solve_refuses(verb, tmp_path):
    bad = Bad("negative mass", (line(2), "mass(1) = -1.0"), changed("= 1.0, coup", "= -1.0, coup"))
    bad.write(tmp_path)
    check(run(verb, "bad.nml", cwd=tmp_path), bad.says)


def test_check_names_the_point_that_is_wrong(tmp_path):
    text = sweep("parameter = 'law(stop)%stiffness', values = 1.0, -1.0")
    Bad("negative stiffness", (), text).write(tmp_path)
    check(run("check", "bad.nml", cwd=tmp_path), ("point 2", "law(stop)%stiffness", "0.0 or greater"))


def test_good_input_is_good(tmp_path):
    solve(GOOD, tmp_path)


# Files and folders


@pytest.mark.parametrize("ranks", [None, 2])
def test_missing_input_file(tmp_path, ranks):
    check(run("solve", "none.nml", cwd=tmp_path, ranks=ranks), ("'none.nml'", "does not exist"))


def test_input_is_a_folder(tmp_path):
    (tmp_path / "folder.nml").mkdir()
    check(run("solve", "folder.nml", cwd=tmp_path), ("'folder.nml'", "directory"))


def test_no_input_file(tmp_path):
    check(run("solve", cwd=tmp_path), ("solve needs an input file",))


def test_no_verb(tmp_path):
    check(run(cwd=tmp_path), ("nhbm --help",))


def test_unknown_verb(tmp_path):
    check(run("sovle", "bad.nml", cwd=tmp_path), ("'sovle'", "did you mean 'solve'?", "check"))


@pytest.mark.parametrize(
    "output, says",
    [
        ("nowhere/result.h5", "folder 'nowhere/' does not exist"),
        ("good.nml/result.h5", "folder 'good.nml/' does not exist"),
        ("folder", "is a folder"),
        ("folder/", "is a folder"),
    ],
)
def test_output_that_cannot_be(tmp_path, output, says):
    source = tmp_path / "good.nml"
    source.write_text(GOOD)
    folder = tmp_path / "folder"
    folder.mkdir()
    check(run("solve", source.name, "--output", output, "--overwrite", cwd=tmp_path), (output, says))
    assert source.read_text() == GOOD
    assert sorted(tmp_path.iterdir()) == sorted([folder, source]) and not list(folder.iterdir())


def test_output_folder_without_permission(tmp_path):
    (tmp_path / "good.nml").write_text(GOOD)
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o555)
    if os.access(folder, os.W_OK):
        pytest.skip("this user may write everywhere (root)")
    check(run("solve", "good.nml", "-o", "closed/result.h5", cwd=tmp_path), ("closed/result.h5", "permission"))


def test_output_on_a_file_system_that_takes_none(tmp_path):
    (tmp_path / "good.nml").write_text(GOOD)
    if not os.path.isdir("/proc/self"):
        pytest.skip("no /proc, where nobody can make a file")
    done = run("solve", "good.nml", "-o", "/proc/self/result.h5", cwd=tmp_path)
    check(done, ("/proc/self/result.h5", "cannot be made", "permission"))


@pytest.mark.parametrize("ranks", [None, 2])
def test_existing_result_is_kept(tmp_path, ranks):
    (tmp_path / "good.nml").write_text(GOOD)
    result = tmp_path / "good.h5"
    result.write_bytes(b"precious")
    check(run("solve", "good.nml", cwd=tmp_path, ranks=ranks), ("'good.h5'", "exists", "--overwrite"))
    assert result.read_bytes() == b"precious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["good.h5", "good.nml"]


def test_existing_result_is_replaced_on_demand(tmp_path):
    (tmp_path / "good.nml").write_text(GOOD)
    (tmp_path / "good.h5").write_bytes(b"precious")
    done = run("solve", "good.nml", "--overwrite", cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stderr
    assert (tmp_path / "good.h5").read_bytes()[:4] == b"\x89HDF"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["good.h5", "good.nml"]


# Words that are not errors


@pytest.mark.parametrize("words", [("--help",), ("-h",), ("help",), ("solve", "--help")])
def test_help_says_how(tmp_path, words):
    done = run(*words, cwd=tmp_path)
    assert done.status == ALL_CONVERGED and done.stderr == ""
    for word in ("usage: nhbm solve INPUT", "--overwrite", "--set PATH=VALUE", "exit status"):
        assert word in done.stdout


def test_version_begins_with_number_and_commit(tmp_path):
    done = run("version", cwd=tmp_path)
    assert done.status == ALL_CONVERGED
    assert re.fullmatch(r"nhbm \d+\.\d+\.\d+ \(\S+\)", done.stdout.splitlines()[0])


def test_quiet_says_nothing(tmp_path):
    (tmp_path / "good.nml").write_text(GOOD)
    done = run("solve", "good.nml", "--quiet", cwd=tmp_path)
    assert (done.status, done.stdout, done.stderr) == (ALL_CONVERGED, "", "")


# Warnings


@pytest.mark.parametrize(
    "tones, loads, told",
    [
        ("1.0, 2.0", "tuple = 1, 0", "(2,-1) has the frequency 0; use one tone of 1.0 rad/s"),
        ("1.0, 1.0", "tuple = 1, 0", "(1,-1) has the frequency 0; use one tone of 1.0 rad/s"),
        ("1.0, 1.4142", None, "no load acts"),
        ("1.0, 1.4142", "tuple = 1, 0", None),
    ],
)
def test_check_and_solve_name_doubts(tones, loads, told, tmp_path):
    """Warnings: the input is solved unchanged, exit status 0."""
    text = "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,\n"
    text += f"   ground_stiffness = 3.0, damping_mass = 0.1 /\n&tones frequency = {tones} /\n&harmonics order = 3 /\n"
    text += "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.01 /\n"
    text += f"&load dof = 'x1', {loads}, cos = 0.1 /\n" if loads else ""
    (tmp_path / "case.nml").write_text(text)
    checked = run("check", "case.nml", cwd=tmp_path)
    ending = "see the warnings above\n" if told else "the input is valid\n"
    assert checked.status == 0 and checked.stdout.endswith(ending), checked.stdout
    assert (told in checked.stdout) if told else ("warning" not in checked.stdout), checked.stdout
    if told and loads:
        solved = run("solve", "case.nml", cwd=tmp_path)
        assert solved.status == 0 and f"tones {tones.replace(', ', ' and ')} rad/s" in solved.stdout
        assert told in solved.stdout
