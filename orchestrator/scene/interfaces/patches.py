"""Interfaces: the faces two subdomains share, or that lie opposite each other; one per connected patch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.distances import paired_gap, tell_distances
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.hinges import hinges
from orchestrator.scene.interfaces.loose_pieces import report_loose_pieces
from orchestrator.scene.interfaces.mortar.sides import Matter
from orchestrator.scene.interfaces.neighbours import piece_of, report_neighbours
from orchestrator.scene.interfaces.overlap import Solid, overlap
from orchestrator.scene.interfaces.pairing import COINCIDE, REACH, Body, close_bodies, match, nearest, outer_bodies
from orchestrator.scene.interfaces.skins import Skins
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.partition.numbering import SplitNumbering
from orchestrator.scene.partition.partition import Partition

# Pairs of parts beyond which it is not said how far apart the nearest ones are.
MOST = 50


def make_interfaces(mesh: Mesh, faces: Faces, partition: Partition, numbering: SplitNumbering, entries: list[Any],
                    problems: Problems, asked: bool = True,
                    matter: Matter | None = None, factors: Sequence[Sequence[float]] = ()) -> tuple[list[Interface], list[tuple[int, int]]]:
    """Finds all interfaces, ordered by pair of subdomains, then by their lowest face; then those of opposite faces, then ``hinges``.

    Pairs that touch along an edge or in a node are one only where nothing else joins them there. All components count as free, see ``leave_free``.

    Parameters
    ----------
    entries : of ``interfaces:`` in the YAML
    asked : whether the user has written them; what is near without an interface is a mistake then
    matter : what chooses slaves where nodes do not match; None: such faces are no interface
    factors : per entry (steps,) what multiplies it

    Returns
    -------
    interfaces, and the pairs of volumes that are near each other without one
    """
    shared, sides, bounds = patches(faces, partition.subdomain)
    triangles, cells = _outward_of_first(faces, partition.subdomain, shared)
    laws = Laws(entries, [*partition.names, *mesh.volumes], factors)
    found: list[Interface] = []
    pairs: list[tuple[str, str]] = []
    cuts: list[tuple[str, str]] = []  # names of the two sides, between bodies and within one
    for first, last in zip(bounds[:-1], bounds[1:]):
        one, other = (int(i) for i in sides[first])
        names = partition.names[one], partition.names[other]
        known = _known_as(mesh, faces, partition, shared[first:last], names)
        whole = partition.body(one) == partition.body(other)  # cuts through a body are perfect, whatever the laws
        (cuts if whole else pairs).append(names)
        entry = -1 if whole else laws.between(*known)
        nodes, local = np.unique(triangles[first:last], return_inverse=True)
        own = tuple(numbering.find(np.int64(i), nodes) - numbering.offsets[i] for i in (one, other))
        found.append(Interface(len(found), " | ".join(names), (one, other), nodes, own,
                               local.reshape(-1, triangles.shape[1]), cells[first:last],
                               np.ones((len(nodes), 3), dtype=bool)))
        laws.apply(entry, found[-1], known[0])
        if laws.follows(entry):
            problems.add(("interfaces", entry, "pairing"), f"follow between {names[0]} and {names[1]}, which share faces of one mesh",
                         "bodies with meshes of their own: shared nodes are no faces to slide on",
                         "mesh each by itself (parts:, or a STEP file with conforming: false), or write pairing: fixed")
    count, piece = components(*sides.T, len(partition.names))
    if count > 1:
        report_loose_pieces(mesh, faces, piece[partition.subdomain], problems)
    bodies = outer_bodies(mesh, faces, partition.subdomain) if len(mesh.volumes) > 1 else []
    for interface, names in _opposite(mesh, faces, bodies, partition, numbering, laws, problems, matter if asked else None):
        interface.index = len(found)
        found.append(interface)
        pairs.append(names)
    for interface in hinges(mesh, partition, numbering, found, laws):
        interface.index = len(found)
        found.append(interface)
    laws.refuse_within(cuts, problems)
    if asked:
        laws.report_unused(list(dict.fromkeys(pairs)), piece_of(mesh, faces)[0], problems,
                           lambda entry: _how_far(mesh, bodies, partition, laws, entry))
    near = []
    if bodies and not problems.found:
        tell_distances(mesh, partition, numbering, found, laws, problems)
        near = report_neighbours(mesh, faces, bodies, found, partition, numbering, laws, asked, problems)
    return found, near


def patches(faces: Faces, subdomain: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shared faces grouped in patches connected through edges.

    Returns
    -------
    shared : (k,) int, indices of faces, patch after patch
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
    return (np.where(swapped[:, None], triangles[:, turned], triangles),
            np.where(swapped[:, None], cells[:, ::-1], cells))


def _known_as(mesh: Mesh, faces: Faces, partition: Partition, shared: np.ndarray,
              names: tuple[str, str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names each side of a patch goes by.

    Inside one volume only the subdomains' names count: a law for a part against all others is not meant for
    the cuts within that part.
    """
    if len(mesh.volumes) == 1:
        return (names[0],), (names[1],)
    beside = np.stack([faces.owner[shared], faces.neighbour[shared]])
    lower = partition.subdomain[beside].argmin(axis=0)
    columns = np.arange(len(shared))
    volumes = [np.unique(mesh.volume[beside[side, columns]]) for side in (lower, 1 - lower)]
    if len(np.intersect1d(*volumes)):
        return (names[0],), (names[1],)
    return tuple((name, *(mesh.volumes[v] for v in own)) for name, own in zip(names, volumes))


