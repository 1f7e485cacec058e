"""The examples of drivers/examples in Python: their results are compared with those of other methods."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)
os.environ["NHBM_LIBRARY"] = str(LIBRARY)
FOLDER = Path(__file__).resolve().parents[2] / "drivers" / "examples"
sys.path.insert(0, str(FOLDER))

import damper_optimum  # noqa: E402
import dual_rotor  # noqa: E402
import monte_carlo  # noqa: E402
import nhbm.reduction  # noqa: E402

PROCESSES = {"PYTHONPATH": os.pathsep.join([str(FOLDER), str(FOLDER.parent / "python" / "src"), os.environ.get("PYTHONPATH", "")])}


@pytest.mark.long  # seconds
def test_damper_optimum_is_that_of_the_ridge():
    """The ridge of peaks over the friction limit has its minimum where SciPy finds it."""
    limit, peak = damper_optimum.main(order=5)
    first = damper_optimum.FREQUENCY
    ridge = damper_optimum.blade().curve(
        "damper.limit", 1.75, 1.3, follow="peak", over="tones[0]", over_from=0.9 * first, over_to=1.3 * first, peak_of="x1 (1)",
        max_step=0.04, order=5,
    )  # fmt: skip
    peaks, limits = ridge.nhbm.amplitude("x1").values, ridge["law_damper_limit"].values
    lowest = np.polynomial.Polynomial.fit(*(v[np.abs(limits - limits[peaks.argmin()]) < 0.2] for v in (limits, peaks)), 4)
    at = np.linspace(limits[peaks.argmin()] - 0.1, limits[peaks.argmin()] + 0.1, 2001)
    assert abs(lowest(at).min() / peak - 1) < 1e-3
    assert abs(at[lowest(at).argmin()] / limit - 1) < 0.02


@pytest.mark.long
def test_damper_optimum_by_derivatives_takes_few_solutions():
    """The peak of the response curve is the amplitude found, and it grows with the limit in both directions."""
    limit, amplitude, frequency, n_solutions = damper_optimum.by_gradients()
    assert n_solutions < 15
    model = damper_optimum.blade()
    model.set("sampling", samples=1024)
    peaks = []
    for factor in (0.97, 1.0, 1.03):
        model["damper.limit"] = factor * limit
        first = damper_optimum.FREQUENCY
        peaks.append(model.peak("x1 (1)", "tones[0]", first, 1.15 * first, order=9))
    assert peaks[1].value == pytest.approx(amplitude, rel=1e-4)
    assert peaks[1].at == pytest.approx(frequency, rel=1e-3)
    assert peaks[1].value < min(peaks[0].value, peaks[2].value)


@pytest.mark.long
def test_first_order_deviation_is_that_of_samples(monkeypatch):
    """2,000 samples determine their standard deviation to 1.6 %; the rest is nonlinear."""
    for name, value in PROCESSES.items():
        monkeypatch.setenv(name, value)
    assert float(monte_carlo.main()["value"].std(ddof=1)) == pytest.approx(monte_carlo.first_order(), rel=0.08)


@pytest.mark.long
def test_samples_are_those_of_models_of_their_own(monkeypatch):
    """Peaks of samples on two processes equal those of curves with a tolerance of new models."""
    for name, value in PROCESSES.items():
        monkeypatch.setenv(name, value)
    found = monte_carlo.main(n_samples=6, n_processes=2)
    for k in (0, 5):
        model = monte_carlo.oscillator()
        model["stop.gap"], model["slider.limit"] = float(found["law_stop_gap"][k]), float(found["law_slider_limit"][k])
        curve = model.curve("tones[0]", 0.8, 1.4, peak_of="x1 (1)", tolerance=1e-3)
        assert float(curve.nhbm.amplitude("x1").max()) == pytest.approx(float(found["value"][k]), rel=5e-3)
        assert float(found["at"][k]) == pytest.approx(
            float(curve["tones_frequency"][curve.nhbm.amplitude("x1").argmax("point")]), rel=5e-3
        )


@pytest.mark.long  # seconds
def test_a_dual_rotor_runs_up_with_its_rub():
    """Below and above the speed at which the disk reaches the casing; the motion at a tenth of the tolerance agrees within it."""
    motions = dual_rotor.main(speeds=[350.0, 400.0, 430.0])
    assert motions.sizes["dof"] == 224 and motions.nhbm.is_converged.all()
    pushed = abs(motions["force_coefficients"]).sel(law_dof="n3.x").max(("harmonic", "component")).values
    assert pushed[0] == pytest.approx(0.0, abs=1e-9) and pushed[2] > 1.0  # N
    finer = dual_rotor.main(speeds=[430.0], tolerance=1e-3)
    for tuple_ in ((1, 0), (0, 1)):
        found, exact = (m.nhbm.amplitude("n3.x", tuple_).values[-1] for m in (motions, finer))
        assert found == pytest.approx(exact, rel=1e-2)
    curve = dual_rotor.model(300.0).curve("tones%frequency(1)", 300.0, 330.0)  # 10 s
    assert curve.nhbm.is_converged.all() and float(curve["tones_frequency_1"][-1]) == 330.0


@pytest.mark.long
def test_the_reduced_dual_rotor_moves_as_the_whole(tmp_path):
    """Below and in the rub; stable by integration of its linearised equations."""
    speeds = [350.0, 400.0]
    whole = dual_rotor.model(speeds[0]).sweep({"tones%frequency(1)": speeds}, tolerance=1e-2)
    model = dual_rotor.model(speeds[0], dual_rotor.reduced())
    model.set("stability", method="integration", tolerance=1e-3)
    small = model.sweep({"tones%frequency(1)": speeds}, tolerance=1e-2)
    assert small.sizes["dof"] == 16 and (small["stability"] == "stable").all()
    for tuple_ in ((1, 0), (0, 1)):
        np.testing.assert_allclose(small.nhbm.amplitude("n3.x", tuple_), whole.nhbm.amplitude("n3.x", tuple_), rtol=5e-3)


@pytest.mark.long  # seconds
def test_disturbances_that_beat_have_a_verdict():
    """Four modes and the rollers by the nodes of both shafts: pairs of modes are close to each other, and averages of growth over
    the usual 100 periods differ by their beats. Averages over 1600 periods are -2.431 and -1.937, each twice, to three digits."""
    kept = ["inner1.x", "inner1.y", "outer1.x", "outer1.y", "disk1.x", "disk1.y"]
    structure = nhbm.reduction.reduce(dual_rotor.rotor().structure(), kept, n_modes=4)
    model = dual_rotor.model(364.85, structure)
    model.set("stability", method="integration", tolerance=1e-3)
    motions = model.sweep({"tones%frequency(1)": [364.85, 388.095]}, tolerance=1e-2)
    exponents = motions["exponent"].values
    assert (motions["stability"] == "stable").all() and (np.diff(exponents, axis=1) <= 0).all()
    assert (np.abs(exponents[:, 0] - [-2.431, -1.937]) <= 3*motions.nhbm.details["stability_estimate"].values + 0.01).all()
