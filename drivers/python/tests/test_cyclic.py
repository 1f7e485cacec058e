"""Wheels from a sector: nodal diameters against the whole wheel, waves of loads and neighbours."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from nhbm import Model, ModelError, cyclic, examples

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
    return Model(
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
    values = scipy.linalg.eigh(wheel.stiffness.toarray(), wheel.mass.toarray(), eigvals_only=True, subset_by_index=[0, 9])
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
