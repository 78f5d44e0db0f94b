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
import scipy.sparse as sp

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.ties import traced
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.patch import node_normals

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
    f = f if space.ties is None else times(sp.csr_array(space.ties.change.T), f)
    for i in scene.interfaces:
        if i.subdomains[0] not in here:
            continue
        points, k = scene.side_points(i, 0), i.index
        each = np.linalg.norm(area_vectors(points, i.triangles), axis=1)
        area[k] = each.sum()
        centre[k] = each @ points[i.triangles[:, :3]].mean(axis=1) / area[k]
        forces, arm = np.zeros((steps, len(points), 3)), points - centre[k]
        forces[:, traced(i, 0)] = f[:, space.sides[k][0]]
        force[:, k] = forces.sum(axis=1)
        turning = np.tensordot(arm, forces, axes=(0, 1))  # (3, T, 3), of which moments are the antisymmetric part
        moment[:, k] = (turning[[1, 2, 0], :, [2, 0, 1]] - turning[[2, 0, 1], :, [1, 2, 0]]).T
        push = np.einsum("tni,ni->tn", forces, node_normals(points, i.triangles) if i.normals is None else i.normals)
        pressed[:, k], size[:, k], weighted[:, k] = push.sum(axis=1), np.abs(push).sum(axis=1), push @ arm
    force, moment, weighted, pressed, size, centre, area = space.team.sum(force, moment, weighted, pressed, size, centre, area)
    known = np.abs(pressed) > NO_CENTRE * size
    shift = weighted / np.where(known, pressed, np.nan)[:, :, None]
    return Resultants(force, moment, centre + shift, centre, area)
