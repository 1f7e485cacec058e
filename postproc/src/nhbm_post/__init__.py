"""Reads the HDF5 result files of nhbm and draws them."""

from nhbm import __version__

from .errors import NhbmPostError, ReaderError, UsageError
from .reader import Parameter, Results
from .series import Series

__all__ = ["NhbmPostError", "Parameter", "ReaderError", "Results", "Series", "UsageError", "__version__"]
