"""Codes that end after every answer: a run per request, until asking once for the interface
compliance is cheaper.

A run per request factorises anew for a few load cases; a run with a unit load on every trace dof, C
= N M⁻¹Nᵀ, costs more, once, and makes every later request the product F C. Nobody knows how many
requests will come: the compliance is formed once the runs have cost as much as it will. Whoever
goes on until that balances pays at most about twice the cheaper of the two ways.

Answers for a part on its joints: M = S + k, factorised once, in this process.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from orchestrator.blackbox.models import Matter
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import BadReply
from orchestrator.blackbox.transport.worker import Worker
from orchestrator.errors import BlackBoxError
from orchestrator.linalg import PLACED
from orchestrator.scene.mesh.checks import memory_left


MEMORY = 0.25  # of what is free: the share that compliances may take


@dataclass(frozen=True)
class Request:
    """CPU seconds of a run for some load cases, as measured: ``start`` and ``each``."""

    start: float
    each: float

    def of(self, cases: float) -> float:
        """Seconds for a number of load cases."""
        return self.start + cases * self.each


@dataclass
class Tally:
    """The trace requests to a model so far, and what they cost.

    name : of the subdomain
    trace_dofs : number of unit loads of the compliance
    request, unit_loads : cost of a run with load cases and of one with unit loads; None: not
        measured yet
    spent : seconds that the runs so far cost by ``request``
    compliance : (t, t) displacements under unit loads, once asked for
    seconds : of CPU that took
    """

    name: str
    trace_dofs: int
    request: Request | None = None
    unit_loads: Request | None = None
    spent: float = 0.0
    compliance: np.ndarray | None = None
    seconds: float = 0.0

    def due(self, cases: int) -> bool:
        """Whether to ask for the compliance instead of making one more run, for so many load
        cases.
        """
        if 8 * self.trace_dofs**2 > MEMORY * memory_left():
            return False
        if self.request is None or self.unit_loads is None:
            return cases >= self.trace_dofs
        return self.spent + self.request.of(cases) > self.unit_loads.of(self.trace_dofs)


class RunWorker(Worker):
    """Decides, model by model, between runs and the compliance. A code or a transport provides the
    two kinds of runs.
    """

    keeps_models = False

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.tallies: dict[int, Tally] = {}

    def run_cases(self, op: int, index: int, forces: np.ndarray,
                  name: str) -> tuple[np.ndarray, float]:
        """Displacements under forces (rhs, m), and the run's CPU seconds; notes the cost in
        ``tallies[index]``.
        """
        raise NotImplementedError

    def run_unit_loads(self, index: int, name: str) -> tuple[np.ndarray, float]:
        """Displacements (t, t) of the trace dofs under a unit load on each, and the run's CPU
        seconds.
        """
        return self.run_cases(messages.TRACES, index, np.eye(self.tallies[index].trace_dofs), name)

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]],
              names: list[str]) -> dict[int, np.ndarray]:
        return {index: self._answer(op, index, forces, name)
                for (index, forces), name in zip(jobs, names)}

    def compliances(self) -> list[dict[str, object]]:
        """Subdomains whose compliance was asked for, with the number of unit loads and the CPU
        seconds it took.
        """
        return [{"subdomain": tally.name, "unit_loads": tally.trace_dofs, "seconds": tally.seconds}
                for tally in self.tallies.values() if tally.compliance is not None]

    def _answer(self, op: int, index: int, forces: np.ndarray, name: str) -> np.ndarray:
        tally = self.tallies[index]
        if op != messages.TRACES:
            return self.run_cases(op, index, forces, name)[0]
        if tally.compliance is None and tally.due(len(forces)):
            tally.compliance, tally.seconds = self.run_unit_loads(index, name)
        if tally.compliance is None:
            answer = self.run_cases(op, index, forces, name)[0]
            tally.spent += tally.request.of(len(forces))
            return answer
        answer = forces @ tally.compliance
        if not np.isfinite(answer).all():
            raise self.failure("solving failed",
                               BadReply("displacements are not finite", "the forces are not"), name)
        return answer


class AlgebraWorker(Worker):
    """A worker without a process. Of a model the first nodes stand for the part: its joints', then
    those of the layer behind
    them, which have no stiffness; soles are plain matter, whose stiffness is added.
    """

    def __init__(self, *arguments):
        super().__init__(*arguments)
        # the model, its free dofs, their factor, and which nodes follow which
        self.models: dict[int, tuple] = {}

    def kill(self) -> None:
        super().kill()
        self.code.kill()

    def load(self, index: int, model: Model) -> None:
        begin = time.thread_time()
        part = self.code.condensed()
        self._check(model, part)
        free = np.flatnonzero(~model.fixed.ravel()[: part.stiffness.shape[0]])
        M = (self._soles(model)[free][:, free]).toarray() + part.stiffness[np.ix_(free, free)]
        try:
            factor = la.cholesky(M, lower=True)
        except la.LinAlgError as error:
            raise BlackBoxError(
                "factorising failed: its stiffness and its soles together are not positive",
                model.name) from error
        self.models[index] = model, free, factor, _followed(model, len(part.joints.points))
        self.count([self.code.seconds, time.thread_time() - begin, 0.0])

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]],
              names: list[str]) -> dict[int, np.ndarray]:
        begin, answers = time.thread_time(), {}
        for index, forces in jobs:
            model, free, factor, (inner, leader) = self.models[index]
            wanted = model.trace if op == messages.TRACES else slice(None)
            full, u = np.zeros((2, len(forces), model.fixed.size))
            full[:, wanted] = forces
            u[:, free] = la.cho_solve((factor, True), full[:, free].T).T
            u.reshape(len(u), -1, 3)[:, inner] = u.reshape(len(u), -1, 3)[:, leader]
            answers[index] = u[:, wanted]
        self.count([0.0, 0.0, time.thread_time() - begin])
        return answers

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        begin = time.thread_time()
        matrix = self._soles(model)
        if model.origin is not None and (model.origin.nodes >= 0).any():
            part, (own,) = self.code.condensed(), np.nonzero(model.origin.nodes >= 0)
            self._check(model, part, own)
            S = sp.coo_array(part.stiffness)
            dofs = (3 * own[: len(part.joints.points), None] + np.arange(3)).ravel()
            matrix = sp.csr_array(matrix + sp.csr_array((S.data, (dofs[S.row], dofs[S.col])),
                                                        shape=matrix.shape))
        self.count([time.thread_time() - begin, 0.0, 0.0])
        return matrix

    def own_loads(self, index: int, model: Model, steps: int) -> np.ndarray:
        self._check(model, part := self.code.condensed())
        return np.pad(self.code.loads(), ((0, 0), (0, model.fixed.size - part.stiffness.shape[0])))

    def _soles(self, model: Model) -> sp.csr_array:
        """(3n, 3n) stiffness of the model's plain matter."""
        sole = np.ones(len(model.cells), bool)
        if model.origin is not None:
            sole[: len(model.origin.cells)] = model.origin.cells < 0
        return Matter(model.nodes, model.cells[sole],
                      *model.materials[model.region[sole]].T).stiffness()

    def _check(self, model: Model, part, own: np.ndarray | slice = slice(None)) -> None:
        """Raises BlackBoxError where the model's nodes are not the joints'."""
        points = model.nodes[own][: len(part.joints.points)]
        if (
            len(points) < len(part.joints.points)
            or np.abs(points - part.joints.points).max() > PLACED * part.joints.size
        ):
            raise BlackBoxError("its joint nodes are not where its file has them", model.name)


def _followed(model: Model, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the layer behind the joints, and the joint node that each moves with: without
    stiffness, they have no motion of
    their own."""
    from scipy.spatial import cKDTree  # for this alone

    body = len(model.origin.nodes)
    return np.arange(joints, body), cKDTree(model.nodes[:joints]).query(model.nodes[joints:body])[1]
