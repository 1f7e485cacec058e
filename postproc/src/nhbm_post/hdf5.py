"""HDF5 files of nhbm: opened while a run may still write, texts of any kind, what h5py raises in damaged ones."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from nhbm.hdf5_file import open_hdf5

from .errors import ReaderError

# Exceptions that h5py and numpy raise in a damaged file.
DAMAGES = (
    AttributeError, IndexError, KeyError, MemoryError, OSError, OverflowError, RuntimeError, TypeError, ValueError,
)  # fmt: skip


def open_file(path: Path) -> h5py.File:
    """An HDF5 file, open for reading, even while a run writes to it."""
    if not path.is_file():
        raise ReaderError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    try:
        return open_hdf5(path)
    except OSError as error:
        first = error
    if "lock" in str(first):
        # A run may still be writing. Complete points are readable at any time, so the lock is not used.
        try:
            return open_hdf5(path, locking=False)
        except (OSError, TypeError, ValueError):  # the last two: HDF5 library without this option
            pass
    if path.suffix == ".nml":
        raise ReaderError(f"{path}: is an input, not a result: nhbm solve {path} makes one, {path.stem}.h5")
    raise ReaderError(f"{path}: cannot be read as HDF5 ({_first_line(first)})")


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def text_of(value) -> str:
    """Text of a scalar string of any HDF5 kind, without the padding of Fortran."""
    if isinstance(value, np.ndarray):
        value = value.ravel()[0] if value.size else ""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return str(value).rstrip("\0 ")


def strings_of(values: np.ndarray) -> list[str]:
    """List of texts from fixed-size strings, variable-length strings, or rows of single characters."""
    values = np.asarray(values)
    if values.ndim == 2 and values.dtype == np.dtype("S1"):
        values = np.ascontiguousarray(values).view(f"S{values.shape[1]}").ravel()
    return [text_of(value) for value in values]
