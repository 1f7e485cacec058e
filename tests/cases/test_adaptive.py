"""Points that choose their harmonics and samples for a tolerance: the same on any number of ranks, killed and resumed, read
and refused."""

from __future__ import annotations

import math
import re
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
from nhbm_post.reader import Results
from nhbm_post.report import info

from program import ALL_CONVERGED, BAD_INPUT, NOT_ALL_CONVERGED, command, environment, run

MODEL = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, ground_stiffness = 1.0, coupling_stiffness = 0.0,
   damping_mass = 0.2 /
&tones frequency = 1.0, 1.618033988749895 /
&load dof = 'x1', tuple = 1, 0, cos = 0.4 /
&load dof = 'x1', tuple = 0, 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', gap = 0.6, stiffness = 5.0 /
"""
SWEEP = "&solver chain_length = 4 /\n&sweep parameter = 'law(1)%gap', from = 0.55, to = 0.8, n = 8 /\n"
MADE_BY_WHOM = ("rank", "solve_seconds", "setup_seconds", "iteration_seconds", "error_estimate_seconds")


def _solve(text, folder, *options, ranks=None, name="out.h5", limit=600.0):
    (folder / "model.nml").write_text(text)
    return run("solve", "model.nml", "-o", name, "--overwrite", *options, cwd=folder, ranks=ranks, limit=limit), folder / name


def _numbers(path):
    with h5py.File(path) as file:
        return {
            name: file[name][()].tobytes()
            for name in file
            if name not in MADE_BY_WHOM and not name.startswith("worker") and file[name].shape[:1] == file["status"].shape
        }


ONE_TONE = """
&structure type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 1.2 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 1.0, gap = 0.1 /
"""


def test_models_without_laws_are_complete(tmp_path):
    """Their first level is the last: it has the verdict on stability that a given order has."""
    for more in ("", "&harmonics order = 3 /\n"):
        done, _ = _solve(MODEL.replace("&law", "! &law") + more, tmp_path)
        assert done.status == ALL_CONVERGED and "1 stable, 0 unstable" in done.stdout, done.stdout + done.stderr


def test_outputs_of_a_motion_that_is_zero_are_exact(tmp_path):
    """Where nothing moves at the laws there is no error, and no next level."""
    more = "&accuracy of = 'x2 (1)' /\n&sweep parameter = 'load(1)%cos', from = 0.0, to = 1.0, n = 3 /\n"
    done, path = _solve(ONE_TONE + more, tmp_path)
    assert done.status == 0, done.stderr
    with h5py.File(path) as file:
        assert file["output_estimate"][0] == 0.0 and file["coefficients"][0, 1].max() == 0.0
    assert run("check", "model.nml", cwd=tmp_path).status == 0


def test_ranks_and_resume_change_no_bit(tmp_path):
    done, one = _solve(MODEL + SWEEP, tmp_path)
    assert done.status == 0, done.stderr
    _solve(MODEL + SWEEP, tmp_path, ranks=2, name="two.h5")
    assert _numbers(one) == _numbers(tmp_path / "two.h5")
    with h5py.File(tmp_path / "two.h5", "r+") as file:  # as after a kill
        file["status"][5:] = 0
    assert run("resume", "two.h5", cwd=tmp_path).status == 0
    assert _numbers(one) == _numbers(tmp_path / "two.h5")
    assert run("info", "--check", one, cwd=tmp_path).status == 0


def test_a_complete_file_has_places_for_what_its_points_use(tmp_path):
    wide = 4 * 2000  # max_harmonics, of integrated motions four times as many
    done, path = _solve(MODEL + SWEEP.replace("n = 8", "n = 16"), tmp_path, "--time-limit", "1e-9")
    with h5py.File(path) as file:
        assert file["coefficients"].shape == (16, 1, wide, 2)
    assert path.stat().st_blocks * 512 < path.stat().st_size / 2, "unused places take no space"
    assert run("resume", path, cwd=tmp_path).status == 0
    with h5py.File(path) as file:
        assert file["coefficients"].shape == (16, 1, file["n_harmonics"][()].max(), 2)
    made = path.read_bytes()
    assert run("resume", path, cwd=tmp_path).status == 0  # nothing is left
    assert path.read_bytes() == made
    assert run("info", "--check", path, cwd=tmp_path).status == 0


def test_the_room_of_many_points_is_removed_with_a_word_and_within_the_time(tmp_path):
    """A run that is killed meanwhile has all points; a resumed one whose time is over leaves them as they are."""
    text = "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /\n&tones frequency = 0.5 /\n"
    text += "&load dof = 'x1', tuple = 1, cos = 0.1 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /\n"
    text += "&accuracy tolerance = 0.1 /\n&stability method = 'off' /\n"
    (tmp_path / "many.nml").write_text(text + "&sweep parameter = 'load(1)%cos', from = 0.1, to = 0.2, n = 1001 /\n")
    with subprocess.Popen(command("solve", "many.nml"), cwd=tmp_path, env=environment(), stderr=subprocess.PIPE,
                          stdout=subprocess.DEVNULL, text=True) as process:  # fmt: skip
        assert any("compacting many.h5" in line and process.kill() is None for line in process.stderr)
    with h5py.File(tmp_path / "many.h5") as file:
        reserved, before = file["coefficients"].shape[2], file["coefficients"][:, :, :5]
    late = run("resume", "many.h5", "--time-limit", "1e-9", cwd=tmp_path)
    assert late.status == ALL_CONVERGED and "no time was left to compact it" in late.stderr, late
    with h5py.File(tmp_path / "many.h5") as file:
        assert file["coefficients"].shape[2] == reserved
    assert "compacting many.h5" in run("resume", "many.h5", cwd=tmp_path).stderr
    with h5py.File(tmp_path / "many.h5") as file:
        assert file["coefficients"].shape[2] < 0.1 * reserved
        np.testing.assert_array_equal(file["coefficients"][:, :, :5], before[:, :, : file["coefficients"].shape[2]])


def test_sets_differ_and_are_read(tmp_path):
    done, path = _solve(MODEL + SWEEP, tmp_path)
    assert done.status == 0, done.stderr
    with Results(path) as results:
        sizes = [results.series(point, "x1").n_harmonics for point in range(8)]
        assert results.per_point("n_harmonics").tolist() == sizes
        assert len(set(sizes)) > 1
    with h5py.File(path) as file:
        n = file["n_harmonics"][0]
        assert np.all(file["tuples"][0, n:] == 0) and np.all(file["coefficients"][0, :, n:] == 0), "sums over all places are right"


def test_one_percent_without_a_word(tmp_path):
    done, path = _solve(MODEL, tmp_path)
    assert done.status == 0, done.stderr
    with h5py.File(path) as file:
        assert np.hypot(file["truncation_estimate"][0], file["aliasing_estimate"][0]) < 1e-2


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("&accuracy tolerance = 1e-15 /", "tolerance = 1e-15 must be 1.0e-14 or greater"),
        ("&accuracy of = 'x2 (1,0)' /", "unknown degree of freedom 'x2'"),
        ("&accuracy of = 'x1 (1)' /", "'x1 (1,1)'"),
        ("&accuracy max_harmonics = 60 /", "must be 61 or more"),
        ("&accuracy of = 'x1' /\n&curve parameter = 'law(1)%gap', from = 0.5, to = 0.9 /", "leave it out with &curve"),
        ("&error_estimate improvement_steps = 3 /", "improvement_steps"),
    ],
)
def test_what_cannot_be_is_refused(group, words, tmp_path):
    done, _ = _solve(MODEL + group, tmp_path)
    assert done.status == BAD_INPUT and words in done.stderr


@pytest.mark.parametrize("n_tones", [1, 2, 3, 4])
def test_the_least_room_for_tuples_is_as_documented(n_tones, tmp_path):
    """docs/user/input/accuracy.md, `max_harmonics`: this number is accepted, one less is rejected."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "user" / "input" / "accuracy.md").read_text(encoding="utf-8")
    told = re.search(r"first box \((\d+), (\d+), (\d+) or (\d+) for one to four tones\)", page)
    least = int(told[n_tones])
    tuples = (",".join(str(int(i == m)) for i in range(n_tones)) for m in range(n_tones))
    loads = "".join(f"&load dof='x1', tuple={entries}, cos=0.4 /\n" for entries in tuples)
    tones = ", ".join(str(np.sqrt(p)) for p in (1, 2, 3, 5)[:n_tones])
    model = f"&structure type='matrices', n_dofs=1, mass=1, damping=0.2, stiffness=1 /\n&tones frequency={tones} /\n{loads}"
    for room, status in ((least, 0), (least - 1, BAD_INPUT)):
        (tmp_path / "model.nml").write_text(f"{model}&law type='cubic_spring', dof='x1', stiffness=0.01 /\n"
                                            f"&accuracy max_harmonics={room} /\n")
        assert run("check", "model.nml", cwd=tmp_path).status == status


