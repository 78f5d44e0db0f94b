"""The faces of parts that a rigid tool may touch: those that look at it within reach of it at some load step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.errors import KeyPath, Problems
from orchestrator.scene.interfaces.opposite import COINCIDE, REACH, TOUCHING, cosine_of
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import barycentric, facet_normals, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.tools.motion import Rigid


class Facing(NamedTuple):
    """Normals (k, 3) of facets, and how far off (k,) a tool may be that they are paired with."""

    normal: np.ndarray
    room: np.ndarray


def touched_faces(mesh: Mesh, faces: Faces, cells: np.ndarray, tool: Rigid, entry: Entry, path: KeyPath,
                  problems: Problems) -> np.ndarray:
    """(k,) int, the outer faces of some cells (m,) bool that a tool may touch; adds a problem where there are none, or where the tool begins
    inside.

    entry : of ``interfaces``, which says how far off faces may be, and how far turned away
    """
    outer = faces.outer[cells[faces.owner[faces.outer]]]
    if not len(outer):  # of a piece of a mesh
        return outer
    triangles = faces.triangles[outer]
    nodes, local = np.unique(triangles, return_inverse=True)
    local, points = local.reshape(triangles.shape), mesh.nodes[nodes]
    facet, area = facet_normals(mesh.nodes, triangles)
    size = np.sqrt(2 * area)
    if _inside(points, local, size, tool, path, problems):
        return outer[:0]
    chosen, near = _within_reach(points, local, Facing(facet, entry.reach or REACH * size), tool, entry)
    if not chosen.any() and mesh.within is None:  # others may have faces that it touches
        _nothing(mesh, cells, tool, near, path, problems)
    return outer[chosen]


def may_touch(mesh: Mesh, triangles: np.ndarray, tool: Rigid, entry: Entry) -> np.ndarray:
    """(k,) bool, triangles (k, 3) that a tool may touch, and, where nodes in the middle of edges are to come, those that it may touch then."""
    facet, area = facet_normals(mesh.nodes, triangles)
    corners = mesh.nodes[triangles]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    room = (entry.reach or REACH * np.sqrt(2 * area)) + edge
    return _within_reach(corners.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), Facing(facet, room), tool, entry)[0]


def _within_reach(points: np.ndarray, local: np.ndarray, facing: Facing, tool: Rigid, entry: Entry) -> tuple[np.ndarray, float]:
    """(k,) bool, facets (k, 3 or 6) of points (n, 3) that look at a tool, within their room, at some load step; and how near any comes that
    looks at it."""
    cosine = cosine_of(entry.angle)
    chosen, near = np.zeros(len(local), dtype=bool), np.inf
    for move in np.unique(tool.driven.moves, axis=0):
        distance, normal = tool.at(move, points)
        looks = np.einsum("kc,kc->k", facing.normal, normal[local[:, :3]].mean(axis=1)) < cosine
        apart = distance[local].min(axis=1)
        chosen |= looks & (apart <= facing.room)
        near = min(near, float(apart[looks].min(initial=np.inf)))
    return chosen, near


def _inside(points: np.ndarray, local: np.ndarray, size: np.ndarray, tool: Rigid, path: KeyPath, problems: Problems) -> bool:
    """Adds a problem where the tool begins inside: at nodes (n, 3) that surfaces go through, or amid facets (k, 3 or 6), whose chords
    may lie aside of these."""
    at_nodes, amid = (tool.at(np.zeros(6), x)[0] for x in (points, points[local[:, :3]].mean(axis=1)))
    apart = np.concatenate([at_nodes[local].min(axis=1) + COINCIDE * size, amid + TOUCHING * size])
    worst = int(apart.argmin())
    if apart[worst] >= 0:
        return False
    k = worst % len(local)
    depth, corner = (-at_nodes[local[k]].min(), local[k][at_nodes[local[k]].argmin()]) if worst < len(local) else (-amid[k], local[k][0])
    problems.add((*path, "between", 1), f"{tool.name} begins {depth:.3g} inside the part, at {format_point(points[corner])}",
                 "a tool that touches the part at most before it moves", "move it back, and press it by its displacement or force")
    return True


def _nothing(mesh: Mesh, cells: np.ndarray, tool: Rigid, near: float, path: KeyPath, problems: Problems) -> None:
    """No face: the tool is elsewhere, turned the other way, or inside altogether."""
    corners = mesh.nodes[mesh.cells[cells, :4]]
    if (barycentric(corners, tool.surface.middle) > 0).all(axis=1).any():
        found, cure = "begins inside the part altogether", "move it out, and press it by its displacement or force"
    elif np.isfinite(near):
        found = f"comes no nearer than {near:.3g} to any face that looks at it"
        cure = f"move it nearer, or write within: {1.5 * near:.2g}"
    else:
        found, cure = "is looked at by no face", "turn its normal round; hollow: true where the part is inside it"
    problems.add((*path, "between", 1), f"{tool.name} {found}", "faces of the part that look at the tool, two elements from it at most",
                 cure)


def pulled_away(points: np.ndarray, tool: Rigid) -> bool:
    """Whether at some load step a force, with no moment, leads away from all nodes (n, 3)."""
    force, turning = tool.driven.loads[:, :3], np.delete(tool.driven.prescribed, range(3))
    if not force.any() or not turning.all():
        return False
    return bool((tool.gaps(points)[1] @ force.T >= 0).all(axis=0)[force.any(axis=1)].any())
