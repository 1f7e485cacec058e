"""Groups of an input as objects: keys with values of Python, and what an operation adds to them."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Optional

import numpy as np

from nhbm.errors import ModelError, meant
from nhbm.keys import Key, check_keys, keys_of, labelled_groups, repeated_groups
from nhbm.paths import InputPath, path_of
from nhbm.values import as_input, numbers_of, plain

OPERATIONS = "sweep", "curve"  # groups of an input that are operations of a model
FILE_KEYS = "file", "library", "stiffness_file", "table"  # keys that name files
SETS = "order", "tuples", "set", "odd_only"  # keys of &harmonics that fix them


def _plain_of(group: str, key: str, value: Any) -> Any:
    """A value of a key, which is named where the value is none of an input."""
    try:
        return plain(value)
    except ModelError as error:
        raise ModelError(f"&{group}: {key}: {error}") from None


def call_of(operations: Iterable[Group]) -> str:
    """The call of a model that does what groups &sweep and &curve of an input do; of a curve in a sweep, the curve."""
    grid: dict[str, str] = {}
    axes: list[int] = []
    for group in operations:
        keys: dict[str, Any] = {key: list(value) if isinstance(value, tuple) else value for key, value in group.keys.items()}
        path = keys.pop("parameter", "")
        if group.name == "curve":
            first = {"first": keys.pop("start")} if "start" in keys else {}
            ends = [repr(keys.pop(end, 0.0)) for end in ("from", "to")]
            named = [f"{key}={value!r}" for key, value in {**first, **keys}.items()]
            return f"model.curve({', '.join([repr(path), *ends, *named])})"
        axes.append(keys.get("axis", -len(axes)))
        spaced = "geomspace" if keys.get("spacing") == "log" else "linspace"
        if "from" in keys:
            grid[path] = f"np.{spaced}({keys['from']}, {keys.get('to')}, {keys.get('n')})"
        else:
            values = list(map(repr, np.ravel(keys.get("values", keys.get("texts", []))).tolist()))
            grid[path] = f"[{', '.join(values if len(values) < 7 else [*values[:2], '...', values[-1]])}]"
    paired = ", paired=True" if len(set(axes)) < len(axes) else ""
    return "model.sweep({" + ", ".join(f"{path!r}: {values}" for path, values in grid.items()) + "}" + paired + ")"


class Group:
    """A group of the input: its name, and the values of its keys. A key with indices, `mass(2)`, has one of several values; one
    with an empty list is left out, as one with None."""

    def __init__(self, name: str, keys: Mapping[str, Any]) -> None:
        self.name = name
        given = {key: _plain_of(name, key, value) for key, value in keys.items()}
        self.keys = {key: value for key, value in given.items() if value not in (None, ())}

    def __repr__(self) -> str:
        return f"<{self.name}: {', '.join(f'{key} = {value!r}' for key, value in self.keys.items())}>"

    def put(self, key: str, value: Any) -> str:
        """Sets a key; None removes it. Values of all indices replace those of single ones; a single one is set among all. Returns
        the key, with one index for a matrix that is a list of its rows."""
        if "(" not in key:
            self.keys = {name: old for name, old in self.keys.items() if not name.startswith(f"{key}(")}
        value = plain(value)
        whole = key.partition("(")[0]
        if whole != key and whole in self.keys and not ("," in key and self._is_matrix(whole)):
            values, k = self._element(key)
            values[k] = value
            self.keys[whole] = tuple(values) if len(values) > 1 else value
            return f"{whole}({k + 1})"
        if value in (None, ()):
            self.keys.pop(key, None)
        else:
            self.keys[key] = value
        return key

    def key_of(self, name: str) -> Key | None:
        """The entry of the table for a key; None if the group, of its type, has no such key."""
        return keys_of(self.name, str(self.keys.get("type", "")).lower()).get(name)

    def _is_matrix(self, key: str) -> bool:
        """Whether the elements of a key have two indices."""
        found = self.key_of(key)
        return found is not None and found.type.startswith("matrix")

    def _element(self, key: str) -> tuple[list[Any], int]:
        """All values of a key with indices, and the position of the one that they mean."""
        whole, _, index = key.partition("(")
        values = self.keys[whole] if isinstance(self.keys[whole], tuple) else (self.keys[whole],)
        at = [int(number) - 1 for number in index.rstrip(")").split(",")]
        k = at[0] if len(at) == 1 else at[0] * math.isqrt(len(values)) + at[1]  # of a matrix, row by row
        if not 0 <= k < len(values):
            raise ModelError(f"&{self.name}: '{key}': {whole} has {len(values)} value{'s' * (len(values) > 1)}")
        return list(values), k

    def value(self, key: str) -> Any:
        """The value of a key that the group has, with indices or without."""
        if key in self.keys:
            return self.keys[key]
        values, k = self._element(key)
        return values[k]

    def get(self, key: str, index: tuple[int, ...] = ()) -> Any:
        """The value that the group itself has for a key; None if it has none of its own."""
        value = self.keys.get(key)
        if any(name.startswith(f"{key}(") for name in self.keys):
            return self.keys.get(InputPath(self.name, None, key, index).keyed)
        if not index:
            return value[0] if isinstance(value, tuple) and len(value) == 1 else value
        if isinstance(value, tuple) and len(index) == 1 and 1 <= index[0] <= len(value):
            return value[index[0] - 1]
        return value if index == (1,) and not isinstance(value, tuple) else None

    @property
    def label(self) -> str:
        """What names it in paths; empty if only its number does."""
        return str(self.keys.get("label", ""))


class Groups:
    """The groups of a model, in their order."""

    def __init__(self, groups: Iterable[Group] = ()) -> None:
        self._all = list(groups)

    def __iter__(self) -> Iterator[Group]:
        return iter(self._all)

    def named(self, name: str) -> list[Group]:
        """All groups of a name."""
        return [group for group in self._all if group.name == name]

    def first(self, name: str) -> Group | None:
        """The first group of a name."""
        return next((group for group in self._all if group.name == name), None)

    def single(self, name: str) -> Group:
        """The group of a name that occurs once; it is added if there is none."""
        found = self.first(name)
        if found is None:
            found = Group(name, {})
            self._all.append(found)
        return found

    def add(self, group: Group) -> None:
        """Adds a group after the others."""
        self._all.append(group)

    def remove(self, group: Group) -> None:
        """Removes a group."""
        self._all = [other for other in self._all if other is not group]

    def find(self, path: InputPath) -> Group | None:
        """The group at a path; None if there is none, or if several are possible."""
        found = self.named(path.group)
        if isinstance(path.which, int):
            return found[path.which - 1] if 0 < path.which <= len(found) else None
        if path.which:
            found = [group for group in found if group.label == path.which]
        return found[0] if len(found) == 1 else None

    def key_at(self, path: InputPath) -> Key | None:
        """The entry of the table for the key of a path, of the group that is there; None if there is none."""
        return (self.find(path) or Group(path.group, {})).key_of(path.key)

    def located(self, path: str) -> InputPath:
        """A path as it is written, with the group that has its label."""
        found = path_of(path)
        if found.group == "law" and isinstance(found.which, str) and self.find(found) is None:
            others = [group for group in self._all if group.label == found.which and group.name in repeated_groups()]
            if len(others) == 1:
                return found._replace(group=others[0].name)
        return found

    def resolved(self, path: str) -> InputPath:
        """The one spelling of a path: groups by their label or, without one, their number; the only tone without an index."""
        found = self.located(path)
        group = self.find(found)
        if group is None:
            return found
        if group.name not in repeated_groups():
            found = found._replace(which=None)
        else:
            is_unique = sum(other.label == group.label for other in self.named(group.name)) == 1
            found = found._replace(which=group.label if group.label and is_unique else self.number_of(group))
        if group.name == "tones" and found.key == "frequency" and "hertz" in group.keys:
            found = found._replace(key="hertz")  # `tones[0]` has the unit of the input
        if group.name == "tones" and found.indices == (1,) and isinstance(group.get(found.key), (bool, int, float)):
            found = found._replace(indices=())
        return found

    def snapshot(self) -> Groups:
        """These groups as they are now, whatever is set later."""
        groups = Groups(copy.copy(group) for group in self._all)
        for group in groups:
            group.keys = dict(group.keys)
        return groups

    def number_of(self, group: Group) -> int:
        """Number of a group among those of its name, from 1."""
        return 1 + next(k for k, other in enumerate(self.named(group.name)) if other is group)

    def with_settings(self, settings: Settings) -> Groups:
        """These groups with those of an operation, which replace keys of the same name, or whole groups."""
        groups = Groups(self._all)
        for name, keys in settings.items():
            own = groups.first(name)
            groups._all = [group for group in groups._all if group is not own]
            if keys is None:
                continue
            merged = Group(name, {} if own is None or name in _REPLACED else own.keys)
            for key, value in keys.items():
                merged.put(key, value)
            if merged.keys or own is not None:
                groups.add(merged)
        return groups

    @classmethod
    def of_text(cls, text: str) -> Groups:
        """The groups of an input that the library has written: one key to a line, lists over several."""
        groups = cls()
        for name, body in re.findall(r"^&(\w+)\n(.*?)^/", text, re.DOTALL | re.MULTILINE):
            keys: dict[str, Any] = {}
            for key, words in re.findall(r"^ {3}(\w+) = ((?:[^\n]*,\n)*[^\n]*)$", body, re.MULTILINE):
                keys[key] = tuple(_value(word) for times, word in _WORD.findall(words) for _ in range(int(times or 1)))
            groups.add(Group(name, {key: values[0] if len(values) == 1 else values for key, values in keys.items()}))
        return groups


Settings = Mapping[str, Optional[Mapping[str, Any]]]  # of an operation: keys by group, or None to leave the group out
_REPLACED = "curve", "gradient"  # groups that an operation gives complete
_WORD = re.compile(r"(?:(\d+)\*)?('(?:[^']|'')*'|[^\s,']+)")


def _value(word: str) -> Any:
    if word.startswith("'"):
        return word[1:-1].replace("''", "'")
    if word in (".true.", ".false."):
        return word == ".true."
    return int(word) if re.fullmatch(r"[-+]?\d+", word) else float(word)


def request(tolerance: float | None = None, order: Any = None, **groups: Mapping[str, Any]) -> Settings:
    """The settings of an operation: a tolerance chooses the harmonics, an order fixes them."""
    if tolerance is not None and order is not None:
        raise ModelError("give a tolerance, which chooses the harmonics, or an order, which fixes them; not both")
    given: dict[str, Any] = dict(groups)
    if order is not None:
        given.update(harmonics={"order": order}, accuracy=None)
    elif tolerance is not None:
        given.update(accuracy={"tolerance": tolerance}, harmonics=dict.fromkeys(SETS))
    return {name: None if keys is None else {key: plain(value) for key, value in keys.items()} for name, keys in given.items()}


def curve_range(start: Any, stop: Any, keys: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of &curve for the range of its parameter, and the given further ones."""
    for key in ("parameter", "from", "to"):
        if key in keys:
            raise ModelError(f"&curve: '{key}' follows from the arguments path, start and stop; leave it out")
    keys = {"start" if key == "first" else key: value for key, value in keys.items()}
    check_keys("curve", keys)
    return {"from": numbers_of("start", start)[0], "to": numbers_of("stop", stop)[0], **keys}


