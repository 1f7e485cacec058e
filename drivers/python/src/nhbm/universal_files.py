"""Universal files of test software (.uff, .unv): functions over the frequency, datasets 58 and 58b, with the units of dataset 164.

Source: SDRC Universal File Formats, datasets 58 and 164 (University of Cincinnati, SDRL).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nhbm.errors import ModelError, check_file

_DISPLACEMENT, _REACTION, _VELOCITY, _ACCELERATION, _FORCE, _FREQUENCY = 8, 9, 11, 12, 13, 18
_ORDERS = {_DISPLACEMENT: 0, _VELOCITY: 1, _ACCELERATION: 2}  # of the derivative by time
_AXES = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z", 4: "+RX", -4: "-RX",
         5: "+RY", -5: "-RY", 6: "+RZ", -6: "-RZ", 0: ""}  # fmt: skip
_FRF, _SPECTRUM = 4, 12  # kinds of functions
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "mil": 2.54e-5, "ft": 0.3048}
_FORCES = {"n": 1.0, "kn": 1e3, "lbf": 4.4482216152605, "lb": 4.4482216152605, "kgf": 9.80665, "dyn": 1e-5}
_GRAVITY = 9.80665
_DTYPES = {2: ("f4", 1), 4: ("f8", 1), 5: ("f4", 2), 6: ("f8", 2)}  # of the ordinate: kind, numbers a value


@dataclass
class Function:
    """A function of a file, as it is: abscissa, ordinate, and what they are."""

    name: str  # response and reference, "12:+Z/3:+Z"
    kind: int  # 4: frequency response
    abscissa: np.ndarray
    values: np.ndarray
    abscissa_type: int
    numerator: int
    denominator: int
    factors: tuple[float, float]  # of dataset 164: a length and a force of the SI in the units of the file
    units: tuple[str, ...]  # labels of abscissa, ordinate and its denominator


def read_uff(path: Any, force: float | None = None, function: str | None = None, unit: str | None = None) -> dict[str, np.ndarray]:
    """A measured response of a universal file (58, 58b), for `fit`.

    Parameters
    ----------
    path : str or Path
        The file. Its dataset 164, if there is one, gives the units, by default those of the SI.
    force : float, optional
        Amplitude of the force [N] at which a frequency response function was measured: the file has only their ratio.
    function : str, optional
        Which one, by response and reference, "12:+Z/3:+Z"; needed where there are several.
    unit : str, optional
        Of the values, such as "m/s^2/N", "g/lbf" or "mm": needed where the file does not tell it, or its label tells another one
        than its types and dataset 164.

    Returns
    -------
    dict
        `hertz` [Hz], or `frequency` [rad/s] where the file has that unit, `amplitude` [m], of the displacement also where velocity
        or acceleration was measured, `phase` [rad], negative where it lags behind the force. Points at zero frequency are left out.
        Spectra are taken as amplitudes: a file does not tell whether they are RMS values.
    """
    path = Path(path)
    found = _chosen(path, functions_of(path), function)
    order, scale, is_ratio = _measured(f"'{path}': {found.name}", found, unit)
    if found.abscissa_type != _FREQUENCY:
        raise ModelError(f"'{path}': {found.name} is over the type {found.abscissa_type}, not over the frequency (18)")
    over = found.units[0].lower()
    if over not in ("", "none", "hz", "hertz", "rad/s", "rad/sec"):
        raise ModelError(f"'{path}': {found.name} is over '{found.units[0]}', not over Hz or rad/s")
    if not np.iscomplexobj(found.values):
        raise ModelError(f"'{path}': {found.name} is real, without a phase")
    if is_ratio and force is None:
        raise ModelError(f"'{path}': {found.name} is a response divided by the force; give the amplitude of the force [N]: force=")
    if not is_ratio and force is not None:
        raise ModelError(f"'{path}': {found.name} has no force as its reference; leave out force=")
    if force is not None and not 0 < force < np.inf:
        raise ModelError(f"the force is an amplitude [N] above 0, not {force}")
    is_circular = over.startswith("rad")
    used = found.abscissa > 0
    omega = found.abscissa[used] * (1.0 if is_circular else 2 * np.pi)
    motion = found.values[used] * scale / (1j * omega) ** order * (force or 1.0)
    if not (np.abs(motion) > 0).all() or not np.isfinite(motion).all():
        raise ModelError(f"'{path}': {found.name} has a value that is zero or not finite")
    return {"frequency" if is_circular else "hertz": found.abscissa[used], "amplitude": np.abs(motion), "phase": np.angle(motion)}


def _measured(what: str, found: Function, unit: str | None) -> tuple[int, float, bool]:
    """Order of the derivative by time, factor from the values to the SI, whether they are divided by a force."""
    if found.kind not in (0, _FRF, _SPECTRUM):
        raise ModelError(f"{what} is a function of the type {found.kind}, not a frequency response (4) or a spectrum (12)")
    numerator, denominator = ("" if text.upper() == "NONE" else text for text in found.units[1:])
    has_force = (_unit_of(numerator) or (0, 1.0, False))[2]
    label = f"{numerator}/{denominator}" if numerator and denominator and not has_force else numerator
    said = _unit_of(label)
    if unit is not None:
        wanted = _unit_of(unit)
        if wanted is None:
            raise ModelError(f"'{unit}' is not the unit of a motion, alone or divided by a force, such as m/s^2/N, g/lbf or mm")
        return wanted
    remedy = f"{f'; its label is {label!r}' * bool(label)}: give unit=, such as m/s^2/N"
    if found.numerator not in _ORDERS:
        raise ModelError(f"{what} has the ordinate type {found.numerator}, not displacement (8), velocity (11) or acceleration "
                         f"(12): it is not told what was measured{remedy}")  # fmt: skip
    if found.denominator not in (_FORCE, _REACTION, 0):
        raise ModelError(f"{what}: its reference is of the type {found.denominator}, not a force (13)")
    if found.denominator == 0 and found.kind != _SPECTRUM:
        raise ModelError(f"{what} does not tell what its reference is{remedy}")
    length, force = found.factors
    is_ratio = found.denominator != 0
    by_types = _ORDERS[found.numerator], force**is_ratio / length, is_ratio
    expected = by_types[1] if said is None or said[2] == is_ratio else 1 / length
    if label and (said is None or said[0] != by_types[0] or not 0.98 < said[1] / expected < 1.02):
        raise ModelError(f"{what} has values in {label!r} by its label, and by its types and dataset 164 another unit: "
                         "give unit=, such as m/s^2/N")  # fmt: skip
    return by_types


def _unit_of(text: str) -> tuple[int, float, bool] | None:
    """Order of the derivative by time, factor to the SI, whether it is divided by a force, of a unit such as (1/N)*(m/s^2)."""
    text = re.sub(r"(?<=s)[\ufffd\u00b2]+", "2", text.strip().lower())
    text = re.sub(r"[\ufffd\u00b5\u03bc]+(?=m)", "u", text).replace("sec", "s").replace("s/s", "s2")
    text = re.sub(r"[\s()^*\[\]]", "", re.sub(r"^\(?1/([a-z]+)\)?\*(.*)", r"\2/\1", text))
    match = re.fullmatch(r"([a-z]+)(/s2?)?(?:/([a-z]+))?", text)
    if match is None or (match[3] and match[3] not in _FORCES):
        return None
    force = _FORCES[match[3]] if match[3] else 1.0
    if match[1] in ("g", "gn"):
        return None if match[2] else (2, _GRAVITY / force, bool(match[3]))
    order = {None: 0, "/s": 1, "/s2": 2}[match[2]]
    return (order, _LENGTHS[match[1]] / force, bool(match[3])) if match[1] in _LENGTHS else None


def _chosen(path: Path, known: list[Function], name: str | None) -> Function:
    listed = ", ".join(f.name for f in known)
    if name is None:
        if len(known) > 1:
            raise ModelError(f"'{path}' has {len(known)} functions; give one of function={listed}")
        return known[0]
    fitting = [f for f in known if f.name == name]
    if len(fitting) != 1:
        raise ModelError(f"'{path}' has {len(fitting) or 'no'} function{'s' * (len(fitting) != 1)} '{name}'; it has {listed}")
    return fitting[0]


def functions_of(path: Any) -> list[Function]:
    """All functions of a file."""
    path = Path(path)
    check_file(path)
    data = path.read_bytes()
    marks = [match.start() for match in re.finditer(rb"^ {4}-1[ \r]*$", data, re.MULTILINE)]
    found: list[Function] = []
    length, force, at = 1.0, 1.0, 0
    try:
        while True:
            start = next((mark for mark in marks if mark >= at), None)
            if start is None or not data[start + 6 :].strip():  # pyuff may leave a mark at the end
                break
            lines = _Lines(data, data.index(b"\n", start) + 1)
            head = lines.next()
            if head[:6].strip() == "164":
                lines.next()
                factors = lines.next().upper().replace("D", "E")
                length, force = float(factors[:25]), float(factors[25:50])
                if not (length > 0 and force > 0):
                    raise ValueError("dataset 164 has no positive factors")
            elif head[:6].strip() == "58" or head[:7].strip() in ("58b", "58B"):
                found.append(_function(lines, head, length, force))
            end = next((mark for mark in marks if mark >= lines.at), None)  # behind binary numbers not in a new line
            if end is None and re.match(rb"[ \r\n]*-1", data[lines.at :]):
                end = data.index(b"-1", lines.at) - 4
            if end is None:
                raise ValueError("its last dataset does not end")
            at = end + 6
    except (ValueError, IndexError) as error:
        raise ModelError(f"'{path}' is not a universal file that can be read: {error}") from None
    if not found:
        raise ModelError(f"'{path}' has no function (dataset 58)")
    return found


class _Lines:
    """Lines of a file of bytes, from a place on."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at = data, at

    def next(self) -> str:
        end = self.data.find(b"\n", self.at)
        if end < 0:
            raise ValueError("it ends too soon")
        line = self.data[self.at : end].decode("ascii", "replace").rstrip("\r")
        self.at = end + 1
        return line


