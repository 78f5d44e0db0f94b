"""Differences of the last evaluations of a fixed point, and their products: read once in each iteration, by all cores.

They are what an acceleration costs: hundreds of MB that no cache holds.
"""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled, in_parts

BLOCK = 1024  # numbers of a row that stay in the first cache while they meet those of all other rows


class History:
    """The last differences of evaluations (s, r), at most ``memory`` of them, T rows of D columns each.

    Parameters
    ----------
    memory : how many are kept
    root : (D,) weights of the residual r = root (F(s) − s)
    relaxation : β

    Attributes
    ----------
    order : their places, the oldest first
    """

    def __init__(self, memory: int, root: np.ndarray, relaxation: float):
        self.memory, self.root, self.relaxation = memory, root, relaxation
        self.order: list[int] = []
        self.change = self.dr = np.empty((0, 0, 0))

    def __len__(self) -> int:
        return len(self.order)

    def clear(self) -> None:
        """Forget all."""
        self.order = []

    def add(self, s: np.ndarray, r: np.ndarray, s_before: np.ndarray, r_before: np.ndarray) -> np.ndarray:
        """Remember r − r_before, and how far it moves s + β r / root; when there are too many, the oldest is forgotten.

        Returns
        -------
        (2, n) products of the latest difference and of r with all differences
        """
        if self.dr.shape[1:] != s.shape:
            # the system gives memory to what is written
            self.change, self.dr = np.empty((2, self.memory, *s.shape))
        if len(self.order) == self.memory:
            place = self.order.pop(0)
        else:
            place = next(p for p in range(self.memory) if p not in self.order)
        self.order.append(place)
        return sum(in_parts(_add, s.shape[1], s, r, s_before, r_before, self.root, self.relaxation, self.change, self.dr,
                            np.array(self.order)))

    def next(self, s: np.ndarray, r: np.ndarray, gamma: np.ndarray) -> np.ndarray:
        """(T, D) s + β r / root less the changes times gamma (n,)."""
        state = np.empty_like(s)
        in_parts(_next, s.shape[1], s, r, self.root, self.relaxation, self.change, np.array(self.order, dtype=int), gamma,
                 state)
        return state


def weighted_residual(s: np.ndarray, image: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """image − s (T, D), the same times root, and the sum of the latter's squares."""
    residual, r = np.empty_like(s), np.empty_like(s)
    return residual, r, sum(in_parts(_residual, s.shape[1], s, image, root, residual, r))


# Slices are counted from zero: what a loop need not look for at the end of an array it does several numbers at a time.


@compiled
def _residual(start, stop, s, image, root, residual, r):
    """Sum of squares of r = root (image − s), written, in columns from start to stop."""
    total, weight = 0.0, root[start:stop]
    for t in range(len(s)):
        old, new, apart, weighted = s[t, start:stop], image[t, start:stop], residual[t, start:stop], r[t, start:stop]
        for i in range(len(weight)):
            apart[i] = new[i] - old[i]
            weighted[i] = weight[i] * apart[i]
            total += weighted[i] * weighted[i]
    return total


@compiled
def _add(start, stop, s, r, s_before, r_before, root, relaxation, change, dr, order):
    """Write the latest difference to the last place of ``order``; products (2, n) of its columns from start to stop."""
    products, new = np.zeros((2, len(order))), order[-1]
    for t in range(len(s)):
        for a in range(start, stop, BLOCK):
            b = min(a + BLOCK, stop)
            weight, s_new, s_old, r_new, r_old = root[a:b], s[t, a:b], s_before[t, a:b], r[t, a:b], r_before[t, a:b]
            latest, moved = dr[new, t, a:b], change[new, t, a:b]
            for i in range(len(weight)):
                latest[i] = r_new[i] - r_old[i]
                moved[i] = s_new[i] - s_old[i] + relaxation * latest[i] / weight[i]
            for n in range(len(order)):
                other, along, across = dr[order[n], t, a:b], 0.0, 0.0
                for i in range(len(other)):
                    along += latest[i] * other[i]
                    across += r_new[i] * other[i]
                products[0, n] += along
                products[1, n] += across
    return products


@compiled
def _next(start, stop, s, r, root, relaxation, change, order, gamma, state):
    """``History.next`` in columns from start to stop."""
    for t in range(len(s)):
        for a in range(start, stop, BLOCK):
            b = min(a + BLOCK, stop)
            weight, old, left, result = root[a:b], s[t, a:b], r[t, a:b], state[t, a:b]
            for i in range(len(weight)):
                result[i] = old[i] + relaxation * left[i] / weight[i]
            for n in range(len(order)):
                share, other = gamma[n], change[order[n], t, a:b]
                for i in range(len(other)):
                    result[i] -= share * other[i]
