"""Coarse rigid repositioning: where floating subdomains fit best, c = argmin ‖B N (u + R c)‖_k.

Six unknowns per floating subdomain, solved on every rank: right for some thousands of them.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import narrow, times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.stopping.semidefinite import semidefinite_solver

RIGID = 6


class RigidModes:
    """Rigid motions of all subdomains that their supports leave, on a rank's dofs.

    space : numbering
    modes : per own subdomain (boundary dofs, r), r at most six
    boundary : (B, modes of all ranks) sparse
    own : int, the modes of this rank's subdomains
    """

    def __init__(self, space: TraceSpace, modes: list[np.ndarray]):
        counts = np.zeros(space.link.subdomain_count)
        counts[space.subdomains] = [m.shape[1] for m in modes]
        counts, = space.team.sum(counts)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        dense = np.zeros((RIGID, len(space.global_dof)))
        for part, mode in zip(space.boundary, modes):
            dense[: mode.shape[1], part] = mode.T
        self._space, self._starts = space, starts
        self._subdomain = np.repeat(space.subdomains, [s.stop - s.start for s in space.boundary])
        self.own = np.concatenate([np.arange(starts[e], starts[e + 1]) for e in space.subdomains] or [np.empty(0, int)])
        self.boundary = self._sparse(dense, self._subdomain)

    @property
    def traces(self) -> sp.csr_array:
        """(D + G, modes of all ranks), formed whenever asked: twice in a run at most. All ranks have to ask."""
        row = np.repeat(np.arange(len(self._subdomain)), np.diff(self.boundary.indptr))
        dense = np.zeros((RIGID, len(self._subdomain)))
        dense[self.boundary.indices - self._starts[self._subdomain[row]], row] = self.boundary.data
        traces, = self._space.extended(self._space.gathered(dense))
        return self._sparse(traces, self._space.owner)

    def _sparse(self, values: np.ndarray, owner: np.ndarray) -> sp.csr_array:
        rows = np.ascontiguousarray(values.T)
        there = rows != 0
        columns = (self._starts[owner][:, None] + np.arange(RIGID))[there]
        ends = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
        return narrow(sp.csr_array((rows[there], columns, ends), shape=(len(rows), self._starts[-1])))


class Repositioning:
    """The best rigid motions for given traces.

    space : numbering
    modes : the motions
    weight : (Q, Q) sparse, stiffness k at the points, in which jumps are measured
    """

    def __init__(self, space: TraceSpace, modes: RigidModes, weight: sp.csr_array):
        self.transfer, self.team = space.transfer, space.team
        one, two = self.transfer.rows(modes.traces)
        jumps, mine = sp.csr_array(two - one), self.transfer.mine
        self.forces = sp.csr_array((weight @ jumps)[mine])  # what is summed over the points is their first side's
        coarse = sp.csr_array(jumps[mine].T @ self.forces)
        self._solve = semidefinite_solver(sum(self.team.all_gather(coarse), sp.csr_array(coarse.shape)))

    def __call__(self, w: np.ndarray) -> np.ndarray:
        """(T, modes) c for traces (T, D + G)."""
        asked, = self.team.sum(times(self.forces.T, self.transfer.jump(w)[:, self.transfer.mine]))
        return self._solve(-asked)
