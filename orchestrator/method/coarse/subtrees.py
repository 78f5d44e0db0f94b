"""Which fronts are eliminated side by side: subtrees of the elimination tree, which share no number before their roots' parents.

Each subtree is one core's, those above all of them follow one after the other. What every front does is the same, whoever does it.
Cut are the largest subtrees, as long as that shortens what the cores take together: at the top a few fronts have a fifth of all
operations each, so that two cores take 0.66 of what one takes for a thousand bodies. Subtrees are dealt to ranks first, so that all
have as much to do as can be, then to the cores of each. Where that is not worth the messages, rank 0's cores take all of them: it may
use those of ranks on its machine that wait for it.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from itertools import accumulate
from typing import NamedTuple

import numpy as np

# Operations that side by side have to save: what it takes to hand them out to cores; to ranks, some messages in every solution too.
WORTH, WORTH_RANKS = 1e7, 1e8


class SideBySide(NamedTuple):
    """Which fronts are whose.

    order : (F,) int, fronts in the order of work
    bounds : (k + 2,) int, where each of the k subtrees begins, in the order of their ranks; what is above them; the end
    ranks : (ranks + 1,) int, where each rank's subtrees begin
    """

    order: np.ndarray
    bounds: np.ndarray
    ranks: np.ndarray

    @property
    def rank(self) -> np.ndarray:
        """(F,) int, whose each front is; those above all subtrees are rank 0's."""
        result = np.zeros(len(self.order), dtype=int)
        for rank, (a, b) in enumerate(zip(self.ranks[:-1], self.ranks[1:])):
            result[self.order[self.bounds[a] : self.bounds[b]]] = rank
        return result

    @property
    def above(self) -> np.ndarray:
        """Fronts above all subtrees."""
        return self.order[self.bounds[-2] :]

    def own(self, rank: int) -> np.ndarray:
        """Fronts of a rank's subtrees."""
        return self.order[self.bounds[self.ranks[rank]] : self.bounds[self.ranks[rank + 1]]]


def side_by_side(parent: np.ndarray, operations: np.ndarray, cores: int, ranks: int = 1) -> SideBySide:
    """Deal out the fronts.

    parent : (F,) int, of each front, which comes later; −1: of none
    operations : (F,) of each
    cores : of each rank
    """
    count = len(parent)
    whole, children = operations.astype(float), [[] for _ in range(count)]
    for f in range(count):
        if parent[f] >= 0:
            whole[parent[f]] += whole[f]
            children[parent[f]].append(f)
    tree, takers = (np.flatnonzero(parent < 0), children, operations, whole), ranks
    chosen = _cut(*tree, ranks * cores, WORTH_RANKS) if ranks > 1 else []
    if not chosen:
        chosen, takers = _cut(*tree, cores, WORTH), 1
    load, of = np.zeros(takers), np.zeros(len(chosen), dtype=int)
    for i, f in enumerate(chosen):  # the largest first
        of[i] = np.argmin(load)
        load[of[i]] += whole[f]
    chosen = [chosen[i] for i in np.argsort(of, kind="stable")]
    label = np.full(count, len(chosen))
    label[chosen] = np.arange(len(chosen))
    for f in range(count - 1, -1, -1):
        if parent[f] >= 0 and label[f] == len(chosen):
            label[f] = label[parent[f]]
    bounds = np.array([0, *accumulate(np.bincount(label, minlength=len(chosen) + 1))])
    return SideBySide(np.argsort(label, kind="stable"), bounds, np.searchsorted(np.sort(of), np.arange(ranks + 1)))


def _cut(roots: np.ndarray, children: list[list[int]], operations: np.ndarray, whole: np.ndarray, cores: int, worth: float) -> list[int]:
    """Subtrees to be eliminated side by side, the largest first; none where that saves less than ``worth`` operations.

    roots, children : of the tree; operations, whole : of each front, and of its subtree
    """
    left = [(-whole[f], f) for f in roots]
    heapify(left)
    total = float(operations.sum())
    least, chosen, above = total - worth, [], 0.0
    while left and above < least:
        took = above + max(-left[0][0], (total - above) / cores)
        if took < least and cores > 1:
            least, chosen = took, [f for _, f in sorted(left)]
        _, largest = heappop(left)
        above += float(operations[largest])
        for f in children[largest]:
            heappush(left, (-whole[f], f))
    return chosen
