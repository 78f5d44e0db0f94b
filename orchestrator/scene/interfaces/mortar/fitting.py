"""Bonded faces that are curved: the slave's nodes are put onto the master's facets before anything
is computed.

Facets of two sizes about one curved surface are apart, or in each other, by what they are off it
(h²/8R). What is bonded across that slit is not what is bonded face to face. Once the slave's nodes
have been moved to P x₂, by no more than facets are off the surface anyway, constant stresses pass
with an error smaller by, measured in energy, 17 times where both sides are equally fine, 25 to 30
where the slave is finer by 2 or 3, and 1.4 where it is coarser. Moving the master's gains nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.rounding import PLACED
from orchestrator.scene.interfaces.distances import around
from orchestrator.scene.interfaces.mortar.duals import multipliers
from orchestrator.scene.interfaces.mortar.operators import COVERED
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.interface import Interface

# Each pass leaves a small share of what was off, as P changes with the nodes.
PASSES = 3
# A cell keeps this share of its volume, or its nodes stay where they are.
KEPT = 0.5
# Facets that have been moved are still within the distance they were, and this share of their size.
SLANTED = 0.1


def fitted(mesh: Mesh, numbering: SplitNumbering, interfaces: Sequence[Interface],
           held: np.ndarray) -> Mesh:
    """The mesh with nodes of bonded curved faces moved; ``surfaces`` of these interfaces follow.

    interfaces : all there are; nothing happens without perfect ones whose nodes do not match
    held : (n, 3) bool, components in which nodes stay as they are prescribed
    """
    bonded = [i for i in interfaces if i.surfaces is not None and i.law.perfect]
    if not bonded:
        return mesh
    stays = held.all(axis=1)
    met = np.zeros(len(mesh.nodes), dtype=int)
    for i in interfaces:
        if i.surfaces is None:  # nodes of either side stay where those of the other are
            met[np.unique(numbering.nodes[np.concatenate(numbering.sides(i))])] += 1
            continue
        for nodes in i.surfaces.nodes:
            met[nodes] += 1
    stays |= met > 1
    nodes, corners = mesh.nodes.copy(), mesh.cells[:, :4]
    far = [np.abs(i.surfaces.segments.distance).max() for i in bonded]
    most = [_chords(i.surfaces) for i in bonded]
    drawn = [i.surfaces.points[0] for i in bonded]
    before = tet_volumes(mesh.nodes, corners)
    for _ in range(PASSES):
        moved, close = nodes.copy(), True
        for i, apart, room, origin in zip(bonded, far, most, drawn):
            here = again(i.surfaces.moved(nodes), apart)
            where, at = _places(here)
            where = np.where(held[here.nodes[0]], here.points[0], where)
            own = here.nodes[0][at]
            moves = ~stays[own] & (np.linalg.norm(where[at] - origin[at], axis=1) <= room[at])
            at, own = at[moves], own[moves]
            moved[own] = where[at]
            close &= bool((np.linalg.norm(moved[own] - nodes[own], axis=1)
                           <= PLACED * here.size[at]).all())
        if close:
            break
        while (crushed := tet_volumes(moved, corners) < KEPT * before).any():
            back = np.unique(corners[crushed])
            if not (moved[back] != mesh.nodes[back]).any():
                break
            moved[back], stays[back] = mesh.nodes[back], True
        nodes = moved
    if np.array_equal(nodes, mesh.nodes):
        return mesh
    if mesh.cells.shape[1] == 10:
        nodes[mesh.cells[:, 4:]] = nodes[mesh.cells[:, TET_EDGES]].mean(axis=2)
    for i, apart in zip(bonded, far):
        # facets themselves are on each other
        i.surfaces = replace(again(i.surfaces.moved(nodes), apart), under=None)
    return replace(mesh, nodes=nodes)


def _chords(surfaces: Surfaces) -> np.ndarray:
    """(n₁,) how far the facets of both sides are off their surfaces around each of the slave's
    nodes: beyond, it is a gap that is
    drawn, which rigid links carry (``operators``), and no slit of chords."""
    if surfaces.under is None:
        return np.zeros(len(surfaces.points[0]))
    off = around(surfaces, *(side.sagitta for side in surfaces.under))
    return off + COINCIDE * surfaces.size


def again(surfaces: Surfaces, apart: float) -> Surfaces:
    """Fit the facets' overlaps where they are now, apart by as much as they were."""
    slave, master = surfaces.facets
    return replace(surfaces, segments=find_segments(slave, master, apart + SLANTED * slave.size))


def _places(surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
    """(n₁, 3) P x₂ of the slave's nodes, and which of these nodes (m,) are well covered corners."""
    corners = tuple(t[:, :3] for t in surfaces.triangles)
    weights = multipliers(surfaces.segments, *corners, surfaces.area,
                          tuple(len(x) for x in surfaces.points))
    there = np.flatnonzero(weights.share >= COVERED)
    places = surfaces.points[0].copy()
    places[there] = (weights.other @ surfaces.points[1])[there] / weights.area[there, None]
    return places, there
