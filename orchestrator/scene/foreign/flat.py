"""Faces of joints: triangles between the nodes of flat ones of which only nodes are known, and what seems wrong with given faces.

No file says which faces there should be: what contradicts itself is refused, what is merely odd is told.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import area_vectors, areas, facet_normals, format_point
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES

# Nodes this near one plane, in units of the joint's extent, are on it; normals likewise.
PLANE = 1e-6
# Triangles between nodes on a plane that are thinner than this share of their longest edge squared lie along its border.
THIN = 1e-6
# Between nodes that are spread evenly triangles are at most this much larger than the smallest at their corners: twice on
# grids without the nodes in the middle of squares, three times on irregular ones. Above the second there is a void.
UNEVEN, VOID = 1.6, 3.5
# Cosine between the normals of two faces beside each other below which they lie on each other: edges sharper than 18° are none.
FOLDED = -0.95
# Planes with less than this share of a joint's area are passed over.
LARGE = 0.1
# Share of a plane's faces up to which area between nodes that none of them covers is odd: what is larger is meant.
ODD = 0.2
INSIDE = (np.ones((3, 3)) + 2 * np.eye(3)) / 5  # points of a triangle where it is asked whether a face covers it
NEAREST = 16  # faces asked whether a point is in them
HOLE = 8  # edges up to which a hole looks like a missing face
SMOOTH = 0.5  # cosine between normals of faces, up to which edges are none: those of a bore of six facets count as smooth
NAMED = 6  # nodes


def of_plane(points: np.ndarray, outward: np.ndarray, path: KeyPath, name: str) -> tuple[list[np.ndarray], list[str]]:
    """A table of triangles (k, 3) between the nodes of a flat joint, outward, and what is to be said of them.

    Raises InputError: nodes off the plane; triangles across what may be a void
    """
    normal = outward / (np.linalg.norm(outward) or 1.0)
    off = np.abs((points - points.mean(axis=0)) @ normal).max()
    if not np.linalg.norm(outward) or off > PLANE * size_of(points):
        raise wrong(path, f"nodes of '{name}' that are up to {off:.3g} off a plane across {outward.tolist()}",
                    "three nodes or more on one plane", "give the normal of the joint's plane, or facets: a file with the joint's faces")
    triangles, area, beside = between_nodes(points, normal)
    if not len(triangles):
        raise wrong(path, f"{len(points)} nodes of '{name}', all on one line", "three nodes or more on a plane, not on a line",
                    "add the joint's other nodes")
    where = points[triangles[beside.argmax()]].mean(axis=0)
    made = f"{area.sum():.4g} of area between the {len(points)} nodes of '{name}'"
    if beside.max() > VOID:
        raise wrong(path, f"{made}, with a face {beside.max():.2g} times as large as those beside it, at {format_point(where)}: "
                    "there may be a void", "nodes spread evenly over a joint that fills its convex hull",
                    "give facets: a file with the joint's faces")
    large = area[beside > UNEVEN].sum()
    return [triangles], [f"{made} are its joint, up to their convex hull" + (
        f", {large:.4g} of it in faces more than {UNEVEN:g} times as large as those beside them, the largest at {format_point(where)}"
        if large else "") + "; if there is a void, give facets"]


def between_nodes(points: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (k, 3) between points (n, 3) of a plane, turning about its normal, up to their convex hull; their areas (k,),
    and how many times as large they are as the smallest at their corners, in the mean; none between points on a line."""
    from scipy.spatial import Delaunay  # for joints without faces alone

    flat = points @ np.linalg.svd(normal[None])[2][1:].T
    if len(points) < 3 or np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)[1] <= PLANE * size_of(points):
        return np.empty((0, 3), int), np.empty(0), np.empty(0)
    triangles = Delaunay(flat).simplices.astype(int)
    signed = area_vectors(points, triangles) @ normal
    longest = np.max([np.sum((points[triangles[:, i]] - points[triangles[:, i - 1]]) ** 2, axis=1) for i in range(3)], axis=0)
    there = np.abs(signed) > THIN * longest  # slivers along straight edges are rounding
    triangles[signed < 0] = triangles[signed < 0][:, ::-1]
    triangles, area = triangles[there], np.abs(signed[there])
    least = np.full(len(points), np.inf)
    np.minimum.at(least, triangles, area[:, None])
    return triangles, area, area / np.median(least[triangles], axis=1)