def test_estimates_of_outputs_are_stored_and_shown(tmp_path):
    outputs = ["x1 (2,0)", "x1"]
    done, path = _solve(MODEL + f"&accuracy of = {', '.join(map(repr, outputs))} /", tmp_path)
    assert done.status == 0, done.stderr
    with Results(path) as results:
        estimates = dict(results.output_estimates())
        shown = info(results)
    assert list(estimates) == outputs and all(0 < found[0] < 1e-2 for found in estimates.values())
    assert all(f"output     {name}: estimated error" in shown for name in outputs)


def test_a_given_order_stays(tmp_path):
    done, path = _solve(MODEL + "&harmonics order = 3 /\n&accuracy tolerance = 1e-6 /", tmp_path)
    with h5py.File(path) as file:
        assert file["n_harmonics"][0] == 25 and file["status"][0] == 7


ODD_SWEEP = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.1 /
&tones frequency = 0.2 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /
&sweep parameter = 'tones%frequency', from = 3.0, to = 0.15, n = 40 /
"""


def _duffing_near(w, x):
    """Motion x'' + .1 x' + x + .5 x**3 = .3 cos w t of order (x.size - 1)/2, by Newton's method from [mean, cosines, sines]."""
    n = x.size // 2
    angle = 2.0 * np.pi / (8 * n) * np.outer(np.arange(8 * n), np.arange(1, n + 1))
    at = np.hstack([np.ones((8 * n, 1)), np.cos(angle), np.sin(angle)])
    back = np.linalg.pinv(at)
    k = np.arange(1, n + 1) * w
    linear = np.diag([1.0, *(1.0 - k**2), *(1.0 - k**2)])
    linear[1 : n + 1, n + 1 :], linear[n + 1 :, 1 : n + 1] = np.diag(0.1 * k), np.diag(-0.1 * k)
    load = np.zeros(x.size)
    load[1] = 0.3
    for _ in range(20):
        change = np.linalg.solve(
            linear + back @ ((1.5 * (at @ x) ** 2)[:, None] * at), linear @ x + back @ (0.5 * (at @ x) ** 3) - load
        )
        x = x - change
    assert np.linalg.norm(change) < 1e-10 * np.linalg.norm(x)
    return x


def test_points_of_a_sweep_are_within_the_tolerance(tmp_path):
    done, path = _solve(ODD_SWEEP, tmp_path)
    assert done.status == 0, done.stderr
    n = 20
    with h5py.File(path) as file:
        errors = []
        for i, w in enumerate(np.linspace(3.0, 0.15, 40)):
            found = np.zeros(2 * n + 1)
            for h in range(file["n_harmonics"][i]):
                j = file["tuples"][i, h, 0]
                found[[j, n + j] if j else [0]] = file["coefficients"][i, 0, h, : 2 if j else 1]
            errors.append(np.linalg.norm(_duffing_near(w, found) - found) / np.linalg.norm(found))
        assert max(errors) < 1e-2
        estimates = np.hypot(file["truncation_estimate"][()], file["aliasing_estimate"][()])
        assert np.all(np.array(errors) < 3.0 * estimates + 1e-5)


@pytest.mark.parametrize(("sweep", "jump_to"), [("from = 0.9, to = 2.6, n = 12", 4), ("from = 0.5, to = 2.2, n = 9", 4)])
def test_a_jump_is_found_whatever_the_sets_are(sweep, jump_to, tmp_path):
    text = ODD_SWEEP.replace("from = 3.0, to = 0.15, n = 40", sweep)
    for name, group in (("chosen.h5", ""), ("given.h5", "&harmonics order = 15 /\n")):
        done, path = _solve(text + group, tmp_path, name=name)
        with h5py.File(path) as file:
            branch = file["branch"][()]
        assert done.status == 0 and "1 jump to another branch" in done.stderr + done.stdout
        assert np.flatnonzero(np.diff(branch)).tolist() == [jump_to]


JUMPS = {
    "three masses and a polynomial spring": """
