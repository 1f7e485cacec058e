"""Rates that are fitted to errors and costs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

# An error reaches a plateau, determined by another cause than the order, where it decreases by less than this factor.
_LEAST_DROP = 0.8
# An exponent of cost is reported if the sizes span this factor and its standard error is below this limit.
_LEAST_SPAN = 2.0
_LARGEST_DEVIATION = 0.3
# Errors dominated by rounding.
_ROUNDING = 2e-14


@dataclass(frozen=True)
class Rate:
    """y = factor * exp(-rate x) (`exponential`) or factor * x**exponent (`algebraic`), by least squares of the logarithms."""

    kind: str
    factor: float
    exponent: float
    misfit: float
    points: np.ndarray = field(repr=False)
    deviation: float = 0.0
    """Standard error of `exponent` by the scatter about the fit."""

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


@dataclass(frozen=True)
class NoRate:
    """The reason why times give no rate; false, while a Rate is true."""

    reason: str

    def __bool__(self) -> bool:
        return False


def convergence_rate(x: np.ndarray, error: np.ndarray, kind: str = "") -> Rate | None:
    """Rate of the decreasing part of an error, exponential or algebraic, whichever fits better; None for fewer than three
    levels."""
    chosen = falling_part(error)
    x, error = x[chosen], error[chosen]
    if len(x) < 3 or (x <= 0.0).any():
        return None
    kinds = (kind,) if kind else ("exponential", "algebraic")
    return min((_fit(name, x, error, chosen) for name in kinds), key=lambda rate: rate.misfit)


def cost_exponent(x: np.ndarray, seconds: np.ndarray) -> Rate | NoRate:
    """Exponent of the cost over the larger half of the sizes, where constant parts of the cost matter least.

    This requires at least three sizes that differ by a factor of two, and times with little scatter about the fit; smaller sizes
    are included if the larger half spans less.
    """
    known = np.isfinite(seconds) & (seconds > 0.0) & (x > 0.0)
    sizes = np.unique(x[known])
    if len(sizes) < 3:
        return NoRate("fewer than three sizes were timed")
    if sizes[-1] < _LEAST_SPAN * sizes[0]:
        return NoRate(f"the sizes span a factor of {sizes[-1] / sizes[0]:.3g} alone")
    least = min(sizes[-max(3, (len(sizes) + 1) // 2)], sizes[sizes <= sizes[-1] / _LEAST_SPAN][-1])
    chosen = np.flatnonzero(known & (x >= least))
    rate = _fit("algebraic", x[chosen], seconds[chosen], chosen)
    if rate.deviation > _LARGEST_DEVIATION:
        return NoRate(f"the times scatter too much ({rate.exponent:.2g} within {rate.deviation:.1g})")
    return rate


def falling_part(error: np.ndarray) -> np.ndarray:
    """Indices of the known errors up to the end of their decrease: at rounding, or at the error of the reference."""
    known = np.flatnonzero(np.isfinite(error) & (error > _ROUNDING))
    falling = list(known[:1])
    for i in known[1:]:
        if error[i] > _LEAST_DROP * error[falling[-1]] and len(falling) > 2:
            break
        falling.append(i)
    return np.array(falling, dtype=int)


def _fit(kind: str, x: np.ndarray, y: np.ndarray, points: np.ndarray) -> Rate:
    abscissa = x if kind == "exponential" else np.log(x)
    (slope, level), *_ = np.linalg.lstsq(np.column_stack([abscissa, np.ones_like(abscissa)]), np.log(y), rcond=None)
    misfit = float(np.sqrt(np.mean((np.log(y) - level - slope * abscissa) ** 2)))
    spread = float(np.sum((abscissa - abscissa.mean()) ** 2))
    freedom = len(x) - 2
    deviation = misfit * float(np.sqrt(len(x) / (freedom * spread))) if freedom > 0 and spread > 0.0 else 0.0
    return Rate(kind, float(np.exp(level)), float(slope), misfit, points, deviation)
