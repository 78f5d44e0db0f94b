"""Local stage of perfect interfaces whose nodes do not match: ŵ without jump, f̂ from forces of the points.

    min ½ ‖ŵ − w‖²_k + fᵀŵ   where   B ŵ = 0,   B = G₂ − G₁,
    f̂ = −Bᵀ q,      s = f̂ + k ŵ

with k⁺ = k⁻ = k, each side its own; ``nearest`` solves it. Where nodes match and both sides have the same sole it is the
exchange s₁ = k w₂ − f₂.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.nearest import Nearest
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.search_direction import SearchDirection


class Tied:
    """The perfect interfaces of a general transfer whose nodes do not match.

    Parameters
    ----------
    direction : search direction k⁻

    Attributes
    ----------
    dofs : (n,) int, their trace dofs, ghosts included; empty where there are none
    own : (n,) bool, which of these are no ghosts
    """

    def __init__(self, direction: SearchDirection):
        self.direction, space = direction, direction.space
        transfer, none = space.transfer, np.empty(0, int)
        self.chosen = [
            index for index in np.flatnonzero(~transfer.matched) if space.perfect[index] and len(transfer.sides[index][0])]
        self.dofs = np.concatenate([none, *(side for index in self.chosen for side in transfer.sides[index])])
        self.own = self.dofs < space.size
        if not transfer.picks:
            self.held = space.held_everywhere[self.dofs]  # all ranks ask

    def __len__(self) -> int:
        return len(self.dofs)

    def __call__(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s, ŵ and f̂, each (T, n), from traces with ghosts (T, D + G)."""
        w, f = w[:, self.dofs], f[:, self.dofs]
        move, f_hat = self._nearest.moves(w, f)
        w_hat = w + move
        return f_hat + times(self._nearest.k, w_hat), w_hat, f_hat

    @cached_property
    def _nearest(self) -> Nearest:
        transfer = self.direction.space.transfer
        points = np.concatenate([np.arange(transfer.bounds[index], transfer.bounds[index + 1]) for index in self.chosen])
        return Nearest(sp.csr_array(self.direction.whole[self.dofs][:, self.dofs]),
                       sp.csr_array(transfer.B[points][:, self.dofs]), self.held)
