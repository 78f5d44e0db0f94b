"""Which fronts are eliminated side by side: subtrees of the elimination tree, which share no number before their roots' parents.

Each subtree is one core's, those above all of them follow one after the other. What every front does is the same, whoever does it.
Cut are the largest subtrees, as long as that shortens what the cores take together: at the top a few fronts have a fifth of all
operations each, so that two cores take 0.6 of what one takes for a thousand bodies.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from itertools import accumulate

import numpy as np

WORTH = 1e7  # operations that side by side have to save: what it takes to hand them out


def side_by_side(parent: np.ndarray, operations: np.ndarray, cores: int) -> tuple[np.ndarray, np.ndarray]:
    """(F,) int, fronts in the order of work, and (k + 1,) int, where each of the subtrees begins, and what is above them, the last.

    parent : (F,) int, of each front, which comes later; −1: of none
    operations : (F,) of each
    """
    count = len(parent)
    whole, children = operations.astype(float), [[] for _ in range(count)]
    for f in range(count):
        if parent[f] >= 0:
            whole[parent[f]] += whole[f]
            children[parent[f]].append(f)
    left = [(-whole[f], f) for f in np.flatnonzero(parent < 0)]
    heapify(left)
    total = float(operations.sum())
    least, chosen, above = total - WORTH, [], 0.0
    while left and above < least:
        took = above + max(-left[0][0], (total - above) / cores)
        if took < least and cores > 1:
            least, chosen = took, [f for _, f in sorted(left)]
        _, largest = heappop(left)
        above += float(operations[largest])
        for f in children[largest]:
            heappush(left, (-whole[f], f))
    label = np.full(count, len(chosen))
    label[chosen] = np.arange(len(chosen))
    for f in range(count - 1, -1, -1):
        if parent[f] >= 0 and label[f] == len(chosen):
            label[f] = label[parent[f]]
    return np.argsort(label, kind="stable"), np.array([0, *accumulate(np.bincount(label, minlength=len(chosen) + 1))])
