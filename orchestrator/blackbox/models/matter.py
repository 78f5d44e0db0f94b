"""What matter itself answers: nodal forces of linear elastic tets from a model's mesh and moduli, without any code.

With B the gradients of the shape functions at the integration points and w their shares of volume, the forces are
f = Bᵀ w σ(B u). Four-node tets have constant gradients, one point; those of ten nodes linear ones, four points of the
rule that is exact for quadratics. Both are exact, so that codes are judged by them to rounding.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.scene.elasticity import lame
from orchestrator.scene.mesh.quadratic import quadratic_slopes

# barycentric coordinates of the integration points, by the number of nodes
_INNER = (5 - np.sqrt(5)) / 20
POINTS = {4: np.full((1, 4), 0.25), 10: np.full((4, 4), _INNER) + (1 - 4 * _INNER) * np.eye(4)}


class Matter:
    """A model's linear elastic tets, P integration points in all.

    Parameters
    ----------
    nodes : (n, 3) float
    cells : (m, 4 or 10) int, edges straight
    young, poisson : (m,) of each tet

    Attributes
    ----------
    gradient : (3P, n) sparse, derivatives along x, then y, then z of something given at the nodes
    weight : (P,) volume
    lam, mu : (P,) Lamé's constants
    """

    def __init__(self, nodes: np.ndarray, cells: np.ndarray, young: np.ndarray, poisson: np.ndarray):
        corners = nodes.T.take(cells[:, :4].T, axis=1)  # (3, 4, m)
        a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
        slopes = np.empty((3, 4, len(cells)))  # of the barycentric coordinates
        for i, (p, q) in enumerate(((b, c), (c, a), (a, b)), 1):
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                slopes[x, i] = p[y] * q[z] - p[z] * q[y]
        six_volumes = (a * slopes[:, 1]).sum(axis=0)
        slopes[:, 1:] /= six_volumes
        slopes[:, 0] = -slopes[:, 1:].sum(axis=1)
        points = POINTS[cells.shape[1]]
        self.weight = np.tile(six_volumes / (6 * len(points)), len(points))
        self.lam, self.mu = (np.tile(values, len(points)) for values in lame(young, poisson))
        if cells.shape[1] == 10:
            slopes = np.concatenate([np.einsum("xim,ai->xam", slopes, quadratic_slopes(p)) for p in points], axis=2)
        size = slopes.shape[1]
        indices = np.tile(np.tile(cells, (len(points), 1)).ravel(), 3)
        rows = 3 * len(self.weight)
        self.gradient = sp.csr_array((slopes.transpose(0, 2, 1).ravel(), indices, np.arange(0, size * rows + 1, size)),
                                     shape=(rows, len(nodes)))

    @classmethod
    def of(cls, model: Model) -> "Matter":
        """That of a model."""
        return cls(model.nodes, model.cells, *model.materials[model.region].T)

    def forces(self, u: np.ndarray) -> np.ndarray:
        """Nodal forces (rhs, 3n) that hold displacements (rhs, 3n) in place."""
        return self._on_nodes(self.stress(self.slopes(u)), len(u))

    def energies(self, u: np.ndarray) -> np.ndarray:
        """(rhs,) ∫ σ : ε, twice the strain energy, of displacements (rhs, 3n)."""
        slopes = self.slopes(u)
        density = self.stress(slopes)
        density *= slopes
        return np.einsum("jpcr,p->r", density, self.weight)

    def slopes(self, u: np.ndarray) -> np.ndarray:
        """(3, P, 3, rhs) derivatives ∂u_c/∂x_j, at [j, point, c], of displacements (rhs, 3n)."""
        columns = u.reshape(len(u), -1, 3).transpose(1, 2, 0).reshape(-1, 3 * len(u))
        return (self.gradient @ columns).reshape(3, -1, 3, len(u))

    def stress(self, slopes: np.ndarray) -> np.ndarray:
        """(3, P, 3, rhs) σ = λ tr(ε) I + 2μ ε of derivatives of that shape."""
        sigma = self.mu[:, None, None] * (slopes + slopes.transpose(2, 1, 0, 3))
        pressure = self.lam[:, None] * (slopes[0, :, 0] + slopes[1, :, 1] + slopes[2, :, 2])
        for c in range(3):
            sigma[c, :, c] += pressure
        return sigma

    def affine_forces(self) -> np.ndarray:
        """(3n, 12) nodal forces that hold uniform displacements and uniform gradients; columns as ``affine`` has them."""
        lam, mu = (self._on_nodes_scalar(values) for values in (self.lam, self.mu))  # (n, 3): Σ w λ ∇φ, Σ w μ ∇φ
        forces = np.zeros((len(lam), 3, 4, 3))  # node, component, {1, x_j}, c
        for j in range(3):
            for c in range(3):  # u_c = x_j
                forces[:, c, 1 + j, c] += mu[:, j]
                forces[:, j, 1 + j, c] += mu[:, c]
                if c == j:
                    forces[:, :, 1 + j, c] += lam
        return forces.reshape(-1, 12)

    @cached_property
    def stiff(self) -> np.ndarray:
        """(n,) what a node opposes to a displacement of its own, the largest of its directions at most."""
        slopes = self.gradient.data.reshape(3, len(self.weight), -1)
        square = np.einsum("xpa,xpa->pa", slopes, slopes)
        square *= (self.weight * (self.lam + 2 * self.mu))[:, None]
        return np.bincount(self.gradient.indices[: square.size], square.ravel(), minlength=self.gradient.shape[1])

    def _on_nodes(self, sigma: np.ndarray, rhs: int) -> np.ndarray:
        sigma *= self.weight[:, None, None]
        nodal = self.gradient.T @ sigma.reshape(-1, 3 * rhs)
        return nodal.reshape(-1, 3, rhs).transpose(2, 0, 1).reshape(rhs, -1)

    def _on_nodes_scalar(self, values: np.ndarray) -> np.ndarray:
        points = len(self.weight)
        return np.stack([self.gradient[j * points : (j + 1) * points].T @ (self.weight * values) for j in range(3)], axis=1)


def affine(nodes: np.ndarray) -> np.ndarray:
    """(3n, 12) displacements u_c = 1, x, y and z about the middle, c = 0, 1, 2 each."""
    shape = np.column_stack([np.ones(len(nodes)), nodes - (nodes.min(axis=0) + nodes.max(axis=0)) / 2])
    return np.einsum("nk,dc->ndkc", shape, np.eye(3)).reshape(-1, 12)
