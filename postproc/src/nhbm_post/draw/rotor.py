"""Bladed disk and casing (structure `rotor_stator`): amplitudes over the speed, snapshots, the wave on the casing.

All pictures are in the stationary frame, whatever the frame of the coordinates is. A blade at the angle phi on the disk is at theta
= phi + Omega t; a body whose coordinates belong to a frame of the speed S has, at theta, u = x1 cos n(theta - S t) + x2 sin n(theta
- S t).
"""

from __future__ import annotations

import numpy as np

from ..complete_input import groups
from ..errors import UsageError
from ..outcome import words
from ..reader import Results
from . import marks, style

VIEWS = ("speeds", "snapshots", "wave")
DISK, CASING = ("q1", "q2"), ("r1", "r2")
_N_SNAPSHOTS = 6
_NOMINAL_RADIUS = 4.0  # of the casing, in units of the largest motion: the model has none


class RotorStator:
    """Numbers of the structure at one point of a file, and its two waves."""

    def __init__(self, results: Results, point: int):
        self._results, self._point = results, point
        structure = _structure(results)
        if structure.get("type") != ["rotor_stator"]:
            raise UsageError(f"{results.path}: these pictures are for a structure of type 'rotor_stator'")
        laws = groups(results.input_complete, "law")
        self.n_blades = next((int(law["n_blades"][0]) for law in laws if "n_blades" in law), 0)
        self.gap = next((float(np.mean([float(gap) for gap in law["gaps"]])) for law in laws if "gaps" in law), 0.0)
        self.n_diameters = int(structure["n_diameters"][0])
        self.frequencies = [float(structure[f"{body}_frequency"][0]) for body in ("disk", "casing")]
        self.speed = float(speeds(results)[point])
        frame = structure["frame"][0]
        self._frame_speed = {
            DISK: 0.0 if frame == "stationary" else self.speed,
            CASING: self.speed if frame == "rotating" else 0.0,
        }

    @property
    def critical_speed(self) -> float:
        """Sum of both frequencies over the number of diameters: the paper's equation (14)."""
        return sum(self.frequencies) / self.n_diameters

    def displacement(self, body, theta, t) -> np.ndarray:
        """Outward displacement of `body` at angles `theta` of the stationary frame and times `t`, broadcast."""
        theta, t = np.broadcast_arrays(theta, t)
        instants, inverse = np.unique(t, return_inverse=True)
        x1, x2 = (self._results.evaluate(self._point, dof, instants)[inverse].reshape(t.shape) for dof in body)
        angle = self.n_diameters * (theta - self._frame_speed[body] * t)
        return x1 * np.cos(angle) + x2 * np.sin(angle)

    def blade_angles(self, t: float) -> np.ndarray:
        """Angles of the blades; without a law of blades, enough of them to show a wave."""
        n = self.n_blades or 8 * self.n_diameters
        return 2.0 * np.pi * np.arange(1, n + 1) / n + self.speed * t

    def wave_speed(self) -> float:
        """Angular speed of the casing's wave in the stationary frame, from its phase a short time later."""
        dt = 1e-4 / max(1.0, abs(self.speed) * self.n_diameters, *self.frequencies)
        theta = 2.0 * np.pi * np.arange(64) / 64
        before, after = (
            np.angle(np.sum(self.displacement(CASING, theta, t) * np.exp(1j * self.n_diameters * theta))) for t in (0.0, dt)
        )
        return float(np.angle(np.exp(1j * (after - before))) / (self.n_diameters * dt))

    def crest(self, t: float) -> float:
        """An angle at which the casing's wave has its maximum."""
        theta = 2.0 * np.pi * np.arange(64) / 64
        wave = np.sum(self.displacement(CASING, theta, t) * np.exp(1j * self.n_diameters * theta))
        return float(np.angle(wave) / self.n_diameters)


def speeds(results: Results) -> np.ndarray:
    """Speed of the disk at each point [rad/s]."""
    for parameter in results.parameters.values():
        if parameter.path == "structure%speed":
            return parameter.values
    return np.full(results.n_points, float(_structure(results)["speed"][0]))


