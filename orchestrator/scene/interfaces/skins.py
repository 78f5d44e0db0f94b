"""Outer faces of bodies with the surfaces they stand for: how far these are off facets, whose
chords cut inside the body, or
bulge out of it.

The surface over each edge is taken for the curve that has the surface's normals at its ends (as
Nagata does, Computer Aided Geometric Design 22, 2005): over the middle of an edge e from a to b it
stands off by (n_b − n_a)·e / (4 + 2 |n_a + n_b|), outward positive, as a circle does. Normals are
those of the CAD model, or of the cylinder, cone, sphere or torus that all nodes of a smooth face
lie on; elsewhere means over the facets around a corner that are part of the same smooth face. Where
a component of a node is prescribed, as on planes of symmetry, with the facets' mirror images, if
these are part of it: where facets nearby turn as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.kept import kept
from orchestrator.linalg import PLACED
from orchestrator.scene.interfaces.opposite import BodyFaces
from orchestrator.scene.mesh.faces import Faces, alike, components
from orchestrator.scene.mesh.geometry import facet_normals, spread, unit
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.shapes import recognised

# Facets beside each other that turn by less than this are one smooth face: a circle of seven chords
# is a circle, the side
# of a hexagonal nut is plane.
SMOOTH = np.cos(np.deg2rad(55.0))
# The same where they are known to be of one face without a crease: a circle may be as coarse as a
# square's corners turn.
SAME_FACE = np.cos(np.deg2rad(95.0))
# Where normals are means surfaces are known from their facets within this share of what they are
# off them: facets' triangles lie as
# they happen to. What is beside such a place and within the whole of it belongs to the same pair.
UNSURE = 0.25
# Where they are known distances lack 1 − cos(θ/2) between the normals of a facet and of the
# surface, a quarter of 1 − cos θ;
# measured on coarse cylinders and spheres an eighth.
TURNED = 0.25


@dataclass(frozen=True)
class Surface:
    """The smooth surface that facets (k,) stand for.

    normals : (k, 3 or 6, 3) unit normals of the surface at their nodes, outward; nan where it is
        not known. In the middle of an edge it is the one nearest to there, not the mean of its
        ends: sides that slide would climb the difference
    means : (k, 3, 3) at their corners, where it is not known those of the facets around that are
        part of the same smooth face
    bulge : (k, 3) how far the surface stands off the middles of their edges, outward positive;
        edges as in ``TRIANGLE_EDGES``. Over the point of barycentric coordinates λ it is 4 (λ₀λ₁ s₀
        + λ₁λ₂ s₁ + λ₂λ₀ s₂)
    """

    normals: np.ndarray
    means: np.ndarray
    bulge: np.ndarray

    @cached_property
    def sagitta(self) -> np.ndarray:
        """(k,) the farthest that the surface is off each facet."""
        return np.abs(self.bulge).max(axis=1)

    @cached_property
    def unsure(self) -> np.ndarray:
        """(k,) within which that is right: a share of it, where normals are known that of 1 − cos
        of the angle by which they turn.
        """
        one, two = self.normals[:, :3], np.roll(self.normals[:, :3], 1, axis=1)
        turn = 1 - np.einsum("kvi,kvi->kv", one, two).min(axis=1)
        return self.sagitta * np.fmin(UNSURE, TURNED * turn)

    def some(self, chosen: np.ndarray) -> Surface:
        """Surfaces of some of the facets, by index or mask."""
        return Surface(self.normals[chosen], self.means[chosen], self.bulge[chosen])


@dataclass(frozen=True)
class Skin:
    """A body's outer faces, the CAD face (k,) that each is on, and what they stand for."""

    body: BodyFaces
    face: np.ndarray
    surface: Surface

    def under(self, triangles: np.ndarray) -> Surface:
        """Surfaces that some of its facets (m, 3 or 6), given by their nodes, stand for."""
        size = int(self.body.triangles[:, :3].max()) + 1
        return self.surface.some(alike(self.body.triangles, triangles, size))


