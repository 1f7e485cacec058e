"""Where the stability of a motion is not known, the file, the command and Python say why."""

import h5py
import nhbm
import pytest
from program import run, solve

CHAIN = """
&structure type = 'chain', n_masses = {n}, mass = 1.0, coupling_stiffness = 1.0, damping_mass = {damping} /
&tones frequency = {frequency} /
&load dof = 'x1', tuple = {tuple}, cos = {load} /
"""
BEAM_AT_A_WALL = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4, damping_diagonal = 1.0 /
&tones frequency = 2.7 /
&harmonics order = 20 /
&load dof = 'v3', tuple = 1, cos = 100.0 /
&law type = 'rigid_wall', dof = 'v3', gap = 0.5e-3 /
"""
CUBIC = "&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /\n"


def text(n=1, damping=0.1, frequency=1.1, of=1, load=0.3, rest=""):
    return CHAIN.format(n=n, damping=damping, frequency=frequency, tuple=of, load=load) + rest


MODELS = {
    "none": text(rest=CUBIC),
    "too_costly": BEAM_AT_A_WALL,
    "too_large": text(n=3000, rest=CUBIC),
    "no_equations": text(frequency="1.1, 1.9371", of="1, 0", rest=CUBIC +
                         "&feedback sensors = 'x1', actuators = 'x1', d = 0.1, delay = 0.2 /\n"),
    "at_limit": text(damping=0.0, frequency=2.3),
    "status": text(rest=CUBIC + "&harmonics order = 3 /\n&error_estimate truncation = 1e-12 /\n"),
}


def reasons(path):
    with h5py.File(path) as file:
        column = file["stability_reason"]
        words = column.attrs["flag_meanings"]
        words = (words.decode() if isinstance(words, bytes) else words).split()
        return [words[number] for number in column[...]], file["is_stable"][...].tolist()


@pytest.mark.parametrize("reason", MODELS)
def test_the_file_has_the_reason(reason, tmp_path):
    path = solve(MODELS[reason], tmp_path, status=None)
    found, is_stable = reasons(path)
    assert found == [reason]
    assert (is_stable == [0]) == (reason != "none")


@pytest.mark.parametrize("reason", ["too_costly", "too_large", "no_equations", "at_limit"])
def test_the_command_says_it_with_what_to_do(reason, tmp_path):
    (tmp_path / "model.nml").write_text(MODELS[reason])
    of_run = run("solve", "model.nml", cwd=tmp_path).stdout
    of_point = run("why", "model.h5", "--point", "0", cwd=tmp_path).stdout
    said = next(line for line in of_run.splitlines() if line.startswith("the stability of 1 point"))
    assert said.split(";")[1].strip()
    assert said in " ".join(of_point.split())


def test_a_request_takes_what_is_costly(tmp_path):
    path = solve(MODELS["too_costly"] + "&stability method = 'integration' /\n", tmp_path, status=None)
    assert reasons(path) == (["none"], [1])


def test_bifurcations_of_a_curve_have_a_reason_of_their_own(tmp_path):
    curve = "&harmonics order = 3 /\n&curve parameter = 'tones%frequency', from = 0.8, to = 2.0 /\n"
    path = solve(text(rest=CUBIC + curve), tmp_path, status=None)
    found, is_stable = reasons(path)
    with h5py.File(path) as file:
        is_fold = file["curve_kind"][...] == 3
    assert is_fold.sum() == 2
    assert {word for word, fold in zip(found, is_fold) if fold} == {"at_bifurcation"}
    assert all(word in ("none", "at_bifurcation") for word, value in zip(found, is_stable) if value or word == "at_bifurcation")


def test_python_has_the_word(tmp_path):
    (tmp_path / "model.nml").write_text(MODELS["at_limit"])
    motion = nhbm.Model.from_file(tmp_path / "model.nml").solve()
    assert str(motion["stability_reason"].values) == "at_limit"
