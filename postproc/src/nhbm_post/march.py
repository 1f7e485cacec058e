"""The only reader of the records of `nhbm march`; docs/user/schema.md says what is in them."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from .errors import ReaderError


def read_displacement(path, dof: str) -> tuple[str, np.ndarray, np.ndarray]:
    """Method, times [s] and displacements of one degree of freedom."""
    path = Path(path)
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("kind") != "march":
                raise ReaderError(f"{path}: is no record of nhbm march")
            labels = list(file["dof"].asstr()[()])
            if dof not in labels:
                raise ReaderError(f"{path}: has no degree of freedom '{dof}'; recorded: {', '.join(labels)}")
            t, x = file["time"][()], file["displacement"][labels.index(dof)]
            method = str(file.attrs["method"]).replace("_", " ")
    except (OSError, KeyError) as error:
        raise ReaderError(f"{path}: cannot be read as a record of nhbm march ({error})") from None
    if len(t) < 2:
        raise ReaderError(f"{path}: holds fewer than two samples")
    return method, t, x
