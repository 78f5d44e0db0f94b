"""The paper's beam meshed with alternating bricks, five tets each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.kit.meshes import positive, write

# corners (x, y, z) of a brick: four tets at every other corner, and the one left in the middle
_FIVE = np.array([
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    [[1, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]],
    [[1, 0, 1], [1, 0, 0], [0, 0, 1], [1, 1, 1]],
    [[0, 1, 1], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
])


def alternating_beam(folder: Path, counts: tuple[int, int, int] = (128, 8, 8), h: float = 1.25) -> Path:
    """Write the mesh and return its path.

    Neighbouring bricks are mirror images, so that the diagonals on every face form diamonds, where the
    program's own beam has them all parallel.

    Parameters
    ----------
    counts : bricks along x, y, z; h : their side
    """
    shape = np.array(counts) + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n) * h for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    bricks = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 1, 1, 3)
    mirrored = bricks.sum(axis=-1, keepdims=True) % 2 == 1
    corners = np.where(mirrored & (np.arange(3) == 0), 1 - _FIVE, _FIVE)
    cells = np.ravel_multi_index(tuple(np.moveaxis(bricks + corners, -1, 0)), tuple(shape)).reshape(-1, 4)
    path = folder / "alternating.vtk"
    write(path, nodes, positive(nodes, cells))
    return path
