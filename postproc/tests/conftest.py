"""Files that several tests read."""

import numpy as np
import pytest
from synthetic import box, write_results

GAPS = [1.0e-3, 1.5e-3, 2.0e-3]


def random_coefficients(seed, n_points, n_dofs, tuples):
    """Coefficients that decay with the order, without a sine at j = 0."""
    random = np.random.default_rng(seed)
    decay = 10.0 ** -np.abs(tuples).sum(axis=1)
    values = random.uniform(-1e-3, 1e-3, (n_points, n_dofs, len(tuples), 2)) * decay[:, None]
    values[:, :, ~tuples.any(axis=1), 1] = 0.0
    return values


@pytest.fixture
def sweep(tmp_path):
    """File of `write_sweep`."""
    return write_sweep(tmp_path / "sweep.h5")


def write_sweep(path, **more):
    """Two tones, three gaps by two methods; points 3 to 5 stalled, failed, pending; 0 of lower order."""
    tuples = box(2, 3)
    coefficients = random_coefficients(1, 6, 2, tuples)
    coefficients[0][:, (np.abs(tuples) > 2).any(axis=1)] = np.nan
    coefficients[4:] = np.nan
    return write_results(
        path,
        tuples,
        np.tile([np.e, np.pi], (6, 1)),
        coefficients,
        dofs=("v1", "v3"),
        law_dofs=("v3",),
        status=[1, 1, 1, 2, 6, 0],
        messages=["", "", "", "", "dgetrf: singular matrix", ""],
        parameters={
            "law_1_gap": ("law(1)%gap", "m", GAPS + GAPS),
            "solver_method": ("solver%method", "1", ["newton"] * 3 + ["broyden"] * 3),
        },
        title="sweep of the gap",
        **more,
    )


def single(path, n_tones, order=3, seed=2, **more):
    """One converged point of `n_tones` tones."""
    tuples = box(n_tones, order)
    coefficients = random_coefficients(seed, 1, 1, tuples)
    return write_results(path, tuples, [np.sqrt([2.0, 3.0, 5.0, 7.0])[:n_tones]], coefficients, **more)


def walled(path, n_tones, n_samples=16, order=3, has_samples=True, **more):
    """One converged point cut at a wall, by default with stored surfaces."""
    tuples = box(n_tones, order)
    coefficients = random_coefficients(3, 1, 1, tuples)
    axes = [2.0 * np.pi * np.arange(n_samples) / n_samples] * n_tones
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    phase = grid @ tuples.T
    surface = np.cos(phase) @ coefficients[0, 0, :, 0] + np.sin(phase) @ coefficients[0, 0, :, 1]
    wall = surface.max() - 0.3 * np.ptp(surface)
    cut = np.minimum(surface, wall)
    corrected = np.stack(
        [(cut[..., None] * f(phase)).mean(axis=tuple(range(n_tones))) for f in (np.cos, np.sin)], axis=-1
    )
    corrected[tuples.any(axis=1)] *= 2.0
    return write_results(
        path,
        tuples,
        [np.sqrt([2.0, 3.0, 5.0])[:n_tones]],
        coefficients,
        corrected=corrected[None, None],
        **(
            {
                "samples": surface.T[None, None],
                "corrected_samples": cut.T[None, None],
                "force_samples": 0.0 * surface.T[None, None],
            }
            if has_samples
            else {}
        ),
        penetration=[surface.max() - wall],
        **more,
    )
