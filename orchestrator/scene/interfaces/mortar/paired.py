"""Operators of six-node faces whose nodes are paired, under laws that say what passes from the jump or the force.

Both sides have the same faces, so that what facets have in common are the facets themselves, and G₁ = G₂: with N the linear and
Q the quadratic functions of a face,

    G_ij = ∫ Nᵢ Qⱼ / ∫ Nᵢ,    whose share of a face of area 1 is 1/30 at i = j, −1/60 at other corners, 2/15 in the middle of edges
                              that meet in i and 1/15 in the middle of the one that does not

A corner carries a point also where it is prescribed: nodes in the middle of edges, which move, are behind it. It carries none
where all nodes of the faces around are prescribed on both sides.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import Mortar, hats
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quadratic import TRIANGLE_MOMENTS

# A point's nodes have this share of its weight where they are free at all; less is rounding.
NOTHING = 1e-9


def means(points: np.ndarray, triangles: np.ndarray) -> tuple[sp.csr_array, np.ndarray]:
    """(n, n) G of nodes at points (n, 3), rows of corners alone, and (n,) ∫ Nᵢ.

    triangles : (k, 6) int
    """
    size = np.linalg.norm(area_vectors(points, triangles), axis=1)
    rows, columns = np.repeat(triangles[:, :3, None], 6, axis=2), np.repeat(triangles[:, None, :], 3, axis=1)
    moments = sp.csr_array(((size[:, None, None] * TRIANGLE_MOMENTS[6].T).ravel(), (rows.ravel(), columns.ravel())),
                           shape=(len(points),) * 2)
    area = np.bincount(triangles[:, :3].ravel(), np.repeat(size / 3, 3), len(points))
    return sp.csr_array(sp.diags_array(1 / np.where(area > 0, area, 1.0)) @ moments), area


def paired_mortar(points: np.ndarray, triangles: np.ndarray, cells: np.ndarray, normals: np.ndarray, gap: np.ndarray,
                  fixed: tuple[np.ndarray, np.ndarray]) -> Mortar:
    """The operators; parameters as of ``Interface`` and ``Mortar``.

    points : (n, 3) halfway between the sides
    normals : (n, 3) at the nodes; gap : (n,) distance of the sides at the nodes
    fixed : (n, 3) bool, components prescribed on either side
    """
    G, area = means(points, triangles)
    free = abs(G) @ (~(fixed[0] & fixed[1])).astype(float)
    chosen = np.flatnonzero((free > NOTHING).any(axis=1))
    operator = sp.csr_array(sp.kron(G[chosen], sp.eye_array(3), format="csr"))
    upright = mirrored(normals, area_vectors(points, triangles), triangles, fixed[0] & fixed[1])
    return Mortar(chosen, operator, operator, area[chosen], upright[chosen], (G @ gap)[chosen], triangles, cells, ~fixed[1],
                  hats(chosen, triangles))


def mirrored(normals: np.ndarray, vectors: np.ndarray, triangles: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals, at planes of symmetry without what the missing half would take back.

    At the rim of a symmetric half facets' mean normals lean off the plane by what a curved face turns within a facet; the
    true normal does not. So a component that is held on both sides is left out where facets nearby differ in it by as much.
    On plane faces they do not, nor do they where a face runs into a support at an angle.

    vectors : (k, 3) along the facets' normals; held : (n, 3) bool
    """
    facets = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    spread = _around(facets, triangles[:, :3], len(normals)) + _around(-facets, triangles[:, :3], len(normals))
    inside = np.where(held & (np.abs(normals) <= spread), 0.0, normals)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    return np.where(length > 0, inside / np.where(length > 0, length, 1.0), normals)


def _around(values: np.ndarray, corners: np.ndarray, count: int) -> np.ndarray:
    """(n, c) the largest of values (k, c) of facets that meet a node, or a facet that does; 0 at nodes that are no corners."""
    for _ in range(2):
        at = np.full((count, values.shape[1]), -np.inf)
        np.maximum.at(at, corners.ravel(), np.repeat(values, 3, axis=0))
        values = at[corners].max(axis=1)
    return np.where(np.isfinite(at), at, 0.0)
