"""Rigid tools that are pushed, on pieces of a mesh: one body each, whose layer the ranks of all that it may touch make alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.parallel.team import Team
from orchestrator.scene.conditions.selection import volumes_named
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.tools.motion import Rigid
from orchestrator.scene.tools.touching import may_touch


def pushed_tools(config: Config) -> list[tuple[Rigid, Entry]]:
    """The tools of a configuration that have to find their way, each with the entry of ``interfaces`` that it is in.

    Raises InputError: an STL file that is none
    """
    if not config.tools:
        return []
    from orchestrator.scene.tools.add import PLACE, rigid_of

    there = [(i, entry) for i, entry in enumerate(config.interfaces) if entry.tool is not None]
    made = [(rigid_of(name, tool, config.factors_of(tool.history), ("interfaces", i, *PLACE[2:])), entry)
            for (i, entry), (name, tool) in zip(there, config.tools.items())]
    return [(tool, entry) for tool, entry in made if not tool.driven.held]


def cells_at_tools(mesh: Mesh, outer: np.ndarray, tools: Sequence[tuple[Rigid, Entry]], team: Team) -> list[np.ndarray]:
    """For every other rank cells (k,) int of this one's that touch faces which a pushed tool may touch that may touch both ranks'.

    mesh : of this rank's subdomains; outer : (k, 3) int, its outer faces; all ranks ask together
    """
    there, found = np.zeros(len(mesh.nodes), dtype=bool), [[np.empty(0, dtype=int)] for _ in range(team.size)]
    touching = []
    for tool, entry in tools:
        there[:] = False
        there[mesh.cells[np.isin(mesh.volume, volumes_named(mesh, entry.pair[0], (), Problems()))]] = True
        triangles = outer[there[outer].all(axis=1)]
        there[:] = False
        there[triangles[may_touch(mesh, triangles, tool, entry)]] = True
        touching.append(np.flatnonzero(there[mesh.cells].any(axis=1)))
    for rank, told in enumerate(team.all_gather([len(cells) > 0 for cells in touching])):
        found[rank] += [cells for cells, too in zip(touching, told) if too and rank != team.rank]
    return [np.unique(np.concatenate(cells)) for cells in found]
