"""What is said of parts that are near or in each other and have no interface there, by name and with the distance.

- faces that touch beside an interface of the same parts and belong to none: a joint with a hole, an error;
- parts that touch without any, or that are within reach though nothing connects them, however indirectly: an error where
  an entry of ``interfaces:`` asks for a joint between them (across a gap, for one that opens), else a warning; parts of
  one connected structure may have a clearance;
- parts inside each other: an error, unless an entry has a press fit that deep;
- where pairs are found rather than named: parts that look at each other beyond reach while nothing connects them, and parts
  without any pair: errors too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.errors import KeyPath, Problems
from orchestrator.registry import LAWS
from orchestrator.scene.interfaces.alone import report_alone
from orchestrator.scene.interfaces.curvature import bulges, sagittas, smooth_faces
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.overlap import Solid, overlap
from orchestrator.scene.interfaces.pairing import Body, close_bodies
from orchestrator.scene.interfaces.proximity import Near, near
from orchestrator.scene.mesh.faces import Faces, components, pack, pieces
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition


def piece_of(mesh: Mesh, faces: Faces) -> tuple[int, np.ndarray]:
    """Number of pieces of the mesh that share no faces with each other, and the piece (m,) of each tet."""
    return pieces(faces, np.zeros(len(mesh.cells), dtype=int))


def report_neighbours(mesh: Mesh, faces: Faces, bodies: list[Body], found: list[Interface], partition: Partition,
                      numbering: SplitNumbering, laws: Laws, asked: bool, problems: Problems) -> list[tuple[int, int]]:
    """Adds problems and warnings; returns the pairs of volumes that are near each other without an interface there.

    Parameters
    ----------
    bodies : the outer faces, by subdomain and volume
    found : all interfaces
    asked : whether the user has written the laws' entries
    """
    cells = [i.cells for i in found] + mesh.one_body
    joined = {tuple(pair) for pair in np.sort(mesh.volume[np.concatenate(cells)], axis=1).tolist()} if cells else set()
    governing: dict[tuple[int, int], int] = {}
    beside: dict[tuple[int, int], Near] = {}
    loose = _unpaired(faces, bodies, found, numbering)
    for one, two in close_bodies(bodies, None):
        pair = tuple(sorted((one.volume, two.volume)))
        known = tuple((partition.names[b.subdomain], mesh.volumes[b.volume]) for b in (one, two))
        index = laws.foreseen(*known)
        governing[pair] = max(index, governing.get(pair, -1))
        if laws.excluded(*known) or (laws.apart(index) and not laws.found(index)):
            continue  # it is not meant; or the search for gaps has said what does not match
        seen = near(one, two, loose[id(one)], loose[id(two)])
        if seen is not None:
            beside[pair] = seen if pair not in beside else _both(beside[pair], seen)
    count, piece = piece_of(mesh, faces)
    inside = _overlaps(mesh, faces, piece, governing, laws, asked, problems) if count > 1 else set()
    connected = components(*piece[np.concatenate(cells)].T, count)[1][piece] if cells else piece
    told = set(inside)
    for pair, seen in beside.items():
        apart = not len(np.intersect1d(*(connected[mesh.volume == v] for v in pair)))
        if laws.found(governing[pair]):  # what faces beside a pair of theirs do later is looked at in the end
            if pair not in inside and apart:
                told.add(pair)
                _beyond_reach(mesh, pair, seen, governing[pair], laws, problems)
        elif pair not in inside and (apart or seen.touching):
            _report(mesh, pair, seen, pair in joined, governing[pair], laws, asked, problems)
    report_alone(mesh, bodies, piece, cells, told, partition, laws, problems)
    return list(beside)


def _unpaired(faces: Faces, bodies: list[Body], found: list[Interface], numbering: SplitNumbering) -> dict[int, np.ndarray]:
    """By the id of each body, which of its faces (k,) bool belong to no interface."""
    keys = [np.empty(0, np.int64)]
    for i in found:
        if i.surfaces is not None:
            keys += [pack(nodes[t[:, :3]], faces.nodes) for nodes, t in zip(i.surfaces.nodes, i.surfaces.triangles)]
            continue
        one, two = (numbering.nodes[numbering.offsets[e] + own] for e, own in zip(i.subdomains, i.nodes))
        if not np.array_equal(one, two):  # shared faces are no outer ones
            keys += [pack(nodes[i.triangles[:, :3]], faces.nodes) for nodes in (one, two)]
    paired = np.concatenate(keys)
    return {id(b): ~np.isin(pack(b.triangles[:, :3], faces.nodes), paired) if len(paired)
            else np.ones(len(b.triangles), dtype=bool) for b in bodies}


def _both(one: Near, two: Near) -> Near:
    """What is near between the same parts in several places."""
    first = min(one, two, key=lambda n: abs(n.distance))
    return replace(first, count=one.count + two.count, touching=one.touching + two.touching, miss=max(one.miss, two.miss))


def _path(index: int, asked: bool) -> KeyPath:
    """What to blame: the entry that governs, or the mesh where the user has written none."""
    return ("interfaces", index) if asked and index >= 0 else ("mesh",)


def _report(mesh: Mesh, pair: tuple[int, int], seen: Near, joined: bool, index: int, laws: Laws, asked: bool,
            problems: Problems) -> None:
    """What faces opposite each other mean for two parts that are joined elsewhere or not."""
    names = " and ".join(repr(mesh.volumes[v]) for v in pair)
    path, where = _path(index, asked), format_point(seen.where)
    if joined:
        if seen.touching:
            problems.add(path, f"{seen.touching} faces of {names} touch beside an interface of theirs and belong to none, the "
                         f"first at {where}: their nodes miss each other by up to {seen.miss:.3g}",
                         "faces that touch with nodes that coincide, all of them",
                         "mesh both sides alike where they touch; a contact over a gap needs gap: geometry")
        return
    how = (f"touch, at {where}: their nodes miss each other by up to {seen.miss:.3g}" if seen.touching
           else f"are {seen.distance:.3g} apart, at {where}")
    wanted = asked and index >= 0 and (seen.touching or not LAWS[laws.entries[index].law].perfect)
    if wanted:
        problems.add(path, f"{names} {how}, and have no interface there", "an interface between parts that the entry joins",
                     "mesh both sides alike; for a gap let the law read it (contact: gap: geometry); or name in between: "
                     "only the parts that are joined")
    else:
        problems.warnings.append(f"{names} {how}, without an interface: they may pass through each other")


def _beyond_reach(mesh: Mesh, pair: tuple[int, int], seen: Near, index: int, laws: Laws, problems: Problems) -> None:
    """Faces that look at each other, of parts that nothing connects, and that are too far apart to have been paired."""
    one, two = (mesh.volumes[v] for v in pair)
    reach = laws.reach(index)
    within = f"{reach:g}" if reach is not None else f"{laws.tolerance(index):g} of the element size, from surface to surface"
    problems.add(("interfaces", index), f"faces of {one!r} and {two!r} look at each other {max(seen.distance, 0.0):.3g} apart, at "
                 f"{format_point(seen.where)}, and are no pair: nothing connects the two", f"faces within {within}",
                 f"raise tolerance, move the parts, or say that they are none: exclude: [[{one}, {two}]]")


def _sagitta(mesh: Mesh, faces: Faces, solid: Solid) -> np.ndarray:
    """(k,) how far the surfaces are off a part's outer faces."""
    return sagittas(bulges(mesh.nodes, solid.outer, smooth_faces(mesh, faces)[faces.find(solid.outer[:, :3])]))


