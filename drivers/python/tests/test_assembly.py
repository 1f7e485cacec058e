"""Parts that are put together, and pairs of nodes whose relative motion is retained."""

import dataclasses

import numpy as np
import pytest

from nhbm import ModelError, assembly, reduction


@pytest.fixture
def two(chain):
    """The chain and a stiffer one that begins at its last node but one."""
    other = dataclasses.replace(chain, stiffness=3.0 * chain.stiffness, sets={"head": np.array([1, 0])})
    first = dataclasses.replace(chain, sets={"tail": np.array([10, 11])})
    return assembly.assemble({"a": first, "b": other}, {"b": (10.0, 0.0, 0.0)})


def test_parts_keep_their_matrices_and_names(two, chain):
    n = chain.n_dofs
    assert (two.stiffness[n:, n:] != 3.0 * chain.stiffness).nnz == 0 and two.stiffness[:n, n:].nnz == 0
    assert two.labels[n] == "n13.z" and two.coordinates[n, 0] == 10.0
    assert list(two.sets) == ["a_tail", "b_head"] and two.dofs_of("b_head.z") == [13, 12]
    assert two.loads["b_push"][0].tolist() == [12, 23]
    assert two.cell_nodes.max() == 23 and len(two.cell_starts) == 23


def test_nodes_that_meet_are_found(two):
    assert assembly.add_pair(two, "joint", "a_tail", "b_head") == 2
    assert two.dofs_of("joint_1.z") == [10, 11] and two.dofs_of("joint_2.z") == [12, 13]


def test_single_nodes_meet_up_to_rounding(two):
    two.sets |= {"one": two.sets["a_tail"][:1], "other": two.sets["b_head"][1:]}
    two.coordinates[two.sets["other"], 0] = np.nextafter(two.coordinates[two.sets["one"], 0], np.inf)
    assert assembly.add_pair(two, "rollers", "one", "other") == 1


def test_sets_that_do_not_meet_are_refused(two):
    two.coordinates[12:, 1] = 0.25
    with pytest.raises(ModelError, match="no node of 'a_tail' meets one of 'b_head'; the closest are 0.25 apart"):
        assembly.add_pair(two, "joint", "a_tail", "b_head")
    with pytest.raises(ModelError, match="there is no set 'tail'; sets: a_tail, b_head"):
        assembly.add_pair(two, "joint", "tail", "b_head")
    with pytest.raises(ModelError, match="there is no part 'c'; parts: a, b"):
        assembly.assemble({"a": two, "b": two}, {"c": (0, 0, 0)})


def test_meshes_that_do_not_match_are_refused(two):
    """One node of each set meets one of the other."""
    two.coordinates[13, 1] = 0.25
    with pytest.raises(ModelError, match=r"1 nodes of 'a_tail' \(2\) and 'b_head' \(2\) meet; pairs need meshes that match"):
        assembly.add_pair(two, "joint", "a_tail", "b_head")
    assert "joint_1" not in two.sets
    assert assembly.add_pair(two, "joint", "a_tail", "b_head", partial=True) == 1
    two.sets["small"] = two.sets["b_head"][1:]
    assert assembly.add_pair(two, "other", "a_tail", "small") == 1


@pytest.mark.parametrize("method", reduction.MODAL)
def test_a_pair_retains_its_relative_motion(two, method):
    """Flexibility against forces that push the two apart, at rest: that of the full model."""
    assembly.add_pair(two, "joint", "a_tail", "b_head")
    small = reduction.reduce(two, ["joint.z", "n3.z"], 6, method)
    assert small.labels[:3] == ["n25.z", "n26.z", "n3.z"] and small.dofs_of("joint.z") == [0, 1]
    apart = np.zeros((24, 3))
    apart[[10, 11, 2], [0, 1, 2]], apart[[12, 13], [0, 1]] = 1.0, -1.0
    full = apart.T @ np.linalg.solve(two.stiffness.toarray(), apart)
    np.testing.assert_allclose(np.linalg.inv(small.stiffness.toarray())[:3, :3], full, rtol=1e-10)
    motion = small.recovery.matrix @ np.linalg.solve(small.stiffness.toarray(), np.eye(small.n_dofs)[:, 0])
    np.testing.assert_allclose(motion, np.linalg.solve(two.stiffness.toarray(), apart[:, 0]), atol=1e-10)
    assert reduction.compare(two, small, [0.01]).errors[0] < 1e-4


def test_a_node_is_in_one_pair_only(two):
    assembly.add_pair(two, "joint", "a_tail", "b_head")
    two.sets |= {"more_1": two.sets["joint_1"], "more_2": np.array([4, 5])}
    with pytest.raises(ModelError, match="'more_1.z' and 'more_2.z' are no pair"):
        reduction.reduce(two, ["joint.z", "more.z"], 4)


def test_reduced_parts_are_put_together(two, chain):
    """In either order, reduction first or last: the same motion of all nodes under a force. Not with parts that are whole."""
    first, second = (dataclasses.replace(chain, stiffness=k * chain.stiffness, sets={"end": np.array([11])}) for k in (1.0, 3.0))
    parts = {name: reduction.reduce(part, ["end.z"], 3) for name, part in (("a", first), ("b", second))}
    small = assembly.assemble(parts, {"b": (10.0, 0.0, 0.0)})
    assert [label for label in small.labels if label[-1] not in "234" or label[0] == "n"] == ["n12.z", "a.q1", "n24.z", "b.q1"]
    small.validate()
    force = np.zeros(small.n_dofs)
    force[small.dofs_of("b_end.z")] = 1.0
    motion = small.recovery.matrix @ np.linalg.solve(small.stiffness.toarray(), force)
    unit = np.zeros(12)
    unit[11] = 1.0
    np.testing.assert_allclose(motion[12:], np.linalg.solve(second.stiffness.toarray(), unit), atol=1e-10)
    assert not motion[:12].any()
    assert small.recovery.node[12:].tolist() == list(range(12, 24)) and len(small.recovery.direction) == 24
    with pytest.raises(ModelError, match="part 'a' is a reduced model and 'b' is none"):
        assembly.assemble({"a": parts["a"], "b": second})
