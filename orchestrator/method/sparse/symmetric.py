"""Solving with sparse symmetric matrices that are factorised once: the macro problem,
repositioning, search directions.

Cholesky's factorisation by CHOLMOD in METIS's elimination order: on the macro matrices of cubes
three to eight times faster than SuperLU, with half the numbers. Where it is missing SuperLU takes
its place, in the same order if pymetis is there; so it does for matrices that are not quite
positive definite.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.sparse import cholmod
from orchestrator.optional import absent
from orchestrator.linalg import BACKWARD, dissection, symmetric_lu

# Unknowns from which METIS's order pays with SuperLU: at 2,700 it takes as long as minimum degree,
# at 24,000 half as long.
ORDERED = 2000

Solve = Callable[[np.ndarray], np.ndarray]  # right-hand sides to solutions


def factorise(lower: sp.sparray, patches: bool = False) -> Solve:
    """Return what solves with a symmetric positive definite matrix: rows (T, n) of right-hand sides
    to solutions (T, n).

    lower : (n, n) its lower triangle; what is above the diagonal is not looked at
    patches : it has a block for each of many small surfaces: minimum degree finds their order in a
        tenth of the time
    Raises RuntimeError: it is singular
    """
    lower = sp.tril(lower, format="csc")
    return by_rows(np.array if not lower.shape[0] else by_cholesky(
        lower, "amd" if patches else "metis") or by_superlu(lower))


def by_rows(solve: Solve) -> Solve:
    """Return the same for rows (T, n) in place of columns (n, T)."""
    return lambda rows: np.ascontiguousarray(solve(rows.T).T)


def by_cholesky(lower: sp.csc_array, order: str = "metis") -> Solve | None:
    """CHOLMOD's factorisation in an order by ``metis`` or ``amd``; None where it is not installed,
    or the matrix is not
    positive definite."""
    factor = cholmod.factorised(lower, order)
    return factor if factor is not None and sound(lower, factor) else None


def by_superlu(lower: sp.csc_array) -> Solve:
    """SuperLU's factorisation, symmetric in its order; where rounding has made the matrix
    indefinite, with pivots that are chosen. ``RuntimeError`` where it is singular.
    """
    columns = whole(lower)
    if columns.shape[0] < ORDERED or absent("pymetis"):
        solve = symmetric_lu(columns).solve
    else:
        order = dissection(columns)
        lu, back = symmetric_lu(columns[order][:, order], "NATURAL"), np.argsort(order)
        solve = lambda right: lu.solve(right[order])[back]
    return solve if sound(lower, solve) else sla.splu(columns).solve


def whole(lower: sp.csc_array) -> sp.csc_array:
    """A symmetric matrix from its lower triangle."""
    return sp.csc_array(lower + sp.tril(lower, -1).T)


def sound(lower: sp.csc_array, solve: Solve) -> bool:
    """Whether a solver solves one right-hand side: a processor newer than its linear algebra has
    been seen to get it wrong.
    """
    diagonal = lower.diagonal()
    right = np.random.default_rng(0).uniform(-1.0, 1.0, len(diagonal))
    found = solve(right)
    left = lower @ found + lower.T @ found - diagonal * found - right
    return bool(np.abs(left).max() <= BACKWARD
                * (np.abs(diagonal).max() * np.abs(found).max() + 1.0))


SHIFT = 1e-13  # of the diagonal


def regularised(matrix: sp.sparray) -> sp.csc_array:
    """A positive semidefinite matrix (n, n), and on its diagonal what rounding may take from it."""
    scale = matrix.diagonal()
    return sp.csc_array(matrix
                        + sp.diags_array(SHIFT * np.where(scale > 0, scale,
                                                          scale.max(initial=0.0) or 1.0)))


def semidefinite_solver(matrix: sp.sparray, patches: bool = False) -> Solve:
    """Solver of a positive semidefinite matrix (n, n) for rows (T, n), regularised by rounding
    where it is singular; ``patches`` as of ``factorise``.
    """
    return factorise(regularised(matrix), patches)


def is_semidefinite(matrix: sp.sparray, rounding: float) -> bool:
    """Whether a symmetric matrix A (n, n) is positive semidefinite, but for errors of its entries.

    It is, to rounding, if A + rounding × diag A has a factorisation with positive pivots
    (Sylvester's law of inertia).

    rounding : relative error of the entries, above that of double precision
    """
    scale = matrix.diagonal()
    largest = scale.max(initial=0.0)
    if (scale < -rounding * largest).any():
        return False
    # where nothing is stiff, any entry would be beside the diagonal
    shifted = sp.tril(matrix
                      + sp.diags_array(rounding * np.where(scale > rounding * largest, scale,
                                                           largest or 1.0)), format="csc")
    if by_cholesky(shifted) is not None:
        return True
    lu = symmetric_lu(whole(shifted))
    return bool(np.array_equal(lu.perm_r, lu.perm_c) and (lu.U.diagonal() > 0).all())
