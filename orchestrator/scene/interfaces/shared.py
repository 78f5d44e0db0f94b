"""Interfaces of nodes that subdomains share: by faces, one per connected patch; by an edge or a
corner alone.

Around a node of a body that is solid there, faces lead from each tet to every other one, and with
them interfaces from each subdomain to every other one. Where bodies touch along an edge or in a
corner they do not: what one mesh holds together by shared nodes would come apart where a cut
passes. There the subdomains get an interface of these nodes, without faces (``hinges``). Laws other
than the perfect one act on areas: along an edge they do nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.parts import bonded, Parts
from orchestrator.scene.mesh.faces import by_label, components, edge_patches, Faces, renumbered
from orchestrator.scene.mesh.quadratic import TET_EDGES


def shared_faces(parts: Parts, laws: Laws, problems: Problems) -> list[Interface]:
    """Return the interfaces of faces that two subdomains share; cuts through a body are perfect,
    whatever the laws."""
    faces, partition, found = parts.faces, parts.partition, []
    shared, sides, bounds = patches(faces, partition.subdomain)
    triangles, cells = _outward_of_first(faces, partition.subdomain, shared)
    for first, last in zip(bounds[:-1], bounds[1:]):
        one, two = (int(i) for i in sides[first])
        known = _known_as(parts, shared[first:last], (one, two))
        entry = -1 if partition.body(one) == partition.body(two) else laws.between(*known)
        nodes, local = renumbered(triangles[first:last])
        found.append(parts.interface((one, two), (nodes, nodes), local, cells[first:last],
                                     called=known))
        laws.apply(entry, found[-1])
        if laws[entry].follows:
            problems.add(
                ("interfaces", entry, "pairing"),
                f"follow between {' and '.join(parts.names((one, two)))}, which share faces of one "
                "mesh", "bodies with meshes of their own: shared nodes are no faces to slide on",
                "mesh each by itself (parts:, or a STEP file with conforming: false), or write "
                "pairing: fixed")
    return found


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
    pair = np.unique(sides[:, 0] * (subdomain.max() + np.int64(1)) + sides[:, 1],
                     return_inverse=True)[1]
    patch = edge_patches(faces.triangles[shared], pair)[1]
    order = np.lexsort((patch, pair))
    bounds = np.flatnonzero(np.r_[True, np.diff(patch[order]) != 0, True])
    return shared[order], sides[order], bounds


def _outward_of_first(faces: Faces, subdomain: np.ndarray,
                      shared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (k, 3 or 6) of faces, seen from outside the lower subdomain, and cells (k, 2), its
    own first.
    """
    triangles = faces.triangles[shared]
    turned = [0, 2, 1, 5, 4, 3][: triangles.shape[1]]
    cells = np.c_[faces.owner[shared], faces.neighbour[shared]]
    swapped = subdomain[cells[:, 0]] > subdomain[cells[:, 1]]
    return (np.where(swapped[:, None], triangles[:, turned], triangles),
            np.where(swapped[:, None], cells[:, ::-1], cells))


def _known_as(parts: Parts, shared: np.ndarray,
              sides: tuple[int, int]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names each side of a patch goes by."""
    faces = parts.faces
    beside = np.stack([faces.owner[shared], faces.neighbour[shared]])
    lower, columns = parts.partition.subdomain[beside].argmin(axis=0), np.arange(len(shared))
    return parts.called(sides,
                        [np.unique(parts.mesh.volume[beside[side, columns]])
                         for side in (lower, 1 - lower)])


def hinges(parts: Parts, laws: Laws, found: Sequence[Interface]) -> list[Interface]:
    """Interfaces that join what no others do, ordered by pair of subdomains; with them, what moves
    as one does.

    found : those of faces
    """
    partition, numbering = parts.partition, parts.numbering
    owner = np.repeat(np.arange(len(partition.names)), np.diff(numbering.offsets))
    copies = np.bincount(numbering.nodes, minlength=numbering.total)
    label = bonded(numbering, found)
    lowest, highest = np.full(numbering.total, len(label)), np.full(numbering.total, -1)
    np.minimum.at(lowest, numbering.nodes, label)
    np.maximum.at(highest, numbering.nodes, label)
    apart = np.flatnonzero((lowest < highest)[numbering.nodes])
    if not len(apart):
        return []
    # copies of a node one after the other, by subdomain
    apart = apart[np.argsort(numbering.nodes[apart], kind="stable")]
    node, made = numbering.nodes[apart], []
    steps = range(1, int(copies[node].max()))
    first = [np.flatnonzero(node[step:] == node[:-step]) for step in steps]
    one, two = apart[np.concatenate(first)], apart[
        np.concatenate([f + step for f, step in zip(first, steps)])]
    pairs, which = np.unique(np.c_[owner[one], owner[two]], axis=0, return_inverse=True)
    around, corners = _Around(parts, apart), 3 if numbering.corners.shape[1] == 4 else 6
    for pair, at in zip(pairs.tolist(), by_label(which.ravel())):
        a, b = one[at], two[at]
        entry, known = -1, ((), ())
        if partition.body(pair[0]) != partition.body(pair[1]):
            known = around.known(pair, (a, b))
            entry = laws.foreseen(*known)
            if not laws[entry].kind.perfect:
                continue
        loose = label[a] != label[b]
        a, b = a[loose], b[loose]
        if not len(a):
            continue
        laws.between(*known)
        # of no facet, and of any normal: bonds ask none
        nodes = numbering.nodes[around.with_ends(a)]
        made.append(parts.interface(
            tuple(pair), (nodes, nodes), np.empty((0, corners), dtype=int),
            np.empty((0, 2), dtype=int), called=known,
            normals=np.tile([1.0, 0, 0], (len(nodes), 1))))
        laws.apply(entry, made[-1])
        joined = components(label[a], label[b], len(label))[1]
        label = joined[label]
    return made


class _Around:
    """Surroundings of some split nodes (k,): the volumes, and with ten-node tets the ends of the
    edges that they are amid.
    """

    def __init__(self, parts: Parts, split: np.ndarray):
        self.parts, numbering = parts, parts.numbering
        chosen = np.zeros(len(numbering.nodes), dtype=bool)
        chosen[split] = True
        cell, corner = np.nonzero(chosen[numbering.corners])
        self.split, self.volume = np.unique(np.c_[numbering.corners[cell, corner],
                                                  parts.mesh.volume[cell]], axis=0).T
        cell, corner = cell[corner > 3], corner[corner > 3]
        self.middle, at = np.unique(numbering.corners[cell, corner], return_index=True)
        self.ends = numbering.corners[cell[at, None], TET_EDGES[corner[at] - 4]]

    def with_ends(self, split: np.ndarray) -> np.ndarray:
        """Split nodes of one side and, ascending, the ends of edges of which they have the middle:
        soles need them.
        """
        return np.unique(np.concatenate([split, self.ends[np.isin(self.middle, split)].ravel()]))

    def known(self, pair: tuple[int, int],
              split: Sequence[np.ndarray]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of both sides at their split nodes."""
        return self.parts.called(pair,
                                 [np.unique(self.volume[np.isin(self.split, at)]) for at in split])
