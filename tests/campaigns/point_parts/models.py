"""Random models for tests/campaigns/points: few degrees of freedom, one to three tones, one or two laws that matter."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

KINDS = (
    "cubic_spring", "elastic_stop", "jenkins", "coulomb_tanh", "rigid_wall", "coulomb_rigid",
    "quadratic_damping", "cubic_damping", "polynomial", "piecewise_linear",
    "jenkins_2d", "jenkins_2d", "annular_clearance", "annular_clearance", "van_der_pol",
    "hertz", "electrostatic", "bouc_wen", "maxwell", "parametric", "film_x", "film_y", "balls_x", "balls_y",
    "contact_x", "contact_y", "contact_n",
)  # fmt: skip
RIGID = (4, 5)
N_SOFT = 4  # kinds of a second law
N_FIRST = 6  # kinds of models that are not wide
PLANE = {"jenkins_2d": 10, "annular_clearance": 12}  # two laws in integration.c: x and y
INTEGRATED_BY = {"jenkins_2d": "&integration method='runge_kutta_4', steps_per_period=1000 /\n"}  # cvode cannot
LATER = (  # drawn where they are named: laws, and what is written as other groups
    "hertz", "electrostatic", "bouc_wen", "parametric", "polynomial_coupled", "squeeze_film", "short_bearing", "rolling_bearing",
    "contact_3d", "dynamic_stiffness", "restitution", "base",
)  # fmt: skip
MIN_DOFS = {"polynomial_coupled": 2, "squeeze_film": 2, "short_bearing": 2, "rolling_bearing": 2, "contact_3d": 3}
WIDE = ("quadratic_damping", "cubic_damping", "polynomial", "piecewise_linear", "iwan", *PLANE)


@dataclass(frozen=True)
class Law:
    """One law on z = shape . q; the parameters are those of integration.c."""

    kind: int
    shape: np.ndarray
    parameters: tuple[float, ...]
    said: str | None = None  # the group of an input where it is not that of this law alone
    tuple_: tuple[int, ...] = ()  # of the tones, where the last parameter is a frequency
    is_multiplied_out: bool = False  # in the input its coordinates are all degrees of freedom

    def text(self, labels: list[str]) -> str:
        if self.said is not None:
            return self.said
        first, second, sides = self.parameters[:3]
        place = _place(labels, self.shape, "dofs" if KINDS[self.kind] == "cubic_damping" else "dof")
        both = ", two_sided=.true." if sides else ""
        keys = {
            "cubic_spring": f"stiffness={first!r}",
            "elastic_stop": f"stiffness={first!r}, gap={second!r}{both}",
            "jenkins": f"stiffness={first!r}, limit={second!r}",
            "coulomb_tanh": f"limit={first!r}, velocity={second!r}",
            "rigid_wall": f"gap={second!r}{both}" + f", restitution={first!r}" * (first > 0),
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
    moves: list[tuple[tuple[int, ...], str, float, float]] = field(default_factory=list)  # of a base, in place of loads

    def text(self) -> str:
        tones = _listed(self.omega)
        text = self.structure + f"&tones frequency={tones} /\n&harmonics order={self.order} /\n"
        text += "".join(law.text(self.labels) for law in self.laws)
        return text + self.load_text()

    def load_text(self) -> str:
        text = ""
        for harmonic, cosine, sine in [] if self.moves else self.loads:
            for label, c, s in zip(self.labels, cosine, sine):
                if c or s:
                    text += f"&load dof='{label}', tuple={_listed(harmonic)}, cos={float(c)!r}, sin={float(s)!r} /\n"
        for harmonic, kind, c, s in self.moves:
            for label in self.labels:
                text += f"&load dof='{label}', tuple={_listed(harmonic)}, cos={c!r}, sin={s!r}, kind='base_{kind}' /\n"
        return text

    def retune(self, omega) -> None:
        """Other tones: what laws and loads have of them follows."""
        self.omega = np.array(omega, dtype=float)
        self.laws = [
            replace(law, parameters=(*law.parameters[:-1], float(np.dot(law.tuple_, self.omega)))) if law.tuple_ else law
            for law in self.laws
        ]
        whole = self.mass @ np.ones(len(self.mass))
        for i, (harmonic, kind, c, s) in enumerate(self.moves):
            loaded = whole * (float(np.dot(harmonic, self.omega)) ** 2 if kind == "displacement" else -1.0)
            self.loads[i : i + 1] = [(harmonic, c * loaded, s * loaded)]

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies without damping [rad/s], decay rates [1/s] of all oscillatory motions."""
        n = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        system = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]])
        return np.sqrt(np.abs(np.linalg.eigvals(inverse @ self.stiffness))), -np.linalg.eigvals(system).real

    @property
    def title(self) -> str:
        laws = " and ".join(law.text(self.labels).split("'")[1] for law in self.laws if law.said != "")
        laws = "base and " * bool(self.moves) + laws
        return f"{len(self.mass)} dofs, {len(self.omega)} tones, order {self.order}, {laws}"


