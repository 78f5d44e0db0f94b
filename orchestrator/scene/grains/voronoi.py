"""Voronoi cells of random seeds, cut exactly at the sides of a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Voronoi, cKDTree

from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import cross

# Sides of the box in the order of their numbers; as second cell of a face, side s is written -1 - s.
SIDES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")
# Vertices closer than this share of the box are one: on the sides, seeds and mirror copies are cospherical.
SAME = 1e-9


@dataclass
class Tessellation:
    """Polyhedral cells that fill a box from the origin and share vertices and faces.

    size : (3,) lengths of the box
    vertices : (v, 3) coordinates
    sides : (v, 6) bool, the sides of the box each vertex lies on
    loops : per face its vertices in order, seen counter-clockwise from outside of its first cell
    cells : (f, 2) int, the two cells of each face; the second is -1 - s on side s of the box
    """

    size: np.ndarray
    vertices: np.ndarray
    sides: np.ndarray
    loops: list[list[int]]
    cells: np.ndarray


def scattered(grains: int, size: np.ndarray, seed: int, lloyd: int) -> Tessellation:
    """The cells of uniformly random points, moved ``lloyd`` times to the centroids of their cells.

    size : (3,) lengths of the box
    """
    points = np.random.default_rng(seed).random((grains, 3)) * size
    for _ in range(lloyd):
        points = centroids(tessellated(points, size))
    return tessellated(points, size)


def tessellated(points: np.ndarray, size: np.ndarray) -> Tessellation:
    """The Voronoi cells of points (n, 3) inside the box of lengths ``size`` (3,).

    Mirror copies of the points behind the six sides make the sides faces of the diagram.
    """
    n, copies = len(points), [points]
    for axis in range(3):
        for plane in (0.0, size[axis]):
            copy = points.copy()
            copy[:, axis] = 2 * plane - copy[:, axis]
            copies.append(copy)
    diagram = Voronoi(np.concatenate(copies))
    vertices, sides, merged = _snapped(diagram.vertices, size)
    loops, cells = [], []
    for (p, q), ridge in zip(diagram.ridge_points, diagram.ridge_vertices):
        one, other = min(p, q), max(p, q)
        side, original = divmod(other - n, n)
        # A cell and the copy of another one meet in a line at most.
        if one >= n or -1 in ridge or (other >= n and original != one):
            continue
        loop = without_repeats([int(merged[v]) for v in ridge])
        if len(loop) < 3:
            continue
        outward = diagram.points[other] - diagram.points[one]
        loops.append(loop if area_vector(vertices[loop]) @ outward > 0 else loop[::-1])
        cells.append((one, other if other < n else -1 - side))
    return Tessellation(size, vertices, sides, loops, np.array(cells))


def _snapped(vertices: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices inside the box, exactly on its sides where they belong there; (v, 6) those sides; old → new index."""
    vertices = vertices.copy()
    near = SAME * size.max()
    for axis in range(3):
        for plane in (0.0, size[axis]):
            vertices[np.abs(vertices[:, axis] - plane) < near, axis] = plane
    inside = np.flatnonzero(np.all((vertices >= 0) & (vertices <= size), axis=1))
    pairs = cKDTree(vertices[inside]).query_pairs(near, output_type="ndarray")
    count, label = components(pairs[:, 0], pairs[:, 1], len(inside))
    first = inside[np.unique(label, return_index=True)[1]]
    merged = np.full(len(vertices), -1)
    merged[inside] = label
    kept = vertices[first]
    sides = np.stack([kept[:, axis] == plane for axis in range(3) for plane in (0.0, size[axis])], axis=1)
    return kept, sides, merged


def centroids(cells: Tessellation) -> np.ndarray:
    """(n, 3) centres of mass of convex cells."""
    fans, owners = [], []
    for loop, (one, other) in zip(cells.loops, cells.cells):
        fan = [(loop[0], loop[k], loop[k + 1]) for k in range(1, len(loop) - 1)]
        fans += fan
        owners += [one] * len(fan)
        if other >= 0:
            fans += [triangle[::-1] for triangle in fan]
            owners += [other] * len(fan)
    count, owners = int(cells.cells.max()) + 1, np.array(owners)
    p, q, r = np.moveaxis(cells.vertices[np.array(fans)], 1, 0)
    volume = np.einsum("ij,ij->i", np.cross(p, q), r) / 6
    moment = volume[:, None] * (p + q + r) / 4
    summed = np.stack([np.bincount(owners, m, count) for m in moment.T], axis=1)
    return summed / np.bincount(owners, volume, count)[:, None]


def without_repeats(loop: list[int]) -> list[int]:
    """A closed loop without equal neighbours."""
    return [v for k, v in enumerate(loop) if v != loop[k - 1]]


def area_vector(points: np.ndarray) -> np.ndarray:
    """(3,) normal of a closed polygon (k, 3), as long as its area."""
    return np.ascontiguousarray(cross(points, points[[*range(1, len(points)), 0]])).sum(axis=0) / 2
