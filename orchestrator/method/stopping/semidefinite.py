"""Small sparse systems that may be singular."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.interface.factor import by_cholesky, by_superlu, sound, whole

SHIFT = 1e-13  # of the diagonal


def semidefinite_solver(matrix: sp.sparray) -> Callable[[np.ndarray], np.ndarray]:
    """Solver of a positive semidefinite matrix (n, n) for rows (T, n), regularised by rounding where it is singular."""
    matrix = sp.csc_array(matrix)
    if matrix.shape[0] == 0:
        return lambda rows: np.zeros((len(rows), 0))
    scale = matrix.diagonal()
    shifted = sp.tril(matrix + sp.diags_array(np.where(scale > 0, scale, 1.0) * SHIFT), format="csc")
    solve = by_cholesky(shifted) or by_superlu(shifted)
    if not sound(shifted, solve):  # where rounding has made it indefinite, pivots have to be chosen
        solve = sla.splu(whole(shifted)).solve
    return lambda rows: np.ascontiguousarray(solve(rows.T).T)


def is_semidefinite(matrix: sp.sparray, rounding: float) -> bool:
    """Whether a symmetric matrix A (n, n) is positive semidefinite, but for errors of its entries.

    It is, to rounding, if A + rounding × diag A has a factorisation with positive pivots (Sylvester's law of inertia).

    rounding : relative error of the entries, above that of double precision
    """
    scale = matrix.diagonal()
    largest = scale.max(initial=0.0)
    if (scale < -rounding * largest).any():
        return False
    # where nothing is stiff, any entry would be beside the diagonal
    shifted = sp.tril(matrix + sp.diags_array(rounding * np.where(scale > rounding * largest, scale, largest or 1.0)), format="csc")
    if by_cholesky(shifted) is not None:
        return True
    lu = sla.splu(whole(shifted), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return bool(np.array_equal(lu.perm_r, lu.perm_c) and (lu.U.diagonal() > 0).all())
