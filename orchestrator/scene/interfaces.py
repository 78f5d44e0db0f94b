"""Interfaces: the faces two subdomains share, one per connected patch."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.faces import Faces, components
from orchestrator.scene.laws import Laws
from orchestrator.scene.model import Interface, Mesh
from orchestrator.scene.numbering import SplitNumbering
from orchestrator.scene.partition import Partition


def make_interfaces(mesh: Mesh, faces: Faces, partition: Partition, numbering: SplitNumbering, fixed: np.ndarray,
                    entries: list[Any], problems: Problems) -> list[Interface]:
    """Finds all interfaces, ordered by pair of subdomains, then by their lowest face.

    Pairs that touch along an edge or in a node are none. Patches on which everything is prescribed are
    left out: nothing is to be found there.

    Parameters
    ----------
    fixed : (n, 3) bool, prescribed components
    entries : of ``interfaces:`` in the YAML
    """
    shared, sides, bounds = patches(faces, partition.subdomain)
    triangles, cells = _outward_of_first(faces, partition.subdomain, shared)
    laws = Laws(entries)
    found: list[Interface] = []
    pairs: list[tuple[str, str]] = []
    for first, last in zip(bounds[:-1], bounds[1:]):
        one, other = (int(i) for i in sides[first])
        names = partition.names[one], partition.names[other]
        pairs.append(names)
        known = _known_as(mesh, faces, partition, shared[first:last], names)
        entry = laws.between(*known)
        nodes, local = np.unique(triangles[first:last], return_inverse=True)
        free = ~fixed[nodes]
        if not free.any():
            continue
        own = tuple(numbering.find(np.int64(i), nodes) - numbering.offsets[i] for i in (one, other))
        found.append(Interface(len(found), " | ".join(names), (one, other), nodes, own, local.reshape(-1, 3), cells[first:last],
                               free))
        laws.apply(entry, found[-1], known[0])
    laws.report_unused([*partition.names, *mesh.volumes], list(dict.fromkeys(pairs)), problems)
    _number_patches(found)
    return found


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
    corners = np.sort(faces.triangles[shared], axis=1)
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
    """Triangles (k, 3) of faces, seen from outside the lower subdomain, and cells (k, 2), its own first."""
    triangles = faces.triangles[shared]
    cells = np.c_[faces.owner[shared], faces.neighbour[shared]]
    swapped = subdomain[cells[:, 0]] > subdomain[cells[:, 1]]
    return (np.where(swapped[:, None], triangles[:, [0, 2, 1]], triangles),
            np.where(swapped[:, None], cells[:, ::-1], cells))


def _known_as(mesh: Mesh, faces: Faces, partition: Partition, shared: np.ndarray,
              names: tuple[str, str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names each side of a patch goes by.

    Inside one volume only the subdomains' names count: a law for a part against all others is not meant for
    the cuts within that part.
    """
    beside = np.stack([faces.owner[shared], faces.neighbour[shared]])
    lower = partition.subdomain[beside].argmin(axis=0)
    columns = np.arange(len(shared))
    volumes = [np.unique(mesh.volume[beside[side, columns]]) for side in (lower, 1 - lower)]
    if len(np.intersect1d(*volumes)):
        return (names[0],), (names[1],)
    return tuple((name, *(mesh.volumes[v] for v in own)) for name, own in zip(names, volumes))


def _number_patches(found: list[Interface]) -> None:
    """Adds "(patch 1)", "(patch 2)" … to the names of pairs that touch in several places."""
    by_pair: dict[tuple[int, int], list[Interface]] = {}
    for interface in found:
        by_pair.setdefault(interface.subdomains, []).append(interface)
    for group in by_pair.values():
        if len(group) > 1:
            for number, interface in enumerate(group, start=1):
                interface.name += f" (patch {number})"
