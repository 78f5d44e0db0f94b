"""What varies linearly over a surface: v(x) = value + slope (x − about), displacement, traction, or pressure in its first row.

A force F and a moment M about a point p become the traction t = F / A + ω × (x − c), c the centre of the area A, with
ω from J ω = M + (p − c) × F and J = ∫ |r|² I − r rᵀ, r = x − c: the one whose resultant and moment they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.config.boundary import BoundaryCondition
from orchestrator.config.turning import unit
from orchestrator.scene.mesh.geometry import area_vectors, skew
from orchestrator.scene.mesh.quadratic import TRIANGLE_MOMENTS
from orchestrator.scene.model import BoundaryEntry

KINDS = ("displacement", "symmetry", "motion", "traction", "pressure", "resultant", "foundation", "coupling")
STRAIGHT = 1e-6  # how far a plane's normal may be from its axis: coordinates in files have that many digits


def field_of(entry: BoundaryCondition, factors: list[float], nodes: np.ndarray,
             triangles: np.ndarray) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """The field of an entry that has no vector.

    Parameters
    ----------
    factors : per load step
    nodes : (n, 3); triangles : (k, 3 or 6), the entry's faces

    Returns
    -------
    kind : "displacement", "traction" or "pressure"
    value (steps, 3), slope (steps, 3, 3), about (3,)
    """
    times = np.asarray(factors, dtype=float)
    if entry.motion is not None:
        turn = entry.motion.rotate
        angle = np.zeros(3) if turn is None else np.radians(turn.degrees) * np.array(unit(turn.axis))
        return ("displacement", np.outer(times, entry.motion.translate), times[:, None, None] * skew(angle),
                np.array(turn.about if turn else np.zeros(3), dtype=float))
    if entry.resultant is not None:
        value, slope, about = spread(entry.resultant, nodes, triangles)
        return "traction", np.outer(times, value), times[:, None, None] * slope, about
    slope = np.zeros((3, 3))
    slope[0] = entry.pressure.gradient
    return ("pressure", np.outer(times, [entry.pressure.value, 0.0, 0.0]), times[:, None, None] * slope,
            np.array(entry.pressure.at, dtype=float))


def spread(resultant: Any, nodes: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value (3,), slope (3, 3) and centre (3,) of the traction with a ``resultant``; zeros where there is no face."""
    if not len(triangles):
        return np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    area = np.linalg.norm(area_vectors(nodes, triangles), axis=1)
    corners = nodes[triangles[:, :3]]
    centre = area @ corners.mean(axis=1) / area.sum()
    r = corners - centre
    second = np.einsum("k,ab,kax,kby->xy", area, TRIANGLE_MOMENTS[3], r, r)
    inertia = np.trace(second) * np.eye(3) - second
    force = np.array(resultant.force, dtype=float)
    point = centre if resultant.about is None else np.array(resultant.about, dtype=float)
    moment = np.array(resultant.moment, dtype=float) + np.cross(point - centre, force)
    return force / area.sum(), skew(np.linalg.solve(inertia, moment)), centre


def normal_of(nodes: np.ndarray, triangles: np.ndarray) -> int | None:
    """The axis, 0, 1 or 2, that all faces are across; None where there is no such axis."""
    vectors = np.abs(area_vectors(nodes, triangles))
    axis = int(vectors.sum(axis=0).argmax())
    return axis if (np.delete(vectors, axis, axis=1) <= STRAIGHT * vectors[:, axis, None]).all() else None


def at_corners(entry: BoundaryEntry, nodes: np.ndarray) -> np.ndarray:
    """(steps, k, 3, 3) what an entry that varies is at the three corners of its faces: step, face, corner, component."""
    corners = nodes[entry.triangles[:, :3]]
    if entry.frame is not None:
        return np.einsum("ti,kaij->tkaj", entry.values, entry.frame.directions(corners))
    return entry.values[:, None, None, :] + np.einsum("tij,kaj->tkai", entry.slope, corners - entry.about)


def nodal(entry: BoundaryEntry, nodes: np.ndarray) -> np.ndarray:
    """(steps, k, 3 or 6, 3) consistent forces of a traction or pressure with a slope on the nodes of its faces."""
    vectors = area_vectors(nodes, entry.triangles)
    corner = at_corners(entry, nodes)
    if entry.kind == "pressure":
        density = -corner[..., :1] * vectors[None, :, None, :]
    else:
        density = corner * np.linalg.norm(vectors, axis=1)[None, :, None, None]
    return np.einsum("ab,tkbi->tkai", TRIANGLE_MOMENTS[entry.triangles.shape[1]], density)


def wrench(entry: BoundaryEntry, nodes: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(steps, 6) the force of a traction or pressure on all of its faces, and its moment about a point (3,)."""
    area, corners = area_vectors(nodes, entry.triangles), nodes[entry.triangles[:, :3]] - about
    if entry.varies:
        forces, arm = nodal(entry, nodes), nodes[entry.triangles] - about
        return np.concatenate([forces.sum(axis=(1, 2)), np.cross(arm, forces).sum(axis=(1, 2))], axis=1)
    arm = corners.mean(axis=1)
    if entry.kind == "pressure":
        return -entry.values[:, :1] * np.concatenate([area.sum(axis=0), np.cross(arm, area).sum(axis=0)])
    size = np.linalg.norm(area, axis=1)
    return np.concatenate([entry.values * size.sum(), np.cross(size @ arm, entry.values)], axis=1)
