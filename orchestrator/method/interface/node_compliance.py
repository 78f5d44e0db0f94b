"""What the nodes of both sides give way where they do not match, C = (k⁺)⁻¹, and the search direction that it makes of points.

Blocks of C belong to nodes, and points share nodes: d changes with f̂ by −S, S = B C Bᵀ, which is not diagonal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.laws.points import Points

# λ is known to a hundredth: what a step may overshoot by costs nothing.
KNOWN = 1e-2


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
