"""Cylinders, cones, spheres and tori that the nodes of a face lie on: their normals in the place of the facets'.

Facets on a surface of radius R lean by some h/8R, each its own way, and so do their means around nodes. Sides that slide would climb
these leanings and wedge. Where all nodes lie on one of these surfaces, normals are its own.

Each is given by a centre c, an axis a and one or two numbers s, and has a distance d(x) and a normal n(x) = ∇d. The Gauss–Newton method
brings the distances of the nodes to zero, with

    ∂d/∂c = −n,    ∂d/∂ω = n × (x − c) where the axis turns by ω,    ∂d/∂s as each surface has it

and steps of least norm: a cylinder may turn about its axis, and move along it. It begins with what fits linearly. Normals of a surface
of revolution all meet its axis (Pottmann & Randrup, Computing 60, 1998), (x × n)·a + n·m = 0, m = c × a; what it is turned from is a
line or a circle in the plane of the distances from the axis and along it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.scene.mesh.geometry import cross

FEWEST = 12  # nodes; a torus has seven unknowns
STEPS = 8
ON = 1e-2  # of what facets are off the surface, how far nodes may be
NONE = 1e-9  # a share of directions that is rounding


@dataclass(frozen=True)
class Shape:
    """Where a surface is.

    centre, axis : (3,); numbers : (1 or 2,)
    measured : its distance (n,), normal (n, 3) and ∂d/∂s (n, 1 or 2) at points, from the point's way off the axis, the unit vector
        of that (n, 3), its way along the axis, and the axis
    """

    centre: np.ndarray
    axis: np.ndarray
    numbers: np.ndarray
    measured: Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]

    def at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances, normals and their slopes at points (n, 3)."""
        arm = x - self.centre
        along = arm @ self.axis
        off = arm - along[:, None] * self.axis
        length = np.linalg.norm(off, axis=1)
        return self.measured(length, off / np.where(length > 0, length, 1.0)[:, None], along, self.axis, *self.numbers)

    def nearer(self, x: np.ndarray) -> Shape:
        """After a step towards points (n, 3)."""
        distance, normal, slopes = self.at(x)
        slopes = np.hstack([-normal, cross(normal, x - self.centre), slopes])
        step = np.linalg.lstsq(slopes, -distance, rcond=NONE)[0]
        axis = self.axis + np.cross(step[3:6], self.axis)
        return replace(self, centre=self.centre + step[:3], axis=axis / np.linalg.norm(axis), numbers=self.numbers + step[6:])


def _cylinder(length, out, along, axis, radius):
    return length - radius, out, np.full((len(length), 1), -1.0)


def _cone(length, out, along, axis, radius, angle):
    """angle : of its surface to the axis, narrower along it; radius : where the centre is"""
    c, s = np.cos(angle), np.sin(angle)
    slope = -(length - radius) * s + along * c
    return (length - radius) * c + along * s, c * out + s * axis, np.stack([np.full(len(length), -c), slope], axis=1)


def _torus(length, out, along, axis, radius, tube):
    away = length - radius
    size = np.hypot(away, along)
    size = np.where(size > 0, size, 1.0)
    normal = (away[:, None] * out + along[:, None] * axis) / size[:, None]
    return size - tube, normal, np.stack([-away / size, np.full(len(length), -1.0)], axis=1)


def _sphere(length, out, along, axis, radius):
    distance, normal, slopes = _torus(length, out, along, axis, 0.0, radius)
    return distance, normal, slopes[:, 1:]


def recognised(x: np.ndarray, normals: np.ndarray, off: float) -> np.ndarray | None:
    """(n, 3) unit normals at nodes (n, 3) of the surface that they lie on; None where they lie on none, or on a plane.

    normals : (n, 3) unit, about what they are
    off : how far facets are off their surfaces
    """
    size = float(np.ptp(x, axis=0).max())
    if len(x) < FEWEST or not off > NONE * size:
        return None
    middle = x.mean(axis=0)
    scaled = (x - middle) / size
    for shape in _first(scaled, normals):
        for _ in range(STEPS):
            shape = shape.nearer(scaled)
        distance, found, _ = shape.at(scaled)
        if np.abs(distance).max() <= ON * off / size:
            return found * np.sign(np.einsum("ni,ni->n", found, normals))[:, None]
    return None


def _first(x: np.ndarray, normals: np.ndarray) -> Iterator[Shape]:
    """What the nodes may lie on, straight ones first: two circles about an axis are on spheres, too."""
    share, directions = np.linalg.eigh(normals.T @ normals / len(normals))
    if share[1] < NONE:
        return
    axis, plane = directions[:, 0], directions[:, 1:]
    (*middle, radius), right = _circle(x @ plane)
    if right:
        yield Shape(plane @ middle, axis, np.array([radius]), _cylinder)
    turned, centre = _axis(x, normals)
    along = (x - centre) @ turned
    length = np.linalg.norm(x - centre - along[:, None] * turned, axis=1)
    if right:
        yield Shape(plane @ middle, axis, np.array([radius, 0.0]), _cone)
    rises, at = np.linalg.lstsq(np.c_[along, np.ones(len(along))], length, rcond=None)[0]
    yield Shape(centre, turned, np.array([at, np.arctan(-rises)]), _cone)
    solution = np.linalg.lstsq(np.c_[2 * x, np.ones(len(x))], np.sum(x**2, axis=1), rcond=None)[0]
    yield Shape(solution[:3], axis, np.array([np.sqrt(max(solution[3] + solution[:3] @ solution[:3], 0.0))]), _sphere)
    (radius, up, tube), right = _circle(np.c_[length, along])
    if right:
        yield Shape(centre + up * turned, turned, np.array([radius, tube]), _torus)


def _circle(at: np.ndarray) -> tuple[tuple[float, float, float], bool]:
    """Centre and radius of the circle through points (n, 2) by linear least squares, and whether there is one."""
    solution = np.linalg.lstsq(np.c_[2 * at, np.ones(len(at))], np.sum(at**2, axis=1), rcond=None)[0]
    square = solution[2] + solution[0] ** 2 + solution[1] ** 2
    return (solution[0], solution[1], float(np.sqrt(max(square, 0.0)))), bool(square > 0)


def _axis(x: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction and a point of the axis that the normals at nodes come nearest to meeting."""
    moments = cross(x, normals)
    coupling = np.linalg.pinv(normals.T @ normals, rcond=NONE) @ normals.T @ moments
    rest = moments - normals @ coupling
    axis = np.linalg.eigh(rest.T @ rest)[1][:, 0]
    return axis, np.cross(axis, -coupling @ axis)
