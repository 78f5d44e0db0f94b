"""Whether a mesh of bodies is what it should be: they fill the box and are balls that touch face to face."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.faces import Faces, edge_patches, faces_of, pieces
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.quadratic import TET_EDGES, TRIANGLE_EDGES, edges_of
from orchestrator.scene.mesh.mesh import Mesh

ROUNDING = 1e-12  # of the volume, of a side's area


def is_ball(cells: np.ndarray) -> bool:
    """Whether tets (m, 4) are a ball: they hold together, with one closed surface of Euler's number 2, a body of 1."""
    faces = faces_of(cells, int(cells.max()) + 1)
    ends, _ = edges_of(cells, TET_EDGES)
    surface = faces.triangles[faces.outer]
    sides, side = edges_of(surface, TRIANGLE_EDGES)
    return bool(pieces(faces, np.zeros(len(cells), dtype=int))[0] == 1 and np.all(np.bincount(side.reshape(-1)) == 2)
                and edge_patches(surface)[0] == 1 and len(np.unique(surface)) - len(sides) + len(surface) == 2
                and len(np.unique(cells)) - len(ends) + len(faces.triangles) - len(cells) == 1)


def unsound(mesh: Mesh, faces: Faces, size: np.ndarray) -> list[str]:
    """What is wrong with the bodies of a mesh that fill a box from the origin; nothing if all is well.

    Parameters
    ----------
    size : (3,) lengths of the box; the surfaces are its sides xmin, xmax, ymin, …
    """
    volumes, found = tet_volumes(mesh.nodes, mesh.cells), []
    if volumes.min() <= 0 or len(faces.folded) or len(faces.crowded):
        found.append("overlaps")
    if not abs(volumes.sum() / np.prod(size) - 1) < ROUNDING:
        found.append("gaps")
    outer, claimed = np.sort(faces.outer), [faces.find(triangles) for triangles in mesh.surfaces.values()]
    if not np.array_equal(outer, np.sort(np.concatenate(claimed))):
        found.append("an outer face on no side of the box, or on two")
    for side, triangles in enumerate(mesh.surfaces.values()):
        axis, end = side // 2, size[side // 2] * (side % 2)
        area = area_vectors(mesh.nodes, triangles).sum(axis=0)
        if (np.abs(mesh.nodes[triangles, axis] - end).max() > ROUNDING * size[axis]
                or not abs(abs(area[axis]) / (np.prod(size) / size[axis]) - 1) < ROUNDING):
            found.append(f"the box's side {side} is not plane or not full")
    order = np.argsort(mesh.volume, kind="stable")
    bounds = np.searchsorted(mesh.volume[order], np.arange(len(mesh.volumes) + 1))
    no_ball = [name for name, a, b in zip(mesh.volumes, bounds, bounds[1:]) if a == b or not is_ball(mesh.cells[order[a:b]])]
    if no_ball:
        found.append("no balls: " + ", ".join(no_ball))
    split = split_interfaces(mesh, faces)
    if split:
        found.append(f"{split} interfaces in several pieces")
    return found


def split_interfaces(mesh: Mesh, faces: Faces) -> int:
    """Pairs of bodies whose common faces do not hold together by edges."""
    inner = faces.inner
    a, b = mesh.volume[faces.owner[inner]], mesh.volume[faces.neighbour[inner]]
    apart = a != b
    pair = np.minimum(a, b)[apart] * len(mesh.volumes) + np.maximum(a, b)[apart]
    order = np.argsort(pair, kind="stable")
    triangles = faces.triangles[inner[apart]][order]
    start = np.flatnonzero(np.diff(pair[order], prepend=-1))
    return sum(edge_patches(part)[0] > 1 for part in np.split(triangles, start[1:]))
