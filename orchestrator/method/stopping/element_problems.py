"""Estimate of the discretisation error of ten-node tets by a small problem in each (Bank and Weiser).

What the stress σ of a solution leaves of balance, its divergence and body force b inside of a tet T, and half of the leap of
its traction [σn] on faces between two tets, loads the tet by itself. Displacements e that are cubic and zero at the tet's ten
nodes, ten functions per component, answer it:

    ∫_T ε(e) : C ε(v) = ∫_T (div σ + b) · v − ½ Σ_faces ∫ [σn] · v     for all such v,      η²_T = ∫_T ε(e) : C ε(e)

On faces of one tet alone v is zero. So neither loads on faces nor the tractions of contact, of supports and of bonds between meshes
that do not match have to be known as fields. Across perfect interfaces the traction is continuous, between two materials as well.

``tests/test_element_problems.py`` holds it against the truth.

R. E. Bank, A. Weiser, Some a posteriori error estimators for elliptic partial differential equations, Math. Comp. 44, 1985,
283–301.
"""

from __future__ import annotations

import numpy as np
from scipy.special import roots_jacobi

from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.scene.mesh.quadratic import DEGREE_4, TET_EDGES
from orchestrator.scene.model import Scene

FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # corners of the face opposite to each corner
CHUNK = 5_000  # tets at once: some 15 kB each
_TENSOR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # which of a stress's six components stand where in the tensor


