"""Structures that the solver builds: beams, chains, rotors and full matrices."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import numpy as np

from nhbm.errors import ModelError
from nhbm.keys import check_keys, missing_key
from nhbm.signatures import STRUCTURES

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from nhbm import signatures


class Builder:
    """A structure that the solver builds: `&structure` with its keys, which docs/user/input.md names with their units.

    Examples
    --------
    >>> import nhbm
    >>> nhbm.Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0)
    Chain(n_masses=2, mass=1.0, coupling_stiffness=1.0)
    """

    type = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__init__" not in cls.__dict__ and cls.type in STRUCTURES:  # what help and completion show
            cls.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
                inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=inspect.Parameter.empty
                                  if is_required else None) for key, (kind, is_required) in STRUCTURES[cls.type].items()
            ])  # fmt: skip

    def __init__(self, *values: Any, **keys: Any) -> None:
        name = type(self).__name__
        if values:
            raise ModelError(f"nhbm.{name} takes its keys by name, {name}(key=value, ...); docs/user/input.md lists them")
        if "type" in keys:
            raise ModelError(f"nhbm.{name} is &structure type = '{self.type}'; leave 'type' out")
        self.keys: dict[str, Any] = {"type": self.type, **keys}
        check_keys("structure", self.keys, f"nhbm.{name}")
        missing = missing_key("structure", self.keys)
        if missing:
            raise ModelError(f"nhbm.{name}: missing key '{missing}'")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.keys.items() if k != 'type')})"


class Beam(Builder):
    """Euler-Bernoulli beam of finite elements."""

    type = "beam"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.BeamKeys]) -> None: ...


class Chain(Builder):
    """A chain of masses, with springs and dashpots between them and to ground."""

    type = "chain"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.ChainKeys]) -> None: ...


class ModalBeam(Builder):
    """A simply supported beam by its first modes."""

    type = "modal_beam"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.ModalBeamKeys]) -> None: ...


class Jeffcott(Builder):
    """A disk on a massless shaft."""

    type = "jeffcott"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.JeffcottKeys]) -> None: ...


class RotorStator(Builder):
    """A bladed disk and a casing."""

    type = "rotor_stator"

    if TYPE_CHECKING:

        def __init__(self, **keys: Unpack[signatures.RotorStatorKeys]) -> None: ...


def _square(name: str, matrix: Any, n: int = 0) -> Any:
    """A full matrix of n rows, by default of as many as it has; ModelError for another shape."""
    matrix = matrix.toarray() if hasattr(matrix, "toarray") else matrix
    try:
        if np.iscomplexobj(matrix):
            raise ModelError(f"{name} must be real; viscous damping is a matrix of its own, `damping`")
        if getattr(np.asarray(matrix), "dtype", np.dtype(float)).kind in "SU":  # NumPy reads "1e3" as a number
            raise ValueError
        full = np.atleast_2d(np.asarray(matrix, dtype=float))
    except (TypeError, ValueError):
        if getattr(getattr(matrix, "dtype", None), "kind", "") == "O":  # of scipy.io.loadmat, by default
            raise ModelError(f"{name} is an array of objects, as of a struct of MATLAB: scipy.io.loadmat(..., simplify_cells=True)"
                             " returns the matrix itself") from None  # fmt: skip
        raise ModelError(f"{name} must be a square matrix of numbers, not {matrix!r}") from None
    n = n or len(full)
    if full.shape != (n, n):
        raise ModelError(
            f"{name} has the shape {full.shape}, not {(n, n)}: matrices must be square and equal in size; "
            "np.diag makes one of a list"
        )
    return full


class Matrices(Builder):
    """Small full matrices; use Structure for large sparse ones.

    Parameters
    ----------
    mass, stiffness, damping : array_like or sparse matrix
        [kg], [N/m], [N s/m], (n_dofs, n_dofs); np.diag makes one of a list, which alone would be ambiguous.
    **keys
        Further keys of &structure type = 'matrices', such as `labels`; `n_dofs` follows from the matrices.
    """

    type = "matrices"

    def __init__(self, mass: Any = None, stiffness: Any = None, damping: Any = None, *values: Any, **keys: Any) -> None:
        if mass is None or stiffness is None or values:
            raise ModelError("nhbm.Matrices takes mass and stiffness (square matrices), optionally damping, further keys by name")
        mass = _square("mass", mass)
        if keys.pop("n_dofs", len(mass)) != len(mass):
            raise ModelError(f"n_dofs follows from the matrices; leave it out: mass is {len(mass)} x {len(mass)}")
        more = {
            name: _square(name, m, len(mass)).ravel()
            for name, m in (("stiffness", stiffness), ("damping", damping))
            if m is not None
        }
        super().__init__(n_dofs=len(mass), mass=mass.ravel(), **more, **keys)
