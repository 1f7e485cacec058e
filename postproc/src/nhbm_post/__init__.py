"""Reads the HDF5 result files of nhbm and draws them."""

from nhbm import __version__

from .errors import NhbmPostError, ReaderError, UsageError
from .parameter import Parameter
from .reader import Results
from .series import Series

__all__ = ["NhbmPostError", "Parameter", "ReaderError", "Results", "Series", "UsageError", "__version__"]
