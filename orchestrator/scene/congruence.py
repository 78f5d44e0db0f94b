"""What is the same but for a translation, so that work done for one of it serves all."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable

import numpy as np

# Relative difference of places and moduli that counts as none: the rounding of coordinates a hundred times
# larger than the part is less, what anyone would notice in a result is more.
SAME = 1e-12


def first_alike(keys: Iterable[Hashable], same: Callable[[int, int], bool]) -> np.ndarray:
    """(n,) int, for each thing the first one that equals it: itself if there is none before.

    Parameters
    ----------
    keys : what must be identical
    same : (i, j) → whether things of equal keys are equal
    """
    result, alike = [], {}
    for index, key in enumerate(keys):
        candidates = alike.setdefault(key, [])
        first = next((other for other in candidates if same(index, other)), index)
        if first == index:
            candidates.append(index)
        result.append(first)
    return np.array(result, dtype=int)


def same_shape(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two clouds of points (n, 3) differ by a translation alone, point by point."""
    if one.shape != other.shape:
        return False
    apart = (one - one[:1]) - (other - other[:1])
    return bool(np.abs(apart).max(initial=0.0) <= SAME * np.ptp(one, axis=0).max(initial=0.0))


def equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether numbers of the same shape agree one by one but for rounding."""
    return bool((np.abs(one - other) <= SAME * np.abs(other)).all())