class ElementProblems(Estimator):
    """The estimate for a whole mesh of ten-node tets, called as ``Estimator`` is.

    body_force : (T, m, 3) force/volume, the mean of each cell in the order of ``cells``; None where there is none
    """

    body_force: np.ndarray | None = None

    @classmethod
    def of(cls, scene: Scene) -> ElementProblems:
        made = super().of(scene)
        made.body_force = None if scene.body_force is None else scene.body_force[:, made.order]
        made._prepare()
        return made

    def _prepare(self) -> None:
        """Corners of every tet in the order of their labels, so that both sides of a face have it in the same order."""
        label = self.joined[self.cells[:, :4]]
        self.turn = np.argsort(label, axis=1)
        label = np.take_along_axis(label, self.turn, 1)
        self.slopes = np.take_along_axis(self.gradients, self.turn[:, :, None], 1)
        n = int(label.max(initial=0)) + 1
        corners = label[:, FACES].reshape(-1, 3)
        _, face = np.unique(corners[:, 0] * n + corners[:, 1], return_inverse=True)
        order = np.lexsort((corners[:, 2], face.ravel()))
        same = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
        mate = np.full(len(corners), -1)
        mate[order[:-1][same]], mate[order[1:][same]] = order[1:][same], order[:-1][same]
        self.mate = mate.reshape(-1, 4)

    def _squares(self, sigma: np.ndarray, number: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        energy = super()._squares(sigma)[1]
        corners = np.take_along_axis(sigma[:, :4].transpose(2, 1, 0), self.turn[:, :, None], 1)  # (m, 4, 6)
        tensors = corners[:, :, _TENSOR]
        vectors = -3 * self.volumes[:, None, None] * self.slopes  # of the faces, outward, as long as their areas
        tractions = np.einsum("mfcij,mfj->mfci", tensors[:, FACES], vectors)
        leap = tractions + tractions.reshape(-1, 3, 3)[self.mate]
        leap[self.mate < 0] = 0.0
        inside = np.einsum("maij,maj->mi", tensors, self.slopes)
        if self.body_force is not None and number is not None:
            inside += self.body_force[number]
        load = np.einsum("q,mi->mqi", _BULK, self.volumes[:, None] * inside) - np.einsum("fqc,mfci->mqi", _FACE, leap) / 2
        chunks = [slice(a, a + CHUNK) for a in range(0, len(load), CHUNK)]
        return np.concatenate([self._answered(some, load[some]) for some in chunks]), energy

    def _answered(self, some: slice, load: np.ndarray) -> np.ndarray:
        """(k,) η² of some tets under loads (k, 10, 3)."""
        slopes, (first, second) = self.slopes[some], self.lame[some].T
        pairs = np.einsum("mai,mbj->mijab", slopes, slopes)
        shear = second[:, None, None, None, None]
        elastic = first[:, None, None, None, None] * pairs + shear * pairs.transpose(0, 2, 1, 3, 4)
        elastic[:, range(3), range(3)] += shear[:, 0] * np.einsum("miiab->mab", pairs)[:, None]
        stiffness = (elastic.reshape(-1, 16) @ _PRODUCTS).reshape(-1, 3, 3, 10, 10).transpose(0, 3, 1, 4, 2)
        dead = np.einsum("mf,fq->mq", (self.mate[some] < 0).astype(float), _ON_FACE) > 0
        dead = np.repeat(dead, 3, axis=1)
        size = self.volumes[some, None]
        matrix = (stiffness * size[:, :, None, None, None]).reshape(-1, 30, 30)
        matrix *= ~dead[:, :, None] & ~dead[:, None]
        diagonal = np.arange(30)
        matrix[:, diagonal, diagonal] += dead * matrix[:, diagonal, diagonal].max(axis=1, keepdims=True)
        load = np.where(dead, 0.0, load.reshape(-1, 30))
        answer = np.linalg.solve(matrix, load[:, :, None])[:, :, 0]
        return np.maximum(np.einsum("mq,mq->m", answer, load), 0.0)


def _functions(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(p, 10) cubic functions λᵢλⱼ(λᵢ − λⱼ), one per edge, and λᵢλⱼλₖ, one per face, at barycentric coordinates (p, 4);
    (p, 10, 4) their derivatives by these."""
    (i, j), count = TET_EDGES.T, len(at)
    values, slopes = np.empty((count, 10)), np.zeros((count, 10, 4))
    a, b, edge = at[:, i], at[:, j], np.arange(6)
    values[:, :6], slopes[:, edge, i], slopes[:, edge, j] = a * b * (a - b), b * (2 * a - b), a * (a - 2 * b)
    for f, corners in enumerate(FACES):
        values[:, 6 + f] = at[:, corners].prod(axis=1)
        for k, corner in enumerate(corners):
            slopes[:, 6 + f, corner] = at[:, np.delete(corners, k)].prod(axis=1)
    return values, slopes


def _rule() -> tuple[np.ndarray, np.ndarray]:
    """Weights (27,), their sum is one, and barycentric coordinates (27, 4): exact up to degree 5 (Stroud's conical product)."""
    (x, u), (y, v), (z, w) = (roots_jacobi(3, power, 0) for power in (2, 1, 0))
    x, y, z = ((1 + c) / 2 for c in np.meshgrid(x, y, z, indexing="ij"))
    weights = np.einsum("i,j,k->ijk", u, v, w).ravel()
    y, z = y * (1 - x), z * (1 - x) * (1 - y)
    return weights / weights.sum(), np.stack([1 - x - y - z, x, y, z], axis=-1).reshape(-1, 4)


_WEIGHTS, _POINTS = _rule()
_BULK = _WEIGHTS @ _functions(_POINTS)[0]  # (10,) means of the functions over a tet
_PRODUCTS = np.einsum("p,pqa,prb->abqr", _WEIGHTS, *2 * [_functions(_POINTS)[1]]).reshape(16, 100)  # means of products of derivatives
_FACE = np.stack([np.einsum("p,pq,pc->qc", DEGREE_4[0], _functions(np.insert(DEGREE_4[1], f, 0.0, axis=1))[0], DEGREE_4[1])
                  for f in range(4)])  # (4, 10, 3) means over a face, of functions times its linear ones
_ON_FACE = np.hstack([(TET_EDGES[None] != np.arange(4)[:, None, None]).all(axis=2), np.eye(4, dtype=bool)]).astype(float)
