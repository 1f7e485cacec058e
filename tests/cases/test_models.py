"""Structures from model files: the same results as from matrices, sets of nodes, and invalid models."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.optimize
import scipy.sparse as sp
import nhbm
from nhbm.command import main as nhbm_model
from nhbm_post.cli import main as post
from nhbm_post.contact import Motion, contacts, follow, history
from nhbm_post.reader import Results
from nhbm_post.structure import Structure, harmonic_of, motions
from scipy.sparse.linalg import spsolve

from expectations import expects_only_converged, failures, read_expectations
from program import ALL_CONVERGED, BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, run

INPUTS = Path(__file__).resolve().parents[2] / "inputs" / "models"

N = 5

REST = """
&tones frequency = 0.9, 1.4142135623730951 /
&harmonics order = 3 /
&load dof = 'n1.z', tuple = 1, 0, cos = 0.5 /
&load dof = 'n5.z', tuple = 0, 1, sin = 0.4 /
&error_estimate is_on = .false. /
"""
MODEL = "&structure type = 'model', file = 'chain.h5', damping_mass = 0.01 /\n" + REST
STOPS = "&law type = 'elastic_stop', label = 'stop', dof = 'stops.z', stiffness = 10.0, gap = 0.2 /\n"


@pytest.fixture
def chain(tmp_path):
    """Five masses between walls, stops at the second and the fourth, in a file."""
    stiffness = sp.diags([np.full(N, 2.0), np.full(N - 1, -1.0), np.full(N - 1, -1.0)], [0, 1, -1])
    model = nhbm.Structure(
        mass=sp.diags(np.linspace(1.0, 2.0, N)),
        stiffness=stiffness,
        damping=0.05 * stiffness,
        labels=[f"n{i + 1}.z" for i in range(N)],
        node_numbers=np.arange(1, N + 1),
        coordinates=np.zeros((N, 3)),
        dof_node=np.arange(N),
        dof_direction=["z"] * N,
        sets={"stops": np.array([3, 1])},
        loads={"wind": (np.array([0, 4]), np.array([0.5, 0.25]))},
    )
    model.write(tmp_path / "chain.h5")
    return model


def solve(folder, text, *options, name="run", ranks=None, status=ALL_CONVERGED):
    (folder / f"{name}.nml").write_text(text)
    done = run("solve", f"{name}.nml", "--overwrite", *options, cwd=folder, ranks=ranks)
    assert done.status == status, done.stderr
    with h5py.File(folder / f"{name}.h5") as file:
        return {key: file[key][()] for key in ("coefficients", "force_coefficients", "dof", "law", "residual")}


def as_matrices(model):
    """The same structure in namelist form."""

    def rows(matrix):
        return ", ".join(f"{x:.17g}" for x in matrix.toarray().ravel())

    labels = ", ".join(f"'{label}'" for label in model.labels)
    return (
        f"&structure type = 'matrices', n_dofs = {N}, labels = {labels}, damping_mass = 0.01\n mass = {rows(model.mass)}\n"
        f" damping = {rows(model.damping)}\n stiffness = {rows(model.stiffness)} /\n" + REST
    )


def test_model_is_what_its_matrices_are(chain, tmp_path):
    one_by_one = "".join(STOPS.replace("stops.z", f"n{n}.z").replace("'stop'", f"'stop n{n}.z'") for n in (4, 2))
    ours = solve(tmp_path, MODEL + STOPS)
    other = solve(tmp_path, as_matrices(chain) + one_by_one, name="matrices")
    for key in ours:
        np.testing.assert_array_equal(ours[key], other[key])


def entries(form, matrix):
    """The lower triangle in lines with row, column and value, counted from one."""
    part = sp.tril(matrix).tocoo()
    return "".join(form.format(i + 1, j + 1, v) for i, j, v in zip(part.row, part.col, part.data))


def test_a_file_without_its_option_is_named(capsys):
    with pytest.raises(SystemExit):
        nhbm_model(["import", "a.inp", "-o", "b.h5"])
    assert "unknown: a.inp: give it to an option, such as --calculix" in capsys.readouterr().err


def test_an_option_that_is_given_once_for_several_values_is_named(capsys):
    with pytest.raises(SystemExit):
        nhbm_model(["fit", "a.nml", "a.csv", "--by", "law(1)%gap", "structure%damping(1)", "--of", "x1 (1)"])
    assert "repeat the option for each, --by structure%damping(1) (see nhbm" in capsys.readouterr().err


def imported(kind, model, folder):
    """Writes the model in a format and gives the options of `nhbm-model import` for it."""
    given = {"mass": model.mass, "stiffness": model.stiffness}
    files = [f"--{name}={folder / name}.{'npz' if kind == 'npz' else 'mtx'}" for name in given]
    (folder / "labels").write_text("\n".join(model.labels))
    labels = f"--labels={folder / 'labels'}"
    if kind == "calculix":
        for end, matrix in ((".sti", model.stiffness), (".mas", model.mass)):
            (folder / f"job{end}").write_text(entries("{} {} {:.17g}\n", matrix))
        (folder / "job.dof").write_text("".join(f"{i + 1}.3\n" for i in range(N)))
        return [f"--calculix={folder / 'job'}"]
    for name, matrix in given.items():
        if kind == "npz":
            sp.save_npz(folder / f"{name}.npz", matrix)
        elif kind == "abaqus":
            (folder / f"{name}.mtx").write_text(entries("{},3, {},3, {:.17g}\n", matrix))
        else:
            scipy.io.mmwrite(folder / name, matrix, precision=17)
    if kind == "abaqus":
        return ["--abaqus", *files]
    if kind == "mesh":
        nodes = "".join(f"{i + 1}, {i}.0, 0.0, 0.0\n" for i in range(N))
        (folder / "mesh.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=T3D2\n1, 1, 2\n*NSET, NSET=STOPS\n2, 4\n")
        return [*files, labels, f"--mesh={folder / 'mesh.inp'}"]
    return [*files, labels]


@pytest.mark.parametrize("kind", ["matrix market", "npz", "calculix", "abaqus", "mesh"])
def test_every_format_gives_the_same_motion(chain, tmp_path, kind):
    chain = dataclasses.replace(chain, damping=None, loads={}, sets={"stops": np.array([1, 3])})
    chain.write(tmp_path / "chain.h5")
    ours = solve(tmp_path, MODEL + STOPS)
    (tmp_path / "chain.h5").unlink()
    sets = [] if kind == "mesh" else ["--set=stops=2,4"]
    assert nhbm_model(["import", *imported(kind, chain, tmp_path), *sets, "-o", str(tmp_path / "chain.h5")]) == 0
    other = solve(tmp_path, MODEL + STOPS, name="other")
    assert np.abs(ours["force_coefficients"]).max() > 0.01  # the stops are struck
    for key in ("coefficients", "force_coefficients"):
        np.testing.assert_allclose(other[key], ours[key], rtol=0, atol=1e-13)
    assert other["dof"].tolist() == ours["dof"].tolist() and other["law"].tolist() == ours["law"].tolist()


@pytest.mark.parametrize("order, warned", [([2, 3], False), ([3, 2], True)])
def test_pairs_of_sets_that_are_not_the_nearest_nodes_are_told(chain, tmp_path, order, warned):
    """Sets are paired in their order: a deck may list one side of a joint backwards."""
    places = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.0, 0, 1e-3], [0.1, 0, 1e-3], [1.0, 0, 0]])
    sets = {"lower": np.array([0, 1]), "upper": np.array(order)}
    structure = dataclasses.replace(chain, coordinates=places, sets=sets, loads={})
    structure.write(tmp_path / "chain.h5")
    joint = "&law type = 'jenkins', label = 'joint', dofs = 'lower.z', 'upper.z', weights = 1, -1, stiffness = 9, limit = 1 /\n"
    (tmp_path / "run.nml").write_text(MODEL + joint)
    done = run("check", "run.nml", cwd=tmp_path)
    assert done.status == 0, done.stderr
    assert ("nearer" in done.stdout + done.stderr) == warned
    for known in (True, False):
        structure.coordinates[0] = 0.0 if known else np.nan  # such as nodes that a solver adds
        model = nhbm.Model(structure, tones=[1.0])
        model.law("jenkins", dofs=["lower.z", "upper.z"], weights=[1, -1], label="joint", stiffness=9.0, limit=1.0)
        assert any("nearer" in warning for warning in model.check()) == (warned and known)


def test_sweep_of_a_law_on_a_set(chain, tmp_path):
    """On two ranks, from neighbours: each point equals a separate one."""
    sweep = "&sweep parameter = 'law(stop)%gap', from = 0.3, to = 0.2, n = 3 /\n&solver first_guess = 'linear' /\n"
    swept = solve(tmp_path, MODEL + STOPS + sweep, ranks=2)
    for i, gap in enumerate((0.3, 0.25, 0.2)):
        alone = solve(tmp_path, MODEL + STOPS, "--set", f"law(stop)%gap={gap}", name="alone")
        np.testing.assert_allclose(swept["coefficients"][i], alone["coefficients"][0], atol=1e-12)


def test_vector_of_loads(chain, tmp_path):
    alone = MODEL.replace("&load", "! &load")
    by_vector = solve(tmp_path, alone + "&load vector = 'wind', tuple = 1, 0, cos = 2.0 /\n" + STOPS)
    one_by_one = "&load dof = 'n1.z', tuple = 1, 0, cos = 1.0 /\n&load dof = 'n5.z', tuple = 1, 0, cos = 0.5 /\n"
    np.testing.assert_array_equal(
        by_vector["coefficients"], solve(tmp_path, alone + one_by_one + STOPS, name="single")["coefficients"]
    )


def test_file_stands_beside_the_input(chain, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run.nml").write_text(MODEL)
    done = run("check", "../run.nml", cwd=tmp_path / "elsewhere")
    assert done.status == 0, done.stderr


DAMAGES = {
    "has no matrix 'mass'": lambda f: f.__delitem__("mass"),
    "has no 'mass/data'": lambda f: f.__delitem__("mass/data"),
    "has no 'labels'": lambda f: f.__delitem__("labels"),
    "matrix 'stiffness': indices(2) is 77, not between 0 and 4": lambda f: f["stiffness/indices"].__setitem__(1, 77),
    "matrix 'mass': the entry in row 3 and column 3 is not a finite number": lambda f: f["mass/data"].__setitem__(2, np.nan),
    "matrix 'mass' has 2 rows, there are 5 labels": lambda f: replace(f, "mass/indptr", np.array([0, 1, 2])),
    "'units' has 2 entries, expected 5": lambda f: replace(f, "units", ["m", "m"]),
    "set 'stops' names node 9, there are 0 to 4": lambda f: f["sets/nodes"].__setitem__(0, 9),
    "set 'stops' names node 1 twice": lambda f: f["sets/nodes"].__setitem__(0, 1),
    "dofs/node(2) is 8, there are nodes 0 to 4": lambda f: f["dofs/node"].__setitem__(1, 8),
    "'sets/indptr' must rise from 0 to 2": lambda f: f["sets/indptr"].__setitem__(1, 5),
    "load 'wind' names degree of freedom 6, there are 0 to 4": lambda f: f["loads/dofs"].__setitem__(1, 6),
    "value 2 of load 'wind' is not a finite number": lambda f: f["loads/values"].__setitem__(1, np.inf),
    "is not a model file: it has no attribute 'format'": lambda f: f.attrs.__delitem__("format"),
    "has schema version 3": lambda f: f.attrs.__setitem__("schema_version", 3),
    "'mass/data' has 2 axes, expected 1": lambda f: replace(f, "mass/data", np.zeros((5, 1))),
    "labels must be unique": lambda f: f["labels"].__setitem__(3, "n1.z"),
    "the mass of n2.z is negative": lambda f: f["mass/data"].__setitem__(1, -1.0),
    "dataset 'labels'": lambda f: replace(f, "labels", np.zeros(5)),
}


def test_a_result_never_takes_the_place_of_a_model(chain, tmp_path):
    before = (tmp_path / "chain.h5").read_bytes()
    (tmp_path / "chain.nml").write_text(MODEL)
    done = run("solve", "chain.nml", "--overwrite", cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "result file 'chain.h5' is a model file; give another --output" in done.stderr
    assert (tmp_path / "chain.h5").read_bytes() == before


def replace(file, name, data):
    del file[name]
    file[name] = data


@pytest.mark.parametrize("message", DAMAGES)
def test_bad_models_are_named(chain, tmp_path, message):
    with h5py.File(tmp_path / "chain.h5", "r+") as file:
        DAMAGES[message](file)
    assert message in refused(tmp_path)


def refused(folder):
    (folder / "run.nml").write_text(MODEL)
    done = run("solve", "run.nml", cwd=folder)
    assert done.status == BAD_INPUT
    assert len(done.messages) == 1 and "run.nml:1: &structure: " in done.stderr
    return done.stderr


def test_files_that_are_no_models(chain, tmp_path):
    path = tmp_path / "chain.h5"
    path.write_bytes(path.read_bytes()[:2000])
    assert "truncated" in refused(tmp_path)
    path.write_text("matrices\n")
    assert "chain.h5'" in refused(tmp_path)
    path.unlink()
    assert "chain.h5' does not exist" in refused(tmp_path)


@pytest.mark.parametrize("n_bytes", [2**62, pytest.param(2**64 - 16, marks=pytest.mark.long)])
def test_texts_of_which_hdf5_dies_or_finds_no_end(chain, tmp_path, n_bytes):
    """The second length causes an infinite loop: headers of texts have 16 bytes, so that the next one begins at the same
    position."""
    data = bytearray((tmp_path / "chain.h5").read_bytes())
    at = data.find(b"GCOL")  # signature, version and size of 16 bytes; of each text index, count and size of 16 bytes
    data[at + 24 : at + 32] = n_bytes.to_bytes(8, "little")
    (tmp_path / "chain.h5").write_bytes(data)
    (tmp_path / "run.nml").write_text(MODEL)
    done = run("check", "run.nml", cwd=tmp_path)
    says = r"chain\.h5.*(damaged, at 'format'|it has no attribute 'format')"  # HDF5 1.14 reports the first length itself
    assert done.status == BAD_INPUT and re.search(says, done.stderr), done.stderr


def test_matrix_that_is_not_symmetric(chain, tmp_path):
    mass = chain.mass.tolil()
    mass[0, 3] = 0.25
    chain.mass = mass.tocsr()
    chain.write(tmp_path / "chain.h5")
    assert "the mass matrix must be symmetric; between n4.z and n1.z it is 0.0 one way and 0.25" in refused(tmp_path)


def test_what_drifts_is_an_outcome_that_says_where(chain, tmp_path):
    """Unsupported masses under a constant load."""
    loose = sp.diags([np.array([1.0, 2, 2, 2, 1]), -np.ones(4), -np.ones(4)], [0, 1, -1])
    chain.stiffness = sp.csr_matrix(loose)
    chain.write(tmp_path / "chain.h5")
    (tmp_path / "run.nml").write_text(MODEL.replace("tuple = 1, 0, cos", "tuple = 0, 0, cos"))
    done = run("solve", "run.nml", cwd=tmp_path)
    assert done.status != ALL_CONVERGED
    with h5py.File(tmp_path / "run.h5") as file:
        assert b"'n5.z' has no static stiffness and drifts" in file["message"][0].tobytes()


def make_model(name, folder):
    """Runs the script of an input with our own nhbm-model."""
    commands = folder / "commands"
    commands.mkdir()
    (commands / "nhbm-model").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nhbm.command "$@"\n')
    (commands / "nhbm-model").chmod(0o755)
    source = Path(sys.modules["nhbm"].__file__).resolve().parents[1]
    path = f"{commands}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(source), "PYTHON": sys.executable}
    done = subprocess.run([INPUTS / f"{name}.sh", folder], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


@pytest.mark.long  # what they do is tested in parts by this file and test_rotor_stator.py
@pytest.mark.parametrize("name", [file.stem for file in sorted(INPUTS.glob("*.nml"))])
def test_gallery(name, tmp_path):
    """From the script to pictures, with the numbers of the input."""
    pytest.importorskip("skfem")
    make_model(name, tmp_path)
    text = (INPUTS / f"{name}.nml").read_text()
    expectations = read_expectations(text)
    solve(tmp_path, text, status=ALL_CONVERGED if expects_only_converged(expectations) else NOT_ALL_CONVERGED)
    with Results(tmp_path / "run.h5") as results:
        assert not failures(expectations, results)
    model = str(tmp_path / f"{name}.h5")
    assert post(["vtk", str(tmp_path / "run.h5"), "--model", model, "--frames", "2"]) == 0
    assert post(["deflection", str(tmp_path / "run.h5"), "--model", model, "--dpi", "40"]) == 0
    assert (tmp_path / "run_motion" / "0001.vtu").exists()
    for view in ("patch", "time"):
        assert post(["contact", str(tmp_path / "run.h5"), "--model", model, "--view", view, "--dpi", "40"]) == 0
    if name == "bladed_wheel":
        check_sliders(tmp_path / "run.h5", model)
    if name == "blades_casing":
        check_blades(tmp_path / "run.h5", model)


def check_sliders(path, model):
    """Sliders that follow the motion over eight beats of the two tones reproduce the loss of the laws in the result."""
    with Results(path) as results:
        (contact,), motion = contacts(results, Structure(model), 0), Motion(results, 0)
        times = motion.step * np.arange(int(1.125 * motion.window / motion.step))
        z, k = motion.coordinate(contact, 0, times), contact.keys["stiffness"]
        places, _ = follow(z[None], np.full(z.shape, contact.keys["limit"] / k), np.zeros((1, z.shape[1])))
        work = k * (z - places[0])[1:] * np.diff(places[0], axis=0)
        start = len(times) // 9
        power = work[start:].sum(axis=0) / (times[-1] - times[start])
        np.testing.assert_allclose(power, results.power_laws(0), rtol=2e-3)


def check_blades(path, model):
    """Normal forces of the blades, with damping, move drum and ring as in the result, averaged over their waves."""
    with Results(path) as results:
        contact, motion = contacts(results, Structure(model), 0)[0], Motion(results, 0)
        times = np.linspace(0.0, motion.period, 400)
        normal = history(contact, motion, times).normal_force
        wave, speed = results.frequency(0)
        for labels, sign, turn in ((("n239.r", "n6799.r"), 1, 0.0), (("n6822.r", "n7790.r"), -1, 3 * speed)):
            phase = 3 * 2 * np.pi * np.arange(1, 23) / 22 + turn * times[:, None]
            rate, told = (
                sum(
                    unit * (np.exp(1j * np.outer(times, s.frequencies)) @ ((1j * s.frequencies) ** n * (s.cos - 1j * s.sin))).real
                    for unit, s in zip((1, 1j), (results.series(0, label, what) for label in labels))
                )
                for what, n in (("motion", 1), ("force", 0))
            )
            push = sign * (normal * np.exp(1j * phase)).sum(axis=1) + 5.0 * np.abs(rate) ** 2 * rate
            backwards = np.exp(1j * (wave - turn) * times)
            assert abs((push * backwards).mean() / (told * backwards).mean() - 1) < 1e-3


WHEEL = """&structure type = 'model', file = 'FILE.h5', damping_stiffness = 1e-6 /
&tones frequency = 2586.0 /
&harmonics order = 9 /
&load vector = 'push_cos', tuple = 1, cos = 10.0 /
&load vector = 'push_sin', tuple = 1, sin = 10.0 /
&law type = 'jenkins', label = 'damper', dof = 'damper.z', stiffness = 1e6, limit = 20.0 /
"""
WAVE = ("--sectors", "8", "--neighbours", "damper=under_high,under_low")


@pytest.mark.long
def test_a_wheel_that_was_never_put_together_moves_as_the_whole(tmp_path, monkeypatch):
    """Under a rotating load with two nodal diameters, with friction between neighbours: each sector moves like the previous one.
    One nodal diameter is sufficient if all odd harmonics belong to it, or if only the first one is needed."""
    pytest.importorskip("skfem")
    monkeypatch.chdir(tmp_path)
    assert nhbm_model(["sector", "--n-sectors", "8", "-o", "sector.h5"]) == 0
    assert nhbm_model(["wheel", "sector.h5", *WAVE, "--wave", "push=tip.z:2", "-o", "whole.h5"]) == 0
    keep = ("--keep", "damper.z,tip.z", "--modes", "16", "--no-error")
    for name, wave, more in (
        ("small", 2, ()), ("one", 2, ("--diameter", "2")), ("three", 3, ()), ("one_three", 3, ("--diameter", "3")),
    ):  # fmt: skip
        assert nhbm_model(["wheel", "sector.h5", *WAVE, "--wave", f"push=tip.z:{wave}", *keep, *more, "-o", f"{name}.h5"]) == 0
    pair = "dofs = 'damper_1.z', 'damper_2.z', weights = 1.0, -1.0"
    inputs = {"whole": WHEEL.replace("dof = 'damper.z'", pair) + "&output dofs = 'tip.z' /", "small": WHEEL, "one": WHEEL}
    first = WHEEL.replace("order = 9", "set = 'list', tuples = 1").replace("2586", "2637") + "&sampling samples = 512 /"
    inputs |= {"three": first, "one_three": first}
    tips = {}
    for name, text in inputs.items():
        (tmp_path / f"{name}.nml").write_text(text.replace("FILE", name))
        done = run("solve", f"{name}.nml", "-o", f"{name}_run.h5", "--set", "error_estimate%is_on=f", cwd=tmp_path)
        assert done.status == ALL_CONVERGED, done.stderr
        labels = nhbm.Structure.read(f"{name}.h5")
        with Results(f"{name}_run.h5") as results:
            series = [results.series(0, labels.labels[dof]) for dof in labels.dofs_of("tip.z")]
            tips[name] = np.array([s.cos - 1j * s.sin for s in series])
    assert np.abs(tips["small"][:, 3]).min() > 1e-4 * np.abs(tips["small"]).max()
    assert largest_difference(tips["small"], tips["whole"]) < 1e-5
    assert largest_difference(tips["one"][0], tips["small"][0]) < 1e-8
    assert largest_difference(tips["one_three"][0], tips["three"][0]) < 1e-7
    later = tips["small"][0] * np.exp(-1j * np.arange(10) * np.pi / 2)  # a quarter of the period
    assert largest_difference(tips["small"][1], later) < 1e-7


@pytest.mark.long  # seconds
def test_waves_of_sectors_move_as_wheels_put_together(tmp_path, monkeypatch):
    """Blades against a casing: under the forces of the balance in waves of one sector each, all nodes of the assembled drum and
    ring move as computed; and the limit cycle is that of waves of sectors and of blades all around the ring."""
    pytest.importorskip("skfem")
    monkeypatch.chdir(tmp_path)
    make_model("blades_casing", tmp_path)
    solve(tmp_path, (INPUTS / "blades_casing.nml").read_text(), "--set", "sampling%samples=4224,8")
    small, structure = nhbm.Structure.read("blades_casing.h5"), Structure("blades_casing.h5")
    phase = 2 * np.pi * 3 * np.arange(22) / 22
    first, found = 0, []
    with Results("run.h5") as results:
        tuples, frequencies, motion = motions(results, structure, 0)
        for sector, place, kept, which in (
            ("blade", "tip.r", "disk_tip.r", (1, 0)), ("ring", "inside.r", "casing_inside.r", (1, -3)),
        ):  # fmt: skip
            assert nhbm_model(["wheel", f"{sector}.h5", "--sectors", "22", "-o", f"{sector}s.h5"]) == 0
            whole, h = nhbm.Structure.read(f"{sector}s.h5"), harmonic_of(tuples, motion, which)
            forces = [results.series(0, small.labels[dof], "force") for dof in small.dofs_of(kept)]
            cosine, sine = (series.cos[h] - 1j * series.sin[h] for series in forces)
            load = np.zeros(whole.n_dofs, dtype=complex)
            load[whole.dofs_of(place)] = -cosine * np.cos(phase) - sine * np.sin(phase)
            dynamic = (1 + 2.5e-6j * frequencies[h]) * whole.stiffness - frequencies[h] ** 2 * whole.mass
            all_nodes = small.recovery.matrix[first : first + whole.n_dofs] @ motion[:, h]
            assert largest_difference(all_nodes, spsolve(dynamic.tocsc(), load)) < 1e-7
            first += whole.n_dofs
            found.append(np.abs(motion[small.dofs_of(kept)[0], h]))
        found.append(results.frequency(0)[0])
    np.testing.assert_allclose(found, waves_against_many_blades(1104.0), rtol=2e-6)


def waves_against_many_blades(speed):
    """Amplitudes of drum and ring and their frequency, from the flexibility of one sector of each and the force of 22 blades as the
    mean around the ring. Complex amplitudes of exp(-i w t) in the frame of the drum."""
    bodies = [(model, model.dofs_of(place)[0]) for model, place in
              ((nhbm.Structure.read("disk.h5"), "tip.r"), (nhbm.Structure.read("casing.h5"), "inside.r"))]  # fmt: skip

    def stiffness(body, w):
        """Force of 1 m at the contact."""
        model, dof = body
        unit = np.eye(model.n_dofs)[:, dof]
        return 1 / np.linalg.solve((1 - 2.5e-6j * w) * model.stiffness.toarray() - w**2 * model.mass.toarray(), unit)[dof]

    def residual(x):
        disk, casing, w = x[0] * 1e-3, (x[1] + 1j * x[2]) * 1e-3, x[3] * 1e3
        pressed, gap = disk - casing, 5e-4
        angle = np.arccos(gap / abs(pressed))
        size = 22 * 1.6e6 / (2 * np.pi) * (abs(pressed) * (angle + np.sin(2 * angle) / 2) - 2 * gap * np.sin(angle))
        out = []
        for body, seen, z, sign in zip(bodies, (w, w - 3 * speed), (disk, casing), (1, -1)):
            out.append((stiffness(body, seen) - 5.0j * seen**3 * abs(z) ** 2) * z + sign * size * pressed / abs(pressed))
        return [part for value in out for part in (value.real, value.imag)]

    x = scipy.optimize.fsolve(residual, [2.2, 2.1, -0.5, 1.63], xtol=1e-12)
    return x[0] * 1e-3, np.hypot(x[1], x[2]) * 1e-3, x[3] * 1e3


N_X, N_Y = 40, 30


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    """1200 masses on a net, held along one edge: too many for dense matrices. A dashpot at one of them."""
    folder = tmp_path_factory.mktemp("net")
    path = lambda n, end: sp.diags([np.r_[np.full(n - 1, 2.0), end], -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1])  # noqa: E731
    free = path(N_Y, 1.0).tolil()
    free[0, 0] = 1.0
    stiffness = (sp.kron(sp.eye(N_Y), path(N_X, 1.0)) + sp.kron(free, sp.eye(N_X))).tocsr()
    n = N_X * N_Y
    mass = sp.diags(1.0 + 0.1 * (np.arange(n) % 7))
    dashpot = sp.csr_matrix(([0.3], ([555], [555])), shape=(n, n))
    nhbm.Structure(
        mass=mass,
        stiffness=stiffness,
        damping=0.02 * stiffness + dashpot,
        labels=[f"n{i + 1}.z" for i in range(n)],
        node_numbers=np.arange(1, n + 1),
        coordinates=np.c_[np.arange(n) % N_X, np.arange(n) // N_X, np.zeros(n)].astype(float),
        dof_node=np.arange(n),
        dof_direction=["z"] * n,
        sets={"stops": np.array([399, 799]), "edge": np.arange(N_X - 1, n, N_X), "most": np.arange(700)},
    ).write(folder / "net.h5")
    return folder


NET = """&structure type = 'model', file = 'net.h5', damping_mass = 0.001 /
&tones frequency = 0.05, 0.0714142 /
&harmonics order = 3 /
&load dof = 'edge.z', tuple = 1, 0, cos = 0.002 /
&load dof = 'n100.z', tuple = 0, 1, sin = 0.01 /
&law type = 'elastic_stop', label = 'stop', dof = 'stops.z', stiffness = 1.0, gap = 0.025 /
&output dofs = 'stops.z', 'n1111.z' /
&error_estimate is_on = .false. /
&solver tolerance = 1e-13 /
"""
SMALL = NET.replace("net.h5", "small.h5")


def largest_difference(ours, other):
    return np.abs(ours - other).max() / np.abs(other).max()


def reduce(folder, command):
    words = command.split()[1:]
    assert nhbm_model([str(folder / word) if word.endswith(".h5") else word for word in words] + ["--overwrite"]) == 0


@pytest.mark.long
def test_a_large_model_is_said_to_be_and_the_command_makes_a_small_one(net):
    """The small model moves like the full one at the locations of laws and &output, under loads on many nodes and on one, with a
    dashpot."""
    (net / "large.nml").write_text(NET)
    told = run("check", "large.nml", cwd=net).stdout
    assert "1200 degrees of freedom, which are condensed at each point anew" in told
    (command,) = (line.strip() for line in told.splitlines() if "nhbm-model reduce" in line)
    assert "--keep stops.z,edge.z,n100.z,n1111.z" in command
    reduce(net, command)
    whole, ours = solve(net, NET, name="large"), solve(net, SMALL, name="small_of_it")
    assert np.abs(whole["force_coefficients"]).max() > 1e-3
    for key in ("coefficients", "force_coefficients"):
        assert largest_difference(ours[key], whole[key]) < 1e-9


def test_the_command_for_a_small_model_names_all_places(net):
    """Second coordinates of a law in a plane, bearings and the place of a normal mode stay as well."""
    (net / "plane.nml").write_text(
        "&structure type = 'model', file = 'net.h5' /\n&tones frequency = 0.05 /\n&harmonics order = 1 /\n"
        "&load dof = 'edge.z', tuple = 1, cos = 0.002 /\n"
        "&law type = 'jenkins_2d', dof = 'n7.z', second_dofs = 'n9.z', stiffness = 1.0, limit = 0.1 /\n"
        "&bearing dofs = 'n11.z', 'n13.z', speed = 1.0, speeds = 1.0, 2.0, stiffness = 1.0, 3*0.0, 1.0, 3*0.0 /\n"
    )
    (command,) = (line.strip() for line in run("check", "plane.nml", cwd=net).stdout.splitlines() if "nhbm-model reduce" in line)
    assert "--keep n7.z,n9.z,edge.z,n11.z,n13.z" in command


def test_no_small_model_is_advised_where_laws_are_nearly_everywhere(net):
    """It would keep all of these."""
    (net / "most.nml").write_text(NET.replace("order = 3", "order = 1").replace("dof = 'stops.z'", "dof = 'most.z'"))
    told = run("check", "most.nml", cwd=net).stdout
    assert "memory" in told and "condensed at each frequency" not in told


@pytest.mark.long  # seconds
def test_harmonics_beyond_what_a_model_was_reduced_for_are_reported(net):
    reduce(net, "nhbm-model reduce net.h5 --keep stops.z,edge.z,n100.z,n1111.z --up-to 0.37 -o small.h5")
    (net / "beyond.nml").write_text(SMALL)
    assert "warning" not in run("check", "beyond.nml", cwd=net).stdout
    told = run("check", "beyond.nml", "--set", "harmonics%order=4", cwd=net).stdout
    assert "the model was reduced for frequencies up to 0.37 rad/s" in told


def test_a_changed_model_is_not_gone_on_with_unasked(net):
    (net / "changed.nml").write_text(NET)
    done = run("solve", "changed.nml", "--overwrite", "--quiet", "--time-limit", "0", cwd=net)
    assert done.status == INCOMPLETE, done.stderr
    file = net / "net.h5"
    before = file.read_bytes()
    with h5py.File(file, "r+") as model:
        model["stiffness/data"][0] += 0.5
    for words in (("resume", "changed.h5"), ("solve", "changed.nml", "--resume")):
        done = run(*words, cwd=net)
        assert done.status == BAD_INPUT and "made with another model" in done.stderr and "'net.h5': CRC-32" in done.stderr
    file.write_bytes(before)
    assert run("resume", "changed.h5", "--quiet", cwd=net).status == ALL_CONVERGED


def test_a_file_without_its_model_says_what_to_do(net):
    """Like files from before models had identifiers."""
    (net / "older.nml").write_text(NET)
    assert run("solve", "older.nml", "--overwrite", "--quiet", "--time-limit", "0", cwd=net).status == INCOMPLETE
    with h5py.File(net / "older.h5", "r+") as file:
        file["input_libraries"][()] = ""
    done = run("resume", "older.h5", cwd=net)
    assert done.status == BAD_INPUT and "does not say which model" in done.stderr and "--retry continues" in done.stderr
    assert run("resume", "older.h5", "--retry", "--quiet", cwd=net).status == ALL_CONVERGED


@pytest.mark.long  # seconds
def test_all_nodes_of_a_reduced_model_are_recovered(net):
    reduce(net, "nhbm-model reduce net.h5 --keep stops.z,edge.z,n100.z --up-to 0.5 -o shapes.h5")
    everything = NET.replace("&output dofs = 'stops.z', 'n1111.z' /\n", "")
    solve(net, everything.replace("net.h5", "shapes.h5"), name="of_shapes")
    solve(net, everything, name="whole")
    fields = []
    for name, model in (("of_shapes", "shapes.h5"), ("whole", "net.h5")):
        structure = Structure(net / model)
        tuples, _, coefficients = motions(Results(net / f"{name}.h5"), structure, 0)
        h = harmonic_of(tuples, coefficients, (1, 0))
        fields.append(structure.displacement(coefficients[:, h].real))
    assert np.abs(fields[1][:, 2]).min() > 0.0
    assert largest_difference(*fields) < 1e-4


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("solid", "--n-x", "0"), "--n-x must be above 0, not 0"),
        (("solid", "--poisson", "0.7"), "--poisson must be above -1 and below 0.5, not 0.7"),
        (("beam", "--young", "inf"), "--young must be above 0, not inf"),
        (("beam", "--node-set", "tip=9,9,9"), "no node is near 9, 9, 9: the closest is at 1, 0, 0"),
        (("beam", "--node-set", "tip"), "--node-set tip: give NAME=X,Y,Z"),
        (("rotor", "--bearing", "0"), "--bearing 0: give POSITION,STIFFNESS,DAMPING"),
    ],
)
def test_options_of_examples_are_checked(words, told, tmp_path, capsys):
    pytest.importorskip("skfem")
    assert nhbm_model([*words, "-o", str(tmp_path / "q.h5")]) == 2
    assert capsys.readouterr().err == f"nhbm-model: {told}\n" and not list(tmp_path.iterdir())


def test_a_warning_of_the_command_is_one_line(tmp_path, capsys):
    assert nhbm_model(["rotor", "--bearing", "0,-1e6,100", "-o", str(tmp_path / "r.h5")]) == 0
    told = capsys.readouterr().err
    assert told.startswith("nhbm-model: warning: bearing at 0 m: stiffness -1000000.0 is negative") and told.count("\n") == 1
    assert nhbm_model(["info", str(tmp_path / "r.h5")]) == 0 and "set bearing1: 1 node; " in capsys.readouterr().out
