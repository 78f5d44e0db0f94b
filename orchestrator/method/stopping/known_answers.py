"""Fields whose forces are known: the macro problem's answers, which need not be found again.

With M = S + k, V = M⁻¹F the answers of each subdomain to the macro forces F = NᵀG,

    S V = F − k V

They are smooth: what is soft beside the soles is among them. Forces h are answered in them at once,
x = V (VᵀS V)⁺Vᵀh, and what remains converges in half the steps.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.interface.rows import orthonormal, peak, ColumnSegments
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.linear.macro import by_blocks, Macro

ROUNDED = 1e-13  # of forces: what a difference of theirs has lost


class KnownAnswers:
    """The answers of one decomposition.

    macro : the macro problem, solved
    direction : search direction k⁻
    """

    def __init__(self, macro: Macro, direction: SearchDirection):
        self.direction, self.blocks, self.inverse = direction, macro.blocks, []
        soles = direction.robin_blocks(range(len(direction.space.boundary)))
        for b in self.blocks:
            each = []
            for e, V, F in zip(b.members, b.answers, b.forces):
                k = soles[e]
                meant = V @ F.T  # beside it, rounding leaves energy of what has none
                turn = orthonormal(meant - V @ (k @ V.T), peak(meant))
                each.append(turn @ turn.T)
            self.inverse.append(np.stack(each))

    def answered(self, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, B) x, and what is left of forces (T, B): nothing where rounding has left it."""
        of = ColumnSegments(self.direction.space.boundary)
        V, F = self._combined(h)
        left = h - F + self.direction.robin(V)
        there = of.sums(left**2) > ROUNDED**2 * of.sums(F**2 + h**2)
        return V, np.where(of.spread(there), left, 0.0)

    def beside(self, x: np.ndarray, kx: np.ndarray,
               mx: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fields x (T, B) and M x, orthogonal to the answers in S; kx, mx : (T, B) k x and M x."""
        V, F = self._combined(mx - kx)
        return x - V, mx - F

    def _combined(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, B) V c and F c, c = (VᵀS V)⁺Vᵀ times forces (T, B)."""
        V, F = np.zeros_like(forces), np.zeros_like(forces)
        for b, inverse in zip(self.blocks, self.inverse):
            c = by_blocks(by_blocks(forces[:, b.columns], b.answers.transpose(0, 2, 1)), inverse)
            V[:, b.columns], F[:, b.columns] = by_blocks(c, b.answers), by_blocks(c, b.forces)
        return V, F
