"""Writes a model's mesh as medit ``.meshb`` (version 2), the way FreeFEM reads it fastest.

Tets and their regions only: clamped dofs travel by number, in the message that loads the model.
"""

from __future__ import annotations

import struct

import numpy as np

from orchestrator.blackbox.protocol import Model

# readmesh3 hashes vertices so that it slows down twentyfold when 64 divides their number, and never ends when 512 does.
BAD_DIVISOR = 64
_DIMENSION, _VERTICES, _TETRAHEDRA, _END = 3, 4, 8, 54


def padding(nodes: np.ndarray) -> np.ndarray:
    """Corners (4, 3) of a tet of its own, beside the mesh; empty (0, 3) unless the vertex count is a bad one."""
    if len(nodes) % BAD_DIVISOR:
        return np.zeros((0, 3))
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    size = 0.1 * np.linalg.norm(high - low)
    return high + size * np.array([[1.0, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]])


def encode(model: Model) -> bytes:
    """The file's bytes. Regions are written as they are, vertex and tet order is kept, padding comes last. Of ten-node tets the corners
    alone are written: FreeFEM numbers the other nodes itself. Raises ValueError when a node belongs to no tet (FreeFEM ends on such
    meshes)."""
    if not (np.bincount(model.cells.ravel(), minlength=len(model.nodes)) > 0).all():
        raise ValueError(f"{model.name}: a node belongs to no tet")
    nodes, cells = model.nodes, model.cells
    if cells.shape[1] == 10:
        used, cells = np.unique(cells[:, :4], return_inverse=True)
        nodes, cells = nodes[used], cells.reshape(-1, 4)
    n, extra = len(nodes), padding(nodes)
    padded = int(len(extra) > 0)

    vertices = np.zeros(n + len(extra), dtype=[("x", "<f8", 3), ("label", "<i4")])
    vertices["x"][:n] = nodes
    vertices["x"][n:] = extra
    tets = np.empty((len(cells) + padded, 5), "<i4")
    tets[: len(cells), :4] = cells
    tets[: len(cells), 4] = model.region
    if padded:
        tets[-1] = [n, n + 1, n + 2, n + 3, model.region[0]]
    tets[:, :4] += 1

    parts, at = [struct.pack("<5i", 1, 2, _DIMENSION, 20, 3)], 20
    for keyword, table in ((_VERTICES, vertices), (_TETRAHEDRA, tets)):
        at += 12 + table.nbytes
        parts += [struct.pack("<3i", keyword, at, len(table)), table.tobytes()]
    parts.append(struct.pack("<2i", _END, 0))
    return b"".join(parts)
