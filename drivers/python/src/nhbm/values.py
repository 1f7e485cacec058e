"""Values of Python as an input has them, and numbers of arguments."""

from __future__ import annotations

from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np

from nhbm.errors import ModelError

_EXPECTED = "expected a real number, string, bool or list of them, not"


def plain(value: Any) -> Any:
    """A value as Python has it, hashable: numbers, texts, truths, tuples of them; objects that the input names stay as they are."""
    if value is None or type(value) in (bool, int, float):
        return value
    if np.ma.is_masked(value):
        raise ModelError("a masked value is none: fill it, or leave it out")
    if hasattr(value, "__array__"):  # of NumPy, xarray, pandas
        value = np.asarray(value)
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.ndim else value.item()
    if isinstance(value, (list, tuple, range)):
        return tuple(plain(one) for one in value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, (Real, Decimal)) and not isinstance(value, (bool, int, float)):
        value = float(value)
    if isinstance(value, str) and ("\n" in value or "\0" in value):
        raise ModelError(f"a text of an input has one line, not {value!r}")
    if value is None or isinstance(value, (bool, int, float, str)) or hasattr(value, "input_name"):
        return value
    raise ModelError(f"{_EXPECTED} {value!r}")


def as_input(value: Any) -> str:
    """A value, or a list of them, as an input has it."""
    value = plain(value)
    if isinstance(value, tuple):
        return ", ".join(map(as_input, value))
    if isinstance(value, bool):
        return ".true." if value else ".false."
    if hasattr(value, "input_name"):
        value = value.input_name
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if value is None:
        raise ModelError(f"{_EXPECTED} {value!r}")
    return repr(value)


def flat(value: Any) -> list[Any]:
    """The values of a list of plain values, row by row, or a single one."""
    return [one for part in value for one in flat(part)] if isinstance(value, tuple) else [value]


def _flat(values: Any) -> list[Any]:
    """The values of a list, or a single one; as they are, without a common type."""
    return [values] if isinstance(values, (str, bytes)) or np.ndim(values) == 0 else list(np.asarray(values, dtype=object).ravel())


def numbers_of(name: str, values: Any, kind: type = float) -> list[Any]:
    """Values as a flat list of float or int, one for a single value; ModelError, which names the argument, for others."""
    try:
        if np.iscomplexobj(values) or any(isinstance(value, (str, bytes, bool, np.bool_)) for value in _flat(values)):
            raise ValueError
        numbers = [kind(value) for value in np.ravel(values)]
        if kind is float and not np.isfinite(numbers).all():
            raise ModelError(f"{name} must be finite, not {values!r}")
        if not numbers or (kind is int and numbers != [float(value) for value in np.ravel(values)]):
            raise ValueError
        if kind is int and np.ndim(values) > 1:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        what = "a whole number, or a list of them" if kind is int else "a number" if np.ndim(values) == 0 else "numbers"
        raise ModelError(f"{name} must be {what}, not {values!r}") from None
    return numbers
