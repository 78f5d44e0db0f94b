"""The processes that solve one scene together, and what they tell each other.

The method knows this interface only. ``Team`` is the single process: everything is local and costs
nothing. ``mpi.Ranks`` is the same over MPI; ``join`` imports it only where mpiexec has started the program.

Sums are taken in the order of the ranks, so that all of them hold the same bits and take the same decisions.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np


class Team:
    """One process.

    Attributes
    ----------
    rank, size : which of how many
    waited : seconds spent waiting for others
    messages, bytes : sent to others so far; of what all take part in, this rank's own part of it counts as one message
    reductions : of these, sums and maxima over all ranks: what nobody goes on without who needs them
    """

    rank, size = 0, 1
    waited = 0.0
    messages = bytes = reductions = 0

    def sum_later(self, *parts) -> Callable[[], list[np.ndarray]]:
        """Begin to sum arrays (or numbers) over the ranks; calling what is returned waits for the sums."""
        return lambda: [np.asarray(part, float) for part in parts]

    def sum(self, *parts) -> list[np.ndarray]:
        """Sums of arrays (or numbers) over the ranks, the same bits everywhere."""
        return self.sum_later(*parts)()

    def max_later(self, *values: float) -> Callable[[], list[float]]:
        """Begin to find the largest of each value over the ranks; calling what is returned waits for them."""
        return lambda: [float(value) for value in values]

    def max(self, *values: float) -> list[float]:
        """Largest of each value over the ranks."""
        return self.max_later(*values)()

    def both_later(self, parts: Sequence, largest: Sequence[float]) -> Callable[[], tuple[list[np.ndarray], list[float]]]:
        """Begin to sum some and to find the largest of others: in one message, where there are not many numbers."""
        sums, ends = self.sum_later(*parts), self.max_later(*largest)
        return lambda: (sums(), ends())

    def exchange(self, outgoing: Mapping[int, np.ndarray],
                 incoming: Mapping[int, tuple[int, ...]]) -> dict[int, np.ndarray]:
        """Point to point: send an array to each of some ranks, receive one of known shape from each of some."""
        outgoing = {rank: np.ascontiguousarray(array) for rank, array in outgoing.items()}
        return self.exchange_later(outgoing, {rank: np.empty(shape) for rank, shape in incoming.items()})()

    def exchange_later(self, outgoing: Mapping[int, np.ndarray],
                       incoming: dict[int, np.ndarray]) -> Callable[[], dict[int, np.ndarray]]:
        """Begin to send arrays that lie together in memory, and to receive into others; calling what is returned waits for all.

        Until then nobody may write into either. All ranks begin their exchanges in the same order.
        """
        return lambda: incoming

    def all_gather(self, part: Any) -> list[Any]:
        """Every rank's object, on all ranks."""
        return [part]

    def gather(self, part: Any) -> list[Any] | None:
        """Every rank's object, on rank 0; None elsewhere."""
        return [part]

    def gather_later(self, part: np.ndarray, sizes: list[int]) -> Callable[[], list[np.ndarray] | None]:
        """Begin to bring arrays of known sizes, flattened, to rank 0; calling what is returned waits for them."""
        return lambda: [part.ravel()]

    def share(self, thing: Any) -> Any:
        """Rank 0's object, on all ranks."""
        return thing

    def hand_out(self, make: Callable[[int], Any]) -> Any:
        """What rank 0 makes for each rank, one after the other: nobody holds more than one of them."""
        return make(0)

    def cores(self) -> float:
        """Cores this process may count as its own."""
        return float(len(os.sched_getaffinity(0)))

    def together(self) -> AbstractContextManager:
        """The block that all ranks run: if one fails, all leave it."""
        return nullcontext()

    def cause(self, error: BaseException) -> BaseException:
        """What ended the run, where another rank's failure may be behind the error."""
        return error

    def lost(self) -> list[int]:
        """Ranks of this node whose process is no more."""
        return []

    def speaks(self) -> bool:
        """Whether it is this rank that tells the user."""
        return True


class Elsewhere(BaseException):
    """Another rank has failed; ``error`` is what it met, ``rank`` which one."""

    def __init__(self, rank: int, error: BaseException):
        super().__init__(f"rank {rank}: {error}")
        self.rank, self.error = rank, error


ALONE = Team()
