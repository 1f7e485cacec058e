"""Groups of the complete input in a result file: one key per line, long lists continue in the next line."""

from __future__ import annotations

import re

_GROUP = re.compile(r"^&(\w+)\n(.*?)^/", re.MULTILINE | re.DOTALL)
_KEY = re.compile(r"^ *(\w+) = ((?:[^\n]*,\n)*[^\n]*)$", re.MULTILINE)
_WORD = re.compile(r"(?:(\d+)\*)?('(?:[^']|'')*'|[^\s,']+)")


def groups(text: str, name: str) -> list[dict[str, list[str]]]:
    """The groups of a name in the order of the input: the values of each key, strings without quotes."""
    return [
        {key: _values(values) for key, values in _KEY.findall(body)} for group, body in _GROUP.findall(text) if group == name
    ]


def _values(text: str) -> list[str]:
    return [_unquoted(word) for times, word in _WORD.findall(text) for _ in range(int(times or 1))]


def _unquoted(word: str) -> str:
    return word[1:-1].replace("''", "'").strip() if word.startswith("'") else word