&structure type = 'chain', n_masses = 3, coupling_stiffness = 1.0, ground_stiffness = 0.5, damping_mass = 0.02, ends = 'free',
   mass = 1.0 /
&tones frequency = 0.3 /
&load dof = 'x3', tuple = 1, cos = 0.2 /
&law type = 'polynomial', dof = 'x1', stiffness = 0.0, 0.0365, 0.29 /
&sweep parameter = 'tones%frequency', from = 0.3, to = 2.2, n = 40 /
""",
    "two masses and a cubic spring": """
&structure type = 'chain', n_masses = 2, coupling_stiffness = 1.0, ground_stiffness = 1.0, damping_mass = 0.02, ends = 'free',
   mass = 1.0 /
&tones frequency = 0.3 /
&load dof = 'x2', tuple = 1, cos = 0.8 /
&law type = 'cubic_spring', dof = 'x2', stiffness = 0.664 /
&sweep parameter = 'tones%frequency', from = 0.3, to = 2.2, n = 40 /
""",
    "three masses and a stop": """
&structure type = 'chain', n_masses = 3, coupling_stiffness = 1.0, ground_stiffness = 0.5, damping_mass = 0.05, ends = 'fixed-free',
   mass = 1.0 /
&tones frequency = 0.3 /
&load dof = 'x2', tuple = 1, cos = 0.8 /
&law type = 'elastic_stop', dof = 'x3', stiffness = 4.67, gap = 0.283 /
&sweep parameter = 'tones%frequency', from = 0.3, to = 2.2, n = 40 /
""",
    "a mass between stops": """
