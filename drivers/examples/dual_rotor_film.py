"""Run-up of the rotor of dual_rotor.py as a film: the largest deflection of the first disk over the speed with the estimated error
and the stability of each motion, its orbit in the casing, and both shafts.

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
FRAMES, TURNS, SAMPLES = 40, 12, 120  # of the film; turns of the inner shaft and samples a turn of an orbit
ROTOR = dual_rotor.reduced()
MARKS = {"stable": ("C2", "o"), "unstable": ("C3", "s"), "unknown": ("0.5", "x")}


def run_up(start: float = 340.0, stop: float = 410.0):
    """The curve over the speed of the inner shaft of the reduced rotor with a tolerance of 1 %, all motions with their stability by
    integration of the linearised equations."""
    model = dual_rotor.model(start, ROTOR)
    model.set("stability", method="integration", tolerance=1e-3)
    return model.curve("tones%frequency(1)", start, stop, points=200, tolerance=1e-2)


def orbit(motion):
    """Deflection x, y of the first disk [um] over turns of the inner shaft."""
    times = np.linspace(0.0, TURNS * 2 * np.pi / float(motion["frequency"][0]), TURNS * SAMPLES + 1)
    return tuple(1e6 * motion.nhbm.time(dof, times).values for dof in ("n3.x", "n3.y"))


def table(curve):
    """Speed [rad/s], largest deflection of the disk [um] and estimated relative error of each point."""
    sizes = [float(np.hypot(*orbit(curve.isel(point=k))).max()) for k in range(curve.sizes["point"])]
    errors = np.hypot(curve["truncation_estimate"].values, curve["aliasing_estimate"].values)
    return curve["tones_frequency_1"].values, np.array(sizes), errors


class Picture:
    """Run-up, orbit and shafts at one speed and time."""

    def __init__(self, curve) -> None:
        self.curve, (self.speeds, self.sizes, self.errors) = curve, table(curve)
        self.figure = plt.figure(figsize=(8.0, 4.6), layout="constrained")
        grid = self.figure.add_gridspec(3, 2, height_ratios=[3, 1, 1.3])
        top, below = self.figure.add_subplot(grid[0, 0]), self.figure.add_subplot(grid[1, 0])
        top.plot(self.speeds, self.sizes, color="C0")
        for name, (color, mark) in MARKS.items():
            at = curve["stability"].values == name
            if at.any():
                top.plot(self.speeds[at], self.sizes[at], mark, color=color, ms=3.5, label=name)
        width = self.sizes * self.errors
        top.fill_between(self.speeds, self.sizes - width, self.sizes + width, color="C0", alpha=0.25, lw=0)
        top.axhline(CASING, color="k", lw=0.8)
        top.text(self.speeds[0], CASING, " casing", va="bottom", fontsize=8)
        (self.marker,) = top.plot([], [], "o", color="C1")
        top.set(ylabel="Largest deflection\nof disk 1 [µm]")
        top.legend(fontsize=7, loc="lower right")
        top.tick_params(labelbottom=False)
        below.semilogy(self.speeds, self.errors, ".-", ms=3, color="0.4", lw=0.8)
        below.axhline(1e-2, color="C3", lw=0.8)
        below.set(xlabel="Speed of the inner shaft [rad/s]", ylabel="Estimated\nerror", ylim=(1e-8, 1e-1))
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
        largest = max(abs(self.shape(len(self.speeds) - 1, turn)).max() for turn in np.arange(8) / 8)
        self.shafts.set(xlim=(0.0, 1.8), xlabel="z [m]", ylabel="x [µm]", ylim=(-1.6 * largest, 1.6 * largest))
        self.shafts.legend(fontsize=7, loc="upper center", ncols=2)
        self.shafts.grid(color="0.9")

    def shape(self, point: int, turn: float):
        """Deflection of all nodes along x [um], recovered from the reduced degrees of freedom."""
        motion = self.curve.isel(point=point)
        when = turn * 2 * np.pi / float(motion["frequency"][0])
        kept = np.array([float(motion.nhbm.time(str(dof), when)) for dof in motion["dof"].values])
        return 1e6 * (ROTOR.recovery.matrix @ kept)[::4]  # of each node: x, y and two slopes

    def show(self, point: int, turn: float) -> None:
        """Shows a point of the curve after a number of turns of the inner shaft."""
        motion = self.curve.isel(point=point)
        x, y = orbit(motion)
        at = int(turn * SAMPLES) % len(x)
        self.trace.set_data(x, y)
        self.now.set_data([x[at]], [y[at]])
        self.marker.set_data([self.speeds[point]], [self.sizes[point]])
        whole = self.shape(point, turn)
        for line, (nodes, z, _, _) in zip(self.lines, self.nodes):
            line.set_data(z, whole[nodes - 1])
        self.title.set_text(f"{self.speeds[point]:.1f} and {dual_rotor.RATIO * self.speeds[point]:.1f} rad/s, "
                            f"estimated error {self.errors[point]:.0e}")  # fmt: skip

    def film(self, path: str) -> None:
        """Writes the run-up as a GIF: frames at equal distances of the speed, an eighth of a turn after each other."""
        targets = np.linspace(self.speeds[0], self.speeds[-1], FRAMES)
        points = [int(abs(self.speeds - target).argmin()) for target in targets]
        moving = FuncAnimation(self.figure, lambda k: self.show(points[k], k / 8), frames=FRAMES)
        moving.save(path, writer=PillowWriter(fps=8), dpi=64)


def main(film: str = "dual_rotor.gif", picture: str = "dual_rotor.png") -> None:
    began = time.process_time()
    curve = run_up()
    print(f"{curve.sizes['point']} points in {time.process_time() - began:.0f} s; {curve.sizes['dof']} degrees of freedom")
    print(curve.nhbm.events("n3.x (1,0)", "n3.x (0,1)").to_string())
    for name in MARKS:
        print(f"{name}: {int((curve['stability'] == name).sum())}")
    drawn = Picture(curve)
    drawn.show(int(drawn.sizes.argmax()), 0.0)
    drawn.figure.savefig(picture, dpi=80)
    drawn.film(film)


if __name__ == "__main__":
    main(*sys.argv[1:])
