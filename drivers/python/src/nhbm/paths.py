"""Paths to single values of an input, `wall.gap` or `law(wall)%gap`, and the labels and names that belong to them."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from nhbm.errors import ModelError
from nhbm.keys import model_groups


class InputPath(NamedTuple):
    """Where a value of an input is: group, its number (from 1) or label if there are several, key, indices (from 1) if it is one
    of several values."""

    group: str
    which: int | str | None
    key: str
    indices: tuple[int, ...] = ()

    def __str__(self) -> str:
        which = "" if self.which is None else f"({self.which})"
        return f"{self.group}{which}%{self.keyed}"

    @property
    def written(self) -> str:
        """The path as it is written in Python: `law[1].gap`, `stop.gap`, `tones.frequency[0]`."""
        stem = f"{self.group}[{self.which - 1}]" if isinstance(self.which, int) else self.which or self.group
        indices = f"[{', '.join(str(i - 1) for i in self.indices)}]" if self.indices else ""
        return f"{stem}.{self.key}{indices}"

    @property
    def keyed(self) -> str:
        """The key with its indices."""
        return self.key + (f"({', '.join(map(str, self.indices))})" if self.indices else "")


_OF_INPUT = re.compile(r"\s*(\w+)\s*(?:\(\s*([^()]*?)\s*\))?\s*%\s*(\w+)\s*(?:\(\s*(\d+)\s*(?:,\s*(\d+)\s*)?\))?\s*")
_OF_PYTHON = re.compile(r"([^.%()\[\]]+?)(?:\[(\d+)\])?(?:\.(\w+)(?:\[(\d+)(?:, *(\d+))?\])?)?")


def path_of(path: Any) -> InputPath:
    """A path as it is written: `tones[0]`, `wall.gap`, `load[1].cos`, `structure.mass[2]`, `bearing[0].stiffness[1, 0]`,
    or as in an input, `law(wall)%gap`."""
    if not isinstance(path, str):
        raise ModelError(f"a path is a text such as 'wall.gap' or 'tones[0]', not {path!r}")
    match = _OF_INPUT.fullmatch(path)
    if match:
        group, which, key, *written = match.groups()
        number = int(which) if which and which.isdigit() else which
        return InputPath(group.lower(), number, key.lower(), tuple(int(i) for i in written if i))
    match = _OF_PYTHON.fullmatch(path)
    if match is None:
        mixed = re.fullmatch(r"\s*\w+\(([^()]+)\)\.(\w+)\s*", path)
        hint = f"; did you mean '{mixed[1]}.{mixed[2]}'?" if mixed and not mixed[1].isdigit() else ""
        hint = "; give each of several paths by itself" if re.search(r"[,;]\s*\w+[^\]]*[.%]", path) else hint
        raise ModelError(f"'{path}' is not a path; 'wall.gap', 'tones[0]' and 'load[1].cos' are{hint}")
    name, number, key, element, column = match.groups()
    if key is None:
        if name != "tones":
            hint = "; did you mean 'tones[0]'?" if name in ("frequency", "omega", "tone") else ""
            raise ModelError(f"path '{path}' has no key{hint or ', as in wall.gap or load[1].cos'}")
        key, element, number = "frequency", number, None
    indices = tuple(int(i) + 1 for i in (element, column) if i is not None)
    if number is None and name not in model_groups():
        return InputPath("law", name, key, indices)
    return InputPath(name, None if number is None else int(number) + 1, key, indices)


def check_label(group: str, label: str) -> None:
    """Raises ModelError for a label that no path can contain, or that a path would take for a number."""
    if not label.strip() or label.strip().isdigit() or re.search(r"[.%()\[\]]", label):
        raise ModelError(f"&{group}: label {label!r} cannot be part of a path such as 'wall.gap': it must have a letter, and "
                         "none of . % ( ) [ ]")  # fmt: skip


def identifier(path: str) -> str:
    """A path of the input as a name, as the result file has it: law(wall)%gap is law_wall_gap."""
    return re.sub("[^a-z0-9]+", "_", path.lower()).strip("_")
