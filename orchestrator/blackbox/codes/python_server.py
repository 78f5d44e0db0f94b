"""Hosts a black box written in Python in a process of its own.

    python -m orchestrator.blackbox.codes.python_server CODE OPTIONS REQUESTS REPLIES [FOLDER]

The other end is the orchestrator, which speaks the bytes of ``messages``; CODE names the class that
answers, see ``template`` for its three methods, and OPTIONS are its keyword arguments, as JSON. In
FOLDER modules are looked for that are nowhere else: numpy.py there is not numpy. An exception ends
the process: its traceback is in the log that the error quotes.
"""

from __future__ import annotations

import inspect
import json
import resource
import sys
import time
import warnings

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from orchestrator.blackbox.codes.adapter import (
    diagnosis, made, NO_SOLVER, NoSolver, promised, read_model, solver_class)
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages


def clock() -> float:
    """CPU seconds of this process and of the children it has waited for: a solver may start
    programs.
    """
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


SYMMETRIC = 1e-10  # relative
# Of the forces, what a load step may leave over. Answers must be a thousand times better than the
# residual that is
# iterated away, or the iterations do not converge.
UNBALANCED = 1e-9


class Server:
    """Answers one request after the other, from and to binary streams."""

    def __init__(self, solver, requests, replies):
        self.solver, self.requests, self.replies = solver, requests, replies
        self.models: dict[int, Model] = {}
        self.prepared: dict[int, object] = {}
        # stiffness of models that have not been asked since they were loaded
        self.unproven: dict[int, sp.csr_array] = {}
        self.elastic: dict[int, sp.csr_array] = {}  # stiffness of nonlinear models
        # the stiffness, which is assembled anyway
        self.handed = len(inspect.signature(solver.prepare).parameters) > 1

    def run(self) -> None:
        """Serve until told to quit, or until the orchestrator is gone."""
        self._reply([0, 0, promised(self.solver)], [clock(), 0, 0], [])
        answers = {messages.LOAD: self._load, messages.TRACES: self._solve,
                   messages.FIELDS: self._solve,
                   messages.STIFFNESS: self._stiffness, messages.OWN_LOADS: self._own_loads,
                   messages.ADVANCE: self._advance}
        while len(head := self.requests.read(8)) == 8:
            op = int(np.frombuffer(head, np.int64)[0])
            if op == messages.QUIT:
                return
            answers[op](op, self._array(np.int64), self._array(np.float64))

    def _load(self, op: int, ints: np.ndarray, reals: np.ndarray) -> None:
        index, start = int(ints[0]), clock()
        model = read_model(f"mesh-{index}.npz")
        stiffness = self._matrix(model)
        assembled = clock()
        self.models[index] = model
        self.prepared[index] = self.solver.prepare(model, *([stiffness] if self.handed else []))
        residual = self._probe(index, stiffness)
        self.unproven[index] = stiffness
        if getattr(self.solver, "nonlinear", False):
            self.elastic[index] = stiffness
        seconds = [assembled - start, clock() - assembled, 0]
        self._reply([index, 0, model.fixed.size, 1], seconds, [residual])

    def _probe(self, index: int, stiffness: sp.csr_array) -> float:
        """Relative residual of three load cases; raises ValueError when the solver, not the model,
        is wrong.
        """
        free = np.flatnonzero(~self.models[index].fixed)
        forces = np.zeros((3, self.models[index].fixed.size))
        # no rigid motion of any part escapes these
        forces[:, free] = np.where(np.arange(len(free)) % np.array([[5], [7], [3]]) == 0, 3.0, 1.0)
        u = self._displacements(index, forces)
        if not np.isfinite(u).all():
            raise ValueError("solve() returned values that are not finite")
        held = sp.csc_array(stiffness[free][:, free])
        residual = _residual(held, u[:, free], forces[:, free])
        if not residual <= messages.RESIDUAL_LIMIT or u[:, self.models[index].fixed.ravel()].any():
            expected = np.zeros(u.shape)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a singular matrix, reported by its residual
                expected[:, free] = spla.spsolve(held, forces[:, free].T).T
            if _residual(held, expected[:, free], forces[:, free]) <= messages.RESIDUAL_LIMIT:
                what = diagnosis(u, expected) or f"a relative residual of {residual:.1e}"
                raise ValueError(f"solve() does not fit stiffness(): {what}")
        return residual

    def _solve(self, op: int, ints: np.ndarray, reals: np.ndarray) -> None:
        at = 0
        for index, cases in ints[1:].reshape(-1, 2).tolist():
            start = clock()
            model = self.models[index]
            size = len(model.trace) if op == messages.TRACES else model.fixed.size
            forces = reals[at : at + cases * size].reshape(cases, size)
            at += cases * size
            if op == messages.TRACES:
                full = np.zeros((cases, model.fixed.size))
                full[:, model.trace] = forces
            else:
                full = forces
            full.flags.writeable = False  # through pipes and files, for traces and fields alike
            u = self._displacements(index, full)
            if index in self.unproven:
                self._prove(index, self.unproven.pop(index), full, u)
            if op == messages.TRACES:
                u = u[:, model.trace]
            self._reply([index, 0], [0, 0, clock() - start], u)

    def _stiffness(self, op: int, ints: np.ndarray, reals: np.ndarray) -> None:
        index, start = int(ints[0]), clock()
        lower = sp.coo_array(sp.tril(self._matrix(read_model(f"mesh-{index}.npz"))))
        head = [index, 0, lower.shape[0], lower.nnz]
        self._reply(np.concatenate([head, lower.row, lower.col]), [clock() - start, 0, 0],
                    lower.data)

    def _own_loads(self, op: int, ints: np.ndarray, reals: np.ndarray) -> None:
        index, steps, start = int(ints[0]), int(ints[3]), clock()
        if not callable(getattr(self.solver, "loads", None)):
            raise ValueError(
                "the solver's class has no method loads(model, step), though its entry says "
                "loads: true")
        model = read_model(f"mesh-{index}.npz")
        forces = [np.asarray(self.solver.loads(model, step + 1), float).ravel()
                  for step in range(steps)]
        if any(force.size != model.fixed.size for force in forces):
            raise ValueError(
                f"loads() returned {forces[0].size} nodal forces for {model.fixed.size} dofs")
        self._reply([index, 0], [clock() - start, 0, 0], np.array(forces))

    def _advance(self, op: int, ints: np.ndarray, reals: np.ndarray) -> None:
        index, commit, start = int(ints[0]), bool(ints[1]), clock()
        model, given = self.models[index], reals.copy()
        u, needed = (np.asarray(x, float).ravel()
                     for x in self.solver.advance(self.prepared[index], given))
        if u.size != given.size or needed.size != given.size:
            raise ValueError(
                f"advance() returned {u.size} displacements and {needed.size} forces for "
                f"{given.size} dofs")
        lost = np.flatnonzero(~(np.isfinite(u) & np.isfinite(needed)))
        if len(lost):
            place = ", ".join(f"{x:.6g}" for x in model.nodes[lost[0] // 3])
            raise ValueError(
                f"advance() returned what is no number (nan or infinite) on {len(lost)} dofs, the "
                f"first at ({place}): look for a division by zero or a root of a negative number "
                "in the matter there")
        fixed = model.fixed.ravel()
        if (u[fixed] != reals[fixed]).any():
            raise ValueError(
                "advance() returned displacements that are not those prescribed on clamped dofs")
        # what a step that has not converged leaves over would be taken for an answer
        size = max(np.linalg.norm(needed), np.linalg.norm(reals[~fixed]), np.finfo(float).tiny)
        left = np.linalg.norm((needed - reals)[~fixed]) / size
        if not left <= UNBALANCED:
            raise ValueError(
                "advance() returned forces that are not those it was given on free dofs: "
                f"{left:.1e} of them is left over, {UNBALANCED:.0e} allowed; the load step may be "
                "too large for its iterations")
        if commit:
            self.solver.commit(self.prepared[index])
        self._reply([index, 0], [0, 0, clock() - start],
                    np.concatenate([u, self.elastic[index] @ u - needed]))

    def _matrix(self, model: Model) -> sp.csr_array:
        """The solver's stiffness; raises ValueError for one that is not square or not symmetric:
        one triangle is sent.
        """
        element, known = "P2" if model.cells.shape[1] == 10 else "P1", getattr(
            self.solver, "elements", ("P1",))
        if element not in known:
            raise ValueError(
                f"the solver's class knows {', '.join(known)} only, as its attribute elements "
                f"says, and {model.name} has {element}: write element: {known[0]} in its entry "
                "under blackbox, or have the class know more")
        matrix = sp.csr_array(self.solver.stiffness(model))
        if matrix.shape != (model.fixed.size,) * 2:
            raise ValueError(
                f"stiffness() returned a matrix of shape {matrix.shape} for {model.fixed.size} "
                "dofs")
        if matrix.nnz:
            apart, size = abs(matrix - matrix.T).max(), abs(matrix).max()
            if apart > SYMMETRIC * size:
                raise ValueError(
                    "stiffness() returned a matrix that is not symmetric: |K - K^T| is "
                    f"{apart / size:.1e} |K|")
        return matrix

    def _prove(self, index: int, stiffness: sp.csr_array, forces: np.ndarray,
               u: np.ndarray) -> None:
        """The first answers of a model, others having been prepared since; raises ValueError when
        they are of another.
        """
        free = np.flatnonzero(~self.models[index].fixed)
        residual = _residual(stiffness[free], u, forces[:, free])
        if not residual <= messages.RESIDUAL_LIMIT:
            raise ValueError(
                f"solve() does not fit stiffness() of {self.models[index].name} any more, now that "
                f"{len(self.models)} models are prepared: a relative residual of {residual:.1e}. "
                "What solve() needs of a model is to be in what prepare() returns for it")

    def _displacements(self, index: int, forces: np.ndarray) -> np.ndarray:
        u = np.asarray(self.solver.solve(self.prepared[index], forces))
        if u.shape != forces.shape:
            raise ValueError(
                f"solve() returned displacements of shape {u.shape}, expected {forces.shape}: a "
                "row per load case, a column per dof")
        return u

    def _array(self, dtype) -> np.ndarray:
        count = int(np.frombuffer(self.requests.read(8), np.int64)[0])
        return np.frombuffer(self.requests.read(8 * count), dtype)

    def _reply(self, ints, seconds, reals) -> None:
        self.replies.writelines([messages.of_ints(ints), *messages.of_reals([seconds]),
                                 *messages.of_reals([reals])])
        self.replies.flush()


def _residual(matrix: sp.sparray, u: np.ndarray, forces: np.ndarray) -> float:
    """‖K u − f‖ / ‖f‖, the largest of all load cases."""
    left = np.linalg.norm((matrix @ u.T).T - forces,
                          axis=1) / np.maximum(np.linalg.norm(forces, axis=1), 1e-300)
    return float(np.max(left, initial=0.0))


if __name__ == "__main__":
    sys.path.extend(sys.argv[5:])
    try:
        solver = made(solver_class(sys.argv[1]), json.loads(sys.argv[2]))
    except NoSolver as absent:
        print(absent, file=sys.stderr)
        sys.exit(NO_SOLVER)
    with open(sys.argv[3], "rb") as requests, open(sys.argv[4], "wb") as replies:
        Server(solver, requests, replies).run()
