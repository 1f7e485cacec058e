"""Random models for tests/points: few degrees of freedom, one to three tones, one or two laws that matter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

KINDS = (
    "cubic_spring", "elastic_stop", "jenkins", "coulomb_tanh", "rigid_wall", "coulomb_rigid",
    "quadratic_damping", "cubic_damping", "polynomial", "piecewise_linear",
    "jenkins_2d", "jenkins_2d", "annular_clearance", "annular_clearance", "van_der_pol",
)  # fmt: skip
RIGID = (4, 5)
N_SOFT = 4  # kinds of a second law
N_FIRST = 6  # kinds of models that are not wide
PLANE = {"jenkins_2d": 10, "annular_clearance": 12}  # two laws in integration.c: x and y
INTEGRATED_BY = {"jenkins_2d": "&integration method='runge_kutta_4', steps_per_period=1000 /\n"}  # cvode cannot
WIDE = ("quadratic_damping", "cubic_damping", "polynomial", "piecewise_linear", "iwan", *PLANE)


@dataclass(frozen=True)
class Law:
    """One law on z = shape . q; the parameters are those of integration.c."""

    kind: int
    shape: np.ndarray
    parameters: tuple[float, float, float]
    said: str | None = None  # the group of an input where it is not that of this law alone

    def text(self, labels: list[str]) -> str:
        if self.said is not None:
            return self.said
        first, second, sides = self.parameters
        used = np.flatnonzero(self.shape)
        place = f"dof{'s' * (KINDS[self.kind] == 'cubic_damping')}='{labels[used[0]]}'"
        if len(used) > 1 or self.shape[used[0]] != 1.0:
            place = "dofs=" + ",".join(f"'{labels[i]}'" for i in used) + ", weights=" + _listed(self.shape[used])
        both = ", two_sided=.true." if sides else ""
        keys = {
            "cubic_spring": f"stiffness={first!r}",
            "elastic_stop": f"stiffness={first!r}, gap={second!r}{both}",
            "jenkins": f"stiffness={first!r}, limit={second!r}",
            "coulomb_tanh": f"limit={first!r}, velocity={second!r}",
            "rigid_wall": f"gap={second!r}{both}",
            "coulomb_rigid": f"limit={first!r}",
            "quadratic_damping": f"coefficient={first!r}",
            "cubic_damping": f"coefficient={first!r}",
            "polynomial": f"stiffness=0,{second!r},{first!r}",
            "van_der_pol": f"strength={first!r}, threshold={second!r}",
            "piecewise_linear": f"breakpoints={-second!r},{second!r}, slopes={sides!r},0,{first!r}",
        }[KINDS[self.kind]]
        return f"&law type='{KINDS[self.kind]}', {place}, {keys} /\n"


@dataclass
class Model:
    """M q'' + D q' + K q + laws = loads(t); loads: tuple, cosine, sine of all degrees of freedom."""

    structure: str
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    labels: list[str]
    omega: np.ndarray
    order: int
    laws: list[Law] = field(default_factory=list)
    loads: list[tuple[tuple[int, ...], np.ndarray, np.ndarray]] = field(default_factory=list)

    def text(self) -> str:
        tones = _listed(self.omega)
        text = self.structure + f"&tones frequency={tones} /\n&harmonics order={self.order} /\n"
        text += "".join(law.text(self.labels) for law in self.laws)
        for harmonic, cosine, sine in self.loads:
            for label, c, s in zip(self.labels, cosine, sine):
                if c or s:
                    text += f"&load dof='{label}', tuple={_listed(harmonic)}, cos={float(c)!r}, sin={float(s)!r} /\n"
        return text

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies without damping [rad/s], decay rates [1/s] of all oscillatory motions."""
        n = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        system = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]])
        return np.sqrt(np.abs(np.linalg.eigvals(inverse @ self.stiffness))), -np.linalg.eigvals(system).real

    @property
    def title(self) -> str:
        laws = " and ".join(law.text(self.labels).split("'")[1] for law in self.laws if law.said != "")
        return f"{len(self.mass)} dofs, {len(self.omega)} tones, order {self.order}, {laws}"


def random_model(seed: int, number: int, is_wide: bool = False) -> Model:
    """The model of a number; the same on every machine. Wide ones have up to three tones and more kinds of laws."""
    draw = np.random.default_rng([seed, number])
    model = _structure(draw, int(draw.integers(1, 4)))
    lowest = np.sort(model.modes()[0])[0]
    model.omega = np.array([lowest * draw.uniform(0.4, 2.3)])
    if draw.random() < 0.4:
        ratio = draw.uniform(0.3, 2.6)
        model.omega = np.append(model.omega, model.omega[0] * ratio * (1 + 1e-3 * np.sqrt(2)))
    if is_wide and len(model.omega) > 1 and draw.random() < 0.4:
        model.omega = np.append(model.omega, model.omega[0] * draw.uniform(0.3, 2.6) * (1 + 1e-3 * np.sqrt(3)))
    model.order = int(draw.integers(*((5, 26), (3, 8), (2, 5))[len(model.omega) - 1]))
    _load(model, draw)
    shape = _coordinate(model, draw)
    kind = int(draw.integers(0, N_FIRST + (len(WIDE) if is_wide else 0)))
    if kind < N_FIRST:
        model.laws.append(_law(model, draw, shape, kind))
    else:
        model.laws += _wide_laws(model, draw, shape, WIDE[kind - N_FIRST])
    if draw.random() < 0.25:
        model.laws.append(_law(model, draw, _coordinate(model, draw), int(draw.integers(0, N_SOFT))))
    return model


def _structure(draw, n: int) -> Model:
    damping = 10 ** draw.uniform(-3.0, -0.8)  # ratio of the first mode, about
    kind = draw.choice(["chain", "matrices", "modal_beam"])
    labels = [f"x{i + 1}" for i in range(n)]
    if kind == "chain":
        mass = np.diag(10 ** draw.uniform(-0.5, 0.5, n))
        springs = 10 ** draw.uniform(-0.5, 0.5, n + 1)
        stiffness = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
        words = f"type='chain', n_masses={n}, mass={_listed(np.diag(mass))}, coupling_stiffness={_listed(springs)}"
    elif kind == "matrices":
        rotation = np.linalg.qr(draw.normal(size=(n, n)))[0]
        mass = rotation @ np.diag(draw.uniform(0.5, 2.0, n)) @ rotation.T
        rotation = np.linalg.qr(draw.normal(size=(n, n)))[0]
        stiffness = rotation @ np.diag(10 ** draw.uniform(0.0, 1.3, n)) @ rotation.T
        mass, stiffness = (mass + mass.T) / 2, (stiffness + stiffness.T) / 2
        words = f"type='matrices', n_dofs={n}, mass={_listed(mass.ravel())}, stiffness={_listed(stiffness.ravel())}"
    else:
        labels = [f"q{i + 1}" for i in range(n)]
        mass = 0.5 * np.eye(n)
        stiffness = np.diag([0.5 * (k * np.pi) ** 4 for k in range(1, n + 1)]) / np.pi**4
        bending = 1 / np.pi**4
        words = f"type='modal_beam', length=1.0, bending_stiffness={bending!r}, mass_per_length=1.0, n_modes={n}"
    first = np.sqrt(np.min(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))
    by_mass, by_stiffness = (2 * damping * first, 0.0) if draw.random() < 0.5 else (0.0, 2 * damping / first)
    words = f"&structure {words}, damping_mass={by_mass!r}, damping_stiffness={by_stiffness!r} /\n"
    words = words.replace("np.float64(", "").replace("),", ",").replace(") /", " /")
    return Model(words, mass, by_mass * mass + by_stiffness * stiffness, stiffness, labels, np.zeros(0), 0)


def _load(model: Model, draw) -> None:
    n = len(model.mass)
    for m in range(len(model.omega)):
        harmonic = tuple(int(i == m) for i in range(len(model.omega)))
        place = np.eye(n)[draw.integers(0, n)]
        phase = draw.uniform(0, 2 * np.pi)
        model.loads.append((harmonic, place * np.cos(phase), place * np.sin(phase) * draw.uniform(0.3, 1.0)))
    if draw.random() < 0.2:
        model.loads.append(((0,) * len(model.omega), draw.uniform(-0.5, 0.5) * np.eye(n)[0], np.zeros(n)))


def _coordinate(model: Model, draw) -> np.ndarray:
    n = len(model.mass)
    if model.labels[0].startswith("q"):
        return np.sin(np.arange(1, n + 1) * np.pi * draw.uniform(0.15, 0.85))
    shape = np.eye(n)[draw.integers(0, n)]
    if n > 1 and draw.random() < 0.25:
        shape = np.zeros(n)
        first, second = draw.choice(n, 2, replace=False)
        shape[first], shape[second] = 1.0, -1.0
    return shape


def _law(model: Model, draw, shape: np.ndarray, kind: int) -> Law:
    """A law that the linear motion would feel: amplitude, speed and force of that set the scale."""
    amplitude, speed, static = _scale(model, shape)
    both = float(draw.random() < 0.4)
    first, second = {
        "cubic_spring": lambda: (static * 10 ** draw.uniform(-1.0, 1.5) / amplitude**2, 0.0),
        "elastic_stop": lambda: (static * 10 ** draw.uniform(0.0, 3.0), amplitude * draw.uniform(0.05, 0.95)),
        "jenkins": lambda: (static * 10 ** draw.uniform(-0.5, 1.0), static * amplitude * draw.uniform(0.03, 0.6)),
        "coulomb_tanh": lambda: (static * amplitude * draw.uniform(0.03, 0.5), speed * draw.uniform(0.03, 0.3)),
        "rigid_wall": lambda: (0.0, amplitude * draw.uniform(0.1, 0.95)),
        "coulomb_rigid": lambda: (static * amplitude * draw.uniform(0.03, 0.4), 0.0),
    }[KINDS[kind]]()
    return Law(kind, shape, (float(first), float(second), both if kind in (1, 4) else 0.0))


def _scale(model: Model, shape: np.ndarray) -> tuple[float, float, float]:
    """Amplitude, speed and stiffness of a coordinate in the linear motion, a little where nothing moves it."""
    amplitude = speed = 1e-9
    for harmonic, cosine, sine in model.loads:
        w = float(np.dot(harmonic, model.omega))
        response = np.linalg.solve(model.stiffness - w**2 * model.mass + 1j * w * model.damping, cosine - 1j * sine)
        amplitude += abs(shape @ response) * (w != 0)
        speed += abs(shape @ response) * w
    return float(amplitude), float(speed), float(1.0 / (shape @ np.linalg.solve(model.stiffness, shape)))


def _wide_laws(model: Model, draw, shape: np.ndarray, name: str) -> list[Law]:
    """A law of those that wide models have besides; where integration.c has several for it, the first one has the words."""
    if name == "cubic_damping":  # has no weights
        shape = max(np.eye(len(shape)), key=lambda axis: _scale(model, axis)[0])
    amplitude, speed, static = _scale(model, shape)
    force = static * amplitude
    if name == "iwan":
        stiffness, limit = static * 10 ** draw.uniform(-0.5, 0.7), force * draw.uniform(0.03, 0.3)
        shares, limits = (1.0, 0.6), (1.0, 1.8)
        laws = [Law(2, shape, (float(stiffness * k), float(limit * m), 0.0)) for k, m in zip(shares, limits)]
        keys = f"stiffness={_listed([w.parameters[0] for w in laws])}, limit={_listed([w.parameters[1] for w in laws])}"
        said = laws[0].text(model.labels)
        said = said[: said.index("stiffness=")].replace("'jenkins'", "'iwan'") + keys + " /\n"
        return [Law(2, shape, laws[0].parameters, said), Law(2, shape, laws[1].parameters, "")]
    if name in PLANE:
        if len(model.mass) == 1:
            return [_law(model, draw, shape, 2)]
        axes = np.eye(len(model.mass))
        x, y = (int(i) for i in draw.choice(len(model.mass), 2, replace=False))
        amplitude = np.hypot(_scale(model, axes[x])[0], _scale(model, axes[y])[0])
        static = min(_scale(model, axes[x])[2], _scale(model, axes[y])[2])
        stiffness, share = float(static * 10 ** draw.uniform(-0.5, 1.0)), draw.uniform(0.05, 0.6)
        second = float(amplitude * share * (stiffness if name == "jenkins_2d" else 1.0))
        labels = f"'{model.labels[x]}'", f"'{model.labels[y]}'"
        said = {
            "jenkins_2d": f"dof={labels[0]}, second_dofs={labels[1]}, stiffness={stiffness!r}, limit={second!r}",
            "annular_clearance": f"dofs={labels[0]},{labels[1]}, stiffness={stiffness!r}, clearance={second!r}",
        }[name]
        parameters = (stiffness, second, 0.0)
        return [
            Law(PLANE[name], axes[x], parameters, f"&law type='{name}', {said} /\n" + INTEGRATED_BY.get(name, "")),
            Law(PLANE[name] + 1, axes[y], parameters, ""),
        ]
    sign = draw.choice([-1.0, 1.0])
    first, second, third = {
        "quadratic_damping": lambda: (force * draw.uniform(0.03, 0.5) / speed**2, 0.0, 0.0),
        "cubic_damping": lambda: (force * draw.uniform(0.03, 0.5) / speed**3, 0.0, 0.0),
        "polynomial": lambda: (static * 10 ** draw.uniform(-0.5, 1.0) / amplitude**2, 0.0, 0.0),
        "piecewise_linear": lambda: (
            static * 10 ** draw.uniform(-0.5, 1.5), amplitude * draw.uniform(0.05, 0.9), static * 10 ** draw.uniform(-0.5, 1.5),
        ),
    }[name]()  # fmt: skip
    if name == "polynomial":
        second = sign * first * amplitude * draw.uniform(0.0, 1.0)
    return [Law(KINDS.index(name), shape, (float(first), float(second), float(third)))]


def _listed(values) -> str:
    return ",".join(repr(v.item() if hasattr(v, "item") else v) for v in values)
