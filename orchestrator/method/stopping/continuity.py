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

    space : numbering
    weight : (B,) the diagonal D, positive
    """

    def __init__(self, space: TraceSpace, weight: np.ndarray):
        self.space, self.weight = space, weight
        self.class_weight = space.class_sums(weight[None])
        transfer = space.transfer
        apart = transfer.perfect & ~transfer.matched  # nodes do not match
        self.tied = bool(apart.any())
        here = np.repeat(apart, np.diff(transfer.bounds))
        self.points = np.flatnonzero(here & transfer.mine)  # of the first sides that are this rank's

    def __call__(self, u: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        """(T, B) δ of boundary displacements (T, B); ``known``: (T, D) prescribed traces, None where there are none."""
        space = self.space
        mean = space.class_sums(self.weight * u) / self.class_weight
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
        loose, none = np.ones((1, space.size)), not len(space.label)
        loose[0, space.held] = 0.0
        at = np.zeros(space.size, int) if none else space.label.take(space.gather)
        weight = np.ones(space.size) if none else self.class_weight[0].take(at)
        # class and weight of every trace dof, ghosts included
        (number, weight, loose), = space.extended(np.vstack([at if none else space.labels.take(at), weight, loose[0]]))
        B = sp.coo_array(space.transfer.B[self.points])
        row, dof = B.coords
        kept = loose[dof] > 0
        row, dof = row[kept], dof[kept]
        parts = team.all_gather((len(self.points), row, number[dof].astype(int), weight[dof], B.data[kept]))
        starts = np.cumsum([0] + [part[0] for part in parts])
        rows = np.concatenate([part[1] + a for part, a in zip(parts, starts)])
        classes, weights, values = (np.concatenate([part[i] for part in parts]) for i in (2, 3, 4))
        columns, place = np.unique(classes, return_inverse=True)
        inverse = np.empty(len(columns))
        inverse[place] = 1 / weights
        B = sp.csr_array((values, (rows, place)), shape=(int(starts[-1]), len(columns)))
        scaled = B @ sp.diags_array(inverse)
        _, there, local = np.intersect1d(space.labels, columns, assume_unique=True, return_indices=True)
        spread = sp.csc_array(scaled)[:, local].tocoo()
        spread = sp.csr_array((spread.data, (spread.row, there[spread.col])), shape=(B.shape[0], len(space.labels)))
        mine = np.arange(starts[team.rank], starts[team.rank] + len(self.points))
        return semidefinite_solver(scaled @ B.T), mine, spread
