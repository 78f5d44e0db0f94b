"""Stiffness of many small models: congruent ones once, the others together in few requests."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models.congruence import representatives
from orchestrator.blackbox.protocol import BlackBox, Model, Origin
from orchestrator.savings import Savings

# Tets per request. Of the soles of 100 grains, 230,000 tets, FreeFEM assembles requests of this size in two thirds
# of the time it takes for two large ones; ten times smaller ones gain little more and cost messages.
LARGEST = 4000
# Nodes of one packet at the same place. FreeFEM's search tree gives up on more than eight; half of them, as
# nodes that differ by rounding may be taken for two places.
CROWD = 4
GRID = 1 << 21  # steps along each axis, by which places are told apart


@dataclass(eq=False)
class Assembled:
    """A model's stiffness, within that of models that are not coupled to it.

    Parameters
    ----------
    whole : stiffness of all of them
    first, last : its dofs are first … last − 1
    """

    whole: sp.csr_array
    first: int
    last: int

    @cached_property
    def matrix(self) -> sp.csr_array:
        """(3n, 3n) by itself."""
        pointers = self.whole.indptr[self.first : self.last + 1]
        inside = slice(pointers[0], pointers[-1])
        return sp.csr_array((self.whole.data[inside], self.whole.indices[inside] - self.first, pointers - pointers[0]),
                            shape=(self.last - self.first,) * 2)


@dataclass(frozen=True, eq=False)
class Block:
    """A small sparse matrix (n, n) by rows: for thousands of them SciPy's own would take longer to be made than to be used."""

    data: np.ndarray
    indices: np.ndarray
    indptr: np.ndarray

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return len(self.data)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, n)."""
        return (len(self.indptr) - 1,) * 2


def assembled(models: Sequence[Model], blackbox: BlackBox, workers: int, share: bool,
              savings: Savings) -> list[Assembled]:
    """Stiffness of every model; congruent ones get the very same.

    Parameters
    ----------
    workers : the models are joined in about this many requests, or in more so that none is large
    share : whether to look for congruent models

    Raises
    ------
    BlackBoxError : from the code
    """
    if not models:
        return []
    first = representatives(models, blackbox.traits) if share else np.arange(len(models))
    kinds = np.unique(first)
    savings.add("congruent", "small stiffness matrices", len(models) - len(kinds))
    tets = sum(len(models[k].cells) for k in kinds)
    packets = joined([models[k] for k in kinds], max(workers, tets // LARGEST))
    found: dict[int, Assembled] = {}
    for stiffness, (_, members) in zip(blackbox.stiffness([m for m, _ in packets]), packets):
        ends = np.cumsum([0] + [3 * len(models[kinds[m]].nodes) for m in members]).tolist()
        found |= {int(kinds[m]): Assembled(stiffness, a, b) for m, a, b in zip(members, ends[:-1], ends[1:])}
    return [found[int(k)] for k in first]


def cut(found: Sequence[Assembled], chosen: Sequence[np.ndarray]) -> list[Block]:
    """Rows and columns (n,) of each stiffness; those that lie in one matrix are taken from it together."""
    groups: dict[tuple[int, int], list[int]] = {}
    before: Counter[int] = Counter()
    for place, one in enumerate(found):  # what is asked for twice would meet itself
        groups.setdefault((id(one.whole), before[id(one)]), []).append(place)
        before[id(one)] += 1
    blocks: list[Block | None] = [None] * len(found)
    for places in groups.values():
        dofs = np.concatenate([found[place].first + chosen[place] for place in places])
        taken = sp.csr_array(found[places[0]].whole[dofs][:, dofs])
        ends, first = taken.indptr, 0
        for place in places:
            last = first + len(chosen[place])
            entries = slice(ends[first], ends[last])
            blocks[place] = Block(taken.data[entries], taken.indices[entries] - first, ends[first : last + 1] - ends[first])
            first = last
    return blocks


# ---- many small models side by side in few: requests that are not worth a message each ----------------------


def joined(models: Sequence[Model], count: int) -> list[tuple[Model, list[int]]]:
    """About ``count`` models per code that hold all the given ones together, of about equal size.

    Returns
    -------
    list of (joined model, indices of the models in it, in order)

    Notes
    -----
    Hundreds of tiny requests cost more in messages than in arithmetic; side by side they are one.
    Each model stays where it is, so that its stiffness is the same bit for bit whatever it is joined with, on
    any number of ranks, and for a sole also the same as within an extended subdomain: s − k w would show the
    rounding of another place. Of models that meet in a cross point, only so many are joined.
    """
    packets = []
    for members in _packets(models, count):
        parts = [models[i] for i in members]
        node_shift = np.cumsum([0] + [len(m.nodes) for m in parts])
        region_shift = np.cumsum([0] + [len(m.materials) for m in parts])
        packets.append((Model(
            name=f"{parts[0].name} … {parts[-1].name}",
            nodes=np.vstack([m.nodes for m in parts]),
            cells=np.vstack([m.cells + s for m, s in zip(parts, node_shift)]),
            region=np.concatenate([m.region + s for m, s in zip(parts, region_shift)]),
            materials=np.vstack([m.materials for m in parts]),
            fixed=np.vstack([m.fixed for m in parts]),
            trace=np.empty(0, int), code=parts[0].code, origin=Origin.side_by_side(parts),
        ), members))
    return packets


@dataclass(eq=False)
class _Packet:
    """Models that are to be joined: their indices, their tets, and how many of their nodes are at each point."""

    members: list[int]
    crowd: np.ndarray
    tets: int = 0


def _packets(models: Sequence[Model], count: int) -> list[list[int]]:
    """Indices of models of the same code, about ``count`` lists for each, in none of which nodes crowd."""
    codes, points, packets = np.array([m.code for m in models]), _points([m.nodes for m in models]), []
    beyond = max(own.max() for own in points) + 1
    for code in np.unique(codes):
        own = np.flatnonzero(codes == code).tolist()
        enough = sum(len(models[i].cells) for i in own) / count
        open_ones: list[_Packet] = []
        for i in own:
            packet = next((p for p in open_ones if p.crowd[points[i]].max() < CROWD), None)
            if packet is None:
                packet = _Packet([], np.zeros(beyond, np.int8))
                open_ones.append(packet)
                packets.append(packet.members)
            packet.members.append(i)
            packet.crowd[points[i]] += 1
            packet.tets += len(models[i].cells)
            if packet.tets >= enough:
                open_ones.remove(packet)
    return packets


def _points(clouds: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per cloud (n, 3) of nodes, the number (n,) of the point each is at: the same for nodes that coincide."""
    nodes = np.vstack(clouds)
    lowest, extent = nodes.min(axis=0), np.ptp(nodes, axis=0).max()
    cells = np.round((nodes - lowest) * ((GRID - 1) / extent)).astype(np.int64)
    points = np.unique(cells @ np.array([GRID**2, GRID, 1]), return_inverse=True)[1]
    return np.split(points, np.cumsum([len(c) for c in clouds])[:-1])
