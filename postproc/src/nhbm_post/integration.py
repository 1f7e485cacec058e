"""The only reader of the records of `nhbm integrate`; docs/user/schema.md describes their contents."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nhbm.hdf5_file import open_hdf5

from .errors import ReaderError
from .hdf5 import text_of
from .reader import gives_hertz
from .series import Series


def is_record(path) -> bool:
    """Whether a file is the record of a time integration; false if it cannot be read."""
    try:
        with open_hdf5(path) as file:
            return file.attrs.get("kind") == "integration"
    except OSError:
        return False


def info(path) -> str:
    """Describes a record in lines: its method, the largest displacement at each degree of freedom [m or rad] and, for several
    starts, the motions found with the magnitude of their coefficients at the first degree of freedom."""
    try:
        with open_hdf5(path) as file:
            t, dofs = file["time"][()], list(file["dof"].asstr()[()])
            lines = [
                f"file       {path}",
                f"written by nhbm {file.attrs['program_version']}, commit {file.attrs['git_commit']}, {file.attrs['created_utc']}",
                f"record     by {str(file.attrs['method']).replace('_', ' ')}, {len(t)} samples from {t[0]:g} to {t[-1]:g} s",
            ]
            if "frequency" in file:
                lines.append(f"tones      {', '.join(f'{w:.10g}' for w in np.atleast_1d(file['frequency'][()]))} rad/s")
            lines += [f"largest    {np.max(np.abs(x)):.4g} at {dof}" for dof, x in zip(dofs, file["displacement"][()])]
            if "peak_frequency" in file:
                sizes = np.hypot(*np.moveaxis(file["peak_coefficients"][()], -1, 0))
                for dof, size, omega in zip(dofs, sizes, file["peak_frequency"][()]):
                    lines.append(f"peaks      {', '.join(f'{a:.4g} at {w:.10g}' for a, w in zip(size, omega))} rad/s of {dof}")
            if "start_motion" in file:
                starts = file["start_motion"][()]
                for k, motion in enumerate(file["motion_coefficients"][()], start=1):
                    size = np.sqrt(np.sum(motion[0] ** 2))
                    lines.append(f"motion {k}   from {np.sum(starts == k)} of {len(starts)} starts, {size:.4g} at {dofs[0]}")
    except (OSError, KeyError, ValueError) as error:
        raise ReaderError(f"{path}: cannot be read as a record of nhbm integrate ({error})") from None
    return "\n".join(lines)


def read_series(path, dof: str | None) -> tuple[Series, str, bool]:
    """Harmonics of one degree of freedom (default: the first) at the tones of a record, a title, and whether it is in hertz."""
    try:
        with open_hdf5(path) as file:
            if "tuple" not in file:
                raise ReaderError(f"{path}: has no harmonics, since the model has no tones; nhbm-post time shows the motion")
            labels = list(file["dof"].asstr()[()])
            k, stored = _row(path, labels, dof or labels[0]), file["coefficients"]
            units = text_of(stored.attrs.get("dof_units", "")).split() or [text_of(stored.attrs["units"])] * len(labels)
            cos, sin = stored[k].T
            series = Series(file["tuple"][()], file["frequency"][()], cos, sin, labels[k], units[k], "displacement")
            about = text_of(file.attrs["title"]), "record of time integration, its harmonics at the tones"
            return series, ", ".join(filter(None, about)), gives_hertz(text_of(file["input_text"][()]))
    except (OSError, KeyError, ValueError) as error:
        raise ReaderError(f"{path}: cannot be read as a record of nhbm integrate ({error})") from None


def _row(path, labels: list[str], dof: str) -> int:
    if dof not in labels:
        raise ReaderError(f"{path}: has no degree of freedom '{dof}'; recorded: {', '.join(labels)}")
    return labels.index(dof)


def read_displacement(path, dof: str) -> tuple[str, np.ndarray, np.ndarray]:
    """Method, times [s] and displacements of one degree of freedom."""
    path = Path(path)
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("kind") != "integration":
                raise ReaderError(f"{path}: is not a record of nhbm integrate")
            k = _row(path, list(file["dof"].asstr()[()]), dof)
            t, x = file["time"][()], file["displacement"][k]
            method = str(file.attrs["method"]).replace("_", " ")
    except (OSError, KeyError) as error:
        raise ReaderError(f"{path}: cannot be read as a record of nhbm integrate ({error})") from None
    if len(t) < 2:
        raise ReaderError(f"{path}: holds fewer than two samples")
    return method, t, x
