"""Measured responses, of which parameters are fitted: tables and CSV files, a set of points for each sweep and condition."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nhbm import advice
from nhbm.errors import Implausible, ModelError
from nhbm.paths import path_of
from nhbm.universal_files import read_uff
from nhbm.values import numbers_of

if TYPE_CHECKING:
    from nhbm.model import Model

Array = Any  # np.ndarray
_RELATIVE = 0.01  # standard deviation of amplitudes, relative, where none is given; it is then scaled by the residuals
_COLUMNS = "frequency", "hertz", "amplitude", "phase", "sweep", "sigma"
_SWEEPS = "up", "down"


@dataclass
class MeasuredSet:
    """Measured points of one sweep: values of the parameter, ascending, amplitudes, phases [rad] or None, standard deviations."""

    at: Array
    amplitude: Array
    phase: Array | None
    sigma: Array
    conditions: tuple[tuple[str, float], ...] = ()
    sweep: str = ""
    force: Array | None = None  # measured, where the response was controlled

    @property
    def measured(self) -> Array:
        """The measured amplitudes: of the response or, where this was controlled, of the force."""
        return self.amplitude if self.force is None else self.force

    @property
    def name(self) -> str:
        """What it differs in from others."""
        return ", ".join([*(f"{path} = {value:g}" for path, value in self.conditions), *([self.sweep] if self.sweep else [])])


def backbone(amplitude: Any, hertz: Any, damping_ratio: Any, mass: float, *, load: str = "load[0].cos") -> dict[str, Any]:
    """Turns a measured backbone, from free decay or phase resonance, into data for `nhbm.fit(..., controlled=True)`.

    Parameters
    ----------
    amplitude : array_like
        Of the first harmonic at the measured degree of freedom [m].
    hertz : array_like
        Frequencies of resonance at these amplitudes [Hz].
    damping_ratio : array_like
        Relative to critical damping.
    mass : float
        Modal mass at that degree of freedom [kg].
    load : str
        Path of the amplitude of the load at that degree of freedom.

    Returns
    -------
    dict
        Columns `hertz`, `amplitude`, `phase` and that of the load: the force 2 zeta omega^2 m a that holds the amplitude a at phase
        resonance, where the response lags by a quarter of a period.

    Examples
    --------
    >>> import nhbm
    >>> data = nhbm.backbone([1e-3], [50.0], [0.01], mass=2.0)
    >>> f"{data['load[0].cos'][0]:.3f} N"
    '3.948 N'
    """
    columns = [np.array(numbers_of(name, values)) for name, values in
               (("amplitude", amplitude), ("hertz", hertz), ("damping_ratio", damping_ratio))]  # fmt: skip
    if len({len(column) for column in columns}) > 1:
        raise ModelError(f"amplitude, hertz and damping_ratio need equally many values, not {[len(column) for column in columns]}")
    if not all((column > 0).all() for column in columns) or not numbers_of("mass", mass)[0] > 0:
        raise ModelError("amplitudes, frequencies, damping ratios and the mass of a backbone must be above 0")
    a, f, zeta = columns
    if (zeta >= 1).any():
        raise ModelError(f"damping_ratio = {zeta.max():g} is above critical damping, where nothing vibrates; 2 % are 0.02")
    return {"hertz": f, "amplitude": a, "phase": np.full(len(a), -np.pi / 2), load: 2 * zeta * (2 * np.pi * f) ** 2 * mass * a}


def is_same(one: MeasuredSet, other: MeasuredSet) -> bool:
    """Whether two sets have the same numbers."""
    if (one.phase is None) != (other.phase is None) or len(one.at) != len(other.at):
        return False
    pairs = [(one.at, other.at), (one.measured, other.measured), (one.sigma, other.sigma), (one.phase, other.phase)]
    return all(a is None or np.array_equal(a, b) for a, b in pairs)


def n_measured(sets: list[MeasuredSet]) -> int:
    """Number of real numbers that were measured."""
    return sum(len(one.at) * (1 if one.phase is None else 2) for one in sets)


def measured_sets(data: Any, model: Model, of: str, at: str, noise: float | None,
                  controlled: bool) -> tuple[list[MeasuredSet], bool, str]:  # fmt: skip
    """The measured points, a set for each sweep and each combination of other values; whether their noise is to be estimated; the
    path of the force that was measured, where the response was controlled."""
    import pandas

    if isinstance(data, (str, Path)):
        try:
            return measured_sets(_read(Path(data)), model, of, at, noise, controlled)
        except ModelError as error:
            text = str(error)
            raise ModelError(text if f"'{data}'" in text else f"'{data}': {text}") from None
    if isinstance(data, Mapping):
        lengths = {str(name): len(column) for name, column in data.items() if np.ndim(column) == 1}
        if len(set(lengths.values())) > 1:
            raise ModelError("the columns of data differ in length: " + ", ".join(f"{name}: {n}" for name, n in lengths.items()))
    try:
        table = pandas.DataFrame(dict(data) if isinstance(data, Mapping) else data)
    except (TypeError, ValueError) as error:
        raise ModelError(f"data are no table: give lists by the names of their columns, a DataFrame or a path ({error})") from None
    heads = [re.fullmatch(r"(.*?)\s*(?:\[([^\]0-9]*)\])?", str(name).strip(), re.DOTALL) for name in table.columns]
    table.columns = [head[1] for head in heads if head]
    units = {head[1]: head[2].strip() for head in heads if head and head[2]}
    given = set(table.columns)
    if "amplitude" not in given or len(given & {"frequency", "hertz"}) != 1:
        known = ", ".join(sorted(given))
        if len(given) == 1:
            known += ", one column: commas separate columns"
        if any(map(_is_number, given)):
            known += "; the first row is that of the names"
        raise ModelError(f"data need the columns 'amplitude' and 'frequency' [rad/s] or 'hertz' [Hz]; there are: {known}")
    if table.empty:
        raise ModelError("data have no rows")
    try:
        others = {name: model._resolved(name) for name in table.columns if name not in _COLUMNS}
    except ModelError as error:
        raise ModelError(f"{error}; columns are {', '.join(_COLUMNS)}, or values of the model by their path") from None
    _check_units(units, {name: model._described(path)["units"] for name, path in others.items()}, model, of)
    for column in [name for name in table.columns if name != "sweep"]:
        wrong = [value for value in table[column].values if isinstance(value, str) and not _is_number(value)]
        if wrong:
            row = 1 + table[column].tolist().index(wrong[0])
            raise ModelError(f"column '{column}' must be numbers, not '{wrong[0]}' (row {row})")
        numbers = np.array(numbers_of(f"column '{column}'", table[column].values.tolist()))
        is_above_zero = column in ("amplitude", "frequency", "hertz", "sigma")
        if not np.isfinite(numbers).all() or (is_above_zero and not (numbers > 0).all()):
            raise ModelError(f"column '{column}' must have finite{' positive' if is_above_zero else ''} numbers")
        table[column] = numbers
    if "sweep" in given:
        wrong = sorted(set(table["sweep"].astype(str)) - set(_SWEEPS))
        if wrong:
            raise ModelError(f"column 'sweep' has 'up' and 'down', not {', '.join(map(repr, wrong))}")
    if noise is not None and not (0 < noise < 1 and "sigma" not in given):
        raise ModelError(f"noise is relative, above 0 and below 1, not {noise:g}: 2 % are 0.02; "
                         "leave it out where the data have a column 'sigma'")  # fmt: skip
    turned = float(table["phase"].abs().max()) if "phase" in given else 0.0
    if turned > 2 * np.pi:
        advice.warn(advice.on("phase_in_degrees", "column 'phase'", values=[turned]).text, Implausible)
    position = table["hertz" if "hertz" in given else "frequency"].values.astype(float)
    is_in_hertz = model._described(at)["units"] == "Hz"
    if "hertz" in given and not is_in_hertz:
        position = 2 * np.pi * position
    elif "frequency" in given and is_in_hertz:
        position = position / (2 * np.pi)
    _doubt_the_unit(model, position * (2 * np.pi if is_in_hertz else 1.0), "hertz" in given)
    table = table.assign(position=position)
    forces = [name for name, path in others.items() if path_of(path).group == "load" and path_of(path).key in ("cos", "sin")]
    force = forces[0] if controlled and len(forces) == 1 else None
    if force is not None and not (table[force] > 0).all():
        raise ModelError(f"column '{force}' must have positive numbers: the force that was measured")
    found = []
    keys = [*(name for name in others if name != force), *(["sweep"] if "sweep" in given else [])]
    for values, rows in table.groupby(keys if len(keys) > 1 else keys[0], sort=False) if keys else [((), table)]:
        values = values if isinstance(values, tuple) else (values,)
        rows = rows.sort_values("position", kind="stable")
        amplitude = rows["amplitude"].values.astype(float)
        sigma = rows["sigma"].values.astype(float) if "sigma" in given else (noise or _RELATIVE) * amplitude
        phase = rows["phase"].values.astype(float) if "phase" in given else None
        conditions = tuple((others[name], float(value)) for name, value in zip(keys, values) if name in others)
        sweep = str(values[-1]) if "sweep" in given else ""
        held = None if force is None else rows[force].values.astype(float)
        found.append(MeasuredSet(rows["position"].values, amplitude, phase, sigma, conditions, sweep, held))
    return found, noise is None and "sigma" not in given, "" if force is None else others[force]


def _read(path: Path) -> Any:
    """The table of a CSV file, or of a universal file."""
    import pandas

    if path.suffix.lower() in (".uff", ".unv", ".uf"):
        return read_uff(path)

    try:
        with open(path, encoding="utf-8") as file:
            head = next((line for line in file if line.strip() and not line.startswith("#")), "")
        for name, mark in (("semicolons", ";"), ("tabs", "\t")):
            if mark in head and "," not in head:
                raise ModelError(f"'{path}': {name} separate its columns; write commas between columns, and points in numbers")
        table = pandas.read_csv(path, comment="#", skipinitialspace=True)
        n, n_more = len(table.columns), table.index.nlevels - isinstance(table.index, pandas.RangeIndex)
        if n_more and len(table):  # pandas takes the first values for names of the rows
            raise ModelError(f"'{path}': its rows have {n + n_more} values, and the first one names {n} columns; "
                             "write commas between columns, and points in numbers")  # fmt: skip
        return table
    except FileNotFoundError:
        raise ModelError(f"file '{path}' does not exist") from None
    except UnicodeDecodeError:
        raise ModelError(f"'{path}' cannot be read as CSV: it is not a text") from None
    except (OSError, ValueError) as error:
        raise ModelError(f"'{path}' cannot be read as CSV: {str(error).strip()}") from None


def _check_units(units: dict[str, str], others: dict[str, str], model: Model, of: str) -> None:
    """Refuses columns whose names give another unit than that of the model, which would be compared number by number."""
    known = {"frequency": "rad/s", "hertz": "Hz", "phase": "rad", **others}
    if units.keys() & {"amplitude", "sigma"}:
        known |= dict.fromkeys(("amplitude", "sigma"), _unit_of(model, of))
    for name, unit in units.items():
        if name in known and "".join(unit.split()) != "".join(known[name].split()):
            raise ModelError(f"column '{name}' is in '{unit}', and the model in '{known[name]}': convert its values, "
                             "or leave out the unit if the model has other ones throughout")  # fmt: skip


def _unit_of(model: Model, of: str) -> str:
    """Unit of a harmonic, which the first motion has."""
    from nhbm.responses import parts_of
    from nhbm.sweeps import _unit_of as unit_of

    trial = copy.copy(model)
    trial._is_trial = True
    trial.response(of, order=sum(map(abs, parts_of(of)[1] or (1,))))
    session = trial._session
    return unit_of(session, of) if session is not None and session.has_motion else "m"


def _doubt_the_unit(model: Model, measured: Array, is_in_hertz: bool) -> None:
    """Warns of frequencies [rad/s] far from those of the structure, if the other unit would bring them there."""
    natural = model.natural_frequencies()
    lowest, highest = measured.min(), measured.max()
    factor = 1 / (2 * np.pi) if is_in_hertz else 2 * np.pi
    is_near = (natural > lowest / 2) & (natural < 2 * highest)
    would_be = (natural > 0.8 * factor * lowest) & (natural < 1.25 * factor * highest)
    if would_be.any() and not is_near.any():
        unit, scale = ("Hz", 2 * np.pi) if is_in_hertz else ("rad/s", 1.0)
        at, nearest = f"{lowest / scale:.4g} to {highest / scale:.4g} {unit}", f"{natural[would_be][0] / scale:.4g} {unit}"
        advice.warn(advice.on("frequencies_in_hertz" if is_in_hertz else "frequencies_in_radians", at, nearest).text, Implausible)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
