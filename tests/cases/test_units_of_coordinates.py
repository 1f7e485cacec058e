"""What is said about a motion does not depend on the units of a coordinate, of an equation, or of time."""

import h5py
import numpy as np
import pytest
from program import read, run, solve
from scaled_models import KINDS

SAME_ESTIMATE = 1e-5  # steps leave out what is 1e-10 of them, and are found by iteration
NOISE = 1e-9  # estimates of rounding differ by their nature
FACTS = ("status", "is_stable", "n_harmonics", "n_levels", "fallback", "stability_method")


def described(text, folder):
    folder.mkdir()
    path = solve(text, folder, status=None)
    with h5py.File(path) as file:
        facts = {name: file[name][()].tolist() for name in FACTS if name in file}
    return facts, np.array(read(path, "truncation_estimate", "aliasing_estimate"))


@pytest.mark.parametrize("settings", ["", "&harmonics order = 3 /"], ids=["by tolerance", "of an order"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_change_of_units_changes_nothing(kind, settings, tmp_path):
    rng = np.random.default_rng(list(kind.encode()))
    model = KINDS[kind](rng)
    model.rest = settings
    facts, estimates = described(model.text(model.same_units()), tmp_path / "given")
    for i in range(2):
        others = described(model.text(model.random_units(rng)), tmp_path / f"other_{i}")
        assert others[0] == facts
        assert others[1] == pytest.approx(estimates, rel=SAME_ESTIMATE, abs=NOISE, nan_ok=True)


@pytest.mark.parametrize("kind", ["cubic springs", "stops", "sliders", "gyroscopic", "nodes without mass", "coupled oscillators"])
def test_a_change_of_units_changes_no_curve(kind, tmp_path):
    rng = np.random.default_rng(list(kind.encode()))
    model = KINDS[kind](rng)
    model.rest = lambda u: (f"&harmonics order = 3 /\n&curve parameter = 'tones%frequency', from = {0.9 * u.time:.17g}, "
                            f"to = {0.8 * u.time:.17g} /")
    facts, estimates = described(model.text(model.same_units()), tmp_path / "given")
    for i in range(3):
        others = described(model.text(model.random_units(rng)), tmp_path / f"other_{i}")
        assert others[0] == facts
        assert others[1] == pytest.approx(estimates, rel=1e-4, abs=NOISE, nan_ok=True)  # positions of steps are found by iteration


LOUDSPEAKER = """
&structure type = 'matrices', n_dofs = 2, labels = 'x', 'i', units = 'm', 'A', mass = 14.35e-3, 0.0
   damping = 0.786, 0.0, {rate}, {inductance}, stiffness = 1852.0, {force}, 0.0, {resistance} /
&tones hertz = 41.0, 600.0 /
&load dof = 'i', tuple = 1, 0, cos = {first} /
&load dof = 'i', tuple = 0, 1, cos = {second} /
&law type = 'polynomial_coupled', dofs = 'x', 'i', coefficients = {coil}, {voltage}, acts_on = 'x', 'i'
   displacement_exponents = 2, 1, 2, 0, velocity_exponents = 0, 0, 1, 0 /
&accuracy tolerance = 1e-3 /
"""


@pytest.mark.parametrize(("ampere", "volt"), [(1.0, 1.0), (1e3, 1.0), (1e-3, 1e3), (1e5, 1e-5)])
def test_a_coil_is_stable_in_any_unit_of_its_current(ampere, volt, tmp_path):
    """Bl(x) = 4.95 (1 - 1e5 x**2); disturbances decay. Its gyrator damps nothing, and is no coupling in one direction."""
    bl = 4.95
    text = LOUDSPEAKER.format(rate=bl * volt, inductance=266e-6 * volt / ampere, force=-bl / ampere, resistance=3.3 * volt / ampere,
                              first=8.0 * volt, second=2.0 * volt, coil=1e5 * bl / ampere, voltage=-1e5 * bl * volt)
    (tmp_path / "case.nml").write_text(text)
    done = run("solve", "case.nml", cwd=tmp_path)
    assert [int(found[0]) for found in read(tmp_path / "case.h5", "status", "is_stable")] == [1, 1]
    assert "energy is fed" not in done.stderr + done.stdout and "one direction" not in done.stderr + done.stdout
