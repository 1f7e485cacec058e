"""The state of contacts at the nodes of a structure: gaps, forces, stick and slip as functions of time, and their summary over a
period.

The laws are evaluated along the stored motion. Stops have the gap g - z and the force k max(z - g, 0). Friction with memory: the
slider w of f = k (z - w) is moved by the window |z - w| <= mu N/k (docs/why/theory.md, section 5.5), step by step. The forces of
rigid laws are those of the result. A wall is closed according to the sign of f + e (z - g), and rigid friction slips according to
the size of f + e dz/dt, for any e, since the gap is zero where the force is not, and the rate is zero where the force is below its
limit. The contacts of a table are those of one law, with gaps g0 + A q and a matrix A that may rotate with a tone; they have no
nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from .complete_input import groups
from .errors import ReaderError, UsageError
from .reader import Results
from .structure import Structure
from .text import list_text

MEASURES = ("gap", "normal_force", "friction")
OPEN, STICK, SLIP = 0, 1, 2  # closed contacts without friction stick
KINDS = ("annular_clearance", "coulomb_rigid", "elastic_stop", "iwan", "jenkins", "jenkins_2d", "rigid_wall")
TABLES = ("blade_contact", "contact_table")

_STEPS = 16  # in a period of the fastest harmonic
_PERIODS = 32  # of the slowest of several tones: averaging time of shares, or
_BEATS = 8  # periods of the slowest beat of two of them if that is longer
_BEFORE = 8  # share of that time until sliders forget their start; one period for one tone and one coordinate
_MOST = 300_000  # steps
_OF_SLIDERS = 300  # terms of a series that take the time of a step of sliders
_BLOCK = 2_000_000  # steps times nodes that are processed together


@dataclass
class Table:
    """Contacts of one law, each a linear form of its coordinates."""

    shapes: np.ndarray  # A (n_contacts, n_coordinates)
    turns: np.ndarray  # of each pair of coordinates, as multiples of the phase of a tone
    frequency: float  # of that tone [rad/s]

    def turned(self, q: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Coordinates (n_coordinates, n_times), with rotating pairs in the frame of the contacts."""
        q = q.copy()
        for k, m in enumerate(self.turns):
            c, s = np.cos(m * self.frequency * t), np.sin(m * self.frequency * t)
            q[2 * k], q[2 * k + 1] = c * q[2 * k] + s * q[2 * k + 1], c * q[2 * k + 1] - s * q[2 * k]
        return q


@dataclass
class Contact:
    """The laws of one `&law`, one per node, or the contacts of a table; coordinates as (labels of each node, weights)."""

    label: str
    kind: str
    laws: np.ndarray  # numbers in the result
    nodes: np.ndarray  # indices; none for a table
    keys: dict[str, float]
    coordinates: list[tuple[list[list[str]], list[float]]]
    is_two_sided: bool = False
    table: Table | None = None

    @property
    def n(self) -> int:
        return len(self.nodes) if self.table is None else len(self.table.shapes)

    @property
    def counted(self) -> str:
        """`4 nodes`, `22 contacts`."""
        return f"{self.n} {'node' if self.table is None else 'contact'}{'s' * (self.n > 1)}"

    @property
    def slides(self) -> bool:
        coefficients = (value for key, value in self.keys.items() if key.startswith("friction_coefficient"))
        return self.kind in ("coulomb_rigid", "iwan", "jenkins", "jenkins_2d") or any(value > 0.0 for value in coefficients)

    @property
    def has_memory(self) -> bool:
        return self.kind in ("iwan", "jenkins", "jenkins_2d")

    @property
    def opens(self) -> bool:
        """Whether the law has a normal force."""
        sliders = ("coulomb_rigid", "iwan", "jenkins", "jenkins_2d")
        return self.kind not in sliders or "friction_coefficient" in self.keys

    def each(self, key: str, n: int) -> np.ndarray:
        """The n numbers of a key that has one for all, or one each."""
        return np.array([self.keys.get(f"{key}({i})", self.keys.get(key, 0.0)) for i in range(1, n + 1)])


