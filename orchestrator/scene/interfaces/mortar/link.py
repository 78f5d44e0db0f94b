"""The rigid link: each point is carried by the master like an arm, so that rigid motions open nothing.

Where the master's image P x₂ of a point is r away from the point, a rotation of both bodies would open it, and opposite
forces would be a couple. With ω the rotation of the master's facets, their least squares fit, averaged with the same
weights as P,

    (P̃ w₂)ᵢ = (P w₂)ᵢ + ωᵢ × rᵢ,    ω = H Σᵥ Yᵥ × wᵥ,    H = (Σᵥ |Yᵥ|² I − Yᵥ Yᵥᵀ)⁻¹,    Y = X − mean X,

and forces P̃ᵀ q have the resultant and the moment of q at the points.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.mesh.geometry import skew


def rotations(points: np.ndarray, triangles: np.ndarray) -> sp.csr_array:
    """(3k, 3n) the rotation ω of each facet, of displacements of its corners.

    points : (n, 3); triangles : (k, 3) int
    """
    arm = points[triangles] - points[triangles].mean(axis=1, keepdims=True)
    inertia = np.einsum("kvi,kvi->k", arm, arm)[:, None, None] * np.eye(3) - np.einsum("kvi,kvj->kij", arm, arm)
    blocks = np.linalg.inv(inertia)[:, None] @ skew(arm)  # (k, corner, 3, 3)
    return _blocks(blocks, np.arange(len(triangles)), triangles, (len(triangles), len(points)))


def linked(weights: sp.csr_array, facets: sp.csr_array, offset: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> sp.csr_array:
    """(3p, 3n) P ⊗ I with the rigid link.

    weights : (p, n) P; facets : (p, k) the weights with which facets give rotations; rows of both sum to 1
    offset : (p, 3) r; zero where there is no link
    points, triangles : the master's, (n, 3) and (k, 3)
    """
    plain = sp.csr_array(sp.kron(weights, sp.eye_array(3), format="csr"))
    at = np.flatnonzero(offset.any(axis=1))
    if not len(at):
        return plain
    turned = sp.kron(facets[at], sp.eye_array(3), format="csr") @ rotations(points, triangles)
    arms = _blocks(-skew(offset[at])[:, None], at, np.arange(len(at))[:, None], (len(offset), len(at)))  # ω × r = −r × ω
    return sp.csr_array(plain + arms @ turned)



def _blocks(blocks: np.ndarray, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> sp.csr_array:
    """Sparse matrix of 3 × 3 blocks (k, c, 3, 3) in the block rows (k,) and block columns (k, c)."""
    inner = np.arange(3)
    row = np.broadcast_to(3 * rows[:, None, None, None] + inner[:, None], blocks.shape)
    column = np.broadcast_to(3 * columns[:, :, None, None] + inner, blocks.shape)
    return sp.csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(3 * shape[0], 3 * shape[1]))
