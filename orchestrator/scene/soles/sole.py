"""What a sole is, and two of them on one interface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class Sole:
    """The matter added to one side of one interface.

    Parameters
    ----------
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
    return Sole(
        np.vstack([first.points, second.points]),
        np.vstack([first.cells, shifted]),
        np.concatenate([first.young, second.young]),
        np.concatenate([first.poisson, second.poisson]),
    )
