"""Reads the files of `nhbm-bench`, result files that also contain the costs of the points, and computes errors against a
reference."""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from .errors import ReaderError, UsageError
from .hdf5 import open_file, strings_of, text_of
from .outcome import CONVERGED, SOLVED
from .reader import SCHEMA_VERSION
from .text import number_text

KERNELS = ("residual", "tangent", "newton_step", "solution", "point")
# Quantities over which a cost may be drawn, and their axis labels; swept parameters are labelled by their paths.
SIZES = {
    "n_unknowns": "Number of unknowns $n$",
    "n_harmonics": "Number of harmonics",
    "n_tones": "Number of tones",
    "bench_n_samples": "Number of samples of the torus",
    "bench_n_channels": "Number of motions transformed at once",
}


@dataclass(frozen=True)
class Curve:
    """Points that differ in one quantity only, in ascending order of it."""

    label: str
    points: np.ndarray


@dataclass(frozen=True)
class Motion:
    """Coefficients by their tuples: `values` (dof, tuple, 2); NaN: unknown."""

    dofs: list[str]
    tuples: np.ndarray
    values: np.ndarray


class Bench:
    """Points of one file of `nhbm-bench`, or of several files with the same columns in sequence."""

    def __init__(self, *paths: str | os.PathLike):
        self.path = Path(paths[0])
        files = [self._read(Path(path)) for path in paths]
        self.title, _, self._paths, self.units = files[0][:4]
        names = [name for name in files[0][1] if all(name in file[1] for file in files)]
        self._columns = {name: np.concatenate([file[1][name] for file in files]) for name in names}
        self._motions = [motion for file in files for motion in file[4]]
        self._improved = [motion for file in files for motion in file[5]]
        self.n_points = len(self._motions)

    @staticmethod
    def _read(path: Path):
        with open_file(path) as file:
            if "bench_total_seconds" not in file:
                raise ReaderError(f"{path}: no file of 'nhbm-bench'")
            version = int(np.ravel(file.attrs["schema_version"])[0])
            if version != SCHEMA_VERSION:
                raise ReaderError(f"{path}: schema version {version}; this nhbm-post reads version {SCHEMA_VERSION}")
            n = file["point"].shape[0]
            columns = {
                name: dataset[()] if dataset.dtype.kind in "fiu" else np.array(strings_of(dataset[()]), dtype=object)
                for name, dataset in file.items()
                if isinstance(dataset, h5py.Dataset) and dataset.shape == (n,)
            }
            columns["n_tones"] = np.full(n, file["tone"].shape[0])
            paths = {text_of(file[name].attrs["parameter"]): name for name in columns if "parameter" in file.get(name, file).attrs}
            dofs, law_dofs = strings_of(file["dof"][()]), strings_of(file["law_dof"][()])
            motions = [_motion(file, dofs, point) for point in range(n)]
            improved = file["improved_coefficients"][()] if "improved_coefficients" in file else np.full((n, 0, 0, 2), np.nan)
            units = text_of(file["coefficients"].attrs.get("units", ""))
            return (
                text_of(file.attrs.get("title", "")), columns, paths, units, [_at(law_dofs, motion) for motion in motions],
                [Motion(law_dofs[: len(own)], motion.tuples[: own.shape[1]], own) for motion, own in zip(motions, improved)],
            )  # fmt: skip

    def column(self, name: str) -> np.ndarray:
        """A column by its name, such as `bench_total_seconds`; a swept parameter also by its path or the end of the path."""
        for path, column in self._paths.items():
            if name in (path, path.split("%")[-1]):
                name = column
        if name not in self._columns:
            known = ", ".join([*(size for size in SIZES if size in self._columns), *self._paths])
            raise ReaderError(f"{self.path}: no column '{name}'; sizes of this file: {known}")
        return self._columns[name]

    @property
    def is_solved(self) -> np.ndarray:
        """Whether each point is solved, within the limits of the error estimate or not."""
        return np.isin(self.column("status"), SOLVED)

    @property
    def is_converged(self) -> np.ndarray:
        return self.column("status") == CONVERGED

    @property
    def has_kernels(self) -> bool:
        return "kernel_point_seconds" in self._columns

    def varying(self) -> str:
        """Default abscissa: the first swept number that varies, otherwise the first size that does."""
        for name in (*self._paths, *SIZES):
            column = self._columns.get(self._paths.get(name, name))
            if column is not None and column.dtype.kind in "fiu" and len(set(column.tolist())) > 1:
                return name
        return "n_unknowns"

    def axis(self, over: str) -> str:
        """Label of an axis."""
        return SIZES.get(over, over)

    def curves(self, over: str) -> list[Curve]:
        """Points along `over`, one curve for each combination of all other swept parameters."""
        x = self.column(over).astype(float)
        rest = {path: self._columns[name] for path, name in self._paths.items() if self._columns[name] is not self.column(over)}
        rest = {path: column for path, column in rest.items() if len(set(column.tolist())) > 1}
        keys = [tuple(column[i] for column in rest.values()) for i in range(self.n_points)]
        curves = []
        for key in dict.fromkeys(keys):
            points = np.array([i for i in range(self.n_points) if keys[i] == key])
            words = [value if isinstance(value, str) else f"{path} = {number_text(value)}" for path, value in zip(rest, key)]
            curves.append(Curve(", ".join(words) or "all points", points[np.argsort(x[points], kind="stable")]))
        return curves

    def motion(self, point: int) -> Motion:
        """Motion at the degrees of freedom of the laws; without laws at all stored ones."""
        return self._motions[point]

    def errors(self, reference: Motion | None = None, *, only_known: bool = False, is_improved: bool = False) -> np.ndarray:
        """Relative rms difference of each point from a reference, over hypertime; NaN for unsolved points.

        Without a reference the solved point with the most harmonics is used; points of that set then have no error. With
        `only_known` the sum is over the tuples of the reference, otherwise over all tuples of both, with zero for missing ones.
        """
        errors = np.full(self.n_points, np.nan)
        rated = self.is_solved
        if reference is None:
            if not rated.any():
                raise UsageError(f"{self.path}: no point is solved")
            sizes = np.where(rated, self.column("n_harmonics"), 0)
            reference = self._motions[int(sizes.argmax())]
            rated = rated & (sizes < sizes.max())
        for i in np.flatnonzero(rated):
            motion = (self._improved if is_improved else self._motions)[i]
            if np.isfinite(motion.values).any():
                errors[i] = relative_error(motion, reference, only_known=only_known)
        return errors


