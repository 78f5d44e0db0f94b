"""Joints that are cut in triangles as what they meet is, so that nodes that coincide are paired.

A quadrilateral has two diagonals, a flat set of nodes many triangulations: none of them is the part's own. Where the nodes of
another body coincide with theirs, its edges decide; two parts of quadrilaterals then have the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.scene.foreign.joints import Joints
from orchestrator.scene.interfaces.pairing import COINCIDE
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.patch import local_size
from orchestrator.scene.mesh.mesh import Mesh

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

    Parameters
    ----------
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
