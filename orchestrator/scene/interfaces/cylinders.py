"""Normals of faces whose nodes lie on a circular cylinder: those of the cylinder, which stays straight along its axis.

Facets on a cylinder of radius R lean along its axis by some h/8R, each its own way, and so do their means around nodes. Sides that
slide along the axis would climb these leanings and wedge. Where all nodes lie on one cylinder, normals are its own.

The axis is sought as the direction that facets' normals have least of, the circle by linear least squares, and both are improved by
the Gauss–Newton method on the distances r = |x − c − ((x − c)·a) a| − R of the nodes.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors

FEWEST = 12  # nodes, of which a cylinder has five unknowns
STEPS = 8
ON = 1e-2  # of what facets are off the cylinder, how far nodes may be


def straightened(points: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals at nodes (n, 3): the cylinder's that the nodes lie on, if they do, else those given.

    triangles : (k, 3 or 6) int, the facets; what is not of their corners stays as it is
    normals : (n, 3) unit, of the facets around
    """
    corner = np.unique(triangles[:, :3])
    x, n = points[corner], normals[corner]
    if len(x) < FEWEST:
        return normals
    centre, size = x.mean(axis=0), float(np.sqrt(2 * np.linalg.norm(area_vectors(points, triangles), axis=1).mean()))
    found = _cylinder((x - centre) / size, n)
    if found is None:
        return normals
    axis, middle, radius = found
    arm = (x - centre) / size - middle
    arm -= (arm @ axis)[:, None] * axis
    length = np.linalg.norm(arm, axis=1)
    if np.abs(length - radius).max() > ON / (8 * radius):
        return normals
    result = normals.copy()
    result[corner] = arm / length[:, None] * np.sign(np.einsum("ni,ni->n", arm, n))[:, None]
    return result


def _cylinder(x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Axis, a point of it and radius of the cylinder nearest to nodes x (n, 3) with normals n; None where faces are plane, or no
    direction is free of normals."""
    share, directions = np.linalg.eigh(n.T @ n / len(n))
    axis = directions[:, 0]
    if share[1] < 1e-9 or share[0] > 0.1 * share[1]:
        return None
    plane = directions[:, 1:]
    at = x @ plane
    solution = np.linalg.lstsq(np.c_[2 * at, np.ones(len(at))], np.sum(at**2, axis=1), rcond=None)[0]
    square = solution[2] + solution[0] ** 2 + solution[1] ** 2
    if not square > 0:
        return None
    middle, radius = plane @ solution[:2], float(np.sqrt(square))
    for _ in range(STEPS):
        arm = x - middle
        along = arm @ axis
        arm -= along[:, None] * axis
        length = np.linalg.norm(arm, axis=1)
        if not (length > 0).all():
            return None
        out = arm / length[:, None] @ plane
        # what distances change by when the axis moves, and when it turns towards either direction of the plane
        slopes = np.c_[-out, -along[:, None] * out, -np.ones(len(x))]
        step = np.linalg.lstsq(slopes, radius - length, rcond=None)[0]
        middle, radius = middle + plane @ step[:2], radius + step[4]
        axis = axis + plane @ step[2:4]
        axis /= np.linalg.norm(axis)
        plane = np.linalg.svd(axis[None])[2][1:].T
    return axis, middle, float(radius)
