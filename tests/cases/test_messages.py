"""Messages for new users: why points have no motion, what to try, and where to read on."""

import contextlib
import os
import re
import shlex
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, coefficients_by_tuple, command, environment, run, solve

ROOT = Path(__file__).resolve().parents[2]
MASS = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0
   damping_mass = 0.1 /
&tones frequency = 0.2 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
"""
STOP = MASS + "&law type = 'elastic_stop', label = 'stop', dof = 'x1', stiffness = 1.0e4, gap = 0.1 /\n"
HARD_STOP = STOP.replace("1.0e4", "1.0e5").replace("0.1 /\n", "0.01 /\n")
FEW_STEPS = """
&harmonics order = 9 /
&solver max_iterations = 2, fallback = .false. /
&sweep parameter = 'tones%frequency', from = 3.0, to = 0.15, n = 20 /
"""


def write(folder, text, name="case.nml"):
    (folder / name).write_text(text)
    return name


def commands(text):
    """The suggested commands, without the remarks after them."""
    told = [line.partition("try: nhbm ")[2] for line in text.splitlines() if "try: nhbm " in line]
    return [line.partition("  (")[0].partition(";")[0] for line in told]


def test_each_failure_is_reported_once_with_a_command_that_works(tmp_path):
    done = run("solve", write(tmp_path, STOP + FEW_STEPS), cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED
    told = [line for line in done.stdout.splitlines() if line.startswith("  point ")]
    assert 1 <= len(told) <= 3 and "'stop' is 10000 times stiffer" in told[0] and "others" in told[0], done.stdout
    assert "13 out of budget: a work limit was reached before the tolerance (first: point 7)" in done.stdout
    assert "\nnhbm why case.h5 explains each of them\n" in done.stdout
    tried = commands(done.stdout)
    assert any("solver%fallback=.true." in words for words in tried), done.stdout
    for line in tried:
        words = shlex.split(line)
        assert run("check", *[w for w in words[1:] if not w.endswith(".h5") and w != "-o"], cwd=tmp_path).status == ALL_CONVERGED
    assert commands(run("info", "case.h5", cwd=tmp_path).stdout) == tried
    with h5py.File(tmp_path / "case.h5") as file:  # the command follows from the stored reason, not from the message
        names = file["reason"].attrs["flag_meanings"].split()
        said = [bytes(row).decode().rstrip("\0") for row in file["message"][:]]
        reasons = [names[reason] for reason in file["reason"][:]]
    assert [reason == "max_iterations" for reason in reasons] == ["raise solver%max_iterations" in text for text in said]
    assert "max_iterations" in reasons


def test_why_says_what_was_tried_and_what_to_do(tmp_path):
    softer = "&sweep parameter = 'law(stop)%stiffness', values = 0.01, 1e3, 1e5 /\n"
    name = write(tmp_path, STOP + FEW_STEPS.partition("&sweep")[0] + softer)
    assert run("solve", name, cwd=tmp_path).status == NOT_ALL_CONVERGED
    told = run("why", "case.h5", cwd=tmp_path).stdout
    info = run("info", "case.h5", cwd=tmp_path).stdout
    assert commands(told) == commands(info)  # the same table
    with h5py.File(tmp_path / "case.h5") as file:
        status = file["status"][:]
    lost = int(np.flatnonzero(status == 3)[-1])
    of_one = " ".join(run("why", "case.h5", "--point", str(lost), cwd=tmp_path).stdout.split())
    assert of_one.startswith(f"Point {lost} (law(stop)%stiffness = 100000 N/m): ") and "out of budget" in of_one
    assert "Attempts: " in of_one and re.search(r"direct out_of_budget at [0-9.]", of_one), of_one
    assert "What to do: Raise the work limit" in of_one and "try: nhbm solve case.nml" in of_one
    assert status[0] == 1 and "Nearest solved point: 0 (" in of_one
    found = run("why", "case.h5", "--point", "0", cwd=tmp_path).stdout
    assert "The estimated error is" in found
    refused = run("why", "case.h5", "--point", "20", cwd=tmp_path)
    assert refused.status == BAD_INPUT and "it has 0 to 2" in refused.stderr


def test_commands_name_files_that_look_like_options_by_their_folder(tmp_path):
    write(
        tmp_path,
        MASS.replace("damping_mass = 0.1", "damping_mass = 0.0").replace("0.2", "1.0") + "&harmonics order = 3 /\n",
        "-o.nml",
    )
    done = run("solve", "./-o.nml", cwd=tmp_path)
    proposed = [line for line in (done.stdout + done.stderr).splitlines() if "try: nhbm" in line or line.startswith("nhbm why")]
    assert proposed and all(" -o." not in line and "./-o.h5" in line for line in proposed), proposed
    assert run("why", "./-o.h5", cwd=tmp_path).status != BAD_INPUT


@pytest.mark.long
def test_friction_that_is_a_step_leads_to_other_laws(tmp_path):
    """More work does not help; a thousand times the speed of smoothing, or rigid friction, does."""
    law = "&law type = 'coulomb_tanh', label = 'pad', dof = 'x1', limit = 0.2, velocity = {} /\n"
    text = MASS.replace("= 0.2 /", "= 0.5 /") + law
    (tmp_path / "step.nml").write_text(text.format("1e-7"))
    done = run("solve", "step.nml", cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED, done.stdout
    for said in (done.stdout, run("why", "step.h5", cwd=tmp_path).stdout):
        assert "'pad' smooths friction over 1.0e-7 m/s, at speeds of" in " ".join(said.split())
        assert "max_fallback_work" not in said
    (tmp_path / "smooth.nml").write_text(text.format("1e-4"))
    assert run("solve", "smooth.nml", cwd=tmp_path).status == ALL_CONVERGED


def test_a_given_tolerance_is_not_loosened(tmp_path):
    """With an order and a tolerance the order is left out, not the tolerance."""
    text = STOP + "&harmonics order = 3 /\n&accuracy tolerance = 1e-4 /\n"
    done = run("solve", write(tmp_path, text.replace("1.0e4", "10.0")), cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED
    (tried,) = commands(done.stdout)
    assert "accuracy%tolerance=1.0e-4 --unset harmonics%order" in tried
    assert run(*shlex.split(tried), cwd=tmp_path).status == ALL_CONVERGED


def test_the_heading_has_no_tolerance_that_points_do_not_have(tmp_path):
    sweep = "&sweep parameter = 'accuracy%tolerance', values = 1e-2, 1e-4 /\n"
    done = run("solve", write(tmp_path, STOP.replace("1.0e4", "10.0") + sweep), cwd=tmp_path)
    assert "1 tone, harmonics for the tolerance of each point\n" in done.stdout


def test_why_alone_has_every_status(tmp_path):
    told = run("why", cwd=tmp_path).stdout
    names = re.search(r"outcome_names\(0:\d+\) = (.*?)\]\n", (ROOT / "src/solve/hb_outcome.f90").read_text(), re.S)[1]
    assert re.findall(r"^(\w+) ", told, re.M) == re.findall(r'"(\w+)"', names)
    page = (ROOT / "docs" / "user" / "convergence.md").read_text()
    assert f"$ nhbm why\n{told}```" in page  # no other copy of the table


def test_answers_of_time_integration_count_as_the_exit_status_says(tmp_path):
    """A balance of order 3 is not found, and the motion is that of time integration."""
    text = STOP.replace("0.2 /", "1.4 /").replace("1.0e4", "1.0e2") + "&harmonics order = 3 /\n"
    name = write(tmp_path, text)
    done = run("solve", name, cwd=tmp_path)
    assert done.status == ALL_CONVERGED, done.stdout + done.stderr
    assert "1 of 1 points found by time integration; results in case.h5" in done.stdout
    assert "not converged" not in done.stdout + done.stderr
    (verify,) = commands(done.stdout)
    assert verify == "verify case.h5 --points 0"
    assert "not converge" not in run("info", "case.h5", cwd=tmp_path).stdout


@pytest.mark.long
def test_motion_of_several_periods_leads_to_its_model(tmp_path):
    """The suggested command has the tuples of the load and the order for the new tone."""
    text = HARD_STOP.replace("0.2 /", "1.24 /") + "&harmonics order = 5 /\n&solver max_iterations = 3 /\n"
    done = run("solve", write(tmp_path, text), cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED and "1 not converged" in done.stderr, done.stdout + done.stderr
    (command,) = commands(done.stdout)
    words = shlex.split(command)
    n = int(re.search(r"repeats after (\d+) periods", done.stdout)[1])
    assert {f"tones%subharmonic={n}", f"load(1)%tuple={n}", f"harmonics%order={5 * n}"} <= set(words)
    with h5py.File(tmp_path / "case.h5") as file:
        assert file["n_periods"][:].tolist() == [n]
    assert run(*words, cwd=tmp_path).status in (ALL_CONVERGED, NOT_ALL_CONVERGED)
    assert words[-1] == f"case_subharmonic_{n}.h5"
    with h5py.File(tmp_path / words[-1]) as file:
        assert np.isfinite(file["coefficients"][()]).all()


def test_verify_says_what_came_of_it(tmp_path):
    text = MASS + "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n&harmonics order = 5 /\n"
    solve(text, tmp_path)
    said = run("verify", "case.h5", cwd=tmp_path).stdout.splitlines()
    assert re.fullmatch(r"point 0: agrees with time integration; deviation .* disturbances decay at .* 1/s; \d+ periods", said[0])
    assert said[-1] == "1 point verified: 1 agrees"
    solve(text.replace("&load", "!").replace("0.2 /", "0.2, unknown = .true. /"), tmp_path, status=None)
    done = run("verify", "case.h5", cwd=tmp_path)
    assert done.status == NOT_ALL_CONVERGED, "nothing was verified"
    said = done.stdout.splitlines()
    assert "it has no motion to start from: no motion: no self-excited" in said[0] and said[-1] == "0 points verified"


def test_info_counts_points_not_room(tmp_path):
    text = MASS + "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n&harmonics order = 3 /\n"
    solve(text + "&curve parameter = 'tones%frequency', from = 0.15, to = 0.5 /\n", tmp_path)
    with h5py.File(tmp_path / "case.h5") as file:
        n, room = int((file["status"][()] == 1).sum()), file["status"].size
    assert 0 < n < room
    said = run("info", "case.h5", cwd=tmp_path).stdout
    assert re.search(rf"^points     {n}$", said, re.MULTILINE) and "unused" not in said, said


def test_frequencies_are_printed_in_the_unit_of_the_input(tmp_path):
    spring = MASS.replace("0.2 /", "0.5, 1.5 /").replace("tuple = 1", "tuple = 1, 0")
    spring += "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n"
    said = run("check", write(tmp_path, spring.replace("frequency", "hertz")), cwd=tmp_path).stdout
    assert "\ntones       0.5 Hz, 1.5 Hz\n" in said
    assert "tones 0.5 and 1.5 Hz: " in said and "use one tone of 0.5 Hz instead" in said
    said = run("check", write(tmp_path, spring), cwd=tmp_path).stdout
    assert "\ntones       0.5 rad/s, 1.5 rad/s\n" in said and "use one tone of 0.5 rad/s instead" in said


def test_the_line_is_that_of_the_second_frequency(tmp_path):
    """The one that contradicts the first: of the curve, the sweep, the option, or of &tones."""
    model = MASS.replace("frequency = 0.2", "hertz = 0.2") + "&harmonics order = 3 /\n"
    n = model.count("\n") + 1
    curve = model + "&curve parameter = 'tones%frequency', from = 0.1, to = 0.5 /\n"
    said = run("check", write(tmp_path, curve), cwd=tmp_path).stderr
    assert f"nhbm: case.nml:{n}: &curve: &tones: frequency: give either" in said
    sweep = model + "&sweep parameter = 'tones%frequency', values = 0.1, 0.5 /\n"
    assert f"case.nml:{n}: &sweep: &tones: frequency: give" in run("check", write(tmp_path, sweep), cwd=tmp_path).stderr
    sweep = sweep.replace("hertz", "FREQUENCY").replace("tones%frequency", "tones%hertz")
    assert f"case.nml:{n}: &sweep: &tones: hertz: give" in run("check", write(tmp_path, sweep), cwd=tmp_path).stderr
    both = MASS.replace("frequency = 0.2", "hertz = 0.2\n   frequency = 0.3")
    assert "case.nml:5: &tones: frequency: give" in run("check", write(tmp_path, both), cwd=tmp_path).stderr
    said = run("check", write(tmp_path, model), "--set", "tones%frequency=1", cwd=tmp_path).stderr
    assert "case.nml (override): &tones: frequency: give" in said


def test_messages_name_what_is_in_the_file_and_in_the_command(tmp_path):
    said = run("solve", write(tmp_path, MASS.replace("&tones", "!")), cwd=tmp_path).stderr
    only = "without it a model can only be integrated in time"
    assert f"missing group &tones; the input has: structure, load; {only}" == said.strip().partition("case.nml: ")[2]
    assert "--resume" not in run("resume", "case.h5", "--overwrite", cwd=tmp_path).stderr


def test_check_prints_natural_frequencies(tmp_path):
    row = "&structure type = 'chain', n_masses = 12, ends = 'fixed', mass = 1.0, coupling_stiffness = 1.0 /\n"
    said = run("check", write(tmp_path, row + MASS.partition("\n&tones")[1] + MASS.partition("\n&tones")[2]), cwd=tmp_path).stdout
    numbers = re.search(r"^natural +(.*) rad/s +\(the 10 lowest\)\n +(.*) Hz$", said, re.MULTILINE)
    assert numbers, said
    exact = 2.0 * np.sin(np.arange(1, 11) * np.pi / 26)
    for text, values in zip(numbers.groups(), (exact, exact / (2 * np.pi))):
        assert [float(word) for word in text.split(",")] == pytest.approx(values, rel=1e-5)


def test_check_prints_small_numbers_as_such(tmp_path):
    said = run("check", write(tmp_path, MASS), cwd=tmp_path).stdout
    assert re.search(r"^ +0\.159155 Hz$", said, re.MULTILINE), said
    said = run("check", "case.nml", "--set", "structure%ground_stiffness=0.01", cwd=tmp_path).stdout
    assert re.search(r"^ +0\.0159155 Hz$", said, re.MULTILINE), said


def test_check_says_what_points_cost(tmp_path):
    """Of a sweep by points that are spread over it: a few may take most of the time."""
    text = MASS + "&law type = 'elastic_stop', dof = 'x1', gap = 0.1, stiffness = 20.0 /\n&accuracy tolerance = 1e-3 /\n"
    one = r"^cost +(\S+) s for the first point \((\w+), (\d+) harmonics\)$"
    found = re.search(one, run("check", write(tmp_path, text), cwd=tmp_path).stdout, re.MULTILINE)
    assert found and found[2] == "converged"
    solve(text, tmp_path)
    with h5py.File(tmp_path / "case.h5") as file:
        assert int(found[3]) == file["n_harmonics"][0]
    text += "&sweep parameter = 'tones%frequency', from = 0.2, to = 1.5, n = 50 /\n"
    many = r"^cost +(\S+) s a point, the mean of 8, which took (\S+) to (\S+) s; about (\S+) s for 50 points on one rank$"
    found = re.search(many, run("check", write(tmp_path, text), cwd=tmp_path).stdout, re.MULTILINE)
    mean, least, most, total = (float(number) for number in found.groups())
    assert least <= mean <= most and total == pytest.approx(50 * mean, rel=0.1)
    given = text.replace("&accuracy tolerance = 1e-3 /", "&harmonics order = 3 /")
    assert re.search(many, run("check", write(tmp_path, given), cwd=tmp_path).stdout, re.MULTILINE)
    assert "cost" not in run("check", write(tmp_path, MASS + "&harmonics order = 3 /\n"), cwd=tmp_path).stdout


def test_check_prints_damping_ratios(tmp_path):
    said = run("check", write(tmp_path, MASS), cwd=tmp_path).stdout  # m = k = 1: c/2
    assert re.search(r"^damping +(\S+) of critical$", said, re.MULTILINE)[1] == "5.00E-02"


TWO_TONES = """
&structure type = 'chain', n_masses = 4, ends = 'fixed-free', mass = 1.0, coupling_stiffness = 4.0, damping_mass = 0.05 /
&tones frequency = 1.0, 1.618 /
&accuracy tolerance = 1e-6 /
&load dof = 'x4', tuple = 1, 0, cos = 0.5 /
&load dof = 'x4', tuple = 0, 1, cos = 0.3 /
&law type = 'elastic_stop', label = 'stop', dof = 'x4', stiffness = 20.0, gap = 0.3 /
"""
IMPACTS = """
&structure type = 'chain', n_masses = 1, ends = 'fixed-free', mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.02 /
&tones frequency = 2.65, 1.17 /
&load dof = 'x1', tuple = 1, 0, cos = 1.0 /
&load dof = 'x1', tuple = 0, 1, cos = 0.5 /
&law type = 'rigid_wall', dof = 'x1', gap = 0.0 /
&integration restitution = 0.8 /
"""


@pytest.mark.parametrize(
    ("text", "within"),
    [(TWO_TONES, rb"level \d+: \d+ unknowns, estimated error \d\.\dE-\d\d"), (IMPACTS, rb"time integration")],
    ids=["levels", "in time"],
)
def test_a_long_point_shows_its_work_on_a_terminal(text, within, tmp_path):
    """Within a point: the level of adaptive refinement, its unknowns and the estimated error, or that it is integrated."""
    line = rb"0/1 points, [^\r]*; " + within
    reader, writer = os.openpty()
    words = command("solve", write(tmp_path, text))
    with subprocess.Popen(words, cwd=tmp_path, stderr=writer, stdout=subprocess.DEVNULL, env=environment()) as process:
        os.close(writer)
        shown = b""
        with contextlib.suppress(OSError):  # the terminal is gone when the program is
            while not re.search(line, shown) and (text := os.read(reader, 4096)):
                shown += text
        process.kill()
    os.close(reader)
    assert re.search(line, shown), shown


@pytest.mark.parametrize("is_by_tolerance", [False, pytest.param(True, marks=pytest.mark.long)], ids=["given", "tolerance"])
def test_recipe_reads_files(is_by_tolerance, tmp_path):
    """The code of docs/howto/xarray.md, with a file of the kind described there and with that of a minimal input."""
    pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    beam = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4, damping_diagonal = 1.0 /
&tones frequency = 100.0, 61.8 /
&load dof = 'v3', tuple = 1, 0, cos = 5.0 /
&load dof = 'v3', tuple = 0, 1, cos = 5.0 /
&law type = 'cubic_spring', dof = 'v3', stiffness = 1.0e10 /
&sweep parameter = 'load(1)%cos', values = 0.5, 5.0 /
"""
    result = solve(beam + ("" if is_by_tolerance else "&harmonics order = 3 /\n"), tmp_path, name="wall")
    code = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "howto" / "xarray.md").read_text(), re.DOTALL).group(1)
    found, here = {}, os.getcwd()
    os.chdir(tmp_path)
    try:
        exec(code, found)
    finally:
        os.chdir(here)
    assert ("tuples" in found["run"]) == is_by_tolerance
    cosine = found["c"].sel(component="cos").values
    assert cosine.shape == (2,) and abs(cosine[0]) < abs(cosine[1])
    if not is_by_tolerance:
        exact = [coefficients_by_tuple(result, point=i, dof=list(found["run"]["dof"].values).index("v3"))[1, 0][0] for i in (0, 1)]
        assert cosine.tolist() == exact
    found["run"].close()