class Skins:
    """The skins of bodies of a mesh, each made once."""

    def __init__(self, mesh: Mesh, faces: Faces, held: np.ndarray | None = None):
        """held : (n, 3) bool, components of nodes that are prescribed; default: none."""
        self.mesh, self.faces, self.held = mesh, faces, held
        self._made: dict[int, Skin] = {}

    def __call__(self, body: BodyFaces) -> Skin:
        if id(body) not in self._made:
            face = self.smooth[self.faces.find(body.triangles[:, :3])]
            self._made[id(body)] = Skin(body, face, surface_of(
                self.mesh.nodes, body.triangles, face, self.given(body), self.held))
        return self._made[id(body)]

    @cached_property
    def smooth(self) -> np.ndarray:
        """See ``smooth_faces``."""
        return smooth_faces(self.mesh, self.faces.triangles)

    def given(self, body: BodyFaces) -> np.ndarray | None:
        """(k, 3, 3) normals that the CAD model has at the corners of a body's faces, outward, nan
        where it has none.
        """
        told = {name: shape.normals for name, shape in self.mesh.smooth.items()
                if shape.normals is not None}
        if not told:
            return None
        triangles = np.concatenate([self.mesh.surfaces[name] for name in told])
        at = alike(triangles, body.triangles, len(self.mesh.nodes))
        corner = (triangles[at][:, None] == body.triangles[:, :3, None]).argmax(axis=2)
        normals = np.take_along_axis(np.concatenate([*told.values()])[at], corner[:, :, None],
                                     axis=1)
        normals = normals * np.sign(np.einsum("kvi,ki->kv", normals, body.normal))[:, :, None]
        return np.where((at >= 0)[:, None, None], normals, np.nan)


def smooth_faces(mesh: Mesh, triangles: np.ndarray) -> np.ndarray:
    """(k,) int, number of the CAD face that triangles (k, 3 or 6) of the mesh's nodes are on, −1
    where that is not known."""
    told = [mesh.surfaces[name] for name in mesh.smooth]
    if not told:
        return np.full(len(triangles), -1)
    number = np.repeat(np.arange(len(told)), [*map(len, told)])
    return np.append(number, -1)[alike(np.concatenate(told), triangles, len(mesh.nodes))]


