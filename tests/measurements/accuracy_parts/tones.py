"""Is the integrated motion of the beam on a stop a torus of its two tones, and how many harmonics does it take?"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from nhbm_post.reader import Results
from program import command, environment
from runs import INPUTS, Balance, Model, integration, nhbm, rms

HIGHEST = 31  # tuples up to here are looked at
SHOWN_ORDERS = (3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 25, 31)
PUSH = "&start dof='q1', tuple=1,0, cos=3e-4 /\n"
MIDSPAN = {"dofs": ("q1", "q3"), "weights": (1.0, -1.0)}
FAST = ("tones%frequency(1)=31.41592653589793", "tones%frequency(2)=27.18281828459045")
N_LINES = 25
VERIFIED = (
    ("hard/dynamic_beam_stop", 1, "slow tones, order 15"),
    ("hard/dynamic_beam_stop", 2, "fast tones, order 7"),
    ("hard/dynamic_beam_stop_15", 0, "fast tones, order 15"),
)


@dataclass
class Torus:
    """What was found at one pair of tones."""

    name: str
    t: np.ndarray
    apart: np.ndarray  # relative difference of two time integrations from different starts, over t
    best: np.ndarray  # rms of what the best series of each of SHOWN_ORDERS leaves out, relative
    outside: int  # lines, of those found at whatever frequency, that lie at no tuple
    distance: float  # largest distance of the others from their tuples [rad/s]
    orders: tuple[int, ...]
    errors: list[float]  # of the balance at these orders
    statuses: list[str]


def investigate(name: str, model: Model, together: float, length: float, orders: tuple[int, ...], folder: Path) -> Torus:
    """`together` [s]: length of the two time integrations; `length` [s]: of the record for the spectrum."""
    settings = ("method='cvode'", "tolerance=1e-12", "step=0.005")
    first = integration(model, folder, *settings, f"duration={together!r}")
    second = integration(model, folder, *settings, f"duration={together!r}", start=PUSH)
    apart = np.abs(second.x - first.x) / rms(first.x)
    omega = np.array([float(value.split("=")[1]) for value in model.sets]) if model.sets else np.array([np.pi, np.e])
    record = integration(model, folder, "method='cvode'", "tolerance=1e-11", "step=0.002", "transient=20", f"duration={length!r}")
    share = _share_of_tuples(record.t, record.x, omega)
    best = np.sqrt(np.maximum(1.0 - share, 0.0))[list(SHOWN_ORDERS)]
    outside, distance = _lines(model, omega, folder)
    errors, statuses = [], []
    for order in orders:
        balance = Balance(model, folder, f"harmonics%order={order}")
        errors.append(rms(record.x - balance.at(record.t)) / rms(record.x))
        statuses.append(_status_name(balance.path))
    return Torus(name, first.t, apart, best, outside, distance, orders, errors, statuses)


def _share_of_tuples(t: np.ndarray, x: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Sum of |c|^2 over all tuples of the boxes of order 0 to HIGHEST, over the mean square, with the window of nhbm integrate.

    The mean square needs the window too: without it the beat of the tones leaves an error of more than small lines.
    """
    s = (np.arange(len(t)) + 0.5) / len(t)
    window = np.exp(-1.0 / (s * (1.0 - s)))
    window /= window.sum()
    weighted = window * x
    k = np.arange(-HIGHEST, HIGHEST + 1)
    c = np.zeros((len(k), len(k)), dtype=complex)
    for i in range(0, len(t), 4000):
        part = slice(i, i + 4000)
        c += (np.exp(-1j * np.outer(k, omega[0] * t[part])) * weighted[part]) @ np.exp(-1j * np.outer(omega[1] * t[part], k))
    order = np.maximum(np.abs(k)[:, None], np.abs(k)[None, :])
    return np.array([np.sum(np.abs(c[order <= n]) ** 2) for n in range(HIGHEST + 1)]) / np.sum(weighted * x)


