"""A mass on a spring with Bouc-Wen hysteresis: its multipliers against those of its period map, and its time integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from in_process import nhbm
from program import ALL_CONVERGED, run

K, RATIO, YIELD, BETA, OMEGA = 1.0, 0.1, 0.4, 0.7, 1.1


def mass(exponent):
    model = nhbm.Model(nhbm.Matrices(mass=[[1.0]], damping=[[0.05]], stiffness=[[0.3]], labels=["x"]), tones=[OMEGA])
    model.load("x", 1, cos=0.5)
    model.law("bouc_wen", "x", stiffness=K, post_yield_ratio=RATIO, yield_displacement=YIELD, exponent=exponent, beta=BETA)
    return model


def period_map(exponent):
    """Motion after a period, and the multipliers, ascending, of the map of perturbations of its start."""

    def rates(time, state):
        x, v, w = state
        bent = abs(w / YIELD) ** exponent * (1 - BETA + BETA * np.sign(w * v))
        return v, 0.5 * np.cos(OMEGA * time) - 0.05 * v - 0.3 * x - K * (RATIO * x + (1 - RATIO) * w), v * (1 - bent)

    def after(state, periods):
        end = 2 * np.pi / OMEGA * periods
        return solve_ivp(rates, (0, end), state, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.1).y[:, -1]

    start, h = after(np.zeros(3), 60), 1e-4
    matrix = np.transpose([(after(start + h * e, 1) - after(start - h * e, 1)) / (2 * h) for e in np.eye(3)])
    multipliers = np.linalg.eigvals(matrix)
    return start, sorted(multipliers, key=abs)


@pytest.mark.parametrize("exponent", [1.0, pytest.param(1.7, marks=pytest.mark.long), pytest.param(3.0, marks=pytest.mark.long)])
def test_multipliers_are_those_of_the_period_map(exponent):
    model = mass(exponent)
    model.set("sampling", samples=1024)
    model.set("stability", method="integration")
    motion = model.solve(order=31)
    start, multipliers = period_map(exponent)
    assert motion.coefficients.sel(component="cos").sum().item() == pytest.approx(start[0], rel=2e-6)
    found = (motion.multiplier_real + 1j * motion.multiplier_imag).values.ravel()
    assert abs(found[0]) == pytest.approx(abs(multipliers[-1]), rel=1e-4)
    assert found.sum().real == pytest.approx(sum(multipliers).real, abs=1e-4)
    assert motion["stability"] == "stable"


def test_a_file_has_the_multiplier_of_its_state(tmp_path):
    """Three multipliers for one mass, as in Python."""
    model = mass(1.0)
    model.set("stability", method="integration")
    motion = model.solve(order=9)
    (tmp_path / "case.nml").write_text(model.to_namelist())
    assert run("solve", "case.nml", "--set", "harmonics%order=9", cwd=tmp_path).status == ALL_CONVERGED
    stored = nhbm.open_dataset(tmp_path / "case.h5")
    assert stored.sizes["multiplier"] == motion.sizes["multiplier"] == 3
    assert stored.multiplier_real.values.ravel() == pytest.approx(motion.multiplier_real.values.ravel(), abs=1e-9)
