"""Flat joints of which only nodes are known: triangles between them, as long as no void can be among them."""

from __future__ import annotations

import numpy as np

from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quality import format_point

# Nodes this near one plane, in units of the joint's extent, are on it; normals likewise.
PLANE = 1e-6
# Triangles between nodes on a plane that are thinner than this share of their longest edge squared lie along its border.
THIN = 1e-6
# Between nodes that are spread evenly triangles are at most this much larger than the smallest at their corners: twice on
# grids without the nodes in the middle of squares, three times on irregular ones. Above the second there is a void.
UNEVEN, VOID = 1.6, 3.5


def of_plane(points: np.ndarray, outward: np.ndarray, path: KeyPath, name: str) -> tuple[list[np.ndarray], list[str]]:
    """A table of triangles (k, 3) between the nodes of a flat joint, outward, and what is to be said of them.

    Raises
    ------
    InputError : nodes off the plane; triangles across what may be a void
    """
    normal = outward / (np.linalg.norm(outward) or 1.0)
    off = np.abs((points - points.mean(axis=0)) @ normal).max()
    if not np.linalg.norm(outward) or off > PLANE * size_of(points):
        raise InputError(Problem(path, f"nodes of '{name}' that are up to {off:.3g} off a plane across {outward.tolist()}",
                                 "three nodes or more on one plane", "give the normal of the joint's plane, or facets: a file with "
                                 "the joint's faces"))
    triangles, area, beside = between_nodes(points, normal)
    if not len(triangles):
        raise InputError(Problem(path, f"{len(points)} nodes of '{name}', all on one line", "three nodes or more on a plane, not on a line",
                                 "add the joint's other nodes"))
    where = points[triangles[beside.argmax()]].mean(axis=0)
    made = f"{area.sum():.4g} of area between the {len(points)} nodes of '{name}'"
    if beside.max() > VOID:
        raise InputError(Problem(path, f"{made}, with a face {beside.max():.2g} times as large as those beside it, at {format_point(where)}: "
                                 "there may be a void", "nodes spread evenly over a joint that fills its convex hull",
                                 "give facets: a file with the joint's faces"))
    large = area[beside > UNEVEN].sum()
    return [triangles], [f"{made} are its joint, up to their convex hull" + (
        f", {large:.4g} of it in faces more than {UNEVEN:g} times as large as those beside them, the largest at {format_point(where)}"
        if large else "") + "; if there is a void, give facets"]


def between_nodes(points: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (k, 3) between points (n, 3) of a plane, turning about its normal, up to their convex hull; their areas (k,),
    and how many times as large they are as the smallest at their corners, in the mean; none between points on a line."""
    from scipy.spatial import Delaunay  # for joints without faces alone

    flat = points @ np.linalg.svd(normal[None])[2][1:].T
    if len(points) < 3 or np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)[1] <= PLANE * size_of(points):
        return np.empty((0, 3), int), np.empty(0), np.empty(0)
    triangles = Delaunay(flat).simplices.astype(int)
    signed = area_vectors(points, triangles) @ normal
    longest = np.max([np.sum((points[triangles[:, i]] - points[triangles[:, i - 1]]) ** 2, axis=1) for i in range(3)], axis=0)
    there = np.abs(signed) > THIN * longest  # slivers along straight edges are rounding
    triangles[signed < 0] = triangles[signed < 0][:, ::-1]
    triangles, area = triangles[there], np.abs(signed[there])
    least = np.full(len(points), np.inf)
    np.minimum.at(least, triangles, area[:, None])
    return triangles, area, area / np.median(least[triangles], axis=1)
