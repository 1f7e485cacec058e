"""A swept parameter of a result file: its values, their texts, and which points have a wanted one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .axis_words import words_of
from .text import list_text, number_text

# A given parameter value matches a stored one within this relative difference.
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Parameter:
    """One swept parameter: `name` of its dataset, `path` in the input, a float or string for each point."""

    name: str
    path: str
    units: str
    values: np.ndarray

    @property
    def is_number(self) -> bool:
        return self.values.dtype.kind == "f"

    @property
    def label(self) -> str:
        """Its path in the input, the name in texts; pictures have words."""
        return self.path or self.name

    @property
    def words(self) -> str:
        """`gap of law 1`, for pictures."""
        return words_of(self.label)[0]

    @property
    def heading(self) -> str:
        """`law(1)%gap [m]`, for axes and columns."""
        return self.label + (f" [{self.units}]" if self.has_unit else "")

    @property
    def has_unit(self) -> bool:
        return self.is_number and self.units not in ("", "1")

    def value_text(self, value) -> str:
        """A value with its unit, a string in quotes, as in the input."""
        if not self.is_number:
            return f"'{value}'"
        return number_text(value) + (f" {self.units}" if self.has_unit else "")

    def text(self, point: int) -> str:
        """`gap of law 1 = 1.5e-3 m` at a point, for titles and legends."""
        return f"{self.words} = {self.value_text(self.values[point])}"

    def range_text(self) -> str:
        """`law(1)%gap: 3 values, 1.0e-3 to 2.0e-3 m`, in the words of `nhbm info`."""
        different = list(dict.fromkeys(self.values.tolist()))
        if self.is_number:
            different = sorted(value for value in different if value == value) or [np.nan]
            ends = [number_text(different[0]), self.value_text(different[-1])]
        else:
            ends = [self.value_text(value) for value in (different[0], different[-1])]
        number = "1 value" if len(different) == 1 else f"{len(different)} values"
        return f"{self.label}: {number}, " + (ends[-1] if len(different) == 1 else " to ".join(ends))

    def fits(self, value) -> np.ndarray:
        """Points (boolean) that have `value`: equal strings, numbers equal to six digits or within a range `1.0:2.5`."""
        if not self.is_number:
            return self.values == str(value)
        first, is_range, last = str(value).partition(":")
        try:
            if is_range:
                ends = float(first or "-inf"), float(last or "inf")
                reach = _TOLERANCE * np.abs(self.values)
                return (self.values >= ends[0] - reach) & (self.values <= ends[1] + reach)
            wanted = float(value)
        except ValueError:
            return np.zeros(self.values.shape, dtype=bool)
        return np.isclose(self.values, wanted, rtol=_TOLERANCE, atol=0.0)

    def choice_text(self, value) -> str:
        """`gap of law 1 = 1.0e-3 to 2.0e-3 m` for a value that `fits` accepts, for titles."""
        texts = []
        for wanted in self.alternatives(value):
            ends = [number_text(float(end)) if end else "" for end in str(wanted).split(":")] if self.is_number else [f"'{wanted}'"]
            first, last = ends[0], ends[-1]
            texts.append(first if len(ends) == 1 else f"{first} to {last}" if first and last else f"{first}{last}")
            if len(ends) == 2 and not (first and last):
                texts[-1] += " or more" if first else " or less"
        return f"{self.words} = {', '.join(texts)}" + (f" {self.units}" if self.has_unit else "")

    def alternatives(self, value) -> list:
        """Values in the list `value`, separated by commas, unless the whole is a string of the sweep."""
        if not isinstance(value, str) or (not self.is_number and (self.values == value).any()):
            return [value]
        return [word.strip() for word in value.split(",")]

    def nearest_text(self, wanted: object) -> str:
        """The existing values; of many numbers those next to the requested one, with their points."""
        values = sorted({v for v in self.values.tolist() if v == v})
        try:
            first, second, *more = sorted(values, key=lambda value: abs(value - float(wanted)))
        except (TypeError, ValueError):
            more = []
        if len(more) <= 10:
            return "values: " + list_text([number_text(v) for v in values])
        where = self.values.tolist().index
        return "nearest: " + ", ".join(f"{number_text(v)} (point {where(v)})" for v in sorted((first, second)))