CONTROLS = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e"


LESS_OFTEN = [pytest.param(verb, marks=pytest.mark.long) for verb in ("check", "verify", "plan")]


@pytest.mark.parametrize("verb", ["solve", "info", *LESS_OFTEN])
def test_control_characters_do_not_reach_the_terminal(verb, tmp_path):
    """In a title, in labels, in the name of the file and in options."""
    name = "ca\x1b[31mse.nml"
    text = STOP.replace("'stop'", f"'st{CONTROLS}op'") + f"&output title = 'a{CONTROLS}b' /\n&harmonics order = 3 /\n"
    (tmp_path / name).write_text(text)
    assert run("solve", name, "-o", "r.h5", cwd=tmp_path).status in (ALL_CONVERGED, NOT_ALL_CONVERGED, BAD_INPUT)
    if not (tmp_path / "r.h5").exists():  # refused in a title or a label: tried without
        (tmp_path / name).write_text(STOP + "&harmonics order = 3 /\n")
        run("solve", name, "-o", "r.h5", cwd=tmp_path)
    for words in ([verb, name], [verb, "r.h5"], [verb, name, "--set", f"law(1)%label='x{CONTROLS}'"], [verb, f"no{CONTROLS}.nml"],
                  [f"{verb}{CONTROLS}"], [verb, name, f"--opt{CONTROLS}"], [verb, name, "--log-level", "debug"]):  # fmt: skip
        done = run(*words, cwd=tmp_path)
        said = done.stdout + done.stderr
        bad = [c for c in said if c != "\n" and (ord(c) < 32 or 126 < ord(c) < 160 or c == "\u202e")]
        assert not bad, (words, said)
        assert "\ufffd" not in said, (words, said)


