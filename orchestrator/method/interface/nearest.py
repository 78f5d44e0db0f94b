"""Traces without jump that are nearest to given ones.

    min ½ ‖ŵ − w‖²_k + fᵀŵ   where   B ŵ = 0

What is prescribed stays what it is. One sparse factorisation, of blocks that do not couple, one per interface,

    [k  Bᵀ] [ŵ − w]   [ −f ]
    [B  0 ] [  q  ] = [−B w]

in which no side is to be inverted and no mesh need be the finer one.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.interface.rows import times


class Nearest:
    """The problem for interfaces that do not couple.

    Parameters
    ----------
    k : (n, n) sparse, stiffness of both sides' soles
    B : (Q, n) sparse
    held : (n,) bool, what is prescribed
    """

    def __init__(self, k: sp.csr_array, B: sp.csr_array, held: np.ndarray):
        self.k, self.B, self.free = k, B, np.flatnonzero(~held)
        self.unit = float(k.diagonal().mean())  # forces in units of displacements: pivots are compared with each other
        inside, across = k[self.free][:, self.free] / self.unit, B[:, self.free]
        self.factor = sla.splu(sp.csc_array(sp.block_array([[inside, across.T], [across, None]])))

    def moves(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ − w and f̂ = −Bᵀq, (T, n) each, of traces (T, n) and forces; f̂ = f + k(ŵ − w) but for what is prescribed."""
        right = np.hstack([-f[:, self.free] / self.unit, -times(self.B, w)])
        found = self.factor.solve(np.ascontiguousarray(right.T))
        move = np.zeros_like(w)
        move[:, self.free] = found[: len(self.free)].T
        return move, -self.unit * times(self.B.T, np.ascontiguousarray(found[len(self.free):].T))
