"""Keys of laws and structures with their types, for completion and static checks. Written by tests/keys; not to be edited."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Union, overload

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import numpy as np
    from typing_extensions import Required, TypedDict, Unpack

    from nhbm.laws import Law

    Array = np.ndarray[Any, Any]
    Reals = Union[float, Sequence[float], Sequence[Sequence[float]], Array]
    Integers = Union[int, Sequence[int], Array]
    Logicals = Union[bool, Sequence[bool], Array]
    Texts = Union[str, Sequence[str]]
    Dofs = Union[str, Iterable[str], None]

    class AnyLawKeys(TypedDict, total=False):
        """Keys that all of `&law` have."""

        label: str
        weights: Reals

    class AnnularClearanceLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'annular_clearance'`."""

        stiffness: Required[float]
        clearance: Required[float]
        friction_coefficient: float
        spin: Literal["positive", "negative"]
        rotor_radius: float
        rotor_speed: float
        slip_velocity: float
        center: Reals

    class BladeContactLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'blade_contact'`."""

        n_diameters: Required[int]
        n_blades: Required[int]
        gaps: Required[Reals]
        stiffness: Reals
        contact: Literal["elastic", "rigid"]
        augmentation: float
        shares: Reals
        friction_coefficient: Reals
        friction_arms: Reals
        frame: Literal["rotating", "stationary", "own"]
        tone: int

    class BoucWenLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'bouc_wen'`."""

        stiffness: Required[float]
        post_yield_ratio: float
        yield_displacement: Required[float]
        exponent: float
        beta: float

    class ContactTableLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'contact_table'`."""

        n_contacts: Required[int]
        shapes: Required[Reals]
        gaps: Required[Reals]
        stiffness: Reals
        contact: Literal["elastic", "rigid"]
        augmentation: float
        friction_coefficient: Reals
        friction_shapes: Reals
        tone: int
        turns: Integers

    class CoulombRigidLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'coulomb_rigid'`."""

        limit: Required[float]
        augmentation: float

    class CoulombTanhLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'coulomb_tanh'`."""

        limit: Required[float]
        velocity: Required[float]

    class CubicDampingLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'cubic_damping'`."""

        coefficient: Required[float]
        speed: float
        n_diameters: int

    class CubicSpringLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'cubic_spring'`."""

        stiffness: Required[float]

    class ElasticStopLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'elastic_stop'`."""

        stiffness: Required[float]
        gap: Required[float]
        two_sided: bool

    class ElectrostaticLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'electrostatic'`."""

        coefficient: Required[float]
        gap: Required[float]
        voltage: float
        tuple: Integers
        voltage_cos: Reals
        voltage_sin: Reals

    class HertzLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'hertz'`."""

        stiffness: Required[float]
        exponent: float
        gap: Required[float]
        dissipation: float

    class IwanLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'iwan'`."""

        stiffness: Required[Reals]
        limit: Required[Reals]

    class JenkinsLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'jenkins'`."""

        stiffness: Required[float]
        limit: float
        friction_coefficient: float
        normal_stiffness: float
        preload: float
        normal_dofs: Texts
        normal_weights: Reals

    class Jenkins2dLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'jenkins_2d'`."""

        stiffness: Required[float]
        limit: float
        second_dofs: Required[Texts]
        second_weights: Reals
        friction_coefficient: float
        normal_stiffness: float
        preload: float
        normal_dofs: Texts
        normal_weights: Reals

    class ParametricLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'parametric'`."""

        tuple: Required[Integers]
        stiffness_cos: float
        stiffness_sin: float
        cubic_cos: float
        cubic_sin: float
        damping_cos: float
        damping_sin: float
        backlash: float

    class PiecewiseLinearLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'piecewise_linear'`."""

        breakpoints: Required[Reals]
        slopes: Required[Reals]
        force_at_zero: float

    class PolynomialLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'polynomial'`."""

        stiffness: Reals
        damping: Reals

    class PolynomialCoupledLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'polynomial_coupled'`."""

        file: str
        coefficients: Reals
        acts_on: Texts
        displacement_exponents: Integers
        velocity_exponents: Integers

    class QuadraticDampingLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'quadratic_damping'`."""

        coefficient: Required[float]

    class RigidWallLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'rigid_wall'`."""

        gap: Required[float]
        augmentation: float
        two_sided: bool
        restitution: float

    class RollingBearingLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'rolling_bearing'`."""

        n_balls: Required[int]
        stiffness: Required[float]
        exponent: float
        clearance: float
        tuple: Required[Integers]
        second_dofs: Required[Texts]
        second_weights: Reals

    class ShortBearingLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'short_bearing'`."""

        viscosity: Required[float]
        radius: Required[float]
        length: Required[float]
        clearance: Required[float]
        rotor_speed: float
        film: Literal["half", "full"]
        second_dofs: Required[Texts]
        second_weights: Reals

    class StribeckLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'stribeck'`."""

        limit: Required[float]
        static_limit: Required[float]
        stribeck_velocity: Required[float]
        velocity: Required[float]
        belt_velocity: float

    class TabulatedLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'tabulated'`."""

        displacements: Required[Reals]
        forces: Required[Reals]
        beyond: Literal["linear", "constant"]

    class UserLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'user'`."""

        library: Required[str]
        name: Required[str]
        parameters: Reals
        odd: bool

    class VanDerPolLaw(AnyLawKeys, total=False):
        """Keys of `&law type = 'van_der_pol'`."""

        strength: Required[float]
        threshold: float

    class AnyStructureKeys(TypedDict, total=False):
        """Keys that all of `&structure` have."""

        damping_diagonal: float
        damping_mass: float
        damping_stiffness: float

    class BeamKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'beam'`."""

        length: Required[float]
        bending_stiffness: Required[float]
        mass_per_length: Required[float]
        n_elements: Required[int]
        left_support: Literal["pinned", "clamped", "free", "guided"]
        right_support: Literal["pinned", "clamped", "free", "guided"]

    class ChainKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'chain'`."""

        n_masses: Required[int]
        ends: Literal["fixed", "free", "fixed-free"]
        mass: Required[Reals]
        coupling_stiffness: Required[Reals]
        ground_stiffness: Reals

    class JeffcottKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'jeffcott'`."""

        mass: Required[float]
        stiffness: Required[float]
        damping: float
        rotating_damping: float
        speed: float
        diametral_inertia: float
        polar_inertia: float
        tilt_stiffness: float
        tilt_damping: float
        coupling_stiffness: float
        ring_mass: float
        ring_stiffness: float
        ring_damping: float

    class MatricesKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'matrices'`."""

        n_dofs: Required[int]
        mass: Required[Reals]
        damping: Reals
        gyroscopic: Reals
        stiffness: Required[Reals]
        speed: float
        gyroscopic_by_speed: Reals
        stiffness_by_speed: Reals
        stiffness_by_speed_squared: Reals
        labels: Texts
        units: Texts

    class ModalBeamKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'modal_beam'`."""

        length: Required[float]
        bending_stiffness: Required[float]
        mass_per_length: Required[float]
        n_modes: Required[int]

    class ModelKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'model'`."""

        file: Required[str]
        structural_frequency: float
        speed: Reals

    class RotorStatorKeys(AnyStructureKeys, total=False):
        """Keys of `&structure type = 'rotor_stator'`."""

        n_diameters: Required[int]
        speed: Required[float]
        frame: Literal["rotating", "stationary", "own"]
        disk_frequency: Required[float]
        casing_frequency: Required[float]
        disk_mass: float
        casing_mass: float
        disk_damping_ratio: float
        casing_damping_ratio: float


