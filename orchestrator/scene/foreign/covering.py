"""Whether a joint's faces are one surface, and whether some of them, or nodes of its set, seem to be missing.

No file says which faces there should be: what contradicts itself is refused, what is merely odd is told. Where a joint ends, the faces
beyond have other nodes outside too; where a node was forgotten, all faces round it, as far as the surface goes on smoothly, have all
corners in the set but this one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.foreign.flat import PLANE, UNEVEN, between_nodes
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quality import format_point

# Cosine between the normals of two faces beside each other below which they lie on each other: edges sharper than 18° are none.
FOLDED = -0.95
# Planes with less than this share of a joint's area are passed over.
LARGE = 0.1
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


SMOOTH = 0.5  # cosine between normals of faces, up to which edges are none: those of a bore of six facets count as smooth
NAMED = 6  # nodes


def forgotten(faces: list[np.ndarray], own: np.ndarray, ids: np.ndarray, points: np.ndarray, name: str) -> list[str]:
    """A sentence on nodes that seem to be forgotten, or none.

    Parameters
    ----------
    faces : tables (f, 3, 4, 6 or 8), numbers of nodes of all outer faces, corners first
    own : numbers of the set's nodes
    ids : (n,) ascending, points : (n, 3), all nodes
    name : of the joint
    """
    count = [4 if table.shape[1] in (4, 8) else 3 for table in faces]
    corners = np.concatenate([table[:, np.arange(4) % c] for table, c in zip(faces, count)])  # a triangle's first corner comes twice
    quad = np.repeat([c == 4 for c in count], [len(table) for table in faces])
    inside = np.isin(corners, own)
    out = (~inside).sum(axis=1) - (~quad & ~inside[:, 0])
    whole = np.concatenate([np.isin(table, own).all(axis=1) for table in faces])
    x = points[np.searchsorted(ids, corners)]
    normal = np.cross(x[:, 2] - x[:, 0], np.where(quad[:, None], x[:, 3], x[:, 2]) - x[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    beside = _smooth(corners, quad, normal, np.flatnonzero(~whole & (out <= 1)), np.flatnonzero(whole), 2)
    lacks = np.unique(beside[0])
    single = lacks[out[lacks] == 1]
    missing = corners[single, (~inside[single]).argmax(axis=1)]
    around, others = _smooth(np.where(inside, -1, corners), quad, normal, single, np.flatnonzero(out > 0), 1)
    keep = ~np.isin(single, around[out[others] > 1])  # no face beyond the joint's end
    # where nodes in the middle of edges are missing too, that may be a corner left out on purpose, unless faces are all round it
    alone = np.concatenate([(~np.isin(table, own)).sum(axis=1) for table in faces])[single] == 1
    keep &= alone | (_count(missing, missing) == _count(np.concatenate([table[:, :c].ravel() for table, c in zip(faces, count)]), missing))
    nodes, faces_told = [missing[keep]], int(keep.sum())
    for table, at in zip(faces, np.split(np.arange(len(corners)), np.cumsum([len(table) for table in faces])[:-1])):
        of_edges = table[np.isin(at, lacks[out[lacks] == 0])]
        nodes.append(of_edges[~np.isin(of_edges, own)])
        faces_told += len(of_edges)
    lost = np.unique(np.concatenate(nodes)).tolist()
    if not lost:
        return []
    named = ", ".join(map(str, lost[:NAMED])) + (" …" if len(lost) > NAMED else "")
    return [f"{name}: faces beside its own, {faces_told} of them, have all other nodes in its set, but not {named}: are these forgotten?"]


def _count(among: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """How often each of the nodes is among others."""
    ordered = np.sort(among)
    return np.searchsorted(ordered, nodes, "right") - np.searchsorted(ordered, nodes)


def _smooth(corners: np.ndarray, quad: np.ndarray, normal: np.ndarray, first: np.ndarray, second: np.ndarray,
            least: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of faces, of the first and the second, that share so many corners (-1: none) at least and no edge is between."""
    place = np.unique(corners, return_inverse=True)[1].reshape(corners.shape)
    valid = corners >= 0
    valid[:, 3] &= quad
    row, column = np.nonzero(valid)
    table = sp.csr_array((np.ones(len(row)), (row, place[row, column])), shape=(len(corners), int(place.max(initial=0)) + 1))
    shared = (table[first] @ table[second].T).tocoo()
    a, b = first[shared.row], second[shared.col]
    good = (shared.data >= least) & (np.einsum("ij,ij->i", normal[a], normal[b]) > SMOOTH)
    return a[good], b[good]
