"""Which material each volume is made of."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Material
from orchestrator.scene.names import matching, patterns_of, suggestion
from orchestrator.wording import some


def assign_materials(mesh: Mesh, entries: list[Any], problems: Problems) -> tuple[list[Material], np.ndarray]:
    """The materials and, per tet, (m,) int which one; of several that match, the last wins."""
    chosen = np.full(len(mesh.volumes), -1)
    for i, entry in enumerate(entries):
        chosen[volumes_named(mesh, entry.on, ("materials", i, "on"), problems)] = i
    materials = [Material(float(e.young), float(e.poisson), float(e.expansion or 0.0)) for e in entries]
    own = {name for e in entries if getattr(e, "on", None) is not None for name in patterns_of(e.on)}
    for stand in mesh.foreign:
        if stand.matter is not None and mesh.volumes[stand.volume] not in own:  # what it tells of itself, unless it is named
            chosen[stand.volume] = len(materials)
            materials.append(Material(*stand.matter))
    without = [name for name, material in zip(mesh.volumes, chosen) if material < 0]
    if without:
        problems.add(("materials",), f"no material for {some(without, 8)}",
                     "a material for each volume", 'name these volumes under on:, or begin the list with a material '
                     'without on:, which holds for all')
    return materials, chosen[mesh.volume]


def volumes_named(mesh: Mesh, on: Any, path: tuple[str | int, ...], problems: Problems) -> list[int]:
    """Indices of the volumes an ``on`` entry names; a name that matches none is a problem."""
    found: dict[int, None] = {}
    for pattern in patterns_of(on):
        names = matching(pattern, mesh.volumes)
        if not names:
            problems.add(path, f"no volume is called {pattern!r}", "names of volumes, shell wildcards allowed",
                         suggestion(pattern, mesh.volumes, "volume"))
        found.update(dict.fromkeys(mesh.volumes.index(name) for name in names))
    return list(found)


def cells_loaded(mesh: Mesh, on: Any, path: tuple[str | int, ...], problems: Problems) -> np.ndarray:
    """(k,) int, cells of the volumes that a load names; parts whose mesh is not ours bring their loads along."""
    cells = np.flatnonzero(np.isin(mesh.volume, volumes_named(mesh, on, path, problems)))
    if not mesh.foreign:
        return cells
    foreign = mesh.is_foreign(cells)
    if len(cells) and foreign.all():
        problems.add(path, f"a load on {mesh.volumes[mesh.volume[cells[0]]]!r} alone, whose mesh is not this program's",
                     "loads on parts with a mesh", "put it in the part's own loads")
    return cells[~foreign]
