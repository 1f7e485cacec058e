"""Models in other units: each coordinate, each equation and time multiplied by a factor of its own.

With x_i = s_i y_i, row i times r_i and t = T t', the matrices become r_i M_ij s_j/T**2, r_i D_ij s_j/T and r_i K_ij s_j, loads
r_i F, and frequencies T w. The motion is the same; so is everything said about it.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Units:
    """Factors of coordinates, of equations, and of time."""

    coordinates: np.ndarray
    equations: np.ndarray
    time: float

    def force(self, i, displacements=(), rates=()):
        """Factor of a coefficient of row i that multiplies these coordinates and rates."""
        return self.equations[i] * np.prod([self.coordinates[j] for j in (*displacements, *rates)]) / self.time ** len(rates)


@dataclass
class Model:
    """A model whose laws are functions of the units that return their namelist groups."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    frequency: list
    loads: list  # (coordinate, tuple, cos)
    laws: list
    rest: object = ""  # text, or a function of the units that returns it
    kind: str = "free"  # "free": every row its own factor; "energy": that of its coordinate, which retains symmetry
    keys: dict = field(default_factory=dict)

    @property
    def n(self):
        return len(self.mass)

    def random_units(self, rng, decades=6.0):
        def power(n):
            return 10.0 ** rng.uniform(-decades, decades, n)
        coordinates = power(self.n)
        equations = power(self.n) if self.kind == "free" else coordinates * power(1)
        return Units(coordinates, equations, power(1)[0])

    def same_units(self):
        return Units(np.ones(self.n), np.ones(self.n), 1.0)

    def text(self, units):
        def matrix(values, power):
            scaled = np.outer(units.equations, units.coordinates) * values / units.time**power
            if np.count_nonzero(scaled - np.diag(np.diag(scaled))) == 0:
                scaled = np.diag(scaled)
            return ", ".join(repr(float(v)) for v in scaled.ravel())

        lines = [f"&structure type='matrices', n_dofs={self.n}, mass={matrix(self.mass, 2)}, damping={matrix(self.damping, 1)}, "
                 f"stiffness={matrix(self.stiffness, 0)} /",
                 f"&tones frequency={', '.join(repr(float(w * units.time)) for w in self.frequency)} /"]
        for i, of, cos in self.loads:
            lines.append(f"&load dof='x{i + 1}', tuple={', '.join(map(str, of))}, cos={cos * units.equations[i]:.17g} /")
        lines += [law(units) for law in self.laws]
        return "\n".join([*lines, self.rest(units) if callable(self.rest) else self.rest])


def cubic(i, k):
    return lambda u: f"&law type='cubic_spring', dof='x{i + 1}', stiffness={k * u.force(i, [i] * 3):.17g} /"


def stop(i, k, gap):
    return lambda u: (f"&law type='elastic_stop', dof='x{i + 1}', stiffness={k * u.force(i, [i]):.17g}, "
                      f"gap={gap / u.coordinates[i]:.17g} /")


def slider(i, k, limit):
    return lambda u: (f"&law type='jenkins', dof='x{i + 1}', stiffness={k * u.force(i, [i]):.17g}, "
                      f"limit={limit * u.force(i):.17g} /")


def wall(i, gap, restitution):
    return lambda u: f"&law type='rigid_wall', dof='x{i + 1}', gap={gap / u.coordinates[i]:.17g}, restitution={restitution:.17g} /"


def van_der_pol(i, c, length):
    """Force c (x**2/length**2 - 1) x'."""
    return lambda u: (f"&law type='polynomial_coupled', dofs='x{i + 1}', coefficients={-c * u.force(i, rates=[i]):.17g}, "
                      f"{c / length**2 * u.force(i, [i, i], [i]):.17g}, acts_on='x{i + 1}', 'x{i + 1}', "
                      "displacement_exponents=0, 2, velocity_exponents=1, 1 /")


def coil(i, j, b):
    """The force b x_i**2 x_j of a current j, and the voltage -b x_i**2 v_i."""
    return lambda u: (f"&law type='polynomial_coupled', dofs='x{i + 1}', 'x{j + 1}', "
                      f"coefficients={b * u.force(i, [i, i, j]):.17g}, {-b * u.force(j, [i, i], [i]):.17g}, "
                      f"acts_on='x{i + 1}', 'x{j + 1}', "
                      "displacement_exponents=2, 1, 2, 0, velocity_exponents=0, 0, 1, 0 /")


def chain(n, k, c):
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return k * stiffness, c * stiffness


def loudspeaker(rng):
    f = rng.uniform(0.7, 1.4, 4)
    b = 4.95 * f[0]
    return Model(np.diag([14.35e-3 * f[1], 0.0]), np.array([[0.786, 0.0], [b, 266e-6 * f[2]]]),
                 np.array([[1852.0, -b], [0.0, 3.3]]), [2 * np.pi * 41 * f[3], 2 * np.pi * 600],
                 [(1, (1, 0), 8.0), (1, (0, 1), 2.0)], [coil(0, 1, 4.95e5)])


def hydraulic(rng):
    f = rng.uniform(0.7, 1.4, 4)
    a = 0.005 * f[0]
    return Model(
        np.diag([50.0, 0.0]),
        np.array([[200.0 * f[1], 0.0], [-a, 1e-13 * f[2]]]),
        np.array([[1e6, a], [0.0, 1e-10 * f[3]]]),
        [2 * np.pi * 2, 2 * np.pi * 25],
        [(0, (1, 0), 2000.0), (0, (0, 1), 2000.0)],
        [cubic(0, 1e11)],
    )


