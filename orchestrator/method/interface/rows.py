"""Traces are rows, one per load step: (T, D) from the black box to the laws.

A row lies together in memory, as a right-hand side does in a message and as components do in the laws. Sparse matrices
multiply columns, several of them in one go, so that ``times`` turns its argument for the product alone.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import daxpy


ROOM = 0.05  # share of a matrix's arrays that may be empty: less is not worth a copy


def times(matrix: sp.sparray, rows: np.ndarray) -> np.ndarray:
    """(T, m) matrix (m, n) times each of the rows (T, n)."""
    if len(rows) == 1:
        return (matrix @ rows[0])[None]
    return np.ascontiguousarray((matrix @ rows.T).T)


def dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(T,) products of the rows of (T, n) with each other."""
    return np.einsum("ti,ti->t", a, b)


def add(rows: np.ndarray, factors: np.ndarray, others: np.ndarray) -> None:
    """rows (T, n) += factors (T,) times others (T, n), where they are: nothing of their size is written in between."""
    if not rows.size:
        return
    if not rows.flags.c_contiguous:  # of others BLAS would change a copy
        rows += factors[:, None] * others
        return
    for row, factor, other in zip(rows, factors, others):
        daxpy(other, row, a=factor)


def narrow(matrix: sp.csr_array) -> sp.csr_array:
    """The same matrix with indices of 32 bits where they suffice: a third less to keep, and to read in every product."""
    if max(matrix.nnz, *matrix.shape) > np.iinfo(np.int32).max:
        return matrix
    return sp.csr_array((matrix.data, matrix.indices.astype(np.int32, copy=False), matrix.indptr.astype(np.int32, copy=False)),
                        shape=matrix.shape)


def fitting(matrix: sp.csr_array) -> sp.csr_array:
    """The same matrix in arrays no longer than its entries: a product's have room for zeros that it has left out."""
    count = matrix.nnz
    if len(matrix.data) - count <= ROOM * count:
        return matrix
    return sp.csr_array((matrix.data[:count].copy(), matrix.indices[:count].copy(), matrix.indptr), shape=matrix.shape)
