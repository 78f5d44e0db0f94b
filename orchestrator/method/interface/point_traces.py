"""Traces at the points that laws work on, and back: through G₁ and G₂.

With B = G₂ − G₁, C = (k⁺)⁻¹ block diagonal per node, zero where a component is prescribed, and E
that reads the forces of points from traces,

    q* = E f,   d* = B (w − C (f + Bᵀq*)),   F = q* + keq d*
    f̂ = law(F) at the points, −Bᵀf̂ on the traces,   d = (F − f̂)/keq,   ŵ = w + C (−Bᵀf̂ − f)

Where G₁ and G₂ pick the nodes of pairs this is, with k = k⁺ on both sides, d = w₂ − w₁ and n from
side 1 to side 2,

    F = ½(f₁ − f₂) + ½k(w₂ − w₁),   keq = k/2,
    ŵ₁ = w₁ + (f̂ − f₁)/k,   ŵ₂ = w₂ − (f̂ + f₂)/k = ŵ₁ + d

Elsewhere points share nodes, and d changes with f̂ by −S, S = B C Bᵀ, of which keq⁻¹ is the normal
and the tangential part at each point, times what makes it the larger of the two: then f̂ ← law is a
step of a forward–backward iteration that never overshoots. What is found does not depend on C and
keq: at a fixed point (1 + kC)(f + Bᵀf̂) = 0, so that f = −Bᵀf̂, q* = f̂, d* = B w, and f̂ = law(f̂
+ keq d) is the law itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Points
from orchestrator.method.interface.rows import eigenvalue, rows_of, times
from orchestrator.method.interface.transfer import Transfer


@dataclass
class NodeCompliance:
    """C = (k⁺)⁻¹ on the traces (D + G) of interfaces."""

    # (n, 3) int, the trace dofs of the nodes of both sides, −1 where there is none
    dofs: np.ndarray
    blocks: np.ndarray  # (n, 3, 3) C at these, zero where there is none
    size: int  # D + G

    @classmethod
    def of(cls, nodes: Sequence[tuple[np.ndarray, np.ndarray]],
           transfer: Transfer) -> NodeCompliance:
        """Point traces from the dofs and blocks of several sides; what blocks have where there is
        no dof does not count.
        """
        dofs, blocks = (np.concatenate(same)
                        for same in zip((np.zeros((0, 3), int), np.zeros((0, 3, 3))), *nodes))
        there = dofs >= 0
        return cls(dofs, np.where(there[:, :, None] & there[:, None, :], blocks, 0.0),
                   transfer.total)

    @cached_property
    def compliance(self) -> sp.csr_array:
        """(D + G, D + G) C."""
        return self._placed(self.blocks)

    @property
    def root(self) -> sp.csr_array:
        """(D + G, D + G) C^½."""
        values, vectors = np.linalg.eigh(self.blocks)
        return self._placed((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])
                            @ vectors.swapaxes(1, 2))

    @cached_property
    def there(self) -> np.ndarray:
        """(D + G,) bool, traces of these interfaces."""
        result = np.zeros(self.size, dtype=bool)
        result[self.dofs[self.dofs >= 0]] = True
        return result

    def some(self, traces: np.ndarray) -> NodeCompliance:
        """Return those of some of the interfaces, traces (D + G,) bool."""
        own = (traces[self.dofs] & (self.dofs >= 0)).any(axis=1)
        return NodeCompliance(self.dofs[own], self.blocks[own], self.size)

    def _placed(self, blocks: np.ndarray) -> sp.csr_array:
        rows, columns = np.repeat(self.dofs[:, :, None], 3,
                                  axis=2), np.repeat(self.dofs[:, None, :], 3, axis=1)
        filled = blocks != 0
        return sp.csr_array((blocks[filled], (rows[filled], columns[filled])),
                            shape=(self.size, self.size))


@dataclass
class PointTraces:
    """Traces at points, of both sides and all load steps."""

    transfer: Transfer  # the points, and C
    points: Points
    nodes: NodeCompliance
    slid: np.ndarray  # (3, P) what B w lacks of the jump
    w: np.ndarray  # (T, D + G) traces
    f: np.ndarray

    @cached_property
    def jump(self) -> np.ndarray:
        """(T, 3, P) B w, and what sides that slide on have slid before they were paired anew."""
        return self.transfer.jump(self.w) + self.slid

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
            jump = self.transfer.jump(self.w - times(self.nodes.compliance, left)) + self.slid
        return self.force + np.where(self.transfer.exists, self.points.stiffness(jump), 0.0)

    def hats(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, D) ŵ and f̂ of the sides for f̂ (T, 3, P) at the points; zero on traces of other
        interfaces.
        """
        size = self.transfer.size
        f_hat = self.transfer.opposed(force)
        w_hat = np.where(self.nodes.there, self.w,
                         0.0) + times(self.nodes.compliance, f_hat - self.f)
        return np.ascontiguousarray(w_hat[:, :size]), np.ascontiguousarray(f_hat[:, :size])

    def squares(self, force: np.ndarray) -> tuple[float, float, float]:
        """Squares of f − f̂, of f and of the sides' imbalance, in the norm of (k⁺)⁻¹; this rank's
        share of the sums.
        """
        size = self.transfer.size
        C = self.nodes.compliance if size == self.transfer.total else self.nodes.compliance[
            :size, :size]
        return tuple(2 * share * float(np.vdot(x, times(C, x))) for share, x in (
            (1.0, (self.f - self.transfer.opposed(force))[:, :size]), (1.0, self.f[:, :size]),
            (0.5, self.transfer.imbalance(self.f))))


