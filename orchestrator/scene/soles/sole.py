"""What a sole is, and two of them on one interface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass
class Sole:
    """The matter added to one side of one interface.

    points : (p, 3) float, the nodes that are not on the interface, all clamped
    cells : (q, 4 or 10) int, positively oriented; values below n are nodes of the interface, the
        others are n + index of one of ``points``
    young, poisson : (q,) float
    """

    points: np.ndarray
    cells: np.ndarray
    young: np.ndarray
    poisson: np.ndarray


def merge(first: Sole, second: Sole, n: int) -> Sole:
    """Both soles on the same interface of n nodes, each with its own other nodes."""
    shifted = np.where(second.cells >= n, second.cells + len(first.points), second.cells)
    return Sole(np.vstack([first.points, second.points]), np.vstack([first.cells, shifted]), np.concatenate([first.young, second.young]),
        np.concatenate([first.poisson, second.poisson]))


def stiffened(soles: Sequence[tuple[Sole, Sole] | None], factors: np.ndarray) -> list[tuple[Sole, Sole] | None]:
    """Soles per interface with their moduli multiplied by factors (interfaces,)."""
    result: list[tuple[Sole, Sole] | None] = []
    for pair, factor in zip(soles, factors):
        if pair is None or factor == 1:
            result.append(pair)
            continue
        one = replace(pair[0], young=factor * pair[0].young)
        result.append((one, one if pair[1] is pair[0] else replace(pair[1], young=factor * pair[1].young)))
    return result