def random_model(seed: int, number: int, is_wide: bool = False, kinds: tuple[str, ...] = (), is_apart: bool = False) -> Model:
    """The model of a number; the same on every machine. Wide ones have up to three tones and more kinds of laws; of `kinds`,
    some of LATER, the models have one after the other. Those apart have two tones with a ratio of 20 to 100."""
    draw = np.random.default_rng([seed, number])
    later = kinds[number % len(kinds)] if kinds else ""
    least = MIN_DOFS.get(later, 1)
    model = _structure(draw, int(draw.integers(least, 4)))
    while least > 1 and model.labels[0].startswith("q"):  # modes of a beam move each by itself
        model = _structure(draw, int(draw.integers(least, 4)))
    lowest = np.sort(model.modes()[0])[0]
    model.omega = np.array([lowest * draw.uniform(0.4, 2.3)])
    if draw.random() < 0.4:
        ratio = draw.uniform(0.3, 2.6)
        model.omega = np.append(model.omega, model.omega[0] * ratio * (1 + 1e-3 * np.sqrt(2)))
    if is_wide and len(model.omega) > 1 and draw.random() < 0.4:
        model.omega = np.append(model.omega, model.omega[0] * draw.uniform(0.3, 2.6) * (1 + 1e-3 * np.sqrt(3)))
    if is_apart:
        model.omega = model.omega[0] * np.array([1.0, 1.0 / draw.uniform(20.0, 100.0)])
    model.order = int(draw.integers(*((5, 26), (3, 8), (2, 5))[len(model.omega) - 1]))
    _load(model, draw)
    if later == "base":
        _move_base(model, draw)
    shape = _coordinate(model, draw)
    if later:
        model.laws += _later_laws(model, draw, shape, later)
    else:
        kind = int(draw.integers(0, N_FIRST + (len(WIDE) if is_wide else 0)))
        if kind < N_FIRST:
            model.laws.append(_law(model, draw, shape, kind))
        else:
            model.laws += _wide_laws(model, draw, shape, WIDE[kind - N_FIRST])
    if draw.random() < 0.25 and later != "restitution":
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