def check_surface(ids: np.ndarray, points: np.ndarray, triangles: np.ndarray, path: KeyPath, name: str) -> None:
    """Check a surface of triangles (k, 3), indices of nodes with numbers ids (n,).

    Raises InputError: edges that two faces pass in the same direction, faces that fold back on each other
    """
    edges = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    way, first, count = np.unique(edges[:, 0] * len(points) + edges[:, 1], return_index=True, return_counts=True)
    if (count > 1).any():
        raise _wrong(path, name, ids[edges[first[count.argmax()]]], "have it in the same direction", "turn one of them over, or leave out "
                     "what comes twice")
    back = edges[:, 1] * len(points) + edges[:, 0]
    at = np.minimum(np.searchsorted(way, back), len(way) - 1)
    shared = np.flatnonzero(way[at] == back)
    normal = facet_normals(points, triangles)[0]
    cosine = np.einsum("ij,ij->i", normal[shared // 3], normal[first[at[shared]] // 3])
    if len(shared) and cosine.min() < FOLDED:
        raise _wrong(path, name, ids[edges[shared[cosine.argmin()]]], "lie on each other",
                     "look for ids that are exchanged, in the table of "
                     "nodes or in the faces")


def _wrong(path: KeyPath, name: str, edge: np.ndarray, found: str, cure: str) -> InputError:
    return wrong(path, f"'{name}': two faces at the edge between nodes {edge[0]} and {edge[1]} {found}",
                 "faces beside each other, all anticlockwise seen from outside", cure)


def missing_faces(points: np.ndarray, triangles: np.ndarray, others: np.ndarray, name: str) -> list[str]:
    """Sentences on faces that may be missing.

    points : (n, 3); triangles : (k, 3), their faces; others : (m, 3) the part's nodes that are on none
    """
    found, flat = [], np.zeros(len(triangles), dtype=bool)
    for own, normal in _planes(points, triangles):
        flat |= own
        origin = points[triangles[own][0, 0]]
        every = np.vstack([points[np.unique(triangles[own])], others[np.abs((others - origin) @ normal) <= PLANE * size_of(points)]])
        made, area, beside = between_nodes(every, normal)
        samples = np.einsum("sc,kcx->skx", INSIDE, every[made])  # diagonals may be others than the faces'
        covers = _covered(samples.reshape(-1, 3), points[triangles[own]], normal).reshape(len(INSIDE), -1)
        bare = area * (beside <= 2 * UNEVEN) * ~covers / 3
        covered = areas(points, triangles[own]).sum()
        if 0 < bare.sum() <= ODD * covered:
            where = format_point(samples.reshape(-1, 3)[bare.argmax()])
            found.append(f"faces of {name!r} cover {covered:.4g} of area, and about {bare.sum():.2g} between nodes beside them, at "
                         f"{where}, is on none: are faces missing?")
    holes = [loop for loop in _holes(triangles) if not flat[np.isin(triangles, loop).any(axis=1)].all()]
    return found + [f"faces of {name!r} leave a hole of {len(loop)} edges at {format_point(points[loop].mean(axis=0))}: are faces missing?"
                    for loop in holes if len(loop) <= HOLE]


def _planes(points: np.ndarray, triangles: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Planes with much of the area: the triangles (k,) on each, and its normal."""
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
    edges = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    border = edges[~np.isin(edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0])]
    loop, piece = components(*border.T, size)[1], components(*edges.T, size)[1]
    loops = [np.flatnonzero(loop == own) for own in np.unique(loop[border[:, 0]])]
    longest = {own: max((len(other) for other in loops if piece[other[0]] == own), default=0)
               for own in np.unique(piece[border[:, 0]]).tolist()}
    return [own for own in loops if len(own) < longest[int(piece[own[0]])]]


def forgotten(faces: list[np.ndarray], own: np.ndarray, ids: np.ndarray, points: np.ndarray, name: str) -> list[str]:
    """A sentence on nodes that a joint's set seems to have forgotten, or none.

    faces : tables (f, 3, 4, 6 or 8), numbers of nodes of all outer faces, corners first
    own : numbers of the set's nodes; name : of the joint
    ids : (n,) ascending, points : (n, 3), all nodes
    """
    blocks = []
    for table in faces:  # four places for corners, four for the nodes in the middle of edges; -1: none
        count = 4 if table.shape[1] in (4, 8) else 3
        blocks.append(np.full((len(table), 8), -1))
        blocks[-1][:, :count], blocks[-1][:, 4 : 4 + table.shape[1] - count] = table[:, :count], table[:, count:]
    nodes = np.concatenate(blocks)
    lost, corners = (nodes >= 0) & ~np.isin(nodes, own), nodes[:, :4]
    x = points[np.searchsorted(ids, np.where(corners < 0, corners[:, [2]], corners))]
    normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    whole, out = ~lost.any(axis=1), lost[:, :4].sum(axis=1)
    lacks = np.unique(_smooth(corners, normal, np.flatnonzero(~whole & (out <= 1)), np.flatnonzero(whole), 2)[0])
    single = lacks[out[lacks] == 1]
    missing = np.searchsorted(ids, corners[single][lost[single, :4]])
    around, others = _smooth(np.where(lost[:, :4], corners, -1), normal, single, np.flatnonzero(out > 0), 1)
    # where nodes in the middle of edges are missing too, that may be a corner left out on purpose, unless faces are all round it
    every, found = (np.bincount(at, minlength=len(ids))[missing] for at in (np.searchsorted(ids, corners[corners >= 0]), missing))
    beyond = np.isin(single, around[out[others] > 1])  # a face beyond the joint's end
    told = np.setdiff1d(lacks, single[beyond | (lost[single].sum(axis=1) > 1) & (every > found)])
    if not len(told):
        return []
    gone = np.unique(nodes[told][lost[told]]).tolist()
    named = ", ".join(map(str, gone[:NAMED])) + (" …" if len(gone) > NAMED else "")
    return [f"{name}: faces beside its own, {len(told)} of them, have all other nodes in its set, but not {named}: are these forgotten?"]


def _smooth(corners: np.ndarray, normal: np.ndarray, first: np.ndarray, second: np.ndarray, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of faces, of the first and the second, that share so many corners (-1: none) at least and no edge is between."""
    row, column = np.nonzero(corners >= 0)
    nodes, place = np.unique(corners[row, column], return_inverse=True)
    table = sp.csr_array((np.ones(len(row)), (row, place)), shape=(len(corners), len(nodes)))
    shared = (table[first] @ table[second].T).tocoo()
    a, b = first[shared.row], second[shared.col]
    good = (shared.data >= least) & (np.einsum("ij,ij->i", normal[a], normal[b]) > SMOOTH)
    return a[good], b[good]
