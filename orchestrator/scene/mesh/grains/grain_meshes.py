"""Meshes of grains: every face of a tessellation is meshed alone, every grain from its faces alone.

So what two grains share comes out the same to the bit. How an edge is divided depends on that edge
alone. Nodes are numbered by vertices, edges, faces, grains.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from orchestrator.processes import libc
from orchestrator.linalg import PLACED
from orchestrator.scene.mesh.faces import LOCAL_FACES, renumbered, runs
from orchestrator.scene.mesh.gmsh_session import gmsh, HXT, last_complaint, session, TET, TRIANGLE
from orchestrator.scene.mesh.grains.polyhedra import SIDES, Tessellation

# Edges have pieces of h at most, but for this share of it.
OVER = 0.01
PERTURB = -6  # glibc's M_PERTURB


@dataclass(frozen=True)
class GrainMesh:
    """Tets of all grains: points (n, 3), cells (m, 4) int, and the grain (m,) of each."""

    points: np.ndarray
    cells: np.ndarray
    grain: np.ndarray

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


def grain_mesh(cells: Tessellation, h: float) -> GrainMesh:
    """Mesh grains, whose faces must be plane, with elements of size h.

    Raises Failed: gmsh makes nothing of one of them
    """
    with session(), _blank_memory():
        gmsh.option.setNumber("Mesh.MeshSizeMax", h)
        # Inside, h counts alone: following the sizes on the faces, which short edges refine,
        # makes 12 % more nodes.
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.Algorithm3D", HXT)
        try:
            points, faces = _faces(cells, h)
            parts, tets, count = [points], [], len(points)
            for grain in range(int(cells.cells.max()) + 1):
                own = np.flatnonzero((cells.cells == grain).any(axis=1))
                inner, found = _grain(points, np.concatenate([faces[face] for face in own]), count)
                parts.append(inner)
                tets.append(found)
                count += len(inner)
        except Exception as error:  # gmsh raises no other
            raise Failed(f"gmsh: {last_complaint(error)}") from None
    return GrainMesh(np.concatenate(parts), np.concatenate(tets),
                     np.repeat(np.arange(len(tets)), [*map(len, tets)]))


def _faces(cells: Tessellation, h: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """Points (n, 3) of vertices, on edges and within faces, and the triangles (k, 3) of each
    face."""
    ends = [sorted(end) for loop in cells.loops for end in zip(loop, [*loop[1:], loop[0]])]
    ends, edge = np.unique(np.array(ends), axis=0, return_inverse=True)
    edges = np.split(edge.ravel(), np.cumsum([len(loop) for loop in cells.loops])[:-1])
    low, high = cells.vertices[ends].transpose(1, 0, 2)
    pieces = np.maximum(np.ceil(np.linalg.norm(high - low, axis=1) / h - OVER), 1).astype(int)
    first = len(cells.vertices) + np.cumsum([0, *(pieces - 1)])
    on, place = np.repeat(np.arange(len(ends)), pieces - 1), runs(0 * pieces + 1, pieces - 1)
    points = np.concatenate([cells.vertices,
                             low[on] + (place / pieces[on])[:, None] * (high - low)[on]])
    parts, triangles, total = [points], [], len(points)
    for loop, own, other in zip(cells.loops, edges, cells.cells[:, 1]):
        outline = np.concatenate([loop, runs(first[own], pieces[own] - 1)]).astype(int)
        lines = [(loop.index(a), loop.index(b), count)
                 for (a, b), count in zip(ends[own].tolist(), pieces[own].tolist())]
        inner, found = _face(points[outline], lines, h)
        if other < 0:  # a side of the box
            inner[:, (-1 - other) // 2] = points[loop[0], (-1 - other) // 2]
        triangles.append(np.concatenate([outline, total + np.arange(len(inner))])[found])
        parts.append(inner)
        total += len(inner)
    return np.concatenate(parts), triangles


def _face(outline: np.ndarray, lines: list[tuple[int, int, int]],
          h: float) -> tuple[np.ndarray, np.ndarray]:
    """Points within a face and its triangles, of those of the outline and these.

    outline : (n, 3) the corners in order, then what is on each edge
    lines : of each edge the places of its lower and higher vertex among the corners, and its
        number of pieces
    """
    gmsh.model.add("face")
    geo = gmsh.model.geo
    corners = [geo.addPoint(*point, h) for point in outline[: len(lines)]]
    wire = []
    for k, (low, high, pieces) in enumerate(lines):
        line = geo.addLine(corners[low], corners[high])
        geo.mesh.setTransfiniteCurve(line, pieces + 1)
        wire.append(line if low == k else -line)
    geo.addPlaneSurface([geo.addCurveLoop(wire)])
    found, triangles = _meshed(2, TRIANGLE)
    count = len(outline)
    if len(found) < count or np.abs(found[:count] - outline).max() > PLACED:
        raise RuntimeError("nodes of a face's edges are not where they were asked for")
    return found[count:], triangles


def _grain(points: np.ndarray, triangles: np.ndarray,
           first: int) -> tuple[np.ndarray, np.ndarray]:
    """Points within a grain of triangles (k, 3), and its tets, of the points and these, which are
    numbered from ``first`` on."""
    used, local = renumbered(triangles)
    gmsh.model.add("grain")
    surface = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, surface, np.arange(len(used)) + 1, points[used].ravel())
    gmsh.model.mesh.addElementsByType(surface, TRIANGLE, [], local.ravel() + 1)
    gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
    found, cells = _meshed(3, TET)
    if not len(cells):
        raise RuntimeError("a grain without tetrahedra")
    if not np.array_equal(found[: len(used)], points[used]):
        raise RuntimeError("nodes of a grain's faces have moved")
    inner = found[len(used):]
    return inner, np.concatenate([used, first + np.arange(len(inner))])[cells]


@contextmanager
def _blank_memory() -> Iterator[None]:
    """New memory holds zeros, where the C library can see to it: HXT reads some that it has not
    written, and what happened to be there
    decides on a few tets of one grain in a thousand."""
    libc("mallopt", PERTURB, 0xFF)  # its complement is what new memory gets
    try:
        yield
    finally:
        libc("mallopt", PERTURB, 0)


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