class Degrees:
    """Stands for the structure of a result without a model: each degree of freedom is a node."""

    def __init__(self, results: Results):
        self.path, self._labels = results.path, results.labels()

    def dofs_of(self, name: str) -> list[str]:
        return [name]

    def node_of(self, label: str) -> int | None:
        return self._labels.index(label) if label in self._labels else None


@dataclass
class History:
    """The state of a contact at the nodes, (n_times, n_nodes); NaN for quantities that the law does not have."""

    status: np.ndarray
    gap: np.ndarray = field(default_factory=lambda: np.array(np.nan))  # [m]
    normal_force: np.ndarray = field(default_factory=lambda: np.array(np.nan))  # [N]
    friction: np.ndarray = field(default_factory=lambda: np.array(np.nan))  # [N], magnitude

    def __post_init__(self):
        for name in MEASURES:
            setattr(self, name, np.broadcast_to(getattr(self, name), self.status.shape))


def contacts(results: Results, structure: Structure | Degrees, point: int) -> list[Contact]:
    """The contacts of a result, at nodes of the structure or in tables, in the order of the input."""
    found, first = [], 0
    labels = results.laws
    if not labels:
        return []
    for number, texts in enumerate(groups(results.input_complete, "law"), start=1):
        kind = texts["type"][0]
        label = texts.get("label", [f"{kind} {number}"])[0]
        coordinates = _coordinates(structure, kind, texts)
        n = max(len(dofs_of_nodes) for dofs_of_nodes, _ in coordinates)
        expected = [label] if n == 1 else [f"{label} {dofs[0]}" for dofs in coordinates[0][0]]
        if labels[first : first + n] not in (expected, [f"{label} {expected[0]}"]):
            raise ReaderError(
                f"{results.path}: law '{label}' of its input is not that of {structure.path}; is that the model of the run?"
            )
        laws = np.arange(first, first + n)
        first += n
        keys = _numbers(results, point, texts, number)
        if kind in TABLES and texts.get("contact", ["elastic"])[0] == "elastic":
            table = _table(kind, texts, keys, len(coordinates), np.abs(results.frequency(point)))
            found.append(Contact(label, kind, laws, np.zeros(0, dtype=int), keys, coordinates, table=table))
            continue
        nodes = [structure.node_of(dofs[0]) for dofs in coordinates[0][0]]
        if kind in KINDS and None not in nodes:
            two_sided = texts.get("two_sided", ["f"])[0].strip(".").lower().startswith("t")
            found.append(Contact(label, kind, laws, np.array(nodes), keys, coordinates, two_sided))
    return found


def _table(kind: str, texts: dict[str, list[str]], keys: dict[str, float], n_coordinates: int, tones: np.ndarray) -> Table:
    """The table of a law; for blades it is computed from their angles."""
    tone = int(keys.get("tone", 0))
    frequency = float(tones[tone - 1]) if tone else 0.0
    if kind == "contact_table":
        shapes = np.array([float(value) for value in texts["shapes"]]).reshape(int(keys["n_contacts"]), n_coordinates)
        turns = [int(value) for value in texts.get("turns", [])] if tone else []
        return Table(shapes, np.array(turns, dtype=int), frequency)
    blades, n = int(keys["n_blades"]), int(keys["n_diameters"])
    angles = 2 * np.pi / blades * n * np.arange(1, blades + 1)
    shares = np.array([keys.get(f"shares({i})", keys.get("shares", 1.0)) for i in range(1, blades + 1)])
    cosine, sine = np.cos(angles), np.sin(angles)
    shapes = np.column_stack([-shares * cosine, -shares * sine, cosine, sine])
    turns = {"rotating": [], "stationary": [n, n], "own": [0, n]}[texts.get("frame", ["rotating"])[0]]
    return Table(shapes, np.array(turns, dtype=int), frequency)


