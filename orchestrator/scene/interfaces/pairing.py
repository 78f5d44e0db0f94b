"""Opposite faces of different parts, matched node by node where the parts share no faces.

Two outer faces match when they face each other and each corner of one projects, along the mean of their normals,
onto a corner of the other. Parts that touch with coincident but separately numbered nodes match under any law;
under ``gap: geometry`` the faces may be apart, and how far they are is the initial gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.mesh.faces import Faces, edge_patches, pack
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.mesh import Mesh

# Nodes closer than this share of the local mesh size h = √(2 × facet area) coincide.
COINCIDE = 1e-3
# Search distance of gaps, and how deep parts may reach into each other to be noticed, in h.
REACH, DEEP = 2.0, 0.5
# Corners may miss each other sideways by this share of h, or of their distance where that is larger: normals turn.
ASIDE = 0.3
# Two faces are opposite when the cosine between their normals is below this.
OPPOSITE = -0.7
# The three ways in which corners of two opposite triangles, then the middles of their edges, can belong together.
TURNS = np.array([[0, 2, 1, 5, 4, 3], [2, 1, 0, 4, 3, 5], [1, 0, 2, 3, 5, 4]])


@dataclass(frozen=True)
class Body:
    """The outer faces of one volume in one subdomain.

    subdomain, volume : indices
    triangles : (k, 3 or 6) int, global nodes, outward; cells : (k,) int, the tet behind each
    corners : (k, 3, 3); normal : (k, 3) unit; size : (k,) h of each facet
    """

    subdomain: int
    volume: int
    triangles: np.ndarray
    cells: np.ndarray
    corners: np.ndarray
    normal: np.ndarray
    size: np.ndarray

    @cached_property
    def centre(self) -> np.ndarray:
        """(k, 3) of the facets."""
        return self.corners.mean(axis=1)

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates (3,) of its corners."""
        return self.corners.min(axis=(0, 1)), self.corners.max(axis=(0, 1))

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Indices of the facets with their centre in a box, widened by their own size."""
        room = (1 + REACH) * self.size[:, None]
        return np.flatnonzero(((self.centre >= low - room) & (self.centre <= high + room)).all(axis=1))


@dataclass(frozen=True)
class Patch:
    """Matching faces connected through edges.

    triangles : (k, 3 or 6) int, global nodes of the first side, outward; opposite : the same shape, their partners
    cells : (k, 2) int, the tets behind them
    """

    triangles: np.ndarray
    opposite: np.ndarray
    cells: np.ndarray


@dataclass(frozen=True)
class Mismatch:
    """Faces that lie opposite each other without matching: how many, where the first is, and how far nodes miss."""

    count: int
    point: np.ndarray
    distance: float
    tolerance: float


def outer_bodies(mesh: Mesh, faces: Faces, subdomain: np.ndarray) -> list[Body]:
    """The outer faces, by subdomain and volume."""
    outer = faces.outer
    if mesh.foreign:  # of parts whose mesh is not ours nothing but the joints is a face
        joints = np.concatenate([pack(stand.triangles, faces.nodes) for stand in mesh.foreign])
        outer = outer[~mesh.is_foreign(faces.owner[outer]) | np.isin(faces.keys[outer], joints)]
    owner = faces.owner[outer]
    order = np.lexsort((outer, mesh.volume[owner], subdomain[owner]))
    outer, owner = outer[order], owner[order]
    label = np.c_[subdomain[owner], mesh.volume[owner]]
    starts = np.flatnonzero(np.r_[True, (np.diff(label, axis=0) != 0).any(axis=1)])
    vectors = area_vectors(mesh.nodes, faces.triangles[outer])
    area = np.linalg.norm(vectors, axis=1)
    corners = mesh.nodes[faces.triangles[outer, :3]]
    return [Body(*label[a].tolist(), faces.triangles[outer[a:b]], owner[a:b], corners[a:b],
                 vectors[a:b] / area[a:b, None], np.sqrt(2 * area[a:b])) for a, b in zip(starts, [*starts[1:], len(outer)])]


def close_bodies(bodies: list[Body], within: float | None) -> Iterator[tuple[Body, Body]]:
    """Pairs of different volumes and subdomains whose boxes come within reach, the lower subdomain first.

    within : largest search distance asked for, if any
    """
    if len(bodies) < 2:
        return
    low, high = (np.array(corners) for corners in zip(*(b.box for b in bodies)))
    room = np.array([max(REACH * b.size.max(), within or 0.0) for b in bodies])
    for i, j in zip(*_boxes_within(low, high, room)):
        if bodies[j].subdomain != bodies[i].subdomain and bodies[j].volume != bodies[i].volume:
            yield bodies[i], bodies[j]


def _boxes_within(low: np.ndarray, high: np.ndarray, room: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs i < j, ascending, of boxes (n, 3) no farther apart than the larger of their rooms (n,).

    Only boxes that overlap along the axis on which they spread most are compared.
    """
    axis = int(np.ptp(low + high, axis=0).argmax())
    order = np.argsort(low[:, axis] - room)
    start, stop = (low[:, axis] - room)[order], (high[:, axis] + room)[order]
    later = np.searchsorted(start, stop, side="right") - np.arange(1, len(order) + 1)
    first = np.repeat(np.arange(len(order)), later)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(later) - later, later)
    i, j = np.sort([order[first], order[second]], axis=0)
    apart = np.maximum(low[i] - high[j], low[j] - high[i]).max(axis=1)
    near = apart <= np.maximum(room[i], room[j])
    chosen = np.lexsort((j[near], i[near]))
    return i[near][chosen], j[near][chosen]


