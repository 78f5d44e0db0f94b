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


def placed(scene: Scene, sides: Sequence[np.ndarray], fields: InterfaceFields) -> list[PlacedTool]:
    """Return all tools of a scene.

    sides : per subdomain (steps, n_E, 3) displacement
    fields : of the interfaces that are not perfect
    """
    tools = {i.tool.name: i.tool for i in scene.interfaces if i.tool is not None}
    return [_placed(scene, sides, fields, tool) for tool in tools.values()]


def _placed(scene: Scene, sides: Sequence[np.ndarray], fields: InterfaceFields,
            tool: Rigid) -> PlacedTool:
    """One of them."""
    meeting = [(i, at) for i, (_, at) in zip(scene.opening, fields.each())
               if i.tool is not None and i.tool.name == tool.name]
    e = meeting[0][0].subdomains[1]
    motions = motions_about(scene.mesh.nodes[scene.subdomains[e].nodes], tool.driven.about,
                            1.0).reshape(-1, 6)
    moved = np.linalg.lstsq(motions, sides[e].reshape(len(sides[e]), -1).T, rcond=None)[0].T
    moved = np.where(tool.driven.prescribed, tool.driven.moves, moved)
    touched = sorted({int(scene.mesh.volume[i.cells[0, 0]]) for i, _ in meeting if len(i.cells)})
    amiss, turned = zip(*(_amiss(scene, i, moved, sides, fields, at) for i, at in meeting))
    return PlacedTool(tool, moved, sorted({scene.mesh.volumes[v] for v in touched}), max(amiss),
                      peak(ratio(*sum(turned, np.zeros((2, scene.steps))))),
                      _passed(scene, tool, touched, moved, sides))


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


def _passed(scene: Scene, tool: Rigid, touched: Sequence[int], moved: np.ndarray,
            sides: Sequence[np.ndarray]) -> tuple[float, int, np.ndarray] | None:
    """As of ``PlacedTool``, in some volumes."""
    mesh = scene.mesh
    cells = np.flatnonzero(np.isin(mesh.volume, touched))
    faces = faces_of(mesh.cells[cells, :4], len(mesh.nodes))
    outer, size = faces.triangles[faces.outer], np.zeros(len(mesh.nodes))
    used, local = np.unique(outer, return_inverse=True)
    size[used] = local_size(mesh.nodes[used], local.reshape(outer.shape)) if len(used) else 0.0
    met = [i.global_nodes for i in scene.interfaces if i.tool is not None
           and i.tool.name == tool.name]
    left, worst = np.setdiff1d(used, np.concatenate(met)), None
    for s in np.unique(scene.cell_subdomain[cells]).tolist():
        at = np.flatnonzero(np.isin(scene.subdomains[s].nodes, left))
        nodes = scene.subdomains[s].nodes[at]
        for t, move in enumerate(moved if len(at) else ()):
            depth = -tool.at(move, mesh.nodes[nodes] + sides[s][t][at])[0]
            deepest = int((depth - COINCIDE * size[nodes]).argmax())
            if depth[deepest] > COINCIDE * size[nodes[deepest]] and (
                worst is None or depth[deepest] > worst[0]):
                worst = float(depth[deepest]), t, mesh.nodes[nodes[deepest]]
    return worst
