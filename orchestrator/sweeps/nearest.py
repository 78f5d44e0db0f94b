"""The order of a sweep, and what each variant begins with: states of those near to it.

A variant has its place in a space with a direction for each number that varies, measured over its
range, whatever its unit; of values that are no numbers it counts that they differ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from orchestrator.config.paths import is_number
from orchestrator.linalg import PLACED
from orchestrator.sweeps.variants import Variant

# Shares of states, at most: a line through two that lie one step apart has 2 and −1. More would
# carry the neighbours' own errors far.
MOST = 2 + PLACED


def places_of(variants: Sequence[Variant]) -> np.ndarray:
    """(variants, directions) their places; the values of a key reach from 0 to 1 or so."""
    columns = [np.zeros((len(variants), 0))]
    for key in variants[0].values:
        rows = [_flat(variant.values[key]) for variant in variants]
        entries = [*zip(*rows)] if len({*map(len, rows)}) == 1 else [[*map(repr, rows)]]
        at = np.hstack([_entry(values) for values in entries])
        columns.append(at / (np.linalg.norm(np.ptp(at, axis=0)) or 1.0))
    return np.hstack(columns)


def _flat(value: Any) -> list[Any]:
    """The entries of a value: itself, or those of a list and of lists in it."""
    return [x for part in value for x in _flat(part)] if isinstance(value, list) else [value]


def _entry(values: Sequence[Any]) -> np.ndarray:
    """(variants, directions) one for numbers, else one for each value; none where all are alike."""
    if all(map(is_number, values)):
        return np.array(values, dtype=float)[:, None]
    known = [next(i for i, other in enumerate(values) if other == one) for one in values]
    return np.eye(len(values))[known] if any(known) else np.zeros((len(values), 0))


def chained(places: np.ndarray) -> list[int]:
    """Return the order in which to solve: the first, then always the one that is nearest to any
    before it.
    """
    order, near = [0], np.full(len(places), np.inf)
    while len(order) < len(places):
        near = np.minimum(near, np.linalg.norm(places - places[order[-1]], axis=1))
        near[order] = np.inf
        order.append(int(near.argmin()))
    return order


def start_near(places: np.ndarray, number: int, fits: Callable[[int], bool]) -> dict[int, float]:
    """Return which variants one begins with, and what of each: of the nearest ones as few as a
    straight line, a plane, … through their places needs to lead to its own; the nearest alone where
    there are none, or where that is far. Nothing where none fits.

    fits : whether another variant's state serves
    """
    away = places - places[number]
    far, chosen = np.linalg.norm(away, axis=1), []
    for other in np.argsort(far, kind="stable"):
        if other == number or not fits(int(other)):
            continue
        chosen.append(int(other))
        if far[other] <= PLACED:
            break
        # Σ shares = 1, Σ shares × places = the place, and least shares of those far away
        rows = np.vstack([np.ones(len(chosen)), away[chosen].T]) / far[chosen]
        shares = np.linalg.lstsq(rows, np.eye(len(rows))[0], rcond=None)[0]
        left = np.linalg.norm(rows @ shares - np.eye(len(rows))[0])
        shares /= far[chosen]
        if left <= PLACED and np.abs(shares).max() <= MOST:
            return dict(zip(chosen, shares.tolist()))
        if len(chosen) == 1 + len(rows):
            break
    return {chosen[0]: 1.0} if chosen else {}
