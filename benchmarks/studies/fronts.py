"""Matrices of the coarse contact problem over ranks: milliseconds of the processor that the busiest rank takes, MUMPS beside.

    mpiexec -n 2 python -m benchmarks.studies.fronts 1000 [mumps] [affine]

So many rigid bodies, or bodies in affine fields, with all of these in the fronts and with rigid motions alone; neighbours as those of
random points in a cube. Seconds of the processor do not hang on what else the machine does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import Delaunay

from orchestrator.method.coarse import elimination
from orchestrator.method.coarse.assembly import Assembly
from orchestrator.parallel.petsc import library
from orchestrator.launch import join
from orchestrator.parallel.team import Team

RIGID, AFFINE, TIMES = 6, 12, 8
FAR = 2.2  # mean distances, beyond which points are no neighbours: on the hull


def neighbours(bodies: int) -> np.ndarray:
    """(I, 2) int, of random points in a cube."""
    points = np.random.default_rng(0).random((bodies, 3))
    corners = Delaunay(points).simplices
    ends = np.unique(np.sort(np.concatenate([corners[:, [i, j]] for i in range(4) for j in range(i)]), axis=1), axis=0)
    return ends[np.linalg.norm(np.subtract(*points[ends.T]), axis=1) < FAR * bodies ** (-1 / 3)]


def taken(team: Team, action: Callable[[], object]) -> float:
    """Milliseconds of the processor of the rank that takes most, the least of some times."""
    least = np.inf
    for _ in range(TIMES):
        team.meet()
        begin = time.process_time()
        action()
        least = min(least, *team.max(1000 * (time.process_time() - begin)))
    return least


def main(bodies: int, mumps: bool, affine: bool) -> None:
    team, size = join(), AFFINE if affine else RIGID
    ends, rng = neighbours(bodies), np.random.default_rng(1)
    slopes = rng.normal(scale=0.1, size=(len(ends), 2, 2, size, size))
    own, right = np.repeat(20 * np.eye(size)[None], bodies, axis=0), rng.normal(size=(bodies, size))
    counts = np.bincount(np.arange(len(ends)) % team.size, minlength=team.size)
    mine, told = slice(counts[: team.rank].sum(), counts[: team.rank + 1].sum()), {}
    elimination.WORTH = 0.0
    for name, rigid in {"fronts": 0, **({"rigid motions alone": RIGID} if affine else {})}.items():
        made = Assembly(team, ends, counts, bodies, size, np.arange(len(ends)), rigid)
        values = made.values(slopes[mine], own)
        factors = made.pattern.factors(values, 0.0)
        told |= {f"{name}: factorise": taken(team, lambda: made.pattern.factors(values, 0.0)),
                 f"{name}: solve": taken(team, lambda: factors.solve(right))}
    if mumps:
        values = made.pattern.summed(slopes)
        values[made.pattern.diagonal] += own
        whole = made.pattern.matrix(values, 0.0)
        factorise, solve = by_mumps(team, whole.tocsr(), right.ravel(), size)
        told |= {"MUMPS: factorise": taken(team, factorise), "MUMPS: solve": taken(team, solve)}
    if team.rank == 0:
        print(f"{bodies} bodies, {len(ends)} interfaces, {team.size} ranks:", ", ".join(f"{what} {ms:.1f} ms" for what, ms in told.items()))


def by_mumps(team: Team, matrix: sp.csr_array, right: np.ndarray, size: int) -> tuple[Callable[[], None], Callable[[], None]]:
    """What factorises anew, in the order that is known, and what solves; every rank has a share of the rows."""
    petsc, n = library(), matrix.shape[0]
    rows = petsc.Vec().createMPI(n, bsize=size, comm=petsc.COMM_WORLD).getOwnershipRange()
    part = matrix[rows[0]:rows[1]]
    given = petsc.Mat().createAIJ(((rows[1] - rows[0], n), (rows[1] - rows[0], n)), comm=petsc.COMM_WORLD,
                                  csr=(part.indptr.astype(petsc.IntType), part.indices.astype(petsc.IntType), part.data))
    solver, (b, x), lowest = petsc.KSP().create(petsc.COMM_WORLD), given.createVecs(), np.array([rows[0]], petsc.IntType)
    b.setArray(right[rows[0]:rows[1]])
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")

    def factorise() -> None:
        given.setValues(lowest, lowest, [part[0, rows[0]] * (1 + 1e-9 * np.random.default_rng().random())])  # another matrix
        given.assemble()
        solver.setOperators(given)
        solver.setUp()

    factorise()
    return factorise, lambda: solver.solve(b, x)


if __name__ == "__main__":
    main(int(sys.argv[1]), "mumps" in sys.argv[2:], "affine" in sys.argv[2:])