def _motion(file, dofs: list[str], point: int) -> Motion:
    """Motion of a point; with `&accuracy` each point has its own tuples, followed by unused elements."""
    values = file["coefficients"][point]
    if "tuples" in file:
        values = values[:, : max(1, int(file["n_harmonics"][point]))]
    tuples = file["tuples"][point] if "tuples" in file else file["tuple"][()]
    return Motion(dofs, np.asarray(tuples[: values.shape[1]], dtype=int), values)


def _at(dofs: list[str], motion: Motion) -> Motion:
    """The motion at some degrees of freedom; unchanged if one of them is missing or none is given."""
    if not dofs or not set(dofs) <= set(motion.dofs):
        return motion
    return Motion(list(dofs), motion.tuples, motion.values[[motion.dofs.index(dof) for dof in dofs]])


def relative_error(found: Motion, reference: Motion, *, only_known: bool = False) -> float:
    """Rms over hypertime of the difference of two motions, relative to that of the reference (Parseval)."""
    known = _by_tuple(reference)
    own = _by_tuple(found)
    zero = np.zeros(2)
    difference = size = 0.0
    for dof in found.dofs:
        if dof not in reference.dofs:
            raise UsageError(f"the reference has no degree of freedom '{dof}'; it has {', '.join(reference.dofs)}")
        keys = {key for key in known if key[0] == dof} | (set() if only_known else {key for key in own if key[0] == dof})
        for key in keys:
            weight = 0.5 if any(key[1]) else 1.0
            expected = known.get(key, zero)
            difference += weight * float(np.sum((own.get(key, zero) - expected) ** 2))
            size += weight * float(np.sum(expected**2))
    return float(np.sqrt(difference / size)) if size > 0.0 else np.nan


def _by_tuple(motion: Motion) -> dict[tuple[str, tuple[int, ...]], np.ndarray]:
    """Known pairs by degree of freedom and tuple; of j and -j the one whose first nonzero entry is positive."""
    pairs = {}
    for dof, values in zip(motion.dofs, motion.values):
        for j, pair in zip(motion.tuples.tolist(), values):
            if np.isnan(pair).any():
                continue
            first = next((entry for entry in j if entry), 1)
            sign = 1 if first > 0 else -1
            pairs[dof, tuple(sign * entry for entry in j)] = pair * (1.0, sign)
    return pairs


def read_reference(text: str) -> Motion:
    """A motion from `FILE` or `FILE@POINT`: a table with the columns dof, tuple ..., cos, sin, or an HDF5 file with `tuple`, `dof`
    and `coefficients` ([point,] dof, harmonic, component), such as nhbm solve and nhbm integrate write."""
    name, _, point = text.rpartition("@") if "@" in text and text.rpartition("@")[2].isdigit() else (text, "", "")
    path = Path(name)
    if path.suffix == ".csv":
        return _read_table(path)
    with open_file(path) as file:
        values = np.asarray(file["coefficients"][()])
        if values.ndim == 4:
            if not point and len(values) > 1:
                raise UsageError(f"{path} has {len(values)} points; choose one of them, from 0, such as {path}@{len(values) - 1}")
            number = int(point or 0)
            if number >= len(values):
                raise UsageError(f"{path} has no point {number}; points: 0 to {len(values) - 1}")
            if "status" in file and int(file["status"][number]) not in SOLVED:
                raise UsageError(f"{path}: point {number} is not solved")
            return _motion(file, strings_of(file["dof"][()]), number)
        return Motion(strings_of(file["dof"][()]), np.asarray(file["tuple"][()], dtype=int), values)


def _read_table(path: Path) -> Motion:
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and not line.startswith("#")]
    except OSError as error:
        raise ReaderError(f"{path}: {error.strerror}") from error
    rows = list(csv.reader(lines))
    if not rows or rows[0][0] != "dof" or rows[0][-2:] != ["cos", "sin"] or any(len(row) != len(rows[0]) for row in rows):
        raise ReaderError(f"{path}: a table of coefficients has the columns dof, one for each tone, cos, sin")
    dofs = list(dict.fromkeys(row[0] for row in rows[1:]))
    tuples = list(dict.fromkeys(tuple(int(entry) for entry in row[1:-2]) for row in rows[1:]))
    values = np.full((len(dofs), len(tuples), 2), np.nan)
    for row in rows[1:]:
        values[dofs.index(row[0]), tuples.index(tuple(int(entry) for entry in row[1:-2]))] = [float(row[-2]), float(row[-1])]
    return Motion(dofs, np.array(tuples), values)
