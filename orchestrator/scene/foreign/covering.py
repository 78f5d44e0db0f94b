"""Whether a joint's faces are one surface, and whether some of them seem to be missing.

No file says which faces there should be: what contradicts itself is refused, what is merely odd is told.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.foreign.flat import UNEVEN, between_nodes
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quality import format_point

# Cosine between the normals of two faces beside each other below which they lie on each other: edges sharper than 18° are none.
FOLDED = -0.95
# Points and normals that are one plane's, in units of the joint's extent; planes with less than this share of its area are passed over.
PLANE, LARGE = 1e-6, 0.1
# Share of a plane's faces up to which area between nodes that none of them covers is odd: what is larger is meant.
ODD = 0.2
INSIDE = (np.ones((3, 3)) + 2 * np.eye(3)) / 5  # points of a triangle where it is asked whether a face covers it
NEAREST = 16  # faces asked whether a point is in them
HOLE = 8  # edges up to which a hole looks like a missing face


def check_surface(ids: np.ndarray, points: np.ndarray, triangles: np.ndarray, path: KeyPath, name: str) -> None:
    """Of triangles (k, 3), indices of nodes with numbers ids (n,).

    Raises
    ------
    InputError : edges that two faces pass in the same direction, faces that fold back on each other
    """
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    way, first, count = np.unique(edges[:, 0] * len(points) + edges[:, 1], return_index=True, return_counts=True)
    if (count > 1).any():
        raise _wrong(path, name, ids[edges[first[count.argmax()]]], "have it in the same direction", "turn one of them over, or leave out "
                     "what comes twice")
    back = edges[:, 1] * len(points) + edges[:, 0]
    at = np.minimum(np.searchsorted(way, back), len(way) - 1)
    shared = np.flatnonzero(way[at] == back)
    normal = area_vectors(points, triangles)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normal[shared // 3], normal[first[at[shared]] // 3])
    if len(shared) and cosine.min() < FOLDED:
        raise _wrong(path, name, ids[edges[shared[cosine.argmin()]]], "lie on each other", "look for ids that are exchanged, in the table of "
                     "nodes or in the faces")


def _wrong(path: KeyPath, name: str, edge: np.ndarray, found: str, cure: str) -> InputError:
    return InputError(Problem(path, f"'{name}': two faces at the edge between nodes {edge[0]} and {edge[1]} {found}",
                              "faces beside each other, all anticlockwise seen from outside", cure))


def missing_faces(points: np.ndarray, triangles: np.ndarray, others: np.ndarray, name: str) -> list[str]:
    """Sentences on faces that may be missing.

    Parameters
    ----------
    points : (n, 3); triangles : (k, 3), their faces; others : (m, 3) the part's nodes that are on none
    """
    found, flat = [], np.zeros(len(triangles), dtype=bool)
    for own, normal in _planes(points, triangles):
        flat |= own
        origin = points[triangles[own][0, 0]]
        every = np.vstack([points[np.unique(triangles[own])], others[np.abs((others - origin) @ normal) <= PLANE * size_of(points)]])
        made, area, beside = between_nodes(every, normal)
        samples = np.einsum("sc,kcx->skx", INSIDE, every[made])  # diagonals may be others than the faces'
        bare = area * (beside <= 2 * UNEVEN) * ~_covered(samples.reshape(-1, 3), points[triangles[own]], normal).reshape(len(INSIDE), -1) / 3
        covered = np.linalg.norm(area_vectors(points, triangles[own]), axis=1).sum()
        if 0 < bare.sum() <= ODD * covered:
            where = format_point(samples.reshape(-1, 3)[bare.argmax()])
            found.append(f"faces of {name!r} cover {covered:.4g} of area, and about {bare.sum():.2g} between nodes beside them, at {where}, "
                         "is on none: are faces missing?")
    holes = [loop for loop in _holes(triangles) if not flat[np.isin(triangles, loop).any(axis=1)].all()]
    return found + [f"faces of {name!r} leave a hole of {len(loop)} edges at {format_point(points[loop].mean(axis=0))}: are faces missing?"
                    for loop in holes if len(loop) <= HOLE]


def _planes(points: np.ndarray, triangles: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each plane with much of the area, which triangles (k,) lie on it, and its normal."""
    vectors = area_vectors(points, triangles)
    area = np.linalg.norm(vectors, axis=1)
    left, size = np.ones(len(triangles), dtype=bool), size_of(points)
    for at in np.argsort(-area, kind="stable")[: int(4 / LARGE)]:
        if not left[at]:
            continue
        normal = vectors[at] / area[at]
        own = left & (vectors @ normal > (1 - PLANE) * area)
        own &= (np.abs((points[triangles] - points[triangles[at, 0]]) @ normal) <= PLANE * size).all(axis=1)
        left &= ~own
        if area[own].sum() >= LARGE * area.sum():
            yield own, normal


def _covered(at: np.ndarray, faces: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(p,) bool, which points (p, 3) of a plane are in one of the triangles (k, 3, 3) there, or on its edge."""
    from scipy.spatial import cKDTree  # such parts alone ask

    nearest = cKDTree(faces.mean(axis=1)).query(at, min(NEAREST, len(faces)))[1].reshape(len(at), -1)
    corners = faces[nearest]
    inside = np.ones(nearest.shape, dtype=bool)
    for i in range(3):
        along = corners[:, :, (i + 1) % 3] - corners[:, :, i]
        inside &= np.cross(along, at[:, None] - corners[:, :, i]) @ normal >= -PLANE * np.einsum("ijk,ijk->ij", along, along)
    return inside.any(axis=1)


def _holes(triangles: np.ndarray) -> list[np.ndarray]:
    """Nodes of each border of a connected surface but its longest."""
    size = int(triangles.max()) + 1
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    border = edges[~np.isin(edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0])]
    loop, piece = components(*border.T, size)[1], components(*edges.T, size)[1]
    loops = [np.flatnonzero(loop == own) for own in np.unique(loop[border[:, 0]])]
    longest = {own: max((len(other) for other in loops if piece[other[0]] == own), default=0) for own in np.unique(piece[border[:, 0]]).tolist()}
    return [own for own in loops if len(own) < longest[int(piece[own[0]])]]
