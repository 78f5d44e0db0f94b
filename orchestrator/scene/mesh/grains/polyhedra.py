"""Polyhedral cells of a box: Voronoi cells of random seeds, their faces cut into triangles, and
what these tell of the bodies within.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree, Voronoi

from orchestrator.linalg import PLACED
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import area_vectors, cross, summed, unit

# Sides of the box in the order of their numbers; as second cell of a face, side s is written -1 -
# s.
SIDES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")


@dataclass
class Tessellation:
    """Polyhedral cells that fill a box from the origin and share vertices and faces.

    size : (3,) lengths of the box
    vertices : (v, 3) coordinates
    sides : (v, 6) bool, the sides of the box each vertex lies on
    loops : per face its vertices in order, seen counter-clockwise from outside of its first cell
    cells : (f, 2) int, the two cells of each face; the second is -1 - s on side s of the box
    """

    size: np.ndarray
    vertices: np.ndarray
    sides: np.ndarray
    loops: list[list[int]]
    cells: np.ndarray


def scattered(grains: int, size: np.ndarray, seed: int, lloyd: int) -> Tessellation:
    """The cells of uniformly random points, moved ``lloyd`` times to the centroids of their cells.

    size : (3,) lengths of the box
    """
    points = np.random.default_rng(seed).random((grains, 3)) * size
    for _ in range(lloyd):
        points = centroids(tessellated(points, size))
    return tessellated(points, size)


def tessellated(points: np.ndarray, size: np.ndarray) -> Tessellation:
    """The Voronoi cells of points (n, 3) inside the box of lengths ``size`` (3,).

    Mirror copies of the points behind the six sides make the sides faces of the diagram.
    """
    n, copies = len(points), [points]
    for axis in range(3):
        for plane in (0.0, size[axis]):
            copy = points.copy()
            copy[:, axis] = 2 * plane - copy[:, axis]
            copies.append(copy)
    diagram = Voronoi(np.concatenate(copies))
    vertices, sides, merged = _snapped(diagram.vertices, size)
    loops, cells = [], []
    for (p, q), ridge in zip(diagram.ridge_points, diagram.ridge_vertices):
        one, other = min(p, q), max(p, q)
        side, original = divmod(other - n, n)
        # A cell and the copy of another one meet in a line at most.
        if one >= n or -1 in ridge or (other >= n and original != one):
            continue
        loop = without_repeats([int(merged[v]) for v in ridge])
        if len(loop) < 3:
            continue
        outward = diagram.points[other] - diagram.points[one]
        loops.append(loop if area_vector(vertices[loop]) @ outward > 0 else loop[::-1])
        cells.append((one, other if other < n else -1 - side))
    return Tessellation(size, vertices, sides, loops, np.array(cells))


def _snapped(vertices: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices inside the box, exactly on its sides where they belong there; (v, 6) those sides;
    old → new index.
    """
    vertices = vertices.copy()
    near = PLACED * size.max()
    for axis in range(3):
        for plane in (0.0, size[axis]):
            vertices[np.abs(vertices[:, axis] - plane) < near, axis] = plane
    inside = np.flatnonzero(np.all((vertices >= 0) & (vertices <= size), axis=1))
    pairs = cKDTree(vertices[inside]).query_pairs(near, output_type="ndarray")
    count, label = components(pairs[:, 0], pairs[:, 1], len(inside))
    first = inside[np.unique(label, return_index=True)[1]]
    merged = np.full(len(vertices), -1)
    merged[inside] = label
    kept = vertices[first]
    sides = np.stack([kept[:, axis] == plane for axis in range(3) for plane in (0.0, size[axis])],
                     axis=1)
    return kept, sides, merged


def centroids(cells: Tessellation) -> np.ndarray:
    """(n, 3) centres of mass of convex cells."""
    fans, owners = [], []
    for loop, (one, other) in zip(cells.loops, cells.cells):
        fan = [(loop[0], loop[k], loop[k + 1]) for k in range(1, len(loop) - 1)]
        fans += fan
        owners += [one] * len(fan)
        if other >= 0:
            fans += [triangle[::-1] for triangle in fan]
            owners += [other] * len(fan)
    count, owners = int(cells.cells.max()) + 1, np.array(owners)
    p, q, r = np.moveaxis(cells.vertices[np.array(fans)], 1, 0)
    volume = np.einsum("ij,ij->i", np.cross(p, q), r) / 6
    moment = volume[:, None] * (p + q + r) / 4
    return summed(owners, moment, count) / np.bincount(owners, volume, count)[:, None]


