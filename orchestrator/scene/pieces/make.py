"""A scene made by all ranks, each the subdomains that are placed on it.

What is wrong is told by one process that makes the whole: where anything is, or may hang on all of the mesh, nothing is made here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.parallel.numbering import Borders, ordered
from orchestrator.parallel.placement import owners
from orchestrator.parallel.team import Team
from orchestrator.scene.body import Body, Meshed
from orchestrator.scene.build import build_scene
from orchestrator.scene.conditions.boundary import faces_meant
from orchestrator.scene.conditions.finder import AT_POINTS, Finder, of_all
from orchestrator.scene.conditions.selection import assign_materials
from orchestrator.scene.conditions.supports import Supports
from orchestrator.scene.interfaces.search import Laws
from orchestrator.scene.mesh.faces import MAX_NODES, components
from orchestrator.scene.model import Scene
from orchestrator.scene.overview import Beside
from orchestrator.scene.part import part_of
from orchestrator.scene.pieces.dealt import Dealt
from orchestrator.scene.pieces.outline import AT_NODES, BEHIND, OPPOSITE, Outline
from orchestrator.scene.pieces.piece import Extent, Piece
from orchestrator.scene.pieces.sources import agreed, dealt
from orchestrator.timing import predicted_cost


JUDGED = "something is amiss, or hangs on all of the mesh"


def source_of(config: Config, team: Team, meshed: Meshed) -> Dealt | str:
    """What makes the configuration's pieces; or why one process has to make the scene. All ranks ask together; ``meshed`` as of ``make``."""
    if config.refines:
        return "an accuracy"
    if any(code.brings_loads or code.remembers for code in config.codes):
        return "matter or loads of a code's own"
    if config.bolts or config.tools:
        return "bolts or rigid tools"
    return dealt(config, team, meshed) or "a mesh that one process makes"


def make(config: Config, team: Team, meshed: Meshed | None = None) -> Scene | str:
    """The part of a scene that is this rank's, which all ranks make together; or why one has to make the whole, the same on all of them.

    meshed : what makes a mesh on rank 0; where one has to make the scene of it, it may have it already
    """
    meshed = meshed or Meshed()
    source = source_of(config, team, meshed)
    if isinstance(source, str):
        return source
    if len(source.names) < team.size:
        return "fewer subdomains than ranks"
    if config.output.figures and source.extent.nodes > MAX_NODES:
        return "pictures of so large a mesh"
    nodes, pairs, common = source.sizes
    rank_of = team.share(None if team.rank else owners(predicted_cost(3 * nodes), pairs, 3 * common, team.size))
    if np.bincount(rank_of, weights=nodes).max() > MAX_NODES / 2:  # with what is around them they have to fit
        return "more nodes of a rank than numbers allow"
    meshed.let_go()  # of the whole, which from here on nobody has
    source.deal(rank_of, config.interfaces, team)
    made, extent = _pieces(config, source, np.flatnonzero(rank_of == team.rank), team)
    surfaces = {} if made[0] is None else gathered(config, made[0], team)
    local = None if made[0] is None else agreed(lambda: Local.of(config, made, surfaces), team)
    if local is None:
        return JUDGED
    every = team.all_gather(local.outline)
    whole, number = Outline.joined(every), np.concatenate([x.number for x in every])
    rank_of = np.repeat(np.arange(team.size), [len(x.number) for x in every])[np.argsort(number)]
    kind = np.sort(number) // local.count  # 0 of the mesh's subdomains, and as ``Local.of`` has it
    extent = local.numbered(whole, np.sort(number), extent, team)
    body = components(*whole.sides[whole.order[:, 0] != AT_NODES].T, len(whole.number))[1]
    laws = Laws(config.interfaces, [*whole.names, *local.part.mesh.volumes], config.factors(config.interfaces))
    parted = any(entry.ground and entry.ground.whole and (kind == 1 + entry.index).sum() > 1
                 for entry in local.part.boundary)
    bodies = np.flatnonzero(kind == 0)
    free = Supports.joined([whole.kept], bodies).free(np.unique(body[bodies], return_inverse=True)[1].ravel()).any()
    near = _near(local, whole, team)
    asked = "interfaces" in config.model_fields_set
    if near is None or any((free, parted, (whole.faces == 0).any(), asked and not _of_use(laws, whole),
                            source.further and (whole.order[:, 0] == OPPOSITE).any(),
                            any(beside.refused for beside in near.values()))):
        return JUDGED
    whole.near = near
    part = whole.around(local.part, local.present, whole.overview(local.part, extent, rank_of), laws)
    if not part.bonded:
        _tell_areas(part, team)
    return _watched(config, part, team)


