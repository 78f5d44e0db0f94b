"""Whether mpiexec (or srun) has started this process, told from the environment: nothing of MPI is imported."""

from __future__ import annotations

import os
from collections.abc import Mapping

# Each launcher's number of processes and number of this process: Open MPI; MPICH, Intel MPI and Slurm's PMI; MVAPICH;
# Slurm with PMIx, which sets PMIX_RANK in the processes of a parallel step only.
_VARIABLES = (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK"),
              ("MV2_COMM_WORLD_SIZE", "MV2_COMM_WORLD_RANK"), ("SLURM_STEP_NUM_TASKS", "PMIX_RANK"))
_PREFIXES = ("OMPI_", "PMI_", "PMIX_", "PRTE_", "MV2_", "HYDRA_", "HYDI_", "MPI_LOCAL")


def launched(environment: Mapping[str, str] = os.environ) -> tuple[int, int]:
    """(rank, size) as the launcher says; (0, 1) without one."""
    for size, rank in _VARIABLES:
        if environment.get(size, "").isdigit() and environment.get(rank, "").isdigit():
            return int(environment[rank]), int(environment[size])
    return 0, 1


def without_launcher(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a code that is no part of the parallel run, even if it was built with MPI."""
    return {name: value for name, value in environment.items() if not name.startswith(_PREFIXES)}
