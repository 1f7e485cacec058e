"""Run-up of the rotor of dual_rotor.py as a film: the largest deflection of the first disk over the speed with estimated error and
stability, its orbit in the casing, and both shafts.

usage: python dual_rotor_film.py [FILM.gif] [PICTURE.png]
"""

import sys
import time

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.animation import FuncAnimation, PillowWriter  # noqa: E402

import dual_rotor  # noqa: E402

CASING = 12.0  # [um]
FRAMES, TURNS, SAMPLES = 60, 12, 120  # of the film; turns of the inner shaft and samples a turn of an orbit
STYLES = {"stable": ("C0", "-"), "unstable": ("C3", "--")}


def run_up(start: float = 340.0, stop: float = 410.0):
    """The curve over the speed of the inner shaft, with a tolerance of 1 %, and the seconds it took."""
    began = time.perf_counter()
    curve = dual_rotor.model(start).curve("tones%frequency(1)", start, stop, points=200, tolerance=1e-2)
    return curve, time.perf_counter() - began


def orbit(motion):
    """Deflection x, y of the first disk [um] over turns of the inner shaft."""
    times = np.linspace(0.0, TURNS * 2 * np.pi / float(motion["frequency"][0]), TURNS * SAMPLES + 1)
    return tuple(1e6 * motion.nhbm.time(dof, times).values for dof in ("n3.x", "n3.y"))


def table(curve):
    """Speed [rad/s], largest deflection of the disk [um], estimated relative error and stability of each point."""
    sizes = [float(np.hypot(*orbit(curve.isel(point=k))).max()) for k in range(curve.sizes["point"])]
    errors = np.hypot(curve["truncation_estimate"].values, curve["aliasing_estimate"].values)
    return curve["tones_frequency_1"].values, np.array(sizes), errors, curve["stability"].values


class Picture:
    """Run-up, orbit and shafts at one speed and time."""

    def __init__(self, curve) -> None:
        self.curve, (self.speeds, self.sizes, self.errors, self.stability) = curve, table(curve)
        self.figure = plt.figure(figsize=(8.0, 4.6), layout="constrained")
        grid = self.figure.add_gridspec(3, 2, height_ratios=[3, 1, 1.3])
        top, below = self.figure.add_subplot(grid[0, 0]), self.figure.add_subplot(grid[1, 0])
        for k in range(len(self.speeds) - 1):
            color, line = STYLES.get(str(self.stability[k + 1]), ("0.5", ":"))
            top.plot(self.speeds[k : k + 2], self.sizes[k : k + 2], line, color=color)
        width = self.sizes * self.errors
        top.fill_between(self.speeds, self.sizes - width, self.sizes + width, color="C0", alpha=0.25, lw=0)
        top.axhline(CASING, color="k", lw=0.8)
        top.text(self.speeds[0], CASING, " casing", va="bottom", fontsize=8)
        (self.marker,) = top.plot([], [], "o", color="C1")
        top.set(ylabel="Largest deflection\nof disk 1 [µm]")
        for name, (color, line) in STYLES.items():
            top.plot([], [], line, color=color, label=name)
        top.legend(fontsize=7, loc="lower right")
        top.tick_params(labelbottom=False)
        below.semilogy(self.speeds, self.errors, ".-", ms=3, color="0.4", lw=0.8)
        below.axhline(1e-2, color="C3", lw=0.8)
        below.set(xlabel="Speed of the inner shaft [rad/s]", ylabel="Estimated\nerror", ylim=(1e-4, 2e-2))
        for ax in (top, below):
            ax.grid(color="0.9")
        self.disk = self.figure.add_subplot(grid[:2, 1], aspect="equal")
        angle = np.linspace(0.0, 2 * np.pi, 200)
        self.disk.plot(CASING * np.cos(angle), CASING * np.sin(angle), "k", lw=1.5)
        (self.trace,) = self.disk.plot([], [], color="C0", lw=0.6)
        (self.now,) = self.disk.plot([], [], "o", color="C1")
        reach = 1.1 * max(self.sizes.max(), CASING)
        self.disk.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x of disk 1 [µm]", ylabel="y [µm]")
        self.title = self.disk.set_title("", fontsize=9)
        self.shafts = self.figure.add_subplot(grid[2, :])
        self.nodes = [(np.arange(1, 38), np.linspace(0.0, 1.8, 37), "C0", "inner shaft"),
                      (np.arange(38, 57), np.linspace(0.5, 1.4, 19), "C2", "outer shaft")]  # fmt: skip
        self.lines = [self.shafts.plot([], [], color=color, lw=2, label=name)[0] for _, _, color, name in self.nodes]
        self.shafts.set(xlim=(0.0, 1.8), xlabel="z [m]", ylabel="x [µm]", ylim=(-1.6 * reach, 1.6 * reach))
        self.shafts.legend(fontsize=7, loc="lower center", ncols=2)
        self.shafts.grid(color="0.9")

    def show(self, point: int, turn: float) -> None:
        """Shows a point of the curve after a number of turns of the inner shaft."""
        motion = self.curve.isel(point=point)
        x, y = orbit(motion)
        at = int(turn * SAMPLES) % len(x)
        self.trace.set_data(x, y)
        self.now.set_data([x[at]], [y[at]])
        self.marker.set_data([self.speeds[point]], [self.sizes[point]])
        when = turn * 2 * np.pi / float(motion["frequency"][0])
        for line, (nodes, z, _, _) in zip(self.lines, self.nodes):
            line.set_data(z, [1e6 * float(motion.nhbm.time(f"n{node}.x", when)) for node in nodes])
        self.title.set_text(f"{self.speeds[point]:.1f} and {dual_rotor.RATIO * self.speeds[point]:.1f} rad/s, "
                            f"{self.stability[point]}, error {self.errors[point]:.0e}")  # fmt: skip

    def film(self, path: str) -> None:
        """Writes the run-up as a GIF: frames at equal distances of the speed, an eighth of a turn after each other."""
        targets = np.linspace(self.speeds[0], self.speeds[-1], FRAMES)
        points = [int(abs(self.speeds - target).argmin()) for target in targets]
        moving = FuncAnimation(self.figure, lambda k: self.show(points[k], k / 8), frames=FRAMES)
        moving.save(path, writer=PillowWriter(fps=8), dpi=64)


def main(film: str = "dual_rotor.gif", picture: str = "dual_rotor.png") -> None:
    curve, seconds = run_up()
    print(f"{curve.sizes['point']} points in {seconds:.0f} s; degrees of freedom: {curve.sizes['dof']}")
    print(curve.nhbm.events("n3.x (1,0)", "n3.x (0,1)").to_string())
    drawn = Picture(curve)
    drawn.show(int(drawn.sizes.argmax()), 0.0)
    drawn.figure.savefig(picture, dpi=80)
    drawn.film(film)


if __name__ == "__main__":
    main(*sys.argv[1:])
