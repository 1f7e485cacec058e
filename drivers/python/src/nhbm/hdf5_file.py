"""HDF5 files that contain their data themselves.

HDF5 follows names of other files that are stored in a file: links, raw data and sources of virtual datasets. A file from elsewhere
could thus show, under the name of a matrix, any file that its reader may read. The packages nhbm_post and nhbm share this module.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py


def open_hdf5(path: Any, **options: Any) -> h5py.File:
    """The file, open for reading; OSError if it cannot be opened or a part of it is in another file."""
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise OSError("it is a pipe or a device, which HDF5 does not read")  # and which may never end
    try:
        file = h5py.File(path, "r", **options)
    except OSError as error:
        if "signature not found" in str(error):
            raise OSError("it is empty" if Path(path).stat().st_size == 0 else "it is not an HDF5 file") from None
        sizes = re.search(r"truncated file: eof = (\d+),.* stored_eof = (\d+)", str(error))
        if sizes:
            raise OSError(f"it is truncated: {sizes[1]} of {sizes[2]} bytes are there") from None
        raise
    name = _part_elsewhere(file, set())
    if name:
        file.close()
        raise OSError(f"'{name}' is stored in another file, which is not read")
    return file


def image_of(write: Callable[[h5py.File], None]) -> bytes:
    """The bytes of a new file, which `write` fills. HDF5 makes them in memory: it does not release a file after a failed write of
    its own, such as on a full disk, and crashes at the end of the process."""
    with h5py.File("image", "w", driver="core", backing_store=False) as file:
        write(file)
        file.flush()
        return bytes(file.id.get_file_image())


def _part_elsewhere(group: h5py.Group, seen: set[Any]) -> str:
    """Name of the first member of a group, at any depth, with data in another file; empty if there is none. What is damaged is
    passed over: reading it fails."""
    for name in group:
        with suppress(AttributeError, KeyError, OSError, RuntimeError, TypeError, ValueError):
            link = group.get(name, getlink=True)
            where = f"{group.name.rstrip('/')}/{name}".lstrip("/")
            if isinstance(link, h5py.ExternalLink):
                return where
            if isinstance(link, h5py.SoftLink):  # another name of what is in this file, or behind an external link
                continue
            member = group[name]
            if isinstance(member, h5py.Dataset) and (member.external or member.is_virtual):
                return where
            address = h5py.h5o.get_info(member.id).addr
            if isinstance(member, h5py.Group) and address not in seen:
                found = _part_elsewhere(member, seen | {address})
                if found:
                    return found
    return ""