def smooth_patches(triangles: np.ndarray, normal: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(k,) int, number of the patch of each facet; patches hang together through edges that are no
    creases.

    triangles : (k, 3) int; normal : (k, 3) unit; face : (k,) as in ``surface_of``
    """
    edge = edges_of(triangles, TRIANGLE_EDGES)[1].ravel()
    order = np.argsort(edge, kind="stable")
    same = np.flatnonzero(np.diff(edge[order]) == 0)
    a, b = order[same] // 3, order[same + 1] // 3
    joined = np.einsum("mi,mi->m", normal[a], normal[b]) > _least(face[a], face[b])
    return components(a[joined], b[joined], len(triangles))[1]


def _least(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(m,) cosine between normals from which facets on CAD faces (m,) and (m,) are one smooth
    face.
    """
    return np.where((one >= 0) & (one == two), SAME_FACE, SMOOTH)


@kept
def surface_of(nodes: np.ndarray, triangles: np.ndarray, face: np.ndarray | int,
               given: np.ndarray | None = None, held: np.ndarray | None = None) -> Surface:
    """The smooth surface that facets stand for.

    nodes : (n, 3); triangles : (k, 3 or 6) int, the whole surface around what is wanted, outward
    face : (k,) int, the CAD face that each is on, −1 where that is not known, or one of all
    given : (k, 3 or 6, 3) normals that are known, nan where they are not
    held : (n, 3) bool, components of nodes that are prescribed; default: none
    """
    corners, face = triangles[:, :3], np.broadcast_to(face, len(triangles))
    normal, points = facet_normals(nodes, corners)[0], nodes[corners]
    ahead, behind = np.roll(points, -1, axis=1) - points, np.roll(points, 1, axis=1) - points
    cosine = np.einsum("kvi,kvi->kv", ahead,
                       behind) / np.linalg.norm(ahead, axis=2) / np.linalg.norm(behind, axis=2)
    means = _corner_normals(corners, normal, np.arccos(np.clip(cosine, -1.0, 1.0)), face,
                             None if held is None else held[corners])
    known = np.full((len(triangles), triangles.shape[1], 3), np.nan)
    if given is not None:
        told = given[:, :3]
        both = told + np.roll(told, -1, axis=1)
        both /= np.linalg.norm(both, axis=2, keepdims=True)
        known = np.concatenate([told, both], axis=1)[:, : triangles.shape[1]]
        known[:, 3 : given.shape[1]] = given[:, 3:]
        means = np.where(np.isnan(told), means, told)
    left = np.flatnonzero(np.isnan(known).any(axis=(1, 2)) | (known.shape[1] == 6))
    off = np.abs(_over_edges(points, means)).max(axis=1)
    patch = smooth_patches(corners[left], normal[left], face[left])
    waiting = [left[patch == label] for label in np.unique(patch[off[left] > 0])]
    while waiting:
        own = waiting.pop()
        at, first = np.unique(corners[own], return_index=True)
        # no curved surface has planes, as there are where a facet and all around it look one way
        found = off[own].all() and recognised(nodes[at], means[own].reshape(-1, 3)[first],
                                              off[own].mean())
        if found:
            there = found(nodes[triangles[own]].reshape(-1, 3)).reshape(known[own].shape)
            there = there * np.sign(np.einsum("kvi,ki->kv", there, normal[own]))[:, :, None]
            told = ~np.isnan(known[own])
            told[:, 3:] = False
            known[own] = np.where(told, known[own], there)
        elif len(faces := np.unique(face[own])) > 1:  # coarse facets hide edges between faces
            waiting += [own[face[own] == number] for number in faces]
    means = np.where(np.isnan(known[:, :3]), means, known[:, :3])
    return Surface(known, means, _over_edges(points, means))


def _over_edges(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(k, 3) how far surfaces with normals (k, 3, 3) at the corners (k, 3, 3) of facets stand off
    the middles of edges.
    """
    edge, after = np.roll(points, -1, axis=1) - points, np.roll(at, -1, axis=1)
    off = np.einsum("kvi,kvi->kv", after - at, edge) / (4 + 2 * np.linalg.norm(after + at, axis=2))
    return np.where(np.abs(off) > PLACED * np.linalg.norm(edge, axis=2), off, 0.0)


def _corner_normals(corners: np.ndarray, normal: np.ndarray, angle: np.ndarray, face: np.ndarray,
                    held: np.ndarray | None = None) -> np.ndarray:
    """(k, 3, 3) unit normals at the corners of each facet, as its own smooth face has them.

    corners : (k, 3) int; normal : (k, 3) unit; angle : (k, 3) of the facets at their corners;
    face : (k,) as in ``surface_of``
    held : (k, 3, 3) bool, components of the corners that are prescribed
    """
    facet = np.repeat(np.arange(len(corners)), 3)
    order = np.argsort(corners.ravel(), kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(corners.ravel()[order]) != 0])
    count = np.diff(np.r_[start, len(order)])
    total = np.zeros((len(order), 3))
    # each corner with each facet around its node, k-th neighbours at once
    first = np.repeat(start, count)
    for k in range(int(count.max(initial=0))):
        there = np.repeat(count, count) > k
        mine, theirs = order[there], order[first[there] + k]
        i, j = facet[mine], facet[theirs]
        same = np.einsum("mi,mi->m", normal[i], normal[j]) > _least(face[i], face[j])
        mine, theirs = mine[same], theirs[same]
        total[mine] += angle.ravel()[theirs, None] * normal[facet[theirs]]
    # a facet and its mirror image in one face have nothing across together
    if held is not None and held.any():
        smooth = 1 - 2 * normal**2 > _least(face, face)[:, None]
        # a plane that meets its mirror image at an angle makes an edge, not a round face
        patch = smooth_patches(corners, normal, face)
        own = np.unique(patch[:, None] * (corners.max() + 1) + corners, return_inverse=True)[1]
        turns = spread(normal, own.reshape(corners.shape), own.max() + 1)[own.ravel()]
        turned = np.abs(unit(total)) <= turns
        inside = np.where(held.reshape(-1, 3) & np.repeat(smooth, 3, axis=0) & turned, 0.0, total)
        planes = ~held.all(axis=2).reshape(-1, 1) & inside.any(axis=1, keepdims=True)
        total = np.where(planes, inside, total)
    return unit(total).reshape(*corners.shape, 3)


def over(bulge: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m,) how far the surface is off facets at barycentric coordinates (m, 3), from the bulges (m,
    3) over their edges.
    """
    a, b, c = np.moveaxis(at, -1, 0)
    return 4 * (a * b * bulge[..., 0] + b * c * bulge[..., 1] + c * a * bulge[..., 2])
