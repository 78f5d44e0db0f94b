"""Linear elasticity on straight tets of four or ten nodes (VTK's order), written for studies and trials alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from orchestrator import Scene

# Four points that integrate degree two exactly over a tet, in barycentric coordinates; equal weights.
POINTS = np.full((4, 4), (5 - np.sqrt(5)) / 20) + np.eye(4) * np.sqrt(5) / 5
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
CENTRE = np.full(4, 0.25)


def lame(young: np.ndarray, poisson: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """λ and μ."""
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def barycentric(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (m, 4, 3) of the barycentric coordinates, and volumes (m,)."""
    x = nodes[cells[:, :4]]
    jacobian = x[:, 1:] - x[:, :1]
    inner = np.linalg.inv(jacobian)
    return np.concatenate([-inner.sum(2, keepdims=True), inner], 2).transpose(0, 2, 1), np.linalg.det(jacobian) / 6


def shape_gradients(linear: np.ndarray, count: int, at: np.ndarray) -> np.ndarray:
    """(m, count, 3) gradients of the shape functions of ``count`` nodes at barycentric coordinates (4,)."""
    if count == 4:
        return linear
    return np.concatenate([(4 * at - 1)[:, None] * linear,
                           np.stack([4 * (at[i] * linear[:, j] + at[j] * linear[:, i]) for i, j in EDGES], 1)], 1)


def stiffness(nodes: np.ndarray, cells: np.ndarray, young: np.ndarray, poisson: np.ndarray) -> sp.csr_array:
    """(3n, 3n), of four- or ten-node tets.

    Parameters
    ----------
    nodes : (n, 3); cells : (m, 4 or 10)
    young, poisson : (m,)
    """
    (linear, volume), (lam, mu), count = barycentric(nodes, cells), lame(young, poisson), cells.shape[1]
    local = np.zeros((len(cells), count, 3, count, 3))
    points = POINTS if count == 10 else CENTRE[None]
    for at in points:
        g, weight = shape_gradients(linear, count, at), volume / len(points)
        local += np.einsum("m,mai,mbj->maibj", weight * lam, g, g) + np.einsum("m,maj,mbi->maibj", weight * mu, g, g)
        local += np.einsum("m,mak,mbk,ij->maibj", weight * mu, g, g, np.eye(3))
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 3 * count)
    rows, columns = np.repeat(dofs, 3 * count, 1), np.tile(dofs, (1, 3 * count))
    return sp.csr_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(nodes.size, nodes.size))


def strain(nodes: np.ndarray, cells: np.ndarray, displacement: np.ndarray, at: np.ndarray = CENTRE) -> np.ndarray:
    """(m, 3, 3) strains of a displacement (n, 3) at barycentric coordinates of every cell."""
    g = shape_gradients(barycentric(nodes, cells)[0], cells.shape[1], at)
    gradient = np.einsum("mai,maj->mij", displacement[cells], g)
    return (gradient + gradient.transpose(0, 2, 1)) / 2


def stress(strains: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """(m, 3, 3) of strains (m, 3, 3)."""
    return lam[:, None, None] * np.trace(strains, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2 * mu[:, None, None] * strains


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """(…,) of stresses (…, 3, 3)."""
    deviator = sigma - np.trace(sigma, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) / 3
    return np.sqrt(1.5 * np.einsum("...ij,...ij", deviator, deviator))


def moduli(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """λ and μ (m,) of a scene's cells."""
    young, poisson = np.array([[m.young, m.poisson] for m in scene.materials]).T
    return lame(young[scene.cell_material], poisson[scene.cell_material])


def energy(scene: Scene, sides: Sequence[np.ndarray]) -> np.ndarray:
    """(T,) ‖u‖² in the energy norm of displacements (T, n_E, 3) of every subdomain."""
    lam, mu = moduli(scene)
    total = np.zeros(len(sides[0]))
    for s, own in zip(scene.subdomains, sides):
        nodes, points = scene.mesh.nodes[s.nodes], POINTS if s.connectivity.shape[1] == 10 else CENTRE[None]
        weight = barycentric(nodes, s.connectivity)[1] / len(points)
        for t, u in enumerate(own):
            for at in points:
                epsilon = strain(nodes, s.connectivity, u, at)
                total[t] += np.einsum("m,mij,mij->", weight, stress(epsilon, lam[s.cells], mu[s.cells]), epsilon)
    return total


def largest_von_mises(scene: Scene, displacement: np.ndarray, chosen: np.ndarray) -> float:
    """The largest von Mises stress of nodal stresses, which are means over the cells around, each of one matter and subdomain.

    Parameters
    ----------
    displacement : (T, n, 3)
    chosen : (n,) bool, nodes that count
    """
    mesh, (lam, mu) = scene.mesh, moduli(scene)
    kind = scene.cell_material * len(scene.subdomains) + scene.cell_subdomain
    node = np.unique(mesh.cells[:, :4].astype(np.int64) * (kind.max() + 1) + kind[:, None], return_inverse=True)[1].ravel()
    at_node = np.zeros(node.max() + 1, dtype=int)
    at_node[node] = mesh.cells[:, :4].ravel()
    volume, largest = barycentric(mesh.nodes, mesh.cells)[1], 0.0
    weights = np.bincount(node, np.repeat(volume, 4))
    for u in displacement:
        corner = np.stack([stress(strain(mesh.nodes, mesh.cells, u, at), lam, mu) for at in np.eye(4)], 1).reshape(-1, 9)
        mean = np.stack([np.bincount(node, np.repeat(volume, 4) * column) for column in corner.T], 1) / weights[:, None]
        largest = max(largest, float(von_mises(mean.reshape(-1, 3, 3))[chosen[at_node]].max()))
    return largest