&structure type = 'chain', n_masses = 1, coupling_stiffness = 1.0, ground_stiffness = 1.0, damping_mass = 0.02, ends = 'free',
   mass = 1.0 /
&tones frequency = 2.2 /
&load dof = 'x1', tuple = 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 1.29, gap = 0.419, two_sided = .true. /
&sweep parameter = 'tones%frequency', from = 2.2, to = 0.3, n = 40 /
""",
}


@pytest.mark.parametrize("model", JUMPS)
def test_jumps_are_those_of_order_40(model, tmp_path):
    """Of 25 random models of this kind 32 jumps are found with a tolerance and 34 at order 40; some sweeps differ."""
    found = []
    for name, group in (("chosen.h5", ""), ("given.h5", "&harmonics order = 40 /\n")):
        _, path = _solve(JUMPS[model] + group, tmp_path, name=name)
        with h5py.File(path) as file:
            found.append(np.flatnonzero(np.diff(file["branch"][()])).tolist())
    assert found[0] == found[1] and len(found[0]) >= 2


def _two_masses_at_a_stop(duration, record, step=5e-4):
    """Times and places of two masses of 1 kg between springs of 1 kN/m, damper 1 Ns/m each, stop of 10 kN/m at 5 mm of the second:
    by Runge and Kutta's method of fourth order from rest, the last of the record alone."""
    w1, w2 = 2.0 * np.pi * 4.7, 2.0 * np.pi * 8.1

    def rate(t, x1, x2, v1, v2):
        stop = 1.0e4 * max(x2 - 5.0e-3, 0.0)
        load = 10.0 * (math.cos(w1 * t) + math.cos(w2 * t))
        return v1, v2, load - v1 - 2000.0 * x1 + 1000.0 * x2, 1000.0 * x1 - v2 - 2000.0 * x2 - stop

    state, times, places = (0.0, 0.0, 0.0, 0.0), [], []
    for i in range(round(duration / step)):
        t = i * step
        if t >= duration - record:
            times.append(t)
            places.append(state[:2])
        a = rate(t, *state)
        b = rate(t + step / 2, *(s + step / 2 * k for s, k in zip(state, a, strict=True)))
        c = rate(t + step / 2, *(s + step / 2 * k for s, k in zip(state, b, strict=True)))
        d = rate(t + step, *(s + step * k for s, k in zip(state, c, strict=True)))
        state = tuple(s + step / 6 * (p + 2 * q + 2 * r + u) for s, p, q, r, u in zip(state, a, b, c, d, strict=True))
    return np.array(times), np.array(places)


