"""The rivals by name: what each needs, how it is run, and what it answers.

A rival gets the matrix of the undecomposed structure, on the dofs that are free, ready in its
memory. It is charged for what it does from there on until its error is small enough, not for its start, its imports, or
for reading the matrix.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.commands import MPI
from benchmarks.kit.elasticity import stiffness
from benchmarks.kit.true_errors import direct
from orchestrator import InputError, Problem

DEBIAN, MPIEXEC = "/usr/bin/python3", "/usr/bin/mpiexec"  # PETSc's binding is a package of Debian's own Python
_PETSC = "/usr/lib/petscdir"
GRACE = 1.5  # of the time allowed, for starting, reading, and what is not charged
_MPI = MPI | {"OMPI_MCA_rmaps_base_oversubscribe": "1"}


@dataclass(frozen=True)
class Rival:
    """Another solver.

    Parameters
    ----------
    method : as its script calls it
    label : for people
    package : of this Python that it needs; None: Debian's PETSc
    iterative : conjugate gradients, not a factorisation
    """

    method: str
    label: str
    package: str | None
    iterative: bool

    def missing(self) -> str | None:
        """Why it cannot be run here; None where it can."""
        if self.package is not None:
            return None if importlib.util.find_spec(self.package) else f"{self.package} is not installed"
        return None if petsc_binding() and Path(MPIEXEC).is_file() else "python3-petsc4py is not installed"

    def command(self, folder: Path, ranks: int, patience: float, wanted: float) -> tuple[list[str], dict[str, str]]:
        """Command line and environment."""
        script = Path(__file__).with_name("petsc_solver.py" if self.package is None else "python_solver.py")
        words, environment = [str(script), str(folder), self.method, f"{patience:g}", f"{wanted:g}"], dict(os.environ)
        if self.package is not None:
            return [sys.executable, *words], environment
        environment["PYTHONPATH"] = str(petsc_binding())
        return [MPIEXEC, "-n", str(ranks), DEBIAN, *words], {**environment, **_MPI}


RIVALS = {rival.method: rival for rival in (
    Rival("gamg", "PETSc, GAMG", None, True), Rival("hypre", "PETSc, hypre", None, True),
    Rival("pyamg", "pyamg", "pyamg", True), Rival("mumps", "PETSc, MUMPS", None, False),
    Rival("pardiso", "PARDISO", "pypardiso", False), Rival("cholmod", "CHOLMOD", "orchestrator", False))}


def petsc_binding() -> Path | None:
    """The folder of Debian's petsc4py for real numbers, of the newest PETSc there is."""
    found = sorted(Path(_PETSC).glob("petsc*/*-real/lib/python3/dist-packages"))
    return found[-1] if found and Path(DEBIAN).is_file() else None


@dataclass(frozen=True)
class Written:
    """A problem on disk.

    Parameters
    ----------
    folder : of its arrays: the matrix in compressed rows, the load, and the coordinates of the nodes
    dofs : of the structure, those included that are held
    mesh, assembly : seconds, the latter on FreeFEM's own clock, in one process
    """

    folder: Path
    dofs: int
    mesh: float
    assembly: float


def write_problem(config: Mapping[str, Any], folder: Path) -> Written:
    """Make the mesh, solve once in one piece by FreeFEM, which tells how long it assembles, and write the matrix for rivals.

    Raises
    ------
    InputError : nodes that are held in some components only, or displacements other than zero
    """
    solved = direct(config)
    scene, timing = solved.scene, solved.summary["timing"]
    held = scene.fixed.all(axis=1)
    if (scene.fixed.any(axis=1) != held).any() or scene.prescribed[:, held].any() or scene.steps > 1:
        raise InputError(Problem((), "nodes held in part, moved, or several load steps", "one load step of nodes held whole",
                                 "rivals are written problems of that kind alone"))
    young, poisson = np.array([[m.young, m.poisson] for m in scene.materials])[scene.cell_material].T
    free = np.flatnonzero(np.repeat(~held, 3))
    matrix = stiffness(scene.mesh.nodes, scene.mesh.cells, young, poisson)[free][:, free]
    matrix.sort_indices()
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in {"indptr": matrix.indptr.astype(np.int32), "indices": matrix.indices.astype(np.int32),
                        "data": matrix.data, "right": scene.loads.reshape(-1)[free],
                        "nodes": scene.mesh.nodes[~held]}.items():
        np.save(folder / f"{name}.npy", array)
    return Written(folder, scene.fixed.size, timing["mesh"], timing["blackbox"]["assemble"])


def compete(rival: Rival, problem: Written, ranks: int, patience: float, wanted: float) -> dict[str, Any]:
    """What a rival answers.

    Parameters
    ----------
    patience : wall seconds after which it has failed
    wanted : relative error in the energy norm

    Returns
    -------
    solved, iterations, set_up, seconds, cpu_seconds, memory_mb (all ranks), energy; of one that fails, solved and failure
    """
    command, environment = rival.command(problem.folder, ranks, patience, wanted)
    with subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            # the script minds the time itself between iterations; a factorisation cannot
            said, complaint = process.communicate(timeout=GRACE * patience)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpiexec then ends its ranks
            process.communicate()
            return {"solved": False, "failure": f"not within {patience:g} s"}
    line = next((line for line in said.splitlines() if line.startswith("{")), None)
    if process.returncode or line is None:
        return {"solved": False, "failure": (complaint.strip().splitlines() or ["no answer"])[-1][:120]}
    answer = json.loads(line)
    return answer if answer["solved"] else {**answer, "failure": f"not within {patience:g} s"}


def present(names: Sequence[str], tell: Callable[[str], None]) -> list[Rival]:
    """Those of the rivals that can be run here; the others are told."""
    found = []
    for name in names:
        why = RIVALS[name].missing()
        if why is None:
            found.append(RIVALS[name])
        else:
            tell(f"{RIVALS[name].label} is left out: {why} (make rivals)")
    return found
