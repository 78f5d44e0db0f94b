"""Writes a model's mesh as medit ``.meshb`` (version 2), the way FreeFEM reads it fastest.

Clamped dofs travel as labelled triangles: FreeFEM eliminates them while it assembles. What no
triangle can say (a component held at a lone node or along an edge) is returned as loose dofs.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.protocol import Model

# readmesh3 hashes vertices so that it slows down twentyfold when 64 divides their number, and
# never ends when 512 does.
BAD_DIVISOR = 64
_FACES = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
_DIMENSION, _VERTICES, _TRIANGLES, _TETRAHEDRA, _END = 3, 4, 6, 8, 54


@dataclass
class Clamping:
    """Clamped dofs as the mesh file can say them.

    Parameters
    ----------
    triangles : (k, 3) int, faces of tets with a component clamped on all three nodes
    labels : (k,) int, which components: 1 x + 2 y + 4 z
    loose : (l,) int, clamped dofs on none of these triangles, sorted
    """

    triangles: np.ndarray
    labels: np.ndarray
    loose: np.ndarray


def clamping(cells: np.ndarray, fixed: np.ndarray) -> Clamping:
    """Triangles that clamp as many of the ``fixed`` (n, 3) bool dofs as triangles can, few of them."""
    mask = fixed.astype(np.int64) @ np.array([1, 2, 4])
    held = mask[cells] > 0
    faces = cells[held.sum(axis=1) >= 3][:, _FACES].reshape(-1, 3)
    common = np.bitwise_and.reduce(mask[faces], axis=1) if len(faces) else np.zeros(0, np.int64)
    chosen: list[np.ndarray] = []
    covered = np.zeros_like(fixed)
    for component in range(3):
        candidates = np.flatnonzero(common & (1 << component))
        # one face per node is enough
        nodes, first = np.unique(faces[candidates].ravel(), return_index=True)
        covered[nodes, component] = True
        chosen.append(candidates[first // 3])
    picked = np.unique(np.concatenate(chosen))
    # the same face seen from its two tets must not be written twice
    _, once = np.unique(np.sort(faces[picked], axis=1), axis=0, return_index=True)
    picked = picked[once]
    return Clamping(faces[picked], common[picked], np.flatnonzero((fixed & ~covered).ravel()))


def padding(nodes: np.ndarray) -> np.ndarray:
    """Corners (4, 3) of a tet of its own, beside the mesh; empty (0, 3) unless the vertex count is a bad one."""
    if len(nodes) % BAD_DIVISOR:
        return np.zeros((0, 3))
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    size = 0.1 * np.linalg.norm(high - low)
    return high + size * np.array([[1.0, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]])


def encode(model: Model, clamped: Clamping) -> bytes:
    """The file's bytes. Regions are written as they are, vertex and tet order is kept.

    Raises ValueError when a node belongs to no tet (FreeFEM ends on such meshes).
    """
    n = len(model.nodes)
    if not (np.bincount(model.cells.ravel(), minlength=n) > 0).all():
        raise ValueError(f"{model.name}: a node belongs to no tet")
    nodes, cells, region = model.nodes, model.cells, model.region
    triangles, labels = clamped.triangles, clamped.labels
    extra = padding(nodes)
    if len(extra):
        nodes = np.concatenate([nodes, extra])
        cells = np.concatenate([cells, n + np.arange(4)[None]])
        region = np.concatenate([region, region[:1]])
        triangles = np.concatenate([triangles.reshape(-1, 3), n + _FACES])
        labels = np.concatenate([labels, np.full(4, 7)])

    vertices = np.zeros(len(nodes), dtype=[("x", "<f8", 3), ("label", "<i4")])
    vertices["x"] = nodes
    parts, at = [struct.pack("<5i", 1, 2, _DIMENSION, 20, 3)], 20
    tables = [(_VERTICES, vertices), (_TETRAHEDRA, _table(cells, region)), (_TRIANGLES, _table(triangles, labels))]
    for keyword, table in tables:
        if len(table):
            at += 12 + table.nbytes
            parts += [struct.pack("<3i", keyword, at, len(table)), table.tobytes()]
    parts.append(struct.pack("<2i", _END, 0))
    return b"".join(parts)


def _table(corners: np.ndarray, label: np.ndarray) -> np.ndarray:
    table = np.empty((len(corners), corners.shape[1] + 1), "<i4")
    table[:, :-1] = corners
    table[:, :-1] += 1
    table[:, -1] = label
    return table
