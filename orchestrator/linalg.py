"""Factorisations of dense and sparse matrices where a library's own choice may fail.

Shares of the largest of their kind below which numbers say nothing.

A length below ``WRITTEN`` of the whole may come of the digits that files have; one below
``PLACED`` comes of turning, projecting and measuring what is exact; a difference below ``SAME``
comes of some sums and products in double precision.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg import svd as by_driver

WRITTEN = 1e-6  # files have six digits, or more
PLACED = 1e-9  # roots of double precision's eps, times what projections lose
SAME = 1e-12  # some thousand eps
# Largest |A x − b| over that of the entries, or the diagonal, times |x| and b, which a
# factorisation may leave: sound ones leave some 1e-16, however the matrix is conditioned.
BACKWARD = 1e-11


def symmetric_lu(matrix: sp.sparray, order: str = "MMD_AT_PLUS_A") -> spla.SuperLU:
    """Factors of a symmetric matrix; ``order`` is SuperLU's word, minimum degree or NATURAL.
    RuntimeError: a pivot is exactly zero.
    """
    return spla.splu(sp.csc_array(matrix), permc_spec=order, diag_pivot_thresh=0.0,
                     options={"SymmetricMode": True})


def dissection(matrix: sp.sparray) -> np.ndarray:
    """(n,) int, a nested dissection of a symmetric pattern, by METIS: an elimination order of
    little fill.
    """
    pattern = sp.coo_array(matrix)
    row, column = pattern.coords
    off = row != column
    graph = sp.csr_array((np.ones(off.sum(), np.int8), (row[off], column[off])),
                         shape=pattern.shape)
    if not graph.nnz:
        return np.arange(graph.shape[0])
    from orchestrator.optional import need  # servers of codes import the rest alone

    pymetis = need("pymetis")
    return np.asarray(
        pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))[0])


def svd(matrix: np.ndarray,
        full_matrices: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute U, σ, Vᵀ with ``matrix`` = U diag(σ) Vᵀ, as ``numpy.linalg.svd`` does.

    matrix : (…, m, n)
    full_matrices : whether U is (…, m, m) and Vᵀ (…, n, n), or both end with the least of m and n
    Raises numpy.linalg.LinAlgError: the matrix has entries that are no numbers

    LAPACK's divide and conquer (gesdd) does not converge on some finite matrices; QR iterations
    (gesvd), which take longer, do.
    """
    try:
        return np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        if not np.isfinite(matrix).all():
            raise
    flat = matrix.reshape(-1, *matrix.shape[-2:])
    found = zip(*(by_driver(each, full_matrices=full_matrices, lapack_driver="gesvd")
                  for each in flat))
    return tuple(np.stack(part).reshape(*matrix.shape[:-2], *part[0].shape) for part in found)
