"""Operators of six-node faces whose nodes are paired, under laws that say what passes from the jump or the force.

A constant traction loads the middles of a six-node face's edges, by a third each, and its corners not at all. So the points are these
middles, node against node, and a corner goes where its body takes it:

    d = u₂ − u₁ in the middle of an edge,      A = Σ |face| / 3 of the faces that meet there

Sums over the middles integrate products of linear functions exactly (Strang & Fix 1973), so that linear tractions have their resultant
and their moment. The jump's mean on every face is that of its middles, so that what tractions differ from constant ones on a face alone is
missed, O(h^(3/2)): what quadratic displacements reach beside a contact that ends (Hild & Laborde, Appl. Numer. Math. 41, 2002). Means around
corners, ∫ N d / ∫ N, would see the gap beyond that border: pressures oscillate from there inwards. And the pieces of a body that is cut
through a contact see the same gap where they meet.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import Mortar, hats
from orchestrator.scene.mesh.geometry import area_vectors, areas


def amid(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) areas that the middles of edges stand for, of nodes at points (n, 3) of triangles (k, 6); 0 at corners."""
    area = areas(points, triangles)
    return np.bincount(triangles[:, 3:].ravel(), np.repeat(area / 3, 3), len(points))


def paired_mortar(points: np.ndarray, triangles: np.ndarray, cells: np.ndarray, normals: np.ndarray, gap: np.ndarray,
                  fixed: tuple[np.ndarray, np.ndarray]) -> Mortar:
    """The operators; parameters as of ``Interface`` and ``Mortar``. What is prescribed on both sides has no point.

    points : (n, 3) halfway between the sides
    normals : (n, 3) at the nodes; gap : (n,) distance of the sides at the nodes
    fixed : (n, 3) bool, components prescribed on either side
    """
    area, held = amid(points, triangles), fixed[0] & fixed[1]
    chosen = np.flatnonzero((area > 0) & ~held.all(axis=1))
    operator = sp.csr_array(sp.eye_array(3 * len(points), format="csr")[(3 * chosen[:, None] + np.arange(3)).ravel()])
    upright = mirrored(normals, area_vectors(points, triangles), triangles, held)
    return Mortar(chosen, operator, operator, area[chosen], upright[chosen], gap[chosen], triangles, cells, ~fixed[1],
                  hats(chosen, triangles))


def mirrored(normals: np.ndarray, vectors: np.ndarray, triangles: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals, at planes of symmetry without what the missing half would take back.

    At the rim of a symmetric half facets' mean normals lean off the plane by what a curved face turns within a facet; the
    true normal does not. So a component that is held on both sides is left out where facets nearby differ in it by as much.
    On plane faces they do not, nor do they where a face runs into a support at an angle.

    vectors : (k, 3) along the facets' normals; held : (n, 3) bool
    """
    facets = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    spread = _around(facets, triangles, len(normals)) + _around(-facets, triangles, len(normals))
    inside = np.where(held & (np.abs(normals) <= spread), 0.0, normals)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    return np.where(length > 0, inside / np.where(length > 0, length, 1.0), normals)


def _around(values: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    """(n, c) the largest of values (k, c) of facets that meet a node, or a facet that does."""
    for _ in range(2):
        at = np.full((count, values.shape[1]), -np.inf)
        np.maximum.at(at, triangles.ravel(), np.repeat(values, triangles.shape[1], axis=0))
        values = at[triangles].max(axis=1)
    return at
