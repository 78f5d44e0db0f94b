"""Bolts cut across their shanks: which tets are on which side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.base import unit
from orchestrator.errors import Problems
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion, unique_names
from orchestrator.scene.partition import Partition
from orchestrator.scene.shanks import (
    across_shank, along_shank, auto_cut, bonds, elsewhere, ends_beside, free_stretch, Shank,
    Thread, threads_of, within)

ONE_VOLUME = "the name of one volume: every bolt has a force of its own"


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
class BoltPlane:
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


def cut_bolts(mesh: Mesh, faces: Faces, partition: Partition, config: Any,
              problems: Problems) -> tuple[Partition, list[BoltCut]]:
    """Cuts the subdomains that a bolt's plane runs through.

    config : whose ``bolts`` and ``interfaces`` are asked for

    Returns the partition, in which both sides are subdomains of their own and pieces of one body;
    and the cuts
    """
    around = []
    for bolt in config.bolts:
        own = bolt_cells(mesh, bolt)
        shank = across_shank(mesh, faces, own) if len(own) else None
        around.append((None, None, ()) if shank is None else (
            shank, ends_beside(mesh, faces, own, shank), threads_of(
                mesh, faces, own, shank, bonds(config.interfaces, mesh.volumes, bolt.on))))
    made = planes(mesh, faces, partition, config.bolts, around, problems)
    return cut_at(made, faces, partition, problems)


def bolt_cells(mesh: Mesh, bolt: Any) -> np.ndarray:
    """(k,) int, the cells of the one volume that an entry of ``bolts`` names; none where it names
    none, or several.
    """
    names = matching(bolt.on, mesh.volumes)
    return np.flatnonzero(mesh.volume == mesh.volumes.index(names[0])) if len(
        names) == 1 else np.empty(0, dtype=int)


def planes(mesh: Mesh, faces: Faces, partition: Partition, bolts: Sequence[Any],
           around: Sequence[tuple],
           problems: Problems) -> list[BoltPlane]:
    """Return the planes of the bolts.

    around : the shank of each, where other parts end beside it, and its threads; None, None and
        nothing of one that has none
    """
    made: list[BoltPlane] = []
    for i, (bolt, (shank, ends, threads)) in enumerate(zip(bolts, around)):
        def wrong(key: str, *said: str, i: int = i) -> None:
            problems.add(("bolts", i, key), *said)

        if found := _plane(mesh, partition, bolt, (shank, ends, threads),
                           [plane.name for plane in made], wrong):
            name, own, axis, point = found
            if bonded := _in_thread(mesh, own, shank, threads, axis, point):
                thread, better = bonded
                if better:
                    wrong("cut",
                          f"a plane through {name} where it is bonded to {thread.part}, which "
                          "takes its force off before the head",
                          "a plane between the head and the thread",
                          f"leave cut out, or move it to {better}")
                    continue
                problems.warnings.append(
                    f"{name} is bonded to {thread.part} at its cut, and has no free stretch "
                    f"between head and thread: the force is taken off by {thread.part}, and does "
                    "not arrive under the head")
            if bolt.cut != "auto" and (better := elsewhere(mesh, own, (shank, ends), axis, point)):
                problems.warnings.append(
                    f"bolts[{i}].cut is within an element of where parts beside {name} end: it "
                    "zigzags across that plane and leaves pieces of contact with hardly a node; "
                    f"{better} is amid one of them")
            height = (mesh.nodes[mesh.cells[own, :4]] - point) @ axis
            ahead, crossed = ahead_of(mesh, own, axis,
                                      point), (height.min(axis=1) < 0) & (height.max(axis=1) > 0)
            made.append(BoltPlane(i, name, axis, point, own,
                              ahead ^ _lonely(faces, own, ahead, crossed)))
    return made


def ahead_of(mesh: Mesh, cells: np.ndarray, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(k,) bool, which cells (k,) have their centroids ahead of a plane."""
    return (mesh.nodes[mesh.cells[cells, :4]].mean(axis=1) - point) @ axis > 0


