"""Where nodes of one mesh stand on a face of another, and what the other's shape functions are there.

The foot of a node is the place of the face nearest to it, found facet by facet (Gauss–Newton on the distance, on the facet's
own shape functions, curved or not), all pairs at once. Nodes may miss a face: beyond its rim, or too far from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.face import Face, functions, inside, middle

# Steps to the foot on a facet: one where it is plane with straight edges and a parallelogram, else a few; far more than any
# facet takes that can be told from its neighbours.
STEPS = 20
# In reference coordinates: the foot has been found.
FOUND = 1e-13
# A node this near to a facet, in units of the facet's size, stands on it whatever lies behind: coordinates from a file.
ALIKE = 1e-9


@dataclass(frozen=True)
class Feet:
    """Of n nodes on a face of m nodes.

    Parameters
    ----------
    weights : (n, m) sparse, the face's shape functions at the feet; a row sums to 1, or is empty where there is no foot
    place : (n, 3) of the feet; normal : (n, 3) unit, outward of the face there; zero where there is none
    triangle : (n,) int, which of the face's triangles is beside the foot; −1 where there is none
    distance : (n,) from node to foot; infinite where there is none
    beside : (n,) how far the foot is beside the node, across the normal: not zero beyond the rim
    """

    weights: sp.csr_array
    place: np.ndarray
    normal: np.ndarray
    triangle: np.ndarray
    distance: np.ndarray
    beside: np.ndarray

    @property
    def there(self) -> np.ndarray:
        """(n,) bool, whether there is one."""
        return np.isfinite(self.distance)


def feet(points: np.ndarray, face: Face, reach: float) -> Feet:
    """The feet of nodes (n, 3) that are no farther than ``reach`` from a face."""
    n = len(points)
    best, normal, place = np.full(n, np.inf), np.zeros((n, 3)), points.copy()
    rows, columns, values = [], [], []
    block_of, facet_of, at_of, triangle = np.full(n, -1), np.zeros(n, dtype=int), np.zeros((n, 2)), np.full(n, -1)
    for number, block in enumerate(face.facets):
        node, facet = _near(points, face.points[block], reach)
        at, where = _nearest(points[node], face.points[block[facet]])
        distance = np.linalg.norm(points[node] - where, axis=1)
        size = np.ptp(face.points[block[facet]], axis=1).max(axis=1) if len(facet) else np.empty(0)
        order = np.lexsort((facet, distance, node))
        first = order[np.flatnonzero(np.r_[True, np.diff(node[order]) != 0])] if len(order) else order
        better = first[(distance[first] <= reach) & (distance[first] < best[node[first]] - ALIKE * size[first])]
        i = node[better]
        best[i], place[i], block_of[i], facet_of[i], at_of[i] = distance[better], where[better], number, facet[better], at[better]
    for number, block in enumerate(face.facets):
        i = np.flatnonzero(block_of == number)
        value, slope = functions(block.shape[1], at_of[i])
        nodes, triangle[i] = block[facet_of[i]], face.first_triangle[number][facet_of[i]]
        rows.append(np.repeat(i, block.shape[1]))
        columns.append(nodes.ravel())
        values.append(value.ravel())
        tangent = np.einsum("mkd,mkc->mdc", slope, face.points[nodes])
        upright = np.cross(tangent[:, 0], tangent[:, 1])
        normal[i] = upright / np.linalg.norm(upright, axis=1, keepdims=True)
    entries = [np.concatenate([np.empty(0, kind), *found]) for found, kind in ((values, float), (rows, int), (columns, int))]
    away = points - place
    return Feet(sp.csr_array((entries[0], (entries[1], entries[2])), shape=(n, len(face.points))), place, normal, triangle, best,
                np.linalg.norm(away - np.einsum("ni,ni->n", away, normal)[:, None] * normal, axis=1))


def _near(points: np.ndarray, corners: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and facets (k, nodes, 3) that may be within reach of each other."""
    from scipy.spatial import cKDTree

    centre = corners.mean(axis=1)
    far = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    lists = cKDTree(points).query_ball_point(centre, 2 * far + reach)  # curved edges stay within twice their corners
    counts = np.fromiter(map(len, lists), int, len(lists))
    return np.fromiter(chain.from_iterable(lists), int, counts.sum()), np.repeat(np.arange(len(corners)), counts)


def _nearest(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reference coordinates (m, 2) and places (m, 3) on facets (m, nodes, 3), next to points (m, 3)."""
    kind = corners.shape[1]
    at = np.broadcast_to(middle(kind), (len(points), 2)).copy()
    for _ in range(STEPS):
        value, slope = functions(kind, at)
        tangent = np.einsum("mkd,mkc->mdc", slope, corners)
        away = points - np.einsum("mk,mkc->mc", value, corners)
        gram = np.einsum("mdc,mec->mde", tangent, tangent)
        step = np.linalg.solve(gram, np.einsum("mdc,mc->md", tangent, away)[:, :, None])[:, :, 0]
        moved = inside(kind, at + step)
        done = np.abs(moved - at).max(initial=0.0) <= FOUND
        at = moved
        if done:
            break
    return at, np.einsum("mk,mkc->mc", functions(kind, at)[0], corners)
