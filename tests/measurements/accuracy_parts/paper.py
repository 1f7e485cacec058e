"""Figures 4 and 7 of the paper: time integration on top of the balance, and what the impact law of the wall is worth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from runs import Balance, Model, integration, rms

MIDSPAN = {"dofs": ("v3",), "weights": (1.0,)}
WALL_ORDERS = (3, 5, 8, 12)
WALL_SAMPLES = (16, 32, 48, 64)
RESTITUTIONS = (0.0, 0.5, 1.0)
MESHES = (4, 8, 12)
MESH_STEP = 5e-5  # [s] with four elements; the limit of stability falls with the square of their size
# Tones, how much faster they are than those of the input, meshes, order and samples of the balance; order 12 is not solved there.
IMPACTS = (("e and π", 1.0, MESHES, 12, 64), ("ten times faster", 10.0, MESHES[:2], 8, 48))


@dataclass(frozen=True)
class Comparison:
    """One motion twice, over the same times [s]."""

    title: str
    t: np.ndarray
    integrated: np.ndarray
    balanced: np.ndarray

    @property
    def difference(self) -> np.ndarray:
        return self.integrated - self.balanced


def figure_4(folder: Path) -> list[Comparison]:
    found = []
    for title, stiffness in (("10 N/m³", "10"), ("1e10 N/m³", "1e10")):
        model = Model("paper/figure4", **MIDSPAN, sets=(f"law(1)%stiffness={stiffness}",))
        balance = Balance(model, folder)
        record = integration(model, folder)
        found.append(Comparison(title, record.t, record.x, balance.at(record.t)))
    return found


def figure_4_table(found: list[Comparison]) -> str:
    text = "| spring | rms of the motion [m] | rms of the difference [m] | largest difference [m] |\n|---|---|---|---|\n"
    for one in found:
        text += f"| {one.title} | {rms(one.integrated):.2e} | {rms(one.difference):.1e} | {np.abs(one.difference).max():.1e} |\n"
    return text


def figure_7(folder: Path) -> list[Comparison]:
    """Orders 3 to 12 against one time integration by central differences, as in the input."""
    model = Model("paper/wall", **MIDSPAN)
    record = integration(model, folder)
    found = []
    for order, samples in zip(WALL_ORDERS, WALL_SAMPLES):
        balance = Balance(model, folder, f"harmonics%order={order}", f"sampling%samples={samples}")
        found.append(Comparison(f"order {order}", record.t, record.x, balance.at(record.t)))
    return found


def figure_7_table(found: list[Comparison], gap: float = 1.5e-3) -> str:
    text = "| order | rms of the difference [m] | relative | largest difference [m] | largest penetration [m] |\n"
    text += "|---|---|---|---|---|\n"
    for one in found:
        d = one.difference
        text += f"| {one.title.split()[1]} | {rms(d):.2e} | {rms(d) / rms(one.integrated):.1e} | {np.abs(d).max():.1e} | "
        text += f"{max(0.0, (one.balanced - gap).max()):.1e} |\n"
    return text


def restitution_table(folder: Path) -> str:
    """How far time integrations with restitution are from those without, and both from the balance, on finer and finer beams."""
    text = "| tones | elements | mass at the contact [kg] | restitution 0.5 to 0 | 1 to 0 | balance to 0 |\n"
    text += "|---|---|---|---|---|---|\n"
    for tones, speed, meshes, order, samples in IMPACTS:
        for n in meshes:
            first, *others, balanced = _impacts(n, speed, order, samples, folder)
            size = rms(first)
            text += f"| {tones} | {n} | {mass_at_contact(n):.2f} | "
            text += " | ".join(f"{rms(x - first) / size:.1e}" for x in (*others, balanced)) + f" (order {order}) |\n"
    return text


def _impacts(n_elements: int, speed: float, order: int, samples: int, folder: Path) -> list[np.ndarray]:
    """Integrates with each of RESTITUTIONS, and the balance, over the same times."""
    # The damping of the input is one at every degree of freedom of four elements: the same by length on finer ones.
    middle = f"v{n_elements // 2 + 1}"
    sets = (f"structure%n_elements={n_elements}", f"structure%damping_diagonal={4.0 / n_elements!r}", f"law(1)%dof='{middle}'",
            f"load(1)%dof='{middle}'", f"load(2)%dof='{middle}'", f"tones%frequency(1)={np.e * speed!r}",
            f"tones%frequency(2)={np.pi * speed!r}")  # fmt: skip
    model = Model("paper/wall", (middle,), (1.0,), sets)
    balance = Balance(model, folder, f"harmonics%order={order}", f"sampling%samples={samples}")
    stride = 40 * (n_elements // 4) ** 2
    settings = ("method='central_differences'", f"step={MESH_STEP * 40 / stride!r}", f"decimation={stride}")
    settings += ("transient=6", "duration=12")
    records = [integration(model, folder, *settings, f"restitution={restitution}") for restitution in RESTITUTIONS]
    return [record.x for record in records] + [balance.at(records[0].t)]


def mass_at_contact(n_elements: int, mass: float = 7.8) -> float:
    """What resists a sudden change of speed of the middle alone, 1/(M^-1)_cc, of the consistent mass of the beam [kg]."""
    h = 1.0 / n_elements
    element = mass * h / 420.0 * np.array([
        [156.0, 22.0 * h, 54.0, -13.0 * h],
        [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
        [54.0, 13.0 * h, 156.0, -22.0 * h],
        [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
    ])  # fmt: skip
    matrix = np.zeros((2 * n_elements + 2,) * 2)
    for i in range(n_elements):
        matrix[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += element
    free = [i for i in range(len(matrix)) if i not in (0, 2 * n_elements)]
    inverse = np.linalg.inv(matrix[np.ix_(free, free)])
    middle = free.index(n_elements)
    return float(1.0 / inverse[middle, middle])
