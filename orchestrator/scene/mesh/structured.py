"""Structured meshes of boxes: every brick split into the same six tets."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np

from orchestrator.scene.mesh.size import check_size, coarser
from orchestrator.scene.mesh.mesh import Mesh


def beam(mesh: Any) -> Mesh:
    """A box of bricks about h wide, from ``mesh.beam`` with ``size`` (3 lengths) and ``h`` (a length)."""
    size, h = np.asarray(mesh.beam.size, dtype=float), float(mesh.beam.h)
    # Python's rounding would send 2.5 cells to 2.
    counts = np.maximum(np.floor(size / h + 0.5), 1)
    check_size(np.prod(counts + 1), ("mesh", "beam", "h"), f"h = {h:g}", coarser(h))
    counts = counts.astype(int)
    return bricks(size, counts, "beam")


def box(mesh: Any) -> Mesh:
    """A box of given bricks, from ``mesh.box`` with ``size`` (3 lengths) and ``cells`` (3 counts)."""
    size, counts = np.asarray(mesh.box.size, dtype=float), np.asarray(mesh.box.cells)
    check_size(np.prod(counts + 1.0), ("mesh", "box", "cells"), f"cells: {list(map(int, mesh.box.cells))}",
               lambda factor: f"take fewer cells, each {factor:.2g} times as large")
    return bricks(size, counts, "box")


def bricks(size: np.ndarray, counts: np.ndarray, name: str) -> Mesh:
    """A box with a corner at the origin, split along the diagonals of its bricks (Kuhn).

    The split is the same in every brick, so slices of equal thickness are congruent.

    size : (3,) lengths; counts : (3,) int, bricks along x, y, z
    name : of the one volume; the six sides are named xmin, xmax, ymin, …; nodes are in lexicographic order, z fastest
    """
    shape = tuple(int(c) + 1 for c in counts)
    axes = [np.linspace(0.0, length, points) for length, points in zip(size, shape)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    ids = np.arange(len(nodes)).reshape(shape)
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    corner = ids[:-1, :-1, :-1].reshape(-1)
    # A tet for each order of the axes: it walks from one corner of the brick to the opposite one.
    tets = []
    for order in permutations(range(3)):
        walk = np.cumsum([0, *stride[list(order)]])
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0
        tets.append(walk[[0, 2, 1, 3]] if odd else walk)
    cells = (corner[:, None, None] + np.array(tets)).reshape(-1, 4)
    return Mesh(nodes, cells, np.zeros(len(cells), dtype=int), [name], _sides(ids), name)


def _sides(ids: np.ndarray) -> dict[str, np.ndarray]:
    """The six sides of a grid of node ids, as outward triangles cut along the bricks' diagonals."""
    sides = {}
    for axis, letter in enumerate("xyz"):
        for end, label in ((0, "min"), (-1, "max")):
            layer = np.take(ids, end, axis=axis)
            a, b, c, d = (part.reshape(-1) for part in (layer[:-1, :-1], layer[1:, :-1], layer[1:, 1:], layer[:-1, 1:]))
            triangles = np.r_[np.c_[a, b, c], np.c_[a, c, d]]
            # (y,z), (x,z), (x,y): the middle pair is left-handed.
            outward = (axis != 1) == (end == -1)
            sides[letter + label] = triangles if outward else triangles[:, ::-1]
    return sides
