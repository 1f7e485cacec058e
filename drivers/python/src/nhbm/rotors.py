"""Rotors: round shafts with disks in bearings, by beam elements in two planes, with their terms in the speeds of the shafts.

Timoshenko's beam with rotary inertia and gyroscopic terms (Nelson, J. Mech. Design 102 (1980) 793), damping that turns with the
shaft (Genta, Dynamics of Rotating Systems, Springer 2005, chapter 6). The shafts lie along z: each node moves along x and y and has
the slopes dx/dz and dy/dz of its section."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from nhbm import advice
from nhbm.errors import Implausible, ModelError
from nhbm.structure import BY_SPEED, Structure
from nhbm.values import numbers_of

if TYPE_CHECKING:
    from nhbm.model import Model

VTK_LINE = 3
DIRECTIONS = ("x", "y", "xz", "yz")
N = len(DIRECTIONS)
_SPEEDS = 200  # at which critical speeds of bearings with tables are separated
_BESIDE = 1e-3  # of a shaft: as far from a node it is not there
_MATERIALS = {"young": (2e6, 1e13, "N/m2", "2.1e11"), "density": (50.0, 3e4, "kg/m3", "7850")}  # plausible values, unit, of steel
_LARGEST = {"diameter": 10.0, "length": 100.0}  # [m], of a shaft, plausible
_LARGEST_ECCENTRICITY = 0.01  # [m], of a whole rotor, likewise
_ROUNDED = 1.001  # of moments of inertia, whose digits were cut
ACROSS = np.array([[0.0, 1.0], [-1.0, 0.0]])  # i z = x' + i y' turned back: what -i Omega z does to (x, y)


@dataclass
class _Shaft:
    name: str
    speed: int  # number of the speed that it turns by
    z: np.ndarray  # of its nodes [m]
    first: int  # number of its first node in the rotor


@dataclass
class _Table:
    """A bearing with coefficients over speed and frequency, rows of k_xx, k_xy, k_yx, k_yy [N/m], and likewise damping [N s/m]."""

    name: str
    node: int
    speed: int  # number of the speed of its shaft
    speeds: np.ndarray | None  # [rad/s], (n_speeds)
    frequencies: np.ndarray | None  # of the whirl [rad/s], (n_frequencies)
    stiffness: np.ndarray  # (n_speeds, n_frequencies, 4), 1 where there is no axis
    damping: np.ndarray

    def at(self, name: str, speed: float, frequency: float) -> np.ndarray:
        """Stiffness or damping at a speed and a frequency, (4)."""
        values = getattr(self, name)
        for axis, x in ((self.speeds, speed), (self.frequencies, frequency)):
            flat = values.reshape(len(values), -1)
            values = (flat[0] if axis is None else _monotone_cubic(axis, flat, x)).reshape(values.shape[1:])
        return np.asarray(values)


class Rotor:
    """Circular shafts of one material on one axis, with disks, bearings and unbalance; `model` makes the model whose speed is that
    of its unbalance, `structure` the matrices alone.

    young: Young's modulus [N/m2]; density [kg/m3]; poisson: Poisson's ratio for the shear of the sections, None for none
    (Bernoulli)."""

    def __init__(self, young: float = 2.1e11, density: float = 7850.0, poisson: float | None = 0.3) -> None:
        for (name, (least, most, unit, steel)), given in zip(_MATERIALS.items(), (young, density)):
            value = _number(name, given)
            if not value > 0:
                raise ModelError(f"{name} must be above 0, not {given}")
            if not least <= value <= most:
                advice.warn(advice.on("implausible_material", name, str(given), unit, steel).text, Implausible)
        if poisson is not None and not -1 < _number("poisson", poisson) <= 0.5:
            raise ModelError(f"poisson must be above -1 and at most 0.5, not {poisson}")
        self.young, self.density, self.poisson = young, density, poisson
        self._shafts: list[_Shaft] = []
        self._sets: dict[str, int] = {}
        self._unbalance: dict[str, list[tuple[int, float, float]]] = {}
        self._tables: list[_Table] = []
        self._parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}  # matrices by name: degrees of freedom, values

    def __repr__(self) -> str:
        shafts = [f"{shaft.name} with {len(shaft.z)} nodes" for shaft in self._shafts]
        return f"<nhbm.Rotor: {'; '.join([', '.join(shafts) or 'no shaft', *([', '.join(self._sets)] if self._sets else [])])}>"

    @property
    def n_nodes(self) -> int:
        """Number of nodes of all shafts."""
        return sum(len(shaft.z) for shaft in self._shafts)

    def shaft(self, z: Any, diameter: Any, bore: float = 0.0, *, name: str = "shaft", speed: int = 1, damping: float = 0.0) -> None:
        """Adds a shaft. z: ascending positions of its nodes [m]; diameter, bore: outer and inner diameter [m], one value or
        one for each element; name: for the other methods; speed: 1 or 2, number of its speed; damping: viscous rotating
        damping of the material, as a factor of the stiffness [s]."""
        z = np.array(numbers_of(f"shaft '{name}': z", z))
        if not _number(f"shaft '{name}': damping", damping) >= 0:
            raise ModelError(f"shaft '{name}': damping must be 0 or more, not {damping}")
        if len(z) < 2 or not (np.diff(z) > 0).all():
            raise ModelError(f"shaft '{name}': z must be two or more rising positions")
        if any(shaft.name == name for shaft in self._shafts):
            raise ModelError(f"there is a shaft '{name}' already; give another name")
        if speed not in (1, 2):
            raise ModelError(f"shaft '{name}': speed is 1 or 2, the number of a speed, not {speed}")
        outer, inner = (_along(f"shaft '{name}': {word}", d, len(z) - 1) for word, d in (("diameter", diameter), ("bore", bore)))
        if not ((outer > inner).all() and (inner >= 0).all()):
            raise ModelError(f"shaft '{name}': the diameter must be above the bore, and this 0 or more")
        for word, size in (("diameter", outer.max()), ("length", np.ptp(z))):
            if size > _LARGEST[word]:
                advice.warn(advice.on("large_length", f"shaft '{name}'", word, f"{size:g}").text, Implausible)
        new = _Shaft(name, speed, z, self.n_nodes)
        for e, h in enumerate(np.diff(z)):
            stiffness, mass, rotary = self._element(h, outer[e], inner[e])
            nodes = new.first + e, new.first + e + 1
            self._add("stiffness", nodes, np.eye(2), stiffness)
            self._add("mass", nodes, np.eye(2), mass + rotary)
            self._add(_by_speed("gyroscopic_by_speed", speed), nodes, ACROSS, 2 * rotary)
            if damping:
                self._add("damping", nodes, np.eye(2), damping * stiffness)
                self._add(_by_speed("stiffness_by_speed", speed), nodes, ACROSS, damping * stiffness)
        self._shafts.append(new)

    def disk(self, z: float, mass: float, diametral: float, polar: float, *, shaft: str | None = None) -> None:
        """Adds a rigid disk at the node nearest to z [m]: its mass [kg], diametral and polar moment of inertia [kg m2]; set
        `disk1`, ..."""
        found, node = self._node(z, shaft)
        for name, value in (("mass", mass), ("diametral", diametral), ("polar", polar)):
            if not _number(f"disk at {z}: {name}", value) >= 0:
                raise ModelError(f"disk at {z}: {name} must be 0 or more, not {value}")
        if polar > _ROUNDED * 2 * diametral > 0:
            raise ModelError(f"disk at {z}: polar moment of inertia, {polar}, is more than twice the diametral one, {diametral}; "
                             "no rigid body has it; the order is mass, diametral, polar")  # fmt: skip
        self._add("mass", (node,), np.eye(2), np.diag([mass, diametral]))
        self._add(_by_speed("gyroscopic_by_speed", found.speed), (node,), ACROSS, np.diag([0.0, polar]))
        self._sets[self._next("disk")] = node

    def bearing(self, z: float, stiffness: Any, damping: Any = 0.0, *, speeds: Any = None, frequencies: Any = None,
                shaft: str | None = None) -> None:  # fmt: skip
        """Supports the node nearest to z [m]: stiffness [N/m] and damping [N s/m], one number or a matrix over x and y, or for
        each of `speeds` [rad/s], or of `frequencies` of the whirl [rad/s], or for each of both, a number, such a matrix, or k_xx,
        k_xy, k_yx, k_yy, between which monotone cubics interpolate (docs/user/input.md, &bearing); set `bearing1`, ..."""
        found, node = self._node(z, shaft)
        if speeds is not None or frequencies is not None:
            of = f"bearing at {z:g} m: "
            axes = _axis(of + "speeds", speeds), _axis(of + "frequencies", frequencies)
            tables = [_rows(of + word, values, axes) for word, values in (("stiffness", stiffness), ("damping", damping))]
            name = self._next("bearing")
            self._tables.append(_Table(name, node, found.speed, axes[0], axes[1], tables[0], tables[1]))
            self._sets[name] = node
            return
        for name, values in (("stiffness", stiffness), ("damping", damping)):
            if (np.diagonal(_two(values)) < 0).any():
                advice.warn(advice.on("negative_bearing", f"{z:g}", name, str(np.asarray(values).tolist())).text, Implausible)
            self._add(name, (node,), _two(values), np.diag([1.0, 0.0]))
        self._sets[self._next("bearing")] = node

    def between(self, z: float, one: str, other: str, stiffness: Any, damping: float = 0.0) -> None:
        """Connects two shafts at z [m] by a bearing, like `bearing`; sets `inner1` and `outer1`, ... for contact laws
        (stiffness may be 0)."""
        nodes = self._node(z, one)[1], self._node(z, other)[1]
        joint = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.diag([1.0, 0.0]))
        for name, values in (("stiffness", stiffness), ("damping", damping)):
            self._add(name, nodes, _two(values), joint)
        for word, node in zip(("inner", "outer"), nodes):
            self._sets[self._next(word)] = node

    def unbalance(self, z: float, amount: float, angle: float = 0.0, *, shaft: str | None = None) -> None:
        """Adds mass times eccentricity [kg m] at z [m] and an angle [rad]; load vectors `unbalance_NAME_cos` and `..._sin` of
        the shaft, for &load with frequency_power = 2 and the tuple of the shaft's tone."""
        found, node = self._node(z, shaft)
        amount, angle = _number(f"unbalance at {z}: amount", amount), _number(f"unbalance at {z}: angle", angle)
        if abs(angle) > 2 * np.pi:
            advice.warn(advice.on("phase_in_degrees", f"unbalance at {z:g} m: angle", values=[angle]).text, Implausible)
        self._unbalance.setdefault(found.name, []).append((node, amount, angle))

    def model(self, speed: float, ratio: float = 1.0, **groups: Any) -> Model:
        """The model in which the unbalance of each shaft turns with it: tone 1 is the speed of shafts of speed 1 [rad/s], and
        tone 2,
        for shafts of speed 2, `ratio` times that; the speeds of structure and bearings follow the tones, also along curves and
        sweeps. groups: of `nhbm.Model`, such as ``harmonics={"order": 5}``."""
        from nhbm.model import Model

        n_speeds = max([shaft.speed for shaft in self._shafts], default=1)
        tones = [_number("speed", speed), _number("ratio", ratio) * speed][:n_speeds]
        made = Model(self._matrices(), tones=tones, **groups)
        made.set("structure", speed=tones)
        for k in range(n_speeds):
            made.tie(f"structure.speed[{k}]", f"tones[{k}]")
        for table in self._tables:
            dofs = [f"n{table.node + 1}.{direction}" for direction in ("x", "y")]
            at = {} if table.speeds is None else {"speed": tones[table.speed - 1]}
            made.bearing(dofs, table.speeds, table.stiffness, table.damping, frequencies=table.frequencies, label=table.name, **at)
            if at:
                made.tie(f"bearing({table.name})%speed", f"tones[{table.speed - 1}]")
        for shaft in self._shafts:
            if shaft.name in self._unbalance:
                self._doubt_the_unbalance(shaft.name)
                tuple_ = [int(k == shaft.speed - 1) for k in range(n_speeds)]
                for part in ("cos", "sin"):
                    unit: dict[str, Any] = {part: 1.0}
                    made.load(vector=f"unbalance_{shaft.name}_{part}", tuple_=tuple_, frequency_power=2, **unit)
        return made

    def _doubt_the_unbalance(self, shaft: str) -> None:
        """Warns of an unbalance that moves the centre of mass of all shafts and disks far off the axis."""
        amount = abs(sum(size * np.exp(1j * angle) for _, size, angle in self._unbalance[shaft]))
        mass = sum(float(block[np.ix_(dofs % N == 0, dofs % N == 0)].sum()) for dofs, block in self._parts["mass"])
        if amount > _LARGEST_ECCENTRICITY * mass:
            words = f"unbalance of {amount:g} kg m of shaft '{shaft}'", "eccentricity of the rotor", f"{amount / mass:.2g}"
            advice.warn(advice.on("large_length", *words).text, Implausible)

    def structure(self) -> Structure:
        """The matrices, with speed-dependent terms for the key `speed` of &structure and &tie."""
        if self._tables:
            raise ModelError(f"'{self._tables[0].name}' has coefficients over the speed, which are no matrices: "
                             "rotor.model(speed=...) makes a model with them")  # fmt: skip
        return self._matrices()

    def _matrices(self) -> Structure:
        """The matrices without bearings that have tables."""
        n = self.n_nodes
        if n == 0:
            raise ModelError("the rotor has no shaft")
        matrices = {}
        for name, parts in self._parts.items():
            rows, columns, values = [], [], []
            for dofs, block in parts:
                rows.append(np.repeat(dofs, len(dofs)))
                columns.append(np.tile(dofs, len(dofs)))
                values.append(block.ravel())
            shape = (N * n, N * n)
            matrix = sp.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape)
            matrix.eliminate_zeros()
            if matrix.nnz:
                matrices[name] = matrix
        loads = {}
        for name, masses in self._unbalance.items():
            dofs = np.array([N * node + plane for node, _, _ in masses for plane in (0, 1)])
            turned = np.concatenate([[amount * np.cos(angle), amount * np.sin(angle)] for _, amount, angle in masses])
            loads[f"unbalance_{name}_cos"] = dofs, turned
            loads[f"unbalance_{name}_sin"] = dofs, np.concatenate([[-b, a] for a, b in turned.reshape(-1, 2)])
        ends = [shaft.first + np.arange(len(shaft.z)) for shaft in self._shafts]
        lines = np.concatenate([np.column_stack([nodes[:-1], nodes[1:]]) for nodes in ends])
        z = np.concatenate([shaft.z for shaft in self._shafts])
        return Structure(
            **matrices,
            labels=[f"n{node + 1}.{d}" for node in range(n) for d in DIRECTIONS],
            units=["m", "m", "rad", "rad"] * n,
            node_numbers=np.arange(1, n + 1),
            coordinates=np.column_stack([np.zeros((n, 2)), z]),
            dof_node=np.repeat(np.arange(n), N),
            dof_direction=list(DIRECTIONS) * n,
            cell_types=np.full(len(lines), VTK_LINE),
            cell_starts=2 * np.arange(len(lines) + 1),
            cell_nodes=lines.ravel(),
            sets={name: np.array([node]) for name, node in self._sets.items()},
            loads=loads,
            source=f"rotor, {len(lines)} elements",
        )

    def campbell(self, speeds: Any, ratio: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Whirl frequencies [rad/s], ascending, and growth rates [1/s] of the linear rotor over its speed, each (n_speeds, n_dofs).

        speeds: values of speed 1 [rad/s]; ratio: speed 2 over speed 1.
        """
        structure, ratio = self._matrices(), _number("ratio", ratio)
        for table in self._tables:
            if table.frequencies is not None:
                raise ModelError(f"'{table.name}' has coefficients over the frequency of each whirl: there is no Campbell "
                                 "diagram; critical_speeds and rotor.model(speed=...) use them")  # fmt: skip
        found = [whirls(self._at_speed(structure, speed, ratio)) for speed in numbers_of("speeds", speeds)]
        return np.array([f for f, _ in found]), np.array([g for _, g in found])

    def critical_speeds(self, up_to: float, ratio: float = 1.0, order: float = 1.0) -> np.ndarray:
        """Values of speed 1 [rad/s], up to a limit, at which a whirl frequency of the undamped rotor is `order` times the
        speed: forward whirl excited by the unbalance of its shafts (order 1); `order = ratio` for the unbalance of the
        other shaft, negative orders for backward whirl. Where bearings differ in x and y, each whirl has parts of both
        directions: all of them are returned, whatever the sign of the order.

        Source: K u = W**2 (order**2 M - i order G) u, G the gyroscopic matrix of all shafts at W = 1, for whirl u exp(i order W t);
        for equal bearings (x, y) = (1, -i) u of circular whirl. Bearings whose stiffness is not symmetric, as of oil films, feed or
        damp whirls: then a whirl frequency of the damped rotor (`campbell`) is |order| times the speed. Motions R of a rotor as a
        rigid
        body, which its bearings do not hold, are left out: R**T K = 0 requires R**T (order**2 M - i order G) u = 0 of others."""
        ratio, order = _number("ratio", ratio), _number("order", order)
        if not _number("up_to", up_to) > 0:
            raise ModelError(f"up_to must be above 0, not {up_to!r}")
        structure = self._matrices()
        if not self._is_symmetric(structure):
            return self._damped_critical(structure, up_to, ratio, abs(order))
        if not self._tables:
            return self._critical(structure, up_to, ratio, order)

        from scipy.optimize import brentq

        # Of bearings with tables: the speeds that are critical ones of the rotor with the bearings at that speed.
        def excess(speed: float, k: int) -> float:
            found = self._critical(self._with_bearings(structure, speed, ratio, order * speed), 2.0 * up_to, ratio, order)
            return float(found[k] - speed) if k < len(found) else up_to

        grid = np.linspace(up_to / _SPEEDS, up_to, _SPEEDS)
        at = [self._with_bearings(structure, speed, ratio, order * speed) for speed in grid]
        most = max(len(self._critical(one, 2.0 * up_to, ratio, order)) for one in at)
        roots = []
        for k in range(most):
            values = [excess(speed, k) for speed in grid]
            for low, high, a, b in zip(grid, grid[1:], values, values[1:]):
                if a >= 0 > b or a < 0 <= b:
                    roots.append(float(brentq(excess, low, high, args=(k,), xtol=1e-10 * up_to)))
        return np.sort(roots)

    def _is_symmetric(self, structure: Structure) -> bool:
        """Whether the stiffness of all bearings is symmetric, at all speeds of their tables."""
        k = structure.stiffness.toarray()
        tables = [(t.stiffness[..., 1], t.stiffness[..., 2]) for t in self._tables]
        return all(np.allclose(a, b, rtol=1e-9, atol=1e-9 * abs(k).max()) for a, b in [(k, k.T), *tables])

    def _damped_critical(self, structure: Structure, up_to: float, ratio: float, order: float) -> np.ndarray:
        """Speeds at which a whirl frequency of the damped rotor is `order` times the speed."""
        from scipy.optimize import brentq

        def excess(speed: float) -> np.ndarray:
            return np.asarray(whirls(self._at_speed(structure, speed, ratio, order * speed))[0] - order * speed)

        grid = np.linspace(up_to / _SPEEDS, up_to, _SPEEDS)
        values = np.array([excess(speed) for speed in grid])
        found = [brentq(lambda speed, k=k: excess(speed)[k], grid[i], grid[i + 1], xtol=1e-10 * up_to)
                 for i, k in np.argwhere((values[:-1] >= 0) != (values[1:] >= 0))]  # fmt: skip
        return np.sort(found)

    def _with_bearings(self, structure: Structure, speed: float, ratio: float, whirl: float) -> Structure:
        """The structure with the coefficients of bearings with tables at a value of speed 1 and a frequency of the whirl."""
        n, added = structure.n_dofs, {"stiffness": [structure.stiffness], "damping": [structure.damping]}
        for table in self._tables:
            at = speed if table.speed == 1 else ratio * speed
            rows = N * table.node + np.array([0, 0, 1, 1])
            columns = N * table.node + np.array([0, 1, 0, 1])
            for name in added:
                values = table.at(name, at, abs(whirl))
                added[name].append(sp.csr_matrix((values, (rows, columns)), (n, n)))
        total = {name: sum(m[1:], m[0]) for name, parts in added.items() if (m := [one for one in parts if one is not None])}
        return replace(structure, **total)

    def _at_speed(self, structure: Structure, speed: float, ratio: float, whirl: float = 0.0) -> Structure:
        """The structure at a value of speed 1, its bearings at a frequency of the whirl."""
        return at_speeds(self._with_bearings(structure, speed, ratio, whirl), (speed, ratio * speed))

    def _critical(self, s: Structure, up_to: float, ratio: float, order: float) -> np.ndarray:
        """The critical speeds of the rotor with constant bearings."""
        k, m = s.stiffness.toarray(), s.mass.toarray()
        g = np.zeros_like(k)
        for part, factor in ((s.gyroscopic_by_speed, 1.0), (s.gyroscopic_by_speed_2, ratio)):
            if part is not None:
                g += factor * part.toarray()
        x, y = (np.arange(s.n_dofs)[plane::2] for plane in (0, 1))  # x and xz, y and yz of all nodes
        whole, inertia = k, order**2 * m - 1j * order * g
        tolerance = 1e-9 * abs(k).max()
        if np.allclose(k[np.ix_(x, x)], k[np.ix_(y, y)], rtol=1e-9, atol=tolerance) and abs(k[np.ix_(x, y)]).max() <= tolerance:
            whole, inertia = k[np.ix_(x, x)], order**2 * m[np.ix_(x, x)] - order * g[np.ix_(x, y)]
        free = self._free_motions(whole)
        if free.shape[1]:
            others = scipy.linalg.null_space(free.T @ inertia)
            whole, inertia = (others.conj().T @ matrix @ others for matrix in (whole, inertia))
        values = scipy.linalg.eigvals(inertia, whole)
        real = values.real[(abs(values.imag) <= 1e-9 * abs(values).max()) & (values.real > 0)]
        return np.sort(1.0 / np.sqrt(real[real >= 1.0 / up_to**2]))

    def _free_motions(self, stiffness: np.ndarray) -> np.ndarray:
        """Motions of the shafts as rigid bodies without forces, one a column; `stiffness` is that of one plane or of both."""
        n = 2 * self.n_nodes
        rigid: Any = np.zeros((n, 2 * len(self._shafts)))
        for i, shaft in enumerate(self._shafts):
            rows, half = 2 * shaft.first + 2 * np.arange(len(shaft.z)), (shaft.z[-1] - shaft.z[0]) / 2
            rigid[rows, 2 * i] = 1.0
            rigid[rows, 2 * i + 1] = (shaft.z - shaft.z.mean()) / half
            rigid[rows + 1, 2 * i + 1] = 1.0 / half
        if len(stiffness) > n:  # both planes: (x, y) of all deflections and slopes
            rigid = np.kron(rigid, np.eye(2))
        forces, motions = np.linalg.eigh(rigid.T @ stiffness @ rigid)
        free: np.ndarray = rigid @ motions[:, forces < len(stiffness) * np.finfo(float).eps * abs(stiffness).max()]
        return free

    def _element(self, h: float, outer: float, inner: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness, translational and rotary mass of one element in one plane; the polar inertia is twice the rotary mass."""
        area, second = np.pi * (outer**2 - inner**2) / 4, np.pi * (outer**4 - inner**4) / 64
        p = 0.0
        if self.poisson is not None:
            shear = self.young / (2 * (1 + self.poisson))
            p = 12 * self.young * second / (_shear_coefficient(self.poisson, inner / outer) * shear * area * h**2)
        stiffness = self.young * second / (h**3 * (1 + p)) * _matrix(h, 12, 6, 4 + p, -12, 6, 2 - p)
        mass = self.density * area * h / (1 + p) ** 2 * _matrix(
            h, 13 / 35 + 7 * p / 10 + p**2 / 3, 11 / 210 + 11 * p / 120 + p**2 / 24, 1 / 105 + p / 60 + p**2 / 120,
            9 / 70 + 3 * p / 10 + p**2 / 6, -(13 / 420 + 3 * p / 40 + p**2 / 24), -(1 / 140 + p / 60 + p**2 / 120),
        )  # fmt: skip
        rotary = (
            self.density
            * second
            / (h * (1 + p) ** 2)
            * _matrix(h, 6 / 5, 1 / 10 - p / 2, 2 / 15 + p / 6 + p**2 / 3, -6 / 5, 1 / 10 - p / 2, -1 / 30 - p / 6 + p**2 / 6)
        )
        return stiffness, mass, rotary

    def _add(self, name: str, nodes: Any, across: np.ndarray, plane: np.ndarray) -> None:
        """Adds kron(across, plane): `across` over x and y, `plane` over deflection and slope of the nodes."""
        dofs = np.concatenate([[N * node + direction, N * node + 2 + direction] for direction in (0, 1) for node in nodes])
        self._parts.setdefault(name, []).append((dofs, np.kron(across, plane)))

    def _node(self, z: float, name: str | None) -> tuple[_Shaft, int]:
        known = [shaft.name for shaft in self._shafts]
        if name is None and len(known) == 1:
            name = known[0]
        if name not in known:
            raise ModelError(f"choose a shaft: shaft='{name}' is none of {', '.join(known) or 'none'}")
        shaft = self._shafts[known.index(name)]
        z = _number("z", z)
        if not shaft.z[0] <= z <= shaft.z[-1]:
            raise ModelError(f"a disk or bearing at {z} is not on the shaft, {shaft.z[0]} to {shaft.z[-1]}")
        nearest = int(np.argmin(np.abs(shaft.z - z)))
        there = float(shaft.z[nearest])
        if abs(there - z) > _BESIDE * (shaft.z[-1] - shaft.z[0]):
            advice.warn(advice.on("no_node_there", f"{z:g}", f"{there:g}").text, Implausible)
        return shaft, shaft.first + nearest

    def _next(self, word: str) -> str:
        return f"{word}{1 + sum(name.startswith(word) for name in self._sets)}"


def rotor(
    length: Any,
    diameter: Any,
    n_elements: Any,
    disks: Any = (),
    bearings: Any = (),
    speed: Any = None,
    young: float = 2.1e11,
    density: float = 7850.0,
) -> Structure:
    """One even shaft [m] without shear; sets `disk1`, `bearing1`, ...

    `disks`: position [m], mass [kg], diametral and polar moment of inertia [kg m2]; `bearings`: position, stiffness [N/m] and
    damping [N s/m], the same in all directions; `speed` [rad/s] from x towards y, None to keep the terms in the speed as such.
    """
    for name, value in (("length", length), ("diameter", diameter), ("n_elements", n_elements)):
        if not _number(name, value) > 0:
            raise ModelError(f"{name} must be above 0, not {value}")
    made = Rotor(young, density, poisson=None)
    made.shaft(np.linspace(0.0, length, int(n_elements) + 1), diameter)
    for disk in disks:
        made.disk(*disk)
    for bearing in bearings:
        made.bearing(*bearing)
    structure = made.structure()
    return structure if speed is None else at_speeds(structure, (speed, 0.0))


def at_speeds(structure: Structure, speeds: Any) -> Structure:
    """The structure with its terms in speeds at these speeds [rad/s]: no term in a speed is left."""
    added: dict[str, list[Any]] = {"gyroscopic": [structure.gyroscopic], "stiffness": [structure.stiffness]}
    for suffix, speed in zip(("", "_2"), speeds):
        for kind, name, factor in (
            ("gyroscopic", "gyroscopic_by_speed", speed),
            ("stiffness", "stiffness_by_speed", speed),
            ("stiffness", "stiffness_by_speed_squared", speed**2),
        ):
            matrix = getattr(structure, name + suffix)
            if matrix is not None and factor:
                added[kind].append(factor * matrix)
    total = {kind: [m for m in matrices if m is not None] for kind, matrices in added.items()}
    at_speed: dict[str, Any] = {kind: sum(m[1:], m[0]) if m else None for kind, m in total.items()}
    return replace(structure, **dict.fromkeys(BY_SPEED), **at_speed)  # type: ignore[arg-type]


def whirls(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies >= 0 [rad/s], rising, and growth rates [1/s] of a small linear structure, each (n_dofs)."""
    n = structure.n_dofs
    none, one, mass = np.zeros((n, n)), np.eye(n), structure.mass.toarray()
    rates = sum((m.toarray() for m in (structure.damping, structure.gyroscopic) if m is not None), none)
    forces = np.hstack([structure.stiffness.toarray(), rates])
    try:  # the standard problem is balanced by LAPACK, the generalised one is not: stiff bearings cost its lowest values digits
        states = np.vstack([np.hstack([none, one]), -scipy.linalg.cho_solve(scipy.linalg.cho_factor(mass), forces)])
        values = scipy.linalg.eigvals(states)
    except np.linalg.LinAlgError:  # coordinates without mass
        values = scipy.linalg.eigvals(np.vstack([np.hstack([none, one]), -forces]), scipy.linalg.block_diag(one, mass))
    values = values[np.lexsort((values.real, abs(values.imag)))][::2]  # one of each pair
    return abs(values.imag), values.real


def _axis(name: str, values: Any) -> np.ndarray | None:
    """Ascending values of a table, or None."""
    if values is None:
        return None
    at = np.array(numbers_of(name, values))
    if len(at) < 2 or not (np.diff(at) > 0).all():
        raise ModelError(f"{name} must be two or more ascending numbers")
    return at


def _rows(name: str, values: Any, axes: tuple[np.ndarray | None, np.ndarray | None]) -> np.ndarray:
    """Coefficients of a bearing for each speed and frequency, (n_speeds, n_frequencies, 4), from numbers, matrices over x and y, or
    rows of four."""
    numbers = np.reshape(numbers_of(name, values), np.shape(values))
    n = tuple(len(axis) for axis in axes if axis is not None)
    shape = tuple(1 if axis is None else len(axis) for axis in axes)
    if numbers.ndim == 0 or numbers.shape == n:  # the same in all directions
        return np.multiply.outer(np.broadcast_to(numbers, n), [1.0, 0.0, 0.0, 1.0]).reshape(*shape, 4)
    if numbers.shape not in ((*n, 4), (*n, 2, 2)):
        of = " of ".join(f"{len(axis)} {word}" for axis, word in zip(axes[::-1], ("frequencies", "speeds")) if axis is not None)
        raise ModelError(f"{name} needs for each of {of} a number, a matrix of 2 x 2 or four numbers, not {numbers.shape}")
    return numbers.reshape(*shape, 4)


def _monotone_cubic(nodes: np.ndarray, values: np.ndarray, x: float) -> np.ndarray:
    """Values at x of the cubics through the columns of a table, constant beyond it: those of the solver (F. N. Fritsch and
    R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246)."""
    x = float(np.clip(x, nodes[0], nodes[-1]))
    widths = np.diff(nodes)
    secants = np.diff(values, axis=0) / widths[:, None]
    slopes = np.concatenate([secants[:1], np.zeros_like(values[1:-1]), secants[-1:]])
    mean = (widths[1:, None] * secants[:-1] + widths[:-1, None] * secants[1:]) / (widths[:-1] + widths[1:])[:, None]
    slopes[1:-1] = np.where(secants[:-1] * secants[1:] > 0, mean, 0.0)
    for i, secant in enumerate(secants):
        size = np.hypot(slopes[i], slopes[i + 1])
        factor = np.where(secant == 0, 0.0, np.minimum(1.0, 3.0 * abs(secant) / np.where(size > 0, size, 1.0)))
        slopes[i] *= factor
        slopes[i + 1] *= factor
    i = min(int(np.searchsorted(nodes, x, side="right")) - 1, len(widths) - 1)
    h, t = widths[i], (x - nodes[i]) / widths[i]
    weights = (1 + 2 * t) * (1 - t) ** 2, t**2 * (3 - 2 * t), h * t * (1 - t) ** 2, -h * t**2 * (1 - t)
    result: np.ndarray = sum(w * a for w, a in zip(weights, (values[i], values[i + 1], slopes[i], slopes[i + 1])))
    return result


def _matrix(h: Any, deflection: Any, both: Any, slope: Any, far_deflection: Any, far_both: Any, far_slope: Any) -> np.ndarray:
    """Matrix of a beam element between deflection and slope of both ends, from the numbers that make it up."""
    near = np.array([[deflection, both * h], [both * h, slope * h**2]])
    other = np.array([[deflection, -both * h], [-both * h, slope * h**2]])
    far = np.array([[far_deflection, far_both * h], [-far_both * h, far_slope * h**2]])
    return np.block([[near, far], [far.T, other]])


def _shear_coefficient(poisson: float, bore: float) -> float:
    """Shear coefficient of a circular section, with the bore relative to the outer diameter (G. R. Cowper, J. Appl. Mech. 33 (1966)
    335-340)."""
    wall = (1 + bore**2) ** 2
    return 6 * (1 + poisson) * wall / ((7 + 6 * poisson) * wall + (20 + 12 * poisson) * bore**2)


def _number(name: str, value: Any) -> float:
    """One finite number; ModelError, which names the argument, for anything else."""
    numbers = numbers_of(name, value)
    if np.ndim(value):
        raise ModelError(f"{name} must be one number, not {value!r}")
    return float(numbers[0])


def _along(name: str, values: Any, n: int) -> np.ndarray:
    """A number for each of n elements, from one or from a list of as many."""
    numbers = np.array(numbers_of(name, values))
    if len(numbers) not in (1, n):
        raise ModelError(f"{name} has {len(numbers)} values; it needs one, or one for each of {n} elements")
    return np.broadcast_to(numbers, n)


def _two(values: Any) -> np.ndarray:
    values = np.reshape(numbers_of("stiffness and damping of a bearing", values), np.shape(values))
    if values.ndim == 0:
        return float(values) * np.eye(2)
    if values.shape != (2, 2):
        raise ModelError(f"stiffness and damping of a bearing are one number or a matrix of 2 x 2, not of {values.shape}")
    return values


def _by_speed(name: str, speed: int) -> str:
    return name if speed == 1 else f"{name}_{speed}"