def cut_at(made: Sequence[BoltPlane], faces: Faces, partition: Partition,
           problems: Problems) -> tuple[Partition, list[BoltCut]]:
    """Return the partition with bolts cut at planes, and the cuts."""
    if not made:
        return partition, []
    ahead = np.zeros(len(partition.subdomain), dtype=bool)
    for plane in made:
        ahead[plane.own] = plane.ahead
    keys, subdomain = np.unique(2 * partition.subdomain + ahead, return_inverse=True)
    before, count = keys // 2, np.bincount(keys // 2)
    names = [partition.names[e] if count[e] == 1 else f"{partition.names[e]}.{1 + key % 2}"
             for e, key in zip(before, keys)]
    cut = Partition(subdomain, unique_names(names), [partition.body(e) for e in before])
    cuts = [BoltCut(plane.index, plane.name, plane.axis, plane.point, *(
        tuple(np.unique(subdomain[plane.own[plane.ahead == side]]).tolist())
        for side in (False, True))) for plane in made]
    number, piece = pieces(faces, subdomain)
    if number != len(names):
        parts = np.bincount(subdomain[np.unique(piece, return_index=True)[1]], minlength=len(names))
        for one in cuts:
            broken = [cut.names[e] for e in (*one.behind, *one.ahead) if parts[e] > 1]
            if broken:
                problems.add(("bolts", one.index, "cut"),
                             f"a plane that leaves {' and '.join(broken)} in pieces",
                             "a plane across the shank that meets nothing else of the bolt, and "
                             "subdomains in one piece on either side of it",
                             "move the plane, or write subdomains: groups, which leaves bolts whole")
    return cut, cuts


def _in_thread(mesh: Mesh, own: np.ndarray, shank: Shank | None, threads: Sequence[Thread],
               axis: np.ndarray,
               point: np.ndarray) -> tuple[Thread, str] | None:
    """The thread that a plane across a shank is within, and a better place in words, if there is
    one; None where it is in no thread.
    """
    if shank is None or not along_shank(shank, axis):
        return None
    thread = within(threads, float((point - shank.middle) @ shank.axis))
    if thread is None:
        return None
    free = free_stretch(mesh, own, shank, threads)
    return thread, "" if free is None else format_point(shank.middle + sum(free) / 2 * shank.axis)


def _plane(mesh: Mesh, partition: Partition, bolt: Any,
           around: tuple[Shank | None, np.ndarray | None, Sequence[Thread]], known: list[str],
           wrong: Callable[..., None]) -> tuple[str, np.ndarray, np.ndarray, np.ndarray] | None:
    """Volume, cells, axis and point of the plane of an entry of ``bolts``; None where something is
    wrong with it, which is told.

    around : the bolt's shank, where other parts end beside it, and its threads; known : names of
        the volumes that other entries cut
    """
    names = matching(bolt.on, mesh.volumes)
    if not names:
        return wrong("on", f"no volume is called {bolt.on!r}", ONE_VOLUME,
                     suggestion(bolt.on, mesh.volumes, "volume"))
    if len(names) > 1:
        return wrong("on", f"{len(names)} volumes match {bolt.on!r}: {', '.join(names[:4])}",
                     ONE_VOLUME, "write an entry for each of them")
    name = names[0]
    if name in known:
        return wrong("on", f"a second entry for {name}", "one entry for each bolt", "leave one out")
    own = np.flatnonzero(mesh.volume == mesh.volumes.index(name))
    shank, ends, threads = around
    if bolt.cut != "auto":
        axis, point = np.array(unit(bolt.cut.plane)), np.array(bolt.cut.point, dtype=float)
    elif shank is None:
        return wrong("cut",
                     f"cut: auto, and no cylinder on {name} that is longer than half its radius",
                     "a bolt with a round shank along one axis",
                     "say where: cut: {plane: z, at: 12}")
    else:
        axis, point = shank.axis, auto_cut(mesh, own, shank, threads, ends)
    ahead = ahead_of(mesh, own, axis, point)
    if ahead.all() or not ahead.any():
        along = mesh.nodes[mesh.cells[own]].reshape(-1, 3) @ axis
        return wrong("cut", f"a plane beside {name}, at {point @ axis:g} along its normal",
                     f"a plane through it: it reaches from {along.min():g} to {along.max():g}",
                     "move the plane")
    if np.isin(np.delete(partition.subdomain, own), partition.subdomain[own]).any():
        return wrong("on", f"subdomains that hold {name} and other matter together",
                     "subdomains of the bolt alone",
                     "write subdomains: groups, one per volume, in a scene of several volumes")
    return name, own, axis, point


def _lonely(faces: Faces, cells: np.ndarray, ahead: np.ndarray, crossed: np.ndarray) -> np.ndarray:
    """Return (k,) bool, tets that a plane crosses and that share no face with others of their side:
    they go to the other one.

    cells : (k,) int, of the bolt; ahead : (k,) bool, where their centroids are
    crossed : (k,) bool, cut by the plane
    """
    part = np.full(len(faces.owner) and int(max(faces.owner.max(), faces.neighbour.max())) + 1, 2)
    part[cells] = ahead
    piece = pieces(faces, part)[1][cells]
    # no tet beside the plane: not the bolt's end
    return np.bincount(piece, weights=~crossed)[piece] == 0
