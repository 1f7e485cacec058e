"""Groups of an input as objects: keys with values of Python, paths to single values, and structures that the solver builds."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from decimal import Decimal
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from nhbm.errors import ModelError
from nhbm.keys import check_keys, keys_of, labelled_groups, missing_key, model_groups, repeated_groups
from nhbm.signatures import STRUCTURES

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from nhbm import signatures

OPERATIONS = "sweep", "curve"  # groups of an input that are operations of a model
SETS = "order", "tuples", "set", "odd_only"  # keys of &harmonics that fix them
_EXPECTED = "expected a real number, text, bool or list of them, not"


def plain(value: Any) -> Any:
    """A value as Python has it, hashable: numbers, texts, truths, tuples of them; objects that the input names stay as they are."""
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
    if isinstance(value, str) and "\n" in value:
        raise ModelError(f"a text of an input has one line, not {value!r}")
    if value is None or isinstance(value, (bool, int, float, str)) or hasattr(value, "input_name"):
        return value
    raise ModelError(f"{_EXPECTED} {value!r}")


def _plain_of(group: str, key: str, value: Any) -> Any:
    """A value of a key, which is named where the value is none of an input."""
    try:
        return plain(value)
    except ModelError as error:
        raise ModelError(f"&{group}: {key}: {error}") from None


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
    except (TypeError, ValueError, OverflowError):
        what = "whole numbers" if kind is int else "a number" if np.ndim(values) == 0 else "numbers"
        raise ModelError(f"{name} must be {what}, not {values!r}") from None
    return numbers


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
        raise ModelError(f"'{path}' is no path; 'wall.gap', 'tones[0]' and 'load[1].cos' are{hint}")
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


def check_label(group: str, label: str) -> None:
    """Raises ModelError for a label that no path can contain, or that a path would take for a number."""
    if not label.strip() or label.strip().isdigit() or re.search(r"[.%()\[\]]", label):
        raise ModelError(f"&{group}: label {label!r} cannot be part of a path such as 'wall.gap': it must have a letter, and "
                         "none of . % ( ) [ ]")  # fmt: skip


def identifier(path: str) -> str:
    """A path of the input as a name, as the result file has it: law(wall)%gap is law_wall_gap."""
    return re.sub("[^a-z0-9]+", "_", path.lower()).strip("_")


class Group:
    """A group of the input: its name, and the values of its keys. A key with indices, `mass(2)`, has one of several values."""

    def __init__(self, name: str, keys: Mapping[str, Any]) -> None:
        self.name = name
        self.keys = {key: _plain_of(name, key, value) for key, value in keys.items() if value is not None}

    def __repr__(self) -> str:
        return f"<{self.name}: {', '.join(f'{key} = {value!r}' for key, value in self.keys.items())}>"

    def put(self, key: str, value: Any) -> None:
        """Sets a key; None removes it. Values of all indices replace those of single ones; a single one is set among all."""
        if "(" not in key:
            self.keys = {name: old for name, old in self.keys.items() if not name.startswith(f"{key}(")}
        value = plain(value)
        whole = key.partition("(")[0]
        if whole != key and whole in self.keys:
            values, k = self._element(key)
            values[k] = value
            self.keys[whole] = tuple(values) if len(values) > 1 else value
            return
        if value is None:
            self.keys.pop(key, None)
        else:
            self.keys[key] = value

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

    def text(self) -> str:
        """The group as an input has it."""
        return f"&{self.name}\n" + "".join(f"   {key} = {as_input(value)}\n" for key, value in self.keys.items()) + "/\n"


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

    def copied(self) -> Groups:
        """Groups of their own with the same values."""
        return Groups(Group(group.name, group.keys) for group in self._all)

    def number_of(self, group: Group) -> int:
        """Number of a group among those of its name, from 1."""
        return 1 + next(k for k, other in enumerate(self.named(group.name)) if other is group)

    def with_settings(self, settings: Settings) -> Groups:
        """These groups with those of an operation, which replace keys of the same name, or whole groups."""
        groups = Groups(self._all)
        for name, keys in settings.items:
            own = groups.first(name)
            groups._all = [group for group in groups._all if group is not own]
            if keys is None:
                continue
            merged = Group(name, {} if own is None or name in _REPLACED else own.keys)
            for key, value in keys:
                merged.put(key, value)
            if merged.keys or own is not None:
                groups.add(merged)
        return groups

    def text(self) -> str:
        """The groups as an input."""
        return "".join(group.text() for group in self._all)

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


_REPLACED = "curve", "gradient"  # groups that an operation gives complete
_WORD = re.compile(r"(?:(\d+)\*)?('(?:[^']|'')*'|[^\s,']+)")


def _value(word: str) -> Any:
    if word.startswith("'"):
        return word[1:-1].replace("''", "'")
    if word in (".true.", ".false."):
        return word == ".true."
    return int(word) if re.fullmatch(r"[-+]?\d+", word) else float(word)


class Settings(NamedTuple):
    """What an operation adds to the groups of a model; hashable. The keys of a group, or None to leave the group out."""

    items: tuple[tuple[str, tuple[tuple[str, Any], ...] | None], ...] = ()

    @classmethod
    def of(cls, groups: Mapping[str, Mapping[str, Any] | None]) -> Settings:
        """From keys by name of the group."""
        return cls(tuple(
            (name, None if keys is None else tuple((key, plain(value)) for key, value in keys.items()))
            for name, keys in groups.items()
        ))  # fmt: skip

    def has(self, path: InputPath) -> bool:
        """Whether the operation has the value at a path, which the model then does not change."""
        keys = dict(self.items).get(path.group, ())
        return keys is None or path.key in dict(keys)

    def without(self, group: str, key: str) -> tuple[Settings, Any]:
        """The settings without a key of a group, and its value; None if there is none."""
        rest = tuple((name, keys and tuple(item for item in keys if (name, item[0]) != (group, key))) for name, keys in self.items)
        return Settings(rest), dict(dict(self.items).get(group) or ()).get(key)


def request(tolerance: float | None = None, order: Any = None, **groups: Mapping[str, Any]) -> Settings:
    """The settings of an operation: a tolerance chooses the harmonics, an order fixes them."""
    if tolerance is not None and order is not None:
        raise ModelError("give a tolerance, which chooses the harmonics, or an order, which fixes them; not both")
    given: dict[str, Mapping[str, Any] | None] = dict(groups)
    if order is not None:
        given.update(harmonics={"order": order}, accuracy=None)
    elif tolerance is not None:
        given.update(accuracy={"tolerance": tolerance}, harmonics=dict.fromkeys(SETS))
    return Settings.of(given)


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
        known = dict.fromkeys(other.name for other in groups)
        raise ModelError(f"'{path.written}': there is no such value; known groups: {', '.join(known)}")
    value = group.get(path.key, path.indices)
    if value is None and path.key in group.keys:
        whole = group.keys[path.key]
        n = len(whole) if isinstance(whole, tuple) else 1
        hint = f", row by row: it has one index, {path.key}({n})" if len(path.indices) > 1 else ""
        raise ModelError(f"'{path.written}': {path.key} has {n} value{'s' * (n > 1)}{hint}")
    if value is None:
        raise ModelError(f"'{path.written}': there is no such value; known keys: {', '.join(group.keys)}")
    return list(value) if isinstance(value, tuple) else value


def described(path: InputPath, groups: Groups) -> dict[str, str]:
    """Name and unit of a value by its path, for axes of pictures."""
    group = groups.find(path)
    if path.group == "tones" and path.key in ("frequency", "hertz"):
        n_tones = len(np.atleast_1d(group.keys.get(path.key, ()))) if group is not None else 0
        number = chr(0x2080 + path.indices[0]) if path.indices and n_tones > 1 else ""
        letter, unit = {"frequency": ("ω", "rad/s"), "hertz": ("f", "Hz")}[path.key]
        return {"long_name": f"Excitation frequency {letter}{number}", "units": unit}
    key = keys_of(path.group, "" if group is None else str(group.keys.get("type", "")).lower()).get(path.key)
    name = path.key.replace("_", " ").capitalize()
    if isinstance(path.which, str):
        name += f" of {path.which}"
    elif path.which is not None:
        name += f" of {path.group} {path.which}"
    return {"long_name": name, "units": key.unit if key is not None and key.unit else "1"}


class Builder:
    """A structure that the solver builds: `&structure` with its keys, which docs/user/input.md names with their units.

    Examples
    --------
    >>> import nhbm
    >>> nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0)
    Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0)
    """

    type = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__init__" not in cls.__dict__ and cls.type in STRUCTURES:  # what help and completion show
            cls.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
                inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=inspect.Parameter.empty
                                  if is_required else None) for key, (kind, is_required) in STRUCTURES[cls.type].items()
            ])  # fmt: skip

    def __init__(self, *values: Any, **keys: Any) -> None:
        name = type(self).__name__
        if values:
            raise ModelError(f"nhbm.{name} takes its keys by name, {name}(key=value, ...); docs/user/input.md lists them")
        if "type" in keys:
            raise ModelError(f"nhbm.{name} is &structure type = '{self.type}'; leave 'type' out")
        self.keys: dict[str, Any] = {"type": self.type, **keys}
        check_keys("structure", self.keys, f"nhbm.{name}")
        missing = missing_key("structure", self.keys)
        if missing:
            raise ModelError(f"nhbm.{name}: missing key '{missing}'")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.keys.items() if k != 'type')})"


class Beam(Builder):
    """Euler-Bernoulli beam of finite elements."""

    type = "beam"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.BeamKeys]) -> None: ...


class Chain(Builder):
    """A chain of masses, with springs and dashpots between them and to ground."""

    type = "chain"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.ChainKeys]) -> None: ...


class ModalBeam(Builder):
    """A simply supported beam by its first modes."""

    type = "modal_beam"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.ModalBeamKeys]) -> None: ...


class Jeffcott(Builder):
    """A disk on a massless shaft."""

    type = "jeffcott"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.JeffcottKeys]) -> None: ...


class RotorStator(Builder):
    """A bladed disk and a casing."""

    type = "rotor_stator"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.RotorStatorKeys]) -> None: ...


def _square(name: str, matrix: Any, n: int = 0) -> Any:
    """A full matrix of n rows, by default of as many as it has; ModelError for another shape."""
    matrix = matrix.toarray() if hasattr(matrix, "toarray") else matrix
    try:
        if np.iscomplexobj(matrix):
            raise ModelError(f"{name} must be real; viscous damping is a matrix of its own, `damping`")
        if getattr(np.asarray(matrix), "dtype", np.dtype(float)).kind in "SU":  # NumPy reads "1e3" as a number
            raise ValueError
        full = np.atleast_2d(np.asarray(matrix, dtype=float))
    except (TypeError, ValueError):
        if getattr(getattr(matrix, "dtype", None), "kind", "") == "O":  # of scipy.io.loadmat, by default
            raise ModelError(f"{name} is an array of objects, as of a struct of MATLAB: scipy.io.loadmat(..., simplify_cells=True)"
                             " returns the matrix itself") from None  # fmt: skip
        raise ModelError(f"{name} must be a square matrix of numbers, not {matrix!r}") from None
    n = n or len(full)
    if full.shape != (n, n):
        raise ModelError(
            f"{name} has the shape {full.shape}, not {(n, n)}: matrices must be square and equal in size; "
            "np.diag makes one of a list"
        )
    return full


class Matrices(Builder):
    """Small full matrices; use Structure for large sparse ones.

    Parameters
    ----------
    mass, stiffness, damping : array_like or sparse matrix
        [kg], [N/m], [N s/m], (n_dofs, n_dofs); np.diag makes one of a list, which alone would be ambiguous.
    **keys
        Further keys of &structure type = 'matrices', such as `labels`; `n_dofs` follows from the matrices.
    """

    type = "matrices"

    def __init__(self, mass: Any = None, stiffness: Any = None, damping: Any = None, *values: Any, **keys: Any) -> None:
        if mass is None or stiffness is None or values:
            raise ModelError("nhbm.Matrices takes mass and stiffness (square matrices), optionally damping, further keys by name")
        mass = _square("mass", mass)
        if keys.pop("n_dofs", len(mass)) != len(mass):
            raise ModelError(f"n_dofs follows from the matrices; leave it out: mass is {len(mass)} x {len(mass)}")
        more = {
            name: _square(name, m, len(mass)).ravel()
            for name, m in (("stiffness", stiffness), ("damping", damping))
            if m is not None
        }
        super().__init__(n_dofs=len(mass), mass=mass.ravel(), **more, **keys)


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
