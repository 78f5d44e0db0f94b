"""Interfaces: the faces two subdomains share, or that lie opposite each other; one per connected patch."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from orchestrator.scene.interfaces.distances import paired_gap, tell_distances
from orchestrator.scene.interfaces.hinges import hinges
from orchestrator.scene.interfaces.neighbours import report_loose_pieces, report_neighbours
from orchestrator.scene.interfaces.overlap import Solid, overlap
from orchestrator.scene.interfaces.pairing import COINCIDE, REACH, close_bodies, match, nearest
from orchestrator.scene.interfaces.search import Search
from orchestrator.scene.interfaces.skins import Skins
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Interface

# Pairs of parts beyond which it is not said how far apart the nearest ones are.
MOST = 50


def make_interfaces(search: Search) -> tuple[list[Interface], list[tuple[int, int]]]:
    """Finds all interfaces, ordered by pair of subdomains, then by their lowest face; then those of opposite faces, then ``hinges``.

    Pairs that touch along an edge or in a node are one only where nothing else joins them there. All components count as
    free, see ``leave_free``.

    Returns interfaces, and the pairs of volumes that are near each other without one
    """
    laws, partition, problems = search.laws, search.partition, search.problems
    found, near = _shared(search), []
    _report_loose(search, found)
    found += _opposite(search)
    within = [partition.body(one) == partition.body(two) for one, two in (i.subdomains for i in found)]
    cuts, pairs = ([search.names(i.subdomains) for i, cut in zip(found, within) if cut == wanted] for wanted in (True, False))
    found += hinges(search, found)
    for number, interface in enumerate(found):
        interface.index = number
    laws.refuse_within(cuts, problems)
    if search.asked:
        laws.report_unused(list(dict.fromkeys(pairs)), search.pieces[0], problems, lambda entry: _how_far(search, entry))
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
        known = _known_as(search, shared[first:last], search.names((one, two)))
        entry = -1 if partition.body(one) == partition.body(two) else laws.between(*known)
        nodes, local = np.unique(triangles[first:last], return_inverse=True)
        found.append(search.interface((one, two), (nodes, nodes), local.reshape(-1, triangles.shape[1]), cells[first:last]))
        laws.apply(entry, found[-1], known[0])
        if laws.follows(entry):
            search.problems.add(("interfaces", entry, "pairing"), f"follow between {' and '.join(search.names((one, two)))}, which share "
                                "faces of one mesh", "bodies with meshes of their own: shared nodes are no faces to slide on",
                                "mesh each by itself (parts:, or a STEP file with conforming: false), or write pairing: fixed")
    return found


def _report_loose(search: Search, shared: list[Interface]) -> None:
    """Pieces of one volume that no faces connect."""
    sides = np.array([i.subdomains for i in shared], dtype=int).reshape(-1, 2)
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
    size = len(shared)
    if size == 0:
        return shared, sides, np.zeros(1, dtype=int)
    pair = np.unique(sides[:, 0] * (subdomain.max() + np.int64(1)) + sides[:, 1], return_inverse=True)[1]
    corners = np.sort(faces.triangles[shared, :3], axis=1)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])
    keys = np.unique(edges[:, 0] * np.int64(faces.nodes) + edges[:, 1], return_inverse=True)[1]
    # Two pairs may meet at an edge: it must not join their patches.
    edge = np.unique(np.tile(pair, 3) * (keys.max() + np.int64(1)) + keys, return_inverse=True)[1]
    # Facets and edges are the two kinds of vertices of one graph.
    patch = components(np.tile(np.arange(size), 3), size + edge, size + int(edge.max()) + 1)[1][:size]
    lowest = np.full(patch.max() + 1, size)
    np.minimum.at(lowest, patch, np.arange(size))
    order = np.lexsort((np.arange(size), lowest[patch], pair))
    bounds = np.flatnonzero(np.r_[True, np.diff(patch[order]) != 0, True])
    return shared[order], sides[order], bounds


def _outward_of_first(faces: Faces, subdomain: np.ndarray, shared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (k, 3 or 6) of faces, seen from outside the lower subdomain, and cells (k, 2), its own first."""
    triangles = faces.triangles[shared]
    turned = [0, 2, 1, 5, 4, 3][: triangles.shape[1]]
    cells = np.c_[faces.owner[shared], faces.neighbour[shared]]
    swapped = subdomain[cells[:, 0]] > subdomain[cells[:, 1]]
    return (np.where(swapped[:, None], triangles[:, turned], triangles), np.where(swapped[:, None], cells[:, ::-1], cells))


