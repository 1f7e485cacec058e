"""Result files as datasets."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

import nhbm.accessor  # noqa: F401  (every dataset has the accessor `nhbm`)
from nhbm.errors import imported, without_own_frames


@without_own_frames
def open_dataset(path: str | Path) -> xr.Dataset:
    """Opens a result file of `nhbm solve` or of `dataset.nhbm.save`.

    Parameters
    ----------
    path : str or Path
        The file. Needs h5netcdf, which is installed with the package.

    Returns
    -------
    xarray.Dataset
        As returned by `Model.solve`, `curve` and `sweep` (docs/user/schema.md), read on demand, without the unused rows of
        curves. A file of one motion has no dimension `point`.
    """
    from nhbm import files

    imported("h5netcdf", "result files are opened with")
    return files.opened(path)
