"""Small pieces of text shared by messages, tables and pictures."""

import math
from collections.abc import Iterable, Sequence


def tuple_text(j: Iterable[int]) -> str:
    """Integer tuple in the usual form, for example `(1,-1)`."""
    return "(" + ",".join(str(int(k)) for k in j) + ")"


def number_text(value) -> str:
    """A value in the form of the input: a number to six digits, whole ones without a point, a string unchanged."""
    if isinstance(value, str):
        return value
    value = float(value)
    if not math.isfinite(value):
        return f"{value}"
    if abs(value) < 1e9 and value == round(value):
        return str(round(value))
    mantissa, exponent_text = f"{abs(value):.5e}".split("e")
    digits, exponent = mantissa.replace(".", "").rstrip("0"), int(exponent_text)
    if exponent >= 6 or exponent < -2:
        text = f"{digits[0]}.{digits[1:] or '0'}e{exponent}"
    else:
        text = f"{abs(value):.{max(1, len(digits) - 1 - exponent)}f}"
    return "-" + text if value < 0.0 else text


def counted(n: int, one: str, many: str = "") -> str:
    """A number with its noun: `1 tone`, `2 tones`."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def list_text(items: Sequence, limit: int = 12) -> str:
    """Items separated by commas; a long list is shortened to its ends and its length."""
    texts = [str(item) for item in items]
    if not texts:
        return "none"
    if len(texts) > limit:
        texts = texts[: limit - 1] + [f"... {texts[-1]} ({len(items)} in all)"]
    return ", ".join(texts)


def range_text(numbers: Iterable[int]) -> str:
    """Ascending integers with ranges contracted, for example `0-3, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = int(number)
        else:
            runs.append([int(number), int(number)])
    return list_text([str(a) if a == b else f"{a}-{b}" for a, b in runs])
