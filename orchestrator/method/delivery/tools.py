"""Rigid tools: how far each has moved, and whether its contact is that with its true surface where
it has ended.

The gap that the law has seen is that of a surface which meets each node along one normal, exact for
a tool that moves as prescribed. Where a tool is free, or the part itself moves along a curved
surface, the distance d of the part's nodes from the tool as both have moved tells what is amiss, e
= d − g, over the pressure's worth p h/E; and the tool's normal there, by how much the whole force
is turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.interface.rows import peak, ratio
from orchestrator.parallel.team import Team
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import local_size
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene
from orchestrator.scene.tools.motion import Rigid


@dataclass(frozen=True)
class PlacedTool:
    """A tool in the end.

    moved : (steps, 6) with rotations in radians; parts : names of the volumes that it touches
    apart : largest share of a gap that is amiss; turned : largest share of a step's forces that
        points elsewhere
    passed : depth, step and place (3,) where faces of these without contact are deepest inside it;
        None: nowhere
    """

    tool: Rigid
    moved: np.ndarray
    parts: list[str]
    apart: float
    turned: float
    passed: tuple[float, int, np.ndarray] | None


def placed(scene: Scene, own: Sequence[int], sides: Sequence[np.ndarray], fields: InterfaceFields,
           interfaces: Sequence[Interface],
           team: Team) -> list[PlacedTool]:
    """All tools of a scene; ranks ask together.

    own : this rank's subdomains; sides : per subdomain (steps, n_E, 3) displacement, of these at
        least
    fields, interfaces : this rank's, and what they are of
    """
    tools = {i.tool.name: i.tool for i in scene.interfaces if i.tool is not None}
    return [_placed(scene, own, sides, fields, interfaces, tool, team) for tool in tools.values()]


def _placed(scene: Scene, own: Sequence[int], sides: Sequence[np.ndarray], fields: InterfaceFields,
            interfaces: Sequence[Interface], tool: Rigid, team: Team) -> PlacedTool:
    """One of them."""
    meeting = [i for i in scene.interfaces if i.tool is not None and i.tool.name == tool.name]
    touched, moved = {int(scene.mesh.volume[i.cells[0, 0]]) for i in meeting if len(i.cells)}, None
    for e in [i.subdomains[1] for i in meeting if i.subdomains[1] in own][:1]:
        nodes = scene.mesh.nodes[scene.subdomains[e].nodes]
        motions = motions_about(nodes, tool.driven.about, 1.0).reshape(-1, 6)
        moved = np.linalg.lstsq(motions, sides[e].reshape(len(sides[e]), -1).T, rcond=None)[0].T
    told = team.all_gather((moved, touched))
    moved = next(m for m, _ in told if m is not None)
    moved = np.where(tool.driven.prescribed, tool.driven.moves, moved)
    touched, meet = sorted(set().union(*(t for _, t in told))), {i.index for i in meeting}
    each = [_amiss(scene, i, moved, sides, fields, at)
            for i, (_, at) in zip(interfaces, fields.each()) if i.index in meet]
    amiss = max((one for one, _ in each), default=0.0)
    turned = sum((two for _, two in each), np.zeros((2, scene.steps)))
    every = team.all_gather((amiss, turned, _passed(scene, own, tool, touched, moved, sides)))
    deepest = max((at for *_, at in every if at is not None), key=lambda at: at[0], default=None)
    return PlacedTool(tool, moved, sorted({scene.mesh.volumes[v] for v in touched}),
                  max(a for a, *_ in every), peak(ratio(*sum(t for _, t, _ in every))), deepest)


def _amiss(scene: Scene, i: Interface, moved: np.ndarray, sides: Sequence[np.ndarray],
           fields: InterfaceFields,
           own: slice) -> tuple[float, np.ndarray]:
    """The largest share of a gap that is amiss; (2, steps) the force that is turned aside, and the
    whole; ``own``: of the fields' nodes.
    """
    nodes, s = fields.nodes[own], scene.subdomains[i.subdomains[0]]
    points, displaced = scene.mesh.nodes[i.global_nodes], sides[i.subdomains[0]][
        :, np.searchsorted(s.nodes, i.global_nodes)]
    at = np.searchsorted(i.global_nodes, nodes)
    young = min(scene.materials[m].young for m in np.unique(scene.cell_material[i.cells[:, 0]]))
    size = local_size(points, i.triangles)[at]
    pressure, off, force = fields.pressure[:,
                                           own], np.zeros(scene.steps), np.zeros((2, scene.steps))
    for t, move in enumerate(moved):
        distance, normal = i.tool.at(move, points + displaced[t])
        push = np.maximum(pressure[t], 0.0)
        off[t] = peak(np.where((push > 0) & (fields.areas[t, own] > 0),
                               distance[at] - fields.gap[t, own], 0.0))
        weight = (push * fields.areas[t, own])[:, None]
        force[:,
              t] = np.linalg.norm(
                  (weight * (normal[at] + fields.normal[own])).sum(axis=0)), weight.sum()
    worth = (np.maximum(pressure, 0.0) * size / young).max(axis=1)
    return peak(ratio(off, worth)), force


def _passed(scene: Scene, own: Sequence[int], tool: Rigid, touched: Sequence[int],
            moved: np.ndarray,
            sides: Sequence[np.ndarray]) -> tuple[float, int, np.ndarray] | None:
    """As of ``PlacedTool``, in own subdomains of some volumes."""
    mesh = scene.mesh
    cells = np.flatnonzero(np.isin(mesh.volume, touched))
    faces = faces_of(mesh.cells[cells, :4], len(mesh.nodes))
    # others' may go on elsewhere
    outer = faces.outer[np.isin(scene.cell_subdomain[cells[faces.owner[faces.outer]]], own)]
    outer, size = faces.triangles[outer], np.zeros(len(mesh.nodes))
    used, local = np.unique(outer, return_inverse=True)
    size[used] = local_size(mesh.nodes[used], local.reshape(outer.shape)) if len(used) else 0.0
    met = [i.global_nodes for i in scene.interfaces if i.tool is not None
           and i.tool.name == tool.name]
    left, worst = np.setdiff1d(used, np.concatenate(met)), None
    for s in np.unique(scene.cell_subdomain[cells]).tolist():
        at = np.flatnonzero(np.isin(scene.subdomains[s].nodes, left)) if s in own else ()
        nodes = scene.subdomains[s].nodes[at]
        for t, move in enumerate(moved if len(at) else ()):
            depth = -tool.at(move, mesh.nodes[nodes] + sides[s][t][at])[0]
            deepest = int((depth - COINCIDE * size[nodes]).argmax())
            if depth[deepest] > COINCIDE * size[nodes[deepest]] and (
                worst is None or depth[deepest] > worst[0]):
                worst = float(depth[deepest]), t, mesh.nodes[nodes[deepest]]
    return worst
