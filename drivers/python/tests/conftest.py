"""Models for the tests: from numbers where that will do, else from scikit-fem."""

import numpy as np
import pytest
import scipy.sparse as sp

from nhbm import Structure, examples


@pytest.fixture
def chain():
    """Twelve masses between walls, each a node that moves along z; nodes 2 and 5 form the set `contact`."""
    n = 12
    mass = sp.diags(np.linspace(1.0, 2.0, n))
    stiffness = sp.diags([np.full(n, 2.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], [0, 1, -1])
    return Structure(
        mass=mass,
        stiffness=stiffness,
        damping=0.01 * stiffness,
        labels=[f"n{i + 1}.z" for i in range(n)],
        node_numbers=np.arange(1, n + 1),
        coordinates=np.column_stack([np.arange(n), np.zeros(n), np.zeros(n)]),
        dof_node=np.arange(n),
        dof_direction=["z"] * n,
        cell_types=np.full(n - 1, 3),
        cell_starts=2 * np.arange(n),
        cell_nodes=np.column_stack([np.arange(n - 1), np.arange(1, n)]).ravel(),
        sets={"contact": np.array([4, 1])},
        loads={"push": (np.array([0, 11]), np.array([1.0, -0.5]))},
        source="a test",
    )


@pytest.fixture(scope="session")
def block():
    """A clamped block of quadratic tetrahedra, 324 degrees of freedom."""
    pytest.importorskip("skfem")
    return examples.solid(n_x=4, n_y=1, n_z=1)
