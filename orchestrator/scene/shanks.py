"""Shanks of bolts: the cylinders that they are round, where other parts end beside these, and where
``cut: auto`` has the plane.

Threads: where along its shank a bolt is bonded to other parts, and the free stretch between these
and its head.

What a thread is bonded to takes the bolt's force off it face by face. A cut within the thread
tightens the bolt against the part that it is screwed into: next to nothing arrives under the head.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import facet_normals, format_point, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching
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
class Shank:
    """The longest cylinder of a bolt: its axis (3,), middle (3,) on it, radius and length."""

    axis: np.ndarray
    middle: np.ndarray
    radius: float
    length: float


def ends_beside(mesh: Mesh, faces: Faces, own: np.ndarray, shank: Shank) -> np.ndarray:
    """(k,) heights along a shank, from its middle, of faces across it where other parts end beside
    it; own : cells of the bolt.
    """
    mine, inner = np.isin(faces.owner, own), faces.neighbour >= 0
    ends = ~mine & ~inner | inner & (mesh.volume[faces.owner] != mesh.volume[faces.neighbour])
    middles = mesh.nodes[faces.triangles[ends, :3]] - shank.middle
    along = middles @ shank.axis
    beside = np.linalg.norm(middles - along[:, :, None] * shank.axis,
                            axis=2).min(axis=1) < NEAR * shank.radius
    return along[beside & (np.ptp(along, axis=1) < FLAT * shank.radius)].mean(axis=1)


def away_from_joints(mesh: Mesh, own: np.ndarray, shank: Shank, ends: np.ndarray, at: float = 0.0,
                     stretch: tuple[float, float] | None = None) -> float:
    """Place of the cut along the axis, from a shank's middle: at ``at``, unless that is nearer than
    an element to where other parts end.

    A cut zigzags along the mesh's faces. Where it crosses the plane at which two plates meet,
    pieces of contact are left with hardly a node. It then goes to the nearest place amid a plate
    that has room for it; nowhere where none has.

    own : cells of the bolt; ends : of ``ends_beside``; stretch : lowest and highest place; None: of
        the shank
    """
    low, high = (-shank.length / 2, shank.length / 2) if stretch is None else stretch
    at = at if low <= at <= high else (low + high) / 2
    corners = (mesh.nodes[mesh.cells[own, :4]] - shank.middle) @ shank.axis
    size = float(np.median(np.ptp(corners, axis=1)))
    ends = np.r_[low, ends, high]
    ends = np.unique(ends[(ends >= low) & (ends <= high)])
    if np.abs(ends - at).min() > size:
        return at
    places = (ends[1:] + ends[:-1]) / 2
    places = places[np.diff(ends) > 2 * size]
    far = np.abs(places - at)
    return float(places[far <= far.min() + FLAT * shank.radius].max()) if len(places) else at


def along_shank(shank: Shank, axis: np.ndarray) -> bool:
    """Whether an axis (3,) is the shank's."""
    return bool(abs(shank.axis @ axis) >= 1 - ACROSS**2)


def elsewhere(mesh: Mesh, own: np.ndarray, around: tuple[Shank | None, np.ndarray | None],
              axis: np.ndarray, point: np.ndarray) -> str:
    """A better place for a cut that crosses planes at which other parts end; empty where there is
    none, or no need.
    """
    shank, ends = around
    if shank is None or not along_shank(shank, axis):
        return ""
    at = float((point - shank.middle) @ shank.axis)
    better = away_from_joints(mesh, own, shank, ends, at)
    return "" if better == at else format_point(shank.middle + better * shank.axis)


def across_shank(mesh: Mesh, faces: Faces, cells: np.ndarray) -> Shank | None:
    """Return the longest cylinder that some cells are round; None where there is none.

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
    normal, area = facet_normals(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
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
    return Shank(best.axis, best.centre + (found - best.centre @ best.axis) * best.axis,
                 float(radius.mean()), length)


@dataclass(frozen=True)
class Thread:
    """Bonded faces around a shank.

    low, high : heights along the shank, from its middle
    part : name of the volume that they are of
    """

    low: float
    high: float
    part: str


def bonds(entries: Sequence[Any], names: Sequence[str], bolt: str) -> Callable[[str], bool]:
    """Return what tells whether a law of perfect interfaces holds between a bolt and the volume of
    a name.

    entries : of ``interfaces``; names : of all volumes; bolt : as the configuration names it
    """
    laws, own = Laws(list(entries), names), matching(bolt, names)
    return lambda name: laws[laws.foreseen(own, [name])].kind.perfect


def threads_of(mesh: Mesh, faces: Faces, own: np.ndarray, shank: Shank,
               holds: Callable[[str], bool]) -> list[Thread]:
    """Return the bonded stretches of a shank, one for each volume around it.

    own : (k,) int, cells of the bolt; holds : whether the volume of a name is bonded to it
    """
    mine, inner = np.isin(faces.owner, own), faces.neighbour >= 0
    beyond = inner & np.isin(faces.neighbour, own)
    around = np.flatnonzero(np.where(inner, mine ^ beyond, ~mine))
    volume = mesh.volume[np.where(mine, faces.neighbour, faces.owner)[around]]
    arm = mesh.nodes[faces.triangles[around, :3]] - shank.middle
    along = arm @ shank.axis
    off = np.linalg.norm(arm - along[..., None] * shank.axis, axis=2) - shank.radius
    near = (np.abs(off) < ALIKE * shank.radius).all(axis=1) & (
        np.abs(along) < shank.length / 2).any(axis=1)
    found = []
    for v in np.unique(volume[near]):
        name = mesh.volumes[v]
        if holds(name):
            heights = along[near & (volume == v)]
            found.append(Thread(float(heights.min()), float(heights.max()), name))
    return found


def free_stretch(mesh: Mesh, own: np.ndarray, shank: Shank,
                 threads: Sequence[Thread]) -> tuple[float, float] | None:
    """Return lowest and highest place along a shank between its head and the nearest thread; None
    where it is bonded all along.

    Of several free stretches it is one with a head or a thread at both ends, then the longest.
    """
    half, places = shank.length / 2, [-shank.length / 2]
    arm = mesh.nodes[mesh.cells[own, :4]].reshape(-1, 3) - shank.middle
    along = arm @ shank.axis
    wide = np.linalg.norm(arm - along[:, None] * shank.axis, axis=1) > (1 + ALIKE) * shank.radius
    ends = {-half: bool((wide & (along <= -half)).any()),
            half: bool((wide & (along >= half)).any())}
    for thread in sorted(threads, key=lambda thread: thread.low):
        places[-1:] = [places[-1], max(thread.low, places[-1]), max(thread.high, places[-1])]
    places.append(max(half, places[-1]))
    places, room = np.clip(places, -half, half), ALIKE * shank.radius
    stretches = [(low, high) for low, high in zip(places[::2], places[1::2]) if high - low > room]
    return max(stretches, key=lambda at: (sum(ends.get(end, True) for end in at), at[1] - at[0]),
               default=None)


def auto_cut(mesh: Mesh, own: np.ndarray, shank: Shank, threads: Sequence[Thread],
             ends: np.ndarray) -> np.ndarray:
    """Return the point (3,) of the cut across a shank, between head and thread, away from where
    parts end beside it.

    ends : of ``ends_beside``
    """
    return shank.middle + away_from_joints(mesh, own, shank, ends, 0.0,
                                           free_stretch(mesh, own, shank, threads)) * shank.axis


def within(threads: Sequence[Thread], at: float) -> Thread | None:
    """Return the thread that a place along the shank is within."""
    return next((thread for thread in threads if thread.low < at < thread.high), None)
