"""Estimate of the discretisation error of ten-node tets by a small problem in each (Bank and
Weiser).

What the stress σ of a solution leaves of balance, its divergence and body force b inside of a tet
T, and half of the leap of its traction [σn] on faces between two tets, loads the tet by itself.
Displacements e that are cubic and zero at the tet's ten nodes, ten functions per component, answer
it:

    ∫_T ε(e) : C ε(v) = ∫_T (div σ + b) · v − ½ Σ_faces ∫ [σn] · v     for all such v,
    η²_T = ∫_T ε(e) : C ε(e)

On faces of one tet alone v is zero. So neither loads on faces nor the tractions of contact, of
supports and of bonds between meshes that do not match have to be known as fields. Across perfect
interfaces the traction is continuous, between two materials as well.

``tests/test_element_problems.py`` holds it against the truth.

R. E. Bank, A. Weiser, Some a posteriori error estimators for elliptic partial differential
equations, Math. Comp. 44, 1985, 283–301.

Which estimate of the discretisation error belongs to which tets.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import roots_jacobi

from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.scene.mesh.quadratic import DEGREE_4, TET_EDGES


# corners of the face opposite to each
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
TENSOR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # places of a stress's six components
CHUNK = 300  # tets at once: some 15 kB each, which the processor keeps at hand
_MIDDLE = np.zeros((4, 4), dtype=int)  # the node between two corners
_MIDDLE[tuple(TET_EDGES.T)] = _MIDDLE[tuple(TET_EDGES[:, ::-1].T)] = np.arange(4, 10)


class ElementProblems(Estimator):
    """The estimate for ten-node tets.

    turn : (m, 4) int, corners of every tet in the order of their labels, so that both sides of a
        face have it in the same order
    slopes : (m, 4, 3) of the linear shape functions, in that order
    mate : (4 m,) int, of each face of a tet the same face of another one; −1: none
    lonely : (m, 4) bool, faces of one tet alone
    """

    def _prepare(self, nodes: np.ndarray, label: np.ndarray) -> None:
        label = label[self.cells]
        self.turn = np.argsort(label[:, :4], axis=1)
        self.slopes = np.take_along_axis(self.gradients, self.turn[:, :, None], 1)
        # by their middles: all corners of a face may be joined by other interfaces than the one
        # that it is on
        ends = self.turn[:, FACES]
        middles = np.take_along_axis(label,
                                     _MIDDLE[ends, np.roll(ends, -1, axis=2)].reshape(-1, 12),
                                     1).reshape(-1, 3)
        order = np.lexsort(middles.T)
        same = (middles[order[1:]] == middles[order[:-1]]).all(axis=1)
        self.mate = np.full(len(middles), -1)
        self.mate[order[:-1][same]], self.mate[order[1:][same]] = order[1:][same], order[:-1][same]
        self.lonely = (self.mate < 0).reshape(-1, 4)

    def _errors(self, stresses: Sequence[np.ndarray], numbers: Sequence[int | None]) -> np.ndarray:
        loads = np.stack([self._load(sigma, number) for sigma, number in zip(stresses, numbers)],
                         axis=2)
        return np.concatenate([self._answered(slice(a, a + CHUNK), loads[a:a + CHUNK])
                               for a in range(0, len(loads), CHUNK)], axis=1)

    def _load(self, sigma: np.ndarray, number: int | None) -> np.ndarray:
        """(m, 30) what the stress (6, 4, m) of a load step leaves of balance, on every tet's
        functions.
        """
        # (m, 4, 6)
        corners = np.take_along_axis(sigma.transpose(2, 1, 0), self.turn[:, :, None], 1)
        tensors = corners[:, :, TENSOR]
        # of the faces, outward, as long as their areas
        vectors = -3 * self.volumes[:, None, None] * self.slopes
        tractions = np.einsum("mfcij,mfj->mfci", tensors[:, FACES], vectors).reshape(-1, 9)
        leap = tractions + tractions[self.mate]
        leap = np.where(self.lonely[:, :, None, None], 0.0, leap.reshape(-1, 4, 3, 3))
        inside = np.einsum("maij,maj->mi", tensors, self.slopes)[:, None]  # (m, 1, 3)
        if self.body_force is not None and number is not None:
            body = self.body_force[number]
            inside = inside + (np.take_along_axis(body, self.turn[:, :, None], 1)
                               if body.shape[1] == 4 else body)
        bulk = _BULK if inside.shape[1] == 4 else _BULK.sum(axis=1, keepdims=True)
        load = np.einsum("qc,mci->mqi", bulk, self.volumes[:, None, None]
                         * inside) - np.einsum("fqc,mfci->mqi", _FACE, leap) / 2
        return load.reshape(-1, 30)

    def _answered(self, some: slice, loads: np.ndarray) -> np.ndarray:
        """(T, k) η² of some tets under loads (k, 30, T)."""
        slopes, (first, second) = self.slopes[some], self.lame[some].T
        pairs = np.einsum("mai,mbj->mijab", slopes, slopes)
        shear = second[:, None, None, None, None]
        elastic = first[:, None, None, None, None] * pairs + shear * pairs.transpose(0, 2, 1, 3, 4)
        elastic[:, range(3), range(3)] += shear[:, 0] * np.einsum("miiab->mab", pairs)[:, None]
        elastic *= self.volumes[some, None, None, None, None]
        matrix = (elastic.reshape(-1, 16) @ _PRODUCTS).reshape(-1, 3, 3, 10, 10).transpose(
            0, 3, 1, 4, 2).reshape(-1, 30, 30)
        dead = np.repeat(self.lonely[some].astype(float) @ _ON_FACE > 0, 3, axis=1)
        matrix *= ~dead[:, :, None] & ~dead[:, None]
        diagonal = np.arange(30)
        matrix[:, diagonal, diagonal] += dead * matrix[:, diagonal,
                                                       diagonal].max(axis=1, keepdims=True)
        loads = np.where(dead[:, :, None], 0.0, loads)
        return np.maximum(np.einsum("mqt,mqt->tm", np.linalg.solve(matrix, loads), loads), 0.0)


def _functions(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(p, 10) cubic functions λᵢλⱼ(λᵢ − λⱼ), one per edge, and λᵢλⱼλₖ, one per face, at barycentric
    coordinates (p, 4);
    (p, 10, 4) their derivatives by these."""
    (i, j), count = TET_EDGES.T, len(at)
    values, slopes = np.empty((count, 10)), np.zeros((count, 10, 4))
    a, b, edge = at[:, i], at[:, j], np.arange(6)
    values[:, :6], slopes[:, edge, i], slopes[:, edge,
                                              j] = a * b * (a - b), b * (2 * a - b), a * (a - 2 * b)
    for f, corners in enumerate(FACES):
        values[:, 6 + f] = at[:, corners].prod(axis=1)
        for k, corner in enumerate(corners):
            slopes[:, 6 + f, corner] = at[:, np.delete(corners, k)].prod(axis=1)
    return values, slopes