def _lines(model: Model, omega: np.ndarray, folder: Path) -> tuple[int, float]:
    """Largest lines of q1: how many lie beside all tuples up to order 31, and how far off the others are at most."""
    source, result = folder / "lines.nml", folder / "lines.h5"
    source.write_text(model.text(), encoding="utf-8")
    length = 300.0 if model.sets else 1500.0
    settings = ("method='cvode'", "tolerance=1e-11", "step=0.01", "transient=20", f"duration={length}", f"n_peaks={N_LINES}")
    given = (f"integration%{s}" for s in settings)
    nhbm("integrate", source, result, (*model.sets, "harmonics%order=1", "output%dofs='q1'", *given))
    with h5py.File(result) as file:
        peaks = np.abs(file["peak_frequency"][0])
    k = np.arange(-HIGHEST, HIGHEST + 1)
    lattice = np.abs(k[:, None] * omega[0] + k[None, :] * omega[1]).ravel()
    nearest = np.array([np.abs(lattice - f).min() for f in peaks])
    resolution = 2.0 * np.pi / length
    inside = nearest < resolution
    return int((~inside).sum()), float(nearest[inside].max())


def _status_name(path: Path) -> str:
    with Results(path) as results:
        return results.status_name(0)


def investigate_both(folder: Path) -> list[Torus]:
    model = Model("order_sequence/dynamic_stop", **MIDSPAN)
    return [
        investigate("tones π and e", model, 40.0, 1200.0, (3, 5, 7, 9), folder),
        investigate("ten times faster", model.with_sets(*FAST), 40.0, 400.0, (3, 5, 7), folder),
    ]


def table(found: list[Torus]) -> str:
    text = "| tones | starts differ, end | lines beside all tuples | farthest line from its tuple [rad/s] | best series of order "
    text += "7 / 15 / 31 | balance |\n|---|---|---|---|---|---|\n"
    for one in found:
        best = " / ".join(f"{one.best[SHOWN_ORDERS.index(n)]:.1e}" for n in (7, 15, 31))
        balances = ", ".join(f"{n}: {e:.1e} ({s})" for n, e, s in zip(one.orders, one.errors, one.statuses))
        end = one.apart[-len(one.apart) // 8 :].max()
        text += f"| {one.name} | {end:.0e} | {one.outside} of {N_LINES} | {one.distance:.1e} | {best} | {balances} |\n"
    return text


def verdicts(folder: Path) -> str:
    text = "| solution | status | `nhbm verify` |\n|---|---|---|\n"
    for source, point, title in VERIFIED:
        status, said = verdict(source, point, folder)
        text += f"| `{source}`, {title} | {status} | {said} |\n"
    return text


def verdict(source: str, point: int, folder: Path) -> tuple[str, str]:
    """(status of the solution, verdict of `nhbm verify`) of a point of an input."""
    file = INPUTS / f"{source}.nml"
    result = folder / "verified.h5"
    nhbm("solve", file, result, ())
    words = command("verify", result, "--points", str(point))
    subprocess.run(words, cwd=folder, env=environment(), capture_output=True, text=True, check=False)
    with h5py.File(result) as data:
        verdicts = data["integration_verdict"]
        names = dict(zip(verdicts.attrs["flag_values"].tolist(), _words(verdicts.attrs["flag_meanings"])))
        first, last, limit, growth = (
            float(data[f"integration_{name}"][point]) for name in ("first_difference", "difference", "limit", "growth")
        )
        said = f"{names[int(verdicts[point])]}: {first:.1e} of the motion of the worst coordinate in the first period, {last:.1e} "
        said += f"in the end, limit {limit:.1e}, growth {growth:.2g} 1/s"
    with Results(result) as results:
        return results.status_name(point), said


def _words(text) -> list[str]:
    return (text.decode() if isinstance(text, bytes) else str(text)).split()
