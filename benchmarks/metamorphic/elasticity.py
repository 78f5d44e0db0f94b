"""The stiffness of linear elasticity on straight tets, written for the trials alone."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

# Four points that integrate degree two exactly over a tet, in barycentric coordinates; equal weights.
POINTS = np.full((4, 4), (5 - np.sqrt(5)) / 20) + np.eye(4) * np.sqrt(5) / 5
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def stiffness(nodes: np.ndarray, cells: np.ndarray, young: np.ndarray, poisson: np.ndarray) -> sp.csr_array:
    """(3n, 3n), of four- or ten-node tets.

    Parameters
    ----------
    nodes : (n, 3); cells : (m, 4 or 10), VTK's order
    young, poisson : (m,)
    """
    x = nodes[cells[:, :4]]
    jacobian = x[:, 1:] - x[:, :1]
    volume = np.linalg.det(jacobian) / 6
    inner = np.linalg.inv(jacobian)
    linear = np.concatenate([-inner.sum(2, keepdims=True), inner], 2).transpose(0, 2, 1)  # (m, 4, 3)
    lam, mu = young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
    count = cells.shape[1]
    local = np.zeros((len(cells), count, 3, count, 3))
    for at in POINTS if count == 10 else [None]:
        g = linear if at is None else np.concatenate([
            (4 * at - 1)[:, None] * linear, np.stack([4 * (at[i] * linear[:, j] + at[j] * linear[:, i]) for i, j in EDGES], 1)], 1)
        weight = volume if at is None else volume / 4
        local += np.einsum("m,mai,mbj->maibj", weight * lam, g, g) + np.einsum("m,maj,mbi->maibj", weight * mu, g, g)
        local += np.einsum("m,mak,mbk,ij->maibj", weight * mu, g, g, np.eye(3))
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 3 * count)
    rows, columns = np.repeat(dofs, 3 * count, 1), np.tile(dofs, (1, 3 * count))
    return sp.csr_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(nodes.size, nodes.size))
