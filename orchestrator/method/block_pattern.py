"""Sparse matrices of dense blocks whose places never change: bodies, and the interfaces between them.

The places are sorted once; what remains of an assembly is a sum of blocks and one gather.
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
        self.bodies, self.size = bodies, size
        one, two = ends.T
        body = np.arange(bodies)
        rows = np.concatenate([one, one, two, two, body])
        columns = np.concatenate([one, two, one, two, body])
        places, place = np.unique(columns * bodies + rows, return_inverse=True)
        self.gathered = np.argsort(place, kind="stable")  # blocks of the same place lie together
        self.starts = np.searchsorted(place[self.gathered], np.arange(len(places)))
        column, row = np.divmod(places, bodies)
        field = np.arange(size)
        rows = np.broadcast_to(size * row[:, None, None] + field[:, None], (len(places), size, size)).ravel()
        columns = np.broadcast_to(size * column[:, None, None] + field, (len(places), size, size)).ravel()
        self.order = np.lexsort((rows, columns))
        self.indices = rows[self.order].astype(np.int32)
        n = size * bodies
        self.indptr = np.searchsorted(columns[self.order], np.arange(n + 1)).astype(np.int32)
        self.diagonal = np.flatnonzero(self.indices == columns[self.order])

    def values(self, pairs: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Entries of the matrix, column after column.

        Parameters
        ----------
        pairs : (I, 2 size, 2 size) blocks of the interfaces, first body first
        own : (bodies, size, size) blocks of the bodies
        """
        m = self.size
        halves = (pairs[:, a : a + m, b : b + m] for a in (0, m) for b in (0, m))
        blocks = np.concatenate([*halves, own], dtype=float).reshape(len(self.gathered), -1)
        return np.add.reduceat(blocks[self.gathered], self.starts, axis=0).ravel()[self.order]

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
