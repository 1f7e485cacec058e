"""Stiffness and gap of a stop from a measured response curve, by least squares on a model in process.

The measurement is made up: amplitudes of an oscillator that meets a stop of 2 N/m behind 1 mm, while the frequency rises,
with 2 % of noise. The frequencies end before the response jumps down: a jump that passes a point makes the misfit discontinuous.
"""

import time

import numpy as np
from scipy.optimize import least_squares

import nhbm

STIFFNESS, GAP, NOISE = 2.0, 1e-3, 0.02  # N/m, m
FREQUENCIES = np.linspace(0.6, 1.1, 30)  # rad/s


def oscillator() -> nhbm.Model:
    model = nhbm.Model(nhbm.Matrices(1.0, 1.0, 0.1), tones=[1.0])
    model.load("x1", 1, cos=3e-4)
    model.law("elastic_stop", "x1", stiffness=STIFFNESS, gap=GAP, label="stop")
    return model


def response(model: nhbm.Model, stiffness: float, gap: float, order: int) -> np.ndarray:
    """Amplitudes [m] along the frequencies, each solution started from the one before."""
    model["stop.stiffness"], model["stop.gap"] = stiffness, gap
    amplitudes = []
    for omega in FREQUENCIES:
        model["tones[0]"] = omega
        amplitudes.append(model.response("x1 (1)", order=order))
    return np.array(amplitudes)


def main():
    """Returns the estimates of stiffness [N/m] and gap [m], and their standard errors."""
    model, n_curves = oscillator(), 0
    random = np.random.default_rng(1)
    measured = response(model, STIFFNESS, GAP, order=21) * (1 + NOISE * random.standard_normal(len(FREQUENCIES)))

    def misfit(logarithms: np.ndarray) -> np.ndarray:
        nonlocal n_curves
        n_curves += 1
        return (response(model, *np.exp(logarithms), order=11) / measured - 1) / NOISE

    began = time.perf_counter()
    fit = least_squares(misfit, np.log([0.5, 1.5e-3]), x_scale=[1.0, 0.1], diff_step=1e-4)
    errors = np.exp(fit.x) * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    print(f"{n_curves} curves of {len(FREQUENCIES)} points in {time.perf_counter() - began:.2f} s")
    for name, value, error, truth in zip(("stiffness [N/m]", "gap [m]"), np.exp(fit.x), errors, (STIFFNESS, GAP)):
        print(f"{name}: {value:.4g} +- {error:.2g}, made with {truth:g}")
    return np.exp(fit.x), errors


if __name__ == "__main__":
    main()
