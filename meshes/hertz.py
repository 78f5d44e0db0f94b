"""Mesh of a cylinder on a block: a thin slice, nodes of both bodies opposite each other, refined at the contact.

    python meshes/hertz.py meshes/hertz.msh --h 0.01

The cylinder is another block whose lower side is bent to z = x²/(2R): near the contact the two are the same.
Both are 2 L wide (L with --half, the plane x = 0 being one of symmetry) and L high; the bodies share no nodes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import meshio
import numpy as np

from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.sources import bricks

LENGTH, RADIUS = 1.0, 2.0
GROWTH = 1.2  # of element sizes away from the contact


def graded(h: float, fine: float, length: float) -> np.ndarray:
    """(n,) coordinates from 0 to a length: spacing h up to ``fine``, then growing."""
    steps = [h] * round(fine / h)
    while sum(steps) < length:
        steps.append(steps[-1] * GROWTH)
    x = np.r_[0.0, np.cumsum(steps)]
    inner = x <= fine * (1 + 1e-9)
    last = x[inner][-1]
    x[~inner] = last + (x[~inner] - last) * (length - last) / (x[-1] - last)
    return x


def cylinder_on_block(h: float, fine: float = 0.1, *, half: bool = False, radius: float = RADIUS,
                      length: float = LENGTH) -> Mesh:
    """Volumes ``block`` (z < 0) and ``cylinder`` (z > 0), without named surfaces.

    Parameters
    ----------
    h : element size at the contact, up to ``fine`` from its centre
    half : x ≥ 0 only
    """
    x, z = graded(h, fine, length), graded(h, fine / 2, length)
    x = x if half else np.r_[-x[:0:-1], x]
    grid = bricks(np.ones(3), np.array([len(x) - 1, 1, len(z) - 1]), "block")
    index = np.rint(grid.nodes * [len(x) - 1, 1, len(z) - 1]).astype(int)
    nodes = np.c_[x[index[:, 0]], 2 * h * index[:, 1], z[index[:, 2]]]
    block = nodes * [1, 1, -1]  # the cylinder's mirror image, tets and all: pressing alone shears nothing
    bent = nodes + np.c_[0 * nodes[:, :2], nodes[:, 0] ** 2 / (2 * radius) * (1 - nodes[:, 2] / length)]
    count = len(block)
    return Mesh(np.r_[block, bent], np.r_[grid.cells[:, [1, 0, 2, 3]], grid.cells + count], np.repeat([0, 1], len(grid.cells)),
                ["block", "cylinder"], {}, "cylinder on block")


def write(path: Path, mesh: Mesh) -> None:
    """As a gmsh file with named volumes."""
    meshio.write(path, meshio.Mesh(
        mesh.nodes, [("tetra", mesh.cells)], field_data={n: np.array([k, 3]) for k, n in enumerate(mesh.volumes, 1)},
        cell_data={"gmsh:physical": [mesh.volume + 1], "gmsh:geometrical": [mesh.volume + 1]}), file_format="gmsh22")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path)
    parser.add_argument("--h", type=float, default=0.01)
    parser.add_argument("--fine", type=float, default=0.1)
    parser.add_argument("--half", action="store_true")
    given = parser.parse_args()
    write(given.path, cylinder_on_block(given.h, given.fine, half=given.half))
