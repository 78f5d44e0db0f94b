"""Shafts in holes, by the shapes of named surfaces: which go about one axis, with how much room;
which volumes are bolts and nuts.

A shaft of radius r is in a hole of radius R where both go about nearly one axis and along some of
it together. Its clearance is R − r; what is eccentric by e leaves R − r − e on one side and R − r +
e on the other. A bolt is a volume whose shank is in holes and that clamps: along its axis planes
press from both sides, its own or those of what its threads are in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.scene.interfaces.facing import facing
from orchestrator.scene.interfaces.opposite import close_bodies, outer_bodies
from orchestrator.scene.interfaces.skins import Skins
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import area_vectors, areas, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.shapes import shape_of

# Axes whose angle has a larger sine than that are two; a hole that is wider than the shaft by more
# than that share of its radius
# is not made for it; along less than that share of the radius round faces do not go together.
TILTED, WIDER, TOGETHER = 1e-3, 0.35, 0.1
# Radii that differ by less than that share are one: a thread drawn without its turns, a bonded or a
# press fit.
SAME = 1e-3
# A press fit strains the ring by its share of the radius: metals yield at some thousandths, this
# much is none.
PRESSED = 0.01
# Of a full circle, what is less is a fillet.
ROUND = 0.5
# A nut is no larger than that many times its bolt.
NUT = 2.0


@dataclass(frozen=True, eq=False)
class RoundFace:
    """A cylindrical surface, of one name or of several halves: its volume, axis (3,), a point (3,)
    of it, radius, from where to where along the axis, whether matter is outside, mean element size,
    area."""

    names: tuple[str, ...]
    volume: int
    axis: np.ndarray
    through: np.ndarray
    radius: float
    low: float
    high: float
    hollow: bool
    size: float
    area: float

    def eccentric(self, other: RoundFace) -> float:
        """Distance of another one's axis from this one's; infinite where they are not parallel."""
        if np.linalg.norm(np.cross(self.axis, other.axis)) > TILTED:
            return np.inf
        return float(np.linalg.norm(np.cross(other.through - self.through, self.axis)))

    def extent_of(self, other: RoundFace) -> tuple[float, float]:
        """Ends of another one along this one's axis."""
        turn, shift = float(np.sign(self.axis @ other.axis)), float(
            (other.through - self.through) @ self.axis)
        low, high = sorted((shift + turn * other.low, shift + turn * other.high))
        return low, high

    def continued_by(self, other: RoundFace) -> bool:
        """Whether another face is of the same cylinder, beside this one."""
        near = SAME * self.radius
        if self.volume != other.volume or self.hollow != other.hollow or abs(
            self.radius - other.radius) > near:
            return False
        low, high = self.extent_of(other)
        return self.eccentric(other) <= near and low <= self.high + near and high >= self.low - near


@dataclass(frozen=True)
class Fit:
    """A shaft in a hole.

    clearance : radius of the hole less that of the shaft; below zero for a press fit
    eccentric : how far apart the axes are; length : along which both go together; where : (3,) in
        the middle of it, on the axis
    """

    shaft: RoundFace
    hole: RoundFace
    clearance: float
    eccentric: float
    length: float
    where: np.ndarray

    @property
    def volumes(self) -> tuple[int, int]:
        """Volumes of shaft and hole."""
        return self.shaft.volume, self.hole.volume

    @property
    def same(self) -> bool:
        """Whether there is no room: faces that touch all round."""
        return abs(self.clearance) <= SAME * self.shaft.radius

    @property
    def overlaps(self) -> bool:
        """Whether shaft and hole are inside each other by more than any press fit: a thread drawn
        by its outer and its core diameter.
        """
        return self.clearance < -PRESSED * self.shaft.radius

    @property
    def area(self) -> float:
        """Area of the shaft, as far as both go together, if they go all round."""
        return 2 * np.pi * self.shaft.radius * self.length


@dataclass(frozen=True)
class ClampingBolt:
    """A volume that clamps others.

    shank : its longest round face that is in holes; threads : fits in which it is held, none where
        planes of its own press on both sides
    nuts : numbers of the volumes that hold its threads, where these are nuts
    """

    volume: int
    shank: RoundFace
    threads: list[Fit]
    nuts: list[int]


