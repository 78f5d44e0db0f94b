"""Subdomains that are the same but for a translation, so that work done for one serves all."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence

import numpy as np

from orchestrator.linalg import SAME

# Clouds of points that are the same differ by less than this, relatively, in their distances from
# their first point: by
# at most SAME √(3n) extents, where the distances are some √n extents together.
NEAR = 1e-10


def first_congruent(keys: Iterable[Hashable], points: Sequence[np.ndarray],
                    values: Callable[[int], np.ndarray] = lambda i: np.empty(0)) -> np.ndarray:
    """(things,) int, for each thing the first one that it equals but for a translation: itself if
    there is none before.

    Only things whose points lie equally far apart, on the whole, and whose numbers are as large,
    are compared one by one: the work grows with the number of things, whether all of them are alike
    or none, be it in their matter.

    keys : what must be identical
    points : per thing (n, 3), see ``same_shapes``
    values : of a thing, its numbers that must agree as ``equal`` says; of the same shape where keys
        are equal
    """
    result = np.arange(len(points))
    alike: dict[Hashable, list[int]] = {}
    for index, key in enumerate(keys):
        alike.setdefault(key, []).append(index)
    sizes = _sizes(points)
    for members in (np.array(m) for m in alike.values() if len(m) > 1):
        for near in _clusters(members, sizes[members]):
            for cluster in _clusters(near, np.array([_amount(values(i)) for i in near.tolist()])):
                _assign(np.sort(cluster), points, values, result)
    return result


def _clusters(members: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """Members (m,), apart where they are of different sizes (m,)."""
    order = np.argsort(sizes, kind="stable")
    members, sizes = members[order], sizes[order]
    return np.split(members, np.flatnonzero(np.diff(sizes) > NEAR * sizes[1:]) + 1)


def _amount(values: np.ndarray) -> float:
    """A sum that differs where values do, or are in another order; where they are ``equal`` it
    hardly does.
    """
    return float(np.abs(values).ravel() @ np.sqrt(np.arange(1.0, values.size + 1)))


def _assign(members: np.ndarray, points: Sequence[np.ndarray], values: Callable[[int], np.ndarray],
            result: np.ndarray) -> None:
    """Give things that may be alike, ascending, the first one that each equals."""
    while len(members) > 1:
        first, others = members[0], members[1:]
        equals = same_shapes(points[first], [points[i] for i in others])
        equals[equals] = [equal(values(int(first)), values(int(i))) for i in others[equals]]
        result[others[equals]] = first
        members = others[~equals]


def _sizes(points: Sequence[np.ndarray]) -> np.ndarray:
    """(clouds,) root of the squared distances of each cloud's points from its first one, summed."""
    counts = np.array([len(cloud) for cloud in points], dtype=int)
    filled = np.flatnonzero(counts)
    sizes = np.zeros(len(points))
    if len(filled):
        starts, joined = (np.cumsum(counts) - counts)[filled], np.concatenate(points)
        apart = joined - np.repeat(joined[starts], counts[filled], axis=0)
        sizes[filled] = np.sqrt(np.add.reduceat(np.einsum("ij,ij->i", apart, apart), starts))
    return sizes


def same_shapes(one: np.ndarray, others: Sequence[np.ndarray]) -> np.ndarray:
    """(others,) bool, whether clouds of points differ from one (n, 3) by a translation alone, point
    by point.
    """
    found = np.array([other.shape == one.shape for other in others], dtype=bool)
    if one.size and found.any():
        clouds = np.stack([other for other in others if other.shape == one.shape])
        apart = (one - one[:1]) - (clouds - clouds[:, :1])
        # coordinates a hundred times larger than the part round by less; results by more
        found[found] = np.abs(apart).max(axis=(1, 2)) <= SAME * np.ptp(one, axis=0).max()
    return found


def equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether numbers of the same shape agree one by one but for rounding."""
    return bool((np.abs(one - other) <= SAME * np.abs(other)).all())
