"""Structures from model files: the same results as from matrices, sets of nodes, and what is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from nhbm import Model
from nhbm_post.cli import main as post
from nhbm_post.reader import Results

from expectations import failures, read_expectations
from program import ALL_CONVERGED, BAD_INPUT, run

INPUTS = Path(__file__).resolve().parents[2] / "inputs" / "models"

N = 5

REST = """
&tones frequency = 0.9, 1.4142135623730951 /
&harmonics order = 3 /
&load dof = 'n1.z', tuple = 1, 0, cos = 0.5 /
&load dof = 'n5.z', tuple = 0, 1, sin = 0.4 /
&certificate is_on = .false. /
"""
MODEL = "&structure type = 'model', file = 'chain.h5', damping_mass = 0.01 /\n" + REST
STOPS = "&law type = 'elastic_stop', label = 'stop', dof = 'stops.z', stiffness = 10.0, gap = 0.2 /\n"


@pytest.fixture
def chain(tmp_path):
    """Five masses between walls, stops at the second and the fourth, in a file."""
    stiffness = sp.diags([np.full(N, 2.0), np.full(N - 1, -1.0), np.full(N - 1, -1.0)], [0, 1, -1])
    model = Model(
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


def solve(folder, text, *options, name="run", ranks=None):
    (folder / f"{name}.nml").write_text(text)
    done = run("solve", f"{name}.nml", "--overwrite", *options, cwd=folder, ranks=ranks)
    assert done.status == ALL_CONVERGED, done.stderr
    with h5py.File(folder / f"{name}.h5") as file:
        return {key: file[key][()] for key in ("coefficients", "force_coefficients", "dof", "law", "residual")}


def as_matrices(model):
    """The same structure as the namelist has it."""

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


def test_sweep_of_a_law_on_a_set(chain, tmp_path):
    """On two ranks, by neighbours: each point is what it is alone."""
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
    "loads/dofs has 6, there are degrees of freedom 0 to 4": lambda f: f["loads/dofs"].__setitem__(1, 6),
    "loads/values(2) is not a finite number": lambda f: f["loads/values"].__setitem__(1, np.inf),
    "is no model file: it has no attribute 'format'": lambda f: f.attrs.__delitem__("format"),
    "has schema version 3": lambda f: f.attrs.__setitem__("schema_version", 3),
    "'mass/data' has 2 axes, not one": lambda f: replace(f, "mass/data", np.zeros((5, 1))),
    "labels must be unique": lambda f: f["labels"].__setitem__(3, "n1.z"),
    "the mass of n2.z is negative": lambda f: f["mass/data"].__setitem__(1, -1.0),
    "dataset 'labels'": lambda f: replace(f, "labels", np.zeros(5)),
}


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


def test_matrix_that_is_not_symmetric(chain, tmp_path):
    mass = chain.mass.tolil()
    mass[0, 3] = 0.25
    chain.mass = mass.tocsr()
    chain.write(tmp_path / "chain.h5")
    assert "the mass matrix must be symmetric; between n4.z and n1.z it is 0.0 one way and 0.25" in refused(tmp_path)


def test_singular_stiffness_is_an_outcome_that_says_where(chain, tmp_path):
    """Masses that nothing holds, under a constant load."""
    loose = sp.diags([np.array([1.0, 2, 2, 2, 1]), -np.ones(4), -np.ones(4)], [0, 1, -1])
    chain.stiffness = sp.csr_matrix(loose)
    chain.write(tmp_path / "chain.h5")
    (tmp_path / "run.nml").write_text(MODEL.replace("tuple = 1, 0, cos", "tuple = 0, 0, cos"))
    done = run("solve", "run.nml", cwd=tmp_path)
    assert done.status != ALL_CONVERGED
    with h5py.File(tmp_path / "run.h5") as file:
        assert b"singular" in file["message"][0].tobytes()


def make_model(name, folder):
    """Runs the script of an input with our own nhbm-model."""
    commands = folder / "commands"
    commands.mkdir()
    (commands / "nhbm-model").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nhbm.command "$@"\n')
    (commands / "nhbm-model").chmod(0o755)
    source = Path(sys.modules["nhbm"].__file__).resolve().parents[1]
    environment = {**os.environ, "PATH": f"{commands}:{os.environ['PATH']}", "PYTHONPATH": str(source)}
    done = subprocess.run([INPUTS / f"{name}.sh", folder], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_plate_that_rattles_on_four_stops(tmp_path):
    """From the script to pictures; numbers are those of the full model."""
    pytest.importorskip("skfem")
    make_model("rattling_plate", tmp_path)
    text = (INPUTS / "rattling_plate.nml").read_text()
    solve(tmp_path, text)
    with Results(tmp_path / "run.h5") as results:
        assert not failures(read_expectations(text), results)
    model = str(tmp_path / "rattling_plate.h5")
    assert post(["vtk", str(tmp_path / "run.h5"), "--model", model, "--frames", "2"]) == 0
    assert post(["deflection", str(tmp_path / "run.h5"), "--model", model, "--dpi", "40"]) == 0
    assert (tmp_path / "run_motion" / "0001.vtu").exists()
