"""Newton's matrices over ranks: each adds up the blocks of the fronts that it eliminates, of slopes
that other ranks have formed.

What an interface changes enters the fronts of its two bodies alone: its slopes go to their ranks,
once each.

Most of Newton's steps change the slopes of a few interfaces in a hundred. What these do not change
of a matrix stays as it was formed and eliminated last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import in_parts
from orchestrator.laws.points import Answer
from orchestrator.method.coarse.elimination import Factors
from orchestrator.method.coarse.kernels import formed
from orchestrator.method.coarse.pattern import BlockPattern
from orchestrator.method.coarse.rigid_first import RigidFirst
from orchestrator.method.interface.rows import bounds_of
from orchestrator.parallel.team import Team

WORTH = 1 << 10  # blocks, over which a loop takes much longer than to hand them out to a thread


class Assembly:
    """Sums of all ranks' slopes.

    ends : (I, 2) int, the two bodies of each interface, one rank's after the other's, each as many
        as ``counts`` says
    order : (I,) int, in which they are added up; rigid : as for the pattern
    pattern : of the matrices, on all ranks
    """

    def __init__(self, team: Team, ends: np.ndarray, counts: Sequence[int], bodies: int, size: int,
                 order: np.ndarray, rigid: int = 0):
        self.team, self.pattern = team, BlockPattern(ends, bodies, size, order, team, rigid)
        self._of: Any = None
        self._wants, self._gives, self.sums = {}, {}, self.pattern.sums[self.pattern.entering]
        if team.size == 1:
            return
        owner, starts, rank = self.pattern.elimination.owner, bounds_of(counts), team.rank
        wanted = [np.flatnonzero((owner[ends] == r).any(axis=1)) for r in range(team.size)]
        here = slice(starts[rank], starts[rank + 1])
        for other, theirs in enumerate(wanted):
            mine = theirs[(theirs >= here.start) & (theirs < here.stop)] - here.start
            if len(mine):
                self._gives[other] = mine
        # of each rank's interfaces among those that this one wants
        where = np.searchsorted(wanted[rank], starts)
        self._wants = {other: slice(a, b) for other, (a, b) in enumerate(zip(where[:-1], where[1:]))
                       if b > a}
        self.count = len(wanted[rank])
        self.sums = _of_some(self.sums, np.repeat(4 * wanted[rank], 4)
                             + np.tile(np.arange(4), self.count))

    def _wanted(self, slopes: np.ndarray) -> np.ndarray:
        """Those that enter this rank's fronts, of those that this rank counts."""
        rank = self.team.rank
        if self.team.size == 1:
            return slopes
        everyones = np.empty((self.count, *slopes.shape[1:]), slopes.dtype)
        if rank in self._gives:
            everyones[self._wants[rank]] = slopes[self._gives[rank]]
        self.team.exchange({other: slopes[mine] for other, mine in self._gives.items()
                            if other != rank},
                           {other: everyones[at] for other, at in self._wants.items()
                            if other != rank})
        return everyones

    def matrix(self, of: Any, answer: Answer) -> np.ndarray:
        """(k, size, size) K₀ − ΣTᵀA L, of the blocks that enter this rank's fronts; the next one
        takes its place.

        of : ``load_step.Bodies`` with some springs; others have another matrix
        answer : with the laws' derivative A, at the pairs that this rank adds up
        """
        fields, counted = of.summed[1], of.counted
        if anew := self._of is not of:
            self._of, self._derivative, self._slopes = of, np.full(
                (3, 3, len(fields.chosen)), np.inf), fields.no_slopes()
            self._values, self._stale = of.affine.copy(), np.ones(len(of.affine), bool)
        changed = fields.changed(answer, self._derivative) | anew
        fields.slopes(answer, of.weight, changed, self._slopes)
        slopes = self._slopes if len(counted) == len(changed) else self._slopes[counted]
        changed = changed[counted]
        if self.team.size > 1:
            slopes, before = self._wanted(slopes), None if anew else self._before
            changed = np.ones(len(slopes),
                              bool) if anew else (slopes != before).any(axis=(1, 2, 3, 4))
            self._before = slopes
        in_parts(formed, len(self._values), (self.sums.indptr, self.sums.indices), changed,
                 slopes.reshape(-1, *self._values.shape[1:]),
                 of.affine, self._values, self._stale, part=WORTH)
        return self._values

    def factors(self, matrix: np.ndarray, shift: float) -> Factors | RigidFirst:
        """Of (matrix + shift), what solves with it, in the place of the last one."""
        result = self.pattern.factors(matrix, shift, self._stale)
        self._stale[:] = False
        return result

    def values(self, slopes: np.ndarray, own: np.ndarray) -> np.ndarray:
        """(k, size, size) sums, of the blocks that enter fronts of this rank, with the bodies'
        ``own`` (bodies, size, size).

        slopes : (counted, 2, 2, size, size) of the interfaces that this rank counts
        """
        size, (place, bodies) = self.pattern.size, self.pattern.own
        result = (self.sums @ self._wanted(slopes).reshape(-1, size**2)).reshape(-1, size, size)
        result[place] += own[bodies]
        return result


def _of_some(sums: sp.csr_array, columns: np.ndarray) -> sp.csr_array:
    """Some columns (k,) of sums, ascending; those of a row stay in their sequence."""
    place = np.full(sums.shape[1], -1)
    place[columns] = np.arange(len(columns))
    kept = place[sums.indices] >= 0
    starts = bounds_of(kept)[sums.indptr]
    return sp.csr_array((sums.data[kept], place[sums.indices[kept]], starts),
                        shape=(sums.shape[0], len(columns)))
