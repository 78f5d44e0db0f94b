"""What interfaces carry as a whole: force, moment, centre of pressure, bonded interfaces too.

With f the nodal forces of side 2 on side 1, x the nodes of side 1, n their normals and c the interface's centre of area,

    F = Σ f,    M = Σ (x − c) × f,    x_p = Σ (n·f) x / Σ n·f

The last is where the normal forces act as a whole: nowhere where they add up to nothing beside themselves. On a plane
interface it is where F has the same moment about axes in the plane. Forces of components that are prescribed are the
supports', not the interface's.

Of a bolt, the same for the interface at its cut: what it carries, how much it has been shortened, load step by load step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.status import BONDED
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.interface.ties import traced
from orchestrator.scene.mesh.geometry import area_vectors, node_normals
from orchestrator.scene.model import Interface, Scene

# Normal forces whose sum is this small beside their magnitudes have no centre: iterations leave as much.
NO_CENTRE = 1e-6


@dataclass(frozen=True)
class Resultants:
    """Of all interfaces of the scene, T load steps, I interfaces.

    Parameters
    ----------
    force, moment : (T, I, 3) of side 2 on side 1, the moment about ``centre``
    pressure_centre : (T, I, 3), nan where there is none
    centre : (I, 3) of area; area : (I,)
    """

    force: np.ndarray
    moment: np.ndarray
    pressure_centre: np.ndarray
    centre: np.ndarray
    area: np.ndarray


def interface_resultants(d: Decomposition, f: np.ndarray) -> Resultants:
    """Those of all ranks' interfaces.

    Parameters
    ----------
    f : (T, D) interface forces
    """
    scene, space = d.scene, d.space
    count, steps, here = len(scene.interfaces), len(f), set(space.subdomains)
    centre, area = np.zeros((count, 3)), np.zeros(count)
    force, moment, weighted = np.zeros((3, steps, count, 3))
    pressed, size = np.zeros((2, steps, count))
    f = space.at_nodes(f)
    alike: dict[int, list[Interface]] = {}  # all with as many nodes to a facet at once
    for i in scene.interfaces:
        if i.subdomains[0] in here and len(i.nodes[0]):
            alike.setdefault(i.triangles.shape[1], []).append(i)
    for chosen in alike.values():
        k, clouds = [i.index for i in chosen], [scene.side_points(i, 0) for i in chosen]
        counts = np.array([len(cloud) for cloud in clouds])
        starts, of, points = np.cumsum(counts) - counts, np.repeat(np.arange(len(k)), counts), np.concatenate(clouds)
        triangles = np.concatenate([i.triangles + start for i, start in zip(chosen, starts)])
        facet_of = np.repeat(np.arange(len(k)), [len(i.triangles) for i in chosen])
        each = np.linalg.norm(area_vectors(points, triangles), axis=1)
        area[k] = np.bincount(facet_of, weights=each, minlength=len(k))
        middle = each[:, None] * points[triangles[:, :3]].mean(axis=1)
        centre[k] = np.stack([np.bincount(facet_of, weights=x, minlength=len(k)) for x in middle.T], axis=1)
        bare = area[k] == 0  # of nodes alone
        centre[k] = np.where(bare[:, None], np.add.reduceat(points, starts, axis=0) / counts[:, None],
                             centre[k] / np.where(bare, 1.0, area[k])[:, None])
        forces, arm = np.zeros((steps, len(points), 3)), points - centre[k][of]
        forces[:, np.concatenate([traced(i, 0) for i in chosen])] = f[:, np.concatenate([space.sides[n][0] for n in k])]
        normals = node_normals(points, triangles)
        given = [n for n, i in enumerate(chosen) if i.normals is not None]
        for n in given:
            normals[starts[n] : starts[n] + counts[n]] = chosen[n].normals
        push = np.einsum("tni,ni->tn", forces, normals)
        force[:, k] = np.add.reduceat(forces, starts, axis=1)
        moment[:, k] = np.add.reduceat(np.cross(arm, forces), starts, axis=1)
        pressed[:, k], size[:, k] = np.add.reduceat(push, starts, axis=1), np.add.reduceat(np.abs(push), starts, axis=1)
        weighted[:, k] = np.add.reduceat(push[:, :, None] * arm, starts, axis=1)
    force, moment, weighted, pressed, size, centre, area = space.team.sum(force, moment, weighted, pressed, size, centre, area)
    known = (np.abs(pressed) > NO_CENTRE * size) & (area > 0)
    shift = weighted / np.where(known, pressed, np.nan)[:, :, None]
    return Resultants(force, moment, centre + shift, centre, area)


def bolt_forces(scene: Scene, interfaces: InterfaceFields) -> list[dict[str, object]]:
    """Per bolt its name, the interface at its cut, its axis, and per load step

    - force, positive where it is pulled: that of side 2 on side 1 along the axis, which leads from side 1 to side 2
    - shortening, a length: how much the cut's sides have gone into each other along the axis
    - state: what its law says it does
    """
    told, kinds = [], dict(zip(interfaces.kinds.tolist(), interfaces.kind_names.tolist()))
    for bolt in scene.bolts:
        at = np.flatnonzero(interfaces.names == bolt.interface.name)
        if not len(at):
            continue
        own = slice(*interfaces.offsets[[at[0], at[0] + 1]])
        area, status = interfaces.area[own], interfaces.status[:, own]
        shortening = -(interfaces.gap[:, own] @ area) / area.sum()
        states = [kinds[int(next(iter(row[row != BONDED]), BONDED))] for row in status]
        told.append({"name": bolt.name, "interface": bolt.interface.name, "axis": bolt.axis.tolist(),
                     "force": (interfaces.resultant[:, at[0]] @ bolt.axis).tolist(), "shortening": shortening.tolist(),
                     "state": states})
    return told
