"""Bolts cut across their shanks: which tets are on which side, and where ``cut: auto`` has the plane."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.base import unit
from orchestrator.errors import Problems
from orchestrator.parallel.numbering import ordered
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.geometry import facet_normals, format_point, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion, unique_names
from orchestrator.scene.partition import Partition
from orchestrator.scene.revolved import cylinder

ONE_VOLUME = "the name of one volume: every bolt has a force of its own"
# Faces of a shank look across its axis: a larger cosine than that belongs to a cone.
ACROSS = 0.05
# Facets of one cylinder are all alike far from its axis, but for the axis' own error on coarse meshes: that share of the
# largest radius between two neighbours tells two cylinders apart.
ALIKE = 0.05
# A cylinder shorter than that many of its radii is no shank.
SHORTEST = 0.5
# The corners of a cylinder's facets are on it, but for digits of files; those of a square bar's are up to 41 % off.
ROUND = 0.02
# Parts end beside a shank with faces across its axis, to so many of its radii, within this share of one.
NEAR, FLAT = 2.0, 1e-3


@dataclass(frozen=True)
class BoltCut:
    """The cut of one bolt.

    index : position in the YAML's ``bolts``
    name : of the volume
    axis : (3,) unit normal of the plane; point : (3,) on it
    behind, ahead : the subdomains on either side, ahead where the axis leads
    """

    index: int
    name: str
    axis: np.ndarray
    point: np.ndarray
    behind: tuple[int, ...]
    ahead: tuple[int, ...]


@dataclass(frozen=True)
class Plane:
    """Where a bolt is cut.

    index, name, axis, point : as of ``BoltCut``
    own : (k,) int, the bolt's cells; ahead : (k,) bool, where the axis leads
    """

    index: int
    name: str
    axis: np.ndarray
    point: np.ndarray
    own: np.ndarray
    ahead: np.ndarray


def cut_bolts(mesh: Mesh, faces: Faces, partition: Partition, bolts: Sequence[Any], problems: Problems) -> tuple[Partition, list[BoltCut]]:
    """Cuts the subdomains that a bolt's plane runs through.

    Returns the partition, in which both sides are subdomains of their own and pieces of one body; and the cuts
    """
    own = {i: bolt_cells(mesh, bolt) for i, bolt in enumerate(bolts)}
    shanks = {i: across_shank(mesh, faces, cells) for i, cells in own.items() if len(cells)}
    beside = {i: ends_beside(mesh, faces, own[i], shank) for i, shank in shanks.items() if shank is not None}
    made = planes(mesh, faces, partition, bolts, Shanks(shanks, beside), problems)
    return cut_at(made, faces, partition, problems)[:2]


@dataclass(frozen=True)
class Shanks:
    """Bolts' shanks, None of one without any, and where other parts end beside them (k,), by the places of their entries."""

    of: Mapping[int, Shank | None]
    beside: Mapping[int, np.ndarray]


def bolt_cells(mesh: Mesh, bolt: Any) -> np.ndarray:
    """(k,) int, the cells of the one volume that an entry of ``bolts`` names; none where it names none, or several."""
    names = matching(bolt.on, mesh.volumes)
    return np.flatnonzero(mesh.volume == mesh.volumes.index(names[0])) if len(names) == 1 else np.empty(0, dtype=int)


