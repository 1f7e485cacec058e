"""All columns of some motions, as the library has filled them: one array for each column of all motions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

_ALIGNMENT = 8  # of columns in an array [bytes]


class ColumnInfo(NamedTuple):
    """What a column is: name, type, names of its axes besides that of the motions, and attributes as in a file."""

    name: str
    dtype: Any
    axes: tuple[str, ...]
    attributes: dict[str, Any]


class Layout:
    """The columns of a table of motions, those with values and the lengths of their axes, and the labels along these."""

    def __init__(self, columns: Iterable[ColumnInfo], sizes: Any, labels: Mapping[str, list[str]],
                 dofs_of_sets: Mapping[str, str]) -> None:  # fmt: skip
        self.columns = {column.name: column for column in columns}
        self.labels, self.dofs_of_sets = dict(labels), dict(dofs_of_sets)
        self.shapes: dict[str, tuple[int, ...]] = {}  # of columns with values
        self.offsets: dict[str, int] = {}  # of one motion, in a common array [bytes]
        self.n_bytes = 0
        for column, (is_known, *lengths) in zip(self.columns.values(), sizes):
            if is_known:
                self.shapes[column.name] = tuple(lengths[: len(column.axes)])
                self.offsets[column.name] = self.n_bytes
                self.n_bytes += -(-math.prod(self.shapes[column.name]) * column.dtype.itemsize // _ALIGNMENT) * _ALIGNMENT
        self.templates: dict[Any, Any] = {}  # datasets of one motion, for nhbm.dataset

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "templates": {}}

    @property
    def lengths(self) -> dict[str, int]:
        """Length of each axis along which there are values."""
        return {axis: n for name, shape in self.shapes.items() for axis, n in zip(self.columns[name].axes, shape)}

    @property
    def absent(self) -> dict[str, ColumnInfo]:
        """Columns without values."""
        return {name: column for name, column in self.columns.items() if name not in self.shapes}


class Rows:
    """Some motions: the values of each column, (motions, ...), and the message of each of them."""

    def __init__(self, layout: Layout, values: dict[str, Any], messages: list[str]) -> None:
        self.layout, self.values, self.messages = layout, values, messages

    def __len__(self) -> int:
        return len(self.messages)

    @classmethod
    def joined(cls, parts: list[Rows]) -> Rows:
        """The motions of all parts, in their order; what some of them lack is padded as the library does."""
        parts = [part for part in parts if len(part)]
        if not parts:
            raise ValueError("there are no motions to join")
        if len(parts) == 1:
            return parts[0]
        columns = {name: column for part in parts for name, column in part.layout.columns.items()}
        columns = {name: next(part.layout.columns[name] for part in parts if name in part.layout.columns) for name in columns}
        longest: dict[str, int] = {}
        labels: dict[str, list[str]] = {}
        for part in parts:
            for axis, n in part.layout.lengths.items():
                if n > longest.get(axis, -1):
                    longest[axis], labels[axis] = n, part.layout.labels.get(axis, [])
        known = [name for name in columns if any(name in part.values for part in parts)]
        shapes = {name: tuple(longest[axis] for axis in columns[name].axes) for name in known}
        sizes = [(name in shapes, *shapes.get(name, ())) for name in columns]
        layout = Layout(columns.values(), sizes, labels, parts[0].layout.dofs_of_sets)
        values = {name: np.concatenate([_padded(part, columns[name], shapes[name]) for part in parts]) for name in known}
        return cls(layout, values, [text for part in parts for text in part.messages])


def _padded(part: Rows, column: ColumnInfo, shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """A column of a part in an array of another shape: 0 for whole numbers and beyond the harmonics in use, else NaN."""
    given = part.values.get(column.name)
    if given is not None and given.shape[1:] == shape:
        return np.asarray(given)
    is_real = column.dtype.kind == "f"
    wide = np.full((len(part), *shape), np.nan if is_real else 0, column.dtype)
    if given is None:
        return wide
    if is_real and "harmonic" in column.axes:
        wide[~np.isnan(given).all(axis=tuple(range(1, given.ndim)))] = 0.0
    wide[tuple(slice(n) for n in given.shape)] = given
    return wide
