"""What ranks find with PETSc and without: run by mpiexec on a Python that has petsc4py, rank 0 writes what the tests compare."""

import sys
from pathlib import Path

import numpy as np
from ranks_case import found
from threads import chain

from orchestrator.method.interface import spread
from orchestrator.method.sparse.symmetric import whole
from orchestrator.parallel.petsc import lacking, shared_by
from orchestrator.launch import join

SCENES = ("perfect", "soft modes")


def matrices(team) -> dict[str, np.ndarray]:
    """Solutions of a ring's matrix, as far as this rank sees them, twice by either engine; and what they say of a singular one."""
    lower, number, shared = chain(team.size, 7)[team.rank]
    right = np.random.default_rng(team.rank).standard_normal((2, len(number)))
    result = {}
    for name, least, engine in (("common", np.inf, spread.CommonBlocks), ("spread", 0, spread.SpreadBlocks)):
        team.shared_from = least
        factor = spread.SpreadFactor(lower, number, shared, team)
        assert type(factor._border) is engine
        result[name] = np.array([factor(right), factor(right)])
        sparse = spread.semidefinite(whole(lower), number, team)
        assert isinstance(sparse, spread.SpreadBlocks) == (name == "spread")
        result[f"sparse, {name}"] = sparse(right)
        try:
            spread.on_borders(np.ones((3, 3)), np.arange(3), team)
            result[f"singular, {name}"] = np.array("solved")
        except RuntimeError as error:
            result[f"singular, {name}"] = np.array(str(error))
    return result


if __name__ == "__main__":
    assert not lacking(), lacking()
    team, folder = join(), Path(sys.argv[1])
    with team.together():
        assert shared_by(team) is not None
        for rank, found_there in enumerate(team.all_gather(matrices(team))):
            if team.rank == 0:
                np.savez(folder / f"rank-{rank}.npz", **found_there)
        for scene in SCENES:
            for name, team.shared_from in (("common", np.inf), ("spread", 0)):
                answer = found(scene, team)
                if answer is not None:
                    np.savez(folder / f"{scene}-{name}.npz", **answer)
