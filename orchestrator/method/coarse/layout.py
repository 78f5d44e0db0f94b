"""Where the fronts of an elimination lie, and what goes from one to the next, as ``fronts`` wants it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

PANEL = 12  # rows of a panel: at fewer products are slower, at more what is not products
BAND = 48  # rows of a band: products of so many columns are nearly as quick as others, and its inverse costs little beside them


class Layout(NamedTuple):
    """Fronts as ``fronts`` wants them; bodies are numbered in the order of elimination.

    panel, band : their rows
    sizes : (F, 2) int, rows that are eliminated, rows that are left
    places : (F, 3) int, where a front begins in all L, all U, and all that is left S, see ``placed``
    starts : (F,) int, the first body of each
    enters : (F + 1,) int, where blocks that enter begin in ``enter`` (k, 3) int: which, and its block row and column
    children : (F + 1,) int, where its children begin in ``child``
    rests : (F + 1,) int, where the bodies that it leaves begin in ``rest``, and in ``within``: their places in its parent
    """

    panel: int
    band: int
    sizes: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    enters: np.ndarray
    enter: np.ndarray
    children: np.ndarray
    child: np.ndarray
    rests: np.ndarray
    rest: np.ndarray
    within: np.ndarray

    @property
    def parent(self) -> np.ndarray:
        """(F,) int, the front that takes what each leaves; −1: none."""
        result = np.full(len(self.sizes), -1)
        result[self.child] = np.repeat(np.arange(len(self.sizes)), np.diff(self.children))
        return result

    def placed(self, here: np.ndarray) -> tuple[Layout, np.ndarray]:
        """The same where some L, U and S, ``here`` (F, 3) bool, lie one after the other; and (3,) how many numbers these are."""
        a, m = self.sizes.T
        lengths = np.where(here, np.column_stack([(a + m) * a, a * m, m**2]), 0)
        return self._replace(places=np.cumsum(lengths, axis=0) - lengths), lengths.sum(axis=0)

    @classmethod
    def of(cls, fronts: np.ndarray, rests: Sequence[np.ndarray], entries: tuple[np.ndarray, np.ndarray], size: int) -> Layout:
        """Of fronts (F, 2).

        rests : per front, ascending, the bodies that it leaves
        entries : rows and columns (n,) of the matrix's blocks
        """
        starts, none, panel = _starts(fronts[:, 0]), np.zeros(0, dtype=int), max(1, PANEL // size) * size
        front_of = np.repeat(np.arange(len(fronts)), fronts[:, 0])
        parent = np.array([front_of[rest[0]] if len(rest) else -1 for rest in rests], dtype=int)

        def places(front: int, bodies: np.ndarray) -> np.ndarray:
            """Where some of its bodies are, eliminated ones first."""
            return np.where(bodies < starts[front + 1], bodies - starts[front], fronts[front, 0] + np.searchsorted(rests[front], bodies))

        of = front_of[np.minimum(*entries)]
        blocks, enters = np.argsort(of, kind="stable"), _starts(np.bincount(of, minlength=len(fronts)))
        enter = [np.column_stack([own, *(places(front, x[own]) for x in entries)])
                 for front, own in enumerate(np.split(blocks, enters[1:-1]))]
        child = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0):]
        return cls(panel, max(1, BAND // panel) * panel, size * fronts,
            np.zeros((len(fronts), 3), int), starts[:-1], enters, np.concatenate([np.zeros((0, 3), int), *enter]),
            np.searchsorted(parent[child], np.arange(len(fronts) + 1)), child, _starts(fronts[:, 1]), np.concatenate([none, *rests]),
            np.concatenate([none, *(places(above, rest) for above, rest in zip(parent, rests) if len(rest))]))


def _starts(lengths: Sequence[int] | np.ndarray) -> np.ndarray:
    """(n + 1,) where each of some runs starts, and the end."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=int)])