def node_blocks(matrix: sp.csr_array, dofs: np.ndarray) -> np.ndarray:
    """(n, 3, 3) diagonal blocks of a matrix at nodes with dofs (n, 3); zero where there is none,
    −1.
    """
    if not len(dofs):
        return np.zeros((0, 3, 3))
    row, column = np.repeat(dofs[:, :, None], 3, axis=2), np.repeat(dofs[:, None, :], 3, axis=1)
    values = np.asarray(matrix[row.ravel(), column.ravel()]).reshape(-1, 3, 3)
    return np.where((row >= 0) & (column >= 0), values, 0.0)


def inverses(blocks: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inverses of symmetric blocks on the components that are free, (n, 3) bool; zero on
    the others.
    """
    both = free[:, :, None] & free[:, None, :]
    held = np.where(free, 0.0, 1.0)[:, :, None] * np.eye(3)
    return np.where(both, np.linalg.inv(np.where(both, blocks, 0.0) + held), 0.0)


def search_stiffness(S: sp.csr_array, points: Points, parts: Sequence[np.ndarray],
                     usual: float) -> None:
    """Sets keq along the normal and across it, from S (3P, 3P), so that keq S has no eigenvalue
    above 1 on any part.

    parts : points of each interface whose nodes do not match: one eigenvalue for each
    usual : compliance of points where none carries anything, as of sides that have slid off each
        other
    """
    for at in parts:
        dofs = rows_of(at, len(points))
        own, normal, count = S[dofs][:, dofs], points.normal[:, at], len(at)
        blocks = node_blocks(own, np.arange(3 * count).reshape(3, -1).T)
        along = np.einsum("ip,pij,jp->p", normal, blocks, normal)
        each = np.einsum("pii->pi", blocks)
        # a missing component takes the mean of the others
        across = (each.sum(axis=1) * 3 / np.maximum((each > 0).sum(axis=1), 1) - along) / 2
        idle = along <= 0  # points that carry nothing: any stiffness does
        along[idle], across[idle] = along.max(initial=0.0) or usual, across.max(
            initial=0.0) or usual
        root = Points(normal, 1 / np.sqrt(along), 1 / np.sqrt(across), np.ones(count))
        factor = 1.0 if idle.all() else max(1.0, _largest(own, root))
        points.stiff_n[at], points.stiff_t[at] = 1 / (along * factor), 1 / (across * factor)


def _largest(S: sp.csr_array, root: Points) -> float:
    """The largest eigenvalue of keq^½ S keq^½; ``root`` applies keq^½."""
    shape = (3, len(root))

    def apply(x: np.ndarray) -> np.ndarray:
        return root.stiffness(np.reshape(S @ root.stiffness(np.reshape(x, shape)).ravel(),
                                         shape)).ravel()

    if len(root) < 3:
        return float(
            np.linalg.eigvalsh(np.column_stack([apply(e) for e in np.eye(S.shape[0])]))[-1])
    return eigenvalue(apply, S.shape[0], "LA")
