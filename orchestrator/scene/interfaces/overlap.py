"""Parts inside each other: outer corners and faces' centres of one in the tets of another, and the middles of tets behind
outer faces: all that tells of parts whose faces lie in one another's, as of a part that is there twice."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import area_vectors

# Faces around a point that are asked how deep it is, and the depth, in the local mesh size, from which it counts.
AROUND, DEEP = 8, 0.1
ROUNDING = 1e-9


@dataclass(frozen=True)
class Solid:
    """One part as a set of points in space.

    name : of the part
    nodes : (n, 3); cells : (m, 4 or 10) int; outer : (k, 3 or 6) int, its outer faces
    low, high : (m, 3) boxes of the tets
    """

    name: str
    nodes: np.ndarray
    cells: np.ndarray
    outer: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, name: str, nodes: np.ndarray, cells: np.ndarray, outer: np.ndarray) -> Solid:
        """Of a mesh's tets and outer faces."""
        corners = nodes[cells[:, :4]]
        return cls(name, nodes, cells, outer, corners.min(axis=1), corners.max(axis=1))

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates."""
        return self.low.min(axis=0), self.high.max(axis=0)

    @cached_property
    def behind(self) -> tuple[np.ndarray, np.ndarray]:
        """(k, 3) middles of the tets behind the outer faces, and how far (k,) these are behind."""
        faces = faces_of(self.cells[:, :4], len(self.nodes))
        middle = self.nodes[self.cells[faces.owner[faces.find(self.outer[:, :3])], :4]].mean(axis=1)
        vectors = area_vectors(self.nodes, self.outer)
        normal = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        return middle, np.einsum("ki,ki->k", self.nodes[self.outer[:, 0]] - middle, normal)


@dataclass(frozen=True)
class Overlap:
    """How deep one part is in the other, where that is, and the local mesh size."""

    depth: float
    where: np.ndarray
    size: float


def overlap(one: Solid, two: Solid, sagitta: tuple[np.ndarray, np.ndarray] | None = None, deep: float = DEEP) -> Overlap | None:
    """The deepest that a corner, a face's centre or the middle of a tet behind it is inside the other; None: not worth mentioning.

    sagitta : (k,) how far the surfaces are off the outer faces of either part: chords of curved faces may be inside each
        other by as much; None: not at all
    deep : share of the local mesh size from which a depth counts
    """
    if (one.box[0] > two.box[1]).any() or (two.box[0] > one.box[1]).any() or not len(one.outer) or not len(two.outer):
        return None
    off = sagitta or (np.zeros(len(one.outer)), np.zeros(len(two.outer)))
    found = [o for o in (_inside(one, two, *off, deep), _inside(two, one, *off[::-1], deep)) if o is not None]
    return max(found, key=lambda o: o.depth / o.size, default=None)


def _inside(one: Solid, two: Solid, mine: np.ndarray, theirs: np.ndarray, deep: float) -> Overlap | None:
    faces = one.nodes[one.outer[:, :3]]
    corners = np.unique(one.outer[:, :3])
    middle, height = one.behind
    points = np.concatenate([one.nodes[corners], faces.mean(axis=1), middle])
    own = np.r_[np.zeros(len(corners)), mine, mine]
    least = np.r_[np.full(len(corners) + len(faces), np.inf), deep * height]  # a middle may be no deeper than a thin tet is
    boxed = ((points > two.box[0]) & (points < two.box[1])).all(axis=1)
    points, own, least = points[boxed], own[boxed], least[boxed]
    within = contained(points, two)
    points, own, least = points[within], own[within], least[within]
    if not len(points):
        return None
    from scipy.spatial import cKDTree  # only parts that are inside each other need it

    faces = two.nodes[two.outer[:, :3]]
    vectors = area_vectors(two.nodes, two.outer)
    area = np.linalg.norm(vectors, axis=1)
    normal, size = vectors / area[:, None], np.sqrt(2 * area)
    _, near = cKDTree(faces.mean(axis=1)).query(points, min(AROUND, len(faces)))
    near = near.reshape(len(points), -1)
    behind = np.einsum("pki,pki->pk", faces[near].mean(axis=2) - points[:, None], normal[near])
    depth = np.abs(behind).min(axis=1)
    allowed = np.minimum(deep * size[near[:, 0]], least) + own + theirs[near].max(axis=1)
    at = int(np.where(depth > allowed, depth, -1.0).argmax())
    return Overlap(float(depth[at]), points[at], float(size[near[at, 0]])) if depth[at] > allowed[at] else None


def contained(points: np.ndarray, solid: Solid) -> np.ndarray:
    """(p,) bool, which points (p, 3) are in one of a part's tets."""
    result = np.zeros(len(points), dtype=bool)
    if not len(points):
        return result
    from scipy.spatial import cKDTree

    chosen = np.flatnonzero(((solid.low <= points.max(axis=0)) & (solid.high >= points.min(axis=0))).all(axis=1))
    middle, radius = (solid.low[chosen] + solid.high[chosen]) / 2, (solid.high[chosen] - solid.low[chosen]) / 2
    around = cKDTree(points).query_ball_point(middle, np.linalg.norm(radius, axis=1))
    count = np.array([len(a) for a in around], dtype=int)
    if not count.sum():
        return result
    tet, point = np.repeat(chosen, count), np.concatenate([np.asarray(a, dtype=int) for a in around])
    boxed = ((points[point] >= solid.low[tet]) & (points[point] <= solid.high[tet])).all(axis=1)
    tet, point = tet[boxed], point[boxed]
    corners = solid.nodes[solid.cells[tet, :4]]
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    share = np.linalg.solve(edges, (points[point] - corners[:, 0])[:, :, None])[:, :, 0]
    result[point[(share.min(axis=1) >= -ROUNDING) & (share.sum(axis=1) <= 1 + ROUNDING)]] = True
    return result
