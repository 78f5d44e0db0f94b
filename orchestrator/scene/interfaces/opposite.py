"""The outer faces of bodies, and the one search for facets that lie opposite each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from orchestrator.config.boundary import ROUND
from orchestrator.kept import Unchanging
from orchestrator.linalg import SAME
from orchestrator.scene.mesh.faces import Faces, pack
from orchestrator.scene.mesh.geometry import cross, facet_normals
from orchestrator.scene.mesh.mesh import Mesh

# Of the local mesh size h = √(2 × facet area): nodes closer than this coincide, surfaces closer
# touch, and gaps are sought so far.
COINCIDE, TOUCHING, REACH = (ROUND * share for share in (1e-3, 0.1, 2.0))
# Two faces are opposite when the cosine between their normals is below this.
OPPOSITE = -0.7
# Far from the origin coordinates themselves are rounded: a few units in their last place.
ROUNDING = 16 * np.finfo(float).eps
# Pairs of facets worked on at once: some 12 MB.
CHUNK = 20_000
# Facets are searched in classes of size that differ by this factor: the largest of a class sets how
# far one searches.
CLASS = 4.0


def cosine_of(angle: float | None) -> float:
    """Bound on the cosine between normals of faces that an entry with this ``angle`` in degrees
    pairs; None: ``OPPOSITE``.
    """
    return OPPOSITE if angle is None else -float(np.cos(np.deg2rad(ROUND * angle)))


@dataclass(frozen=True)
class Triangles:
    """Triangles: corners (k, 3, 3), unit normals (k, 3) to which they turn, areas (k,)."""

    corners: np.ndarray
    normal: np.ndarray
    area: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray) -> Triangles:
        vectors = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        area = np.linalg.norm(vectors, axis=1)
        return cls(corners, vectors / area[:, None], area)

    def some(self, chosen: np.ndarray) -> Triangles:
        """Some of them, by index or mask."""
        return Triangles(self.corners[chosen], self.normal[chosen], self.area[chosen])

    @cached_property
    def size(self) -> np.ndarray:
        """(k,) h of each."""
        return np.sqrt(2 * self.area)

    @cached_property
    def centre(self) -> np.ndarray:
        """(k, 3) centroids."""
        return self.corners.mean(axis=1)

    @cached_property
    def radius(self) -> np.ndarray:
        """(k,) of the spheres about the centres that hold the facets."""
        return np.linalg.norm(self.corners - self.centre[:, None], axis=2).max(axis=1)

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates (3,)."""
        return self.corners.min(axis=(0, 1)), self.corners.max(axis=(0, 1))

    @cached_property
    def slopes(self) -> np.ndarray:
        """(k, 3, 3) gradients of the barycentric coordinates."""
        one, two = (self.corners[:, k] - self.corners[:, 0] for k in (1, 2))
        slopes = np.stack([cross(two, self.normal), cross(self.normal, one)],
                          axis=1) / (2 * self.area)[:, None, None]
        return np.concatenate([-slopes.sum(axis=1, keepdims=True), slopes], axis=1)

    @cached_property
    def snap(self) -> np.ndarray:
        """(k,) below this a barycentric coordinate is rounding."""
        return np.maximum(SAME, ROUNDING * np.abs(self.corners).max(axis=(1, 2))
                          * np.linalg.norm(self.slopes, axis=2).max(axis=1))

    def within(self, box: tuple[np.ndarray, np.ndarray], room: float) -> np.ndarray:
        """(c,) int, the facets that come within reach of a box."""
        low, high = self._boxes
        return np.flatnonzero(((high >= box[0] - room) & (low <= box[1] + room)).all(axis=1))

    @cached_property
    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        return self.corners.min(axis=1), self.corners.max(axis=1)


@dataclass(frozen=True)
class BodyFaces(Triangles, Unchanging):
    """The outer faces of one volume in one subdomain.

    subdomain, volume : indices
    triangles : (k, 3 or 6) int, global nodes, outward; cells : (k,) int, the tet behind each
    """

    subdomain: int
    volume: int
    triangles: np.ndarray
    cells: np.ndarray


