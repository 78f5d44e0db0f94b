"""Faces of joints: triangles between the nodes of flat ones of which only nodes are known, and what
seems wrong with given faces.

No file says which faces there should be: what contradicts itself is refused, what is merely odd is
told.
"""

from __future__ import annotations

import numpy as np

from orchestrator.errors import InputError, KeyPath, some, wrong
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import area_vectors, facet_normals, format_point
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES
from orchestrator.linalg import svd, WRITTEN

# Between nodes that are spread evenly triangles are at most this much larger than the smallest at
# their corners: twice on
# grids without the nodes in the middle of squares, three times on irregular ones. Above the second
# there is a void.
UNEVEN, VOID = 1.6, 3.5
# Cosine between the normals of two faces beside each other below which they lie on each other:
# edges sharper than 18° are none.
FOLDED = -0.95
HOLE = 8  # edges up to which a hole looks like a missing face
# Share of a plane's faces up to which area between nodes that none of them covers is odd: what is
# larger is meant. Below the second it is rounding. Planes with less than LARGE of a joint's area
# are passed over.
ODD, NONE, LARGE = 0.2, 1e-6, 0.1
SMOOTH = 0.5  # cosine between normals of faces above which no edge is between them


def of_plane(points: np.ndarray, outward: np.ndarray, path: KeyPath,
             name: str) -> tuple[list[np.ndarray], list[str]]:
    """A table of triangles (k, 3) between the nodes of a flat joint, outward, and what is to be
    said of them.

    Raises InputError: nodes off the plane; triangles across what may be a void
    """
    normal = outward / (np.linalg.norm(outward) or 1.0)
    off = np.abs((points - points.mean(axis=0)) @ normal).max()
    if not np.linalg.norm(outward) or off > WRITTEN * size_of(points):
        raise wrong(path,
                    f"nodes of '{name}' that are up to {off:.3g} off a plane across "
                    f"{outward.tolist()}",
                    "three nodes or more on one plane",
                    "give the normal of the joint's plane, or facets: a file with the joint's "
                    "faces")
    triangles, area, beside = between_nodes(points, normal)
    if not len(triangles):
        raise wrong(path, f"{len(points)} nodes of '{name}', all on one line",
                    "three nodes or more on a plane, not on a line",
                    "add the joint's other nodes")
    where = points[triangles[beside.argmax()]].mean(axis=0)
    made = f"{area.sum():.4g} of area between the {len(points)} nodes of '{name}'"
    if beside.max() > VOID:
        raise wrong(path,
                    f"{made}, with a face {beside.max():.2g} times as large as those beside it, at "
                    f"{format_point(where)}: there may be a void",
                    "nodes spread evenly over a joint that fills its convex hull",
                    "give facets: a file with the joint's faces")
    large = area[beside > UNEVEN].sum()
    return [triangles], [f"{made} are its joint, up to their convex hull" + (
        f", {large:.4g} of it in faces more than {UNEVEN:g} times as large as those beside them, "
        f"the largest at {format_point(where)}"
        if large else "") + "; if there is a void, give facets"]


