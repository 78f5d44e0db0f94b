"""Isotropic linear elasticity: Lamé's constants; strain, stress and von Mises stress of tetrahedra
from nodal displacements.

Six components are in VTK's order xx, yy, zz, xy, yz, xz; shear strains are tensor components ε_xy
(half the engineering γ_xy). In memory each component of all cells lies together, whatever the order
of the axes: long operations instead of many small products. Codes in a Python of their own import
this, so it needs numpy at most.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.quadratic import quadratic_slopes


def lame(young: float | np.ndarray, poisson: float
         | np.ndarray) -> tuple[float | np.ndarray, float | np.ndarray]:
    """Lamé's λ = E ν / ((1 + ν)(1 − 2ν)) and μ = E / (2 (1 + ν)), each in the unit and shape of
    Young's modulus E.

    Examples
    --------
    >>> lame(1.0, 0.25)
    (0.4, 0.4)
    """
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


CENTRE = np.full(4, 0.25)  # barycentric coordinates
# rows and columns of the six components in the 3×3 tensor
_ROW, _COLUMN = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])


def strain(gradients: np.ndarray, cells: np.ndarray, displacement: np.ndarray,
           at: np.ndarray = CENTRE) -> np.ndarray:
    """ε = ½(∇u + ∇uᵀ): constant in a four-node tet, linear in a ten-node one, so that the centre
    has the mean.

    gradients : (m, 4, 3) of ``shape_gradients``; cells : (m, 4 or 10) int; displacement : (n, 3),
        length
    at : (4,) barycentric coordinates of the point, a corner for instance
    Returns (m, 6)
    """
    u = displacement.T.take(cells.T, axis=1)
    if cells.shape[1] == 10:
        u = quadratic_slopes(at).T @ u
    slopes = gradients.transpose(1, 2, 0)

    def slope(i: int, j: int) -> np.ndarray:  # ∂u_i/∂x_j
        return np.einsum("km,km->m", u[i], slopes[:, j])

    epsilon = np.empty((6, len(cells)))
    for row, i, j in zip(epsilon, _ROW, _COLUMN):
        row[:] = slope(i, j) if i == j else 0.5 * (slope(i, j) + slope(j, i))
    return epsilon.T


def stress(epsilon: np.ndarray, lame: np.ndarray) -> np.ndarray:
    """σ = λ tr(ε) I + 2μ ε.

    epsilon : (m, 6) strains; lame : (m, 2) λ and μ per cell, force/length²
    Returns (m, 6), force/length²
    """
    sigma = 2.0 * lame[:, 1:] * epsilon
    sigma[:, :3] += (lame[:, 0] * epsilon[:, :3].sum(axis=1))[:, None]
    return sigma


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """√(½[(σxx−σyy)² + (σyy−σzz)² + (σzz−σxx)²] + 3[σxy² + σyz² + σxz²]): (..., 6) → (...)."""
    normal, shear = sigma[..., :3], sigma[..., 3:]
    differences = normal - np.roll(normal, -1, axis=-1)
    return np.sqrt(0.5 * (differences**2).sum(axis=-1) + 3.0 * (shear**2).sum(axis=-1))


def principal(sigma: np.ndarray) -> np.ndarray:
    """(..., 3) principal stresses, the largest first, of stresses (..., 6) in VTK's order; nan of
    nan.
    """
    matrix = sigma[..., [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    known = np.isfinite(matrix).all(axis=(-2, -1))
    result = np.full(sigma.shape[:-1] + (3,), np.nan)
    result[known] = np.linalg.eigvalsh(matrix[known])[..., ::-1]
    return result
