"""Numbers that represent a point of a sweep in curves and maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .reader import QUANTITIES, Results
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

    def values(self, results: Results, dof: str) -> np.ndarray:
        """The measure at each point, NaN at points that are not solved or do not have the tuple `j`."""
        values = np.full(results.n_points, np.nan)
        if self.name == "frequency":
            for point in results.solved:
                values[point] = results.frequency_scale()[0] * results.frequency(int(point))[self.tone]
            return values
        if self.name == "multiplier":
            values[results.solved] = np.abs(results.multipliers()[results.solved, 0])
            return values
        for point, series in results.all_series(dof, self.quantity):
            series = series.without_noise(results.noise(point, self.quantity, series.units))
            if self.name == "harmonic":
                try:
                    values[point] = np.hypot(*series.harmonic(self.j))
                except KeyError:
                    continue
            else:
                values[point] = series.rms if self.name == "rms" else series.peak()
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
        return f"Largest |{symbol}|", rf"Largest {of_what.words} $\max\,|\,${dof}$\,|$"
