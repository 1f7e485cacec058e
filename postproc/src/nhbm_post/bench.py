"""The only reader of the files of `nhbm bench`."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np

from .errors import ReaderError
from .reader import SCHEMA_VERSION, SOLVED, _open, _text

KERNELS = ("residual", "tangent", "newton_step", "solution", "point")
# What a cost may be drawn over, and how the axis is called; swept parameters are named by their paths.
SIZES = {
    "n_unknowns": "unknowns",
    "n_harmonics": "harmonics",
    "n_tones": "tones",
    "n_samples": "samples of the torus",
    "n_channels": "motions transformed at once",
}


class KernelTimes:
    """Points of one file or of several with the same columns, one after the other."""

    def __init__(self, *paths: str | os.PathLike):
        self.path = Path(paths[0])
        files = [self._read(Path(path)) for path in paths]
        self.title = files[0][0]
        names = [name for name in files[0][1] if all(name in columns for _, columns, _ in files)]
        self._columns = {name: np.concatenate([columns[name] for _, columns, _ in files]) for name in names}
        self._paths = files[0][2]
        self.n_points = len(self._columns["status"])

    @staticmethod
    def _read(path: Path):
        with _open(path) as file:
            if _text(file.attrs.get("kind", "")) != "bench":
                raise ReaderError(f"{path}: no file of 'nhbm bench'")
            version = int(np.ravel(file.attrs["schema_version"])[0])
            if version != SCHEMA_VERSION:
                raise ReaderError(f"{path}: schema version {version}; this nhbm-post reads version {SCHEMA_VERSION}")
            numbers = {
                name: dataset[()]
                for name, dataset in file.items()
                if isinstance(dataset, h5py.Dataset) and dataset.shape and dataset.dtype.kind in "fiu"
            }
            paths = {_text(file[name].attrs["parameter"]): name for name in numbers if "parameter" in file[name].attrs}
            return _text(file.attrs.get("title", "")), numbers, paths

    def column(self, name: str) -> np.ndarray:
        """A column by its name, a swept parameter also by its path."""
        name = self._paths.get(name, name)
        if name not in self._columns:
            known = ", ".join([*SIZES, *self._paths])
            raise ReaderError(f"{self.path}: no column '{name}'; sizes of this file: {known}")
        return self._columns[name]

    @property
    def is_solved(self) -> np.ndarray:
        return np.isin(self.column("status"), SOLVED)

    def varying(self) -> str:
        """The first size that differs between points, else the first swept parameter that does."""
        for name in (*SIZES, *self._paths):
            if len(set(self.column(name).tolist())) > 1:
                return name
        return "n_unknowns"
