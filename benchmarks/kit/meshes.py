"""Meshes that studies make by themselves: bricks of six tets, and gmsh's, written as files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations, permutations
from pathlib import Path

import gmsh
import meshio
import numpy as np


def bricks(size: Sequence[float], counts: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, 3) and tets (6 m, 4) of a box of m bricks from the origin, a brick's six tets one after the other (Kuhn)."""
    shape = np.array(counts) + 1
    nodes = np.stack(np.meshgrid(*(np.linspace(0, a, n) for a, n in zip(size, shape)), indexing="ij"), -1).reshape(-1, 3)
    corner = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 1, 1, 3)
    walks = np.array([np.cumsum(np.vstack([np.zeros(3, int), np.eye(3, dtype=int)[list(order)]]), 0)
                      for order in permutations(range(3))])  # from one corner of the brick to the opposite one
    cells = np.ravel_multi_index(tuple(np.moveaxis(corner + walks, -1, 0)), tuple(shape)).reshape(-1, 4)
    return nodes, positive(nodes, cells)


def positive(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Tets with their first two nodes swapped where they are inside out."""
    inverted = np.linalg.det(nodes[cells[:, 1:]] - nodes[cells[:, :1]]) < 0
    return np.where(inverted[:, None], cells[:, [1, 0, 2, 3]], cells)


def centres(nodes: np.ndarray, cells: np.ndarray, step: float) -> np.ndarray:
    """(m, 3) int, the brick of edge ``step`` that each tet's centre lies in."""
    return np.floor(nodes[cells].mean(axis=1) / step).astype(int)


def write(path: Path, nodes: np.ndarray, cells: np.ndarray, volume: np.ndarray | int = 0) -> dict[str, str]:
    """A mesh file whose volumes are volume_1, volume_2 …, and the ``mesh`` section that reads it.

    Parameters
    ----------
    volume : (m,) number of each tet's volume, from 0; nodes without tets are left out
    """
    used, local = np.unique(cells, return_inverse=True)
    tags = np.broadcast_to(np.asarray(volume) + 1, len(cells))
    how = {"file_format": "vtk", "binary": True} if path.suffix == ".vtk" else {}
    meshio.write(path, meshio.Mesh(nodes[used], [("tetra", local.reshape(-1, 4))], cell_data={"medit:ref": [tags]}), **how)
    return {"file": str(path)}


def simplices(cells: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces of simplices (m, k): their ``width`` nodes in order, (m, f) which of them each has, and how many have each."""
    parts = np.sort(cells[:, list(combinations(range(cells.shape[1]), width))], axis=2)
    found, which, count = np.unique(parts.reshape(-1, width), axis=0, return_inverse=True, return_counts=True)
    return found, which.reshape(len(cells), -1), count


@contextmanager
def session() -> Iterator[None]:
    """gmsh switched on, quiet, with a model of its own; always switched off again."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)  # with several, it gives another mesh at every call
        yield
    finally:
        gmsh.finalize()
