"""What bodies resist beside their affine fields, as their soles see it: the ends of σ in S x = σ k x, asked of the black box.

    C k = N M⁻¹ Nᵀ k = (S + k)⁻¹ k,    whose eigenvalues are θ = 1/(1 + σ)

A few steps of Lanczos' method in the inner product of k, all bodies side by side, each a back-substitution per body, on what is
orthogonal to affine fields. σ found so lie between the true ends.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.interface.rows import DEPENDENT, orthonormal
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.scene.model import Scene


class BesideAffine:
    """The bodies' fields beside the affine ones.

    on : (D,) 0 or 1, the traces that are looked at
    x : (B, 3) where boundary dofs are, from the middle of their body's, over half its extent
    U, V : (12, D) affine fields there, orthonormal in k, and k U
    """

    def __init__(self, scene: Scene, blackbox: GuardedTraces, on: np.ndarray):
        self.blackbox, self.on, self.of, self.space = blackbox, on, blackbox.owned, blackbox.direction.space
        self.x, component = _within(scene, self.space), self.space.global_dof % 3
        fields, at = np.zeros((12, len(component))), np.arange(len(component))
        for m, monomial in enumerate([np.ones(len(self.x)), *self.x.T]):
            fields[3 * m + component, at] = monomial
        self.U = on * self.space.trace(fields)
        self.V = blackbox.direction.times(self.U)
        for part in self.of.slices:
            turn = orthonormal(self.U[:, part] @ self.V[:, part].T).T
            self.U[:, part], self.V[:, part] = turn @ self.U[:, part], turn @ self.V[:, part]

    def rough(self) -> np.ndarray:
        """(B,) a displacement that depends on where nodes are in their body alone, and is as rough as the mesh: waves that no mesh
        resolves, numbers at random, but the same ones for whoever asks."""
        component, held = self.space.global_dof % 3, self.space.loads(self.on * self.blackbox.direction.diagonal[None])[0]
        phase = np.array([[7919.0, 6101.0, 4801.0], [5869.0, 7687.0, 5303.0], [6637.0, 4441.0, 7207.0]])[component]
        return np.cos(np.sum(phase * self.x, axis=1)) / np.sqrt(np.where(held > 0, held, 1.0))

    def bent(self) -> np.ndarray:
        """(B,) a displacement of second degree in the coordinates, with a part of all that there are: what is slender or thin
        bends and twists about so."""
        component, x = self.space.global_dof % 3, self.x.copy()
        for part in self.space.boundary:
            x[part] /= np.maximum(np.abs(x[part]).max(axis=0, initial=0.0), np.finfo(float).tiny)
        degrees = np.stack([x[:, i] * x[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))])
        shares = np.cos(1 + 2.4 * np.arange(18)).reshape(6, 3)  # numbers of either sign, of which none is the other
        return np.sum(shares[:, component] * degrees, axis=0)

    def ends(self, start: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """(S,) bool, of each body with traces whether it has anything beside affine fields, and (n, 2) least and largest σ
        of those that have.

        start : (B,) displacement to start from
        """
        of, space, product = self.of, self.space, lambda v: self.blackbox.direction.times(v[None])[0]
        start = self.on * space.trace(start[None])[0]
        beside = self._rest(start)
        before, left = (of.sums(v * product(v)) for v in (start, beside))
        exists = left > DEPENDENT * before
        theta = of.lanczos(np.where(of.spread(exists), beside, 0.0), product,
                           lambda kv: self._rest(self.on * self.blackbox.answered(space.loads(kv[None]))[1][0]), steps)
        tiny = np.finfo(float).eps
        return exists, np.maximum(1 / np.maximum(np.linalg.eigvalsh(theta[exists])[:, [-1, 0]], tiny) - 1, tiny)

    def _rest(self, v: np.ndarray) -> np.ndarray:
        """(D,) v without affine fields."""
        return v - np.sum(self.U * self.of.spread(self.of.sums(self.V * v)), axis=0)


def _within(scene: Scene, space: TraceSpace) -> np.ndarray:
    """``BesideAffine.x``."""
    x, result = scene.mesh.nodes[space.global_dof // 3], np.zeros((len(space.global_dof), 3))
    for part in space.boundary:
        if part.stop > part.start:
            low, high = x[part].min(axis=0), x[part].max(axis=0)
            result[part] = (x[part] - (low + high) / 2) / max(np.max(high - low) / 2, np.finfo(float).tiny)
    return result
