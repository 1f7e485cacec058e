"""Multipliers beside the unit circle."""

import h5py
import numpy as np
import pytest
from test_response import grid_file, head_of

from nhbm_post import Results, UsageError
from nhbm_post.cli import main
from nhbm_post.draw import draw_multipliers


def add_stability(path, is_stable, multipliers=None):
    with h5py.File(path, "r+") as file:
        file["is_stable"] = np.asarray(is_stable, dtype=np.int32)
        if multipliers is not None:
            file["multiplier_real"] = np.real(multipliers)
            file["multiplier_imag"] = np.imag(multipliers)
    return path


def test_multipliers_stand_beside_the_unit_circle(tmp_path):
    values = np.array([[0.5 + 0.5j, 0.5 - 0.5j], [-1.5, -0.2], [6.0j, 0.1], [np.nan, np.nan]])
    path = add_stability(grid_file(tmp_path / "a.h5", n_gaps=1, n_speeds=4), [1, -1, -1, 0], values)
    with Results(path) as results:
        fig = draw_multipliers(results)
        some = draw_multipliers(results, where={"tones%frequency": "1"})
    spots = {c.get_gid(): c.get_offsets() for ax in fig.axes for c in ax.collections if c.get_gid()}
    np.testing.assert_allclose(spots["inside"], [[0.5, 0.5], [0.5, -0.5], [-0.2, 0.0], [0.1, 0.0]])
    np.testing.assert_allclose(spots["outside"], [[-1.5, 0.0], [0.0, 3.0]], atol=1e-12)
    assert "3 points, 2 unstable" in head_of(fig) and "1 multipliers above 3 are clipped to 3" in head_of(fig)
    assert "1 point, 0 unstable" in head_of(some)


@pytest.mark.parametrize(("spread", "n_insets"), [(0.02, 1), (0.9, 0)])
def test_multipliers_that_stand_close_together_are_enlarged(tmp_path, spread, n_insets):
    values = np.array([[-0.99], [-1.0 + spread * 1j], [-1.0 - spread]])
    path = add_stability(grid_file(tmp_path / "a.h5", n_gaps=1, n_speeds=3), [1, -1, -1], values)
    with Results(path) as results:
        insets = draw_multipliers(results).axes[0].child_axes
    assert [sum(len(c.get_offsets()) for c in ax.collections) for ax in insets] == [3] * n_insets


def test_multipliers_are_drawn_by_the_command_or_refused(tmp_path, capsys):
    path = grid_file(tmp_path / "a.h5", n_gaps=1, n_speeds=2)
    assert main(["multipliers", str(path)]) == 2
    assert "there are no multipliers" in capsys.readouterr().err
    add_stability(path, [1, 0], np.array([[0.3, 0.2], [np.nan, np.nan]]))
    assert main(["multipliers", str(path), "--dpi", "40"]) == 0
    assert (tmp_path / "a_multipliers.png").exists()
    with Results(path) as results, pytest.raises(UsageError, match="none of the chosen points .*; .*integration"):
        draw_multipliers(results, where={"tones%frequency": "2"})