def _rule() -> tuple[np.ndarray, np.ndarray]:
    """Weights (27,), their sum is one, and barycentric coordinates (27, 4): exact up to degree 5
    (Stroud's conical product).
    """
    (x, u), (y, v), (z, w) = (roots_jacobi(3, power, 0) for power in (2, 1, 0))
    x, y, z = ((1 + c) / 2 for c in np.meshgrid(x, y, z, indexing="ij"))
    weights = np.einsum("i,j,k->ijk", u, v, w).ravel()
    y, z = y * (1 - x), z * (1 - x) * (1 - y)
    return weights / weights.sum(), np.stack([1 - x - y - z, x, y, z], axis=-1).reshape(-1, 4)


_WEIGHTS, _POINTS = _rule()
# (10, 4) means over a tet, of functions times its linear ones
_BULK = _functions(_POINTS)[0].T * _WEIGHTS @ _POINTS
# means of products of derivatives
_PRODUCTS = np.einsum("p,pqa,prb->abqr", _WEIGHTS, *2 * [_functions(_POINTS)[1]]).reshape(16, 100)
_FACE = np.stack(
    [np.einsum("p,pq,pc->qc", DEGREE_4[0], _functions(np.insert(DEGREE_4[1], f, 0.0, axis=1))[0],
               DEGREE_4[1])
                  # (4, 10, 3) means over a face, of functions times its linear ones
                  for f in range(4)])
_ON_FACE = np.hstack([(TET_EDGES[None] != np.arange(4)[:, None, None]).all(axis=2),
                      np.eye(4, dtype=bool)]).astype(float)