def _coordinates(
    structure: Structure | Degrees, kind: str, texts: dict[str, list[str]]
) -> list[tuple[list[list[str]], list[float]]]:
    """For each coordinate of a law, the degrees of freedom of each of its locations, and their weights."""
    coordinates = []
    for key, weights in (("dof", ""), ("dofs", "weights"), ("second_dofs", "second_weights"), ("normal_dofs", "normal_weights")):
        if key not in texts:
            continue
        names = [structure.dofs_of(name) for name in texts[key]]
        n = max(map(len, names))
        if key == "dofs" and "weights" not in texts:  # a law of several coordinates
            coordinates += [([[dof] for dof in column], [1.0]) for column in names]
            continue
        dofs_of_nodes = [[column[i if len(column) > 1 else 0] for column in names] for i in range(n)]
        coordinates.append((dofs_of_nodes, [float(w) for w in texts.get(weights, ["1"] * len(names))]))
    return coordinates


def _numbers(results: Results, point: int, texts: dict[str, list[str]], number: int) -> dict[str, float]:
    """The numbers of a law; swept ones have their values at the point."""
    keys = {}
    for key, values in texts.items():
        try:
            keys |= {key if len(values) == 1 else f"{key}({i})": float(value) for i, value in enumerate(values, start=1)}
        except ValueError:
            continue
    for parameter in results.parameters.values():
        for name in (number, texts.get("label", [""])[0]):
            prefix = f"law({name})%"
            if parameter.is_number and parameter.path.startswith(prefix):
                keys[parameter.path[len(prefix) :]] = float(parameter.values[point])
    return keys