@pytest.mark.parametrize("key", ["frequency", "hertz"])
@pytest.mark.parametrize("group", ["&curve", "&sweep n = 5,"])
def test_what_moves_all_of_two_tones_is_asked_which(group, key, tmp_path):
    """It replaced both frequencies, and loads were reported to have too many tuples."""
    two = STOP.replace("frequency = 0.2 /", f"{key} = 0.2, 0.3 /").replace("tuple = 1,", "tuple = 1, 0,")
    done = run("solve", write(tmp_path, two + f"{group} parameter = 'tones%{key}', from = 0.1, to = 0.2 /\n"), cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "there are 2 tones; say which" in done.stderr and f"'tones%{key}(1)'" in done.stderr and "&load" not in done.stderr


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("1.0;2.0", "by commas or blanks, not by ';'"),
        ("[1.0]", "lists of numbers have no brackets"),
        ("\u22121.0", "its minus is another character than '-'"),
        ("2*3.14*0.15", "there are no products or powers; 3*0.5 repeats 0.5 three times"),
        ("10**-1", "there are no products or powers"),
        ("10^-3", "there are no products or powers"),
    ],
)
def test_signs_of_other_languages_are_named(value, says, tmp_path):
    """Brackets were taken for a decimal comma, another minus for a unit."""
    done = run("check", write(tmp_path, STOP.replace("gap = 0.1", f"gap = {value}")), cwd=tmp_path)
    assert done.status == BAD_INPUT and "&law: gap" in done.stderr and says in done.stderr, done.stderr
