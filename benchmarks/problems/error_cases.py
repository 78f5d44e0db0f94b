"""The problems of the study of time against error: bricks of equal size, each in six tets, so that refinements nest.

Lengths in mm, forces in N. k counts the bricks along a length that the docstrings name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.meshes import bricks, write
from benchmarks.problems.cases import STEEL

HELD = [0, 0, 0]


@dataclass(frozen=True)
class Model:
    """A problem at any fineness.

    Parameters
    ----------
    problem : (folder for meshes, k) → configuration without method
    sizes : element → k of the meshes
    exact : k of the meshes that stand for the exact solution: three of ten-node tets, each twice as fine as the one
        before; with contact one of four-node tets
    watched : (n, 3) points → whether their stress counts: away from edges where the exact one is unbounded
    brick : edge of a brick at k = 1; length : of the whole, for the paper's soles
    """

    problem: Callable[[Path, int], dict[str, Any]]
    sizes: dict[str, tuple[int, ...]]
    exact: tuple[int, ...]
    watched: Callable[[np.ndarray], np.ndarray]
    brick: float
    length: float


def beam(folder: Path, k: int) -> dict[str, Any]:
    """A slender cantilever in bending, 100 × 5 × 10, k bricks through its height."""
    return {
        "name": "beam", "mesh": {"beam": {"size": [100, 5, 10], "h": 10 / k}}, "materials": STEEL,
        "subdomains": {"slices": {"axis": "x", "count": min(20, 10 * k)}},
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": HELD},
                     {"on": {"plane": "x", "at": 100}, "traction": [0, 0, -1]}],
    }


def bracket(folder: Path, k: int) -> dict[str, Any]:
    """An L of two arms, 20 × 5 × 20 less a quarter, k bricks to the inner corner, clamped at its foot."""
    def inside(x: np.ndarray) -> np.ndarray:
        return (x[:, 0] < 10) | (x[:, 2] > 10)

    return {
        "name": "bracket",
        "mesh": _write(folder / f"bracket-{k}.vtk", (20, 5, 20), (2 * k, k // 2, 2 * k), inside),
        "subdomains": {"metis": 8 if k < 9 else 16}, "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": HELD},
                     {"on": {"plane": "x", "at": 20}, "traction": [0, 0, 1]}],
    }


def inclusions(folder: Path, k: int) -> dict[str, Any]:
    """A block 20 × 10 × 10 with two cubes in it, 1000 times as stiff, k bricks through its height; k in threes."""
    def hard(x: np.ndarray) -> np.ndarray:
        return (np.abs(x % 10 - 5) < 10 / 6).all(axis=1)

    return {
        "name": "inclusions",
        "mesh": _write(folder / f"inclusions-{k}.vtk", (20, 10, 10), (2 * k, k, k), second=hard),
        "subdomains": {"metis": 8 if k < 10 else 16},
        "materials": [{"young": 200.0, "poisson": 0.3}, {"young": 200e3, "poisson": 0.3, "on": "volume_2"}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": HELD},
                     {"on": {"plane": "x", "at": 20}, "traction": [1, 0, 1]}],
    }


def blocks(folder: Path, k: int) -> dict[str, Any]:
    """Two cubes 10 × 10 × 10 in frictional contact, pressed and then dragged, k bricks along a side."""
    return {
        "name": "blocks", "mesh": {"box": {"size": [10, 10, 20], "cells": [k, k, 2 * k]}},
        "subdomains": {"grid": [1, 1, 2]}, "materials": STEEL,
        "interfaces": [{"law": "contact", "friction": 0.3}],
        "boundary": [{"on": "zmin", "displacement": HELD},
                     {"on": "zmax", "displacement": [[0, 0, -0.01], [0.002, 0, -0.01]]}],
    }


def _write(path: Path, size: tuple[float, ...], counts: tuple[int, ...], inside: Callable | None = None,
           second: Callable | None = None) -> dict[str, str]:
    """A mesh file of the bricks that are inside, some of them of a second matter; both are told by their centres."""
    nodes, cells = bricks(size, counts)
    corner = nodes[cells].reshape(-1, 24, 3)  # six tets make a brick
    centre = np.repeat((corner.min(axis=1) + corner.max(axis=1)) / 2, 6, axis=0)
    kept = slice(None) if inside is None else inside(centre)
    return write(path, nodes, cells[kept], 0 if second is None else second(centre)[kept].astype(int))


MODELS = {
    "beam in bending": Model(
        beam, {"P1": (4, 8, 12, 24), "P2": (1, 2, 3, 4)}, (2, 4, 8),
        lambda x: (x[:, 0] >= 20 - 1e-6) & (x[:, 0] <= 80 + 1e-6), 10, 100),
    "L-shaped bracket": Model(
        bracket, {"P1": (4, 8, 12, 16), "P2": (2, 4, 6, 8)}, (4, 8, 16),
        lambda x: (np.maximum(np.abs(x[:, 0] - 10), np.abs(x[:, 2] - 10)) >= 5 - 1e-6) & (x[:, 2] >= 5 - 1e-6)
        & (x[:, 0] <= 15 + 1e-6), 10, 20),
    "inclusions 1:1000": Model(
        inclusions, {"P1": (6, 9, 12, 18), "P2": (3, 6, 9, 12)}, (3, 6, 12),
        lambda x: (x[:, 2] >= 10 - 1e-6) & (x[:, 0] >= 10 / 3 - 1e-6) & (x[:, 0] <= 50 / 3 + 1e-6), 10, 20),
    "blocks in frictional contact": Model(
        blocks, {"P1": (4, 6, 8, 12), "P2": (2, 3, 4, 6)}, (24,),
        lambda x: (np.abs(x[:, 2] - 10) >= 5 - 1e-6) & (np.abs(x[:, 2] - 10) <= 7.5 + 1e-6), 10, 20),
}
