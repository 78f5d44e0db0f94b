"""When iterations end, and what that is called in ``stop_reason``.

- ``converged``: the stopping criterion holds
- ``diverged``: the residual is not finite, or displacements have grown beyond all that a convergent run shows
- ``stagnated at rounding``: the residual is down at rounding level and has not halved for ``STALL`` stages
- ``held by stabilisation alone``: all has settled, but springs carry more than the tolerance: the laws have no balance
- ``max_iterations``: as many as were allowed
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.evaluation import Evaluation, Verdict
from orchestrator.method.monitors.monitor import Case, Monitor

DIVERGED = "diverged"
STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding
RUNAWAY = 1e6  # growth of the displacement that no convergent run shows
LOOSE = 10.0  # the same times ε: a body that springs alone hold goes 1/ε times as far as its load would deform it


class Ending(Monitor):
    """Says which iteration of a case is the last.

    Parameters
    ----------
    epsilon : the smallest ε of springs of stabilisation; infinite where there are none
    """

    name = "ending"

    def __init__(self, epsilon: float = math.inf):
        self.runaway = max(RUNAWAY, LOOSE / epsilon)
        self.reach = 0.0  # largest interface displacement of the first stage that moved
        self.residuals: list[float] = []

    @classmethod
    def of(cls, case: Case) -> Ending:
        problem = case.problem
        return cls() if problem.all_perfect else cls(problem.local.pairs.weakest(problem.space.team))

    def judge(self, now: Evaluation) -> Verdict:
        verdict, residual, moved = now.verdict, now.measures.residual, now.measures.moved
        self.reach = self.reach or moved
        self.residuals.append(residual)
        if verdict.met:
            return Verdict(reason="converged")
        if not math.isfinite(residual) or moved > self.runaway * self.reach > 0:
            return Verdict(reason=DIVERGED)
        if not verdict.changes and verdict.laws is not None and verdict.laws.held_by_springs(verdict.told["target"][1]):
            return Verdict(reason="held by stabilisation alone")
        if self._stalled():
            return Verdict(reason="stagnated at rounding")
        return Verdict(reason="max_iterations" if now.last else "")

    def state(self) -> dict[str, Any]:
        return {"reach": self.reach, "residuals": list(self.residuals)}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.reach, self.residuals = state["reach"], list(state["residuals"])
        return problem

    def _stalled(self) -> bool:
        """Rounding has been reached and nothing improves any more."""
        if len(self.residuals) <= STALL or self.residuals[-1] > ROUNDING:
            return False
        return min(self.residuals[-STALL:]) > 0.5 * min(self.residuals[:-STALL])
