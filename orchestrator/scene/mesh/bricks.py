"""A box of bricks, each split along its diagonals in six tets."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from orchestrator.scene.mesh.mesh import Mesh


def bricks(size: Sequence[float], counts: Sequence[int], name: str) -> Mesh:
    """Return the mesh of a box with a corner at the origin.

    The split, Kuhn's, is the same in every brick, so slices of equal thickness are congruent.
    Nodes and bricks are in lexicographic order, z fastest, tets follow each other brick by brick.

    size : (3,) lengths; counts : (3,) bricks along x, y, z
    name : of the one volume; the six sides are named xmin, xmax, ymin, …
    """
    counts = np.asarray(counts)
    shape = tuple(int(c) + 1 for c in counts)
    index = np.stack(np.unravel_index(np.arange(np.prod(counts)), counts), axis=1)
    cells = (np.ravel_multi_index(index.T, shape)[:, None, None] + _tets(shape)).reshape(-1, 4)
    at = np.unravel_index(np.arange(np.prod(shape)), shape)
    nodes = np.column_stack([np.linspace(0.0, length, n)[i]
                             for length, n, i in zip(map(float, size), shape, at)])
    return Mesh(nodes, cells, np.zeros(len(cells), dtype=int), [name], _sides(index, shape), name)


def _sides(index: np.ndarray, shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Return the six sides, as outward triangles cut along the diagonals of bricks (k, 3)."""
    stride, sides = np.array([shape[1] * shape[2], shape[2], 1]), {}
    for axis, letter in enumerate("xyz"):
        one, two = np.delete(stride, axis)
        for end, label in ((0, "min"), (shape[axis] - 1, "max")):
            own = index[index[:, axis] == max(end - 1, 0)]
            a = (own @ stride) + (end - own[:, axis]) * stride[axis]
            a, b, c, d = a, a + one, a + one + two, a + two
            triangles = np.r_[np.c_[a, b, c], np.c_[a, c, d]]
            # (y,z), (x,z), (x,y): the middle pair is left-handed.
            outward = (axis != 1) == (end > 0)
            sides[letter + label] = triangles if outward else triangles[:, ::-1]
    return sides


def _tets(shape: tuple[int, ...]) -> np.ndarray:
    """Return (6, 4) nodes of a brick's tets beyond its first, in a grid of nodes: one for each order
    of the axes, from one corner to the opposite one."""
    stride, tets = np.array([shape[1] * shape[2], shape[2], 1]), []
    for order in permutations(range(3)):
        walk = np.cumsum([0, *stride[list(order)]])
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0
        tets.append(walk[[0, 2, 1, 3]] if odd else walk)
    return np.array(tets)
