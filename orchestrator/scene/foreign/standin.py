"""The thin layer of tets behind the joints of a part whose mesh is not ours.

It stands for the part wherever geometry is asked for: faces that look at other parts, their normals, areas and sizes, the
thickness of soles. Nothing of it is ever assembled: the part's own stiffness acts on its joint nodes, and the layer's inner
nodes have none. Where supports inside hold the part, the inner nodes are held instead, so that rigid motions are counted
as they are.

Joints are cut in triangles as what they meet is, so that nodes that coincide are paired: a quadrilateral has two diagonals, a flat set of
nodes many triangulations, and none of them is the part's own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.foreign.joints import Joints, components_held
from orchestrator.scene.interfaces.pairing import COINCIDE
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import area_vectors, local_size
from orchestrator.scene.mesh.mesh import Mesh, StandIn
from orchestrator.scene.soles.facets import Facets
from orchestrator.scene.soles.prisms import prisms

PASSES = 50  # in each of them a triangle takes part in one exchange of diagonals


def outer_surfaces(mesh: Mesh) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points (n, 3) and outer triangles (k, 3) of each volume."""
    faces = faces_of(mesh.cells, len(mesh.nodes))
    beside = np.where(faces.neighbour < 0, -1, mesh.volume[faces.neighbour])
    outer = np.flatnonzero(mesh.volume[faces.owner] != beside)
    volume = mesh.volume[faces.owner[outer]]
    return [(mesh.nodes, faces.triangles[outer[volume == v]]) for v in range(len(mesh.volumes))]


def fitted(joints: Joints, others: list[tuple[np.ndarray, np.ndarray]]) -> Joints:
    """The same nodes, with diagonals that are edges of other bodies wherever they can be.

    others : points (n, 3) and triangles (k, 3) of the surface of each other body
    """
    triangles = joints.triangles.copy()
    if (joints.face >= 0).any():
        near = COINCIDE * local_size(joints.points, triangles)
        for points, surface in others:
            _fit(triangles, joints, _counterparts(joints.points, near, points, surface), surface, len(points))
    return replace(joints, triangles=triangles)


def _counterparts(own: np.ndarray, near: np.ndarray, points: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """(n,) int, the points of another body's surface that joint nodes coincide with; -1: none."""
    from scipy.spatial import cKDTree  # only such parts need it

    used = np.unique(surface)
    low, high = points[used].min(axis=0) - near.max(), points[used].max(axis=0) + near.max()
    if (own.min(axis=0) > high).any() or (own.max(axis=0) < low).any():
        return np.full(len(own), -1)
    distance, place = cKDTree(points[used]).query(own)
    return np.where(distance <= near, used[place], -1)


def _fit(triangles: np.ndarray, joints: Joints, other: np.ndarray, surface: np.ndarray, count: int) -> None:
    """Exchanges diagonals of triangles (k, 3), in place, that are none of the other's edges for those that are."""
    if (other >= 0).sum() < 4:
        return
    edges = np.unique(_keys(surface[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), count))
    for _ in range(PASSES):
        key = _keys(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), len(joints.points))
        order = np.argsort(key, kind="stable")
        twice = np.flatnonzero(key[order][1:] == key[order][:-1])
        one, two = order[twice], order[twice + 1]  # half-edges 3 triangle + side, shared by two triangles
        (s, i), (t, j) = (one // 3, one % 3), (two // 3, two % 3)
        a, b, c, d = triangles[s, i], triangles[s, (i + 1) % 3], triangles[s, (i + 2) % 3], triangles[t, (j + 2) % 3]
        mapped = other[np.column_stack([a, b, c, d])]
        wanted = (joints.face[s] >= 0) & (joints.face[s] == joints.face[t]) & (mapped >= 0).all(axis=1)
        wanted &= ~np.isin(_keys(mapped[:, :2], count), edges) & np.isin(_keys(mapped[:, 2:], count), edges)
        first, second = np.column_stack([c, a, d]), np.column_stack([d, b, c])
        before, after = area_vectors(joints.points, triangles[s]), [area_vectors(joints.points, x) for x in (first, second)]
        wanted &= (np.einsum("ij,ij->i", before, after[0]) > 0) & (np.einsum("ij,ij->i", before, after[1]) > 0)
        chosen = np.flatnonzero(wanted)
        _, place = np.unique(np.concatenate([s[chosen], t[chosen]]), return_index=True)
        free = np.bincount(place % max(len(chosen), 1), minlength=len(chosen)) == 2  # both triangles are first asked by this edge
        chosen = chosen[free]
        if not len(chosen):
            return
        triangles[s[chosen]], triangles[t[chosen]] = first[chosen], second[chosen]


def _keys(pairs: np.ndarray, count: int) -> np.ndarray:
    """One integer for each pair (k, 2), whatever their order."""
    return pairs.min(axis=1) * count + pairs.max(axis=1)


# Thickness over the size of the faces: thin beside the part, thick beside rounding.
THICKNESS = 0.25
# Along this direction, of no symmetry, the layer gets thinner to either side: inner nodes that lay on a plane could turn about
# axes in it when held along that plane, as the part cannot.
SLANTED = np.array([0.45, 0.6, 0.66])


def stand_in(joints: Joints, name: str, path: KeyPath) -> Mesh:
    """The mesh of the layer; the joints' nodes come first, in their order.

    name : of the part
    path : of its entry in the YAML
    Raises InputError: joint nodes on no face; supports that hold the part in a way that the layer cannot
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
