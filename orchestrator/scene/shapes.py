"""Shapes of surfaces, by the nodes of their triangles: planes, and surfaces of revolution by least
squares, whose normals stand in the place of facets'.

Facets on a surface of radius R lean by some h/8R, each its own way, and so do their means around
nodes. Sides that slide would climb these leanings and wedge. Where all nodes lie on one of these
surfaces, normals are its own.

Each is given by a centre c, an axis a and one or two numbers s, and has a distance d(x) and a
normal n(x) = ∇d. The Gauss–Newton method brings the distances of the nodes to zero, with

    ∂d/∂c = −n,    ∂d/∂ω = n × (x − c) where the axis turns by ω,    ∂d/∂s as each surface has it

and steps of least norm: a cylinder may turn about its axis, and move along it. It begins with
what fits linearly. Normals of a surface of revolution all meet its axis (Pottmann & Randrup,
Computing 60, 1998), (x × n)·a + n·m = 0, m = c × a; what it is turned from is a line or a circle
in the plane of the distances from the axis and along it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.scene.mesh.geometry import cross, facet_normals
from orchestrator.linalg import PLACED, svd, WRITTEN

# Nodes lie on a cylinder or a sphere within this share of its radius: files have that many digits,
# and nodes in the middle of
# nothing curved are farther off.
ROUND = 1e-4
# Surfaces that bend less than this over their extent are not told from others by their radius.
FLATTEST = 50.0


@dataclass(frozen=True)
class Shape:
    """``kind``: plane, cylinder, sphere or curved; the plane's normal or the cylinder's axis (3,);
    its radius; a point (3,) of the
    plane or the axis, or the sphere's centre; (k, 3, 3) unit normals at the corners of its
    triangles, whichever way they look, where a CAD
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
            return None if vectors is None else ((place(through + vectors.reshape(-1, 3)) - origin)
                                                 / size).reshape(vectors.shape)

        return Shape(self.kind, turned(self.direction),
                     None if self.radius is None else size * self.radius,
                     None if self.through is None else origin, turned(self.normals))


def shape_of(nodes: np.ndarray, triangles: np.ndarray) -> Shape:
    """The shape of triangles (k, 3 or 6), corners first, that have an area."""
    normals, each = facet_normals(nodes, triangles)
    mean = each @ normals / each.sum()
    if np.abs(normals - mean).max() < WRITTEN:
        return Shape("plane", mean, None, nodes[triangles[0, 0]])
    points = nodes[np.unique(triangles[:, :3])]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) < 6:
        return Shape("curved")
    shift = points.mean(axis=0)
    centre, radius = through(points - shift)
    # facets of a cylinder look across its axis, but for what their size makes of it
    across = np.linalg.eigh((normals * each[:, None]).T @ normals)[1][:, 0]
    middles, found = nodes[triangles[:, :3]].mean(axis=1), []
    for kind, fewest, surface in (
            ("sphere", 7, Revolved(centre + shift, across, np.array([radius]), _sphere)),
            ("cylinder", 6, cylinder(points, across))):
        radius, axis = float(surface.numbers[0]), surface.axis
        if (0 < radius < FLATTEST * size and len(points) >= fewest
                and np.abs(surface.at(points)[0]).max() <= ROUND * radius):
            off = np.linalg.norm(np.cross(surface.at(middles)[1], normals), axis=1).mean()
            found.append((off, Shape(
                kind, None if kind == "sphere" else axis * np.sign(axis[np.abs(axis).argmax()]),
                radius, surface.centre)))
    # the nodes of two rings are on a cylinder and on a sphere: the facets between them tell which
    return min(found, key=lambda each: each[0])[1] if found else Shape("curved")


FEWEST = 12  # nodes; a torus has seven unknowns
STEPS = 8  # of Gauss and Newton, which doubles its digits in each
ON = 1e-2  # of what facets are off the surface, how far nodes may be


