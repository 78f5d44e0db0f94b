"""What two surface meshes have in common: each pair of facets that overlap, and the polygon in which they do.

The master's facets are projected along the normal of each slave facet near them and clipped by its three edges
(Sutherland & Hodgman, Comm. ACM 17, 1974), all pairs at once. Everything is done in barycentric coordinates: those of
the slave's facet tell on which side of an edge a corner is, those of the master's are carried along, so that shape
functions of both sides are at hand wherever one integrates. The projection is affine: integrals are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from orchestrator.scene.mesh.geometry import cross

# Faces face each other where the cosine between their normals is below this: curved faces of coarse and fine facets
# still do, the two faces at an edge of 90 degrees do not.
FACING = -0.3
# A barycentric coordinate this small is zero: edges that lie upon each other must not cross for rounding.
SNAP = 1e-12
# Far from the origin coordinates themselves are rounded: a few units in their last place.
ROUNDING = 16 * np.finfo(float).eps
# Overlaps of less than this share of the slave's facet, squared edges that touch, are rounding.
NOTHING = 1e-12
# Facets covered by this much more than their area are covered twice.
TWICE = 1e-6
# Pairs of facets worked on at once: some 12 MB.
CHUNK = 20_000
# Masters are searched in classes of size that differ by this factor: the largest of a class sets how far one searches.
CLASS = 4.0


@dataclass(frozen=True)
class Segments:
    """Overlaps of facets, m of them.

    slave, master : (m,) int, the facets; ordered by slave, then by master
    on_slave, on_master : (m, 6, 3) barycentric coordinates of the polygon's corners in either facet; what a polygon lacks of
        six corners repeats its last
    area : (m,) of the overlap in the slave's facet
    distance : (m,) of the master along the slave's normal, averaged over the polygon's corners
    """

    slave: np.ndarray
    master: np.ndarray
    on_slave: np.ndarray
    on_master: np.ndarray
    area: np.ndarray
    distance: np.ndarray

    def __len__(self) -> int:
        return len(self.slave)

    def some(self, chosen: np.ndarray) -> Segments:
        """Some of them, by index or mask."""
        return Segments(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def numbered(self, slaves: np.ndarray, masters: np.ndarray) -> Segments:
        """The same with other numbers of facets, given for each old one."""
        return replace(self, slave=slaves[self.slave], master=masters[self.master])

    def nearest(self, area: np.ndarray) -> Segments:
        """Those that a slave facet meets first, where masters lie behind each other; all where none is covered twice.

        area : of the slave's facets
        """
        full = np.bincount(self.slave, self.area, minlength=len(area)) > (1 + TWICE) * area
        if not full.any():
            return self
        order = np.lexsort((np.abs(self.distance), self.slave))
        filled = np.cumsum(self.area[order])
        start = np.flatnonzero(np.r_[True, np.diff(self.slave[order]) != 0])
        before = filled - self.area[order] - np.repeat((filled - self.area[order])[start], np.diff(np.r_[start, len(order)]))
        own = self.slave[order]
        kept = ~full[own] | (before < (1 - TWICE) * area[own])
        return self.some(np.sort(order[kept]))

    @property
    def fans(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The polygons cut in triangles: share of the slave facet's area (m, 4), and the triangles' corners (m, 4, 3, 3) in
        barycentric coordinates of the slave and of the master."""
        fans = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
        one, two = self.on_slave[:, fans], self.on_master[:, fans]
        a, b = one[:, :, 1, :2] - one[:, :, 0, :2], one[:, :, 2, :2] - one[:, :, 0, :2]
        return np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]), one, two


def find_segments(slave: np.ndarray, master: np.ndarray, reach: np.ndarray, depth: np.ndarray, facing: float = FACING) -> Segments:
    """All overlaps of facets that face each other.

    slave, master : (a, 3, 3), (b, 3, 3) corners of the facets, outward of their own body
    reach, depth : (a,) how far in front of each slave facet, and how far behind it, masters are sought
    facing : the cosine between normals has to be below this
    """
    frame = _Frame.of(slave, reach, depth)
    normal = _unit(cross(master[:, 1] - master[:, 0], master[:, 2] - master[:, 0]))
    found = [_clipped(frame, master, normal, i, j, facing)
             for i, j in _candidates(slave, master, np.maximum(reach, depth))] if len(slave) and len(master) else []
    if not found:
        return Segments(*np.zeros((2, 0), int), *np.zeros((2, 0, 6, 3)), *np.zeros((2, 0)))
    joined = Segments(*(np.concatenate([getattr(f, name) for f in found]) for name in Segments.__dataclass_fields__))
    return joined.some(np.lexsort((joined.master, joined.slave)))


@dataclass(frozen=True)
class _Frame:
    """The slave's facets as affine maps: a point x has barycentric coordinates at + (x − first)·slopes.

    first : (a, 3) a corner; slopes : (a, 3, 3) gradient of each coordinate; normal : (a, 3) unit; area : (a,)
    snap : (a,) below this a coordinate is rounding
    reach, depth : (a,) how far in front of each and behind it masters are sought
    """

    first: np.ndarray
    slopes: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    snap: np.ndarray
    reach: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray, reach: np.ndarray, depth: np.ndarray) -> _Frame:
        one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        vector = cross(one, two)
        double = np.linalg.norm(vector, axis=1)
        normal = vector / double[:, None]
        slopes = np.stack([cross(two, normal), cross(normal, one)], axis=1) / double[:, None, None]
        slopes = np.concatenate([-slopes.sum(axis=1, keepdims=True), slopes], axis=1)
        rounding = ROUNDING * np.abs(corners).max(axis=(1, 2)) * np.linalg.norm(slopes, axis=2).max(axis=1)
        return cls(corners[:, 0], slopes, normal, double / 2, np.maximum(SNAP, rounding), reach, depth)


