"""Located points of curves, such as folds, as the column `curve_kind` describes them."""

from __future__ import annotations

from typing import Any, Mapping, NamedTuple

# Shapes as matplotlib names them.
MARKERS = {"circle": "o", "up": "^", "down": "v", "left": "<", "right": ">", "diamond": "D", "square": "s", "pentagon": "p",
           "hexagon": "h", "octagon": "8"}  # fmt: skip


class Located(NamedTuple):
    """A kind of located point."""

    label: str
    plural: str
    mark: str  # shape in pictures
    is_bifurcation: bool  # stability may change there


def located_kinds(attributes: Mapping[str, Any]) -> dict[str, Located]:
    """The kinds of located points by their names, from the attributes of the column; none if it does not describe them."""

    def words(name: str, separator: str | None = None) -> list[str]:
        value = attributes.get(name, "")
        return (value.decode() if isinstance(value, bytes) else str(value)).split(separator)

    rows = zip(words("flag_meanings"), words("flag_labels", ", "), words("flag_plurals", ", "), words("flag_marks"))
    changing = words("bifurcations")
    return {name: Located(label, plural, mark, name in changing) for name, label, plural, mark in rows if mark != "none"}
