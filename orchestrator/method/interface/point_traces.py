"""Traces at the points that laws work on, and back: where nodes match pair by pair, elsewhere through G₁ and G₂.

With k = k⁺ on both sides of a pair and d = w₂ − w₁, n from side 1 to side 2:

    F = ½(f₁ − f₂) + ½k(w₂ − w₁),   f̂ = law(F),   d = (F − f̂)/keq,   keq = k/2
    f̂₁ = f̂, f̂₂ = −f̂,   ŵ₁ = ½(w₁ + w₂) − (f₁ + f₂)/(2k) − d/2,   ŵ₂ = ŵ₁ + d

In general, with B = G₂ − G₁ and C = (k⁺)⁻¹ block diagonal per node, zero where a component is prescribed:

    q* = E f,   d* = B (w − C (f + Bᵀq*)),   F = q* + keq d*
    f̂ on the traces −Bᵀf̂,   ŵ = w + C (−Bᵀf̂ − f)

which is the same where G₁ and G₂ pick entries. d changes with f̂ by −S, S = B C Bᵀ, of which keq⁻¹ is the normal and the
tangential part at each point, times what makes it the larger of the two (``search_stiffness``): then f̂ ← law is a
step of a forward–backward iteration that never overshoots. What is found does not depend on C and keq: at a fixed point
(1 + kC)(f + Bᵀf̂) = 0, so that f = −Bᵀf̂, q* = f̂, d* = B w, and f̂ = law(f̂ + keq d) is the law itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.compiled import Compiled, in_parts
from orchestrator.method.interface import pair_loops
from orchestrator.method.interface.rows import times

if TYPE_CHECKING:
    from orchestrator.method.interface.pairs import Pairs


@dataclass
class _Traces:
    """Traces at points, of both sides and all load steps.

    Parameters
    ----------
    pairs : the points
    w, f : (T, D + G) traces
    """

    pairs: Pairs
    w: np.ndarray
    f: np.ndarray


class PairTraces(_Traces):
    """Traces at node pairs; zero where prescribed."""

    @cached_property
    def _both(self) -> tuple[np.ndarray, np.ndarray]:
        jump, force = np.empty((2, len(self.w), 3, len(self.pairs)))
        self._loop(pair_loops.at_pairs, *self._ends, self.w, self.f, jump, force)
        return jump, force

    @property
    def jump(self) -> np.ndarray:
        """(T, 3, P) w₂ − w₁."""
        return self._both[0]

    @property
    def force(self) -> np.ndarray:
        """(T, 3, P) force on side 1, ½(f₁ − f₂)."""
        return self._both[1]

    @property
    def _ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.pairs.transfer.one, self.pairs.transfer.two, self.pairs.free

    @property
    def _search(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.pairs.points.search

    def predicted(self) -> np.ndarray:
        """(T, 3, P) F, the search direction of eq. 10 with no jump."""
        F = np.empty_like(self.jump)
        self._loop(pair_loops.predicted, self.pairs.free, *self._search, self.jump, self.force, F)
        return F

    def hats(self, force: np.ndarray, jump: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, D) ŵ and f̂ of the sides for f̂ and d (T, 3, P); of ghosts, what the laws give is left out."""
        size = self.pairs.transfer.size
        w_hat, f_hat = np.zeros((2, len(self.w), size))
        self._loop(pair_loops.hats, *self._ends, size, *self._search, self.w, self.f, force, jump, w_hat, f_hat)
        return w_hat, f_hat

    def squares(self, force: np.ndarray) -> tuple[float, float, float]:
        """Of f − f̂, of f and of what both sides do not cancel, in the norm of (k⁺)⁻¹; what is this rank's to add up."""
        parts = self._loop(pair_loops.squares, *self._ends, self.pairs.mine, *self._search, self.f, force)
        return tuple(np.sum(parts, axis=0).tolist())

    def _loop(self, function: Compiled, *arguments) -> list:
        return in_parts(function, len(self.pairs), *arguments)


class GeneralTraces(_Traces):
    """The same where the nodes of some interface do not match."""

    @cached_property
    def jump(self) -> np.ndarray:
        """(T, 3, P) B w, and what sides that slide on have slid before they were paired anew."""
        return self._since(self.pairs.transfer.jump(self.w))

    @cached_property
    def force(self) -> np.ndarray:
        """(T, 3, P) E f."""
        return self.pairs.transfer.carried(self.f)

    def predicted(self) -> np.ndarray:
        """(T, 3, P) F."""
        transfer = self.pairs.transfer
        left = self.f - transfer.opposed(self.force)
        jump = self._since(transfer.jump(self.w - times(self.pairs.nodes.compliance, left)))
        return self.force + self.pairs.masked(self.pairs.points.stiffness(jump))

    def _since(self, jump: np.ndarray) -> np.ndarray:
        return jump if self.pairs.slid is None else jump + self.pairs.slid

    def hats(self, force: np.ndarray, jump: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As for pairs; zero on traces of other interfaces."""
        size, nodes = self.pairs.transfer.size, self.pairs.nodes
        f_hat = self.pairs.transfer.opposed(force)
        w_hat = np.where(nodes.there, self.w, 0.0) + times(nodes.compliance, f_hat - self.f)
        return w_hat[:, :size], f_hat[:, :size]

    def squares(self, force: np.ndarray) -> tuple[float, float, float]:
        """As for pairs."""
        transfer, size = self.pairs.transfer, self.pairs.transfer.size

        def norm2(x: np.ndarray) -> float:
            return 2 * float(np.vdot(x[:, :size], times(self.pairs.nodes.compliance, x)[:, :size]))

        return (norm2(self.f - transfer.opposed(force)), norm2(self.f), norm2(self.f - transfer.opposed(self.force)))