def _function(lines: _Lines, head: str, length: float, force: float) -> Function:
    """Dataset 58, or 58b, whose numbers are binary."""
    for _ in range(5):
        lines.next()
    kind_of = lines.next()
    ends = [(int(kind_of[k : k + 10]), int(kind_of[k + 10 : k + 14])) for k in (41, 66)]  # node and axis: response, reference
    shape = lines.next()
    dtype, n, is_even = (int(shape[k : k + 10]) for k in (0, 10, 20))
    first, step = float(shape[30:43]), float(shape[43:56])
    if dtype not in _DTYPES or n < 1:
        raise ValueError(f"a function has values of the type {dtype}, {n} of them")
    axes = [lines.next() for _ in range(4)]
    types = [int(axis[:10]) for axis in axes[:3]]
    real, per_value = _DTYPES[dtype]
    if "b" in head[:7].lower():
        order = {1: "<", 2: ">"}.get(int(head[7:13]), "")
        if not order or int(head[13:19]) != 2:
            raise ValueError("its binary numbers are not those of IEEE 754")
        columns = _binary(lines, n, f"{order}{real}", per_value, bool(is_even))
    else:
        n_columns = per_value + (not is_even)
        numbers: list[float] = []
        widths = _text_widths(real, per_value, bool(is_even))
        while len(numbers) < n * n_columns:
            line, at = lines.next().replace("D", "E"), 0
            if line.strip() == "-1":
                raise ValueError(f"a function has {len(numbers)} of {n * n_columns} numbers")
            while line[at:].strip():
                width = widths[len(numbers) % len(widths)]
                numbers.append(float(line[at : at + width]))
                at += width
        columns = np.reshape(numbers[: n * n_columns], (n, n_columns))
    if not np.isfinite(columns).all():
        raise ValueError("a function has a number that is not finite")
    abscissa = first + step * np.arange(n) if is_even else columns[:, 0]
    values = columns[:, -1] if per_value == 1 else columns[:, -2] + 1j * columns[:, -1]
    units = tuple(axis[47:67].strip() for axis in axes[:3])
    name = "/".join(f"{node}:{_AXES.get(axis, axis)}" for node, axis in ends)
    return Function(name, int(kind_of[:5]), abscissa, values, types[0], types[1], types[2], (length, force), units)