def mean_radius(results: Results, point: int, body) -> float:
    """Mean over hypertime of the length of (x1, x2)."""
    order = np.abs(results.tuples).max(axis=0)
    shape = [int(8 * n + 8) for n in order]
    return float(np.hypot(*(results.on_grid(point, dof, shape) for dof in body)).mean())


def draw_rotor(results: Results, point: int, view: str = "speeds"):
    """Draws one of the VIEWS; `point` chooses the motion of `snapshots` and `wave`."""
    if view == "speeds":
        return _draw_speeds(results)
    rotor = RotorStator(results, point)
    return (_draw_snapshots if view == "snapshots" else _draw_wave)(results, rotor, point)


def _draw_speeds(results: Results):
    rotor = RotorStator(results, 0)
    solved = [int(point) for point in results.solved]
    if not solved:
        raise UsageError(f"{results.path}: no point is solved")
    omega = speeds(results)
    units = results.units("motion", DISK[0])
    tone = np.array([results.frequency(point)[0] for point in solved])
    with style.look():
        fig = style.figure(7.0, 6.4)
        above, below = fig.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for body, label, colour, marker in (
            (DISK, "disk, mean of |q|", style.COLOURS[0], "o"),
            (CASING, "casing, mean of |r|", style.COLOURS[1], "s"),
        ):
            radius = [mean_radius(results, point, body) for point in solved]
            above.semilogy(omega[solved], radius, marker, color=colour, markersize=4.2, label=label)
        for name, is_solved, points in marks.by_status(results, range(results.n_points)):
            look = marks.mark(name, is_solved).look(5.0)
            label = f"{words(name)} ({points.size})"
            if is_solved:
                for body in (DISK, CASING):
                    above.plot(omega[points], [mean_radius(results, p, body) for p in points], label=label, **look)
                    label = None
            else:
                transform = above.get_xaxis_transform()
                above.plot(omega[points], np.full(points.size, 0.03), clip_on=False, transform=transform, label=label, **look)
        below.plot(omega[solved], tone, "o", color=style.INK, markersize=4.2, label="tone of the motion")
        span = np.array([np.min(omega), np.max(omega)])
        below.plot(span, np.full(2, rotor.frequencies[0]), style.REFERENCE, color=style.COLOURS[0], label="wave of the disk alone")
        below.plot(
            span, rotor.n_diameters * span - rotor.frequencies[1], style.REFERENCE, color=style.COLOURS[1],
            label="of the casing alone, seen from the disk",
        )
        for ax in (above, below):
            ax.axvline(rotor.critical_speed, color=style.MUTED, linewidth=1.0, linestyle=style.REFERENCE)
            ax.grid(True)
        above.annotate(
            f" critical speed {rotor.critical_speed:.4g} rad/s", (rotor.critical_speed, 1.0), color=style.MUTED,
            xycoords=("data", "axes fraction"), va="top", size=8.5,
        )
        above.set_ylabel(style.with_unit("Amplitude", units))
        for ax in (above, below):
            columns = style.legend_columns(ax.get_legend_handles_labels()[1], fig.get_figwidth())
            ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=columns, borderaxespad=0.3, columnspacing=1.4)
        below.set_xlabel(r"Speed $\Omega$ [rad/s]")
        below.set_ylabel(r"Frequency $\omega$ [rad/s]")
        style.head(fig, "Limit cycles over the speed of the rotor", results.title)
    return fig


def _round(rotor: RotorStator) -> float:
    """Time of one revolution of the casing's wave."""
    speed = rotor.wave_speed()
    return 2.0 * np.pi / abs(speed) if abs(speed) > 1e-9 * abs(rotor.speed) else 2.0 * np.pi / abs(rotor.speed)


