"""Singular values of finite matrices, of which LAPACK's fast driver fails on a few."""

from __future__ import annotations

import numpy as np
from scipy.linalg import svd as by_driver


def svd(matrix: np.ndarray, full_matrices: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute U, σ, Vᵀ with ``matrix`` = U diag(σ) Vᵀ, as ``numpy.linalg.svd`` does.

    matrix : (…, m, n)
    full_matrices : whether U is (…, m, m) and Vᵀ (…, n, n), or both end with the least of m and n
    Raises numpy.linalg.LinAlgError: the matrix has entries that are no numbers

    LAPACK's divide and conquer (gesdd) does not converge on some finite matrices; QR iterations (gesvd), which take
    longer, do.
    """
    try:
        return np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        if not np.isfinite(matrix).all():
            raise
    flat = matrix.reshape(-1, *matrix.shape[-2:])
    found = zip(*(by_driver(each, full_matrices=full_matrices, lapack_driver="gesvd") for each in flat))
    return tuple(np.stack(part).reshape(*matrix.shape[:-2], *part[0].shape) for part in found)
