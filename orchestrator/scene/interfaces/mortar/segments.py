"""Overlaps of two surface meshes: each pair of facets that overlap, and the polygon in which they
do.

The master's facets are projected along the normal of each slave facet near them and clipped by its
three edges (Sutherland & Hodgman, Comm. ACM 17, 1974), all pairs at once. Everything is done in
barycentric coordinates: those of the slave's facet tell on which side of an edge a corner is, those
of the master's are carried along, so that shape functions of both sides are at hand wherever one
integrates. The projection is affine: integrals are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.kept import kept
from orchestrator.linalg import SAME, WRITTEN
from orchestrator.scene.interfaces.opposite import Triangles, opposite

# Faces face each other where the cosine between their normals is below this: curved faces of coarse
# and fine facets
# still do, the two faces at an edge of 90 degrees do not.
FACING = -0.3


@dataclass(frozen=True)
class Segments:
    """Overlaps of facets, m of them.

    slave, master : (m,) int, the facets; ordered by slave, then by master
    on_slave, on_master : (m, 6, 3) barycentric coordinates of the polygon's corners in either
        facet; what a polygon lacks of six corners repeats its last
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
        """Renumber the facets, by a number for each old one."""
        return replace(self, slave=slaves[self.slave], master=masters[self.master])

    def nearest(self, area: np.ndarray) -> Segments:
        """Overlaps that a slave facet meets first, where masters lie behind each other; all where
        none is covered twice.

        area : of the slave's facets
        """
        full = np.bincount(self.slave, self.area, minlength=len(area)) > (1 + WRITTEN) * area
        if not full.any():
            return self
        order = np.lexsort((np.abs(self.distance), self.slave))
        filled = np.cumsum(self.area[order])
        start = np.flatnonzero(np.r_[True, np.diff(self.slave[order]) != 0])
        before = filled - self.area[order] - np.repeat((filled - self.area[order])[start],
                                                       np.diff(np.r_[start, len(order)]))
        own = self.slave[order]
        kept = ~full[own] | (before < (1 - WRITTEN) * area[own])
        return self.some(np.sort(order[kept]))

    @property
    def middles(self) -> tuple[np.ndarray, np.ndarray]:
        """(m, 3), (m, 3) barycentric coordinates of the mean of each polygon's corners, at which it
        is as far as ``distance``.
        """
        own = np.ones(self.on_slave.shape[:2])
        own[:, 1:] = (self.on_slave[:, 1:] != self.on_slave[:, :-1]).any(axis=2)
        own /= own.sum(axis=1, keepdims=True)
        return np.einsum("mv,mvk->mk", own,
                         self.on_slave), np.einsum("mv,mvk->mk", own, self.on_master)

    @property
    def fans(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The polygons cut in triangles: share of the slave facet's area (m, 4), and the triangles'
        corners (m, 4, 3, 3) in
        barycentric coordinates of the slave and of the master."""
        fans = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
        one, two = self.on_slave[:, fans], self.on_master[:, fans]
        a, b = one[:, :, 1, :2] - one[:, :, 0, :2], one[:, :, 2, :2] - one[:, :, 0, :2]
        return np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]), one, two


@kept
def find_segments(slave: Triangles, master: Triangles, reach: np.ndarray,
                  cosine: float = FACING) -> Segments:
    """All overlaps of facets that face each other, ordered by slave, then by master.

    reach : (a,) how far in front of each slave facet, and behind it, masters are sought
    cosine : that between normals has to be below this
    """
    found = [_clipped(slave, master, reach, i, j)
             for i, j in opposite(slave, master, reach, cosine)]
    if not found:
        return Segments(*np.zeros((2, 0), int), *np.zeros((2, 0, 6, 3)), *np.zeros((2, 0)))
    joined = Segments(*(np.concatenate([getattr(f, name) for f in found])
                        for name in Segments.__dataclass_fields__))
    return joined.some(np.lexsort((joined.master, joined.slave)))


def _clipped(slave: Triangles, master: Triangles, reach: np.ndarray, i: np.ndarray,
             j: np.ndarray) -> Segments:
    """The overlaps of facets i of the slave and j of the master.

    A point x has barycentric coordinates (1, 0, 0) + (x − first corner)·slopes.
    """
    away = master.corners[j] - slave.corners[i, :1]
    height = np.einsum("mvc,mc->mv", away, slave.normal[i])
    keep = (height.min(axis=1) <= reach[i]) & (height.max(axis=1) >= -reach[i])
    i, j, away, height = i[keep], j[keep], away[keep], height[keep]
    on_slave = np.einsum("mvc,mkc->mvk", away, slave.slopes[i])
    on_slave[:, :, 0] += 1.0
    on_slave[np.abs(on_slave) < slave.snap[i][:, None, None]] = 0.0
    keep = (on_slave.max(axis=1) > 0).all(axis=1)
    i, j, height = i[keep], j[keep], height[keep]
    corners = np.concatenate([on_slave[keep], np.broadcast_to(np.eye(3), (len(i), 3, 3))], axis=2)
    count = np.full(len(i), 3)
    for edge in range(3):
        corners, count = _cut(corners, count, edge)
        keep = count > 2
        if not keep.all():
            i, j, height, corners, count = i[keep], j[keep], height[keep], corners[keep], count[
                keep]
    corners = corners[:, :6]
    found = Segments(i, j, corners[:, :, :3], corners[:, :, 3:], np.empty(len(i)), np.empty(len(i)))
    share = found.fans[0].sum(axis=1)
    there = np.arange(6) < count[:, None]
    distance = (np.einsum("mvk,mk->mv", found.on_master, height)
                * there).sum(axis=1) / np.maximum(count, 1)
    found = replace(found, area=share * slave.area[i], distance=distance)
    return found.some((share > SAME) & (np.abs(distance) <= reach[i]))


def _cut(corners: np.ndarray, count: np.ndarray, edge: int) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons to where a coordinate of theirs is not negative.

    corners : (m, v, 6) coordinates of the corners, the last of each polygon repeated; count : (m,)
        how many it has
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