class Motion:
    """Coordinates of the laws of a point, and the forces in the result, as functions of time."""

    def __init__(self, results: Results, point: int, allow_unconverged: bool = False):
        self._results, self._point, self._allow = results, point, allow_unconverged
        self._loaded: dict = {}
        series = self._series(results.default_dof("force"), "force")
        tones = np.sort(np.abs(series.omega))
        self.slowest, self.fastest = float(tones[0]), float(np.abs(series.frequencies).max())
        self.period = 2 * np.pi / self.slowest
        self.step = min(2 * np.pi / self.fastest / _STEPS, self.period / 256)
        self.window = self.period  # averaging time of shares
        if len(tones) > 1:
            self.window = 2 * np.pi * max(_PERIODS / tones[0], _BEATS / max(np.diff(tones).min(), 1e-300))
            self.window = min(self.window, _MOST * self.step)

    def coordinate(self, contact: Contact, k: int, t: np.ndarray, rate: bool = False) -> np.ndarray:
        """Coordinate k at given times, or its rate (n_times, n_nodes)."""
        dofs_of_nodes, weights = contact.coordinates[k]
        return sum(w * self._values([dofs[i] for dofs in dofs_of_nodes], "corrected", t, rate) for i, w in enumerate(weights))

    def force(self, contact: Contact, t: np.ndarray) -> np.ndarray:
        """Force of each law on its coordinate, for laws of one coordinate (n_times, n_nodes)."""
        dofs_of_nodes, weights = contact.coordinates[0]
        return self._values([dofs[0] for dofs in dofs_of_nodes], "force", t) / weights[0]

    def _series(self, dof: str, quantity: str):
        if (dof, quantity) not in self._loaded:
            self._loaded[dof, quantity] = self._results.series(self._point, dof, quantity, self._allow)
        return self._loaded[dof, quantity]

    def _values(self, dofs: Sequence[str], quantity: str, t: np.ndarray, rate: bool = False) -> np.ndarray:
        series = [self._series(dof, quantity) for dof in dofs]
        frequencies = series[0].frequencies
        c = np.array([s.cos - 1j * s.sin for s in series]).T
        if rate:
            c = 1j * frequencies[:, None] * c
        parts = np.array_split(t, 1 + len(t) // 2000)
        return np.concatenate([(np.exp(1j * np.outer(part, frequencies)) @ c).real for part in parts])


def history(contact: Contact, motion: Motion, times: np.ndarray) -> History:
    """The state of a contact at equally spaced times."""
    step = times[1] - times[0] if len(times) > 1 else motion.step
    n_inner = max(1, int(np.ceil(step / motion.step * (1 - 1e-9))))
    n = (len(times) - 1) * n_inner + 1
    blocks = list(_blocks(contact, motion, times[0], step / n_inner, n))
    return History(*(np.concatenate([getattr(b, name) for b in blocks])[::n_inner] for name in ("status", *MEASURES)))


def _blocks(contact: Contact, motion: Motion, start: float, step: float, n: int) -> Iterator[History]:
    """The history at n times, in blocks; each block starts with the sliders of the previous one."""
    n_before = 0
    if contact.has_memory:
        n_before = int(np.ceil(max(_BEFORE * motion.period, motion.window / _BEATS) / step))
    sliders = None
    most = max(1000, _BLOCK // contact.n)
    for first in [*range(-n_before, 0, most), *range(0, n, most)]:
        last = min(first + most, 0 if first < 0 else n)
        found, sliders = _evaluate(contact, motion, start + step * np.arange(first, last), sliders)
        if first >= 0:
            yield found


def _evaluate(contact: Contact, motion: Motion, times: np.ndarray, sliders: np.ndarray | None) -> tuple[History, np.ndarray | None]:
    """The history at given times, and the final positions of the sliders, which begin at given positions or at rest."""
    if contact.kind == "iwan":
        return _sliding_side_by_side(contact, motion, times, sliders)
    if contact.has_memory:
        return _sliding(contact, motion, times, sliders)
    return _without_memory(contact, motion, times), None


def _without_memory(contact: Contact, motion: Motion, times: np.ndarray) -> History:
    keys, kind = contact.keys, contact.kind
    if contact.table is not None:
        q = np.array([motion.coordinate(contact, k, times)[:, 0] for k in range(len(contact.coordinates))])
        gap = contact.each("gaps", contact.n) + (contact.table.shapes @ contact.table.turned(q, times)).T
        normal = contact.each("stiffness", contact.n) * np.maximum(-gap, 0.0)
        friction = contact.each("friction_coefficient", contact.n) * normal if contact.slides else np.array(np.nan)
        return History(np.where(gap < 0, SLIP if contact.slides else STICK, OPEN), gap, normal, friction)
    z = motion.coordinate(contact, 0, times)
    if kind == "coulomb_rigid":
        force, rate = motion.force(contact, times), motion.coordinate(contact, 0, times, rate=True)
        slips = np.abs(force + keys["limit"] / _largest(rate) * rate) > keys["limit"]
        return History(np.where(slips, SLIP, STICK), friction=np.minimum(np.abs(force), keys["limit"]))
    if kind == "annular_clearance":
        x, y = (motion.coordinate(contact, k, times) for k in (0, 1))
        if len(contact.coordinates) == 4:
            x, y = x - motion.coordinate(contact, 2, times), y - motion.coordinate(contact, 3, times)
        gap = keys["clearance"] - np.hypot(x - keys.get("center(1)", 0.0), y - keys.get("center(2)", 0.0))
        normal = keys["stiffness"] * np.maximum(-gap, 0.0)
        friction = keys.get("friction_coefficient", 0.0) * normal
        return History(np.where(gap < 0, SLIP if contact.slides else STICK, OPEN), gap, normal, friction)
    gap = keys["gap"] - (np.abs(z) if contact.is_two_sided else z)
    if kind == "elastic_stop":
        return History(np.where(gap < 0, STICK, OPEN), gap, keys["stiffness"] * np.maximum(-gap, 0.0))
    force = motion.force(contact, times)  # rigid wall
    force = np.where(z < 0, -force, force) if contact.is_two_sided else force
    closed = force - _largest(force) / _largest(z) * gap > 0
    return History(np.where(closed, STICK, OPEN), gap, np.where(closed, np.maximum(force, 0.0), 0.0))


def _largest(values: np.ndarray) -> np.ndarray:
    return np.maximum(np.abs(values).max(), 1e-300)


def _sliding(contact: Contact, motion: Motion, t: np.ndarray, sliders: np.ndarray | None) -> tuple[History, np.ndarray]:
    """Elastic friction."""
    z = np.array([motion.coordinate(contact, k, t) for k in range(2 if contact.kind == "jenkins_2d" else 1)])
    k = contact.keys["stiffness"]
    gap = normal = np.full(z[0].shape, np.nan)
    reach = np.full(z[0].shape, contact.keys.get("limit", 0.0) / k)
    if "friction_coefficient" in contact.keys:
        normal = contact.keys["preload"] + contact.keys["normal_stiffness"] * motion.coordinate(contact, len(z), t)
        if contact.keys["normal_stiffness"] > 0:
            gap = -normal / contact.keys["normal_stiffness"]
        normal = np.maximum(normal, 0.0)
        reach = contact.keys["friction_coefficient"] * normal / k
    positions, moved = follow(z, reach, np.zeros_like(z[:, 0]) if sliders is None else sliders)
    status = np.where(normal == 0.0, OPEN, np.where(moved, SLIP, STICK))
    return History(status, gap, normal, k * np.sqrt(((z - positions) ** 2).sum(axis=0))), positions[:, -1]


def _sliding_side_by_side(
    contact: Contact, motion: Motion, t: np.ndarray, sliders: np.ndarray | None
) -> tuple[History, np.ndarray]:
    """Parallel friction elements; slip means that at least one of them slips."""
    z = motion.coordinate(contact, 0, t)
    n = sum(1 for key in contact.keys if key.startswith("stiffness"))
    sliders = np.zeros((n, 1, contact.n)) if sliders is None else sliders
    force, slips, ends = 0.0, False, []
    for k, limit, start in zip(contact.each("stiffness", n), contact.each("limit", n), sliders):
        positions, moved = follow(z[None], np.full(z.shape, limit / k), start)
        force, slips = force + k * (z - positions[0]), slips | moved
        ends.append(positions[:, -1])
    return History(np.where(slips, SLIP, STICK), friction=np.abs(force)), np.array(ends)


def follow(z: np.ndarray, reach: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of sliders within a distance `reach` (n_times, n_nodes) of z (n_directions, n_times, n_nodes), and whether each has
    moved in the step to that time, from `start` (n_directions, n_nodes)."""
    positions = np.zeros_like(z)
    moved = np.zeros(reach.shape, dtype=bool)
    w = start
    for i in range(len(reach)):
        leash = w - z[:, i]
        length = np.sqrt((leash**2).sum(axis=0))
        moved[i] = length > reach[i]
        w = np.where(moved[i], z[:, i] + leash * (reach[i] / np.maximum(length, 1e-300)), w)
        positions[:, i] = w
    return positions, moved


def summary(contact: Contact, motion: Motion, power: np.ndarray) -> dict[str, np.ndarray]:
    """Summary of the history over a period of one tone, or a long time for several tones, at each node, for the quantities of the
    law."""
    n = int(np.ceil(motion.window / motion.step))
    n_open = n_stick = n_slip = gap = 0.0
    smallest, largest, normal, friction = np.inf, -np.inf, -np.inf, -np.inf
    for found in _blocks(contact, motion, 0.0, motion.window / n, n):
        n_open = n_open + (found.status == OPEN).sum(axis=0)
        n_stick = n_stick + (found.status == STICK).sum(axis=0)
        n_slip = n_slip + (found.status == SLIP).sum(axis=0)
        gap = gap + found.gap.sum(axis=0)
        smallest = np.minimum(smallest, found.gap.min(axis=0))
        largest = np.maximum(largest, found.gap.max(axis=0))
        normal = np.maximum(normal, found.normal_force.max(axis=0))
        friction = np.maximum(friction, found.friction.max(axis=0))
    values = {"open share": n_open / n, "stick share": n_stick / n, "slip share": n_slip / n, "smallest gap": smallest,
              "mean gap": gap / n, "largest gap": largest, "largest normal force": normal, "largest friction": friction,
              "loss": power[contact.laws]}  # fmt: skip
    unknown = ["open share"] * (not contact.opens) + ["stick share", "slip share", "loss"] * (not contact.slides)
    for name in unknown + ["loss"] * (contact.table is not None and contact.slides):
        del values[name]
    return {name: value for name, value in values.items() if np.isfinite(value).any()}


def work_of(found: Sequence[Contact], motion: Motion, n_harmonics: int) -> float:
    """Work of the summaries of contacts, in terms of the series of a coordinate."""
    work = 0.0
    for contact in found:
        of_step = n_harmonics * contact.n * len(contact.coordinates) + _OF_SLIDERS * contact.has_memory
        work += motion.window / motion.step * (1 + _BEFORE * contact.has_memory) * of_step
    return work


def state_text(contact: Contact, values: dict[str, np.ndarray]) -> str:
    """Shares of time of a summary, means over its nodes: `open 66 %, closed 34 %`."""
    names = {"open": "open share", "sticking": "stick share", "slipping": "slip share"}
    shares = {word: np.nanmean(values[name]) for word, name in names.items() if name in values}
    if list(shares) == ["open"]:
        shares["closed"] = 1.0 - shares["open"]
    text = ", ".join(f"{word} {100 * float(f'{share:.3g}'):.3g} %" for word, share in shares.items())
    return text + (f" (mean of {contact.counted})" if contact.n > 1 else "")


UNITS = {"open share": "1", "stick share": "1", "slip share": "1", "smallest gap": "m", "mean gap": "m", "largest gap": "m",
         "largest normal force": "N", "largest friction": "N", "loss": "W"}  # fmt: skip


def shares(found: Sequence[Contact], motion: Motion, power: np.ndarray, structure: Structure) -> dict[str, np.ndarray]:
    """The summaries of contacts at nodes as fields over all nodes, `open share LABEL`, ...; NaN at nodes without a law."""
    return {
        f"{name} {contact.label}": structure.field(contact.nodes, values)
        for contact in found
        if contact.table is None
        for name, values in summary(contact, motion, power).items()
    }


def moments(
    found: Sequence[Contact], motion: Motion | None, times: np.ndarray, structure: Structure
) -> list[dict[str, np.ndarray]]:
    """Fields over all nodes at each time: `status LABEL`, with -1 at nodes without a law, and `gap LABEL`, `normal_force LABEL`,
    `friction LABEL` for laws that have them."""
    fields: list[dict[str, np.ndarray]] = [{} for _ in times]
    for contact in [contact for contact in found if contact.table is None] if len(times) else ():
        past = history(contact, motion, times)
        for i, frame in enumerate(fields):
            frame[f"status {contact.label}"] = structure.field(contact.nodes, past.status[i], -1.0)
            for name in MEASURES:
                if np.isfinite(getattr(past, name)).any():
                    frame[f"{name} {contact.label}"] = structure.field(contact.nodes, getattr(past, name)[i])
    return fields


def chosen(found: Sequence[Contact], label: str | None, results: Results) -> Contact:
    """The contact with a label, or the first one if none is given."""
    if not found:
        raise UsageError(
            f"{results.path}: no law of the result is a contact that can be drawn: {list_text(KINDS)} at a node, "
            f"{list_text(TABLES)} that are not rigid"
        )
    for contact in found:
        if label in (None, contact.label):
            return contact
    raise UsageError(f"{results.path}: no contact '{label}'; there are {list_text([c.label for c in found])}")
