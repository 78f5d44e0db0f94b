"""Shanks of bolts: the cylinders that they are round, where other parts end beside these, and where
``cut: auto`` has the plane.

Threads: where along its shank a bolt is bonded to other parts, and the free stretch between these
and its head.

What a thread is bonded to takes the bolt's force off it face by face. A cut within the thread
tightens the bolt against the part that it is screwed into: next to nothing arrives under the head.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.kept import kept
from orchestrator.scene.interfaces.opposite import Triangles
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.shapes import cylinder

# Faces of a shank look across its axis: a larger cosine than that belongs to a cone.
ACROSS = 0.05
# Facets of one cylinder are all alike far from its axis, but for the axis' own error on coarse
# meshes: that share of the
# largest radius between two neighbours tells two cylinders apart.
ALIKE = 0.05
# A cylinder shorter than that many of its radii is no shank.
SHORTEST = 0.5
# The corners of a cylinder's facets are on it, but for digits of files; those of a square bar's are
# up to 41 % off.
ROUND = 0.02
# Parts end beside a shank with faces across its axis, to so many of its radii, within this share of
# one.
NEAR, FLAT = 2.0, 1e-3


@dataclass(frozen=True)
class Thread:
    """Bonded faces around a shank.

    low, high : heights along the shank, from its middle
    part : name of the volume that they are of
    """

    low: float
    high: float
    part: str


@dataclass(frozen=True)
class Shank:
    """The longest cylinder of a bolt, and what there is along it, by heights from its middle.

    axis : (3,); middle : (3,) on it
    size : of the bolt's elements along it, in the median
    ends : (k,) heights of faces across it where other parts end beside it
    threads : the bonded stretches, one for each volume around it
    free : lowest and highest place between the head and the nearest thread; None: it is bonded all
        along
    """

    axis: np.ndarray
    middle: np.ndarray
    radius: float
    length: float
    size: float
    ends: np.ndarray
    threads: list[Thread]
    free: tuple[float, float] | None

    def at(self, height: float) -> np.ndarray:
        """Return the point (3,) of the axis at a height."""
        return self.middle + height * self.axis

    def height(self, axis: np.ndarray, point: np.ndarray) -> float | None:
        """Return where a plane across an axis (3,), through a point (3,), cuts it; None: that is
        another axis."""
        if abs(self.axis @ axis) < 1 - ACROSS**2:
            return None
        return float((point - self.middle) @ self.axis)

    @property
    def cut(self) -> np.ndarray:
        """(3,) where it is best cut: between head and thread, away from where parts end."""
        return self.at(self.away_from_joints(0.0, self.free))

    def away_from_joints(self, at: float, stretch: tuple[float, float] | None = None) -> float:
        """Return the height of a cut: ``at``, unless that is nearer than an element to where other
        parts end.

        A cut zigzags along the mesh's faces. Where it crosses the plane at which two plates meet,
        pieces of contact are left with hardly a node. It then goes to the nearest place amid a
        plate that has room for it; nowhere where none has.

        stretch : lowest and highest place; None: of the shank
        """
        low, high = (-self.length / 2, self.length / 2) if stretch is None else stretch
        at = at if low <= at <= high else (low + high) / 2
        ends = np.r_[low, self.ends, high]
        ends = np.unique(ends[(ends >= low) & (ends <= high)])
        if np.abs(ends - at).min() > self.size:
            return at
        places = (ends[1:] + ends[:-1]) / 2
        places = places[np.diff(ends) > 2 * self.size]
        far = np.abs(places - at)
        return float(places[far <= far.min() + FLAT * self.radius].max()) if len(places) else at


@kept
def shank_of(mesh: Mesh, faces: Faces, cells: np.ndarray, bonded: list[str]) -> Shank | None:
    """Return the shank of a bolt; None where it has none.

    cells : (k,) int, of the bolt; bonded : volumes that are bonded to it
    """
    if (found := _cylinder(mesh, faces, cells)) is None:
        return None
    axis, middle, radius, length = found
    mine, inner = np.isin(faces.owner, cells), faces.neighbour >= 0
    triangles, volume = faces.triangles[:, :3], mesh.volume
    ends = ~mine & ~inner | inner & (volume[faces.owner] != volume[faces.neighbour])
    along, off = _places(mesh.nodes[triangles[ends]], axis, middle)
    beside = (off.min(axis=1) < NEAR * radius) & (np.ptp(along, axis=1) < FLAT * radius)
    heights = along[beside].mean(axis=1)
    beyond = inner & np.isin(faces.neighbour, cells)
    around = np.flatnonzero(np.where(inner, mine ^ beyond, ~mine))
    volume = volume[np.where(mine, faces.neighbour, faces.owner)[around]]
    along, off = _places(mesh.nodes[triangles[around]], axis, middle)
    near = (np.abs(off - radius) < ALIKE * radius).all(axis=1) & (
        np.abs(along) < length / 2).any(axis=1)
    threads = [Thread(float(own.min()), float(own.max()), name) for v in np.unique(volume[near])
               if (name := mesh.volumes[v]) in bonded for own in [along[near & (volume == v)]]]
    along, off = _places(mesh.nodes[mesh.cells[cells, :4]], axis, middle)
    return Shank(axis, middle, radius, length, float(np.median(np.ptp(along, axis=1))), heights,
                 threads, _free(along[off > (1 + ALIKE) * radius], radius, length / 2, threads))


def _places(points: np.ndarray, axis: np.ndarray,
            middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return heights (k, c) of points (k, c, 3) along an axis, and their distances (k, c) from
    it."""
    arm = points - middle
    along = arm @ axis
    return along, np.linalg.norm(arm - along[..., None] * axis, axis=2)


