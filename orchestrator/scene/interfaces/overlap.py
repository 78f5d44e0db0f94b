"""Parts inside each other: outer corners and faces' centres of one in the tets of another, and the
middles of tets behind
outer faces: all that tells of parts whose faces lie in one another's, as of a part that is there
twice."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.config.boundary import ROUND
from orchestrator.rounding import PLACED
from orchestrator.scene.interfaces.opposite import Triangles
from orchestrator.scene.interfaces.skins import smooth_faces, surface_of
from orchestrator.scene.mesh.faces import faces_of, renumbered
from orchestrator.scene.mesh.geometry import barycentric
from orchestrator.scene.mesh.mesh import Mesh

# Faces around a point that are asked how deep it is, and the depth, in the local mesh size, from
# which it counts.
AROUND, DEEP = 8, 0.1 * ROUND


@dataclass(frozen=True)
class Solid:
    """One part as a set of points in space.

    nodes : (n, 3); cells : (m, 4 or 10) int; outer : (k, 3 or 6) int, its outer faces
    """

    nodes: np.ndarray
    cells: np.ndarray
    outer: np.ndarray

    @cached_property
    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """(m, 3) lowest and highest coordinates of the tets."""
        corners = self.nodes[self.cells[:, :4]]
        return corners.min(axis=1), corners.max(axis=1)

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """The box around all."""
        return self.boxes[0].min(axis=0), self.boxes[1].max(axis=0)

    @cached_property
    def surface(self) -> Triangles:
        """The outer faces as they are in space."""
        return Triangles.of(self.nodes[self.outer[:, :3]])

    @cached_property
    def behind(self) -> tuple[np.ndarray, np.ndarray]:
        """(k, 3) middles of the tets behind the outer faces, and how far (k,) these are behind."""
        faces = faces_of(self.cells[:, :4], len(self.nodes))
        middle = self.nodes[self.cells[faces.owner[faces.find(self.outer[:, :3])], :4]].mean(axis=1)
        return middle, np.einsum("ki,ki->k", self.surface.corners[:, 0] - middle,
                                 self.surface.normal)


@dataclass(frozen=True)
class Overlap:
    """Depth of one part in the other, its place, and the local mesh size."""

    depth: float
    where: np.ndarray
    size: float


def solid_of(mesh: Mesh, volume: int) -> tuple[np.ndarray, Solid]:
    """(n,) int, a volume's nodes, and the volume on these."""
    number, cells = renumbered(mesh.cells[mesh.volume == volume])
    faces = faces_of(cells[:, :4], len(number))
    return number, Solid(mesh.nodes[number], cells, faces.triangles[faces.outer])


def sagittas(mesh: Mesh, volumes: Iterable[int]) -> dict[int, np.ndarray]:
    """Volume → (k,) how far the surface that its outer faces, as of ``solid_of``, stand for is off
    these.
    """
    result = {}
    for volume in volumes:
        number, solid = solid_of(mesh, volume)
        at = number[solid.outer]
        result[volume] = surface_of(mesh.nodes, at, smooth_faces(mesh, at)).sagitta
    return result


def overlap(one: Solid, two: Solid, sagitta: tuple[np.ndarray, np.ndarray] | None = None,
            deep: float = DEEP) -> Overlap | None:
    """The deepest that a corner, a face's centre or the middle of a tet behind it is inside the
    other; None: not worth mentioning.

    sagitta : (k,) how far the surfaces are off the outer faces of either part: chords of curved
        faces may be inside each other by as much; None: not at all
    deep : share of the local mesh size from which a depth counts
    """
    if (one.box[0] > two.box[1]).any() or (two.box[0] > one.box[1]).any() or not len(
        one.outer) or not len(two.outer):
        return None
    off = sagitta or (np.zeros(len(one.outer)), np.zeros(len(two.outer)))
    found = [o for o in (_inside(one, two, *off, deep), _inside(two, one, *off[::-1], deep))
             if o is not None]
    return max(found, key=lambda o: o.depth / o.size, default=None)


def _inside(one: Solid, two: Solid, mine: np.ndarray, theirs: np.ndarray,
            deep: float) -> Overlap | None:
    corners = np.unique(one.outer[:, :3])
    middle, height = one.behind
    points = np.concatenate([one.nodes[corners], one.surface.centre, middle])
    own = np.r_[np.zeros(len(corners)), mine, mine]
    # a middle may be no deeper than a thin tet is
    least = np.r_[np.full(len(corners) + len(one.outer), np.inf), deep * height]
    within = contained(points, two)
    points, own, least = points[within], own[within], least[within]
    if not len(points):
        return None
    depth, near = _behind(points, two.surface)
    size = two.surface.size
    allowed = np.minimum(deep * size[near[:, 0]], least) + own + theirs[near].max(axis=1)
    at = int(np.where(depth > allowed, depth, -1.0).argmax())
    return Overlap(float(depth[at]), points[at],
                   float(size[near[at, 0]])) if depth[at] > allowed[at] else None


def _behind(points: np.ndarray, faces: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """(p,) how far points (p, 3) are from the planes of the faces around, and (p, k) int, these,
    the nearest first.
    """
    from scipy.spatial import cKDTree  # only parts that are inside each other need it

    near = cKDTree(faces.centre).query(points,
                                       min(AROUND, len(faces.area)))[1].reshape(len(points), -1)
    return np.abs(np.einsum("pki,pki->pk", faces.centre[near] - points[:, None],
                            faces.normal[near])).min(axis=1), near


def contained(points: np.ndarray, solid: Solid) -> np.ndarray:
    """(p,) bool, which points (p, 3) are in one of a part's tets."""
    from scipy.spatial import cKDTree

    result = np.zeros(len(points), dtype=bool)
    boxed = np.flatnonzero(((points >= solid.box[0]) & (points <= solid.box[1])).all(axis=1))
    if not len(boxed):
        return result
    (low, high), near = solid.boxes, points[boxed]
    chosen = np.flatnonzero(((low <= near.max(axis=0)) & (high >= near.min(axis=0))).all(axis=1))
    around = cKDTree(near).query_ball_point((low + high)[chosen] / 2,
                                            np.linalg.norm((high - low)[chosen] / 2, axis=1))
    tet = np.repeat(chosen, np.array([len(a) for a in around], dtype=int))
    point = boxed[np.array([p for a in around for p in a], dtype=int)]
    inside = ((points[point] >= low[tet]) & (points[point] <= high[tet])).all(axis=1)
    tet, point = tet[inside], point[inside]
    result[
        point[barycentric(solid.nodes[solid.cells[tet, :4]], points[point]).min(axis=1)
              >= -PLACED]] = True
    return result