def match(one: Body, two: Body, apart: bool, within: float | None = None, share: float = REACH) -> tuple[list[Patch], Mismatch | None]:
    """Matching faces of two bodies.

    apart : whether they may be at a distance; otherwise nodes must coincide
    within : search distance; none: ``share`` × h, of the larger facet of two
    Returns patches, and the faces opposite each other that do not match, if there are any
    """
    a = one.near(two.corners.min(axis=(0, 1)) - (within or 0), two.corners.max(axis=(0, 1)) + (within or 0))
    b = two.near(one.corners.min(axis=(0, 1)) - (within or 0), one.corners.max(axis=(0, 1)) + (within or 0))
    if len(a) == 0 or len(b) == 0:
        return [], None
    size, largest = one.size[a], np.maximum(one.size[a], two.size[b].max())
    reach = (np.full(len(a), within) if within else share * largest) if apart else COINCIDE * size
    i, j = candidates(one.corners[a].mean(axis=1), two.corners[b].mean(axis=1), (1 + ASIDE) * reach + ASIDE * size * apart)
    reach, i, j = reach[i], a[i], b[j]
    if apart and not within:
        reach = share * np.maximum(one.size[i], two.size[j])
    facing = np.einsum("ij,ij->i", one.normal[i], two.normal[j]) < OPPOSITE
    reach, i, j = reach[facing], i[facing], j[facing]
    normal = one.normal[i] - two.normal[j]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = two.corners[j][:, TURNS[:, :3]] - one.corners[i][:, None]  # (m, 3 turns, 3 corners, 3)
    along = np.einsum("mtci,mi->mtc", away, normal)
    aside = np.linalg.norm(away - along[..., None] * normal[:, None, None, :], axis=3).max(axis=2)  # (m, 3)
    turn = aside.argmin(axis=1)
    rows = np.arange(len(i))
    aside, distance = aside[rows, turn], along[rows, turn].mean(axis=1)
    limit = ASIDE * np.maximum(one.size[i], np.abs(distance)) if apart else reach
    depth = DEEP * one.size[i] if apart else reach
    level = (distance <= reach) & (distance >= -depth)
    fits = level & (aside <= limit)
    mismatch = None
    if apart:  # seen along the normal, two's triangles turn the other way
        before = in_front(one.centre[i], two.corners[j], -normal, 1e-9 * one.size[i] ** 2)
        mismatch = _mismatch(one, i, level & before & ~np.isin(i, i[fits]), aside, limit)
    i, opposite, j = i[fits], two.triangles[j[fits][:, None], TURNS[turn[fits], : two.triangles.shape[1]]], j[fits]
    # of several partners the nearest; then one node for one node
    order = np.lexsort((aside[fits], np.abs(distance[fits])))
    first = np.zeros(len(i), dtype=bool)
    first[order[np.unique(i[order], return_index=True)[1]]] = True
    keep = np.flatnonzero(first)
    i, opposite, j = i[keep], opposite[keep], j[keep]
    single = _one_to_one(one.triangles[i], opposite)
    i, opposite, j = i[single], opposite[single], j[single]
    cells = np.c_[one.cells[i], two.cells[j]]
    return [Patch(one.triangles[i[p]], opposite[p], cells[p]) for p in _connected(one.triangles[i])], mismatch


def nearest(one: Body, two: Body) -> tuple[float, np.ndarray, float]:
    """Distance of the nearest outer nodes of two bodies, where that is, and the facets' mean size there."""
    from scipy.spatial import cKDTree  # only scenes of several parts need it

    x, y = one.corners.reshape(-1, 3), two.corners.reshape(-1, 3)
    distance, _ = cKDTree(y).query(x)
    at = int(distance.argmin())
    return float(distance[at]), x[at], float(one.size[at // 3])


def candidates(x: np.ndarray, y: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices i, j of points x[i], y[j] closer than reach[i]."""
    from scipy.spatial import cKDTree  # as above

    found = cKDTree(y).query_ball_point(x, reach)
    return np.repeat(np.arange(len(x)), [len(f) for f in found]), np.array([j for f in found for j in f], dtype=int)


def in_front(points: np.ndarray, corners: np.ndarray, normal: np.ndarray, least: np.ndarray | float = 0.0) -> np.ndarray:
    """(m,) bool, whether points (m, 3) project along normals (m, 3) into triangles (m, 3, 3) that turn about them.

    least : twice the area that a point spans with each edge is more
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    inside = np.ones(len(points), dtype=bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(q - p, points - p), normal) > least
    return inside


def _mismatch(one: Body, i: np.ndarray, alone: np.ndarray, aside: np.ndarray, limit: np.ndarray) -> Mismatch | None:
    """Facets i (m,) of the first body that lie opposite one of the second and match none: those ``alone`` (m,) bool."""
    if not alone.any():
        return None
    mine = np.flatnonzero(i == i[alone][0])
    at = mine[aside[mine].argmin()]
    return Mismatch(len(np.unique(i[alone])), one.centre[i[at]], float(aside[at]), float(limit[at]))


def _one_to_one(triangles: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """(k,) bool, faces none of whose nodes has a second partner."""
    pairs = np.unique(np.c_[triangles.ravel(), opposite.ravel()], axis=0)
    single = np.ones(len(triangles), dtype=bool)
    for nodes, side in zip(pairs.T, (triangles, opposite)):
        found, count = np.unique(nodes, return_counts=True)
        single &= ~np.isin(side, found[count > 1]).any(axis=1)
    return single


def _connected(triangles: np.ndarray) -> list[np.ndarray]:
    """Indices of triangles, one array per patch connected through edges, the lowest first."""
    if len(triangles) == 0:
        return []
    label = edge_patches(triangles)[1]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