def _later_laws(model: Model, draw, shape: np.ndarray, name: str) -> list[Law]:
    """A law of LATER; where integration.c has several for it, the first one has the words."""
    if name in ("squeeze_film", "short_bearing", "rolling_bearing", "contact_3d"):
        return _laws_of_a_journal(model, draw, name)
    if name == "polynomial_coupled":
        return _coupled(model, draw)
    amplitude, speed, static = _scale(model, shape)
    force = static * amplitude
    tuple_ = np.eye(len(model.omega), dtype=int)[draw.integers(0, len(model.omega))] * int(draw.integers(1, 3))
    phase = f"tuple={_listed(tuple_)}"
    place = _place(model.labels, shape, "dof")
    soft = [_law(model, draw, _coordinate(model, draw), int(draw.integers(0, N_SOFT)))]
    if name == "base":
        return soft
    if name == "restitution":
        law = _law(model, draw, shape, RIGID[0])
        return [replace(law, parameters=(float(draw.uniform(0.1, 0.95)), *law.parameters[1:]))]
    if name == "hertz":
        n = float(draw.choice([1.5, 10 / 9, draw.uniform(1.2, 3.0)]))
        values = {
            "stiffness": static * 10 ** draw.uniform(0.0, 2.0) * amplitude ** (1 - n),
            "exponent": n,
            "gap": amplitude * draw.uniform(-0.2, 0.9),
            "dissipation": draw.choice([0.0, draw.uniform(0.0, 0.3) / speed]),
        }
        return [_said(model, shape, name, values)]
    if name == "electrostatic":
        gap, part, angle = amplitude * draw.uniform(1.5, 6.0), draw.uniform(0.0, 0.5), draw.uniform(0, 2 * np.pi)
        values = {
            "coefficient": draw.uniform(0.05, 0.5) * 4 * static * gap**3 / 27 / (1 + part**2 / 2),
            "gap": gap, "voltage": 1.0, "voltage_cos": part * np.cos(angle), "voltage_sin": part * np.sin(angle),
        }  # fmt: skip
        return [_said(model, shape, name, values, tuple_, phase)]
    if name == "bouc_wen":
        values = {
            "stiffness": static * 10 ** draw.uniform(-0.5, 0.7),
            "post_yield_ratio": draw.uniform(0.0, 0.5),
            "yield_displacement": amplitude * draw.uniform(0.05, 0.8),
            "exponent": draw.choice([1.0, 2.0, draw.uniform(1.0, 4.0)]),
            "beta": draw.uniform(0.5, 1.0),
        }
        return [_said(model, shape, name, values)]
    angle = draw.uniform(0, 2 * np.pi)
    if name == "parametric":
        change, loss = static * draw.uniform(0.05, 0.6), force / speed * draw.uniform(0.0, 0.02)
        values = {
            "stiffness_cos": change * np.cos(angle), "stiffness_sin": change * np.sin(angle), "damping_cos": loss,
            "damping_sin": 0.0, "backlash": amplitude * draw.uniform(0.05, 0.5) * (draw.random() < 0.4),
        }  # fmt: skip
        return [_said(model, shape, name, values, tuple_, phase), *soft[: int(draw.integers(0, 2))]]
    moduli = static * 10 ** draw.uniform(-1.0, 0.5, int(draw.integers(1, 3)))  # dynamic_stiffness
    times = 10 ** draw.uniform(-1.0, 1.0, len(moduli)) / model.omega[0]
    said = f"&dynamic_stiffness type='maxwell', {place}, moduli={_listed(moduli)}, times={_listed(times)} /\n"
    parts = [(float(k), float(t)) for k, t in zip(moduli, times)]
    return soft + [Law(KINDS.index("maxwell"), shape, part, said * (i == 0)) for i, part in enumerate(parts)]


def _said(model: Model, shape, name: str, values: dict, tuple_=(), more: str = "") -> Law:
    """A law whose parameters in integration.c are its keys in this order, perhaps with the frequency of a tuple behind them."""
    parameters = tuple(float(value) for value in values.values())
    keys = ", ".join(f"{key}={value!r}" for key, value in zip(values, parameters))
    keys = ", ".join(part for part in (_place(model.labels, shape, "dof"), keys, more) if part)
    tuple_ = tuple(int(j) for j in tuple_)
    parameters += (float(np.dot(tuple_, model.omega)),) if tuple_ else ()
    return Law(KINDS.index(name), shape, parameters, f"&law type='{name}', {keys} /\n", tuple_)


def _laws_of_a_journal(model: Model, draw, name: str) -> list[Law]:
    """Laws of two or three coordinates, degrees of freedom of the model."""
    axes = np.eye(len(model.mass))
    x, y, *rest = (int(i) for i in draw.permutation(len(model.mass)))
    scales = [_scale(model, axes[i]) for i in (x, y)]
    amplitude, speed = (float(np.hypot(*(scale[i] for scale in scales))) for i in (0, 1))
    static = min(scale[2] for scale in scales)
    tuple_: tuple[int, ...] = ()
    labels = [model.labels[i] for i in (x, y, *rest[:1])]
    said = f"dof='{labels[0]}', second_dofs='{labels[1]}', "
    if name in ("squeeze_film", "short_bearing"):
        clearance = amplitude * float(draw.uniform(0.3, 2.0))
        viscosity = static * amplitude / speed * float(draw.uniform(0.05, 1.0)) * clearance**3 * 2 / np.pi
        turns = float(draw.uniform(0.2, 1.5) * model.omega[0]) * (name == "short_bearing")
        is_full = bool(draw.random() < 0.3)
        said += f"viscosity={viscosity!r}, radius=1.0, length=1.0, clearance={clearance!r}, rotor_speed={turns!r}, "
        said += f"film='{'full' if is_full else 'half'}'"
        kind, law, parameters = "film", "short_bearing", (viscosity, clearance, turns, float(is_full))
    elif name == "rolling_bearing":
        n, exponent = int(draw.integers(5, 13)), float(draw.choice([1.5, 10 / 9]))
        stiffness = float(static * 10 ** draw.uniform(-0.5, 1.0) * amplitude ** (1 - exponent) / n)
        clearance = float(amplitude * draw.uniform(-0.3, 0.3))
        passing = np.eye(len(model.omega), dtype=int)[-1] * int(draw.integers(1, 4))
        said += f"n_balls={n}, stiffness={stiffness!r}, exponent={exponent!r}, clearance={clearance!r}, tuple={_listed(passing)}"
        kind, law = "balls", name
        parameters = (stiffness, exponent, clearance, float(n), float(passing @ model.omega))
        tuple_ = tuple(int(j) for j in passing)
    else:
        deep, _, below = _scale(model, axes[rest[0]])
        stiffness, friction = float(static * 10 ** draw.uniform(-0.5, 1.0)), float(draw.uniform(0.2, 0.8))
        preload = float(stiffness * amplitude * draw.uniform(0.05, 0.6) / friction)
        normal = float(min(below * 10 ** draw.uniform(-1.0, 0.7), 5 * preload / deep))
        said += f"normal_dofs='{labels[2]}', stiffness={stiffness!r}, friction_coefficient={friction!r}, "
        said += f"normal_stiffness={normal!r}, preload={preload!r}"
        kind, law, parameters = "contact", "jenkins_2d", (stiffness, friction, normal, preload)
    words = f"&law type='{law}', {said} /\n" + INTEGRATED_BY.get(law, "")
    first = KINDS.index(f"{kind}_x")
    places = [axes[i] for i in ((x, y, rest[0]) if kind == "contact" else (x, y))]
    return [Law(first + i, place, parameters, words * (i == 0), tuple_) for i, place in enumerate(places)]


