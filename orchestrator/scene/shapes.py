"""What shape a surface has: plane, cylinder or sphere, from the nodes of its triangles, which lie on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors

# Facets whose normals differ by less than this from their mean make a plane surface.
PLANE = 1e-6
# Nodes lie on a cylinder or a sphere within this share of its radius: files have that many digits, and nodes in the middle of
# nothing curved are farther off.
ROUND = 1e-4
# Surfaces that bend less than this over their extent are not told from others by their radius.
FLATTEST = 50.0
ROUNDS = 30  # of Gauss and Newton, that find a cylinder from a direction a tenth of a radian off in five


@dataclass(frozen=True)
class Shape:
    """``kind``: plane, cylinder, sphere or curved; the plane's normal or the cylinder's axis (3,); its radius."""

    kind: str
    direction: np.ndarray | None = None
    radius: float | None = None


def shape_of(nodes: np.ndarray, triangles: np.ndarray) -> Shape:
    """The shape of triangles (k, 3 or 6), corners first, that have an area."""
    vectors = area_vectors(nodes, triangles)
    each = np.linalg.norm(vectors, axis=1)
    mean = vectors.sum(axis=0) / each.sum()
    normals = vectors / each[:, None]
    if np.abs(normals - mean).max() < PLANE:
        return Shape("plane", mean)
    points = nodes[np.unique(triangles[:, :3])]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) < 6:
        return Shape("curved")
    centre, radius = _sphere(points)
    if _fits(np.linalg.norm(points - centre, axis=1), radius, size) and len(points) > 6:
        return Shape("sphere", None, radius)
    # facets of a cylinder look across its axis, but for what their size makes of it
    axis = np.linalg.eigh((normals * each[:, None]).T @ normals)[1][:, 0]
    found = _cylinder(points, axis)
    if found is not None:
        axis, radius, off = found
        if _fits(off, radius, size):
            return Shape("cylinder", axis * np.sign(axis[np.abs(axis).argmax()]), radius)
    return Shape("curved")


def _fits(distance: np.ndarray, radius: float, size: float) -> bool:
    return 0 < radius < FLATTEST * size and bool(np.abs(distance - radius).max() <= ROUND * radius)


def _sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius by |x|² = 2 c·x + r² − c²."""
    shift = points.mean(axis=0)
    x = points - shift
    found = np.linalg.lstsq(np.column_stack([2 * x, np.ones(len(x))]), (x**2).sum(axis=1), rcond=None)[0]
    return shift + found[:3], float(np.sqrt(max(found[3] + found[:3] @ found[:3], 0.0)))


def _cylinder(points: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, float, np.ndarray] | None:
    """Axis, radius and distances from the axis (n,) of the cylinder that fits best, near a direction; None: there is none."""
    x = points - points.mean(axis=0)
    across = np.linalg.svd(axis[None])[2][1:]  # (2, 3) orthonormal, across the axis
    flat = x @ across.T
    found = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(x))]), (flat**2).sum(axis=1), rcond=None)[0]
    centre, radius = found[:2] @ across, float(np.sqrt(max(found[2] + found[:2] @ found[:2], 0.0)))
    for _ in range(ROUNDS):
        arm = x - centre
        along = arm @ axis
        out = arm - along[:, None] * axis
        distance = np.linalg.norm(out, axis=1)
        if not np.isfinite(distance).all() or distance.min() == 0:
            return None
        across = np.linalg.svd(axis[None])[2][1:]
        unit = (out / distance[:, None]) @ across.T
        # derivatives of the distance by the axis' tilt and the centre's shift across it, and by the radius
        slopes = np.column_stack([-along[:, None] * unit, -unit, -np.ones(len(x))])
        change = np.linalg.lstsq(slopes, radius - distance, rcond=None)[0]
        axis = axis + change[:2] @ across
        axis /= np.linalg.norm(axis)
        centre, radius = centre + change[2:4] @ across, radius + float(change[4])
        if np.abs(change[:2]).max() < 1e-12 and np.abs(change[2:]).max() < 1e-12 * max(radius, 1e-300):
            break
    arm = x - centre
    return axis, radius, np.linalg.norm(arm - (arm @ axis)[:, None] * axis, axis=1)
