"""The mean of the sides: what makes displacements continuous over perfect interfaces with the least change.

    min ‖δ‖²_D   where   B N (u + δ) = 0

D is diagonal. Where nodes match, the copies of a node take their weighted mean. Where nodes of some interfaces do not,
these means v are changed in their turn,

    v − D_c⁻¹ Bᵀ (B D_c⁻¹ Bᵀ)⁻¹ B v

in one sparse problem of all their points, which share nodes at cross points. It is solved on every rank.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.stopping.semidefinite import semidefinite_solver


class Continuity:
    """The nearest continuous displacements.

    Parameters
    ----------
    space : numbering
    weight : (B,) the diagonal D, positive
    """

    def __init__(self, space: TraceSpace, weight: np.ndarray):
        self.space, self.weight = space, weight
        self.class_weight = space.class_sums(weight[None])
        transfer, none = space.transfer, np.empty(0, int)
        self.tied = bool((transfer.perfect & ~transfer.matched).any())
        if self.tied:
            counts = [b - a if p and not m else 0 for a, b, p, m in zip(
                transfer.bounds[:-1], transfer.bounds[1:], transfer.perfect, transfer.matched)]
            here = [np.arange(transfer.bounds[i], transfer.bounds[i + 1]) for i in np.flatnonzero(counts)]
            self.points = np.concatenate([none, *here])
            self.points = self.points[transfer.mine[self.points]]  # theirs is the first side

    def __call__(self, u: np.ndarray, known: np.ndarray | None = None, sums: np.ndarray | None = None) -> np.ndarray:
        """(T, B) δ of boundary displacements (T, B).

        Parameters
        ----------
        known : (T, D) prescribed traces; None where there are none
        sums : (T, classes) class sums of the weighted displacements, where they are known
        """
        space = self.space
        mean = (space.class_sums(self.weight * u) if sums is None else sums) / self.class_weight
        if self.tied:
            w = space.trace(mean.take(space.label, axis=1))
            jump = space.transfer.jump(space.extended(w if known is None else w + known)[0])[:, self.points]
            mean = mean - self._change(jump)
        return mean.take(space.label, axis=1) - u

    def _change(self, jump: np.ndarray) -> np.ndarray:
        """(T, classes) D_c⁻¹ Bᵀ (B D_c⁻¹ Bᵀ)⁻¹ of jumps (T, Q) at this rank's points."""
        solve, mine, spread = self._system
        right = np.zeros((len(jump), spread.shape[0]))
        right[:, mine] = jump
        right, = self.space.team.sum(right)
        return times(spread.T, solve(right))

    @cached_property
    def _system(self):
        """Solver of all points' problem, which of them are this rank's, and D_c⁻¹ B of this rank's classes."""
        space, team = self.space, self.space.team
        size = space.size
        loose = np.ones((1, size))
        loose[0, space.held] = 0.0
        at = space.label.take(space.gather) if len(space.label) else np.zeros(size, int)
        weight = self.class_weight[0].take(at) if len(space.label) else np.ones(size)
        # class and weight of every trace dof, ghosts included
        found, = space.extended(np.vstack([space.labels.take(at) if len(space.label) else at, weight, loose[0]]))
        number, weight, loose = found[0].astype(int), found[1], found[2]
        B = sp.coo_array(space.transfer.B[self.points])
        row, dof = B.coords
        kept = loose[dof] > 0
        row, dof, values = row[kept], dof[kept], B.data[kept]
        parts = team.all_gather((len(self.points), row, number[dof], weight[dof], values))
        starts = np.cumsum([0] + [part[0] for part in parts])
        rows = np.concatenate([part[1] + a for part, a in zip(parts, starts)])
        classes, weights, values = (np.concatenate([part[i] for part in parts]) for i in (2, 3, 4))
        columns, place = np.unique(classes, return_inverse=True)
        shape = (int(starts[-1]), len(columns))
        B = sp.csr_array((values, (rows, place)), shape=shape)
        inverse = np.empty(len(columns))
        inverse[place] = 1 / weights
        solve = semidefinite_solver(B @ sp.diags_array(inverse) @ B.T)
        local = np.searchsorted(columns, space.labels)
        there = np.flatnonzero((local < len(columns)) & (columns[np.minimum(local, len(columns) - 1)] == space.labels)) \
            if len(columns) else np.empty(0, int)
        spread = sp.csc_array(B @ sp.diags_array(inverse))[:, local[there]].tocoo()
        spread = sp.csr_array((spread.data, (spread.row, there[spread.col])), shape=(shape[0], len(space.labels)))
        mine = np.arange(starts[team.rank], starts[team.rank] + len(self.points))
        return solve, mine, spread
