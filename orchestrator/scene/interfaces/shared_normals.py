"""Normals of contact surfaces that are split over several interfaces because the bodies are cut further.

At a node where pieces of one surface meet, each piece alone has another normal, and what may slide along one is
stopped by the other. So the normals come from the surface as it is between the whole bodies.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.faces import edge_patches
from orchestrator.scene.mesh.patch import node_normals
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.partition.numbering import SplitNumbering


def share_normals(mesh: Mesh, numbering: SplitNumbering, interfaces: list[Interface], bodies: list[str]) -> None:
    """Sets ``normals`` of all interfaces with a law between bodies of which one is cut further.

    Parameters
    ----------
    bodies : per subdomain, the name of its body; the pieces of a body follow one another
    """
    surfaces: dict[tuple[str, str], list[Interface]] = {}
    for i in interfaces:
        if not i.law.perfect and i.matching:
            surfaces.setdefault(tuple(bodies[e] for e in i.subdomains), []).append(i)
    for pieces in surfaces.values():
        if len(pieces) > 1:
            _share(mesh, numbering, pieces)


def _share(mesh: Mesh, numbering: SplitNumbering, pieces: list[Interface]) -> None:
    ends = np.cumsum([0] + [len(i.triangles) for i in pieces])
    triangles = np.concatenate([i.global_nodes[i.triangles] for i in pieces])
    patch = edge_patches(triangles)[1]
    # a node in which two patches only touch has a normal in each of them
    keys, local = np.unique(patch[:, None] * np.int64(len(mesh.nodes)) + triangles, return_inverse=True)
    points = np.empty((len(keys), 3))
    at = []
    for i, first in zip(pieces, ends[:-1]):
        at.append(np.searchsorted(keys, patch[first] * np.int64(len(mesh.nodes)) + i.global_nodes))
        one, two = (numbering.nodes[numbering.offsets[e] + own] for e, own in zip(i.subdomains, i.nodes))
        points[at[-1]] = 0.5 * (mesh.nodes[one] + mesh.nodes[two])
    normals = node_normals(points, local.reshape(triangles.shape))
    for i, own in zip(pieces, at):
        i.normals = normals[own]
