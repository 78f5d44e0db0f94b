"""Areas, volumes, gradients; local size, area and normals at the nodes of a patch. Nodes amid edges play no part unless told."""

from __future__ import annotations

import numpy as np


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k, 3) vector products; four times as fast as numpy's, which is made for any axis and dimension."""
    (a1, a2, a3), (b1, b2, b3) = a.T, b.T
    result = np.empty((3, len(a)))
    result[0], result[1], result[2] = a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1
    return result.T


def area_vectors(nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(k, 3) normals of triangles (k, 3 or 6), each as long as the triangle's area."""
    p, q, r = (nodes[triangles[:, i]] for i in range(3))
    return cross(q - p, r - p) / 2


def tet_volumes(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) volumes of tets (m, 4 or 10), positive where the fourth corner is on the side that the first three turn to."""
    p, q, r, s = (nodes.take(corner, axis=0) for corner in cells[:, :4].T)
    return np.einsum("ij,ij->i", cross(q - p, r - p), s - p) / 6


def skew(vectors: np.ndarray) -> np.ndarray:
    """(…, 3, 3) matrices of v ×."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape, 3)


def shape_gradients(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 4, 3) gradients of the four linear shape functions, 1/length, and (m,) volumes, positive for positively oriented tets.

    nodes : (n, 3) float; cells : (m, 4 or 10) int, edges straight
    """
    corners = nodes.T.take(cells[:, :4].T, axis=1)
    a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    gradients = np.empty((4, 3, len(cells)))
    for one, (p, q) in zip(gradients[1:], ((b, c), (c, a), (a, b))):
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            np.subtract(p[y] * q[z], p[z] * q[y], out=one[x])
    six_volumes = (a * gradients[1]).sum(axis=0)
    gradients[1:] /= six_volumes
    np.negative(gradients[1:].sum(axis=0), out=gradients[0])
    return gradients.transpose(2, 0, 1), six_volumes / 6.0


PLACES = 64 * np.finfo(float).eps


def local_size(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) local mesh size at points (n, 3) of triangles (k, 3 or 6): √(2 × mean area of the adjacent ones); 0 where there is none.

    On a structured patch of right triangles this is the length of their legs.
    """
    area = np.linalg.norm(area_vectors(points, triangles), axis=1)
    count = np.bincount(triangles.ravel(), minlength=len(points))
    total = np.bincount(triangles.ravel(), weights=np.repeat(area, triangles.shape[1]), minlength=len(points))
    return np.sqrt(2 * total / np.maximum(count, 1))


def rounding(points: np.ndarray, h: np.ndarray | float) -> np.ndarray:
    """(n,) distances that are rounding where elements measure some h (n,): a share of h, or units in the last place of the
    coordinates that may add up on the way."""
    return np.maximum(h, PLACES * np.abs(points).max(initial=0.0))


def node_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) a third of the area of the triangles (k, 3 or 6) around each of points (n, 3); none for nodes amid edges."""
    corners = triangles[:, :3]
    area = np.linalg.norm(area_vectors(points, corners), axis=1)
    return np.bincount(corners.ravel(), weights=np.repeat(area / 3, 3), minlength=len(points))


def node_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals at points (n, 3): mean of the normals of triangles (k, 3 or 6) weighted by their angle there.

    In the middle of an edge all angles are the same.
    """
    corners = points[triangles[:, :3]]
    normal = area_vectors(points, triangles)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    result = np.zeros_like(points)
    for i in range(3):
        u = corners[:, (i + 1) % 3] - corners[:, i]
        v = corners[:, (i + 2) % 3] - corners[:, i]
        cosine = np.einsum("ij,ij->i", u, v) / (np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1))
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(result, triangles[:, i], angle[:, None] * normal)
    for middle in triangles[:, 3:].T:
        np.add.at(result, middle, np.pi * normal)
    length = np.linalg.norm(result, axis=1, keepdims=True)
    return result / np.where(length > 0, length, 1.0)