@pytest.mark.long
def test_a_stop_between_two_modes_is_found_by_time_integration(tmp_path):
    model = """
&structure type = 'chain', n_masses = 2, ends = 'fixed', mass = 1.0, coupling_stiffness = 1000.0, damping_mass = 1.0 /
&tones hertz = 4.7, 8.1 /
&load dof = 'x1', tuple = 1, 0, cos = 10.0 /
&load dof = 'x1', tuple = 0, 1, cos = 10.0 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 1.0e4, gap = 5.0e-3 /
&accuracy tolerance = 1e-2 /
&solver max_fallback_work = 45.0 /
"""
    done, path = _solve(model, tmp_path)
    said = done.stdout + done.stderr
    assert "does not repeat" not in said and "repeats after" not in said
    with h5py.File(path) as file:
        n = file["n_harmonics"][0]
        phases = file["tuples"][0, :n] @ file["frequency"][0]
        cosines, sines = np.moveaxis(file["coefficients"][0, :, :n], -1, 0)
        estimate = file["truncation_estimate"][0]
    times, places = _two_masses_at_a_stop(60.0, 20.0)
    angles = np.outer(times, phases)
    error = np.linalg.norm(np.cos(angles) @ cosines.T + np.sin(angles) @ sines.T - places) / np.linalg.norm(places)
    assert error < 1e-2 and error < 3.0 * estimate


@pytest.mark.long
def test_what_shorter_steps_change_is_the_error_of_a_motion(tmp_path):
    """Sliders whose states are not periodic on any grid, since they hardly slip: the integrated motion is stored, with the effect
    of halving the steps as its error. It was discarded, and the point `failed`."""
    model = """
&structure type = 'matrices', n_dofs = 2, mass = 1.73646588456, 1.60713871564,
   damping = 0.0373382123727, 0.000995290776734, 0.000995290776734, 0.0277005059864,
   stiffness = 1.91282242288, 0.120743833625, 0.120743833625, 0.938519849265 /
&tones frequency = 1.08566030714, 1.35960020488 /
&accuracy tolerance = 1e-2 /
&load dof = 'x1', tuple = 1, 0, cos = 0.742785312186, sin = -0.264302495068 /
&load dof = 'x2', tuple = 0, 1, cos = -0.29806674424, sin = 0.0429676824647 /
&law type = 'jenkins_2d', dof = 'x1', second_dofs = 'x2', stiffness = 9.53755198532, limit = 0.882585812616 /
&solver primary_method = 'integration', max_fallback_work = 40.0 /
"""
    done, path = _solve(model, tmp_path, limit=900.0)  # 25 s of the processor
    assert "1 truncated" in done.stdout
    with h5py.File(path) as file:
        assert np.isfinite(file["coefficients"][0]).any()
        assert 1e-2 < file["truncation_estimate"][0] < 5e-2
    assert "1 agrees" in run("verify", path, cwd=tmp_path, limit=900.0).stdout


@pytest.mark.long
def test_a_stop_with_little_damping_is_known_to_1e_4(tmp_path):
    """Added tuples next to resonances are coupled strongly; estimates that miss the coupling never become small."""
    model = MODEL.replace("damping_mass = 0.2", "damping_mass = 0.02")
    model = model.replace("gap = 0.6, stiffness = 5.0", "gap = 0.5, stiffness = 10.0")
    done, path = _solve(model + "&accuracy tolerance = 1e-4 /\n&stability method = 'off' /\n", tmp_path)
    assert done.status == 0, done.stderr
    with h5py.File(path) as file:
        assert np.hypot(file["truncation_estimate"][0], file["aliasing_estimate"][0]) <= 1e-4


@pytest.mark.long
def test_tones_near_sixteen_to_five_are_within_the_tolerance(tmp_path):
    """16 w1 - 5 w2 is small: the combination (4, -2), nearly in resonance under light damping, has a neighbour (20, -7) with 9e-3
    of the motion."""
    model = """
&structure type = 'matrices', n_dofs = 1, mass = 1.9139, damping = 0.0131, stiffness = 1.7880 /
&tones frequency = 0.4119385967, 1.3217288668 /
&load dof = 'x1', tuple = 1, 0, cos = 0.9980 /
&load dof = 'x1', tuple = 0, 1, cos = 0.9661 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 4.3191, gap = 0.9888 /
"""
    motions, estimates = [], []
    for tolerance in (1e-2, 5e-4):
        _, path = _solve(model, tmp_path, "--set", f"accuracy%tolerance={tolerance}", name=f"{tolerance}.h5", limit=900.0)
        with h5py.File(path) as file:
            n = file["n_harmonics"][0]
            motions.append({tuple(j): c for j, c in zip(file["tuples"][0, :n], np.moveaxis(file["coefficients"][0], 0, 1))})
            estimates.append(file["truncation_estimate"][0])
    found, truth = motions
    parts = [found.get(j, 0.0) - truth.get(j, 0.0) for j in found.keys() | truth.keys()]
    error = np.linalg.norm(np.stack(parts)) / np.linalg.norm(np.stack(list(truth.values())))
    assert error < 1e-2 and error < 2.0 * estimates[0], (error, estimates[0])


