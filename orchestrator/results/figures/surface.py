"""What one sees of a tetrahedral mesh: outer faces, sharp edges, and a camera that frames them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.faces import LOCAL_FACES as _FACES
from orchestrator.scene.mesh.faces import MAX_NODES, pack
from orchestrator.scene.mesh.quadratic import TET_EDGES

# the four faces of a tet, each cut at the middles of its edges: (4, 4, 3)
_MIDDLE = {frozenset(ends): 4 + i for i, ends in enumerate(TET_EDGES.tolist())}
_QUARTERS = np.array([[[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                      for a, b, c in _FACES.tolist()
                      for ab, bc, ca in [[_MIDDLE[frozenset(e)] for e in ((a, b), (b, c), (c, a))]]])


def outer_faces(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces that belong to one tet only; those of a ten-node tet in four triangles each.

    Parameters
    ----------
    cells : (m, 4 or 10) int

    Returns
    -------
    triangles : (k, 3) node ids, oriented outward
    cell : (k,) the tet of each; local : (k, 3) the triangle's nodes within that tet
    """
    chosen = np.flatnonzero(alone(cells.T[_FACES.T]).T)  # tet after tet
    cell, local = chosen // 4, _FACES[chosen % 4]
    if cells.shape[1] == 10:
        cell, local = np.repeat(cell, 4), _QUARTERS[chosen % 4].reshape(-1, 3)
    return cells[cell[:, None], local], cell, local


def alone(triangles: np.ndarray) -> np.ndarray:
    """(...) bool, which triangles (3, ...) have nodes that no other one has."""
    flat, count = triangles.reshape(3, -1), int(triangles.max()) + 1
    if count <= MAX_NODES:  # three node ids fit in one 64-bit number: sorting that is much faster
        key = pack(flat.T, np.int64(count))
        order = np.argsort(key)
        differs = np.diff(key[order]) != 0
    else:
        ids = np.sort(flat, axis=0)
        order = np.lexsort(ids)
        differs = (np.diff(ids[:, order]) != 0).any(axis=0)
    result = np.empty(len(order), dtype=bool)
    result[order] = np.concatenate([[True], differs]) & np.concatenate([differs, [True]])
    return result.reshape(triangles.shape[1:])


def edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges shared by exactly two triangles, each pair of neighbours once.

    Returns
    -------
    nodes : (e, 2) int; neighbours : (e, 2) int, indices of the two triangles
    """
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    key = pairs[:, 0] * (int(triangles.max()) + 1) + pairs[:, 1]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(key[order]) != 0]))
    twice = starts[np.diff(np.append(starts, len(key))) == 2]
    return pairs[order[twice]], np.stack([order[twice], order[twice + 1]], axis=1) // 3


def normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(k, 3) unit normals of triangles."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


def sharp_edges(points: np.ndarray, triangles: np.ndarray, degrees: float = 30.0) -> np.ndarray:
    """(e, 2) node ids of the edges where neighbouring faces turn by more than ``degrees``."""
    nodes, neighbours = edges(triangles)
    normal = normals(points, triangles)
    cosine = np.einsum("ij,ij->i", normal[neighbours[:, 0]], normal[neighbours[:, 1]])
    return nodes[cosine < np.cos(np.radians(degrees))]


def box_edges(points: np.ndarray) -> np.ndarray:
    """(12, 2, 3) edges of the bounding box: an outline for bodies without sharp edges."""
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    ends = [(a, b) for a in range(8) for b in range(a) if np.abs(corners[a] - corners[b]).sum() == 1]
    return np.where(corners == 1, high, low)[np.array(ends)]


@dataclass(frozen=True)
class Camera:
    """Parallel projection with z upward.

    Parameters
    ----------
    focus : (3,) the point at the picture's centre
    toward : (3,) unit vector from the scene to the eye; right, up : (3,) the picture's axes
    width, height : of the picture, in the model's unit
    """

    focus: np.ndarray
    toward: np.ndarray
    right: np.ndarray
    up: np.ndarray
    width: float
    height: float

    def project(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points to (..., 3): right, up (from the picture's centre) and depth toward the eye."""
        return (points - self.focus) @ np.stack([self.right, self.up, self.toward], axis=1)

    @classmethod
    def framing(cls, points: np.ndarray, margin: float = 0.04) -> Camera:
        """A view from the front, right and above that just holds ``points`` (n, 3).

        Slender bodies are seen more from the side, so that their length runs across the picture.
        """
        size = np.sort(np.ptp(points, axis=0))
        longest = int(np.argmax(np.ptp(points, axis=0)))
        slender = size[2] > 3 * size[1]
        direction = {0: (0.45, -1.0, 0.45), 1: (1.0, -0.45, 0.45), 2: (0.7, -1.0, 0.3)}[longest] \
            if slender else (0.75, -1.0, 0.6)
        toward = np.array(direction) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], toward)
        right /= np.linalg.norm(right)
        up = np.cross(toward, right)
        seen = points @ np.stack([right, up, toward], axis=1)
        low, high = seen.min(axis=0), seen.max(axis=0)
        span = np.maximum(high - low, 1e-9 * max(size[2], 1e-300))
        pad = 2 * margin * span[:2].max()
        focus = np.stack([right, up, toward], axis=1) @ (0.5 * (low + high))
        return cls(focus, toward, right, up, float(span[0] + pad), float(span[1] + pad))
