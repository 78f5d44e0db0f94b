"""Parts inside each other: outer corners and faces' centres of one in the tets of another, and the
middles of tets behind
outer faces: all that tells of parts whose faces lie in one another's, as of a part that is there
twice.

Bodies between faces that look at each other: no pair reaches through another body.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.config.boundary import ROUND
from orchestrator.kept import kept
from orchestrator.linalg import PLACED
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.opposite import BodyFaces, COINCIDE, Triangles
from orchestrator.scene.interfaces.skins import over, Skin, smooth_faces, surface_of
from orchestrator.scene.mesh.faces import faces_of, renumbered, runs
from orchestrator.scene.mesh.geometry import barycentric, rounding
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

    def moved(self, displacement: np.ndarray) -> Solid:
        """The part displaced by (n, 3)."""
        result = Solid(self.nodes + displacement, self.cells, self.outer)
        vars(result)["under"] = self.under
        return result

    @cached_property
    def under(self) -> np.ndarray:
        """(k,) int, the tet behind each outer face."""
        faces = faces_of(self.cells[:, :4], len(self.nodes))
        return faces.owner[faces.find(self.outer[:, :3])]

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
        middle = self.nodes[self.cells[self.under, :4]].mean(axis=1)
        return middle, np.einsum("ki,ki->k", self.surface.corners[:, 0] - middle,
                                 self.surface.normal)


@dataclass(frozen=True)
class Overlap:
    """Depth of one part in the other, its place, and the local mesh size."""

    depth: float
    where: np.ndarray
    size: float


@kept
def solid_of(mesh: Mesh, volume: int) -> tuple[np.ndarray, Solid]:
    """(n,) int, a volume's nodes, and the volume on these."""
    number, cells = renumbered(mesh.cells[mesh.volume == volume])
    faces = faces_of(cells[:, :4], len(number))
    return number, Solid(mesh.nodes[number], cells, faces.triangles[faces.outer])


@kept
def sagittas(mesh: Mesh, volumes: Sequence[int]) -> dict[int, np.ndarray]:
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


# Of facets i of one body and j of another, at barycentric coordinates (m, 3) of either, and what
# is between their planes there (m,), a length: (m,) bool, whether another body is there.
Hidden = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def hidden(bodies: Sequence[BodyFaces], skins: Callable[[BodyFaces], Skin], one: BodyFaces,
           two: BodyFaces) -> Hidden:
    """Return the test whether a third of the ``bodies`` is between two: it has a face that looks
    at the first one's, on the way along the normal, and nearer than the second one's. Distances
    are those of the surfaces that facets stand for."""

    def test(i: np.ndarray, at: np.ndarray, j: np.ndarray, at_two: np.ndarray,
             distance: np.ndarray) -> np.ndarray:
        result = np.zeros(len(i), dtype=bool)
        mine, theirs = skins(one).surface, skins(two).surface
        bulge = over(mine.bulge[i], at)
        distance = distance - bulge - over(theirs.bulge[j], at_two)
        points = np.einsum("mk,mkc->mc", at, one.corners[i])
        least = rounding(points, PLACED * one.size[i]) + mine.unsure[i] + theirs.unsure[j]
        apart = np.flatnonzero(distance > least)
        if not len(apart):
            return result
        box, room = (points[apart].min(axis=0), points[apart].max(axis=0)), distance[apart].max()
        for third in bodies:
            near = third.within(box, room) if third is not one and third is not two else ()
            if len(near):
                surface = skins(third).surface.some(near)
                behind = COINCIDE * one.size[i] + mine.sagitta[i]
                result[apart] |= _met(one, i[apart], at[apart], third.some(near), surface.bulge,
                                      bulge[apart], behind[apart], (distance - least)[apart])
        return result

    return test


def _met(one: Triangles, i: np.ndarray, at: np.ndarray, third: Triangles, theirs: np.ndarray,
         bulge: np.ndarray, behind: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return (m,) bool, whether rays along normals meet a body's facets before a distance (m,).

    The rays begin on facets i (m,) at barycentric coordinates (m, 3), over which their surface
    bulges by (m,); ``behind`` (m,) it the other's surface may be. ``theirs`` : (k, 3) its bulges.
    """
    facets, place = np.unique(i, return_inverse=True)
    reach, off = np.zeros(len(facets)), np.abs(theirs).max(axis=1)
    np.maximum.at(reach, place, distance + behind + off.max())
    found = find_segments(one.some(facets), third, reach)
    count = np.bincount(found.slave, minlength=len(facets))
    many = count[place]  # each ray with all facets that overlap its own
    ray, which = np.repeat(np.arange(len(i)), many), runs((np.cumsum(count) - count)[place], many)
    facet, normal = found.master[which], one.normal[i[ray]]
    point = np.einsum("mk,mkc->mc", at[ray], one.corners[i[ray]])
    corner, across = third.corners[facet, 0], third.normal[facet]
    way = np.einsum("mc,mc->m", corner - point, across) / np.einsum("mc,mc->m", normal, across)
    met = np.einsum("mc,mkc->mk", point + way[:, None] * normal - corner, third.slopes[facet])
    met[:, 0] += 1.0
    way = way - bulge[ray] - over(theirs[facet], met)
    before = (met > -PLACED).all(axis=1) & (way >= -behind[ray] - off[facet]) & (
        way < distance[ray])
    return np.bincount(ray[before], minlength=len(i)) > 0
