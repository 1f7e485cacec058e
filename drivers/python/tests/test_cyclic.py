"""Wheels from a sector: nodal diameters against the whole wheel, waves of loads and neighbours."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from nhbm import ModelError, Structure, cyclic, examples
from nhbm.command import main
from nhbm.factors import lowest_modes
from nhbm.reduction import MODAL

N = 6


@pytest.fixture
def ring():
    """A sixth of a ring: three masses that move along x, y and z, springs between them, the last being the next one's first."""
    angles = np.array([0.0, 0.4, 1.0]) * 2 * np.pi / N
    points = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    stiffness = np.zeros((9, 9))
    for a, b in ((0, 1), (1, 2)):
        way = points[b] - points[a]
        block = np.outer(way, way) / (way @ way) + 0.3 * np.eye(3)
        i, j = slice(3 * a, 3 * a + 3), slice(3 * b, 3 * b + 3)
        stiffness[i, i] += block
        stiffness[j, j] += block
        stiffness[i, j] -= block
        stiffness[j, i] -= block
    stiffness[3:6, 3:6] += np.eye(3)
    mass = np.kron(np.diag([0.5, 2.0, 0.7]), np.eye(3))
    return Structure(
        mass=sp.csr_matrix(mass),
        stiffness=sp.csr_matrix(stiffness),
        labels=[f"n{i}.{d}" for i in (1, 2, 3) for d in "xyz"],
        node_numbers=np.array([1, 2, 3]),
        coordinates=points,
        dof_node=np.repeat([0, 1, 2], 3),
        dof_direction=list("xyz") * 3,
        cell_types=np.array([3, 3]),
        cell_starts=np.array([0, 2, 4]),
        cell_nodes=np.array([0, 1, 1, 2]),
        sets={"low": np.array([0]), "high": np.array([2]), "tip": np.array([1])},
    )


