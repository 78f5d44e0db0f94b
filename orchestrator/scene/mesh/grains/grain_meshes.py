"""Meshes of single grains: every face of a tessellation is meshed alone, every grain from its faces
alone.

So what two grains share comes out the same to the bit. Bad tets are mended together with the
grains around them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from orchestrator.processes import mallopt
from orchestrator.scene.mesh.faces import components, LOCAL_FACES
from orchestrator.scene.mesh.gmsh_session import gmsh, HXT, last_complaint, session, TET, TRIANGLE
from orchestrator.scene.mesh.grains.polyhedra import SIDES
from orchestrator.scene.mesh.grains.skeleton import Skeleton
from orchestrator.scene.mesh.grains.mending import Fitness, mend, Mended
from orchestrator.scene.mesh.mesh import Mesh

# how far off gmsh may place the nodes of an edge, which are then where the skeleton has them; the
# box is 1 long at most
ROUNDING = 1e-9
PERTURB = -6  # glibc's M_PERTURB


@dataclass(frozen=True)
class GrainMesh:
    """Tets of one or several grains: tags (n,) of the nodes, ascending, points (n, 3), cells (m, 4)
    int, and the grain (m,) of each.
    """

    tags: np.ndarray
    points: np.ndarray
    cells: np.ndarray
    grain: np.ndarray

    @classmethod
    def joined(cls, meshes: Sequence[GrainMesh]) -> GrainMesh:
        """Of all their tets, by grains; what has one tag is one node."""
        tags, first, place = np.unique(np.concatenate([m.tags for m in meshes]), return_index=True,
                                       return_inverse=True)
        starts = np.cumsum([0, *(len(m.tags) for m in meshes)])
        cells = np.concatenate([m.cells + start for m, start in zip(meshes, starts)])
        grain = np.concatenate([m.grain for m in meshes])
        order = np.argsort(grain, kind="stable")
        return cls(tags, np.concatenate([m.points for m in meshes])[first],
                   place.ravel()[cells[order]], grain[order])

    def some(self, cells: np.ndarray) -> GrainMesh:
        """Of some of its tets, (m,) bool."""
        used, corners = np.unique(self.cells[cells], return_inverse=True)
        return GrainMesh(self.tags[used], self.points[used], corners.reshape(-1, 4),
                         self.grain[cells])

    def sides(self, size: np.ndarray) -> dict[str, np.ndarray]:
        """Triangles (k, 3) on each side of the box from the origin, of lengths ``size`` (3,),
        outward.
        """
        triangles, found = self.cells[:, LOCAL_FACES].reshape(-1, 3), {}
        for index, name in enumerate(SIDES):
            on = self.points[:, index // 2] == (size[index // 2] if index % 2 else 0.0)
            found[name] = triangles[on[triangles].all(axis=1)]
        return found


class Failed(Exception):
    """gmsh has made nothing of a grain."""


class GrainMesher:
    """Meshes faces and grains of a skeleton, each once."""

    def __init__(self, skeleton: Skeleton):
        self.skeleton = skeleton
        self._faces: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._grains: dict[int, GrainMesh] = {}

    def of(self, grains: Sequence[int]) -> list[GrainMesh]:
        """Meshes of some grains, ascending. Raises Failed: for the first of which there is none"""
        with session(), _blank_memory():
            gmsh.option.setNumber("Mesh.MeshSizeMax", self.skeleton.h)
            # Inside, h counts alone: following the sizes on the faces, which short edges refine,
            # makes 12 % more nodes.
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
            gmsh.option.setNumber("Mesh.Algorithm3D", HXT)
            for grain in grains:
                if grain not in self._grains:
                    try:
                        self._grains[grain] = self._grain(grain)
                    except Exception as error:  # gmsh raises no other
                        raise Failed(f"gmsh: {last_complaint(error)}") from None
        return [self._grains[grain] for grain in grains]

    def _face(self, face: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tags (n,) and points (n, 3) of a face's nodes, and its triangles (k, 3)."""
        if face in self._faces:
            return self._faces[face]
        h, (tags, points, lines) = self.skeleton.h, self.skeleton.outline(face)
        gmsh.model.add("face")
        geo = gmsh.model.geo
        corners = [geo.addPoint(*point, h) for point in points[: len(lines)]]
        wire = []
        for k, (low, high, pieces) in enumerate(lines):
            line = geo.addLine(corners[low], corners[high])
            geo.mesh.setTransfiniteCurve(line, pieces + 1)
            wire.append(line if low == k else -line)
        geo.addPlaneSurface([geo.addCurveLoop(wire)])
        found, triangles = _meshed(2, TRIANGLE)
        if len(found) < len(points) or np.abs(found[: len(points)] - points).max() > ROUNDING:
            raise RuntimeError("nodes of a face's edges are not where they were asked for")
        found[: len(points)] = points
        other = self.skeleton.cells.cells[face, 1]
        if other < 0:  # a side of the box
            found[:, (-1 - other) // 2] = points[0, (-1 - other) // 2]
        self._faces[face] = np.concatenate(
            [tags, self.skeleton.in_face(face, len(found) - len(tags))]), found, triangles
        return self._faces[face]

    def _grain(self, grain: int) -> GrainMesh:
        tags, points, triangles = zip(*(self._face(face) for face in self.skeleton.faces_of[grain]))
        starts = np.cumsum([0, *map(len, tags)])
        tags, first, place = np.unique(np.concatenate(tags), return_index=True, return_inverse=True)
        points = np.concatenate(points)[first]
        triangles = place.ravel()[
            np.concatenate([own + start for own, start in zip(triangles, starts)])]
        gmsh.model.add("grain")
        surface = gmsh.model.addDiscreteEntity(2)
        gmsh.model.mesh.addNodes(2, surface, np.arange(len(points)) + 1, points.ravel())
        gmsh.model.mesh.addElementsByType(surface, TRIANGLE, [], triangles.ravel() + 1)
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
        found, cells = _meshed(3, TET)
        if not len(cells):
            raise RuntimeError("a grain without tetrahedra")
        if not np.array_equal(found[: len(points)], points):
            raise RuntimeError("nodes of a grain's faces have moved")
        return GrainMesh(
            np.concatenate([tags, self.skeleton.in_grain(grain, len(found) - len(tags))]), found,
            cells,
                         np.full(len(cells), grain))


@contextmanager
def _blank_memory() -> Iterator[None]:
    """New memory holds zeros, where the C library can see to it: HXT reads some that it has not
    written, and what happened to be there
    decides on a few tets of one grain in a thousand."""
    mallopt(PERTURB, 0xFF)  # its complement is what new memory gets
    try:
        yield
    finally:
        mallopt(PERTURB, 0)


def _meshed(dimension: int, kind: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and elements (k, 3 or 4) of gmsh's model, which then goes; nodes of vertices
    come first, then of edges, faces.
    """
    try:
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.generate(dimension)
        tags, points, _ = gmsh.model.mesh.getNodes(returnParametricCoord=False)
        elements = gmsh.model.mesh.getElementsByType(kind)[1].reshape(-1, dimension + 1)
        order = np.argsort(tags)
        if not np.array_equal(tags[order], np.arange(1, len(tags) + 1)):
            raise RuntimeError("nodes that are not numbered one after another")
        return points.reshape(-1, 3)[order], elements.astype(int) - 1
    finally:
        gmsh.model.remove()


def mended(mesher: GrainMesher, whole: GrainMesh, bad: np.ndarray,
           fitness: Fitness) -> tuple[GrainMesh, Mended]:
    """Return all grains with bad tets mended, and what was done.

    A bad tet may change with what is around its own nodes and those next to them: the grains there
    make a cluster, which is mended by itself. What they have in common with others stays.

    whole : all grains; bad : (m,) bool, of its tets
    """
    patches = [_patch(mesher, whole, bad, grain) for grain in np.unique(whole.grain[bad])]
    clusters = _clusters(patches, mesher.skeleton.grains)
    parts, done = zip(*(_mended(mesher, cluster, fitness) for cluster in clusters))
    rest = whole.some(~np.isin(whole.grain, np.concatenate(clusters)))
    return GrainMesh.joined([rest, *parts]), sum(done, Mended())


def _patch(mesher: GrainMesher, whole: GrainMesh, bad: np.ndarray, grain: int) -> list[int]:
    """Grains at the nodes of a grain's bad tets and at those next to them."""
    near, own = np.zeros(len(whole.tags), dtype=bool), whole.cells[whole.grain == grain]
    near[whole.cells[bad & (whole.grain == grain)]] = True
    near[own[near[own].any(axis=1)]] = True
    return sorted(mesher.skeleton.grains_at(whole.tags[near]))


def _clusters(patches: list[list[int]], grains: int) -> list[list[int]]:
    """Of patches that have grains in common, all their grains; ascending, and so are they."""
    pairs = np.array([(patch[0], grain) for patch in patches for grain in patch])
    _, label = components(*pairs.T, grains)
    return sorted(np.flatnonzero(label == k).tolist() for k in np.unique(label[pairs[:, 0]]))


def _mended(mesher: GrainMesher, cluster: list[int], fitness: Fitness) -> tuple[GrainMesh, Mended]:
    """The grains of a cluster, and what was done."""
    whole, skeleton = GrainMesh.joined(mesher.of(cluster)), mesher.skeleton
    mesh = Mesh(whole.points, whole.cells, np.searchsorted(cluster, whole.grain),
                [str(grain) for grain in cluster],
                whole.sides(skeleton.cells.size))
    mesh, kept, done = mend(mesh, fitness, ~skeleton.all_at(whole.tags, cluster))
    return GrainMesh(whole.tags[kept], mesh.nodes, mesh.cells, np.array(cluster)[mesh.volume]), done
