"""Newton's matrices of the coarse contact problem: where their blocks go, and what solves with
them.

    pattern = BlockPattern(ends, bodies, size)
    pattern.factors(pattern.summed(pairs), shift).solve(right)

Places and the order of elimination are found once; what remains of an assembly are sums of blocks.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
import scipy.sparse as sp

from orchestrator.method.coarse.elimination import Elimination, Factors
from orchestrator.method.coarse.rigid_first import RigidFirst
from orchestrator.parallel.team import ALONE, Team


class BlockPattern:
    """Where the blocks of bodies and of pairs of bodies go.

    ends : (I, 2) int, the two bodies of every interface
    bodies : number of bodies
    size : rows of a body's block
    order : (I,) int, the interfaces in the order in which they are added up; default: as they are
    team : the ranks that eliminate together; all make the same
    rigid : how many rows of a block, the first, may be eliminated alone (``rigid_first``), where
        that saves much; default: none
    first : how many are
    rows, indices : (n,) int, block rows and columns of the blocks, row after row
    """

    def __init__(self, ends: np.ndarray, bodies: int, size: int, order: np.ndarray | None = None,
                 team: Team = ALONE, rigid: int = 0):
        self.bodies, self.size, self.team, self._rigid = bodies, size, team, rigid
        self._factors, self._corners, self._shift = None, [], None
        rows, columns = np.repeat(ends, 2, axis=1).ravel(), np.tile(ends, 2).ravel()
        own = np.arange(bodies)
        places, where = np.unique(np.concatenate([bodies * rows + columns, bodies * own + own]),
                                  return_inverse=True)
        where = where[:len(rows)]
        rows, columns = np.divmod(places, bodies)  # block row after block row
        self.diagonal = np.flatnonzero(columns == rows)
        self.rows, self.indices, self.indptr = rows, columns.astype(np.int32), np.searchsorted(
            rows, np.arange(bodies + 1)).astype(np.int32)
        turn = np.arange(len(ends)) if order is None else np.argsort(order)
        # the columns of a row stay in this sequence
        sequence = np.lexsort((np.repeat(turn, 4), where))
        starts = np.searchsorted(where[sequence], np.arange(len(places) + 1))
        self.sums = sp.csr_array((np.ones(len(sequence)), sequence, starts),
                                 shape=(len(places), len(where)))

    def summed(self, pairs: np.ndarray) -> np.ndarray:
        """(n, size, size) sums of blocks of the interfaces, block row after block row.

        pairs : (I, 2, 2, size, size), first body first
        """
        return (self.sums @ pairs.reshape(-1, self.size**2)).reshape(-1, self.size, self.size)

    def matrix(self, values: np.ndarray, shift: float) -> sp.bsr_array:
        """The matrix that ``values`` belong to, with a shift of its diagonal."""
        shifted = values.copy()
        shifted[self.diagonal] += (shift * np.eye(self.size)).astype(values.dtype)
        return _matrix(shifted, self.indices, self.indptr, self.bodies)

    def factors(self, values: np.ndarray, shift: float,
                stale: np.ndarray | None = None) -> Factors | RigidFirst:
        """Of (matrix + shift), in the place of the last ones: fresh memory costs as much as what is
        done on it.

        values : (k, size, size) of the blocks that are ``entering``
        stale : (k,) bool, those that are others than in the last ones; default: all
        """
        (place, bodies), first = self.own, self.first
        if shift != self._shift:
            stale = None
        self._shift = None  # until these are found
        chosen = slice(None) if stale is None else np.flatnonzero(stale)
        blocks, shifted = values[chosen], place if stale is None else place[stale[place]]
        cuts = (slice(0, first), slice(first, self.size))
        if not self._corners:
            self._corners = [np.empty((len(values), b.stop - b.start, c.stop - c.start))
                             for b, c in product(cuts, cuts)]
        for corner, (b, c) in zip(self._corners, product(cuts, cuts)):
            corner[chosen] = blocks[:, b, c]
            if b == c:
                corner[shifted] += shift * np.eye(corner.shape[1])
        eliminated, *parts = self._corners
        self._factors = self.elimination.factors(eliminated, self._factors, stale)
        self._shift = shift
        if first == self.size:
            return self._factors
        own, starts = np.zeros((self.bodies, *parts[2].shape[1:])), np.searchsorted(
            self.entering, self.indptr)
        own[bodies] = parts[2][place]
        matrices = (_matrix(part, self.indices[self.entering], starts, self.bodies)
                    for part in parts)
        return RigidFirst(self._factors, tuple(matrices), own, self.team)

    @cached_property
    def elimination(self) -> Elimination:
        """Order and fronts."""
        return Elimination(self.indptr, self.indices, self.size, self.team, self._rigid)

    @cached_property
    def entering(self) -> np.ndarray:
        """(k,) int, ascending, the blocks that enter this rank's fronts; each enters those of
        one.
        """
        return np.flatnonzero(self.elimination.entered)

    @cached_property
    def own(self) -> tuple[np.ndarray, np.ndarray]:
        """Which of these are blocks of a body with itself, and of which bodies, (b,) int each."""
        place = np.flatnonzero(self.rows[self.entering] == self.indices[self.entering])
        return place, self.rows[self.entering[place]]

    @property
    def first(self) -> int:
        """Rows of a block that are eliminated."""
        return self.elimination.size


def _matrix(blocks: np.ndarray, indices: np.ndarray, indptr: np.ndarray,
            count: int) -> sp.bsr_array:
    """Of ``count`` block rows and columns."""
    rows, columns = blocks.shape[1:]
    return sp.bsr_array((blocks, indices, indptr), shape=(rows * count, columns * count))
