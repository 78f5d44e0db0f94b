"""The processes that solve one scene together, and what they tell each other.

``Team`` is the single process: everything is local and costs nothing. ``mpi.MpiRanks`` is the same
over MPI. Sums are taken in the order of the ranks, so that all of them hold the same bits and take
the same decisions. Whether mpiexec (or srun) has started this process is told from the environment;
of MPI nothing is imported unless it has.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from orchestrator import folders


class Team:
    """One process.

    rank, size : which of how many
    waited : seconds spent waiting for others
    messages, bytes : sent to others so far; of what all take part in, this rank's own part of it
        counts as one message
    reductions : of these, sums and maxima over all ranks
    parted : whether a rank has failed: they work together no more
    shared_from : unknowns on the borders between ranks from which PETSc pays. With 4,800 it takes 9
        and 13 s on eight and four ranks instead of 28 and 20, and 174 and 294 MB instead of 282 and
        140; with 1,200 both take some seconds (``benchmarks.studies.borders``)
    """

    rank, size, shared_from = 0, 1, 5000
    waited = 0.0
    parted = False
    messages = bytes = reductions = 0

    def both(self, parts: Sequence,
             largest: Sequence[float]) -> tuple[list[np.ndarray], list[float]]:
        """Sums of arrays (or numbers) over the ranks, and the largest of each of some values, the
        same bits everywhere.
        """
        return [np.asarray(part, float) for part in parts], [float(value) for value in largest]

    def sum(self, *parts) -> list[np.ndarray]:
        """Sums of arrays (or numbers) over the ranks."""
        return self.both(parts, ())[0]

    def max(self, *values: float) -> list[float]:
        """Largest of each value over the ranks; nan where any is."""
        return self.both((), values)[1]

    def meet(self) -> None:
        """Wait until all ranks are here."""

    def exchange(self, outgoing: Mapping[int, np.ndarray],
                 incoming: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Point to point: send an array to each of some ranks, and receive one of known size from
        each of some.
        """
        return incoming

    def deliver(self, outgoing: Sequence[np.ndarray]) -> list[np.ndarray]:
        """An array of numbers to every rank, most of them empty: what each of the ranks has for
        this one, flat; all ranks take part.
        """
        return [np.ravel(array) for array in outgoing]

    def all_gather(self, part: Any) -> list[Any]:
        """Every rank's object, on all ranks."""
        return self.share(self.gather(part))

    def gather(self, part: Any) -> list[Any] | None:
        """Every rank's object, on rank 0; None elsewhere."""
        return [part]

    def share(self, thing: Any) -> Any:
        """Rank 0's object, on all ranks."""
        return thing

    def spread(self, array: np.ndarray) -> np.ndarray:
        """Rank 0's array on all ranks, where others have room for it: as ``share``, in one
        message.
        """
        return array

    def hand_out(self, make: Callable[[int], Any]) -> Any:
        """Return what rank 0 makes for each rank, one after the other: nobody holds more than one
        of
        them.
        """
        return make(0)

    def cores(self) -> float:
        """Cores this process may count as its own."""
        return float(len(os.sched_getaffinity(0)))

    def together(self) -> AbstractContextManager:
        """The block that all ranks run: if one fails, all leave it."""
        return nullcontext()

    def part(self, error: BaseException) -> None:
        """Have all others end for a failure after which this rank alone goes on."""

    def cause(self, error: BaseException) -> BaseException:
        """Return what ended the run, where another rank's failure may be behind the error."""
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
# Each launcher's number of processes and number of this process: Open MPI; MPICH, Intel MPI and
# Slurm's PMI; MVAPICH;
# Slurm with PMIx, which sets PMIX_RANK in the processes of a parallel step only.
_VARIABLES = (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK"),
              ("MV2_COMM_WORLD_SIZE", "MV2_COMM_WORLD_RANK"), ("SLURM_STEP_NUM_TASKS", "PMIX_RANK"))
# Where ranks of one host share memory, and what tells Open MPI to do it elsewhere: 4 by this name
# alone, 5 by it too.
SHARED, BACKING = "/dev/shm", "OMPI_MCA_btl_vader_backing_directory"


def launched(environment: Mapping[str, str] = os.environ) -> tuple[int, int]:
    """(rank, size) as the launcher says; (0, 1) without one."""
    for size, rank in _VARIABLES:
        if environment.get(size, "").isdigit() and environment.get(rank, "").isdigit():
            return int(environment[rank]), int(environment[size])
    return 0, 1


def watched() -> bool:
    """Whether a terminal is one that somebody looks at: Open MPI gives each rank one, wherever it
    writes to itself.
    """
    return launched()[1] == 1


def share_memory() -> None:
    """Make a folder of this rank's own for what Open MPI shares with others of its host, swept like
    all
    others where it is killed.
    """
    if {BACKING,
        BACKING.replace("vader", "sm")} & os.environ.keys() or not os.access(SHARED, os.W_OK):
        return
    folder = folders.make(SHARED)
    os.environ[BACKING] = str(folder)
    atexit.register(folders.remove, folder)  # before MPI is imported, so that it has ended by then