def _known_as(search: Search, shared: np.ndarray, names: tuple[str, str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names each side of a patch goes by.

    Inside one volume only the subdomains' names count: a law for a part against all others is not meant for
    the cuts within that part.
    """
    mesh, faces = search.mesh, search.faces
    if len(mesh.volumes) == 1:
        return (names[0],), (names[1],)
    beside = np.stack([faces.owner[shared], faces.neighbour[shared]])
    lower = search.partition.subdomain[beside].argmin(axis=0)
    columns = np.arange(len(shared))
    volumes = [np.unique(mesh.volume[beside[side, columns]]) for side in (lower, 1 - lower)]
    if len(np.intersect1d(*volumes)):
        return (names[0],), (names[1],)
    return tuple((name, *(mesh.volumes[v] for v in own)) for name, own in zip(names, volumes))


def _opposite(search: Search) -> Iterator[Interface]:
    """Interfaces of parts that share no faces there."""
    laws = search.laws
    within, skins = max((e.reach or 0.0 for e in laws.entries), default=0.0), Skins(search.mesh, search.faces, search.bodies)
    for pair in close_bodies(search.bodies, within):
        known = tuple(map(search.known, pair))
        if laws.excluded(*known):
            continue
        index = laws.foreseen(*known)
        apart = laws.apart(index)
        patches, mismatch = match(*pair, bool(apart), laws.reach(index), laws.tolerance(index))
        if search.asked and search.matter is not None and index >= 0:
            from orchestrator.scene.interfaces.nonmatching import nonmatching  # SciPy, only where it is asked for

            unmatched = list(nonmatching(search, pair, skins, patches, index))
            if unmatched:
                laws.between(*known)
                yield from unmatched
                continue
        if mismatch and (patches or not laws.found(index)):
            search.problems.add(("interfaces", index, apart), f"{mismatch.count} faces of {known[0][0]} | {known[1][0]} lie opposite each "
                                f"other and do not match: nodes miss each other by up to {mismatch.distance:.3g} at "
                                f"{format_point(mismatch.point)}", f"nodes that project onto each other within {mismatch.tolerance:.3g}",
                                "mesh both sides alike, or lower within: to what is meant to touch")
        for patch in patches:
            laws.between(*known)
            nodes, at, local = np.unique(patch.triangles, return_index=True, return_inverse=True)
            others = patch.opposite.ravel()[at]
            interface = search.interface(tuple(b.subdomain for b in pair), (nodes, others), local.reshape(patch.triangles.shape),
                                         patch.cells)
            laws.apply(index, interface, known[0], paired_gap(search, interface, (index, apart)) if apart else None)
            yield interface


def _how_far(search: Search, entry: Any) -> str:
    """How far apart the nearest nodes are of the parts that an entry names."""
    mesh = search.mesh
    sides = [[b for b in search.bodies if search.laws.means(pattern, search.known(b))] for pattern in entry.pair]
    found = [nearest(a, b) for a, b in product(*sides) if a is not b and a.volume != b.volume]
    if not found or len(found) > MOST:
        return ""
    for a, b in product(*sides):
        solids = [Solid.of(mesh.volumes[v.volume], mesh.nodes, mesh.cells[mesh.volume == v.volume], v.triangles) for v in (a, b)]
        if a.volume != b.volume and (inside := overlap(*solids)) is not None:
            return f"; {solids[0].name} and {solids[1].name} are inside each other by about {inside.depth:.3g}, " \
                   f"at {format_point(inside.where)}"
    distance, where, size = min(found, key=lambda f: f[0])
    allowed = (f"faces are sought within {entry.reach or REACH * size:.3g} along the normal"
               if entry.apart else f"nodes coincide within {COINCIDE * size:.3g}")
    return f"; their nearest nodes are {distance:.3g} apart, at {format_point(where)}, and {allowed}"
