"""The shared library from Python and from C: the numbers of the command, errors that help, nothing left behind."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from program import ALL_CONVERGED, run

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)
os.environ["NHBM_LIBRARY"] = str(LIBRARY)

from nhbm.errors import ModelError  # noqa: E402
from nhbm.solver import Model, input_keys  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
DUFFING = """&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 0.9 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /
"""
STOP = DUFFING.replace("type = 'cubic_spring'", "type = 'elastic_stop', gap = 0.2").replace("= 0.5 /", "= 20.0 /")
CURVE = "&curve parameter = 'tones%frequency', from = 0.3, to = 3.0, peak_of = 'x1 (1)' /\n"
SECONDS = "setup_seconds", "iteration_seconds", "certificate_seconds", "solve_seconds"


def same(ours, stored, name):
    """Whether a column has the bits of a row of a file, which is padded where points have sets of their own."""
    stored = stored[tuple(slice(n) for n in np.shape(ours))] if np.ndim(ours) else stored
    assert np.array_equal(ours, stored, equal_nan=True), name


@pytest.mark.parametrize("text", [DUFFING, STOP, STOP + "&harmonics order = 9 /\n"], ids=["tolerance", "stop", "order"])
def test_points_have_the_bits_of_the_command(text, tmp_path):
    (tmp_path / "point.nml").write_text(text)
    assert run("solve", "point.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    model = Model(text)
    motion = model.solve().keep()
    assert motion.is_converged
    with h5py.File(tmp_path / "point.h5") as file:
        compared = [name for name in model.columns() if name in file and name not in (*SECONDS, "message", "rank")]
        for name in compared:
            if motion[name] is not None:
                same(motion[name], file[name][0], name)
        for axis in ("dof", "law_dof", "law"):
            assert model.labels(axis) == list(file[axis].asstr()[()])
    assert {"coefficients", "truncation_estimate", "is_stable", "multiplier_real", "power_in"} <= set(compared)


def test_curves_have_the_bits_of_the_command(tmp_path):
    (tmp_path / "curve.nml").write_text(DUFFING + CURVE)
    assert run("solve", "curve.nml", "--quiet", cwd=tmp_path).status == ALL_CONVERGED
    points = [motion.keep() for motion in Model(DUFFING + CURVE).curve()]
    with h5py.File(tmp_path / "curve.h5") as file:
        assert len(points) == np.count_nonzero(file["curve_kind"][()])
        for name in ("coefficients", "tones_frequency", "curve_kind", "curve_unknowns", "curve_step", "is_stable", "status"):
            for point, stored in zip(points, file[name][()]):
                same(point[name], stored, name)
    kinds = [int(point["curve_kind"]) for point in points]
    assert kinds.count(3) == 2 and kinds.count(4) == 1


def test_values_are_set_by_path_and_by_handle():
    model, other = Model(DUFFING), Model(DUFFING.replace("stiffness = 0.5", "stiffness = 0.7").replace("= 0.9 /", "= 1.1 /"))
    model.parameter("law(spring)%stiffness").set(0.7)
    model["tones%frequency"] = 1.1
    np.testing.assert_array_equal(model.solve()["coefficients"], other.solve()["coefficients"])
    assert "stiffness = 0.7" in " ".join(model.to_namelist().split())


def test_warm_starts_stay_on_the_branch():
    """Downwards the response of a hardening spring stays small at .9 of the way up, upwards large."""
    model = Model(DUFFING.replace("damping_mass = 0.1", "damping_mass = 0.05") + "&harmonics order = 7 /\n")
    frequency, found = model.parameter("tones%frequency"), []
    for values in (np.linspace(0.6, 1.6, 41), np.linspace(2.4, 1.6, 41)):
        for k, value in enumerate(values):
            frequency.set(value)
            motion = model.solve(warm=k > 0)
        found.append(np.abs(motion["coefficients"]).max())
    assert found[0] > 2 * found[1]


def test_what_is_wrong_is_said():
    with pytest.raises(ModelError, match="type = 'chian' is not known; did you mean 'chain'"):
        Model(DUFFING.replace("chain", "chian"))
    model = Model(DUFFING)
    with pytest.raises(ModelError, match="'law.stop.%gap'.*spring"):
        model.parameter("law(stop)%gap")
    with pytest.raises(KeyError, match="no column 'amplitude'; known: status message"):
        model.solve()["amplitude"]
    model["tones%frequency"] = -1.0
    with pytest.raises(ModelError, match="frequency"):
        model.solve()
    model["tones%frequency"] = 0.9
    first = model.solve()
    assert first.is_converged
    model.solve()
    with pytest.raises(ModelError, match="before the model was solved again"):
        first["coefficients"]
    with pytest.raises(ModelError, match="curve"):
        next(model.curve())


def test_an_interrupt_ends_a_solution():
    """Ctrl-C ends a long solution within a second, and the model goes on."""
    laws = "".join(f"&law type = 'jenkins', dof = 'x{i}', stiffness = 5.0, limit = 0.1 /\n" for i in range(1, 9))
    text = ("&structure type = 'chain', n_masses = 8, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.01 /\n"
            "&tones frequency = 0.7, 1.13 /\n&harmonics order = 14 /\n"
            "&load dof = 'x1', tuple = 1, 0, cos = 1.0 /\n&load dof = 'x1', tuple = 0, 1, cos = 1.0 /\n" + laws)  # fmt: skip
    model = Model(text)
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        model.solve()
    assert time.monotonic() - started < 3.0


def test_threads_with_a_model_each_do_not_meet():
    def sweep(text, found):
        model = Model(text)
        frequency = model.parameter("tones%frequency")
        for value in np.linspace(0.5, 1.4, 30):
            frequency.set(value)
            found.append(model.solve(warm=True)["coefficients"].tobytes())

    texts = [text + "&harmonics order = 9 /\n" for text in (DUFFING, STOP)]
    alone, together = [[], []], [[], []]
    for text, found in zip(texts, alone):
        sweep(text, found)
    threads = [threading.Thread(target=sweep, args=pair) for pair in zip(texts, together)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone


def test_models_leave_nothing_behind():
    def make(n):
        for _ in range(n):
            Model(DUFFING + "&harmonics order = 3 /\n").solve()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    make(50)
    before = make(50)
    assert make(500) - before < 4000  # KiB


def test_a_c_program_has_the_same_numbers(tmp_path):
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    source = ROOT / "drivers" / "examples" / "duffing.c"
    program = tmp_path / "duffing"
    command = [compiler, "-Wall", "-Werror", "-I", str(ROOT / "src" / "api"), str(source), str(LIBRARY), "-o", str(program)]
    subprocess.run([*command, f"-Wl,-rpath,{LIBRARY.parent}"], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    model = Model(DUFFING)
    frequency, expected = model.parameter("tones%frequency"), []
    for k in range(5):
        frequency.set(0.5 + 0.25 * k)
        expected.append(model.solve(warm=k > 0)["coefficients"][0, 1, 0])
    assert [float(line.split()[1]) for line in done.stdout.splitlines()] == expected


def test_the_table_of_keys():
    rows = [line for line in (ROOT / "src" / "input_keys.txt").read_text().splitlines() if line and not line.startswith("#")]
    assert [" | ".join(key) for key in input_keys()] == rows
    gap = next(key for key in input_keys() if (key.section, key.name) == ("law rigid_wall", "gap"))
    assert (gap.type, gap.unit, gap.default) == ("real", "m", "required")
