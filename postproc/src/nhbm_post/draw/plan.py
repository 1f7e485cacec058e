"""Forecast of a run over many ranks: the table of `nhbm plan` as a picture."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ..errors import ReaderError
from . import style

# Shares of the time of all ranks, from the bottom up.
_SHARES = (
    ("efficiency", "solving"),
    ("drawing", "at shared counters"),
    ("writing", "writing results"),
    ("idle", "idle"),
)


def read_plan(path) -> dict[str, np.ndarray]:
    """Columns of a table that `nhbm plan -o` has written, by their names, sorted by ranks."""
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        table = {name: np.array([float(row[name]) for row in rows]) for name in (rows[0] if rows else {})}
    except OSError as error:
        raise ReaderError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, ValueError, TypeError, csv.Error):
        raise ReaderError(f"{path}: no table of nhbm plan; write one by nhbm plan INPUT -o {path.name}") from None
    missing = [name for name in ("ranks", "points", "seconds", *(n for n, _ in _SHARES)) if name not in table]
    if missing:
        raise ReaderError(f"{path}: no table of nhbm plan, it lacks {', '.join(missing)}")
    order = np.argsort(table["ranks"])
    return {name: values[order] for name, values in table.items()}


def draw_plan(path):
    """Efficiency and wall time over the number of ranks, and where the time of all ranks goes."""
    table = read_plan(path)
    ranks = table["ranks"]
    with style.look():
        fig = style.figure(7.2, 3.6)
        style.head(
            fig,
            "Forecast of a run over MPI ranks",
            f"{table['points'][0]:.3g} points; {Path(path).name}",
        )
        left, right = fig.subplots(1, 2)
        bottom = np.zeros_like(ranks)
        for (name, label), colour in zip(_SHARES, (style.COLOURS[0], style.COLOURS[2], style.COLOURS[1], "#d9dce1")):
            top = bottom + 100.0 * table[name]
            left.fill_between(ranks, bottom, top, color=colour, lw=0, label=label)
            bottom = top
        left.plot(ranks, 100.0 * table["efficiency"], color=style.INK, marker="o", ms=3)
        left.set(xscale="log", ylim=(0, 100), xlabel="ranks", ylabel="time of all ranks [%]", title="(a) where it goes")
        left.margins(x=0.0)
        left.legend(loc="lower left", frameon=True, framealpha=0.9)
        right.loglog(ranks, table["seconds"], color=style.COLOURS[0], marker="o", ms=3, label="forecast")
        ideal = table["seconds"][0] * table["efficiency"][0] * ranks[0] / ranks
        right.loglog(ranks, ideal, color=style.MUTED, ls="--", lw=1.0, label="solving alone, evenly shared")
        right.set(xlabel="ranks", ylabel="wall time [s]", title="(b) how long it takes")
        right.grid(True)
        right.legend(loc="upper right")
    return fig
