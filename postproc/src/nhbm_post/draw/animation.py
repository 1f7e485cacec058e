"""Animated motions: a structure in space, or the state on its torus, as GIF or MP4."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg

from nhbm.child_process import atomic_write

from ..errors import UsageError
from ..series import Series
from ..structure import Structure
from . import style
from .correction import draw_level
from .deflection import draw_deflection, scale_of, surface
from .motion import level_range, other_phases

ENDINGS = (".gif", ".mp4")
Update = Callable[[int], None]


def structure_in_motion(structure: Structure, fields: list[np.ndarray], times: np.ndarray, about: str):
    """(figure, function that draws frame k) for displacements (n_nodes, 3) at given times."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    sizes = [np.linalg.norm(field, axis=1) for field in fields]
    k = int(np.argmax([size.max() for size in sizes]))
    fig = draw_deflection(structure, fields[k], ("Displacement", sizes[k]), "Motion", about)
    (drawn,) = fig.axes[0].collections
    faces, scale = surface(structure.cells), scale_of(structure, fields[k])
    factor, units = style.unit_scale(float(np.ptp(times)), "s")
    with style.look():
        clock = fig.text(0.02, 0.02, "", color=style.MUTED, size=8.5)

    def update(frame: int) -> None:
        points = structure.points + scale * fields[frame]
        corners = [points[list(face)] for face in faces]
        (drawn.set_segments if isinstance(drawn, Line3DCollection) else drawn.set_verts)(corners)
        by = drawn.norm.vmax / sizes[k].max() if sizes[k].max() > 0.0 else 1.0
        drawn.set_array(by * np.array([sizes[frame][list(face)].mean() for face in faces]))
        clock.set_text(f"t = {factor * times[frame]:.3f} {units}")

    return fig, update


def hypertime_in_motion(series: Series, times: np.ndarray, about: str):
    """(figure, function that draws frame k): the state on the map of two tones, or in the phase plane for one, next to the motion
    in time."""
    factor, units = style.unit_scale(series.peak(), series.units)
    label = style.with_unit(series.axis_label, units)
    by, seconds = style.unit_scale(float(times[-1]), "s")
    n_fine = len(times) * max(20, -(-1200 // len(times)))
    fine = np.linspace(times[0], times[-1] + times[1] - times[0], n_fine + 1)  # until the first picture recurs
    with style.look():
        fig = style.figure(8.0 if series.n_tones == 1 else 8.8, 3.9)
        left, right = fig.subplots(1, 2)
        if series.n_tones > 1:
            n = 72
            grid = np.linspace(0.0, 2.0 * np.pi, n + 1)
            values = factor * np.pad(series.on_grid((n, n) + (1,) * (series.n_tones - 2)).reshape(n, n), [(0, 1)] * 2, mode="wrap")
            draw_level(left, [grid, grid], values, level_range(values), label, np.zeros(values.shape, dtype=bool))
            bar = fig.colorbar(left.collections[0], cax=style.bar_beside(left), label=style.with_unit(series.label, units))
            bar.outline.set_linewidth(0.5)
            about = ", ".join(filter(None, (about, other_phases(series.n_tones))))
            orbit = np.mod(np.outer(fine, series.omega[:2]), 2.0 * np.pi)
        else:
            velocity = series.velocity()
            of_velocity, velocity_units = style.unit_scale(velocity.peak(), velocity.units)
            orbit = np.column_stack([factor * series.evaluate(fine), of_velocity * velocity.evaluate(fine)])
            left.plot(*orbit.T, color="#b9bec7", linewidth=1.0)
            left.set(xlabel=label, ylabel=style.with_unit(velocity.axis_label, velocity_units))
            left.grid(True)
        motion = factor * series.evaluate(fine)
        right.plot(by * fine, motion, color="#b9bec7", linewidth=1.0)
        right.set(xlabel=style.with_unit("Time $t$", seconds), ylabel=label, xlim=(by * fine[0], by * fine[-1]))
        right.grid(True)
        red = style.COLOURS[1]
        (trace,) = left.plot([], [], ".", color=red, markersize=1.5, gid="trace")
        (state,) = left.plot([], [], "o", color=red, markeredgecolor="white", markersize=8, gid="state")
        (past,) = right.plot([], [], color=style.COLOURS[0], gid="past")
        (now,) = right.plot([], [], "o", color=red, markeredgecolor="white", markersize=8, gid="now")
        style.head(fig, f"{series.axis_label}: state and motion", about)

    def update(frame: int) -> None:
        end = np.searchsorted(fine, times[frame])
        end = min(int(end), fine.size - 1)
        trace.set_data(*orbit[: end + 1].T)
        state.set_data(orbit[end : end + 1, 0], orbit[end : end + 1, 1])
        past.set_data(by * fine[: end + 1], motion[: end + 1])
        now.set_data(by * fine[end : end + 1], motion[end : end + 1])

    return fig, update


def save_animation(fig, update: Update, n_frames: int, path, fps: int, dpi: int) -> Path:
    """Draws all frames and writes them; the ending of `path` chooses the format."""
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"cannot animate to '{path}': the name must end in {', '.join(ENDINGS)}")
    FigureCanvasAgg(fig)
    try:
        with style.look(), atomic_write(path) as name:
            writer = PillowWriter(fps=fps) if path.suffix.lower() == ".gif" else _mp4(fps)
            with writer.saving(fig, str(name), dpi):
                fig.draw_without_rendering()
                fig.set_layout_engine("none")
                for frame in range(n_frames):
                    update(frame)
                    writer.grab_frame()
    except OSError as error:
        raise UsageError(f"cannot write '{path}': {error.strerror or error}") from None
    return path


def _mp4(fps: int) -> FFMpegWriter:
    program = shutil.which("ffmpeg")
    if program is None:
        try:
            from imageio_ffmpeg import get_ffmpeg_exe
        except ImportError:
            raise UsageError("an .mp4 needs ffmpeg (Debian: ffmpeg; PyPI: imageio-ffmpeg); a .gif does not") from None
        program = get_ffmpeg_exe()
    matplotlib.rcParams["animation.ffmpeg_path"] = program
    # even numbers of pixels, as the encoder requires, and colours that all players support
    even = ["-vf", "scale=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p"]
    return FFMpegWriter(fps=fps, extra_args=[*even, "-loglevel", "error"])
