"""PETSc over the ranks: MUMPS factorises a sum of blocks of which each rank has one, and nobody
holds the whole.

petsc4py comes from Debian, for its own Python (``./setup.sh cluster`` makes an environment of it),
or from conda-forge. pip would compile all of PETSc, without MUMPS unless told: it is no extra of
this package.

PETSc and MUMPS wait inside MPI, where they hear of no failure and keep their core busy. The ranks
meet before each call (``Team.meet``), waiting outside: inside, all are at work at the same time.
"""

from __future__ import annotations

import atexit
import os
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import scipy.sparse as sp

from orchestrator.linalg import BACKWARD
from orchestrator.optional import absent
from orchestrator.parallel.team import Team

NUMPY_2 = (3, 21)  # the first binding that goes with numpy 2
CURE = (
    "./setup.sh cluster makes an environment with Debian's python3-petsc4py, .venv-cluster; "
    "conda-forge has petsc4py too")
OPTIONS = ("-no_signal_handler", "-skip_petscrc")  # signals are ours


def lacking(installed: str = "/usr/lib/petscdir") -> str:
    """Why there is no PETSc for this Python, and what brings one; empty where there is one. PETSc
    itself is not loaded.

    installed : where Debian's versions are, each with its binding, which Python finds by itself
        only where PETSC_DIR is set
    """
    if absent("petsc4py"):
        folders, ours = _folders(installed), f"petsc4py/lib/PETSc.{sys.implementation.cache_tag}-*"
        sys.path += [str(folder) for folder in folders if list(folder.glob(ours))][:1]
        if folders and absent("petsc4py"):
            return (
                f"petsc4py in {folders[0]} is not for Python "
                f"{sys.version_info.major}.{sys.version_info.minor}; {CURE}")
    if absent("petsc4py"):
        return f"petsc4py is not installed; {CURE}"
    version = import_module("petsc4py").__version__
    if np.__version__[0] >= "2" and tuple(map(int, version.split(".")[:2])) < NUMPY_2:
        return (
            f"petsc4py {version} goes with numpy below 2, and numpy {np.__version__} is here; "
            f"{CURE}")
    return ""


def _folders(installed: str) -> list[Path]:
    """Where bindings may be that Python does not look for, PETSC_DIR's first, then the newest;
    complex numbers are not asked for.
    """
    found = [Path(path) / "lib/python3/dist-packages"
             for path in [*filter(None, [os.environ.get("PETSC_DIR")]),
                          *sorted(Path(installed).glob("petsc*/*-real"), reverse=True)]]
    return [path for path in found if (path / "petsc4py").is_dir()]


@cache
def library() -> ModuleType | str:
    """PETSc, loaded and begun, or why not; where there are ranks all of them ask."""
    if why := lacking():
        return why
    try:
        import_module("petsc4py").init([sys.argv[0], *OPTIONS])
        found = import_module("petsc4py.PETSc")
    except ImportError as error:
        return f"petsc4py cannot be loaded: {error}; {CURE}"
    atexit.register(found._finalize)  # before MPI is ended, which began earlier
    if np.dtype(found.ScalarType) != np.float64:
        return (
            f"PETSc computes with {np.dtype(found.ScalarType)}, not with real numbers in double "
            f"precision; {CURE}")
    return found if found.Sys.hasExternalPackage(
        "mumps") else f"PETSc has been built without MUMPS; {CURE}"


def shared_by(team: Team) -> ModuleType | None:
    """PETSc, if all ranks have it and it sees all of them."""
    there, = team.max(float(bool(lacking())))
    if there:
        return None
    team.meet()  # it begins on all ranks together
    found = library()
    # another MPI than mpi4py's sees one rank
    failed, = team.max(float(isinstance(found, str) or found.COMM_WORLD.size != team.size))
    return None if failed else found


