"""What interfaces carry as a whole: force, moment, centre of pressure, bonded interfaces too.

With f the nodal forces of side 2 on side 1, x the nodes of side 1, n their normals and c the interface's centre of area,

    F = Σ f,    M = Σ (x − c) × f,    x_p = Σ (n·f) x / Σ n·f

The last is where the normal forces act as a whole: nowhere where they add up to nothing beside themselves. On a plane
interface it is where F has the same moment about axes in the plane. Forces of components that are prescribed are the
supports', not the interface's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.status import BONDED
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.interface.ties import traced
from orchestrator.scene.mesh.geometry import area_vectors, node_normals
from orchestrator.scene.model import Scene

# Normal forces whose sum is this small beside their magnitudes have no centre: iterations leave as much.
NO_CENTRE = 1e-6


@dataclass(frozen=True)
class Resultants:
    """Of all interfaces of the scene, T load steps, I interfaces."""

    force: np.ndarray  # (T, I, 3) of side 2 on side 1
    moment: np.ndarray  # (T, I, 3) about ``centre``
    pressure_centre: np.ndarray  # (T, I, 3), nan where there is none
    centre: np.ndarray  # (I, 3) of area
    area: np.ndarray  # (I,)


def interface_resultants(d: Decomposition, f: np.ndarray) -> Resultants:
    """Those of all ranks' interfaces, from interface forces f (T, D)."""
    scene, space = d.scene, d.space
    count, steps, here = len(scene.interfaces), len(f), set(space.subdomains)
    centre, area = np.zeros((count, 3)), np.zeros(count)
    force, moment, weighted = np.zeros((3, steps, count, 3))
    pressed, size = np.zeros((2, steps, count))
    f = space.at_nodes(f)
    for k, i in enumerate(scene.interfaces):
        if i.subdomains[0] not in here or not len(i.nodes[0]):
            continue
        points = scene.side_points(i, 0)
        each = np.linalg.norm(area_vectors(points, i.triangles), axis=1)
        area[k] = each.sum()
        centre[k] = each @ points[i.triangles[:, :3]].mean(axis=1) / area[k] if area[k] else points.mean(axis=0)  # of nodes alone
        forces, arm = np.zeros((steps, len(points), 3)), points - centre[k]
        forces[:, traced(i, 0)] = f[:, space.sides[k][0]]
        push = np.einsum("tni,ni->tn", forces, node_normals(points, i.triangles) if i.normals is None else i.normals)
        force[:, k], moment[:, k] = forces.sum(axis=1), np.cross(arm, forces).sum(axis=1)
        pressed[:, k], size[:, k], weighted[:, k] = push.sum(axis=1), np.abs(push).sum(axis=1), push @ arm
    force, moment, weighted, pressed, size, centre, area = space.team.sum(force, moment, weighted, pressed, size, centre, area)
    known = (np.abs(pressed) > NO_CENTRE * size) & (area > 0)
    shift = weighted / np.where(known, pressed, np.nan)[:, :, None]
    return Resultants(force, moment, centre + shift, centre, area)


def bolt_forces(scene: Scene, interfaces: InterfaceFields) -> list[dict[str, object]]:
    """Per bolt its name, the interface at its cut, its axis, which leads from side 1 to side 2, and per load step

    - force, positive where it is pulled: that of side 2 on side 1 along the axis
    - shortening, a length: how much the cut's sides have gone into each other along the axis
    - state: what its law says it does
    """
    told, kinds = [], dict(zip(interfaces.kinds.tolist(), interfaces.kind_names.tolist()))
    for bolt in scene.bolts:
        for k, own in interfaces.each():
            if interfaces.names[k] == bolt.interface.name:
                area = interfaces.area[own]
                told.append({
                    "name": bolt.name, "interface": bolt.interface.name, "axis": bolt.axis.tolist(),
                    "force": (interfaces.resultant[:, k] @ bolt.axis).tolist(),
                    "shortening": (-(interfaces.gap[:, own] @ area) / area.sum()).tolist(),
                    "state": [kinds[int(next(iter(row[row != BONDED]), BONDED))] for row in interfaces.status[:, own]]})
    return told