def between_nodes(points: np.ndarray,
                  normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (k, 3) between points (n, 3) of a plane, turning about its normal, up to their
    convex hull; their areas (k,),
    and how many times as large they are as the smallest at their corners, in the mean; none between
    points on a line."""
    from scipy.spatial import Delaunay  # for joints without faces alone

    flat = points @ svd(normal[None])[2][1:].T
    if len(points) < 3 or svd(flat - flat.mean(axis=0),
                              full_matrices=False)[1][1] <= WRITTEN * size_of(points):
        return np.empty((0, 3), int), np.empty(0), np.empty(0)
    triangles = Delaunay(flat).simplices.astype(int)
    signed = area_vectors(points, triangles) @ normal
    longest = np.max([np.sum((points[triangles[:, i]] - points[triangles[:, i - 1]]) ** 2, axis=1)
                      for i in range(3)], axis=0)
    there = np.abs(signed) > WRITTEN * longest  # slivers along straight edges are rounding
    triangles[signed < 0] = triangles[signed < 0][:, ::-1]
    triangles, area = triangles[there], np.abs(signed[there])
    least = np.full(len(points), np.inf)
    np.minimum.at(least, triangles, area[:, None])
    return triangles, area, area / np.median(least[triangles], axis=1)


def check_surface(ids: np.ndarray, points: np.ndarray, triangles: np.ndarray, path: KeyPath,
                  name: str) -> None:
    """Check a surface of triangles (k, 3), indices of nodes with numbers ids (n,).

    Raises InputError: edges that two faces pass in the same direction, faces that fold back on each
    other
    """
    edges = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    way, first, count = np.unique(edges[:, 0] * len(points) + edges[:, 1], return_index=True,
                                  return_counts=True)
    if (count > 1).any():
        raise _wrong(path, name, ids[edges[first[count.argmax()]]], "have it in the same direction",
                     "turn one of them over, or leave out what comes twice")
    back = edges[:, 1] * len(points) + edges[:, 0]
    at = np.minimum(np.searchsorted(way, back), len(way) - 1)
    shared = np.flatnonzero(way[at] == back)
    normal = facet_normals(points, triangles)[0]
    cosine = np.einsum("ij,ij->i", normal[shared // 3], normal[first[at[shared]] // 3])
    if len(shared) and cosine.min() < FOLDED:
        raise _wrong(path, name, ids[edges[shared[cosine.argmin()]]], "lie on each other",
                     "look for ids that are exchanged, in the table of nodes or in the faces")


def _wrong(path: KeyPath, name: str, edge: np.ndarray, found: str, cure: str) -> InputError:
    return wrong(path,
                 f"'{name}': two faces at the edge between nodes {edge[0]} and {edge[1]} {found}",
                 "faces beside each other, all anticlockwise seen from outside", cure)


def holes(points: np.ndarray, triangles: np.ndarray, quadratic: bool, name: str) -> list[str]:
    """Return a sentence for each small hole in a surface of triangles (k, 3), of faces with nodes
    in the middle of edges perhaps.
    """
    return [
        f"faces of {name!r} leave a hole of {len(loop)} edges at "
        f"{format_point(points[loop].mean(axis=0))}: are faces missing?"
            for loop in _inner_borders(triangles) if len(loop) <= HOLE * (1 + quadratic)]


def bare(points: np.ndarray, triangles: np.ndarray, others: np.ndarray, name: str) -> list[str]:
    """Return a sentence for each plane where a joint's faces leave out a little between nodes.

    points : (n, 3); triangles : (k, 3), its faces; others : (m, 3), the part's nodes on no face
    """
    found, vectors = [], area_vectors(points, triangles)
    area, centres = np.linalg.norm(vectors, axis=1), points[triangles].mean(axis=1)
    near = WRITTEN * size_of(points)
    left = np.ones(len(area), dtype=bool)
    for at in np.argsort(-area, kind="stable")[: int(4 / LARGE)]:
        normal, origin = vectors[at] / area[at], centres[at]
        own = left & (vectors @ normal > (1 - WRITTEN) * area)
        own &= np.abs((centres - origin) @ normal) <= near
        left &= ~own
        covered = area[own].sum()
        if not own.any() or covered < LARGE * area.sum():
            continue
        beside = others[np.abs((others - origin) @ normal) <= near]
        every = np.vstack([points[np.unique(triangles[own])], beside])
        made, between, larger = between_nodes(every, normal)
        even = larger <= 2 * UNEVEN
        missing = between[even].sum() - covered
        if NONE * covered < missing <= ODD * covered:
            moment = between[even] @ every[made[even]].mean(axis=1) - area[own] @ centres[own]
            found.append(
                f"faces of {name!r} cover {covered:.4g} of area, and {missing:.2g} between nodes "
                f"beside them, about {format_point(moment / missing)}, is on none: are faces "
                "missing?")
    return found


def forgotten(faces: list[np.ndarray], own: np.ndarray, ids: np.ndarray, points: np.ndarray,
              name: str) -> list[str]:
    """Return a sentence on nodes that a joint's set seems to have forgotten, or none.

    These are the only ones that faces going on smoothly from the joint's lack, all round them.

    faces : tables (f, 3, 4, 6 or 8), numbers of nodes of all outer faces, corners first
    own : numbers of the set's nodes; ids : (n,) ascending, points : (n, 3), all nodes
    """
    rows, of_joint, of_single = [], np.zeros((len(ids), 3)), np.zeros((len(ids), 3))
    for table in faces:
        at, lost = np.searchsorted(ids, table), ~np.isin(table, own)
        x, whole = points[at[:, : 4 if table.shape[1] in (4, 8) else 3]], ~lost.any(axis=1)
        normal = np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + np.finfo(float).tiny
        np.add.at(of_joint, at[whole], normal[whole, None])
        rows.append((at, lost, normal))
    smooth = SMOOTH * np.linalg.norm(of_joint, axis=1)
    for at, lost, normal in rows:
        goes_on = (np.einsum("fx,fcx->fc", normal, of_joint[at]) > smooth[at]).any(axis=1)
        row, column = np.nonzero(lost & (goes_on & (lost.sum(axis=1) == 1))[:, None])
        np.add.at(of_single, at[row, column], normal[row])
    length = np.linalg.norm(of_single, axis=1)
    told = length > 0
    for at, lost, normal in rows:
        ends = lost & (lost.sum(axis=1) > 1)[:, None]
        ends &= np.einsum("fx,fcx->fc", normal, of_single[at]) > SMOOTH * length[at]
        told[at[ends]] = False  # faces beyond the joint's end
    gone = ids[told].tolist()
    named = some(list(map(str, gone)))
    return [f"{name}: faces beside its own have all other nodes in its set, but not {named}: are "
            "these forgotten?"] if gone else []


def _inner_borders(triangles: np.ndarray) -> list[np.ndarray]:
    """Nodes of each border of a connected surface but its longest."""
    size = int(triangles.max()) + 1
    edges = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    border = edges[~np.isin(edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0])]
    loop, piece = components(*border.T, size)[1], components(*edges.T, size)[1]
    loops = [np.flatnonzero(loop == own) for own in np.unique(loop[border[:, 0]])]
    longest = {own: max((len(other) for other in loops if piece[other[0]] == own), default=0)
               for own in np.unique(piece[border[:, 0]]).tolist()}
    return [own for own in loops if len(own) < longest[int(piece[own[0]])]]
