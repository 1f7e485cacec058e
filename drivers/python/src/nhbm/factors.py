"""Factors of large sparse symmetric matrices: CHOLMOD (by CVXOPT, where installed) or SuperLU (SciPy)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from nhbm.errors import ModelError

LARGEST_DENSE = 3000  # degrees of freedom, where ARPACK fails
BLOCK = 64  # right-hand sides
FEW = 0.01  # of their entries, which are not zero: making a sparse matrix of many takes longer than the solution
MAX_RESTARTS = 40  # of ARPACK, which needs a few


class Factors:
    """Factors of a symmetric positive definite matrix; fails for one that is not."""

    def __init__(self, matrix: sp.spmatrix, what: str) -> None:
        self.n = matrix.shape[0]
        try:
            from cvxopt import cholmod, matrix as dense, spmatrix
        except ImportError:
            self._solve = self._by_superlu(matrix, what)
            return
        lower = sp.tril(matrix).tocoo()
        entries = spmatrix(lower.data, lower.row.astype(int), lower.col.astype(int), (self.n, self.n))
        factor = cholmod.symbolic(entries)
        try:
            cholmod.numeric(entries, factor)
        except ArithmeticError:
            raise ModelError(f"{what} is not positive definite") from None

        def solve(b: Any) -> Any:
            answers = np.empty(b.shape)
            for first in range(0, b.shape[1], BLOCK):
                block = b[:, first : first + BLOCK]
                if np.count_nonzero(block) <= FEW * block.size:  # solved four columns at a time, others one by one
                    few = sp.coo_matrix(block)
                    x = dense(cholmod.spsolve(factor, spmatrix(few.data, few.row.astype(int), few.col.astype(int), few.shape)))
                else:
                    x = dense(np.asfortranarray(block))
                    cholmod.solve(factor, x)
                answers[:, first : first + BLOCK] = np.array(x).reshape(block.shape)
            return answers

        self._solve = solve

    @staticmethod
    def _by_superlu(matrix: Any, what: Any) -> Any:
        try:
            factor = spla.splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:
            raise ModelError(f"{what} is singular") from None
        if (factor.U.diagonal() <= 0.0).any():
            raise ModelError(f"{what} is not positive definite")
        return factor.solve

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Solutions for one right-hand side, or for the columns of several."""
        b = np.asarray(b, dtype=float)
        if b.ndim == 1:
            return self._solve(b[:, None])[:, 0]
        return self._solve(b)

    def operator(self) -> spla.LinearOperator:
        return spla.LinearOperator((self.n, self.n), matvec=lambda b: self.solve(np.ravel(b)), dtype=float)


def symmetric_part(matrix: Any) -> sp.csr_matrix:
    """(A + A')/2."""
    return sp.csr_matrix((matrix + matrix.T) / 2)


def lowest_modes(stiffness: Any, mass: Any, n_modes: int, shift: float = 0.0, factors: Factors | None = None) -> Any:
    """Lowest squared frequencies and shapes (unit modal mass) by ARPACK, shifted to -shift and inverted; fewer where the mass has
    no more."""
    n = stiffness.shape[0]
    if n_modes < 1:
        return np.zeros(0), np.zeros((n, 0))
    if n_modes >= n - 1 or n <= 60:
        return dense_modes(stiffness, mass, n_modes, shift)
    if factors is None:
        factors = Factors(stiffness + shift * mass, "the shifted stiffness")
    start = np.cos(np.arange(1.0, n + 1.0))
    try:
        values, shapes = spla.eigsh(
            stiffness, k=n_modes, M=mass, sigma=-shift, which="LM", OPinv=factors.operator(), v0=start, maxiter=MAX_RESTARTS
        )
        order = np.argsort(values)
        if values[order[0]] + shift > 0.0:
            return values[order], shapes[:, order]
    except spla.ArpackError:
        pass
    if n > LARGEST_DENSE:  # motions without mass have grown among the vectors
        raise ModelError(f"{n_modes} modes cannot be distinguished from motions without mass: take fewer")
    return dense_modes(stiffness, mass, n_modes, shift)


def dense_modes(stiffness: Any, mass: Any, n_modes: int | None = None, shift: float = 0.0) -> Any:
    """The same by LAPACK, by default all of them; some degrees of freedom may be without mass."""
    k, m = stiffness.toarray(), mass.toarray()
    try:
        values, shapes = scipy.linalg.eigh(k, m)
    except np.linalg.LinAlgError:  # the mass is singular: M x = x/(w**2 + shift) (K + shift M)
        try:
            inverse, shapes = scipy.linalg.eigh(m, k + shift * m)
        except np.linalg.LinAlgError:
            raise ModelError("the stiffness is not positive definite, and there are degrees of freedom without mass") from None
        has_mass = inverse[::-1] > len(k) * np.finfo(float).eps * inverse[-1]
        inverse, shapes = inverse[::-1][has_mass], shapes[:, ::-1][:, has_mass]
        values, shapes = 1.0 / inverse - shift, shapes / np.sqrt(inverse)
    return values[:n_modes], shapes[:, :n_modes]


def dense_values(stiffness: Any, mass: Any) -> np.ndarray:
    """The squared frequencies of `dense_modes` without their shapes, in a third of its time."""
    try:
        return scipy.linalg.eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True, overwrite_a=True, overwrite_b=True)
    except np.linalg.LinAlgError:
        return dense_modes(stiffness, mass)[0]
