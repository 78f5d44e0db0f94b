"""Matrices of blocks of bodies and of pairs of bodies: where their blocks go, and what solves with
them.

    pattern = BlockPattern(ends, bodies, size, team)
    pattern.factors(pattern.values(pairs), shift).solve(right)

Places and the order of elimination are found once; what remains of an assembly are sums of blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.sparse.fronts import Elimination, Factors
from orchestrator.method.sparse.rigid_first import RigidFirst
from orchestrator.parallel.team import ALONE, Team


class BlockPattern:
    """Where the blocks go; all ranks make it together, and rank 0 eliminates for all.

    ends : (I, 2) int, the two bodies of every interface that this rank adds up
    bodies : number of bodies of all ranks
    size : rows of a body's block
    rigid : how many of them, the first, may be eliminated alone (``rigid_first``), where that saves
        much; default: none
    rows, indices : (n,) int, block rows and columns of the blocks, row after row
    diagonal : (bodies,) int, which of them are a body's own
    """

    def __init__(self, ends: np.ndarray, bodies: int, size: int, team: Team = ALONE,
                 rigid: int = 0):
        self.bodies, self.size, self.team, self._rigid = bodies, size, team, rigid
        own, all_ends = np.arange(bodies), np.concatenate(team.all_gather(ends))
        places = np.unique(np.concatenate([_places(all_ends, bodies), bodies * own + own]))
        self.rows, self.indices = np.divmod(places, bodies)
        self.diagonal = np.flatnonzero(self.rows == self.indices)
        self.indptr = np.searchsorted(self.rows, np.arange(bodies + 1))
        where = np.searchsorted(places, _places(ends, bodies))
        self.sums = sp.csr_array((np.ones(len(where)), (where, np.arange(len(where)))),
                                 shape=(len(places), len(where)))

    def summed(self, pairs: np.ndarray) -> np.ndarray:
        """(n, size, size) sums of blocks of this rank's interfaces, block row after block row.

        pairs : (I, 2, 2, size, size), first body first
        """
        return (self.sums @ pairs.reshape(-1, self.size**2)).reshape(-1, self.size, self.size)

    def values(self, pairs: np.ndarray, own: np.ndarray | float = 0.0) -> np.ndarray:
        """(n, size, size) the same of all ranks, which ask together, with the bodies' ``own``
        (bodies, size, size).
        """
        result, = self.team.sum(self.summed(pairs))
        result[self.diagonal] += own
        return result

    def matrix(self, values: np.ndarray) -> sp.bsr_array:
        """The matrix that ``values`` belong to."""
        return sp.bsr_array((values, self.indices, self.indptr),
                            shape=(self.size * self.bodies,) * 2)

    def factors(self, values: np.ndarray, shift: float) -> SharedFactors:
        """Of (matrix + shift), what solves with it."""
        if self.team.rank:
            return SharedFactors(self.team, None)
        whole = self.elimination.size == self.size
        return SharedFactors(self.team, self.elimination.factors(values, shift) if whole else
                             RigidFirst(self.elimination, values, shift, self.diagonal))

    @cached_property
    def elimination(self) -> Elimination:
        """Order and fronts."""
        return Elimination(self.indptr, self.indices, self.size, self._rigid)


@dataclass(frozen=True)
class SharedFactors:
    """A factorised matrix, on rank 0."""

    team: Team
    factors: Factors | RigidFirst | None

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape, which rank 0 has; on all
        ranks.
        """
        return self.team.spread(np.empty_like(right) if self.factors is None
                                else self.factors.solve(right))


def _places(ends: np.ndarray, bodies: int) -> np.ndarray:
    """(4 I,) int, block row × bodies + block column of the four blocks of each two bodies."""
    return (bodies * np.repeat(ends, 2, axis=1) + np.tile(ends, 2)).ravel()
