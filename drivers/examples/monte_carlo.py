"""Statistics of a resonance peak whose gap and friction are random: 2,000 samples on two processes.

usage: monte_carlo.py [SAMPLES [PROCESSES]]

A mass on a spring, of frequency 1 rad/s, with a stop behind a gap and a slider: the gap is uniform between 0.8 and 1.6 mm, the
friction limit lognormal about 0.1 mN with a spread of 30 %. Of each sample the largest amplitude over the frequency is found.
Beside it the standard deviation to first order, from the derivatives of a single motion.
"""

import functools
import sys
import time

import numpy as np

import nhbm


def oscillator() -> nhbm.Model:
    model = nhbm.Model(nhbm.Matrices(1.0, 1.0, 0.04), tones=[1.0])
    model.load("x1", 1, cos=3e-4)
    model.law("elastic_stop", "x1", stiffness=0.5, gap=1e-3, label="stop")
    model.law("jenkins", "x1", stiffness=0.2, limit=1e-4, label="slider")
    return model


GAPS, LIMIT, SPREAD = (0.8e-3, 1.6e-3), 1e-4, 0.3  # m, N
PEAK = functools.partial(nhbm.Model.peak, of="x1 (1)", path="tones[0]", start=0.8, stop=1.4, order=7, max_step=0.1)


def first_order():
    """Returns the standard deviation [m] of the peak, from its derivatives at the middle of both values.

    Where the amplitude is largest it does not change with the frequency: its derivatives at a fixed one are those of the peak.
    """
    model = oscillator()
    model["stop.gap"], model["slider.limit"] = np.mean(GAPS), LIMIT
    model["tones[0]"] = PEAK(model).at
    slopes = model.gradient("x1 (1)", ["stop.gap", "slider.limit"], order=7).slopes
    return np.linalg.norm(slopes * [np.ptp(GAPS) / np.sqrt(12), LIMIT * SPREAD])


def main(n_samples: int = 2000, n_processes: int = 2):
    """Returns the dataset of the samples: value, the peak [m], and at, its frequency [rad/s]."""
    random = np.random.default_rng(1)
    samples = {
        "stop.gap": random.uniform(*GAPS, n_samples),
        "slider.limit": LIMIT * np.exp(SPREAD * random.standard_normal(n_samples)),
    }
    began = time.perf_counter()
    found = oscillator().sweep(samples, paired=True, of=PEAK, workers=n_processes)
    low, median, high = 1e3 * np.quantile(found["value"], [0.05, 0.5, 0.95])
    print(f"{n_samples} response curves in {time.perf_counter() - began:.1f} s on {n_processes} processes")
    print(f"peak: mean {1e3 * float(found['value'].mean()):.4f} mm, 5 % {low:.4f}, median {median:.4f}, 95 % {high:.4f} mm")
    print(f"standard deviation {1e3 * float(found['value'].std(ddof=1)):.4f} mm, to first order {1e3 * first_order():.4f} mm")
    for name in ("law_stop_gap", "law_slider_limit"):
        peak, frequency = (np.corrcoef(found[name], found[what])[0, 1] for what in ("value", "at"))
        print(f"correlation of {name} with the peak {peak:+.2f}, with its frequency {frequency:+.2f}")
    return found


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
