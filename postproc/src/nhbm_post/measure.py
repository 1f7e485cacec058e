"""Numbers that represent a point of a sweep in curves and maps."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from nhbm.hypertime import peaks

from .reader import QUANTITIES, Results
from .series import Series
from .text import tuple_text

MEASURES = ("peak", "rms", "harmonic", "frequency", "multiplier")


@dataclass(frozen=True)
class Measure:
    """The quantity: `peak`, `rms`, `harmonic` with its tuple `j`, `frequency` of `tone` (from 0), or the
    magnitude of the largest Floquet `multiplier`."""

    name: str = "peak"
    j: tuple[int, ...] | None = None
    tone: int = 0
    quantity: str = "motion"

    def values(self, results: Results, dof: str, points: Sequence[int] | None = None) -> np.ndarray:
        """The measure at each point (or at some), NaN at points that are not solved or do not have the tuple `j`."""
        values = np.full(results.n_points, np.nan)
        solved = results.solved if points is None else np.intersect1d(results.solved, points)
        if self.name == "frequency":
            values[solved] = results.frequency_scale()[0] * results.column("frequency")[solved, self.tone]
            return values
        if self.name == "multiplier":
            values[solved] = np.abs(results.multipliers()[solved, 0])
            return values
        alike: dict[bytes, list[tuple[int, Series]]] = {}  # by their tuples
        for point, series in results.all_series(dof, self.quantity, solved):
            series = series.without_noise(results.noise(point, self.quantity, series.units))
            if self.name == "harmonic":
                with contextlib.suppress(KeyError):
                    values[point] = np.hypot(*series.harmonic(self.j))
            elif self.name == "rms":
                values[point] = series.rms
            else:
                alike.setdefault(series.tuples.tobytes(), []).append((point, series))
        for found in alike.values():
            cos, sin = (np.array([getattr(series, name) for _, series in found]) for name in ("cos", "sin"))
            values[[point for point, _ in found]] = peaks(found[0][1].tuples, cos, sin)[0]
        return values

    def units(self, results: Results, dof: str) -> str:
        if self.name == "multiplier":
            return "1"
        return results.frequency_scale()[1] if self.name == "frequency" else results.units(self.quantity, dof)

    def words(self, results: Results, dof: str) -> tuple[str, str]:
        """(description, axis label)."""
        of_what = QUANTITIES[self.quantity]
        symbol = of_what.symbol.format(dof)
        if self.name == "frequency":
            letter = "f" if results.in_hertz else r"\omega"
            if results.n_tones == 1:
                return "Frequency of the tone", f"Frequency of the tone ${letter}$"
            return f"Frequency of tone {self.tone + 1}", f"Frequency of tone {self.tone + 1} ${letter}_{{{self.tone + 1}}}$"
        if self.name == "multiplier":
            return "Largest Floquet multiplier", r"Largest Floquet multiplier $|\mu|$"
        if self.name == "harmonic":
            j = tuple_text(self.j)
            return f"Amplitude of harmonic {j} of {symbol}", rf"Amplitude $|c_{{{j}}}|$ of {symbol}"
        if self.name == "rms":
            return f"Root mean square of {symbol}", f"Rms {of_what.words} of {dof}"
        return f"Largest |{symbol}|", f"Largest {of_what.words} max|{dof}|"
