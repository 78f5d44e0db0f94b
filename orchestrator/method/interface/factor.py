"""Solving with sparse symmetric matrices that are factorised once: the macro problem, repositioning, search directions.

Cholesky's factorisation by CHOLMOD in METIS's elimination order: on the macro matrices of cubes three to eight times faster
than SuperLU, with half the numbers. Its binding needs a compiler to be installed. Where it is missing SuperLU takes its place,
in the same order; so it does for matrices that are not quite positive definite.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

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
# Largest |A x − b| over that of the diagonal times |x| and b, which a factorisation may leave; sound ones leave some 1e-16, however
# the matrix is conditioned.
BACKWARD = 1e-11

Solve = Callable[[np.ndarray], np.ndarray]  # right-hand sides (n, T) to solutions


class Factor:
    """Solves with a symmetric positive definite sparse matrix, factorised once.

    lower : (n, n) its lower triangle; what is above the diagonal is not looked at
    patches : it has a block for each of many small surfaces: minimum degree finds their order in a tenth of the time
    Raises RuntimeError: it is singular
    """

    def __init__(self, lower: sp.sparray, patches: bool = False):
        lower = sp.tril(lower, format="csc")
        self._solve = np.array if not lower.shape[0] else by_cholesky(lower, "amd" if patches else "metis") or by_superlu(lower)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Solutions (T, n) for rows (T, n) of right-hand sides."""
        return np.ascontiguousarray(self._solve(rows.T).T)


def by_cholesky(lower: sp.csc_array, order: str = "metis") -> Solve | None:
    """CHOLMOD's factorisation in an order by ``metis`` or ``amd``; None where it is not installed, or the matrix is not
    positive definite."""
    if cholmod is None:
        return None
    columns = sp.csc_matrix(lower)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cholmod.CholmodWarning)  # of index types that it converts
        try:
            factor = cholmod.analyze(columns, mode="supernodal", ordering_method=order)
            factor.cholesky_inplace(columns)
        except cholmod.CholmodError:
            return None
    return factor if sound(lower, factor) else None


def by_superlu(lower: sp.csc_array) -> Solve:
    """SuperLU's factorisation, symmetric in its order; ``RuntimeError`` where the matrix is singular."""
    symmetric = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    columns = whole(lower)
    if columns.shape[0] < ORDERED:
        return sla.splu(columns, permc_spec="MMD_AT_PLUS_A", **symmetric).solve
    order = dissection(columns)
    lu = sla.splu(sp.csc_array(columns[order][:, order]), permc_spec="NATURAL", **symmetric)
    back = np.argsort(order)
    return lambda right: lu.solve(right[order])[back]


def whole(lower: sp.csc_array) -> sp.csc_array:
    """A symmetric matrix from its lower triangle."""
    return sp.csc_array(lower + sp.tril(lower, -1).T)


def sound(lower: sp.csc_array, solve: Solve) -> bool:
    """Whether a solver solves one right-hand side: a processor newer than its linear algebra has been seen to get it wrong."""
    diagonal = lower.diagonal()
    right = np.random.default_rng(0).uniform(-1.0, 1.0, len(diagonal))
    found = solve(right)
    left = lower @ found + lower.T @ found - diagonal * found - right
    return bool(np.abs(left).max() <= BACKWARD * (np.abs(diagonal).max() * np.abs(found).max() + 1.0))


def dissection(matrix: sp.sparray, seed: int | None = None) -> np.ndarray:
    """(n,) int, a nested dissection of a symmetric pattern: an elimination order of little fill, another one for each seed."""
    pattern = sp.coo_array(matrix)
    row, column = pattern.coords
    off = row != column
    graph = sp.csr_array((np.ones(off.sum(), np.int8), (row[off], column[off])), shape=pattern.shape)
    if not graph.nnz:
        return np.arange(graph.shape[0])
    options = None if seed is None else pymetis.Options(seed=seed)
    return np.asarray(pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices), options=options)[0])
