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
from orchestrator.method.monitors.monitor import Monitor

DIVERGED = "diverged"
STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding
RUNAWAY = 1e6  # growth of the displacement that no convergent run shows
LOOSE = 10.0  # the same times ε: a body that springs alone hold goes 1/ε times as far as its load would deform it


class Ending(Monitor):
    """Says which iteration of a case is the last."""

    name = "ending"

    def __init__(self) -> None:
        self.reach = 0.0  # largest interface displacement of the first stage that moved
        self.residuals: list[float] = []
        self.problem, self.runaway = None, RUNAWAY

    def judge(self, now: Evaluation) -> Verdict:
        verdict, residual, moved = now.verdict, now.measures.residual, now.measures.moved
        if now.problem is not self.problem:  # its springs may have become weaker
            self.problem, self.runaway = now.problem, self._runaway(now.problem)
        self.reach = self.reach or moved
        self.residuals.append(residual)
        if verdict.anew:  # of another fixed point from here on
            self.residuals.clear()
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

    @staticmethod
    def _runaway(problem: Decomposition) -> float:
        return RUNAWAY if problem.all_perfect else max(RUNAWAY, LOOSE / problem.local.pairs.weakest(problem.space.team))

    def _stalled(self) -> bool:
        """Rounding has been reached and nothing improves any more."""
        if len(self.residuals) <= STALL or self.residuals[-1] > ROUNDING:
            return False
        return min(self.residuals[-STALL:]) > 0.5 * min(self.residuals[:-STALL])
