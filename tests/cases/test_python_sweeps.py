"""Sweeps in Python: the motions, the jumps and the messages of the command, in one process and in several."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from program import run

import nhbm
from nhbm import Model, ModelError

OSCILLATOR = """&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.05, stiffness = 1.0 /
&tones frequency = 0.9 /
&load dof = 'x1', tuple = 1, cos = 0.2 /
"""
DUFFING = OSCILLATOR + "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1, label = 'spring' /\n"
STOP = OSCILLATOR + "&law type = 'elastic_stop', dof = 'x1', gap = 0.7, stiffness = 3.0, label = 'stop' /\n"
WALL = OSCILLATOR + "&law type = 'rigid_wall', dof = 'x1', gap = 0.8, restitution = 0.7, label = 'wall' /\n"
FREQUENCY = "tones%frequency"
UP = np.linspace(0.8, 1.6, 17).tolist()
DOWN = UP[::-1]
# text of the input, values by path, further arguments, and what they are in an input
SWEEPS = {
    "up": (DUFFING, {FREQUENCY: UP}, {}, ""),
    "down": (DUFFING, {FREQUENCY: DOWN}, {}, ""),
    "order": (DUFFING, {FREQUENCY: UP}, {"order": 7}, "&harmonics order = 7 /\n"),
    "alone": (DUFFING, {FREQUENCY: UP}, {"warm": False}, "&solver first_guess = 'linear' /\n"),
    "given": (DUFFING, {FREQUENCY: UP[6:13]}, {"warm": True}, "&solver first_guess = 'neighbour' /\n"),
    "two values": (STOP, {"law(stop)%gap": [0.5, 0.9], FREQUENCY: UP}, {"order": 5}, "&harmonics order = 5 /\n"),
    "paired": (DUFFING, {FREQUENCY: UP, "law(spring)%stiffness": DOWN}, {"paired": True}, ""),
    "stop down": (STOP, {FREQUENCY: DOWN}, {}, ""),
    "restitution": (WALL, {FREQUENCY: UP[:10]}, {}, ""),
    "gap of a wall": (WALL, {FREQUENCY: [1.1], "law(wall)%gap": np.linspace(0.5, 1.5, 9).tolist()}, {}, ""),
    "chains": (DUFFING + "&solver chain_length = 5 /\n", {FREQUENCY: UP}, {}, ""),
    "words": (DUFFING, {"stability%method": ["off", "auto"]}, {"order": 3}, "&harmonics order = 3 /\n"),
}


def sweep_groups(values, is_paired):
    """The groups &sweep of an input."""
    text = ""
    for axis, (path, line) in enumerate(values.items(), start=1):
        key = "texts" if isinstance(line[0], str) else "values"
        text += f"&sweep axis = {1 if is_paired else axis}, parameter = '{path}', {key} = {', '.join(map(repr, line))} /\n"
    return text


def silent_sweep(model, values, **options):
    """A sweep, and the texts of its warnings of jumps."""
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        found = model.sweep(values, **options)
    return found, [str(one.message) for one in issued if one.category is nhbm.Jump]


def assert_same(found, stored):
    """Two results have the same motions, to the bit."""
    for name in ("status", "stability", "message"):
        texts = [text.replace("sweep.nml:1: ", "") for text in stored[name].values.tolist()]
        assert found[name].values.tolist() == texts, name
    np.testing.assert_array_equal(np.nan_to_num(found["coefficients"]), np.nan_to_num(stored["coefficients"]))
    for name in ("branch", "residual", "attempts"):
        np.testing.assert_array_equal(found.nhbm.details[name], stored.nhbm.details[name], err_msg=name)


LONG = ("alone", "two values", "restitution", "chains")  # others are alike


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in SWEEPS])
def test_sweeps_have_the_motions_of_the_command(name, tmp_path):
    text, values, options, keys = SWEEPS[name]
    (tmp_path / "sweep.nml").write_text(text + keys + sweep_groups(values, options.get("paired", False)))
    done = run("solve", "sweep.nml", cwd=tmp_path)
    stored = nhbm.open_dataset(tmp_path / "sweep.h5")
    found, jumps = silent_sweep(Model.from_namelist(text), values, **options)
    assert_same(found, stored)
    said = [line for line in done.stdout.splitlines() if "to another branch" in line]
    assert [line.split(" to another branch")[0] for line in said] == [text.split(" to another branch")[0] for text in jumps]
    assert sorted(found.nhbm.input.splitlines()) == sorted(stored.nhbm.input.splitlines())


@pytest.mark.parametrize("options", [pytest.param({"workers": 2}, marks=pytest.mark.long), {"threads": 2}])
def test_chains_have_the_same_motions_in_any_process(options):
    from concurrent.futures import ThreadPoolExecutor

    text, values = STOP, {"law(stop)%gap": [0.5, 0.9], FREQUENCY: UP}
    alone, jumps = silent_sweep(Model.from_namelist(text), values, order=5)
    assert jumps
    if "threads" in options:
        with ThreadPoolExecutor(2) as executor:
            spread, others = silent_sweep(Model.from_namelist(text), values, order=5, executor=executor)
    else:
        spread, others = silent_sweep(Model.from_namelist(text), values, order=5, **options)
    assert_same(spread, alone)
    assert others == jumps
    response = Model.from_namelist(text).sweep(values, order=5, of="x1 (1)")["response"]
    np.testing.assert_allclose(response, alone.nhbm.amplitude("x1", 1), rtol=1e-14)  # rounding of a sum of squares


def test_a_saved_sweep_is_resumed_by_the_command(tmp_path):
    found, _ = silent_sweep(Model.from_namelist(DUFFING), {FREQUENCY: UP}, order=5)
    found.nhbm.save(tmp_path / "sweep.h5")
    done = run("resume", "sweep.h5", cwd=tmp_path)
    assert "nothing is left to solve" in done.stdout
    assert_same(found, nhbm.open_dataset(tmp_path / "sweep.h5"))


def test_a_point_with_an_invalid_value_is_a_failed_one(tmp_path):
    """The points beside it are those of the command."""
    values = {"law(spring)%stiffness": [0.1], "structure%mass": [1.0, 1.1, -1.0, 1.3]}
    (tmp_path / "sweep.nml").write_text(DUFFING + "&harmonics order = 5 /\n" + sweep_groups(values, False))
    run("solve", "sweep.nml", "--quiet", cwd=tmp_path)
    stored = nhbm.open_dataset(tmp_path / "sweep.h5")
    found, _ = silent_sweep(Model.from_namelist(DUFFING), values, order=5)
    assert_same(found, stored)


def test_a_value_is_not_swept_and_given():
    with pytest.raises(ModelError, match="'harmonics%order' is swept, and given as an argument"):
        Model.from_namelist(DUFFING).sweep({"harmonics.order": [3, 5]}, order=7)


def test_a_sweep_in_a_session_ends_with_other_computations():
    """Its values are those of its points; the session then has its own again."""
    session = nhbm.Session()
    session.read(DUFFING + "&harmonics order = 5 /\n" + sweep_groups({FREQUENCY: UP}, False))
    session.solve()
    before = session.column("coefficients").values
    assert session.begin_sweep() == 1
    while session.next_of_sweep():
        last = session.column("frequency").values[0]
    assert last == UP[-1] and not session.next_of_sweep()
    session.set("tones%frequency", 1.0)
    assert session.column("frequency").values[0] == UP[-1]  # of the last motion still
    session.set("tones%frequency", 0.9)
    session.solve()
    np.testing.assert_array_equal(session.column("coefficients").values, before)
    with pytest.raises(ModelError, match="there is no sweep"):
        session.next_of_sweep()
