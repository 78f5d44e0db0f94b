"""Interfaces: the faces two subdomains share, or that lie opposite each other; one per connected patch."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from orchestrator.errors import some
from orchestrator.scene.interfaces.distances import paired_gap, tell_distances
from orchestrator.scene.interfaces.hinges import hinges
from orchestrator.scene.interfaces.matching import Patch, match
from orchestrator.scene.interfaces.neighbours import report_loose_pieces, report_neighbours
from orchestrator.scene.interfaces.facing import nonmatching
from orchestrator.scene.interfaces.opposite import COINCIDE, REACH, Body, close_bodies, nearest
from orchestrator.scene.interfaces.search import Search
from orchestrator.scene.mesh.faces import Faces, components, edge_patches
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.overview import Beside
from orchestrator.scene.names import suggestion

# Pairs of parts beyond which it is not said how far apart the nearest ones are.
MOST = 50


def make_interfaces(search: Search) -> tuple[list[Interface], dict[tuple[int, int], Beside]]:
    """Finds all interfaces, ordered by pair of subdomains, then by their lowest face; then those of opposite faces, then ``hinges``.

    Pairs that touch along an edge or in a node are one only where nothing else joins them there. All components count as
    free, see ``leave_free``.

    Returns interfaces, and the pairs of volumes that are near each other without one, as ``report_neighbours``
    """
    laws, partition, problems = search.laws, search.partition, search.problems
    found, near = _shared(search), {}
    _report_loose(search, found)
    found += _opposite(search)
    within = [partition.body(one) == partition.body(two) for one, two in (i.subdomains for i in found)]
    cuts, pairs = ([search.names(i.subdomains) for i, cut in zip(found, within) if cut == wanted] for wanted in (True, False))
    found += hinges(search, found)
    for number, interface in enumerate(found):
        interface.index = number
    laws.refuse_within(cuts, problems)
    if search.asked:
        _report_unused(search, list(dict.fromkeys(pairs)))
    if search.bodies and not problems.found:
        tell_distances(search, found)
        near = report_neighbours(search, found)
    return found, near


def _shared(search: Search) -> list[Interface]:
    """Interfaces of faces that two subdomains share; cuts through a body are perfect, whatever the laws."""
    faces, partition, laws = search.faces, search.partition, search.laws
    shared, sides, bounds = patches(faces, partition.subdomain)
    triangles, cells = _outward_of_first(faces, partition.subdomain, shared)
    found: list[Interface] = []
    for first, last in zip(bounds[:-1], bounds[1:]):
        one, two = (int(i) for i in sides[first])
        known = _known_as(search, shared[first:last], (one, two))
        entry = -1 if partition.body(one) == partition.body(two) else laws.between(*known)
        nodes, local = np.unique(triangles[first:last], return_inverse=True)
        found.append(search.interface((one, two), (nodes, nodes), local.reshape(-1, triangles.shape[1]), cells[first:last],
                                      called=known))
        laws.apply(entry, found[-1])
        if laws[entry].follows:
            search.problems.add(("interfaces", entry, "pairing"), f"follow between {' and '.join(search.names((one, two)))}, which share "
                                "faces of one mesh", "bodies with meshes of their own: shared nodes are no faces to slide on",
                                "mesh each by itself (parts:, or a STEP file with conforming: false), or write pairing: fixed")
    return found


def _report_loose(search: Search, shared: list[Interface]) -> None:
    """Pieces of one volume that no faces connect."""
    sides = ends_of(shared)
    count, piece = components(*sides.T, len(search.partition.names))
    if count > 1:
        report_loose_pieces(search, piece[search.partition.subdomain])


def patches(faces: Faces, subdomain: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shared faces grouped in patches connected through edges.

    Returns shared : (k,) int, indices of faces, patch after patch
    sides : (k, 2) int, the two subdomains, ascending
    bounds : (p + 1,) int, where each patch starts in ``shared``
    """
    inner = faces.inner
    sides = np.sort(np.c_[subdomain[faces.owner[inner]], subdomain[faces.neighbour[inner]]], axis=1)
    cut = sides[:, 0] != sides[:, 1]
    shared, sides = inner[cut], sides[cut]
    if not len(shared):
        return shared, sides, np.zeros(1, dtype=int)
    pair = np.unique(sides[:, 0] * (subdomain.max() + np.int64(1)) + sides[:, 1], return_inverse=True)[1]
    patch = edge_patches(faces.triangles[shared], pair)[1]
    order = np.lexsort((patch, pair))
    bounds = np.flatnonzero(np.r_[True, np.diff(patch[order]) != 0, True])
    return shared[order], sides[order], bounds