def _pieces(config: Config, source: Dealt, mine: np.ndarray, team: Team) -> tuple[list[Piece | None], Extent]:
    """This rank's piece, with some subdomains, alone in a list that it can be taken out of, None on all ranks where one cannot make its; and
    what the whole mesh is then."""
    made, extent = [agreed(lambda: source.piece(mine), team)], source.extent
    if made[0] is not None:
        piece, nodes = made.pop().of_element(config.codes[0].element, config.matter, extent.nodes, team)
        made, extent = [piece], replace(extent, nodes=nodes)
    return made, extent


@dataclass
class Local:
    """A rank's subdomains, in the numbers of the piece that it has made.

    part : theirs of the scene that was made of the piece; its nodes and cells have their numbers in the whole
    present : (subdomains,) int, which of the whole scene's those of the part are; until they are ``numbered`` as of a ``Piece``, and then
        grounds, entry by entry, by that of what they are behind
    given : how many nodes and cells of the part are the mesh's; count : as of a ``Piece``
    """

    part: Scene
    present: np.ndarray
    outline: Outline
    given: tuple[int, int]
    count: int

    @classmethod
    def of(cls, config: Config, made: list[Piece], surfaces: Mapping[int, np.ndarray]) -> Local:
        """Of the subdomains that are all there, and the grounds behind them.

        made : the piece with them, which is taken out of the list so that it goes when it is not needed any more
        surfaces : as of ``Body``
        Raises InputError: whatever is wrong with it
        """
        present, number, cell_number, here, count = *(getattr(made[0], name) for name in ("present", "number", "cell_number")), \
            made[0].partition.here, made[0].count

        def meshed(config, run_programs, problems) -> Body:  # its faces go with the last step that needs them
            piece = made.pop()
            return Body(piece.mesh, piece.faces, *assign_materials(piece.mesh, config.matter, problems),
                        piece.choice, piece.partition, surfaces)

        scene = build_scene(config, meshed=meshed)
        before = {i.subdomains[1]: i.subdomains[0] for i in reversed(scene.interfaces) if i.law.on_ground}
        for behind in scene.subdomains[len(present):]:
            entry, body = int(behind.held_by.max()), before[behind.index]
            here = np.append(here, here[body])
            present = np.append(present, (1 + entry) * count + present[body])
        own = np.flatnonzero(here)
        part = part_of(scene, own, None)
        given = np.searchsorted(part.number, len(number)), np.searchsorted(part.cell_number, len(cell_number))
        for behind in scene.subdomains[-len(before):] if before else ():  # of a layer some nodes and cells may be there
            part.number[part.subdomains[behind.index].nodes] -= behind.nodes[0]
            part.cell_number[part.subdomains[behind.index].cells] -= behind.cells[0]
        part.number, part.cell_number = (np.concatenate([of[at[:end]], at[end:]]) for of, at, end in (
            (number, part.number, given[0]), (cell_number, part.cell_number, given[1])))
        return cls(part, present, Outline.of(scene, part, present, own), given, count)

    def numbered(self, whole: Outline, order: np.ndarray, extent: Extent, team: Team) -> Extent:
        """Gives what has been added to the mesh its numbers; and what is around all of it. All ranks ask together.

        whole : of all; order : (subdomains,) ascending, the numbers that have put its subdomains in their order
        extent : of the mesh
        """
        self.present, part = np.searchsorted(order, self.present), self.part
        added = order >= self.count
        for of, what, every, begin in ((part.number, "nodes", whole.nodes, extent.nodes),
                                       (part.cell_number, "cells", whole.cells, int(whole.cells[~added].sum()))):
            starts = begin + np.cumsum(every * added) - every
            for e, s in zip(self.present.tolist(), part.subdomains):
                of[getattr(s, what)] += starts[e] * added[e]
        points = part.mesh.nodes[self.given[0]:]
        low, high = np.reshape(team.max(*-points.min(axis=0, initial=np.inf), *points.max(axis=0, initial=-np.inf)), (2, 3))
        return Extent(extent.nodes + int(whole.nodes[added].sum()), np.stack([np.minimum(extent.box[0], -low), np.maximum(extent.box[1], high)]))


