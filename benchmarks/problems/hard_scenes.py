"""Meshes for hard cases that the generators do not make, written as files, and the small scenes around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.meshes import bricks, centres, write
from benchmarks.problems.cases import STEEL


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


def contrast(folder: Path, pattern: str, ratio: float) -> dict[str, Any]:
    """The 2³ cubes of two materials: by cubes, layers, checkerboard of bricks, random bricks or random tets."""
    nodes, cells = bricks((2, 2, 2), (8, 8, 8))
    brick, random = centres(nodes, cells, 0.25), np.random.default_rng(0)
    volume = {
        "across": (brick // 4).sum(axis=1) % 2, "layers": brick[:, 2] % 2, "checkerboard": brick.sum(axis=1) % 2,
        "random bricks": random.integers(0, 2, (8, 8, 8))[tuple(brick.T)],
        "random tets": random.integers(0, 2, len(brick)),
    }[pattern]
    return scene(write(_path(folder, f"{pattern} {ratio:g}"), nodes, cells, volume), {"grid": [2, 2, 2]}, 2.0, materials=[
        {"young": 200e3 / ratio, "poisson": 0.3}, {"young": 200e3, "poisson": 0.3, "on": "volume_2"}])


def halves(folder: Path, ratio: float, cuts: int) -> dict[str, Any]:
    """Two blocks of soft and stiff bricks at random, one upon the other in contact, each cut in cuts² pieces; pressed and sheared."""
    made = contrast(folder, "random bricks", ratio)
    return {**made, "subdomains": {"grid": [cuts, cuts, 2]}, "interfaces": [
        {"between": ["*-0", "*-1"], "law": "contact", "friction": 0.3}], "boundary": [
            {"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
            {"on": {"plane": "z", "at": 2.0}, "displacement": [0.001, 0, -0.002]}]}


def sliver(folder: Path, angle: float) -> dict[str, Any]:
    """The bar of slices with one tet at an interface flattened to a dihedral angle, in degrees."""
    nodes, cells = bricks((4, 1, 1), (12, 3, 3))
    node, target = (int(np.argmin(np.linalg.norm(nodes - [x, 1 / 3, 1 / 3], axis=1))) for x in (1.0, 2 / 3))
    nodes[target, 0] = nodes[node, 0] - np.tan(np.radians(angle)) / 3
    return scene(write(_path(folder, f"sliver-{angle:g}"), nodes, cells), {"slices": {"axis": "x", "count": 4}}, 4.0)


def joined(folder: Path, nodes: int) -> dict[str, Any]:
    """Two bars of bricks that share one triangle (3 nodes), an edge (2) or a corner (1) only."""
    (one, cells), (two, _) = (bricks((1, 1, 1), (3, 3, 3)) for _ in range(2))
    two += {3: [1, 0, 0], 2: [1, 1, 2 / 3], 1: [1, 2 / 3, 1]}[nodes]
    if nodes == 3:  # the second bar is pushed away from the first but for one triangle
        face = [[1, 1 / 3, 1 / 3], [1, 2 / 3, 1 / 3], [1, 2 / 3, 2 / 3]]
        meets = np.any([np.linalg.norm(two - p, axis=1) < 1e-9 for p in face], axis=0)
        two[(two[:, 0] < 1 + 1e-9) & ~meets, 0] += 0.3
    both, all_cells, volume = _both(one, two, cells)
    _, first, inverse = np.unique(np.round(both, 6), axis=0, return_index=True, return_inverse=True)
    return scene(write(_path(folder, f"joined-{nodes}"), both[first], inverse.ravel()[all_cells], volume), "groups", 2.0)


def patches(folder: Path) -> dict[str, Any]:
    """Two plates joined by two legs: one interface of two patches."""
    nodes, cells = bricks((3, 1, 1), (9, 3, 3))
    brick = centres(nodes, cells, 1 / 3)
    kept = ~((brick[:, 2] == 1) & (brick[:, 0] >= 3) & (brick[:, 0] < 6))
    return scene(write(_path(folder, "patches"), nodes, cells[kept], brick[kept][:, 2] >= 1), "groups", 3.0)


def apart(folder: Path, distance: float) -> dict[str, str]:
    """The mesh of two unit blocks of separate nodes, one above the other."""
    nodes, cells = bricks((1, 1, 0.5), (4, 4, 2))
    return write(_path(folder, f"apart-{distance:g}"), *_both(nodes, nodes + [0, 0, 0.5 + distance], cells))


def _both(one: np.ndarray, two: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.vstack([one, two]), np.vstack([cells, cells + len(one)]), np.repeat([0, 1], len(cells))


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name.replace(' ', '-')}.mesh"


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
