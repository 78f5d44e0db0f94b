"""Bolts cut across their shanks: which tets are on which side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.base import unit
from orchestrator.errors import InputError, KeyPath, Problems, wrong
from orchestrator.kept import kept
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion, unique_names
from orchestrator.scene.partition import Partition
from orchestrator.scene.shanks import Shank, shank_of

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


def cut_bolts(mesh: Mesh, faces: Faces, partition: Partition, bolts: Sequence[Any],
              entries: Sequence[Any], problems: Problems) -> tuple[Partition, list[BoltCut]]:
    """Cuts the subdomains that a bolt's plane runs through.

    bolts, entries : of the configuration's ``bolts`` and ``interfaces``

    Returns the partition, in which both sides are subdomains of their own and pieces of one body;
    and the cuts
    """
    planes: dict[str, tuple[int, np.ndarray, np.ndarray, np.ndarray]] = {}
    ahead = np.zeros(len(mesh.cells), dtype=bool)
    for i, bolt in enumerate(bolts):
        try:
            name = _volume(mesh, partition, bolt, ("bolts", i, "on"), planes)
            own = np.flatnonzero(mesh.volume == mesh.volumes.index(name))
            shank = shank_of(mesh, faces, own, _bonded(name, entries, mesh.volumes))
            axis, point = _plane(mesh, own, bolt, shank, ("bolts", i, "cut"))
            at = None if shank is None else shank.height(axis, point)
            if at is not None:
                problems.warnings += _told(shank, at, name, ("bolts", i, "cut"), bolt.cut != "auto")
        except InputError as error:
            problems.found += error.problems
            continue
        height = (mesh.nodes[mesh.cells[own, :4]] - point) @ axis
        front = (mesh.nodes[mesh.cells[own, :4]].mean(axis=1) - point) @ axis > 0
        crossed = (height.min(axis=1) < 0) & (height.max(axis=1) > 0)
        ahead[own] = front ^ _lonely(faces, own, front, crossed)
        planes[name] = i, axis, point, own
    if not planes:
        return partition, []
    keys, subdomain = np.unique(2 * partition.subdomain + ahead, return_inverse=True)
    before, count = keys // 2, np.bincount(keys // 2)
    names = [partition.names[e] if count[e] == 1 else f"{partition.names[e]}.{1 + key % 2}"
             for e, key in zip(before, keys)]
    cut = Partition(subdomain, unique_names(names), [partition.body(e) for e in before])
    cuts = [BoltCut(i, name, axis, point, *(
        tuple(np.unique(subdomain[own[ahead[own] == side]]).tolist()) for side in (False, True)))
            for name, (i, axis, point, own) in planes.items()]
    _check_whole(faces, cut, cuts, problems)
    return cut, cuts


def _check_whole(faces: Faces, cut: Partition, cuts: Sequence[BoltCut], problems: Problems) -> None:
    """Add a problem for each cut that leaves a subdomain in pieces."""
    piece = pieces(faces, cut.subdomain)[1]
    parts = np.bincount(cut.subdomain[np.unique(piece, return_index=True)[1]],
                        minlength=len(cut.names))
    for one in cuts:
        if broken := [cut.names[e] for e in (*one.behind, *one.ahead) if parts[e] > 1]:
            problems.add(("bolts", one.index, "cut"),
                         f"a plane that leaves {' and '.join(broken)} in pieces",
                         "a plane across the shank that meets nothing else of the bolt, and "
                         "subdomains in one piece on either side of it",
                         "move the plane, or write subdomains: groups, which leaves bolts whole")


def _volume(mesh: Mesh, partition: Partition, bolt: Any, path: KeyPath,
            known: dict) -> str:
    """Return the volume of an entry of ``bolts``.

    known : volumes that other entries cut
    Raises InputError: something is wrong with it
    """
    names = matching(bolt.on, mesh.volumes)
    if not names:
        raise wrong(path, f"no volume is called {bolt.on!r}", ONE_VOLUME,
                     suggestion(bolt.on, mesh.volumes, "volume"))
    if len(names) > 1:
        raise wrong(path, f"{len(names)} volumes match {bolt.on!r}: {', '.join(names[:4])}",
                     ONE_VOLUME, "write an entry for each of them")
    if names[0] in known:
        raise wrong(path, f"a second entry for {names[0]}", "one entry for each bolt",
                     "leave one out")
    own = mesh.volume == mesh.volumes.index(names[0])
    if np.isin(partition.subdomain[~own], partition.subdomain[own]).any():
        raise wrong(path, f"subdomains that hold {names[0]} and other matter together",
                     "subdomains of the bolt alone",
                     "write subdomains: groups, one per volume, in a scene of several volumes")
    return names[0]


def _bonded(bolt: str, entries: Sequence[Any], names: list[str]) -> list[str]:
    """Return the volumes, of all names, that entries bond to a bolt."""
    laws = Laws(entries, names)
    return [name for name in names if laws[laws.foreseen([bolt], [name])].kind.perfect]


def _plane(mesh: Mesh, own: np.ndarray, bolt: Any, shank: Shank | None,
           path: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """Return axis and point of the plane of an entry of ``bolts``.

    own : (k,) int, the bolt's cells
    Raises InputError: something is wrong with it
    """
    name = mesh.volumes[mesh.volume[own[0]]]
    if bolt.cut != "auto":
        axis, point = np.array(unit(bolt.cut.plane)), np.array(bolt.cut.point, dtype=float)
    elif shank is None:
        raise wrong(path,
                     f"cut: auto, and no cylinder on {name} that is longer than half its radius",
                     "a bolt with a round shank along one axis",
                     "say where: cut: {plane: z, at: 12}")
    else:
        axis, point = shank.axis, shank.cut
    ahead = (mesh.nodes[mesh.cells[own, :4]].mean(axis=1) - point) @ axis > 0
    if ahead.all() or not ahead.any():
        along = mesh.nodes[mesh.cells[own]].reshape(-1, 3) @ axis
        raise wrong(path, f"a plane beside {name}, at {point @ axis:g} along its normal",
                     f"a plane through it: it reaches from {along.min():g} to {along.max():g}",
                     "move the plane")
    return axis, point


def _told(shank: Shank, at: float, name: str, path: KeyPath, given: bool) -> Iterator[str]:
    """Yield what is to be said of a cut at a height of a shank: in a thread, or across where other
    parts end.

    given : whether the entry says where it is
    Raises InputError: in a thread, and there is a better place
    """
    thread = next((thread for thread in shank.threads if thread.low < at < thread.high), None)
    if thread is not None and shank.free is not None:
        raise wrong(path,
                    f"a plane through {name} where it is bonded to {thread.part}, which takes its "
                    "force off before the head", "a plane between the head and the thread",
                    f"leave cut out, or move it to {format_point(shank.at(sum(shank.free) / 2))}")
    if thread is not None:
        yield (f"{name} is bonded to {thread.part} at its cut, and has no free stretch between "
               f"head and thread: the force is taken off by {thread.part}, and does not arrive "
               "under the head")
    if given and (better := shank.away_from_joints(at)) != at:
        yield (f"bolts[{path[1]}].cut is within an element of where parts beside {name} end: it "
               "zigzags across that plane and leaves pieces of contact with hardly a node; "
               f"{format_point(shank.at(better))} is amid one of them")


@kept
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