def without_repeats(loop: list[int]) -> list[int]:
    """A closed loop without equal neighbours."""
    return [v for k, v in enumerate(loop) if v != loop[k - 1]]


def area_vector(points: np.ndarray) -> np.ndarray:
    """(3,) normal of a closed polygon (k, 3), as long as its area."""
    return np.ascontiguousarray(cross(points, points[[*range(1, len(points)), 0]])).sum(axis=0) / 2


def loop_vectors(points: np.ndarray, loops: Sequence[list[int]]) -> np.ndarray:
    """(k, 3) the same of many polygons, given by their corners among points (v, 3)."""
    count = np.array([len(loop) for loop in loops])
    ends = np.cumsum(count)
    at = points[np.concatenate(loops)]
    after = np.arange(1, len(at) + 1)
    after[ends - 1] = ends - count
    return np.add.reduceat(cross(at, at[after]), ends - count) / 2


# From some point of a body all planes of its surface are this far at least, per cube root of its
# volume; and
# for how long to look for the point.
SEEN, LOOKS = 0.02, 50
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # corners of a triangle, from each
Triangles = list[tuple[int, int, int]]


def cut(points: np.ndarray, loops: list[list[int]]) -> list[Triangles | None]:
    """Cuts polygons, not necessarily plane, into triangles whose smallest angle is as large as
    possible.

    points : (v, 3) coordinates
    loops : per polygon the indices of its corners, in order
    Returns per polygon triangles turning like the loop, or None when it is so bent that there are
    none
    """
    chosen = [_triples(len(loop))[0] for loop in loops]
    corners = np.concatenate([np.array(loop)[triples] for loop, triples in zip(loops, chosen)])
    # Negative where a triangle turns the other way.
    turns = np.repeat(loop_vectors(points, loops), [len(triples) for triples in chosen], axis=0)
    angle = corner_angles(points[corners]).min(axis=1)
    angle = np.where(np.einsum("ij,ij->i", area_vectors(points, corners), turns) > 0, angle,
                     -1.0).tolist()
    ends = np.cumsum([len(triples) for triples in chosen]).tolist()
    return [_best(loop, angle[end - len(triples):end])
            for loop, triples, end in zip(loops, chosen, ends)]


@cache
def _triples(k: int) -> tuple[np.ndarray, dict[tuple[int, ...], int]]:
    """(t, 3) all i < m < j below k, and the place of each."""
    found = list(combinations(range(k), 3))
    return np.array(found), {triple: place for place, triple in enumerate(found)}


def _best(loop: list[int], angle: list[float]) -> Triangles | None:
    """The triangles of a polygon, given the smallest angle of each that there may be
    (``_triples``).
    """
    k, place = len(loop), _triples(len(loop))[1]
    if k == 3:  # most often
        return [tuple(loop)] if angle[0] > 0 else None
    # best[i, j]: the largest smallest angle over all ways to cut the corners i … j; split: their
    # third corner.
    best, split = {(i, i + 1): np.inf for i in range(k - 1)}, {}
    for span in range(2, k):
        for i in range(k - span):
            j = i + span
            choices = [(min(best[i, m], best[m, j], angle[place[i, m, j]]), m)
                       for m in range(i + 1, j)]
            best[i, j], split[i, j] = max(choices, key=lambda choice: choice[0])
    if best[0, k - 1] <= 0:
        return None
    triangles, todo = [], [(0, k - 1)]
    while todo:
        i, j = todo.pop()
        if j > i + 1:
            m = split[i, j]
            triangles.append((loop[i], loop[m], loop[j]))
            todo += [(i, m), (m, j)]
    return triangles


