"""What a sole is, and two of them on one interface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass
class Sole:
    """The matter added to one side of one interface.

    points : (p, 3) float, the nodes that are not on the interface, all clamped
    cells : (q, 4 or 10) int, positively oriented; values below n are nodes of the interface, others n + index of ``points``
    young, poisson : (q,) float
    """

    points: np.ndarray
    cells: np.ndarray
    young: np.ndarray
    poisson: np.ndarray


def merge(first: Sole, second: Sole, n: int) -> Sole:
    """Both soles on the same interface of n nodes, each with its own other nodes."""
    shifted = np.where(second.cells >= n, second.cells + len(first.points), second.cells)
    return Sole(np.vstack([first.points, second.points]), np.vstack([first.cells, shifted]),
                np.r_[first.young, second.young], np.r_[first.poisson, second.poisson])


def stiffened(soles: Sequence[tuple[Sole, Sole] | None], factors: np.ndarray) -> list[tuple[Sole, Sole] | None]:
    """Soles per interface with their moduli multiplied by factors (interfaces,)."""
    def of(pair: tuple[Sole, Sole], factor: float) -> tuple[Sole, Sole]:
        one = replace(pair[0], young=factor * pair[0].young)
        return one, one if pair[1] is pair[0] else replace(pair[1], young=factor * pair[1].young)

    return [pair if pair is None or factor == 1 else of(pair, factor) for pair, factor in zip(soles, factors)]
