"""Matter's own answers: nodal forces of linear elastic tets from a model's mesh and moduli, without any code.

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
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.quadratic import TET_POINTS, quadratic_slopes


class Matter:
    """A model's linear elastic tets, P integration points in all.

    nodes : (n, 3) float
    cells : (m, 4 or 10) int, edges straight
    young, poisson : (m,) of each tet
    slopes : (3, 4 or 10, P) ∂φ_a/∂x_j of the tets' own shape functions, at [j, a, point]
    weight : (P,) volume
    lam, mu : (P,) Lamé's constants
    """

    def __init__(self, nodes: np.ndarray, cells: np.ndarray, young: np.ndarray, poisson: np.ndarray):
        gradients, volumes = shape_gradients(nodes, cells)
        slopes, points = gradients.transpose(2, 1, 0), TET_POINTS[cells.shape[1]]
        self.weight = np.tile(volumes / len(points), len(points))
        self.lam, self.mu = (np.tile(values, len(points)) for values in lame(young, poisson))
        if cells.shape[1] == 10:
            slopes = np.concatenate([np.einsum("xim,ai->xam", slopes, quadratic_slopes(p)) for p in points], axis=2)
        self.slopes, self.size = slopes, len(nodes)
        self._nodes = np.tile(cells.T, len(points))  # (4 or 10, P)

    @classmethod
    def of(cls, model: Model) -> "Matter":
        """The matter of a model."""
        return cls(model.nodes, model.cells, *model.materials[model.region].T)

    def forces(self, u: np.ndarray) -> np.ndarray:
        """Nodal forces (rhs, 3n) that hold displacements (rhs, 3n) in place."""
        sigma = self.stress(self.gradient(u))
        sigma *= self.weight[:, None, None]
        nodal = self._operator.T @ sigma.reshape(-1, 3 * len(u))
        return nodal.reshape(-1, 3, len(u)).transpose(2, 0, 1).reshape(len(u), -1)

    def stiffness(self) -> sp.csr_array:
        """(3n, 3n) symmetric, nothing clamped, dof = 3 * node + component: λ ∂ᵢφ ∂ⱼφ + μ ∂ⱼφ ∂ᵢφ + μ δᵢⱼ ∇φ·∇φ."""
        count = len(self.weight)
        along = [self._operator[x * count : (x + 1) * count] for x in range(3)]
        lam, mu = (sp.diags_array(self.weight * values) for values in (self.lam, self.mu))
        same = sum(a.T @ mu @ a for a in along)
        blocks = [[along[i].T @ lam @ along[j] + along[j].T @ mu @ along[i] + (same if i == j else 0 * same) for j in range(3)]
                  for i in range(3)]
        order = np.arange(3 * self.size).reshape(3, -1).T.ravel()  # component by component → node by node
        return sp.csr_array(sp.csr_array(sp.block_array(blocks))[order][:, order])

    def energies(self, u: np.ndarray) -> np.ndarray:
        """(rhs,) ∫ σ : ε, twice the strain energy, of displacements (rhs, 3n)."""
        gradient = self.gradient(u)
        density = self.stress(gradient)
        density *= gradient
        return np.einsum("jpcr,p->r", density, self.weight)

    def gradient(self, u: np.ndarray) -> np.ndarray:
        """(3, P, 3, rhs) derivatives ∂u_c/∂x_j, at [j, point, c], of displacements (rhs, 3n)."""
        columns = u.reshape(len(u), -1, 3).transpose(1, 2, 0).reshape(-1, 3 * len(u))
        return (self._operator @ columns).reshape(3, -1, 3, len(u))

    def stress(self, gradient: np.ndarray) -> np.ndarray:
        """(3, P, 3, rhs) σ = λ tr(ε) I + 2μ ε of derivatives of that shape."""
        sigma = self.mu[:, None, None] * (gradient + gradient.transpose(2, 1, 0, 3))
        pressure = self.lam[:, None] * (gradient[0, :, 0] + gradient[1, :, 1] + gradient[2, :, 2])
        for c in range(3):
            sigma[c, :, c] += pressure
        return sigma

    def forces_of_strain(self, strain: np.ndarray) -> np.ndarray:
        """(3n,) nodal forces that hold a uniform strain (3, 3): Σ w λ ∇φ tr(ε) + 2 Σ w μ ∇φ ε."""
        lam, mu = (np.stack([self._sum_on_nodes(slopes * (self.weight * values)) for slopes in self.slopes], axis=1)
                   for values in (self.lam, self.mu))
        return (np.trace(strain) * lam + 2 * mu @ strain).ravel()

    @cached_property
    def stiff(self) -> np.ndarray:
        """(n,) what a node opposes to a displacement of its own, the largest of its directions at most."""
        square = np.einsum("xap,xap->ap", self.slopes, self.slopes)
        square *= self.weight * (self.lam + 2 * self.mu)
        return self._sum_on_nodes(square)

    @cached_property
    def _operator(self) -> sp.csr_array:
        """(3P, n) derivatives along x, then y, then z of something given at the nodes."""
        rows, size = 3 * len(self.weight), len(self._nodes)
        return sp.csr_array((self.slopes.transpose(0, 2, 1).ravel(), np.tile(self._nodes.T.ravel(), 3),
                             np.arange(0, size * rows + 1, size)), shape=(rows, self.size))

    def _sum_on_nodes(self, values: np.ndarray) -> np.ndarray:
        """(n,) sums of values (4 or 10, P) of the tets' own nodes."""
        return np.bincount(self._nodes.ravel(), values.ravel(), minlength=self.size)
