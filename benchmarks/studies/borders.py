"""The macro problem of a cube of subdomains over ranks, its borders dense or by PETSc: seconds, and what ranks hold.

    mpiexec -n 4 .venv-cluster/bin/python -m benchmarks.studies.borders 16 dense
    mpiexec -n 4 .venv-cluster/bin/python -m benchmarks.studies.borders 16 petsc

The argument is the number of subdomains along the cube's side; the matrix has the macro problem's pattern. Prints a line of JSON: of the
slowest rank the seconds to eliminate what each rank alone sees, to factorise what is left on the borders, and to solve; of the rank that
holds most the MB that its peak has grown by since the elimination.
"""

from __future__ import annotations

import json
import resource
import sys
import time

import numpy as np
import scipy.sparse as sp

from benchmarks.studies.prediction import macro_of, touches
from orchestrator.method.interface import spread
from orchestrator.parallel.numbering import owners
from orchestrator.launch import join
from orchestrator.parallel.team import Team

SOLUTIONS = 20  # about as many as a run has iterations
FIELDS = 9  # affine ones, of a plane interface


def part_of(side: int, team: Team) -> tuple[sp.csr_array, np.ndarray, np.ndarray]:
    """The lower triangle of this rank's part of the matrix, the numbers of its unknowns, and which of these another rank sees."""
    whole = touches(side)
    pairs = whole.indices.reshape(-1, 2)
    owner = owners(np.ones(side**3), pairs, np.ones(len(pairs), dtype=int), team.size)
    seen = np.flatnonzero((owner[pairs] == team.rank).any(axis=1))
    mine = sp.csr_array(whole[seen][:, owner == team.rank])
    number = (FIELDS * seen[:, None] + np.arange(FIELDS)).ravel()
    apart = owner[pairs[seen, 0]] != owner[pairs[seen, 1]]
    return sp.csr_array(sp.tril(macro_of(mine, FIELDS))), number, np.repeat(apart, FIELDS)


def measure(side: int, engine: str, team: Team) -> dict[str, float]:
    """What the module tells, on every rank."""
    team.shared_from = {"dense": np.inf, "petsc": 0}[engine]
    lower, number, shared = part_of(side, team)
    at = []

    def noted() -> int:
        """The time, once all are here; the most memory so far, MB."""
        team.meet()
        at.append(time.perf_counter())
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024

    noted()
    block = spread.Elimination(lower, shared).left()
    held = noted()
    border = spread.on_borders(block, number[shared], team)
    noted()
    for _ in range(SOLUTIONS):
        border(np.ones((1, len(block))))
    gained = noted() - held
    eliminate, factorise, solve = np.diff(at)
    total = spread.places(number[shared], team)[1].sum()
    eliminate, factorise, solve, gained, most = team.max(eliminate, factorise, solve / SOLUTIONS, gained, len(block))
    return {"engine": type(border).__name__, "ranks": team.size, "subdomains": side**3, "on borders": int(total), "most of a rank": most,
            "eliminate": eliminate, "factorise": factorise, "solve": solve, "MB": gained}


if __name__ == "__main__":
    ranks = join()
    with ranks.together():
        told = measure(int(sys.argv[1]), sys.argv[2], ranks)
        if ranks.rank == 0:
            print(json.dumps({name: round(value, 5) if isinstance(value, float) else value for name, value in told.items()}))