@dataclass(frozen=True)
class Revolved:
    """Place of a surface of revolution.

    centre, axis : (3,); numbers : (1 or 2,)
    measured : its distance (n,), normal (n, 3) and ∂d/∂s (n, 1 or 2) at points, from the point's
        way off the axis, the unit vector of that (n, 3), its way along the axis, and the axis
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
        return self.measured(length, off / np.where(length > 0, length, 1.0)[:, None], along,
                             self.axis, *self.numbers)

    def fitted(self, x: np.ndarray) -> Revolved:
        """Fit to points (n, 3), of an extent of about one, by least squares."""
        now = self
        for _ in range(STEPS):
            distance, normal, slopes = now.at(x)
            slopes = np.hstack([-normal, cross(normal, x - now.centre), slopes])
            step = np.linalg.lstsq(slopes, -distance, rcond=PLACED)[0]
            axis = now.axis + cross(step[None, 3:6], now.axis[None])[0]
            now = replace(now, centre=now.centre + step[:3], axis=axis / np.linalg.norm(axis),
                          numbers=now.numbers + step[6:])
        return now


def _cylinder(length, out, along, axis, radius):
    return length - radius, out, np.full((len(length), 1), -1.0)


def _cone(length, out, along, axis, radius, angle):
    """angle : of its surface to the axis, narrower along it; radius : where the centre is"""
    c, s = np.cos(angle), np.sin(angle)
    slope = -(length - radius) * s + along * c
    return (length - radius) * c + along * s, c * out + s * axis, np.stack(
        [np.full(len(length), -c), slope], axis=1)


def _torus(length, out, along, axis, radius, tube):
    away = length - radius
    size = np.hypot(away, along)
    size = np.where(size > 0, size, 1.0)
    normal = (away[:, None] * out + along[:, None] * axis) / size[:, None]
    return size - tube, normal, np.stack([-away / size, np.full(len(length), -1.0)], axis=1)


def _sphere(length, out, along, axis, radius):
    distance, normal, slopes = _torus(length, out, along, axis, 0.0, radius)
    return distance, normal, slopes[:, 1:]


def through(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle or sphere that points (n, 2 or 3) fit best by |x|² = 2 c·x +
    r² − c²; 0: there is none.
    """
    *centre, rest = np.linalg.lstsq(np.c_[2 * points, np.ones(len(points))],
                                    np.sum(points**2, axis=1), rcond=None)[0]
    return np.array(centre), float(np.sqrt(max(rest + np.square(centre).sum(), 0.0)))


def cylinder(points: np.ndarray, axis: np.ndarray) -> Revolved:
    """The cylinder that points (n, 3) fit best, from about its axis (3,) on."""
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    x, across = (points - middle) / size, svd(axis[None])[2][1:]
    centre, radius = through(x @ across.T)
    found = Revolved(centre @ across, axis, np.array([radius]), _cylinder).fitted(x)
    return replace(found, centre=middle + size * found.centre, numbers=size * found.numbers)


def recognised(x: np.ndarray, normals: np.ndarray,
               off: float) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return the surface that nodes (n, 3) lie on: its unit normals (m, 3), whichever way they
    look, at points (m, 3); None where they lie on none, or on a plane.

    normals : (n, 3) unit, about what they are
    off : how far facets are off their surfaces
    """
    size = float(np.ptp(x, axis=0).max())
    if len(x) < FEWEST or not off > PLACED * size:
        return None
    middle = x.mean(axis=0)
    scaled = (x - middle) / size
    for shape in _first(scaled, normals):
        found = shape.fitted(scaled)
        if np.abs(found.at(scaled)[0]).max() <= ON * off / size:
            return lambda points: found.at((points - middle) / size)[1]
    return None


def _first(x: np.ndarray, normals: np.ndarray) -> Iterator[Revolved]:
    """Surfaces that the nodes may lie on, straight ones first: two circles about an axis are on
    spheres, too.
    """
    share, directions = np.linalg.eigh(normals.T @ normals / len(normals))
    if share[1] < PLACED:
        return
    axis, plane = directions[:, 0], directions[:, 1:]
    middle, radius = through(x @ plane)
    if radius > 0:
        yield Revolved(plane @ middle, axis, np.array([radius]), _cylinder)
    turned, centre = _axis(x, normals)
    along = (x - centre) @ turned
    length = np.linalg.norm(x - centre - along[:, None] * turned, axis=1)
    if radius > 0:
        yield Revolved(plane @ middle, axis, np.array([radius, 0.0]), _cone)
    rises, at = np.linalg.lstsq(np.c_[along, np.ones(len(along))], length, rcond=None)[0]
    yield Revolved(centre, turned, np.array([at, np.arctan(-rises)]), _cone)
    middle, radius = through(x)
    yield Revolved(middle, axis, np.array([radius]), _sphere)
    (radius, up), tube = through(np.c_[length, along])
    if tube > 0:
        yield Revolved(centre + up * turned, turned, np.array([radius, tube]), _torus)


def _axis(x: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction and a point of the axis that the normals at nodes come nearest to meeting."""
    moments = cross(x, normals)
    coupling = np.linalg.pinv(normals.T @ normals, rcond=PLACED) @ normals.T @ moments
    rest = moments - normals @ coupling
    axis = np.linalg.eigh(rest.T @ rest)[1][:, 0]
    return axis, np.cross(axis, -coupling @ axis)
