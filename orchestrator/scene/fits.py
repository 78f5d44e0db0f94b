"""Shafts in holes, by the shapes of named surfaces: which go about one axis, with how much room; which volumes are bolts and nuts.

A shaft of radius r is in a hole of radius R where both go about nearly one axis and along some of it together. Its clearance is
R − r; what is eccentric by e leaves R − r − e on one side and R − r + e on the other. A bolt is a volume whose shank is in holes
and that clamps: a plane of its own presses on one part, and on the other side its thread is in another one, or a second plane presses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.interfaces.facing import facing
from orchestrator.scene.interfaces.opposite import close_bodies, outer_bodies
from orchestrator.scene.interfaces.skins import Skins
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.shapes import shape_of

# Axes whose angle has a larger sine than that are two; a hole that is wider than the shaft by more than that share of its radius
# is not made for it; along less than that share of the radius round faces do not go together.
TILTED, WIDER, TOGETHER = 1e-3, 0.35, 0.1
# Radii that differ by less than that share are one: a thread drawn without its turns, a bonded or a press fit.
SAME = 1e-3
# A nut is no larger than that many times its bolt.
NUT = 2.0


@dataclass(frozen=True)
class RoundFace:
    """A cylindrical surface: its volume, axis (3,), a point (3,) of it, radius, from where to where along the axis, whether matter is
    outside."""

    name: str
    volume: int
    axis: np.ndarray
    through: np.ndarray
    radius: float
    low: float
    high: float
    hollow: bool


@dataclass(frozen=True)
class Fit:
    """A shaft in a hole.

    clearance : radius of the hole less that of the shaft; below zero for a press fit
    eccentric : how far apart the axes are; length : along which both go together; where : (3,) in the middle of it, on the axis
    """

    shaft: RoundFace
    hole: RoundFace
    clearance: float
    eccentric: float
    length: float
    where: np.ndarray

    @property
    def volumes(self) -> tuple[int, int]:
        """Of shaft and hole."""
        return self.shaft.volume, self.hole.volume

    @property
    def same(self) -> bool:
        """Whether there is no room: faces that touch all round."""
        return abs(self.clearance) <= SAME * self.shaft.radius

    @property
    def area(self) -> float:
        """Of the shaft, as far as both go together, if they go all round."""
        return 2 * np.pi * self.shaft.radius * self.length


@dataclass(frozen=True)
class Pressed:
    """A plane patch on which two volumes lie on each other: its normal (3,), outward of the first, and its area."""

    volumes: tuple[int, int]
    normal: np.ndarray
    area: float


@dataclass(frozen=True)
class Bolt:
    """A volume that clamps others.

    shank : its longest round face that is in holes; thread : the fit in which it is held, None where a second plane presses
    heads : numbers of the volumes that its planes press on
    nut : number of the volume that holds its thread where that is a nut, else None
    """

    volume: int
    shank: RoundFace
    thread: Fit | None
    heads: list[int]
    nut: int | None


def round_faces(mesh: Mesh, faces: Faces) -> list[RoundFace]:
    """The named surfaces that are cylinders, by what the CAD model says of them, else by their nodes; those inside the mesh are none."""
    found = []
    for name, triangles in mesh.surfaces.items():
        at = faces.find(triangles) if len(triangles) else np.empty(0, int)
        if not len(at) or (at < 0).any() or (faces.neighbour[at] >= 0).any():
            continue
        known = mesh.smooth.get(name)
        shape = shape_of(mesh.nodes, triangles) if known is None or known.kind == "curved" else known
        if shape.kind != "cylinder":
            continue
        points = mesh.nodes[triangles[:, :3]]
        along = (points.reshape(-1, 3) - shape.through) @ shape.direction
        arm = points.mean(axis=1) - shape.through
        arm -= np.outer(arm @ shape.direction, shape.direction)
        outward = np.einsum("ki,ki->", arm, area_vectors(mesh.nodes, faces.triangles[at]))
        found.append(RoundFace(name, int(mesh.volume[faces.owner[at[0]]]), shape.direction, shape.through, shape.radius,
                               float(along.min()), float(along.max()), bool(outward < 0)))
    return found


def fits(found: Sequence[RoundFace]) -> list[Fit]:
    """Each shaft in each hole of another volume that it may be made for."""
    result = []
    for shaft in (face for face in found if not face.hollow):
        for hole in (face for face in found if face.hollow and face.volume != shaft.volume):
            clearance = hole.radius - shaft.radius
            if not abs(clearance) <= WIDER * shaft.radius or np.linalg.norm(np.cross(shaft.axis, hole.axis)) > TILTED:
                continue
            arm = hole.through - shaft.through
            eccentric = float(np.linalg.norm(np.cross(arm, shaft.axis)))
            if eccentric > max(clearance, 0.0) + SAME * shaft.radius:
                continue
            turn, shift = float(np.sign(shaft.axis @ hole.axis)), float(arm @ shaft.axis)
            ends = sorted((shift + turn * hole.low, shift + turn * hole.high))
            low, high = max(shaft.low, ends[0]), min(shaft.high, ends[1])
            if high - low > TOGETHER * shaft.radius:
                result.append(Fit(shaft, hole, clearance, eccentric, high - low, shaft.through + (low + high) / 2 * shaft.axis))
    return result


def pressed(mesh: Mesh, faces: Faces) -> Iterator[Pressed]:
    """The plane patches on which volumes touch, with meshes of their own."""
    skins = Skins(mesh, faces)
    for one, two in close_bodies(outer_bodies(mesh, faces, mesh.volume), None):
        for patch in facing(skins(one), skins(two)):
            own = patch.facets[0]
            whole = one.area[own] @ one.normal[own]
            size = float(np.linalg.norm(whole))
            if size > (1 - SAME) * one.area[own].sum():
                yield Pressed((one.volume, two.volume), whole / size, patch.area)


def bolts(mesh: Mesh, found: Sequence[Fit], touching: Sequence[Pressed]) -> list[Bolt]:
    """The volumes that clamp others, in the order of the mesh."""
    content = np.bincount(mesh.volume, tet_volumes(mesh.nodes, mesh.cells), len(mesh.volumes))
    result = []
    for volume in dict.fromkeys(fit.shaft.volume for fit in found):
        own = [fit for fit in found if fit.shaft.volume == volume]
        shank = max((fit.shaft for fit in own), key=lambda face: face.high - face.low)
        sides = {}  # which way a plane of it looks along the axis → what it presses on
        for patch in touching:
            if volume in patch.volumes:
                along = float(patch.normal @ shank.axis) * (1 if patch.volumes[0] == volume else -1)
                if abs(along) > 1 - SAME:
                    sides[np.sign(along)] = patch.volumes[1 - patch.volumes.index(volume)]
        clamped = set(sides.values())
        thread = next((fit for fit in own if fit.same and fit.hole.volume not in clamped), None)
        if not clamped or (thread is None and len(sides) < 2):
            continue
        nut = None if thread is None else thread.hole.volume
        if nut is not None and content[nut] > NUT * content[volume]:
            nut = None  # a hole with a thread in a larger part
        result.append(Bolt(volume, shank, thread, sorted(clamped), nut))
    return result
