"""The table of input keys of the library, and checks of keys and words against it where they are written."""

from __future__ import annotations

import ctypes
import functools
import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from nhbm._library import KEY_ROW_SIZE, library, raise_error
from nhbm.errors import ModelError, among

_WORDS = re.compile(r"'[^']*'(, '[^']*')*")  # a range of nothing but words


class Key(NamedTuple):
    """A key of the input as the table of the program has it (docs/user/input.md)."""

    section: str  # a group, or a group and its type: "law", "law jenkins"
    name: str
    type: str
    unit: str
    default: str
    range: str
    meaning: str


def input_keys() -> list[Key]:
    """The table of input keys, in the order of the documentation.

    Returns
    -------
    list of Key
        With section, name, type, unit, default, range and meaning, as texts.

    Examples
    --------
    >>> import nhbm
    >>> next(key.unit for key in nhbm.input_keys() if (key.section, key.name) == ("law rigid_wall", "gap"))
    'm'
    """
    return list(_table())


@functools.lru_cache(maxsize=1)
def _table() -> tuple[Key, ...]:
    keys: list[Key] = []
    row = ctypes.create_string_buffer(KEY_ROW_SIZE)
    for k in range(library().nhbm_get_key_count()):
        status = library().nhbm_get_key_row(k, row, len(row))
        if status:
            raise_error(status)
        keys.append(Key(*row.value.decode().split(" | ")))
    return tuple(keys)


@functools.lru_cache(maxsize=1)
def model_groups() -> tuple[str, ...]:
    """The groups of an input, without the operation &sweep, which is not one of a single model."""
    groups = dict.fromkeys(key.section.partition(" ")[0] for key in _table())
    return tuple(group for group in groups if group != "sweep")


@functools.lru_cache(maxsize=1)
def labelled_groups() -> tuple[str, ...]:
    """The groups of which there may be several, each with a label: laws, and what is added to the structure."""
    return tuple(key.section for key in _table() if key.name == "label")


@functools.lru_cache(maxsize=1)
def repeated_groups() -> tuple[str, ...]:
    """The groups of which there may be several."""
    return tuple(dict.fromkeys(("load", "law", "start", "initial", *labelled_groups(), "tie")))


@functools.lru_cache(maxsize=None)
def keys_of(group: str, kind: str = "") -> dict[str, Key]:
    """The keys of a group, and of its type, by name."""
    return {key.name: key for key in _table() if key.section in (group, f"{group} {kind}")}


def check_keys(group: str, given: Mapping[str, Any], subject: str = "") -> None:
    """Raises ModelError for a key that the group, or its type, does not have, and for a word or number that a key does not accept.

    `subject` replaces the name of the group in messages."""
    kind = given.get("type")
    known = keys_of(group)
    if isinstance(kind, str):
        _check_word(subject or f"&{group}", known["type"], kind)
        known = keys_of(group, kind.lower())
    subject = subject or subject_of(group, kind)
    for name, value in given.items():
        stem = name.partition("(")[0]
        if stem.lower() not in known:
            raise ModelError(f"{subject}: unknown key '{name}'{among(stem, list(known))}")
        if isinstance(value, str):
            _check_word(subject, known[stem.lower()], value)
        check_numbers(subject, name, known[stem.lower()], value)


def subject_of(group: str, kind: Any) -> str:
    """How messages name a group: by its type, too, if there may be several of it."""
    return f"&{group} type = '{kind}'" if group == "law" and isinstance(kind, str) else f"&{group}"


def missing_key(group: str, given: Mapping[str, Any]) -> str:
    """The first key that the group, of the given type, requires and that is not given; empty if there is none."""
    kind = given.get("type", "")
    names = [key.name for key in keys_of(group, str(kind).lower()).values() if key.default == "required"]
    return next((name for name in names if given.get(name) is None), "")


def _check_word(subject: str, key: Key, value: str) -> None:
    known = _choices(key.range) if key.type.startswith("text") else ()
    if known and value.lower() not in known:
        raise ModelError(f"{subject}: {key.name} = '{value}' is not known{among(value, known)}")


@functools.lru_cache(maxsize=None)
def _choices(words: str) -> tuple[str, ...]:
    """The words of a range of nothing but words."""
    return tuple(re.findall(r"'([^']*)'", words)) if _WORDS.fullmatch(words) else ()


_NUMBER = r"[-+]?[\d.]+(?:e[-+]?\d+)?"


class Limits(NamedTuple):
    """What the range of a key permits, as the program reads it (hb_input_keys)."""

    minimum: float
    above: float
    maximum: float


@functools.lru_cache(maxsize=None)
def limits_of(words: str) -> Limits:
    """From parts like `>= 0`, `> 0`, `<= 1`, `1 to 100`; other parts are for readers."""
    minimum, above, maximum = -math.inf, -math.inf, math.inf
    for part in words.split(","):
        part = part.strip()
        limit = re.fullmatch(rf"(>=|>|<=) ({_NUMBER})", part)
        ends = re.fullmatch(rf"({_NUMBER}) to (.*)", part)
        if limit and limit[1] == ">=":
            minimum = float(limit[2])
        elif limit and limit[1] == ">":
            above = float(limit[2])
        elif limit:
            maximum = float(limit[2])
        elif ends:
            minimum = float(ends[1])
            maximum = float(ends[2]) if re.fullmatch(_NUMBER, ends[2]) else maximum
    return Limits(minimum, above, maximum)


def check_numbers(subject: str, name: str, key: Key, values: Any) -> None:
    """Raises ModelError, in the words of the program, for values of a numeric key that are no such numbers, not finite or outside
    its range."""
    is_whole = "integer" in key.type
    if values is None or not (is_whole or "real" in key.type):
        return
    limits = limits_of(key.range)
    if type(values) is float and not is_whole and limits.minimum <= values <= limits.maximum and limits.above < values < math.inf:
        return
    array = np.asarray(values)
    if array.dtype.kind in "iuf"[: 2 if is_whole else 3] and array.size and np.isfinite(array).all():  # all at once
        if array.min() >= limits.minimum and array.min() > limits.above and array.max() <= limits.maximum:
            return
    given = [values] if array.ndim == 0 else list(np.asarray(values, dtype=object).ravel())
    for k, value in enumerate(given, start=1):
        wrong = _wrong_number(value, limits, is_whole)
        if wrong:
            index = f"({k})" if array.ndim or ("(" not in name and key.type.startswith(("list", "matrix"))) else ""
            shown = repr(value) if isinstance(value, str) else value
            raise ModelError(f"{subject}: {name}{index} = {shown} must be {wrong}")


def _wrong_number(value: Any, limits: Limits, is_whole: bool) -> str:
    """What a value must be and is not; empty if it is."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str):
        return f"{'an integer' if is_whole else 'a real number'}, without quotes"
    if isinstance(value, bool):
        return "an integer, not a bool" if is_whole else "a real number, not a bool"
    if not isinstance(value, (int, float)):
        return ""
    if is_whole and not isinstance(value, int):
        return "an integer like 3, at most 2147483647"
    if not math.isfinite(value):
        return "finite"
    show: Any = int if is_whole else float
    if value < limits.minimum:
        return f"{show(limits.minimum)} or greater"
    if value > limits.maximum:
        return f"{show(limits.maximum)} or less"
    return f"above {show(limits.above)}" if value <= limits.above else ""
