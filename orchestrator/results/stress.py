"""Strain, stress and von Mises stress of linear tetrahedra from nodal displacements.

Six components are in VTK's order xx, yy, zz, xy, yz, xz; shear strains are tensor
components ε_xy (half the engineering γ_xy).
"""

from __future__ import annotations

import numpy as np

# rows and columns of the six components in the 3×3 tensor
_ROW, _COLUMN = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])


def shape_gradients(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients of the four shape functions, and volumes.

    Parameters
    ----------
    nodes : (n, 3) float; cells : (m, 4) int

    Returns
    -------
    gradients : (m, 4, 3), 1/length; volumes : (m,), positive for positively oriented tets
    """
    corners = nodes[cells]
    a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    gradients = np.empty((len(cells), 4, 3))
    gradients[:, 1], gradients[:, 2], gradients[:, 3] = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    six_volumes = np.einsum("ij,ij->i", a, gradients[:, 1])
    gradients[:, 1:] /= six_volumes[:, None, None]
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    return gradients, six_volumes / 6.0


def strain(gradients: np.ndarray, cells: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """ε = ½(∇u + ∇uᵀ), constant per cell.

    Parameters
    ----------
    gradients : (m, 4, 3) of ``shape_gradients``; cells : (m, 4) int; displacement : (n, 3), length

    Returns
    -------
    (m, 6)
    """
    u = displacement[cells]
    gradient = np.matmul(u.transpose(0, 2, 1), gradients)  # [cell, i, j] = ∂u_i/∂x_j
    return 0.5 * (gradient[:, _ROW, _COLUMN] + gradient[:, _COLUMN, _ROW])


def stress(epsilon: np.ndarray, lame: np.ndarray) -> np.ndarray:
    """σ = λ tr(ε) I + 2μ ε.

    Parameters
    ----------
    epsilon : (m, 6) strains; lame : (m, 2) λ and μ per cell, force/length²

    Returns
    -------
    (m, 6), force/length²
    """
    sigma = 2.0 * lame[:, 1:] * epsilon
    sigma[:, :3] += (lame[:, 0] * epsilon[:, :3].sum(axis=1))[:, None]
    return sigma


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """√(½[(σxx−σyy)² + (σyy−σzz)² + (σzz−σxx)²] + 3[σxy² + σyz² + σxz²]): (..., 6) → (...)."""
    normal, shear = sigma[..., :3], sigma[..., 3:]
    differences = normal - np.roll(normal, -1, axis=-1)
    return np.sqrt(0.5 * (differences**2).sum(axis=-1) + 3.0 * (shear**2).sum(axis=-1))


def nodal_average(cells: np.ndarray, values: np.ndarray, volumes: np.ndarray,
                  group: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Volume-weighted average of cell values at the nodes, one value per node and group.

    Stress jumps from one material to the next: averaging across would hide that.

    Parameters
    ----------
    cells : (m, 4) int; values, volumes : (m,); group : (m,) int, e.g. the material

    Returns
    -------
    average : (k,), one per pair of node and group that occurs
    node : (k,) int, the node of each
    corner : (m, 4) int, index into ``average`` of every cell's corners
    """
    count = int(cells.max()) + 1
    key = group.astype(np.int64)[:, None] * count + cells
    present = np.zeros(int(key.max()) + 1, dtype=bool)
    present[key] = True
    pairs = np.flatnonzero(present)
    position = np.cumsum(present) - 1
    corner = position[key]
    weight = np.bincount(corner.ravel(), np.repeat(volumes, 4), len(pairs))
    total = np.bincount(corner.ravel(), np.repeat(volumes * values, 4), len(pairs))
    return total / weight, pairs % count, corner
