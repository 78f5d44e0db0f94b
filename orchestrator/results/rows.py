"""Arrays of which every rank has some rows: rank 0 gets them block after block, and never has more than one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orchestrator.parallel.team import Team

BLOCK = 1 << 19  # bytes


@dataclass(frozen=True)
class Streamed:
    """An array of the whole in C order, block after block, once; all ranks go through it together, and rank 0 alone gets them."""

    shape: tuple[int, ...]
    dtype: np.dtype
    made: Iterator[np.ndarray]

    def __iter__(self) -> Iterator[np.ndarray]:
        return self.made

    def whole(self) -> np.ndarray:
        """All of it, on rank 0; empty elsewhere."""
        result, first = np.empty(self.shape, self.dtype), 0
        for block in self:
            result.reshape(-1)[first : first + block.size] = block.ravel()
            first += block.size
        return result


class Rows:
    """Rows of a whole of which every rank has some; all ranks make it, and go through its blocks, together.

    number : (k,) int, which ones this rank has; others may have them too
    """

    def __init__(self, number: np.ndarray, team: Team):
        self._team, self._order = team, np.argsort(number, kind="stable")
        self._number = number[self._order]
        self._count = 1 + int(team.max(float(number.max(initial=-1)))[0])

    def blocks(self, values: np.ndarray, axis: int = 0, turn: np.ndarray | None = None) -> Streamed:
        """Values (k, …), or with ``axis`` 1 (T, k, …), of the whole.

        turn : (k,) int: of rows that are there several times the mean, added in this order; None: they are the same
        """
        shape = (*values.shape[:axis], self._count, *values.shape[axis + 1:])
        return Streamed(shape, values.dtype, self._made(values if axis else values[None], turn))

    def _made(self, layers: np.ndarray, turn: np.ndarray | None) -> Iterator[np.ndarray]:
        size = max(1, BLOCK // max(1, layers.itemsize * math.prod(layers.shape[2:])))
        for layer in layers:
            for first in range(0, self._count, size):
                block = self._block(layer, turn, first, min(size, self._count - first))
                if block is not None:
                    yield block

    def _block(self, layer: np.ndarray, turn: np.ndarray | None, first: int, size: int) -> np.ndarray | None:
        """Some rows of the whole, on rank 0."""
        a, b = np.searchsorted(self._number, [first, first + size])
        own, at = self._order[a:b], self._number[a:b] - first
        told = self._team.gather((at, layer[own], None if turn is None else turn[own]))
        if told is None:
            return None
        block = np.zeros((size, *layer.shape[1:]), layer.dtype)
        if turn is None:
            for at, rows, _ in told:
                block[at] = rows
            return block
        at, rows, turns = (np.concatenate(each) for each in zip(*told))
        order = np.argsort(turns, kind="stable")
        np.add.at(block, at[order], rows[order])
        return block / np.maximum(np.bincount(at, minlength=size), 1)[:, None]
