"""Solves a written problem by PETSc: a script for Debian's own Python, alone or over ranks.

    mpiexec -n 2 /usr/bin/python3 petsc_solver.py FOLDER METHOD SECONDS

METHOD is gamg, hypre or mumps. Conjugate gradients go on beyond what is wanted, and each iterate's potential energy is
noted; ½‖x − x*‖²_K is the difference to that of the last one. What counts are the seconds until the error was small
enough, known afterwards: no rival is charged for knowing its error, nor for the noting. Prints one line of JSON.
"""

import json
import os
import resource
import sys
import time

import numpy as np

BEYOND = 1e-9  # of the residual's natural norm: the last iterate's error is a thousandth of what is wanted
OPTIONS = {
    "gamg": ["-pc_type", "gamg"],  # its defaults: no other thresholds, smoothers or coarsenings were faster on the cubes
    "hypre": ["-pc_type", "hypre", "-pc_hypre_type", "boomeramg", "-pc_hypre_boomeramg_strong_threshold", "0.5",
              "-pc_hypre_boomeramg_coarsen_type", "HMIS", "-pc_hypre_boomeramg_interp_type", "ext+i",
              "-pc_hypre_boomeramg_P_max", "4", "-pc_hypre_boomeramg_nodal_coarsen", "4"],
    "mumps": ["-pc_type", "cholesky", "-pc_factor_mat_solver_type", "mumps"],
}


def main(folder, method, limit, wanted):
    import petsc4py

    petsc4py.init(["petsc_solver", *OPTIONS[method]])
    from petsc4py import PETSc

    comm = PETSc.COMM_WORLD
    indptr, indices, data, right, nodes = (np.load(os.path.join(folder, f"{name}.npy"), mmap_mode="r") for name in (
        "indptr", "indices", "data", "right", "nodes"))
    first, last = (3 * (len(nodes) * r // comm.size) for r in (comm.rank, comm.rank + 1))
    rows, span = np.array(indptr[first : last + 1]), slice(int(indptr[first]), int(indptr[last]))
    shape = (last - first, len(right))
    matrix = PETSc.Mat().createAIJ((shape, shape), bsize=3, comm=comm, csr=(
        rows - rows[0], np.array(indices[span]), np.array(data[span])))
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    x, load, product = matrix.createVecRight(), matrix.createVecLeft(), matrix.createVecLeft()
    load.setArray(np.array(right[first:last]))
    centres = PETSc.Vec().createWithArray(np.array(nodes[first // 3 : last // 3]).ravel(), bsize=3, comm=comm)
    matrix.setNearNullSpace(PETSc.NullSpace().createRigidBody(centres))

    def everywhere(value):
        """(sum, largest) of a number of each rank; waits for all of them."""
        each = PETSc.Vec().createMPI((1, comm.size), comm=comm)
        each.setArray([value])
        return each.sum(), each.max()[1]

    def potential(vector):
        matrix.mult(vector, product)
        return 0.5 * product.dot(vector) - load.dot(vector)

    everywhere(0.0)
    begin, cpu, noting = time.perf_counter(), time.process_time(), [0.0, 0.0]
    solver, noted = PETSc.KSP().create(comm), []
    solver.setOperators(matrix)
    solver.setType("preonly" if method == "mumps" else "cg")
    if method != "mumps":
        solver.setNormType(PETSc.KSP.NormType.NATURAL)
        solver.setTolerances(rtol=BEYOND, atol=0.0, max_it=100000)

        def note(solver, iteration, norm):
            at = [time.perf_counter() - begin - noting[0], time.process_time() - cpu - noting[1]]
            noted.append([*at, potential(solver.buildSolution())])
            if iteration and everywhere(at[0])[1] > limit:
                solver.setConvergedReason(PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)
            noting[0], noting[1] = time.perf_counter() - begin - at[0], time.process_time() - cpu - at[1]

        solver.setMonitor(note)
    solver.setFromOptions()
    solver.setUp()
    set_up = time.perf_counter() - begin - noting[0]
    solver.solve(load, x)
    final = [time.perf_counter() - begin - noting[0], time.process_time() - cpu - noting[1]]
    peak, _ = everywhere(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6)
    energy = -potential(x)
    solved = solver.getConvergedReason() > 0 and np.isfinite(energy) and energy > 0
    errors = [np.sqrt(max(value + energy, 0.0) / abs(energy)) for _, _, value in noted]
    reached = next((k for k, error in enumerate(errors) if error <= wanted), None)
    if noted and reached is not None:
        final, error = noted[reached][:2], errors[reached]
    elif noted:
        error = float("inf")
    else:  # a factorisation: its error δ = K⁻¹ r is known from one step of refinement, ‖δ‖²_K = δᵀ r
        product.aypx(-1.0, load)
        solver.solve(product, x)
        error = np.sqrt(max(product.dot(x), 0.0) / (2 * energy)) if energy > 0 else float("inf")
    spent, _ = everywhere(final[1])
    _, wall = everywhere(final[0])
    if comm.rank == 0:
        print(json.dumps({"solved": bool(solved and error <= wanted), "iterations": reached, "set_up": set_up, "seconds": wall,
                          "cpu_seconds": spent, "memory_mb": peak, "energy": energy}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]))