def corner_angles(triangles: np.ndarray) -> np.ndarray:
    """(k, 3) angles in radians of triangles (k, 3, 3); zero in triangles without area."""
    to_next = (triangles[:, NEXT] - triangles).reshape(-1, 3)
    to_last = (triangles[:, LAST] - triangles).reshape(-1, 3)
    sine = np.linalg.norm(cross(to_next, to_last), axis=-1)
    return np.arctan2(sine, np.einsum("ij,ij->i", to_next, to_last)).reshape(-1, 3)


def narrowest(points: np.ndarray, triangles: np.ndarray, body: np.ndarray) -> np.ndarray | None:
    """Quality of some bodies, from the triangles that bound them.

    points : (v, 3) coordinates
    triangles : (t, 3) int, indices into the points, turning outward
    body : (t,) int, ascending, the body each triangle bounds
    Returns of each body the smallest angle in radians, in a triangle or between two neighbours
    through the body; or None when one of them is no ball or cannot be seen as a whole from a point
    inside. Bodies that can, share faces and fill a space cannot overlap.
    """
    body = np.unique(body, return_inverse=True)[1]
    mate = _mates(triangles, body, len(points))
    if mate is None:
        return None
    shape = points[triangles]
    p, q, r = np.moveaxis(shape, 1, 0)
    normal = area_vectors(points, triangles)
    volume = np.einsum("ij,ij->i", normal, p) / 3
    total = np.bincount(body, volume)
    if np.any(total <= 0):
        return None
    moment = volume[:, None] * (p + q + r) / 4
    centre = summed(body, moment, len(total)) / total[:, None]
    normal = unit(normal)
    if not _seen_whole(normal, np.einsum("ij,ij->i", normal, p), body, centre,
                       SEEN * np.cbrt(total)):
        return None
    along = unit((shape[:, NEXT] - shape).reshape(-1, 3))
    one, other = np.repeat(normal, 3, axis=0), normal[mate // 3]
    turn = np.arctan2(np.einsum("ij,ij->i", cross(one, other), along),
                      np.einsum("ij,ij->i", one, other))
    least = np.minimum((np.pi - turn).reshape(-1, 3), corner_angles(shape)).min(axis=1)
    return np.minimum.reduceat(least, np.flatnonzero(np.diff(body, prepend=-1)))


def _mates(triangles: np.ndarray, body: np.ndarray, points: int) -> np.ndarray | None:
    """Per side of a triangle (3 t) the same side of the neighbour; None unless every body's surface
    is a ball's.
    """
    start, end, label = triangles.reshape(-1), np.roll(triangles, -1,
                                                       axis=1).reshape(-1), np.repeat(body, 3)
    key, opposite = (label * points + start) * points + end, (label * points + end) * points + start
    order, back = np.argsort(key), np.argsort(opposite)
    if np.any(key[order] != opposite[back]) or np.any(np.diff(key[order]) == 0):
        return None
    # Closed; then Euler's number, 2 for a ball, counts 3/2 edges per triangle.
    corners = np.bincount(np.unique(label * points + start) // points)
    if np.any(2 * corners - np.bincount(body) != 4):
        return None
    mate = np.empty(len(key), dtype=int)
    mate[order] = back
    return mate


def _seen_whole(normal: np.ndarray, offset: np.ndarray, body: np.ndarray, point: np.ndarray,
                margin: np.ndarray) -> bool:
    """Whether in every body there is a point with all planes of the surface a margin before it.

    normal, offset : (t, 3) and (t,), the planes normal · x = offset
    body : (t,) int, ascending
    point : (b, 3), where to begin looking
    margin : (b,) lengths
    """
    point, start = point.copy(), np.flatnonzero(np.r_[True, body[1:] != body[:-1]])
    for _ in range(LOOKS):
        lacking = margin[body] - offset + np.einsum("ij,ij->i", normal, point[body])
        most = np.maximum.reduceat(lacking, start)
        if np.all(most <= 0):
            return True
        # Away from the plane that is worst (Agmon's relaxation).
        worst = np.flatnonzero(lacking == most[body])
        worst = worst[np.unique(body[worst], return_index=True)[1]]
        point -= np.maximum(most * 1.01, 0)[:, None] * normal[worst]
    return False