def planes(mesh: Mesh, faces: Faces, partition: Partition, bolts: Sequence[Any], shanks: Shanks, problems: Problems) -> list[Plane]:
    """Planes of the bolts; of a piece of a mesh of those that subdomains have which are all there."""
    made: list[Plane] = []
    for i, bolt in enumerate(bolts):
        def wrong(key: str, *said: str, i: int = i) -> None:
            problems.add(("bolts", i, key), *said)

        here = np.ones(len(mesh.cells), dtype=bool) if partition.here is None else partition.here[partition.subdomain]
        if partition.here is not None and not here[bolt_cells(mesh, bolt)].any():
            continue  # another rank's
        shank, ends = shanks.of.get(i), shanks.beside.get(i)
        if found := _plane(mesh, partition, bolt, (shank, ends), [plane.name for plane in made], wrong):
            name, own, axis, point = found
            if bolt.cut != "auto" and (better := _elsewhere(mesh, own, (shank, ends), axis, point)):
                problems.warnings.append(f"bolts[{i}].cut is within an element of where parts beside {name} end: it zigzags across that plane "
                                         f"and leaves pieces of contact with hardly a node; {better} is amid one of them")
            height = (mesh.nodes[mesh.cells[own, :4]] - point) @ axis
            ahead, crossed = ahead_of(mesh, own, axis, point), (height.min(axis=1) < 0) & (height.max(axis=1) > 0)
            turned, unsure = _lonely(faces, own, ahead, crossed, here[own])
            if unsure:
                wrong("cut", "a plane that leaves tets on either side alone", "all of the mesh, to tell how many")
            made.append(Plane(i, name, axis, point, own, ahead ^ turned))
    return made


