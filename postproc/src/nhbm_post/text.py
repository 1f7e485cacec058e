"""Small pieces of text shared by messages, tables and pictures."""

from collections.abc import Iterable, Sequence


def tuple_text(j: Iterable[int]) -> str:
    """Integer tuple as written everywhere, for example `(1,-1)`."""
    return "(" + ",".join(str(int(k)) for k in j) + ")"


def number_text(value) -> str:
    """Short text of a parameter value: six digits for a number, the text itself for a string."""
    return value if isinstance(value, str) else f"{float(value):g}"


def list_text(items: Sequence, limit: int = 12) -> str:
    """Items joined by commas; a long list keeps its ends and tells its length."""
    texts = [str(item) for item in items]
    if not texts:
        return "none"
    if len(texts) > limit:
        texts = texts[: limit - 1] + [f"... {texts[-1]} ({len(items)} in all)"]
    return ", ".join(texts)


def range_text(numbers: Iterable[int]) -> str:
    """Ascending integers with runs contracted, for example `0-3, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = int(number)
        else:
            runs.append([int(number), int(number)])
    return list_text([str(a) if a == b else f"{a}-{b}" for a, b in runs])
