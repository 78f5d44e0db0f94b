"""Sentences on scenes that can be solved, but hardly are what was meant: ``check`` says them, and every summary."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from orchestrator.scene.model import Scene

LOCKING = 0.45  # Poisson's ratio from which four-node tets move visibly too little
_SHOWN = 4


def locking(scene: Scene) -> Iterator[str]:
    """Four-node tets of nearly incompressible matter."""
    if scene.mesh.cells.shape[1] != 4:
        return
    poisson = np.array([material.poisson for material in scene.materials])[scene.cell_material]
    stiff = poisson > LOCKING
    if stiff.any():
        where = some([scene.mesh.volumes[v] for v in np.unique(scene.mesh.volume[stiff])])
        yield (f"Poisson's ratio {poisson.max():g} in {where} with four-node tets (P1), which lock from about {LOCKING:g} on: "
               "they move too little, however small the residuals; take blackbox: {element: P2}, which code: freefem has")


RULES: list[Callable[[Scene], Iterator[str]]] = [locking]


def scene_cautions(scene: Scene) -> list[str]:
    """What a user should know before the scene is solved."""
    return [sentence for rule in RULES for sentence in rule(scene)]


def some(names: list[str]) -> str:
    """The first of many names."""
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"