def _draw_snapshots(results: Results, rotor: RotorStator, point: int):
    theta = np.linspace(0.0, 2.0 * np.pi, 721)
    turn = _round(rotor)
    times = turn * np.arange(_N_SNAPSHOTS) / (_N_SNAPSHOTS - 1)
    largest = max(np.abs(rotor.displacement(body, theta, t)).max() for body in (DISK, CASING) for t in times)
    radius = _NOMINAL_RADIUS * largest
    speed = rotor.wave_speed()
    with style.look():
        fig = style.figure(7.4, 5.6)
        for ax, t in zip(fig.subplots(2, 3).flat, times):
            casing = radius + rotor.gap + rotor.displacement(CASING, theta, t)
            ax.fill(
                np.append(casing, np.full(theta.size, 1.5 * radius)) * np.cos(np.append(theta, theta[::-1])),
                np.append(casing, np.full(theta.size, 1.5 * radius)) * np.sin(np.append(theta, theta[::-1])),
                color="#e4e7eb", linewidth=0.0,
            )
            ax.plot(casing * np.cos(theta), casing * np.sin(theta), color=style.COLOURS[1], linewidth=1.2)
            ax.fill(0.5 * radius * np.cos(theta), 0.5 * radius * np.sin(theta), color="#c9d6e6", linewidth=0.0)
            blades = rotor.blade_angles(t)
            tips = radius + rotor.displacement(DISK, blades, t)
            for i, (angle, tip) in enumerate(zip(blades, tips)):
                reach = np.array([0.5 * radius, tip])
                is_marked = i == 0
                ax.plot(
                    reach * np.cos(angle), reach * np.sin(angle), color=style.INK if is_marked else style.COLOURS[0],
                    linewidth=2.6 if is_marked else 1.0, solid_capstyle="butt",
                )
            crest = rotor.crest(0.0) + speed * t
            casing_radius = radius + rotor.gap + float(rotor.displacement(CASING, np.array([crest]), t)[0])
            ax.plot(1.08 * casing_radius * np.cos(crest), 1.08 * casing_radius * np.sin(crest), "s", color=style.INK, markersize=5)
            ax.set_title(f"{t / turn:.1f} rounds of the wave", loc="center")
            ax.set_aspect("equal")
            ax.set_xlim(-1.5 * radius, 1.5 * radius)
            ax.set_ylim(-1.5 * radius, 1.5 * radius)
            ax.set_axis_off()
        style.head(
            fig,
            "Disk and casing in the stationary frame during one round of the casing's wave",
            f"{results.title}; speed {rotor.speed:.4g} rad/s, tone {results.frequency(point)[0]:.7g} rad/s. Square: a crest of the "
            f"wave on the casing. Black: always the same blade. The radius "
            f"{style.quantity_text(radius, results.units('motion', DISK[0]), 3)} of the disk at rest is chosen for the picture.",
        )
    return fig


def _draw_wave(results: Results, rotor: RotorStator, point: int):
    turn = _round(rotor)
    theta = np.linspace(0.0, 2.0 * np.pi, 361)
    t = np.linspace(0.0, 2.0 * turn, 401)
    wave = rotor.displacement(CASING, theta[None, :], t[:, None])
    units = results.units("motion", CASING[0])
    with style.look():
        fig = style.figure(7.0, 5.0)
        ax = fig.add_subplot()
        limit = np.abs(wave).max()
        shown = ax.pcolormesh(
            np.degrees(theta), t, wave, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="auto", rasterized=True
        )
        fig.colorbar(shown, ax=ax, label=style.with_unit("Displacement of the casing, outwards", units))
        for start, speed, look, label in (
            (rotor.crest(0.0), rotor.wave_speed(), "-", f"crest of the wave, {rotor.wave_speed():.4g} rad/s"),
            (rotor.blade_angles(0.0)[0], rotor.speed, style.REFERENCE, f"a blade, {rotor.speed:.4g} rad/s"),
        ):
            angle = np.degrees(np.mod(start + speed * t, 2.0 * np.pi))
            angle[np.append(np.abs(np.diff(angle)) > 180.0, False)] = np.nan
            ax.plot(angle, t, look, color=style.INK, linewidth=1.4, label=label)
        ax.set_xticks(np.arange(0, 361, 60))
        ax.set_xlabel("Angle in the stationary frame [degrees]")
        ax.set_ylabel("Time $t$ [s]")
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2, borderaxespad=0.3)
        style.head(
            fig,
            "Wave on the casing over angle and time",
            f"{results.title}; speed {rotor.speed:.4g} rad/s, tone {results.frequency(point)[0]:.7g} rad/s",
        )
    return fig


def _structure(results: Results) -> dict[str, list[str]]:
    """Keys of the group `&structure`."""
    return next(iter(groups(results.input_complete, "structure")), {})
