"""Multipliers on the slave's side, and what they make of the displacements of both sides (dual mortar).

On each slave facet, over the part of it that the master covers,

    S = ∫ N Nᵀ,   L = ∫ N,   A = diag(L) S⁻¹,   ψ = A N,   ∫ ψᵢ Nⱼ = δᵢⱼ Lⱼ

so that each multiplier meets one node alone (Wohlmuth, SIAM J. Numer. Anal. 38, 2000) and linear fields of the master
arrive unchanged also where facets are covered in part (Cichosz & Bischoff, Comput. Methods Appl. Mech. Eng. 200, 2011).
Ten-node faces that are bonded have ψ = N, the linear functions of the corners, instead: they alone hold linear tractions,
without which quadratic displacements lose half an order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.segments import Segments

# S scaled to a unit diagonal may be this ill-conditioned; what is covered of such a facet is a line of width 1e-6.
CONDITION = 1e12
# Weights below this share of a row's are rounding.
NOTHING = 1e-14
# Integrates polynomials of degree 4 over a triangle (Strang & Fix 1973): weights, barycentric coordinates.
_A, _B = 0.445948490915965, 0.091576213509771
DEGREE_4 = (np.repeat([0.223381589678011, 0.109951743655322], 3),
            np.concatenate([np.full((3, 3), x) + (1 - 3 * x) * np.eye(3) for x in (_A, _B)]))


@dataclass(frozen=True)
class Weights:
    """Integrals of the multipliers, one row per slave node; none at nodes in the middle of edges.

    Parameters
    ----------
    own : (n₁, n₁) ∫ψᵢNⱼ with the slave's functions; diagonal for dual multipliers
    other : (n₁, n₂) with the master's
    facets : (n₁, k₂) ∫ψᵢ over each master facet
    area : (n₁,) ∫ψᵢ: what every row of each of the three sums to
    share : (n₁,) of the facets around each node, which part is covered
    """

    own: sp.csr_array
    other: sp.csr_array
    facets: sp.csr_array
    area: np.ndarray
    share: np.ndarray


def multipliers(segments: Segments, slave: np.ndarray, master: np.ndarray, slave_area: np.ndarray, counts: tuple[int, int],
                dual: bool = True) -> Weights:
    """What the multipliers of a slave surface integrate to.

    Parameters
    ----------
    segments : of all its facets
    slave, master : (k₁, 3 or 6), (k₂, 3 or 6) int, nodes of the facets; functions are quadratic where they are six
    slave_area : (k₁,) of its facets
    counts : (n₁, n₂) numbers of nodes
    dual : whether multipliers are dual, else the slave's linear functions themselves
    """
    size, one, two = segments.fans
    size = size * slave_area[segments.slave][:, None]
    linear, at = moments(size, one, one), segments.slave
    first = np.einsum("mt,mtvk->mk", size, one) / 3
    gram, mass = np.zeros((len(slave), 3, 3)), np.zeros((len(slave), 3))
    np.add.at(gram, at, linear)
    np.add.at(mass, at, first)
    covered = mass.sum(axis=1)
    sound, shape = _dual(gram, mass) if dual else (covered > 0, np.broadcast_to(np.eye(3), gram.shape))
    there = sound[at]
    segments, size, one, two, linear, first = segments.some(there), size[there], one[there], two[there], linear[there], first[there]
    at, on = segments.slave, segments.master
    shape = shape[at]
    quadratic = slave.shape[1] == 6, master.shape[1] == 6
    own = _integrals(size, one, one, linear if not quadratic[0] else None)
    other = _integrals(size, one, two, moments(size, one, two) if not quadratic[1] else None)
    corners = slave[:, :3]

    def assembled(values: np.ndarray, columns: np.ndarray, width: int) -> sp.csr_array:
        rows = np.broadcast_to(corners[at][:, :, None], values.shape)
        columns = np.broadcast_to(columns[:, None], values.shape)
        return sp.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(counts[0], width))

    weights = np.einsum("mij,mj->mi", shape, first)[:, :, None]
    area = np.bincount(corners[at].ravel(), weights=weights.ravel(), minlength=counts[0])
    around = np.bincount(corners.ravel(), weights=np.repeat(slave_area, 3), minlength=counts[0])
    part = np.bincount(corners.ravel(), weights=np.repeat(np.where(sound, covered, 0.0), 3), minlength=counts[0])
    matrices = (assembled(shape @ own, slave[at], counts[0]), assembled(shape @ other, master[on], counts[1]),
                assembled(weights, on[:, None], len(master)))
    return Weights(*(cleaned(m, area) for m in matrices), area, part / np.where(around > 0, around, 1.0))


def moments(size: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(m, 3, 3) ∫ a bᵀ over triangles of areas (m, t), of functions that are linear there, given at corners (m, t, 3, 3)."""
    return (np.einsum("mt,mtk,mtl->mkl", size, one.sum(axis=2), two.sum(axis=2))
            + np.einsum("mt,mtvk,mtvl->mkl", size, one, two)) / 12


def _integrals(size: np.ndarray, one: np.ndarray, two: np.ndarray, linear: np.ndarray | None) -> np.ndarray:
    """(m, 3, 3 or 6) ∫ N fᵀ over triangles, of the slave's linear functions and the linear or quadratic f of a facet.

    Parameters
    ----------
    size, one, two : as for ``moments``
    linear : what it is if f is linear
    """
    if linear is not None:
        return linear
    weights, points = DEGREE_4
    at_one, at_two = (np.einsum("qv,mtvk->mtqk", points, corners) for corners in (one, two))
    return np.einsum("mt,q,mtqk,mtql->mkl", size, weights, at_one, six_functions(at_two), optimize=True)


def six_functions(at: np.ndarray) -> np.ndarray:
    """(…, 6) quadratic functions of a triangle at barycentric coordinates (…, 3)."""
    a, b, c = np.moveaxis(at, -1, 0)
    return np.stack([a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * a * b, 4 * b * c, 4 * c * a], axis=-1)


def cleaned(matrix: sp.csr_array, scale: np.ndarray) -> sp.csr_array:
    """The matrix without entries that are rounding beside ``scale`` (rows,)."""
    matrix = sp.coo_array(matrix.tocsr())
    kept = np.abs(matrix.data) > NOTHING * np.abs(scale)[matrix.row]
    return sp.csr_array((matrix.data[kept], (matrix.row[kept], matrix.col[kept])), shape=matrix.shape)


def _dual(gram: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Facets (k,) bool on which there are dual functions, and their coefficients (k, 3, 3); rows of zeros elsewhere.

    What is covered of a facet may be a strip along one of its edges: scaled to a unit diagonal S conditions well there.
    """
    scale = np.sqrt(np.einsum("kii->ki", gram))
    there = (scale > 0).all(axis=1)
    scale = np.where(there[:, None], scale, 1.0)
    scaled = np.where(there[:, None, None], gram / scale[:, :, None] / scale[:, None, :], np.eye(3))
    values = np.linalg.eigvalsh(scaled)
    sound = there & (values[:, 0] * CONDITION > values[:, 2])
    inverse = np.linalg.inv(np.where(sound[:, None, None], scaled, np.eye(3)))
    shape = mass[:, :, None] * inverse / scale[:, :, None] / scale[:, None, :]
    return sound, np.where(sound[:, None, None], shape, 0.0)
