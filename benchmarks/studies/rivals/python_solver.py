"""Solves a written problem by a package of this Python's: a script, in a process of its own.

    python python_solver.py FOLDER METHOD SECONDS WANTED

METHOD is cholmod, pardiso or pyamg; accuracy and seconds as ``petsc_solver`` has them. The error of a factorisation is known
from one step of refinement, δ = K⁻¹r: ‖δ‖²_K = δᵀr. Prints one line of JSON.
"""

import json
import os
import resource
import sys
import time

import numpy as np
import scipy.sparse as sp

BEYOND = 1e-10  # of the residual, for the last iterate's error to be far below what is wanted


class Enough(Exception):
    """The time is over."""


def cholmod(matrix, load, nodes, note):
    from orchestrator.method.sparse.cholmod import factorised

    factor = factorised(sp.tril(matrix, format="csc"), "metis")
    return factor(load), factor


def pardiso(matrix, load, nodes, note):
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=2)  # symmetric positive definite, of which it wants the upper triangle
    upper = sp.csr_matrix(sp.triu(matrix))
    solver.factorize(upper)
    return solver.solve(upper, load), lambda right: solver.solve(upper, right)


def pyamg(matrix, load, nodes, note):
    from pyamg import smoothed_aggregation_solver

    hierarchy = smoothed_aggregation_solver(sp.bsr_matrix(matrix, blocksize=(3, 3)), B=rigid(nodes),
                                            smooth=("jacobi", {"omega": 4 / 3}), symmetry="symmetric")
    return hierarchy.solve(load, tol=BEYOND, accel="cg", maxiter=100000, callback=note), None


def rigid(nodes):
    """(3n, 6) rigid motions of nodes (n, 3)."""
    x, y, z = (nodes - nodes.mean(axis=0)).T
    motions, zero = np.zeros((6, len(nodes), 3)), np.zeros_like(x)
    motions[:3] = np.eye(3)[:, None]
    for motion, spin in zip(motions[3:], ((zero, -z, y), (z, zero, -x), (-y, x, zero))):
        motion[:] = np.stack(spin, axis=1)
    return motions.reshape(6, -1).T


def main(folder, method, limit, wanted):
    indptr, indices, data, load, nodes = (np.load(os.path.join(folder, f"{name}.npy")) for name in (
        "indptr", "indices", "data", "right", "nodes"))
    matrix, noted, noting = sp.csr_matrix((data, indices, indptr)), [], [0.0, 0.0]
    begin, cpu = time.perf_counter(), time.process_time()

    def now():
        return [time.perf_counter() - begin - noting[0], time.process_time() - cpu - noting[1]]

    def note(x):
        at = now()
        noted.append([*at, 0.5 * x @ (matrix @ x) - load @ x])
        noting[0], noting[1] = time.perf_counter() - begin - at[0], time.process_time() - cpu - at[1]
        if at[0] > limit:
            raise Enough

    solved, energy, reached, error = True, float("nan"), None, float("inf")
    try:
        x, again = {"cholmod": cholmod, "pardiso": pardiso, "pyamg": pyamg}[method](matrix, load, nodes, note)
    except Enough:
        solved = False
    final = now()
    if solved:
        energy = load @ x - 0.5 * x @ (matrix @ x)
        left = load - matrix @ x
        if again is not None:
            error = np.sqrt(max(again(left) @ left, 0.0) / (2 * energy))
        elif np.linalg.norm(left) <= 10 * BEYOND * np.linalg.norm(load):
            errors = [np.sqrt(max(value + energy, 0.0) / abs(energy)) for _, _, value in noted]
            reached = next((k for k, e in enumerate(errors) if e <= wanted), None)
            if reached is not None:
                final, error, reached = noted[reached][:2], errors[reached], reached + 1
    print(json.dumps({"solved": bool(solved and error <= wanted), "iterations": reached, "set_up": None, "seconds": final[0],
                      "cpu_seconds": final[1], "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
                      "energy": energy}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]))
