"""Random models and what a new user does with them, for tests/campaigns/workflows: sweeps, curves, backbones, interrupted runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from point_parts.models import (
    KINDS, MIN_DOFS, Law, Model, _coordinate, _later_laws, _law, _listed, _move_base, _scale, _structure,
)  # fmt: skip

SWEPT = ("frequency", "load", "gap", "stiffness", "damping")
WORKFLOWS = (*SWEPT, "nested", "ranks", "resumed", "curve", "two_tones", "mode_amplitude", "mode_energy", "limit_cycle")
SHARES = (6, 3, 2, 2, 2, 2, 1, 2, 4, 4, 2, 2, 2)  # how often each of them is drawn
POINTS = {"nested": (3, 10), "ranks": (4, 8), "resumed": (5, 16), "two_tones": (10,)}
ONE_LINE = 24  # points of all other sweeps
FORCED = ("frequency", "load", "damping", "nested", "ranks", "resumed", "curve", "two_tones")  # of models with a law of LATER
FEWER = {"nested": (2, 4), "ranks": (2, 4), "resumed": (2, 8), "two_tones": (5,)}  # points of these
SHORT_LINE = 8
AT_WALLS = 8  # points of a line where a law is rigid, which takes seconds a point
ODD = ("cubic_spring", "elastic_stop", "jenkins", "cubic_damping")
GENERAL = ("elastic_stop", "polynomial", "piecewise_linear", "quadratic_damping", "coulomb_tanh", "rigid_wall")
GENERAL_SHARES = (4, 3, 2, 1, 1, 1)
TWO_SIDED = 1.0


@dataclass(frozen=True)
class Axis:
    """A swept value: its path, first and last value, how many, and whether these have equal ratios."""

    path: str
    first: float
    last: float
    n: int
    is_log: bool

    def text(self) -> str:
        spacing = ", spacing='log'" if self.is_log else ""
        return f"&sweep parameter='{self.path}', from={self.first!r}, to={self.last!r}, n={self.n}{spacing} /\n"


@dataclass(frozen=True)
class Workflow:
    """A model and what is done with it."""

    kind: str
    model: Model
    axes: tuple[Axis, ...]
    more: str = ""  # groups beside those of the model
    mode_dof: int | None = None
    measure: str = ""  # of a normal mode: amplitude or energy
    later: str = ""  # the kind of LATER in the model

    @property
    def is_autonomous(self) -> bool:
        return self.kind.startswith("mode_") or self.kind == "limit_cycle"

    @property
    def n_ranks(self) -> int | None:
        return 2 if self.kind == "ranks" else None

    @property
    def title(self) -> str:
        laws = " and ".join(_name(law) for law in self.model.laws)
        over = ", ".join(f"{axis.path} {axis.first:.3g} to {axis.last:.3g}" for axis in self.axes)
        if self.later:
            laws = " and ".join([self.later, *(_name(law) for law in self.model.laws if law.said is None)])
        return f"{self.kind}, {len(self.model.mass)} dofs, {laws}, {over}"

    def text(self) -> str:
        model = self.model
        tones = "unknown=.true." if self.is_autonomous else f"frequency={_listed(model.omega)}"
        text = model.structure + f"&tones {tones} /\n" + self.more
        text += "".join(law.text(model.labels) for law in model.laws)
        text += model.load_text()
        if self.kind == "curve":
            axis = self.axes[0]
            return text + f"&curve parameter='{axis.path}', from={axis.first!r}, to={axis.last!r} /\n"
        return text + "".join(axis.text() for axis in self.axes)

    def at(self, values: dict[str, float]) -> Model:
        """The model at a point: `values` by their paths."""
        model = replace(self.model, laws=list(self.model.laws), loads=list(self.model.loads))
        for path, value in values.items():
            group, key = path.split("%")
            if group == "tones":
                model.retune([value, *model.omega[1:]])
            elif group == "load(1)":
                harmonic, cosine, sine = model.loads[0]
                model.loads[0] = harmonic, np.where(cosine != 0, value, 0.0), sine
            elif group == "structure":
                model.damping = model.damping - _damping_mass(model.structure) * model.mass + value * model.mass
            elif group == "law(1)":
                first, second, third = model.laws[0].parameters
                new = (first, value, third) if key == "gap" else (value, second, third)
                model.laws[0] = replace(model.laws[0], parameters=new)
        return model


def random_workflow(seed: int, number: int, kinds: tuple[str, ...] = WORKFLOWS, laws: tuple[str, ...] = ()) -> Workflow:
    """The workflow of a number; the same on every machine. With `laws`, some of LATER, the models have one after the other."""
    draw = np.random.default_rng([seed, number])
    if laws:
        return _later(draw, laws[number % len(laws)], tuple(kind for kind in FORCED if kind in kinds))
    shares = np.array([SHARES[WORKFLOWS.index(kind)] for kind in kinds], dtype=float)
    kind = str(draw.choice(kinds, p=shares / shares.sum()))
    if kind.startswith("mode_"):
        return _mode(draw, kind)
    if kind == "limit_cycle":
        return _limit_cycle(draw)
    model = _structure(draw, int(draw.integers(1, 4)))
    lowest = float(np.sort(model.modes()[0])[0])
    model.omega = np.array([lowest * draw.uniform(0.3, 1.6)])
    if kind == "two_tones":
        model.omega = np.append(model.omega, model.omega[0] * draw.uniform(0.4, 2.4) * (1 + 1e-3 * np.sqrt(2)))
    _loads(model, draw)
    has_key = {"gap": ("elastic_stop",), "stiffness": ("cubic_spring", "elastic_stop", "jenkins")}.get(kind)
    model.laws.append(_one_law(model, draw, has_key))
    if draw.random() < 0.2 and not _is_rigid(model.laws[0]):
        model.laws.append(_one_law(model, draw, ODD if draw.random() < 0.5 else ("elastic_stop", "polynomial")))
    if kind == "curve" and _is_rigid(model.laws[0]):
        model.laws[0] = _one_law(model, draw, ("elastic_stop",))
    own = 0.0
    if kind in ("gap", "stiffness"):
        own = model.laws[0].parameters[1 if kind == "gap" else 0]
    return Workflow(kind, model, _axes(model, draw, kind, lowest, own, POINTS, AT_WALLS if _is_rigid(model.laws[0]) else ONE_LINE))


def _axes(model: Model, draw, kind: str, lowest: float, own: float, points: dict, longest: int) -> tuple[Axis, ...]:
    """What a workflow sweeps; `own`: the value of a law that it begins with."""
    tone = "tones%frequency" + ("(1)" if len(model.omega) > 1 else "")
    frequencies = (tone, lowest * draw.uniform(0.15, 0.7), lowest * draw.uniform(1.3, 3.2))
    force = float(np.abs(model.loads[0][1]).sum())
    loads = ("load(1)%cos", force * draw.uniform(0.05, 0.3), force * draw.uniform(1.0, 4.0))
    n = points.get(kind, (ONE_LINE,))
    if kind in SWEPT[2:]:
        ranges = {"gap": (0.03, 1.5), "stiffness": (0.03, 30.0), "damping": (0.3, 30.0)}[kind]
        path = {"gap": "law(1)%gap", "stiffness": "law(1)%stiffness", "damping": "structure%damping_mass"}[kind]
        own = own or max(_damping_mass(model.structure), 1e-2 * lowest)
        axes = [(path, own * ranges[0], own * ranges[1])]
    elif kind == "load" or kind == "two_tones" and draw.random() < 0.5:
        axes = [loads]
    elif len(n) == 2:
        axes = [loads, frequencies]
    else:
        axes = [frequencies]
    if model.moves:  # whose load is no force
        axes = [axis for axis in axes if not axis[0].startswith("load")] or [frequencies]
    made = []
    for (path, low, high), count in zip(axes, n):
        ends = (low, high) if draw.random() < 0.5 else (high, low)
        is_log = not path.startswith("tones") and kind != "load"
        made.append(Axis(path, float(ends[0]), float(ends[1]), min(count, longest), is_log))
    return tuple(made)


def _later(draw, law: str, kinds: tuple[str, ...]) -> Workflow:
    """A workflow of a model with a law or term of LATER."""
    if law == "restitution":  # two tones take up to a minute a point; curves are held against closed forms, test_impacts.py
        kinds = tuple(kind for kind in kinds if kind not in ("curve", "two_tones"))
    if law == "base":
        kinds = tuple(kind for kind in kinds if kind != "load")
    shares = np.array([SHARES[WORKFLOWS.index(kind)] for kind in kinds], dtype=float)
    kind = str(draw.choice(kinds, p=shares / shares.sum()))
    least = MIN_DOFS.get(law, 1)
    model = _structure(draw, int(draw.integers(least, 4)))
    while least > 1 and model.labels[0].startswith("q"):
        model = _structure(draw, int(draw.integers(least, 4)))
    lowest = float(np.sort(model.modes()[0])[0])
    model.omega = np.array([lowest * draw.uniform(0.3, 1.6)])
    if kind == "two_tones":
        model.omega = np.append(model.omega, model.omega[0] * draw.uniform(0.4, 2.4) * (1 + 1e-3 * np.sqrt(2)))
    _loads(model, draw)
    if law == "base":
        _move_base(model, draw)
    model.laws += _later_laws(model, draw, _coordinate(model, draw), law)
    return Workflow(kind, model, _axes(model, draw, kind, lowest, 0.0, FEWER, SHORT_LINE), later=law)


def _loads(model: Model, draw) -> None:
    n = len(model.mass)
    for m in range(len(model.omega)):
        harmonic = tuple(int(i == m) for i in range(len(model.omega)))
        model.loads.append((harmonic, np.eye(n)[draw.integers(0, n)] * draw.uniform(0.3, 1.0), np.zeros(n)))


def _one_law(model: Model, draw, among: tuple[str, ...] | None = None) -> Law:
    """Odd laws as often as general ones."""
    is_odd = draw.random() < 0.5
    if among:
        name = str(draw.choice(among))
    elif is_odd:
        name = str(draw.choice(ODD))
    else:
        name = str(draw.choice(GENERAL, p=np.array(GENERAL_SHARES) / sum(GENERAL_SHARES)))
    shape = _coordinate(model, draw)
    if name == "cubic_damping":  # has no weights
        shape = max(np.eye(len(shape)), key=lambda axis: _scale(model, axis)[0])
    law = _law_of(model, draw, shape, name)
    if name == "elastic_stop":
        law = replace(law, parameters=(*law.parameters[:2], TWO_SIDED if is_odd else 0.0))
    return law


def _law_of(model: Model, draw, shape, name: str) -> Law:
    kind = KINDS.index(name)
    if kind <= 4:
        return _law(model, draw, shape, kind)
    amplitude, speed, static = _scale(model, shape)
    force = static * amplitude
    if name == "polynomial":
        first = static * 10 ** draw.uniform(-0.5, 1.0) / amplitude**2
        parameters = first, float(draw.choice([-1.0, 1.0])) * first * amplitude * draw.uniform(0.0, 1.0), 0.0
    elif name == "piecewise_linear":
        slopes = static * 10 ** draw.uniform(-0.5, 1.5, 2)
        parameters = slopes[0], amplitude * draw.uniform(0.05, 0.9), slopes[1]
    else:
        power = {"quadratic_damping": 2, "cubic_damping": 3}[name]
        parameters = force * draw.uniform(0.03, 0.5) / speed**power, 0.0, 0.0
    return Law(kind, shape, tuple(float(p) for p in parameters))


def _is_rigid(law: Law) -> bool:
    return KINDS[law.kind] == "rigid_wall"


def _damping_mass(structure: str) -> float:
    return float(structure.split("damping_mass=")[1].split(",")[0])


def _name(law: Law) -> str:
    return KINDS[law.kind] + (" two-sided" if KINDS[law.kind] == "elastic_stop" and law.parameters[2] else "")


def _mode(draw, kind: str) -> Workflow:
    """A backbone: free vibration of a structure without damping, or with some that is made up for."""
    model = _structure(draw, int(draw.integers(1, 4)))
    while model.labels[0].startswith("q"):  # of modes of a beam none is where the law is
        model = _structure(draw, int(draw.integers(1, 4)))
    n = len(model.mass)
    if draw.random() < 0.7:
        model = replace(model, structure=_undamped(model.structure), damping=np.zeros((n, n)))
    dof = int(draw.integers(0, n))
    shape = np.eye(n)[dof]
    static = float(1 / np.linalg.inv(model.stiffness)[dof, dof])
    name = str(draw.choice(["cubic_spring", "elastic_stop", "elastic_stop", "polynomial", "piecewise_linear"]))
    sides = TWO_SIDED * (draw.random() < 0.6)
    parameters = {
        "cubic_spring": lambda: (static * 10 ** draw.uniform(-1.0, 1.0), 0.0, 0.0),
        "elastic_stop": lambda: (static * 10 ** draw.uniform(-0.3, 1.7), draw.uniform(0.1, 0.9), sides),
        "polynomial": lambda: (static * 10 ** draw.uniform(-1.0, 0.7), static * draw.uniform(-0.8, 0.8), 0.0),
        "piecewise_linear": lambda: (
            static * 10 ** draw.uniform(-0.5, 1.3), draw.uniform(0.1, 0.9), static * 10 ** draw.uniform(-0.5, 1.3),
        ),
    }[name]()  # fmt: skip
    if name == "polynomial":
        parameters = parameters[0], float(np.clip(parameters[1], -parameters[0], parameters[0])), 0.0
    model.laws.append(Law(KINDS.index(name), shape, tuple(float(p) for p in parameters)))
    measure = kind.removeprefix("mode_")
    low, high = 10 ** draw.uniform(-2.0, -0.3), draw.uniform(1.5, 4.0)
    if measure == "energy":
        low, high = static * low**2 / 2, static * high**2 / 2
    ends = (low, high) if draw.random() < 0.7 else (high, low)
    given = f"energy={float(ends[0])!r}" if measure == "energy" else f"amplitude={float(ends[0])!r}, dof='{model.labels[dof]}'"
    axis = Axis(f"normal_mode%{measure}", float(ends[0]), float(ends[1]), ONE_LINE, True)
    return Workflow(kind, model, (axis,), f"&normal_mode {given} /\n", dof, measure)


def _undamped(structure: str) -> str:
    head, _, rest = structure.partition(", damping_mass=")
    return head + rest[rest.index(" /") :]


def _limit_cycle(draw) -> Workflow:
    """What a van der Pol law drives, over its strength; some with a second law."""
    model = _structure(draw, int(draw.integers(1, 3)))
    n = len(model.mass)
    shape = np.eye(n)[draw.integers(0, n)] if not model.labels[0].startswith("q") else _coordinate(model, draw)
    static = float(1 / (shape @ np.linalg.solve(model.stiffness, shape)))
    inertia = float(1 / (shape @ np.linalg.solve(model.mass, shape)))
    unit = np.sqrt(static * inertia)
    model.laws.append(Law(KINDS.index("van_der_pol"), shape, (float(unit), 1.0, 0.0)))
    choice = draw.random()
    if choice < 0.25:
        model.laws.append(Law(0, shape, (float(static * 10 ** draw.uniform(-1.5, 0.5)), 0.0, 0.0)))
    elif choice < 0.5:
        sides = TWO_SIDED * (draw.random() < 0.5)
        model.laws.append(Law(1, shape, (float(static * 10 ** draw.uniform(-0.5, 1.0)), float(draw.uniform(0.3, 1.5)), sides)))
    low, high = unit * 10 ** draw.uniform(-3.0, -0.3), unit * 10 ** draw.uniform(0.0, 0.7)
    ends = (low, high) if draw.random() < 0.7 else (high, low)
    return Workflow("limit_cycle", model, (Axis("law(1)%strength", float(ends[0]), float(ends[1]), ONE_LINE, True),))
