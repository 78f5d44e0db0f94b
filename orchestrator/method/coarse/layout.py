"""Where the fronts of an elimination lie, and what goes from one to the next, as ``fronts`` wants
it.

Which fronts are eliminated side by side: subtrees of the elimination tree, which share no number
before their roots' parents.

Each subtree is one core's, those above all of them follow one after the other. What every front
does is the same, whoever does it. Cut are the largest subtrees, as long as that shortens what the
cores take together: at the top a few fronts have a fifth of all operations each, so that two cores
take 0.66 of what one takes for a thousand bodies. Subtrees are dealt to ranks first, so that all
have as much to do as can be, then to the cores of each. Where that is not worth the messages, rank
0's cores take all of them: it may use those of ranks on its machine that wait for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np

from orchestrator.method.interface.rows import bounds_of


# rows of a band: products of so many columns are nearly as quick as others, and its inverse costs
# little beside them
BAND = 48


class Layout(NamedTuple):
    """Fronts as ``fronts`` wants them; bodies are numbered in the order of elimination.

    band : how many rows are eliminated at once
    sizes : (F, 2) int, rows that are eliminated, rows that are left
    places : (F, 3) int, where a front begins in all L, all U, and all that is left S, see
        ``placed``
    starts : (F,) int, the first body of each
    enters : (F + 1,) int, where blocks that enter begin in ``enter`` (k, 3) int: which, and its
        block row and column
    children : (F + 1,) int, where its children begin in ``child``
    rests : (F + 1,) int, where the bodies that it leaves begin in ``rest``, and in ``within``:
        their places in its parent
    """

    band: int
    sizes: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    enters: np.ndarray
    enter: np.ndarray
    children: np.ndarray
    child: np.ndarray
    rests: np.ndarray
    rest: np.ndarray
    within: np.ndarray

    @property
    def parent(self) -> np.ndarray:
        """(F,) int, the front that takes what each leaves; −1: none."""
        result = np.full(len(self.sizes), -1)
        result[self.child] = np.repeat(np.arange(len(self.sizes)), np.diff(self.children))
        return result

    def placed(self, here: np.ndarray) -> tuple[Layout, np.ndarray]:
        """The same where some L, U and S, ``here`` (F, 3) bool, lie one after the other; and (3,)
        how many numbers these are.
        """
        a, m = self.sizes.T
        lengths = np.where(here, np.column_stack([(a + m) * a, a * m, m**2]), 0)
        return self._replace(places=np.cumsum(lengths, axis=0) - lengths), lengths.sum(axis=0)

    @classmethod
    def of(cls, fronts: np.ndarray, rests: Sequence[np.ndarray],
           entries: tuple[np.ndarray, np.ndarray], size: int) -> Layout:
        """Of fronts (F, 2).

        rests : per front, ascending, the bodies that it leaves
        entries : rows and columns (n,) of the matrix's blocks
        """
        starts, none = bounds_of(fronts[:, 0]), np.zeros(0, dtype=int)
        front_of = np.repeat(np.arange(len(fronts)), fronts[:, 0])
        parent = np.array([front_of[rest[0]] if len(rest) else -1 for rest in rests], dtype=int)

        def places(front: int, bodies: np.ndarray) -> np.ndarray:
            """Where some of its bodies are, eliminated ones first."""
            return np.where(bodies < starts[front + 1], bodies - starts[front],
                            fronts[front, 0] + np.searchsorted(rests[front], bodies))

        of = front_of[np.minimum(*entries)]
        blocks, enters = np.argsort(of,
                                    kind="stable"), bounds_of(
                                        np.bincount(of, minlength=len(fronts)))
        enter = [np.column_stack([own, *(places(front, x[own]) for x in entries)])
                 for front, own in enumerate(np.split(blocks, enters[1:-1]))]
        child = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0):]
        return cls(max(1, BAND // size) * size, size * fronts,
                   np.zeros((len(fronts), 3), int), starts[:-1], enters,
                   np.concatenate([np.zeros((0, 3), int), *enter]),
                   np.searchsorted(parent[child], np.arange(len(fronts) + 1)), child,
                   bounds_of(fronts[:, 1]), np.concatenate([none, *rests]),
                   np.concatenate(
                [none, *(places(above, rest) for above, rest in zip(parent, rests) if len(rest))]))


# Operations that side by side have to save: what it takes to hand them out to cores; to ranks, some
# messages in every solution too.
WORTH, WORTH_RANKS = 1e7, 1e8


class SideBySide(NamedTuple):
    """Which fronts are whose.

    order : (F,) int, fronts in the order of work
    bounds : (k + 2,) int, where each of the k subtrees begins, in the order of their ranks; what is
        above them; the end
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


def side_by_side(parent: np.ndarray, operations: np.ndarray, cores: int,
                 ranks: int = 1) -> SideBySide:
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
    bounds = bounds_of(np.bincount(label, minlength=len(chosen) + 1))
    return SideBySide(np.argsort(label, kind="stable"), bounds,
                      np.searchsorted(np.sort(of), np.arange(ranks + 1)))


def _cut(roots: np.ndarray, children: list[list[int]], operations: np.ndarray, whole: np.ndarray,
         cores: int, worth: float) -> list[int]:
    """Subtrees to be eliminated side by side, the largest first; none where that saves less than
    ``worth`` operations.

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
