"""What the nodes of both sides give way, C = (k⁺)⁻¹, and the search direction that it makes of points whose nodes do not match.

Blocks of C belong to nodes, and such points share nodes: d changes with f̂ by −S, S = B C Bᵀ, which is not diagonal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.laws.points import Points
from orchestrator.method.interface.transfer import Transfer

# λ is known to a hundredth: what a step may overshoot by costs nothing.
KNOWN = 1e-2


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
        dofs = np.concatenate([np.zeros((0, 3), int), *(dofs for dofs, _ in nodes)])
        blocks = np.concatenate([np.zeros((0, 3, 3)), *(blocks for _, blocks in nodes)])
        there = dofs >= 0
        result = cls(dofs, np.where(there[:, :, None] & there[:, None, :], blocks, 0.0), transfer.total)
        if not transfer.picks:
            result.coupling = sp.csr_array(transfer.B @ result.compliance @ transfer.B.T)
        return result

    @cached_property
    def compliance(self) -> sp.csr_array:
        """(D + G, D + G) C."""
        return self._placed(self.blocks)

    @cached_property
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

    def own(self, size: int) -> sp.csr_array:
        """(D, D) the part of C without ghosts."""
        return self.compliance if size == self.size else sp.csr_array(self.compliance[:size, :size])

    def _placed(self, blocks: np.ndarray) -> sp.csr_array:
        rows, columns = np.repeat(self.dofs[:, :, None], 3, axis=2), np.repeat(self.dofs[:, None, :], 3, axis=1)
        filled = blocks != 0
        return sp.csr_array((blocks[filled], (rows[filled], columns[filled])), shape=(self.size, self.size))


def node_blocks(matrix: sp.csr_array, dofs: np.ndarray) -> np.ndarray:
    """(n, 3, 3) diagonal blocks of a matrix at nodes with dofs (n, 3); zero where there is none, −1."""
    if not len(dofs):
        return np.zeros((0, 3, 3))
    row, column = np.repeat(dofs[:, :, None], 3, axis=2), np.repeat(dofs[:, None, :], 3, axis=1)
    values = np.asarray(matrix[row.ravel(), column.ravel()]).reshape(-1, 3, 3)
    return np.where((row >= 0) & (column >= 0), values, 0.0)


def inverses(blocks: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inverses of symmetric blocks on the components that are free, (n, 3) bool; zero on the others."""
    both = free[:, :, None] & free[:, None, :]
    held = np.where(free, 0.0, 1.0)[:, :, None] * np.eye(3)
    return np.where(both, np.linalg.inv(np.where(both, blocks, 0.0) + held), 0.0)


def search_stiffness(S: sp.csr_array, normal: np.ndarray, parts: Sequence[slice], usual: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(P,) keq along the normal and across it, from S (3P, 3P), so that keq S has no eigenvalue above 1 on any part.

    Parameters
    ----------
    normal : (3, P) unit
    parts : points of each interface: one eigenvalue for each
    usual : compliance of points where none carries anything, as of sides that have slid off each other
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
    along[idle], across[idle] = along.max() or usual, across.max() or usual
    points = Points(normal, 1 / np.sqrt(along), 1 / np.sqrt(across), np.ones(count))
    S, factor = sp.csr_array(S), np.ones(count)
    for part in parts:
        if not idle[part].all():
            chosen = (np.arange(3)[:, None] * count + np.arange(count)[part]).ravel()
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