def round_faces(mesh: Mesh, faces: Faces) -> list[RoundFace]:
    """The named surfaces that are cylinders, by what the CAD model says of them, else by their
    nodes; those inside the mesh are none.

    What goes about one axis at one radius, beside each other, is one face: many a CAD program has
    two halves.
    """
    found: list[RoundFace] = []
    for name, triangles in mesh.surfaces.items():
        at = faces.find(triangles) if len(triangles) else np.empty(0, int)
        if not len(at) or (at < 0).any() or (faces.neighbour[at] >= 0).any():
            continue
        known = mesh.smooth.get(name)
        shape = shape_of(mesh.nodes,
                         triangles) if known is None or known.kind == "curved" else known
        if shape.kind != "cylinder":
            continue
        points = mesh.nodes[triangles[:, :3]]
        along = (points.reshape(-1, 3) - shape.through) @ shape.direction
        arm = points.mean(axis=1) - shape.through
        arm -= np.outer(arm @ shape.direction, shape.direction)
        outward = np.einsum("ki,ki->", arm, area_vectors(mesh.nodes, faces.triangles[at]))
        each = areas(mesh.nodes, triangles)
        face = RoundFace((name,), int(mesh.volume[faces.owner[at[0]]]), shape.direction,
                         shape.through, shape.radius,
                         float(along.min()), float(along.max()), bool(outward < 0),
                         float(np.sqrt(2 * each).mean()), float(each.sum()))
        half = next((k for k, other in enumerate(found) if other.continued_by(face)), None)
        if half is None:
            found.append(face)
        else:
            one = found[half]
            low, high = one.extent_of(face)
            found[half] = replace(one, names=(*one.names, name), low=min(low, one.low),
                                  high=max(high, one.high), area=one.area + face.area)
    return [face for face in found
            if face.area > ROUND * 2 * np.pi * face.radius * (face.high - face.low)]


def fits(found: Sequence[RoundFace]) -> list[Fit]:
    """Each shaft in each hole of another volume that it may be made for."""
    result = []
    for shaft in (face for face in found if not face.hollow):
        for hole in (face for face in found if face.hollow and face.volume != shaft.volume):
            clearance, eccentric = hole.radius - shaft.radius, shaft.eccentric(hole)
            if abs(clearance) > WIDER * shaft.radius or eccentric > max(
                clearance, 0.0) + SAME * shaft.radius:
                continue
            low, high = (pick(ends)
                         for pick, ends in zip((max, min),
                                               zip((shaft.low, shaft.high), shaft.extent_of(hole))))
            if high - low > TOGETHER * shaft.radius:
                result.append(Fit(shaft, hole, clearance, eccentric, high - low,
                                  shaft.through + (low + high) / 2 * shaft.axis))
    return result


def exact_distance(mesh: Mesh, found: Sequence[Fit]) -> np.ndarray:
    """(s, s) clearance between the CAD faces of the mesh, in the order of ``mesh.smooth``, of those
    that fit about one axis; else nan.
    """
    number = {name: k for k, name in enumerate(mesh.smooth)}
    # the last one for what is on no CAD face
    result = np.full((len(number) + 1, len(number) + 1), np.nan)
    for fit in found:
        if fit.eccentric <= SAME * fit.shaft.radius:
            a, b = ([number[name] for name in face.names if name in number]
                    for face in (fit.shaft, fit.hole))
            result[np.ix_(a, b)] = result[np.ix_(b, a)] = fit.clearance
    return result


# Two volumes that touch, and the normals (k, 3) of the facets there, outward of the first.
Touching = tuple[int, int, np.ndarray]


def bolts(mesh: Mesh, faces: Faces, found: Sequence[Fit]) -> list[ClampingBolt]:
    """The volumes that clamp others, in the order of the mesh."""
    skins, touching = Skins(mesh, faces), []
    for one, two in close_bodies(outer_bodies(mesh, faces, mesh.volume), None):
        touching += [(one.volume, two.volume, one.normal[patch.facets[0]])
                     for patch in facing(skins(one), skins(two))]
    content = np.bincount(mesh.volume, tet_volumes(mesh.nodes, mesh.cells), len(mesh.volumes))
    result = []
    for volume in dict.fromkeys(fit.shaft.volume for fit in found):
        own = [fit for fit in found if fit.shaft.volume == volume]
        shank = max((fit.shaft for fit in own), key=lambda face: face.high - face.low)
        # a nut is a small part that holds the thread; without one it is in a part that the head
        # does not lie on
        tight = [fit for fit in own if (fit.same or fit.overlaps) and fit.shaft is shank]
        nuts = [fit for fit in tight if content[fit.hole.volume] <= NUT * content[volume]]
        under = {other for _, other in _pressing(volume, shank.axis, touching)}
        threads = nuts or [fit for fit in tight if fit.hole.volume not in under]
        held = {fit.hole.volume for fit in threads}
        ways = [way for way, other in _pressing(volume, shank.axis, touching) if other not in held]
        ways += [way for part in held for way, other in _pressing(part, shank.axis, touching)
                 if other != volume]
        if len(set(ways)) == 2:
            result.append(ClampingBolt(volume, shank, threads, [fit.hole.volume for fit in nuts]))
    return result


def _pressing(volume: int, axis: np.ndarray,
              touching: Sequence[Touching]) -> Iterator[tuple[float, int]]:
    """Direction, 1 or −1, in which faces of a volume press along an axis, and the volumes pressed
    on.
    """
    for one, two, normals in touching:
        if volume in (one, two):
            along = normals @ axis * (1 if volume == one else -1)
            for way in np.unique(np.sign(along[np.abs(along) > 1 - SAME])):
                yield float(way), two if volume == one else one