class Laws:
    """The method `law` of a model with the keys of each law."""

    if TYPE_CHECKING:

        @overload
        def law(self, kind: Literal["annular_clearance"], dof: Dofs = None, **keys: Unpack[AnnularClearanceLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["blade_contact"], dof: Dofs = None, **keys: Unpack[BladeContactLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["bouc_wen"], dof: Dofs = None, **keys: Unpack[BoucWenLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["contact_table"], dof: Dofs = None, **keys: Unpack[ContactTableLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["coulomb_rigid"], dof: Dofs = None, **keys: Unpack[CoulombRigidLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["coulomb_tanh"], dof: Dofs = None, **keys: Unpack[CoulombTanhLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["cubic_damping"], dof: Dofs = None, **keys: Unpack[CubicDampingLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["cubic_spring"], dof: Dofs = None, **keys: Unpack[CubicSpringLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["elastic_stop"], dof: Dofs = None, **keys: Unpack[ElasticStopLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["electrostatic"], dof: Dofs = None, **keys: Unpack[ElectrostaticLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["hertz"], dof: Dofs = None, **keys: Unpack[HertzLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["iwan"], dof: Dofs = None, **keys: Unpack[IwanLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["jenkins"], dof: Dofs = None, **keys: Unpack[JenkinsLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["jenkins_2d"], dof: Dofs = None, **keys: Unpack[Jenkins2dLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["parametric"], dof: Dofs = None, **keys: Unpack[ParametricLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["piecewise_linear"], dof: Dofs = None, **keys: Unpack[PiecewiseLinearLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["polynomial"], dof: Dofs = None, **keys: Unpack[PolynomialLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["polynomial_coupled"], dof: Dofs = None, **keys: Unpack[PolynomialCoupledLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["quadratic_damping"], dof: Dofs = None, **keys: Unpack[QuadraticDampingLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["rigid_wall"], dof: Dofs = None, **keys: Unpack[RigidWallLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["rolling_bearing"], dof: Dofs = None, **keys: Unpack[RollingBearingLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["short_bearing"], dof: Dofs = None, **keys: Unpack[ShortBearingLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["stribeck"], dof: Dofs = None, **keys: Unpack[StribeckLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["tabulated"], dof: Dofs = None, **keys: Unpack[TabulatedLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["user"], dof: Dofs = None, **keys: Unpack[UserLaw]) -> None: ...

        @overload
        def law(self, kind: Literal["van_der_pol"], dof: Dofs = None, **keys: Unpack[VanDerPolLaw]) -> None: ...

        @overload
        def law(self, kind: Law | Callable[..., Any], dof: Dofs = None, **keys: Any) -> None: ...

        def law(self, kind: Any, dof: Dofs = None, **keys: Any) -> None: ...


STRUCTURES: dict[str, dict[str, tuple[str, bool]]] = {  # keys of each structure: type, and whether it is required
    "beam": {
        "length": ('float', True),
        "bending_stiffness": ('float', True),
        "mass_per_length": ('float', True),
        "n_elements": ('int', True),
        "left_support": ('Literal["pinned", "clamped", "free", "guided"]', False),
        "right_support": ('Literal["pinned", "clamped", "free", "guided"]', False),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
    "chain": {
        "n_masses": ('int', True),
        "ends": ('Literal["fixed", "free", "fixed-free"]', False),
        "mass": ('Reals', True),
        "coupling_stiffness": ('Reals', True),
        "ground_stiffness": ('Reals', False),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
    "jeffcott": {
        "mass": ('float', True),
        "stiffness": ('float', True),
        "damping": ('float', False),
        "rotating_damping": ('float', False),
        "speed": ('float', False),
        "diametral_inertia": ('float', False),
        "polar_inertia": ('float', False),
        "tilt_stiffness": ('float', False),
        "tilt_damping": ('float', False),
        "coupling_stiffness": ('float', False),
        "ring_mass": ('float', False),
        "ring_stiffness": ('float', False),
        "ring_damping": ('float', False),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
    "matrices": {
        "n_dofs": ('int', True),
        "mass": ('Reals', True),
        "damping": ('Reals', False),
        "gyroscopic": ('Reals', False),
        "stiffness": ('Reals', True),
        "speed": ('float', False),
        "gyroscopic_by_speed": ('Reals', False),
        "stiffness_by_speed": ('Reals', False),
        "stiffness_by_speed_squared": ('Reals', False),
        "labels": ('Texts', False),
        "units": ('Texts', False),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
    "modal_beam": {
        "length": ('float', True),
        "bending_stiffness": ('float', True),
        "mass_per_length": ('float', True),
        "n_modes": ('int', True),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
    "model": {
        "file": ('str', True),
        "structural_frequency": ('float', False),
        "speed": ('Reals', False),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
    "rotor_stator": {
        "n_diameters": ('int', True),
        "speed": ('float', True),
        "frame": ('Literal["rotating", "stationary", "own"]', False),
        "disk_frequency": ('float', True),
        "casing_frequency": ('float', True),
        "disk_mass": ('float', False),
        "casing_mass": ('float', False),
        "disk_damping_ratio": ('float', False),
        "casing_damping_ratio": ('float', False),
        "damping_diagonal": ('float', False),
        "damping_mass": ('float', False),
        "damping_stiffness": ('float', False),
    },
}
