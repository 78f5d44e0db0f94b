"""The thin layer of tets behind the joints of a part whose mesh is not ours.

It stands for the part wherever geometry is asked for: faces that look at other parts, their normals, areas and sizes, the
thickness of soles. Nothing of it is ever assembled: the part's own stiffness acts on its joint nodes, and the layer's inner
nodes have none. Where supports inside hold the part, the inner nodes are held instead, so that rigid motions are counted
as they are.
"""

from __future__ import annotations

import numpy as np

from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.foreign.joints import Joints, components_held
from orchestrator.scene.mesh.patch import local_size
from orchestrator.scene.mesh.mesh import Mesh, StandIn
from orchestrator.scene.soles.facets import Facets
from orchestrator.scene.soles.prisms import prisms

# Thickness over the size of the faces: thin beside the part, thick beside rounding.
THICKNESS = 0.25
# Along this direction, of no symmetry, the layer gets thinner to either side: inner nodes that lay on a plane could turn about
# axes in it when held along that plane, as the part cannot.
SLANTED = np.array([0.45, 0.6, 0.66])


def stand_in(joints: Joints, name: str, path: KeyPath) -> Mesh:
    """The mesh of the layer; the joints' nodes come first, in their order.

    Parameters
    ----------
    name : of the part
    path : of its entry in the YAML

    Raises
    ------
    InputError : joint nodes on no face; supports that hold the part in a way that the layer cannot
    """
    used = np.zeros(len(joints.points), dtype=bool)
    used[joints.triangles] = True
    if not used.all():
        lost = joints.ids[~used]
        raise InputError(Problem(path, f"{len(lost)} joint nodes of '{name}' are on no face of its joints, the first is {lost[0]}",
                                 "nodes between which faces of elements lie: of each face all nodes, those in the middle of "
                                 "edges too", "leave these nodes out of the joint, or put the rest of their face in it"))
    count = len(joints.triangles)
    thinner = 1 - 0.5 * ((joints.points - joints.centre) @ SLANTED / joints.size) ** 2
    facets = Facets(joints.points, joints.triangles, np.ones(count), np.zeros(count),
                    THICKNESS * thinner * local_size(joints.points, joints.triangles))
    layer = prisms(facets, -1)
    nodes = np.vstack([joints.points, layer.points])
    components = components_held(joints, layer.points)
    if components is None:
        raise InputError(Problem(path, f"supports inside '{name}' that leave some of its rigid motions, along no axis of the mesh",
                                 "supports that hold all of the part, some of its components x, y, z, or nothing",
                                 "write held: true if they hold all of it (nodes of *RIGID BODY count as points here); else turn the "
                                 "model so that what is free is along an axis, or hold the part outside, under boundary"))
    held = np.zeros(nodes.shape, dtype=bool)
    held[: len(joints.points)] = joints.held
    held[len(joints.points):] = components
    surfaces = {joint: joints.triangles[joints.joint == i] for i, joint in enumerate(joints.names)}
    return Mesh(nodes, layer.cells, np.zeros(len(layer.cells), dtype=int), [name],
                {f"{name}/{joint}": triangles for joint, triangles in surfaces.items()}, f"{name} (joints)", joints.remarks,
                foreign=[StandIn(0, 0, len(joints.points), held, joints.triangles, joints.size, joints.quadratic,
                                 None if joints.young is None else (joints.young, joints.poisson))])