def outer_bodies(mesh: Mesh, faces: Faces, subdomain: np.ndarray) -> list[BodyFaces]:
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
    normal, area = facet_normals(mesh.nodes, faces.triangles[outer])
    corners = mesh.nodes[faces.triangles[outer, :3]]
    return [BodyFaces(corners[a:b], normal[a:b], area[a:b], *label[a].tolist(),
                 faces.triangles[outer[a:b]], owner[a:b])
            for a, b in zip(starts, [*starts[1:], len(outer)])]


def close_bodies(bodies: list[BodyFaces], within: float
                 | None) -> Iterator[tuple[BodyFaces, BodyFaces]]:
    """Pairs of different volumes and subdomains whose boxes come within reach, the lower subdomain
    first.

    within : largest search distance asked for, if any
    """
    if len(bodies) < 2:
        return
    low, high = (np.array(corners) for corners in zip(*(b.box for b in bodies)))
    room = np.array([max(REACH * b.size.max(), within or 0.0) for b in bodies])
    for i, one in enumerate(bodies):
        apart = np.maximum(low[i] - high[i + 1:], low[i + 1:] - high[i]).max(axis=1)
        for j in i + 1 + np.flatnonzero(apart <= np.maximum(room[i], room[i + 1:])):
            if bodies[j].subdomain != one.subdomain and bodies[j].volume != one.volume:
                yield one, bodies[j]


def opposite(one: Triangles, two: Triangles, reach: np.ndarray, cosine: float = OPPOSITE,
             spheres: bool = True) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Facets i, j that look at each other within reach, in pieces of about ``CHUNK`` pairs.

    reach : (k₁,) how far apart the spheres around them may be, or their centres where they are not
        ``spheres``
    cosine : between their normals it is below this
    """
    if not len(one.area) or not len(two.area):
        return
    a, b = one.within(two.box, reach.max()), two.within(one.box, reach.max())
    if not len(a) or not len(b):
        return
    ends = [np.stack([n.min(axis=0), n.max(axis=0)]) for n in (one.normal[a], two.normal[b])]
    if (ends[0][:, None] * ends[1]).min(axis=(0, 1)).sum() >= cosine:
        return  # none look at each other
    from scipy.spatial import cKDTree  # only scenes of parts that do need it

    x, y, near, room = one.centre[a], two.centre[b], reach[a], np.zeros(len(b))
    number = np.zeros(len(b), dtype=int)
    if spheres:
        near, room = near + one.radius[a], two.radius[b]
        number = np.floor(np.log(room / room.min()) / np.log(CLASS) + SAME).astype(int)
    for each in np.unique(number):
        chosen = np.flatnonzero(number == each)
        far, tree = near + room[chosen].max(), cKDTree(y[chosen])
        counts = tree.query_ball_point(x, far, return_length=True)
        piece = (np.cumsum(counts) - 1) // CHUNK
        for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(piece)) + 1):
            lists = tree.query_ball_point(x[part], far[part]) if counts[part].any() else ()
            i = np.repeat(part, counts[part])
            j = chosen[np.fromiter(chain.from_iterable(lists), int, counts[part].sum())]
            keep = np.einsum("ij,ij->i", one.normal[a[i]], two.normal[b[j]]) < cosine
            keep &= ((x[i] - y[j]) ** 2).sum(axis=1) <= (near[i] + room[j]) ** 2
            yield a[i[keep]], b[j[keep]]


def nearest(one: BodyFaces, two: BodyFaces) -> tuple[float, np.ndarray, float]:
    """Distance of the nearest outer nodes of two bodies, where that is, and the facets' mean size
    there.
    """
    from scipy.spatial import cKDTree  # as above

    x, y = one.corners.reshape(-1, 3), two.corners.reshape(-1, 3)
    distance, _ = cKDTree(y).query(x)
    at = int(distance.argmin())
    return float(distance[at]), x[at], float(one.size[at // 3])