def test_nodal_diameters_are_those_of_the_whole_wheel(ring):
    sector = cyclic.sector_of(ring, N, "low", "high")
    wheel = cyclic.wheel(sector)
    full = np.sqrt(scipy.linalg.eigh(wheel.stiffness.toarray(), wheel.mass.toarray(), eigvals_only=True))
    waves = [np.repeat(cyclic.frequencies(sector, h, 6), 1 if h in (0, N // 2) else 2) for h in range(N // 2 + 1)]
    assert wheel.n_dofs == 36
    np.testing.assert_allclose(np.sort(np.concatenate(waves)), full, rtol=1e-12)


def test_wheel_is_put_together_of_turned_sectors(ring):
    """The wheel in x and y, from copies that are turned and joined by hand, has the same frequencies."""
    stiffness, mass = np.zeros((36, 36)), np.zeros((36, 36))
    for i in range(N):
        t = 2 * np.pi * i / N
        turn = np.kron(np.eye(3), [[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])
        at = np.ix_(*2 * [np.concatenate([3 * (n % 12) + np.arange(3) for n in (2 * i, 2 * i + 1, 2 * i + 2)])])
        stiffness[at] += turn @ ring.stiffness @ turn.T
        mass[at] += turn @ ring.mass @ turn.T
    wheel = cyclic.wheel(cyclic.sector_of(ring, N, "low", "high"))
    ours, other = (scipy.linalg.eigh(k, m, eigvals_only=True) for k, m in
                   ((wheel.stiffness.toarray(), wheel.mass.toarray()), (stiffness, mass)))  # fmt: skip
    np.testing.assert_allclose(ours, other, rtol=1e-12)


def test_bladed_sector_of_finite_elements():
    pytest.importorskip("skfem")
    sector = cyclic.sector_of(examples.sector(5), 5, "low", "high")
    wheel = cyclic.wheel(sector)
    values, _ = lowest_modes(wheel.stiffness, wheel.mass, 10)
    waves = np.sort(np.concatenate([np.repeat(cyclic.frequencies(sector, h, 3), 1 if h == 0 else 2) for h in range(3)]))
    np.testing.assert_allclose(waves[:10], np.sqrt(values), rtol=1e-7)  # rounding times the ratio of the highest frequency squared


def test_sets_waves_and_neighbours(ring):
    ring.sets["more"] = np.array([1, 0])
    wheel = cyclic.wheel(cyclic.sector_of(ring, N, "low", "high"))
    assert [wheel.labels[i] for i in wheel.dofs_of("tip.t")[:2]] == ["n2.t", "n5.t"]
    assert "high" not in wheel.sets and len(wheel.sets["more"]) == 2 * N
    cyclic.add_neighbours(wheel, "damper", "more", "more", N)
    assert wheel.sets["damper_2"][:2].tolist() == wheel.sets["more"][2:4].tolist()
    cyclic.add_wave(wheel, "push", "tip.z", 2, N)
    np.testing.assert_allclose(wheel.loads["push_sin"][1], np.sin(4 * np.pi * np.arange(N) / N))
    np.testing.assert_allclose(wheel.coordinates[2], [0.5, np.sqrt(0.75), 0.0])


def test_what_is_no_sector_is_refused(ring):
    with pytest.raises(ModelError, match="no node of 'low' meets one of 'high'"):
        cyclic.sector_of(ring, N + 1, "low", "high")
    with pytest.raises(ModelError, match="there is no set 'left'; sets: low, high, tip"):
        cyclic.sector_of(ring, N, "left", "high")
    with pytest.raises(ModelError, match="rotations"):
        cyclic.sector_of(dataclasses.replace(ring, dof_direction=["x", "y", "rx"] * 3), N, "low", "high")


@pytest.fixture
def dented(ring):
    """The ring with a second mass inside, so that neighbours face each other across nodes of their own."""
    model = dataclasses.replace(ring)
    k, m = (sp.block_diag([x, sp.csr_matrix((3, 3))]).tolil() for x in (model.stiffness, model.mass))
    for d in range(3):
        k[3 + d, 3 + d] += 2.0
        k[9 + d, 9 + d] += 2.5
        k[3 + d, 9 + d] = k[9 + d, 3 + d] = -2.0
        m[9 + d, 9 + d] = 0.3
    angle = 0.8 * 2 * np.pi / N
    return Structure(
        mass=m.tocsr(),
        stiffness=k.tocsr(),
        labels=[f"n{i}.{d}" for i in (1, 2, 3, 4) for d in "xyz"],
        node_numbers=np.arange(1, 5),
        coordinates=np.vstack([ring.coordinates, [[np.cos(angle), np.sin(angle), 0.0]]]),
        dof_node=np.repeat(np.arange(4), 3),
        dof_direction=list("xyz") * 4,
        sets={**ring.sets, "front": np.array([3]), "back": np.array([1])},
    )


def flexibility(model, forms, w):
    """Of linear forms (n, n_dofs) of the degrees of freedom."""
    dynamic = model.stiffness * (1 + 1e-3j) - w**2 * model.mass
    return forms @ np.linalg.solve(dynamic.toarray(), forms.T)


def forms_of(model, name):
    """Rows that pick the degrees of freedom of a name, or differences of a pair."""
    unit = np.eye(model.n_dofs)
    stem, _, direction = name.rpartition(".")
    if f"{stem}_1" in model.sets:
        return unit[model.dofs_of(f"{stem}_1.{direction}")] - unit[model.dofs_of(f"{stem}_2.{direction}")]
    return unit[model.dofs_of(name)]


NEIGHBOURS = {"joint": ("front", "back")}


def whole(model, diameter):
    wheel = cyclic.wheel(cyclic.sector_of(model, N, "low", "high"))
    cyclic.add_neighbours(wheel, "joint", "front", "back", N)
    cyclic.add_wave(wheel, "push", "low.t", diameter, N)
    return wheel


@pytest.mark.parametrize("method, n_modes, frequencies", [("craig-bampton", 9, (0.0, 0.6, 1.3)), ("free-interface", 3, (0.0,))])
def test_a_wheel_of_reduced_nodal_diameters_is_the_whole_wheel(dented, method, n_modes, frequencies):
    """At any frequency with all modes, at rest with few."""
    keep = ["joint.z", "joint.r", "low.z"]
    wanted = cyclic.Reduction(keep, n_modes, method, NEIGHBOURS, {"push": cyclic.Wave("low.t", 2)})
    ours, parts = cyclic.reduced_wheel(cyclic.sector_of(dented, N, "low", "high"), wanted)
    wheel = whole(dented, 2)
    assert len(parts) == 4 and ours.n_dofs <= 54
    np.testing.assert_allclose(ours.mass.diagonal()[3 * N :], 1.0, rtol=1e-10)
    forms = [np.vstack([forms_of(model, name) for name in keep]) for model in (ours, wheel)]
    assert forms[0].shape == (3 * N, ours.n_dofs)
    for w in frequencies:
        a, b = (flexibility(model, rows, w) for model, rows in zip((ours, wheel), forms))
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9 * abs(b).max())
        for load in ("push_cos", "push_sin"):
            a, b = (motion_under(model, load, w) for model in (ours, wheel))
            np.testing.assert_allclose(ours.recovery.matrix @ a, b, rtol=1e-8, atol=1e-9 * abs(b).max())


def motion_under(model, load, w):
    full = np.zeros(model.n_dofs)
    full[model.loads[load][0]] = model.loads[load][1]
    return np.linalg.solve((model.stiffness * (1 + 1e-3j) - w**2 * model.mass).toarray(), full)


def test_one_nodal_diameter_moves_as_the_wheel_does_under_a_wave_that_turns(dented):
    wanted = cyclic.Reduction(["joint.r", "low.t"], 9, MODAL[0], NEIGHBOURS, {"push": cyclic.Wave("low.t", 4)})
    ours, _ = cyclic.reduced_wheel(cyclic.sector_of(dented, N, "low", "high"), wanted, 4)
    wheel = whole(dented, 4)
    a, b = (motion_under(model, "push_cos", 0.7) - 1j * motion_under(model, "push_sin", 0.7) for model in (ours, wheel))
    np.testing.assert_allclose(ours.recovery.matrix @ a, b, rtol=1e-8, atol=1e-9 * abs(b).max())
    for name in ("joint.r", "low.t"):
        cosine, sine = a[ours.dofs_of(name)]
        first = (forms_of(wheel, name) @ b)[0]
        assert abs(first) > 1e-3 and cosine == pytest.approx(first, rel=1e-8) and abs(abs(sine) / abs(cosine) - 1) < 1e-8


def test_waves_and_pairs_that_cannot_be_are_refused(dented, tmp_path, capsys):
    path, out = str(tmp_path / "sector.h5"), str(tmp_path / "small.h5")
    dented.write(path)
    words = ["wheel", path, "--sectors", str(N), "-o", out, "--keep", "low.z"]
    for more, message in (
        (["--diameter", "1", "--wave", "push=low.z:2"], "wave 'push' of 2 nodal diameters: the model has 1 alone"),
        (["--neighbours", "joint=high,back"], "node 3 of 'high' is held, or belongs to the next sector"),
        (["--neighbours", "joint=back,back"], "a node that faces the sector before faces the next one, too"),
        (["--neighbours", "joint=front,side"], "there is no set 'side'"),
    ):
        assert main([*words, *more]) == 2 and message in capsys.readouterr().err
    assert main([*words[:-2], "--diameter", "1"]) == 2 and "--diameter belongs to --keep" in capsys.readouterr().err
    assert main([*words, "--wave", "push=low.z:5", "--modes", "3"]) == 0
    assert "error of the flexibility at" in capsys.readouterr().out
    assert set(Structure.read(out).loads) == {"push_cos", "push_sin"}