@pytest.mark.parametrize("ratio", [80.0, 130.0])
def test_disturbances_that_grow_beside_a_slow_tone_hide_the_verdict(ratio, tmp_path):
    """The slow tone passes phases in which the fast motion is unstable: integration in time leaves the torus of the balance by .17
    of it, although disturbances decay on average. It was called stable, and accurate to 2e-3."""
    model = f"""
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.54752856718, coupling_stiffness = 1.0,
   ground_stiffness = 0.716296639597, damping_mass = 0.0188776371784, damping_stiffness = 0.0846740464663 /
&tones frequency = 0.668872832083, {0.668872832083 / ratio!r} /
&accuracy tolerance = 1e-2 /
&load dof = 'x1', tuple = 1, 0, cos = 0.110382368275, sin = -0.565319622897 /
&load dof = 'x1', tuple = 0, 1, cos = 0.711375146219, sin = 0.392785291252 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 19.2926173494, gap = 0.931035200195, two_sided = .false. /
"""
    done, path = _solve(model, tmp_path)
    with h5py.File(path) as file:
        assert file["is_stable"][0] == 0 and file["level_estimate"][0] > 0.17
    assert "disturbances grow" in done.stdout and "1 truncated" in done.stdout


# The beam of the paper against its wall, 1.5 mm away.
WALL = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4, damping_diagonal = 1.0 /
&tones frequency = 2.718281828459045, 3.141592653589793 /
&load dof = 'v3', tuple = 1, 0, cos = 100.0 /
&load dof = 'v3', tuple = 0, 1, cos = 100.0 /
&law type = 'rigid_wall', dof = 'v3', gap = 1.5e-3 /
"""


def _motion(path):
    """Coefficients of the middle by tuple, and the estimate."""
    with h5py.File(path) as file:
        n, dof = file["n_harmonics"][0], list(file["dof"].asstr()[()]).index("v3")
        tuples = file["tuples"][0] if "tuples" in file else file["tuple"][()]
        return dict(zip(map(tuple, tuples[:n]), file["coefficients"][0, dof, :n])), float(file["truncation_estimate"][0])


def _distance(motion, reference):
    gaps = [reference.get(k, np.zeros(2)) - motion.get(k, np.zeros(2)) for k in {*motion, *reference}]
    return np.linalg.norm(gaps) / np.linalg.norm(list(reference.values()))


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """The motion at the wall with many harmonics."""
    return _motion(_solve(WALL + "&harmonics order = 36 /\n", tmp_path_factory.mktemp("wall"))[1])[0]


def test_a_wall_is_solved_and_kept_with_nothing_set(wall, tmp_path):
    """A tolerance also applies to the penetration, relative to the one that the error estimate permits."""
    done, path = _solve(WALL, tmp_path)
    assert done.status == 0, done.stdout
    with h5py.File(path) as file:
        largest = np.linalg.norm(file["coefficients"][0], axis=-1).max()
        assert file["penetration"][0] <= 1e-2 * largest
    assert _distance(_motion(path)[0], wall) < 1e-2


@pytest.mark.parametrize("order", [8, 12, 20])
def test_estimates_of_a_wall_are_near_the_error(order, wall, tmp_path):
    """Also for large sets, in which the second step of Newton's method makes walls chatter."""
    motion, estimate = _motion(_solve(WALL + f"&harmonics order = {order} /\n", tmp_path)[1])
    assert 0.6 < estimate / _distance(motion, wall) < 2.5


def test_rows_that_are_written_again_take_no_more_disk(tmp_path):
    """The room that is reserved for more harmonics stays unwritten, whatever run writes a row: here points that fail."""
    (tmp_path / "case.nml").write_text(
        "&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /\n&tones frequency = 1.0 /\n"
        "&load dof = 'x1', tuple = 1, cos = 0.3 /\n&sweep parameter = 'load(1)%cos', from = 0.1, to = 0.2, n = 40 /\n"
    )
    path = tmp_path / "case.h5"
    assert run("solve", "case.nml", cwd=tmp_path).status == NOT_ALL_CONVERGED
    before = 512 * path.stat().st_blocks
    if before > path.stat().st_size / 2:
        pytest.skip("the file system has no sparse files")
    assert run("resume", "case.h5", "--retry", cwd=tmp_path).status == NOT_ALL_CONVERGED
    assert 512 * path.stat().st_blocks < before + 1e6
