"""Solving with sparse symmetric matrices that are factorised once: the macro problem, repositioning, search directions.

Cholesky's factorisation by CHOLMOD, which makes dense products of most of it, in METIS's elimination order: on the
macro matrices of cubes three to eight times faster than SuperLU, with half the numbers. Its binding needs a compiler to
be installed. Where it is missing SuperLU takes its place, in the same order; so it does for matrices that are not quite
positive definite. Each is tried on one right-hand side before it is trusted.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pymetis
import scipy.sparse as sp
import scipy.sparse.linalg as sla

try:
    from sksparse import cholmod
except ImportError:  # there are no wheels: ``setup.sh`` builds it where it can
    cholmod = None

# Unknowns from which METIS's order pays with SuperLU: at 2,700 it takes as long as minimum degree, at 24,000 half as long.
ORDERED = 2000
# ‖A x − b‖ over ‖A‖‖x‖ + ‖b‖ that a factorisation may leave; sound ones leave some 1e-16, whatever the conditioning.
BACKWARD = 1e-11


@dataclass(frozen=True)
class Factorised:
    """A factorisation of a matrix (n, n).

    Parameters
    ----------
    solve : right-hand sides (n, T) to solutions
    count : how many numbers the factors hold, counted when asked
    """

    solve: Callable[[np.ndarray], np.ndarray]
    count: Callable[[], int]


class Factor:
    """Solves with a symmetric positive definite sparse matrix, factorised once.

    Parameters
    ----------
    matrix : (n, n) both triangles

    Raises
    ------
    RuntimeError : it is singular
    """

    def __init__(self, matrix: sp.sparray):
        self._made = (by_cholesky(matrix) or by_superlu(matrix)) if matrix.shape[0] else None

    @property
    def entries(self) -> int:
        """Numbers that the factors hold."""
        return self._made.count() if self._made else 0

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Solutions (T, n) for rows (T, n) of right-hand sides."""
        return np.ascontiguousarray(self._made.solve(rows.T).T) if self._made else np.array(rows)


def by_cholesky(matrix: sp.sparray) -> Factorised | None:
    """CHOLMOD's factorisation; None where it is not installed, or the matrix is not positive definite."""
    if cholmod is None:
        return None
    columns = sp.csc_matrix(matrix)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cholmod.CholmodWarning)  # of index types that it converts
        try:
            factor = cholmod.analyze(columns, mode="supernodal", ordering_method="metis")
            factor.cholesky_inplace(columns)
        except cholmod.CholmodError:
            return None
    return Factorised(factor, lambda: factor.copy().L().nnz) if sound(columns, factor) else None


def by_superlu(matrix: sp.sparray) -> Factorised:
    """SuperLU's factorisation, symmetric in its order.

    Raises
    ------
    RuntimeError : the matrix is singular
    """
    symmetric = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    columns = sp.csc_array(matrix)
    if columns.shape[0] < ORDERED:
        lu = sla.splu(columns, permc_spec="MMD_AT_PLUS_A", **symmetric)
        return Factorised(lu.solve, lambda: lu.nnz)
    order = dissection(columns)
    lu = sla.splu(sp.csc_array(columns[order][:, order]), permc_spec="NATURAL", **symmetric)

    def solve(right: np.ndarray) -> np.ndarray:
        result = np.empty_like(right)
        result[order] = lu.solve(right[order])
        return result

    return Factorised(solve, lambda: lu.nnz)


def sound(matrix: sp.sparray, solve: Callable[[np.ndarray], np.ndarray]) -> bool:
    """Whether a solver solves: a processor that is newer than its linear algebra has been seen to get it wrong."""
    right = np.random.default_rng(0).uniform(-1.0, 1.0, matrix.shape[0])
    found = solve(right)
    allowed = BACKWARD * (abs(matrix).sum(axis=0).max() * np.abs(found).max() + 1.0)
    return bool(np.abs(matrix @ found - right).max() <= allowed)


def dissection(matrix: sp.sparray) -> np.ndarray:
    """(n,) int, a nested dissection of a symmetric pattern: an elimination order of little fill."""
    pattern = sp.coo_array(matrix)
    row, column = pattern.coords
    off = row != column
    graph = sp.csr_array((np.ones(off.sum(), np.int8), (row[off], column[off])), shape=pattern.shape)
    if not graph.nnz:
        return np.arange(graph.shape[0])
    return np.asarray(pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))[0])
