"""Findings of check for sound models and for others."""

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from nhbm import Structure, examples
from nhbm.checks import check
from nhbm.command import main
from nhbm.reduction import reduce


def bad(model):
    return [finding.text for finding in check(model) if finding.is_bad]


def texts_of(model):
    return "\n".join(finding.text for finding in check(model))


def test_sound_chain(chain):
    assert bad(chain) == []
    assert "0 rigid body modes" in texts_of(chain)
    assert "mass that moves along z: 18" in texts_of(chain)


def test_degrees_of_freedom_without_mass_are_no_fault(chain):
    mass = chain.mass.diagonal()
    mass[3] = 0.0
    light = dataclasses.replace(chain, mass=sp.diags(mass))
    assert bad(light) == [] and "1 degrees of freedom have none" in texts_of(light) and "lowest frequencies" in texts_of(light)


def test_asymmetry_is_named(chain):
    mass = chain.mass.tolil()
    mass[2, 5] = 0.1
    assert "mass is not symmetric: between n3.z and n6.z it is 0.1 one way and 0 the other" in bad(
        dataclasses.replace(chain, mass=mass)
    ) or "between n6.z and n3.z" in texts_of(dataclasses.replace(chain, mass=mass))


def test_indefinite_mass(chain):
    mass = chain.mass.tolil()
    mass[0, 1] = mass[1, 0] = 3.0
    assert any("negative kinetic energy" in text for text in bad(dataclasses.replace(chain, mass=mass)))


def test_indefinite_stiffness(chain):
    stiffness = chain.stiffness.tolil()
    stiffness[0, 0] = -3.0
    assert any("indefinite" in text for text in bad(dataclasses.replace(chain, stiffness=stiffness)))


def test_empty_degree_of_freedom_is_named(chain):
    keep = sp.diags([0.0 if i == 6 else 1.0 for i in range(12)])
    model = dataclasses.replace(chain, mass=keep @ chain.mass @ keep, stiffness=keep @ chain.stiffness @ keep)
    assert any(text.startswith("n7.z has neither mass nor stiffness") for text in bad(model))


@pytest.mark.parametrize("clamped, n", [("none", 6), ("left", 0)])
def test_rigid_body_modes(clamped, n):
    pytest.importorskip("skfem")
    assert f"{n} rigid body modes" in texts_of(examples.solid(n_x=4, n_y=2, n_z=1, clamped=clamped))


def test_a_reduced_model_has_no_density():
    """Its coordinates are modes and a few nodes: their masses are not that of the body."""
    pytest.importorskip("skfem")
    block = examples.solid(n_x=2, n_y=1, n_z=1)
    assert "that of m, kg, s" in texts_of(block)
    small = reduce(block, [block.labels[-1]], 4)
    assert "mass over" not in texts_of(small) and "mass that moves" not in texts_of(small)


def test_units_by_plausibility():
    pytest.importorskip("skfem")
    assert "that of m, kg, s" in texts_of(examples.solid(n_x=2, n_y=1, n_z=1))
    small = examples.solid(200.0, 40.0, 20.0, 2, 1, 1, young=2.1e5, density=7.85e-9)
    assert "that of mm, t, s" in texts_of(small)


def test_exit_status(chain, tmp_path, capsys):
    chain.write(tmp_path / "good.h5")
    assert main(["check", str(tmp_path / "good.h5")]) == 0
    dataclasses.replace(chain, mass=-1.0 * chain.mass).write(tmp_path / "bad.h5")
    assert main(["check", str(tmp_path / "bad.h5")]) == 1
    assert "wrong: the mass of n12.z is negative: -2" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "none.h5")]) == 2
    assert "does not exist" in capsys.readouterr().err


def test_models_without_nodes():
    model = Structure(mass=sp.identity(2), stiffness=sp.csr_matrix(np.array([[1.0, -1.0], [-1.0, 1.0]])), labels=["a", "b"])
    assert "1 rigid body mode" in texts_of(model)
