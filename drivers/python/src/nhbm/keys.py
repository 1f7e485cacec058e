"""The table of input keys of the library, and checks of keys and words against it where they are written."""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

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


@functools.lru_cache(maxsize=None)
def keys_of(group: str, kind: str = "") -> dict[str, Key]:
    """The keys of a group, and of its type, by name."""
    return {key.name: key for key in _table() if key.section in (group, f"{group} {kind}")}


def check_keys(group: str, given: Mapping[str, Any], subject: str = "") -> None:
    """Raises ModelError for a key that the group, or its type, does not have, and for a word that a key does not accept.

    `subject` replaces the name of the group in messages."""
    subject = subject or f"&{group}"
    kind = given.get("type")
    known = keys_of(group)
    if isinstance(kind, str):
        _check_word(subject, known["type"], kind)
        known = keys_of(group, kind.lower())
    for name, value in given.items():
        stem = name.partition("(")[0]
        if stem.lower() not in known:
            raise ModelError(f"{subject}: unknown key '{name}'{among(stem, list(known))}")
        if isinstance(value, str):
            _check_word(subject, known[stem.lower()], value)


def missing_key(group: str, given: Mapping[str, Any]) -> str:
    """The first key that the group, of the given type, requires and that is not given; empty if there is none."""
    kind = given.get("type", "")
    names = [key.name for key in keys_of(group, str(kind).lower()).values() if key.default == "required"]
    return next((name for name in names if given.get(name) is None), "")


def _check_word(subject: str, key: Key, value: str) -> None:
    if not key.type.startswith("text") or not _WORDS.fullmatch(key.range):
        return
    known = re.findall(r"'([^']*)'", key.range)
    if value.lower() not in known:
        raise ModelError(f"{subject}: {key.name} = '{value}' is not known{among(value, known)}")
