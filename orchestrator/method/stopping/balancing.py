"""Forces that push no floating subdomain: self-balanced force fields per interface, of least norm.

The macro problem has seen to it where its basis holds the rigid motions; the mono-scale strategy leaves it to this
one problem of all subdomains.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.macro import both_sides
from orchestrator.method.linear.macro_basis import known_widths
from orchestrator.method.stopping.repositioning import RigidModes
from orchestrator.method.stopping.semidefinite import semidefinite_solver

# Resultants above this fraction of the forces need the coarse balance: those forces are as small as the error, so that
# what rounding leaves of the interface forces shows; b² is known to 2 %, and smaller resultants change 1e-5 of it at most.
UNBALANCED = 1e-7
BALANCED = 1e-6  # of the resultants, what may be left after it
DEPENDENT = 1e-10  # singular value of a force field, over the largest, that counts as zero


class Balancing:
    """Balances forces on the rigid motions of the subdomains; made ready when it is first needed.

    Parameters
    ----------
    space : numbering
    modes : rigid motions of all subdomains
    """

    def __init__(self, space: TraceSpace, modes: RigidModes):
        self.space, self.modes = space, modes
        self._prepared = None

    def __call__(self, change: np.ndarray) -> tuple[np.ndarray, bool]:
        """Forces (T, D) with what balances them, and whether they are balanced then."""
        team, modes = self.space.team, self.modes.boundary
        resultant, scale = team.sum(times(modes.T, self.space.loads(change)),
                                    times(np.abs(modes.T), self.space.loads(np.abs(change))))
        tiny = np.finfo(float).tiny
        if not resultant.size or np.abs(resultant).max() <= UNBALANCED * max(scale.max(), tiny):
            return change, True
        spread, work, solve = self._prepared = self._prepared or self._prepare()
        change = change + times(spread, times(work.T, solve(-resultant)))
        left, = team.sum(times(modes.T, self.space.loads(change)))
        return change, bool(np.abs(left).max() <= BALANCED * max(np.abs(resultant).max(), tiny))

    def _prepare(self):
        """Force fields (D, m), their work in the motions (modes, m), and the solver of the least norm."""
        space, traces, bases = self.space, self.modes.traces, []
        bounds, (one, two) = space.transfer.bounds, space.transfer.rows(traces)
        for a, b in zip(bounds[:-1], bounds[1:]):  # the motions of either side span the fields
            block = sp.csc_array(one[a:b] if one[a:b].nnz else two[a:b])
            local = block[:, np.flatnonzero(np.diff(block.indptr))].toarray()
            left, s, _ = np.linalg.svd(local, full_matrices=False) if local.size else (local, np.zeros(0), None)
            bases.append(left[:, s > DEPENDENT * s.max(initial=0.0)])
        spread = both_sides(space, known_widths(bases, space.team), (1.0, -1.0))
        work = sp.csr_array(traces[: space.size].T @ spread)
        work = sum(space.team.all_gather(work), sp.csr_array(work.shape))
        return spread, work, semidefinite_solver(work @ work.T)
