"""Operators of points on the traces of both sides, as sparse matrices: of node pairs, and of sides that do not match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import Mortar

# Forces of points are read from mass matrices that condition well: their solutions' far entries fade below this.
FADED = 1e-14


@dataclass(frozen=True)
class Products:
    """Sparse operators (Q, D + G) of all points of a scene: G₁, G₂, and E, which reads the points' forces, E (−Bᵀ) = 1."""

    G1: sp.csr_array
    G2: sp.csr_array
    E: sp.csr_array

    def rows(self, chosen: sp.csr_array | np.ndarray) -> Products:
        """Some of the rows, by number, or combined by a matrix."""
        if sp.issparse(chosen):
            return Products(*(sp.csr_array(chosen @ G) for G in (self.G1, self.G2, self.E)))
        return Products(*(sp.csr_array(G[chosen]) for G in (self.G1, self.G2, self.E)))


def unit_rows(at: np.ndarray, size: int) -> sp.csr_array:
    """(Q, size) unit rows with their entries at columns (Q,), empty ones for −1."""
    there = at >= 0
    return sp.csr_array((np.ones(there.sum()), at[there], np.concatenate([[0], np.cumsum(there)])), shape=(len(at), size))


def stacked(blocks: Sequence[Products]) -> Products:
    return Products(*(sp.csr_array(sp.vstack([getattr(block, name) for block in blocks])) for name in ("G1", "G2", "E")))


def of_pairs(one: np.ndarray, two: np.ndarray, size: int) -> Products:
    """Of an interface whose nodes match, on the trace dofs of its sides."""
    first, second = unit_rows(one, size), unit_rows(two, size)
    return Products(first, second, 0.5 * (first - second))


def of_mortar(mortar: Mortar, one: np.ndarray, two: np.ndarray, size: int) -> Products:
    """Of an interface whose nodes do not match, on the trace dofs of its sides."""
    return Products(*(sp.csr_array((G.data, dofs[G.indices], G.indptr), shape=(G.shape[0], size)) for G, dofs in (
        (mortar.first, one), (mortar.second, two), (_reads(mortar), one))))


def _reads(mortar: Mortar) -> sp.csr_array:
    """(3p, 3n₁) sparse: own⁻ᵀ hatsᵀ; empty rows where a point carries nothing now."""
    own = mortar.own
    if mortar.diagonal:
        share = own.diagonal()
        return sp.csr_array(sp.diags_array(np.divide(1, share, out=np.zeros_like(share), where=share > 0)) @ mortar.hats.T)
    inverse = np.linalg.inv(own[::3, ::3].toarray()).T  # the same for every component
    inverse[np.abs(inverse) < FADED * np.abs(inverse).max()] = 0.0
    return sp.csr_array(sp.kron(inverse, sp.eye_array(3), format="csr") @ mortar.hats.T)
