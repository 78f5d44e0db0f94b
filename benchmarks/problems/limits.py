"""Scenes at their limit loads, with what theory says of them: bodies that friction, and nothing else, keeps where they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from benchmarks.kit.meshes import positive

Shape = Callable[[np.ndarray], np.ndarray]  # nodes (n, 3) → where they are


def _bricks(size: Sequence[float], counts: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and tets of a box of bricks, each cut into 24 tets about its centre and those of its faces: as symmetric as the brick, so
    that a face bent about an axis has normals through that axis."""
    shape = np.array(counts) + 1
    index = np.stack(np.meshgrid(*map(np.arange, 2 * shape - 1), indexing="ij"), -1)  # of half bricks
    nodes = (index * np.asarray(size) / (2 * np.asarray(counts))).reshape(-1, 3)
    middle = 2 * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3) + 1
    tets = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        around = np.zeros((4, 3), int)
        around[:, one], around[:, two] = (-1, 1, 1, -1), (-1, -1, 1, 1)
        for side in (-1, 1):
            face = np.eye(3, dtype=int)[axis] * side
            for a, b in zip(around, np.roll(around, -1, axis=0)):
                tets.append(np.stack([middle, middle + face, middle + face + a, middle + face + b], axis=1))
    cells = np.ravel_multi_index(tuple(np.moveaxis(np.concatenate(tets), -1, 0)), tuple(2 * shape - 1))
    used, cells = np.unique(cells, return_inverse=True)
    return nodes[used], cells.reshape(-1, 4)


def _block(size: Sequence[float], counts: Sequence[int], shape: Shape = lambda x: x,
           **surfaces: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Nodes, tets, and named triangles of a box of bricks, bent to a shape; surfaces: what says which nodes of the box lie on each."""
    nodes, cells = _bricks(size, counts)
    faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    faces, times = np.unique(faces, axis=0, return_counts=True)
    outside = faces[times == 1]
    named = {name: outside[on(nodes)[outside].all(axis=1)] for name, on in surfaces.items()}
    nodes = shape(nodes)
    return nodes, positive(nodes, cells), named


def _written(path: Path, **parts: tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]) -> dict[str, str]:
    """The ``mesh`` section of a file with parts by name, numbered separately, and their surfaces."""
    nodes, tets, triangles, names, start = [], [], [], {}, 0
    volume, surface = [], []
    for number, (name, (own, cells, surfaces)) in enumerate(parts.items(), 1):
        names[name] = np.array([number, 3])
        nodes.append(own)
        tets.append(cells + start)
        volume.append(np.full(len(cells), number))
        for called, faces in surfaces.items():
            names.setdefault(called, np.array([len(names) + 100, 2]))
            triangles.append(faces + start)
            surface.append(np.full(len(faces), names[called][0]))
        start += len(own)
    refs = [np.concatenate(volume), np.concatenate(surface)]
    meshio.write(path, meshio.Mesh(np.concatenate(nodes), [("tetra", np.concatenate(tets)), ("triangle", np.concatenate(triangles))],
                                   cell_data={"gmsh:physical": refs, "gmsh:geometrical": refs}, field_data=names),
                 file_format="gmsh22", binary=False)
    return {"file": str(path)}


def belt(folder: Path, ratio: float, friction: float = 0.2, thickness: float = 0.1, along: int = 60, off: float = 10.0,
         young: float = 2000.0) -> dict[str, Any]:
    """A belt over half a drum of radius 10, pulled at its ends by T and ``ratio`` T, ``off`` degrees away from the drum."""
    radius, width, below = 10.0, 0.5, 0.5

    def ring(inner: float) -> Shape:
        def bent(x: np.ndarray) -> np.ndarray:
            r, turn = inner + x[:, 1], pi * x[:, 0]
            return np.column_stack([r * np.cos(turn), r * np.sin(turn), x[:, 2]])
        return bent

    drum = _block([1, below, width], [along, 1, 1], ring(radius - below), inside=lambda x: x[:, 1] == 0)
    band = _block([1, thickness, width], [along, 1, 1], ring(radius), slack=lambda x: x[:, 0] == 0, tight=lambda x: x[:, 0] == 1)
    x, y = sin(radians(off)), -cos(radians(off))
    return {"name": "belt", "mesh": _written(folder / "belt.msh", drum=drum, belt=band), "subdomains": "groups",
            "materials": [{"young": young, "poisson": 0.3}],
            "interfaces": [{"between": ["drum", "belt"], "law": "contact", "friction": friction}],
            "boundary": [{"on": "inside", "displacement": [0, 0, 0]}, {"on": "slack", "traction": [x, y, 0]},
                         {"on": "tight", "traction": [-ratio * x, ratio * y, 0]}]}
