"""Codes that end after every answer: a run per request, until asking once for the interface
compliance is cheaper.

A run per request factorises anew for a few load cases; a run with a unit load on every trace dof, C
= N M⁻¹Nᵀ, costs more, once, and makes every later request the product F C. Nobody knows how many
requests will come: the compliance is formed once the runs have cost as much as it will. Whoever
goes on until that balances pays at most about twice the cheaper of the two ways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import BadReply
from orchestrator.blackbox.transport.worker import Worker
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
