"""C beside the scripts that integrate, compiled where it is used."""

import ctypes
import os
import subprocess
import tempfile
from pathlib import Path


def compiled(name: str, integration: str, *options: str) -> ctypes.CDLL:
    """The library of `name`.c, whose function `integration` returns a long."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / f"{name}.so"
        source = Path(__file__).with_name(f"{name}.c")
        words = [os.environ.get("CC", "cc"), "-O2", *options, "-shared", "-fPIC", "-o", library, source, "-lm"]
        subprocess.run(words, check=True)
        loaded = ctypes.CDLL(str(library))
    getattr(loaded, integration).restype = ctypes.c_long
    return loaded