def _opposite(mesh: Mesh, faces: Faces, bodies: list[Body], partition: Partition, numbering: SplitNumbering,
              laws: Laws, problems: Problems, matter: Matter | None) -> Iterator[tuple[Interface, tuple[str, str]]]:
    """Interfaces of parts that share no faces there, and the names of their subdomains."""
    within, skins = max((e.reach or 0.0 for e in laws.entries), default=0.0), Skins(mesh, faces, bodies)
    for pair in close_bodies(bodies, within):
        names = tuple(partition.names[b.subdomain] for b in pair)
        known = tuple((name, mesh.volumes[b.volume]) for name, b in zip(names, pair))
        if laws.excluded(*known):
            continue
        index = laws.foreseen(*known)
        apart = laws.apart(index)
        patches, mismatch = match(*pair, bool(apart), laws.reach(index), laws.tolerance(index))
        if matter is not None and index >= 0:
            from orchestrator.scene.interfaces.nonmatching import nonmatching  # SciPy, only where it is asked for

            unmatched = list(nonmatching(mesh, pair, skins, patches, partition, numbering, laws, index, matter, problems))
            if unmatched:
                laws.between(*known)
                yield from ((interface, names) for interface in unmatched)
                continue
        if mismatch and (patches or not laws.found(index)):
            problems.add(("interfaces", index, apart), f"{mismatch.count} faces of {' | '.join(names)} lie opposite each "
                         f"other and do not match: nodes miss each other by up to {mismatch.distance:.3g} at "
                         f"{format_point(mismatch.point)}", f"nodes that project onto each other within {mismatch.tolerance:.3g}",
                         "mesh both sides alike, or lower within: to what is meant to touch")
        for patch in patches:
            laws.between(*known)
            nodes, at, local = np.unique(patch.triangles, return_index=True, return_inverse=True)
            others = patch.opposite.ravel()[at]
            own = tuple(numbering.find(np.int64(b.subdomain), ids) - numbering.offsets[b.subdomain]
                        for b, ids in zip(pair, (nodes, others)))
            interface = Interface(-1, " | ".join(names), tuple(b.subdomain for b in pair), nodes, own,
                                  local.reshape(patch.triangles.shape), patch.cells, np.ones((len(nodes), 3), dtype=bool))
            laws.apply(index, interface, known[0], paired_gap(mesh, interface, others, (index, apart), problems) if apart else None)
            yield interface, names


def _how_far(mesh: Mesh, bodies: list[Body], partition: Partition, laws: Laws, entry: Any) -> str:
    """How far apart the nearest nodes are of the parts that an entry names."""
    sides = [[b for b in bodies if laws.means(pattern, (partition.names[b.subdomain], mesh.volumes[b.volume]))]
             for pattern in entry.pair]
    found = [nearest(a, b) for a in sides[0] for b in sides[1] if a is not b and a.volume != b.volume]
    if not found or len(found) > MOST:
        return ""
    for a, b in product(*sides):
        solids = [Solid.of(mesh.volumes[v.volume], mesh.nodes, mesh.cells[mesh.volume == v.volume], v.triangles) for v in (a, b)]
        if a.volume != b.volume and (inside := overlap(*solids)) is not None:
            return f"; {solids[0].name} and {solids[1].name} are inside each other by about {inside.depth:.3g}, at {format_point(inside.where)}"
    distance, where, size = min(found, key=lambda f: f[0])
    allowed = (f"faces are sought within {entry.reach or REACH * size:.3g} along the normal"
               if entry.apart else f"nodes coincide within {COINCIDE * size:.3g}")
    return f"; their nearest nodes are {distance:.3g} apart, at {format_point(where)}, and {allowed}"
