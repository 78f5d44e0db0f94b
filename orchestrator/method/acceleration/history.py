"""Differences of the last evaluations of a fixed point, and their products: read once in each iteration, by all cores.

They are what an acceleration costs: hundreds of MB that no cache holds. Single precision would halve them, and does not do: it
moves a state by 6e-8 of its last changes, and a body that stabilisation alone holds by that over ε. Ten grains at 1e-10
then stagnate at 6e-10.
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
        products = sum(in_parts(_add, s.shape[1], s, r, s_before, r_before, self.root, self.relaxation, self.change, self.dr,
                                self._in_fours))
        return products[:, : len(self.order)]

    def next(self, s: np.ndarray, r: np.ndarray, gamma: np.ndarray) -> np.ndarray:
        """(T, D) s + β r / root less the changes times gamma (n,)."""
        state, order = np.empty_like(s), self._in_fours
        shares = np.zeros(len(order))
        shares[: len(gamma)] = gamma
        in_parts(_next, s.shape[1], s, r, self.root, self.relaxation, self.change, order, shares, state)
        return state

    @property
    def _in_fours(self) -> np.ndarray:
        """(4m,) int, ``order``, its last repeated up to a multiple of four."""
        return np.array(self.order + self.order[-1:] * (-len(self.order) % 4), dtype=int)


def weighted_residual(s: np.ndarray, image: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """image − s (T, D), the same times root, and the sum of the latter's squares."""
    residual, r = np.empty_like(s), np.empty_like(s)
    return residual, r, sum(in_parts(_residual, s.shape[1], s, image, root, residual, r))


# Slices are counted from zero: what a loop need not look for at the end of an array it does several numbers at a time. Four
# differences at once: several streams of memory, and what they all meet is loaded once.


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
            for n in range(0, len(order), 4):
                one, two = dr[order[n], t, a:b], dr[order[n + 1], t, a:b]
                three, four = dr[order[n + 2], t, a:b], dr[order[n + 3], t, a:b]
                x1, x2, x3, x4, y1, y2, y3, y4 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(len(one)):
                    x, y = latest[i], r_new[i]
                    x1 += x * one[i]
                    y1 += y * one[i]
                    x2 += x * two[i]
                    y2 += y * two[i]
                    x3 += x * three[i]
                    y3 += y * three[i]
                    x4 += x * four[i]
                    y4 += y * four[i]
                for m, x, y in ((n, x1, y1), (n + 1, x2, y2), (n + 2, x3, y3), (n + 3, x4, y4)):
                    products[0, m] += x
                    products[1, m] += y
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
            for n in range(0, len(order), 4):
                one, two = change[order[n], t, a:b], change[order[n + 1], t, a:b]
                three, four = change[order[n + 2], t, a:b], change[order[n + 3], t, a:b]
                g1, g2, g3, g4 = gamma[n], gamma[n + 1], gamma[n + 2], gamma[n + 3]
                for i in range(len(one)):
                    result[i] -= (g1 * one[i] + g2 * two[i]) + (g3 * three[i] + g4 * four[i])
