"""The processes that solve one scene together, and what they tell each other.

``Team`` is the single process: everything is local and costs nothing. ``mpi.Ranks`` is the same over MPI. Sums are taken in
the order of the ranks, so that all of them hold the same bits and take the same decisions.
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
    reductions : of these, sums and maxima over all ranks
    """

    rank, size = 0, 1
    waited = 0.0
    messages = bytes = reductions = 0

    def both(self, parts: Sequence, largest: Sequence[float]) -> tuple[list[np.ndarray], list[float]]:
        """Sums of arrays (or numbers) over the ranks, and the largest of each of some values, the same bits everywhere."""
        return [np.asarray(part, float) for part in parts], [float(value) for value in largest]

    def sum(self, *parts) -> list[np.ndarray]:
        """Sums of arrays (or numbers) over the ranks."""
        return self.both(parts, ())[0]

    def max(self, *values: float) -> list[float]:
        """Largest of each value over the ranks; nan where any is."""
        return self.both((), values)[1]

    def exchange(self, outgoing: Mapping[int, np.ndarray], incoming: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Point to point: send an array to each of some ranks, and receive one of known size from each of some."""
        return incoming

    def all_gather(self, part: Any) -> list[Any]:
        """Every rank's object, on all ranks."""
        return self.share(self.gather(part))

    def gather(self, part: Any) -> list[Any] | None:
        """Every rank's object, on rank 0; None elsewhere."""
        return [part]

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
