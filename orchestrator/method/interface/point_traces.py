"""Traces at the points that laws work on, and back: through G₁ and G₂.

With B = G₂ − G₁, C = (k⁺)⁻¹ block diagonal per node, zero where a component is prescribed, and E that reads the forces of
points from traces,

    q* = E f,   d* = B (w − C (f + Bᵀq*)),   F = q* + keq d*
    f̂ = law(F) at the points, −Bᵀf̂ on the traces,   d = (F − f̂)/keq,   ŵ = w + C (−Bᵀf̂ − f)

Where G₁ and G₂ pick the nodes of pairs this is, with k = k⁺ on both sides, d = w₂ − w₁ and n from side 1 to side 2,

    F = ½(f₁ − f₂) + ½k(w₂ − w₁),   keq = k/2,   ŵ₁ = w₁ + (f̂ − f₁)/k,   ŵ₂ = w₂ − (f̂ + f₂)/k = ŵ₁ + d

Elsewhere points share nodes, and d changes with f̂ by −S, S = B C Bᵀ, of which keq⁻¹ is the normal and the tangential part at
each point, times what makes it the larger of the two: then f̂ ← law is a step of a forward–backward iteration that never
overshoots. What is found does not depend on C and keq: at a fixed point (1 + kC)(f + Bᵀf̂) = 0, so that f = −Bᵀf̂, q* = f̂,
d* = B w, and f̂ = law(f̂ + keq d) is the law itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Points
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.transfer import Transfer


@dataclass
class NodeCompliance:
    """C = (k⁺)⁻¹ on the traces (D + G) of interfaces.

    Parameters
    ----------
    dofs : (n, 3) int, the trace dofs of the nodes of both sides, −1 where there is none
    blocks : (n, 3, 3) C at these, zero where there is none
    size : D + G
    coupling : (3P, 3P) sparse S = B C Bᵀ at their points; None where nodes match on all of them: keq⁻¹ says it
    """

    dofs: np.ndarray
    blocks: np.ndarray
    size: int
    coupling: sp.csr_array | None = None

    @classmethod
    def of(cls, nodes: Sequence[tuple[np.ndarray, np.ndarray]], transfer: Transfer) -> NodeCompliance:
        """From the dofs and blocks of several sides; what blocks have where there is no dof does not count."""
        dofs, blocks = (np.concatenate(same) for same in zip((np.zeros((0, 3), int), np.zeros((0, 3, 3))), *nodes))
        there = dofs >= 0
        result = cls(dofs, np.where(there[:, :, None] & there[:, None, :], blocks, 0.0), transfer.total)
        if not transfer.picks:
            result.coupling = sp.csr_array(transfer.B @ result.compliance @ transfer.B.T)
        return result

    @cached_property
    def compliance(self) -> sp.csr_array:
        """(D + G, D + G) C."""
        return self._placed(self.blocks)

    @property
    def root(self) -> sp.csr_array:
        """(D + G, D + G) C^½."""
        values, vectors = np.linalg.eigh(self.blocks)
        return self._placed((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.swapaxes(1, 2))

    @cached_property
    def there(self) -> np.ndarray:
        """(D + G,) bool, traces of these interfaces."""
        result = np.zeros(self.size, dtype=bool)
        result[self.dofs[self.dofs >= 0]] = True
        return result

    def some(self, traces: np.ndarray, points: np.ndarray, count: int) -> NodeCompliance:
        """Of some of the interfaces: traces (D + G,) bool, points (R,) int of all that there are."""
        at = (np.arange(3)[:, None] * count + points).ravel()
        own = (traces[self.dofs] & (self.dofs >= 0)).any(axis=1)
        return NodeCompliance(self.dofs[own], self.blocks[own], self.size,
                              None if self.coupling is None else sp.csr_array(self.coupling[at][:, at]))

    def _placed(self, blocks: np.ndarray) -> sp.csr_array:
        rows, columns = np.repeat(self.dofs[:, :, None], 3, axis=2), np.repeat(self.dofs[:, None, :], 3, axis=1)
        filled = blocks != 0
        return sp.csr_array((blocks[filled], (rows[filled], columns[filled])), shape=(self.size, self.size))


@dataclass
class PointTraces:
    """Traces at points, of both sides and all load steps.

    Parameters
    ----------
    transfer, points, nodes : the points, and C
    slid : (3, P) what B w lacks of the jump; None: nothing
    w, f : (T, D + G) traces
    """

    transfer: Transfer
    points: Points
    nodes: NodeCompliance
    slid: np.ndarray | None
    w: np.ndarray
    f: np.ndarray

    @cached_property
    def jump(self) -> np.ndarray:
        """(T, 3, P) B w, and what sides that slide on have slid before they were paired anew."""
        return self._since(self.transfer.jump(self.w))

    @cached_property
    def force(self) -> np.ndarray:
        """(T, 3, P) E f."""
        return self.transfer.carried(self.f)

    def predicted(self) -> np.ndarray:
        """(T, 3, P) F, the search direction of eq. 10 with no jump."""
        if self.transfer.picks:  # what both sides' C f differ by is nothing
            jump = self.jump
        else:
            left = self.f - self.transfer.opposed(self.force)
            jump = self._since(self.transfer.jump(self.w - times(self.nodes.compliance, left)))
        return self.force + np.where(self.transfer.exists, self.points.stiffness(jump), 0.0)

    def hats(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, D) ŵ and f̂ of the sides for f̂ (T, 3, P) at the points; zero on traces of other interfaces."""
        size = self.transfer.size
        f_hat = self.transfer.opposed(force)
        w_hat = np.where(self.nodes.there, self.w, 0.0) + times(self.nodes.compliance, f_hat - self.f)
        return np.ascontiguousarray(w_hat[:, :size]), np.ascontiguousarray(f_hat[:, :size])

    def squares(self, force: np.ndarray) -> tuple[float, float, float]:
        """Of f − f̂, of f and of what both sides do not cancel, in the norm of (k⁺)⁻¹; what is this rank's to add up."""
        size = self.transfer.size
        C = self.nodes.compliance if size == self.transfer.total else sp.csr_array(self.nodes.compliance[:size, :size])
        return tuple(2 * share * float(np.vdot(x, times(C, x))) for share, x in (
            (1.0, (self.f - self.transfer.opposed(force))[:, :size]), (1.0, self.f[:, :size]), (0.5, self.transfer.imbalance(self.f))))

    def _since(self, jump: np.ndarray) -> np.ndarray:
        return jump if self.slid is None else jump + self.slid