class SpreadBlocks:
    """Solves with A = Σ Rᵣᵀ Bᵣ Rᵣ, symmetric and positive definite but for rounding: every rank has
    a block, and its own solution.

    petsc : as of ``shared_by``
    block : (n, n) B of this rank, symmetric, dense or sparse
    place : (n,) int, which rows of A these are; owned : how many of them this rank keeps. Places
        count rank by rank, each its own
    team : the ranks
    Raises RuntimeError: A is singular, or MUMPS has not solved it
    """

    def __init__(self, petsc: ModuleType, block: np.ndarray | sp.sparray, place: np.ndarray,
                 owned: int, team: Team):
        self._petsc, self._team = petsc, team
        world, alone, places = petsc.COMM_WORLD, petsc.COMM_SELF, place.astype(petsc.IntType)
        team.meet()
        rows = petsc.LGMap().create(places, comm=world)
        matrix = petsc.Mat().createIS(((owned, petsc.DETERMINE),) * 2, lgmapr=rows, lgmapc=rows,
                                      comm=world)
        matrix.setISLocalMat(_local(petsc, block))
        matrix.assemble()
        matrix.convert("aij")  # in place
        # not as positive definite: rounding may have made it indefinite, and MUMPS then chooses
        # pivots
        matrix.setOption(petsc.Mat.Option.SYMMETRIC, True)
        self._solver = petsc.KSP().create(world)
        self._solver.setOperators(matrix)
        self._solver.setType("preonly")
        conditioner = self._solver.getPC()
        conditioner.setType("cholesky")
        conditioner.setFactorSolverType("mumps")
        self._solver.setUp()
        self._right, self._left = matrix.createVecs()
        self._mine = petsc.Vec().createSeq(len(place), comm=alone)
        self._moved = petsc.Scatter().create(self._right,
                                             petsc.IS().createGeneral(places, comm=alone),
                                             self._mine, None)
        told = conditioner.getFactorMatrix().getMumpsInfog(1)
        if told < 0:
            raise RuntimeError("a pivot vanishes" if told == -10
                               else f"MUMPS ends with code {told}")
        self._check(matrix)

    def _check(self, matrix) -> None:
        """Raises RuntimeError: a right-hand side is not solved; libraries of different MPIs have
        been mixed, say.
        """
        first, last = self._right.getOwnershipRange()
        right = np.random.default_rng(first).uniform(-1.0, 1.0, last - first)
        self._right.setArray(right)
        self._solver.solve(self._right, self._left)
        most = self._petsc.NormType.INFINITY
        found = self._left.norm(most)
        left = matrix.createVecLeft()
        matrix.mult(self._left, left)
        left.axpy(-1.0, self._right)
        apart, largest = left.norm(most), matrix.norm(most)
        if not apart <= BACKWARD * (largest * found + 1.0):
            raise RuntimeError(f"MUMPS leaves a residual of {apart:.1e}")

    def __call__(self, parts: np.ndarray) -> np.ndarray:
        """(T, n) solutions at this rank's places, of the sums of all ranks' parts (T, n) of the
        right-hand sides.
        """
        petsc, result = self._petsc, np.empty_like(parts)
        self._team.meet()
        for part, solution in zip(parts, result):
            self._right.set(0.0)
            self._mine.setArray(part)
            self._moved.scatter(self._mine, self._right, addv=petsc.InsertMode.ADD_VALUES,
                                mode=petsc.ScatterMode.REVERSE)
            self._solver.solve(self._right, self._left)
            self._moved.scatter(self._left, self._mine, mode=petsc.ScatterMode.FORWARD)
            solution[:] = self._mine.getArray()
        return result


def _local(petsc: ModuleType, block: np.ndarray | sp.sparray) -> object:
    """A matrix of this rank alone."""
    if not sp.issparse(block):
        return petsc.Mat().createDense(block.shape, array=np.asfortranarray(block),
                                       comm=petsc.COMM_SELF)
    rows = sp.csr_array(block)
    return petsc.Mat().createAIJ(rows.shape,
                                 csr=(*(x.astype(petsc.IntType)
                                        for x in (rows.indptr, rows.indices)), rows.data),
                                 comm=petsc.COMM_SELF)
