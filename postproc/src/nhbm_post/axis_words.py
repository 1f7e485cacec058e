"""Values of the input in words, with their symbols on axes, for pictures; elsewhere a value is named by its path."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .parameter import Parameter
    from .reader import Results

# By path without indices, or by key alone.
_WORDS = {
    "tones%frequency": ("excitation frequency", r"\omega"),
    "tones%hertz": ("excitation frequency", "f"),
    "load%cos": ("amplitude", "F"),
    "load%sin": ("amplitude", "F"),
    "load%phase": ("phase", r"\varphi"),
    "structure%speed": ("rotor speed", r"\Omega"),
    "normal_mode%amplitude": ("amplitude of the normal mode", "a"),
    "normal_mode%energy": ("energy of the normal mode", "E"),
    "harmonics%order": ("order of the harmonics", "N"),
    "sampling%samples": ("samples per period", ""),
    "accuracy%tolerance": ("tolerance", ""),
    "gap": ("gap", "g"),
    "stiffness": ("stiffness", "k"),
    "stiffness_cos": ("stiffness amplitude", "k"),
    "stiffness_sin": ("stiffness amplitude", "k"),
    "damping_cos": ("damping amplitude", "d"),
    "damping_sin": ("damping amplitude", "d"),
    "voltage_cos": ("voltage amplitude", "V"),
    "voltage_sin": ("voltage amplitude", "V"),
    "friction": ("friction coefficient", r"\mu"),
    "mu": ("friction coefficient", r"\mu"),
    "damping": ("damping", "d"),
    "damping_mass": ("damping by mass", r"\alpha"),
    "damping_stiffness": ("damping by stiffness", r"\beta"),
}
_PATH = re.compile(r"(\w+)(?:\(([^)]*)\))?%(\w+)(?:\(([^)]*)\))?$")


def words_of(path: str, is_unknown_tone: bool = False) -> tuple[str, str]:
    """(words, symbol without dollars) of a path in the input: `law(stop)%gap` is the gap of stop, g."""
    match = _PATH.match(path)
    if not match:
        return path.replace("_", " "), ""
    group, which, key, number = match.groups()
    words, symbol = _WORDS.get(f"{group}%{key}") or _WORDS.get(key) or (key.replace("_", " "), "")
    if group == "tones":
        words = words.replace("excitation ", "") if is_unknown_tone else words
        if number:
            words, symbol = f"{words} {number}", f"{symbol}_{{{number}}}" if symbol else ""
        return words, symbol
    if which:
        words = f"{words} of {which if re.search('[A-Za-z]', which) else f'{group} {which}'}"
    elif group == "load" or f"{group}%{key}" not in _WORDS:
        words = f"{words} of the {group.replace('_', ' ')}"
    return words + (f", entry {number}" if number else ""), symbol


def with_symbol(words: str, symbol: str) -> str:
    """`Gap of stop $g$`: begins with a capital letter, as axes do."""
    return words[:1].upper() + words[1:] + (f" ${symbol}$" if symbol else "")


def axis_words(results: Results, axis: Parameter) -> tuple[str, str]:
    """(words, symbol) of the quantity on an axis of a picture."""
    if axis.path.startswith("tones%"):
        number = re.search(r"\((\d+)\)$", axis.path)
        tone = int(number[1]) - 1 if number else 0
        path = re.sub(r"\(\d+\)$", "", axis.path) if results.n_tones == 1 else axis.path
        return words_of(path, tone in results.unknown_tones())
    return words_of(axis.label)