def _near(local: Local, whole: Outline, team: Team) -> dict[tuple[int, int], Beside] | None:
    """The pairs that are near each other, with what is said of them once it is known whether something connects them; None where no rank
    has all of one. All ranks ask together."""
    if not whole.near:
        return {}
    part, body = local.part, components(*whole.sides[whole.order[:, 0] <= OPPOSITE].T, len(whole.number))[1]
    own = {v: int(body[local.present[part.cell_subdomain[part.mesh.volume == v][0]]]) for v in part.sagitta}
    of = {v: number for told in team.all_gather(own) for v, number in told.items()}
    if any(v not in of for pair in whole.near for v in pair):
        return None
    return {(one, two): Beside(beside.gap) if beside.enough and of[one] == of[two] else beside for (one, two), beside in whole.near.items()}


def _tell_areas(part: Scene, team: Team) -> None:
    """Gives neighbours the areas of all their interfaces that are not perfect: some are with bodies that are not here."""
    present = [s for s in part.subdomains if len(s.nodes)]
    areas = np.concatenate([s.contact_area * (part.overview.rank_of[s.index] == team.rank) for s in present])
    names = np.column_stack([np.repeat([s.index for s in present], [len(s.nodes) for s in present]),
                             part.number[np.concatenate([s.nodes for s in present])]])
    told = np.split(Borders(names, np.arange(len(names)), team)(areas), np.cumsum([len(s.nodes) for s in present])[:-1])
    for s, area in zip(present, told):
        s.contact_area = area


def _watched(config: Config, part: Scene, team: Team) -> Scene | str:
    """The part with its probes, which have the numbers of the whole; why one has to make it, on all ranks, where something is wrong with one."""
    problems, of, asked = Problems(), part.cell_subdomain, config.output.named_probes
    points = Finder(part.mesh, None, of, [s.body or s.name for s in part.subdomains], part.interfaces, problems, part.cell_number,
                    (part.overview.rank_of[of] == team.rank) & ~part.stand_ins[of], team).find(asked, AT_POINTS)
    found = {p.name: p for p in [*points, *(of_all(p, asked[p.name], part, team) for p in part.probes)] if p is not None}
    part.probes = [found[name] for name in asked if name in found]
    part.overview.cautions.extend(problems.warnings)
    return part if len(found) == len(asked) else JUDGED


def gathered(config: Config, piece: Piece, team: Team) -> dict[int, np.ndarray]:
    """Corners (K, 3, 3) of all faces of each entry of ``boundary`` whose effect on one hangs on all, in the order of the whole mesh."""
    found, here = {}, piece.partition.here
    for k, entry in enumerate(config.boundary):
        if not entry.kind.local:
            chosen = faces_meant(piece.mesh, piece.faces, entry, ("boundary", k), Problems())  # told with the scene
            triangles = piece.faces.triangles[chosen[here[piece.partition.subdomain[piece.faces.owner[chosen]]]], :3]
            found[k] = ordered(np.sort(piece.number[triangles], axis=1), piece.mesh.nodes[triangles], team)
    return found


def _of_use(laws: Laws, whole: Outline) -> bool:
    """Whether every entry governs, or would but for a later one, some interface, and every name that it leaves out or chooses is known."""
    problems, cuts = Problems(), []
    for (one, two), called, kind in zip(whole.sides.tolist(), whole.called, whole.order[:, 0].tolist()):
        if whole.bodies[one] != whole.bodies[two] and kind != BEHIND:
            laws.between(*called)
        elif kind != BEHIND:
            cuts.append((whole.names[one], whole.names[two]))
    laws.refuse_within(cuts, problems)
    named = [name for entry in laws.entries for name in (*chain.from_iterable(entry.exclude or ()), *([entry.slave] if entry.slave else ()))]
    return not problems.found and all(laws.used) and all(laws.meant(name) for name in named)
