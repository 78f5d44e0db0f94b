"""The mean of the sides: what makes displacements continuous over perfect interfaces with the least change.

    min ‖δ‖²_D   where   B N (u + δ) = 0

D is diagonal. Where nodes match, the copies of a node take their weighted mean v. Where nodes of some interfaces do not, or where more
is asked of traces, C w = c, these means are changed in their turn,

    v − D_c⁻¹ Cᵀ (C D_c⁻¹ Cᵀ)⁻¹ (C w − c)

in one sparse problem of all that is asked, of points that share nodes at cross points. It is solved on every rank.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.factor import semidefinite_solver
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.parallel.team import Team

LOOSE = 1e4  # compliance of what may differ, over the largest of the others
REFINED = 8  # solves with a matrix that rounding makes regular: each leaves some 1e-10 of what the one before has


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
        mean = self.means(u)
        if self.tied:
            mean = mean - self._joined(self.jump(mean, known)[:, self.points])
        return self.of_means(mean) - u

    def means(self, u: np.ndarray) -> np.ndarray:
        """(T, classes) the weighted means of boundary displacements (T, B) over the copies of each node."""
        return self.space.class_sums(self.weight * u) / self.class_weight

    def of_means(self, mean: np.ndarray) -> np.ndarray:
        """(T, B) boundary displacements of means (T, classes)."""
        return mean.take(self.space.label, axis=1)

    def traces(self, mean: np.ndarray, known: np.ndarray | None) -> np.ndarray:
        """(T, D + G) of means (T, classes) and prescribed traces (T, D)."""
        w = self.space.trace(self.of_means(mean))
        return self.space.extended(w if known is None else w + known)[0]

    def jump(self, mean: np.ndarray, known: np.ndarray | None) -> np.ndarray:
        """(T, Q) of means (T, classes) and prescribed traces (T, D)."""
        return self.space.transfer.jump(self.traces(mean, known))

    @property
    def rows(self) -> sp.csr_array:
        """(p, D + G) the jump at those points of perfect interfaces whose nodes do not match."""
        return sp.csr_array(self.space.transfer.B[self.points])

    @cached_property
    def _joined(self) -> Constraint:
        return self.constrained(self.rows)

    def constrained(self, rows: sp.csr_array, loose: sp.csr_array | None = None) -> Constraint:
        """What holds C w where it is asked for; all ranks have to ask.

        rows : C (r, D + G), this rank's
        loose : (r, k) unit columns that C w may differ by; None: none
        """
        space, team = self.space, self.space.team
        number, weight, mobile = self._traces
        row, dof = sp.coo_array(rows).coords
        kept = mobile[dof] > 0
        row, dof, data = row[kept], dof[kept], sp.coo_array(rows).data[kept]
        parts = team.all_gather((rows.shape[0], row, number[dof], weight[dof], data))
        starts = np.cumsum([0] + [part[0] for part in parts])
        row = np.concatenate([part[1] + a for part, a in zip(parts, starts)])
        classes, weights, values = (np.concatenate([part[i] for part in parts]) for i in (2, 3, 4))
        columns, place = np.unique(classes, return_inverse=True)
        inverse = np.empty(len(columns))
        inverse[place] = 1 / weights
        C = sp.csr_array((values, (row, place)), shape=(int(starts[-1]), len(columns)))
        scaled = C @ sp.diags_array(inverse)
        matrix = sp.csr_array(scaled @ C.T)
        for rank, free in enumerate(team.all_gather(loose)):
            if free is not None:
                at = sp.csr_array((np.ones(free.shape[0]), (starts[rank] + np.arange(free.shape[0]), np.arange(free.shape[0]))),
                                  shape=(C.shape[0], free.shape[0])) @ free
                matrix = sp.csr_array(matrix + LOOSE * matrix.diagonal().max() * (at @ at.T))
        _, there, local = np.intersect1d(space.labels, columns, assume_unique=True, return_indices=True)
        spread = sp.csc_array(scaled)[:, local].tocoo()
        spread = sp.csr_array((spread.data, (spread.row, there[spread.col])), shape=(C.shape[0], len(space.labels)))
        return Constraint(matrix, np.arange(starts[team.rank], starts[team.rank] + rows.shape[0]), spread, team)

    @cached_property
    def _traces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Class, weight and whether it is free of every trace dof, ghosts included (D + G,)."""
        space, none = self.space, not len(self.space.label)
        loose = np.ones(space.size)
        loose[space.held] = 0.0
        at = np.zeros(space.size, int) if none else space.label.take(space.gather)
        weight = np.ones(space.size) if none else self.class_weight[0].take(at)
        (number, weight, loose), = space.extended(np.vstack([at if none else space.labels.take(at), weight, loose]))
        return number.astype(int), weight, loose


class Constraint:
    """The change of means that makes C w what it has to be, with the least D-weighted change.

    matrix : (r, r) C D⁻¹ Cᵀ of all ranks, which may be singular; mine : (r',) int, this rank's rows
    spread : (r, classes) C D⁻¹ of this rank's classes
    """

    def __init__(self, matrix: sp.csr_array, mine: np.ndarray, spread: sp.csr_array, team: Team):
        self.matrix, self.mine, self.spread, self.team, self.solve = matrix, mine, spread, team, semidefinite_solver(matrix)

    def __call__(self, lack: np.ndarray) -> np.ndarray:
        """(T, classes) to be taken from means whose C w is more than it has to be by ``lack`` (T, r'), this rank's."""
        left = np.zeros((len(lack), self.matrix.shape[0]))
        left[:, self.mine] = lack
        left, = self.team.sum(left)
        total = np.zeros_like(left)
        for _ in range(REFINED):
            found = self.solve(left)
            total, left = total + found, left - times(self.matrix, found)
        return times(self.spread.T, total)
