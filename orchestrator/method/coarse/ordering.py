"""Which bodies make a front: those that are eliminated one after the other and see much the same bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

OWN_CALLS = 1e5  # operations that BLAS does in the time that one more front takes beside them
PASSED = 50.0  # operations that BLAS does in the time that it takes to pass a number on to the parent


def grouped(sees: Sequence[np.ndarray], order: np.ndarray, size: int) -> list[tuple[list[int], set[int], list]]:
    """Fronts, children before parents: the bodies eliminated, in order, those that they see, and the children.

    A child is joined with its parent where that costs fewer operations more than a front of its own costs calls.
    """
    count = len(order)
    place = np.empty(count, dtype=int)
    place[order] = np.arange(count)
    children: list[list] = [[] for _ in range(count)]
    roots = []
    for k, body in enumerate(order):
        columns, kept = [int(body)], []
        rest = {int(j) for j in sees[body] if place[j] > k}.union(*(group[1] for group in children[k])) - {int(body)}
        for group in sorted(children[k], key=lambda g: len(g[0])):
            apart = operations(len(group[0]), len(group[1]), size) + operations(len(columns), len(rest), size)
            if operations(len(group[0]) + len(columns), len(rest), size) <= apart + OWN_CALLS + PASSED * (size * len(group[1])) ** 2:
                columns, kept = group[0] + columns, kept + group[2]
            else:
                kept.append(group)
        group = (columns, rest, kept)
        if rest:
            children[min(place[j] for j in rest)].append(group)
        else:
            roots.append(group)
    found, left = [], list(roots)  # parents before children, then turned round
    while left:
        group = left.pop()
        found.append(group)
        left.extend(group[2])
    return found[::-1]


def operations(own: int, rest: int, size: int) -> float:
    """Of a front that eliminates ``own`` bodies and leaves ``rest``."""
    a, m = own * size, rest * size
    return 2 * a**3 / 3 + 2 * a * a * m + 2 * a * m * m
