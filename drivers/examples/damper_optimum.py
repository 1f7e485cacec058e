"""The friction limit of a damper at which the resonance peak of a blade is smallest, by SciPy on a model in process: by response
curves, and by derivatives of single motions.

One mode of a blade, 0.1 kg at 100 Hz with 0.1 % of critical damping, is driven by 1 N. An underplatform damper holds it by an
elastic slider of 10 kN/m. A loose damper dissipates nothing, a stuck one neither: the optimum is between them. There the amplitude
changes neither with the limit nor, at its peak, with the frequency: two equations for two unknowns, by `Model.gradient`.
"""

import time

import numpy as np
from scipy.optimize import minimize_scalar, root

import nhbm

MASS, FREQUENCY, CONTACT_STIFFNESS = 0.1, 2 * np.pi * 100.0, 1e4  # kg, rad/s, N/m


def blade() -> nhbm.Model:
    model = nhbm.Model(nhbm.Matrices(MASS, MASS * FREQUENCY**2, 2e-3 * MASS * FREQUENCY), tones=[FREQUENCY])
    model.load("x1", 1, cos=1.0)
    model.law("jenkins", "x1", stiffness=CONTACT_STIFFNESS, limit=1.0, label="damper")
    model.set("sampling", samples=256)  # where it sticks and slips is met to a 256th of a period: fewer leave ripples on the peak
    return model


def main(order: int = 9):
    """Returns the best friction limit [N] and the resonance peak there [m]."""
    model, peaks = blade(), {}

    def peak(log_limit: float) -> float:
        limit = np.exp(log_limit)
        model["damper.limit"] = limit
        peaks[limit] = model.peak("x1 (1)", "tones[0]", 0.9 * FREQUENCY, 1.3 * FREQUENCY, order=order)
        return peaks[limit].value

    began = time.perf_counter()
    best = minimize_scalar(peak, bounds=np.log([0.2, 20.0]), method="bounded", options={"xatol": 1e-3})
    limit, found = np.exp(best.x), peaks[np.exp(best.x)]
    print(f"{len(peaks)} response curves in {time.perf_counter() - began:.2f} s")
    print(f"best limit {limit:.4g} N: peak {1e3 * found.value:.4g} mm at {found.at / (2 * np.pi):.5g} Hz")
    return limit, found.value


def by_gradients(order: int = 9):
    """Returns the best friction limit [N], the amplitude there [m], its frequency [rad/s] and the number of solutions."""
    model, amplitudes = blade(), []
    model.set("sampling", samples=1024)

    def slopes(unknowns):
        """Relative change of the amplitude by the logarithm of the limit, and by the frequency relative to that of the mode."""
        limit, model["tones[0]"] = np.exp(unknowns[0]), FREQUENCY * unknowns[1]
        model["damper.limit"] = limit
        value, (by_limit, by_frequency) = model.gradient("x1 (1)", ["damper.limit", "tones[0]"], order=order)
        amplitudes.append(value)
        return np.array([limit * by_limit, FREQUENCY * by_frequency]) / value

    began = time.perf_counter()
    # One harmonic of a slider that dissipates the most at its amplitude takes pi/2 of the load, and half of its stiffness.
    start = [np.log(np.pi / 2), np.sqrt(1 + CONTACT_STIFFNESS / 2 / (MASS * FREQUENCY**2))]
    found = root(slopes, start, tol=1e-3, options={"diag": (1, 20)})  # resonance is narrow in frequency, wide in the limit
    limit, frequency = np.exp(found.x[0]), FREQUENCY * found.x[1]
    print(f"{len(amplitudes)} solutions with derivatives in {time.perf_counter() - began:.2f} s")
    print(f"best limit {limit:.4g} N: peak {1e3 * amplitudes[-1]:.4g} mm at {frequency / (2 * np.pi):.5g} Hz")
    return limit, amplitudes[-1], frequency, len(amplitudes)


if __name__ == "__main__":
    main()
    by_gradients()
