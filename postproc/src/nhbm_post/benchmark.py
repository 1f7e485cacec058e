"""The only reader of the files of `nhbm benchmark`, and the rates that are fitted to them."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from .errors import ReaderError
from .reader import CONVERGED, SCHEMA_VERSION, SOLVED, _open, _strings, _text

# A rung falls on a plateau, ruled by something else than its order, where the error drops less than this.
_LEAST_DROP = 0.8
# Errors that rounding decides.
_ROUNDING = 2e-14


@dataclass(frozen=True)
class Curve:
    """Rungs that differ in one thing alone, in ascending order of it."""

    label: str
    rungs: np.ndarray


@dataclass(frozen=True)
class Rate:
    """y = factor * exp(-rate x) (`exponential`) or factor * x**exponent (`algebraic`), by least squares of the logarithms."""

    kind: str
    factor: float
    exponent: float
    misfit: float
    points: np.ndarray = field(repr=False)

    def __call__(self, x) -> np.ndarray:
        x = np.asarray(x, dtype=float)
        return self.factor * (np.exp(self.exponent * x) if self.kind == "exponential" else x**self.exponent)

    def text(self, symbol: str) -> str:
        """Such as `N^-2.9`, or `exp(-0.81 N)`, in mathtext."""
        if self.kind == "exponential":
            return rf"$\sim \mathrm{{e}}^{{{self.exponent:.2f}\,{symbol}}}$"
        return rf"$\sim {symbol}^{{{self.exponent:.1f}}}$"

    def plain(self, symbol: str) -> str:
        """The same as plain text."""
        if self.kind == "exponential":
            return f"exp({self.exponent:.3g} {symbol})"
        return f"{symbol}^{self.exponent:.3g}"


class Benchmark:
    """A file of `nhbm benchmark`, read whole. `column` gives one number or text a rung."""

    def __init__(self, path: str | os.PathLike):
        self.path = Path(path)
        with _open(self.path) as file:
            if _text(file.attrs.get("kind", "")) != "benchmark":
                raise ReaderError(f"{path}: no file of 'nhbm benchmark'")
            version = int(np.ravel(file.attrs["schema_version"])[0])
            if version != SCHEMA_VERSION:
                raise ReaderError(f"{path}: schema version {version}; this nhbm-post reads version {SCHEMA_VERSION}")
            self.title = _text(file.attrs.get("title", ""))
            self.n_rungs = file["rung"].shape[0]
            self.dofs = _strings(file["dof"][()])
            self.tuples = np.asarray(file["tuple"][()], dtype=int)
            self.coefficients = np.asarray(file["coefficients"][()])
            self.units = _text(file["coefficients"].attrs.get("units", ""))
            self.reference = (
                np.asarray(file["reference_coefficients"][()]) if "reference_coefficients" in file else None
            )
            self._columns = {
                name: self._read(dataset)
                for name, dataset in file.items()
                if isinstance(dataset, h5py.Dataset) and dataset.shape and dataset.shape[0] == self.n_rungs
            }

    @staticmethod
    def _read(dataset: h5py.Dataset) -> np.ndarray:
        values = dataset[()]
        return values if values.dtype.kind in "fiu" else np.array(_strings(values), dtype=object)

    def column(self, name: str) -> np.ndarray:
        """A dataset with one row a rung: `order`, `method`, `error`, `total_seconds`, ..."""
        if name not in self._columns:
            raise ReaderError(f"{self.path}: no column '{name}' in this file")
        return self._columns[name]

    @property
    def is_solved(self) -> np.ndarray:
        """Which rungs are solved, well enough for the certificate or not."""
        return np.isin(self.column("status"), SOLVED)

    @property
    def is_converged(self) -> np.ndarray:
        return self.column("status") == CONVERGED

    def error(self, name: str = "error") -> np.ndarray:
        """Error of each rung, NaN for the reference itself and for rungs that are not solved."""
        return np.where(self.is_solved & (self.column("is_reference") == 0), self.column(name), np.nan)

    def size_of_sampling(self) -> np.ndarray:
        """Samples of the torus."""
        return np.prod(np.atleast_2d(self.column("samples")), axis=1)

    def varying(self) -> str:
        """What makes a curve unless said otherwise: orders, or the samples where there is one order."""
        return "order" if len(set(self.column("order").tolist())) > 1 else "samples"

    def curves(self, over: str) -> list[Curve]:
        """Rungs along `over` (`order` or `samples`), one curve for each combination of all the rest."""
        rest = ["method", "formulation", "sampling" if over == "order" else "order"]
        x = self.x_of(over)
        keys = [tuple(self.column(name)[i] for name in rest) for i in range(self.n_rungs)]
        found = list(dict.fromkeys(keys))
        names = [name for k, name in enumerate(rest) if len({key[k] for key in found}) > 1]
        curves = []
        for key in found:
            rungs = np.array([i for i in range(self.n_rungs) if keys[i] == key])
            words = [_word(name, value) for name, value in zip(rest, key) if name in names]
            curves.append(Curve(", ".join(w for w in words if w) or key[0], rungs[np.argsort(x[rungs], kind="stable")]))
        return curves

    def x_of(self, over: str) -> np.ndarray:
        """Number on the axis: order, samples of the tone that has most, or unknowns."""
        if over == "samples":
            return np.atleast_2d(self.column("samples")).max(axis=1).astype(float)
        return self.column("n_unknowns" if over == "unknowns" else "order").astype(float)


def _word(name: str, value) -> str:
    return f"order {value}" if name == "order" else str(value)


def convergence_rate(x: np.ndarray, error: np.ndarray, kind: str = "") -> Rate | None:
    """Rate of the falling part of an error, exponential or algebraic, whichever fits better; None for fewer than three rungs."""
    chosen = falling_part(error)
    x, error = x[chosen], error[chosen]
    if len(x) < 3 or (x <= 0.0).any():
        return None
    kinds = (kind,) if kind else ("exponential", "algebraic")
    return min((_fit(name, x, error, chosen) for name in kinds), key=lambda rate: rate.misfit)


def cost_exponent(x: np.ndarray, seconds: np.ndarray) -> Rate | None:
    """Exponent of the cost over the larger half of the sizes, where what is constant matters least; at least three rungs."""
    known = np.flatnonzero(np.isfinite(seconds) & (seconds > 0.0) & (x > 0.0))
    if len(known) < 3:
        return None
    chosen = known[-max(3, (len(known) + 1) // 2) :]
    return _fit("algebraic", x[chosen], seconds[chosen], chosen)


def falling_part(error: np.ndarray) -> np.ndarray:
    """Numbers of the known errors up to where they stop to fall: at rounding, or at the error of the reference."""
    known = np.flatnonzero(np.isfinite(error) & (error > _ROUNDING))
    kept = list(known[:1])
    for i in known[1:]:
        if error[i] > _LEAST_DROP * error[kept[-1]] and len(kept) > 2:
            break
        kept.append(i)
    return np.array(kept, dtype=int)


def _fit(kind: str, x: np.ndarray, y: np.ndarray, points: np.ndarray) -> Rate:
    abscissa = x if kind == "exponential" else np.log(x)
    (slope, level), *_ = np.linalg.lstsq(np.column_stack([abscissa, np.ones_like(abscissa)]), np.log(y), rcond=None)
    misfit = float(np.sqrt(np.mean((np.log(y) - level - slope * abscissa) ** 2)))
    return Rate(kind, float(np.exp(level)), float(slope), misfit, points)
