"""Interfaces of subdomains that hang together by nodes alone: by an edge or a corner that they share, and no face.

Around a node of a body that is solid there, faces lead from each tet to every other one, and with them interfaces from each
subdomain to every other one. Where bodies touch along an edge or in a corner they do not: what one mesh holds together by
shared nodes would come apart where a cut passes. There the subdomains get an interface of these nodes, without faces.
Laws other than the perfect one act on areas: along an edge they do nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.registry import LAWS
from orchestrator.scene.interfaces.search import Search, bonded
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.interface import Interface


def hinges(search: Search, found: Sequence[Interface]) -> list[Interface]:
    """Interfaces that join what no others do, ordered by pair of subdomains; with them, what moves as one does.

    found : those of faces
    """
    partition, numbering, laws = search.partition, search.numbering, search.laws
    owner = np.repeat(np.arange(len(partition.names)), np.diff(numbering.offsets))
    copies = np.bincount(numbering.nodes, minlength=numbering.total)
    label = bonded(numbering, found)
    lowest, highest = np.full(numbering.total, len(label)), np.full(numbering.total, -1)
    np.minimum.at(lowest, numbering.nodes, label)
    np.maximum.at(highest, numbering.nodes, label)
    apart = np.flatnonzero((lowest < highest)[numbering.nodes])
    if not len(apart):
        return []
    apart = apart[np.argsort(numbering.nodes[apart], kind="stable")]  # copies of a node one after the other, by subdomain
    node, made = numbering.nodes[apart], []
    steps = range(1, int(copies[node].max()))
    first = [np.flatnonzero(node[step:] == node[:-step]) for step in steps]
    one, two = apart[np.concatenate(first)], apart[np.concatenate([f + step for f, step in zip(first, steps)])]
    pairs, which = np.unique(np.c_[owner[one], owner[two]], axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    around = _Around(search, apart)
    for pair, at in zip(pairs.tolist(), np.split(order, np.flatnonzero(np.diff(which.ravel()[order])) + 1)):
        a, b = one[at], two[at]
        entry, known = -1, ((), ())
        if partition.body(pair[0]) != partition.body(pair[1]):
            known = around.known(pair, (a, b))
            entry = laws.foreseen(*known)
            if not LAWS[laws[entry].law].perfect:
                continue
        loose = label[a] != label[b]
        a, b = a[loose], b[loose]
        if not len(a):
            continue
        laws.between(*known)
        made.append(_interface(search, tuple(pair), around.with_ends(a), known))
        laws.apply(entry, made[-1])
        joined = components(label[a], label[b], len(label))[1]
        label = joined[label]
    return made


def _interface(search: Search, pair: tuple[int, int], split: np.ndarray, called: tuple[tuple[str, ...], tuple[str, ...]]) -> Interface:
    """Interface without facets, of split nodes (n,) of the first side and the second side's split nodes of the same nodes."""
    nodes, corners = search.numbering.nodes[split], 3 if search.numbering.corners.shape[1] == 4 else 6
    return search.interface(pair, (nodes, nodes), np.empty((0, corners), dtype=int), np.empty((0, 2), dtype=int),
                            called=called, normals=np.tile([1.0, 0.0, 0.0], (len(nodes), 1)))  # any: what is bonded asks for no direction


class _Around:
    """Surroundings of some split nodes (k,): the volumes, and with ten-node tets the ends of the edges that they are amid."""

    def __init__(self, search: Search, split: np.ndarray):
        self.search, numbering = search, search.numbering
        chosen = np.zeros(len(numbering.nodes), dtype=bool)
        chosen[split] = True
        cell, corner = np.nonzero(chosen[numbering.corners])
        self.split, self.volume = np.unique(np.c_[numbering.corners[cell, corner], search.mesh.volume[cell]], axis=0).T
        cell, corner = cell[corner > 3], corner[corner > 3]
        self.middle, at = np.unique(numbering.corners[cell, corner], return_index=True)
        self.ends = numbering.corners[cell[at, None], TET_EDGES[corner[at] - 4]]

    def with_ends(self, split: np.ndarray) -> np.ndarray:
        """Split nodes of one side and, ascending, the ends of edges of which they have the middle: soles need them."""
        return np.unique(np.concatenate([split, self.ends[np.isin(self.middle, split)].ravel()]))

    def known(self, pair: tuple[int, int], split: Sequence[np.ndarray]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of both sides at their split nodes."""
        return self.search.called(pair, [np.unique(self.volume[np.isin(self.split, at)]) for at in split])
