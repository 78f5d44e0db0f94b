"""How far solutions on two meshes are apart, where one mesh contains the other: where tets have been halved.

Every tet of the finer mesh is within one of the coarser, so that stresses of both, constant or linear in every tet, are integrated exactly:

    ‖u₂ − u₁‖² = Σ ∫ (σ₂ − σ₁) : C⁻¹ (σ₂ − σ₁)      over the tets of the finer mesh
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.mesh import Mesh

NEAR = 8, 64, 512  # coarser tets with the nearest centres, one of which has a finer one within: few first, then more
WITHIN = -1e-6  # barycentric coordinates that rounding leaves of zero


@dataclass(frozen=True)
class Stressed:
    """A solution at one load step.

    nodes : (n, 3); cells : (m, 4) int, corners; volume : (m,) int, the volumes that they are of
    stress : (6, p, m), constant, p = 1, or linear, at the corners, p = 4
    """

    nodes: np.ndarray
    cells: np.ndarray
    volume: np.ndarray
    stress: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, estimator: Estimator, displacement: np.ndarray) -> Stressed:
        """displacement : (N, 3), one subdomain after another."""
        return cls(mesh.nodes, mesh.cells[:, :4], mesh.volume, estimator.stress(displacement))

    def apart(self, before: Stressed, estimator: Estimator) -> float | None:
        """Squared distance from the solution on a coarser mesh, in the energy norm; None where that does not contain this mesh.

        estimator : on this mesh
        """
        corners = self.nodes[self.cells]
        parent = before._holding(corners.mean(axis=1), self.volume)
        if parent is None:
            return None
        gradients, _ = shape_gradients(before.nodes, before.cells)
        from_centre = corners - before.nodes[before.cells].mean(axis=1)[parent, None]
        place = 0.25 + np.einsum("mpi,mai->mpa", from_centre, gradients[parent])  # (m, 4, 4) barycentric
        if place.min(initial=0.0) < WITHIN:
            return None
        theirs = before.stress[:, :, parent]
        if theirs.shape[1] == 4:
            theirs = np.einsum("mpa,cam->cpm", place, theirs)
        return float(estimator.energies_of(self.stress - theirs).sum())

    def _holding(self, points: np.ndarray, volume: np.ndarray) -> np.ndarray | None:
        """(k,) which of the tets has each of some points (k, 3) of its volumes (k,) within; None where one is in none."""
        centres, gradients = self.nodes[self.cells].mean(axis=1), shape_gradients(self.nodes, self.cells)[0]
        far = 10 * float(np.ptp(self.nodes, axis=0).max())  # bodies may be inside each other
        tree = cKDTree(np.column_stack([centres, far * self.volume]))
        found, left = np.empty(len(points), dtype=int), np.arange(len(points))
        for count in NEAR:
            count = min(count, len(centres))
            near = tree.query(np.column_stack([points[left], far * volume[left]]), count)[1].reshape(len(left), count)
            least = (0.25 + np.einsum("kci,kcai->kca", points[left, None] - centres[near], gradients[near])).min(axis=2)
            best = least.argmax(axis=1)
            found[left] = near[np.arange(len(left)), best]
            left = left[least.max(axis=1) < WITHIN]
            if not len(left):
                return found
        return None