def _coupled(model: Model, draw) -> list[Law]:
    """Forces c (u.q)**3 + b (u.q)**2, perhaps d (u.v)**3, along directions u, multiplied out."""
    n = len(model.mass)
    laws, terms = [], Counter()
    for _ in range(int(draw.integers(1, 3))):
        shape = draw.normal(size=n)
        shape /= np.linalg.norm(shape)
        amplitude, speed, static = _scale(model, shape)
        third = float(static * 10 ** draw.uniform(-0.5, 1.0) / amplitude**2)
        second = float(draw.choice([-1.0, 1.0]) * third * amplitude * draw.uniform(0.0, 1.0))
        laws.append(Law(KINDS.index("polynomial"), shape, (third, second, 0.0), ""))
        if draw.random() < 0.4:
            damping = float(static * amplitude * draw.uniform(0.03, 0.5) / speed**3)
            laws.append(Law(KINDS.index("cubic_damping"), shape, (damping, 0.0, 0.0), ""))
    for law in laws:
        is_rate = KINDS[law.kind] == "cubic_damping"
        for degree, coefficient in ((3, law.parameters[0]), (2, law.parameters[1])):
            for factors in product(range(n), repeat=degree) if coefficient else ():
                powers = tuple(int(np.sum(np.array(factors) == i)) for i in range(n))
                for acts_on in range(n):
                    exponents = ((0,) * n, powers) if is_rate else (powers, (0,) * n)
                    terms[(acts_on, *exponents)] += float(coefficient * law.shape[acts_on] * np.prod(law.shape[list(factors)]))
    said = "dofs=" + ",".join(f"'{label}'" for label in model.labels)
    said += "\n   coefficients=" + ",\n   ".join(repr(value) for value in terms.values())
    said += "\n   acts_on=" + ",\n   ".join(f"'{model.labels[i]}'" for i, _, _ in terms)
    said += "\n   displacement_exponents=" + ",\n   ".join(_listed(powers) for _, powers, _ in terms)
    said += "\n   velocity_exponents=" + ",\n   ".join(_listed(powers) for _, _, powers in terms)
    laws[0] = replace(laws[0], said=f"&law type='polynomial_coupled', {said} /\n")
    return [replace(law, is_multiplied_out=True) for law in laws]


def _move_base(model: Model, draw) -> None:
    """Loads of a base that moves all degrees of freedom, by an acceleration or a displacement a tone."""
    for harmonic, _, _ in model.loads:
        kind = str(draw.choice(["acceleration", "displacement"]))
        c, s = (float(value) for value in draw.normal(size=2))
        model.moves.append((harmonic, kind, c, s))
    model.retune(model.omega)


def _place(labels: list[str], shape: np.ndarray, key: str) -> str:
    used = np.flatnonzero(shape)
    if len(used) == 1 and shape[used[0]] == 1.0:
        return f"{key}='{labels[used[0]]}'"
    return "dofs=" + ",".join(f"'{labels[i]}'" for i in used) + ", weights=" + _listed(shape[used])


def _listed(values) -> str:
    return ",".join(repr(v.item() if hasattr(v, "item") else v) for v in values)
