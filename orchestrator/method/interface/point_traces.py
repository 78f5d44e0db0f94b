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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.compiled import Compiled, in_parts
from orchestrator.laws.points import Points
from orchestrator.method.interface import pair_loops
from orchestrator.method.interface.rows import times

if TYPE_CHECKING:
    from orchestrator.method.interface.pairs import Pairs

# λ is known to a hundredth: what a step may overshoot by costs nothing.
KNOWN = 1e-2


@dataclass
class PairTraces:
    """Traces at node pairs, of both sides and all load steps; zero where prescribed.

    Parameters
    ----------
    w, f : (T, D + G) traces
    """

    pairs: Pairs
    w: np.ndarray
    f: np.ndarray

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


@dataclass
class GeneralTraces:
    """The same where the nodes of some interface do not match.

    Parameters
    ----------
    w, f : (T, D + G) traces
    """

    pairs: Pairs
    w: np.ndarray
    f: np.ndarray

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


@dataclass
class NodeCompliance:
    """C = (k⁺)⁻¹ on the traces of interfaces.

    Parameters
    ----------
    compliance : (D + G, D + G) sparse, blocks of 3 × 3
    there : (D + G,) bool, traces of these interfaces
    coupling : (3P, 3P) sparse S = B C Bᵀ at their points
    of_laws : the same of the interfaces that are not perfect alone
    """

    compliance: sp.csr_array
    there: np.ndarray
    coupling: sp.csr_array | None = None
    of_laws: NodeCompliance | None = None

    @classmethod
    def of_interfaces(cls, nodes: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, bool]], size: int) -> NodeCompliance:
        """From the nodes of interfaces and sides: dofs (n, 3), blocks (n, 3, 3), which dofs there are (n, 3), and whether a
        law other than the perfect one governs them."""
        result = cls._of([n[:3] for n in nodes], size)
        lawful = [n[:3] for n in nodes if n[3]]
        result.of_laws = result if len(lawful) == len(nodes) else cls._of(lawful, size)
        return result

    @classmethod
    def _of(cls, nodes: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], size: int) -> NodeCompliance:
        at = np.concatenate([np.zeros((0, 3), int), *(dofs for dofs, _, _ in nodes)])
        values = np.concatenate([np.zeros((0, 3, 3)), *(blocks for _, blocks, _ in nodes)])
        rows, columns = np.repeat(at[:, :, None], 3, axis=2), np.repeat(at[:, None, :], 3, axis=1)
        filled = values != 0
        matrix = sp.csr_array((values[filled], (rows[filled], columns[filled])), shape=(size, size))
        there = np.zeros(size, dtype=bool)
        for dofs, _, exist in nodes:
            there[dofs[exist]] = True
        return cls(matrix, there)

    @cached_property
    def root(self) -> sp.csr_array:
        """C^½."""
        return _root(self.compliance)


def inverses(blocks: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inverses of symmetric blocks on the components that are free, (n, 3) bool; zero on the others."""
    both = free[:, :, None] & free[:, None, :]
    held = np.where(free, 0.0, 1.0)[:, :, None] * np.eye(3)
    return np.where(both, np.linalg.inv(np.where(both, blocks, 0.0) + held), 0.0)


def search_stiffness(S: sp.csr_array, normal: np.ndarray, parts: Sequence[slice]) -> tuple[np.ndarray, np.ndarray]:
    """(P,) keq along the normal and across it, from S (3P, 3P), so that keq S has no eigenvalue above 1 on any part.

    Parameters
    ----------
    normal : (3, P) unit
    parts : points of each interface: one eigenvalue for each
    """
    count = normal.shape[1]
    if not count:
        return np.zeros(0), np.zeros(0)
    component, point = np.divmod(np.arange(3 * count), count)
    entries = sp.coo_array(S)
    row, column = entries.coords
    own = point[row] == point[column]
    blocks = np.zeros((count, 3, 3))
    np.add.at(blocks, (point[row[own]], component[row[own]], component[column[own]]), entries.data[own])
    along = np.einsum("ip,pij,jp->p", normal, blocks, normal)
    across = (np.trace(blocks, axis1=1, axis2=2) - along) / 2
    idle = along <= 0  # points that carry nothing: any stiffness does
    along[idle], across[idle] = along.max() or 1.0, across.max() or 1.0
    points = Points(normal, 1 / np.sqrt(along), 1 / np.sqrt(across), np.ones(count))
    S, factor = sp.csr_array(S), np.ones(count)
    for part in parts:
        chosen = (np.arange(3)[:, None] * count + np.arange(count)[part]).ravel()
        if len(chosen):
            factor[part] = max(1.0, _largest(S[chosen][:, chosen], points.some(part)))
    return 1 / (along * factor), 1 / (across * factor)


def _largest(S: sp.csr_array, root: Points) -> float:
    """The largest eigenvalue of keq^½ S keq^½; ``root`` applies keq^½."""
    shape = (3, len(root))

    def apply(x: np.ndarray) -> np.ndarray:
        return root.stiffness(np.reshape(S @ root.stiffness(np.reshape(x, shape)).ravel(), shape)).ravel()

    if len(root) < 3:
        return float(np.linalg.eigvalsh(np.column_stack([apply(e) for e in np.eye(S.shape[0])]))[-1])
    start = np.random.default_rng(0).standard_normal(S.shape[0])
    operator = sla.LinearOperator(S.shape, matvec=apply, dtype=float)
    return float(sla.eigsh(operator, k=1, which="LA", tol=KNOWN, v0=start, return_eigenvectors=False)[0])


def _root(blocks: sp.csr_array) -> sp.csr_array:
    """The square root of a positive semidefinite matrix of small blocks."""
    count, label = sp.csgraph.connected_components(blocks, directed=False)
    order = np.argsort(label, kind="stable")
    place = np.empty(len(label), int)
    sizes = np.bincount(label, minlength=count)
    starts = np.cumsum(sizes) - sizes
    place[order] = np.arange(len(label)) - starts[label[order]]
    entries = sp.coo_array(blocks)
    row, column = entries.coords
    dense = np.zeros((count, 3, 3))
    dense[label[row], place[row], place[column]] = entries.data
    values, vectors = np.linalg.eigh(dense)
    roots = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.swapaxes(1, 2)
    return sp.csr_array((roots[label[row], place[row], place[column]], (row, column)), shape=blocks.shape)