def value_at(path: InputPath, groups: Groups) -> Any:
    """The value at a path in complete groups; ModelError, with what is known, if there is none."""
    group = groups.find(path)
    if group is None:
        n = len(groups.named(path.group))
        if n > 1 and path.which is None:
            raise ModelError(f"'{path.written}': there are several groups &{path.group}; "
                             "a number, 'law[0].gap', or a label chooses one")
        if n > 0 and isinstance(path.which, int):
            there = ", ".join(f"{path.group}[{k}]" for k in range(n))
            raise ModelError(f"'{path.written}': there is no such &{path.group}; the model has {there}")
        names = list(dict.fromkeys(other.name for other in groups))
        known = f"known groups: {', '.join(names)}"
        labels = [other.label for other in groups.named(path.group) if other.label]
        if isinstance(path.which, str) and labels:
            hint = meant(path.which, labels + names) or ";"
            raise ModelError(f"'{path.written}': no group &{path.group} has the label '{path.which}'{hint} labels: "
                             f"{', '.join(map(repr, labels))}; {known}")
        raise ModelError(f"'{path.written}': there is no such value; {known}")
    value = group.get(path.key, path.indices)
    if value is None and path.key in group.keys:
        whole = group.keys[path.key]
        n = len(whole) if isinstance(whole, tuple) else 1
        hint = f", row by row: it has one index, {path.key}({n})" if len(path.indices) > 1 else ""
        raise ModelError(f"'{path.written}': {path.key} has {n} value{'s' * (n > 1)}{hint}")
    if value is None:
        hint = meant(path.key, list(group.keys)) or ";"
        raise ModelError(f"'{path.written}': there is no such value{hint} known keys: {', '.join(group.keys)}")
    return list(value) if isinstance(value, tuple) else value