def _outward_of_first(faces: Faces, subdomain: np.ndarray, shared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (k, 3 or 6) of faces, seen from outside the lower subdomain, and cells (k, 2), its own first."""
    triangles = faces.triangles[shared]
    turned = [0, 2, 1, 5, 4, 3][: triangles.shape[1]]
    cells = np.c_[faces.owner[shared], faces.neighbour[shared]]
    swapped = subdomain[cells[:, 0]] > subdomain[cells[:, 1]]
    return (np.where(swapped[:, None], triangles[:, turned], triangles), np.where(swapped[:, None], cells[:, ::-1], cells))


def _known_as(search: Search, shared: np.ndarray, sides: tuple[int, int]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names each side of a patch goes by."""
    faces = search.faces
    beside = np.stack([faces.owner[shared], faces.neighbour[shared]])
    lower, columns = search.partition.subdomain[beside].argmin(axis=0), np.arange(len(shared))
    return search.called(sides, [np.unique(search.mesh.volume[beside[side, columns]]) for side in (lower, 1 - lower)])


def _opposite(search: Search) -> Iterator[Interface]:
    """Interfaces of parts that share no faces there."""
    laws = search.laws
    for pair in close_bodies(search.bodies, max((e.reach or 0.0 for e in laws.entries), default=0.0)):
        known = tuple(map(search.known, pair))
        if laws.excluded(*known):
            continue
        index = laws.foreseen(*known)
        apart = laws[index].apart
        patches = match(*pair, bool(apart), laws[index].reach, laws.tolerance(index), search.hidden(*pair))
        unmatched = list(nonmatching(search, pair, patches, index)) if search.asked and search.matter is not None and index >= 0 else []
        if unmatched or patches:
            laws.between(*known)
        yield from unmatched
        for patch in patches if not unmatched else []:
            nodes, at, local = np.unique(patch.triangles, return_index=True, return_inverse=True)
            others = patch.opposite.ravel()[at]
            interface = search.interface(tuple(b.subdomain for b in pair), (nodes, others), local.reshape(patch.triangles.shape),
                                         patch.cells, called=known)
            if search.skins.given(pair[0]) is not None:
                known = search.skins(pair[0]).surface.normals
                interface.given = known[patch.facets[:, 0]]
            gap = paired_gap(search, interface, (index, apart), _filled(search, pair, patch)) if apart else None
            laws.apply(index, interface, gap)
            yield interface


def _filled(search: Search, pair: tuple[Body, Body], patch: Patch) -> np.ndarray:
    """(k, 3) what the surfaces of both sides fill of the gap amid the edges of a patch's facets; of three-node ones nothing."""
    if patch.triangles.shape[1] == 3:
        return np.zeros((len(patch.triangles), 3))
    one, two = (search.skins(body).surface.bulge[facets] for body, facets in zip(pair, patch.facets.T))
    behind = pair[1].triangles[patch.facets[:, 1], 3:]
    return one + np.take_along_axis(two, (patch.opposite[:, 3:, None] == behind[:, None, :]).argmax(axis=2), axis=1)


def _report_unused(search: Search, pairs: list[tuple[str, str]]) -> None:
    """Adds a problem for each entry that matched no interface; one for all parts may, where there are no two.

    pairs : names of the two sides of existing interfaces, for the cure
    """
    laws, problems = search.laws, search.problems
    for i, (entry, used) in enumerate(zip(laws.entries, laws.used)):
        for key, pattern in [*((("exclude", k), p) for k, two in enumerate(entry.exclude or []) for p in two), (("slave",), entry.slave)]:
            if pattern is not None and not laws.meant(pattern):
                problems.add(("interfaces", i, *key), f"{pattern!r} matches no subdomain and no volume",
                             "names of parts, shell wildcards allowed", suggestion(pattern, laws.names, "part"))
        everything = entry.pair == ("*", "*")
        if used or entry.found or entry.tool is not None or (everything and search.pieces[0] < 2):
            continue  # of pairs that are found, ``report_neighbours`` says which are missing
        where = entry.apart or "between"
        if unknown := [p for p in entry.pair if not laws.meant(p)]:
            where, found = "between", f"{' and '.join(repr(p) for p in unknown)} matches no subdomain and no volume"
            cure = "; ".join(suggestion(p, laws.names, "part") for p in unknown)
        elif everything:
            found = f"no interface in all the scene: its {search.pieces[0]} separate pieces share no face" + _how_far(search, entry)
            cure = ("mesh what touches alike on both sides; for gaps, let the law read them (contact: "
                    "gap: geometry); for parts that have nothing to do with each other leave interfaces out")
        else:
            found = f"no interface between {entry.pair[0]!r} and {entry.pair[1]!r}: they share no face" + _how_far(search, entry)
            beside = [pair for pair in pairs if any(laws.means(p, pair) for p in entry.pair if p != "*")] or pairs
            cure = "interfaces exist between " + some([" | ".join(b) for b in beside], 6) if pairs else "there are no interfaces at all"
        problems.add(("interfaces", i, where), found,
                     "names of two parts that share faces, or have opposite faces with matching nodes; shell wildcards allowed", cure)


def _how_far(search: Search, entry: Any) -> str:
    """Distance of the nearest nodes of the parts that an entry names."""
    sides = [[b for b in search.bodies if search.laws.means(pattern, search.known(b))] for pattern in entry.pair]
    pairs = [(a, b) for a, b in product(*sides) if a.volume != b.volume]
    if not pairs or len(pairs) > MOST:
        return ""
    for a, b in pairs:
        if (inside := search.inside(a.volume, b.volume)) is not None:
            return f"; {search.mesh.volumes[a.volume]} and {search.mesh.volumes[b.volume]} are inside each other by about " \
                   f"{inside.depth:.3g}, at {format_point(inside.where)}"
    distance, where, size = min((nearest(a, b) for a, b in pairs), key=lambda f: f[0])
    allowed = (f"faces are sought within {entry.reach or REACH * size:.3g} along the normal"
               if entry.apart else f"nodes coincide within {COINCIDE * size:.3g}")
    return f"; their nearest nodes are {distance:.3g} apart, at {format_point(where)}, and {allowed}"
