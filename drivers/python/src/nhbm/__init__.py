"""Finite element models for nhbm: the model file, import from other programs, checks, examples and reduction."""

from nhbm.errors import ModelError
from nhbm.model import Model

__version__ = "0.1.0"
__all__ = ["Model", "ModelError", "__version__"]