def ahead_of(mesh: Mesh, cells: np.ndarray, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(k,) bool, which cells (k,) have their centroids ahead of a plane."""
    return (mesh.nodes[mesh.cells[cells, :4]].mean(axis=1) - point) @ axis > 0


def cut_at(made: Sequence[Plane], faces: Faces, partition: Partition, problems: Problems,
           split: np.ndarray | None = None) -> tuple[Partition, list[BoltCut], np.ndarray]:
    """The partition with bolts cut at planes, the cuts, and (subdomains,) int, twice the subdomain that each was, one more ahead of a plane.

    split : (s,) int, subdomains that are cut, of which a piece of a mesh may have one side alone
    """
    if not made:
        return partition, [], 2 * np.arange(len(partition.names))
    ahead = np.zeros(len(partition.subdomain), dtype=bool)
    for plane in made:
        ahead[plane.own] = plane.ahead
    keys, subdomain = np.unique(2 * partition.subdomain + ahead, return_inverse=True)
    before, count, here = keys // 2, np.bincount(keys // 2), partition.here
    if split is not None:
        count[split] = 2
    names = [partition.names[e] if count[e] == 1 else f"{partition.names[e]}.{1 + key % 2}" for e, key in zip(before, keys)]
    cut = Partition(subdomain, unique_names(names), [partition.body(e) for e in before], None if here is None else here[before])
    cuts = [BoltCut(plane.index, plane.name, plane.axis, plane.point, *(
        tuple(np.unique(subdomain[plane.own[plane.ahead == side]]).tolist()) for side in (False, True))) for plane in made]
    number, piece = pieces(faces, subdomain)
    if number != len(names):
        parts = np.bincount(subdomain[np.unique(piece, return_index=True)[1]], minlength=len(names))
        for one in cuts:
            broken = [cut.names[e] for e in (*one.behind, *one.ahead) if parts[e] > 1 and (here is None or cut.here[e])]
            if broken:
                problems.add(("bolts", one.index, "cut"), f"a plane that leaves {' and '.join(broken)} in pieces",
                             "a plane across the shank that meets nothing else of the bolt, and subdomains in one piece on either "
                             "side of it", "move the plane, or write subdomains: groups, which leaves bolts whole")
    return cut, cuts, keys


def _plane(mesh: Mesh, partition: Partition, bolt: Any, around: tuple[Shank | None, np.ndarray | None], known: list[str],
           wrong: Callable[..., None]) -> tuple[str, np.ndarray, np.ndarray, np.ndarray] | None:
    """Volume, cells, axis and point of the plane of an entry of ``bolts``; None where something is wrong with it, which is told.

    around : the bolt's shank, and where other parts end beside it; known : names of the volumes that other entries cut
    """
    names = matching(bolt.on, mesh.volumes)
    if not names:
        return wrong("on", f"no volume is called {bolt.on!r}", ONE_VOLUME, suggestion(bolt.on, mesh.volumes, "volume"))
    if len(names) > 1:
        return wrong("on", f"{len(names)} volumes match {bolt.on!r}: {', '.join(names[:4])}", ONE_VOLUME, "write an entry for each of them")
    name = names[0]
    if name in known:
        return wrong("on", f"a second entry for {name}", "one entry for each bolt", "leave one out")
    own = np.flatnonzero(mesh.volume == mesh.volumes.index(name))
    shank, ends = around
    if bolt.cut != "auto":
        axis, point = np.array(unit(bolt.cut.plane)), np.array(bolt.cut.point, dtype=float)
    elif shank is None:
        return wrong("cut", f"cut: auto, and no cylinder on {name} that is longer than half its radius",
                     "a bolt with a round shank along one axis", "say where: cut: {plane: z, at: 12}")
    else:
        axis, point = shank.axis, shank.middle + away_from_joints(mesh, own, shank, ends) * shank.axis
    ahead = ahead_of(mesh, own, axis, point)
    if mesh.within is None and (ahead.all() or not ahead.any()):
        along = mesh.nodes[mesh.cells[own]].reshape(-1, 3) @ axis
        return wrong("cut", f"a plane beside {name}, at {point @ axis:g} along its normal",
                     f"a plane through it: it reaches from {along.min():g} to {along.max():g}", "move the plane")
    if np.isin(np.delete(partition.subdomain, own), partition.subdomain[own]).any():
        return wrong("on", f"subdomains that hold {name} and other matter together",
                     "subdomains of the bolt alone", "write subdomains: groups, one per volume, in a scene of several volumes")
    return name, own, axis, point


def _lonely(faces: Faces, cells: np.ndarray, ahead: np.ndarray, crossed: np.ndarray, here: np.ndarray) -> tuple[np.ndarray, bool]:
    """(k,) bool, tets that a plane crosses and that share no face with others of their side: they go to the other one; and whether some
    that are here may share faces with more than are known.

    cells : (k,) int, of the bolt; ahead : (k,) bool, where their centroids are; crossed : (k,) bool, cut by the plane
    here : (k,) bool, of which all that share faces with them are known
    """
    part = np.full(len(faces.owner) and int(max(faces.owner.max(), faces.neighbour.max())) + 1, 2)
    part[cells] = ahead
    piece = pieces(faces, part)[1][cells]
    lonely = np.bincount(piece, weights=~crossed)[piece] == 0  # no tet beside the plane: not the bolt's end
    return lonely, bool((lonely & here & (np.bincount(piece, weights=~here)[piece] > 0)).any())


@dataclass(frozen=True)
class Shank:
    """The longest cylinder of a bolt: its axis (3,), middle (3,) on it, radius and length."""

    axis: np.ndarray
    middle: np.ndarray
    radius: float
    length: float


def ends_beside(mesh: Mesh, faces: Faces, own: np.ndarray, shank: Shank) -> np.ndarray:
    """(k,) heights along a shank, from its middle, of faces across it where other parts end beside it; own : cells of the bolt."""
    mine, inner = np.isin(faces.owner, own), faces.neighbour >= 0
    ends = ~mine & ~inner | inner & (mesh.volume[faces.owner] != mesh.volume[faces.neighbour])
    middles = mesh.nodes[faces.triangles[ends, :3]] - shank.middle
    along = middles @ shank.axis
    beside = np.linalg.norm(middles - along[:, :, None] * shank.axis, axis=2).min(axis=1) < NEAR * shank.radius
    return along[beside & (np.ptp(along, axis=1) < FLAT * shank.radius)].mean(axis=1)


def away_from_joints(mesh: Mesh, own: np.ndarray, shank: Shank, ends: np.ndarray, at: float = 0.0) -> float:
    """Place of the cut along the axis, from a shank's middle: at ``at``, unless that is nearer than an element to where other parts end.

    A cut zigzags along the mesh's faces. Where it crosses the plane at which two plates meet, pieces of contact are left with hardly a
    node. It then goes to the nearest place amid a plate that has room for it; nowhere where none has.

    own : cells of the bolt; ends : of ``ends_beside``
    """
    corners = (mesh.nodes[mesh.cells[own, :4]] - shank.middle) @ shank.axis
    size = float(np.median(np.ptp(corners, axis=1)))
    ends = np.r_[-shank.length / 2, ends, shank.length / 2]
    ends = np.unique(ends[np.abs(ends) <= shank.length / 2])
    if np.abs(ends - at).min() > size:
        return at
    places = (ends[1:] + ends[:-1]) / 2
    places = places[np.diff(ends) > 2 * size]
    far = np.abs(places - at)
    return float(places[far <= far.min() + FLAT * shank.radius].max()) if len(places) else at


def _elsewhere(mesh: Mesh, own: np.ndarray, around: tuple[Shank | None, np.ndarray | None], axis: np.ndarray, point: np.ndarray) -> str:
    """A better place for a cut that crosses planes at which other parts end; empty where there is none, or no need."""
    shank, ends = around
    if shank is None or abs(shank.axis @ axis) < 1 - ACROSS**2:
        return ""
    at = float((point - shank.middle) @ shank.axis)
    better = away_from_joints(mesh, own, shank, ends, at)
    return "" if better == at else format_point(shank.middle + better * shank.axis)


def across_shank(mesh: Mesh, faces: Faces, cells: np.ndarray, own: np.ndarray | None = None, team: Team = ALONE,
                 number: np.ndarray | None = None) -> Shank | None:
    """The longest cylinder that some cells are round; None where there is none.

    The axis is first the principal axis of inertia that is least like the others, then what the faces that look across it
    all look across.

    own : (k,) bool, cells (k,) that are this rank's, of several which ask together; number : (n,) int, as of a piece of a mesh
    """
    mine = cells if own is None else cells[own]
    volume, middle = np.abs(tet_volumes(mesh.nodes, mesh.cells[mine])), mesh.nodes[mesh.cells[mine, :4]].mean(axis=1)
    total, centre = team.sum(volume.sum(), volume @ middle)
    if not total:
        return None
    centre = centre / total
    r = middle - centre
    inertia, = team.sum(np.einsum("k,ki,kj->ij", volume, r, r))
    moments, axes = np.linalg.eigh(inertia)
    axis = axes[:, np.argmax(np.abs(moments - np.median(moments)))]
    inside = np.isin(faces.owner, cells), np.isin(faces.neighbour, cells) & (faces.neighbour >= 0)
    skin = np.flatnonzero(inside[0] ^ inside[1])
    triangles = faces.triangles[skin[np.isin(np.where(inside[0], faces.owner, faces.neighbour)[skin], mine)], :3]
    corners = ordered(np.sort(triangles if number is None else number[triangles], axis=1), mesh.nodes[triangles], team)
    normal, area = facet_normals(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    for _ in range(2):
        beside = np.abs(normal @ axis) < ACROSS
        if not beside.any():
            return None
        least = np.linalg.eigh(np.einsum("k,ki,kj->ij", area[beside], normal[beside], normal[beside]))[1][:, 0]
        axis = least * np.sign(least @ axis)
    axis *= np.sign(axis[np.abs(axis).argmax()])
    beside = np.abs(normal @ axis) < ACROSS
    points, normal = corners[beside], normal[beside]
    radius = np.abs(np.einsum("ki,ki->k", normal, points[:, 0] - centre))  # how far from the axis each facet's plane is
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
    return Shank(best.axis, best.centre + (found - best.centre @ best.axis) * best.axis, float(radius.mean()), length)