def harvester(rng):
    f = rng.uniform(0.8, 1.25, 3)
    return Model(np.diag([1.0, 0.0]), np.array([[0.02 * f[0], 0.0], [0.5, 1.0]]), np.array([[-0.5, -0.05 * f[1]], [0.0, 0.05]]),
                 [0.8], [(0, (1,), 0.15 * f[2])], [cubic(0, 0.5)])


def springs(rng, tones=1):
    """A node without mass between springs, another with a dashpot."""
    f = rng.uniform(0.7, 1.4, 4)
    k1, k2, k3, c = 3.0 * f[0], 6.0 * f[1], 2.0 * f[2], 0.7 * f[3]
    stiffness = np.array([[k1 + 1.0, -k1, 0.0], [-k1, k1 + k2, -k2], [0.0, -k2, k2 + k3]])
    loads = [(0, (1,), 0.4)] if tones == 1 else [(0, (1, 0), 0.4), (0, (0, 1), 0.3)]
    return Model(np.diag([1.0, 0.0, 0.0]), np.diag([0.05, 0.0, c]), stiffness, [1.3, 1.7123][:tones], loads, [cubic(0, 1.0)])


def masses(rng, law, tones=1, n=3, load=0.5):
    f = rng.uniform(0.7, 1.4, 3)
    k, c = chain(n, 1.0 * f[0], 0.03 * f[1])
    loads = [(0, (1,), load * f[2])] if tones == 1 else [(0, (1, 0), load * f[2]), (0, (0, 1), 0.7 * load)]
    return Model(np.diag(rng.uniform(0.5, 2.0, n)), c, k, [0.9, 0.9 * 1.71237][:tones], loads, [law], kind="energy")


def drawn(rng, kind, i):
    f = rng.uniform(0.7, 1.4, 2)
    if kind == "cubic":
        return cubic(i, 0.5 * f[0])
    return stop(i, 8.0 * f[0], 0.4 * f[1]) if kind == "stop" else slider(i, 1.5 * f[0], 0.25 * f[1])


def several(rng, kinds, tones=1, load=0.5):
    """Laws at all masses of a chain."""
    model = masses(rng, cubic(0, 0.4), tones, n=len(kinds), load=load)
    model.laws = []
    for i, kind in enumerate(kinds):
        model.laws.append(drawn(rng, kind, i))
    return model


def speaker_with_suspension(rng):
    """Laws at the coil and at its cone, of which one coordinate is a current."""
    model = loudspeaker(rng)
    model.laws.append(cubic(0, 4e9 * rng.uniform(0.7, 1.4)))
    return model


def coupled_oscillators(rng):
    """Two oscillators that one potential couples."""
    f = rng.uniform(0.7, 1.4, 3)
    k = 0.3 * f[0]

    def law(u):  # the gradient of k x1**2 x2**2/2
        return (f"&law type='polynomial_coupled', dofs='x1', 'x2', coefficients={k * u.force(0, [0, 1, 1]):.17g}, "
                f"{k * u.force(1, [0, 0, 1]):.17g}, acts_on='x1', 'x2', displacement_exponents=1, 2, 2, 1 /")
    return Model(np.diag([1.0, 0.6 * f[1]]), np.diag([0.05, 0.04]), np.diag([1.0, 1.3 * f[2]]), [0.9],
                 [(0, (1,), 0.4), (1, (1,), 0.2)], [law, cubic(0, 0.2)], kind="energy")


def gyroscopic(rng):
    """A disc in two planes: coupled by rates alone, with opposite signs."""
    f = rng.uniform(0.7, 1.4, 3)
    g = 0.3 * f[0]
    return Model(np.eye(2), np.array([[0.05, g], [-g, 0.05]]), np.diag([1.0, 1.2 * f[1]]), [0.9], [(0, (1,), 0.4 * f[2])],
                 [cubic(0, 0.5), cubic(1, 0.3)])


def oscillator(rng):
    f = rng.uniform(0.7, 1.4, 2)
    k, c = chain(2, 1.0, 0.05)
    return Model(np.diag([1.0, 0.7 * f[0]]), c, k, [1.0], [], [van_der_pol(0, 0.4 * f[1], 0.6)],
                 rest="", kind="energy")


KINDS = {
    "loudspeaker": loudspeaker,
    "hydraulic mount": hydraulic,
    "harvester": harvester,
    "nodes without mass": springs,
    "nodes without mass, two tones": lambda rng: springs(rng, 2),
    "cubic": lambda rng: masses(rng, cubic(1, 0.4)),
    "cubic, two tones": lambda rng: masses(rng, cubic(1, 0.4), 2),
    "stop": lambda rng: masses(rng, stop(2, 20.0, 0.3)),
    "stop, two tones": lambda rng: masses(rng, stop(2, 5.0, 0.5), 2, load=0.3),
    "slider": lambda rng: masses(rng, slider(1, 2.0, 0.3)),
    "slider, two tones": lambda rng: masses(rng, slider(1, 2.0, 0.3), 2),
    "wall": lambda rng: masses(rng, wall(2, 0.6, 0.6), n=2 + 1),
    "gyroscopic": gyroscopic,
    "cubic springs": lambda rng: several(rng, ["cubic", "cubic", "cubic"]),
    "cubic springs, two tones": lambda rng: several(rng, ["cubic", "cubic"], 2),
    "stops": lambda rng: several(rng, ["stop", "stop"], load=0.4),
    "stops, two tones": lambda rng: several(rng, ["stop", "cubic"], 2, load=0.3),
    "sliders": lambda rng: several(rng, ["slider", "cubic", "slider", "cubic"]),
    "loudspeaker with a suspension": speaker_with_suspension,
    "coupled oscillators": coupled_oscillators,
}
