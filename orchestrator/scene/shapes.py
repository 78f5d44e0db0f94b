"""Shapes of surfaces: plane, cylinder or sphere, from the nodes of its triangles, which lie on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.scene.mesh.geometry import facet_normals
from orchestrator.scene.revolved import cylinder, through

# Facets whose normals differ by less than this from their mean make a plane surface.
PLANE = 1e-6
# Nodes lie on a cylinder or a sphere within this share of its radius: files have that many digits, and nodes in the middle of
# nothing curved are farther off.
ROUND = 1e-4
# Surfaces that bend less than this over their extent are not told from others by their radius.
FLATTEST = 50.0


@dataclass(frozen=True)
class Shape:
    """``kind``: plane, cylinder, sphere or curved; the plane's normal or the cylinder's axis (3,); its radius; a point (3,) of the
    plane or the axis, or the sphere's centre; (k, 3, 3) unit normals at the corners of its triangles, whichever way they look, where a CAD
    model knows them, nan where it does not."""

    kind: str
    direction: np.ndarray | None = None
    radius: float | None = None
    through: np.ndarray | None = None
    normals: np.ndarray | None = None

    def of(self, triangles: slice) -> Shape:
        """The shape with the normals of some of its triangles."""
        return self if self.normals is None else replace(self, normals=self.normals[triangles])

    def placed(self, place: Callable[[np.ndarray], np.ndarray]) -> Shape:
        """The shape moved by a similarity, points (n, 3) → (n, 3)."""
        through = np.zeros(3) if self.through is None else self.through
        origin, ahead = place(through + np.array([np.zeros(3), [1.0, 0.0, 0.0]]))
        size = float(np.linalg.norm(ahead - origin))

        def turned(vectors: np.ndarray | None) -> np.ndarray | None:
            return None if vectors is None else ((place(through + vectors.reshape(-1, 3)) - origin) / size).reshape(vectors.shape)

        return Shape(self.kind, turned(self.direction), None if self.radius is None else size * self.radius,
                     None if self.through is None else origin, turned(self.normals))


def shape_of(nodes: np.ndarray, triangles: np.ndarray) -> Shape:
    """The shape of triangles (k, 3 or 6), corners first, that have an area."""
    normals, each = facet_normals(nodes, triangles)
    mean = each @ normals / each.sum()
    if np.abs(normals - mean).max() < PLANE:
        return Shape("plane", mean, None, nodes[triangles[0, 0]])
    points = nodes[np.unique(triangles[:, :3])]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) < 6:
        return Shape("curved")
    middles, found = nodes[triangles[:, :3]].mean(axis=1), []
    shift = points.mean(axis=0)
    centre, radius = through(points - shift)
    centre += shift
    if _fits(np.linalg.norm(points - centre, axis=1) - radius, radius, size) and len(points) > 6:
        found.append((_off(middles - centre, normals), Shape("sphere", None, radius, centre)))
    # facets of a cylinder look across its axis, but for what their size makes of it
    best = cylinder(points, np.linalg.eigh((normals * each[:, None]).T @ normals)[1][:, 0])
    axis, radius = best.axis, float(best.numbers[0])
    if _fits(best.at(points)[0], radius, size):
        arm = middles - best.centre
        found.append((_off(arm - np.outer(arm @ axis, axis), normals),
                      Shape("cylinder", axis * np.sign(axis[np.abs(axis).argmax()]), radius, best.centre)))
    # the nodes of two rings are on a cylinder and on a sphere: the facets between them tell which
    return min(found, key=lambda each: each[0])[1] if found else Shape("curved")


def _off(arms: np.ndarray, normals: np.ndarray) -> float:
    """Mean deviation of facets' normals (k, 3) from the directions of arms (k, 3), or their opposites."""
    return float(np.linalg.norm(np.cross(arms, normals), axis=1).sum() / np.linalg.norm(arms, axis=1).sum())


def _fits(distance: np.ndarray, radius: float, size: float) -> bool:
    """Whether points at distances (n,) from a round surface lie on it, and it is no flatter than can be told."""
    return 0 < radius < FLATTEST * size and bool(np.abs(distance).max() <= ROUND * radius)
