"""Multipliers on the slave's side, and what they make of the displacements of both sides (dual
mortar).

On each slave facet, over the part of it that the master covers,

    S = ∫ N Nᵀ,   L = ∫ N,   A = diag(L) S⁻¹,   ψ = A N,   ∫ ψᵢ Nⱼ = δᵢⱼ Lⱼ

so that each multiplier meets one node alone (Wohlmuth, SIAM J. Numer. Anal. 38, 2000) and linear
fields of the master arrive unchanged also where facets are covered in part (Cichosz & Bischoff,
Comput. Methods Appl. Mech. Eng. 200, 2011). Bonded faces of six nodes have ψ = N, the linear
functions of the corners, instead: they alone hold linear tractions, without which quadratic
displacements lose half an order.

Under laws that open, a multiplier of a six-node face belongs to the middle of an edge: a constant
traction loads these middles alone, and points there reach as far as the face does, so that a body
may stand on its edge. With all six functions in the place of N, and their integrals over a whole
face L = (0, 0, 0, ⅓, ⅓, ⅓), the same formula has three dual functions,

    ∫ ψᵢ Nⱼ = δᵢⱼ Lⱼ,   Σ ψᵢ = 1

so that quadratic fields of the master arrive unchanged, and faces that match are paired node by
node (``paired``). Over a part of a face no dual functions at the middles have the sum 1: there the
linear functions that are 1 in one middle and 0 in the others take the place of N (Crouzeix &
Raviart 1973), and linear fields arrive unchanged. Their integrals L may be negative, see
``operators``. The solution of a contact problem is no smoother than H^(5/2−ε) (Moussaoui & Khodja
1992), for which such multipliers beside quadratic displacements lose no order (Hild & Laborde,
Appl. Numer. Math. 41, 2002).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.segments import Segments
from orchestrator.scene.mesh.quadratic import DEGREE_4, six_functions

# S scaled to a unit diagonal may be this ill-conditioned; what is covered of such a facet is a line
# of width 1e-6.
CONDITION = 1e12
# Weights below this share of a row's are rounding.
NOTHING = 1e-14
# A side is covered where the other overlaps this share of its facets: chords of curved faces leave
# slits.
FULL = 0.99
# Functions that are 1 in the middle of an edge and 0 in the middles of the others, at the six nodes
# of a face.
AMID = np.hstack([1.0 - 2.0 * np.roll(np.eye(3), 2, axis=1), np.eye(3)])
# Overlaps integrated at once: what is in work fits the processor's cache.
CHUNK = 5_000


class Multiplier(Enum):
    """Multipliers: dual to the functions of corners, these themselves, or dual to those of six-node
    faces' middles of edges."""

    DUAL = 0
    LINEAR = 1
    AMID = 2


@dataclass(frozen=True)
class Weights:
    """Integrals of the multipliers, one row per slave node; none where a node has no multiplier.

    own : (n₁, n₁) ∫ψᵢNⱼ with the slave's functions; diagonal for dual multipliers
    other : (n₁, n₂) with the master's
    facets : (n₁, k₂) ∫ψᵢ over each master facet
    area : (n₁,) ∫ψᵢ: what every row of each of the three sums to
    around : (n₁,) area of the facets around each node, its share of them; share : which part of it
        is covered
    """

    own: sp.csr_array
    other: sp.csr_array
    facets: sp.csr_array
    area: np.ndarray
    around: np.ndarray
    share: np.ndarray


def multipliers(segments: Segments, slave: np.ndarray, master: np.ndarray, slave_area: np.ndarray,
                counts: tuple[int, int],
                kind: Multiplier = Multiplier.DUAL) -> Weights:
    """Integrals of a slave surface's multipliers.

    segments : of all its facets
    slave, master : (k₁, 3 or 6), (k₂, 3 or 6) int, nodes of the facets; functions are quadratic
        where they are six
    slave_area : (k₁,) of its facets
    counts : (n₁, n₂) numbers of nodes
    """
    corners = slave[:, 3:] if kind is Multiplier.AMID else slave[:, :3]
    integrated = _amid if kind is Multiplier.AMID else _linear
    quadratic = (slave.shape[1] == 6, master.shape[1] == 6)
    # facets stay whole
    ends = np.searchsorted(segments.slave,
                           np.append(np.unique(segments.slave[::CHUNK]), len(slave)))
    parts = [integrated(segments.some(slice(a, b)), slave_area, kind, quadratic)
             for a, b in zip(ends[:-1], ends[1:])]
    at, on, own, other, weights, covered = (np.concatenate(found)
                                            for found in zip(*parts)) if parts else \
        (np.empty(0, int), np.empty(0, int),
         *(np.empty((0, 3, width)) for width in (slave.shape[1], master.shape[1], 1)), np.empty(0))

    def assembled(values: np.ndarray, columns: np.ndarray, width: int) -> sp.csr_array:
        rows = np.broadcast_to(corners[at][:, :, None], values.shape)
        columns = np.broadcast_to(columns[:, None], values.shape)
        return sp.csr_array((values.ravel(), (rows.ravel(), columns.ravel())),
                            shape=(counts[0], width))

    area, part, around = (np.bincount(nodes.ravel(), weights=values.ravel(), minlength=counts[0])
                          for nodes, values in (
        (corners[at], weights), (corners[at], np.repeat(covered, 3)),
        (corners, np.repeat(slave_area, 3))))
    matrices = (assembled(own, slave[at], counts[0]), assembled(other, master[on], counts[1]),
                assembled(weights, on[:, None], len(master)))
    share = part / np.where(around > 0, around, 1.0)
    return Weights(*(cleaned(m, area) for m in matrices), area, around / 3, share)


