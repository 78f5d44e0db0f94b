"""The mean of the sides: what makes displacements continuous over perfect interfaces with the least
change.

    min ‖δ‖²_D   where   B N (u + δ) = 0

D is diagonal. Where nodes match, the copies of a node take their weighted mean v. Where nodes of
some interfaces do not, or where more is asked of traces, C w = c, these means are changed in their
turn,

    v − D_c⁻¹ Cᵀ (C D_c⁻¹ Cᵀ)⁻¹ (C w − c)

in one sparse problem of all that is asked, of points that share nodes at cross points. It is solved
on every rank.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.sparse.symmetric import semidefinite_solver
from orchestrator.method.interface.rows import bounds_of, ratio, times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.parallel.team import Team

# solves with a matrix that rounding makes regular: each leaves some 1e-10 of what the one before
# has
REFINED = 8
ROUNDED = 1e-15  # of an entry over its diagonal ones: none


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
        # of the first sides that are this rank's
        self.points = np.flatnonzero(here & transfer.mine)

    def __call__(self, u: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        """(T, B) δ of boundary displacements (T, B); ``known``: (T, D) prescribed traces, None
        where there are none.
        """
        mean = self.means(u)
        if self.tied:
            jump = self.space.transfer.jump(self.traces(mean, known))
            mean = mean - self._joined.held(jump[:, self.points])
        return self.of_means(mean) - u

    def means(self, u: np.ndarray) -> np.ndarray:
        """(T, classes) the weighted means of boundary displacements (T, B) over the copies of each
        node.
        """
        return self.space.class_sums(self.weight * u) / self.class_weight

    def size(self, mean: np.ndarray) -> float:
        """This rank's part of ‖v‖²_D of means v (1, classes)."""
        return float(self.weight @ self.of_means(mean)[0] ** 2)

    def of_means(self, mean: np.ndarray) -> np.ndarray:
        """(T, B) boundary displacements of means (T, classes)."""
        return mean.take(self.space.label, axis=1)

    def traces(self, mean: np.ndarray, known: np.ndarray | None) -> np.ndarray:
        """(T, D + G) of means (T, classes) and prescribed traces (T, D)."""
        return self.space.everywhere(self.of_means(mean), known)

    @cached_property
    def rows(self) -> sp.csr_array:
        """(p, D + G) the jump at those points of perfect interfaces whose nodes do not match."""
        return self.space.transfer.B[self.points]

    @cached_property
    def _joined(self) -> Constraint:
        return self.constrained(self.rows)

    def constrained(self, rows: sp.csr_array) -> Constraint:
        """Return what holds C w where it is asked for; all ranks have to ask; ``rows``: C (r, D +
        G), this
        rank's.
        """
        space, team = self.space, self.space.team
        number, weight, mobile = self._traces
        row, dof = sp.coo_array(rows).coords
        kept = mobile[dof] > 0
        row, dof, data = row[kept], dof[kept], sp.coo_array(rows).data[kept]
        parts = team.all_gather((rows.shape[0], row, number[dof], weight[dof], data))
        starts = bounds_of([part[0] for part in parts])
        row = np.concatenate([part[1] + a for part, a in zip(parts, starts)])
        classes, weights, values = (np.concatenate([part[i] for part in parts]) for i in (2, 3, 4))
        columns, place = np.unique(classes, return_inverse=True)
        inverse = np.empty(len(columns))
        inverse[place] = 1 / weights
        C = sp.csr_array((values, (row, place)), shape=(int(starts[-1]), len(columns)))
        scaled = C @ sp.diags_array(inverse)
        _, there, local = np.intersect1d(space.labels, columns, assume_unique=True,
                                         return_indices=True)
        spread = sp.csc_array(scaled)[:, local].tocoo()
        spread = sp.csr_array((spread.data, (spread.row, there[spread.col])),
                              shape=(C.shape[0], len(space.labels)))
        return Constraint(scaled @ C.T,
                          np.arange(starts[team.rank], starts[team.rank] + rows.shape[0]), spread,
                          team)

    @cached_property
    def _traces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Class, weight and whether it is free of every trace dof, ghosts included (D + G,)."""
        space, none = self.space, not len(self.space.label)
        loose = np.ones(space.size)
        loose[space.held] = 0.0
        at = np.zeros(space.size, int) if none else space.label.take(space.gather)
        weight = np.ones(space.size) if none else self.class_weight[0].take(at)
        (number, weight,
         loose), = space.extended(np.vstack([at if none else space.labels.take(at), weight, loose]))
        return number.astype(int), weight, loose


class Constraint:
    """The change of means that makes C w what it has to be, with the least D-weighted change.

    matrix : (r, r) C D⁻¹ Cᵀ of all ranks, which may be singular, and what it gives way by; mine :
        (r',) int, this rank's rows
    spread : (r, classes) C D⁻¹ of this rank's classes
    """

    def __init__(self, matrix: sp.csr_array, mine: np.ndarray, spread: sp.csr_array, team: Team):
        self.matrix, self.mine, self.spread, self.team = matrix, mine, spread, team

    def some(self, pick: sp.csr_array, soft: sp.csr_array) -> Constraint:
        """Return what holds combinations P C w, but for what they give way by; all ranks have to
        ask.

        pick : P (s, r'), this rank's; soft : (s, s) symmetric, how far unit forces move what holds
            them
        """
        parts = self.team.all_gather((pick, soft))
        starts = bounds_of([one.shape[0] for one, _ in parts])
        if len(parts) > 1:
            pick, soft = (sp.block_diag(same) for same in zip(*parts))
        matrix = (pick @ self.matrix @ pick.T + soft).tocoo()
        (row, column), root = matrix.coords, np.sqrt(matrix.diagonal())
        # directions at a point are orthogonal but for rounding
        there = np.abs(matrix.data) > ROUNDED * root[row] * root[column]
        matrix = sp.csr_array((matrix.data[there], (row[there], column[there])), shape=matrix.shape)
        return Constraint(matrix, np.arange(*starts[self.team.rank: self.team.rank + 2]),
                          pick @ self.spread, self.team)

    @cached_property
    def solve(self) -> Callable[[np.ndarray], np.ndarray]:
        """Rows (T, r) to rows. Most have nothing to do with any other: these are divided."""
        alone, diagonal = np.diff(self.matrix.indptr) == 1, self.matrix.diagonal()
        alone &= diagonal > 0
        rest = np.flatnonzero(~alone)
        solve = semidefinite_solver(self.matrix[rest][:, rest], patches=True)

        def solved(rows: np.ndarray) -> np.ndarray:
            result = ratio(rows, diagonal, alone)
            result[:, rest] = solve(rows[:, rest])
            return result
        return solved

    def moved(self, forces: np.ndarray) -> np.ndarray:
        """(T, classes) what forces (T, r') take from means, D⁻¹ Cᵀ x."""
        return times(self.spread.T, self._of_all(forces))

    def _of_all(self, own: np.ndarray) -> np.ndarray:
        """(T, r) from every rank's rows (T, r')."""
        result = np.zeros((len(own), self.matrix.shape[0]))
        result[:, self.mine] = own
        return self.team.sum(result)[0]

    def held(self, lack: np.ndarray) -> np.ndarray:
        """(T, classes) to be taken from means whose C w is more than it has to be by ``lack`` (T,
        r'), this rank's."""
        left = self._of_all(lack)
        total = np.zeros_like(left)
        for _ in range(REFINED):
            found = self.solve(left)
            total, left = total + found, left - times(self.matrix, found)
        return times(self.spread.T, total)