def _overlaps(mesh: Mesh, faces: Faces, piece: np.ndarray, governing: dict[tuple[int, int], int],
              laws: Laws, asked: bool, problems: Problems) -> set[tuple[int, int]]:
    """Pairs of parts, of pieces that share no faces, that are inside each other; each with its problem."""
    outer = faces.outer
    own = [np.unique(piece[mesh.volume == v]) for v in range(len(mesh.volumes))]
    solids: dict[int, Solid] = {}
    result = set()
    for pair, index in governing.items():
        if len(np.intersect1d(*(own[v] for v in pair))):
            continue
        for v in pair:
            if v not in solids:
                solids[v] = Solid.of(mesh.volumes[v], mesh.nodes, mesh.cells[mesh.volume == v],
                                     faces.triangles[outer[mesh.volume[faces.owner[outer]] == v]])
        found = overlap(*(solids[v] for v in pair))
        if found is not None:  # worth a closer look: curved faces of coarse chords may be meant to touch
            found = overlap(*(solids[v] for v in pair), tuple(_sagitta(mesh, faces, solids[v]) for v in pair))
        if found is None or (index >= 0 and laws.entries[index].fit >= found.depth):
            continue
        result.add(pair)
        names = " and ".join(repr(mesh.volumes[v]) for v in pair)
        problems.add(_path(index, asked),
                     f"{names} are inside each other by about {found.depth:.3g}, at {format_point(found.where)}",
                     "parts that touch or are apart",
                     "move the parts; a press fit is a gap of contact below zero between parts that touch")
    return result
