"""Groups of an input as values of Python, and structures that the solver builds itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from nhbm.errors import ModelError

GROUPS = (
    "structure", "bearing", "dynamic_stiffness", "tones", "phase", "harmonics", "sampling", "load", "law", "start", "normal_mode",
    "solver", "certificate", "stability",
    "output", "integration", "accuracy", "curve", "tie", "gradient",
)  # fmt: skip


def as_input(value: Any) -> str:
    """A value, or a list of them, as an input has it."""
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.ndim else value.item()
    if isinstance(value, (list, tuple, range)):
        return ", ".join(map(as_input, value))
    if isinstance(value, (bool, np.bool_)):
        return ".true." if value else ".false."
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, (int, np.integer)):
        return repr(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    raise ModelError(f"{value!r} is no number, text, truth or list of them")


def numbers_of(name: str, values: Any, kind: type = float) -> list[Any]:
    """Values as a flat list of float or int, one for a single value; ModelError, which names the argument, for others."""
    try:
        numbers = [kind(value) for value in np.ravel(values)]
        if not numbers or (kind is int and numbers != [float(value) for value in np.ravel(values)]):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        what = "whole numbers" if kind is int else "numbers"
        raise ModelError(f"{name} must be {what}, not {values!r}") from None
    return numbers


def group_text(name: str, keys: Mapping[str, Any]) -> str:
    """A group of an input: keys whose value is None are left out."""
    given = ", ".join(f"{key} = {as_input(value)}" for key, value in keys.items() if value is not None)
    return f"&{name} {given} /\n"


def path_of(path: str) -> str:
    """A path of the input: `tones[0]` is tones%frequency(1), `wall.gap` law(wall)%gap, `load[1].cos` load(2)%cos.

    What names a group (`structure.length`) is a key of it; paths of the input itself stay as they are.
    """
    if not isinstance(path, str):
        raise ModelError(f"a path is a text such as 'wall.gap' or 'tones[0]', not {path!r}")
    if "%" in path:
        return path
    match = re.fullmatch(r"([\w ]+?)(?:\[(\d+)\])?(?:\.(\w+)(?:\[(\d+)\])?)?", path)
    if match is None:
        raise ModelError(f"'{path}' is no path; 'wall.gap', 'tones[0]' and 'load[1].cos' are")
    name, number, key, element = match.groups()
    if key is None:
        if name != "tones":
            raise ModelError(f"'{path}' names no key; 'wall.gap' and 'load[1].cos' do")
        key, element, number = "frequency", number, None
    group = f"{name}({int(number) + 1})" if number is not None else name
    if name not in GROUPS:
        group = f"law({name})"
    return f"{group}%{key}" + (f"({int(element) + 1})" if element is not None else "")


def identifier(path: str) -> str:
    """A path of the input as a name, as the result file has it: law(wall)%gap is law_wall_gap."""
    return re.sub("[^a-z0-9]+", "_", path.lower()).strip("_")


_PATH = re.compile(r"(\w+)(?:\(([^()]*)\))?%(\w+)(?:\((\d+)\))?")
_WORD = re.compile(r"(?:(\d+)\*)?('(?:[^']|'')*'|[^\s,']+)")


def _bodies(text: str, group: str) -> list[str]:
    """The groups of a name in a complete input, one key in a line."""
    return [body for name, body in re.findall(r"^&(\w+)\n(.*?)^/", text, re.DOTALL | re.MULTILINE) if name == group]


def value_of(path: str, text: str) -> Any:
    """The value at a path in a complete input: a number, text, truth or list of them."""
    match = _PATH.fullmatch(path)
    group, which, key, element = match.groups() if match else ("", None, "", None)
    bodies = _bodies(text, group)
    if which is not None:
        bodies = bodies[int(which) - 1 : int(which)] if which.isdigit() else [b for b in bodies if f"label = '{which}'\n" in b]
    lines = [re.search(rf"^ *{key} = ((?:[^\n]*,\n)*[^\n]*)$", body, re.MULTILINE) for body in bodies]
    if len(lines) != 1 or lines[0] is None:
        if len(bodies) > 1:
            raise ModelError(f"'{path}': there are several groups &{group}; a number, 'law[0].gap', or a label chooses one")
        raise ModelError(f"'{path}': there is no such value; {_known(text, bodies)}")
    values = [_value(word) for times, word in _WORD.findall(lines[0][1]) for _ in range(int(times or 1))]
    if element is not None:
        if not 1 <= int(element) <= len(values):
            raise ModelError(f"'{path}': {key} has {len(values)} values")
        return values[int(element) - 1]
    return values[0] if len(values) == 1 else values


def _known(text: str, bodies: list[str]) -> str:
    if bodies:
        return "known keys: " + ", ".join(re.findall(r"^ *(\w+) = ", bodies[0], re.MULTILINE))
    return "known groups: " + ", ".join(dict.fromkeys(re.findall(r"^&(\w+)$", text, re.MULTILINE)))


def _value(word: str) -> Any:
    if word.startswith("'"):
        return word[1:-1].replace("''", "'")
    if word in (".true.", ".false."):
        return word == ".true."
    return int(word) if re.fullmatch(r"[-+]?\d+", word) else float(word)


def without_group(text: str, name: str) -> str:
    """An input without a group; its lines stay, so that messages name the lines of the others."""
    group = rf"""^[ \t]*&{name}\b(?:'[^']*'|"[^"]*"|![^\n]*|[^'"!/])*/"""
    return re.sub(group, lambda match: "\n" * match[0].count("\n"), text, flags=re.IGNORECASE | re.MULTILINE)


