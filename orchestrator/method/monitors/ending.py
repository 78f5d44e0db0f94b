"""When iterations end, and what that is called in ``stop_reason``.

- ``converged``: the stopping criterion holds
- ``diverged``: the residual is not finite, or displacements have grown beyond all that a convergent
run shows
- ``stagnated at rounding``: the residual is down at rounding level and has not halved for ``STALL``
stages
- ``limit load``: no forces that the laws allow balance the loads, see ``limit_load``
- ``a body is let go``: it may be jammed, and iterations are too few to solve load steps one by one
- ``held by stabilisation alone``: all has settled, but springs carry more than the tolerance,
however weak they are
- ``error bound stands still``: the laws hold much better than was asked, see ``energy_error``
- ``max_iterations``: as many as were allowed
"""

from __future__ import annotations

import math

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import peak
from orchestrator.method.monitors import Evaluation, Monitor, Verdict

DIVERGED, HELD = "diverged", "held by stabilisation alone"
STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding
# growth of the displacement that no convergent run shows: rounding leaves four digits of strains.
# Slender bodies and those on soft springs go a million times as far as the first stage takes them
RUNAWAY = 1e12
# the same times ε: a body that springs alone hold goes 1/ε times as far as its load would deform it
LOOSE = 10.0


class Ending(Monitor):
    """Says which iteration of a case is the last."""

    name, remembered = "ending", ("reach", "residuals")

    def __init__(self) -> None:
        # largest interface displacement of the first stage that moved, or of what laws ask for
        self.reach = 0.0
        self.residuals: list[float] = []
        self.pairs, self.runaway = None, RUNAWAY

    def judge(self, now: Evaluation) -> Verdict:
        verdict, residual, moved = now.verdict, now.measures.residual, now.measures.moved
        if verdict.reason:
            return Verdict()
        # springs may have become weaker
        if not now.problem.all_perfect and now.problem.local.pairs is not self.pairs:
            # a whole problem would outlive the one that replaces it
            self.pairs = now.problem.local.pairs
            self.runaway = max(RUNAWAY, LOOSE / self.pairs.weakest(now.problem.space.team))
        self.reach = self.reach or (max(moved, self.asked(now.problem)) if moved > 0 else 0.0)
        self.residuals.append(residual)
        if verdict.anew:  # of another fixed point from here on
            self.residuals.clear()
        if verdict.met:
            return Verdict(reason="converged")
        if not math.isfinite(residual) or moved > self.runaway * self.reach > 0:
            return Verdict(reason=DIVERGED, led=True)
        if not verdict.changes and now.held:
            return Verdict(reason=HELD, led=True)
        if self._stalled():
            return Verdict(reason="stagnated at rounding")
        return Verdict(reason="max_iterations" if now.last else "")

    @staticmethod
    def asked(problem: Decomposition) -> float:
        """How far laws send bodies whatever the loads: press fits and jumps that they impose, and
        gaps that may close.
        """
        laws = [i.law for i in problem.scene.interfaces]
        return problem.space.team.max(max((max(law.imposed, peak(law.distance)) for law in laws),
                                          default=0.0))[0]

    def _stalled(self) -> bool:
        """Rounding has been reached and nothing improves any more."""
        if len(self.residuals) <= STALL or self.residuals[-1] > ROUNDING:
            return False
        return min(self.residuals[-STALL:]) > 0.5 * min(self.residuals[:-STALL])
