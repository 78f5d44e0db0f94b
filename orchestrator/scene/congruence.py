"""What is the same but for a translation, so that work done for one of it serves all."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Hashable, Iterable, Sequence

import numpy as np

# Relative difference of coordinates and moduli that counts as none: the rounding of coordinates a hundred times
# larger than the part is less, what anyone would notice in a result is more.
SAME = 1e-12
# Clouds of points that are the same differ by less than this, relatively, in their distances from their first point.
NEAR = 1e-8


def first_congruent(keys: Iterable[Hashable], points: Sequence[np.ndarray],
                    same: Callable[[int, int], bool] = lambda i, j: True) -> np.ndarray:
    """(things,) int, for each thing the first one that it equals but for a translation: itself if there is none before.

    Only things whose points lie equally far apart, on the whole, are compared point by point: the work grows with
    the number of things, whether all of them are alike or none.

    Parameters
    ----------
    keys : what must be identical
    points : per thing (n, 3), see ``same_shape``
    same : (i, j) → whether things of equal keys and shapes are equal in all else
    """
    result: list[int] = []
    alike: dict[Hashable, tuple[list[float], list[int]]] = {}  # per key the sizes of the first ones, ascending, and who
    for index, (key, size) in enumerate(zip(keys, _sizes(points))):
        sizes, firsts = alike.setdefault(key, ([], []))
        near = slice(bisect_left(sizes, size * (1 - NEAR)), bisect_right(sizes, size * (1 + NEAR)))
        first = next((other for other in sorted(firsts[near])
                      if same_shape(points[other], points[index]) and same(other, index)), index)
        if first == index:
            at = bisect_left(sizes, size)
            sizes.insert(at, size)
            firsts.insert(at, index)
        result.append(first)
    return np.array(result, dtype=int)


def _sizes(points: Sequence[np.ndarray]) -> list[float]:
    """Root of the squared distances of each cloud's points from its first one, summed."""
    counts = np.array([len(cloud) for cloud in points], dtype=int)
    filled = np.flatnonzero(counts)
    sizes = np.zeros(len(points))
    if len(filled):
        starts, joined = (np.cumsum(counts) - counts)[filled], np.concatenate(points)
        apart = joined - np.repeat(joined[starts], counts[filled], axis=0)
        sizes[filled] = np.sqrt(np.add.reduceat(np.einsum("ij,ij->i", apart, apart), starts))
    return sizes.tolist()


def same_shape(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two clouds of points (n, 3) differ by a translation alone, point by point."""
    if one.shape != other.shape:
        return False
    apart = (one - one[:1]) - (other - other[:1])
    return bool(np.abs(apart).max(initial=0.0) <= SAME * np.ptp(one, axis=0).max(initial=0.0))


def equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether numbers of the same shape agree one by one but for rounding."""
    return bool((np.abs(one - other) <= SAME * np.abs(other)).all())
