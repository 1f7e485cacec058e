"""Runs nhbm on inputs without their sweeps, and reads what comes out as motions over time."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from nhbm_post.reader import SOLVED
from program import ALL_CONVERGED, NOT_ALL_CONVERGED, command, environment

ROOT = Path(__file__).resolve().parents[3]
INPUTS = ROOT / "inputs"


class Refused(RuntimeError):
    """The program did not do what it was asked for."""


@dataclass(frozen=True)
class Record:
    """A time integration: times, a displacement [m] at each, processor time [s]."""

    t: np.ndarray
    x: np.ndarray
    cpu: float


@dataclass(frozen=True)
class Model:
    """An input file for one point, values set on top of it, and the displacement looked at as a weighted sum."""

    source: str
    dofs: tuple[str, ...]
    weights: tuple[float, ...]
    sets: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ("sweep",)

    def text(self) -> str:
        """The input without its sweeps and other groups that are left out, each of which stands on one line."""
        text = (INPUTS / f"{self.source}.nml").read_text(encoding="utf-8")
        return re.sub(rf"^&({'|'.join(self.left_out)})\b[^\n]*/[^\n]*\n", "", text, flags=re.MULTILINE)

    def without(self, *groups: str) -> Model:
        """The model without these groups, each of which stands on one line."""
        return replace(self, left_out=(*self.left_out, *groups))

    def with_sets(self, *sets: str) -> Model:
        return replace(self, sets=self.sets + sets)


def nhbm(verb: str, source: Path, result: Path, sets: tuple[str, ...], *options: str) -> None:
    """Runs a verb that writes a file. Points that do not converge are for the caller to notice."""
    words = command(verb, source, "-o", result, "--overwrite", "--quiet", *options)
    words += [word for value in sets for word in ("--set", value)]
    done = subprocess.run(words, cwd=result.parent, env=environment(), capture_output=True, text=True, check=False)
    if done.returncode not in (ALL_CONVERGED, NOT_ALL_CONVERGED):
        raise Refused(f"{verb} {source.name}: {done.stderr.strip()}")


def integration(model: Model, folder: Path, *settings: str, start: str = "") -> Record:
    """Integrates a model with settings of &integration, from rest or from the &start groups of a text."""
    source, result = folder / "integration.nml", folder / "integration.h5"
    text = model.text()
    if start:
        settings += ("start='given'",)
    source.write_text(text + start, encoding="utf-8")
    sets = model.sets + ("harmonics%order=1",) + tuple(f"integration%{setting}" for setting in settings)
    nhbm("integrate", source, result, sets)
    with h5py.File(result) as file:
        labels = list(file["dof"].asstr()[()])
        x = sum(w * file["displacement"][labels.index(dof)] for dof, w in zip(model.dofs, model.weights))
        return Record(file["time"][()], x, float(file["cpu_seconds"][()]))


class Balance:
    """A file of `nhbm solve`: motions of its points."""

    def __init__(self, model: Model, folder: Path, *sets: str, addition: str = "", name: str = "balance"):
        source, self.path = folder / f"{name}.nml", folder / f"{name}.h5"
        source.write_text(model.text() + addition, encoding="utf-8")
        nhbm("solve", source, self.path, model.sets + sets)
        with h5py.File(self.path) as file:
            self.labels = list(file["dof"].asstr()[()])
            self.tuples = file["tuple"][()]
            self.omega = file["frequency"][()]
            self.coefficients = file["coefficients"][()]
            self.improved = file["improved_coefficients"][()] if "improved_coefficients" in file else None
            self.law_labels = list(file["law_dof"].asstr()[()])
            self.status = file["status"][()]
        self.model = model

    def pairs(self, point: int = 0, is_improved: bool = False) -> np.ndarray:
        """(cos, sin) of the displacement looked at, of each tuple."""
        values, labels = (self.improved, self.law_labels) if is_improved else (self.coefficients, self.labels)
        model = self.model
        return sum(w * values[point, labels.index(dof)] for dof, w in zip(model.dofs, model.weights))

    def at(self, t: np.ndarray, point: int = 0, is_improved: bool = False) -> np.ndarray:
        """Displacement at times; NaN where the point is not solved."""
        if self.status[point] not in SOLVED:
            return np.full_like(t, np.nan)
        return series(t, self.tuples @ self.omega[point], self.pairs(point, is_improved))

    def start_groups(self, point: int = 0) -> str:
        """&start groups whose sum is the state at t = 0: one tuple is enough for displacement and velocity."""
        rates = self.tuples @ self.omega[point]
        omega = self.omega[point, 0]
        rest = ", ".join("0" for _ in self.omega[point][1:])
        text = ""
        for label, pairs in zip(self.labels, self.coefficients[point]):
            x, v = np.nansum(pairs[:, 0]), np.nansum(rates * pairs[:, 1])
            text += f"&start dof='{label}', tuple=1, {rest}, cos={x:.17e}, sin={v / omega:.17e} /\n"
        return text


def series(t: np.ndarray, rates: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Sum of cosines and sines at times, in blocks that fit into a cache; NaN pairs are tuples outside of the set."""
    known = ~np.isnan(pairs[:, 0]) & (np.abs(pairs).max(axis=1) > 0.0)
    rates, pairs = rates[known], pairs[known]
    x = np.empty_like(t)
    for i in range(0, len(t), 2000):
        phases = np.outer(t[i : i + 2000], rates)
        x[i : i + 2000] = np.cos(phases) @ pairs[:, 0] + np.sin(phases) @ pairs[:, 1]
    return x


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def known_methods(folder: Path) -> list[str]:
    """Solvers of this program, from its message about an unknown one."""
    source = folder / "methods.nml"
    source.write_text(Model("order_sequence/paper_cubic", (), ()).text(), encoding="utf-8")
    words = command("solve", source, "-o", folder / "methods.h5", "--set", "solver%method='none'")
    done = subprocess.run(words, cwd=folder, env=environment(), capture_output=True, text=True, check=False)
    found = re.search(r"known: ([\w, ]+)", done.stderr)
    if not found:
        raise Refused(f"the program does not tell its solvers: {done.stderr.strip()}")
    return found.group(1).split(", ")
