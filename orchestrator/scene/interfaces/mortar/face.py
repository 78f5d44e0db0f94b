"""Faces of meshes that need not be ours: triangles and quadrilaterals, with or without nodes in the middle of their edges.

A side of an interface is handed over as a ``Face``: where its nodes are, and its facets. Its dofs are numbered 3 × node +
component in the order of its nodes, as the columns of every operator are; normals follow from the facets, which turn
outwards. ``feet`` finds where nodes of another mesh stand on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors

# Corner coordinates of the reference square, and of the middles of its edges.
_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float)
# Their corners as triangles, by number of nodes.
_TRIANGLES = {3: [[0, 1, 2]], 6: [[0, 1, 2]], 4: [[0, 1, 2], [0, 2, 3]], 8: [[0, 1, 2], [0, 2, 3]]}
KINDS = tuple(sorted(_TRIANGLES))


@dataclass(frozen=True)
class Face:
    """One side of an interface.

    Parameters
    ----------
    points : (n, 3) where its nodes are
    facets : arrays (k, 3), (k, 6), (k, 4) or (k, 8) int, indices into them: the corners in turn, seen from outside
        counter-clockwise, then the middles of the edges in the same turn (first to second corner, second to third, …)
    """

    points: np.ndarray
    facets: Sequence[np.ndarray]

    def __post_init__(self) -> None:
        for block in self.facets:
            if block.ndim != 2 or block.shape[1] not in KINDS:
                raise ValueError(f"facets of {block.shape[-1]} nodes; there are those of {', '.join(map(str, KINDS))}")

    @cached_property
    def triangles(self) -> np.ndarray:
        """(t, 3) int, the facets' corners as triangles: two where there are four."""
        found = [block[:, _TRIANGLES[block.shape[1]]].reshape(-1, 3) for block in self.facets]
        return np.concatenate([np.empty((0, 3), dtype=int), *found])

    @cached_property
    def first_triangle(self) -> list[np.ndarray]:
        """(k,) for each array of facets, which of the triangles begins each facet."""
        counts = [len(_TRIANGLES[block.shape[1]]) for block in self.facets]
        starts = np.cumsum([0, *(count * len(block) for count, block in zip(counts, self.facets))])
        return [start + count * np.arange(len(block)) for start, count, block in zip(starts, counts, self.facets)]

    @cached_property
    def vectors(self) -> np.ndarray:
        """(n, 3) outward area of the facets around each node: every facet's, in equal parts to its nodes."""
        result = np.zeros((len(self.points), 3))
        for block in self.facets:
            vector = sum(area_vectors(self.points, block[:, corners]) for corners in _TRIANGLES[block.shape[1]])
            for node in block.T:
                np.add.at(result, node, vector / block.shape[1])
        return result

    @cached_property
    def areas(self) -> np.ndarray:
        """(n,) of the facets around each node, in equal parts: what nodes stand for, not the integrals of their functions,
        which are negative at the corners of quadrilaterals with eight nodes."""
        result = np.zeros(len(self.points))
        for block in self.facets:
            area = sum(np.linalg.norm(area_vectors(self.points, block[:, corners]), axis=1) for corners in _TRIANGLES[block.shape[1]])
            np.add.at(result, block, np.repeat(area[:, None] / block.shape[1], block.shape[1], axis=1))
        return result


def functions(kind: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, kind) shape functions of a facet and (m, kind, 2) their derivatives.

    Parameters
    ----------
    kind : number of its nodes: 3, 6, 4 or 8 (serendipity)
    at : (m, 2) in the unit triangle, its first corner at the origin, or in the square from −1 to 1
    """
    if kind in (3, 6):
        slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
        value = np.c_[1 - at.sum(axis=1), at]
        if kind == 3:
            return value, np.broadcast_to(slope, (len(at), 3, 2))
        i, j = [0, 1, 2], [1, 2, 0]
        return (np.hstack([value * (2 * value - 1), 4 * value[:, i] * value[:, j]]),
                np.concatenate([(4 * value - 1)[:, :, None] * slope,
                                4 * (value[:, i, None] * slope[j] + value[:, j, None] * slope[i])], axis=1))
    x, y = at[:, :1], at[:, 1:]
    a, b = _SQUARE[:4].T
    p, q = 1 + a * x, 1 + b * y
    if kind == 4:
        return p * q / 4, np.stack([a * q, b * p], axis=2) / 4
    c, d = _SQUARE[4:].T
    along = c == 0  # edges along x
    r, s = 1 + c * x, 1 + d * y
    # (1 − x²)(1 + d y)/2 or (1 + c x)(1 − y²)/2
    middle = np.where(along, (1 - x**2) * s, r * (1 - y**2)) / 2
    middle_slope = np.stack([np.where(along, -2 * x * s, c * (1 - y**2)), np.where(along, (1 - x**2) * d, -2 * y * r)], axis=2) / 2
    corner = p * q * (a * x + b * y - 1) / 4
    corner_slope = np.stack([a * q * (2 * a * x + b * y), b * p * (a * x + 2 * b * y)], axis=2) / 4
    return np.hstack([corner, middle]), np.concatenate([corner_slope, middle_slope], axis=1)


def inside(kind: int, at: np.ndarray) -> np.ndarray:
    """(m, 2) the points of a facet's reference triangle or square that are next to these."""
    if kind in (4, 8):
        return np.clip(at, -1.0, 1.0)
    share = np.maximum(np.c_[1 - at.sum(axis=1), at], 0.0)
    return (share / share.sum(axis=1, keepdims=True))[:, 1:]


def middle(kind: int) -> np.ndarray:
    """(2,) of the reference triangle or square."""
    return np.zeros(2) if kind in (4, 8) else np.full(2, 1 / 3)
