#!/usr/bin/env python3
"""Draws the pictures of the two pages of concepts (docs/start/concepts.md, docs/start/concepts_accuracy.md) by the program itself.

usage: concepts.py FOLDER      writes FOLDER/concept_*.png; for the repository: docs/site/concepts.py docs/pictures

NHBM_LIBRARY names libnhbm.so.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

import nhbm

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

TONES = (1.0, 0.5 * (1.0 + np.sqrt(5.0)))  # [rad/s]
BLUE, RED, GREY = "#1f5fa8", "#b3402a", "0.55"


def rattling() -> nhbm.Model:
    """A mass on a spring between two tones and a stop."""
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=list(TONES))
    model.load("x1", (1, 0), cos=0.05)
    model.load("x1", (0, 1), cos=0.8)
    model.law("elastic_stop", "x1", stiffness=2.0, gap=0.5)
    return model


def tuples(path: Path) -> None:
    """The motion over time, and its spectrum with the tuples of the largest lines."""
    motion = rattling().solve(order=12)
    times = np.linspace(0.0, 60.0, 3000)
    fig, (left, right) = plt.subplots(1, 2, figsize=(8.4, 2.9), layout="constrained", width_ratios=(1, 1.25))
    left.plot(times, motion.nhbm.time("x1", times), color=BLUE, lw=1.0)
    left.axhline(0.5, color=GREY, lw=0.8)
    left.text(60.0, 0.52, "stop", color=GREY, fontsize=8, ha="right", va="bottom")
    left.set(xlabel="Time [s]", ylabel="Displacement [m]", title="The motion never repeats ...")
    chosen = [(1, 0), (0, 1), (-1, 1), (2, 0), (0, 2), (1, 1), (0, 0), (0, 3), (1, 2)]
    for j in chosen:
        size, at = float(motion.nhbm.amplitude("x1", j)), abs(np.dot(j, TONES))
        right.semilogy([at, at], [1e-4, size], color=RED if j in ((1, 0), (0, 1)) else BLUE, lw=2)
        right.annotate(f"({j[0]},{j[1]})".replace("-", "−"), (at, size), (0, 3), textcoords="offset points", ha="center", fontsize=8)
    right.set(xlabel=r"Frequency $|j_1\omega_1 + j_2\omega_2|$ [rad/s]", ylabel="Amplitude [m]", ylim=(1e-4, 3.0), xlim=(-0.2, 5.2),
              title="... but has a few lines, each named by a tuple")  # fmt: skip
    fig.savefig(path / "concept_tuples.png", dpi=110)
    plt.close(fig)


def hypertime(path: Path) -> None:
    """The motion over both phases, and the line that time follows there."""
    motion = rattling().solve(order=12)
    n = 120
    tau = np.linspace(0.0, 2 * np.pi, n)
    names = motion["tuple"].values
    a, b = (motion["coefficients"].sel(dof="x1", component=part).values for part in ("cos", "sin"))
    phase = names[:, 0, None, None] * tau[None, :, None] + names[:, 1, None, None] * tau[None, None, :]
    surface = (a[:, None, None] * np.cos(phase) + b[:, None, None] * np.sin(phase)).sum(0)
    fig, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.1), layout="constrained", width_ratios=(1.15, 1))
    shown = left.pcolormesh(tau, tau, surface.T, cmap="RdBu_r", vmin=-np.abs(surface).max(), vmax=np.abs(surface).max(), rasterized=True)
    left.contour(tau, tau, surface.T, levels=[0.5], colors="k", linewidths=1.0)
    left.text(0.9, 2.9, "at the stop", fontsize=8, ha="center", color="w")
    fig.colorbar(shown, ax=left, label="Displacement [m]")
    times = np.linspace(0.0, 30.0, 6000)
    one, two = (np.mod(w * times, 2 * np.pi) for w in TONES)
    breaks = (np.abs(np.diff(one, prepend=0.0)) > 3) | (np.abs(np.diff(two, prepend=0.0)) > 3)
    left.plot(np.where(breaks, np.nan, one), np.where(breaks, np.nan, two), color="k", lw=0.6, alpha=0.7)
    left.set(xlabel=r"Phase $\tau_1 = \omega_1 t$ [rad]", ylabel=r"Phase $\tau_2 = \omega_2 t$ [rad]", title="Hypertime: both phases as axes")
    right.plot(times, motion.nhbm.time("x1", times), color="k", lw=1.0)
    right.axhline(0.5, color=GREY, lw=0.8)
    right.set(xlabel="Time [s]", ylabel="Displacement [m]", title="The same, read along the black line")
    fig.savefig(path / "concept_hypertime.png", dpi=110)
    plt.close(fig)


def estimates(path: Path) -> None:
    """True and estimated error over the order, for a mass and its stop; the true one against order 200."""
    model, fine = (nhbm.Model(nhbm.Matrices(mass=1.0, damping=0.1, stiffness=1.0), tones=[1.2]) for _ in range(2))
    for one in (model, fine):
        one.load("x1", 1, cos=0.3)
        one.law("elastic_stop", "x1", stiffness=5.0, gap=0.3)
        one.set("error_estimate", truncation=1.0, aliasing=1.0)
    fine.set("sampling", samples=8192)
    orders = np.array([3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40])
    best = _line(fine.solve(order=200), 200)
    true, estimated = [], []
    for order in orders:
        motion = model.solve(order=int(order))
        line = _line(motion, 200)
        true.append(np.linalg.norm(line - best) / np.linalg.norm(best))
        estimated.append(float(motion["truncation_estimate"] + motion["aliasing_estimate"]))
    fig, ax = plt.subplots(figsize=(5.2, 3.0), layout="constrained")
    ax.loglog(orders, true, "o-", color=BLUE, ms=4, label="true error (against order 200)")
    ax.loglog(orders, estimated, "s--", color=RED, ms=4, mfc="none", label="estimated error: truncation and aliasing")
    ax.axhline(1e-3, color=GREY, lw=0.8)
    ax.text(18.0, 1.1e-3, "tolerance = 1e-3", color=GREY, fontsize=8)
    ax.set_xticks([3, 5, 10, 20, 40], ["3", "5", "10", "20", "40"])
    ax.minorticks_off()
    ax.set(xlabel="Order: number of harmonics", ylabel="Relative error of the motion")
    ax.legend(frameon=False, fontsize=8)
    fig.savefig(path / "concept_error.png", dpi=110)
    plt.close(fig)


def _line(motion, order: int) -> np.ndarray:
    """Coefficients of all harmonics up to an order; those that the motion does not have are zero."""
    c = np.zeros((order + 1, 2))
    names = motion["tuple"].values[:, 0]
    c[np.abs(names)] = motion["coefficients"].sel(dof="x1").values
    return c


def branches(path: Path) -> None:
    """A curve with two folds, and the sweeps up and down that jump there."""
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=1.2, stiffness=3948.0), tones={"hertz": 10.0})
    model.load("x1", 1, cos=0.5)
    model.law("elastic_stop", "x1", gap=2e-3, stiffness=4000.0, label="stop")
    curve = model.curve("tones%hertz", 9.0, 12.0, order=15, peak_of="x1")
    f, size = curve["tones_hertz"].values, 1e3 * curve.nhbm.largest("x1").values
    stable, kind = (curve["stability"] != "unstable").values, curve["curve_kind"].values
    fig, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.1), layout="constrained", sharey=True)
    for ax in (left, right):
        ax.plot(f, np.where(stable, size, np.nan), color=BLUE, lw=2)
        ax.plot(f, np.where(stable, np.nan, size), "--", color=BLUE, lw=1.5)
        ax.axhline(2.0, color=GREY, lw=0.8)
        ax.set(xlabel="Excitation frequency [Hz]", xlim=(9.0, 12.0), ylim=(0, 7.5))
    left.set(ylabel="Largest displacement [mm]", title="A curve turns back at folds")
    right.set(title="A chain of points jumps there")
    for name, mark, offset in (("fold", "o", (8, -4)), ("grazing", "v", (-8, 6)), ("peak", "^", (-6, 7))):
        here = kind == name
        left.plot(f[here], size[here], mark, color=RED, mfc="none", ms=8)
        k = np.flatnonzero(here)[0]
        left.annotate(name, (f[k], size[k]), offset, textcoords="offset points", color=RED, fontsize=9,
                      ha="left" if offset[0] > 0 else "right")  # fmt: skip
    left.annotate("unstable", (10.75, 4.1), (10.95, 3.2), color=BLUE, fontsize=9, arrowprops={"arrowstyle": "-", "color": BLUE, "lw": 0.6})
    grid = np.linspace(9.0, 12.0, 31)
    for values, colour, name in ((grid, "#2f7d3b", "upwards"), (grid[::-1], "#8a4fa3", "downwards")):
        chain = model.sweep({"tones%hertz": values}, order=15, warm=True)
        right.plot(values, 1e3 * chain.nhbm.largest("x1").values, ".", color=colour, ms=6, label=name)
    right.legend(frameon=False, fontsize=9)
    fig.savefig(path / "concept_branches.png", dpi=110)
    plt.close(fig)


def main(folder: Path) -> None:
    with plt.rc_context({"font.size": 9}):
        for draw in (tuples, hypertime, estimates, branches):
            draw(folder)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    main(Path(sys.argv[1]))
