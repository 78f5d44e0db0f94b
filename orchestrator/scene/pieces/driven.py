"""Bolts and pushed tools of a mesh that ranks have in pieces.

Ranks that have cells of a bolt find its plane, and tell all which cells go to the other side. A
rigid tool that is pushed is one body, whose layer the ranks of all that it may touch make alike.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.parallel.team import Team
from orchestrator.scene.bolts import ahead_of, bolt_cells, cut_at, Plane, planes
from orchestrator.scene.conditions.selection import volumes_named
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.pieces.piece import Piece
from orchestrator.scene.shanks import across_shank, ends_beside, Shanks
from orchestrator.scene.threads import bonds, threads_of
from orchestrator.scene.tools.motion import Rigid
from orchestrator.scene.tools.touching import may_touch


def cut(piece: Piece, config: Any, team: Team) -> Piece | None:
    """A piece with the bolts cut that it has cells of; None, on all ranks, where something is wrong with one, or where the place of its cut
    hangs on cells of several. All ranks ask together; of ``config`` its ``bolts`` and ``interfaces``."""
    bolts = config.bolts
    mesh, faces, partition, number, problems = piece.mesh, piece.faces, piece.partition, piece.cell_number, Problems()
    own, here = [bolt_cells(mesh, bolt) for bolt in bolts], partition.here[partition.subdomain]
    shanks = {i: across_shank(mesh, faces, cells, here[cells], team, piece.number) for i, cells in enumerate(own)}
    round_ones = {i: shank for i, shank in shanks.items() if shank is not None}
    ends = team.all_gather({i: np.unique(ends_beside(mesh, faces, own[i], shank)) for i, shank in round_ones.items()})
    beside = {i: np.concatenate([told[i] for told in ends]) for i in ends[0]}
    bonded = team.all_gather({i: threads_of(mesh, faces, own[i], shank, bonds(config.interfaces, mesh.volumes, bolts[i].on))
                              for i, shank in round_ones.items()})
    threads = {i: [thread for told in bonded for thread in told[i]] for i in bonded[0]}
    found: dict[int, list[Plane]] = {}
    for told in team.all_gather([_told(piece, plane, here[plane.own]) for plane in
                                 planes(mesh, faces, partition, bolts, Shanks(shanks, beside, threads), problems)]):
        for plane in told:
            found.setdefault(plane.index, []).append(plane)
    known = [len(same) == 1 or bolts[i].cut != "auto" for i, same in found.items() if sum(plane.ahead for plane in same).all()]
    every = [replace(same[0], own=own[i], ahead=ahead_of(mesh, own[i], same[0].axis, same[0].point)
                     ^ np.isin(number[own[i]], np.concatenate([plane.own for plane in same]))) for i, same in sorted(found.items()) if len(own[i])]
    both = [np.intersect1d(*(partition.subdomain[plane.own[plane.ahead == side]] for side in (False, True))) for plane in every]
    split = np.concatenate(team.all_gather(piece.present[np.concatenate([np.empty(0, int), *both])]))
    partition, cuts, keys = cut_at(every, faces, partition, problems, np.flatnonzero(np.isin(piece.present, split)))
    if team.max(float(bool(problems.found)))[0] or sum(known) < len(bolts):
        return None
    return replace(piece, partition=partition, present=2 * piece.present[keys // 2] + keys % 2, count=2 * piece.count, cuts=cuts,
                   cautions=problems.warnings)


def _told(piece: Piece, plane: Plane, here: np.ndarray) -> Plane:
    """Of a plane the numbers of this rank's own cells that are on the other side than their centroids, and how many of them are on each."""
    other = plane.ahead != ahead_of(piece.mesh, plane.own, plane.axis, plane.point)
    return replace(plane, own=piece.cell_number[plane.own[other & here]], ahead=np.bincount(plane.ahead[here], minlength=2))


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
