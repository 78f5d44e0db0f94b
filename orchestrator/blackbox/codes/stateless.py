"""Codes that end after every answer: a run per request, until asking once for the interface compliance is cheaper.

A run per request factorises anew for a few load cases; a run with a unit load on every trace dof costs more, once,
and makes every later request a product of matrices. How many requests will follow is unknown, so they are run until
what they have cost reaches what the compliance would: at most twice the cheaper of the two ways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import BadReply
from orchestrator.blackbox.pool.worker import Worker


@dataclass
class Cost:
    """CPU seconds of a run with some load cases, as measured: ``start`` and ``each``."""

    start: float
    each: float

    def of(self, cases: int) -> float:
        """Seconds for a number of load cases."""
        return self.start + cases * self.each


@dataclass
class Ledger:
    """What a model's trace requests cost.

    Parameters
    ----------
    name : of the subdomain
    trace_dofs : number of unit loads of the compliance
    request, unit_loads : cost of a run with load cases and of one with unit loads; None: not measured yet
    spent : CPU seconds of the runs so far
    compliance : (t, t) displacements under unit loads, once asked for
    asked : CPU seconds that took
    """

    name: str
    trace_dofs: int
    request: Cost | None = None
    unit_loads: Cost | None = None
    spent: float = 0.0
    compliance: np.ndarray | None = None
    asked: float = 0.0

    def pays(self, cases: int) -> bool:
        """Whether the compliance is due instead of one more run."""
        if self.request is None or self.unit_loads is None:
            return cases >= self.trace_dofs
        return self.spent + self.request.of(cases) >= self.unit_loads.of(self.trace_dofs)

    def note(self) -> dict[str, object]:
        """For the summary."""
        return {"subdomain": self.name, "unit_loads": self.trace_dofs, "seconds": self.asked}


class StatelessWorker(Worker):
    """Decides, model by model, between runs and the compliance. A code provides the two kinds of runs."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.ledgers: dict[int, Ledger] = {}

    def run_cases(self, op: int, index: int, forces: np.ndarray, name: str) -> tuple[np.ndarray, float]:
        """Displacements under forces (rhs, m), and the run's CPU seconds; notes the cost in ``ledgers[index]``."""
        raise NotImplementedError

    def run_unit_loads(self, index: int, name: str) -> tuple[np.ndarray, float]:
        """Displacements (t, t) of the trace dofs under a unit load on each, and the run's CPU seconds."""
        raise NotImplementedError

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]], names: list[str]) -> dict[int, np.ndarray]:
        return {index: self._answer(op, index, forces, name) for (index, forces), name in zip(jobs, names)}

    def compliances(self) -> list[dict[str, object]]:
        """Subdomains whose compliance was asked for, with the number of unit loads and the CPU seconds it took."""
        return [ledger.note() for ledger in self.ledgers.values() if ledger.compliance is not None]

    def _answer(self, op: int, index: int, forces: np.ndarray, name: str) -> np.ndarray:
        ledger = self.ledgers[index]
        if op != messages.TRACES:
            return self.run_cases(op, index, forces, name)[0]
        if ledger.compliance is None and ledger.pays(len(forces)):
            ledger.compliance, ledger.asked = self.run_unit_loads(index, name)
        if ledger.compliance is None:
            answer, seconds = self.run_cases(op, index, forces, name)
            ledger.spent += seconds
            return answer
        answer = forces @ ledger.compliance
        if not np.isfinite(answer).all():
            raise self.failure("solving failed", BadReply("displacements are not finite", "the forces are not"), name)
        return answer