def described(path: InputPath, groups: Groups) -> dict[str, str]:
    """Name and unit of a value by its path, for axes of pictures."""
    group = groups.find(path)
    if path.group == "tones" and path.key in ("frequency", "hertz"):
        n_tones = len(np.atleast_1d(group.keys.get(path.key, ()))) if group is not None else 0
        number = chr(0x2080 + path.indices[0]) if path.indices and n_tones > 1 else ""
        letter, unit = {"frequency": ("ω", "rad/s"), "hertz": ("f", "Hz")}[path.key]
        return {"long_name": f"Excitation frequency {letter}{number}", "units": unit}
    key = groups.key_at(path)
    name = path.key.replace("_", " ").capitalize()
    if isinstance(path.which, str):
        name += f" of {path.which}"
    elif path.which is not None:
        name += f" of {path.group} {path.which}"
    if path.indices and group is not None and np.size(group.keys.get(path.key, ())) > 1:
        name += f", entry {', '.join(map(str, path.indices))}"
    return {"long_name": name, "units": key.unit if key is not None and key.unit else "1"}


def changed_values(before: str, after: str, varied: Iterable[str]) -> str:
    """The first number by which two complete inputs differ, in words, other than those at the paths `varied` and those that follow
    others; empty if there is none."""
    groups = {text: Groups.of_text(text) for text in (before, after)}
    free = [groups[after].resolved(path) for path in varied]
    free += [path_of(str(tie.keys["parameter"])) for tie in groups[after].named("tie")]
    skipped = {(id(groups[after].find(path)), path.key) for path in free}
    for name in ("structure", *labelled_groups(), "tones", "load"):  # groups that a motion satisfies
        old, new = groups[before].named(name), groups[after].named(name)
        if len(old) != len(new):
            return f"it has {len(new)} groups &{name}, and had {len(old)}"
        for k, (was, now) in enumerate(zip(old, new)):
            for key, value in now.keys.items():
                other = was.keys.get(key)
                old_numbers, new_numbers = np.asarray(other).ravel(), np.asarray(value).ravel()
                if (id(now), key) in skipped or not {old_numbers.dtype.kind, new_numbers.dtype.kind} <= {"f", "i"}:
                    continue
                if not np.array_equal(old_numbers, new_numbers):
                    which = f"({now.label or k + 1})" if name in repeated_groups() else ""
                    return f"{name}{which}%{key} is {as_input(value)}, and was {as_input(other)}"
    return ""


def absolute_files(text: str, folder: Path) -> str:
    """The input with paths of its files that do not depend on the folder."""

    def absolute(match: re.Match[str]) -> str:
        there = folder / match[2]
        return f"{match[1]}'{there.resolve()}'" if there.is_file() else match[0]

    return re.sub(r"( (?:file|library|stiffness_file|table) = )'([^']+)'", absolute, text)
