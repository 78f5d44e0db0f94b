"""Rigid tools in the summary: how far each has moved, and whether its contact is that with its true surface where it has ended.

The gap that the law has seen is that of a surface which meets each node along one normal, exact for a tool that moves as prescribed. Where
a tool is free, or the part itself moves along a curved surface, the distance d of the part's nodes from the tool as both have moved
tells what is amiss, e = d − g, over the pressure's worth p h/E; and the tool's normal there, by how much the whole force is turned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from orchestrator.errors import some
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import format_point, local_size
from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.tools.motion import Rigid

# Shares of gaps' worth of pressure, and of forces that point elsewhere, from which they are told.
AMISS, TURNED = 0.1, 0.01


def _placed(scene: Scene, sides: Sequence[np.ndarray]) -> dict[str, tuple[list[Interface], Rigid, np.ndarray]]:
    """Per tool its interfaces, itself, and how far it has moved, (steps, 6) with rotations in radians.

    sides : per subdomain (steps, n_E, 3) displacement
    """
    found: dict[str, tuple[list[Interface], Rigid, np.ndarray]] = {}
    for i in scene.interfaces:
        if i.tool is None:
            continue
        if i.tool.name not in found:
            e = i.subdomains[1]
            motions = motions_about(scene.mesh.nodes[scene.subdomains[e].nodes], i.tool.driven.about, 1.0).reshape(-1, 6)
            moved = np.linalg.lstsq(motions, sides[e].reshape(len(sides[e]), -1).T, rcond=None)[0].T
            found[i.tool.name] = [], i.tool, np.where(i.tool.driven.prescribed, i.tool.driven.moves, moved)
        found[i.tool.name][0].append(i)
    return found


def tools_moved(scene: Scene, sides: Sequence[np.ndarray]) -> list[dict[str, Any]]:
    """Every tool's displacement of its point and rotation in degrees, per load step."""
    return [{"name": name, "about": tool.driven.about.tolist(), "displacement": moved[:, :3].tolist(),
             "rotation": np.degrees(moved[:, 3:]).tolist()} for name, (_, tool, moved) in _placed(scene, sides).items()]


def tool_cautions(scene: Scene, sides: Sequence[np.ndarray], fields: InterfaceFields) -> Iterator[str]:
    """A sentence on each tool whose contact is not that with its surface; ``sides``: as for ``tools_moved``."""
    numbers = {str(name): k for k, name in enumerate(fields.names)}
    for name, (interfaces, tool, moved) in _placed(scene, sides).items():
        apart, turned = 0.0, np.zeros((2, scene.steps))
        for i in interfaces:
            one, two = _amiss(scene, i, moved, sides, fields, numbers[i.name])
            apart, turned = max(apart, one), turned + two
        share = float((turned[0] / np.where(turned[1] > 0, turned[1], 1.0)).max())
        told = [f"gaps are off by up to {apart:.0%} of what presses"] * (apart > AMISS) + \
            [f"forces point {share:.1%} of their size elsewhere"] * (share > TURNED)
        if told:
            yield f"{name} has moved along its curved surface: {' and '.join(told)}; smaller motions are told right"
        yield from _passed(scene, interfaces, tool, moved, sides)


def _amiss(scene: Scene, i: Interface, moved: np.ndarray, sides: Sequence[np.ndarray], fields: InterfaceFields,
           number: int) -> tuple[float, np.ndarray]:
    """The largest share of a gap that is amiss; (2, steps) the force that is turned aside, and the whole."""
    own = slice(int(fields.offsets[number]), int(fields.offsets[number + 1]))
    nodes, s = fields.nodes[own], scene.subdomains[i.subdomains[0]]
    points, displaced = scene.mesh.nodes[i.global_nodes], sides[i.subdomains[0]][:, np.searchsorted(s.nodes, i.global_nodes)]
    at = np.searchsorted(i.global_nodes, nodes)
    young = min(scene.materials[m].young for m in np.unique(scene.cell_material[i.cells[:, 0]]))
    size = local_size(points, i.triangles)[at]
    pressure, off, force = fields.pressure[:, own], np.zeros(scene.steps), np.zeros((2, scene.steps))
    for t, move in enumerate(moved):
        distance, normal = i.tool.at(move, points + displaced[t])
        push = np.maximum(pressure[t], 0.0)
        off[t] = np.abs(np.where((push > 0) & (fields.areas[t, own] > 0), distance[at] - fields.gap[t, own], 0.0)).max(initial=0.0)
        weight = (push * fields.areas[t, own])[:, None]
        force[:, t] = np.linalg.norm((weight * (normal[at] + fields.normal[own])).sum(axis=0)), weight.sum()
    worth = (np.maximum(pressure, 0.0) * size / young).max(axis=1)
    return float((off / np.where(worth > 0, worth, np.inf)).max(initial=0.0)), force


def _passed(scene: Scene, interfaces: Sequence[Interface], tool: Rigid, moved: np.ndarray, sides: Sequence[np.ndarray]) -> Iterator[str]:
    """A sentence where faces of the part that have no contact with the tool end inside it."""
    mesh = scene.mesh
    cells = np.flatnonzero(np.isin(mesh.volume, [mesh.volume[i.cells[0, 0]] for i in interfaces]))
    faces = faces_of(mesh.cells[cells, :4], len(mesh.nodes))
    outer = faces.triangles[faces.outer]
    size = np.zeros(len(mesh.nodes))
    used, local = np.unique(outer, return_inverse=True)
    size[used] = local_size(mesh.nodes[used], local.reshape(outer.shape))
    left, worst = np.setdiff1d(used, np.concatenate([i.global_nodes for i in interfaces])), None
    for s in np.unique(scene.cell_subdomain[cells]).tolist():
        at = np.flatnonzero(np.isin(scene.subdomains[s].nodes, left))
        nodes = scene.subdomains[s].nodes[at]
        for t, move in enumerate(moved if len(at) else ()):
            depth = -tool.at(move, mesh.nodes[nodes] + sides[s][t][at])[0]
            deepest = int((depth - COINCIDE * size[nodes]).argmax())
            if depth[deepest] > COINCIDE * size[nodes[deepest]] and (worst is None or depth[deepest] > worst[0]):
                worst = depth[deepest], t, mesh.nodes[nodes[deepest]]
    if worst is not None:
        yield (f"{some(sorted({mesh.volumes[v] for v in np.unique(mesh.volume[cells])}))} passes through {tool.name} by {worst[0]:.3g} at "
               f"load step {worst[1] + 1}, at {format_point(worst[2])}, where no faces were sought that it may touch: write within: with a "
               "larger length, or angle: for faces that look aside")
