"""Where subdomains meet: each other, rigid tools and grounds.

Bonded faces that are curved: the slave's nodes are put onto the master's facets before anything
is computed.

Facets of two sizes about one curved surface are apart, or in each other, by what they are off it
(h²/8R). What is bonded across that slit is not what is bonded face to face. Once the slave's nodes
have been moved to P x₂, by no more than facets are off the surface anyway, constant stresses pass
with an error smaller by, measured in energy, 17 times where both sides are equally fine, 25 to 30
where the slave is finer by 2 or 3, and 1.4 where it is coarser. Moving the master's gains nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.linalg import PLACED
from orchestrator.scene.body import Body, Divided
from orchestrator.scene.cautions import loads_on_pairs
from orchestrator.scene.conditions.boundary import acting
from orchestrator.scene.conditions.ground import add_grounds
from orchestrator.scene.interface import Beside, Interface
from orchestrator.scene.interfaces.distances import around
from orchestrator.scene.interfaces.freedom import join_bolts
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.mortar.duals import multipliers
from orchestrator.scene.interfaces.mortar.operators import COVERED
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.interfaces.overlap import sagittas
from orchestrator.scene.interfaces.pairs import make_interfaces
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.model import BoundaryEntry, PlacedBolt


@dataclass(frozen=True)
class Joined:
    """Subdomains and where they meet.

    cut : the subdomains; where sides are fitted to each other their nodes are moved
    boundary : what acts on faces, and what drives tools
    near, covered, sagitta : see ``Scene``
    grounds : those of the interfaces that are with a ground, and the entry of ``boundary`` of each
    stands : per entry of ``boundary`` that stands on one, the nodes of its grounds
    """

    cut: Divided
    boundary: list[BoundaryEntry]
    interfaces: list[Interface]
    near: Mapping[tuple[int, int], Beside]
    bolts: list[PlacedBolt]
    covered: np.ndarray
    sagitta: Mapping[int, np.ndarray]
    grounds: Sequence[tuple[int, Interface]] = ()
    stands: Mapping[int, slice] = field(default_factory=dict)


def joined(config: Config, cut: Divided, boundary: list[BoundaryEntry],
           problems: Problems) -> Joined:
    """Return the interfaces; where their sides are fitted to each other the mesh's nodes move, and
    what acts on faces with them."""
    body, mesh = cut.body, cut.body.mesh
    young, held = _matter(body, boundary)
    asked = "interfaces" in config.model_fields_set and any(
        entry.tool is None for entry in config.interfaces)
    laws = Laws(config.interfaces, [*cut.partition.names, *mesh.volumes],
                config.factors(config.interfaces), asked)
    parts = Parts(mesh, body.faces, cut.partition, cut.numbering, young, held)
    interfaces, near = ([], {}) if cut.failed else make_interfaces(parts, laws, problems)
    bolts = join_bolts(cut.bolts, interfaces, config.bolts, config.factors(config.bolts), problems)
    if mesh.foreign and not cut.failed:
        from orchestrator.scene.foreign.standin import report_joints, report_units

        report_joints(mesh, interfaces, cut.numbering, problems)
        report_units(mesh, interfaces, cut.partition.subdomain, young, problems)
    covered = loads_on_pairs(mesh, boundary, interfaces, cut.numbering)
    if any(i.surfaces is not None for i in interfaces):
        for stand in mesh.foreign:
            held[stand.nodes] = True
        mesh = fitted(mesh, cut.numbering, interfaces, held)
        boundary = [replace(entry, does=acting(mesh, entry.triangles, given, times,
                                               # told before
                                               ("boundary", entry.index), Problems()))
                    for entry, given, times in zip(
                        boundary, config.boundary, config.factors(config.boundary))]
    return Joined(replace(cut, body=replace(body, mesh=mesh)), boundary, interfaces, near, bolts,
                  covered, sagittas(mesh, sorted({v for pair in near for v in pair})))


def _matter(body: Body, boundary: list[BoundaryEntry]) -> tuple[np.ndarray, np.ndarray]:
    """Return the modulus (m,) of each cell, 1 without materials, which are complained of
    elsewhere; and which components (n, 3) bool are prescribed.
    """
    young = np.array([m.young for m in body.materials] or [1.0])
    young = young[np.maximum(body.material, 0) if body.materials else 0 * body.material]
    held = np.zeros((len(body.mesh.nodes), 3), dtype=bool)
    for entry in boundary:
        if entry.prescribed and entry.prescribed.fixed.any():
            held[entry.nodes] |= entry.prescribed.fixed
    for stand in body.mesh.foreign:
        held[stand.nodes] |= stand.held
    return young, held


def with_tools(config: Config, before: Joined, problems: Problems) -> Joined:
    """Add rigid tools: cells, subdomains, interfaces, and entries of ``boundary`` that drive
    them."""
    body = before.cut.body
    if before.cut.failed or not (config.tools and body.materials):
        return before
    from orchestrator.scene.tools.add import add_tools, pressed_tools

    pressed = pressed_tools(body.mesh, body.faces, config.interfaces, config.tools,
                            config.factors(config.tools.values()), problems)
    if problems.found:
        return before
    cut, interfaces, entries = add_tools(before.cut, pressed, len(before.boundary))
    return replace(before, cut=cut, boundary=before.boundary + entries,
                   interfaces=before.interfaces + interfaces)


def with_grounds(before: Joined, problems: Problems) -> Joined:
    """Add a ground behind every entry that stands on one: cells, subdomains, interfaces."""
    if before.cut.failed or problems.found or not any(e.ground for e in before.boundary):
        return before
    cut, grounds, stands = add_grounds(before.cut, before.boundary, problems)
    return replace(before, cut=cut, grounds=grounds, stands=stands,
                   interfaces=before.interfaces + [i for _, i in grounds])


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
