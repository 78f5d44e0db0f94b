"""Meshes for hard cases that the generators do not make, written as files, and the small scenes around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from orchestrator.scene.mesh.structured import bricks
from orchestrator.scene.mesh.mesh import Mesh

STEEL = [{"young": 200e3, "poisson": 0.3}]


def scene(mesh: Mapping[str, Any], subdomains: Any, length: float, *, force: float = 10.0,
          **more: Any) -> dict[str, Any]:
    """A body held at x = 0, pulled and sheared at x = length."""
    data = {
        "name": "hard", "mesh": dict(mesh), "subdomains": subdomains, "materials": STEEL,
        "boundary": [{"on": {"plane": "x", "at": 0.0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": length}, "traction": [force, 0.0, force]}],
    }
    return {**data, **more}


def box(size: Sequence[float], cells: Sequence[int], grid: Sequence[int], **more: Any) -> dict[str, Any]:
    """A structured box cut in a grid."""
    return scene({"box": {"size": list(map(float, size)), "cells": list(cells)}}, {"grid": list(grid)}, float(size[0]),
                 **more)


def cubes(**more: Any) -> dict[str, Any]:
    """2³ unit cubes with 4 elements a side."""
    return box([2, 2, 2], [8, 8, 8], [2, 2, 2], **more)


def slices(**more: Any) -> dict[str, Any]:
    """A bar of four unit cubes in a row, 3 elements a side."""
    mesh = {"box": {"size": [4.0, 1.0, 1.0], "cells": [12, 3, 3]}}
    return scene(mesh, {"slices": {"axis": "x", "count": 4}}, 4.0, **more)


def write(folder: Path, name: str, mesh: Mesh) -> dict[str, str]:
    """A mesh file whose volumes are volume_1, volume_2 …, and the ``mesh`` section that reads it."""
    path = folder / f"{name}.mesh"
    meshio.write(path, meshio.Mesh(mesh.nodes, [("tetra", mesh.cells)], cell_data={"medit:ref": [mesh.volume + 1]}))
    return {"file": str(path)}


def contrast(folder: Path, pattern: str, ratio: float) -> dict[str, Any]:
    """The 2³ cubes of two materials: by cubes, layers, checkerboard of bricks, random bricks or random tets."""
    mesh = bricks(np.full(3, 2.0), np.full(3, 8), "box")
    brick = np.floor(mesh.nodes[mesh.cells].mean(axis=1) * 4).astype(int)
    random = np.random.default_rng(0)
    mesh.volume = {
        "across": (brick // 4).sum(axis=1) % 2, "layers": brick[:, 2] % 2, "checkerboard": brick.sum(axis=1) % 2,
        "random bricks": random.integers(0, 2, (8, 8, 8))[tuple(brick.T)],
        "random tets": random.integers(0, 2, len(brick)),
    }[pattern]
    return scene(write(folder, f"{pattern} {ratio:g}".replace(" ", "-"), mesh), {"grid": [2, 2, 2]}, 2.0, materials=[
        {"young": 200e3 / ratio, "poisson": 0.3}, {"young": 200e3, "poisson": 0.3, "on": "volume_2"}])


def sliver(folder: Path, angle: float) -> dict[str, Any]:
    """The bar of slices with one tet at an interface flattened to a dihedral angle, in degrees."""
    mesh = bricks(np.array([4.0, 1.0, 1.0]), np.array([12, 3, 3]), "box")
    node = int(np.argmin(np.linalg.norm(mesh.nodes - [1.0, 1 / 3, 1 / 3], axis=1)))
    target = int(np.argmin(np.linalg.norm(mesh.nodes - [2 / 3, 1 / 3, 1 / 3], axis=1)))
    mesh.nodes[target, 0] = mesh.nodes[node, 0] - np.tan(np.radians(angle)) / 3
    return scene(write(folder, f"sliver-{angle:g}", mesh), {"slices": {"axis": "x", "count": 4}}, 4.0)


def joined(folder: Path, nodes: int) -> dict[str, Any]:
    """Two bars of bricks that share one triangle (3 nodes), an edge (2) or a corner (1) only."""
    one = bricks(np.ones(3), np.full(3, 3), "box")
    two = bricks(np.ones(3), np.full(3, 3), "box")
    two.nodes = two.nodes + [1.0, 2 / 3 if nodes < 3 else 0.0, 1.0 if nodes == 1 else 0.0]
    if nodes == 2:
        two.nodes = two.nodes + [0.0, 1 / 3, 2 / 3]
    if nodes == 3:  # the second bar is pushed away from the first but for one triangle
        face = [[1, 1 / 3, 1 / 3], [1, 2 / 3, 1 / 3], [1, 2 / 3, 2 / 3]]
        meets = np.any([np.linalg.norm(two.nodes - p, axis=1) < 1e-9 for p in face], axis=0)
        two.nodes[(two.nodes[:, 0] < 1 + 1e-9) & ~meets, 0] += 0.3
    both = np.vstack([one.nodes, two.nodes])
    _, first, inverse = np.unique(np.round(both, 6), axis=0, return_index=True, return_inverse=True)
    cells = np.vstack([one.cells, two.cells + len(one.nodes)])
    mesh = Mesh(both[first], inverse.ravel()[cells], np.repeat([0, 1], [len(one.cells), len(two.cells)]), ["a", "b"])
    return scene(write(folder, f"joined-{nodes}", mesh), "groups", 2.0)


def patches(folder: Path) -> dict[str, Any]:
    """Two plates joined by two legs: one interface of two patches."""
    mesh = bricks(np.array([3.0, 1.0, 1.0]), np.array([9, 3, 3]), "box")
    brick = np.floor(mesh.nodes[mesh.cells].mean(axis=1) * 3).astype(int)
    kept = ~((brick[:, 2] == 1) & (brick[:, 0] >= 3) & (brick[:, 0] < 6))
    used, cells = np.unique(mesh.cells[kept], return_inverse=True)
    volume = (brick[kept][:, 2] >= 1).astype(int)
    made = Mesh(mesh.nodes[used], cells.reshape(-1, 4), volume, ["a", "b"])
    return scene(write(folder, "patches", made), "groups", 3.0)


def apart(distance: float) -> Mesh:
    """Two unit blocks of separate nodes, one above the other."""
    one, two = (bricks(np.array([1.0, 1.0, 0.5]), np.array([4, 4, 2]), "box") for _ in range(2))
    two.nodes = two.nodes + [0, 0, 0.5 + distance]
    return Mesh(np.vstack([one.nodes, two.nodes]), np.vstack([one.cells, two.cells + len(one.nodes)]),
                np.repeat([0, 1], [len(one.cells), len(two.cells)]), ["a", "b"])


def blocks(steps: Sequence[Sequence[float]], *, friction: float = 0.3, gap: Any = None, **more: Any) -> dict[str, Any]:
    """Two unit blocks in contact; the upper one's top is moved, a vector per load step."""
    law = {"law": "contact", "friction": friction} | ({} if gap is None else {"gap": gap})
    data = {
        "name": "hard", "mesh": {"box": {"size": [1.0, 1.0, 1.0], "cells": [4, 4, 4]}},
        "subdomains": {"grid": [1, 1, 2]}, "materials": STEEL, "interfaces": [law],
        "boundary": [{"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1.0}, "displacement": [list(map(float, s)) for s in steps]}],
    }
    return {**data, **more}
