"""Random scenes for tests/judge: few degrees of freedom, one or two tones, one or two laws that matter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

KINDS = ("cubic_spring", "elastic_stop", "jenkins", "coulomb_tanh", "rigid_wall", "coulomb_rigid")
RIGID = 4  # the first of the rigid ones


@dataclass(frozen=True)
class Law:
    """One law on z = shape . q; the parameters are those of marching.c."""

    kind: int
    shape: np.ndarray
    parameters: tuple[float, float, float]

    def text(self, labels: list[str]) -> str:
        first, second, sides = self.parameters
        used = np.flatnonzero(self.shape)
        place = f"dof='{labels[used[0]]}'"
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
        }[KINDS[self.kind]]
        return f"&law type='{KINDS[self.kind]}', {place}, {keys} /\n"


@dataclass
class Scene:
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
        laws = " and ".join(KINDS[law.kind] for law in self.laws)
        return f"{len(self.mass)} dofs, {len(self.omega)} tones, order {self.order}, {laws}"


def random_scene(seed: int, number: int) -> Scene:
    """The scene of a number; the same on every machine."""
    draw = np.random.default_rng([seed, number])
    scene = _structure(draw, int(draw.integers(1, 4)))
    lowest = np.sort(scene.modes()[0])[0]
    scene.omega = np.array([lowest * draw.uniform(0.4, 2.3)])
    if draw.random() < 0.4:
        ratio = draw.uniform(0.3, 2.6)
        scene.omega = np.append(scene.omega, scene.omega[0] * ratio * (1 + 1e-3 * np.sqrt(2)))
    scene.order = int(draw.integers(5, 26) if len(scene.omega) == 1 else draw.integers(3, 8))
    _load(scene, draw)
    shape = _coordinate(scene, draw)
    scene.laws.append(_law(scene, draw, shape, int(draw.integers(0, len(KINDS)))))
    if draw.random() < 0.25:
        scene.laws.append(_law(scene, draw, _coordinate(scene, draw), int(draw.integers(0, RIGID))))
    return scene


def _structure(draw, n: int) -> Scene:
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
    return Scene(words, mass, by_mass * mass + by_stiffness * stiffness, stiffness, labels, np.zeros(0), 0)


def _load(scene: Scene, draw) -> None:
    n = len(scene.mass)
    for m in range(len(scene.omega)):
        harmonic = tuple(int(i == m) for i in range(len(scene.omega)))
        place = np.eye(n)[draw.integers(0, n)]
        phase = draw.uniform(0, 2 * np.pi)
        scene.loads.append((harmonic, place * np.cos(phase), place * np.sin(phase) * draw.uniform(0.3, 1.0)))
    if draw.random() < 0.2:
        scene.loads.append(((0,) * len(scene.omega), draw.uniform(-0.5, 0.5) * np.eye(n)[0], np.zeros(n)))


def _coordinate(scene: Scene, draw) -> np.ndarray:
    n = len(scene.mass)
    if scene.labels[0].startswith("q"):
        return np.sin(np.arange(1, n + 1) * np.pi * draw.uniform(0.15, 0.85))
    shape = np.eye(n)[draw.integers(0, n)]
    if n > 1 and draw.random() < 0.25:
        shape = np.zeros(n)
        first, second = draw.choice(n, 2, replace=False)
        shape[first], shape[second] = 1.0, -1.0
    return shape


def _law(scene: Scene, draw, shape: np.ndarray, kind: int) -> Law:
    """A law that the linear motion would feel: amplitude, speed and force of that set the scale."""
    amplitude = speed = 0.0
    for harmonic, cosine, sine in scene.loads:
        w = float(np.dot(harmonic, scene.omega))
        response = np.linalg.solve(scene.stiffness - w**2 * scene.mass + 1j * w * scene.damping, cosine - 1j * sine)
        amplitude += abs(shape @ response) * (w != 0)
        speed += abs(shape @ response) * w
    static = 1.0 / (shape @ np.linalg.solve(scene.stiffness, shape))
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


def _listed(values) -> str:
    return ",".join(repr(v.item() if hasattr(v, "item") else v) for v in values)