def described(path: str, text: str, keys: Iterable[Any]) -> dict[str, str]:
    """Name and unit of a value by its path, for axes of pictures; `text` is the complete input and `keys` the table of keys."""
    match = _PATH.fullmatch(path)
    if match is None:
        return {}
    group, which, key, element = match.groups()
    bodies = _bodies(text, group)
    named = [body for body in bodies if f"label = '{which}'" in body]
    if (group, key) == ("tones", "frequency"):
        several = re.search(r"frequency = .*,", bodies[0])
        number = chr(0x2080 + int(element)) if element and several else ""
        return {"long_name": f"Excitation frequency ω{number}", "units": "rad/s"}
    body = (named or bodies[int(which) - 1 if (which or "").isdigit() else 0 :] or [""])[0]
    kind = re.search(r"type = '(\w+)'", body)
    sections = (f"{group} {kind[1]}" if kind else group, group)
    unit = next((row.unit for row in keys if row.section in sections and row.name == key), "")
    name = key.replace("_", " ").capitalize() + (f" of {which if named else f'{group} {which}'}" if which else "")
    return {"long_name": name, "units": unit} if unit else {"long_name": name}


class Builder:
    """A structure that the solver builds: `&structure` with its keys, which docs/user/input.md names with their units.

    Examples
    --------
    >>> import nhbm
    >>> nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0)
    Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0)
    """

    type = ""

    def __init__(self, *values: Any, **keys: Any) -> None:
        name = type(self).__name__
        if values:
            raise ModelError(f"nhbm.{name} takes its keys by name, {name}(key=value, ...); docs/user/input.md lists them")
        if "type" in keys:
            raise ModelError(f"nhbm.{name} is &structure type = '{self.type}'; leave 'type' out")
        self.keys: dict[str, Any] = {"type": self.type, **keys}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.keys.items() if k != 'type')})"


class Beam(Builder):
    """Euler-Bernoulli beam of finite elements."""

    type = "beam"


class Chain(Builder):
    """A chain of masses, with springs and dashpots between them and to ground."""

    type = "chain"


class ModalBeam(Builder):
    """A simply supported beam by its first modes."""

    type = "modal_beam"


class Jeffcott(Builder):
    """A disk on a massless shaft."""

    type = "jeffcott"


class RotorStator(Builder):
    """A bladed disk and a casing."""

    type = "rotor_stator"


def _square(name: str, matrix: Any, n: int = 0) -> Any:
    """A full matrix of n rows, by default of as many as it has; ModelError for another shape."""
    try:
        full = np.atleast_2d(np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=float))
    except (TypeError, ValueError):
        raise ModelError(f"{name} must be a square matrix of numbers, not {matrix!r}") from None
    n = n or len(full)
    if full.shape != (n, n):
        raise ModelError(
            f"{name} has the shape {full.shape}, not {(n, n)}; [[1, 0], [0, 1]] has two degrees of freedom, as np.diag([1, 1])"
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
