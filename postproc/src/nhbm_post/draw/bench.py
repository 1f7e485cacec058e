"""Cost of the kernels of a model as a function of its size."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..bench import KERNELS, Bench
from ..errors import UsageError
from ..rates import NoRate, Rate, cost_exponent
from . import style


def draw_bench(times: Bench, over: str | None = None) -> tuple[Figure, list[tuple[str, Rate | NoRate]], list[str]]:
    """Time of each kernel over `over`, the exponents observed over the larger half of the sizes, and the kernels that could not be
    drawn.

    Solid: the kernel, median of the repetitions, with a band from the shortest time to the median. Dashed: the reference costs, for
    the residual the pair of transforms, for all others the LU factorisation of a full matrix.
    """
    if not times.has_kernels:
        raise UsageError(f"{times.path}: no kernel was timed; nhbm-bench --budget 0 leaves them out, a model without laws has none")
    over = over or times.varying()
    x = times.column(over).astype(float)
    order = np.argsort(x, kind="stable")
    exponents, notes = [], []
    n_lost = int((x <= 0.0).sum())
    if n_lost:
        notes.append(f"{_points(n_lost)} with {times.axis(over)} = 0 or less not drawn: the axis is logarithmic")
    with style.look():
        fig = style.figure(7.0, 4.6)
        ax = fig.add_subplot()
        for i, kernel in enumerate(KERNELS):
            seconds = times.column(f"kernel_{kernel}_seconds")
            if kernel in ("solution", "point"):
                seconds = np.where(times.is_solved, seconds, np.nan)
            n_lost = int((seconds[x > 0.0] <= 0.0).sum())
            if n_lost:
                notes.append(f"{_points(n_lost)} of {kernel.replace('_', ' ')} with a time of 0 not drawn")
            rate = cost_exponent(x, seconds)
            exponents.append((kernel, rate))
            label = kernel.replace("newton_", "Newton ") + (f"  {rate.text('n')}" if rate else "")
            ax.plot(x[order], seconds[order], color=style.COLOURS[i], marker=style.MARKERS[i], label=label)
            least = times.column(f"kernel_{kernel}_seconds_min")
            ax.fill_between(x[order], least[order], seconds[order], color=style.COLOURS[i], alpha=0.2, linewidth=0.0)
        for kernel, label in (("residual", "pair of transforms"), ("tangent", "LU of a full matrix")):
            yardstick = times.column(f"kernel_{kernel}_yardstick")
            if np.isfinite(yardstick).any():
                grey = "0.4" if kernel == "residual" else "0.7"
                ax.plot(x[order], yardstick[order], linestyle=style.REFERENCE, color=grey, label=label)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel(times.axis(over))
        ax.set_ylabel("Time [s]")
        ax.grid(True)
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=3, borderaxespad=0.3, columnspacing=1.4)
        style.head(fig, f"Cost of the kernels: {times.title}" if times.title else "Cost of the kernels", "; ".join(notes))
    return fig, exponents, notes


def _points(n: int) -> str:
    return "1 point" if n == 1 else f"{n} points"
