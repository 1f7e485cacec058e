"""The only reader of the result file of nhbm; docs/user/schema.md describes its schema."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np

from nhbm.located import Located, located_kinds

from .complete_input import groups
from .errors import ReaderError, UsageError
from .hdf5 import open_file, strings_of, text_of
from .outcome import ANSWERS, CONVERGED, EMPTY, NAMES, SOLVED, UNUSED, sentence, words
from .parameter import Parameter
from .series import Series
from .text import counted, list_text, range_text, tuple_text

SCHEMA_VERSION = 1

_REQUIRED = ("point", "tone", "harmonic", "dof", "status", "frequency", "coefficients")

_WORDS_OF_UNITS = {"rad": "rotation", "1": "motion", "": "motion"}

# Reasons in the file that end curves, where the row has no message.
_ENDS_OF_CURVES = {
    6: "no further motion was found",
    8: "it has reached the limit of its points, and continues",
    9: "a wall is grazed, and no motion was found beyond",
}

# Coefficients this much smaller than the largest of a point are rounding errors.
_ROUNDING = 1e-14
# Numbers read together in the search for the largest.
_BLOCK = 2**23


@dataclass(frozen=True)
class _Quantity:
    coefficients: str
    labels: str
    samples: str
    words: str
    symbol: str


# Quantities that can be read by harmonic, by the word that users give.
QUANTITIES = {
    "motion": _Quantity("coefficients", "dof", "displacement_samples", "displacement", "{}"),
    "force": _Quantity(
        "force_coefficients", "law_dof", "force_samples", "force of the laws", "law force on {}"
    ),
    "corrected": _Quantity(
        "corrected_coefficients", "law_dof", "corrected_samples", "corrected displacement", "corrected {}"
    ),
    "improved": _Quantity(
        "improved_coefficients", "law_dof", "improved_samples", "improved displacement", "improved {}"
    ),
}


class Results:
    """A result file, open for reading; use it in a `with` statement.

    Points are counted from 0. `quantity` is `motion`, `force` or `corrected`. If data do not exist, the methods raise ReaderError,
    which names the file, the request and the alternatives.
    """

    def __init__(self, path: str | os.PathLike):
        self.path = Path(path)
        self._file = open_file(self.path)
        self._noise: dict[tuple[str, str], np.ndarray] = {}
        self._columns: dict[str, np.ndarray] = {}
        try:
            self._check_schema()
            self.dofs = self._labels("dof")
            self.law_dofs = self._labels("law_dof") if "law_dof" in self._file else []
            self.laws = self._labels("law") if "law" in self._file else []
            self.has_own_tuples = "tuples" in self._file
            self.tuples = self._union() if self.has_own_tuples else np.atleast_2d(np.asarray(self._file["tuple"][()], dtype=int))
            self.status = np.asarray(self._file["status"][()], dtype=int)
            self.parameters = {p.name: p for p in self._read_parameters()}
            self._names = self._status_names()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file; safe to call twice."""
        self._file.close()

    # Attributes of the file

    @property
    def title(self) -> str:
        return self._text_attribute("title")

    @property
    def program_version(self) -> str:
        return self._text_attribute("program_version")

    @property
    def git_commit(self) -> str:
        return self._text_attribute("git_commit")

    @property
    def created_utc(self) -> str:
        return self._text_attribute("created_utc")

    @property
    def amplitude_convention(self) -> str:
        return self._text_attribute("amplitude_convention")

    @property
    def n_ranks(self) -> int:
        return int(np.ravel(self._file.attrs.get("n_ranks", 1))[0])

    @property
    def input_text(self) -> str:
        return self._text_dataset("input_text")

    @property
    def overrides(self) -> str:
        """The changes by --set, `path=value`, separated by commas."""
        return ", ".join(self._text_dataset("input_overrides").split("\n")) if "input_overrides" in self._file else ""

    @property
    def input_complete(self) -> str:
        return self._text_dataset("input_complete")

    @property
    def input_folder(self) -> Path:
        """Folder of the input, to which names of files in it are relative; the present one if it is not known."""
        dataset = self._file.get("input_text")
        return Path(text_of(dataset.attrs.get("folder", "")) if dataset is not None else "")

    @cached_property
    def in_hertz(self) -> bool:
        """Whether the input gives frequencies in hertz; pictures then do so too."""
        return gives_hertz(f"{self.input_text}\n{self.overrides}")

    def frequency_scale(self) -> tuple[float, str]:
        """(factor on rad/s, unit) of the frequencies in pictures."""
        return (0.5 / np.pi, "Hz") if self.in_hertz else (1.0, "rad/s")

    def shown(self, parameter: Parameter) -> Parameter:
        """A parameter as shown in pictures: a frequency in hertz if the input has hertz."""
        if parameter.path.startswith("tones%frequency") and parameter.units == "rad/s" and self.in_hertz:
            path = parameter.path.replace("%frequency", "%hertz")
            return Parameter(parameter.name, path, "Hz", parameter.values / (2.0 * np.pi))
        return parameter

    def noise(self, point: int, quantity: str = "motion", units: str = "") -> float:
        """The rounding level of a coefficient of a point: 1e-14 of the largest coefficient with that unit."""
        if (quantity, units) not in self._noise:
            alike = [i for i, label in enumerate(self.labels(quantity)) if self.units(quantity, label) == units]
            blocks = _blocks(self._coefficients_dataset(quantity))
            largest = [np.nanmax(np.abs(block[:, alike]), axis=(1, 2, 3), initial=0.0) for _, block in blocks]
            self._noise[quantity, units] = _ROUNDING * np.concatenate(largest)
        return float(self._noise[quantity, units][point])

    @property
    def has_rigid_law(self) -> bool:
        """Whether the model has a law that corrects the motion: a rigid wall, or another law with rigid contacts."""
        return re.search(r"'rigid_wall'|^ *contact = 'rigid'", self.input_complete, re.MULTILINE) is not None

    @property
    def n_points(self) -> int:
        return self.status.size

    @property
    def n_tones(self) -> int:
        return self.tuples.shape[1]

    @property
    def n_harmonics(self) -> int:
        return self.tuples.shape[0]

    def tuples_of(self, point: int) -> np.ndarray:
        """Tuples of all elements of the coefficients of a point, (harmonics, n_tones)."""
        if not self.has_own_tuples:
            return self.tuples
        return np.asarray(self._tuples[point, : max(1, self.column("n_harmonics")[point])], dtype=int)

    @cached_property
    def _tuples(self) -> np.ndarray | h5py.Dataset:
        """Those of all points: in memory unless they are many."""
        tuples = self._dataset("tuples")
        return tuples[()] if tuples.size <= 8 * _BLOCK else tuples

    # Outcome of the points

    def status_name(self, point: int) -> str:
        """Name of the status of a point, as defined in the file."""
        return self._names.get(int(self.status[point]), f"status {self.status[point]}")

    def status_counts(self, points: Sequence[int] | None = None) -> dict[str, int]:
        """Number of points (default: all) by status, in the order of the status numbers, without empty ones."""
        status = self.status if points is None else self.status[np.asarray(points, dtype=int)]
        codes, counts = np.unique(status, return_counts=True)
        return {self._names.get(int(code), f"status {code}"): int(n) for code, n in zip(codes, counts)}

    @property
    def converged(self) -> np.ndarray:
        """Numbers of the converged points."""
        return np.flatnonzero(self.status == CONVERGED)

    @property
    def solved(self) -> np.ndarray:
        """Numbers of the points with a motion: converged, truncated, aliased, penetrating, impact, integrated or one of
        multiple_attractors."""
        return np.flatnonzero(np.isin(self.status, SOLVED))

    @property
    def used(self) -> np.ndarray:
        """Numbers of all points except the unused ones of curves."""
        return np.flatnonzero(self.status != UNUSED)

    @property
    def curve(self) -> Parameter | None:
        """The moving value of the curves of the file, None if there are none."""
        return next((p for p in self.parameters.values() if "moves_along" in self._file[p.name].attrs), None)

    def curve_ends(self) -> list[str]:
        """Why curves ended before the end of their range, a sentence for each."""
        if self.curve is None or "reason" not in self._file:
            return []
        reasons = self.column("reason")
        sentences = []
        for point in np.flatnonzero(np.isin(reasons, list(_ENDS_OF_CURVES))):
            why = self.message(point) or _ENDS_OF_CURVES[int(reasons[point])]
            sentences.append(f"a curve ended at point {point}: {why}")
        for point in np.flatnonzero((self.curve_kind() == "end") & ~np.isin(reasons, list(_ENDS_OF_CURVES))):
            if self.message(point):
                sentences.append(f"a curve ended at point {point}: {self.message(point)}")
        return sentences

    def curve_kind(self) -> np.ndarray:
        """Kind of each point of a curve, as a word: `regular`, `fold`, `peak`, ..."""
        dataset = self._dataset("curve_kind")
        names = np.array(text_of(dataset.attrs["flag_meanings"]).split())
        return names[np.clip(dataset[()], 0, names.size - 1)]

    @cached_property
    def located_kinds(self) -> dict[str, Located]:
        """The kinds of located points of curves, such as folds, by their names."""
        return located_kinds(self._dataset("curve_kind").attrs) if self.curve else {}

    def stability(self) -> np.ndarray:
        """1 if the motion of a point is stable, -1 if it is unstable, 0 if this is unknown."""
        return self.per_point("is_stable") if "is_stable" in self._file else np.zeros(self.n_points, dtype=int)

    @property
    def has_stability(self) -> bool:
        """Whether the run computed stability, or tried to; normal modes have none."""
        is_mode = any(path.startswith("normal_mode%") for path in self.swept)
        return "is_stable" in self._file and "exponent" in self._file and not is_mode

    def curve_branch(self) -> np.ndarray:
        """Number of the branch point, or separate motion, from which each part of a curve was followed; 0: from its start."""
        return self.per_point("curve_branch") if "curve_branch" in self._file else np.zeros(self.n_points, dtype=int)

    @property
    def curve_jumps(self) -> bool:
        """Whether a curve was followed with jumps over its folds: its parts are one curve, in their order."""
        return any(group.get("jump") == [".true."] for group in groups(self.input_complete, "curve"))

    def outcome_text(self, points: Sequence[int] | None = None) -> str:
        """`123 of 205 points converged, 50 truncated, 32 stalled`: counted as in `nhbm solve`."""
        answers = [self._names.get(code) for code in ANSWERS]
        others = [f"{n} {words(name)}" for name, n in self.status_counts(self._or_used(points)).items() if name not in answers]
        return ", ".join([self.answers_text(points), *others])

    def answers_text(self, points: Sequence[int] | None = None) -> str:
        """The part of `outcome_text` about motions without a fault: `123 of 205 points converged`, or found by time integration."""
        status = self.status[self._or_used(points)]
        counts = [(int((status == code).sum()), how) for code, how in ANSWERS.items()]
        (n, how), *more = [count for count in counts if count[0]] or counts[:1]
        return ", ".join([f"{n} of {status.size} points {how}", *(f"{n} {how}" for n, how in more)])

    def _or_used(self, points: Sequence[int] | None) -> np.ndarray:
        return self.used if points is None else np.asarray(points, dtype=int)

    def warning(self, point: int) -> str:
        """The remark on the point in a picture: empty if it has converged, otherwise the meaning of its status."""
        if self.status[point] == CONVERGED:
            return ""
        text = sentence(self.status_name(point))
        return text if self.status[point] in SOLVED else f"no solution, {text}"

    def message(self, point: int) -> str:
        """Cause of the failure of a point; empty for the others."""
        return strings_of(self.column("message")[point : point + 1])[0] if "message" in self._file else ""

    def branch(self) -> np.ndarray:
        """Number of the branch of each point along the fastest parameter, from 1; 0 if unknown; -1 where a chain left its branch,
        in a run that has not ended."""
        return self.per_point("branch") if "branch" in self._file else np.zeros(self.n_points, dtype=int)

    def multipliers(self) -> np.ndarray:
        """Floquet multipliers (n_points, n_multipliers), complex, the largest first; NaN for missing ones."""
        if "multiplier_real" not in self._file:
            raise ReaderError(f"{self.path}: there are no multipliers; solve with &stability and one tone")
        return self.column("multiplier_real") + 1j * self.column("multiplier_imag")

    def has(self, name: str) -> bool:
        """Whether the file has a dataset; files of older versions lack some."""
        return name in self._file

    def per_point(self, name: str) -> np.ndarray:
        """A dataset with one number per point: `iterations`, `residual`, `solve_seconds`, `penetration`, ..."""
        column = self.column(name)
        if column.shape != (self.n_points,):
            raise ReaderError(f"{self.path}: '{name}' has shape {column.shape}, not one number a point")
        return column

    def column(self, name: str) -> np.ndarray:
        """A dataset with a row per point; read once."""
        if name not in self._columns:
            self._columns[name] = self._dataset(name)[()]
        return self._columns[name]

    def power_laws(self, point: int) -> np.ndarray:
        """Mean loss in each law [W], (n_laws); NaN without an error estimate."""
        return np.asarray(self._dataset("power_laws")[point], dtype=float)

    # Choice of points

    def select(self, at: Mapping[str, object]) -> list[int]:
        """Points that have all parameter values of `at`; keys are input paths (`law(1)%gap`) or names (`law_1_gap`).

        A value may be a list `1.0e-3,2.0e-3` or, for numbers, a range `1.0e-3:2.0e-3`, open if an end is omitted.
        """
        fits = np.ones(self.n_points, dtype=bool)
        for key, value in at.items():
            parameter = self.parameter(key)
            fits_one = np.zeros(self.n_points, dtype=bool)
            for wanted in parameter.alternatives(value):
                fits_this = parameter.fits(wanted)
                if not fits_this.any():
                    raise ReaderError(
                        f"{self.path}: no point with {parameter.label} = {wanted}; "
                        f"{parameter.nearest_text(wanted)}"
                    )
                fits_one |= fits_this
            fits &= fits_one
        points = [int(i) for i in np.flatnonzero(fits)]
        if not points:
            raise ReaderError(
                f"{self.path}: no point with {_at_text(at)} together; see nhbm-post info for the points"
            )
        return points

    def point(self, number: int | None = None, at: Mapping[str, object] | None = None) -> int:
        """One point: by number, by parameter values, or by default the first converged one."""
        if number is not None:
            if number not in self.used:
                raise ReaderError(f"{self.path}: no point {number}; points: {range_text(self.used)}")
            return int(number)
        if at:
            points = self.select(at)
            if len(points) > 1:
                differing = [
                    p.label for p in self.parameters.values() if len({str(v) for v in p.values[points]}) > 1
                ]
                raise ReaderError(
                    f"{self.path}: {_at_text(at)} fits points {range_text(points)}; "
                    f"give also {list_text(differing) if differing else 'the number of the point'}"
                )
            return points[0]
        if self.converged.size == 0 and self.solved.size > 0:
            return int(self.solved[0])
        if self.converged.size == 0:
            raise ReaderError(f"{self.path}: no point is solved: {self.outcome_text()}")
        return int(self.converged[0])

    def parameter(self, key: str) -> Parameter:
        """Swept parameter by name or by path in the input."""
        for parameter in self.parameters.values():
            if key in (parameter.name, parameter.path):
                return parameter
        if key == "curve_kind" and self.curve:
            return Parameter(key, key, "", self.curve_kind())
        raise ReaderError(
            f"{self.path}: no swept parameter '{key}'; swept: {list_text(self.swept)}"
        )

    @property
    def swept(self) -> list[str]:
        """Paths of the swept parameters."""
        return [parameter.label for parameter in self.parameters.values()]

    def where_text(self, at: Mapping[str, object]) -> str:
        """`gap of law 1 = 1.5e-3 m`: the selection for `select`, with units, for titles."""
        return ", ".join(self.parameter(key).choice_text(value) for key, value in at.items())

    def point_text(self, point: int) -> str:
        """`point 3, gap of law 1 = 1.5e-3 m`, for titles."""
        return ", ".join([f"point {point}", *(self.shown(p).text(point) for p in self.parameters.values())])

    # Solutions

    def default_dof(self, quantity: str = "motion") -> str:
        """First degree of freedom with a law for which `quantity` is stored, otherwise the first stored one; `tip.z` where the
        input names it by its set."""
        labels = self.labels(quantity)
        if not labels:
            raise ReaderError(f"{self.path}: no degree of freedom with {QUANTITIES[quantity].words}")
        return self.as_written(next((label for label in self.law_dofs if label in labels), labels[0]))

    def labels(self, quantity: str = "motion") -> list[str]:
        """Labels of the degrees of freedom for which `quantity` is stored."""
        return self.dofs if QUANTITIES[quantity].labels == "dof" else self.law_dofs

    def units(self, quantity: str = "motion", dof: str | None = None) -> str:
        """Unit of a degree of freedom (its own if the file has `dof_units`), or the common one."""
        attributes = self._dataset(QUANTITIES[quantity].coefficients).attrs
        labels = self.labels(quantity)
        by_dof = text_of(attributes.get("dof_units", "")).split()
        if dof is not None and dof not in labels and len(set(by_dof)) > 1:
            dof = next(iter(self._dofs_of_set(dof)), dof)
        if dof in labels and len(by_dof) == len(labels):
            return by_dof[labels.index(dof)]
        return text_of(attributes.get("units", ""))

    def frequency(self, point: int) -> np.ndarray:
        """Base frequencies of a point [rad/s], (n_tones)."""
        return np.asarray(self.column("frequency")[point], dtype=float)

    def frequency_estimate(self, point: int) -> np.ndarray:
        """Estimated errors of the base frequencies [rad/s], (n_tones); 0 for given ones, NaN if unknown."""
        if "frequency_estimate" not in self._file:
            return np.full(self.n_tones, np.nan)
        return np.asarray(self._file["frequency_estimate"][point], dtype=float)

    def output_estimates(self) -> list[tuple[str, np.ndarray]]:
        """Name and estimated relative errors (n_points) of each output to which a tolerance applies."""
        if "output_estimate" not in self._file:
            return []
        names = [name.decode() for name in self._file["output"][()]]
        found = np.asarray(self._file["output_estimate"][()], dtype=float)
        if "output_level_estimate" in self._file:
            found = np.maximum(found, self._file["output_level_estimate"][()])
        return list(zip(names, found.T))

    def unknown_tones(self) -> np.ndarray:
        """Numbers (from 0) of the tones with unknown frequencies."""
        if "frequency_estimate" not in self._file:
            return np.array([], dtype=int)
        return np.flatnonzero((self._file["frequency_estimate"][()] > 0.0).any(axis=0))

    def series(
        self, point: int, dof: str | None = None, quantity: str = "motion", allow_unconverged: bool = False
    ) -> Series:
        """Harmonics of one degree of freedom at a point, those in the set of the point."""
        self._require_outcome(point, allow_unconverged)
        dof = self.default_dof(quantity) if dof is None else dof
        i_dof = self._dof_index(dof, quantity)
        return self._series(point, dof, quantity, self._coefficients_dataset(quantity)[point, i_dof], self.units(quantity, dof))

    def all_series(
        self, dof: str | None = None, quantity: str = "motion", points: Sequence[int] | None = None
    ) -> Iterator[tuple[int, Series]]:
        """(point, series) of each solved point, or of some of them; reads the file once."""
        dof = self.default_dof(quantity) if dof is None else dof
        values = self._coefficients_dataset(quantity)[:, self._dof_index(dof, quantity)]
        units = self.units(quantity, dof)
        for point in self.solved if points is None else np.intersect1d(self.solved, points):
            yield int(point), self._series(int(point), dof, quantity, values[point], units)

    def coefficients(
        self,
        point: int,
        dof: str,
        j: Sequence[int],
        quantity: str = "motion",
        allow_unconverged: bool = False,
    ) -> tuple[float, float]:
        """(cos, sin) of tuple `j`; a mirrored tuple -j gives (cos, -sin) of the stored one."""
        series = self.series(point, dof, quantity, allow_unconverged)
        if len(j) != self.n_tones:
            raise ReaderError(
                f"{self.path}: tuple {tuple_text(j)} has {counted(len(j), 'entry', 'entries')}; "
                f"the file has {counted(self.n_tones, 'tone')}"
            )
        try:
            return series.harmonic(j)
        except KeyError:
            raise ReaderError(
                f"{self.path}: tuple {tuple_text(j)} is not in the set of point {point}; {_set_text(series)}"
            ) from None

    def amplitude(self, point: int, dof: str, j: Sequence[int], quantity: str = "motion") -> float:
        """One-sided peak amplitude of tuple `j`."""
        return float(np.hypot(*self.coefficients(point, dof, j, quantity)))

    def evaluate(self, point: int, dof: str, t, quantity: str = "motion") -> np.ndarray:
        """Values at times `t` [s], of the shape of `t`."""
        return self.series(point, dof, quantity).evaluate(t)

    def on_grid(self, point: int, dof: str, shape, quantity: str = "motion") -> np.ndarray:
        """Values on a hypertime grid of any size, axes in the order tau_1, tau_2, ...; see Series.on_grid."""
        return self.series(point, dof, quantity).on_grid(shape)

    def samples(
        self, point: int, dof: str, quantity: str = "motion", allow_unconverged: bool = False
    ) -> tuple[list[np.ndarray], np.ndarray] | None:
        """Stored surface as (hypertime axes, values), in the order tau_1, tau_2, ...; None if not stored."""
        self._require_outcome(point, allow_unconverged)
        name = QUANTITIES[quantity].samples
        axes = [f"tau_{m}" for m in range(1, self.n_tones + 1)]
        if name not in self._file or any(axis not in self._file for axis in axes):
            return None
        if dof not in self.law_dofs:
            raise ReaderError(
                f"{self.path}: no surface of '{dof}' is stored; stored: {list_text(self.law_dofs)}"
            )
        values = self._file[name][point, self.law_dofs.index(dof)].T
        if not np.isfinite(values).all():
            raise ReaderError(f"{self.path}: '{name}' of point {point} holds values that are not finite")
        return [self._file[axis][()] for axis in axes], values

    # Internal functions

    def _series(self, point: int, dof: str, quantity: str, values: np.ndarray, units: str) -> Series:
        tuples = self.tuples_of(point)
        values = values[: len(tuples)]
        is_in_set = ~np.isnan(values).all(axis=-1)
        if not is_in_set.any():
            raise ReaderError(
                f"{self.path}: point {point} ({self.status_name(point)}) holds no "
                f"{QUANTITIES[quantity].words} of '{dof}'"
            )
        values = values[is_in_set]
        if not np.isfinite(values).all():
            raise ReaderError(
                f"{self.path}: {QUANTITIES[quantity].words} of '{dof}' at point {point} "
                "has values that are not finite"
            )
        return Series(
            tuples[is_in_set],
            self.frequency(point),
            values[:, 0],
            values[:, 1],
            QUANTITIES[quantity].symbol.format(dof),
            units,
            _WORDS_OF_UNITS.get(units, "displacement") if quantity == "motion" else "",
        )

    def _require_outcome(self, point: int, allow_unconverged: bool) -> None:
        """Raises an error unless the point is solved or, if that suffices, has at least ended with numbers."""
        if not 0 <= point < self.n_points:
            raise ReaderError(f"{self.path}: no point {point}; points: {range_text(self.used)}")
        status = self.status[point]
        if status in SOLVED or (allow_unconverged and status not in EMPTY):
            return
        why = f": {self.message(point)}" if self.message(point) else ""
        raise ReaderError(
            f"{self.path}: point {point} has no result (status {self.status_name(point)}{why}); "
            f"solved points: {range_text(self.solved)}"
        )

    def _dof_index(self, dof: str, quantity: str) -> int:
        labels = self.labels(quantity)
        named = [dof] if dof in labels else self._dofs_of_set(dof)
        if len(named) > 1:
            raise ReaderError(f"{self.path}: '{dof}' are {len(named)} degrees of freedom; name one: {list_text(named)}")
        if not named or named[0] not in labels:
            raise ReaderError(
                f"{self.path}: no {QUANTITIES[quantity].words} of degree of freedom '{dof}'; "
                f"stored: {list_text([self.as_written(label) for label in labels])}"
            )
        return labels.index(named[0])

    def as_written(self, label: str) -> str:
        """The name that the input has for a degree of freedom: its label, or a set of one node and a direction."""
        return self._names_of_sets.get(label, label)

    @cached_property
    def _names_of_sets(self) -> dict[str, str]:
        words = dict.fromkeys(re.findall(r"'([^'\s]+\.\w+)'", self.input_text))
        names: dict[str, str] = {}
        for word in words:
            labels = [] if word in self.dofs or word in self.law_dofs else self._dofs_of_set(word)
            if len(labels) == 1:
                names.setdefault(labels[0], word)
        return names

    def _dofs_of_set(self, name: str) -> list[str]:
        """Labels of a set of nodes and a direction, as `tip.z` in the input; none if the model file has no such set or is not
        available."""
        from .structure import has_model, structure_of

        try:
            return structure_of(self, 0, None).dofs_of(name) if has_model(self) else []
        except (ReaderError, UsageError):
            return []

    def _coefficients_dataset(self, quantity: str) -> h5py.Dataset:
        return self._dataset(QUANTITIES[quantity].coefficients)

    def _dataset(self, name: str) -> h5py.Dataset:
        if name not in self._file:
            raise ReaderError(f"{self.path}: no dataset '{name}' in this file")
        return self._file[name]

    def _check_schema(self) -> None:
        version = self._file.attrs.get("schema_version")
        if version is None:
            raise ReaderError(f"{self.path}: no result file of nhbm: it has no attribute 'schema_version'")
        version = np.ravel(version)[0]
        if version != SCHEMA_VERSION:
            raise ReaderError(
                f"{self.path}: schema version {version}; this nhbm-post reads version {SCHEMA_VERSION}"
            )
        if self._file.attrs.get("kind") == "integration":
            raise ReaderError(f"{self.path}: a record of time integration; nhbm-post info, time and spectrum read it")
        missing = [name for name in _REQUIRED if name not in self._file]
        if "tuple" not in self._file and "tuples" not in self._file:
            missing.append("tuple")
        if missing:
            raise ReaderError(
                f"{self.path}: result file without {list_text(missing)}: written by another program?"
            )
        n_harmonics, n_tones = self._file["tuples" if "tuples" in self._file else "tuple"].shape[-2:]
        found = self._file["coefficients"].shape
        expected = (self._file["status"].size, self._file["dof"].shape[0], n_harmonics, 2)
        if found != expected:
            raise ReaderError(
                f"{self.path}: 'coefficients' has shape {found}; "
                f"points, dofs, harmonics and components make {expected}"
            )
        found, expected = self._file["frequency"].shape, (expected[0], n_tones)
        if found != expected:
            raise ReaderError(f"{self.path}: 'frequency' has shape {found}, expected {expected}")

    def _union(self) -> np.ndarray:
        """Tuples of all points, each once: low orders first."""
        used = np.maximum(1, self.column("n_harmonics"))
        sets = []
        for first, block in _blocks(self._file["tuples"]):
            is_used = np.arange(block.shape[1]) < used[first : first + len(block), None]
            sets.append(np.unique(block[is_used], axis=0))
        union = np.unique(np.concatenate(sets), axis=0)
        return union[np.lexsort((*union.T, np.abs(union).sum(axis=1)))]

    def _read_parameters(self) -> Iterator[Parameter]:
        for name, dataset in self._file.items():
            if not isinstance(dataset, h5py.Dataset) or "parameter" not in dataset.attrs:
                continue
            raw = dataset[()]
            values = raw.astype(float) if raw.dtype.kind in "fiu" else np.array(strings_of(raw), dtype=object)
            if values.shape == (self._file["status"].size,):
                path = text_of(dataset.attrs["parameter"])
                yield Parameter(name, path, text_of(dataset.attrs.get("units", "")), values)

    def _status_names(self) -> dict[int, str]:
        attributes = self._file["status"].attrs
        if "flag_values" not in attributes or "flag_meanings" not in attributes:
            return NAMES
        codes = np.ravel(attributes["flag_values"])
        return {int(code): word for code, word in zip(codes, text_of(attributes["flag_meanings"]).split())}

    def _labels(self, name: str) -> list[str]:
        return strings_of(self._file[name][()])

    def _text_attribute(self, name: str) -> str:
        return text_of(self._file.attrs.get(name, ""))

    def _text_dataset(self, name: str) -> str:
        return text_of(self._dataset(name)[()])


def gives_hertz(input_text: str) -> bool:
    """Whether an input gives frequencies in hertz."""
    text = re.sub(r"!.*", "", input_text)
    return re.search(r"&tones\b[^/&]*?\bhertz\b|\btones%hertz\b", text, re.IGNORECASE) is not None


def _blocks(dataset: h5py.Dataset) -> Iterator[tuple[int, np.ndarray]]:
    """(number of the first row, rows) of a dataset, in pieces that fit the memory."""
    step = max(1, _BLOCK // max(1, int(np.prod(dataset.shape[1:]))))
    return ((first, dataset[first : first + step]) for first in range(0, len(dataset), step))


def _at_text(at: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in at.items())


def _set_text(series: Series) -> str:
    """The extent of a set of tuples, for messages."""
    order = np.abs(series.tuples).max(axis=0)
    return f"it has {series.n_harmonics} tuples with " + ", ".join(
        f"|j{m}| <= {n}" for m, n in enumerate(order, start=1)
    )
