"""Whether a mesh of bodies is what it should be: they fill the box and are balls that touch face to face."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from benchmarks.kit.meshes import simplices

ROUNDING = 1e-12  # of the volume, of a side's area


def pieces(which: np.ndarray) -> int:
    """In how many pieces simplices fall that hold together by faces (m, f)."""
    rows = np.repeat(np.arange(len(which)), which.shape[1])
    touches = sp.csr_array((np.ones(which.size), (rows, which.ravel())))
    return connected_components(touches @ touches.T)[0]


def is_ball(cells: np.ndarray) -> bool:
    """Whether tets (m, 4) are a ball: they hold together, with one closed surface of Euler's number 2, a body of 1."""
    if not len(cells):
        return False
    triangles, which, count = simplices(cells, 3)
    surface = triangles[count == 1]
    sides, side, meet = simplices(surface, 2)
    return bool(pieces(which) == 1 and (meet == 2).all() and pieces(side) == 1
                and len(np.unique(surface)) - len(sides) + len(surface) == 2
                and len(np.unique(cells)) - len(simplices(cells, 2)[0]) + len(triangles) - len(cells) == 1)


def unsound(mesh: Any, size: np.ndarray) -> list[str]:
    """What is wrong with the bodies of a scene's ``mesh`` that fill a box from the origin; nothing if all is well.

    Parameters
    ----------
    size : (3,) lengths of the box; the surfaces are its sides xmin, xmax, ymin, …
    """
    nodes, cells, found = mesh.nodes, mesh.cells, []
    volumes = np.linalg.det(nodes[cells[:, 1:]] - nodes[cells[:, :1]]) / 6
    triangles, _, count = simplices(cells, 3)
    if volumes.min() <= 0 or count.max() > 2:
        found.append("overlaps")
    if not abs(volumes.sum() / np.prod(size) - 1) < ROUNDING:
        found.append("gaps")
    claimed = np.sort(np.concatenate(list(mesh.surfaces.values())), axis=1)
    if not np.array_equal(np.unique(claimed, axis=0), triangles[count == 1]) or len(claimed) != (count == 1).sum():
        found.append("an outer face on no side of the box, or on two")
    for side, faces in enumerate(mesh.surfaces.values()):
        axis, end = side // 2, size[side // 2] * (side % 2)
        a, b, c = nodes[faces].swapaxes(0, 1)
        area = abs(np.cross(b - a, c - a)[:, axis].sum()) / 2
        if (np.abs(nodes[faces, axis] - end).max() > ROUNDING * size[axis]
                or not abs(area / (np.prod(size) / size[axis]) - 1) < ROUNDING):
            found.append(f"the box's side {side} is not plane or not full")
    no_ball = [name for k, name in enumerate(mesh.volumes) if not is_ball(cells[mesh.volume == k])]
    if no_ball:
        found.append("no balls: " + ", ".join(no_ball))
    if split := split_interfaces(cells, mesh.volume):
        found.append(f"{split} interfaces in several pieces")
    return found


def interfaces(cells: np.ndarray, volume: np.ndarray) -> list[np.ndarray]:
    """Triangles (k, 3) that each pair of bodies shares."""
    triangles, which, count = simplices(cells, 3)
    order = np.argsort(which.ravel(), kind="stable")
    owner = np.repeat(volume, 4)[order]
    start = np.searchsorted(which.ravel()[order], np.flatnonzero(count == 2))
    pairs = np.sort(np.stack([owner[start], owner[start + 1]], 1), axis=1)
    apart = pairs[:, 0] != pairs[:, 1]
    key = np.unique(pairs[apart], axis=0, return_inverse=True)[1].ravel()
    inner = triangles[count == 2][apart]
    return [inner[key == k] for k in range(key.max(initial=-1) + 1)]


def split_interfaces(cells: np.ndarray, volume: np.ndarray) -> int:
    """Pairs of bodies whose common faces do not hold together by edges."""
    return sum(pieces(simplices(patch, 2)[1]) > 1 for patch in interfaces(cells, volume))
