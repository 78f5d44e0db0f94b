"""What a patch of facets is like at its nodes: local mesh size, area, normals."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors

PLACES = 64 * np.finfo(float).eps


def local_size(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) local mesh size at the nodes of a patch: √(2 × mean area of the adjacent facets); 0 where there is none.

    On a structured patch of right triangles this is the length of their legs.

    Parameters
    ----------
    points : (n, 3); triangles : (k, 3 or 6) int, indices of points
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
    """(n,) a third of the area of the facets around each corner; none for mid-edge nodes.

    Parameters
    ----------
    points : (n, 3); triangles : (k, 3 or 6) int, indices of points
    """
    corners = triangles[:, :3]
    area = np.linalg.norm(area_vectors(points, corners), axis=1)
    return np.bincount(corners.ravel(), weights=np.repeat(area / 3, 3), minlength=len(points))


def node_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals at the nodes: mean of the facets' normals weighted by their angle there.

    In the middle of an edge all angles are the same.

    Parameters
    ----------
    points : (n, 3); triangles : (k, 3 or 6) int, indices of points
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
