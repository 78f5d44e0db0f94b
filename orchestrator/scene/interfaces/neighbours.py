"""Messages on parts that are near or in each other and have no interface there, by name and with
the distance.

- faces that touch beside an interface of the same parts and belong to none: a joint with a hole, an
error;
- parts that touch without any, or that are within reach though nothing connects them, however
indirectly: an error where
  an entry of ``interfaces:`` asks for a joint between them (across a gap, for one that opens), else
  a warning; parts of one connected structure may have a clearance;
- parts inside each other: an error, unless an entry has a press fit that deep;
- where pairs are found rather than named: parts that look at each other beyond reach while nothing
connects them, and parts
  without any pair: errors too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.config.boundary import ROUND
from orchestrator.errors import KeyPath, Problems, some
from orchestrator.kept import kept
from orchestrator.scene.interfaces.facing import COMMON
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.matching import match
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.opposite import (
    OPPOSITE, REACH, TOUCHING, BodyFaces, close_bodies, nearest, outer_bodies)
from orchestrator.scene.interfaces.overlap import Solid, overlap
from orchestrator.scene.interfaces.parts import paired_faces, Parts
from orchestrator.scene.interfaces.skins import over
from orchestrator.scene.mesh.faces import components, pack
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.interface import Beside, Interface

# search distance that is proposed, of the nearest faces' distance: chords of round faces vary
FARTHER = 1.5


@dataclass(frozen=True)
class Near:
    """Faces of two bodies that lie opposite each other.

    where : one of them is
    distance : of the nearest along the normal; negative inside the other
    touching : how many of the first body's touch
    miss : how far corners of those that touch are from the other's nearest corner, at most
    """

    where: np.ndarray
    distance: float
    touching: int
    miss: float


def report_neighbours(parts: Parts, laws: Laws, found: list[Interface],
                      problems: Problems) -> dict[tuple[int, int], Beside]:
    """Adds problems and warnings; returns the pairs of volumes that are near each other without an
    interface there.

    found : all interfaces
    """
    mesh = parts.mesh
    cells = [i.cells for i in found] + mesh.one_body
    joined = {tuple(pair)
              for pair in np.sort(mesh.volume[np.concatenate(cells)],
                                  axis=1).tolist()} if cells else set()
    beside, governing = _beside(parts, laws, found)
    count, piece = parts.pieces
    inside = _overlaps(parts, laws, governing, problems) if count > 1 else set()
    connected = components(*piece[np.concatenate(cells)].T, count)[1][piece] if cells else piece
    told, near = set(inside), {}
    for pair, seen in beside.items():
        entry, own = laws[governing[pair]], Problems()
        apart = not len(np.intersect1d(*(connected[mesh.volume == v] for v in pair)))
        # what faces beside a pair of theirs do later is looked at in the end
        enough = not seen.touching or bool(entry.apart) or entry.found
        if pair not in inside and apart and entry.found:
            told.add(pair)
            _beyond_reach(parts, laws, pair, seen, governing[pair], own)
        elif pair not in inside and (apart or not enough):
            _report(parts, laws, pair, seen, governing[pair], pair in joined, own)
        problems.found += own.found
        gap = "" if seen.touching or pair in inside else _gap(parts, pair, seen)
        near[pair] = Beside(gap, "".join(own.warnings))
    _report_alone(parts, laws, cells, told, problems)
    return near


def _gap(parts: Parts, pair: tuple[int, int], seen: Near) -> str:
    """A gap that nothing bridges."""
    one, two = (parts.mesh.volumes[v] for v in pair)
    return (
        f"{one} and {two} look at each other {seen.distance:.3g} apart, at "
        f"{format_point(seen.where)}, and nothing keeps them apart there: for contact across that "
        f"gap write within: {FARTHER * seen.distance:.2g} beside between: auto, or gap: geometry")


def _beside(parts: Parts, laws: Laws,
            found: list[Interface]) -> tuple[dict[tuple[int, int], Near],
                                             dict[tuple[int, int], int]]:
    """Faces, by pair of volumes, that are near without an interface, and the entry that governs."""
    paired = paired_faces(parts.numbering, found)
    loose = {
        id(b): np.flatnonzero(~np.isin(pack(b.triangles[:, :3], parts.numbering.total), paired))
        for b in parts.bodies}
    governing: dict[tuple[int, int], int] = {}
    beside: dict[tuple[int, int], Near] = {}
    for one, two in close_bodies(parts.bodies, None):
        pair = tuple(sorted((one.volume, two.volume)))
        known = parts.known(one), parts.known(two)
        index = laws.foreseen(*known)
        governing[pair] = max(index, governing.get(pair, -1))
        if laws.excluded(*known):
            continue  # it is not meant
        seen = _near(parts, one, two, loose[id(one)], loose[id(two)])
        if seen is None or (laws[index].apart and not laws[index].found and not seen.touching):
            continue  # what is apart the search for gaps has looked at
        beside[pair] = seen if pair not in beside else _both(beside[pair], seen)
    return beside, governing


@kept
def _near(parts: Parts, one: BodyFaces, two: BodyFaces, mine: np.ndarray,
          theirs: np.ndarray) -> Near | None:
    """Faces opposite each other among those (k,) int of either body; None: there are none.

    They are no farther apart than reach, or a little inside each other: rounding, coarse curves.
    What is told is the distance of the surfaces, as where pairs are sought: facets in a hole are
    nearer to the shank's. Those touch that are no farther apart than a share of the finer side's
    element size.
    """
    a, b = one.some(mine), two.some(theirs)
    found = find_segments(a, b, REACH * a.size, OPPOSITE)
    found = found.some((found.distance >= -TOUCHING * a.size[found.slave])
                       & (found.area >= COMMON * np.minimum(a.area[found.slave],
                                                            b.area[found.master])))
    i, j = found.slave, found.master
    if not len(i):
        return None
    bulges = parts.skins(one).surface.bulge[mine[i]], parts.skins(two).surface.bulge[theirs[j]]
    distance = found.distance - sum(over(bulge, at) for bulge, at in zip(bulges, found.middles))
    touches, at, worst = distance <= TOUCHING * np.minimum(a.size[i],
                                                           b.size[j]), int(
                                                               np.abs(distance).argmin()), 0.0
    if touches.any():
        apart = np.linalg.norm(a.corners[i[touches]][:, :, None] - b.corners[j[touches]][:, None],
                               axis=3).min(axis=2)
        best = np.full(len(a.area), np.inf)  # of the faces opposite one, that which fits best
        np.minimum.at(best, i[touches], apart.max(axis=1))
        worst = float(best[np.isfinite(best)].max())
    return Near(a.centre[i[at]], float(distance[at]), len(np.unique(i[touches])), worst)


def _both(one: Near, two: Near) -> Near:
    """Join what is near between the same parts in several places."""
    first = min(one, two, key=lambda n: abs(n.distance))
    return replace(first, touching=one.touching + two.touching, miss=max(one.miss, two.miss))


def _path(laws: Laws, index: int) -> KeyPath:
    """The key to blame: the entry that governs, or the mesh where the user has written none."""
    return ("interfaces", index) if laws.asked and index >= 0 else ("mesh",)


def _report(parts: Parts, laws: Laws, pair: tuple[int, int], seen: Near, index: int, joined: bool,
            problems: Problems) -> None:
    """Tell what faces opposite each other mean for two parts that are joined elsewhere or not."""
    names, path, where = " and ".join(repr(parts.mesh.volumes[v])
                                      for v in pair), _path(laws, index), format_point(seen.where)
    if joined:
        if seen.touching:
            problems.add(path,
                         f"{seen.touching} faces of {names} touch beside an interface of theirs "
                         f"and belong to none, the first at {where}: their nodes miss each other "
                         f"by up to {seen.miss:.3g}",
                         "faces that touch with nodes that coincide, all of them",
                         "mesh both sides alike where they touch; a contact over a gap needs gap: "
                         "geometry")
        return
    how = (f"touch, at {where}: their nodes miss each other by up to {seen.miss:.3g}"
           if seen.touching
           else f"are {seen.distance:.3g} apart, at {where}")
    wanted = laws.asked and index >= 0 and (seen.touching or not laws[index].kind.perfect)
    if wanted:
        problems.add(path, f"{names} {how}, and have no interface there",
                     "an interface between parts that the entry joins",
                     "mesh both sides alike; for a gap let the law read it (contact: gap: "
                     "geometry); or name in between: only the parts that are joined")
    else:
        problems.warnings.append(
            f"{names} {how}, without an interface: they may pass through each other")


def _beyond_reach(parts: Parts, laws: Laws, pair: tuple[int, int], seen: Near, index: int,
                  problems: Problems) -> None:
    """Faces that look at each other, of parts that nothing connects, and that are too far apart to
    have been paired.
    """
    one, two = (parts.mesh.volumes[v] for v in pair)
    reach = laws[index].reach
    within = (
        f"{reach:g}" if reach is not None
        else f"{laws.tolerance(index):g} of the element size, from surface to surface")
    wider = (f"write within: {FARTHER * seen.distance:.2g}" if hasattr(laws[index], "within")
             else "raise tolerance")
    problems.add(("interfaces", index),
                 f"faces of {one!r} and {two!r} look at each other {max(seen.distance, 0.0):.3g} "
                 f"apart, at {format_point(seen.where)}, and are no pair: nothing connects the two",
                 f"faces within {within}",
                 f"{wider}, move the parts, or say that they are none: exclude: [[{one}, {two}]]")


def _overlaps(parts: Parts, laws: Laws, governing: dict[tuple[int, int], int],
              problems: Problems) -> set[tuple[int, int]]:
    """Pairs of parts, of pieces that share no faces, that are inside each other; each with its
    problem.
    """
    mesh, (_, piece) = parts.mesh, parts.pieces
    own = [np.unique(piece[mesh.volume == v]) for v in range(len(mesh.volumes))]
    result = set()
    for pair, index in governing.items():
        found = parts.inside(*pair) if not len(np.intersect1d(*(own[v] for v in pair))) else None
        if found is None or ROUND * laws[index].fit >= found.depth:
            continue
        result.add(pair)
        problems.add(_path(laws, index),
                     f"{' and '.join(repr(mesh.volumes[v]) for v in pair)} are inside each other "
                     f"by about {found.depth:.3g}, at {format_point(found.where)}",
                     "parts that touch or are apart",
                     "move the parts; a press fit is a gap of contact below zero between "
                     "parts that touch")
    return result


def _report_alone(parts: Parts, laws: Laws, links: list[np.ndarray], told: set[tuple[int, int]],
                  problems: Problems) -> None:
    """Add, where pairs are found rather than named, a problem for each piece without any, with the
    nearest other part.

    links : (k, 2) int each, cells on both sides of the interfaces
    told : pairs of volumes that have been complained of already
    """
    mesh, (_, piece) = parts.mesh, parts.pieces
    index = next((i for i, entry in enumerate(laws.entries) if entry.found), -1)
    if index < 0:
        return
    paired = np.unique(piece[np.concatenate(links)]) if links else np.empty(0, dtype=int)
    known = {v for pair in told for v in pair}
    for number in np.setdiff1d(piece, paired):
        own = [int(v) for v in np.unique(mesh.volume[piece == number])]
        others = [(b, c) for b in parts.bodies if b.volume in own for c in parts.bodies
                  if c.volume not in own
                  and not laws.excluded(parts.known(b), parts.known(c))]
        if not others or known & set(own):
            continue
        (distance, where, size), other = min(((nearest(b, c), c) for b, c in others),
                                             key=lambda found: found[0][0])
        problems.add(("interfaces", index),
                     f"{some([mesh.volumes[v] for v in own])} has no pair: the nearest other part "
                     f"is {mesh.volumes[other.volume]!r}, {distance:.3g} from node to node, at "
                     f"{format_point(where)}, where elements measure "
                     f"{size:.3g}", "parts that lie on some other one",
                     "move it, raise tolerance, or say that it is meant to be alone: "
                     f"exclude: [[{mesh.volumes[own[0]]}, '*']]")


def report_loose_pieces(parts: Parts, piece: np.ndarray, problems: Problems) -> None:
    """Adds a problem where pieces of a volume are inside each other, and a warning where they
    touch: laws between volumes do
    not reach them.

    piece : (m,) int, of each tet
    """
    mesh = parts.mesh
    own = [set(np.unique(mesh.volume[piece == p]).tolist()) for p in range(int(piece.max()) + 1)]
    foreign = {stand.volume for stand in mesh.foreign}
    apart = replace(mesh, volume=piece, volumes=[str(p) for p in range(len(own))], foreign=[])
    for one, two in close_bodies(outer_bodies(apart, parts.faces, piece), None):
        common = own[one.volume] & own[two.volume] - foreign
        if not common:
            continue
        name = mesh.volumes[min(common)]
        inside = overlap(*(Solid(mesh.nodes, mesh.cells[piece == b.volume], b.triangles)
                           for b in (one, two)))
        if inside is not None:
            problems.add(("mesh",),
                         f"two pieces of {name!r}, which share no faces, are inside each other by "
                         f"about {inside.depth:.3g}, at {format_point(inside.where)}",
                         "pieces that are apart",
                         "leave out what is there twice")
        elif touching := match(one, two):
            problems.warnings.append(
                f"two pieces of {name!r} touch, at "
                f"{format_point(mesh.nodes[touching[0].triangles[0, :3]].mean(axis=0))}, with "
                "nodes of their own: nothing joins them there; merge the nodes that coincide, or "
                "give each piece a volume of its own")