def _candidates(slave: np.ndarray, master: np.ndarray, reach: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Facets i, j whose surrounding spheres come within reach, in pieces of about ``CHUNK`` pairs."""
    from scipy.spatial import cKDTree  # only scenes of several parts need it

    x, y = slave.mean(axis=1), master.mean(axis=1)
    one, two = (np.linalg.norm(c - m[:, None], axis=2).max(axis=1) for c, m in ((slave, x), (master, y)))
    number = np.floor(np.log(two / two.min()) / np.log(CLASS) + SNAP).astype(int)
    for each in np.unique(number):
        chosen = np.flatnonzero(number == each)
        far = two[chosen].max()
        within = cKDTree(y[chosen])
        counts = within.query_ball_point(x, one + far + reach, return_length=True)
        piece = (np.cumsum(counts) - 1) // CHUNK
        for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(piece)) + 1):
            if not counts[part].any():
                continue
            lists = within.query_ball_point(x[part], (one + far + reach)[part])
            i = np.repeat(part, counts[part])
            j = chosen[np.fromiter(chain.from_iterable(lists), int, counts[part].sum())]
            close = ((x[i] - y[j]) ** 2).sum(axis=1) <= (one[i] + two[j] + reach[i]) ** 2
            yield i[close], j[close]


def _clipped(frame: _Frame, master: np.ndarray, normal: np.ndarray, i: np.ndarray, j: np.ndarray, facing: float) -> Segments:
    """The overlaps of facets i of the slave and j of the master."""
    keep = np.einsum("ij,ij->i", frame.normal[i], normal[j]) < facing
    i, j = i[keep], j[keep]
    away = master[j] - frame.first[i][:, None]
    height = np.einsum("mvc,mc->mv", away, frame.normal[i])
    keep = (height.min(axis=1) <= frame.reach[i]) & (height.max(axis=1) >= -frame.depth[i])
    i, j, away, height = i[keep], j[keep], away[keep], height[keep]
    on_slave = np.einsum("mvc,mkc->mvk", away, frame.slopes[i])
    on_slave[:, :, 0] += 1.0
    on_slave[np.abs(on_slave) < frame.snap[i][:, None, None]] = 0.0
    keep = (on_slave.max(axis=1) > 0).all(axis=1)
    i, j, height = i[keep], j[keep], height[keep]
    corners = np.concatenate([on_slave[keep], np.broadcast_to(np.eye(3), (len(i), 3, 3))], axis=2)
    count = np.full(len(i), 3)
    for edge in range(3):
        corners, count = _cut(corners, count, edge)
        keep = count > 2
        if not keep.all():
            i, j, height, corners, count = i[keep], j[keep], height[keep], corners[keep], count[keep]
    corners = corners[:, :6]
    found = Segments(i, j, corners[:, :, :3], corners[:, :, 3:], np.empty(len(i)), np.empty(len(i)))
    share = found.fans[0].sum(axis=1)
    there = np.arange(6) < count[:, None]
    distance = (np.einsum("mvk,mk->mv", found.on_master, height) * there).sum(axis=1) / np.maximum(count, 1)
    found = replace(found, area=share * frame.area[i], distance=distance)
    return found.some((share > NOTHING) & (distance <= frame.reach[i]) & (distance >= -frame.depth[i]))


def _cut(corners: np.ndarray, count: np.ndarray, edge: int) -> tuple[np.ndarray, np.ndarray]:
    """What is left of polygons where a coordinate of theirs is not negative.

    corners : (m, v, 6) coordinates of the corners, the last of each polygon repeated; count : (m,) how many it has
    edge : which of the coordinates
    Returns the same for what is left, (m, v + 1, 6)
    """
    m, most, _ = corners.shape
    if m == 0:
        return np.empty((0, most + 1, 6)), count
    rows, number = np.arange(m)[:, None], np.arange(most)
    following = np.where(number + 1 < count[:, None], number + 1, 0)
    here = corners[:, :, edge]
    there = here[rows, following]
    exists = number < count[:, None]
    inside, crosses = exists & (here >= 0), exists & (here * there < 0)
    # a corner, then what crosses the line between it and the next
    emitted = np.stack([inside, crosses], axis=2).reshape(m, -1)
    at = np.cumsum(emitted, axis=1) - 1
    left = np.minimum(at[:, -1] + 1, most + 1)
    result = np.empty((m, most + 1, 6))
    row, slot = np.nonzero(inside)
    result[row, at[row, 2 * slot]] = corners[row, slot]
    row, slot = np.nonzero(crosses)
    share = (here[row, slot] / (here[row, slot] - there[row, slot]))[:, None]
    point = (1 - share) * corners[row, slot] + share * corners[row, following[row, slot]]
    point[:, edge] = 0.0
    result[row, at[row, 2 * slot + 1]] = point
    spare = np.arange(most + 1) >= left[:, None]
    row, slot = np.nonzero(spare)
    result[row, slot] = result[row, np.maximum(left[row] - 1, 0)]
    return result, left


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