def _linear(segments: Segments, slave_area: np.ndarray, kind: Multiplier,
            quadratic: tuple[bool, bool]) -> tuple[np.ndarray, ...]:
    """Contribution of each overlap (m,), of whole facets: the facets of both sides, ∫ψNᵀ with the
    functions of the slave (m, 3, 3 or 6)
    and of the master, ∫ψ (m, 3, 1), the area (m,)."""
    size, one, two = segments.fans
    size = size * slave_area[segments.slave][:, None]
    linear = moments(size, one, one)
    first = (size[:, :, None] * one.sum(axis=2)).sum(axis=1) / 3
    _, at, gram, mass = _summed(segments, linear, first)
    sound, shape = mass.sum(axis=1) > 0, np.broadcast_to(np.eye(3), gram.shape)
    if kind is Multiplier.DUAL:
        sound, shape = _dual(gram, mass)
    shape = shape[at]
    own = _quadratic(size, one, one) if quadratic[0] else linear
    other = (_quadratic if quadratic[1] else moments)(size, one, two)
    return _where(sound[at], segments.slave, segments.master, shape @ own, shape @ other,
                  shape @ first[:, :, None], size.sum(axis=1))


def _amid(segments: Segments, slave_area: np.ndarray, kind: Multiplier,
          quadratic: tuple[bool, bool]) -> tuple[np.ndarray, ...]:
    """The same of multipliers in the middle of edges."""
    size, one, two = segments.fans
    size = size * slave_area[segments.slave][:, None]
    weights, points = DEGREE_4
    at_one, at_two = (np.einsum("qv,mtvk->mtqk", points, corners) for corners in (one, two))
    functions, theirs = six_functions(at_one), six_functions(at_two) if quadratic[1] else at_two
    weighted = functions * (size[:, :, None] * weights)[..., None]
    first = weighted.sum(axis=(1, 2))
    facets, at, gram, mass = _summed(
        segments, np.einsum("mtqk,mtql->mkl", weighted, functions, optimize=True), first)
    stands, covered = mass @ AMID.T, np.bincount(at, size.sum(axis=1))
    sound, shape = _dual(AMID @ gram @ AMID.T, stands)
    shape, whole = shape @ AMID, covered >= FULL * slave_area[facets]
    shape[whole] = stands[whole][:, :, None] * np.linalg.inv(gram[whole])[:, 3:]
    own = np.zeros((len(at), 3, 6))
    own[:, :, 3:] = (first @ AMID.T)[:, :, None] * np.eye(3)
    other = shape[at] @ np.einsum("mtqk,mtql->mkl", weighted, theirs, optimize=True)
    return _where((sound | whole)[at], segments.slave, segments.master, own, other,
                  shape[at] @ first[:, :, None], size.sum(axis=1))


def _summed(segments: Segments, *values: np.ndarray) -> tuple[np.ndarray, ...]:
    """The slave's facets, which of them each overlap is on, and the sums of values (m, …) there."""
    facets, at = np.unique(segments.slave, return_inverse=True)
    sums = [np.zeros((len(facets), *value.shape[1:])) for value in values]
    for total, value in zip(sums, values):
        np.add.at(total, at, value)
    return facets, at, *sums


def _where(there: np.ndarray, *found: np.ndarray) -> tuple[np.ndarray, ...]:
    return found if there.all() else tuple(f[there] for f in found)


def moments(size: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(m, 3, 3) ∫ a bᵀ over triangles of areas (m, t), of functions that are linear there, given at
    corners (m, t, 3, 3).
    """
    both = [np.concatenate([at.sum(axis=2, keepdims=True), at], axis=2).reshape(len(size), -1, 3)
            for at in (one, two)]
    weighted = both[0] * np.repeat(size, 4, axis=1)[:, :, None]
    return weighted.transpose(0, 2, 1) @ both[1] / 12


def _quadratic(size: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(m, 3, 6) ∫ N fᵀ over triangles, of the slave's linear functions and the quadratic f of a
    facet; parameters as above.
    """
    weights, points = DEGREE_4
    at_one, at_two = (np.einsum("qv,mtvk->mtqk", points, corners) for corners in (one, two))
    return np.einsum("mt,q,mtqk,mtql->mkl", size, weights, at_one, six_functions(at_two),
                     optimize=True)


def cleaned(matrix: sp.csr_array, scale: np.ndarray) -> sp.csr_array:
    """The matrix without entries that are rounding beside ``scale`` (rows,)."""
    matrix = sp.coo_array(matrix.tocsr())
    kept = np.abs(matrix.data) > NOTHING * np.abs(scale)[matrix.row]
    return sp.csr_array((matrix.data[kept], (matrix.row[kept], matrix.col[kept])),
                        shape=matrix.shape)


def _dual(gram: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Facets (k,) bool on which there are dual functions, and their coefficients (k, 3, 3); rows of
    zeros elsewhere.

    What is covered of a facet may be a strip along one of its edges: scaled to a unit diagonal S
    conditions well there.
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
