"""Loads on faces that lie on another part: planes and boxes take them along with the free faces that were meant."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry, Interface
from orchestrator.scene.partition.numbering import SplitNumbering


def loads_on_pairs(mesh: Mesh, boundary: list[BoundaryEntry], interfaces: list[Interface],
                   numbering: SplitNumbering) -> list[str]:
    """A sentence for each traction or pressure that acts on faces which an interface pairs with another part's.

    Parameters
    ----------
    interfaces : all there are; only sides with nodes of their own count, shared faces are no outer ones
    """
    loads = [entry for entry in boundary if entry.forces and len(entry.triangles)]
    if not loads:
        return []
    keys = [np.empty(0, np.int64)]
    for i in interfaces:
        if i.surfaces is not None:
            met = (np.unique(own) for own in (i.surfaces.segments.slave, i.surfaces.segments.master))
            sides = zip(i.surfaces.nodes, (t[own] for t, own in zip(i.surfaces.triangles, met)))
        else:
            nodes = [numbering.nodes[numbering.offsets[e] + own] for e, own in zip(i.subdomains, i.nodes)]
            sides = zip(nodes, 2 * [i.triangles]) if not np.array_equal(*nodes) else ()
        keys += [pack(nodes[triangles[:, :3]], len(mesh.nodes)) for nodes, triangles in sides]
    paired = np.concatenate(keys)
    result = []
    for entry in loads if len(paired) else []:
        hit = np.isin(pack(entry.triangles[:, :3], len(mesh.nodes)), paired)
        if hit.any():
            names = sorted({mesh.volumes[v] for v in mesh.volume[entry.cells[hit, 0]]})
            result.append(f"boundary[{entry.index}], a {entry.kind}, acts on {hit.sum()} faces of {', '.join(names)} that lie on another "
                          "part: name a surface of the part, as part/surface, or a smaller box, if that is not meant")
    return result
