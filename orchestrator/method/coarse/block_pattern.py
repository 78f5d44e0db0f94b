"""Sparse matrices of dense blocks whose places never change: bodies, and the interfaces between them.

The places are sorted once; what remains of an assembly is one product with a matrix of ones.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

PIVOTING = 0.01  # a diagonal entry this large relative to its column's largest is taken as pivot


class BlockPattern:
    """Where the blocks of bodies and of pairs of bodies go.

    Parameters
    ----------
    ends : (I, 2) int, the two bodies of every interface
    bodies : number of bodies
    size : rows of a body's block
    """

    def __init__(self, ends: np.ndarray, bodies: int, size: int):
        self.bodies, self.size, n = bodies, size, size * bodies
        field = np.arange(size)
        both = (size * ends[:, :, None] + field).reshape(len(ends), -1)
        own = size * np.arange(bodies)[:, None] + field
        place = np.concatenate([(n * dofs[:, None, :] + dofs[:, :, None]).ravel() for dofs in (both, own)])
        places, where = np.unique(place, return_inverse=True)
        columns, rows = np.divmod(places, n)  # column after column
        self.diagonal = np.flatnonzero(columns == rows)
        self.indices, self.indptr = rows.astype(np.int32), np.searchsorted(columns, np.arange(n + 1)).astype(np.int32)
        self.sum = sp.csr_array((np.ones(len(place)), (where, np.arange(len(place)))),
                                shape=(len(places), len(place)))

    def values(self, pairs: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Entries of the matrix, column after column.

        Parameters
        ----------
        pairs : (I, 2 size, 2 size) blocks of the interfaces, first body first
        own : (bodies, size, size) blocks of the bodies
        """
        return self.sum @ np.concatenate([pairs.ravel(), own.ravel()], dtype=float)

    def matrix(self, values: np.ndarray, shift: float) -> sp.csc_array:
        """The matrix that ``values`` belong to, with a shift of its diagonal."""
        n = self.size * self.bodies
        shifted = values.copy()
        shifted[self.diagonal] += shift
        return sp.csc_array((shifted, self.indices, self.indptr), shape=(n, n))

    @staticmethod
    def factorise(matrix: sp.csc_array) -> sla.SuperLU:
        """LU of a matrix of this kind: symmetric pattern, strong diagonal."""
        return sla.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOTING, options={"SymmetricMode": True})