def _binary(lines: _Lines, n: int, kind: str, per_value: int, is_even: bool) -> np.ndarray:
    """Numbers behind which the mark of the end stands; an uneven abscissa is in single precision, or in that of the values."""
    for first in [[]] if is_even else [[kind], [kind[0] + "f4"]]:
        row = np.dtype([(f"c{k}", one) for k, one in enumerate([*first, *[kind] * per_value])])
        end = lines.at + n * row.itemsize
        if re.match(rb"[ \r\n]*-1[ \r]*(\n|$)", lines.data[end : end + 12]):
            table = np.frombuffer(lines.data, row, n, lines.at)
            lines.at = end
            return np.column_stack([table[name].astype(float) for name in row.names or ()])
    raise ValueError("the binary numbers of a function do not end where they should")


def _text_widths(real: str, per_value: int, is_even: bool) -> list[int]:
    """Fields of the numbers of a line: 13 columns in single precision, 20 in double; the abscissa has 13 always."""
    ordinate = [13 if real == "f4" else 20] * per_value
    return ordinate if is_even else [13, *ordinate]


def write_uff(path: Any, hertz: Any, values: Any, dof: tuple[int, str], per_force: bool, title: str) -> None:
    """Writes displacements [m], or receptances [m/N], over the frequency [Hz] as dataset 58, with dataset 164 (SI)."""
    hertz, values = np.asarray(hertz, dtype=float), np.asarray(values, dtype=complex)
    kind, axis = _FRF if per_force else _SPECTRUM, next((number for number, name in _AXES.items() if name == dof[1]), 0)
    ends = f" {'NONE':<10}{dof[0]:10d}{axis:4d}" + f" {'NONE':<10}{dof[0] if per_force else 0:10d}{axis if per_force else 0:4d}"
    lines = [f"{-1:6d}", f"{164:6d}", f"{1:10d}{'SI: Meter (newton)':<20}{2:10d}", "".join(f"{x:25.16E}" for x in (1.0, 1.0, 1.0)),
             f"{273.15:25.16E}", f"{-1:6d}", f"{-1:6d}", f"{58:6d}", f"{title[:80]:<80}", *4 * [f"{'NONE':<80}"]]  # fmt: skip
    lines.append(f"{kind:5d}{1:10d}{0:5d}{0:10d}{ends}")
    lines.append(f"{6:10d}{len(hertz):10d}{0:10d}{hertz[0]:13.5E}{0.0:13.5E}{0.0:13.5E}")
    for number, label, unit in ((_FREQUENCY, "Frequency", "Hz"), (_DISPLACEMENT, "Displacement", "m"),
                                (_FORCE if per_force else 0, "Force" if per_force else "NONE", "N" if per_force else "NONE"),
                                (0, "NONE", "NONE")):  # fmt: skip
        lines.append(f"{number:10d}{0:5d}{0:5d}{0:5d} {label:<20} {unit:<20}")
    lines += [f"{f:13.5E}{value.real:20.12E}{value.imag:20.12E}" for f, value in zip(hertz, values)]
    Path(path).write_text("\n".join([*lines, f"{-1:6d}"]) + "\n", encoding="ascii", errors="replace")