def _free(wide: np.ndarray, radius: float, half: float,
          threads: list[Thread]) -> tuple[float, float] | None:
    """Return the free stretch of a shank from -half to half: of several one with a head or a
    thread at both ends, then the longest.

    wide : (k,) heights at which the bolt is wider than its shank
    """
    places, room = [-half], ALIKE * radius
    ends = {-half: bool((wide <= -half).any()), half: bool((wide >= half).any())}
    for thread in sorted(threads, key=lambda thread: thread.low):
        places[-1:] = [places[-1], max(thread.low, places[-1]), max(thread.high, places[-1])]
    places = np.clip([*places, max(half, places[-1])], -half, half)
    stretches = [(low, high) for low, high in zip(places[::2], places[1::2]) if high - low > room]
    return max(stretches, key=lambda at: (sum(ends.get(end, True) for end in at), at[1] - at[0]),
               default=None)


def _cylinder(mesh: Mesh, faces: Faces,
              cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float] | None:
    """Return axis, middle, radius and length of the longest cylinder that some cells are round;
    None where there is none.

    The axis is first the principal axis of inertia that is least like the others, then what the
    faces that look across it all look across.
    """
    volume = np.abs(tet_volumes(mesh.nodes, mesh.cells[cells]))
    middle = mesh.nodes[mesh.cells[cells, :4]].mean(axis=1)
    if not volume.any():
        return None
    centre = volume @ middle / volume.sum()
    r = middle - centre
    moments, axes = np.linalg.eigh(np.einsum("k,ki,kj->ij", volume, r, r))
    axis = axes[:, np.argmax(np.abs(moments - np.median(moments)))]
    inside = np.isin(faces.owner, cells), np.isin(faces.neighbour, cells) & (faces.neighbour >= 0)
    triangles = faces.triangles[inside[0] ^ inside[1], :3]
    corners = mesh.nodes[triangles[np.lexsort(np.sort(triangles, axis=1).T[::-1])]]
    facets = Triangles.of(corners)
    normal, area = facets.normal, facets.area
    for _ in range(2):
        beside = np.abs(normal @ axis) < ACROSS
        if not beside.any():
            return None
        least = np.linalg.eigh(np.einsum("k,ki,kj->ij", area[beside], normal[beside],
                                         normal[beside]))[1][:, 0]
        axis = least * np.sign(least @ axis)
    axis *= np.sign(axis[np.abs(axis).argmax()])
    beside = np.abs(normal @ axis) < ACROSS
    points, normal = corners[beside], normal[beside]
    # how far from the axis each facet's plane is
    radius = np.abs(np.einsum("ki,ki->k", normal, points[:, 0] - centre))
    order = np.argsort(radius)
    group = np.zeros(len(radius), dtype=int)
    group[order] = np.cumsum(np.r_[0, np.diff(radius[order]) > ALIKE * radius.max()])
    height = points @ axis
    length, found = 0.0, None
    for own in (group == g for g in range(group.max() + 1)):
        low, high = height[own].min(), height[own].max()
        if high - low > max(length, SHORTEST * radius[own].mean()):
            length, found = float(high - low), (low + high) / 2
            shank = points[own].reshape(-1, 3)
    if found is None:
        return None
    best = cylinder(shank, axis)
    radius = np.linalg.norm(np.cross(shank - best.centre, best.axis), axis=1)
    if np.ptp(radius) > ROUND * radius.mean():
        return None
    return best.axis, best.centre + (found - best.centre @ best.axis) * best.axis, float(
        radius.mean()), length
